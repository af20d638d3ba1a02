//! The triangles for each of the 256 sign patterns of a cube, derived instead of listed.
//!
//! On every face the surface leaves one directed segment per run of inside corners, from where the run ends
//! to where it begins. Both cells of a face see the same corners, hence the same segments in opposite
//! direction, and the surface closes. A face with two diagonal inside corners keeps them apart.

use std::sync::LazyLock;

/// Corner `i` has its offset along x, y, z in the bits `4, 1, 2`: a column of four corners is a nibble.
pub(super) const AXIS_BIT: [usize; 3] = [4, 1, 2];

/// An edge of the cube: the axis it runs along and the corner at its lower end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CubeEdge {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Corner at the lower end.
    pub corner: usize,
}

impl CubeEdge {
    /// Offset of the lower end along x, y, z: 0 or 1.
    pub(crate) fn lower_end_offset(self) -> [usize; 3] {
        AXIS_BIT.map(|bit| usize::from(self.corner & bit != 0))
    }
}

/// Edges, and for every sign pattern (bit `i` set: corner `i` inside) its triangles as triples of edge
/// numbers.
pub(super) struct CubeTable {
    /// The twelve edges.
    pub edges: [CubeEdge; 12],
    /// Triangles of every pattern, counter-clockwise seen from outside.
    pub triangles: Vec<Vec<[u8; 3]>>,
}

/// The table, made on first use.
pub(super) static CUBE_TABLE: LazyLock<CubeTable> = LazyLock::new(|| {
    let edges = cube_edges();
    let faces = cube_faces();
    let triangles = (0..256)
        .map(|pattern| {
            pattern_loops(pattern, &edges, &faces).iter().flat_map(|l| loop_triangles(l, &edges)).collect()
        })
        .collect();
    CubeTable { edges, triangles }
});

/// The edges: four along each axis.
fn cube_edges() -> [CubeEdge; 12] {
    let mut edges = [CubeEdge { axis: 0, corner: 0 }; 12];
    for (axis, bit) in AXIS_BIT.into_iter().enumerate() {
        for (k, corner) in (0..8).filter(|c| c & bit == 0).enumerate() {
            edges[4 * axis + k] = CubeEdge { axis, corner };
        }
    }
    edges
}

/// Corners of each face, counter-clockwise seen from outside.
fn cube_faces() -> Vec<[usize; 4]> {
    let mut faces = Vec::with_capacity(6);
    for axis in 0..3 {
        let u = AXIS_BIT[(axis + 1) % 3];
        let v = AXIS_BIT[(axis + 2) % 3];
        let upper = AXIS_BIT[axis];
        // The far face, then the near one, seen from the other side.
        faces.push([upper, upper | u, upper | u | v, upper | v]);
        faces.push([0, v, u | v, u]);
    }
    faces
}

/// Number of the edge between two neighboring corners.
fn edge_between(a: usize, b: usize, edges: &[CubeEdge; 12]) -> usize {
    let corner = a & b;
    let bit = a ^ b;
    edges.iter().position(|e| AXIS_BIT[e.axis] == bit && e.corner == corner).unwrap_or(0)
}

/// Closed loops of cut edges around the surface pieces of a pattern.
fn pattern_loops(pattern: usize, edges: &[CubeEdge; 12], faces: &[[usize; 4]]) -> Vec<Vec<usize>> {
    let inside = |corner: usize| pattern >> corner & 1 == 1;
    let mut next = [None; 12];
    for face in faces {
        for start in 0..4 {
            if inside(face[start]) || !inside(face[(start + 1) % 4]) {
                continue;
            }
            // A run of inside corners begins here; the segment goes from the end of the run back to this
            // edge.
            let begins = edge_between(face[start], face[(start + 1) % 4], edges);
            let mut last = (start + 1) % 4;
            while inside(face[(last + 1) % 4]) {
                last = (last + 1) % 4;
            }
            next[edge_between(face[last], face[(last + 1) % 4], edges)] = Some(begins);
        }
    }
    let mut loops = Vec::new();
    for first in 0..12 {
        let mut piece = Vec::new();
        let mut at = first;
        while let Some(to) = next[at].take() {
            piece.push(at);
            at = to;
        }
        if !piece.is_empty() {
            loops.push(piece);
        }
    }
    loops
}

/// Whether two edges lie in one face of the cube. A triangle side between them could coincide with a side in
/// the neighboring cell, and four triangles would share an edge.
fn share_face(a: CubeEdge, b: CubeEdge) -> bool {
    (0..3).any(|axis| {
        a.axis != axis && b.axis != axis && a.corner & AXIS_BIT[axis] == b.corner & AXIS_BIT[axis]
    })
}

/// Triangulates a loop with as few diagonals inside faces as possible. Triangles turn against the loop, so
/// that they face outward.
fn loop_triangles(piece: &[usize], edges: &[CubeEdge; 12]) -> Vec<[u8; 3]> {
    let n = piece.len();
    // cost[i][j]: fewest diagonals in faces of the polygon i..=j, and its third corner beside side (i, j).
    let mut cost = vec![vec![(0usize, 0usize); n]; n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let whole = i == 0 && j == n - 1;
            let own = usize::from(!whole && share_face(edges[piece[i]], edges[piece[j]]));
            let best = (i + 1..j).map(|k| (cost[i][k].0 + cost[k][j].0, k)).min().unwrap_or_default();
            cost[i][j] = (best.0 + own, best.1);
        }
    }
    let mut triangles = Vec::new();
    let mut open = vec![(0, n - 1)];
    while let Some((i, j)) = open.pop() {
        if j > i + 1 {
            let k = cost[i][j].1;
            triangles.push([j, k, i].map(|c| piece[c] as u8));
            open.extend([(i, k), (k, j)]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn every_pattern_uses_each_cut_edge_and_no_diagonal_in_a_face() {
        for (pattern, triangles) in CUBE_TABLE.triangles.iter().enumerate() {
            let cut: Vec<u8> = (0..12u8)
                .filter(|&e| {
                    let edge = CUBE_TABLE.edges[e as usize];
                    let ends = [edge.corner, edge.corner | AXIS_BIT[edge.axis]];
                    (pattern >> ends[0] ^ pattern >> ends[1]) & 1 == 1
                })
                .collect();
            let mut used: Vec<u8> = triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            assert_eq!(used, cut, "pattern {pattern:08b}");
            let mut sides = BTreeMap::new();
            for t in triangles {
                for k in 0..3 {
                    *sides.entry((t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3]))).or_insert(0) += 1;
                }
            }
            for (&(a, b), &count) in &sides {
                assert!(count <= 2);
                let diagonal_in_face =
                    count == 2 && share_face(CUBE_TABLE.edges[a as usize], CUBE_TABLE.edges[b as usize]);
                assert!(!diagonal_in_face, "pattern {pattern:08b}: {a} {b} in {triangles:?}");
            }
        }
    }

    #[test]
    fn one_inside_corner_gives_one_outward_triangle() {
        let triangles = &CUBE_TABLE.triangles[1];
        assert_eq!(triangles.len(), 1);
        let mid = triangles[0].map(|e| {
            let edge = CUBE_TABLE.edges[e as usize];
            let mut p = nalgebra::Vector3::from(edge.lower_end_offset().map(|o| o as f64));
            p[edge.axis] += 0.5;
            p
        });
        let normal = (mid[1] - mid[0]).cross(&(mid[2] - mid[0]));
        assert!(normal.iter().all(|&c| c > 0.0));
    }
}
