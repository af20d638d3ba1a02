//! The program as a process: help, messages, exit codes, streams.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

fn artitwin(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_artitwin")).args(args).output().unwrap()
}

/// Exit code, stdout, stderr.
fn run(args: &[&str]) -> (i32, String, String) {
    let output = artitwin(args);
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

/// A folder of this test alone, deleted at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("artitwin-cli-{name}-{}", std::process::id()));
        fs::remove_dir_all(&path).ok();
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, text: &str) -> String {
        let path = self.0.join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

#[test]
fn help_is_a_result_and_names_every_verb() {
    let (code, out, err) = run(&["--help"]);
    assert_eq!((code, err.as_str()), (0, ""));
    for word in
        ["reconstruct", "inspect", "evaluate", "config", "doctor", "Exit codes: 0 done", "130 stopped"]
    {
        assert!(out.contains(word), "{word} not in\n{out}");
    }
    let (code, out, _) = run(&["reconstruct", "--help"]);
    assert_eq!(code, 0);
    for option in [
        "--out",
        "--name",
        "--parts",
        "--seed",
        "--split",
        "--workspace",
        "--topic",
        "--preset",
        "--config",
        "--set",
        "--resume",
        "--json",
    ] {
        assert!(out.contains(option), "{option} not in\n{out}");
    }
    assert_eq!(run(&["--version"]).1, format!("artitwin {}\n", env!("CARGO_PKG_VERSION")));
}

#[test]
fn wrong_usage_is_told_on_stderr_with_code_2() {
    for args in [
        &["--colour"][..],
        &[],
        &["reconstruct"],
        &["reconstruct", "bag", "--out", "x", "--jobs", "0"],
        &["config", "hide"],
    ] {
        let (code, out, err) = run(args);
        assert_eq!((code, out.as_str()), (2, ""), "{args:?}");
        assert!(!err.is_empty(), "{args:?}");
    }
}

#[test]
fn a_wrong_key_is_named_with_its_place_and_the_nearest_one() {
    let folder = Folder::new("key");
    let file = folder.file("mine.yaml", "# mine\ntrain:\n  field:\n    level: 8\n");
    let (code, out, err) = run(&["config", "show", "--config", &file]);
    assert_eq!((code, out.as_str()), (2, ""));
    assert_eq!(
        err,
        format!("error: {file}:4: unknown key train.field.level; did you mean train.field.levels?\n")
    );
    let (code, _, err) =
        run(&["reconstruct", "bag", "--out", folder.0.to_str().unwrap(), "--set", "train.field.levels=many"]);
    assert_eq!(
        (code, err.as_str()),
        (2, "error: --set: train.field.levels = many: invalid type: string \"many\", expected usize\n")
    );
    let (code, _, err) = run(&["config", "show", "--preset", "papr"]);
    assert!(code == 2 && err.contains("default, fields, preview, paper"), "{err}");
    let (code, _, err) = run(&["config", "show", "--config", "/nowhere/x.yaml"]);
    assert!(code == 2 && err.contains("cannot read /nowhere/x.yaml: "), "{err}");
    let (code, _, err) = run(&["reconstruct", "bag", "--out", "x", "--parts", "1"]);
    assert!(code == 2 && err.starts_with("error: run.parts: "), "{err}");
    let (code, _, err) = run(&["reconstruct", "bag", "--out", "x", "--topic", "colour=/x"]);
    assert!(code == 2 && err.contains("capture.topics.colour; did you mean capture.topics.color?"), "{err}");
}

#[test]
fn origins_are_shown_and_later_layers_win() {
    let folder = Folder::new("origin");
    let file = folder.file("mine.yaml", "run:\n  seed: 3\ntrain: {field: {hidden: 32}}\n");
    let (code, out, err) =
        run(&["config", "show", "--origin", "--preset", "preview", "--config", &file, "--set", "run.seed=9"]);
    assert_eq!((code, err.as_str()), (0, ""));
    let line = |key: &str| {
        let line = out.lines().find(|l| l.starts_with(&format!("{key} = "))).unwrap();
        line.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(line("run.seed"), "run.seed = 9 # --set");
    assert_eq!(line("run.init"), "run.init = registration # default");
    assert_eq!(line("train.field.hidden"), format!("train.field.hidden = 32 # {file}:3"));
    let preset =
        fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/launch_configs/preview.yaml")).unwrap();
    let number = 1 + preset.lines().position(|l| l.trim_start().starts_with("levels:")).unwrap();
    assert!(
        line("train.field.levels").ends_with(&format!("# launch_configs/preview.yaml:{number}")),
        "{}",
        line("train.field.levels")
    );
}

#[test]
fn what_config_shows_can_be_given_back() {
    let folder = Folder::new("back");
    let (code, shown, _) = run(&["config", "show", "--preset", "preview", "--set", "run.parts=3"]);
    assert_eq!(code, 0);
    let file = folder.file("shown.yaml", &shown);
    assert_eq!(run(&["config", "show", "--config", &file]).1, shown);
}

#[test]
fn the_doctor_reports_the_machine_and_the_engine() {
    let (code, out, err) = run(&["doctor"]);
    assert_eq!((code, err.as_str()), (0, ""));
    for name in ["artitwin ", "processor ", "memory ", "disk ", "gpu ", "engine     cpu, "] {
        assert!(out.lines().any(|l| l.starts_with(name)), "{name} not in\n{out}");
    }
    #[cfg(not(feature = "gpu"))]
    {
        assert!(out.contains("built without the gpu feature"), "{out}");
        let gpu = ["reconstruct", "bags/drawer", "--out", "/nowhere/out", "--set", "run.engine=gpu"];
        let (code, _, err) = run(&gpu);
        assert!(code == 2 && err.contains("--features gpu"), "{code} {err}");
    }
}

#[test]
fn a_shell_and_man_get_what_they_need() {
    for shell in ["bash", "zsh", "fish"] {
        let (code, out, err) = run(&["completions", shell]);
        assert!(
            (code, err.as_str()) == (0, "") && out.contains("reconstruct") && out.contains("workspace"),
            "{out}"
        );
    }
    let (code, out, _) = run(&["man"]);
    assert!(code == 0 && out.contains(".TH artitwin 1") && out.contains("Exit codes"), "{out}");
    let (code, out, _) = run(&["man", "reconstruct"]);
    assert!(code == 0 && out.contains(".TH artitwin-reconstruct 1") && out.contains("\\-\\-parts"), "{out}");
    assert_eq!(run(&["man", "nothing"]).0, 2);
}

#[test]
fn a_gallery_takes_the_place_of_a_gallery_alone() {
    let folder = Folder::new("gallery");
    let runs = folder.0.to_str().unwrap();
    folder.file("manifest.json", "{");
    let page = folder.0.with_extension("html");
    let out = page.to_str().unwrap();
    for _ in 0..2 {
        let (code, said, err) = run(&["gallery", runs, "--out", out]);
        // Its only result is damaged.
        assert!(code == 3 && said.contains("0 results") && err.contains("manifest.json"), "{said} {err}");
    }
    std::fs::write(&page, "mine").unwrap();
    assert_eq!(run(&["gallery", runs, "--out", out]).0, 2);
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "mine");
    std::fs::remove_file(&page).unwrap();
    assert_eq!(run(&["gallery", "/nowhere"]).0, 1);
}

#[test]
fn a_missing_recording_is_an_error_that_names_it() {
    for args in [
        &["inspect", "/nowhere/bag"][..],
        &["reconstruct", "/nowhere/bag", "--out", "/nowhere/out", "--parts", "2"],
    ] {
        let (code, out, err) = run(args);
        assert_eq!((code, out.as_str()), (1, ""), "{args:?}: {err}");
        assert!(err.contains("/nowhere/bag"), "{args:?}: {err}");
    }
}

#[test]
fn a_uri_is_refused_and_the_way_named() {
    for line in [
        "reconstruct s3://lab/box --out runs",
        "reconstruct bags/drawer --out gs://lab/twins",
        "reconstruct file:///bags/drawer --out runs --estimate",
        "diagnose https://lab/box.urdf run --out found",
        "diagnose box.urdf run --held-out az://lab/run --out found",
        "diagnose box.urdf --frames s3://lab/frames --out found",
    ] {
        let (code, out, err) = run(&line.split(' ').collect::<Vec<_>>());
        assert_eq!((code, out.as_str()), (2, ""), "{line}: {err}");
        assert!(err.contains("://") && err.contains("a URI is no path: download it"), "{err}");
        assert!(err.contains("`artitwin fleet` of the Python package"), "{err}");
    }
}

#[test]
fn an_estimate_is_a_line_of_json_and_writes_nothing() {
    let folder = Folder::new("estimate");
    let out = folder.0.join("runs");
    let estimate = |options: &[&str]| -> serde_json::Value {
        let all = [&["reconstruct", "bags/drawer", "--estimate", "--out", out.to_str().unwrap()], options];
        let (code, said, err) = run(&all.concat());
        assert_eq!((code, said.lines().count()), (0, 1), "{err}");
        serde_json::from_str(&said).unwrap()
    };
    let plain = estimate(&[]);
    assert_eq!((&plain["format"], &plain["name"]), (&"artitwin-estimate/2".into(), &"drawer".into()));
    assert!(
        plain["memory_bytes"].as_u64() > Some(500 << 20) && plain["seconds"].as_f64() > Some(10.0),
        "{plain}"
    );
    // The preset `default` by its name is the same; places and names do not count.
    let same = estimate(&["--preset", "default", "--name", "other", "-v", "--json"]);
    assert_eq!((&same["settings"], &same["name"]), (&plain["settings"], &"other".into()));
    let other = estimate(&["--preset", "preview"]);
    assert!(
        other["settings"] != plain["settings"]
            && other["memory_bytes"].as_u64() < plain["memory_bytes"].as_u64()
    );
    assert!(!out.exists());
    let (code, _, err) = run(&["reconstruct", "bags/gone", "--estimate", "--out", "runs"]);
    assert!(code == 1 && err.contains("bags/gone"), "{err}");
}

#[cfg(unix)]
#[test]
fn a_command_of_another_package_is_run_and_an_unknown_one_refused() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = Folder::new("external");
    let path = folder.file("artitwin-hello", "#!/bin/sh\necho \"hello $1 from $ARTITWIN\"\nexit 7\n");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    let run = |verb: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
        let path = format!("{}:{}", folder.0.display(), std::env::var("PATH").unwrap());
        command.args([verb, "--you"]).env("PATH", path).output().unwrap()
    };
    let hello = run("hello");
    assert_eq!((hello.status.code(), hello.stdout.starts_with(b"hello --you from /")), (Some(7), true));
    let unknown = run("recontruct");
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("reconstruct"), "{unknown:?}");
}

