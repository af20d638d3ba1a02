//! Layout of a printed tag board.

use nalgebra::Point2;

use super::tag::{CELLS, TagCells, cells_of_code};

/// Paper size of a printed board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 297 x 420 mm.
    A3,
    /// 8.5 x 11 in.
    Letter,
}

impl Paper {
    /// All paper sizes.
    pub const ALL: [Self; 3] = [Self::A4, Self::A3, Self::Letter];

    /// Its name on the command line and in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::A4 => "a4",
            Self::A3 => "a3",
            Self::Letter => "letter",
        }
    }

    /// The paper with a name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|p| p.name() == name)
    }
}

/// Columns and rows of tags, the same on every paper: a few large tags can be read from far away.
const COLUMNS: usize = 2;
const ROWS: usize = 3;
/// Number of tags on a board.
pub(super) const TAGS: usize = COLUMNS * ROWS;

/// Numbers of the codes in the tag family: from 300, 310 and 320 on.
const A4_CODES: [u64; TAGS] =
    [0x2_2d9a_43ed, 0xf_db16_2a9f, 0x0_cb4a_727d, 0x4_fae2_e371, 0x5_35b5_be8b, 0x4_8795_908a];
const A3_CODES: [u64; TAGS] =
    [0xc_8bd9_ec61, 0x8_3ee8_e8bb, 0xc_8431_419a, 0x1_aa78_079d, 0x8_111a_a4a5, 0xd_fa3a_69fe];
const LETTER_CODES: [u64; TAGS] =
    [0xb_c07a_4e8a, 0x5_7bf0_8ba0, 0x6_cb18_036a, 0xf_0e2e_4b75, 0x3_eb69_2b6f, 0xd_8178_a3fa];

/// A grid of tags on a sheet. The origin of its frame is the center of the grid, x points right, y up the
/// sheet and z out of it; lengths are in meters at true print scale.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardLayout {
    /// Paper it is printed on.
    pub paper: Paper,
    /// Width and height of the sheet, meters.
    pub sheet_m: [f64; 2],
    /// Side of a tag's black border, meters.
    pub tag_m: f64,
    /// White gap between neighboring tags, meters: more than the one cell that a tag needs.
    pub gap_m: f64,
    /// Distance from the upper edge of the sheet to the first row of tags, meters.
    top_m: f64,
    /// Number of the upper left tag; the others follow row by row. The numbers of different papers differ.
    first: u16,
    cells: [TagCells; TAGS],
}

impl BoardLayout {
    /// The board for a paper.
    #[must_use]
    pub fn of_paper(paper: Paper) -> Self {
        let (sheet_m, tag_m, gap_m, top_m, first, codes) = match paper {
            Paper::A4 => ([0.210, 0.297], 0.072, 0.020, 0.011, 300, A4_CODES),
            Paper::A3 => ([0.297, 0.420], 0.104, 0.028, 0.016, 310, A3_CODES),
            Paper::Letter => ([0.2159, 0.2794], 0.068, 0.020, 0.009, 320, LETTER_CODES),
        };
        let cells = codes.map(cells_of_code);
        Self { paper, sheet_m, tag_m, gap_m, top_m, first, cells }
    }

    /// The board that holds a tag.
    #[must_use]
    pub fn with_tag(tag: u16) -> Option<Self> {
        Paper::ALL.into_iter().map(Self::of_paper).find(|l| l.tag_place(tag).is_some())
    }

    /// Numbers of its tags.
    pub fn tag_numbers(&self) -> impl Iterator<Item = u16> + use<> {
        let first = self.first;
        (0..TAGS as u16).map(move |k| first + k)
    }

    /// Corners of a tag's black border in the board frame, meters: clockwise as the sheet is read, from the
    /// upper left. `None` for a tag of another board.
    #[must_use]
    pub fn tag_corners(&self, tag: u16) -> Option<[Point2<f64>; 4]> {
        let place = self.tag_place(tag)?;
        let column = (place % COLUMNS) as f64;
        let row = (place / COLUMNS) as f64;
        let pitch_m = self.tag_m + self.gap_m;
        let [half_x, half_y] = self.half_grid_m();
        let x = column * pitch_m - half_x;
        let y = half_y - row * pitch_m;
        let a = self.tag_m;
        Some([Point2::new(x, y), Point2::new(x + a, y), Point2::new(x + a, y - a), Point2::new(x, y - a)])
    }

