//! The filter against the covariance that it factors, and linearizations against the equation of motion.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::*;
use crate::{
    judge::simulated::{pendulum, with},
    model::{
        actuator::{Actuator, Servo},
        effects::catalogue,
        plant::Plant,
    },
};

/// Transitions of no particular joint, over intervals of two lengths.
fn locals(count: usize) -> Vec<Local> {
    let of = |k: usize| {
        let x = k as f64;
        Local {
            a: [0.95 + 0.01 * x.sin(), 0.3 + 0.02 * x.cos(), -0.2 + 0.03 * x.sin(), 0.85 - 0.02 * x.cos()],
            g: [0.1 + 0.01 * x.cos(), 0.4 + 0.03 * x.sin()],
            interval_s: if k % 3 == 1 { 0.02 } else { 0.01 },
        }
    };
    (0..count).map(of).collect()
}

const NOISE: EffortNoise = EffortNoise { white: 0.3, wander: 0.7, memory_s: 0.015, deflection: 0.2 };

/// Transition of (position, velocity, wander) to the next sample.
fn transition(local: &Local, noise: &EffortNoise) -> Matrix3<f64> {
    let a = local.a;
    let g = local.g;
    let kept = (-local.interval_s / noise.memory_s).exp();
    Matrix3::new(a[0], a[1], g[0], a[2], a[3], g[1], 0.0, 0.0, kept)
}

/// Covariance of all readings of a window whose start state is known: what efforts make of the positions, and
/// on top the variances of the readings and of the deflection.
fn covariance(locals: &[Local], readings: &[f64], noise: &EffortNoise) -> DMatrix<f64> {
    let n = readings.len();
    let mut all = DMatrix::zeros(n, n);
    let mut state = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, noise.wander.powi(2)));
    for first in 0..n {
        let mut column = state.column(0).into_owned();
        for later in first..n {
            all[(first, later)] = column[0];
            all[(later, first)] = column[0];
            column = transition(&locals[later], noise) * column;
        }
        all[(first, first)] += readings[first] + noise.deflection.powi(2);
        let step = transition(&locals[first], noise);
        let push = Vector3::new(locals[first].g[0], locals[first].g[1], 0.0) * noise.white;
        let fresh = noise.wander.powi(2) * (1.0 - step[(2, 2)].powi(2));
        state = step * state * step.transpose() + push * push.transpose();
        state[(2, 2)] += fresh;
    }
    all
}

fn readings(count: usize) -> Vec<f64> {
    (0..count).map(|k| 0.01 + 0.005 * (k % 4) as f64).collect()
}

fn gains_of(locals: &[Local], readings: &[f64], noise: &EffortNoise) -> (Vec<Gain>, f64) {
    let mut gains = Gains::of_noise(noise);
    let found = locals.iter().zip(readings).map(|(local, reading)| gains.next(local, *reading)).collect();
    (found, gains.log_variance())
}

/// Columns of no particular shape.
fn columns(count: usize) -> DMatrix<f64> {
    DMatrix::from_fn(count, 3, |k, i| (0.7 * k as f64 * (i + 1) as f64).sin() + 0.2 * i as f64)
}

#[test]
fn whitened_columns_have_the_products_of_generalized_least_squares() {
    let locals = locals(9);
    let readings = readings(9);
    let columns = columns(9);
    let (gains, log_variance) = gains_of(&locals, &readings, &NOISE);
    let mut rows = vec![[0.0; 16]; 9];
    for (k, row) in rows.iter_mut().enumerate() {
        row[..3].copy_from_slice(&[columns[(k, 0)], columns[(k, 1)], columns[(k, 2)]]);
        row[3] = 5.0;
    }
    whiten_rows::<3>(&mut rows, &locals, &gains);
    let whitened = DMatrix::from_fn(9, 3, |k, i| rows[k][i]);
    let known = covariance(&locals, &readings, &NOISE).cholesky().unwrap();
    let found = whitened.tr_mul(&whitened);
    let expected = columns.tr_mul(&known.solve(&columns));
    assert!((&found - &expected).amax() < 1e-9 * expected.amax(), "{found} {expected}");
    let determinant = 2.0 * known.l().diagonal().map(f64::ln).sum();
    assert!((log_variance - determinant).abs() < 1e-9, "{log_variance} {determinant}");
    // Columns behind those that are asked for stay.
    assert!(rows.iter().all(|row| row[3] == 5.0 && row[4] == 0.0));
}

