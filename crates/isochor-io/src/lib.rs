//! Documents: model files that keep everything but positions and normals.
//!
//! A [`Document`] holds the bytes of a file and the [`Mesh`](isochor::Mesh) in it. Writing copies the bytes and
//! replaces the numbers that changed, so polygons, texture coordinates, groups, materials, colours, unknown elements,
//! comments, line ends and the spelling of every other number leave as they came.
//!
//! ```
//! use isochor_io::{Document, Format, WriteOptions};
//!
//! let text = "v 0 0 0 # corner\nv 1.50 0 0\nv 0 1 0\nf 1 2 3\n";
//! let document = Document::parse(text.into(), Format::Obj)?;
//!
//! let mut points = document.mesh().points().to_vec();
//! points[1].x = 2.25;
//! let written = document.with_points(&points, &WriteOptions::default())?;
//! assert_eq!(written.bytes, b"v 0 0 0 # corner\nv 2.25 0 0\nv 0 1 0\nf 1 2 3\n");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod binding_file;
mod document;
mod format;
mod lattice_file;
mod mix;
mod newell;
mod normal;
mod number;
mod obj;
mod obj_patches;
mod obj_refined;
mod off;
mod off_refined;
mod param_file;
mod patch_file;
mod patch_json;
mod ply;
mod ply_body;
mod ply_header;
mod ply_refined;
mod ply_rows;
mod read_error;
mod refined;
mod splice;
mod stl;
mod weld;
mod words;
mod write_error;

pub use binding_file::{SavedBinding, hash_of_cage, hash_of_points};
pub use document::{Document, WriteOptions, Written};
pub use format::Format;
pub use isochor::Precision;
pub use lattice_file::{LatticeFileError, lattice_from_json, lattice_to_json};
pub use newell::patches_from_newell;
pub use number::NumberType;
pub use obj_patches::patches_from_obj;
pub use param_file::{CageMoves, cage_moves_from_param};
pub use patch_file::{patch_from_bytes, patches_from_bytes};
pub use patch_json::{patch_from_json, patch_to_json};
pub use read_error::{Place, ReadError};
pub use refined::RefinementError;
pub use write_error::WriteError;
