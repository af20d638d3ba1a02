//! A picture mapped onto a mesh.

use nalgebra::{Vector2, Vector3};

use geometry::bilinear;

/// A square picture and the places of a mesh's vertices in it.
#[derive(Clone, Copy)]
pub struct Texture<'a> {
    /// Place of every vertex in `[0, 1]`, v up.
    pub uv: &'a [[f64; 2]],
    /// Side, pixels.
    pub size_px: usize,
    /// `size_px * size_px` sRGB pixels, row by row from the top.
    pub pixels: &'a [[u8; 3]],
}

impl Texture<'_> {
    /// Place of a vertex, pixels from the center of the upper left one.
    pub(super) fn place_px(&self, vertex: usize) -> Vector2<f32> {
        let [u, v] = self.uv[vertex];
        let size = self.size_px as f64;
        Vector2::new((u * size - 0.5) as f32, ((1.0 - v) * size - 0.5) as f32)
    }

    /// Color at a place, interpolated between four pixels, levels.
    pub(super) fn color_at(&self, place_px: Vector2<f32>) -> Vector3<f32> {
        let at = |i: usize| Vector3::from(self.pixels[i].map(f64::from));
        let size = self.size_px;
        bilinear(at, size, size, f64::from(place_px.x), f64::from(place_px.y)).cast()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_between_pixels_are_their_mean() {
        let pixels = [[0, 0, 0], [100, 0, 0], [0, 200, 0], [100, 200, 0]];
        let uv = [[0.25, 0.75], [0.5, 0.5], [1.0, 0.0]];
        let texture = Texture { uv: &uv, size_px: 2, pixels: &pixels };
        let color = |vertex| texture.color_at(texture.place_px(vertex));
        assert_eq!(color(0), Vector3::zeros());
        assert_eq!(color(1), Vector3::new(50.0, 100.0, 0.0));
        // Outside of all middles the nearest pixel counts.
        assert_eq!(color(2), Vector3::new(100.0, 200.0, 0.0));
    }
}
