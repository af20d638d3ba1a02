//! Settings for reading a recording into frames.

use serde::{Deserialize, Serialize};

use super::{CaptureError, NoiseConfig, RefinePoses, TrackCamera, UseBoard, UseColorDepth};
use common::limits::BYTES_PER_PIXEL;

/// Memory that images of all states may take, GiB.
/// chosen: 40 frames of 4K in each of two states take 7.4 GiB, which leaves as much of 16 GiB for the rest
const MEMORY_GIB: f64 = 8.0;
/// Larger delays are refused. chosen: far beyond the delay of any clock; such poses are from another take
const MAX_POSE_DELAY_SECS: f64 = 10.0;

/// How recordings are read. A value of `None` is determined from the recording and reported in
/// [`super::Capture::notes`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CaptureConfig {
    /// Topic names.
    pub topics: TopicConfig,
    /// World frame of the twin; default: the root of the camera's transform chain.
    pub world_frame: Option<String>,
    /// Frame described by the poses of a PoseStamped topic; default: the optical frame of the color images.
    pub pose_frame: Option<String>,
    /// Largest difference of stamps between color and depth or mask, seconds.
    pub sync_slop_secs: f64,
    /// Transforms are interpolated only between samples at most this far apart, seconds.
    pub tf_max_gap_secs: f64,
    /// Delay of the camera poses against the images, seconds: the pose of an image is read at its stamp plus
    /// this delay.
    pub pose_delay_secs: f64,
    /// Number of frames kept per state; those with the most different views are chosen.
    pub frames_per_state: usize,
    /// Most memory for the pixels of all kept frames together, GiB.
    pub memory_gib: f64,
    /// Where one bag is split into states: `[t]`, or `[t0, t1]` to leave out the time between. Seconds from
    /// the bag's start, or since the epoch if greater than 1e8; the recording time of the messages counts.
    pub split_secs: Vec<f64>,
    /// Length of a unit of depth images in whole numbers (16UC1), meters: 0.0001 of a D405, 0.00025 of an
    /// L515, 0.0002 of TUM's recordings; default: 0.001, or what the lengths of recorded poses tell.
    pub depth_unit_m: Option<f64>,
    /// Depth readings nearer than this are not used, meters.
    pub depth_min_m: f64,
    /// Depth readings further than this are not used, meters.
    pub depth_max_m: f64,
    /// How the object is separated from its surroundings.
    pub isolate: IsolateConfig,
    /// Expected depth noise.
    pub noise: NoiseConfig,
    /// Whether the noise model is scaled to the noise measured in the recording.
    pub measure_noise: bool,
    /// Whether the object's depth is smoothed by local planes, where they explain it.
    pub denoise: bool,
    /// Whether missing depth on the object is filled by multi-view stereo from color, in recordings with
    /// masks: `auto` (where holes are wider than shadows and depth edges cause), `always`, or `never`.
    pub color_depth: UseColorDepth,
    /// Whether the camera is tracked by its images: `auto` (where the recording holds no camera poses),
    /// `always`, or `never`.
    pub tracking: TrackCamera,
    /// Whether a printed tag board (`artitwin board`) sets the world frame and the scale of tracked cameras:
    /// `auto` (where one is seen), or `never`.
    pub board: UseBoard,
    /// Whether the camera poses are corrected by surfaces seen in several frames: `auto` (where frames then
    /// agree clearly better), or `never`.
    pub refine_poses: RefinePoses,
}

/// Topic names; topics without a name here are found by type and name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TopicConfig {
    /// Color images (Image or CompressedImage).
    pub color: Option<String>,
    /// Depth images aligned to color (Image or CompressedImage).
    pub depth: Option<String>,
    /// CameraInfo of the color images.
    pub color_info: Option<String>,
    /// CameraInfo of the depth images.
    pub depth_info: Option<String>,
    /// Object masks (Image or CompressedImage; nonzero = object).
    pub mask: Option<String>,
    /// Camera poses (PoseStamped or Odometry) in place of /tf.
    pub pose: Option<String>,
    /// Topic (std_msgs) with a message between the states of one bag.
    pub marker: Option<String>,
}

/// How the object is separated from its surroundings where there are no masks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IsolateConfig {
    /// Whether the recording's masks are used.
    pub use_masks: bool,
    /// Box around the object: lower and upper corner in the world frame, meters.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// A point on the object; the thing at this point is the object, whether it changed or not.
    pub at: Option<At>,
}

/// A point on the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum At {
    /// A point in the world frame, meters.
    Point([f64; 3]),
    /// A pixel of a kept frame.
    Pixel {
        /// Name of the frame as in reports: `<state>_<index>`.
        frame: String,
        /// Column and row.
        pixel: [usize; 2],
    },
}

impl Default for CaptureConfig {
    fn default() -> Self {
        Self {
            topics: TopicConfig::default(),
            world_frame: None,
            pose_frame: None,
            sync_slop_secs: 0.015,
            tf_max_gap_secs: 0.5,
            pose_delay_secs: 0.0,
            frames_per_state: 40,
            memory_gib: MEMORY_GIB,
            split_secs: Vec::new(),
            depth_unit_m: None,
            depth_min_m: 0.1,
            depth_max_m: 6.0,
            isolate: IsolateConfig::default(),
            noise: NoiseConfig::default(),
            measure_noise: true,
            denoise: true,
            color_depth: UseColorDepth::Auto,
            tracking: TrackCamera::Auto,
            board: UseBoard::Auto,
            refine_poses: RefinePoses::Auto,
        }
    }
}

impl Default for IsolateConfig {
    fn default() -> Self {
        Self { use_masks: true, workspace: None, at: None }
    }
}