#[test]
fn white_noise_alone_leaves_nothing_behind() {
    let locals = locals(9);
    let readings = readings(9);
    let columns = columns(9);
    let noise = EffortNoise::white_noise(0.3);
    let (gains, log_variance) = gains_of(&locals, &readings, &noise);
    assert!(gains.iter().all(|g| g.kd == 0.0 && g.kept == 0.0));
    let mut rows = vec![[0.0; 16]; 9];
    rows.iter_mut().enumerate().for_each(|(k, row)| row[0] = columns[(k, 1)]);
    whiten_rows::<1>(&mut rows, &locals, &gains);
    let never = EffortNoise { memory_s: 1.0, ..noise };
    let known = covariance(&locals, &readings, &never).cholesky().unwrap();
    let column = DVector::from_column_slice(columns.column(1).as_slice());
    let found: f64 = rows.iter().map(|row| row[0] * row[0]).sum();
    assert!((found / column.dot(&known.solve(&column)) - 1.0).abs() < 1e-9, "{found}");
    assert!((log_variance - 2.0 * known.l().diagonal().map(f64::ln).sum()).abs() < 1e-9);
}

#[test]
fn variances_of_any_size_add_up_in_the_logarithm() {
    for scale in [1e-14, 1e14] {
        let noise = NOISE.scaled_by(scale);
        let locals = locals(40);
        let readings = vec![0.01 * scale * scale; 40];
        let (gains, log_variance) = gains_of(&locals, &readings, &noise);
        let expected: f64 = gains.iter().map(|g| -2.0 * g.scale.ln()).sum();
        assert!((log_variance / expected - 1.0).abs() < 1e-9, "{log_variance} {expected}");
    }
}

#[test]
fn a_response_is_the_whitened_motion_under_the_efforts() {
    let locals = locals(9);
    let readings = readings(9);
    let (gains, _) = gains_of(&locals, &readings, &NOISE);
    let effort: Vec<f64> = (0..9).map(|k| (1.3 * f64::from(k)).cos()).collect();
    let direct: Vec<f64> = (0..9).map(|k| 0.1 * (0.4 * f64::from(k)).sin()).collect();
    for with_direct in [false, true] {
        let mut state = [0.0, 0.0];
        let mut filter = Filter::<1>::default();
        let expected: Vec<f64> = (0..9)
            .map(|k| {
                let mut row = [state[0] + if with_direct { direct[k] } else { 0.0 }];
                filter.pass_row(&mut row, &locals[k], &gains[k]);
                let Local { a, g, .. } = locals[k];
                state = [
                    a[0] * state[0] + a[1] * state[1] + g[0] * effort[k],
                    a[2] * state[0] + a[3] * state[1] + g[1] * effort[k],
                ];
                row[0]
            })
            .collect();
        let mut found = vec![0.0; 9];
        effort_response(&effort, with_direct.then_some(&direct), &locals, &gains, &mut found);
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-12, "{found:?} {expected:?}");
        }
        assert!(expected[8].abs() > 1e-3);
    }
}

/// Samples 0.01 s apart at some positions and velocities, under efforts, beside another joint at 0.5.
fn along(states: &[(f64, f64, f64)]) -> (JointLog, Trace) {
    let count = states.len();
    let log = JointLog {
        time_s: (0..count).map(|k| 0.01 * k as f64).collect(),
        position: vec![0.0; count],
        effort: vec![0.0; count],
        others: vec![vec![0.5; count]],
        ..JointLog::default()
    };
    let trace = Trace {
        position: states.iter().map(|s| s.0).collect(),
        velocity: states.iter().map(|s| s.1).collect(),
        signal: states.iter().map(|s| s.2).collect(),
        ..Trace::default()
    };
    (log, trace)
}

