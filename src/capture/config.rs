//! Settings of everything between a recording and its frames.

use serde::{Deserialize, Serialize};

use super::{CaptureError, NoiseConfig, RefinePoses, TrackCamera, UseBoard, UseColorDepth};
use common::limits::BYTES_PER_PIXEL;

/// Memory that images of all states may take, GiB.
/// chosen: 40 frames of 4K in each of two states take 7.4 GiB, and as much is left of 16 GiB for the rest.
const MEMORY_GIB: f64 = 8.0;
/// Older poses are those of another take. chosen: far beyond the delay of any clock
const MAX_POSE_DELAY_SECS: f64 = 10.0;

/// How recordings are read. `None` means: found from the recording, and reported in
/// [`super::Capture::notes`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CaptureConfig {
    /// Topic names.
    pub topics: TopicConfig,
    /// Frame of the twin; default: the root of the camera's transform chain.
    pub world_frame: Option<String>,
    /// Frame of the poses of a PoseStamped topic; default: the optical frame of the color images.
    pub pose_frame: Option<String>,
    /// Largest difference of stamps between color and depth or mask, seconds.
    pub sync_slop_secs: f64,
    /// Transforms further apart than this are not interpolated, seconds.
    pub tf_max_gap_secs: f64,
    /// By how much camera poses are older than images of the same stamp, seconds: a pose is read later by as
    /// much.
    pub pose_delay_secs: f64,
    /// Frames kept per state, chosen by the spread of their views.
    pub frames_per_state: usize,
    /// Most memory for the pixels of all kept frames together, GiB.
    pub memory_gib: f64,
    /// Where one bag is split into states: `[t]`, or `[t0, t1]` to leave out the time between. Seconds from
    /// the bag's start, or since the epoch where greater than 1e8; by the time messages were recorded.
    pub split_secs: Vec<f64>,
    /// Depth readings nearer than this are not used, meters.
    pub depth_min_m: f64,
    /// Depth readings further than this are not used, meters.
    pub depth_max_m: f64,
    /// How the object is separated from its surroundings.
    pub isolate: IsolateConfig,
    /// Expected depth noise.
    pub noise: NoiseConfig,
    /// Whether the noise model is scaled to the recording's own noise.
    pub measure_noise: bool,
    /// Whether the object's depth is replaced by local planes, where they explain it.
    pub denoise: bool,
    /// Whether the sensor's missing depth on the object is taken from color, in recordings with masks:
    /// `auto`, where holes are wider than shadows and edges make them, `always`, or `never`.
    pub color_depth: UseColorDepth,
    /// Whether the camera is tracked by its images: `auto`, where the recording holds no camera poses,
    /// `always`, or `never`.
    pub tracking: TrackCamera,
    /// Whether a printed board of tags (`artitwin board`) gives tracked cameras their world and length:
    /// `auto`, where one is seen, or `never`.
    pub board: UseBoard,
    /// Whether the camera poses of a state are corrected by the common surfaces of its frames: `auto`, where
    /// frames clearly agree better then, or `never`.
    pub refine_poses: RefinePoses,
}

/// Topic names in place of those found by type and name.
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
    /// A std_msgs topic with a message between the states of one bag.
    pub marker: Option<String>,
}

/// How the object is separated from its surroundings where there are no masks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IsolateConfig {
    /// Whether masks of the recording are used.
    pub use_masks: bool,
    /// Box around the object: lower and upper corner in the world frame, meters.
    pub workspace: Option<[[f64; 3]; 2]>,
    /// A place on the object: where given, the thing there is the object, changed or not.
    pub at: Option<At>,
    /// Whether the support plane is taken away inside a workspace too.
    pub plane_in_workspace: bool,
    /// Points closer to the support plane than this are part of it, meters.
    pub plane_clearance_m: f64,
    /// ... and those closer than this many standard deviations of the depth noise.
    pub plane_sigmas: f64,
    /// Parts of the object may be this far apart, meters; `None`: from the depth noise.
    pub link_distance_m: Option<f64>,
}

/// A place on the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum At {
    /// In the world, meters.
    Point([f64; 3]),
    /// In a kept frame.
    Pixel {
        /// Name of the frame, as reports have it: `<state>_<index>`.
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
        Self {
            use_masks: true,
            workspace: None,
            at: None,
            plane_in_workspace: true,
            plane_clearance_m: 0.002,
            plane_sigmas: 3.0,
            link_distance_m: None,
        }
    }
}

impl CaptureConfig {
    /// Refuses frames with pixels beyond the given memory: so many frames of so many columns and rows, of
    /// each state or recording.
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

    /// Refuses senseless settings.
    ///
    /// # Errors
    /// [`CaptureError::Setting`] with the key.
    pub fn check(&self) -> Result<(), CaptureError> {
        let refuse = |key, reason: &str| Err(CaptureError::Setting { key, reason: reason.to_owned() });
        let positive = |v: f64| v.is_finite() && v > 0.0;
        // Conditions are the required ones: NaN is refused as well.
        if !(positive(self.depth_max_m) && self.depth_min_m >= 0.0 && self.depth_min_m < self.depth_max_m) {
            return refuse(
                "capture.depth_min_m",
                "the depth range must satisfy 0 <= depth_min_m < depth_max_m",
            );
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
        if !(self.isolate.plane_clearance_m >= 0.0 && self.isolate.plane_sigmas >= 0.0) {
            return refuse("capture.isolate.plane_clearance_m", "clearance and sigmas must be zero or more");
        }
        if self.isolate.link_distance_m.is_some_and(|v| !positive(v)) {
            return refuse("capture.isolate.link_distance_m", "must be positive");
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
