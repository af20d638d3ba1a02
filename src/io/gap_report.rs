//! What the folder of a diagnosis says, as a message.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::ros2msg::gap::{GapFinding, GapParameter, GapReport};
use common::files;
use common::limits::REPORT;

/// Why the report of a diagnosis cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum GapReportError {
    /// The disk refuses.
    #[error("`{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is of another form.
    #[error("`{}`: {source}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        source: serde_json::Error,
    },
}

/// Reads `report.json` of a diagnosis' folder. Header, twin and summary are not in it and stay empty.
///
/// # Errors
/// [`GapReportError`].
pub fn read_gap_report(folder: &Path) -> Result<GapReport, GapReportError> {
    let path = folder.join("report.json");
    let text = files::read_text(&path, REPORT)
        .map_err(|source| GapReportError::Read { path: path.clone(), source })?;
    let file: File = serde_json::from_str(&text).map_err(|source| GapReportError::Form { path, source })?;
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
