//! The files of a model that a simulator loads.

use super::{obj::obj, urdf::urdf, urdf::visual_path};
use crate::model::ArticulatedModel;

/// A file in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportFile {
    /// Path relative to the model's folder, with `/`.
    pub path: String,
    /// Contents.
    pub bytes: Vec<u8>,
}

/// `<name>.urdf` and `meshes/visual/<link>.obj` of every link that has a surface. The model must be without findings
/// ([`crate::model::validate`]).
#[must_use]
pub fn urdf_package(model: &ArticulatedModel) -> Vec<ExportFile> {
    let meshes = model.links.iter().filter(|l| !l.visual.is_empty());
    let meshes = meshes.map(|l| ExportFile { path: visual_path(l), bytes: obj(&l.visual).into_bytes() });
    std::iter::once(ExportFile { path: format!("{}.urdf", model.name), bytes: urdf(model).into_bytes() }).chain(meshes).collect()
}
