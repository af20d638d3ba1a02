//! Why a recording cannot be used.

use std::path::{Path, PathBuf};

use common::stop::Stopped;

/// A recording that cannot be used: the message names the fault, its place and its remedy.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The run was asked to stop; nothing is wrong.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The file or folder cannot be read.
    #[error("cannot read `{}`: {source}", path.display())]
    Read {
        /// File that could not be read.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Nothing is at the path.
    #[error(
        "cannot read `{}`: No such file or folder; check the path, which must lead to a rosbag2 folder, \
         an .mcap or .bag file, or a folder of images", path.display()
    )]
    Missing {
        /// Path as given.
        path: PathBuf,
    },
    /// The path holds neither a bag nor a dataset.
    #[error(
        "`{}` is not a recording: {reason}; give a rosbag2 folder, an .mcap or .bag file, a folder of images \
         in one of the forms of docs/folders.md, or a folder that holds one of these for each state, named \
         `state0`, `state1`, ...", path.display()
    )]
    NotARecording {
        /// Path as given.
        path: PathBuf,
        /// Why it is no recording.
        reason: String,
    },
    /// The path holds no track of a point.
    #[error("`{}` gives no track: {reason}", path.display())]
    NotATrack {
        /// Path as given.
        path: PathBuf,
        /// Why it gives none.
        reason: String,
    },
    /// The bag is in sqlite3 storage, which is not read.
    #[error(
        "`{}` is an sqlite3 (.db3) bag; convert it first: `rosbags-convert --src {} --dst {} --dst-storage \
         mcap` (pip install rosbags), or `ros2 bag convert -i {} -o convert.yaml` with this line in \
         convert.yaml: `output_bags: [{{uri: {}, storage_id: mcap, all: true}}]`",
        path.display(), quoted(path), quoted(&converted(path)), quoted(path), quoted(&converted(path))
    )]
    Sqlite {
        /// Path of the bag.
        path: PathBuf,
    },
    /// The bag's metadata.yaml cannot be trusted.
    #[error("`{}`: {reason}", path.display())]
    Metadata {
        /// Path of the metadata file.
        path: PathBuf,
        /// The fault and its remedy.
        reason: String,
    },
    /// Nothing could be read from a file.
    #[error("`{}` is damaged and nothing in it could be read: {reason}; record again or copy the file \
             again", path.display())]
    Corrupt {
        /// Path of the file.
        path: PathBuf,
        /// The first fault found in it.
        reason: String,
    },
    /// A known format that is not supported.
    #[error("{what} is not supported; {remedy}")]
    Unsupported {
        /// The unsupported feature and its place.
        what: String,
        /// What to do instead.
        remedy: String,
    },
    /// The bag has no image topic.
    #[error(
        "`{}` is not an RGB-D recording: it has no image topics at all (it has {topics}); record color, \
         aligned depth, camera_info and /tf", path.display()
    )]
    NotRgbd {
        /// Path of the bag.
        path: PathBuf,
        /// Topics of the bag.
        topics: String,
    },
    /// A required topic is missing.
    #[error("no {role} topic in `{}` (candidates looked at: {candidates}); {remedy}", path.display())]
    NoTopic {
        /// Role of the missing topic: `color`, `depth` or `camera_info`.
        role: &'static str,
        /// Path of the bag.
        path: PathBuf,
        /// Topics of the bag that were considered.
        candidates: String,
        /// What to do about it.
        remedy: String,
    },
    /// A requested topic is missing or has the wrong type.
    #[error("the {role} topic `{topic}` that was asked for {problem}; topics with messages: {available}")]
    BadTopic {
        /// Role of the topic, such as `color`.
        role: &'static str,
        /// Topic name as requested.
        topic: String,
        /// `is not in the bag`, or why the topic cannot be used.
        problem: String,
        /// Topics of the bag with messages.
        available: String,
    },
    /// No transform between two frames at a stamp.
    #[error("no transform from `{source_frame}` to `{target}` at {stamp_secs:.6} s: {reason}")]
    NoTransform {
        /// Frame in which the pose was requested.
        target: String,
        /// Frame of which the pose was requested.
        source_frame: String,
        /// Stamp, seconds.
        stamp_secs: f64,
        /// The part of the transform that is missing.
        reason: String,
    },
    /// Too few frames of a state have a camera pose.
    #[error(
        "state {state}: too few of {frames} frames have a camera pose (first: {first}); record /tf and \
         /tf_static from before the first to after the last image, or name a pose topic with `--topic \
         pose=TOPIC`"
    )]
    NoPoses {
        /// Index of the state.
        state: usize,
        /// Number of frames.
        frames: usize,
        /// Why the first frame has none.
        first: String,
    },
    /// The camera cannot be tracked by its images.
    #[error(
        "state {state}: the recording holds no camera poses, and the camera cannot be tracked through its \
         {views} views, of which no two hang together: {why}; or record camera poses (/tf)"
    )]
    NotTracked {
        /// Index of the state.
        state: usize,
        /// Number of views.
        views: usize,
        /// Most frequent reason for which views have no place, and its remedy.
        why: String,
    },
    /// The states cannot be brought into a common world.
    #[error(
        "state {state} cannot be brought into the world of state 0: {reason}; keep in view what stands \
         still, or record camera poses of both states in one frame"
    )]
    StatesUnaligned {
        /// Index of the state.
        state: usize,
        /// Why they cannot be aligned.
        reason: String,
    },
    /// Every pose is not finite or has no unit quaternion.
    #[error(
        "all {count} camera poses on `{topic}` are invalid (NaN, infinite or no unit quaternion); check the \
         odometry or robot driver"
    )]
    InvalidPoses {
        /// Topic of the poses.
        topic: String,
        /// Number of poses.
        count: usize,
    },
    /// The chain of transforms to the camera is static.
    #[error(
        "the pose of `{frame}` comes from static transforms alone (root `{root}`): the recording holds no \
         camera motion; record odometry or the robot's /tf, name a pose topic with `--topic pose=TOPIC`, or \
         give `--set capture.world_frame={root}` if the camera did stand still"
    )]
    StaticCamera {
        /// Optical frame of the camera.
        frame: String,
        /// Root of its chain.
        root: String,
    },
    /// Only one state was given.
    #[error(
        "`{}` holds one recording, but two states are needed; give two bags, a folder with `state0` and \
         `state1`, or say where the states part (`--split SECONDS` or a marker topic)", path.display()
    )]
    OneState {
        /// Path as given.
        path: PathBuf,
    },
    /// More states than a run takes.
    #[error("{count} states, {limit} at most; give the paths of those that show the joints farthest apart")]
    TooManyStates {
        /// Number of given states.
        count: usize,
        /// Largest number of states.
        limit: usize,
    },
    /// The recording cannot be split into states as requested.
    #[error("cannot split the recording into two states: {reason}")]
    Split {
        /// The fault and its remedy.
        reason: String,
    },
    /// An image encoding that is not supported.
    #[error("{topic}: encoding `{encoding}` is not supported; {supported}")]
    Encoding {
        /// Topic of the image.
        topic: String,
        /// Name of the encoding.
        encoding: String,
        /// The supported encodings.
        supported: &'static str,
    },
    /// Images change their size or differ from their camera_info.
    #[error(
        "{topic}: image of {width}x{height} at {stamp_secs:.6} s, but {expected} say \
         {expected_width}x{expected_height}; all images of a recording must have one size: record again with \
         a fixed profile"
    )]
    ImageSize {
        /// Topic of the image.
        topic: String,
        /// Width of the image, pixels.
        width: usize,
        /// Height of the image, pixels.
        height: usize,
        /// Stamp of the image, seconds.
        stamp_secs: f64,
        /// Source that says otherwise: `earlier images` or `camera_info`.
        expected: &'static str,
        /// Width according to that source, pixels.
        expected_width: usize,
        /// Height according to that source, pixels.
        expected_height: usize,
    },
    /// Depth cannot be brought to the pixels of color.
    #[error("depth `{depth}` cannot be brought to color `{color}`: {reason}; {remedy}")]
    NotAligned {
        /// Depth topic.
        depth: String,
        /// Color topic.
        color: String,
        /// What is missing.
        reason: String,
        /// What to do about it.
        remedy: String,
    },
    /// A lens distortion that cannot be undone.
    #[error(
        "{topic}: distortion model `{model}` {problem}; supported: plumb_bob (4 or 5 values) and \
         rational_polynomial (8), or rectify the images first"
    )]
    Distortion {
        /// Topic of the camera_info.
        topic: String,
        /// Name of the distortion model.
        model: String,
        /// Why it cannot be used.
        problem: String,
    },
    /// The camera_info describes no pinhole camera.
    #[error("{topic}: camera_info is unusable: {reason}; calibrate the camera or fix its driver")]
    CameraInfo {
        /// Topic of the camera_info.
        topic: String,
        /// Why it cannot be used.
        reason: String,
    },
    /// A state has no usable frame.
    #[error("state {state} has no usable frame: {reason}")]
    NoFrames {
        /// Index of the state.
        state: usize,
        /// Why its frames were dropped.
        reason: String,
    },
    /// A state has no valid depth reading.
    #[error(
        "state {state}: all depth is invalid (no reading between {min_m} and {max_m} m in {frames} frames); \
         check the depth topic's unit (16UC1 is millimeters, unless `--set capture.depth_unit_m=METERS` says \
         otherwise, 32FC1 meters) and the range (`--set capture.depth_max_m=METERS`)"
    )]
    NoDepth {
        /// Index of the state.
        state: usize,
        /// Number of frames.
        frames: usize,
        /// Least accepted depth, meters.
        min_m: f64,
        /// Largest accepted depth, meters.
        max_m: f64,
    },
    /// The states were recorded in different world frames.
    #[error(
        "state 0 is in world frame `{world0}` and state {state} in `{world1}`; all states need one fixed \
         frame: name one that all recordings hold with `--set capture.world_frame=FRAME`"
    )]
    WorldFrames {
        /// World frame of state 0.
        world0: String,
        /// Index of the other state.
        state: usize,
        /// World frame of the other state.
        world1: String,
    },
    /// A dataset folder that breaks its format.
    #[error("dataset file `{}`: {reason}", path.display())]
    Dataset {
        /// Path of the file.
        path: PathBuf,
        /// The fault and its remedy.
        reason: String,
    },
    /// The object cannot be separated from its surroundings.
    #[error(
        "cannot isolate the object: {reason}; give masks, a place on the object with \
         `--at`, or a box around it with `--workspace`"
    )]
    Isolation {
        /// Why it cannot be separated.
        reason: String,
    },
    /// Several separate things changed about as much between the states.
    #[error(
        "{} things changed between the states, about ({}) m; record again with nothing moved but the object, \
         or say which is the object with `--at X,Y,Z`",
        at.len(),
        at.iter().map(|p| p.map(|x| format!("{x:.2}")).join(", ")).collect::<Vec<_>>().join(") m, (")
    )]
    SeveralChanged {
        /// Centers of these things in the world, meters.
        at: Vec<[f64; 3]>,
    },
    /// One recording was given for two states.
    #[error(
        "states {first} and {second} hold the same images: one recording was given twice; give the recording \
         that was made after the joints were moved"
    )]
    SameRecording {
        /// Index of one state.
        first: usize,
        /// Index of the state with the same images.
        second: usize,
    },
    /// Two states show nothing at a common place.
    #[error(
        "states 0 and {state} have no place in common: only {share_percent:.1} % of the object's points in \
         one state lie near those of the other; the static part must stand still in the world frame: check \
         the camera poses of both recordings"
    )]
    NoOverlap {
        /// Index of the other state.
        state: usize,
        /// Object points near those of the other state, percent.
        share_percent: f64,
    },
    /// The frames would take more memory than allowed.
    #[error(
        "{frames} frames of {width}x{height} pixels take {needed_gib:.1} GiB, more than capture.memory_gib = \
         {limit_gib}; keep fewer with `--set capture.frames_per_state={fitting}`, record smaller images, or \
         allow more with `--set capture.memory_gib=GIB`"
    )]
    Memory {
        /// Number of frames of all states.
        frames: usize,
        /// Width of the largest frame, pixels.
        width: usize,
        /// Height of the largest frame, pixels.
        height: usize,
        /// Memory the frames would take, GiB.
        needed_gib: f64,
        /// Memory limit, GiB.
        limit_gib: f64,
        /// Frames per state that would fit.
        fitting: usize,
    },
    /// A setting with an unusable value.
    #[error("setting `{key}`: {reason}")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// What is wrong with its value.
        reason: String,
    },
}

/// Path to which a bag in another storage is to be converted.
fn converted(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or(path.as_os_str()).to_owned();
    name.push("_mcap");
    path.with_file_name(name)
}

/// A path quoted for both a shell and YAML: bare without special characters, else in single quotes. (A path
/// with a single quote would need two forms; it gets the shell's.)
#[must_use]
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    // A leading hyphen would make it an option.
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
