//! A refinement that fits its mesh, old face by old face.

use isochor::{Mesh, MeshError, Refinement};

use crate::mix::Mix;

/// What the weights of a mix may sum to beside 1. Smaller would refuse barycentric weights that were mixed many times, larger would let
/// through mixes that leave something out, which 32-bit values show from 6e-8 on.
const SUM_TOLERANCE: f64 = 1e-9;

/// Why a [`Refinement`] does not fit the mesh of a document.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefinementError {
    /// Not one origin for each face.
    #[error("{origins} origins were given for {faces} faces")]
    OriginCount {
        /// Number of origins given.
        origins: usize,
        /// Number of faces of the refinement.
        faces: usize,
    },
    /// Not one mix for each corner of a face.
    #[error("{mixes} mixes were given for {corners} corners")]
    CornerCount {
        /// Number of mixes given.
        mixes: usize,
        /// Number of corners of all faces of the refinement.
        corners: usize,
    },
    /// A face comes from a face that the document does not have.
    #[error("face {face} comes from face {origin}, but the document has {faces} faces")]
    MissingOrigin {
        /// Index of the face in the refinement.
        face: usize,
        /// The face of the document that it names.
        origin: u32,
        /// Number of faces of the document.
        faces: usize,
    },
    /// A face comes from an earlier face than the one before it.
    #[error("face {face} comes from face {origin}, the one before it from face {before}: origins ascend")]
    OriginOrder {
        /// Index of the face in the refinement.
        face: usize,
        /// The face of the document that it comes from.
        origin: u32,
        /// That of the face before it.
        before: u32,
    },
    /// A face is none.
    #[error(transparent)]
    Face(#[from] MeshError),
    /// An added vertex is mixed of a vertex that the document does not have.
    #[error("vertex {vertex} is mixed of vertex {part}, but the document has {vertices} vertices")]
    MissingVertex {
        /// Index of the added vertex, behind those of the document.
        vertex: usize,
        /// The vertex of the document that it names.
        part: u32,
        /// Number of vertices of the document.
        vertices: usize,
    },
    /// A corner is mixed of a corner that its old face does not have.
    #[error("corner {corner} of face {face} is mixed of corner {part}, but its old face has {corners} corners")]
    MissingCorner {
        /// Index of the face in the refinement.
        face: usize,
        /// Which of its corners.
        corner: usize,
        /// The corner of the old face that it names.
        part: u32,
        /// Number of corners of the old face.
        corners: usize,
    },
    /// The weights of an added vertex are no mix.
    #[error("vertex {vertex} has the weights {weights:?}: they must not be negative, and their sum must be 1")]
    VertexWeights {
        /// Index of the added vertex, behind those of the document.
        vertex: usize,
        /// Its weights.
        weights: [f64; 3],
    },
    /// The weights of a corner are no mix.
    #[error(
        "corner {corner} of face {face} has the weights {weights:?}: they must not be negative, and their sum must be 1"
    )]
    CornerWeights {
        /// Index of the face in the refinement.
        face: usize,
        /// Which of its corners.
        corner: usize,
        /// Its weights.
        weights: [f64; 3],
    },
}

/// A refinement that was found to fit a mesh.
pub(crate) struct Refined<'a> {
    mesh: &'a Mesh,
    refinement: &'a Refinement,
    /// The first new face of each old face, and one behind the last (#old faces + 1).
    pieces: Vec<usize>,
    /// The first corner of each new face, and one behind the last (#faces + 1).
    corners: Vec<usize>,
    /// Whether each old face stays as it is.
    kept: Vec<bool>,
}

/// A face in place of an old one, or of a part of it.
#[derive(Clone, Copy)]
pub(crate) struct Piece<'a> {
    pub(crate) vertices: &'a [u32],
    /// Its corners as mixes of corners of the old face.
    mixes: &'a [[(u32, f64); 3]],
}

impl Piece<'_> {
    /// Its corners: vertices, and mixes of corners of the old face.
    pub(crate) fn corners(&self) -> impl Iterator<Item = (u32, Mix)> {
        self.vertices.iter().copied().zip(self.mixes.iter().map(Mix::of))
    }

    /// Whether it is the old face itself.
    fn is(&self, face: &[u32]) -> bool {
        let stays = |(k, (v, mix)): (usize, (u32, Mix))| v == face[k] && mix.only() == Some(k as u32);
        self.vertices.len() == face.len() && self.corners().enumerate().all(stays)
    }
}

