//! Boxes, cylinders and capsules: ray intersections, meshes, bounds.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::Material;
use geometry::Pose;
use surface::TriangleMesh;

/// Sides of the mesh of a cylinder or capsule; rays intersect the exact shape.
const CYLINDER_SIDES: u32 = 64;
/// Rings of the mesh of each cap of a capsule.
const CAP_RINGS: u32 = 16;

/// A convex shape centered at its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Box with these half sides, meters.
    Cuboid(Vector3<f64>),
    /// Cylinder about z.
    Cylinder {
        /// Radius, meters.
        radius_m: f64,
        /// Half the height, meters.
        half_m: f64,
    },
    /// Points within a radius of a segment of the z axis.
    Capsule {
        /// Radius, meters.
        radius_m: f64,
        /// Half the length of the segment, meters.
        half_m: f64,
    },
}

/// A shape in the frame of its part.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Its shape.
    pub shape: Shape,
    /// Pose of the shape in the part.
    pub part_from_solid: Pose,
    /// Material of the surface.
    pub material: Material,
}

/// Intersection where a ray enters a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance as a multiple of the ray's direction.
    pub at: f64,
    /// Outward unit normal, in the frame of the ray.
    pub normal: Vector3<f64>,
}

impl Solid {
    /// An axis-aligned box between two corners in the part's frame, meters.
    pub fn box_between(lower: [f64; 3], upper: [f64; 3], material: &Material) -> Self {
        let lower = Vector3::from(lower);
        let upper = Vector3::from(upper);
        let center = (lower + upper) * 0.5;
        Self {
            shape: Shape::Cuboid((upper - lower) * 0.5),
            part_from_solid: Pose::translation(center.x, center.y, center.z),
            material: material.clone(),
        }
    }

    /// The same solid, moved in the part's frame.
    pub(super) fn moved(self, by: &Pose) -> Self {
        Self { part_from_solid: by * self.part_from_solid, ..self }
    }

    /// A capsule around the segment between two points in the part's frame, meters.
    pub fn capsule(radius_m: f64, from: Point3<f64>, to: Point3<f64>, material: &Material) -> Self {
        let along = to - from;
        // For an opposite direction the rotation is not unique; half a turn about x is chosen.
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &along)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        Self {
            shape: Shape::Capsule { radius_m, half_m: 0.5 * along.norm() },
            part_from_solid: Pose::from_parts(nalgebra::center(&from, &to).into(), turn),
            material: material.clone(),
        }
    }

    /// A cylinder at a pose.
    pub fn cylinder(radius_m: f64, half_m: f64, part_from_solid: Pose, material: &Material) -> Self {
        Self { shape: Shape::Cylinder { radius_m, half_m }, part_from_solid, material: material.clone() }
    }
}

impl Shape {
    /// Half sides of the smallest axis-aligned box around the shape, meters.
    pub fn half_sides(&self) -> Vector3<f64> {
        match *self {
            Self::Cuboid(half) => half,
            Self::Cylinder { radius_m, half_m } => Vector3::new(radius_m, radius_m, half_m),
            Self::Capsule { radius_m, half_m } => Vector3::new(radius_m, radius_m, half_m + radius_m),
        }
    }

    /// First entry of a ray, in the shape's frame, beyond the multiple `least`; `None` if it starts inside.
    pub fn hit_by(&self, origin: &Point3<f64>, ray: &Vector3<f64>, least: f64) -> Option<Hit> {
        match *self {
            Self::Cuboid(half) => hit_cuboid(origin, ray, &half),
            Self::Cylinder { radius_m, half_m } => hit_cylinder(origin, ray, radius_m, half_m),
            Self::Capsule { radius_m, half_m } => hit_capsule(origin, ray, radius_m, half_m),
        }
        .filter(|h| h.at > least)
    }

    /// Closed mesh in the shape's frame, with normals outward.
    pub fn closed_mesh(&self) -> TriangleMesh {
        match *self {
            Self::Cuboid(half) => cuboid_mesh(&half),
            Self::Cylinder { radius_m, half_m } => cylinder_mesh(radius_m, half_m),
            Self::Capsule { radius_m, half_m } => capsule_mesh(radius_m, half_m),
        }
    }
}

/// Slab method: the ray hits if the latest entry is before the earliest exit.
fn hit_cuboid(origin: &Point3<f64>, ray: &Vector3<f64>, half: &Vector3<f64>) -> Option<Hit> {
    let mut near = f64::NEG_INFINITY;
    let mut far = f64::INFINITY;
    let mut axis = 0;
    for k in 0..3 {
        // A ray parallel to a slab crosses neither side: it is inside or misses.
        if ray[k] == 0.0 {
            if origin[k].abs() > half[k] {
                return None;
            }
            continue;
        }
        // The sign of the ray selects the side it enters.
        let enter = (-half[k].copysign(ray[k]) - origin[k]) / ray[k];
        let leave = (half[k].copysign(ray[k]) - origin[k]) / ray[k];
        if enter > near {
            (near, axis) = (enter, k);
        }
        far = far.min(leave);
    }
    (near <= far).then(|| {
        let mut normal = Vector3::zeros();
        normal[axis] = -ray[axis].signum();
        Hit { at: near, normal }
    })
}

