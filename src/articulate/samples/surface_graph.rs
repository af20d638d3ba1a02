//! Joins samples of a surface to their neighbors on it, and smooths labels over them.

use rayon::prelude::*;

use crate::{
    observations::SurfaceSamples,
    samples::{
        flat_patch::flat_patches,
        place_costs::{ALL_FREE, HIDDEN},
        sample_index::SampleIndex,
    },
};
use numeric::{index_sets::IndexSets, lists::Lists};

/// Number of neighbors of a sample.
const NEIGHBORS: usize = 8;
/// Number of labels in one vector register.
const LANES: usize = 4;
/// Rounds of mean-field smoothing.
const ROUNDS: usize = 15;
/// Changes of a sample's probabilities below this are not passed to its neighbors in the same round.
///
/// derived: over all rounds such changes sum to less than [`FILL_CHANGE`]
const SMOOTHING_STEP: f32 = FILL_CHANGE / ROUNDS as f32;
/// Cost of a neighborhood that disagrees entirely; a missing surface costs 1.
///
/// tuned: shared/bags
const SMOOTHNESS: f32 = 0.8;
/// Softness of the labels while smoothing.
///
/// tuned: shared/bags
const TEMPERATURE: f32 = 0.12;
/// A sample whose costs differ by less than this is no evidence.
///
/// derived: odds of two to one at the temperature of the labels
const EVIDENCE: f32 = TEMPERATURE * std::f32::consts::LN_2;
/// Cost from which a label is ruled out, whatever is around, if another label at worst hides the sample: its
/// motion takes the sample to a place seen empty all around.
///
/// derived: the cost of such places (docs/method.md 6.2)
const EMPTY: f32 = ALL_FREE - 1e-4;
/// Largest cost of the best label with which another label can be ruled out.
///
/// derived: the cost of hidden places (docs/method.md 6.2)
const HIDDEN_AT_WORST: f32 = HIDDEN + 1e-4;
/// An island does not get a label that more than this share of its samples rule out.
///
/// derived: where one in fifty of the label's own samples and one in two of others' makes even odds
const RULED_OUT_SHARE: f32 = 0.17;
/// Largest number of rounds of the random walk of labels along the surface.
const FILL_ROUNDS: usize = 60;
/// The rounds end once no probability changes by more than this.
///
/// chosen: a thousandth of a share decides no label
const FILL_CHANGE: f32 = 1e-3;
/// Changes of a sample's probabilities below this are not passed to its neighbors.
///
/// derived: over all rounds such changes sum to less than [`FILL_CHANGE`]
const FILL_STEP: f32 = FILL_CHANGE / FILL_ROUNDS as f32;
/// Weight of a sample's own evidence relative to its neighbors while filling, at a cost difference of 1.
///
/// tuned: shared/bags
const OWN_PULL: f32 = 4.0;
/// An island joins its surroundings if its evidence is less than this share of that of its label's largest
/// component.
///
/// tuned: shared/bags
const ISLAND_SHARE: f32 = 0.02;

/// Standard deviation of a surface's normals (length of their difference, or slope of an offset from a
/// tangent plane).
///
/// tuned: shared/bags
pub(crate) const NORMAL_SIGMA: f64 = 0.35;
/// Least cosine between normals of one plane.
///
/// derived: unit vectors with a difference of [`NORMAL_SIGMA`]
pub(crate) const SAME_NORMAL: f64 = 1.0 - 0.5 * NORMAL_SIGMA * NORMAL_SIGMA;
/// Weight of the squared change of the normal in the distance of neighbors, in squared reaches.
///
/// chosen: neighbors across a right angle are nearly half a reach farther
const CREASE: f64 = 0.1;
/// Weight of the squared offset from the tangent planes relative to the squared offset along them.
///
/// derived: in standard deviations of a normal, the mean over both planes
const LIFT: f64 = 0.5 / (NORMAL_SIGMA * NORMAL_SIGMA);
/// A face belongs to one part if its evidence for all others is less than this share of its evidence for the
/// part.
///
/// tuned: shared/bags
const FACE_DISSENT: f32 = 0.2;
/// Weight of a sheet's label for its samples while parts are missing: their surface would otherwise go to
/// other parts in pieces.
///
/// chosen: as much as all neighbors of the sample together
const SHEET_PULL: f32 = 1.0;
/// Weight of a face's label for its samples without evidence: within about three samples of evidence the
/// random walk decides, as two parts may lie in one plane.
///
/// measured: from 0.01 to 0.1 labels of bags/drawer and of two of shared/bags are equally right
const FACE_PULL: f32 = 0.03;

