//! Reads URDF files and their meshes as a tree.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use nalgebra::{Unit, Vector3};

use super::{MeshFileError, mesh_files::read_mesh_within, package_path::named_path, urdf_fault::UrdfFault};
use common::files;
use common::limits::{MESH, URDF, with_declaration};
use export::{Description, Geometry, JointText, LinkText};
use model::{JointType, Tree, TreeError, TreeJoint, TreeLink};
use surface::{TriangleMesh, merged_mesh};

/// Why a URDF could not be read.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// The disk refused.
    #[error("cannot read {path}: {source}")]
    Disk {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The text is no usable URDF.
    #[error("{path}: {problem}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: UrdfFault,
    },
    /// The links do not form a tree.
    #[error("{path}: {source}")]
    Tree {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: TreeError,
    },
    /// A mesh could not be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}

impl UrdfError {
    /// A fault in the text of a file.
    pub(super) fn of(path: &Path, problem: impl Into<UrdfFault>) -> Self {
        Self::Format { path: path.to_owned(), problem: problem.into() }
    }
}

/// Reads a URDF and its visual meshes (relative paths, or `package://` with a ROS package or the URDF's
/// folder as the package); scales and origins of visuals are applied. Visuals without a mesh are left out.
///
/// # Errors
/// If a file cannot be read or exceeds 16 MiB; a joint type is not fixed, revolute, continuous or
/// prismatic; links form no tree; or a mesh is absolute, remote, outside of the URDF's folder and packages,
/// missing or damaged.
pub fn read_urdf(path: &Path) -> Result<Tree, UrdfError> {
    let (description, _) = read_description(path)?;
    let description = description.require_numbers().map_err(|e| UrdfError::of(path, e))?;
    tree_of(&description, path)
}

/// The links of a URDF at `path` with their visual meshes, as a tree. The description must be sound.
///
/// # Errors
/// As [`read_urdf`].
pub(super) fn tree_of(description: &Description, path: &Path) -> Result<Tree, UrdfError> {
    let mut links = Vec::with_capacity(description.links.len());
    // One budget for all meshes: a short URDF may refer to a large file ten thousand times.
    let mut left = MESH.bytes;
    for link in &description.links {
        links.push(TreeLink {
            name: link.name.clone(),
            visual: visuals(link, path, &mut left).map_err(|e| e.at(path))?,
        });
    }
    let joints = tree_joints(description).map_err(|e| UrdfError::of(path, e))?;
    Tree::new(links, joints).map_err(|source| UrdfError::Tree { path: path.to_owned(), source })
}

/// Reads a URDF file and returns its text as well, with a declaration that XML readers accept
/// ([`with_declaration`]).
///
/// # Errors
/// If the disk refuses, the file exceeds 16 MiB, or the text is not UTF-8 or not a URDF.
pub(super) fn read_description(path: &Path) -> Result<(Description, String), UrdfError> {
    let text = files::read_text(path, URDF);
    let text = text.map_err(|source| UrdfError::Disk { path: path.to_owned(), source })?;
    let text = with_declaration(&text).into_owned();
    if is_template(&text) {
        return Err(UrdfError::of(path, xacro_fault(path)));
    }
    let description = Description::parse(&text).map_err(|e| UrdfError::of(path, e))?;
    Ok((description, text))
}

/// Whether a text is a xacro template. What xacro writes keeps the namespace, and no expressions.
fn is_template(text: &str) -> bool {
    text.contains("xmlns:xacro") && ["<xacro:", "${", "$("].iter().any(|sign| text.contains(sign))
}

/// The fault of a xacro template at a path.
pub(super) fn xacro_fault(template: &Path) -> UrdfFault {
    let expanded = template.with_extension("");
    let is_named = expanded.extension().is_some_and(|e| e == "urdf") && expanded != template;
    let expanded = if is_named { expanded } else { template.with_extension("expanded.urdf") };
    UrdfFault::Xacro(template.display().to_string(), expanded.display().to_string())
}

/// A fault of a visual: its mesh, or the path to it.
enum VisualError {
    Mesh(MeshFileError),
    Path(UrdfFault),
}

impl VisualError {
    fn at(self, urdf: &Path) -> UrdfError {
        match self {
            Self::Mesh(e) => UrdfError::Mesh(e),
            Self::Path(problem) => UrdfError::of(urdf, problem),
        }
    }
}

/// All visual meshes of a link as one, in the link frame. `left` is the remaining budget, bytes.
fn visuals(link: &LinkText, urdf: &Path, left: &mut u64) -> Result<TriangleMesh, VisualError> {
    let mut all = Vec::new();
    for shape in &link.visuals {
        let Geometry::Mesh { path, scale } = &shape.geometry else { continue };
        let file = named_path(urdf, path).map_err(VisualError::Path)?;
        let mut mesh = read_mesh_within(&file, left).map_err(VisualError::Mesh)?;
        // URDF scales a mesh in the mesh's own frame, before the visual's origin moves it.
        for p in &mut mesh.vertices {
            p.coords.component_mul_assign(&scale.cast());
        }
        all.push(mesh.transformed(&shape.link_from_shape));
    }
    Ok(merged_mesh(&all.iter().collect::<Vec<_>>()))
}

