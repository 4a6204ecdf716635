//! Pictures, animations and report pages of deformations, drawn without a display or a GPU.
//!
//! # A tour
//!
//! A [`Show`] is what is shown: poses of one model. [`picture`] draws them side by side, with one camera for all.
//!
//! ```
//! use isochor::{Job, JobInput, Source, shapes};
//! use isochor_view::{Coloring, PictureOptions, Show, picture};
//!
//! let mesh = shapes::icosphere(3);
//! let job = Job::from_toml("[[edit]]\nstretch = { axis = 'z', scale = 0.4 }").unwrap();
//! let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
//! let outcome = job.run(&input, &mut |_stage| {}).unwrap();
//! let course = outcome.course();
//! let show = Show::of_job(&mesh, &outcome, course.as_ref());
//!
//! let options = PictureOptions { coloring: Coloring::VolumeChange, ..PictureOptions::default() };
//! let image = picture(&show, &options);
//! assert_eq!(&image.png()[1..4], b"PNG");
//! ```
//!
//! Sequences are shows of many poses: [`frames`] and [`animated_png`] make a film of them, [`strip`] a page. Both are
//! drawn by the processor alone, and have the same bits for any number of threads.
//!
//! # Features
//!
//! - `rayon` (default): threads. Pictures have the same bits without it.

mod animation;
mod camera;
mod color_scale;
mod digits;
mod geometry;
mod image;
mod index;
mod ink;
mod legend;
mod light;
mod normals;
mod number;
mod page;
mod panel;
mod parallel;
mod picture;
mod raster;
mod request;
mod show;
mod surface;
mod text;

pub use animation::{AnimationError, animated_png};
pub use camera::{Camera, View};
pub use color_scale::{ColorScale, NO_VALUE, Quantity, Tick};
pub use image::{Image, MAX_SIDE, Rgb};
pub use index::{IndexEntry, index};
pub use page::{Figure, Page, page};
pub use picture::{Coloring, PictureOptions, StripOptions, frames, picture, strip};
pub use show::{Show, ShownLattice, ShownPose};
