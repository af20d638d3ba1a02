//! Publishes the live map: changes at once, and everything repeatedly for late subscribers, in messages that
//! fit a small receive buffer.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use super::{
    error::NodeError,
    live_map::{LiveProducts, LiveResults},
    live_messages::{
        chunk_bytes, chunk_marker, clear_markers, gone_chunk, moved_markers, next_view, unseen_markers,
    },
    participant::{Participant, Publisher, reliable_profile},
};
use io::ros2msg::{Header, PoseStamped, Time, markers::MarkerArray};
use surface::MeshChunk;

/// Time between surface messages.
const TICK: Duration = Duration::from_millis(20);
/// Target size of a surface message, bytes; a large chunk may double it.
/// derived: the default receive buffer of Linux is 212992 bytes; 6 MB per second exceed the largest surface
const MESSAGE_BYTES: usize = 120_000;
/// Time between messages of everything else.
const REST_EVERY: Duration = Duration::from_millis(250);
/// Messages with new surface between two with repeated surface.
const PAUSE: u32 = 12;
/// Time between repetitions of everything.
const AGAIN: Duration = Duration::from_secs(10);
/// Time span over which the longest delay is reported.
const DELAY_KEPT: Duration = Duration::from_secs(1);

/// All publishers of the live map.
pub(crate) struct LiveOutputs {
    mesh: Publisher<MarkerArray>,
    unseen: Publisher<MarkerArray>,
    next_view: Publisher<PoseStamped>,
    moved: Publisher<MarkerArray>,
}

/// What was sent of the surface.
#[derive(Default)]
struct Sent {
    /// Number of states started when it was sent.
    begun: u64,
    /// Version of each sent chunk, by chunk number.
    versions: BTreeMap<i32, u64>,
    /// By chunk, time of the oldest view that changed it since it was sent.
    waiting: BTreeMap<i32, Instant>,
    /// Number of the last repeated chunk, and of idle ticks since.
    again: (i32, u32),
}

impl LiveOutputs {
    /// Creates all publishers.
    ///
    /// # Errors
    /// If a name is invalid or the network reports an error.
    pub(crate) fn new(participant: &mut Participant) -> Result<Self, NodeError> {
        Ok(Self {
            mesh: participant.create_publisher("~/live_mesh", &reliable_profile(4))?,
            unseen: participant.create_publisher("~/unseen", &reliable_profile(1))?,
            next_view: participant.create_publisher("~/next_view", &reliable_profile(1))?,
            moved: participant.create_publisher("~/moved", &reliable_profile(1))?,
        })
    }

    /// Publishes until the node ends.
    pub(crate) async fn run(self, results: LiveResults) {
        let mut tick = tokio::time::interval(TICK);
        tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut sent = Sent::default();
        let mut shown: Option<Arc<LiveProducts>> = None;
        let mut rest_at = Instant::now();
        let mut rest_of = None;
        let mut longest = Duration::ZERO;
        let mut longest_at = Instant::now();
        loop {
            tick.tick().await;
            let begun = *results.begun.borrow();
            if begun != sent.begun {
                self.clear_screen(shown.take().as_deref()).await;
                sent = Sent { begun, ..Sent::default() };
                rest_of = None;
            }
            let products = results.products.borrow().clone().filter(|p| p.key.begun == begun);
            let Some(products) = products else { continue };
            let header = header_of_products(&products);
            if shown.as_ref().is_none_or(|s| !Arc::ptr_eq(s, &products)) {
                sent.note_changes(&products);
                shown = Some(Arc::clone(&products));
            }
            if let Some((message, delay)) = sent.next(&products, &header) {
                log_failure(self.mesh.async_publish(message).await.is_err(), "live_mesh");
                if delay >= longest || longest_at.elapsed() > DELAY_KEPT {
                    (longest, longest_at) = (delay, Instant::now());
                    results.counts.set_behind(delay);
                }
            }
            let is_new = rest_of.as_ref().is_none_or(|r| !Arc::ptr_eq(r, &products));
            let age = rest_at.elapsed();
            if (is_new && age >= REST_EVERY) || age >= AGAIN {
                (rest_at, rest_of) = (Instant::now(), Some(Arc::clone(&products)));
                self.publish_rest(&products, &header).await;
            }
        }
    }

