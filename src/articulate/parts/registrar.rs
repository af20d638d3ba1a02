//! Searches for the parts and motions of an object in two states: proposals from lifted matches, a choice
//! among them by their evidence on the surfaces, then labels and motions in turn (docs/method.md 6.10). It
//! runs step by step: the caller can stop between two steps and resume later.

use rand_core::Rng;
use serde::{Deserialize, Serialize};
use tracing::debug;

use crate::{
    observations::{LiftedMatch, SurfaceSamples},
    pair::surface_pair::{FreeSpace, SurfacePair},
    parts::{
        config::RegisterConfig,
        division::add_divided_sets,
        elimination::{Step, best_motions, elimination_steps},
        end_for_end::turned_by_hinge,
        error::RegisterError,
        exchange::exchanged_set,
        labeling::label_of_all,
        matched_pair::MatchedPair,
        part_count::{PartCount, chosen_parts},
        register::{Registration, checked_extent_m, motion_support},
        round_parts::turned_round,
        score::explained_shares,
        settle::settle_once,
    },
    propose::{
        ransac::{Proposal, proposed_motions},
        residual::propose_from_residual,
    },
    samples::spacing::reach_m,
};
use geometry::Pose;

/// Number of motions proposed by matches if the number of parts is not given, in addition to the spare ones.
const PROPOSED: usize = 8;
/// Largest distance between a moved surface point and its partner in the first rounds, as a share of the
/// object's longest side. chosen: twice [`LAST_REACH`], for rough motions
pub(crate) const FIRST_REACH: f64 = 0.03;
/// The same in the last rounds. chosen: some 6 mm of a laptop, far beyond the errors of surfaces and below
/// the size of a part
pub(crate) const LAST_REACH: f64 = 0.015;
/// Rounds in which unexplained surface proposes motions.
const RESIDUAL_ROUNDS: usize = 2;
/// Number of steps before the last rounds: proposals, residual rounds, the number of parts, hinges.
const SEARCH_STEPS: usize = 1 + RESIDUAL_ROUNDS + 2;

/// The changing state of the search: a resumed search gives bit for bit the same result as an uninterrupted
/// one.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RegistrarCheckpoint {
    done: usize,
    proposals: Vec<Proposal>,
    motions: Vec<Pose>,
    /// Motions of possible parts; unexplained surface proposes more motions on them.
    likely: Vec<Pose>,
    /// Sets of motions, from many to none.
    tried: Option<Vec<Step>>,
    count: Option<PartCount>,
}

/// Finds the rigid motions of all parts and the part of every surface sample, for a given number of parts
/// (the static one included) or for as many as the evidence supports.
pub struct Registrar<'a> {
    pair: MatchedPair<'a>,
    parts: Option<usize>,
    rounds: usize,
    state: RegistrarCheckpoint,
}

