//! Which of the proposed motions are parts: each must explain what no other does, measured on what it was not fitted to.
//!
//! The motion with the least evidence of its own is dropped, and the others take over what they can, until all that are
//! left have enough. Two motions of one part share their evidence, so that one of them goes first.

use serde::Serialize;

use super::{
    LiftedMatch, RegisterError,
    labeling::{FREE, HIDDEN},
    ransac::CellCounter,
    register::{Run, occupied_cells},
    residual::unexplained,
};
use crate::geometry::Pose;

/// Log likelihood that a landing at the edge of the reach loses against a perfect one.
const NATS: f64 = 3.0;
/// Minus the log of the share of a surface that the other state does not show: a quarter.
const UNSEEN: f64 = 1.4;
/// Minus the log of the share of a surface that lies, by errors of depth and pose, in space seen empty: one in fifty.
const CONTRADICTED: f64 = 3.9;
/// Weight of a cell of explained surface against one with a match: a match to a wrong place is caught by its distance in
/// three dimensions and its look, a wrong surface by its distance in one.
const SURFACE_WEIGHT: f64 = 0.16;
/// Cells of matches that say nothing: so many of a few hundred wrong ones follow the best of all motions by chance. Three
/// fix the motion, and where one in a thousand lands in the gate, six or seven of 300 are expected on some motion of the
/// 300^3 / 6 (number of false alarms, Moisan and Stival 2004).
const CHANCE: f64 = 5.0;
/// Most that surface counts for a motion without matches, cells.
const SURFACE_ALONE: f64 = 10.0;
/// Motions with less evidence than this many times the least are said to rest on little.
const LITTLE: f64 = 1.5;
/// Motions that were dropped with more than this share of the least evidence are told.
const NEARLY: f64 = 0.7;
/// A motion that is left out because the number of parts was given, and has this many times the least evidence, is told.
const SPARE: f64 = 3.0;
/// Share of the surface that may move unexplained.
const UNEXPLAINED_SHARE: f64 = 0.02;

/// Evidence for a number of parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EvidencePoint {
    /// Number of parts, the static one included.
    pub parts: usize,
    /// What the motions explain together: cells of matches, and a sixth of the cells of surface.
    pub evidence: f64,
    /// The same less the evidence that every moving part must bring.
    pub penalised: f64,
    /// Evidence of the weakest motion and no other; none where nothing moves.
    pub weakest: Option<f64>,
}

