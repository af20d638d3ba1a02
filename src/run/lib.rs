//! The pipeline: stages in order, progress, cancellation, checkpoints.
//!
//! ```no_run
//! use run::{Monitor, ReconstructRequest, reconstruct};
//!
//! let outcome = reconstruct(&ReconstructRequest::new(["bags/drawer"], "runs"), &Monitor::silent())?;
//! println!("{} joints", outcome.joints.len());
//! # Ok::<(), run::RunError>(())
//! ```

mod admission;
mod alignment;
mod articulation;
mod assemble;
mod assessed;
mod band;
mod batch;
pub mod capture;
mod checkpoint;
mod demonstrate;
mod diagnose;
mod diagnose_frames;
mod differences;
mod doubts;
mod earlier;
mod estimate;
mod facts;
mod fields;
mod follow;
mod found;
mod frame_run;
mod idle;
mod joint_runs;
mod joints;
mod least_bytes;
mod left_out;
mod matching;
mod may_pass;
mod monitor;
mod outcome;
mod pictures;
mod plan;
mod progress;
mod radiance;
mod reconstruct;
mod reconstruct_twin;
mod recorded_twin;
#[cfg(feature = "rerun")]
mod rerun;
mod run_motion;
mod scene;
mod signs;
mod stage;
mod stage_facts;
mod stage_store;
mod state;
mod state_surface;
mod traced_joint;
mod trials;
mod write;

pub use batch::reconstruct_all;
pub use checkpoint::{Checkpoint, CheckpointError};
pub use common::fingerprint::Fingerprint;
pub use demonstrate::{DemonstrateError, DemonstrateRequest, demonstrate};
pub use diagnose::{DiagnoseOutcome, DiagnoseRequest, diagnose};
pub use diagnose_frames::diagnose_frames;
pub use differences::compare;
pub use estimate::Estimate;
pub use follow::follow;
pub use monitor::{Cancelled, Event, Monitor, Planned};
pub use outcome::{JointSummary, Outcome, ReconstructRequest, RunError, chain};
pub use progress::RunProgress;
pub use reconstruct::reconstruct;
pub use reconstruct_twin::{Twin, reconstruct_twin};
pub use stage::Stages;
pub use stage_store::StageStore;
pub use traced_joint::joint_of_tracks;
pub use trials::{Method, TrialsError, TrialsRequest, trials};
