//! The up direction from an accelerometer fixed to the tracked camera. See docs/method.md 2.14.
//!
//! A reading is the sensor's acceleration minus gravity. The tracked poses give the acceleration: the second
//! difference of positions is its mean weighted by a triangle over the same time, for any motion in between.
//! Subtracting it leaves gravity and the sensor's bias, which rotates with the sensor.

use std::fmt;

use nalgebra::{Matrix3, Matrix6, SMatrix, Unit, Vector3, Vector6};

use geometry::Pose;
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Acceleration of free fall, m/s².
/// derived: the standard value; on Earth it ranges from 9.78 to 9.83
const GRAVITY: f64 = 9.806_65;
/// Prior standard deviation of the bias, m/s².
/// derived: 70 mg, the zero-g offset in the data sheet of the BMI055 of depth cameras
const BIAS: f64 = 0.07 * GRAVITY;
/// Direction error by axes that are not orthogonal, radians.
/// derived: 1 % cross-axis sensitivity in the same data sheet
const CROSS_AXIS_RAD: f64 = 0.01;
/// Largest relative error of the measured gravity's magnitude, beyond its deviation.
/// derived: 3 % tolerance of the sensitivity in data sheets of such sensors
const SENSITIVITY: f64 = 0.03;
/// Half the length of a time window, nanoseconds.
/// derived: position errors of 1 mm then give 1 cm/s² of acceleration, a thousandth of gravity
const HALF_NANOS: i64 = 500_000_000;
/// Largest gap between views, nanoseconds: beyond, the rotation in between is unknown.
/// derived: a hand does not turn and return in less
const GAP_NANOS: i64 = 300_000_000;
/// Fewest readings in a window.
/// derived: 20 a second; hand motion is slower than 10 Hz
const LEAST_READINGS: usize = 20;
/// Fewest windows for an estimate.
/// derived: gravity and bias have the unknowns of two windows, and two more
const LEAST_WINDOWS: usize = 4;
/// Residuals beyond this many deviations get less weight (Huber 1964). chosen: 95 % of normal residuals lie
/// within
const HUBER: f64 = 2.0;
/// Least standard deviation of a window, m/s².
/// derived: the noise of such a sensor over a window, 150 µg/√Hz
const LEAST_DEVIATION: f64 = 1.5e-3;
/// Most rounds of reweighting.
const ROUNDS: usize = 20;

/// Readings of an accelerometer fixed to the camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Accelerometer {
    /// Stamps in nanoseconds, increasing, with readings in m/s², in the axes of the camera's optical frame.
    /// At rest a reading points up.
    pub readings: Vec<(i64, Vector3<f64>)>,
    /// Position of the sensor in the optical frame, meters.
    pub place_m: Vector3<f64>,
}

/// The measured up direction in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredUp {
    /// Unit vector in the map.
    pub up: Unit<Vector3<f64>>,
    /// Its standard deviation in the least determined direction, radians.
    pub sigma_rad: f64,
    /// The sensor's bias, m/s².
    pub bias: Vector3<f64>,
    /// Number of time windows used.
    pub windows: usize,
}

/// Why accelerations give no up direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoGravity {
    /// Readings and poses overlap too little.
    Short {
        /// Number of time windows.
        windows: usize,
    },
    /// The magnitude at rest is not that of gravity, m/s².
    NotGravity(f64),
}

impl fmt::Display for NoGravity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { windows } => write!(
                f,
                "only {windows} half seconds hold both accelerations and tracked views, {LEAST_WINDOWS} are \
                 needed"
            ),
            Self::NotGravity(found) => write!(
                f,
                "they show {found:.2} m/s² at rest in place of {GRAVITY:.2}: another unit, or axes that are \
                 not those of their frame"
            ),
        }
    }
}

/// Means weighted by a triangle over a time window.
struct TimeWindow {
    /// Mean of the readings minus the sensor's acceleration, in the map.
    rest: Vector3<f64>,
    /// Mean rotation from the sensor to the map.
    turn: Matrix3<f64>,
}

