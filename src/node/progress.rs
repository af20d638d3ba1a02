//! How far a reconstruction is, from the events of its stages.

use std::time::Duration;

use crate::{io::ros2msg::status::ReconstructFeedback, run::Event};

/// Shares of a run without fields, by stage, as measured (docs/figures.md); a stage that is not listed
/// counts 1.
const WEIGHTS: [(&str, f64); 9] = [
    ("capture", 8.0),
    ("match", 9.0),
    ("fusion", 10.0),
    ("surface", 8.0),
    ("register", 15.0),
    ("joints", 5.0),
    ("assemble", 13.0),
    ("export", 13.0),
    // Only where networks are trained; then they are most of the run.
    ("field", 400.0),
];
/// Stages of a run without fields.
const STAGES: [&str; 12] = [
    "capture",
    "match",
    "fusion/state0",
    "surface/state0",
    "fusion/state1",
    "surface/state1",
    "register",
    "joints",
    "assemble",
    "pictures",
    "export",
    "check",
];
/// Below this the time left is a guess.
const MIN_FRACTION: f64 = 0.05;

/// How far a run is.
#[derive(Clone, Debug)]
pub struct RunProgress {
    total: f64,
    done: f64,
    stage: String,
    /// Of the present stage, 0 to 1.
    part: f64,
    loss: f64,
}

fn weight(stage: &str) -> f64 {
    let kind = stage.split('/').next().unwrap_or(stage);
    WEIGHTS.iter().find(|(name, _)| *name == kind).map_or(1.0, |(_, w)| *w)
}

impl RunProgress {
    /// Nothing done yet; whether networks are trained.
    #[must_use]
    pub fn new(trains_fields: bool) -> Self {
        let plain: f64 = STAGES.iter().map(|s| weight(s)).sum();
        let fields = if trains_fields { 2.0 * weight("field") } else { 0.0 };
        Self { total: plain + fields, done: 0.0, stage: String::new(), part: 0.0, loss: f64::NAN }
    }

    /// Takes an event; whether there is something to report.
    pub fn take(&mut self, event: &Event) -> bool {
        match event {
            Event::StageStarted { stage, .. } => {
                self.stage.clone_from(stage);
                (self.part, self.loss) = (0.0, f64::NAN);
            }
            Event::Step { done, total, loss, .. } => {
                self.part = *done as f64 / (*total).max(1) as f64;
                self.loss = *loss;
            }
            Event::Count { done, total, .. } => self.part = *done as f64 / (*total).max(1) as f64,
            Event::StageFinished { stage, .. } => {
                self.done += weight(stage);
                self.part = 0.0;
                // A stage that was not foreseen makes the whole longer.
                self.total = self.total.max(self.done);
            }
            _ => return false,
        }
        true
    }

    /// What a goal's feedback says after a time.
    #[must_use]
    pub fn feedback(&self, elapsed: Duration) -> ReconstructFeedback {
        let fraction = ((self.done + self.part * weight(&self.stage)) / self.total).clamp(0.0, 1.0);
        // By the mean so far; at the start that is the time of one cheap stage.
        let left = if fraction < MIN_FRACTION {
            f64::NAN
        } else {
            elapsed.as_secs_f64() * (1.0 - fraction) / fraction
        };
        ReconstructFeedback {
            stage: self.stage.clone(),
            fraction: fraction as f32,
            loss: self.loss,
            seconds_left: left,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::note::NoteCode;

    #[test]
    fn the_fraction_rises_to_one() {
        let mut progress = RunProgress::new(false);
        let mut last = 0.0;
        assert!(progress.feedback(Duration::from_secs(1)).seconds_left.is_nan());
        for stage in STAGES {
            progress.take(&Event::StageStarted { stage: stage.into(), steps: Some(2) });
            progress.take(&Event::Step { stage: stage.into(), done: 1, total: 2, loss: 0.5 });
            let feedback = progress.feedback(Duration::from_secs(10));
            assert!(feedback.fraction > last && feedback.stage == stage && feedback.loss == 0.5);
            progress.take(&Event::StageFinished { stage: stage.into(), seconds: 1.0 });
            last = progress.feedback(Duration::from_secs(10)).fraction;
            assert!(last >= feedback.fraction);
        }
        assert!((last - 1.0).abs() < 1e-6);
        assert!(progress.feedback(Duration::from_secs(10)).seconds_left.abs() < 1e-6);
    }

    #[test]
    fn notes_tell_nothing_of_the_way() {
        assert!(
            !RunProgress::new(true).take(&Event::Note { code: NoteCode::Stopping, message: String::new() })
        );
    }
}
