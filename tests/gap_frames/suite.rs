//! The suite: its rows and cases, how they are run side by side, and the table that they make.

use std::{
    fmt::Write as _,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Instant,
};

use crate::{
    case::diagnose,
    hidden::{Hidden, PART},
    judge::{expected, gap_m, judge},
};

/// Seeds of a row begin this far behind those of the row before: every row has objects of its own.
const ROW_SEEDS: u64 = 10;

/// Cases of a kind.
pub struct Row {
    /// What is hidden.
    pub name: &'static str,
    /// In which strengths: one in the middle first, then the weakest.
    pub strengths: [Hidden; 5],
    /// Cases where other rows have one.
    pub times: usize,
}

/// The rows.
pub fn rows() -> Vec<Row> {
    let row = |name, strengths| Row { name, strengths, times: 1 };
    vec![
        row("depth_scale", [-0.02, 0.01, 0.015, 0.025, 0.03].map(Hidden::DepthScale)),
        row("depth_bias", [-0.006, 0.003, 0.005, 0.008, 0.01].map(Hidden::DepthBias)),
        row("camera_extrinsic_offset", [0.01, 0.005, 0.008, 0.015, 0.02].map(Hidden::Extrinsic)),
        row("camera_time_offset", [0.02, 0.01, -0.015, 0.025, -0.03].map(Hidden::Delay)),
        row("axis_offset (direction)", [0.035, 0.02, 0.03, 0.045, 0.05].map(Hidden::AxisTurn)),
        row("axis_offset (position)", [0.012, 0.008, 0.01, 0.015, 0.02].map(Hidden::AxisShift)),
        row("axis_offset (frame)", [0.012, 0.006, 0.008, 0.015, 0.02].map(Hidden::FrameShift)),
        row("axis_play", [0.02, 0.01, 0.015, 0.025, 0.03].map(Hidden::Play)),
        row("second_dof (slide)", [0.08, 0.04, 0.06, 0.1, 0.15].map(Hidden::SecondSlide)),
        row("second_dof (turn)", [0.06, 0.03, 0.04, 0.08, 0.1].map(Hidden::SecondTurn)),
        row("encoder_bias", [0.04, -0.02, 0.03, -0.05, 0.06].map(Hidden::EncoderBias)),
        row("encoder_scale", [-0.05, 0.03, -0.04, 0.06, 0.08].map(Hidden::EncoderScale)),
        row("wrong_joint_type", [Hidden::OtherType; 5]),
        row("wrong_joint_type (no thread)", [Hidden::NoThread; 5]),
        row("wrong_joint_type (pitch)", [0.5, -0.3, 0.4, -0.6, 0.8].map(Hidden::Pitch)),
        row("missing_geometry", [0, 1, 0, 1, 1].map(Hidden::Cut)),
        Row { times: 3, ..row("nothing", [Hidden::Nothing; 5]) },
        row("nothing, positions recorded", [Hidden::NothingWithPositions; 5]),
    ]
}

/// A case as it came out.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Name of its row.
    pub row: &'static str,
    /// What was hidden.
    pub hidden: Hidden,
    /// The object and how its joint moves.
    pub object: String,
    /// Its seed.
    pub seed: u64,
    /// What is wrong with the first name, if anything.
    pub wrong: Option<String>,
    /// Intervals that hold the truth, of how many.
    pub held: [usize; 2],
    /// Error of the values as a share of what was hidden.
    pub error_share: Option<f64>,
    /// Names behind the first.
    pub further: Vec<String>,
    /// Gap before and after, and what the noise makes, millimeters.
    pub gap_mm: [f64; 3],
    /// What the program printed.
    pub summary: String,
}

