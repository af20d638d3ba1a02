//! The hash encoding as one differentiable GPU operation, instead of a dozen tensor operations per level.

use burn::{
    backend::{
        Autodiff, Backend, Dispatch, Shape,
        autodiff::{
            checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
            grads::Gradients,
            ops::{Backward, Ops, OpsKind},
        },
        backend_extension,
        tensor::FloatTensor,
    },
    tensor::Tensor,
};
use burn_cubecl::{
    CubeBackend,
    kernel::into_contiguous,
    ops::numeric::{empty_device_dtype, zeros_client},
    tensor::CubeTensor,
};
use cubecl::{CubeDim, calculate_cube_count_elemwise};

use super::{FEATURES, LevelLayout, gpu_kernels};

/// Features `[points, 2]` of one level at `points` `[points, 3]`; `table` is `[2 entries]`. Differentiable by
/// the table.
pub(super) fn level_features(points: &Tensor<2>, table: &Tensor<1>, level: &LevelLayout) -> Tensor<2> {
    let features = <Dispatch as HashLevel>::hash_encode(
        points.clone().into_dispatch(),
        table.clone().into_dispatch(),
        *level,
    );
    Tensor::from_dispatch(features)
}

/// The encoding of one level and its derivative by the table.
#[backend_extension(Cube, Fusion, Autodiff)]
trait HashLevel: Backend {
    /// Features `[points, 2]`.
    #[fusion(dtype = table, shape = Shape::new([points[0], FEATURES]))]
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        level: LevelLayout,
    ) -> FloatTensor<Self>;

    /// Gradient `[2 entries]` by the table from the gradient `[points, 2]` by the features.
    #[fusion(dtype = gradient, shape = Shape::new([FEATURES * level.entries]))]
    fn hash_scatter(
        points: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        level: LevelLayout,
    ) -> FloatTensor<Self>;
}

impl HashLevel for CubeBackend {
    fn hash_encode(points: CubeTensor, table: CubeTensor, level: LevelLayout) -> CubeTensor {
        // The kernels index rows directly and would misread a strided view.
        let points = into_contiguous(points);
        let table = into_contiguous(table);
        let count = points.meta.shape()[0];
        let client = points.client.clone();
        let features = empty_device_dtype(
            client.clone(),
            points.device.clone(),
            Shape::new([count, FEATURES]),
            table.dtype,
        );
        let dim = CubeDim::new(&client, count);
        let cubes = calculate_cube_count_elemwise(&client, count, dim);
        // SAFETY: threads beyond the points return early; nodes of points in the unit cube lie inside the
        // table, whose size `check_shape` has verified.
        unsafe {
            gpu_kernels::encode::launch_unchecked(
                &client,
                cubes,
                dim,
                points.into_tensor_arg(),
                table.into_tensor_arg(),
                features.clone().into_tensor_arg(),
                level.scale,
                level.resolution as u32,
                level.entries as u32 - 1,
                level.hashed,
            );
        }
        features
    }

    fn hash_scatter(points: CubeTensor, gradient: CubeTensor, level: LevelLayout) -> CubeTensor {
        let points = into_contiguous(points);
        let gradient = into_contiguous(gradient);
        let count = points.meta.shape()[0];
        let client = points.client.clone();
        let table = zeros_client(
            client.clone(),
            points.device.clone(),
            Shape::new([FEATURES * level.entries]),
            gradient.dtype,
        );
        let dim = CubeDim::new(&client, count);
        let cubes = calculate_cube_count_elemwise(&client, count, dim);
        // SAFETY: as above; the additions are atomic.
        unsafe {
            gpu_kernels::scatter::launch_unchecked(
                &client,
                cubes,
                dim,
                points.into_tensor_arg(),
                gradient.into_tensor_arg(),
                table.clone().into_tensor_arg(),
                level.scale,
                level.resolution as u32,
                level.entries as u32 - 1,
                level.hashed,
            );
        }
        table
    }
}

/// The backward pass of [`HashLevel::hash_encode`].
#[derive(Debug)]
struct Scatter;

impl<B: Backend + HashLevel> Backward<B, 1> for Scatter {
    type State = (FloatTensor<B>, LevelLayout);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let [table] = ops.parents;
        let gradient = gradients.consume::<B>(&ops.node);
        let (points, level) = ops.state;
        if let Some(table) = table {
            gradients.register::<B>(table.id, B::hash_scatter(points, gradient, level));
        }
    }
}

impl<B: Backend + HashLevel, C: CheckpointStrategy> HashLevel for Autodiff<B, C> {
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        level: LevelLayout,
    ) -> FloatTensor<Self> {
        // The points are samples and need no gradient.
        let points = points.into_primitive();
        match Scatter.prepare::<C>([table.node()]).compute_bound().stateful() {
            OpsKind::Tracked(tracked) => {
                let features = B::hash_encode(points.clone(), table.into_primitive(), level);
                tracked.finish((points, level), features)
            }
            OpsKind::UnTracked(untracked) => {
                untracked.finish(B::hash_encode(points, table.into_primitive(), level))
            }
        }
    }

    /// Not differentiable itself, as no loss needs second derivatives.
    fn hash_scatter(
        points: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        level: LevelLayout,
    ) -> FloatTensor<Self> {
        FloatTensor::<Self>::new(B::hash_scatter(points.into_primitive(), gradient.into_primitive(), level))
    }
}
