//! Why a recording cannot be used.

use std::path::{Path, PathBuf};

use common::stop::Stopped;

/// A fault, its place, and its remedy.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// Nothing is wrong: it was asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The file or folder cannot be read.
    #[error("cannot read `{}`: {source}", path.display())]
    Read {
        /// The file to read.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
    /// Nothing is at the path.
    #[error(
        "cannot read `{}`: No such file or folder; check the path, which must lead to a rosbag2 folder, \
         an .mcap file or a dataset folder", path.display()
    )]
    Missing {
        /// The given value.
        path: PathBuf,
    },
    /// Neither a bag nor a dataset.
    #[error(
        "`{}` is not a recording: {reason}; give a rosbag2 folder, an .mcap file, a folder that holds \
         `state0` and `state1` (and `state2`, ...), or a dataset folder", path.display()
    )]
    NotARecording {
        /// The given value.
        path: PathBuf,
        /// The found value.
        reason: String,
    },
    /// A bag in sqlite3 storage.
    #[error(
        "`{}` is an sqlite3 (.db3) bag; convert it first: `rosbags-convert --src {} --dst {} --dst-storage \
         mcap` (pip install rosbags), or `ros2 bag convert -i {} -o convert.yaml` with this line in \
         convert.yaml: `output_bags: [{{uri: {}, storage_id: mcap, all: true}}]`",
        path.display(), quoted(path), quoted(&converted(path)), quoted(path), quoted(&converted(path))
    )]
    Sqlite {
        /// The bag.
        path: PathBuf,
    },
    /// The bag's metadata.yaml cannot be trusted.
    #[error("`{}`: {reason}", path.display())]
    Metadata {
        /// The metadata file.
        path: PathBuf,
        /// Its fault, and the remedy.
        reason: String,
    },
    /// Nothing could be read from a file.
    #[error("`{}` is damaged and nothing in it could be read: {reason}; record again or copy the file \
             again", path.display())]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// The first fault.
        reason: String,
    },
    /// A known format without support.
    #[error("{what} is not supported; {remedy}")]
    Unsupported {
        /// The feature, with its place.
        what: String,
        /// The remedy.
        remedy: String,
    },
    /// A bag without any image topic.
    #[error(
        "`{}` is not an RGB-D recording: it has no image topics at all (it has {topics}); record color, \
         aligned depth, camera_info and /tf", path.display()
    )]
    NotRgbd {
        /// The bag.
        path: PathBuf,
        /// Its contents instead.
        topics: String,
    },
    /// A needed topic is missing.
    #[error("no {role} topic in `{}` (candidates looked at: {candidates}); {remedy}", path.display())]
    NoTopic {
        /// `color`, `depth` or `camera_info`.
        role: &'static str,
        /// The bag.
        path: PathBuf,
        /// The existing ones.
        candidates: String,
        /// The remedy.
        remedy: String,
    },
    /// A requested topic is missing or has the wrong type.
    #[error("the {role} topic `{topic}` that was asked for {problem}; topics with messages: {available}")]
    BadTopic {
        /// Its role.
        role: &'static str,
        /// Its name.
        topic: String,
        /// `is not in the bag` or its fault.
        problem: String,
        /// The existing ones.
        available: String,
    },
    /// No transform at a stamp.
    #[error("no transform from `{source_frame}` to `{target}` at {stamp_secs:.6} s: {reason}")]
    NoTransform {
        /// Target frame of the pose.
        target: String,
        /// Frame of the wanted pose.
        source_frame: String,
        /// When.
        stamp_secs: f64,
        /// The missing part.
        reason: String,
    },
    /// Not one frame has a camera pose.
    #[error(
        "state {state}: none of {frames} frames has a camera pose (first: {first}); record /tf and \
         /tf_static from before the first to after the last image, or name a pose topic with `--topic \
         pose=TOPIC`"
    )]
    NoPoses {
        /// The state.
        state: usize,
        /// Number of frames.
        frames: usize,
        /// Why the first one has none.
        first: String,
    },
    /// The camera cannot be tracked.
    #[error(
        "state {state}: the recording holds no camera poses, and the camera cannot be tracked through its \
         {views} views, of which no two hang together: {why}; or record camera poses (/tf)"
    )]
    NotTracked {
        /// The state.
        state: usize,
        /// Number of views.
        views: usize,
        /// Reason for most of them, and its remedy.
        why: &'static str,
    },
    /// The states have no common world.
    #[error(
        "state {state} cannot be brought into the world of state 0: {reason}; keep in view what stands \
         still, or record camera poses of both states in one frame"
    )]
    StatesUnaligned {
        /// The state.
        state: usize,
        /// Why.
        reason: String,
    },
    /// Every pose is NaN or no rotation.
    #[error(
        "all {count} camera poses on `{topic}` are invalid (NaN, infinite or no unit quaternion); check the \
         odometry or robot driver"
    )]
    InvalidPoses {
        /// Where they came from.
        topic: String,
        /// How many there are.
        count: usize,
    },
    /// The chain of frames holds no motion.
    #[error(
        "the pose of `{frame}` comes from static transforms alone (root `{root}`): the recording holds no \
         camera motion; record odometry or the robot's /tf, name a pose topic with `--topic pose=TOPIC`, or \
         give `--set capture.world_frame={root}` if the camera did stand still"
    )]
    StaticCamera {
        /// The optical frame.
        frame: String,
        /// Where its chain ends.
        root: String,
    },
    /// Only one state was given.
    #[error(
        "`{}` holds one recording, but two states are needed; give two bags, a folder with `state0` and \
         `state1`, or say where the states part (`--split SECONDS` or a marker topic)", path.display()
    )]
    OneState {
        /// The given value.
        path: PathBuf,
    },
    /// More states than a run takes.
    #[error("{count} states, {limit} at most; give the paths of those that show the joints farthest apart")]
    TooManyStates {
        /// Number of states.
        count: usize,
        /// The largest accepted number.
        limit: usize,
    },
    /// The states cannot be separated at the place given.
    #[error("cannot split the recording into two states: {reason}")]
    Split {
        /// The fault, and the remedy.
        reason: String,
    },
    /// An unusable image encoding.
    #[error("{topic}: encoding `{encoding}` is not supported; {supported}")]
    Encoding {
        /// Where.
        topic: String,
        /// The encoding by its name.
        encoding: String,
        /// Supported ones.
        supported: &'static str,
    },
    /// Images change their size or differ from their camera_info.
    #[error(
        "{topic}: image of {width}x{height} at {stamp_secs:.6} s, but {expected} say \
         {expected_width}x{expected_height}; all images of a recording must have one size: record again with \
         a fixed profile"
    )]
    ImageSize {
        /// Where.
        topic: String,
        /// The found value.
        width: usize,
        /// The found value.
        height: usize,
        /// When.
        stamp_secs: f64,
        /// The contradicting source: `earlier images`, `camera_info`.
        expected: &'static str,
        /// The expected value.
        expected_width: usize,
        /// The expected value.
        expected_height: usize,
    },
    /// Depth is not aligned to color.
    #[error(
        "depth `{depth}` is not aligned to color `{color}`: {reason}; record the aligned depth \
         (realsense2_camera: `align_depth.enable:=true`, topic aligned_depth_to_color/image_raw; others: \
         depth_image_proc register)"
    )]
    NotAligned {
        /// Depth topic.
        depth: String,
        /// Color topic.
        color: String,
        /// Their difference.
        reason: String,
    },
    /// Lens model without an inverse.
    #[error(
        "{topic}: distortion model `{model}` {problem}; supported: plumb_bob (4 or 5 values) and \
         rational_polynomial (8), or rectify the images first"
    )]
    Distortion {
        /// Where.
        topic: String,
        /// Its name.
        model: String,
        /// Its fault.
        problem: String,
    },
    /// Camera parameters of no pinhole camera.
    #[error("{topic}: camera_info is unusable: {reason}; calibrate the camera or fix its driver")]
    CameraInfo {
        /// Where.
        topic: String,
        /// The fault.
        reason: String,
    },
    /// A state without frames.
    #[error("state {state} has no usable frame: {reason}")]
    NoFrames {
        /// The state.
        state: usize,
        /// Their fate.
        reason: String,
    },
    /// No depth at all.
    #[error(
        "state {state}: all depth is invalid (no reading between {min_m} and {max_m} m in {frames} frames); \
         check the depth topic's unit (16UC1 is millimeters, 32FC1 meters) and the range (`--set \
         capture.depth_max_m=METERS`)"
    )]
    NoDepth {
        /// The state.
        state: usize,
        /// Number of frames.
        frames: usize,
        /// Depth range.
        min_m: f64,
        /// Depth range.
        max_m: f64,
    },
    /// The states were recorded in different world frames.
    #[error(
        "state 0 is in world frame `{world0}` and state {state} in `{world1}`; all states need one fixed \
         frame: name one that all recordings hold with `--set capture.world_frame=FRAME`"
    )]
    WorldFrames {
        /// Root frame of state 0.
        world0: String,
        /// The state in another frame.
        state: usize,
        /// Its root frame.
        world1: String,
    },
    /// A dataset folder in breach of its format.
    #[error("dataset file `{}`: {reason}", path.display())]
    Dataset {
        /// The file.
        path: PathBuf,
        /// The fault, and the remedy.
        reason: String,
    },
    /// The object cannot be separated from its surroundings.
    #[error(
        "cannot isolate the object: {reason}; give masks, a place on the object with \
         `--at`, or a box around it with `--workspace`"
    )]
    Isolation {
        /// The missing part.
        reason: String,
    },
    /// Things apart from each other changed about as much.
    #[error(
        "{} things changed between the states, about ({}) m; record again with nothing moved but the object, \
         or say which is the object with `--at X,Y,Z`",
        at.len(),
        at.iter().map(|p| p.map(|x| format!("{x:.2}")).join(", ")).collect::<Vec<_>>().join(") m, (")
    )]
    SeveralChanged {
        /// Their middles in the world, meters.
        at: Vec<[f64; 3]>,
    },
    /// One recording was given for two states.
    #[error(
        "states {first} and {second} hold the same images: one recording was given twice; give the recording \
         that was made after the joints were moved"
    )]
    SameRecording {
        /// A state.
        first: usize,
        /// The state with the repetition.
        second: usize,
    },
    /// The states lie in different places.
    #[error(
        "states 0 and {state} have no place in common: only {share_percent:.1} % of the object's points in \
         one state lie near those of the other; the static part must stand still in the world frame: check \
         the camera poses of both recordings"
    )]
    NoOverlap {
        /// The state apart from state 0.
        state: usize,
        /// Points in common.
        share_percent: f64,
    },
    /// The frames would take more memory than they may.
    #[error(
        "{frames} frames of {width}x{height} pixels take {needed_gib:.1} GiB, more than capture.memory_gib = \
         {limit_gib}; keep fewer with `--set capture.frames_per_state={fitting}`, record smaller images, or \
         allow more with `--set capture.memory_gib=GIB`"
    )]
    Memory {
        /// Of all states.
        frames: usize,
        /// Columns of the largest.
        width: usize,
        /// Rows of the largest.
        height: usize,
        /// Their memory.
        needed_gib: f64,
        /// Their limit.
        limit_gib: f64,
        /// Number of frames of a state within it.
        fitting: usize,
    },
    /// An unusable setting.
    #[error("setting `{key}`: {reason}")]
    Setting {
        /// Its key.
        key: &'static str,
        /// Its fault.
        reason: String,
    },
}

