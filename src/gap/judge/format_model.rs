//! A joint's effects in each file format: the found effects if the format can express them, else the best
//! expressible ones, fitted anew; or the twin's values if nothing helps. See docs/method.md 14.12.

use crate::{
    fit::{
        problem::Problem,
        shooting::{Free, Pace, shooting_fit},
    },
    judge::{
        breadth::Breadth,
        cross_validation::Unseen,
        proof::{Gap, windowed_rmse},
        search::{Candidate, Scope, Search, scored_candidate, searched_sets},
        simplify::SIMPLER,
        verdict::Diagnosis,
    },
    model::{
        effect::{Effect, Place},
        expressed::expressed_model,
        format::{Expression, Format},
        joint_model::{Catalogue, JointModel, Term},
    },
};

/// A joint as expressed in the file of one format.
#[derive(Clone, Debug)]
pub struct FormatModel {
    /// The format.
    pub format: Format,
    /// The twin with the effects in the file; without effects if the file keeps the twin's values.
    pub model: JointModel,
    /// Root mean square residual of the held-out runs with this model, rad or m.
    pub rmse: f64,
    /// The same for the twin.
    pub twin_rmse: f64,
    /// What happens to each found effect.
    pub effects: Vec<HeldEffect>,
}

/// A found effect in the file of a format.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldEffect {
    /// Index in the catalogue; `None` for an unnamed part of the gap.
    pub effect: Option<usize>,
    /// What happens to it.
    pub fate: Fate,
    /// The terms replacing it, or the effect itself with other parameters.
    pub by: Vec<Term>,
}

/// What happens to a found effect in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// The file holds it as found.
    Native,
    /// The file holds the nearest expressible effect.
    Approximated,
    /// The file holds it with parameters fitted anew within the format.
    FittedAgain,
    /// The file holds other effects, fitted in its place.
    Replaced,
    /// The format could express it, but without the inexpressible effects the joint is predicted no worse
    /// without it.
    LeftOut,
    /// The format could express something, but nothing expressible predicts better than the twin.
    Kept,
    /// The format cannot express anything like it.
    NotExpressible,
}

impl Fate {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Approximated => "approximated",
            Self::FittedAgain => "fitted again",
            Self::Replaced => "replaced",
            Self::LeftOut => "left out",
            Self::Kept => "kept",
            Self::NotExpressible => "not expressible",
        }
    }
}

impl FormatModel {
    /// Whether the file holds all effects as found.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.effects.iter().all(|e| e.fate == Fate::Native)
    }

    /// Whether the file keeps the twin's values.
    #[must_use]
    pub fn keeps_twin(&self) -> bool {
        self.model.terms.is_empty()
    }
}

/// The joint in each format. `updated` is the twin with the effects other than pushes, `gap` their proof.
#[must_use]
pub fn format_models(
    problem: &Problem,
    held_out: &Problem,
    diagnosis: &Diagnosis,
    updated: &JointModel,
    gap: &Gap,
) -> Vec<FormatModel> {
    let problem = problem.for_prediction();
    let mut maker = Maker { problem, held_out, diagnosis, updated, gap, sought: Vec::new() };
    Format::ALL.map(|format| maker.format_model_of(format)).to_vec()
}

