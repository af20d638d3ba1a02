//! The arguments. `settings.rs` and the verbs decide their meaning.

use std::path::PathBuf;

use clap::{Args, builder::PossibleValue};

use super::{
    actuator_args::{command_topic, effort_unit, servo},
    board::paper,
    recording_args::RecordingArgs,
    wanted::{local, name, recorded_joint, topic_of_link, vector},
};
use capture::Paper;
use gap::record::command::{EffortUnit, ToldServo};
use io::DatasetLayout;
use synth::{DepthSource, HandheldSensor, PoseSource, PoseSpread, SynthConfig};

/// Layers of configuration, later wins.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Configuration, later wins")]
pub(super) struct SettingArgs {
    /// Settings of a built-in preset: default, fields, preview; to compare with: paper, paris, paris-depth,
    /// paris-depth-multi
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// The others.
    #[command(flatten)]
    pub changes: ChangeArgs,
}

/// Layers of configuration on the defaults or a preset, later wins.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Configuration, later wins")]
pub(super) struct ChangeArgs {
    /// YAML file that holds the settings that differ
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting, e.g. train.steps=500; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Where a command puts its result.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Output")]
pub(super) struct OutputArgs {
    /// Folder that gets the result, in a folder DIR/NAME of its own. A result that the same command wrote
    /// there is replaced if nobody changed it since; anything else is refused
    #[arg(long, value_name = "DIR", value_parser = local())]
    pub out: PathBuf,
    /// Name of that folder, and of the twin: a letter, then letters, digits and _; default: `reconstruct`
    /// takes the recording's, `diagnose`, `demo` and `synth` put the result into DIR itself
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub name: Option<String>,
    /// Move what must not be replaced to NAME.bak instead of refusing; an input is never moved
    #[arg(long)]
    pub force: bool,
}

/// Options of `inspect`.
#[derive(Args, Clone, Debug)]
pub(super) struct InspectArgs {
    /// Recording: a rosbag2 folder, an .mcap or .bag file, a folder of images (docs/folders.md), a folder of
    /// state0, state1, ..., or a dataset folder;
    /// several of them are the states of one object
    #[arg(value_name = "BAG", required = true)]
    pub bags: Vec<PathBuf>,
    /// Also open the images, find the object, and write a PNG: the object in some views of each state, and
    /// from where the views see it. A file that is there is not replaced
    #[arg(long, value_name = "FILE.png")]
    pub picture: Option<PathBuf>,
    /// How the recording is read.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Layers of configuration.
    #[command(flatten)]
    pub settings: ChangeArgs,
}

/// Options of `track`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin track bags/drawer > poses.txt")]
pub(super) struct TrackArgs {
    /// Recordings: a rosbag2 folder or an .mcap file a state, or a folder of state0, state1, ...
    #[arg(value_name = "BAG", required = true)]
    pub sources: Vec<PathBuf>,
    #[command(flatten)]
    pub settings: ChangeArgs,
}

/// Options of `node`.
#[cfg(feature = "node")]
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin node --ros-args -p parts:=2 -r __ns:=/lab\n\
    Parameters: `artitwin node --ros-args -p parts:=2`; all of them stand in launch_configs/ros/node.yaml.")]
pub(super) struct NodeArgs {
    /// Arguments of ROS 2: --ros-args -r FROM:=TO -p NAME:=VALUE --params-file FILE --log-level LEVEL
    // `--ros-args` and what follows are read by the node, not as options.
    #[arg(value_name = "ROS_ARGS", trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}

/// Options of `record`.
#[cfg(feature = "node")]
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin record bags/state0 --ros-args -p color_transport:=compressed")]
pub(super) struct RecordArgs {
    /// Folder of the bag, which must not be there yet
    #[arg(value_name = "BAG")]
    pub bag: PathBuf,
    /// Arguments of ROS 2, as for `node`
    #[arg(value_name = "ROS_ARGS", trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}

/// Options of `check`.
#[derive(Args, Clone, Debug)]
pub(super) struct CheckArgs {
    /// Folder with one or more .urdf files and their meshes, or a .urdf file
    #[arg(value_name = "MODEL")]
    pub model: PathBuf,
    /// Warnings count as errors
    #[arg(long)]
    pub strict: bool,
}

/// Options of `evaluate`.
#[derive(Args, Clone, Debug)]
pub(super) struct EvaluateArgs {
    /// Run folders of one object; several count as trials
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Folder with truth.json and truth/state0, truth/state1
    #[arg(long, value_name = "DIR")]
    pub truth: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `demo`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin demo runs/drawer --out demos/drawer")]
pub(super) struct DemoArgs {
    /// Folder of a finished run
    #[arg(value_name = "RUN")]
    pub twin: PathBuf,
    /// What opens and closes the twin: gripper, a free two-finger hand; panda, an arm, from the Python
    /// package dm-robotics-panda
    #[arg(long, value_name = "ROBOT", value_parser = ["gripper", "panda"], default_value = "gripper")]
    pub robot: String,
    /// Python with the packages mujoco, numpy and pillow; with av a film is written as MP4, too
    #[arg(long, value_name = "PATH", default_value = "python3")]
    pub python: PathBuf,
    /// Write no film, which needs a machine that can draw
    #[arg(long)]
    pub no_film: bool,
    /// Where the result goes.
    #[command(flatten)]
    pub output: OutputArgs,
}

/// Options of `diagnose`.
#[derive(Args, Clone, Debug)]
pub(super) struct DiagnoseArgs {
    /// URDF of the twin, or a folder that holds one
    #[arg(value_name = "TWIN", value_parser = local())]
    pub twin: PathBuf,
    /// Bags with sensor_msgs/JointState: positions and efforts; or poses and wrenches, see --pose and
    /// --wrench
    #[arg(value_name = "RUN", required_unless_present = "frames", value_parser = local())]
    pub runs: Vec<PathBuf>,
    /// RGB-D recording of the object at a further joint position, camera poses in the frame of the twin's
    /// root; may be repeated
    #[arg(long, value_name = "BAG", value_parser = local())]
    pub frames: Vec<PathBuf>,
    /// Least error of the twin's surface and joints, millimeters; larger ones are found from the frames
    #[arg(long, value_name = "MM", default_value_t = 0.3)]
    pub accuracy: f64,
    /// Run that only the proof reads; may be repeated; default: every third, at least the last
    #[arg(long, value_name = "RUN", value_parser = local())]
    pub held_out: Vec<PathBuf>,
    /// Gravity in the frame of the twin's root, m/s^2: x,y,z
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_parser = vector,
        default_value = "0,0,-9.81",
        allow_hyphen_values = true
    )]
    pub gravity: [f64; 3],
    /// How the effort runs between samples: zero, held until the next one, as simulators apply it; or sampled
    /// with the position, as drives measure it; default: what the runs show
    #[arg(long, value_parser = [PossibleValue::new("zero"), PossibleValue::new("sampled").alias("linear")])]
    pub effort_hold: Option<String>,
    /// Effects to fit at every joint instead of searching for them, such as viscous_friction,inertia
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    pub effects: Vec<String>,
    /// Topic with geometry_msgs/WrenchStamped that act on a link, as a force gauge measures them; may be
    /// repeated. header.frame_id names a link, at whose origin the wrench acts, or the twin's root or
    /// `world`: it then acts at the origin of LINK
    #[arg(long, value_name = "TOPIC=LINK", value_parser = topic_of_link)]
    pub wrench: Vec<(String, String)>,
    /// Topic with geometry_msgs/PoseStamped of a link, in the frame of another link or `world`, in place of
    /// joint states; may be repeated. Without either, transforms on /tf whose child frame is a link of the
    /// twin are read
    #[arg(long, value_name = "TOPIC=LINK", value_parser = topic_of_link)]
    pub pose: Vec<(String, String)>,
    /// Newton meters (newtons) that one unit of the recorded efforts is: 1 for a calibrated sensor, which has
    /// no gain to be found; or `unknown` for currents, duty cycles or counts: the factor is then found. By
    /// default newton meters, calibrated where wrenches are read
    #[arg(long, value_name = "FACTOR", value_parser = effort_unit)]
    #[arg(allow_hyphen_values = true)]
    pub effort_unit: Option<EffortUnit>,
    /// Position controller that follows recorded commands; they then count before efforts. What is not given
    /// is found: kp (N m/rad or N/m), kd (N m s/rad or N s/m), limit (N m or N; none if not given), delay
    /// (s); may be repeated for single joints. Without recorded efforts commands are read anyway
    #[arg(
        long,
        value_name = "[JOINT:]KEY=VALUE,...",
        value_parser = servo,
        num_args = 0..=1,
        default_missing_value = ""
    )]
    pub servo: Vec<ToldServo>,
    /// Topic of commands: sensor_msgs/JointState, trajectory_msgs/JointTrajectory, or
    /// std_msgs/Float64MultiArray with the joints of its values; may be repeated.
    /// control_msgs/JointTrajectoryControllerState and JointState on a topic with `command` in its name are
    /// found without
    #[arg(long, value_name = "TOPIC[=JOINT,...]", value_parser = command_topic)]
    pub command: Vec<(String, Vec<String>)>,
    /// Joint of the twin that was recorded under another name; may be repeated
    #[arg(long, value_name = "JOINT=RECORDED", value_parser = recorded_joint)]
    pub joint: Vec<(String, String)>,
    /// Seed of the permutation tests
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Print events as JSON lines to stdout, and nothing else
    #[arg(long)]
    pub json: bool,
    /// Print what the command will need, as one line of JSON: cores, memory, disk space, seconds. Nothing is
    /// run or written
    #[arg(long)]
    pub estimate: bool,
    /// Show notes, too: what was chosen on the way, and why
    #[arg(short, long)]
    pub verbose: bool,
    /// Where the result goes.
    #[command(flatten)]
    pub output: OutputArgs,
}

