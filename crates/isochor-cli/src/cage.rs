//! `isochor cage`: a cage round a model.

use std::path::Path;

use isochor::{CageCheck, CageMakingError, CageMakingOptions, cage_round};
use isochor_io::{Document, Format, NumberType};

use crate::args::CageArgs;
use crate::failure::Failure;
use crate::files::{self, Pending};
use crate::model::Model;
use crate::terminal::Terminal;

/// What was made, for programs.
#[derive(serde::Serialize)]
struct Made<'a> {
    output: &'a Path,
    /// In units of the model.
    distance: f64,
    #[serde(flatten)]
    cage: CageCheck,
}

/// Makes the cage, checks it and writes it.
pub fn run(args: &CageArgs, terminal: &Terminal) -> Result<(), Failure> {
    let CageArgs { model, output, faces, distance } = args;
    let model = Model::named(model)?;
    let format = Format::from_path(output).map_err(|error| Failure::read(output, &error))?;
    if format == Format::Stl {
        let hint = "choose a name that ends in .obj or .ply";
        return Err(Failure::file(output, "a cage is written as OBJ or PLY, which keep its vertices", hint));
    }
    if let Model::File { path, .. } = &model
        && files::are_same(path, output)
    {
        return Err(Failure::file(output, "the cage would overwrite the model", "choose another name"));
    }
    let document = model.document(format)?;
    let mesh = document.mesh();
    let options = CageMakingOptions { faces: *faces as usize, distance: *distance };
    let cage = cage_round(mesh, &options).map_err(|error| failure(&model, &error))?;
    let written =
        Document::from_mesh(&cage, format, NumberType::F64).map_err(|error| Failure::write(output, &error))?;
    let distance = mesh.bounds().map_or(0.0, |bounds| distance * bounds.extent());
    let report = CageCheck::of(written.mesh(), mesh, distance);
    let mut pending = Pending::default();
    pending.add(output, written.bytes())?;
    pending.commit()?;
    for warning in document.warnings() {
        terminal.say(&format!("note: {warning}"));
    }
    terminal.say(&format!(
        "cage: {} vertices, {} triangles, {}, volume {:e}; the model's vertices are inside, at {:e} and more",
        report.vertices,
        report.faces,
        if report.components == 1 { "one piece".into() } else { format!("{} pieces", report.components) },
        report.volume.unwrap_or_default(),
        report.least_distance.unwrap_or_default(),
    ));
    terminal.say(&format!("wrote {}", output.display()));
    terminal.data(&Made { output, distance, cage: report });
    Ok(())
}

/// Why there is no cage, and what to do.
fn failure(model: &Model, error: &CageMakingError) -> Failure {
    let (exit, place, hint) = match error {
        CageMakingError::Faces { .. } => (2, "--faces".into(), "200 is usual"),
        CageMakingError::Distance { .. } => (2, "--distance".into(), "0.02 is usual"),
        CageMakingError::TooMany { .. } => (1, "--faces".into(), "raise --faces or --distance"),
        CageMakingError::Nothing | CageMakingError::Extent { .. } | CageMakingError::Mesh(_) => {
            (2, model.name(), "check the model's coordinates; isochor info tells its bounds")
        }
        CageMakingError::Faulty { .. } => (1, model.name(), "move the model nearer to the origin, or scale it"),
    };
    Failure { exit, code: "cage", what: error.to_string(), place, hint: hint.into() }
}
