//! The fixed part of a cabinet and the openings of its front.

/// An opening of the front, between the boards around it; meters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    /// From left to right as the object sees it.
    pub y: [f64; 2],
    /// From bottom to top.
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

/// Measures of a carcass, meters. It stands on z = 0, its middle at x = y = 0; its front looks along +x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carcass {
    /// Half its depth: the front lies at `x = front`.
    pub front: f64,
    /// Half its width.
    pub side: f64,
    /// Lower side of the bottom board.
    pub bottom: f64,
    /// Upper side of the top board.
    pub top: f64,
    /// Thickness of the boards.
    pub board: f64,
}
