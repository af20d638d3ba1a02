//! Shapes of links for a drawing: what the URDF gives as boxes, cylinders and balls, or the box of the same
//! mass and inertia.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use crate::check::{Description, Geometry, ShapeText};
use gap::twin_tree::TwinLink;

/// Sides of a drawn cylinder.
const SIDES: usize = 24;
/// Rings of a drawn ball, from pole to pole.
const RINGS: usize = 8;
/// Most shapes of a link.
const MAX_SHAPES: usize = 40;
/// Least side of a box of inertia, as a share of its longest. chosen: for the eye
const LEAST_SIDE: f64 = 0.02;

/// A convex solid in the frame of its link: faces with their corners, counterclockwise from outside.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Solid {
    /// Faces.
    pub faces: Vec<Vec<Point3<f64>>>,
    /// Edges between faces are drawn; a round solid has none.
    pub has_edges: bool,
}

/// Visual shapes of all links, by name; meshes are not read. Nothing of a text that is no URDF.
#[must_use]
pub(super) fn visuals(urdf: &str) -> BTreeMap<String, Vec<Solid>> {
    let Ok(description) = Description::parse(urdf) else { return BTreeMap::new() };
    let mut all = BTreeMap::new();
    for link in description.links {
        let shapes = link.visuals.iter().filter_map(solid).take(MAX_SHAPES).collect();
        all.insert(link.name, shapes);
    }
    all
}

fn solid(shape: &ShapeText) -> Option<Solid> {
    let mut solid = match shape.geometry {
        Geometry::Cuboid(sides) => cuboid(sides),
        Geometry::Cylinder { radius, length } => cylinder(radius, length),
        Geometry::Sphere(radius) => ball(radius),
        _ => return None,
    };
    for p in solid.faces.iter_mut().flatten() {
        *p = shape.link_from_shape * *p;
    }
    // What is no number was read as NaN.
    solid.faces.iter().flatten().all(|p| p.iter().all(|x| x.is_finite())).then_some(solid)
}

/// The box that has the mass and the inertia of a link; `None` without mass.
#[must_use]
pub(super) fn box_of_inertia(link: &TwinLink) -> Option<Solid> {
    if !(link.mass_kg > 0.0) {
        return None;
    }
    let eigen = SymmetricEigen::new(link.inertia);
    let turn = Matrix3::from_columns(&[0, 1, 2].map(|i| eigen.eigenvectors.column(i).into_owned()));
    let turn = if turn.determinant() < 0.0 { -turn } else { turn };
    let [a, b, c] = [0, 1, 2].map(|i| eigen.eigenvalues[i]);
    // A box of sides x, y, z has the inertia m (y^2 + z^2) / 12 about x.
    let side = |others: f64, own: f64| (6.0 * (others - own) / link.mass_kg).max(0.0).sqrt();
    let sides = Vector3::new(side(b + c, a), side(c + a, b), side(a + b, c));
    let longest = sides.amax();
    if !(longest > 0.0 && longest.is_finite()) {
        return None;
    }
    let solid = cuboid(sides.map(|s| s.max(LEAST_SIDE * longest)));
    let place = |p: Point3<f64>| link.center_of_mass + turn * p.coords;
    let faces = solid.faces.into_iter().map(|f| f.into_iter().map(place).collect()).collect();
    Some(Solid { faces, has_edges: true })
}

/// A box about the origin.
#[must_use]
pub(super) fn cuboid(sides: Vector3<f64>) -> Solid {
    let corner = |x: f64, y: f64, z: f64| Point3::from(0.5 * sides.component_mul(&Vector3::new(x, y, z)));
    let mut faces = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let at = |a: f64, b: f64| {
                let mut c = [0.0; 3];
                (c[axis], c[(axis + 1) % 3], c[(axis + 2) % 3]) = (sign, a, b);
                corner(c[0], c[1], c[2])
            };
            let mut face = vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
            if sign < 0.0 {
                face.reverse();
            }
            faces.push(face);
        }
    }
    Solid { faces, has_edges: true }
}

