//! The progress of a run: a bar on a terminal, lines elsewhere, JSON lines on request.

use std::{
    io::{self, IsTerminal as _, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use indicatif::{ProgressBar, ProgressStyle};

use ::io::printable;
use export::counted_noun;
use run::{Event, RunProgress};

/// How long to wait for an event before looking whether the run has ended.
const PATIENCE: Duration = Duration::from_millis(50);
/// Plain lines about steps come no more often.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// How events are shown.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shown {
    /// As JSON.
    pub json: bool,
    /// With notes.
    pub verbose: bool,
}

/// A thread to show events until [`Self::finish`].
pub(super) struct Progress {
    done: Arc<AtomicBool>,
    thread: JoinHandle<io::Result<()>>,
}

impl Progress {
    /// Starts listening: JSON to stdout, else a bar or lines to stderr. A failure to write
    /// JSON sets `stop`: such a run serves its events, and ends at its next step.
    pub(super) fn start(shown: Shown, stop: Arc<AtomicBool>) -> (Self, Sender<Event>) {
        let (sender, receiver) = mpsc::channel();
        let done = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&done);
        let thread = thread::spawn(move || {
            if shown.json {
                let mut lines = JsonLines { out: io::stdout(), outcome: Ok(()), stop };
                listen_to_end(&receiver, &ended, &mut lines);
                return lines.outcome;
            }
            let kept = Kept { verbose: shown.verbose, ..Kept::default() };
            // A bar for people; a log cannot be redrawn and gets lines.
            if io::stderr().is_terminal() {
                listen_to_end(&receiver, &ended, &mut Bar::new(kept));
            } else {
                listen_to_end(&receiver, &ended, &mut Lines::new(io::stderr(), kept));
            }
            Ok(())
        });
        (Self { done, thread }, sender)
    }

    /// Shows the events sent so far and ends, though senders may be left.
    ///
    /// # Errors
    /// If JSON could not be written though its reader is there.
    pub(super) fn finish(self) -> io::Result<()> {
        self.done.store(true, Ordering::Release);
        // A panic of the listener was printed by itself and must not hide the run's own outcome.
        self.thread.join().unwrap_or(Ok(()))
    }
}

/// Shows events; `at` is the time since the run began.
trait Listener {
    fn report(&mut self, event: &Event, at: Duration);

    /// Nothing was reported for a while.
    fn wait(&mut self, _at: Duration) {}

    /// Shows the lines kept for the end.
    fn end(&mut self) {}
}

fn listen_to_end(events: &Receiver<Event>, ended: &AtomicBool, listener: &mut dyn Listener) {
    let start = Instant::now();
    loop {
        match events.recv_timeout(PATIENCE) {
            Ok(event) => listener.report(&event, start.elapsed()),
            // Senders outlive the run (the handler of Ctrl-C keeps one), so its end is a flag.
            Err(RecvTimeoutError::Timeout) if !ended.load(Ordering::Acquire) => {
                listener.wait(start.elapsed())
            }
            Err(_) => return listener.end(),
        }
    }
}

/// One JSON object a line.
struct JsonLines<W> {
    out: W,
    /// The error of the first unwritten line.
    outcome: io::Result<()>,
    stop: Arc<AtomicBool>,
}

impl<W: Write> Listener for JsonLines<W> {
    fn report(&mut self, event: &Event, _: Duration) {
        if self.outcome.is_err() {
            return;
        }
        let written = serde_json::to_string(event).map_err(io::Error::from);
        // Each line at once, for readers of a pipe.
        let written = written.and_then(|line| writeln!(self.out, "{line}").and_then(|()| self.out.flush()));
        // Once the reader went away nobody is left to report to; the run goes on.
        if let Err(error) =
            written.or_else(|e| if e.kind() == io::ErrorKind::BrokenPipe { Ok(()) } else { Err(e) })
        {
            self.stop.store(true, Ordering::Relaxed);
            self.outcome = Err(error);
        }
    }
}

/// Messages kept for the end, to be read there.
#[derive(Default)]
struct Kept {
    /// Whether notes are shown as they come.
    verbose: bool,
    notes: usize,
    warnings: Vec<String>,
}

impl Kept {
    /// A line to show at once.
    fn line_now(&mut self, event: &Event) -> Option<String> {
        match event {
            Event::Warning { message, .. } => {
                // Several objects may say the same.
                if !self.warnings.contains(message) {
                    self.warnings.push(message.clone());
                }
                None
            }
            Event::Note { code, message } if code.is_of_run() => Some(message.clone()),
            Event::Note { message, .. } => {
                self.notes += 1;
                self.verbose.then(|| message.clone())
            }
            Event::Failed { message } => Some(format!("failed: {message}")),
            Event::Artifact { path } => Some(format!("wrote {path}")),
            // The program says last why it fails.
            _ => None,
        }
    }

