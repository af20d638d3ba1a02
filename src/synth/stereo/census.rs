//! Census transform (Zabih and Woodfill 1994): which pixels of a window are darker than its center.

use rayon::prelude::*;

/// Half the width and height of the window: 9 x 7 pixels, 62 comparisons.
const HALF_WIDTH: usize = 4;
const HALF_HEIGHT: usize = 3;
/// Number of comparisons, the largest Hamming distance of two windows.
pub(super) const COMPARISONS: u8 = 62;

/// The census of every pixel of an image, row-major, one bit a comparison; the image's border is repeated
/// outwards.
pub(super) fn census_image(gray: &[u8], width: usize) -> Vec<u64> {
    let height = gray.len() / width;
    let mut census = vec![0; gray.len()];
    census.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let rows: [Vec<u8>; 2 * HALF_HEIGHT + 1] = std::array::from_fn(|k| {
            let row = (y + k).saturating_sub(HALF_HEIGHT).min(height - 1);
            padded_row(&gray[row * width..][..width])
        });
        for row in 0..=2 * HALF_HEIGHT {
            for column in 0..=2 * HALF_WIDTH {
                if row != HALF_HEIGHT || column != HALF_WIDTH {
                    add_comparison(&rows[row][column..], &rows[HALF_HEIGHT][HALF_WIDTH..], out);
                }
            }
        }
    });
    census
}

/// Shifts in a bit: whether a pixel is darker than its center.
fn add_comparison(beside: &[u8], center: &[u8], out: &mut [u64]) {
    for ((bits, a), b) in out.iter_mut().zip(beside).zip(center) {
        *bits = *bits << 1 | u64::from(a < b);
    }
}

fn padded_row(row: &[u8]) -> Vec<u8> {
    let first = std::iter::repeat_n(row[0], HALF_WIDTH);
    let last = std::iter::repeat_n(row[row.len() - 1], HALF_WIDTH);
    first.chain(row.iter().copied()).chain(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_and_contrast_do_not_matter_and_every_neighbor_counts() {
        let gray: Vec<u8> = (0..20 * 15).map(|i: u32| (i * i % 97) as u8).collect();
        let brighter: Vec<u8> = gray.iter().map(|g| 2 * g + 11).collect();
        let census = census_image(&gray, 20);
        assert_eq!(census, census_image(&brighter, 20));
        let center = 7 * 20 + 10;
        for dy in 0..7 {
            for dx in 0..9 {
                let mut other = vec![100; 300];
                other[(4 + dy) * 20 + 6 + dx] = 0;
                let bits = census_image(&other, 20)[center].count_ones();
                // A darker center is darker than none.
                assert_eq!(bits, u32::from((dy, dx) != (3, 4)), "{dy} {dx}");
            }
        }
    }
}
