//! Recordings whose images are there but in a form that is not read, each with what makes a form of it that
//! is.

use std::path::Path;

use super::topics::{ImageRole, TopicSummary};
use capture::{CaptureError, TopicConfig, quoted};

/// Types of messages that hold a part of a video.
const VIDEO_TYPES: [&str; 3] = [
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
    "foxglove_msgs/msg/CompressedVideo",
    "foxglove.CompressedVideo",
];
/// How topics begin in what the RealSense viewer records.
const REALSENSE_VIEWER: &str = "/device_0/sensor_";

/// Refuses a recording of the RealSense viewer, and one whose color is a video.
///
/// # Errors
/// [`CaptureError::Unsupported`] with the command that converts.
pub(super) fn refuse_foreign(
    topics: &[TopicSummary],
    wanted: &TopicConfig,
    path: &Path,
) -> Result<(), CaptureError> {
    let at = quoted(path);
    if topics.iter().any(|t| t.count > 0 && t.name.starts_with(REALSENSE_VIEWER)) {
        return Err(CaptureError::Unsupported {
            what: format!(
                "`{}`: a recording of the RealSense viewer, whose images name no frames,",
                path.display()
            ),
            remedy: format!(
                "play it to ROS 2 with `ros2 launch realsense2_camera rs_launch.py rosbag_filename:={at} \
                 align_depth.enable:=true`, and record that with `ros2 bag record -a -s mcap -o NEW`"
            ),
        });
    }
    let has_color = topics.iter().any(|t| t.count > 0 && t.image_role() == Some(ImageRole::Color));
    let video = topics.iter().find(|t| t.count > 0 && VIDEO_TYPES.contains(&t.type_name.as_str()));
    match video {
        Some(video) if !has_color && wanted.color.is_none() => Err(CaptureError::Unsupported {
            what: format!("`{}`: color as a video ({}, {})", path.display(), video.name, video.type_name),
            remedy: format!(
                "make images of it with `python -m artitwin.decode_video {at} NEW.mcap` (pip install \
                 artitwin av pillow mcap-ros2-support)"
            ),
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(name: &str, type_name: &str, encoding: &str) -> TopicSummary {
        let recorded = TopicSummary { count: 3, ..TopicSummary::default() };
        TopicSummary { name: name.into(), type_name: type_name.into(), encoding: encoding.into(), ..recorded }
    }

    #[test]
    fn a_video_is_named_with_what_makes_images_of_it_unless_there_are_images() {
        let refused = |topics: &[TopicSummary]| {
            refuse_foreign(topics, &TopicConfig::default(), Path::new("a.mcap")).map_err(|e| e.to_string())
        };
        let depth = topic("/d", "sensor_msgs/msg/Image", "16UC1");
        for type_name in VIDEO_TYPES {
            let video = topic("/color/image_raw/ffmpeg", type_name, "");
            let why = refused(&[depth.clone(), video.clone()]).unwrap_err();
            assert!(
                why.contains(type_name) && why.contains("artitwin.decode_video a.mcap NEW.mcap"),
                "{why}"
            );
            let color = topic("/color/image_raw", "sensor_msgs/msg/Image", "rgb8");
            assert_eq!(refused(&[depth.clone(), video, color]), Ok(()));
        }
        let viewer = topic("/device_0/sensor_1/Color_0/image/data", "sensor_msgs/msg/Image", "rgb8");
        assert!(refused(&[viewer]).unwrap_err().contains("rosbag_filename:=a.mcap"));
    }
}
