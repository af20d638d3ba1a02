//! The report of a diagnosis: JSON with fixed keys, and a short text.

use serde::Serialize;

use crate::{
    judge::{
        doubt::Doubt,
        doubt_json::DoubtJson,
        finding::{Finding, ParameterEstimate},
        format_model::FormatModel,
        law::Law,
        proof::{Gap, RunSeries, left_of},
        report_json::{AlternativeJson, FindingJson, GapJson, ParameterJson, RunJson},
        verdict::{Diagnosis, Verdict},
    },
    model::effect::{Coverage, Dimension},
    record::off_axis::{Across, OffAxis},
};

/// A joint's diagnosis with its proof.
#[derive(Debug)]
pub struct JointReport {
    /// Name of the joint.
    pub joint: String,
    /// Whether the joint is revolute.
    pub turns: bool,
    /// Diagnosis.
    pub diagnosis: Diagnosis,
    /// Gap before and after on the held-out runs; `None` without any.
    pub gap: Option<Gap>,
    /// Residuals of the held-out runs, with the nearest effects if none is named; for plots.
    pub series: Vec<RunSeries>,
    /// The findings as laws of effort over a variable; for plots.
    pub laws: Vec<Law>,
    /// Positions of all runs; for plots.
    pub tracks: Vec<Track>,
    /// Range of the fitted motion.
    pub coverage: Coverage,
    /// The joint in the file of each format, if effects were named.
    pub in_format: Vec<FormatModel>,
    /// Windows of the held-out runs with the updated twin's start states.
    pub replay: Vec<ReplayWindow>,
    /// Gap on the held-out runs with the nearest effects, if none is named.
    pub nearest: Option<Gap>,
    /// Off-axis evidence from measured poses of the part, if there are any.
    pub off_axis: Option<OffAxis>,
    /// Why there is no diagnosis: twin and recording seem to use different conventions.
    pub doubt: Option<Doubt>,
    /// Whether the motion was imposed, so that it explains the efforts: gaps are then of efforts, N m or N.
    pub is_imposed: bool,
}

/// Measured positions of a run, or of part of one.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Run.
    pub run: String,
    /// Whether the run is used for the proof only.
    pub is_held_out: bool,
    /// Seconds.
    pub time_s: Vec<f64>,
    /// Position, rad or m.
    pub position: Vec<f64>,
}

/// A window of a held-out run. Simulated from this state with the recorded efforts, the updated twin has the
/// residual `after`.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct ReplayWindow {
    /// Joint.
    pub joint: String,
    /// Run.
    pub run: String,
    /// Time of the first sample, seconds from the start of the recording.
    pub start_s: f64,
    /// Number of samples.
    pub samples: usize,
    /// Recorded position at the start, as the updated twin's sensor sees it, rad or m.
    pub position: f64,
    /// Velocity, rad/s or m/s.
    pub velocity: f64,
    /// Position of the sensor within its play, -1 to 1.
    pub play: f64,
}

/// What happens to an effect in a format.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct ExportNote {
    /// `urdf`, `mjcf`, `sdf` or `usd`.
    pub format: String,
    /// File in the output folder.
    pub file: String,
    /// Joint.
    pub joint: String,
    /// Effect.
    pub effect: String,
    /// What became of it.
    pub status: ExportStatus,
    /// The effects replacing it, or the effect itself with other parameters.
    pub by: Vec<Held>,
    /// Root mean square residual of the held-out runs with the joint's effects in the file, rad or m.
    pub rmse: Option<f64>,
    /// The same for the twin.
    pub before: Option<f64>,
}

/// What became of an effect in a file; a text in JSON.
#[derive(Clone, Debug, PartialEq)]
pub enum ExportStatus {
    /// `native`, `approximated`, `fitted again`, `replaced`, `left out`, `kept` (the twin's values), or `not
    /// expressible`.
    InFile(&'static str),
    /// There is no file, or the file leaves the joint as it was; with the reason.
    NotWritten(String),
}

impl std::fmt::Display for ExportStatus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::InFile(fate) => f.write_str(fate),
            Self::NotWritten(why) => write!(f, "not written: {why}"),
        }
    }
}

impl Serialize for ExportStatus {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// An effect as written in a file.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct Held {
    /// Effect.
    pub effect: String,
    /// Its parameters.
    pub parameters: Vec<HeldParameter>,
}

