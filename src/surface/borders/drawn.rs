//! Moves rims to where the depth readings of a surface end.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::reach::{Neighbors, Reach};
use crate::TriangleMesh;
use capture::{NoiseConfig, RgbdFrame};
use geometry::Pose;

/// Range of the search for a rim along the way out of the surface, voxels: from within it to beyond it.
/// chosen: marching cubes want eight known corners: a surface ends up to two voxels before its readings, and
/// a node is known up to one beyond them
pub(super) const SEARCH: [f64; 2] = [-1.5, 3.0];
/// Step of the search, voxels. chosen: finer than half a pixel of usual recordings
const STEP: f64 = 0.25;
/// Radius of the surface that gives a vertex its outward direction, voxels. tuned: made and recorded objects
/// (docs/method.md 16); more than a tooth
const AROUND: f64 = 3.0;
/// Readings at a smaller cosine of incidence tell little about the end of a surface. chosen: their pixels are
/// twice as long on the surface
const MIN_COSINE: f64 = 0.5;
/// A reading is of the surface within this many standard deviations. chosen: one in 370 of a normal
/// distribution is farther
const OF_SURFACE: f64 = 3.0;

/// A depth frame of a state, and the pose of the mesh in it.
#[derive(Clone, Copy)]
pub struct DepthView<'a> {
    /// Depth, mask and camera.
    pub frame: &'a RgbdFrame,
    /// Where the mesh stood in the world.
    pub world_from_mesh: Pose,
    /// State of the frame: a surface ends where one state saw it end.
    pub state: usize,
}

/// What a recording shows of the places around a mesh.
pub struct Readings<'a> {
    /// Frames of all states, those of a state together.
    pub views: &'a [DepthView<'a>],
    /// Noise of their depth.
    pub noise: NoiseConfig,
    /// Whether views saw a place empty of the mesh (frame of the mesh, meters).
    pub is_seen_empty: &'a (dyn Fn(&Point3<f64>) -> bool + Sync),
}

/// Displacements, within the surface, of the vertices of all loops to where the readings end; `None` where no
/// reading shows an end.
pub(super) fn drawn_out(
    mesh: &TriangleMesh,
    normals: &[Vector3<f64>],
    loops: &[Vec<u32>],
    voxel_m: f64,
    readings: &Readings<'_>,
) -> Vec<Vec<Option<Vector3<f64>>>> {
    if readings.views.is_empty() {
        return loops.iter().map(|rim| vec![None; rim.len()]).collect();
    }
    let neighbors = Neighbors::of_mesh(mesh);
    let mut reach = Reach::new(mesh, &neighbors);
    let mut moves = Vec::with_capacity(loops.len());
    for rim in loops {
        let ways: Vec<Option<Way>> =
            rim.iter().map(|&v| Way::out_of(mesh, normals, &mut reach, v, voxel_m)).collect();
        let moves_of_rim = ways.par_iter().with_min_len(16).map(|way| {
            let way = way.as_ref()?;
            Some(way.outward * readings.end_m(way)?)
        });
        moves.push(moves_of_rim.collect());
    }
    moves
}

/// A direction out of a surface at its border, within the surface's plane.
struct Way {
    place: Point3<f64>,
    outward: Vector3<f64>,
    normal: Vector3<f64>,
    voxel_m: f64,
}

impl Way {
    /// The way from a border vertex away from the surface around it; `None` where no direction is defined.
    fn out_of(
        mesh: &TriangleMesh,
        normals: &[Vector3<f64>],
        reach: &mut Reach<'_>,
        vertex: u32,
        voxel_m: f64,
    ) -> Option<Self> {
        let mut middle = Vector3::zeros();
        let mut normal = Vector3::zeros();
        let around = reach.vertices_within(&[(vertex, 0.0)], AROUND * voxel_m);
        for &n in around {
            middle += mesh.vertices[n as usize].coords.cast::<f64>() / around.len() as f64;
            normal += normals[n as usize];
        }
        let normal = normal.try_normalize(0.0)?;
        let place: Point3<f64> = mesh.vertices[vertex as usize].cast();
        let away = place.coords - middle;
        let outward = (away - normal * normal.dot(&away)).try_normalize(1e-3 * voxel_m)?;
        Some(Self { place, outward, normal, voxel_m })
    }
}

