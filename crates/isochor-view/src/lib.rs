//! Pictures, animations and report pages of deformations, drawn without a display or a GPU.

mod digits;
mod geometry;
mod index;
mod page;
mod request;
mod show;

pub use index::{IndexEntry, index};
pub use page::{Figure, Page, page};
pub use show::{Show, ShownLattice, ShownPose};
