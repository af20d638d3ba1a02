//! Mends the borders of an open mesh: takes shreds off, closes small holes, moves rims to where the readings
//! end and straightens them. See docs/method.md 9.1.

mod bays;
mod drawn;
mod face;
mod fill;
mod holes;
mod loops;
#[cfg(test)]
mod plates;
mod polygon;
mod reach;
mod rim;
mod sheet;
mod straight;
mod teeth;
#[cfg(test)]
mod tests;

use self::{
    holes::close_holes,
    loops::border_loops,
    sheet::Sheet,
    straight::straightened_mesh,
    teeth::{drop_hanging, drop_shreds, drop_teeth},
};
use super::TriangleMesh;

pub use self::drawn::{DepthView, Readings};

/// A mesh with mended borders.
#[derive(Clone, Debug, PartialEq)]
pub struct Mended {
    /// The mesh, without colors where anything changed.
    pub mesh: TriangleMesh,
    /// Number of closed holes.
    pub holes: usize,
    /// Area of the closed holes, which no reading supports, square meters.
    pub assumed_m2: f64,
}

/// Rounds of closing and taking off: tuned. The first removes shreds; the second can then close the holes
/// between them.
const ROUNDS: usize = 2;

/// The mesh with mended borders: loose triangles and strips are removed and rims become straight or smooth
/// where the `readings` end. With `close`, small holes in flat faces are closed unless views saw through
/// them. `voxel_m` is the spacing of the mesh's grid, meters. A mesh without a border, or without a clear
/// one, is returned as it is.
pub fn mend_borders(mesh: &TriangleMesh, voxel_m: f64, close: bool, readings: &Readings<'_>) -> Mended {
    if border_loops(mesh).is_none_or(|loops| loops.is_empty()) {
        return Mended { mesh: mesh.clone(), holes: 0, assumed_m2: 0.0 };
    }
    let colorless = TriangleMesh { colors: Vec::new(), ..mesh.clone() };
    let mut sheet = Sheet::of_mesh(&colorless);
    let mut holes = 0;
    for _ in 0..ROUNDS {
        drop_hanging(&mut sheet);
        if close {
            holes += close_holes(&mut sheet, voxel_m, readings.is_seen_empty);
        }
        drop_teeth(&mut sheet, voxel_m);
    }
    drop_hanging(&mut sheet);
    drop_shreds(&mut sheet, voxel_m);
    sheet.mesh = straightened_mesh(&sheet.mesh, voxel_m, readings);
    Mended { mesh: sheet.used_mesh(), holes, assumed_m2: sheet.assumed_m2() }
}
