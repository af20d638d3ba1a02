//! Findings and gaps as written to `report.json` and read from it. `null` stands for a number not finite or
//! unknown.

use serde::{Deserialize, Serialize};

/// The parts read from a `report.json`, of this version or an earlier one. Other keys are ignored.
#[derive(Debug, Deserialize)]
pub struct ReadDiagnosis {
    /// The verdict over all joints.
    pub verdict: String,
    /// Named effects.
    #[serde(default)]
    pub findings: Vec<FindingJson>,
    /// Gap before and after the update.
    #[serde(default)]
    pub gap: GapJson,
}

/// An effect of a joint.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct FindingJson {
    /// Joint.
    pub joint: String,
    /// Effect.
    pub effect: String,
    /// Its parameters.
    pub parameters: Vec<ParameterJson>,
    /// Its weight among its rivals.
    pub weight: Option<f64>,
    #[serde(skip_deserializing)]
    pub(super) alternatives: Vec<AlternativeJson>,
}

#[derive(Debug, Serialize)]
pub(super) struct AlternativeJson {
    pub effect: String,
    pub weight: f64,
    pub experiment: String,
}

/// A parameter of an effect.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ParameterJson {
    /// Name.
    pub name: String,
    /// Value.
    pub value: Option<f64>,
    /// Unit.
    pub unit: String,
    /// Lower and upper bound.
    pub interval: [Option<f64>; 2],
    /// Why the runs leave it open: `at_bound` or `wide`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open: Option<String>,
}

/// Root mean square residuals of the held-out runs, rad or m.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct GapJson {
    /// With the twin.
    pub before: Option<f64>,
    /// With the findings.
    pub after: Option<f64>,
    /// Expected from the noise of the readings alone.
    pub noise_floor: Option<f64>,
    /// `rad` or `m`.
    pub unit: Option<String>,
    #[serde(skip_deserializing)]
    pub(super) runs: Vec<RunJson>,
}

#[derive(Debug, Serialize)]
pub(super) struct RunJson {
    pub run: String,
    pub joint: String,
    pub unit: String,
    pub before: f64,
    pub after: f64,
    pub full_length_before: Option<f64>,
    pub full_length_after: Option<f64>,
}
