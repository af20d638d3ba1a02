//! Rules for paths, formats, meshes and textures; returns the convex solids for the rules of overlap.

use std::collections::BTreeMap;

use nalgebra::Point3;
use rayon::prelude::*;

use super::{
    description::{Description, Geometry, ShapeText},
    finding::{Findings, Folder, Level},
    mesh_text::{MaterialFile, MeshText},
    numbers::is_number,
    paths::path_in_folder,
    rule::Rule,
};
use common::limits::{NAMED_MESHES, SHAPES};
use geometry::{bounding_box, box_corners, lattice_directions};
use surface::{ConvexSolid, SolidFit, TriangleMesh, convex_hull, merged_mesh};

/// Largest number of faces of an STL in MuJoCo.
const MAX_STL_FACES: usize = 200_000;
/// Hulls thinner than this are refused or explode, meters. chosen: no part is as thin
const MIN_THICKNESS_M: f64 = 5e-4;
/// Hulls smaller than this are refused, cubic meters. chosen: a cube of a millimeter
const MIN_VOLUME_M3: f64 = 1e-9;
/// Of a hull with more corners than this, only the extremes along as many directions are kept.
const DIRECTIONS: usize = 200;

/// Solids of every link, in the link frame.
pub(super) fn checked_solids(
    description: &Description,
    folder: &Folder,
    urdf: &str,
    found: &mut Findings,
) -> Vec<Vec<ConvexSolid>> {
    let mut basenames: BTreeMap<String, String> = BTreeMap::new();
    let mut solids = Vec::new();
    let mut seen = Vec::new();
    let visuals = Use::visual(description);
    if !affordable(description, folder, urdf, found) {
        return vec![Vec::new(); description.links.len()];
    }
    for link in &description.links {
        let mut visual = Some(TriangleMesh::default());
        for shape in &link.visuals {
            let mesh = mesh_of(shape, folder, urdf, visuals, &mut basenames, found);
            if let Some((path, mesh)) = &mesh {
                check_appearance(path, mesh, shape, folder, found);
            }
            // A surface that is only partly known says nothing about its solids.
            let placed = mesh.and_then(|(_, mesh)| placed(&mesh, shape));
            visual = visual.zip(placed).map(|(all, mesh)| merged_mesh(&[&all, &mesh]));
        }
        let mut own = Vec::new();
        for shape in &link.collisions {
            let solid = match &shape.geometry {
                Geometry::Mesh { scale, .. } => {
                    let mesh = mesh_of(shape, folder, urdf, Use::COLLISION, &mut basenames, found);
                    let Some((file, mesh)) = mesh else {
                        continue;
                    };
                    // The rules of numbers report it.
                    if scale.iter().any(|s| !is_number(*s) || *s == 0.0) {
                        continue;
                    }
                    let points: Vec<Point3<f64>> =
                        mesh.points.iter().map(|p| Point3::from(p.coords.component_mul(scale))).collect();
                    let solid = hull(&points)
                        .filter(|h| h.thickness_m() >= MIN_THICKNESS_M && h.volume_m3() >= MIN_VOLUME_M3);
                    if solid.is_none() {
                        found.add_error(
                            Rule::Mesh,
                            &file,
                            "its corners lie in a plane or nearly so: MuJoCo \
                            refuses the hull; make it 2 mm thick",
                        );
                    }
                    solid
                }
                // Converted to polyhedra, so one overlap test serves all shapes.
                primitive => {
                    let mut corners = corners(primitive);
                    corners.retain(|p| p.iter().all(|x| is_number(*x)));
                    hull(&corners)
                }
            };
            own.extend(solid.map(|h| h.transformed(&shape.link_from_shape)));
        }
        seen.push(visual);
        solids.push(own);
    }
    let fits: Vec<Option<SolidFit>> = seen
        .par_iter()
        .zip(&solids)
        .map(|(visual, own)| SolidFit::of_solids(visual.as_ref()?, own))
        .collect();
    for (link, fit) in description.links.iter().zip(fits) {
        if let Some(fit) = fit.filter(|fit| !fit.is_sound()) {
            found.add_warning(Rule::Fit, &link.name, format!("the collision shapes {fit}"));
        }
    }
    solids
}

