//! Messages of ROS 2, from bags and from the network.

use io::{
    image_codec as codec,
    image_codec::{MAX_SIDE, Raster},
    pinhole,
    ros2msg::{
        CameraInfo, CompressedFront, CompressedImage, Image, ImageFront, JointState, Odometry, PoseStamped,
        TfMessage, Time, Transform, Vector3, WrenchStamped, decode, encode,
        odometry::FullOdometry,
        status::CollectionStatus,
        text::{Clock, Text},
    },
};
use node::requests::{DiagnoseGoal, ReconstructGoal, SetStateRequest};
use serde::{Serialize, de::DeserializeOwned};

use super::{
    engine::{BYTES, Target, plain, whole},
    recorded::{
        START, WORDS, camera_info, compressed, compressed_depth, header, image, millimeters, picture, pose,
        transform,
    },
};

/// Decodes; what comes out must be the same after it was encoded again.
fn decoded<T: Serialize + DeserializeOwned>(input: &[u8]) -> Option<T> {
    let message: T = decode(input).ok()?;
    let bytes = encode(&message).unwrap();
    let again: T = decode(&bytes).unwrap();
    assert_eq!(encode(&again).unwrap(), bytes);
    Some(message)
}

fn check_pose(given: &Transform) {
    let Some(pose) = given.checked() else { return };
    assert!(pose.to_homogeneous().iter().all(|x| x.is_finite()));
    assert!((pose.rotation.norm() - 1.0).abs() < 1e-6);
}

fn check_raster<T>(raster: &Raster<T>) {
    assert!((1..=MAX_SIDE).contains(&raster.width) && (1..=MAX_SIDE).contains(&raster.height));
    assert_eq!(raster.pixels.len(), raster.width * raster.height);
}

fn check_depth(depth: &Raster<f32>) {
    check_raster(depth);
    assert!(depth.pixels.iter().all(|d| d.is_finite() && *d >= 0.0));
}

fn check_info(info: &CameraInfo) {
    for image in ["/camera/image_raw", "/camera/image_rect"] {
        let Ok((camera, lens)) = pinhole(info, "/camera/camera_info", image) else { continue };
        assert!((1..=MAX_SIDE).contains(&camera.width) && (1..=MAX_SIDE).contains(&camera.height));
        assert!(
            [camera.fx, camera.fy].iter().all(|f| f.is_finite() && *f > 0.0)
                && [camera.cx, camera.cy].iter().all(|c| c.is_finite())
        );
        let _ = lens.is_pinhole();
    }
}

fn check_image(image: &Image) {
    if let Ok(color) = codec::raw_color(image) {
        check_raster(&color);
    }
    if let Ok(depth) = codec::raw_depth(image) {
        check_depth(&depth);
    }
    if let Ok(mask) = codec::raw_mask(image) {
        check_raster(&mask);
    }
}

