//! Pictures of a report: pixels, arrows over them, and their form in a page.

use std::fmt::Write as _;

use base64::Engine as _;
use image::{ExtendedColorType, ImageEncoder, codecs::jpeg::JpegEncoder, codecs::png::PngEncoder};
use nalgebra::{Point3, Vector3};

use super::number::decimal;
use geometry::{Intrinsics, Pose};
use model::escape_xml as escape;
use model::{ArticulatedModel, Joint, JointKind};

/// Quality of photos, 1 to 100.
const JPEG_QUALITY: u8 = 85;
/// Half length of a drawn axis as a share of the child's longest side. chosen: for the eye
const AXIS_SHARE: f64 = 0.6;
/// Colors of parts in drawings: the static one, then the movable ones in turn.
const PART_COLORS: [[u8; 3]; 7] = [
    [176, 182, 190],
    [46, 123, 214],
    [232, 118, 32],
    [38, 158, 98],
    [176, 66, 148],
    [214, 178, 30],
    [54, 168, 184],
];

/// Color of a part in drawings, sRGB; part 0 is static. Colors repeat beyond the seventh part.
pub fn part_color(part: usize) -> [u8; 3] {
    if part == 0 { PART_COLORS[0] } else { PART_COLORS[1 + (part - 1) % (PART_COLORS.len() - 1)] }
}

/// How a picture is stored in the page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PictureKind {
    /// JPEG.
    #[default]
    Photo,
    /// PNG.
    Drawing,
}

/// An arrow over a picture, pixels (u right, v down).
#[derive(Clone, Debug, PartialEq)]
pub struct Arrow {
    /// Tail.
    pub from: [f64; 2],
    /// Head.
    pub to: [f64; 2],
    /// sRGB color.
    pub color: [u8; 3],
    /// Text beside the head.
    pub label: String,
}

/// A picture with a caption.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `3 * width * height` sRGB bytes, row-major.
    pub rgb: Vec<u8>,
    /// How it is stored.
    pub kind: PictureKind,
    /// A few words below it.
    pub caption: String,
    /// Lines drawn over it.
    pub arrows: Vec<Arrow>,
}

/// A part of a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Window {
    /// The window around the pixels marked in some masks (`width * height`, row-major), with a margin of an
    /// eighth of its size and the aspect ratio of the picture; the whole picture if nothing is marked.
    pub fn around_marks(masks: &[&[bool]], width: usize, height: usize) -> Self {
        let marked = masks
            .iter()
            .flat_map(|m| m.iter().enumerate())
            .filter(|(_, m)| **m)
            .map(|(i, _)| (i % width, i / width));
        let start = (usize::MAX, usize::MAX, 0, 0);
        let (x0, y0, x1, y1) =
            marked.fold(start, |b, (x, y)| (b.0.min(x), b.1.min(y), b.2.max(x), b.3.max(y)));
        if x0 > x1 {
            return Self { x: 0, y: 0, width, height };
        }
        // Share of the picture for both sides of the box and its margin.
        let share =
            (1.25 * ((x1 + 1 - x0) as f64 / width as f64).max((y1 + 1 - y0) as f64 / height as f64)).min(1.0);
        let [shown_width, shown_height] =
            [width, height].map(|all| ((share * all as f64).round() as usize).clamp(1, all));
        Self {
            x: first_of_window(x0, x1, shown_width, width),
            y: first_of_window(y0, y1, shown_height, height),
            width: shown_width,
            height: shown_height,
        }
    }
}

/// First column or row of a window of `size` around the midpoint of two columns or rows, inside the picture.
fn first_of_window(first: usize, last: usize, size: usize, picture_size: usize) -> usize {
    let middle = (first + last) / 2;
    middle.saturating_sub(size / 2).min(picture_size - size)
}

/// Why a picture cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The number of bytes does not fit the size.
    #[error("picture '{caption}' has {bytes} bytes for {width} x {height} pixels")]
    Size {
        /// Its caption.
        caption: String,
        /// Bytes it has.
        bytes: usize,
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The encoder refused.
    #[error("picture '{caption}': {source}")]
    Encode {
        /// Its caption.
        caption: String,
        /// The encoder's error.
        source: image::ImageError,
    },
}

