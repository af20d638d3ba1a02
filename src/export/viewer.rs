//! `viewer.html`: the twin in one page that opens from the disk, with a slider for every joint.

use base64::Engine as _;
use nalgebra::Point3;
use serde::Serialize;

use super::{
    drawn::Drawn,
    look::Look,
    picture::{axis_line, part_color},
};
use geometry::bounding_box;
use model::{ArticulatedModel, Link, escape_xml, script_json};
use surface::TriangleMesh;

const PAGE: &str = include_str!("viewer.html");

#[derive(Serialize)]
struct Data {
    center: [f64; 3],
    radius: f64,
    links: Vec<LinkData>,
    meshes: Vec<MeshData>,
    joints: Vec<JointData>,
}

#[derive(Serialize)]
struct LinkData {
    name: String,
    color: [u8; 3],
    /// Collision solids: three little-endian `f32` a corner, three corners a triangle, one string per solid.
    solids: Vec<String>,
}

#[derive(Serialize)]
struct MeshData {
    link: usize,
    /// Whether no view saw it.
    assumed: bool,
    /// Eight little-endian `f32` a corner, three corners a triangle: position, normal, texture coordinates.
    corners: String,
    texture_png: String,
}

#[derive(Serialize)]
struct JointData {
    name: String,
    kind: &'static str,
    /// Advance along the axis per radian, meters.
    pitch: f64,
    parent: usize,
    child: usize,
    /// Homogeneous matrix, column by column.
    parent_from_joint: Vec<f64>,
    axis: [f64; 3],
    /// Ends of the drawn axis in the frame of the child; a slide's arrow points towards rising positions.
    line: Option<[[f64; 3]; 2]>,
    lower: f64,
    upper: f64,
    start: f64,
}

/// The page with the meshes of a model. It loads nothing.
pub(crate) fn viewer_html(model: &ArticulatedModel, drawn: &[Drawn]) -> String {
    let (center, radius) = bounding_sphere(model);
    let data = Data {
        center: center.into(),
        radius,
        links: model.links.iter().enumerate().map(|(i, link)| link_data(link, i)).collect(),
        meshes: drawn.iter().map(mesh_data).collect(),
        joints: (0..model.joints.len()).map(|j| joint_data(model, j)).collect(),
    };
    // Text and numbers always serialize.
    let json = script_json(&serde_json::to_string(&data).unwrap_or_default());
    // The title is inserted on both sides of the data, so no placeholder inside the data is replaced.
    let [head, tail] = PAGE.split_once("@DATA@").map_or([PAGE, ""], |(head, tail)| [head, tail]);
    let titled = |part: &str| part.replace("@TITLE@", &escape_xml(&model.name));
    format!("{}{json}{}", titled(head), titled(tail))
}

fn link_data(link: &Link, part: usize) -> LinkData {
    LinkData {
        name: link.name.clone(),
        color: part_color(part),
        solids: link.collision.iter().map(|s| base64_text(&triangle_bytes(&s.to_mesh()))).collect(),
    }
}

fn mesh_data(drawn: &Drawn) -> MeshData {
    MeshData {
        link: drawn.link,
        assumed: drawn.visual.is_assumed,
        corners: base64_text(&corner_bytes(&drawn.look)),
        texture_png: base64_text(&drawn.png),
    }
}

fn joint_data(model: &ArticulatedModel, j: usize) -> JointData {
    let joint = &model.joints[j];
    let first = model.states.first().and_then(|s| s.get(j)).copied();
    JointData {
        name: joint.name.clone(),
        kind: joint.kind.nearest_simple().name(),
        pitch: joint.kind.pitch_m_per_rad().unwrap_or(0.0),
        parent: joint.parent,
        child: joint.child,
        parent_from_joint: joint.parent_from_joint.to_homogeneous().as_slice().to_vec(),
        axis: joint.axis.into_inner().into(),
        line: axis_line(model, joint).map(|line| line.map(Into::into)),
        lower: joint.limit.lower,
        upper: joint.limit.upper,
        start: first.unwrap_or(joint.limit.lower),
    }
}

/// Base64 text of floats, which is exact and shorter than JSON numbers.
fn base64_text(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

fn triangle_bytes(mesh: &TriangleMesh) -> Vec<u8> {
    let places = mesh.triangles.iter().flatten().map(|&i| <[f32; 3]>::from(mesh.vertices[i as usize]));
    places.flatten().flat_map(f32::to_le_bytes).collect()
}

fn corner_bytes(look: &Look) -> Vec<u8> {
    let mut bytes = Vec::new();
    for &i in look.triangles.iter().flatten() {
        let c = &look.corners[i as usize];
        let position = look.mesh.vertices[c.vertex as usize];
        let [normal_x, normal_y, normal_z] = [c.normal.x as f32, c.normal.y as f32, c.normal.z as f32];
        let [u, v] = c.uv.map(|t| t as f32);
        let values = [position.x, position.y, position.z, normal_x, normal_y, normal_z, u, v];
        bytes.extend(values.into_iter().flat_map(f32::to_le_bytes));
    }
    bytes
}

/// A sphere around the model in its first state.
fn bounding_sphere(model: &ArticulatedModel) -> (Point3<f64>, f64) {
    let none = vec![0.0; model.joints.len()];
    let positions = model.states.first().unwrap_or(&none);
    let points = model.links.iter().enumerate().flat_map(|(i, l)| {
        let pose = model.world_from_link(i, positions);
        l.visual.vertices.iter().map(move |p| pose * p.cast::<f64>())
    });
    let around = |(lo, hi): (Point3<f64>, Point3<f64>)| (nalgebra::center(&lo, &hi), 0.5 * (hi - lo).norm());
    bounding_box(points).map_or((Point3::origin(), 1.0), around)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawn::{drawn_meshes, plain_looks};
    use model::example::cabinet;

    #[test]
    fn the_page_holds_everything_and_asks_for_nothing() {
        let model = cabinet();
        let looks = plain_looks(&model);
        let page = viewer_html(&model, &drawn_meshes(&model, &looks));
        assert!(!page.contains("http") && !page.contains("@DATA@") && !page.contains("@TITLE@"));
        let json = page.split_once("application/json\">").unwrap().1.split_once("</script>").unwrap().0;
        let data: serde_json::Value = serde_json::from_str(json).unwrap();
        assert_eq!(
            (data["meshes"].as_array().unwrap().len(), data["joints"][1]["start"].as_f64()),
            (3, Some(0.18))
        );
        let bytes = base64::engine::general_purpose::STANDARD
            .decode(data["meshes"][0]["corners"].as_str().unwrap())
            .unwrap();
        assert_eq!(bytes.len(), 12 * 3 * 8 * 4);
        // A hinge's axis is drawn along its joint, and a collision box has twelve triangles.
        let line = |k: usize, c: usize| data["joints"][0]["line"][k][c].as_f64().unwrap();
        assert!((line(1, 2) - line(0, 2)).abs() > 0.1 && line(0, 0).abs() < 1e-12, "{}", data["joints"][0]);
        assert_eq!(data["links"][1]["name"], "door");
        let solid = data["links"][1]["solids"][0].as_str().unwrap();
        let solid = base64::engine::general_purpose::STANDARD.decode(solid).unwrap();
        assert_eq!(solid.len(), 12 * 3 * 3 * 4);
    }
}
