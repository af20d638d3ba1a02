//! Joint type, axis and amount of motion, chosen by evidence.
//!
//! Each joint type is a family of motions relative to the parent. Every family is fitted to the same evidence; the type
//! with the lowest Bayesian information criterion `cost + parameters * ln(independent residuals)` wins, a screw only
//! decisively. The released evaluation of the published method takes the type from the ground truth; nothing here does.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, Matrix3, Matrix6, Point3, SMatrix, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    joint_motion::{Carried, PrismaticMotion, RevoluteMotion, ScrewMotion, foot, frame_across},
    motion_fit::{FreeMotion, MotionEvidence, MotionModel, RefineConfig, Refined, refine},
};
use crate::{
    geometry::Pose,
    model::{JointEvidence, JointKind},
};

/// What a joint's parent did between the states.
#[derive(Clone, Debug)]
pub struct ParentMotion {
    /// Its `state1_from_state0` in the world; the identity for the static part.
    pub state1_from_state0: Pose,
    /// Covariance of a left perturbation (translation 3, rotation 3) of that motion, square metres and radians; zero for
    /// the static part.
    pub covariance: Matrix6<f64>,
}

impl ParentMotion {
    /// The static part.
    #[must_use]
    pub fn still() -> Self {
        Self { state1_from_state0: Pose::identity(), covariance: Matrix6::zeros() }
    }
}

/// A joint between a parent and a moving part, in the world frame as it stands in state 0.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointEstimate {
    /// Type with the best evidence.
    pub kind: JointKind,
    /// Unit axis direction; the farthest motion from state 0 is positive.
    pub axis: Unit<Vector3<f64>>,
    /// A point of the axis near the part, metres.
    pub point: Point3<f64>,
    /// Position in every state behind state 0, where it is 0, radians or metres.
    pub positions: Vec<f64>,
    /// Rigid motions of the part in the world from state 0 to these: that of the parent and of the joint.
    pub motions: Vec<Pose>,
    /// Covariance of a left perturbation (translation 3, rotation 3) of each motion.
    pub covariances: Vec<Matrix6<f64>>,
    /// What it rests on.
    pub evidence: JointEvidence,
}

impl JointEstimate {
    /// Position farthest from that of state 0, radians or metres, positive.
    #[must_use]
    pub fn motion(&self) -> f64 {
        self.positions.iter().copied().fold(0.0, |a, b| if b.abs() > f64::abs(a) { b } else { a })
    }
}

/// Smallest standard deviation of a surface residual as a share of the reach: below it lies systematic error of
/// poses and surfaces that more points do not average out.
pub(super) const SIGMA_FLOOR: f64 = 0.02;
/// Difference of two scores from which one type is decisively better: very strong evidence in the sense of Kass and
/// Raftery (1995), on their scale of twice the log likelihood. Less of it is said, and a screw needs as much.
pub(super) const DECISIVE: f64 = 10.0;
/// Number of parameters of a prismatic, a revolute and a screw or free motion.
pub(super) const PARAMETERS: [f64; 3] = [3.0, 5.0, 6.0];

/// All joint types fitted to the evidence of one part.
struct Candidates {
    /// The motion without a joint.
    free: Pose,
    fixed_cost: f64,
    prismatic: Refined<Carried<PrismaticMotion>>,
    revolute: Option<Refined<Carried<RevoluteMotion>>>,
    screw: Option<Refined<Carried<ScrewMotion>>>,
    free_cost: f64,
    /// Squared error of a parameter against what independent residuals give.
    dispersion: f64,
    /// Independent residuals after that.
    count: f64,
}

impl Candidates {
    fn fit(start: &Pose, parent: &ParentMotion, evidence: &MotionEvidence, near: &Point3<f64>, config: &RefineConfig) -> Self {
        let (free, dispersion) = fit_free(start, evidence, config);
        let (motion, sigma_m) = (free.model.motion(), free.sigma_m);
        let parent = parent.state1_from_state0;
        let relative = parent.inverse() * motion;
        let turn = RevoluteMotion::of(&relative, near);
        let advance_m = crate::geometry::Screw::of(&relative).map_or(0.0, |s| s.advance_m);
        let slide = PrismaticMotion(relative * near - near);
        let independent = free.quadratic.independent.max(2.0);
        Self {
            free: motion,
            fixed_cost: evidence.linearise(&parent, sigma_m, config).cost,
            prismatic: refine(Carried { parent, joint: slide }, evidence, sigma_m, config),
            revolute: turn.map(|joint| refine(Carried { parent, joint }, evidence, sigma_m, config)),
            screw: turn.map(|turn| refine(Carried { parent, joint: ScrewMotion { turn, advance_m } }, evidence, sigma_m, config)),
            free_cost: free.quadratic.cost,
            dispersion,
            count: (independent / dispersion).max(2.0),
        }
    }

