//! An open mesh while its borders are mended.

use crate::{TriangleMesh, drop_unused_vertices};

/// A mesh without colors; its assumed triangles are marked.
#[derive(Clone, Debug)]
pub(super) struct Sheet {
    pub mesh: TriangleMesh,
    /// Per triangle: whether it fills a hole.
    pub is_assumed: Vec<bool>,
}

impl Sheet {
    pub(super) fn of_mesh(mesh: &TriangleMesh) -> Self {
        Self { mesh: mesh.clone(), is_assumed: vec![false; mesh.triangles.len()] }
    }

    /// Keeps the marked triangles; vertices keep their numbers.
    pub(super) fn keep_marked(&mut self, is_kept: &[bool]) {
        let mut each = is_kept.iter();
        self.mesh.triangles.retain(|_| each.next() == Some(&true));
        let mut each = is_kept.iter();
        self.is_assumed.retain(|_| each.next() == Some(&true));
    }

    /// The mesh without unused vertices.
    pub(super) fn used_mesh(&self) -> TriangleMesh {
        drop_unused_vertices(&self.mesh)
    }

    /// Area of the assumed triangles, square meters.
    pub(super) fn assumed_m2(&self) -> f64 {
        let assumed = (0..self.mesh.triangles.len()).filter(|&t| self.is_assumed[t]);
        // Folded: the sum of nothing is -0.
        assumed.fold(0.0, |sum, t| sum + 0.5 * f64::from(self.mesh.area_normal(t).norm()))
    }
}
