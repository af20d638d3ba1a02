//! Files to which a file of a model folder refers.

use super::{finding::Folder, mesh_text::MaterialFile, paths::path_in_folder};
use common::limits::{URDF, parse_xml, with_declaration};

/// Paths, relative to the folder, of the files to which a file refers: meshes and textures of a URDF, the
/// material file of an OBJ, textures of a material file; those of packages outside of the folder as
/// `package://...`. Paths that leave the folder are left out; an unreadable file refers to none.
pub fn named_files(folder: &Folder, path: &str, bytes: &[u8]) -> Vec<String> {
    let extension = path.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let text = || String::from_utf8_lossy(bytes);
    let named: Vec<String> = match extension.as_str() {
        "urdf" if bytes.len() as u64 <= URDF.bytes => parse_xml(&with_declaration(&text())).map_or_else(
            |_| Vec::new(),
            |robot| robot.descendants().filter_map(|n| n.attribute("filename").map(str::to_owned)).collect(),
        ),
        "obj" => text()
            .lines()
            .filter_map(|line| line.trim_start().strip_prefix("mtllib").map(|m| m.trim().to_owned()))
            .collect(),
        "mtl" => MaterialFile::parse(&text()).textures,
        _ => Vec::new(),
    };
    named.iter().filter_map(|name| path_in_folder(folder, name, path).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_name_others() {
        let urdf = "<robot><material><texture filename='t.png'/></material><link><visual><geometry>\
            <mesh filename='m/a.obj'/></geometry></visual></link><x filename='/etc/passwd'/></robot>";
        let folder = Folder::new();
        assert_eq!(named_files(&folder, "u/x.urdf", urdf.as_bytes()), ["u/t.png", "u/m/a.obj"]);
        assert_eq!(named_files(&folder, "u/m/a.obj", b"mtllib a.mtl\nv 0 0 0\n"), ["u/m/a.mtl"]);
        assert_eq!(named_files(&folder, "u/m/a.mtl", b"newmtl a\nmap_Kd ./a.png\n"), ["u/m/a.png"]);
        assert!(
            named_files(&folder, "u/x.urdf", b"<robot").is_empty()
                && named_files(&folder, "a.stl", b"mtllib b").is_empty()
        );
    }
}
