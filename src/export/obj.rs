//! Wavefront OBJ text: textured visual meshes and plain collision meshes.

use std::fmt::Write as _;

use nalgebra::Vector3;

use super::{look::Look, number::decimal};
use model::identifier;
use surface::ConvexSolid;

/// Digits after the point of a vertex position: 0.1 micrometer.
const POSITION_PLACES: usize = 7;
/// Digits of a texture coordinate: a twentieth of a texel of a large texture.
const UV_PLACES: usize = 6;

/// OBJ text of a textured mesh: positions (meters), texture coordinates in `[0, 1]`, unit normals, triangles.
/// It uses one material, `name` of `name.mtl`.
pub fn textured_obj(look: &Look, name: &str) -> String {
    let name = identifier(name);
    let mut text = format!("mtllib {name}.mtl\no {name}\n");
    for p in &look.mesh.vertices {
        push_values(&mut text, "v", &[p.x, p.y, p.z].map(f64::from), POSITION_PLACES);
    }
    for c in &look.corners {
        push_values(&mut text, "vt", &c.uv, UV_PLACES);
    }
    for c in &look.corners {
        // Drake's renderer fails on a mesh without normals.
        push_values(&mut text, "vn", c.normal.as_slice(), 4);
    }
    writeln!(text, "usemtl {name}").ok();
    for (t, corners) in look.mesh.triangles.iter().zip(&look.triangles) {
        // Indices count from 1. A vertex has one position, and texture coordinates and a normal in each
        // chart.
        let [a, b, c] = [0, 1, 2].map(|k| format!("{}/{}/{}", t[k] + 1, corners[k] + 1, corners[k] + 1));
        // Writing to a string cannot fail.
        writeln!(text, "f {a} {b} {c}").ok();
    }
    text
}

/// The material of a textured mesh: its texture without a tint.
pub(crate) fn mtl_text(name: &str) -> String {
    // Importers multiply the texture by Kd: 1 leaves its colors as they are.
    let name = identifier(name);
    format!("newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nd 1\nillum 1\nmap_Kd {name}.png\n")
}

/// OBJ text of a convex solid: positions and triangles with the normals of their faces.
pub(crate) fn solid_obj(solid: &ConvexSolid, name: &str) -> String {
    let mesh = solid.to_mesh();
    let mut text = format!("o {}\n", identifier(name));
    for p in &solid.vertices {
        push_values(&mut text, "v", &[p.x, p.y, p.z], POSITION_PLACES);
    }
    for t in 0..mesh.triangles.len() {
        // A face without area gets an arbitrary normal, so the others keep their numbers.
        let normal = mesh.area_normal(t).cast::<f64>().try_normalize(0.0).unwrap_or_else(Vector3::z);
        push_values(&mut text, "vn", normal.as_slice(), 4);
    }
    for (k, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|i| i + 1);
        writeln!(text, "f {a}//{n} {b}//{n} {c}//{n}", n = k + 1).ok();
    }
    text
}

fn push_values(text: &mut String, word: &str, values: &[f64], places: usize) {
    text.push_str(word);
    for v in values {
        text.push(' ');
        text.push_str(&decimal(*v, places));
    }
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::{LookConfig, look};
    use nalgebra::Point3;
    use surface::TriangleMesh;

    fn triangle() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![
                Point3::new(0.0, 0.0, -0.0),
                Point3::new(0.1, 0.0, 0.0),
                Point3::new(0.0, 0.25, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            colors: vec![[255, 0, 128]; 3],
        }
    }

    #[test]
    fn a_textured_mesh_names_its_material_and_stays_inside_it() {
        let text = textured_obj(&look(&triangle(), &[], &LookConfig::default()), "lid");
        assert!(text.starts_with("mtllib lid.mtl\no lid\nv 0 0 0\nv 0.1 0 0\nv 0 0.25 0\nvt "), "{text}");
        assert!(text.ends_with("usemtl lid\nf 1/1/1 2/2/2 3/3/3\n"), "{text}");
        let uv = text
            .lines()
            .filter_map(|l| l.strip_prefix("vt "))
            .flat_map(|l| l.split(' ').map(|x| x.parse::<f64>().unwrap()));
        assert!(uv.clone().count() == 6 && uv.into_iter().all(|x| x > 0.0 && x < 1.0));
        assert!(mtl_text("lid").contains("Kd 1 1 1\n") && mtl_text("lid").ends_with("map_Kd lid.png\n"));
    }

    #[test]
    fn a_solid_has_outward_triangles() {
        let text = solid_obj(&ConvexSolid::cuboid(&Point3::origin(), &Point3::new(1.0, 2.0, 0.5)), "lid_0");
        assert_eq!((text.matches("\nv ").count(), text.matches("\nf ").count()), (8, 12));
        assert!(text.contains("vn 0 0 -1\n") && text.contains("vn 1 0 0\n"));
    }
}
