//! Completions and manual pages, made from the command line's own description.

use std::path::Path;

use clap::CommandFactory;

use crate::args::Cli;
use crate::failure::Failure;

/// Prints completions for a shell.
pub fn completions(shell: clap_complete::Shell) -> Result<(), Failure> {
    clap_complete::generate(shell, &mut Cli::command(), "isochor", &mut std::io::stdout());
    Ok(())
}

/// Prints the manual page, or writes one page per command into `folder`.
pub fn man(folder: Option<&Path>) -> Result<(), Failure> {
    let command = Cli::command();
    let Some(folder) = folder else {
        return clap_mangen::Man::new(command).render(&mut std::io::stdout()).map_err(|error| {
            Failure::usage("standard output", format!("cannot be written: {error}"), "check where it is piped to")
        });
    };
    let failed = |error: std::io::Error| {
        Failure::file(
            folder,
            format!("manual pages cannot be written: {error}"),
            "check that the folder may be written to",
        )
    };
    std::fs::create_dir_all(folder).map_err(failed)?;
    clap_mangen::generate_to(command, folder).map_err(failed)
}
