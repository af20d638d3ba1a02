//! Another type of joint: a hinge where the twin has a slide, a slide where it has a hinge.
//!
//! Signature: a part that its joint cannot bring to where the frames show it, and another motion can. Directions are the
//! joint's own and those of the part's faces; hinges are tried along its edges. The best start is refined with its axis
//! free.

use nalgebra::{Point3, Unit, Vector3};

use super::{
    assess::{CameraFinding, estimate},
    fit::{GATE_M, State, Work},
    placement::{CoarseRun, find_position},
    residual::{Sample, compare},
    select::Selected,
    trial::free_joints,
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
    /// As a finding.
    #[must_use]
    pub fn finding(&self, _twin: &SeenTwin) -> CameraFinding {
        let mut parameters: Vec<_> =
            ["axis_x", "axis_y", "axis_z"].iter().enumerate().map(|(k, n)| estimate(n, self.axis[k], "1", 0.02)).collect();
        if self.to.turns() {
            parameters.extend(["x", "y", "z"].iter().enumerate().map(|(k, n)| estimate(n, self.point[k], "m", 0.005)));
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
    let before = costs(work, &first.state.hypothesis);
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
            (spec.hinge, spec.axis, spec.point, spec.limit) = (hinge, axis, point, None);
            let mut start = Hypothesis::of(&twin, work.runs.len());
            start.world_from_root.clone_from(&first.null.hypothesis.world_from_root);
            start.positions.clone_from(&first.null.hypothesis.positions);
            start.positions.iter_mut().for_each(|p| p[joint] = 0.0);
            (find_position(&twin, &coarse[worst], &mut start, worst, joint), twin, start)
        })
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.truncate(REFINED);
    for (_, twin, start) in &mut starts {
        for r in (0..coarse.len()).filter(|r| *r != worst) {
            find_position(twin, &coarse[r], start, r, joint);
        }
    }
    let total = |c: &[f64]| c.last().copied().unwrap_or(f64::INFINITY);
    let mut best: Option<(f64, SeenTwin, State)> = None;
    for (_, mut twin, mut hypothesis) in starts {
        for _ in 0..STEPS {
            let own = Work::new(&twin, work.runs, work.held_out_every);
            let axis: Vec<usize> = own.trials.iter().position(|t| t.name == "axis_offset" && t.joint == Some(joint)).into_iter().collect();
            let mut state = State { hypothesis, applied: Vec::new() };
            own.step(&mut state, &axis, GATE_M);
            hypothesis = state.hypothesis;
        }
        let law = hypothesis.laws[joint];
        let spec = &mut twin.joints[joint];
        (spec.axis, spec.point) = (law.axis, law.point);
        let cost = total(&costs(&Work::new(&twin, work.runs, work.held_out_every), &hypothesis));
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, twin, State { hypothesis, applied: Vec::new() }));
        }
    }
    let (cost, twin, state) = best?;
    let was = total(&before);
    let spec = &twin.joints[joint];
    let change =
        KindChange { joint, from: work.twin.joints[joint].hinge, to: spec.hinge, axis: spec.axis, point: spec.point, cost: [was, cost] };
    (cost < FALL * was).then_some((change, twin, state))
}

/// Mean cost of the pixels of every part, and over all.
fn costs(work: &Work, hypothesis: &Hypothesis) -> Vec<f64> {
    let samples = compare(work.twin, work.runs, &work.pixels, hypothesis, GATE_M);
    let n = work.twin.parts.len();
    let mut sums = vec![(0.0, 0usize); n + 1];
    for s in &samples {
        let (part, cost) = match &s.sample {
            Sample::Match { seen, residual_m, sigma_m } => {
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
        return directions.into_iter().map(|d| (Hinge::Prismatic, d, spec.point)).collect();
    }
    let mesh = &twin.parts[spec.child].mesh;
    let mut all = Vec::new();
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
