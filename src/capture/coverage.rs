//! Viewing directions and depth quality of a state: how good a recording is, before a twin is made of it.

use std::{f64::consts::TAU, fmt};

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{Capture, NoiseConfig, RgbdFrame, median_over_object};
use numeric::statistics::median;

/// Names of the sectors around the object, from its front on to the right, as seen from above.
pub const SECTORS: [&str; 8] =
    ["front", "front right", "right", "back right", "back", "back left", "left", "front left"];
/// Stride of the sampled pixels.
/// derived: some hundred samples of an object that covers a tenth of 640x480
const STRIDE: usize = 97;
/// Number of sampled points on the object, looked for in all views of the state.
const POINTS: usize = 400;
/// Standard deviations within which a reading is of the same surface ...
/// chosen: 0.3 % of a normal distribution
const GATE_SIGMAS: f64 = 3.0;
/// ... plus this share of the depth, for errors of poses and of the sensor.
/// chosen: a hundredth of a degree of pose error, and a warp of half a percent
const GATE_SHARE: f64 = 0.01;

/// How well the views of a state cover the object.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Per view: azimuth from the front to the right, radians; elevation, radians; distance from the object's
    /// center, meters.
    pub eyes: Vec<[f64; 3]>,
    /// Number of views from each of [`SECTORS`].
    pub by_sector: [usize; SECTORS.len()],
    /// Number of views with a reading of a point on the object: median over the points.
    pub seen_by: f64,
    /// Median depth of the object, meters.
    pub depth_m: f64,
    /// Standard deviation of a reading at that depth, meters.
    pub sigma_m: f64,
    /// Share of the object's pixels without depth.
    pub unread: f64,
    /// Share of the views in which the image border cuts the object.
    pub cut: f64,
}

/// Coverage of the object in each state, under its masks; `None` for a state without object pixels.
#[must_use]
pub fn coverage(capture: &Capture) -> Vec<Option<Coverage>> {
    let points: Vec<Vec<Point3<f64>>> = capture.states.iter().map(|frames| sampled_points(frames)).collect();
    let all: Vec<&Point3<f64>> = points.iter().flatten().collect();
    let Some(middle) = median_point(&all) else { return vec![None; points.len()] };
    // The cameras of state 0 define the front.
    let front = capture.states[0]
        .iter()
        .map(|f| (f.world_from_camera.translation.vector - middle.coords).xy())
        .fold(nalgebra::Vector2::zeros(), |sum, v| sum + v);
    let front_rad = front.y.atan2(front.x);
    capture
        .states
        .iter()
        .zip(&points)
        .map(|(frames, points)| of_state(frames, points, &middle, front_rad, &capture.noise))
        .collect()
}

fn of_state(
    frames: &[RgbdFrame],
    points: &[Point3<f64>],
    middle: &Point3<f64>,
    front_rad: f64,
    noise: &NoiseConfig,
) -> Option<Coverage> {
    let depth_m = median_over_object(frames.iter(), |f, i| f64::from(f.depth_m[i]))?;
    let object = frames.iter().flat_map(|f| sampled_object_pixels(f).map(|p| f.depth_m[p] == 0.0));
    let mut shown = 0_usize;
    let mut lost = 0_usize;
    for is_lost in object {
        shown += 1;
        lost += usize::from(is_lost);
    }
    let unread = lost as f64 / shown.max(1) as f64;
    let eyes: Vec<[f64; 3]> = frames.iter().map(|f| eye_of_view(f, middle, front_rad)).collect();
    let mut by_sector = [0; SECTORS.len()];
    for [azimuth_rad, ..] in &eyes {
        let sector = (azimuth_rad / TAU * SECTORS.len() as f64).round() as usize;
        by_sector[sector % SECTORS.len()] += 1;
    }
    let seen_by: Vec<f64> = points
        .par_iter()
        .map(|point| frames.iter().filter(|f| reads_surface(f, point, noise)).count() as f64)
        .collect();
    Some(Coverage {
        by_sector,
        seen_by: median(seen_by).unwrap_or(0.0),
        depth_m,
        sigma_m: noise.sigma_m(depth_m),
        unread,
        cut: frames.iter().filter(|f| is_cut(f)).count() as f64 / frames.len() as f64,
        eyes,
    })
}

