//! Joins meshes and vertices, and counts defects of edges.

use nalgebra::Point3;

use super::TriangleMesh;

/// The mesh without unused vertices; the order of the others stays.
pub fn drop_unused_vertices(mesh: &TriangleMesh) -> TriangleMesh {
    let mut used = vec![false; mesh.vertices.len()];
    for &i in mesh.triangles.iter().flatten() {
        used[i as usize] = true;
    }
    let mut number = vec![0; used.len()];
    let mut kept = Vec::new();
    for (i, _) in used.iter().enumerate().filter(|(_, u)| **u) {
        number[i] = kept.len() as u32;
        kept.push(i);
    }
    let has_colors = mesh.colors.len() == mesh.vertices.len();
    TriangleMesh {
        vertices: kept.iter().map(|&i| mesh.vertices[i]).collect(),
        triangles: mesh.triangles.iter().map(|t| t.map(|i| number[i as usize])).collect(),
        colors: if has_colors { kept.iter().map(|&i| mesh.colors[i]).collect() } else { Vec::new() },
    }
}

/// All meshes as one, in order. Colors are kept where every mesh with vertices has them.
pub fn merged_mesh(meshes: &[&TriangleMesh]) -> TriangleMesh {
    let has_colors = meshes.iter().all(|m| m.colors.len() == m.vertices.len());
    let mut all = TriangleMesh::default();
    for m in meshes {
        let first = all.vertices.len() as u32;
        all.vertices.extend_from_slice(&m.vertices);
        all.triangles.extend(m.triangles.iter().map(|t| t.map(|i| i + first)));
        if has_colors {
            all.colors.extend_from_slice(&m.colors);
        }
    }
    all
}

/// The mesh with all vertices in one cell of a lattice joined at the first of them; the lattice has the given
/// spacing, meters (0: only equal positions are joined). Triangles left with fewer than three corners and
/// unused vertices are dropped.
pub fn welded_mesh(mesh: &TriangleMesh, spacing_m: f32) -> TriangleMesh {
    let representative = first_of_cells(&mesh.vertices, spacing_m);
    let triangles = mesh.triangles.iter().map(|t| t.map(|i| representative[i as usize]));
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    drop_unused_vertices(&TriangleMesh { triangles, ..mesh.clone() })
}

/// For each vertex, the first vertex of its lattice cell.
fn first_of_cells(vertices: &[Point3<f32>], spacing_m: f32) -> Vec<u32> {
    let mut order: Vec<([i64; 3], u32)> = Vec::with_capacity(vertices.len());
    for (p, i) in vertices.iter().zip(0..) {
        order.push(([p.x, p.y, p.z].map(|x| lattice_key(x, spacing_m)), i));
    }
    // Sorted by cell and then by index: each run begins with the first vertex of its cell.
    order.sort_unstable();
    let mut representative = vec![0; vertices.len()];
    let mut first = 0;
    for i in 0..order.len() {
        if order[i].0 != order[first].0 {
            first = i;
        }
        representative[order[i].1 as usize] = order[first].1;
    }
    representative
}

/// Key of a coordinate's lattice cell.
fn lattice_key(x: f32, spacing_m: f32) -> i64 {
    // Adding 0 turns -0 into +0: equal positions have equal keys.
    if spacing_m > 0.0 { (x / spacing_m).floor() as i64 } else { i64::from((x + 0.0).to_bits()) }
}

/// Counts of irregular triangle sides. A regular one is shared by exactly two triangles of opposite
/// direction; an open one belongs to a single triangle; any other is non-manifold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EdgeDefects {
    /// Sides of one triangle only.
    pub open: usize,
    /// Sides neither open nor shared by two triangles of consistent winding.
    pub non_manifold: usize,
}

/// Counts open and non-manifold sides.
pub fn edge_defects(mesh: &TriangleMesh) -> EdgeDefects {
    let mut sides: Vec<(u32, u32, bool)> =
        mesh.sides().map(|(p, q, _)| (p.min(q), p.max(q), p < q)).collect();
    sides.sort_unstable();
    let mut defects = EdgeDefects::default();
    for same in sides.chunk_by(|p, q| (p.0, p.1) == (q.0, q.1)) {
        match same {
            [_] => defects.open += 1,
            [p, q] if p.2 != q.2 => {}
            _ => defects.non_manifold += 1,
        }
    }
    defects
}

/// Whether the mesh has triangles and each side of them belongs to exactly two, of consistent winding.
pub fn is_watertight(mesh: &TriangleMesh) -> bool {
    !mesh.is_empty() && edge_defects(mesh) == EdgeDefects::default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::box_mesh;
    use nalgebra::Vector3;

    /// Every triangle with its own three vertices.
    fn soup(mesh: &TriangleMesh) -> TriangleMesh {
        let corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        TriangleMesh {
            vertices: corners.iter().map(|&i| mesh.vertices[i as usize]).collect(),
            triangles: (0..mesh.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
            colors: corners.iter().map(|&i| [i as u8; 3]).collect(),
        }
    }

    #[test]
    fn welding_a_soup_makes_it_watertight_again() {
        let mesh = box_mesh(Vector3::new(0.1, 0.2, 0.3));
        let loose = soup(&mesh);
        assert_eq!(edge_defects(&loose).open, 36);
        assert!(!is_watertight(&loose) && is_watertight(&mesh));
        for spacing in [0.0, 1e-4] {
            let welded = welded_mesh(&loose, spacing);
            assert!(is_watertight(&welded));
            assert_eq!((welded.vertices.len(), welded.triangles.len(), welded.colors.len()), (8, 12, 8));
        }
        let moved = mesh.transformed(&geometry::Pose::translation(0.5, 0.5, 0.5));
        assert!(welded_mesh(&moved, 1.0).is_empty());
    }

    #[test]
    fn a_doubled_or_turned_triangle_is_non_manifold() {
        let mut mesh = box_mesh(Vector3::new(0.1, 0.2, 0.3));
        mesh.triangles[0].swap(0, 1);
        assert_eq!(edge_defects(&mesh), EdgeDefects { open: 0, non_manifold: 3 });
        mesh.triangles.swap_remove(0);
        assert_eq!(edge_defects(&mesh), EdgeDefects { open: 3, non_manifold: 0 });
    }

    #[test]
    fn merging_keeps_both_and_their_colors() {
        let a = soup(&box_mesh(Vector3::new(0.1, 0.2, 0.3)));
        let m = merged_mesh(&[&a, &a]);
        assert_eq!((m.vertices.len(), m.triangles.len(), m.colors.len()), (72, 24, 72));
        assert_eq!(m.corners(13), a.corners(1));
        assert!(merged_mesh(&[&a, &box_mesh(Vector3::new(0.1, 0.2, 0.3))]).colors.is_empty());
    }
}
