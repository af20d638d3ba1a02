//! What the file of each format gets of a joint: the found effects where it holds them, else the best that it
//! holds, fitted again alone, and the twin's values where nothing helps. See docs/method.md 14.12.

use rayon::prelude::*;

use crate::gap::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        rollout::Start,
        shooting::{Fit, Free, MAX_FIT_FREE, Pace, fit},
    },
    judge::{
        proof::{Gap, residuals, started, windowed_rmse},
        screen::Screen,
        verdict::Diagnosis,
    },
    model::{
        effect::Effect,
        expressed::expressed,
        format::{Expression, Format},
        joint_model::{Catalogue, JointModel, SETTLE_S, Term},
    },
    record::log::rms,
};

/// A joint as the file of a format holds it.
#[derive(Clone, Debug)]
pub struct FormatModel {
    /// The format.
    pub format: Format,
    /// The twin with the effects that the file gets; without any where it keeps the twin's values.
    pub model: JointModel,
    /// Root mean square residual of the held-out runs with it, rad or m.
    pub rmse: f64,
    /// That of the twin.
    pub twin_rmse: f64,
    /// What became of each effect that was found.
    pub effects: Vec<HeldEffect>,
}

/// A found effect in the file of a format.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldEffect {
    /// Index in the catalogue.
    pub effect: usize,
    /// What became of it.
    pub fate: Fate,
    /// What the file has in its place, or of it with other parameters.
    pub by: Vec<Term>,
}

/// What becomes of a found effect in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is there as it was found.
    Native,
    /// What comes nearest is there.
    Approximated,
    /// It is there with parameters that were fitted to what the format holds.
    FittedAgain,
    /// Other effects are there, fitted in its place.
    Replaced,
    /// The format could hold it; without what it lacks, the joint is predicted better or as well without.
    LeftOut,
    /// The format could hold something; nothing that it holds predicts better than the twin.
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

/// The joint in each format. `updated` is the twin with the effects that leave the runs with it, `gap` their
/// proof.
#[must_use]
pub fn format_models(
    problem: &Problem,
    held_out: &Problem,
    diagnosis: &Diagnosis,
    updated: &JointModel,
    gap: &Gap,
) -> Vec<FormatModel> {
    let known = vec![(updated.clone(), gap.after)];
    let mut maker =
        Maker { problem, held_out, diagnosis, updated, gap, folds: None, known, sought: Vec::new() };
    Format::ALL.map(|format| maker.make(format)).to_vec()
}

/// Fits of one joint, shared by the formats.
struct Maker<'p, 'c> {
    problem: &'p Problem<'c>,
    held_out: &'p Problem<'c>,
    diagnosis: &'p Diagnosis,
    updated: &'p JointModel,
    gap: &'p Gap,
    /// Parts of the runs, and what each is predicted from.
    folds: Option<Vec<[Problem<'c>; 2]>>,
    /// Models with their residuals on held-out runs.
    known: Vec<(JointModel, f64)>,
    /// Terms that a search began with, and what it ended in.
    sought: Vec<(Vec<Term>, Trial)>,
}

/// A model of the runs, and how it predicts each window from the others.
#[derive(Clone)]
struct Trial {
    model: JointModel,
    /// Mean square of each window.
    squares: Vec<f64>,
    /// Its parameters are those that were found.
    is_translated: bool,
}

/// Share of the mean squares that is little.
/// derived: the level of the intervals.
const LITTLE: f64 = 0.05;

impl Trial {
    fn mean(&self) -> f64 {
        let mean = self.squares.iter().sum::<f64>() / self.squares.len().max(1) as f64;
        if mean.is_finite() { mean } else { f64::INFINITY }
    }

