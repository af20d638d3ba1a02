//! Covers a raster with few rectangles.

/// A rectangle of cells: columns `x..x + width`, rows `y..y + height`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rectangle {
    pub x: usize,
    pub y: usize,
    pub width: usize,
    pub height: usize,
}

impl Rectangle {
    pub(super) fn area(&self) -> usize {
        self.width * self.height
    }
}

/// Rectangles that cover the filled cells (row-major, `columns` a row) and no empty ones, the largest first.
/// It ends when less than `rest` of the cells is bare, the next would be narrower than `min_side` cells, or
/// there are `most` of them.
pub(super) fn covering_rectangles(
    filled: &[bool],
    columns: usize,
    min_side: usize,
    rest: f64,
    most: usize,
) -> Vec<Rectangle> {
    let mut left = filled.to_vec();
    let total = filled.iter().filter(|c| **c).count();
    let mut bare = total;
    let mut found = Vec::new();
    while found.len() < most && bare as f64 > rest * total as f64 {
        // A rectangle may overlap covered cells, to leave no gaps; only new cells count.
        let Some(best) = largest_rectangle(&left, filled, columns, min_side) else { break };
        for y in best.y..best.y + best.height {
            for cell in &mut left[y * columns + best.x..y * columns + best.x + best.width] {
                bare -= usize::from(*cell);
                *cell = false;
            }
        }
        found.push(best);
    }
    found
}

/// The largest rectangle of bare cells, grown over filled cells as far as possible.
fn largest_rectangle(bare: &[bool], filled: &[bool], columns: usize, min_side: usize) -> Option<Rectangle> {
    let rows = bare.len().checked_div(columns)?;
    // The largest rectangle under a row of heights, row by row: linear in the cells. The empty column behind
    // the last one closes open rectangles.
    let mut heights = vec![0usize; columns + 1];
    let mut best: Option<Rectangle> = None;
    for y in 0..rows {
        for x in 0..columns {
            heights[x] = if bare[y * columns + x] { heights[x] + 1 } else { 0 };
        }
        let mut open: Vec<(usize, usize)> = Vec::new();
        for x in 0..=columns {
            let mut start = x;
            while let Some((from, height)) = open.pop_if(|(_, h)| *h > heights[x]) {
                start = from;
                let found = Rectangle { x: from, y: y + 1 - height, width: x - from, height };
                let wide = found.width.min(found.height) >= min_side;
                if wide && best.is_none_or(|b| found.area() > b.area()) {
                    best = Some(found);
                }
            }
            if heights[x] > 0 && open.last().is_none_or(|(_, h)| *h < heights[x]) {
                open.push((start, heights[x]));
            }
        }
    }
    best.map(|b| grown_rectangle(b, filled, columns, rows))
}

fn grown_rectangle(mut r: Rectangle, filled: &[bool], columns: usize, rows: usize) -> Rectangle {
    let column = |x: usize, r: &Rectangle| (r.y..r.y + r.height).all(|y| filled[y * columns + x]);
    let row =
        |y: usize, r: &Rectangle| filled[y * columns + r.x..y * columns + r.x + r.width].iter().all(|c| *c);
    while r.x > 0 && column(r.x - 1, &r) {
        (r.x, r.width) = (r.x - 1, r.width + 1);
    }
    while r.x + r.width < columns && column(r.x + r.width, &r) {
        r.width += 1;
    }
    while r.y > 0 && row(r.y - 1, &r) {
        (r.y, r.height) = (r.y - 1, r.height + 1);
    }
    while r.y + r.height < rows && row(r.y + r.height, &r) {
        r.height += 1;
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raster(text: &[&str]) -> (Vec<bool>, usize) {
        (text.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect(), text[0].len())
    }

    #[test]
    fn a_frame_takes_four_and_its_hole_stays_open() {
        let (filled, columns) = raster(&[
            "##########",
            "##########",
            "##......##",
            "##......##",
            "##......##",
            "##########",
            "##########",
        ]);
        let found = covering_rectangles(&filled, columns, 1, 0.0, 32);
        assert_eq!(found.len(), 4, "{found:?}");
        let covered = |x: usize, y: usize| {
            found.iter().any(|r| (r.x..r.x + r.width).contains(&x) && (r.y..r.y + r.height).contains(&y))
        };
        for (i, full) in filled.iter().enumerate() {
            assert_eq!(covered(i % columns, i / columns), *full);
        }
    }

    #[test]
    fn one_rectangle_is_one_and_slivers_are_left() {
        let (filled, columns) = raster(&["......", ".####.", ".####.", "....#."]);
        assert_eq!(
            covering_rectangles(&filled, columns, 2, 0.0, 9),
            [Rectangle { x: 1, y: 1, width: 4, height: 2 }]
        );
        assert_eq!(covering_rectangles(&[false; 6], 3, 1, 0.0, 9), []);
    }
}
