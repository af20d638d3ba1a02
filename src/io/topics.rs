//! Chooses the topics of color, depth, camera_info, mask and pose: by type, encoding and name, or as
//! requested.

use std::path::Path;

use super::{
    foreign_topics::refuse_foreign, image_codec::MASK_ENCODINGS, pose_topic::POSE_TYPES,
    synchronize::MOST_FREE_RUNNING_NANOS,
};
use capture::{CaptureError, TopicConfig, pair};
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
    /// Frame of an image topic.
    pub frame: String,
    /// Columns and rows of an image topic, if known.
    pub size: Option<(usize, usize)>,
    /// Stamps of an image topic, nanoseconds; empty where they are not known.
    pub stamps: Vec<i64>,
    /// Whether transforms say that the frame of an image topic moves.
    pub moves: bool,
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
    /// Image topics that could have been chosen and were not.
    pub others: Vec<String>,
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

/// Types of image messages.
pub const IMAGE_TYPES: [&str; 2] = ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"];
/// Type of camera parameters.
pub const INFO_TYPE: &str = "sensor_msgs/msg/CameraInfo";

impl TopicSummary {
    /// Whether the topic may have a role unasked: an infrared or debug image is no color image.
    fn is_candidate(&self, role: ImageRole) -> bool {
        self.image_role() == Some(role) && (role != ImageRole::Color || self.rank(role) > -8)
    }

    /// Whether the images are masks of those of another topic: of their size and times.
    fn masks(&self, color: &Self) -> bool {
        self.image_role() == Some(ImageRole::Mask)
            && (self.size.is_none() || color.size.is_none() || self.size == color.size)
            && (self.stamps.is_empty() || paired_share(&color.stamps, &self.stamps) >= LEAST_MASKED)
    }

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
        let has_color = encoding.contains("jpeg") || !self.may_be_mask();
        let depth_encoding =
            ["16UC1", "16SC1", "32FC1", "64FC1", "mono16"].iter().any(|e| encoding.starts_with(e))
                || encoding.contains("compressedDepth");
        match () {
            // A picture of masks, drawn over the image or in colors, is none of the camera's images.
            () if named_mask && has_color => None,
            () if named_mask => Some(ImageRole::Mask),
            () if depth_encoding || (name.contains("depth") && self.may_be_mask()) => Some(ImageRole::Depth),
            // Depth in colors.
            () if name.contains("depth") => None,
            () => Some(ImageRole::Color),
        }
    }

    /// Whether the encoding has one channel, or does not tell.
    fn may_be_mask(&self) -> bool {
        let encoding = self.encoding.to_ascii_lowercase();
        let is_raw = self.type_name == IMAGE_TYPES[0];
        match is_raw {
            true => encoding.is_empty() || MASK_ENCODINGS.contains(&encoding.as_str()),
            // Before `;` the encoding of the image, if the format has both.
            false => match encoding.split_once(';') {
                Some((raw, _)) => MASK_ENCODINGS.contains(&raw.trim()),
                None => true,
            },
        }
    }

    /// How well the name fits a role; higher is better.
    fn rank(&self, role: ImageRole) -> i32 {
        let name = self.name.to_ascii_lowercase();
        let has = |words: &[&str]| i32::from(words.iter().any(|w| name.contains(w)));
        let raw = i32::from(self.type_name == IMAGE_TYPES[0]);
        match role {
            // The stream's name counts most, then the driver's own topic, then raw before compressed. An
            // infrared image comes last, and `is_candidate` rejects a topic that is nothing else.
            ImageRole::Color => {
                8 * has(&["color", "rgb"]) + 2 * has(&["image_raw", "image_rect"])
                    - 16 * has(&["infra", "/ir", "fisheye", "debug", "overlay"])
                    - 8 * has(&DRAWN)
                    + raw
            }
            ImageRole::Depth => {
                // Drivers publish depth in the depth camera's frame beside the aligned one, but only the
                // aligned one fits the color.
                8 * i32::from(is_aligned_by_name(&self.name)) + 2 * has(&["image_raw", "image_rect"]) + raw
            }
            ImageRole::Mask => 4 * has(&["object"]) + 2 * has(&["mask"]) + raw,
        }
    }
}

