//! Recordings of an object's states by a handheld camera.

use nalgebra::{Point3, Unit, Vector3};

use super::{
    Board, BoundingSphere, CameraPath, DepthCamera, HandheldCamera, Material, Object, PoseSource, Room,
    Scene, SeenSample, Solid, StereoCamera, SynthConfig, TakePoses, View,
    imu::{ImuReading, imu_readings},
    seen_points,
    workspace::whole_way,
};
use geometry::{Intrinsics, Pose};
use numeric::random::{self, stage_rng};

/// Focal length over image width: a horizontal field of view of 58 degrees. chosen: as usual cameras
const FOCAL_SHARE: f64 = 0.902;
/// Radius of the floor relative to the object's radius; at least as many meters. chosen: the floor fills the
/// images
const FLOOR_RADII: f64 = 6.0;
const MIN_FLOOR_M: f64 = 1.5;
/// Points sampled on the true surface of each state.
const SURFACE_POINTS: usize = 40_000;

/// Time between views of a clean recording, nanoseconds.
const PERIOD_NANOS: i64 = 200_000_000;
/// Mean speed of a handheld camera, m/s: the handheld sequences fr1/xyz and fr1/desk of Sturm et al. 2012
/// have 0.24 and 0.41. chosen: between these two
const HAND_SPEED: f64 = 0.35;
/// Segments for measuring the length of the camera's path.
const WAY_PIECES: usize = 1000;

/// One view of a state.
#[derive(Clone, Debug)]
pub struct SynthFrame {
    /// sRGB color, row-major.
    pub rgb: Vec<[u8; 3]>,
    /// Depth readings in millimeters, row-major; 0 = none.
    pub depth_mm: Vec<u16>,
    /// Whether each pixel shows the object; `None` for a handheld camera and for matched depth.
    pub mask: Option<Vec<bool>>,
    /// Poses reported shortly before and after the view, with errors: optical frame in the recording's world.
    pub reported: [Pose; 2],
    /// True pose at the view: optical frame in the true world.
    pub world_from_camera: Pose,
    /// Camera velocity in its optical frame: translation, m/s, and rotation, rad/s.
    pub velocity: [Vector3<f64>; 2],
    /// Factor on linear red, green and blue.
    pub gain: Vector3<f64>,
    /// Whether a hand is in front of the object.
    pub has_hand: bool,
}

impl SynthFrame {
    /// Time from a view to its reported poses before and after, nanoseconds; the pose at the view is
    /// interpolated.
    pub const POSE_OFFSET_NANOS: i64 = 1_000_000;
}

/// One state of a recording.
#[derive(Clone, Debug)]
pub struct SynthState {
    /// Camera intrinsics of all views.
    pub intrinsics: Intrinsics,
    /// Views in order of time.
    pub frames: Vec<SynthFrame>,
    /// Time between views, nanoseconds.
    pub period_nanos: i64,
    /// Pose of the true world in the recording's world; identity without drift.
    pub recorded_from_world: Pose,
    /// True surface points that the views show, in the true world.
    pub seen: Vec<SeenSample>,
    /// Accelerometer readings; empty without an accelerometer.
    pub imu: Vec<ImuReading>,
    /// Errors of the reported poses; zero at the first view of state 0.
    pub poses: TakePoses,
    /// Whether poses are reported at all.
    pub is_posed: bool,
}

/// Records an object in a state. The result depends only on the configuration, not on the number of threads.
pub fn record(object: &Object, state: usize, config: &SynthConfig) -> SynthState {
    film_take(object, state, state, config)
}

