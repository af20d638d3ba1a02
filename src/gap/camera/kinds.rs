//! Another type of joint: a hinge where the twin has a slide, a slide or a screw where it has a hinge.
//!
//! Signature: a part that its joint cannot bring to where the frames show it, and another motion can. Directions are the
//! joint's own and those of the part's faces; hinges are tried on the joint's axis and along the part's edges, screws on
//! the axis with a range of pitches. The best starts are refined with their axis, or their pitch, free.

use nalgebra::{DVector, Point3, Unit, Vector3};

use super::{
    assess::{CameraFinding, estimate},
    fit::{GATE_M, MIDDLE, State, Work},
    parameter::{Parameter, normals_of},
    placement::{CoarseRun, find_position},
    residual::Sample,
    select::Selected,
    trial::{INTERVAL, Trial, free_joints},
    twin::{Hinge, Hypothesis, SeenTwin},
};
use crate::gap::verdict::Finding;

/// Index in reports, behind the catalogue.
const INDEX: usize = 100;
/// Cost of a pixel that conflicts.
const CONFLICT_COST: f64 = 4.5;
/// Errors of a twin beside the camera's, metres, in the cost of a pixel.
const SURFACE_M: f64 = 0.002;
/// Mean cost of a part's pixels from which its joint is doubted.
const DOUBT: f64 = 0.9;
/// The cost must fall to this share.
const FALL: f64 = 0.7;
/// Steps of refinement.
const STEPS: usize = 5;
/// Starts of each kind that are refined.
const REFINED: usize = 3;
/// Pitches of screws that are tried both ways, metres a radian.
const PITCHES: [f64; 6] = [0.001, 0.002, 0.0035, 0.006, 0.01, 0.016];
/// The new type may cost this much more than effects that fit every state by itself.
const STATEWISE_COST: f64 = 1.2;

/// A joint that was given another type.
#[derive(Clone, Debug, PartialEq)]
pub struct KindChange {
    /// Joint.
    pub joint: usize,
    /// Type in the twin.
    pub from: Hinge,
    /// Type that explains the frames.
    pub to: Hinge,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// A point of it in the joint frame, metres.
    pub point: Point3<f64>,
    /// Mean cost of the pixels before and after.
    pub cost: [f64; 2],
}

impl KindChange {
    /// Trials that free the law of the joint: its axis, and the pitch of a screw.
    #[must_use]
    pub fn free(&self, work: &Work) -> Vec<usize> {
        let of = |name: &str| work.trials.iter().position(|t| t.joint == Some(self.joint) && t.name == name);
        let pitch = if matches!(self.to, Hinge::Screw { .. }) { of("wrong_joint_type") } else { None };
        of("axis_offset").into_iter().chain(pitch).collect()
    }

    /// As a finding, its law and intervals those of a selection in which the law was free.
    #[must_use]
    pub fn finding(&self, work: &Work, freed: &Selected) -> CameraFinding {
        let law = freed.state.hypothesis.laws[self.joint];
        let normals = normals_of(&law.axis);
        let spread = |of: &dyn Fn(Parameter) -> f64| {
            let mut weights = DVector::zeros(freed.chosen.solution.values.len());
            let columns = freed.chosen.set.iter().flat_map(|&t| &work.trials[t].columns);
            for (w, c) in weights.iter_mut().skip(work.nuisance.len()).zip(columns) {
                *w = of(c.parameter);
            }
            INTERVAL * weights.dot(&(&freed.chosen.solution.covariance * &weights)).max(0.0).sqrt()
        };
        let joint = self.joint;
        let turned = |k: usize| {
            spread(&|p| match p {
                Parameter::AxisTurn(j, n) if j == joint => normals[n].cross(&law.axis)[k],
                _ => 0.0,
            })
        };
        let shifted = |k: usize| {
            spread(&|p| match p {
                Parameter::AxisShift(j, n) if j == joint => normals[n][k],
                _ => 0.0,
            })
        };
        let mut parameters: Vec<_> =
            ["axis_x", "axis_y", "axis_z"].iter().enumerate().map(|(k, n)| estimate(n, law.axis[k], "1", turned(k))).collect();
        if self.to.turns() {
            // The point of the axis next to the part's center: there turns of the axis do not move it.
            let center = work.twin.parts[work.twin.joints[joint].child].center;
            let point = law.point + law.axis.into_inner() * law.axis.dot(&(center - law.point));
            parameters.extend(["x", "y", "z"].iter().enumerate().map(|(k, n)| estimate(n, point[k], "m", shifted(k))));
        }
        if let Hinge::Screw { pitch_m_per_rad } = law.hinge {
            let half = spread(&|p| f64::from(u8::from(p == Parameter::Pitch(joint))));
            parameters.push(estimate("pitch", pitch_m_per_rad, "m/rad", half));
        }
        let finding = Finding {
            index: INDEX,
            effect: "wrong_joint_type".into(),
            parameters,
            weight: 1.0,
            alternatives: Vec::new(),
            experiment: "film the joint at three more positions over its whole range".into(),
        };
        CameraFinding { joint: Some(self.joint), finding, in_urdf: "native" }
    }
}

