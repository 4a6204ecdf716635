//! Running a job: from a mesh to posed, corrected points and a report.
//!
//! All arithmetic is done relative to [`Bounds::lossless_origin`], so that a model far from the origin loses nothing; the
//! origin is added back at the end, and what that rounding costs is measured and reported.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::along::{Along, AlongError, SheetDrawing};
use crate::binding::{Binding, BoundVertices, displaced, translated};
use crate::body::{Body, Wish};
use crate::cage::CageError;
use crate::cage_binding::{CageBinding, CageBindingError, Coordinates};
use crate::cage_correction::{CagePose, corrected};
use crate::cage_request::{CageInput, PosedCage, WitnessPoints};
use crate::controls::{Controls, Deformer, Saved};
use crate::correct::{CorrectError, CorrectOptions, Correction, Method, Pose, Reason, Status, Wanted, correct_last};
use crate::drag_plane::DragPlane;
use crate::edit::{Edit, EditError};
use crate::elastic::{ElasticError, ElasticWanted};
use crate::elastic_job::ElasticTask;
use crate::energy::Energy;
use crate::goals::{Components, VolumeGoal};
use crate::health::{Health, Source};
use crate::height_scale::{HeightScaleError, scaled_heights};
use crate::job::{
    AxisLetters, Directions, Falloff, Job, LatticeRequest, MethodKind, MobilityKind, Objective, PointRequest, Preserve,
    VolumeTarget,
};
use crate::lattice::{Lattice, LatticeError};
use crate::least_stress::{LeastStressReport, StressError, Witnesses, relaxed};
use crate::local_stress::StressReport;
use crate::locality::{LocalityOptions, local_mobility};
use crate::mesh::{Bounds, Mesh, MeshError};
use crate::parallel;
use crate::points::PointTarget;
use crate::preview::Preview;
use crate::refinement::Refinement;
use crate::report::{CageJobReport, CorrectionReport, DragPlaneReport, Report, Stopwatch};
use crate::select::{ControlSpace, SelectError};
use crate::surface::Surface;
use crate::surface_request::{SurfaceFolds, SurfaceRequest, SurfaceRequestError};
use crate::tolerances;
use crate::topology::topology;
use crate::volume::{OpenBoundaries, Solid, SolidError, Volumes, opening};
use crate::witnesses::inside;
use crate::wrap::WrapError;

/// A lattice with a pose, as files hold it: model coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedLattice {
    /// Bases and frame.
    pub lattice: Lattice,
    /// Rest positions C⁰ (#controls × 3).
    pub rest: Vec<DVec3>,
    /// Posed positions C (#controls × 3).
    pub posed: Vec<DVec3>,
    /// Mobility of each control coordinate (#controls × 3); `None`: 1 everywhere.
    pub mobility: Option<Vec<DVec3>>,
}

/// What a job works on: files have been read by the caller.
#[derive(Clone, Copy, Debug)]
pub struct JobInput<'a> {
    /// The model.
    pub mesh: &'a Mesh,
    /// Where it came from.
    pub source: &'a Source,
    /// The lattice of [`LatticeRequest::file`], where the job names one.
    pub lattice: Option<&'a PosedLattice>,
    /// The surface of [`SurfaceRequest::file`](crate::SurfaceRequest::file), where the job names one.
    pub surface: Option<&'a Surface>,
    /// The cage of [`CageRequest::file`](crate::CageRequest::file), where the job names one.
    pub cage: Option<&'a CageInput>,
}

/// What a job finds out about its model before anything else.
#[derive(Clone, Debug)]
pub struct Examination {
    /// What the model is.
    pub health: Health,
    /// Why it is refused where open models are; `None` where it is balanced.
    opening: Option<SolidError>,
    body: Result<Arc<Body>, SolidError>,
}

impl Examination {
    /// Examines `mesh`, which came from `source`.
    #[must_use]
    pub fn of(mesh: &Mesh, source: &Source) -> Self {
        let topology = topology(mesh);
        let (health, solid) = Health::of(mesh, &topology, source);
        let body = solid.map(|solid| {
            let rest = health.volume.clone().unwrap_or_else(|| solid.volumes(mesh.points()));
            Arc::new(Body::new(solid, rest, &health.roles))
        });
        Self { health, opening: opening(&topology), body }
    }
}

/// A stage of a job, for progress displays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Topology and rest volume.
    Examine,
    /// Weights of every vertex.
    Bind,
    /// Edits and posed vertices.
    Deform,
    /// Volume correction.
    Correct,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 4] = [Self::Examine, Self::Bind, Self::Deform, Self::Correct];

    /// Its name, also the key of its time in the report.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Examine => "examine",
            Self::Bind => "bind",
            Self::Deform => "deform",
            Self::Correct => "correct",
        }
    }
}

/// The result of a job.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Deformed points (#vertices × 3), model coordinates. Points that did not move have the bits they had.
    pub points: Vec<DVec3>,
    /// The lattice after the correction, model coordinates; `None` where the job deforms nothing, or by a cage.
    pub controls: Option<PosedLattice>,
    /// The cage after the correction, model coordinates, where there is one.
    pub cage: Option<PosedCage>,
    /// What happened.
    pub report: Report,
    /// The body, where the model bounds one.
    body: Option<Arc<Body>>,
    deformation: Option<Deformation>,
    along: Option<Along>,
    net: Option<NetDrawing>,
}

/// Lines between control points that are not those of a lattice: what pictures show of springs and cages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetDrawing {
    /// What the lines are.
    pub kind: NetKind,
    /// The control points at the ends of each: flat indices.
    pub ends: Vec<[u32; 2]>,
    /// Which control points have no free coordinate (#controls): the others settled, or restored the volume.
    pub is_held: Vec<bool>,
}

/// What lines between control points are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetKind {
    /// Springs, with the method "elastic".
    Springs,
    /// Edges of a cage.
    Cage,
}

/// A deformation by a lattice or a cage, relative to the job's origin.
#[derive(Clone, Debug)]
struct Deformation {
    deformer: Deformer,
    /// C − C⁰ (#controls × 3): what the edits did.
    posed: Vec<DVec3>,
    /// C + δ − C⁰ (#controls × 3).
    displacement: Vec<DVec3>,
    rest_points: Arc<Vec<DVec3>>,
    /// What to add to positions here to have model coordinates.
    origin: DVec3,
    /// C⁰ (#controls × 3).
    rest_controls: Vec<DVec3>,
}

/// The model between rest and result: what pictures show of a job beside both.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Points after the edits, before the correction (#vertices × 3), model coordinates.
    pub posed: Vec<DVec3>,
    /// Control points then (#controls × 3), model coordinates.
    pub posed_controls: Vec<DVec3>,
    /// det ∂(posed)/∂(rest) at each vertex (#vertices): by what factor the volume of a small piece changed.
    pub posed_change: Vec<f64>,
    /// det ∂(corrected)/∂(rest) at each vertex (#vertices).
    pub corrected_change: Vec<f64>,
}

