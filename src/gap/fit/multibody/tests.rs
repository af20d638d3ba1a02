//! Rollouts of several joints against that of one, against conserved energy, and fits of them.

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Unit, Vector3};

use crate::{
    fit::{
        multibody::{
            dynamics::{Dynamics, Inputs},
            joints::Joints,
            normal::{MultibodyBlock, cluster_covariance, multibody_step},
            shooting::{MultibodyPace, multibody_fit, window_sizes},
        },
        problem::Problem,
        rollout::{Rollout, roll_window},
        shooting::Free,
    },
    model::{
        effects::catalogue,
        joint_model::{Catalogue, JointModel},
        plant::Plant,
    },
    record::{drive::Hold, log::JointLog},
    twin_tree::{Motion, TwinJoint, TwinLink, TwinTree},
};
use geometry::Pose;

/// Two arms that hang on hinges about y, one below the other, with a damping at each, N m s/rad.
fn arms(damping: f64) -> TwinTree {
    let link = |name: &str, mass_kg: f64, com: [f64; 3]| TwinLink {
        name: name.into(),
        mass_kg,
        center_of_mass: Point3::from(com),
        inertia: Matrix3::from_diagonal(&Vector3::new(1e-3, 1e-3, 1e-3)),
        inertia_excess: 0.0,
    };
    let joint = |name: &str, parent, z: f64| TwinJoint {
        name: name.into(),
        motion: Motion::Turn,
        parent,
        child: parent + 1,
        parent_from_joint: Pose::translation(0.0, 0.0, z),
        axis: Unit::new_normalize(Vector3::y()),
        damping,
        friction: 0.0,
        limit: None,
        mimic: None,
        is_free: false,
    };
    TwinTree {
        name: "arms".into(),
        links: vec![
            link("base", 0.0, [0.0; 3]),
            link("upper", 0.6, [0.0, 0.0, -0.15]),
            link("lower", 0.4, [0.0, 0.0, -0.1]),
        ],
        joints: vec![joint("shoulder", 0, 1.0), joint("elbow", 1, -0.3)],
        root: 0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
    }
}

fn with(effects: &Catalogue, plant: &Plant, terms: &[(&str, &[f64])]) -> JointModel {
    let index = |name: &str| effects.iter().position(|e| e.name() == name).unwrap();
    terms.iter().fold(JointModel::of_plant(plant), |m, (name, p)| m.with_effect(index(name), p))
}

const INTERVAL_S: f64 = 0.01;

/// Runs of joints under their models, `steps` a sample.
fn simulated(
    tree: &TwinTree,
    joints: &[usize],
    models: &[JointModel],
    effects: &Catalogue,
    run: usize,
    steps: usize,
) -> Vec<JointLog> {
    let count = 800;
    let time_s: Vec<f64> = (0..count).map(|k| INTERVAL_S * k as f64).collect();
    let effort = |i: usize, t: f64| {
        let phase = 1.3 * run as f64 + i as f64;
        // The lower arm is light.
        let size = if i == 0 { 1.0 } else { 0.2 };
        size * (0.4 * (2.9 * t + phase).sin() + 0.3 * (6.7 * t - phase).cos())
    };
    let dynamics = Dynamics::of_models(tree, joints, models, effects);
    let mut q = vec![0.0; joints.len()];
    let mut v = vec![0.0; joints.len()];
    let mut position = vec![Vec::new(); joints.len()];
    let others = vec![[0.0; 8]; joints.len()];
    for t in &time_s {
        position.iter_mut().zip(&q).for_each(|(all, q)| all.push(*q));
        let signal: Vec<f64> = (0..joints.len()).map(|i| effort(i, *t)).collect();
        let inputs = Inputs { signal: &signal, time_s: *t, others: &others };
        (0..steps).for_each(|_| dynamics.step_by(&mut q, &mut v, INTERVAL_S / steps as f64, &inputs));
    }
    let log = |(i, position): (usize, Vec<f64>)| JointLog {
        run: format!("run_{run}"),
        effort: time_s.iter().map(|t| effort(i, *t)).collect(),
        position,
        time_s: time_s.clone(),
        ..JointLog::default()
    };
    position.into_iter().enumerate().map(log).collect()
}

