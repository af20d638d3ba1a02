//! The URDFs that newton-physics/urdf-usd-converter (Apache-2.0) tests its reader with, through `check` and
//! through the readers of `diagnose`. They lie in `tests/conformance/urdf.tar.zst`; a name that begins with
//! `error_` is of a file to be refused, one with `warning_` of a file to be warned of, others are sound.

use std::{collections::BTreeSet, fs, path::PathBuf};

use super::{conformance_tests::files, read_model, read_model_folder, read_seen_twin, read_twin, twin_path};
use export::{CheckFinding, Level, check_folder};

/// What a file is to be refused or warned of for: rule and words.
const FAULTS: [(&str, &str, &str); 32] = [
    ("error_convert_loop_joint_structure", "tree", "in a loop of joints (link1, link2, link3)"),
    ("error_dupilcate_material_names", "name", "more than one of the materials"),
    ("error_duplicate_joint_names", "name", "more than one of the joints"),
    ("error_duplicate_link_names", "name", "more than one of the links"),
    ("error_incorrect_joint_child_link_name", "tree", "'link_dummy', which is not there"),
    ("error_incorrect_joint_parent_link_name", "tree", "'BaseLink_dummy', which is not there"),
    ("error_incorrect_joint_type", "joint", "is of type 'incorrect_type'"),
    ("error_incorrect_mimic_joint", "joint", "mimics the joint 'foo', which is not there"),
    ("error_incorrect_vec3", "origin", "'-2.2 0.0 0.5 1.0'; it must be 3 finite numbers"),
    ("error_incorrect_vec4", "color", "'0.0 1.0'; it must be 4 finite numbers"),
    ("error_joint_axis_0", "joint", "'0 0 0'; it must be a direction"),
    ("error_no_joint_child", "tree", "names the link '', which is not there"),
    ("error_no_joint_mimic_joint", "joint", "mimics the joint '', which is not there"),
    ("error_no_joint_parent", "tree", "names the link '', which is not there"),
    ("error_no_joint_parent_link", "tree", "names the link '', which is not there"),
    ("error_no_joint_type", "joint", "is of type ''"),
    ("error_no_link", "tree", "has no link"),
    ("error_no_material_name", "name", "a <material> without a name"),
    ("error_no_urdf_xml", "xml", "the root element is <test>"),
    ("error_xml_syntax", "xml", "is no XML"),
    ("warning_dae_no_exist_filename", "path", "the file is missing"),
    ("warning_different_place", "geometry", "a <visual> without geometry"),
    ("warning_incorrect_visual_geometry_name", "geometry", "of geometry <foo>"),
    ("warning_invalid_material_name", "texture", "'green', which is not there"),
    ("warning_mesh_https", "path", "not relative to the URDF"),
    ("warning_missing_collision_geometry", "geometry", "a <collision> without geometry"),
    ("warning_missing_visual_geometry", "geometry", "a <visual> without geometry"),
    ("warning_no_joint_k_velocity", "joint", "without k_velocity"),
    ("warning_no_mesh_filename", "path", "names no file"),
    ("warning_obj_no_exist_filename", "path", "the file is missing"),
    ("warning_obj_no_shape", "mesh", "has no face"),
    ("warning_ref_ros_package", "path", "package:// fails"),
];
/// The one file that has two.
const MISSING_PACKAGE: (&str, &str, &str) =
    ("warning_ref_ros_package_not_exist", "path", "the file is missing");

/// MuJoCo refuses bodies that move without a mass ("must be larger than mjMINVAL"), SDF drops them and their
/// joints: measured.
const NO_MASS: &[&str] = &["inertia"];
/// urdfdom refuses a revolute or prismatic joint without limits or effort: measured.
const NO_EFFORT: &[&str] = &["inertia", "limit"];

/// Sound files that `check` finds errors in, and the rules: importers refuse or lose them.
const STRICTER: [(&str, &[&str]); 14] = [
    ("fixed_continuous_joints", NO_MASS),
    ("fixed_floating_joints", NO_MASS),
    // urdfdom refuses the link without a joint, a second root, too.
    ("fixed_planar_joints", &["inertia", "tree"]),
    // The last link's inertia breaks A + B >= C, which MuJoCo refuses.
    ("inertia", &["inertia"]),
    ("link_first_ghost_link_floating", NO_MASS),
    ("link_ghost_link_children", NO_EFFORT),
    ("link_skip_ghost_link_chain", NO_EFFORT),
    ("link_skip_ghost_link_chain_branch", NO_EFFORT),
    ("link_skip_ghost_link_with_mimic", NO_EFFORT),
    // MuJoCo has no decoder for a DAE, which a collision here is.
    ("meshes", &["format"]),
    ("mimic_joint", NO_EFFORT),
    // A link without a joint, too.
    ("prismatic_joints", &["inertia", "limit", "tree"]),
    ("revolute_joints", NO_EFFORT),
    // Drake makes no hull of an STL, which two collisions here are.
    ("verifying_elements", &["format"]),
];

/// Sound files that a diagnosis by motion refuses: links in places that no one number says.
const UNREAD: [(&str, &str); 2] = [
    ("fixed_planar_joints", "has 2 root links (BaseLink, planar_tilt_axis_len_0)"),
    ("prismatic_joints", "has 2 root links (BaseLink, Arm_5)"),
];

/// The files, unpacked; names without their ending.
fn unpacked() -> (tempfile::TempDir, Vec<String>) {
    let temp = tempfile::tempdir().unwrap();
    let mut names = Vec::new();
    for (path, bytes) in files("urdf.tar.zst") {
        let to = temp.path().join(&path);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::write(to, bytes).unwrap();
        names.extend(path.strip_prefix("urdf/").and_then(|p| p.strip_suffix(".urdf")).map(str::to_owned));
    }
    assert_eq!(names.len(), 77);
    (temp, names)
}

