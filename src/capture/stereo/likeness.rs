//! Photo-consistency: how similar other views look if a patch of one view lies on a plane.

use nalgebra::{Matrix3, Vector3};

use super::cells::Cells;
use crate::common_focus;
use geometry::Intrinsics;

/// Samples per side of a patch, and their step in cells: the patch is 9 cells wide.
/// chosen: 18 pixels, between the windows of denoising (15 and 25)
const SIDE: i32 = 5;
const STRIDE: i32 = 2;
const SAMPLES: usize = (SIDE * SIDE) as usize;
/// Half the width of a patch, cells: narrower holes come from shadows and edges.
pub(super) const REACH: i32 = STRIDE * (SIDE / 2);
const CORNERS: [(i32, i32); 4] = [(-REACH, -REACH), (REACH, -REACH), (-REACH, REACH), (REACH, REACH)];
/// Other views compared with a view, and how many of the most similar count.
/// derived: the best half (Galliani 2015), so that half of the views may be occluded
const VIEWS: usize = 6;
const BEST: usize = 3;
/// Least and largest angle between two compared views, radians: a small one hardly shows depth, a large one
/// changes the look of patches.
/// chosen: 4 and 34 deg
const ANGLES: [f64; 2] = [0.07, 0.6];
/// Preferred angle, radians. chosen: 14 deg
const BEST_ANGLE: f64 = 0.25;
/// Extra cost per view that sees through the point. chosen: a quarter of the cost of the most dissimilar
/// views
const SEEN_THROUGH: f32 = 0.5;
/// Cost of an unknown plane; the most dissimilar views cost 2. chosen: twice that
pub(super) const UNKNOWN: f32 = 4.0;
/// Largest depth difference of a point on its surface, in standard deviations, and at least this share of the
/// depth.
/// chosen: beyond chance, and the share for two agreeing views
const ON_SURFACE: (f32, f32) = (4.0, 0.01);

/// Another view relative to the reference view: a cell at `p` with inverse depth `w` projects to `turn p +
/// shift w`, homogeneous: docs/method.md (2.30).
pub(super) struct Eye<'a> {
    pub cells: &'a Cells,
    turn: Matrix3<f32>,
    shift: Vector3<f32>,
}

/// The views to compare with a reference view.
pub(super) fn compared_views(views: &[Cells], reference: usize) -> Vec<Eye<'_>> {
    let poses: Vec<_> = views.iter().map(|v| v.world_from_camera).collect();
    let Some(focus) = common_focus(&poses) else { return Vec::new() };
    let toward = |i: usize| (focus.coords - poses[i].translation.vector).normalize();
    let mut others: Vec<(f64, usize)> = Vec::new();
    for i in (0..views.len()).filter(|i| *i != reference) {
        let angle_rad = toward(i).angle(&toward(reference));
        if (ANGLES[0]..ANGLES[1]).contains(&angle_rad) {
            others.push(((angle_rad - BEST_ANGLE).abs(), i));
        }
    }
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others.truncate(VIEWS);
    others.into_iter().map(|(_, i)| Eye::of_view(&views[reference], &views[i])).collect()
}

impl<'a> Eye<'a> {
    fn of_view(reference: &Cells, cells: &'a Cells) -> Self {
        let motion = cells.world_from_camera.inverse() * reference.world_from_camera;
        // A camera matrix is always invertible.
        let back = camera_matrix(&reference.camera).try_inverse().unwrap_or_else(Matrix3::identity);
        let matrix = camera_matrix(&cells.camera);
        let turn = matrix * motion.rotation.to_rotation_matrix().matrix() * back;
        let shift = matrix * motion.translation.vector;
        Self { cells, turn: turn.cast(), shift: shift.cast() }
    }
}

/// The patch of a view around a cell.
pub(super) struct Patch<'a> {
    view: &'a Cells,
    cell: usize,
    /// Brightness minus the mean; 0 off the object.
    values: [f32; SAMPLES],
    /// 1 for samples on the object, else 0.
    weights: [f32; SAMPLES],
    count: f32,
    /// Sum of the squared values.
    square: f32,
}

/// Offsets of the samples in cells, row by row.
fn sample_offsets() -> [(i32, i32); SAMPLES] {
    std::array::from_fn(|k| {
        let x = k as i32 % SIDE;
        let y = k as i32 / SIDE;
        (STRIDE * x - REACH, STRIDE * y - REACH)
    })
}

impl<'a> Patch<'a> {
    /// The patch; `None` without enough object or with no more texture than noise.
    pub fn about_cell(view: &'a Cells, cell: usize) -> Option<Self> {
        let w = view.camera.width as i32;
        let h = view.camera.height as i32;
        let x = cell as i32 % w;
        let y = cell as i32 / w;
        let mut values = [0.0; SAMPLES];
        let mut weights = [0.0; SAMPLES];
        for (k, (dx, dy)) in sample_offsets().into_iter().enumerate() {
            let x = x + dx;
            let y = y + dy;
            if x >= 0 && y >= 0 && x < w && y < h && view.on_object[(y * w + x) as usize] {
                (values[k], weights[k]) = (view.luma[(y * w + x) as usize], 1.0);
            }
        }
        let count: f32 = weights.iter().sum();
        let mean = values.iter().sum::<f32>() / count.max(1.0);
        values.iter_mut().zip(&weights).for_each(|(v, w)| *v = w * (*v - mean));
        let square: f32 = values.iter().map(|v| v * v).sum();
        // At least half of the samples, and a spread beyond noise.
        let has_texture = square > 4.0 * count * view.luma_sigma.powi(2);
        (2.0 * count > SAMPLES as f32 && has_texture).then_some(Self {
            view,
            cell,
            values,
            weights,
            count,
            square,
        })
    }

