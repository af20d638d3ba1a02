//! The accelerometer inside a camera.
//!
//! Noise and bias are from the data sheet of the BMI055 (Bosch Sensortec), used in the RealSense D435i, D455
//! and L515. Scale errors and axis misalignment are omitted.

use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::{CameraPath, SynthConfig};
use geometry::Pose;
use numeric::random::{self, stage_rng};

/// Acceleration of free fall, m/s². derived: the standard value
const GRAVITY: f64 = 9.806_65;
/// Readings per second. derived: the default of realsense2_camera
const RATE_HZ: f64 = 250.0;
/// Noise density, 150 µg/√Hz in m/s²/√Hz. derived: the data sheet of the BMI055
const NOISE: f64 = 150e-6 * GRAVITY;
/// Largest bias per axis, 70 mg in m/s². derived: the data sheet of the BMI055
const BIAS: f64 = 0.07 * GRAVITY;

/// One reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuReading {
    /// Time after the first view, nanoseconds; negative before it.
    pub after_nanos: i64,
    /// Reading, m/s², in the sensor's axes.
    pub acceleration: Vector3<f64>,
}

/// Pose of the sensor in the optical frame: behind and beside the lens, x forward and z up.
pub fn optical_from_imu() -> Pose {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, -0.5, 0.5, -0.5)).inverse();
    Pose::from_parts(Translation3::new(-0.03, 0.01, -0.005), turn)
}

/// Bias of a camera's sensor in its own axes, m/s².
pub fn imu_bias(config: &SynthConfig) -> Vector3<f64> {
    let rng = &mut stage_rng(config.seed, "synth/imu/bias", 0);
    Vector3::from_fn(|_, _| random::uniform_in(rng, -BIAS, BIAS))
}

/// Readings along the path of a take with `views` views, `period_nanos` apart; each is the mean over the time
/// to its neighbors.
pub(super) fn imu_readings(
    path: &CameraPath,
    take: usize,
    views: usize,
    period_nanos: i64,
    config: &SynthConfig,
) -> Vec<ImuReading> {
    let rng = &mut stage_rng(config.seed, &format!("synth/state{take}/imu"), 0);
    let bias = imu_bias(config);
    let period_s = 1e-9 * period_nanos as f64;
    let place = Point3::from(optical_from_imu().translation.vector);
    let pose = |after_s: f64| path.pose_at((0.5 + after_s / period_s) / views as f64);
    let at = |after_s: f64| (pose(after_s) * place).coords;
    let step_s = 1.0 / RATE_HZ;
    let sigma = NOISE * (0.5 * RATE_HZ).sqrt();
    // The path extends half a period before the first and after the last view.
    let count = (views as f64 * period_s * RATE_HZ) as usize;
    (1..count.max(2) - 1)
        .map(|k| {
            let after_s = k as f64 * step_s - 0.5 * period_s;
            let moved = (at(after_s + step_s) - 2.0 * at(after_s) + at(after_s - step_s)) / step_s.powi(2);
            let turn = (pose(after_s) * optical_from_imu()).rotation;
            let noise = Vector3::from_fn(|_, _| sigma * random::standard_normal(rng));
            let held = moved + Vector3::z() * GRAVITY;
            ImuReading {
                after_nanos: (1e9 * after_s).round() as i64,
                acceleration: turn.inverse() * held + bias + noise,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_those_of_the_data_sheet_about_gravity() {
        let config = SynthConfig { seed: 5, ..SynthConfig::default() };
        let path = CameraPath::new(Point3::origin(), 0.5, 0.3, 0.4, &mut stage_rng(3, "path", 0));
        let found = imu_readings(&path, 1, 150, 66_666_667, &config);
        assert!(found.len().abs_diff(2500) < 5, "{}", found.len());
        let bias = imu_bias(&config);
        assert!(bias.amax() <= BIAS && bias.norm() > 0.01);
        let pose = |r: &ImuReading| {
            path.pose_at((0.5 + r.after_nanos as f64 / 66_666_667.0) / 150.0) * optical_from_imu()
        };
        let up = found.iter().map(|r| pose(r).rotation * (r.acceleration - bias)).sum::<Vector3<f64>>();
        let up = up / found.len() as f64;
        assert!((up - Vector3::z() * GRAVITY).norm() < 0.15, "{up}");
        // Neighbors differ by noise alone: 16 mm/s² each.
        let steps: Vec<f64> =
            found.windows(2).map(|w| (w[1].acceleration - w[0].acceleration).norm_squared() / 6.0).collect();
        let sigma = (steps.iter().sum::<f64>() / steps.len() as f64).sqrt();
        assert!((0.015..0.03).contains(&sigma), "{sigma}");
    }
}
