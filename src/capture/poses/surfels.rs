//! Surfels: small flat patches of surface in a frame; depth averaged over a patch has least noise.

use nalgebra::{IsometryMatrix3, Point3, Vector3};
use rayon::prelude::*;

use super::{
    depth_warp::Bend,
    pose_noise::PoseNoise,
    sensor_errors::SensorErrors,
    window_planes::{WindowPlanes, plane_about_pixel},
};
use crate::{
    GRAZING_COSINE, NoiseConfig, RgbdFrame,
    window::{R, READINGS, WindowPlane},
};
use geometry::{Intrinsics, Pose};

/// Least distance of neighboring surfels, pixels, and most surfels in a row.
const LEAST_STEP: usize = 4;
const COLUMNS: usize = 160;
/// Independent readings in a window: stereo noise is correlated over about two pixels.
/// chosen: two by two pixels count as one
const INDEPENDENT: f64 = READINGS as f64 / 4.0;
/// Standard deviation of a feature's position, pixels.
/// tuned: shared/bags, as in the lift of matches (docs/method.md 4.4)
const PLACE_PX: f64 = 0.6;
/// Least cosine between the normals of one surface.
/// chosen: 37 deg, more than the error of any normal
const SAME_COSINE: f64 = 0.8;

/// Number of facings of a surfel: to the camera, left, right, up, down.
pub(crate) const FACINGS: usize = 5;
/// Least component of a normal along the image for a surfel to face sideways. chosen: 24 deg
const ASIDE: f32 = 0.4;

/// A flat patch of surface in the camera's optical frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfel {
    /// Inverse depth at its center, 1/meter, and slopes along the image, 1/(meter pixel), as read.
    plane: Vector3<f32>,
    /// Its center, meters.
    pub point: Point3<f32>,
    /// Unit normal, pointing away from the camera.
    pub normal: Vector3<f32>,
    /// Standard deviation along the normal, meters.
    pub sigma_m: f32,
}

/// The surfels of a frame on a grid of pixels.
#[derive(Clone)]
pub(crate) struct Surfels {
    intrinsics: Intrinsics,
    step: usize,
    columns: usize,
    rows: usize,
    cells: Vec<Option<Surfel>>,
    /// Cells with a surfel, by facing.
    facing: [Vec<u32>; FACINGS],
    /// Image features with depth; see [`Self::set_landmarks`].
    landmarks: Vec<Landmark>,
}

/// An image feature with its depth.
#[derive(Clone, Copy, Debug)]
struct Landmark {
    /// Position in the color image.
    pixel: [f64; 2],
    /// Inverse depth there, 1/meter, and slopes along the image, 1/(meter pixel), as read.
    read: Vector3<f64>,
    /// Standard deviation of its depth, meters.
    sigma_m: f64,
    /// Position in the camera's optical frame, meters.
    point: Point3<f64>,
    /// Derivative of the point by a shift of color along either image axis, meters.
    by_shift: [Vector3<f64>; 2],
}

/// Counts of one frame's surfels seen by another frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Overlap {
    /// Number of tried surfels.
    pub tried: usize,
    /// Number of surfels at which the other frame sees the same surface.
    pub agreeing: usize,
    /// Number of surfels that the other frame sees through: its surface lies behind them.
    pub seen_through: usize,
}

impl Overlap {
    /// The sum of two counts.
    pub fn added_to(self, other: Self) -> Self {
        Self {
            tried: self.tried + other.tried,
            agreeing: self.agreeing + other.agreeing,
            seen_through: self.seen_through + other.seen_through,
        }
    }

    /// Agreeing share of the surfels that the other frame can judge.
    pub fn agreement(&self) -> f64 {
        self.agreeing as f64 / (self.agreeing + self.seen_through).max(1) as f64
    }

    /// Agreeing share of all surfels tried.
    pub fn share(&self) -> f64 {
        self.agreeing as f64 / self.tried.max(1) as f64
    }
}

/// Distance of a surfel from another frame's surface.
pub(crate) struct Residual {
    /// Distance from the other surfel's plane, meters.
    pub distance_m: f64,
    /// Standard deviation of the distance by pose errors, meters.
    pub displacement_m: f64,
    /// Standard deviation of the distance by the noise of both, meters.
    pub sigma_m: f64,
    /// The other surfel's normal, and this one's point, in this camera's frame.
    pub normal: Vector3<f64>,
    pub point: Point3<f64>,
    /// The same in the other camera's frame.
    pub other_normal: Vector3<f64>,
    pub other_point: Point3<f64>,
    /// Its pixel in either frame.
    pub pixels: [[f64; 2]; 2],
    /// Derivatives of the distance by the shift of color; zero for surfels.
    pub by_color_shift: [f64; 2],
}

