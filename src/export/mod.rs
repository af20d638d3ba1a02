//! Files in memory from a model: simulator formats, meshes, textures, viewer, report. Nothing here touches a disk.

mod camera_poses;
mod check;
mod look;
mod mjcf;
#[cfg(test)]
mod names_tests;
pub mod number;
mod obj;
mod package;
mod part_count;
mod picture;
mod preview;
mod report_html;
mod report_json;
mod ros_package;
mod sdf;
mod start;
mod urdf;
mod usda;
mod viewer;

pub use camera_poses::CameraPosesReport;
pub use check::{CheckFinding, Folder, Level, check_folder, require_sound};
pub use look::{Corner, Look, LookConfig, look, looks};
pub use mjcf::mjcf;
pub use obj::{mtl, solid_obj, textured_obj};
pub use package::{ExportConfig, ExportFile, package, urdf_package};
pub use part_count::{EvidencePointReport, PartCountReport};
pub use picture::{Arrow, Picture, PictureError, PictureKind, Window, axis_arrows, cutout_png, part_color};
pub use report_html::{PhotoAndTwin, ReportPictures, report_html};
pub use report_json::{
    DynamicsReport, InputFacts, JointReport, LimitReport, LinkReport, ParentReport, Quantity, REPORT_FORMAT, RecordedCamera, Rendering,
    Report, RunFacts, StageTime, StateReport,
};
pub use sdf::sdf;
pub use start::{InitialMotion, compare_starts, nearest_starts};
pub use urdf::{UrdfScrew, roll_pitch_yaw, ros_urdf, solid_name, solid_path, urdf, visual_path};
pub use usda::usda;
pub use viewer::viewer_html;
