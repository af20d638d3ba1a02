//! artitwin: RGB-D recordings of an articulated object in two or more states in, a digital twin that
//! simulators load out.
//!
//! [`reconstruct`] makes the twin and writes its run folder:
//!
//! ```no_run
//! use artitwin::{Config, Monitor, ReconstructRequest, reconstruct};
//!
//! let mut request = ReconstructRequest::new(["bags/drawer"], "runs");
//! request.config = Config::preset("preview")?;
//! let outcome = reconstruct(&request, &Monitor::silent())?;
//! assert_eq!(outcome.joints[0].kind.name(), "prismatic");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`read_run_summary`] reads its joints, and their uncertainty, back:
//!
//! ```no_run
//! let twin = artitwin::read_run_summary("runs/drawer".as_ref())?;
//! let [_, upper] = twin.joints[0].limits;
//! println!("{}", twin.joints[0].parent_from_child(upper));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`diagnose`] compares a twin with recorded motion, [`diagnose_frames`] with recordings of further joint
//! positions, and both name what the twin lacks:
//!
//! ```no_run
//! use artitwin::{DiagnoseRequest, Monitor, Verdict, diagnose};
//!
//! let mut request = DiagnoseRequest::new("twin.urdf", "diagnosis");
//! request.runs = vec!["run_0".into(), "run_1".into(), "run_2".into()];
//! let outcome = diagnose(&request, &Monitor::silent())?;
//! assert_eq!(outcome.verdict, Verdict::Named);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! That is one call. Two depths lie below it: [`stages`] has the stages as functions on plain types (frames,
//! meshes, models; no files, no progress), with their engines in the same crates:
//!
//! ```no_run
//! use artitwin::stages::{export, run};
//! use artitwin::{Config, Monitor};
//!
//! let config = Config::preset("preview")?;
//! let monitor = Monitor::silent();
//! let paths = ["bags/drawer".into()];
//! let mut frames = run::capture::open(&paths, &config.capture, 1, &Default::default(), &monitor)?;
//! let mut stages = run::Stages::new(&monitor);
//! let twin = run::reconstruct_twin("drawer", &mut frames, None, &config, &mut stages)?;
//! let looks = export::link_looks(&twin.model, &frames, &config.look);
//! let files = export::package(&twin.model, &looks, &config.export);
//! println!("{} joints, {} files", twin.model.joints.len(), files.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! `examples/` has whole programs. Settings and what comes out are documented in `docs/`.
//!
//! Data flows one way:
//!
//! ```text
//! io (bag, dataset) -> capture (frames of each state) -> surface (fusion, mesh, distance field, visibility)
//!     -> articulate (parts, motions, joints) -> model (links, joints, evidence) -> export -> io (run folder)
//! ```
//!
//! Conventions: SI units and radians; a transform `target_from_source` maps source coordinates to target
//! coordinates; cameras are optical frames (x right, y down, z forward); integer pixel coordinates are pixel
//! centers; depth is z-depth in meters and 0 means unknown; signed distances are negative inside.

mod cli;

/// The crates of the stages, for a program that needs a step of the method by itself.
pub mod stages {
    pub use {
        articulate, capture, evaluate, export, field, gap, geometry, io, model, numeric, run, surface, synth,
    };
}

#[doc(hidden)]
pub use cli::main;
pub use common::note::{Note, NoteCode};
pub use config::{Config, ConfigError};
pub use gap::{
    camera::record::options::FrameOptions,
    judge::verdict::Verdict,
    record::{drive::Hold, tracks::Streams},
};
pub use io::{RunSummary, RunSummaryError, SummaryJoint, read_run_summary};
pub use model::JointKind;
pub use run::{
    Cancelled, DiagnoseOutcome, DiagnoseRequest, Event, JointSummary, Monitor, Outcome, ReconstructRequest,
    RunError, diagnose, diagnose_frames, joint_of_tracks, reconstruct, reconstruct_all,
};
