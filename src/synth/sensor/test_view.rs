//! A view for the tests of this room.

use nalgebra::Vector3;

use crate::View;
use geometry::Intrinsics;

/// A white wall square to a camera.
pub(super) fn wall(depth_m: f64) -> (View, Intrinsics) {
    let k = Intrinsics { width: 160, height: 120, fx: 144.0, fy: 144.0, cx: 80.0, cy: 60.0 };
    let n = k.width * k.height;
    let view = View {
        color: vec![Vector3::repeat(1.0); n],
        reflectance: vec![1.0; n],
        gloss: vec![0.0; n],
        lacquered: vec![false; n],
        depth_m: vec![depth_m; n],
        cosine: vec![1.0; n],
        part: vec![None; n],
    };
    (view, k)
}