/// For joints without a named effect: the formats in which some expressible effects surely predict better.
/// They stand in for an unknown cause.
#[must_use]
pub fn stand_ins(
    problem: &Problem,
    held_out: &Problem,
    diagnosis: &Diagnosis,
    gap: &Gap,
) -> Vec<FormatModel> {
    let twin = &diagnosis.model;
    let mut nearest = diagnosis.nearest.as_ref().map_or(twin, |n| &n.model).clone();
    nearest.terms.retain(|t| !problem.catalogue[t.effect].is_of_one_run());
    let predicting = problem.for_prediction();
    let mut maker =
        Maker { problem: predicting, held_out, diagnosis, updated: &nearest, gap, sought: Vec::new() };
    let mut weighed: Vec<(JointModel, bool)> = Vec::new();
    let mut stand_ins = Vec::new();
    for format in Format::ALL {
        let model = maker.best_model(format, &expressed_model(format, &nearest, problem.catalogue));
        if model.terms.is_empty() {
            continue;
        }
        // Most formats express the same model.
        let known = weighed.iter().find(|(m, _)| *m == model).map(|(_, serves)| *serves);
        let serves = known.unwrap_or_else(|| {
            let serves = Unseen::of_models(problem, held_out, [&model, twin], diagnosis.noise).serve_better();
            weighed.push((model.clone(), serves));
            serves
        });
        let rmse = windowed_rmse(held_out, &model);
        if serves && rmse < gap.before {
            let by = model.terms.clone();
            let effects = vec![HeldEffect { effect: None, fate: Fate::Replaced, by }];
            stand_ins.push(FormatModel { format, model, rmse, twin_rmse: gap.before, effects });
        }
    }
    stand_ins
}

/// Searches for one joint, shared by the formats.
struct Maker<'p, 'c> {
    /// The fitted runs, set up to predict whole windows: if a model lacks an effect its residuals are not
    /// noise, and the parameters with the best predictions are wanted.
    problem: Problem<'c>,
    held_out: &'p Problem<'c>,
    diagnosis: &'p Diagnosis,
    updated: &'p JointModel,
    gap: &'p Gap,
    /// Sets of effects already searched, with the results.
    sought: Vec<(Vec<usize>, Search)>,
}

/// Breadth of the search among a format's effects.
const BREADTH: Breadth = Breadth { singles: 9, grown: 2, partners: 4, largest: 4, regressed: 4 };

