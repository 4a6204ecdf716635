//! The section `[cage]` of a job.

use std::path::PathBuf;

use glam::DVec3;

use crate::cage_binding::{CageOptions, Coordinates};
use crate::harmonic::HarmonicOptions;
use crate::lattice::Outside;
use crate::mesh::Mesh;
use crate::select::Selector;

/// The cage to deform with.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct CageRequest {
    /// The cage at rest: a closed mesh.
    pub file: Option<PathBuf>,
    /// The posed cage: a mesh with the same vertices in the same order, or CageModeler's moves of handles (`.param`).
    pub posed: Option<PathBuf>,
    /// How far the cage goes from rest (0) to the posed cage (1, the default): any number.
    pub blend: Option<f64>,
    /// The coordinates.
    pub coordinates: Coordinates,
    /// What happens to vertices outside; by default they follow the cage, too ("extend").
    pub outside: Option<Outside>,
    /// Cells of the grid of harmonic coordinates, along the longest side of the cage; by default a number that suits it.
    pub resolution: Option<usize>,
    /// Whether local stress at the model's vertices is reported.
    pub stress: bool,
    /// Saved coordinates of this model in this cage, instead of computing them.
    pub weights: Option<PathBuf>,
    /// Where to save the coordinates.
    pub save_weights: Option<PathBuf>,
    /// The vertices of the cage that restore the volume; the others stay where the edits put them. By default all do, as `preserve.pin` allows.
    pub free: Option<Selector>,
    /// Where local stress is measured that the objective "stress" makes small; by default at [`WitnessPoints::DEFAULT`] or more points inside the model.
    pub witnesses: Option<WitnessPoints>,
    /// Vertices of the cage whose drag planes are reported and drawn.
    pub planes: Option<Selector>,
}

/// Where local stress is measured.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize),
    serde(untagged, expecting = "`witnesses` must be a number of points or a list of places, such as [[0, 0, 0.5]]")
)]
pub enum WitnessPoints {
    /// At this number of points inside the model at rest, or a few more: those of a grid.
    Number(usize),
    /// At these points inside the cage at rest, model coordinates.
    Places(Vec<DVec3>),
}

impl WitnessPoints {
    /// How many where a request says nothing. More: time; fewer: parts of the model without any.
    pub const DEFAULT: usize = 256;

    /// The largest number. More: memory, 24 bytes for each vertex of the cage and each point.
    pub const MOST: usize = 100_000;
}

impl CageRequest {
    /// How the model is bound.
    #[must_use]
    pub fn options(&self) -> CageOptions {
        CageOptions {
            coordinates: self.coordinates,
            outside: self.outside.unwrap_or(Outside::Extend),
            harmonic: self.resolution.map(|resolution| HarmonicOptions { resolution }),
        }
    }
}

/// The cage of a job, as its files hold it: model coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct CageInput {
    /// The cage at rest.
    pub mesh: Mesh,
    /// Its vertices posed (#vertices × 3), where the job names a posed cage.
    pub posed: Option<Vec<DVec3>>,
    /// Saved coordinates (#model vertices × #controls, [`CageBinding::weights`](crate::CageBinding::weights)), where the job names them.
    pub weights: Option<Vec<f64>>,
}

/// A cage with a pose: model coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedCage {
    /// The cage at rest, with its faces.
    pub mesh: Mesh,
    /// Its vertices posed (#vertices × 3).
    pub posed: Vec<DVec3>,
}
