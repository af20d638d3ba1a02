//! The diagnosis: takes a twin and runs, and gives a verdict, an updated twin and a report.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{
    Monitor, RunError,
    assessed::{Assessed, EffortHold, assessed},
    joint_runs::{MOST_DIVIDED, moving_joints},
    least_bytes::least_diagnosis,
    outcome::OUTPUT_STAGE,
};
use common::files;
use common::limits::{SDF, USD};
use common::note::{Note, NoteCode};
use export::{
    DiagnosisFacts,
    diagnosed::{
        effects::{LawNames, effects_file},
        mjcf,
        numbers::{exported_file, missing},
        tilt::placed_text,
        urdf,
    },
    diagnosis_page,
};
use gap::{
    judge::{
        format_note::format_note,
        report::{self, ExportNote, JointReport, Report},
        verdict::Verdict,
    },
    model::{effects::catalogue, format::Format, joint_model::Catalogue},
    record::{
        command::Told,
        drive::Hold,
        inputs::complete_run,
        off_axis::OffAxis,
        recording::Recording,
        tracks::{Streams, moved_link},
    },
    twin_tree::TwinTree,
};
use io::{Place, ResultKind, RunDir};

/// Request for a diagnosis.
#[derive(Clone, Debug)]
pub struct DiagnoseRequest {
    /// URDF of the twin, or a folder with one.
    pub twin: PathBuf,
    /// Bags of the runs.
    pub runs: Vec<PathBuf>,
    /// Bags used only for the proof, among the runs or beside them.
    pub held_out: Vec<PathBuf>,
    /// Parent of the result's folder.
    pub out: PathBuf,
    /// Name of the result's folder; without it the result is in `out` itself.
    pub name: Option<String>,
    /// Whether a folder that may not be replaced is moved to `NAME.bak`.
    pub force: bool,
    /// Gravity in the root's frame, m/s^2.
    pub gravity: [f64; 3],
    /// How the effort is interpolated between samples; `None`: as the runs show it.
    pub hold: Option<Hold>,
    /// Seed of the permutation tests.
    pub seed: u64,
    /// Effects to fit at every joint instead of searching for them, by name.
    pub effects: Vec<String>,
    /// Wrenches, poses and commands to read beside the joint states.
    pub streams: Streams,
    /// What the user says about the actuators.
    pub told: Told,
}

/// The result of a diagnosis.
#[derive(Clone, Debug)]
pub struct DiagnoseOutcome {
    /// Folder of the result.
    pub folder: PathBuf,
    /// Verdict over all joints.
    pub verdict: Verdict,
    /// Summary for the terminal.
    pub summary: String,
    /// Warnings.
    pub warnings: Vec<Note>,
}

impl DiagnoseRequest {
    /// A request for a twin in a world with z up, with a search for effects, to the folder `out`; no runs
    /// yet.
    pub fn new(twin: impl Into<PathBuf>, out: impl Into<PathBuf>) -> Self {
        Self {
            twin: twin.into(),
            runs: Vec::new(),
            held_out: Vec::new(),
            out: out.into(),
            name: None,
            force: false,
            gravity: [0.0, 0.0, -9.81],
            hold: None,
            seed: 0,
            effects: Vec::new(),
            streams: Streams::default(),
            told: Told::default(),
        }
    }

    /// The request with the path of its twin's URDF.
    pub(super) fn with_urdf(&self) -> Result<Self, RunError> {
        let twin = io::twin_path(&self.twin).map_err(|e| RunError::stage("twin", e))?;
        Ok(Self { twin, ..self.clone() })
    }

    /// Where the result goes. `text` is that of the twin; files in `more` are read as well as the request's.
    pub(super) fn place(&self, text: &str, more: &[PathBuf]) -> Place {
        // All inputs are listed, so the result cannot take their place.
        let named = [&self.runs[..], &self.held_out, more].concat();
        let inputs = named.into_iter().chain(io::twin_files(&self.twin, text)).collect();
        Place { out: self.out.clone(), name: self.name.clone(), force: self.force, inputs }
    }
}

/// Puts the files of a diagnosis in their place; adds a warning if a folder was moved away for them.
pub(super) fn put_files(
    place: &Place,
    files: &[(String, String)],
    warnings: &mut Vec<Note>,
) -> Result<PathBuf, RunError> {
    let failed = |e| RunError::stage(OUTPUT_STAGE, e);
    let run_dir = RunDir::open(place, ResultKind::Diagnose).map_err(failed)?;
    files.iter().try_for_each(|(path, content)| run_dir.put(path, content.as_bytes())).map_err(failed)?;
    let committed = run_dir.commit().map_err(failed)?;
    warnings.extend(committed.note());
    Ok(committed.folder)
}

