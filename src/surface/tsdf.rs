//! Fusion of depth maps into a truncated signed distance volume (Curless and Levoy 1996).
//!
//! At each node the result is the weighted least-squares solution for the targets of the field's losses:
//! projective distance near a surface, 1 in front of it (docs/method.md 3.2).

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{
    TriangleMesh, marching_cubes,
    row_sweep::{RowSums, Sweep, sweep_over},
    rows::RowCamera,
    tsdf_view::{FREE_WEIGHT, NodeReading, TsdfView, behind_weight, reading_of_node},
};
use geometry::Grid3;

/// Layers, and rows of each, in one task: all views are added to these before the next rows.
/// derived: the sums of these rows of 224 nodes and their pixels fit in a cache of 1 MB; other sizes were not
/// tried
const LAYERS: usize = 8;
const LINES: usize = 16;

/// Weighted means of projective distance and color at the nodes of a grid. 24 bytes a node.
pub struct TsdfVolume {
    truncation_m: f32,
    /// Weighted sum of distances, in truncation distances.
    sums: Grid3<f32>,
    weights: Vec<f32>,
    /// Weighted sum of red, green, blue and the sum of weights.
    colors: Vec<[f32; 4]>,
}

impl TsdfVolume {
    /// An empty volume with node (0, 0, 0) at `origin` in the world; distances are cut off at `truncation_m`.
    pub fn new(origin: Point3<f64>, spacing_m: f64, dims: [usize; 3], truncation_m: f64) -> Self {
        let count = dims.iter().product();
        Self {
            truncation_m: truncation_m as f32,
            sums: Grid3 { origin, spacing_m, dims, values: vec![0.0; count] },
            weights: vec![0.0; count],
            colors: vec![[0.0; 4]; count],
        }
    }

    /// Fuses views into an empty volume: first all views at every node, then again near the surface only the
    /// views on a node's side of it (3.4): those of the other side of a thin panel would push it outwards.
    pub fn fuse(&mut self, views: &[TsdfView]) {
        self.integrate(views);
        self.fuse_facing(views);
    }

    /// Adds views to the volume. A reading weighs `pixel weight / sigma(depth)^2`, normalized to 1 at one
    /// meter. The result does not depend on the number of threads. See docs/method.md (3.2).
    pub fn integrate(&mut self, views: &[TsdfView]) {
        let cameras = self.view_cameras(views);
        let truncation_m = self.truncation_m;
        let [nx, ny, _] = self.sums.dims;
        self.layer_slabs().for_each(|slab| {
            let layers = slab.weights.len() / (nx * ny);
            let mut near = Vec::new();
            // All views are added to a few rows at a time: both then stay in the cache.
            for lines in (0..ny).step_by(LINES) {
                for (view, ViewCamera { camera, .. }) in views.iter().zip(&cameras) {
                    let sweep = Sweep { camera, readings: &view.readings, truncation_m };
                    for (z, y) in
                        (0..layers).flat_map(|z| (lines..(lines + LINES).min(ny)).map(move |y| (z, y)))
                    {
                        let row = camera.row_in_image(y, slab.first + z, nx);
                        let at = (z * ny + y) * nx;
                        let sums = &mut slab.sums[at..at + nx];
                        let weights = &mut slab.weights[at..at + nx];
                        near.clear();
                        sweep_over(sweep, &row, RowSums { sums, weights }, &mut near);
                        for &x in &near {
                            let said = reading_of_node(
                                &view.readings,
                                &view.frame.intrinsics,
                                camera,
                                &row.at(x),
                                truncation_m,
                            );
                            if let Some(near @ NodeReading::Near { .. }) = said {
                                let color = &mut slab.colors[at + x];
                                let sums = NodeSums { sum: &mut sums[x], weight: &mut weights[x], color };
                                sums.add_reading(&near, view, 1.0);
                            }
                        }
                    }
                }
            }
        });
    }

