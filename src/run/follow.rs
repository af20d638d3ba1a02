//! Follows recordings while they are written, and does a run's work on them as they grow.

use std::{
    path::PathBuf,
    thread::sleep,
    time::{Duration, Instant},
};

use super::{Event, Monitor, ReconstructRequest, RunError, capture::work_ahead};
use common::{
    ahead::Ahead,
    note::{Note, NoteCode},
};
use io::{GrowingState, is_recording};
use surface::{LiveMap, LiveSettings};

/// Interval between looks at a recording.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Time without growth after which a warning says that a recording may never be closed.
/// derived: recorders write their caches every few seconds
const STILL: Duration = Duration::from_secs(30);

/// Interval between reports of how much there is.
const SAY_EVERY: Duration = Duration::from_secs(2);
/// Memory limit of the map of seen places, bytes.
const MAP_BYTES: usize = 64 << 20;

/// Waits until the recordings of a request are closed, one state after the other, and works ahead on one
/// thread. In a folder that is not itself a recording, `state0` and `state1` are followed.
///
/// # Errors
/// If a stop is requested, or the system gives no further thread.
pub fn follow(request: &ReconstructRequest, monitor: &Monitor) -> Result<Ahead, RunError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|error| RunError::stage("follow", error.to_string()))?;
    let ahead = Ahead::new();
    let paths = followed(&request.sources);
    let noise = request.config.capture.noise;
    let mut map = LiveMap::new(LiveSettings { noise, most_bytes: MAP_BYTES });
    for (state, path) in paths.iter().enumerate() {
        let stage = format!("follow/state{state}");
        monitor.report(Event::StageStarted { stage: stage.clone(), steps: None });
        let begun = Instant::now();
        let mut follower = Follower {
            growing: GrowingState::new(path, state),
            state,
            request,
            ahead: &ahead,
            monitor,
            said: None,
            map: &mut map,
        };
        follower.map.begin_state();
        pool.install(|| follower.until_closed())?;
        // When nothing more will come, the run does the rest, on all threads.
        if paths[state + 1..].iter().any(|path| !GrowingState::new(path, 0).is_closed()) {
            pool.install(|| follower.look());
        }
        monitor.report(Event::StageFinished { stage, seconds: begun.elapsed().as_secs_f64() });
    }
    Ok(ahead)
}

/// The recordings to follow.
fn followed(sources: &[PathBuf]) -> Vec<PathBuf> {
    match sources {
        [one] if !is_recording(one) => ["state0", "state1"].map(|s| one.join(s)).into(),
        all => all.to_vec(),
    }
}

/// Follows one recording.
struct Follower<'a> {
    growing: GrowingState,
    state: usize,
    request: &'a ReconstructRequest,
    ahead: &'a Ahead,
    monitor: &'a Monitor,
    /// When the number of views was last reported, and that number.
    said: Option<(Instant, usize)>,
    map: &'a mut LiveMap,
}

impl Follower<'_> {
    /// Looks at the recording until it is closed.
    fn until_closed(&mut self) -> Result<(), RunError> {
        let mut grown = Some(Instant::now());
        let mut bytes = 0;
        while !self.growing.is_closed() {
            self.monitor.check()?;
            self.look();
            let now = self.growing.bytes();
            if now != bytes {
                (bytes, grown) = (now, Some(Instant::now()));
            } else if grown.is_some_and(|since| since.elapsed() > STILL) {
                // Reported once, until it grows again.
                grown = None;
                let what = if bytes == 0 { "is not there yet" } else { "does not grow, and is not closed" };
                let text = format!(
                    "`{}` {what}; where its recorder has ended, stop this and run it without --follow",
                    self.growing.path().display()
                );
                self.monitor.note(&Note::new(NoteCode::RecordingStill, text));
            }
            sleep(LOOK_EVERY);
        }
        Ok(())
    }

    /// Looks at the recording once.
    fn look(&mut self) {
        let config = &self.request.config;
        // A recording that has just begun has too few views. The run reports the same for a closed one.
        let seed = config.run.seed;
        let grown = work_ahead(&mut self.growing, &config.capture, seed, self.ahead, self.monitor);
        let Ok(Some(grown)) = grown else { return };
        // Tracked frames have no poses in the world yet.
        let frames = grown.frames.iter().filter(|_| grown.is_posed);
        frames.for_each(|frame| _ = self.map.add_view(frame));
        if self.said.is_none_or(|(when, views)| when.elapsed() > SAY_EVERY && views != grown.views) {
            self.said = Some((Instant::now(), grown.views));
            let map = self.map_text();
            let text = format!(
                "state {}: {} views, of which a run takes {}{map}",
                self.state, grown.views, grown.taken
            );
            self.monitor.note(&Note::new(NoteCode::RecordingGrows, text));
        }
    }

    /// A sentence on unseen sides of the object, the next places to look from, and moved parts; empty without
    /// a map.
    fn map_text(&mut self) -> String {
        self.map.refresh();
        let Some((unseen, next)) = self.map.unseen_and_next() else { return String::new() };
        let mut text =
            format!("; {:.0} % of the surface that they look at is unseen", 100.0 * unseen.unseen_share());
        if let Some(next) = next {
            let p = next.world_from_camera.translation.vector;
            text += &format!(", most of it from ({:.2}, {:.2}, {:.2}) m", p.x, p.y, p.z);
        }
        if let Some(moved) = self.map.moved_surface() {
            let area_m2 = moved.areas_m2().iter().fold(0.0, |most: f64, a| most.max(*a));
            text += &format!("; {:.0} cm2 of surface moved", 1e4 * area_m2);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_no_recording_holds_two_that_come() {
        let folder = tempfile::tempdir().unwrap();
        let one = folder.path().join("session");
        assert_eq!(followed(std::slice::from_ref(&one)), ["state0", "state1"].map(|s| one.join(s)));
        std::fs::create_dir_all(&one).unwrap();
        std::fs::write(one.join("metadata.yaml"), "").unwrap();
        assert_eq!(followed(std::slice::from_ref(&one)), std::slice::from_ref(&one));
        let two = [one.join("a"), one.join("b")];
        assert_eq!(followed(&two), two);
    }
}
