//! Whether a GPU wins: the same small work on the processor and on it.

use std::{collections::BTreeSet, time::Instant};

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::Monitor;
use crate::{
    articulate::{SurfacePair, SurfaceSamples, mesh_samples},
    capture::{MatchConfig, NoiseConfig, PixelMatch, RgbdFrame, match_states},
    config::GpuUse,
    geometry::{Grid3, Intrinsics, Pose},
    gpu::{Gpu, GpuError, Offload, Work},
    note::{Note, NoteCode},
    surface::{DistanceOptions, TriangleMesh, TsdfView, TsdfVolume, signed_distance},
};

/// A GPU that takes at most this share of the processor's time wins. Below 1, as what wins by chance would
/// not win again, and the files of two runs would differ by rounding.
const WON: f64 = 0.5;

/// A GPU whose findings agree less with the processor's has a fault: rounding changes few.
/// measured: on software Vulkan 0.991 of distances and 0.999 of all else agree
const AGREED: f64 = 0.98;

/// How long some work took.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The work.
    pub work: Work,
    /// On the processor, seconds.
    pub processor_s: f64,
    /// On the GPU with its kernels compiled, seconds; or why it failed, or is wrong.
    pub gpu_s: Result<f64, GpuError>,
}

impl Comparison {
    /// Whether the GPU clearly wins.
    #[must_use]
    pub fn is_won(&self) -> bool {
        self.gpu_s.as_ref().is_ok_and(|gpu_s| *gpu_s < WON * self.processor_s)
    }
}

impl std::fmt::Display for Comparison {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, processor_ms) = (self.work.name(), 1e3 * self.processor_s);
        match &self.gpu_s {
            Ok(gpu_s) => {
                let ratio = self.processor_s / gpu_s;
                write!(f, "{name} {processor_ms:.1} ms, {:.1} ms on the GPU ({ratio:.1}x)", 1e3 * gpu_s)
            }
            Err(error) => write!(f, "{name} {processor_ms:.1} ms, {error}"),
        }
    }
}

/// What a GPU does in a run by the settings, said to the monitor. Timings differ from run to run, so what
/// `auto` decides near a draw may, too; what is found is the same up to rounding.
pub(super) fn offload(asked: GpuUse, monitor: &Monitor) -> Offload {
    let gpu = match asked {
        GpuUse::Never => return Offload::none(),
        GpuUse::Auto => Gpu::open(false),
        GpuUse::Always => Gpu::open(true),
    };
    let say = |code, text| monitor.note(&Note::new(code, text));
    match (gpu, asked) {
        // Nobody asked for it.
        (Err(_), GpuUse::Auto) => Offload::none(),
        (Err(error), _) => {
            say(NoteCode::GpuFailed, format!("the processor does all work: {error}"));
            Offload::none()
        }
        (Ok(gpu), asked) => {
            let tried = trial(&gpu);
            for error in tried.iter().filter_map(|c| c.gpu_s.as_ref().err()) {
                say(NoteCode::GpuFailed, error.to_string());
            }
            let takes = |c: &Comparison| c.is_won() || (asked == GpuUse::Always && c.gpu_s.is_ok());
            let offload = Offload::on(gpu, |work| tried.iter().any(|c| c.work == work && takes(c)));
            if let Some(text) = offload.describe() {
                say(NoteCode::GpuUsed, text);
            }
            offload
        }
    }
}

/// Times each work on the processor and on a GPU, and compares what both find.
#[must_use]
pub fn trial(gpu: &Gpu) -> Vec<Comparison> {
    let scene = TrialScene::new();
    let one = |work: Work| {
        let (offload, none) = (Offload::on(gpu.clone(), |w| w == work), Offload::none());
        // The first time compiles the kernels.
        let [(ours, processor_s), (theirs, gpu_s)] = [&none, &offload].map(|offload| {
            let run = scene.prepared(work, offload);
            (run(), seconds(run))
        });
        let agreed = agreement(ours, theirs);
        let wrong = || {
            let message = format!("it finds {:.0} % of what the processor does", 100.0 * agreed);
            GpuError::Failed { doing: work.name(), message }
        };
        let failed = offload.failures().into_iter().next().or_else(|| (agreed < AGREED).then(wrong));
        Comparison { work, processor_s, gpu_s: failed.map_or(Ok(gpu_s), Err) }
    };
    Work::ALL.into_iter().map(one).collect()
}