/// Where a bag in another storage is converted to.
fn converted(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or(path.as_os_str()).to_owned();
    name.push("_mcap");
    path.with_file_name(name)
}

/// A path as a word of a shell and as a string of YAML: bare where nothing in it means more, else in single
/// quotes. (One with a single quote in it needs another form in each; it is written for the shell.)
#[must_use]
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    // A path with a hyphen in front would be read as an option.
    let plain = text.chars().all(|c| c.is_alphanumeric() || "/._-+".contains(c))
        && !text.starts_with('-')
        && !text.is_empty();
    if plain { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Header stamp in seconds, for messages.
#[must_use]
pub fn stamp_secs(stamp_nanos: i64) -> f64 {
    stamp_nanos as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_take_any_path() {
        let message = |path: &str| CaptureError::Sqlite { path: path.into() }.to_string();
        assert!(
            message("a/run_0.db3")
                .contains("`rosbags-convert --src a/run_0.db3 --dst a/run_0_mcap --dst-storage mcap`")
        );
        assert!(message("a/run").contains("`ros2 bag convert -i a/run -o convert.yaml`"));
        assert!(message("a/run").contains("`output_bags: [{uri: a/run_mcap, storage_id: mcap, all: true}]`"));
        assert!(message("my run; rm x").contains("--src 'my run; rm x' --dst 'my run; rm x_mcap' "));
        assert!(message("it's").contains("-i 'it'\\''s' "));
    }
}
