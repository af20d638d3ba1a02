//! Derivatives of every effect and of the rollout against central differences.

use crate::{
    fit::rollout::{Rollout, Start, roll_window},
    model::{
        actuator::{Actuator, Servo},
        effect::{At, Coverage, Effect, Place, Response},
        effects::catalogue,
        joint_model::JointModel,
        plant::{Load, Plant},
    },
    record::{
        drive::{Drive, Hold},
        log::{JointLog, Span},
    },
};

fn coverage() -> Coverage {
    Coverage {
        position: (-0.3, 1.4),
        travel: 1.7,
        speed: (0.5, 2.0),
        effort_rms: 6.0,
        interval_s: 0.005,
        inertia: 2.0,
        damping: 0.3,
        position_noise: 1e-3,
        durations_s: vec![10.0, 10.0],
        others: 1,
        turns: true,
        has_load_slope: true,
        in_chain: false,
    }
}

/// Parameters at which an effect acts.
fn acting(effect: &dyn Effect) -> Vec<f64> {
    let shapes = effect.start_shapes(&coverage());
    let mut p = shapes[shapes.len() / 2].clone();
    for (i, spec) in effect.parameters().iter().enumerate() {
        if spec.neutral.is_some() {
            p[i] += 0.3 + 0.1 * i as f64;
        }
    }
    p
}

fn value(effect: &dyn Effect, at: &At, p: &[f64]) -> f64 {
    let mut r = Response::default();
    effect.write_response(at, p, &mut r);
    r.value
}

#[test]
fn effects_have_the_derivatives_that_they_claim() {
    for effect in
        catalogue(1).iter().filter(|e| matches!(e.place(), Place::Effort | Place::Contact | Place::Friction))
    {
        let p = acting(effect.as_ref());
        let mut acted = false;
        for step in 0..60 {
            let x = f64::from(step) / 60.0;
            let t = if effect.name() == "disturbance" { p[1] + 0.2 * (x - 0.5) } else { x };
            let at = At {
                feedback: [0.0; 2],
                q: -0.25 + 1.6 * x,
                v: 0.7 * (9.0 * x).sin() + 0.01,
                u: 3.0 - 5.0 * x,
                t,
                direction: 1.0,
                others: &[0.4],
                load: 2.0 - x,
                carried: None,
            };
            let mut r = Response::default();
            effect.write_response(&at, &p, &mut r);
            acted |= r.value != 0.0;
            let h = 1e-6;
            let difference = |up: f64, down: f64| (up - down) / (2.0 * h);
            let by_q = difference(
                value(effect.as_ref(), &At { q: at.q + h, ..at }, &p),
                value(effect.as_ref(), &At { q: at.q - h, ..at }, &p),
            );
            let by_v = difference(
                value(effect.as_ref(), &At { v: at.v + h, ..at }, &p),
                value(effect.as_ref(), &At { v: at.v - h, ..at }, &p),
            );
            let near = |a: f64, b: f64| (a - b).abs() < 1e-4 * (1.0 + a.abs().max(b.abs()));
            assert!(near(r.q, by_q), "{} by position at {x}: {} {by_q}", effect.name(), r.q);
            let by_load = difference(
                value(effect.as_ref(), &At { load: at.load + h, ..at }, &p),
                value(effect.as_ref(), &At { load: at.load - h, ..at }, &p),
            );
            assert!(near(r.load, by_load), "{} by load at {x}: {} {by_load}", effect.name(), r.load);
            assert!(near(r.v, by_v), "{} by velocity at {x}: {} {by_v}", effect.name(), r.v);
            for i in 0..p.len() {
                // Times are large numbers; a finer step would be lost in rounding.
                let h = if effect.name() == "disturbance" { 1e-5 } else { 1e-6 };
                let mut up = p.clone();
                let mut down = p.clone();
                up[i] += h;
                down[i] -= h;
                let by_p =
                    (value(effect.as_ref(), &at, &up) - value(effect.as_ref(), &at, &down)) / (2.0 * h);
                assert!(
                    (r.p[i] - by_p).abs() < 1e-3 * (1.0 + by_p.abs()),
                    "{} by parameter {i} at {x}: {} {by_p}",
                    effect.name(),
                    r.p[i]
                );
            }
        }
        assert!(acted, "{} never acted", effect.name());
    }
}

