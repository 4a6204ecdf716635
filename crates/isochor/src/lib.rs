//! Free-form deformation of 3D models whose volume comes out exactly as wanted.
//!
//! # A tour
//!
//! Measure a model: a [`Mesh`] has a [`Topology`], and bounds a [`Solid`] that gives its signed volume.
//!
//! ```
//! use isochor::{OpenBoundaries, Solid, shapes, topology};
//!
//! let mesh = shapes::cube(4);
//! let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse)?;
//! assert_eq!(solid.volume(mesh.points()), 1.0);
//! # Ok::<(), isochor::SolidError>(())
//! ```
//!
//! Deform it: a [`Lattice`] binds points, and the [`Binding`] W carries control displacements to vertices, `P = P⁰ + W (C −
//! C⁰)`.
//!
//! ```
//! use isochor::{Basis, Bounds, Frame, Lattice, Outside, displaced, shapes};
//!
//! let mesh = shapes::cube(4);
//! let frame = Frame::fitted(mesh.bounds().unwrap(), 0.0)?;
//! let lattice = Lattice::new([0; 3].map(|_| Basis::clamped(5, 3).unwrap()), frame)?;
//! let binding = lattice.bind(mesh.points(), Outside::Keep)?;
//!
//! // Squash: every control point goes down to 60 % of its height.
//! let displacement: Vec<_> = lattice.rest().iter().map(|c| glam::DVec3::new(0.0, 0.0, -0.4 * c.z)).collect();
//! let posed = displaced(mesh.points(), &binding.apply(&displacement));
//! assert!((Bounds::of(&posed).unwrap().max.z - 0.6).abs() < 1e-15);
//! # Ok::<(), isochor::LatticeError>(())
//! ```
//!
//! Give it back its volume: [`correct`] moves the controls a little further.
//!
//! ```
//! # use isochor::{Basis, Frame, Lattice, OpenBoundaries, Outside, Solid, displaced, shapes, topology};
//! use isochor::{CorrectOptions, Method, Pose, Wanted, correct};
//! # let mesh = shapes::cube(4);
//! # let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
//! # let frame = Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap();
//! # let lattice = Lattice::new([0; 3].map(|_| Basis::clamped(5, 3).unwrap()), frame).unwrap();
//! # let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
//! # let displacement: Vec<_> = lattice.rest().iter().map(|c| glam::DVec3::new(0.0, 0.0, -0.4 * c.z)).collect();
//! # let posed = displaced(mesh.points(), &binding.apply(&displacement));
//!
//! let method = Method::Axes { directions: vec![glam::DVec3::X, glam::DVec3::Y], shares: None };
//! let pose = Pose { solid: &solid, vertices: &posed, binding: &binding };
//! let corrected = correct(&pose, &Wanted::volume(1.0), &CorrectOptions { method, ..CorrectOptions::default() })?;
//! assert!((solid.volume(&corrected.vertices) - 1.0).abs() < 1e-13);
//! # Ok::<(), isochor::CorrectError>(())
//! ```
//!
//! Or ask for all of it at once, as data: a [`Job`].
//!
//! ```
//! # #[cfg(feature = "serde")] {
//! use isochor::{Job, JobInput, Source, shapes};
//!
//! let mesh = shapes::cube(4);
//! let job = Job::from_toml("[[edit]]\ntwist = { axis = 'z', degrees = 90 }\n[preserve]\nvolume = '110%'").unwrap();
//! let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
//! let outcome = job.run(&input, &mut |_stage| {}).unwrap();
//! assert!((outcome.report.volume.unwrap().overall.corrected - 1.1).abs() < 1e-13);
//! # }
//! ```
//!
//! # Features
//!
//! - `rayon` (default): threads. Results have the same bits without it.
//! - `serde`: jobs as TOML and JSON, reports as JSON.

