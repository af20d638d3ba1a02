//! Ray casting of an object in one state on a floor.

use nalgebra::{Point3, Vector3};

use super::{
    Board, Light, Material, Object, Shape, Solid,
    bvh::{Bounds, Bvh},
};
use geometry::Pose;

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Distance along the ray, as a multiple of its direction.
    pub at: f64,
    /// Outward unit normal in the world frame.
    pub normal: Vector3<f64>,
    /// Index of the part; `None` for the floor and for surroundings.
    pub part: Option<usize>,
    /// Index of the solid over the whole scene; the number of solids for the floor.
    pub solid: usize,
    /// The point in its part's frame, or in the world without a part.
    pub point_in_part: Point3<f64>,
}

#[derive(Clone)]
struct Placed<'a> {
    part: Option<usize>,
    shape: Shape,
    material: &'a Material,
    part_from_solid: Pose,
    world_from_solid: Pose,
    solid_from_world: Pose,
}

/// The solids of a state at their poses, above a floor.
pub struct Scene<'a> {
    placed: Vec<Placed<'a>>,
    bvh: Bvh,
    floor: &'a Material,
    floor_z_m: f64,
    floor_center: Point3<f64>,
    floor_radius_m: f64,
    /// A printed board and the index of its solid.
    print: Option<(usize, &'a Board)>,
}

impl<'a> Scene<'a> {
    /// The object in a state on a round floor centered below it.
    pub fn new(object: &'a Object, state: usize, floor: &'a Material, floor_radius_m: f64) -> Self {
        let poses = object.world_from_parts(state);
        let mut placed = Vec::new();
        for (k, part) in object.parts.iter().enumerate() {
            for solid in &part.solids {
                placed.push(Placed::new(Some(k), solid, &poses[k]));
            }
        }
        let boxes: Vec<Bounds> = placed.iter().map(bounds_of_placed).collect();
        let foot = object.world_from_rest.translation.vector;
        Self {
            bvh: Bvh::new(&boxes),
            placed,
            floor,
            floor_z_m: foot.z,
            floor_center: Point3::from(foot),
            floor_radius_m,
            print: None,
        }
    }

    /// The scene with a printed board added.
    #[must_use]
    pub fn with_board(&self, board: &'a Board) -> Self {
        let print = Some((self.placed.len(), board));
        Self { print, ..self.with_solids(std::slice::from_ref(&board.solid)) }
    }

    /// Whether the surface has print on it, finer than a pixel.
    pub fn is_printed(&self, sight: &Sight) -> bool {
        self.print.is_some_and(|(solid, _)| solid == sight.solid)
    }

    /// The scene with solids added that belong to no part, in the world frame.
    #[must_use]
    pub fn with_solids(&self, solids: &'a [Solid]) -> Self {
        let around = solids.iter().map(|s| Placed::new(None, s, &Pose::identity()));
        let placed: Vec<Placed> = self.placed.iter().cloned().chain(around).collect();
        let bvh = Bvh::new(&placed.iter().map(bounds_of_placed).collect::<Vec<_>>());
        Self { placed, bvh, ..*self }
    }

    /// The first surface on a ray, between the multiples 0 and `farthest` of its direction.
    pub fn first_sight(&self, origin: &Point3<f64>, ray: &Vector3<f64>, farthest: f64) -> Option<Sight> {
        let mut best: Option<Sight> = None;
        // The floor first, as its hit limits the search among the solids. Level rays fail the comparisons.
        let to_floor = (self.floor_z_m - origin.z) / ray.z;
        if to_floor > 0.0 && to_floor < farthest {
            let point_in_part = origin + ray * to_floor;
            if (point_in_part - self.floor_center).xy().norm() < self.floor_radius_m {
                best = Some(Sight {
                    at: to_floor,
                    normal: Vector3::z(),
                    part: None,
                    solid: self.placed.len(),
                    point_in_part,
                });
            }
        }
        let nearest = best.as_ref().map_or(farthest, |b| b.at);
        self.bvh.visit_boxes(origin, ray, nearest, |i| {
            let p = &self.placed[i];
            let nearest = best.as_ref().map_or(farthest, |b| b.at);
            let o = p.solid_from_world * origin;
            let r = p.solid_from_world * ray;
            // In the solid's frame; rigid motions preserve multiples of the ray.
            let Some(hit) = p.shape.hit_by(&o, &r, 0.0).filter(|h| h.at < nearest) else { return nearest };
            best = Some(Sight {
                at: hit.at,
                normal: p.world_from_solid * hit.normal,
                part: p.part,
                solid: i,
                point_in_part: p.part_from_solid * (o + r * hit.at),
            });
            hit.at
        });
        best
    }

    /// Whether nothing is between two world points; `margin_m` next to the first is ignored.
    pub fn is_clear(&self, from: &Point3<f64>, to: &Point3<f64>, margin_m: f64) -> bool {
        let way = to - from;
        let length_m = way.norm();
        if length_m <= margin_m {
            return true;
        }
        // With a unit direction, multiples are meters.
        let step = way / length_m;
        self.first_sight(&(from + step * margin_m), &step, length_m - margin_m).is_none()
    }

    /// How a visible point reflects infrared light.
    pub(super) fn infrared_of_sight(&self, sight: &Sight, light: &Light, footprint_m: f64) -> InfraredShade {
        let material = self.placed.get(sight.solid).map_or(self.floor, |p| p.material);
        let reflectance = material.color_at(&sight.point_in_part, footprint_m).dot(&LUMINANCE);
        let paint = DYE_SHARE * reflectance + (1.0 - DYE_SHARE) * DYE_ALBEDO;
        let is_lacquered = material.is_lacquered(&sight.point_in_part);
        // Lacquer and glass send next to nothing back.
        let albedo = if is_lacquered { LACQUER_SHARE * reflectance } else { paint };
        InfraredShade {
            albedo,
            sheen: if is_lacquered { 0.0 } else { material.sheen },
            ambient: albedo * light.diffuse_light(&sight.normal).dot(&LUMINANCE),
        }
    }

