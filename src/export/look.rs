//! The appearance of a link: a decimated mesh with a texture baked from the photos.

use std::collections::BTreeMap;

use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
use nalgebra::Vector3;
use rand_core::SeedableRng as _;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use capture::Capture;
use geometry::Pose;
use model::ArticulatedModel;
use numeric::statistics::median;
use surface::{
    BakeView, Light, Lighting, Paint, RenderItem, Shown, Texture, TriangleMesh, atlas_of_mesh, baked_texture,
    keep_components, render, samples_of_spots, simplify,
};

/// Components of a visual mesh are loose fragments if they have a smaller share of the largest one's
/// triangles.
/// chosen: too small to be missed
const MIN_COMPONENT: f64 = 0.01;
/// Texels per pixel of the photos, as lengths on the surface. chosen: photos are blurred by more than a pixel
const TEXEL_SHARE: f64 = 0.8;
/// Number of spots on a mesh at which photos are compared for exposure and light.
/// derived: a hundred for each of thirty photos
const SPOTS: usize = 3000;
/// Texels across a mesh without photos. chosen: size against what is seen
const PLAIN_TEXELS: f64 = 400.0;

/// Settings of visual meshes and textures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LookConfig {
    /// Largest number of triangles of a part's visual mesh.
    pub max_faces: usize,
    /// Decimation stops before it would move the surface by more than this, meters.
    pub max_error_m: f64,
    /// Longest side of a texture, pixels.
    pub max_texture_px: usize,
}

impl Default for LookConfig {
    fn default() -> Self {
        Self { max_faces: 20_000, max_error_m: 0.001, max_texture_px: 2048 }
    }
}

/// A corner shared by triangles of one chart, with its texture coordinates and its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Vertex of the mesh.
    pub vertex: u32,
    /// Texture coordinates in `[0, 1]`, v up.
    pub uv: [f64; 2],
    /// Unit normal; smooth within a chart, with an edge between charts.
    pub normal: Vector3<f64>,
}

/// A textured mesh, in the frame of its link.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// The mesh.
    pub mesh: TriangleMesh,
    /// Corners; a vertex has one in each of its charts.
    pub corners: Vec<Corner>,
    /// Corners of every triangle of the mesh.
    pub triangles: Vec<[u32; 3]>,
    /// Side of the texture, pixels.
    pub size_px: usize,
    /// The texture, `size_px * size_px` sRGB pixels, row by row from the top.
    pub texture: Vec<[u8; 3]>,
}

impl Look {
    /// The mesh with one vertex per corner, as renderers need it, and the texture coordinates of these
    /// vertices.
    pub fn unwelded_mesh(&self) -> (TriangleMesh, Vec<[f64; 2]>) {
        let vertices = self.corners.iter().map(|c| self.mesh.vertices[c.vertex as usize]).collect();
        let mesh = TriangleMesh { vertices, triangles: self.triangles.clone(), ..TriangleMesh::default() };
        (mesh, self.corners.iter().map(|c| c.uv).collect())
    }

    /// Its texture, for vertices with these coordinates.
    pub fn texture_at<'a>(&'a self, uv: &'a [[f64; 2]]) -> Texture<'a> {
        Texture { uv, size_px: self.size_px, pixels: &self.texture }
    }

    /// The texture as a PNG; empty for a texture without pixels.
    pub fn png_of_texture(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let side = self.size_px as u32;
        let pixels = self.texture.as_flattened();
        // Writing to memory fails only if size and pixels disagree.
        if PngEncoder::new(&mut bytes).write_image(pixels, side, side, ExtendedColorType::Rgb8).is_err() {
            bytes.clear();
        }
        bytes
    }
}

/// Looks of all links, from the photos of all states, in the order of the links.
pub fn link_looks(model: &ArticulatedModel, capture: &Capture, config: &LookConfig) -> Vec<Look> {
    let meshes: Vec<TriangleMesh> = model.links.par_iter().map(|l| reduced_mesh(&l.visual, config)).collect();
    let mut depths: Vec<Vec<Vec<f32>>> = Vec::new();
    for (frames, positions) in capture.states.iter().zip(&model.states) {
        // All parts are rendered together: a texel that another part hides takes no color from the photo.
        let mut items = Vec::with_capacity(meshes.len());
        for (i, mesh) in meshes.iter().enumerate() {
            let world_from_mesh = model.world_from_link(i, positions);
            items.push(RenderItem { mesh, world_from_mesh, paint: Paint::Vertices });
        }
        depths.push(
            frames
                .par_iter()
                .map(|f| render(&items, &f.intrinsics, &f.world_from_camera, false).depth_m)
                .collect(),
        );
    }
    let mut views: Vec<Vec<BakeView>> =
        (0..meshes.len()).map(|link| views_of_link(model, capture, &depths, link)).collect();
    // Every link has the views of all states, in the same order.
    let photos = views.first().map_or(0, Vec::len);
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(0);
    let spots: Vec<Vec<Shown>> = meshes
        .iter()
        .zip(&views)
        .flat_map(|(mesh, views)| samples_of_spots(mesh, views, SPOTS, &mut rng))
        .collect();
    let Lighting { gains, light } = Lighting::of_spots(&spots, photos);
    views.iter_mut().for_each(|v| v.iter_mut().zip(&gains).for_each(|(view, gain)| view.gain = *gain));
    meshes
        .into_par_iter()
        .zip(views)
        .map(|(mesh, views)| painted_look(mesh, &views, &light, config))
        .collect()
}