    /// Fuses the same views again near the surface, at each node only those on the node's side of the
    /// surface: in a plate thinner than the truncation distance, the readings of one side push the other
    /// outwards, by up to half its thickness. (Splietker and Behnke 2019 keep a volume for each of six
    /// directions instead.) Nodes without such a view keep their value. See docs/method.md (3.4).
    pub fn fuse_facing(&mut self, views: &[TsdfView]) {
        let cameras = self.view_cameras(views);
        let first = self.distance_grid(0.0);
        let truncation_m = self.truncation_m;
        let [nx, ny, _] = first.dims;
        self.layer_slabs().for_each(|slab| {
            let layers = slab.weights.len() / (nx * ny);
            let mut near: Vec<FacedNode> = Vec::new();
            for (z, y) in (0..layers).flat_map(|z| (0..ny).map(move |y| (z, y))) {
                let at = (z * ny + y) * nx;
                let layer = slab.first + z;
                near.clear();
                let start = first.index(0, y, layer);
                // A node without a reading is NaN and also left out.
                for x in (0..nx).filter(|x| first.values[start + x].abs() < 0.999 * truncation_m) {
                    near.push(FacedNode::new(&first, [x, y, layer]));
                }
                for (view, ViewCamera { camera, eye }) in views.iter().zip(&cameras) {
                    if near.is_empty() {
                        break;
                    }
                    let row = camera.row_in_image(y, layer, nx);
                    for node in near.iter_mut().filter(|n| row.range.contains(&n.x)) {
                        node.add_view(view, camera, &row.at(node.x), eye, truncation_m);
                    }
                }
                for node in near.iter().filter(|n| n.weight > 0.0) {
                    let i = at + node.x;
                    (slab.sums[i], slab.weights[i], slab.colors[i]) = (node.sum, node.weight, node.color);
                }
            }
        });
    }

    fn view_cameras(&self, views: &[TsdfView]) -> Vec<ViewCamera> {
        let mut cameras = Vec::with_capacity(views.len());
        for view in views {
            let volume_from_camera = view.volume_from_world * view.frame.world_from_camera;
            let origin = &self.sums.origin;
            let spacing_m = self.sums.spacing_m;
            let inverse = volume_from_camera.inverse();
            let camera = RowCamera::new(&view.frame.intrinsics, &inverse, origin, spacing_m);
            cameras.push(ViewCamera { camera, eye: volume_from_camera.translation.vector.cast() });
        }
        cameras
    }

    /// The volume in slabs of some layers each.
    fn layer_slabs(&mut self) -> impl IndexedParallelIterator<Item = Slab<'_>> {
        let size = (self.sums.dims[0] * self.sums.dims[1] * LAYERS).max(1);
        let sums = self.sums.values.par_chunks_mut(size);
        let all = sums.zip(self.weights.par_chunks_mut(size)).zip(self.colors.par_chunks_mut(size));
        all.enumerate().map(|(slab, ((sums, weights), colors))| Slab {
            first: slab * LAYERS,
            sums,
            weights,
            colors,
        })
    }

    /// Distances in meters, cut off at the truncation distance; NaN where the weight is at most `min_weight`.
    pub fn distance_grid(&self, min_weight: f32) -> Grid3<f32> {
        let nodes = self.sums.values.par_iter().zip(&self.weights).with_min_len(1 << 14);
        // docs/method.md (3.3).
        let values = nodes.map(
            |(&sum, &weight)| {
                if weight > min_weight { sum / weight * self.truncation_m } else { f32::NAN }
            },
        );
        Grid3 {
            origin: self.sums.origin,
            spacing_m: self.sums.spacing_m,
            dims: self.sums.dims,
            values: values.collect(),
        }
    }

    /// Sum of the weights at each node, in the order of the grid's values.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Mean color at a point in the world, interpolated between the colored nodes; `None` where there is
    /// none.
    pub fn color_at(&self, point: &Point3<f64>) -> Option<[u8; 3]> {
        let grid = &self.sums;
        let g = (point - grid.origin) / grid.spacing_m;
        let mut base = [0; 3];
        for k in 0..3 {
            if !(g[k] >= 0.0 && g[k] <= (grid.dims[k] - 1) as f64) {
                return None;
            }
            base[k] = (g[k] as usize).min(grid.dims[k].saturating_sub(2));
        }
        let mut sum = [0.0f32; 4];
        for corner in 0..8 {
            let at = [0, 1, 2].map(|k| (base[k] + (corner >> k & 1)).min(grid.dims[k] - 1));
            let share: f64 = (0..3).map(|k| 1.0 - (g[k] - at[k] as f64).abs()).product();
            let c = self.colors[grid.index(at[0], at[1], at[2])];
            if c[3] > 0.0 {
                // A colored corner always counts a little: it may be the only one.
                let share = share.max(1e-6) as f32;
                add_weighted(&mut sum, [c[0] / c[3], c[1] / c[3], c[2] / c[3]], share);
            }
        }
        (sum[3] > 0.0).then(|| [0, 1, 2].map(|k| (sum[k] / sum[3]).round() as u8))
    }

    /// Gives each vertex of a mesh in the world the color there; gray where none was seen.
    pub fn paint_vertices(&self, mesh: &mut TriangleMesh) {
        let vertices = mesh.vertices.par_iter().with_min_len(1024);
        mesh.colors = vertices.map(|p| self.color_at(&p.cast()).unwrap_or([128; 3])).collect();
    }

    /// The colored surface between the nodes with a weight above `min_weight`.
    pub fn colored_mesh(&self, min_weight: f32) -> TriangleMesh {
        let mut mesh = marching_cubes(&self.distance_grid(min_weight), 0.0);
        self.paint_vertices(&mut mesh);
        mesh
    }
}

