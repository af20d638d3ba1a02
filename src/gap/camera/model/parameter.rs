//! The free numbers of a hypothesis.

use nalgebra::{Unit, Vector3};

/// A free number of a hypothesis. Angles rad, lengths m.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub enum HypothesisParameter {
    /// Placement of the root in a run: 0 to 2 shift, 3 to 5 turn about the object's center.
    Root(usize, usize),
    /// Position of a joint in a run.
    Position(usize, usize),
    /// Placement of a part's mesh, in its own frame, 0 to 2 shift, 3 to 5 turn about its center.
    Mesh(usize, usize),
    /// Camera's optical frame, 0 to 2 shift, 3 to 5 turn.
    Extrinsic(usize),
    /// Depth readings over depth, less one.
    DepthScale,
    /// Depth readings less depth.
    DepthBias,
    /// Delay of the images' stamps, seconds.
    Delay,
    /// Turn of a joint's axis at position 0 of the child unchanged: joint, one of two directions.
    AxisTurn(usize, usize),
    /// Shift of a joint's axis at position 0 of the child unchanged: joint, one of two directions.
    AxisShift(usize, usize),
    /// Shift (0 to 2, along two normals and the axis) and turn (3, 4, about two normals) of a joint's frame,
    /// child and all.
    Frame(usize, usize),
    /// Advance of a turning joint, meters a radian.
    Pitch(usize),
    /// Motion of a joint's child in a run beyond the law: run, joint, 0 to 2 shift, 3 to 5 turn about the
    /// child's center.
    Extra(usize, usize, usize),
    /// Factor on a joint's reported positions, less one.
    EncoderScale(usize),
    /// Offset of a joint's reported positions.
    EncoderBias(usize),
}

impl HypothesisParameter {
    /// Whether it is an angle of a joint's axis, frame or child.
    #[must_use]
    pub fn is_turn(&self) -> bool {
        matches!(self, Self::AxisTurn(..) | Self::Frame(_, 3..) | Self::Extra(_, _, 3..))
    }
}

/// Two unit vectors normal to a third.
#[must_use]
pub fn normals_of(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let a = axis.into_inner();
    // The unit vector least along the axis: the product is far from zero.
    let k = a.iamin();
    let e = Vector3::from_fn(|i, _| if i == k { 1.0 } else { 0.0 });
    let u = a.cross(&e).normalize();
    [u, a.cross(&u)]
}

/// The unit vector of a component and whether it is a turn.
pub(super) fn unit_component(k: usize) -> (Vector3<f64>, bool) {
    (Vector3::from_fn(|i, _| if i == k % 3 { 1.0 } else { 0.0 }), k >= 3)
}
