//! Texels that no photograph sees take their colours from around.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Replaces colours that are `NaN` by push and pull (Gortler, Grzeszczuk, Szeliski and Cohen, The Lumigraph, SIGGRAPH
/// 1996, section 3.4.3): means over ever larger squares of what is known.
pub(crate) fn fill(colors: &mut [Vec3], size: u32) {
    // Colour times weight, and weight.
    let known = |color: &Vec3| if color.is_nan() { Vec4::ZERO } else { color.extend(1.0) };
    let mut levels = vec![(size as usize, colors.par_iter().map(known).collect::<Vec<Vec4>>())];
    while let Some((edge, fine)) = levels.last()
        && *edge > 1
    {
        let coarse = pull(fine, *edge);
        levels.push((edge.div_ceil(2), coarse));
    }
    while levels.len() > 1
        && let Some((coarse_edge, coarse)) = levels.pop()
    {
        let Some((edge, fine)) = levels.last_mut() else { break };
        push(fine, *edge, &coarse, coarse_edge);
    }
    let filled = &levels[0].1;
    colors.par_iter_mut().zip(filled).for_each(|(color, filled)| {
        if color.is_nan() {
            *color = if filled.w > 0.0 { filled.truncate() / filled.w } else { Vec3::splat(0.5) };
        }
    });
}

/// Means over squares of two by two.
fn pull(fine: &[Vec4], edge: usize) -> Vec<Vec4> {
    let half = edge.div_ceil(2);
    (0..half * half)
        .into_par_iter()
        .map(|i| {
            let (u, v) = (2 * (i % half), 2 * (i / half));
            let at = |u: usize, v: usize| if u < edge && v < edge { fine[v * edge + u] } else { Vec4::ZERO };
            let sum = at(u, v) + at(u + 1, v) + at(u, v + 1) + at(u + 1, v + 1);
            if sum.w > 1.0 { sum / sum.w } else { sum }
        })
        .collect()
}

/// What is not known takes the colour of the coarser level.
fn push(fine: &mut [Vec4], edge: usize, coarse: &[Vec4], coarse_edge: usize) {
    fine.par_iter_mut().enumerate().for_each(|(i, value)| {
        if value.w < 1.0 {
            let above = coarse[i / edge / 2 * coarse_edge + i % edge / 2];
            if above.w > 0.0 {
                *value += (1.0 - value.w) * above / above.w;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_stays_and_the_rest_comes_from_what_is_near() {
        let size = 37u32;
        let known = |u: u32| !(6..=30).contains(&u);
        let mut colors: Vec<Vec3> = (0..size * size)
            .map(|i| if known(i % size) { Vec3::splat(f32::from(u8::from(i % size > 18))) } else { Vec3::NAN })
            .collect();
        let before = colors.clone();
        fill(&mut colors, size);
        let grey = |u: u32| colors[(18 * size + u) as usize].x;
        assert!(colors.iter().zip(&before).all(|(after, before)| before.is_nan() || after == before));
        assert!(grey(7) < 0.2 && grey(29) > 0.8, "{} {}", grey(7), grey(29));
        assert!(colors.iter().all(|color| color.min_element() >= 0.0 && color.max_element() <= 1.0));
    }

    #[test]
    fn where_nothing_is_known_it_is_grey() {
        let mut colors = vec![Vec3::NAN; 25];
        fill(&mut colors, 5);
        assert_eq!(colors, [Vec3::splat(0.5); 25]);
    }
}