/// A view's camera in front of the nodes.
struct ViewCamera {
    camera: RowCamera,
    /// Position of the camera in the volume, meters.
    eye: Vector3<f32>,
}

/// Some layers of a volume, for one task.
struct Slab<'a> {
    /// Index of the first layer.
    first: usize,
    sums: &'a mut [f32],
    weights: &'a mut [f32],
    colors: &'a mut [[f32; 4]],
}

/// A node near the surface, fused from the views on its side.
struct FacedNode {
    x: usize,
    position: Vector3<f32>,
    /// Gradient of the distance there; zero where it is unknown.
    slope: Vector3<f32>,
    sum: f32,
    weight: f32,
    color: [f32; 4],
}

impl FacedNode {
    fn new(distance: &Grid3<f32>, node: [usize; 3]) -> Self {
        let slope = Vector3::from_fn(|axis, _| {
            let [before, behind] = [-1, 1].map(|step| value_beside(distance, node, axis, step));
            let slope = behind - before;
            if slope.is_nan() { 0.0 } else { slope }
        });
        let position = distance.node_position(node[0], node[1], node[2]).coords.cast();
        Self { x: node[0], position, slope, sum: 0.0, weight: 0.0, color: [0.0; 4] }
    }

    /// Adds a view's reading if the view sees free space at the node (at `p` in its optical frame) or is on
    /// its side of the surface.
    fn add_view(
        &mut self,
        view: &TsdfView,
        camera: &RowCamera,
        p: &Vector3<f32>,
        eye: &Vector3<f32>,
        truncation_m: f32,
    ) {
        let Some(said) = reading_of_node(&view.readings, &view.frame.intrinsics, camera, p, truncation_m)
        else {
            return;
        };
        // docs/method.md (3.4).
        if matches!(said, NodeReading::Free { .. }) || self.slope.dot(&(eye - self.position)) >= 0.0 {
            // Weights that are even around the surface leave it at the mean of noisy readings.
            let sums = NodeSums { sum: &mut self.sum, weight: &mut self.weight, color: &mut self.color };
            sums.add_reading(&said, view, 2.0);
        }
    }
}

/// Value of the node `step` steps along an axis, at most to the border of the grid.
fn value_beside(grid: &Grid3<f32>, node: [usize; 3], axis: usize, step: isize) -> f32 {
    let mut other = node;
    other[axis] = other[axis].saturating_add_signed(step).min(grid.dims[axis] - 1);
    grid.values[grid.index(other[0], other[1], other[2])]
}

/// The sums of a node: weighted distance, weight, color.
struct NodeSums<'a> {
    sum: &'a mut f32,
    weight: &'a mut f32,
    color: &'a mut [f32; 4],
}

impl NodeSums<'_> {
    /// Adds a view's reading.
    fn add_reading(self, reading: &NodeReading, view: &TsdfView, steepness: f32) {
        match *reading {
            NodeReading::Free { weight } => {
                *self.sum += FREE_WEIGHT * weight;
                *self.weight += FREE_WEIGHT * weight;
            }
            NodeReading::Near { s, weight, pixel } => {
                let w = weight * behind_weight(s, steepness);
                *self.sum += w * s.min(1.0);
                *self.weight += w;
                add_color(self.color, view.frame.rgb[pixel], w * (1.0 - s.abs()).max(0.0));
            }
        }
    }
}