fn hit_cylinder(origin: &Point3<f64>, ray: &Vector3<f64>, radius_m: f64, half_m: f64) -> Option<Hit> {
    // The squared distance from the axis is quadratic along the ray.
    let a = ray.x * ray.x + ray.y * ray.y;
    let b = origin.x * ray.x + origin.y * ray.y;
    let c = origin.x * origin.x + origin.y * origin.y - radius_m * radius_m;
    let mut near = f64::NEG_INFINITY;
    let mut far = f64::INFINITY;
    let mut side = true;
    // A ray parallel to the axis never crosses the side.
    if a > 0.0 {
        let root = b * b - a * c;
        if root < 0.0 {
            return None;
        }
        (near, far) = ((-b - root.sqrt()) / a, (-b + root.sqrt()) / a);
    } else if c > 0.0 {
        return None;
    }
    if ray.z == 0.0 {
        if origin.z.abs() > half_m {
            return None;
        }
    } else {
        let enter = (-half_m.copysign(ray.z) - origin.z) / ray.z;
        if enter > near {
            (near, side) = (enter, false);
        }
        far = far.min((half_m.copysign(ray.z) - origin.z) / ray.z);
    }
    (near <= far).then(|| {
        let p = origin + ray * near;
        let normal = if side {
            Vector3::new(p.x / radius_m, p.y / radius_m, 0.0)
        } else {
            Vector3::new(0.0, 0.0, -ray.z.signum())
        };
        Hit { at: near, normal }
    })
}

/// A capsule is the side of a cylinder and a ball at each end; the first entry into any of them counts.
fn hit_capsule(origin: &Point3<f64>, ray: &Vector3<f64>, radius_m: f64, half_m: f64) -> Option<Hit> {
    let hits = [
        cylinder_side(origin, ray, radius_m, half_m),
        outer_half_ball(origin, ray, radius_m, half_m),
        outer_half_ball(origin, ray, radius_m, -half_m),
    ];
    hits.into_iter().flatten().min_by(|a, b| a.at.total_cmp(&b.at))
}

fn cylinder_side(origin: &Point3<f64>, ray: &Vector3<f64>, radius_m: f64, half_m: f64) -> Option<Hit> {
    let squared = ray.xy().norm_squared();
    let b = origin.xy().coords.dot(&ray.xy());
    let root = b * b - squared * (origin.xy().coords.norm_squared() - radius_m * radius_m);
    let at = (-b - root.max(0.0).sqrt()) / squared;
    let p = origin + ray * at;
    (root >= 0.0 && squared > 0.0 && p.z.abs() <= half_m)
        .then(|| Hit { at, normal: Vector3::new(p.x, p.y, 0.0) / radius_m })
}

/// Entry into the ball at one end of a capsule, on its outer half; the inner half is inside the capsule.
fn outer_half_ball(origin: &Point3<f64>, ray: &Vector3<f64>, radius_m: f64, z: f64) -> Option<Hit> {
    let from = origin - Vector3::z() * z;
    let a = ray.norm_squared();
    let b = from.coords.dot(ray);
    let root = b * b - a * (from.coords.norm_squared() - radius_m * radius_m);
    let at = (-b - root.max(0.0).sqrt()) / a;
    let p = from + ray * at;
    (root >= 0.0 && p.z * z.signum() >= 0.0).then(|| Hit { at, normal: p.coords / radius_m })
}

fn cuboid_mesh(half: &Vector3<f64>) -> TriangleMesh {
    let upper: Point3<f32> = Point3::from(*half).cast();
    TriangleMesh::cuboid(&-upper, &upper)
}

fn cylinder_mesh(radius_m: f64, half_m: f64) -> TriangleMesh {
    let n = CYLINDER_SIDES;
    let mut mesh = TriangleMesh::default();
    for z in [-half_m, half_m] {
        for i in 0..n {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
            mesh.vertices.push(Point3::new(radius_m * cos, radius_m * sin, z).cast());
        }
        mesh.vertices.push(Point3::new(0.0, 0.0, z).cast());
    }
    // Indices of the centers of both ends.
    let bottom = n;
    let top = 2 * n + 1;
    for i in 0..n {
        let a = i;
        let b = (i + 1) % n;
        let c = a + n + 1;
        let d = b + n + 1;
        mesh.triangles.extend([[a, b, d], [a, d, c], [b, a, bottom], [c, d, top]]);
    }
    mesh
}

