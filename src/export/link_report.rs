//! A link in a report.

use serde::Serialize;

use super::{
    drawn::link_visuals,
    mjcf::quaternion,
    number::round_significant,
    package::ExportFile,
    urdf::{grasp_name, solid_path},
};
use model::{Grasp, Link};

/// Significant digits of numbers.
const DIGITS: usize = 10;

/// A link in the report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkReport {
    /// Name.
    pub name: String,
    /// Mass, kg.
    pub mass_kg: f64,
    /// How mass and inertia were computed.
    pub assumption: String,
    /// Lowest and highest mass under that assumption, kg.
    pub mass_range_kg: [f64; 2],
    /// Number of convex collision solids.
    pub solids: usize,
    /// Area of the surface, square meters.
    pub area_m2: f64,
    /// Area of it that no view saw, in small holes that were closed, square meters.
    pub assumed_area_m2: f64,
    /// Area of walls that no view saw and that are drawn as `meshes/assumed`, square meters.
    pub assumed_walls_m2: f64,
    /// Number of vertices of the mesh.
    pub vertices: usize,
    /// Number of triangles of the mesh.
    pub triangles: usize,
    /// Numbers of triangles in its files.
    pub file_triangles: FileTriangles,
    /// Poses at which a parallel gripper can hold it, best first.
    pub grasps: Vec<GraspReport>,
}

/// Numbers of triangles in the files of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FileTriangles {
    /// In `meshes/visual`: the mesh above, decimated.
    pub visual: usize,
    /// In `meshes/assumed`.
    pub assumed: usize,
    /// In all its solids in `meshes/collision`.
    pub collision: usize,
}

impl FileTriangles {
    fn of_link_files(link: &Link, files: &[ExportFile]) -> Self {
        let mut triangles = Self::default();
        for visual in link_visuals(link) {
            let count = if visual.is_assumed { &mut triangles.assumed } else { &mut triangles.visual };
            *count += file_triangles(files, &visual.path);
        }
        for k in 0..link.collision.len() {
            triangles.collision += file_triangles(files, &solid_path(link, k));
        }
        triangles
    }
}

/// Number of triangles of the OBJ file at a path; 0 without such a file.
fn file_triangles(files: &[ExportFile], path: &str) -> usize {
    let bytes = files.iter().find(|f| f.path == path).map_or(&[][..], |f| &f.bytes);
    bytes.split(|b| *b == b'\n').filter(|line| line.starts_with(b"f ")).count()
}

/// A pose at which a gripper can hold a link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspReport {
    /// Name of its site or frame.
    pub name: String,
    /// Point between the fingertips in the link frame, meters.
    pub position: [f64; 3],
    /// Rotation of the hand in the link frame, w first: x is the closing direction, z the approach.
    pub quaternion: [f64; 4],
    /// Width of the part there, millimeters.
    pub width_mm: f64,
    /// Largest angle between the closing direction and the normal of a face at a pad, degrees.
    pub off_deg: f64,
    /// Whether views saw both faces.
    pub seen: bool,
}

impl LinkReport {
    /// The report of a link; `files` contains its meshes.
    pub fn of_link(l: &Link, files: &[ExportFile]) -> Self {
        Self {
            name: l.name.clone(),
            mass_kg: round_significant(l.inertial.mass_kg, DIGITS),
            assumption: l.inertial.assumption.clone(),
            mass_range_kg: l.inertial.mass_range_kg.map(|m| round_significant(m, DIGITS)),
            solids: l.collision.len(),
            area_m2: round_significant(l.visual.area_m2(), DIGITS),
            assumed_area_m2: round_significant(l.assumed_m2, DIGITS),
            assumed_walls_m2: round_significant(l.assumed.area_m2(), DIGITS),
            vertices: l.visual.vertices.len(),
            triangles: l.visual.triangles.len(),
            file_triangles: FileTriangles::of_link_files(l, files),
            grasps: l.grasps.iter().enumerate().map(|(k, g)| grasp_report(grasp_name(l, k), g)).collect(),
        }
    }
}

fn grasp_report(name: String, grasp: &Grasp) -> GraspReport {
    GraspReport {
        name,
        position: <[f64; 3]>::from(grasp.link_from_grasp.translation.vector)
            .map(|x| round_significant(x, DIGITS)),
        quaternion: quaternion(&grasp.link_from_grasp.rotation).map(|x| round_significant(x, DIGITS)),
        width_mm: round_significant(1e3 * grasp.width_m, 4),
        off_deg: round_significant(grasp.off_rad.to_degrees(), 4),
        seen: grasp.is_seen,
    }
}
