//! `artitwin gallery`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{
    exit::{CliError, Exit},
    terminal::{self, print_line},
};
use common::files;
use common::limits::REPORT;
use export::{GALLERY_MARK, gallery_page};

/// Options of `gallery`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin gallery runs")]
pub(super) struct GalleryArgs {
    /// Folders with results of reconstruct and diagnose, at any depth
    #[arg(value_name = "RUNS", required = true)]
    pub runs: Vec<PathBuf>,
    /// File that gets the page [default: gallery.html in the first folder]; a file that is no gallery is not
    /// replaced
    #[arg(long, value_name = "FILE.html")]
    pub out: Option<PathBuf>,
}

/// Writes the page of all results.
///
/// # Errors
/// An unreadable folder; a file without the gallery's mark in the page's place; a page without write access.
pub(super) fn write_gallery(args: &GalleryArgs) -> Result<Exit, CliError> {
    let first = args.runs.first().map_or(Path::new("."), PathBuf::as_path);
    let out = args.out.clone().unwrap_or_else(|| first.join("gallery.html"));
    if out.exists() && !files::read_text(&out, REPORT).is_ok_and(|text| text.contains(GALLERY_MARK)) {
        return Err(CliError::Usage("the file of --out is there and no gallery: give another"));
    }
    let folder = out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let gallery =
        io::read_gallery(&args.runs, folder).map_err(|(path, source)| CliError::Results { path, source })?;
    let page = gallery_page(&gallery.cards, &gallery.unread);
    files::write_whole(&out, page.as_bytes())
        .map_err(|source| CliError::Page { path: out.clone(), source })?;
    gallery.unread.iter().for_each(|why| print_line(&format!("warning: {why}")));
    terminal::print_result(&format!("{}: {} results\n", out.display(), gallery.cards.len()))?;
    Ok(if gallery.unread.is_empty() { Exit::Done } else { Exit::Degraded })
}
