//! Where the fit of a curve starts: the best of some curves through two or three samples, by the median of
//! the distances, which outliers do not change.

use nalgebra::Vector3;

use crate::track::curve::PathCurve;
use numeric::{
    random::{stage_rng, unit_uniform},
    statistics::median,
};

/// Curves that are tried.
/// chosen: with every third sample an outlier, a hundred of them pass through none.
const TRIALS: usize = 300;
/// Samples that choose and judge a curve lie apart by this share of the extent.
/// chosen: some tens of places along any track.
const APART: f64 = 0.03;

/// The best line, or circle, through samples, from the middle of its length on, with the median distance,
/// meters.
#[must_use]
pub fn start_curve(positions: &[Vector3<f64>], is_bent: bool) -> Option<(PathCurve, f64)> {
    let mut rng = stage_rng(0, "track", u64::from(is_bent));
    let judges = places(positions)?;
    let mut best: Option<(PathCurve, f64)> = None;
    for _ in 0..TRIALS {
        let mut chosen = [0; 3].map(|_: usize| (unit_uniform(&mut rng) * judges.len() as f64) as usize);
        chosen.sort_unstable();
        let [first, middle, last] = chosen.map(|k| &judges[k]);
        let curve = if is_bent {
            PathCurve::circle([first, middle, last])
        } else {
            PathCurve::line(*first, &(last - first))
        };
        let Some(curve) = curve else { continue };
        let distances = judges.iter().map(|p| curve.residual(p).0.norm()).collect();
        let distance = median(distances).unwrap_or(f64::INFINITY);
        if best.is_none_or(|b| distance < b.1) {
            best = Some((curve, distance));
        }
    }
    let (curve, distance) = best?;
    let middle = median(curve.residuals(&judges).1)?;
    Some((curve.from_point_at(middle), distance))
}

/// Samples that lie apart: a long rest is one place.
fn places(positions: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    let middle = positions.get(positions.len() / 2)?;
    let mut extents: Vec<f64> = positions.iter().map(|p| (p - middle).norm()).collect();
    extents.sort_unstable_by(f64::total_cmp);
    // The farthest may be outliers.
    let apart = APART * extents[extents.len() * 9 / 10].max(f64::MIN_POSITIVE);
    let mut places: Vec<Vector3<f64>> = Vec::new();
    for position in positions {
        if places.iter().all(|p| (p - position).norm() > apart) {
            places.push(*position);
        }
    }
    Some(places)
}
