//! `isochor info`: the health of a model.

use std::path::Path;

use isochor::{Health, topology};
use isochor_io::Format;

use crate::failure::Failure;
use crate::model::Model;
use crate::terminal::Terminal;

/// Prints the health of the model at `path`.
pub fn run(path: &Path, terminal: &Terminal) -> Result<(), Failure> {
    let model = Model::named(path)?;
    let document = model.document(Format::Ply)?;
    let mesh = document.mesh();
    let (health, _) = Health::of(mesh, &topology(mesh), &model.source(&document));
    terminal.health(path, &health);
    Ok(())
}
