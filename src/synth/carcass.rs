//! The fixed part of a cabinet and its front openings.

/// A front opening between boards; coordinates in meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    /// Left and right side, as seen from the object.
    pub y: [f64; 2],
    /// Lower and upper side.
    pub z: [f64; 2],
}

impl Cell {
    pub(crate) fn width(&self) -> f64 {
        self.y[1] - self.y[0]
    }

    pub(crate) fn height(&self) -> f64 {
        self.z[1] - self.z[0]
    }
}

/// Dimensions of a carcass, meters. It stands on z = 0, centered at x = y = 0, with its front facing +x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carcass {
    /// Half the depth: the front is at `x = front`.
    pub front: f64,
    /// Half the width.
    pub side: f64,
    /// z of the lower face of the bottom board.
    pub bottom: f64,
    /// z of the upper face of the top board.
    pub top: f64,
    /// Thickness of the boards.
    pub board: f64,
}
