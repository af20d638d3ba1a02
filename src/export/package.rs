//! The files of a model that simulators load, in one folder.

use serde::{Deserialize, Serialize};

use super::{
    look::{Look, LookConfig, look},
    mjcf::mjcf,
    obj::{mtl, solid_obj, textured_obj},
    preview::{thumbnail, turntable},
    ros_package::{cmake_lists, package_xml},
    sdf::{model_config, sdf},
    urdf::{UrdfScrew, ros_urdf, solid_name, solid_path, urdf, visual_path},
    usda::usda,
    viewer::viewer_html,
};
use crate::model::{ArticulatedModel, identifier};

/// Choices among ways to say the same to a simulator.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExportConfig {
    /// How URDF holds a screw joint.
    pub urdf_screw: UrdfScrew,
}

/// A file in memory.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportFile {
    /// Path relative to the model's folder, with `/`.
    pub path: String,
    /// Contents.
    #[serde(with = "crate::geometry::bytes")]
    pub bytes: Vec<u8>,
}

/// All files of a model but its report: URDF (for simulators and for ROS), MJCF, SDF, USD, ROS package,
/// meshes, textures, previews, viewer. `looks` in the order of the links. The model must be without findings
/// ([`crate::model::validate`]).
#[must_use]
pub fn package(model: &ArticulatedModel, looks: &[Look], config: &ExportConfig) -> Vec<ExportFile> {
    let name = identifier(&model.name);
    // Encoded once: the folder and the viewer hold the same textures.
    let textures: Vec<Vec<u8>> = looks.iter().map(Look::png).collect();
    let texts = [
        (format!("{name}.urdf"), urdf(model, config.urdf_screw)),
        (format!("{name}.ros.urdf"), ros_urdf(model, config.urdf_screw)),
        (format!("{name}.xml"), mjcf(model)),
        ("model.sdf".to_owned(), sdf(model)),
        ("model.config".to_owned(), model_config(model)),
        (format!("{name}.usda"), usda(model, looks)),
        ("package.xml".to_owned(), package_xml(model)),
        ("CMakeLists.txt".to_owned(), cmake_lists(model)),
        ("viewer.html".to_owned(), viewer_html(model, looks, &textures)),
    ];
    let mut files: Vec<ExportFile> =
        texts.into_iter().map(|(path, text)| ExportFile { path, bytes: text.into_bytes() }).collect();
    for ((link, look), png) in model.links.iter().zip(looks).zip(textures) {
        let path = visual_path(link);
        let stem = path.trim_end_matches(".obj").to_owned();
        files.push(ExportFile { path, bytes: textured_obj(look, &link.name).into_bytes() });
        files.push(ExportFile { path: format!("{stem}.mtl"), bytes: mtl(&link.name).into_bytes() });
        files.push(ExportFile { path: format!("{stem}.png"), bytes: png });
        for (k, solid) in link.collision.iter().enumerate() {
            files.push(ExportFile {
                path: solid_path(link, k),
                bytes: solid_obj(solid, &solid_name(link, k)).into_bytes(),
            });
        }
    }
    files.push(ExportFile { path: "preview/thumbnail.png".to_owned(), bytes: thumbnail(model) });
    files.push(ExportFile { path: "preview/turntable.gif".to_owned(), bytes: turntable(model) });
    files
}

/// [`package`] of a model without photos: the meshes' own colors are their textures.
#[must_use]
pub fn urdf_package(model: &ArticulatedModel) -> Vec<ExportFile> {
    let looks: Vec<Look> = model.links.iter().map(|l| look(&l.visual, &[], &LookConfig::default())).collect();
    package(model, &looks, &ExportConfig::default())
}
