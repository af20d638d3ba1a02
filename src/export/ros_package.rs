//! The files of a ROS 2 package.

use std::{collections::BTreeSet, fmt::Write as _};

use super::{
    config::{ExportConfig, UrdfScrew},
    xacro::commanded_joint,
};
use model::{ArticulatedModel, escape_xml as escape, identifier};

/// `package.xml`, which ament installs by itself.
pub(crate) const PACKAGE_XML: &str = "package.xml";
/// `CMakeLists.txt`.
pub(crate) const CMAKE_LISTS: &str = "CMakeLists.txt";

/// Text of `package.xml`.
pub(crate) fn package_xml(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let name = escape(&model.name);
    // `check` refuses any other form.
    let (maintainer, address) = config.maintainer().unwrap_or_default();
    let needs: String =
        ["joint_state_publisher_gui", "launch_ros", "robot_state_publisher", "rviz2", "xacro"]
            .map(|package| format!("  <exec_depend>{package}</exec_depend>\n"))
            .concat();
    format!(
        "<?xml version=\"1.0\"?>\n<package \
         format=\"3\">\n  <name>{name}</name>\n  <version>0.0.1</version>\n  \
         <description>Twin of a recorded object: {name}</description>\n  <maintainer \
         email=\"{}\">{}</maintainer>\n  \
         <license>{}</license>\n  <buildtool_depend>ament_cmake</buildtool_depend>\n{needs}  <export>\n    \
         <build_type>ament_cmake</build_type>\n  </export>\n</package>\n",
        escape(address),
        escape(maintainer),
        escape(&config.license)
    )
}

/// Text of `CMakeLists.txt`, which installs all files at these paths; files in folders are installed by
/// folder.
pub(crate) fn cmake_lists<'a>(model: &ArticulatedModel, paths: impl Iterator<Item = &'a str>) -> String {
    let name = identifier(&model.name);
    let mut folders = BTreeSet::new();
    let mut files = BTreeSet::new();
    for path in paths.filter(|p| ![PACKAGE_XML, CMAKE_LISTS].contains(p)) {
        match path.split_once('/') {
            Some((folder, _)) => folders.insert(folder),
            None => files.insert(path),
        };
    }
    let list = |names: BTreeSet<&str>| names.into_iter().map(|n| format!("  {n}\n")).collect::<String>();
    format!(
        "cmake_minimum_required(VERSION 3.8)\nproject({name})\nfind_package(ament_cmake REQUIRED)\n\
         install(DIRECTORY\n{}  DESTINATION share/${{PROJECT_NAME}})\n\
         install(FILES\n{}  DESTINATION share/${{PROJECT_NAME}})\nament_package()\n",
        list(folders),
        list(files)
    )
}

/// Text of `launch/display.launch.py`: the twin in RViz, with a slider for every joint.
pub(crate) fn display_launch(model: &ArticulatedModel) -> String {
    format!(
        r#""""Shows the twin in RViz, with a slider for every joint."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    share = Path(get_package_share_directory("{name}"))
    description = (share / "{name}.ros.urdf").read_text()
    return LaunchDescription(
        [
            Node(package="robot_state_publisher", executable="robot_state_publisher", parameters=[{{"robot_description": description}}]),
            Node(package="joint_state_publisher_gui", executable="joint_state_publisher_gui"),
            Node(package="rviz2", executable="rviz2", arguments=["-d", str(share / "rviz" / "display.rviz")]),
        ]
    )
"#,
        name = identifier(&model.name)
    )
}

/// Text of `rviz/display.rviz`: the twin in the frame of its root.
pub(crate) fn display_rviz(model: &ArticulatedModel) -> String {
    let root = model.links.first().map_or("world", |l| l.name.as_str());
    format!(
        r"Visualization Manager:
  Class: ''
  Displays:
    - Class: rviz_default_plugins/Grid
      Enabled: true
      Name: Grid
    - Class: rviz_default_plugins/RobotModel
      Description Topic:
        Value: /robot_description
      Enabled: true
      Name: RobotModel
    - Class: rviz_default_plugins/TF
      Enabled: false
      Name: TF
  Global Options:
    Fixed Frame: {root}
  Tools:
    - Class: rviz_default_plugins/MoveCamera
  Views:
    Current:
      Class: rviz_default_plugins/Orbit
      Distance: 2
      Name: Current View
      Pitch: 0.5
      Yaw: 5.5
"
    )
}

/// Text of `config/controllers.yaml`: controllers for the `ros2_control` block, for an empty xacro prefix.
pub(crate) fn controllers(model: &ArticulatedModel, screws: UrdfScrew) -> String {
    let name = identifier(&model.name);
    let mut text = format!(
        "controller_manager:\n  ros__parameters:\n    update_rate: 100\n    joint_state_broadcaster:\n      \
         type: joint_state_broadcaster/JointStateBroadcaster\n    {name}_controller:\n      type: \
         joint_trajectory_controller/JointTrajectoryController\n\n{name}_controller:\n  \
         ros__parameters:\n    joints:\n"
    );
    for joint in &model.joints {
        // Writing to a string cannot fail.
        writeln!(text, "      - {}", commanded_joint(joint, screws).0).ok();
    }
    text.push_str("    command_interfaces:\n      - position\n    state_interfaces:\n      - position\n");
    text.push_str("      - velocity\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::cabinet;

    #[test]
    fn the_package_says_who_maintains_it_and_under_which_license() {
        let config = ExportConfig {
            license: "CC-BY-4.0".to_owned(),
            maintainer: "Ada & Co <ada@example.org>".to_owned(),
            ..ExportConfig::default()
        };
        let text = package_xml(&cabinet(), &config);
        let document = roxmltree::Document::parse(&text).unwrap();
        let of = |tag: &str| document.descendants().find(|n| n.has_tag_name(tag)).unwrap();
        assert_eq!(of("license").text(), Some("CC-BY-4.0"));
        assert_eq!(of("maintainer").text(), Some("Ada & Co"));
        assert_eq!(of("maintainer").attribute("email"), Some("ada@example.org"));
    }

    #[test]
    fn folders_and_files_are_installed_once() {
        let paths = ["a.urdf", "meshes/x.obj", "meshes/y.obj", PACKAGE_XML, "model.sdf", CMAKE_LISTS];
        let text = cmake_lists(&cabinet(), paths.into_iter());
        assert!(text.contains("install(DIRECTORY\n  meshes\n  DESTINATION share/${PROJECT_NAME})"), "{text}");
        assert!(text.contains("install(FILES\n  a.urdf\n  model.sdf\n  DESTINATION"), "{text}");
    }

    #[test]
    fn settings_of_ros_are_yaml() {
        let model = cabinet();
        let yaml: serde_norway::Value = serde_norway::from_str(&display_rviz(&model)).unwrap();
        assert_eq!(yaml["Visualization Manager"]["Global Options"]["Fixed Frame"].as_str(), Some("body"));
        let yaml: serde_norway::Value =
            serde_norway::from_str(&controllers(&model, UrdfScrew::Pair)).unwrap();
        let joints = &yaml["cabinet_controller"]["ros__parameters"]["joints"];
        assert_eq!([joints[0].as_str(), joints[1].as_str()], [Some("door_hinge"), Some("drawer_slide")]);
    }
}
