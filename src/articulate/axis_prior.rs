//! A joint with a prior of its axis direction: what motion and prior tell together.

use nalgebra::{DMatrix, Matrix2, Matrix3x2, Matrix6, SMatrix, Unit, Vector3};

use super::{
    joint::{JointEstimate, ParentMotion, SIGMA_FLOOR},
    joint_motion::{Carried, Directed, RevoluteMotion, ScrewMotion, frame_across},
    motion_fit::{MotionEvidence, RefineConfig, left_difference, refine},
    square_axes::SeenDirection,
};
use crate::{
    geometry::{Pose, Screw},
    model::{AxisAlone, JointKind},
};

impl JointEstimate {
    /// The direction of the axis as the motion alone tells it; `None` where it does not.
    #[must_use]
    pub fn seen_direction(&self) -> Option<SeenDirection> {
        let covariance: nalgebra::Matrix3<f64> = self.evidence.covariance.fixed_view::<3, 3>(0, 0).into();
        let known = covariance.iter().all(|c| c.is_finite()) && !matches!(self.kind, JointKind::Free { .. });
        known.then_some(SeenDirection { direction: self.axis, covariance })
    }

    /// The joint with a prior of its direction, the rest of it moved by what the covariance says goes with that (linear update of
    /// a Gaussian). `parents` are the motions of the parent to the states behind state 0.
    #[must_use]
    pub fn towards(mut self, prior: &SeenDirection, parents: &[ParentMotion]) -> Self {
        let before = self.evidence.covariance;
        let (a, b) = frame_across(&prior.direction);
        let across = Matrix3x2::from_columns(&[a, b]);
        let mut observe = SMatrix::<f64, 2, 7>::zeros();
        observe.fixed_view_mut::<2, 3>(0, 0).copy_from(&across.transpose());
        let noise: Matrix2<f64> = across.transpose() * prior.covariance * across;
        let Some(inverse) = (observe * before * observe.transpose() + noise).try_inverse() else { return self };
        let gain = before * observe.transpose() * inverse;
        let step = gain * -(across.transpose() * self.axis.into_inner());
        let farthest = (0..self.positions.len()).find(|&k| self.positions[k] == self.motion());
        let Some(farthest) = farthest.filter(|_| self.motion() + step[6] > 0.0) else { return self };
        let std_rad = before.fixed_view::<3, 3>(0, 0).trace().sqrt();
        self.evidence.axis_alone = Some(AxisAlone { axis: self.axis, std_rad });
        let kept = SMatrix::<f64, 7, 7>::identity() - gain * observe;
        self.evidence.covariance = kept * before * kept.transpose() + gain * noise * gain.transpose();
        for k in 0..self.positions.len() {
            let slopes = self.slopes(k, k == farthest, &parents[k].state1_from_state0);
            let Ok(back) = slopes.clone().pseudo_inverse(1e-9) else { continue };
            let kept = DMatrix::identity(6, 6) - &slopes * gain * observe * back;
            let added = &slopes * gain * noise * gain.transpose() * slopes.transpose();
            let covariance = &kept * self.covariances[k] * kept.transpose() + added;
            self.covariances[k] = Matrix6::from_fn(|r, c| covariance[(r, c)]);
        }
        self.axis = Unit::new_normalize(self.axis.into_inner() + step.fixed_rows::<3>(0));
        self.point += step.fixed_rows::<3>(3);
        self.positions[farthest] += step[6];
        self.motions = (0..self.positions.len()).map(|k| parents[k].state1_from_state0 * self.at(self.positions[k])).collect();
        self
    }

    /// A turning joint with one motion, its axis moved to where it suits its direction best; any other as it is.
    pub(super) fn placed(mut self, parent: &ParentMotion, evidence: &MotionEvidence, config: &RefineConfig) -> Self {
        let parent = parent.state1_from_state0;
        let start = RevoluteMotion { direction: self.axis, point: self.point, angle_rad: self.positions[0] };
        let sigma_m = evidence.surface_sigma_m(&self.motions[0], evidence.reach_m * SIGMA_FLOOR);
        let turn = match self.kind {
            JointKind::Revolute => refine(Carried { parent, joint: Directed(start) }, evidence, sigma_m, config).model.joint.0,
            JointKind::Screw { pitch_m_per_rad } => {
                let screw = ScrewMotion { turn: start, advance_m: pitch_m_per_rad * start.angle_rad };
                let screw = refine(Carried { parent, joint: Directed(screw) }, evidence, sigma_m, config).model.joint.0;
                self.kind = JointKind::Screw { pitch_m_per_rad: screw.advance_m / screw.turn.angle_rad };
                screw.turn
            }
            JointKind::Prismatic | JointKind::Free { .. } => return self,
        };
        (self.point, self.positions) = (turn.point, vec![turn.angle_rad]);
        self.motions = vec![parent * self.at(turn.angle_rad)];
        self
    }

    /// Motion relative to the parent at a position.
    fn at(&self, position: f64) -> Pose {
        let (angle_rad, advance_m) = match self.kind {
            JointKind::Prismatic => (0.0, position),
            kind => (position, kind.pitch_m_per_rad().unwrap_or_default() * position),
        };
        Screw { direction: self.axis, point: self.point, angle_rad, advance_m }.motion()
    }

    /// Left perturbation of motion `k` in the world per unit of (direction 3, point 3, motion 1), 6 x 7; without the motion's
    /// where it is that of another state.
    fn slopes(&self, k: usize, own: bool, parent: &Pose) -> DMatrix<f64> {
        const H: f64 = 1e-6;
        let moved = |i: usize, by: f64| {
            let mut joint = self.clone();
            let mut position = self.positions[k];
            match i {
                0..3 => joint.axis = Unit::new_normalize(self.axis.into_inner() + Vector3::ith(i, by)),
                3..6 => joint.point += Vector3::ith(i - 3, by),
                _ => position += if own { by } else { 0.0 },
            }
            parent * joint.at(position)
        };
        let mut slopes = DMatrix::zeros(6, 7);
        (0..7).for_each(|i| slopes.column_mut(i).copy_from(&(left_difference(&moved(i, H), &moved(i, -H)) / (2.0 * H))));
        slopes
    }
}
