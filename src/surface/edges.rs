//! Sides and edges of a mesh by their vertices.

use super::TriangleMesh;
use numeric::lists::Lists;

/// The end vertex of each triangle side, grouped by its start vertex.
pub(crate) fn sides_by_vertex(mesh: &TriangleMesh) -> Lists<u32> {
    Lists::of_entries(mesh.vertices.len(), mesh.sides().map(|(p, q, _)| (p, q)))
}

/// Edges of a mesh, grouped by their lower vertex, with one entry per side: the other end and the index of
/// the side. Triangle t has sides 3 t to 3 t + 2.
pub(crate) struct Edges(Lists<(u32, u32)>);

impl Edges {
    pub(crate) fn of_mesh(mesh: &TriangleMesh) -> Self {
        let sides = mesh.sides().zip(0..).map(|((p, q, _), side)| (p.min(q), (p.max(q), side)));
        Self(Lists::of_entries(mesh.vertices.len(), sides))
    }

    /// For each edge its lower end, and its other end with each of its sides; ascending.
    pub(crate) fn by_lower_end(&self) -> impl Iterator<Item = (u32, &[(u32, u32)])> {
        self.0.all().flat_map(|(a, ends)| ends.chunk_by(|p, q| p.0 == q.0).map(move |same| (a, same)))
    }

    /// The neighbors over an edge of each of `triangles` triangles, among those `kept`, in the order of the
    /// edges.
    pub(crate) fn neighbors(&self, triangles: usize, kept: impl Fn(u32) -> bool) -> Vec<Vec<u32>> {
        let mut near = vec![Vec::new(); triangles];
        for (_, same) in self.by_lower_end() {
            let of_edge = || same.iter().map(|&(_, side)| side / 3).filter(|t| kept(*t));
            for t in of_edge() {
                near[t as usize].extend(of_edge().filter(|u| *u != t));
            }
        }
        near
    }
}