/// Which parts the labels stand for.
#[derive(Clone, Copy)]
pub(crate) enum Of {
    /// Some parts may be missing.
    SomeParts,
    /// All parts are known.
    AllParts,
}

/// Samples of a surface and their neighbors on it.
pub(crate) struct SurfaceGraph {
    /// Neighbors of every sample, with weights that sum to 1; unused slots refer to the sample itself with
    /// weight 0.
    neighbors: Vec<[(u32, f32); NEIGHBORS]>,
    /// For every sample, the samples that have it as a neighbor.
    neighbor_of: Lists<u32>,
    /// Index of the smooth sheet of every sample.
    sheets: Vec<u32>,
    /// Index of the flat patch of every sample.
    patches: Vec<u32>,
}

impl SurfaceGraph {
    /// Joins every sample to the nearest ones within `reach_m`. Samples on the same tangent plane weigh more
    /// than samples beyond a crease or on a parallel surface.
    pub(crate) fn new(samples: &SurfaceSamples, index: &SampleIndex<'_>, reach_m: f64) -> Self {
        let neighbors: Vec<_> = (0..samples.points.len())
            .into_par_iter()
            .map(|i| neighbors_of(i, samples, index, reach_m))
            .collect();
        let in_plane = |i: usize, j: usize| are_in_one_plane(samples, i, j);
        let sheets = component_numbers(&neighbors, in_plane);
        let patches =
            flat_patches(&samples.normals, NORMAL_SIGMA, |i| used_neighbors(&neighbors, i), in_plane);
        Self { neighbor_of: neighbor_of(&neighbors), neighbors, sheets, patches }
    }

    /// Neighbors of a sample.
    pub(crate) fn neighbors_on_surface(&self, sample: usize) -> impl Iterator<Item = usize> {
        used_neighbors(&self.neighbors, sample)
    }

    /// Index of the smooth sheet of a sample.
    pub(crate) fn sheet_of(&self, sample: usize) -> u32 {
        self.sheets[sample]
    }

    /// Probability of every label at every sample, sample-major, by mean-field smoothing of the costs.
    /// See docs/method.md (6.7).
    pub(crate) fn mean_field(&self, costs: &[f32], labels: usize) -> Vec<f32> {
        let n = self.neighbors.len();
        let quads = labels.div_ceil(LANES);
        // Labels are stored in groups of four, as vector registers hold them; unused places stay zero.
        let mut lanes = vec![[0.0f32; LANES]; n * quads];
        for (lanes, costs) in lanes.chunks_exact_mut(quads).zip(costs.chunks_exact(labels)) {
            lanes.as_flattened_mut()[..labels].copy_from_slice(costs);
        }
        let costs = lanes;
        // Equal at first, so the first round uses the costs alone.
        let mut beliefs = vec![[1.0 / labels as f32; LANES]; n * quads];
        let mut next = beliefs.clone();
        // Whether each sample changed in the last round: a sample without changed neighbors stays as it is.
        let mut changed = vec![true; n];
        let mut changes = vec![true; n];
        for _ in 0..ROUNDS {
            let rows = next.par_chunks_mut(quads).zip(&mut changes).with_min_len(512).enumerate();
            rows.for_each(|(i, (energies, changes))| {
                let before = &beliefs[i * quads..(i + 1) * quads];
                *changes = self.neighbors[i].iter().any(|(j, _)| changed[*j as usize]);
                if !*changes {
                    energies.copy_from_slice(before);
                    return;
                }
                for (quad, energy) in energies.iter_mut().enumerate() {
                    let mut sum = costs[i * quads + quad];
                    for &(j, w) in &self.neighbors[i] {
                        let belief = &beliefs[j as usize * quads + quad];
                        sum.iter_mut().zip(belief).for_each(|(e, b)| *e += SMOOTHNESS * w * (1.0 - b));
                    }
                    *energy = sum;
                }
                let energy = &mut energies.as_flattened_mut()[..labels];
                // Relative to the least energy, so no sum of exponentials underflows to zero.
                let least = energy.iter().copied().fold(f32::INFINITY, f32::min);
                energy.iter_mut().for_each(|e| *e = (-(*e - least) / TEMPERATURE).exp());
                let sum: f32 = energy.iter().sum();
                energy.iter_mut().for_each(|e| *e /= sum);
                let moved = energy.iter().zip(before.as_flattened()).map(|(e, b)| (e - b).abs());
                *changes = moved.fold(0.0, f32::max) >= SMOOTHING_STEP;
            });
            std::mem::swap(&mut beliefs, &mut next);
            std::mem::swap(&mut changed, &mut changes);
        }
        beliefs.chunks_exact(quads).flat_map(|b| &b.as_flattened()[..labels]).copied().collect()
    }