    /// Bayesian information criterion in units of the errors that were seen.
    fn score(&self, cost: f64, parameters: f64) -> f64 {
        cost / self.dispersion + parameters * self.count.ln()
    }

    fn scores(&self, (near, radius_m): (&Point3<f64>, f64)) -> BTreeMap<String, f64> {
        let [slides, turns, any] = PARAMETERS;
        let mut scores = BTreeMap::from([
            ("fixed".to_owned(), self.score(self.fixed_cost, 0.0)),
            ("prismatic".to_owned(), self.score(self.prismatic.quadratic.cost, slides)),
            ("free".to_owned(), self.score(self.free_cost, any)),
        ]);
        if let Some(r) = &self.revolute {
            scores.insert("revolute".to_owned(), self.score(r.quadratic.cost, turns) + far(&r.model.joint, near, radius_m));
        }
        if let Some(s) = &self.screw {
            scores.insert("screw".to_owned(), self.score(s.quadratic.cost, any) + far(&s.model.joint.turn, near, radius_m));
        }
        scores
    }
}

/// Score of the best joint with one freedom against that of the free motion; a screw, which is one of any motion, pays as in the
/// choice of the type, and counts only where it is `threaded`.
pub(super) fn excess(scores: &BTreeMap<String, f64>, threaded: bool) -> f64 {
    let of = |name: &str| scores.get(name).copied().unwrap_or(f64::INFINITY);
    let screw = if threaded { of("screw") + DECISIVE } else { f64::INFINITY };
    of("prismatic").min(of("revolute")).min(screw) - of("free")
}

/// What speaks against an axis far from its part, on the scale of the scores: a hinge is on the part or beside it, so that the
/// distance of the axis from the part's middle is taken as that of a Student distribution with two degrees of freedom, over
/// twice the radius of the part. A slide is a turn about an axis far away.
pub(super) fn far(turn: &RevoluteMotion, near: &Point3<f64>, radius_m: f64) -> f64 {
    let off_m = (foot(&turn.point, &turn.direction, near) - near).norm();
    4.0 * (off_m / (2.0 * radius_m)).powi(2).ln_1p()
}

/// Fits all joint types to the evidence of one part, starting at a motion, and chooses, unless the `kind` is known. `near` is the
/// middle of the part in state 0 and `radius_m` the distance of its farthest point from there.
#[must_use]
pub fn estimate_joint(
    start: &Pose,
    parent: &ParentMotion,
    evidence: &MotionEvidence,
    (near, radius_m): (&Point3<f64>, f64),
    kind: Option<JointKind>,
    config: &RefineConfig,
) -> JointEstimate {
    let found = Candidates::fit(start, parent, evidence, near, config);
    let scores = found.scores((near, radius_m));
    let of = |name: &str| among(kind, &scores, name);
    let simple = of("prismatic").min(of("revolute"));
    let chosen = match (&found.screw, &found.revolute) {
        (Some(screw), _) if of("screw") + DECISIVE < simple => {
            let turn = &screw.model.joint.turn;
            let off_m = (foot(&turn.point, &turn.direction, near) - near).norm();
            let pitch_m_per_rad = screw.model.joint.advance_m / turn.angle_rad;
            // The thread is on the part: a screw line beside it is that of a free motion.
            let kind = if off_m < radius_m { JointKind::Screw { pitch_m_per_rad } } else { JointKind::Free { pitch_m_per_rad } };
            Chosen::turning(screw, turn, kind, screw.model.joint.advance_m)
        }
        (_, Some(revolute)) if of("revolute") < of("prismatic") => {
            Chosen::turning(revolute, &revolute.model.joint, JointKind::Revolute, 0.0)
        }
        _ => Chosen::sliding(&found.prismatic, near),
    };
    chosen.estimate(&found, parent, near, scores)
}

/// Score of a type; infinite where it was not fitted or another is known to be right.
pub(super) fn among(known: Option<JointKind>, scores: &BTreeMap<String, f64>, name: &str) -> f64 {
    let right = known.is_none_or(|k| k.name() == name || k.name() == "free" && name == "screw");
    scores.get(name).copied().filter(|_| right).unwrap_or(f64::INFINITY)
}

