//! The hash grid of one level: features, their derivatives by position, and the gradient of the table.

use super::lanes::{COLUMN_ALIGN, Lanes};
use crate::LevelLayout;

/// Multipliers of the spatial hash; the one of x is 1: docs/method.md (12.2).
const HASH_Y: i32 = 2_654_435_761u32 as i32;
const HASH_Z: i32 = 805_459_861;
/// Most entries of a level, as pairs are indexed by 32-bit integers.
const MAX_ENTRIES: usize = 1 << 28;

/// A level as the kernels need it; it is always consistent, so every index lies in the table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelGeometry {
    scale: f32,
    resolution: i32,
    entries: usize,
    hashed: bool,
}

impl LevelGeometry {
    /// # Panics
    /// If the layout is inconsistent: a dense level with fewer entries than nodes, or a hashed one whose size
    /// is no power of two.
    pub(crate) fn new(level: &LevelLayout) -> Self {
        let nodes = level.resolution.checked_pow(3);
        let consistent = if level.hashed {
            level.entries.is_power_of_two()
        } else {
            nodes.is_some_and(|n| n <= level.entries)
        };
        assert!(
            consistent && level.resolution >= 2 && level.entries <= MAX_ENTRIES,
            "inconsistent level {level:?}"
        );
        assert!(level.scale.is_finite() && level.resolution < 1 << 20, "inconsistent level {level:?}");
        Self {
            scale: level.scale,
            resolution: level.resolution as i32,
            entries: level.entries,
            hashed: level.hashed,
        }
    }
}

/// Unit coordinates of points, one slice per axis, of equal length, a multiple of 16.
#[derive(Clone, Copy)]
pub(crate) struct PointColumns<'a> {
    /// Along x.
    pub x: &'a [f32],
    /// Along y.
    pub y: &'a [f32],
    /// Along z.
    pub z: &'a [f32],
}

impl<'a> PointColumns<'a> {
    /// The points of a range.
    pub(crate) fn columns_in(&self, range: std::ops::Range<usize>) -> Self {
        let PointColumns { x, y, z } = *self;
        Self { x: &x[range.clone()], y: &y[range.clone()], z: &z[range] }
    }

    fn checked_length(&self) -> usize {
        let n = self.x.len();
        assert!(self.y.len() == n && self.z.len() == n && n.is_multiple_of(COLUMN_ALIGN));
        n
    }
}

/// The cell of each lane's point: entries of its 8 corners (bit 0 of the corner is +x, bit 1 +y, bit 2 +z)
/// and the fractional position.
struct Cell<S: Lanes> {
    corners: [S::I; 8],
    frac: [S::F; 3],
}

/// The cell along one axis: the lower node, limited to the level, and the fraction to the next. `position =
/// unit scale + 0.5`.
#[inline(always)]
fn axis_cell<S: Lanes>(s: S, level: LevelGeometry, unit: S::F) -> (S::I, S::F) {
    // NaN becomes 0 (see `Lanes::max`): every index below lies in the table. docs/method.md (12.1).
    let unit = s.min(s.max(unit, s.splat(0.0)), s.splat(1.0));
    let position = s.fma(unit, s.splat(level.scale), s.splat(0.5));
    let node = s.clamp_int(s.truncate(position), 0, level.resolution - 2);
    (node, s.sub(position, s.float(node)))
}