/// Looks for a joint whose part another type brings to where it is seen; the twin with that type and its state.
#[must_use]
pub fn other_kinds(work: &Work, first: &Selected) -> Option<(KindChange, SeenTwin, State)> {
    // What fits every state by itself may stand for a motion that the joint lacks.
    let statewise = first.chosen.set.iter().any(|&t| work.trials[t].log_odds < 0.0);
    let explained = mean_cost(work, &first.state.hypothesis);
    let before = costs(work, if statewise { &first.null.hypothesis } else { &first.state.hypothesis });
    let doubted = free_joints(work.twin).map(|j| (j, before[work.twin.joints[j].child])).filter(|(_, c)| *c > DOUBT);
    let (joint, _) = doubted.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let coarse: Vec<CoarseRun> = work.runs.iter().map(CoarseRun::of).collect();
    // The run that the twin fits worst shows the motion best.
    let worst = (0..coarse.len())
        .map(|r| (r, coarse[r].cost(work.twin, &first.null.hypothesis, r)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(r, _)| r)?;
    let mut starts: Vec<(f64, SeenTwin, Hypothesis)> = laws(work.twin, joint)
        .into_iter()
        .map(|(hinge, axis, point)| {
            let mut twin = work.twin.clone();
            let spec = &mut twin.joints[joint];
            if hinge.turns() != spec.hinge.turns() {
                spec.limit = None;
            }
            (spec.hinge, spec.axis, spec.point) = (hinge, axis, point);
            let mut start = Hypothesis::of(&twin, work.runs.len());
            start.positions.clone_from(&first.null.hypothesis.positions);
            start.positions.iter_mut().for_each(|p| p[joint] = 0.0);
            (find_position(&twin, &coarse[worst], &mut start, worst, joint), twin, start)
        })
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept = [0usize; 3];
    starts.retain(|(_, twin, _)| {
        let count = &mut kept[rank(twin.joints[joint].hinge)];
        *count += 1;
        *count <= REFINED
    });
    for (_, twin, start) in &mut starts {
        for r in (0..coarse.len()).filter(|r| *r != worst) {
            find_position(twin, &coarse[r], start, r, joint);
        }
    }
    let total = |c: &[f64]| c.last().copied().unwrap_or(f64::INFINITY);
    let mut best: Option<(f64, SeenTwin, State)> = None;
    for (_, mut twin, mut hypothesis) in starts {
        for _ in 0..STEPS {
            let own = work.of(&twin);
            let screw = matches!(twin.joints[joint].hinge, Hinge::Screw { .. });
            let free = |t: &Trial| t.joint == Some(joint) && t.name == if screw { "wrong_joint_type" } else { "axis_offset" };
            let set: Vec<usize> = own.trials.iter().position(free).into_iter().collect();
            let mut state = State { hypothesis, applied: Vec::new() };
            own.step(&mut state, &set, &MIDDLE, GATE_M);
            hypothesis = state.hypothesis;
        }
        let law = hypothesis.laws[joint];
        let spec = &mut twin.joints[joint];
        (spec.hinge, spec.axis, spec.point) = (law.hinge, law.axis, law.point);
        let cost = mean_cost(&work.of(&twin), &hypothesis);
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, twin, State { hypothesis, applied: Vec::new() }));
        }
    }
    let (cost, twin, state) = best?;
    let was = total(&before);
    let spec = &twin.joints[joint];
    let change =
        KindChange { joint, from: work.twin.joints[joint].hinge, to: spec.hinge, axis: spec.axis, point: spec.point, cost: [was, cost] };
    let better = cost < FALL * was && (!statewise || cost < STATEWISE_COST * explained);
    better.then_some((change, twin, state))
}

/// Place of a type among the three.
fn rank(hinge: Hinge) -> usize {
    match hinge {
        Hinge::Revolute => 0,
        Hinge::Prismatic => 1,
        Hinge::Screw { .. } => 2,
    }
}

/// Mean cost of all pixels, conflicts at a fixed cost: comparable between hypotheses of different types.
#[must_use]
pub fn mean_cost(work: &Work, hypothesis: &Hypothesis) -> f64 {
    costs(work, hypothesis).last().copied().unwrap_or(f64::INFINITY)
}

