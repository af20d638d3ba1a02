//! Vertex normals.

use nalgebra::Vector3;

use super::TriangleMesh;

/// Unit outward normal of each vertex: the mean of the adjacent face normals weighted by area (the smallest
/// triangles of marching cubes have the least certain normals); zero where no face with area is adjacent.
pub fn vertex_normals(mesh: &TriangleMesh) -> Vec<Vector3<f32>> {
    let mut normals = vec![Vector3::zeros(); mesh.vertices.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let normal = mesh.area_normal(t);
        for &v in corners {
            normals[v as usize] += normal;
        }
    }
    normals.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{box_mesh, sphere_mesh};

    #[test]
    fn normals_point_outward() {
        let ball = sphere_mesh(0.3, 40);
        assert!(
            vertex_normals(&ball).iter().zip(&ball.vertices).all(|(n, p)| n.dot(&p.coords) / 0.3 > 0.999)
        );
        let block = box_mesh(Vector3::new(0.1, 0.5, 0.3));
        assert!(
            vertex_normals(&block)
                .iter()
                .zip(&block.vertices)
                .all(|(n, p)| (0..3).all(|k| n[k] * p[k].signum() > 0.05))
        );
    }

    #[test]
    fn a_vertex_without_area_around_it_has_none() {
        let mut mesh = box_mesh(Vector3::repeat(0.1));
        mesh.vertices.push([0.0; 3].into());
        mesh.triangles = vec![[0, 0, 1]];
        assert!(vertex_normals(&mesh).iter().all(|n| *n == Vector3::zeros()));
    }
}
