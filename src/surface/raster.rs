//! A z-buffer renderer for meshes.

use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

use super::{Texture, TriangleMesh, vertex_normals};
use geometry::{Intrinsics, Pose};

/// Nothing nearer than this is drawn, meters. chosen: no object is so near
const NEAR_M: f32 = 0.01;
/// Image rows of one task.
const ROWS_PER_TASK: usize = 16;
/// Color of pixels without a surface.
pub(crate) const BACKGROUND: [u8; 3] = [255; 3];
/// Color of vertices without one.
const PLAIN: [u8; 3] = [180; 3];
/// Brightness of a surface seen edge-on, relative to one facing the camera. chosen: for the eye
const AMBIENT: f32 = 0.35;
/// A pixel this far outside a side, in triangle heights, still belongs to the triangle: rounding must not
/// open gaps. chosen: above the rounding of single precision
const SIDE_TOLERANCE: f32 = 1e-5;
/// Share of an item's tint in its color. chosen: for the eye
const TINT_SHARE: f32 = 0.65;

/// A mesh to draw.
#[derive(Clone, Copy)]
pub struct RenderItem<'a> {
    /// The mesh.
    pub mesh: &'a TriangleMesh,
    /// Its pose.
    pub world_from_mesh: Pose,
    /// Its colors.
    pub paint: Paint<'a>,
}

/// Colors of a drawn mesh.
#[derive(Clone, Copy, Default)]
pub enum Paint<'a> {
    /// The colors of its vertices.
    #[default]
    Vertices,
    /// The colors of its vertices, mixed with this one.
    Tint([u8; 3]),
    /// A texture; never shaded.
    Texture(Texture<'a>),
}

/// An image with depth; all lists are row-major, one value a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Camera of the image.
    pub intrinsics: Intrinsics,
    /// Pose of the camera.
    pub world_from_camera: Pose,
    /// Colors.
    pub rgb: Vec<[u8; 3]>,
    /// z-depth in meters; 0 where there is no surface.
    pub depth_m: Vec<f32>,
    /// Index of the item seen in each pixel.
    pub item: Vec<Option<u16>>,
}

/// A corner in the image. `inverse` is 1/z; `color` (with a texture: the place in it, pixels) is divided by
/// z: both are linear in the image.
#[derive(Clone, Copy)]
struct Corner {
    u: f32,
    v: f32,
    inverse: f32,
    color: Vector3<f32>,
}

/// A triangle in the image.
struct Facet {
    corners: [Corner; 3],
    item: u16,
}

/// Draws the items as a pinhole camera sees them: perspective-correct, with both sides of every triangle; of
/// equally near items the first is seen. With `shading`, brightness falls with the angle between normal and
/// ray (a lamp at the camera). The result does not depend on the number of threads.
pub fn render(
    items: &[RenderItem],
    intrinsics: &Intrinsics,
    world_from_camera: &Pose,
    shading: bool,
) -> Rendered {
    let width = intrinsics.width;
    let height = intrinsics.height;
    let facets: Vec<Facet> = items
        .iter()
        .enumerate()
        .flat_map(|(i, item)| facets_of_item(item, i as u16, intrinsics, world_from_camera, shading))
        .collect();
    // Each task draws its own rows: no two threads share a pixel, and at equal depths the first item stays.
    let mut bands = vec![Vec::new(); height.div_ceil(ROWS_PER_TASK)];
    for (f, facet) in facets.iter().enumerate() {
        let v = facet.corners.map(|c| c.v);
        let low = v[0].min(v[1]).min(v[2]).max(0.0);
        let high = v[0].max(v[1]).max(v[2]);
        if high >= 0.0 && low <= (height - 1) as f32 {
            let last = (high as usize).min(height - 1) / ROWS_PER_TASK;
            for band in &mut bands[low as usize / ROWS_PER_TASK..=last] {
                band.push(f as u32);
            }
        }
    }
    let count = width * height;
    let mut image = Rendered {
        intrinsics: *intrinsics,
        world_from_camera: *world_from_camera,
        rgb: vec![BACKGROUND; count],
        depth_m: vec![0.0; count],
        item: vec![None; count],
    };
    let size = (width * ROWS_PER_TASK).max(1);
    let rows = image
        .rgb
        .par_chunks_mut(size)
        .zip(image.depth_m.par_chunks_mut(size))
        .zip(image.item.par_chunks_mut(size));
    rows.zip(bands).enumerate().for_each(|(task, (((rgb, depth_m), item), band))| {
        // Inverse depth 0 is infinitely far.
        let mut inverse = vec![0.0; rgb.len()];
        for f in band {
            let facet = &facets[f as usize];
            let paint = items[usize::from(facet.item)].paint;
            visit_nearer_pixels(facet, width, task * ROWS_PER_TASK, &mut inverse, |i, near, color| {
                let color = match paint {
                    Paint::Texture(texture) => texture.color_at(color.xy() / near),
                    Paint::Vertices | Paint::Tint(_) => color / near,
                };
                // The cast rounds and limits to a byte.
                rgb[i] = color.map(|c| (c + 0.5) as u8).into();
                depth_m[i] = 1.0 / near;
                item[i] = Some(facet.item);
            });
        }
    });
    image
}