#[test]
fn a_urdf_and_the_folder_that_it_stands_in_are_the_same_model() {
    let folder = Folder::new("model");
    let urdf = folder.file("box.urdf", "<robot name='r'><link name='a'/></robot>");
    let text = folder.file("box.txt", "");
    let [dir, out] = [folder.0.clone(), folder.0.join("out")].map(|p| p.to_str().unwrap().to_owned());
    for model in [&urdf, &dir] {
        assert_eq!(run(&["check", model]), (0, "0 errors, 0 warnings\n".to_owned(), String::new()));
    }
    let (code, _, err) = run(&["check", &text]);
    assert!(code == 1 && err.contains("box.txt is neither a folder nor a .urdf file"), "{err}");
    let bag = concat!(env!("CARGO_MANIFEST_DIR"), "/bags/drawer/state0");
    let [by_file, by_folder] = [&urdf, &dir].map(|twin| run(&["diagnose", twin, bag, "--out", &out]));
    assert_eq!(by_file, by_folder);
    folder.file("lid.urdf", "");
    let (code, _, err) = run(&["diagnose", &dir, bag, "--out", &out]);
    assert!(code == 1 && err.contains("the folder holds 2 .urdf files; name one"), "{err}");
}

#[test]
fn json_leaves_nothing_but_events_on_stdout() {
    let folder = Folder::new("json");
    let (code, out, err) =
        run(&["reconstruct", "/nowhere/bag", "--out", folder.0.to_str().unwrap(), "--parts", "2", "--json"]);
    assert!(code == 1 && err.starts_with("error: "), "{err}");
    let known = ["stage_started", "step", "stage_finished", "warning", "note", "artifact", "error"];
    for line in out.lines() {
        let event: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(known.contains(&event["event"].as_str().unwrap()), "{line}");
    }
}