/// `report.json`: findings and warnings.
#[derive(Serialize)]
struct ReportFile<'a> {
    #[serde(flatten)]
    report: Report,
    effort_hold: EffortHold,
    warnings: &'a [Note],
}

/// The findings of a diagnosis by motion, before they are written.
pub(super) struct MotionDiagnosis {
    /// Path and content of every file.
    pub files: Vec<(String, String)>,
    /// The content of `report.json`, which is one of them.
    pub report: String,
    pub verdict: Verdict,
    pub summary: String,
    pub warnings: Vec<Note>,
}

/// All recordings.
pub(super) struct Recorded {
    /// The runs, each with whether only the proof uses it.
    pub recordings: Vec<(Recording, bool)>,
    /// Motion other than the joint's, from the poses of each run, by joint.
    pub off_axis: Vec<BTreeMap<usize, OffAxis>>,
    pub warnings: Vec<Note>,
}

/// Reads all runs and holds some of them out.
fn read_runs(request: &DiagnoseRequest, tree: &TwinTree, monitor: &Monitor) -> Result<Recorded, RunError> {
    let failed = |what: &str, e: &dyn std::fmt::Display| RunError::stage(what, e.to_string());
    // Checked before any bag is read, so an unknown link is reported at once.
    for (topic, link) in request.streams.wrenches.iter().chain(&request.streams.poses) {
        moved_link(tree, topic, link).map_err(|e| failed("twin", &e))?;
    }
    for (joint, _) in &request.streams.joints {
        if !tree.joints.iter().any(|j| j.name == *joint) {
            let names = tree.joints.iter().map(|j| j.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(failed("twin", &format!("--joint: the twin has no joint '{joint}'; it has {names}")));
        }
    }
    let streams =
        Streams { links: tree.links.iter().map(|l| l.name.clone()).collect(), ..request.streams.clone() };
    let mut read = Recorded { recordings: Vec::new(), off_axis: Vec::new(), warnings: Vec::new() };
    let is_held = |p: &Path| request.held_out.iter().any(|h| h == p);
    // A held-out run may be among the runs or beside them; it is read once.
    let beside = request.held_out.iter().filter(|h| !request.runs.contains(h));
    for path in request.runs.iter().chain(beside) {
        monitor.check()?;
        let mut recording =
            io::read_joint_log(path, &streams).map_err(|e| RunError::stage("recording", e))?;
        let about =
            |e: &dyn std::fmt::Display| failed("recording", &format!("run '{}': {e}", path.display()));
        // Positions from poses and efforts from wrenches are added before the joints are examined.
        read.off_axis.push(
            complete_run(&mut recording, tree, request.hold.unwrap_or_default()).map_err(|e| about(&e))?,
        );
        read.warnings.extend(recording.warnings.iter().cloned());
        read.recordings.push((recording, is_held(path)));
    }
    if request.held_out.is_empty() && read.recordings.len() > MOST_DIVIDED {
        // Every third run.
        let n = read.recordings.len();
        // Spread over all runs: conditions may drift from the first to the last.
        let count = n / 3;
        for i in 0..count {
            read.recordings[n - 1 - i * n / count].1 = true;
        }
    }
    Ok(read)
}

/// Diagnoses a twin.
///
/// # Errors
/// [`RunError`] if the place is taken (reported before the work), the twin or a run cannot be read, nothing
/// can be said about any joint, or the disk refuses.
pub fn diagnose(request: &DiagnoseRequest, monitor: &Monitor) -> Result<DiagnoseOutcome, RunError> {
    let request = &request.with_urdf()?;
    let (tree, text) =
        io::read_twin(&request.twin, request.gravity).map_err(|e| RunError::stage("twin", e))?;
    let place = request.place(&text, &[]);
    place
        .check(ResultKind::Diagnose, least_diagnosis(&text))
        .map_err(|e| RunError::stage(OUTPUT_STAGE, e))?;
    let MotionDiagnosis { files, verdict, summary, mut warnings, .. } = find(request, &tree, &text, monitor)?;
    let folder = put_files(&place, &files, &mut warnings)?;
    warnings.iter().for_each(|warning| monitor.warn(warning));
    Ok(DiagnoseOutcome { folder, verdict, summary, warnings })
}

/// Diagnoses by motion a twin with URDF `text`; writes nothing.
pub(super) fn find(
    request: &DiagnoseRequest,
    tree: &TwinTree,
    text: &str,
    monitor: &Monitor,
) -> Result<MotionDiagnosis, RunError> {
    let failed = |what: &str, e: &dyn std::fmt::Display| RunError::stage(what, e.to_string());
    let effects = catalogue(moving_joints(tree).len().saturating_sub(1));
    let wanted = indices(&effects, &request.effects).map_err(|e| failed("diagnose", &e))?;
    let recorded = read_runs(request, tree, monitor)?;
    let Assessed { joints, moving, left_out, effort_hold, mut warnings } =
        assessed(request, tree, recorded, &effects, wanted, monitor)?;
    monitor.check()?;
    if joints.is_empty() {
        let why =
            if left_out.is_empty() { "the twin has no moving joint".to_owned() } else { left_out.join("; ") };
        return Err(RunError::stage("diagnose", why));
    }
    warnings.extend(left_out.into_iter().map(|why| Note::new(NoteCode::JointNotDiagnosed, why)));
    let (urdf, mut exports) =
        urdf::urdf(text, tree, &joints, &effects, "twin.urdf").map_err(|e| failed("twin", &e))?;
    let (mjcf, notes) = mjcf::mjcf(tree, &joints, &effects, "twin.xml");
    exports.extend(notes);
    let (mut more, notes) = beside(&request.twin, tree, &joints, &effects);
    exports.extend(notes);
    warnings.extend(less(&joints, &exports));
    let facts = DiagnosisFacts {
        joints: &joints,
        effects: &effects,
        tree,
        urdf: text,
        exports: &exports,
        warnings: &warnings,
    };
    let page = diagnosis_page(&facts);
    let names = LawNames { tree, moving: &moving, catalogue: &effects };
    let laws = effects_file(&names, &joints, &exports);
    let laws = serde_json::to_string_pretty(&laws).map_err(|e| failed("effects", &e))? + "\n";
    let file = ReportFile { report: report::report(&joints, exports), effort_hold, warnings: &warnings };
    let json = serde_json::to_string_pretty(&file).map_err(|e| failed("report", &e))? + "\n";
    let windows: Vec<_> = joints.iter().flat_map(|j| &j.replay).collect();
    let replay = serde_json::to_string(&windows).map_err(|e| failed("report", &e))?;
    more.extend([
        ("twin.urdf", urdf),
        ("twin.xml", mjcf),
        ("report.json", json.clone()),
        ("replay.json", replay + "\n"),
        ("effects.json", laws),
        ("report.html", page),
    ]);
    let files = more.into_iter().map(|(path, content)| (path.to_owned(), content)).collect();
    Ok(MotionDiagnosis {
        files,
        report: json,
        verdict: report::overall_verdict(&joints),
        summary: report::summary_of_joints(&joints),
        warnings,
    })
}

/// Warnings about files that contain less than the findings.
fn less(joints: &[JointReport], exports: &[ExportNote]) -> Vec<Note> {
    let mut notes = Vec::new();
    for joint in joints {
        // If there is no file, or its format cannot express the joint, the notes of the effects say so.
        let formats = joint.in_format.iter();
        let written: Vec<_> =
            formats.filter_map(|held| Some((held, exported_file(joint, held, exports)?))).collect();
        let is_sole = written.iter().all(|(held, _)| held.keeps_twin());
        notes.extend(written.iter().filter_map(|(held, file)| format_note(held, file, joint, is_sole)));
    }
    notes
}

/// The SDF and the USD beside the twin, if it is in a run folder, with the effects; and what became of each.
fn beside(
    twin: &Path,
    tree: &TwinTree,
    joints: &[JointReport],
    effects: &Catalogue,
) -> (Vec<(&'static str, String)>, Vec<ExportNote>) {
    let mut files = Vec::new();
    let mut remarks = Vec::new();
    for (format, file, path, limit) in [
        (Format::Sdf, "model.sdf", twin.with_file_name("model.sdf"), SDF),
        (Format::Usd, "twin.usda", twin.with_extension("usda"), USD),
    ] {
        let changed = files::read_text(&path, limit)
            .ok()
            .map(|text| placed_text(format, &text, tree, joints, effects, file));
        let why = match changed {
            Some(Ok((text, notes))) => {
                files.push((file, text));
                remarks.extend(notes);
                continue;
            }
            Some(Err(error)) => format!("{file} beside the twin: {error}"),
            None if format == Format::Usd => "no .usda of its name stands beside the twin".to_owned(),
            None => format!("no {file} stands beside the twin"),
        };
        remarks.extend(joints.iter().flat_map(|j| missing(format, j, effects, &why)));
    }
    (files, remarks)
}

/// No effect has this name.
#[derive(Debug, thiserror::Error)]
#[error("no effect is called '{name}'; there are {known}")]
struct UnknownEffect {
    name: String,
    known: String,
}

/// Indices of named effects.
fn indices(catalogue: &Catalogue, names: &[String]) -> Result<Vec<usize>, UnknownEffect> {
    let mut indices = Vec::with_capacity(names.len());
    for name in names {
        let Some(index) = catalogue.iter().position(|e| e.name() == name) else {
            let known = catalogue.iter().map(|e| e.name()).collect::<Vec<_>>().join(", ");
            return Err(UnknownEffect { name: name.clone(), known });
        };
        indices.push(index);
    }
    Ok(indices)
}