impl Readings<'_> {
    /// Distance along the way to the end of the surface, meters: the median over the views of a state, and
    /// the nearest over the states that saw an end.
    fn end_m(&self, way: &Way) -> Option<f64> {
        let mut end_m = f64::INFINITY;
        for state in self.views.chunk_by(|a, b| a.state == b.state) {
            let mut ends: Vec<f64> = state.iter().filter_map(|v| self.end_of_view_m(v, way)).collect();
            if !ends.is_empty() {
                ends.sort_by(f64::total_cmp);
                end_m = end_m.min(ends[ends.len() / 2]);
            }
        }
        // A surface that continues into empty space or another part has no rim here.
        let step_m = STEP * way.voxel_m;
        let slack_m = 0.5 * way.voxel_m;
        let mut steps = (1..)
            .map(|k| f64::from(k) * step_m)
            .take_while(|s| *s <= end_m.min(SEARCH[1] * way.voxel_m) - slack_m);
        let is_open = steps.all(|s| !(self.is_seen_empty)(&(way.place + way.outward * s)));
        (end_m.is_finite() && is_open).then_some(end_m)
    }

    /// The same in one view: infinite where its readings continue, `None` where it does not show the surface.
    fn end_of_view_m(&self, view: &DepthView, way: &Way) -> Option<f64> {
        let frame = view.frame;
        let camera_from_mesh = frame.world_from_camera.inverse() * view.world_from_mesh;
        let [place, outward, normal] = [way.place.coords, way.outward, way.normal];
        let place = camera_from_mesh * Point3::from(place);
        let outward = camera_from_mesh * outward;
        let normal = camera_from_mesh * normal;
        if -normal.dot(&place.coords) < MIN_COSINE * place.coords.norm() {
            return None;
        }
        let [from, to] = SEARCH.map(|s| s * way.voxel_m);
        let step_m = STEP * way.voxel_m;
        let count = ((to - from) / step_m).round() as usize;
        let mut steps = 0..=count;
        let first = steps.find(|i| {
            let p = place + outward * (from + *i as f64 * step_m);
            !self.show_surface(frame, &p, way.voxel_m)
        });
        match first {
            Some(0) => None,
            Some(i) => Some(from + (i as f64 - 0.5) * step_m),
            None => Some(f64::INFINITY),
        }
    }

    /// Whether a frame's readings at a point (optical frame) are of the surface there.
    fn show_surface(&self, frame: &RgbdFrame, p: &Point3<f64>, voxel_m: f64) -> bool {
        let Some(pixel) = frame.intrinsics.pixel_of(p) else { return false };
        let measured_m = f64::from(frame.depth_m[pixel]);
        let slack_m = OF_SURFACE * frame.sigma_m(pixel, &self.noise) + 0.5 * voxel_m;
        frame.is_object(pixel) && measured_m > 0.0 && (measured_m - p.z).abs() <= slack_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        borders::{mend_borders, plates::plate},
        shapes::{cuboid, looking_at_origin, view_of},
    };
    use geometry::Intrinsics;

    /// A plate of 0.3 x 0.2 m, its top seen by three cameras; the mesh ends a voxel and a half before it.
    #[test]
    fn a_rim_is_drawn_out_to_where_readings_end() {
        let voxel_m = 0.004;
        let k = Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 319.5, cy: 239.5 };
        let shape = cuboid(Vector3::new(0.15, 0.1, 0.01));
        let eyes = [[0.1, 0.05, 0.6], [-0.15, 0.1, 0.55], [0.02, -0.2, 0.6]].map(Point3::from);
        let frames = eyes.map(|e| view_of(&shape, k, looking_at_origin(e)));
        let views =
            frames.each_ref().map(|frame| DepthView { frame, world_from_mesh: Pose::identity(), state: 0 });
        // Squares of half a voxel.
        let mut mesh = plate(144, 94, |_, _| true);
        for p in &mut mesh.vertices {
            *p = Point3::new(p.x * 0.002 - 0.144, p.y * 0.002 - 0.094, 0.01);
        }
        let nothing = |_: &Point3<f64>| false;
        let readings = Readings { views: &views, noise: NoiseConfig::default(), is_seen_empty: &nothing };
        let (low, high) = mend_borders(&mesh, voxel_m, false, &readings).mesh.bounds().unwrap();
        for (found, true_m) in [(low.x, -0.15), (high.x, 0.15), (low.y, -0.1), (high.y, 0.1)] {
            assert!((found - true_m).abs() < 0.001, "{found} for {true_m}");
        }
        // Beside what is seen empty a rim stays.
        let right = |p: &Point3<f64>| p.x > 0.1445;
        let readings = Readings { is_seen_empty: &right, ..readings };
        let (_, high) = mend_borders(&mesh, voxel_m, false, &readings).mesh.bounds().unwrap();
        assert!((high.x - 0.144).abs() < 0.002 && (high.y - 0.1).abs() < 0.001, "{high}");
    }
}
