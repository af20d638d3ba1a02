//! The up direction without reported poses: from an accelerometer, the support plane of the object, or the
//! image axes.

use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};

use super::{imu::MeasuredUp, locate::mean_depth_m, observation::Observation, track::Track};
use crate::{poses::surfels::Surfels, select::common_focus};
use geometry::Pose;
use numeric::statistics::median;

/// Number of sampled surfels.
const LOOKED_AT: usize = 8_000;
/// One in this many of them proposes its plane.
const PROPOSING: usize = 20;
/// Largest distance of a surfel on a plane, standard deviations.
/// chosen: 0.3 % of a normal distribution
const GATE: f64 = 3.0;
/// Depth error of surfels, share of the depth, warp included. chosen: the warp of a depth sensor, and a
/// little more
const DEPTH_SHARE: f64 = 0.005;
/// Least cosine between the normals of a surfel and of its plane. chosen: 20 deg
const SAME_COSINE: f64 = 0.94;
/// Least sine of the angle by which a support plane faces up in the images; a wall faces down if the camera
/// is tilted down.
/// chosen: 10 deg
const LEAST_UP: f64 = 0.17;
/// Least share of the observed surface on a support plane.
/// chosen: a smaller one may be a shelf or a step of the object
const LEAST_SHARE: f64 = 0.05;
/// Largest share of the observed surface below a support plane. derived: as for background planes
/// (`isolate::plane`)
const BELOW_SHARE: f64 = 0.05;
/// Standard deviation of a support's tilt, radians.
/// chosen: the feet of a table of 1 m differ by 1 cm; floors are better (DIN 18202: 4 mm on 1 m)
const LEVEL_RAD: f64 = 0.01;
/// Largest difference of two up directions that agree, standard deviations.
/// chosen: 0.3 % of a normal distribution
const APART: f64 = 3.0;

/// Source of the up direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpBy {
    /// The largest plane with nothing below it, if its normal points up in the images.
    Support,
    /// The images' own up axis, without such a plane.
    Images,
    /// A measured acceleration.
    Imu,
}

/// The upright world frame of a track.
#[derive(Clone, Copy, Debug)]
pub struct Upright {
    /// Pose of the map in the world.
    pub world_from_map: Pose,
    /// Source of the up direction.
    pub by: UpBy,
    /// Standard deviation of the up direction, radians; `None` if it comes from the images only.
    pub sigma_rad: Option<f64>,
    /// Angle between measured gravity and the support's normal, radians; `None` unless both exist.
    pub apart_rad: Option<f64>,
    /// Whether this angle exceeds the errors of both.
    pub contradicted: bool,
}

/// Views with known poses.
pub(super) struct Placed<'a> {
    pub observations: Vec<&'a Observation>,
    pub poses: &'a [Pose],
}

/// A plane with nothing below it.
pub(super) struct SupportPlane {
    pub normal: Unit<Vector3<f64>>,
    offset_m: f64,
    /// Share of the observed surface that lies on it.
    pub share: f64,
    /// Standard deviation of its normal, radians.
    sigma_rad: f64,
}

/// A sampled patch of surface.
pub(super) struct SurfacePatch {
    point: Point3<f64>,
    /// Unit normal, pointing towards the camera.
    normal: Vector3<f64>,
    /// Its area, up to a factor.
    weight: f64,
    gate_m: f64,
}

impl Track {
    /// The world frame of the twin: z up, x along the cameras' view, origin on the support below their focus.
    /// Up comes from accelerations or the support, whichever is more accurate.
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
        // A camera held sideways sees walls below, and with swapped axes the floor looks like a wall. A plane
        // that agrees with measured gravity is the support, if there is one.
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
        // Below the focus, at the height of the support or else of the lowest tenth of the surface.
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
        // Cameras looking straight down have no forward direction; any will do.
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

    /// Mean up axis of the images.
    fn images_upright(&self) -> Unit<Vector3<f64>> {
        images_up(self.poses).unwrap_or_else(|| Unit::new_unchecked(-Vector3::y()))
    }

    fn depth_m(&self) -> f64 {
        median(self.observations.iter().map(|o| mean_depth_m(&o.surfels)).collect()).unwrap_or(1.0)
    }

    fn surface_patches(&self) -> Vec<SurfacePatch> {
        let surfels: Vec<&Surfels> = self.observations.iter().map(|o| &o.surfels).collect();
        surface_patches(&surfels, self.poses)
    }
}

/// Samples of the surface that cameras at the given poses see.
pub(super) fn surface_patches(surfels: &[&Surfels], poses: &[Pose]) -> Vec<SurfacePatch> {
    let count: usize = surfels.iter().map(|s| s.sum_of_points().1 as usize).sum();
    let every = count.div_ceil(LOOKED_AT).max(1);
    let mut patches = Vec::new();
    for (surfels, pose) in surfels.iter().zip(poses) {
        patches.extend(surfels.points(every).map(|(point, normal)| SurfacePatch {
            // A surfel covers more area if it is far away or seen at an angle.
            weight: point.z.powi(2) / normal.dot(&point.coords.normalize()).max(0.1),
            gate_m: GATE * DEPTH_SHARE * point.z,
            point: pose * point,
            normal: -(pose.rotation * normal),
        }));
    }
    patches
}

/// Mean up axis of images; `None` if they are held in all directions.
pub(super) fn images_up(poses: &[Pose]) -> Option<Unit<Vector3<f64>>> {
    let up = poses.iter().map(|p| p.rotation * -Vector3::y()).sum::<Vector3<f64>>();
    Unit::try_new(up, 1e-9)
}

/// The largest plane with nothing below it that faces up, about along `upright`.
pub(super) fn support_plane(patches: &[SurfacePatch], upright: &Unit<Vector3<f64>>) -> Option<SupportPlane> {
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
    let (held, normal, offset_m) = best?;
    let mut found = SupportPlane { normal, offset_m, share: held / total, sigma_rad: LEVEL_RAD };
    for _ in 0..5 {
        found = refitted_plane(patches, &found)?;
    }
    Some(found)
}

fn is_on(patch: &SurfacePatch, normal: &Unit<Vector3<f64>>, offset_m: f64) -> bool {
    (normal.dot(&patch.point.coords) - offset_m).abs() <= patch.gate_m
        && normal.dot(&patch.normal) >= SAME_COSINE
}

/// Least squares fit to the patches on a plane.
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
    // The sensor's warp is common to all readings and does not average out: only the extent of the plane in
    // its shortest direction counts.
    let reach_m =
        (0..3).filter(|k| *k != least).map(|k| eigen.eigenvalues[k].sqrt()).fold(f64::INFINITY, f64::min);
    let error_m = on.iter().map(|p| p.gate_m * weight(p)).sum::<f64>() / (GATE * total);
    Some(SupportPlane {
        normal,
        offset_m: normal.dot(&mean),
        share: plane.share,
        sigma_rad: LEVEL_RAD.hypot(error_m / reach_m.max(1e-9)),
    })
}

/// The tenth percentile; 0 for no values.
fn tenth_percentile(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 10).copied().unwrap_or(0.0)
}
