//! Image features on a GPU: what `feature::features` finds, for some frames at a time. Blurs, differences,
//! the way to the sample nearest to an extremum and histograms of gradients are the GPU's; whether there is
//! an extremum, which are the strongest, and what a histogram says are the processor's, by the same code.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use crate::capture::features::{
    descriptor::{
        CELLS, DESCRIPTOR_LENGTH, ORIENTATIONS, descriptor_window, hellinger, orientation_window, peaks,
    },
    feature::{
        Around, Crop, Extremum, FARTHEST, Feature, FeatureConfig, Fit, MOST_STEPS, sort_by_response, weakest,
    },
    scale_space::{Plan, half_kernel},
};
use crate::{
    capture::frame::RgbdFrame,
    gpu::{Buffer, Gpu, GpuError, Kernel},
};

const DOUBLE: Kernel = Kernel {
    name: "double",
    source: concat!(include_str!("../../gpu/thread.wgsl"), include_str!("double.wgsl")),
};
const BLUR: Kernel = Kernel {
    name: "blur",
    source: concat!(include_str!("../../gpu/thread.wgsl"), include_str!("blur.wgsl")),
};
const HALVE: Kernel = Kernel {
    name: "halve",
    source: concat!(include_str!("../../gpu/thread.wgsl"), include_str!("halve.wgsl")),
};
const EXTREMA: Kernel = Kernel {
    name: "extrema",
    source: concat!(
        include_str!("../../gpu/thread.wgsl"),
        include_str!("object.wgsl"),
        include_str!("extrema.wgsl")
    ),
};
const ORIENT: Kernel = Kernel {
    name: "orientations",
    source: concat!(
        include_str!("../../gpu/thread.wgsl"),
        include_str!("object.wgsl"),
        include_str!("gradients.wgsl"),
        include_str!("orientations.wgsl")
    ),
};
const DESCRIBE: Kernel = Kernel {
    name: "describe",
    source: concat!(
        include_str!("../../gpu/thread.wgsl"),
        include_str!("object.wgsl"),
        include_str!("gradients.wgsl"),
        include_str!("describe.wgsl")
    ),
};
const DOING: &str = "features";
/// Frames at a time: their blurred images lie in the GPU's memory together, about 40 MB of a frame of
/// 640x480 that is doubled.
const FRAMES: usize = 4;
/// Candidates of a frame that there is room for at first.
const CANDIDATES: usize = 8192;

/// `Size` of double.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Size {
    width: u32,
    height: u32,
}

/// `Blur` of blur.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Blur {
    width: u32,
    height: u32,
    start: u32,
    blurred_start: u32,
    weights_start: u32,
    radius: u32,
    along_rows: u32,
}

/// `Halving` of halve.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Halving {
    width: u32,
    start: u32,
    half_width: u32,
    half_height: u32,
    half_start: u32,
}

/// `Search` of extrema.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Search {
    crop: u32,
    octave: u32,
    start: u32,
    width: u32,
    height: u32,
    scales: u32,
    steps: u32,
    step: f32,
    weakest: f32,
    farthest: f32,
}

/// `Candidate` of extrema.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Candidate {
    crop: u32,
    octave: u32,
    level: u32,
    y: u32,
    x: u32,
    sample: [u32; 3],
    values: [f32; 27],
}

/// `Place` of gradients.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Place {
    start: u32,
    width: u32,
    height: u32,
    found: u32,
    step: f32,
    x: f32,
    y: f32,
    sigma: f32,
    reach: f32,
    angle: f32,
}

/// What `feature::features` finds in each frame.
///
/// # Errors
/// If the GPU fails, or the blurred images of a frame do not fit into one of its buffers.
pub(super) fn features_of_frames(
    gpu: &Gpu,
    frames: &[RgbdFrame],
    config: &FeatureConfig,
) -> Result<Vec<Vec<Feature>>, GpuError> {
    let mut found = Vec::with_capacity(frames.len());
    for some in frames.chunks(FRAMES) {
        let crops: Vec<Option<Crop>> = some.par_iter().map(|frame| Crop::of(frame, config)).collect();
        let searched: Vec<&Crop> = crops.iter().flatten().collect();
        let mut of_crops =
            gpu.guarded(DOING, || features_of_crops(gpu, &searched, config, CANDIDATES))?.into_iter();
        // Without an object there is nothing to search.
        let of_frame = |crop: &Option<Crop>| crop.as_ref().and_then(|_| of_crops.next()).unwrap_or_default();
        found.extend(crops.iter().map(of_frame));
    }
    Ok(found)
}