    /// Lines to show at the end.
    fn at_the_end(&mut self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.notes > 0 && !self.verbose {
            lines.push(format!("{} not shown: -v shows them", counted_noun(self.notes, "note")));
        }
        lines.extend(self.warnings.drain(..).map(|w| format!("warning: {w}")));
        lines
    }
}

/// Plain lines.
struct Lines<W> {
    out: W,
    kept: Kept,
    progress: RunProgress,
    /// When a step was last shown.
    shown: Duration,
}

impl<W> Lines<W> {
    fn new(out: W, kept: Kept) -> Self {
        Self { out, kept, progress: RunProgress::default(), shown: Duration::ZERO }
    }

    /// The time left of the planned work, as text; empty without an estimate.
    fn time_left_text(&self, at: Duration) -> String {
        self.progress.at(at).map(|(_, time)| left_text(time)).unwrap_or_default()
    }
}

impl<W: Write> Listener for Lines<W> {
    fn report(&mut self, event: &Event, at: Duration) {
        self.progress.take(event, at);
        let line = match event {
            Event::StageStarted { stage, steps } => match steps {
                Some(steps) => format!("{stage}: {steps} steps"),
                None => format!("{stage}: started"),
            },
            Event::Step { stage, done, total, .. } | Event::Count { stage, done, total } => {
                // A stage of a thousand steps would fill the log.
                if at < self.shown + LINE_INTERVAL {
                    return;
                }
                self.shown = at;
                let loss = self.progress.loss().map(|loss| format!(", loss {loss:.4e}")).unwrap_or_default();
                format!("{stage}: {done} of {total}{loss}{}", self.time_left_text(at))
            }
            Event::StageFinished { stage, seconds } => {
                format!("{stage}: done in {seconds:.1} s{}", self.time_left_text(at))
            }
            other => match self.kept.line_now(other) {
                Some(line) => line,
                None => return,
            },
        };
        writeln!(self.out, "{}", printable(&line)).ok();
    }

    fn end(&mut self) {
        for line in self.kept.at_the_end() {
            writeln!(self.out, "{}", printable(&line)).ok();
        }
    }
}

/// One bar over all stages.
struct Bar {
    bar: ProgressBar,
    kept: Kept,
    progress: RunProgress,
}

impl Bar {
    fn new(kept: Kept) -> Self {
        Self {
            bar: ProgressBar::new(SHARES).with_style(bar_style(SPINNER)),
            kept,
            progress: RunProgress::default(),
        }
    }

    /// Writes a line above the bar.
    fn write_line(&self, text: &str) {
        self.bar.suspend(|| writeln!(io::stderr(), "{}", printable(text)).ok());
    }

    /// Draws the bar as it stands after a time.
    fn draw_at(&self, at: Duration) {
        // Nothing runs: a bar would stand beside the line with the result.
        let Some((stage, others)) = self.progress.stage() else { return };
        let more = if others == 0 { String::new() } else { format!(" and {others} more") };
        let doing = format!("{}{more}", printable(stage));
        match self.progress.at(at) {
            Some((share, time)) => {
                self.bar.set_position((share * SHARES as f64) as u64);
                self.bar.set_message(format!("{doing}{}", left_text(time)));
            }
            None => self.bar.set_message(format!("{doing}, {} s", at.as_secs())),
        }
        self.bar.tick();
    }
}

impl Listener for Bar {
    fn report(&mut self, event: &Event, at: Duration) {
        self.progress.take(event, at);
        if matches!(event, Event::Planned { .. }) {
            self.bar.set_style(bar_style(BAR));
        }
        self.kept.line_now(event).iter().for_each(|line| self.write_line(line));
        self.draw_at(at);
    }

    fn wait(&mut self, at: Duration) {
        self.draw_at(at);
    }

    fn end(&mut self) {
        self.bar.finish_and_clear();
        self.kept.at_the_end().iter().for_each(|line| self.write_line(line));
    }
}

/// Parts of the bar.
const SHARES: u64 = 1000;
const BAR: &str = "{bar:32} {percent:>3} %  {msg}";
const SPINNER: &str = "{spinner} {msg}";

