//! Paths of files to which a file of the folder refers.

use common::limits::parse_xml;

use super::finding::Folder;

/// The path in the folder of the file `named` by the file `by`, or why there is none. A package is the
/// folder above `by` whose `package.xml` has its name, else the folder of `by` if the file is there; a file
/// of a package outside of the folder keeps its name `package://...`.
pub(super) fn path_in_folder(folder: &Folder, named: &str, by: &str) -> Result<String, &'static str> {
    let own = by.rsplit_once('/').map_or("", |(parent, _)| parent);
    if let Some(rest) = named.strip_prefix("package://") {
        let (package, relative) = rest.split_once('/').unwrap_or((rest, ""));
        if let Some(root) = package_root(folder, package, own) {
            return joined(root, relative);
        }
        let beside = joined(own, relative)?;
        return if folder.contains_key(&beside) {
            Ok(beside)
        } else {
            Ok(format!("package://{package}/{}", joined("", relative)?))
        };
    }
    if named.contains("://") || named.starts_with('/') || named.contains('\\') || named.get(1..2) == Some(":")
    {
        return Err("is not relative to the URDF: other machines do not have it");
    }
    joined(own, named)
}

/// The folder `own`, or one above it, that holds the package.
fn package_root<'a>(folder: &Folder, package: &str, own: &'a str) -> Option<&'a str> {
    let above = std::iter::successors(Some(own), |path| {
        (!path.is_empty()).then(|| path.rsplit_once('/').map_or("", |(parent, _)| parent))
    });
    let manifest =
        |path: &str| if path.is_empty() { MANIFEST.to_owned() } else { format!("{path}/{MANIFEST}") };
    above.into_iter().find(|path| {
        folder.get(&manifest(path)).is_some_and(|bytes| package_name(bytes).as_deref() == Some(package))
    })
}

/// The file that makes a folder a ROS package.
const MANIFEST: &str = "package.xml";

/// The name in a `package.xml`.
#[must_use]
pub fn package_name(manifest: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(manifest);
    let document = parse_xml(&text).ok()?;
    let name = document.root_element().children().find(|n| n.has_tag_name("name"))?;
    name.text().map(|t| t.trim().to_owned())
}

/// The path of `relative` in the folder `at`.
fn joined(at: &str, relative: &str) -> Result<String, &'static str> {
    if relative.is_empty() {
        return Err("names no file");
    }
    // The gap in `package://` is kept.
    let mut parts: Vec<&str> = if at.is_empty() { Vec::new() } else { at.split('/').collect() };
    for part in relative.split('/') {
        match part {
            "" | "." => {}
            ".." if parts.pop().is_some() => {}
            ".." => return Err("leads out of the folder"),
            name => parts.push(name),
        }
    }
    Ok(parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_those_of_the_folder() {
        let manifest = b"<package format='3'>\n<name> pack </name></package>".to_vec();
        let folder = Folder::from([("meshes/a.obj".to_owned(), vec![]), ("p/package.xml".into(), manifest)]);
        for (named, by, path) in [
            ("meshes/a.obj", "x.urdf", "meshes/a.obj"),
            ("./a.png", "meshes/a.mtl", "meshes/a.png"),
            ("../meshes//a.obj", "urdf/x.urdf", "meshes/a.obj"),
            ("package://robot/meshes/a.obj", "x.urdf", "meshes/a.obj"),
            ("package://robot/meshes/a.obj", "p/x.urdf", "package://robot/meshes/a.obj"),
            ("package://pack/meshes/a.obj", "p/urdf/x.urdf", "p/meshes/a.obj"),
            ("a.mtl", "package://robot/meshes/a.obj", "package://robot/meshes/a.mtl"),
        ] {
            assert_eq!(path_in_folder(&folder, named, by).as_deref(), Ok(path));
        }
        for (named, words) in [
            ("", "no file"),
            ("package://robot", "no file"),
            ("package://robot/../../a.obj", "out of the folder"),
            ("../a.obj", "out of the folder"),
            ("https://x/a.obj", "not relative"),
            ("file://a.obj", "not relative"),
            ("/a.obj", "not relative"),
            ("C:/a.obj", "not relative"),
            ("meshes\\a.obj", "not relative"),
        ] {
            assert!(path_in_folder(&folder, named, "x.urdf").unwrap_err().contains(words), "{named}");
        }
    }
}
