//! Comparisons of numbers that refuse what is not finite.

/// The largest of some errors, which are not negative; 0 of none.
///
/// # Panics
/// At NaN and infinity.
#[track_caller]
pub fn largest<T: Into<f64>>(values: impl IntoIterator<Item = T>) -> f64 {
    let mut largest = 0.0;
    for (place, value) in values.into_iter().enumerate() {
        let value = value.into();
        assert!(value.is_finite(), "value {place} is {value}");
        largest = f64::max(largest, value);
    }
    largest
}

/// Largest absolute difference, 0 of none.
///
/// # Panics
/// At NaN and infinity, and where one has more values than the other.
#[track_caller]
pub fn max_difference<A: Copy + Into<f64>, B: Copy + Into<f64>>(a: &[A], b: &[B]) -> f64 {
    let [a, b] = [finite(a), finite(b)];
    assert_eq!(a.len(), b.len(), "as many values on both sides");
    largest(a.iter().zip(&b).map(|(a, b)| (a - b).abs()))
}

/// `|a - b| / |b|` in the Euclidean norm.
///
/// # Panics
/// At NaN and infinity, and where one has more values than the other.
#[track_caller]
pub fn relative_difference<A: Copy + Into<f64>, B: Copy + Into<f64>>(a: &[A], b: &[B]) -> f64 {
    let [a, b] = [finite(a), finite(b)];
    assert_eq!(a.len(), b.len(), "as many values on both sides");
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut a.iter().zip(&b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied()).max(f64::MIN_POSITIVE)
}

/// The values in double precision.
#[track_caller]
fn finite<T: Copy + Into<f64>>(values: &[T]) -> Vec<f64> {
    let values: Vec<f64> = values.iter().map(|&value| value.into()).collect();
    if let Some(place) = values.iter().position(|value| !value.is_finite()) {
        panic!("value {place} of {} is {}", values.len(), values[place]);
    }
    values
}

#[cfg(test)]
mod tests {
    use std::panic::catch_unwind;

    use super::*;

    #[test]
    fn differences_are_those_of_the_numbers() {
        assert_eq!(max_difference(&[1.0, 2.0], &[1.5f32, 2.0]), 0.5);
        assert_eq!(relative_difference(&[3.0, 0.0], &[0.0, 4.0]), 1.25);
        assert_eq!((largest([1.0f32, 3.0, 2.0]), largest([0.0; 0])), (3.0, 0.0));
    }

    #[test]
    fn nan_infinity_and_other_lengths_are_refused() {
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(catch_unwind(|| max_difference(&[wrong], &[wrong])).is_err());
            assert!(catch_unwind(|| relative_difference(&[1.0], &[wrong])).is_err());
            assert!(catch_unwind(|| largest([wrong, 1.0])).is_err());
        }
        assert!(catch_unwind(|| max_difference(&[1.0], &[1.0, 2.0])).is_err());
    }
}