    /// Whether it predicts worse than another by less than a standard error of the difference (the rule of
    /// one standard error, Breiman et al. 1984, over pairs of windows), and by little: where few windows make
    /// most of the squares, a standard error is wide.
    fn ties(&self, best: &Self) -> bool {
        let n = self.squares.len().max(2) as f64;
        let differences = || self.squares.iter().zip(&best.squares).map(|(a, b)| a - b);
        let mean = differences().sum::<f64>() / n;
        let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
        mean <= (variance / n).sqrt().min(LITTLE * best.mean())
    }
}

/// A fit that begins near its end.
const WARM: Pace = Pace { rounds: 1, steps: 6, enough: 0.2, settles: false, searches: false, hears: false };
/// A fit that begins far from it.
const COLD: Pace = Pace { settles: false, ..Pace::thorough(1) };

impl<'c> Maker<'_, 'c> {
    fn catalogue(&self) -> &'c Catalogue {
        self.problem.catalogue
    }

    fn make(&mut self, format: Format) -> FormatModel {
        let translated = expressed(format, self.updated, self.catalogue());
        let twin =
            Trial { model: JointModel::of(&self.problem.plant), squares: Vec::new(), is_translated: false };
        let start = self.start(format, &translated);
        let (trial, rmse) = if translated.terms == self.updated.terms {
            (Trial { model: translated, is_translated: true, ..twin }, self.gap.after)
        } else if start.terms.is_empty() {
            (twin, self.gap.before)
        } else {
            let best = self.best(format, translated, &start);
            let rmse = self.measured(&best.model);
            // Negated, so that a residual that is not a number is not better.
            if best.model.terms.is_empty() || !(rmse < self.gap.before) {
                (twin, self.gap.before)
            } else {
                (best, rmse)
            }
        };
        let effects = self.updated.terms.iter().map(|t| self.held(format, t, &trial, &start)).collect();
        FormatModel { format, model: trial.model, rmse, twin_rmse: self.gap.before, effects }
    }

    /// Residual on held-out runs.
    fn measured(&mut self, model: &JointModel) -> f64 {
        let same = |m: &JointModel| m.terms == model.terms && m.settle_s == model.settle_s;
        if let Some((_, rmse)) = self.known.iter().find(|(m, _)| same(m)) {
            return *rmse;
        }
        let rmse = windowed_rmse(self.held_out, model);
        self.known.push((model.clone(), rmse));
        rmse
    }

    /// What became of a found effect.
    fn held(&self, format: Format, term: &Term, trial: &Trial, start: &JointModel) -> HeldEffect {
        let of = |fate, by| HeldEffect { effect: term.effect, fate, by };
        let terms = &trial.model.terms;
        if terms.is_empty() {
            let fate = if start.terms.is_empty() { Fate::NotExpressible } else { Fate::Kept };
            return of(fate, Vec::new());
        }
        if let Some(own) = terms.iter().find(|t| t.effect == term.effect) {
            return match (own.p == term.p, trial.is_translated) {
                (true, _) => of(Fate::Native, Vec::new()),
                (_, true) => of(Fate::Approximated, vec![own.clone()]),
                (_, false) => of(Fate::FittedAgain, vec![own.clone()]),
            };
        }
        let is_found = |t: &Term| self.updated.terms.iter().any(|u| u.effect == t.effect);
        let names = self.stand_ins(format, term);
        let stands = |t: &&Term| !is_found(t) && names.contains(&self.catalogue()[t.effect].name());
        let by: Vec<Term> = terms.iter().filter(stands).cloned().collect();
        let fate = match self.catalogue()[term.effect].in_format(format, &term.p, &self.problem.plant) {
            _ if !by.is_empty() && trial.is_translated => Fate::Approximated,
            _ if !by.is_empty() => Fate::Replaced,
            Expression::NotExpressible => Fate::NotExpressible,
            _ => Fate::LeftOut,
        };
        of(fate, by)
    }

    /// Names of effects that may stand in for a found one: what a format has nearest, what it contains, what
    /// acts as it does, and what the runs do not distinguish from it.
    fn stand_ins(&self, format: Format, term: &Term) -> Vec<&str> {
        let effect = &self.catalogue()[term.effect];
        let nearest = match effect.in_format(format, &term.p, &self.problem.plant) {
            Expression::Approximated(nearest) => nearest.into_iter().filter_map(|n| n.effect).collect(),
            _ => Vec::new(),
        };
        let finding = self.diagnosis.findings.iter().find(|f| f.index == term.effect);
        let class = finding.into_iter().flat_map(|f| f.alternatives.iter().map(|(name, _)| name.as_str()));
        nearest
            .into_iter()
            .chain(effect.indistinguishable(&self.problem.coverage))
            .chain(class)
            .chain(effect.stand_ins().iter().copied())
            .chain(effect.spec().contains.iter().copied())
            .collect()
    }

    /// All that a format can hold in place of what was found: what it holds of that, and what may stand in
    /// for the rest.
    fn start(&self, format: Format, translated: &JointModel) -> JointModel {
        let catalogue = self.catalogue();
        let mut model = JointModel { terms: Vec::new(), ..translated.clone() };
        for term in &translated.terms {
            if !model.terms.iter().any(|t| t.effect == term.effect) {
                model.terms.push(term.clone());
            }
        }
        let is_native = |t: &&Term| {
            catalogue[t.effect].in_format(format, &t.p, &self.problem.plant) == Expression::Native
        };
        for term in self.updated.terms.iter().filter(|t| !is_native(t)) {
            for name in self.stand_ins(format, term) {
                let Some(index) = catalogue.iter().position(|e| e.name() == name) else { continue };
                let effect = catalogue[index].as_ref();
                let doubles = |t: &Term| {
                    let other = &catalogue[t.effect];
                    t.effect == index
                        || other.spec().contains.contains(&name)
                        || effect.spec().contains.contains(&other.name())
                };
                if model.terms.iter().any(doubles) || !self.can_hold(format, effect) {
                    continue;
                }
                if let Some(p) = self.shape(index)
                    && model.free() + self.pushes().len() * 3 + p.len() <= MAX_FIT_FREE
                {
                    model = model.with(index, &p);
                }
            }
        }
        model
    }

    /// The model, and such with what an effect contains in place of it, where a format holds less of it.
    fn simpler(&self, format: Format, start: &JointModel) -> Vec<JointModel> {
        let mut models = vec![start.clone()];
        for (i, term) in start.terms.iter().enumerate() {
            let effect = &self.catalogue()[term.effect];
            if effect.in_format(format, &term.p, &self.problem.plant) == Expression::Native
                && self.updated.terms.contains(term)
            {
                continue;
            }
            for name in effect.spec().contains {
                let Some(index) = self.catalogue().iter().position(|e| e.name() == *name) else { continue };
                if !self.can_hold(format, self.catalogue()[index].as_ref())
                    || start.terms.iter().any(|t| t.effect == index)
                {
                    continue;
                }
                if let Some(p) = self.shape(index) {
                    let mut model = start.clone();
                    model.terms[i] = Term { effect: index, p };
                    models.push(model);
                }
            }
        }
        models
    }

    /// Whether a format holds an effect of some strength.
    fn can_hold(&self, format: Format, effect: &dyn Effect) -> bool {
        let shapes = effect.shapes(&self.problem.coverage);
        shapes.first().is_some_and(|p| {
            let mut strong = p.clone();
            // A spring without stiffness and an armature of zero are none.
            strong[0] += 1.0;
            [p, &strong]
                .iter()
                .any(|p| effect.in_format(format, p, &self.problem.plant) == Expression::Native)
        })
    }

    /// Where a fit of an effect begins: beside the twin, where there are several shapes.
    fn shape(&self, effect: usize) -> Option<Vec<f64>> {
        let mut shapes = self.catalogue()[effect].shapes(&self.problem.coverage);
        if shapes.len() < 2 {
            return shapes.pop();
        }
        let twin = least_squares(self.problem, &JointModel::of(&self.problem.plant), None, COLD);
        Screen::new(self.problem, &twin).hits(effect, 1).pop().map(|h| h.p)
    }

    /// Effects of one run, which are fitted beside the others and not written.
    fn pushes(&self) -> Vec<Term> {
        let terms = self.diagnosis.model.terms.iter();
        terms.filter(|t| self.catalogue()[t.effect].is_of_one_run()).cloned().collect()
    }

    /// The model that predicts the runs best, each part from the others, of those that a format holds; of
    /// such as predict as well, the one with the fewest parameters.
    fn best(&mut self, format: Format, translated: JointModel, start: &JointModel) -> Trial {
        let holds = |m: &JointModel| expressed(format, m, self.catalogue()).terms == m.terms;
        if let Some((_, trial)) = self.sought.iter().find(|(s, t)| *s == start.terms && holds(&t.model)) {
            return trial.clone();
        }
        if self.folds.is_none() {
            self.folds = Some(parts(self.problem));
        }
        let folds = self.folds.as_deref().unwrap_or_default();
        let twin = JointModel::of(&self.problem.plant);
        let mut trials = vec![
            Trial { squares: predicted(folds, |_| twin.clone()), model: twin, is_translated: false },
            Trial {
                squares: predicted(folds, |p| {
                    expressed(format, &least_squares(p, self.updated, None, WARM).model, p.catalogue)
                }),
                model: translated,
                is_translated: true,
            },
        ];
        let starts = self.simpler(format, start);
        let path: Vec<JointModel> =
            starts.iter().flat_map(|s| path(self.problem, s, &self.pushes())).collect();
        trials.extend(
            path.into_par_iter()
                .map(|model| {
                    let fitted = |p: &Problem| {
                        expressed(format, &least_squares(p, &model, None, WARM).model, p.catalogue)
                    };
                    Trial { squares: predicted(folds, fitted), model, is_translated: false }
                })
                .collect::<Vec<_>>(),
        );
        let best = trials.iter().min_by(|a, b| a.mean().total_cmp(&b.mean()));
        let tied = trials.iter().filter(|t| best.is_some_and(|b| t.ties(b)));
        // What was found has intervals: of two that predict as well it stays as it is.
        let is_found =
            |t: &Trial| t.is_translated && t.model.terms.iter().all(|term| self.updated.terms.contains(term));
        let order = |t: &Trial| (t.model.free(), !is_found(t));
        let simplest = tied.min_by(|a, b| order(a).cmp(&order(b)).then(a.mean().total_cmp(&b.mean())));
        let mut chosen = simplest.unwrap_or(&trials[0]).clone();
        if !chosen.is_translated && !chosen.model.terms.is_empty() {
            let fine = finely(self.problem, &chosen.model, &self.pushes());
            chosen.model = expressed(format, &fine, self.catalogue());
        }
        self.sought.push((start.terms.clone(), chosen.clone()));
        chosen
    }
}

