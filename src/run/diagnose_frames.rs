//! The diagnosis by frames: takes a twin and RGB-D recordings, and gives a verdict, an updated twin and a
//! report.

use std::path::{Path, PathBuf};

use super::{
    DiagnoseOutcome, DiagnoseRequest, Event, Monitor, RunError,
    diagnose::{find, put_files},
    frame_run::frame_run,
    least_bytes::least_diagnosis,
    outcome::OUTPUT_STAGE,
};
use capture::{CaptureError, RgbdFrame};
use common::note::{Note, NoteCode};
use export::{Picture, PictureKind, diagnosed::seen_urdf};
use gap::{
    camera::{
        fit::predict::{rendered_twin, true_camera},
        judge::{assess::frame_diagnosis, diagnosis::FrameDiagnosis, report},
        model::{
            hypothesis::Hypothesis,
            own_error::{JointError, OwnErrors},
            twin::SeenTwin,
        },
        record::{frames::FrameRun, options::FrameOptions},
    },
    judge::verdict::Verdict,
};
use geometry::{Intrinsics, Pose};
use io::{self, ResultKind, SummaryJoint};
use model::{escape_lines, escape_xml};

/// Number of frames of every run that are shown.
const SHOWN: usize = 2;
/// Number of runs shown on the page.
const RUNS_SHOWN: usize = 4;
/// Residual drawn in full color, as a share of the gate. chosen: for the eye
const FULL: f64 = 0.25;

/// Diagnoses a twin by frames, and also by motion if the request has runs. Both are in one report; the
/// motion's files are in the folder `motion`.
///
/// # Errors
/// [`RunError`] if the place is taken (checked before the work), the twin or a recording cannot be read, the
/// frames do not show the twin, or the disk refuses.
pub fn diagnose_frames(
    request: &DiagnoseRequest,
    recordings: &[PathBuf],
    options: &FrameOptions,
    monitor: &Monitor,
) -> Result<DiagnoseOutcome, RunError> {
    let failed = |what: &str, e: &dyn std::fmt::Display| RunError::stage(what, e.to_string());
    if !(options.accuracy_m.is_finite() && options.accuracy_m > 0.0) {
        return Err(RunError::stage(
            "accuracy",
            "the accuracy of the twin must be a positive number of millimeters".to_owned(),
        ));
    }
    let request = &request.with_urdf()?;
    // First the twin, then its place, then the recordings: cheap refusals come first.
    let (mut twin, text) = io::read_seen_twin(&request.twin).map_err(|e| failed("twin", &e))?;
    if let Some(own) = own_errors(&request.twin, &twin) {
        // The run folder of a reconstructed twin reports its errors: effects within them are not named.
        twin.own = own;
    }
    let place = request.place(&text, recordings);
    place
        .check(ResultKind::Diagnose, least_diagnosis(&text))
        .map_err(|e| RunError::stage(OUTPUT_STAGE, e))?;
    let mut warnings = Vec::new();
    let mut runs: Vec<FrameRun> = Vec::new();
    monitor.report(Event::StageStarted { stage: "frames".to_owned(), steps: None });
    for path in recordings {
        monitor.check()?;
        let run = frame_run(path, request.seed, &mut warnings, &monitor.stop());
        runs.push(run.map_err(|e| match e {
            CaptureError::Stopped(stopped) => stopped.into(),
            other => failed("frames", &other),
        })?);
    }
    let mut diagnosis = frame_diagnosis(&twin, &runs, options).map_err(|e| failed("diagnose", &e))?;
    monitor.check()?;
    if !twin.own.is_exact() {
        // First, because all findings must be read with it in mind.
        diagnosis.notes.insert(0, known_errors(&twin));
    }
    let (urdf, exports) =
        seen_urdf::urdf(&text, &diagnosis, &twin.joints, "twin.urdf").map_err(|e| failed("twin", &e))?;
    let mut json = report::report(&twin, &diagnosis, &exports);
    let mut summary = report::summary_of_frames(&twin, &diagnosis);
    let mut verdict = diagnosis.verdict;
    let mut files: Vec<(String, String)> = Vec::new();
    if !request.runs.is_empty() {
        let (tree, text) = io::read_twin(&request.twin, request.gravity).map_err(|e| failed("twin", &e))?;
        let motion = find(request, &tree, &text, monitor)?;
        files.extend(motion.files.into_iter().map(|(path, content)| (format!("motion/{path}"), content)));
        // One report with the findings of both: readers need not know which found what.
        json = report::merged_reports(
            serde_json::from_str(&motion.report).map_err(|e| failed("report", &e))?,
            &json,
        );
        // Where frames show no gap, the motion decides.
        if verdict == Verdict::None {
            verdict = motion.verdict;
        }
        summary = format!("by frames, {summary}by motion, {}", motion.summary);
        warnings.extend(motion.warnings);
    }
    // A page without other files is easy to send.
    let page = page(&summary, &twin, &runs, &diagnosis)?;
    json["warnings"] = serde_json::to_value(&warnings).map_err(|e| failed("report", &e))?;
    let json = serde_json::to_string_pretty(&json).map_err(|e| failed("report", &e))?;
    files.extend(
        [("twin.urdf", urdf), ("report.json", json + "\n"), ("report.html", page)]
            .map(|(path, content)| (path.to_owned(), content)),
    );
    let folder = put_files(&place, &files, &mut warnings)?;
    warnings.iter().for_each(|w| monitor.warn(w));
    Ok(DiagnoseOutcome { folder, verdict, summary, warnings })
}