fn outcome(row: &'static str, hidden: Hidden, seed: u64) -> Outcome {
    let case = diagnose(hidden, seed);
    let expected = expected(hidden, &case.object, &case.states, case.seed);
    let judged = judge(&case.report, expected.as_ref());
    let kind = case.object.parts[PART].joint.unwrap().kind.name();
    Outcome {
        row,
        hidden,
        object: format!("{}, {kind}", case.object.family),
        seed,
        wrong: judged.wrong,
        held: judged.held,
        error_share: judged.error_share,
        further: judged.further,
        gap_mm: gap_m(&case.report).map(|m| 1e3 * m),
        summary: case.summary,
    }
}

/// Runs so many cases of every row, as many at a time as there are processors; in the order of the rows.
pub fn run(cases: usize, seed: u64) -> Vec<Outcome> {
    let mut all = Vec::new();
    for (r, row) in rows().iter().enumerate() {
        for k in 0..cases * row.times {
            all.push((row.name, row.strengths[k % 5], seed + ROW_SEEDS * r as u64 + k as u64));
        }
    }
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some((row, hidden, seed)) = all.get(i) else { return };
            let start = Instant::now();
            let outcome = outcome(row, *hidden, *seed);
            let told = outcome.wrong.as_deref().unwrap_or("right");
            let seconds = start.elapsed().as_secs_f64();
            println!("{row}, {hidden:?}, {}, seed {seed}: {told} ({seconds:.0} s)", outcome.object);
            done.lock().unwrap().push((i, outcome));
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    let mut done = done.into_inner().unwrap();
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, outcome)| outcome).collect()
}

/// Counts over cases.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Cases.
    pub all: usize,
    /// Of them with the right first name.
    pub right: usize,
    /// Parameters of right first names.
    pub intervals: usize,
    /// Of them with an interval that holds the truth.
    pub held: usize,
    /// Names behind the first.
    pub further: usize,
}

/// Counts of some cases.
pub fn counts<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> Counts {
    let mut counts = Counts::default();
    for outcome in outcomes {
        counts.all += 1;
        counts.right += usize::from(outcome.wrong.is_none());
        counts.held += outcome.held[0];
        counts.intervals += outcome.held[1];
        counts.further += outcome.further.len();
    }
    counts
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The table of a suite.
pub fn table(outcomes: &[Outcome]) -> String {
    let mut table = "| hidden | cases | first name right | error of its values | intervals that hold the \
                     truth | further names | gap before | after | noise |\n\
                     |---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    let held = |c: &Counts| match c.intervals {
        0 => "-".to_owned(),
        n => format!("{} of {n}", c.held),
    };
    for row in rows() {
        let own: Vec<&Outcome> = outcomes.iter().filter(|o| o.row == row.name).collect();
        let counts = counts(own.iter().copied());
        let error = median(own.iter().filter_map(|o| o.error_share).collect());
        let error = error.map_or("-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
        let gap = [0, 1, 2].map(|k| median(own.iter().map(|o| o.gap_mm[k]).collect()).unwrap_or(f64::NAN));
        writeln!(
            table,
            "| {} | {} | {} | {error} | {} | {} | {:.2} | {:.2} | {:.2} |",
            row.name,
            counts.all,
            counts.right,
            held(&counts),
            counts.further,
            gap[0],
            gap[1],
            gap[2]
        )
        .unwrap();
    }
    let all = counts(outcomes.iter());
    writeln!(table, "| all | {} | {} | | {} | {} | | | |", all.all, all.right, held(&all), all.further)
        .unwrap();
    table
}

/// The cases that are not right, or not right alone, a line each.
pub fn remarks(outcomes: &[Outcome]) -> String {
    let mut lines = String::new();
    for o in outcomes {
        let mut remarks: Vec<String> = o.wrong.iter().cloned().collect();
        if o.held[0] < o.held[1] {
            remarks.push(format!("{} of {} intervals hold the truth", o.held[0], o.held[1]));
        }
        if !o.further.is_empty() {
            remarks.push(format!("then {}", o.further.join(", ")));
        }
        if !remarks.is_empty() {
            let case = format!("{} | {:?} | {} | {}", o.row, o.hidden, o.object, o.seed);
            writeln!(lines, "| {case} | {} |", remarks.join("; ")).unwrap();
        }
    }
    lines
}
