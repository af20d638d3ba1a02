//! Smooth noise interpolated between random values on a lattice.

use nalgebra::Vector3;

/// Smooth noise in `[-1, 1]`, interpolated between random values at integer lattice nodes.
pub(super) fn value_noise(p: &Vector3<f64>, seed: u32) -> f64 {
    let cell = p.map(f64::floor);
    // Slopes are zero at the nodes, which hides the lattice.
    let t = (p - cell).map(|f| f * f * (3.0 - 2.0 * f));
    let nodes: [f64; 8] = std::array::from_fn(|i| {
        hash(Vector3::from_fn(|k, _| (cell[k] as i64 + (i >> k & 1) as i64) as u32), seed)
    });
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edges = [0, 2, 4, 6].map(|i| lerp(nodes[i], nodes[i + 1], t.x));
    lerp(lerp(edges[0], edges[1], t.y), lerp(edges[2], edges[3], t.y), t.z)
}

/// A value in `[-1, 1]` for a lattice node (the mixing steps are those of MurmurHash3's finaliser).
fn hash(at: Vector3<u32>, seed: u32) -> f64 {
    let mut h = at.x.wrapping_mul(0x8da6_b343)
        ^ at.y.wrapping_mul(0xd816_3841)
        ^ at.z.wrapping_mul(0xcb1a_b31f)
        ^ seed;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ (h >> 16)) / f64::from(u32::MAX) * 2.0 - 1.0
}
