//! Why points cannot be written into a document.

use crate::{ReadError, RefinementError};

/// Why points cannot be written into a document.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WriteError {
    /// Not one point for each vertex of the mesh.
    #[error("{points} points were given for {vertices} vertices")]
    PointCount {
        /// Number of points given.
        points: usize,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// Not one Jacobian for each vertex of the mesh.
    #[error("{jacobians} Jacobians were given for {vertices} vertices")]
    JacobianCount {
        /// Number of Jacobians given.
        jacobians: usize,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex}: {axis} = {value} is not a finite number")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
        /// The coordinate.
        value: f64,
    },
    /// An entry of a Jacobian is infinite or not a number.
    #[error("vertex {vertex}: its Jacobian is not finite")]
    JacobianNotFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A coordinate is beyond the 32-bit floats of the file.
    #[error("vertex {vertex}: {axis} = {value:e} is beyond 32-bit floats (up to 3.4e38)")]
    BeyondF32 {
        /// Index of the vertex.
        vertex: usize,
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
        /// The coordinate.
        value: f64,
    },
    /// A coordinate that the file holds as an integer was to change.
    #[error("vertex {vertex}: {axis} is stored as an integer and cannot become {value}")]
    Integer {
        /// Index of the vertex.
        vertex: usize,
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
        /// The coordinate.
        value: f64,
    },
    /// STL has no 64-bit numbers.
    #[error("STL stores 32-bit floats and cannot hold 64-bit ones")]
    StlPrecision,
    /// A new file cannot be written with integer coordinates.
    #[error("a new file is written with 32-bit or 64-bit floats, not with integers")]
    NewInteger,
    /// Too much for what the format can count.
    #[error("{count} {things} are more than the {limit} that {format} can count")]
    TooMany {
        /// Number of things.
        count: usize,
        /// What is counted.
        things: &'static str,
        /// The largest number possible.
        limit: u64,
        /// Name of the format.
        format: &'static str,
    },
    /// A refinement does not fit the mesh of the document.
    #[error("the refinement does not fit the document: {0}")]
    Refinement(#[from] RefinementError),
    /// Strips hold triangles together that a refinement splits.
    #[error("the faces of the file are triangle strips, and none of their triangles can be split")]
    Strips,
    /// A number is beyond the type that a PLY file announces for a list.
    #[error("{value} is beyond the {limit} that the list '{list}' of the file can hold")]
    ListRange {
        /// Name of the list.
        list: String,
        /// The index or count.
        value: u64,
        /// The largest number possible.
        limit: u64,
    },
    /// A statement of an OBJ file names something that does not exist, and that an added line would be.
    #[error("line {line} names {thing} {index}, but there are only {count}: an added one would take its place")]
    StrayIndex {
        /// Line of the statement, counted from 1.
        line: usize,
        /// What is named.
        thing: &'static str,
        /// Its index, counted from 1.
        index: u64,
        /// Number of such things in the file.
        count: usize,
    },
    /// The document's own bytes could not be followed again.
    #[error("the document cannot be followed: {0}")]
    Document(String),
}

impl WriteError {
    /// What to do about it.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::BeyondF32 { .. } => Some("write with precision f64 where the format allows it, or scale the model"),
            Self::Integer { .. } => Some("write with precision f64"),
            Self::StlPrecision => Some("write .ply or .obj, or keep the file's precision"),
            Self::NewInteger => Some("choose f32 or f64"),
            Self::TooMany { .. } => Some("write .ply"),
            Self::Refinement(_) => Some("refine the mesh of this document"),
            Self::Strips => Some("write a new file of the mesh, or convert the strips to faces"),
            Self::ListRange { .. } => Some("write a new file of the mesh, or announce a wider type such as uint"),
            Self::StrayIndex { .. } => Some("repair the index"),
            _ => None,
        }
    }
}

impl From<ReadError> for WriteError {
    /// The document's own bytes, which were read before, could not be followed again.
    fn from(error: ReadError) -> Self {
        Self::Document(error.to_string())
    }
}
