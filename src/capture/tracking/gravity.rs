//! The direction of up, without reported poses: by accelerations, by the object's support plane, or by the
//! images.

use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};

use super::{imu::MeasuredUp, locate::mean_depth_m, observation::Observation, track::Track};
use crate::select::common_focus;
use geometry::Pose;
use numeric::statistics::median;

/// Surfels looked at.
const LOOKED_AT: usize = 8_000;
/// Of those, one in so many proposes its plane.
const PROPOSING: usize = 20;
/// A surfel within so many standard deviations lies on a plane.
/// chosen: 0.3 % of a normal distribution
const GATE: f64 = 3.0;
/// Depth of surfels errs by this share, warp included. chosen: the warp of a depth sensor, and a little more
const DEPTH_SHARE: f64 = 0.005;
/// Least cosine between the normals of a surfel and of its plane. chosen: 20 deg
const SAME_COSINE: f64 = 0.94;
/// A support looks up in the images by at least this sine. A wall looks down for a camera turned down.
/// chosen: 10 deg
const LEAST_UP: f64 = 0.17;
/// Least share of all surface on a support.
/// chosen: a smaller one may be a shelf or a step of the object
const LEAST_SHARE: f64 = 0.05;
/// Largest share of the surface below a support. derived: as for background planes (`isolate::plane`)
const BELOW_SHARE: f64 = 0.05;
/// Tilt of supports, one standard deviation, radians.
/// chosen: the feet of a table of 1 m differ by 1 cm; floors are better (DIN 18202: 4 mm on 1 m)
const LEVEL_RAD: f64 = 0.01;
/// Directions further apart than so many of their deviations contradict each other.
/// chosen: 0.3 % of a normal distribution
const APART: f64 = 3.0;

/// Source of the direction of up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpBy {
    /// The largest plane below everything, with its normal up in the images.
    Support,
    /// The images' own upright, for want of such a plane.
    Images,
    /// A measured acceleration.
    Imu,
}

/// The world of a tracked thing.
#[derive(Clone, Copy, Debug)]
pub struct Upright {
    /// From the map.
    pub world_from_map: Pose,
    /// Source of the direction of up.
    pub by: UpBy,
    /// Standard deviation of up, radians; `None` where only the images say so.
    pub sigma_rad: Option<f64>,
    /// Angle between measured gravity and the support's normal, radians, where there are both.
    pub apart_rad: Option<f64>,
    /// Whether the angle is beyond the errors of both.
    pub contradicted: bool,
}

/// Views with known places.
pub(super) struct Placed<'a> {
    pub observations: Vec<&'a Observation>,
    pub poses: &'a [Pose],
}

/// The plane below everything.
struct SupportPlane {
    normal: Unit<Vector3<f64>>,
    offset_m: f64,
    /// Standard deviation of up by it, radians.
    sigma_rad: f64,
}

/// A piece of surface.
struct SurfacePatch {
    point: Point3<f64>,
    /// Towards the camera.
    normal: Vector3<f64>,
    /// Its area, up to a factor.
    weight: f64,
    gate_m: f64,
}

impl Track {
    /// The world of the twin: z up, x along the cameras' view, the origin on the support below their focus.
    /// Up is from accelerations or the support, the better known of both.
    #[must_use]
    pub fn upright_world(&self) -> Upright {
        let measured = self.measured_up.as_ref().and_then(|m| m.as_ref().ok());
        Placed { observations: self.observations.iter().collect(), poses: &self.key_poses }
            .upright_world(measured)
    }
}

