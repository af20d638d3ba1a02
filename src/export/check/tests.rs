//! Planted faults: each is found under its rule, and the folder without it passes.

use super::*;
use crate::{
    export::obj::solid_obj,
    surface::{ConvexSolid, Plane},
};
use nalgebra::{Point3, Vector3};

/// A box that slides out of a frame, as another tool might have written it.
const URDF: &str = r#"<?xml version="1.0"?>
<robot name="unit">
  <link name="frame">
    <inertial><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
    <visual name="frame_visual"><geometry><mesh filename="meshes/visual/frame.obj"/></geometry></visual>
    <collision name="frame_0"><geometry><mesh filename="meshes/collision/frame_0.obj"/></geometry></collision>
  </link>
  <link name="tray">
    <inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision name="tray_0"><geometry><mesh filename="meshes/collision/tray_0.obj"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic">
    <origin xyz="0.11 0 0"/><parent link="frame"/><child link="tray"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.2" effort="10" velocity="1"/>
  </joint>
</robot>
"#;

fn folder() -> Folder {
    let cuboid = |name| {
        let solid = ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.1));
        solid_obj(&solid, name)
    };
    let visual = cuboid("frame").replace("o frame", "mtllib frame.mtl\no frame").replace("vn ", "vt 0.5 0.5\nvn ");
    [
        ("unit.urdf", URDF.to_owned()),
        ("meshes/visual/frame.obj", visual),
        ("meshes/visual/frame.mtl", "newmtl frame\nKd 1 1 1\nmap_Kd frame.png\n".to_owned()),
        ("meshes/visual/frame.png", "png".to_owned()),
        ("meshes/collision/frame_0.obj", cuboid("frame_0")),
        ("meshes/collision/tray_0.obj", cuboid("tray_0")),
    ]
    .into_iter()
    .map(|(path, text)| (path.to_owned(), if text == "png" { b"\x89PNG\r\n\x1a\n".to_vec() } else { text.into_bytes() }))
    .collect()
}

