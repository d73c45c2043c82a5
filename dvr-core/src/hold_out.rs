//! Which views are not trained on, where the dataset does not say.

use crate::dataset::natural_order;
use crate::scene::{Scene, Split};
use crate::view_split::ViewNames;

/// With fewer views than this, none is left out: each shows sides that no other does.
const FEWEST: usize = 5;

/// With fewer views than this, one is left out for testing, and none for validation.
///
/// Pixels of training views, kept back, would be no validation in place of a view: the surface there is learned all the
/// same, by the masks and by the rays of other views, whose photographs are compared with just these pixels.
const FEW: usize = 12;

/// One view in this many is for testing where nothing is said.
pub const HOLD_OUT_EVERY: usize = 8;

impl Scene {
    /// Divides the views in three parts, where the dataset does not: of the views to train on, one in `every` is for
    /// testing and one in `2 * every` for validation, evenly spread over the views in the order of their names. The
    /// result depends on names alone. 0 and 1 hold nothing out.
    ///
    /// Where the object is was decided when the scene was read: give the same share as
    /// [`ReadOptions::hold_out_every`](crate::dataset::ReadOptions::hold_out_every), so that views for testing had no
    /// say in that.
    ///
    /// Of fewer than twelve views, one is for testing and none for validation; of fewer than five, all are trained on.
    /// What the dataset itself keeps for validation or for testing stays as it is. The rule that held is part of the
    /// result.
    pub fn hold_out(&mut self, every: usize) -> ViewNames {
        let has = |split| self.views_of(split).next().is_some();
        let (has_validation, has_test) = (has(Split::Val), has(Split::Test));
        let train = in_order(&self.views.iter().map(|view| (view.name.as_str(), view.split)).collect::<Vec<_>>());
        let count = train.len();
        let HeldOut { validation, test } = HeldOut::of(count, every);
        let mut rule = match () {
            () if has_test => "the dataset says which views are for testing".to_owned(),
            () if every <= 1 => "no view is left out, and no figure tells how the mesh looks from other sides".into(),
            () if count < FEWEST => format!(
                "{count} views are too few to leave one out, and no figure tells how the mesh looks from other sides"
            ),
            () if count < FEW => format!("{count} views are few, and one of them is left out for testing"),
            () => format!("one view in {every} is left out for testing"),
        };
        if !has_test {
            test.iter().for_each(|&i| self.views[train[i]].split = Split::Test);
        }
        rule += &match () {
            () if has_validation => ", the dataset says which are for validation".to_owned(),
            () if !validation.is_empty() => format!(", one in {} for validation", every.saturating_mul(2)),
            () => ", none for validation: nothing is chosen by views during the run".into(),
        };
        if !has_validation {
            validation.iter().for_each(|&i| self.views[train[i]].split = Split::Val);
        }
        ViewNames::of(self, rule)
    }
}

/// Which of these views, by name and by what the dataset keeps them for, are for testing once [`Scene::hold_out`] has
/// divided them.
pub(crate) fn test_views(views: &[(&str, Split)], every: usize) -> Vec<bool> {
    let mut test: Vec<bool> = views.iter().map(|&(_, split)| split == Split::Test).collect();
    if !test.contains(&true) {
        let train = in_order(views);
        HeldOut::of(train.len(), every).test.into_iter().for_each(|i| test[train[i]] = true);
    }
    test
}

/// The views to train on, as far as the dataset says, in the order of their names.
fn in_order(views: &[(&str, Split)]) -> Vec<usize> {
    let mut train: Vec<usize> = (0..views.len()).filter(|&i| views[i].1 == Split::Train).collect();
    train.sort_by(|&a, &b| natural_order(views[a].0, views[b].0));
    train
}

/// Which of so many views, in the order of their names, [`Scene::hold_out`] takes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HeldOut {
    /// For validation: the first of every second group of `every`, but of the first group; where that is none, the end
    /// of the first quarter of all.
    pub validation: Vec<usize>,
    /// For testing: the middle of each group; of few views, and where no group has a middle, the middle of all.
    pub test: Vec<usize>,
}