    /// Labels from a random walk to samples with evidence (Grady 2006): a sample without evidence takes the
    /// label whose evidence is reached first along the surface. See docs/method.md (6.8).
    pub(crate) fn filled_labels(
        &self,
        mut beliefs: Vec<f32>,
        costs: &[f32],
        labels: usize,
        of: Of,
    ) -> Vec<u8> {
        let n = self.neighbors.len();
        let own: Vec<f32> =
            (0..n).map(|i| OWN_PULL * label_evidence(&costs[i * labels..(i + 1) * labels])).collect();
        // Faces count before the walk, which would otherwise carry labels across a face of one part.
        let mut pull = own.clone();
        let faces: &[(&[u32], f32)] = match of {
            Of::SomeParts => &[(&self.sheets, SHEET_PULL)],
            // A patch without evidence is of the same part as its sheet.
            Of::AllParts => &[(&self.patches, FACE_PULL), (&self.sheets, FACE_PULL)],
        };
        for (faces, strength) in faces {
            pull_of_faces(faces, *strength, &own, &mut beliefs, &mut pull);
        }
        let quads = labels.div_ceil(LANES);
        let mut reached = vec![[0.0f32; LANES]; n * quads];
        let open = open_labels(costs, labels, quads);
        // The weight of every sample's own evidence by label, and the sum of all weights on it.
        let mut own = vec![[0.0f32; LANES]; n * quads];
        for ((own, beliefs), pull) in own.chunks_exact_mut(quads).zip(beliefs.chunks_exact(labels)).zip(&pull)
        {
            own.as_flattened_mut().iter_mut().zip(beliefs).for_each(|(own, b)| *own = pull * b);
        }
        let whole: Vec<f32> = pull.iter().map(|pull| 1.0 + pull).collect();
        // Whether a neighbor of a sample changed since its last update: the others stay as they are.
        let mut stirred = vec![true; n];
        for round in 0..FILL_ROUNDS {
            let mut most = 0.0f32;
            for k in 0..n {
                // Alternating directions: labels cross the surface in few rounds.
                let i = if round % 2 == 0 { k } else { n - 1 - k };
                if !std::mem::take(&mut stirred[i]) {
                    continue;
                }
                let neighbors = &self.neighbors[i];
                let mut change = [0.0f32; LANES];
                for at in i * quads..(i + 1) * quads {
                    let mut mean = own[at];
                    let quad = at - i * quads;
                    for &(j, w) in neighbors {
                        let other = &reached[j as usize * quads + quad];
                        mean.iter_mut().zip(other).for_each(|(m, o)| *m += w * o);
                    }
                    let old = &mut reached[at];
                    let open = &open[at];
                    for lane in 0..LANES {
                        let new = open[lane] * mean[lane] / whole[i];
                        change[lane] = change[lane].max((new - old[lane]).abs());
                        old[lane] = new;
                    }
                }
                let change = change.into_iter().fold(0.0, f32::max);
                if change >= FILL_STEP {
                    self.neighbor_of.list_at(i as u32).iter().for_each(|&j| stirred[j as usize] = true);
                }
                most = most.max(change);
            }
            if most < FILL_CHANGE {
                break;
            }
        }
        let rows = reached.chunks_exact(quads).zip(beliefs.chunks_exact(labels));
        rows.map(|(row, beliefs)| {
            let row = &row.as_flattened()[..labels];
            let reached = first_largest(row);
            // A sample that no label reaches keeps the smoothed label of its neighborhood.
            (if row[reached] > 0.0 { reached } else { first_largest(beliefs) }) as u8
        })
        .collect()
    }

