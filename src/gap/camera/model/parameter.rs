//! The free numbers of a hypothesis.

use nalgebra::Vector3;

/// A free number of a hypothesis. Angles in rad, lengths in m.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub enum HypothesisParameter {
    /// Placement of the root: run, component (0 to 2 shift, 3 to 5 turn about the object's center).
    Root(usize, usize),
    /// Position of a joint: run, joint.
    Position(usize, usize),
    /// Placement of a part's mesh in the part frame: part, component (0 to 2 shift, 3 to 5 turn about its
    /// center).
    Mesh(usize, usize),
    /// Pose of the camera's optical frame: component (0 to 2 shift, 3 to 5 turn).
    Extrinsic(usize),
    /// Ratio of depth reading to depth, minus one.
    DepthScale,
    /// Depth reading minus depth.
    DepthBias,
    /// Delay of the images' stamps, seconds.
    Delay,
    /// Turn of a joint's axis, the child at position 0 unchanged: joint, normal of the axis (0 or 1).
    AxisTurn(usize, usize),
    /// Shift of a joint's axis, the child at position 0 unchanged: joint, normal of the axis (0 or 1).
    AxisShift(usize, usize),
    /// Displacement of a joint's frame with its child: joint, component (0 to 2 shift along two normals and
    /// the axis; 3, 4 turn about the normals).
    Frame(usize, usize),
    /// Pitch of a turning joint, meters per radian.
    Pitch(usize),
    /// Motion of a joint's child beyond its law: run, joint, component (0 to 2 shift, 3 to 5 turn about the
    /// child's center).
    Extra(usize, usize, usize),
    /// Factor of a joint's reported positions, minus one.
    EncoderScale(usize),
    /// Offset of a joint's reported positions.
    EncoderBias(usize),
}

impl HypothesisParameter {
    /// Whether it is an angle of a joint's axis, frame or child.
    pub fn is_turn(&self) -> bool {
        matches!(self, Self::AxisTurn(..) | Self::Frame(_, 3..) | Self::Extra(_, _, 3..))
    }
}

/// The unit vector of component `k`, and whether it is a turn.
pub(super) fn unit_component(k: usize) -> (Vector3<f64>, bool) {
    (Vector3::from_fn(|i, _| if i == k % 3 { 1.0 } else { 0.0 }), k >= 3)
}
