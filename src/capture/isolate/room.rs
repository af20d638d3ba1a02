//! Whether what was found is the room rather than an object in it.

use rayon::prelude::*;

use super::{
    plane::is_at_border,
    select::Object,
    support::STRIDE,
    voxels::{Cell, cell_of_point, frames_needed, supported_cells},
};
use crate::RgbdFrame;
use common::stop::{Stop, Stopped};

/// Largest share of all cells, and of the readings at the image borders, that an object has.
/// chosen: a room has more of both, while an object that fills the images has few of the latter
const LARGEST_SHARE: f64 = 1.0 / 3.0;

/// What an object has of all that was read.
#[derive(Clone, Copy, Debug)]
pub struct ShareOfRoom {
    /// Share of the cells, background included.
    pub cells: f64,
    /// Share of the readings at the image borders.
    pub borders: f64,
}

impl ShareOfRoom {
    /// The share of an object in what the frames of all states read.
    pub fn of_object(
        object: &Object,
        states: &[Vec<RgbdFrame>],
        size_m: f64,
        stop: &Stop,
    ) -> Result<Self, Stopped> {
        let mut cells = Count::default();
        let mut borders = Count::default();
        for frames in states {
            let found: Vec<(Vec<Cell>, Count)> = frames
                .par_iter()
                .map(|frame| stop.check().map(|()| cells_and_borders(frame, object, size_m)))
                .collect::<Result<_, Stopped>>()?;
            let (of_frames, at_borders): (Vec<Vec<Cell>>, Vec<Count>) = found.into_iter().unzip();
            at_borders.iter().for_each(|count| borders.add(*count));
            for cell in supported_cells(&of_frames, frames_needed(frames.len())) {
                cells.count(object.contains(&cell));
            }
        }
        Ok(Self { cells: cells.share(), borders: borders.share() })
    }

    /// Whether the object is the room.
    pub fn is_room(&self) -> bool {
        self.cells > LARGEST_SHARE && self.borders > LARGEST_SHARE
    }
}

/// A number of things, and how many of them are the object's.
#[derive(Clone, Copy, Default)]
struct Count {
    of_object: usize,
    all: usize,
}

impl Count {
    fn count(&mut self, is_of_object: bool) {
        self.add(Self { of_object: usize::from(is_of_object), all: 1 });
    }

    fn add(&mut self, other: Self) {
        self.of_object += other.of_object;
        self.all += other.all;
    }

    fn share(self) -> f64 {
        self.of_object as f64 / self.all.max(1) as f64
    }
}

/// The sorted cells of a frame's readings, every second in rows and columns, and the count of those at its
/// borders.
fn cells_and_borders(frame: &RgbdFrame, object: &Object, size_m: f64) -> (Vec<Cell>, Count) {
    let k = &frame.intrinsics;
    let mut cells = Vec::new();
    let mut borders = Count::default();
    for v in (0..k.height).step_by(STRIDE) {
        for u in (0..k.width).step_by(STRIDE) {
            let point = frame.world_point(v * k.width + u);
            let Some(cell) = point.and_then(|p| cell_of_point(&p, size_m)) else { continue };
            if is_at_border(k, u, v) {
                borders.count(object.contains(&cell));
            }
            cells.push(cell);
        }
    }
    cells.sort_unstable();
    cells.dedup();
    (cells, borders)
}
