//! The live map of a state during collection, in its own thread. It receives kept views and computes the
//! observed surface, unseen space, the next view and moved surface. Nothing waits for it: a view that finds
//! the queue full is missing in the map, but not in the recording.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    time::{Duration, Instant},
};

use tokio::sync::watch;

use capture::RgbdFrame;
use geometry::Intrinsics;
use surface::{LiveMap, LiveSettings, MeshChunk, Moved, NextView, Unseen};

/// Queue length for views: one that finds it full is missing from the map for good.
/// chosen: images of 640x480 take 20 MB; at a quarter of a second each, a burst is fused within 2 s
const WAITING: usize = 8;

/// Identifies the map to which a view belongs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct MapKey {
    /// Number of the session.
    pub session: u64,
    /// Number of states started so far; it increases with each state.
    pub begun: u64,
    /// Index of the state.
    pub state: usize,
    /// Number of the tracking map; `None` if poses were given, all in one world.
    pub tracked: Option<u64>,
}

impl MapKey {
    /// Whether a state `next` can be compared with earlier views.
    fn goes_on(&self, next: &Self) -> bool {
        self.session == next.session && self.tracked == next.tracked && next.state == 1
    }
}

/// A kept view for the map.
pub(crate) struct KeptView {
    /// Map it belongs to.
    pub key: MapKey,
    /// Time at which it was kept.
    pub kept: Instant,
    /// Name of the coordinate frame of its pose.
    pub world_frame: String,
    /// Its pixels and pose.
    pub frame: RgbdFrame,
}

/// Current contents of the map.
pub(crate) struct LiveProducts {
    /// Map it belongs to.
    pub key: MapKey,
    /// Stamp of the newest view, nanoseconds.
    pub stamp_nanos: i64,
    /// Time at which the oldest of the new views was kept.
    pub kept: Instant,
    /// Frame of all contents.
    pub world_frame: String,
    /// Observed surface.
    pub chunks: Vec<Arc<MeshChunk>>,
    /// Unseen space.
    pub unseen: Unseen,
    /// The best next view.
    pub next_view: Option<NextView>,
    /// Moved surface, if there is another state.
    pub moved: Option<Moved>,
    /// Camera intrinsics, for drawing it.
    pub intrinsics: Intrinsics,
    /// Number of fused views.
    pub fused: usize,
    /// Number of views without usable depth.
    pub unusable: u64,
    /// Grid spacing of the surface, meters.
    pub spacing_m: f64,
    /// Memory of the map, bytes.
    pub bytes: usize,
    /// Time for the last view, seconds.
    pub secs: f64,
}

/// Status of the live map, for `/diagnostics`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LiveStatus {
    /// Number of fused views of the current state.
    pub fused: usize,
    /// Number of views dropped because the map was busy, since the start of the node.
    pub left_out: u64,
    /// Number of views without usable depth.
    pub unusable: u64,
    /// Longest delay from keeping a view to publishing its surface, within the last second, seconds.
    pub behind_secs: f64,
    /// Unseen share of the viewed space; `None` before the first view.
    pub unseen: Option<f64>,
    /// Unseen area, square meters.
    pub unseen_m2: f64,
    /// Area that appeared and that is gone since state 0, square meters.
    pub moved_m2: Option<[f64; 2]>,
    /// Grid spacing of the surface, meters.
    pub spacing_m: f64,
    /// Memory of the map, bytes.
    pub bytes: usize,
    /// Time for the last view, seconds.
    pub secs: f64,
}

/// Counters shared with other threads.
#[derive(Debug, Default)]
pub(crate) struct LiveCounts {
    left_out: AtomicU64,
    behind_micros: AtomicU64,
}

