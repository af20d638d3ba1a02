//! Other forms of recordings: folders of images are looked into, refusals name commands that work,
//! and URDFs in ROS packages are read.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test may panic, and says why it is left out"
)]

mod common;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/program.rs"]
mod program;
#[path = "common/venv.rs"]
mod venv;

use std::{
    fs,
    path::Path,
    process::{Command, ExitCode},
};

use ::common::stop::Stop;
use capture::CaptureConfig;
use harness::{Missing, tests};
use io::{
    Recording, read_urdf,
    ros2msg::{CompressedImage, Image, decode},
};
use program::{end, messages, reconstruct, shipped};

fn main() -> ExitCode {
    harness::main(tests![
        a_folder_with_a_folder_for_each_state_is_usable,
        inspect_and_reconstruct_agree_on_what_is_no_recording,
        meshes_of_ros_packages_are_found,
        the_video_of_a_phone_is_read_after_the_command_that_its_refusal_names,
    ])
}

fn put(path: &Path, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Writes a state of the shipped drawer as object frames, and gives its views.
fn put_object_frames(state: usize, folder: &Path) {
    let bag = shipped(&format!("drawer/state{state}"));
    let all = messages(&bag);
    let recording = Recording::open(&bag, &CaptureConfig::default(), state, &Stop::never()).unwrap();
    let views = &recording.views;
    let of = |topic: &str, ordinal: usize| {
        all.iter().find(|m| m.topic == topic && m.ordinal == ordinal).unwrap().data.clone()
    };
    let k = views.cameras[0].intrinsics;
    put(&folder.join("cam_K.txt"), format!("{} 0 {}\n0 {} {}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy));
    for (i, view) in views.views.iter().enumerate() {
        let color: CompressedImage = decode(&of(&views.topics.color, view.color)).unwrap();
        put(&folder.join(format!("rgb/{i:06}.jpg")), color.data);
        let depth: CompressedImage = decode(&of(&views.topics.depth, view.depth)).unwrap();
        put(&folder.join(format!("depth/{i:06}.png")), &depth.data[12..]);
        let mask: Image = decode(&of(views.topics.mask.as_ref().unwrap(), view.mask.unwrap())).unwrap();
        let mask = image::GrayImage::from_raw(mask.width, mask.height, mask.data).unwrap();
        fs::create_dir_all(folder.join("masks")).unwrap();
        mask.save(folder.join(format!("masks/{i:06}.png"))).unwrap();
        let object = view.world_from_camera.unwrap().inverse().to_homogeneous();
        let rows =
            object.row_iter().map(|r| format!("{:.15} {:.15} {:.15} {:.15}\n", r[0], r[1], r[2], r[3]));
        put(&folder.join(format!("ob_in_cam/{i:06}.txt")), rows.collect::<String>());
    }
}

fn a_folder_with_a_folder_for_each_state_is_usable() {
    let folder = tempfile::tempdir().unwrap();
    for state in 0..2 {
        put_object_frames(state, &folder.path().join(format!("state{state}")));
    }
    let looked_at = end(Command::new(env!("CARGO_BIN_EXE_artitwin")).arg("inspect").arg(folder.path()));
    let told = looked_at.stdout;
    assert!(
        looked_at.code == 0 && told.contains("(object frames)") && told.contains("usable: yes"),
        "{told}"
    );
    assert_eq!(told.matches("posed RGB-D views: 16").count(), 2, "{told}");
}

fn inspect_and_reconstruct_agree_on_what_is_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("scan");
    for state in ["state0", "state1"] {
        put(&root.join(state).join("cloud.ply"), "ply");
    }
    let one = folder.path().join("one");
    put_object_frames(0, &one);
    for (path, words) in
        [(&root, "state0` is not a recording: the folder holds cloud.ply"), (&one, "two states are needed")]
    {
        let looked_at = end(Command::new(env!("CARGO_BIN_EXE_artitwin")).arg("inspect").arg(path));
        let tried = end(&mut reconstruct(&[path], &folder.path().join("out"), &[]));
        assert!(looked_at.code != 0 && tried.code != 0);
        let told = looked_at.stdout + &looked_at.stderr;
        assert!(told.contains(words) && tried.stderr.contains(words), "{told}\n{}", tried.stderr);
    }
}

const OBJ: &str = "mtllib m.mtl\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nvn 0 0 1\nusemtl a\n\
    f 1//1 3//1 2//1\nf 1//1 2//1 4//1\nf 1//1 4//1 3//1\nf 2//1 3//1 4//1\n";

fn meshes_of_ros_packages_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let package = |name: &str| folder.path().join("src").join(name);
    for name in ["arm_description", "arm_meshes"] {
        put(&package(name).join("package.xml"), format!("<package format='3'><name>{name}</name></package>"));
        put(&package(name).join("meshes/m.obj"), OBJ);
        put(&package(name).join("meshes/m.mtl"), "newmtl a\nKd 0.5 0.5 0.5\n");
    }
    let elsewhere = folder.path().join("elsewhere/share/far_meshes");
    put(&elsewhere.join("package.xml"), "<package><name>far_meshes</name></package>");
    put(&elsewhere.join("meshes/m.obj"), OBJ);
    put(&elsewhere.join("meshes/m.mtl"), "newmtl a\n");
    for (mesh, prefix, found) in [
        ("package://arm_description/meshes/m.obj", None, true),
        ("package://arm_meshes/meshes/m.obj", None, true),
        ("../meshes/m.obj", None, true),
        ("package://far_meshes/meshes/m.obj", Some("elsewhere"), true),
        ("package://far_meshes/meshes/m.obj", None, false),
        ("package://arm_description/../../gone.obj", None, false),
        ("../../arm_meshes/meshes/m.obj", None, false),
    ] {
        let urdf = package("arm_description").join("urdf/arm.urdf");
        let text = format!(
            "<robot name='arm'><link name='base'><inertial><mass value='1'/><inertia ixx='0.01' \
             iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial><visual><geometry>\
             <mesh filename='{mesh}'/></geometry></visual></link></robot>"
        );
        put(&urdf, text);
        let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
        command.arg("check").arg(&urdf).env_remove("ROS_PACKAGE_PATH").env_remove("AMENT_PREFIX_PATH");
        if let Some(prefix) = prefix {
            command.env("AMENT_PREFIX_PATH", folder.path().join(prefix));
        }
        let told = end(&mut command).stdout;
        let is_lost = told.contains("is missing") || told.contains("leads out of the folder");
        assert_eq!(!is_lost, found, "{mesh}: {told}");
        if prefix.is_none() {
            // What `diagnose --frames` reads.
            assert_eq!(read_urdf(&urdf).is_ok(), found, "{mesh}: {:?}", read_urdf(&urdf).err());
        }
    }
}

/// The part of a text between backquotes that holds `word`.
fn quoted_command(text: &str, word: &str) -> String {
    text.split('`').find(|part| part.contains(word)).unwrap().to_owned()
}

fn the_video_of_a_phone_is_read_after_the_command_that_its_refusal_names() -> Result<(), Missing> {
    venv::program("ffmpeg", "-version", "ffmpeg")?;
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("a scan's folder");
    put_object_frames(0, &scan);
    put(&scan.join("camera_matrix.csv"), "2000, 0, 960\n0, 2000, 720\n0, 0, 1\n");
    let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
    for i in 0..16 {
        odometry += &format!("{}, {i:06}, 0.0{i:02}, 0, 0, 0, 0, 0, 1\n", 1.0 + 0.1 * f64::from(i));
    }
    put(&scan.join("odometry.csv"), odometry);
    let video = scan.join("rgb.mp4");
    let mut make = Command::new("ffmpeg");
    make.args(["-loglevel", "error", "-i"]).arg(scan.join("rgb/%06d.jpg")).arg(&video);
    assert_eq!(end(&mut make).code, 0);
    fs::remove_dir_all(scan.join("rgb")).unwrap();
    let refused =
        Recording::open(&scan, &CaptureConfig::default(), 0, &Stop::never()).err().unwrap().to_string();
    let ended = end(Command::new("sh").arg("-c").arg(quoted_command(&refused, "ffmpeg")));
    assert_eq!(ended.code, 0, "{refused}\n{}", ended.stderr);
    let read = Recording::open(&scan, &CaptureConfig::default(), 0, &Stop::never()).unwrap();
    assert_eq!(read.all().len(), 16);
    Ok(())
}
