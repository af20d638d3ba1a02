//! The dynamics of a twin from a URDF: masses, axes, damping, friction, limits. Meshes are not read.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use nalgebra::{Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::{UrdfError, urdf::robot_of, urdf_fault::UrdfFault};
use crate::{
    export::require_sound,
    files,
    gap::twin_tree::{Motion, TwinJoint, TwinLink, TwinTree},
    geometry::Pose,
    limits::{CHAIN_WORK, URDF},
};

/// Reads a twin, and gives its text too; `gravity` is given in the root's frame, m/s^2.
///
/// # Errors
/// [`UrdfError`] where the file cannot be read, is no URDF, or describes no bodies ([`require_sound`]).
pub fn read_twin(path: &Path, gravity: [f64; 3]) -> Result<(TwinTree, String), UrdfError> {
    let disk = |source| UrdfError::Disk { path: path.to_owned(), source };
    let format = |problem| UrdfError::Format { path: path.to_owned(), problem };
    let text = files::read_text(path, URDF).map_err(disk)?;
    let tree = twin_of(&text, gravity).map_err(format)?;
    Ok((tree, text))
}

/// Files that a twin consists of: the URDF, whose text is given, the SDF and USD that stand beside it, and
/// what it names.
#[must_use]
pub fn twin_files(path: &Path, text: &str) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let value = |rest: &str| {
        let rest = rest.trim_start().strip_prefix('=')?.trim_start();
        let quote = rest.chars().next().filter(|c| "'\"".contains(*c))?;
        rest[1..].split_once(quote).map(|(value, _)| value.to_owned())
    };
    // By its words, not as XML: what cannot be parsed is refused elsewhere, and a file named in a comment
    // does no harm.
    let named = text.split("filename").skip(1).filter_map(value).map(|name| match name.split_once("://") {
        Some(("package", rest)) => folder.join(rest.split_once('/').map_or(rest, |(_, path)| path)),
        Some((_, rest)) => PathBuf::from(rest),
        None => folder.join(name),
    });
    [path.to_owned(), path.with_file_name("model.sdf"), path.with_extension("usda")]
        .into_iter()
        .chain(named)
        .collect()
}

/// The twin of a URDF's text.
///
/// # Errors
/// [`UrdfFault`].
pub fn twin_of(text: &str, gravity: [f64; 3]) -> Result<TwinTree, UrdfFault> {
    require_sound(text)?;
    let robot = robot_of(text)?;
    let index: BTreeMap<&str, usize> =
        robot.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
    let mut joints: Vec<TwinJoint> = Vec::with_capacity(robot.joints.len());
    for j in &robot.joints {
        joints.push(joint(j, &index)?);
    }
    // The work of a diagnosis grows with this product, whatever the recordings.
    let moving = joints.iter().filter(|j| j.motion != Motion::Fixed).count();
    if moving * robot.links.len() > CHAIN_WORK {
        return Err(UrdfFault::Chain { moving, links: robot.links.len() });
    }
    let mut is_child = vec![false; robot.links.len()];
    for j in &joints {
        is_child[j.child] = true;
    }
    let roots: Vec<usize> = (0..is_child.len()).filter(|&i| !is_child[i]).collect();
    let [root] = roots[..] else {
        return Err(UrdfFault::Roots(roots.len()));
    };
    // Parents first. Each pass keeps the order of the file, so that results do not depend on names.
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
            return Err(UrdfFault::Loop);
        }
    }
    Ok(TwinTree {
        name: robot.name.clone(),
        links: robot.links.iter().map(link).collect(),
        joints: sorted,
        root,
        gravity: Vector3::from(gravity),
    })
}

fn link(link: &urdf_rs::Link) -> TwinLink {
    let i = &link.inertial;
    let frame = pose(&i.origin);
    let t = &i.inertia;
    let inertia = Matrix3::new(t.ixx, t.ixy, t.ixz, t.ixy, t.iyy, t.iyz, t.ixz, t.iyz, t.izz);
    let r = frame.rotation.to_rotation_matrix();
    TwinLink {
        name: link.name.clone(),
        mass_kg: i.mass.value,
        center_of_mass: Point3::from(frame.translation.vector),
        // URDF gives the inertia in the inertial frame; a twin holds it in that of the link.
        inertia: r.matrix() * inertia * r.matrix().transpose(),
    }
}