    /// Deletes all markers in viewers.
    async fn clear_screen(&self, shown: Option<&LiveProducts>) {
        let header = shown.map(header_of_products).unwrap_or_default();
        for (topic, name) in [(&self.mesh, "live_mesh"), (&self.unseen, "unseen"), (&self.moved, "moved")] {
            log_failure(topic.async_publish(clear_markers(&header)).await.is_err(), name);
        }
    }

    async fn publish_rest(&self, products: &LiveProducts, header: &Header) {
        let unseen = unseen_markers(products, header);
        log_failure(self.unseen.async_publish(unseen).await.is_err(), "unseen");
        if let Some(pose) = next_view(products, header) {
            log_failure(self.next_view.async_publish(pose).await.is_err(), "next_view");
        }
        if let Some(moved) = moved_markers(products, header) {
            log_failure(self.moved.async_publish(moved).await.is_err(), "moved");
        }
    }
}

impl Sent {
    /// Records which chunks have changed.
    fn note_changes(&mut self, products: &LiveProducts) {
        for chunk in &products.chunks {
            if self.versions.get(&chunk.id) != Some(&chunk.version) {
                self.waiting.entry(chunk.id).or_insert(products.kept);
            }
        }
        let there: BTreeMap<i32, &Arc<MeshChunk>> = by_number(products);
        let gone = self.versions.keys().filter(|id| !there.contains_key(id));
        let gone: Vec<i32> = gone.copied().collect();
        for id in gone {
            self.waiting.entry(id).or_insert(products.kept);
        }
    }

    /// The next message, with the longest waiting chunks first, and its delay; without changes, repeated
    /// surface.
    fn next(&mut self, products: &LiveProducts, header: &Header) -> Option<(MarkerArray, Duration)> {
        let there = by_number(products);
        let mut order: Vec<(Instant, i32)> = self.waiting.iter().map(|(id, at)| (*at, *id)).collect();
        order.sort_unstable();
        let delay = order.first().map_or(Duration::ZERO, |(at, _)| at.elapsed());
        let mut ids: Vec<i32> = order.into_iter().map(|(_, id)| id).collect();
        let is_again = ids.is_empty();
        if is_again {
            let (last, pause) = self.again;
            self.again.1 = (pause + 1) % PAUSE;
            let rounds = AGAIN.as_millis() / (TICK * PAUSE).as_millis();
            let count = if pause == 0 { there.len().div_ceil(rounds as usize) } else { 0 };
            ids = there.range(last + 1..).map(|(id, _)| *id).take(count).collect();
            if pause == 0 && ids.is_empty() {
                self.again.0 = 0;
            }
        }
        let mut markers = Vec::new();
        let mut bytes = 0;
        for id in ids {
            if bytes >= MESSAGE_BYTES {
                break;
            }
            self.waiting.remove(&id);
            if is_again {
                self.again.0 = id;
            }
            if let Some(chunk) = there.get(&id) {
                self.versions.insert(id, chunk.version);
                bytes += chunk_bytes(chunk);
                markers.push(chunk_marker(chunk, header));
            } else {
                self.versions.remove(&id);
                markers.push(gone_chunk(id, header));
            }
        }
        (!markers.is_empty()).then_some((MarkerArray { markers }, delay))
    }
}

fn by_number(products: &LiveProducts) -> BTreeMap<i32, &Arc<MeshChunk>> {
    products.chunks.iter().map(|c| (c.id, c)).collect()
}

/// Header with the stamp of the newest view and the frame.
fn header_of_products(products: &LiveProducts) -> Header {
    Header { stamp: Time::from_nanos(products.stamp_nanos), frame_id: products.world_frame.clone() }
}

