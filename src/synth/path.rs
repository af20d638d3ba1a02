//! Path of a handheld camera that sweeps around the front of an object.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use rand_core::Rng;

use geometry::Pose;
use numeric::random;

/// Half the azimuth range about the object's front, radians. chosen: 100 degrees to either side
const HALF_SWEEP_RAD: f64 = 1.75;
/// Range of elevation, radians. chosen: 11 and 60 degrees
const ELEVATION_RAD: [f64; 2] = [0.2, 1.05];
/// Share of half the field of view that the object's sphere fills. chosen: leaves a margin
const FILL: f64 = 0.95;
/// Least distance to the sphere's center, meters, beside 1.5 radii, to stay within the range of stereo.
/// chosen: as for usual stereo cameras
const MIN_DISTANCE_M: f64 = 0.4;

/// A sine wave over the time `[0, 1]`.
#[derive(Clone, Copy, Debug)]
struct Wave {
    amplitude: f64,
    /// Number of periods.
    frequency: f64,
    phase_rad: f64,
}

impl Wave {
    /// A random wave with seven tenths to all of an amplitude.
    fn drawn(amplitude: f64, [low, high]: [f64; 2], rng: &mut impl Rng) -> Self {
        Self {
            amplitude: amplitude * random::uniform_in(rng, 0.7, 1.0),
            frequency: random::uniform_in(rng, low, high),
            phase_rad: random::uniform_in(rng, 0.0, TAU),
        }
    }

    fn value_at(&self, time: f64) -> f64 {
        self.amplitude * (TAU * self.frequency * time + self.phase_rad).sin()
    }
}

/// A smooth path of a camera, over the time `[0, 1]`.
#[derive(Clone, Debug)]
pub struct CameraPath {
    center: Point3<f64>,
    radius_m: f64,
    distance_m: f64,
    front_rad: f64,
    /// Range of the azimuth about the front, radians, without waves.
    sweep_rad: [f64; 2],
    start: f64,
    elevation: [Wave; 2],
    azimuth: Wave,
    range: Wave,
    look: [Wave; 3],
    roll: Wave,
}

impl CameraPath {
    /// A sweep around `center` of an object with radius `radius_m` and front at azimuth `front_rad`;
    /// `half_view_rad` is half the smaller field of view.
    pub fn new(
        center: Point3<f64>,
        radius_m: f64,
        front_rad: f64,
        half_view_rad: f64,
        rng: &mut impl Rng,
    ) -> Self {
        // Distance at which the object's sphere fits the smaller field of view.
        let distance_m = (radius_m / (FILL * half_view_rad).sin()).max(MIN_DISTANCE_M).max(1.5 * radius_m);
        let mut wave = |amplitude, low, high| Wave::drawn(amplitude, [low, high], rng);
        // A slow and a fast wave, with amplitudes of sum 1 to stay in bounds.
        let elevation = [wave(0.7, 1.5, 3.0), wave(0.3, 4.0, 7.0)];
        let azimuth = wave(0.08, 2.0, 5.0);
        let range = wave(0.06, 1.0, 4.0);
        let look = [0; 3].map(|_| wave(0.06, 1.0, 5.0));
        let roll = wave(0.07, 1.0, 4.0);
        let start = if random::is_chosen(rng, 0.5) { 1.0 } else { -1.0 };
        Self {
            center,
            radius_m,
            distance_m,
            front_rad,
            sweep_rad: [-HALF_SWEEP_RAD, HALF_SWEEP_RAD],
            start,
            elevation,
            azimuth,
            range,
            look,
            roll,
        }
    }

    /// The same path within another range of the azimuth about the front, radians.
    #[must_use]
    pub fn with_sweep(self, sweep_rad: [f64; 2]) -> Self {
        Self { sweep_rad, ..self }
    }

    /// Range of the azimuth about the front, radians, without waves.
    pub fn sweep(&self) -> [f64; 2] {
        self.sweep_rad
    }

    /// Azimuth about the front at a time in `[0, 1]`, radians, without waves.
    pub(super) fn sweep_at(&self, time: f64) -> f64 {
        let [from, to] = self.sweep_rad;
        0.5 * (from + to) + self.start * (0.5 * (to - from)) * (2.0 * time - 1.0)
    }

    /// `world_from_camera` (optical frame) at a time in `[0, 1]`.
    pub fn pose_at(&self, time: f64) -> Pose {
        let azimuth = self.front_rad + self.sweep_at(time) + self.azimuth.value_at(time);
        let [low, high] = ELEVATION_RAD;
        let waves = self.elevation[0].value_at(time) + self.elevation[1].value_at(time);
        let elevation = 0.5 * (low + high) + 0.5 * (high - low) * waves;
        let outward =
            Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let mut eye = self.center + outward * (self.distance_m * (1.0 + self.range.value_at(time)));
        // Low views of flat objects must stay above the floor.
        eye.z = eye.z.max(self.center.z + 0.1 * self.radius_m);
        let target = self.center + Vector3::from(self.look.map(|wave| wave.value_at(time))) * self.radius_m;
        let forward = (target - eye).try_normalize(1e-12).unwrap_or(-outward);
        // Starts with a level horizon, then adds the roll.
        let right = forward.cross(&Vector3::z()).try_normalize(1e-12).unwrap_or_else(Vector3::x);
        let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
        let upright = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.roll.value_at(time));
        Pose::from_parts(eye.coords.into(), upright * roll)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn the_object_stays_in_view_and_the_path_is_smooth() {
        for seed in 0..20 {
            let center = Point3::new(0.3, -0.2, 0.4);
            let path = CameraPath::new(center, 0.5, 0.7, 0.39, &mut stage_rng(seed, "path", 0));
            for i in 0..=60 {
                let pose = path.pose_at(f64::from(i) / 60.0);
                let seen = pose.inverse() * center;
                let off = seen.xy().coords.norm().atan2(seen.z);
                assert!(off < 0.05 && seen.z > 0.75, "{off} {}", seen.z);
                assert!(pose.translation.vector.z > 0.4);
                let next = path.pose_at(f64::from(i) / 60.0 + 1e-4);
                assert!((next.translation.vector - pose.translation.vector).norm() < 0.01);
                assert!(next.rotation.angle_to(&pose.rotation) < 0.01);
            }
        }
    }
}