/// Options of `synth`.
#[derive(Args, Clone, Debug)]
pub(super) struct SynthArgs {
    /// Seed of every random choice
    #[arg(long, value_name = "N", default_value_t = SynthConfig::default().seed)]
    pub seed: u64,
    /// Number of rigid parts, the static one included; default: 2 to 6 by the seed
    #[arg(long, value_name = "N")]
    pub parts: Option<usize>,
    /// Kind of object; default: by the seed
    #[arg(long, value_parser = ["cabinet", "lamp", "folding_door", "capped_box", "clamshell"])]
    pub family: Option<String>,
    /// Handles of the doors and drawers of a cabinet, in truth.json too: bar, knob, recess, mixed or none;
    /// default: plain blocks, as before
    #[arg(long, value_parser = ["bar", "knob", "recess", "mixed", "none"])]
    pub handles: Option<String>,
    /// One color a part and no texture; default: by the seed
    #[arg(long, conflicts_with = "textured")]
    pub plain: bool,
    /// Textured parts; default: by the seed
    #[arg(long)]
    pub textured: bool,
    /// Factor on the noise of depth and color; 0 is a perfect camera
    #[arg(long, value_name = "X", default_value_t = SynthConfig::default().noise)]
    pub noise: f64,
    /// By how much the world of state 1 is off, millimeters and degrees
    #[arg(long, value_name = "MM,DEG", default_value = "0,0")]
    pub drift: PoseSpread,
    /// Factor, 1 at most, on the motion of every joint from state 0 to state 1; the object stays the same
    #[arg(long, value_name = "X", default_value_t = SynthConfig::default().motion_scale)]
    pub motion_scale: f64,
    /// Angle by which every axis is tilted from square, degrees
    #[arg(long, value_name = "DEG", default_value_t = SynthConfig::default().skew_deg)]
    pub skew: f64,
    /// Share of the surface under dark lacquer, in patches: color is seen there, no depth is read
    #[arg(long, value_name = "SHARE", default_value_t = SynthConfig::default().lacquer)]
    pub lacquer: f64,
    /// Record as a camera carried by hand does, errors and surroundings and all, without masks: handheld;
    /// handheld:LEVEL with a factor on all errors; handheld:LEVEL:EFFECT,... with these effects alone
    #[arg(long, value_name = "handheld[:LEVEL[:EFFECT,...]]")]
    pub sensor: Option<HandheldSensor>,
    /// Where depth comes from: model; stereo, two infrared images under a dot pattern, matched, without
    /// masks; stereo:LEVEL with a factor, 0 to 2, on noise and on the errors of the rig
    #[arg(long, value_name = "model|stereo[:LEVEL]", default_value = "model")]
    pub depth: DepthSource,
    /// A room: floor and walls of plain paint, a table below a small object, things about, all by the seed;
    /// parts of paint, wood, steel and glass
    #[arg(long)]
    pub room: bool,
    /// Who reports the camera's poses: exact; noisy, with errors of this root mean square size, millimeters
    /// and degrees; robot, with a constant error of the camera on its hand; slam, a tracker with drift; none:
    /// a recording without poses
    #[arg(long, value_name = "exact|noisy:MM,DEG|robot|slam|none", default_value = "exact")]
    pub poses: PoseSource,
    /// Lay a printed board of tags before the object; PAPER: a4, a3 or letter
    #[arg(long, value_name = "PAPER", value_parser = paper, num_args = 0..=1, default_missing_value = "a4")]
    pub board: Option<Paper>,
    /// Record the accelerometer of the camera, too, which shows which way is up
    #[arg(long)]
    pub imu: bool,
    /// States to film; those beyond two have further joint positions, in state2, state3, ...
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=100))]
    pub states: u8,
    /// Write a folder in the layout of a published dataset in place of bags, with its form of the truth: dta
    /// (DigitalTwinArt) or paris
    #[arg(
        long,
        value_parser = DatasetLayout::NAMES,
        conflicts_with_all = ["sensor", "depth", "room", "poses", "board", "imu", "states"]
    )]
    pub layout: Option<String>,
    /// Views of each state
    #[arg(long, value_name = "N", default_value_t = SynthConfig::default().views)]
    pub views: usize,
    /// Views a second, in place of their number: a camera that a hand carries at 0.35 m/s
    #[arg(long, value_name = "HZ", conflicts_with = "views")]
    pub rate: Option<f64>,
    /// Width of the images, pixels
    #[arg(long, value_name = "N", default_value_t = SynthConfig::default().width)]
    pub width: usize,
    /// Height of the images, pixels
    #[arg(long, value_name = "N", default_value_t = SynthConfig::default().height)]
    pub height: usize,
    /// Where the result goes.
    #[command(flatten)]
    pub output: OutputArgs,
}

