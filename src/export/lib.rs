//! Creates files in memory from a model: simulator formats, meshes, textures, viewer, report. Nothing here
//! accesses the disk.
//!
//! ```
//! use export::{ExportConfig, urdf_package};
//!
//! let files = urdf_package(&model::example::cabinet(), &ExportConfig::default());
//! assert!(files.iter().any(|file| file.path.ends_with(".urdf")));
//! ```

mod board_page;
mod camera_poses;
mod check;
mod config;
mod contact_sheet;
pub mod diagnosed;
mod diagnosis_page;
mod difference_report;
mod drawn;
mod gallery_page;
#[cfg(test)]
mod grasp_tests;
mod guide;
mod limit_report;
mod link_report;
mod look;
mod mjcf;
#[cfg(test)]
mod names_tests;
pub mod number;
mod obj;
mod overall;
mod package;
mod page;
mod part_count;
mod picture;
mod preview;
mod report_html;
mod report_json;
mod report_read;
mod ros_package;
mod scene;
mod sdf;
mod srdf;
mod start;
mod traced_urdf;
mod urdf;
mod usda;
mod viewer;
mod xacro;

pub use board_page::board_page;
pub use camera_poses::{CameraPosesReport, CameraTrackingReport, DepthSensorReport, WorldFrameReport};
pub use check::{
    CheckFinding, Description, Folder, Geometry, INERTIA, InertialText, JointText, Level, LimitText,
    LinkText, ShapeText, UnsoundUrdf, check_folder, named_files, package_name,
};
pub use config::ExportConfig;
pub use config::{Base, UrdfScrew};
pub use contact_sheet::contact_sheet;
pub use diagnosis_page::{DiagnosisFacts, diagnosis_page};
pub use difference_report::{StateDifference, Tally};
pub use gallery_page::{GALLERY_MARK, GalleryCard, gallery_page};
pub use guide::screw_notes;
pub use look::look;
pub use look::{Look, LookConfig, link_looks};
pub use obj::textured_obj;
pub use package::{ExportFile, package, urdf_package};
pub use page::counted_noun;
pub use part_count::PartCountReport;
pub use picture::{Picture, PictureKind, Window, axis_arrows, cutout_png, part_color};
pub use report_html::{PhotoAndTwin, ReportPictures, report_html};
pub use report_json::{InputFacts, RecordedCamera, Rendering, Report, RunFacts, StageTime};
pub use report_read::{ReadJoint, ReadReport};
pub use start::InitialMotion;
pub use start::{compare_starts, nearest_starts};
pub use traced_urdf::traced_urdf;
pub use urdf::{SINGLE_JOINT, roll_pitch_yaw};
pub use usda::usda;