/// The triangles of an item in the image, cut at the near plane.
fn facets_of_item(
    item: &RenderItem,
    index: u16,
    k: &Intrinsics,
    world_from_camera: &Pose,
    shading: bool,
) -> Vec<Facet> {
    let mesh = item.mesh;
    let camera_from_mesh: Isometry3<f32> = (world_from_camera.inverse() * item.world_from_mesh).cast();
    let positions: Vec<Vector3<f32>> =
        mesh.vertices.par_iter().with_min_len(4096).map(|p| (camera_from_mesh * p).coords).collect();
    let normals = if shading { vertex_normals(mesh) } else { Vec::new() };
    let indices = (0..positions.len()).into_par_iter().with_min_len(4096);
    let colors = indices.map(|i| {
        let light = normals.get(i).map_or(1.0, |n| headlight(&(camera_from_mesh * n), &positions[i]));
        vertex_color(item, i, light)
    });
    let colors: Vec<Vector3<f32>> = colors.collect();
    let mut facets = Vec::with_capacity(mesh.triangles.len());
    for t in &mesh.triangles {
        let whole = t.map(|i| CameraVertex { position: positions[i as usize], color: colors[i as usize] });
        if whole.iter().all(CameraVertex::is_in_front) {
            facets.push(Facet { corners: whole.map(|v| v.image_corner(k)), item: index });
            continue;
        }
        let cut = in_front(&whole);
        // Cut at the near plane, a triangle has up to four corners and is drawn as a fan.
        for i in 2..cut.len() {
            let corners = [cut[0], cut[i - 1], cut[i]].map(|v| v.image_corner(k));
            facets.push(Facet { corners, item: index });
        }
    }
    facets
}

/// Brightness of a surface lit by a lamp at the camera; unit normal and position are in the optical frame.
fn headlight(normal: &Vector3<f32>, position: &Vector3<f32>) -> f32 {
    let cosine = normal.dot(position).abs() / position.norm().max(1e-9);
    AMBIENT + (1.0 - AMBIENT) * cosine
}

/// Color of a vertex at a brightness, levels; with a texture, the place in it, pixels.
fn vertex_color(item: &RenderItem, vertex: usize, light: f32) -> Vector3<f32> {
    let own = Vector3::from(item.mesh.colors.get(vertex).copied().unwrap_or(PLAIN).map(f32::from));
    match item.paint {
        Paint::Vertices => own * light,
        Paint::Tint(t) => own.lerp(&Vector3::from(t.map(f32::from)), TINT_SHARE) * light,
        Paint::Texture(texture) => texture.place_px(vertex).push(0.0),
    }
}

/// A vertex in the optical frame, meters, with its color.
#[derive(Clone, Copy)]
struct CameraVertex {
    position: Vector3<f32>,
    color: Vector3<f32>,
}

impl CameraVertex {
    fn is_in_front(&self) -> bool {
        self.position.z >= NEAR_M
    }

