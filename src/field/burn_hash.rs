//! Multi-resolution hash encoding (docs/method.md 12.1): custom kernels on a GPU, tensor operations on the
//! CPU device.
//!
//! The table is read by `gather`; its backward pass is an atomic `scatter`. `select` would be shorter, but
//! its backward pass runs one thread per table column: slow on a GPU, and wrong on drivers that limit loops.

use burn::tensor::{Device, Int, Tensor, TensorData};

use super::{FEATURES, LevelLayout};

/// Multipliers of the spatial hash as 32-bit integers: 1, 2654435761 and 805459861. Only the low 32 bits of a
/// product count, so signed arithmetic of 32 bits (GPUs) or 64 bits (the CPU backend) gives the same index.
const HASH_PRIMES: [i32; 3] = [1, 2_654_435_761_u32 as i32, 805_459_861];

/// Features `[points, 2 levels]` (column `2 level + feature`) at `points` `[points, 3]` of the unit cube.
///
/// `tables` holds one tensor `[2 entries]` per level. Differentiable by the tables, not by the points.
pub(super) fn hash_encode(points: &Tensor<2>, tables: &[Tensor<1>], levels: &[LevelLayout]) -> Tensor<2> {
    #[cfg(feature = "gpu")]
    if points.device().without_autodiff() != Device::flex() {
        let features = tables
            .iter()
            .zip(levels)
            .map(|(table, level)| super::gpu_hash::level_features(points, table, level));
        return Tensor::cat(features.collect(), 1);
    }
    let upper = Corners::new(&points.device());
    let features =
        tables.iter().zip(levels).map(|(table, level)| upper.interpolated_features(points, table, level));
    Tensor::cat(features.collect(), 1)
}

/// The constants 0 and 1 along the axes of a cell's 8 corners, `[1, z 2, y 2, x 2]`.
struct Corners {
    offset: Tensor<1, Int>,
    feature: Tensor<3, Int>,
}

impl Corners {
    fn new(device: &Device) -> Self {
        let offset = Tensor::<1, Int>::from_data(TensorData::from([0, 1]), device);
        Self { feature: offset.clone().reshape([1, 1, FEATURES]), offset }
    }

    /// Interpolated features `[points, 2]` of one level.
    fn interpolated_features(&self, points: &Tensor<2>, table: &Tensor<1>, level: &LevelLayout) -> Tensor<2> {
        let n = points.dims()[0];
        // docs/method.md (12.1).
        let position = points.clone() * level.scale + 0.5;
        let cell = position.clone().floor();
        let fraction = position - cell.clone();
        let cell = cell.int();

        let along_x = [n, 1, 1, 2];
        let along_y = [n, 1, 2, 1];
        let along_z = [n, 2, 1, 1];
        let weights = corner_weights(&fraction, 0, along_x)
            * corner_weights(&fraction, 1, along_y)
            * corner_weights(&fraction, 2, along_z);
        let x = self.axis_nodes(&cell, 0, along_x);
        let y = self.axis_nodes(&cell, 1, along_y);
        let z = self.axis_nodes(&cell, 2, along_z);
        // docs/method.md (12.2).
        let entry = if level.hashed {
            let y = y * HASH_PRIMES[1];
            let z = z * HASH_PRIMES[2];
            // A hashed level has 2^k entries: the remainder is the low k bits.
            broadcast_xor(broadcast_xor(x, y, [n, 1, 2, 2]), z, [n, 2, 2, 2])
                .bitwise_and_scalar(level.entries as i32 - 1)
        } else {
            let side = level.resolution as i32;
            (z * side + y) * side + x
        };
        let floats = entry.reshape([n, 8, 1]) * FEATURES as i32 + self.feature.clone();
        let corners = table.clone().gather(0, floats.reshape([n * 8 * FEATURES])).reshape([n, 8, FEATURES]);
        (corners * weights.reshape([n, 8, 1])).sum_dim(1).reshape([n, FEATURES])
    }

    /// Lower and upper node of every cell along one axis.
    fn axis_nodes(&self, cell: &Tensor<2, Int>, axis: usize, shape: [usize; 4]) -> Tensor<4, Int> {
        (cell.clone().narrow(1, axis, 1) + self.offset.clone().reshape([1, 2])).reshape(shape)
    }
}

/// The weight 1 - f of the lower corner and f of the upper one along one axis.
fn corner_weights(fraction: &Tensor<2>, axis: usize, shape: [usize; 4]) -> Tensor<4> {
    let f = fraction.clone().narrow(1, axis, 1);
    Tensor::cat(vec![f.clone().neg() + 1.0, f], 1).reshape(shape)
}

/// `a ^ b` with both expanded to one shape.
fn broadcast_xor(a: Tensor<4, Int>, b: Tensor<4, Int>, shape: [usize; 4]) -> Tensor<4, Int> {
    a.expand(shape).bitwise_xor(b.expand(shape))
}
