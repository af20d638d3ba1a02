//! Settings and arguments: `--config`, `--set`, arguments and parameter files of ROS 2.

use config::{Config, Layers};

use super::engine::{BYTES, Scratch, Target, plain, whole};

const YAML: [&str; 14] =
    ["{", "[", "- ", "&a ", "*a", "<<: *a", "!!int ", "!x ", "? ", "|\n", ">\n", "\"", "---\n", "~"];

/// A file of `--config` on the defaults.
#[test]
fn config() {
    let base = Layers::new(&Config::default()).unwrap();
    let preview = include_str!("../../launch_configs/preview.yaml");
    let paper = include_str!("../../launch_configs/paper.yaml");
    let some =
        "capture:\n  frames_per_state: 20\n  topics: {color: /rgb}\nrun:\n  seed: 3\nsurface:\n  nodes: 64\n";
    let target = Target {
        name: "settings::config",
        seeds: whole([preview, paper, some]),
        words: &YAML,
        assemble: plain,
        bytes: BYTES,
    };
    target.run(|input| {
        let Ok(text) = std::str::from_utf8(input) else { return false };
        let mut layers = base.clone();
        if layers.add_text("fuzz.yaml", text).is_err() {
            return false;
        }
        let Ok(resolved) = layers.resolve::<Config>() else { return false };
        if resolved.config.check().is_ok() {
            // What a run keeps of its settings gives the same settings.
            let (kept, mut again) = (resolved.to_yaml().unwrap(), base.clone());
            again.add_text("kept.yaml", &kept).unwrap();
            assert_eq!(again.resolve::<Config>().unwrap().to_yaml().unwrap(), kept);
        }
        let _ = resolved.to_lines_with_origins();
        true
    });
}

/// Assignments of `--set`.
#[test]
fn assignments() {
    let base = Layers::new(&Config::default()).unwrap();
    let seeds = whole([
        "surface.nodes=64",
        "run.seed=7",
        "capture.topics.color=/camera/color",
        "capture.split_secs=[1.5, 2.5]",
        "capture={frames_per_state: 3}",
    ]);
    let target = Target { name: "settings::assignments", seeds, words: &YAML, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let mut layers = base.clone();
        let set = std::str::from_utf8(input).is_ok_and(|text| layers.add_setting(text).is_ok());
        if set && let Ok(resolved) = layers.resolve::<Config>() {
            let _ = resolved.config.check();
            return true;
        }
        false
    });
}

/// Arguments of `artitwin node`, one a piece.
#[cfg(feature = "node")]
#[test]
fn ros_arguments() {
    let line = |text: &str| text.split(' ').map(|word| word.as_bytes().to_vec()).collect::<Vec<_>>();
    let seeds = vec![
        line("--ros-args -r __node:=twin -r __ns:=/lab -p parts:=2 --log-level info"),
        line(
            "--ros-args -r color:=/rgb -r twin:color:=/x -p settings:=[surface.nodes=64] -p still_secs:=2.5 \
             --",
        ),
        line(
            "--ros-args -p preset:=preview -r rostopic://a/b:=c -e / --disable-rosout-logs -p \
             twin:session:=abc",
        ),
    ];
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        parts.join(&0)
    }
    let words = [
        &YAML[..],
        &[
            "--ros-args",
            "--",
            "-r",
            "-p",
            ":=",
            "__node",
            "__ns",
            "~/",
            "/",
            "parts",
            "settings",
            "..",
            "{a}",
        ],
    ]
    .concat();
    let target = Target { name: "settings::ros_arguments", seeds, words: &words, assemble, bytes: BYTES };
    target.run(|input| {
        let arguments: Vec<String> =
            input.split(|b| *b == 0).map(|word| String::from_utf8_lossy(word).into_owned()).collect();
        // A file that the input names is not part of it.
        let names_file = arguments.iter().any(|a| a.contains("file"));
        !names_file && node::check_arguments(&arguments).is_ok()
    });
}

/// A parameter file of ROS 2.
#[cfg(feature = "node")]
#[test]
fn parameter_file() {
    let name = "settings::parameter_file";
    let scratch = Scratch::new(name);
    let shipped = include_str!("../../launch_configs/ros/node.yaml");
    let short = "/**:\n  ros__parameters:\n    parts: 2\n\
                 /lab/*/artitwin: {ros__parameters: {still_secs: 2, a: {b: c}}}\n";
    let words = [
        &YAML[..],
        &["ros__parameters", "/**", "/*", "artitwin", "**/", "settings", "config_file", "qos_overrides"],
    ]
    .concat();
    let target =
        Target { name, seeds: whole([shipped, short]), words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let file = scratch.put("parameters.yaml", input);
        let arguments = ["--ros-args", "--params-file", file.to_str().unwrap()].map(str::to_owned);
        node::check_arguments(&arguments).is_ok()
    });
}
