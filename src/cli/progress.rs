//! What a run reports, shown while it runs: bars on a terminal, plain lines elsewhere, JSON lines on request.

use std::{
    collections::BTreeMap,
    io::{self, IsTerminal as _, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::{io::printable, run::Event};

/// How long to wait for an event before looking whether the run has ended.
const PATIENCE: Duration = Duration::from_millis(50);
/// Plain lines about steps come no more often.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// A thread that shows events until [`Self::finish`].
pub struct Progress {
    done: Arc<AtomicBool>,
    thread: JoinHandle<io::Result<()>>,
}

impl Progress {
    /// Starts listening: `json` to stdout, else bars or lines to stderr. JSON that cannot be written sets
    /// `stop`: events are what such a run is for, and it ends at its next step.
    pub fn start(json: bool, stop: Arc<AtomicBool>) -> (Self, Sender<Event>) {
        let (sender, receiver) = mpsc::channel();
        let done = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&done);
        let thread = thread::spawn(move || {
            if json {
                let mut lines = JsonLines { out: io::stdout(), outcome: Ok(()), stop };
                listen(&receiver, &ended, &mut lines);
                return lines.outcome;
            }
            // Bars for people; a log cannot be redrawn and gets lines.
            if io::stderr().is_terminal() {
                listen(&receiver, &ended, &mut Bars::default());
            } else {
                listen(&receiver, &ended, &mut Lines::new(io::stderr()));
            }
            Ok(())
        });
        (Self { done, thread }, sender)
    }

    /// Shows what was sent so far and ends, though senders may be left.
    ///
    /// # Errors
    /// If JSON could not be written, for another reason than that its reader went away.
    pub fn finish(self) -> io::Result<()> {
        self.done.store(true, Ordering::Release);
        // A panic of the listener was printed by itself and must not hide the run's own outcome.
        self.thread.join().unwrap_or(Ok(()))
    }
}

/// Shows events; `at` is the time since the run began.
trait Listener {
    fn report(&mut self, event: &Event, at: Duration);

    /// Shows what was kept for the end.
    fn end(&mut self) {}
}

fn listen(events: &Receiver<Event>, ended: &AtomicBool, listener: &mut dyn Listener) {
    let start = Instant::now();
    loop {
        match events.recv_timeout(PATIENCE) {
            Ok(event) => listener.report(&event, start.elapsed()),
            // Senders outlive the run (the handler of Ctrl-C keeps one), so its end is a flag.
            Err(RecvTimeoutError::Timeout) if !ended.load(Ordering::Acquire) => {}
            Err(_) => return listener.end(),
        }
    }
}

/// One JSON object a line.
struct JsonLines<W> {
    out: W,
    /// The first line that could not be written.
    outcome: io::Result<()>,
    stop: Arc<AtomicBool>,
}

impl<W: Write> Listener for JsonLines<W> {
    fn report(&mut self, event: &Event, _: Duration) {
        if self.outcome.is_err() {
            return;
        }
        let written = serde_json::to_string(event).map_err(io::Error::from);
        // Each line at once, for whoever follows the run through a pipe.
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

/// Plain lines.
struct Lines<W> {
    out: W,
    /// When each stage began, and when a step of it was last shown.
    stages: BTreeMap<String, (Duration, Duration)>,
    /// Shown together at the end, where they are read.
    warnings: Vec<String>,
}

impl<W> Lines<W> {
    fn new(out: W) -> Self {
        Self { out, stages: BTreeMap::new(), warnings: Vec::new() }
    }
}

impl<W: Write> Listener for Lines<W> {
    fn report(&mut self, event: &Event, at: Duration) {
        let line = match event {
            Event::StageStarted { stage, steps } => {
                self.stages.insert(stage.clone(), (at, at));
                match steps {
                    Some(steps) => format!("{stage}: {steps} steps"),
                    None => format!("{stage}: started"),
                }
            }
            Event::Step { stage, done, total, .. } | Event::Count { stage, done, total } => {
                let (began, shown) = self.stages.entry(stage.clone()).or_insert((at, at));
                // A stage of a thousand steps would fill the log.
                if at < *shown + LINE_INTERVAL {
                    return;
                }
                *shown = at;
                let left = time_left(at.saturating_sub(*began), *done, *total);
                let loss = if let Event::Step { loss, .. } = event {
                    format!(", loss {loss:.4e}")
                } else {
                    String::new()
                };
                format!("{stage}: {done} of {total}{loss}{left}")
            }
            Event::Warning { message, .. } => return self.warnings.push(message.clone()),
            other => match sentence(other) {
                Some(line) => line,
                None => return,
            },
        };
        writeln!(self.out, "{}", printable(&line)).ok();
    }

    fn end(&mut self) {
        for warning in self.warnings.drain(..) {
            writeln!(self.out, "warning: {}", printable(&warning)).ok();
        }
    }
}

/// A bar for every stage that runs.
#[derive(Default)]
struct Bars {
    all: MultiProgress,
    running: BTreeMap<String, ProgressBar>,
    /// Shown together at the end, where they are read.
    warnings: Vec<String>,
}

impl Bars {
    fn bar(&mut self, stage: &str, steps: Option<usize>) -> &ProgressBar {
        self.running.entry(stage.to_owned()).or_insert_with(|| {
            let (bar, template) = match steps {
                Some(steps) => {
                    (ProgressBar::new(steps as u64), "{prefix:24} {wide_bar} {pos}/{len} {msg} {eta} left")
                }
                None => (ProgressBar::new_spinner(), "{prefix:24} {spinner} {elapsed}"),
            };
            let style =
                ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = self.all.add(bar.with_style(style).with_prefix(printable(stage)));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        })
    }
}

impl Bars {
    /// Writes a line above the bars. `MultiProgress::println` would leave the cursor in it once there are no
    /// bars.
    fn line(&self, text: &str) {
        self.all.suspend(|| writeln!(io::stderr(), "{}", printable(text)).ok());
    }
}

impl Listener for Bars {
    fn report(&mut self, event: &Event, _: Duration) {
        match event {
            Event::StageStarted { stage, steps } => drop(self.bar(stage, *steps).clone()),
            Event::Step { stage, done, total, loss } => {
                let bar = self.bar(stage, Some(*total));
                bar.set_position(*done as u64);
                bar.set_message(format!("loss {loss:.3e}"));
            }
            Event::Count { stage, done, total } => {
                self.bar(stage, Some(*total)).set_position(*done as u64);
            }
            Event::Warning { message, .. } => self.warnings.push(message.clone()),
            other => {
                if let Event::StageFinished { stage, .. } = other
                    && let Some(bar) = self.running.remove(stage)
                {
                    bar.finish_and_clear();
                    self.all.remove(&bar);
                }
                sentence(other).iter().for_each(|line| self.line(line));
            }
        }
    }

    fn end(&mut self) {
        std::mem::take(&mut self.warnings).iter().for_each(|w| self.line(&format!("warning: {w}")));
    }
}

impl Drop for Bars {
    fn drop(&mut self) {
        for (stage, bar) in &self.running {
            let steps = bar
                .length()
                .map(|steps| format!(" at step {} of {steps}", bar.position()))
                .unwrap_or_default();
            bar.finish_and_clear();
            self.line(&format!("{stage}: ended{steps}"));
        }
    }
}

/// What an event says; steps, starts and warnings are shown in their own way.
fn sentence(event: &Event) -> Option<String> {
    match event {
        // The program says last why it fails.
        Event::StageStarted { .. }
        | Event::Step { .. }
        | Event::Count { .. }
        | Event::Warning { .. }
        | Event::Error { .. } => None,
        Event::StageFinished { stage, seconds } => Some(format!("{stage}: done in {seconds:.1} s")),
        Event::Failed { message } => Some(format!("failed: {message}")),
        Event::Note { message, .. } => Some(message.clone()),
        Event::Artifact { path } => Some(format!("wrote {path}")),
    }
}

/// `, 1 min 20 s left` by the mean time of a step; nothing while no step is done.
fn time_left(spent: Duration, done: usize, total: usize) -> String {
    if done == 0 || done > total {
        return String::new();
    }
    // By the mean of all steps: single ones vary.
    let seconds = (spent.as_secs_f64() * (total - done) as f64 / done as f64).round() as u64;
    if seconds < 60 {
        format!(", {seconds} s left")
    } else {
        format!(", {} min {} s left", seconds / 60, seconds % 60)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::note::NoteCode;

    fn events() -> Vec<(u64, Event)> {
        let stage = || "field/state0".to_owned();
        let step = |done, loss| Event::Step { stage: stage(), done, total: 100, loss };
        vec![
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
            (99, Event::Artifact { path: "runs/box/box.urdf".to_owned() }),
            (99, Event::StageStarted { stage: "export".to_owned(), steps: None }),
        ]
    }

    fn shown(listener: &mut dyn Listener) {
        events().iter().for_each(|(seconds, event)| listener.report(event, Duration::from_secs(*seconds)));
    }

    #[test]
    fn lines_are_few_and_tell_the_time_left() {
        let mut lines = Lines::new(Vec::new());
        shown(&mut lines);
        lines.end();
        let expected = "field/state0: 100 steps\n\
                        field/state0: 10 of 100, loss 2.5000e-1, 1 min 30 s left\n\
                        field/state0: 20 of 100, loss NaN, 1 min 20 s left\n\
                        field/state0: done in 99.0 s\n\
                        stopping\n\
                        wrote runs/box/box.urdf\n\
                        export: started\n\
                        warning: topic \u{fffd}[2J lost\n";
        assert_eq!(String::from_utf8(lines.out).unwrap(), expected);
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
        assert_eq!(
            parsed[0],
            serde_json::json!({"event": "stage_started", "stage": "field/state0", "steps": 100})
        );
        let stage = "field/state0";
        assert_eq!(
            parsed[1],
            serde_json::json!({"event": "step", "stage": stage, "done": 1, "total": 100, "loss": 0.5})
        );
        assert_eq!(parsed[4]["loss"], serde_json::Value::Null);
        let warning = "topic \u{1b}[2J lost";
        assert_eq!(
            parsed[6],
            serde_json::json!({"event": "warning", "code": "recording_damaged", "message": warning})
        );
        assert_eq!(parsed[8], serde_json::json!({"event": "artifact", "path": "runs/box/box.urdf"}));
    }

    #[test]
    fn bars_follow_their_stages() {
        let mut bars = Bars::default();
        bars.all.set_draw_target(indicatif::ProgressDrawTarget::hidden());
        shown(&mut bars);
        assert_eq!(bars.running.keys().collect::<Vec<_>>(), ["export"]);
    }

    #[test]
    fn the_listener_ends_though_a_sender_is_left() {
        let (progress, sender) = Progress::start(false, Arc::default());
        progress.finish().unwrap();
        sender.send(Event::Note { code: NoteCode::Stopping, message: String::new() }).ok();
    }

    #[test]
    fn the_time_left_needs_a_step() {
        assert_eq!(time_left(Duration::from_secs(3), 0, 5), "");
        assert_eq!(time_left(Duration::from_secs(3), 6, 5), "");
        assert_eq!(time_left(Duration::from_secs(3), 5, 5), ", 0 s left");
    }
}