/// Words in the names of images that other nodes make of the camera's.
const DRAWN: [&str; 12] = [
    "annotat", "detect", "result", "preview", "visual", "track", "heatmap", "segment", "mask", "label",
    "output", "marked",
];

/// Whether a topic is named as depth that was brought to the pixels of color.
pub fn is_aligned_by_name(topic: &str) -> bool {
    let name = topic.to_ascii_lowercase();
    ["aligned", "registered", "depth_to_color", "depth_to_rgb"].iter().any(|w| name.contains(w))
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
/// [`CaptureError::NoTopic`] without color, depth or camera_info, [`CaptureError::BadTopic`] for a requested
/// one without usable messages.
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
    let asked_color = chooser.asked("color", wanted.color.as_ref(), &IMAGE_TYPES)?;
    let asked_depth = chooser.asked("depth", wanted.depth.as_ref(), &IMAGE_TYPES)?;
    let colors = chooser.candidates(ImageRole::Color, asked_color.as_deref());
    let depths = chooser.candidates(ImageRole::Depth, asked_depth.as_deref());
    let Some([color, depth]) = chooser.one_camera(&colors, &depths) else {
        return Err(chooser.missing_image(colors.is_empty()));
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
        .or_else(|| chooser.info_of(&depth))
        // The info of color stands beside depth where both have one namespace.
        .filter(|info| wanted.depth_info.is_some() || *info != color_info);
    let mask = chooser.asked("mask", wanted.mask.as_ref(), &IMAGE_TYPES)?.or_else(|| chooser.mask_of(&color));
    let pose = chooser.asked("pose", wanted.pose.as_ref(), &POSE_TYPES)?;
    let marker = chooser.asked("marker", wanted.marker.as_ref(), &[])?;
    let others = chooser.others([&color, &depth], mask.as_ref());
    Ok(TopicChoice { color, depth, color_info, depth_info, mask, pose, marker, others })
}

/// Least share of the color images that have a mask of the same camera. chosen: a majority
const LEAST_MASKED: f64 = 0.5;

/// Number of parts at the beginning of two names that are the same.
fn shared_parts(a: &str, b: &str) -> usize {
    let parts = |name: &str| -> Vec<String> { base(name).split('/').map(str::to_owned).collect() };
    // The empty part before the first slash is no evidence.
    parts(a).iter().zip(&parts(b)).skip(1).take_while(|(a, b)| a == b).count()
}

/// Share of the stamps of the side with fewer that have a partner on the other side; 1 where one is unknown.
fn paired_share(a: &[i64], b: &[i64]) -> f64 {
    let fewer = a.len().min(b.len());
    if fewer == 0 {
        return 1.0;
    }
    pair(a, b, MOST_FREE_RUNNING_NANOS).iter().flatten().count() as f64 / fewer as f64
}

/// The first of some names, and how many more there are.
fn first_names(mut names: Vec<String>) -> Vec<String> {
    if let Some(more) = names.len().checked_sub(NAMED).filter(|n| *n > 0) {
        names.truncate(NAMED);
        names.push(format!("and {more} more"));
    }
    names
}

struct Chooser<'a> {
    topics: &'a [TopicSummary],
    path: &'a Path,
}

