//! A view for the fusion of depth: how to read its pixels, and the nodes it sees.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::rows::RowCamera;
use capture::{NoiseConfig, RgbdFrame, Unread, object_weights};
use geometry::{Intrinsics, Pose};

/// Depth at which a reading has weight 1, meters. derived: the unit of length
const REFERENCE_DEPTH_M: f64 = 1.0;
/// Weight of a node seen through, relative to one near a surface: rays that pass close by an edge would
/// otherwise push its zero crossing inwards. (On a sphere of 20 node spacings the mean error is 0.11 spacings
/// at weight 1 and 0.01 at 0.05.) chosen: between these two, as free space must still count
pub(super) const FREE_WEIGHT: f32 = 0.1;

/// What a pixel shows the volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelRole {
    /// Its depth is a surface of the volume's object: space in front is free, and nodes near it get
    /// distances.
    Surface,
    /// It shows something else: space in front of its depth is free, or the whole ray where its depth is
    /// unknown.
    FreeOnly,
    /// It shows nothing.
    Skip,
}

/// The roles for a whole object: object pixels with a positive weight are its surface, pixels off the mask
/// are free space, object pixels without a usable depth are skipped.
pub(crate) fn object_roles(frame: &RgbdFrame, weights: &[f32]) -> Vec<PixelRole> {
    let mut roles = Vec::with_capacity(weights.len());
    for (pixel, weight) in weights.iter().enumerate() {
        let is_usable = *weight > 0.0 && frame.depth_m[pixel] > 0.0;
        roles.push(match (frame.is_object(pixel), is_usable) {
            (false, _) => PixelRole::FreeOnly,
            (true, true) => PixelRole::Surface,
            (true, false) => PixelRole::Skip,
        });
    }
    roles
}

/// The reading of a pixel for fusion.
#[derive(Clone, Copy)]
pub(super) struct Reading {
    /// z-depth, meters; infinite where only free space is known.
    pub depth_m: f32,
    /// Its weight: 1 for a pixel of weight 1 at the reference depth, negative where its depth is no surface
    /// of the volume's object, 0 where it shows nothing.
    signed_weight: f32,
}

impl Reading {
    /// It shows nothing.
    pub(crate) const NOTHING: Self = Self { depth_m: 0.0, signed_weight: 0.0 };

    /// A surface of the volume's object.
    pub(crate) fn of_surface(depth_m: f32, weight: f32) -> Self {
        Self { depth_m, signed_weight: weight }
    }

    /// Empty space up to a depth, which may be infinite.
    pub(crate) fn of_free_space(depth_m: f32, weight: f32) -> Self {
        Self { depth_m, signed_weight: -weight }
    }

    /// Its weight, negative where it is no surface.
    #[inline(always)]
    pub(crate) fn signed_weight(self) -> f32 {
        self.signed_weight
    }

    /// Its weight, at least 0.
    #[inline(always)]
    pub(crate) fn weight(self) -> f32 {
        self.signed_weight.abs()
    }

    /// Whether it is a surface of the volume's object.
    #[inline(always)]
    pub(crate) fn is_surface(self) -> bool {
        self.signed_weight > 0.0
    }
}

/// One view for the volume.
pub struct TsdfView<'a> {
    /// The frame.
    pub(super) frame: &'a RgbdFrame,
    /// Transform applied to the view before it is fused.
    pub(super) volume_from_world: Pose,
    /// The reading of each pixel.
    pub(super) readings: Vec<Reading>,
}

impl<'a> TsdfView<'a> {
    /// A view with a weight per pixel, e.g. from [`capture::pixel_weights`], and roles, e.g. from
    /// `object_roles`. `volume_from_world` moves it before it is fused: the identity, or the motion of a part
    /// from the frame's state to the volume's.
    ///
    /// # Panics
    /// If `weights` or `roles` do not have one value a pixel.
    pub fn new(
        frame: &'a RgbdFrame,
        weights: &[f32],
        roles: &[PixelRole],
        volume_from_world: Pose,
        noise: &NoiseConfig,
    ) -> Self {
        Self { frame, volume_from_world, readings: readings_of_frame(frame, weights, roles, noise) }
    }

    /// A view of a whole object in its own world.
    pub fn of_object(frame: &'a RgbdFrame, unread: Unread, noise: &NoiseConfig) -> Self {
        let weights = object_weights(frame, noise);
        let mut roles = object_roles(frame, &weights);
        if unread == Unread::Unknown {
            for (role, depth_m) in roles.iter_mut().zip(&frame.depth_m) {
                if *depth_m <= 0.0 {
                    *role = PixelRole::Skip;
                }
            }
        }
        Self::new(frame, &weights, &roles, Pose::identity(), noise)
    }
}

