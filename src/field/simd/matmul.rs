//! Matrix products of a small dense layer with many columns, one per point.

use super::lanes::{COLUMN_ALIGN, Lanes};

/// A matrix of `rows` rows, `stride` floats apart; kernels read the first columns of each row.
#[derive(Clone, Copy)]
pub(crate) struct Columns<'a> {
    /// Starts at the first column of the first row.
    pub data: &'a [f32],
    /// Distance between rows, floats.
    pub stride: usize,
    /// Number of rows.
    pub rows: usize,
}

impl Columns<'_> {
    /// Panics unless `cols` columns of every row lie in the data.
    fn check_size(&self, cols: usize) {
        assert!(cols <= self.stride || self.rows <= 1, "{cols} columns in rows of {}", self.stride);
        assert!(
            self.rows == 0 || (self.rows - 1) * self.stride + cols <= self.data.len(),
            "matrix too short"
        );
    }
}

/// The last operation on a product before storing.
#[derive(Clone, Copy)]
pub(crate) enum Epilogue<'a> {
    /// Nothing.
    Linear,
    /// `max(y, 0)`.
    Relu,
    /// `y` where the activation (same layout as `y`) is positive, else 0: the backward pass of
    /// [`Self::Relu`].
    Mask(&'a [f32]),
}

/// Rows of outputs in a register tile.
const ROWS: usize = 4;

/// Store step: none, ReLU or mask.
const LINEAR: u8 = 0;
const RELU: u8 = 1;
const MASK: u8 = 2;

/// `y[o][p] = epilogue(sum_k w[o][k] x[k][p] + b[o])` for `cols` columns; `y` has rows of `cols` floats, `w`
/// is row-major `[outputs][x.rows]`. `outputs` is `w.len() / x.rows`, a multiple of 4; `cols` is a multiple
/// of 16.
///
/// # Panics
/// If the lengths do not match.
#[inline(always)]
pub(super) fn forward<S: Lanes>(
    s: S,
    weights: &[f32],
    biases: Option<&[f32]>,
    x: Columns<'_>,
    y: &mut [f32],
    cols: usize,
    epilogue: Epilogue<'_>,
) {
    x.check_size(cols);
    let outputs = weights.len() / x.rows;
    assert!(
        outputs * x.rows == weights.len()
            && outputs.is_multiple_of(ROWS)
            && cols.is_multiple_of(COLUMN_ALIGN)
    );
    assert!(outputs * cols <= y.len() && biases.is_none_or(|b| b.len() == outputs));
    let w = weights.as_ptr();
    let b = biases.map_or(std::ptr::null(), <[f32]>::as_ptr);
    let xp = x.data.as_ptr();
    let yp = y.as_mut_ptr();
    let shape = Shape { outputs, inputs: x.rows, stride: x.stride, cols };
    // SAFETY: the lengths were checked above for `shape`; a mask has at least the size of `y`.
    unsafe {
        match epilogue {
            Epilogue::Linear => multiply_panels::<S, LINEAR>(s, shape, w, b, xp, yp, std::ptr::null()),
            Epilogue::Relu => multiply_panels::<S, RELU>(s, shape, w, b, xp, yp, std::ptr::null()),
            Epilogue::Mask(active) => {
                assert!(outputs * cols <= active.len(), "mask too short");
                multiply_panels::<S, MASK>(s, shape, w, b, xp, yp, active.as_ptr());
            }
        }
    }
}

/// Sizes of a product.
#[derive(Clone, Copy)]
struct Shape {
    outputs: usize,
    inputs: usize,
    stride: usize,
    cols: usize,
}

/// All column panels of a product.
///
/// # Safety
/// The pointers cover matrices of the sizes in `shape` (`b` and `mask` may be null where they are not used).
#[inline(always)]
unsafe fn multiply_panels<S: Lanes, const E: u8>(
    s: S,
    shape: Shape,
    w: *const f32,
    b: *const f32,
    x: *const f32,
    y: *mut f32,
    mask: *const f32,
) {
    let mut col = 0;
    // SAFETY: every panel lies within `cols` columns; the rest is the caller's promise.
    unsafe {
        // AVX-512 has 32 registers, for 4 x 4 sums; the other sets hold 4 x 2.
        if S::TILE == 4 {
            while col + 4 * S::N <= shape.cols {
                multiply_panel::<S, E, 4>(s, shape, w, b, x, y, mask, col);
                col += 4 * S::N;
            }
        }
        while col + 2 * S::N <= shape.cols {
            multiply_panel::<S, E, 2>(s, shape, w, b, x, y, mask, col);
            col += 2 * S::N;
        }
        while col < shape.cols {
            multiply_panel::<S, E, 1>(s, shape, w, b, x, y, mask, col);
            col += S::N;
        }
    }
}