/// Errors of a twin according to the report of its run folder; `None` if it has none. Unknown values count as
/// zero.
fn own_errors(path: &Path, twin: &SeenTwin) -> Option<OwnErrors> {
    let known = io::read_run_summary(path.parent()?).ok()?.joints;
    let joints = twin.joints.iter().map(|j| joint_error(&known, &j.name)).collect();
    // The largest over the parts: no effect can be named within the error of the surface.
    let surface_m = known.iter().map(|k| or_zero(k.residual_rms_m)).fold(0.0, f64::max);
    Some(OwnErrors { surface_m, joints })
}

/// Errors of a joint according to a run's report; zero for a joint that it does not contain.
fn joint_error(known: &[SummaryJoint], name: &str) -> JointError {
    let known = known.iter().find(|k| k.name == name);
    known.map_or_else(JointError::default, |k| JointError {
        axis_rad: or_zero(k.axis_std_rad),
        place_m: or_zero(k.origin_std_m),
    })
}

fn or_zero(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}

/// The note on the own errors of a reconstructed twin.
fn known_errors(twin: &SeenTwin) -> Note {
    let worst = |of: fn(&JointError) -> f64| twin.own.joints.iter().map(of).fold(0.0, f64::max);
    let (place_m, axis_rad) = (worst(|j| j.place_m), worst(|j| j.axis_rad));
    let text = format!(
        "the twin is a reconstruction: its surfaces are known to {:.1} mm, its axes to {:.1} mm and {:.2} \
         deg (standard deviation, worst joint); effects within that, of an axis within three times that, are \
         not named, and geometry may be missing in the twin alone",
        1e3 * twin.own.surface_m,
        1e3 * place_m,
        axis_rad.to_degrees()
    );
    Note::new(NoteCode::TwinUncertain, text)
}

