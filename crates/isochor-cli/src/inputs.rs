//! What a request's job works on beside its model: a lattice, a surface, a cage, read from their files.

use std::path::Path;

use glam::DVec3;
use isochor::{CageInput, JobInput, PosedLattice, Source, Surface};
use isochor_io::{Document, Format, lattice_from_json, patch_from_bytes};

use crate::failure::Failure;
use crate::files;
use crate::request::Request;

/// The files of a request, read.
pub struct Inputs {
    lattice: Option<PosedLattice>,
    surface: Option<Surface>,
    cage: Option<CageInput>,
}

impl Inputs {
    /// Reads the files that a request names.
    pub fn read(request: &Request) -> Result<Self, Failure> {
        Ok(Self { lattice: lattice(request)?, surface: surface(request)?, cage: cage(request)? })
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

fn cage(request: &Request) -> Result<Option<CageInput>, Failure> {
    let Some(cage) = &request.job.cage else { return Ok(None) };
    let Some(path) = &cage.file else { return Ok(None) }; // the job says that it is missing
    let mesh = document(path)?.mesh().clone();
    let posed = cage.posed.as_ref().map(|path| posed(path)).transpose()?;
    Ok(Some(CageInput { mesh, posed, weights: None }))
}

/// The vertices of a posed cage.
fn posed(path: &Path) -> Result<Vec<DVec3>, Failure> {
    Ok(document(path)?.mesh().points().to_vec())
}

/// The mesh in a file.
pub fn document(path: &Path) -> Result<Document, Failure> {
    let failed = |error| Failure::read(path, &error);
    let format = Format::from_path(path).map_err(failed)?;
    Document::parse(files::bytes(path)?, format).map_err(failed)
}