#[test]
fn one_joint_moves_as_by_itself() {
    let tree = arms(0.02);
    let effects = catalogue(0);
    let plant = Plant::of_joint(&tree, 1).unwrap();
    let terms: [(&str, &[f64]); 4] = [
        ("asymmetric_friction", &[0.05, 0.08]),
        ("viscous_friction", &[0.01]),
        ("inertia", &[0.004]),
        ("backlash", &[0.01]),
    ];
    let models = [with(&effects, &plant, &terms)];
    let logs = simulated(&tree, &[1], &models, &effects, 0, 20);
    let problem = Problem::new(&effects, &plant, true, logs, Hold::Zero);
    let joints = Joints::new(&tree, vec![1], &[&problem]).unwrap();
    let problem = &joints.problems[0];
    let starts = joints.smoothed_starts(&models);
    let drives = joints.joint_drives(&models);
    let mut rollout = Rollout::default();
    for w in 0..joints.window_count() {
        let span = problem.windows[w];
        let log = &problem.logs[span.log];
        roll_window(&models[0], &effects, log, &drives[0][span.log], span, starts[w][0], &mut rollout);
        let residuals = joints.window_residuals(&models, &drives, w, &starts[w]);
        for (k, residual) in residuals.iter().enumerate() {
            let own = log.position[span.start + k] - rollout.position[k];
            assert!((own - residual).abs() < 1e-9, "window {w}, sample {k}: {own} {residual}");
        }
    }
}

#[test]
fn without_friction_energy_stays() {
    let tree = arms(0.0);
    let effects = catalogue(0);
    let models: Vec<JointModel> =
        (0..2).map(|j| JointModel::of_plant(&Plant::of_joint(&tree, j).unwrap())).collect();
    let energy = |q: &[f64], v: &[f64]| {
        let v = DVector::from_column_slice(v);
        let height = |link: usize| {
            let poses = tree.link_poses(q);
            tree.links[link].mass_kg * (poses[link] * tree.links[link].center_of_mass).z
        };
        0.5 * v.dot(&(tree.mass_matrix(q) * &v)) + 9.81 * (height(1) + height(2))
    };
    let drift = |steps: usize| {
        let dynamics = Dynamics::of_models(&tree, &[0, 1], &models, &effects);
        let mut q = vec![0.9, -0.5];
        let mut v = vec![0.0, 1.0];
        let before = energy(&q, &v);
        let inputs = Inputs { signal: &[0.0, 0.0], time_s: 0.0, others: &[[0.0; 8]; 2] };
        (0..steps).for_each(|_| dynamics.step_by(&mut q, &mut v, 1.0 / steps as f64, &inputs));
        (energy(&q, &v) - before).abs()
    };
    // Less than a thousandth of what the fall sets free, and smaller with smaller steps.
    assert!(drift(1000) < 5e-3, "{}", drift(1000));
    assert!(drift(4000) < 0.5 * drift(1000), "{} {}", drift(4000), drift(1000));
}

#[test]
fn joints_that_friction_holds_stand_still() {
    let tree = arms(0.0);
    let effects = catalogue(0);
    let of = |j: usize| with(&effects, &Plant::of_joint(&tree, j).unwrap(), &[("coulomb_friction", &[2.0])]);
    let models = [of(0), of(1)];
    let dynamics = Dynamics::of_models(&tree, &[0, 1], &models, &effects);
    let mut q = vec![0.6, -0.4];
    let mut v = vec![0.0, 0.0];
    let inputs = Inputs { signal: &[0.3, -0.2], time_s: 0.0, others: &[[0.0; 8]; 2] };
    (0..200).for_each(|_| dynamics.step_by(&mut q, &mut v, 5e-3, &inputs));
    assert!((q[0] - 0.6).abs() < 1e-9 && (q[1] + 0.4).abs() < 1e-9, "{q:?} {v:?}");
}

