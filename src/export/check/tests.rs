//! Planted faults: each is found under its rule, and the folder without it passes.

use super::*;
use crate::obj::solid_obj;
use nalgebra::{Point3, Vector3};
use surface::{ConvexSolid, Plane};

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
    let visual =
        cuboid("frame").replace("o frame", "mtllib frame.mtl\no frame").replace("vn ", "vt 0.5 0.5\nvn ");
    [
        ("unit.urdf", URDF.to_owned()),
        ("meshes/visual/frame.obj", visual),
        ("meshes/visual/frame.mtl", "newmtl frame\nKd 1 1 1\nmap_Kd frame.png\n".to_owned()),
        ("meshes/visual/frame.png", "png".to_owned()),
        ("meshes/collision/frame_0.obj", cuboid("frame_0")),
        ("meshes/collision/tray_0.obj", cuboid("tray_0")),
    ]
    .into_iter()
    .map(|(path, text)| {
        (path.to_owned(), if text == "png" { b"\x89PNG\r\n\x1a\n".to_vec() } else { text.into_bytes() })
    })
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
        ("mesh", "no whole STL", "meshes/visual/frame.obj", "meshes/visual/frame.stl"),
        ("inertia", "no <inertial>", "<inertial><mass value=\"1\"/>", "<inertia_l><mass value=\"1\"/>"),
        ("inertia", "not positive", inertia, r#"ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0""#),
        ("inertia", "lacks an element", inertia, r#"ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0""#),
        ("inertia", "has no mass", "<mass value=\"1\"/>", ""),
        ("limit", "the effort is 0", "effort=\"10\"", "effort=\"0\""),
        ("inertia", "the mass is 0", "<mass value=\"1\"/>", "<mass value=\"0\"/>"),
        ("limit", "no effort", " effort=\"10\"", ""),
        ("limit", "no velocity", " velocity=\"1\"", ""),
        ("limit", "no <limit>", "<limit lower=\"0\" upper=\"0.2\" effort=\"10\" velocity=\"1\"/>", ""),
        ("limit", "nothing moves", "lower=\"0\" upper=\"0.2\"", "lower=\"0\" upper=\"0\""),
        ("overlap", "overlap by 2.00 mm", "xyz=\"0.11 0 0\"", "xyz=\"0.098 0 0\""),
        ("sweep", "the joint jams", "axis xyz=\"1 0 0\"", "axis xyz=\"-1 0 0\""),
        ("name", "both a link and a joint", "joint name=\"slide\"", "joint name=\"tray\""),
        ("joint", "'sliding'", "type=\"prismatic\"", "type=\"sliding\""),
        ("xml", "is no XML", "</robot>", ""),
        ("name", "same file name", mesh, "other/frame_0.obj"),
    ];
    for (rule, message, from, to) in cases {
        let mut folder = folder();
        let (at, _) =
            URDF.rmatch_indices(from).next().unwrap_or_else(|| panic!("{from} is not in the fixture"));
        let mut broken = URDF.to_owned();
        broken.replace_range(at..at + from.len(), to);
        if rule == "inertia" && to.starts_with("<inertia_l>") {
            broken = broken.replace("izz=\"0.01\"/></inertial>", "izz=\"0.01\"/></inertia_l>");
        }
        folder.insert("unit.urdf".to_owned(), broken.into_bytes());
        folder.insert("other/frame_0.obj".to_owned(), folder[mesh].clone());
        let glb = b"glTF".to_vec();
        folder.insert("meshes/visual/frame.glb".to_owned(), glb);
        // A binary STL that ends within its first facet.
        let cut = [[0; 80].as_slice(), &1u32.to_le_bytes(), &[0; 20]].concat();
        folder.insert("meshes/visual/frame.stl".to_owned(), cut);
        let found = check_folder(&folder);
        let hit = found
            .iter()
            .any(|f| f.level == Level::Error && f.rule.word() == rule && f.message.contains(message));
        assert!(hit, "{rule}: '{message}' is not in:\n{}", text(&found));
    }
}

