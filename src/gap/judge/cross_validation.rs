//! Cross-validation of effects: each must improve predictions of windows of runs it was not fitted to.

use rayon::prelude::*;
use tracing::debug;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        shooting::{Free, Pace, shooting_fit},
    },
    judge::{
        proof::{Gap, WindowGap, started_model, window_residuals},
        search::{Candidate, Search},
        simplify::{fit_with_replacement, refitted_set, special_terms},
    },
    model::joint_model::JointModel,
    record::log::rms,
};
use numeric::statistics::{HALF_WIDTH_95, median};

/// Window lengths for the test of effects, as shares of the fitted length.
/// chosen: lasting effects are most visible over whole windows, local or momentary ones in short windows.
const LENGTHS: [f64; 2] = [1.0, 0.25];

/// A mean is surely above zero in one of the lengths beyond this many standard errors.
/// derived: the normal quantile at 97.5 %, 5 % over two tests.
const SURELY: f64 = HALF_WIDTH_95;

/// Largest share of the squared residuals beyond the noise an effect may leave where it acts: effects beyond
/// the catalog have several shapes, and one effect can seldom imitate most of them.
/// tuned: machines of eval/gap/suite.py, seed 6100: 0.33 and more beside a floor alone, 0.22 and less with an
/// effect
const MOST_LEFT: f64 = 0.25;

/// Root mean square residuals of windows of each length.
type Sizes = [Vec<f64>; LENGTHS.len()];
/// Residuals of each of these windows.
type Residuals = [Vec<Vec<f64>>; LENGTHS.len()];

/// Number of sets of each size compared by their predictions.
/// derived: the number of sets fitted to the end by a search.
const CONTENDERS: usize = 5;

/// Simplifies a chosen set of effects as long as predictions of other runs do not become surely worse. First,
/// effects are removed, the least useful first, or general effects replaced by their special cases. Then the
/// simplest set of the search, with no more effects and the fewest parameters, takes its place if it predicts
/// as well.
#[must_use]
pub fn predictive_set(problem: &Problem, found: &Search, chosen: &Candidate) -> Candidate {
    let folds = problem.cross_validation_folds();
    let predicted = |model: &JointModel| crossed_residuals(&folds, model, chosen.fit.noise);
    let mut model = chosen.fit.model.clone();
    let mut with = predicted(&model);
    while let Some((simpler, residuals)) =
        least_worse(models_with_one_less(problem, &model), &with, predicted)
            .or_else(|| least_worse(models_with_special_case(problem, &model, chosen), &with, predicted))
    {
        (model, with) = (simpler, residuals);
        let effects = model.effect_names(problem.catalogue);
        debug!(?effects, "effect dropped: predictions are as good without");
    }
    let own = model_richness(&model);
    let mut contenders: Vec<&Candidate> =
        found.by_size.iter().skip(1).flat_map(|sets| sets.iter().take(CONTENDERS)).collect();
    contenders.retain(|c| model_richness(&c.fit.model) < own);
    contenders.sort_by_key(|c| model_richness(&c.fit.model));
    for alike in contenders.chunk_by(|a, b| model_richness(&a.fit.model) == model_richness(&b.fit.model)) {
        let as_good = alike.iter().filter_map(|set| {
            let errors = errors_better_at_best(&with, &predicted(&set.fit.model));
            (errors <= SURELY).then_some((errors, set))
        });
        if let Some((_, smaller)) = as_good.min_by(|a, b| a.0.total_cmp(&b.0)) {
            return refitted_set(problem, smaller, &smaller.fit.model);
        }
    }
    if model == chosen.fit.model {
        return chosen.clone();
    }
    refitted_set(problem, chosen, &model)
}

/// The model with the least loss of prediction against `with`, and its residuals; `None` if all are surely
/// worse.
fn least_worse(
    models: Vec<JointModel>,
    with: &Residuals,
    predicted: impl Fn(&JointModel) -> Residuals,
) -> Option<(JointModel, Residuals)> {
    let tried = models.into_iter().map(|model| {
        let residuals = predicted(&model);
        (errors_better_at_best(with, &residuals), model, residuals)
    });
    let (errors, model, residuals) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Negated, so NaN passes.
    (!(errors > SURELY)).then_some((model, residuals))
}

