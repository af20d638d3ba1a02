//! The map of a state, and its queries.

use std::sync::Arc;

use super::{
    block_map::BlockMap,
    clearance::Clearance,
    eyes::Eyes,
    live_mesh::{LiveMesh, MeshChunk},
    moved::{Moved, changed_surface},
    next_view::{NextView, next_view},
    region::Region,
    sight_map::SightMap,
    unseen::{Unseen, unseen_of_region},
    view_depth::ViewDepth,
};
use crate::{TriangleMesh, merged_mesh};
use capture::{NoiseConfig, RgbdFrame};

/// Least and largest initial distance between nodes, meters.
/// chosen: finer than 5 mm shows the eye no more of an object; with 20 mm a drawer still has its front
const SPACING_M: [f64; 2] = [0.005, 0.02];
/// Least truncation distance, in spacings and in standard deviations of a reading.
/// derived: that of the pipeline's fusion (`SurfaceConfig::truncation_m`), and two cells on each side for
/// marching cubes of every second node
const TRUNCATION: f64 = 4.0;
/// Initial side of a cell of seen space, in spacings. chosen: space needs no finer cells than surface
const CELL: f64 = 2.0;

/// Settings of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveSettings {
    /// The sensor's noise.
    pub noise: NoiseConfig,
    /// Memory limit of the map, bytes; at least [`LiveSettings::LEAST_BYTES`].
    pub most_bytes: usize,
}

impl LiveSettings {
    /// Least useful memory limit.
    /// derived: a fifth of it holds the largest mesh
    pub const LEAST_BYTES: usize = 4 << 20;
}

/// A map of one state.
struct StateMap {
    blocks: BlockMap,
    sight: SightMap,
    mesh: LiveMesh,
    eyes: Eyes,
    /// Standard deviation of a reading at the first view's median depth, meters.
    sigma_m: f64,
}

/// What is kept of the first state.
struct Before {
    chunks: Vec<Arc<MeshChunk>>,
    spacing_m: f64,
    sight: SightMap,
}

/// The map of the present state, and what is kept of the first one.
///
/// The same views in the same order give the same bytes. Memory is bounded: when the bound is reached, the
/// spacing doubles; seen surface and space stay. The work runs in the Rayon pool of the calling thread; a
/// pool of one keeps it on this thread.
pub struct LiveMap {
    settings: LiveSettings,
    now: Option<StateMap>,
    before: Option<Before>,
}

impl LiveMap {
    /// An empty map.
    pub fn new(settings: LiveSettings) -> Self {
        Self { settings, now: None, before: None }
    }

    /// Begins another state in the same world: the map of the first one is kept for comparison.
    pub fn begin_state(&mut self) {
        let Some(mut map) = self.now.take() else { return };
        if self.before.is_some() {
            return;
        }
        map.refresh_mesh();
        while map.sight.bytes() > self.share_of_memory(8) {
            map.sight.coarsen();
        }
        let chunks = map.mesh.chunks().cloned().collect();
        self.before = Some(Before { chunks, spacing_m: map.spacing_m(), sight: map.sight });
    }

    /// One `part`th of the memory limit, bytes.
    fn share_of_memory(&self, part: usize) -> usize {
        self.settings.most_bytes.max(LiveSettings::LEAST_BYTES) / part
    }

    /// Adds a view. If it has a mask, only the surface of its object counts. Returns whether the view was
    /// taken: not if it reads no depth, or if its sizes, camera or pose make no sense.
    pub fn add_view(&mut self, frame: &RgbdFrame) -> bool {
        let Some(view) = ViewDepth::new(frame, &self.settings.noise) else { return false };
        // Half is for surfaces, an eighth each for space seen now and before, and the rest for the mesh and
        // temporary data.
        let most_blocks = self.share_of_memory(2);
        let most_sight = self.share_of_memory(8);
        let map = self.now.get_or_insert_with(|| StateMap::new(&view));
        loop {
            let clearance = Clearance::new(&view, map.sight.cell_m());
            let (looks, new_sight) = map.sight.looks_of_view(&view, &clearance);
            let (keys, new_blocks) = map.blocks.blocks_about(&view);
            let sight_bytes = map.sight.bytes() + SightMap::bytes_of(new_sight);
            let block_bytes = map.blocks.bytes() + BlockMap::bytes_of(new_blocks);
            if sight_bytes > most_sight {
                map.sight.coarsen();
                continue;
            }
            if block_bytes > most_blocks {
                map.coarsen();
                continue;
            }
            map.sight.add_looks(&looks);
            map.blocks.allocate(&keys);
            let changed = map.blocks.integrate(&view, &clearance);
            map.mesh.mark_changed(&changed);
            map.eyes.remember_view(&view);
            return true;
        }
    }

    /// Makes the surface again where it changed since the last call.
    pub fn refresh(&mut self) {
        if let Some(map) = &mut self.now {
            map.refresh_mesh();
        }
    }

