//! The pattern of a tag: AprilTag 36h11 (Olson 2011).

/// Cells along a side of a tag, the black border included.
pub(super) const CELLS: usize = 8;
/// Cells along a side of a tag's code.
const INSIDE: usize = CELLS - 2;

/// By cell of a tag, whether it is black: rows from above.
pub type TagCells = [[bool; CELLS]; CELLS];

/// The cells of a tag with a code of 36 bits, the highest first. Nine bits fill the upper sides of the rings,
/// from the outside in; the other quarters are rotated clockwise. A set bit is white.
pub(super) fn cells_of_code(code: u64) -> TagCells {
    let mut cells = [[true; CELLS]; CELLS];
    let quarter = INSIDE * INSIDE / 4;
    let mut place = 0;
    for ring in 0..INSIDE / 2 {
        for along in ring..INSIDE - 1 - ring {
            for side in 0..4 {
                let bit = side * quarter + place;
                // The upper side, rotated by quarter turns.
                let mut x = 1 + along;
                let mut y = 1 + ring;
                for _ in 0..side {
                    (x, y) = (CELLS - 1 - y, x);
                }
                cells[y][x] = code >> (INSIDE * INSIDE - 1 - bit) & 1 == 0;
            }
            place += 1;
        }
    }
    cells
}