/// Records take number `take` of an object in a state; every take has its own camera path and noise.
pub fn film_take(object: &Object, state: usize, take: usize, config: &SynthConfig) -> SynthState {
    let rng =
        |what: &str, step: usize| stage_rng(config.seed, &format!("synth/state{take}/{what}"), step as u64);
    let intrinsics = camera_intrinsics(config);
    let sphere = object.bounding_sphere();
    let path = camera_path(object, take, config);
    // The floor and the objects on it are the same in all states.
    let (textured_floor, lamp) = drawn_surroundings(config.seed);
    let camera = handheld_camera(config);
    let stereo = stereo_camera(config);
    let around = Room::of_config(object, config);
    let floor = around.as_ref().map_or(&textured_floor, |around| &around.floor);
    // Around the object's reach in any state, so that nothing is in its way.
    let board = Board::of_config(object, config);
    let room = room_about(object, board.as_ref());
    let foot_z_m = object.world_from_rest.translation.vector.z;
    // A room has things of its own.
    let clutter = match &around {
        Some(around) => around.solids.clone(),
        None => camera.clutter_solids(&room, foot_z_m),
    };
    let still = Scene::new(object, state, floor, (FLOOR_RADII * sphere.radius_m).max(MIN_FLOOR_M))
        .with_floor_at(foot_z_m - around.as_ref().map_or(0.0, |around| around.foot_height_m))
        .with_solids(&clutter);
    let still = board.as_ref().map_or_else(|| still.with_solids(&[]), |board| still.with_board(board));
    let depth_camera = DepthCamera::with_scaled_noise(config.noise);
    let (views, period_nanos) = view_pace(&path, config);
    // Views are at the middle of their share of the path, so that the poses shortly before and after are on
    // it too.
    let time = |i: usize, nanos: f64| (i as f64 + 0.5 + nanos / period_nanos as f64) / views as f64;
    let cameras: Vec<Pose> = (0..views).map(|i| path.pose_at(time(i, 0.0))).collect();
    let hands: Vec<Vec<Solid>> =
        cameras.iter().enumerate().map(|(i, pose)| camera.hand_solids(take, i, pose, &sphere)).collect();
    // Few views show a hand; all others share one scene.
    let with_hands: Vec<Option<Scene>> =
        hands.iter().map(|hand| (!hand.is_empty()).then(|| still.with_solids(hand))).collect();
    let scene = |i: usize| with_hands[i].as_ref().unwrap_or(&still);
    let poses = camera.pose_errors(take, &cameras);
    let hand_error = config.poses.hand_error(config.seed);
    // The first take defines the world frame.
    let offset = if take == 0 { Pose::identity() } else { world_drift(config) };
    let recorded_from_world = offset * poses.relocalization;
    let mut frames = Vec::with_capacity(views);
    for i in 0..views {
        let world_from_camera = cameras[i];
        let light = camera.light_of_view(take, i, &lamp, scene(i), &world_from_camera, &sphere);
        let mut view = View::cast_rays(scene(i), &intrinsics, &world_from_camera, &light);
        let depth_rng = &mut rng("depth", i);
        let depth_mm = match &stereo {
            Some(stereo) => stereo.depth_mm(scene(i), &light, &intrinsics, &world_from_camera, depth_rng),
            None => {
                let errors = camera.depth_errors(take, i, &view, &intrinsics);
                depth_camera.depth_mm(&view, scene(i), &intrinsics, &world_from_camera, &errors, depth_rng)
            }
        };
        let velocity = camera_velocity(&path, time(i, 0.0), views as f64 * period_nanos as f64 * 1e-9);
        // Depth is computed from the sharp view: blur and shift affect only color.
        view.color = camera.colors_of_view(take, i, &view, &intrinsics, &velocity);
        // One error for both poses of a view; otherwise interpolation would average the errors.
        let error = poses.jitter[i] * pose_error(config, &mut rng("pose", i)) * hand_error;
        let reported = [-1.0, 1.0].map(|side| {
            let at = side * SynthFrame::POSE_OFFSET_NANOS as f64 - 1e9 * camera.lag_s;
            recorded_from_world * poses.drift[i] * path.pose_at(time(i, at)) * error
        });
        frames.push(SynthFrame {
            rgb: depth_camera.color_image(&view, &mut rng("color", i)),
            depth_mm,
            mask: config.has_masks().then(|| view.part.iter().map(Option::is_some).collect()),
            reported,
            world_from_camera,
            velocity,
            gain: camera.color_gain(take, i),
            has_hand: !hands[i].is_empty(),
        });
    }
    // Scenes with their hands, as surface behind a hand was not seen.
    let eyes: Vec<(&Scene, Pose)> = (0..views).map(|i| (scene(i), cameras[i])).collect();
    let seen = seen_points(object, state, &intrinsics, &eyes, SURFACE_POINTS, &mut rng("seen", 0));
    let imu = if config.imu { imu_readings(&path, take, views, period_nanos, config) } else { Vec::new() };
    let is_posed = config.poses != PoseSource::Nobody;
    SynthState { intrinsics, frames, period_nanos, recorded_from_world, seen, imu, poses, is_posed }
}

/// The camera of a configuration, without effects if no sensor is configured.
pub fn handheld_camera(config: &SynthConfig) -> HandheldCamera {
    let sensor = config.sensor.unwrap_or_else(|| config.poses.sensor());
    HandheldCamera::drawn(sensor, &camera_intrinsics(config), config.seed)
}

/// The stereo camera of a configuration; `None` where depth is modeled.
pub fn stereo_camera(config: &SynthConfig) -> Option<StereoCamera> {
    let level = config.depth.stereo_level()?;
    Some(StereoCamera::drawn(level, &camera_intrinsics(config), config.seed))
}

/// Number of views and the time between them, nanoseconds. With a sensor or a rate, they follow from a hand's
/// speed; a recording without errors has no effects of time.
fn view_pace(path: &CameraPath, config: &SynthConfig) -> (usize, i64) {
    if config.sensor.is_none() && config.rate_hz.is_none() {
        return (config.views, PERIOD_NANOS);
    }
    let at = |i: usize| path.pose_at(i as f64 / WAY_PIECES as f64).translation.vector;
    let way_m: f64 = (0..WAY_PIECES).map(|i| (at(i + 1) - at(i)).norm()).sum();
    let seconds = way_m / HAND_SPEED;
    match config.rate_hz {
        Some(rate_hz) => (((rate_hz * seconds).round() as usize).max(2), (1e9 / rate_hz).round() as i64),
        None => (config.views, (1e3 * seconds / config.views as f64).ceil() as i64 * 1_000_000),
    }
}

