//! Bakes photos into a texture.

use nalgebra::{IsometryMatrix3, Point3, UnitQuaternion, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use super::{Atlas, Light, Shown, TriangleMesh, sample_surface};
use capture::RgbdFrame;
use geometry::{Pose, bilinear};

/// A point farther behind a view's surface than this share of its depth is hidden in that view. chosen:
/// beyond errors of depth and surface
const DEPTH_SHARE: f64 = 0.015;
/// A view at a smaller cosine of incidence is not used. chosen: 81 deg; texels get seven times as long
const MIN_COSINE: f64 = 0.15;
/// Exponent of cosine over depth in a view's weight: the best views count most.
const SHARPNESS: i32 = 3;
/// Pixels at the border of an image that are not used. chosen: images are worst there
const BORDER_PX: f64 = 3.0;
/// Scale of the color difference (levels) from which views disagree: highlights, wrong alignment. chosen: a
/// tenth of the levels
const DISAGREEMENT: f32 = 24.0;
/// Color where there is neither a view nor a vertex color.
const PLAIN: [u8; 3] = [150; 3];

/// A photo as seen from a mesh.
pub struct BakeView<'a> {
    /// Photo, depth and camera.
    pub frame: &'a RgbdFrame,
    /// Where the mesh stood in the world.
    pub world_from_mesh: Pose,
    /// z-depth of the whole object rendered for that camera, meters; 0 where there is none.
    pub depth_m: &'a [f32],
    /// How much brighter the photo is than the others, by channel.
    pub gain: Vector3<f32>,
}

/// Samples of the photos at `count` spots of a mesh, one list a spot, in the order of the views.
pub fn samples_of_spots(
    mesh: &TriangleMesh,
    views: &[BakeView],
    count: usize,
    rng: &mut impl Rng,
) -> Vec<Vec<Shown>> {
    let spots = sample_surface(mesh, count, rng);
    let eyes: Vec<Eye> = views.iter().map(Eye::of_view).collect();
    let spots = spots.points.par_iter().zip(&spots.normals).with_min_len(64);
    spots.map(|(point, normal)| samples_of_spot(&eyes, &point.cast(), &normal.cast())).collect()
}

/// Samples of all photos with a view of the spot.
fn samples_of_spot(eyes: &[Eye], point: &Point3<f64>, normal: &Vector3<f64>) -> Vec<Shown> {
    let mut samples = Vec::new();
    for (photo, eye) in eyes.iter().enumerate() {
        if let Some((weight, color)) = eye.weighted_color(point, normal) {
            samples.push(Shown { photo, weight, color, normal: eye.view.world_from_mesh.rotation * normal });
        }
    }
    samples
}

/// A texel on the surface.
struct Texel {
    index: u32,
    point: Point3<f64>,
    normal: Vector3<f64>,
    color: [u8; 3],
}

/// The texture of a mesh, `size_px * size_px` sRGB pixels with the effect of the light taken out. Each texel
/// is the weighted mean of its agreeing views (frontal and near ones count most), or the mesh's own color
/// where no view shows it; around the charts it is the nearest color. `normals` are unit normals at the
/// corners of every triangle.
pub fn baked_texture(
    mesh: &TriangleMesh,
    atlas: &Atlas,
    normals: &[[Vector3<f64>; 3]],
    views: &[BakeView],
    light: &Light,
) -> Vec<[u8; 3]> {
    let texels = texels_of_triangles(mesh, atlas, normals);
    let eyes: Vec<Eye> = views.iter().map(Eye::of_view).collect();
    let colors: Vec<[u8; 3]> = texels
        .par_iter()
        .with_min_len(512)
        .map_init(Vec::new, |samples, t| color_by_views(t, &eyes, light, samples).unwrap_or(t.color))
        .collect();
    let mut texture: Vec<Option<[u8; 3]>> = vec![None; atlas.size_px * atlas.size_px];
    for (texel, color) in texels.iter().zip(colors) {
        texture[texel.index as usize] = Some(color);
    }
    // Fills the margins around charts: filtering reads them.
    for _ in 0..3 {
        texture = spread_colors(&texture, atlas.size_px);
    }
    texture.into_iter().map(|c| c.unwrap_or(PLAIN)).collect()
}

