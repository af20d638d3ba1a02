//! Triangle meshes from PLY and OBJ files.

use std::path::{Path, PathBuf};

use super::{
    obj::{ObjError, parse_obj},
    ply::{PlyError, parse_ply},
};
use common::files;
use common::limits::{FileLimit, MESH};
use surface::TriangleMesh;

/// Why a mesh could not be read.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The disk refused.
    #[error("cannot read {path}: {source}")]
    Disk {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The contents are malformed.
    #[error("{path}: {problem}")]
    Format {
        /// The file.
        path: PathBuf,
        /// The fault, with its line or element.
        problem: MeshFault,
    },
}

/// A fault in the contents of a mesh file.
#[derive(Debug, thiserror::Error)]
pub enum MeshFault {
    /// A PLY file is faulty.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// An OBJ file is faulty.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// An unsupported kind of file.
    #[error("meshes of type '.{0}' are not read; .ply and .obj are")]
    Kind(String),
    /// A vertex with coordinates that are not finite.
    #[error("vertex {0} is not finite")]
    NotFinite(usize),
    /// A triangle with missing vertices.
    #[error("triangle {triangle} names a vertex beyond the last of {count}")]
    Beyond {
        /// Its number, from 0.
        triangle: usize,
        /// Vertices of the mesh.
        count: usize,
    },
}

/// Reads a `.ply` (ASCII or binary little-endian) or `.obj` mesh; faces with more corners become fans of
/// triangles. Vertices are kept as they are, also those that coincide.
///
/// # Errors
/// If the file cannot be read, is larger than 1 GiB, has another format, is damaged, or has values that are
/// not finite or indices beyond the vertices.
pub fn read_mesh(path: &Path) -> Result<TriangleMesh, MeshFileError> {
    read_mesh_within(path, &mut MESH.bytes.clone())
}

/// As [`read_mesh`], for several meshes: `left` is the number of bytes they may still have together.
///
/// # Errors
/// As [`read_mesh`], or if the file has more bytes than are left.
pub(super) fn read_mesh_within(path: &Path, left: &mut u64) -> Result<TriangleMesh, MeshFileError> {
    let disk = |source| MeshFileError::Disk { path: path.to_owned(), source };
    let format = |problem| MeshFileError::Format { path: path.to_owned(), problem };
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let limit = FileLimit {
        bytes: *left,
        what: if *left == MESH.bytes { MESH.what } else { "all meshes together, 1 GiB" },
    };
    let bytes = files::read_limited(path, limit).map_err(disk)?;
    *left -= bytes.len() as u64;
    let mesh = match extension.as_str() {
        "ply" => parse_ply(&bytes).map_err(MeshFault::from),
        // Comments and names of materials may be in any encoding; keywords and numbers are ASCII.
        "obj" => parse_obj(&String::from_utf8_lossy(&bytes)).map_err(MeshFault::from),
        other => Err(MeshFault::Kind(other.to_owned())),
    };
    let mesh = mesh.map_err(format)?;
    check(&mesh).map_err(format)?;
    Ok(mesh)
}

fn check(mesh: &TriangleMesh) -> Result<(), MeshFault> {
    let count = mesh.vertices.len();
    // A NaN compares as false with every bound, so no later check would see it.
    if let Some(i) = mesh.vertices.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(MeshFault::NotFinite(i));
    }
    match mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= count)) {
        Some(triangle) => Err(MeshFault::Beyond { triangle, count }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use export::{LookConfig, look, textured_obj};
    use model::example::box_mesh;

    #[test]
    fn what_is_written_reads_back() {
        let mesh = box_mesh([-0.1, 0.0, 0.2], [0.3, 0.25, 0.4], [10, 200, 77]);
        let back = parse_obj(&textured_obj(&look(&mesh, &[], &LookConfig::default()), "box")).unwrap();
        assert_eq!((&back.triangles, back.colors.len()), (&mesh.triangles, 0));
        assert!(back.vertices.iter().zip(&mesh.vertices).all(|(a, b)| (a - b).norm() < 1e-7));
    }

    #[test]
    fn other_writers_obj_is_read() {
        let text = "# a comment\nmtllib x.mtl\no thing\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn \
            0 0 1\nusemtl m\ns off\nf 1/1/1 2/1 3//1 4\nf -4 -3 -1\n";
        let mesh = parse_obj(text).unwrap();
        assert_eq!((mesh.vertices.len(), mesh.colors.len()), (4, 0));
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
    }

    #[test]
    fn damaged_obj_is_refused_with_its_line() {
        for (text, message) in [
            ("v 0 0\n", "line 1: a vertex has fewer"),
            ("v 0 0 x\n", "line 1: a vertex: invalid float"),
            ("v 0 0 0\nf 1 1\n", "line 2: a face has 2 corners"),
            ("v 0 0 0\nf 1 0 1\n", "line 2: a face names vertex 0 of 1"),
            ("v 0 0 0\nf 1 a 1\n", "line 2: a face corner 'a'"),
        ] {
            let error = parse_obj(text).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!(
            check(&parse_obj("v 0 0 0\nf 1 2 3\n").unwrap())
                .unwrap_err()
                .to_string()
                .contains("beyond the last of 1")
        );
        assert!(check(&parse_obj("v 0 0 nan\n").unwrap()).unwrap_err().to_string().contains("not finite"));
    }

    #[test]
    fn the_truth_of_a_recording_is_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer/truth/state0");
        let part = read_mesh(&folder.join("part_0.ply")).unwrap();
        assert_eq!((part.vertices.len(), part.triangles.len()), (48, 72));
        assert!(read_mesh(&folder.join("seen.npy")).unwrap_err().to_string().contains("'.npy' are not read"));
        assert!(read_mesh(&folder.join("none.ply")).unwrap_err().to_string().contains("cannot read"));
    }
}
