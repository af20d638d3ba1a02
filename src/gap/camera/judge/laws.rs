//! Candidate motion laws of other types for a joint: type, direction, point.

use nalgebra::{Point3, Unit, Vector3};

use crate::camera::{
    effects::screw_pitch::{LEAST_PITCH, PITCHES},
    model::twin::SeenTwin,
};
use geometry::{AxisMotion, normals_of};
use surface::TriangleMesh;

/// Sine below which two directions count as parallel, and have no common normal.
///
/// chosen: far above rounding; the directions are meant to be perpendicular
const PARALLEL: f64 = 1e-6;
/// Cosine above which two directions count as one.
///
/// tuned: made objects (tests/gap_frames.rs)
const SAME_DIRECTION: f64 = 0.98;
/// Cosine below which two directions count as perpendicular.
///
/// derived: the sine of the angle of `SAME_DIRECTION`
const SQUARE: f64 = 0.2;

/// Index of a type, 0 to 2.
pub(super) fn type_rank(kind: AxisMotion) -> usize {
    match kind {
        AxisMotion::Revolute => 0,
        AxisMotion::Prismatic => 1,
        AxisMotion::Screw { .. } => 2,
    }
}

/// Candidate laws of the other types: type, direction, point.
pub(super) fn laws_of_other_types(
    twin: &SeenTwin,
    joint: usize,
) -> Vec<(AxisMotion, Unit<Vector3<f64>>, Point3<f64>)> {
    let spec = &twin.joints[joint];
    let faces = face_directions(twin, spec.child);
    let mut directions: Vec<Unit<Vector3<f64>>> = vec![spec.axis];
    for f in &faces {
        if directions.iter().all(|d| d.dot(f).abs() < SAME_DIRECTION) {
            directions.push(*f);
        }
    }
    if spec.kind.is_turning() {
        let slides = directions.into_iter().map(|d| (AxisMotion::Prismatic, d, spec.point));
        let size_m = twin.parts[spec.child].radius_m;
        let pitches = (0..PITCHES).map(|k| LEAST_PITCH * size_m * f64::from(1 << k)).flat_map(|p| [p, -p]);
        let screws =
            pitches.map(|pitch_m_per_rad| (AxisMotion::Screw { pitch_m_per_rad }, spec.axis, spec.point));
        return slides.chain(screws).collect();
    }
    let mesh = &twin.parts[spec.child].mesh;
    let mut all = vec![(AxisMotion::Revolute, spec.axis, spec.point)];
    for d in directions {
        let [u, v] = side_directions(&d, &faces);
        let ru = range_along(mesh, &u);
        let rv = range_along(mesh, &v);
        let along = twin.parts[spec.child].center.coords.dot(&d);
        // Hinges mostly lie at an edge of their part; the center is for a part turning in place.
        for (a, b) in [(ru.0, rv.0), (ru.0, rv.1), (ru.1, rv.0), (ru.1, rv.1)] {
            all.push((AxisMotion::Revolute, d, Point3::from(u * a + v * b + d.into_inner() * along)));
        }
        let middle =
            Point3::from(u * (0.5 * (ru.0 + ru.1)) + v * (0.5 * (rv.0 + rv.1)) + d.into_inner() * along);
        all.push((AxisMotion::Revolute, d, middle));
    }
    all
}

/// Least and greatest coordinate of a mesh along a direction, meters.
fn range_along(mesh: &TriangleMesh, direction: &Vector3<f64>) -> (f64, f64) {
    let along = mesh.vertices.iter().map(|p| p.cast::<f64>().coords.dot(direction));
    along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
}

/// Two directions normal to an axis, along faces of the part where possible.
fn side_directions(axis: &Unit<Vector3<f64>>, faces: &[Unit<Vector3<f64>>]) -> [Vector3<f64>; 2] {
    let face = faces.iter().find(|f| f.dot(axis).abs() < SQUARE);
    face.map_or_else(
        || normals_of(axis),
        |f| {
            let u = (f.into_inner() - axis.into_inner() * axis.dot(f)).normalize();
            [u, axis.cross(&u)]
        },
    )
}

/// Total area of the faces normal to a direction, on either side.
fn area_facing(normals: &[Vector3<f64>], direction: &Unit<Vector3<f64>>) -> f64 {
    let areas = normals.iter().map(|n| (n.norm(), n.dot(direction).abs()));
    areas.filter(|(a, d)| *d > SAME_DIRECTION * a).map(|(a, _)| a).sum::<f64>()
}

/// Up to three directions of most of a part's faces, mutually perpendicular, in the part frame.
fn face_directions(twin: &SeenTwin, part: usize) -> Vec<Unit<Vector3<f64>>> {
    const CANDIDATES: usize = 96;
    let mesh = &twin.parts[part].mesh;
    let normals: Vec<Vector3<f64>> = (0..mesh.triangles.len()).map(|t| mesh.area_normal(t).cast()).collect();
    let step = (normals.len() / CANDIDATES).max(1);
    let candidates: Vec<Unit<Vector3<f64>>> =
        normals.iter().step_by(step).filter_map(|n| Unit::try_new(*n, 1e-12)).collect();
    let mut chosen: Vec<Unit<Vector3<f64>>> = Vec::new();
    // Two directions by area; the third is perpendicular to both.
    for _ in 0..2 {
        let free = candidates.iter().filter(|c| chosen.iter().all(|d| d.dot(c).abs() < SQUARE));
        let best = free.max_by(|a, b| area_facing(&normals, a).total_cmp(&area_facing(&normals, b)));
        let Some(best) = best else { break };
        chosen.push(*best);
    }
    if let [a, b] = chosen[..]
        && let Some(c) = Unit::try_new(a.cross(&b), PARALLEL)
    {
        chosen.push(c);
    }
    chosen
}
