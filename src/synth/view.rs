//! What a perfect camera sees.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{Scene, scene::Sight};
use crate::geometry::{Intrinsics, Pose};

/// Colour samples along each side of a pixel on an edge.
const EDGE_SAMPLES: usize = 3;
/// Colour where no surface is near, 8 bits.
const NOTHING: f64 = 0.15;
/// No surface is seen beyond this, metres.
const FARTHEST_M: f64 = 20.0;
/// Smallest cosine between ray and normal that widens a pixel's footprint.
const LEAST_COSINE: f64 = 0.1;

/// A view without noise; all lists are row-major, one value a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Linear colour in `[0, 1]`.
    pub color: Vec<Vector3<f64>>,
    /// z-depth, metres; 0 where there is no surface.
    pub depth_m: Vec<f64>,
    /// Cosine between the ray and the surface's normal; 0 where there is no surface.
    pub cosine: Vec<f64>,
    /// Part seen; `None` for the floor and for nothing.
    pub part: Vec<Option<u16>>,
}

impl View {
    /// Casts a ray through the centre of every pixel; colours of pixels on an edge are means over several rays.
    #[must_use]
    pub fn cast(scene: &Scene, intrinsics: &Intrinsics, world_from_camera: &Pose, lamp: &Vector3<f64>) -> Self {
        let width = intrinsics.width;
        let eye = Point3::from(world_from_camera.translation.vector);
        let ray = |u: f64, v: f64| world_from_camera.rotation * intrinsics.ray(u, v);
        let sight = |u: f64, v: f64| scene.sight(&eye, &ray(u, v), FARTHEST_M);
        let pixels = width * intrinsics.height;
        let at = |i: usize| ((i % width) as f64, (i / width) as f64);
        let sights: Vec<Option<Sight>> = (0..pixels).into_par_iter().with_min_len(width).map(|i| sight(at(i).0, at(i).1)).collect();
        let color = |s: &Option<Sight>, u: f64, v: f64, samples: usize| {
            s.map_or(Vector3::repeat(NOTHING), |s| {
                let ray = ray(u, v);
                let cosine = (ray.dot(&s.normal).abs() / ray.norm()).max(LEAST_COSINE);
                scene.color(&s, lamp, s.at / intrinsics.fx / cosine / samples as f64)
            })
        };
        let surface = |s: &Option<Sight>| s.map(|s| (s.solid, s.normal.map(|n| (n * 8.0).round() as i32)));
        let on_edge = |i: usize| {
            let (x, y) = (i % width, i / width);
            let around = [(x > 0, 1, false), (x + 1 < width, 1, true), (y > 0, width, false), (y + 1 < intrinsics.height, width, true)];
            around.iter().any(|&(inside, step, up)| inside && surface(&sights[if up { i + step } else { i - step }]) != surface(&sights[i]))
        };
        let colors = (0..pixels).into_par_iter().with_min_len(width).map(|i| {
            let (u, v) = at(i);
            if !on_edge(i) {
                return color(&sights[i], u, v, 1);
            }
            let offset = |k: usize| (k as f64 + 0.5) / EDGE_SAMPLES as f64 - 0.5;
            let samples = (0..EDGE_SAMPLES * EDGE_SAMPLES).map(|k| {
                let (u, v) = (u + offset(k % EDGE_SAMPLES), v + offset(k / EDGE_SAMPLES));
                color(&sight(u, v), u, v, EDGE_SAMPLES)
            });
            samples.sum::<Vector3<f64>>() / (EDGE_SAMPLES * EDGE_SAMPLES) as f64
        });
        let cosine = |i: usize| {
            let ray = ray(at(i).0, at(i).1);
            sights[i].map_or(0.0, |s| ray.dot(&s.normal).abs() / ray.norm())
        };
        Self {
            color: colors.collect(),
            // The rays have z = 1 in the camera's frame, so the multiple is the depth.
            depth_m: sights.iter().map(|s| s.map_or(0.0, |s| s.at)).collect(),
            cosine: (0..pixels).map(cosine).collect(),
            part: sights.iter().map(|s| s.and_then(|s| s.part).map(|p| p as u16)).collect(),
        }
    }
}