fn log() -> JointLog {
    let n = 200;
    let time_s: Vec<f64> = (0..n).map(|k| 0.005 * f64::from(k)).collect();
    let effort = time_s.iter().map(|t| 6.0 * (7.0 * t).sin() + 2.0).collect();
    JointLog {
        run: "r".into(),
        position: vec![0.0; time_s.len()],
        effort,
        others: vec![vec![0.2; time_s.len()]],
        time_s,
        ..JointLog::default()
    }
}

fn plant() -> Plant {
    Plant {
        inertia: 2.0,
        damping: 0.3,
        friction: 0.1,
        load: Load { constant: 0.0, sine: 0.4, cosine: 1.0 },
        most_load: 2.0,
        actuator: Actuator::default(),
    }
}

fn last(model: &JointModel, start: Start) -> (f64, [f64; 16]) {
    last_of(&log(), model, start, 1)
}

fn last_of(log: &JointLog, model: &JointModel, start: Start, steps: usize) -> (f64, [f64; 16]) {
    let effects = catalogue(1);
    let drive = Drive::with_steps(log, Hold::Sampled, model.delay_s(&effects), steps);
    let mut out = Rollout::default();
    roll_window(model, &effects, log, &drive, Span { log: 0, start: 0, len: 200 }, start, &mut out);
    (out.position[199], out.rows[199])
}

/// Sensitivities of a rollout's end to every parameter against central differences.
fn assert_sensitivities(
    end: &dyn Fn(&JointModel) -> (f64, [f64; 16]),
    model: &JointModel,
    allowed: f64,
    what: &str,
) {
    let row = end(model).1;
    let parameters = model.free_parameters();
    for i in 0..parameters.len() {
        let h = 1e-5 * (1.0 + parameters[i].abs());
        let shifted = |by: f64| {
            let mut p = parameters.clone();
            p[i] += by;
            end(&model.with_parameters(&p)).0
        };
        let slope = (shifted(h) - shifted(-h)) / (2.0 * h);
        assert!(
            (row[2 + i] - slope).abs() < allowed * (0.02 + slope.abs()),
            "{what} column {i}: {} {slope}",
            row[2 + i]
        );
    }
}

#[test]
fn rollouts_have_the_sensitivities_that_they_claim() {
    let start = Start { position: 0.3, velocity: 0.4, play: -1.0 };
    for (index, effect) in catalogue(1).iter().enumerate() {
        if effect.name() == "disturbance" {
            continue;
        }
        let model = JointModel::of_plant(&plant())
            .with_effect(index, &acting(effect.as_ref()).iter().map(|x| 0.3 * x + 0.02).collect::<Vec<_>>());
        // Friction and play switch between steps; their derivative is that of the smooth pieces.
        let switches = effect.place() == Place::Friction || effect.name() == "backlash";
        let allowed = if switches { 0.1 } else { 0.01 };
        assert_sensitivities(&|m| last(m, start), &model, allowed, effect.name());
    }
}

