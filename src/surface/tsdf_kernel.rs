//! Fusion of depth maps on a GPU: what [`TsdfVolume::integrate`] and [`TsdfVolume::face`] do, a thread a
//! node.

use bytemuck::{Pod, Zeroable};

use super::{
    rows::NEAR_M,
    tsdf::TsdfVolume,
    tsdf_view::{FREE_WEIGHT, TsdfView},
};
use crate::gpu::{Gpu, GpuError, Kernel};

const INTEGRATE: Kernel = Kernel {
    name: "integrate",
    source: concat!(include_str!("../gpu/thread.wgsl"), include_str!("view.wgsl"), include_str!("tsdf.wgsl")),
};
const FACE: Kernel = Kernel {
    name: "face",
    source: concat!(include_str!("../gpu/thread.wgsl"), include_str!("view.wgsl"), include_str!("face.wgsl")),
};
const DOING: &str = "fusion";
/// Most bytes of nodes at a time, before and after the second look each.
/// derived: a small part of the memory of any GPU, and millions of threads; others were not tried
const CHUNK_BYTES: usize = 64 << 20;
/// A depth beyond all others: shaders need not know infinity.
const FAR_M: f32 = 1e30;

/// `Params` of view.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Params {
    nx: u32,
    ny: u32,
    first: u32,
    layers: u32,
    views: u32,
    nz: u32,
    truncation_m: f32,
    free_weight: f32,
    near_m: f32,
    spacing_m: f32,
    origin: [f32; 3],
}

/// `Camera` of view.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Camera {
    origin: [f32; 3],
    steps: [[f32; 3]; 3],
    focal: [f32; 2],
    center: [f32; 2],
    size: [u32; 2],
    pixel: u32,
    eye: [f32; 3],
}

/// `Node` of view.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Node {
    sum: f32,
    weight: f32,
    color: [f32; 4],
}

impl TsdfVolume {
    /// [`Self::fuse`] on a GPU.
    ///
    /// # Errors
    /// If the GPU fails, or the views do not fit into one of its buffers. The volume is then as it was.
    pub(super) fn fuse_on(&mut self, gpu: &Gpu, views: &[TsdfView]) -> Result<(), GpuError> {
        gpu.guarded(DOING, || self.fuse_all(gpu, views))
    }

    fn fuse_all(&mut self, gpu: &Gpu, views: &[TsdfView]) -> Result<(), GpuError> {
        let [nx, ny, nz] = self.sums.dims;
        let layer_bytes = size_of::<Node>() * nx * ny;
        let most_layers = (CHUNK_BYTES.min(gpu.most_bytes() as usize) / layer_bytes.max(1)).max(3);
        gpu.require(DOING, most_layers.min(nz) * layer_bytes)?;
        gpu.require(DOING, 8 * views.iter().map(|v| v.readings.len()).sum::<usize>())?;
        let readings: Vec<[f32; 2]> = views
            .iter()
            .flat_map(|v| v.readings.iter().map(|r| [r.depth_m.min(FAR_M), r.signed_weight()]))
            .collect();
        let color = |[r, g, b]: &[u8; 3]| u32::from_le_bytes([*r, *g, *b, 0]);
        let colors: Vec<u32> = views.iter().flat_map(|v| v.frame.rgb.iter().map(color)).collect();
        let (readings, colors) = (gpu.buffer(&readings), gpu.buffer(&colors));
        let cameras = gpu.buffer(&self.cameras_of(views));
        let mut nodes = Vec::with_capacity(nx * ny * nz);
        // A layer on each side is looked at once only, for the slope of the next.
        for start in (0..nz).step_by(most_layers - 2) {
            let end = (start + most_layers - 2).min(nz);
            let (first, last) = (start.saturating_sub(1), (end + 1).min(nz));
            let (layers, count) = (last - first, (last - first) * nx * ny);
            let params = gpu.buffer(&[Params {
                nx: nx as u32,
                ny: ny as u32,
                first: first as u32,
                layers: layers as u32,
                views: views.len() as u32,
                nz: nz as u32,
                truncation_m: self.truncation_m,
                free_weight: FREE_WEIGHT,
                near_m: NEAR_M as f32,
                spacing_m: self.sums.spacing_m as f32,
                origin: self.sums.origin.coords.cast().into(),
            }]);
            let [once, twice] = [0, 1].map(|_| gpu.zeros(count * size_of::<Node>() / 4));
            gpu.start(&INTEGRATE, &[&params, &cameras, &readings, &colors, &once], count);
            gpu.start(&FACE, &[&params, &cameras, &readings, &colors, &once, &twice], count);
            let found: Vec<Node> = gpu.read(DOING, &twice)?;
            nodes.extend_from_slice(&found[(start - first) * nx * ny..(end - first) * nx * ny]);
        }
        for (i, node) in nodes.iter().enumerate() {
            (self.sums.values[i], self.weights[i], self.colors[i]) = (node.sum, node.weight, node.color);
        }
        Ok(())
    }

    fn cameras_of(&self, views: &[TsdfView]) -> Vec<Camera> {
        let mut pixel = 0;
        let of = |(view, (camera, eye)): (&TsdfView, (super::rows::RowCamera, nalgebra::Vector3<f32>))| {
            let k = &camera.intrinsics;
            let before = pixel;
            pixel += view.readings.len() as u32;
            Camera {
                origin: camera.origin.cast().into(),
                steps: camera.steps.map(|step| step.cast().into()),
                focal: camera.focal,
                center: camera.center,
                size: [k.width as u32, k.height as u32],
                pixel: before,
                eye: eye.into(),
            }
        };
        views.iter().zip(self.cameras(views)).map(of).collect()
    }
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use nalgebra::Point3;

    use crate::{
        capture::NoiseConfig,
        gpu::tests::any_gpu,
        surface::{
            TsdfView, TsdfVolume,
            shapes::{orbit, sphere},
        },
    };

    /// Nodes that differ by more than rounding, of those of a sphere in a grid of so many chunks.
    #[test]
    fn a_sphere_is_fused_as_on_the_processor() {
        let Some(gpu) = any_gpu() else { return };
        let frames = orbit(&sphere(0.2), 12, 0.8);
        let noise = NoiseConfig::default();
        let views: Vec<TsdfView> = frames.iter().map(|f| TsdfView::of_object(f, &noise)).collect();
        let volume = || TsdfVolume::new(Point3::new(-0.3, -0.31, -0.29), 0.0041, [149, 150, 151], 0.02);
        let (mut ours, mut theirs) = (volume(), volume());
        ours.integrate(&views);
        ours.face(&views);
        theirs.fuse_on(&gpu, &views).unwrap();
        let [a, b] = [ours.tsdf(0.0), theirs.tsdf(0.0)];
        let (mut near, mut off) = (0, 0);
        for i in 0..a.values.len() {
            let (a, b) = (a.values[i], b.values[i]);
            assert!(b.is_nan() || b.abs() < 0.0201, "{b}");
            near += usize::from(a.abs() < 0.019);
            // A node between two pixels may take either.
            off += usize::from(a.is_nan() != b.is_nan() || (a - b).abs() > 1e-6);
        }
        println!("{off} of {} nodes differ, {near} near", a.values.len());
        assert!(near > 100_000 && off * 2000 < near, "{off} of {near}");
        let [ours, theirs] = [ours.mesh(0.0), theirs.mesh(0.0)];
        assert!(ours.vertices.len().abs_diff(theirs.vertices.len()) < 20);
        assert!((ours.area_m2() / theirs.area_m2() - 1.0).abs() < 1e-5);
    }
}
