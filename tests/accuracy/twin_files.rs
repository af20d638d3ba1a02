//! The files of a twin that it is measured by, to be changed in a copy.

use std::path::Path;

use serde_json::Value;

use super::measure::json;

/// Text of the URDF, and the report.
pub struct TwinFiles {
    pub urdf: String,
    pub report: Value,
}

impl TwinFiles {
    /// Reads the twin in a folder.
    pub fn read(folder: &Path) -> Self {
        let urdf = std::fs::read_to_string(folder.join("object.urdf")).unwrap();
        Self { urdf, report: json(&folder.join("report.json")) }
    }

    /// Writes the twin into a new folder, with the meshes of another one.
    pub fn write(&self, folder: &Path, meshes_of: &Path) {
        std::fs::remove_dir_all(folder).ok();
        for kind in std::fs::read_dir(meshes_of.join("meshes")).unwrap() {
            let from = kind.unwrap().path();
            let to = folder.join("meshes").join(from.file_name().unwrap());
            std::fs::create_dir_all(&to).unwrap();
            for mesh in std::fs::read_dir(&from).unwrap() {
                let mesh = mesh.unwrap().path();
                std::fs::copy(&mesh, to.join(mesh.file_name().unwrap())).unwrap();
            }
        }
        std::fs::write(folder.join("object.urdf"), &self.urdf).unwrap();
        std::fs::write(folder.join("report.json"), self.report.to_string()).unwrap();
    }

    /// Where the element of a joint stands in the text.
    pub fn joint(&self, name: &str) -> std::ops::Range<usize> {
        let head = format!("<joint name=\"{name}\"");
        let start = self.urdf.find(&head).unwrap_or_else(|| panic!("no joint {name}"));
        let end = "</joint>";
        start..start + self.urdf[start..].find(end).unwrap() + end.len()
    }
}
