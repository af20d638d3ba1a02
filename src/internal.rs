//! What the tests and benches of this repository use beside the API, by layer. No part of the API: it changes
//! without notice.

#![allow(missing_docs, reason = "documented where it is defined")]

pub mod capture {
    pub use crate::capture::{
        Capture, CaptureConfig, CaptureError, Correspondence, NoiseConfig, RefinePoses, RgbdFrame,
        TrackCamera, scene_box,
    };
}
pub mod config {
    pub use crate::config::{Config, Layers};
}
pub mod evaluate {
    pub use crate::evaluate::{
        EvaluateOptions, Evaluation, EvaluationReport, RunFiles, Truth, read_truth, run,
    };
}
pub mod export {
    pub use crate::export::{
        ExportConfig, Folder, Level, Look, LookConfig, check_folder, looks, urdf_package,
    };
}
pub mod field {
    pub use crate::field::{
        BurnEngine, CpuEngine, EngineError, EngineState, FieldConfig, FieldEngine, FieldParams, FieldTrainer,
        HalfMotion, InstructionSet, ObjectField, Occupancy, RadianceCheckpoint, RadianceConfig,
        RadianceInput, RadianceLosses, RadianceModel, RadianceTrainer, SampleBatch, SdfTarget, StepPhase,
        TrainConfig, TrainInput,
    };
}
pub mod gap {
    pub mod camera {
        pub mod model {
            pub mod small_motion {
                pub use crate::gap::camera::model::small_motion::twist_motion;
            }
        }
    }
    pub mod record {
        pub mod command {
            pub use crate::gap::record::command::Told;
        }
        pub mod drive {
            pub use crate::gap::record::drive::Hold;
        }
        pub mod inputs {
            pub use crate::gap::record::inputs::complete;
        }
        pub mod tracks {
            pub use crate::gap::record::tracks::Streams;
        }
    }
}
pub mod geometry {
    pub use crate::geometry::{Grid3, Intrinsics, Pose, SceneBox};
}
pub mod io {
    pub use crate::io::image_codec;
    pub use crate::io::{
        BagWriter, DatasetLayout, MAX_MODEL_BYTES, OfferedQos, OnnxError, OnnxMatcher, Place, ResultKind,
        RunDir, inspect, inspect_with, open, pinhole, read_frame_run, read_gap_report, read_joint_log,
        read_mesh, read_model, read_model_folder, read_npy, read_run_summary, read_seen_twin, read_urdf,
        track_camera, twin_of, write_synth, write_synth_bag, write_synth_dataset, write_true_twin,
    };
    pub mod ros2msg {
        pub use crate::io::ros2msg::{
            CameraInfo, CompressedFront, CompressedImage, Header, Image, ImageFront, JointState, Odometry,
            PoseStamped, Quaternion, TfMessage, Time, Transform, TransformStamped, Vector3, WrenchStamped,
            decode, encode,
        };
        pub mod definitions {
            pub use crate::io::ros2msg::definitions::{RosMessage, definitions};
        }
        pub mod diagnostic {
            pub use crate::io::ros2msg::diagnostic::{DiagnosticArray, DiagnosticStatus, KeyValue};
        }
        pub mod gap {
            pub use crate::io::ros2msg::gap::{
                DiagnoseFeedback, DiagnoseGoal, DiagnoseResult, GapFinding, GapParameter, GapReport,
            };
        }
        pub mod imu {
            pub use crate::io::ros2msg::imu::Imu;
        }
        pub mod markers {
            pub use crate::io::ros2msg::markers::{Color, Marker, MarkerArray};
        }
        pub mod odometry {
            pub use crate::io::ros2msg::odometry::FullOdometry;
        }
        pub mod point_cloud {
            pub use crate::io::ros2msg::point_cloud::PointCloud2;
        }
        pub mod status {
            pub use crate::io::ros2msg::status::{
                CollectionStatus, ReconstructFeedback, ReconstructGoal, ReconstructResult, SetStateRequest,
                SetStateResponse, TriggerResponse,
            };
        }
        pub mod text {
            pub use crate::io::ros2msg::text::{Clock, Text};
        }
    }
    pub mod rvl {
        pub use crate::io::rvl::{decode, encode};
    }
}
pub mod model {
    pub use crate::model::{
        ArticulatedModel, Inertial, Joint, JointDynamics, JointEvidence, JointKind, Limit, LimitPolicy,
        LimitSource, Link, Material, ModelConfig, MovingPart, PartNames, TypeScores, build, named, validate,
    };
}
#[cfg(feature = "node")]
pub mod node {
    pub use crate::node::check_arguments;
}
pub mod random {
    pub use crate::random::stage_rng;
}
pub mod run {
    pub use crate::run::{Checkpoint, Fingerprint, Monitor, Stages, Twin, compare, reconstruct_twin};
}
pub mod surface {
    pub use crate::surface::{
        DistanceOptions, LiveMap, LiveSettings, MeshChunk, MeshDistance, Moved, NextView, Paint, PixelRole,
        RenderItem, TriangleMesh, TsdfView, TsdfVolume, Unseen, UnseenPatch, marching_cubes, merge, render,
        sample_surface, signed_distance, simplify,
    };
}
pub mod synth {
    pub use crate::synth::{
        DepthCamera, DepthErrors, Effect, Family, HandheldSensor, HandleStyle, Light, Material, Object, Part,
        PartJointKind, PoseSpread, Scene, Solid, SynthConfig, SynthState, View, film, further_states,
        generate, record,
    };
}
