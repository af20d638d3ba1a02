//! Rows of grid nodes seen by a camera. Along x, a node's position in the camera is linear, so a row is
//! clipped to the image once and then traversed.

use std::ops::Range;

use nalgebra::{Point3, Vector3};

use geometry::{Intrinsics, Pose};

/// Nodes nearer to the camera plane are not seen, meters. chosen: no camera reads so near
const NEAR_M: f64 = 0.01;
/// Number of nodes of a row projected at once.
pub(super) const LANES: usize = 16;

/// A node-aligned grid in front of one camera.
pub(super) struct RowCamera {
    intrinsics: Intrinsics,
    /// Node (0, 0, 0) in the optical frame, meters.
    origin: Vector3<f64>,
    /// Steps along x, y, z in the optical frame, meters.
    steps: [Vector3<f64>; 3],
    focal: [f32; 2],
    center: [f32; 2],
}

/// The nodes of one row within the image.
pub(super) struct Row {
    /// Range of their x.
    pub range: Range<usize>,
    start: Vector3<f32>,
    step: Vector3<f32>,
}

impl Row {
    /// Position of node x in the optical frame, meters.
    #[inline(always)]
    pub(crate) fn at(&self, x: usize) -> Vector3<f32> {
        // Node numbers are small, and vector instructions convert 32 bits.
        self.start + self.step * (x as i32) as f32
    }
}

impl RowCamera {
    /// A camera in front of the grid with the given node (0, 0, 0) and spacing, both in the grid's frame.
    pub(crate) fn new(
        intrinsics: &Intrinsics,
        camera_from_grid: &Pose,
        origin: &Point3<f64>,
        spacing_m: f64,
    ) -> Self {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        Self {
            intrinsics: *intrinsics,
            origin: (camera_from_grid * origin).coords,
            steps: axes.map(|axis| camera_from_grid * (axis * spacing_m)),
            focal: [intrinsics.fx as f32, intrinsics.fy as f32],
            // With half a pixel added, truncation gives the pixel with the nearest center.
            center: [intrinsics.cx as f32 + 0.5, intrinsics.cy as f32 + 0.5],
        }
    }

    /// The part of row (y, z) of `nx` nodes inside the image and in front of the camera.
    pub(crate) fn row_in_image(&self, y: usize, z: usize, nx: usize) -> Row {
        let start = self.origin + self.steps[1] * y as f64 + self.steps[2] * z as f64;
        let k = &self.intrinsics;
        let left = k.cx + 0.5;
        let right = k.width as f64 - 0.5 - k.cx;
        let top = k.cy + 0.5;
        let bottom = k.height as f64 - 0.5 - k.cy;
        // Each value is at least zero inside the view: the sides of the image as half spaces through the
        // camera, and the near plane.
        let planes = [
            Vector3::new(k.fx, 0.0, left),
            Vector3::new(-k.fx, 0.0, right),
            Vector3::new(0.0, k.fy, top),
            Vector3::new(0.0, -k.fy, bottom),
            Vector3::z(),
        ];
        // Along the row each value is linear in x; the row is cut at its zero.
        let mut first = 0.0f64;
        let mut last = nx as f64 - 1.0;
        for (i, plane) in planes.iter().enumerate() {
            let value = plane.dot(&start) - if i == 4 { NEAR_M } else { 0.0 };
            let slope = plane.dot(&self.steps[0]);
            if slope > 0.0 {
                first = first.max(-value / slope);
            } else if slope < 0.0 {
                last = last.min(-value / slope);
            } else if value < 0.0 {
                last = -1.0;
            }
        }
        let range = if first <= last { first.ceil() as usize..last.floor() as usize + 1 } else { 0..0 };
        Row { range, start: start.cast(), step: self.steps[0].cast() }
    }

