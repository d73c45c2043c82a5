//! What stands behind a turntable: it is the same in all pictures, while the object turns. In the object's space it has no place, and
//! what a plane sweep makes of it may lie anywhere.

use rayon::prelude::*;

use crate::shrunk::Shrunk;

/// A pixel is static where its channels, of 255, differ by no more than this from their medians in this share of the views.
const ALIKE: u8 = 16;
const STATIC: f32 = 0.8;

/// Which pixels are static, by the views that are `asked`; empty where their pictures differ in size.
pub(crate) fn static_pixels(views: &[Shrunk], asked: &[bool]) -> Vec<bool> {
    let asked: Vec<&Shrunk> = views.iter().zip(asked).filter_map(|(view, asked)| asked.then_some(view)).collect();
    let size = |view: &Shrunk| (view.width, view.height);
    let Some(first) = asked.first().filter(|first| views.iter().all(|view| size(view) == size(first))) else {
        return Vec::new();
    };
    let is_static = |pixel: usize| {
        let median = [0, 1, 2].map(|channel| {
            let mut values: Vec<u8> = asked.iter().map(|view| view.colors[pixel][channel]).collect();
            let at = values.len() / 2;
            *values.select_nth_unstable(at).1
        });
        let is_alike = |color: [u8; 3]| color.iter().zip(median).all(|(value, median)| value.abs_diff(median) <= ALIKE);
        let alike = asked.iter().filter(|view| is_alike(view.colors[pixel])).count();
        alike as f32 >= STATIC * asked.len() as f32
    };
    (0..first.len()).into_par_iter().map(is_static).collect()
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, View, stored};
    use glam::DVec3;
    use image::{Rgb, RgbImage};

    use super::*;

    fn view(index: u32, (width, height): (u32, u32)) -> Shrunk {
        // Stripes that stand still on the left, and others that move on the right.
        let stripes = |u: u32, v: u32| if u < 8 { v * 20 } else { (v + 3 * index) * 20 };
        let picture = RgbImage::from_fn(width, height, |u, v| Rgb([(stripes(u, v) % 240) as u8; 3]));
        let camera = Camera::look_at(width, height, 20.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
        Shrunk::new(&View::new(index.to_string(), camera, stored(picture), None), 100)
    }

    #[test]
    fn what_is_the_same_in_most_views_is_static_and_pictures_of_other_sizes_say_nothing() {
        let views: Vec<Shrunk> = (0..10).map(|index| view(index, (16, 12))).collect();
        let found = static_pixels(&views, &[true; 10]);
        assert_eq!(found.len(), 16 * 12);
        assert!(found.iter().enumerate().all(|(pixel, found)| *found == (pixel % 16 < 8)));
        // A view that differs is outvoted, two of ten are, three are not.
        let of = |others: usize| {
            let views: Vec<Shrunk> = (0..10).map(|index| view(if index < others { 1 } else { 0 }, (16, 12))).collect();
            static_pixels(&views, &[true; 10])[10]
        };
        assert!(of(2) && !of(3));
        // Those that are not asked have no say.
        let asked: Vec<bool> = (0..10).map(|index| index == 0).collect();
        assert!(static_pixels(&views, &asked).iter().all(|found| *found));
        let sizes: Vec<Shrunk> = vec![view(0, (16, 12)), view(0, (12, 16))];
        assert!(static_pixels(&sizes, &[true; 2]).is_empty());
    }
}
