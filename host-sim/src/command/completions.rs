//! `schuler completions SHELL`.
use clap_complete::Shell;

use super::Failure;

/// What its help teaches.
const EXAMPLES: &str = "\
Examples:
  schuler completions bash > ~/.local/share/bash-completion/completions/schuler
  schuler completions zsh > ~/.zfunc/_schuler
  schuler completions fish > ~/.config/fish/completions/schuler.fish";

/// For which shell.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

pub(super) fn run(arguments: &Arguments, command: &mut clap::Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, command, "schuler", &mut script);
    super::session::print(&script)
}
