//! Pictures, animations and report pages of deformations, drawn without a display or a GPU.

mod show;

pub use show::{Show, ShownLattice, ShownPose};
