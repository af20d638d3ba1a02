//! A twin held against the views that it was made of: it agrees, and a part that is off or missing is said.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

#[path = "common/opened.rs"]
mod opened;

use config::Config;
use export::{Look, LookConfig, link_looks};
use model::ArticulatedModel;
use opened::open;
use run::{Monitor, Stages, compare, reconstruct_twin};

/// The states that are warned of.
fn warned(capture: &capture::Capture, model: &ArticulatedModel, looks: &[Look]) -> Vec<usize> {
    let found = compare(capture, model, looks);
    assert_eq!(found.len(), 2);
    found.iter().filter(|d| d.difference_warning().is_some()).map(|d| d.state).collect()
}

#[test]
fn a_part_that_is_off_or_missing_is_said_and_a_right_one_is_not() {
    let config = Config::default();
    let mut capture = open(&["bags/drawer".into()], &config.capture, 0).unwrap();
    let monitor = Monitor::silent();
    let mut stages = Stages::new(&monitor);
    let twin = reconstruct_twin("drawer", &mut capture, None, &config, &mut stages).unwrap();
    let looks = link_looks(&twin.model, &capture, &LookConfig::default());
    assert_eq!(warned(&capture, &twin.model, &looks), [0usize; 0]);
    // The noise of this sensor is 6 mm at 1 m.
    let mut off = twin.model.clone();
    off.states[1][0] -= 0.03;
    assert_eq!(warned(&capture, &off, &looks), [1]);
    let mut turned = twin.model.clone();
    turned.joints[0].parent_from_joint.rotation *= nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 0.2);
    assert_eq!(warned(&capture, &turned, &looks), [0, 1]);
    let mut without = looks;
    without[1].mesh.triangles.clear();
    assert_eq!(warned(&capture, &twin.model, &without), [0, 1]);
}
