//! `README.md` of a twin's folder, with the purpose of each file.

use std::fmt::Write as _;

use super::{
    config::{Base, ExportConfig, UrdfScrew},
    sdf::SCREW_SDF,
    urdf::SINGLE_JOINT,
    xacro::macro_file,
};
use common::note::{Note, NoteCode};
use model::{ArticulatedModel, Joint, identifier};

/// A sentence on the frames at grasps.
const GRASPS: &str = "\nSites (MJCF), frames (SDF, xacro) and Xforms (USD) named `PART_grasp_K` are places \
    where a parallel gripper can take a part: the origin lies between the fingertips, x is the closing \
    direction, z the approach. Widths are in report.json.\n";

/// The text of `README.md`.
pub(crate) fn guide(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let name = identifier(&model.name);
    let macros = macro_file(model);
    let mut rows = vec![
        (format!("{name}.urdf"), "any simulator that reads URDF"),
        (format!("{name}.xml"), "MuJoCo: the twin, passive; its keyframes are the observed states"),
        ("scene.xml".to_owned(), "MuJoCo: the twin on a floor, with light and camera"),
    ];
    if !model.joints.is_empty() {
        rows.push(("scene_actuated.xml".to_owned(), "the scene with a position actuator a joint"));
    }
    rows.extend([
        ("model.sdf, model.config".to_owned(), "Gazebo, Drake"),
        (format!("{name}.usda"), "USD with UsdPhysics"),
        (format!("{name}.ros.urdf"), "ROS 2: paths by package://"),
        (format!("{name}.urdf.xacro, {macros}"), "ROS 2: with a prefix, held by a link, ros2_control"),
        (format!("config/{name}.srdf"), "MoveIt: group, states, pairs of links that never collide"),
        ("launch/display.launch.py".to_owned(), "ROS 2: the twin in RViz, with sliders"),
        ("viewer.html, report.html".to_owned(), "a browser"),
    ]);
    let mut text =
        format!("# {name}\n\nTwin of a recorded object, by artitwin.\n\n| file | for |\n|---|---|\n");
    // Writing to a string cannot fail, here and below.
    rows.iter().for_each(|(file, what)| writeln!(text, "| `{file}` | {what} |").unwrap_or_default());
    text.push('\n');
    let base = match config.base {
        Base::Fixed => "stands still in the world",
        Base::Floating => "is free",
    };
    writeln!(
        text,
        "The root link {base} in MJCF, SDF and USD; URDF has no word for that, there an option of the \
         simulator decides."
    )
    .ok();
    if model.links.iter().any(|l| !l.grasps.is_empty()) {
        text.push_str(GRASPS);
    }
    screw_notes(model, config).iter().for_each(|n| writeln!(text, "\n{n}.").unwrap_or_default());
    text
}

/// How the files represent each screw.
pub fn screw_notes(model: &ArticulatedModel, config: &ExportConfig) -> Vec<Note> {
    let name = identifier(&model.name);
    let screws = model.joints.iter().filter(|joint| joint.kind.thread_m_per_rad().is_some());
    screws.map(|joint| screw_note(joint, &name, config)).collect()
}

fn screw_note(joint: &Joint, name: &str, config: &ExportConfig) -> Note {
    let turn = &joint.name;
    let advance = joint.advance_name();
    let urdf = match config.urdf_screw {
        UrdfScrew::Pair => format!(
            "{name}.urdf holds it as a slide, {advance}, and the turn {turn} that mimics it; simulators \
             that drop mimic (PyBullet, MuJoCo before 4) get a turn without advance from \
             {SINGLE_JOINT}/{name}.urdf"
        ),
        UrdfScrew::Nearest => format!("{name}.urdf holds it as a turn without advance"),
    };
    let text = format!(
        "{turn} is a screw: {urdf}; model.sdf holds the pair, for Drake, and {SCREW_SDF}, which \
         model.config names, SDF's own screw, for Gazebo; USD holds a turn without advance"
    );
    Note::new(NoteCode::ScrewForms, text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{drawn::plain_looks, package};
    use model::{JointKind, example::cabinet};

    #[test]
    fn every_file_that_is_named_is_written_and_all_are_installed() {
        let mut model = cabinet();
        model.joints[1].kind = JointKind::Screw { pitch_m_per_rad: 0.5 };
        for screws in [UrdfScrew::Pair, UrdfScrew::Nearest] {
            let config = ExportConfig { urdf_screw: screws, ..ExportConfig::default() };
            let files = package(&model, &plain_looks(&model), &config);
            let has = |path: &str| files.iter().any(|f| f.path == path);
            let text = guide(&model, &config);
            let rows = text.lines().filter_map(|l| l.strip_prefix("| `")?.split_once('`'));
            for file in rows.flat_map(|(files, _)| files.split(", ")) {
                assert!(has(file) || file == "report.html", "{file}");
            }
            assert_eq!(has("single_joint/cabinet.urdf"), screws == UrdfScrew::Pair);
            assert!(text.contains("screw.sdf") && has("screw.sdf"), "{text}");
            let cmake = files.iter().find(|f| f.path == "CMakeLists.txt").unwrap();
            let cmake = String::from_utf8(cmake.bytes.clone()).unwrap();
            for file in &files {
                let installed = file.path.split_once('/').map_or(file.path.as_str(), |(folder, _)| folder);
                let is_listed = cmake.lines().any(|l| l.trim() == installed);
                assert_eq!(is_listed, !["package.xml", "CMakeLists.txt"].contains(&installed), "{installed}");
            }
        }
        assert!(screw_notes(&cabinet(), &ExportConfig::default()).is_empty());
    }
}
