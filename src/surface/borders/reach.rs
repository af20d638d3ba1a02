//! Short distances along a surface.

use std::{cmp::Ordering, collections::BinaryHeap};

use crate::TriangleMesh;
use numeric::lists::Lists;

/// Neighbors of each vertex by sides, ascending.
pub(super) struct Neighbors(Lists<u32>);

impl Neighbors {
    pub(super) fn of_mesh(mesh: &TriangleMesh) -> Self {
        let pairs = mesh.sides().flat_map(|(p, q, _)| [(p, q), (q, p)]);
        Self(Lists::of_entries(mesh.vertices.len(), pairs).without_repeats())
    }

    pub(super) fn of_vertex(&self, vertex: u32) -> &[u32] {
        self.0.list_at(vertex)
    }

    pub(super) fn are_joined(&self, a: u32, b: u32) -> bool {
        self.of_vertex(a).binary_search(&b).is_ok()
    }
}

/// A search along the surface from some vertices; its buffers serve many searches.
pub(super) struct Reach<'a> {
    mesh: &'a TriangleMesh,
    neighbors: &'a Neighbors,
    /// Distance of every vertex, meters; infinite where the search did not arrive.
    distance_m: Vec<f64>,
    reached: Vec<u32>,
}

impl<'a> Reach<'a> {
    pub(super) fn new(mesh: &'a TriangleMesh, neighbors: &'a Neighbors) -> Self {
        let distance_m = vec![f64::INFINITY; mesh.vertices.len()];
        Self { mesh, neighbors, distance_m, reached: Vec::new() }
    }

    /// Vertices with a distance of at most `limit_m`, in the order of distance. `sources` are vertices with a
    /// start value each. A vertex gets the least sum of a start value and the straight distance to its
    /// source, among the sources connected to it from vertex to vertex. Over short ways on a smooth surface
    /// this is close to the distance along it, without the zigzag of edges.
    pub(super) fn vertices_within(&mut self, sources: &[(u32, f64)], limit_m: f64) -> &[u32] {
        for v in self.reached.drain(..) {
            self.distance_m[v as usize] = f64::INFINITY;
        }
        let position = |v: u32| self.mesh.vertices[v as usize].cast::<f64>();
        let mut queue: BinaryHeap<QueuedVertex> = sources
            .iter()
            .map(|&source| QueuedVertex { distance_m: source.1, vertex: source.0, source })
            .collect();
        while let Some(QueuedVertex { distance_m, vertex, source }) = queue.pop() {
            // Entries come in the order of distance: the first one settles the vertex.
            if self.distance_m[vertex as usize].is_finite() || distance_m > limit_m {
                continue;
            }
            self.distance_m[vertex as usize] = distance_m;
            self.reached.push(vertex);
            let from = position(source.0);
            for &n in self
                .neighbors
                .of_vertex(vertex)
                .iter()
                .filter(|&&n| self.distance_m[n as usize].is_infinite())
            {
                let distance_m = source.1 + (position(n) - from).norm();
                queue.push(QueuedVertex { distance_m, vertex: n, source });
            }
        }
        &self.reached
    }

    /// Distance of a vertex in the last search, meters; infinite where the search did not arrive.
    pub(super) fn distance_m(&self, vertex: u32) -> f64 {
        self.distance_m[vertex as usize]
    }
}

/// A vertex in the queue of a search.
#[derive(Clone, Copy, Debug)]
struct QueuedVertex {
    distance_m: f64,
    vertex: u32,
    /// The source vertex of the way, and its start value.
    source: (u32, f64),
}

impl Ord for QueuedVertex {
    /// The nearest is the greatest; of equally near ones, the vertex with the lowest number.
    fn cmp(&self, other: &Self) -> Ordering {
        let by_distance = other.distance_m.total_cmp(&self.distance_m);
        by_distance.then_with(|| (other.vertex, other.source.0).cmp(&(self.vertex, self.source.0)))
    }
}

impl PartialOrd for QueuedVertex {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for QueuedVertex {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for QueuedVertex {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::borders::plates::plate;

    #[test]
    fn distances_on_a_plate_are_straight_and_end_at_the_limit() {
        let mesh = plate(12, 12, |_, _| true);
        let neighbors = Neighbors::of_mesh(&mesh);
        let mut reach = Reach::new(&mesh, &neighbors);
        for limit in [3.0, 6.5] {
            reach.vertices_within(&[(0, 0.0)], limit);
            for (v, p) in mesh.vertices.iter().enumerate() {
                let d = reach.distance_m(v as u32);
                let straight = f64::from(p.coords.norm());
                assert!(if straight <= limit { (d - straight).abs() < 1e-6 } else { d.is_infinite() });
            }
        }
    }
}
