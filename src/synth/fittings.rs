//! Fits handles of common sizes to the plates of doors and drawers.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rand_core::Rng;

use super::{Handle, HandleKind, HandleStyle, Material, Part, Shape, Solid};
use geometry::Pose;
use numeric::random::{index_below, is_chosen, uniform_in};

/// Largest size of a handle along itself, share of the plate's side. chosen: usual proportions
const MOST_ALONG: f64 = 0.6;
/// Largest size across it. chosen: usual proportions
const MOST_ACROSS: f64 = 0.35;
/// Depth of posts and stems in the plate, meters. chosen: solids overlap without a gap
const SUNK_M: f64 = 0.001;
/// Wall thickness of a recess deeper than its plate, meters. chosen: thin, as such cups are
const CUP_M: f64 = 0.004;

/// Replaces the handles of the doors, flaps and drawers of a cabinet. In these parts the plate is the first
/// solid and the handle the last.
pub(super) fn fit_handles(parts: &mut [Part], style: HandleStyle, rng: &mut impl Rng) {
    for part in
        parts.iter_mut().filter(|p| ["door_", "flap_", "drawer_"].iter().any(|n| p.name.starts_with(n)))
    {
        let Some(plate) = Plate::of_part(part) else { continue };
        let Some(old) = part.solids.pop() else { continue };
        let style = match style {
            HandleStyle::Mixed => {
                [HandleStyle::Bar, HandleStyle::Knob, HandleStyle::Recess][index_below(rng, 3)]
            }
            style => style,
        };
        part.handle = match style {
            HandleStyle::Bar => Some(plate.add_bar(&mut part.solids, &old.material, rng)),
            HandleStyle::Knob => Some(plate.add_knob(&mut part.solids, &old.material, rng)),
            HandleStyle::Recess => Some(plate.add_recess(&mut part.solids, &old.material, rng)),
            HandleStyle::Mixed | HandleStyle::Bare => None,
        };
    }
}

/// The plate of a handle in the handle's axes: x along it, y across, z outward.
struct Plate {
    /// Frame at the center of its outer face.
    part_from_face: Pose,
    /// Half sides.
    half: Vector3<f64>,
    /// Sign of y towards the edge opposite the hinge; 0 for a drawer.
    free: f64,
    material: Material,
}

