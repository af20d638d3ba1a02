//! Segments of surface: the flat patches of each part; those of one state are joined with their
//! correspondences in the other.
//!
//! Under the motion of a segment, the surfaces of the two states may coincide though each has another motion
//! and is hidden in one state, unless they would have had to pass through each other.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use crate::{observations::SurfaceSamples, pair::surface_pair::SurfacePair};
use geometry::Pose;

/// The samples of one label on one flat patch in each state; one state may have none.
pub(crate) struct Segment {
    pub label: usize,
    /// Indices of the samples of each state.
    pub samples: [Vec<usize>; 2],
}

impl Segment {
    /// Whether its surface of state 0 under one motion and its surface of state 1 under another would pass
    /// through each other.
    pub(crate) fn crosses(&self, pair: &SurfacePair<'_>, first: &Pose, second: &Pose) -> bool {
        let [Some(start), Some(end)] = [0, 1].map(|s| Facet::of(pair.samples[s], &self.samples[s])) else {
            return false;
        };
        // Two sheets cross if one is in front of the other in state 0 and behind it in state 1.
        let before = end.moved(&second.inverse()).height_m(&start.center);
        let after = end.height_m(&(first * start.center));
        let clear_m = CLEAR * pair.scales.plane_m;
        let overlap = before.1 < 1.0 && after.1 < 1.0;
        overlap && before.0.abs().min(after.0.abs()) > clear_m && before.0 * after.0 < 0.0
    }
}

/// Surface at least this many standard deviations from a plane is on one side of it.
/// chosen: beyond three lie 0.3 % of the samples of the plane
const CLEAR: f64 = 3.0;

/// Position and size of a segment in one state.
struct Facet {
    center: Point3<f64>,
    normal: Vector3<f64>,
    radius_m: f64,
}

impl Facet {
    fn of(surface: &SurfaceSamples, samples: &[usize]) -> Option<Self> {
        let n = samples.len() as f64;
        let center =
            Point3::from(samples.iter().map(|&i| surface.points[i].coords).sum::<Vector3<f64>>() / n);
        let normal = samples.iter().map(|&i| surface.normals[i]).sum::<Vector3<f64>>().try_normalize(1e-9)?;
        let radius_m =
            (samples.iter().map(|&i| (surface.points[i] - center).norm_squared()).sum::<f64>() / n).sqrt();
        Some(Self { center, normal, radius_m })
    }

    fn moved(&self, motion: &Pose) -> Self {
        Self { center: motion * self.center, normal: motion * self.normal, radius_m: self.radius_m }
    }

    /// Height of a point above it, meters, and the point's distance from its center, in radii.
    fn height_m(&self, point: &Point3<f64>) -> (f64, f64) {
        let offset = point - self.center;
        let height = self.normal.dot(&offset);
        (height, (offset - self.normal * height).norm() / self.radius_m.max(1e-9))
    }
}

/// All samples by segment. Each patch is joined with one of the other state, pairs with the most
/// correspondences first.
pub(crate) fn segments_of(pair: &SurfacePair<'_>, motions: &[Pose], labels: &[Vec<u8>; 2]) -> Vec<Segment> {
    let groups = [0, 1].map(|s| samples_by_sheet(pair, s, &labels[s]));
    let of = [0, 1].map(|s| {
        let mut of = vec![0; labels[s].len()];
        groups[s].iter().enumerate().for_each(|(g, (_, samples))| samples.iter().for_each(|&i| of[i] = g));
        of
    });
    let mut shared: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for (k, motion) in motions.iter().enumerate() {
        for s in 0..2 {
            for (i, j) in pair.partners_under(s, motion) {
                if usize::from(labels[s][i]) == k && usize::from(labels[1 - s][j]) == k {
                    let pair = if s == 0 { [of[0][i], of[1][j]] } else { [of[0][j], of[1][i]] };
                    *shared.entry(pair).or_default() += 1;
                }
            }
        }
    }
    let mut pairs: Vec<([usize; 2], usize)> = shared.into_iter().collect();
    // Most first, and equal ones by index, so the result depends on nothing else.
    pairs.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut partner = [0, 1].map(|s| vec![None; groups[s].len()]);
    for ([a, b], _) in pairs {
        if partner[0][a].is_none() && partner[1][b].is_none() {
            (partner[0][a], partner[1][b]) = (Some(b), Some(a));
        }
    }
    let [first, mut second] = groups;
    let mut all: Vec<Segment> = Vec::new();
    for ((label, samples), there) in first.into_iter().zip(&partner[0]) {
        let there = there.map_or_else(Vec::new, |b: usize| std::mem::take(&mut second[b].1));
        all.push(Segment { label, samples: [samples, there] });
    }
    let alone = second.into_iter().filter(|g| !g.1.is_empty());
    all.extend(alone.map(|(label, samples)| Segment { label, samples: [Vec::new(), samples] }));
    all
}

/// The samples of a state, grouped by label and smooth sheet, each group with its label.
pub(crate) fn samples_by_sheet(
    pair: &SurfacePair<'_>,
    state: usize,
    labels: &[u8],
) -> Vec<(usize, Vec<usize>)> {
    let mut of: BTreeMap<(u8, u32), Vec<usize>> = BTreeMap::new();
    for (i, label) in labels.iter().enumerate() {
        of.entry((*label, pair.sheet_of(state, i))).or_default().push(i);
    }
    of.into_iter().map(|((label, _), samples)| (usize::from(label), samples)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate at `x_m`, facing x.
    fn plate(x_m: f64) -> SurfaceSamples {
        let points: Vec<Point3<f64>> =
            (0..100).map(|i| Point3::new(x_m, 0.01 * (i % 10) as f64, 0.01 * (i / 10) as f64)).collect();
        SurfaceSamples {
            normals: vec![Vector3::x(); points.len()],
            colors: vec![[0.5; 3]; points.len()],
            points,
        }
    }

    #[test]
    fn a_front_pushed_in_does_not_pass_through_another() {
        let before = plate(0.1);
        let after = plate(0.0);
        let pair = SurfacePair::new([&before, &after], [None, None], 0.03);
        let own = Pose::translation(-0.1, 0.0, 0.0);
        let labels = [vec![1; 100], vec![1; 100]];
        let all = segments_of(&pair, &[Pose::identity(), own], &labels);
        assert!(all.len() == 1 && all[0].samples.iter().all(|s| s.len() == 100));
        let crosses = |first: Pose, second: Pose| all[0].crosses(&pair, &first, &second);
        let still = Pose::identity();
        assert!(crosses(Pose::translation(-0.13, 0.0, 0.0), still));
        // Stopped before it, gone past it, and after it went the same way.
        assert!(!crosses(Pose::translation(-0.07, 0.0, 0.0), still));
        assert!(!crosses(Pose::translation(-0.13, 0.5, 0.0), still));
        assert!(!crosses(Pose::translation(-0.13, 0.0, 0.0), Pose::translation(-0.12, 0.0, 0.0)));
    }
}