/// Features of each crop, in pixels of its frame, with room for so many candidates of each at first.
fn features_of_crops(
    gpu: &Gpu,
    crops: &[&Crop],
    config: &FeatureConfig,
    candidates: usize,
) -> Result<Vec<Vec<Feature>>, GpuError> {
    let spaces = crops.iter().map(|crop| Space::start(gpu, crop, config)).collect::<Result<Vec<_>, _>>()?;
    let mut extrema = vec![Vec::new(); crops.len()];
    for c in &search(gpu, &spaces, config, candidates)? {
        let octave_and_level = (c.octave as usize, c.level as usize);
        let fit = Around(c.values).fit(octave_and_level, c.sample.map(|k| k as usize), config);
        if let Fit::Here(extremum) = fit {
            extrema[c.crop as usize].push(extremum);
        }
    }
    extrema.iter_mut().for_each(|extrema| sort_by_response(extrema));
    let looked_at = |e: &Extremum| (*e, orientation_window(e.scale_px(config)), 0.0);
    let places = places(&spaces, extrema.iter().map(|of_crop| of_crop.iter().map(looked_at)));
    let histograms = histograms::<ORIENTATIONS>(gpu, (&ORIENT, 1), &spaces, &places)?;
    let turned: Vec<Vec<(Extremum, f32)>> = extrema
        .iter()
        .zip(histograms)
        .map(|(extrema, histograms)| {
            let all = extrema.iter().zip(histograms);
            let angles = all.flat_map(|(e, histogram)| peaks(histogram).into_iter().map(|a| (*e, a)));
            angles.take(config.limit).collect()
        })
        .collect();
    let described =
        |(e, angle_rad): &(Extremum, f32)| (*e, descriptor_window(e.scale_px(config)), *angle_rad);
    let places = self::places(&spaces, turned.iter().map(|of_crop| of_crop.iter().map(described)));
    let cells = self::histograms::<DESCRIPTOR_LENGTH>(gpu, (&DESCRIBE, CELLS * CELLS), &spaces, &places)?;
    let all = turned.iter().zip(cells).zip(crops.iter().zip(&spaces));
    let features = all.map(|((turned, cells), (crop, space))| {
        let of_one = |((e, angle_rad), cells): (&(Extremum, f32), [f32; DESCRIPTOR_LENGTH])| {
            let step = space.octaves[e.found.0].step;
            Some(e.feature(step, config, *angle_rad, hellinger(cells)?))
        };
        let mut features: Vec<Feature> = turned.iter().zip(cells).filter_map(of_one).collect();
        crop.place(&mut features);
        features
    });
    Ok(features.collect())
}

/// Images of an octave in a buffer.
struct OctaveImages {
    start: usize,
    width: usize,
    height: usize,
    step: f32,
}

impl OctaveImages {
    /// Where an image begins.
    fn image(&self, number: usize) -> usize {
        self.start + number * self.width * self.height
    }
}

/// The scale space of a crop on the GPU.
struct Space {
    octaves: Vec<OctaveImages>,
    images: Buffer,
    object: Buffer,
}

impl Space {
    /// Starts to make it.
    fn start(gpu: &Gpu, crop: &Crop, config: &FeatureConfig) -> Result<Self, GpuError> {
        let plan = crop.plan(config);
        let mut words = 0;
        let of_octave = |&(width, height, step): &(usize, usize, f32)| {
            let start = words;
            words += (plan.added_px.len() + 1) * width * height;
            OctaveImages { start, width, height, step }
        };
        let octaves: Vec<OctaveImages> = plan.octaves.iter().map(of_octave).collect();
        gpu.require(DOING, 4 * words)?;
        let space = Self { octaves, images: gpu.zeros(words), object: gpu.buffer(&object_words(crop)) };
        if let Some(first) = space.octaves.first() {
            let mut start = gpu.buffer(&crop.image.values);
            if plan.upsample {
                let pixels = first.width * first.height;
                let (image, doubled) = (start, gpu.zeros(pixels));
                let size = Size { width: crop.image.width as u32, height: crop.image.height as u32 };
                gpu.start(&DOUBLE, &[&gpu.buffer(&[size]), &image, &doubled], pixels);
                start = doubled;
            }
            space.blur(gpu, &plan, first, &start);
        }
        Ok(space)
    }

