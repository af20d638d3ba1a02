//! Named effects: parameters with intervals, alternatives, and whether they are certain.

use crate::{
    fit::problem::Problem,
    judge::spread::Spread,
    model::{
        effect::{Dimension, RUN_SPACING_S, Reported},
        joint_model::{Catalogue, JointModel, Term},
    },
};

/// A parameter with its interval.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterEstimate {
    /// Name.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// 95 % interval.
    pub interval: (f64, f64),
    /// Why the runs leave it open.
    pub open: Option<Open>,
}

impl ParameterEstimate {
    /// An estimate from its value and half the width of its 95 % interval.
    #[must_use]
    pub fn with_half_width(name: &str, value: f64, unit: &str, half: f64) -> Self {
        let interval = (value - half, value + half);
        Self { name: name.to_owned(), value, unit: unit.to_owned(), interval, open: None }
    }

    /// The parameter with its interval.
    #[must_use]
    pub fn in_words(&self) -> String {
        let Self { name, value, unit, interval: (low, high), open } = self;
        match open {
            Some(Open::AtBound) => format!("{name} not determined (at its bound, {value:.4})"),
            Some(Open::Wide) => format!("{name} not determined"),
            None => format!("{name} {value:.4} [{low:.4}, {high:.4}] {unit}"),
        }
    }
}

/// Why runs do not determine a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Open {
    /// It is as far from no effect as it may be: what limits it is not the recording.
    AtBound,
    /// Its interval is infinite or covers orders of magnitude.
    Wide,
}

impl Open {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AtBound => "at_bound",
            Self::Wide => "wide",
        }
    }
}

/// Half width from which an interval is that of an undetermined parameter, in multiples of the parameter.
/// chosen: from there on it covers another order of magnitude
const WIDE: f64 = 9.0;

/// A named effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Index in the catalogue.
    pub index: usize,
    /// Name.
    pub effect: String,
    /// Parameters.
    pub parameters: Vec<ParameterEstimate>,
    /// Weight of the sets containing it, among those of the same size.
    pub weight: f64,
    /// Other effects explaining the recording equally well, with their weights.
    pub alternatives: Vec<(String, f64)>,
    /// The recording to decide between them.
    pub experiment: String,
    /// Whether it is certainly present. An uncertain effect is not named, but files hold it where it improves
    /// unseen windows.
    pub is_sure: bool,
}

impl Finding {
    /// Whether the runs determine any of its parameters. Else it is no name.
    #[must_use]
    pub fn is_determined(&self) -> bool {
        self.parameters.iter().any(|p| p.open.is_none())
    }
}

/// Weight of the sets containing `effect`, and the effects replacing it in the other sets; `own` is the found
/// set.
#[must_use]
pub fn weight_and_alternatives(
    catalogue: &Catalogue,
    own: &[usize],
    effect: usize,
    rivals: &[(Vec<usize>, f64)],
    total: f64,
) -> (f64, Vec<(String, f64)>) {
    let (with, without): (Vec<_>, Vec<_>) = rivals.iter().partition(|(effects, _)| effects.contains(&effect));
    let mut alternatives: Vec<(String, f64)> = Vec::new();
    for (effects, weight) in without {
        for other in effects.iter().filter(|e| !own.contains(e)) {
            let name = catalogue[*other].name();
            match alternatives.iter_mut().find(|(known, _)| known == name) {
                Some((_, known)) => *known += weight / total,
                None => alternatives.push((name.to_owned(), weight / total)),
            }
        }
    }
    ((1.0 + with.iter().map(|(_, weight)| weight).sum::<f64>()) / total, alternatives)
}