/// The motion of a part without a joint, with its covariance; zero in directions that nothing observes.
#[must_use]
pub fn free_motion(start: &Pose, evidence: &MotionEvidence, config: &RefineConfig) -> ParentMotion {
    let (free, dispersion) = fit_free(start, evidence, config);
    let displacements = free.quadratic.displacements();
    let covariance = free.covariance.map_or_else(Matrix6::zeros, |c| {
        let c = Matrix6::from_fn(|r, k| c[(r, k)]);
        c * dispersion + c * displacements * c
    });
    ParentMotion { state1_from_state0: free.model.motion(), covariance }
}

/// The free motion and the squared error of its parameters against what independent residuals give.
pub(super) fn fit_free(start: &Pose, evidence: &MotionEvidence, config: &RefineConfig) -> (Refined<FreeMotion>, f64) {
    let floor_m = evidence.reach_m * SIGMA_FLOOR;
    let free = refine(FreeMotion(*start), evidence, evidence.surface_sigma_m(start, floor_m), config);
    let sigma_m = evidence.surface_sigma_m(&free.model.motion(), floor_m);
    let free = refine(free.model, evidence, sigma_m, config);
    let scale = free.quadratic.cost / free.quadratic.independent.max(2.0);
    let dispersion = scale.max(free.quadratic.dispersion(&DMatrix::identity(6, 6)));
    (free, dispersion)
}

/// A fit with what all types share.
struct Chosen {
    kind: JointKind,
    direction: Unit<Vector3<f64>>,
    point: Point3<f64>,
    /// Positive or negative.
    motion: f64,
    state1_from_state0: Pose,
    /// Left perturbations of the motion per parameter, 6 x n.
    tangent: DMatrix<f64>,
    information: Matrix6<f64>,
    displacements: Matrix6<f64>,
    covariance: Option<DMatrix<f64>>,
    /// Maps the parameters to (direction 3, point 3, motion 1, pitch 1).
    spread: DMatrix<f64>,
    agreement: [usize; 2],
    residual_rms_m: f64,
}

impl Chosen {
    fn new<M: MotionModel>(fit: &Refined<M>, spread: DMatrix<f64>) -> Self {
        let q = &fit.quadratic;
        Self {
            kind: JointKind::Prismatic,
            direction: Vector3::x_axis(),
            point: Point3::origin(),
            motion: 0.0,
            state1_from_state0: fit.model.motion(),
            tangent: fit.model.tangent(),
            information: q.information,
            displacements: q.displacements(),
            covariance: fit.covariance.clone(),
            spread,
            agreement: [q.inliers, q.tried],
            residual_rms_m: q.rms_m(),
        }
    }

    fn turning<M: MotionModel>(fit: &Refined<M>, turn: &RevoluteMotion, kind: JointKind, advance_m: f64) -> Self {
        let (a, b) = frame_across(&turn.direction);
        let n = fit.model.dimension();
        let mut spread = DMatrix::zeros(8, n);
        for (column, v, row) in [(0, a, 0), (1, b, 0), (2, a, 3), (3, b, 3)] {
            spread.fixed_view_mut::<3, 1>(row, column).copy_from(&v);
        }
        spread[(6, 4)] = 1.0;
        if n > 5 {
            spread[(7, 4)] = -advance_m / turn.angle_rad.powi(2);
            spread[(7, 5)] = 1.0 / turn.angle_rad;
        }
        Self { kind, direction: turn.direction, point: turn.point, motion: turn.angle_rad, ..Self::new(fit, spread) }
    }

    fn sliding(fit: &Refined<Carried<PrismaticMotion>>, near: &Point3<f64>) -> Self {
        let t = fit.model.joint.0;
        let motion = t.norm();
        let direction = Unit::try_new(t, 1e-9).unwrap_or_else(Vector3::x_axis);
        let mut spread = DMatrix::zeros(8, 3);
        let across = Matrix3::identity() - direction.into_inner() * direction.transpose();
        spread.fixed_view_mut::<3, 3>(0, 0).copy_from(&(across / motion.max(1e-9)));
        spread.fixed_view_mut::<1, 3>(6, 0).copy_from(&direction.transpose());
        Self { kind: JointKind::Prismatic, direction, point: *near, motion, ..Self::new(fit, spread) }
    }

    /// Covariance of the parameters by what the fit rests on: residuals, and displacements of the surfaces.
    fn own_covariance(&self, dispersion: f64) -> Option<DMatrix<f64>> {
        let response = self.covariance.as_ref()? * self.tangent.transpose();
        Some(self.covariance.as_ref()? * dispersion + &response * self.displacements * response.transpose())
    }