/// One self-contained page: the summary, then photo, twin and residuals of some frames.
fn page(summary: &str, twin: &SeenTwin, runs: &[FrameRun], d: &FrameDiagnosis) -> Result<String, RunError> {
    let mut page = format!(
        "<!doctype html><meta charset=\"utf-8\"><title>diagnosis</title><style>\
         body{{font:14px sans-serif;max-width:80em;margin:2em auto}}\
         pre{{background:#f4f4f4;padding:1em;white-space:pre-wrap;overflow-wrap:anywhere}}\
         section{{display:flex;flex-wrap:wrap;gap:8px}}figure{{margin:0;width:24%}}\
         img{{width:100%}}</style><h1>Diagnosis</h1><pre>{}</pre>\
         <p>Residuals: red, the object is nearer than the twin; blue, farther; \
         full color from {:.0} mm; black, one is where the other is not; gray, within.</p>",
        escape_lines(summary),
        1e3 * full_m(d)
    );
    for (r, run) in runs.iter().enumerate().take(RUNS_SHOWN) {
        page.push_str(&format!("<h2>{}</h2>", escape_xml(&run.name)));
        for s in 0..SHOWN.min(run.frames.len()) {
            // From the middle of each share of the run, not from its ends.
            let f = s * run.frames.len() / SHOWN + run.frames.len() / (2 * SHOWN);
            page.push_str("<section>");
            for picture in pictures(twin, run, r, f, d) {
                page.push_str(&picture.figure_html().map_err(|e| RunError::stage("report", e.to_string()))?);
            }
            page.push_str("</section>");
        }
    }
    Ok(page)
}

/// Photo, updated twin, and residuals before and after, for a frame.
fn pictures(twin: &SeenTwin, run: &FrameRun, r: usize, f: usize, d: &FrameDiagnosis) -> Vec<Picture> {
    let frame = &run.frames[f];
    let k = &frame.intrinsics;
    let poses = d.after.part_and_joint_poses(&d.twin, r).0;
    let drawn = rendered_twin(&d.twin, &poses, k, &true_camera(run, f, &d.after.camera), true);
    vec![
        picture(k, frame.rgb.as_flattened().to_vec(), PictureKind::Photo, "photo"),
        picture(k, drawn.rgb.as_flattened().to_vec(), PictureKind::Photo, "updated twin"),
        picture(
            k,
            residual(twin, frame, &true_camera(run, f, &d.before.camera), r, &d.before, full_m(d)),
            PictureKind::Drawing,
            "residual of the twin",
        ),
        picture(
            k,
            residual(&d.twin, frame, &true_camera(run, f, &d.after.camera), r, &d.after, full_m(d)),
            PictureKind::Drawing,
            "residual of the updated twin",
        ),
    ]
}

fn picture(k: &Intrinsics, rgb: Vec<u8>, kind: PictureKind, caption: &str) -> Picture {
    let caption = caption.to_owned();
    Picture { width: k.width, height: k.height, rgb, kind, caption, arrows: Vec::new() }
}

/// Residual that is drawn in full color, meters.
fn full_m(d: &FrameDiagnosis) -> f64 {
    FULL * d.scales.gate_m()
}

/// Depth residual of a frame of a run in colors.
fn residual(
    twin: &SeenTwin,
    frame: &RgbdFrame,
    camera: &Pose,
    run: usize,
    hypothesis: &Hypothesis,
    full_m: f64,
) -> Vec<u8> {
    let poses = hypothesis.part_and_joint_poses(twin, run).0;
    let image = rendered_twin(twin, &poses, &frame.intrinsics, camera, false);
    let mut rgb = Vec::with_capacity(3 * image.depth_m.len());
    for i in 0..image.depth_m.len() {
        let reading = f64::from(frame.depth_m[i]);
        // The camera's error under the hypothesis is removed, as in (15.3).
        let measured = (reading - hypothesis.camera.bias_m) / hypothesis.camera.scale;
        rgb.extend(match (frame.is_object(i), image.item[i].is_some()) {
            (true, true) if reading > 0.0 => {
                let x = ((measured - f64::from(image.depth_m[i])) / full_m).clamp(-1.0, 1.0);
                let fade = (220.0 * (1.0 - x.abs())) as u8;
                if x < 0.0 { [220, fade, fade] } else { [fade, fade, 220] }
            }
            (true, true) => [200; 3],
            (true, false) if reading > 0.0 && frame.mask.is_some() => [0; 3],
            (false, true) => [0; 3],
            _ => [255; 3],
        });
    }
    rgb
}
