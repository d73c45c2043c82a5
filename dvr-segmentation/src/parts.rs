//! Connected parts of a picture.

/// What most of a part's pixels must agree with.
const MOST: f64 = 0.5;

/// Takes out the parts of a picture's object that lie beyond the outline of the volume for the most part, and fills its
/// enclosed holes that the volume covers for the most part: highlights, and what has the object's colours by chance.
/// `belongs` is from 0 to 1, `covered` where the volume is shown.
pub(crate) fn join_parts(belongs: &mut [f32], covered: impl Fn(usize) -> bool, width: usize) {
    for is_object in [true, false] {
        let mut reached = vec![false; belongs.len()];
        for start in 0..belongs.len() {
            if reached[start] || (belongs[start] >= 0.5) != is_object {
                continue;
            }
            reached[start] = true;
            let mut part = vec![start];
            let (mut done, mut shown, mut is_open) = (0, 0, false);
            while done < part.len() {
                let pixel = part[done];
                done += 1;
                shown += usize::from(covered(pixel));
                let around = neighbours(pixel, width, belongs.len());
                is_open |= around.iter().any(Option::is_none);
                for next in around.into_iter().flatten() {
                    if !reached[next] && (belongs[next] >= 0.5) == is_object {
                        reached[next] = true;
                        part.push(next);
                    }
                }
            }
            let share = shown as f64 / part.len() as f64;
            if is_object && share < MOST {
                part.into_iter().for_each(|pixel| belongs[pixel] = 0.0);
            } else if !is_object && !is_open && share > MOST {
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
