//! A table of what became of the found effects in each file.

use std::fmt::Write as _;

use super::words::{decimal_places, escaped_words, fixed_text, residual_text, with_unit};
use crate::page::{push_table, table_row};
use gap::judge::report::{ExportNote, ExportStatus, Held, JointReport};
use model::escape_xml;

/// The table of all formats.
pub(super) fn exports_table(joints: &[JointReport], notes: &[ExportNote]) -> String {
    let head =
        ["Format", "Joint", "Effect", "The file", "In its place", "Held-out residual, twin \u{2192} file"];
    let mut rows = String::new();
    let mut last = (String::new(), String::new());
    let mut absent = None;
    for note in notes {
        if note.file.is_empty() && matches!(note.status, ExportStatus::NotWritten(_)) {
            // One row covers all joints and effects.
            let is_new = note.format != last.0 || absent != Some(&note.status);
            last = (note.format.clone(), String::new());
            absent = Some(&note.status);
            if is_new {
                let format = note.format.to_uppercase();
                let status = escape_xml(&note.status.to_string());
                writeln!(rows, "<tr><td>{format}</td><td colspan=\"5\">{status}</td></tr>").ok();
            }
            continue;
        }
        let unit = joints.iter().find(|j| j.joint == note.joint).map_or("m", JointReport::gap_unit);
        let own = (note.format.clone(), note.joint.clone());
        // The residuals are those of the joint in the file, with all its effects.
        let (file, gap) = if own == last {
            (String::new(), String::new())
        } else {
            let file = if note.file.is_empty() { String::new() } else { escape_xml(&note.file) };
            let gap = match (note.before, note.rmse) {
                (Some(before), Some(after)) if !note.file.is_empty() => {
                    format!("{} \u{2192} {}", residual_text(before, unit), residual_text(after, unit))
                }
                _ => "\u{2013}".into(),
            };
            (format!("{} <span class=\"soft\">{file}</span>", note.format.to_uppercase()), gap)
        };
        last = own;
        let by = note.by.iter().map(held_text).collect::<Vec<_>>().join("; ");
        let by = if by.is_empty() { "\u{2013}".into() } else { by };
        let cells = [
            file,
            escape_xml(&note.joint),
            escaped_words(&note.effect),
            escape_xml(&note.status.to_string()),
            by,
            gap,
        ];
        rows.push_str(&table_row(&head, &cells));
    }
    let mut out = String::new();
    push_table(&mut out, "What each file holds", &head, &rows);
    out
}

fn held_text(held: &Held) -> String {
    let mut parameters = Vec::with_capacity(held.parameters.len());
    for p in &held.parameters {
        let value = with_unit(&fixed_text(p.value, decimal_places(p.value, 0.0)), &p.unit);
        parameters.push(format!("{} {value}", escaped_words(&p.name)));
    }
    format!("{}: {}", escaped_words(&held.effect), parameters.join(", "))
}
