//! Joint type, axis and amount of motion, chosen by evidence.
//!
//! Each joint type is a family of motions. Every family is fitted to the same evidence; the type with the lowest
//! Bayesian information criterion `cost + parameters * ln(independent residuals)` wins. The released evaluation of the
//! published method takes the type from the ground truth; nothing here does.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Point3, SMatrix, Unit, Vector3};

use super::motion_fit::{FreeMotion, MotionEvidence, MotionModel, RefineConfig, Refined, refine};
use crate::{
    geometry::{Pose, Screw},
    model::{JointEvidence, JointKind},
};

/// Rotation about a fixed line: axis direction (2), point (2), angle (1).
#[derive(Clone, Copy, Debug)]
pub struct RevoluteMotion {
    /// Unit direction of the axis.
    pub direction: Unit<Vector3<f64>>,
    /// A point of the axis, near the part.
    pub point: Point3<f64>,
    /// Rotation, radians.
    pub angle_rad: f64,
}

impl MotionModel for RevoluteMotion {
    fn dimension(&self) -> usize {
        5
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        let (a, b) = frame_across(&self.direction);
        let direction = Unit::new_normalize(self.direction.into_inner() + a * s[0] + b * s[1]);
        Self { direction, point: self.point + a * s[2] + b * s[3], angle_rad: self.angle_rad + s[4] }
    }

    fn motion(&self) -> Pose {
        Screw { direction: self.direction, point: self.point, angle_rad: self.angle_rad, advance_m: 0.0 }.motion()
    }
}

/// Translation without rotation.
#[derive(Clone, Copy, Debug)]
pub struct PrismaticMotion(pub Vector3<f64>);

impl MotionModel for PrismaticMotion {
    fn dimension(&self) -> usize {
        3
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        Self(self.0 + Vector3::new(s[0], s[1], s[2]))
    }

    fn motion(&self) -> Pose {
        Pose::from_parts(self.0.into(), nalgebra::UnitQuaternion::identity())
    }
}

/// Two unit vectors that span the plane across a direction, a fixed choice for each direction.
fn frame_across(direction: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let d = direction.into_inner();
    let helper = if d.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let a = d.cross(&helper).normalize();
    (a, d.cross(&a))
}

/// A joint between the static part and a moving part, in the world frame as it stands in state 0.
#[derive(Clone, Debug)]
pub struct JointEstimate {
    /// Type with the best evidence.
    pub kind: JointKind,
    /// Unit axis direction; the motion from state 0 to state 1 is positive.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis near the part, metres.
    pub point: Point3<f64>,
    /// Motion from state 0 to state 1, radians or metres, positive.
    pub motion: f64,
    /// Rigid motion that the joint makes, state 0 to state 1.
    pub state1_from_state0: Pose,
    /// What it rests on.
    pub evidence: JointEvidence,
}

/// Smallest standard deviation of a surface residual as a share of the reach: below it lies systematic error of
/// poses and surfaces that more points do not average out.
const SIGMA_FLOOR: f64 = 0.02;
/// A rotation below this angle can't be told from a translation by the surfaces alone (method.md 5: 10 degrees), so
/// that a revolute joint then needs decisive evidence.
const DECISIVE: f64 = 10.0;

/// Fits all joint types to the evidence of one part, starting at a motion, and chooses.
#[must_use]
pub fn estimate_joint(start: &Pose, evidence: &MotionEvidence, near: &Point3<f64>, config: &RefineConfig) -> JointEstimate {
    let floor_m = evidence.reach_m * SIGMA_FLOOR;
    let mut free = refine(FreeMotion(*start), evidence, evidence.surface_sigma_m(start, floor_m), config);
    let sigma_m = evidence.surface_sigma_m(&free.model.motion(), floor_m);
    free = refine(free.model, evidence, sigma_m, config);
    let motion = free.model.motion();
    let prismatic = refine(PrismaticMotion(translation_at(&motion, near)), evidence, sigma_m, config);
    let revolute = revolute_start(&motion, near).map(|s| refine(s, evidence, sigma_m, config));

    let count = free.quadratic.independent.max(2.0);
    // Scale costs so that the free fit has one unit per residual at most: misfit that no motion explains must not
    // decide between types.
    let unit = (free.quadratic.cost / count).max(1.0);
    let score = |cost: f64, parameters: f64| cost / unit + parameters * count.ln();
    let mut type_scores = BTreeMap::new();
    type_scores.insert("free".to_owned(), score(free.quadratic.cost, 6.0));
    type_scores.insert("prismatic".to_owned(), score(prismatic.quadratic.cost, 3.0));
    if let Some(r) = &revolute {
        type_scores.insert("revolute".to_owned(), score(r.quadratic.cost, 5.0));
    }
    let turning = revolute.filter(|r| score(r.quadratic.cost, 5.0) < score(prismatic.quadratic.cost, 3.0));
    match turning {
        Some(r) => revolute_estimate(&r, &motion, near, unit, type_scores),
        None => prismatic_estimate(&prismatic, &motion, near, unit, type_scores),
    }
}