    /// Starts to make all images from that of the first octave before it is blurred.
    fn blur(&self, gpu: &Gpu, plan: &Plan, first: &OctaveImages, start: &Buffer) {
        let blurs = Blurs::of(gpu, plan, first.width * first.height);
        blurs.start(gpu, 0, first, [(start, 0), (&self.images, first.start)]);
        for (number, octave) in self.octaves.iter().enumerate() {
            if let Some(finer) = number.checked_sub(1).map(|k| &self.octaves[k]) {
                let halving = Halving {
                    width: finer.width as u32,
                    start: finer.image(plan.halved_image()) as u32,
                    half_width: octave.width as u32,
                    half_height: octave.height as u32,
                    half_start: octave.start as u32,
                };
                gpu.start(&HALVE, &[&gpu.buffer(&[halving]), &self.images], octave.width * octave.height);
            }
            for i in 0..plan.added_px.len() {
                let ends = [i, i + 1].map(|k| (&self.images, octave.image(k)));
                blurs.start(gpu, i + 1, octave, ends);
            }
        }
    }
}

/// Width and height of a crop, then what its pixels are, as object.wgsl has them.
fn object_words(crop: &Crop) -> Vec<u32> {
    let kinds: Vec<u8> =
        crop.object.iter().zip(&crop.inner).map(|(&on, &inner)| u8::from(on) + u8::from(inner)).collect();
    let word = |four: &[u8]| four.iter().rev().fold(0, |word, kind| word << 8 | u32::from(*kind));
    let size = [crop.image.width as u32, crop.image.height as u32];
    size.into_iter().chain(kinds.chunks(4).map(word)).collect()
}

/// The kernels of the blurs of a plan, the first one and those within an octave.
struct Blurs {
    weights: Buffer,
    /// Where each kernel begins, and its radius.
    kernels: Vec<(usize, usize)>,
    /// An image that is blurred along rows.
    rows: Buffer,
}

impl Blurs {
    fn of(gpu: &Gpu, plan: &Plan, most_pixels: usize) -> Self {
        let (mut weights, mut kernels) = (Vec::new(), Vec::new());
        for &sigma_px in std::iter::once(&plan.first_px).chain(&plan.added_px) {
            let half = half_kernel(sigma_px);
            kernels.push((weights.len(), half.len() - 1));
            weights.extend(half);
        }
        Self { weights: gpu.buffer(&weights), kernels, rows: gpu.zeros(most_pixels) }
    }

    /// Starts a blur of an image of an octave, which begins in a buffer, into another one.
    fn start(&self, gpu: &Gpu, number: usize, octave: &OctaveImages, ends: [(&Buffer, usize); 2]) {
        let (weights_start, radius) = self.kernels[number];
        let along_rows = (ends[0], (&self.rows, 0), 1);
        let along_columns = ((&self.rows, 0), ends[1], 0);
        for ((image, start), (blurred, blurred_start), along_rows) in [along_rows, along_columns] {
            let blur = Blur {
                width: octave.width as u32,
                height: octave.height as u32,
                start: start as u32,
                blurred_start: blurred_start as u32,
                weights_start: weights_start as u32,
                radius: radius as u32,
                along_rows,
            };
            let buffers = [&gpu.buffer(&[blur]), &self.weights, image, blurred];
            gpu.start(&BLUR, &buffers, octave.width * octave.height);
        }
    }
}

/// Candidates of all crops, sorted by crop, octave, level, row and column: the GPU finds them in no order.
fn search(
    gpu: &Gpu,
    spaces: &[Space],
    config: &FeatureConfig,
    candidates: usize,
) -> Result<Vec<Candidate>, GpuError> {
    const WORDS: usize = size_of::<Candidate>() / 4;
    let mut room = candidates * spaces.len();
    loop {
        gpu.require(DOING, 4 * (1 + room * WORDS))?;
        let found = gpu.zeros(1 + room * WORDS);
        for (crop, space) in spaces.iter().enumerate() {
            for (number, octave) in space.octaves.iter().enumerate() {
                let search = Search {
                    crop: crop as u32,
                    octave: number as u32,
                    start: octave.start as u32,
                    width: octave.width as u32,
                    height: octave.height as u32,
                    scales: config.scales as u32,
                    steps: MOST_STEPS as u32,
                    step: octave.step,
                    weakest: weakest(config),
                    farthest: FARTHEST,
                };
                let buffers = [&space.images, &space.object, &gpu.buffer(&[search]), &found];
                gpu.start(&EXTREMA, &buffers, octave.width * octave.height * config.scales);
            }
        }
        let words: Vec<u32> = gpu.read(DOING, &found)?;
        let count = words[0] as usize;
        if count <= room {
            let mut all: Vec<Candidate> = bytemuck::cast_slice(&words[1..1 + count * WORDS]).to_vec();
            all.sort_unstable_by_key(|c| (c.crop, c.octave, c.level, c.y, c.x));
            return Ok(all);
        }
        // The next time as many are found.
        room = count;
    }
}