#[test]
fn a_friction_of_one_joint_is_not_found_at_the_other() {
    let tree = arms(0.02);
    let effects = catalogue(0);
    let plants = [0, 1].map(|j| Plant::of_joint(&tree, j).unwrap());
    let truth =
        [with(&effects, &plants[0], &[("coulomb_friction", &[0.12])]), with(&effects, &plants[1], &[])];
    let runs: Vec<Vec<JointLog>> =
        (0..2).map(|run| simulated(&tree, &[0, 1], &truth, &effects, run, 20)).collect();
    let problem = |i: usize| {
        let logs = runs.iter().map(|r: &Vec<JointLog>| r[i].clone()).collect();
        Problem::new(&effects, &plants[i], true, logs, Hold::Zero)
    };
    let problems = [problem(0), problem(1)];
    let joints = Joints::new(&tree, vec![0, 1], &[&problems[0], &problems[1]]).unwrap();
    let begun = [0, 1].map(|i| with(&effects, &plants[i], &[("coulomb_friction", &[0.06])]));
    let fitted = multibody_fit(&joints, &begun, None, Free::All, MultibodyPace::THOROUGH);
    let [own, other] = [0, 1].map(|i| fitted.models[i].terms[0].p[0]);
    assert!((own - 0.12).abs() < 0.004 && other < 0.004, "{own} {other}");
    let mean = |models: &[JointModel]| window_sizes(&joints, models).iter().map(|w| w[0] + w[1]).sum::<f64>();
    let twin = [0, 1].map(|i| with(&effects, &plants[i], &[]));
    assert!(mean(&fitted.models) < 0.1 * mean(&twin), "{} {}", mean(&fitted.models), mean(&twin));
}

#[test]
fn windows_with_states_of_their_own_give_the_parameters_of_plain_least_squares() {
    // Two windows of y = state + parameter x, the states 1 and -2, the parameter 3.
    let x = [0.0, 1.0, 2.0, 4.0];
    let noise = [[0.1, -0.2, 0.05, 0.0], [0.0, 0.1, -0.1, 0.15]];
    let of = |window: usize, state: f64| {
        let y = DVector::from_iterator(4, (0..4).map(|k| state + 3.0 * x[k] + noise[window][k]));
        let by = DMatrix::from_fn(4, 2, |k, c| if c == 0 { 1.0 } else { x[k] });
        MultibodyBlock::of_residuals(&y, &by, 1)
    };
    let blocks = [of(0, 1.0), of(1, -2.0)];
    let found = multibody_step(&blocks, &[false], 0.0).unwrap();
    // The slope of lines with intercepts of their own: covariances within windows.
    let centered: Vec<f64> = x.iter().map(|x| x - 1.75).collect();
    let up: f64 = noise.iter().flat_map(|n| n.iter().zip(&centered)).map(|(n, c)| n * c).sum();
    let below: f64 = 2.0 * centered.iter().map(|c| c * c).sum::<f64>();
    assert!((found.parameters[0] - 3.0 - up / below).abs() < 1e-9, "{}", found.parameters[0]);
    let mean = |w: usize| noise[w].iter().sum::<f64>() / 4.0;
    let state = 1.0 + mean(0) - 1.75 * up / below;
    assert!((found.states[0][0] - state).abs() < 1e-9, "{}", found.states[0][0]);
    let frozen = multibody_step(&blocks, &[true], 0.0).unwrap();
    assert_eq!(frozen.parameters[0], 0.0);
    // At the optimum, a unit variance of white residuals, halved where half of them count.
    let at = |w: usize| {
        let y = DVector::from_iterator(4, (0..4).map(|k| noise[w][k]));
        MultibodyBlock::of_residuals(&y, &DMatrix::from_fn(4, 2, |k, c| if c == 0 { 1.0 } else { x[k] }), 1)
    };
    let (wide, witnesses) = cluster_covariance(&[at(0), at(1)], &[false], 0.5);
    assert!((wide[(0, 0)] - 2.0 / below).abs() < 1e-9, "{wide}");
    assert!((witnesses[0] - 2.0).abs() < 1e-9, "{witnesses:?}");
}