/// The up direction in the map of views given by stamp, nanoseconds, and pose, in order of time.
///
/// # Errors
/// [`NoGravity`].
pub(super) fn measured_up(
    placed: &[(i64, Pose)],
    accelerometer: &Accelerometer,
) -> Result<MeasuredUp, NoGravity> {
    let windows = windows(placed, accelerometer);
    if windows.len() < LEAST_WINDOWS {
        return Err(NoGravity::Short { windows: windows.len() });
    }
    solve(&windows)
}

/// Windows that overlap by half; each spans views about half a second before and after its middle view.
fn windows(placed: &[(i64, Pose)], accelerometer: &Accelerometer) -> Vec<TimeWindow> {
    let mut all = Vec::new();
    let mut begin = 0;
    while begin < placed.len() {
        let after = |from: usize| (from..placed.len()).find(|&v| placed[v].0 >= placed[from].0 + HALF_NANOS);
        let Some(middle) = after(begin) else { break };
        let Some(end) = after(middle) else { break };
        all.extend(window(placed, [begin, middle, end], accelerometer));
        begin = middle;
    }
    all
}

fn window(
    placed: &[(i64, Pose)],
    [begin, middle, end]: [usize; 3],
    accelerometer: &Accelerometer,
) -> Option<TimeWindow> {
    let views = &placed[begin..=end];
    if views.windows(2).any(|pair| pair[1].0 - pair[0].0 > GAP_NANOS) {
        return None;
    }
    let [t0, t1, t2] = [begin, middle, end].map(|v| placed[v].0);
    let seconds = |from: i64, to: i64| (to - from) as f64 * 1e-9;
    let [p0, p1, p2] =
        [begin, middle, end].map(|v| (placed[v].1 * nalgebra::Point3::from(accelerometer.place_m)).coords);
    let before_s = seconds(t0, t1);
    let after_s = seconds(t1, t2);
    let moved = 2.0 * ((p2 - p1) / after_s - (p1 - p0) / before_s) / (before_s + after_s);
    let readings = &accelerometer.readings;
    let first = readings.partition_point(|r| r.0 <= t0);
    let last = readings.partition_point(|r| r.0 < t2);
    if last < first + LEAST_READINGS {
        return None;
    }
    let mut sum = 0.0;
    let mut read = Vector3::zeros();
    let mut turn = Matrix3::zeros();
    for k in first..last {
        let (t, value) = readings[k];
        // A reading represents the time to its neighbors.
        let [from, to] = [readings.get(k.wrapping_sub(1)), readings.get(k + 1)]
            .map(|r| r.map_or(t, |r| r.0.clamp(t0, t2)));
        let height = if t < t1 { seconds(t0, t) / before_s } else { seconds(t, t2) / after_s };
        let weight = height * seconds(from, to);
        let rotation = rotation_at(views, t)?.to_rotation_matrix();
        sum += weight;
        read += weight * (rotation * value);
        turn += weight * rotation.matrix();
    }
    (sum > 0.0).then(|| TimeWindow { rest: read / sum - moved, turn: turn / sum })
}

/// Rotation of the camera at a stamp, between two views.
fn rotation_at(views: &[(i64, Pose)], stamp: i64) -> Option<nalgebra::UnitQuaternion<f64>> {
    let next = views.partition_point(|v| v.0 <= stamp).clamp(1, views.len() - 1);
    let [(t0, a), (t1, b)] = [views[next - 1], views[next]];
    a.rotation.try_slerp(&b.rotation, (stamp - t0) as f64 / (t1 - t0) as f64, 1e-9)
}

