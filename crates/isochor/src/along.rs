//! A job's model along a surface: flattened sheet, placement, subdivision, and the map, in this order (CO, section 3).
//!
//! # Changes versus the paper
//!
//! The volume of the placed model is restored, by [`crate::height_scale`] or by a lattice round what lies along the surface. Each step tells in its own
//! module what it does otherwise.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::flatten::{FlattenError, FlattenMethod, FlattenOptions, FlattenStatus, flatten};
use crate::mesh::{Mesh, MeshError};
use crate::outcome::Stage;
use crate::placement::{Beyond, PlacementError};
use crate::refinement::Refinement;
use crate::report::{Stopwatch, SurfaceReport};
use crate::subdivide::{SubdivideError, Subdivision, subdivide};
use crate::surface::Surface;
use crate::surface_request::{FlattenKind, Refine, SurfaceFolds, SurfaceRequest};
use crate::wrap::{Feet, Laid, Wrap, WrapError};

/// Why a model cannot be laid along a surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlongError {
    /// The surface cannot be flattened.
    #[error(transparent)]
    Flatten(#[from] FlattenError),
    /// The model cannot be placed on the sheet.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The model cannot be divided.
    #[error(transparent)]
    Subdivide(#[from] SubdivideError),
    /// The model cannot be laid on the surface.
    #[error(transparent)]
    Wrap(#[from] WrapError),
    /// What was divided is no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl AlongError {
    /// Whether the request is sound but cannot be met.
    pub(crate) fn is_unreachable(&self) -> bool {
        matches!(
            self,
            Self::Wrap(
                WrapError::Beyond { .. }
                    | WrapError::NoNormal { .. }
                    | WrapError::Singular { .. }
                    | WrapError::Folded(_)
            )
        )
    }

    pub(crate) fn place(&self) -> &'static str {
        match self {
            Self::Flatten(_) => "surface.grid",
            Self::Placement(_) | Self::Wrap(_) => "surface.place",
            Self::Subdivide(_) | Self::Mesh(_) => "surface.refine",
        }
    }

    pub(crate) fn hint(&self) -> &'static str {
        match self {
            Self::Flatten(_) => "change the surface, the grid or the reach",
            Self::Placement(_) => "correct the named value",
            Self::Subdivide(_) | Self::Mesh(_) => "take a coarser grid, a higher refine, or refine = \"off\"",
            Self::Wrap(WrapError::Folded(_)) => "make the model thinner, take folds = \"report\", or another surface",
            Self::Wrap(WrapError::Sheet(_)) => "raise the reach to 3 or more, or take a finer grid",
            Self::Wrap(_) => "move the model (place.at), or make it smaller",
        }
    }
}

/// A model laid along a surface.
#[derive(Clone, Debug)]
pub(crate) struct Along {
    /// The divided model at rest, model coordinates.
    pub(crate) rest: Mesh,
    /// How it was divided; none where nothing was added.
    pub(crate) refinement: Option<Refinement>,
    /// The divided model on the sheet.
    pub(crate) placed: Mesh,
    /// ∂(place on the sheet)/∂(model coordinates).
    matrix: DMat3,
    pub(crate) feet: Feet,
    /// As it was laid.
    pub(crate) posed: Arc<Laid>,
    /// With scaled heights.
    corrected: Arc<Laid>,
    pub(crate) report: SurfaceReport,
    wrap: Wrap,
    division: Option<Subdivision>,
}

