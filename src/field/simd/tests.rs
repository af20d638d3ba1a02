//! Every kernel against a plain loop, on every instruction set of this machine.

use super::*;
use crate::LevelLayout;

fn values(n: usize, seed: u32) -> Vec<f32> {
    let mut x = seed.wrapping_mul(2_654_435_761).wrapping_add(12345);
    let mut next = || {
        x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (x >> 8) as f32 / (1u32 << 24) as f32 * 2.0 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

#[test]
fn products_agree_with_plain_loops() {
    for isa in InstructionSet::available_sets() {
        for (outputs, inputs, cols) in [(64, 32, 256), (16, 64, 240), (4, 7, 16), (8, 5, 112)] {
            let stride = cols + 32;
            let w = values(outputs * inputs, 1);
            let b = values(outputs, 2);
            let x = values(inputs * stride, 3);
            let mask = values(outputs * cols, 4);
            let view = Columns { data: &x, stride, rows: inputs };
            for kind in 0..3 {
                let mut y = vec![f32::NAN; outputs * cols];
                let epilogue = [Epilogue::Linear, Epilogue::Relu, Epilogue::Mask(&mask)][kind];
                let biases = (kind != 2).then_some(b.as_slice());
                isa.matmul(&w, biases, view, &mut y, cols, epilogue);
                for o in 0..outputs {
                    for p in 0..cols {
                        let sum: f64 = (0..inputs)
                            .map(|k| f64::from(w[o * inputs + k]) * f64::from(x[k * stride + p]))
                            .sum();
                        let expected = match kind {
                            0 => sum + f64::from(b[o]),
                            1 => (sum + f64::from(b[o])).max(0.0),
                            _ if mask[o * cols + p] > 0.0 => sum,
                            _ => 0.0,
                        };
                        assert!(
                            (f64::from(y[o * cols + p]) - expected).abs() < 1e-5,
                            "{} {outputs}x{inputs}",
                            isa.name()
                        );
                    }
                }
            }
            let dy = values(outputs * cols, 5);
            let mut dw = vec![1.0; outputs * inputs];
            let mut db = vec![2.0; outputs];
            isa.weight_gradient(
                Columns { data: &dy, stride: cols, rows: outputs },
                view,
                cols,
                &mut dw,
                &mut db,
            );
            for o in 0..outputs {
                let row = &dy[o * cols..][..cols];
                assert!(
                    (f64::from(db[o]) - 2.0 - row.iter().map(|&d| f64::from(d)).sum::<f64>()).abs() < 1e-4
                );
                for k in 0..inputs {
                    let sum: f64 =
                        row.iter().zip(&x[k * stride..]).map(|(&d, &v)| f64::from(d) * f64::from(v)).sum();
                    assert!((f64::from(dw[o * inputs + k]) - 1.0 - sum).abs() < 1e-4, "{}", isa.name());
                }
            }
        }
    }
}

#[test]
fn the_logistic_function_is_accurate() {
    let x: Vec<f32> = (-800..800).map(|i| i as f32 * 0.05).collect();
    for isa in InstructionSet::available_sets() {
        let mut y = x.clone();
        isa.sigmoid(&mut y);
        for (&x, &y) in x.iter().zip(&y) {
            let expected = 1.0 / (1.0 + (-f64::from(x)).exp());
            assert!(
                (f64::from(y) - expected).abs() < 1e-6 * expected + 1e-30,
                "{}: {x} gives {y}, not {expected}",
                isa.name()
            );
        }
    }
}

fn levels() -> [LevelLayout; 2] {
    [
        LevelLayout { scale: 6.7, resolution: 9, entries: 729, hashed: false, offset: 0 },
        LevelLayout { scale: 40.3, resolution: 43, entries: 512, hashed: true, offset: 0 },
    ]
}

#[test]
fn derivatives_of_the_encoding_are_those_of_its_values() {
    let n = 64;
    let unit = |seed| values(n, seed).iter().map(|v| 0.5 + 0.49 * v).collect::<Vec<_>>();
    let axes = [unit(6), unit(7), unit(8)];
    for level in levels() {
        let geometry = LevelGeometry::new(&level);
        let table = values(2 * level.entries, 9);
        for isa in InstructionSet::available_sets() {
            let mut out = vec![0.0; 8 * n];
            let mut rows = out.chunks_exact_mut(n);
            let mut four = || std::array::from_fn(|_| rows.next().unwrap());
            let jacobian = LevelJacobian { first: four(), second: four() };
            let columns = |a: &'static [Vec<f32>; 3]| PointColumns { x: &a[0], y: &a[1], z: &a[2] };
            isa.encode_jacobian(geometry, &table, columns(Box::leak(Box::new(axes.clone()))), jacobian);
            let encode = |axes: [Vec<f32>; 3]| {
                let mut a = vec![0.0; n];
                let mut b = vec![0.0; n];
                isa.encode(
                    geometry,
                    &table,
                    PointColumns { x: &axes[0], y: &axes[1], z: &axes[2] },
                    &mut a,
                    &mut b,
                );
                [a, b]
            };
            let center = encode(axes.clone());
            for feature in 0..2 {
                for i in 0..n {
                    assert!((center[feature][i] - out[4 * feature * n + i]).abs() < 1e-6);
                }
            }
            for k in 0..3 {
                let h = 1e-4;
                let moved = |h: f32| {
                    let mut a = axes.clone();
                    a[k].iter_mut().for_each(|x| *x += h);
                    encode(a)
                };
                let up = moved(h);
                let down = moved(-h);
                for feature in 0..2 {
                    for i in 0..n {
                        let right = (up[feature][i] - center[feature][i]) / h;
                        let left = (center[feature][i] - down[feature][i]) / h;
                        let exact = out[(4 * feature + 1 + k) * n + i];
                        // At a cell border the interpolant has a kink; one side must agree.
                        let error = (right - exact).abs().min((left - exact).abs());
                        assert!(
                            error < 0.05 + 0.01 * exact.abs(),
                            "{}: {exact} but {left} and {right}",
                            isa.name()
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn points_outside_or_not_a_number_stay_in_the_table() {
    let axis = vec![
        -3.0,
        7.5,
        f32::NAN,
        f32::INFINITY,
        -f32::INFINITY,
        1e30,
        0.0,
        1.0,
        -0.0,
        0.5,
        1.0 + 1e-6,
        2.0,
        3.0,
        4.0,
        5.0,
        6.0,
    ];
    let points = PointColumns { x: &axis, y: &axis, z: &axis };
    for level in levels() {
        let geometry = LevelGeometry::new(&level);
        let table = vec![1.0; 2 * level.entries];
        for isa in InstructionSet::available_sets() {
            let mut a = vec![0.0; 16];
            let mut b = vec![0.0; 16];
            isa.encode(geometry, &table, points, &mut a, &mut b);
            assert!(a.iter().chain(&b).all(|v| (v - 1.0).abs() < 1e-5), "{}: {a:?}", isa.name());
            let mut gradient = vec![0.0; 2 * level.entries];
            isa.scatter(geometry, &mut gradient, points, &[1.0; 16], &[2.0; 16]);
            let sum: f32 = gradient.iter().sum();
            assert!((sum - 48.0).abs() < 1e-3, "{}: {sum}", isa.name());
        }
    }
}