/// A model by the least squares of its windows: where it lacks an effect, what it misses is no noise, and the
/// parameters wanted are those that predict best.
fn least_squares(problem: &Problem, model: &JointModel, starts: Option<&[Start]>, pace: Pace) -> Fit {
    // With next to no effort noise, whitened residuals are the residuals up to a factor.
    fit(problem, model, starts, EffortNoise::white(problem.min_sigma_u), Free::All, pace)
}

/// Models from all effects down to one; each lacks the effect without which the fit loses least.
fn path(problem: &Problem, start: &JointModel, pushes: &[Term]) -> Vec<JointModel> {
    let cost = |f: &Fit| f.costs.iter().sum::<f64>();
    let own = |f: &Fit| f.model.terms.len() - pushes.len();
    let fitted = |model: &JointModel, pace| least_squares(problem, model, None, pace);
    let mut model = start.clone();
    model.terms.extend(pushes.iter().cloned());
    let mut now = fitted(&model, COLD);
    if model.has_friction(problem.catalogue) {
        // By least squares the settle time has no likelihood: all are tried.
        let trial = |settle_s: &f64| fitted(&JointModel { settle_s: *settle_s, ..now.model.clone() }, WARM);
        let trials: Vec<Fit> = SETTLE_S.par_iter().map(trial).collect();
        now = trials.into_iter().fold(now, |best, t| if cost(&t) < cost(&best) { t } else { best });
    }
    let mut models = Vec::new();
    loop {
        let count = own(&now);
        let mut model = now.model.clone();
        model.terms.truncate(count);
        models.push(model);
        if count < 2 {
            return models;
        }
        let without = |i: usize| {
            let mut model = now.model.clone();
            model.terms.remove(i);
            fitted(&model, WARM)
        };
        let fits: Vec<Fit> = (0..count).into_par_iter().map(without).collect();
        match fits.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b))) {
            Some(next) => now = next,
            None => return models,
        }
    }
}