    fn image_corner(&self, k: &Intrinsics) -> Corner {
        let p = self.position;
        let inverse = 1.0 / p.z;
        let u = k.fx as f32 * p.x * inverse + k.cx as f32;
        let v = k.fy as f32 * p.y * inverse + k.cy as f32;
        Corner { u, v, inverse, color: self.color * inverse }
    }
}

/// The part of a triangle in front of the near plane, as a polygon.
fn in_front(triangle: &[CameraVertex; 3]) -> Vec<CameraVertex> {
    let mut kept = Vec::with_capacity(4);
    for i in 0..3 {
        let a = triangle[i];
        let b = triangle[(i + 1) % 3];
        if a.is_in_front() {
            kept.push(a);
        }
        if a.is_in_front() != b.is_in_front() {
            let share = (NEAR_M - a.position.z) / (b.position.z - a.position.z);
            let position = a.position.lerp(&b.position, share);
            kept.push(CameraVertex { position, color: a.color.lerp(&b.color, share) });
        }
    }
    kept
}

/// The pixels between the smallest and the largest place along an axis, among `count` from `first` on; they
/// are counted from `first`.
fn pixels_between(places: [f32; 3], first: usize, count: usize) -> std::ops::Range<usize> {
    let low = places[0].min(places[1]).min(places[2]);
    let high = places[0].max(places[1]).max(places[2]);
    let start = (low.ceil() - first as f32).max(0.0) as usize;
    start..((high.floor() - first as f32 + 1.0).clamp(0.0, count as f32) as usize)
}

