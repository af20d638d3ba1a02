//! `artitwin node`: a ROS 2 node that collects the two states of an object, reconstructs its twin with the
//! pipeline of the command line, and publishes it. It is a DDS participant in pure Rust and needs no ROS
//! installation.
//!
//! ```text
//! subscriptions -> [queues] -> collection (collector: pairs, poses, keyframes -> session/state0, state1)
//! views without a pose -> [queue] -> live_tracking (a thread of its own) -> collection -> outputs
//! views that are kept -> [queue] -> live_map (a thread of its own) -> live_outputs
//! services -> collection
//! actions -> run::reconstruct(session), run::diagnose -> outputs
//! ```
//!
//! ```no_run
//! // As `artitwin node --ros-args -p name:=cabinet` does.
//! node::run(&["--ros-args".into(), "-p".into(), "name:=cabinet".into()])?;
//! # Ok::<(), node::NodeError>(())
//! ```

mod action;
mod action_messages;
mod clock;
mod collect_error;
mod collection;
mod collector;
mod counts;
mod dds_names;
mod diagnosis;
mod diagnostics;
mod environment;
mod error;
mod goal_error;
mod graph;
mod input_count;
mod inputs;
mod job;
mod keyframes;
mod last_results;
mod live_map;
mod live_messages;
mod live_outputs;
mod live_parameters;
mod live_tf;
mod live_tracking;
mod logger;
mod motion_watch;
mod outputs;
mod parameter_file;
mod parameter_messages;
mod parameter_services;
mod parameters;
mod participant;
mod peers;
mod preview_cloud;
mod reach;
mod reconstruction;
mod recorder;
pub mod requests;
mod ros_args;
mod ros_names;
mod rosout;
mod sample;
mod service_server;
mod services;
mod session;
mod session_folder;
mod session_lock;
mod settings;
mod state_bag;
mod synchronizer;
mod track_status;
mod twin;
mod twin_messages;
mod view;
mod work_ahead;

pub use error::NodeError;
pub use recorder::record;
pub use session::{check_arguments, run};