fn log_failure(failed: bool, what: &str) {
    if failed {
        log::debug!("{what} could not be published");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live_map::MapKey;
    use geometry::{Intrinsics, Pose};
    use io::ros2msg::markers::action;
    use surface::{TriangleMesh, Unseen};

    fn products(chunks: &[(i32, u64, usize)]) -> LiveProducts {
        let mesh = |triangles: usize| TriangleMesh {
            vertices: vec![nalgebra::Point3::origin(); 3],
            triangles: vec![[0, 1, 2]; triangles],
            colors: vec![[9; 3]; 3],
        };
        let chunk = |&(id, version, triangles): &(i32, u64, usize)| {
            Arc::new(MeshChunk { id, version, mesh: mesh(triangles) })
        };
        LiveProducts {
            key: MapKey::default(),
            stamp_nanos: 5,
            kept: Instant::now(),
            world_frame: "map".into(),
            chunks: chunks.iter().map(chunk).collect(),
            unseen: Unseen::default(),
            next_view: None,
            moved: None,
            intrinsics: Intrinsics { width: 4, height: 3, fx: 4.0, fy: 4.0, cx: 1.5, cy: 1.0 },
            fused: 1,
            unusable: 0,
            spacing_m: 0.01,
            bytes: 1,
            secs: 0.1,
        }
    }

    /// Numbers and actions of the markers of the next messages until nothing waits.
    fn all(sent: &mut Sent, products: &LiveProducts) -> Vec<Vec<(i32, i32)>> {
        let mut messages = Vec::new();
        while !sent.waiting.is_empty() {
            let (message, _) = sent.next(products, &header_of_products(products)).unwrap();
            messages.push(message.markers.iter().map(|m| (m.id, m.action)).collect());
        }
        messages
    }

    #[test]
    fn what_changed_is_sent_once_and_what_is_gone_is_taken_away() {
        let mut sent = Sent::default();
        let first = products(&[(1, 1, 2), (2, 1, 2), (3, 1, 2)]);
        sent.note_changes(&first);
        assert_eq!(all(&mut sent, &first), [[(1, 0), (2, 0), (3, 0)]]);
        let second = products(&[(1, 1, 2), (2, 2, 0), (4, 2, 1)]);
        sent.note_changes(&second);
        assert_eq!(all(&mut sent, &second), [[(2, action::DELETE), (3, action::DELETE), (4, 0)]]);
        sent.note_changes(&second);
        assert!(sent.waiting.is_empty());
    }

    #[test]
    fn messages_are_small_and_all_is_sent_again() {
        let mut sent = Sent::default();
        let many: Vec<(i32, u64, usize)> = (1..=100).map(|id| (id, 1, 300)).collect();
        let products = products(&many);
        sent.note_changes(&products);
        let messages = all(&mut sent, &products);
        let largest = messages.iter().map(Vec::len).max().unwrap() * chunk_bytes(&products.chunks[0]);
        assert!(messages.len() > 20 && largest < 2 * MESSAGE_BYTES, "{} {largest}", messages.len());
        // One tick after the other for as long as all of it may take.
        let ticks = (AGAIN.as_millis() / TICK.as_millis()) as usize;
        let again = (0..ticks).filter_map(|_| sent.next(&products, &header_of_products(&products)));
        let ids: std::collections::BTreeSet<i32> = again.flat_map(|(m, _)| m.markers).map(|m| m.id).collect();
        assert_eq!(ids.len(), 100);
    }

    #[test]
    fn what_is_drawn_is_drawn_whole() {
        let mut p = products(&[(1, 1, 2)]);
        let header = header_of_products(&p);
        let marker = chunk_marker(&p.chunks[0], &header);
        assert_eq!((marker.points.len(), marker.colors.len(), marker.header.stamp.nanosec), (6, 6, 5));
        assert_eq!(moved_markers(&p, &header), None);
        assert!(next_view(&p, &header).is_none());
        // Without points a marker would be refused.
        let nothing = unseen_markers(&p, &header).markers;
        assert!(nothing.iter().all(|m| m.action == action::DELETE));
        p.unseen.patches.push(surface::UnseenPatch {
            center: nalgebra::Point3::new(1.0, 0.0, 0.0),
            normal: nalgebra::Vector3::x(),
            area_m2: 0.04,
        });
        p.next_view =
            Some(surface::NextView { world_from_camera: Pose::translation(0.0, 0.0, 1.0), gain_m2: 0.1 });
        p.moved = Some(surface::Moved::default());
        let shown = unseen_markers(&p, &header).markers;
        assert_eq!(shown.iter().map(|m| m.points.len()).collect::<Vec<_>>(), [6, 16]);
        let corner = &shown[0].points[0];
        assert!((corner.y.abs() - 0.1).abs() < 1e-12 && (corner.z.abs() - 0.1).abs() < 1e-12);
        assert!((next_view(&p, &header).unwrap().pose.translation.z - 1.0).abs() < 1e-12);
        assert!(moved_markers(&p, &header).unwrap().markers.iter().all(|m| m.action == action::DELETE));
    }
}