/// The joints of a URDF, each between the indices of its links.
///
/// # Errors
/// An unsupported type, a missing link, an axis without length.
pub(super) fn tree_joints(description: &Description) -> Result<Vec<TreeJoint>, UrdfFault> {
    let index: BTreeMap<&str, usize> =
        description.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
    description.joints.iter().map(|j| tree_joint(j, &index)).collect()
}

fn tree_joint(joint: &JointText, index: &BTreeMap<&str, usize>) -> Result<TreeJoint, UrdfFault> {
    let kind = match joint.kind.as_str() {
        "fixed" => JointType::Fixed,
        "revolute" => JointType::Revolute,
        "continuous" => JointType::Continuous,
        "prismatic" => JointType::Prismatic,
        other => return Err(UrdfFault::JointType { joint: joint.name.clone(), kind: other.to_owned() }),
    };
    let no_link = |name: &str| UrdfFault::NoLink { joint: joint.name.clone(), link: name.to_owned() };
    let axis = match Unit::try_new(joint.axis.unwrap_or_else(Vector3::x), 1e-9) {
        Some(axis) => axis,
        // A fixed joint has no axis; writers leave it out or put zeros there.
        None if kind == JointType::Fixed => Vector3::x_axis(),
        None => return Err(UrdfFault::NoAxis(joint.name.clone())),
    };
    Ok(TreeJoint {
        name: joint.name.clone(),
        kind,
        parent: *index.get(joint.parent.as_str()).ok_or_else(|| no_link(&joint.parent))?,
        child: *index.get(joint.child.as_str()).ok_or_else(|| no_link(&joint.child))?,
        parent_from_joint: joint.parent_from_joint,
        axis,
        mimic: joint.mimic.clone(),
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{Place, ResultKind, RunDir};
    use export::{ExportConfig, urdf_package};
    use model::example::cabinet;

    #[test]
    fn a_written_model_reads_back_in_every_pose() {
        let model = cabinet();
        let temp = tempfile::tempdir().unwrap();
        let run = RunDir::open(&Place::named(temp.path(), &model.name), ResultKind::Reconstruct).unwrap();
        for file in urdf_package(&model, &ExportConfig::default()) {
            run.put(&file.path, &file.bytes).unwrap();
        }
        let tree = read_urdf(&run.commit().unwrap().folder.join("cabinet.urdf")).unwrap();
        for state in &model.states {
            let positions = model.joints.iter().map(|j| j.name.clone()).zip(state.iter().copied()).collect();
            for (i, link) in model.links.iter().enumerate() {
                let k = tree.links.iter().position(|l| l.name == link.name).unwrap();
                let a = model.world_from_link(i, state);
                let b = tree.world_from_link(k, &positions);
                let worst = link.visual.vertices.iter().zip(&tree.links[k].visual.vertices);
                let worst = worst
                    .map(|(x, y)| (a * x.cast::<f64>() - b * y.cast::<f64>()).norm())
                    .fold(0.0, f64::max);
                assert!(worst < 1e-6, "{}: {worst}", link.name);
            }
        }
    }

    fn read(text: &str) -> Result<Tree, UrdfError> {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("x.urdf");
        fs::write(&path, format!("<robot name='x'>{text}</robot>")).unwrap();
        fs::write(temp.path().join("m.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        read_urdf(&path)
    }

    #[test]
    fn scale_origin_and_defaults_are_applied() {
        let mesh = "<link name='a'><visual><origin xyz='0 0 5'/><geometry><mesh \
            filename='package://x/m.obj' scale='2 1 1'/></geometry></visual></link>";
        let tree = read(&format!(
            "{mesh}<link name='b'/><joint name='j' type='continuous'><parent \
                link='a'/><child link='b'/></joint>"
        ))
        .unwrap();
        assert_eq!(tree.links[0].visual.vertices[1], nalgebra::Point3::new(2.0, 0.0, 5.0));
        assert_eq!(tree.joints[0].axis, Vector3::x_axis());
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        let joint = |kind: &str, child: &str, axis: &str| {
            format!(
                "<link name='a'/><link name='b'/><joint name='j' type='{kind}'><parent link='a'/><child \
                 link='{child}'/><axis xyz='{axis}'/></joint>"
            )
        };
        let mesh = |path: &str| {
            format!("<link name='a'><visual><geometry><mesh filename='{path}'/></geometry></visual></link>")
        };
        for (text, message) in [
            ("<link".to_owned(), "x.urdf"),
            (joint("floating", "b", "1 0 0"), "is of type 'floating'"),
            (joint("revolute", "c", "1 0 0"), "unknown link 'c'"),
            (joint("revolute", "b", "0 0 0"), "it must be a direction"),
            (joint("revolute", "b", "inf 0 0"), "'j': the xyz of <axis> is 'inf 0 0'"),
            (joint("fixed", "b", "1 nan 0"), "'j': the xyz of <axis> is '1 nan 0'"),
            (joint("revolute", "b", "1e200 0 0"), "coordinates beyond 1e6"),
            (joint("revolute", "a", "1 0 0"), "in a loop"),
            (mesh("m.obj' scale='1 1e39 1"), "'a': the scale of <mesh> is '1 1e39 1'"),
            (mesh("/etc/x.obj"), "not below"),
            (mesh("../x.obj"), "not below"),
            (mesh("file:///x.obj"), "not a relative path"),
            (mesh("none.obj"), "cannot read"),
        ] {
            let error = read(&text).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
