//! Which motion of a set every surface sample follows.

use crate::articulate::pair::surface_pair::SurfacePair;
use crate::geometry::Pose;

/// Labels and costs of both states.
pub(crate) type Labeling = ([Vec<u8>; 2], [Vec<f32>; 2]);

/// Labels and costs of both states under a set of motions that is still sought.
pub(crate) fn label(surfaces: &SurfacePair<'_>, motions: &[Pose]) -> Labeling {
    twice(surfaces, motions.len(), |s, others| surfaces.costs(s, motions, others))
}

/// The same under the motions of all parts: surface is of no part that was not there when its place was seen
/// empty. While motions are missing it would be handed to any that happens to be hidden there.
pub(crate) fn label_of_all(surfaces: &SurfacePair<'_>, motions: &[Pose]) -> Labeling {
    twice(surfaces, motions.len(), |s, others| surfaces.costs_ruling_out(s, motions, others))
}

/// Labels by costs of a state, once more with each state's labels known to the other: a surface belongs to
/// one part only.
fn twice(
    surfaces: &SurfacePair<'_>,
    motions: usize,
    costs: impl Fn(usize, Option<&[u8]>) -> Vec<f32>,
) -> Labeling {
    let alone = of_costs(surfaces, &[0, 1].map(|s| costs(s, None)), motions);
    let both = [0, 1].map(|s| costs(s, Some(&alone[1 - s])));
    (of_costs(surfaces, &both, motions), both)
}

fn of_costs(surfaces: &SurfacePair<'_>, costs: &[Vec<f32>; 2], motions: usize) -> [Vec<u8>; 2] {
    let one = |s: usize| surfaces.labels(s, &costs[s], motions);
    rayon::join(|| one(0), || one(1)).into()
}