/// Gravity and bias by robust least squares.
fn solve(windows: &[TimeWindow]) -> Result<MeasuredUp, NoGravity> {
    let mut weights = vec![1.0; windows.len()];
    let mut state = Vector6::<f64>::zeros();
    let mut covariance = Matrix6::<f64>::identity();
    let mut deviation = GRAVITY;
    for _ in 0..ROUNDS {
        let mut information = Matrix6::<f64>::zeros();
        let mut right = Vector6::<f64>::zeros();
        for (window, weight) in windows.iter().zip(&weights) {
            let row = row(window);
            information += row.transpose() * row * *weight;
            right += row.transpose() * window.rest * *weight;
        }
        // Prior of the bias, in units of the windows' deviation.
        for k in 3..6 {
            information[(k, k)] += (deviation / BIAS).powi(2);
        }
        let Some(inverse) = information.cholesky().map(|c| c.inverse()) else { break };
        state = inverse * right;
        let residuals: Vec<Vector3<f64>> = windows.iter().map(|w| w.rest - row(w) * state).collect();
        let parts = residuals.iter().flat_map(|r| r.iter().map(|x| x.abs())).collect();
        // Six values were fitted.
        let free = (3 * windows.len()) as f64 / (3 * windows.len() - 6) as f64;
        deviation = (SIGMAS_PER_MAD * median(parts).unwrap_or(0.0) * free.sqrt()).max(LEAST_DEVIATION);
        covariance = inverse * deviation.powi(2);
        let wide = HUBER * deviation * 3.0f64.sqrt();
        weights = residuals.iter().map(|r| (wide / r.norm().max(1e-12)).min(1.0)).collect();
    }
    let found: Vector3<f64> = state.fixed_rows::<3>(0).into();
    let spread: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into();
    let length = found.norm();
    let along = if length > 0.0 { (found.dot(&(spread * found)) / found.norm_squared()).sqrt() } else { 0.0 };
    let up = Unit::try_new(found, 1e-9)
        .filter(|_| (length - GRAVITY).abs() <= 3.0 * along.hypot(SENSITIVITY * GRAVITY))
        .ok_or(NoGravity::NotGravity(length))?;
    let across = Matrix3::identity() - up.into_inner() * up.transpose();
    let worst = (across * spread * across).symmetric_eigenvalues().max().max(0.0).sqrt() / length;
    Ok(MeasuredUp {
        up,
        sigma_rad: worst.hypot(CROSS_AXIS_RAD),
        bias: state.fixed_rows::<3>(3).into(),
        windows: windows.len(),
    })
}