/// Camera velocity in its own frame, m/s and rad/s, on a path that takes `seconds`.
fn camera_velocity(path: &CameraPath, time: f64, seconds: f64) -> [Vector3<f64>; 2] {
    /// chosen: far above rounding
    const STEP: f64 = 1e-5;
    let seconds = 2.0 * STEP * seconds;
    let step = path.pose_at(time - STEP).inverse() * path.pose_at(time + STEP);
    [step.translation.vector / seconds, step.rotation.scaled_axis() / seconds]
}

/// Camera intrinsics of all views.
pub(super) fn camera_intrinsics(config: &SynthConfig) -> Intrinsics {
    let focal = FOCAL_SHARE * config.width as f64;
    Intrinsics {
        width: config.width,
        height: config.height,
        fx: focal,
        fy: focal,
        // Off center, so that programs that assume the center fail.
        cx: 0.5 * config.width as f64 + 2.7,
        cy: 0.5 * config.height as f64 - 3.2,
    }
}

/// The camera path of a state.
pub(super) fn camera_path(object: &Object, state: usize, config: &SynthConfig) -> CameraPath {
    let k = camera_intrinsics(config);
    let sphere = object.bounding_sphere();
    let board = Board::of_config(object, config);
    let BoundingSphere { center, radius_m } = board.map_or(sphere, |board| board.sphere_with(sphere));
    let forward = object.world_from_rest.rotation * Vector3::x();
    let half_view_rad = (0.5 * k.width.min(k.height) as f64 / k.fx).atan();
    let rng = &mut stage_rng(config.seed, &format!("synth/state{state}/path"), 0);
    let path = CameraPath::new(center, radius_m, forward.y.atan2(forward.x), half_view_rad, rng);
    match Room::of_config(object, config) {
        Some(room) => room.limited_path(path),
        None => path,
    }
}

/// The box around an object and a board.
fn room_about(object: &Object, board: Option<&Board>) -> [Point3<f64>; 2] {
    let corners = board.map(Board::sheet_corners);
    corners.iter().flatten().fold(whole_way(object), |[lower, upper], p| {
        [Point3::new(lower.x.min(p.x), lower.y.min(p.y), lower.z), upper.sup(p)]
    })
}

/// Material of the floor, and direction to the lamp.
pub(super) fn drawn_surroundings(seed: u64) -> (Material, Vector3<f64>) {
    let rng = &mut stage_rng(seed, "synth/surroundings", 0);
    let tone = random::uniform_in(rng, 0.2, 0.5);
    let floor = Material {
        base: Vector3::new(tone, 0.9 * tone, 0.75 * tone),
        second: Vector3::new(0.5 * tone, 0.52 * tone, 0.55 * tone),
        wavelength_m: Some(Vector3::repeat(random::uniform_in(rng, 0.2, 0.5))),
        seed: random::index_below(rng, 1 << 30) as u32,
        lacquer: None,
        sheen: 0.0,
    };
    let lamp = Vector3::new(random::uniform_in(rng, -1.0, 1.0), random::uniform_in(rng, -1.0, 1.0), 1.0);
    (floor, Unit::new_normalize(lamp).into_inner())
}

/// Error of a frame's pose, in the camera's frame.
fn pose_error(config: &SynthConfig, rng: &mut impl rand_core::Rng) -> Pose {
    let spread = config.poses.spread();
    Pose::new(
        random::isotropic_normal(rng, spread.translation_m),
        random::isotropic_normal(rng, spread.rotation_rad),
    )
}

/// Error of state 1's world: the full amount, in a random direction and about a random axis through the
/// object's base, near the world origin.
fn world_drift(config: &SynthConfig) -> Pose {
    let rng = &mut stage_rng(config.seed, "synth/drift", 0);
    let shift = random::random_direction(rng).into_inner() * config.drift.translation_m;
    let turn = random::random_direction(rng).into_inner() * config.drift.rotation_rad;
    Pose::new(shift, turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HandheldSensor;

    #[test]
    fn a_rate_says_how_many_views_a_hand_takes_on_the_same_way() {
        let path = CameraPath::new(nalgebra::Point3::origin(), 0.5, 0.3, 0.4, &mut stage_rng(3, "path", 0));
        let seconds = |config: &SynthConfig| {
            let (views, period_nanos) = view_pace(&path, config);
            (views, 1e-9 * views as f64 * period_nanos as f64)
        };
        let by_hand =
            SynthConfig { sensor: Some(HandheldSensor::new(1.0)), views: 100, ..SynthConfig::default() };
        let slow = seconds(&SynthConfig { rate_hz: Some(5.0), ..by_hand.clone() });
        let fast = seconds(&SynthConfig { rate_hz: Some(30.0), ..by_hand.clone() });
        let (_, whole_s) = seconds(&by_hand);
        assert!(slow.0.abs_diff((5.0 * whole_s) as usize) <= 1, "{slow:?} {whole_s}");
        assert!(fast.0.abs_diff((30.0 * whole_s) as usize) <= 4, "{fast:?} {whole_s}");
        assert!((slow.1 - fast.1).abs() < 0.2 && (slow.1 - whole_s).abs() < 0.2);
    }
}
