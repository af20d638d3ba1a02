//! Combines a joint with a prior of its axis direction. See docs/method.md 8.8.

use nalgebra::{DMatrix, Matrix2, Matrix3x2, Matrix6, SMatrix, Unit, Vector3};

use crate::joints::{
    free_motion::{ParentMotion, surface_sigma_m},
    joint::JointEstimate,
    joint_fit::{JointMotion, Residuals},
    joint_motion::{Freedom, frame_across},
    minimise::{DIFFERENCE, left_difference},
    square_axes::SeenDirection,
};
use geometry::Pose;
use model::{AxisAlone, JointKind};

/// Singular values below this share of the largest count as zero: two of (direction 3, point 3) have no
/// effect, and finite differences ([`DIFFERENCE`]) leave 1e-10 to 1e-9 of them. Inverted, they would blow up
/// any covariance.
///
/// chosen: between this noise and the slopes of a real joint (no smaller than its motion in radians)
const FLAT: f64 = 1e-6;

impl JointEstimate {
    /// The direction of the axis from the motion alone; `None` where the motion does not determine it.
    pub fn seen_direction(&self) -> Option<SeenDirection> {
        let covariance: nalgebra::Matrix3<f64> = self.evidence.covariance.fixed_view::<3, 3>(0, 0).into();
        let known = covariance.iter().all(|c| c.is_finite()) && !matches!(self.kind, JointKind::Free { .. });
        known.then_some(SeenDirection { direction: self.axis, covariance })
    }

    /// The joint updated with a prior of its direction; its other parameters follow by their covariance with
    /// the direction (linear update of a Gaussian). `parents` are the motions of the parent from state 0 to
    /// the other states.
    pub fn with_axis_prior(mut self, prior: &SeenDirection, parents: &[ParentMotion]) -> Self {
        let before = self.evidence.covariance;
        let (a, b) = frame_across(&prior.direction);
        let across = Matrix3x2::from_columns(&[a, b]);
        // The prior is of the direction alone, observed as two components perpendicular to the prior's.
        let mut observe = SMatrix::<f64, 2, 7>::zeros();
        observe.fixed_view_mut::<2, 3>(0, 0).copy_from(&across.transpose());
        let noise: Matrix2<f64> = across.transpose() * prior.covariance * across;
        // Kalman gain, and the covariance in Joseph's form, which keeps it positive.
        let Some(inverse) = (observe * before * observe.transpose() + noise).try_inverse() else {
            return self;
        };
        let gain = before * observe.transpose() * inverse;
        // In that plane the prior lies at the origin, so the innovation is minus the offset of the axis.
        let step = gain * -(across.transpose() * self.axis.into_inner());
        let farthest = (0..self.positions.len()).find(|&k| self.positions[k] == self.largest_position());
        // A step that reverses the motion is not small: the linear update does not hold.
        let Some(farthest) = farthest.filter(|_| self.largest_position() + step[6] > 0.0) else {
            return self;
        };
        // The report keeps the axis from the motion alone, before the prior changes it.
        let std_rad = before.fixed_view::<3, 3>(0, 0).trace().sqrt();
        self.evidence.axis_alone = Some(AxisAlone { axis: self.axis, std_rad });
        let kept = SMatrix::<f64, 7, 7>::identity() - gain * observe;
        self.evidence.covariance = kept * before * kept.transpose() + gain * noise * gain.transpose();
        for k in 0..self.positions.len() {
            // Joseph's form once more, in the space of the motion: `back` maps a motion to the axis, `slopes`
            // maps a change of the axis to the motion, and the rest of the motion stays.
            let slopes = self.motion_slopes(k, k == farthest, &parents[k].state1_from_state0);
            let Ok(back) = slopes.clone().pseudo_inverse(FLAT * slopes.norm()) else { continue };
            let kept = DMatrix::identity(6, 6) - &slopes * gain * observe * back;
            let added = &slopes * gain * noise * gain.transpose() * slopes.transpose();
            // The prior does not reduce the covariance of the parent's motion.
            let parent = parents[k].covariance;
            let covariance = &kept * (self.covariances[k] - parent) * kept.transpose() + added;
            self.covariances[k] = parent + Matrix6::from_fn(|r, c| covariance[(r, c)]);
        }
        self.axis = Unit::new_normalize(self.axis.into_inner() + step.fixed_rows::<3>(0));
        self.point += step.fixed_rows::<3>(3);
        self.positions[farthest] += step[6];
        if let Some(std) = self.evidence.position_std.get_mut(farthest) {
            *std = self.evidence.covariance[(6, 6)].max(0.0).sqrt();
        }
        self.with_motions_on(parents.iter().map(|p| p.state1_from_state0))
    }

    /// The joint with its motions recomputed on moved parents.
    fn with_motions_on(mut self, parents: impl Iterator<Item = Pose>) -> Self {
        let joint = self.placed_joint();
        self.motions = parents.enumerate().map(|(k, parent)| joint.world_motion(k, &parent)).collect();
        self
    }