/// Visits the pixels of a facet that are nearer than `inverse` says, and updates it. Rows begin at
/// `first_row`.
fn visit_nearer_pixels(
    facet: &Facet,
    width: usize,
    first_row: usize,
    inverse: &mut [f32],
    mut visit: impl FnMut(usize, f32, Vector3<f32>),
) {
    let [a, b, c] = &facet.corners;
    let area = (b.u - a.u) * (c.v - a.v) - (c.u - a.u) * (b.v - a.v);
    // A triangle seen edge-on covers nothing. Dividing by the signed area makes the weights inside positive
    // for both windings.
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let rows = inverse.len() / width;
    let columns = pixels_between([a.u, b.u, c.u], 0, width);
    for row in pixels_between([a.v, b.v, c.v], first_row, rows) {
        let v = (first_row + row) as f32;
        for column in columns.clone() {
            let u = column as f32;
            let wa = ((b.u - u) * (c.v - v) - (c.u - u) * (b.v - v)) / area;
            let wb = ((c.u - u) * (a.v - v) - (a.u - u) * (c.v - v)) / area;
            let wc = 1.0 - wa - wb;
            if wa.min(wb).min(wc) < -SIDE_TOLERANCE {
                continue;
            }
            let near = wa * a.inverse + wb * b.inverse + wc * c.inverse;
            let i = row * width + column;
            if near > inverse[i] {
                inverse[i] = near;
                visit(i, near, a.color * wa + b.color * wb + c.color * wc);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{box_mesh, color_of, cuboid, looking_at_origin, sphere, sphere_mesh, view_of};
    use nalgebra::Point3;

    const K: Intrinsics = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 148.0, cx: 80.3, cy: 58.9 };

    fn item(mesh: &TriangleMesh) -> RenderItem<'_> {
        RenderItem { mesh, world_from_mesh: Pose::identity(), paint: Paint::Vertices }
    }

    #[test]
    fn depth_and_color_of_a_box_agree_with_ray_casting() {
        let half = Vector3::new(0.2f32, 0.15, 0.1);
        let mut mesh = box_mesh(half);
        mesh.colors = mesh.vertices.iter().map(|p| color_of(&p.cast())).collect();
        let pose = looking_at_origin(Point3::new(0.5, 0.4, 0.45));
        let image = render(&[item(&mesh)], &K, &pose, false);
        let truth = view_of(&cuboid(half.cast()), K, pose);
        let mut seen = 0;
        for i in 0..image.depth_m.len() {
            if (image.depth_m[i] > 0.0) != (truth.depth_m[i] > 0.0) {
                continue;
            }
            seen += usize::from(image.depth_m[i] > 0.0);
            assert!((image.depth_m[i] - truth.depth_m[i]).abs() < 1e-4);
            if image.depth_m[i] > 0.0 {
                assert!((0..3).all(|k| image.rgb[i][k].abs_diff(truth.rgb[i][k]) <= 1));
                assert_eq!(image.item[i], Some(0));
            } else {
                assert_eq!((image.rgb[i], image.item[i]), (BACKGROUND, None));
            }
        }
        let differ = (0..image.depth_m.len())
            .filter(|&i| (image.depth_m[i] > 0.0) != (truth.depth_m[i] > 0.0))
            .count();
        assert!(seen > 3000 && differ < 4, "{seen} {differ}");
    }

    #[test]
    fn a_sphere_has_no_pinhole_and_its_depth() {
        let pose = looking_at_origin(Point3::new(-0.6, 0.2, 0.3));
        let image = render(&[item(&sphere_mesh(0.2, 150))], &K, &pose, true);
        let truth = view_of(&sphere(0.2), K, pose);
        let mut worst = 0.0f32;
        let mut holes = 0;
        for y in 1..K.height - 1 {
            for x in 1..K.width - 1 {
                let i = y * K.width + x;
                let inner =
                    [i, i - 1, i + 1, i - K.width, i + K.width].iter().all(|&j| truth.depth_m[j] > 0.0);
                if inner {
                    holes += usize::from(image.depth_m[i] == 0.0);
                    worst = worst.max((image.depth_m[i] - truth.depth_m[i]).abs());
                }
            }
        }
        assert!(holes == 0 && worst < 0.002, "{holes} {worst}");
        // A lamp at the camera: bright in the middle, dark at the rim.
        let middle = image.rgb[59 * K.width + 80][0];
        let rim =
            (0..image.rgb.len()).filter(|&i| image.item[i].is_some()).map(|i| image.rgb[i][0]).min().unwrap();
        assert!(middle > 175 && rim < 100, "{middle} {rim}");
    }

    #[test]
    fn the_nearer_item_wins_whatever_the_order() {
        let mesh = box_mesh(Vector3::new(0.1, 0.1, 0.1));
        let at = |z: f64, tint: [u8; 3]| RenderItem {
            mesh: &mesh,
            world_from_mesh: Pose::translation(0.0, 0.0, z),
            paint: Paint::Tint(tint),
        };
        let pose = Pose::identity();
        let near = at(0.6, [255, 0, 0]);
        let far = at(1.5, [0, 0, 255]);
        let one = render(&[near, far], &K, &pose, false);
        let two = render(&[far, near], &K, &pose, false);
        assert_eq!((&one.rgb, &one.depth_m), (&two.rgb, &two.depth_m));
        let middle = 59 * K.width + 80;
        assert_eq!((one.item[middle], two.item[middle]), (Some(0), Some(1)));
        assert!((one.depth_m[middle] - 0.5).abs() < 1e-6 && one.rgb[middle][0] > one.rgb[middle][2]);
    }

    #[test]
    fn a_camera_inside_sees_the_walls_all_over() {
        let half = Vector3::new(0.5f32, 0.4, 0.3);
        let pose = Pose::new(Vector3::new(0.1, 0.05, 0.02), Vector3::new(0.3, 1.0, -0.4));
        let image = render(&[item(&box_mesh(half))], &K, &pose, true);
        for (i, &d) in image.depth_m.iter().enumerate() {
            let p = pose * K.unproject((i % K.width) as f64, (i / K.width) as f64, f64::from(d));
            assert!(d > 0.0 && cuboid(half.cast())(&p).abs() < 1e-5);
        }
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let mesh = sphere_mesh(0.2, 40);
        let pose = looking_at_origin(Point3::new(-0.6, 0.2, 0.3));
        let with = |n| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap()
                .install(|| render(&[item(&mesh)], &K, &pose, true))
        };
        assert_eq!(with(1), with(3));
    }
}
