//! Planes below or behind the object: RANSAC finds them in the points of all frames.
//!
//! A plane is background only if all cameras are on one side of it, it reaches the image borders, almost
//! nothing lies behind it there, and little elsewhere. So no side of the object is taken for a wall, a floor
//! is removed before the table on it, and a wall with a door or a window in it is still a wall.

use std::fmt;

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use rand_core::Rng;

use super::background::in_box;
use crate::{NoiseConfig, RgbdFrame};
use common::stop::{Stop, Stopped};
use geometry::Intrinsics;

/// Number of sampled points.
const SAMPLES: usize = 60_000;
/// Number of points that score a hypothesis.
const SCORED: usize = 6_000;
/// Fewest samples in which a plane is looked for.
const LEAST_SAMPLES: usize = 100;
/// Hypotheses per plane.
const TRIALS: usize = 600;
/// Rounds of refitting a plane to its readings.
const ROUNDS: usize = 5;
/// Most points at the image borders that lie behind a background plane, relative to all of them.
/// tuned: made and recorded objects (docs/method.md 16)
const BEHIND_SHARE: f64 = 0.05;
/// Most points anywhere that lie behind a background plane, relative to those on it.
/// chosen: an open door takes less of the wall that is seen about it
const OPENING_SHARE: f64 = 0.25;
/// Least share of all points at the image borders that lie on a background plane.
/// chosen: with fewer, stray readings of planes found before are most of what is left there
const LEAST_BORDER: f64 = 0.02;
/// Least share of the points at the image borders, without those of planes found before, that lie on a
/// background plane.
/// tuned: made and recorded objects (docs/method.md 16)
const BORDER_SHARE: f64 = 0.15;
/// Least share of all points that lie on a background plane.
/// tuned: made and recorded objects (docs/method.md 16)
const SUPPORT_SHARE: f64 = 0.05;
/// Width of the image border, share of the image. tuned: made and recorded objects (docs/method.md 16)
const BORDER: f64 = 0.06;

/// Plane `normal . p = offset_m`; the normal points to the cameras' side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal in the world frame.
    pub normal: Unit<Vector3<f64>>,
    /// Offset of the plane along its normal, meters.
    pub offset_m: f64,
    /// Lower and upper corner of a box in the world, meters, in which the plane is a surface of the object.
    pub object_box_m: Option<[[f64; 3]; 2]>,
}

impl fmt::Display for Plane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.normal.into_inner().into();
        write!(f, "normal ({x:.3}, {y:.3}, {z:.3}), {:.4} m from the world's origin", self.offset_m)
    }
}

impl Plane {
    /// Signed distance of a point, meters; positive on the cameras' side.
    #[must_use]
    pub fn height_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    /// Whether a surface on the plane, or behind it, is background at a point.
    #[must_use]
    pub fn is_background_at(&self, point: &Point3<f64>) -> bool {
        self.object_box_m.is_none_or(|object_box_m| !in_box(Some(object_box_m), point))
    }

    /// Whether a reading is of the plane, up to `sigma_m` of its depth along a ray with unit z.
    #[must_use]
    pub fn is_on(&self, point: &Point3<f64>, ray_in_world: &Vector3<f64>, sigma_m: f64) -> bool {
        self.height_m(point).abs() < 0.002 + 2.5 * self.height_sigma_m(ray_in_world, sigma_m)
    }

    /// Standard deviation of a point's height, meters, from `sigma_m` of its depth along a ray with unit z.
    #[must_use]
    pub fn height_sigma_m(&self, ray_in_world: &Vector3<f64>, sigma_m: f64) -> f64 {
        sigma_m * self.normal.dot(ray_in_world).abs()
    }
}

/// A sampled depth reading.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    pub point: Point3<f64>,
    /// Direction of its ray in the world, with unit depth.
    pub ray: Vector3<f64>,
    /// Standard deviation of its depth, meters.
    pub sigma_m: f64,
    at_border: bool,
}

