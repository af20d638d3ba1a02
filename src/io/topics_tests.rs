//! Tests of the choice of topics.

use super::*;

fn topic(name: &str, kind: &str, encoding: &str) -> TopicSummary {
    let type_name = if kind.contains('/') { kind.to_owned() } else { format!("sensor_msgs/msg/{kind}") };
    TopicSummary { name: name.into(), type_name, count: 30, encoding: encoding.into(), ..Default::default() }
}

fn realsense() -> Vec<TopicSummary> {
    vec![
        topic("/camera/camera/aligned_depth_to_color/camera_info", "CameraInfo", ""),
        topic(
            "/camera/camera/aligned_depth_to_color/image_raw/compressedDepth",
            "CompressedImage",
            "16UC1; compressedDepth png",
        ),
        topic("/camera/camera/color/camera_info", "CameraInfo", ""),
        topic("/camera/camera/color/image_raw/compressed", "CompressedImage", "rgb8; jpeg compressed bgr8"),
        topic("/camera/camera/depth/camera_info", "CameraInfo", ""),
        topic("/camera/camera/depth/image_rect_raw", "Image", "16UC1"),
        topic("/camera/camera/infra1/image_rect_raw", "Image", "mono8"),
        topic("/object_mask", "Image", "mono8"),
        topic("/tf", "tf2_msgs/msg/TFMessage", ""),
    ]
}

fn pick(topics: &[TopicSummary], wanted: &TopicConfig) -> Result<TopicChoice, CaptureError> {
    choose(topics, wanted, Path::new("bag"))
}

#[test]
fn realsense_topics_are_found_and_the_aligned_depth_wins() {
    let choice = pick(&realsense(), &TopicConfig::default()).unwrap();
    assert_eq!(choice.color, "/camera/camera/color/image_raw/compressed");
    assert_eq!(choice.depth, "/camera/camera/aligned_depth_to_color/image_raw/compressedDepth");
    assert_eq!(choice.color_info, "/camera/camera/color/camera_info");
    assert_eq!(choice.depth_info.as_deref(), Some("/camera/camera/aligned_depth_to_color/camera_info"));
    assert_eq!(choice.mask.as_deref(), Some("/object_mask"));
}

#[test]
fn raw_is_preferred_over_compressed_of_the_same_camera() {
    let mut topics = realsense();
    topics.push(topic("/camera/camera/color/image_raw", "Image", "rgb8"));
    assert_eq!(pick(&topics, &TopicConfig::default()).unwrap().color, "/camera/camera/color/image_raw");
}

#[test]
fn topics_can_be_named_and_wrong_names_are_refused() {
    let depth = |name: &str| TopicConfig { depth: Some(name.into()), ..TopicConfig::default() };
    let name = "/camera/camera/depth/image_rect_raw";
    assert_eq!(pick(&realsense(), &depth(name)).unwrap().depth, name);
    let text = pick(&realsense(), &depth("/nope")).unwrap_err().to_string();
    assert!(
        text.contains("/nope") && text.contains("not in the recording") && text.contains("/object_mask"),
        "{text}"
    );
    assert!(pick(&realsense(), &depth("/tf")).unwrap_err().to_string().contains("TFMessage"));
}

#[test]
fn what_is_missing_is_named_with_its_remedy() {
    let without = |words: &[&str]| {
        realsense().into_iter().filter(|t| !words.iter().any(|w| t.name.contains(w))).collect::<Vec<_>>()
    };
    let text = |topics: &[TopicSummary]| pick(topics, &TopicConfig::default()).unwrap_err().to_string();
    assert!(text(&without(&["depth"])).contains("no depth topic"));
    // Infrared is no color.
    let no_color = text(&without(&["color/image"]));
    assert!(no_color.contains("no color topic") && no_color.contains("infra1"), "{no_color}");
    assert!(text(&without(&["color/camera_info"])).contains("no camera_info topic"));
    let other = text(&without(&["camera", "mask"]));
    assert!(other.contains("not an RGB-D recording") && other.contains("/tf"), "{other}");
}

#[test]
fn the_only_camera_info_serves_a_camera_without_one_beside_it() {
    let topics =
        [topic("/rgb", "Image", "rgb8"), topic("/d", "Image", "16UC1"), topic("/info", "CameraInfo", "")];
    let choice = pick(&topics, &TopicConfig::default()).unwrap();
    assert_eq!((choice.color_info.as_str(), choice.depth_info), ("/info", None));
}

/// The topics of two cameras; every `drop`-th image of a topic is missing.
fn two_cameras(names: [&str; 2], drops: [usize; 4]) -> Vec<TopicSummary> {
    let mut topics = Vec::new();
    for (c, name) in names.into_iter().enumerate() {
        let streams = [
            (format!("/{name}/camera/color/image_raw"), "rgb8", drops[2 * c]),
            (format!("/{name}/camera/aligned_depth_to_color/image_raw"), "16UC1", drops[2 * c + 1]),
        ];
        for (stream, encoding, drop) in streams {
            let stamps: Vec<i64> = (1..31).filter(|k| k % drop as i64 != 0).map(|k| k << 27).collect();
            topics.push(TopicSummary {
                count: stamps.len(),
                frame: format!("{name}_optical"),
                size: Some((640, 480)),
                stamps,
                moves: c == 0,
                ..topic(&stream, "Image", encoding)
            });
            topics.push(topic(&format!("{}/camera_info", parent(&stream)), "CameraInfo", ""));
        }
    }
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    topics
}

#[test]
fn color_and_depth_are_of_one_camera_and_of_the_one_that_moves() {
    for names in [["wrist", "scene"], ["left_arm", "front"]] {
        for drops in [[99; 4], [5, 99, 99, 7], [7, 5, 99, 99]] {
            let choice = pick(&two_cameras(names, drops), &TopicConfig::default()).unwrap();
            assert!(choice.color.starts_with(&format!("/{}/", names[0])), "{choice:?}");
            assert!(choice.depth.starts_with(&format!("/{}/", names[0])), "{choice:?}");
            assert_eq!(choice.others.len(), 2);
        }
    }
}

#[test]
fn what_is_drawn_of_the_images_is_neither_color_nor_mask() {
    let color = TopicConfig::default();
    for (name, encoding) in [
        ("/detection/rgb_image_raw", "rgb8"),
        ("/yolo/mask_overlay", "bgr8"),
        ("/ultralytics/segmentation/image", "rgb8"),
        ("/camera/camera/color/image_annotated", "bgr8"),
    ] {
        let mut topics: Vec<_> = realsense().into_iter().filter(|t| t.name != "/object_mask").collect();
        topics.push(topic(name, "Image", encoding));
        let choice = pick(&topics, &color).unwrap();
        assert_eq!(choice.color, "/camera/camera/color/image_raw/compressed", "{name}");
        assert_eq!(choice.mask, None, "{name}");
    }
}