/// Extrema of each crop, with standard deviation and reach of a window (see `Place`) and an angle, as places
/// in its images.
fn places<I: Iterator<Item = (Extremum, [f32; 2], f32)>>(
    spaces: &[Space],
    of_crops: impl Iterator<Item = I>,
) -> Vec<Vec<Place>> {
    let mut found = 0;
    let of_crop = |(space, extrema): (&Space, I)| {
        let place = |(e, [sigma, reach], angle): (Extremum, [f32; 2], f32)| {
            let octave = &space.octaves[e.found.0];
            found += 1;
            Place {
                start: octave.image(e.found.1) as u32,
                width: octave.width as u32,
                height: octave.height as u32,
                found: found - 1,
                step: octave.step,
                x: e.x,
                y: e.y,
                sigma,
                reach,
                angle,
            }
        };
        extrema.map(place).collect()
    };
    spaces.iter().zip(of_crops).map(of_crop).collect()
}

/// What a kernel, with so many threads a place, finds at the places in each space.
fn histograms<const N: usize>(
    gpu: &Gpu,
    (kernel, threads): (&Kernel, usize),
    spaces: &[Space],
    places: &[Vec<Place>],
) -> Result<Vec<Vec<[f32; N]>>, GpuError> {
    let count: usize = places.iter().map(Vec::len).sum();
    gpu.require(DOING, 4 * N * count)?;
    let found = gpu.zeros(N * count);
    for (space, places) in spaces.iter().zip(places) {
        // No kernel runs on nothing.
        if !places.is_empty() {
            gpu.require(DOING, size_of_val(places.as_slice()))?;
            let buffers = [&space.images, &space.object, &gpu.buffer(places), &found];
            gpu.start(kernel, &buffers, threads * places.len());
        }
    }
    let words: Vec<f32> = if count > 0 { gpu.read(DOING, &found)? } else { Vec::new() };
    let mut all = words.as_chunks().0.iter().copied();
    Ok(places.iter().map(|places| all.by_ref().take(places.len()).collect()).collect())
}

#[cfg(all(test, feature = "wgpu"))]
mod tests {
    use std::f32::consts::TAU;

    use super::*;
    use crate::{
        capture::features::{descriptor::dot, feature::features},
        geometry::{Intrinsics, Pose},
        gpu::tests::any_gpu,
    };

