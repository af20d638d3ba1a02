//! Draws lines and arrows, such as joint axes, into a rendered image.

use nalgebra::{Point3, Vector3};

use super::Rendered;

/// Nothing nearer than this is drawn, meters. chosen: no object is so near
const NEAR_M: f64 = 0.01;
/// Length of an arrow's head as a share of the arrow's length, and half the head's width as a share of the
/// head's length. chosen: for the eye
const HEAD_LENGTH: f64 = 0.12;
const HEAD_HALF_WIDTH: f64 = 0.35;
/// Share of the line's color in a hidden stretch. chosen: for the eye
const HIDDEN_SHARE: f32 = 0.35;

/// How a surface in front of a line affects it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Not at all: the line is on top.
    Ignore,
    /// The line shows through, faded.
    Fade,
    /// The line is hidden.
    Hide,
}

/// Style of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineStyle {
    /// sRGB.
    pub color: [u8; 3],
    /// Width in pixels.
    pub width_px: f64,
    /// How surfaces in front of the line affect it.
    pub occlusion: Occlusion,
}

impl Rendered {
    /// Draws the straight line between two points of the world.
    pub fn draw_line(&mut self, from: &Point3<f64>, to: &Point3<f64>, style: &LineStyle) {
        let camera = self.world_from_camera;
        let mut a = camera.inverse_transform_point(from);
        let mut b = camera.inverse_transform_point(to);
        if a.z > b.z {
            // After the swap, only the first end can be in front of the near plane.
            std::mem::swap(&mut a, &mut b);
        }
        if b.z <= NEAR_M {
            return;
        }
        if a.z < NEAR_M {
            a += (b - a) * ((NEAR_M - a.z) / (b.z - a.z));
        }
        let (Some(p), Some(q)) = (self.intrinsics.project(&a), self.intrinsics.project(&b)) else { return };
        let ends = [
            ImagePoint { u: p.0, v: p.1, inverse_depth: 1.0 / a.z },
            ImagePoint { u: q.0, v: q.1, inverse_depth: 1.0 / b.z },
        ];
        if let Some([p, q]) =
            clipped_line(ends, self.intrinsics.width as f64, self.intrinsics.height as f64, style.width_px)
        {
            self.draw_stroke(p, q, style);
        }
    }

    /// Draws an arrow between two points of the world; its head is at `to` and faces the camera flat.
    pub fn draw_arrow(&mut self, from: &Point3<f64>, to: &Point3<f64>, style: &LineStyle) {
        self.draw_line(from, to, style);
        let along = to - from;
        let view = to - Point3::from(self.world_from_camera.translation.vector);
        let Some(across) = along.cross(&view).try_normalize(1e-12) else { return };
        let head = along * HEAD_LENGTH;
        for side in [-1.0, 1.0] {
            let barb: Vector3<f64> = across * (side * HEAD_HALF_WIDTH * head.norm());
            self.draw_line(&(to - head + barb), to, style);
        }
    }

    /// Draws a stroke between two places of the image.
    fn draw_stroke(&mut self, p: ImagePoint, q: ImagePoint, style: &LineStyle) {
        let width = self.intrinsics.width;
        let height = self.intrinsics.height;
        let radius = 0.5 * style.width_px.max(1.0);
        let du = q.u - p.u;
        let dv = q.v - p.v;
        let length2 = du * du + dv * dv;
        // Each pixel is drawn once: where strokes overlap, a faded line would be mixed in twice.
        for y in pixels_about([p.v, q.v], radius, height) {
            for x in pixels_about([p.u, q.u], radius, width) {
                let u = x as f64 - p.u;
                let v = y as f64 - p.v;
                let share = if length2 > 0.0 { ((u * du + v * dv) / length2).clamp(0.0, 1.0) } else { 0.0 };
                if (u - share * du).hypot(v - share * dv) > radius {
                    continue;
                }
                let i = y * width + x;
                // Inverse depth is linear in the image, depth is not.
                let depth_m = 1.0 / (p.inverse_depth + (q.inverse_depth - p.inverse_depth) * share);
                let surface_m = f64::from(self.depth_m[i]);
                let hidden = style.occlusion != Occlusion::Ignore && surface_m > 0.0 && surface_m < depth_m;
                let keep = match (hidden, style.occlusion) {
                    (true, Occlusion::Hide) => continue,
                    (true, _) => HIDDEN_SHARE,
                    _ => 1.0,
                };
                for k in 0..3 {
                    let old = f32::from(self.rgb[i][k]);
                    let new = f32::from(style.color[k]);
                    self.rgb[i][k] = (old + (new - old) * keep).round() as u8;
                }
            }
        }
    }
}