/// The background planes of all readings, in order of removal; `cameras` are the places of the cameras.
pub(super) fn background_planes(
    mut samples: Vec<Sample>,
    cameras: &[Point3<f64>],
    rng: &mut impl Rng,
    stop: &Stop,
) -> Result<Vec<Plane>, Stopped> {
    let least = SUPPORT_SHARE * samples.len() as f64;
    let least_at_borders = LEAST_BORDER * count_at_borders(&samples) as f64;
    let mut planes = Vec::new();
    // Without readings at the borders, no background remains.
    while samples.len() >= LEAST_SAMPLES && count_at_borders(&samples) as f64 >= least_at_borders {
        stop.check()?;
        let Some(plane) = best_plane(&samples, cameras, rng) else { break };
        let on = samples.iter().filter(|s| is_inlier(&plane, s));
        let at_borders = on.clone().filter(|s| s.at_border).count();
        if (on.count() as f64) < least || (at_borders as f64) < least_at_borders {
            break;
        }
        // Points behind are removed as well: cameras do not see through a plane.
        samples.retain(|s| plane.height_m(&s.point) > 0.005 + 4.0 * plane.height_sigma_m(&s.ray, s.sigma_m));
        planes.push(plane);
    }
    Ok(planes)
}

fn count_at_borders(samples: &[Sample]) -> usize {
    samples.iter().filter(|s| s.at_border).count()
}

/// Places of the cameras in the world.
pub(super) fn places(frames: &[&RgbdFrame]) -> Vec<Point3<f64>> {
    frames.iter().map(|f| Point3::from(f.world_from_camera.translation.vector)).collect()
}

/// Depth readings on a regular grid of pixels in every frame.
pub(super) fn sampled_readings(frames: &[&RgbdFrame], noise: &NoiseConfig) -> Vec<Sample> {
    let pixels: usize = frames.iter().map(|f| f.depth_m.len()).sum();
    let stride = ((pixels as f64 / SAMPLES as f64).sqrt().ceil() as usize).max(1);
    let mut samples = Vec::new();
    for frame in frames {
        let k = &frame.intrinsics;
        for y in (stride / 2..k.height).step_by(stride) {
            for x in (stride / 2..k.width).step_by(stride) {
                let Some(point) = frame.world_point(y * k.width + x) else { continue };
                samples.push(Sample {
                    point,
                    ray: frame.world_from_camera.rotation * k.ray_at(x as f64, y as f64),
                    sigma_m: noise.sigma_m(f64::from(frame.depth_m[y * k.width + x])),
                    at_border: is_at_border(k, x, y),
                });
            }
        }
    }
    samples
}

/// Whether a pixel is at the image border.
pub fn is_at_border(k: &Intrinsics, x: usize, y: usize) -> bool {
    let width = (k.width as f64 * BORDER) as usize;
    let height = (k.height as f64 * BORDER) as usize;
    x < width || y < height || x + width >= k.width || y + height >= k.height
}

fn best_plane(samples: &[Sample], cameras: &[Point3<f64>], rng: &mut impl Rng) -> Option<Plane> {
    let plane = drawn_plane(samples, cameras, TRIALS, rng, background_readings)?;
    // A few readings sufficed to compare; all of them decide.
    let all: Vec<&Sample> = samples.iter().collect();
    background_readings(&plane, &all).map(|_| plane)
}

/// The best of planes through three readings, fitted to its readings (RANSAC, Fischler and Bolles 1981).
/// `score` compares planes by some of the readings; `None` refuses one. There must be readings.
pub(super) fn drawn_plane(
    samples: &[Sample],
    cameras: &[Point3<f64>],
    trials: usize,
    rng: &mut impl Rng,
    score: impl Fn(&Plane, &[&Sample]) -> Option<u32>,
) -> Option<Plane> {
    let scored: Vec<&Sample> = samples.iter().step_by(samples.len().div_ceil(SCORED)).collect();
    let mut best: Option<(u32, Plane)> = None;
    for _ in 0..trials {
        let [a, b, c] = [(); 3].map(|()| samples[(rng.next_u64() % samples.len() as u64) as usize].point);
        let Some(plane) = plane_through(&a, &b, &c, cameras) else { continue };
        let Some(score) = score(&plane, &scored) else { continue };
        if best.is_none_or(|(s, _)| score > s) {
            best = Some((score, plane));
        }
    }
    let (_, mut plane) = best?;
    // The inliers change with the plane.
    for _ in 0..ROUNDS {
        plane = refitted_plane(&plane, samples, cameras)?;
    }
    Some(plane)
}