/// All texels whose middle lies in a triangle.
fn texels_of_triangles(mesh: &TriangleMesh, atlas: &Atlas, normals: &[[Vector3<f64>; 3]]) -> Vec<Texel> {
    let mut found = Vec::new();
    let size = atlas.size_px;
    for (t, c) in atlas.corners_px.iter().enumerate() {
        let turn = (c[1] - c[0]).perp(&(c[2] - c[0]));
        if turn.abs() < 1e-12 || mesh.area_normal(t) == Vector3::zeros() {
            continue;
        }
        let lo = c[0].inf(&c[1]).inf(&c[2]);
        let hi = c[0].sup(&c[1]).sup(&c[2]);
        let corners = mesh.corners(t).map(|p| p.coords.cast::<f64>());
        let colors = mesh.triangles[t].map(|v| mesh.colors.get(v as usize).copied().unwrap_or(PLAIN));
        for y in (lo.y - 0.5).floor().max(0.0) as usize..=((hi.y as usize).min(size - 1)) {
            for x in (lo.x - 0.5).floor().max(0.0) as usize..=((hi.x as usize).min(size - 1)) {
                let p = nalgebra::Point2::new(x as f64 + 0.5, y as f64 + 0.5);
                let b = [(c[1] - p).perp(&(c[2] - p)) / turn, (c[2] - p).perp(&(c[0] - p)) / turn];
                let weights = [b[0], b[1], 1.0 - b[0] - b[1]];
                // A texel on a shared side belongs to both triangles.
                if weights.iter().any(|w| *w < -1e-9) {
                    continue;
                }
                let normal = weighted_sum(&normals[t], &weights);
                found.push(Texel {
                    index: (y * size + x) as u32,
                    point: weighted_sum(&corners, &weights).into(),
                    normal: normal.try_normalize(0.0).unwrap_or(normals[t][0]),
                    color: [0, 1, 2].map(|k| weighted_level(colors.map(|c| c[k]), &weights)),
                });
            }
        }
    }
    found
}

fn weighted_sum(v: &[Vector3<f64>; 3], weights: &[f64; 3]) -> Vector3<f64> {
    v[0] * weights[0] + v[1] * weights[1] + v[2] * weights[2]
}

fn weighted_level(levels: [u8; 3], weights: &[f64; 3]) -> u8 {
    let sum: f64 = (0..3).map(|i| weights[i] * f64::from(levels[i])).sum();
    sum.round().clamp(0.0, 255.0) as u8
}

/// Color of a texel by its views; `None` where there is none. `samples` is a buffer for their colors.
fn color_by_views(
    texel: &Texel,
    eyes: &[Eye],
    light: &Light,
    samples: &mut Vec<(f32, Vector3<f32>)>,
) -> Option<[u8; 3]> {
    // Views of one state follow each other, and the mesh has one pose in them: the light is computed once.
    let mut lit: Option<(UnitQuaternion<f64>, Vector3<f32>)> = None;
    samples.clear();
    for eye in eyes {
        let Some((weight, color)) = eye.weighted_color(&texel.point, &texel.normal) else { continue };
        let turn = eye.view.world_from_mesh.rotation;
        let brightness = match lit {
            Some((known, brightness)) if known == turn => brightness,
            _ => light.brightness_at(&(turn * texel.normal)),
        };
        lit = Some((turn, brightness));
        samples.push((weight, color.component_div(&brightness)));
    }
    // docs/method.md (3.7): the mean of all views, then again by their agreement with it. The floor keeps
    // the first mean where no view agrees.
    let first = weighted_mean(samples, |s| s.0)?;
    let agreed = weighted_mean(samples, |s| {
        s.0 * (-(s.1 - first).norm_squared() / (2.0 * DISAGREEMENT * DISAGREEMENT)).exp().max(1e-6)
    })?;
    // The cast rounds and limits to a byte.
    Some(agreed.map(|c| (c + 0.5) as u8).into())
}

/// Mean of the colors of samples; `None` where the weights sum to zero.
fn weighted_mean(
    samples: &[(f32, Vector3<f32>)],
    weight: impl Fn(&(f32, Vector3<f32>)) -> f32,
) -> Option<Vector3<f32>> {
    let total: f32 = samples.iter().map(&weight).sum();
    (total > 0.0).then(|| samples.iter().map(|s| s.1 * weight(s)).sum::<Vector3<f32>>() / total)
}

/// A view with the pose of the mesh in its camera.
struct Eye<'a> {
    view: &'a BakeView<'a>,
    camera_from_mesh: IsometryMatrix3<f64>,
}

impl<'a> Eye<'a> {
    fn of_view(view: &'a BakeView<'a>) -> Self {
        let camera_from_mesh = view.frame.world_from_camera.inverse() * view.world_from_mesh;
        Self { view, camera_from_mesh: nalgebra::convert(camera_from_mesh) }
    }

