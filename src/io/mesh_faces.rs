//! Parts shared by all mesh files: faces of any number of corners, and how many a mesh may have.

/// Most vertices or faces of a mesh.
pub(super) const MAX_ELEMENTS: usize = 20_000_000;

/// A face of fewer than three corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a face has {0} corners")]
pub struct FaceError(usize);

/// Triangles from the corners of a face.
pub(super) fn fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) -> Result<(), FaceError> {
    if corners.len() < 3 {
        return Err(FaceError(corners.len()));
    }
    triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    Ok(())
}
