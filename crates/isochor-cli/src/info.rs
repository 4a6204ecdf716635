//! `isochor info`: the health of a model.

use std::path::Path;

use isochor::{Health, topology};
use isochor_io::{Document, Format};

use crate::failure::Failure;
use crate::terminal::Terminal;
use crate::{files, run};

/// Prints the health of the model at `path`.
pub fn run(path: &Path, terminal: &Terminal) -> Result<(), Failure> {
    let failed = |error| Failure::read(path, &error);
    let format = Format::from_path(path).map_err(failed)?;
    let document = Document::parse(files::bytes(path)?, format).map_err(failed)?;
    let mesh = document.mesh();
    let (health, _) = Health::of(mesh, &topology(mesh), &run::source(&document));
    terminal.health(path, &health);
    Ok(())
}
