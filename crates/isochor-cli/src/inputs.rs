//! What a request's job works on beside its model: a lattice, a surface, a cage, read from their files.

use std::path::Path;

use glam::DVec3;
use isochor::{CageInput, CageRequest, Coordinates, JobInput, Mesh, Outside, PosedLattice, Source, Surface, displaced};
use isochor_io::{
    Document, Format, SavedBinding, cage_moves_from_param, hash_of_cage, hash_of_points, lattice_from_json,
    patch_from_bytes,
};

use crate::failure::Failure;
use crate::files;
use crate::request::{Request, has_extension};

/// The files of a request, read.
pub struct Inputs {
    lattice: Option<PosedLattice>,
    surface: Option<Surface>,
    cage: Option<CageInput>,
}

impl Inputs {
    /// Reads the files that a request names, for its model.
    pub fn read(request: &Request, model: &Mesh) -> Result<Self, Failure> {
        Ok(Self { lattice: lattice(request)?, surface: surface(request)?, cage: cage(request, model)? })
    }

    /// With the model of a document.
    pub fn with<'a>(&'a self, document: &'a Document, source: &'a Source) -> JobInput<'a> {
        JobInput {
            mesh: document.mesh(),
            source,
            lattice: self.lattice.as_ref(),
            surface: self.surface.as_ref(),
            cage: self.cage.as_ref(),
        }
    }
}

fn lattice(request: &Request) -> Result<Option<PosedLattice>, Failure> {
    let Some(path) = &request.lattice_file else { return Ok(None) };
    let lattice = lattice_from_json(&files::text(path)?);
    lattice.map(Some).map_err(|error| Failure::lattice_file(path, &error))
}

fn surface(request: &Request) -> Result<Option<Surface>, Failure> {
    let (Some(path), Some(surface)) = (&request.surface_file, &request.job.surface) else { return Ok(None) };
    let patch = patch_from_bytes(&files::bytes(path)?, surface.patch);
    patch.map(|patch| Some(Surface::from(patch))).map_err(|error| Failure::surface_file(path, &error))
}

fn cage(request: &Request, model: &Mesh) -> Result<Option<CageInput>, Failure> {
    let Some(cage) = &request.job.cage else { return Ok(None) };
    let Some(path) = &cage.file else { return Ok(None) }; // the job says that it is missing
    let mesh = document(path)?.mesh().clone();
    let posed = cage.posed.as_ref().map(|path| posed(path, &mesh)).transpose()?;
    let weights = cage.weights.as_ref().map(|path| weights(path, cage, model, &mesh)).transpose()?;
    Ok(Some(CageInput { mesh, posed, weights }))
}

/// The vertices of a posed cage: those of a mesh, or of `cage` with its handles moved by the largest factor of a `.param` file.
fn posed(path: &Path, cage: &Mesh) -> Result<Vec<DVec3>, Failure> {
    if !has_extension(path, "param") {
        return Ok(document(path)?.mesh().points().to_vec());
    }
    let moves = cage_moves_from_param(&files::bytes(path)?, cage.points().len());
    let moves = moves.map_err(|error| Failure::read(path, &error))?;
    let displacement: Vec<DVec3> = moves.displacements.iter().map(|d| *d * moves.factors[1]).collect();
    Ok(displaced(cage.points(), &displacement))
}

/// What coordinates depend on beside their kind, the model and the cage.
pub fn settings(cage: &CageRequest) -> String {
    let options = cage.options();
    let outside = match options.outside {
        Outside::Keep => "keep",
        Outside::Extend | Outside::Refuse => "extend", // where none is outside they are the same
    };
    match options.harmonic.filter(|_| options.coordinates == Coordinates::Harmonic) {
        Some(grid) => format!("{{\"outside\":\"{outside}\",\"resolution\":{}}}", grid.resolution),
        None => format!("{{\"outside\":\"{outside}\"}}"),
    }
}

/// Saved coordinates, if they are of this model in this cage.
fn weights(path: &Path, request: &CageRequest, model: &Mesh, cage: &Mesh) -> Result<Vec<f64>, Failure> {
    let saved = SavedBinding::from_bytes(&files::bytes(path)?).map_err(|error| Failure::read(path, &error))?;
    let hint = "leave cage.weights out, so that they are computed, or save them anew with cage.save_weights";
    let other = |what: &str| Failure::file(path, format!("these coordinates are of another {what}"), hint);
    let coordinates = request.coordinates.name();
    if saved.coordinates != coordinates {
        let what = format!("these are {} coordinates, not {coordinates}", saved.coordinates);
        return Err(Failure::file(path, what, hint));
    }
    let settings = settings(request);
    if saved.settings != settings {
        let what = format!("these coordinates were computed with {}, not {settings}", saved.settings);
        return Err(Failure::file(path, what, hint));
    }
    if saved.model != hash_of_points(model.points()) {
        return Err(other("model"));
    }
    if saved.cage != hash_of_cage(cage) {
        return Err(other("cage"));
    }
    Ok(saved.weights)
}

/// The mesh in a file.
pub fn document(path: &Path) -> Result<Document, Failure> {
    let failed = |error| Failure::read(path, &error);
    let format = Format::from_path(path).map_err(failed)?;
    Document::parse(files::bytes(path)?, format).map_err(failed)
}
