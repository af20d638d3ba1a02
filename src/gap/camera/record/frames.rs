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
    /// RGB-D frames with their masks.
    pub frames: Vec<RgbdFrame>,
    /// Camera velocity at each frame, in its optical frame: linear, m/s, and angular, rad/s; empty if the
    /// poses do not provide it.
    pub velocities: Vec<[Vector3<f64>; 2]>,
    /// Joint positions recorded with the frames, by name, rad or m.
    pub positions: BTreeMap<String, f64>,
    /// Depth noise of the recording.
    pub noise: NoiseConfig,
}

/// A frame at a coarser resolution: single pixels are taken, since a mean would blur edges.
pub fn coarse_frame(frame: &RgbdFrame, step: usize) -> RgbdFrame {
    let k = &frame.intrinsics;
    let width = k.width / step;
    let height = k.height / step;
    // The middle pixel of each block, so coarse pixels keep its ray.
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
