use std::{collections::BTreeMap, fmt::Write as _, fs};

use super::*;
use crate::{Recording, bag::Bag, bag_index::BagIndex, ros2msg::decode};
use capture::{CaptureConfig, RgbdFrame};
use common::stop::Stop;
use geometry::Intrinsics;

/// Views of the shipped drawer that the folders hold.
const COUNT: usize = 5;

/// One view of the shipped drawer as files.
struct Shot {
    stamp_nanos: i64,
    jpeg: Vec<u8>,
    depth_png: Vec<u8>,
    world_from_camera: Pose,
}

/// The first views of the shipped drawer, and their camera.
fn shots() -> (Vec<Shot>, Intrinsics) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/state0");
    let recording = Recording::open(&path, &CaptureConfig::default(), 0, &Stop::never()).unwrap();
    let views = &recording.views;
    let mut messages: BTreeMap<(String, usize), Vec<u8>> = BTreeMap::new();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    recording
        .bag
        .read(&mut |message| {
            let count = counts.entry(message.topic.to_owned()).or_default();
            if message.type_name == COMPRESSED {
                let image: CompressedImage = decode(message.data).unwrap();
                messages.insert((message.topic.to_owned(), *count), image.data);
            }
            *count += 1;
            Ok(())
        })
        .unwrap();
    let shots = views.views[..COUNT].iter().map(|v| Shot {
        stamp_nanos: v.stamp_nanos,
        jpeg: messages[&(views.topics.color.clone(), v.color)].clone(),
        // Behind the 12 bytes of compressedDepth.
        depth_png: messages[&(views.topics.depth.clone(), v.depth)][12..].to_vec(),
        world_from_camera: v.world_from_camera.unwrap(),
    });
    (shots.collect(), views.cameras[0].intrinsics)
}

/// The frames of a recording, without masks.
fn frames(path: &Path) -> Vec<RgbdFrame> {
    let config = CaptureConfig::default();
    let recording = Recording::open(path, &config, 0, &Stop::never()).unwrap();
    let chosen: Vec<(usize, usize)> = recording.all().into_iter().map(|v| (0, v)).collect();
    let decoded = recording.decode(&chosen, &config, &Stop::never()).unwrap();
    assert!(decoded.lost.is_empty(), "{:?}", decoded.lost);
    decoded.frames.into_iter().map(|(_, frame)| frame).collect()
}

/// Compares a folder's frames with those of the bag; `depth_m` is the rounding of its depth, and its world
/// may be turned.
fn same_as_the_bag(folder: &Path, rounding_m: f32, bag_from_folder: &Pose) {
    let (_, camera) = shots();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/state0");
    let expected = frames(&path);
    let found = frames(folder);
    assert_eq!(found.len(), COUNT);
    for (a, b) in found.iter().zip(&expected) {
        assert_eq!(a.rgb, b.rgb);
        let worst = a.depth_m.iter().zip(&b.depth_m).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        assert!(worst <= rounding_m, "{worst}");
        let difference = b.world_from_camera.inverse() * bag_from_folder * a.world_from_camera;
        assert!(
            difference.translation.vector.norm() < 1e-6 && difference.rotation.angle() < 1e-6,
            "{difference}"
        );
        let k = a.intrinsics;
        let off = [k.fx - camera.fx, k.fy - camera.fy, k.cx - camera.cx, k.cy - camera.cy];
        assert!(off.iter().all(|d| d.abs() < 1e-9), "{off:?}");
    }
}

fn put(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

fn matrix_text(k: &Intrinsics) -> String {
    format!("{:.9} 0 {:.9}\n0 {:.9} {:.9}\n0 0 1\n", k.fx, k.cx, k.fy, k.cy)
}

/// Rows of a 4x4 matrix.
fn rows_of(pose: &Pose) -> Vec<Vec<f64>> {
    let m = pose.to_homogeneous();
    m.row_iter().map(|r| r.iter().copied().collect()).collect()
}

fn matrix_lines(pose: &Pose) -> String {
    let row = |r: Vec<f64>| r.iter().map(|v| format!("{v:.12}")).collect::<Vec<_>>().join(" ");
    rows_of(pose).into_iter().map(row).collect::<Vec<_>>().join("\n")
}

/// The camera's pose in OpenGL axes.
fn opengl(world_from_camera: &Pose) -> Pose {
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI);
    world_from_camera * Pose::from_parts(nalgebra::Translation3::identity(), turn)
}