    /// Waves of many lengths and a checkerboard, under a disk with a hole.
    fn textured(width: usize, height: usize, shift: f32) -> RgbdFrame {
        let place = |i: usize| ((i % width) as f32 + shift, (i / width) as f32 + 0.3 * shift);
        let color = |i: usize| {
            let (x, y) = place(i);
            let wave = |k: usize| {
                let f = 1.3 / 1.45f32.powi(k as i32);
                let turn = 2.4 * k as f32 + shift;
                let (s, c) = turn.sin_cos();
                ((c * x + s * y) * f + turn).sin() * ((c * y - s * x) * 0.8 * f + 2.0 * turn).cos()
            };
            let waves: f32 = (0..10).map(wave).sum();
            let board = ((x / 13.0) as usize + (y / 17.0) as usize) % 2;
            (100.0 + 18.0 * waves + 40.0 * board as f32).clamp(0.0, 255.0) as u8
        };
        let on_object = |i: usize| {
            let (x, y) = ((i % width) as f32 / width as f32 - 0.5, (i / width) as f32 / height as f32 - 0.5);
            x.hypot(y) < 0.45 && (x - 0.1).hypot(y + 0.1) > 0.08
        };
        let count = width * height;
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics: Intrinsics { width, height, fx: 300.0, fy: 300.0, cx: 80.0, cy: 60.0 },
            world_from_camera: Pose::identity(),
            rgb: (0..count).map(|i| [color(i), color(i) / 2, 255 - color(i)]).collect(),
            depth_m: vec![1.0; count],
            mask: Some((0..count).map(on_object).collect()),
            readings: Vec::new(),
        }
    }

    /// How far apart two features are: pixels, share of the scale, angle, and cosine of the descriptors less
    /// than 1.
    fn difference(a: &Feature, b: &Feature) -> [f64; 4] {
        let away = (a.pixel[0] - b.pixel[0]).hypot(a.pixel[1] - b.pixel[1]);
        let turn = (a.angle_rad - b.angle_rad).rem_euclid(TAU);
        let product = |a: &Feature, b: &Feature| f64::from(dot(&a.descriptor, &b.descriptor));
        // Numbers of descriptors are rounded, and so are their lengths.
        let cosine = product(a, b) / (product(a, a) * product(b, b)).sqrt();
        let scale = (a.scale_px / b.scale_px - 1.0).abs();
        [f64::from(away), f64::from(scale), f64::from(turn.min(TAU - turn)), 1.0 - cosine]
    }

    /// Whether two features are the same up to rounding.
    fn are_same(a: &Feature, b: &Feature) -> bool {
        difference(a, b).into_iter().zip([1e-2, 1e-3, 1e-3, 1e-4]).all(|(d, most)| d < most)
    }

    /// Compares the features of frames by the processor with those by the GPU, and says how they differ.
    fn compare(ours: &[Vec<Feature>], theirs: &[Vec<Feature>]) -> String {
        assert_eq!(ours.len(), theirs.len());
        let mut text = String::new();
        for (ours, theirs) in ours.iter().zip(theirs) {
            let partners: Vec<(&Feature, &Feature)> =
                ours.iter().filter_map(|a| theirs.iter().find(|b| are_same(a, b)).map(|b| (a, b))).collect();
            let largest = partners.iter().fold([0.0f64; 4], |most, (a, b)| {
                let d = difference(a, b);
                [0, 1, 2, 3].map(|k| most[k].max(d[k]))
            });
            let [on_ours, on_theirs, same] = [ours.len(), theirs.len(), partners.len()];
            let [px, scale, rad, cosine] = largest.map(|d| format!("{d:.1e}"));
            text += &format!(
                "{on_ours} features, {on_theirs} on the GPU, {same} the same, \
                 within {px} px, {scale} of the scale, {rad} rad, {cosine} of the cosine\n"
            );
            assert!(same as f64 >= 0.995 * on_ours as f64, "{same} of {on_ours}");
            assert!(on_ours.abs_diff(on_theirs) as f64 <= 0.01 * on_ours as f64);
        }
        text
    }

    fn by_processor(frames: &[RgbdFrame], config: &FeatureConfig) -> Vec<Vec<Feature>> {
        frames.iter().map(|frame| features(frame, config)).collect()
    }

    #[test]
    fn features_are_those_of_the_processor() {
        let Some(gpu) = any_gpu() else { return };
        let mut frames: Vec<RgbdFrame> = [(320, 240), (157, 203), (20, 90), (5, 4), (240, 180)]
            .map(|(w, h)| textured(w, h, w as f32))
            .into();
        // Nothing to be searched.
        frames[2].mask = Some(vec![false; 20 * 90]);
        for upsample in [true, false] {
            let config = FeatureConfig { upsample, limit: 5000, ..FeatureConfig::default() };
            let ours = by_processor(&frames, &config);
            let counts: Vec<usize> = ours.iter().map(Vec::len).collect();
            assert!([0, 1, 4].iter().all(|k| counts[*k] > 50) && counts[2] == 0, "{counts:?}");
            let theirs = features_of_frames(&gpu, &frames, &config).unwrap();
            println!("{}", compare(&ours, &theirs));
        }
    }

    #[test]
    fn the_strongest_are_kept_and_candidates_beyond_the_room_are_found() {
        let Some(gpu) = any_gpu() else { return };
        let frames = [textured(200, 150, 3.0), textured(150, 200, 8.0)];
        let config = FeatureConfig { limit: 60, scales: 4, ..FeatureConfig::default() };
        let ours = by_processor(&frames, &config);
        assert!(ours.iter().all(|of_frame| of_frame.len() == 60));
        let crops: Vec<Crop> = frames.iter().filter_map(|frame| Crop::of(frame, &config)).collect();
        let theirs = features_of_crops(&gpu, &crops.iter().collect::<Vec<_>>(), &config, 20).unwrap();
        println!("{}", compare(&ours, &theirs));
        assert!(features_of_frames(&gpu, &[], &config).unwrap().is_empty());
    }

    #[test]
    fn features_of_another_image_are_not_the_same() {
        let config = FeatureConfig::default();
        let [a, b] = [0.0, 0.4].map(|shift| features(&textured(160, 120, shift), &config));
        let same = a.iter().filter(|a| b.iter().any(|b| are_same(a, b))).count();
        println!("{same} of {} and {} features are the same", a.len(), b.len());
        assert!(!a.is_empty() && same * 20 < a.len());
    }
}
