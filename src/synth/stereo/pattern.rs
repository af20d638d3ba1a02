//! The dot pattern of a projector, as a table over the directions of its rays.

use nalgebra::Vector3;
use numeric::random::{self, stage_rng};

/// Side of the table, entries; a power of two. The pattern repeats after it, as tiles of diffractive elements
/// do, farther than any disparity.
const SIDE: usize = 1024;
/// Entries a pixel. chosen: dots are four entries wide at least
const ENTRIES_PER_PIXEL: f64 = 3.0;
/// Cells along a side, each with one dot: 5.5 pixels. chosen: one dot in 30 pixels, as a D435's pattern looks
const CELLS: usize = 62;
/// Standard deviation of a dot, pixels. chosen: dots of two to three pixels
const DOT_PX: f64 = 0.9;
/// Brightness of the weakest dot, share of the brightest. chosen: dots differ clearly
const WEAKEST: f64 = 0.4;

/// Light of a projector by direction, in `[0, 1]`.
#[derive(Clone, Debug)]
pub(super) struct DotPattern {
    values: Vec<u8>,
    /// Entries a unit of slope.
    scale: f64,
}

impl DotPattern {
    /// Pseudo-random dots, one at a random place in each cell of a grid; `focal_px` is that of the imagers.
    pub(super) fn drawn(focal_px: f64, seed: u64) -> Self {
        let rng = &mut stage_rng(seed, "synth/stereo/pattern", 0);
        let mut light = vec![0.0; SIDE * SIDE];
        let cell = SIDE as f64 / CELLS as f64;
        for k in 0..CELLS * CELLS {
            let x = cell * ((k % CELLS) as f64 + random::unit_uniform(rng));
            let y = cell * ((k / CELLS) as f64 + random::unit_uniform(rng));
            add_dot(&mut light, [x, y], random::uniform_in(rng, WEAKEST, 1.0));
        }
        let values = light.iter().map(|v: &f64| (255.0 * v.min(1.0)).round() as u8).collect();
        Self { values, scale: ENTRIES_PER_PIXEL * focal_px }
    }

    /// Light along a direction in the projector's frame, interpolated; none backwards.
    pub(super) fn light_along(&self, direction: &Vector3<f64>) -> f64 {
        if !(direction.z > 0.0) {
            return 0.0;
        }
        let x = self.scale * direction.x / direction.z;
        let y = self.scale * direction.y / direction.z;
        let column = x.floor();
        let row = y.floor();
        let right = x - column;
        let below = y - row;
        let above = self.light_at(column, row) * (1.0 - right) + self.light_at(column + 1.0, row) * right;
        let under =
            self.light_at(column, row + 1.0) * (1.0 - right) + self.light_at(column + 1.0, row + 1.0) * right;
        above * (1.0 - below) + under * below
    }

    fn light_at(&self, column: f64, row: f64) -> f64 {
        f64::from(self.values[index_of_entry(column as i64, row as i64)]) / 255.0
    }
}

/// Index of an entry; the table repeats.
fn index_of_entry(x: i64, y: i64) -> usize {
    let wrapped = |at: i64| at as usize & (SIDE - 1);
    wrapped(y) * SIDE + wrapped(x)
}

fn add_dot(light: &mut [f64], [x, y]: [f64; 2], brightness: f64) {
    let sigma = DOT_PX * ENTRIES_PER_PIXEL;
    let reach = (3.0 * sigma).ceil() as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let column = x as i64 + dx;
            let row = y as i64 + dy;
            let squared = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
            light[index_of_entry(column, row)] += brightness * (-0.5 * squared / (sigma * sigma)).exp();
        }
    }
}
