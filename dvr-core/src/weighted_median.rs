//! The median of values that count more or less.

use std::ops::Add;

/// The value at which half of the weight is reached; 0 where there are no items. Sorts them by their values.
///
/// `of` gives an item's value and its weight, which is not negative.
pub fn weighted_median<T, W>(items: &mut [T], of: impl Fn(&T) -> (f32, W)) -> f32
where
    W: Add<Output = W> + Copy + Default + PartialOrd,
{
    items.sort_unstable_by(|a, b| of(a).0.total_cmp(&of(b).0));
    let total = items.iter().fold(W::default(), |sum, item| sum + of(item).1);
    let mut reached = W::default();
    for (value, weight) in items.iter().map(&of) {
        reached = reached + weight;
        if reached + reached >= total {
            return value;
        }
    }
    items.last().map_or(0.0, |item| of(item).0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn median(items: &[(f32, f32)]) -> f32 {
        weighted_median(&mut items.to_vec(), |item| *item)
    }

    #[test]
    fn half_of_the_weight_is_reached_at_the_median() {
        assert_eq!(median(&[(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), 2.0);
        assert_eq!(median(&[(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)]), 3.0, "what weighs more than all others");
        assert_eq!(median(&[(1.0, 1.0), (2.0, 1.0)]), 1.0, "the lower one of two");
        assert_eq!(median(&[(0.4, 0.0)]), 0.4);
        assert_eq!(median(&[]), 0.0);
    }

    #[test]
    fn items_are_sorted_by_their_values() {
        let mut items = [('b', 0.2, 1.0), ('c', 0.3, 9.0), ('a', 0.1, 1.0)];
        assert_eq!(weighted_median(&mut items, |&(_, value, weight): &(char, f32, f64)| (value, weight)), 0.3);
        assert_eq!(items.map(|(name, ..)| name), ['a', 'b', 'c']);
    }
}