/// Options of `reconstruct`.
#[derive(Args, Clone, Debug)]
pub(super) struct ReconstructArgs {
    /// Recording: a rosbag2 folder, an .mcap or .bag file, a folder of images (docs/folders.md), a folder of
    /// state0, state1, ..., or a dataset folder;
    /// several of them are the states of one object, 16 at most
    #[arg(value_name = "BAG", required = true, value_parser = local())]
    pub bags: Vec<PathBuf>,
    /// Every BAG is an object of its own; reconstruct N of them at a time
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u8).range(1..=64),
        conflicts_with = "name"
    )]
    pub jobs: Option<u8>,
    /// Number of rigid parts, the static one included; default: found by evidence
    #[arg(long, value_name = "N")]
    pub parts: Option<usize>,
    /// Seed of every random choice
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// How the recording is read.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Model that matches pairs of images, in place of the built-in matcher; needs a build with `--features
    /// onnx`
    ///
    /// Inputs `image0`, `image1`: float32 [1, C, H, W] in 0 to 1, C = 1 (luma) or 3 (RGB), H and W fixed or
    /// open. Outputs `keypoints0`, `keypoints1`: [N, 2] or [1, N, 2], pixels (u, v) of the inputs, integers
    /// at pixel centers; `confidence`, which may be absent: [N] or [1, N]. Others are ignored. Weights stand
    /// in the file, 512 MiB at most.
    #[arg(long, value_name = "FILE.onnx")]
    pub matcher: Option<PathBuf>,
    /// Also write views, fused surfaces, parts and joints as a recording of rerun, to a file that is not
    /// there yet; needs a build with `--features rerun`
    #[arg(long, value_name = "FILE.rrd", conflicts_with_all = ["jobs", "resume"])]
    pub rerun: Option<PathBuf>,
    /// Continue the run that was stopped, from its last finished stage; a finished run is left as it is
    #[arg(long)]
    pub resume: bool,
    /// Keep what every stage finds in a folder, and take from there what was found for the same recordings:
    /// with other settings, only the stages run that these change. Some 500 MB an object, for you to delete
    #[arg(long, value_name = "DIR")]
    pub stages: Option<PathBuf>,
    /// Begin while the recordings are still written, or not there yet: wait until their recorder closes them,
    /// one state after the other, and work out meanwhile what the run needs. One folder that is no recording
    /// is where state0 and state1 will stand
    #[arg(long, conflicts_with = "jobs")]
    pub follow: bool,
    /// Print events as JSON lines to stdout, and nothing else
    #[arg(long)]
    pub json: bool,
    /// Print what the command will need, as one line of JSON: cores, memory, disk space, seconds. Nothing is
    /// run or written
    #[arg(long, conflicts_with = "jobs")]
    pub estimate: bool,
    /// Show notes, too: what was chosen on the way, and why
    #[arg(short, long)]
    pub verbose: bool,
    /// Where the result goes.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Layers of configuration.
    #[command(flatten)]
    pub settings: SettingArgs,
}