    /// Lower left and upper right corner of the sheet, meters.
    #[must_use]
    pub fn sheet_corners(&self) -> [Point2<f64>; 2] {
        let top = self.half_grid_m()[1] + self.top_m;
        let [width, height] = self.sheet_m;
        [Point2::new(-0.5 * width, top - height), Point2::new(0.5 * width, top)]
    }

    /// Half the extent of the tag grid along x and y, meters.
    #[must_use]
    pub fn half_grid_m(&self) -> [f64; 2] {
        [COLUMNS, ROWS].map(|n| 0.5 * (n as f64 * (self.tag_m + self.gap_m) - self.gap_m))
    }

    /// By cell of a tag, whether it is black: rows from above, the border included.
    #[must_use]
    pub fn tag_cells(&self, tag: u16) -> Option<&TagCells> {
        self.tag_place(tag).map(|place| &self.cells[place])
    }

    /// Whether a point of the sheet is printed black.
    #[must_use]
    pub fn is_black(&self, at: &Point2<f64>) -> bool {
        let pitch_m = self.tag_m + self.gap_m;
        let [half_x, half_y] = self.half_grid_m();
        let right = at.x + half_x;
        let down = half_y - at.y;
        let column = (right / pitch_m).floor();
        let row = (down / pitch_m).floor();
        if !((0.0..COLUMNS as f64).contains(&column) && (0.0..ROWS as f64).contains(&row)) {
            return false;
        }
        let cell_m = self.tag_m / CELLS as f64;
        let [x, y] = [right - column * pitch_m, down - row * pitch_m].map(|v| (v / cell_m) as usize);
        let cells = &self.cells[row as usize * COLUMNS + column as usize];
        x < CELLS && y < CELLS && cells[y][x]
    }

    fn tag_place(&self, tag: u16) -> Option<usize> {
        tag.checked_sub(self.first).map(usize::from).filter(|k| *k < TAGS)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_number_is_of_one_paper() {
        let all: Vec<u16> = Paper::ALL.iter().flat_map(|p| BoardLayout::of_paper(*p).tag_numbers()).collect();
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), Paper::ALL.len() * TAGS);
        for paper in Paper::ALL {
            assert_eq!(Paper::by_name(paper.name()), Some(paper));
            for tag in BoardLayout::of_paper(paper).tag_numbers() {
                assert_eq!(BoardLayout::with_tag(tag).unwrap().paper, paper);
            }
        }
        assert_eq!(BoardLayout::with_tag(0), None);
        assert_eq!(Paper::by_name("a5"), None);
    }

    #[test]
    fn tags_have_white_around_them_and_lie_on_the_sheet() {
        for layout in Paper::ALL.map(BoardLayout::of_paper) {
            let cell_m = layout.tag_m / CELLS as f64;
            assert!(layout.gap_m > 2.0 * cell_m, "two tags must not share their white");
            let [low, high] = layout.sheet_corners();
            // The space below the tags holds a ruler and a line of text.
            let room = |side: f64, least: f64| assert!(side > least, "{side} {:?}", layout.paper);
            let [half_x, half_y] = layout.half_grid_m();
            room(high.x - half_x, 0.008);
            room(high.y - half_y, cell_m);
            room(-half_y - low.y, 0.025);
            for tag in layout.tag_numbers() {
                let corners = layout.tag_corners(tag).unwrap();
                let middle = nalgebra::center(&corners[0], &corners[2]);
                for corner in corners {
                    let inside = corner + (middle - corner) * 0.02;
                    let outside = corner - (middle - corner) * 0.02;
                    assert!(layout.is_black(&inside) && !layout.is_black(&outside));
                }
            }
        }
    }
}
