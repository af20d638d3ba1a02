//! The rays of an optimiser step, determined by seed and step.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::RadianceConfig;
use crate::FieldError;
use crate::pool::View;
use crate::sample::Stream;
use capture::RgbdFrame;
use geometry::SceneBox;

/// Most pixels drawn for a ray until one crosses the cube.
const TRIES: usize = 32;
/// Tested pixels along each side of a frame to see whether it shows the cube.
const LATTICE: usize = 24;

/// One ray in normalised coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ray {
    /// State of its image, 0 or 1.
    pub state: usize,
    pub origin: Point3<f64>,
    /// Unit direction.
    pub direction: Vector3<f64>,
    /// Length of a sample; 0 if the ray misses the cube.
    pub step: f64,
    /// Observed color in `[0, 1]`; white off the object.
    pub color: [f64; 3],
    /// Whether the pixel shows the object.
    pub object: bool,
    /// Observed distance along the ray (z-depth times the length of the ray to z = 1), if the object has a
    /// reading there.
    pub distance: Option<f64>,
}

/// Rays of both states with their samples, ray-major.
#[derive(Clone, Debug)]
pub(super) struct RayBatch {
    pub rays: Vec<Ray>,
    /// Samples per ray, a multiple of 16.
    pub samples: usize,
    /// Distance of every sample along its ray.
    pub distances: Vec<f64>,
}

impl RayBatch {
    /// By state, the number of rays and of rays with a reading.
    pub(super) fn state_counts(&self) -> [(usize, usize); 2] {
        [0, 1].map(|state| {
            let of_state = self.rays.iter().filter(|r| r.state == state);
            (of_state.clone().count(), of_state.filter(|r| r.distance.is_some()).count())
        })
    }
}

/// A ray's path through the cube, in normalised coordinates.
struct Crossing {
    origin: Point3<f64>,
    /// Direction with z = 1 in the camera.
    direction: Vector3<f64>,
    /// First and last parameter inside the cube: z-depth in meters times the scale.
    inside: Option<(f64, f64)>,
}

/// A pixel of an image, with its ray.
struct DrawnPixel<'a> {
    frame: &'a RgbdFrame,
    pixel: usize,
    crossing: Crossing,
}

/// The images from which rays are drawn.
pub(super) struct RaySource<'a> {
    states: [&'a [RgbdFrame]; 2],
    scene: SceneBox,
    ray_half_side: f64,
}

