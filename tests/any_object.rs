//! Objects of which nothing is told beforehand: the number of parts is found, an object at rest has one,
//! states that drifted apart are aligned.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/opened.rs"]
mod opened;

use std::path::Path;

use capture::Capture;
use config::{Config, Layers};
use geometry::Pose;
use nalgebra::Vector3;
use opened::open;
use run::{Monitor, Stages, Twin, reconstruct_twin};

fn config() -> Config {
    let mut layers = Layers::new(&Config::default()).unwrap();
    layers.add_preset("preview").unwrap();
    layers.resolve::<Config>().unwrap().config
}

fn recording(name: &str) -> Capture {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name);
    open(&[path], &config().capture, 0).unwrap()
}

fn twin(capture: &Capture) -> Twin {
    let monitor = Monitor::silent();
    reconstruct_twin("object", &mut capture.clone(), None, &config(), &mut Stages::new(&monitor)).unwrap()
}

#[test]
fn the_number_of_parts_stands_out() {
    for name in ["drawer", "laptop"] {
        let twin = twin(&recording(name));
        assert_eq!((twin.part_count.given, twin.part_count.found), (None, 2));
        let weakest = |parts: usize| {
            twin.part_count.curve.iter().find(|p| p.parts == parts).and_then(|p| p.weakest).unwrap_or(0.0)
        };
        assert!(weakest(2) > 2.0 * weakest(3), "{name}: {:?}", twin.part_count.curve);
    }
}

#[test]
fn states_that_drifted_apart_are_aligned() {
    // 5 cm and 5 degrees.
    let drift = Pose::new(Vector3::new(0.03, -0.03, 0.0265), Vector3::new(0.05, 0.05, -0.0515));
    for name in ["drawer", "laptop"] {
        let (straight, mut moved) = (recording(name), recording(name));
        moved.states[1].iter_mut().for_each(|f| f.world_from_camera = drift * f.world_from_camera);
        let [expected, found] = [twin(&straight), twin(&moved)];
        assert!(expected.drifts == [None] && found.drifts[0].is_some(), "{name}");
        assert!(
            found.warnings.iter().any(|w| w.text.contains("another world frame")),
            "{:?}",
            found.warnings
        );
        let [a, b] = [&expected.model.joints[0], &found.model.joints[0]];
        assert_eq!(a.kind, b.kind);
        let degrees = a.axis.angle(&b.axis).to_degrees();
        let motion = |t: &Twin| t.model.states[1][0];
        eprintln!(
            "{name}: the axis is {degrees:.3} deg, the motion {:.5} off that of the undrifted recording",
            motion(&found) - motion(&expected)
        );
        // Measured: 0.03 deg, and 0.01 mm and 0.004 deg.
        assert!(
            degrees < 0.11 && (motion(&found) - motion(&expected)).abs() < 0.0003,
            "{name}: {degrees} deg"
        );
    }
}

#[test]
fn an_object_at_rest_has_one_part() {
    // Every other view of one state as another state.
    let mut capture = recording("drawer");
    let frames = std::mem::take(&mut capture.states[0]);
    let (even, odd): (Vec<_>, Vec<_>) = frames.into_iter().enumerate().partition(|(i, _)| i % 2 == 0);
    capture.states = [even, odd].map(|half| half.into_iter().map(|(_, f)| f).collect()).into();
    let twin = twin(&capture);
    assert_eq!((twin.model.links.len(), twin.model.joints.len()), (1, 0), "{:?}", twin.part_count);
    assert!(twin.notes.iter().any(|n| n.text.contains("no part moved")), "{:?}", twin.notes);
}