/// Why a job gives no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum JobError {
    /// The lattice cannot be made, or vertices are outside.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// The cage is none.
    #[error(transparent)]
    Cage(#[from] CageError),
    /// The model cannot be bound to the cage.
    #[error(transparent)]
    CageBinding(#[from] CageBindingError),
    /// The surface cannot be made.
    #[error(transparent)]
    Surface(#[from] SurfaceRequestError),
    /// The model cannot be laid along the surface.
    #[error(transparent)]
    Along(#[from] AlongError),
    /// Heights over the surface cannot restore the volume.
    #[error(transparent)]
    Heights(#[from] HeightScaleError),
    /// An edit is impossible.
    #[error("edit {}: {source}", .index + 1)]
    Edit {
        /// Its place in the list, from 0.
        index: usize,
        /// What is wrong with it.
        source: EditError,
    },
    /// A pin picks no control points.
    #[error("pin: {0}")]
    Pin(SelectError),
    /// Free vertices of a cage that are none.
    #[error("cage.free: {0}")]
    Free(SelectError),
    /// Vertices of a cage for drag planes that are none.
    #[error("cage.planes: {0}")]
    Planes(SelectError),
    /// The model bounds no body whose volume could be preserved.
    #[error(transparent)]
    Solid(#[from] SolidError),
    /// The model encloses nothing.
    #[error("the model encloses no volume: |{volume:e}| is rounding noise for its area and extent")]
    NoVolume {
        /// What was measured.
        volume: f64,
    },
    /// The correction is impossible.
    #[error(transparent)]
    Correct(#[from] CorrectError),
    /// One of several wanted volumes cannot be met.
    #[error("{name} cannot become {target:?} (it is {volume:?}): impossible, because {reason}")]
    Volume {
        /// Which of them, such as "the capacity of component 2".
        name: String,
        /// Where the request asks for it.
        place: String,
        /// The wanted volume, positive as the request has it.
        target: f64,
        /// That volume of the pose, counted in the same way.
        volume: f64,
        /// Why not.
        reason: Reason,
    },
    /// The correction is impossible with the controls that the mobility "auto" lets move.
    #[error("with mobility \"auto\" only control points where volume was lost can move: {0}")]
    Local(Box<Self>),
    /// A dragged vertex cannot be at its target after the correction.
    #[error(
        "edit {}: drag: vertex {vertex} misses its target by {by:.3e} whatever the correction does, given the other points, the \
         mobilities and the axes",
        .index + 1
    )]
    Dragged {
        /// Place of the edit in the list, from 0.
        index: usize,
        /// The vertex.
        vertex: usize,
        /// By how far it misses.
        by: f64,
    },
    /// The method "nearest" did not come to the smallest displacement.
    #[error("the nearest pose was not found: its condition is missed by {residual:.1e} extents, more than {limit:e}")]
    NotConverged {
        /// How far its condition is missed.
        residual: f64,
        /// How far it may be.
        limit: f64,
    },
    /// Nodes to hold that pick none.
    #[error("elastic.hold: {0}")]
    Hold(SelectError),
    /// Nodes cannot settle.
    #[error(transparent)]
    Elastic(ElasticError),
    /// Nodes have not settled.
    #[error(
        "the nodes have not settled: after {steps} steps forces are off balance by {residual:.1e}, more than {:e}",
        tolerances::BALANCE_ENOUGH
    )]
    NotSettled {
        /// The largest force that nothing balances, in forces that stretch a spring by its own length.
        residual: f64,
        /// Steps.
        steps: usize,
    },
    /// Values that contradict one another or are out of range.
    #[error("{key} {problem}")]
    Value {
        /// The key.
        key: &'static str,
        /// What is wrong with its value.
        problem: String,
    },
    /// A vertex that does not exist.
    #[error("{key} names vertex {vertex}, but the model has {vertices} (0 to {})", .vertices.saturating_sub(1))]
    MissingVertex {
        /// The key.
        key: &'static str,
        /// The vertex.
        vertex: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A component that does not exist.
    #[error("{place} names component {component}, but the model has {components} (0 to {})", .components.saturating_sub(1))]
    MissingComponent {
        /// Which part.
        place: String,
        /// The component.
        component: usize,
        /// Number of components.
        components: usize,
    },
    /// Material or capacity of a model that has no cavities.
    #[error("the model has no cavities, so it has no capacity and its material is the whole volume{}", match .inward {
        Some(component) => format!("; component {component} is wound inwards, but lies inside no other"),
        None => String::new(),
    })]
    NoCavities {
        /// The first inward component, which is inside nothing.
        inward: Option<usize>,
    },
}

impl From<ElasticError> for JobError {
    fn from(error: ElasticError) -> Self {
        match error {
            ElasticError::Correct(error) => Self::Correct(error),
            other => Self::Elastic(other),
        }
    }
}

impl From<MeshError> for JobError {
    fn from(error: MeshError) -> Self {
        Self::Cage(error.into())
    }
}

impl JobError {
    /// Of a correction that was to fulfil wishes and to bring points to their places, with mobilities "auto" if it `is_local`.
    fn of_correction(error: CorrectError, wishes: &[Wish], points: &[WantedPoint], is_local: bool) -> Self {
        if let CorrectError::Impossible {
            reason: Reason::Contradiction { point, by } | Reason::OffAxes { point, by },
            ..
        } = error
            && let WantedPoint { request: PointRequest { vertex, .. }, edit: Some(index) } = points[point]
        {
            return Self::Dragged { index, vertex, by };
        }
        let error = Wish::error_of(wishes, error);
        match error.reason() {
            Some(
                Reason::Pinned
                | Reason::Dead
                | Reason::Turns { .. }
                | Reason::Coupled { .. }
                | Reason::Contradiction { .. },
            ) if is_local => Self::Local(Box::new(error)),
            _ => error,
        }
    }

    /// Why what is asked of the correction is impossible.
    fn reason(&self) -> Option<&Reason> {
        match self {
            Self::Correct(CorrectError::Impossible { reason, .. }) | Self::Volume { reason, .. } => Some(reason),
            _ => None,
        }
    }

    /// Whether the request is sound but cannot be met; otherwise the input is bad.
    #[must_use]
    pub fn is_unreachable(&self) -> bool {
        match self {
            Self::Edit { source, .. } => source.is_unreachable(),
            Self::Along(error) => error.is_unreachable(),
            _ => matches!(
                self,
                Self::Correct(CorrectError::Impossible { .. } | CorrectError::Energy { .. })
                    | Self::Volume { .. }
                    | Self::Lattice(LatticeError::Outside { .. })
                    | Self::CageBinding(CageBindingError::Outside { .. })
                    | Self::Solid(_)
                    | Self::NoVolume { .. }
                    | Self::NotConverged { .. }
                    | Self::NotSettled { .. }
                    | Self::Elastic(ElasticError::Held | ElasticError::NoPose | ElasticError::TooLarge { .. })
                    | Self::Dragged { .. }
                    | Self::Local(_)
                    | Self::Heights(_)
            ),
        }
    }

