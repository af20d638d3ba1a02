//! Paths of files to which a file of the folder refers.

/// The path in the folder of the file `named` by the file `by`, or why there is none. A package is the folder
/// of the file `by`.
pub(super) fn path_in_folder(named: &str, by: &str) -> Result<String, &'static str> {
    let relative = if let Some(rest) = named.strip_prefix("package://") {
        rest.split_once('/').map_or("", |(_, path)| path)
    } else if named.contains("://")
        || named.starts_with('/')
        || named.contains('\\')
        || named.get(1..2) == Some(":")
    {
        return Err("is not relative to the URDF: other machines do not have it");
    } else {
        named
    };
    if relative.is_empty() {
        return Err("names no file");
    }
    let mut parts: Vec<&str> = by.split('/').collect();
    parts.pop();
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
        for (named, by, path) in [
            ("meshes/a.obj", "x.urdf", "meshes/a.obj"),
            ("./a.png", "meshes/a.mtl", "meshes/a.png"),
            ("../meshes//a.obj", "urdf/x.urdf", "meshes/a.obj"),
            ("package://robot/meshes/a.obj", "x.urdf", "meshes/a.obj"),
        ] {
            assert_eq!(path_in_folder(named, by).as_deref(), Ok(path));
        }
        for (named, words) in [
            ("", "no file"),
            ("package://robot", "no file"),
            ("../a.obj", "out of the folder"),
            ("https://x/a.obj", "not relative"),
            ("file://a.obj", "not relative"),
            ("/a.obj", "not relative"),
            ("C:/a.obj", "not relative"),
            ("meshes\\a.obj", "not relative"),
        ] {
            assert!(path_in_folder(named, "x.urdf").unwrap_err().contains(words), "{named}");
        }
    }
}