impl Surfel {
    /// Its facing.
    fn facing(&self) -> usize {
        let x = self.normal.x;
        let y = self.normal.y;
        match (x.abs() > y.abs(), x.abs().max(y.abs()) > ASIDE) {
            (_, false) => 0,
            (true, true) => 1 + usize::from(x > 0.0),
            (false, true) => 3 + usize::from(y > 0.0),
        }
    }
}

impl Surfels {
    /// The surfels of a frame at the wanted pixels.
    pub fn of_frame(frame: &RgbdFrame, noise: &NoiseConfig, wanted: impl Fn(usize) -> bool) -> Self {
        let k = frame.intrinsics;
        let step = (k.width / COLUMNS).max(LEAST_STEP);
        let count = |side: usize| side.saturating_sub(2 * R).div_ceil(step);
        let columns = count(k.width);
        let rows = count(k.height);
        let place = |i: usize| [R + i % columns * step, R + i / columns * step];
        let mut all = Vec::with_capacity(columns * rows);
        for [x, y] in (0..columns * rows).map(place) {
            let is_wanted = wanted(y * k.width + x);
            all.push(if is_wanted { plane_about_pixel(frame, noise, x, y) } else { None });
        }
        let planes = WindowPlanes { columns, rows, step, all };
        let cells: Vec<Option<Surfel>> = (0..columns * rows)
            .map(|i| surfel_of_plane(&k, noise, place(i), &planes.all[i]?, planes.smoothed_slopes(i)?))
            .collect();
        let mut facing: [Vec<u32>; FACINGS] = Default::default();
        for (i, surfel) in cells.iter().enumerate() {
            if let Some(s) = surfel {
                facing[s.facing()].push(i as u32);
            }
        }
        Self { intrinsics: k, step, columns, rows, cells, facing, landmarks: Vec::new() }
    }

    /// Stores the features at these pixels as landmarks; returns the index of each one, `None` without depth.
    pub fn set_landmarks(
        &mut self,
        frame: &RgbdFrame,
        noise: &NoiseConfig,
        pixels: impl Iterator<Item = [f64; 2]>,
    ) -> Vec<Option<u32>> {
        let numbers = pixels.map(|pixel| {
            self.landmarks.push(Landmark::at_pixel(frame, noise, pixel)?);
            Some(self.landmarks.len() as u32 - 1)
        });
        numbers.collect()
    }

    /// Residuals of a landmark and its match in `other`: distances from the match's ray along two directions
    /// across it. Distances beyond three standard deviations are rejected. See docs/method.md (2.14).
    pub fn landmark_residuals(
        &self,
        [this, that]: [u32; 2],
        other: &Self,
        other_from_this: &Pose,
        poses: &PoseNoise,
    ) -> [Option<Residual>; 2] {
        let this = &self.landmarks[this as usize];
        let that = &other.landmarks[that as usize];
        let other_point = other_from_this * this.point;
        let ray = that.point.coords.normalize();
        let right = Vector3::y().cross(&ray).normalize();
        let own_ray = other_from_this.rotation * this.point.coords / this.point.z;
        let displacement_m = poses.displacement_m(other_point.z);
        [right, ray.cross(&right)].map(|across| {
            let distance_m = across.dot(&(other_point - that.point));
            let ends = this.place_m(&self.intrinsics).hypot(that.place_m(&other.intrinsics));
            // Depth errors along the point's own ray move it sideways in the other frame.
            let sigma_m = ends.hypot(this.sigma_m * across.dot(&own_ray));
            (distance_m.abs() <= 3.0 * sigma_m.hypot(displacement_m)).then(|| Residual {
                distance_m,
                displacement_m,
                sigma_m,
                normal: other_from_this.inverse_transform_vector(&across),
                point: this.point,
                other_normal: across,
                other_point,
                pixels: [this.pixel, that.pixel],
                // docs/method.md (2.22); `by_shift` has the sign.
                by_color_shift: [0, 1]
                    .map(|k| across.dot(&(other_from_this.rotation * this.by_shift[k] - that.by_shift[k]))),
            })
        })
    }

