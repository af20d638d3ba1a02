//! Computes how far runs are from the events of their stages.

use std::{collections::BTreeMap, time::Duration};

use super::{Event, plan::WEIGHT_OF_SECOND};

/// How much the pace of the machine on which weights were measured counts relative to this run's pace: as
/// much as stages of this weight. chosen: a tenth of a run
const TRUST_IN_WEIGHTS: f64 = 10.0;

/// A running stage.
#[derive(Clone, Debug)]
struct Running {
    name: String,
    began: Duration,
    /// Share done, 0 to 1; `None` if it reports no steps.
    share: Option<f64>,
}

/// Progress of a run, or of several at once. Times are since it began.
#[derive(Clone, Debug, Default)]
pub struct RunProgress {
    /// When the first stages were announced: waiting before does not count for the pace.
    begun: Option<Duration>,
    /// Weights of coming and running stages.
    weights: BTreeMap<String, f64>,
    /// Running stages, in the order in which they began.
    running: Vec<Running>,
    /// Total weight of ended stages.
    done: f64,
    /// Time of the last progress, and the weight done by then.
    counted: (Duration, f64),
    loss: Option<f64>,
}

impl RunProgress {
    /// Processes an event; returns whether it changes the progress.
    pub fn take(&mut self, event: &Event, at: Duration) -> bool {
        match event {
            Event::Planned { stages } => {
                self.begun.get_or_insert(at);
                for planned in stages {
                    self.weights.insert(planned.stage.clone(), planned.weight);
                    // The stage will not come: its run failed.
                    if planned.weight == 0.0 {
                        self.running.retain(|r| r.name != planned.stage);
                    }
                }
                return false;
            }
            Event::StageStarted { stage, .. } => {
                self.running.push(Running { name: stage.clone(), began: at, share: None });
                self.loss = None;
            }
            Event::Step { stage, done, total, loss } => {
                self.loss = Some(*loss);
                self.stepped(stage, *done, *total, at);
            }
            Event::Count { stage, done, total } => self.stepped(stage, *done, *total, at),
            Event::StageFinished { stage, .. } => {
                self.running.retain(|r| r.name != *stage);
                self.done += self.weights.remove(stage).unwrap_or_default();
                self.loss = None;
                self.counted = (at, self.done + self.stepped_weight());
            }
            _ => return false,
        }
        true
    }

    fn stepped(&mut self, stage: &str, done: usize, total: usize, at: Duration) {
        if let Some(running) = self.running.iter_mut().find(|r| r.name == stage) {
            running.share = Some((done as f64 / total.max(1) as f64).min(1.0));
        }
        self.counted = (at, self.done + self.stepped_weight());
    }

    fn weight(&self, stage: &Running) -> f64 {
        self.weights.get(&stage.name).copied().unwrap_or_default()
    }

    /// Weight of the finished steps of unfinished stages.
    fn stepped_weight(&self) -> f64 {
        self.running.iter().map(|r| self.weight(r) * r.share.unwrap_or_default()).sum()
    }

    /// The running stage that began last, and the number of other running ones.
    pub fn stage(&self) -> Option<(&str, usize)> {
        self.running.last().map(|r| (r.name.as_str(), self.running.len() - 1))
    }

    /// The loss of the running stage, if it has one.
    pub fn loss(&self) -> Option<f64> {
        self.loss
    }

    /// Share of the work done, 0 to 1, and the time for the rest at the pace so far; `None` if no stages were
    /// announced.
    pub fn at(&self, now: Duration) -> Option<(f64, Duration)> {
        let to_come: f64 = self.weights.values().sum();
        let all = self.done + to_come;
        if all <= 0.0 {
            return None;
        }
        let (counted_at, counted) = self.counted;
        let worked = counted_at.saturating_sub(self.begun.unwrap_or_default());
        let seconds_of_weight =
            (worked.as_secs_f64() + TRUST_IN_WEIGHTS / WEIGHT_OF_SECOND) / (counted + TRUST_IN_WEIGHTS);
        let running = self.running.iter().map(|r| self.weight_done(r, now, seconds_of_weight));
        let done = self.done + running.sum::<f64>();
        let left_s = (all - done) * seconds_of_weight;
        Some(((done / all).clamp(0.0, 1.0), Duration::from_secs_f64(left_s.max(0.0))))
    }

