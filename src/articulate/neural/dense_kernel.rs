//! Small dense layers on point-major activations: the arithmetic of the segmentation networks.
//!
//! Every product is built from one register tile and compiled twice: with AVX2 and FMA for processors that
//! have them (detected at run time), and for the baseline target.

/// A product `C[rows][n] += A B`, `A[r][i] = a[r * row_stride + i * depth_stride]`, `B[i][j] = b[i * n + j]`;
/// `n` is a multiple of 8.
#[derive(Clone, Copy)]
struct Product<'a> {
    a: &'a [f32],
    row_stride: usize,
    depth_stride: usize,
    depth: usize,
    b: &'a [f32],
    n: usize,
}

/// `c[m][n] += a[m][k] b[k][n]`, all row-major; `n` must be a multiple of 8.
pub(crate) fn multiply(a: &[f32], k: usize, b: &[f32], n: usize, c: &mut [f32]) {
    run(Product { a, row_stride: k, depth_stride: 1, depth: k, b, n }, c);
}

/// `c[k][n] += transpose(a[m][k]) b[m][n]`, all row-major; `n` must be a multiple of 8.
pub(crate) fn multiply_transposed(a: &[f32], k: usize, b: &[f32], n: usize, c: &mut [f32]) {
    run(Product { a, row_stride: 1, depth_stride: k, depth: a.len() / k, b, n }, c);
}

/// Runs the version of [`all_rows`] for this processor.
fn run(product: Product<'_>, c: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
        // SAFETY: both features were found on this processor.
        return unsafe { run_avx2(product, c) };
    }
    // Without the hardware instruction, a fused multiply-add would call the math library.
    all_rows::<{ cfg!(target_arch = "aarch64") }>(product, c);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(product: Product<'_>, c: &mut [f32]) {
    all_rows::<true>(product, c);
}

#[inline(always)]
fn all_rows<const FMA: bool>(p: Product<'_>, c: &mut [f32]) {
    let rows = c.len() / p.n;
    let mut row = 0;
    // Four rows share the values read from `b`.
    while row + 4 <= rows {
        all_columns::<FMA, 4>(p, row, c);
        row += 4;
    }
    while row < rows {
        all_columns::<FMA, 1>(p, row, c);
        row += 1;
    }
}

#[inline(always)]
fn all_columns<const FMA: bool, const R: usize>(p: Product<'_>, row: usize, c: &mut [f32]) {
    let mut column = 0;
    while column + 16 <= p.n {
        tile::<FMA, R, 16>(p, row, column, c);
        column += 16;
    }
    while column < p.n {
        tile::<FMA, R, 8>(p, row, column, c);
        column += 8;
    }
}

#[inline(always)]
fn tile<const FMA: bool, const R: usize, const W: usize>(
    p: Product<'_>,
    row: usize,
    column: usize,
    c: &mut [f32],
) {
    // Sums stay in registers over the whole depth; `b` is read once for R rows.
    let mut sum = [[0.0f32; W]; R];
    for (r, s) in sum.iter_mut().enumerate() {
        let start = (row + r) * p.n + column;
        s.copy_from_slice(&c[start..start + W]);
    }
    for i in 0..p.depth {
        let mut b = [0.0f32; W];
        b.copy_from_slice(&p.b[i * p.n + column..i * p.n + column + W]);
        for (r, s) in sum.iter_mut().enumerate() {
            let a = p.a[(row + r) * p.row_stride + i * p.depth_stride];
            for w in 0..W {
                s[w] = if FMA { a.mul_add(b[w], s[w]) } else { a * b[w] + s[w] };
            }
        }
    }
    for (r, s) in sum.iter().enumerate() {
        let start = (row + r) * p.n + column;
        c[start..start + W].copy_from_slice(s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_the_definition() {
        let m = 7;
        let k = 24;
        let n = 40;
        let a: Vec<f32> = (0..m * k).map(|i| ((i * 37 % 101) as f32 - 50.0) / 50.0).collect();
        let b: Vec<f32> = (0..k * n).map(|i| ((i * 53 % 97) as f32 - 48.0) / 48.0).collect();
        let d: Vec<f32> = (0..m * n).map(|i| ((i * 29 % 89) as f32 - 44.0) / 44.0).collect();
        let mut c = vec![0.5; m * n];
        let mut t = vec![-0.25; k * n];
        multiply(&a, k, &b, n, &mut c);
        multiply_transposed(&a, k, &d, n, &mut t);
        for j in 0..n {
            for r in 0..m {
                let expected: f32 = 0.5 + (0..k).map(|i| a[r * k + i] * b[i * n + j]).sum::<f32>();
                assert!((c[r * n + j] - expected).abs() < 1e-4);
            }
            for i in 0..k {
                let expected: f32 = -0.25 + (0..m).map(|r| a[r * k + i] * d[r * n + j]).sum::<f32>();
                assert!((t[i * n + j] - expected).abs() < 1e-4);
            }
        }
        let mut baseline = vec![0.5; m * n];
        all_rows::<false>(
            Product { a: &a, row_stride: k, depth_stride: 1, depth: k, b: &b, n },
            &mut baseline,
        );
        assert!(c.iter().zip(&baseline).all(|(x, y)| (x - y).abs() < 1e-5));
    }
}