/// The plane through three points, with its normal to the cameras; `None` if they are collinear or the
/// cameras are on both sides.
fn plane_through(
    a: &Point3<f64>,
    b: &Point3<f64>,
    c: &Point3<f64>,
    cameras: &[Point3<f64>],
) -> Option<Plane> {
    let normal = Unit::try_new((b - a).cross(&(c - a)), 1e-4)?;
    oriented_to_cameras(Plane { normal, offset_m: normal.dot(&a.coords), object_box_m: None }, cameras)
}

fn oriented_to_cameras(plane: Plane, cameras: &[Point3<f64>]) -> Option<Plane> {
    let above = cameras.iter().filter(|c| plane.height_m(c) > 0.0).count();
    if above == cameras.len() {
        Some(plane)
    } else if above == 0 {
        Some(Plane { normal: -plane.normal, offset_m: -plane.offset_m, ..plane })
    } else {
        None
    }
}

pub(super) fn is_inlier(plane: &Plane, s: &Sample) -> bool {
    plane.is_on(&s.point, &s.ray, s.sigma_m)
}

/// Number of readings on a plane; `None` if the plane is no background.
fn background_readings(plane: &Plane, samples: &[&Sample]) -> Option<u32> {
    let mut inside = 0;
    let mut behind = 0;
    let mut borders = 0;
    let mut on_borders = 0;
    let mut behind_borders = 0;
    for s in samples {
        let inlier = is_inlier(plane, s);
        // Well behind, beyond the noise of the plane's own points.
        let limit_m = 0.01 + 4.0 * plane.height_sigma_m(&s.ray, s.sigma_m);
        let is_behind = plane.height_m(&s.point) < -limit_m;
        inside += u32::from(inlier);
        behind += u32::from(is_behind);
        borders += u32::from(s.at_border);
        on_borders += u32::from(s.at_border && inlier);
        behind_borders += u32::from(s.at_border && is_behind);
    }
    let is_wide = on_borders > 0 && f64::from(on_borders) >= BORDER_SHARE * f64::from(borders);
    let is_last = f64::from(behind_borders) <= BEHIND_SHARE * f64::from(borders)
        && f64::from(behind) <= OPENING_SHARE * f64::from(inside);
    (is_wide && is_last).then_some(inside)
}