    /// Position of a node (x, y, z) in the optical frame, meters.
    pub(crate) fn node_in_camera(&self, [x, y, z]: [usize; 3]) -> Vector3<f32> {
        let start = self.origin + self.steps[1] * y as f64 + self.steps[2] * z as f64;
        start.cast() + self.steps[0].cast() * x as f32
    }

    /// Whether a depth is beyond the camera's near plane.
    pub(crate) fn is_before(&self, depth_m: f32) -> bool {
        f64::from(depth_m) > NEAR_M
    }

    /// Pixel coordinates of a point of a [`Row`], plus one half: their integer part is the pixel.
    #[inline(always)]
    pub(crate) fn project(&self, p: &Vector3<f32>) -> [f32; 2] {
        let inverse = 1.0 / p.z;
        [self.focal[0] * p.x * inverse + self.center[0], self.focal[1] * p.y * inverse + self.center[1]]
    }

    /// Pixel index and depth, meters, of each of the nodes of a [`Row`] from x on. Nodes outside the row's
    /// range get some pixel of the image.
    #[inline(always)]
    pub(crate) fn pixels_and_depths(&self, row: &Row, x: usize) -> ([u32; LANES], [f32; LANES]) {
        let width = self.intrinsics.width as u32;
        let last = [self.intrinsics.width, self.intrinsics.height].map(|n| n as f32 - 1.0);
        let mut pixels = [0; LANES];
        let mut depths_m = [0.0; LANES];
        for k in 0..LANES {
            let p = row.at(x + k);
            let [u, v] = self.project(&p);
            // `max` first: it turns NaN into 0.
            // SAFETY: both are whole numbers of the image then, they fit.
            let [column, line] = [u.max(0.0).min(last[0]), v.max(0.0).min(last[1])]
                .map(|at| unsafe { at.to_int_unchecked::<u32>() });
            (pixels[k], depths_m[k]) = (line * width + column, p.z);
        }
        (pixels, depths_m)
    }

    /// Index of the pixel of a point of a [`Row`].
    pub(crate) fn pixel_of(&self, p: &Vector3<f32>) -> usize {
        let [u, v] = self.project(p);
        // Rounding may put the ends of the row just outside the image.
        let x = (u as usize).min(self.intrinsics.width - 1);
        let y = (v as usize).min(self.intrinsics.height - 1);
        y * self.intrinsics.width + x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn rows_hold_exactly_the_nodes_that_project_into_the_image() {
        let k = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 58.0, cx: 30.3, cy: 25.1 };
        let origin = Point3::new(-0.5, -0.4, -0.3);
        for (angle, t) in [
            ([0.0, 0.0, 0.0], [0.0, 0.0, 0.9]),
            ([0.7, -0.3, 2.0], [0.1, 0.0, 0.5]),
            ([0.0, 1.5, 0.0], [0.0, 0.1, 0.1]),
        ] {
            let pose = Pose::from_parts(
                Vector3::from(t).into(),
                UnitQuaternion::from_scaled_axis(Vector3::from(angle)),
            );
            let camera = RowCamera::new(&k, &pose, &origin, 0.03);
            let mut seen = 0;
            for (y, z) in (0..30).flat_map(|y| (0..25).map(move |z| (y, z))) {
                let row = camera.row_in_image(y, z, 35);
                for x in 0..35 {
                    let p = pose * (origin + Vector3::new(x as f64, y as f64, z as f64) * 0.03);
                    let expected = if p.z > NEAR_M { k.pixel_of(&p) } else { None };
                    let got = row.range.contains(&x).then(|| camera.pixel_of(&row.at(x)));
                    // A node whose projection is within rounding of a pixel border may go either way.
                    let (u, v) = k.project(&p).unwrap_or_default();
                    let near_border = |c: f64| (c + 0.5 - (c + 0.5).round()).abs() < 1e-3;
                    assert!(
                        got == expected || near_border(u) || near_border(v),
                        "{x} {y} {z}: {got:?} {expected:?}"
                    );
                    seen += usize::from(got.is_some());
                }
            }
            assert!(seen > 500);
        }
    }
}
