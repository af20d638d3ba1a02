//! Where results go: nothing is lost that the program did not write itself, and what cannot be written is
//! told.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

mod common;
#[path = "common/doors.rs"]
mod doors;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/program.rs"]
mod program;

use std::{
    collections::BTreeMap,
    fs::{self, File},
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    sync::OnceLock,
};

use harness::{Missing, tests};
use program::{Ended, end, shipped};
use tempfile::TempDir;

fn main() -> ExitCode {
    harness::main(tests![
        diagnose_and_synth_leave_a_twins_folder_as_it_is,
        notes_and_edits_survive_a_second_reconstruction,
        the_manifest_names_every_file_with_its_digest,
        out_and_name_mean_the_same_for_all_commands,
        a_result_never_takes_the_place_of_an_input,
        a_link_is_no_place_for_a_result,
        #[cfg(feature = "node")]
        record_overwrites_nothing,
        a_diagnosis_by_frames_and_motion_is_one_result,
        #[cfg(target_os = "linux")]
        a_full_standard_output_is_a_failure_of_every_command,
        #[cfg(target_os = "linux")]
        events_that_cannot_be_written_stop_the_run,
        a_reader_that_went_away_is_no_error,
        #[cfg(target_os = "linux")]
        a_disk_that_is_too_full_is_refused_before_the_work,
        #[cfg(target_os = "linux")]
        a_disk_that_fills_up_midway_leaves_nothing,
        #[cfg(target_os = "linux")]
        a_file_that_cannot_be_written_whole_leaves_nothing,
    ])
}

/// What the first stage of a reconstruction says.
const BEGUN: &str = "capture: started";
/// A small object.
const SMALL_SYNTH: [&str; 8] = ["--seed", "3", "--views", "3", "--width", "96", "--height", "72"];

fn artitwin() -> Command {
    Command::new(env!("CARGO_BIN_EXE_artitwin"))
}

/// A reconstruction of a few seconds.
fn reconstruct(bag: &Path, out: &Path, options: &[&str]) -> Command {
    let mut command = artitwin();
    command.arg("reconstruct").arg(bag).arg("--out").arg(out).args(["--preset", "preview", "--parts", "2"]);
    command.args(["--set", "surface.nodes=64", "--set", "surface.points=3000"]).args(options);
    command
}

fn synth(out: &Path, options: &[&str]) -> Command {
    let mut command = artitwin();
    command.arg("synth").arg("--out").arg(out).args(SMALL_SYNTH).args(options);
    command
}

/// A diagnosis of two doors by two runs; twin and runs lie in `folder`.
fn diagnose(folder: &TempDir, out: &Path, options: &[&str]) -> Command {
    let (twin, runs) = doors::write(folder, 2, 4.0);
    let mut command = artitwin();
    command.arg("diagnose").arg(twin).args(runs).arg("--out").arg(out).args(options);
    command
}

/// Runs a command that must give a result, degraded or not.
fn done(command: &mut Command) -> Ended {
    let ended = end(command);
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    ended
}

/// Everything below a folder: the bytes of files, where links lead.
fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let (path, kind) = (entry.path(), entry.file_type().unwrap());
        if kind.is_dir() {
            all.extend(snapshot(&path));
            all.insert(path, Vec::new());
        } else if kind.is_symlink() {
            all.insert(path.clone(), fs::read_link(&path).unwrap().into_os_string().into_encoded_bytes());
        } else {
            all.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    all
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let place = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &place);
        } else {
            fs::copy(entry.path(), place).unwrap();
        }
    }
}

/// The twin of `bags/drawer`, reconstructed once, in `folder/runs/drawer`.
fn twin(folder: &TempDir) -> PathBuf {
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let made = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outputs-twin");
        fs::remove_dir_all(&made).ok();
        done(&mut reconstruct(&shipped("drawer"), &made, &[]));
        made
    });
    let twin = folder.path().join("runs/drawer");
    copy(&made.join("drawer"), &twin);
    twin
}

/// Runs a command that must be refused without a change to `folder`.
fn refused(command: &mut Command, folder: &Path, words: &[&str]) -> Ended {
    refused_with(1, command, folder, words)
}