    /// Position of a landmark in the camera's frame, meters, with standard deviations of its depth and across
    /// the ray, meters.
    pub fn landmark_point(&self, number: u32) -> (Point3<f64>, [f64; 2]) {
        let landmark = &self.landmarks[number as usize];
        (landmark.point, [landmark.sigma_m, landmark.place_m(&self.intrinsics)])
    }

    /// Counts how `other` sees every so many of these surfels.
    pub fn overlap_with(
        &self,
        other: &Self,
        other_from_this: &Pose,
        poses: &PoseNoise,
        every: usize,
    ) -> Overlap {
        let mut overlap = Overlap::default();
        for &cell in self.facing.iter().flat_map(|cells| cells.iter().step_by(every)) {
            let Some(this) = self.cells[cell as usize] else { continue };
            overlap.tried += 1;
            let point = other_from_this * this.point.cast::<f64>();
            let Some(there) = other.intrinsics.project(&point).and_then(|at| other.surfel_at(at)) else {
                continue;
            };
            let normal: Vector3<f64> = there.normal.cast();
            let distance_m = normal.dot(&(point - there.point.cast::<f64>()));
            let sigma_m = f64::from(this.sigma_m).hypot(f64::from(there.sigma_m));
            let gate_m = 3.0 * sigma_m.hypot(poses.displacement_m(point.z));
            let turned = other_from_this.rotation * this.normal.cast::<f64>();
            if distance_m.abs() <= gate_m {
                overlap.agreeing += usize::from(turned.dot(&normal) >= SAME_COSINE);
            // A surface that faces away occludes itself.
            } else if distance_m < 0.0 && turned.dot(&point.coords) > 0.0 {
                overlap.seen_through += 1;
            }
        }
        overlap
    }

    /// The surfels of several frames with corrected depth.
    pub fn all_corrected(all: &[Self], errors: &SensorErrors) -> Vec<Self> {
        // All frames share one camera, and so one table.
        let Some(first) = all.first() else { return Vec::new() };
        let bends: Vec<Bend> =
            (0..first.cells.len()).map(|i| Bend::of_warp_at(&errors.warp, first.pixel_of_cell(i))).collect();
        let corrected = all.par_iter().map(|surfels| {
            if surfels.intrinsics == first.intrinsics {
                return surfels.corrected_by(errors, |i| bends[i]);
            }
            surfels.corrected_by(errors, |i| Bend::of_warp_at(&errors.warp, surfels.pixel_of_cell(i)))
        });
        corrected.collect()
    }

    /// The surfels with depth corrected by the error at each cell.
    fn corrected_by(&self, errors: &SensorErrors, bend: impl Fn(usize) -> Bend) -> Self {
        let mut corrected = self.clone();
        for (i, cell) in corrected.cells.iter_mut().enumerate() {
            let Some(surfel) = cell else { continue };
            let pixel = self.pixel_of_cell(i);
            let plane = bend(i).corrected_plane(surfel.plane.cast());
            let ray = self.intrinsics.ray_at(pixel[0], pixel[1]);
            // Deviations and facings remain: corrections are a few percent.
            surfel.point = Point3::from(ray / plane.x).cast();
            surfel.normal =
                normal_of_plane(&self.intrinsics, &ray, &plane).map_or(surfel.normal, |n| n.cast());
        }
        corrected.landmarks.iter_mut().for_each(|l| l.correct(&self.intrinsics, errors));
        corrected
    }

    /// Camera intrinsics of the frame.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Pixel at the center of a cell.
    fn pixel_of_cell(&self, cell: usize) -> [f64; 2] {
        [R + cell % self.columns * self.step, R + cell / self.columns * self.step].map(|i| i as f64)
    }

    /// Indices of the cells with a surfel, increasing within each facing.
    pub fn cells_by_facing(&self) -> &[Vec<u32>; FACINGS] {
        &self.facing
    }

    /// Sum of the surfels' centers, and their number.
    pub fn sum_of_points(&self) -> (Vector3<f64>, f64) {
        let sum =
            self.cells.iter().flatten().fold(Vector3::zeros(), |sum, s| sum + s.point.coords.cast::<f64>());
        (sum, self.facing.iter().map(Vec::len).sum::<usize>() as f64)
    }

