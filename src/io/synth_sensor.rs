//! The sensor entry of `truth.json`: the errors added to a recording.

use serde::Serialize;

use super::synth_matrix::rows;
use geometry::Pose;
use synth::{Effect, HandheldCamera, PoseSource, SynthConfig, SynthState, handheld_camera, stereo_camera};

/// Nodes of the warp along the image's width.
const WARP_NODES: usize = 32;

/// A sensor and its random draws.
#[derive(Serialize)]
pub(super) struct SensorEntry {
    name: &'static str,
    level: f64,
    effects: Vec<&'static str>,
    /// A depth reading is the true depth times `1 + depth_scale + depth_warp`.
    depth_scale: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    depth_warp: Option<WarpEntry>,
    /// Offset of color relative to depth, along u and v.
    color_shift_px: [f64; 2],
    /// How much older the reported poses are than the images.
    pose_lag_s: f64,
    /// Who reports the poses, where it was chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    poses: Option<&'static str>,
    /// Constant error of the reported poses in the camera's frame: x, y, z and a rotation vector.
    #[serde(skip_serializing_if = "Option::is_none")]
    hand_error: Option<[f64; 6]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stereo: Option<StereoEntry>,
    states: Vec<StateEntry>,
}

/// A stereo rig. Depth is computed with `baseline_m`, and with its pose in the color camera's frame as the
/// calibration has it.
#[derive(Serialize)]
struct StereoEntry {
    level: f64,
    focal_px: f64,
    baseline_m: f64,
    color_from_left: [f64; 6],
    true_left_from_right: [f64; 6],
    true_color_from_left: [f64; 6],
}

#[derive(Serialize)]
struct WarpEntry {
    /// Columns and rows of the pixels sampled in `relative`.
    u_px: Vec<usize>,
    v_px: Vec<usize>,
    /// A list for each row.
    relative: Vec<Vec<f64>>,
}

#[derive(Serialize)]
struct StateEntry {
    /// Pose of the true world in the recording's world.
    recorded_from_world: [[f64; 4]; 4],
    views: Vec<ViewEntry>,
}

/// Errors of a view's pose, each as x, y, z in meters and a rotation vector in radians: reported =
/// recorded_from_world * drift * (true, `pose_lag_s` earlier) * jitter * hand_error, not including
/// those of `--poses noisy`.
#[derive(Serialize)]
struct ViewEntry {
    world_from_camera: [[f64; 4]; 4],
    drift: [f64; 6],
    jitter: [f64; 6],
    /// Factor on linear red, green and blue.
    gain: [f64; 3],
    hand: bool,
}

impl SensorEntry {
    /// The sensor of a configuration before any state; `None` without errors of depth and poses.
    pub fn of(config: &SynthConfig) -> Option<Self> {
        let stereo = stereo_camera(config);
        if config.sensor.is_none() && stereo.is_none() && config.poses == PoseSource::Exact {
            return None;
        }
        let camera = handheld_camera(config);
        let sensor = camera.sensor;
        Some(Self {
            name: if config.sensor.is_some() { "handheld" } else { "camera" },
            level: sensor.level(),
            effects: sensor.effects().into_iter().map(Effect::name).collect(),
            depth_scale: camera.depth_scale,
            depth_warp: warp(&camera, config.width, config.height),
            color_shift_px: camera.color_shift_px,
            pose_lag_s: camera.lag_s,
            poses: (config.poses != PoseSource::Exact).then_some(config.poses.name()),
            hand_error: (config.poses == PoseSource::Robot)
                .then(|| six(&config.poses.hand_error(config.seed))),
            stereo: stereo.map(|stereo| StereoEntry {
                level: config.depth.stereo_level().unwrap_or_default(),
                focal_px: stereo.rig.intrinsics.fx,
                baseline_m: stereo.rig.baseline_m,
                color_from_left: six(&stereo.rig.color_from_left),
                true_left_from_right: six(&stereo.rig.true_left_from_right),
                true_color_from_left: six(&stereo.rig.true_color_from_left),
            }),
            states: Vec::new(),
        })
    }

    /// Adds the next state.
    pub fn add(&mut self, recording: &SynthState) {
        let poses = &recording.poses;
        let views = recording.frames.iter().zip(poses.drift.iter().zip(&poses.jitter)).map(
            |(frame, (drift, jitter))| ViewEntry {
                world_from_camera: rows(&frame.world_from_camera),
                drift: six(drift),
                jitter: six(jitter),
                gain: frame.gain.into(),
                hand: frame.has_hand,
            },
        );
        let recorded_from_world = rows(&recording.recorded_from_world);
        self.states.push(StateEntry { recorded_from_world, views: views.collect() });
    }
}

fn warp(camera: &HandheldCamera, width: usize, height: usize) -> Option<WarpEntry> {
    let step = (width / WARP_NODES).max(1);
    let [u_px, v_px] =
        [width, height].map(|n| (0..=n / step).map(|k| (k * step).min(n - 1)).collect::<Vec<usize>>());
    (!camera.depth_warp.is_empty()).then(|| WarpEntry {
        relative: v_px
            .iter()
            .map(|v| u_px.iter().map(|u| camera.depth_warp[v * width + u]).collect())
            .collect(),
        u_px: u_px.clone(),
        v_px: v_px.clone(),
    })
}

fn six(pose: &Pose) -> [f64; 6] {
    let shift = pose.translation.vector;
    let turn = pose.rotation.scaled_axis();
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}
