//! Runs of two doors that brake, and a twin that knows nothing of brakes.

#![allow(dead_code, reason = "every test binary uses its own part of this")]

use std::path::PathBuf;

use io::ros2msg::{Header, JointState, Time};

use crate::common::{BagWriter, START};
use tempfile::TempDir;

/// Viscous friction of each door, N m s.
pub const DAMPING: [f64; 2] = [0.4, 0.7];
/// Moment of inertia about each hinge, kg m^2.
const INERTIA: [f64; 2] = [2.0, 3.0];
const RATE_HZ: f64 = 100.0;
const SMALL_STEPS: usize = 10;

/// Writes the URDF of the twin and bags of so many runs of so many seconds.
pub fn write(folder: &TempDir, runs: usize, seconds: f64) -> (PathBuf, Vec<PathBuf>) {
    let twin = folder.path().join("doors.urdf");
    let door = |name: &str, mass: f64| {
        format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"1 0 0\"/><mass value=\"{mass}\"/>\
             <inertia ixx=\"1e-9\" ixy=\"0\" ixz=\"0\" \
             iyy=\"1e-9\" iyz=\"0\" izz=\"1e-9\"/></inertial></link>\
             <joint name=\"{name}_hinge\" type=\"revolute\"><parent link=\"wall\"/>\
             <child link=\"{name}\"/><axis xyz=\"0 0 1\"/>\
             <limit lower=\"-3\" upper=\"3\" effort=\"9\" velocity=\"9\"/></joint>"
        )
    };
    let text = format!(
        "<robot name=\"doors\"><link name=\"wall\"/>{}{}</robot>",
        door("left", INERTIA[0]),
        door("right", INERTIA[1])
    );
    std::fs::write(&twin, text).unwrap();
    (twin, (0..runs).map(|run| write_run(folder, run, seconds)).collect())
}

/// Both doors under pushes of three frequencies and a weak spring, with noise of a milliradian.
fn write_run(folder: &TempDir, run: usize, seconds: f64) -> PathBuf {
    let path = folder.path().join(format!("push_{run}.mcap"));
    let mut bag = BagWriter::create(&path, None, 100_000);
    let mut noise = Noise(run as u64 + 1);
    let (mut angle, mut speed) = ([0.3f64, 0.5], [0.0f64; 2]);
    for k in 0..(seconds * RATE_HZ) as usize {
        let t = k as f64 / RATE_HZ;
        let mut effort = [0.0; 2];
        let mut measured = vec![0.0; 2];
        for d in 0..2 {
            let phase = (run + 2 * d) as f64;
            let push = 3.0 * (0.8 * t + phase).sin()
                + 2.0 * (2.9 * t + 2.0 * phase).sin()
                + 1.5 * (6.7 * t + phase).cos();
            effort[d] = push - 2.5 * (angle[d] - 0.5);
            measured[d] = angle[d] + 1e-3 * noise.normal();
            for _ in 0..SMALL_STEPS {
                let dt = 1.0 / RATE_HZ / SMALL_STEPS as f64;
                angle[d] += 0.5 * dt * speed[d];
                speed[d] += dt * (effort[d] - DAMPING[d] * speed[d]) / INERTIA[d];
                angle[d] += 0.5 * dt * speed[d];
            }
        }
        let nanos = START + (t * 1e9).round() as i64;
        let state = JointState {
            header: Header { stamp: Time::from_nanos(nanos), frame_id: String::new() },
            name: vec!["left_hinge".into(), "right_hinge".into()],
            position: measured,
            velocity: Vec::new(),
            effort: effort.to_vec(),
        };
        bag.message("/joint_states", "sensor_msgs/msg/JointState", nanos, &state);
    }
    bag.finish();
    path
}

/// Sums of twelve numbers of a linear congruence: close to normal.
struct Noise(u64);

impl Noise {
    fn normal(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}
