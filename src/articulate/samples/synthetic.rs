//! Textured boxes rendered analytically: scenes with a known answer for the tests of this folder.

use nalgebra::{Point3, Vector3};

use crate::{observations::SurfaceSamples, pair::surface_pair::SurfacePair};
use capture::{PixelMatch, RgbdFrame};
use geometry::{Intrinsics, Pose, Screw};

/// A rigid part of axis-aligned boxes, as it stands in state 0.
pub struct Part {
    /// Center and half sides of every box, meters.
    pub boxes: Vec<(Point3<f64>, Vector3<f64>)>,
    /// Motion from state 0 to state 1 before the world is moved.
    pub motion: Pose,
}

/// Parts in a world that was moved as a whole by `world`.
pub struct Scene {
    pub parts: Vec<Part>,
    pub world: Pose,
    /// Amplitude of the texture; 0 is plain.
    pub texture: f64,
}

fn cuboid(center: [f64; 3], half: [f64; 3]) -> (Point3<f64>, Vector3<f64>) {
    (Point3::from(center), Vector3::from(half))
}

/// A turn about a line.
pub fn turn(axis: Vector3<f64>, point: [f64; 3], angle_rad: f64) -> Pose {
    let screw = Screw {
        direction: nalgebra::Unit::new_normalize(axis),
        point: Point3::from(point),
        angle_rad,
        advance_m: 0.0,
    };
    screw.to_motion()
}

impl Scene {
    /// A chest whose lid opens by 0.6 rad about its rear edge.
    pub fn box_with_lid() -> Self {
        let chest = Part { boxes: vec![cuboid([0.0, 0.0, 0.1], [0.2, 0.15, 0.1])], motion: Pose::identity() };
        let lid = Part {
            boxes: vec![cuboid([0.0, 0.0, 0.215], [0.2, 0.15, 0.015])],
            motion: turn(Vector3::x(), [0.0, 0.15, 0.2], -0.6),
        };
        Self { parts: vec![chest, lid], world: Pose::identity(), texture: 1.0 }
    }

    /// The chest with a drawer that slides out below the lid.
    pub fn box_with_lid_and_drawer() -> Self {
        let mut scene = Self::box_with_lid();
        scene.parts[0].boxes =
            vec![cuboid([0.0, 0.0, 0.15], [0.2, 0.15, 0.05]), cuboid([0.0, 0.14, 0.05], [0.2, 0.01, 0.05])];
        let drawer = Part {
            boxes: vec![cuboid([0.0, -0.08, 0.05], [0.19, 0.2, 0.045])],
            motion: Pose::translation(0.0, -0.1, 0.0),
        };
        scene.parts.push(drawer);
        scene
    }

    /// A chest with two drawers side by side, pulled by so many meters each.
    pub fn two_drawers(pulled_m: [f64; 2]) -> Self {
        let chest =
            vec![cuboid([0.0, 0.0, 0.15], [0.2, 0.15, 0.05]), cuboid([0.0, 0.14, 0.05], [0.2, 0.01, 0.05])];
        let drawer = |x: f64, pulled_m: f64| Part {
            boxes: vec![cuboid([x, -0.08, 0.05], [0.095, 0.2, 0.045])],
            motion: Pose::translation(0.0, -pulled_m, 0.0),
        };
        let parts = vec![
            Part { boxes: chest, motion: Pose::identity() },
            drawer(-0.1, pulled_m[0]),
            drawer(0.1, pulled_m[1]),
        ];
        Self { parts, world: Pose::identity(), texture: 0.0 }
    }

    /// A lamp: a foot, an arm that turns about the foot's top and a head that turns about the arm's end, both
    /// about y, so the head's motion in the world is a plain rotation too.
    pub fn lamp() -> Self {
        let foot =
            Part { boxes: vec![cuboid([0.0, 0.0, 0.02], [0.12, 0.1, 0.02])], motion: Pose::identity() };
        let bend = turn(Vector3::y(), [0.0, 0.0, 0.05], 0.5);
        let arm = Part { boxes: vec![cuboid([0.0, 0.0, 0.18], [0.015, 0.025, 0.14])], motion: bend };
        let nod = turn(Vector3::y(), [0.0, 0.0, 0.33], 0.6);
        let head = Part { boxes: vec![cuboid([0.06, 0.0, 0.34], [0.08, 0.045, 0.02])], motion: bend * nod };
        Self { parts: vec![foot, arm, head], world: Pose::identity(), texture: 1.0 }
    }

