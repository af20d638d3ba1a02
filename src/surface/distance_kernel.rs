//! The nearest triangles of a distance field's nodes on a GPU. Distances and sides follow from them on the
//! processor.

use bytemuck::{Pod, Zeroable};

use super::pseudonormal::Pseudonormals;
use crate::gpu::{Gpu, GpuError, Kernel};

const SPREAD: Kernel = Kernel {
    name: "spread",
    source: concat!(
        include_str!("../gpu/thread.wgsl"),
        include_str!("closest.wgsl"),
        include_str!("spread.wgsl")
    ),
};
const REFINE: Kernel = Kernel {
    name: "refine",
    source: concat!(
        include_str!("../gpu/thread.wgsl"),
        include_str!("closest.wgsl"),
        include_str!("refine.wgsl")
    ),
};
const DOING: &str = "distances";

/// `Links` of closest.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Links {
    vertices: [u32; 3],
    across: [u32; 3],
}

/// The nearest triangle of each node, from the triangles of nodes in the band about the surface and the
/// seed nearest to each node; those of nodes further from their seed than so many spacings are
/// `distance::FAR`.
///
/// # Errors
/// If the GPU fails, or the grid or the mesh does not fit into one of its buffers.
pub(super) fn nearest_triangles(
    gpu: &Gpu,
    surface: &Pseudonormals,
    dims: [usize; 3],
    near: f64,
    (band, seeds): (&[u32], &[u32]),
) -> Result<Vec<u32>, GpuError> {
    gpu.require(DOING, 4 * band.len())?;
    gpu.require(DOING, size_of::<[[f32; 3]; 3]>() * surface.corners.len())?;
    gpu.guarded(DOING, || {
        let corners: Vec<[[f32; 3]; 3]> =
            surface.corners.iter().map(|t| t.map(|corner| corner.into())).collect();
        let links: Vec<Links> = surface
            .links()
            .map(|(vertices, across)| Links { vertices: *vertices, across: *across })
            .collect();
        let [nx, ny, nz] = dims.map(|n| n as u32);
        // Squares of distances between nodes are whole numbers.
        let params = gpu.buffer(&[nx, ny, nz, (near * near).floor() as u32]);
        let (corners, links) = (gpu.buffer(&corners), gpu.buffer(&links));
        let (starts, rings) = surface.rings().parts();
        let (starts, rings) = (gpu.buffer(starts), gpu.buffer(rings));
        let mesh = [&params, &corners, &links, &starts, &rings];
        let (own, seeds) = (gpu.buffer(band), gpu.buffer(seeds));
        let [triangles, refined] = [0, 1].map(|_| gpu.zeros(band.len()));
        gpu.start(&SPREAD, &[&mesh[..], &[&own, &seeds, &triangles]].concat(), band.len());
        gpu.start(&REFINE, &[&mesh[..], &[&own, &triangles, &refined]].concat(), band.len());
        gpu.read(DOING, &refined)
    })
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use crate::{
        gpu::{Offload, Work, tests::any_gpu},
        surface::{
            DistanceOptions, marching_cubes,
            shapes::{box_mesh, grid_of, sphere_mesh, torus},
            signed_distance,
        },
    };

    #[test]
    fn distances_are_those_of_the_processor() {
        let Some(gpu) = any_gpu() else { return };
        let ring = marching_cubes(&grid_of(0.5, 120, torus(0.25, 0.1)), 0.0);
        let nodes = grid_of(0.52, 71, |_| 0.0);
        for mesh in [sphere_mesh(0.3, 90), box_mesh([0.31, 0.17, 0.23].into()), ring] {
            for near_m in [0.06, f64::INFINITY] {
                let options = DistanceOptions { near_m, ..DistanceOptions::default() };
                let with =
                    |offload: &Offload| signed_distance(&mesh, &nodes, None, &options, offload).unwrap();
                let offload = Offload::on(gpu.clone(), |work| work == Work::Distances);
                let (ours, theirs) = (with(&Offload::none()), with(&offload));
                assert_eq!(offload.failures(), []);
                let (mut differ, mut farther) = (0, 0);
                for (a, b) in ours.values.iter().zip(&theirs.values) {
                    // As near as both searches promise, in spacings of 15 mm.
                    assert!((a.abs() - b.abs()).abs() < 0.006 && (a * b >= 0.0 || a.abs() < 1e-6), "{a} {b}");
                    // By more than a hundredth of a spacing. Of two distances to triangles the shorter is the
                    // better.
                    differ += usize::from((a - b).abs() > 1.5e-4);
                    farther += usize::from(b.abs() > a.abs() + 1.5e-4);
                }
                println!("{differ} of {} differ, {farther} farther", ours.values.len());
                // Both are searches, of which under 1 % of the nodes are off by as much.
                assert!(differ * 100 < ours.values.len(), "{differ}");
            }
        }
    }
}
