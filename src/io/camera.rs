//! Camera parameters out of `sensor_msgs/CameraInfo`.

use super::{image_codec::MAX_SIDE, ros2msg::CameraInfo};
use capture::{CaptureError, Distortion};
use geometry::Intrinsics;

/// The pinhole camera and the lens distortion of a camera_info. If the topic has a rectified image's name,
/// there is no distortion left, and the camera matrix is that of `P`.
///
/// # Errors
/// [`CaptureError::CameraInfo`] and [`CaptureError::Distortion`].
pub fn pinhole(
    info: &CameraInfo,
    info_topic: &str,
    image_topic: &str,
) -> Result<(Intrinsics, Distortion), CaptureError> {
    let refuse = |reason: String| Err(CaptureError::CameraInfo { topic: info_topic.to_owned(), reason });
    let width = info.width as usize;
    let height = info.height as usize;
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return refuse(format!("it says {width}x{height} pixels"));
    }
    // `K` and `P` are those of the full image; binning and regions would change them.
    if info.binning_x > 1 || info.binning_y > 1 {
        return refuse(format!("binning {}x{} is not supported", info.binning_x, info.binning_y));
    }
    let roi = &info.roi;
    let whole = (roi.width == 0 || roi.width == info.width) && (roi.height == 0 || roi.height == info.height);
    if !whole || roi.x_offset > 0 || roi.y_offset > 0 {
        return refuse("a region of interest is not supported".into());
    }
    // Not always the last part: `.../image_rect/compressed`.
    let name = image_topic.rsplit('/').find(|part| part.contains("image")).unwrap_or(image_topic);
    // An uncalibrated camera has zeros in `P`.
    let rectified = name.contains("rect") && info.p[0] > 0.0;
    let [fx, fy, cx, cy] =
        if rectified { [0, 5, 2, 6].map(|k| info.p[k]) } else { [0, 4, 2, 5].map(|k| info.k[k]) };
    let skew = if rectified { info.p[1] } else { info.k[1] };
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy };
    // Negated comparisons also catch NaN.
    if !(fx > 0.0 && fy > 0.0 && fx < 1e6 && fy < 1e6) {
        return refuse(format!("focal lengths {fx} and {fy} (an uncalibrated camera has 0)"));
    }
    if !(cx.abs() < 1e6 && cy.abs() < 1e6 && skew.abs() < 1e-6) {
        return refuse(format!("principal point {cx}, {cy}, skew {skew}"));
    }
    if rectified {
        return Ok((intrinsics, Distortion::default()));
    }
    Distortion::from_info(&info.distortion_model, &info.d).map(|lens| (intrinsics, lens)).map_err(|fault| {
        CaptureError::Distortion {
            topic: info_topic.to_owned(),
            model: info.distortion_model.escape_debug().to_string(),
            problem: fault.to_string(),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info() -> CameraInfo {
        CameraInfo {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            d: vec![0.1, 0.0, 0.0, 0.0, 0.0],
            k: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0],
            p: [480.0, 0.0, 310.0, 0.0, 0.0, 481.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraInfo::default()
        }
    }

    #[test]
    fn raw_images_have_k_and_a_lens_rectified_ones_p_and_none() {
        let (camera, lens) = pinhole(&info(), "/info", "/camera/color/image_raw/compressed").unwrap();
        assert_eq!((camera.fx, camera.cy, lens.radial[0]), (500.0, 240.0, 0.1));
        let (camera, lens) = pinhole(&info(), "/info", "/camera/color/image_rect_color").unwrap();
        assert!(camera.fx == 480.0 && camera.cy == 230.0 && lens.is_pinhole());
    }

    #[test]
    fn what_is_no_calibrated_whole_image_is_refused() {
        let refused = |change: fn(&mut CameraInfo)| {
            let mut i = info();
            change(&mut i);
            matches!(pinhole(&i, "/info", "/image_raw"), Err(CaptureError::CameraInfo { .. }))
        };
        assert!(refused(|i| i.k[0] = 0.0));
        assert!(refused(|i| i.k[4] = f64::NAN));
        assert!(refused(|i| i.k[2] = f64::INFINITY));
        assert!(refused(|i| i.width = 0));
        assert!(refused(|i| i.height = 20_000));
        assert!(refused(|i| i.binning_x = 2));
        assert!(refused(|i| i.roi.x_offset = 8));
    }
}
