//! A mesh with added vertices and split faces, and where each of them comes from.

use crate::mesh::{Faces, Mesh, MeshError};

/// Faces that were split, over the old vertices and new ones after them.
///
/// What lies on a mesh (normals, colours, texture coordinates) is carried over by the mixes: sums of weight × value, weights not negative
/// and together 1. Entries of weight 0 name any old place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refinement {
    /// All faces. Old vertices keep their indices; new ones follow them in the order of `vertices`.
    pub faces: Faces,
    /// Each new vertex as a mix of old vertices (#new vertices).
    pub vertices: Vec<[(u32, f64); 3]>,
    /// The old face in which each face lies (#faces), ascending.
    pub origins: Vec<u32>,
    /// Each corner as a mix of corners of its old face, which count from 0 in each face (#corners of all faces, face after face).
    pub corners: Vec<[(u32, f64); 3]>,
}

impl Refinement {
    /// The divided mesh: old points as they are, new ones as mixes of them.
    ///
    /// # Errors
    ///
    /// Faces that do not fit `mesh`.
    ///
    /// # Panics
    ///
    /// Panics where a mix names a vertex that `mesh` does not have.
    pub fn mesh(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let mut points = mesh.points().to_vec();
        let mix = |of: &[(u32, f64); 3]| of.iter().map(|(v, w)| mesh.points()[*v as usize] * *w).sum();
        points.extend(self.vertices.iter().map(mix).collect::<Vec<glam::DVec3>>());
        Mesh::new(points, self.faces.clone())
    }
}
