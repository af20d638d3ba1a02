//! Frames of an object at further joint positions.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use capture::{NoiseConfig, RgbdFrame};
use geometry::Intrinsics;

/// One recording of the object at rest.
#[derive(Clone, Debug)]
pub struct FrameRun {
    /// Name of the recording.
    pub name: String,
    /// Views with their masks.
    pub frames: Vec<RgbdFrame>,
    /// Velocity of the camera at each frame in its optical frame: translation, m/s, and rotation, rad/s;
    /// empty where the poses do not give them.
    pub velocities: Vec<[Vector3<f64>; 2]>,
    /// Joint positions recorded beside the frames, by name, rad or m.
    pub positions: BTreeMap<String, f64>,
    /// Depth noise of the recording.
    pub noise: NoiseConfig,
}

/// A frame at a coarser grid: nearest pixels, no mean over edges.
#[must_use]
pub fn coarse_frame(frame: &RgbdFrame, step: usize) -> RgbdFrame {
    let k = &frame.intrinsics;
    let width = k.width / step;
    let height = k.height / step;
    // The middle of each block: coarse pixels look along the rays of fine ones.
    let off = (step - 1) / 2;
    let center = |c: f64| (c - off as f64) / step as f64;
    let intrinsics = Intrinsics {
        width,
        height,
        fx: k.fx / step as f64,
        fy: k.fy / step as f64,
        cx: center(k.cx),
        cy: center(k.cy),
    };
    let from = |i: usize| (i / width * step + off) * k.width + i % width * step + off;
    let all = 0..width * height;
    RgbdFrame {
        id: frame.id.clone(),
        stamp_nanos: frame.stamp_nanos,
        intrinsics,
        world_from_camera: frame.world_from_camera,
        rgb: all.clone().map(|i| frame.rgb[from(i)]).collect(),
        depth_m: all.clone().map(|i| frame.depth_m[from(i)]).collect(),
        mask: frame.mask.as_ref().map(|m| all.clone().map(|i| m[from(i)]).collect()),
        readings: Vec::new(),
    }
}