/// A parameter as written in a file.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct HeldParameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// Content of `report.json`.
#[derive(Debug, Serialize)]
pub struct Report {
    verdict: String,
    findings: Vec<FindingJson>,
    /// Further effects in the files, improving unseen runs although they may be absent.
    unsure: Vec<FindingJson>,
    /// Under the verdict `unknown`: the nearest effects, explaining too little to be findings.
    nearest: Vec<NearestJson>,
    r#where: Vec<WhereJson>,
    gap: GapJson,
    /// Gap left beside named effects, beyond noise.
    remainder: Vec<RemainderJson>,
    /// Off-axis evidence from measured poses of the parts.
    off_axis: Vec<OffAxisJson>,
    /// Fitted parameters of servos, and of efforts in an unknown unit.
    actuators: Vec<ActuatorJson>,
    /// Joints whose motion was imposed: their gaps are of efforts, given the motion.
    imposed: Vec<String>,
    /// Joints without a diagnosis: twin and recording seem to use different conventions.
    doubts: Vec<DoubtJson>,
    exports: Vec<ExportNote>,
}

#[derive(Debug, Serialize)]
struct RemainderJson {
    joint: String,
    share_of_gap: f64,
    times_noise: f64,
}

#[derive(Debug, Serialize)]
struct OffAxisJson {
    joint: String,
    suspect: String,
    text: String,
    measured: AcrossJson,
    noise: AcrossJson,
    left: AcrossJson,
    axis: AcrossJson,
}

#[derive(Debug, Serialize)]
struct AcrossJson {
    mm: f64,
    deg: f64,
}

#[derive(Debug, Serialize)]
struct ActuatorJson {
    joint: String,
    /// `servo` or `effort`.
    kind: String,
    parameters: Vec<ParameterJson>,
}

#[derive(Debug, Serialize)]
struct NearestJson {
    joint: String,
    effects: Vec<FindingJson>,
    before: f64,
    after: f64,
    runs: Vec<RunJson>,
}

#[derive(Debug, Serialize)]
struct WhereJson {
    joint: String,
    variable: String,
    region: [f64; 2],
    p: f64,
}

/// The verdict over all joints: findings at any joint count before their absence.
#[must_use]
pub fn overall_verdict(joints: &[JointReport]) -> Verdict {
    let order = [Verdict::Unknown, Verdict::Ambiguous, Verdict::Named, Verdict::Insufficient];
    order.into_iter().find(|v| joints.iter().any(|j| j.diagnosis.verdict == *v)).unwrap_or(Verdict::None)
}

/// The joint shown in the headline: the one with the largest gap relative to its noise, findings first.
#[must_use]
pub fn main_joint(joints: &[JointReport]) -> Option<&JointReport> {
    let size = |j: &JointReport| j.gap.as_ref().map_or(-1.0, |g| headline_size(j, g));
    joints.iter().filter(|j| j.gap.is_some()).max_by(|a, b| size(a).total_cmp(&size(b)))
}

/// The gap relative to its noise, plus a large number if effects were found.
fn headline_size(joint: &JointReport, gap: &Gap) -> f64 {
    let found = f64::from(u8::from(!joint.diagnosis.findings.is_empty()));
    found * 1e12 + gap.before / gap.noise_floor.max(1e-12)
}

/// The content of `report.json` for all joints.
#[must_use]
pub fn report(joints: &[JointReport], exports: Vec<ExportNote>) -> Report {
    let main = main_joint(joints);
    let gap = main.and_then(|j| j.gap.as_ref());
    let runs = joints.iter().flat_map(|j| j.gap.iter().flat_map(|g| runs_of(j, g)).collect::<Vec<_>>());
    Report {
        verdict: overall_verdict(joints).name().to_owned(),
        findings: joints.iter().flat_map(|j| findings_json(j, j.diagnosis.sure_findings())).collect(),
        unsure: joints.iter().flat_map(|j| findings_json(j, j.diagnosis.unsure_findings())).collect(),
        nearest: joints.iter().filter_map(nearest_json).collect(),
        r#where: joints.iter().flat_map(places_json).collect(),
        gap: GapJson {
            before: gap.map(|g| g.before),
            after: gap.map(|g| g.after),
            noise_floor: gap.map(|g| g.noise_floor),
            unit: main.map(|j| j.gap_unit().to_owned()),
            runs: runs.collect(),
        },
        remainder: joints.iter().filter_map(remainder_json).collect(),
        off_axis: joints.iter().filter_map(off_axis).collect(),
        actuators: joints.iter().filter_map(actuator_json).collect(),
        imposed: joints.iter().filter(|j| j.is_imposed).map(|j| j.joint.clone()).collect(),
        doubts: joints.iter().filter_map(|j| j.doubt.as_ref().map(DoubtJson::of_doubt)).collect(),
        exports,
    }
}