impl Plate {
    fn of_part(part: &Part) -> Option<Self> {
        let solid = part.solids.first()?;
        let joint = part.joint?;
        let Shape::Cuboid(half) = solid.shape else { return None };
        let center = solid.part_from_solid.translation.vector;
        let slides = part.name.starts_with("drawer_");
        // Bars are upright on doors and horizontal on flaps and drawers.
        let along = if !slides && joint.axis.z.abs() > 0.5 { Vector3::z() } else { Vector3::y() };
        let across = Vector3::x().cross(&along);
        let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[along, across, Vector3::x()]));
        let face = center + half.x * Vector3::x();
        let side = |v: &Vector3<f64>| v.abs().dot(&half);
        Some(Self {
            part_from_face: Pose::from_parts(face.into(), UnitQuaternion::from_rotation_matrix(&turn)),
            half: Vector3::new(side(&along), side(&across), half.x),
            free: if slides { 0.0 } else { -(joint.origin.coords - center).dot(&across).signum() },
            material: solid.material.clone(),
        })
    }

    /// Factor of at most 1 that shrinks a handle to fit the plate.
    fn handle_scale(&self, length_m: f64, width_m: f64) -> f64 {
        let fits = |most: f64, half: f64, size: f64| most * 2.0 * half / size;
        fits(MOST_ALONG, self.half.x, length_m).min(fits(MOST_ACROSS, self.half.y, width_m)).min(1.0)
    }

    /// The frame of a handle, `out_m` from the face: near the free edge, or centered.
    fn handle_frame(&self, width_m: f64, out_m: f64) -> Pose {
        // Clear of the boards behind the edge.
        let rim = (0.5 * self.half.y).min(0.03);
        let inward = (0.5 * width_m + rim).max(0.24 * self.half.y);
        self.part_from_face * Pose::translation(0.0, self.free * (self.half.y - inward), out_m)
    }

    fn add_bar(&self, solids: &mut Vec<Solid>, material: &Material, rng: &mut impl Rng) -> Handle {
        let [length_m, thickness_m, clearance_m] =
            [uniform_in(rng, 0.096, 0.16), uniform_in(rng, 0.008, 0.012), uniform_in(rng, 0.025, 0.035)];
        let s = self.handle_scale(length_m, thickness_m);
        let [length_m, thickness_m, clearance_m] = [s * length_m, s * thickness_m, s * clearance_m];
        let half = 0.5 * thickness_m;
        let out_m = clearance_m + 0.5 * thickness_m;
        let part_from_handle = self.handle_frame(thickness_m, out_m);
        solids.push(if is_chosen(rng, 0.5) {
            let along = Pose::rotation(std::f64::consts::FRAC_PI_2 * Vector3::y());
            Solid::cylinder(half, 0.5 * length_m, part_from_handle * along, material)
        } else {
            Solid {
                shape: Shape::Cuboid(Vector3::new(0.5 * length_m, half, half)),
                part_from_solid: part_from_handle,
                material: material.clone(),
            }
        });
        // Posts end inside the bar.
        let post = Vector3::new(0.8 * half, 0.8 * half, 0.5 * (out_m + SUNK_M));
        for side in [-1.0, 1.0] {
            let at = Pose::translation(side * (0.5 * length_m - thickness_m), 0.0, -post.z);
            solids.push(Solid {
                shape: Shape::Cuboid(post),
                part_from_solid: part_from_handle * at,
                material: material.clone(),
            });
        }
        Handle { kind: HandleKind::Bar { length_m, thickness_m, clearance_m }, part_from_handle }
    }

    fn add_knob(&self, solids: &mut Vec<Solid>, material: &Material, rng: &mut impl Rng) -> Handle {
        let diameter_m = uniform_in(rng, 0.025, 0.035);
        let diameter_m = diameter_m * self.handle_scale(diameter_m, diameter_m);
        // Half the height is the stem, so that fingers reach behind the head.
        let stem = 0.5 * diameter_m;
        let head = 0.4 * diameter_m;
        let part_from_handle = self.handle_frame(diameter_m, stem + 0.5 * head);
        let half_stem = 0.5 * (stem + SUNK_M);
        let behind = Pose::translation(0.0, 0.0, -0.5 * head - half_stem);
        solids.push(Solid::cylinder(0.5 * diameter_m, 0.5 * head, part_from_handle, material));
        solids.push(Solid::cylinder(0.25 * diameter_m, half_stem, part_from_handle * behind, material));
        Handle { kind: HandleKind::Knob { diameter_m, height_m: stem + head }, part_from_handle }
    }

    /// Replaces the plate by boxes around the recess, with a floor of another material.
    fn add_recess(&self, solids: &mut Vec<Solid>, trim: &Material, rng: &mut impl Rng) -> Handle {
        let s = self.handle_scale(0.1, 0.025);
        let [length_m, width_m, depth_m] = [s * 0.1, s * 0.025, s * uniform_in(rng, 0.012, 0.018)];
        let part_from_handle = self.handle_frame(width_m, 0.0);
        let from_face = (self.part_from_face.inverse() * part_from_handle).translation.vector;
        // Coordinates are in the frame of the recess.
        let between =
            |lower, upper, material| Solid::box_between(lower, upper, material).moved(&part_from_handle);
        let lower = -self.half - from_face;
        let upper = self.half - from_face;
        let a = 0.5 * length_m;
        let b = 0.5 * width_m;
        let back = -2.0 * self.half.z;
        let plate = &self.material;
        let mut pieces = vec![
            between([lower.x, lower.y, back], [upper.x, -b, 0.0], plate),
            between([lower.x, b, back], [upper.x, upper.y, 0.0], plate),
            between([lower.x, -b, back], [-a, b, 0.0], plate),
            between([a, -b, back], [upper.x, b, 0.0], plate),
        ];
        if depth_m < -back {
            pieces.push(between([-a, -b, back], [a, b, -depth_m], trim));
        } else {
            let c = a + CUP_M;
            let d = b + CUP_M;
            let floor = -depth_m - CUP_M;
            pieces.push(between([-c, -d, floor], [c, d, -depth_m], trim));
            for [x, y] in [[[-c, -a], [-d, d]], [[a, c], [-d, d]], [[-a, a], [-d, -b]], [[-a, a], [b, d]]] {
                pieces.push(between([x[0], y[0], -depth_m], [x[1], y[1], back], trim));
            }
        }
        solids.splice(..1, pieces);
        Handle { kind: HandleKind::Recess { length_m, width_m, depth_m }, part_from_handle }
    }
}

#[cfg(test)]
mod tests;