/// Wall seconds, the better of two.
fn seconds<T>(run: impl Fn() -> T) -> f64 {
    let once = || {
        let start = Instant::now();
        drop(run());
        start.elapsed().as_secs_f64()
    };
    once().min(once())
}

/// What was found, in numbers that rounding seldom changes.
type Findings = Vec<[i64; 5]>;

/// Share of the findings of one or the other that both have.
fn agreement(ours: Findings, theirs: Findings) -> f64 {
    let most = ours.len().max(theirs.len()).max(1);
    let ours: BTreeSet<_> = ours.into_iter().collect();
    theirs.iter().filter(|finding| ours.contains(*finding)).count() as f64 / most as f64
}

/// A bumpy ball as some cameras see it, and its surface. Smaller than a recording, so that what a GPU takes
/// however little it is given weighs more here.
struct TrialScene {
    frames: Vec<RgbdFrame>,
    distances: Grid3<f32>,
    mesh: TriangleMesh,
    samples: SurfaceSamples,
}

const NODES: usize = 96;
const SAMPLES: usize = 20_000;
const EXTENT_M: f64 = 0.5;

impl TrialScene {
    fn new() -> Self {
        let frames: Vec<RgbdFrame> = (0..6).map(|i| view(f64::from(i))).collect();
        let mut volume = empty();
        volume.integrate(&views(&frames));
        let mesh = volume.mesh(0.0);
        let samples = mesh_samples(&mesh, SAMPLES);
        Self { frames, distances: volume.tsdf(0.0), mesh, samples }
    }

    /// Some work, which gives what it finds.
    fn prepared<'a>(&'a self, work: Work, offload: &'a Offload) -> Box<dyn Fn() -> Findings + 'a> {
        match work {
            Work::Fusion => {
                let views = views(&self.frames);
                Box::new(move || {
                    let mut volume = empty();
                    volume.fuse(&views, offload);
                    of_nodes(&volume.tsdf(0.0))
                })
            }
            Work::Features => Box::new(|| {
                let eighths = |pixels: f32| (8.0 * f64::from(pixels)).round() as i64;
                let of_match = |m: &PixelMatch| {
                    let [u, v] = m.pixel0.map(eighths);
                    [m.frame0 as i64, m.frame1 as i64, u, v, eighths(m.pixel1[0])]
                };
                let matches = match_states(halves(&self.frames), &MatchConfig::default(), offload);
                matches.iter().map(of_match).collect()
            }),
            Work::Distances => Box::new(|| {
                let options = DistanceOptions { near_m: 0.1 * EXTENT_M, ..DistanceOptions::default() };
                let found = signed_distance(&self.mesh, &self.distances, None, &options, offload);
                // Without a surface there is nothing to compare.
                found.map_or_else(|_| Vec::new(), |distances| of_nodes(&distances))
            }),
            Work::Labels => {
                let pair = SurfacePair::new([&self.samples; 2], [None, None], 0.03 * EXTENT_M);
                let pair = pair.offloading(offload);
                Box::new(move || {
                    // What is kept would not be searched for again.
                    pair.forget();
                    let of_motion = |k: i64| {
                        let partners = pair.partners(0, &Pose::rotation(Vector3::z() * 0.01 * k as f64));
                        partners.into_iter().map(move |(i, j)| [k, i as i64, j as i64, 0, 0])
                    };
                    (1..8).flat_map(of_motion).collect()
                })
            }
        }
    }
}

/// Some nodes of a grid with the distances there, in hundredths of a millimeter.
fn of_nodes(distances: &Grid3<f32>) -> Findings {
    let known = distances.values.iter().enumerate().filter(|(_, d)| d.is_finite()).step_by(17);
    known.map(|(i, d)| [i as i64, (1e5 * f64::from(*d)).round() as i64, 0, 0, 0]).collect()
}

