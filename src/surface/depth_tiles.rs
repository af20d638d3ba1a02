//! Least and largest depths of the pixels of an image, by tiles: what a piece of space covers of it is judged
//! at once.

use rayon::prelude::*;

/// Pixels along a side of a tile.
const TILE: usize = 8;

/// Depths of an image by tiles, meters.
pub(super) struct DepthTiles {
    width: usize,
    height: usize,
    columns: usize,
    /// The least of the first depths of the pixels, and the largest of the second.
    tiles: Vec<[f32; 2]>,
}

impl DepthTiles {
    /// Of an image with two depths a pixel.
    pub(crate) fn of(width: usize, height: usize, depths_m: impl Fn(usize) -> [f32; 2] + Sync) -> Self {
        let columns = width.div_ceil(TILE);
        let tile = |t: usize| {
            let left = t % columns * TILE;
            let top = t / columns * TILE;
            let right = (left + TILE).min(width);
            let bottom = (top + TILE).min(height);
            let pixels = (top..bottom).flat_map(|y| y * width + left..y * width + right);
            pixels.map(&depths_m).fold([f32::INFINITY, 0.0], join)
        };
        let count = columns * height.div_ceil(TILE);
        let tiles = (0..count).into_par_iter().with_min_len(columns.max(1)).map(tile).collect();
        Self { width, height, columns, tiles }
    }

    /// Columns and rows of the image.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Number of tiles that pixels from the first to the last column, and row, lie in.
    pub(crate) fn count(pixels: [[usize; 2]; 2]) -> usize {
        pixels.map(|[first, last]| last / TILE - first / TILE + 1).iter().product()
    }

    /// Least first and largest second depth in the tiles of the pixels from the first to the last column, and
    /// row.
    pub(crate) fn over(&self, pixels: [[usize; 2]; 2]) -> [f32; 2] {
        let [[left, right], [top, bottom]] = pixels.map(|ends| ends.map(|p| p / TILE));
        let rows = (top..=bottom).flat_map(|row| &self.tiles[row * self.columns..][left..=right]);
        rows.copied().fold([f32::INFINITY, 0.0], join)
    }
}

fn join(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}
