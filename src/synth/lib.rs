//! Synthetic recordings with ground truth: parametric articulated objects, ray-cast by a moving depth camera.
//!
//! ```
//! use synth::{Family, SynthConfig, generate};
//!
//! let object = generate(&SynthConfig { family: Some(Family::Clamshell), ..SynthConfig::default() })?;
//! assert_eq!(object.parts.len(), 2);
//! # Ok::<(), synth::NoShape>(())
//! ```

mod board;
mod bvh;
mod cabinet;
mod cabinet_front;
mod carcass;
mod chain;
mod clearance;
mod config;
mod depth_camera;
mod depth_errors;
mod edge;
mod finish;
mod fittings;
mod further;
mod generate;
mod handle;
mod imu;
mod lacquer;
mod lattice_noise;
mod light;
mod look;
mod material;
mod object;
mod observable;
mod path;
mod pose_source;
mod reach;
mod recording;
mod room;
mod scene;
mod sensor;
mod smooth;
mod solid;
mod stereo;
mod tabletop;
mod things;
mod truth;
mod view;
mod workspace;

pub use board::Board;
pub use config::{Family, PoseSpread, SynthConfig, SynthConfigError};
pub use depth_camera::DepthCamera;
pub use depth_errors::DepthErrors;
pub use further::{NoPositions, further_states};
pub use generate::{NoShape, generate};
pub use handle::{Handle, HandleKind, HandleStyle};
pub use imu::{ImuReading, imu_bias, optical_from_imu};
pub use lacquer::Lacquer;
pub use light::Light;
pub use material::Material;
pub use object::{BoundingSphere, Object, Part, PartJoint};
pub use path::CameraPath;
pub use pose_source::{ParsePosesError, PoseSource};
pub use recording::{SynthFrame, SynthState, film_take, handheld_camera, record, stereo_camera};
pub use room::Room;
pub use scene::Scene;
pub use sensor::{Effect, HandheldCamera, HandheldSensor, TakePoses};
pub use solid::{Shape, Solid};
pub use stereo::{DepthSource, ParseDepthError, StereoCamera, StereoRig};
pub use truth::{SeenSample, seen_points};
pub use view::View;
pub use workspace::workspace;
