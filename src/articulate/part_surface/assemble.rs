//! One surface per part from all states: each state's field is moved by the part's motion.
//!
//! The published method cuts a part out of one state's TSDF by setting it to `+1` where the label is another
//! part's. Here the states vote together: a drawer gets its inside from the open state.

use std::ops::{Range, RangeInclusive};

use nalgebra::Point3;
use rayon::prelude::*;

use geometry::{Grid3, Pose};

/// Places outside a grid by up to this, in spacings, count as on its border.
/// derived: half a spacing; the rest is rounding
const OUTSIDE: f64 = 0.51;
/// Least weight of a vote.
/// chosen: nothing against an observation; the mean stays finite
const LEAST_WEIGHT: f32 = 1e-3;

/// The surface of one state, with a part label for every place near it.
pub struct LabelledState {
    /// Truncated signed distance, meters; NaN where nothing was observed.
    pub tsdf: Grid3<f32>,
    /// Weight of the observation at the same nodes.
    pub weight: Grid3<f32>,
    /// Part of the nearest surface at the same nodes; [`NO_LABEL`] away from every surface.
    pub labels: Grid3<u8>,
    /// Truncation distance, meters.
    pub truncation_m: f64,
    /// What is known in each block of cells, x fastest.
    blocks: Grid3<Known>,
}

/// Marks a node away from every surface.
pub const NO_LABEL: u8 = u8::MAX;

/// Cells along a side of a block.
const BLOCK: usize = 4;

/// What a state knows about a piece of space.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Known {
    /// Whether something was observed in it, and (`all`) whether all of it was.
    some: bool,
    all: bool,
    /// Parts of the nodes in it, as a bit set: see [`label_bit`].
    labels: u64,
}

impl Known {
    /// What is known of no place at all: the start of a union.
    const NO_PLACE: Self = Self { some: false, all: true, labels: 0 };

    fn and(self, other: Self) -> Self {
        let Self { some, all, labels } = other;
        Self { some: self.some | some, all: self.all & all, labels: self.labels | labels }
    }
}

/// The bit of a part, modulo 64.
fn label_bit(part: u8) -> u64 {
    1 << (part % 64)
}

impl LabelledState {
    /// Builds a state from distances, weights and labels, all at the same nodes.
    pub fn new(tsdf: Grid3<f32>, weight: Grid3<f32>, labels: Grid3<u8>, truncation_m: f64) -> Self {
        let dims = tsdf.dims.map(|n| n.saturating_sub(1).div_ceil(BLOCK).max(1));
        let origin = tsdf.origin;
        let spacing_m = tsdf.spacing_m * BLOCK as f64;
        let blocks = Grid3 { origin, spacing_m, dims, values: Vec::new() };
        let values = (0..dims.iter().product())
            .into_par_iter()
            .map(|block| known_of_block(&tsdf, &labels, blocks.coordinates(block)))
            .collect();
        let blocks = Grid3 { values, ..blocks };
        Self { tsdf, weight, labels, truncation_m, blocks }
    }

    /// What is known of all places within `radius_m` of one.
    fn known_about(&self, place: &Point3<f64>, radius_m: f64) -> Known {
        let at = (place - self.tsdf.origin) / self.tsdf.spacing_m;
        let reach = radius_m / self.tsdf.spacing_m + OUTSIDE;
        let last = self.tsdf.dims.map(|n| n.saturating_sub(1) as f64);
        if (0..3).any(|k| at[k] + reach < 0.0 || at[k] - reach > last[k]) {
            return Known { all: false, ..Known::NO_PLACE };
        }
        let blocks: [RangeInclusive<usize>; 3] = [0, 1, 2].map(|k| {
            let [first, last] = [at[k] - reach, at[k] + reach]
                .map(|x| (x.max(0.0) as usize / BLOCK).min(self.blocks.dims[k] - 1));
            first..=last
        });
        let [xs, ys, zs] = blocks;
        let rows = zs.flat_map(|z| ys.clone().map(move |y| (y, z)));
        let all = rows.flat_map(|(y, z)| {
            let row = self.blocks.index(0, y, z);
            &self.blocks.values[row + xs.start()..=row + xs.end()]
        });
        let known = all.copied().fold(Known::NO_PLACE, Known::and);
        let is_inside = (0..3).all(|k| at[k] - reach >= 0.0 && at[k] + reach <= last[k]);
        Known { all: known.all && is_inside, ..known }
    }
}