    /// A plain case whose lid stands upright, then is nearly closed.
    pub fn case() -> Self {
        let base =
            Part { boxes: vec![cuboid([0.0, 0.0, 0.01], [0.2, 0.15, 0.01])], motion: Pose::identity() };
        let lid = Part {
            boxes: vec![cuboid([0.0, 0.15, 0.16], [0.2, 0.007, 0.135])],
            motion: turn(Vector3::x(), [0.0, 0.15, 0.02], 1.35),
        };
        Self { parts: vec![base, lid], world: Pose::identity(), texture: 0.0 }
    }

    /// A jar whose lid unscrews by 2 rad and 16 mm.
    pub fn jar() -> Self {
        let jar =
            Part { boxes: vec![cuboid([0.0, 0.0, 0.06], [0.05, 0.05, 0.06])], motion: Pose::identity() };
        let screw =
            Screw { direction: Vector3::z_axis(), point: Point3::origin(), angle_rad: 2.0, advance_m: 0.016 };
        let lid = Part {
            boxes: vec![
                cuboid([0.0, 0.0, 0.135], [0.055, 0.045, 0.014]),
                cuboid([0.03, 0.0, 0.155], [0.012, 0.02, 0.008]),
            ],
            motion: screw.to_motion(),
        };
        Self { parts: vec![jar, lid], world: Pose::identity(), texture: 1.0 }
    }

    /// Signed distance of a world point to the boxes, meters; exact outside.
    pub fn distance_m(&self, state: usize, point: &Point3<f64>) -> f64 {
        let of = |(i, part): (usize, &Part)| {
            let p = self.world_from_part(state, i).inverse_transform_point(point);
            let to_box = |(center, half): &(Point3<f64>, Vector3<f64>)| {
                let q = (p - center).abs() - half;
                q.map(|x| x.max(0.0)).norm() + q.max().min(0.0)
            };
            part.boxes.iter().map(to_box).fold(f64::INFINITY, f64::min)
        };
        self.parts.iter().enumerate().map(of).fold(f64::INFINITY, f64::min)
    }

    /// Motion of a part from state 0 to state 1 in the moved world.
    pub fn truth(&self, part: usize) -> Pose {
        self.world * self.parts[part].motion * self.world.inverse()
    }

    /// Pose of a part's own coordinates in the world.
    fn world_from_part(&self, state: usize, part: usize) -> Pose {
        if state == 0 { self.world } else { self.world * self.parts[part].motion }
    }

