//! Reads the dynamics of a twin from a URDF: masses, axes, damping, friction, limits. Meshes are not read.

use std::{
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Matrix3, Point3, Vector3};

use super::{
    UrdfError,
    package_path::named_path,
    urdf::{read_description, tree_joints, xacro_fault},
    urdf_fault::UrdfFault,
};
use common::limits::CHAIN_WORK;
use export::{Description, InertialText, JointText, LimitText, LinkText};
use gap::twin_tree::{Motion, TwinJoint, TwinLink, TwinTree};
use model::{JointType, TreeJoint, inertia_excess};

/// The URDF at a path; in a folder, the only one except those for ROS (`*.ros.urdf`).
///
/// # Errors
/// An unreadable folder, or one without a URDF or with several.
pub fn twin_path(path: &Path) -> Result<PathBuf, UrdfError> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let disk = |source| UrdfError::Disk { path: path.to_owned(), source };
    let mut found = Vec::new();
    let mut templates = Vec::new();
    for entry in fs::read_dir(path).map_err(disk)? {
        let entry = entry.map_err(disk)?.path();
        let name = entry.file_name().unwrap_or_default().to_string_lossy();
        if name.ends_with(".urdf.xacro") {
            templates.push(entry);
        } else if name.ends_with(".urdf") && !name.ends_with(".ros.urdf") && !name.starts_with('.') {
            found.push(entry);
        }
    }
    match &found[..] {
        [one] => Ok(one.clone()),
        [] if !templates.is_empty() => Err(UrdfError::of(path, xacro_fault(&templates.remove(0)))),
        all => Err(UrdfError::of(path, UrdfFault::NotOneUrdf(all.len()))),
    }
}

/// Reads a twin and returns its text as well; `gravity` is in the root's frame, m/s^2.
///
/// # Errors
/// [`UrdfError`] where the file cannot be read, is no URDF, or describes no bodies
/// ([`Description::require_sound`]).
pub fn read_twin(path: &Path, gravity: [f64; 3]) -> Result<(TwinTree, String), UrdfError> {
    let (description, text) = read_description(path)?;
    Ok((twin_tree(description, gravity).map_err(|e| UrdfError::of(path, e))?, text))
}

/// Files of a twin: the URDF with the given text, the SDF and USD beside it, and the files to which it
/// refers.
#[must_use]
pub fn twin_files(path: &Path, text: &str) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new(""));
    // Found in the text, not in parsed XML: what cannot be parsed is refused elsewhere, and a file named in a
    // comment does no harm.
    let named = text.split("filename").skip(1).filter_map(quoted_value);
    let named = named.map(|name| match named_path(path, &name) {
        Ok(file) => file,
        Err(_) => name.split_once("://").map_or_else(|| folder.join(&name), |(_, rest)| PathBuf::from(rest)),
    });
    [path.to_owned(), path.with_file_name("model.sdf"), path.with_extension("usda")]
        .into_iter()
        .chain(named)
        .collect()
}

/// Value of an attribute; `rest` is the text after its name.
fn quoted_value(rest: &str) -> Option<String> {
    let rest = rest.trim_start().strip_prefix('=')?.trim_start();
    let quote = rest.chars().next().filter(|c| "'\"".contains(*c))?;
    rest[1..].split_once(quote).map(|(value, _)| value.to_owned())
}

/// The twin of a URDF's text.
///
/// # Errors
/// `UrdfFault`.
pub fn twin_of(text: &str, gravity: [f64; 3]) -> Result<TwinTree, UrdfFault> {
    twin_tree(Description::parse(text)?, gravity)
}

fn twin_tree(description: Description, gravity: [f64; 3]) -> Result<TwinTree, UrdfFault> {
    let mut description = description.require_sound()?;
    let links: Vec<TwinLink> = description.links.iter().map(twin_link).collect();
    let free = fix_free_joints(&mut description);
    let placed = tree_joints(&description)?;
    let texts = description.joints.iter().zip(free);
    let joints: Vec<TwinJoint> = texts.zip(placed).map(|((j, free), at)| joint(j, free, at)).collect();
    // The work of a diagnosis grows with this product, whatever the recordings.
    let moving = joints.iter().filter(|j| j.motion != Motion::Fixed).count();
    if moving * links.len() > CHAIN_WORK {
        return Err(UrdfFault::Chain { moving, links: links.len() });
    }
    let mut is_child = vec![false; links.len()];
    for j in &joints {
        is_child[j.child] = true;
    }
    let roots: Vec<usize> = (0..is_child.len()).filter(|&i| !is_child[i]).collect();
    let [root] = roots[..] else {
        return Err(UrdfFault::Roots(roots.len()));
    };
    // Parents first. Each pass keeps the order of the file, so results do not depend on names.
    let mut sorted: Vec<TwinJoint> = Vec::with_capacity(joints.len());
    let mut reached = vec![false; links.len()];
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
    Ok(TwinTree { name: description.name, links, joints: sorted, root, gravity: Vector3::from(gravity) })
}

