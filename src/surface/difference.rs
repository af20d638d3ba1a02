//! Finds where a camera saw something other than a rendered model shows. See docs/method.md 11.4.

use super::Rendered;
use capture::RgbdFrame;
use geometry::Intrinsics;

/// A reading farther from the model's surface than this is not of it, standard deviations.
///
/// chosen: one of 16 000 readings of a normal distribution
const SIGMAS: f64 = 4.0;

/// How the reading of a pixel compares with a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difference {
    /// There is no reading, or it may be of the surroundings.
    Unread,
    /// It lies on the model's surface.
    Same,
    /// The object is there, and the model is not.
    Lacks,
    /// The model is there, and the camera saw empty space.
    Surplus,
}

/// Compares the readings of a frame with a model rendered for the frame's camera, pixel by pixel; `sigma_m`
/// is the standard deviation of a pixel's reading of a correct surface, meters.
///
/// A reading is compared with all depths of the model within one pixel: edges of object and model fall on the
/// same pixel only by chance, and a slanted surface has many depths in one pixel.
pub fn differences(frame: &RgbdFrame, model: &Rendered, sigma_m: impl Fn(usize) -> f64) -> Vec<Difference> {
    (0..frame.depth_m.len()).map(|i| difference_at(frame, model, &sigma_m, i)).collect()
}

fn difference_at(
    frame: &RgbdFrame,
    model: &Rendered,
    sigma_m: impl Fn(usize) -> f64,
    pixel: usize,
) -> Difference {
    let reading_m = f64::from(frame.depth_m[pixel]);
    if reading_m <= 0.0 {
        return Difference::Unread;
    }
    let around = Around::of_pixel(model, &frame.intrinsics, pixel);
    // Surroundings: most of the pixels.
    if around.is_bare && !frame.is_object(pixel) {
        return Difference::Unread;
    }
    let error_m = SIGMAS * sigma_m(pixel);
    let is_behind = reading_m > around.farthest_m + error_m;
    match (frame.is_object(pixel), around.is_bare) {
        (true, _) if reading_m < around.nearest_m - error_m => Difference::Lacks,
        (_, false) if is_behind => Difference::Surplus,
        // Beside the edge of the model, a reading behind it may be of something past the edge.
        (true, true) if is_behind => Difference::Unread,
        (true, _) => Difference::Same,
        (false, _) => Difference::Unread,
    }
}

/// Depths of a model at a pixel and its neighbors.
struct Around {
    /// Infinite where there is no surface.
    nearest_m: f64,
    /// 0 where there is no surface.
    farthest_m: f64,
    /// Whether at least one of them has no surface.
    is_bare: bool,
}

impl Around {
    fn of_pixel(model: &Rendered, k: &Intrinsics, pixel: usize) -> Self {
        let x = pixel % k.width;
        let y = pixel / k.width;
        let mut found = Self { nearest_m: f64::INFINITY, farthest_m: 0.0, is_bare: false };
        for v in y.saturating_sub(1)..(y + 2).min(k.height) {
            for u in x.saturating_sub(1)..(x + 2).min(k.width) {
                let depth_m = f64::from(model.depth_m[v * k.width + u]);
                if depth_m > 0.0 {
                    found.nearest_m = found.nearest_m.min(depth_m);
                    found.farthest_m = found.farthest_m.max(depth_m);
                } else {
                    found.is_bare = true;
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Paint, RenderItem, TriangleMesh, render, shapes::box_mesh};
    use geometry::Pose;
    use nalgebra::Vector3;

    const K: Intrinsics = Intrinsics { width: 80, height: 60, fx: 100.0, fy: 100.0, cx: 39.5, cy: 29.5 };

    /// A wall 1.5 m ahead, and before it boxes of 0.2 m, which are the object.
    fn seen(boxes: &[Vector3<f64>]) -> Rendered {
        let mesh: TriangleMesh = box_mesh(Vector3::new(0.1, 0.1, 0.1));
        let item = |at: &Vector3<f64>| RenderItem {
            mesh: &mesh,
            world_from_mesh: Pose::translation(at.x, at.y, at.z),
            paint: Paint::Vertices,
        };
        render(&boxes.iter().map(item).collect::<Vec<_>>(), &K, &Pose::identity(), false)
    }

    /// Lacks and surplus of a model where a camera sees one box 1 m ahead, in readings.
    fn found(model: &[Vector3<f64>]) -> [usize; 2] {
        let object = seen(&[Vector3::new(0.0, 0.0, 1.1)]);
        let frame = RgbdFrame {
            id: "0_0000".into(),
            stamp_nanos: 0,
            intrinsics: K,
            world_from_camera: Pose::identity(),
            rgb: object.rgb.clone(),
            depth_m: object.depth_m.iter().map(|d| if *d > 0.0 { *d } else { 1.5 }).collect(),
            mask: Some(object.depth_m.iter().map(|d| *d > 0.0).collect()),
            readings: Vec::new(),
        };
        let all = differences(&frame, &seen(model), |_| 0.003);
        [Difference::Lacks, Difference::Surplus].map(|d| all.iter().filter(|a| **a == d).count())
    }

    #[test]
    fn readings_before_and_through_a_model_are_told_apart() {
        let at = |x: f64, z: f64| Vector3::new(x, 0.0, z);
        let area = 20 * 20;
        assert_eq!(found(&[at(0.0, 1.1)]), [0, 0]);
        // Within four deviations, and within a pixel aside.
        assert_eq!((found(&[at(0.0, 1.111)]), found(&[at(0.01, 1.1)])), ([0, 0], [0, 0]));
        let [lacks, surplus] = found(&[at(0.0, 1.13)]);
        assert!(lacks > area * 8 / 10 && surplus == 0, "{lacks} {surplus}");
        let [lacks, surplus] = found(&[at(0.0, 1.07)]);
        assert!(surplus > area * 8 / 10 && lacks == 0, "{lacks} {surplus}");
        assert_eq!(found(&[]), [area, 0]);
        // Aside by half its width: a half of each.
        let [lacks, surplus] = found(&[at(0.1, 1.1)]);
        assert!(
            [lacks, surplus].iter().all(|n| (area * 3 / 10..area * 6 / 10).contains(n)),
            "{lacks} {surplus}"
        );
    }
}
