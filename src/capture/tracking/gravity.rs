//! Which way is up, where no pose says so: by the plane that the object stands on, or by the images.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::track::Track;
use crate::{capture::select::common_focus, geometry::Pose, statistics::median};

/// Surfels looked at.
const LOOKED_AT: usize = 8_000;
/// Of those, one in so many proposes the plane on which it lies.
const PROPOSING: usize = 20;
/// A surfel within so many standard deviations lies on a plane.
/// derived: 0.3 % of a normal distribution
const GATE: f64 = 3.0;
/// Depth of surfels errs by this share, warp included.
/// measured: as in the motion by landmarks
const DEPTH_SHARE: f64 = 0.005;
/// Cosine between the normals of a surfel and of the plane that it lies on, at least.
/// derived: 20 deg
const SAME_COSINE: f64 = 0.94;
/// A support looks up in the images by at least this sine. A wall looks down in those of a camera that looks
/// down.
/// derived: 10 deg
const LEAST_UP: f64 = 0.17;
/// Share of all surface that a support holds, at least.
/// derived: what is smaller may be a shelf or a step of the object
const LEAST_SHARE: f64 = 0.05;
/// Share of the surface that may lie below a support.
/// tuned: as for background planes
const BELOW_SHARE: f64 = 0.05;

/// What says which way is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpBy {
    /// The largest plane below everything that looks up in the images.
    Support,
    /// The images' own upright, for want of such a plane.
    Images,
    /// A measured acceleration.
    Imu,
}

/// A piece of surface.
struct Patch {
    point: Point3<f64>,
    /// Towards the camera.
    normal: Vector3<f64>,
    /// Area that it stands for, up to a factor.
    weight: f64,
    gate_m: f64,
}

impl Track {
    /// The world in which the twin stands: z up, x to where the cameras look, the origin on the support below
    /// what they look at. `up`: the direction upwards in the map, where it was measured.
    #[must_use]
    pub fn upright(&self, up: Option<Unit<Vector3<f64>>>) -> (Pose, UpBy) {
        let patches = self.patches();
        let upright = self.images_upright();
        let support = support(&patches, up.as_ref().unwrap_or(&upright));
        let (normal, by) = match (up, &support) {
            (Some(up), _) => (up, UpBy::Imu),
            (None, Some((normal, _))) => (*normal, UpBy::Support),
            (None, None) => (upright, UpBy::Images),
        };
        let ahead = self.key_poses.iter().map(|p| p.rotation * Vector3::z()).sum::<Vector3<f64>>();
        let focus = common_focus(&self.key_poses).unwrap_or_else(|| {
            let depths = self.patches_depth_m();
            self.key_poses[0] * Point3::new(0.0, 0.0, depths)
        });
        // Below the focus: on the support, or on the lowest tenth of what is seen.
        let height_m = |p: &Point3<f64>| normal.dot(&p.coords);
        let floor_m = match &support {
            Some((plane, offset_m)) if plane.dot(&normal) > SAME_COSINE => {
                (offset_m - plane.dot(&focus.coords)) / plane.dot(&normal) + height_m(&focus)
            }
            _ => low(patches.iter().map(|p| height_m(&p.point)).collect()),
        };
        let origin = focus + normal.into_inner() * (floor_m - height_m(&focus));
        let flat = ahead - normal.into_inner() * normal.dot(&ahead);
        // Cameras that look straight down have no direction ahead; any will do.
        let x = flat.try_normalize(1e-3 * ahead.norm().max(1e-12)).unwrap_or_else(|| {
            let aside = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
            normal.cross(&aside).normalize()
        });
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[
            x,
            normal.cross(&x),
            normal.into_inner(),
        ]));
        let map_from_world =
            Pose::from_parts(origin.coords.into(), UnitQuaternion::from_rotation_matrix(&rotation));
        (map_from_world.inverse(), by)
    }

    /// Mean of what is up in the images.
    fn images_upright(&self) -> Unit<Vector3<f64>> {
        let up = self.key_poses.iter().map(|p| p.rotation * -Vector3::y()).sum::<Vector3<f64>>();
        Unit::try_new(up, 1e-9).unwrap_or_else(|| Unit::new_unchecked(-Vector3::y()))
    }

    fn patches_depth_m(&self) -> f64 {
        median(self.observations.iter().map(|o| super::locate::mean_depth_m(&o.surfels)).collect())
            .unwrap_or(1.0)
    }

    fn patches(&self) -> Vec<Patch> {
        let count: usize = self.observations.iter().map(|o| o.surfels.sum().1 as usize).sum();
        let every = count.div_ceil(LOOKED_AT).max(1);
        let of_keyframe = |(observation, pose): (&super::Observation, &Pose)| -> Vec<Patch> {
            let patch = |(point, normal): (Point3<f64>, Vector3<f64>)| Patch {
                // A surfel covers more where it is further away, and where it is seen from aside.
                weight: point.z.powi(2) / normal.dot(&point.coords.normalize()).max(0.1),
                gate_m: GATE * DEPTH_SHARE * point.z,
                point: pose * point,
                normal: -(pose.rotation * normal),
            };
            observation.surfels.points(every).map(patch).collect()
        };
        self.observations.iter().zip(&self.key_poses).flat_map(of_keyframe).collect()
    }
}