/// What is known of one block of cells, by its coordinates.
fn known_of_block(tsdf: &Grid3<f32>, labels: &Grid3<u8>, block: [usize; 3]) -> Known {
    // The last nodes of a cell are the first of the next one.
    let [xs, ys, zs] = [0, 1, 2].map(|k| BLOCK * block[k]..(BLOCK * (block[k] + 1) + 1).min(tsdf.dims[k]));
    let mut known = Known::NO_PLACE;
    for (y, z) in zs.flat_map(|z| ys.clone().map(move |y| (y, z))) {
        let row = tsdf.index(xs.start, y, z)..tsdf.index(xs.end, y, z);
        for (distance, label) in tsdf.values[row.clone()].iter().zip(&labels.values[row]) {
            let is_seen = !distance.is_nan();
            let labels = if *label == NO_LABEL { 0 } else { label_bit(*label) };
            known = known.and(Known { some: is_seen, all: is_seen, labels });
        }
    }
    known
}

/// The ranges of `n` nodes in blocks.
fn block_ranges(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n).step_by(BLOCK).map(move |start| start..(start + BLOCK).min(n))
}

/// Truncated signed distance of a part in the world, as it is in state 0, meters; NaN where no state votes.
/// `motions` take the part from state 0 to each of the `states`; the first is the identity.
pub fn part_tsdf(part: u8, motions: &[Pose], states: &[LabelledState]) -> Grid3<f32> {
    let Grid3 { origin, spacing_m, dims, .. } = states[0].tsdf;
    let mut out = Grid3 { origin, spacing_m, dims, values: vec![f32::NAN; dims.iter().product()] };
    let [nx, ny, nz] = dims;
    let template = &states[0].tsdf;
    let free = states[0].truncation_m as f32;
    out.values.par_chunks_mut((nx * ny * BLOCK).max(1)).enumerate().for_each(|(slab, values)| {
        let layers = slab * BLOCK..((slab + 1) * BLOCK).min(nz);
        for (lines, columns) in
            block_ranges(ny).flat_map(|lines| block_ranges(nx).map(move |c| (lines.clone(), c)))
        {
            let ends = [&columns, &lines, &layers];
            let [low, high] = [ends.map(|r| r.start), ends.map(|r| r.end - 1)]
                .map(|[x, y, z]| template.node_position(x, y, z));
            let middle = nalgebra::center(&low, &high);
            let radius_m = 0.5 * (high - low).norm();
            let mut some = false;
            let mut all = false;
            let mut labels = 0;
            for (motion, state) in motions.iter().zip(states) {
                let known = state.known_about(&(motion * middle), radius_m);
                (some, all, labels) = (some | known.some, all | known.all, labels | known.labels);
            }
            if !some {
                continue;
            }
            // Where everything is known and no state has its label, the part is elsewhere.
            let is_elsewhere = all && labels & label_bit(part) == 0;
            for (z, y) in layers.clone().flat_map(|z| lines.clone().map(move |y| (z, y))) {
                for x in columns.clone() {
                    let value = &mut values[((z - layers.start) * ny + y) * nx + x];
                    *value = if is_elsewhere {
                        free
                    } else {
                        vote_of_states(part, &template.node_position(x, y, z), motions, states)
                    };
                }
            }
        }
    });
    out
}