impl<'c> Maker<'_, 'c> {
    fn catalogue(&self) -> &'c Catalogue {
        self.problem.catalogue
    }

    fn format_model_of(&mut self, format: Format) -> FormatModel {
        let translated = expressed_model(format, self.updated, self.catalogue());
        let twin = self.updated.without_effects();
        let mut may_help = true;
        let (model, rmse) = if translated.terms == self.updated.terms {
            (translated.clone(), self.gap.after)
        } else {
            let best = self.best_model(format, &translated);
            let rmse = windowed_rmse(self.held_out, &best);
            may_help = !best.terms.is_empty();
            // Negated, so a NaN residual is not better.
            if best.terms.is_empty() || !(rmse < self.gap.before) {
                (twin, self.gap.before)
            } else {
                (best, rmse)
            }
        };
        let is_translated = model.terms == translated.terms;
        let effects = self
            .updated
            .terms
            .iter()
            .map(|t| self.held_effect(format, t, &model, is_translated, may_help))
            .collect();
        FormatModel { format, model, rmse, twin_rmse: self.gap.before, effects }
    }

    /// What happens to a found effect in a file with `model`.
    fn held_effect(
        &self,
        format: Format,
        term: &Term,
        model: &JointModel,
        is_translated: bool,
        may_help: bool,
    ) -> HeldEffect {
        let of = |fate, by| HeldEffect { effect: Some(term.effect), fate, by };
        let effect = self.catalogue()[term.effect].as_ref();
        let is_held = effect.in_format(format, &term.p, &self.problem.plant) != Expression::NotExpressible;
        if model.terms.is_empty() {
            return of(if is_held || may_help { Fate::Kept } else { Fate::NotExpressible }, Vec::new());
        }
        if let Some(own) = model.terms.iter().find(|t| t.effect == term.effect) {
            return match (own.p == term.p, is_translated) {
                (true, _) => of(Fate::Native, Vec::new()),
                (_, true) => of(Fate::Approximated, vec![own.clone()]),
                (_, false) => of(Fate::FittedAgain, vec![own.clone()]),
            };
        }
        let mut by = model.terms.clone();
        by.retain(|t| {
            let is_found = self.updated.terms.iter().any(|u| u.effect == t.effect);
            !is_found && may_stand_in(self.catalogue()[t.effect].as_ref(), effect)
        });
        let fate = match (by.is_empty(), is_translated) {
            (false, true) => Fate::Approximated,
            (false, false) => Fate::Replaced,
            _ if is_held => Fate::LeftOut,
            _ => Fate::NotExpressible,
        };
        of(fate, by)
    }

    /// Whether a format can express an effect of some strength.
    fn can_hold(&self, format: Format, effect: &dyn Effect) -> bool {
        let shapes = effect.start_shapes(&self.problem.coverage);
        shapes.first().is_some_and(|p| {
            let mut strong = p.clone();
            // A spring of zero stiffness or a zero armature expresses nothing.
            strong[0] += 1.0;
            [p, &strong]
                .iter()
                .any(|p| effect.in_format(format, p, &self.problem.plant) == Expression::Native)
        })
    }

    /// The model with the best predictions among those a format can express.
    fn best_model(&mut self, format: Format, translated: &JointModel) -> JointModel {
        let problem = &self.problem;
        let effects = self.holdable_effects(format);
        let known = self.sought.iter().position(|(e, _)| *e == effects);
        let at = known.unwrap_or_else(|| {
            let seeds = std::slice::from_ref(translated);
            // A stand-in needs no certain name, only good predictions.
            let scope = Scope { effects: &effects, seeds, least_gain: 0.0 };
            let found = searched_sets(problem, &BREADTH, &scope);
            self.sought.push((effects, found));
            self.sought.len() - 1
        });
        // Some fitted values, such as a negative armature, cannot be expressed.
        let sets = self.sought[at].1.by_size.iter().flatten().filter(|c| {
            let model = without_pushes(problem.catalogue, &c.fit.model);
            expressed_model(format, &model, problem.catalogue).terms == model.terms
        });
        let Some(best) = sets.max_by(|a, b| a.score.total_cmp(&b.score)) else {
            return translated.without_effects();
        };
        let found = finely_fitted(problem, best);
        // Found effects have intervals: if they predict as well, they are kept.
        let starts = Some(found.fit.starts.as_slice());
        let as_found =
            shooting_fit(problem, translated, starts, found.fit.noise, Free::Starts, Pace::thorough(2));
        let as_found = scored_candidate(problem, as_found);
        if !translated.terms.is_empty() && as_found.score > found.score - SIMPLER {
            return translated.clone();
        }
        expressed_model(format, &without_pushes(problem.catalogue, &found.fit.model), problem.catalogue)
    }

    /// The sought effects a format can express. If a push was found it is fitted with them, but not written.
    fn holdable_effects(&self, format: Format) -> Vec<usize> {
        let catalogue = self.catalogue();
        let has_push = self.diagnosis.model.terms.iter().any(|t| catalogue[t.effect].is_of_one_run());
        let mut effects = self.problem.sought_effects();
        effects.retain(|e| {
            let effect = catalogue[*e].as_ref();
            if effect.is_of_one_run() { has_push } else { self.can_hold(format, effect) }
        });
        effects
    }
}

/// A model without effects of single runs.
fn without_pushes(catalogue: &Catalogue, model: &JointModel) -> JointModel {
    let mut model = model.clone();
    model.terms.retain(|t| !catalogue[t.effect].is_of_one_run());
    model
}

/// Whether an effect can take over another's action: both resist motion, or neither does; a gain and an
/// inertia scale any effort.
fn may_stand_in(other: &dyn Effect, effect: &dyn Effect) -> bool {
    let resists = |e: &dyn Effect| e.place() == Place::Friction || e.is_of_velocity();
    matches!(other.place(), Place::Gain | Place::Inertia) || resists(other) == resists(effect)
}

/// Refits a set with the small steps used for reported parameters.
fn finely_fitted(problem: &Problem, coarse: &Candidate) -> Candidate {
    let fit_ = &coarse.fit;
    let problem = &problem.with_small_steps();
    scored_candidate(
        problem,
        shooting_fit(problem, &fit_.model, Some(&fit_.starts), fit_.noise, Free::All, Pace::WARM),
    )
}