fn refused_with(code: i32, command: &mut Command, folder: &Path, words: &[&str]) -> Ended {
    let before = snapshot(folder);
    let ended = end(command);
    assert_eq!((ended.code, ended.stdout.as_str()), (code, ""), "{}", ended.stderr);
    assert!(snapshot(folder) == before, "something changed in {}", folder.display());
    for word in words {
        assert!(ended.stderr.contains(word), "`{word}` is not in:\n{}", ended.stderr);
    }
    assert!(!ended.stderr.contains(BEGUN), "{}", ended.stderr);
    ended
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn diagnose_and_synth_leave_a_twins_folder_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let runs = tempfile::tempdir().unwrap();
    let twin = twin(&folder);
    refused(
        &mut synth(&twin, &[]),
        folder.path(),
        &["it is a result of reconstruct, not of synth", "--force, which moves it to", "drawer.bak"],
    );
    refused(
        &mut diagnose(&runs, &twin, &[]),
        folder.path(),
        &["it is a result of reconstruct, not of diagnose", "another --out or --name"],
    );
    // The twin that is diagnosed: not even by force, however its folder is named.
    let (_, bags) = doors::write(&runs, 1, 4.0);
    symlink(&twin, folder.path().join("link")).unwrap();
    for out in [
        &twin,
        &twin.join("../drawer"),
        &folder.path().join("runs"),
        &folder.path().join("link"),
        &twin.join("meshes"),
    ] {
        for force in [&[][..], &["--force"]] {
            let mut command = artitwin();
            command
                .arg("diagnose")
                .arg(folder.path().join("link/drawer.urdf"))
                .args(&bags)
                .arg("--out")
                .arg(out)
                .args(force);
            refused(&mut command, folder.path(), &["is or holds the input", "give another --out or --name"]);
        }
    }
    // The folder of an older version.
    fs::remove_file(twin.join("manifest.json")).unwrap();
    for command in
        [&mut synth(&twin, &[]), &mut reconstruct(&shipped("drawer"), &folder.path().join("runs"), &[])]
    {
        refused(
            command,
            folder.path(),
            &[
                "runs/drawer is left as it is: it holds ",
                "and no manifest.json that says which command wrote it",
            ],
        );
    }
}

fn notes_and_edits_survive_a_second_reconstruction() {
    let folder = tempfile::tempdir().unwrap();
    let (runs, twin) = (folder.path().join("runs"), twin(&folder));
    fs::write(twin.join("notes.txt"), "the hinge squeaks").unwrap();
    fs::write(twin.join("drawer.urdf"), "<robot/>").unwrap();
    let told =
        ["runs/drawer is left as it is: since reconstruct wrote it, drawer.urdf was edited, notes.txt was \
         added"];
    refused(&mut reconstruct(&shipped("drawer"), &runs, &[]), folder.path(), &told);

    let before = snapshot(&twin);
    let forced = done(&mut reconstruct(&shipped("drawer"), &runs, &["--force"]));
    let moved = format!("what stood at {0} was moved to {0}.bak", twin.display());
    assert!(forced.stderr.lines().any(|l| l == moved), "{}", forced.stderr);
    assert_eq!(names(&runs), ["drawer", "drawer.bak"]);
    let after = snapshot(&runs.join("drawer.bak"));
    assert!(before.values().eq(after.values()), "the copy differs");

    // What nobody changed is replaced, by force too, without a copy.
    let again = done(&mut reconstruct(&shipped("drawer"), &runs, &["--force"]));
    assert_eq!(names(&runs), ["drawer", "drawer.bak"]);
    assert!(!again.stderr.contains("was moved to"), "{}", again.stderr);
}

fn the_manifest_names_every_file_with_its_digest() {
    let folder = tempfile::tempdir().unwrap();
    let (twin, object, diagnosis) =
        (twin(&folder), folder.path().join("made/object"), folder.path().join("found"));
    done(&mut synth(&folder.path().join("made"), &["--name", "object"]));
    done(&mut diagnose(&folder, &diagnosis, &[]));
    for (result, command) in [(&twin, "reconstruct"), (&object, "synth"), (&diagnosis, "diagnose")] {
        let manifest: serde_json::Value =
            serde_json::from_slice(&fs::read(result.join("manifest.json")).unwrap()).unwrap();
        assert_eq!(
            (&manifest["command"], &manifest["artitwin"]),
            (&command.into(), &env!("CARGO_PKG_VERSION").into())
        );
        let files = manifest["files"].as_object().unwrap();
        let there = snapshot(result).into_keys().filter(|p| p.is_file());
        let mut there: Vec<_> =
            there.map(|p| p.strip_prefix(result).unwrap().to_str().unwrap().to_owned()).collect();
        there.retain(|p| p != "manifest.json");
        there.sort();
        assert!(there.iter().eq(files.keys()), "{command}: {there:?}");
        let mut sums = Command::new("sha256sum");
        let output = sums.current_dir(result).args(files.keys()).output().unwrap();
        let expected: String =
            files.iter().map(|(path, f)| format!("{}  {path}\n", f["sha256"].as_str().unwrap())).collect();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), expected);
    }
    // All three replace what they wrote.
    done(&mut synth(&folder.path().join("made"), &["--name", "object", "--plain"]));
    done(&mut diagnose(&folder, &diagnosis, &[]));
    assert_eq!(names(&folder.path().join("made")), ["object"]);
}