fn linearized(model: &JointModel, states: &[(f64, f64, f64)]) -> Vec<Local> {
    let (log, trace) = along(states);
    linearized_joint(model, &catalogue(1), &log, 0, &trace)
}

fn assert_near(local: &Local, a: [f64; 4], g: [f64; 2], tolerance: f64) {
    let mut off = local.a.iter().chain(&local.g).zip(a.iter().chain(&g)).map(|(x, y)| (x - y).abs());
    assert!(off.all(|off| off < tolerance), "{local:?} {a:?} {g:?}");
}

/// Transition and effect of an effort over 0.01 s of `inertia q'' = effort - stiffness q - damping q'`, by
/// the series of the exponential.
fn exact(inertia: f64, stiffness: f64, damping: f64) -> ([f64; 4], [f64; 2]) {
    let rate = Matrix3::new(0.0, 1.0, 0.0, -stiffness, -damping, 1.0, 0.0, 0.0, 0.0);
    let rate = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0 / inertia, 1.0)) * rate * 0.01;
    let mut sum = Matrix3::identity();
    let mut term = Matrix3::identity();
    for k in 1..20 {
        term *= rate / f64::from(k);
        sum += term;
    }
    ([sum[(0, 0)], sum[(0, 1)], sum[(1, 0)], sum[(1, 1)]], [sum[(0, 2)], sum[(1, 2)]])
}

#[test]
fn a_moving_joint_is_linearized_as_its_equation_says() {
    let effects = catalogue(1);
    let state = [(0.4, 1.0, 0.2), (0.41, 1.0, 0.2)];
    // The plant's own damping and load.
    let plant = Plant { damping: 0.05, ..pendulum(0.6) };
    let (a, g) = exact(0.05, 0.6 * 0.4f64.cos(), 0.05);
    assert_near(&linearized(&JointModel::of_plant(&plant), &state)[0], a, g, 1e-4);
    // Effects add to the inertia and to the stiffness.
    let heavier = with(&effects, &plant, &[("inertia", &[0.03]), ("spring_return", &[0.5, 0.1])]);
    let (a, g) = exact(0.08, 0.6 * 0.4f64.cos() + 0.5, 0.05);
    assert_near(&linearized(&heavier, &state)[0], a, g, 1e-4);
    // A servo is a spring and a damper, under a gain of the effort as well.
    let servo = Some(Servo { stiffness: 2.0, limit: f64::INFINITY });
    let actuator = Actuator { damping: 0.1, servo, ..Actuator::default() };
    let follows = Plant { actuator, ..pendulum(0.0) };
    let gained = with(&effects, &follows, &[("torque_gain", &[1.5])]);
    let (a, g) = exact(0.05, 3.0, 0.02 + 0.15);
    assert_near(&linearized(&gained, &state)[0], a, g, 7e-4);
    // Behind the last sample there is no time.
    let last = &linearized(&gained, &state)[1];
    assert_near(last, [1.0, 0.0, 0.0, 1.0], [0.0; 2], 1e-12);
    assert_eq!(last.interval_s, 0.0);
    assert!((linearized(&gained, &state)[0].interval_s - 0.01).abs() < 1e-12);
}

#[test]
fn stiff_and_driving_effects_do_not_blow_up() {
    let effects = catalogue(1);
    let of = |stiffness: f64, damping: f64| {
        let plant = Plant { damping, ..pendulum(0.0) };
        let model = with(&effects, &plant, &[("spring_return", &[stiffness, 0.0])]);
        linearized(&model, &[(0.0, 1.0, 0.0), (0.0, 1.0, 0.0)])[0]
    };
    // A share of 1 and of -0.2 of the spring, of 0.9 and of -0.2 of the velocity, at most.
    let push = |mean: f64| [0.5e-4 / 0.05, 0.01 / 0.05 * mean];
    assert_near(&of(1e6, 0.0), [0.5, 0.01, -100.0, 0.5], push(1.0), 1e-9);
    assert_near(&of(-1e6, 0.0), [1.1, 0.01, 20.0, 1.1], push(1.0), 1e-9);
    assert_near(&of(0.0, 1e6), [1.0, 0.0055, 0.0, 0.1], push(0.55), 1e-9);
    assert_near(&of(0.0, -1e6), [1.0, 0.011, 0.0, 1.2], push(1.1), 1e-9);
}

