//! Synthetic frames of solids with known signed distance functions, for tests and examples.

use geometry::{Intrinsics, Pose, lattice_directions};
use nalgebra::{Point3, Vector3};

use crate::RgbdFrame;

/// Signed distance to a sphere about the origin, meters.
pub fn sphere(radius_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| p.coords.norm() - radius_m
}

/// Signed distance to a cuboid about the origin, meters.
pub fn cuboid(half: Vector3<f64>) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| {
        let q = p.coords.abs() - half;
        q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
    }
}

/// Signed distance to a torus about the z axis, meters.
pub fn torus(major_m: f64, minor_m: f64) -> impl Fn(&Point3<f64>) -> f64 {
    move |p| (p.coords.xy().norm() - major_m).hypot(p.z) - minor_m
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

/// The view of a signed distance function, by sphere tracing; the background has no depth. Colors encode the
/// position: 128 + 400 per meter.
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
        mask: None,
        readings: Vec::new(),
    };
    let mut mask = vec![false; count];
    for i in 0..count {
        let ray = intrinsics.ray_at((i % intrinsics.width) as f64, (i / intrinsics.width) as f64);
        let mut z = 0.0;
        for _ in 0..200 {
            let p = world_from_camera * Point3::from(ray * z);
            let d = distance(&p);
            if d < 1e-7 {
                frame.depth_m[i] = z as f32;
                frame.rgb[i] = color_of(&p);
                mask[i] = true;
                break;
            }
            z += d / ray.norm();
            if z > 5.0 {
                break;
            }
        }
    }
    frame.mask = Some(mask);
    frame
}

/// Color of a position as in [`view_of`].
pub fn color_of(p: &Point3<f64>) -> [u8; 3] {
    [0, 1, 2].map(|k| (128.0 + 400.0 * p[k]).round().clamp(0.0, 255.0) as u8)
}

/// Views at the given distance from evenly spread directions (a Fibonacci lattice).
pub fn orbit(distance: &dyn Fn(&Point3<f64>) -> f64, views: usize, range_m: f64) -> Vec<RgbdFrame> {
    let k = Intrinsics { width: 200, height: 160, fx: 210.0, fy: 208.0, cx: 101.3, cy: 78.6 };
    lattice_directions(views)
        .map(|d| view_of(distance, k, looking_at_origin(Point3::from(d * range_m))))
        .collect()
}