/// Entry indices of the corners, all below the level's number of entries: nodes are limited to the level,
/// hashes to the table.
///
/// # Safety
/// N floats are readable at every pointer.
#[inline(always)]
unsafe fn cell_corners<S: Lanes>(
    s: S,
    level: LevelGeometry,
    x: *const f32,
    y: *const f32,
    z: *const f32,
) -> Cell<S> {
    // SAFETY: the caller's promise.
    let (x, y, z) = unsafe { (s.load(x), s.load(y), s.load(z)) };
    let (ix, fx) = axis_cell(s, level, x);
    let (iy, fy) = axis_cell(s, level, y);
    let (iz, fz) = axis_cell(s, level, z);
    let one = s.splat_int(1);
    let corners = if level.hashed {
        let mask = s.splat_int((level.entries - 1) as i32);
        let hy = s.mul_int(iy, s.splat_int(HASH_Y));
        let hz = s.mul_int(iz, s.splat_int(HASH_Z));
        // docs/method.md (12.2). The upper node's hash adds one multiplier, which saves a product.
        let xs = [ix, s.add_int(ix, one)];
        let ys = [hy, s.add_int(hy, s.splat_int(HASH_Y))];
        let zs = [hz, s.add_int(hz, s.splat_int(HASH_Z))];
        std::array::from_fn(|c| s.and(s.xor(s.xor(xs[c & 1], ys[c >> 1 & 1]), zs[c >> 2]), mask))
    } else {
        let r = s.splat_int(level.resolution);
        let base = s.add_int(ix, s.mul_int(r, s.add_int(iy, s.mul_int(r, iz))));
        let dy = level.resolution;
        let dz = level.resolution.wrapping_mul(level.resolution);
        std::array::from_fn(|c| {
            let offset = (c & 1) as i32 + if c & 2 != 0 { dy } else { 0 } + if c & 4 != 0 { dz } else { 0 };
            s.add_int(base, s.splat_int(offset))
        })
    };
    Cell { corners, frac: [fx, fy, fz] }
}

/// Trilinear weights of the 8 corners.
#[inline(always)]
fn corner_weights<S: Lanes>(s: S, [fx, fy, fz]: [S::F; 3]) -> [S::F; 8] {
    let one = s.splat(1.0);
    let gx = s.sub(one, fx);
    let gy = s.sub(one, fy);
    let gz = s.sub(one, fz);
    let yz = [s.mul(gy, gz), s.mul(fy, gz), s.mul(gy, fz), s.mul(fy, fz)];
    std::array::from_fn(|c| s.mul(if c & 1 == 0 { gx } else { fx }, yz[c >> 1]))
}

/// Features of the level at every point: trilinear interpolation of the 8 corners, docs/method.md (12.1).
///
/// # Panics
/// If the lengths do not match.
#[inline(always)]
pub(super) fn encode<S: Lanes>(
    s: S,
    level: LevelGeometry,
    table: &[f32],
    points: PointColumns<'_>,
    first: &mut [f32],
    second: &mut [f32],
) {
    let n = points.checked_length();
    assert!(table.len() == 2 * level.entries && first.len() == n && second.len() == n);
    for i in (0..n).step_by(S::N) {
        // SAFETY: `i + N <= n`, the length of all slices; corners are below `entries`.
        unsafe {
            let cell = cell_corners(
                s,
                level,
                points.x.as_ptr().add(i),
                points.y.as_ptr().add(i),
                points.z.as_ptr().add(i),
            );
            let weights = corner_weights(s, cell.frac);
            let mut a = s.splat(0.0);
            let mut b = s.splat(0.0);
            for c in 0..8 {
                let (f, g) = s.gather_pairs(table.as_ptr(), cell.corners[c]);
                a = s.fma(weights[c], f, a);
                b = s.fma(weights[c], g, b);
            }
            s.store(first.as_mut_ptr().add(i), a);
            s.store(second.as_mut_ptr().add(i), b);
        }
    }
}

