//! The report in the folder of a diagnosis, as a message.

use std::path::{Path, PathBuf};

use super::ros2msg::gap::{GapFinding, GapParameter, GapReport};
use common::files;
use common::limits::REPORT;
use gap::judge::report_json::{FindingJson, ParameterJson, ReadDiagnosis};

/// Why the report of a diagnosis cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum GapReportError {
    /// The disk refuses.
    #[error("`{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// It is of another form.
    #[error("`{}`: {source}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// Error of the parser.
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
    let read: ReadDiagnosis =
        serde_json::from_str(&text).map_err(|source| GapReportError::Form { path, source })?;
    Ok(GapReport {
        folder: folder.display().to_string(),
        verdict: read.verdict,
        findings: read.findings.into_iter().map(finding).collect(),
        gap_before: number(read.gap.before),
        gap_after: number(read.gap.after),
        noise_floor: number(read.gap.noise_floor),
        unit: read.gap.unit.unwrap_or_default(),
        report: text,
        ..GapReport::default()
    })
}

/// JSON has no number for a value beyond the finite ones.
fn number(x: Option<f64>) -> f64 {
    x.unwrap_or(f64::NAN)
}

fn gap_parameter(read: ParameterJson) -> GapParameter {
    let [lower, upper] = read.interval.map(number);
    GapParameter { name: read.name, value: number(read.value), lower, upper, unit: read.unit }
}

fn finding(found: FindingJson) -> GapFinding {
    GapFinding {
        parameters: found.parameters.into_iter().map(gap_parameter).collect(),
        joint: found.joint,
        effect: found.effect,
        weight: number(found.weight),
    }
}