/// The motions that are parts.
pub(super) struct PartCount {
    pub motions: Vec<Pose>,
    pub curve: Vec<EvidencePoint>,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

impl Run<'_> {
    /// Drops the motion that least speaks for until enough speaks for all, and, where their number is given, no more than
    /// `parts` are left. The others are refitted to what they take over.
    pub fn choose(&self, mut motions: Vec<Pose>, parts: Option<usize>) -> Result<PartCount, RegisterError> {
        let (mut curve, mut notes, mut warnings) = (Vec::<EvidencePoint>::new(), Vec::new(), Vec::new());
        loop {
            let before = motions.len();
            self.thin(&mut motions, parts, &mut curve, &mut warnings);
            if motions.len() < before {
                self.round(&mut motions);
                continue;
            }
            // Once more where a surface belongs to one part only.
            let (labels, costs) = self.labels(&motions);
            let shares = self.shares(&costs, &labels, motions.len());
            let scores = self.scores(&motions, &shares);
            let weakest = (1..motions.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
            let chosen = self.point(&motions, &costs, weakest.map(|k| scores[k]));
            let least = self.config.least_score;
            let Some(k) = weakest.filter(|&k| scores[k] < least) else {
                self.check(&motions, parts, &shares, &mut notes)?;
                if let Some(k) = weakest.filter(|&k| parts.is_none() && scores[k] < LITTLE * least) {
                    warnings.push(format!("part {k} rests on little evidence: {:.0} cells of the {least} that a part needs", scores[k]));
                }
                self.thin(&mut motions.clone(), Some(1), &mut curve, &mut Vec::new());
                curve.iter_mut().filter(|p| p.parts == chosen.parts).for_each(|p| *p = chosen.clone());
                return Ok(PartCount { motions, curve, notes, warnings });
            };
            if parts.is_none() && scores[k] > NEARLY * least {
                notes.push(format!("a further motion has {:.1} of the {least} cells of evidence that a part needs", scores[k]));
            }
            motions.remove(k);
            self.round(&mut motions);
        }
    }

    /// Drops motions without refitting the others, the weakest first, while they are too many or too weak, and adds the
    /// evidence at every number of parts to the curve.
    fn thin(&self, motions: &mut Vec<Pose>, parts: Option<usize>, curve: &mut Vec<EvidencePoint>, warnings: &mut Vec<String>) {
        let least = self.config.least_score;
        let mut costs = [0, 1].map(|s| self.evidence.costs(s, motions, None));
        while motions.len() > 1 {
            let shares = self.shares(&costs, &cheapest(&costs, motions.len()), motions.len());
            let scores = self.scores(motions, &shares);
            let Some(k) = (1..motions.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b])) else { return };
            curve.retain(|p| p.parts > motions.len());
            curve.push(self.point(motions, &costs, Some(scores[k])));
            let many = parts.is_some_and(|p| motions.len() > p);
            if scores[k] >= least && !many {
                return;
            }
            if let Some(parts) = parts.filter(|p| *p > 1 && scores[k] > SPARE * least) {
                let percent = 100.0 * shares[k];
                warnings.push(format!(
                    "a further motion explains {percent:.1} % of the surface that no other explains; there may be more than {parts} parts"
                ));
            }
            let count = motions.len();
            motions.remove(k);
            for c in &mut costs {
                *c = c.chunks_exact(count).flat_map(|row| row.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, c)| *c)).collect();
            }
        }
        curve.push(self.point(motions, &costs, None));
    }

    /// Refuses what the motions that are left do not explain.
    fn check(&self, motions: &[Pose], parts: Option<usize>, shares: &[f64], notes: &mut Vec<String>) -> Result<(), RegisterError> {
        let static_percent = 100.0 * shares[0];
        let one = motions.len() == 1;
        if shares[0] < self.config.least_static_share {
            return Err(RegisterError::NoOverlap { static_percent });
        }
        let (found, moving) = (motions.len(), motions.len() - 1);
        match parts {
            Some(_) if one => Err(RegisterError::NoMotion { static_percent }),
            Some(asked) if asked > found => {
                let support: Vec<String> = shares.iter().skip(1).map(|s| format!("{:.1} % of the surface", 100.0 * s)).collect();
                Err(RegisterError::FewerParts { asked, found, moving, support: support.join(", ") })
            }
            _ => {
                let moved = unexplained(&self.evidence, motions);
                let of = |s: usize| moved[s].iter().filter(|m| **m).count() as f64 / moved[s].len().max(1) as f64;
                let moved_percent = 100.0 * of(0).max(of(1));
                if one && of(0).min(of(1)) > UNEXPLAINED_SHARE {
                    return Err(RegisterError::Unexplained { moved_percent });
                }
                if one {
                    notes.push(format!(
                        "no part moved: {static_percent:.0} % of the surface stands still and {moved_percent:.1} % left its place; the twin has one part"
                    ));
                }
                Ok(())
            }
        }
    }

    /// Share of the surface that each motion explains and no other.
    pub fn shares(&self, costs: &[Vec<f32>; 2], labels: &[Vec<u8>; 2], motions: usize) -> Vec<f64> {
        let patch = |s: usize| move |i: usize| self.evidence.patch(s, i);
        shares(costs, labels, [&patch(0), &patch(1)], motions)
    }

    fn point(&self, motions: &[Pose], costs: &[Vec<f32>; 2], weakest: Option<f64>) -> EvidencePoint {
        let cell_m = self.config.ransac.cell * self.extent_m;
        let explained = |s: usize| {
            let cells = occupied_cells(&self.evidence.samples[s].points, cell_m) as f64;
            let gain: f64 = costs[s].chunks_exact(motions.len()).map(|row| row.iter().map(|c| f64::from(landing(*c))).fold(1.0, f64::min)).sum();
            cells * (1.0 - gain / self.evidence.samples[s].points.len().max(1) as f64)
        };
        let matches: f64 = self.match_cells(motions).iter().skip(1).sum();
        let evidence = matches + SURFACE_WEIGHT * (explained(0) + explained(1));
        let penalised = evidence - self.config.least_score * (motions.len() - 1) as f64;
        EvidencePoint { parts: motions.len(), evidence, penalised, weakest }
    }

    /// Cells of the matches that follow each motion.
    fn match_cells(&self, motions: &[Pose]) -> Vec<f64> {
        let labels = self.match_labels(motions);
        let cell_m = self.config.ransac.cell * self.extent_m;
        let cells = |k: usize| {
            let follows = |(m, l): (&LiftedMatch, &Option<u8>)| (*l == Some(k as u8) && self.gate.has_moved(m)).then_some(*m);
            let followers: Vec<LiftedMatch> = self.matches.iter().zip(&labels).filter_map(follows).collect();
            CellCounter::new(&followers, self.gate, cell_m).support(&followers, &motions[k])
        };
        (0..motions.len()).map(cells).collect()
    }

    /// What speaks for each motion and no other, in cells: those of the matches that follow it beyond chance, and the cells of surface
    /// that it explains, which weigh less because a plane explains any other.
    fn scores(&self, motions: &[Pose], shares: &[f64]) -> Vec<f64> {
        let cell_m = self.config.ransac.cell * self.extent_m;
        let surface: usize = self.evidence.samples.iter().map(|s| occupied_cells(&s.points, cell_m)).sum();
        let score = |(cells, share): (f64, &f64)| {
            let cells = f64::max(cells - CHANCE, 0.0);
            cells + (SURFACE_WEIGHT * share * surface as f64).min(2.0 * cells + SURFACE_ALONE)
        };
        self.match_cells(motions).into_iter().zip(shares).map(score).collect()
    }
}