    /// A short word for programs.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Lattice(LatticeError::Outside { .. }) | Self::CageBinding(CageBindingError::Outside { .. }) => {
                "outside"
            }
            Self::Lattice(_) => "lattice",
            Self::Cage(_) | Self::CageBinding(_) => "cage",
            Self::Surface(_) => "surface",
            Self::Along(AlongError::Wrap(WrapError::Beyond { .. })) => "outside",
            Self::Along(AlongError::Wrap(WrapError::Folded(_))) => "folds",
            Self::Along(_) => "surface",
            Self::Heights(_) => "impossible",
            Self::Edit { source, .. } if source.is_unreachable() => "impossible",
            Self::Edit { .. } => "edit",
            Self::Pin(_) => "pin",
            Self::Hold(_) => "hold",
            Self::Free(_) | Self::Planes(_) => "cage",
            Self::Elastic(ElasticError::TooLarge { .. }) => "memory",
            Self::Elastic(ElasticError::Held | ElasticError::NoPose) => "impossible",
            Self::Elastic(_) => "elastic",
            Self::NotSettled { .. } => "not-converged",
            Self::Solid(SolidError::Open { .. }) => "open",
            Self::Solid(SolidError::Winding { .. }) => "winding",
            Self::Solid(_) | Self::NoVolume { .. } => "no-volume",
            Self::Correct(CorrectError::Impossible { .. })
            | Self::Volume { .. }
            | Self::Dragged { .. }
            | Self::Local(_) => "impossible",
            Self::Correct(CorrectError::Energy { .. }) => "memory",
            Self::Correct(_) => "correct",
            Self::NotConverged { .. } => "not-converged",
            Self::Value { .. } => "value",
            Self::MissingVertex { .. } => "missing-vertex",
            Self::MissingComponent { .. } => "missing-component",
            Self::NoCavities { .. } => "no-cavities",
        }
    }

    /// The part of the job that is meant.
    #[must_use]
    pub fn place(&self) -> String {
        match self {
            Self::Lattice(LatticeError::Outside { .. }) => "lattice.outside".into(),
            Self::Lattice(_) => "lattice".into(),
            Self::CageBinding(CageBindingError::Outside { .. }) => "cage.outside".into(),
            Self::CageBinding(CageBindingError::NoTetrahedron { .. }) => "cage.coordinates".into(),
            Self::CageBinding(CageBindingError::Weights { .. }) => "cage.weights".into(),
            Self::CageBinding(CageBindingError::Harmonic(_)) => "cage.resolution".into(),
            Self::Cage(_) | Self::CageBinding(_) => "cage.file".into(),
            Self::Surface(_) => "surface".into(),
            Self::Along(error) => error.place().into(),
            Self::Heights(_) => "preserve.method".into(),
            Self::Edit { index, .. } | Self::Dragged { index, .. } => format!("edit[{index}]"),
            Self::Pin(_) => "preserve.pin".into(),
            Self::Hold(_) | Self::Elastic(ElasticError::Held) => "elastic.hold".into(),
            Self::Free(_) => "cage.free".into(),
            Self::Planes(_) => "cage.planes".into(),
            Self::Elastic(ElasticError::Moments) => "elastic.center_of_mass".into(),
            Self::Elastic(ElasticError::TooLarge { .. }) => "lattice.size".into(),
            Self::Elastic(_) | Self::NotSettled { .. } => "elastic".into(),
            Self::Solid(SolidError::Open { .. }) => "preserve.open".into(),
            Self::Solid(_) | Self::NoVolume { .. } => "model".into(),
            Self::Correct(CorrectError::Impossible {
                reason:
                    Reason::Contradiction { point, .. }
                    | Reason::OffAxes { point, .. }
                    | Reason::PointRounding { point, .. },
                ..
            }) => format!("preserve.points[{point}]"),
            Self::Local(error) => match error.reason() {
                Some(Reason::Contradiction { .. }) => error.place(),
                _ => "preserve.mobility".into(),
            },
            Self::Volume { place, .. } => place.clone(),
            Self::Correct(CorrectError::Energy { .. }) => "preserve.objective".into(),
            Self::Correct(_) => "preserve".into(),
            Self::NotConverged { .. } => "preserve.method".into(),
            Self::Value { key, .. } | Self::MissingVertex { key, .. } => (*key).into(),
            Self::MissingComponent { place, .. } => place.clone(),
            Self::NoCavities { .. } => "preserve.volume".into(),
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Lattice(LatticeError::Outside { .. }) => {
                "enlarge the lattice (margin), or choose outside = \"keep\" or \"extend\""
            }
            Self::Lattice(_) => "change the size, degree, knots or frame of the lattice",
            Self::Cage(_) => {
                "a cage is a closed mesh; isochor cage makes one, isochor info says what is wrong with one"
            }
            Self::CageBinding(CageBindingError::Outside { .. }) => {
                "enlarge the cage, or choose outside = \"extend\" or \"keep\""
            }
            Self::CageBinding(CageBindingError::NoTetrahedron { .. }) => "choose other coordinates",
            Self::CageBinding(CageBindingError::Weights { .. }) => "leave the weights out, so that they are computed",
            Self::CageBinding(CageBindingError::Harmonic(_)) => "choose a finer resolution, or other coordinates",
            Self::CageBinding(CageBindingError::NotFinite { .. }) => "choose a cage that does not cross itself",
            Self::Surface(_) => "correct the named key; the docs page of surfaces lists the keys of each kind",
            Self::Along(error) => error.hint(),
            Self::Heights(_) => "choose method = \"nearest\", which lays a lattice round the model, or another volume",
            Self::Edit { source, .. } if source.is_unreachable() => {
                "choose other targets or more nodes, or a lattice that holds the vertex"
            }
            Self::Edit { .. } => "correct the edit; its formulas and keys are on the docs page of edits",
            Self::Pin(_) | Self::Hold(_) | Self::Free(_) | Self::Planes(_) => "choose control points that exist",
            Self::Elastic(ElasticError::Held) => "hold fewer nodes: hold = \"edited\" holds those that an edit moved",
            Self::Elastic(ElasticError::TooLarge { .. }) => "choose fewer control points",
            Self::Elastic(_) => "hold fewer nodes, or ask for less at once",
            Self::NotSettled { .. } => "deform in smaller steps, or hold more nodes",
            Self::Solid(SolidError::Open { .. }) => "close the model, or allow virtual caps with open = \"cap\"",
            Self::Solid(SolidError::Winding { .. }) => {
                "orient the faces consistently in a modelling program, or deform with volume = \"free\""
            }
            Self::Solid(_) | Self::NoVolume { .. } => "deform with volume = \"free\"",
            Self::Volume { reason: Reason::Follows { .. }, .. } => {
                "leave out one of the volumes that contradict one another"
            }
            Self::Volume { reason: Reason::Coupled { .. }, .. } => {
                "free more controls, take a finer lattice, or ask for fewer volumes at once"
            }
            Self::Correct(CorrectError::Energy { .. }) => "choose objective = \"controls\", or fewer control points",
            Self::Correct(CorrectError::Impossible { .. }) | Self::Volume { .. } => {
                "free more controls, choose other axes, enlarge the lattice, or ask for another volume"
            }
            Self::Dragged { .. } => {
                "free more controls, leave out points that contradict it, or drag the vertex elsewhere"
            }
            Self::Local(_) => "choose mobility = \"uniform\", pin less, or ask for fewer points",
            Self::Correct(_) => "correct the named value",
            Self::NotConverged { .. } => "choose the method \"gradient\", or ask for less change",
            Self::Value { .. } => "correct or leave out the key",
            Self::MissingVertex { .. } => "vertices are counted from 0 in file order",
            Self::MissingComponent { .. } => "components are counted from 0; isochor info lists them",
            Self::NoCavities { .. } => {
                "isochor info lists components and cavities; volume = \"100%\" keeps the volume of the whole model"
            }
        }
    }
}

