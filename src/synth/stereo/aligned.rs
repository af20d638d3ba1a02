//! Depth aligned to the color camera, as the driver of a D435 does (librealsense, `align`).

use super::StereoRig;
use geometry::Intrinsics;
use nalgebra::Point3;

/// Depth in millimeters at the pixels of the color camera, row-major, 0 = none, from disparities of the left
/// imager. Each pixel of depth covers the color pixels between its projected corners; the nearest depth
/// counts.
pub(super) fn aligned_depth_mm(disparity: &[f32], rig: &StereoRig, color: &Intrinsics) -> Vec<u16> {
    let k = &rig.intrinsics;
    let mut depth_mm = vec![0; color.width * color.height];
    for (i, d) in disparity.iter().enumerate() {
        // Before rounding to millimeters, disparities near 0 and NAN fail here.
        let mm = (1000.0 * rig.depth_of_disparity(f64::from(*d))).round();
        if !(mm > 0.0 && mm < f64::from(u16::MAX)) {
            continue;
        }
        let at = [(i % k.width) as f64, (i / k.width) as f64];
        let corners = [-0.5, 0.5].map(|half| {
            let point: Point3<f64> = k.unproject(at[0] + half, at[1] + half, 0.001 * mm);
            color.project(&(rig.color_from_left * point))
        });
        let [Some(from), Some(to)] = corners else { continue };
        let columns = pixels_between(from.0, to.0, color.width);
        for y in pixels_between(from.1, to.1, color.height) {
            for nearest in &mut depth_mm[y * color.width..][columns.clone()] {
                if *nearest == 0 || mm as u16 <= *nearest {
                    *nearest = mm as u16;
                }
            }
        }
    }
    depth_mm
}

/// Pixels from one coordinate to another, within an image.
fn pixels_between(from: f64, to: f64, size: usize) -> std::ops::Range<usize> {
    let first = (from + 0.5).floor().max(0.0);
    let end = ((to + 0.5).floor() + 1.0).clamp(0.0, size as f64);
    first.min(end) as usize..end as usize
}
