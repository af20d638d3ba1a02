//! RGB-D frames of one object in several states. This crate computes on data only; it uses no file and no
//! network.
//!
//! ```
//! // Stamps in nanoseconds: a depth image belongs to the color image next to it, at most 10 ms away.
//! let [color, depth] = [[0, 33_000_000, 66_000_000], [4_000_000, 70_000_000, 120_000_000]];
//! assert_eq!(capture::pair(&color, &depth, 10_000_000), [Some(0), None, Some(1)]);
//! ```

#[doc(hidden)]
pub mod analytic;
mod board;
mod config;
mod coverage;
mod denoise;
mod depth_noise;
mod error;
mod features;
mod frame;
mod gaps;
mod isolate;
mod mask;
mod mounting;
mod noise;
mod noise_estimate;
mod pixel_weights;
mod poses;
mod recording;
mod register;
mod scene;
mod select;
mod state;
mod stereo;
mod sync;
mod tf;
mod tracking;
mod undistort;
mod window;

pub use board::{
    BoardInView, BoardInWorld, BoardLayout, BoardPlace, BoardSighting, ColorTurn, Paper, UNREAD_BOARD,
    UseBoard, board_scale, find_board, pose_scaled,
};
pub use config::{At, CaptureConfig, TopicConfig};
pub use coverage::{Coverage, SECTORS, coverage};
pub use denoise::{denoise, smoothing_m};
pub use depth_noise::{measured_noise, noise_of};
pub use error::{CaptureError, quoted, stamp_secs};
pub use features::luma;
pub use features::{Correspondence, MatchConfig, PixelMatch, frame_pairs, look_at, match_states, on_object};
pub use frame::{RgbdFrame, cameras, median_over_object};
pub use gaps::close_gaps;
pub use isolate::isolate;
pub use isolate::{CLEARLY, LEAST_PATCH, cell_of_point, clusters_of_cells};
pub use mask::{Unread, dilated_mask};
pub use mounting::{MotionPair, Mounting};
pub use noise::{GRAZING_COSINE, NoiseConfig};
use noise_estimate::noise_factor;
pub use pixel_weights::{object_weights, pixel_weights};
pub use poses::{
    ErrorDraw, PoseAgreement, PoseCorrection, PoseFindings, PoseNoise, RefinePoses, SensorCalibration,
    align_worlds, refine_poses,
};
pub use recording::{Capture, MAX_STATES};
pub use register::DepthRegistration;
pub use scene::scene_box;
pub use select::{common_focus, spread_views};
pub use state::Split;
pub use stereo::{UseColorDepth, fill_from_color};
pub use sync::{nearest_stamp, pair};
pub use tf::{MAX_TF_FRAMES, TfBuffer};
pub use tracking::{
    Accelerometer, LiveTracker, LiveView, Lost, MeasuredUp, NoGravity, Observation, Track, TrackCamera,
    TrackedState, Tracker, TrackingFindings, Unaligned, UpBy, Upright, WorldUp, align_tracks, seen_motion,
    world_up,
};
pub use undistort::{Distortion, UndistortMap};