impl Picture {
    /// The part of the picture inside a window, with its arrows. The window is clipped to the picture.
    #[must_use]
    pub fn cropped_to(&self, window: &Window) -> Self {
        let x = window.x.min(self.width);
        let y = window.y.min(self.height);
        let width = window.width.min(self.width - x);
        let height = window.height.min(self.height - y);
        let mut rgb = Vec::new();
        for v in y..y + height {
            let start = v * self.width + x;
            rgb.extend_from_slice(self.rgb.get(3 * start..3 * (start + width)).unwrap_or_default());
        }
        let shift = |[u, v]: [f64; 2]| [u - x as f64, v - y as f64];
        let arrows =
            self.arrows.iter().map(|a| Arrow { from: shift(a.from), to: shift(a.to), ..a.clone() }).collect();
        Self { width, height, rgb, arrows, kind: self.kind, caption: self.caption.clone() }
    }

    /// The picture as a `<figure>` with the image inside it as base64 and its arrows as SVG.
    ///
    /// # Errors
    /// The number of bytes does not fit the size, or the encoder refuses the size.
    pub fn figure_html(&self) -> Result<String, PictureError> {
        let caption = escape(&self.caption);
        let data = self.data_uri()?;
        let w = self.width;
        let h = self.height;
        let mut html = format!(
            "<figure><div class=\"frame\"><img src=\"{data}\" width=\"{w}\" height=\"{h}\" alt=\"{caption}\">"
        );
        if !self.arrows.is_empty() {
            html.push_str(&arrows_svg(&self.arrows, w, h));
        }
        // Writing to a string cannot fail.
        write!(html, "</div><figcaption>{caption}</figcaption></figure>").ok();
        Ok(html)
    }

    fn data_uri(&self) -> Result<String, PictureError> {
        // Encoders take sides of 32 bits, and none of 0.
        let fit = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
        let bytes = self.width.checked_mul(self.height).and_then(|n| n.checked_mul(3));
        let (Some(width), Some(height), true) =
            (fit(self.width), fit(self.height), bytes == Some(self.rgb.len()))
        else {
            let Self { width, height, .. } = *self;
            return Err(PictureError::Size {
                caption: self.caption.clone(),
                bytes: self.rgb.len(),
                width,
                height,
            });
        };
        let mut out = Vec::new();
        let (kind, result) = match self.kind {
            PictureKind::Photo => {
                let encoder = JpegEncoder::new_with_quality(&mut out, JPEG_QUALITY);
                ("jpeg", encoder.write_image(&self.rgb, width, height, ExtendedColorType::Rgb8))
            }
            PictureKind::Drawing => (
                "png",
                PngEncoder::new(&mut out).write_image(&self.rgb, width, height, ExtendedColorType::Rgb8),
            ),
        };
        result.map_err(|source| PictureError::Encode { caption: self.caption.clone(), source })?;
        Ok(format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(out)))
    }
}

/// A PNG of the pixels for whose index `shown` is true, with the others transparent; empty if size and pixels
/// disagree.
pub fn cutout_png(rgb: &[[u8; 3]], width: usize, height: usize, shown: impl Fn(usize) -> bool) -> Vec<u8> {
    let mut rgba = Vec::with_capacity(4 * rgb.len());
    for (i, [r, g, b]) in rgb.iter().enumerate() {
        rgba.extend(if shown(i) { [*r, *g, *b, 255] } else { [0; 4] });
    }
    let mut bytes = Vec::new();
    // Writing to memory fails only if size and pixels disagree.
    PngEncoder::new(&mut bytes)
        .write_image(&rgba, width as u32, height as u32, ExtendedColorType::Rgba8)
        .ok();
    bytes
}