fn out_and_name_mean_the_same_for_all_commands() {
    let help = |verb: &str| {
        let text = end(artitwin().args([verb, "--help"])).stdout;
        let (_, text) = text.split_once("\nOutput:\n").expect("a heading");
        let text = text.split("\nConfiguration").next().unwrap();
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let said = help("reconstruct");
    for option in ["--out <DIR> Folder that gets the result", "--name <NAME>", "--force"] {
        assert!(said.contains(option), "{option} is not in {said}");
    }
    assert_eq!([help("diagnose"), help("synth")], [said.clone(), said]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("all");
    done(&mut synth(&out, &["--name", "object"]));
    done(&mut diagnose(&folder, &out, &["--name", "gap"]));
    assert_eq!(names(&out), ["gap", "object"]);
    assert!(out.join("gap/report.json").is_file() && out.join("object/state0/metadata.yaml").is_file());
    let wrong = end(&mut synth(&out, &["--name", "../x"]));
    assert_eq!(wrong.code, 2, "{}", wrong.stderr);
}

fn a_result_never_takes_the_place_of_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let bags = folder.path().join("bags");
    copy(&shipped("drawer"), &bags.join("drawer"));
    fs::create_dir_all(folder.path().join("files/drawer")).unwrap();
    fs::write(folder.path().join("files/drawer/mine.yaml"), "run: {seed: 3}\n").unwrap();
    symlink(&bags, folder.path().join("link")).unwrap();
    let bag = bags.join("drawer");
    let config = folder.path().join("files/drawer/mine.yaml");
    let checkpoint = folder.path().join(".artitwin-box.checkpoint");
    symlink(&bags, &checkpoint).unwrap();
    let (linked, state) = (folder.path().join("link/drawer"), bag.join("state0"));
    let mut cases: Vec<(&Path, PathBuf, Vec<&str>)> = vec![
        (&bag, bags.clone(), vec![]),
        (&bag, folder.path().join("link"), vec![]),
        (&bag, folder.path().to_owned(), vec!["--name", "bags"]),
        (&linked, folder.path().to_owned(), vec!["--name", "link"]),
        (&bag, folder.path().join("files"), vec!["--config", config.to_str().unwrap()]),
        (&state, bags.clone(), vec!["--name", "drawer"]),
    ];
    if cfg!(feature = "onnx") {
        cases.push((&bag, folder.path().join("files"), vec!["--matcher", config.to_str().unwrap()]));
    }
    for (source, out, options) in cases {
        let options = [&options[..], &["--force"]].concat();
        refused(&mut reconstruct(source, &out, &options), folder.path(), &["is or holds the input"]);
    }
    // Of several objects the recording of another one.
    let mut jobs = reconstruct(&bag, folder.path(), &["--jobs", "1", "--force"]);
    copy(&shipped("laptop"), &folder.path().join("other/bags"));
    jobs.arg(folder.path().join("other/bags"));
    let ended = end(&mut jobs);
    assert!(ended.stderr.contains("bags, which is or holds the input"), "{}", ended.stderr);
    assert!(bag.join("state0/state0.mcap").is_file(), "the recording is gone");
    // The checkpoint is no way around it.
    refused(
        &mut reconstruct(&bag, folder.path(), &["--name", "box", "--force"]),
        folder.path(),
        &[".artitwin-box.checkpoint is left as it is: it is a link"],
    );
    // Nor is the name of a rejected twin.
    copy(&bag, &folder.path().join("box_rejected"));
    let held = folder.path().join("box_rejected");
    refused(
        &mut reconstruct(&held, folder.path(), &["--name", "box", "--force"]),
        folder.path(),
        &["box_rejected, which is or holds the input"],
    );
}

fn a_link_is_no_place_for_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let theirs = folder.path().join("theirs");
    fs::create_dir(&theirs).unwrap();
    symlink(&theirs, folder.path().join("mine")).unwrap();
    for out in ["mine", "mine/"] {
        refused(
            &mut synth(&folder.path().join(out), &[]),
            folder.path(),
            &["mine is left as it is: it is a link"],
        );
    }
    let forced = end(&mut synth(&folder.path().join("mine/"), &["--force"]));
    assert_eq!(forced.code, 0, "{}", forced.stderr);
    assert!(
        folder.path().join("mine.bak").is_symlink()
            && !folder.path().join("mine").is_symlink()
            && names(&theirs).is_empty()
    );
}