    /// Every so many of the surfels: center, and unit normal pointing away from the camera.
    pub fn points(&self, every: usize) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        self.cells.iter().flatten().step_by(every).map(|s| (s.point.cast(), s.normal.cast()))
    }

    /// Column and row of a cell's block of `side` x `side` cells.
    pub fn block_of_cell(&self, cell: u32, side: usize) -> [usize; 2] {
        let cell = cell as usize;
        [cell % self.columns / side, cell / self.columns / side]
    }

    /// Distance of a surfel from the surface in `other`; `None` without one, or if it is another surface.
    /// Distances beyond three standard deviations of depth noise and `poses` are rejected.
    pub fn surfel_residual(
        &self,
        cell: u32,
        other: &Self,
        other_from_this: &IsometryMatrix3<f64>,
        poses: &PoseNoise,
    ) -> Option<Residual> {
        let this = self.cells[cell as usize]?;
        let point: Point3<f64> = this.point.cast();
        let other_point = other_from_this * point;
        let seen_at = other.intrinsics.project(&other_point)?;
        let there = other.surfel_at(seen_at)?;
        let other_normal: Vector3<f64> = there.normal.cast();
        let distance_m = other_normal.dot(&(other_point - there.point.cast::<f64>()));
        let variance_m2 = f64::from(this.sigma_m).powi(2) + f64::from(there.sigma_m).powi(2);
        let displacement_m = poses.displacement_m(other_point.z);
        // Larger than noise and pose errors explain: another surface.
        if distance_m.powi(2) > 9.0 * (variance_m2 + displacement_m.powi(2)) {
            return None;
        }
        let normal = other_from_this.inverse_transform_vector(&other_normal);
        if normal.dot(&this.normal.cast()) < SAME_COSINE {
            return None;
        }
        let pixels = [self.pixel_of_cell(cell as usize), seen_at.into()];
        Some(Residual {
            distance_m,
            displacement_m,
            sigma_m: variance_m2.sqrt(),
            normal,
            point,
            other_normal,
            other_point,
            pixels,
            by_color_shift: [0.0; 2],
        })
    }

    /// The surfel nearest to a pixel.
    fn surfel_at(&self, (u, v): (f64, f64)) -> Option<&Surfel> {
        let row = self.nearest_cell(v, self.rows)?;
        let column = self.nearest_cell(u, self.columns)?;
        self.cells[row * self.columns + column].as_ref()
    }

    /// The cell nearest to a pixel coordinate, among `count` along the axis.
    fn nearest_cell(&self, pixel: f64, count: usize) -> Option<usize> {
        let at = (pixel - R as f64) / self.step as f64 + 0.5;
        (at >= 0.0 && at < count as f64).then_some(at as usize)
    }
}

impl Landmark {
    /// The feature at a pixel; `None` if the depth there is not flat.
    fn at_pixel(frame: &RgbdFrame, noise: &NoiseConfig, [u, v]: [f64; 2]) -> Option<Self> {
        let k = frame.intrinsics;
        let [x, y] = [u, v].map(|c| c.round().max(0.0) as usize);
        if x < R || y < R || x + R >= k.width || y + R >= k.height {
            return None;
        }
        let plane = plane_about_pixel(frame, noise, x, y)?;
        let [slope_u, slope_v] = plane.slopes;
        let inverse = plane.inverse + slope_u * (u - x as f64) + slope_v * (v - y as f64);
        let reading_m = noise.sigma_m(plane.mean_depth_m).max(plane.reading_sigma_m());
        let mut landmark = Self {
            pixel: [u, v],
            read: Vector3::new(inverse, slope_u, slope_v),
            sigma_m: reading_m / INDEPENDENT.sqrt(),
            point: Point3::origin(),
            by_shift: [Vector3::zeros(); 2],
        };
        landmark.correct(&k, &SensorErrors::without_errors(&k));
        Some(landmark)
    }

    /// Corrects its point by the errors of the sensor.
    fn correct(&mut self, k: &Intrinsics, errors: &SensorErrors) {
        let focal_px = [k.fx, k.fy];
        let shift_px = [0, 1].map(|i| errors.color_shift[i] * focal_px[i]);
        // The depth of a color pixel lies beside it, shifted.
        let [u, v] = [0, 1].map(|i| self.pixel[i] - shift_px[i]);
        let inverse = self.read.x - self.read.y * shift_px[0] - self.read.z * shift_px[1];
        let ray = k.ray_at(u, v);
        let depth_m = (1.0 + errors.warp.relative_error_at([u, v])) / inverse;
        self.point = Point3::from(ray * depth_m);
        let slopes = [self.read.y, self.read.z];
        self.by_shift = [0, 1].map(|i| {
            let mut moved = ray * (slopes[i] * focal_px[i] / inverse);
            moved[i] -= 1.0;
            moved * depth_m
        });
    }

