//! What must not matter to the twin: the order of the states, where the world frame stands, and, within
//! bounds, the number of views.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/opened.rs"]
mod opened;

use std::path::Path;

use capture::Capture;
use config::{Config, Layers};
use geometry::Pose;
use model::{Joint, JointKind};
use nalgebra::{Point3, Vector3};
use opened::open;
use run::{Monitor, Stages, reconstruct_twin};

fn config() -> Config {
    let mut layers = Layers::new(&Config::default()).unwrap();
    layers.add_preset("preview").unwrap();
    layers.add_setting("run.parts=2").unwrap();
    layers.resolve::<Config>().unwrap().config
}

fn recording(name: &str) -> Capture {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name);
    open(&[path], &config().capture, 0).unwrap()
}

/// The one joint of a recording, and its motion from state 0 to state 1.
fn joint(capture: &Capture) -> (Joint, Pose) {
    let monitor = Monitor::silent();
    let twin = reconstruct_twin("object", &mut capture.clone(), None, &config(), &mut Stages::new(&monitor))
        .unwrap();
    let model = twin.model;
    let [start, end] = [0, 1].map(|s| model.world_from_link(model.joints[0].child, &model.states[s]));
    (model.joints[0].clone(), end * start.inverse())
}

/// Root mean square displacement that a motion gives to the corners of a box of half a side of 0.2 m around a
/// point, mm.
fn displacement_mm(motion: &Pose, center: &Point3<f64>) -> f64 {
    let side = |k: usize, bit: usize| if k >> bit & 1 == 1 { 0.2 } else { -0.2 };
    let corner = |k: usize| center + Vector3::new(side(k, 0), side(k, 1), side(k, 2));
    let squares = (0..8).map(|k| (motion * corner(k) - corner(k)).norm_squared()).sum::<f64>();
    1e3 * (squares / 8.0).sqrt()
}

fn center(capture: &Capture) -> Point3<f64> {
    let frame = &capture.states[0][0];
    let points: Vec<_> = (0..frame.depth_m.len())
        .filter(|&i| frame.is_object(i))
        .filter_map(|i| frame.world_point(i))
        .collect();
    Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64)
}

fn check(name: &str, kind: JointKind) {
    let capture = recording(name);
    let center = center(&capture);
    let (found, motion) = joint(&capture);
    assert_eq!(found.kind, kind);

    let mut swapped = capture.clone();
    swapped.states.swap(0, 1);
    let (joint_back, back) = joint(&swapped);
    assert_eq!(joint_back.kind, kind);
    let apart_mm = displacement_mm(&(back * motion), &center);
    eprintln!("{name}: swapped states are {apart_mm:.2} mm from the inverse");
    assert!(apart_mm < 0.5, "{name}: {apart_mm} mm");

    let moved_from_world = Pose::new(Vector3::new(1.3, -0.7, 0.4), Vector3::new(0.3, -0.2, 1.1));
    let mut moved = capture.clone();
    for frame in moved.states.iter_mut().flatten() {
        frame.world_from_camera = moved_from_world * frame.world_from_camera;
    }
    let (joint_moved, there) = joint(&moved);
    assert_eq!(joint_moved.kind, kind);
    let expected = moved_from_world * motion * moved_from_world.inverse();
    let apart_mm = displacement_mm(&(there * expected.inverse()), &(moved_from_world * center));
    eprintln!("{name}: the moved world's motion is {apart_mm:.2} mm from the moved motion");
    assert!(apart_mm < 3.0, "{name}: {apart_mm} mm");

    let mut half = capture.clone();
    for frames in &mut half.states {
        *frames = frames.iter().step_by(2).cloned().collect();
    }
    let (joint_half, with_half) = joint(&half);
    assert_eq!(joint_half.kind, kind);
    let apart_mm = displacement_mm(&(with_half * motion.inverse()), &center);
    eprintln!("{name}: with half of the views the motion is {apart_mm:.2} mm off");
    assert!(apart_mm < 4.0, "{name}: {apart_mm} mm");
}

#[test]
fn a_laptop_is_the_same_whichever_way_it_is_recorded() {
    check("laptop", JointKind::Revolute);
}

#[test]
fn a_drawer_is_the_same_whichever_way_it_is_recorded() {
    check("drawer", JointKind::Prismatic);
}