/// Complexity of a model: number of effects, then number of parameters.
#[must_use]
pub fn model_richness(model: &JointModel) -> (usize, usize) {
    (model.terms.len(), model.terms.iter().map(|t| t.p.len()).sum())
}

/// Weights of other sets of the same size relative to a chosen one of weight 1, by their predictions: the
/// odds of predicting unfitted windows better.
#[must_use]
pub fn predicted_weights(problem: &Problem, chosen: &Candidate, others: &[&Candidate]) -> Vec<f64> {
    let folds = problem.cross_validation_folds();
    let own = crossed_residuals(&folds, &chosen.fit.model, chosen.fit.noise);
    let contenders = others.iter().take(CONTENDERS);
    let predicted = contenders.map(|c| crossed_residuals(&folds, &c.fit.model, chosen.fit.noise));
    predicted.map(|residuals| (-LOGISTIC * errors_better_at_best(&own, &residuals)).exp()).collect()
}

/// Slope of the logistic function closest to the normal distribution function.
/// derived: it minimizes the greatest difference of the two, 0.0095.
const LOGISTIC: f64 = 1.702;

/// Number of standard errors by which the windows changed by a model are better with it, in the best length.
fn errors_better_at_best(with: &Residuals, without: &Residuals) -> f64 {
    let errors = with.iter().zip(without).map(|(with, without)| {
        let [with, without] = with_and_without(&acting_windows(&compared_windows(with, without)));
        errors_better(&with, &without)
    });
    errors.fold(f64::NEG_INFINITY, f64::max)
}

/// A model without each of its effects in turn.
fn models_with_one_less(problem: &Problem, model: &JointModel) -> Vec<JointModel> {
    let mut all = Vec::new();
    for (i, term) in model.terms.iter().enumerate() {
        // A push of one run does not predict another run.
        if !problem.catalogue[term.effect].is_of_one_run() {
            let mut fewer = model.clone();
            fewer.terms.remove(i);
            all.push(fewer);
        }
    }
    all
}

/// A model with each general effect replaced by its special cases in turn.
fn models_with_special_case(problem: &Problem, model: &JointModel, chosen: &Candidate) -> Vec<JointModel> {
    let mut all = Vec::new();
    for (i, term) in model.terms.iter().enumerate() {
        for special in special_terms(problem, term) {
            all.push(fit_with_replacement(problem, model, i, special, &chosen.fit).model);
        }
    }
    all
}

/// Whether a model surely predicts windows of some length better than another, and explains more than half of
/// the other's squared residuals.
#[must_use]
pub fn predicts_better(problem: &Problem, model: &JointModel, other: &JointModel) -> bool {
    is_better(&window_sizes_of(problem, model), &window_sizes_of(problem, other), problem.noise_floor())
}

/// Whether held-out windows are surely worse with the findings than with the twin.
#[must_use]
pub fn is_surely_worse(gap: &Gap) -> bool {
    let [before, after]: [Vec<f64>; 2] =
        [|w: &WindowGap| w.before, |w: &WindowGap| w.after].map(|of| gap.windows.iter().map(of).collect());
    errors_better(&before, &after) > SURELY
}

/// Windows of each length to which neither model was fitted: those of held-out runs, and those of each fitted
/// run under the parameters of the others.
pub struct Unseen {
    windows: [Vec<Compared>; LENGTHS.len()],
    floor: f64,
}

/// Root mean squares over a window, rad or m.
#[derive(Clone, Copy, Debug)]
struct Compared {
    /// Residual with the tested model.
    with: f64,
    /// Residual with the other one.
    without: f64,
    /// Difference of the two predictions.
    change: f64,
}

/// The windows testing an effect hold this share of the squared change of the predictions.
/// chosen: in the others both models predict the same, and the residuals do not show the effect.
const ACTING: f64 = 0.9;