    /// Standard deviation of its position across the ray, meters.
    fn place_m(&self, k: &Intrinsics) -> f64 {
        PLACE_PX * self.point.z / k.fx.min(k.fy)
    }
}

/// The plane `n . p = 1` of inverse depth `a + b u + c v` has `n = (b fx, c fy, a + b cx + c cy)`.
fn surfel_of_plane(
    k: &Intrinsics,
    noise: &NoiseConfig,
    [x, y]: [usize; 2],
    plane: &WindowPlane,
    slopes: [f64; 2],
) -> Option<Surfel> {
    let reading_m = noise.sigma_m(plane.mean_depth_m);
    let ray = k.ray_at(x as f64, y as f64);
    let inverse = Vector3::new(plane.inverse, slopes[0], slopes[1]);
    let normal = normal_of_plane(k, &ray, &inverse)?;
    let along = normal.dot(&ray);
    if along < GRAZING_COSINE * ray.norm() {
        return None;
    }
    // A window with little scatter by chance must not get more weight.
    let sigma_m = along * reading_m.max(plane.reading_sigma_m()) / INDEPENDENT.sqrt();
    Some(Surfel {
        plane: inverse.cast(),
        point: Point3::from(ray / plane.inverse).cast(),
        normal: normal.cast(),
        sigma_m: sigma_m as f32,
    })
}

/// Unit normal of a plane of inverse depth with slopes `plane.y` and `plane.z` at the pixel of `ray`.
/// See docs/method.md (2.12).
fn normal_of_plane(k: &Intrinsics, ray: &Vector3<f64>, plane: &Vector3<f64>) -> Option<Vector3<f64>> {
    let [b, c] = [plane.y * k.fx, plane.z * k.fy];
    Vector3::new(b, c, plane.x - b * ray.x - c * ray.y).try_normalize(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analytic::{cuboid, looking_at_origin, view_of};

    /// Windows across an edge are no planes.
    const FINE: NoiseConfig =
        NoiseConfig { constant_m: 2e-5, quadratic_per_m: 0.0, edge_sigmas: 6.0, grazing_cosine: 0.15 };

    #[test]
    fn surfels_lie_on_the_surface_with_its_normal() {
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let half = Vector3::new(0.2, 0.15, 0.1);
        let frame = view_of(&cuboid(half), k, looking_at_origin(Point3::new(0.7, 0.5, 0.4)));
        let surfels = Surfels::of_frame(&frame, &FINE, |_| true);
        assert!(surfels.sum_of_points().1 > 50.0, "{}", surfels.sum_of_points().1);
        for s in surfels.cells.iter().flatten() {
            let p = frame.world_from_camera * s.point.cast::<f64>();
            let n = frame.world_from_camera * s.normal.cast::<f64>();
            assert!(cuboid(half)(&p).abs() < 1e-4, "{p}");
            let face = (0..3)
                .min_by(|a, b| (p[*a].abs() - half[*a]).abs().total_cmp(&(p[*b].abs() - half[*b]).abs()))
                .unwrap();
            // Outward is towards the camera; a normal of a surfel points away from it.
            assert!((n[face] + p[face].signum()).abs() < 1e-3, "{n} on face {face}");
        }
    }

    #[test]
    fn a_frame_agrees_with_another_of_the_same_scene() {
        let k = Intrinsics { width: 160, height: 120, fx: 170.0, fy: 165.0, cx: 81.0, cy: 58.0 };
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.1));
        let [a, b] = [Point3::new(0.7, 0.5, 0.4), Point3::new(0.6, 0.6, 0.45)]
            .map(|eye| view_of(&shape, k, looking_at_origin(eye)));
        let [sa, sb] = [&a, &b].map(|f| Surfels::of_frame(f, &FINE, |_| true));
        let b_from_a = nalgebra::convert(b.world_from_camera.inverse() * a.world_from_camera);
        let all: Vec<Residual> = sa
            .cells_by_facing()
            .iter()
            .flatten()
            .filter_map(|&i| sa.surfel_residual(i, &sb, &b_from_a, &PoseNoise::EXPECTED))
            .collect();
        assert!(all.len() > 30 && all.iter().all(|r| r.distance_m.abs() < 1e-4), "{}", all.len());
    }
}