fn row(window: &TimeWindow) -> SMatrix<f64, 3, 6> {
    let mut row = SMatrix::<f64, 3, 6>::zeros();
    row.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    row.fixed_view_mut::<3, 3>(0, 3).copy_from(&window.turn);
    row
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use numeric::random::{self, stage_rng};

    const RATE_HZ: f64 = 250.0;
    const SECONDS: f64 = 12.0;

    /// A camera that a hand carries around something: turns by `turn_rad`, nods, and shakes.
    fn pose(t: f64, turn_rad: f64) -> Pose {
        let yaw = turn_rad * (t / SECONDS - 0.5);
        let nod = 0.3 * turn_rad.min(1.0) * (1.1 * t).sin();
        let shake = Vector3::new((7.0 * t).sin(), (9.0 * t).cos(), (5.0 * t).sin()) * 0.01;
        let place = Vector3::new(yaw.sin(), -yaw.cos(), 0.3 + 0.1 * (0.9 * t).sin()) + shake;
        // Looks ahead along y of the world, z up: camera's x right, y down, z forward.
        let level = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        Pose::from_parts(
            place.into(),
            turned * level * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), nod),
        )
    }

    fn placed(rate_hz: f64, turn_rad: f64, map: &Pose) -> Vec<(i64, Pose)> {
        let rng = &mut stage_rng(1, "views", 0);
        let times = (0..(SECONDS * rate_hz) as usize).map(|k| k as f64 / rate_hz);
        let mut error = |sigma: f64| Vector3::from_fn(|_, _| sigma * random::standard_normal(rng));
        let view = |t: f64| {
            let pose = map * pose(t, turn_rad) * Pose::new(error(0.0005), error(0.001));
            ((t * 1e9) as i64, pose)
        };
        times.map(view).collect()
    }

    fn readings(turn_rad: f64, bias: Vector3<f64>, unit: f64) -> Accelerometer {
        let rng = &mut stage_rng(2, "readings", 0);
        let place_m = Vector3::new(-0.03, 0.01, 0.005);
        let at = |t: f64| (pose(t, turn_rad) * nalgebra::Point3::from(place_m)).coords;
        let readings = (0..(SECONDS * RATE_HZ) as usize).map(|k| {
            let t = k as f64 / RATE_HZ;
            let step = 1e-3;
            let moved = (at(t + step) - 2.0 * at(t) + at(t - step)) / (step * step);
            let held = moved + Vector3::z() * GRAVITY;
            let noise = Vector3::from_fn(|_, _| 0.0165 * random::standard_normal(rng));
            ((t * 1e9) as i64, unit * (pose(t, turn_rad).rotation.inverse() * held + bias + noise))
        });
        Accelerometer { readings: readings.collect(), place_m }
    }

    fn map() -> Pose {
        Pose::new(Vector3::new(0.3, 0.2, 0.1), Vector3::new(0.4, -0.9, 0.2))
    }

    #[test]
    fn a_biased_sensor_in_a_shaking_hand_shows_the_vertical_within_its_deviation() {
        let truth = map().rotation * Vector3::z();
        let bias = Vector3::new(0.5, -0.4, 0.6);
        for (rate_hz, turn_rad, most_rad) in [(15.0, 3.0, 0.012), (5.0, 3.0, 0.013), (15.0, 0.0, 0.12)] {
            let found =
                measured_up(&placed(rate_hz, turn_rad, &map()), &readings(turn_rad, bias, 1.0)).unwrap();
            let off = found.up.angle(&Unit::new_normalize(truth));
            assert!(off < 2.5 * found.sigma_rad && found.sigma_rad < most_rad, "{off} {found:?}");
            if turn_rad > 0.0 {
                // Turning shows the bias, without which up would err by 4 degrees.
                assert!(off < 0.004 && (found.bias - bias).norm() < 0.05, "{off} {found:?}");
            } else {
                assert!(off > 0.03 && found.sigma_rad > 0.06, "{off} {found:?}");
            }
        }
    }

    #[test]
    fn knocks_count_little() {
        let mut knocked = readings(3.0, Vector3::zeros(), 1.0);
        for (_, reading) in knocked.readings.iter_mut().skip(400).step_by(900) {
            reading.x += 150.0;
        }
        let found = measured_up(&placed(15.0, 3.0, &map()), &knocked).unwrap();
        let off = found.up.angle(&Unit::new_normalize(map().rotation * Vector3::z()));
        assert!(off < 0.01, "{off} {found:?}");
    }

    #[test]
    fn what_is_no_gravity_is_refused() {
        let views = placed(15.0, 3.0, &map());
        let in_g = readings(3.0, Vector3::zeros(), 1.0 / GRAVITY);
        let found = measured_up(&views, &in_g);
        assert!(matches!(found, Err(NoGravity::NotGravity(a)) if (a - 1.0).abs() < 0.1), "{found:?}");
        let full = readings(3.0, Vector3::zeros(), 1.0);
        let short = Accelerometer { readings: full.readings[..300].to_vec(), ..full.clone() };
        assert!(matches!(measured_up(&views, &short), Err(NoGravity::Short { .. })));
        // Axes of another frame: gravity does not stand still.
        let turned = |r: &(i64, Vector3<f64>)| (r.0, Vector3::new(r.1.y, r.1.z, r.1.x));
        let wrong = Accelerometer { readings: full.readings.iter().map(turned).collect(), ..full };
        let found = measured_up(&views, &wrong);
        assert!(found.is_err() || found.is_ok_and(|f| f.sigma_rad > 0.02), "{found:?}");
    }
}