/// Every type is decoded from every input: a publisher may claim any type for any bytes.
#[test]
fn decoding() {
    let seeds = [
        encode(&camera_info(START, "plumb_bob")),
        encode(&camera_info(START, "rational_polynomial")),
        encode(&image(START, "rgb8", 3, |p| vec![p as u8; 3])),
        encode(&image(START, "16UC1", 2, |p| millimeters(p).to_le_bytes().to_vec())),
        encode(&image(START, "32FC1", 4, |p| (p as f32).to_le_bytes().to_vec())),
        encode(&image(START, "mono8", 1, |p| vec![p as u8])),
        encode(&compressed(START, "png", picture(image::ImageFormat::Png, false))),
        encode(&compressed(START, "16UC1; compressedDepth rvl", compressed_depth(true))),
        encode(&transform(START, "world", "camera", &pose(3))),
        encode(&PoseStamped { header: header(START, "world"), pose: Transform::from_pose(&pose(4)) }),
        encode(&Odometry {
            header: header(START, "odom"),
            child_frame_id: "base".into(),
            pose: Transform::from_pose(&pose(5)),
        }),
        encode(&WrenchStamped {
            header: header(START, "tool"),
            force: Vector3::from([1.0, 2.0, 3.0]),
            ..WrenchStamped::default()
        }),
        encode(&JointState {
            header: header(START, ""),
            name: vec!["a".into(), "b".into()],
            position: vec![1.0, 2.0],
            velocity: Vec::new(),
            effort: vec![0.5, 0.25],
        }),
        encode(&FullOdometry { child_frame_id: "base".into(), ..FullOdometry::default() }),
        encode(&Text { data: "state1".into() }),
        encode(&Clock { clock: Time { sec: 5, nanosec: 6 } }),
        encode(&CollectionStatus::default()),
        encode(&SetStateRequest::default()),
        encode(&ReconstructGoal::default()),
        encode(&DiagnoseGoal::default()),
    ];
    let seeds = whole(seeds.map(Result::unwrap));
    let target = Target { name: "messages::decoding", seeds, words: &WORDS, assemble: plain, bytes: BYTES };
    target.run(|input| {
        let mut known = false;
        if let Some(info) = decoded::<CameraInfo>(input) {
            check_info(&info);
            known = true;
        }
        if let Some(image) = decoded::<Image>(input) {
            assert!(image.data.len() <= input.len());
            check_image(&image);
            known = true;
        }
        if let Some(message) = decoded::<TfMessage>(input) {
            message.transforms.iter().for_each(|t| check_pose(&t.transform));
            known = true;
        }
        if let Some(message) = decoded::<PoseStamped>(input) {
            assert!(message.header.checked().is_none_or(|(nanos, frame)| nanos >= 0 && frame.len() <= 256));
            check_pose(&message.pose);
            known = true;
        }
        known |= decoded::<CompressedImage>(input).is_some() | decoded::<ImageFront>(input).is_some();
        known |= decoded::<CompressedFront>(input).is_some() | decoded::<Odometry>(input).is_some();
        known |= decoded::<JointState>(input).is_some() | decoded::<WrenchStamped>(input).is_some();
        known |= decoded::<FullOdometry>(input).is_some() | decoded::<Text>(input).is_some();
        known |= decoded::<Clock>(input).is_some() | decoded::<CollectionStatus>(input).is_some();
        known |= decoded::<SetStateRequest>(input).is_some() | decoded::<ReconstructGoal>(input).is_some();
        known |= decoded::<DiagnoseGoal>(input).is_some();
        known
    });
}

/// Pixels of raw images with whole headers: sizes, steps and encodings against the data.
#[test]
fn raw_images() {
    let seeds = [
        image(START, "rgb8", 3, |p| vec![p as u8; 3]),
        image(START, "bgra8", 4, |p| vec![p as u8; 4]),
        image(START, "mono8", 1, |p| vec![p as u8]),
        image(START, "mono16", 2, |p| millimeters(p).to_le_bytes().to_vec()),
        image(START, "32FC1", 4, |p| (0.1 * p as f32).to_le_bytes().to_vec()),
    ];
    let sizes =
        |i: &Image| [i.height, i.width, i.step, u32::from(i.is_bigendian)].map(u32::to_le_bytes).concat();
    let seeds =
        seeds.iter().map(|i| vec![sizes(i), i.encoding.clone().into_bytes(), i.data.clone()]).collect();
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        let part = |k: usize| parts.get(k).map_or(&[][..], Vec::as_slice);
        let number =
            |k: usize| part(0).get(4 * k..4 * k + 4).map_or(1, |b| u32::from_le_bytes(b.try_into().unwrap()));
        let encoding = String::from_utf8_lossy(part(1)).into_owned();
        let [height, width, step, big] = [0, 1, 2, 3].map(number);
        let data = part(2).to_vec();
        encode(&Image {
            header: header(START, "x"),
            height,
            width,
            encoding,
            is_bigendian: big as u8,
            step,
            data,
        })
        .unwrap()
    }
    let target = Target { name: "messages::raw_images", seeds, words: &WORDS, assemble, bytes: BYTES };
    target.run(|input| {
        let Ok(image) = decode::<Image>(input) else { return false };
        check_image(&image);
        codec::raw_color(&image).is_ok()
            || codec::raw_depth(&image).is_ok()
            || codec::raw_mask(&image).is_ok()
    });
}
