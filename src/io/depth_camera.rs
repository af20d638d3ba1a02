//! The camera of the depth images: that of the color images, or one of its own that has to be brought to it.

use super::{
    bag_index::BagIndex,
    camera::pinhole,
    image_codec::MAX_SIDE,
    topics::{TopicChoice, is_aligned_by_name},
};
use capture::{CaptureError, Distortion};
use common::note::{Note, NoteCode};
use geometry::{Intrinsics, Pose};

/// Largest relative difference of focal lengths of aligned images. chosen: drivers round them
const FOCAL_TOLERANCE: f64 = 0.005;
/// Largest difference of principal points of aligned images, pixels. chosen: drivers round them
const CENTER_TOLERANCE_PX: f64 = 1.0;
/// Largest distance between frames of aligned images, meters and radians. chosen: drivers round them
const FRAME_TOLERANCE: f64 = 1e-3;
/// Largest relative difference of the ratios of width and height of images of one field of view.
/// chosen: sizes are whole pixels
const SHAPE_TOLERANCE: f64 = 0.02;

/// A pinhole camera with the distortion of its lenses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The ideal camera of the color images.
    pub intrinsics: Intrinsics,
    /// Distortion of the color images.
    pub color: Distortion,
    /// Distortion of the depth images.
    pub depth: Distortion,
    /// Where depth has a camera of its own: its ideal camera and its pose in the frame of color.
    pub own_depth: Option<(Intrinsics, Pose)>,
}

impl Camera {
    /// The ideal camera of the depth images.
    #[must_use]
    pub fn of_depth(&self) -> &Intrinsics {
        self.own_depth.as_ref().map_or(&self.intrinsics, |(camera, _)| camera)
    }

    /// The note on depth that is brought to color's pixels.
    pub fn registration_note(&self, topic: &str) -> Option<Note> {
        let (camera, color_from_depth) = self.own_depth.as_ref()?;
        let text = format!(
            "{topic}: {}x{} pixels of a camera {:.1} mm and {:.2} deg from color's; depth is brought to \
             color's pixels",
            camera.width,
            camera.height,
            1e3 * color_from_depth.translation.vector.norm(),
            color_from_depth.rotation.angle().to_degrees()
        );
        Some(Note::new(NoteCode::DepthRegistered, text))
    }
}

/// What a recording says about the camera of its depth images.
pub struct DepthSource {
    /// Camera and lens by the camera_info of depth; `None` without one.
    pub own: Option<(Intrinsics, Distortion)>,
    /// Columns and rows of the images, if known.
    pub size: Option<(usize, usize)>,
    /// Pose in the frame of color, by the frames of the images; `None` where no static transform gives it.
    pub color_from_depth: Option<Pose>,
    /// Color and depth topic.
    pub topics: [String; 2],
    /// Frames of color and depth.
    pub frames: [String; 2],
}

impl DepthSource {
    /// The source of the chosen topics. The first camera_info stands for all.
    ///
    /// # Errors
    /// A camera_info of depth that cannot be used.
    pub fn of_topics(topics: &TopicChoice, index: &BagIndex) -> Result<Self, CaptureError> {
        let mut infos =
            topics.depth_info.as_ref().and_then(|n| index.infos.get(n)).cloned().unwrap_or_default();
        infos.settle();
        let own = match (infos.distinct.first(), &topics.depth_info) {
            (Some(info), Some(name)) => Some(pinhole(info, name, &topics.depth)?),
            _ => None,
        };
        let frame = |topic: &str| index.images.get(topic).map_or(String::new(), |i| i.frame.clone());
        let frames = [frame(&topics.color), frame(&topics.depth)];
        let color_from_depth = if frames[0] == frames[1] {
            Some(Pose::identity())
        } else {
            // Stamp 0 and no gap: only a static transform can answer.
            index.tf.lookup(&frames[0], &frames[1], 0, 0).ok()
        };
        let size = index.images.get(&topics.depth).and_then(|i| i.first_size);
        Ok(Self { own, size, color_from_depth, topics: [topics.color.clone(), topics.depth.clone()], frames })
    }

    /// The camera of images whose color has the given camera.
    ///
    /// # Errors
    /// [`CaptureError::NotAligned`] where depth has a camera of its own and nothing says where it stands.
    pub fn camera(&self, intrinsics: Intrinsics, color: Distortion) -> Result<Camera, CaptureError> {
        // Without a camera_info, depth is taken to have color's field of view.
        let (own, lens) = self.own.unwrap_or((intrinsics, color));
        let size = self.size.unwrap_or((own.width, own.height));
        let own = self.resized(own, size)?;
        let scaled = self.resized(intrinsics, size).ok();
        let has_color_matrix = scaled.is_some_and(|expected| is_same_matrix(&expected, &own));
        let color_from_depth = match self.color_from_depth {
            Some(pose) if is_at_rest(&pose) => Pose::identity(),
            Some(pose) => pose,
            // Only depth that was brought to color has its matrix.
            None if has_color_matrix || is_aligned_by_name(&self.topics[1]) => Pose::identity(),
            None => return Err(self.no_transform(&own, &intrinsics)),
        };
        let in_color_frame = color_from_depth == Pose::identity();
        // Depth brought to color has color's lens: drivers give it an info without coefficients.
        let depth = if has_color_matrix && in_color_frame && lens.is_pinhole() { color } else { lens };
        let is_aligned = has_color_matrix && in_color_frame && size == (intrinsics.width, intrinsics.height);
        let own_depth = (!is_aligned).then_some((own, color_from_depth));
        Ok(Camera { intrinsics, color, depth, own_depth })
    }