#[test]
fn a_fault_is_as_bad_as_what_it_costs() {
    let keeps = "<mujoco><compiler discardvisual=\"false\"/></mujoco></robot>";
    let visual = "meshes/visual/frame.obj";
    let solid = "meshes/collision/tray_0.obj";
    let [frame, tray] = ["2", "1"].map(|mass| format!("<inertial><mass value=\"{mass}\"/>"));
    let still = "type=\"fixed\"";
    let error = Level::Error;
    let warning = Level::Warning;
    for (rule, words, level, changes) in [
        ("path", "is missing", warning, vec![(visual, "gone.obj")]),
        ("path", "is missing", error, vec![(visual, "gone.obj"), ("</robot>", keeps)]),
        ("path", "is missing", error, vec![(solid, "gone.obj")]),
        ("format", "a DAE", warning, vec![(visual, "meshes/box.dae")]),
        ("format", "a DAE", error, vec![(solid, "meshes/box.dae")]),
        ("inertia", "no mass", warning, vec![("<mass value=\"2\"/>", "")]),
        ("inertia", "no mass", error, vec![("<mass value=\"1\"/>", "")]),
        ("inertia", "no mass", warning, vec![("<mass value=\"1\"/>", ""), ("type=\"prismatic\"", still)]),
        ("inertia", "no <inertial>", warning, vec![(&frame, "<x>"), ("izz=\"0.02\"/></inertial>", "/></x>")]),
        ("inertia", "no <inertial>", error, vec![(&tray, "<x>"), ("izz=\"0.01\"/></inertial>", "/></x>")]),
        ("joint", "'floating'", warning, vec![("type=\"prismatic\"", "type=\"floating\"")]),
        ("limit", "no <limit>", warning, vec![("prismatic", "continuous"), ("<limit", "<x")]),
        ("limit", "no <limit>", error, vec![("<limit", "<x")]),
        ("name", "no name for USD", warning, vec![("link name=\"tray\"", "link name=\"my tray\"")]),
        ("name", "without a name", error, vec![("joint name=\"slide\"", "joint name=\"\"")]),
        (
            "color",
            "without rgba",
            warning,
            vec![("</robot>", "<material name=\"m\"><color/></material></robot>")],
        ),
    ] {
        let mut urdf = URDF.to_owned();
        for (from, to) in changes {
            assert!(urdf.contains(from), "{from}");
            urdf = urdf.replace(from, to);
        }
        let mut folder = folder();
        folder.insert("unit.urdf".to_owned(), urdf.into_bytes());
        folder.insert("meshes/box.dae".to_owned(), Vec::new());
        let found = check_folder(&folder);
        let hits: Vec<Level> = found
            .iter()
            .filter(|f| f.rule.word() == rule && f.message.contains(words))
            .map(|f| f.level)
            .collect();
        assert_eq!(hits, [level], "{rule}: '{words}' in:\n{}", text(&found));
    }
    // What is fixed to each other does not collide.
    let mut folder = folder();
    let welded = URDF.replace("xyz=\"0.11 0 0\"", "xyz=\"0.05 0 0\"").replace("type=\"prismatic\"", still);
    folder.insert("unit.urdf".to_owned(), welded.into_bytes());
    assert_eq!(text(&check_folder(&folder)), "");
}

/// Inertias that no body can have: words, what stands in the fixture, what takes its place.
const IMPOSSIBLE: &[(&str, &str, &str)] = &[
    ("not positive", "ixx=\"0.01\"", "ixx=\"-0.01\""),
    ("not positive", "ixy=\"0\"", "ixy=\"0.02\""),
    ("A + B >= C", "ixx=\"0.01\"", "ixx=\"0.03\""),
];

