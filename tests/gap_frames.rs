//! `artitwin diagnose --frames` on made objects with effects hidden in the twin, the object or the
//! recordings: every effect of frames once, and twins without errors.
//!
//! The same test makes `eval/gap/frames.md` from more cases, with the command that the page shows:
//! `GAP_FRAMES_CASES` of every row, `GAP_FRAMES_SEED` the first seed, `ARTITWIN_ACCEPT=1` writes the page.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "a test may panic")]

#[path = "gap_frames/case.rs"]
mod case;
mod common;
#[path = "gap_frames/cut.rs"]
mod cut;
#[path = "gap_frames/hidden.rs"]
mod hidden;
#[path = "gap_frames/judge.rs"]
mod judge;
#[path = "gap_frames/planted.rs"]
mod planted;
#[path = "gap_frames/reconstructed.rs"]
mod reconstructed;
#[path = "gap_frames/suite.rs"]
mod suite;

use std::{fs, path::Path, process::Command};

use suite::{Outcome, counts, remarks, run, table};

/// Cases of every row, and the first seed, where the environment says nothing.
const SMALL: [u64; 2] = [1, 700];
/// Rows of the small suite that the program gets wrong today; [`KNOWN`] says how.
const MISSED: [&str; 1] = ["second_dof (slide)"];
/// Intervals of the small suite that hold the truth, of 21; measured on 2026-11-29. The two that do not are
/// one of `axis_play` and the pitch of [`KNOWN`].
const HELD: usize = 19;
/// Names behind a first one in the small suite; measured on 2026-11-29.
const FURTHER: usize = 0;
/// Errors of the values in the small suite as shares of what is hidden; measured on 2026-11-29.
const ERRORS: [(&str, f64); 13] = [
    ("depth_scale", 0.01),
    ("depth_bias", 0.01),
    ("camera_extrinsic_offset", 0.15),
    ("camera_time_offset", 0.0),
    ("axis_offset (direction)", 0.05),
    ("axis_offset (position)", 0.06),
    ("axis_offset (frame)", 0.0),
    ("axis_play", 0.37),
    ("second_dof (turn)", 0.02),
    ("encoder_bias", 0.0),
    ("encoder_scale", 0.02),
    ("wrong_joint_type (no thread)", 0.0),
    ("wrong_joint_type (pitch)", 1.5),
];
/// An error may be this many times the measured one, and a share of what is hidden beside.
const WORSE: [f64; 2] = [1.5, 0.02];
/// What is known of cases that are not as they should be.
const KNOWN: &str = "\
`second_dof (slide)`: a door that slides along its hinge stays in its own plane, and its edges alone show it.
The size of an effect leaves out the twentieth of the patches that it moves most
(`src/gap/camera/judge/effect_size.rs`), so the program finds the effect and takes its name back. A part that
leaves its plane is named (`second_dof (turn)`).

`axis_play`: what of the play no depth shows is missing in its lengths; they come out short, with intervals
that do not know of it.

`wrong_joint_type (pitch)`: of a twin that is a screw with a wrong pitch the report says `revolute in the
twin`, and its `pitch` is what the twin's pitch lacks, not the joint's.
";
/// Least share of right first names in any other suite, but for the rows of `MISSED`.
const RIGHT: f64 = 0.9;

/// A number of the environment.
fn number(variable: &str, default: u64) -> u64 {
    std::env::var(variable).map_or(default, |v| v.parse().unwrap())
}

/// What is wrong with the small suite, held against what it showed when its figures were set.
fn complaints(outcomes: &[Outcome]) -> Vec<String> {
    let mut all = Vec::new();
    for o in outcomes {
        let case = format!("{}, {:?}, seed {}", o.row, o.hidden, o.seed);
        match (&o.wrong, MISSED.contains(&o.row)) {
            (Some(wrong), false) => all.push(format!("{case}: {wrong}")),
            (None, true) => all.push(format!("{case} is right now: take it out of MISSED")),
            _ => {}
        }
        let measured = ERRORS.iter().find(|(row, _)| *row == o.row).map(|(_, share)| *share);
        if let (Some(share), Some(measured)) = (o.error_share, measured)
            && share > WORSE[0] * measured + WORSE[1]
        {
            all.push(format!("{case}: values are off by {share:.3} of it, not {measured}"));
        }
    }
    let counts = counts(outcomes.iter());
    if counts.held < HELD {
        all.push(format!("{} of {} intervals hold the truth, not {HELD}", counts.held, counts.intervals));
    }
    if counts.further > FURTHER {
        all.push(format!("{} further names, not {FURTHER}", counts.further));
    }
    all
}

/// The page of figures.
fn page(outcomes: &[Outcome], cases: u64, seed: u64) -> String {
    let date = String::from_utf8(Command::new("date").args(["-u", "+%F"]).output().unwrap().stdout).unwrap();
    format!(
        "# `diagnose --frames` on made objects, their true twins, effects hidden\n\n\
         {}, written by\n\n\
         <!-- not run: a suite of many minutes -->\n\
         ```sh\n\
         ARTITWIN_ACCEPT=1 GAP_FRAMES_CASES={cases} GAP_FRAMES_SEED={seed} cargo test --release --test \
         gap_frames every_effect\n\
         ```\n\n\
         3 recordings of 12 views of 320x240 a case. A first name is right if the effect, its joint (or the \
         camera) and the joint's\ntrue type are, and if the held-out gap falls to a fifth or to a millimeter \
         above the noise. Error: root mean square over\nthe parameters, as a share of what was hidden. Gap: \
         root mean square on held-out frames, mm. Medians.\n`wrong_joint_type (no thread)` and `(pitch)` are \
         the effect `screw_pitch` of the code; strengths and seeds are in `tests/gap_frames/`.\n\n\
         {}\n\
         What was not as it should be:\n\n\
         | hidden | case | object | seed | the program says |\n|---|---|---|---|---|\n{}\n{KNOWN}",
        date.trim(),
        table(outcomes),
        remarks(outcomes)
    )
}

#[test]
fn every_effect_is_named_and_nothing_else() {
    let size = [number("GAP_FRAMES_CASES", SMALL[0]), number("GAP_FRAMES_SEED", SMALL[1])];
    let outcomes = run(size[0] as usize, size[1]);
    let page = page(&outcomes, size[0], size[1]);
    println!("{page}");
    for o in outcomes.iter().filter(|o| o.wrong.is_some()) {
        println!("{}, {:?}, seed {}:\n{}", o.row, o.hidden, o.seed, o.summary);
    }
    if std::env::var("ARTITWIN_ACCEPT").is_ok_and(|v| v == "1") {
        fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("eval/gap/frames.md"), page).unwrap();
    }
    if size == SMALL {
        let complaints = complaints(&outcomes);
        assert!(complaints.is_empty(), "{}", complaints.join("\n"));
        return;
    }
    let known = counts(outcomes.iter().filter(|o| !MISSED.contains(&o.row)));
    assert!(known.right as f64 >= RIGHT * known.all as f64, "{} of {} right", known.right, known.all);
}