impl Unseen {
    /// Compares the first model with the second.
    #[must_use]
    pub fn of_models(
        problem: &Problem,
        held_out: &Problem,
        [model, other]: [&JointModel; 2],
        noise: EffortNoise,
    ) -> Self {
        let folds = problem.for_prediction().cross_validation_folds();
        let [with, without] = [model, other].map(|model| {
            let mut all = crossed_residuals(&folds, model, noise);
            let held_out = window_residuals_of(held_out, model);
            all.iter_mut().zip(held_out).for_each(|(all, more)| all.extend(more));
            all
        });
        let windows = std::array::from_fn(|i| compared_windows(&with[i], &without[i]));
        Self { windows, floor: problem.noise_floor() }
    }

    /// Whether they confirm the model: in windows of some length where it changes the prediction, it is
    /// surely better and leaves little of the squared residuals.
    #[must_use]
    pub fn bear_out(&self) -> bool {
        let mut acting = self.windows.iter().map(|windows| with_and_without(&acting_windows(windows)));
        acting.any(|[with, without]| surely_leaves(&with, &without, self.floor, MOST_LEFT))
    }

    /// Whether they are surely better with the model, in windows of some length.
    #[must_use]
    pub fn surely_agree(&self) -> bool {
        self.windows
            .iter()
            .map(|windows| with_and_without(windows))
            .any(|[with, without]| errors_better(&with, &without) > SURELY)
    }

    /// Whether a file with this model surely serves better than one with the other: over whole windows in the
    /// mean, in most of them, in the median and in the sum of squares.
    #[must_use]
    pub fn serve_better(&self) -> bool {
        let [with, without] = with_and_without(&self.windows[0]);
        errors_better(&with, &without) > SURELY
            && mostly_smaller(&with, &without)
            && median(with.clone()) < median(without.clone())
            && rms(&with) < rms(&without)
    }
}

/// Pairs the windows of two models.
fn compared_windows(with: &[Vec<f64>], without: &[Vec<f64>]) -> Vec<Compared> {
    let mut windows = Vec::with_capacity(with.len());
    for (with, without) in with.iter().zip(without) {
        let change: Vec<f64> = with.iter().zip(without).map(|(a, b)| a - b).collect();
        windows.push(Compared { with: rms(with), without: rms(without), change: rms(&change) });
    }
    windows
}

/// The windows with the largest differences of the predictions, holding `ACTING` of their squares.
fn acting_windows(windows: &[Compared]) -> Vec<Compared> {
    let mut sorted = windows.to_vec();
    sorted.sort_by(|a, b| b.change.total_cmp(&a.change));
    let total: f64 = sorted.iter().map(|w| w.change * w.change).sum();
    let mut held = 0.0;
    let mut count = 0;
    while count < sorted.len() && held < ACTING * total {
        held += sorted[count].change * sorted[count].change;
        count += 1;
    }
    sorted.truncate(count);
    sorted
}

/// Residuals of all windows with and without the model.
fn with_and_without(windows: &[Compared]) -> [Vec<f64>; 2] {
    [windows.iter().map(|w| w.with).collect(), windows.iter().map(|w| w.without).collect()]
}

/// Residuals of the windows of each fold, with parameters fitted to the other folds.
fn crossed_residuals(folds: &[[Problem; 2]], model: &JointModel, noise: EffortNoise) -> Residuals {
    let parts: Vec<Residuals> = folds
        .par_iter()
        .map(|[fitted, other]| {
            window_residuals_of(other, &shooting_fit(fitted, model, None, noise, Free::All, Pace::WARM).model)
        })
        .collect();
    std::array::from_fn(|length| parts.iter().flat_map(|p| p[length].iter().cloned()).collect())
}

/// Whether significantly more windows are smaller than larger (sign test).
fn mostly_smaller(with: &[f64], without: &[f64]) -> bool {
    let signs =
        || with.iter().zip(without).filter(|(a, b)| a != b).map(|(a, b)| if a < b { 1.0 } else { -1.0 });
    signs().sum::<f64>() > SURELY * (signs().count() as f64).sqrt()
}