/// All outputs of `C` vectors of columns.
///
/// # Safety
/// As [`multiply_panels`], and `col + C N <= cols`.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "pointers of one product")]
unsafe fn multiply_panel<S: Lanes, const E: u8, const C: usize>(
    s: S,
    shape: Shape,
    w: *const f32,
    b: *const f32,
    x: *const f32,
    y: *mut f32,
    mask: *const f32,
    col: usize,
) {
    let Shape { outputs, inputs, stride, cols } = shape;
    let mut o = 0;
    while o < outputs {
        // SAFETY: `o + ROWS <= outputs`, `col + C N <= cols`, and the caller's promise on the pointers.
        unsafe {
            let mut acc = [[s.splat(0.0); C]; ROWS];
            if !b.is_null() {
                for (r, row) in acc.iter_mut().enumerate() {
                    *row = [s.splat(*b.add(o + r)); C];
                }
            }
            // The sums stay in registers over all inputs; each vector of `x` is used for four outputs.
            let rows: [*const f32; ROWS] = std::array::from_fn(|r| w.add((o + r) * inputs));
            for k in 0..inputs {
                let at = x.add(k * stride + col);
                let v: [S::F; C] = std::array::from_fn(|c| s.load(at.add(c * S::N)));
                for r in 0..ROWS {
                    let weight = s.splat(*rows[r].add(k));
                    for c in 0..C {
                        acc[r][c] = s.fma(weight, v[c], acc[r][c]);
                    }
                }
            }
            for (r, row) in acc.iter().enumerate() {
                for (c, &value) in row.iter().enumerate() {
                    let at = (o + r) * cols + col + c * S::N;
                    let zero = s.splat(0.0);
                    let value = match E {
                        RELU => s.max(value, zero),
                        MASK => s.keep_above(s.load(mask.add(at)), zero, value),
                        _ => value,
                    };
                    s.store(y.add(at), value);
                }
            }
        }
        o += ROWS;
    }
}

/// `dw[o][k] += sum_p dy[o][p] x[k][p]` and `db[o] += sum_p dy[o][p]`; `dy.rows` is a multiple of 4, `cols`
/// of 16.
///
/// # Panics
/// If the lengths do not match.
#[inline(always)]
pub(super) fn weight_gradient<S: Lanes>(
    s: S,
    dy: Columns<'_>,
    x: Columns<'_>,
    cols: usize,
    d_weights: &mut [f32],
    d_biases: &mut [f32],
) {
    dy.check_size(cols);
    x.check_size(cols);
    assert!(dy.rows.is_multiple_of(ROWS) && cols.is_multiple_of(COLUMN_ALIGN));
    assert!(d_weights.len() == dy.rows * x.rows && d_biases.len() == dy.rows);
    let mut o = 0;
    while o < dy.rows {
        let mut k = 0;
        // SAFETY: rows `o..o + 4` of `dy` and `k..k + K` of `x` exist, each with `cols` columns (checked
        // above).
        unsafe {
            // Four inputs at a time share the loads of `dy`.
            while k + 4 <= x.rows {
                gradient_tile::<S, 4>(s, dy, x, cols, o, k, d_weights);
                k += 4;
            }
            while k < x.rows {
                gradient_tile::<S, 1>(s, dy, x, cols, o, k, d_weights);
                k += 1;
            }
            let mut acc = [s.splat(0.0); ROWS];
            for p in (0..cols).step_by(S::N) {
                for (r, sum) in acc.iter_mut().enumerate() {
                    *sum = s.add(*sum, s.load(dy.data.as_ptr().add((o + r) * dy.stride + p)));
                }
            }
            for (target, sum) in d_biases[o..o + ROWS].iter_mut().zip(s.sum4(acc)) {
                *target += sum;
            }
        }
        o += ROWS;
    }
}

/// Gradient of four rows by `K` columns of weights.
///
/// # Safety
/// Rows `o..o + 4` of `dy` and `k..k + K` of `x` exist with `cols` columns each.
#[inline(always)]
unsafe fn gradient_tile<S: Lanes, const K: usize>(
    s: S,
    dy: Columns<'_>,
    x: Columns<'_>,
    cols: usize,
    o: usize,
    k: usize,
    d_weights: &mut [f32],
) {
    let mut acc = [[s.splat(0.0); ROWS]; K];
    // SAFETY: the caller's promise.
    unsafe {
        let d: [*const f32; ROWS] = std::array::from_fn(|r| dy.data.as_ptr().add((o + r) * dy.stride));
        let v: [*const f32; K] = std::array::from_fn(|j| x.data.as_ptr().add((k + j) * x.stride));
        let mut p = 0;
        while p < cols {
            let grad: [S::F; ROWS] = std::array::from_fn(|r| s.load(d[r].add(p)));
            for j in 0..K {
                let value = s.load(v[j].add(p));
                for r in 0..ROWS {
                    acc[j][r] = s.fma(grad[r], value, acc[j][r]);
                }
            }
            p += S::N;
        }
    }
    for (j, sums) in acc.into_iter().enumerate() {
        for (r, sum) in s.sum4(sums).into_iter().enumerate() {
            d_weights[(o + r) * x.rows + k + j] += sum;
        }
    }
}
