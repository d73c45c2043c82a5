//! Intersection over union.

use crate::error::{ComparisonError, Result};

/// Intersection over union of two sets, given by whether each item (a pixel, a point) belongs to them.
///
/// 1 where both are empty: they agree. (DVR's reference code divides 0 by 0.)
///
/// # Errors
/// When the two have different lengths.
pub fn intersection_over_union(predicted: &[bool], truth: &[bool]) -> Result<f64> {
    if predicted.len() != truth.len() {
        return Err(ComparisonError::Lengths { predicted: predicted.len(), truth: truth.len() }.into());
    }
    let count = |holds: fn(bool, bool) -> bool| predicted.iter().zip(truth).filter(|&(&a, &b)| holds(a, b)).count();
    let union = count(|a, b| a || b);
    Ok(if union == 0 { 1.0 } else { count(|a, b| a && b) as f64 / union as f64 })
}

#[cfg(test)]
mod tests {
    use super::intersection_over_union as iou;

    #[test]
    fn sets_are_compared_by_what_they_share() {
        assert_eq!(iou(&[true, true, false, false], &[true, false, true, false]).unwrap(), 1.0 / 3.0);
        assert_eq!(iou(&[true; 3], &[false; 3]).unwrap(), 0.0);
        assert_eq!(iou(&[false; 3], &[false; 3]).unwrap(), 1.0, "two empty sets agree");
        assert_eq!(iou(&[], &[]).unwrap(), 1.0);
        assert!(iou(&[true], &[]).unwrap_err().to_string().contains("1 predicted"));
    }
}
