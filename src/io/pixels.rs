//! Second reading of a bag: only the pixels of the chosen views.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::OnceLock,
};

use rayon::prelude::*;

use super::{
    bag::Bag,
    depth_camera::Camera,
    image_codec::{self as codec, ImageError, Raster},
    mcap_file::RawMessage,
    ros2msg::{CompressedImage, Image, decode},
    views::{View, Views, check_size},
};
use capture::{CaptureConfig, CaptureError, DepthRegistration, RgbdFrame, UndistortMap};
use common::stop::Stop;
use geometry::Intrinsics;

/// A needed message: index of its topic in [`Payloads::topics`], and its number in the topic.
type Key = (usize, usize);

/// Index of the topic of depth.
const DEPTH: usize = 1;

/// A message has more bytes than its image can need.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("the message has {size} bytes; {most} are the limit of an image of {pixels} pixels")]
struct LongMessage {
    size: usize,
    most: usize,
    pixels: usize,
}

/// Payloads of the messages of the chosen views.
struct Payloads {
    /// Topics of color, depth and mask.
    topics: [Option<String>; 3],
    /// Payload, and whether it is a CompressedImage; or why it is not kept.
    found: BTreeMap<Key, Option<Result<(Vec<u8>, bool), LongMessage>>>,
}

/// Largest number of message bytes per pixel of its image: raw images have 4, and no compression needs more
/// ...
const BYTES_PER_PIXEL: usize = 16;
/// ... in addition to these: header, padding, tables.
const BYTES_BESIDE: usize = 1 << 20;
/// An image with more than this many times the pixels of its camera is not decoded.
const MOST_LARGER: usize = 16;

fn most_pixels(camera: &Intrinsics) -> usize {
    MOST_LARGER * camera.width * camera.height
}

/// Number of cameras whose lens maps are shared by all frames; with more cameras, each frame makes its own.
const SHARED_MAPS: usize = 4;

/// What brings the images of a camera to its ideal one (equation 2.3).
pub(super) struct Maps {
    /// Undistortion of color and masks.
    color: Option<UndistortMap>,
    /// Undistortion of depth in the camera of color.
    depth: Option<UndistortMap>,
    /// Where depth has a camera of its own, in place of its undistortion.
    registration: Option<DepthRegistration>,
}

/// Pixels of a view in the order of rows.
pub(super) struct ViewPixels {
    pub rgb: Vec<[u8; 3]>,
    /// Meters; 0: unknown.
    pub depth_m: Vec<f32>,
    pub mask: Option<Vec<bool>>,
}

impl Maps {
    pub(super) fn of_camera(camera: &Camera) -> Self {
        let registration = camera.own_depth.map(|(own, color_from_depth)| {
            DepthRegistration::new(own, &camera.depth, camera.intrinsics, color_from_depth)
        });
        let depth = match registration {
            Some(_) => None,
            None => UndistortMap::new(&camera.intrinsics, &camera.depth),
        };
        Self { color: UndistortMap::new(&camera.intrinsics, &camera.color), depth, registration }
    }

    /// The pixels in the ideal camera of color. Depth and masks take the nearest pixel: a mean across an edge
    /// is an unseen surface.
    pub(super) fn ideal_pixels(&self, mut pixels: ViewPixels) -> ViewPixels {
        if let Some(map) = &self.color {
            pixels.rgb = map.undistorted_color(&pixels.rgb);
            pixels.mask = pixels.mask.map(|m| map.undistorted_nearest(&m, false));
        }
        if let Some(map) = &self.depth {
            pixels.depth_m = map.undistorted_nearest(&pixels.depth_m, 0.0);
        }
        if let Some(registration) = &self.registration {
            pixels.depth_m = registration.registered(&pixels.depth_m);
        }
        pixels
    }
}

/// Frames of the chosen views, and what was lost.
pub struct Decoded {
    /// State and frame, in the order in which views were chosen.
    pub frames: Vec<(usize, RgbdFrame)>,
    /// Sentences about views with broken pixels.
    pub lost: Vec<String>,
}