impl Job {
    /// Runs the job. `on_stage` is called as each stage begins.
    ///
    /// Without a deformer and without edits the points come back bit for bit, whatever the model is, unless a volume is
    /// asked for other than that at rest.
    ///
    /// # Errors
    ///
    /// Impossible requests and bad values; see [`JobError::is_unreachable`] for which is which.
    pub fn run(&self, input: &JobInput, on_stage: &mut dyn FnMut(Stage)) -> Result<Outcome, JobError> {
        let mut watch = Stopwatch::start();
        on_stage(Stage::Examine);
        let examination = Examination::of(input.mesh, input.source);
        watch.lap(Stage::Examine.name());
        self.run_after(examination, input, watch, on_stage)
    }

    /// [`Job::run`] for a model that has been examined: what many jobs on one model share.
    ///
    /// # Errors
    ///
    /// As [`Job::run`].
    pub fn run_examined(
        &self,
        examination: &Examination,
        input: &JobInput,
        on_stage: &mut dyn FnMut(Stage),
    ) -> Result<Outcome, JobError> {
        self.run_after(examination.clone(), input, Stopwatch::start(), on_stage)
    }

    fn run_after(
        &self,
        examination: Examination,
        input: &JobInput,
        mut watch: Stopwatch,
        on_stage: &mut dyn FnMut(Stage),
    ) -> Result<Outcome, JobError> {
        if let Some(request) = &self.surface {
            return self.run_along(request, examination, input, watch, on_stage);
        }
        let mesh = input.mesh;
        let Examination { opening, health, body } = examination;
        let mut warnings = health.warnings.clone();
        let report = |volume, correction, warnings, watch: Stopwatch| Report {
            version: env!("CARGO_PKG_VERSION").into(),
            model: health,
            volume,
            correction,
            folds: "off".into(),
            timings_ms: watch.timings(),
            peak_memory: None,
            warnings,
            surface: None,
            elastic: None,
            cage: None,
        };
        let elastic_request = self.elastic_request()?;
        if self.changes_nothing() {
            let body = body.ok();
            let volume = body.as_ref().map(|body| body.rows(&body.rest, &body.rest, &[]));
            let report = report(volume, CorrectionReport::not_asked(), warnings, watch);
            return Ok(Outcome {
                points: mesh.points().to_vec(),
                controls: None,
                cage: None,
                report,
                body,
                deformation: None,
                along: None,
                net: None,
            });
        }

        on_stage(Stage::Bind);
        let Some(bounds) = mesh.bounds() else {
            return Err(JobError::Value {
                key: "model",
                problem: "has no vertices, so there is nothing to deform".into(),
            });
        };
        let (origin, extent) = (bounds.lossless_origin(), bounds.extent());
        let rest_points = match origin {
            DVec3::ZERO => mesh.shared_points(),
            _ => Arc::new(parallel::collect(mesh.points().len(), |v| mesh.points()[v] - origin)),
        };
        let near = Bounds { min: bounds.min - origin, max: bounds.max - origin };
        let controls = self.controls(input, near, &rest_points, origin, &mut warnings)?;
        let deformer = controls.deformer.clone();
        let binding = deformer.binding(&rest_points, self.portable_bits)?;
        if deformer.cage().is_none() && binding.kept_count() > 0 {
            let (kept, all) = (binding.kept_count(), binding.vertex_count());
            warnings.push(format!("{kept} of {all} vertices are outside the lattice and stay where they are."));
        }
        watch.lap(Stage::Bind.name());

        on_stage(Stage::Deform);
        let space = ControlSpace {
            rest: &controls.rest,
            size: deformer.size(),
            bounds: deformer.bounds(),
            extent,
            origin,
            vertices: deformer.is_linear().then_some(BoundVertices { rest: &rest_points, binding: &binding }),
            solid: body.as_ref().ok().map(|body| &body.solid),
        };
        let planes = match self.cage.as_ref().and_then(|request| request.planes.as_ref()) {
            Some(planes) => planes.weights(&space).map_err(JobError::Planes)?,
            None => vec![0.0; controls.rest.len()],
        };
        let mut posed = controls.posed.clone();
        let mut is_edited: Vec<bool> = posed.iter().zip(&controls.rest).map(|(posed, rest)| posed != rest).collect();
        for (index, edit) in self.edit.iter().enumerate() {
            let before = posed.clone();
            edit.apply(&mut posed, &space).map_err(|source| JobError::Edit { index, source })?;
            // A dragged vertex is held as a point.
            if !matches!(edit, Edit::Drag(_)) {
                is_edited.iter_mut().zip(before.iter().zip(&posed)).for_each(|(edited, (a, b))| *edited |= a != b);
            }
        }
        let edited: Vec<DVec3> = posed.iter().zip(&controls.rest).map(|(p, r)| *p - *r).collect();
        let mut displacement = edited.clone();
        let mut points = binding.displaced(&rest_points, &deformer.spread(&controls.rest, &displacement));
        watch.lap(Stage::Deform.name());

        on_stage(Stage::Correct);
        let (volume, correction, kept);
        let (mut elastic, mut least_stress) = (None, None);
        let mut net = deformer.cage().map(|cage| NetDrawing {
            kind: NetKind::Cage,
            ends: cage.cage().mesh_edges(),
            is_held: vec![false; controls.rest.len()],
        });
        if let Some(request) = &elastic_request {
            let Some((lattice, _)) = deformer.lattice() else {
                let problem =
                    "is \"elastic\", whose springs lie between the points of a lattice; choose another for a cage"
                        .into();
                return Err(JobError::Value { key: "preserve.method", problem });
            };
            let body = body.clone()?;
            if let (OpenBoundaries::Refuse, Some(opening)) = (self.preserve.open, opening) {
                return Err(opening.into());
            }
            let posed_volumes = body.solid.volumes(&points);
            let wishes = match self.preserve.volume {
                VolumeTarget::Free => Vec::new(),
                _ => self.checked_wishes(&body, [mesh.points(), &points], &posed_volumes, &mut warnings)?,
            };
            let wanted_points = self.wanted_points();
            let goals: Vec<VolumeGoal> = wishes.iter().map(|wish| wish.goal.clone()).collect();
            let task = ElasticTask {
                request,
                lattice,
                solid: &body.solid,
                binding: &binding,
                points: &rest_points,
                rest: &controls.rest,
                posed: &posed,
                is_edited: &is_edited,
                mobility: controls.mobility.as_deref(),
                along: self.preserve.axes.as_ref().map_or(DVec3::ONE, |axes| axes.vectors().iter().sum()),
                pin: self.preserve.pin.as_ref(),
                space: &space,
            };
            let wanted = ElasticWanted {
                volumes: goals.clone(),
                points: self.points(&wanted_points, &binding, &rest_points, origin)?,
                moments: None,
            };
            let (settled, settled_report, drawing) = task.settled(wanted, origin).map_err(|error| match error {
                JobError::Correct(error) => JobError::of_correction(error, &wishes, &wanted_points, false),
                other => other,
            })?;
            let moved = &settled.correction.vertices;
            correction =
                CorrectionReport::of_springs(&settled.correction, settled_report.steps, &points, moved, extent);
            posed = settled.places;
            displacement = posed.iter().zip(&controls.rest).map(|(p, r)| *p - *r).collect();
            points = settled.correction.vertices;
            let end = Volumes { total: settled.correction.volume, components: settled.correction.component_volumes };
            volume =
                Some(if goals.is_empty() { body.free_rows(&points) } else { body.rows(&posed_volumes, &end, &goals) });
            (elastic, net) = (Some(settled_report), Some(drawing));
            kept = Some(body);
        } else if self.preserve.volume == VolumeTarget::Free {
            kept = body.clone().ok();
            volume = kept.as_ref().map(|body| body.free_rows(&points));
            correction = CorrectionReport::not_asked();
        } else {
            let body = body.clone()?;
            if let (OpenBoundaries::Refuse, Some(opening)) = (self.preserve.open, opening) {
                return Err(opening.into());
            }
            let (method, coordinates) = self.method()?;
            let mut mobility = self.mobility(controls.mobility.as_deref(), &space, &rest_points)?;
            mobility.iter_mut().for_each(|m| *m *= coordinates);
            if self.preserve.objective == Objective::Stress {
                self.hold_edited(&mut mobility, &is_edited);
            }
            if let Some(net) = &mut net {
                net.is_held = mobility.iter().map(|m| *m == DVec3::ZERO).collect();
            }
            let posed_volumes = body.solid.volumes(&points);
            let wishes = self.checked_wishes(&body, [mesh.points(), &points], &posed_volumes, &mut warnings)?;
            let is_local = self.preserve.mobility == MobilityKind::Auto;
            if is_local {
                let Some((lattice, outside)) = deformer.lattice() else {
                    let problem = "is \"auto\", which goes by the cells of a lattice; name the vertices of the cage with cage.free".into();
                    return Err(JobError::Value { key: "preserve.mobility", problem });
                };
                let (posed, wanted) = body.relative_sizes(&wishes, &posed_volumes);
                let options = LocalityOptions { vertices: &rest_points, outside, posed, wanted };
                let local = local_mobility(lattice, &displacement, &options);
                mobility.iter_mut().zip(local).for_each(|(m, local)| *m *= local);
            }
            let wanted_points = self.wanted_points();
            let goals: Vec<VolumeGoal> = wishes.iter().map(|wish| wish.goal.clone()).collect();
            let wanted = Wanted { volumes: goals, points: self.points(&wanted_points, &binding, &points, origin)? };
            let energy = match self.preserve.objective {
                Objective::Controls | Objective::Stress => None,
                Objective::Surface => Some(Energy::surface(&binding)?),
                Objective::Edges => Some(match &deformer {
                    Deformer::Lattice(lattice, _) => Energy::edges(lattice)?,
                    Deformer::Cage(cage) => Energy::of_cage(cage.cage())?,
                }),
                Objective::Bending => {
                    let Some((lattice, _)) = deformer.lattice() else {
                        let problem = "is \"bending\", which goes by the lines of a lattice; choose \"edges\" or \"surface\" for a cage".into();
                        return Err(JobError::Value { key: "preserve.objective", problem });
                    };
                    Some(Energy::bending(lattice)?)
                }
            };
            let options = CorrectOptions { method, mobility: Some(mobility), energy };
            let corrected = match self.preserve.preview {
                _ if self.preserve.objective == Objective::Stress => {
                    let Some(cage) = deformer.cage() else {
                        let problem = "is \"stress\", which is measured at points in a cage; choose \"edges\" or \"surface\" for a lattice";
                        return Err(JobError::Value { key: "preserve.objective", problem: problem.into() });
                    };
                    self.check_derivatives(&options.method, "the objective \"stress\"")?;
                    if options.method != Method::Nearest {
                        let problem =
                            "must be \"nearest\" with the objective \"stress\", which searches all directions";
                        return Err(JobError::Value { key: "preserve.method", problem: problem.into() });
                    }
                    let witnesses = self.witnesses(cage, &body.solid, &rest_points, origin)?;
                    let (solid, rest, mobility) =
                        (&body.solid, &rest_points[..], options.mobility.as_deref().unwrap_or_default());
                    let pose = CagePose { cage, solid, rest, posed: &posed, mobility, extent };
                    match relaxed(&pose, &wanted, &witnesses) {
                        Ok((correction, report)) => {
                            if let Some(LeastStressReport { is_settled: false, steps, .. }) = &report {
                                warnings.push(format!(
                                    "The search for the least stress used up its {steps} steps: the volume is exact, but other poses may have less \
                                     stress. Free fewer vertices of the cage, or more of those near the moved ones."
                                ));
                            }
                            least_stress = report;
                            Ok(correction)
                        }
                        Err(StressError::Correct(error)) => Err(error),
                        Err(error @ StressError::NoMeasure { .. }) => {
                            let problem = format!("cannot be used: {error}; name others, or move the cage less");
                            return Err(JobError::Value { key: "cage.witnesses", problem });
                        }
                    }
                }
                _ if !deformer.is_linear() => self.by_normals(&options, |mobility, is_nearest| {
                    let cage = deformer.cage().expect("Green coordinates are a cage's");
                    let (solid, rest) = (&body.solid, &rest_points[..]);
                    corrected(&CagePose { cage, solid, rest, posed: &posed, mobility, extent }, &wanted, is_nearest)
                })?,
                None => correct_last(&body.solid, binding, &points, &wanted, &options),
                Some(0) => {
                    let problem = "is 0: it is a number of triangles, such as 20000".into();
                    return Err(JobError::Value { key: "preserve.preview", problem });
                }
                Some(triangles) => {
                    let pose = Pose { solid: &body.solid, vertices: &points, binding: &binding };
                    let preview = Preview::new(&pose, triangles)?;
                    watch.lap("simplify");
                    let corrected = preview.correct(&pose, &wanted, &options);
                    if let Ok(Correction { status: Status::Preview, relative_error, .. }) = &corrected {
                        let (few, all) = (preview.triangle_count(), body.solid.triangle_count());
                        warnings.push(format!(
                            "This is a preview: the volume is approximate, off by {relative_error:.1e} of the target, because {few} of {all} \
                             triangles were corrected. Leave preview out for the exact volume."
                        ));
                    }
                    corrected
                }
            };
            let corrected =
                corrected.map_err(|error| JobError::of_correction(error, &wishes, &wanted_points, is_local))?;
            if let (Status::NotNearest, Some(residual)) = (corrected.status, corrected.residual) {
                return Err(JobError::NotConverged { residual, limit: tolerances::KKT_ENOUGH });
            }
            correction = CorrectionReport {
                objective: self.preserve.objective.name().into(),
                ..CorrectionReport::of(&corrected, &options.method, &points, extent)
            };
            displacement = displaced(&displacement, &corrected.displacement);
            posed = displaced(&posed, &corrected.displacement);
            points = corrected.vertices;
            let end = Volumes { total: corrected.volume, components: corrected.component_volumes };
            volume = Some(body.rows(&posed_volumes, &end, &wanted.volumes));
            kept = Some(body);
        }
        watch.lap(Stage::Correct.name());

        let is_stressed = self.cage.as_ref().is_some_and(|request| request.stress);
        let cage = match deformer.cage() {
            Some(cage) => Some(CageJobReport {
                least_stress,
                ..Self::cage_report(cage, body.as_ref(), &rest_points, &posed, &planes, is_stressed, origin)?
            }),
            None => None,
        };
        let (saved, saved_cage) = match controls.in_model_coordinates(&posed, origin)? {
            Saved::Lattice(lattice) => (Some(*lattice), None),
            Saved::Cage(cage) => (None, Some(cage)),
        };
        Ok(Outcome {
            points: if origin == DVec3::ZERO { points } else { translated(&points, origin) },
            controls: saved,
            cage: saved_cage,
            report: Report { elastic, cage, ..report(volume, correction, warnings, watch) },
            body: kept,
            deformation: Some(Deformation {
                deformer,
                posed: edited,
                displacement,
                rest_points,
                origin,
                rest_controls: controls.rest,
            }),
            along: None,
            net,
        })
    }

