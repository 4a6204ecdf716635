//! Pictures, animations and report pages of deformations, drawn without a display or a GPU.

mod animation;
mod camera;
mod color_scale;
mod image;
mod ink;
mod legend;
mod light;
mod normals;
mod number;
mod panel;
mod parallel;
mod picture;
mod raster;
mod show;
mod surface;
mod text;

pub use animation::{AnimationError, animated_png};
pub use camera::{Camera, View};
pub use color_scale::{ColorScale, NO_VALUE, Quantity, Tick};
pub use image::{Image, MAX_SIDE, Rgb};
pub use picture::{Coloring, PictureOptions, StripOptions, frames, picture, strip};
pub use show::{Show, ShownLattice, ShownPose};