/// A reported number of a term with its interval; the term's columns start at `at`.
fn parameter_estimate(
    problem: &Problem,
    term: &Term,
    at: usize,
    r: &Reported,
    spread: &Spread,
) -> ParameterEstimate {
    let effect = &problem.catalogue[term.effect];
    let n = term.p.len();
    let half = spread.half_width(at, &r.gradient[..n]);
    let value = if r.name == "time" { r.value % RUN_SPACING_S } else { r.value };
    // A parameter bounded below by zero has no negative interval.
    let positive = (0..n).any(|i| {
        r.gradient[i] == 1.0 && r.value == term.p[i] && effect.parameter_bounds(i, &problem.coverage).0 == 0.0
    });
    let low = if positive { (value - half).max(0.0) } else { value - half };
    ParameterEstimate {
        name: r.name.to_owned(),
        value,
        unit: r.dimension.unit_name(problem.turns).to_owned(),
        interval: (low, value + half),
        open: reason_open(problem, term, r, half),
    }
}

/// Why a number of a term is left open, given the half width of its interval.
fn reason_open(problem: &Problem, term: &Term, r: &Reported, half: f64) -> Option<Open> {
    let effect = &problem.catalogue[term.effect];
    for (i, p) in term.p.iter().enumerate().filter(|(i, _)| r.gradient[*i] != 0.0) {
        let (low, high) = effect.parameter_bounds(i, &problem.coverage);
        // Where it has no effect, the bound is what is found.
        let is_neutral = effect.parameters()[i].neutral == Some(*p);
        if (*p <= low || *p >= high) && !is_neutral {
            return Some(Open::AtBound);
        }
    }
    // Places and times count from where the motion begins, not from 0.
    let scale = match r.dimension {
        Dimension::Position => r.value.abs().max(problem.coverage.travel),
        Dimension::Time => {
            r.value.abs().max(problem.coverage.durations_s.iter().copied().fold(0.0, f64::max))
        }
        _ => r.value.abs(),
    };
    let is_wide = !r.value.is_finite() || !(half <= WIDE * scale);
    is_wide.then_some(Open::Wide)
}

/// The findings of a model with their weights: `rivals` are other sets of the same size with their weights,
/// `total` is the sum of all weights, the model's own included.
#[must_use]
pub fn findings_of_model(
    problem: &Problem,
    model: &JointModel,
    spread: &Spread,
    rivals: &[(Vec<usize>, f64)],
    total: f64,
) -> Vec<Finding> {
    let own = model.effect_indices();
    let mut findings = Vec::new();
    for (at, term) in model.placed_terms() {
        let effect = &problem.catalogue[term.effect];

        let reported = effect.reported_parameters(&term.p).into_iter();
        let (weight, alternatives) =
            weight_and_alternatives(problem.catalogue, &own, term.effect, rivals, total);
        findings.push(Finding {
            index: term.effect,
            effect: effect.name().to_owned(),
            parameters: reported.map(|r| parameter_estimate(problem, term, at, &r, spread)).collect(),
            weight,
            alternatives,
            experiment: effect.effect_spec().experiment.to_owned(),
            is_sure: true,
        });
    }
    findings
}

/// The fitted actuator parameters of a model, with intervals.
#[must_use]
pub fn actuator_estimates(model: &JointModel, spread: &Spread, turns: bool) -> Vec<ParameterEstimate> {
    let actuator = &model.plant.actuator;
    let [gain, damping] = model.actuator_columns();
    let mut all = Vec::new();
    if let Some(at) = gain {
        let (name, unit, scale) = match actuator.servo {
            Some(servo) => ("stiffness", Dimension::Stiffness.unit_name(turns), servo.stiffness),
            None => ("gain", if turns { "N m per unit" } else { "N per unit" }, actuator.unit),
        };
        all.push(ParameterEstimate::with_half_width(
            name,
            scale * actuator.gain,
            unit,
            spread.half_width(at, &[scale]),
        ));
    }
    if let Some(at) = damping {
        let unit = Dimension::Damping.unit_name(turns);
        all.push(ParameterEstimate::with_half_width(
            "damping",
            actuator.damping,
            unit,
            spread.half_width(at, &[1.0]),
        ));
    }
    if actuator.is_late {
        // The lag is the first of the free parameters.
        let half = spread.half_width(0, &[1.0]);
        all.push(ParameterEstimate::with_half_width("delay", actuator.delay_s + model.lag_s, "s", half));
    }
    all
}