/// The pose in a world whose y points up.
fn y_up(world_from_camera: &Pose) -> Pose {
    // (x, y, z) of the world with z up is (y, z, x) of the one with y up.
    let m = nalgebra::Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
    let turn = nalgebra::UnitQuaternion::from_matrix(&m);
    Pose::from_parts(nalgebra::Translation3::identity(), turn) * world_from_camera
}

/// Position and quaternion of a pose.
fn seven(pose: &Pose) -> [f64; 7] {
    let t = pose.translation.vector;
    let q = pose.rotation;
    [t.x, t.y, t.z, q.i, q.j, q.k, q.w]
}

/// The depth image with every reading multiplied.
fn scaled_depth(png: &[u8], factor: u16) -> Vec<u8> {
    let image = image::load_from_memory(png).unwrap().into_luma16();
    let scaled = image::ImageBuffer::from_fn(image.width(), image.height(), |x, y| {
        image::Luma([image.get_pixel(x, y).0[0].saturating_mul(factor)])
    });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::DynamicImage::ImageLuma16(scaled).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn a_tum_folder_gives_the_frames_of_the_bag() {
    let (shots, camera) = shots();
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let mut lists =
        ["# color images\n".to_owned(), "# depth maps\n".to_owned(), "# ground truth\n".to_owned()];
    for shot in &shots {
        let stamp = format!("{:.6}", shot.stamp_nanos as f64 * 1e-9);
        put(folder, &format!("rgb/{stamp}.jpg"), &shot.jpeg);
        put(folder, &format!("depth/{stamp}.png"), scaled_depth(&shot.depth_png, 5));
        _ = writeln!(lists[0], "{stamp} rgb/{stamp}.jpg");
        _ = writeln!(lists[1], "{stamp} depth/{stamp}.png");
        let numbers = seven(&shot.world_from_camera).map(|v| format!("{v:.12}")).join(" ");
        _ = writeln!(lists[2], "{stamp} {numbers}");
    }
    for (name, list) in ["rgb.txt", "depth.txt", "groundtruth.txt"].iter().zip(&lists) {
        put(folder, name, list);
    }
    // The format has no file of the camera; what the refusal proposes is taken.
    let why = Bag::open(folder).unwrap_err().to_string();
    assert!(why.contains("cam_K.txt") && why.contains("525 0 319.5 0 525 239.5 0 0 1"), "{why}");
    put(folder, "cam_K.txt", "525 0 319.5 0 525 239.5 0 0 1");
    assert_eq!(frames(folder).len(), COUNT);
    put(folder, "cam_K.txt", matrix_text(&camera));
    same_as_the_bag(folder, 1e-6, &Pose::identity());
    put(folder, "rgb.txt", "1.0 ../x.png\n");
    assert!(Bag::open(folder).unwrap_err().to_string().contains("lies outside the folder"));
}

#[test]
fn object_frames_give_the_frames_of_the_bag_with_poses_of_the_object_or_the_camera_or_none() {
    let (shots, camera) = shots();
    for (name, turned) in [("ob_in_cam", true), ("annotated_poses", true), ("poses", false)] {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path();
        put(folder, "cam_K.txt", matrix_text(&camera));
        for (i, shot) in shots.iter().enumerate() {
            put(folder, &format!("rgb/{i:06}.jpg"), &shot.jpeg);
            put(folder, &format!("depth/{i:06}.png"), &shot.depth_png);
            let pose = if turned { shot.world_from_camera.inverse() } else { shot.world_from_camera };
            put(folder, &format!("{name}/{i:06}.txt"), matrix_lines(&pose));
        }
        same_as_the_bag(folder, 0.0, &Pose::identity());
        fs::remove_dir_all(folder.join(name)).unwrap();
        let recording = Recording::open(folder, &CaptureConfig::default(), 0, &Stop::never()).unwrap();
        assert!(recording.views.are_untracked() && recording.all().len() == COUNT);
    }
}

/// `transforms.json` of the shots, with further keys.
fn transforms_json(shots: &[Shot], k: &Intrinsics, scale: f64, more: &str) -> String {
    let frame = |(i, shot): (usize, &Shot)| {
        let mut pose = opengl(&shot.world_from_camera);
        pose.translation.vector *= scale;
        format!(
            "{{\"file_path\": \"./images/frame_{i:05}.jpg\", \
             \"depth_file_path\": \"depths/frame_{i:05}.png\", \
             \"transform_matrix\": {:?}}}",
            rows_of(&pose)
        )
    };
    let frames = shots.iter().enumerate().map(frame).collect::<Vec<_>>().join(",\n");
    // nerfstudio puts pixel centers at half integers.
    format!(
        "{{\"camera_model\": \"OPENCV\", \"w\": {}, \"h\": {}, \"fl_x\": {}, \"fl_y\": {}, \
         \"cx\": {}, \"cy\": {}, \
         \"k1\": 0.0, {more} \"frames\": [{frames}]}}",
        k.width,
        k.height,
        k.fx,
        k.fy,
        k.cx + 0.5,
        k.cy + 0.5
    )
}

#[test]
fn transforms_of_nerfstudio_give_the_frames_of_the_bag() {
    let (shots, camera) = shots();
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    for (i, shot) in shots.iter().enumerate() {
        put(folder, &format!("images/frame_{i:05}.jpg"), &shot.jpeg);
        put(folder, &format!("depths/frame_{i:05}.png"), &shot.depth_png);
    }
    put(folder, "transforms.json", transforms_json(&shots, &camera, 1.0, ""));
    same_as_the_bag(folder, 0.0, &Pose::identity());
    // Poses that were scaled, as `applied_scale` says, and a world that was turned already.
    let more = "\"applied_scale\": 0.25, \"applied_transform\": [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]],";
    put(folder, "transforms.json", transforms_json(&shots, &camera, 0.25, more));
    same_as_the_bag(folder, 0.0, &Pose::identity());
    let without_depth = transforms_json(&shots, &camera, 1.0, "").replace("depth_file_path", "depth_gone");
    put(folder, "transforms.json", without_depth);
    assert!(Bag::open(folder).unwrap_err().to_string().contains("depth is needed"));
}

#[test]
fn a_record3d_folder_gives_the_frames_of_the_bag() {
    let (shots, k) = shots();
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let mut poses = Vec::new();
    for (i, shot) in shots.iter().enumerate() {
        put(folder, &format!("rgb/{i}.jpg"), &shot.jpeg);
        put(folder, &format!("depth/{i}.png"), &shot.depth_png);
        let [x, y, z, i, j, k, w] = seven(&opengl(&y_up(&shot.world_from_camera)));
        poses.push([i, j, k, w, x, y, z]);
    }
    let matrix = [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0];
    put(
        folder,
        "metadata.json",
        format!(
            "{{\"w\": {}, \"h\": {}, \"K\": {matrix:?}, \"fps\": 60, \"poses\": {poses:?}}}",
            k.width, k.height
        ),
    );
    same_as_the_bag(folder, 0.0, &Pose::identity());
}

/// A Stray Scanner folder of the shots; its depth has half of the color's columns and rows.
fn put_stray(folder: &Path, shots: &[Shot], k: &Intrinsics, frames: &str) {
    let video = [1920.0 / k.width as f64, 1440.0 / k.height as f64];
    let scaled =
        [k.fx * video[0], (k.cx + 0.5) * video[0] - 0.5, k.fy * video[1], (k.cy + 0.5) * video[1] - 0.5];
    put(
        folder,
        "camera_matrix.csv",
        format!("{}, 0.0, {}\n0.0, {}, {}\n0.0, 0.0, 1.0\n", scaled[0], scaled[1], scaled[2], scaled[3]),
    );
    let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
    for (i, shot) in shots.iter().enumerate() {
        put(folder, &format!("{frames}/{i:06}.jpg"), &shot.jpeg);
        let whole = image::load_from_memory(&shot.depth_png).unwrap().into_luma16();
        let half = image::ImageBuffer::from_fn(whole.width() / 2, whole.height() / 2, |x, y| {
            *whole.get_pixel(2 * x, 2 * y)
        });
        // Of low confidence in the left half.
        let confidence = image::GrayImage::from_fn(half.width(), half.height(), |x, _| {
            image::Luma([if x < half.width() / 2 { 0 } else { 2 }])
        });
        for (name, image) in [("depth", image::DynamicImage::from(half)), ("confidence", confidence.into())] {
            let mut bytes = std::io::Cursor::new(Vec::new());
            image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            put(folder, &format!("{name}/{i:06}.png"), bytes.into_inner());
        }
        let numbers = seven(&y_up(&shot.world_from_camera)).map(|v| format!("{v:.12}")).join(", ");
        _ = writeln!(odometry, "{:.6}, {i:06}, {numbers}", 100.0 + 0.05 * i as f64);
    }
    put(folder, "odometry.csv", odometry);
}

#[test]
fn a_stray_scanner_folder_gives_cameras_of_both_sizes_poses_and_trusted_depth() {
    let (shots, k) = shots();
    let temp = tempfile::tempdir().unwrap();
    put_stray(temp.path(), &shots, &k, "rgb");
    let bag = Bag::open(temp.path()).unwrap();
    let index = BagIndex::read(&bag, &Stop::never()).unwrap();
    let info = |topic: &str| index.infos[topic].distinct[0].clone();
    let color = info(COLOR_INFO);
    assert!((color.k[0] - k.fx).abs() < 1e-9 && (color.k[5] - k.cy).abs() < 1e-9, "{color:?}");
    let depth = info(DEPTH_INFO);
    assert_eq!((depth.width, depth.height), (color.width / 2, color.height / 2));
    assert!((depth.k[0] - 0.5 * k.fx).abs() < 1e-9 && (depth.k[2] - (0.5 * k.cx - 0.25)).abs() < 1e-9);
    for (i, shot) in shots.iter().enumerate() {
        let stamp = index.images[COLOR].entries[i].stamp_nanos;
        let found = index.tf.lookup(WORLD, CAMERA, stamp, 1).unwrap();
        let difference = found.inverse() * shot.world_from_camera;
        assert!(difference.translation.vector.norm() < 1e-6 && difference.rotation.angle() < 1e-6);
    }
    let mut readings = [0, 0];
    bag.read(&mut |message| {
        if message.topic == DEPTH {
            let image: crate::ros2msg::Image = decode(message.data).unwrap();
            for (i, word) in image.data.chunks_exact(2).enumerate() {
                let is_right = i % image.width as usize >= image.width as usize / 2;
                readings[usize::from(is_right)] += usize::from(word != [0, 0]);
            }
        }
        Ok(())
    })
    .unwrap();
    assert!(readings[0] == 0 && readings[1] > 1000, "{readings:?}");
}

#[test]
fn a_stray_scanner_video_is_refused_with_the_command_that_makes_images() {
    let (shots, k) = shots();
    let temp = tempfile::tempdir().unwrap();
    put_stray(temp.path(), &shots, &k, "elsewhere");
    put(temp.path(), "rgb.mp4", b"video");
    let why = Bag::open(temp.path()).unwrap_err().to_string();
    assert!(why.contains("`mkdir ") && why.contains("ffmpeg -i ") && why.contains("rgb/%06d.jpg'`"), "{why}");
}