fn joint(joint: &urdf_rs::Joint, index: &BTreeMap<&str, usize>) -> Result<TwinJoint, UrdfFault> {
    let name = &joint.name;
    let of = |link: &str| {
        index
            .get(link)
            .copied()
            .ok_or_else(|| UrdfFault::NoLink { joint: name.clone(), link: link.to_owned() })
    };
    let motion = match joint.joint_type {
        urdf_rs::JointType::Fixed => Motion::Fixed,
        urdf_rs::JointType::Revolute | urdf_rs::JointType::Continuous => Motion::Turn,
        urdf_rs::JointType::Prismatic => Motion::Slide,
        ref other => {
            return Err(UrdfFault::JointType { joint: name.clone(), kind: format!("{other:?}") });
        }
    };
    let axis =
        Unit::try_new(Vector3::from(*joint.axis.xyz), 1e-9).ok_or_else(|| UrdfFault::NoAxis(name.clone()));
    let dynamics = joint.dynamics.as_ref();
    // A joint without limits reads as 0 to 0; those of a continuous joint hold effort and velocity only.
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
    Pose::from_parts(
        Translation3::from(Vector3::from(*origin.xyz)),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_a_twin_are_those_beside_it_and_those_it_names() {
        let text = "<mesh filename=\"meshes/a.obj\"/><mesh filename = 'package://x/m/b.obj'/><mesh \
            filename=\"file:///c.obj\"/><mesh filename=d";
        let files = twin_files(Path::new("runs/box/box.urdf"), text);
        let expected = ["box.urdf", "model.sdf", "box.usda", "meshes/a.obj", "m/b.obj"]
            .map(|f| Path::new("runs/box").join(f));
        assert_eq!(files[..5], expected);
        assert_eq!(files[5..], [PathBuf::from("/c.obj")]);
    }

    #[test]
    fn a_chain_that_would_take_minutes_is_refused() {
        let chain = |links: usize, kind: &str| {
            let bodies: String = (0..links)
                .map(|i| {
                    format!(
                        "<link name='l{i}'><inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' \
                        iyy='1' iyz='0' izz='1'/></inertial></link>"
                    )
                })
                .collect();
            let joints: String = (1..links)
                .map(|i| {
                    let p = i - 1;
                    format!(
                        "<joint name='j{i}' type='{kind}'><parent link='l{p}'/><child link='l{i}'/><axis \
                         xyz='0 0 1'/>\
                         <limit lower='-1' upper='1' effort='1' velocity='1'/></joint>"
                    )
                })
                .collect();
            twin_of(&format!("<robot name='r'>{bodies}{joints}</robot>"), [0.0; 3]).map(|t| t.joints.len())
        };
        assert_eq!(chain(100, "revolute"), Ok(99));
        assert_eq!(chain(400, "fixed"), Ok(399));
        assert!(
            chain(400, "revolute").is_err_and(|why| why.to_string().contains("399 joints move 400 links"))
        );
    }

    const TEXT: &str = "<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/><inertia \
        ixx='1' ixy='0' ixz='0' iyy='1' \
        iyz='0' izz='1'/></inertial></link><joint name='j' type='revolute'><origin xyz='0 0 1'/><parent \
        link='a'/><child link='b'/>\
        <axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='1' velocity='1'/><dynamics \
        damping='0.1'/></joint></robot>";

    #[test]
    fn a_twin_that_describes_no_bodies_is_refused() {
        let refused = |from: &str, to: &str| {
            assert!(TEXT.contains(from), "{from}");
            twin_of(&TEXT.replace(from, to), [0.0; 3]).expect_err(to).to_string()
        };
        assert_eq!(twin_of(TEXT, [0.0; 3]).unwrap().joints[0].limit, Some((-1.0, 1.0)));
        for (from, to, words) in [
            (
                "mass value='1'",
                "mass value='nan'",
                "'b': the value of <mass> is 'nan'; it must be a finite number",
            ),
            ("mass value='1'", "mass value='1e308'", "overflows"),
            ("xyz='0 0 1'/><parent", "xyz='0 nan 1'/><parent", "the xyz of <origin> is '0 nan 1'"),
            (
                "damping='0.1'",
                "damping='-0.1'",
                "the damping of <dynamics> is '-0.1'; it must not be negative",
            ),
            ("lower='-1' upper='1'", "lower='nan' upper='inf'", "(and 1 more: see `artitwin check`)"),
            ("lower='-1'", "lower='2'", "lower 2 is above upper 1"),
            ("ixx='1'", "ixx='-1'", "not positive"),
            ("<parent link='a'/>", "<parent link='b'/>", "in a loop of joints (b)"),
            ("<link name='a'/>", "<link name='a'/><link name='a'/>", "more than one of the links"),
        ] {
            let why = refused(from, to);
            assert!(why.contains(words), "'{words}' is not in: {why}");
        }
    }
}