impl HeldOut {
    /// Of `count` views that the dataset leaves open, with one in `every` for testing.
    pub fn of(count: usize, every: usize) -> Self {
        match count {
            _ if every <= 1 || count < FEWEST => Self::default(),
            _ if count < FEW => Self { validation: Vec::new(), test: vec![count / 2] },
            _ => {
                let mut validation: Vec<usize> = (every..count).step_by(every.saturating_mul(2)).collect();
                let mut test: Vec<usize> = (every / 2..count).step_by(every).collect();
                if validation.is_empty() {
                    validation.push(count / 4);
                }
                if test.is_empty() {
                    test.push(count / 2);
                }
                Self { validation, test }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::{Camera, Similarity};
    use crate::error::Error;
    use crate::pixels::stored;
    use crate::scene::{GroundTruth, View};
    use crate::view_split::ViewSplit;

    /// A scene with views of these names, to train on.
    fn scene(names: impl IntoIterator<Item = String>) -> Scene {
        let view = |name| {
            let camera = Camera::look_at(2, 2, 2.0, DVec3::Z * 2.0, DVec3::ZERO, DVec3::Y);
            View::new(name, camera, stored(image::RgbImage::new(2, 2)), None)
        };
        Scene {
            name: "names".into(),
            source: "names".into(),
            format: "test",
            views: names.into_iter().map(view).collect(),
            object_to_world: Similarity::default(),
            region: crate::region::Region::default(),
            sparse_points: None,
            ground_truth: GroundTruth::default(),
            warnings: Vec::new(),
        }
    }

    fn numbered(count: usize) -> Scene {
        scene((0..count).map(|i| format!("view_{i}")))
    }

    fn counts(names: &ViewNames) -> [usize; 3] {
        [names.train.len(), names.validation.len(), names.test.len()]
    }

    #[test]
    fn one_view_in_eight_tests_and_one_in_sixteen_validates_evenly_spread() {
        for (count, parts) in [(12, [10, 1, 1]), (16, [13, 1, 2]), (49, [40, 3, 6]), (100, [82, 6, 12])] {
            let names = numbered(count).hold_out(8);
            assert_eq!(counts(&names), parts, "of {count} views");
            assert!(names.rule.contains("one view in 8") && names.rule.contains("one in 16"), "{}", names.rule);
        }
        let names = numbered(49).hold_out(8);
        assert_eq!(names.test, ["view_4", "view_12", "view_20", "view_28", "view_36", "view_44"]);
        assert_eq!(names.validation, ["view_8", "view_24", "view_40"]);
    }

    #[test]
    fn no_view_has_two_parts_and_enough_are_left_whatever_the_share() {
        for (every, count) in (2..40).flat_map(|every| (2..60).map(move |count| (every, count))) {
            let mut scene = numbered(count);
            let names = scene.hold_out(every);
            let [train, validation, test] = counts(&names);
            assert_eq!(train + validation + test, count);
            assert!(train >= 2 && 4 * train >= count, "{train} of {count} with {every}");
            assert_eq!((test > 0, validation > 0), (count >= FEWEST, count >= FEW), "{count} with {every}");
            ViewSplit::of(&scene).unwrap();
        }
    }

    #[test]
    fn the_views_for_testing_are_known_before_they_are_divided() {
        for (count, every) in [(4, 8), (9, 8), (30, 8), (30, 3), (30, 0)] {
            let mut scene = scene((0..count).rev().map(|i| format!("view_{i}")));
            let before: Vec<(String, Split)> = scene.views.iter().map(|view| (view.name.clone(), view.split)).collect();
            let before: Vec<(&str, Split)> = before.iter().map(|(name, split)| (name.as_str(), *split)).collect();
            scene.hold_out(every);
            let after: Vec<bool> = scene.views.iter().map(|view| view.split == Split::Test).collect();
            assert_eq!(test_views(&before, every), after, "{count} views, one in {every}");
        }
        let of_dataset = [("a", Split::Train), ("b", Split::Test), ("c", Split::Val), ("d", Split::Train)];
        assert_eq!(test_views(&of_dataset, 2), [false, true, false, false]);
    }

    #[test]
    fn few_views_lose_one_or_none_and_the_rule_says_so() {
        let names = numbered(4).hold_out(8);
        assert!(counts(&names) == [4, 0, 0] && names.rule.contains("4 views are too few"), "{names}");
        let names = numbered(11).hold_out(8);
        assert!(counts(&names) == [10, 0, 1] && names.rule.contains("11 views are few"), "{names}");
        assert!(names.rule.contains("none for validation"), "{names}");
        let names = numbered(30).hold_out(0);
        assert!(counts(&names) == [30, 0, 0] && names.rule.contains("no view is left out"), "{names}");
    }

    #[test]
    fn the_parts_depend_on_names_and_not_on_the_order_of_the_files() {
        let sorted = |mut names: ViewNames| {
            [&mut names.train, &mut names.validation, &mut names.test].into_iter().for_each(|part| part.sort());
            names
        };
        let backwards = scene((0..20).rev().map(|i| format!("view_{i}"))).hold_out(8);
        assert_eq!(sorted(backwards), sorted(numbered(20).hold_out(8)));
    }

    #[test]
    fn what_the_dataset_keeps_for_validation_and_testing_stays() {
        let divided = |parts: &[(usize, Split)]| {
            let mut scene = numbered(20);
            parts.iter().for_each(|&(i, split)| scene.views[i].split = split);
            scene.hold_out(8)
        };
        let names = divided(&[(0, Split::Val), (1, Split::Test), (2, Split::Test)]);
        assert_eq!((counts(&names), names.test), ([17, 1, 2], vec!["view_1".to_owned(), "view_2".into()]));
        let names = divided(&[(1, Split::Test)]);
        assert!(counts(&names) == [18, 1, 1] && names.rule.contains("the dataset"), "{names}");
        let names = divided(&[(1, Split::Val)]);
        assert!(counts(&names) == [17, 1, 2] && names.rule.contains("the dataset"), "{names}");
    }

    #[test]
    fn a_scene_that_is_read_again_keeps_its_parts_and_what_is_gone_is_said() {
        let names = numbered(16).hold_out(8);
        let mut again = scene((0..16).rev().map(|i| format!("view_{i}")));
        names.apply(&mut again).unwrap();
        let split = ViewSplit::of(&again).unwrap();
        assert_eq!((split.train.len(), split.validation.len(), split.test.len()), (13, 1, 2));
        assert!(again.warnings.is_empty());

        again.views.retain(|view| view.name != "view_4" && view.name != "view_7");
        names.apply(&mut again).unwrap();
        names.apply(&mut again).unwrap();
        let said = again.warnings.join("\n");
        assert_eq!(again.warnings.len(), 2, "{said}");
        assert!(said.contains("1 to train on: view_7") && said.contains("1 for testing: view_4"), "{said}");
        assert_eq!(names.missing(&again, Split::Test), ["view_4"]);
    }

    #[test]
    fn a_view_that_a_run_did_not_know_is_refused_by_name() {
        let names = numbered(12).hold_out(8);
        match names.apply(&mut numbered(13)) {
            Err(Error::ViewsUnknown { views, .. }) => assert_eq!(views, ["view_12"]),
            other => panic!("{other:?}"),
        }
    }
}
