//! ROS messages of the live map: surface chunks, unseen space, the next view, moved surface.

use nalgebra::Point3;

use super::live_map::LiveProducts;
use geometry::{Intrinsics, Pose, normals_of};
use io::ros2msg::{
    Header, PoseStamped, Transform, Vector3 as Point,
    markers::{Color, Marker, MarkerArray, action, kind},
};
use surface::{MeshChunk, TriangleMesh, UnseenPatch};

/// Marker namespace of the surface chunks.
const SURFACE: &str = "live_mesh";
/// Marker namespace of unseen space.
const UNSEEN: &str = "unseen";
/// Marker namespace of the next view.
const NEXT_VIEW: &str = "next_view";
/// Marker namespace of moved surface.
const MOVED: &str = "moved";
/// Most triangles of appeared or gone surface per message; of more, a sample is sent.
const MOST_MOVED: usize = 1500;
/// Length of the next view's pyramid, meters. chosen: easy to see
const PYRAMID_M: f64 = 0.12;

/// Size of a chunk in a message, bytes: three points and three colors per triangle.
#[must_use]
pub(crate) fn chunk_bytes(chunk: &MeshChunk) -> usize {
    200 + chunk.mesh.triangles.len() * 3 * (24 + 16)
}

/// Message that deletes all markers of a topic.
#[must_use]
pub(crate) fn clear_markers(header: &Header) -> MarkerArray {
    let marker = Marker { header: header.clone(), action: action::DELETE_ALL, ..Marker::default() };
    MarkerArray { markers: vec![marker] }
}

/// Marker of a chunk, which replaces an earlier one; deletes it if the chunk has no triangles.
#[must_use]
pub(crate) fn chunk_marker(chunk: &MeshChunk, header: &Header) -> Marker {
    if chunk.mesh.is_empty() {
        return gone_chunk(chunk.id, header);
    }
    let corners = || chunk.mesh.triangles.iter().flatten().map(|i| *i as usize);
    let colors = corners().map(|i| {
        let [r, g, b] = chunk.mesh.colors.get(i).copied().unwrap_or([128; 3]).map(|c| f32::from(c) / 255.0);
        Color { r, g, b, a: 1.0 }
    });
    Marker {
        id: chunk.id,
        points: corners().map(|i| point_message(&chunk.mesh.vertices[i].cast())).collect(),
        colors: colors.collect(),
        ..triangle_marker(SURFACE, header, Color { r: 0.5, g: 0.5, b: 0.5, a: 1.0 })
    }
}

/// Marker that deletes a chunk.
#[must_use]
pub(crate) fn gone_chunk(id: i32, header: &Header) -> Marker {
    Marker { header: header.clone(), ns: SURFACE.into(), id, action: action::DELETE, ..Marker::default() }
}

/// Markers of unseen space, as squares of its area, and of the next view, as a pyramid.
#[must_use]
pub(crate) fn unseen_markers(products: &LiveProducts, header: &Header) -> MarkerArray {
    let squares = Marker {
        points: products.unseen.patches.iter().flat_map(patch_square).map(|p| point_message(&p)).collect(),
        ..triangle_marker(UNSEEN, header, Color { r: 0.9, g: 0.1, b: 0.8, a: 0.5 })
    };
    let next = match &products.next_view {
        Some(next) => Marker {
            header: header.clone(),
            ns: NEXT_VIEW.into(),
            kind: kind::LINE_LIST,
            pose: upright_transform(),
            scale: [0.004, 0.0, 0.0].into(),
            color: Color { r: 0.1, g: 0.9, b: 0.3, a: 1.0 },
            points: view_pyramid(&next.world_from_camera, &products.intrinsics),
            ..Marker::default()
        },
        None => Marker {
            header: header.clone(),
            ns: NEXT_VIEW.into(),
            action: action::DELETE,
            ..Marker::default()
        },
    };
    MarkerArray { markers: vec![or_gone(squares), next] }
}

/// Pose of the next view; `None` if none is worthwhile.
#[must_use]
pub(crate) fn next_view(products: &LiveProducts, header: &Header) -> Option<PoseStamped> {
    let next = products.next_view.as_ref()?;
    Some(PoseStamped { header: header.clone(), pose: Transform::from_pose(&next.world_from_camera) })
}

/// Markers of surface that appeared and that is gone since state 0; `None` without a comparison.
#[must_use]
pub(crate) fn moved_markers(products: &LiveProducts, header: &Header) -> Option<MarkerArray> {
    let moved = products.moved.as_ref()?;
    let orange = Color { r: 1.0, g: 0.6, b: 0.0, a: 0.9 };
    let blue = Color { r: 0.1, g: 0.6, b: 1.0, a: 0.6 };
    let appeared = moved_marker(0, &moved.appeared, header, orange);
    let gone = moved_marker(1, &moved.gone, header, blue);
    Some(MarkerArray { markers: vec![appeared, gone] })
}

/// Marker with at most [`MOST_MOVED`] triangles of a surface.
fn moved_marker(id: i32, mesh: &TriangleMesh, header: &Header, color: Color) -> Marker {
    let every = mesh.triangles.len().div_ceil(MOST_MOVED).max(1);
    let corners = (0..mesh.triangles.len()).step_by(every).flat_map(|t| mesh.corners(t));
    let points = corners.map(|p| point_message(&p.cast())).collect();
    or_gone(Marker { id, points, ..triangle_marker(MOVED, header, color) })
}

fn triangle_marker(group: &str, header: &Header, color: Color) -> Marker {
    Marker {
        header: header.clone(),
        ns: group.into(),
        kind: kind::TRIANGLE_LIST,
        pose: upright_transform(),
        scale: [1.0, 1.0, 1.0].into(),
        color,
        ..Marker::default()
    }
}

/// Deletes a marker without points, which viewers reject.
fn or_gone(marker: Marker) -> Marker {
    if marker.points.is_empty() { Marker { action: action::DELETE, ..marker } } else { marker }
}

/// The identity rotation, as a zero quaternion is invalid.
fn upright_transform() -> Transform {
    Transform::from_pose(&Pose::identity())
}

fn point_message(p: &Point3<f64>) -> Point {
    <[f64; 3]>::from(p.coords).into()
}

/// Two triangles that form a square with the patch's area, perpendicular to its normal.
fn patch_square(patch: &UnseenPatch) -> [Point3<f64>; 6] {
    let half = 0.5 * patch.area_m2.sqrt();
    let [u, v] = normals_of(&patch.normal).map(|across| across * half);
    let [a, b, c, d] = [-u - v, u - v, u + v, -u + v].map(|offset| patch.center + offset);
    [a, b, c, a, c, d]
}

/// The edges of a camera's field of view.
fn view_pyramid(world_from_camera: &Pose, k: &Intrinsics) -> Vec<Point> {
    let ends = [(0, 0), (k.width, 0), (k.width, k.height), (0, k.height)]
        .map(|(u, v)| world_from_camera * k.unproject(u as f64 - 0.5, v as f64 - 0.5, PYRAMID_M));
    let eye = Point3::from(world_from_camera.translation.vector);
    (0..4).flat_map(|i| [eye, ends[i], ends[i], ends[(i + 1) % 4]]).map(|p| point_message(&p)).collect()
}
