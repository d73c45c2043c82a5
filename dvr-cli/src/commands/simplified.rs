//! What simplification did to a mesh, for people.

use dvr_core::metrics::Simplification;

/// One line; distances are in the units of the scene's files. `is_remeshed` says whether its triangles are others.
pub fn simplified_to(faces: usize, simplification: &Simplification, is_remeshed: bool) -> String {
    let done = if is_remeshed { "remeshed" } else { "simplified" };
    let Simplification { faces_before, mean_distance, max_distance, open_edges } = simplification;
    let closed = match open_edges {
        0 => "watertight".to_owned(),
        edges => format!("{edges} open edges"),
    };
    format!(
        "{done}: {faces_before} to {faces} faces, {closed}; the surface moved by {} in the mean, {} at most, in the units \
         of the scene",
        short(*mean_distance),
        short(*max_distance)
    )
}

/// Three digits that count.
fn short(distance: f64) -> String {
    if distance == 0.0 {
        return "0".into();
    }
    let digits = (2 - distance.abs().log10().floor() as i32).max(0);
    if digits > 9 { format!("{distance:.2e}") } else { format!("{distance:.*}", digits as usize) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_three_digits_that_count() {
        assert_eq!([0.0, 0.012345, 1.0, 123.456, 98_765.4].map(short), ["0", "0.0123", "1.00", "123", "98765"]);
        assert_eq!(short(1.23e-9), "1.23e-9");
    }
}
