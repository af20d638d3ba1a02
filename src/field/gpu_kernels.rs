//! GPU kernels for one level of the hash grid, with one thread per point (docs/method.md 12.1).

use cubecl::prelude::*;

/// Multipliers of the spatial hash along y and z; along x it is 1.
const PRIME_Y: u32 = 2_654_435_761;
const PRIME_Z: u32 = 805_459_861;

/// The cell of a point in a level's grid, and the position within the cell.
#[derive(CubeType)]
struct Place {
    x: u32,
    y: u32,
    z: u32,
    fx: f32,
    fy: f32,
    fz: f32,
}

#[cube]
fn place(points: &Tensor<f32>, scale: f32) -> Place {
    // docs/method.md (12.1).
    let px = points[ABSOLUTE_POS * 3] * scale + 0.5;
    let py = points[ABSOLUTE_POS * 3 + 1] * scale + 0.5;
    let pz = points[ABSOLUTE_POS * 3 + 2] * scale + 0.5;
    let cx = f32::floor(px);
    let cy = f32::floor(py);
    let cz = f32::floor(pz);
    Place {
        x: u32::cast_from(cx),
        y: u32::cast_from(cy),
        z: u32::cast_from(cz),
        fx: px - cx,
        fy: py - cy,
        fz: pz - cz,
    }
}

/// Weight of the lower (0) or upper (1) node along one axis.
#[cube]
fn weight(fraction: f32, upper: u32) -> f32 {
    let upper = f32::cast_from(upper);
    // Branch-free, to keep neighboring threads together.
    1.0 - upper + (2.0 * upper - 1.0) * fraction
}

/// Index of the first float of a node's entry.
#[cube]
fn first_float(x: u32, y: u32, z: u32, resolution: u32, mask: u32, #[comptime] hashed: bool) -> usize {
    if hashed {
        usize::cast_from(((x ^ (y * PRIME_Y) ^ (z * PRIME_Z)) & mask) * 2)
    } else {
        usize::cast_from(((z * resolution + y) * resolution + x) * 2)
    }
}

/// A node around a point: its weight, and the index of its entry's first float.
#[derive(CubeType)]
struct Node {
    weight: f32,
    at: usize,
}

#[cube]
fn node(p: &Place, corner: u32, resolution: u32, mask: u32, #[comptime] hashed: bool) -> Node {
    let dx = corner & 1;
    let dy = (corner >> 1) & 1;
    let dz = corner >> 2;
    let weight = weight(p.fx, dx) * weight(p.fy, dy) * weight(p.fz, dz);
    Node { weight, at: first_float(p.x + dx, p.y + dy, p.z + dz, resolution, mask, hashed) }
}

/// Interpolated features `[points, 2]` of a table `[2 entries]` at `points` `[points, 3]` of the unit cube.
#[cube(launch_unchecked)]
pub(super) fn encode(
    points: &Tensor<f32>,
    table: &Tensor<f32>,
    features: &mut Tensor<f32>,
    scale: f32,
    resolution: u32,
    mask: u32,
    #[comptime] hashed: bool,
) {
    // The last block of threads extends beyond the points.
    if ABSOLUTE_POS >= points.shape(0) {
        terminate!();
    }
    let p = place(points, scale);
    let mut first = 0.0f32;
    let mut second = 0.0f32;
    #[unroll]
    for corner in 0..8u32 {
        let n = node(&p, corner, resolution, mask, hashed);
        first += n.weight * table[n.at];
        second += n.weight * table[n.at + 1];
    }
    features[ABSOLUTE_POS * 2] = first;
    features[ABSOLUTE_POS * 2 + 1] = second;
}

/// Adds the gradient by the features, `[points, 2]`, to the gradient by the table, `[2 entries]`.
#[cube(launch_unchecked)]
pub(super) fn scatter(
    points: &Tensor<f32>,
    gradient: &Tensor<f32>,
    table: &mut Tensor<Atomic<f32>>,
    scale: f32,
    resolution: u32,
    mask: u32,
    #[comptime] hashed: bool,
) {
    if ABSOLUTE_POS >= points.shape(0) {
        terminate!();
    }
    let p = place(points, scale);
    let first = gradient[ABSOLUTE_POS * 2];
    let second = gradient[ABSOLUTE_POS * 2 + 1];
    #[unroll]
    for corner in 0..8u32 {
        let n = node(&p, corner, resolution, mask, hashed);
        // Several points may share a node.
        table[n.at].fetch_add(n.weight * first);
        table[n.at + 1].fetch_add(n.weight * second);
    }
}