/// Normal and offset of the largest plane below everything that faces up by about `upright`.
fn support(patches: &[Patch], upright: &Unit<Vector3<f64>>) -> Option<(Unit<Vector3<f64>>, f64)> {
    let total: f64 = patches.iter().map(|p| p.weight).sum();
    let mut best: Option<(f64, Unit<Vector3<f64>>, f64)> = None;
    for proposing in patches.iter().step_by(PROPOSING) {
        let Some(normal) = Unit::try_new(proposing.normal, 1e-9) else { continue };
        if normal.dot(upright) < LEAST_UP {
            continue;
        }
        let offset_m = normal.dot(&proposing.point.coords);
        let on = |p: &&Patch| is_on(p, &normal, offset_m);
        let held: f64 = patches.iter().filter(on).map(|p| p.weight).sum();
        let below = |p: &&Patch| normal.dot(&p.point.coords) - offset_m < -2.0 * p.gate_m;
        let lower: f64 = patches.iter().filter(below).map(|p| p.weight).sum();
        if lower <= BELOW_SHARE * total && held >= LEAST_SHARE * total && best.is_none_or(|b| held > b.0) {
            best = Some((held, normal, offset_m));
        }
    }
    let (_, mut normal, mut offset_m) = best?;
    for _ in 0..5 {
        (normal, offset_m) = refit(patches, &normal, offset_m)?;
    }
    Some((normal, offset_m))
}

fn is_on(patch: &Patch, normal: &Unit<Vector3<f64>>, offset_m: f64) -> bool {
    (normal.dot(&patch.point.coords) - offset_m).abs() <= patch.gate_m
        && normal.dot(&patch.normal) >= SAME_COSINE
}

/// Least squares over the patches on a plane.
fn refit(patches: &[Patch], normal: &Unit<Vector3<f64>>, offset_m: f64) -> Option<(Unit<Vector3<f64>>, f64)> {
    let on: Vec<&Patch> = patches.iter().filter(|p| is_on(p, normal, offset_m)).collect();
    let weight = |p: &Patch| p.weight / p.gate_m.powi(2);
    let total: f64 = on.iter().map(|p| weight(p)).sum();
    let mean = on.iter().map(|p| p.point.coords * weight(p)).sum::<Vector3<f64>>() / total;
    let spread = on
        .iter()
        .map(|p| (p.point.coords - mean) * (p.point.coords - mean).transpose() * weight(p))
        .sum::<nalgebra::Matrix3<f64>>();
    let eigen = spread.symmetric_eigen();
    let found = Unit::try_new(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned(), 1e-9)?;
    let found = if found.dot(normal) < 0.0 { -found } else { found };
    Some((found, found.dot(&mean)))
}

/// The value that a tenth lie below; 0 of none.
fn low(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 10).copied().unwrap_or(0.0)
}