#[test]
fn a_servo_has_the_sensitivities_that_it_claims_beside_every_effect() {
    // Sensitivities leave out how the implicit factor of a step changes; of those of a closed loop, which are
    // small differences, that is too much at one step.
    const STEPS: usize = 16;
    let mut log = log();
    log.commanded = log.time_s.iter().map(|t| 0.3 + 0.5 * (5.0 * t).sin()).collect();
    let found =
        Actuator { gain: 1.2, damping: 4.0, delay_s: 0.01, is_found: [true; 2], ..Actuator::default() };
    let start = Start { position: 0.3, velocity: 0.4, play: -1.0 };
    for (index, effect) in catalogue(1).iter().enumerate() {
        if effect.name() == "disturbance" {
            continue;
        }
        let own: Vec<f64> = acting(effect.as_ref()).iter().map(|x| 0.3 * x + 0.02).collect();
        // Where both a friction and a limit switch, the derivative is that of neither piece.
        let both = [f64::INFINITY, 12.0];
        let limits = if effect.place() == Place::Friction { &both[..1] } else { &both[..] };
        for &limit in limits {
            let servo = Some(Servo { stiffness: 60.0, limit });
            // A loop that is closed leaves so little that where friction switches would show.
            let plant = Plant { friction: 0.0, actuator: Actuator { servo, ..found }, ..plant() };
            let model = JointModel::of_plant(&plant).with_effect(index, &own);
            let parameters = model.free_parameters();
            assert_eq!(parameters.len(), model.free_count());
            assert_eq!(parameters[parameters.len() - 2..], [1.2, 4.0]);
            // What switches between steps has the derivative of its smooth pieces.
            let switches = effect.place() == Place::Friction || effect.name() == "backlash" || limit < 1e3;
            let allowed = if switches { 0.1 } else { 0.01 };
            let what = format!("{} limit {limit}", effect.name());
            assert_sensitivities(&|m| last_of(&log, m, start, STEPS), &model, allowed, &what);
        }
    }
}

#[test]
fn a_joint_that_sticks_stands_still() {
    let effects = catalogue(0);
    let mut log = log();
    log.effort = vec![0.5; 200];
    let held = Plant { friction: 2.0, load: Load::default(), ..plant() };
    let drive = Drive::with_steps(&log, Hold::Zero, 0.0, 1);
    let mut out = Rollout::default();
    let start = Start { position: 0.3, velocity: 0.0, play: 0.0 };
    roll_window(
        &JointModel::of_plant(&held),
        &effects,
        &log,
        &drive,
        Span { log: 0, start: 0, len: 200 },
        start,
        &mut out,
    );
    assert!(out.position.iter().all(|q| *q == 0.3));
}

#[test]
fn friction_that_settles_brings_to_rest_in_its_time_and_creeps() {
    let effects = catalogue(0);
    let mut log = log();
    log.effort = vec![0.5; 200];
    let held = Plant { damping: 0.0, friction: 2.0, load: Load::default(), most_load: 0.0, ..plant() };
    let settle_s = 0.01;
    let model = JointModel { settle_s, ..JointModel::of_plant(&held) };
    let velocity = |finer: usize, at: usize| {
        let drive = Drive::with_steps(&log, Hold::Zero, 0.0, finer);
        let mut out = Rollout::default();
        let start = Start { position: 0.3, velocity: 0.004, play: 0.0 };
        roll_window(&model, &effects, &log, &drive, Span { log: 0, start: 0, len: 200 }, start, &mut out);
        (out.position[at + 1] - out.position[at]) / 0.005
    };
    // The solution of dv/dt = -v / settle + 0.1 a, averaged over an interval.
    let creep = 0.1 * settle_s * 0.5 / 2.0;
    let mean = |from: f64| {
        creep
            + (0.004 - creep) * settle_s / 0.005
                * ((-from / settle_s).exp() - (-(from + 0.005) / settle_s).exp())
    };
    for (finer, allowed) in [(1, 0.05), (8, 0.002)] {
        for at in [0, 1, 3, 6, 150] {
            let v = velocity(finer, at);
            let wanted = mean(0.005 * at as f64);
            assert!((v - wanted).abs() < allowed * 0.004, "interval {at}: {v} {wanted}");
        }
    }
}

#[test]
fn sensitivities_hold_where_friction_settles() {
    let index = catalogue(1).iter().position(|e| e.name() == "coulomb_friction").unwrap();
    let model = JointModel { settle_s: 0.03, ..JointModel::of_plant(&plant()).with_effect(index, &[0.7]) };
    let start = Start { position: 0.3, velocity: 0.4, play: 0.0 };
    assert_sensitivities(&|m| last(m, start), &model, 0.02, "friction that settles");
}
