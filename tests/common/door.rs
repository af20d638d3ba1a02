//! A door under pushes, simulated: its twin and its samples.

#![allow(dead_code, reason = "every test binary uses its own part of this")]
#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use std::path::PathBuf;
use tempfile::TempDir;

const INERTIA: f64 = 2.0;
/// Damping that the twin knows of, N m s/rad.
pub const DAMPING: f64 = 0.4;
const RATE_HZ: usize = 100;
const STEPS: usize = 10;

/// One message to be: seconds, positions and efforts; an empty list is not recorded.
#[derive(Clone, Debug)]
pub struct Sample {
    pub time_s: f64,
    pub position: Vec<f64>,
    pub effort: Vec<f64>,
}

/// The door under a mixture of slow and fast pushes, with noise of a milliradian. Intervals vary by the share
/// `uneven`.
pub fn door(run: usize, seconds: f64, uneven: f64, damping: f64) -> Vec<Sample> {
    let (mut q, mut v) = (0.4f64, 0.0f64);
    let mut state = 77 + run as u64;
    let mut noise = move || {
        let mut sum = 0.0;
        for _ in 0..12 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (state >> 11) as f64 / (1u64 << 53) as f64;
        }
        1e-3 * (sum - 6.0)
    };
    let (mut samples, mut t) = (Vec::new(), 0.0f64);
    for k in 0..(seconds * RATE_HZ as f64) as usize {
        let interval_s = (1.0 + uneven * (1.7 * k as f64).sin()) / RATE_HZ as f64;
        let phase = run as f64;
        let wave =
            3.0 * (0.9 * t + phase).sin() + 2.0 * (2.7 * t + 2.0 * phase).sin() + 1.5 * (7.1 * t).cos();
        let effort = wave - 2.5 * (q - 0.6);
        samples.push(Sample { time_s: t, position: vec![q + noise()], effort: vec![effort] });
        for _ in 0..STEPS {
            let dt = interval_s / STEPS as f64;
            q += 0.5 * dt * v;
            v += dt * (effort - damping * v) / INERTIA;
            q += 0.5 * dt * v;
        }
        t += interval_s;
    }
    samples
}

/// A mass of two kilograms a meter from the hinge.
pub const INERTIAL: &str = "<inertial><origin xyz=\"1 0 0\"/><mass value=\"2\"/>\
                            <inertia ixx=\"1e-9\" ixy=\"0\" ixz=\"0\" iyy=\"1e-9\" iyz=\"0\" izz=\"1e-9\"/>\
                            </inertial>";

/// The twin: a door on a post, its hinge half a meter from the world's origin, with a handle a meter from it.
pub fn twin(folder: &TempDir, inertial: &str) -> PathBuf {
    let path = folder.path().join("twin.urdf");
    let text = format!(
        "<robot name=\"twin\"><link name=\"base\"/><link name=\"door\">{inertial}</link>\
         <link name=\"handle\"/>\
         <joint name=\"door_joint\" type=\"revolute\"><parent link=\"base\"/><child link=\"door\"/>\
         <origin xyz=\"0.5 0 0\"/>\
         <axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"3\" effort=\"9\" velocity=\"9\"/>\
         <dynamics damping=\"{DAMPING}\" friction=\"0\"/></joint>\
         <joint name=\"grip\" type=\"fixed\"><parent link=\"door\"/><child link=\"handle\"/>\
         <origin xyz=\"1 0 0\"/></joint></robot>"
    );
    std::fs::write(&path, text).unwrap();
    path
}
