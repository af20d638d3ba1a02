//! A joint with effects: the twin's plant and the terms added to it.

use crate::model::{
    effect::{At, Effect, Place, Response},
    plant::Plant,
};

/// The effects, by index.
pub type Catalogue = [Box<dyn Effect>];

/// An effect with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// Index in the catalogue.
    pub effect: usize,
    /// Parameters.
    pub p: Vec<f64>,
}

impl Term {
    /// Effort of the effect at a state, or its friction bound, N m or N.
    pub fn value_at(&self, catalogue: &Catalogue, at: &At) -> f64 {
        let mut response = Response::default();
        catalogue[self.effect].write_response(at, &self.p, &mut response);
        response.value
    }
}

/// A plant with added effects.
#[derive(Clone, Debug, PartialEq)]
pub struct JointModel {
    /// The twin's joint.
    pub plant: Plant,
    /// Added effects.
    pub terms: Vec<Term>,
    /// Offset between the stamps of effort and position, seconds: a nuisance with a tight prior, never
    /// reported.
    pub lag_s: f64,
    /// Time in which friction brings the joint to rest, seconds; 0 is exact sticking. A nuisance, see
    /// [`SETTLE_S`].
    pub settle_s: f64,
}

/// Tried settle times of friction, seconds. Exact sticking is the ideal; friction of compliant contacts, and
/// of simulators with soft friction, stops the joint within a few milliseconds.
/// derived: none; the time constant of a soft constraint, 20 ms by default in MuJoCo; and its halves down to
/// one step of a rollout, below which settling is sticking.
pub const SETTLE_S: [f64; 4] = [0.0, 0.005, 0.01, 0.02];

/// Share of the load still moving a joint held by settling friction (creep), as for a soft constraint of
/// impedance 0.9.
/// derived: one minus the impedance, MuJoCo's default.
pub const CREEP: f64 = 0.1;

/// Velocity of a joint held by friction after one step: `keep * v + creep * kick`, with `kick` the velocity
/// change by the other efforts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settling {
    /// Share of the velocity remaining.
    pub keep: f64,
    /// Share of the other efforts still acting.
    pub creep: f64,
}

impl Settling {
    /// For a settle time and a step, both in seconds.
    pub fn over_step(settle_s: f64, step_s: f64) -> Self {
        // Exact sticking, the limit of (14.8) at T = 0: no velocity remains, and nothing creeps.
        if !(settle_s > 0.0 && step_s > 0.0) {
            return Self::default();
        }
        // docs/method.md (14.8).
        let keep = (-step_s / settle_s).exp();
        Self { keep, creep: CREEP * settle_s * (1.0 - keep) / step_s }
    }
}

impl JointModel {
    /// The twin's joint without effects.
    pub fn of_plant(plant: &Plant) -> Self {
        Self { plant: plant.clone(), terms: Vec::new(), lag_s: 0.0, settle_s: 0.0 }
    }

    /// The model without effects, with its actuator as fitted.
    #[must_use]
    pub fn without_effects(&self) -> Self {
        let lag_s = if self.plant.actuator.is_late { self.lag_s } else { 0.0 };
        Self { lag_s, ..Self::of_plant(&self.plant) }
    }

    /// Whether friction acts on the joint.
    pub fn has_friction(&self, catalogue: &Catalogue) -> bool {
        self.plant.friction > 0.0 || self.terms.iter().any(|t| catalogue[t.effect].place() == Place::Friction)
    }

    /// Indices of its effects, sorted.
    pub fn effect_indices(&self) -> Vec<usize> {
        let mut effects: Vec<usize> = self.terms.iter().map(|t| t.effect).collect();
        effects.sort_unstable();
        effects
    }

    /// Names of its effects, in the order of the catalogue.
    #[must_use]
    pub fn effect_names(&self, catalogue: &Catalogue) -> Vec<&'static str> {
        self.effect_indices().into_iter().map(|e| catalogue[e].name()).collect()
    }

    /// Number of free parameters, the lag included.
    pub fn free_count(&self) -> usize {
        1 + self.terms.iter().map(|t| t.p.len()).sum::<usize>() + self.plant.actuator.found_count()
    }

    /// All free parameters: the lag, the terms' parameters, and those fitted of the actuator.
    pub fn free_parameters(&self) -> Vec<f64> {
        let terms = self.terms.iter().flat_map(|t| t.p.iter().copied());
        std::iter::once(self.lag_s).chain(terms).chain(self.plant.actuator.found_values()).collect()
    }

    /// The model with other parameters.
    #[must_use]
    pub fn with_parameters(&self, parameters: &[f64]) -> Self {
        let mut model = self.clone();
        model.lag_s = parameters[0];
        let mut at = 1;
        for term in &mut model.terms {
            let n = term.p.len();
            term.p.copy_from_slice(&parameters[at..at + n]);
            at += n;
        }
        model.plant.actuator = model.plant.actuator.with_found(&parameters[at..]);
        model
    }

    /// Indices of the actuator's gain and damping among the free parameters, if they are fitted.
    pub fn actuator_columns(&self) -> [Option<usize>; 2] {
        let first = self.free_count() - self.plant.actuator.found_count();
        let [gain, damping] = self.plant.actuator.is_found;
        [gain.then_some(first), damping.then_some(first + usize::from(gain))]
    }

    /// The model with one more effect.
    #[must_use]
    pub fn with_effect(&self, effect: usize, p: &[f64]) -> Self {
        let mut model = self.clone();
        model.terms.push(Term { effect, p: p.to_vec() });
        model
    }

    /// The terms, each with the index of its first parameter among the free ones.
    pub fn placed_terms(&self) -> impl Iterator<Item = (usize, &Term)> {
        // Parameter 0 is the lag.
        self.terms.iter().scan(1, |next, term| {
            let at = *next;
            *next += term.p.len();
            Some((at, term))
        })
    }

    /// The first parameter of the term at a place, and its index among the free parameters.
    pub fn scalar_of(&self, catalogue: &Catalogue, place: Place) -> Option<(f64, usize)> {
        self.placed_terms().find(|(_, t)| catalogue[t.effect].place() == place).map(|(at, t)| (t.p[0], at))
    }

    /// Total delay of the effort, seconds: the nuisance lag, plus the delay if the model has one.
    pub fn delay_s(&self, catalogue: &Catalogue) -> f64 {
        self.plant.actuator.delay_s
            + self.lag_s
            + self.scalar_of(catalogue, Place::Delay).map_or(0.0, |(d, _)| d)
    }

    /// The sensor of the joint's position under this model.
    pub fn position_sensor(&self, catalogue: &Catalogue) -> Sensor {
        let of = |place, neutral| self.scalar_of(catalogue, place).map_or(neutral, |(x, _)| x);
        Sensor { bias: of(Place::Bias, 0.0), scale: of(Place::Scale, 1.0), half_gap: of(Place::Play, 0.0) }
    }
}

/// Measurement of the position: `scale * play(q) + bias`. See docs/method.md (14.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Offset of the measured position.
    pub bias: f64,
    /// Factor of the measured position.
    pub scale: f64,
    /// Half the gap of the play.
    pub half_gap: f64,
}
