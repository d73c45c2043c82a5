//! How far COLMAP is, by its lines.

/// Parts that are done, and of how many where the line says so.
///
/// Features, matches and undistortion count: `Processed file [3/49]`, `Matching image [3/49]`, and pairs of blocks,
/// `Matching block [2/5, 3/5] in 1.2s` (`Processing block` in later versions). The mapper says how many pictures its model
/// has: `Registering image #12 (31)`, later `(num_reg_frames=31)`.
pub(crate) fn progress_of(line: &str) -> Option<(usize, Option<usize>)> {
    if let Some((_, after)) = line.split_once("Registering ") {
        let count = after.rsplit_once('(')?.1;
        let digits: String = count.chars().filter(char::is_ascii_digit).collect();
        return digits.parse().ok().map(|count| (count, None));
    }
    let inside = line.split_once('[')?.1.split_once(']')?.0;
    let fractions: Option<Vec<(usize, usize)>> = inside
        .split(", ")
        .map(|fraction| {
            let (done, total) = fraction.split_once('/')?;
            Some((done.trim().parse().ok()?, total.trim().parse().ok()?))
        })
        .collect();
    match fractions?[..] {
        [(done, total)] if done <= total => Some((done, Some(total))),
        [(row @ 1.., rows), (column, columns)] if row <= rows && column <= columns => {
            Some((((row - 1).checked_mul(columns)?).checked_add(column)?, Some(rows.checked_mul(columns)?)))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_every_version_say_how_far_it_is() {
        for (line, expected) in [
            ("Processed file [3/49]", (3, Some(49))),
            ("I20250101 10:00:00.1 77 feature_extraction.cc:261] Processed file [3/49]", (3, Some(49))),
            ("Matching block [2/5, 3/5] in 1.250s", (8, Some(25))),
            ("Processing block [1/1, 1/1]", (1, Some(1))),
            ("Matching image [49/49] in 0.1s", (49, Some(49))),
            ("Undistorting image [7/49]", (7, Some(49))),
            ("Registering image #12 (31)", (31, None)),
            (
                "I20250101 10:00:00.1 77 incremental_pipeline.cc:51] Registering image #12 (num_reg_frames=31)",
                (31, None),
            ),
        ] {
            assert_eq!(progress_of(line), Some(expected), "{line}");
        }
        for line in
            ["", "Elapsed time: 0.1 [minutes]", "  => Image sees 238 / 1258 points", "[3/2]", "[0/0, 1/0]", "[x/y]"]
        {
            assert!(progress_of(line).is_none_or(|(done, total)| Some(done) <= total), "{line}");
        }
        assert_eq!(progress_of(&format!("[{0}/{0}, 1/{0}]", usize::MAX)), None);
    }
}
