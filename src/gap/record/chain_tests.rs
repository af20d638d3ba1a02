//! A chain's joint against the inverse dynamics of the whole tree, and that against MuJoCo.

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use crate::{
    record::{chain::carried_by_stamp, motion::SmoothMotion},
    twin_tree::{Motion, TwinJoint, TwinLink, TwinTree},
};
use geometry::Pose;

/// An upper part that turns about -y, one below it that turns about an oblique axis, and a slide in that.
fn tree() -> TwinTree {
    let link = |name: &str, mass_kg: f64, com: [f64; 3], i: [f64; 3]| TwinLink {
        name: name.into(),
        mass_kg,
        center_of_mass: Point3::from(com),
        inertia: Matrix3::from_diagonal(&Vector3::from(i)),
        inertia_excess: 0.0,
    };
    let joint = |name: &str, motion, parent, at: [f64; 3], axis: [f64; 3]| TwinJoint {
        name: name.into(),
        motion,
        parent,
        child: parent + 1,
        parent_from_joint: Pose::translation(at[0], at[1], at[2]),
        axis: Unit::new_normalize(Vector3::from(axis)),
        damping: 0.0,
        friction: 0.0,
        limit: None,
        mimic: None,
        is_free: false,
    };
    TwinTree {
        name: "chain".into(),
        links: vec![
            link("base", 0.0, [0.0; 3], [0.0; 3]),
            link("upper", 2.0, [0.2, 0.05, 0.0], [0.02, 0.03, 0.04]),
            link("lower", 1.0, [0.15, 0.0, 0.03], [0.01, 0.02, 0.015]),
            link("slide", 0.5, [0.02, 0.01, 0.0], [0.001, 0.002, 0.003]),
        ],
        joints: vec![
            joint("a", Motion::Turn, 0, [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
            joint("b", Motion::Turn, 1, [0.4, 0.0, 0.1], [0.0, 0.6, 0.8]),
            joint("c", Motion::Slide, 2, [0.3, 0.0, 0.0], [0.8, 0.0, 0.6]),
        ],
        root: 0,
        gravity: Vector3::new(0.0, 0.0, -9.81),
    }
}

const POSITION: [f64; 3] = [0.7, -0.4, 0.12];
const VELOCITY: [f64; 3] = [1.3, -2.1, 0.5];
const ACCELERATION: [f64; 3] = [-3.0, 4.0, 2.5];

#[test]
fn the_inverse_dynamics_of_a_chain_are_those_of_mujoco() {
    // `qfrc_inverse` of mj_inverse, MuJoCo 4.0: `tests/python/gap/chain.py --values` prints them.
    let mujoco = [6.003438189494, -0.104776409712, 3.037804655133];
    let own = tree().inverse_dynamics(&POSITION, &VELOCITY, &ACCELERATION, true);
    for (own, mujoco) in own.iter().zip(mujoco) {
        assert!((own - mujoco).abs() < 1e-9 * (1.0 + mujoco.abs()), "{own} {mujoco}");
    }
}

#[test]
fn a_joint_carried_by_its_chain_obeys_the_whole_tree() {
    let tree = tree();
    let whole = tree.inverse_dynamics(&POSITION, &VELOCITY, &ACCELERATION, true);
    let at = |j: usize| SmoothMotion {
        time_s: vec![0.0],
        state: vec![Vector3::new(POSITION[j], VELOCITY[j], ACCELERATION[j])],
        expected: Vec::new(),
        level: 0,
    };
    for j in 0..3 {
        let others: Vec<_> = tree.chain_joints(j).into_iter().map(|o| (o, at(o))).collect();
        assert_eq!(others.len(), 2);
        let c = carried_by_stamp(&tree, j, &others, &[0.0])[0];
        let own =
            c.inertia * ACCELERATION[j] + c.inertia_rate * VELOCITY[j] + c.load_and_slope(POSITION[j]).0;
        assert!((own - whole[j]).abs() < 1e-6 * (1.0 + whole[j].abs()), "joint {j}: {own} {}", whole[j]);
        let slope = (c.load_and_slope(POSITION[j] + 1e-6).0 - c.load_and_slope(POSITION[j] - 1e-6).0) / 2e-6;
        assert!((c.load_and_slope(POSITION[j]).1 - slope).abs() < 1e-5 * (1.0 + slope.abs()));
    }
}
