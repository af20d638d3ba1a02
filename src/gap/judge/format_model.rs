//! The effects of a joint in the file of each format: the found effects where it holds them, else the best
//! expressible ones, fitted again alone, and the twin's values where nothing helps. See docs/method.md 14.12.

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

/// A joint as the file of a format holds it.
#[derive(Clone, Debug)]
pub struct FormatModel {
    /// The format.
    pub format: Format,
    /// The twin with the effects of the file; without any where it keeps the twin's values.
    pub model: JointModel,
    /// Root mean square residual of the held-out runs with it, rad or m.
    pub rmse: f64,
    /// The twin's.
    pub twin_rmse: f64,
    /// Fate of each found effect.
    pub effects: Vec<HeldEffect>,
}

/// A found effect in the file of a format.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldEffect {
    /// Index in the catalogue; `None` for a part without a name.
    pub effect: Option<usize>,
    /// Its fate.
    pub fate: Fate,
    /// The terms in its place, or the effect with other parameters.
    pub by: Vec<Term>,
}

/// Fate of a found effect in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is there as it was found.
    Native,
    /// The nearest effect is there.
    Approximated,
    /// It is there with parameters fitted again within the format.
    FittedAgain,
    /// Other effects are there, fitted in its place.
    Replaced,
    /// The format could hold it; without the missing effects, the joint is predicted better or as well
    /// without.
    LeftOut,
    /// The format could hold something; nothing expressible predicts better than the twin.
    Kept,
    /// The format holds nothing like it.
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
    /// Whether the file holds all effects as they were found.
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

/// The joint in each format. `updated` is the twin with the effects of the joint itself, `gap` their proof.
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

/// The joint in each format with surely better predictions by some expressible effects, where nothing was
/// named: they stand in for something unknown.
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
        // Most formats hold the same.
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

/// Searches of one joint, shared by the formats.
struct Maker<'p, 'c> {
    /// The fitted runs, for predictions of whole windows: without an effect, the misses of a model are no
    /// noise, and the wanted parameters are those of the best predictions.
    problem: Problem<'c>,
    held_out: &'p Problem<'c>,
    diagnosis: &'p Diagnosis,
    updated: &'p JointModel,
    gap: &'p Gap,
    /// Effects of each search, and its result.
    sought: Vec<(Vec<usize>, Search)>,
}

/// Breadth of a search among a format's effects.
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
            // Negated: a residual of NaN is not better.
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

    /// Fate of a found effect.
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

    /// Whether a format holds an effect of some strength.
    fn can_hold(&self, format: Format, effect: &dyn Effect) -> bool {
        let shapes = effect.start_shapes(&self.problem.coverage);
        shapes.first().is_some_and(|p| {
            let mut strong = p.clone();
            // A spring without stiffness and an armature of zero are none.
            strong[0] += 1.0;
            [p, &strong]
                .iter()
                .any(|p| effect.in_format(format, p, &self.problem.plant) == Expression::Native)
        })
    }

    /// The best predicting model among those of a format.
    fn best_model(&mut self, format: Format, translated: &JointModel) -> JointModel {
        let problem = &self.problem;
        let effects = self.holdable_effects(format);
        let known = self.sought.iter().position(|(e, _)| *e == effects);
        let at = known.unwrap_or_else(|| {
            let seeds = std::slice::from_ref(translated);
            // A stand-in needs no certainty of a name: it is there to predict.
            let scope = Scope { effects: &effects, seeds, least_gain: 0.0 };
            let found = searched_sets(problem, &BREADTH, &scope);
            self.sought.push((effects, found));
            self.sought.len() - 1
        });
        // An armature below zero is none.
        let sets = self.sought[at].1.by_size.iter().flatten().filter(|c| {
            let model = without_pushes(problem.catalogue, &c.fit.model);
            expressed_model(format, &model, problem.catalogue).terms == model.terms
        });
        let Some(best) = sets.max_by(|a, b| a.score.total_cmp(&b.score)) else {
            return translated.without_effects();
        };
        let found = finely_fitted(problem, best);
        // Found effects have intervals: with as good predictions they stay as they are.
        let starts = Some(found.fit.starts.as_slice());
        let as_found =
            shooting_fit(problem, translated, starts, found.fit.noise, Free::Starts, Pace::thorough(2));
        let as_found = scored_candidate(problem, as_found);
        if !translated.terms.is_empty() && as_found.score > found.score - SIMPLER {
            return translated.clone();
        }
        expressed_model(format, &without_pushes(problem.catalogue, &found.fit.model), problem.catalogue)
    }

    /// The sought effects with a place in a file; with the push, fitted beside them and not written, where
    /// one was found.
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

/// A model without the effects of one run.
fn without_pushes(catalogue: &Catalogue, model: &JointModel) -> JointModel {
    let mut model = model.clone();
    model.terms.retain(|t| !catalogue[t.effect].is_of_one_run());
    model
}

/// Whether an effect may take up another's action: both resist the motion, or neither does; a gain and an
/// inertia scale any effort.
fn may_stand_in(other: &dyn Effect, effect: &dyn Effect) -> bool {
    let resists = |e: &dyn Effect| e.place() == Place::Friction || e.is_of_velocity();
    matches!(other.place(), Place::Gain | Place::Inertia) || resists(other) == resists(effect)
}

/// The set fitted with the small steps of reported parameters.
fn finely_fitted(problem: &Problem, coarse: &Candidate) -> Candidate {
    let fit_ = &coarse.fit;
    let problem = &problem.with_small_steps();
    scored_candidate(
        problem,
        shooting_fit(problem, &fit_.model, Some(&fit_.starts), fit_.noise, Free::All, Pace::WARM),
    )
}
