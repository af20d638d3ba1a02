//! Straightens rims: border vertices move within the surface, and those near them follow.

use nalgebra::{Point3, Vector3};

use super::{
    Readings,
    drawn::{SEARCH, drawn_out},
    loops::border_loops,
    reach::{Neighbors, Reach},
    rim::Rim,
};
use crate::{TriangleMesh, vertex_normals};

/// Largest move of a vertex from where the readings end, voxels. chosen: a rim's place is known to a voxel
pub(super) const MAX_MOVE: f64 = 1.0;
/// Vertices up to here from a rim follow it, voxels.
/// tuned: made and recorded objects (docs/method.md 16); moves of one voxel spread over four compress
/// triangles by a quarter
const FOLLOWING: f64 = 4.0;
/// Rounds to settle the moves of vertices near a rim: tuned.
const ROUNDS: usize = 20;
/// Largest number of halvings of the moves of a triangle that turns too much; after it, they are dropped.
const HALVINGS: usize = 6;

/// Least cosine of a triangle's turn, and least share of its area that it keeps. tuned: made and recorded
/// objects (docs/method.md 16)
const MIN_COSINE: f32 = 0.5;
const MIN_AREA: f32 = 0.1;

/// The mesh with its rims moved to where the readings end and straightened. No triangle turns over.
pub(super) fn straightened_mesh(mesh: &TriangleMesh, voxel_m: f64, readings: &Readings<'_>) -> TriangleMesh {
    let Some(loops) = border_loops(mesh) else { return mesh.clone() };
    let normals: Vec<Vector3<f64>> = vertex_normals(mesh).iter().map(|n| n.cast()).collect();
    let mut moves = vec![Vector3::zeros(); mesh.vertices.len()];
    let mut passes = vec![0_u8; mesh.vertices.len()];
    loops.iter().flatten().for_each(|&v| passes[v as usize] = passes[v as usize].saturating_add(1));
    let drawn = drawn_out(mesh, &normals, &loops, voxel_m, readings);
    for (rim, drawn) in loops.iter().zip(drawn) {
        // Where readings place most of a rim, the rest follows; else all of the rim counts as it is.
        let is_drawn = 2 * drawn.iter().flatten().count() > rim.len();
        let drawn = drawn.iter().map(|d| d.filter(|_| is_drawn));
        let counts: Vec<bool> = drawn.clone().map(|d| d.is_some() || !is_drawn).collect();
        let drawn: Vec<Vector3<f64>> = drawn.map(Option::unwrap_or_default).collect();
        let points: Vec<Point3<f64>> =
            rim.iter().zip(&drawn).map(|(&v, d)| mesh.vertices[v as usize].cast::<f64>() + d).collect();
        let Some(places) = Rim::new(&points, counts.clone(), voxel_m).places_of_points() else { continue };
        for (k, (&v, place)) in rim.iter().zip(places).enumerate() {
            // Where loops touch, the right move for one is wrong for the other.
            if passes[v as usize] == 1 {
                // A vertex whose end no reading shows may follow as far as ends are looked for.
                let most_m = if counts[k] { MAX_MOVE } else { SEARCH[1] } * voxel_m;
                let d = tangential_part(&(place - points[k]), &normals[v as usize]);
                moves[v as usize] = drawn[k] + d * (most_m / d.norm()).min(1.0);
            }
        }
    }
    if moves.iter().all(|d| *d == Vector3::zeros()) {
        return mesh.clone();
    }
    let neighbors = Neighbors::of_mesh(mesh);
    let mut reach = Reach::new(mesh, &neighbors);
    let border: Vec<(u32, f64)> = loops.iter().flatten().map(|&v| (v, 0.0)).collect();
    let mut inner = reach.vertices_within(&border, FOLLOWING * voxel_m).to_vec();
    inner.retain(|&v| passes[v as usize] == 0);
    for _ in 0..ROUNDS {
        // In the order of distance and with the moves of this round, so moves spread inward.
        for &v in &inner {
            let around = neighbors.of_vertex(v);
            let sum: Vector3<f64> = around.iter().map(|&n| moves[n as usize]).sum();
            moves[v as usize] = tangential_part(&(sum / around.len() as f64), &normals[v as usize]);
        }
    }
    moved_mesh(mesh, moves)
}

/// A vector without its component along a unit normal.
fn tangential_part(d: &Vector3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
    d - normal * normal.dot(d)
}

/// The mesh with its vertices moved; moves are reduced where a triangle would turn or shrink too much.
fn moved_mesh(mesh: &TriangleMesh, mut moves: Vec<Vector3<f64>>) -> TriangleMesh {
    let mut halvings = vec![0; mesh.vertices.len()];
    loop {
        let mut result = mesh.clone();
        for (p, d) in result.vertices.iter_mut().zip(&moves).filter(|(_, d)| **d != Vector3::zeros()) {
            *p = (p.cast::<f64>() + d).cast();
        }
        let mut turned: Vec<u32> = Vec::new();
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let is_moved = corners.iter().any(|&v| moves[v as usize] != Vector3::zeros());
            if is_moved && turns_too_much(&mesh.area_normal(t), &result.area_normal(t)) {
                turned.extend(corners);
            }
        }
        if turned.is_empty() {
            return result;
        }
        turned.sort_unstable();
        turned.dedup();
        for v in turned.into_iter().map(|v| v as usize) {
            halvings[v] += 1;
            moves[v] = if halvings[v] > HALVINGS { Vector3::zeros() } else { moves[v] * 0.5 };
        }
    }
}

/// Whether a triangle with these normals (as long as twice its area) before and after turns or shrinks too
/// much.
fn turns_too_much(old: &Vector3<f32>, new: &Vector3<f32>) -> bool {
    new.dot(old) <= (MIN_COSINE * new.norm()).max(MIN_AREA * old.norm()) * old.norm()
}