mod along;
mod arc;
mod arc_length;
mod augmented;
mod axes;
mod binding;
mod block_matrix;
mod body;
mod bspline;
mod buckets;
mod built_in;
mod cage;
mod cage_binding;
mod cage_check;
mod cage_correction;
mod cage_making;
mod cage_request;
mod closest;
mod coarse;
mod cone;
mod controls;
mod correct;
mod couplings;
mod crossing;
mod curvature;
mod curve;
mod descent;
mod double;
mod drag;
mod drag_plane;
mod edge_collapse;
mod edit;
mod elastic;
mod elastic_job;
mod elastic_request;
mod elementary;
mod energy;
mod equilibrium;
#[cfg(feature = "serde")]
mod exact;
mod extrusion;
#[cfg(feature = "serde")]
mod film;
mod flatten;
mod gauss;
mod geodesic;
mod goals;
mod gradient;
mod green;
mod harmonic;
mod harmonic_grid;
mod health;
mod height_scale;
mod homogeneous;
mod interpolation;
mod intersection;
mod job;
#[cfg(feature = "serde")]
mod job_text;
mod kkt;
mod lattice;
mod least_stress;
mod levels;
mod local_frame;
mod local_stress;
mod locality;
mod locate;
mod mean_value;
mod measure;
mod mesh;
mod metric;
mod moments;
mod nearest;
mod node_rows;
mod offset_surface;
mod order;
mod outcome;
mod parallel;
mod parametric_solid;
mod patch;
mod pieces;
mod placement;
mod point_tree;
mod points;
mod posed;
mod preview;
mod quasi_newton;
mod refinement;
mod report;
mod revolution;
mod rows;
mod select;
mod sensitivity;
pub mod shapes;
mod sheet;
mod shells;
mod simplify;
mod spare;
mod sphere;
mod springs;
mod square;
mod stored;
mod stress;
mod stretch;
mod subdivide;
mod surface;
mod surface_mesh;
mod surface_request;
mod sweep;
mod tensor;
pub mod tolerances;
mod topology;
mod torus;
mod triangles;
mod triangulation;
mod unroll;
mod volume;
mod volume_form;
mod winding;
mod witnesses;
mod wrap;