fn text(found: &[CheckFinding]) -> String {
    found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_sound_folder_passes() {
    let found = check_folder(&folder());
    assert!(found.is_empty(), "{}", text(&found));
}

#[test]
fn every_fault_of_the_urdf_is_found_under_its_rule() {
    let inertia = r#"ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01""#;
    let mesh = "meshes/collision/tray_0.obj";
    let cases = [
        ("path", "package://", mesh, "package://unit/meshes/collision/tray_0.obj"),
        ("path", "not relative", mesh, "file:///tmp/tray_0.obj"),
        ("path", "not relative", mesh, "/meshes/collision/tray_0.obj"),
        ("path", "out of the folder", mesh, "../other/tray_0.obj"),
        ("path", "missing", mesh, "meshes/collision/tray_9.obj"),
        ("format", "'.glb'", "meshes/visual/frame.obj", "meshes/visual/frame.glb"),
        ("inertia", "no <inertial>", "<inertial><mass value=\"1\"/>", "<inertia_l><mass value=\"1\"/>"),
        ("inertia", "A + B >= C", inertia, r#"ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.03""#),
        ("inertia", "not positive", inertia, r#"ixx="-0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01""#),
        ("inertia", "no finite", inertia, r#"ixx="nan" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01""#),
        ("inertia", "the mass is 0", "<mass value=\"1\"/>", "<mass value=\"0\"/>"),
        ("limit", "no effort", " effort=\"10\"", ""),
        ("limit", "no velocity", " velocity=\"1\"", ""),
        ("limit", "no <limit>", "<limit lower=\"0\" upper=\"0.2\" effort=\"10\" velocity=\"1\"/>", ""),
        ("limit", "above upper", "lower=\"0\" upper=\"0.2\"", "lower=\"0.2\" upper=\"-0.1\""),
        ("limit", "nothing moves", "lower=\"0\" upper=\"0.2\"", "lower=\"0\" upper=\"0\""),
        ("limit", "must be finite", "upper=\"0.2\"", "upper=\"NaN\""),
        ("overlap", "overlap by 2.00 mm", "xyz=\"0.11 0 0\"", "xyz=\"0.098 0 0\""),
        ("sweep", "the joint jams", "axis xyz=\"1 0 0\"", "axis xyz=\"-1 0 0\""),
        ("name", "no name for USD", "link name=\"tray\"", "link name=\"my tray\""),
        ("name", "more than one", "joint name=\"slide\"", "joint name=\"tray\""),
        ("tree", "not there", "child link=\"tray\"", "child link=\"lid\""),
        ("joint", "'floating'", "type=\"prismatic\"", "type=\"floating\""),
        ("xml", "is no XML", "</robot>", ""),
        ("name", "same file name", mesh, "other/frame_0.obj"),
    ];
    for (rule, message, from, to) in cases {
        let mut folder = folder();
        let (at, _) = URDF.rmatch_indices(from).next().unwrap_or_else(|| panic!("{from} is not in the fixture"));
        let mut broken = URDF.to_owned();
        broken.replace_range(at..at + from.len(), to);
        if rule == "inertia" && to.starts_with("<inertia_l>") {
            broken = broken.replace("izz=\"0.01\"/></inertial>", "izz=\"0.01\"/></inertia_l>");
        }
        folder.insert("unit.urdf".to_owned(), broken.into_bytes());
        folder.insert("other/frame_0.obj".to_owned(), folder[mesh].clone());
        let glb = b"glTF".to_vec();
        folder.insert("meshes/visual/frame.glb".to_owned(), glb);
        let found = check_folder(&folder);
        let hit = found.iter().any(|f| f.level == Level::Error && f.rule == rule && f.message.contains(message));
        assert!(hit, "{rule}: '{message}' is not in:\n{}", text(&found));
    }
}

#[test]
fn every_fault_of_a_file_is_found_under_its_rule() {
    let flat = solid_obj(&ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.0001)), "x");
    let cases: [(&str, &str, &str, Vec<u8>); 9] = [
        ("texture", "no PNG", "meshes/visual/frame.png", b"\xff\xd8\xff\xe0JFIF".to_vec()),
        ("texture", "no PNG", "meshes/visual/frame.mtl", b"newmtl frame\nmap_Kd frame.jpg\n".to_vec()),
        ("texture", "is missing", "meshes/visual/frame.mtl", b"newmtl frame\nmap_Kd gone.png\n".to_vec()),
        ("texture", "black", "meshes/visual/frame.mtl", b"newmtl frame\nKd 0 0 0\nmap_Kd frame.png\n".to_vec()),
        ("mesh", "lie in a plane", "meshes/collision/tray_0.obj", flat.into_bytes()),
        ("mesh", "lie in a plane", "meshes/collision/tray_0.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()),
        ("mesh", "no finite point", "meshes/collision/tray_0.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()),
        ("mesh", "no normals", "meshes/visual/frame.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()),
        ("mesh", "which is not there", "meshes/collision/tray_0.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec()),
    ];
    for (rule, message, path, bytes) in cases {
        let mut folder = folder();
        folder.insert("meshes/visual/frame.jpg".to_owned(), b"\xff\xd8\xff\xe0JFIF".to_vec());
        folder.insert(path.to_owned(), bytes);
        let found = check_folder(&folder);
        let hit = found.iter().any(|f| f.level == Level::Error && f.rule == rule && f.message.contains(message));
        assert!(hit, "{rule}: '{message}' is not in:\n{}", text(&found));
    }
    assert_eq!(text(&check_folder(&Folder::new())), "error file: .: .: the folder holds no .urdf file");
}

#[test]
fn package_paths_are_for_ros_files_and_large_hulls_are_thinned_out() {
    let mut folder = folder();
    folder.insert("unit.ros.urdf".to_owned(), URDF.replace("filename=\"", "filename=\"package://unit/").into_bytes());
    // A round box: a cube with its corners cut by many planes.
    let mut round = ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.1));
    for k in 0..300 {
        let (s, c) = (f64::from(k) * 0.37).sin_cos();
        let normal = Vector3::new(c, s, (f64::from(k) * 0.11).sin()).normalize();
        round = round.clipped(&Plane { normal, offset_m: normal.dot(&Vector3::repeat(0.05)) + 0.055 }).unwrap();
    }
    assert!(round.vertices.len() > 250);
    folder.insert("meshes/collision/tray_0.obj".to_owned(), solid_obj(&round, "tray_0").into_bytes());
    assert_eq!(text(&check_folder(&folder)), "");
}

#[test]
fn a_joint_that_follows_another_is_swept_with_it() {
    let pair = r#"<link name="carriage"/>
  <joint name="drop" type="prismatic">
    <origin xyz="0 0 0.11"/><parent link="frame"/><child link="carriage"/><axis xyz="0 0 -1"/>
    <limit lower="0" upper="0.1" effort="10" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="carriage"/><child link="tray"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="2" effort="10" velocity="1"/><mimic joint="drop" multiplier="20"/>
  </joint>
</robot>"#;
    let (start, _) = URDF.split_once("<joint").unwrap();
    let jams = |text: String| {
        let mut folder = folder();
        folder.insert("unit.urdf".to_owned(), text.into_bytes());
        check_folder(&folder).iter().any(|f| f.rule == "sweep" && f.level == Level::Error)
    };
    assert!(!jams(format!("{start}{pair}")));
    let alone = format!("{start}{pair}").replace("<mimic joint=\"drop\" multiplier=\"20\"/>", "");
    assert!(jams(alone.clone()));
    // A screw as its nearest joint is known to lack its advance.
    assert!(!jams(
        alone
            .replace("<axis xyz=\"0 0 -1\"/>", "<axis xyz=\"0 0 -1\"/><thread/>")
            .replace("<axis xyz=\"1 0 0\"/>", "<axis xyz=\"1 0 0\"/><thread/>")
    ));
}
