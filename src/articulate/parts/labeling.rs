//! Which motion of a set every surface sample follows.

use crate::articulate::pair::surface_pair::SurfacePair;
use crate::geometry::Pose;

/// Labels and costs of both states under a set of motions.
pub(crate) fn label(surfaces: &SurfacePair<'_>, motions: &[Pose]) -> ([Vec<u8>; 2], [Vec<f32>; 2]) {
    let alone = of_costs(surfaces, &[0, 1].map(|s| surfaces.costs(s, motions, None)), motions.len());
    // Once more with each state's labels known to the other: a surface belongs to one part only.
    let costs = [0, 1].map(|s| surfaces.costs(s, motions, Some(&alone[1 - s])));
    (of_costs(surfaces, &costs, motions.len()), costs)
}

fn of_costs(surfaces: &SurfacePair<'_>, costs: &[Vec<f32>; 2], motions: usize) -> [Vec<u8>; 2] {
    let one = |s: usize| surfaces.labels(s, &costs[s], motions);
    rayon::join(|| one(0), || one(1)).into()
}
