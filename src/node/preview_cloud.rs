//! A small colored point cloud of the collection, for display.

use std::collections::BTreeMap;

use capture::RgbdFrame;

/// Stride of the sampled pixels.
const EVERY: usize = 6;
/// Initial cell size, meters; it doubles whenever there are too many points. chosen: fine enough for display
const FIRST_CELL_M: f64 = 0.004;
/// Largest depth considered, meters. chosen: the range of usual depth cameras
const MAX_DEPTH_M: f32 = 4.0;

/// A cloud with one point per cell.
#[derive(Clone, Debug)]
pub(crate) struct PreviewCloud {
    most: usize,
    cell_m: f64,
    cells: BTreeMap<[i32; 3], ([f32; 3], [u8; 3])>,
}

impl PreviewCloud {
    /// An empty cloud of at most `most` points.
    #[must_use]
    pub(crate) fn new(most: usize) -> Self {
        Self { most, cell_m: FIRST_CELL_M, cells: BTreeMap::new() }
    }

    /// Adds a view; with a mask, only the object.
    pub(crate) fn add_view(&mut self, frame: &RgbdFrame) {
        if self.most == 0 {
            return;
        }
        let camera = &frame.intrinsics;
        for v in (0..camera.height).step_by(EVERY) {
            for u in (0..camera.width).step_by(EVERY) {
                let i = v * camera.width + u;
                let z = frame.depth_m[i];
                let hidden = frame.mask.as_ref().is_some_and(|m| !m[i]);
                if !(z > 0.0 && z < MAX_DEPTH_M) || hidden {
                    continue;
                }
                let z = f64::from(z);
                let ray = [(u as f64 - camera.cx) / camera.fx, (v as f64 - camera.cy) / camera.fy];
                let point = frame.world_from_camera * nalgebra::Point3::new(ray[0] * z, ray[1] * z, z);
                // Single precision, as in PointCloud2.
                let point = [point.x as f32, point.y as f32, point.z as f32];
                self.cells.entry(self.cell_of_point(&point)).or_insert((point, frame.rgb[i]));
            }
            // After each row, so that the map hardly exceeds its limit.
            self.double_cells();
        }
    }

    fn cell_of_point(&self, point: &[f32; 3]) -> [i32; 3] {
        point.map(|v| (f64::from(v) / self.cell_m).floor() as i32)
    }

    /// Doubles the cell size until there are few enough points.
    fn double_cells(&mut self) {
        while self.cells.len() > self.most && self.cell_m < 1e3 {
            self.cell_m *= 2.0;
            let points: Vec<_> = std::mem::take(&mut self.cells).into_values().collect();
            for (point, color) in points {
                self.cells.entry(self.cell_of_point(&point)).or_insert((point, color));
            }
        }
    }

    /// Points in the world frame, meters, with colors.
    #[must_use]
    pub(crate) fn colored_points(&self) -> Vec<([f32; 3], [u8; 3])> {
        self.cells.values().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    #[test]
    fn the_cloud_lies_on_the_surface_and_stays_small() {
        let intrinsics = Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
        let size = 320 * 240;
        let frame = RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::translation(0.0, 0.0, 2.0),
            rgb: vec![[9, 8, 7]; size],
            depth_m: vec![1.0; size],
            mask: Some((0..size).map(|i| i % 320 < 160).collect()),
            readings: Vec::new(),
        };
        let mut cloud = PreviewCloud::new(100);
        cloud.add_view(&frame);
        let points = cloud.colored_points();
        assert!((20..=100).contains(&points.len()), "{}", points.len());
        assert!(points.iter().all(|(p, c)| (p[2] - 3.0).abs() < 1e-6 && p[0] < 0.0 && *c == [9, 8, 7]));
    }
}
