//! The pipeline: stages in order, progress, cancellation, checkpoints.

mod alignment;
mod articulation;
mod batch;
mod checkpoint;
mod checksum;
mod diagnose;
mod diagnose_frames;
mod earlier;
mod fields;
mod fingerprint;
mod found;
mod least_bytes;
mod matching;
mod monitor;
mod outcome;
mod pictures;
mod reconstruct;
mod seed;
mod stage;
mod state_surface;
mod twin;
mod world_noise;

pub use batch::{MAX_JOBS, reconstruct_all};
pub use checkpoint::{Checkpoint, CheckpointError};
pub use diagnose::{DiagnoseOutcome, DiagnoseRequest, diagnose};
pub use diagnose_frames::diagnose_frames;
pub use fingerprint::Fingerprint;
pub use monitor::{Cancelled, Event, Monitor};
pub use outcome::{JointSummary, Outcome, ReconstructRequest, RunError, chain};
pub use reconstruct::{Twin, reconstruct, reconstruct_twin};
pub use seed::stage_rng;
pub use stage::Stages;
