//! Efforts at a joint for each moment of the recorded motion.

use crate::{
    fit::problem::Problem,
    model::{
        effect::{At, Place, run_time_s},
        joint_model::JointModel,
    },
    record::carried::Carried,
};

/// A moment between two samples.
#[derive(Clone, Copy, Debug)]
pub struct Observed<'a> {
    /// Index of the log.
    pub log: usize,
    /// Index of the window.
    pub window: usize,
    /// Position of the joint, rad or m.
    pub q: f64,
    /// Velocity, rad/s or m/s.
    pub v: f64,
    /// Acceleration of the model. The acceleration of the recorded motion has the errors of its positions,
    /// and a plot over it would follow these.
    pub a: f64,
    /// The model's acceleration a few samples before and after: its errors are independent of those of the
    /// effort here.
    pub about: f64,
    /// Measured effort, N m or N.
    pub u: f64,
    /// Seconds on the common axis of the runs.
    pub t: f64,
    /// Positions of the other joints, rad or m.
    pub others: [f64; 8],
    carried: Option<&'a Carried>,
    /// The twin's missing effort: required by the motion, minus the measured and the twin's own effort, N m
    /// or N.
    pub lacking: f64,
    /// Effort of the model's effects, N m or N.
    pub found: f64,
}

impl Observed<'_> {
    /// The joint state at this moment, as needed by an effect.
    #[must_use]
    pub fn effect_state(&self) -> At<'_> {
        At {
            q: self.q,
            v: self.v,
            u: self.u,
            feedback: [0.0; 2],
            t: self.t,
            direction: if self.v < 0.0 { -1.0 } else { 1.0 },
            others: &self.others,
            load: 0.0,
            carried: self.carried,
        }
    }
}

/// All moments within the windows of the runs, as a model's sensor sees them.
#[must_use]
pub fn observed_moments<'a>(problem: &'a Problem, model: &JointModel) -> Vec<Observed<'a>> {
    let plant = &problem.plant;
    let sensor = model.position_sensor(problem.catalogue);
    let drives = problem.model_drives(model);
    let mut seen = Vec::new();
    for (window, span) in problem.windows.iter().enumerate() {
        let log = &problem.logs[span.log];
        let trace = &problem.traces[span.log];
        let drive = &drives[span.log];
        let first = seen.len();
        for k in span.start..span.start + span.len - 1 {
            let dt = log.time_s[k + 1] - log.time_s[k];
            let carried = log.carried.get(k);
            let q = (0.5 * (trace.position[k] + trace.position[k + 1]) - sensor.bias) / sensor.scale;
            let v = 0.5 * (trace.velocity[k] + trace.velocity[k + 1]) / sensor.scale;
            let recorded = (trace.velocity[k + 1] - trace.velocity[k]) / (dt * sensor.scale).max(1e-12);
            // If a delay was found, the efforts at the time they act.
            let u = model
                .plant
                .actuator
                .effort_under(drive.mean_after(k), q, v, (sensor.scale, sensor.bias))
                .effort;
            // (14.3), solved for the effort.
            let inertia = plant.inertia_at(carried).0;
            let smooth = plant.net_effort(carried, q, v, u);
            let rubs = plant.friction * v.signum();
            let lacking = inertia * recorded + rubs - smooth;
            let t = run_time_s(span.log, log, k);
            let others = log.others_after(k);
            let log = span.log;
            let found = 0.0;
            let a = 0.0;
            let about = 0.0;
            let mut o = Observed { log, window, q, v, a, about, u, t, others, carried, lacking, found };
            let acts = found_beside_inertia(problem, model, &o, smooth);
            let added = model.scalar_of(problem.catalogue, Place::Inertia).map_or(0.0, |(x, _)| x);
            o.a = (smooth - rubs + acts) / (inertia + added);
            o.found = acts - added * o.a;
            seen.push(o);
        }
        set_accelerations_beside(&mut seen[first..]);
    }
    seen
}

/// Offsets of neighboring samples; the mean of their accelerations stands in for the acceleration between.
const BESIDE: [usize; 2] = [2, 3];

/// Sets `about` for the moments of a window.
fn set_accelerations_beside(window: &mut [Observed]) {
    let a: Vec<f64> = window.iter().map(|o| o.a).collect();
    for (k, o) in window.iter_mut().enumerate() {
        let others = BESIDE.into_iter().flat_map(|d| [k.checked_sub(d), Some(k + d)]);
        let others: Vec<f64> = others.flatten().filter_map(|i| a.get(i).copied()).collect();
        o.about = others.iter().sum::<f64>() / others.len().max(1) as f64;
    }
}

/// Effort of a model's effects at a moment, except an added inertia; `smooth` is the effort without them.
fn found_beside_inertia(problem: &Problem, model: &JointModel, o: &Observed, smooth: f64) -> f64 {
    let gain = model.scalar_of(problem.catalogue, Place::Gain).map_or(1.0, |(x, _)| x);
    let mut sum = (gain - 1.0) * o.u;
    let mut at = At { u: gain * o.u, ..o.effect_state() };
    let of = |place: Place| model.terms.iter().filter(move |t| problem.catalogue[t.effect].place() == place);
    for term in of(Place::Effort) {
        sum += term.value_at(problem.catalogue, &at);
    }
    // A contact acts on the sum of the other efforts.
    at.load = smooth + sum;
    for term in of(Place::Contact) {
        sum += term.value_at(problem.catalogue, &at);
    }
    for term in of(Place::Friction) {
        sum -= term.value_at(problem.catalogue, &at).max(0.0) * at.direction;
    }
    sum
}