    /// A correction of a cage whose normals turn with its vertices: of its mobilities, to the nearest pose or along the gradient.
    fn by_normals(
        &self,
        options: &CorrectOptions,
        correct: impl Fn(&[DVec3], bool) -> Result<Correction, CorrectError>,
    ) -> Result<Result<Correction, CorrectError>, JobError> {
        if self.preserve.objective != Objective::Controls {
            let problem = "must be \"controls\" or \"stress\" with Green coordinates".into();
            return Err(JobError::Value { key: "preserve.objective", problem });
        }
        self.check_derivatives(&options.method, "Green coordinates")?;
        Ok(correct(options.mobility.as_deref().unwrap_or_default(), options.method == Method::Nearest))
    }

    /// Whether a correction by derivatives, which is made with `what`, can do what is asked.
    fn check_derivatives(&self, method: &Method, what: &str) -> Result<(), JobError> {
        let refused = |key, problem| Err(JobError::Value { key, problem });
        if self.preserve.preview.is_some() {
            return refused("preserve.preview", format!("cannot be with {what}, where the model itself is corrected"));
        }
        match method {
            Method::Nearest | Method::Gradient => Ok(()),
            Method::Axes { .. } => refused(
                "preserve.axes",
                format!("go with closed forms; with {what} there are none: choose the method \"nearest\""),
            ),
        }
    }