    /// The part of a running stage's weight that is done: from its steps, else from its time so far, divided
    /// among the running stages.
    fn weight_done(&self, stage: &Running, now: Duration, seconds_of_weight: f64) -> f64 {
        let weight = self.weight(stage);
        if let Some(share) = stage.share {
            return share * weight;
        }
        let spent = now.saturating_sub(stage.began).as_secs_f64() / self.running.len() as f64;
        (spent / seconds_of_weight).min(weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Planned, plan};
    use common::note::NoteCode;
    use config::Config;

    fn seconds(s: f64) -> Duration {
        Duration::from_secs_f64(s)
    }

    fn started(stage: &str) -> Event {
        Event::StageStarted { stage: stage.into(), steps: None }
    }

    fn finished(stage: &str) -> Event {
        Event::StageFinished { stage: stage.into(), seconds: 1.0 }
    }

    #[test]
    fn what_was_waited_for_is_no_pace() {
        let left = |waited: f64| {
            let mut progress = RunProgress::default();
            progress.take(&started("follow/state0"), seconds(0.0));
            progress.take(&finished("follow/state0"), seconds(waited));
            let stages = plan::plan(&Config::default(), 2);
            progress.take(&Event::Planned { stages }, seconds(waited));
            progress.take(&started("capture"), seconds(waited));
            progress.take(&finished("capture"), seconds(waited + 4.0));
            progress.at(seconds(waited + 4.0)).unwrap().1.as_secs_f64()
        };
        assert!((left(0.0) - left(600.0)).abs() < 1e-6, "{} {}", left(0.0), left(600.0));
    }

    #[test]
    fn the_share_rises_to_one_and_the_time_left_is_that_of_the_pace() {
        for preset in ["default", "fields", "paper", "paris"] {
            let config = Config::preset(preset).unwrap();
            let mut progress = RunProgress::default();
            assert!(progress.at(seconds(1.0)).is_none());
            progress.take(&Event::Planned { stages: plan::plan(&config, 2) }, seconds(0.0));
            // A machine of a third of the pace.
            let pace = 3.0 / WEIGHT_OF_SECOND;
            let stages = plan::plan(&config, 2);
            let whole = pace * stages.iter().map(|p| p.weight).sum::<f64>();
            let mut now = 0.0;
            let mut last = 0.0;
            for planned in &stages {
                progress.take(&started(&planned.stage), seconds(now));
                assert_eq!(progress.stage(), Some((planned.stage.as_str(), 0)));
                now += 0.5 * planned.weight * pace;
                let (share, _) = progress.at(seconds(now)).unwrap();
                assert!(share >= last, "{preset} {}", planned.stage);
                now += 0.5 * planned.weight * pace;
                progress.take(&finished(&planned.stage), seconds(now));
                let (after, left) = progress.at(seconds(now)).unwrap();
                assert!(after >= share && (after - now / whole).abs() < 1e-9, "{preset} {}", planned.stage);
                // Half done, the pace is known within a quarter.
                let error_s = left.as_secs_f64() - (whole - now);
                assert!(after < 0.5 || error_s.abs() < 0.25 * (whole - now) + 1e-6, "{preset} {error_s}");
                last = after;
            }
            assert!((last - 1.0).abs() < 1e-9, "{preset}");
        }
    }

    #[test]
    fn steps_count_and_a_stage_that_was_kept_does_not() {
        let weigh = |stage: &str, weight| Planned { stage: stage.into(), weight };
        let mut progress = RunProgress::default();
        let stages = vec![weigh("a", 60.0), weigh("b", 40.0)];
        progress.take(&Event::Planned { stages }, seconds(0.0));
        progress.take(&Event::Planned { stages: vec![weigh("a", 0.0)] }, seconds(0.0));
        progress.take(&started("a"), seconds(0.0));
        progress.take(&finished("a"), seconds(0.0));
        assert!(progress.at(seconds(0.0)).unwrap().0 < 1e-12);
        progress.take(&started("b"), seconds(0.0));
        let step = Event::Step { stage: "b".into(), done: 1, total: 4, loss: 0.5 };
        assert!(progress.take(&step, seconds(25.0)) && progress.loss() == Some(0.5));
        let (share, left) = progress.at(seconds(25.0)).unwrap();
        // 10 of 40 in 25 s, and what was foreseen counts as much.
        assert!((share - 0.25).abs() < 1e-12);
        assert!((left.as_secs_f64() - 30.0 * (25.0 + 2.5) / 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_run_that_failed_is_done_with() {
        let weigh = |stage: &str, weight| Planned { stage: stage.into(), weight };
        let mut progress = RunProgress::default();
        let stages = vec![weigh("one/a", 10.0), weigh("two/a", 10.0)];
        progress.take(&Event::Planned { stages }, seconds(0.0));
        progress.take(&started("one/a"), seconds(0.0));
        progress.take(&started("two/a"), seconds(0.0));
        assert_eq!(progress.stage(), Some(("two/a", 1)));
        progress.take(&Event::Planned { stages: vec![weigh("two/a", 0.0)] }, seconds(1.0));
        assert_eq!(progress.stage(), Some(("one/a", 0)));
        progress.take(&finished("one/a"), seconds(2.0));
        assert_eq!(progress.at(seconds(2.0)), Some((1.0, Duration::ZERO)));
    }

    #[test]
    fn notes_say_nothing_of_the_way() {
        let note = Event::Note { code: NoteCode::Stopping, message: String::new() };
        assert!(!RunProgress::default().take(&note, Duration::ZERO));
    }
}