    /// Joins islands to the label around them (static if there is none), unless their evidence is against it.
    /// An island is a component of a label with little evidence, apart from the label's largest component.
    pub(crate) fn join_islands(&self, labels: &mut [u8], costs: &[f32], motions: usize) {
        let components = component_numbers(&self.neighbors, |i, j| labels[i] == labels[j]);
        let count = components.iter().max().map_or(0, |m| *m as usize + 1);
        let mut strength = vec![0.0f32; count];
        let mut label = vec![0u8; count];
        let mut around = vec![0.0f32; count * motions];
        let mut against = vec![0.0f32; count * motions];
        let mut size = vec![0.0f32; count];
        for (i, &component) in components.iter().enumerate() {
            let component = component as usize;
            let own = &costs[i * motions..(i + 1) * motions];
            // An island's evidence is how much its label costs less than the next best.
            let rival = (0..motions)
                .filter(|k| *k != usize::from(labels[i]))
                .map(|k| own[k])
                .fold(f32::INFINITY, f32::min);
            let taken = own[usize::from(labels[i])];
            strength[component] += (rival - taken).clamp(0.0, 1.0);
            label[component] = labels[i];
            size[component] += 1.0;
            for k in 0..motions {
                against[component * motions + k] += f32::from(u8::from(is_ruled_out(own, k)));
            }
            for &(j, w) in &self.neighbors[i] {
                if labels[j as usize] != labels[i] {
                    around[component * motions + usize::from(labels[j as usize])] += w;
                }
            }
        }
        let mut largest = vec![0.0f32; motions];
        for (component, &s) in strength.iter().enumerate() {
            let l = usize::from(label[component]);
            largest[l] = largest[l].max(s);
        }
        // The updated label of each component.
        let mut joined = label.clone();
        for component in 0..count {
            if strength[component] >= ISLAND_SHARE * largest[usize::from(label[component])] {
                continue;
            }
            let row = component * motions..(component + 1) * motions;
            let around = &around[row.clone()];
            let against = &against[row];
            let most_against = RULED_OUT_SHARE * size[component];
            let nearest = (0..motions)
                .filter(|k| against[*k] < most_against)
                .reduce(|best, k| if around[k] > around[best] { k } else { best });
            // An island with none of these around it is static, unless static is ruled out as well.
            if let Some(k) = nearest.filter(|k| around[*k] > 0.0 || *k == 0) {
                joined[component] = k as u8;
            }
        }
        labels.iter_mut().zip(&components).for_each(|(l, c)| *l = joined[*c as usize]);
    }
}

/// Index of the largest value, the first of equal ones; 0 for an empty list.
fn first_largest(values: &[f32]) -> usize {
    (1..values.len()).fold(0, |best, k| if values[k] > values[best] { k } else { best })
}

/// Gives samples without evidence the label of their face if all its evidence is for one label and no other
/// face has done so. `own` is the weight of each sample's own evidence, `faces` the index of its face,
/// `strength` the weight of faces.
fn pull_of_faces(faces: &[u32], strength: f32, own: &[f32], beliefs: &mut [f32], pull: &mut [f32]) {
    let labels = beliefs.len() / faces.len().max(1);
    let count = faces.iter().max().map_or(0, |m| *m as usize + 1);
    let mut votes = vec![0.0f32; count * labels];
    for (i, &face) in faces.iter().enumerate() {
        for k in 0..labels {
            votes[face as usize * labels + k] += own[i] * beliefs[i * labels + k];
        }
    }
    for (i, &face) in faces.iter().enumerate() {
        let votes = &votes[face as usize * labels..(face as usize + 1) * labels];
        // Equal votes go to the smallest label; the static part is the first.
        let top = first_largest(votes);
        let dissent = votes.iter().sum::<f32>() - votes[top];
        if pull[i] == 0.0 && votes[top] > 0.0 && dissent < FACE_DISSENT * votes[top] {
            pull[i] = strength;
            (0..labels).for_each(|k| beliefs[i * labels + k] = f32::from(u8::from(k == top)));
        }
    }
}

