//! Work of an action: it runs in its own thread, reports progress and can be stopped.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use serde::{Serialize, de::DeserializeOwned};
use tokio::sync::mpsc;

use super::goal_error::GoalError;
use run::{Event, Monitor};

/// Queue length for reports.
const NEWS: usize = 256;
/// Least time between feedback messages of one stage.
const FEEDBACK_EVERY: Duration = Duration::from_millis(100);

/// The work of an action.
pub(crate) trait Job: Send + Sync + 'static {
    /// Goal message.
    type Goal: DeserializeOwned + Send + Sync + 'static;
    /// Result message.
    type Result: Serialize + Clone + Default + Send + Sync + 'static;
    /// Feedback message.
    type Feedback: Serialize + Send + Sync + 'static;
    /// Name of the action below the node's name.
    const NAME: &'static str;
    /// Type of the action in `artitwin_msgs`.
    const TYPE: &'static str;

    /// Starts the work.
    ///
    /// # Errors
    /// If the work cannot be started.
    fn begin_work(
        self: &Arc<Self>,
        goal: &Self::Goal,
    ) -> Result<Work<Self::Result, Self::Feedback>, GoalError>;

    /// Result of work that failed with a message.
    fn failed_result(message: String) -> Self::Result;
}

/// How the work ended.
#[derive(Debug)]
pub(crate) enum Finished<R> {
    /// Completed with a result.
    Done(R),
    /// Stopped on request.
    Canceled,
    /// Failed; with the reason.
    Failed(String),
}

/// Reports from the work.
#[derive(Debug)]
pub(crate) enum News<R, F> {
    /// Progress.
    Feedback(F),
    /// The end; no report follows.
    Ended(Finished<R>),
}

/// Work in progress; dropping it requests a stop.
#[derive(Debug)]
pub(crate) struct Work<R, F> {
    news: mpsc::Receiver<News<R, F>>,
    cancel: Arc<AtomicBool>,
}

impl<R: Send + 'static, F: Send + 'static> Work<R, F> {
    /// Starts the work. `feedback` converts an event and the time since the start to a message, if there is
    /// one; it is sent at once for a new stage, else at a limited rate.
    pub(crate) fn start_thread(
        mut feedback: impl FnMut(&Event, Duration) -> Option<F> + Send + 'static,
        work: impl FnOnce(&Monitor) -> Finished<R> + Send + 'static,
    ) -> Self {
        let cancel = Arc::new(AtomicBool::new(false));
        let (send, news) = mpsc::channel(NEWS);
        let (events, listener) = std::sync::mpsc::channel();
        let to_client = send.clone();
        // Two threads: a slow client must not block the work, and the pipeline is not async.
        std::thread::spawn(move || {
            let start = Instant::now();
            let mut last = None::<Instant>;
            for event in listener {
                if let Event::Warning { message, .. } = &event {
                    log::warn!("{message}");
                }
                let Some(feedback) = feedback(&event, start.elapsed()) else { continue };
                // Otherwise each step would send a message.
                if matches!(event, Event::StageStarted { .. })
                    || last.is_none_or(|t| t.elapsed() >= FEEDBACK_EVERY)
                {
                    last = Some(Instant::now());
                    // A slow client may miss feedback; the end is sent separately.
                    to_client.try_send(News::Feedback(feedback)).ok();
                }
            }
        });
        let stop = Arc::clone(&cancel);
        std::thread::spawn(move || {
            let finished = work(&Monitor::new(events, stop));
            send.blocking_send(News::Ended(finished)).ok();
        });
        Self { news, cancel }
    }

    /// Waits for the next report.
    pub(crate) async fn next(&mut self) -> News<R, F> {
        // The channel closes without an end only if the work panicked.
        match self.news.recv().await {
            Some(news) => news,
            None => News::Ended(Finished::Failed("the work ended without a word".into())),
        }
    }
}

impl<R, F> Work<R, F> {
    /// Requests a stop after the current step.
    pub(crate) fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }
}

impl<R, F> Drop for Work<R, F> {
    fn drop(&mut self) {
        self.cancel();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wait(monitor: &Monitor) -> Finished<u8> {
        for k in 0.. {
            monitor.report(Event::StageStarted { stage: format!("stage{k}"), steps: None });
            if monitor.check().is_err() {
                return Finished::Canceled;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Finished::Done(0)
    }

    fn stage(event: &Event, _: Duration) -> Option<String> {
        match event {
            Event::StageStarted { stage, .. } => Some(stage.clone()),
            _ => None,
        }
    }

    #[tokio::test]
    async fn work_reports_its_stages_and_stops_when_asked() {
        let mut work = Work::start_thread(stage, wait);
        for expected in ["stage0", "stage1"] {
            assert!(matches!(work.next().await, News::Feedback(sent) if sent == expected));
        }
        work.cancel();
        let mut news = work.next().await;
        while matches!(news, News::Feedback(_)) {
            news = work.next().await;
        }
        assert!(matches!(news, News::Ended(Finished::Canceled)));
    }

    #[tokio::test]
    async fn work_that_panics_has_failed() {
        let mut work: Work<u8, String> = Work::start_thread(stage, |_| panic!("as a test"));
        assert!(matches!(work.next().await, News::Ended(Finished::Failed(_))));
    }
}