/// What a view reads at a node.
pub(super) enum NodeReading {
    /// The node is in free space, in front of the truncation; no distance is measured.
    Free {
        /// Weight of the reading.
        weight: f32,
    },
    /// The node is near a surface.
    Near {
        /// Projective distance in truncation distances, above -1.
        s: f32,
        /// Weight of the reading.
        weight: f32,
        /// Index of the reading's pixel.
        pixel: usize,
    },
}

/// What a view reads at a node, given its position in the optical frame, inside the image; `None` if nothing.
pub(super) fn reading_of_node(
    readings: &[Reading],
    intrinsics: &Intrinsics,
    camera: &RowCamera,
    p: &Vector3<f32>,
    truncation_m: f32,
) -> Option<NodeReading> {
    let pixel = camera.pixel_of(p);
    let reading = readings[pixel];
    let weight = reading.weight();
    let ahead_m = reading.depth_m - p.z;
    if weight <= 0.0 || ahead_m <= -truncation_m {
        return None;
    }
    if ahead_m >= truncation_m {
        return Some(NodeReading::Free { weight });
    }
    if !reading.is_surface() {
        return None;
    }
    let between = interpolated_depth(readings, intrinsics, camera.project(p), truncation_m);
    // docs/method.md (3.2).
    let s = (between.unwrap_or(reading.depth_m) - p.z) / truncation_m;
    (s > -1.0).then_some(NodeReading::Near { s, weight, pixel })
}

/// Share of a reading's weight at a distance in truncation distances. It falls to zero behind the surface, so
/// that both sides of a thin wall survive.
pub(super) fn behind_weight(s: f32, steepness: f32) -> f32 {
    (steepness * (1.0 + s)).min(1.0)
}

/// Reading of each pixel for fusion.
fn readings_of_frame(
    frame: &RgbdFrame,
    weights: &[f32],
    roles: &[PixelRole],
    noise: &NoiseConfig,
) -> Vec<Reading> {
    assert!(
        weights.len() == frame.depth_m.len() && roles.len() == frame.depth_m.len(),
        "one weight and role a pixel"
    );
    let reference_m = noise.sigma_m(REFERENCE_DEPTH_M);
    let pixels = (0..frame.depth_m.len()).into_par_iter().with_min_len(1 << 14);
    let readings = pixels.map(|pixel| {
        let depth_m = frame.depth_m[pixel];
        let precision = || (reference_m / frame.sigma_m(pixel, noise)).powi(2) as f32;
        match roles[pixel] {
            PixelRole::Surface if depth_m > 0.0 => Reading::of_surface(depth_m, weights[pixel] * precision()),
            PixelRole::FreeOnly if depth_m > 0.0 => Reading::of_free_space(depth_m, precision().min(1.0)),
            PixelRole::FreeOnly => Reading::of_free_space(f32::INFINITY, 1.0),
            _ => Reading::NOTHING,
        }
    });
    readings.collect()
}

/// Depth interpolated between four pixels of one surface, linear in inverse depth (exact on planes); `None`
/// at the surface's edges. `shifted` is the pixel position plus one half.
fn interpolated_depth(
    readings: &[Reading],
    k: &Intrinsics,
    shifted: [f32; 2],
    truncation_m: f32,
) -> Option<f32> {
    let u = shifted[0] - 0.5;
    let v = shifted[1] - 0.5;
    if u < 0.0 || v < 0.0 || u >= (k.width - 1) as f32 || v >= (k.height - 1) as f32 {
        return None;
    }
    let x = u as usize;
    let y = v as usize;
    let a = u - x as f32;
    let b = v - y as f32;
    let first = y * k.width + x;
    let four = [first, first + 1, first + k.width, first + k.width + 1].map(|i| readings[i]);
    let mut low = f32::INFINITY;
    let mut high = 0.0f32;
    let mut inverse = 0.0;
    for (r, share) in four.iter().zip([(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b]) {
        if !r.is_surface() {
            return None;
        }
        low = low.min(r.depth_m);
        high = high.max(r.depth_m);
        inverse += share / r.depth_m;
    }
    // Readings farther apart than the truncation distance are of two surfaces.
    (high - low < truncation_m).then(|| 1.0 / inverse)
}

#[cfg(test)]
#[path = "tsdf_view_tests.rs"]
mod tests;
