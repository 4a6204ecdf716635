//! Free-form deformation of 3D models whose volume comes out exactly as wanted.

mod axes;
mod binding;
mod bspline;
mod correct;
mod double;
mod edit;
#[cfg(feature = "serde")]
mod exact;
mod gradient;
mod health;
mod job;
#[cfg(feature = "serde")]
mod job_text;
mod lattice;
mod mesh;
mod outcome;
mod parallel;
mod posed;
mod report;
mod select;
pub mod shapes;
pub mod tolerances;
mod topology;
mod volume;

pub use binding::{Binding, displaced};
pub use bspline::{Basis, BasisError, MAX_SIZE};
pub use correct::{CorrectError, CorrectOptions, Correction, Method, Pose, Reason, Status, correct};
pub use edit::{
    Axis, Bend, Edit, EditError, Factors, LengthUnit, Move, Noise, Rotate, RotationAxis, Scale, SignedAxis, Stretch,
    Taper, Twist,
};
pub use health::{Health, HealthVolume, Source, Verdict};
pub use job::{
    Amount, AxisLetters, BasisKind, Directions, Falloff, Fit, Folds, Job, KnotRule, Knots, LatticeRequest, MethodKind,
    MobilityKind, Objective, PerAxis, Precision, Preserve, ValueError, VolumeTarget,
};
#[cfg(feature = "serde")]
pub use job_text::JobTextError;
pub use lattice::{Frame, Lattice, LatticeError, MAX_CONTROLS, Outside};
pub use mesh::{Bounds, Faces, Mesh, MeshError, fan};
pub use outcome::{JobError, JobInput, Outcome, PosedLattice, Stage};
pub use posed::{Posed, PosedError, PosedPoint, PosedTo};
pub use report::{CorrectionReport, Report, Stopwatch, Timings, VolumeReport, VolumeRow};
pub use select::{ControlSpace, SelectError, Selector};
pub use topology::{Topology, UnbalancedEdge, topology};
pub use volume::{OpenBoundaries, Solid, SolidError, Volumes};
