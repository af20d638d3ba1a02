//! A surface as convex solids.
//!
//! A scanned surface need not be closed and is seldom convex: its hull or a decomposition of its volume fills
//! the places that things are put into. So the solids follow the surface itself, with the wall behind it.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{
    ConvexSolid,
    cover::{Wanted, cover},
    hidden::hidden_pieces,
    pieces::{Piece, Seen, seen},
};
use crate::surface::{ShellInertia, TriangleMesh, inertia::plates_inertia, keep_components, simplify};

/// Triangles that the pieces are made of.
const TRIANGLES: usize = 3000;
/// Components with a smaller share of the largest one's triangles are loose fragments.
const MIN_COMPONENT: f64 = 0.003;

/// Root mean square distance of a flat patch from its plane, in tolerances.
const FLAT: f64 = 0.6;

/// Settings of the collision solids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ConvexConfig {
    /// Most solids of a part.
    pub max_solids: usize,
    /// How far a solid may stand before the surface that was seen, meters.
    pub tolerance_m: f64,
    /// No solid is thinner, meters (a simulator refuses flat hulls).
    pub min_thickness_m: f64,
    /// Solids of moving parts are this much smaller on every side, meters.
    pub shrink_m: f64,
    /// Gap that is kept free around the path of a moving part, meters.
    pub gap_m: f64,
}

impl Default for ConvexConfig {
    fn default() -> Self {
        Self { max_solids: 64, tolerance_m: 0.002, min_thickness_m: 0.002, shrink_m: 0.001, gap_m: 0.002 }
    }
}

/// Whether no view saw what a place (in the mesh's frame, meters) holds.
pub type Hidden<'a> = &'a dyn Fn(&Point3<f64>) -> bool;

/// A surface without loose fragments, with as few triangles as solids need.
#[must_use]
pub fn few_triangles(mesh: &TriangleMesh, config: &ConvexConfig) -> TriangleMesh {
    simplify(&keep_components(mesh, MIN_COMPONENT), TRIANGLES, 0.5 * config.tolerance_m)
}

/// A seen surface with the walls behind it: what collides and what weighs.
pub struct Walls {
    seen: Seen,
    bounds: Option<(Point3<f64>, Point3<f64>)>,
    wall_m: f64,
    config: ConvexConfig,
}

impl Walls {
    /// The walls behind a surface, `wall_m` thick where their other side was not seen. They end before
    /// `others`: surfaces of other parts where these were seen, in the same frame. A flat wall goes on
    /// through `hidden` places, where these are known, up to where it or another wall was seen again, as the
    /// floor of a drawer does behind its front. Both meshes should be [`few_triangles`]. See docs/method.md
    /// 10.1.
    #[must_use]
    pub fn of(
        mesh: &TriangleMesh,
        others: &TriangleMesh,
        wall_m: f64,
        hidden: Option<Hidden<'_>>,
        config: &ConvexConfig,
    ) -> Self {
        let goes_on = |p: &Point3<f64>| hidden.is_some_and(|hidden| hidden(p));
        // Of noise, two standard deviations are within the tolerance where one is half of it.
        let flat_m = FLAT * config.tolerance_m;
        let sizes = [flat_m, wall_m, config.min_thickness_m, config.shrink_m + config.gap_m];
        let (mut seen, patches) = seen(mesh, others, sizes, &goes_on);
        if let Some(hidden) = hidden {
            seen.pieces.extend(hidden_pieces(mesh, &patches, wall_m, hidden, config));
        }
        let bounds = mesh.bounds().filter(|_| !mesh.is_empty()).map(|(lo, hi)| (lo.cast(), hi.cast()));
        Self { seen, bounds, wall_m, config: config.clone() }
    }

    /// Convex solids: at least one for a surface with area, at most `max_solids`. Deterministic. See
    /// docs/method.md 10.1.
    #[must_use]
    pub fn solids(&self) -> Vec<ConvexSolid> {
        let ConvexConfig { max_solids, tolerance_m, min_thickness_m, .. } = self.config;
        let wanted = Wanted { solids: max_solids, tolerance_m, thin_m: min_thickness_m, wall_m: self.wall_m };
        let mut solids = cover(&self.seen, &wanted);
        if let Some((lower, upper)) = self.bounds.filter(|_| solids.is_empty()) {
            // Too small for pieces: its box.
            let pads = (upper - lower).map(|side| (min_thickness_m - side).max(0.0) * 0.5);
            solids.push(ConvexSolid::cuboid(&(lower - pads), &(upper + pads)));
        }
        solids
    }

