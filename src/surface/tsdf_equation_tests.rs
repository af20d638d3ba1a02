//! Fused nodes against the equations of docs/method.md 3.2, written out node by node in double precision.

use super::*;
use crate::{PixelRole, shapes::sphere};
use capture::{NoiseConfig, RgbdFrame};
use geometry::{Intrinsics, Pose};

const K: Intrinsics = Intrinsics { width: 28, height: 22, fx: 30.0, fy: 28.0, cx: 13.3, cy: 10.6 };
const TRUNCATION_M: f64 = 0.06;
const SPACING_M: f64 = 0.02;
// More layers and lines than one task takes at a time.
const DIMS: [usize; 3] = [21, 19, 18];
const ORIGIN: Point3<f64> = Point3::new(-0.2, -0.19, 0.55);

/// A view of a slanted plane with a step in it; some pixels see something else, or say nothing.
struct View {
    frame: RgbdFrame,
    weights: Vec<f32>,
    roles: Vec<PixelRole>,
    volume_from_world: Pose,
}

impl View {
    fn new(world_from_camera: Pose, volume_from_world: Pose) -> Self {
        let count = K.width * K.height;
        let depth_of = |i: usize| {
            let u = i % K.width;
            let v = i / K.width;
            let ray = K.ray_at(u as f64, v as f64);
            let ahead_m = if u > 19 { 0.55 } else { 0.75 };
            if i % 53 == 7 { 0.0 } else { (ahead_m / Vector3::new(0.3, -0.2, 1.0).dot(&ray)) as f32 }
        };
        let role = |i: usize| match i % 37 {
            3 | 7 => PixelRole::FreeOnly,
            11 => PixelRole::Skip,
            _ => PixelRole::Surface,
        };
        let frame = RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics: K,
            world_from_camera,
            rgb: (0..count).map(|i| [(i % 251) as u8, (i / 3) as u8, 200]).collect(),
            depth_m: (0..count).map(depth_of).collect(),
            mask: None,
            readings: Vec::new(),
        };
        let weights = (0..count).map(|i| 0.2 + 0.15 * (i % 5) as f32).collect();
        Self { frame, weights, roles: (0..count).map(role).collect(), volume_from_world }
    }

    fn tsdf_view(&self) -> TsdfView<'_> {
        let noise = NoiseConfig::default();
        TsdfView::new(&self.frame, &self.weights, &self.roles, self.volume_from_world, &noise)
    }

    /// (sigma(1 m) / sigma(depth))^2.
    fn precision(&self, pixel: usize) -> f64 {
        let noise = NoiseConfig::default();
        (noise.sigma_m(1.0) / noise.sigma_m(f64::from(self.frame.depth_m[pixel]))).powi(2)
    }

    fn is_surface(&self, pixel: usize) -> bool {
        self.roles[pixel] == PixelRole::Surface && self.frame.depth_m[pixel] > 0.0
    }

    /// What the view says of a place, and whether rounding may decide otherwise.
    fn says(&self, x: &Point3<f64>) -> (Option<Says>, bool) {
        let p = self.frame.world_from_camera.inverse() * (self.volume_from_world.inverse() * x);
        let u = K.fx * p.x / p.z + K.cx;
        let v = K.fy * p.y / p.z + K.cy;
        let near_border = |c: f64| (c + 0.5 - (c + 0.5).round()).abs() < 1e-3 || (c - c.round()).abs() < 1e-3;
        let unclear = near_border(u) || near_border(v);
        let column = (u + 0.5).floor();
        let line = (v + 0.5).floor();
        if !(0.0..K.width as f64).contains(&column) || !(0.0..K.height as f64).contains(&line) {
            return (None, unclear);
        }
        let pixel = line as usize * K.width + column as usize;
        let depth_m = f64::from(self.frame.depth_m[pixel]);
        let (depth_m, weight) = match (self.roles[pixel], depth_m > 0.0) {
            (PixelRole::Surface, true) => (depth_m, f64::from(self.weights[pixel]) * self.precision(pixel)),
            (PixelRole::FreeOnly, true) => (depth_m, self.precision(pixel).min(1.0)),
            (PixelRole::FreeOnly, false) => (f64::INFINITY, 1.0),
            _ => return (None, unclear),
        };
        let ahead = (depth_m - p.z) / TRUNCATION_M;
        let unclear = unclear || (ahead.abs() - 1.0).abs() < 1e-4;
        if ahead >= 1.0 {
            return (Some(Says { d: None, weight, pixel }), unclear);
        }
        if ahead <= -1.0 || !self.is_surface(pixel) {
            return (None, unclear);
        }
        let d = (self.between(u, v).unwrap_or(depth_m) - p.z) / TRUNCATION_M;
        let unclear = unclear || (d.abs() - 1.0).abs() < 1e-4;
        ((d > -1.0).then_some(Says { d: Some(d), weight, pixel }), unclear)
    }

    /// Depth between four pixels of one surface, linear in inverse depth.
    fn between(&self, u: f64, v: f64) -> Option<f64> {
        let x = u.floor();
        let y = v.floor();
        if x < 0.0 || y < 0.0 || x + 1.0 >= K.width as f64 || y + 1.0 >= K.height as f64 {
            return None;
        }
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let pixel = |(dx, dy): (usize, usize)| (y as usize + dy) * K.width + x as usize + dx;
        let depths: Vec<f64> = four
            .iter()
            .filter(|c| self.is_surface(pixel(**c)))
            .map(|c| f64::from(self.frame.depth_m[pixel(*c)]))
            .collect();
        let range =
            depths.iter().copied().fold(0.0, f64::max) - depths.iter().copied().fold(f64::INFINITY, f64::min);
        if depths.len() < 4 || range >= TRUNCATION_M {
            return None;
        }
        let share = |(dx, dy): (usize, usize)| {
            let a = u - x;
            let b = v - y;
            (if dx == 1 { a } else { 1.0 - a }) * (if dy == 1 { b } else { 1.0 - b })
        };
        Some(1.0 / four.iter().zip(&depths).map(|(c, z)| share(*c) / z).sum::<f64>())
    }
}