pub use along::{AlongError, SheetDrawing};
pub use augmented::{Augmented, LevelReport};
pub use binding::{Binding, BoundVertices, displaced};
pub use bspline::{Basis, BasisError, MAX_SIZE};
pub use built_in::{BuiltIn, ShapeName, ShapeNameError};
pub use cage::{Cage, CageError};
pub use cage_binding::{CageBinding, CageBindingError, CageOptions, CageReport, Coordinates};
pub use cage_check::{CageCheck, CageFault};
pub use cage_making::{CageMakingError, CageMakingOptions, cage_round};
pub use cage_request::{CageInput, CageRequest, PosedCage, WitnessPoints};
pub use correct::{CorrectError, CorrectOptions, Correction, Corrector, Method, Pose, Reason, Status, Wanted, correct};
pub use curvature::Curvature;
pub use curve::{Curve, CurveJet};
pub use drag::{Drag, DragError};
pub use drag_plane::DragPlane;
pub use edit::{
    Axis, Bend, Edit, EditError, Factors, LengthUnit, Move, Noise, Rotate, RotationAxis, Scale, SignedAxis, Stretch,
    Taper, Twist,
};
pub use elastic::{
    Elastic, ElasticError, ElasticModel, ElasticOptions, ElasticSolver, ElasticState, ElasticStatus, ElasticStep,
    ElasticWanted, Evaluation, MomentTargets, Settled, relaxed,
};
pub use elastic_request::{CenterOfMass, Continuity, ElasticRequest, ElasticSolverKind, Hold, Inertia, LevelCount};
pub use energy::Energy;
#[cfg(feature = "serde")]
pub use film::Film;
pub use flatten::{
    FlattenError, FlattenMethod, FlattenOptions, FlattenStart, FlattenStatus, FlattenWeights, Flattened, flatten,
};
pub use geodesic::Geodesic;
pub use goals::{Components, VolumeGoal};
pub use green::{green_coordinates, stretched_normals};
pub use harmonic::{Harmonic, HarmonicError, HarmonicOptions, HarmonicReport};
pub use health::{ComponentHealth, Health, Source, Verdict};
pub use height_scale::{HeightScale, HeightScaleError, scaled_heights};
pub use interpolation::Smoothness;
pub use job::{
    Amount, AxisKnots, AxisLetters, BasisKind, ColorBy, Directions, Falloff, Fit, Folds, Job, KnotRule, Knots,
    LatticeRequest, MethodKind, MobilityKind, Objective, PartTarget, PerAxis, PointRequest, Precision, Preserve,
    ValueError, ViewRequest, VolumeTarget,
};
#[cfg(feature = "serde")]
pub use job_text::JobTextError;
pub use lattice::{Frame, Lattice, LatticeError, MAX_CONTROLS, Outside};
pub use least_stress::LeastStressReport;
pub use levels::{Level, LevelOptions, Levels, TriangleError};
pub use local_stress::{LocalStress, StressReport, stress_angles};
pub use locality::{LocalityOptions, local_mobility, volume_loss};
pub use locate::LocateError;
pub use mesh::{Bounds, Faces, Mesh, MeshError, fan};
pub use moments::Moments;
pub use outcome::{Course, Examination, JobError, JobInput, NetDrawing, NetKind, Outcome, PosedLattice, Stage};
pub use parametric_solid::{GaussVolume, LEAST_TRIANGLES, ParametricSolid, ParametricSolidError};
pub use patch::Patch;
pub use placement::{Beyond, Height, HeightWord, Placed, Placement, PlacementError, SheetFit};
pub use points::{PointError, PointTarget, least_displacement};
pub use posed::{Posed, PosedError, PosedPoint, PosedTo};
pub use preview::Preview;
pub use refinement::Refinement;
pub use report::{
    CageJobReport, CorrectionReport, DragPlaneReport, ElasticReport, FilmReport, FrameReport, PartRow, Report,
    Stopwatch, SurfaceReport, Timings, VolumeReport, VolumeRow,
};
pub use select::{ControlSpace, SelectError, Selector};
pub use sensitivity::{Cause, Effect, Sensitivity};
pub use sheet::Sheet;
pub use shells::{Role, Shell, roles};
pub use simplify::coarse_triangles;
pub use springs::{Net, Spring, Springs, SpringsError, Stiffness};
pub use stretch::{CellStretch, FlattenReport, SheetError};
pub use subdivide::{SubdivideError, Subdivision, SubdivisionPoint, subdivide};
pub use surface::{Jet, Surface, SurfaceError};
pub use surface_request::{
    FlattenKind, FrameRequest, ProfileRequest, Refine, RefineWord, SplineRequest, SurfaceFolds, SurfaceKind,
    SurfaceRequest, SurfaceRequestError, ThroughRequest,
};
pub use topology::{Topology, UnbalancedEdge, topology};
pub use volume::{OpenBoundaries, Solid, SolidError, Volumes};
pub use volume_form::VolumeForm;
pub use wrap::{Feet, Laid, Wrap, WrapError, WrapFolds};

/// The examples of the documentation are tests.
#[cfg(all(doctest, feature = "serde"))]
mod pages {
    #[doc = include_str!("../../../docs/correct.md")]
    mod correct {}
    #[doc = include_str!("../../../docs/elastic.md")]
    mod elastic {}
    #[doc = include_str!("../../../docs/frames.md")]
    mod frames {}
    #[doc = include_str!("../../../docs/preview.md")]
    mod preview {}
    #[doc = include_str!("../../../docs/sensitivity.md")]
    mod sensitivity {}
    #[doc = include_str!("../../../docs/surface.md")]
    mod surface {}
}
