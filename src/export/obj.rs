//! Wavefront OBJ text of a coloured mesh.

use std::fmt::Write as _;

use nalgebra::Vector3;

use super::number::decimal;
use crate::surface::TriangleMesh;

/// Digits after the point of a vertex position: 0.1 micrometre.
const POSITION_PLACES: usize = 7;

/// OBJ text: `v x y z r g b` (metres; colour in `[0, 1]`, left out where the mesh has none), `vn` per vertex
/// (area-weighted, unit) and triangles `f a//a b//b c//c`. Needs finite vertices and indices inside the mesh.
#[must_use]
pub fn obj(mesh: &TriangleMesh) -> String {
    let mut text = String::with_capacity(mesh.vertices.len() * 90 + mesh.triangles.len() * 40);
    let colored = mesh.colors.len() == mesh.vertices.len();
    for (i, p) in mesh.vertices.iter().enumerate() {
        text.push('v');
        for k in 0..3 {
            text.push(' ');
            text.push_str(&decimal(f64::from(p[k]), POSITION_PLACES));
        }
        if colored {
            for c in mesh.colors[i] {
                text.push(' ');
                text.push_str(&decimal(f64::from(c) / 255.0, 4));
            }
        }
        text.push('\n');
    }
    for n in vertex_normals(mesh) {
        text.push_str("vn");
        for k in 0..3 {
            text.push(' ');
            text.push_str(&decimal(f64::from(n[k]), 4));
        }
        text.push('\n');
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| i + 1);
        // Writing to a string cannot fail.
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").ok();
    }
    text
}

/// Unit normal per vertex: the sum of the area normals of its triangles; `+z` where that is zero.
fn vertex_normals(mesh: &TriangleMesh) -> Vec<Vector3<f32>> {
    let mut sums = vec![Vector3::<f64>::zeros(); mesh.vertices.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let normal = mesh.area_normal(t).cast::<f64>();
        for &i in triangle {
            sums[i as usize] += normal;
        }
    }
    sums.iter().map(|n| n.try_normalize(1e-30).unwrap_or_else(Vector3::z).cast()).collect()
}

/// Mean colour of a mesh, weighted by triangle area, in `[0, 1]`; `None` without colours or area.
#[must_use]
pub fn mean_color(mesh: &TriangleMesh) -> Option<[f64; 3]> {
    if mesh.colors.len() != mesh.vertices.len() {
        return None;
    }
    let (mut sum, mut area) = (Vector3::<f64>::zeros(), 0.0);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let a = f64::from(mesh.area_normal(t).norm());
        for &i in triangle {
            sum += Vector3::from(mesh.colors[i as usize].map(f64::from)) * a;
        }
        area += a;
    }
    (area > 0.0).then(|| (sum / (3.0 * 255.0 * area)).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn triangle() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![Point3::new(0.0, 0.0, -0.0), Point3::new(0.1, 0.0, 0.0), Point3::new(0.0, 0.25, 0.0)],
            triangles: vec![[0, 1, 2]],
            colors: vec![[255, 0, 128]; 3],
        }
    }

    #[test]
    fn text_is_exact() {
        let text = "v 0 0 0 1 0 0.502\nv 0.1 0 0 1 0 0.502\nv 0 0.25 0 1 0 0.502\nvn 0 0 1\nvn 0 0 1\nvn 0 0 1\nf 1//1 2//2 3//3\n";
        assert_eq!(obj(&triangle()), text);
        assert_eq!(obj(&TriangleMesh { colors: vec![], ..triangle() }), text.replace(" 1 0 0.502", ""));
    }

    #[test]
    fn colors_are_weighted_by_area() {
        let mut mesh = triangle();
        mesh.vertices.extend([Point3::new(0.0, 0.0, 1.0), Point3::new(0.3, 0.0, 1.0), Point3::new(0.0, 0.25, 1.0)]);
        mesh.triangles.push([3, 4, 5]);
        mesh.colors.extend([[0, 255, 0]; 3]);
        let mean = mean_color(&mesh).unwrap();
        assert!((mean[0] - 0.25).abs() < 1e-6 && (mean[1] - 0.75).abs() < 1e-6);
        assert_eq!(mean_color(&TriangleMesh::default()), None);
    }
}