/// Two states.
fn halves(frames: &[RgbdFrame]) -> [&[RgbdFrame]; 2] {
    let (a, b) = frames.split_at(frames.len() / 2);
    [a, b]
}

fn empty() -> TsdfVolume {
    let spacing_m = EXTENT_M / (NODES - 1) as f64;
    let corner = Point3::from(Vector3::repeat(-0.5 * EXTENT_M));
    TsdfVolume::new(corner, spacing_m, [NODES; 3], 0.04 * EXTENT_M)
}

fn views(frames: &[RgbdFrame]) -> Vec<TsdfView<'_>> {
    let noise = NoiseConfig::default();
    frames.iter().map(|frame| TsdfView::of_object(frame, &noise)).collect()
}

/// What a camera on a ring sees of the ball.
fn view(number: f64) -> RgbdFrame {
    let intrinsics = Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5 };
    let eye = UnitQuaternion::from_scaled_axis(Vector3::z() * number) * Vector3::new(0.7, 0.0, 0.2);
    let z = -eye.normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let axes = nalgebra::Matrix3::from_columns(&[x, z.cross(&x), z]);
    let rotation = UnitQuaternion::from_matrix(&axes);
    let world_from_camera = Pose::from_parts(eye.into(), rotation);
    let radius_m = 0.2;
    let hit = |pixel: usize| {
        let (u, v) = ((pixel % intrinsics.width) as f64, (pixel / intrinsics.width) as f64);
        let ray = intrinsics.ray(u, v);
        // The ray of depth `t`: |eye + t R ray|^2 = radius^2.
        let way = rotation * ray;
        let (a, b, c) = (way.norm_squared(), way.dot(&eye), eye.norm_squared() - radius_m * radius_m);
        let root = b * b - a * c;
        (root > 0.0).then(|| (-b - root.sqrt()) / a).map(|t| (t, eye + way * t))
    };
    let color = |place: Vector3<f64>| {
        let wave = |f: f64| (f * place.x).sin() * (f * place.y + 1.0).sin() * (f * place.z + 2.0).sin();
        (120.0 + 60.0 * wave(90.0) + 60.0 * wave(230.0)) as u8
    };
    let seen: Vec<Option<(f64, Vector3<f64>)>> = (0..intrinsics.width * intrinsics.height).map(hit).collect();
    let bump = |place: &Vector3<f64>| 0.004 * (40.0 * place.x).sin() * (40.0 * place.y).sin();
    RgbdFrame {
        id: String::new(),
        stamp_nanos: 0,
        intrinsics,
        world_from_camera,
        rgb: seen.iter().map(|s| s.map_or([0; 3], |s| [color(s.1); 3])).collect(),
        depth_m: seen.iter().map(|s| s.map_or(0.0, |(t, place)| (t + bump(&place)) as f32)).collect(),
        mask: Some(seen.iter().map(Option::is_some).collect()),
        readings: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "wgpu")]
    #[test]
    fn all_work_is_done_by_both() {
        let Some(gpu) = crate::gpu::tests::any_gpu() else { return };
        for comparison in trial(&gpu) {
            println!("{comparison}");
            assert!(comparison.gpu_s.is_ok() && comparison.processor_s > 0.0, "{comparison}");
        }
        let scene = TrialScene::new();
        for work in Work::ALL {
            let [ours, theirs] = [Offload::none(), Offload::on(gpu.clone(), |_| true)]
                .map(|offload| scene.prepared(work, &offload)());
            assert!(ours.len() > 20, "{}: {} findings", work.name(), ours.len());
            let agreed = agreement(ours, theirs);
            println!("{}: {agreed}", work.name());
            assert!(agreed > 0.99, "{}: {agreed}", work.name());
        }
    }

    #[test]
    fn findings_agree_by_what_both_have() {
        let found = |numbers: &[i64]| numbers.iter().map(|n| [*n; 5]).collect::<Findings>();
        assert_eq!(agreement(found(&[1, 2, 3, 4]), found(&[4, 3, 2, 7])), 0.75);
        assert_eq!(agreement(found(&[1]), found(&[1, 2])), 0.5);
        assert_eq!(agreement(found(&[1, 2]), Findings::new()), 0.0);
    }
}
