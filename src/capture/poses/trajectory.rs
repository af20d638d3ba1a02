//! The reported poses of a state along time.

use nalgebra::DVector;

use crate::RgbdFrame;
use geometry::{Pose, shift_and_turn};

/// Reported poses and their stamps, in order of time.
pub(super) struct Trajectory {
    pub poses: Vec<Pose>,
    stamps_s: Vec<f64>,
}

impl Trajectory {
    pub fn of_frames(frames: &[RgbdFrame]) -> Self {
        let first = frames.first().map_or(0, |f| f.stamp_nanos);
        Self {
            poses: frames.iter().map(|f| f.world_from_camera).collect(),
            stamps_s: frames.iter().map(|f| (f.stamp_nanos - first) as f64 * 1e-9).collect(),
        }
    }

    /// Camera velocities in their own frames, six values each, m/s and rad/s, by central differences; zero
    /// where stamps do not increase.
    pub fn velocities(&self) -> DVector<f64> {
        let last = self.poses.len().saturating_sub(1);
        let mut all = DVector::zeros(6 * self.poses.len());
        for i in 0..self.poses.len() {
            let before = i.saturating_sub(1);
            let after = (i + 1).min(last);
            let seconds = self.stamps_s[after] - self.stamps_s[before];
            if seconds > 0.0 {
                let [from, to] = [before, after].map(|k| self.poses[i].inverse() * self.poses[k]);
                let velocity = (shift_and_turn(&to) - shift_and_turn(&from)) / seconds;
                all.fixed_rows_mut::<6>(6 * i).copy_from(&velocity);
            }
        }
        all
    }

    /// The poses `delay_s` after their stamps; constant beyond either end.
    pub fn delayed_poses(&self, delay_s: f64) -> Vec<Pose> {
        self.stamps_s.iter().map(|stamp_s| self.pose_at(stamp_s + delay_s)).collect()
    }

    fn pose_at(&self, time_s: f64) -> Pose {
        let last = self.poses.len().saturating_sub(1);
        let after = self.stamps_s.partition_point(|&s| s <= time_s).clamp(1.min(last), last);
        let before = after.saturating_sub(1);
        let seconds = self.stamps_s[after] - self.stamps_s[before];
        let share = if seconds > 0.0 { (time_s - self.stamps_s[before]) / seconds } else { 0.0 };
        let step = shift_and_turn(&(self.poses[before].inverse() * self.poses[after])) * share;
        let [shift, turn] = [0, 3].map(|k| step.fixed_rows::<3>(k).into_owned());
        self.poses[before] * Pose::new(shift, turn)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn an_even_motion_is_followed_within_and_beyond_its_ends() {
        let way = |s: f64| Pose::new(Vector3::new(0.2 * s, 0.0, 0.1), Vector3::new(0.0, 0.0, 0.3 * s));
        let stamps_s = vec![0.0, 0.4, 1.0, 1.3, 2.0];
        let trajectory = Trajectory { poses: stamps_s.iter().map(|s| way(*s)).collect(), stamps_s };
        for delay_s in [-0.5, 0.0, 0.25, 0.7] {
            for (pose, s) in trajectory.delayed_poses(delay_s).iter().zip(&trajectory.stamps_s) {
                let off = way(s + delay_s).inverse() * pose;
                assert!(off.translation.vector.norm() < 0.01 && off.rotation.angle() < 1e-6, "{off}");
            }
        }
        let velocities = trajectory.velocities();
        let first = trajectory.poses[1].inverse_transform_vector(&Vector3::new(0.2, 0.0, 0.0));
        assert!((velocities.fixed_rows::<3>(6) - first).norm() < 0.01, "{velocities}");
        assert!((velocities[11] - 0.3).abs() < 1e-3);
    }
}