impl Along {
    pub(crate) fn new(
        request: &SurfaceRequest,
        surface: &Surface,
        mesh: &Mesh,
        watch: &mut Stopwatch,
        on_stage: &mut dyn FnMut(Stage),
    ) -> Result<Self, AlongError> {
        let (cells, reach) = (request.cells(), request.steps());
        let method = match request.flatten {
            FlattenKind::QuasiNewton => FlattenMethod::QuasiNewton,
            // Half of what is stable.
            FlattenKind::Descent => FlattenMethod::Descent { step: 0.125 / ((2 * reach + 1).pow(2) - 1) as f64 },
        };
        let options = FlattenOptions { cells, reach, method, ..FlattenOptions::default() };
        let flattened = flatten(surface, &options)?;
        watch.lap("flatten");

        on_stage(Stage::Deform);
        let bounds = mesh.bounds().unwrap_or(crate::mesh::Bounds { min: DVec3::ZERO, max: DVec3::ZERO });
        let place = request.place.placed(bounds, &flattened.sheet)?;
        let on_sheet = mesh.with_points(place.points(mesh.points()))?;
        let division = match request.refine {
            Refine::Above(curvature) => {
                let extent = on_sheet.bounds().map_or(0.0, |bounds| bounds.extent());
                let threshold = if extent > 0.0 { curvature / extent } else { f64::INFINITY };
                Some(subdivide(&flattened.sheet, &on_sheet, threshold)?)
            }
            Refine::Word(_) => None,
        };
        watch.lap("divide");
        let refinement =
            division.as_ref().map(|division| &division.refinement).filter(|refinement| !refinement.vertices.is_empty());
        let (rest, placed) = match refinement {
            Some(refinement) => (refinement.mesh(mesh)?, refinement.mesh(&on_sheet)?),
            None => (mesh.clone(), on_sheet),
        };
        let wrap = match request.place.outside {
            Beyond::Refuse => Wrap::new(&flattened.sheet)?,
            Beyond::Extend => Wrap::covering(&flattened.sheet, placed.points())?,
        };
        let laid = wrap.laid(placed.points())?;
        let laid = if request.folds == SurfaceFolds::Refuse { laid.unfolded()? } else { laid };
        let feet = wrap.feet(placed.points())?;
        let kept = |points: &[crate::subdivide::SubdivisionPoint]| points.iter().filter(|point| point.is_kept).count();
        let report = SurfaceReport {
            cells,
            reach,
            scale: place.scale(),
            edge_points: division.as_ref().map_or(0, |division| kept(&division.edge_points)),
            face_points: division.as_ref().map_or(0, |division| kept(&division.face_points)),
            folds: laid.folds,
            height_scale: None,
            flattening: flattened.report,
        };
        let refinement = refinement.cloned();
        watch.lap(Stage::Deform.name());
        let (posed, matrix) = (Arc::new(laid), place.matrix());
        let corrected = Arc::clone(&posed);
        Ok(Self { rest, refinement, placed, matrix, feet, posed, corrected, report, wrap, division })
    }

    /// What a user should know of it.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let flattening = &self.report.flattening;
        if flattening.status != FlattenStatus::Converged {
            warnings.push(format!("The sheet was not flattened to the end after {} steps.", flattening.iterations));
        }
        if let Some(folds) = self.report.folds {
            warnings.push(format!(
                "The model folds at {} vertices, the first of them vertex {}: it is higher than the surface's radius of curvature there.",
                folds.count, folds.first
            ));
        }
        if self.report.scale != 1.0 {
            warnings.push(format!(
                "The model was placed {} times as large; its volume at rest is that of the placed model.",
                self.report.scale
            ));
        }
        warnings
    }

    /// All heights times `scale`, the vertices having gone to `points`.
    pub(crate) fn scaled(&mut self, scale: f64, points: Vec<DVec3>) -> Result<(), WrapError> {
        let places: Vec<DVec3> = self.placed.points().iter().map(|q| q.truncate().extend(scale * q.z)).collect();
        let mut laid = self.wrap.laid(&places)?;
        laid.jacobians.iter_mut().for_each(|j| j.z_axis *= scale);
        laid.points = points;
        self.report.folds = laid.folds;
        self.report.height_scale = Some(scale);
        self.corrected = Arc::new(laid);
        Ok(())
    }

    /// ∂(corrected)/∂(model coordinates) at each vertex.
    pub(crate) fn jacobians(&self) -> Vec<DMat3> {
        self.corrected.jacobians.iter().map(|j| *j * self.matrix).collect()
    }

    /// The same before heights were scaled.
    pub(crate) fn posed_jacobians(&self) -> Vec<DMat3> {
        self.posed.jacobians.iter().map(|j| *j * self.matrix).collect()
    }

    pub(crate) fn drawing(&self) -> SheetDrawing<'_> {
        SheetDrawing { wrap: &self.wrap, placed: &self.placed, division: self.division.as_ref() }
    }
}

/// What a picture of a flattened sheet with a model on it shows.
#[derive(Clone, Copy, Debug)]
pub struct SheetDrawing<'a> {
    wrap: &'a Wrap,
    /// The divided model on the sheet: x, y and height.
    pub placed: &'a Mesh,
    /// The points between which it was divided; none where it was not to be.
    pub division: Option<&'a Subdivision>,
}

impl<'a> SheetDrawing<'a> {
    /// The sheet.
    #[must_use]
    pub fn sheet(&self) -> &'a crate::sheet::Sheet {
        self.wrap.sheet()
    }

    /// Vertex points: how many of the placed vertices are the model's own.
    #[must_use]
    pub fn vertex_points(&self) -> usize {
        self.placed.points().len() - self.division.map_or(0, |division| division.refinement.vertices.len())
    }
}
