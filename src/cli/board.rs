//! `artitwin board`.

use std::{fs::File, io::Write as _, path::PathBuf};

use clap::Args;

use super::{
    exit::{CliError, Exit},
    terminal,
};
use capture::{BoardLayout, Paper};
use export::board_page;

/// Options of `board`.
#[derive(Args, Clone, Debug)]
#[command(after_help = "Example: artitwin board --out board.pdf --paper a3")]
pub(super) struct BoardArgs {
    /// File that gets the page; a file that is there is not replaced
    #[arg(long, value_name = "FILE.pdf")]
    pub out: PathBuf,
    /// Sheet to print on: a4, a3 or letter
    #[arg(long, value_name = "PAPER", value_parser = paper, default_value = "a4")]
    pub paper: Paper,
}

/// The paper of a name.
pub(super) fn paper(text: &str) -> Result<Paper, &'static str> {
    Paper::by_name(text).ok_or("give a4, a3 or letter")
}

/// Writes the page.
///
/// # Errors
/// The file exists already or cannot be written.
pub(super) fn write_board(args: &BoardArgs) -> Result<Exit, CliError> {
    let page = board_page(&BoardLayout::of_paper(args.paper));
    let refused = |source| CliError::Page { path: args.out.clone(), source };
    let mut file = File::create_new(&args.out).map_err(refused)?;
    file.write_all(&page).and_then(|()| file.sync_all()).map_err(refused)?;
    let text = format!(
        "{}: print at 100 %, measure the ruler, glue the sheet to a flat plate\n",
        args.out.display()
    );
    terminal::print_result(&text)?;
    Ok(Exit::Done)
}