/// Whether the windows of some length are surely smaller, with less than half of the squares beyond the
/// noise.
fn is_better(with: &Sizes, without: &Sizes, floor: f64) -> bool {
    with.iter().zip(without).any(|(with, without)| surely_leaves(with, without, floor, 0.5))
}

/// Whether windows are surely smaller, with less than `share` of the squares beyond the noise.
fn surely_leaves(with: &[f64], without: &[f64], floor: f64, share: f64) -> bool {
    let beyond = |sizes: &[f64]| sizes.iter().map(|s| (s * s - floor * floor).max(0.0)).sum::<f64>();
    errors_better(with, without) > SURELY && beyond(with) < share * beyond(without)
}

/// Root mean square residuals of windows of each length under a model.
fn window_sizes_of(problem: &Problem, model: &JointModel) -> Sizes {
    sizes_of(&window_residuals_of(problem, model))
}

fn sizes_of(residuals: &Residuals) -> Sizes {
    std::array::from_fn(|length| residuals[length].iter().map(|r| rms(r)).collect())
}

/// Residuals of windows of each length under a model.
fn window_residuals_of(problem: &Problem, model: &JointModel) -> Residuals {
    LENGTHS.map(|share| {
        let problem = problem.with_windows(share);
        let (model, starts) = started_model(&problem, model);
        window_residuals(&problem, &model, &starts).into_iter().map(|(_, r)| r).collect()
    })
}

/// Mean of the pairwise differences `without - with`, in standard errors.
fn errors_better(with: &[f64], without: &[f64]) -> f64 {
    let n = with.len().max(2) as f64;
    let differences = || without.iter().zip(with).map(|(a, b)| a - b);
    let mean = differences().sum::<f64>() / n;
    let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if variance > 0.0 { mean / (variance / n).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Windows of two lengths, in each of which every sample is off by one number.
    fn windows(of: &[f64]) -> Residuals {
        std::array::from_fn(|_| of.iter().map(|x| vec![*x; 4]).collect())
    }

    #[test]
    fn windows_that_a_model_does_not_change_have_no_say() {
        let with = windows(&[1.0, 1.1, 0.9, 1.0, 5.0, 7.0, 3.0]);
        let without = windows(&[2.0, 2.1, 2.1, 2.0, 5.0, 7.0, 3.0]);
        let surely = errors_better_at_best(&with, &without);
        assert!(surely > 10.0, "{surely}");
        assert!((errors_better_at_best(&without, &with) + surely).abs() < 1e-9);
        assert_eq!(errors_better_at_best(&with, &with), 0.0);
    }

    #[test]
    fn a_few_much_better_windows_are_not_most() {
        let without = [1.0; 20];
        let few: Vec<f64> = (0..20).map(|k| if k < 6 { 0.01 } else { 1.01 }).collect();
        let most: Vec<f64> = (0..20).map(|k| if k < 16 { 0.9 } else { 1.1 }).collect();
        assert!(errors_better(&few, &without) > SURELY && !mostly_smaller(&few, &without));
        assert!(mostly_smaller(&most, &without));
    }

    #[test]
    fn a_held_out_run_in_which_nothing_acts_is_not_surely_worse() {
        let gap = |after: &[f64]| {
            let windows = after.iter().map(|a| WindowGap { before: 1.0, after: *a }).collect();
            Gap { before: 1.0, after: 1.0, noise_floor: 0.1, runs: Vec::new(), windows }
        };
        assert!(!is_surely_worse(&gap(&[1.0; 5])));
        assert!(!is_surely_worse(&gap(&[1.01, 0.99, 1.02, 0.99, 1.0])));
        assert!(is_surely_worse(&gap(&[1.2, 1.3, 1.25, 1.2, 1.3])));
        assert!(!is_surely_worse(&gap(&[0.2, 0.3, 0.25, 0.2, 0.3])));
    }
}