    /// Cost of a plane `n . x = 1` in the camera's frame: 1 minus the normalized cross-correlation, averaged
    /// over the most similar views, plus a cost for each view that sees through the point.
    pub fn plane_cost(&self, n: &Vector3<f32>, eyes: &[Eye<'_>]) -> f32 {
        let inverse = n.dot(&self.view.ray_of_cell(self.cell));
        if inverse <= 0.0 {
            return UNKNOWN;
        }
        let mut costs = [UNKNOWN; VIEWS];
        let mut used = 0;
        let mut through = 0;
        for eye in eyes {
            match self.look_by_view(n, inverse, eye) {
                Look::Unlike(cost) => {
                    costs[used] = cost;
                    used += 1;
                }
                Look::Through => through += 1,
                Look::Blocked => {}
            }
        }
        if used < 2 {
            return UNKNOWN;
        }
        costs[..used].sort_by(f32::total_cmp);
        let best = used.min(BEST);
        costs[..best].iter().sum::<f32>() / best as f32 + SEEN_THROUGH * through as f32
    }

    fn look_by_view(&self, n: &Vector3<f32>, inverse: f32, eye: &Eye<'_>) -> Look {
        let camera = &self.view.camera;
        let x = (self.cell % camera.width) as f32;
        let y = (self.cell / camera.width) as f32;
        let middle = eye.turn * Vector3::new(x, y, 1.0) + eye.shift * inverse;
        if let Some(look) = eye.verdict_on_place(&middle, inverse) {
            return look;
        }
        let across = eye.turn.column(0) + eye.shift * (n.x / camera.fx as f32);
        let down = eye.turn.column(1) + eye.shift * (n.y / camera.fy as f32);
        let at = |(dx, dy): (i32, i32)| middle + across * dx as f32 + down * dy as f32;
        // A plane maps the patch to a convex quadrangle: if its corners are inside, all of it is.
        if CORNERS.iter().any(|&corner| !eye.is_inside(&at(corner))) {
            return Look::Blocked;
        }
        let places = sample_offsets().map(|offset| {
            let q = at(offset);
            [q.x / q.z, q.y / q.z]
        });
        let mut sum = 0.0;
        let mut square = 0.0;
        let mut product = 0.0;
        for (k, &place) in places.iter().enumerate() {
            let value = self.weights[k] * eye.luma_at(place);
            sum += value;
            square += value * value;
            product += value * self.values[k];
        }
        // The values have zero mean, so the other view's mean cancels in the product.
        let square = square - sum * sum / self.count;
        let floor = self.count * eye.cells.luma_sigma.powi(2);
        Look::Unlike(1.0 - product / (self.square * square.max(floor)).sqrt())
    }
}

enum Look {
    /// Compared: 1 minus the correlation.
    Unlike(f32),
    /// The view sees a surface behind the point.
    Through,
    /// The point is occluded or outside the image.
    Blocked,
}

impl Eye<'_> {
    /// Verdict of the view by its depth and mask; `None` if neither prevents a comparison.
    fn verdict_on_place(&self, q: &Vector3<f32>, inverse: f32) -> Option<Look> {
        let Some(cell) = self.cell_at(q) else { return Some(Look::Blocked) };
        if self.cells.off_object[cell] {
            return Some(Look::Through);
        }
        match self.cells.side_of_depth(cell, q.z / inverse) {
            Side::Before => Some(Look::Through),
            Side::Behind => Some(Look::Blocked),
            Side::On | Side::Unknown => None,
        }
    }

    fn cell_at(&self, q: &Vector3<f32>) -> Option<usize> {
        let w = self.cells.camera.width;
        let h = self.cells.camera.height;
        if q.z <= 0.0 {
            return None;
        }
        let x = q.x / q.z + 0.5;
        let y = q.y / q.z + 0.5;
        (x >= 0.0 && y >= 0.0 && x < w as f32 && y < h as f32).then(|| y as usize * w + x as usize)
    }

    /// Whether a homogeneous point projects into the image, with a cell to its right and one below.
    fn is_inside(&self, q: &Vector3<f32>) -> bool {
        let w = self.cells.camera.width;
        let h = self.cells.camera.height;
        q.z > 0.0 && q.x >= 0.0 && q.y >= 0.0 && q.x < (w - 1) as f32 * q.z && q.y < (h - 1) as f32 * q.z
    }

    /// Brightness at a position, bilinear.
    fn luma_at(&self, [x, y]: [f32; 2]) -> f32 {
        let w = self.cells.camera.width;
        let i = x as usize;
        let j = y as usize;
        let fx = x - i as f32;
        let fy = y - j as f32;
        // Rounding may move a point inside onto the last row or column.
        let Some(cells) = self.cells.luma.get(j * w + i..j * w + i + w + 2) else { return 0.0 };
        let top = cells[0] + fx * (cells[1] - cells[0]);
        let bottom = cells[w] + fx * (cells[w + 1] - cells[w]);
        top + fy * (bottom - top)
    }
}

fn camera_matrix(k: &Intrinsics) -> Matrix3<f64> {
    Matrix3::new(k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0)
}

/// Position of a point relative to the depth measured there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Before,
    On,
    Behind,
    Unknown,
}

impl Cells {
    /// Compares a z-depth with the depth measured at a cell.
    pub fn side_of_depth(&self, cell: usize, depth_m: f32) -> Side {
        let read_m = self.depth_m[cell];
        if read_m <= 0.0 {
            return Side::Unknown;
        }
        let within_m = (ON_SURFACE.0 * self.sigma_m[cell]).max(ON_SURFACE.1 * read_m);
        match depth_m - read_m {
            d if d < -within_m => Side::Before,
            d if d > within_m => Side::Behind,
            _ => Side::On,
        }
    }
}
