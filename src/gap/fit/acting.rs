//! Efforts and friction bounds of a joint at a state, with their derivatives.

use crate::model::{
    effect::{At, Effect, MAX_PARAMETERS, Place, Response},
    joint_model::{Catalogue, JointModel},
    plant::Plant,
};

/// Columns of the sensitivities: start position, start velocity, then the parameters.
pub const MAX_COLUMNS: usize = 16;
/// One row of sensitivities.
pub type Row = [f64; MAX_COLUMNS];

/// Efforts at a state, summed over the plant and the model's terms.
#[derive(Clone, Copy, Debug, Default)]
pub struct EffortSum {
    /// Smooth effort, without the actuator's, N m or N.
    pub effort: f64,
    /// Derivative of both smooth and actuator effort with respect to position.
    pub q: f64,
    /// Derivative of both with respect to velocity.
    pub v: f64,
    /// Bound of the friction, N m or N.
    pub friction: f64,
    /// Its derivative with respect to position.
    pub friction_q: f64,
    /// Its derivative with respect to the measured effort.
    pub friction_u: f64,
    /// Share of the measured effort absorbed by contacts.
    pub taken: f64,
}

/// The terms of a model, looked up once for many states.
pub struct Acting<'a> {
    plant: &'a Plant,
    /// Every term: effect, place, parameters.
    terms: Vec<(&'a dyn Effect, Place, &'a [f64])>,
    has_contact: bool,
}

impl<'a> Acting<'a> {
    /// Looks up the terms of a model.
    pub fn of_model(model: &'a JointModel, catalogue: &'a Catalogue) -> Self {
        let mut terms = Vec::with_capacity(model.terms.len());
        for term in &model.terms {
            let effect = catalogue[term.effect].as_ref();
            terms.push((effect, effect.place(), term.p.as_slice()));
        }
        let has_contact = terms.iter().any(|t| t.1 == Place::Contact);
        Self { plant: &model.plant, terms, has_contact }
    }

    /// Efforts at a state, without derivatives with respect to parameters.
    pub fn efforts_at(&self, at: &At) -> EffortSum {
        self.add_up(at, &mut [0.0; MAX_COLUMNS], &mut [0.0; MAX_COLUMNS])
    }

    /// The first contact reached within `h` seconds by the joint moving at velocity `v`.
    #[inline]
    pub fn first_meeting(&self, q: f64, v: f64, h: f64) -> Option<Meeting> {
        if !self.has_contact {
            return None;
        }
        // Columns before those of the terms: start position, start velocity, lag.
        let mut first = None::<Meeting>;
        let mut column = 3;
        for (effect, _, p) in &self.terms {
            if let Some(i) = effect.contact_parameter() {
                // At rest this is infinite or NaN, and the comparisons below fail.
                let after_s = (p[i] - q) / v;
                let enters = (v > 0.0) == effect.is_upper();
                if enters && after_s > 0.0 && after_s < first.map_or(h, |f| f.after_s) {
                    first = Some(Meeting { after_s, position: p[i], column: column + i });
                }
            }
            column += p.len();
        }
        first
    }

    /// Sums plant and terms at a state. `effort` and `friction` receive the derivatives with respect to the
    /// parameters.
    #[inline]
    pub fn add_up(&self, at: &At, effort: &mut Row, friction: &mut Row) -> EffortSum {
        let plant = self.plant;
        let (load, slope) = plant.load_at(at.carried, at.q);
        // A change of inertia due to the motion of a chain acts as damping: d(I v)/dt = I a + dI/dt v.
        let damping = plant.damping + plant.inertia_at(at.carried).1;
        let mut sum = EffortSum {
            effort: -load - damping * at.v,
            q: at.feedback[0] - slope,
            v: at.feedback[1] - damping,
            friction: plant.friction,
            ..EffortSum::default()
        };
        let mut column = 3;
        for (effect, place, p) in &self.terms {
            if matches!(place, Place::Effort | Place::Friction) {
                let mut r = Response::default();
                effect.write_response(at, p, &mut r);
                let target = if *place == Place::Effort {
                    sum.effort += r.value;
                    sum.q += r.q;
                    sum.v += r.v;
                    &mut *effort
                } else {
                    // A negative bound would make friction drive the joint.
                    sum.friction += r.value.max(0.0);
                    sum.friction_q += r.q;
                    sum.friction_u += r.u;
                    &mut *friction
                };
                write_first(&mut target[column..], &r.p, p.len());
            }
            column += p.len();
        }
        sum.friction_q += sum.friction_u * at.feedback[0];
        if self.has_contact {
            self.add_contacts(at, effort, &mut sum);
        }
        sum
    }

    /// Adds the contacts, which act on the sum of the other efforts.
    fn add_contacts(&self, at: &At, effort: &mut Row, sum: &mut EffortSum) {
        let at = At { load: at.u + sum.effort, ..*at };
        let mut column = 3;
        for (effect, place, p) in &self.terms {
            let first = column;
            column += p.len();
            if *place != Place::Contact {
                continue;
            }
            let mut r = Response::default();
            effect.write_response(&at, p, &mut r);
            sum.effort += r.value;
            sum.q += r.q + r.load * sum.q;
            sum.v += r.v + r.load * sum.v;
            sum.taken -= r.load;
            // A contact absorbs the same share of the efforts and of their derivatives.
            if r.load != 0.0 {
                effort[3..].iter_mut().for_each(|x| *x *= 1.0 + r.load);
            }
            write_first(&mut effort[first..], &r.p, p.len());
        }
    }
}

/// Where a step meets a contact.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// Seconds from the start of the step.
    pub after_s: f64,
    /// Position where the contact begins, rad or m.
    pub position: f64,
    /// Column of this position in the sensitivities.
    pub column: usize,
}

/// Writes the first `count` values; the loop has a fixed length.
#[inline]
fn write_first(target: &mut [f64], values: &[f64; MAX_PARAMETERS], count: usize) {
    for (i, (t, x)) in target.iter_mut().zip(values).enumerate() {
        if i < count {
            *t = *x;
        }
    }
}

/// Bound of the friction on a joint reversing its motion: starting from rest, the bound of the direction it
/// leaves in; passing through rest, the larger bound of both directions.
pub fn bound_at_turn(acting: &Acting, at: &At, bound: f64, friction: &mut Row) -> f64 {
    let mut unused = [0.0; MAX_COLUMNS];
    let turned = At { direction: -at.direction, v: 0.0, ..*at };
    if at.v == 0.0 {
        return acting.add_up(&turned, &mut unused, friction).friction;
    }
    if bound <= 0.0 {
        return bound;
    }
    bound.max(acting.add_up(&turned, &mut unused, &mut [0.0; MAX_COLUMNS]).friction)
}