/// Cost of a sample where only landing on a surface counts as an explanation.
fn landing(cost: f32) -> f32 {
    if cost >= 0.9 { 1.0 } else { cost }
}

/// Minus the log likelihood of a sample by its cost under a motion, in units of a landing at the edge of the reach. A
/// landing's cost is `z^2 / 6` for a small deviation of `z` standard deviations, whose log likelihood is `-z^2 / 2`.
fn surprise(cost: f32) -> f64 {
    if cost >= FREE {
        CONTRADICTED / NATS
    } else if cost >= HIDDEN {
        UNSEEN / NATS
    } else {
        f64::from(cost)
    }
}

/// Share of the samples that each motion explains and no other: the rise of their surprise, patch by patch, if each patch
/// that follows the motion followed the best of the others, as a share of the surprise of as many lost landings. That a
/// patch was hidden in the other state explains it too, if not well.
fn shares(costs: &[Vec<f32>; 2], labels: &[Vec<u8>; 2], patches: [&dyn Fn(usize) -> u32; 2], motions: usize) -> Vec<f64> {
    let mut gains = vec![0.0; motions];
    for s in 0..2 {
        let mut of: Vec<(u8, u32, usize)> = labels[s].iter().enumerate().map(|(i, l)| (*l, patches[s](i), i)).collect();
        of.sort_unstable();
        for group in of.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let own = usize::from(group[0].0);
            let total = |k: usize| group.iter().map(|g| surprise(costs[s][g.2 * motions + k])).sum::<f64>();
            let alone = group.len() as f64 * CONTRADICTED / NATS;
            let other = (0..motions).filter(|k| *k != own).map(total).fold(alone, f64::min);
            gains[own] += (other - total(own)).max(0.0);
        }
    }
    let count = labels.iter().map(Vec::len).sum::<usize>();
    gains.into_iter().map(|g| g / count.max(1) as f64).collect()
}

/// The cheapest motion of every sample.
fn cheapest(costs: &[Vec<f32>; 2], motions: usize) -> [Vec<u8>; 2] {
    let best = |row: &[f32]| (1..motions).fold(0, |best, k| if row[k] < row[best] { k } else { best }) as u8;
    [0, 1].map(|s| costs[s].chunks_exact(motions).map(best).collect())
}

#[cfg(test)]
#[path = "part_count_tests.rs"]
mod tests;