/// What no reader can make sense of: rule, words, what stands in the fixture, what takes its place.
const NONSENSE: &[(&str, &str, &str, &str)] = &[
    ("origin", "the xyz of <origin> is 'nan inf 0'", "xyz=\"0.11 0 0\"", "xyz=\"nan inf 0\""),
    ("origin", "the rpy of <origin> is '0 0 1e999'", "xyz=\"0.11 0 0\"", "rpy=\"0 0 1e999\""),
    ("origin", "must be 3 finite numbers", "xyz=\"0.11 0 0\"", "xyz=\"0.11 0\""),
    ("origin", "must be 3 finite numbers", "xyz=\"0.11 0 0\"", "xyz=\"0.11 0 0 0\""),
    ("origin", "must be 3 finite numbers", "xyz=\"0.11 0 0\"", "xyz=\"0.11 x 0\""),
    ("origin", "overflows", "xyz=\"0.11 0 0\"", "xyz=\"1e308 0 0\""),
    ("origin", "'nan 0 0'", "<mass value=\"1\"/>", "<mass value=\"1\"/><origin xyz=\"nan 0 0\"/>"),
    (
        "origin",
        "'0 -inf 0'",
        "<collision name=\"tray_0\">",
        "<collision name=\"tray_0\"><origin xyz=\"0 -inf 0\"/>",
    ),
    ("inertia", "the value of <mass> is 'nan'", "<mass value=\"1\"/>", "<mass value=\"nan\"/>"),
    ("inertia", "must not be negative", "<mass value=\"1\"/>", "<mass value=\"-1\"/>"),
    ("inertia", "overflows", "<mass value=\"1\"/>", "<mass value=\"1e308\"/>"),
    ("inertia", "must be a finite number", "<mass value=\"1\"/>", "<mass value=\"1 kg\"/>"),
    ("inertia", "the ixx of <inertia> is 'nan'", "ixx=\"0.01\"", "ixx=\"nan\""),
    ("joint", "'nan 0 0'", "axis xyz=\"1 0 0\"", "axis xyz=\"nan 0 0\""),
    ("joint", "must be a direction", "axis xyz=\"1 0 0\"", "axis xyz=\"0 0 0\""),
    ("joint", "the damping of <dynamics> is 'nan'", "<axis", "<dynamics damping=\"nan\"/><axis"),
    ("joint", "must not be negative", "<axis", "<dynamics damping=\"-1e3\"/><axis"),
    ("joint", "the friction of <dynamics> is 'inf'", "<axis", "<dynamics friction=\"inf\"/><axis"),
    ("joint", "mimics the joint 'lid', which is not there", "<axis", "<mimic joint=\"lid\"/><axis"),
    ("joint", "mimics itself (slide)", "<axis", "<mimic joint=\"slide\"/><axis"),
    ("joint", "the multiplier of <mimic>", "<axis", "<mimic joint=\"slide\" multiplier=\"nan\"/><axis"),
    ("joint", "the pitch_m_per_rad of <thread>", "<axis", "<thread pitch_m_per_rad=\"inf\"/><axis"),
    ("limit", "the upper of <limit> is 'NaN'", "upper=\"0.2\"", "upper=\"NaN\""),
    ("limit", "the lower of <limit> is '-inf'", "lower=\"0\"", "lower=\"-inf\""),
    ("limit", "must not be negative", "effort=\"10\"", "effort=\"-10\""),
    ("limit", "the velocity of <limit>", "velocity=\"1\"", "velocity=\"inf\""),
    ("limit", "above upper", "lower=\"0\" upper=\"0.2\"", "lower=\"0.2\" upper=\"-0.1\""),
    ("geometry", "must not be zero", "frame.obj\"", "frame.obj\" scale=\"1 0 1\""),
    ("geometry", "'1 inf 1'", "tray_0.obj\"", "tray_0.obj\" scale=\"1 inf 1\""),
    (
        "geometry",
        "must be positive",
        "<mesh filename=\"meshes/collision/tray_0.obj\"/>",
        "<box size=\"1 -1 1\"/>",
    ),
    (
        "geometry",
        "must be positive",
        "<mesh filename=\"meshes/collision/tray_0.obj\"/>",
        "<sphere radius=\"0\"/>",
    ),
    (
        "geometry",
        "'nan'",
        "<mesh filename=\"meshes/collision/tray_0.obj\"/>",
        "<cylinder radius=\"1\" length=\"nan\"/>",
    ),
    (
        "color",
        "must be 4 finite numbers",
        "<link name=\"tray\">",
        "<material name=\"m\"><color rgba=\"0 1\"/></material><link name=\"tray\">",
    ),
    ("tree", "names the link 'lid', which is not there", "child link=\"tray\"", "child link=\"lid\""),
    ("tree", "in a loop of joints (frame)", "child link=\"tray\"", "child link=\"frame\""),
    ("tree", "in a loop of joints (a, b)", "</robot>", LOOP),
    ("tree", "in a loop of joints (a)", "</robot>", SELF),
    ("tree", "is the child of two joints", "</robot>", TWICE),
    ("tree", "has 2 root links (frame, lid)", "</robot>", "<link name=\"lid\"/></robot>"),
    ("name", "more than one of the links", "</robot>", "<link name=\"tray\"/></robot>"),
    ("name", "more than one of the joints", "</robot>", TWICE),
    ("joint", "mimics itself (b, c); one joint must lead", "</robot>", MIMICS),
];
const LOOP: &str = "<link name=\"a\"/><link name=\"b\"/><joint name=\"u\" type=\"fixed\"><parent \
    link=\"a\"/><child link=\"b\"/></joint>\
    <joint name=\"v\" type=\"fixed\"><parent link=\"b\"/><child link=\"a\"/></joint></robot>";