    /// A turning joint with its axis moved to the best place for its fixed direction; any other joint is
    /// returned as it is. A motion left out of the joint stays out.
    pub fn settled(mut self, motions: &[JointMotion]) -> Self {
        if !matches!(self.kind, JointKind::Revolute | JointKind::Screw { .. }) {
            return self;
        }
        // An infinite deviation marks a motion that contradicts the others.
        let kept: Vec<usize> = (0..motions.len())
            .filter(|k| self.evidence.position_std.get(*k).is_some_and(|std| std.is_finite()))
            .collect();
        if kept.is_empty() {
            return self;
        }
        let chosen: Vec<JointMotion> = kept.iter().map(|&k| motions[k]).collect();
        let sigma_m = kept.iter().map(|&k| surface_sigma_m(&motions[k].evidence, &self.motions[k])).collect();
        // The first two parameters are the direction: the prior has decided them, so they are held.
        let mut start = self.placed_joint();
        start.positions = kept.iter().map(|&k| self.positions[k]).collect();
        let joint = Residuals { motions: &chosen, sigma_m }.fitted_joint(start, 2).joint;
        for (k, m) in motions.iter().enumerate() {
            self.positions[k] = match kept.iter().position(|&own| own == k) {
                Some(own) => joint.positions[own],
                // A left-out motion does not take part in the fit; it gets the nearest position.
                None => {
                    joint.nearest_position(&(m.parent.state1_from_state0.inverse() * m.start), &joint.point)
                }
            };
        }
        self.point = joint.point;
        if joint.freedom == Freedom::Helix {
            self.kind = JointKind::Screw { pitch_m_per_rad: joint.pitch_m_per_rad };
        }
        self.with_motions_on(motions.iter().map(|m| m.parent.state1_from_state0))
    }

    /// Left perturbation of motion `k` in the world per unit of (direction 3, point 3, motion 1), 6 x 7. The
    /// last column is zero unless `own`: the motion parameter belongs to another state.
    fn motion_slopes(&self, k: usize, own: bool, parent: &Pose) -> DMatrix<f64> {
        let mut slopes = DMatrix::zeros(6, 7);
        for i in 0..7 {
            let [plus, minus] = [DIFFERENCE, -DIFFERENCE].map(|by| {
                let mut joint = self.placed_joint();
                match i {
                    0..3 => {
                        joint.direction = Unit::new_normalize(self.axis.into_inner() + Vector3::ith(i, by))
                    }
                    3..6 => joint.point += Vector3::ith(i - 3, by),
                    _ => joint.positions[k] += if own { by } else { 0.0 },
                }
                joint.world_motion(k, parent)
            });
            slopes.column_mut(i).copy_from(&(left_difference(&plus, &minus) / (2.0 * DIFFERENCE)));
        }
        slopes
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, UnitQuaternion};
    use proptest::prelude::*;

    use super::*;
    use model::JointEvidence;

    /// A hinge on a parent that turned, its covariances those of one another.
    fn hinge(
        axis: Unit<Vector3<f64>>,
        point: Point3<f64>,
        angle_rad: f64,
        parent: &ParentMotion,
    ) -> JointEstimate {
        let evidence = JointEvidence { inliers: 1, tried: 1, dispersion: 1.0, ..JointEvidence::default() };
        let mut joint = JointEstimate {
            kind: JointKind::Revolute,
            axis,
            point,
            positions: vec![angle_rad],
            motions: Vec::new(),
            drawn: Vec::new(),
            covariances: Vec::new(),
            evidence,
        };
        joint.motions = vec![joint.placed_joint().world_motion(0, &parent.state1_from_state0)];
        let across = Matrix3::identity() - axis.into_inner() * axis.transpose();
        let covariance = &mut joint.evidence.covariance;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(across * 3e-4));
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(across * 1e-6));
        covariance[(6, 6)] = 2e-5;
        let slopes = joint.motion_slopes(0, true, &parent.state1_from_state0);
        let own = &slopes * joint.evidence.covariance * slopes.transpose();
        joint.covariances = vec![Matrix6::from_fn(|r, c| own[(r, c)]) + parent.covariance];
        joint
    }

    proptest! {
        /// What is learned takes uncertainty away. (The inverse of slopes that are rounding alone made it
        /// 1450 deg.)
        #[test]
        fn a_prior_never_makes_a_motion_less_certain(
            tilt in prop::array::uniform3(-1.0f64..1.0),
            place in prop::array::uniform3(-2.0f64..2.0),
            angle_rad in 0.05f64..3.0,
            turned in prop::array::uniform3(-1.0f64..1.0),
        ) {
            prop_assume!(Vector3::from(tilt).norm() > 0.1);
            let axis = Unit::new_normalize(Vector3::from(tilt));
            let turn = UnitQuaternion::from_scaled_axis(turned.into());
            let state1_from_state0 = Pose::from_parts(Vector3::from(turned).into(), turn);
            let parent = ParentMotion {
                state1_from_state0,
                covariance: Matrix6::identity() * 1e-5,
                ..ParentMotion::static_part()
            };
            let before = hinge(axis, Point3::from(place), angle_rad, &parent);
            let prior = SeenDirection { direction: axis, covariance: Matrix3::identity() * 1e-5 };
            let after = before.clone().with_axis_prior(&prior, &[parent]);
            let [was, is] = [&before, &after].map(|j| j.covariances[0].trace());
            prop_assert!(is <= was * (1.0 + 1e-6), "{was:e} became {is:e}");
        }
    }
}