/// Frames of the chosen views: state and index into `views.views`.
///
/// # Errors
/// [`CaptureError::Encoding`] and [`CaptureError::ImageSize`], which hold for the whole recording; those of
/// [`Bag::read`].
pub fn decode_views(
    bag: &Bag,
    views: &Views,
    chosen: &[(usize, usize)],
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<Decoded, CaptureError> {
    let payloads = Payloads::read(bag, views, chosen, stop)?;
    // Most recordings have one camera. One that focuses has a lens for each frame, and maps for all would
    // fill memory.
    let used: BTreeSet<usize> = chosen.iter().map(|(_, v)| views.views[*v].camera).collect();
    let shared: BTreeMap<usize, OnceLock<Maps>> =
        used.into_iter().take(SHARED_MAPS).map(|c| (c, OnceLock::new())).collect();
    // In parallel, but gathered in the order of the choice.
    let decoded: Vec<Result<RgbdFrame, FrameError>> = chosen
        .par_iter()
        .map(|(_, v)| {
            stop.check().map_err(CaptureError::from)?;
            let view = &views.views[*v];
            let own = OnceLock::new();
            let maps = shared.get(&view.camera).unwrap_or(&own);
            Decoder { views, payloads: &payloads, maps, config }.frame(view)
        })
        .collect();
    let mut frames = Vec::new();
    let mut lost = Vec::new();
    for ((state, _), frame) in chosen.iter().zip(decoded) {
        match frame {
            Ok(frame) => frames.push((*state, frame)),
            // It affects all frames: a list of lost ones would hide the common cause.
            Err(FrameError::Recording(error)) => return Err(error),
            Err(FrameError::Frame(why)) => lost.push(why),
        }
    }
    Ok(Decoded { frames, lost })
}

enum FrameError {
    /// An error that affects every frame.
    Recording(CaptureError),
    /// This frame is broken.
    Frame(String),
}

impl From<CaptureError> for FrameError {
    fn from(error: CaptureError) -> Self {
        Self::Recording(error)
    }
}

impl Payloads {
    fn read(bag: &Bag, views: &Views, chosen: &[(usize, usize)], stop: &Stop) -> Result<Self, CaptureError> {
        let t = &views.topics;
        let topics = [Some(t.color.clone()), Some(t.depth.clone()), t.mask.clone()];
        // The needed messages, by topic and ordinal: all others pass by without a copy.
        let keys = chosen
            .iter()
            .map(|(_, v)| &views.views[*v])
            .flat_map(|v| [Some((0, v.color)), Some((DEPTH, v.depth)), v.mask.map(|m| (2, m))]);
        let mut found: BTreeMap<Key, _> = keys.flatten().map(|k| (k, None)).collect();
        let mut counts = [0; 3];
        let pixels = views.cameras.first().map_or(0, |c| {
            [&c.intrinsics, c.of_depth()].map(|k| k.width * k.height).into_iter().fold(0, usize::max)
        });
        let most = BYTES_BESIDE + BYTES_PER_PIXEL * pixels;
        // Messages are counted as the index counted them: each of the topic, whatever its content.
        bag.read(&mut |message: &RawMessage| {
            stop.check()?;
            for (place, topic) in topics.iter().enumerate() {
                if topic.as_deref() == Some(message.topic) {
                    if let Some(slot) = found.get_mut(&(place, counts[place])) {
                        let size = message.data.len();
                        *slot = Some(match size <= most {
                            true => {
                                Ok((message.data.to_vec(), message.type_name.ends_with("CompressedImage")))
                            }
                            false => Err(LongMessage { size, most, pixels }),
                        });
                    }
                    counts[place] += 1;
                }
            }
            Ok(())
        })?;
        Ok(Self { topics, found })
    }
}

struct Decoder<'a> {
    views: &'a Views,
    payloads: &'a Payloads,
    /// Made once an image has the size that its camera states.
    maps: &'a OnceLock<Maps>,
    config: &'a CaptureConfig,
}

