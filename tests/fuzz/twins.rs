//! Descriptions of twins and their meshes.

use std::path::Path;

use export::{Folder, check_folder};
use io::{read_mesh, read_seen_twin, read_urdf, twin_of};
use surface::TriangleMesh;

use super::engine::{BYTES, Scratch, Target, plain, whole};

const URDF: &str = include_str!("../golden/cabinet.urdf");
/// A box that slides out of a frame, a mimic and a screw.
const UNIT: &str = r#"<?xml version="1.0"?>
<robot name="unit" xmlns:artitwin="https://artitwin/urdf">
  <link name="frame">
    <inertial><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
    <visual name="frame_visual"><origin xyz="0 0 0.1" rpy="0 0 1"/><geometry><mesh filename="meshes/a.obj" scale="1 1 2"/></geometry></visual>
    <collision name="frame_0"><geometry><mesh filename="meshes/a.obj"/></geometry></collision>
  </link>
  <link name="tray">
    <inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <visual><geometry><mesh filename="package://unit/meshes/b.ply"/></geometry></visual>
    <collision name="tray_0"><geometry><mesh filename="meshes/c.stl"/></geometry></collision>
    <collision name="tray_1"><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <link name="knob"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual></link>
  <joint name="slide" type="prismatic">
    <origin xyz="0.21 0 0"/><parent link="frame"/><child link="tray"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.2" effort="10" velocity="1"/><dynamics damping="0.1" friction="0.2"/>
  </joint>
  <joint name="turn" type="revolute">
    <parent link="tray"/><child link="knob"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="10" velocity="1"/>
    <mimic joint="slide" multiplier="5" offset="0.1"/><artitwin:thread type="screw" pitch_m_per_rad="0.01"/>
  </joint>
</robot>
"#;
const OBJ: &str = "mtllib a.mtl\no box\nv 0 0 0\nv 0.1 0 0 \nv 0 0.1 0\nv 0 0 0.1\nvt 0 0\nvt 1 0.5\n\
                   vn 0 0 1\n\
                   f 1 3 2\nf 1/1/1 2/2/1 4/1/1\nf -4 -1 -2\nf 2 3 4\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\n\
                   property float z\n\
                   property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\n\
                   property list uchar int vertex_indices\n\
                   end_header\n0 0 0 255 0 0\n0.1 0 0 0 255 0\n0 0.1 0 0 0 255\n0 0 0.1 9 9 9\n3 0 2 1\n\
                   3 0 1 3\n3 0 3 2\n3 1 2 3\n";
const XML: [&str; 22] = [
    "<joint",
    "</joint>",
    "<link name=\"x\"/>",
    "<mimic joint=\"slide\"/>",
    "type=\"continuous\"",
    "type=\"floating\"",
    "type=\"planar\"",
    "parent link=\"tray\"",
    "child link=\"frame\"",
    "<!DOCTYPE r [<!ENTITY a \"b\">]>",
    "&a;",
    "&#0;",
    "&lt;",
    "<![CDATA[",
    "<!--",
    "<a>",
    "../",
    "package://",
    "file:///",
    "<sphere radius=\"1\"/>",
    "xyz=\"1 2\"",
    "rpy=\"nan 0 0\"",
];

/// The same tetrahedron as binary STL.
fn stl() -> Vec<u8> {
    let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1f32]];
    let mut bytes = [&[0; 80][..], &4u32.to_le_bytes()].concat();
    for triangle in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3usize]] {
        let points = triangle.iter().flat_map(|&k| corners[k]).flat_map(f32::to_le_bytes);
        bytes.extend([0u8; 12].into_iter().chain(points).chain([0, 0]));
    }
    bytes
}

/// The same tetrahedron as binary PLY.
fn binary_ply() -> Vec<u8> {
    let end = PLY.find("end_header\n").unwrap() + "end_header\n".len();
    let mut bytes = PLY[..end].replace("ascii", "binary_little_endian").into_bytes();
    for [x, y, z] in [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1f32]] {
        bytes.extend([x, y, z].iter().flat_map(|v| v.to_le_bytes()).chain([1, 2, 3]));
    }
    for triangle in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3u32]] {
        bytes.extend([3].into_iter().chain(triangle.iter().flat_map(|k| k.to_le_bytes())));
    }
    bytes
}

fn sound(mesh: &TriangleMesh) {
    assert!(mesh.vertices.iter().all(|p| p.iter().all(|x| x.is_finite())));
    assert!(mesh.triangles.iter().flatten().all(|k| (*k as usize) < mesh.vertices.len()));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == mesh.vertices.len());
}