impl<'a> Refined<'a> {
    pub(crate) fn new(mesh: &'a Mesh, refinement: &'a Refinement) -> Result<Self, RefinementError> {
        let (faces, origins) = (&refinement.faces, &refinement.origins);
        if origins.len() != faces.len() {
            return Err(RefinementError::OriginCount { origins: origins.len(), faces: faces.len() });
        }
        if refinement.corners.len() != faces.corners().len() {
            let (mixes, corners) = (refinement.corners.len(), faces.corners().len());
            return Err(RefinementError::CornerCount { mixes, corners });
        }
        let vertices = mesh.points().len();
        for (k, parts) in refinement.vertices.iter().enumerate() {
            let vertex = vertices + k;
            check_weights(parts).map_err(|weights| RefinementError::VertexWeights { vertex, weights })?;
            if let Some(part) = missing(parts, vertices) {
                return Err(RefinementError::MissingVertex { vertex, part, vertices });
            }
        }
        let (mut pieces, mut corners) = (vec![0; mesh.faces().len() + 1], vec![0]);
        for (f, (face, &origin)) in faces.iter().zip(origins).enumerate() {
            if origin as usize >= mesh.faces().len() {
                return Err(RefinementError::MissingOrigin { face: f, origin, faces: mesh.faces().len() });
            }
            if let Some(&before) = f.checked_sub(1).and_then(|f| origins.get(f)).filter(|before| **before > origin) {
                return Err(RefinementError::OriginOrder { face: f, origin, before });
            }
            let first = corners[f];
            corners.push(first + face.len());
            let all = vertices + refinement.vertices.len();
            check_face(f, face, all)?;
            let old = mesh.faces().face(origin as usize).len();
            for (corner, parts) in refinement.corners[first..first + face.len()].iter().enumerate() {
                check_weights(parts).map_err(|weights| RefinementError::CornerWeights { face: f, corner, weights })?;
                if let Some(part) = missing(parts, old) {
                    return Err(RefinementError::MissingCorner { face: f, corner, part, corners: old });
                }
            }
            pieces[origin as usize + 1] = f + 1;
        }
        // Old faces without a piece have their place behind the pieces before them.
        for f in 1..pieces.len() {
            pieces[f] = pieces[f].max(pieces[f - 1]);
        }
        let mut refined = Self { mesh, refinement, pieces, corners, kept: Vec::new() };
        refined.kept = mesh.faces().iter().enumerate().map(|(f, face)| refined.is_kept(f, face)).collect();
        Ok(refined)
    }

    /// Number of vertices of the document.
    pub(crate) fn old_vertices(&self) -> usize {
        self.mesh.points().len()
    }

    /// Number of faces of the refinement.
    pub(crate) fn faces(&self) -> usize {
        self.refinement.faces.len()
    }

    /// The added vertices as mixes of those of the document.
    pub(crate) fn added(&self) -> impl ExactSizeIterator<Item = Mix> {
        self.refinement.vertices.iter().map(Mix::of)
    }

    /// The faces in place of face `f` of the document.
    pub(crate) fn pieces(&self, f: usize) -> impl ExactSizeIterator<Item = Piece<'a>> {
        let refinement = self.refinement;
        (self.pieces[f]..self.pieces[f + 1]).map(move |piece| Piece {
            vertices: refinement.faces.face(piece),
            mixes: &refinement.corners[self.corners[piece]..self.corners[piece + 1]],
        })
    }

    fn is_kept(&self, f: usize, face: &[u32]) -> bool {
        let mut pieces = self.pieces(f);
        pieces.len() == 1 && pieces.all(|piece| piece.is(face))
    }

    /// Whether face `f` of the document stays as it is.
    pub(crate) fn keeps(&self, f: usize) -> bool {
        self.kept[f]
    }

    /// Whether all faces of the document stay as they are.
    pub(crate) fn keeps_all(&self) -> bool {
        self.kept.iter().all(|kept| *kept)
    }
}

/// The weights, where they are no mix.
fn check_weights(parts: &[(u32, f64); 3]) -> Result<(), [f64; 3]> {
    let weights = parts.map(|part| part.1);
    // Comparisons with nan are false.
    let is_mix = weights.iter().all(|w| *w >= 0.0) && (weights.iter().sum::<f64>() - 1.0).abs() <= SUM_TOLERANCE;
    if is_mix { Ok(()) } else { Err(weights) }
}

/// A part that weighs something and is not among so many.
fn missing(parts: &[(u32, f64); 3], count: usize) -> Option<u32> {
    parts.iter().find(|(k, weight)| *weight != 0.0 && *k as usize >= count).map(|part| part.0)
}

fn check_face(f: usize, face: &[u32], vertices: usize) -> Result<(), MeshError> {
    if face.len() < 3 {
        return Err(MeshError::TooFewCorners { face: f, corners: face.len() });
    }
    match face.iter().find(|v| **v as usize >= vertices) {
        Some(&vertex) => Err(MeshError::MissingVertex { face: f, vertex, vertices }),
        None => Ok(()),
    }
}