/// For every label of every sample 1, or 0 if it is ruled out, in groups of four.
fn open_labels(costs: &[f32], labels: usize, quads: usize) -> Vec<[f32; LANES]> {
    let mut open = vec![[0.0f32; LANES]; costs.len() / labels * quads];
    for (row, own) in open.chunks_exact_mut(quads).zip(costs.chunks_exact(labels)) {
        let lanes = row.as_flattened_mut().iter_mut().take(labels);
        lanes.enumerate().for_each(|(k, open)| *open = f32::from(u8::from(!is_ruled_out(own, k))));
    }
    open
}

/// Whether a label's motion takes a sample with these costs to a place seen empty, and another label's does
/// not.
fn is_ruled_out(costs: &[f32], label: usize) -> bool {
    costs[label] >= EMPTY && costs.iter().any(|c| *c <= HIDDEN_AT_WORST)
}

/// Neighbors of a sample, without unused slots.
fn used_neighbors(
    neighbors: &[[(u32, f32); NEIGHBORS]],
    sample: usize,
) -> impl Iterator<Item = usize> + Clone {
    neighbors[sample].iter().filter(|n| n.1 > 0.0).map(|n| n.0 as usize)
}

/// For every sample, the samples that have it as a neighbor.
fn neighbor_of(neighbors: &[[(u32, f32); NEIGHBORS]]) -> Lists<u32> {
    let pairs =
        (0..neighbors.len()).flat_map(|i| used_neighbors(neighbors, i).map(move |j| (j as u32, i as u32)));
    Lists::of_entries(neighbors.len(), pairs)
}

/// The nearest neighbors of a sample, with weights that sum to 1.
fn neighbors_of(
    i: usize,
    samples: &SurfaceSamples,
    index: &SampleIndex<'_>,
    reach_m: f64,
) -> [(u32, f32); NEIGHBORS] {
    let mut near: Vec<(f64, u32)> = Vec::new();
    index.visit_around(&samples.points[i], |j, place| {
        let offset = place - samples.points[i];
        let squared = offset.norm_squared();
        if j != i && squared < reach_m * reach_m {
            let bend = (samples.normals[j] - samples.normals[i]).norm_squared();
            let lift = samples.normals[i].dot(&offset).powi(2) + samples.normals[j].dot(&offset).powi(2);
            // The distance of docs/method.md (6.6), which is larger beyond a crease or across a gap.
            near.push((squared + LIFT * lift + CREASE * reach_m * reach_m * bend, j as u32));
        }
    });
    // Equal distances are ordered by index, so the neighbors do not depend on the sort.
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut slots = [(i as u32, 0.0); NEIGHBORS];
    let weight = |squared: f64| (-2.0 * squared / (reach_m * reach_m)).exp() as f32;
    let sum: f32 = near.iter().take(NEIGHBORS).map(|n| weight(n.0)).sum();
    for (slot, n) in slots.iter_mut().zip(&near) {
        *slot = (n.1, weight(n.0) / sum.max(1e-12));
    }
    slots
}

/// Whether two neighbors are in one plane.
fn are_in_one_plane(samples: &SurfaceSamples, i: usize, j: usize) -> bool {
    let offset = samples.points[j] - samples.points[i];
    let lift = samples.normals[i].dot(&offset).abs().max(samples.normals[j].dot(&offset).abs());
    // On a bent surface, the slope of the offset is as large as the difference of the normals.
    (samples.normals[j] - samples.normals[i]).norm() < NORMAL_SIGMA && lift < NORMAL_SIGMA * offset.norm()
}