/// Along z.
fn cylinder(radius: f64, length: f64) -> Solid {
    let rim = |i: usize, z: f64| {
        let angle = std::f64::consts::TAU * (i % SIDES) as f64 / SIDES as f64;
        Point3::new(radius * angle.cos(), radius * angle.sin(), z)
    };
    let low = -0.5 * length;
    let high = 0.5 * length;
    let mut faces: Vec<Vec<Point3<f64>>> =
        (0..SIDES).map(|i| vec![rim(i, low), rim(i + 1, low), rim(i + 1, high), rim(i, high)]).collect();
    faces.push((0..SIDES).map(|i| rim(i, high)).collect());
    faces.push((0..SIDES).rev().map(|i| rim(i, low)).collect());
    Solid { faces, has_edges: false }
}

fn ball(radius: f64) -> Solid {
    let at = |i: usize, ring: usize| {
        let turn = std::f64::consts::TAU * (i % SIDES) as f64 / SIDES as f64;
        let tilt = std::f64::consts::PI * ring as f64 / RINGS as f64;
        let across = radius * tilt.sin();
        Point3::new(across * turn.cos(), across * turn.sin(), -radius * tilt.cos())
    };
    let face =
        |ring: usize, i: usize| vec![at(i, ring), at(i + 1, ring), at(i + 1, ring + 1), at(i, ring + 1)];
    let faces = (0..RINGS).flat_map(|ring| (0..SIDES).map(move |i| (ring, i))).map(|(r, i)| face(r, i));
    Solid { faces: faces.collect(), has_edges: false }
}

/// Normal of a face, longer for a larger face.
#[must_use]
pub(super) fn normal(face: &[Point3<f64>]) -> Vector3<f64> {
    // Newell's sum, which a triangle with a doubled corner does not spoil.
    (0..face.len()).map(|i| face[i].coords.cross(&face[(i + 1) % face.len()].coords)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_look_outwards() {
        for solid in [cuboid(Vector3::new(1.0, 2.0, 3.0)), cylinder(0.5, 2.0), ball(0.7)] {
            for face in &solid.faces {
                let normal = normal(face);
                let middle = face.iter().map(|p| p.coords).sum::<Vector3<f64>>() / face.len() as f64;
                assert!(normal.dot(&middle) > 0.0, "{face:?}");
            }
        }
    }

    #[test]
    fn the_box_of_inertia_of_a_box_is_the_box() {
        // A door of 0.8 x 0.04 x 2 m.
        let link = TwinLink {
            name: "door".into(),
            mass_kg: 10.0,
            center_of_mass: Point3::new(0.4, 0.0, 0.0),
            inertia: Matrix3::from_diagonal(&Vector3::new(
                10.0 * (0.0016 + 4.0) / 12.0,
                10.0 * (0.64 + 4.0) / 12.0,
                10.0 * (0.64 + 0.0016) / 12.0,
            )),
        };
        let solid = box_of_inertia(&link).unwrap();
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        let mut low = Vector3::repeat(f64::INFINITY);
        for p in solid.faces.iter().flatten() {
            (high, low) = (high.sup(&p.coords), low.inf(&p.coords));
        }
        assert!((high - low - Vector3::new(0.8, 0.04, 2.0)).norm() < 1e-9, "{low} {high}");
        assert!((low.x - 0.0).abs() < 1e-9);
    }

    #[test]
    fn shapes_of_a_urdf_stand_where_it_says() {
        let text = "<robot><link name=\"a\"><visual><origin xyz=\"1 0 0\" rpy=\"0 0 1.5707963267948966\"/>\
                    <geometry><box size=\"2 4 6\"/></geometry></visual><visual><geometry><mesh \
                    filename=\"m.obj\"/></geometry></visual><visual><geometry><box size=\"1 nan 1\"/>\
                    </geometry></visual></link></robot>";
        let all = visuals(text);
        assert_eq!(all["a"].len(), 1);
        let highest = all["a"][0].faces.iter().flatten().map(|p| p.x).fold(0.0, f64::max);
        assert!((highest - 3.0).abs() < 1e-9, "{highest}");
        assert!(visuals("<robot").is_empty());
    }
}
