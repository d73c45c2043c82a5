//! Connected parts of a picture.

use dvr_core::flood;

/// What most of a part's pixels must agree with.
const MOST: f64 = 0.5;

/// Takes out the parts of a picture's object that lie beyond the outline of the volume for the most part, and fills its
/// enclosed holes that the volume covers for the most part: highlights, and what has the object's colours by chance.
/// `belongs` is from 0 to 1, `covered` where the volume is shown.
pub(crate) fn join_parts(belongs: &mut [f32], covered: impl Fn(usize) -> bool, width: usize) {
    let len = belongs.len();
    let beside = |pixel: usize| neighbours(pixel, width, len).into_iter().flatten();
    for is_object in [true, false] {
        let mut left: Vec<bool> = belongs.iter().map(|&belongs| (belongs >= 0.5) == is_object).collect();
        for start in 0..len {
            if !left[start] {
                continue;
            }
            let part = flood(start, &mut left, beside);
            let shown = part.iter().filter(|&&pixel| covered(pixel)).count() as f64;
            let is_open = || part.iter().any(|&pixel| neighbours(pixel, width, len).iter().any(Option::is_none));
            if is_object && shown < MOST * part.len() as f64 {
                part.into_iter().for_each(|pixel| belongs[pixel] = 0.0);
            } else if !is_object && shown > MOST * part.len() as f64 && !is_open() {
                part.into_iter().for_each(|pixel| belongs[pixel] = 1.0);
            }
        }
    }
}

/// The pixels beside one; `None` beyond the frame.
fn neighbours(pixel: usize, width: usize, len: usize) -> [Option<usize>; 4] {
    let u = pixel % width;
    [
        (u > 0).then(|| pixel - 1),
        (u + 1 < width).then_some(pixel + 1),
        pixel.checked_sub(width),
        Some(pixel + width).filter(|&below| below < len),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_beyond_the_volume_go_and_holes_within_it_are_filled() {
        let picture = ["..........", ".#####..#.", ".#.#.#..#.", ".#####....", ".........."];
        let width = picture[0].len();
        let mut belongs: Vec<f32> =
            picture.iter().flat_map(|row| row.bytes().map(|byte| f32::from(u8::from(byte == b'#')))).collect();
        // The volume shows the left half but for one hole.
        join_parts(&mut belongs, |pixel| pixel % width < 6 && pixel != 2 * width + 4, width);
        let shown: Vec<String> = belongs
            .chunks(width)
            .map(|row| row.iter().map(|&value| if value >= 0.5 { '#' } else { '.' }).collect())
            .collect();
        assert_eq!(shown, ["..........", ".#####....", ".###.#....", ".#####....", ".........."]);
    }
}