fn parameter_json(p: &ParameterEstimate) -> ParameterJson {
    let interval = [Some(p.interval.0), Some(p.interval.1)];
    ParameterJson {
        name: p.name.clone(),
        value: Some(p.value),
        unit: p.unit.clone(),
        interval,
        open: p.open.map(|why| why.name().to_owned()),
    }
}

fn actuator_json(joint: &JointReport) -> Option<ActuatorJson> {
    let found = &joint.diagnosis.actuator;
    (!found.is_empty()).then(|| ActuatorJson {
        joint: joint.joint.clone(),
        kind: joint.diagnosis.model.plant.actuator.kind().to_owned(),
        parameters: found.iter().map(parameter_json).collect(),
    })
}

fn runs_of(joint: &JointReport, gap: &Gap) -> Vec<RunJson> {
    // Over a whole run an unstable twin may diverge, and JSON has no infinity.
    let finite = |x: f64| x.is_finite().then_some(x);
    let mut runs = Vec::with_capacity(gap.runs.len());
    for r in &gap.runs {
        runs.push(RunJson {
            run: r.run.clone(),
            joint: joint.joint.clone(),
            unit: joint.gap_unit().to_owned(),
            before: r.before,
            after: r.after,
            full_length_before: finite(r.full_before),
            full_length_after: finite(r.full_after),
        });
    }
    runs
}

/// A remainder beside named effects is reported from this share of the gap.
/// chosen: the level of the intervals.
const REPORTED_SHARE: f64 = 0.05;
/// A remainder is reported from this multiple of the noise.
/// chosen: three standard deviations.
pub const REPORTED_NOISES: f64 = 3.0;

impl JointReport {
    /// Unit of the gap: of positions, or of efforts where the motion was imposed.
    #[must_use]
    pub fn gap_unit(&self) -> &'static str {
        let dimension = if self.is_imposed { Dimension::Effort } else { Dimension::Position };
        dimension.unit_name(self.turns)
    }

    /// Remainder beside named effects, beyond noise: its share of the gap, and its multiple of the noise.
    #[must_use]
    pub fn remainder_of_gap(&self) -> Option<(f64, f64)> {
        let gap = self.gap.as_ref().filter(|_| !self.diagnosis.findings.is_empty())?;
        let share = left_of(gap.before, gap.after, gap.noise_floor);
        let noises = gap.after / gap.noise_floor.max(1e-300);
        (share > REPORTED_SHARE && noises > REPORTED_NOISES).then_some((share, noises))
    }
}

fn remainder_json(joint: &JointReport) -> Option<RemainderJson> {
    let (share_of_gap, times_noise) = joint.remainder_of_gap()?;
    Some(RemainderJson { joint: joint.joint.clone(), share_of_gap, times_noise })
}

fn off_axis(joint: &JointReport) -> Option<OffAxisJson> {
    let e = joint.off_axis?;
    let [measured, noise, left, axis] = [&e.measured, &e.noise, &e.left, &e.axis]
        .map(|a: &Across| AcrossJson { mm: 1e3 * a.shift_m, deg: a.turn_rad.to_degrees() });
    Some(OffAxisJson {
        joint: joint.joint.clone(),
        suspect: e.suspect.name().to_owned(),
        text: e.in_words(),
        measured,
        noise,
        left,
        axis,
    })
}

fn nearest_json(joint: &JointReport) -> Option<NearestJson> {
    let near = joint.diagnosis.nearest.as_ref()?;
    let gap = joint.nearest.as_ref()?;
    let effects = findings_json(joint, near.findings.iter());
    Some(NearestJson {
        joint: joint.joint.clone(),
        effects,
        before: gap.before,
        after: gap.after,
        runs: runs_of(joint, gap),
    })
}

fn findings_json<'f>(joint: &JointReport, found: impl Iterator<Item = &'f Finding>) -> Vec<FindingJson> {
    found.map(|f| finding_json_of(joint, f)).collect()
}

fn finding_json_of(joint: &JointReport, f: &Finding) -> FindingJson {
    let experiment = &f.experiment;
    let alternatives = f.alternatives.iter().map(|(effect, weight)| AlternativeJson {
        effect: effect.clone(),
        weight: *weight,
        experiment: experiment.clone(),
    });
    FindingJson {
        joint: joint.joint.clone(),
        effect: f.effect.clone(),
        parameters: f.parameters.iter().map(parameter_json).collect(),
        weight: Some(f.weight),
        alternatives: alternatives.collect(),
    }
}

