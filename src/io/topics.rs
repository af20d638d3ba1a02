//! Chooses the topics of color, depth, camera_info, mask and pose: by type, encoding and name, or as
//! requested.

use std::path::Path;

use super::foreign_topics::refuse_foreign;
use capture::{CaptureError, TopicConfig};
use common::limits::NAMED;

/// Type, count and encoding of a topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicSummary {
    /// Name.
    pub name: String,
    /// Type, e.g. `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// Number of decodable messages.
    pub count: usize,
    /// Encoding of an Image, format of a CompressedImage (of the first message).
    pub encoding: String,
}

/// The topics used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicChoice {
    /// Color images.
    pub color: String,
    /// Depth images.
    pub depth: String,
    /// CameraInfo of the color images.
    pub color_info: String,
    /// CameraInfo of the depth images, where there is one.
    pub depth_info: Option<String>,
    /// Object masks.
    pub mask: Option<String>,
    /// Camera poses in place of /tf.
    pub pose: Option<String>,
    /// Marker between states.
    pub marker: Option<String>,
}

/// Role of an image topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageRole {
    /// Color.
    Color,
    /// Depth.
    Depth,
    /// Object mask.
    Mask,
}

/// Types of pose messages.
pub const POSE_TYPES: [&str; 2] = ["geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"];
/// Types of image messages.
pub const IMAGE_TYPES: [&str; 2] = ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"];
/// Type of camera parameters.
pub const INFO_TYPE: &str = "sensor_msgs/msg/CameraInfo";

impl TopicSummary {
    /// Role of a topic by its encoding and name; `None` if it is no image topic.
    #[must_use]
    pub fn image_role(&self) -> Option<ImageRole> {
        if !IMAGE_TYPES.contains(&self.type_name.as_str()) {
            return None;
        }
        let name = self.name.to_ascii_lowercase();
        let encoding = self.encoding.as_str();
        // Checked before the encoding: label images are often 16UC1, as depth is.
        let named_mask = ["mask", "segment", "label"].iter().any(|w| name.contains(w));
        let depth_encoding = ["16UC1", "32FC1", "mono16"].iter().any(|e| encoding.starts_with(e))
            || encoding.contains("compressedDepth");
        Some(match () {
            () if named_mask => ImageRole::Mask,
            () if depth_encoding || name.contains("depth") => ImageRole::Depth,
            () => ImageRole::Color,
        })
    }

    /// How well the name fits a role; higher is better.
    fn rank(&self, role: ImageRole) -> i32 {
        let name = self.name.to_ascii_lowercase();
        let has = |words: &[&str]| i32::from(words.iter().any(|w| name.contains(w)));
        let raw = i32::from(self.type_name == IMAGE_TYPES[0]);
        match role {
            // The stream's name counts most, then the driver's own topic, then raw before compressed. An
            // infrared image comes last, and `best` rejects a topic that is nothing else.
            ImageRole::Color => {
                8 * has(&["color", "rgb"]) + 2 * has(&["image_raw", "image_rect"])
                    - 16 * has(&["infra", "/ir", "fisheye", "debug", "overlay"])
                    + raw
            }
            ImageRole::Depth => {
                // Drivers publish depth in the depth camera's frame beside the aligned one, but only the
                // aligned one fits the color.
                8 * has(&["aligned", "registered", "depth_to_color", "depth_to_rgb"])
                    + 2 * has(&["image_raw", "image_rect"])
                    + raw
            }
            ImageRole::Mask => 4 * has(&["object"]) + 2 * has(&["mask"]) + raw,
        }
    }
}

/// The topic without the suffix of an image transport.
fn base(topic: &str) -> &str {
    ["/compressedDepth", "/compressed"].iter().find_map(|s| topic.strip_suffix(s)).unwrap_or(topic)
}

/// The topic's name up to its last part.
fn parent(topic: &str) -> &str {
    topic.rsplit_once('/').map_or("", |(front, _)| front)
}

/// Chooses the topics of a recording. A requested topic is used or refused, never replaced.
///
/// # Errors
/// [`CaptureError::Unsupported`] for a video, [`CaptureError::NotRgbd`] without any image topic,
/// [`CaptureError::NoTopic`] without color, depth or
/// camera_info, [`CaptureError::BadTopic`] for a requested one without usable messages.
pub fn choose(
    topics: &[TopicSummary],
    wanted: &TopicConfig,
    path: &Path,
) -> Result<TopicChoice, CaptureError> {
    refuse_foreign(topics, wanted, path)?;
    let chooser = Chooser { topics, path };
    let asked = [&wanted.color, &wanted.depth, &wanted.mask];
    // One message about the recording, instead of one about a missing color topic.
    if asked.iter().all(|w| w.is_none()) && !topics.iter().any(|t| t.count > 0 && t.image_role().is_some()) {
        return Err(CaptureError::NotRgbd { path: path.to_owned(), topics: chooser.list(|_| true) });
    }
    let color = match chooser.asked("color", wanted.color.as_ref(), &IMAGE_TYPES)? {
        Some(topic) => topic,
        None => chooser.best(ImageRole::Color).ok_or_else(|| {
            chooser.missing(
                "color",
                "record the color images (realsense2_camera: /camera/camera/color/image_raw), or name them \
                 with `--topic color=TOPIC`",
            )
        })?,
    };
    let depth = match chooser.asked("depth", wanted.depth.as_ref(), &IMAGE_TYPES)? {
        Some(topic) => topic,
        None => chooser.best(ImageRole::Depth).ok_or_else(|| {
            chooser.missing(
                "depth",
                "record depth aligned to color (realsense2_camera: align_depth.enable:=true, \
                 /camera/camera/aligned_depth_to_color/image_raw), or name it with `--topic depth=TOPIC`",
            )
        })?,
    };
    let color_info = match chooser.asked("camera_info", wanted.color_info.as_ref(), &[INFO_TYPE])? {
        Some(topic) => topic,
        // First the one named like the images, then the only one.
        None => chooser
            .info_of(&color)
            .or_else(|| chooser.only_info(&color))
            .ok_or_else(|| chooser.missing_info(&color))?,
    };
    let depth_info = chooser
        .asked("depth camera_info", wanted.depth_info.as_ref(), &[INFO_TYPE])?
        .or_else(|| chooser.info_of(&depth));
    let mask =
        chooser.asked("mask", wanted.mask.as_ref(), &IMAGE_TYPES)?.or_else(|| chooser.best(ImageRole::Mask));
    let pose = chooser.asked("pose", wanted.pose.as_ref(), &POSE_TYPES)?;
    let marker = chooser.asked("marker", wanted.marker.as_ref(), &[])?;
    Ok(TopicChoice { color, depth, color_info, depth_info, mask, pose, marker })
}

