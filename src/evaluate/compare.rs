//! Evaluation of one run against the truth.

use std::collections::BTreeMap;

use nalgebra::Point3;
use serde::Serialize;

use super::{
    EvaluateError, EvaluateOptions,
    joint_metrics::{JointRow, displacement_m},
    matching::{MAX_PARTS, cheapest_pairs},
    run_files::RunFiles,
    surface_metrics::{chamfer_distance, mean_distance_mm, points_on_surface},
    truth::{TrueJoint, TruePart, Truth},
};
use numeric::random::stage_rng;
use surface::TriangleMesh;

/// Expected Chamfer distance (1e-3 m^2) of two samplings of the same surface, per square meter and 10,000
/// samples (`1000 * 2 A / (pi N)`; docs/method.md 13.2). derived: that formula
const FLOOR_PER_M2: f64 = 0.0637;
/// Number of samples this constant holds for. derived: that of the published evaluation
const FLOOR_SAMPLES: f64 = 10_000.0;
/// Stride through the seen points to be measured.
const SEEN_STRIDE: usize = 4;

/// All measurements of one run.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Folder of the run.
    pub run: String,
    /// Why the run has no twin, if it has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// Parts of the true object, the static one included.
    pub parts_true: usize,
    /// Number of parts found by the run.
    pub parts_found: usize,
    /// One row for every movable true part.
    pub joints: Vec<JointRow>,
    /// Surfaces by `state<k>/<part>`, where `<part>` is `static`, a part's name or `whole`.
    pub mesh: BTreeMap<String, MeshRow>,
}

impl Evaluation {
    /// The evaluation of a run without a twin: every part is missing.
    pub(super) fn failed(run: &str, truth: &Truth, why: String) -> Self {
        let joints = truth.parts.iter().filter_map(|p| Some(JointRow::missing(&p.name, p.joint.as_ref()?)));
        Self {
            run: run.to_owned(),
            failed: Some(why),
            parts_true: truth.parts.len(),
            parts_found: 0,
            joints: joints.collect(),
            mesh: BTreeMap::new(),
        }
    }
}

/// One surface in one state; numbers not measured are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MeshRow {
    /// Chamfer distance as published, 1e-3 m^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cd: Option<f64>,
    /// The same between two samplings of the true surface, 1e-3 m^2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cd_floor: Option<f64>,
    /// Expected value of this floor, 1e-3 m^2: `0.0637 A` for 10,000 samples.
    pub cd_floor_expected: f64,
    /// Area of the true surface, square meters.
    pub area_m2: f64,
    /// Accuracy: mean distance from the found surface to the true one, millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy_mm: Option<f64>,
    /// Completeness: mean distance from the true points seen by some camera to the found surface,
    /// millimeters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seen_mm: Option<f64>,
}

/// Measures one run.
///
/// # Errors
/// If there are more than `MAX_PARTS` movable parts.
pub fn compare_run(
    name: &str,
    truth: &Truth,
    run: &RunFiles,
    options: &EvaluateOptions,
) -> Result<Evaluation, EvaluateError> {
    let wanted: Vec<(&TruePart, &TrueJoint)> =
        truth.parts.iter().filter_map(|p| Some((p, p.joint.as_ref()?))).collect();
    // The part of the root stands still and is matched with the static one.
    let movable = run.parts.len() - 1;
    let cost: Vec<Vec<f64>> = wanted.iter().map(|(part, joint)| matching_costs(part, joint, run)).collect();
    let count = wanted.len().max(movable);
    let pairs =
        cheapest_pairs(&cost, movable).ok_or(EvaluateError::TooManyParts { count, limit: MAX_PARTS })?;
    let found: BTreeMap<usize, usize> = pairs.into_iter().collect();
    let mut joints = Vec::with_capacity(wanted.len());
    for (i, (part, joint)) in wanted.iter().enumerate() {
        joints.push(match found.get(&i) {
            // Part 0 of a run holds its root; the movable ones count from 1.
            Some(&k) => JointRow::matched(&part.name, joint, run, k + 1, cost[i][k]),
            None => JointRow::missing(&part.name, joint),
        });
    }

    let mut surfaces: Vec<(String, Option<&TruePart>, Vec<usize>)> = Vec::new();
    for part in truth.parts.iter().filter(|p| p.joint.is_none()) {
        surfaces.push(("static".into(), Some(part), run.parts[0].clone()));
    }
    for (&i, &k) in &found {
        surfaces.push((wanted[i].0.name.clone(), Some(wanted[i].0), run.parts[k + 1].clone()));
    }
    // The whole surface is compared too: it does not depend on how parts were found and matched.
    surfaces.push(("whole".into(), None, run.parts.concat()));
    let mut mesh = BTreeMap::new();
    for state in [0, 1] {
        for (part_name, part, links) in &surfaces {
            let key = format!("state{state}/{part_name}");
            let row = mesh_row(&key, truth, *part, &run.surface(links, state), state, options);
            mesh.insert(key, row);
        }
    }
    // Links without a mesh are the intermediate links of screws, not parts.
    let parts_found =
        run.parts.iter().filter(|p| p.iter().any(|&l| !run.tree.links[l].visual.is_empty())).count();
    Ok(Evaluation {
        run: name.to_owned(),
        failed: None,
        parts_true: truth.parts.len(),
        parts_found,
        joints,
        mesh,
    })
}

/// Mean displacement of a true part under the motion of each found movable part, meters, over all states
/// present in both run and truth.
fn matching_costs(part: &TruePart, joint: &TrueJoint, run: &RunFiles) -> Vec<f64> {
    // Motions are compared by their effect on the true part, so badly found shapes do not matter.
    let points = &part.meshes[0].vertices;
    let mut costs = Vec::new();
    for found in 1..run.parts.len() {
        let motions = joint.motions().take(run.states.len() - 1).enumerate();
        let displacements: Vec<f64> = motions
            .map(|(k, m)| displacement_m(points, m, &run.motion(found, k + 1)).unwrap_or(f64::MAX))
            .collect();
        costs.push(displacements.iter().sum::<f64>() / displacements.len() as f64);
    }
    costs
}

fn mesh_row(
    key: &str,
    truth: &Truth,
    part: Option<&TruePart>,
    found: &TriangleMesh,
    state: usize,
    options: &EvaluateOptions,
) -> MeshRow {
    let true_mesh = part.map_or(&truth.whole[state], |p| &p.meshes[state]);
    let stage = format!("evaluate/{key}");
    // A random stream for each drawing: samples of one surface do not depend on those of another.
    let stream = |k: u64| stage_rng(options.seed, &stage, k);
    let count = options.samples;
    let samples = points_on_surface(found, count, &mut stream(0));
    let [first, second, third] = [1, 2, 3].map(|k| points_on_surface(true_mesh, count, &mut stream(k)));
    // As in the reference tool: first every fourth point, then those of the part.
    let seen = truth.seen[state].iter().step_by(SEEN_STRIDE);
    let seen = seen.filter(|p| part.is_none_or(|part| p.part == part.index));
    let seen: Vec<Point3<f64>> = seen.map(|p| p.point).collect();
    let area_m2 = true_mesh.area_m2();
    MeshRow {
        cd: chamfer_distance(&samples, &first),
        // The measured distance due to sampling alone (13.3).
        cd_floor: chamfer_distance(&second, &third),
        cd_floor_expected: FLOOR_PER_M2 * area_m2 * FLOOR_SAMPLES / options.samples as f64,
        area_m2,
        accuracy_mm: mean_distance_mm(&samples, true_mesh),
        seen_mm: mean_distance_mm(&seen, found),
    }
}
