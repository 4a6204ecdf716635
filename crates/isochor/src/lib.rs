//! Free-form deformation of 3D models whose volume comes out exactly as wanted.

mod mesh;

pub use mesh::{Bounds, Faces, Mesh, MeshError, fan};