#[cfg(feature = "node")]
fn record_overwrites_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    fs::write(bag.join("notes.txt"), "mine").unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    symlink(folder.path().join("nowhere"), folder.path().join("dangling")).unwrap();
    for name in ["bag", "empty", "dangling"] {
        let mut command = artitwin();
        command.arg("record").arg(folder.path().join(name)).env("ROS_DOMAIN_ID", "88");
        refused(&mut command, folder.path(), &["is there already; give another folder or move it away"]);
    }
}

fn a_diagnosis_by_frames_and_motion_is_one_result() {
    let folder = tempfile::tempdir().unwrap();
    let (made, out) = (folder.path().join("made"), folder.path().join("found"));
    done(&mut synth(&made, &["--family", "clamshell", "--parts", "2", "--states", "3"]));
    let (_, runs) = doors::write(&folder, 2, 4.0);
    let urdf = made.join("truth/twin.urdf");
    let text = fs::read_to_string(&urdf).unwrap();
    let (start, _) = text.match_indices("<joint name=\"").next().unwrap();
    let name = text[start + 13..].split('"').next().unwrap();
    fs::write(&urdf, text.replace(&format!("\"{name}\""), "\"left_hinge\"")).unwrap();
    let mut command = artitwin();
    command
        .arg("diagnose")
        .arg(&urdf)
        .args(&runs)
        .arg("--frames")
        .arg(made.join("state2"))
        .arg("--out")
        .arg(&out);
    done(&mut command);
    assert_eq!(names(&out), ["manifest.json", "motion", "report.html", "report.json", "twin.urdf"]);
    assert_eq!(
        names(&out.join("motion")),
        ["effects.json", "replay.json", "report.html", "report.json", "twin.urdf", "twin.xml"]
    );
    // It replaces what it wrote; not what it reads, the recording of the frames among it.
    done(&mut command);
    assert_eq!(names(folder.path()).iter().filter(|n| n.starts_with(['.', 'f'])).count(), 1);
    let mut command = artitwin();
    command.arg("diagnose").arg(&urdf).arg("--frames").arg(made.join("state2")).arg("--force");
    refused(command.arg("--out").arg(made.join("state2")), folder.path(), &["is or holds the input"]);
}

/// Runs a command with standard output on a device that is full.
fn on_a_full_device(command: &mut Command) -> (i32, String) {
    let full = File::options().write(true).open("/dev/full").unwrap();
    let output = command.stdout(full).stderr(Stdio::piped()).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[cfg(target_os = "linux")]
fn a_full_standard_output_is_a_failure_of_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let drawer = shipped("drawer").display().to_string();
    let truth = tempfile::tempdir().unwrap();
    let twin = twin(&truth).display().to_string();
    let mut commands: Vec<Command> = [
        &["--help"][..],
        &["--version"],
        &["doctor"],
        &["config", "show"],
        &["config", "show", "--origin"],
        &["inspect", &drawer],
        &["check", &twin],
        &["evaluate", &twin, "--truth", &drawer],
        &["evaluate", &twin, "--truth", &drawer, "--json"],
    ]
    .into_iter()
    .map(|arguments| {
        let mut command = artitwin();
        command.args(arguments);
        command
    })
    .collect();
    commands.push(synth(&folder.path().join("made"), &[]));
    commands.push(diagnose(&folder, &folder.path().join("found"), &[]));
    for command in &mut commands {
        let (code, told) = on_a_full_device(command);
        assert_eq!(code, 1, "{command:?}: {told}");
        assert!(
            told.contains("error: cannot write to standard output") && told.contains("No space left"),
            "{command:?}: {told}"
        );
    }
    // The results are there.
    assert!(
        folder.path().join("made/manifest.json").is_file()
            && folder.path().join("found/manifest.json").is_file()
    );
}