/// A visual mesh in the frame of its link; `None` for a broken one.
fn placed(mesh: &MeshText, shape: &ShapeText) -> Option<TriangleMesh> {
    let Geometry::Mesh { scale, .. } = &shape.geometry else { return None };
    let places =
        mesh.points.iter().map(|p| shape.link_from_shape * Point3::from(p.coords.component_mul(scale)));
    let vertices: Vec<Point3<f32>> = places.map(|p| p.cast()).collect();
    let sound = vertices.iter().all(|p| p.iter().all(|x| x.is_finite()))
        && mesh.triangles.iter().flatten().all(|i| (*i as usize) < vertices.len());
    let mut triangles = mesh.triangles.clone();
    if scale.product() < 0.0 {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    sound.then_some(TriangleMesh { vertices, triangles, colors: Vec::new() })
}

/// Whether the shapes are few enough, and their meshes together small enough, to be checked.
fn affordable(description: &Description, folder: &Folder, urdf: &str, found: &mut Findings) -> bool {
    let collisions: usize = description.links.iter().map(|l| l.collisions.len()).sum();
    let shapes = description.links.iter().flat_map(|l| l.visuals.iter().chain(&l.collisions));
    let mut all = 0u64;
    for shape in shapes {
        if let Geometry::Mesh { path, .. } = &shape.geometry {
            let bytes = path_in_folder(folder, path, urdf).ok().and_then(|file| folder.get(&file));
            all += bytes.map_or(0, |b| b.len() as u64);
        }
    }
    let problem = if collisions > SHAPES {
        format!("has {collisions} collision shapes; {SHAPES} are the limit: use fewer")
    } else if all > NAMED_MESHES {
        format!(
            "names meshes of {all} bytes, each counted as often as it is named; {NAMED_MESHES} are the \
             limit: use smaller ones"
        )
    } else {
        return true;
    };
    found.add_error(Rule::Mesh, "robot", problem);
    false
}

/// The hull of a mesh's corners; only some of them are used if there are many.
fn hull(points: &[Point3<f64>]) -> Option<ConvexSolid> {
    if points.len() <= DIRECTIONS {
        return convex_hull(points);
    }
    // The hull of some corners is inside the hull of all: it can miss an overlap but not invent one.
    let mut some = Vec::with_capacity(DIRECTIONS);
    for d in lattice_directions(DIRECTIONS) {
        some.extend(points.iter().max_by(|a, b| a.coords.dot(&d).total_cmp(&b.coords.dot(&d))));
    }
    convex_hull(&some)
}

/// Corners of a primitive shape.
fn corners(geometry: &Geometry) -> Vec<Point3<f64>> {
    match geometry {
        Geometry::Cuboid(size) => box_corners(&Point3::from(-0.5 * size), &Point3::from(0.5 * size)).to_vec(),
        Geometry::Cylinder { radius, length } => (0..48u32)
            .map(|k| {
                let (sin, cos) = (f64::from(k / 2) * std::f64::consts::TAU / 24.0).sin_cos();
                Point3::new(radius * cos, radius * sin, length * (f64::from(k % 2) - 0.5))
            })
            .collect(),
        Geometry::Sphere(radius) => lattice_directions(64).map(|d| Point3::from(d * *radius)).collect(),
        Geometry::Mesh { .. } | Geometry::Other(_) | Geometry::Missing => Vec::new(),
    }
}

/// How the meshes of a kind of shape are checked.
#[derive(Clone, Copy)]
struct Use {
    visual: bool,
    /// Severity if a shape gets no mesh.
    lost: Level,
}

impl Use {
    const COLLISION: Self = Self { visual: false, lost: Level::Error };

    fn visual(description: &Description) -> Self {
        // MuJoCo refuses unreadable meshes if it has to read visuals at all.
        let lost = if description.keeps_visuals { Level::Error } else { Level::Warning };
        Self { visual: true, lost }
    }
}

/// The mesh of a shape with its path in the folder; `None` for primitives, and after a finding.
fn mesh_of(
    shape: &ShapeText,
    folder: &Folder,
    urdf: &str,
    of: Use,
    basenames: &mut BTreeMap<String, String>,
    found: &mut Findings,
) -> Option<(String, MeshText)> {
    let Geometry::Mesh { path, .. } = &shape.geometry else { return None };
    let file = resolve(path, folder, urdf, of, found)?;
    let Some(bytes) = folder.get(&file) else {
        found.add_finding(
            of.lost,
            Rule::Path,
            path,
            "the file is missing: PyBullet refuses the model, others the shape",
        );
        return None;
    };
    let name = file.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
    let first = basenames.entry(name.clone()).or_insert_with(|| file.clone());
    if *first != file {
        found.add_error(
            Rule::Name,
            &file,
            format!(
                "has the same file name as {first}: MuJoCo before 4 strips the folders and mixes them up"
            ),
        );
    }
    let extension = name.rsplit('.').next().unwrap_or_default().to_owned();
    let mesh = match extension.as_str() {
        "obj" => MeshText::of_obj(&String::from_utf8_lossy(bytes)),
        "stl" => stl(path, &file, bytes, of, found)?,
        "dae" => {
            found.add_finding(
                of.lost,
                Rule::Format,
                path,
                "a DAE is refused by MuJoCo and not drawn by Drake; use OBJ",
            );
            return None;
        }
        // PyBullet refuses a whole model because of one GLB or PLY.
        other => {
            found.add_error(
                Rule::Format,
                path,
                format!("'.{other}' is refused or dropped by MuJoCo, PyBullet or Drake; use OBJ"),
            );
            return None;
        }
    };
    is_healthy(&file, &mesh, extension == "stl", of, found).then_some((file, mesh))
}

/// The mesh of an STL file.
fn stl(path: &str, file: &str, bytes: &[u8], of: Use, found: &mut Findings) -> Option<MeshText> {
    if of.visual {
        found.add_warning(Rule::Format, path, "an STL has no colors, and Drake draws none; use OBJ");
    } else {
        found.add_error(Rule::Format, path, "Drake refuses STL for collision; use OBJ");
    }
    let mesh = MeshText::of_stl(bytes);
    if mesh.is_none() {
        found.add_error(Rule::Mesh, file, "is no whole STL, neither binary nor text");
    }
    mesh
}

/// The path of a mesh in the folder; `None`, with a finding, if there is no such file.
fn resolve(path: &str, folder: &Folder, urdf: &str, of: Use, found: &mut Findings) -> Option<String> {
    if path.starts_with("package://") && !urdf.ends_with(".ros.urdf") {
        found.add_finding(
            of.lost,
            Rule::Path,
            path,
            "package:// fails in MuJoCo and loses all shapes in Newton; use a relative path",
        );
    }
    path_in_folder(folder, path, urdf).map_err(|why| found.add_finding(of.lost, Rule::Path, path, why)).ok()
}

fn is_healthy(file: &str, mesh: &MeshText, stl: bool, of: Use, found: &mut Findings) -> bool {
    let before = found.all.len();
    if mesh.faces == 0 {
        found.add_finding(of.lost, Rule::Mesh, file, "has no face");
    }
    if mesh.points.iter().any(|p| !p.iter().all(|x| is_number(*x))) {
        found.add_error(Rule::Mesh, file, "has a vertex that is no finite point");
    }
    if mesh.bad_number {
        found.add_error(
            Rule::Mesh,
            file,
            "has a color, normal or texture coordinate that is no finite number",
        );
    }
    if mesh.bad_index {
        found.add_error(Rule::Mesh, file, "has a face that names a vertex which is not there");
    }
    if stl && mesh.faces > MAX_STL_FACES {
        found.add_error(
            Rule::Mesh,
            file,
            format!("has {} faces; MuJoCo reads {MAX_STL_FACES} of an STL", mesh.faces),
        );
    }
    let extent = bounding_box(mesh.points.iter().copied()).map_or(0.0, |(lo, hi)| (hi - lo).amax());
    let healthy = found.all.len() == before;
    if healthy && extent > 20.0 {
        found.add_warning(Rule::Mesh, file, format!("is {extent:.1} m long: are these millimeters?"));
    }
    healthy
}

/// Checks normals, material and texture of a visual mesh.
fn check_appearance(file: &str, mesh: &MeshText, shape: &ShapeText, folder: &Folder, found: &mut Findings) {
    // Of these formats only OBJ has materials.
    if !file.to_ascii_lowercase().ends_with(".obj") {
        return;
    }
    if mesh.normals == 0 {
        found.add_error(Rule::Mesh, file, "has no normals: Drake's renderer fails");
    }
    if mesh.vertex_colors {
        found.add_warning(
            Rule::Texture,
            file,
            "has vertex colors: most importers drop them, Newton splits the mesh; bake a texture",
        );
    }
    // Names in an OBJ and in its material file are relative to their folder.
    let beside = |name: &str| path_in_folder(folder, name, file).ok().and_then(|path| folder.get(&path));
    let Some(material_file) = &mesh.material_file else { return };
    let Some(bytes) = beside(material_file) else {
        found.add_error(Rule::Texture, file, format!("its material file {material_file} is missing"));
        return;
    };
    let material = MaterialFile::parse(&String::from_utf8_lossy(bytes));
    if material.materials != 1 {
        found.add_warning(
            Rule::Texture,
            file,
            format!("has {} materials; one loads everywhere", material.materials),
        );
    }
    if material.black && !material.textures.is_empty() {
        found.add_error(Rule::Texture, file, "Kd 0 0 0 turns the texture black; write Kd 1 1 1");
    }
    for texture in &material.textures {
        match beside(texture) {
            None => found.add_error(Rule::Texture, file, format!("the texture {texture} is missing")),
            Some(bytes)
                if !bytes.starts_with(b"\x89PNG\r\n\x1a\n")
                    || !texture.to_ascii_lowercase().ends_with(".png") =>
            {
                found.add_error(Rule::Texture, file, format!("{texture} is no PNG; MuJoCo refuses others"));
            }
            Some(_) => {}
        }
    }
    if !material.textures.is_empty() {
        // With some tolerance for coordinates with few digits.
        if mesh.uv_range.is_none_or(|[lo, hi]| !(lo >= -1e-4 && hi <= 1.0001)) {
            found.add_warning(
                Rule::Texture,
                file,
                "texture coordinates are missing or leave [0, 1]: Drake smears the texture",
            );
        }
        if shape.material.is_some() {
            found.add_warning(
                Rule::Texture,
                file,
                "a <material> in the URDF replaces the texture in Newton; leave it out",
            );
        }
    }
}
