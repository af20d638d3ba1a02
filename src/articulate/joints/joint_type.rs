//! The type of the joint behind the motions of a part, chosen by the Bayesian information criterion. See
//! docs/method.md 8.6.
//!
//! Every type is a family of motions relative to the parent, fitted to the same evidence. Its score is
//! `cost + parameters * ln(independent residuals)`, where the cost excludes the share of errors that leave no
//! residual. The type with the lowest score wins; a screw must win decisively.

use crate::joints::{
    free_motion::FREEDOMS,
    joint_fit::{FreeFits, JointFit, PartPlace},
    joint_motion::{Freedom, PlacedJoint, foot_on_line},
    misfit::Misfit,
};
use model::{JointFamily, JointKind, TypeScores};

/// Least difference of two scores for a decision: very strong evidence on the scale of twice the log
/// likelihood.
///
/// chosen: the limit of very strong evidence of Kass and Raftery (1995), section 3.2
pub(crate) const DECISIVE: f64 = 10.0;

/// The best joint of every type, with the scores of all.
pub(crate) struct TypeFits {
    slide: JointFit,
    turn: Option<JointFit>,
    helix: Option<JointFit>,
    pub scores: TypeScores,
}

impl TypeFits {
    pub(crate) fn new(found: &FreeFits) -> Self {
        let slide = found.fitted_slide();
        let turn = found.fitted_turn();
        let helix = found.fitted_helix();
        // A part at rest is scored only for the report: no choice depends on it.
        let still = found.residuals.models_at(|k| found.parent_motion(k).state1_from_state0);
        let free: f64 = found.free.iter().map(|f| f.quadratic.cost).sum();
        let misfit = Misfit::new(found);
        // A free motion has six parameters in every state, a joint has one.
        let mut scores = vec![
            (JointFamily::Fixed, type_score(found, still.iter().map(|q| q.cost).sum(), 0.0)),
            (JointFamily::Free, type_score(found, free, FREEDOMS * found.free.len() as f64)),
        ];
        for fit in [Some(&slide), turn.as_ref(), helix.as_ref()].into_iter().flatten() {
            // Misfit due to errors that leave no residual does not count against a joint.
            let excess = (fit.cost() - free).max(0.0);
            let left = misfit.as_ref().map_or(excess, |m| m.unexplained_misfit(excess, fit, found));
            let cost = fit.cost() - excess + left;
            let score = type_score(found, cost, fit.joint.dimension() as f64);
            scores.push((fit.joint.freedom.family(), score + far(&fit.joint, &found.place)));
        }
        Self { slide, turn, helix, scores: scores.into_iter().collect() }
    }

    /// The joint of the best type, or of a known kind.
    pub(crate) fn chosen_fit(self, known: Option<JointKind>) -> (JointFit, TypeScores) {
        let best = match known.map_or_else(|| best_type(&self.scores), JointKind::family) {
            JointFamily::Revolute => self.turn,
            JointFamily::Screw => self.helix,
            JointFamily::Fixed | JointFamily::Free | JointFamily::Prismatic => None,
        };
        // There may be no turn even if one is asked for: none of the motions turns.
        (best.unwrap_or(self.slide), self.scores)
    }
}

fn type_score(found: &FreeFits, cost: f64, parameters: f64) -> f64 {
    cost / found.dispersion + parameters * found.count.ln()
}

/// The type of the lowest score; a screw must win decisively.
fn best_type(scores: &TypeScores) -> JointFamily {
    let [slide, turn] = [JointFamily::Prismatic, JointFamily::Revolute].map(|t| scores.score_of(t));
    // A screw explains any single motion, a slide or a turn only some.
    if scores.score_of(JointFamily::Screw) + DECISIVE < slide.min(turn) {
        JointFamily::Screw
    } else if turn < slide {
        JointFamily::Revolute
    } else {
        JointFamily::Prismatic
    }
}

/// Score of the best joint with one freedom, less that of the free motion. Any motion has a screw: it is
/// penalised as in the choice of the type, and counts only where it is `threaded`. See docs/method.md (8.15).
pub(crate) fn excess_over_free(scores: &TypeScores, threaded: bool) -> f64 {
    let screw = if threaded { scores.score_of(JointFamily::Screw) + DECISIVE } else { f64::INFINITY };
    let simple = scores.score_of(JointFamily::Prismatic).min(scores.score_of(JointFamily::Revolute));
    simple.min(screw) - scores.score_of(JointFamily::Free)
}

/// Evidence against an axis far from its part, on the scale of the scores: a hinge is on the part or beside
/// it. In the plane perpendicular to it, the axis has a Student distribution about the part's middle, with
/// two degrees of freedom and a scale of sqrt 2 radii. A slide is a turn about an axis far away. See
/// docs/method.md (8.9).
fn far(joint: &PlacedJoint, place: &PartPlace) -> f64 {
    // A slide has no position.
    if joint.freedom == Freedom::Slide {
        return 0.0;
    }
    let off_m = (foot_on_line(&joint.point, &joint.direction, &place.middle) - place.middle).norm();
    4.0 * (off_m / (2.0 * place.radius_m)).powi(2).ln_1p()
}

#[cfg(test)]
#[path = "joint_type_tests.rs"]
mod tests;
