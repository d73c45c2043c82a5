//! Connected parts.

/// Takes the part of `left` that is connected to `start` by `beside` out of it: the indices of what is in it, `start`
/// first.
///
/// ```
/// use dvr_core::flood;
///
/// let mut left = [true, true, false, true];
/// let beside = |at: usize| [at.checked_sub(1), Some(at + 1).filter(|&at| at < 4)].into_iter().flatten();
/// assert_eq!(flood(0, &mut left, beside), [0, 1]);
/// assert_eq!(left, [false, false, false, true]);
/// ```
pub fn flood<I: Iterator<Item = usize>>(start: usize, left: &mut [bool], beside: impl Fn(usize) -> I) -> Vec<usize> {
    left[start] = false;
    let (mut region, mut next) = (vec![start], 0);
    while let Some(&member) = region.get(next) {
        next += 1;
        region.extend(beside(member).filter(|&other| std::mem::take(&mut left[other])));
    }
    region
}
