//! A page of many results: a card for each with its picture, its verdict, and links.

use std::fmt::Write as _;

use base64::Engine as _;

use super::page::{self, counted_noun, push_list};
use model::escape_xml as escape;

/// Mark of a gallery page: a later run may replace pages that contain it.
pub const GALLERY_MARK: &str = "<!-- artitwin gallery -->";

const STYLE: &str =
    ".cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(250px, 1fr)); gap: 14px }
.card { margin: 0; padding: 0 0 12px; overflow: hidden }
.card > * { margin: 8px 14px 0 }
.card > img { display: block; width: 100%; margin: 0; aspect-ratio: 4 / 3; object-fit: contain }
.card h3 { font-size: 16px; overflow-wrap: anywhere }
.card a { margin-right: 12px }
";

/// A result of the gallery.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GalleryCard {
    /// Its name.
    pub name: String,
    /// Its folder, as shown to people.
    pub folder: String,
    /// A picture of it, PNG.
    pub picture: Option<Vec<u8>>,
    /// The verdict in a word or two, and whether it is good enough to need no further look.
    pub verdict: (String, bool),
    /// Findings, one line each.
    pub found: Vec<String>,
    /// Names and paths of files to open; paths are relative to the page and percent-encoded.
    pub links: Vec<(String, String)>,
}

/// The page; `unread` has a sentence for each result that could not be read.
pub fn gallery_page(cards: &[GalleryCard], unread: &[String]) -> String {
    let mut out = page::page_head("artitwin: gallery", STYLE);
    // Writing to a string cannot fail.
    writeln!(
        out,
        "{GALLERY_MARK}\n<header>\n<h1>Gallery</h1>\n<p class=\"facts\">{}</p>\n</header>",
        counted_noun(cards.len(), "result")
    )
    .ok();
    push_list(&mut out, "warnings", "Not read", unread);
    out.push_str("<div class=\"cards\">\n");
    cards.iter().for_each(|card| push_card(&mut out, card));
    out.push_str("</div>\n");
    out.push_str(page::TAIL);
    out
}

fn push_card(out: &mut String, card: &GalleryCard) {
    let encoded = card.picture.as_ref().map(|png| base64::engine::general_purpose::STANDARD.encode(png));
    let picture = encoded.map_or(String::new(), |data| {
        format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(&card.name))
    });
    let (word, is_good) = &card.verdict;
    let class = if *is_good { "pill" } else { "pill check" };
    let found: String = card.found.iter().map(|f| format!("<div>{}</div>\n", escape(f))).collect();
    let mut links = String::new();
    for (name, path) in &card.links {
        write!(links, "<a href=\"{}\">{}</a>", escape(path), escape(name)).ok();
    }
    writeln!(
        out,
        "<section class=\"card\">\n{picture}<h3>{}</h3>\n\
         <div><span class=\"{class}\">{}</span></div>\n\
         {found}<div>{links}</div>\n<div class=\"soft\">{}</div>\n</section>",
        escape(&card.name),
        escape(word),
        escape(&card.folder)
    )
    .ok();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_holds_all_of_a_result_and_nothing_that_runs() {
        let card = GalleryCard {
            name: "<script>".into(),
            folder: "runs/a & b".into(),
            picture: Some(vec![1, 2, 3]),
            verdict: ("2 warnings".into(), false),
            found: vec!["door turns 90\u{b0}".into()],
            links: vec![("report".into(), "a%20%26%20b/report.html".into())],
        };
        let page = gallery_page(&[card], &["c: damaged".into()]);
        assert!(!page.contains("<script>") && page.contains("&lt;script&gt;") && page.contains("a &amp; b"));
        for part in [
            "<span class=\"pill check\">2 warnings</span>",
            "door turns 90\u{b0}",
            "<a href=\"a%20%26%20b/report.html\">report</a>",
            "data:image/png;base64,AQID",
            "<li>c: damaged</li>",
            "1 result<",
            GALLERY_MARK,
        ] {
            assert!(page.contains(part), "{part} is not in {page}");
        }
    }
}