    /// Mass properties of the walls: of plates of one density, as thick as their walls; those whose other
    /// side was seen weigh half on either side. `None` without area. See docs/method.md 10.2.
    #[must_use]
    pub fn inertia(&self, density_kg_m3: f64) -> Option<ShellInertia> {
        let plates = self.seen.pieces.iter().flat_map(Piece::plates);
        plates_inertia(plates, density_kg_m3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{
        marching_cubes, merge,
        shapes::{box_mesh, grid_of, sphere_mesh, torus},
    };

    fn holds_point(solids: &[ConvexSolid], p: [f64; 3]) -> bool {
        solids.iter().any(|s| s.planes().iter().all(|q| q.distance_m(&Point3::from(p)) <= 0.0))
    }

    /// A tray: walls 10 mm thick around a hollow that is open at the top.
    fn tray() -> TriangleMesh {
        let outer = box_mesh(Vector3::new(0.2, 0.15, 0.06));
        let mut inner = box_mesh(Vector3::new(0.19, 0.14, 0.06));
        inner.vertices.iter_mut().for_each(|p| p.z += 0.01);
        inner.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let top = |mesh: &TriangleMesh, t: &[u32; 3], z: f32| {
            t.iter().all(|&i| (mesh.vertices[i as usize].z - z).abs() < 1e-6)
        };
        let mut outer_open = outer.clone();
        outer_open.triangles.retain(|t| !top(&outer, t, 0.06));
        let mut inner_open = inner.clone();
        inner_open.triangles.retain(|t| !top(&inner, t, 0.07));
        merge(&[&outer_open, &inner_open])
    }

    #[test]
    fn a_tray_is_made_of_slabs_and_stays_hollow() {
        let solids = solids_of(&tray(), 0.008, None, &ConvexConfig::default());
        assert!((5..=10).contains(&solids.len()), "{}", solids.len());
        for hollow in [[0.0, 0.0, 0.0], [0.15, 0.1, -0.03], [-0.18, 0.0, 0.05]] {
            assert!(!holds_point(&solids, hollow), "{hollow:?}");
        }
        for wall in [[0.0, 0.0, -0.055], [0.195, 0.0, 0.0], [0.0, -0.145, 0.02]] {
            assert!(holds_point(&solids, wall), "{wall:?}");
        }
    }

    #[test]
    fn a_floor_goes_on_where_no_view_saw_it_and_ends_where_one_saw_a_hole() {
        // The floor between x = -0.19 and -0.12 is missing.
        let mut mesh = marching_cubes(&grid_of(0.25, 126, |p: &Point3<f64>| tray_distance(p)), 0.0);
        let missing = |p: &Point3<f32>| p.x < -0.12 && p.x > -0.185 && p.z < -0.03 && p.y.abs() < 0.135;
        let vertices = mesh.vertices.clone();
        mesh.triangles.retain(|t| !t.iter().all(|&i| missing(&vertices[i as usize])));
        let config = ConvexConfig::default();
        let behind = |p: &Point3<f64>| p.x < -0.11;
        let gap = [-0.15, 0.03, -0.055];
        assert!(!holds_point(&solids_of(&mesh, 0.008, None, &config), gap));
        let closed = solids_of(&mesh, 0.008, Some(&behind), &config);
        assert!(holds_point(&closed, gap));
        assert!(!holds_point(&closed, [-0.15, 0.03, -0.03]) && !holds_point(&closed, [0.0, 0.0, 0.0]));
    }

    /// Distance to the tray of [`tray`].
    fn tray_distance(p: &Point3<f64>) -> f64 {
        let cuboid = |center: Vector3<f64>, half: Vector3<f64>| {
            let q = (p.coords - center).abs() - half;
            q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
        };
        cuboid(Vector3::zeros(), Vector3::new(0.2, 0.15, 0.06))
            .max(-cuboid(Vector3::new(0.0, 0.0, 0.05), Vector3::new(0.19, 0.14, 0.1)))
    }

    #[test]
    fn a_ring_keeps_its_hole_and_a_ball_is_covered() {
        let config = ConvexConfig::default();
        let ring =
            solids_of(&marching_cubes(&grid_of(0.5, 50, torus(0.3, 0.08)), 0.0), 0.01, None, &config);
        assert!(!holds_point(&ring, [0.0; 3]) && ring.len() <= config.max_solids && ring.len() > 8);
        let ball = solids_of(&sphere_mesh(0.1, 40), 0.01, None, &config);
        assert!(ball.len() <= config.max_solids);
        for d in [Vector3::x(), Vector3::y(), -Vector3::z()] {
            assert!((0..20).any(|k| holds_point(&ball, (d * (0.101 - 0.001 * f64::from(k))).into())));
        }
    }

    #[test]
    fn every_solid_has_volume_and_a_mesh_without_area_has_none() {
        let solids =
            solids_of(&box_mesh(Vector3::new(0.2, 0.1, 0.0005)), 0.008, None, &ConvexConfig::default());
        assert!(
            !solids.is_empty() && solids.iter().all(|s| s.thickness_m() >= 0.0019 && s.volume_m3() > 0.0)
        );
        let speck = solids_of(
            &box_mesh(Vector3::new(0.0004, 0.0004, 0.0004)),
            0.008,
            None,
            &ConvexConfig::default(),
        );
        assert!(!speck.is_empty() && speck.iter().all(|s| s.thickness_m() >= 0.0019));
        assert!(solids_of(&TriangleMesh::default(), 0.008, None, &ConvexConfig::default()).is_empty());
    }
}