/// Azimuth from the front and elevation of a camera about the object's center, radians, and its distance,
/// meters.
fn eye_of_view(frame: &RgbdFrame, middle: &Point3<f64>, front_rad: f64) -> [f64; 3] {
    let out: Vector3<f64> = frame.world_from_camera.translation.vector - middle.coords;
    // Counterclockwise is to the right of a viewer in front of the object.
    [(out.y.atan2(out.x) - front_rad).rem_euclid(TAU), out.z.atan2(out.xy().norm()), out.norm()]
}

/// Sampled pixels of a frame on the object.
fn sampled_object_pixels(frame: &RgbdFrame) -> impl Iterator<Item = usize> {
    (0..frame.depth_m.len()).step_by(STRIDE).filter(|p| frame.is_object(*p))
}

/// Sampled points on the object's surface, evenly from all frames.
fn sampled_points(frames: &[RgbdFrame]) -> Vec<Point3<f64>> {
    let all: Vec<Point3<f64>> =
        frames.iter().flat_map(|f| sampled_object_pixels(f).filter_map(|p| f.world_point(p))).collect();
    let every = all.len().div_ceil(POINTS).max(1);
    all.into_iter().step_by(every).collect()
}

fn median_point(points: &[&Point3<f64>]) -> Option<Point3<f64>> {
    let mut middle = Point3::origin();
    for k in 0..3 {
        middle[k] = median(points.iter().map(|p| p[k]).collect())?;
    }
    Some(middle)
}

/// Whether a frame has a reading of the surface at a point.
fn reads_surface(frame: &RgbdFrame, point: &Point3<f64>, noise: &NoiseConfig) -> bool {
    let k = &frame.intrinsics;
    let seen = frame.in_camera(point);
    let Some((u, v)) = k.project(&seen) else { return false };
    let u = u.round();
    let v = v.round();
    if u < 0.0 || v < 0.0 || u >= k.width as f64 || v >= k.height as f64 {
        return false;
    }
    let read_m = f64::from(frame.depth_m[v as usize * k.width + u as usize]);
    let gate_m = (GATE_SIGMAS * noise.sigma_m(seen.z)).max(GATE_SHARE * seen.z);
    read_m > 0.0 && (read_m - seen.z).abs() <= gate_m
}

/// Whether the image border cuts the object: it covers [`CUT_SHARE`] of a side.
fn is_cut(frame: &RgbdFrame) -> bool {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let sides: [Vec<usize>; 4] = [
        (0..width).collect(),
        (0..width).map(|x| (height - 1) * width + x).collect(),
        (0..height).map(|y| y * width).collect(),
        (0..height).map(|y| y * width + width - 1).collect(),
    ];
    sides.iter().any(|side| {
        let on_object = side.iter().filter(|p| frame.is_object(**p)).count();
        on_object as f64 / side.len().max(1) as f64 > CUT_SHARE
    })
}

/// Share of an image side that an object covers if the side cuts it.
/// chosen: as for a leg of a twentieth of the image width
const CUT_SHARE: f64 = 0.05;
/// Fewest views for surfaces without holes.
/// measured: docs/figures.md, curves over the number of views
const FEW_VIEWS: usize = 10;
/// Fewest sectors with views.
/// derived: enough to see two faces of a box at a right angle
const FEW_SECTORS: usize = 3;
/// Largest standard deviation of a reading at which motions of millimeters show, meters.
/// chosen: a third of the smallest motion that was resolved, 3 mm, over some ten views
const COARSE_M: f64 = 0.004;
/// Share of the object's pixels without depth above which parts may be missing.
/// measured: shared/bags/handheld, where dark synthetic objects lose two thirds
const MUCH_UNREAD: f64 = 0.4;

impl Coverage {
    /// Expected error of a surface, meters: if errors are independent, and if all views share them. Sensor
    /// errors beyond noise (scale, warp, poses) lie between.
    #[must_use]
    pub fn expected_m(&self) -> [f64; 2] {
        [self.sigma_m / self.seen_by.max(1.0).sqrt(), self.sigma_m]
    }

    /// Advice for recording the state again; empty where nothing is wrong.
    #[must_use]
    pub fn advice(&self) -> Vec<String> {
        let mut advice = Vec::new();
        let sectors = self.by_sector.iter().filter(|n| **n > 0).count();
        let views = self.eyes.len();
        if views < FEW_VIEWS {
            advice.push(format!("only {views} views; record 20 or more, a second apart"));
        }
        if sectors < FEW_SECTORS {
            advice.push(format!(
                "seen from {sectors} of 8 directions; walk around the object, a quarter turn at least"
            ));
        }
        if self.sigma_m > COARSE_M {
            advice.push(format!(
                "{:.2} m away, where one reading errs by {:.1} mm; go nearer",
                self.depth_m,
                1e3 * self.sigma_m
            ));
        }
        if self.unread > MUCH_UNREAD {
            advice.push(format!(
                "{:.0} % of the object has no depth; dark, glossy and thin parts want other light, a matt \
                 spray, or a nearer camera",
                100.0 * self.unread
            ));
        }
        if self.cut > 0.5 {
            advice.push(format!(
                "the image's border cuts the object in {:.0} % of the views; step back, or film the rest too",
                100.0 * self.cut
            ));
        }
        advice
    }

