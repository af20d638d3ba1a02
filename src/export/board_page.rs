//! A printable page with a board of tags: a PDF at true scale, as vector graphics.

use std::fmt::Write as _;

use nalgebra::Point2;

use capture::{BoardLayout, Paper};

/// Points of a PDF in a meter. derived: 72 an inch
const POINTS: f64 = 72.0 / 0.0254;
/// Length of the ruler, and its height above the lower edge of the sheet, meters.
/// chosen: a length of any ruler, beside the tags
const RULER_M: f64 = 0.1;
const RULER_UP_M: f64 = 0.017;
/// Distance of ruler and text from the left edge of the sheet, meters. chosen: a printer's border, and more
const LEFT_M: f64 = 0.023;

/// The page as PDF bytes. Each tag is one path, black with its white cells cut out: no hairlines show between
/// cells.
pub fn board_page(layout: &BoardLayout) -> Vec<u8> {
    let content = drawing(layout);
    let [width, height] = layout.sheet_m.map(|m| m * POINTS);
    let objects = [
        // Asks viewers not to scale the page to the printer's margins.
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.3} {height:.3}] /Contents 4 0 R /Resources \
             << /Font << /F1 5 0 R >> >> >>"
        ),
        format!("<< /Length {} >>\nstream\n{content}endstream", content.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>".to_owned(),
    ];
    let mut file = "%PDF-1.4\n".to_owned();
    let mut starts = Vec::new();
    // Writing to a String cannot fail.
    for (k, object) in objects.iter().enumerate() {
        starts.push(file.len());
        _ = write!(file, "{} 0 obj\n{object}\nendobj\n", k + 1);
    }
    let table = file.len();
    _ = write!(file, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
    for start in starts {
        _ = writeln!(file, "{start:010} 00000 n ");
    }
    let size = objects.len() + 1;
    _ = write!(file, "trailer\n<< /Size {size} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n");
    file.into_bytes()
}

/// The drawing commands: lengths in points from the lower left corner of the sheet.
fn drawing(layout: &BoardLayout) -> String {
    let [low, _] = layout.sheet_corners();
    let mut text = String::new();
    for tag in layout.tag_numbers() {
        let (Some(corners), Some(cells)) = (layout.tag_corners(tag), layout.tag_cells(tag)) else { continue };
        let upper_left: Point2<f64> = corners[0] - low.coords;
        let cell_m = layout.tag_m / cells.len() as f64;
        rectangle(&mut text, upper_left.x, upper_left.y - layout.tag_m, layout.tag_m, layout.tag_m);
        text.push_str("0 g f\n");
        for (row, cells) in cells.iter().enumerate() {
            for (column, _) in cells.iter().enumerate().filter(|(_, black)| !**black) {
                let x = upper_left.x + column as f64 * cell_m;
                rectangle(&mut text, x, upper_left.y - (row + 1) as f64 * cell_m, cell_m, cell_m);
            }
        }
        text.push_str("1 g f\n");
    }
    text.push_str("0 g\n");
    ruler(&mut text);
    let paper = match layout.paper {
        Paper::A4 => "A4",
        Paper::A3 => "A3",
        Paper::Letter => "Letter",
    };
    let lines = [
        format!(
            "artitwin board, {paper}: print at 100 % (no \"fit to page\"); the ruler must measure 100 mm. \
             Glue flat on a stiff plate."
        ),
        "Lay it level beside the object, leave it there in all states, and let the camera see it often."
            .to_owned(),
    ];
    for (line, up_m) in lines.iter().zip([0.0095, 0.0055]) {
        let line = line.replace('(', "\\(").replace(')', "\\)");
        _ = writeln!(text, "BT /F1 7.5 Tf {:.3} {:.3} Td ({line}) Tj ET", LEFT_M * POINTS, up_m * POINTS);
    }
    text
}

/// A ruler with a mark every millimeter.
fn ruler(text: &mut String) {
    let millimeters = (RULER_M * 1e3).round() as usize;
    for mm in 0..=millimeters {
        let mark_m = match mm % 10 {
            0 => 0.005,
            5 => 0.0035,
            _ => 0.002,
        };
        let x = (LEFT_M + mm as f64 * 1e-3) * POINTS;
        let y = RULER_UP_M * POINTS;
        _ = writeln!(text, "0.25 w {x:.3} {y:.3} m {x:.3} {:.3} l S", y + mark_m * POINTS);
    }
    let y = RULER_UP_M * POINTS;
    let [from, to] = [LEFT_M, LEFT_M + RULER_M].map(|x| x * POINTS);
    _ = writeln!(text, "0.25 w {from:.3} {y:.3} m {to:.3} {y:.3} l S");
    for mm in (0..=millimeters).step_by(20) {
        let x = (LEFT_M + mm as f64 * 1e-3 - 0.0015) * POINTS;
        _ = writeln!(text, "BT /F1 6 Tf {x:.3} {:.3} Td ({mm}) Tj ET", y - 0.0028 * POINTS);
    }
    _ = writeln!(text, "BT /F1 6 Tf {:.3} {:.3} Td (mm) Tj ET", to + 0.005 * POINTS, y - 0.0028 * POINTS);
}

fn rectangle(text: &mut String, x_m: f64, y_m: f64, width_m: f64, height_m: f64) {
    let [x, y, width, height] = [x_m, y_m, width_m, height_m].map(|m| m * POINTS);
    _ = writeln!(text, "{x:.4} {y:.4} {width:.4} {height:.4} re");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_leads_to_every_object_and_sizes_are_true() {
        for paper in Paper::ALL {
            let layout = BoardLayout::of_paper(paper);
            let file = String::from_utf8(board_page(&layout)).unwrap();
            let (_, table) = file.split_once("xref\n0 6\n0000000000 65535 f \n").unwrap();
            for (k, line) in table.lines().take(5).enumerate() {
                let start: usize = line[..10].parse().unwrap();
                assert!(file[start..].starts_with(&format!("{} 0 obj\n", k + 1)));
            }
            let length: usize =
                file.split_once("/Length ").unwrap().1.split_once(' ').unwrap().0.parse().unwrap();
            let (_, stream) = file.split_once("stream\n").unwrap();
            assert!(stream[length..].starts_with("endstream"));
            // Of a tag its outline is the only rectangle of its size.
            let side = format!("{:.4} {:.4} re", layout.tag_m * POINTS, layout.tag_m * POINTS);
            assert_eq!(file.matches(&side).count(), 6);
        }
    }
}
