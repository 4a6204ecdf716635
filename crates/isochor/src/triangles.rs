//! The triangles of a body: its own, or those that are the faces of its mesh.

use std::ops::Deref;
use std::sync::Arc;

use crate::mesh::Faces;

/// Triangles as corner indices.
#[derive(Clone, Debug)]
pub(crate) enum Triangles {
    Own(Vec<[u32; 3]>),
    /// All faces of a mesh, which are triangles: no copy of them.
    OfMesh(Arc<Faces>),
}

impl Deref for Triangles {
    type Target = [[u32; 3]];

    #[inline]
    fn deref(&self) -> &[[u32; 3]] {
        match self {
            Self::Own(triangles) => triangles,
            Self::OfMesh(faces) => faces.corners().as_chunks().0,
        }
    }
}

impl From<Vec<[u32; 3]>> for Triangles {
    fn from(triangles: Vec<[u32; 3]>) -> Self {
        Self::Own(triangles)
    }
}