impl<'a> Registrar<'a> {
    /// Prepares the search and draws proposals from the matches. `free` says for each state whether a world
    /// point was seen empty, where known. The result depends on the order of the inputs and on the random
    /// numbers only; swapping the states inverts the motions up to noise.
    ///
    /// # Errors
    /// [`RegisterError::Input`] if the arguments make no sense.
    pub fn new(
        matches: &'a [LiftedMatch],
        samples: [&'a SurfaceSamples; 2],
        free: [Option<FreeSpace<'a>>; 2],
        parts: Option<usize>,
        config: &RegisterConfig,
        rng: &mut impl Rng,
    ) -> Result<Self, RegisterError> {
        let extent_m = checked_extent_m(&samples, parts)?;
        let wanted = parts.map_or(PROPOSED, |p| p - 1);
        // Motions proposed by matches need a reach wide enough for rough ones (docs/method.md 6.10).
        let coarse = SurfacePair::new(samples, free, reach_m(samples, FIRST_REACH * extent_m));
        let pair = MatchedPair::new(matches, extent_m, coarse);
        let proposals = proposed_motions(&pair.informative, wanted, extent_m, rng);
        for p in &proposals {
            let Proposal { support, matches, rms_m, displacement_m, .. } = p;
            debug!(support_cells = support, matches, rms_m, displacement_m, "motion proposed by matches");
        }
        let motions =
            std::iter::once(Pose::identity()).chain(proposals.iter().map(|p| p.state1_from_state0)).collect();
        let state = RegistrarCheckpoint { proposals, motions, ..RegistrarCheckpoint::default() };
        Ok(Self { pair, parts, rounds: config.rounds, state })
    }

    /// Total number of steps.
    pub fn total_steps(&self) -> usize {
        SEARCH_STEPS + self.rounds
    }

    /// Number of steps done.
    pub fn done_steps(&self) -> usize {
        self.state.done
    }

    /// Everything needed to continue.
    pub fn checkpoint(&self) -> &RegistrarCheckpoint {
        &self.state
    }

    /// Continues from a checkpoint of a search with the same inputs and settings.
    pub fn restore(&mut self, checkpoint: RegistrarCheckpoint) {
        self.state = checkpoint;
        if self.state.done >= SEARCH_STEPS {
            self.shorten_reach();
        }
    }

    /// Takes the next step of the search.
    ///
    /// # Errors
    /// [`RegisterError`] for no motion, no overlap, fewer motions than asked for, or unexplained movement.
    pub fn step(&mut self) -> Result<(), RegisterError> {
        let mut next = self.state.done + 1;
        match self.state.done {
            0 => self.settle_proposals(),
            n if n <= RESIDUAL_ROUNDS => {
                if !self.propose_more() {
                    next = RESIDUAL_ROUNDS + 1;
                }
            }
            n if n == RESIDUAL_ROUNDS + 1 => self.count_parts()?,
            n if n == RESIDUAL_ROUNDS + 2 => {
                // Parts turned end for end: the hinge decides, as their surface cannot.
                self.state.motions = turned_by_hinge(&self.pair, std::mem::take(&mut self.state.motions));
                self.shorten_reach();
            }
            done => {
                settle_once(&self.pair, &mut self.state.motions);
                debug!(round = done - SEARCH_STEPS + 1, of = self.rounds, "labels and motions settled");
            }
        }
        self.state.done = next;
        Ok(())
    }

    /// The result, once all steps are done.
    pub fn registration(self) -> Registration {
        let Self { pair, state, .. } = self;
        let RegistrarCheckpoint { motions, proposals, count, .. } = state;
        let PartCount { curve, notes, warnings, .. } = count.unwrap_or_default();
        let (labels, costs) = label_of_all(&pair.surfaces, &motions);
        let match_labels = pair.match_labels(&motions);
        let shares = explained_shares(&costs, motions.len());
        let support = (0..motions.len())
            .map(|k| motion_support(&pair, &motions[k], k as u8, &labels, &match_labels, shares[k]))
            .collect();
        Registration { motions, labels, match_labels, support, proposals, curve, notes, warnings }
    }

    /// Motions from matches come first: surface that they explain proposes nothing.
    fn settle_proposals(&mut self) {
        let mut motions = std::mem::take(&mut self.state.motions);
        for _ in 0..2 {
            settle_once(&self.pair, &mut motions);
        }
        self.state.motions = best_motions(&elimination_steps(&self.pair, motions));
        debug!(kept = self.state.motions.len() - 1, "motions by matches that stand");
        self.state.likely.clone_from(&self.state.motions);
    }

    /// Adds motions proposed by the unexplained surface; returns whether there were any.
    fn propose_more(&mut self) -> bool {
        let Self { pair, state, .. } = self;
        // Surface of an unlikely motion may propose another one.
        let more = propose_from_residual(&pair.surfaces, &state.likely, pair.extent_m);
        debug!(
            motions = more.len(),
            beside = state.likely.len() - 1,
            "motions proposed by unexplained surface"
        );
        if more.is_empty() {
            return false;
        }
        state.motions.extend(more);
        settle_once(pair, &mut state.motions);
        let further = elimination_steps(pair, state.motions.clone());
        let found = best_motions(&further);
        state.likely = exchanged_set(pair, found.clone(), &state.motions);
        state.tried =
            Some(if state.likely == found { further } else { elimination_steps(pair, state.likely.clone()) });
        true
    }

    /// Turns round parts (earlier rounds could not find their turn), divides motions once all possible ones
    /// are known, and chooses the number of parts.
    fn count_parts(&mut self) -> Result<(), RegisterError> {
        let Self { pair, state, parts, .. } = self;
        if let Some(turned) = turned_round(pair, &state.likely) {
            state.tried = Some(elimination_steps(pair, turned));
        }
        let mut tried = state.tried.take().unwrap_or_else(|| elimination_steps(pair, state.motions.clone()));
        add_divided_sets(pair, &mut tried);
        let count = chosen_parts(pair, &tried, *parts)?;
        state.motions.clone_from(&count.motions);
        state.count = Some(count);
        Ok(())
    }

    /// Shortens the reach for the last rounds, so partners that only seem to fit are dropped.
    fn shorten_reach(&mut self) {
        let SurfacePair { samples, free, .. } = self.pair.surfaces;
        let last_m = LAST_REACH * self.pair.extent_m;
        self.pair.surfaces = SurfacePair::new(samples, free, reach_m(samples, last_m));
    }
}

/// The whole search at once.
#[cfg(test)]
pub fn register(
    matches: &[LiftedMatch],
    samples: [&SurfaceSamples; 2],
    free: [Option<FreeSpace<'_>>; 2],
    parts: Option<usize>,
    config: &RegisterConfig,
    rng: &mut impl Rng,
) -> Result<Registration, RegisterError> {
    let mut search = Registrar::new(matches, samples, free, parts, config, rng)?;
    while search.done_steps() < search.total_steps() {
        search.step()?;
    }
    Ok(search.registration())
}
