//! All disk access: bags, datasets, run folders.
//!
//! ```no_run
//! use capture::CaptureConfig;
//! use common::stop::Stop;
//!
//! let path = "bags/drawer/state0".as_ref();
//! let recording = io::Recording::open(path, &CaptureConfig::default(), 0, &Stop::never())?;
//! println!("{} views of the closed drawer", recording.all().len());
//! # Ok::<(), capture::CaptureError>(())
//! ```

mod disk;
mod frame_run;
mod gallery;
mod gap_report;
mod joint_commands;
mod joint_log;
mod locked_file;
mod manifest;
mod mesh_faces;
mod mesh_files;
mod model_folder;
mod npy;
mod obj;
mod package_path;
mod place;
mod plain_file;
mod ply;
mod run_dir;
mod run_dir_error;
mod run_summary;
mod seen_twin;
mod sibling;
mod track_file;
mod twin_file;
mod urdf;
mod urdf_fault;

pub use disk::free_bytes;
pub use frame_run::read_frame_run;
pub use gallery::read_gallery;
pub use gap_report::{GapReportError, read_gap_report};
pub use joint_log::read_joint_log;
pub use locked_file::LockedFile;
pub use manifest::{ResultKind, hex, sha256};
pub use mesh_files::{MeshFileError, read_mesh};
pub use model_folder::{ModelFolderError, read_model, read_model_folder};
pub use npy::{NpyError, read_npy};
pub use place::Place;
pub use plain_file::{create_plain, open_plain, write_new};
pub use run_dir::{Committed, RunDir};
pub use run_dir_error::RunDirError;
pub use run_summary::{RunSummary, RunSummaryError, SummaryJoint, read_result_fingerprint, read_run_summary};
pub use seen_twin::read_seen_twin;
pub use track_file::{read_track, track_of_text};
pub use twin_file::{read_twin, twin_files, twin_of, twin_path};
pub use urdf::{UrdfError, read_urdf};
pub mod image_codec;
pub mod ros2msg;
pub mod rvl;

mod bag;
mod bag_index;
mod bag_metadata;
mod bag_writer;
mod board_look;
mod camera;
#[cfg(test)]
mod conformance_tests;
mod dataset;
mod depth_camera;
mod expansion;
mod file_ranges;
mod folder;
mod foreign_topics;
mod glimpse;
mod growing;
mod image_files;
mod imu;
mod inspect;
mod inspect_motion;
mod lags;
mod live_view;
mod mcap_file;
mod mcap_record;
mod mcap_summary;
mod mosaic;
mod offered_qos;
mod onnx;
#[cfg(feature = "onnx")]
mod onnx_matcher;
mod picture_size;
mod pixels;
mod pose_candidate;
mod pose_topic;
mod poses;
mod probe;
mod recording;
#[cfg(feature = "rerun")]
mod rerun;
mod ros1_bag;
mod ros1msg;
mod source;
mod synchronize;
mod synth_bag;
mod synth_dataset;
mod synth_error;
mod synth_folder;
mod synth_matrix;
mod synth_sensor;
mod synth_twin;
mod topics;
#[cfg(test)]
mod urdf_conformance_tests;
mod views;

pub use bag_writer::{BagWriteError, BagWriter};
pub use camera::pinhole;
pub use dataset::{JointTransform, JointTransforms, STATES, open_keyframes, open_start_end};
pub use glimpse::{Glimpse, count_joint_messages, glimpse_views};
pub use growing::{GrowingState, Grown};
pub use inspect::{inspect, inspect_with, inspected, printable};
pub use live_view::{LiveCamera, LiveEye, LiveImages, LiveTopics};
pub use offered_qos::OfferedQos;
#[cfg(not(feature = "onnx"))]
pub use onnx::OnnxMatcher;
pub use onnx::{MAX_MODEL_BYTES, OnnxError};
#[cfg(feature = "onnx")]
pub use onnx_matcher::OnnxMatcher;
pub use pixels::Decoded;
pub use poses::poses_unused;
pub use recording::{RecordedStates, Recording, object_name, state_count};
#[cfg(feature = "rerun")]
pub use rerun::{Seen, write_rerun};
pub use source::{Source, is_recording, name_of};
pub use synth_dataset::{DatasetLayout, write_synth_dataset};
pub use synth_error::SynthError;
pub use synth_folder::{write_synth, write_synth_bag, write_true_twin};
pub use views::{View, Views, check_size, views_kept};