    /// Takes their mobility from the vertices of a cage that were moved, unless the job names those that are free: completed is what was left.
    fn hold_edited(&self, mobility: &mut [DVec3], is_edited: &[bool]) {
        if self.cage.as_ref().is_none_or(|cage| cage.free.is_none()) {
            let edited = mobility.iter_mut().zip(is_edited).filter(|(_, is_edited)| **is_edited);
            edited.for_each(|(m, _)| *m = DVec3::ZERO);
        }
    }

    /// The witness points of a cage.
    fn witnesses(
        &self,
        cage: &CageBinding,
        solid: &Solid,
        rest_points: &[DVec3],
        origin: DVec3,
    ) -> Result<Witnesses, JobError> {
        let refused = |problem| Err(JobError::Value { key: "cage.witnesses", problem });
        let asked = self.cage.as_ref().and_then(|request| request.witnesses.as_ref());
        let points = match asked.unwrap_or(&WitnessPoints::Number(WitnessPoints::DEFAULT)) {
            WitnessPoints::Number(0) => {
                return refused("is 0: it is a number of points, such as 256, or a list of them".into());
            }
            WitnessPoints::Number(number) if *number > WitnessPoints::MOST => {
                return refused(format!("is {number}: at most {} points are taken", WitnessPoints::MOST));
            }
            WitnessPoints::Number(number) => {
                let mut points = inside(solid, rest_points, *number);
                let is_outside = cage.cage().are_outside(&points);
                let mut is_outside = is_outside.into_iter();
                points.retain(|_| !is_outside.next().unwrap_or_default());
                if points.is_empty() {
                    return refused(
                        "found no point inside the model and its cage: name some, such as [[0, 0, 0]]".into(),
                    );
                }
                points
            }
            WitnessPoints::Places(places) => {
                if let Some(k) = places.iter().position(|p| !p.is_finite()) {
                    return refused(format!("has point {k} at {}: coordinates must be finite", places[k]));
                }
                if places.is_empty() {
                    return refused("is an empty list: name at least one point, or a number of them".into());
                }
                let points: Vec<DVec3> = places.iter().map(|p| *p - origin).collect();
                if let Some(k) = cage.cage().are_outside(&points).iter().position(|is_outside| *is_outside) {
                    return refused(format!("has point {k} at {}, outside the cage", places[k]));
                }
                points
            }
        };
        Ok(Witnesses::new(cage, &points)?)
    }

    /// What is reported of a cage, with its vertices at `posed` in the end: the drag planes of those with weights, too.
    fn cage_report(
        cage: &CageBinding,
        body: Result<&Arc<Body>, &SolidError>,
        rest_points: &[DVec3],
        posed: &[DVec3],
        weights: &[f64],
        is_stressed: bool,
        origin: DVec3,
    ) -> Result<CageJobReport, JobError> {
        let mut planes = Vec::new();
        if weights.iter().any(|w| *w > 0.0) {
            let body = body.map_err(Clone::clone)?;
            if cage.coordinates() == Coordinates::Green {
                let problem = "are asked for, but with Green coordinates the volume is no affine function of a vertex: normals turn with it";
                return Err(JobError::Value { key: "cage.planes", problem: problem.into() });
            }
            let by_point = body.solid.volume_gradient(&cage.deformed(rest_points, posed));
            let gradients = cage.gradient(posed, &by_point);
            for vertex in (0..posed.len()).filter(|v| weights[*v] > 0.0) {
                let plane = DragPlane { origin: posed[vertex] + origin, gradient: gradients[vertex] };
                planes.push(DragPlaneReport { vertex, plane });
            }
        }
        let jacobians = is_stressed.then(|| cage.jacobians(rest_points, posed)).transpose()?;
        let stress = jacobians.and_then(|jacobians| StressReport::of(&jacobians));
        Ok(CageJobReport { binding: cage.report().clone(), stress, least_stress: None, planes })
    }