/// The model fitted with the small steps that parameters are reported from.
fn finely(problem: &Problem, model: &JointModel, pushes: &[Term]) -> JointModel {
    let mut with = model.clone();
    with.terms.extend(pushes.iter().cloned());
    let mut fine = least_squares(&problem.refined(), &with, None, WARM).model;
    fine.terms.truncate(model.terms.len());
    fine
}

/// Runs that predict each other; of a single one its halves.
fn parts<'c>(problem: &Problem<'c>) -> Vec<[Problem<'c>; 2]> {
    let folds = problem.folds();
    let [log] = problem.logs.as_slice() else { return folds };
    let n = log.time_s.len();
    let half = |from: usize, to: usize| problem.of_logs(vec![log.part(from, to)]);
    let [first, second] = [half(0, n / 2), half(n / 2, n)];
    vec![[first.clone(), second.clone()], [second, first]]
}

/// Mean squares of the windows of each part under the model that is made from the others.
fn predicted(folds: &[[Problem; 2]], made: impl Fn(&Problem) -> JointModel + Sync) -> Vec<f64> {
    let one = |[fitted, other]: &[Problem; 2]| -> Vec<f64> {
        let (model, starts) = started(other, &made(fitted));
        residuals(other, &model, &starts).iter().map(|(_, r)| rms(r).powi(2)).collect()
    };
    folds.par_iter().map(one).collect::<Vec<_>>().concat()
}
