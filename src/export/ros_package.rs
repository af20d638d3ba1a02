//! The files that make the folder a ROS 2 package.

use crate::model::{ArticulatedModel, escape_xml as escape, identifier};

/// `package.xml`.
#[must_use]
pub fn package_xml(model: &ArticulatedModel) -> String {
    // A package needs a maintainer and a license (REP 149), and the program knows neither.
    let name = escape(&model.name);
    format!(
        "<?xml version=\"1.0\"?>\n<package \
         format=\"3\">\n  <name>{name}</name>\n  <version>0.0.1</version>\n  \
         <description>Twin of a recorded object: {name}</description>\n  <maintainer \
         email=\"nobody@example.com\">nobody</maintainer>\n  \
         <license>unknown</license>\n  <buildtool_depend>ament_cmake</buildtool_depend>\n  <export>\n    \
         <build_type>ament_cmake</build_type>\n  </export>\n</package>\n"
    )
}

/// `CMakeLists.txt`: installs what the URDF names.
#[must_use]
pub fn cmake_lists(model: &ArticulatedModel) -> String {
    let name = identifier(&model.name);
    format!(
        "cmake_minimum_required(VERSION 3.8)\nproject({name})\nfind_package(ament_cmake REQUIRED)\n\
         install(DIRECTORY meshes DESTINATION share/${{PROJECT_NAME}})\n\
         install(FILES {name}.urdf {name}.ros.urdf {name}.xml model.sdf model.config DESTINATION \
         share/${{PROJECT_NAME}})\nament_package()\n"
    )
}