/// Distance in truncations, none where the place is seen through; weight; pixel.
struct Says {
    d: Option<f64>,
    weight: f64,
    pixel: usize,
}

/// Sums of distance, weight and color of what views say, `steepness` being k of (3.2).
#[derive(Default)]
struct Sums {
    sum: f64,
    weight: f64,
    color: [f64; 4],
}

impl Sums {
    fn add(&mut self, says: &Says, view: &View, steepness: f64) {
        let Some(d) = says.d else {
            self.sum += 0.1 * says.weight;
            self.weight += 0.1 * says.weight;
            return;
        };
        let w = says.weight * (steepness * (1.0 + d)).min(1.0);
        self.sum += w * d.min(1.0);
        self.weight += w;
        let share = w * (1.0 - d.abs()).max(0.0);
        let [r, g, b] = view.frame.rgb[says.pixel].map(f64::from);
        for (sum, x) in self.color.iter_mut().zip([r, g, b, 1.0]) {
            *sum += share * x;
        }
    }

    /// Whether a node of a volume holds these sums, up to rounding.
    fn is_at(&self, volume: &TsdfVolume, node: usize) -> bool {
        let near = |a: f64, b: f32| (a - f64::from(b)).abs() < 2e-4 * a.abs().max(0.1);
        near(self.sum, volume.sums.values[node])
            && near(self.weight, volume.weights[node])
            && (0..4).all(|k| near(self.color[k] / 200.0, volume.colors[node][k] / 200.0))
    }
}

fn views() -> [View; 3] {
    let pose = |t: [f64; 3], r: [f64; 3]| Pose::new(Vector3::from(t), Vector3::from(r));
    [
        View::new(Pose::identity(), Pose::identity()),
        View::new(pose([0.1, -0.05, 0.1], [0.05, -0.2, 0.1]), Pose::identity()),
        // From behind, moved before it is fused.
        View::new(pose([0.0, 0.1, 1.5], [3.0, 0.1, 0.0]), pose([0.01, -0.02, 0.03], [0.02, 0.03, -0.05])),
    ]
}

fn empty() -> TsdfVolume {
    TsdfVolume::new(ORIGIN, SPACING_M, DIMS, TRUNCATION_M)
}

fn place(node: usize) -> (Point3<f64>, [usize; 3]) {
    let at = [node % DIMS[0], node / DIMS[0] % DIMS[1], node / DIMS[0] / DIMS[1]];
    (ORIGIN + Vector3::from(at.map(|k| k as f64)) * SPACING_M, at)
}

#[test]
fn every_node_holds_the_weighted_mean_of_what_views_say() {
    let views = views();
    let mut volume = empty();
    volume.integrate(&views.each_ref().map(View::tsdf_view));
    let mut near = 0;
    let mut free = 0;
    let mut skipped = 0;
    for node in 0..DIMS.iter().product() {
        let (x, _) = place(node);
        let mut sums = Sums::default();
        let mut unclear = false;
        for view in &views {
            let (says, is_unclear) = view.says(&x);
            unclear |= is_unclear;
            if let Some(says) = says {
                sums.add(&says, view, 1.0);
                near += usize::from(says.d.is_some());
                free += usize::from(says.d.is_none());
            }
        }
        skipped += usize::from(unclear);
        assert!(unclear || sums.is_at(&volume, node), "node {node} at {x}");
    }
    assert!(near > 1000 && free > 1000 && skipped < 300, "{near} {free} {skipped}");
}

