//! Ray casting of a view by an ideal camera.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{
    Light, Scene,
    scene::{Shade, Sight},
};
use geometry::{Intrinsics, Pose};

/// Color samples per side of a pixel at an edge ...
const EDGE_SAMPLES: usize = 3;
/// ... and of a pixel with print, where edges are measured to hundredths of a pixel.
const PRINT_SAMPLES: usize = 8;
/// Color without a surface, 8 bits. chosen: dark gray
const NOTHING: f64 = 0.15;
/// Largest distance at which surfaces are seen, meters. chosen: beyond any room
const FARTHEST_M: f64 = 20.0;
/// Least cosine between ray and normal in a pixel's footprint. chosen: 84 degrees
const LEAST_COSINE: f64 = 0.1;

/// A view without noise; all lists are row-major with one value per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Linear color; a highlight may exceed 1.
    pub color: Vec<Vector3<f64>>,
    /// Reflectance of the surface without gloss, in `[0, 1]`; 0 without a surface.
    pub reflectance: Vec<f64>,
    /// Strength of a bulb's reflection, in `[0, 1]`.
    pub gloss: Vec<f64>,
    /// Whether lacquer absorbs the pattern of a depth camera.
    pub lacquered: Vec<bool>,
    /// z-depth, meters; 0 without a surface.
    pub depth_m: Vec<f64>,
    /// Cosine between ray and surface normal; 0 without a surface.
    pub cosine: Vec<f64>,
    /// Index of the part; `None` for floor, surroundings and no surface.
    pub part: Vec<Option<u16>>,
}

impl View {
    /// Casts a ray through the center of every pixel; colors of pixels at edges are averaged over several
    /// rays.
    pub fn cast_rays(
        scene: &Scene,
        intrinsics: &Intrinsics,
        world_from_camera: &Pose,
        light: &Light,
    ) -> Self {
        let eye = Point3::from(world_from_camera.translation.vector);
        let rays = Rays { scene, intrinsics, world_from_camera, light, eye };
        let width = intrinsics.width;
        let pixels = intrinsics.width * intrinsics.height;
        let sights: Vec<Option<Sight>> = (0..pixels)
            .into_par_iter()
            .with_min_len(width)
            .map(|i| rays.sight_at(rays.center_of_pixel(i)))
            .collect();
        let shades: Vec<Shade> =
            (0..pixels).into_par_iter().with_min_len(width).map(|i| rays.pixel_shade(&sights, i)).collect();
        Self {
            color: shades.iter().map(|s| s.color).collect(),
            reflectance: shades.iter().map(|s| s.reflectance).collect(),
            gloss: shades.iter().map(|s| s.gloss).collect(),
            lacquered: shades.iter().map(|s| s.is_lacquered).collect(),
            // Rays have z = 1 in the camera's frame, so the multiple is the depth.
            depth_m: sights.iter().map(|s| s.map_or(0.0, |s| s.at)).collect(),
            cosine: (0..pixels)
                .map(|i| {
                    sights[i].map_or(0.0, |s| cosine_of_sight(&rays.ray_through(rays.center_of_pixel(i)), &s))
                })
                .collect(),
            part: sights.iter().map(|s| s.and_then(|s| s.part).map(|p| p as u16)).collect(),
        }
    }
}

/// A camera in a scene. Image positions are `[u, v]`, pixels.
struct Rays<'a> {
    scene: &'a Scene<'a>,
    intrinsics: &'a Intrinsics,
    world_from_camera: &'a Pose,
    light: &'a Light,
    eye: Point3<f64>,
}

impl Rays<'_> {
    fn center_of_pixel(&self, pixel: usize) -> [f64; 2] {
        [(pixel % self.intrinsics.width) as f64, (pixel / self.intrinsics.width) as f64]
    }

    fn ray_through(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        self.world_from_camera.rotation * self.intrinsics.ray_at(u, v)
    }

    fn sight_at(&self, at: [f64; 2]) -> Option<Sight> {
        self.scene.first_sight(&self.eye, &self.ray_through(at), FARTHEST_M)
    }

    /// Light of one of `samples` x `samples` samples in a pixel.
    fn shade_at(&self, sight: Option<Sight>, at: [f64; 2], samples: usize) -> Shade {
        let Some(sight) = sight else {
            return Shade {
                color: Vector3::repeat(NOTHING),
                reflectance: 0.0,
                gloss: 0.0,
                is_lacquered: false,
            };
        };
        let ray = self.ray_through(at);
        // A pixel covers more area on a slanted surface.
        let footprint_m =
            sight.at / self.intrinsics.fx / cosine_of_sight(&ray, &sight).max(LEAST_COSINE) / samples as f64;
        self.scene.shade_of_sight(&sight, self.light, &self.eye, &(self.eye + ray * sight.at), footprint_m)
    }

    /// Light of a pixel; at edges only the color is averaged over samples.
    fn pixel_shade(&self, sights: &[Option<Sight>], pixel: usize) -> Shade {
        let [u, v] = self.center_of_pixel(pixel);
        let shade = self.shade_at(sights[pixel], [u, v], 1);
        // Within a surface, texture waves too fine for the pixel are already left out.
        let side = match sights[pixel].as_ref().is_some_and(|s| self.scene.is_printed(s)) {
            true => PRINT_SAMPLES,
            false if self.is_on_edge(sights, pixel) => EDGE_SAMPLES,
            false => return shade,
        };
        let offset = |k: usize| (k as f64 + 0.5) / side as f64 - 0.5;
        let samples = (0..side * side).map(|k| {
            let at = [u + offset(k % side), v + offset(k / side)];
            self.shade_at(self.sight_at(at), at, side).color
        });
        let color = samples.sum::<Vector3<f64>>() / (side * side) as f64;
        Shade { color, ..shade }
    }

    /// Whether a neighbor of this pixel shows another surface.
    fn is_on_edge(&self, sights: &[Option<Sight>], pixel: usize) -> bool {
        let width = self.intrinsics.width;
        let height = self.intrinsics.height;
        let x = pixel % width;
        let y = pixel / width;
        let beside = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < width).then(|| pixel + 1),
            (y > 0).then(|| pixel - width),
            (y + 1 < height).then(|| pixel + width),
        ];
        beside.into_iter().flatten().any(|other| seen_surface(&sights[other]) != seen_surface(&sights[pixel]))
    }
}

fn cosine_of_sight(ray: &Vector3<f64>, sight: &Sight) -> f64 {
    ray.dot(&sight.normal).abs() / ray.norm()
}

/// The visible solid and its rounded normal.
fn seen_surface(sight: &Option<Sight>) -> Option<(usize, Vector3<i32>)> {
    // Rounded, so that a curved side has edges only between few of its pixels.
    sight.map(|s| (s.solid, s.normal.map(|n| (n * 8.0).round() as i32)))
}