    /// Nearest hit of a world ray: parameter, part, point in the part and its normal there.
    fn hit(
        &self,
        state: usize,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<(f64, usize, Point3<f64>, Vector3<f64>)> {
        let mut nearest: Option<(f64, usize, Point3<f64>, Vector3<f64>)> = None;
        for (i, part) in self.parts.iter().enumerate() {
            let part_from_world = self.world_from_part(state, i).inverse();
            let o = part_from_world * origin;
            let d = part_from_world * direction;
            for (center, half) in &part.boxes {
                // A ray is in the box from where it has entered all three slabs to where it leaves the first.
                let mut enter = 0.0;
                let mut leave = f64::INFINITY;
                let mut axis = 3;
                for k in 0..3 {
                    let a = (center[k] - half[k] - o[k]) / d[k];
                    let b = (center[k] + half[k] - o[k]) / d[k];
                    if a.min(b) > enter {
                        (enter, axis) = (a.min(b), k);
                    }
                    leave = leave.min(a.max(b));
                }
                if enter < leave && axis < 3 && nearest.as_ref().is_none_or(|n| enter < n.0) {
                    let mut normal = Vector3::zeros();
                    normal[axis] = -d[axis].signum();
                    nearest = Some((enter, i, o + d * enter, normal));
                }
            }
        }
        nearest
    }

    /// Color of a part at a point in its own coordinates.
    fn color(&self, part: usize, p: &Point3<f64>) -> [f32; 3] {
        let base = [[0.5, 0.45, 0.4], [0.4, 0.5, 0.6], [0.6, 0.4, 0.35]][part % 3];
        let mut value = 0.0;
        for (octave, size_m) in [0.05, 0.025, 0.012].into_iter().enumerate() {
            value += value_noise(&(p.coords / size_m), (17 * part + octave) as i64) - 0.5;
        }
        base.map(|b: f64| (b + 0.35 * self.texture * value).clamp(0.0, 1.0) as f32)
    }

    /// Renders the scene from cameras given in the unmoved world; object pixels are masked.
    pub fn frames(&self, state: usize, cameras: &[Pose]) -> Vec<RgbdFrame> {
        let intrinsics = Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 161.0, cy: 118.0 };
        let one = |(i, camera): (usize, &Pose)| {
            let world_from_camera = self.world * camera;
            let n = intrinsics.width * intrinsics.height;
            let mut rgb = vec![[90; 3]; n];
            let mut depth_m = vec![0.0; n];
            let mut mask = vec![false; n];
            for p in 0..n {
                let ray = intrinsics.ray_at((p % intrinsics.width) as f64, (p / intrinsics.width) as f64);
                let origin = Point3::from(world_from_camera.translation.vector);
                if let Some((t, part, at, _)) = self.hit(state, &origin, &(world_from_camera * ray)) {
                    // The ray has unit depth, so its parameter is the depth.
                    depth_m[p] = t as f32;
                    rgb[p] = self.color(part, &at).map(|c| (c * 255.0).round() as u8);
                    mask[p] = true;
                }
            }
            RgbdFrame {
                id: format!("{state}_{i:04}"),
                stamp_nanos: i as i64,
                intrinsics,
                world_from_camera,
                rgb,
                depth_m,
                mask: Some(mask),
                readings: Vec::new(),
            }
        };
        cameras.iter().enumerate().map(one).collect()
    }

    /// World point seen at a pixel; `None` beside the object.
    pub fn ray_hit(&self, state: usize, frame: &RgbdFrame, pixel: [f32; 2]) -> Option<Point3<f64>> {
        let ray = frame.world_from_camera * frame.intrinsics.ray_at(f64::from(pixel[0]), f64::from(pixel[1]));
        let origin = Point3::from(frame.world_from_camera.translation.vector);
        self.hit(state, &origin, &ray).map(|(t, ..)| origin + ray * t)
    }

    /// How far apart the ends of a match lie on the object; `None` where an end misses it or parts differ.
    pub fn match_error_m(&self, frames: &[Vec<RgbdFrame>; 2], m: &PixelMatch) -> Option<f64> {
        let at = |state: usize, frame: &RgbdFrame, pixel: [f32; 2]| {
            let ray =
                frame.world_from_camera * frame.intrinsics.ray_at(f64::from(pixel[0]), f64::from(pixel[1]));
            self.hit(state, &Point3::from(frame.world_from_camera.translation.vector), &ray)
        };
        let a = at(0, &frames[0][m.frame0], m.pixel0)?;
        let b = at(1, &frames[1][m.frame1], m.pixel1)?;
        (a.1 == b.1).then(|| (a.2 - b.2).norm())
    }