#[test]
fn a_recording_without_poses_and_masks_is_tracked_and_shown() {
    let folder = Folder::new("look");
    let path = |name: &str| folder.0.join(name).to_str().unwrap().to_owned();
    let (made, picture) = (path("made"), path("look.png"));
    let size =
        ["--views", "14", "--width", "320", "--height", "240", "--textured", "--sensor", "handheld:0.5"];
    let synth = [&["synth", "--out", &made, "--seed", "3303", "--family", "clamshell"], &size[..]].concat();
    assert_eq!(run(&synth).0, 0);
    let (code, out, err) = run(&["track", &made]);
    assert!(code == 0 || code == 3, "{err}");
    assert_eq!(out.lines().filter(|l| l.starts_with("# state")).count(), 2, "{out}");
    assert!(out.lines().filter(|l| !l.starts_with('#')).count() >= 20, "most views are tracked: {err}");
    let look = ["inspect", &made, "--picture", &picture, "--set", "capture.tracking=always"];
    let (code, out, err) = run(&look);
    assert!(code == 0 || code == 3, "{out}{err}");
    for told in
        ["by what changed", "camera poses were tracked", "state 1: ", "views of the object", "picture: "]
    {
        assert!(out.contains(told), "{told} not in\n{out}");
    }
    let bytes = fs::read(&picture).unwrap();
    assert!(bytes.starts_with(b"\x89PNG"));
    // What is there stays.
    let (code, _, err) = run(&look);
    assert!(code == 1 && err.contains("give a name that is not taken"), "{code} {err}");
    assert_eq!(fs::read(&picture).unwrap(), bytes);
    // Somebody may mean something else, in numbers that make sense.
    let (code, out, err) = run(&["inspect", &made, "--picture", &path("other.png"), "--at", "0_9999,3,4"]);
    assert!(code != 0 && format!("{out}{err}").contains("no frame `0_9999` was kept"), "{code} {out} {err}");
    let (code, _, err) = run(&["inspect", &made, "--at", "1,2"]);
    assert!(code == 2 && err.contains("three numbers"), "{code} {err}");
}
