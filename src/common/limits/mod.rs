//! Upper limits on inputs: one constant for each, with its reason, and checks of texts whose parsers have no
//! limits.
//!
//! Limits are generous: no known recording, twin or dataset comes near them. A larger input is refused with
//! the limit in the message, before it is loaded or processed.

mod xml;
mod yaml;

pub use xml::{XmlError, parse_xml, with_declaration};
pub use yaml::{YamlError, parse_yaml};

/// Size limit for a kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileLimit {
    /// Name of the kind, with its article.
    pub what: &'static str,
    /// Largest size, bytes.
    pub bytes: u64,
}

const fn file_limit(what: &'static str, bytes: u64) -> FileLimit {
    FileLimit { what, bytes }
}

/// Settings; a file of all groups with comments has 20 kB.
pub const CONFIG: FileLimit = file_limit("a configuration", 1 << 20);
/// Parameters of ROS 2 nodes.
pub const PARAMETERS: FileLimit = file_limit("a parameter file", 1 << 20);
/// The metadata of a rosbag2 folder; that of a bag of 10,000 files has 800 kB.
pub const METADATA: FileLimit = file_limit("a metadata.yaml", 4 << 20);
/// A URDF; 10,000 links have 5 MB.
pub const URDF: FileLimit = file_limit("a URDF", 16 << 20);
/// An SDF beside a twin.
pub const SDF: FileLimit = file_limit("an SDF", 16 << 20);
/// A USD layer in text, with its meshes.
pub const USD: FileLimit = file_limit("a USD layer", 1 << 30);
/// A mesh of 20 million elements.
pub const MESH: FileLimit = file_limit("a mesh", 1 << 30);
/// All files of a model folder to be checked.
pub const MODEL_FOLDER: FileLimit = file_limit("a model folder", 1 << 30);
/// An array of numbers.
pub const NPY: FileLimit = file_limit("a NumPy array", 1 << 30);
/// A text, image or archive of a dataset folder; 100,000 frames are listed in 40 MB, an image of 8192 x 8192
/// has at most 200 MB.
pub const DATASET: FileLimit = file_limit("a file of a dataset", 256 << 20);
/// Ground truth of a recording.
pub const TRUTH: FileLimit = file_limit("a truth.json", 16 << 20);
/// Positions or poses of a point, a line each; an hour at 200 Hz has 90 MB.
pub const TRACK: FileLimit = file_limit("a track", 128 << 20);
/// Report of a run, with its series.
pub const REPORT: FileLimit = file_limit("a report", 256 << 20);

/// Nesting depth of elements in an XML text. Readers are recursive: at some thousands they were measured to
/// crash the process. URDF and SDF need about ten.
pub const XML_DEPTH: usize = 128;
/// Elements of an XML text; a URDF of [`LINKS`] links has 200,000.
pub const XML_ELEMENTS: usize = 1_000_000;
/// Nesting depth of lists in a YAML text, the same as its reader's limit; the reader's own check takes time
/// quadratic in the depth.
pub const YAML_DEPTH: usize = 128;
/// Scalars and groups of a YAML text: 100,000 frames of a dataset have 2.3 million. A reader needs about 100
/// bytes for each.
pub const YAML_EVENTS: usize = 4_000_000;
/// Links of a twin; the largest robots have some hundreds.
pub const LINKS: usize = 10_000;

/// Moving joints times links of a twin to be diagnosed: every joint needs the dynamics of the whole chain at
/// every sample. Measured: 500 x 500 take 25 s for 6 s of log. A humanoid with hands has 100 x 150.
pub const CHAIN_WORK: usize = 1 << 16;

/// Decompressed bytes of a bag always allowed, beyond [`EXPANSION`] times its size: a small bag of black
/// images.
pub const EXPANDED_FREE: u64 = 1 << 30;
/// Decompressed bytes for each byte of a bag. Measured: raw depth and color expand 2 to 8 times, raw masks up
/// to 200 times.
pub const EXPANSION: u64 = 256;
/// Decompressed bytes of a chunk always allowed, beyond [`EXPANSION`] times its compressed ones; rosbag2
/// writes chunks of 768 kB.
pub const CHUNK_FREE: u64 = 16 << 20;

/// Bytes of all members of a NumPy archive together; the matches of a frame have some megabytes.
pub const ARCHIVE: u64 = 256 << 20;
/// Values of a pickle, counting every mention: 30 pairs of frames have 1,000. A value takes 72 bytes.
pub const PICKLE_VALUES: usize = 2_000_000;
/// Characters of a NumPy type or of a function's name in a pickle.
pub const PICKLE_NAME: usize = 256;

/// Bytes of a pixel of a kept frame: color 3, depth 4, mask 1, readings 4. Measured: each further frame of
/// 1920x480 adds 17 bytes a pixel to the peak of a run.
pub const BYTES_PER_PIXEL: u64 = 12;

/// Bytes of the meshes of a URDF's shapes, each counted as often as it is named. Text is read at some
/// 100 MB/s.
pub const NAMED_MESHES: u64 = 1 << 30;
/// Collision shapes of a URDF, each of which needs a hull; a decomposed robot has 2,000.
pub const SHAPES: usize = 20_000;
/// Lines of a displayed list: topics, transforms, warnings of one kind.
pub const SHOWN: usize = 200;
/// Findings reported for a URDF.
pub const FINDINGS: usize = 10_000;
/// Names listed in a sentence.
pub const NAMED: usize = 20;
