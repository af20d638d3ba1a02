//! Decoded and validated messages of the subscriptions.

use io::{
    image_codec::{self as codec, ImageError, MAX_SIDE, Raster},
    ros2msg::{
        CameraInfo, CompressedImage, DecodeError, Header, Image, MAX_NAME, PoseStamped, TfMessage,
        definitions::RosMessage, encode, odometry::FullOdometry,
    },
};

/// Largest accepted image message, bytes.
pub(crate) const MAX_IMAGE_BYTES: usize = 64 << 20;
/// Most transforms per message.
const MAX_TRANSFORMS: usize = 10_000;
/// Most distortion coefficients.
const MAX_COEFFICIENTS: usize = 64;

/// A color, depth or mask image as received.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Picture {
    /// `sensor_msgs/msg/Image`.
    Raw(Image),
    /// `sensor_msgs/msg/CompressedImage`.
    Compressed(CompressedImage),
}

/// A message with its role.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Sample {
    /// Color image.
    Color(Picture),
    /// Depth image.
    Depth(Picture),
    /// Object mask.
    Mask(Picture),
    /// Parameters of the color camera.
    ColorInfo(Box<CameraInfo>),
    /// Parameters of the depth camera.
    DepthInfo(Box<CameraInfo>),
    /// `/tf`.
    Transforms(TfMessage),
    /// `/tf_static`.
    StaticTransforms(TfMessage),
    /// Camera pose (PoseStamped).
    Pose(PoseStamped),
    /// Camera pose (Odometry).
    Odometry(Box<FullOdometry>),
}

/// Why a message is rejected, for the counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Refusal {
    /// Missing stamp or frame name.
    Header,
    /// Inconsistent size, row length or amount of data.
    Size,
    /// Numbers that are not finite, or invalid quaternions.
    Value,
}

impl Picture {
    /// Its header.
    #[must_use]
    pub(crate) fn header(&self) -> &Header {
        match self {
            Self::Raw(m) => &m.header,
            Self::Compressed(m) => &m.header,
        }
    }

    /// Its encoding; that of a compressed image begins with the encoding of its pixels.
    #[must_use]
    pub(crate) fn encoding(&self) -> &str {
        match self {
            Self::Raw(m) => &m.encoding,
            Self::Compressed(m) => &m.format,
        }
    }

    /// Its ROS type.
    #[must_use]
    pub(crate) fn type_name(&self) -> &'static str {
        match self {
            Self::Raw(_) => Image::TYPE,
            Self::Compressed(_) => CompressedImage::TYPE,
        }
    }

    /// The payload to write to a bag.
    ///
    /// # Errors
    /// If it cannot be encoded as CDR.
    pub(crate) fn payload(&self) -> Result<Vec<u8>, DecodeError> {
        match self {
            Self::Raw(m) => encode(m),
            Self::Compressed(m) => encode(m),
        }
    }

    /// Size of the pixel data, bytes.
    #[must_use]
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Raw(m) => m.data.len(),
            Self::Compressed(m) => m.data.len(),
        }
    }

    /// Decodes a color image.
    ///
    /// # Errors
    /// [`ImageError`].
    pub(crate) fn color_raster(&self) -> Result<Raster<[u8; 3]>, ImageError> {
        match self {
            Self::Raw(m) => codec::raw_color(m),
            Self::Compressed(m) => codec::compressed_color(m),
        }
    }

    /// Decodes a depth image to meters; 0: unknown.
    ///
    /// # Errors
    /// [`ImageError`].
    pub(crate) fn depth_raster(&self) -> Result<Raster<f32>, ImageError> {
        match self {
            Self::Raw(m) => codec::raw_depth(m),
            Self::Compressed(m) => codec::compressed_depth(m),
        }
    }

    /// Decodes a mask.
    ///
    /// # Errors
    /// [`ImageError`].
    pub(crate) fn mask_raster(&self) -> Result<Raster<bool>, ImageError> {
        match self {
            Self::Raw(m) => codec::raw_mask(m),
            Self::Compressed(m) => codec::compressed_mask(m),
        }
    }

    fn check_size(&self) -> Result<(), Refusal> {
        check_header(self.header())?;
        let (name, sized) = match self {
            Self::Raw(m) => {
                let side = |n: u32| (1..=MAX_SIDE).contains(&(n as usize));
                // CDR only gives the length of `data`; it must match the image size.
                let whole = (m.step as usize).checked_mul(m.height as usize) == Some(m.data.len());
                (&m.encoding, side(m.width) && side(m.height) && whole)
            }
            Self::Compressed(m) => (&m.format, !m.data.is_empty()),
        };
        (sized && self.bytes() <= MAX_IMAGE_BYTES && name.len() <= MAX_NAME)
            .then_some(())
            .ok_or(Refusal::Size)
    }
}