impl Decoder<'_> {
    fn frame(&self, view: &View) -> Result<RgbdFrame, FrameError> {
        let intrinsics = self.views.cameras[view.camera].intrinsics;
        let rgb = self.pixels(view, (0, view.color), codec::raw_color, codec::compressed_color)?.pixels;
        let depth_m =
            self.pixels(view, (DEPTH, view.depth), codec::raw_depth, codec::compressed_depth)?.pixels;
        let mask = match view.mask {
            Some(m) => Some(self.pixels(view, (2, m), codec::raw_mask, codec::compressed_mask)?.pixels),
            None => None,
        };
        let maps = self.maps.get_or_init(|| Maps::of_camera(&self.views.cameras[view.camera]));
        let ViewPixels { rgb, mut depth_m, mask } = maps.ideal_pixels(ViewPixels { rgb, depth_m, mask });
        scale_depth(&mut depth_m, self.views.depth_factor);
        limit_depth(&mut depth_m, self.config);
        Ok(RgbdFrame {
            id: String::new(),
            stamp_nanos: view.stamp_nanos,
            intrinsics,
            // A camera that is yet to be tracked is at the origin.
            world_from_camera: view.world_from_camera.unwrap_or_default(),
            rgb,
            depth_m,
            mask,
            readings: Vec::new(),
        })
    }

    fn pixels<T>(
        &self,
        view: &View,
        key: Key,
        raw: fn(&Image) -> Result<Raster<T>, ImageError>,
        compressed: fn(&CompressedImage) -> Result<Raster<T>, ImageError>,
    ) -> Result<Raster<T>, FrameError> {
        let topic = self.payloads.topics[key.0].as_deref().unwrap_or_default();
        let seconds = capture::stamp_secs(view.stamp_nanos);
        let broken = |why: String| FrameError::Frame(format!("{topic} at {seconds:.6} s: {why}"));
        let (data, is_compressed) = match self.payloads.found.get(&key) {
            Some(Some(Ok(payload))) => payload,
            Some(Some(Err(why))) => return Err(broken(why.to_string())),
            _ => return Err(broken("the message is gone".into())),
        };
        let camera = &self.views.cameras[view.camera];
        let camera = if key.0 == DEPTH { camera.of_depth() } else { &camera.intrinsics };
        let decoded = match is_compressed {
            true => {
                let image = decode(data).map_err(|e| broken(e.to_string()))?;
                // Checked by the size stated in the file: a small file can state an image that fills memory.
                if let Some((w, h)) =
                    codec::compressed_size(&image).filter(|(w, h)| w.saturating_mul(*h) > most_pixels(camera))
                {
                    return Err(broken(format!(
                        "an image of {w}x{h} pixels, but its camera has {}x{}",
                        camera.width, camera.height
                    )));
                }
                compressed(&image)
            }
            false => raw(&decode(data).map_err(|e| broken(e.to_string()))?),
        };
        match decoded {
            Ok(raster) => {
                check_size(topic, (raster.width, raster.height), view.stamp_nanos, camera)?;
                Ok(raster)
            }
            Err(ImageError::Broken(why)) => Err(broken(why)),
            Err(ImageError::Encoding { encoding, supported }) => {
                Err(CaptureError::Encoding { topic: topic.to_owned(), encoding, supported }.into())
            }
        }
    }
}

/// Multiplies depth by the ratio of its unit to that in which it was decoded.
pub(super) fn scale_depth(depth_m: &mut [f32], factor: f64) {
    let factor = factor as f32;
    if factor != 1.0 {
        depth_m.iter_mut().for_each(|d| *d *= factor);
    }
}

/// Sets depth outside the range of the settings to unknown.
pub fn limit_depth(depth_m: &mut [f32], config: &CaptureConfig) {
    let range = config.depth_min_m as f32..=config.depth_max_m as f32;
    for d in depth_m.iter_mut().filter(|d| !range.contains(*d)) {
        *d = 0.0;
    }
}
