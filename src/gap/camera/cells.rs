//! Residuals averaged over patches of surface, frame by frame: neighboring pixels err together.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::{
    parameter::Seen,
    residual::{PixelSample, Sample},
    twin::SeenTwin,
};
use crate::geometry::Pose;

/// Fewest pixels of a cell.
const MIN_PIXELS: usize = 4;
/// Side of a patch over the radius of the object, and its bounds in metres.
const PATCH_SHARE: f64 = 0.2;
const PATCH_M: [f64; 2] = [0.03, 0.12];

/// A patch of a part's surface as one frame sees it.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Where, on average.
    pub seen: Seen,
    /// Index of the patch.
    pub patch: usize,
    /// Mean residual across the surface, metres.
    pub residual_m: f64,
    /// Variance of the mean that the camera's noise gives, square metres.
    pub variance_m2: f64,
    /// Pixels.
    pub pixels: usize,
}

type Key = (usize, [i32; 3], usize);

/// Averages samples of the frames that `is_used` accepts. Patches are cubes in the part's frame, split by the side that
/// the surface faces. Returns the cells and the number of patches.
#[must_use]
pub fn cells(
    twin: &SeenTwin,
    world_from_parts: &[Vec<Pose>],
    samples: &[PixelSample],
    is_used: impl Fn(usize, usize) -> bool,
) -> (Vec<Cell>, usize) {
    let side_m = (PATCH_SHARE * twin.radius_m()).clamp(PATCH_M[0], PATCH_M[1]);
    let mut patches: BTreeMap<Key, usize> = BTreeMap::new();
    let mut groups: BTreeMap<(Key, usize, usize), Vec<(Seen, f64, f64)>> = BTreeMap::new();
    for s in samples {
        let Sample::Match { seen, residual_m, sigma_m, .. } = s.sample else { continue };
        if !is_used(s.run, s.frame) {
            continue;
        }
        let pose = &world_from_parts[s.run][seen.part];
        let p = pose.inverse_transform_point(&seen.point);
        let n = pose.rotation.inverse() * seen.normal;
        let axis = n.iamax();
        let key = (seen.part, [0, 1, 2].map(|k| (p[k] / side_m).floor() as i32), 2 * axis + usize::from(n[axis] > 0.0));
        groups.entry((key, s.run, s.frame)).or_default().push((seen, residual_m, sigma_m));
    }
    let mut all = Vec::with_capacity(groups.len());
    for ((key, _, _), group) in groups {
        if let Some(mut cell) = average(&group) {
            let next = patches.len();
            cell.patch = *patches.entry(key).or_insert(next);
            all.push(cell);
        }
    }
    (all, patches.len())
}

/// The mean of a cell without its outliers.
fn average(group: &[(Seen, f64, f64)]) -> Option<Cell> {
    if group.len() < MIN_PIXELS {
        return None;
    }
    let median = |mut v: Vec<f64>| {
        let m = v.len() / 2;
        *v.select_nth_unstable_by(m, f64::total_cmp).1
    };
    let middle = median(group.iter().map(|g| g.1).collect());
    let spread = 1.4826 * median(group.iter().map(|g| (g.1 - middle).abs()).collect());
    let kept: Vec<_> = group.iter().filter(|g| (g.1 - middle).abs() <= 3.0 * spread.max(g.2)).collect();
    let weight: f64 = kept.iter().map(|g| g.2.powi(-2)).sum();
    let mean = |f: &dyn Fn(&(Seen, f64, f64)) -> f64| kept.iter().map(|g| f(g) * g.2.powi(-2)).sum::<f64>() / weight;
    let vector = |f: &dyn Fn(&Seen) -> Vector3<f64>| Vector3::from_fn(|k, _| mean(&|g| f(&g.0)[k]));
    let seen = Seen {
        point: Point3::from(vector(&|s| s.point.coords)),
        normal: vector(&|s| s.normal).try_normalize(1e-6)?,
        depth_m: mean(&|g| g.0.depth_m),
        slant: mean(&|g| g.0.slant),
        ..kept.first()?.0
    };
    // Where pixels scatter more than the camera's noise, the scatter counts.
    let scatter = (kept.iter().map(|g| (g.1 - middle).powi(2)).sum::<f64>() / kept.len() as f64) / kept.len() as f64;
    Some(Cell { seen, patch: 0, residual_m: mean(&|g| g.1), variance_m2: (1.0 / weight).max(scatter), pixels: kept.len() })
}
