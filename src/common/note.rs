//! Notes beside a result: a sentence for people, a code for programs (`docs/codes.md`).

use std::fmt;

use serde::{Deserialize, Serialize};

/// A note or a warning.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    /// What it is about, for programs; it stays the same when the sentence changes.
    pub code: NoteCode,
    /// The sentence.
    pub text: String,
}

impl Note {
    /// A sentence under its code.
    pub fn new(code: NoteCode, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }

    /// The same note about one of several things; its name precedes the sentence.
    #[must_use]
    pub fn about(&self, whom: impl fmt::Display) -> Self {
        Self { code: self.code, text: format!("{whom}: {}", self.text) }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Codes that put a twin's parts, joints or shape in doubt; all others are about the recording, the run, or
/// usable results.
const DOUBTS: &[NoteCode] = &[
    NoteCode::PosesContradict,
    NoteCode::PosesFarOff,
    NoteCode::SensorFarOff,
    NoteCode::MorePartsEvident,
    NoteCode::PartOnLittleEvidence,
    NoteCode::PartAlmostEvident,
    NoteCode::JointTypeUndecided,
    NoteCode::JointTypeUnknown,
    NoteCode::JointAtRest,
    NoteCode::JointContradicted,
    NoteCode::StateContradicts,
    NoteCode::AxisNotDetermined,
    NoteCode::AxisCoarse,
    NoteCode::MotionNotDetermined,
    NoteCode::ParentNotDecided,
    NoteCode::PartUntouched,
    NoteCode::SurfaceLeftOut,
    NoteCode::TwinDiffers,
];

/// Codes of general interest to a user: what happened to files, and how the run went.
const OF_RUN: &[NoteCode] = &[
    NoteCode::EngineReplaced,
    NoteCode::RecordingGrows,
    NoteCode::RecordingStill,
    NoteCode::StageKept,
    NoteCode::StageNotKept,
    NoteCode::StageComputedAgain,
    NoteCode::StartsAnew,
    NoteCode::ResultStands,
    NoteCode::KeptForResume,
    NoteCode::CheckpointLeft,
    NoteCode::MovedAside,
    NoteCode::Stopping,
];

macro_rules! codes {
    ($($name:ident = $word:literal, $meaning:literal;)*) => {
        /// What a note or a warning is about.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        pub enum NoteCode {
            $(#[doc = $meaning] #[serde(rename = $word)] $name,)*
        }

        impl NoteCode {
            /// All codes, each with its word and its meaning.
            pub const ALL: &[(Self, &str, &str)] = &[$((Self::$name, $word, $meaning),)*];

            /// Whether it puts a twin's parts, joints or shape in doubt.
            pub fn doubts_twin(self) -> bool {
                DOUBTS.contains(&self)
            }

            /// Whether it is about the user's files or the course of the run, not about choices made in it.
            pub fn is_of_run(self) -> bool {
                OF_RUN.contains(&self)
            }

            /// Its word in files and events.
            pub fn word(self) -> &'static str {
                match self {
                    $(Self::$name => $word,)*
                }
            }
        }
    };
}

codes! {
    // Recordings.
    MetadataMissing = "metadata_missing", "A bag has no `metadata.yaml`: it was not closed.";
    MetadataUnreadable = "metadata_unreadable", "The `metadata.yaml` of a bag cannot be read.";
    FilesMissing = "files_missing", "Files that a bag lists are not there.";
    RecordingDamaged = "recording_damaged", "A file of a bag is damaged or cut; what can be read of it is \
        used.";
    RecordingGrows = "recording_grows", "A recording that is followed has more views than before.";
    RecordingStill = "recording_still", "A recording that is followed does not grow, and is not closed.";
    MessagesUndecodable = "messages_undecodable", "Messages of a topic cannot be decoded.";
    TransformsSurplus = "transforms_surplus", "Transforms name more frames than are kept.";
    TransformsInvalid = "transforms_invalid", "Transforms hold NaN or no unit quaternion.";
    DepthUnpaired = "depth_unpaired", "Color images have no depth image of their time.";
    MasksUnpaired = "masks_unpaired", "Color images have no mask of their time.";
    ImagesInOtherFrame = "images_in_other_frame", "Images of a topic are in another frame than its first.";
    CameraInfoContradicted = "camera_info_contradicted", "Camera parameters contradict all others of their \
        topic.";
    PosesMissing = "poses_missing", "Frames have no camera pose.";
    PosesUnused = "poses_unused", "Poses were recorded and cannot be used; the camera is tracked.";
    PosesTurned = "poses_turned", "Poses are of a frame turned against the camera, as that of its body.";
    CameraStands = "camera_stands", "The camera stands still; its pose is that of static transforms.";
    TransformsShared = "transforms_shared", "Static transforms are taken from the recording of another \
     state.";
    ClocksDiffer = "clocks_differ", "Messages are stamped by different clocks; the times of recording relate \
        them.";
    DepthUnit = "depth_unit", "Depth, or poses, are in another unit than the standard one.";
    DepthRegistered = "depth_registered", "Depth has a camera of its own and is brought to color's pixels.";
    MasksUnlike = "masks_unlike", "Images that are named as masks show no object; they are not used.";
    WorldTurned = "world_turned", "The world of the poses is not z-up; the twin's was turned upright.";
    FramesBroken = "frames_broken", "Images cannot be decoded.";
    MasksIncomplete = "masks_incomplete", "Only some frames have masks; none is used.";
    MatchesUnreadable = "matches_unreadable", "A file of matches cannot be read.";
    MatchesOutside = "matches_outside", "Matches lie outside their images.";
    PositionsUnreadable = "positions_unreadable", "The joint positions beside the frames cannot be read.";
    StampsMissing = "stamps_missing", "Messages have no stamp; the time of recording is used.";
    SamplesBackward = "samples_backward", "Samples have stamps that repeat or run backward.";
    PositionsFromVelocities = "positions_from_velocities", "A joint has velocities and no positions: they \
        are added up.";
    SamplesNotNumbers = "samples_not_numbers", "Samples hold a position or an effort that is not a number.";
    DatasetFormat = "dataset_format", "The format of a dataset folder was recognized.";
    TopicsChosen = "topics_chosen", "The topics, camera and pose source that are used.";
    ImagesUndistorted = "images_undistorted", "Images are undistorted by their camera's lens model.";
    ViewsKept = "views_kept", "How many views of a state are kept.";
    MatchesRead = "matches_read", "Matches came with the recording.";
    CameraTracked = "camera_tracked", "The camera poses were tracked by what the camera sees.";
    ViewsLost = "views_lost", "The camera was lost in a stretch of views; they are not used.";
    GravityMeasured = "gravity_measured", "Accelerations of an IMU say which way is up, or check it.";
    ImuUnusable = "imu_unusable", "Accelerations were recorded and cannot say which way is up.";
    UprightContradicted = "upright_contradicted", "Gravity as it was measured and the plane that the object \
        stands on are further apart than both err by.";
    UprightByImages = "upright_by_images", "No support plane was found; up is what is up in the images.";
    BoardSeen = "board_seen", "A printed board of tags is seen; where the camera is tracked, the world \
        is its.";
    BoardSize = "board_size", "How long depth measures a printed board; depth and poses got its length.";
    BoardSizeDoubtful = "board_size_doubtful", "Depth measures a printed board too long or too short; it \
        gives no lengths.";
    BoardTilted = "board_tilted", "A printed board does not lie level.";
    BoardMoved = "board_moved", "A printed board was moved between states.";
    GapsClosed = "gaps_closed", "Gaps of one pixel in enlarged depth were closed.";
    NoiseMeasured = "noise_measured", "The depth noise was measured.";
    DepthFromColor = "depth_from_color", "Depth that the sensor did not read was taken from color.";
    PosesChecked = "poses_checked", "Camera poses were checked against the surfaces that frames share.";
    SensorChecked = "sensor_checked", "The depth sensor's own errors were looked for, together with the \
        camera poses.";
    PosesLate = "poses_late", "Camera poses are older or younger than the images.";
    PosesContradict = "poses_contradict", "Camera poses contradict what the images show.";
    SeveralSensors = "several_sensors", "Frames come from cameras of different intrinsics.";
    PosesFarOff = "poses_far_off", "Camera poses err by as much as is looked for at most.";
    SensorFarOff = "sensor_far_off", "The depth sensor errs by more than data sheets allow.";
    MasksUsed = "masks_used", "The masks of the recording are used.";
    BackgroundRemoved = "background_removed", "A plane was taken for background.";
    ObjectIsolated = "object_isolated", "The object was found without masks.";
    // States and parts.
    WorldFrameDiffers = "world_frame_differs",
        "A state was recorded in another world frame, or the whole object was moved; it was moved back.";
    MatchesFound = "matches_found", "How many pixel matches were found.";
    MorePartsEvident = "more_parts_evident", "The evidence is for more parts than were asked for.";
    PartOnLittleEvidence = "part_on_little_evidence", "A part rests on little evidence.";
    PartAlmostEvident = "part_almost_evident", "A further part nearly has the evidence that it needs.";
    PartsMoveAlike = "parts_move_alike", "One motion was divided, as two parts move nearly alike.";
    NoPartMoved = "no_part_moved", "No part moved; the twin has one part.";
    MotionByOtherStates = "motion_by_other_states", "The motion of a part in a state follows from other \
        states.";
    StateAddsNoMotion = "state_adds_no_motion", "A state shows all joints where an earlier one does.";
    // Joints.
    JointTypeUndecided = "joint_type_undecided", "Two types explain the motion about equally well.";
    JointTypeUnknown = "joint_type_unknown", "No joint type explains the motion.";
    JointAtRest = "joint_at_rest", "The joint did not move.";
    JointContradicted = "joint_contradicted", "Most observations disagree with the joint's motion.";
    StateContradicts = "state_contradicts", "A state disagrees with the joint that the others show.";
    JointAsPublished = "joint_as_published", "A joint was read off its motion alone, as the published \
        method does.";
    AxisNotDetermined = "axis_not_determined", "The motion leaves direction or position of the axis open.";
    AxisCoarse = "axis_coarse", "The motion determines direction or position of the axis coarsely.";
    MotionNotDetermined = "motion_not_determined", "How far the joint moved is not determined.";
    LimitsNotObserved = "limits_not_observed", "The limits of the joint lie beyond what was observed.";
    TurnsNotObserved = "turns_not_observed", "Whole turns between the states cannot be seen.";
    ScrewNotObserved = "screw_not_observed", "A screw looks like a turn and a slide of their own.";
    ScrewForms = "screw_forms", "How the files hold a screw, which not every format has.";
    SpinNotObserved = "spin_not_observed", "The part looks alike all round: its turn about its axis cannot \
        be seen.";
    ParentNotDecided = "parent_not_decided", "Another link could carry the part as well.";
    PartUntouched = "part_untouched", "No other part touches this one in all states.";
    SurfaceLeftOut = "surface_left_out", "Surface is of no part: another state saw nothing where its part \
        is.";
    SolidsOff = "solids_off", "Collision solids of a part do not stand where its surface was seen.";
    TwinDiffers = "twin_differs", "The twin is not where the cameras saw the object, or where they saw \
        through.";
    // Runs.
    EngineReplaced = "engine_replaced", "The CPU engine took over from the one that was asked for.";
    StageKept = "stage_kept", "A stage was taken from an earlier run.";
    StageNotKept = "stage_not_kept", "A stage could not be kept for a later run.";
    StageComputedAgain = "stage_computed_again", "What was kept of a stage cannot be used.";
    StartsAnew = "starts_anew", "There is nothing to continue.";
    ResultStands = "result_stands", "The result is there already; nothing is left to do.";
    KeptForResume = "kept_for_resume", "What was finished is kept for `--resume`.";
    CheckpointLeft = "checkpoint_left", "What was kept on the way could not be deleted.";
    MovedAside = "moved_aside", "What stood in the result's place was moved.";
    Stopping = "stopping", "The run stops after its present step.";
    // Diagnoses.
    JointNotDiagnosed = "joint_not_diagnosed", "The runs say too little about a joint.";
    EffortsSampled = "efforts_sampled", "The efforts were sampled with the positions, not held until the \
        next sample.";
    EffortsIdle = "efforts_idle", "The efforts of a joint never change, though it was driven: its commands \
        are used, or it is not diagnosed.";
    PositionsWrapped = "positions_wrapped", "The angle of a joint jumps by a turn; its positions go on over \
        the jumps.";
    JointFixed = "joint_fixed", "A joint stands still in all runs, floats, or is not felt where it was not \
        recorded: it is taken as fixed.";
    InertiaImpossible = "inertia_impossible", "A link of a twin has an inertia that no body can have.";
    UnitsDoubtful = "units_doubtful", "A twin or a recording looks as if it were in other units; the joint \
        is not diagnosed.";
    EffortSignTurned = "effort_sign_turned", "The efforts of a joint have the sign of the opposite axis; it \
        is not diagnosed.";
    EffortsOfOtherJoint = "efforts_of_other_joint", "The efforts that move a joint were recorded as those of \
        another one; it is not diagnosed.";
    EffortsWithoutSign = "efforts_without_sign", "The efforts of a joint are never negative, though it was \
        driven both ways: their sign is that of the command less the position, or they are not used.";
    TwinUncertain = "twin_uncertain", "The twin is a reconstruction with errors of its own.";
    UnknownStoodIn = "unknown_stood_in", "The file of a format holds what predicts a joint better than the \
        twin; no effect in it is certain.";
    FormatHoldsLess = "format_holds_less", "The file of a format holds less than was found at a joint.";
    FormatKeepsTwin = "format_keeps_twin", "The file of a format keeps the twin's values at a joint: nothing \
        that it holds predicts better, or no file has a place for what was found.";
    FewPatches = "few_patches", "The frames show too little of the object.";
    JointStands = "joint_stands", "A joint stands at one place in all recordings.";
    EffectTooSmall = "effect_too_small", "An effect moves less than the twin errs.";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_codes_is_that_of_the_program() {
        let table = include_str!("../../docs/codes.md");
        let (_, table) = table.split_once("## Notes and warnings").unwrap();
        let rows: Vec<&str> = table.lines().filter(|l| l.starts_with("| `")).collect();
        let expected: Vec<String> =
            NoteCode::ALL.iter().map(|(_, word, meaning)| format!("| `{word}` | {meaning} |")).collect();
        assert_eq!(rows, expected);
    }

    #[test]
    fn a_note_is_a_code_and_a_sentence() {
        let note = Note::new(NoteCode::AxisNotDetermined, "too short a motion").about("lid");
        let json = r#"{"code":"axis_not_determined","text":"lid: too short a motion"}"#;
        assert_eq!(serde_json::to_string(&note).unwrap(), json);
        assert_eq!(serde_json::from_str::<Note>(json).unwrap(), note);
        for (code, word, _) in NoteCode::ALL {
            assert_eq!(serde_json::to_value(code).unwrap(), *word);
            assert_eq!(code.word(), *word);
        }
    }
}