impl Placed<'_> {
    pub fn upright_world(&self, measured: Option<&MeasuredUp>) -> Upright {
        let patches = self.surface_patches();
        let upright = self.images_upright();
        let by_images = support_plane(&patches, &upright);
        // A camera held on its side sees walls below; axes mixed up make a wall of the floor. A plane in
        // agreement with gravity is the support, if there is one.
        let support = match measured {
            None => by_images,
            Some(m) => {
                let found = [by_images, support_plane(&patches, &m.up)].into_iter().flatten();
                found.min_by(|a, b| a.normal.angle(&m.up).total_cmp(&b.normal.angle(&m.up)))
            }
        };
        let apart = measured.zip(support.as_ref()).map(|(m, s)| {
            let apart_rad = m.up.angle(&s.normal);
            (apart_rad, apart_rad > APART * m.sigma_rad.hypot(s.sigma_rad))
        });
        let (normal, by, sigma_rad) = match (measured, &support) {
            (Some(m), Some(s)) if s.sigma_rad < m.sigma_rad => (s.normal, UpBy::Support, Some(s.sigma_rad)),
            (Some(m), _) => (m.up, UpBy::Imu, Some(m.sigma_rad)),
            (None, Some(s)) => (s.normal, UpBy::Support, Some(s.sigma_rad)),
            (None, None) => (upright, UpBy::Images, None),
        };
        Upright {
            world_from_map: self.world_from_map(&patches, &normal, support.as_ref()),
            by,
            sigma_rad,
            apart_rad: apart.map(|a| a.0),
            contradicted: apart.is_some_and(|a| a.1),
        }
    }

    fn world_from_map(
        &self,
        patches: &[SurfacePatch],
        normal: &Unit<Vector3<f64>>,
        support: Option<&SupportPlane>,
    ) -> Pose {
        let ahead = self.poses.iter().map(|p| p.rotation * Vector3::z()).sum::<Vector3<f64>>();
        let focus =
            common_focus(self.poses).unwrap_or_else(|| self.poses[0] * Point3::new(0.0, 0.0, self.depth_m()));
        // Below the focus: on the support, or on the lowest tenth of the seen surface.
        let height_m = |p: &Point3<f64>| normal.dot(&p.coords);
        let floor_m = match support {
            Some(plane) if plane.normal.dot(normal) > SAME_COSINE => {
                (plane.offset_m - plane.normal.dot(&focus.coords)) / plane.normal.dot(normal)
                    + height_m(&focus)
            }
            _ => tenth_percentile(patches.iter().map(|p| height_m(&p.point)).collect()),
        };
        let origin = focus + normal.into_inner() * (floor_m - height_m(&focus));
        let flat = ahead - normal.into_inner() * normal.dot(&ahead);
        // Cameras turned straight down have no direction ahead; any will do.
        let x = flat.try_normalize(1e-3 * ahead.norm().max(1e-12)).unwrap_or_else(|| {
            let aside = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
            normal.cross(&aside).normalize()
        });
        let axes = Matrix3::from_columns(&[x, normal.cross(&x), normal.into_inner()]);
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(axes);
        let map_from_world =
            Pose::from_parts(origin.coords.into(), UnitQuaternion::from_rotation_matrix(&rotation));
        map_from_world.inverse()
    }

    /// Mean direction of up in the images.
    fn images_upright(&self) -> Unit<Vector3<f64>> {
        let up = self.poses.iter().map(|p| p.rotation * -Vector3::y()).sum::<Vector3<f64>>();
        Unit::try_new(up, 1e-9).unwrap_or_else(|| Unit::new_unchecked(-Vector3::y()))
    }

    fn depth_m(&self) -> f64 {
        median(self.observations.iter().map(|o| mean_depth_m(&o.surfels)).collect()).unwrap_or(1.0)
    }

    fn surface_patches(&self) -> Vec<SurfacePatch> {
        let count: usize = self.observations.iter().map(|o| o.surfels.sum_of_points().1 as usize).sum();
        let every = count.div_ceil(LOOKED_AT).max(1);
        let mut patches = Vec::new();
        for (observation, pose) in self.observations.iter().zip(self.poses) {
            patches.extend(observation.surfels.points(every).map(|(point, normal)| SurfacePatch {
                // A surfel covers more where it is further away, and where it is seen from aside.
                weight: point.z.powi(2) / normal.dot(&point.coords.normalize()).max(0.1),
                gate_m: GATE * DEPTH_SHARE * point.z,
                point: pose * point,
                normal: -(pose.rotation * normal),
            }));
        }
        patches
    }
}

/// Normal and offset of the largest plane below everything, facing up by about `upright`.
fn support_plane(patches: &[SurfacePatch], upright: &Unit<Vector3<f64>>) -> Option<SupportPlane> {
    let total: f64 = patches.iter().map(|p| p.weight).sum();
    let mut best: Option<(f64, Unit<Vector3<f64>>, f64)> = None;
    for proposing in patches.iter().step_by(PROPOSING) {
        let Some(normal) = Unit::try_new(proposing.normal, 1e-9) else { continue };
        if normal.dot(upright) < LEAST_UP {
            continue;
        }
        let offset_m = normal.dot(&proposing.point.coords);
        let on = patches.iter().filter(|p| is_on(p, &normal, offset_m));
        let held: f64 = on.map(|p| p.weight).sum();
        let below = patches.iter().filter(|p| normal.dot(&p.point.coords) - offset_m < -2.0 * p.gate_m);
        let lower: f64 = below.map(|p| p.weight).sum();
        if lower <= BELOW_SHARE * total && held >= LEAST_SHARE * total && best.is_none_or(|b| held > b.0) {
            best = Some((held, normal, offset_m));
        }
    }
    let (_, normal, offset_m) = best?;
    let mut found = SupportPlane { normal, offset_m, sigma_rad: LEVEL_RAD };
    for _ in 0..5 {
        found = refitted_plane(patches, &found)?;
    }
    Some(found)
}

fn is_on(patch: &SurfacePatch, normal: &Unit<Vector3<f64>>, offset_m: f64) -> bool {
    (normal.dot(&patch.point.coords) - offset_m).abs() <= patch.gate_m
        && normal.dot(&patch.normal) >= SAME_COSINE
}

/// Least squares over the patches on a plane.
fn refitted_plane(patches: &[SurfacePatch], plane: &SupportPlane) -> Option<SupportPlane> {
    let on: Vec<&SurfacePatch> = patches.iter().filter(|p| is_on(p, &plane.normal, plane.offset_m)).collect();
    let weight = |p: &SurfacePatch| p.weight / p.gate_m.powi(2);
    let total: f64 = on.iter().map(|p| weight(p)).sum();
    let mean = on.iter().map(|p| p.point.coords * weight(p)).sum::<Vector3<f64>>() / total;
    let spread = on
        .iter()
        .map(|p| (p.point.coords - mean) * (p.point.coords - mean).transpose() * weight(p))
        .sum::<Matrix3<f64>>()
        / total;
    let eigen = spread.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let found = Unit::try_new(eigen.eigenvectors.column(least).into_owned(), 1e-9)?;
    let normal = if found.dot(&plane.normal) < 0.0 { -found } else { found };
    // The warp of a sensor is the same in all its readings: more patches do not average it away, only the
    // reach of the plane counts, in its shortest direction.
    let reach_m =
        (0..3).filter(|k| *k != least).map(|k| eigen.eigenvalues[k].sqrt()).fold(f64::INFINITY, f64::min);
    let error_m = on.iter().map(|p| p.gate_m * weight(p)).sum::<f64>() / (GATE * total);
    Some(SupportPlane {
        normal,
        offset_m: normal.dot(&mean),
        sigma_rad: LEVEL_RAD.hypot(error_m / reach_m.max(1e-9)),
    })
}

/// The tenth percentile; 0 of none.
fn tenth_percentile(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 10).copied().unwrap_or(0.0)
}