/// Checks that the header has a positive stamp and a frame name.
fn check_header(header: &Header) -> Result<(), Refusal> {
    match header.checked() {
        // Drivers without stamps send 0; all such images would seem simultaneous.
        Some((stamp, frame)) if stamp > 0 && !frame.is_empty() => Ok(()),
        _ => Err(Refusal::Header),
    }
}

impl Sample {
    /// Rejects messages that are unusable in a recording.
    ///
    /// # Errors
    /// The first failed check.
    pub(crate) fn check(&self) -> Result<(), Refusal> {
        match self {
            Self::Color(p) | Self::Depth(p) | Self::Mask(p) => p.check_size(),
            Self::ColorInfo(info) | Self::DepthInfo(info) => check_info(info),
            Self::Transforms(m) | Self::StaticTransforms(m) => match m.transforms.len() {
                // Anyone on the network may send such a list.
                n if n > MAX_TRANSFORMS => Err(Refusal::Size),
                // One invalid transform does not affect the others; the buffer drops it.
                _ if m
                    .transforms
                    .iter()
                    .all(|t| t.header.checked().is_some() && t.transform.checked().is_some()) =>
                {
                    Ok(())
                }
                _ => Err(Refusal::Value),
            },
            Self::Pose(m) => check_header(&m.header).and(m.pose.checked().map(|_| ()).ok_or(Refusal::Value)),
            Self::Odometry(m) => {
                check_header(&m.header)?;
                (m.child_frame_id.len() <= MAX_NAME).then_some(()).ok_or(Refusal::Header)?;
                m.pose.checked().map(|_| ()).ok_or(Refusal::Value)
            }
        }
    }
}

fn check_info(info: &CameraInfo) -> Result<(), Refusal> {
    // No stamp is needed, as the last camera_info applies to all images.
    info.header.checked().ok_or(Refusal::Header)?;
    if info.d.len() > MAX_COEFFICIENTS || info.distortion_model.len() > MAX_NAME {
        return Err(Refusal::Size);
    }
    // A NaN in the lens parameters would affect every pixel.
    let finite = info.d.iter().chain(&info.k).chain(&info.r).chain(&info.p).all(|v| v.is_finite());
    finite.then_some(()).ok_or(Refusal::Value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use io::ros2msg::{Time, Transform, TransformStamped};

    fn header() -> Header {
        Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "cam".into() }
    }

    fn image() -> Image {
        Image {
            header: header(),
            height: 2,
            width: 1,
            encoding: "rgb8".into(),
            is_bigendian: 0,
            step: 3,
            data: vec![0; 6],
        }
    }

    #[test]
    fn images_must_hold_what_they_say() {
        let check = |change: fn(&mut Image)| {
            let mut m = image();
            change(&mut m);
            Sample::Color(Picture::Raw(m)).check()
        };
        assert_eq!(check(|_| {}), Ok(()));
        assert_eq!(check(|m| m.data.truncate(5)), Err(Refusal::Size));
        assert_eq!(check(|m| (m.width, m.step) = (0, 0)), Err(Refusal::Size));
        assert_eq!(check(|m| m.height = u32::MAX), Err(Refusal::Size));
        assert_eq!(check(|m| m.encoding = "x".repeat(300)), Err(Refusal::Size));
        assert_eq!(check(|m| m.header.stamp.sec = -1), Err(Refusal::Header));
        assert_eq!(check(|m| m.header.stamp = Time::default()), Err(Refusal::Header));
        assert_eq!(check(|m| m.header.frame_id.clear()), Err(Refusal::Header));
        let empty = CompressedImage { header: header(), ..CompressedImage::default() };
        assert_eq!(Sample::Depth(Picture::Compressed(empty)).check(), Err(Refusal::Size));
    }

    #[test]
    fn transforms_and_cameras_must_be_finite() {
        let tf = |w: f64| {
            let mut t = TransformStamped {
                header: header(),
                child_frame_id: "a".into(),
                transform: Transform::default(),
            };
            t.transform.rotation.w = w;
            Sample::Transforms(TfMessage { transforms: vec![t] }).check()
        };
        assert_eq!((tf(1.0), tf(0.5), tf(f64::NAN)), (Ok(()), Err(Refusal::Value), Err(Refusal::Value)));
        let info = |k: f64| {
            Sample::ColorInfo(Box::new(CameraInfo { header: header(), k: [k; 9], ..CameraInfo::default() }))
                .check()
        };
        assert_eq!((info(1.0), info(f64::INFINITY)), (Ok(()), Err(Refusal::Value)));
    }
}
