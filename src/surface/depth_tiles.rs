//! Least and largest depths in tiles of an image, to judge a piece of space at once.

use rayon::prelude::*;

/// Pixels along a side of a tile.
const TILE: usize = 8;

/// Least and largest depths of an image by tiles, meters.
pub(super) struct DepthTiles {
    width: usize,
    height: usize,
    columns: usize,
    /// The least first and the largest second depth of the pixels of each tile.
    tiles: Vec<[f32; 2]>,
}

impl DepthTiles {
    /// Tiles of an image with two depths a pixel.
    pub(crate) fn of_image(width: usize, height: usize, depths_m: impl Fn(usize) -> [f32; 2] + Sync) -> Self {
        let columns = width.div_ceil(TILE);
        let count = columns * height.div_ceil(TILE);
        let tiles = (0..count).into_par_iter().with_min_len(columns.max(1)).map(|t| {
            let pixels = pixels_of_tile(width, height, t % columns, t / columns);
            pixels.map(&depths_m).fold([f32::INFINITY, 0.0], joined_ranges)
        });
        Self { width, height, columns, tiles: tiles.collect() }
    }

    /// Columns and rows of the image.
    pub(crate) fn image_size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Number of tiles that cover a range of pixels, given as its first and last column and row.
    pub(crate) fn tile_count(pixels: [[usize; 2]; 2]) -> usize {
        pixels.map(|[first, last]| last / TILE - first / TILE + 1).iter().product()
    }

    /// Least first and largest second depth in the tiles that cover a range of pixels, given as its first and
    /// last column and row.
    pub(crate) fn depths_over(&self, pixels: [[usize; 2]; 2]) -> [f32; 2] {
        let [[left, right], [top, bottom]] = pixels.map(|ends| ends.map(|p| p / TILE));
        let rows = (top..=bottom).flat_map(|row| &self.tiles[row * self.columns..][left..=right]);
        rows.copied().fold([f32::INFINITY, 0.0], joined_ranges)
    }
}

/// Indices of the pixels of a tile.
fn pixels_of_tile(width: usize, height: usize, column: usize, row: usize) -> impl Iterator<Item = usize> {
    let left = column * TILE;
    let top = row * TILE;
    let right = (left + TILE).min(width);
    let bottom = (top + TILE).min(height);
    (top..bottom).flat_map(move |y| y * width + left..y * width + right)
}

fn joined_ranges(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}