/// Mean cost of the pixels of every part, and over all.
fn costs(work: &Work, hypothesis: &Hypothesis) -> Vec<f64> {
    let samples = work.compare(hypothesis, GATE_M);
    let n = work.twin.parts.len();
    let mut sums = vec![(0.0, 0usize); n + 1];
    for s in &samples {
        let (part, cost) = match &s.sample {
            Sample::Match { seen, residual_m, sigma_m, .. } => {
                let variance = sigma_m * sigma_m + SURFACE_M * SURFACE_M;
                (Some(seen.part), (0.5 * residual_m * residual_m / variance).min(CONFLICT_COST))
            }
            Sample::Conflict { part, .. } => (*part, CONFLICT_COST),
        };
        for k in part.into_iter().chain([n]) {
            sums[k] = (sums[k].0 + cost, sums[k].1 + 1);
        }
    }
    sums.iter().map(|(sum, count)| sum / (*count).max(1) as f64).collect()
}

/// Laws of the other type that are tried: type, direction, point.
fn laws(twin: &SeenTwin, joint: usize) -> Vec<(Hinge, Unit<Vector3<f64>>, Point3<f64>)> {
    let spec = &twin.joints[joint];
    let faces = face_directions(twin, spec.child);
    let mut directions: Vec<Unit<Vector3<f64>>> = vec![spec.axis];
    for f in &faces {
        if directions.iter().all(|d| d.dot(f).abs() < 0.98) {
            directions.push(*f);
        }
    }
    if spec.hinge.turns() {
        let slides = directions.into_iter().map(|d| (Hinge::Prismatic, d, spec.point));
        let pitches = PITCHES.iter().flat_map(|p| [*p, -p]);
        let screws = pitches.map(|pitch_m_per_rad| (Hinge::Screw { pitch_m_per_rad }, spec.axis, spec.point));
        return slides.chain(screws).collect();
    }
    let mesh = &twin.parts[spec.child].mesh;
    let mut all = vec![(Hinge::Revolute, spec.axis, spec.point)];
    for d in directions {
        let [u, v] = sides(&d, &faces);
        let range = |e: &Vector3<f64>| {
            let of = mesh.vertices.iter().map(|p| p.cast::<f64>().coords.dot(e));
            of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
        };
        let (ru, rv, along) = (range(&u), range(&v), twin.parts[spec.child].center.coords.dot(&d));
        for (a, b) in [(ru.0, rv.0), (ru.0, rv.1), (ru.1, rv.0), (ru.1, rv.1)] {
            all.push((Hinge::Revolute, d, Point3::from(u * a + v * b + d.into_inner() * along)));
        }
        let middle = Point3::from(u * (0.5 * (ru.0 + ru.1)) + v * (0.5 * (rv.0 + rv.1)) + d.into_inner() * along);
        all.push((Hinge::Revolute, d, middle));
    }
    all
}

/// Two directions normal to an axis, along faces where there are such.
fn sides(axis: &Unit<Vector3<f64>>, faces: &[Unit<Vector3<f64>>]) -> [Vector3<f64>; 2] {
    let face = faces.iter().find(|f| f.dot(axis).abs() < 0.2);
    face.map_or_else(
        || super::parameter::normals_of(axis),
        |f| {
            let u = (f.into_inner() - axis.into_inner() * axis.dot(f)).normalize();
            [u, axis.cross(&u)]
        },
    )
}

/// Up to three directions that most of a part's faces have, normal to each other, in its frame.
fn face_directions(twin: &SeenTwin, part: usize) -> Vec<Unit<Vector3<f64>>> {
    const CANDIDATES: usize = 96;
    let mesh = &twin.parts[part].mesh;
    let normals: Vec<Vector3<f64>> = (0..mesh.triangles.len()).map(|t| mesh.area_normal(t).cast()).collect();
    let step = (normals.len() / CANDIDATES).max(1);
    let candidates: Vec<Unit<Vector3<f64>>> = normals.iter().step_by(step).filter_map(|n| Unit::try_new(*n, 1e-12)).collect();
    let area = |c: &Unit<Vector3<f64>>| {
        normals.iter().map(|n| (n.norm(), n.dot(c).abs())).filter(|(a, d)| *d > 0.97 * a).map(|(a, _)| a).sum::<f64>()
    };
    let mut chosen: Vec<Unit<Vector3<f64>>> = Vec::new();
    for _ in 0..2 {
        let free = candidates.iter().filter(|c| chosen.iter().all(|d| d.dot(c).abs() < 0.2));
        let Some(best) = free.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
        chosen.push(*best);
    }
    if let [a, b] = chosen[..]
        && let Some(c) = Unit::try_new(a.cross(&b), 1e-6)
    {
        chosen.push(c);
    }
    chosen
}
