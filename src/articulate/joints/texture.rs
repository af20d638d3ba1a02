//! Aligns surface texture between the states: dense matches where pixel features are few.
//!
//! Around a surface point, the frames of one state are averaged on the tangent plane into a small patch. The
//! part's motion moves it onto the other state's surface, where Lucas-Kanade with normalized brightness looks
//! for the same patch: shading may change. A patch fixes the surface within its own plane, which distance
//! fields leave open.

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use rayon::prelude::*;

use crate::{
    joints::{
        gray_frames::{GrayFrames, Tangent},
        joint_motion::frame_across,
        motion_evidence::MatchEvidence,
        patch_alignment::{RADIUS, REACH, Shift, aligned_shift},
    },
    observations::SurfaceSamples,
};
use capture::{NoiseConfig, RgbdFrame};
use geometry::{Grid3, Pose};

/// Least cosine between the normals of a moved point and of the surface there.
/// chosen: 45 degrees; beyond, it is not the moved surface
const SAME_WAY_COSINE: f64 = 0.7;

/// Surface points tried per part and state.
const POINTS: usize = 3000;
/// Largest number of frames averaged into a patch.
const FRAMES: usize = 8;
/// Distance between patch samples, in pixels of the closest camera.
/// chosen: the mean of frames is blurred by about as much
const SPACING_PX: f64 = 2.0;
/// Least contrast of a patch, the standard deviation of gray values of 0 to 1.
/// chosen: four steps of 8 bits, somewhat above the noise of a camera
const LEAST_CONTRAST: f64 = 0.015;
/// Least normalized correlation of an aligned pair.
/// chosen: two thirds of the variance are the same texture
const LEAST_CORRELATION: f64 = 0.8;
/// Least standard deviation of an aligned patch, pixels of the closest camera.
/// chosen: errors of poses and of the averaging, which no residual shows
const LEAST_SIGMA_PX: f64 = 0.5;

/// Dense matches of one part under a motion near the true one. `sdf` are the distance fields of both states,
/// meters.
pub(crate) fn texture_matches(
    surfaces: [&SurfaceSamples; 2],
    states: [&[RgbdFrame]; 2],
    sdf: [&Grid3<f32>; 2],
    motion: &Pose,
    noise: &NoiseConfig,
) -> Vec<MatchEvidence> {
    let gray = [GrayFrames::new(states[0], noise), GrayFrames::new(states[1], noise)];
    let mut all = Vec::new();
    for from in [0, 1] {
        let to = 1 - from;
        let warp = if from == 0 { *motion } else { motion.inverse() };
        let surface = surfaces[from];
        let stride = surface.points.len().div_ceil(POINTS).max(1);
        let picked: Vec<usize> = (0..surface.points.len()).step_by(stride).collect();
        let found: Vec<Option<(Point3<f64>, Point3<f64>, Matrix3<f64>, f64)>> = picked
            .par_iter()
            .map(|&i| {
                match_point(&surface.points[i], &surface.normals[i], &warp, &gray[from], &gray[to], sdf[to])
            })
            .collect();
        for (point, other, covariance, patch_area_m2) in found.into_iter().flatten() {
            // The covariance is that of the far end; the near end is exact by definition.
            let (point0, point1) = if from == 0 { (point, other) } else { (other, point) };
            let (covariance0, covariance1) =
                if from == 0 { (Matrix3::zeros(), covariance) } else { (covariance, Matrix3::zeros()) };
            all.push((MatchEvidence { point0, point1, covariance0, covariance1, share: 1.0 }, patch_area_m2));
        }
    }
    share_out(all)
}

/// Overlapping patches are not independent: each counts for its share of the patches around it.
fn share_out(all: Vec<(MatchEvidence, f64)>) -> Vec<MatchEvidence> {
    let centers: Vec<Point3<f64>> = all.iter().map(|(m, _)| m.point0).collect();
    let shares: Vec<f64> = all
        .par_iter()
        .map(|(m, area)| {
            1.0 / centers.iter().filter(|c| (**c - m.point0).norm_squared() < area / 4.0).count().max(1)
                as f64
        })
        .collect();
    all.into_iter().zip(shares).map(|((m, _), share)| MatchEvidence { share, ..m }).collect()
}

/// Finds one surface point on the other state's surface: both points, the covariance of the other, and the
/// area of the patch.
fn match_point(
    point: &Point3<f64>,
    normal: &Vector3<f64>,
    warp: &Pose,
    from: &GrayFrames,
    to: &GrayFrames,
    sdf: &Grid3<f32>,
) -> Option<(Point3<f64>, Point3<f64>, Matrix3<f64>, f64)> {
    let warped = warp * point;
    let (distance, gradient) = sdf.sample_with_gradient(&warped);
    let other_normal = warp.rotation * normal;
    let gradient = gradient.cast::<f64>();
    // The nearest surface faces another way: it is not the moved one.
    if gradient.dot(&other_normal) < SAME_WAY_COSINE * gradient.norm() {
        return None;
    }
    // Onto the other state's surface: off it, frames from different sides would see it displaced.
    let center = warped - other_normal * f64::from(distance);
    let (frames, pixel_m) = from.best_frames(point, normal, FRAMES);
    let (other_frames, other_pixel_m) = to.best_frames(&center, &other_normal, FRAMES);
    if frames.is_empty() || other_frames.is_empty() {
        return None;
    }
    let (a, b) = frame_across(&Unit::new_unchecked(*normal));
    let axes = [a, b];
    // The coarser camera decides, as a finer patch would contain texture unseen in one state.
    let pixel_m = pixel_m.max(other_pixel_m);
    let spacing_m = SPACING_PX * pixel_m;
    let here = Tangent { center: *point, normal: *normal, axes, spacing_m };
    let there = Tangent { center, normal: other_normal, axes: axes.map(|a| warp.rotation * a), spacing_m };
    let reference = from.mean_patch(&here, &frames, RADIUS);
    if reference.is_lost(LEAST_CONTRAST) {
        return None;
    }
    let target = to.mean_patch(&there, &other_frames, RADIUS + REACH);
    let Shift { shift, covariance, correlation } = aligned_shift(&reference, &target, LEAST_CONTRAST)?;
    if correlation < LEAST_CORRELATION {
        return None;
    }
    let other = center + (there.axes[0] * shift.x + there.axes[1] * shift.y) * spacing_m;
    // The covariance of docs/method.md (8.6) in the tangent plane.
    let floor = (LEAST_SIGMA_PX * pixel_m).powi(2);
    let mut spread = Matrix3::identity() * floor;
    for i in 0..2 {
        for j in 0..2 {
            spread +=
                there.axes[i] * there.axes[j].transpose() * (covariance[(i, j)] * spacing_m * spacing_m);
        }
    }
    // Along the normal it is left open: there the distance fields decide.
    let open = (spacing_m * f64::from(RADIUS)).powi(2);
    spread += there.normal * there.normal.transpose() * open;
    let side = spacing_m * f64::from(2 * RADIUS + 1);
    Some((*point, other, spread, side * side))
}