/// Adds a weighted 8-bit color.
fn add_color(sum: &mut [f32; 4], color: [u8; 3], weight: f32) {
    add_weighted(sum, color.map(f32::from), weight);
}

/// Adds a weighted color.
fn add_weighted(sum: &mut [f32; 4], color: [f32; 3], weight: f32) {
    let v = Vector3::from(color) * weight;
    *sum = [sum[0] + v.x, sum[1] + v.y, sum[2] + v.z, sum[3] + weight];
}

#[cfg(test)]
#[path = "tsdf_equation_tests.rs"]
mod equation_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        PixelRole, edge_defects,
        shapes::{color_of, cuboid, orbit, sphere, view_of},
        tsdf_view::object_roles,
    };
    use capture::{NoiseConfig, RgbdFrame, Unread, pixel_weights};
    use geometry::Pose;

    fn fuse(frames: &[RgbdFrame], spacing_m: f64, truncation_m: f64, motion: Pose) -> TsdfVolume {
        let noise = NoiseConfig::default();
        let nodes = (0.6 / spacing_m) as usize + 1;
        let mut volume = TsdfVolume::new(Point3::new(-0.3, -0.3, -0.3), spacing_m, [nodes; 3], truncation_m);
        let view = |frame| {
            let weights = pixel_weights(frame, &noise);
            TsdfView::new(frame, &weights, &object_roles(frame, &weights), motion, &noise)
        };
        volume.integrate(&frames.iter().map(view).collect::<Vec<_>>());
        volume
    }

    /// Largest and root mean square distance of the mesh's vertices to the shape.
    fn errors(mesh: &TriangleMesh, distance: impl Fn(&Point3<f64>) -> f64) -> (f64, f64) {
        let d: Vec<f64> = mesh.vertices.iter().map(|p| distance(&p.cast()).abs()).collect();
        (
            d.iter().copied().fold(0.0, f64::max),
            (d.iter().map(|d| d * d).sum::<f64>() / d.len() as f64).sqrt(),
        )
    }

    #[test]
    fn a_sphere_seen_all_around_comes_back_within_a_fraction_of_a_node_spacing() {
        let frames = orbit(&sphere(0.2), 20, 0.8);
        let volume = fuse(&frames, 0.01, 0.03, Pose::identity());
        let mesh = volume.colored_mesh(0.0);
        let (largest, rms) = errors(&mesh, sphere(0.2));
        assert!(largest < 0.001 && rms < 0.0003, "{largest} {rms}");
        assert_eq!(edge_defects(&mesh), Default::default());
        assert!((mesh.area_m2() / (4.0 * std::f64::consts::PI * 0.04) - 1.0).abs() < 0.01);
        for (p, color) in mesh.vertices.iter().zip(&mesh.colors) {
            let expected = color_of(&p.cast());
            assert!((0..3).all(|k| color[k].abs_diff(expected[k]) <= 6), "{color:?} {expected:?}");
        }
    }

    #[test]
    fn space_in_front_and_beside_is_free_and_deep_inside_is_unknown() {
        let volume = fuse(&orbit(&sphere(0.2), 20, 0.8), 0.01, 0.03, Pose::identity());
        let grid = volume.distance_grid(0.0);
        for i in 0..grid.values.len() {
            let d = sphere(0.2)(&grid.position_of_index(i));
            if d < -0.031 {
                assert!(grid.values[i].is_nan());
            } else if d > 0.03 {
                assert!((grid.values[i] - 0.03).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_box_keeps_its_faces() {
        let shape = cuboid(Vector3::new(0.15, 0.1, 0.12));
        let (largest, rms) =
            errors(&fuse(&orbit(&shape, 24, 0.8), 0.01, 0.03, Pose::identity()).colored_mesh(0.0), &shape);
        assert!(largest < 0.003 && rms < 0.0005, "{largest} {rms}");
    }

    #[test]
    fn a_moved_view_fuses_where_its_part_was() {
        let motion = Pose::new(Vector3::new(0.03, -0.02, 0.01), Vector3::new(0.2, 0.5, -0.3));
        let shape = cuboid(Vector3::new(0.15, 0.1, 0.12));
        let moved =
            move |p: &Point3<f64>| cuboid(Vector3::new(0.15, 0.1, 0.12))(&motion.inverse_transform_point(p));
        let mesh = fuse(&orbit(&moved, 24, 0.8), 0.01, 0.03, motion.inverse()).colored_mesh(0.0);
        let (largest, rms) = errors(&mesh, &shape);
        assert!(largest < 0.003 && rms < 0.0005, "{largest} {rms}");
    }

    #[test]
    fn roles_select_what_a_view_says() {
        let frame = &orbit(&sphere(0.2), 1, 0.8)[0];
        let noise = NoiseConfig::default();
        let weights = vec![1.0; frame.depth_m.len()];
        let fused = |role: PixelRole| {
            let mut volume = TsdfVolume::new(Point3::new(-0.3, -0.3, -0.3), 0.02, [31; 3], 0.04);
            let roles = vec![role; weights.len()];
            volume.integrate(&[TsdfView::new(frame, &weights, &roles, Pose::identity(), &noise)]);
            volume
        };
        assert!(fused(PixelRole::Skip).weights().iter().all(|&w| w == 0.0));
        let free = fused(PixelRole::FreeOnly).distance_grid(0.0);
        assert!(free.values.iter().all(|v| v.is_nan() || (v - 0.04).abs() < 1e-6));
        let count = |v: &TsdfVolume| v.distance_grid(0.0).values.iter().filter(|v| **v < 0.0).count();
        assert!(count(&fused(PixelRole::Surface)) > 100);
        assert!(fused(PixelRole::FreeOnly).colored_mesh(0.0).is_empty());
    }

    #[test]
    fn a_thin_plate_keeps_both_sides() {
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.006));
        let mut frames = orbit(&shape, 24, 0.8);
        frames.retain(|f| f.world_from_camera.translation.vector.z.abs() > 0.2);
        let mesh = fuse(&frames, 0.005, 0.015, Pose::identity()).colored_mesh(0.0);
        let (_, rms) = errors(&mesh, &shape);
        let above =
            mesh.vertices.iter().filter(|p| p.x.abs() < 0.18 && p.y.abs() < 0.13 && p.z > 0.004).count();
        let below =
            mesh.vertices.iter().filter(|p| p.x.abs() < 0.18 && p.y.abs() < 0.13 && p.z < -0.004).count();
        assert!(rms < 0.002 && above > 3000 && below > 3000, "{rms} {above} {below}");
    }

    #[test]
    fn sides_of_a_plate_do_not_push_each_other() {
        let shape = cuboid(Vector3::new(0.2, 0.15, 0.006));
        let mut frames = orbit(&shape, 24, 0.8);
        // One side is seen more often than the other.
        let mut seen = 0;
        frames.retain(|f| {
            let z = f.world_from_camera.translation.vector.z;
            seen += usize::from(z > 0.2);
            z < -0.2 || (z > 0.2 && seen % 3 == 0)
        });
        let noise = NoiseConfig::default();
        let views: Vec<_> = frames.iter().map(|f| TsdfView::of_object(f, Unread::Empty, &noise)).collect();
        let mut volume = TsdfVolume::new(Point3::new(-0.3, -0.3, -0.3), 0.005, [121; 3], 0.02);
        volume.integrate(&views);
        let off_m = |volume: &TsdfVolume, side: f32| {
            let mesh = volume.colored_mesh(0.0);
            let inner =
                mesh.vertices.iter().filter(|p| p.x.abs() < 0.17 && p.y.abs() < 0.12 && p.z * side > 0.0);
            let heights: Vec<f32> = inner.map(|p| p.z * side - 0.006).collect();
            heights.iter().sum::<f32>() / heights.len() as f32
        };
        let before = [1.0, -1.0].map(|side| off_m(&volume, side));
        assert!(before.iter().any(|m| *m > 0.001), "{before:?}");
        volume.fuse_facing(&views);
        let after = [1.0, -1.0].map(|side| off_m(&volume, side));
        assert!(after.iter().all(|m| m.abs() < 2e-4), "{after:?}");
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let k = geometry::Intrinsics { width: 60, height: 50, fx: 60.0, fy: 60.0, cx: 29.5, cy: 24.5 };
        let pose = crate::shapes::looking_at_origin(Point3::new(0.5, 0.4, 0.3));
        let frame = view_of(&sphere(0.2), k, pose);
        let with = |n| {
            let fused = || fuse(std::slice::from_ref(&frame), 0.02, 0.03, Pose::identity()).colored_mesh(0.0);
            rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(fused)
        };
        assert_eq!(with(1), with(3));
    }
}