/// Arrows with a white rim, visible on any background; labels are beside the heads.
fn arrows_svg(arrows: &[Arrow], width: usize, height: usize) -> String {
    // Widths and fonts below are for a picture of 640 pixels.
    let size = width.max(height) as f64 / 640.0;
    let mut out = format!("<svg viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">");
    for arrow in arrows {
        let [[x0, y0], [x1, y1]] = [arrow.from, arrow.to];
        let along = Vector3::new(x1 - x0, y1 - y0, 0.0).try_normalize(1e-9).unwrap_or_else(Vector3::x)
            * (22.0 * size);
        let head = |side: f64| [x1 - along.x + side * 0.45 * along.y, y1 - along.y - side * 0.45 * along.x];
        let [ax, ay] = head(1.0);
        let [bx, by] = head(-1.0);
        let path = [x0, y0, x1, y1, ax, ay, x1, y1, bx, by].map(|v| decimal(v, 1));
        let [x0, y0, x1, y1, ax, ay, _, _, bx, by] = &path;
        let path = format!("M{x0} {y0}L{x1} {y1}M{ax} {ay}L{x1} {y1}L{bx} {by}");
        // Darker than the part to which it belongs.
        let [r, g, b] = arrow.color.map(|c| (0.6 * f64::from(c)) as u8);
        for (color, stroke) in [("#fff".to_owned(), 9.0), (format!("rgb({r} {g} {b})"), 4.5)] {
            let stroke = decimal(stroke * size, 2);
            write!(
                out,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{stroke}\" \
                 stroke-linecap=\"round\" stroke-linejoin=\"round\"/>"
            )
            .ok();
        }
        // The label stays inside the picture: to the left of a head in the right third.
        let right = arrow.to[0] > 0.66 * width as f64;
        let (anchor, shift) = if right { ("end", -12.0) } else { ("start", 12.0) };
        let left = arrow.to[0] + shift * size;
        let x = decimal(left, 1);
        let y = decimal((arrow.to[1] - 4.0 * size).min(height as f64 - 8.0 * size).max(30.0 * size), 1);
        let font = decimal(29.0 * size, 1);
        let rim = decimal(7.0 * size, 1);
        // A long name is condensed: letters are about 0.62 of the font size wide.
        let room = if right { left } else { width as f64 - left };
        let is_long = 0.62 * 29.0 * size * arrow.label.chars().count() as f64 > room;
        let fit = if is_long {
            format!("textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\" ", decimal(0.98 * room, 1))
        } else {
            String::new()
        };
        write!(
            out,
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" font-size=\"{font}\" \
             {fit}stroke-width=\"{rim}\" fill=\"rgb({r} {g} {b})\">{}</text>",
            escape(&arrow.label)
        )
        .ok();
    }
    out.push_str("</svg>");
    out
}

/// Arrows along the joint axes of a model in a state (`axis_line`), as a camera sees them. An axis with an
/// end behind the camera is left out; axes are drawn even if something hides them.
pub fn axis_arrows(
    model: &ArticulatedModel,
    state: usize,
    intrinsics: &Intrinsics,
    world_from_camera: &Pose,
) -> Vec<Arrow> {
    let Some(positions) = model.states.get(state) else { return Vec::new() };
    let mut arrows = Vec::new();
    for joint in &model.joints {
        let Some(line) = axis_line(model, joint) else { continue };
        let world_from_link = model.world_from_link(joint.child, positions);
        let pixels = line
            .map(|p| intrinsics.project(&world_from_camera.inverse_transform_point(&(world_from_link * p))));
        if let [Some(from), Some(to)] = pixels {
            let color = part_color(joint.child);
            arrows.push(Arrow { from: from.into(), to: to.into(), color, label: joint.name.clone() });
        }
    }
    arrows
}

/// The ends of the drawn axis of a joint, in the frame of its child: centered on the part or, for a slide,
/// from the center towards rising positions; `None` for a part without surface.
pub(crate) fn axis_line(model: &ArticulatedModel, joint: &Joint) -> Option<[Point3<f64>; 2]> {
    let (lower, upper) = model.links[joint.child].visual.bounds()?;
    let middle = nalgebra::center(&lower.cast::<f64>(), &upper.cast::<f64>());
    let half = joint.axis.into_inner() * (AXIS_SHARE * f64::from((upper - lower).max()));
    Some(match joint.kind {
        JointKind::Revolute | JointKind::Screw { .. } | JointKind::Free { .. } => {
            // The axis passes through the origin of the link frame; this is its point nearest to the center.
            let on_axis = Point3::from(joint.axis.into_inner() * middle.coords.dot(&joint.axis));
            [on_axis - half, on_axis + half]
        }
        JointKind::Prismatic => [middle, middle + half * 1.5],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::cabinet;

    #[test]
    fn a_figure_holds_its_image_and_arrows() {
        let arrow = Arrow { from: [1.0, 1.0], to: [9.0, 5.0], color: [1, 2, 3], label: "a<b".into() };
        let mut picture = Picture {
            width: 10,
            height: 6,
            rgb: vec![120; 180],
            caption: "x & y".into(),
            arrows: vec![arrow],
            ..Picture::default()
        };
        for (kind, mime) in [(PictureKind::Photo, "image/jpeg"), (PictureKind::Drawing, "image/png")] {
            picture.kind = kind;
            let html = picture.figure_html().unwrap();
            let (_, rest) = html.split_once(&format!("{mime};base64,")).unwrap();
            let bytes =
                base64::engine::general_purpose::STANDARD.decode(rest.split_once('"').unwrap().0).unwrap();
            let image = image::load_from_memory(&bytes).unwrap().to_rgb8();
            assert_eq!((image.dimensions(), image.get_pixel(3, 3).0[0].abs_diff(120) < 3), ((10, 6), true));
            assert!(html.contains("x &amp; y") && html.contains("a&lt;b") && html.contains("M1 1L9 5M"));
        }
        picture.rgb.pop();
        assert!(picture.figure_html().unwrap_err().to_string().contains("179 bytes for 10 x 6"));
        assert!(Picture::default().figure_html().is_err());
    }

    #[test]
    fn a_window_holds_what_is_marked_in_the_same_proportions() {
        let mut mask = vec![false; 80 * 60];
        (mask[20 * 80 + 40], mask[30 * 80 + 44]) = (true, true);
        let window = Window::around_marks(&[&mask, &vec![false; 4800]], 80, 60);
        assert_eq!(window, Window { x: 33, y: 18, width: 18, height: 14 });
        assert_eq!(Window::around_marks(&[&[false; 12]], 4, 3), Window { x: 0, y: 0, width: 4, height: 3 });
        let rgb: Vec<u8> = (0..60 * 80).flat_map(|i| [(i % 80) as u8, (i / 80) as u8, 0]).collect();
        let arrow = Arrow { from: [40.0, 20.0], to: [44.0, 30.0], color: [0; 3], label: String::new() };
        let picture = Picture { width: 80, height: 60, rgb, arrows: vec![arrow], ..Picture::default() };
        let part = picture.cropped_to(&window);
        assert_eq!(
            (part.rgb.len(), &part.rgb[..2], &part.rgb[part.rgb.len() - 3..][..2]),
            (18 * 14 * 3, &[33, 18][..], &[50, 31][..])
        );
        assert_eq!(part.arrows[0].from, [7.0, 2.0]);
        let corner = picture.cropped_to(&Window { x: 70, y: 55, width: 99, height: 99 });
        assert_eq!((corner.width, corner.height, corner.rgb.len()), (10, 5, 150));
    }

    #[test]
    fn axes_are_drawn_where_the_camera_sees_them() {
        let model = cabinet();
        let k = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0 };
        // Three meters in front, looking back along -x, z up.
        let eye = Point3::new(3.0, 0.0, 0.3);
        let world_from_camera = Pose::face_towards(&eye, &Point3::new(0.0, 0.0, 0.3), &-Vector3::z());
        let arrows = axis_arrows(&model, 1, &k, &world_from_camera);
        assert_eq!(arrows.len(), 2);
        let pixel = |p: Point3<f64>| k.project(&world_from_camera.inverse_transform_point(&p)).unwrap();
        // The hinge's line passes through the joint's origin.
        let (u, v) = pixel(model.joints[0].parent_from_joint * Point3::origin());
        let [a, b] = [arrows[0].from, arrows[0].to].map(|[x, y]| Vector3::new(x, y, 0.0));
        let across = (b - a).cross(&(Vector3::new(u, v, 0.0) - a)).norm() / (b - a).norm();
        assert!(across < 1.0, "{across}");
        assert_eq!(axis_arrows(&model, 5, &k, &world_from_camera), []);
        let behind = Pose::face_towards(&eye, &Point3::new(9.0, 0.0, 0.3), &-Vector3::z());
        assert_eq!(axis_arrows(&model, 1, &k, &behind), []);
    }

    #[test]
    fn neighboring_parts_have_different_colors() {
        assert!((0..20).all(|i| part_color(i) != part_color(i + 1)) && part_color(7) != part_color(0));
    }
}
