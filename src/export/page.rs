//! Shared elements of report pages: head and style, tables, lists, numbers.

use std::fmt::Write as _;

use model::escape_xml as escape;

const STYLE: &str = include_str!("report.css");

/// The end of a page.
pub(crate) const TAIL: &str = "</main>\n</body>\n</html>\n";

/// The beginning of a page, up to its first section; `title` is escaped, `style` extends the style of all
/// pages.
pub(crate) fn page_head(title: &str, style: &str) -> String {
    // The policy allows only pictures inside the page and its own style: no name from a recording can make
    // the page load or run anything.
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
         style-src 'unsafe-inline'\">\n\
         <title>{title}</title>\n<style>\n{STYLE}{style}</style>\n</head>\n<body>\n<main>\n"
    )
}

// Writing to a string cannot fail: the results below are dropped.

/// Adds a section with a list of sentences, which it escapes; nothing if there are none.
pub(crate) fn push_list(out: &mut String, class: &str, title: &str, sentences: &[String]) {
    if sentences.is_empty() {
        return;
    }
    let items: String = sentences.iter().map(|s| format!("<li>{}</li>\n", escape(s))).collect();
    writeln!(out, "<section class=\"{class}\">\n<h2>{title}</h2>\n<ul>\n{items}</ul>\n</section>").ok();
}

/// A row of a table with column heads `head`. On a narrow screen every cell is on a line of its own, and all
/// but the first show the head of their column.
pub(crate) fn table_row(head: &[&str], cells: &[String]) -> String {
    let mut out = "<tr>".to_owned();
    for (k, (cell, head)) in cells.iter().zip(head).enumerate() {
        let label = if k > 0 { format!(" data-label=\"{head}\"") } else { String::new() };
        write!(out, "<td{label}><div>{cell}</div></td>").ok();
    }
    out.push_str("</tr>\n");
    out
}

/// Adds a section with a table of such rows; nothing if there are none.
pub(crate) fn push_table(out: &mut String, title: &str, head: &[&str], rows: &str) {
    if rows.is_empty() {
        return;
    }
    let head: String = head.iter().map(|h| format!("<th>{h}</th>")).collect();
    writeln!(
        out,
        "<section>\n<h2>{title}</h2>\n<div \
        class=\"scroll\"><table>\n<tr>{head}</tr>\n{rows}</table></div>\n</section>"
    )
    .ok();
}

/// Text with true minus signs.
pub(crate) fn with_true_minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

/// A number, escaped, with its unit.
pub(crate) fn number_with_unit(number: &str, unit: &str) -> String {
    let space = if unit == "\u{b0}" { "" } else { "\u{a0}" };
    format!("{}{space}<span class=\"unit\">{unit}</span>", escape(number))
}

/// A number with its noun, which is plural unless the number is 1.
pub fn counted_noun(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}
