//! Nearest surface samples on a GPU.

use bytemuck::{Pod, Zeroable};
use nalgebra::Translation3;

use crate::articulate::samples::sample_index::SampleIndex;
use crate::{
    geometry::Pose,
    gpu::{Buffer, Gpu, GpuError, Kernel},
};

const NEAREST: Kernel = Kernel {
    name: "nearest",
    source: concat!(include_str!("../../gpu/thread.wgsl"), include_str!("nearest.wgsl")),
};
const DOING: &str = "labels";
/// No sample is near.
const NONE: u32 = u32::MAX;

/// `Params` of nearest.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Params {
    rotation: [f32; 9],
    shift: [f32; 3],
    cell_m: f32,
    reach_m: f32,
    dims: [u32; 3],
    queries: u32,
}

/// `Sample` of nearest.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Sample {
    point: [f32; 3],
    normal: [f32; 3],
}

/// An index in storage of a GPU.
pub(crate) struct IndexOnGpu {
    samples: Buffer,
    starts: Buffer,
    entries: Buffer,
}

impl IndexOnGpu {
    /// # Errors
    /// If it does not fit into a buffer, or the GPU fails.
    pub fn new(gpu: &Gpu, index: &SampleIndex<'_>) -> Result<Self, GpuError> {
        let (starts, entries) = index.cells.parts();
        gpu.require(DOING, size_of::<Sample>() * entries.len())?;
        gpu.require(DOING, 4 * starts.len())?;
        let all = index.samples.points.iter().zip(&index.samples.normals);
        let samples: Vec<Sample> = all
            .map(|(p, n)| Sample { point: (p - index.origin).cast().into(), normal: n.cast().into() })
            .collect();
        gpu.guarded(DOING, || {
            let [starts, entries] = [starts, entries].map(|values| gpu.buffer(values));
            Ok(Self { samples: gpu.buffer(&samples), starts, entries })
        })
    }
}

/// What [`SampleIndex::nearest`] finds in `searched` for every sample of `queries`, moved by
/// `searched_from_queries`.
///
/// # Errors
/// If the GPU fails.
pub(crate) fn nearest_of_all(
    gpu: &Gpu,
    (queries, queries_on_gpu): (&SampleIndex<'_>, &IndexOnGpu),
    (searched, searched_on_gpu): (&SampleIndex<'_>, &IndexOnGpu),
    searched_from_queries: &Pose,
) -> Result<Vec<Option<usize>>, GpuError> {
    // In double precision: the surfaces may be far from the world's origin.
    let between = Translation3::from(-searched.origin.coords)
        * searched_from_queries
        * Translation3::from(queries.origin.coords);
    let rotation = between.rotation.to_rotation_matrix();
    let count = queries.samples.points.len();
    let params = Params {
        rotation: std::array::from_fn(|i| rotation[(i / 3, i % 3)] as f32),
        shift: between.translation.vector.cast().into(),
        cell_m: searched.cell_m as f32,
        reach_m: searched.reach_m as f32,
        dims: searched.dims.map(|n| n as u32),
        queries: count as u32,
    };
    let found: Vec<u32> = gpu.guarded(DOING, || {
        let (params, partners) = (gpu.buffer(&[params]), gpu.zeros(count));
        let IndexOnGpu { samples, starts, entries } = searched_on_gpu;
        let buffers = [&params, &queries_on_gpu.samples, samples, starts, entries, &partners];
        gpu.start(&NEAREST, &buffers, count);
        gpu.read(DOING, &partners)
    })?;
    Ok(found.into_iter().take(count).map(|j| (j != NONE).then_some(j as usize)).collect())
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{articulate::samples::synthetic::Scene, gpu::tests::any_gpu};

    #[test]
    fn the_nearest_samples_are_those_of_the_processor() {
        let Some(gpu) = any_gpu() else { return };
        let scene = Scene::box_with_lid_and_drawer();
        scene.seen(0.004, 0.02, |pair, _| {
            let [a, b] = &pair.indices;
            let [on_a, on_b] = [a, b].map(|index| IndexOnGpu::new(&gpu, index).unwrap());
            let (mut found, mut differ) = (0, 0);
            // Made samples stand in rows: a motion off their axes leaves no two as near.
            let askew = Pose::new(Vector3::new(0.0012, -0.0021, 0.0007), Vector3::new(0.011, 0.007, -0.013));
            for motion in (0..scene.parts.len()).map(|part| scene.truth(part)) {
                let motion = askew * motion;
                let partners = nearest_of_all(&gpu, (a, &on_a), (b, &on_b), &motion).unwrap();
                assert_eq!(partners.len(), a.samples.points.len());
                for (i, partner) in partners.iter().enumerate() {
                    let (point, normal) = (motion * a.samples.points[i], motion * a.samples.normals[i]);
                    let expected = b.nearest(&point, &normal);
                    found += usize::from(expected.is_some());
                    // Two samples may be as near, up to rounding.
                    differ += usize::from(*partner != expected);
                }
            }
            println!("{differ} of {found} partners differ");
            assert!(found > 5000 && differ * 500 < found, "{differ} of {found}");
        });
    }
}
