//! The simulator files of a model, in one folder.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    config::{ExportConfig, UrdfScrew},
    drawn::{Drawn, drawn_meshes, plain_looks},
    guide::guide,
    look::Look,
    mjcf::mjcf,
    obj::{mtl_text, solid_obj, textured_obj},
    preview::{thumbnail_png, turntable_gif},
    ros_package::{
        CMAKE_LISTS, PACKAGE_XML, cmake_lists, controllers, display_launch, display_rviz, package_xml,
    },
    scene::{actuated_scene, scene_text},
    sdf::{SCREW_SDF, model_config, screw_sdf, sdf},
    srdf::srdf_text,
    urdf::{SINGLE_JOINT, ros_urdf, single_joint_urdf, solid_name, solid_path, urdf},
    usda::usda,
    viewer::viewer_html,
    xacro,
};
use model::{ArticulatedModel, identifier};

/// A file in memory.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportFile {
    /// Path relative to the model's folder, with `/`.
    pub path: String,
    /// Contents.
    #[serde(with = "geometry::bytes")]
    pub bytes: Vec<u8>,
}

/// All files of a model except its report: URDF (for simulators and for ROS), MJCF, SDF, USD, ROS package,
/// meshes, textures, previews, viewer. `looks` are in the order of the links. The model must have no findings
/// ([`model::validate`]).
pub fn package(model: &ArticulatedModel, looks: &[Look], config: &ExportConfig) -> Vec<ExportFile> {
    let drawn = drawn_meshes(model, looks);
    let name = identifier(&model.name);
    let ((usda, viewer), (objs, (thumbnail, turntable))) = rayon::join(
        || rayon::join(|| usda(model, &drawn, config.base), || viewer_html(model, &drawn)),
        || {
            rayon::join(
                || drawn.par_iter().map(|d| textured_obj(&d.look, &d.visual.material)).collect::<Vec<_>>(),
                || rayon::join(|| thumbnail_png(model), || turntable_gif(model, &drawn)),
            )
        },
    );
    let mut texts = description_files(model, config);
    texts.push((format!("{name}.usda"), usda));
    texts.push(("viewer.html".to_owned(), viewer));
    let mut files: Vec<ExportFile> =
        texts.into_iter().map(|(path, text)| ExportFile { path, bytes: text.into_bytes() }).collect();
    for (Drawn { visual, png, .. }, obj) in drawn.into_iter().zip(objs) {
        files.push(ExportFile {
            path: visual.material_path(),
            bytes: mtl_text(&visual.material).into_bytes(),
        });
        files.push(ExportFile { path: visual.texture_path(), bytes: png });
        files.push(ExportFile { path: visual.path, bytes: obj.into_bytes() });
    }
    for link in &model.links {
        for (k, solid) in link.collision.iter().enumerate() {
            files.push(ExportFile {
                path: solid_path(link, k),
                bytes: solid_obj(solid, &solid_name(link, k)).into_bytes(),
            });
        }
    }
    files.push(ExportFile { path: "preview/thumbnail.png".to_owned(), bytes: thumbnail });
    files.push(ExportFile { path: "preview/turntable.gif".to_owned(), bytes: turntable });
    // Last, because it installs all others.
    let lists = cmake_lists(model, files.iter().map(|f| f.path.as_str()));
    files.push(ExportFile { path: CMAKE_LISTS.to_owned(), bytes: lists.into_bytes() });
    files
}

/// Path and text of the files that do not depend on looks.
fn description_files(model: &ArticulatedModel, config: &ExportConfig) -> Vec<(String, String)> {
    let name = identifier(&model.name);
    let screws = config.urdf_screw;
    let threaded = model.joints.iter().any(|j| j.kind.thread_m_per_rad().is_some());
    let twin = format!("{name}.xml");
    let mut texts = vec![
        (format!("{name}.urdf"), urdf(model, screws)),
        (format!("{name}.ros.urdf"), ros_urdf(model, screws)),
        (format!("{name}.urdf.xacro"), xacro::twin_text(model)),
        (xacro::macro_file(model), xacro::macros_text(model, screws)),
        ("scene.xml".to_owned(), scene_text(model, &twin)),
        (twin, mjcf(model, config)),
        ("model.sdf".to_owned(), sdf(model, config)),
        ("model.config".to_owned(), model_config(model, config)),
        (format!("config/{name}.srdf"), srdf_text(model, config)),
        ("config/controllers.yaml".to_owned(), controllers(model, screws)),
        ("launch/display.launch.py".to_owned(), display_launch(model)),
        ("rviz/display.rviz".to_owned(), display_rviz(model)),
        (PACKAGE_XML.to_owned(), package_xml(model, config)),
        ("README.md".to_owned(), guide(model, config)),
    ];
    // In a folder of its own: tools look for the only URDF in the run's folder.
    if threaded && screws == UrdfScrew::Pair {
        texts.push((format!("{SINGLE_JOINT}/{name}.urdf"), single_joint_urdf(model)));
    }
    texts.extend(screw_sdf(model, config).map(|text| (SCREW_SDF.to_owned(), text)));
    if !model.joints.is_empty() {
        texts.push(("scene_actuated.xml".to_owned(), actuated_scene(model, config)));
    }
    texts
}

/// [`package`] for a model without photos: the textures show the meshes' own colors.
pub fn urdf_package(model: &ArticulatedModel, config: &ExportConfig) -> Vec<ExportFile> {
    package(model, &plain_looks(model), config)
}
