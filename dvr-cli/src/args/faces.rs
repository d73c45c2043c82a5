//! How many faces a mesh may have: `--faces`.

use dvr_core::mesh::LEAST_FACES;

/// Most faces that can be asked for.
const MOST_FACES: usize = 100_000_000;

/// The value of `--faces`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaceBudget {
    /// All that there are.
    Full,
    /// At most so many.
    AtMost(usize),
}

impl FaceBudget {
    /// The number, where there is one.
    pub fn limit(self) -> Option<usize> {
        match self {
            Self::Full => None,
            Self::AtMost(faces) => Some(faces),
        }
    }
}

/// Reads `full`, `50000`, `50k` or `1M`.
pub(super) fn parse_faces(text: &str) -> Result<FaceBudget, String> {
    if text == "full" {
        return Ok(FaceBudget::Full);
    }
    let (number, factor) = match text.char_indices().last() {
        Some((i, 'k' | 'K')) => (&text[..i], 1_000),
        Some((i, 'M')) => (&text[..i], 1_000_000),
        _ => (text, 1),
    };
    let faces = number.parse::<usize>().ok().and_then(|number| number.checked_mul(factor));
    let faces = faces.filter(|faces| (LEAST_FACES..=MOST_FACES).contains(faces)).map(FaceBudget::AtMost);
    faces.ok_or_else(|| {
        format!("write full, or a number of faces from {LEAST_FACES} to {}M, e.g. 50k", MOST_FACES / 1_000_000)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_faces_are_read_or_refused() {
        let read = |text: &str| parse_faces(text).map(FaceBudget::limit);
        assert_eq!((read("full"), read("4"), read("50k")), (Ok(None), Ok(Some(4)), Ok(Some(50_000))));
        assert_eq!((read("200K"), read("100M")), (Ok(Some(200_000)), Ok(Some(100_000_000))));
        for wrong in ["0", "3", "-1", "banana", "", "k", "1.5k", "101M", "1e5", "nan", "99999999999999999999k", "Full"]
        {
            assert!(parse_faces(wrong).is_err_and(|said| said.contains("from 4 to 100M")), "{wrong}");
        }
    }
}
