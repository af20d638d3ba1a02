//! The dynamics of a twin from a URDF: masses, axes, damping, friction, limits. Meshes are not read.

use std::{collections::BTreeMap, path::Path};

use nalgebra::{Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::{
    UrdfError,
    urdf::{check_numbers, robot_of},
};
use crate::{
    files,
    gap::twin_tree::{Motion, TwinJoint, TwinLink, TwinTree},
    geometry::Pose,
    limits::URDF,
};

/// Reads a twin, and gives its text too; `gravity` is given in the root's frame, m/s^2.
///
/// # Errors
/// [`UrdfError`] where the file cannot be read, is no URDF, or its links are no tree.
pub fn read_twin(path: &Path, gravity: [f64; 3]) -> Result<(TwinTree, String), UrdfError> {
    let disk = |source| UrdfError::Disk { path: path.to_owned(), source };
    let format = |problem: String| UrdfError::Format { path: path.to_owned(), problem };
    let text = files::read_text(path, URDF).map_err(disk)?;
    let tree = twin_of(&text, gravity).map_err(format)?;
    Ok((tree, text))
}

/// The twin of a URDF's text.
///
/// # Errors
/// A sentence about what is wrong.
pub fn twin_of(text: &str, gravity: [f64; 3]) -> Result<TwinTree, String> {
    let robot = robot_of(text)?;
    let index: BTreeMap<&str, usize> = robot.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
    let links: Result<Vec<TwinLink>, String> = robot.links.iter().map(link).collect();
    let mut joints: Vec<TwinJoint> = Vec::with_capacity(robot.joints.len());
    for j in &robot.joints {
        joints.push(joint(j, &index)?);
    }
    let mut is_child = vec![false; robot.links.len()];
    for j in &joints {
        if std::mem::replace(&mut is_child[j.child], true) {
            return Err(format!("link '{}' is the child of two joints", robot.links[j.child].name));
        }
    }
    let roots: Vec<usize> = (0..is_child.len()).filter(|&i| !is_child[i]).collect();
    let [root] = roots[..] else {
        return Err(format!("the links must hang on one root, there are {}", roots.len()));
    };
    let mut sorted: Vec<TwinJoint> = Vec::with_capacity(joints.len());
    let mut reached = vec![false; robot.links.len()];
    reached[root] = true;
    while sorted.len() < joints.len() {
        let before = sorted.len();
        for j in &joints {
            if reached[j.parent] && !reached[j.child] {
                reached[j.child] = true;
                sorted.push(j.clone());
            }
        }
        if sorted.len() == before {
            return Err("some joints make a loop".to_owned());
        }
    }
    Ok(TwinTree { name: robot.name.clone(), links: links?, joints: sorted, root, gravity: Vector3::from(gravity) })
}

fn link(link: &urdf_rs::Link) -> Result<TwinLink, String> {
    let i = &link.inertial;
    let frame = pose(&i.origin);
    let t = &i.inertia;
    let inertia = Matrix3::new(t.ixx, t.ixy, t.ixz, t.ixy, t.iyy, t.iyz, t.ixz, t.iyz, t.izz);
    let r = frame.rotation.to_rotation_matrix();
    let all = inertia.iter().chain([&i.mass.value]).chain(frame.translation.vector.iter());
    if !all.clone().all(|x| x.is_finite()) || i.mass.value < 0.0 {
        return Err(format!("link '{}': mass, center and inertia must be finite, the mass not negative", link.name));
    }
    Ok(TwinLink {
        name: link.name.clone(),
        mass_kg: i.mass.value,
        center_of_mass: Point3::from(frame.translation.vector),
        inertia: r.matrix() * inertia * r.matrix().transpose(),
    })
}

fn joint(joint: &urdf_rs::Joint, index: &BTreeMap<&str, usize>) -> Result<TwinJoint, String> {
    let name = &joint.name;
    let of = |link: &str| index.get(link).copied().ok_or_else(|| format!("joint '{name}' names a link '{link}' that is not there"));
    let motion = match joint.joint_type {
        urdf_rs::JointType::Fixed => Motion::Fixed,
        urdf_rs::JointType::Revolute | urdf_rs::JointType::Continuous => Motion::Turn,
        urdf_rs::JointType::Prismatic => Motion::Slide,
        ref other => return Err(format!("joint '{name}' is of type {other:?}; revolute, continuous, prismatic and fixed are supported")),
    };
    check_numbers(joint)?;
    let axis = Unit::try_new(Vector3::from(*joint.axis.xyz), 1e-9).ok_or_else(|| format!("joint '{name}' has an axis of length 0"));
    let dynamics = joint.dynamics.as_ref();
    let limited = joint.joint_type != urdf_rs::JointType::Continuous && joint.limit.upper > joint.limit.lower;
    Ok(TwinJoint {
        name: name.clone(),
        motion,
        parent: of(&joint.parent.link)?,
        child: of(&joint.child.link)?,
        parent_from_joint: pose(&joint.origin),
        axis: if motion == Motion::Fixed { Vector3::z_axis() } else { axis? },
        damping: dynamics.map_or(0.0, |d| d.damping),
        friction: dynamics.map_or(0.0, |d| d.friction),
        limit: limited.then_some((joint.limit.lower, joint.limit.upper)),
        is_mimic: joint.mimic.is_some(),
    })
}

fn pose(origin: &urdf_rs::Pose) -> Pose {
    let [roll, pitch, yaw] = *origin.rpy;
    Pose::from_parts(Translation3::from(Vector3::from(*origin.xyz)), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}