/// Least squares fit to the inliers, weighted by their noise.
fn refitted_plane(plane: &Plane, samples: &[Sample], cameras: &[Point3<f64>]) -> Option<Plane> {
    let inliers: Vec<_> = samples.iter().filter(|s| is_inlier(plane, s)).collect();
    if inliers.len() < 3 {
        return None;
    }
    // One millimeter is added, as grazing readings have hardly any noise of height and would dominate.
    let weight = |s: &Sample| 1.0 / (0.001 + plane.height_sigma_m(&s.ray, s.sigma_m)).powi(2);
    let total: f64 = inliers.iter().map(|s| weight(s)).sum();
    let mean = inliers.iter().map(|s| s.point.coords * weight(s)).sum::<Vector3<f64>>() / total;
    let spread = inliers
        .iter()
        .map(|s| (s.point.coords - mean) * (s.point.coords - mean).transpose() * weight(s))
        .sum::<Matrix3<f64>>();
    let eigen = spread.symmetric_eigen();
    let normal = Unit::try_new(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned(), 1e-9)?;
    oriented_to_cameras(Plane { normal, offset_m: normal.dot(&mean), object_box_m: None }, cameras)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use geometry::Pose;
    use numeric::random::stage_rng;

    /// Lower and upper corner of a block, meters.
    pub type Block = [[f64; 3]; 2];

    /// Where a ray meets a block first, as a multiple of its direction.
    pub fn hit(origin: &Point3<f64>, ray: &Vector3<f64>, [lower, upper]: &Block) -> Option<f64> {
        let mut near = 0.0f64;
        let mut far = f64::INFINITY;
        for k in 0..3 {
            let a = (lower[k] - origin[k]) / ray[k];
            let b = (upper[k] - origin[k]) / ray[k];
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near <= far && near > 0.0).then_some(near)
    }

    /// About normal: the sum of twelve uniform numbers.
    pub fn normal(rng: &mut impl Rng) -> f64 {
        (0..12).map(|_| rng.next_u64() as f64 / u64::MAX as f64).sum::<f64>() - 6.0
    }

    /// Blocks seen with noise from an arc of cameras that look at the origin from this far.
    fn frames(blocks: &[Block], distance: f64, height: f64) -> Vec<RgbdFrame> {
        let intrinsics = Intrinsics { width: 96, height: 72, fx: 80.0, fy: 80.0, cx: 48.0, cy: 36.0 };
        let noise = NoiseConfig::default();
        let mut rng = stage_rng(3, "planes", 0);
        let mut frame = |i: usize| {
            let angle = -0.8 + 0.2 * i as f64;
            let eye = Point3::new(distance * angle.cos(), distance * angle.sin(), height);
            let world_from_camera = Pose::face_towards(&eye, &Point3::new(0.0, 0.0, 0.1), &-Vector3::z());
            let mut depth = |p: usize| {
                let ray = world_from_camera.rotation * intrinsics.ray_at((p % 96) as f64, (p / 96) as f64);
                let d = blocks.iter().filter_map(|b| hit(&eye, &ray, b)).fold(f64::INFINITY, f64::min);
                if d < 6.0 { (d + noise.sigma_m(d) * normal(&mut rng)) as f32 } else { 0.0 }
            };
            let depth_m = (0..96 * 72).map(&mut depth).collect();
            RgbdFrame {
                id: String::new(),
                stamp_nanos: 0,
                intrinsics,
                world_from_camera,
                rgb: Vec::new(),
                depth_m,
                mask: None,
                readings: Vec::new(),
            }
        };
        (0..9).map(&mut frame).collect()
    }

    fn planes(blocks: &[Block], distance: f64, height: f64) -> Vec<Plane> {
        let frames = frames(blocks, distance, height);
        let frames: Vec<&RgbdFrame> = frames.iter().collect();
        let samples = sampled_readings(&frames, &NoiseConfig::default());
        background_planes(samples, &places(&frames), &mut stage_rng(0, "test", 0), &Stop::never()).unwrap()
    }

    const FLOOR: Block = [[-9.0, -9.0, -1.1], [9.0, 9.0, -1.0]];

    #[test]
    fn the_floor_goes_and_the_sides_of_a_large_box_stay() {
        let floor = [[-9.0, -9.0, -0.1], [9.0, 9.0, 0.0]];
        let found = planes(&[floor, [[-0.3, -0.3, 0.0], [0.3, 0.3, 0.8]]], 2.0, 1.2);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].normal.z > 0.9999 && found[0].offset_m.abs() < 0.002, "{found:?}");
    }

    #[test]
    fn the_floor_goes_before_the_table_that_stands_on_it() {
        let table = [[-0.6, -0.9, -0.05], [0.6, 0.9, 0.0]];
        let found = planes(&[FLOOR, table, [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.2]]], 1.3, 0.9);
        let offsets: Vec<f64> = found.iter().map(|p| p.offset_m).collect();
        assert!(found.len() == 2 && (offsets[0] + 1.0).abs() < 0.01 && offsets[1].abs() < 0.003, "{found:?}");
    }

    #[test]
    fn without_background_there_is_no_plane() {
        assert!(planes(&[[[-0.2, -0.2, 0.0], [0.2, 0.2, 0.2]]], 1.5, 0.8).is_empty());
    }
}
