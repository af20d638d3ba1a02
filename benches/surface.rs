//! Times of the surface operations at the sizes of a run.

use capture::{NoiseConfig, RgbdFrame};
use geometry::{Grid3, Intrinsics, Pose};
use nalgebra::{Point3, Vector3};
use surface::{
    DistanceOptions, MeshDistance, Paint, PixelRole, RenderItem, TsdfView, TsdfVolume, marching_cubes,
    render, sample_surface, signed_distance, simplify,
};

fn main() {
    divan::main();
}

/// A bumpy sphere in `[-1, 1]^3`.
fn field(nodes: usize) -> Grid3<f32> {
    let spacing_m = 2.0 / (nodes - 1) as f64;
    let mut grid = Grid3 {
        origin: Point3::new(-1.0, -1.0, -1.0),
        spacing_m,
        dims: [nodes; 3],
        values: vec![0.0; nodes.pow(3)],
    };
    for i in 0..grid.values.len() {
        let p = grid.position_of_index(i);
        grid.values[i] = (p.coords.norm() - 0.75
            + 0.05 * ((9.0 * p.x).sin() * (9.0 * p.y).sin() * (9.0 * p.z).sin()))
            as f32;
    }
    grid
}

#[divan::bench(args = [128, 256])]
fn marching_cubes_nodes(bencher: divan::Bencher, nodes: usize) {
    let grid = field(nodes);
    bencher.bench_local(|| marching_cubes(&grid, 0.0));
}

#[divan::bench(args = [101, 201], sample_count = 5)]
fn signed_distance_nodes(bencher: divan::Bencher, nodes: usize) {
    let (mesh, grid) = (marching_cubes(&field(256), 0.0), field(nodes));
    bencher.bench_local(|| signed_distance(&mesh, &grid, None, &DistanceOptions::default()));
}

/// A view of a sphere of radius 0.2 m, one meter away.
fn view() -> RgbdFrame {
    let intrinsics = Intrinsics { width: 640, height: 480, fx: 570.0, fy: 570.0, cx: 319.5, cy: 239.5 };
    let depth = |i: usize| {
        let ray: Vector3<f64> = intrinsics.ray_at((i % 640) as f64, (i / 640) as f64);
        let (b, c) = (ray.z, 1.0 - 0.04);
        let root = b * b - ray.norm_squared() * c;
        if root < 0.0 { 0.0 } else { ((b - root.sqrt()) / ray.norm_squared()) as f32 }
    };
    let depth_m: Vec<f32> = (0..640 * 480).map(depth).collect();
    RgbdFrame {
        id: "0_0000".into(),
        stamp_nanos: 0,
        intrinsics,
        world_from_camera: Pose::translation(0.0, 0.0, -1.0),
        rgb: vec![[128; 3]; depth_m.len()],
        mask: Some(depth_m.iter().map(|d| *d > 0.0).collect()),
        depth_m,
        readings: Vec::new(),
    }
}

#[divan::bench(args = [180, 256])]
fn tsdf_frame_nodes(bencher: divan::Bencher, nodes: usize) {
    let (frame, noise) = (view(), NoiseConfig::default());
    let weights = vec![1.0; frame.depth_m.len()];
    let roles: Vec<PixelRole> = (0..weights.len())
        .map(|i| if frame.is_object(i) { PixelRole::Surface } else { PixelRole::FreeOnly })
        .collect();
    let mut volume =
        TsdfVolume::new(Point3::new(-0.25, -0.25, -0.25), 0.5 / (nodes - 1) as f64, [nodes; 3], 0.012);
    let views = [TsdfView::new(&frame, &weights, &roles, Pose::identity(), &noise)];
    bencher.bench_local(|| volume.integrate(&views));
}

#[divan::bench(sample_count = 20)]
fn render_350k_triangles(bencher: divan::Bencher) {
    let mesh = marching_cubes(&field(256), 0.0);
    let intrinsics = view().intrinsics;
    let item = RenderItem { mesh: &mesh, world_from_mesh: Pose::identity(), paint: Paint::Vertices };
    bencher.bench_local(|| render(&[item], &intrinsics, &Pose::translation(0.0, 0.0, -2.5), true));
}

#[divan::bench(sample_count = 20)]
fn closest_100k_points(bencher: divan::Bencher) {
    let tree = MeshDistance::new(&marching_cubes(&field(128), 0.0));
    let samples = sample_surface(
        &marching_cubes(&field(64), 0.05),
        100_000,
        &mut numeric::random::stage_rng(0, "bench", 0),
    );
    bencher.bench_local(|| tree.as_ref().map(|t| t.distances_m(&samples.points)));
}

#[divan::bench(sample_count = 3)]
fn simplify_350k_triangles(bencher: divan::Bencher) {
    let mesh = marching_cubes(&field(256), 0.0);
    bencher.bench_local(|| simplify(&mesh, 30_000, f64::INFINITY));
}
