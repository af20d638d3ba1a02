//! Forward simulation of one joint with its sensitivities to start state and parameters.
//! See docs/method.md (14.7).
//!
//! A step drifts for half its length, changes the velocity at the middle, and drifts for the other half.
//! Velocity-dependent efforts are linearly implicit. Friction is set-valued: where its bound suffices, it
//! brings the joint to rest within the model's settle time (within the step, if this is 0), so a sticking
//! joint stands still.

use crate::{
    fit::acting::{Acting, EffortSum, MAX_COLUMNS, Row, bound_at_turn},
    model::{
        actuator::Acted,
        effect::{At, Place, run_time_s},
        joint_model::{Catalogue, JointModel, Sensor, Settling},
    },
    record::{
        drive::Drive,
        log::{JointLog, Span},
    },
};

/// Most free parameters.
pub const MAX_FREE: usize = MAX_COLUMNS - 2;

/// Predicted positions of a window and their sensitivities; the buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    /// Predicted measurement at each sample.
    pub position: Vec<f64>,
    /// Its sensitivities, one row per sample.
    pub rows: Vec<Row>,
}

impl Rollout {
    fn push(&mut self, position: f64, row: &Row) {
        self.position.push(position);
        self.rows.push(*row);
    }
}

/// Start state of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Start {
    /// Position of the joint, rad or m.
    pub position: f64,
    /// Velocity, rad/s or m/s.
    pub velocity: f64,
    /// Position of the sensor within its play, -1 to 1.
    pub play: f64,
}

/// Number of columns for `free` parameters: start state, parameters, and one for the caller.
pub fn column_count(free: usize) -> usize {
    (3 + free).next_multiple_of(4).min(MAX_COLUMNS)
}

/// Simulates a window from a start state.
pub fn roll_window(
    model: &JointModel,
    catalogue: &Catalogue,
    log: &JointLog,
    drive: &Drive,
    span: Span,
    start: Start,
    out: &mut Rollout,
) {
    out.position.clear();
    out.rows.clear();
    let keep = |q: f64, row: &Row| out.push(q, row);
    match column_count(model.free_count()) {
        4 => roll_columns::<4>(model, catalogue, log, drive, span, start, keep),
        8 => roll_columns::<8>(model, catalogue, log, drive, span, start, keep),
        12 => roll_columns::<12>(model, catalogue, log, drive, span, start, keep),
        _ => roll_columns::<MAX_COLUMNS>(model, catalogue, log, drive, span, start, keep),
    };
}

/// Simulates a window with the sensitivities to its start state only, the first two columns of each row;
/// `each` receives the predicted measurement and the row. Returns the state at the last sample.
pub fn roll_starts(
    model: &JointModel,
    catalogue: &Catalogue,
    log: &JointLog,
    drive: &Drive,
    span: Span,
    start: Start,
    each: impl FnMut(f64, &Row),
) -> Start {
    roll_columns::<2>(model, catalogue, log, drive, span, start, each)
}

/// The model's scalars used in every step, and their columns.
struct Layout {
    gain: f64,
    gain_column: Option<usize>,
    /// Added inertia.
    added: f64,
    inertia_column: Option<usize>,
    delay_column: Option<usize>,
    /// Columns of the sensor's offset, scale and play.
    sensors: [Option<usize>; 3],
    /// Columns of the actuator's gain and damping.
    actuator: [Option<usize>; 2],
}

impl Layout {
    fn of_model(model: &JointModel, catalogue: &Catalogue) -> Self {
        // The first two columns are the start state.
        let scalar = |place| model.scalar_of(catalogue, place).map(|(x, at)| (x, at + 2));
        let column = |place| scalar(place).map(|s| s.1);
        let inertia = scalar(Place::Inertia);
        let gain = scalar(Place::Gain);
        Self {
            gain: gain.map_or(1.0, |g| g.0),
            gain_column: gain.map(|g| g.1),
            added: inertia.map_or(0.0, |i| i.0),
            inertia_column: inertia.map(|i| i.1),
            delay_column: column(Place::Delay),
            sensors: [Place::Bias, Place::Scale, Place::Play].map(column),
            actuator: model.actuator_columns().map(|c| c.map(|at| at + 2)),
        }
    }

