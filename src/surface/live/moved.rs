//! What moved between two states: surface of one where the other saw nothing.
//!
//! The idea of `capture::isolate`, for views that come one by one: two views of the other state read
//! something clearly behind a piece of surface, four times as many as read anything about it.

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::{live_mesh::MeshChunk, sight_map::SightMap};
use crate::{TriangleMesh, merge};
use capture::{CLEARLY, LEAST_PATCH, cell, clusters};

/// Views of each state that must agree, as there.
/// derived: one reading may be wrong
const LEAST_VIEWS: u8 = 2;
/// What moved since the state before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moved {
    /// Surface of the present state where the one before was empty.
    pub appeared: TriangleMesh,
    /// Surface of the state before where the present one is empty.
    pub gone: TriangleMesh,
}

impl Moved {
    /// Areas of what appeared and of what is gone, square meters.
    #[must_use]
    pub fn areas_m2(&self) -> [f64; 2] {
        [self.appeared.area_m2(), self.gone.area_m2()]
    }
}

/// Whether a state saw space empty about a point: in its cell, and in the six next to it, as a pose that is
/// off moves the rim of what it sees sideways.
fn is_empty(sight: &SightMap, point: &Point3<f64>) -> bool {
    let Some(at) = cell(point, sight.cell_m()) else { return false };
    let is_seen_through = |c: [i32; 3]| {
        let seen = sight.of(c);
        seen.empty >= LEAST_VIEWS && usize::from(seen.empty) >= CLEARLY * usize::from(seen.filled)
    };
    let beside = |axis: usize, step: i32| {
        let mut other = at;
        other[axis] += step;
        other
    };
    is_seen_through(at) && (0..3).all(|k| [-1, 1].into_iter().all(|step| is_seen_through(beside(k, step))))
}

/// Triangles of one state's surface, of cells so wide, that are in space which the other state saw empty.
pub(super) fn changed<'a>(
    surface: impl Iterator<Item = &'a MeshChunk>,
    spacing_m: f64,
    own: &SightMap,
    other: &SightMap,
) -> TriangleMesh {
    // No finer than the surface, whose neighboring triangles would not hang together.
    let size_m = other.cell_m().max(spacing_m);
    let mut found = Vec::new();
    for chunk in surface {
        for triangle in 0..chunk.mesh.triangles.len() {
            let middle = chunk.mesh.middle(triangle);
            if own.at(&middle).filled >= LEAST_VIEWS && is_empty(other, &middle) {
                found.extend(cell(&middle, size_m).map(|c| (c, chunk, triangle)));
            }
        }
    }
    let cells: BTreeSet<[i32; 3]> = found.iter().map(|f| f.0).collect();
    let cells: Vec<[i32; 3]> = cells.into_iter().collect();
    let kept: BTreeSet<[i32; 3]> =
        clusters(&cells, 1).into_iter().filter(|patch| patch.len() >= LEAST_PATCH).flatten().collect();
    let pieces = found.iter().filter(|f| kept.contains(&f.0)).map(|(_, chunk, triangle)| {
        let vertices = chunk.mesh.corners(*triangle).to_vec();
        TriangleMesh { vertices, triangles: vec![[0, 1, 2]], colors: Vec::new() }
    });
    let pieces: Vec<TriangleMesh> = pieces.collect();
    merge(&pieces.iter().collect::<Vec<_>>())
}
