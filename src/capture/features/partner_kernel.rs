//! The best partners of features on a GPU.

use bytemuck::{Pod, Zeroable};

use crate::capture::features::{
    descriptor::DESCRIPTOR_LENGTH,
    feature::Feature,
    partner::{BestTwo, Partners},
};
use crate::gpu::{Gpu, GpuError, Kernel};

const PARTNERS: Kernel = Kernel { name: "partners", source: include_str!("partners.wgsl") };
const DOING: &str = "features";

/// `Task` of partners.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Task {
    first: u32,
    count: u32,
    partners: u32,
    partner_count: u32,
    found: u32,
}

/// `Feature` of partners.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Described {
    pixel: [f32; 2],
    words: [u32; DESCRIPTOR_LENGTH / 2],
}

/// `Found` of partners.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Found {
    best: u32,
    top: i32,
    second: i32,
}

/// What `partner::partners` finds for each of some pairs of images, by the features of the images of both
/// states. Products of integers are exact: it is the same.
///
/// # Errors
/// If the GPU fails, or the features do not fit into one of its buffers.
pub(super) fn partners_of_pairs(
    gpu: &Gpu,
    images: [&[Vec<Feature>]; 2],
    pairs: &[(usize, usize)],
) -> Result<Vec<Partners>, GpuError> {
    let described = |f: &Feature| Described {
        pixel: f.pixel,
        words: std::array::from_fn(|k| {
            let [low, high] = [0, 1].map(|side| u32::from(f.descriptor[2 * k + side] as u16));
            low | high << 16
        }),
    };
    let all: Vec<Described> = images.iter().flat_map(|s| s.iter().flatten()).map(described).collect();
    gpu.require(DOING, size_of::<Described>() * all.len())?;
    let mut first = 0u32;
    let ranges = images.map(|images| -> Vec<(u32, u32)> {
        let of_image = |image: &Vec<Feature>| {
            let range = (first, image.len() as u32);
            first += range.1;
            range
        };
        images.iter().map(of_image).collect()
    });
    let (mut tasks, mut groups, mut found) = (Vec::new(), Vec::new(), 0u32);
    for &(a, b) in pairs {
        for (own, other) in [(ranges[0][a], ranges[1][b]), (ranges[1][b], ranges[0][a])] {
            groups.extend((0..own.1).step_by(Kernel::GROUP).map(|from| [tasks.len() as u32, from]));
            let ((first, count), (partners, partner_count)) = (own, other);
            tasks.push(Task { first, count, partners, partner_count, found });
            found += count;
        }
    }
    gpu.require(DOING, size_of::<Found>() * found as usize)?;
    let on_gpu = || {
        let (on_gpu, features) = (gpu.buffer(&tasks), gpu.buffer(&all));
        let (of_tasks, out) = (gpu.buffer(&groups), gpu.zeros(found as usize * size_of::<Found>() / 4));
        gpu.start(&PARTNERS, &[&on_gpu, &features, &of_tasks, &out], Kernel::GROUP * groups.len());
        gpu.read(DOING, &out)
    };
    let found: Vec<Found> = if found == 0 { Vec::new() } else { gpu.guarded(DOING, on_gpu)? };
    let of_task = |task: &Task| -> Vec<Option<BestTwo>> {
        let found = &found[task.found as usize..(task.found + task.count) as usize];
        let best = |f: &Found| {
            (task.partner_count > 0).then_some(BestTwo {
                best: f.best as usize,
                top: f.top,
                second: f.second,
            })
        };
        found.iter().map(best).collect()
    };
    Ok(tasks
        .chunks_exact(2)
        .map(|both| Partners { forward: of_task(&both[0]), backward: of_task(&both[1]) })
        .collect())
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use rand_core::Rng as _;

    use super::*;
    use crate::{capture::features::partner::partners, gpu::tests::any_gpu, random::stage_rng};

    #[test]
    fn the_best_partners_are_those_of_the_processor() {
        let Some(gpu) = any_gpu() else { return };
        let mut rng = stage_rng(1, "partners", 0);
        let mut number = |below: u32| rng.next_u32() % below;
        // Few places and values: equal products, and partners at one place.
        let mut image = |count: usize| -> Vec<Feature> {
            let feature = |_| Feature {
                pixel: [number(40) as f32 * 0.7, number(9) as f32],
                scale_px: 1.0,
                angle_rad: 0.0,
                response: 1.0,
                descriptor: std::array::from_fn(|_| (number(3) * 300) as i16),
            };
            (0..count).map(feature).collect()
        };
        // As many as a frame has at most.
        let images = [vec![image(130), image(0), image(1)], vec![image(64), image(1100)]];
        let pairs = [(0, 0), (0, 1), (1, 0), (2, 1), (2, 0)];
        let found = partners_of_pairs(&gpu, [&images[0], &images[1]], &pairs).unwrap();
        for (&(a, b), found) in pairs.iter().zip(&found) {
            assert_eq!(*found, partners(&images[0][a], &images[1][b]));
        }
        assert!(partners_of_pairs(&gpu, [&[], &[]], &[]).unwrap().is_empty());
    }
}