    /// Sets the columns of parameters on the recorded signal's path; `by_delay` is the signal's derivative
    /// with respect to the delay, `q` the position read by a servo through the sensor.
    #[inline]
    fn by_drive(
        &self,
        sum: &EffortSum,
        acted: &Acted,
        by_delay: f64,
        q: f64,
        effort_p: &mut Row,
        friction_p: &mut Row,
    ) {
        // A contact absorbs its share of the acting effort too, and of its derivatives.
        let by_u = 1.0 - sum.taken;
        let by_delay = self.gain * acted.signal * by_delay;
        (effort_p[2], friction_p[2]) = (by_u * by_delay, sum.friction_u * by_delay);
        // Lag (column 2) and delay shift the same effort.
        if let Some(c) = self.delay_column {
            (effort_p[c], friction_p[c]) = (effort_p[2], friction_p[2]);
        }
        if let Some(c) = self.gain_column {
            (effort_p[c], friction_p[c]) = (by_u * acted.effort, sum.friction_u * acted.effort);
        }
        for (c, by) in self.actuator.iter().zip(acted.p) {
            if let Some(c) = *c {
                (effort_p[c], friction_p[c]) = (by_u * self.gain * by, sum.friction_u * self.gain * by);
            }
        }
        // A servo takes an error of its sensor for motion.
        for (c, by) in self.sensors.iter().zip([1.0, q]) {
            if let Some(c) = *c {
                let by = self.gain * acted.read * by;
                (effort_p[c], friction_p[c]) = (by_u * by, sum.friction_u * by);
            }
        }
    }
}

/// Least effective inertia, as a share of the inertia itself. The bound of the added inertia is derived for
/// the chain at rest; as other joints move, the sum could reach zero.
/// chosen: far below any plausible inertia.
pub const LEAST_INERTIA: f64 = 1e-3;

/// Inverse of an inertia with its addition.
pub fn inverse_inertia(inertia: f64, added: f64) -> f64 {
    1.0 / (inertia + added).max(LEAST_INERTIA * inertia)
}

/// State of a joint during a rollout, with the sensitivities of position and velocity.
struct Moving {
    q: f64,
    v: f64,
    dq: Row,
    dv: Row,
}

impl Moving {
    /// Advances the position at constant velocity.
    #[inline]
    fn drift_by<const W: usize>(&mut self, h: f64) {
        self.q += h * self.v;
        for c in 0..W {
            self.dq[c] += h * self.dv[c];
        }
    }

    /// Updates the sensitivities where a contact begins and the acceleration jumps by `leap`: the time of
    /// contact depends on the joint's position and on the contact's, parameter `column`.
    /// See docs/method.md (14.9).
    fn meet_contact<const W: usize>(&mut self, column: usize, leap: f64) {
        let rate = leap / self.v;
        for c in 0..W {
            // (14.9); the contact's own position counts with the opposite sign.
            self.dv[c] += rate * (self.dq[c] - f64::from(u8::from(c == column)));
        }
    }
}

/// Changes of velocity under the efforts of a model; the buffers are reused.
struct Kicks<'a> {
    acting: Acting<'a>,
    layout: Layout,
    /// Inverse of the inertia.
    inverse: f64,
    effort_p: Row,
    friction_p: Row,
}

