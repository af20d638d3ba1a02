//! Analytic shapes for the tests: signed distances and meshes.

use nalgebra::{Point3, Vector3};

use super::TriangleMesh;
use crate::{
    capture::RgbdFrame,
    geometry::{Grid3, Intrinsics, Pose},
};

/// Samples a function at the nodes of a cube `[-half, half]^3`.
pub fn grid_of(half_m: f64, nodes: usize, f: impl Fn(&Point3<f64>) -> f64) -> Grid3<f32> {
    let spacing_m = 2.0 * half_m / (nodes - 1) as f64;
    let mut g = Grid3 {
        origin: Point3::new(-half_m, -half_m, -half_m),
        spacing_m,
        dims: [nodes; 3],
        values: vec![0.0; nodes.pow(3)],
    };
    for i in 0..g.values.len() {
        g.values[i] = f(&g.position(i)) as f32;
    }
    g
}

pub fn sphere(radius_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| p.coords.norm() - radius_m
}

pub fn cuboid(half: Vector3<f64>) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| {
        let q = p.coords.abs() - half;
        q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
    }
}

pub fn torus(major_m: f64, minor_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| (p.coords.xy().norm() - major_m).hypot(p.z) - minor_m
}

/// A cuboid of the given half sides as twelve triangles.
pub fn box_mesh(half: Vector3<f32>) -> TriangleMesh {
    let vertices = (0..8)
        .map(|i| {
            Point3::from(Vector3::from([0, 1, 2].map(|k| if i >> k & 1 == 1 { half[k] } else { -half[k] })))
        })
        .collect();
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriangleMesh { vertices, triangles, colors: Vec::new() }
}

/// A sphere as latitude bands; closed, outward.
pub fn sphere_mesh(radius_m: f32, bands: u32) -> TriangleMesh {
    let (rows, columns) = (bands, 2 * bands);
    let mut mesh =
        TriangleMesh { vertices: vec![Point3::new(0.0, 0.0, -radius_m)], ..TriangleMesh::default() };
    for r in 1..rows {
        let polar = std::f32::consts::PI * r as f32 / rows as f32;
        for c in 0..columns {
            let azimuth = std::f32::consts::TAU * c as f32 / columns as f32;
            mesh.vertices.push(Point3::from(
                Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), -polar.cos())
                    * radius_m,
            ));
        }
    }
    mesh.vertices.push(Point3::new(0.0, 0.0, radius_m));
    let top = mesh.vertices.len() as u32 - 1;
    let at = |r: u32, c: u32| 1 + (r - 1) * columns + c % columns;
    for c in 0..columns {
        mesh.triangles.push([0, at(1, c + 1), at(1, c)]);
        for r in 1..rows - 1 {
            mesh.triangles.push([at(r, c), at(r, c + 1), at(r + 1, c + 1)]);
            mesh.triangles.push([at(r, c), at(r + 1, c + 1), at(r + 1, c)]);
        }
        mesh.triangles.push([top, at(rows - 1, c), at(rows - 1, c + 1)]);
    }
    mesh
}

/// Enclosed volume by the divergence theorem.
pub fn volume_m3(mesh: &TriangleMesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p.coords.cast::<f64>());
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum()
}

/// A camera at `eye` that looks at the origin.
pub fn looking_at_origin(eye: Point3<f64>) -> Pose {
    let up = if eye.coords.xy().norm() < 1e-3 { Vector3::x() } else { Vector3::z() };
    let forward = -eye.coords.normalize();
    let right = forward.cross(&up).normalize();
    let r = nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    Pose::from_parts(
        eye.coords.into(),
        nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r)),
    )
}

/// What a camera sees of a signed distance function, by sphere tracing; the background has no depth. Colors
/// encode the position: 128 + 400 a meter.
pub fn view_of(
    distance: &dyn Fn(&Point3<f64>) -> f64,
    intrinsics: Intrinsics,
    world_from_camera: Pose,
) -> RgbdFrame {
    let count = intrinsics.width * intrinsics.height;
    let mut frame = RgbdFrame {
        id: String::new(),
        stamp_nanos: 0,
        intrinsics,
        world_from_camera,
        rgb: vec![[0; 3]; count],
        depth_m: vec![0.0; count],
        mask: Some(vec![false; count]),
        readings: Vec::new(),
    };
    for i in 0..count {
        let ray = intrinsics.ray((i % intrinsics.width) as f64, (i / intrinsics.width) as f64);
        let mut z = 0.0;
        for _ in 0..200 {
            let p = world_from_camera * Point3::from(ray * z);
            let d = distance(&p);
            if d < 1e-7 {
                frame.depth_m[i] = z as f32;
                frame.rgb[i] = color_of(&p);
                frame.mask.as_mut().unwrap()[i] = true;
                break;
            }
            z += d / ray.norm();
            if z > 5.0 {
                break;
            }
        }
    }
    frame
}

/// Color of a position in [`view_of`].
pub fn color_of(p: &Point3<f64>) -> [u8; 3] {
    [0, 1, 2].map(|k| (128.0 + 400.0 * p[k]).round().clamp(0.0, 255.0) as u8)
}

/// Views from all around, evenly spread (a Fibonacci lattice), at the given distance.
pub fn orbit(distance: &dyn Fn(&Point3<f64>) -> f64, views: usize, range_m: f64) -> Vec<RgbdFrame> {
    let k = Intrinsics { width: 200, height: 160, fx: 210.0, fy: 208.0, cx: 101.3, cy: 78.6 };
    (0..views)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / views as f64;
            let azimuth = i as f64 * std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
            let r = (1.0 - z * z).sqrt();
            view_of(
                distance,
                k,
                looking_at_origin(Point3::new(r * azimuth.cos(), r * azimuth.sin(), z) * range_m),
            )
        })
        .collect()
}