impl<'a> RaySource<'a> {
    /// # Errors
    /// [`FieldError::NoViews`] if no frame of a state sees the cube.
    pub(super) fn new(
        states: [&'a [RgbdFrame]; 2],
        scene: SceneBox,
        config: &RadianceConfig,
    ) -> Result<Self, FieldError> {
        let source = Self { states, scene, ray_half_side: config.ray_half_side };
        for (state, frames) in states.into_iter().enumerate() {
            if !frames.iter().any(|f| source.sees_cube(f)) {
                return Err(FieldError::NoViews { state });
            }
        }
        Ok(source)
    }

    /// Whether one of a lattice of pixels has a ray across the cube.
    fn sees_cube(&self, frame: &RgbdFrame) -> bool {
        let w = frame.intrinsics.width;
        let h = frame.intrinsics.height;
        let on_lattice = |i: usize, of: usize| (2 * i + 1) * of / (2 * LATTICE);
        (0..LATTICE * LATTICE)
            .map(|i| on_lattice(i / LATTICE, h) * w + on_lattice(i % LATTICE, w))
            .any(|pixel| self.cube_crossing(frame, pixel).inside.is_some())
    }

    /// The path of a pixel's ray through the cube.
    fn cube_crossing(&self, frame: &RgbdFrame, pixel: usize) -> Crossing {
        let view = View { intrinsics: frame.intrinsics, world_from_camera: frame.world_from_camera };
        let (origin, direction) = view.pixel_ray(pixel as u32);
        let origin = self.scene.normalise(&origin);
        let mut enter = 0.0f64;
        let mut leave = f64::INFINITY;
        for k in 0..3 {
            // A ray parallel to a face divides by 0: the result is a signed infinity or NaN, and max and min
            // ignore NaN.
            let [a, b] = [-self.ray_half_side, self.ray_half_side].map(|x| (x - origin[k]) / direction[k]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        let inside = (enter < leave && leave.is_finite()).then_some((enter, leave));
        Crossing { origin, direction, inside }
    }

    /// The rays of a step with the random key `key`: the configured number per state, each through a random
    /// pixel of a random image, across the cube if possible.
    pub(super) fn step_batch(&self, config: &RadianceConfig, key: u64) -> RayBatch {
        let samples = config.samples;
        let mut distances = vec![0.0; 2 * config.rays * samples];
        let rays = distances
            .par_chunks_exact_mut(samples)
            .enumerate()
            .map(|(i, distances)| {
                // Streams have 2^32 numbers each, so those of two rays never overlap.
                let mut stream = Stream(key.wrapping_add((i as u64) << 32));
                self.random_ray(i / config.rays, &mut stream, distances)
            })
            .collect();
        RayBatch { rays, samples, distances }
    }

    /// A random ray of a state; its samples are stratified along its path through the cube.
    fn random_ray(&self, state: usize, stream: &mut Stream, distances: &mut [f64]) -> Ray {
        let mut drawn = self.drawn_pixel(state, stream);
        for _ in 1..TRIES {
            if drawn.crossing.inside.is_some() {
                break;
            }
            drawn = self.drawn_pixel(state, stream);
        }
        let DrawnPixel { frame, pixel, crossing: Crossing { origin, direction, inside } } = drawn;
        let length = direction.norm();
        let (enter, leave) = inside.map_or((0.0, 0.0), |(a, b)| (a * length, b * length));
        let step = (leave - enter) / distances.len() as f64;
        for (i, t) in distances.iter_mut().enumerate() {
            *t = enter + (i as f64 + stream.next()) * step;
        }
        let object = frame.is_object(pixel);
        let depth_m = f64::from(frame.depth_m[pixel]);
        Ray {
            state,
            origin,
            direction: direction / length,
            step,
            color: if object { frame.rgb[pixel].map(|v| f64::from(v) / 255.0) } else { [1.0; 3] },
            object,
            distance: (object && depth_m > 0.0).then_some(depth_m * length * self.scene.scale),
        }
    }

    /// A random pixel of a random image of a state.
    fn drawn_pixel(&self, state: usize, stream: &mut Stream) -> DrawnPixel<'a> {
        let frames = self.states[state];
        let frame = &frames[index_at(stream.next(), frames.len())];
        let pixel = index_at(stream.next(), frame.rgb.len());
        DrawnPixel { frame, pixel, crossing: self.cube_crossing(frame, pixel) }
    }
}

/// The index below `count` at a given fraction.
fn index_at(share: f64, count: usize) -> usize {
    ((share * count as f64) as usize).min(count - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    /// A wall at z = 2 seen off its normal; the left half of the image is the object, a row has no depth.
    fn frame() -> RgbdFrame {
        let intrinsics = Intrinsics { width: 20, height: 10, fx: 9.0, fy: 9.0, cx: 9.5, cy: 4.5 };
        let pixels = 0..200usize;
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::new(Vector3::new(0.1, -0.2, 0.0), Vector3::new(0.1, 0.2, 0.3)),
            rgb: pixels.clone().map(|p| [p as u8, 10, 20]).collect(),
            depth_m: pixels.clone().map(|p| if p / 20 == 3 { 0.0 } else { 2.0 }).collect(),
            mask: Some(pixels.map(|p| p % 20 < 10).collect()),
            readings: Vec::new(),
        }
    }

    #[test]
    fn rays_show_their_pixels_and_stay_in_the_cube() {
        let frames = [frame()];
        let scene = SceneBox { center: frames[0].world_from_camera * Point3::new(0.0, 0.0, 2.0), scale: 0.7 };
        let config = RadianceConfig { rays: 150, samples: 32, ..RadianceConfig::default() };
        let source = RaySource::new([&frames, &frames], scene, &config).unwrap();
        let batch = source.step_batch(&config, 5);
        let own: Vec<Point3<f64>> = (0..200).filter_map(|p| frames[0].world_point(p)).collect();
        let [mut beside, mut unread] = [0, 0];
        for (i, ray) in batch.rays.iter().enumerate() {
            assert_eq!(ray.state, i / 150);
            assert!((ray.direction.norm() - 1.0).abs() < 1e-12 && ray.step > 0.0);
            let distances = &batch.distances[i * 32..(i + 1) * 32];
            for (k, t) in distances.iter().enumerate() {
                let p = ray.origin + ray.direction * *t;
                assert!(p.coords.amax() <= config.ray_half_side + 1e-9);
                assert!(k == 0 || *t - distances[k - 1] < 2.0 * ray.step);
            }
            if let Some(distance) = ray.distance {
                let seen = scene.to_world(&(ray.origin + ray.direction * distance));
                assert!(ray.object && own.iter().any(|p| (p - seen).norm() < 1e-9), "{seen}");
            } else {
                unread += usize::from(ray.object);
            }
            beside += usize::from(!ray.object);
            assert_eq!(ray.object, ray.color != [1.0; 3]);
        }
        assert!(beside > 50 && unread > 3, "{beside} {unread}");
        // Both states are drawn alike, and another key draws others.
        let readings = batch.rays.iter().filter(|r| r.distance.is_some()).count();
        let [(n, a), (m, b)] = batch.state_counts();
        assert!(n == 150 && m == 150 && a + b == readings);
        assert_eq!(source.step_batch(&config, 5).rays, batch.rays);
        assert_ne!(source.step_batch(&config, 6).rays, batch.rays);
    }

    #[test]
    fn a_state_that_looks_elsewhere_is_refused() {
        let frames = [frame()];
        let behind = frames[0].world_from_camera * Point3::new(0.0, 0.0, -9.0);
        let refused = RaySource::new(
            [&frames, &frames],
            SceneBox { center: behind, scale: 0.7 },
            &RadianceConfig::default(),
        );
        assert!(matches!(refused.err(), Some(FieldError::NoViews { state: 0 })));
    }
}
