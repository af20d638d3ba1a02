//! Files in memory from a model: URDF, meshes, report. Nothing here touches a disk.

pub mod number;
mod obj;
mod package;
mod picture;
mod report_html;
mod report_json;
mod start;
mod urdf;

pub use obj::{mean_color, obj};
pub use package::{ExportFile, urdf_package};
pub use picture::{Arrow, Picture, PictureError, PictureKind, Window, axis_arrows, part_color};
pub use report_html::{PhotoAndTwin, ReportPictures, report_html};
pub use report_json::{
    InputFacts, JointReport, LimitReport, LinkReport, Quantity, REPORT_FORMAT, Report, RunFacts, StageTime, StateReport,
};
pub use start::{InitialMotion, compare_starts, nearest_starts};
pub use urdf::{escape, roll_pitch_yaw, urdf, urdf_with_collision, visual_path};