/// A place in the image.
#[derive(Clone, Copy)]
struct ImagePoint {
    /// Column, pixels.
    u: f64,
    /// Row, pixels.
    v: f64,
    /// One over the depth, 1/m.
    inverse_depth: f64,
}

/// The pixels, among `count`, between two places along an axis, with a margin of `radius`.
fn pixels_about([a, b]: [f64; 2], radius: f64, count: usize) -> std::ops::Range<usize> {
    let low = a.min(b) - radius;
    let high = a.max(b) + radius;
    low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, count as f64) as usize
}

/// The part of a line inside the image and a margin around it (Liang and Barsky 1984); inverse depth is
/// linear along it.
fn clipped_line(ends: [ImagePoint; 2], width: f64, height: f64, margin: f64) -> Option<[ImagePoint; 2]> {
    let [p, q] = ends;
    let mut first = 0.0f64;
    let mut last = 1.0f64;
    for (from, step, limit) in [(p.u, q.u - p.u, width), (p.v, q.v - p.v, height)] {
        for (delta, room) in [(-step, from + margin), (step, limit + margin - from)] {
            if delta == 0.0 && room < 0.0 {
                return None;
            } else if delta < 0.0 {
                first = first.max(room / delta);
            } else if delta > 0.0 {
                last = last.min(room / delta);
            }
        }
    }
    (first <= last).then(|| [p.towards(&q, first), p.towards(&q, last)])
}

impl ImagePoint {
    /// The place at a share of the way to another.
    fn towards(&self, other: &Self, share: f64) -> Self {
        Self {
            u: self.u + (other.u - self.u) * share,
            v: self.v + (other.v - self.v) * share,
            inverse_depth: self.inverse_depth + (other.inverse_depth - self.inverse_depth) * share,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Paint, RenderItem, render, shapes::box_mesh};
    use geometry::{Intrinsics, Pose};

    const K: Intrinsics = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 80.0, cy: 60.0 };
    const RED: [u8; 3] = [255, 0, 0];

    /// A box 0.5 m ahead with a line 1 m ahead behind it, from left to right.
    fn drawn(occlusion: Occlusion) -> Rendered {
        let mesh = box_mesh(Vector3::new(0.1, 0.1, 0.1));
        let item = RenderItem {
            mesh: &mesh,
            world_from_mesh: Pose::translation(0.0, 0.0, 0.6),
            paint: Paint::Vertices,
        };
        let mut image = render(&[item], &K, &Pose::identity(), false);
        let style = LineStyle { color: RED, width_px: 3.0, occlusion };
        image.draw_line(&Point3::new(-0.4, 0.0, 1.0), &Point3::new(0.4, 0.0, 1.0), &style);
        image
    }

    #[test]
    fn surfaces_in_front_hide_fade_or_leave_a_line() {
        let beside = 60 * 160 + 25;
        let behind = 60 * 160 + 80;
        for occlusion in [Occlusion::Ignore, Occlusion::Fade, Occlusion::Hide] {
            let image = drawn(occlusion);
            assert_eq!(image.rgb[beside], RED);
            assert_eq!(image.rgb[beside + 2 * 160], crate::raster::BACKGROUND);
            let expected = match occlusion {
                Occlusion::Ignore => RED,
                Occlusion::Fade => [206, 117, 117],
                Occlusion::Hide => [180; 3],
            };
            assert_eq!(image.rgb[behind], expected);
        }
    }

    #[test]
    fn lines_out_of_view_and_through_the_camera_do_no_harm() {
        let mut image = drawn(Occlusion::Hide);
        let before = image.clone();
        let style = LineStyle { color: RED, width_px: 3.0, occlusion: Occlusion::Ignore };
        image.draw_line(&Point3::new(0.0, 0.0, -1.0), &Point3::new(0.3, 0.0, -0.5), &style);
        image.draw_line(&Point3::new(5.0, 9.0, 1.0), &Point3::new(9.0, 5.0, 1.0), &style);
        assert_eq!(image, before);
        image.draw_arrow(&Point3::new(0.0, 0.1, -1.0), &Point3::new(0.0, 0.0, 2.0), &style);
        assert_eq!(image.rgb[60 * 160 + 80], RED);
        // A line of sight is a point.
        image.draw_arrow(&Point3::new(0.0, 0.0, 1.0), &Point3::new(0.0, 0.0, 2.0), &style);
    }
}
