//! Connected components of a mesh.

use super::{TriangleMesh, drop_unused_vertices};
use numeric::index_sets::IndexSets;

/// Number of the component of each triangle, and the number of triangles of each component. Triangles with a
/// common vertex are connected; components are numbered by their first triangle.
pub fn connected_components(mesh: &TriangleMesh) -> (Vec<u32>, Vec<usize>) {
    let mut sets = IndexSets::new(mesh.vertices.len());
    for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| v as usize)) {
        sets.join(a, b);
        sets.join(a, c);
    }
    let mut number = vec![u32::MAX; mesh.vertices.len()];
    let mut sizes = Vec::new();
    let mut labels = Vec::with_capacity(mesh.triangles.len());
    for t in &mesh.triangles {
        let n = &mut number[sets.root_of(t[0] as usize)];
        if *n == u32::MAX {
            *n = sizes.len() as u32;
            sizes.push(0);
        }
        sizes[*n as usize] += 1;
        labels.push(*n);
    }
    (labels, sizes)
}

/// The mesh without components of fewer triangles than `min_share` of the largest one's (docs/method.md 3.3).
pub fn keep_components(mesh: &TriangleMesh, min_share: f64) -> TriangleMesh {
    let (labels, sizes) = connected_components(mesh);
    let least = min_share * sizes.iter().max().copied().unwrap_or(0) as f64;
    let kept = mesh.triangles.iter().zip(labels).filter(|(_, label)| sizes[*label as usize] as f64 >= least);
    drop_unused_vertices(&TriangleMesh { triangles: kept.map(|(t, _)| *t).collect(), ..mesh.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        merged_mesh,
        shapes::{box_mesh, sphere_mesh},
    };
    use geometry::Pose;
    use nalgebra::Vector3;

    #[test]
    fn small_components_go() {
        let speck = box_mesh(Vector3::repeat(0.01)).transformed(&Pose::translation(2.0, 0.0, 0.0));
        let mesh = merged_mesh(&[
            &speck,
            &sphere_mesh(0.3, 20),
            &speck.transformed(&Pose::translation(1.0, 0.0, 0.0)),
        ]);
        let (labels, sizes) = connected_components(&mesh);
        assert_eq!(sizes, [12, 40 * 38, 12]);
        assert_eq!((labels[0], labels[12], labels[labels.len() - 1]), (0, 1, 2));
        assert_eq!(keep_components(&mesh, 0.1), sphere_mesh(0.3, 20));
        assert_eq!(keep_components(&mesh, 12.0 / 1520.0).triangles.len(), mesh.triangles.len());
        assert!(keep_components(&TriangleMesh::default(), 0.1).is_empty());
    }
}
