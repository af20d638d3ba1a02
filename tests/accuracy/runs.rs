//! The runs of the table, and the program that makes them.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::{Mutex, OnceLock},
    time::Instant,
};

use super::frame;

/// What is reconstructed.
pub enum Recording {
    /// A recording of `bags/`.
    Shipped(&'static str),
    /// An object that `synth` makes by these options, and the size of its recording.
    Made(&'static str, &'static str),
}

/// Where a twin is compared with the truth.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// In the world of the recording.
    World,
    /// In the twin's own frame, near the world: poses of a sensor carried by hand are off as a whole.
    OfTwin,
    /// In the twin's own frame, which is another one: tracked cameras have a world of their own.
    OfTrackedTwin,
}

/// A row of the table.
pub struct Run {
    pub name: &'static str,
    pub recording: Recording,
    /// Options of `reconstruct`.
    pub options: &'static [&'static str],
    pub frame: Frame,
    done: OnceLock<Finished>,
}

/// How a run ended.
pub struct Finished {
    /// Folder of the twin, which stands where the truth does; `None` where the program made none.
    pub twin: Option<PathBuf>,
    /// Folder with the truth.
    pub truth: PathBuf,
    /// Exit code and the last line that was printed.
    pub outcome: String,
    /// Wall time of the run, and of making its object.
    pub seconds: f64,
}

/// Size of made recordings: that of `bags/drawer`, so that a run takes seconds.
const SMALL: &str = "--views 16 --width 320 --height 240";
/// Images of a depth sensor, for small parts.
const VGA: &str = "--views 16 --width 640 --height 480";

const fn run(
    name: &'static str,
    recording: Recording,
    options: &'static [&'static str],
    frame: Frame,
) -> Run {
    Run { name, recording, options, frame, done: OnceLock::new() }
}

const PREVIEW: &[&str] = &["--preset", "preview"];

/// Every family of objects is in it. A made object has the first seed, 0, whatever comes out.
pub static RUNS: [Run; 13] = [
    run("drawer", Recording::Shipped("drawer"), &[], Frame::World),
    run("drawer, preview", Recording::Shipped("drawer"), PREVIEW, Frame::World),
    run("drawer_raw", Recording::Shipped("drawer_raw"), &[], Frame::World),
    run("drawer_raw, preview", Recording::Shipped("drawer_raw"), PREVIEW, Frame::World),
    run("laptop", Recording::Shipped("laptop"), &[], Frame::World),
    run("laptop, preview", Recording::Shipped("laptop"), PREVIEW, Frame::World),
    run("real_box", Recording::Shipped("real_box"), &[], Frame::World),
    run(
        "cabinet of four parts",
        Recording::Made("--family cabinet --parts 4 --textured", VGA),
        &[],
        Frame::World,
    ),
    run("chain", Recording::Made("--family lamp --parts 3 --textured", VGA), &[], Frame::World),
    run("screw", Recording::Made("--family capped_box --parts 2 --textured", SMALL), &[], Frame::World),
    run("plain", Recording::Made("--family folding_door --parts 2 --plain", SMALL), &[], Frame::World),
    run(
        "hand-held without masks",
        Recording::Made("--family clamshell --textured --sensor handheld", SMALL),
        &[],
        Frame::OfTwin,
    ),
    run(
        "tracked without poses",
        Recording::Made("--family cabinet --parts 2 --textured", SMALL),
        &["--set", "capture.tracking=always"],
        Frame::OfTrackedTwin,
    ),
];

/// Only one run at a time: the program uses all cores.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// A run, made at its first use.
pub fn finished(run: &Run) -> &Finished {
    run.done.get_or_init(|| {
        let _alone = ONE_AT_A_TIME.lock().unwrap();
        make(run)
    })
}

fn make(run: &Run) -> Finished {
    let start = Instant::now();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("accuracy").join(run.name);
    std::fs::remove_dir_all(&folder).ok();
    let recording = match &run.recording {
        Recording::Shipped(name) => Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name),
        Recording::Made(options, size) => {
            let made = folder.join("made");
            let mut command = Command::new(PROGRAM);
            command.arg("synth").arg("--out").arg(&made).args(options.split(' ')).args(size.split(' '));
            let (code, said) = artitwin(&mut command);
            assert_eq!(code, 0, "{}: synth: {said}", run.name);
            made
        }
    };
    let mut command = Command::new(PROGRAM);
    command.arg("reconstruct").arg(&recording).arg("--out").arg(&folder).args(["--name", "object"]);
    command.args(run.options);
    // The box that a user gives where there are no masks.
    if let Ok(workspace) = std::fs::read_to_string(recording.join("workspace.txt")) {
        command.arg(format!("--workspace={}", workspace.trim()));
    }
    let (code, said) = artitwin(&mut command);
    let mut twin = Some(folder.join("object")).filter(|twin| twin.join("report.json").exists());
    if run.frame != Frame::World {
        twin = twin.map(|twin| frame::placed(&twin, &recording, run.frame));
    }
    let outcome = format!("exit code {code}: {}", said.lines().last().unwrap_or_default());
    Finished { twin, truth: recording, outcome, seconds: start.elapsed().as_secs_f64() }
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_artitwin");

/// Exit code and what was said on stderr.
fn artitwin(command: &mut Command) -> (i32, String) {
    let ended = command.output().unwrap();
    (ended.status.code().unwrap_or(-1), String::from_utf8_lossy(&ended.stderr).into_owned())
}