#[test]
fn every_node_near_the_surface_is_fused_again_by_the_views_of_its_side() {
    let views = views();
    let tsdf_views = views.each_ref().map(View::tsdf_view);
    let mut volume = empty();
    volume.integrate(&tsdf_views);
    let first = volume.distance_grid(0.0);
    let sums_before = volume.sums.values.clone();
    let weights_before = volume.weights.clone();
    let before = |at: [usize; 3]| f64::from(first.values[first.index(at[0], at[1], at[2])]);
    volume.fuse_facing(&tsdf_views);
    let mut checked = 0;
    let mut behind = 0;
    let mut alone = 0;
    for node in 0..DIMS.iter().product() {
        let (x, at) = place(node);
        let share = before(at).abs() / TRUNCATION_M;
        let stays =
            volume.sums.values[node] == sums_before[node] && volume.weights[node] == weights_before[node];
        if !(share < 0.999) {
            assert!(stays || (share - 0.999).abs() < 1e-4, "node {node} at {x}");
            continue;
        }
        let slope = Vector3::from_fn(|k, _| {
            let mut low = at;
            let mut high = at;
            low[k] = at[k].saturating_sub(1);
            high[k] = (at[k] + 1).min(DIMS[k] - 1);
            let slope = before(high) - before(low);
            if slope.is_nan() { 0.0 } else { slope }
        });
        let mut sums = Sums::default();
        let mut unclear = (share - 0.999).abs() < 1e-4;
        for view in &views {
            let (says, is_unclear) = view.says(&x);
            let eye = (view.volume_from_world * view.frame.world_from_camera).translation.vector;
            let facing = slope.dot(&(eye - x.coords));
            unclear |= is_unclear || facing.abs() < 1e-4;
            let Some(says) = says else { continue };
            if says.d.is_none() || facing >= 0.0 {
                sums.add(&says, view, 2.0);
            } else {
                behind += 1;
            }
        }
        if unclear {
            continue;
        }
        // A node that no view sees so stays as it was.
        alone += usize::from(sums.weight == 0.0);
        checked += usize::from(sums.weight > 0.0);
        assert!(if sums.weight > 0.0 { sums.is_at(&volume, node) } else { stays }, "node {node} at {x}");
    }
    assert!(checked > 500 && behind > 100 && alone > 0, "{checked} {behind} {alone}");
}

#[test]
fn fusing_is_both_passes() {
    let views = views();
    let views = views.each_ref().map(View::tsdf_view);
    let [mut whole, mut steps] = [empty(), empty()];
    whole.fuse(&views);
    steps.integrate(&views);
    steps.fuse_facing(&views);
    assert!(whole.weights == steps.weights && whole.weights.iter().any(|w| *w > 0.0));
    assert_eq!((whole.sums.values, whole.colors), (steps.sums.values, steps.colors));
}

#[test]
fn nodes_of_no_more_than_the_least_weight_are_unknown() {
    let mut volume = TsdfVolume::new(Point3::origin(), 0.1, [3, 1, 1], 0.5);
    volume.sums.values = vec![0.5, 1.0, -3.0];
    volume.weights = vec![1.0, 2.0, 4.0];
    let grid = volume.distance_grid(1.0);
    assert!(grid.values[0].is_nan());
    assert_eq!(grid.values[1..], [0.25, -0.375]);
    assert_eq!((grid.dims, grid.spacing_m, grid.origin), ([3, 1, 1], 0.1, Point3::origin()));
    assert_eq!(volume.weights(), [1.0, 2.0, 4.0]);
}

/// A cube of eight nodes 0.1 m apart at (1, 2, 3); the node at each corner is red by its number, green by
/// twice that, blue by 100, of different weights.
fn colored(seen: impl Fn(usize) -> bool) -> TsdfVolume {
    let mut volume = TsdfVolume::new(Point3::new(1.0, 2.0, 3.0), 0.1, [2; 3], 0.05);
    for i in (0..8).filter(|i| seen(*i)) {
        let weight = 0.5 + i as f32;
        volume.colors[i] = [10.0 * i as f32 * weight, 20.0 * i as f32 * weight, 100.0 * weight, weight];
    }
    volume
}

