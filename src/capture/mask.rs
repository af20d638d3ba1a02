//! Masks of pixels.

use serde::{Deserialize, Serialize};

/// What a pixel off the mask shows where it has no depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unread {
    /// No object on its ray, as a recorded mask says.
    #[default]
    Empty,
    /// Nothing: the mask was found by depth, and where none was read there may be anything.
    Unknown,
}

/// A mask dilated by `reach` pixels along rows and columns.
#[must_use]
pub fn dilated_mask(mask: &[bool], width: usize, height: usize, reach: usize) -> Vec<bool> {
    // A square is separable: along rows, then along columns.
    let rows = spread_along_lines(mask, width, height, 1, width, reach);
    spread_along_lines(&rows, height, width, width, 1, reach)
}

/// Dilates along `lines` lines of `length` pixels with step `step`; lines are `next` apart.
fn spread_along_lines(
    mask: &[bool],
    length: usize,
    lines: usize,
    step: usize,
    next: usize,
    reach: usize,
) -> Vec<bool> {
    let mut out = vec![false; mask.len()];
    for line in 0..lines {
        let mut filled = 0;
        for i in 0..length {
            if mask[line * next + i * step] {
                // Writes every pixel once, however large the reach.
                for k in filled.max(i.saturating_sub(reach))..(i + reach + 1).min(length) {
                    out[line * next + k * step] = true;
                }
                filled = (i + reach + 1).min(length);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_spreads_as_a_square() {
        let w = 13;
        let h = 9;
        let mut mask = vec![false; w * h];
        for p in [0, 5 * w + 6, 5 * w + 7, 8 * w + 12] {
            mask[p] = true;
        }
        let out = dilated_mask(&mask, w, h, 2);
        for y in 0..h {
            for x in 0..w {
                let near =
                    (0..w * h).any(|p| mask[p] && (p % w).abs_diff(x) <= 2 && (p / w).abs_diff(y) <= 2);
                assert_eq!(out[y * w + x], near, "{x} {y}");
            }
        }
    }
}