    /// Runs a job whose model goes along a surface first.
    fn run_along(
        &self,
        request: &SurfaceRequest,
        examination: Examination,
        input: &JobInput,
        mut watch: Stopwatch,
        on_stage: &mut dyn FnMut(Stage),
    ) -> Result<Outcome, JobError> {
        if input.mesh.points().is_empty() {
            return Err(JobError::Value {
                key: "model",
                problem: "has no vertices, so there is nothing to deform".into(),
            });
        }
        if let (Some(path), None) = (&request.file, input.surface) {
            let problem = format!("names {}, which was not loaded", path.display());
            return Err(JobError::Value { key: "surface.file", problem });
        }
        on_stage(Stage::Bind);
        let surface = request.surface(input.surface.cloned())?;
        let mut along = Along::new(request, &surface, input.mesh, &mut watch, on_stage)?;
        let laid = Arc::clone(&along.posed);
        let Examination { health, opening, body } = examination;
        let body = body.map(|_| {
            let topology = topology(&along.placed);
            let solid = Solid::new(&along.placed, &topology, OpenBoundaries::Cap)?;
            let rest = solid.volumes(along.placed.points());
            Ok::<_, SolidError>(Arc::new(Body::new(solid, rest, &health.roles)))
        });
        let body = body.and_then(|body| body);
        if !self.is_by_height() {
            // A lattice round the laid model does the rest.
            let mesh = along.placed.with_points(laid.points.clone()).map_err(AlongError::from)?;
            let inner = Self { surface: None, ..self.clone() };
            let examination = Examination { health, opening, body };
            let mut outcome = inner.run_after(examination, &JobInput { mesh: &mesh, ..*input }, watch, on_stage)?;
            outcome.report.warnings.extend(along.warnings());
            outcome.report.surface = Some(along.report.clone());
            outcome.along = Some(along);
            return Ok(outcome);
        }

        on_stage(Stage::Correct);
        let mut warnings = health.warnings.clone();
        let (volume, correction, kept);
        let mut points = laid.points.clone();
        if self.preserve.volume == VolumeTarget::Free {
            kept = body.ok();
            volume = kept.as_ref().map(|body| body.free_rows(&points));
            correction = CorrectionReport::not_asked();
        } else {
            let body = body?;
            if let (OpenBoundaries::Refuse, Some(opening)) = (self.preserve.open, opening) {
                return Err(opening.into());
            }
            if body.solid.encloses_nothing(along.placed.points(), body.rest.total) {
                return Err(JobError::NoVolume { volume: body.rest.total });
            }
            let posed = body.solid.volumes(&points);
            let wishes = body.wishes(&self.preserve.volume, &posed, &mut warnings)?;
            let [Wish { goal: VolumeGoal { components: Components::All, volume: wanted }, .. }] = &wishes[..] else {
                let problem = "\"height\" scales all heights alike, so it meets one volume of the whole model; choose \"nearest\" for several";
                return Err(JobError::Value { key: "preserve.method", problem: problem.into() });
            };
            let scaled = scaled_heights(&body.solid, &along.feet.feet, &along.feet.offsets, *wanted)?;
            // Where the volume was right nothing moves by a rounding.
            if scaled.scale != 1.0 {
                points.clone_from(&scaled.vertices);
            }
            let extent = along.placed.bounds().map_or(0.0, |bounds| bounds.extent());
            correction = CorrectionReport::of_heights(&laid.points, &points, extent);
            along.scaled(scaled.scale, points.clone()).map_err(AlongError::from)?;
            if let (SurfaceFolds::Refuse, Some(folds)) = (request.folds, along.report.folds) {
                return Err(AlongError::Wrap(WrapError::Folded(folds)).into());
            }
            let end = body.solid.volumes(&points);
            let goals: Vec<VolumeGoal> = wishes.iter().map(|wish| wish.goal.clone()).collect();
            volume = Some(body.rows(&posed, &end, &goals));
            kept = Some(body);
        }
        watch.lap(Stage::Correct.name());
        warnings.extend(along.warnings());
        let report = Report {
            version: env!("CARGO_PKG_VERSION").into(),
            model: health,
            volume,
            correction,
            surface: Some(along.report.clone()),
            elastic: None,
            cage: None,
            folds: "off".into(),
            timings_ms: watch.timings(),
            peak_memory: None,
            warnings,
        };
        Ok(Outcome {
            points,
            controls: None,
            cage: None,
            report,
            body: kept,
            deformation: None,
            along: Some(along),
            net: None,
        })
    }

    /// The wanted volumes of a body that stood at `rest` and now, at `points`, has the volumes `posed`.
    fn checked_wishes(
        &self,
        body: &Body,
        [rest, points]: [&[DVec3]; 2],
        posed: &Volumes,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Wish>, JobError> {
        let is_whole = !matches!(self.preserve.volume, VolumeTarget::Each(_) | VolumeTarget::Parts(_));
        if is_whole && body.solid.encloses_nothing(rest, body.rest.total) {
            return Err(JobError::NoVolume { volume: body.rest.total });
        }
        if !posed.total.is_finite() && points.iter().all(|p| p.is_finite()) {
            let (target, volume, reason) = (body.rest.total, posed.total, Reason::Overflow);
            return Err(CorrectError::Impossible { goal: Some(0), target, volume, reason }.into());
        }
        body.wishes(&self.preserve.volume, posed, warnings)
    }

    /// Whether a model along a surface gets its volume by its heights: unless a lattice is asked for in one way or another.
    fn is_by_height(&self) -> bool {
        let Preserve { volume, method, axes, shares, objective, pin, mobility, falloff, points, preview, .. } =
            &self.preserve;
        match method {
            Some(method) => *method == MethodKind::Height || (*volume == VolumeTarget::Free && !self.has_lattice()),
            None => {
                !self.has_lattice()
                    && axes.is_none()
                    && shares.is_none()
                    && *objective == Objective::default()
                    && pin.is_none()
                    && *mobility == MobilityKind::default()
                    && falloff.is_none()
                    && points.is_empty()
                    && preview.is_none()
            }
        }
    }

    fn has_lattice(&self) -> bool {
        self.lattice.is_some() || self.cage.is_some() || !self.edit.is_empty()
    }

    /// Whether nothing is to be deformed and nothing asked of the volume.
    fn changes_nothing(&self) -> bool {
        let is_default = |volume| self.preserve == Preserve { volume, ..Preserve::default() };
        let asks_for_nothing = is_default(VolumeTarget::Rest) || is_default(VolumeTarget::Free);
        self.lattice.is_none() && self.cage.is_none() && self.edit.is_empty() && asks_for_nothing
    }

    /// The lattice or cage of the job, relative to `origin`, as `points` are.
    fn controls(
        &self,
        input: &JobInput,
        bounds: Bounds,
        points: &[DVec3],
        origin: DVec3,
        warnings: &mut Vec<String>,
    ) -> Result<Controls, JobError> {
        if let Some(request) = &self.cage {
            if self.lattice.is_some() {
                let problem = "stands beside [lattice]: there is at most one of them".into();
                return Err(JobError::Value { key: "cage", problem });
            }
            let Some(path) = &request.file else {
                let problem = "is missing: name the cage, a closed mesh; isochor cage makes one".into();
                return Err(JobError::Value { key: "cage.file", problem });
            };
            let Some(input) = input.cage else {
                let problem = format!("names {}, which was not loaded", path.display());
                return Err(JobError::Value { key: "cage.file", problem });
            };
            return Controls::of_cage(request, input, points, origin, warnings);
        }
        let default_request = LatticeRequest::default();
        let request = self.lattice.as_ref().unwrap_or(&default_request);
        match (&request.file, input.lattice) {
            (None, _) => Controls::made(request, bounds, origin, warnings),
            (Some(_), Some(file)) => Controls::of_file(request, file, origin, warnings),
            (Some(path), None) => {
                let problem = format!("names {}, which was not loaded", path.display());
                Err(JobError::Value { key: "lattice.file", problem })
            }
        }
    }

    /// The method, and which coordinates it may change.
    fn method(&self) -> Result<(Method, DVec3), JobError> {
        let Preserve { method, axes, shares, .. } = &self.preserve;
        let default = if axes.is_some() || shares.is_some() { MethodKind::Axes } else { MethodKind::Nearest };
        let other = match method.unwrap_or(default) {
            MethodKind::Axes => {
                let directions = axes.clone().unwrap_or_else(|| Directions::Letters(AxisLetters::default())).vectors();
                return Ok((Method::Axes { directions, shares: shares.clone() }, DVec3::ONE));
            }
            MethodKind::Nearest => Method::Nearest,
            MethodKind::Gradient => Method::Gradient,
            MethodKind::Elastic => unreachable!("the method \"elastic\" goes its own way"),
            MethodKind::Height => {
                let problem =
                    "is \"height\", which is for models along a surface: add [surface], or choose another".into();
                return Err(JobError::Value { key: "preserve.method", problem });
            }
        };
        let contradicts = |problem: &str| Err(JobError::Value { key: "preserve.method", problem: problem.into() });
        match axes {
            _ if shares.is_some() => contradicts("takes no shares; leave them out, or choose \"axes\""),
            Some(Directions::Vectors(_)) => {
                contradicts("takes axes as letters only, such as \"xy\"; choose \"axes\" for other directions")
            }
            Some(letters) => Ok((other, letters.vectors().iter().sum())),
            None => Ok((other, DVec3::ONE)),
        }
    }

    /// The points that must be at exact places in the end: those of `preserve`, then the vertices that edits dragged, each with
    /// its last target, unless `preserve` names them.
    fn wanted_points(&self) -> Vec<WantedPoint> {
        let mut dragged: Vec<WantedPoint> = Vec::new();
        for (index, edit) in self.edit.iter().enumerate() {
            let Edit::Drag(drag) = edit else { continue };
            for &request in &drag.points {
                dragged.retain(|earlier| earlier.request.vertex != request.vertex);
                dragged.push(WantedPoint { request, edit: Some(index) });
            }
        }
        let is_named = |vertex| self.preserve.points.iter().any(|point| point.vertex == vertex);
        dragged.retain(|point| !is_named(point.request.vertex));
        let named = self.preserve.points.iter().map(|&request| WantedPoint { request, edit: None });
        named.chain(dragged).collect()
    }

    /// The same with weights and positions, near the model.
    fn points(
        &self,
        wanted: &[WantedPoint],
        binding: &Binding,
        posed: &[DVec3],
        origin: DVec3,
    ) -> Result<Vec<PointTarget>, JobError> {
        let point = |&WantedPoint { request: PointRequest { vertex, to }, .. }: &WantedPoint| {
            let (key, vertices) = ("preserve.points", posed.len());
            let position = *posed.get(vertex).ok_or(JobError::MissingVertex { key, vertex, vertices })?;
            Ok(PointTarget { weights: binding.weights(vertex), position, target: to - origin })
        };
        wanted.iter().map(point).collect()
    }

    /// Mobility of each control coordinate: of the lattice file, times falloff, times what pins leave.
    fn mobility(
        &self,
        of_file: Option<&[DVec3]>,
        space: &ControlSpace,
        rest_points: &[DVec3],
    ) -> Result<Vec<DVec3>, JobError> {
        let mut mobility = of_file.map_or_else(|| vec![DVec3::ONE; space.rest.len()], <[DVec3]>::to_vec);
        if let Some(Falloff { vertex, radius }) = self.preserve.falloff {
            let key = "preserve.falloff";
            let vertices = rest_points.len();
            let center = *rest_points.get(vertex).ok_or(JobError::MissingVertex { key, vertex, vertices })?;
            if !(radius > 0.0 && radius.is_finite()) {
                let problem = format!("has radius {radius}: it must be more than 0, in extents");
                return Err(JobError::Value { key, problem });
            }
            for (m, rest) in mobility.iter_mut().zip(space.rest) {
                *m *= libm::exp(-rest.distance(center) / (radius * space.extent));
            }
        }
        if let Some(free) = self.cage.as_ref().and_then(|cage| cage.free.as_ref()) {
            for (m, weight) in mobility.iter_mut().zip(free.weights(space).map_err(JobError::Free)?) {
                *m *= weight;
            }
        }
        if let Some(pin) = &self.preserve.pin {
            for (m, weight) in mobility.iter_mut().zip(pin.weights(space).map_err(JobError::Pin)?) {
                *m *= 1.0 - weight;
            }
        }
        Ok(mobility)
    }
}

impl Outcome {
    /// The model at rest with the vertices and faces of the result, where these were divided along a surface.
    #[must_use]
    pub fn divided(&self) -> Option<(&Mesh, &Refinement)> {
        let along = self.along.as_ref()?;
        Some((&along.rest, along.refinement.as_ref()?))
    }

