//! The node's publishers: twin, joint states, collection, diagnostics. Large messages are published rarely or
//! best effort.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::sync::{mpsc, watch};

use super::{
    clock::NodeClock,
    collection::{Shared, Snapshot},
    diagnostics::Diagnostics,
    error::NodeError,
    parameters::Parameters,
    participant::{Participant, Publisher, latched_profile, reliable_profile},
    twin::Twin,
    twin_messages::{joint_markers, joint_state, link_transforms, root_transform},
};
use io::ros2msg::{
    Header, JointState, TfMessage, TransformStamped, diagnostic::DiagnosticArray, gap::GapReport,
    markers::MarkerArray, point_cloud::PointCloud2, status::CollectionStatus, text::Text,
};

/// Values of `CollectionStatus.phase`.
mod phase {
    pub(super) const IDLE: u8 = 0;
    pub(super) const COLLECTING: u8 = 1;
    pub(super) const MOVING: u8 = 2;
    pub(super) const READY: u8 = 3;
    pub(super) const RECONSTRUCTING: u8 = 4;
    pub(super) const DONE: u8 = 5;
}

/// Sources of the published data.
pub(crate) struct OutputSources {
    /// The last twin.
    pub twin: watch::Receiver<Option<Arc<Twin>>>,
    /// The last diagnosis.
    pub report: watch::Receiver<Option<Arc<GapReport>>>,
    /// Poses of the tracked camera.
    pub poses: mpsc::Receiver<TransformStamped>,
}

/// All publishers.
pub(crate) struct Outputs {
    description: Publisher<Text>,
    joint_states: Publisher<JointState>,
    tf: Publisher<TfMessage>,
    tf_static: Publisher<TfMessage>,
    markers: Publisher<MarkerArray>,
    cloud: Publisher<PointCloud2>,
    diagnostics: Publisher<DiagnosticArray>,
    status: Publisher<CollectionStatus>,
    gap_report: Publisher<GapReport>,
    settings: OutputSettings,
    clock: Arc<NodeClock>,
}

struct OutputSettings {
    rate_hz: f64,
    prefix: String,
    publish_tf: bool,
    package_uris: bool,
}