#[cfg(target_os = "linux")]
fn events_that_cannot_be_written_stop_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let (code, told) =
        on_a_full_device(&mut reconstruct(&shipped("drawer"), &folder.path().join("runs"), &["--json"]));
    assert_eq!(code, 1, "{told}");
    assert!(
        told.starts_with("error: cannot write events to standard output; the run was stopped")
            && told.contains("No space left"),
        "{told}"
    );
    assert!(!folder.path().join("runs/drawer").exists(), "the run went on to its end");
}

fn a_reader_that_went_away_is_no_error() {
    let drawer = shipped("drawer").display().to_string();
    for arguments in [&["inspect", drawer.as_str()][..], &["config", "show"], &["--help"]] {
        let mut child =
            artitwin().args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]), "{arguments:?}");
    }
}

/// A file system of so many bytes in memory, for as long as the value lives.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn new(folder: &TempDir, bytes: u64) -> Result<Self, Missing> {
        let at = folder.path().join("disk");
        fs::create_dir(&at).unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "none"])
            .arg(&at)
            .output();
        if mounted.is_ok_and(|o| o.status.success()) {
            return Ok(Self(at));
        }
        Err("a small file system cannot be mounted: run the tests as root".into())
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        Command::new("umount").arg(&self.0).status().ok();
    }
}

#[cfg(target_os = "linux")]
fn a_disk_that_is_too_full_is_refused_before_the_work() -> Result<(), Missing> {
    let folder = tempfile::tempdir().unwrap();
    let (twin, runs) = doors::write(&folder, 2, 4.0);
    let disk = SmallDisk::new(&folder, 8192)?;
    let mut diagnosis = artitwin();
    diagnosis.arg("diagnose").arg(twin).args(runs).arg("--out").arg(disk.0.join("found"));
    let bag = shipped("drawer");
    for (code, command) in [
        (1, &mut synth(&disk.0.join("made"), &[])),
        // Room may be made: the same command may succeed later.
        (75, &mut diagnosis),
        (75, &mut reconstruct(&bag, &disk.0.join("runs"), &[])),
    ] {
        refused_with(
            code,
            command,
            &disk.0,
            &["has 8192 bytes free, and ", " at least are needed; make room or give another --out"],
        );
    }
    assert!(names(&disk.0).is_empty());
    Ok(())
}

#[cfg(target_os = "linux")]
fn a_disk_that_fills_up_midway_leaves_nothing() -> Result<(), Missing> {
    let folder = tempfile::tempdir().unwrap();
    // More than the least that is asked for, less than all: 250 kB of the object, 3.7 MB of the twin.
    let disk = SmallDisk::new(&folder, 100 << 10)?;
    let ended = end(&mut synth(&disk.0.join("new/made"), &[]));
    assert!(ended.code == 1 && ended.stderr.contains("No space left"), "{}", ended.stderr);
    assert!(names(&disk.0).is_empty(), "{:?}", names(&disk.0));
    let resized = Command::new("mount").args(["-o", "remount,size=2200k"]).arg(&disk.0).status().unwrap();
    assert!(resized.success());
    let ended = end(&mut reconstruct(&shipped("drawer"), &disk.0.join("runs"), &[]));
    assert!(ended.code == 75 && ended.stderr.contains("No space left"), "{}", ended.stderr);
    // The checkpoint stays, so that the run can go on where there is room.
    let left = names(&disk.0.join("runs"));
    assert!(left.iter().all(|n| n == ".artitwin-drawer.checkpoint"), "{left:?}");
    Ok(())
}

/// The same without a mount: no file may grow beyond a size.
#[cfg(target_os = "linux")]
fn a_file_that_cannot_be_written_whole_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for kilobytes in ["8", "32", "64"] {
        let mut shell = Command::new("sh");
        shell.args([
            "-c",
            &format!("trap '' XFSZ; ulimit -f {}; exec \"$@\"", 2 * kilobytes.parse::<u32>().unwrap()),
            "sh",
        ]);
        let ended = end(shell
            .arg(env!("CARGO_BIN_EXE_artitwin"))
            .args(["synth", "--out"])
            .arg(&out)
            .args(SMALL_SYNTH));
        assert!(
            ended.code == 1 && ended.stderr.contains("File too large"),
            "{kilobytes}: {} {}",
            ended.code,
            ended.stderr
        );
        assert!(names(folder.path()).is_empty(), "{:?}", names(folder.path()));
    }
}