/// Displacement that a motion gives to a point.
fn translation_at(motion: &Pose, point: &Point3<f64>) -> Vector3<f64> {
    motion * point - point
}

/// The closest pure rotation, its point moved along the axis to be nearest to `near`.
fn revolute_start(motion: &Pose, near: &Point3<f64>) -> Option<RevoluteMotion> {
    let screw = Screw::of(motion)?;
    (screw.angle_rad > 1e-3).then(|| RevoluteMotion {
        direction: screw.direction,
        point: foot(&screw.point, &screw.direction, near),
        angle_rad: screw.angle_rad,
    })
}

/// The point of a line nearest to another point.
fn foot(point: &Point3<f64>, direction: &Unit<Vector3<f64>>, near: &Point3<f64>) -> Point3<f64> {
    point + direction.into_inner() * direction.dot(&(near - point))
}

fn revolute_estimate(
    fit: &Refined<RevoluteMotion>,
    free: &Pose,
    near: &Point3<f64>,
    unit: f64,
    type_scores: BTreeMap<String, f64>,
) -> JointEstimate {
    let mut m = fit.model;
    if m.angle_rad < 0.0 {
        m = RevoluteMotion { direction: -m.direction, angle_rad: -m.angle_rad, ..m };
    }
    let (a, b) = frame_across(&fit.model.direction);
    let mut spread = DMatrix::zeros(7, 5);
    for (column, v, row) in [(0, a, 0), (1, b, 0), (2, a, 3), (3, b, 3)] {
        spread.fixed_view_mut::<3, 1>(row, column).copy_from(&v);
    }
    spread[(6, 4)] = 1.0;
    let evidence = joint_evidence(fit, &spread, free, unit, type_scores, 1.0);
    JointEstimate {
        kind: JointKind::Revolute,
        axis: m.direction,
        point: foot(&m.point, &m.direction, near),
        motion: m.angle_rad,
        state1_from_state0: m.motion(),
        evidence,
    }
}

fn prismatic_estimate(
    fit: &Refined<PrismaticMotion>,
    free: &Pose,
    near: &Point3<f64>,
    unit: f64,
    type_scores: BTreeMap<String, f64>,
) -> JointEstimate {
    let t = fit.model.0;
    let motion = t.norm();
    let axis = Unit::try_new(t, 1e-9).unwrap_or_else(Vector3::x_axis);
    let mut spread = DMatrix::zeros(7, 3);
    let across = nalgebra::Matrix3::identity() - axis.into_inner() * axis.transpose();
    spread.fixed_view_mut::<3, 3>(0, 0).copy_from(&(across / motion.max(1e-9)));
    spread.fixed_view_mut::<1, 3>(6, 0).copy_from(&axis.transpose());
    let evidence = joint_evidence(fit, &spread, free, unit, type_scores, motion);
    JointEstimate { kind: JointKind::Prismatic, axis, point: *near, motion, state1_from_state0: fit.model.motion(), evidence }
}

