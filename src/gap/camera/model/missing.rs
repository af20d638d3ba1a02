//! A region of geometry missing in the twin.

use std::collections::BTreeSet;

use geometry::Pose;
use nalgebra::Point3;

/// Cell of a grid in a part's frame.
pub type Voxel = [i32; 3];

/// A region of geometry missing in the twin.
#[derive(Clone, Debug)]
pub struct Missing {
    /// Part the region moves with.
    pub part: usize,
    /// Box in the part's frame, meters.
    pub bounds: [[f64; 3]; 2],
    /// Largest area seen in one frame, square meters.
    pub area_m2: f64,
    /// 95 % interval of the sides of the box.
    pub bounds_interval: [[(f64, f64); 3]; 2],
    /// 95 % interval of the area.
    pub area_interval: (f64, f64),
    /// Its voxels.
    pub voxels: BTreeSet<Voxel>,
    /// Side of a voxel, meters.
    pub voxel_m: f64,
}

impl Missing {
    /// Whether a world point belongs to the region, for given part poses.
    pub fn covers(&self, world_from_parts: &[Pose], point: &Point3<f64>) -> bool {
        let [x, y, z] = voxel_of(&world_from_parts[self.part].inverse_transform_point(point), self.voxel_m);
        // Neighboring voxels count too: noise moves readings of the region past its border.
        (-1..=1).any(|i| (-1..=1).any(|j| (-1..=1).any(|k| self.voxels.contains(&[x + i, y + j, z + k]))))
    }
}

/// Voxel of a point.
pub fn voxel_of(p: &Point3<f64>, side_m: f64) -> Voxel {
    [0, 1, 2].map(|k| (p[k] / side_m).floor() as i32)
}