impl Kicks<'_> {
    /// Changes the velocity by the efforts at a state over `h` seconds; `acted` is the actuator's effort,
    /// `by_delay` its signal's derivative with respect to the delay.
    #[inline]
    fn kick_by<const W: usize>(
        &mut self,
        moving: &mut Moving,
        at: &At,
        h: f64,
        settling: &Settling,
        acted: &Acted,
        by_delay: f64,
    ) {
        let inverse = self.inverse;
        let v = moving.v;
        let mut sum = self.acting.add_up(at, &mut self.effort_p, &mut self.friction_p);
        self.layout.by_drive(&sum, acted, by_delay, at.q, &mut self.effort_p, &mut self.friction_p);
        let total = at.u + sum.effort;
        // (14.7): implicit in the velocity, so strong damping does not overshoot; the floor limits the step
        // if an effort drives the joint.
        let kick = h * inverse / (1.0 - (0.5 * h * sum.v * inverse)).max(0.5);
        // The velocity change is divided by the inertia: its derivative acts as an effort of -total / I.
        if let Some(c) = self.layout.inertia_column {
            (self.effort_p[c], self.friction_p[c]) = (-total * inverse, -sum.friction * inverse);
        }
        let free = v + kick * total;
        // The joint would reverse within the step, where another friction bound may hold it.
        if free * at.direction < 0.0 {
            sum.friction = bound_at_turn(&self.acting, at, sum.friction, &mut self.friction_p);
        }
        let bound = kick * sum.friction;
        // The velocity of a joint held by friction, (14.7) and (14.8).
        let target = settling.keep * v + settling.creep * kick * total;
        let taken = free - target;
        let dq = &moving.dq;
        let dv = &mut moving.dv;
        if taken.abs() <= bound {
            moving.v = target;
            // Sticking: friction compensates any change by the parameters, except for the creep.
            let creep = settling.creep * kick;
            for c in 0..W {
                dv[c] = (settling.keep + creep * sum.v) * dv[c] + creep * (sum.q * dq[c] + self.effort_p[c]);
            }
        } else {
            // Sliding: friction acts at its bound, which depends on position and parameters.
            let sign = taken.signum();
            moving.v = free - sign * bound;
            let by_q = kick * (sum.q - sign * sum.friction_q);
            let by_v = 1.0 + kick * sum.v;
            for c in 0..W {
                dv[c] = by_v * dv[c] + by_q * dq[c] + kick * (self.effort_p[c] - sign * self.friction_p[c]);
            }
        }
    }

    /// Jump of the acceleration where a contact begins, from a state before it, for a step of `h` seconds.
    fn acceleration_leap(&self, at: &At, position: f64, h: f64) -> f64 {
        // A contact's damping sets in at once, so the effort differs between both sides.
        let side = |by: f64| self.acting.efforts_at(&At { q: position + by * at.direction, ..*at });
        let before = side(-BESIDE);
        let after = side(BESIDE);
        let implicit = (1.0 - 0.5 * h * after.v * self.inverse).max(0.5);
        self.inverse * (after.effort - before.effort) / (implicit * implicit)
    }
}

/// Distance for evaluating just before and after a contact, rad or m.
/// chosen: some thousand times the rounding error of a position of 1.
const BESIDE: f64 = 1e-12;

