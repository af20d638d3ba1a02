//! The true twin of a synthetic object: a URDF with the meshes of its parts, in the world of state 0.

use std::fmt::Write as _;

use super::{RunDir, RunDirError};
use geometry::{AxisMotion, Pose};
use model::escape_xml;
use synth::Object;

/// Writes `truth/twin.urdf` and `truth/meshes/part_K.obj`. Joints are at 0 in the object's rest frame. As
/// URDF has no screw joint, a screw is a revolute joint with its pitch in an element `artitwin:thread`.
///
/// # Errors
/// An error of the disk.
pub(super) fn put_twin(folder: &RunDir, object: &Object) -> Result<(), RunDirError> {
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{}\" xmlns:artitwin=\"urn:artitwin:urdf\">\n",
        escape_xml(object.family)
    );
    // Writing to a String cannot fail.
    for (k, part) in object.parts.iter().enumerate() {
        // The frame of a part is that of its joint, so the joint turns about its origin.
        let part_from_rest = part.joint.map_or(object.world_from_rest, |j| {
            Pose::from_parts((-j.origin.coords).into(), Default::default())
        });
        let mesh = object.mesh_of_part(k).transformed(&part_from_rest);
        let mut obj = String::new();
        mesh.vertices.iter().for_each(|v| writeln!(obj, "v {} {} {}", v.x, v.y, v.z).unwrap_or_default());
        mesh.triangles
            .iter()
            // OBJ counts vertices from 1.
            .for_each(|t| writeln!(obj, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap_or_default());
        folder.put(&format!("truth/meshes/part_{k}.obj"), obj.as_bytes())?;
        // Any mass will do: the truth has no masses, and a twin without masses is refused.
        writeln!(
            text,
            "  <link name=\"{}\"><inertial><origin xyz=\"0 0 0\" rpy=\"0 0 0\"/><mass \
             value=\"1\"/><inertia ixx=\"0.01\" ixy=\"0\" \
             ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.01\"/></inertial><visual><origin xyz=\"0 0 0\" \
             rpy=\"0 0 0\"/><geometry>\
             <mesh filename=\"meshes/part_{k}.obj\"/></geometry></visual></link>",
            escape_xml(&part.name)
        )
        .unwrap_or_default();
    }
    for part in &object.parts {
        let Some(joint) = part.joint else { continue };
        let parent_from_rest = object.parts[joint.parent].joint.map_or(object.world_from_rest, |j| {
            Pose::from_parts((-j.origin.coords).into(), Default::default())
        });
        let origin = parent_from_rest * Pose::translation(joint.origin.x, joint.origin.y, joint.origin.z);
        let t = origin.translation.vector;
        let [r, p, y] = export::roll_pitch_yaw(&origin.rotation);
        let (kind, thread) = match joint.kind {
            AxisMotion::Revolute => ("revolute", String::new()),
            AxisMotion::Prismatic => ("prismatic", String::new()),
            AxisMotion::Screw { pitch_m_per_rad } => (
                "revolute",
                format!("<artitwin:thread type=\"screw\" pitch_m_per_rad=\"{pitch_m_per_rad}\"/>"),
            ),
        };
        writeln!(
            text,
            "  <joint name=\"{}_joint\" type=\"{kind}\"><origin xyz=\"{} {} {}\" rpy=\"{r} {p} \
             {y}\"/><parent link=\"{}\"/><child link=\"{}\"/>\
             <axis xyz=\"{} {} {}\"/><limit lower=\"{}\" upper=\"{}\" effort=\"100\" \
             velocity=\"1\"/>{thread}</joint>",
            escape_xml(&part.name),
            t.x,
            t.y,
            t.z,
            escape_xml(&object.parts[joint.parent].name),
            escape_xml(&part.name),
            joint.axis.x,
            joint.axis.y,
            joint.axis.z,
            joint.limits[0],
            joint.limits[1]
        )
        .unwrap_or_default();
    }
    text.push_str("</robot>\n");
    folder.put("truth/twin.urdf", text.as_bytes())
}