/// Index of the connected component of each sample, over pairs of neighbors for which `joined` holds.
fn component_numbers(
    neighbors: &[[(u32, f32); NEIGHBORS]],
    joined: impl Fn(usize, usize) -> bool,
) -> Vec<u32> {
    let mut sets = IndexSets::new(neighbors.len());
    for (i, slots) in neighbors.iter().enumerate() {
        for &(j, w) in slots {
            if w > 0.0 && joined(i, j as usize) {
                sets.join(i, j as usize);
            }
        }
    }
    let mut number = vec![0; neighbors.len()];
    let mut count = 0;
    for i in 0..neighbors.len() {
        let root = sets.root_of(i);
        // A root precedes the rest of its set.
        if root == i {
            number[i] = count;
            count += 1;
        } else {
            number[i] = number[root];
        }
    }
    number
}

/// How far the best cost is below the second best, less [`EVIDENCE`], from 0 to 1.
fn label_evidence(costs: &[f32]) -> f32 {
    let (best, second) = costs.iter().fold((f32::INFINITY, f32::INFINITY), |(best, second), &c| {
        if c < best { (c, best) } else { (best, second.min(c)) }
    });
    if second.is_finite() { (second - best - EVIDENCE).clamp(0.0, 1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples in a row, each joined to the next, broken after the fourth.
    fn chain() -> SurfaceGraph {
        let slots = |i: u32| {
            let mut slots = [(i, 0.0); NEIGHBORS];
            let (first, last) = if i < 4 { (0, 3) } else { (4, 5) };
            slots[0] = (i.saturating_sub(1).max(first), 0.5);
            slots[1] = ((i + 1).min(last), 0.5);
            slots
        };
        let neighbors: Vec<_> = (0..6).map(slots).collect();
        SurfaceGraph {
            neighbor_of: neighbor_of(&neighbors),
            neighbors,
            sheets: (0..6).collect(),
            patches: (0..6).collect(),
        }
    }

    #[test]
    fn samples_without_evidence_take_the_nearest_label_along_the_surface() {
        let hidden = [0.9, 0.9, 0.9];
        let costs = [[0.9, 0.9, 0.0], hidden, hidden, [0.9, 0.0, 0.9], hidden, hidden].concat();
        let graph = chain();
        assert_eq!(
            graph.filled_labels(graph.mean_field(&costs, 3), &costs, 3, Of::AllParts),
            vec![2, 2, 1, 1, 0, 0]
        );
    }

    #[test]
    fn labels_do_not_cross_to_samples_that_rule_them_out() {
        // The third and fourth are hidden under the last two motions and in empty space under the first.
        let free = [1.61, 0.9, 0.9];
        let costs = [[0.9, 0.0, 0.9], [0.9; 3], free, free, [0.0, 0.9, 0.9], [0.9; 3]].concat();
        let graph = chain();
        assert_eq!(
            graph.filled_labels(graph.mean_field(&costs, 3), &costs, 3, Of::AllParts),
            vec![1, 1, 1, 1, 0, 0]
        );
        // Alone among what they rule out they stay what they are.
        let costs = [[0.0, 0.9, 0.9], [0.9; 3], free, free, [0.0, 0.9, 0.9], [0.9; 3]].concat();
        let mut labels = graph.filled_labels(graph.mean_field(&costs, 3), &costs, 3, Of::AllParts);
        graph.join_islands(&mut labels, &costs, 3);
        assert!(labels[2] != 0 && labels[3] == labels[2] && labels[..2] == [0, 0], "{labels:?}");
    }

    #[test]
    fn an_island_without_evidence_joins_what_surrounds_it() {
        let strong = [0.0, 0.9];
        let costs = [strong, [0.9, 0.89], strong, strong, [0.9, 0.0], [0.9, 0.0]].concat();
        let mut labels = vec![0, 1, 0, 0, 1, 1];
        chain().join_islands(&mut labels, &costs, 2);
        assert_eq!(labels, vec![0, 0, 0, 0, 1, 1]);
    }
}
