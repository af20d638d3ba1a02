//! What the folder of a diagnosis tells, as a message.

use std::path::Path;

use serde::Deserialize;

use super::ros2msg::gap::{GapFinding, GapParameter, GapReport};

/// Reads `report.json` of a diagnosis' folder. Header, twin and summary are not in it and stay empty.
///
/// # Errors
/// A sentence: the file cannot be read or is of another form.
pub fn read_gap_report(folder: &Path) -> Result<GapReport, String> {
    let path = folder.join("report.json");
    let told = |why: String| format!("`{}`: {why}", path.display());
    let text = crate::files::read_text(&path, crate::limits::REPORT).map_err(|e| told(e.to_string()))?;
    let file: File = serde_json::from_str(&text).map_err(|e| told(e.to_string()))?;
    Ok(GapReport {
        folder: folder.display().to_string(),
        verdict: file.verdict,
        findings: file.findings.into_iter().map(Finding::message).collect(),
        gap_before: file.gap.before.unwrap_or(f64::NAN),
        gap_after: file.gap.after.unwrap_or(f64::NAN),
        noise_floor: file.gap.noise_floor.unwrap_or(f64::NAN),
        unit: file.gap.unit.unwrap_or_default(),
        report: text,
        ..GapReport::default()
    })
}

#[derive(Deserialize)]
struct File {
    verdict: String,
    findings: Vec<Finding>,
    gap: Gap,
}

#[derive(Deserialize)]
struct Gap {
    before: Option<f64>,
    after: Option<f64>,
    noise_floor: Option<f64>,
    unit: Option<String>,
}

#[derive(Deserialize)]
struct Finding {
    joint: String,
    effect: String,
    weight: Option<f64>,
    parameters: Vec<Parameter>,
}

#[derive(Deserialize)]
struct Parameter {
    name: String,
    value: Option<f64>,
    unit: String,
    interval: [Option<f64>; 2],
}

impl Finding {
    fn message(self) -> GapFinding {
        // JSON has no number for what is not finite.
        let number = |x: Option<f64>| x.unwrap_or(f64::NAN);
        let parameter = |Parameter { name, value, unit, interval: [lower, upper] }: Parameter| GapParameter {
            name,
            value: number(value),
            lower: number(lower),
            upper: number(upper),
            unit,
        };
        GapFinding {
            joint: self.joint,
            effect: self.effect,
            weight: number(self.weight),
            parameters: self.parameters.into_iter().map(parameter).collect(),
        }
    }
}
