//! Residuals averaged over patches of surface in each frame, since the errors of neighboring pixels
//! correlate.
//! See docs/method.md 15.4.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use crate::camera::{
    fit::sample::{PixelSample, Sample},
    model::{posed::SurfacePoint, twin::SeenTwin},
};
use geometry::Pose;
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Least length of a mean of unit normals; a shorter mean has no direction.
///
/// chosen: far above rounding, far below any patch's
const LEAST_NORMAL: f64 = 1e-6;
/// Fewest pixels of a patch in a frame.
const MIN_PIXELS: usize = 4;
/// Side of a patch as a share of the object's size.
///
/// tuned: made objects (tests/gap_frames.rs)
const PATCH: f64 = 0.2;

/// A patch of a part's surface seen in one frame.
#[derive(Clone, Copy, Debug)]
pub struct PatchMean {
    /// Mean surface point.
    pub seen: SurfacePoint,
    /// Index of the patch.
    pub patch: usize,
    /// Mean residual normal to the surface, meters.
    pub residual_m: f64,
    /// Variance of the mean due to the camera's noise, square meters.
    pub variance_m2: f64,
    /// Number of pixels.
    pub pixels: usize,
}

type Key = (usize, [i32; 3], usize);

/// A surface point, its residual and the residual's standard deviation, meters.
type PixelReading = (SurfacePoint, f64, f64);

/// Mean of a quantity, weighted by the inverse variances of the residuals; `weight` is their sum.
fn weighted_mean(kept: &[&PixelReading], weight: f64, of: &dyn Fn(&PixelReading) -> f64) -> f64 {
    kept.iter().map(|g| of(g) * g.2.powi(-2)).sum::<f64>() / weight
}

/// Averages samples over patches, in the frames accepted by `is_used`. Patches are cubes in the part's frame,
/// split by the direction of the surface normal. Returns the means and the number of patches.
pub fn patch_means(
    twin: &SeenTwin,
    world_from_parts: &[Vec<Pose>],
    samples: &[PixelSample],
    is_used: impl Fn(usize, usize) -> bool,
) -> (Vec<PatchMean>, usize) {
    let side_m = PATCH * twin.radius_m();
    let mut patches: BTreeMap<Key, usize> = BTreeMap::new();
    let mut groups: BTreeMap<(Key, usize, usize), Vec<(SurfacePoint, f64, f64)>> = BTreeMap::new();
    for s in samples {
        let Sample::Match { seen, residual_m, sigma_m, .. } = s.sample else { continue };
        if !is_used(s.run, s.frame) {
            continue;
        }
        let pose = &world_from_parts[s.run][seen.part];
        let p = pose.inverse_transform_point(&seen.point);
        let n = pose.rotation.inverse() * seen.normal;
        let axis = n.iamax();
        let key = (
            seen.part,
            [0, 1, 2].map(|k| (p[k] / side_m).floor() as i32),
            2 * axis + usize::from(n[axis] > 0.0),
        );
        groups.entry((key, s.run, s.frame)).or_default().push((seen, residual_m, sigma_m));
    }
    let mut all = Vec::with_capacity(groups.len());
    for ((key, _, _), group) in groups {
        if let Some(mut mean) = mean_of_patch(&group) {
            let next = patches.len();
            mean.patch = *patches.entry(key).or_insert(next);
            all.push(mean);
        }
    }
    (all, patches.len())
}

/// The mean of a patch in a frame, without its outliers.
fn mean_of_patch(group: &[PixelReading]) -> Option<PatchMean> {
    if group.len() < MIN_PIXELS {
        return None;
    }
    let middle = median(group.iter().map(|g| g.1).collect())?;
    let spread = SIGMAS_PER_MAD * median(group.iter().map(|g| (g.1 - middle).abs()).collect())?;
    // Readings in whole millimeters may have no spread at all: a pixel's own noise is the least spread.
    let kept: Vec<_> = group.iter().filter(|g| (g.1 - middle).abs() <= 3.0 * spread.max(g.2)).collect();
    let weight: f64 = kept.iter().map(|g| g.2.powi(-2)).sum();
    let mean = |f: &dyn Fn(&PixelReading) -> f64| weighted_mean(&kept, weight, f);
    let seen = SurfacePoint {
        point: Point3::from(Vector3::from_fn(|k, _| mean(&|g| g.0.point.coords[k]))),
        normal: Vector3::from_fn(|k, _| mean(&|g| g.0.normal[k])).try_normalize(LEAST_NORMAL)?,
        depth_m: mean(&|g| g.0.depth_m),
        slant: mean(&|g| g.0.slant),
        ..kept.first()?.0
    };
    // Where pixels scatter more than the camera's noise, the larger variance is taken.
    let scatter =
        (kept.iter().map(|g| (g.1 - middle).powi(2)).sum::<f64>() / kept.len() as f64) / kept.len() as f64;
    Some(PatchMean {
        seen,
        patch: 0,
        residual_m: mean(&|g| g.1),
        variance_m2: (1.0 / weight).max(scatter),
        pixels: kept.len(),
    })
}