impl LiveCounts {
    /// Sets the longest delay from keeping a view to publishing its surface.
    pub(crate) fn set_behind(&self, time: Duration) {
        self.behind_micros.store(u64::try_from(time.as_micros()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
}

/// Output of the live map.
#[derive(Clone)]
pub(crate) struct LiveResults {
    /// Contents of the map; they are of an earlier state if `begun` exceeds that of their key.
    pub products: watch::Receiver<Option<Arc<LiveProducts>>>,
    /// Number of states started so far.
    pub begun: watch::Receiver<u64>,
    /// Counts.
    pub counts: Arc<LiveCounts>,
}

/// Input queue of the live map; the thread ends when it is dropped.
pub(crate) struct LiveQueue {
    views: SyncSender<KeptView>,
    begun: watch::Sender<u64>,
    results: LiveResults,
}

impl LiveQueue {
    /// Sends a view, unless the map is busy.
    pub(crate) fn offer_view(&self, view: KeptView) {
        if self.views.try_send(view).is_err() {
            self.results.counts.left_out.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Announces a new state or session; the current contents are then outdated.
    pub(crate) fn begin_map(&self) -> u64 {
        self.begun.send_modify(|n| *n += 1);
        *self.begun.borrow()
    }

    /// The outputs of the map.
    pub(crate) fn results(&self) -> LiveResults {
        self.results.clone()
    }

    /// The current status.
    pub(crate) fn status(&self) -> LiveStatus {
        let counts = &self.results.counts;
        let status = LiveStatus {
            left_out: counts.left_out.load(Ordering::Relaxed),
            behind_secs: counts.behind_micros.load(Ordering::Relaxed) as f64 * 1e-6,
            ..LiveStatus::default()
        };
        let products = self.results.products.borrow();
        let Some(p) = products.as_ref().filter(|p| p.key.begun == *self.begun.borrow()) else {
            return status;
        };
        LiveStatus {
            fused: p.fused,
            unusable: p.unusable,
            unseen: Some(p.unseen.unseen_share()),
            unseen_m2: p.unseen.area_m2,
            moved_m2: p.moved.as_ref().map(Moved::areas_m2),
            spacing_m: p.spacing_m,
            bytes: p.bytes,
            secs: p.secs,
            ..status
        }
    }
}

/// Starts the thread; it is idle while `is_read` says that a reconstruction reads the session.
///
/// # Errors
/// If no thread can be created.
pub(crate) fn start_thread(
    settings: LiveSettings,
    is_read: impl Fn() -> bool + Send + 'static,
) -> std::io::Result<LiveQueue> {
    let (views, inbox) = sync_channel(WAITING);
    let (begun, begun_receiver) = watch::channel(0);
    let (sender, products) = watch::channel(None);
    let counts = Arc::new(LiveCounts::default());
    let results = LiveResults { products, begun: begun_receiver, counts: Arc::clone(&counts) };
    std::thread::Builder::new().name("live_map".into()).spawn(move || {
        // A pool with only this thread, so that parallel work uses one core.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
        if let Err(error) = &pool {
            log::warn!("the live map takes all cores: {error}");
        }
        let mut mapper = Mapper::new(settings);
        while let Some(found) = mapper.next(&inbox, &is_read, &counts) {
            sender.send_replace(found.map(Arc::new));
        }
    })?;
    Ok(LiveQueue { views, begun, results })
}

/// Fuses views into their maps.
pub(crate) struct Mapper {
    settings: LiveSettings,
    map: LiveMap,
    key: MapKey,
    unusable: u64,
}

impl Mapper {
    /// A mapper without views.
    pub(crate) fn new(settings: LiveSettings) -> Self {
        Self { settings, map: LiveMap::new(settings), key: MapKey::default(), unusable: 0 }
    }

    /// Waits for views and fuses those present. Returns the contents (`None` inside if no view was usable),
    /// or `None` once all senders are gone.
    fn next(
        &mut self,
        inbox: &Receiver<KeptView>,
        is_read: &impl Fn() -> bool,
        counts: &LiveCounts,
    ) -> Option<Option<LiveProducts>> {
        let first = inbox.recv().ok()?;
        let start = Instant::now();
        let kept = first.kept;
        let mut views = 0;
        let mut last = None;
        // All waiting views are drawn together, but no more, so that they do get drawn.
        for view in std::iter::once(first).chain(inbox.try_iter().take(WAITING)) {
            // A reconstruction needs the CPU.
            if is_read() {
                counts.left_out.fetch_add(1, Ordering::Relaxed);
                continue;
            }
            views += 1;
            last = Some((view.frame.stamp_nanos, view.world_frame.clone(), view.frame.intrinsics));
            self.add_view(view);
        }
        let Some((stamp_nanos, world_frame, intrinsics)) = last else { return Some(None) };
        Some(self.map_products(kept, stamp_nanos, world_frame, intrinsics, || {
            start.elapsed().as_secs_f64() / f64::from(views)
        }))
    }

    /// Fuses a view.
    pub(crate) fn add_view(&mut self, view: KeptView) {
        if view.key != self.key {
            if self.key.goes_on(&view.key) && self.map.view_count() > 0 {
                self.map.begin_state();
            } else {
                self.map = LiveMap::new(self.settings);
            }
            self.key = view.key;
            self.unusable = 0;
        }
        self.unusable += u64::from(!self.map.add_view(&view.frame));
    }

    /// The current contents; `None` without views.
    fn map_products(
        &mut self,
        kept: Instant,
        stamp_nanos: i64,
        world_frame: String,
        intrinsics: Intrinsics,
        secs: impl Fn() -> f64,
    ) -> Option<LiveProducts> {
        self.map.refresh();
        let (unseen, next_view) = self.map.unseen_and_next()?;
        Some(LiveProducts {
            key: self.key,
            stamp_nanos,
            kept,
            world_frame,
            chunks: self.map.chunks().cloned().collect(),
            unseen,
            next_view,
            moved: self.map.moved_surface(),
            intrinsics,
            fused: self.map.view_count(),
            unusable: self.unusable,
            spacing_m: self.map.spacing_m(),
            bytes: self.map.bytes(),
            secs: secs(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;

    fn view(frame: &RgbdFrame, key: MapKey) -> KeptView {
        KeptView { key, kept: Instant::now(), world_frame: "map".into(), frame: frame.clone() }
    }

    /// A wall at 1 m.
    fn wall() -> RgbdFrame {
        let intrinsics = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 };
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 7,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: vec![[1, 2, 3]; 64 * 48],
            depth_m: vec![1.0; 64 * 48],
            mask: None,
            readings: Vec::new(),
        }
    }

    const SETTINGS: LiveSettings = LiveSettings { noise: NOISE, most_bytes: 64 << 20 };
    const NOISE: capture::NoiseConfig = capture::NoiseConfig {
        constant_m: 0.0005,
        quadratic_per_m: 0.0025,
        edge_sigmas: 6.0,
        grazing_cosine: 0.15,
    };

    #[test]
    fn states_are_compared_in_one_world_alone() {
        let key = |session, begun, state, tracked| MapKey { session, begun, state, tracked };
        let compared = |keys: &[MapKey]| {
            let mut mapper = Mapper::new(SETTINGS);
            keys.iter().for_each(|k| mapper.add_view(view(&wall(), *k)));
            mapper.map.moved_surface().is_some()
        };
        assert!(compared(&[key(0, 1, 0, None), key(0, 2, 1, None)]));
        assert!(compared(&[key(0, 1, 0, None), key(0, 2, 1, None), key(0, 3, 1, None)]));
        assert!(!compared(&[key(0, 1, 0, None), key(0, 2, 0, None)]));
        assert!(!compared(&[key(0, 1, 0, None), key(1, 2, 1, None)]));
        assert!(!compared(&[key(0, 1, 0, Some(1)), key(0, 2, 1, Some(2))]));
        assert!(compared(&[key(0, 1, 0, Some(1)), key(0, 2, 1, Some(1))]));
        assert!(!compared(&[key(0, 2, 1, None)]));
    }

    #[test]
    fn a_view_that_finds_no_room_is_counted_and_a_run_stops_the_map() {
        let (views, inbox) = sync_channel(1);
        let (begun, begun_receiver) = watch::channel(0);
        let (_sender, products) = watch::channel(None);
        let counts = Arc::new(LiveCounts::default());
        let results = LiveResults { products, begun: begun_receiver, counts: Arc::clone(&counts) };
        let queue = LiveQueue { views, begun, results };
        queue.offer_view(view(&wall(), MapKey::default()));
        queue.offer_view(view(&wall(), MapKey::default()));
        assert_eq!(queue.status().left_out, 1);
        let mut mapper = Mapper::new(SETTINGS);
        let found = mapper.next(&inbox, &|| false, &counts).unwrap().unwrap();
        assert_eq!((found.fused, found.stamp_nanos), (1, 7));
        assert!(found.chunks.iter().any(|c| !c.mesh.is_empty()));
        queue.offer_view(view(&wall(), MapKey::default()));
        assert!(mapper.next(&inbox, &|| true, &counts).unwrap().is_none());
        assert_eq!((queue.status().left_out, mapper.map.view_count()), (2, 1));
        drop(queue);
        assert!(mapper.next(&inbox, &|| false, &counts).is_none());
    }

    #[test]
    #[ignore = "measures: needs a recording, named by ARTITWIN_BAG"]
    fn what_a_view_of_a_recording_takes() {
        let bag = std::path::PathBuf::from(std::env::var_os("ARTITWIN_BAG").unwrap());
        let config = capture::CaptureConfig::default();
        let states = [bag.join("state0"), bag.join("state1")];
        let ahead = common::ahead::Ahead::default();
        let monitor = run::Monitor::silent();
        let capture = run::capture::open(&states, &config, 0, &ahead, &monitor).unwrap();
        let work = || {
            for with_mask in [true, false] {
                let mut mapper = Mapper::new(SETTINGS);
                for (state, frames) in capture.states.iter().enumerate() {
                    let mut millis = Vec::new();
                    for frame in frames {
                        let key = MapKey { begun: state as u64, state, ..MapKey::default() };
                        let mut view = view(frame, key);
                        view.frame.mask = view.frame.mask.filter(|_| with_mask);
                        let start = Instant::now();
                        mapper.add_view(view);
                        let fused = start.elapsed();
                        mapper.map.refresh();
                        let drawn = start.elapsed();
                        let _ = mapper.map.unseen_and_next();
                        let looked = start.elapsed();
                        let _ = mapper.map.moved_surface();
                        millis.push([fused, drawn - fused, looked - drawn, start.elapsed() - looked]);
                    }
                    let of = |k: usize| {
                        let mut all: Vec<f64> = millis.iter().map(|m| m[k].as_secs_f64() * 1e3).collect();
                        all.sort_by(f64::total_cmp);
                        (all[all.len() / 2].round(), all[all.len() - 1].round())
                    };
                    let (unseen, next) = mapper.map.unseen_and_next().unwrap();
                    eprintln!(
                        "mask {with_mask} {state}: fuse {:?} draw {:?} look {:?} moved {:?} ms (median, \
                         most); {} triangles at {:.1} mm, {:.1} MB, unseen {:.3} m2 ({:.2}), next {:.3}, \
                         moved {:?} m2",
                        of(0),
                        of(1),
                        of(2),
                        of(3),
                        mapper.map.mesh().triangles.len(),
                        mapper.map.spacing_m() * 1e3,
                        mapper.map.bytes() as f64 / 1e6,
                        unseen.area_m2,
                        unseen.unseen_share(),
                        next.map_or(0.0, |n| n.gain_m2),
                        mapper.map.moved_surface().map(|m| m.areas_m2()),
                    );
                }
            }
        };
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work);
    }
}