    /// Covariance of the parameters: that of the fit, and that of the parent's motion, which shifts the joint by what the
    /// fit makes of it.
    fn parameter_covariance(&self, dispersion: f64, parent: &ParentMotion) -> Option<DMatrix<f64>> {
        let own = self.own_covariance(dispersion)?;
        let carried = self.covariance.as_ref()? * self.tangent.transpose() * self.information;
        Some(own + &carried * parent.covariance * carried.transpose())
    }

    fn estimate(self, found: &Candidates, parent: &ParentMotion, near: &Point3<f64>, scores: BTreeMap<String, f64>) -> JointEstimate {
        let covariance = self.parameter_covariance(found.dispersion, parent);
        let forward = self.motion >= 0.0;
        let full: SMatrix<f64, 8, 8> = match &covariance {
            Some(c) => {
                let full = &self.spread * c * self.spread.transpose();
                directed(SMatrix::from_fn(|r, c| full[(r, c)]), forward)
            }
            None => SMatrix::from_element(f64::INFINITY),
        };
        let own = self.own_covariance(found.dispersion).map(|c| &self.tangent * c * self.tangent.transpose());
        let own: Matrix6<f64> = own.map_or_else(Matrix6::zeros, |c| Matrix6::from_fn(|r, k| c[(r, k)]));
        let (axis, motion) = if forward { (self.direction, self.motion) } else { (-self.direction, -self.motion) };
        let (kind, agreement) = (self.kind, self.agreement);
        let cautions = cautions(&Cautioned { kind, motion, scores: &scores, agreement });
        let evidence = JointEvidence {
            covariance: full.fixed_view::<7, 7>(0, 0).into(),
            position_std: Vec::new(),
            pitch_std_m_per_rad: if self.kind.pitch_m_per_rad().is_some() { full[(7, 7)].max(0.0).sqrt() } else { 0.0 },
            state1_from_state0: found.free,
            inliers: self.agreement[0],
            tried: self.agreement[1],
            residual_rms_m: self.residual_rms_m,
            dispersion: found.dispersion,
            type_scores: scores,
            parents: BTreeMap::new(),
            axis_alone: None,
            cautions,
            not_observable: not_observable(self.kind, 2),
        };
        JointEstimate {
            kind: self.kind,
            axis,
            point: foot(&self.point, &axis, near),
            positions: vec![motion],
            motions: vec![self.state1_from_state0],
            covariances: vec![own + parent.covariance],
            evidence,
        }
    }
}

/// The covariance of (direction 3, point 3, motion 1, pitch 1) where the axis is turned round unless it points `forward`.
pub(super) fn directed(covariance: SMatrix<f64, 8, 8>, forward: bool) -> SMatrix<f64, 8, 8> {
    let turned = |i: usize| !forward && !(3..6).contains(&i) && i != 7;
    SMatrix::from_fn(|r, c| if turned(r) == turned(c) { covariance[(r, c)] } else { -covariance[(r, c)] })
}

/// What a joint is judged by.
pub(super) struct Cautioned<'a> {
    pub kind: JointKind,
    /// Farthest from state 0, positive.
    pub motion: f64,
    pub scores: &'a BTreeMap<String, f64>,
    /// Observations that agree with the joint, of those tried.
    pub agreement: [usize; 2],
}

/// What speaks against trusting a joint, in words; what its deviations say is in `vagueness`, once they are final.
pub(super) fn cautions(joint: &Cautioned<'_>) -> Vec<String> {
    let Cautioned { kind, motion, scores, agreement: [agree, tried] } = *joint;
    let mut cautions = Vec::new();
    if let (Some(p), Some(r)) = (scores.get("prismatic"), scores.get("revolute"))
        && (p - r).abs() < DECISIVE
    {
        cautions.push(format!("prismatic and revolute explain the motion about equally well (scores {p:.1} and {r:.1})"));
    }
    if matches!(kind, JointKind::Free { .. }) {
        cautions.push("no joint type explains the motion; the twin moves the part along the screw of it".to_owned());
    }
    if motion <= 0.0 {
        cautions.push("no motion".to_owned());
    }
    if agree * 2 < tried {
        cautions.push(format!("only {agree} of {tried} observations agree with the motion"));
    }
    cautions
}