/// The views of a link in all states; `depths` are the rendered depths of each state's frames, meters.
fn views_of_link<'a>(
    model: &ArticulatedModel,
    capture: &'a Capture,
    depths: &'a [Vec<Vec<f32>>],
    link: usize,
) -> Vec<BakeView<'a>> {
    let mut views = Vec::new();
    for ((frames, depths), positions) in capture.states.iter().zip(depths).zip(&model.states) {
        let world_from_mesh: Pose = model.world_from_link(link, positions);
        let gain = Vector3::repeat(1.0);
        for (frame, depth_m) in frames.iter().zip(depths) {
            views.push(BakeView { frame, world_from_mesh, depth_m, gain });
        }
    }
    views
}

/// The look of one mesh from some views; without views, the texture shows the mesh's own colors.
pub fn look(mesh: &TriangleMesh, views: &[BakeView], config: &LookConfig) -> Look {
    painted_look(reduced_mesh(mesh, config), views, &Light::default(), config)
}

fn reduced_mesh(mesh: &TriangleMesh, config: &LookConfig) -> TriangleMesh {
    let whole = keep_components(mesh, MIN_COMPONENT);
    let mut small = simplify(&whole, config.max_faces, f64::INFINITY);
    // Removes further triangles if this hardly changes the shape.
    small = simplify(&small, 0, (0.25 * config.max_error_m).min(0.0005 * extent_m(mesh)));
    small
}

fn extent_m(mesh: &TriangleMesh) -> f64 {
    mesh.bounds().map_or(0.0, |(lo, hi)| f64::from((hi - lo).norm()))
}

fn painted_look(mesh: TriangleMesh, views: &[BakeView], light: &Light, config: &LookConfig) -> Look {
    let atlas = atlas_of_mesh(&mesh, texel_m(&mesh, views), config.max_texture_px);
    let mut index: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut triangles = Vec::with_capacity(mesh.triangles.len());
    for (t, vertices) in mesh.triangles.iter().enumerate() {
        let uv = atlas.texture_coordinates(t);
        let area_normal = mesh.area_normal(t).cast::<f64>();
        triangles.push([0, 1, 2].map(|k| {
            let corner = *index.entry((vertices[k], atlas.chart[t])).or_insert_with(|| {
                corners.push(Corner { vertex: vertices[k], uv: uv[k], normal: Vector3::zeros() });
                corners.len() as u32 - 1
            });
            // The sum of area normals weighs faces by their area.
            corners[corner as usize].normal += area_normal;
            corner
        }));
    }
    for corner in &mut corners {
        corner.normal = corner.normal.try_normalize(0.0).unwrap_or_else(Vector3::z);
    }
    let normals: Vec<_> = triangles.iter().map(|t| t.map(|c| corners[c as usize].normal)).collect();
    let texture = baked_texture(&mesh, &atlas, &normals, views, light);
    Look { mesh, corners, triangles, size_px: atlas.size_px, texture }
}

/// Size of a texel, meters: slightly smaller than the median pixel of the photos on the mesh.
fn texel_m(mesh: &TriangleMesh, views: &[BakeView]) -> f64 {
    let center = mesh.bounds().map(|(lo, hi)| nalgebra::center(&lo, &hi).cast::<f64>());
    let mut pixels_m = Vec::new();
    if let Some(center) = center {
        for v in views {
            let depth_m = v.frame.in_camera(&(v.world_from_mesh * center)).z;
            if depth_m > 0.0 {
                pixels_m.push(depth_m / v.frame.intrinsics.fx);
            }
        }
    }
    median(pixels_m).map_or(extent_m(mesh) / PLAIN_TEXELS, |m| TEXEL_SHARE * m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::{box_mesh, cabinet};

    #[test]
    fn a_mesh_without_photos_keeps_its_color() {
        let mesh = box_mesh([0.0; 3], [0.4, 0.3, 0.02], [200, 60, 50]);
        let look = look(&mesh, &[], &LookConfig::default());
        assert_eq!((look.mesh.triangles.len(), look.corners.len()), (12, 24));
        for c in &look.corners {
            let x = (c.uv[0] * look.size_px as f64) as usize;
            let y = ((1.0 - c.uv[1]) * look.size_px as f64) as usize;
            assert_eq!(look.texture[y * look.size_px + x], [200, 60, 50]);
            assert!((c.normal.amax() - 1.0).abs() < 1e-9, "the edges of a box are sharp");
        }
        let decoded = image::load_from_memory(&look.png_of_texture()).unwrap();
        assert_eq!((decoded.width() as usize, decoded.height() as usize), (look.size_px, look.size_px));
    }

    #[test]
    fn there_is_one_for_every_link() {
        assert_eq!(link_looks(&cabinet(), &Capture::default(), &LookConfig::default()).len(), 3);
    }
}