    /// The surface in chunks, ordered by position, as [`Self::refresh`] left it.
    pub fn chunks(&self) -> impl Iterator<Item = &Arc<MeshChunk>> {
        self.now.iter().flat_map(|map| map.mesh.chunks())
    }

    /// The surface as one mesh, as [`Self::refresh`] left it; its triangles are not joined across chunks.
    pub fn mesh(&self) -> TriangleMesh {
        merged_mesh(&self.chunks().map(|c| &c.mesh).collect::<Vec<_>>())
    }

    /// The unseen part of the region of the views, and the next view if one is worth taking; `None` before
    /// the first view.
    pub fn unseen_and_next(&self) -> Option<(Unseen, Option<NextView>)> {
        let map = self.now.as_ref()?;
        let region = Region::new(&map.eyes, &map.sight)?;
        let seen_m2: f64 = map
            .mesh
            .chunks()
            .flat_map(|c| (0..c.mesh.triangles.len()).map(|t| (&c.mesh, t)))
            .filter(|(mesh, t)| region.holds(&mesh.middle_of(*t)))
            .map(|(mesh, t)| 0.5 * f64::from(mesh.area_normal(t).norm()))
            .fold(0.0, |sum, area| sum + area);
        let unseen = unseen_of_region(&region, seen_m2);
        let next = next_view(&region, &map.sight, unseen.area_m2 + seen_m2);
        Some((unseen, next))
    }

    /// The surface that moved since the first state; `None` where there is no such state, or the present one
    /// has no view.
    pub fn moved_surface(&self) -> Option<Moved> {
        let map = self.now.as_ref()?;
        let before = self.before.as_ref()?;
        Some(Moved {
            appeared: changed_surface(
                map.mesh.chunks().map(AsRef::as_ref),
                map.spacing_m(),
                &map.sight,
                &before.sight,
            ),
            gone: changed_surface(
                before.chunks.iter().map(AsRef::as_ref),
                before.spacing_m,
                &before.sight,
                &map.sight,
            ),
        })
    }

    /// Gain of a view from a pose, square meters.
    #[cfg(test)]
    pub(super) fn gain_m2(&self, world_from_camera: &geometry::Pose) -> Option<f64> {
        let map = self.now.as_ref()?;
        Some(super::next_view::gain_m2(&Region::new(&map.eyes, &map.sight)?, world_from_camera))
    }

    /// Number of accepted views of the present state.
    pub fn view_count(&self) -> usize {
        self.now.as_ref().map_or(0, |map| map.eyes.count)
    }

    /// Distance between the nodes of the surface, meters; 0 before the first view.
    pub fn spacing_m(&self) -> f64 {
        self.now.as_ref().map_or(0.0, StateMap::spacing_m)
    }

    /// Memory of the maps, bytes.
    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks().map(|c| mesh_bytes(&c.mesh)).sum();
        let now = self.now.as_ref().map_or(0, |map| map.blocks.bytes() + map.sight.bytes());
        let before = self
            .before
            .as_ref()
            .map_or(0, |b| b.sight.bytes() + b.chunks.iter().map(|c| mesh_bytes(&c.mesh)).sum::<usize>());
        now + chunks + before
    }
}

/// Memory of a mesh with colors, bytes.
fn mesh_bytes(mesh: &TriangleMesh) -> usize {
    mesh.vertices.len() * 15 + mesh.triangles.len() * 12
}

impl StateMap {
    /// A map for a first view, as fine as its readings.
    fn new(view: &ViewDepth) -> Self {
        let sigma_m = view.noise.sigma_m(view.median_m);
        // Nodes finer than the pixels or their noise would lack readings.
        let spacing_m = sigma_m.max(view.pixel_m(view.median_m)).clamp(SPACING_M[0], SPACING_M[1]);
        Self {
            blocks: BlockMap::new(spacing_m, truncation_m(spacing_m, sigma_m)),
            sight: SightMap::new(CELL * spacing_m),
            mesh: LiveMesh::new(),
            eyes: Eyes::new(view.frame.intrinsics),
            sigma_m,
        }
    }

    /// Distance between the nodes of the surface within the ball of the views, meters.
    fn spacing_m(&self) -> f64 {
        self.blocks.spacing_m() * self.mesh.stride() as f64
    }

    fn refresh_mesh(&mut self) {
        let ball = self.eyes.focus_ball().map(|(focus, radius_m)| (focus.point, radius_m));
        self.mesh.refresh(&self.blocks, ball);
    }

    fn coarsen(&mut self) {
        self.blocks.coarsen(truncation_m(2.0 * self.blocks.spacing_m(), self.sigma_m));
        self.mesh.begin_coarser(&self.blocks);
    }
}

fn truncation_m(spacing_m: f64, sigma_m: f64) -> f64 {
    TRUNCATION * spacing_m.max(sigma_m)
}
