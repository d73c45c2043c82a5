//! Why an object cannot be found by cameras and masks.

/// Why the object cannot be moved into the unit cube.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NormalisationError {
    /// Fewer than two masks show an object.
    #[error(
        "{shown} of {masks} masks show an object. At least two views must show it: check that the masks are white where the \
         object is."
    )]
    TooFewMasks {
        /// Masks that show an object.
        shown: usize,
        /// All masks.
        masks: usize,
    },
    /// The cameras all look along one direction.
    #[error(
        "all cameras look along the same direction, so nothing shows how far the object is. Add views from other sides, or \
         check the cameras."
    )]
    ParallelCameras,
    /// What the cameras look at lies behind most of them.
    #[error(
        "the object would lie behind the cameras. Check that the cameras look along +z (OpenCV), and that the poses are not \
         inverted."
    )]
    BehindCameras,
    /// There is no place that agrees with most of the masks.
    #[error(
        "the masks of {views} views agree on no place in space{}. Check that masks and cameras belong to the same pictures, \
         that masks are white on the object, and the cameras' convention.",
        most(odd)
    )]
    Disagreement {
        /// How many views were compared.
        views: usize,
        /// Those that disagree most with the others, ascending, as indices into the views that were given.
        odd: Vec<usize>,
    },
}

/// "; views 3, 4 and 7 disagree most".
fn most(odd: &[usize]) -> String {
    if odd.is_empty() { String::new() } else { format!("; {} most", name_views(odd, "disagrees", "disagree")) }
}

/// "view 3 has", "views 3, 4 and 7 have".
pub(crate) fn name_views(views: &[usize], singular: &str, plural: &str) -> String {
    match views {
        [] => String::new(),
        [one] => format!("view {one} {singular}"),
        [rest @ .., last] => {
            let rest: Vec<String> = rest.iter().map(usize::to_string).collect();
            format!("views {} and {last} {plural}", rest.join(", "))
        }
    }
}
