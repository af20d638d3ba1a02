//! Made objects: parametric articulated objects, ray-cast by a moving depth camera, with all truth known.

mod bvh;
mod cabinet;
mod cabinet_front;
mod carcass;
mod chain;
mod clearance;
mod config;
mod depth_camera;
mod further;
mod generate;
mod look;
mod material;
mod object;
mod observable;
mod path;
mod recording;
mod scene;
mod solid;
mod tabletop;
mod truth;
mod view;

pub use config::{Family, PoseSpread, SynthConfig, SynthConfigError};
pub use depth_camera::DepthCamera;
pub use further::{NoPositions, further_states};
pub use generate::{NoShape, generate};
pub use material::Material;
pub use object::{Object, Part, PartJoint, PartJointKind};
pub use path::CameraPath;
pub use recording::{SynthFrame, SynthState, film, record};
pub use scene::Scene;
pub use solid::{Shape, Solid};
pub use truth::{SeenSample, seen_points};
pub use view::View;
