//! Shapes of links for a drawing: boxes, cylinders and spheres of the URDF, or the box with the link's mass
//! and inertia.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use crate::check::{Description, Geometry, ShapeText};
use gap::twin_tree::TwinLink;
use surface::ConvexSolid;

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
    /// Whether edges between faces are drawn; not for a round solid.
    pub has_edges: bool,
}

/// Visual shapes of all links, by name; meshes are not read. Empty for a text that is not a URDF.
pub(super) fn visual_solids(urdf: &str) -> BTreeMap<String, Vec<Solid>> {
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
    // What is not a number was read as NaN.
    solid.faces.iter().flatten().all(|p| p.iter().all(|x| x.is_finite())).then_some(solid)
}

/// The box with the mass and the inertia of a link; `None` without mass.
pub(super) fn box_of_inertia(link: &TwinLink) -> Option<Solid> {
    if !(link.mass_kg > 0.0) {
        return None;
    }
    let eigen = SymmetricEigen::new(link.inertia);
    let turn = Matrix3::from_columns(&[0, 1, 2].map(|i| eigen.eigenvectors.column(i).into_owned()));
    let turn = if turn.determinant() < 0.0 { -turn } else { turn };
    let [a, b, c] = [0, 1, 2].map(|i| eigen.eigenvalues[i]);
    // A box of sides x, y, z has the inertia m (y^2 + z^2) / 12 about x.
    let sides = Vector3::from(
        [[b + c, a], [c + a, b], [a + b, c]]
            .map(|[others, own]| (6.0 * (others - own) / link.mass_kg).max(0.0).sqrt()),
    );
    let longest = sides.amax();
    if !(longest > 0.0 && longest.is_finite()) {
        return None;
    }
    let solid = cuboid(sides.map(|s| s.max(LEAST_SIDE * longest)));
    let faces = solid
        .faces
        .into_iter()
        .map(|f| f.into_iter().map(|p| link.center_of_mass + turn * p.coords).collect())
        .collect();
    Some(Solid { faces, has_edges: true })
}

/// A box about the origin.
pub(super) fn cuboid(sides: Vector3<f64>) -> Solid {
    let half = Point3::from(0.5 * sides);
    Solid { faces: corners_of_faces(&ConvexSolid::cuboid(&-half, &half)), has_edges: true }
}

/// A cylinder along z.
fn cylinder(radius: f64, length: f64) -> Solid {
    let prism = ConvexSolid::prism(&circle_points(radius, 0.0), &Vector3::z(), -0.5 * length, 0.5 * length);
    Solid { faces: corners_of_faces(&prism), has_edges: false }
}

fn corners_of_faces(solid: &ConvexSolid) -> Vec<Vec<Point3<f64>>> {
    solid.faces.iter().map(|f| f.iter().map(|&i| solid.vertices[i as usize]).collect()).collect()
}

/// Points of a circle about z.
fn circle_points(radius: f64, z: f64) -> Vec<Point3<f64>> {
    let angles = (0..SIDES).map(|i| std::f64::consts::TAU * i as f64 / SIDES as f64);
    angles.map(|angle| Point3::new(radius * angle.cos(), radius * angle.sin(), z)).collect()
}

fn ball(radius: f64) -> Solid {
    let rings: Vec<Vec<Point3<f64>>> = (0..=RINGS)
        .map(|ring| {
            let tilt = std::f64::consts::PI * ring as f64 / RINGS as f64;
            circle_points(radius * tilt.sin(), -radius * tilt.cos())
        })
        .collect();
    let mut faces = Vec::with_capacity(RINGS * SIDES);
    for pair in rings.windows(2) {
        for i in 0..SIDES {
            let next = (i + 1) % SIDES;
            faces.push(vec![pair[0][i], pair[0][next], pair[1][next], pair[1][i]]);
        }
    }
    Solid { faces, has_edges: false }
}

/// Normal of a face, with twice its area as length.
pub(super) fn face_normal(face: &[Point3<f64>]) -> Vector3<f64> {
    // Newell's sum: repeated corners do no harm.
    (0..face.len()).map(|i| face[i].coords.cross(&face[(i + 1) % face.len()].coords)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_look_outwards() {
        for solid in [cuboid(Vector3::new(1.0, 2.0, 3.0)), cylinder(0.5, 2.0), ball(0.7)] {
            for face in &solid.faces {
                let normal = face_normal(face);
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
            inertia_excess: 0.0,
        };
        let solid = box_of_inertia(&link).unwrap();
        let (low, high) = geometry::bounding_box(solid.faces.iter().flatten().copied()).unwrap();
        assert!((high - low - Vector3::new(0.8, 0.04, 2.0)).norm() < 1e-9, "{low} {high}");
        assert!((low.x - 0.0).abs() < 1e-9);
    }

    #[test]
    fn shapes_of_a_urdf_stand_where_it_says() {
        let text = "<robot><link name=\"a\"><visual><origin xyz=\"1 0 0\" rpy=\"0 0 1.5707963267948966\"/>\
                    <geometry><box size=\"2 4 6\"/></geometry></visual><visual><geometry><mesh \
                    filename=\"m.obj\"/></geometry></visual><visual><geometry><box size=\"1 nan 1\"/>\
                    </geometry></visual></link></robot>";
        let all = visual_solids(text);
        assert_eq!(all["a"].len(), 1);
        let highest = all["a"][0].faces.iter().flatten().map(|p| p.x).fold(0.0, f64::max);
        assert!((highest - 3.0).abs() < 1e-9, "{highest}");
        assert!(visual_solids("<robot").is_empty());
    }
}