    /// The flattened sheet and the model on it, of a job along a surface.
    #[must_use]
    pub fn sheet(&self) -> Option<SheetDrawing<'_>> {
        self.along.as_ref().map(Along::drawing)
    }

    /// The springs and the held nodes, of a job with the method "elastic"; the edges of a cage.
    #[must_use]
    pub fn net(&self) -> Option<&NetDrawing> {
        self.net.as_ref()
    }

    /// Jacobian matrices ∂(deformed)/∂(rest) at each vertex (#vertices), which carry normals. `None` where the job
    /// deformed nothing.
    #[must_use]
    pub fn jacobians(&self) -> Option<Vec<DMat3>> {
        self.jacobians_of(|d| &d.displacement)
    }

    /// The same before the correction: ∂(posed)/∂(rest) (#vertices).
    #[must_use]
    pub fn posed_jacobians(&self) -> Option<Vec<DMat3>> {
        match (&self.deformation, &self.along) {
            (None, Some(along)) => Some(along.posed_jacobians()),
            _ => self.jacobians_of(|d| &d.posed),
        }
    }

    /// Those with some displacement of a lattice's controls, after what was done along a surface.
    fn jacobians_of(&self, displacement: impl Fn(&Deformation) -> &[DVec3]) -> Option<Vec<DMat3>> {
        let lattice = self
            .deformation
            .as_ref()
            .and_then(|d| d.deformer.jacobians(&d.rest_points, &d.rest_controls, displacement(d)));
        let along = self.along.as_ref().map(Along::jacobians);
        match (lattice, along) {
            (Some(lattice), Some(along)) => Some(lattice.iter().zip(&along).map(|(l, a)| *l * *a).collect()),
            (one, other) => one.or(other),
        }
    }

    /// How the model is bound to its cage, in a job with one: relative to [`Bounds::lossless_origin`] of the model.
    #[must_use]
    pub fn cage_binding(&self) -> Option<&CageBinding> {
        self.deformation.as_ref().and_then(|d| d.deformer.cage())
    }

    /// The model between rest and result. `None` where the job deformed nothing.
    #[must_use]
    pub fn course(&self) -> Option<Course> {
        // A model along a surface is compared with itself as it was placed.
        let placed = self.along.as_ref().map_or(1.0, |along| along.report.scale.powi(3));
        let determinants =
            |jacobians: Vec<DMat3>| jacobians.iter().map(|j| j.determinant() / placed).collect::<Vec<f64>>();
        let [posed_change, corrected_change] = [self.posed_jacobians()?, self.jacobians()?].map(determinants);
        let Some(d) = &self.deformation else {
            let along = self.along.as_ref()?;
            let posed = along.posed.points.clone();
            return Some(Course { posed, posed_controls: Vec::new(), posed_change, corrected_change });
        };
        let binding = d.deformer.binding(&d.rest_points, false).ok()?; // it was bound before
        let spread = d.deformer.spread(&d.rest_controls, &d.posed);
        Some(Course {
            posed: translated(&binding.displaced(&d.rest_points, &spread), d.origin),
            posed_controls: translated(&displaced(&d.rest_controls, &d.posed), d.origin),
            posed_change,
            corrected_change,
        })
    }

    /// Adds to the report what volume the *written* points have (#vertices × 3, model coordinates, as rounded to the
    /// file's number type).
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    pub fn measure_written(&mut self, points: &[DVec3]) {
        if let (Some(body), Some(rows)) = (&self.body, &mut self.report.volume) {
            body.add_written(rows, points);
        }
    }
}

/// A point that must be at an exact place in the end.
#[derive(Clone, Copy)]
struct WantedPoint {
    request: PointRequest,
    /// The edit that dragged it there; `None`: `preserve` names it.
    edit: Option<usize>,
}