/// Evidence of a fit; `spread` maps its parameters to (direction 3, point 3, motion 1).
fn joint_evidence<M>(
    fit: &Refined<M>,
    spread: &DMatrix<f64>,
    free: &Pose,
    unit: f64,
    type_scores: BTreeMap<String, f64>,
    motion: f64,
) -> JointEvidence {
    let q = &fit.quadratic;
    let mut cautions = Vec::new();
    let covariance = match &fit.covariance {
        Some(c) => {
            let full = spread * c * spread.transpose() * unit;
            SMatrix::from_fn(|r, c| full[(r, c)])
        }
        None => {
            cautions.push("some direction of the joint is not observed; its covariance is not finite".to_owned());
            SMatrix::from_element(f64::INFINITY)
        }
    };
    let spread_of = |from: usize| (0..3).map(|k| covariance[(from + k, from + k)]).sum::<f64>().sqrt();
    if spread_of(0) > 0.02 {
        cautions.push(format!("the axis direction is known to +-{:.1} deg only", spread_of(0).to_degrees()));
    }
    if spread_of(3) > 0.01 {
        cautions.push(format!("the axis position is known to +-{:.0} mm only", 1e3 * spread_of(3)));
    }
    let (p, r) = (type_scores.get("prismatic"), type_scores.get("revolute"));
    if let (Some(p), Some(r)) = (p, r)
        && (p - r).abs() < DECISIVE
    {
        cautions.push(format!("prismatic and revolute explain the motion about equally well (scores {p:.1} and {r:.1})"));
    }
    if q.inliers * 2 < q.tried {
        cautions.push(format!("only {} of {} observations agree with the motion", q.inliers, q.tried));
    }
    if motion <= 0.0 {
        cautions.push("no motion".to_owned());
    }
    JointEvidence {
        covariance,
        state1_from_state0: *free,
        inliers: q.inliers,
        tried: q.tried,
        residual_rms_m: q.rms_m(),
        type_scores,
        cautions,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Translation3};

    use super::*;
    use crate::{
        articulate::{MatchEvidence, SurfaceSamples},
        geometry::{Grid3, SceneBox, line_distance_m},
    };

    /// Signed distance of a box with half sides `h` at the origin.
    fn box_distance(p: &Point3<f64>, h: &Vector3<f64>) -> f64 {
        let q = p.coords.abs() - h;
        q.map(|x| x.max(0.0)).norm() + q.max().min(0.0)
    }

    fn box_samples(h: &Vector3<f64>, place: &Pose) -> SurfaceSamples {
        let mut s = SurfaceSamples::default();
        let n = 12;
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                for i in 0..n {
                    for j in 0..n {
                        let mut p = Vector3::zeros();
                        p[axis] = side * h[axis];
                        p[(axis + 1) % 3] = h[(axis + 1) % 3] * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
                        p[(axis + 2) % 3] = h[(axis + 2) % 3] * (2.0 * (j as f64 + 0.5) / n as f64 - 1.0);
                        let mut normal = Vector3::zeros();
                        normal[axis] = side;
                        s.points.push(place * Point3::from(p));
                        s.normals.push(place.rotation * normal);
                        s.colors.push([0.5; 3]);
                    }
                }
            }
        }
        s
    }

    /// A box of half sides `H` in state 0, moved in state 1; the estimate starts off the truth.
    fn check(motion: &Pose, kind: JointKind) -> JointEstimate {
        const H: Vector3<f64> = Vector3::new(0.2, 0.03, 0.15);
        let place = Pose::translation(0.1, 0.05, 0.0);
        let scene = SceneBox::around(&Point3::new(-0.5, -0.5, -0.5), &Point3::new(0.5, 0.5, 0.5));
        let mut grids = [Grid3::over(&scene, 101, 0.0f32), Grid3::over(&scene, 101, 0.0f32)];
        let seen = Grid3::over(&scene, 101, true);
        for (g, pose) in grids.iter_mut().zip([place, motion * place]) {
            for i in 0..g.values.len() {
                g.values[i] = box_distance(&pose.inverse_transform_point(&g.position(i)), &H) as f32;
            }
        }
        let surfaces = [box_samples(&H, &place), box_samples(&H, &(motion * place))];
        let matches: Vec<MatchEvidence> = surfaces[0].points[..40]
            .iter()
            .map(|p| MatchEvidence {
                point0: *p,
                point1: motion * p,
                covariance0: Matrix3::identity() * 4e-6,
                covariance1: Matrix3::identity() * 4e-6,
                share: 1.0,
            })
            .collect();
        let evidence = MotionEvidence {
            surfaces: [&surfaces[0], &surfaces[1]],
            sdf: [&grids[0], &grids[1]],
            visible: [&seen, &seen],
            matches: &matches,
            independent_area_m2: 1e-3,
            areas_m2: [0.3, 0.3],
            reach_m: 0.05,
        };
        let off = Pose::from_parts(Translation3::new(0.008, -0.006, 0.01), nalgebra::UnitQuaternion::from_euler_angles(0.02, 0.03, -0.02));
        let e = estimate_joint(&(off * motion), &evidence, &Point3::new(0.1, 0.05, 0.0), &RefineConfig::default());
        assert_eq!(e.kind, kind, "{:?}", e.evidence.type_scores);
        let difference = e.state1_from_state0 * motion.inverse();
        assert!(difference.rotation.angle() < 2e-3, "{}", difference.rotation.angle());
        assert!((e.state1_from_state0 * Point3::origin() - motion * Point3::origin()).norm() < 1e-3);
        e
    }

    #[test]
    fn a_turned_box_is_revolute_about_its_line() {
        let axis = Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0));
        let screw = Screw { direction: axis, point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.6, advance_m: 0.0 };
        let e = check(&screw.motion(), JointKind::Revolute);
        assert!(e.axis.angle(&axis) < 4e-3, "{}", e.axis.angle(&axis));
        assert!(line_distance_m((&e.point, &e.axis), (&screw.point, &axis)) < 2e-3);
        assert!((e.motion - 0.6).abs() < 2e-3);
    }

    #[test]
    fn a_small_turn_is_still_told_from_a_slide() {
        let screw = Screw { direction: Vector3::z_axis(), point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.1, advance_m: 0.0 };
        check(&screw.motion(), JointKind::Revolute);
    }

    #[test]
    fn a_slid_box_is_prismatic() {
        let e = check(&Pose::translation(0.12, 0.0, 0.02), JointKind::Prismatic);
        assert!((e.motion - 0.12f64.hypot(0.02)).abs() < 1e-3);
        assert!(e.evidence.covariance[(6, 6)].sqrt() < 1e-3);
    }
}
