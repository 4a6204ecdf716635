//! Free-form deformation of 3D models whose volume comes out exactly as wanted.

mod axes;
mod binding;
mod bspline;
mod correct;
mod double;
mod gradient;
mod lattice;
mod mesh;
mod parallel;
pub mod tolerances;
mod topology;
mod volume;

pub use binding::{Binding, displaced};
pub use bspline::{Basis, BasisError, MAX_SIZE};
pub use correct::{CorrectError, CorrectOptions, Correction, Method, Pose, Reason, Status, correct};
pub use lattice::{Frame, Lattice, LatticeError, MAX_CONTROLS, Outside};
pub use mesh::{Bounds, Faces, Mesh, MeshError, fan};
pub use topology::{Topology, UnbalancedEdge, topology};
pub use volume::{OpenBoundaries, Solid, SolidError, Volumes};