/// What some states of a part cannot tell.
pub(super) fn not_observable(kind: JointKind, states: usize) -> Vec<String> {
    let count = if states == 2 { "two".to_owned() } else { states.to_string() };
    let mut said = vec![format!("the joint's limits: it reaches at least the {count} observed positions")];
    if kind.turns() {
        said.push("whole turns: the smallest rotation between the states is taken".to_owned());
    }
    if kind.pitch_m_per_rad().is_some() {
        said.push(
            "a screw against a rotation and a translation of their own along one axis; the pitch rests on the smallest rotation".to_owned(),
        );
    }
    said
}

#[cfg(test)]
mod tests {
    use nalgebra::Translation3;

    use super::*;
    use crate::{
        articulate::{MatchEvidence, SeenDirection, SurfaceSamples},
        geometry::{Grid3, SceneBox, Screw, line_distance_m},
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
            block_m: 0.08,
            offsets_m: [&[]; 2],
            displacement_m: 0.0,
            piece_m: 0.2,
        };
        let off = Pose::from_parts(Translation3::new(0.008, -0.006, 0.01), nalgebra::UnitQuaternion::from_euler_angles(0.02, 0.03, -0.02));
        let place = (&Point3::new(0.1, 0.05, 0.0), 0.25);
        let e = estimate_joint(&(off * motion), &ParentMotion::still(), &evidence, place, None, &RefineConfig::default());
        assert_eq!(e.kind, kind, "{:?}", e.evidence.type_scores);
        let difference = e.motions[0] * motion.inverse();
        assert!(difference.rotation.angle() < 2e-3, "{}", difference.rotation.angle());
        assert!((e.motions[0] * Point3::origin() - motion * Point3::origin()).norm() < 1e-3);
        e
    }

    #[test]
    fn a_turned_box_is_revolute_about_its_line() {
        let axis = Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0));
        let screw = Screw { direction: axis, point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.6, advance_m: 0.0 };
        let e = check(&screw.motion(), JointKind::Revolute);
        assert!(e.axis.angle(&axis) < 4e-3, "{}", e.axis.angle(&axis));
        assert!(line_distance_m((&e.point, &e.axis), (&screw.point, &axis)) < 2e-3);
        assert!((e.motion() - 0.6).abs() < 2e-3);
    }

    #[test]
    fn a_small_turn_is_still_told_from_a_slide() {
        let screw = Screw { direction: Vector3::z_axis(), point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.1, advance_m: 0.0 };
        check(&screw.motion(), JointKind::Revolute);
    }

    #[test]
    fn a_prior_moves_the_axis_and_what_goes_with_it() {
        let screw = Screw { direction: Vector3::z_axis(), point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.3, advance_m: 0.0 };
        let e = check(&screw.motion(), JointKind::Revolute);
        let still = [ParentMotion::still()];
        let prior = |lean: f64, std_rad: f64| {
            let direction = Unit::new_normalize(e.axis.into_inner() + Vector3::x() * lean);
            SeenDirection { direction, covariance: Matrix3::identity() * std_rad.powi(2) }
        };
        let deviation = |e: &JointEstimate| e.evidence.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        // One that tells nothing changes nothing.
        let vague = e.clone().towards(&prior(0.03, 1e3), &still);
        assert!(vague.axis.angle(&e.axis) < 1e-6 && (deviation(&vague) / deviation(&e) - 1.0).abs() < 1e-6);
        assert!((vague.covariances[0] - e.covariances[0]).norm() < 1e-6 * e.covariances[0].norm());
        assert!(vague.evidence.axis_alone.is_some_and(|a| a.axis == e.axis && a.std_rad == deviation(&e)));
        // One that is known better is followed, and the motion is that of the joint.
        let firm = e.clone().towards(&prior(0.03, 1e-5), &still);
        assert!(firm.axis.angle(&prior(0.03, 1.0).direction) < 1e-4 && deviation(&firm) < 3e-5);
        assert!(firm.covariances[0].trace() < e.covariances[0].trace());
        let told = Screw { direction: firm.axis, point: firm.point, angle_rad: firm.motion(), advance_m: 0.0 }.motion();
        let middle = Point3::new(0.1, 0.05, 0.0);
        assert!((firm.motions[0] * told.inverse()).rotation.angle() < 1e-9);
        assert!((told * middle - screw.motion() * middle).norm() < 5e-4);
    }

    #[test]
    fn a_slid_box_is_prismatic() {
        let e = check(&Pose::translation(0.12, 0.0, 0.02), JointKind::Prismatic);
        assert!((e.motion() - 0.12f64.hypot(0.02)).abs() < 1e-3);
        assert!(e.evidence.covariance[(6, 6)].sqrt() < 1e-3);
    }
}
