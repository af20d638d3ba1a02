//! The bounding box of missing geometry, with intervals of its sides.

use nalgebra::Point3;
use rand_core::Rng;

use numeric::random::stage_rng;

/// Share of readings left outside each side of the box.
///
/// chosen: one in a hundred, for outliers of the depth
const OUTER: f64 = 0.01;
/// Number of bootstrap draws for the intervals.
const DRAWS: usize = 120;

/// Bounding box of the points of all frames, and 95 % intervals of its sides. They hold the spread over
/// bootstrapped frames, the noise of the readings, and outward the border of the twin's silhouette, where
/// pixels are not compared.
pub(super) fn box_sides(
    views: &[Vec<Point3<f64>>],
    border_m: f64,
    noise_m: f64,
) -> Option<([[f64; 3]; 2], [[(f64, f64); 3]; 2])> {
    if views.iter().all(Vec::is_empty) {
        return None;
    }
    let mut bounds = [[0.0; 3]; 2];
    let mut intervals = [[(0.0, 0.0); 3]; 2];
    for k in 0..3 {
        let along: Vec<Vec<f64>> = views.iter().map(|v| v.iter().map(|p| p[k]).collect()).collect();
        for (s, share) in [OUTER, 1.0 - OUTER].into_iter().enumerate() {
            bounds[s][k] = quantile(&along.concat(), share);
            let (low, high) = bootstrap_interval(&along, |all| quantile(all, share));
            let (below, above) = if s == 0 { (border_m, 0.0) } else { (0.0, border_m) };
            intervals[s][k] = (low - noise_m - below, high + noise_m + above);
        }
    }
    Some((bounds, intervals))
}

/// The largest area in one frame and its interval: bootstrap over the frames, widened outward by the border.
pub(super) fn largest_area(areas: &[f64], border_m: f64) -> (f64, (f64, f64)) {
    let largest = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
    let area_m2 = largest(areas);
    let groups: Vec<Vec<f64>> = areas.iter().map(|a| vec![*a]).collect();
    let (low, high) = bootstrap_interval(&groups, largest);
    (area_m2, (low, high.max((area_m2.sqrt() + 2.0 * border_m).powi(2))))
}

/// The value below which a `share` of all values lies.
fn quantile(all: &[f64], share: f64) -> f64 {
    let mut sorted = all.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// 95 % bootstrap interval of a statistic over groups.
fn bootstrap_interval(groups: &[Vec<f64>], statistic: impl Fn(&[f64]) -> f64) -> (f64, f64) {
    // A fixed seed: the same frames give the same interval.
    let rng = &mut stage_rng(0, "gap/missing", groups.len() as u64);
    let mut values: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let drawn: Vec<f64> = (0..groups.len())
                .flat_map(|_| groups[rng.next_u64() as usize % groups.len()].iter().copied())
                .collect();
            statistic(&drawn)
        })
        .collect();
    values.sort_unstable_by(f64::total_cmp);
    // 2.5 % on either side.
    let cut = DRAWS / 40;
    (values[cut], values[DRAWS - 1 - cut])
}
