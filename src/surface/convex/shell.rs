//! Turns a surface into convex solids.
//!
//! A scanned surface need not be closed and is seldom convex: its hull, or a decomposition of its volume,
//! would fill its interior. So the solids follow the surface itself, with the wall behind it.

use nalgebra::Point3;

use super::{
    ConvexConfig, ConvexSolid, Hidden, MIN_THICKNESS_M,
    cover::{Wanted, covering_solids},
    hidden::{front_mesh, hidden_walls},
    pieces::{Piece, SeenSurface, seen_surface},
};
use crate::{ShellInertia, TriangleMesh, inertia::plates_inertia, keep_components, simplify};

/// Largest number of triangles cut into pieces.
const TRIANGLES: usize = 3000;
/// Components with a smaller share of the largest one's triangles are loose fragments.
/// tuned: made and recorded objects (docs/method.md 16)
const MIN_COMPONENT: f64 = 0.003;

/// Largest root mean square distance of a flat patch from its plane, in tolerances.
/// tuned: made and recorded objects (docs/method.md 16)
const FLAT: f64 = 0.6;

/// A surface without loose fragments, with as few triangles as solids need.
pub fn few_triangles(mesh: &TriangleMesh, config: &ConvexConfig) -> TriangleMesh {
    simplify(&keep_components(mesh, MIN_COMPONENT), TRIANGLES, 0.5 * config.tolerance_m)
}

/// A seen surface with the walls behind it, for collision and mass.
pub struct Walls {
    seen: SeenSurface,
    assumed: TriangleMesh,
    bounds: Option<(Point3<f64>, Point3<f64>)>,
    wall_m: f64,
    config: ConvexConfig,
}

impl Walls {
    /// The walls behind a surface, `wall_m` thick where their other side was not seen. They end before
    /// `others`: seen surfaces of other parts in the same frame. A flat wall continues through places known
    /// to be `hidden` to its next seen part or another wall, as the floor of a drawer does behind its front.
    /// Both meshes should come from [`few_triangles`]. See docs/method.md 10.1.
    pub fn behind_surface(
        mesh: &TriangleMesh,
        others: &TriangleMesh,
        wall_m: f64,
        hidden: Option<Hidden<'_>>,
        config: &ConvexConfig,
    ) -> Self {
        // Two standard deviations of noise are within the tolerance if one is half of it.
        let flat_m = FLAT * config.tolerance_m;
        let sizes = [flat_m, wall_m, MIN_THICKNESS_M, config.gap_m];
        let (mut seen, patches) =
            seen_surface(mesh, others, sizes, &|p| hidden.is_some_and(|hidden| hidden(p)));
        let walls = hidden.map_or_else(Vec::new, |h| hidden_walls(mesh, &patches, wall_m, h));
        let assumed = front_mesh(&walls);
        seen.pieces.extend(walls.into_iter().map(|wall| wall.piece));
        let bounds = mesh.bounds().filter(|_| !mesh.is_empty()).map(|(lo, hi)| (lo.cast(), hi.cast()));
        Self { seen, assumed, bounds, wall_m, config: config.clone() }
    }

    /// The faces of the assumed walls in hidden places, in the color of the seen part of the wall.
    pub fn assumed_faces(&self) -> &TriangleMesh {
        &self.assumed
    }

    /// Convex solids: at least one for a surface with area, at most `max_solids`. Deterministic. See
    /// docs/method.md 10.1.
    pub fn convex_solids(&self) -> Vec<ConvexSolid> {
        let ConvexConfig { max_solids, tolerance_m, .. } = self.config;
        let wanted = Wanted { solids: max_solids, tolerance_m, thin_m: MIN_THICKNESS_M, wall_m: self.wall_m };
        let mut solids = covering_solids(&self.seen, &wanted);
        if let Some((lower, upper)) = self.bounds.filter(|_| solids.is_empty()) {
            // The surface is too small for pieces: its bounding box instead.
            let pads = (upper - lower).map(|side| (MIN_THICKNESS_M - side).max(0.0) * 0.5);
            solids.push(ConvexSolid::cuboid(&(lower - pads), &(upper + pads)));
        }
        solids
    }

    /// Mass properties of the walls, as plates of one density and of their walls' thickness; of a wall seen
    /// from both sides, each side carries half. `None` without area. See docs/method.md 10.2.
    pub fn shell_inertia(&self, density_kg_m3: f64) -> Option<ShellInertia> {
        let plates = self.seen.pieces.iter().flat_map(Piece::wall_plates);
        plates_inertia(plates, density_kg_m3)
    }

    /// Share of the mass in walls of assumed thickness (other side unseen); 0 without area.
    pub fn assumed_share(&self) -> f64 {
        let all_m3 = self.volume_m3(|_| true);
        if all_m3 > 0.0 { self.volume_m3(|p| p.is_assumed) / all_m3 } else { 0.0 }
    }

    /// Volume of the counted pieces, cubic meters.
    fn volume_m3(&self, is_counted: fn(&Piece) -> bool) -> f64 {
        let plates = self.seen.pieces.iter().filter(|p| is_counted(p)).flat_map(Piece::wall_plates);
        plates.map(|([a, b, c], thick_m)| 0.5 * (b - a).cross(&(c - a)).norm() * thick_m).sum()
    }
}

#[cfg(test)]
#[path = "shell_tests.rs"]
mod tests;