impl CaptureConfig {
    /// Refuses frames that take more memory than allowed. Each entry gives a number of frames and their width
    /// and height in pixels.
    ///
    /// # Errors
    /// [`CaptureError::Memory`].
    pub fn check_memory(&self, frames: &[(usize, usize, usize)]) -> Result<(), CaptureError> {
        let mut needed_bytes = 0.0;
        for &(count, width, height) in frames {
            needed_bytes += count as f64 * width as f64 * height as f64 * BYTES_PER_PIXEL as f64;
        }
        let needed_gib = needed_bytes / f64::from(1 << 30);
        if needed_gib <= self.memory_gib {
            return Ok(());
        }
        let (width, height) =
            frames.iter().map(|f| (f.1, f.2)).max_by_key(|(w, h)| w * h).unwrap_or_default();
        let most = frames.iter().map(|f| f.0).max().unwrap_or(0);
        Err(CaptureError::Memory {
            frames: frames.iter().map(|f| f.0).sum(),
            width,
            height,
            needed_gib,
            limit_gib: self.memory_gib,
            fitting: (self.memory_gib / needed_gib * most as f64) as usize,
        })
    }

    /// The settings without what is done to an object's depth once the object is isolated.
    #[must_use]
    pub fn until_isolated(&self) -> Self {
        Self { denoise: false, color_depth: UseColorDepth::Never, ..self.clone() }
    }

    /// Whether the settings name poses, which nothing then replaces.
    #[must_use]
    pub fn asks_for_poses(&self) -> bool {
        self.world_frame.is_some() || self.pose_frame.is_some() || self.topics.pose.is_some()
    }

    /// Refuses settings with unusable values.
    ///
    /// # Errors
    /// [`CaptureError::Setting`] with the key of the setting.
    pub fn check(&self) -> Result<(), CaptureError> {
        let refuse = |key, reason: &str| Err(CaptureError::Setting { key, reason: reason.to_owned() });
        let positive = |v: f64| v.is_finite() && v > 0.0;
        // Written as the negation of what must hold, so that NaN is refused as well.
        if !(positive(self.depth_max_m) && self.depth_min_m >= 0.0 && self.depth_min_m < self.depth_max_m) {
            return refuse(
                "capture.depth_min_m",
                "the depth range must satisfy 0 <= depth_min_m < depth_max_m",
            );
        }
        if self.depth_unit_m.is_some_and(|unit| !positive(unit)) {
            return refuse("capture.depth_unit_m", "must be positive");
        }
        if self.frames_per_state == 0 {
            return refuse("capture.frames_per_state", "at least one frame per state is needed");
        }
        if !positive(self.memory_gib) {
            return refuse("capture.memory_gib", "must be positive");
        }
        if !(self.sync_slop_secs >= 0.0 && self.sync_slop_secs.is_finite()) {
            return refuse("capture.sync_slop_secs", "must be zero or more");
        }
        if !positive(self.tf_max_gap_secs) {
            return refuse("capture.tf_max_gap_secs", "must be positive");
        }
        if !(self.pose_delay_secs.abs() <= MAX_POSE_DELAY_SECS) {
            return refuse("capture.pose_delay_secs", "must be at most 10 s either way");
        }
        let sorted = self.split_secs.windows(2).all(|w| w[0] < w[1]);
        if self.split_secs.len() > 2 || !sorted || self.split_secs.iter().any(|t| !positive(*t)) {
            return refuse("capture.split_secs", "give one time, or two rising times, in positive seconds");
        }
        if !self.split_secs.is_empty() && self.topics.marker.is_some() {
            return refuse("capture.split_secs", "give either a split time or a marker topic, not both");
        }
        if let Some([lower, upper]) = self.isolate.workspace
            && !(0..3).all(|k| lower[k].is_finite() && upper[k].is_finite() && lower[k] < upper[k])
        {
            return refuse(
                "capture.isolate.workspace",
                "the lower corner must lie below the upper one along x, y and z",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_usable_and_nonsense_is_refused_by_key() {
        CaptureConfig::default().check().unwrap();
        let key = |change: fn(&mut CaptureConfig)| {
            let mut config = CaptureConfig::default();
            change(&mut config);
            match config.check() {
                Err(CaptureError::Setting { key, .. }) => key,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(key(|c| c.depth_max_m = f64::NAN), "capture.depth_min_m");
        assert_eq!(key(|c| c.frames_per_state = 0), "capture.frames_per_state");
        assert_eq!(key(|c| c.memory_gib = f64::NAN), "capture.memory_gib");
        assert_eq!(key(|c| c.split_secs = vec![2.0, 1.0]), "capture.split_secs");
        assert_eq!(
            key(|c| c.isolate.workspace = Some([[0.0; 3], [1.0, 0.0, 1.0]])),
            "capture.isolate.workspace"
        );
    }

    #[test]
    fn frames_of_4k_fit_and_those_of_a_bomb_do_not() {
        let config = CaptureConfig::default();
        config.check_memory(&[(40, 3840, 2160); 2]).unwrap();
        config.check_memory(&[(40, 1280, 720); 16]).unwrap();
        config.check_memory(&[]).unwrap();
        let error = config.check_memory(&[(16, 8192, 8192); 2]).unwrap_err().to_string();
        for words in
            ["32 frames of 8192x8192", "24.0 GiB", "capture.memory_gib = 8", "capture.frames_per_state=5"]
        {
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn unknown_keys_are_refused() {
        assert!(serde_json::from_str::<CaptureConfig>(r#"{"sync_slop": 1}"#).is_err());
        let c: CaptureConfig =
            serde_json::from_str(r#"{"topics": {"depth": "/d"}, "frames_per_state": 5}"#).unwrap();
        assert_eq!((c.topics.depth.as_deref(), c.frames_per_state), (Some("/d"), 5));
    }
}