/// Level below which a dependence is reported.
/// chosen: the accepted share of false alarms.
const LEVEL: f64 = 0.05;

fn places_json(joint: &JointReport) -> Vec<WhereJson> {
    let d = &joint.diagnosis;
    // Without findings this is where the updated model fails; with findings, where the twin did.
    d.before
        .iter()
        .filter(|w| w.q <= LEVEL && w.gain > 2.0 * w.bins.len() as f64 + 10.0)
        .map(|w| WhereJson {
            joint: joint.joint.clone(),
            variable: w.variable.name().to_owned(),
            region: [w.region.0, w.region.1],
            p: w.p,
        })
        .collect()
}

/// The report in at most 15 lines.
#[must_use]
pub fn summary_of_joints(joints: &[JointReport]) -> String {
    let mut lines = vec![format!("verdict: {}", overall_verdict(joints).name())];
    for j in joints {
        let unit = j.gap_unit();
        let d = &j.diagnosis;
        if d.findings.is_empty() {
            let reason = d.lacks.first().map_or(String::new(), |l| format!(": {l}"));
            lines.push(format!("{}: {}{reason}", j.joint, d.verdict.name()));
        }
        if d.verdict == Verdict::Unknown
            && let Some(w) = d.before.first()
        {
            lines.push(format!(
                "  residual depends on {}, {:.3} to {:.3} {}",
                w.variable.name(),
                w.region.0,
                w.region.1,
                w.variable.unit(j.turns)
            ));
        }
        if let (Some(near), Some(gap)) = (&d.nearest, &j.nearest) {
            let names: Vec<&str> = near.findings.iter().map(|f| f.effect.as_str()).collect();
            lines.push(format!(
                "  nearest, not enough: {}; held out {:.3e} -> {:.3e} {unit}",
                names.join(" + "),
                gap.before,
                gap.after
            ));
        }
        for f in d.sure_findings() {
            let parameters: Vec<String> = f.parameters.iter().map(ParameterEstimate::in_words).collect();
            lines.push(format!(
                "{}: {} (weight {:.2}): {}",
                j.joint,
                f.effect,
                f.weight,
                parameters.join(", ")
            ));
            if !f.alternatives.is_empty() {
                let names: Vec<String> = f.alternatives.iter().map(|(n, w)| format!("{n} {w:.2}")).collect();
                lines.push(format!("  or {}; to decide: {}", names.join(", "), f.experiment));
            }
        }
        for f in d.unsure_findings() {
            let parameters: Vec<String> = f.parameters.iter().map(ParameterEstimate::in_words).collect();
            lines.push(format!("  perhaps {}: {}", f.effect, parameters.join(", ")));
        }
        if !d.actuator.is_empty() {
            let found: Vec<String> = d.actuator.iter().map(ParameterEstimate::in_words).collect();
            lines.push(format!("  {}: {}", d.model.plant.actuator.kind(), found.join(", ")));
        }
        if let Some(e) = &j.off_axis {
            lines.push(format!("  {}", e.in_words()));
        }
        if j.is_imposed {
            lines
                .push("  the motion was imposed: what is explained are efforts, given the motion".to_owned());
        }
        if let Some(g) = &j.gap {
            lines.push(format!(
                "  held out: {:.3e} -> {:.3e} {unit}, noise {:.3e}  {}",
                g.before,
                g.after,
                g.noise_floor,
                bar(g)
            ));
            if let Some(r) = remainder_json(j) {
                let share = 100.0 * r.share_of_gap;
                let noises = r.times_noise;
                lines.push(format!(
                    "  beside it something unknown is left: {share:.0} % of the gap, \
                 {noises:.0} times the noise"
                ));
            }
        }
    }
    lines.truncate(15);
    lines.join("\n") + "\n"
}

/// The gap as a bar of 30 characters on a logarithmic scale: noise, remainder, closed part.
fn bar(gap: &Gap) -> String {
    let top = (gap.before / gap.noise_floor.max(1e-12)).max(1.0).ln().max(1e-9);
    // derived: 30 characters.
    let left = ((gap.after / gap.noise_floor.max(1e-12)).max(1.0).ln() / top * 30.0).round().clamp(0.0, 30.0)
        as usize;
    format!("|{}{}|", "#".repeat(left), ".".repeat(30 - left))
}