const SELF: &str = "<link name=\"a\"/><joint name=\"u\" type=\"fixed\"><parent link=\"a\"/><child \
    link=\"a\"/></joint></robot>";
const TWICE: &str =
    "<joint name=\"slide\" type=\"fixed\"><parent link=\"frame\"/><child link=\"tray\"/></joint></robot>";
const MIMICS: &str = "<link name=\"l\"/><link name=\"m\"/>\
    <joint name=\"b\" type=\"fixed\"><parent link=\"tray\"/><child link=\"l\"/><mimic joint=\"c\"/></joint>\
    <joint name=\"c\" type=\"fixed\"><parent link=\"l\"/><child link=\"m\"/><mimic \
    joint=\"b\"/></joint></robot>";

fn require_sound(urdf: &str) -> Result<Description, UnsoundUrdf> {
    Description::parse(urdf)?.require_sound()
}

#[test]
fn what_no_reader_can_make_sense_of_is_found_and_refused_by_all() {
    require_sound(URDF).unwrap();
    for (rule, words, from, to) in NONSENSE {
        let broken = replaced_last(from, to);
        assert_one_error(&broken, rule, words);
        let refused = require_sound(&broken).unwrap_err().to_string();
        assert!(refused.contains(words) || refused.contains("more: see"), "'{words}' is not in: {refused}");
    }
}

#[test]
fn an_inertia_that_no_body_can_have_is_an_error_of_the_check_alone() {
    for (words, from, to) in IMPOSSIBLE {
        let broken = replaced_last(from, to);
        assert_one_error(&broken, "inertia", words);
        require_sound(&broken).unwrap();
    }
}

/// The fixture, with another text in place of the last `from`.
fn replaced_last(from: &str, to: &str) -> String {
    let at = URDF.rfind(from).unwrap_or_else(|| panic!("{from} is not in the fixture"));
    let mut text = URDF.to_owned();
    text.replace_range(at..at + from.len(), to);
    text
}

/// Asserts that the check of a folder with this URDF reports one error of a rule with these words.
fn assert_one_error(urdf: &str, rule: &str, words: &str) {
    let mut folder = folder();
    folder.insert("unit.urdf".to_owned(), urdf.as_bytes().to_vec());
    let found = check_folder(&folder);
    let hits = found
        .iter()
        .filter(|f| f.level == Level::Error && f.rule.word() == rule && f.message.contains(words))
        .count();
    assert_eq!(hits, 1, "{rule}: '{words}' in:\n{}", text(&found));
}

#[test]
fn what_only_importers_refuse_is_sound() {
    for (from, to) in [
        ("<mass value=\"1\"/>", "<mass value=\"0\"/>"),
        (
            "ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.01\" iyz=\"0\" izz=\"0.01\"",
            "ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"",
        ),
        (
            "<limit lower=\"0\" upper=\"0.2\" effort=\"10\" velocity=\"1\"/>",
            "<limit effort=\"1.7976931348623157e308\" velocity=\"0\"/>",
        ),
        ("type=\"prismatic\"", "type=\"fixed\""),
        ("axis xyz=\"1 0 0\"", "axis xyz=\"0 0 -3\""),
        ("tray_0.obj\"", "tray_0.obj\" scale=\"1 -1 1e-3\""),
    ] {
        assert!(URDF.contains(from), "{from}");
        require_sound(&URDF.replace(from, to)).unwrap();
    }
    let still = URDF.replace("prismatic", "fixed").replace("axis xyz=\"1 0 0\"", "axis xyz=\"0 0 0\"");
    require_sound(&still).unwrap();
}

