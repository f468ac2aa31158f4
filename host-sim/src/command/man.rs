//! `schuler man --out DIR`.
use std::path::PathBuf;

use serde::Serialize;

use super::Failure;
use super::session::Session;
use crate::output;

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  schuler man --out ~/.local/share/man/man1";

/// Where to.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Directory for the pages, one for each command; it is made if it is not there.
    #[arg(long, short)]
    out: PathBuf,
}

#[derive(Serialize)]
struct Answer {
    pages: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments, session: &Session, mut all: clap::Command) -> Result<(), Failure> {
    all.build();
    let mut pages = Vec::new();
    let visible = all.get_subcommands().filter(|it| !it.is_hide_set() && it.get_name() != "help");
    for command in std::iter::once(&all).chain(visible) {
        // A page is called as the whole command, with hyphens: `schuler-explain`.
        let name = command.get_display_name().unwrap_or(command.get_name()).replace(' ', "-");
        let mut page = Vec::new();
        clap_mangen::Man::new(command.clone().display_name(&name))
            .render(&mut page)
            .map_err(|error| Failure::Other(error.into()))?;
        let path = arguments.out.join(format!("{name}.1"));
        output::write(&path, sections(&String::from_utf8_lossy(&page)).as_bytes())?;
        pages.push(path);
    }
    session.answer(&Answer { pages }, |it| {
        it.pages.iter().fold(String::new(), |text, path| text + &path.display().to_string() + "\n")
    })
}

/// The page with what follows the options of a help under the names that manual pages have for it, line by line.
fn sections(page: &str) -> String {
    page.replace(".SH EXTRA\nExamples:\n", ".SH EXAMPLES\n.nf\n")
        .replace(".SH EXTRA\n", ".SH NOTES\n")
        .replace("\nExit status:\n", "\n.SH EXIT STATUS\n.nf\n")
        .replace("\nExamples:\n", "\n.SH EXAMPLES\n.nf\n")
}