impl Chooser<'_> {
    fn list(&self, keep: impl Fn(&TopicSummary) -> bool) -> String {
        let kept = self.topics.iter().filter(|t| keep(t));
        let names = kept.map(|t| format!("{} ({}, {})", t.name, t.type_name, t.count)).collect();
        let names = first_names(names).join(", ");
        if names.is_empty() { "none".into() } else { names }
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

    /// Color and depth of one camera: of all pairs the one that most speaks for, by names, frames, stamps,
    /// sizes and camera_infos together.
    fn one_camera(&self, colors: &[&TopicSummary], depths: &[&TopicSummary]) -> Option<[String; 2]> {
        let mut best: Option<(f64, [&TopicSummary; 2])> = None;
        for &c in colors {
            for &d in depths {
                let score = self.pair_score(c, d);
                // Of equals the first by name, as topics are sorted.
                if best.is_none_or(|(most, _)| score > most) {
                    best = Some((score, [c, d]));
                }
            }
        }
        best.map(|(_, pair)| pair.map(|t| t.name.clone()))
    }

    /// The topic that was asked for, or all topics of a role.
    fn candidates(&self, role: ImageRole, asked: Option<&str>) -> Vec<&TopicSummary> {
        let with_messages = self.topics.iter().filter(|t| t.count > 0);
        match asked {
            Some(name) => with_messages.filter(|t| t.name == name).collect(),
            None => with_messages.filter(|t| t.is_candidate(role)).collect(),
        }
    }

    /// How much speaks for two topics as color and depth of one camera.
    fn pair_score(&self, color: &TopicSummary, depth: &TopicSummary) -> f64 {
        let score = |holds: bool, weight: f64| if holds { weight } else { 0.0 };
        let names = f64::from(color.rank(ImageRole::Color) + depth.rank(ImageRole::Depth));
        let own_info = self.info_of(&color.name).is_some();
        let one_frame = !color.frame.is_empty() && color.frame == depth.frame;
        let one_size = color.size.is_some() && color.size == depth.size;
        let shared = shared_parts(&color.name, &depth.name) as f64;
        // More images break ties.
        let count = 0.5 * (color.count.min(depth.count) as f64)
            / (color.count.max(depth.count).max(1) as f64)
            + 1e-6 * color.count as f64;
        names
            + score(own_info, 16.0)
            + score(one_frame, 8.0)
            + score(one_size, 4.0)
            + 6.0 * shared
            + 24.0 * paired_share(&color.stamps, &depth.stamps)
            + score(color.moves, 8.0)
            + count
    }

    /// The masks of the images of a topic: named so, of their size, and of their times.
    fn mask_of(&self, color: &str) -> Option<String> {
        let color = self.topics.iter().find(|t| t.name == color)?;
        let masks = self.topics.iter().filter(|t| t.count > 0 && t.masks(color));
        let best = masks.min_by_key(|t| {
            let near = shared_parts(&color.name, &t.name) as i32;
            (-t.rank(ImageRole::Mask) - 2 * near, usize::MAX - t.count, t.name.clone())
        });
        best.map(|t| t.name.clone())
    }

    /// The image topics that are not used, at most as many as are named in messages.
    fn others(&self, [color, depth]: [&String; 2], mask: Option<&String>) -> Vec<String> {
        let used: Vec<&str> =
            [Some(color), Some(depth), mask].into_iter().flatten().map(|u| base(u)).collect();
        let images =
            self.topics.iter().filter(|t| t.count > 0 && IMAGE_TYPES.contains(&t.type_name.as_str()));
        let others = images.filter(|t| !used.contains(&base(&t.name)));
        first_names(others.map(|t| t.name.clone()).collect())
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

    /// The error of a recording without a topic of color, or else of depth.
    fn missing_image(&self, is_color: bool) -> CaptureError {
        let (role, remedy) = match is_color {
            true => (
                "color",
                "record the color images (realsense2_camera: /camera/camera/color/image_raw), or name them \
                 with `--topic color=TOPIC`",
            ),
            false => (
                "depth",
                "record depth (realsense2_camera: enable_depth:=true, /camera/camera/depth/image_rect_raw \
                 with its camera_info and /tf_static), or name it with `--topic depth=TOPIC`",
            ),
        };
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
#[path = "topics_tests.rs"]
mod tests;