struct Chooser<'a> {
    topics: &'a [TopicSummary],
    path: &'a Path,
}

impl Chooser<'_> {
    fn list(&self, keep: impl Fn(&TopicSummary) -> bool) -> String {
        let mut names: Vec<_> = self
            .topics
            .iter()
            .filter(|t| keep(t))
            .map(|t| format!("{} ({}, {})", t.name, t.type_name, t.count))
            .collect();
        if let Some(more) = names.len().checked_sub(NAMED).filter(|n| *n > 0) {
            names.truncate(NAMED);
            names.push(format!("and {more} more"));
        }
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }

    /// The requested topic, if any. Without types, any topic of std_msgs is accepted.
    fn asked(
        &self,
        role: &'static str,
        name: Option<&String>,
        types: &[&str],
    ) -> Result<Option<String>, CaptureError> {
        let Some(name) = name else { return Ok(None) };
        let problem = match self.topics.iter().find(|t| t.name == *name) {
            None => "is not in the recording".to_owned(),
            Some(t) if t.count == 0 => "has no message that could be decoded".to_owned(),
            Some(t)
                if types.contains(&t.type_name.as_str())
                    || (types.is_empty() && t.type_name.starts_with("std_msgs/")) =>
            {
                return Ok(Some(name.clone()));
            }
            Some(t) => format!(
                "is of type {}, not {}",
                t.type_name,
                if types.is_empty() { "std_msgs".into() } else { types.join(" or ") }
            ),
        };
        Err(CaptureError::BadTopic {
            role,
            topic: name.clone(),
            problem,
            available: self.list(|t| t.count > 0),
        })
    }

    /// The best topic of a role: by name, then by count, then the first by name.
    fn best(&self, role: ImageRole) -> Option<String> {
        let fits = self.topics.iter().filter(|t| t.count > 0 && t.image_role() == Some(role));
        let best = fits.min_by_key(|t| (-t.rank(role), usize::MAX - t.count, &t.name))?;
        // An infrared or debug image is no color image.
        (role != ImageRole::Color || best.rank(role) > -8).then(|| best.name.clone())
    }

    /// The camera_info beside an image topic.
    fn info_of(&self, image: &str) -> Option<String> {
        // camera_info is beside the raw image; transports put theirs below it.
        let name = format!("{}/camera_info", parent(base(image)));
        self.topics
            .iter()
            .find(|t| t.name == name && t.type_name == INFO_TYPE && t.count > 0)
            .map(|t| t.name.clone())
    }

    /// The only camera_info, unless it is beside the images of another topic.
    fn only_info(&self, color: &str) -> Option<String> {
        let mut infos = self.topics.iter().filter(|t| t.type_name == INFO_TYPE && t.count > 0);
        // Of two, either could be meant.
        let first = infos.next().filter(|_| infos.next().is_none())?;
        let others =
            self.topics.iter().filter(|t| t.name != color && IMAGE_TYPES.contains(&t.type_name.as_str()));
        let taken = others.filter_map(|t| self.info_of(&t.name)).any(|info| info == first.name);
        (!taken).then(|| first.name.clone())
    }

    fn missing(&self, role: &'static str, remedy: &str) -> CaptureError {
        let candidates = self.list(|t| t.image_role().is_some());
        CaptureError::NoTopic { role, path: self.path.to_owned(), candidates, remedy: remedy.to_owned() }
    }

    fn missing_info(&self, color: &str) -> CaptureError {
        let remedy =
            format!("record {}/camera_info, or name it with `--topic color_info=TOPIC`", parent(base(color)));
        CaptureError::NoTopic {
            role: "camera_info",
            path: self.path.to_owned(),
            candidates: self.list(|t| t.type_name == INFO_TYPE),
            remedy,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(name: &str, kind: &str, encoding: &str) -> TopicSummary {
        let type_name = if kind.contains('/') { kind.to_owned() } else { format!("sensor_msgs/msg/{kind}") };
        TopicSummary { name: name.into(), type_name, count: 30, encoding: encoding.into() }
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
            topic(
                "/camera/camera/color/image_raw/compressed",
                "CompressedImage",
                "rgb8; jpeg compressed bgr8",
            ),
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
}