fn bar_style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// `, 1 min 20 s left`.
fn left_text(time: Duration) -> String {
    let seconds = time.as_secs_f64().round() as u64;
    match seconds {
        0..60 => format!(", {seconds} s left"),
        60..3600 => format!(", {} min {} s left", seconds / 60, seconds % 60),
        _ => format!(", {} h {} min left", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::note::NoteCode;
    use run::Planned;

    fn events() -> Vec<(u64, Event)> {
        let stage = || "field/state0".to_owned();
        let step = |done, loss| Event::Step { stage: stage(), done, total: 100, loss };
        let planned = |stage: &str, weight| Planned { stage: stage.to_owned(), weight };
        vec![
            (0, Event::Planned { stages: vec![planned(&stage(), 90.0), planned("export", 10.0)] }),
            (0, Event::StageStarted { stage: stage(), steps: Some(100) }),
            (1, step(1, 0.5)),
            (10, step(10, 0.25)),
            (11, step(11, 0.2)),
            (20, step(20, f64::NAN)),
            (99, Event::StageFinished { stage: stage(), seconds: 99.0 }),
            (
                99,
                Event::Warning {
                    code: NoteCode::RecordingDamaged,
                    message: "topic \u{1b}[2J lost".to_owned(),
                },
            ),
            (99, Event::Note { code: NoteCode::Stopping, message: "stopping".to_owned() }),
            (99, Event::Note { code: NoteCode::ViewsKept, message: "16 of 16 views".to_owned() }),
            (99, Event::Artifact { path: "runs/box/box.urdf".to_owned() }),
            (99, Event::StageStarted { stage: "export".to_owned(), steps: None }),
        ]
    }

    fn shown(listener: &mut dyn Listener) {
        events().iter().for_each(|(seconds, event)| listener.report(event, Duration::from_secs(*seconds)));
    }

    fn lines(verbose: bool) -> String {
        let mut lines = Lines::new(Vec::new(), Kept { verbose, ..Kept::default() });
        shown(&mut lines);
        lines.end();
        String::from_utf8(lines.out).unwrap()
    }

    #[test]
    fn lines_are_few_and_say_the_time_left_of_the_whole() {
        // After 10 s 9 of 100 are done, and 10 count as foreseen, at 4 a second.
        let expected = "field/state0: 100 steps\n\
                        field/state0: 10 of 100, loss 2.5000e-1, 1 min 0 s left\n\
                        field/state0: 20 of 100, loss NaN, 1 min 6 s left\n\
                        field/state0: done in 99.0 s, 10 s left\n\
                        stopping\n\
                        wrote runs/box/box.urdf\n\
                        export: started\n\
                        1 note not shown: -v shows them\n\
                        warning: topic \u{fffd}[2J lost\n";
        assert_eq!(lines(false), expected);
    }

    #[test]
    fn notes_are_shown_on_request() {
        let shown = lines(true);
        assert!(shown.contains("stopping\n16 of 16 views\n") && !shown.contains("-v"), "{shown}");
    }

    #[test]
    fn a_warning_is_shown_once() {
        let mut kept = Kept::default();
        for message in ["b", "a", "b"] {
            let event = Event::Warning { code: NoteCode::RecordingDamaged, message: message.to_owned() };
            assert_eq!(kept.line_now(&event), None);
        }
        assert_eq!(kept.at_the_end(), ["warning: b", "warning: a"]);
    }

    fn json<W>(out: W) -> JsonLines<W> {
        JsonLines { out, outcome: Ok(()), stop: Arc::default() }
    }

    /// Takes nothing.
    struct Refuses(io::ErrorKind);

    impl Write for Refuses {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn json_that_cannot_be_written_stops_the_run_but_for_a_reader_that_went_away() {
        for (kind, stops) in [(io::ErrorKind::StorageFull, true), (io::ErrorKind::BrokenPipe, false)] {
            let mut json = json(Refuses(kind));
            shown(&mut json);
            assert_eq!((json.outcome.is_err(), json.stop.load(Ordering::Relaxed)), (stops, stops), "{kind}");
        }
    }

    #[test]
    fn json_is_one_object_a_line_with_a_tag() {
        let mut json = json(Vec::new());
        shown(&mut json);
        assert!(json.outcome.is_ok() && !json.stop.load(Ordering::Relaxed));
        let text = String::from_utf8(json.out).unwrap();
        let parsed: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(parsed.len(), events().len());
        assert_eq!(parsed[0]["stages"][1], serde_json::json!({"stage": "export", "weight": 10.0}));
        assert_eq!(
            parsed[1],
            serde_json::json!({"event": "stage_started", "stage": "field/state0", "steps": 100})
        );
        let stage = "field/state0";
        assert_eq!(
            parsed[2],
            serde_json::json!({"event": "step", "stage": stage, "done": 1, "total": 100, "loss": 0.5})
        );
        assert_eq!(parsed[5]["loss"], serde_json::Value::Null);
        let warning = "topic \u{1b}[2J lost";
        assert_eq!(
            parsed[7],
            serde_json::json!({"event": "warning", "code": "recording_damaged", "message": warning})
        );
        assert_eq!(parsed[10], serde_json::json!({"event": "artifact", "path": "runs/box/box.urdf"}));
    }

    #[test]
    fn the_bar_follows_all_stages() {
        let mut bar = Bar::new(Kept::default());
        bar.bar.set_draw_target(indicatif::ProgressDrawTarget::hidden());
        shown(&mut bar);
        assert_eq!((bar.bar.position(), bar.bar.message().as_str()), (900, "export, 10 s left"));
    }

    #[test]
    fn the_listener_ends_though_a_sender_is_left() {
        let (progress, sender) = Progress::start(Shown::default(), Arc::default());
        progress.finish().unwrap();
        sender.send(Event::Note { code: NoteCode::Stopping, message: String::new() }).ok();
    }
}