#[test]
fn colors_between_nodes_are_interpolated() {
    let volume = colored(|_| true);
    let at =
        |x: f64, y: f64, z: f64| volume.color_at(&Point3::new(1.0 + 0.1 * x, 2.0 + 0.1 * y, 3.0 + 0.1 * z));
    // Corner i lies at its bits.
    assert_eq!(at(1e-9, 1e-9, 1e-9), Some([0, 0, 100]));
    assert_eq!(at(0.999_999, 1e-9, 1e-9), Some([10, 20, 100]));
    assert_eq!(at(1e-9, 0.999_999, 1e-9), Some([20, 40, 100]));
    assert_eq!(at(0.999_999, 0.999_999, 0.999_999), Some([70, 140, 100]));
    // Linear in each direction: red is 10 x + 20 y + 40 z.
    assert_eq!(at(0.4, 0.3, 0.7), Some([38, 76, 100]));
    for outside in [[-0.01, 0.5, 0.5], [0.5, 1.01, 0.5], [0.5, 0.5, -0.01], [1.01, 0.5, 0.5]] {
        assert_eq!(at(outside[0], outside[1], outside[2]), None, "{outside:?}");
    }
    // On the border itself there is a color.
    let corner = TsdfVolume {
        colors: vec![[3.0, 4.0, 5.0, 1.0]; 27],
        ..TsdfVolume::new(Point3::origin(), 1.0, [3; 3], 1.0)
    };
    for border in [Point3::origin(), Point3::new(2.0, 2.0, 2.0)] {
        assert_eq!(corner.color_at(&border), Some([3, 4, 5]));
    }
}

#[test]
fn a_color_is_that_of_the_nodes_that_have_one() {
    // Nodes 1 and 2 alone: a point nearer to node 1 takes more of it; beside both, either counts a little.
    let volume = colored(|i| i == 1 || i == 2);
    let at =
        |x: f64, y: f64, z: f64| volume.color_at(&Point3::new(1.0 + 0.1 * x, 2.0 + 0.1 * y, 3.0 + 0.1 * z));
    // Shares 0.6 * 0.8 and 0.4 * 0.2.
    assert_eq!(at(0.6, 0.2, 0.0), Some([11, 23, 100]));
    assert_eq!(at(1e-9, 1e-9, 0.999_999_999), Some([15, 30, 100]));
    // A volume of one node.
    let mut one = TsdfVolume::new(Point3::origin(), 0.1, [1; 3], 0.05);
    one.colors[0] = [20.0, 40.0, 60.0, 2.0];
    assert_eq!(one.color_at(&Point3::origin()), Some([10, 20, 30]));
    assert_eq!(colored(|_| false).color_at(&Point3::new(1.05, 2.05, 3.05)), None);
    // A mesh is gray where nothing was seen.
    let mut mesh = TriangleMesh {
        vertices: vec![Point3::new(1.0999, 2.0, 3.0), Point3::new(9.0, 9.0, 9.0)],
        ..TriangleMesh::default()
    };
    volume.paint_vertices(&mut mesh);
    assert_eq!(mesh.colors, [[10, 20, 100], [128; 3]]);
}

#[test]
fn roles_follow_from_mask_weight_and_depth() {
    let mut view = View::new(Pose::identity(), Pose::identity());
    view.frame.depth_m[..4].copy_from_slice(&[1.0, 1.0, 0.0, 1.0]);
    let count = view.frame.depth_m.len();
    view.frame.mask = Some((0..count).map(|i| i != 0).collect());
    let mut weights = vec![1.0; count];
    weights[3] = 0.0;
    let roles = crate::tsdf_view::object_roles(&view.frame, &weights);
    let expected = [PixelRole::FreeOnly, PixelRole::Surface, PixelRole::Skip, PixelRole::Skip];
    assert_eq!(roles[..4], expected);
    assert_eq!(roles.len(), count);
}

#[test]
fn a_mesh_is_closed_where_its_nodes_are_known_and_colored() {
    let mut volume = TsdfVolume::new(Point3::new(-0.3, -0.3, -0.3), 0.05, [13; 3], 0.1);
    for i in 0..volume.weights.len() {
        let d = sphere(0.2)(&volume.sums.position_of_index(i)) / 0.1;
        (volume.sums.values[i], volume.weights[i]) = (2.0 * d.clamp(-1.0, 1.0) as f32, 2.0);
        volume.colors[i] = [20.0, 40.0, 60.0, 2.0];
    }
    let mesh = volume.colored_mesh(1.0);
    assert!(mesh.vertices.iter().all(|p| (p.coords.norm() - 0.2).abs() < 0.01) && !mesh.is_empty());
    assert!(mesh.colors.len() == mesh.vertices.len() && mesh.colors.iter().all(|c| *c == [10, 20, 30]));
    assert!(volume.colored_mesh(2.0).is_empty());
}