fn capsule_mesh(radius_m: f64, half_m: f64) -> TriangleMesh {
    let n = CYLINDER_SIDES;
    let mut mesh = TriangleMesh::default();
    for ring in 0..2 * CAP_RINGS {
        // The lower cap runs from pole to equator, the upper one from equator to pole.
        let [upper, step] = [ring / CAP_RINGS, ring % CAP_RINGS + 1 - ring / CAP_RINGS];
        let from_pole = std::f64::consts::FRAC_PI_2 * f64::from(step) / f64::from(CAP_RINGS);
        let (r, z) = if upper == 0 {
            (radius_m * from_pole.sin(), -half_m - radius_m * from_pole.cos())
        } else {
            (radius_m * from_pole.cos(), half_m + radius_m * from_pole.sin())
        };
        for i in 0..n {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
            mesh.vertices.push(Point3::new(r * cos, r * sin, z).cast());
        }
    }
    let bottom = 2 * CAP_RINGS * n;
    mesh.vertices.extend([-1.0, 1.0].map(|s| Point3::new(0.0, 0.0, s * (half_m + radius_m)).cast::<f32>()));
    let last = (2 * CAP_RINGS - 1) * n;
    for i in 0..n {
        let next = (i + 1) % n;
        for ring in 0..2 * CAP_RINGS - 1 {
            let [a, b] = [i, next].map(|k| ring * n + k);
            mesh.triangles.extend([[a, b, b + n], [a, b + n, a + n]]);
        }
        mesh.triangles.extend([[next, i, bottom], [last + i, last + next, bottom + 1]]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use surface::is_watertight;

    #[test]
    fn hits_lie_on_the_surface_and_face_the_ray() {
        let shapes = [
            Shape::Cuboid(Vector3::new(0.3, 0.2, 0.1)),
            Shape::Cylinder { radius_m: 0.25, half_m: 0.15 },
            Shape::Capsule { radius_m: 0.15, half_m: 0.12 },
        ];
        for shape in shapes {
            let mesh = shape.closed_mesh();
            assert!(is_watertight(&mesh));
            let mut hits = 0;
            for i in 0..400 {
                let u = f64::from(i % 20) / 10.0 - 0.95;
                let v = f64::from(i / 20) / 10.0 - 0.95;
                let origin = Point3::new(1.0, 1.3 * u, 1.1);
                let target = Point3::new(0.0, 0.4 * v, 0.3 * u);
                let ray = target - origin;
                let Some(hit) = shape.hit_by(&origin, &ray, 0.0) else { continue };
                hits += 1;
                assert!(hit.normal.dot(&ray) < 0.0 && (hit.normal.norm() - 1.0).abs() < 1e-9);
                let p = origin + ray * hit.at;
                let off = match shape {
                    Shape::Cuboid(half) => (p.coords.abs() - half).max(),
                    Shape::Cylinder { radius_m, half_m } => {
                        (p.coords.xy().norm() - radius_m).max(p.z.abs() - half_m)
                    }
                    Shape::Capsule { radius_m, half_m } => {
                        (p - Point3::new(0.0, 0.0, p.z.clamp(-half_m, half_m))).norm() - radius_m
                    }
                };
                assert!(off.abs() < 1e-9);
            }
            assert!(hits > 50);
            let volume: f32 = (0..mesh.triangles.len())
                .map(|t| {
                    let [a, b, c] = mesh.corners(t).map(|p| p.coords);
                    a.dot(&b.cross(&c)) / 6.0
                })
                .sum();
            let exact = match shape {
                Shape::Cuboid(half) => 8.0 * half.product(),
                Shape::Cylinder { radius_m, half_m } => {
                    std::f64::consts::PI * radius_m * radius_m * 2.0 * half_m
                }
                Shape::Capsule { radius_m, half_m } => {
                    std::f64::consts::PI * radius_m * radius_m * (2.0 * half_m + 4.0 / 3.0 * radius_m)
                }
            };
            assert!((f64::from(volume) / exact - 1.0).abs() < 0.004);
        }
    }

    #[test]
    fn rays_along_an_axis_and_from_within() {
        let cuboid = Shape::Cuboid(Vector3::repeat(0.1));
        let along = cuboid.hit_by(&Point3::new(-1.0, 0.05, 0.0), &Vector3::x(), 0.0).unwrap();
        assert!((along.at - 0.9).abs() < 1e-12 && along.normal == -Vector3::x());
        assert_eq!(cuboid.hit_by(&Point3::new(-1.0, 0.2, 0.0), &Vector3::x(), 0.0), None);
        assert_eq!(cuboid.hit_by(&Point3::origin(), &Vector3::x(), 0.0), None);
        let can = Shape::Cylinder { radius_m: 0.1, half_m: 0.2 };
        assert!(
            (can.hit_by(&Point3::new(0.05, 0.0, 1.0), &-Vector3::z(), 0.0).unwrap().at - 0.8).abs() < 1e-12
        );
        assert_eq!(can.hit_by(&Point3::new(0.15, 0.0, 1.0), &-Vector3::z(), 0.0), None);
    }
}