    /// A camera at another size of the same field of view.
    fn resized(
        &self,
        camera: Intrinsics,
        (width, height): (usize, usize),
    ) -> Result<Intrinsics, CaptureError> {
        if (width, height) == (camera.width, camera.height) {
            return Ok(camera);
        }
        let x = width as f64 / camera.width as f64;
        let y = height as f64 / camera.height as f64;
        let is_possible = (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height);
        if !is_possible || (x / y - 1.0).abs() > SHAPE_TOLERANCE {
            return Err(CaptureError::NotAligned {
                depth: self.topics[1].clone(),
                color: self.topics[0].clone(),
                reason: format!(
                    "its images are {width}x{height}, but the camera_info taken for it has {}x{}",
                    camera.width, camera.height
                ),
                remedy: "record the camera_info beside the depth images, or name it with `--topic \
                         depth_info=TOPIC`"
                    .into(),
            });
        }
        Ok(camera.at_size(width, height))
    }

    fn no_transform(&self, own: &Intrinsics, color: &Intrinsics) -> CaptureError {
        let [color_frame, depth_frame] = &self.frames;
        CaptureError::NotAligned {
            depth: self.topics[1].clone(),
            color: self.topics[0].clone(),
            reason: format!(
                "it has a camera of its own (fx {:.1}, color {:.1}), and no static transform leads from \
                 its frame `{depth_frame}` to color's `{color_frame}`",
                own.fx, color.fx
            ),
            remedy: "record /tf_static, or the aligned depth (realsense2_camera: \
                     `align_depth.enable:=true`, topic aligned_depth_to_color/image_raw; others: \
                      depth_image_proc register)"
                .into(),
        }
    }
}

fn is_same_matrix(a: &Intrinsics, b: &Intrinsics) -> bool {
    let focal = (a.fx / b.fx - 1.0).abs().max((a.fy / b.fy - 1.0).abs());
    let center = (a.cx - b.cx).abs().max((a.cy - b.cy).abs());
    focal <= FOCAL_TOLERANCE && center <= CENTER_TOLERANCE_PX
}

fn is_at_rest(pose: &Pose) -> bool {
    pose.translation.vector.norm() <= FRAME_TOLERANCE && pose.rotation.angle() <= FRAME_TOLERANCE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color() -> Intrinsics {
        Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 319.5, cy: 239.5 }
    }

    fn source(own: Option<(Intrinsics, Distortion)>, pose: Option<Pose>) -> DepthSource {
        let size = own.map(|(camera, _)| (camera.width, camera.height));
        let topics = ["/c".to_owned(), "/d".to_owned()];
        DepthSource { own, size, color_from_depth: pose, topics: topics.clone(), frames: topics }
    }

    #[test]
    fn a_small_depth_of_the_same_view_is_color_scaled() {
        let small = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };
        let told = source(Some((small, Distortion::default())), Some(Pose::identity()));
        let camera = told.camera(color(), Distortion::default()).unwrap();
        assert_eq!(camera.own_depth, Some((small, Pose::identity())));
        // The same where only the images say how large they are.
        let mut untold = source(None, Some(Pose::identity()));
        untold.size = Some((160, 120));
        assert_eq!(untold.camera(color(), Distortion::default()).unwrap().own_depth, camera.own_depth);
        untold.size = Some((160, 160));
        assert!(untold.camera(color(), Distortion::default()).is_err());
    }

    #[test]
    fn aligned_depth_has_the_lens_of_color_and_depth_of_its_own_frame_needs_a_transform() {
        let lens = Distortion { radial: [0.1, 0.0, 0.0], ..Distortion::default() };
        let aligned = source(Some((color(), Distortion::default())), Some(Pose::identity()));
        let camera = aligned.camera(color(), lens).unwrap();
        assert!(camera.own_depth.is_none() && camera.depth == lens);
        let own = Intrinsics { fx: 400.0, fy: 400.0, ..color() };
        let beside = Pose::translation(0.015, 0.0, 0.0);
        let camera = source(Some((own, Distortion::default())), Some(beside)).camera(color(), lens).unwrap();
        assert!(camera.own_depth == Some((own, beside)) && camera.depth.is_pinhole());
        let text =
            source(Some((own, Distortion::default())), None).camera(color(), lens).unwrap_err().to_string();
        assert!(text.contains("/tf_static"), "{text}");
    }
}