impl Outputs {
    /// Creates all publishers.
    ///
    /// # Errors
    /// If a name is invalid or the network reports an error.
    pub(crate) fn new(
        participant: &mut Participant,
        p: &Parameters,
        clock: Arc<NodeClock>,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            description: participant.create_publisher("~/robot_description", &latched_profile(1))?,
            joint_states: participant.create_publisher("joint_states", &reliable_profile(10))?,
            tf: participant.create_publisher("/tf", &reliable_profile(100))?,
            tf_static: participant.create_publisher("/tf_static", &latched_profile(1))?,
            markers: participant.create_publisher("~/joint_markers", &latched_profile(1))?,
            cloud: participant.create_publisher("~/points", &latched_profile(1))?,
            diagnostics: participant.create_publisher("/diagnostics", &reliable_profile(10))?,
            status: participant.create_publisher("~/status", &latched_profile(1))?,
            gap_report: participant.create_publisher("~/gap_report", &latched_profile(1))?,
            settings: OutputSettings {
                rate_hz: p.joint_state_rate_hz,
                prefix: p.frame_prefix.clone(),
                publish_tf: p.publish_tf,
                package_uris: p.mesh_uri == "package",
            },
            clock,
        })
    }

    /// Publishes until the node ends.
    pub(crate) async fn run(
        self,
        OutputSources { twin: mut twins, mut report, mut poses }: OutputSources,
        shared: Arc<Shared>,
        mut diagnostics: Diagnostics,
    ) {
        let mut fast = tokio::time::interval(Duration::from_secs_f64(1.0 / self.settings.rate_hz));
        let mut slow = tokio::time::interval(Duration::from_secs(1));
        let mut last_report = Instant::now();
        let mut last_cloud = 0;
        loop {
            tokio::select! {
                changed = twins.changed() => {
                    // The sender is gone: the node is shutting down.
                    if changed.is_err() {
                        return;
                    }
                    let twin = twins.borrow_and_update().clone();
                    if let Some(twin) = twin {
                        self.announce_twin(&twin).await;
                    }
                }
                changed = report.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    let found = report.borrow_and_update().clone();
                    if let Some(found) = found {
                        let header = Header { stamp: self.clock.stamp_now(), frame_id: String::new() };
                        // Stamped now, also for a report published again after a restart.
                        let report = GapReport { header, ..GapReport::clone(&found) };
                        log_failure(self.gap_report.async_publish(report).await, "gap_report");
                    }
                }
                Some(pose) = poses.recv() => {
                    if self.settings.publish_tf {
                        let message = TfMessage { transforms: vec![pose] };
                        log_failure(self.tf.async_publish(message).await, "/tf");
                    }
                }
                // Repeated without motion, since tf2 drops transforms after ten seconds.
                _ = fast.tick() => {
                    let twin = twins.borrow().clone();
                    if let Some(twin) = twin {
                        self.move_links(&twin).await;
                    }
                }
                _ = slow.tick() => {
                    let snapshot = shared.snapshot();
                    let report =
                        diagnostics.status_array(self.clock.stamp_now(), last_report.elapsed(), &snapshot);
                    last_report = Instant::now();
                    log_failure(self.diagnostics.async_publish(report).await, "/diagnostics");
                    let done = twins.borrow().is_some();
                    let status = self.status_of(&snapshot, shared.is_read(), done);
                    log_failure(self.status.async_publish(status).await, "status");
                    // The largest message, sent only when it has changed.
                    if snapshot.cloud_version != last_cloud {
                        last_cloud = snapshot.cloud_version;
                        let frame_id = snapshot.world_frame.unwrap_or_default();
                        let header = Header { stamp: self.clock.stamp_now(), frame_id };
                        let cloud = PointCloud2::colored(header, &shared.cloud());
                        log_failure(self.cloud.async_publish(cloud).await, "points");
                    }
                }
            }
        }
    }

    /// Publishes all latched messages of a new twin.
    async fn announce_twin(&self, twin: &Twin) {
        let stamp = self.clock.stamp_now();
        let data = twin.summary.urdf_with_uris(self.settings.package_uris);
        log::info!("robot_description: {} bytes, {} joints", data.len(), twin.summary.joints.len());
        log_failure(self.description.async_publish(Text { data }).await, "robot_description");
        log_failure(
            self.markers
                .async_publish(joint_markers(&twin.summary, twin.state, &twin.world_frame, stamp))
                .await,
            "joint_markers",
        );
        if let Some(root) = root_transform(&twin.summary, &twin.world_frame, stamp, &self.settings.prefix)
            .filter(|_| self.settings.publish_tf)
        {
            log_failure(
                // All in one message, as a late subscriber gets only the last one per publisher.
                self.tf_static.async_publish(TfMessage { transforms: vec![root] }).await,
                "/tf_static",
            );
        }
    }

    async fn move_links(&self, twin: &Twin) {
        let stamp = self.clock.stamp_now();
        log_failure(
            self.joint_states.async_publish(joint_state(&twin.summary, twin.state, stamp)).await,
            "joint_states",
        );
        if self.settings.publish_tf {
            log_failure(
                self.tf
                    .async_publish(link_transforms(&twin.summary, twin.state, stamp, &self.settings.prefix))
                    .await,
                "/tf",
            );
        }
    }

    fn status_of(&self, s: &Snapshot, busy: bool, done: bool) -> CollectionStatus {
        let phase = match () {
            // Order matters: the first condition that holds is the phase.
            () if busy => phase::RECONSTRUCTING,
            () if s.collecting.is_some() => phase::COLLECTING,
            () if s.moving => phase::MOVING,
            () if done => phase::DONE,
            () if s.recordings.iter().all(Option::is_some) => phase::READY,
            () => phase::IDLE,
        };
        let tracking = s.tracking.clone().unwrap_or_default();
        CollectionStatus {
            header: Header {
                stamp: self.clock.stamp_now(),
                frame_id: s.world_frame.clone().unwrap_or_default(),
            },
            phase,
            state: s.collecting.unwrap_or(s.state) as u8,
            keyframes: s.kept.map(|n| n as u32),
            matched: s.matched,
            unmatched: s.unmatched.iter().sum(),
            session: s.session.display().to_string(),
            tracked: s.tracking.is_some(),
            views_per_second: tracking.views_hz as f32,
            inliers: tracking.inliers as f32,
            position_error: tracking.error_m as f32,
            hint: tracking.hint,
        }
    }
}

fn log_failure<E: std::fmt::Debug>(published: Result<(), E>, what: &str) {
    if published.is_err() {
        log::debug!("{what} could not be published");
    }
}

#[cfg(test)]
mod tests {
    /// The layouts for RViz and Foxglove name topics of the node that are published.
    #[test]
    fn shipped_layouts_show_what_is_published() {
        let published = [include_str!("outputs.rs"), include_str!("live_outputs.rs")].concat();
        for layout in [
            include_str!("../../launch_configs/ros/twin.rviz"),
            include_str!("../../launch_configs/ros/twin.foxglove.json"),
        ] {
            let named: Vec<&str> = layout
                .split("/artitwin/")
                .skip(1)
                .map(|rest| rest.split(['"', '\n']).next().unwrap_or_default())
                .collect();
            assert!(named.len() >= 3, "{named:?}");
            for name in named {
                assert!(published.contains(&format!("publisher(\"~/{name}\"")), "{name}");
            }
        }
    }
}
