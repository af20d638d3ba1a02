//! Both states of an object as a hand-held camera records them.

use nalgebra::{Unit, Vector3};

use super::{CameraPath, DepthCamera, Material, Object, Scene, SeenSample, SynthConfig, View, seen_points};
use crate::{
    geometry::{Intrinsics, Pose},
    random::{self, stage_rng},
};

/// Focal length over image width: 58 degrees across.
const FOCAL_SHARE: f64 = 0.902;
/// Radius of the floor in radii of the object, meters at least.
const FLOOR_RADII: f64 = 6.0;
const MIN_FLOOR_M: f64 = 1.5;
/// Points drawn on the true surface of each state.
const SURFACE_POINTS: usize = 40_000;

/// One view of a state.
#[derive(Clone, Debug)]
pub struct SynthFrame {
    /// sRGB, row-major.
    pub rgb: Vec<[u8; 3]>,
    /// Depth readings, millimeters; 0 = none.
    pub depth_mm: Vec<u16>,
    /// Whether the object is seen.
    pub mask: Vec<bool>,
    /// Poses reported a little before and after the view: optical frame in the recording's world, with its
    /// errors.
    pub reported: [Pose; 2],
    /// True pose at the view: optical frame in the true world.
    pub world_from_camera: Pose,
    /// Velocity of the camera in its optical frame: translation, m/s, and rotation, rad/s.
    pub velocity: [Vector3<f64>; 2],
}

impl SynthFrame {
    /// Time between views, nanoseconds.
    pub const PERIOD_NANOS: i64 = 200_000_000;
    /// Poses are reported this long before and after each view, nanoseconds, so that the one at the view is
    /// interpolated.
    pub const POSE_OFFSET_NANOS: i64 = 1_000_000;
}

/// One state of a recording.
#[derive(Clone, Debug)]
pub struct SynthState {
    /// Camera of all views.
    pub intrinsics: Intrinsics,
    /// Views in order.
    pub frames: Vec<SynthFrame>,
    /// Where the true world stands in the world of the recording; identity without drift.
    pub recorded_from_world: Pose,
    /// True surface points that the views saw, in the true world.
    pub seen: Vec<SeenSample>,
}

/// Films an object in a state. The same configuration gives the same values, whatever the number of threads.
#[must_use]
pub fn record(object: &Object, state: usize, config: &SynthConfig) -> SynthState {
    film(object, state, state, config)
}

/// Films take number `take` of an object in a state: every take has a camera path and noise of its own.
#[must_use]
pub fn film(object: &Object, state: usize, take: usize, config: &SynthConfig) -> SynthState {
    let rng =
        |what: &str, step: usize| stage_rng(config.seed, &format!("synth/state{take}/{what}"), step as u64);
    let intrinsics = intrinsics(config);
    let (_, radius_m) = object.bounding_sphere();
    let path = camera_path(object, take, config);
    // The floor and the lamp are the same in both states.
    let (floor, lamp) = surroundings(config.seed);
    let scene = Scene::new(object, state, &floor, (FLOOR_RADII * radius_m).max(MIN_FLOOR_M));
    let sensor = DepthCamera::scaled(config.noise);
    let recorded_from_world = if take == 0 { Pose::identity() } else { drift(config) };
    let time = |i: usize, offset: i64| {
        (i as f64 + 0.5 + offset as f64 / SynthFrame::PERIOD_NANOS as f64) / config.views as f64
    };
    let frame = |i: usize| {
        let world_from_camera = path.pose(time(i, 0));
        let view = View::cast(&scene, &intrinsics, &world_from_camera, &lamp);
        let error = error(config, &mut rng("pose", i));
        let reported = [-SynthFrame::POSE_OFFSET_NANOS, SynthFrame::POSE_OFFSET_NANOS]
            .map(|o| recorded_from_world * path.pose(time(i, o)) * error);
        SynthFrame {
            rgb: sensor.rgb(&view, &mut rng("color", i)),
            depth_mm: sensor.depth_mm(&view, &scene, &intrinsics, &world_from_camera, &mut rng("depth", i)),
            mask: view.part.iter().map(Option::is_some).collect(),
            reported,
            world_from_camera,
            velocity: velocity(&path, time(i, 0), config.views),
        }
    };
    let frames: Vec<SynthFrame> = (0..config.views).map(frame).collect();
    let cameras: Vec<Pose> = frames.iter().map(|f| f.world_from_camera).collect();
    let seen = seen_points(object, state, &scene, &intrinsics, &cameras, SURFACE_POINTS, &mut rng("seen", 0));
    SynthState { intrinsics, frames, recorded_from_world, seen }
}

/// Velocity of the camera in its own frame.
fn velocity(path: &CameraPath, time: f64, views: usize) -> [Vector3<f64>; 2] {
    const STEP: f64 = 1e-5;
    let seconds = 2.0 * STEP * views as f64 * SynthFrame::PERIOD_NANOS as f64 * 1e-9;
    let step = path.pose(time - STEP).inverse() * path.pose(time + STEP);
    [step.translation.vector / seconds, step.rotation.scaled_axis() / seconds]
}

/// The camera of all views.
pub(super) fn intrinsics(config: &SynthConfig) -> Intrinsics {
    let focal = FOCAL_SHARE * config.width as f64;
    Intrinsics {
        width: config.width,
        height: config.height,
        fx: focal,
        fy: focal,
        cx: 0.5 * config.width as f64 + 2.7,
        cy: 0.5 * config.height as f64 - 3.2,
    }
}

/// The camera's way through a state.
pub(super) fn camera_path(object: &Object, state: usize, config: &SynthConfig) -> CameraPath {
    let k = intrinsics(config);
    let (center, radius_m) = object.bounding_sphere();
    let forward = object.world_from_rest.rotation * Vector3::x();
    let half_view_rad = (0.5 * k.width.min(k.height) as f64 / k.fx).atan();
    let rng = &mut stage_rng(config.seed, &format!("synth/state{state}/path"), 0);
    CameraPath::new(center, radius_m, forward.y.atan2(forward.x), half_view_rad, rng)
}

/// Material of the floor, and the direction of the lamp.
pub(super) fn surroundings(seed: u64) -> (Material, Vector3<f64>) {
    let rng = &mut stage_rng(seed, "synth/surroundings", 0);
    let tone = random::range(rng, 0.2, 0.5);
    let floor = Material {
        base: Vector3::new(tone, 0.9 * tone, 0.75 * tone),
        second: Vector3::new(0.5 * tone, 0.52 * tone, 0.55 * tone),
        wavelength_m: Some(Vector3::repeat(random::range(rng, 0.2, 0.5))),
        seed: random::below(rng, 1 << 30) as u32,
    };
    let lamp = Vector3::new(random::range(rng, -1.0, 1.0), random::range(rng, -1.0, 1.0), 1.0);
    (floor, Unit::new_normalize(lamp).into_inner())
}

/// The error of a frame's pose, in the camera's frame.
fn error(config: &SynthConfig, rng: &mut impl rand_core::Rng) -> Pose {
    let spread = &config.pose_noise;
    Pose::new(random::isotropic(rng, spread.translation_m), random::isotropic(rng, spread.rotation_rad))
}

/// How far the world of state 1 is off: the whole amount, in a random direction and about a random axis
/// through the object's foot, which is near the world's origin.
fn drift(config: &SynthConfig) -> Pose {
    let rng = &mut stage_rng(config.seed, "synth/drift", 0);
    let shift = random::direction(rng).into_inner() * config.drift.translation_m;
    let turn = random::direction(rng).into_inner() * config.drift.rotation_rad;
    Pose::new(shift, turn)
}
