//! OBJ meshes: vertices, their colors, faces.

use super::mesh_faces::{FaceError, MAX_ELEMENTS, fan};
use surface::TriangleMesh;

/// Why an OBJ text is no mesh.
#[derive(Debug, thiserror::Error)]
pub enum ObjError {
    /// An unusable line.
    #[error("line {line}: {fault}")]
    Line {
        /// Line number, from 1.
        line: usize,
        /// Its fault.
        fault: ObjFault,
    },
    /// More than are taken.
    #[error("more than {MAX_ELEMENTS} vertices or faces")]
    Large,
}

/// A fault in a line of an OBJ text.
#[derive(Debug, thiserror::Error)]
pub enum ObjFault {
    /// A coordinate without a number.
    #[error("a vertex: {0}")]
    Coordinate(#[from] std::num::ParseFloatError),
    /// Too few coordinates.
    #[error("a vertex has fewer than three coordinates")]
    Coordinates,
    /// A corner without a number.
    #[error("a face corner '{word}': {source}")]
    Corner {
        /// The corner.
        word: String,
        /// Why it is none.
        source: std::num::ParseIntError,
    },
    /// A corner beyond the vertices so far.
    #[error("a face names vertex {word} of {count}")]
    Beyond {
        /// The corner.
        word: String,
        /// Vertices so far.
        count: i64,
    },
    /// A face of too few corners.
    #[error(transparent)]
    Face(#[from] FaceError),
}

/// Reads OBJ text. Colors are read where every vertex has one.
pub(super) fn parse_obj(text: &str) -> Result<TriangleMesh, ObjError> {
    let mut mesh = TriangleMesh::default();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        let result = match words.next() {
            Some("v") => obj_vertex(words, &mut mesh),
            Some("f") => obj_face(words, &mut mesh),
            _ => Ok(()),
        };
        result.map_err(|fault| ObjError::Line { line: number + 1, fault })?;
        if mesh.vertices.len() > MAX_ELEMENTS || mesh.triangles.len() > MAX_ELEMENTS {
            return Err(ObjError::Large);
        }
    }
    // Colors of some vertices could not be assigned to theirs.
    if mesh.colors.len() != mesh.vertices.len() {
        mesh.colors.clear();
    }
    Ok(mesh)
}

fn obj_vertex<'a>(words: impl Iterator<Item = &'a str>, mesh: &mut TriangleMesh) -> Result<(), ObjFault> {
    let values = words.take(7).map(str::parse).collect::<Result<Vec<f32>, _>>()?;
    let [x, y, z, rest @ ..] = values.as_slice() else { return Err(ObjFault::Coordinates) };
    mesh.vertices.push([*x, *y, *z].into());
    // Three more values are a color (an extension of many writers); a single one is a weight.
    if let [r, g, b] = rest {
        mesh.colors.push([r, g, b].map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8));
    }
    Ok(())
}

/// Index of a corner's vertex; `count`: vertices read so far.
fn vertex_index(word: &str, count: i64) -> Result<u32, ObjFault> {
    // vertex/texture/normal: the first is the vertex.
    let index: i64 = word
        .split('/')
        .next()
        .unwrap_or_default()
        .parse()
        .map_err(|source| ObjFault::Corner { word: word.to_owned(), source })?;
    // OBJ counts from 1; negative numbers count back from the vertex given last.
    let index = if index < 0 { count + index } else { index - 1 };
    u32::try_from(index).ok().ok_or_else(|| ObjFault::Beyond { word: word.to_owned(), count })
}

fn obj_face<'a>(words: impl Iterator<Item = &'a str>, mesh: &mut TriangleMesh) -> Result<(), ObjFault> {
    let count = mesh.vertices.len() as i64;
    let corners = words.map(|word| vertex_index(word, count)).collect::<Result<Vec<u32>, ObjFault>>()?;
    Ok(fan(&corners, &mut mesh.triangles)?)
}
