//! The report of a diagnosis by frames, in the layout of that by motion.

use serde_json::{Value, json};

use super::{assess::FrameDiagnosis, twin::SeenTwin};
use crate::gap::report::ExportNote;

/// Name of the camera where a report names a joint.
pub const CAMERA: &str = "camera";

/// What a finding is about: a joint, a part without one, or the camera.
fn subject(twin: &SeenTwin, joint: Option<usize>, effect: &str) -> String {
    match joint {
        Some(j) => twin.joints[j].name.clone(),
        None if effect == "missing_geometry" => twin.parts[0].name.clone(),
        None => CAMERA.to_owned(),
    }
}

/// `report.json`.
#[must_use]
pub fn report(twin: &SeenTwin, d: &FrameDiagnosis, exports: &[ExportNote]) -> Value {
    let finding = |f: &super::assess::CameraFinding| {
        let parameters: Vec<Value> = f
            .finding
            .parameters
            .iter()
            .map(|p| json!({"name": p.name, "value": p.value, "unit": p.unit, "interval": [p.interval.0, p.interval.1]}))
            .collect();
        let alternatives: Vec<Value> = f
            .finding
            .alternatives
            .iter()
            .map(|(effect, weight)| json!({"effect": effect, "weight": weight, "experiment": f.finding.experiment}))
            .collect();
        let mut value = json!({
            "joint": subject(twin, f.joint, &f.finding.effect),
            "effect": f.finding.effect,
            "parameters": parameters,
            "weight": f.finding.weight,
            "alternatives": alternatives,
        });
        if let Some(change) = d.kind.as_ref().filter(|_| f.finding.effect == "wrong_joint_type") {
            value["type"] = json!({"from": change.from.name(), "to": change.to.name()});
        } else if f.finding.effect == "wrong_joint_type" {
            value["type"] = json!({"from": "revolute", "to": "screw"});
        }
        value
    };
    let places: Vec<Value> = d
        .places
        .iter()
        .map(|p| {
            json!({"joint": p.part, "variable": "surface", "residual_before_m": p.before_m, "residual_after_m": p.after_m,
                   "conflict_share": p.conflict, "region": p.bounds})
        })
        .collect();
    let runs: Vec<Value> = d
        .gap
        .runs
        .iter()
        .map(|(run, before, after)| json!({"run": run, "joint": CAMERA, "unit": "m", "before": before, "after": after}))
        .collect();
    let positions: Vec<Value> = d
        .after
        .positions
        .iter()
        .enumerate()
        .map(|(r, _)| {
            let of = |j: usize| (twin.joints[j].name.clone(), json!(d.after.position(&d.twin, r, j)));
            Value::Object((0..twin.joints.len()).map(of).collect())
        })
        .collect();
    json!({
        "verdict": d.verdict.name(),
        "findings": d.findings.iter().map(finding).collect::<Vec<_>>(),
        "nearest": [],
        "where": places,
        "gap": {
            "before": d.gap.before, "after": d.gap.after, "noise_floor": d.gap.noise_floor, "unit": "m", "runs": runs,
            "conflict_share_before": d.gap.conflict_before, "conflict_share_after": d.gap.conflict_after,
        },
        "positions": positions,
        "notes": d.notes,
        "exports": exports,
    })
}

/// A report by motion and one by frames in one: findings, places and exports of both; the gap of the frames stands under
/// `frames_gap`.
#[must_use]
pub fn merged(mut motion: Value, frames: &Value) -> Value {
    const ORDER: [&str; 5] = ["unknown", "ambiguous", "named", "insufficient", "none"];
    let verdicts = [&motion["verdict"], &frames["verdict"]].map(|v| v.as_str().unwrap_or("none").to_owned());
    let verdict = ORDER.into_iter().find(|v| verdicts.iter().any(|w| w == v)).unwrap_or("none");
    for key in ["findings", "where", "exports"] {
        if let (Some(all), Some(more)) = (motion[key].as_array_mut(), frames[key].as_array()) {
            all.extend(more.iter().cloned());
        }
    }
    motion["verdict"] = json!(verdict);
    motion["frames_gap"] = frames["gap"].clone();
    motion["positions"] = frames["positions"].clone();
    motion
}

/// The diagnosis in at most 15 lines.
#[must_use]
pub fn summary(twin: &SeenTwin, d: &FrameDiagnosis) -> String {
    let mut lines = vec![format!("verdict: {}", d.verdict.name())];
    for f in &d.findings {
        let parameters: Vec<String> = f
            .finding
            .parameters
            .iter()
            .map(|p| format!("{} {:.4} [{:.4}, {:.4}] {}", p.name, p.value, p.interval.0, p.interval.1, p.unit))
            .collect();
        let kind = d.kind.as_ref().filter(|_| f.finding.effect == "wrong_joint_type");
        let kind = kind.map_or(String::new(), |k| format!(", {} in the twin, {} in the frames", k.from.name(), k.to.name()));
        let who = subject(twin, f.joint, &f.finding.effect);
        lines.push(format!("{who}: {}{kind} (weight {:.2}): {}", f.finding.effect, f.finding.weight, parameters.join(", ")));
        if !f.finding.alternatives.is_empty() {
            let names: Vec<String> = f.finding.alternatives.iter().map(|(n, w)| format!("{n} {w:.2}")).collect();
            lines.push(format!("  or {}; to decide: {}", names.join(", "), f.finding.experiment));
        }
    }
    for p in d.places.iter().take(2) {
        lines.push(format!(
            "  {}: residual {:.1} -> {:.1} mm, {:.0} % of its pixels conflicted",
            p.part,
            1e3 * p.before_m,
            1e3 * p.after_m,
            100.0 * p.conflict
        ));
    }
    lines.extend(d.notes.iter().take(2).map(|n| format!("  {n}")));
    lines.push(format!(
        "  held-out frames: {:.2} -> {:.2} mm, noise {:.2} mm; in conflict {:.1} -> {:.1} %",
        1e3 * d.gap.before,
        1e3 * d.gap.after,
        1e3 * d.gap.noise_floor,
        100.0 * d.gap.conflict_before,
        100.0 * d.gap.conflict_after
    ));
    lines.truncate(15);
    lines.join("\n") + "\n"
}