fn meshes(scratch: &Scratch) {
    scratch.put("meshes/a.obj", OBJ);
    scratch.put("meshes/b.ply", PLY);
    for file in ["visual/body.obj", "visual/door.obj", "visual/drawer.obj"] {
        scratch.put(&format!("meshes/{file}"), OBJ);
    }
}

/// A URDF as `evaluate` and `diagnose` read it, with its meshes.
#[test]
fn urdf() {
    let name = "twins::urdf";
    let scratch = Scratch::new(name);
    meshes(&scratch);
    let target = Target { name, seeds: whole([UNIT, URDF]), words: &XML, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let path = scratch.put("unit.urdf", input);
        if let Ok(tree) = std::str::from_utf8(input)
            .map_err(drop)
            .and_then(|text| twin_of(text, [0.0, 0.0, -9.8]).map_err(drop))
        {
            let links = tree.links.len();
            assert!(tree.root < links && tree.joints.iter().all(|j| j.parent < links && j.child < links));
            assert!(tree.links.iter().all(|l| l.mass_kg.is_finite() && l.mass_kg >= 0.0));
            let poses = tree.link_poses(&vec![0.1; tree.joints.len()]);
            assert_eq!(poses.len(), links);
        }
        let tree = read_urdf(&path).ok();
        if let Some(tree) = &tree {
            tree.links.iter().for_each(|l| {
                assert!(l.visual.triangles.iter().flatten().all(|k| (*k as usize) < l.visual.vertices.len()))
            });
            assert!(tree.joints.iter().all(|j| (j.axis.norm() - 1.0).abs() < 1e-6));
            assert!(tree.rigid_parts().iter().flatten().all(|l| *l < tree.links.len()));
            assert!(
                tree.joints.iter().all(|j| j
                    .parent_from_joint
                    .to_homogeneous()
                    .iter()
                    .all(|x| x.is_finite()))
            );
        }
        // What `evaluate` refuses, the camera's reader refuses as well.
        let read = tree.is_some();
        if read {
            let _ = read_seen_twin(&path);
        }
        read
    });
}

/// A folder of a model as `check` reads it: URDF, OBJ, MTL and STL, one a piece.
#[test]
fn check() {
    let material = b"newmtl a\nKd 1 1 1\nmap_Kd a.png\n".to_vec();
    let texture = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    let seed =
        |urdf: &str| vec![urdf.as_bytes().to_vec(), OBJ.into(), material.clone(), stl(), texture.clone()];
    let cabinet = URDF
        .replace("meshes/visual/body.obj", "meshes/a.obj")
        .replace("meshes/collision/body_solid_0.obj", "meshes/c.stl");
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        parts.iter().flat_map(|part| [&(part.len() as u32).to_le_bytes()[..], part].concat()).collect()
    }
    let seeds = vec![seed(UNIT), seed(&cabinet)];
    let target = Target { name: "twins::check", seeds, words: &XML, assemble, bytes: BYTES };
    target.run(|input| {
        let mut rest = input;
        let mut next = || {
            let (length, tail) = rest.split_first_chunk::<4>().unwrap_or((&[0; 4], &[]));
            let (part, tail) = tail.split_at((u32::from_le_bytes(*length) as usize).min(tail.len()));
            rest = tail;
            part.to_vec()
        };
        let names = ["unit.urdf", "meshes/a.obj", "meshes/a.mtl", "meshes/c.stl", "meshes/a.png"];
        let folder: Folder = names.map(|name| (name.to_owned(), next())).into();
        let found = check_folder(&folder);
        assert!(found.iter().all(|f| !f.message.is_empty()));
        !found.iter().any(|f| f.rule.word() == "xml")
    });
}

fn mesh(name: &str, file: &str, seeds: &[&[u8]], words: &[&str]) {
    let scratch = Scratch::new(name);
    let target = Target { name, seeds: whole(seeds), words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let path = scratch.put(file, input);
        let read = read_mesh(Path::new(&path)).ok();
        read.iter().for_each(sound);
        read.is_some()
    });
}

/// OBJ meshes.
#[test]
fn obj() {
    mesh(
        "twins::obj",
        "mesh.obj",
        &[OBJ.as_bytes()],
        &["v ", "f ", "/", "//", "\n", "1e39", "vt ", "usemtl "],
    );
}

/// PLY meshes, text and binary.
#[test]
fn ply() {
    let words = [
        "element vertex 20000000\n",
        "element face ",
        "property list uint8 int32 ",
        "property double x\n",
        "end_header\n",
        "ascii",
    ];
    mesh("twins::ply", "mesh.ply", &[PLY.as_bytes(), &binary_ply()], &words);
}