    /// The same scene with its floor at another height, meters.
    #[must_use]
    pub(super) fn with_floor_at(self, floor_z_m: f64) -> Self {
        Self { floor_z_m, ..self }
    }

    /// Light from a visible world point towards the eye.
    pub fn shade_of_sight(
        &self,
        sight: &Sight,
        light: &Light,
        eye: &Point3<f64>,
        point: &Point3<f64>,
        footprint_m: f64,
    ) -> Shade {
        let material = self.placed.get(sight.solid).map_or(self.floor, |p| p.material);
        let own = match self.print.filter(|_| self.is_printed(sight)) {
            Some((_, board)) => board.color_at(&sight.point_in_part),
            None => material.color_at(&sight.point_in_part, footprint_m),
        };
        // The floor and surroundings are matt.
        let gloss = if sight.part.is_some() { light.gloss_at(eye, point, &sight.normal) } else { 0.0 };
        Shade {
            color: own.component_mul(&light.diffuse_light(&sight.normal))
                + Vector3::repeat(light.shine * gloss),
            reflectance: own.dot(&LUMINANCE),
            gloss,
            is_lacquered: material.is_lacquered(&sight.point_in_part),
        }
    }
}

/// Luminance of linear red, green and blue (ITU-R BT.709). derived: that recommendation
const LUMINANCE: Vector3<f64> = Vector3::new(0.2126, 0.7152, 0.0722);

/// Share of infrared light that a lacquered surface sends back, beside its dark color.
/// chosen: below the noise of an infrared image
const LACQUER_SHARE: f64 = 0.15;

/// Share of the visible reflectance that remains in near infrared, and the albedo that replaces the rest:
/// most dyes are pale there. chosen: black cloth and plastic still reflect a tenth
const DYE_SHARE: f64 = 0.7;
const DYE_ALBEDO: f64 = 0.4;

/// How a surface reflects infrared light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct InfraredShade {
    /// Reflectance of a matt surface, in `[0, 1]`.
    pub albedo: f64,
    /// Strength of a mirror-like reflection, in `[0, 1]`.
    pub sheen: f64,
    /// Reflected ambient light, in units of the albedo.
    pub ambient: f64,
}

/// Light from a surface towards a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shade {
    /// Linear color; a highlight may exceed 1.
    pub color: Vector3<f64>,
    /// Reflectance of the surface without gloss, in `[0, 1]`.
    pub reflectance: f64,
    /// Strength of a bulb's reflection, in `[0, 1]`.
    pub gloss: f64,
    /// Whether lacquer absorbs the pattern of a depth camera.
    pub is_lacquered: bool,
}

impl<'a> Placed<'a> {
    fn new(part: Option<usize>, solid: &'a Solid, world_from_part: &Pose) -> Self {
        let world_from_solid = world_from_part * solid.part_from_solid;
        Self {
            part,
            shape: solid.shape,
            material: &solid.material,
            part_from_solid: solid.part_from_solid,
            world_from_solid,
            solid_from_world: world_from_solid.inverse(),
        }
    }
}

fn bounds_of_placed(placed: &Placed) -> Bounds {
    // Along a world axis, a rotated box extends by the sum of its projected half sides.
    let reach =
        placed.world_from_solid.rotation.to_rotation_matrix().matrix().abs() * placed.shape.half_sides();
    let center = Point3::from(placed.world_from_solid.translation.vector);
    Bounds { lower: center - reach, upper: center + reach }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoundingSphere, SynthConfig, generate};
    use numeric::random::{self, stage_rng};

    #[test]
    fn the_hierarchy_finds_what_a_full_search_finds() {
        let config = SynthConfig { parts: Some(5), ..SynthConfig::default() };
        let object = generate(&config).unwrap();
        let floor = Material::plain(Vector3::repeat(0.5));
        let scene = Scene::new(&object, 0, &floor, 5.0);
        let BoundingSphere { center, radius_m } = object.bounding_sphere();
        let rng = &mut stage_rng(1, "rays", 0);
        let mut hits = 0;
        for _ in 0..2000 {
            let origin = center + random::random_direction(rng).into_inner() * (3.0 * radius_m);
            let ray = center + random::random_direction(rng).into_inner() * (0.7 * radius_m) - origin;
            let full = scene.placed.iter().filter_map(|p| {
                p.shape.hit_by(&(p.solid_from_world * origin), &(p.solid_from_world * ray), 0.0)
            });
            let full = full.map(|h| h.at).fold(f64::INFINITY, f64::min);
            let found = scene.first_sight(&origin, &ray, f64::INFINITY).filter(|s| s.part.is_some());
            if let Some(s) = found {
                hits += 1;
                assert!((s.at - full).abs() < 1e-12);
                assert!(!scene.is_clear(&origin, &(origin + ray * (s.at + 0.1)), 0.0));
                assert!(scene.is_clear(&origin, &(origin + ray * (s.at - 1e-6)), 0.0));
            } else {
                let to_floor =
                    scene.first_sight(&origin, &ray, f64::INFINITY).map_or(f64::INFINITY, |s| s.at);
                assert!(full >= to_floor);
            }
        }
        assert!(hits > 300, "{hits}");
    }
}
