//! Connected components of a mesh.

use surface::{TriangleMesh, connected_components, drop_unused_vertices, welded_mesh};

/// The mesh without components smaller than `share` times the area of the largest one. The released
/// evaluation counts triangles instead, which are of similar size in marching cubes but not in a simplified
/// mesh. Triangles are connected by common vertices; vertices at the same position are one.
pub(crate) fn large_components(mesh: &TriangleMesh, share: f64) -> TriangleMesh {
    // Textures split vertices at their seams; welding joins those at the same position.
    let welded = welded_mesh(mesh, 0.0);
    let (labels, sizes) = connected_components(&welded);
    let mut area_m2 = vec![0.0; sizes.len()];
    for (t, label) in labels.iter().enumerate() {
        area_m2[*label as usize] += f64::from(welded.area_normal(t).norm());
    }
    let least_m2 = share * area_m2.iter().copied().fold(0.0, f64::max);
    let kept =
        welded.triangles.iter().zip(&labels).filter(|(_, label)| area_m2[**label as usize] >= least_m2);
    let triangles = kept.map(|(t, _)| *t).collect();
    drop_unused_vertices(&TriangleMesh { triangles, ..welded })
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::box_mesh;
    use surface::merged_mesh;

    #[test]
    fn small_components_go_and_large_ones_stay() {
        let a = box_mesh([0.0; 3], [1.0; 3], [1; 3]);
        let b = box_mesh([3.0; 3], [4.0; 3], [2; 3]);
        let mut sliver = box_mesh([7.0; 3], [8.0; 3], [3; 3]);
        sliver.triangles.truncate(1);
        let all = merged_mesh(&[&a, &sliver, &b]);
        assert_eq!(large_components(&all, 0.1).triangles.len(), 24, "1 of 12 is less than 10 %");
        assert_eq!(large_components(&all, 0.05).triangles.len(), 25);
        // By area, not by count: a floater of many small triangles goes, a plate of two large ones stays.
        let mut fine = TriangleMesh::default();
        for k in 0..30 {
            let x = 9.0 + 0.01 * k as f32;
            fine = merged_mesh(&[&fine, &box_mesh([x, 0.0, 0.0], [x + 0.01, 0.01, 0.01], [4; 3])]);
        }
        let mut plate = box_mesh([-9.0; 3], [-8.0; 3], [5; 3]);
        plate.triangles.truncate(2);
        assert_eq!(large_components(&merged_mesh(&[&a, &fine, &plate]), 0.1).triangles.len(), 14);
        // The same box as a soup of triangles is still one component.
        let mut soup = TriangleMesh::default();
        for t in 0..a.triangles.len() {
            let n = soup.vertices.len() as u32;
            soup.vertices.extend(a.corners(t));
            soup.triangles.push([n, n + 1, n + 2]);
        }
        assert_eq!(large_components(&soup, 0.9).triangles.len(), 12);
        assert!(large_components(&TriangleMesh::default(), 0.1).is_empty());
    }
}