/// Weighted mean of the votes of all states for one place. See docs/method.md (9.1).
fn vote_of_states(part: u8, place: &Point3<f64>, motions: &[Pose], states: &[LabelledState]) -> f32 {
    let mut sum = 0.0;
    let mut weight = 0.0;
    let mut elsewhere = None::<f32>;
    for (k, (motion, state)) in motions.iter().zip(states).enumerate() {
        // State 0 is not moved: even the identity would round.
        let place = if k == 0 { *place } else { motion * place };
        let Some(node) = state.tsdf.nearest_node(&place) else { continue };
        let distance = state.tsdf.value_at(&place);
        // No vote where nothing was observed, so no surface is invented.
        if !distance.is_finite() {
            continue;
        }
        let free = state.truncation_m as f32;
        let label = state.labels.values[node];
        let w = state.weight.values[node].max(LEAST_WEIGHT);
        if label == part {
            sum += w * distance;
            weight += w;
        // This state saw it empty: the part is not here.
        } else if label == NO_LABEL || distance > 0.5 * free {
            sum += w * free;
            weight += w;
        } else {
            // Another part is here and may hide this one: it votes only if no state has a better vote.
            elsewhere = Some(free);
        }
    }
    if weight > 0.0 { sum / weight } else { elsewhere.unwrap_or(f32::NAN) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::SceneBox;

    /// Two slabs normal to z: part 0 at z < -0.2, part 1 at z < 0 in state 0 and z < 0.1 in state 1.
    fn state(top: f64, seen_below: bool) -> LabelledState {
        let scene = SceneBox::around_box(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5));
        let mut tsdf = Grid3::over_scene(&scene, 61, f32::NAN);
        let mut labels = Grid3::over_scene(&scene, 61, NO_LABEL);
        for i in 0..tsdf.values.len() {
            let p = tsdf.position_of_index(i);
            let d = if p.x > 0.0 { p.z - top } else { p.z + 0.2 };
            if d > -0.08 && (seen_below || p.x > 0.0) {
                tsdf.values[i] = d.min(0.08) as f32;
            }
            if d.abs() < 0.08 {
                labels.values[i] = u8::from(p.x > 0.0);
            }
        }
        LabelledState::new(tsdf, Grid3::over_scene(&scene, 61, 1.0), labels, 0.08)
    }

    #[test]
    fn each_part_gets_its_own_surface_from_the_state_that_saw_it() {
        let states = [state(0.0, false), state(0.1, true)];
        let moved = part_tsdf(1, &[Pose::identity(), Pose::translation(0.0, 0.0, 0.1)], &states);
        let at = |g: &Grid3<f32>, x: f64, z: f64| g.value_at(&Point3::new(x, 0.0, z));
        assert!(at(&moved, 0.3, 0.03) > 0.02 && at(&moved, 0.3, -0.03) < -0.02);
        assert!(at(&moved, -0.3, 0.03) > 0.0, "free space of the other part");
        let still = part_tsdf(0, &[Pose::identity(); 2], &states);
        assert!(at(&still, -0.3, -0.17) > 0.02 && at(&still, -0.3, -0.23) < -0.02, "seen in state 1 only");
        assert!(at(&still, 0.3, 0.05) > 0.0);
    }

    #[test]
    fn blocks_say_what_their_places_do_one_by_one() {
        let states = [state(0.0, false), state(0.1, true)];
        let turned =
            Pose::new(nalgebra::Vector3::new(0.05, 0.02, 0.08), nalgebra::Vector3::new(0.1, 0.3, 0.2));
        for (part, motion) in [(0, Pose::identity()), (1, Pose::translation(0.0, 0.0, 0.1)), (1, turned)] {
            let motions = [Pose::identity(), motion];
            let field = part_tsdf(part, &motions, &states);
            let mut empty = 0;
            let mut nothing = 0;
            for (i, found) in field.values.iter().enumerate() {
                let alone = vote_of_states(part, &field.position_of_index(i), &motions, &states);
                // Empty space is said at once, not as the mean of votes for it.
                assert!(
                    (found - alone).abs() < 1e-7 || (found.is_nan() && alone.is_nan()),
                    "{found} {alone}"
                );
                empty += usize::from(*found == 0.08);
                nothing += usize::from(found.is_nan());
            }
            assert!(empty > 10_000 && nothing > 1000, "{empty} {nothing}");
        }
    }
}