    /// Calls with what a ring of ten cameras sees of both states, and the part of each sample.
    pub fn seen<R>(
        &self,
        spacing_m: f64,
        reach_m: f64,
        then: impl FnOnce(SurfacePair<'_>, &[Vec<u8>; 2]) -> R,
    ) -> R {
        let cameras = &camera_ring(10);
        let [(s0, t0), (s1, t1)] = [0, 1].map(|s| self.surface(s, cameras, spacing_m));
        let free = [0, 1].map(|s| move |p: &Point3<f64>| self.is_free(s, cameras, p));
        then(SurfacePair::new([&s0, &s1], [Some(&free[0]), Some(&free[1])], reach_m), &[t0, t1])
    }

    /// Points on the faces that some camera sees, with the part of each, on grids `spacing_m` wide.
    pub fn surface(&self, state: usize, cameras: &[Pose], spacing_m: f64) -> (SurfaceSamples, Vec<u8>) {
        let mut samples = SurfaceSamples::default();
        let mut labels = Vec::new();
        for (i, part) in self.parts.iter().enumerate() {
            let pose = self.world_from_part(state, i);
            for (center, half) in &part.boxes {
                for face in 0..6 {
                    let k = face / 2;
                    let sign = if face % 2 == 0 { 1.0 } else { -1.0 };
                    let a = (k + 1) % 3;
                    let b = (k + 2) % 3;
                    let steps = |axis: usize| ((2.0 * half[axis] / spacing_m) as usize).max(1);
                    for s in 0..steps(a) * steps(b) {
                        let mut p = *center;
                        p[k] += sign * half[k];
                        p[a] += half[a] * (2.0 * ((s % steps(a)) as f64 + 0.5) / steps(a) as f64 - 1.0);
                        p[b] += half[b] * (2.0 * ((s / steps(a)) as f64 + 0.5) / steps(b) as f64 - 1.0);
                        let mut normal = Vector3::zeros();
                        normal[k] = sign;
                        let point = pose * p;
                        // Hidden faces have no samples, as in a recording.
                        if cameras.iter().any(|c| self.sees(state, &(self.world * c), &point)) {
                            samples.points.push(point);
                            samples.normals.push(pose * normal);
                            samples.colors.push(self.color(i, &p));
                            labels.push(i as u8);
                        }
                    }
                }
            }
        }
        (samples, labels)
    }

    /// Whether nothing lies between a camera and a point.
    fn sees(&self, state: usize, world_from_camera: &Pose, point: &Point3<f64>) -> bool {
        let origin = Point3::from(world_from_camera.translation.vector);
        self.hit(state, &origin, &(point - origin)).is_some_and(|(t, ..)| t > 1.0 - 1e-6)
    }

    /// Whether some camera sees through a point of a state.
    pub fn is_free(&self, state: usize, cameras: &[Pose], point: &Point3<f64>) -> bool {
        cameras.iter().any(|c| {
            let origin = Point3::from((self.world * c).translation.vector);
            let range = (point - origin).norm();
            self.hit(state, &origin, &(point - origin)).is_none_or(|(t, ..)| (t - 1.0) * range > 0.01)
        })
    }
}

/// Smooth noise in `[0, 1]` with nodes at integer points.
fn value_noise(p: &Vector3<f64>, seed: i64) -> f64 {
    let base = p.map(f64::floor);
    let f = (p - base).map(|t| t * t * (3.0 - 2.0 * t));
    let mut sum = 0.0;
    for corner in 0..8 {
        let bit = |k: usize| (corner >> k & 1) as f64;
        let weight: f64 = (0..3).map(|k| if bit(k) > 0.0 { f[k] } else { 1.0 - f[k] }).product();
        let node = [0, 1, 2].map(|k| (base[k] + bit(k)) as i64);
        let mut h =
            (node[0] * 73_856_093) ^ (node[1] * 19_349_663) ^ (node[2] * 83_492_791) ^ (seed * 2_654_435_761);
        h = (h ^ (h >> 13)).wrapping_mul(0x5bd1_e995_7f4a_7c15);
        h ^= h >> 29;
        h = h.wrapping_mul(0x1ce4_e5b9_94d0_49bb);
        sum += weight * ((h >> 40) & 0xff_ffff) as f64 / f64::from(0x100_0000);
    }
    sum
}

/// Camera poses on a ring that looks down on the object from two heights.
pub fn camera_ring(count: usize) -> Vec<Pose> {
    (0..count)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / count as f64;
            let eye = Point3::new(0.85 * angle.cos(), 0.85 * angle.sin(), if i % 2 == 0 { 0.5 } else { 0.7 });
            // Optical frames look along +z with y down.
            Pose::face_towards(&eye, &Point3::new(0.0, 0.0, 0.12), &-Vector3::z())
        })
        .collect()
}