    /// Names of the sectors with views, or of those without.
    fn sector_names(&self, with_views: bool) -> String {
        let sectors = SECTORS.iter().zip(self.by_sector).filter(|(_, n)| (*n > 0) == with_views);
        sectors.map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
    }
}

impl fmt::Display for Coverage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let low = self.eyes.iter().map(|e| e[1].to_degrees()).fold(90.0, f64::min);
        let high = self.eyes.iter().map(|e| e[1].to_degrees()).fold(-90.0, f64::max);
        let [best_mm, worst_mm] = self.expected_m().map(|m| 1e3 * m);
        write!(
            f,
            "{} views of the object, {:.2} m away, from {}{}, {low:.0} to {high:.0} deg above; a point is \
             read in {:.0} of them; surfaces to be expected within {best_mm:.1} to {worst_mm:.1} mm",
            self.eyes.len(),
            self.depth_m,
            self.sector_names(true),
            match self.sector_names(false) {
                none if none.is_empty() => String::new(),
                unseen => format!(" (not from {unseen})"),
            },
            self.seen_by
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    /// Views of a plate of 0.2 m that stands on x = 0, from some azimuths, radians.
    fn state(azimuths: &[f64], depth_holes: usize) -> Vec<RgbdFrame> {
        let k = Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5 };
        let frame = |azimuth: &f64| {
            let eye = Point3::new(azimuth.cos(), azimuth.sin(), 0.3);
            let pose = Pose::face_towards(&eye, &Point3::origin(), &-Vector3::z());
            let mut mask = Vec::new();
            let depth_m = (0..k.width * k.height).map(|p| {
                let ray = k.ray_at((p % k.width) as f64, (p / k.width) as f64);
                let across = pose.rotation * ray;
                let depth_m = -eye.x / across.x;
                let at = eye + across * depth_m;
                let is_on = depth_m > 0.0 && at.y.abs() < 0.1 && at.z.abs() < 0.1;
                mask.push(is_on);
                if is_on && p % 4 >= depth_holes { depth_m as f32 } else { 0.0 }
            });
            RgbdFrame {
                id: String::new(),
                stamp_nanos: 0,
                intrinsics: k,
                world_from_camera: pose,
                rgb: vec![[0; 3]; k.width * k.height],
                depth_m: depth_m.collect(),
                mask: Some(mask),
                readings: Vec::new(),
            }
        };
        azimuths.iter().map(frame).collect()
    }

    #[test]
    fn views_are_counted_by_where_they_look_from() {
        let azimuths: Vec<f64> = (-6..=6).map(|i| 0.15 * f64::from(i)).collect();
        let capture = Capture { states: vec![state(&azimuths, 0)], ..Capture::default() };
        let found = coverage(&capture)[0].clone().unwrap();
        // From 52 deg left to 52 deg right: the front and one sector to each side.
        assert_eq!(found.by_sector.iter().sum::<usize>(), 13);
        assert!(found.by_sector[0] >= 5 && found.by_sector[1] >= 2 && found.by_sector[7] >= 2);
        assert_eq!(found.by_sector[2..7], [0; 5]);
        assert!(found.seen_by >= 12.0 && found.unread < 1e-9 && (found.depth_m - 1.04).abs() < 0.05);
        assert!(found.advice().is_empty(), "{:?}", found.advice());
        let text = found.to_string();
        assert!(text.contains("front, front right, front left (not from right"), "{text}");
    }

    #[test]
    fn what_is_wrong_is_said() {
        let capture = Capture { states: vec![state(&[0.0, 0.1], 3), Vec::new()], ..Capture::default() };
        let found = coverage(&capture);
        assert!(found[1].is_none());
        let advice = found[0].as_ref().unwrap().advice().join("; ");
        assert!(advice.contains("only 2 views") && advice.contains("walk around"), "{advice}");
        assert!(advice.contains("has no depth"), "{advice}");
    }
}