/// Simulates a window with `W` columns; returns the state at its last sample.
fn roll_columns<const W: usize>(
    model: &JointModel,
    catalogue: &Catalogue,
    log: &JointLog,
    drive: &Drive,
    span: Span,
    start: Start,
    mut each: impl FnMut(f64, &Row),
) -> Start {
    let sensor = model.position_sensor(catalogue);
    let layout = Layout::of_model(model, catalogue);
    let gain = layout.gain;
    let added = layout.added;
    let sensors = layout.sensors;
    let inverse = inverse_inertia(model.plant.inertia, added);
    let row = [0.0; MAX_COLUMNS];
    let mut kicks =
        Kicks { acting: Acting::of_model(model, catalogue), layout, inverse, effort_p: row, friction_p: row };
    let mut moving = Moving { q: start.position, v: start.velocity, dq: row, dv: row };
    (moving.dq[0], moving.dv[1]) = (1.0, 1.0);
    let mut gauge = moving.q + start.play * sensor.half_gap;
    let mut dgauge = moving.dq;
    if let Some(c) = sensors[2] {
        dgauge[c] = start.play;
    }
    let mut settled_h = f64::NAN;
    let mut settling = Settling::default();
    for k in span.start..span.start + span.len {
        measure_position::<W>(moving.q, &moving.dq, &sensor, sensors, &mut gauge, &mut dgauge, &mut each);
        if k + 1 == span.start + span.len {
            break;
        }
        let step = (log.time_s[k + 1] - log.time_s[k]) / drive.steps as f64;
        let t = run_time_s(span.log, log, k);
        let others_now = log.others_after(k);
        let carried = log.carried.get(k);
        if let Some(c) = carried {
            kicks.inverse = inverse_inertia(c.inertia, added);
        }
        for s in 0..drive.steps {
            let index = k * drive.steps + s;
            let signal = drive.signal[index];
            let by_delay = drive.by_delay[index];
            // A step across the start of a contact is split, or the contact would act too long or too late.
            let meeting = kicks.acting.first_meeting(moving.q, moving.v, step);
            let before = meeting.map_or(step, |m| m.after_s);
            for (h, meeting) in [(before, None), (step - before, meeting)]
                .into_iter()
                .take(if meeting.is_some() { 2 } else { 1 })
            {
                // Most steps are equally long, and exponentials are expensive.
                if h != settled_h {
                    (settled_h, settling) = (h, Settling::over_step(model.settle_s, h));
                }
                // At rest either direction will do: the velocity change looks up the direction of motion.
                let direction = if moving.v != 0.0 { moving.v.signum() } else { 1.0 };
                let t = t + (s as f64 + 0.5) * step;
                // The velocity changes after the first half drift, under the efforts at the middle of the
                // step.
                let q = moving.q + 0.5 * h * moving.v;
                let v = moving.v;
                let acted = model.plant.actuator.effort_under(signal, q, v, (sensor.scale, sensor.bias));
                let at = At {
                    q,
                    v,
                    u: gain * acted.effort,
                    feedback: [gain * acted.q, gain * acted.v],
                    t,
                    direction,
                    others: &others_now,
                    load: 0.0,
                    carried,
                };
                if let Some(m) = meeting {
                    moving.meet_contact::<W>(m.column, kicks.acceleration_leap(&at, m.position, h));
                }
                moving.drift_by::<W>(0.5 * h);
                kicks.kick_by::<W>(&mut moving, &at, h, &settling, &acted, by_delay);
                moving.drift_by::<W>(0.5 * h);
            }
        }
    }
    let Moving { q, v, .. } = moving;
    let play = if sensor.half_gap > 0.0 { (gauge - q) / sensor.half_gap } else { start.play };
    Start { position: q, velocity: v, play }
}

/// Passes the position through the sensor's play, scale and offset.
#[inline]
fn measure_position<const W: usize>(
    q: f64,
    dq: &Row,
    sensor: &Sensor,
    columns: [Option<usize>; 3],
    gauge: &mut f64,
    dgauge: &mut Row,
    each: &mut impl FnMut(f64, &Row),
) {
    let half = sensor.half_gap;
    // Without a gap the gauge follows the joint; within a gap it stands still, and so do its sensitivities.
    let side = if *gauge < q - half || half == 0.0 {
        -1.0
    } else if *gauge > q + half {
        1.0
    } else {
        0.0
    };
    if side != 0.0 {
        *gauge = q + side * half;
        dgauge[..W].copy_from_slice(&dq[..W]);
        if let Some(c) = columns[2] {
            dgauge[c] += side;
        }
    }
    let mut row = [0.0; MAX_COLUMNS];
    for i in 0..W {
        row[i] = sensor.scale * dgauge[i];
    }
    if let Some(c) = columns[0] {
        row[c] += 1.0;
    }
    if let Some(c) = columns[1] {
        row[c] += *gauge;
    }
    each(sensor.scale * *gauge + sensor.bias, &row);
}