fn file(temp: &tempfile::TempDir, name: &str) -> PathBuf {
    temp.path().join("urdf").join(format!("{name}.urdf"))
}

fn text(found: &[CheckFinding]) -> String {
    found.iter().map(|f| format!("{f}\n")).collect()
}

#[test]
fn every_urdf_has_the_outcome_that_its_name_says() {
    let (temp, names) = unpacked();
    let of_folder = check_folder(&read_model_folder(&temp.path().join("urdf")).unwrap());
    let mut faulty = 0;
    let mut stricter = 0;
    for name in &names {
        let found = check_folder(&read_model(&file(&temp, name)).unwrap());
        // A file by itself and within its folder.
        let within: Vec<CheckFinding> =
            of_folder.iter().filter(|f| f.file == format!("{name}.urdf")).cloned().collect();
        assert_eq!(text(&found), text(&within), "{name}");
        let errors: BTreeSet<&str> =
            found.iter().filter(|f| f.level == Level::Error).map(|f| f.rule.word()).collect();
        let level = if name.starts_with("error_") { Level::Error } else { Level::Warning };
        if let Some((_, rule, words)) = FAULTS.iter().chain([&MISSING_PACKAGE]).find(|f| f.0 == name) {
            let is_it = |f: &&CheckFinding| f.rule.word() == *rule && f.message.contains(words);
            let hits: Vec<Level> = found.iter().filter(is_it).map(|f| f.level).collect();
            assert!(!hits.is_empty() && hits.iter().all(|l| *l == level), "{name}:\n{}", text(&found));
            assert!(level == Level::Error || errors.is_empty(), "{name}:\n{}", text(&found));
            faulty += 1;
        } else {
            assert!(!name.starts_with("error_") && !name.starts_with("warning_"), "{name}");
            let expected = STRICTER.iter().find(|s| s.0 == name).map_or(&[][..], |s| s.1);
            assert_eq!(errors, expected.iter().copied().collect(), "{name}:\n{}", text(&found));
            stricter += usize::from(!expected.is_empty());
        }
    }
    assert_eq!((faulty, stricter), (FAULTS.len() + 1, STRICTER.len()));
}

#[test]
fn a_diagnosis_reads_every_urdf_that_is_no_error() {
    let (temp, names) = unpacked();
    let mut unread = 0;
    for name in &names {
        let read = read_twin(&twin_path(&file(&temp, name)).unwrap(), [0.0, 0.0, -9.81]);
        let why = read.as_ref().err().map(ToString::to_string).unwrap_or_default();
        if let Some((_, words)) = UNREAD.iter().find(|u| u.0 == name) {
            assert!(why.contains(words), "{name}: {why}");
            unread += 1;
        } else {
            assert_eq!(read.is_err(), name.starts_with("error_"), "{name}: {why}");
        }
    }
    assert_eq!(unread, UNREAD.len());
    // All in one folder: which of them is not guessed.
    let several = twin_path(&temp.path().join("urdf")).unwrap_err().to_string();
    assert!(several.contains("holds 77 .urdf files"), "{several}");
}

#[test]
fn cameras_are_given_what_is_whole_and_has_meshes() {
    let (temp, names) = unpacked();
    let read: Vec<&String> = names.iter().filter(|n| read_seen_twin(&file(&temp, n)).is_ok()).collect();
    assert_eq!(
        read,
        [
            "material_mesh_color",
            "material_mesh_texture",
            "material_texture",
            "material_texture_name_duplication",
            "verifying_elements"
        ]
    );
    for (name, words) in [
        ("warning_mesh_https", "is not a relative path"),
        ("warning_obj_no_exist_filename", "cannot read"),
        ("dae_no_normal", "meshes of type '.dae' are not read"),
        ("simple_box", "no link of the twin has a visual mesh"),
    ] {
        let why = read_seen_twin(&file(&temp, name)).unwrap_err().to_string();
        assert!(why.contains(words), "{name}: {why}");
    }
}

/// urdf-rs, which shares no code with the reader, finds the same numbers in what it reads.
#[test]
fn a_second_reader_finds_the_same_and_refuses_more() {
    let (temp, names) = unpacked();
    let mut refused = 0;
    for name in &names {
        let Ok((tree, text)) = read_twin(&file(&temp, name), [0.0, 0.0, -9.81]) else { continue };
        let Ok(robot) = urdf_rs::read_from_string(&text) else {
            refused += 1;
            continue;
        };
        assert_eq!((tree.links.len(), tree.joints.len()), (robot.links.len(), robot.joints.len()), "{name}");
        for (link, other) in tree.links.iter().zip(&robot.links) {
            assert_eq!((&link.name, link.mass_kg), (&other.name, other.inertial.mass.value), "{name}");
            assert_eq!(link.center_of_mass.coords.as_slice(), &other.inertial.origin.xyz[..], "{name}");
        }
        for joint in &tree.joints {
            let other = robot.joints.iter().find(|j| j.name == joint.name).unwrap();
            let place = joint.parent_from_joint.translation.vector;
            assert_eq!(place.as_slice(), &other.origin.xyz[..], "{name}");
            let is_continuous = other.joint_type == urdf_rs::JointType::Continuous;
            let limit = Some((other.limit.lower, other.limit.upper));
            assert_eq!(joint.limit, limit.filter(|(low, high)| !is_continuous && high > low), "{name}");
            let dynamics = other.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
            assert_eq!((joint.damping, joint.friction), dynamics, "{name}");
        }
    }
    assert_eq!(refused, 17);
}
