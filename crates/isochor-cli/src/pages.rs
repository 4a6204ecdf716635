//! Completions and manual pages, made from the command line's own description.

use std::path::Path;

use clap::CommandFactory;

use crate::args::Cli;
use crate::failure::Failure;
use crate::terminal::write;

/// Prints completions for a shell.
pub fn completions(shell: clap_complete::Shell) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "isochor", &mut script);
    write(&mut std::io::stdout(), &String::from_utf8_lossy(&script));
    Ok(())
}

/// Prints the manual page, or writes one page per command into `folder`.
pub fn man(folder: Option<&Path>) -> Result<(), Failure> {
    let command = Cli::command();
    let Some(folder) = folder else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page).expect("writing to memory does not fail");
        write(&mut std::io::stdout(), &String::from_utf8_lossy(&page));
        return Ok(());
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
