//! The surface that moved between two states: surface of one in empty space of the other.
//!
//! As in `capture::isolate`, but with views one by one: at least two views of the other state must read
//! something clearly behind a piece of surface, four times as many as read anything near it.

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::{
    live_mesh::MeshChunk,
    sight_map::{SightCount, SightMap},
};
use crate::{TriangleMesh, merged_mesh};
use capture::{CLEARLY, LEAST_PATCH, cell_of_point, clusters_of_cells};

/// Least number of agreeing views of each state, as there.
/// derived: one reading may be wrong
const LEAST_VIEWS: u8 = 2;
/// The moved surface since the state before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// Surface of the present state where the one before was empty.
    pub appeared: TriangleMesh,
    /// Surface of the state before where the present one is empty.
    pub gone: TriangleMesh,
}

impl Moved {
    /// Areas of the appeared and of the gone surface, square meters.
    pub fn areas_m2(&self) -> [f64; 2] {
        [self.appeared.area_m2(), self.gone.area_m2()]
    }
}

/// Whether a state saw the space around a point empty: its cell and the six neighbors, as a wrong pose shifts
/// the rim of the seen surface sideways.
fn is_empty(sight: &SightMap, point: &Point3<f64>) -> bool {
    let Some(at) = cell_of_point(point, sight.cell_m()) else { return false };
    if !is_seen_through(sight.count_of_cell(at)) {
        return false;
    }
    let steps = (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]);
    let mut beside = steps.map(|(axis, step)| {
        let mut other = at;
        other[axis] += step;
        other
    });
    beside.all(|c| is_seen_through(sight.count_of_cell(c)))
}

fn is_seen_through(seen: SightCount) -> bool {
    seen.empty >= LEAST_VIEWS && usize::from(seen.empty) >= CLEARLY * usize::from(seen.filled)
}

/// Triangles of one state's surface (cells of the given size) in space that the other state saw empty.
pub(super) fn changed_surface<'a>(
    surface: impl Iterator<Item = &'a MeshChunk>,
    spacing_m: f64,
    own: &SightMap,
    other: &SightMap,
) -> TriangleMesh {
    // No finer than the surface: neighboring triangles would fall apart.
    let size_m = other.cell_m().max(spacing_m);
    let mut found = Vec::new();
    for chunk in surface {
        for triangle in 0..chunk.mesh.triangles.len() {
            let middle = chunk.mesh.middle_of(triangle);
            if own.count_at_point(&middle).filled >= LEAST_VIEWS && is_empty(other, &middle) {
                found.extend(cell_of_point(&middle, size_m).map(|c| (c, chunk, triangle)));
            }
        }
    }
    let cells: BTreeSet<[i32; 3]> = found.iter().map(|f| f.0).collect();
    let cells: Vec<[i32; 3]> = cells.into_iter().collect();
    let kept: BTreeSet<[i32; 3]> = clusters_of_cells(&cells, 1)
        .into_iter()
        .filter(|patch| patch.len() >= LEAST_PATCH)
        .flatten()
        .collect();
    let pieces = found.iter().filter(|f| kept.contains(&f.0)).map(|(_, chunk, triangle)| {
        let vertices = chunk.mesh.corners(*triangle).to_vec();
        TriangleMesh { vertices, triangles: vec![[0, 1, 2]], colors: Vec::new() }
    });
    let pieces: Vec<TriangleMesh> = pieces.collect();
    merged_mesh(&pieces.iter().collect::<Vec<_>>())
}
