//! The report of a diagnosis from frames, in the layout of a diagnosis from motion.

use serde_json::{Value, json};

use crate::{
    camera::{
        judge::{
            diagnosis::{FrameDiagnosis, OutstandingPart},
            finding::{CAMERA, CameraFinding},
        },
        model::twin::SeenTwin,
    },
    judge::report::ExportNote,
};

/// Content of `report.json`.
pub fn report(twin: &SeenTwin, d: &FrameDiagnosis, exports: &[ExportNote]) -> Value {
    let runs = d.gap.runs.iter().map(|(run, before, after)| {
        json!({"run": run, "joint": CAMERA, "unit": "m", "before": before, "after": after})
    });
    json!({
        "verdict": d.verdict.name(),
        "findings": d.findings.iter().map(|f| finding_json(twin, f)).collect::<Vec<_>>(),
        "nearest": [],
        "where": d.places.iter().map(part_json).collect::<Vec<_>>(),
        "gap": {
            "before": d.gap.before,
            "after": d.gap.after,
            "noise_floor": d.gap.noise_floor,
            "unit": "m",
            "runs": runs.collect::<Vec<_>>(),
            "conflict_share_before": d.gap.conflict_before,
            "conflict_share_after": d.gap.conflict_after,
        },
        "positions": (0..d.after.positions.len()).map(|r| positions_json(twin, d, r)).collect::<Vec<_>>(),
        "notes": d.notes,
        "exports": exports,
    })
}

fn finding_json(twin: &SeenTwin, f: &CameraFinding) -> Value {
    let parameters = f.finding.parameters.iter().map(|p| {
        let interval = [p.interval.0, p.interval.1];
        json!({"name": p.name, "value": p.value, "unit": p.unit, "interval": interval})
    });
    let alternatives = f.finding.alternatives.iter().map(
        |(effect, weight)| json!({"effect": effect, "weight": weight, "experiment": f.finding.experiment}),
    );
    let mut value = json!({
        "joint": f.subject.name(twin),
        "effect": f.finding.effect,
        "parameters": parameters.collect::<Vec<_>>(),
        "weight": f.finding.weight,
        "alternatives": alternatives.collect::<Vec<_>>(),
    });
    if let Some([from, to]) = f.types {
        value["type"] = json!({"from": from, "to": to});
    }
    value
}

fn part_json(p: &OutstandingPart) -> Value {
    json!({
        "joint": p.part,
        "variable": "surface",
        "residual_before_m": p.before_m,
        "residual_after_m": p.after_m,
        "conflict_share": p.conflict,
        "region": p.bounds,
    })
}

/// Positions of all joints in a run.
fn positions_json(twin: &SeenTwin, d: &FrameDiagnosis, run: usize) -> Value {
    let mut positions = serde_json::Map::new();
    for (j, joint) in twin.joints.iter().enumerate() {
        positions.insert(joint.name.clone(), json!(d.after.joint_position(&d.twin, run, j)));
    }
    Value::Object(positions)
}

/// Merges a report from motion and one from frames: findings, places and exports of both; the frames' gap is
/// under `frames_gap`.
pub fn merged_reports(mut motion: Value, frames: &Value) -> Value {
    // In order of weight: findings first, agreement last, as among joints.
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
pub fn summary_of_frames(twin: &SeenTwin, d: &FrameDiagnosis) -> String {
    let mut lines = vec![format!("verdict: {}", d.verdict.name())];
    for f in &d.findings {
        let parameters: Vec<String> = f
            .finding
            .parameters
            .iter()
            .map(|p| {
                format!("{} {:.4} [{:.4}, {:.4}] {}", p.name, p.value, p.interval.0, p.interval.1, p.unit)
            })
            .collect();
        let types =
            f.types.map_or(String::new(), |[from, to]| format!(", {from} in the twin, {to} in the frames"));
        let who = f.subject.name(twin);
        lines.push(format!(
            "{who}: {}{types} (weight {:.2}): {}",
            f.finding.effect,
            f.finding.weight,
            parameters.join(", ")
        ));
        if !f.finding.alternatives.is_empty() {
            let names: Vec<String> =
                f.finding.alternatives.iter().map(|(n, w)| format!("{n} {w:.2}")).collect();
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