/// Whether a joint at a position sticks under an effort, at a velocity beside a top speed of 1.
fn sticks(model: &JointModel, q: f64, v: f64, u: f64) -> bool {
    linearized(model, &[(q, v, u), (q, 1.0, u)])[0].a[3] == 0.0
}

#[test]
fn a_joint_at_rest_sticks_under_less_than_its_friction() {
    let effects = catalogue(1);
    let rough = Plant { friction: 0.5, damping: 0.0, ..pendulum(0.0) };
    let model = JointModel::of_plant(&rough);
    assert!(sticks(&model, 0.0, 0.0, 0.49) && !sticks(&model, 0.0, 0.0, 0.51));
    assert!(sticks(&model, 0.0, 0.0, -0.49) && !sticks(&model, 0.0, 0.0, -0.51));
    // At 0.3 % of the top speed or less, either way.
    assert!(sticks(&model, 0.0, -0.0029, 0.1) && !sticks(&model, 0.0, -0.0031, 0.1));
    assert!(sticks(&model, 0.0, 0.0029, 0.1) && !sticks(&model, 0.0, 0.0031, 0.1));
    // It forgets its velocity, and no effort moves it.
    let stuck = linearized(&model, &[(0.0, 0.0, 0.1), (0.0, 1.0, 0.1)])[0];
    assert_near(&stuck, [1.0, 0.0, 0.0, 0.0], [0.0; 2], 1e-12);
    assert!((stuck.interval_s - 0.01).abs() < 1e-12);
    // Load, gain and another joint act beside the effort.
    let loaded = JointModel::of_plant(&Plant { friction: 0.5, ..pendulum(0.6) });
    let load = 0.6 * 0.8f64.sin();
    assert!(sticks(&loaded, 0.8, 0.0, load + 0.49) && !sticks(&loaded, 0.8, 0.0, load + 0.51));
    let gained = with(&effects, &rough, &[("torque_gain", &[2.0])]);
    assert!(sticks(&gained, 0.0, 0.0, 0.24) && !sticks(&gained, 0.0, 0.0, 0.26));
    let coupled = with(&effects, &rough, &[("coupling", &[0.0, 0.4, 0.0])]);
    assert!(sticks(&coupled, 0.0, 0.0, 0.29) && !sticks(&coupled, 0.0, 0.0, 0.31));
    // The bound is that of the way that the joint goes; at rest, up.
    let smooth = pendulum(0.0);
    let one_way = with(&effects, &smooth, &[("asymmetric_friction", &[0.1, 0.5])]);
    assert!(!sticks(&one_way, 0.0, 0.001, 0.3) && sticks(&one_way, 0.0, -0.001, 0.3));
    assert!(!sticks(&one_way, 0.0, 0.0, 0.3));
}

#[test]
fn friction_that_settles_also_brakes() {
    let rough = Plant { friction: 0.5, damping: 0.0, ..pendulum(0.0) };
    let model = JointModel { settle_s: 0.02, ..JointModel::of_plant(&rough) };
    let of = |v: f64, u: f64| linearized(&model, &[(0.0, v, u), (0.0, 1.0, u)])[0];
    // docs/method.md (14.8): what is kept of the velocity, and the creep under a tenth of the load.
    let keep = (-0.5f64).exp();
    let creep = 0.1 * 0.02 * (1.0 - keep) / 0.01 * 0.01 / 0.05;
    assert_near(&of(0.0, 0.1), [1.0, 0.005 * keep, 0.0, keep], [0.005 * creep, creep], 1e-12);
    // A velocity of 0.1 takes 0.05 * 0.1 / 0.02 of the friction, at any speed.
    let is_held = |v: f64, u: f64| (of(v, u).a[3] - keep).abs() < 1e-9;
    assert!(is_held(0.1, 0.24) && !is_held(0.1, 0.26) && is_held(-0.1, 0.74) && !is_held(-0.1, 0.76));
}
