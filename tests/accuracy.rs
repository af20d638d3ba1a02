//! How accurate twins are: every figure of every run against `accuracy/expected.json`.
//!
//! A figure may be 1.5 times the expected one and a floor (`accuracy/table.rs`) before the test fails, with a
//! table of all figures. `ARTITWIN_ACCEPT=1 cargo test --release --test accuracy` writes the figures that got
//! better into the file; `ARTITWIN_ACCEPT=worse` writes all of them, for a change that is meant to cost
//! accuracy.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may panic")]
#![allow(clippy::print_stdout, reason = "shown where a test fails, or with --nocapture")]

#[path = "accuracy/expected.rs"]
mod expected;
#[path = "accuracy/faults.rs"]
mod faults;
#[path = "accuracy/frame.rs"]
mod frame;
#[path = "accuracy/measure.rs"]
mod measure;
#[path = "common/opened.rs"]
mod opened;
#[path = "accuracy/runs.rs"]
mod runs;
#[path = "accuracy/table.rs"]
mod table;
#[path = "accuracy/twin_files.rs"]
mod twin_files;

use std::{fmt::Write as _, io::Write as _};

use measure::measure;
use runs::{RUNS, Run, finished};
use table::{Line, Mark, Table, compare, overall, text_of};
use twin_files::TwinFiles;

/// The runs whose files get the faults: a joint that slides, and one that turns.
const PLANTED_RUNS: [&str; 2] = ["drawer", "laptop"];

/// What a finished run is measured to be; of one without a twin how it ended.
fn figures_of(run: &Run) -> Table {
    let done = finished(run);
    match &done.twin {
        Some(twin) => measure(run.name, twin, &done.truth),
        None => measure::failed(run.name, &done.outcome),
    }
}

#[test]
fn no_figure_is_worse_than_expected() {
    let mut found = Table::new();
    let mut times = String::new();
    for run in &RUNS {
        found.extend(figures_of(run));
        writeln!(times, "  {:6.1} s  {}", finished(run).seconds, run.name).unwrap();
    }
    found.extend(overall(&found));
    let accepted = expected::accept(
        &compare(&expected::read(), &found),
        std::env::var("ARTITWIN_ACCEPT").ok().as_deref(),
    );
    let lines = compare(&expected::read(), &found);
    let count = |is: fn(Mark) -> bool| lines.iter().filter(|line| is(line.mark)).count();
    let (failing, better) = (count(Mark::fails), count(|mark| mark == Mark::Better));
    // Not through the macros, whose output a test that passes swallows.
    writeln!(
        std::io::stderr(),
        "\n{accepted}{better} of {} figures are better than expected\nseconds of the runs, with making their \
         objects:\n{times}",
        lines.len()
    )
    .unwrap();
    assert_eq!(failing, 0, "of {} figures {failing} fail; all of them:\n{}", lines.len(), text_of(&lines));
    println!("{}", text_of(&lines));
}

/// A finished run whose files get faults, and what is expected of it.
struct Planted {
    run: &'static Run,
    expected: Table,
}

impl Planted {
    fn new(name: &str) -> Self {
        let run = RUNS.iter().find(|run| run.name == name).unwrap();
        let mut expected = expected::read();
        expected.retain(|key, _| key.run == name);
        // The deviations of this run alone: those of all runs need all of them.
        expected.extend(overall(&figures_of(run)));
        Self { run, expected }
    }

    /// The lines that fail for a copy of the twin with a fault in it.
    fn failing(&self, fault: &str, plant: impl FnOnce(&mut TwinFiles)) -> Vec<Line> {
        let done = finished(self.run);
        let twin = done.twin.as_ref().expect("a twin");
        let folder = twin.with_file_name(format!("planted {fault}"));
        let mut copy = TwinFiles::read(twin);
        plant(&mut copy);
        copy.write(&folder, twin);
        let mut found = measure(self.run.name, &folder, &done.truth);
        found.extend(overall(&found));
        compare(&self.expected, &found).into_iter().filter(|line| line.mark.fails()).collect()
    }

    /// A copy with a fault fails by these figures of an item.
    fn notices(&self, fault: &str, figures: &[[&str; 2]], plant: impl FnOnce(&mut TwinFiles)) {
        let failing = self.failing(fault, plant);
        println!("{}, {fault}:{}", self.run.name, text_of(&failing));
        for [item, figure] in figures {
            let named = failing.iter().any(|line| line.key.item == *item && line.key.figure == *figure);
            assert!(named, "{}, {fault}: {item} {figure} does not fail", self.run.name);
        }
    }
}

#[test]
fn planted_faults_are_noticed() {
    for name in PLANTED_RUNS {
        let planted = Planted::new(name);
        let none = planted.failing("nothing", |_| {});
        assert!(none.is_empty(), "a copy of {name} without a fault fails:{}", text_of(&none));

        let [(part, joint)] = &faults::joints(finished(planted.run))[..] else {
            panic!("{name} has one joint")
        };
        let part = part.as_str();
        let motion = if name == "drawer" { "motion_mm" } else { "motion_deg" };
        planted.notices("axis", &[[part, "axis_deg"]], |twin| faults::turn_axis(twin, joint, 0.3));
        planted.notices("motion", &[[part, motion]], |twin| faults::scale_motions(twin, 1.005));
        let lost = [["twin", "parts"], [part, "type"]];
        planted.notices("lost part", &lost, |twin| faults::lose_part(twin, joint));
        let stated = ["axis_per_std", "motion_per_std"].map(|figure| [table::ROOT_MEAN_SQUARE, figure]);
        planted.notices("small deviations", &stated, |twin| faults::scale_deviations(twin, 1.0 / 3.0));
        planted.notices("large deviations", &stated, |twin| faults::scale_deviations(twin, 3.0));
    }
}