/// Features of a level at points, with their derivatives by the unit coordinates: `[value, d/dx, d/dy, d/dz]`
/// for each of the two features, one value per point.
pub(crate) struct LevelJacobian<'a> {
    /// First feature.
    pub first: [&'a mut [f32]; 4],
    /// Second feature.
    pub second: [&'a mut [f32]; 4],
}

/// Features and exact derivatives of the trilinear interpolant.
///
/// # Panics
/// If the lengths do not match.
#[inline(always)]
pub(super) fn encode_jacobian<S: Lanes>(
    s: S,
    level: LevelGeometry,
    table: &[f32],
    points: PointColumns<'_>,
    out: LevelJacobian<'_>,
) {
    let n = points.checked_length();
    assert!(table.len() == 2 * level.entries && out.first.iter().chain(&out.second).all(|o| o.len() == n));
    for i in (0..n).step_by(S::N) {
        // SAFETY: `i + N <= n`, the length of all slices; corners are below `entries`.
        unsafe {
            let cell = cell_corners(
                s,
                level,
                points.x.as_ptr().add(i),
                points.y.as_ptr().add(i),
                points.z.as_ptr().add(i),
            );
            let pairs: [(S::F, S::F); 8] =
                std::array::from_fn(|c| s.gather_pairs(table.as_ptr(), cell.corners[c]));
            let a = trilinear(s, level.scale, cell.frac, pairs.map(|p| p.0));
            let b = trilinear(s, level.scale, cell.frac, pairs.map(|p| p.1));
            for k in 0..4 {
                s.store(out.first[k].as_mut_ptr().add(i), a[k]);
                s.store(out.second[k].as_mut_ptr().add(i), b[k]);
            }
        }
    }
}

/// Value and derivatives of a trilinear interpolant, by unit coordinates.
#[inline(always)]
fn trilinear<S: Lanes>(s: S, scale: f32, [fx, fy, fz]: [S::F; 3], v: [S::F; 8]) -> [S::F; 4] {
    let lerp = |a, b, t| s.fma(s.sub(b, a), t, a);
    let x: [S::F; 4] = std::array::from_fn(|i| lerp(v[2 * i], v[2 * i + 1], fx));
    let dx: [S::F; 4] = std::array::from_fn(|i| s.sub(v[2 * i + 1], v[2 * i]));
    let y0 = lerp(x[0], x[1], fy);
    let y1 = lerp(x[2], x[3], fy);
    let gx = lerp(lerp(dx[0], dx[1], fy), lerp(dx[2], dx[3], fy), fz);
    let gy = lerp(s.sub(x[1], x[0]), s.sub(x[3], x[2]), fz);
    // A unit coordinate spans `scale` cells.
    let k = s.splat(scale);
    [lerp(y0, y1, fz), s.mul(gx, k), s.mul(gy, k), s.mul(s.sub(y1, y0), k)]
}

/// Adds `d loss / d table` of the level, given `d loss / d feature` of every point, in order of the points.
///
/// # Panics
/// If the lengths do not match.
#[inline(always)]
pub(super) fn scatter<S: Lanes>(
    s: S,
    level: LevelGeometry,
    gradient: &mut [f32],
    points: PointColumns<'_>,
    first: &[f32],
    second: &[f32],
) {
    let n = points.checked_length();
    assert!(gradient.len() == 2 * level.entries && first.len() == n && second.len() == n);
    let mut index = [[0i32; 16]; 8];
    let mut weight = [[0.0f32; 16]; 8];
    for i in (0..n).step_by(S::N) {
        // SAFETY: `i + N <= n`, the length of all slices; corners are below `entries`; the arrays hold 16 >=
        // N lanes.
        unsafe {
            let cell = cell_corners(
                s,
                level,
                points.x.as_ptr().add(i),
                points.y.as_ptr().add(i),
                points.z.as_ptr().add(i),
            );
            let weights = corner_weights(s, cell.frac);
            for c in 0..8 {
                // Lanes may share an entry, so they are added one by one, in order of the points.
                s.store_int(index[c].as_mut_ptr(), cell.corners[c]);
                s.store(weight[c].as_mut_ptr(), weights[c]);
            }
            for p in 0..S::N {
                let pair = (first[i + p], second[i + p]);
                // Padding, or samples with zero gradient.
                if pair.0 == 0.0 && pair.1 == 0.0 {
                    continue;
                }
                for c in 0..8 {
                    s.add_pair(gradient.as_mut_ptr().add(2 * index[c][p] as usize), weight[c][p], pair);
                }
            }
        }
    }
}