/// A link; without `<inertial>` its mass and inertia are 0.
fn twin_link(link: &LinkText) -> TwinLink {
    let Some(inertial) = &link.inertial else {
        return TwinLink {
            name: link.name.clone(),
            mass_kg: 0.0,
            center_of_mass: Point3::origin(),
            inertia: Matrix3::zeros(),
            inertia_excess: 0.0,
        };
    };
    let tensor = inertia_tensor(inertial);
    let r = inertial.link_from_inertial.rotation.to_rotation_matrix();
    TwinLink {
        name: link.name.clone(),
        mass_kg: inertial.mass.unwrap_or(0.0),
        center_of_mass: Point3::from(inertial.link_from_inertial.translation.vector),
        // URDF gives the inertia in the inertial frame, a twin in the link frame.
        inertia: r.matrix() * tensor.unwrap_or_default() * r.matrix().transpose(),
        inertia_excess: tensor.as_ref().map_or(f64::INFINITY, inertia_excess),
    }
}

/// The inertia in its frame, kg m^2; zeros where it has none, `None` where an element is missing.
fn inertia_tensor(inertial: &InertialText) -> Option<Matrix3<f64>> {
    if inertial.inertia.iter().all(Option::is_none) {
        return Some(Matrix3::zeros());
    }
    let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
    Some(Matrix3::new(xx?, xy?, xz?, xy?, yy?, yz?, xz?, yz?, zz?))
}

/// Makes floating and planar joints fixed; gives for each joint whether it was one.
fn fix_free_joints(description: &mut Description) -> Vec<bool> {
    let mut free = Vec::with_capacity(description.joints.len());
    for joint in &mut description.joints {
        let is_free = ["floating", "planar"].contains(&joint.kind.as_str());
        if is_free {
            joint.kind = "fixed".to_owned();
        }
        free.push(is_free);
    }
    free
}

fn joint(text: &JointText, is_free: bool, placed: TreeJoint) -> TwinJoint {
    let motion = match placed.kind {
        JointType::Fixed => Motion::Fixed,
        JointType::Revolute | JointType::Continuous => Motion::Turn,
        JointType::Prismatic => Motion::Slide,
    };
    // A joint without limits reads as 0 to 0; those of a continuous joint hold effort and velocity only.
    let [lower, upper] = text.limit.as_ref().map_or([0.0; 2], LimitText::range);
    let limited = placed.kind != JointType::Continuous && upper > lower;
    TwinJoint {
        name: placed.name,
        motion,
        parent: placed.parent,
        child: placed.child,
        parent_from_joint: placed.parent_from_joint,
        axis: if motion == Motion::Fixed { Vector3::z_axis() } else { placed.axis },
        damping: text.damping,
        friction: text.friction,
        limit: limited.then_some((lower, upper)),
        mimic: placed.mimic,
        is_free,
    }
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
    fn a_folder_leads_to_its_only_urdf() {
        let temp = tempfile::tempdir().unwrap();
        let none = twin_path(temp.path()).unwrap_err().to_string();
        assert!(none.contains("holds 0 .urdf files"), "{none}");
        for name in ["box.urdf", "box.ros.urdf", ".box.urdf", "box.xml"] {
            fs::write(temp.path().join(name), "").unwrap();
        }
        let urdf = temp.path().join("box.urdf");
        assert_eq!((twin_path(temp.path()).unwrap(), twin_path(&urdf).unwrap()), (urdf.clone(), urdf));
        fs::write(temp.path().join("lid.urdf"), "").unwrap();
        assert!(twin_path(temp.path()).unwrap_err().to_string().contains("holds 2 .urdf files; name one"));
        assert_eq!(twin_path(&temp.path().join("gone")).unwrap(), temp.path().join("gone"));
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
            ("<parent link='a'/>", "<parent link='b'/>", "in a loop of joints (b)"),
            ("<link name='a'/>", "<link name='a'/><link name='a'/>", "more than one of the links"),
        ] {
            let why = refused(from, to);
            assert!(why.contains(words), "'{words}' is not in: {why}");
        }
    }
}