#[test]
fn every_fault_of_a_file_is_found_under_its_rule() {
    let flat = solid_obj(&ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.0001)), "x");
    let numbers = |v: &str, vt: &str, vn: &str| {
        format!("v {v} 0 0\nv 1 0 0\nv 0 1 0\nvt {vt} 0\nvn 0 {vn} 1\nf 1 2 3\n").into_bytes()
    };
    let cases: [(&str, &str, &str, Vec<u8>); 13] = [
        ("texture", "no PNG", "meshes/visual/frame.png", b"\xff\xd8\xff\xe0JFIF".to_vec()),
        ("texture", "no PNG", "meshes/visual/frame.mtl", b"newmtl frame\nmap_Kd frame.jpg\n".to_vec()),
        ("texture", "is missing", "meshes/visual/frame.mtl", b"newmtl frame\nmap_Kd gone.png\n".to_vec()),
        (
            "texture",
            "black",
            "meshes/visual/frame.mtl",
            b"newmtl frame\nKd 0 0 0\nmap_Kd frame.png\n".to_vec(),
        ),
        ("mesh", "lie in a plane", "meshes/collision/tray_0.obj", flat.into_bytes()),
        (
            "mesh",
            "lie in a plane",
            "meshes/collision/tray_0.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(),
        ),
        (
            "mesh",
            "no finite point",
            "meshes/collision/tray_0.obj",
            b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(),
        ),
        ("mesh", "no finite point", "meshes/visual/frame.obj", numbers("1e999", "0", "0")),
        ("mesh", "no finite point", "meshes/collision/tray_0.obj", numbers("-1e308", "0", "0")),
        ("mesh", "texture coordinate that is no finite", "meshes/visual/frame.obj", numbers("0", "nan", "0")),
        ("mesh", "normal or texture", "meshes/visual/frame.obj", numbers("0", "0", "inf")),
        ("mesh", "no normals", "meshes/visual/frame.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()),
        (
            "mesh",
            "which is not there",
            "meshes/collision/tray_0.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec(),
        ),
    ];
    for (rule, message, path, bytes) in cases {
        let mut folder = folder();
        folder.insert("meshes/visual/frame.jpg".to_owned(), b"\xff\xd8\xff\xe0JFIF".to_vec());
        folder.insert(path.to_owned(), bytes);
        let found = check_folder(&folder);
        let hit = found
            .iter()
            .any(|f| f.level == Level::Error && f.rule.word() == rule && f.message.contains(message));
        assert!(hit, "{rule}: '{message}' is not in:\n{}", text(&found));
    }
    assert_eq!(text(&check_folder(&Folder::new())), "error file: .: .: the folder holds no .urdf file");
}

#[test]
fn package_paths_are_for_ros_files_and_large_hulls_are_thinned_out() {
    let mut folder = folder();
    folder.insert(
        "unit.ros.urdf".to_owned(),
        URDF.replace("filename=\"", "filename=\"package://unit/").into_bytes(),
    );
    // A round box: a cube with its corners cut by many planes.
    let mut round = ConvexSolid::cuboid(&Point3::origin(), &Point3::new(0.1, 0.1, 0.1));
    for k in 0..300 {
        let (s, c) = (f64::from(k) * 0.37).sin_cos();
        let normal = Vector3::new(c, s, (f64::from(k) * 0.11).sin()).normalize();
        round = round
            .clipped_at(&Plane { normal, offset_m: normal.dot(&Vector3::repeat(0.05)) + 0.055 })
            .unwrap();
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
        check_folder(&folder).iter().any(|f| f.rule == Rule::Sweep && f.level == Level::Error)
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