    /// Weight and color of a point on the mesh; `None` where the view does not show it.
    fn weighted_color(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> Option<(f32, Vector3<f32>)> {
        let BakeView { frame, depth_m, gain, .. } = self.view;
        let k = &frame.intrinsics;
        let p = self.camera_from_mesh * point;
        let cosine = -(self.camera_from_mesh * normal).dot(&p.coords) / p.coords.norm();
        if cosine < MIN_COSINE {
            return None;
        }
        let (u, v) = k.project(&p)?;
        if !(u >= BORDER_PX
            && v >= BORDER_PX
            && u < k.width as f64 - 1.0 - BORDER_PX
            && v < k.height as f64 - 1.0 - BORDER_PX)
        {
            return None;
        }
        let pixel = k.pixel_at(u, v)?;
        let model = f64::from(depth_m[pixel]);
        let measured = f64::from(frame.depth_m[pixel]);
        // Readings scatter more than the depth of the model: they get three times its tolerance.
        let hidden = (model > 0.0 && p.z > model * (1.0 + DEPTH_SHARE))
            || (measured > 0.0 && p.z > measured * (1.0 + 3.0 * DEPTH_SHARE));
        if hidden || !frame.is_object(pixel) {
            return None;
        }
        let color =
            bilinear(|i| Vector3::from(frame.rgb[i].map(f64::from)), k.width, k.height, u, v).cast::<f32>();
        Some(((cosine / p.z).powi(SHARPNESS) as f32, color.component_div(gain)))
    }
}

/// The texture with empty texels filled by the mean of the filled ones around them.
fn spread_colors(texture: &[Option<[u8; 3]>], size: usize) -> Vec<Option<[u8; 3]>> {
    let texels = (0..texture.len()).into_par_iter().with_min_len(4096);
    texels.map(|i| texture[i].or_else(|| mean_around(texture, size, i))).collect()
}

/// Mean color of the filled texels around one; `None` where all are empty.
fn mean_around(texture: &[Option<[u8; 3]>], size: usize, texel: usize) -> Option<[u8; 3]> {
    let x = texel % size;
    let y = texel / size;
    let mut sum = [0u32; 3];
    let mut count = 0;
    for v in y.saturating_sub(1)..=(y + 1).min(size - 1) {
        for u in x.saturating_sub(1)..=(x + 1).min(size - 1) {
            if let Some(c) = texture[v * size + u] {
                (0..3).for_each(|k| sum[k] += u32::from(c[k]));
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum.map(|s| (s / count) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Paint, RenderItem, atlas_of_mesh, render,
        shapes::{box_mesh, color_of, cuboid, looking_at_origin, view_of},
    };
    use geometry::Intrinsics;

    #[test]
    fn what_was_seen_is_painted_and_what_was_not_keeps_its_color() {
        let half = Vector3::new(0.3, 0.2, 0.1);
        let mut mesh = box_mesh(half.cast());
        mesh.colors = vec![[1, 2, 3]; mesh.vertices.len()];
        let k = Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5 };
        let eyes = [Point3::new(0.3, 0.2, 1.0), Point3::new(-0.3, -0.1, 1.1)];
        let shape = cuboid(half);
        let frames: Vec<_> = eyes.iter().map(|e| view_of(&shape, k, looking_at_origin(*e))).collect();
        let item = RenderItem { mesh: &mesh, world_from_mesh: Pose::identity(), paint: Paint::Vertices };
        let depths: Vec<_> =
            frames.iter().map(|f| render(&[item], &k, &f.world_from_camera, false).depth_m).collect();
        let view = |(frame, depth_m): (_, &'static Vec<f32>)| BakeView {
            frame,
            world_from_mesh: Pose::identity(),
            depth_m,
            gain: Vector3::repeat(1.0),
        };
        let depths: &'static Vec<Vec<f32>> = Box::leak(Box::new(depths));
        let views: Vec<BakeView> = frames.iter().zip(depths).map(view).collect();
        let atlas = atlas_of_mesh(&mesh, 0.004, 1024);
        let normals: Vec<_> =
            (0..mesh.triangles.len()).map(|t| [mesh.area_normal(t).cast::<f64>().normalize(); 3]).collect();
        let texture = baked_texture(&mesh, &atlas, &normals, &views, &Light::default());
        let all = texels_of_triangles(&mesh, &atlas, &normals);
        let top: Vec<&Texel> = all
            .iter()
            .filter(|t| t.normal.z > 0.9 && t.point.x.abs() < 0.28 && t.point.y.abs() < 0.18)
            .collect();
        assert!(top.len() > 8000, "{}", top.len());
        let off =
            |t: &&&Texel| (0..3).any(|c| texture[t.index as usize][c].abs_diff(color_of(&t.point)[c]) > 12);
        assert!(top.iter().filter(off).count() < top.len() / 100);
        assert!(all.iter().filter(|t| t.normal.z < -0.9).all(|t| texture[t.index as usize] == [1, 2, 3]));
    }
}
