//! Direct manipulation: vertices that are brought to given places by the smallest displacement of the control points.
//!
//! With w the row of W of a vertex that stands at S, T its target and m the mobilities of the control points (the weights of
//! `nodes`), a drag adds to the control points the δ that minimises `Σ_i |δ_i|²/m_i` with `Σ_i w_i δ_i = T − S` for each of its
//! vertices. For one vertex that is
//!
//! ```text
//! δ_i = m_i w_i (T − S) / Σ_j m_j w_j²
//! ```
//!
//! W. M. Hsu, J. F. Hughes, H. Kaufman, *Direct manipulation of free-form deformations*, SIGGRAPH 1992, section 4; HB (20) without
//! the volume.
//!
//! # Changes versus the paper
//!
//! - Mobilities; rows that depend on others are found ([`least_displacement`]) instead of a pseudoinverse that would meet
//!   contradicting targets on average.

use glam::DVec3;

use crate::job::PointRequest;
use crate::points::{PointError, PointTarget, least_displacement};
use crate::select::{ControlSpace, Selector};

/// Vertices go to places.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "form::Table", into = "form::Table")
)]
pub struct Drag {
    /// The vertices with their places, in model coordinates.
    pub points: Vec<PointRequest>,
    /// The control points that it moves; their weights are mobilities.
    pub nodes: Selector,
}

/// Why vertices cannot be dragged to their places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DragError {
    /// An infinite coordinate, or one that is not a number.
    #[error("vertex {vertex} is to go to ({}, {}, {}): coordinates must be finite", .to.x, .to.y, .to.z)]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// Its target.
        to: DVec3,
    },
    /// A vertex that does not exist.
    #[error("it names vertex {vertex}, but the model has {vertices} (0 to {})", .vertices.saturating_sub(1))]
    MissingVertex {
        /// The vertex.
        vertex: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex that none of the selected control points moves.
    #[error(
        "vertex {vertex} follows none of the selected control points and misses its target by {by:.3e}: it is outside the \
         lattice, or `nodes` leaves out what moves it"
    )]
    Unmoved {
        /// The vertex.
        vertex: usize,
        /// How far it is from its target.
        by: f64,
    },
    /// A vertex whose target contradicts those of the others.
    #[error(
        "vertex {vertex} misses its target by {by:.3e} whatever the selected control points do, given the other vertices"
    )]
    Contradiction {
        /// Index in `points`.
        point: usize,
        /// The vertex.
        vertex: usize,
        /// By how far it misses along one coordinate.
        by: f64,
    },
    /// Finite numbers whose result is not.
    #[error("the displacement it takes leaves the range of numbers")]
    Overflow,
}

impl Drag {
    /// By how much control points at `controls` move (#controls × 3), given their mobility (#controls).
    pub(crate) fn displacement(
        &self,
        controls: &[DVec3],
        mobility: &[f64],
        space: &ControlSpace,
    ) -> Result<Vec<DVec3>, DragError> {
        let vertices = space.vertices.map_or(0, |vertices| vertices.rest.len());
        let target = |&PointRequest { vertex, to }: &PointRequest| {
            let bound = space.vertices.filter(|_| vertex < vertices);
            let bound = bound.ok_or(DragError::MissingVertex { vertex, vertices })?;
            if !to.is_finite() {
                return Err(DragError::NotFinite { vertex, to });
            }
            let weights = bound.binding.weights(vertex);
            let moved: DVec3 = weights.iter().map(|&(c, w)| w * (controls[c] - space.rest[c])).sum();
            Ok(PointTarget { weights, position: bound.rest[vertex] + moved, target: space.position(to) })
        };
        let points = self.points.iter().map(target).collect::<Result<Vec<_>, _>>()?;
        let mobility: Vec<DVec3> = mobility.iter().map(|m| DVec3::splat(*m)).collect();
        // What is dragged far has the rounding of far coordinates.
        let reach = points.iter().map(|p| p.target.distance(p.position)).fold(space.extent, f64::max);
        least_displacement(&points, &mobility, reach).map_err(|error| match error {
            PointError::Unmoved { point, by } => DragError::Unmoved { vertex: self.points[point].vertex, by },
            PointError::Contradiction { point, by } => {
                DragError::Contradiction { point, vertex: self.points[point].vertex, by }
            }
            PointError::Value { .. } | PointError::Mobility { .. } | PointError::Overflow => DragError::Overflow,
        })
    }
}

/// How a drag stands in a job file.
#[cfg(feature = "serde")]
mod form {
    use glam::DVec3;
    use serde::{Deserialize, Serialize};

    use super::Drag;
    use crate::exact;
    use crate::job::PointRequest;
    use crate::select::Selector;

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Table {
        #[serde(default, skip_serializing_if = "Option::is_none")]
        vertex: Option<usize>,
        #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exact::optional_vector")]
        to: Option<DVec3>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        points: Option<Vec<PointRequest>>,
        #[serde(default)]
        nodes: Selector,
    }

    impl TryFrom<Table> for Drag {
        type Error = &'static str;

        fn try_from(table: Table) -> Result<Self, &'static str> {
            let points = match (table.points, table.vertex, table.to) {
                (Some(points), None, None) => points,
                (None, Some(vertex), Some(to)) => vec![PointRequest { vertex, to }],
                (Some(_), ..) => {
                    return Err("drag has both `points` and `vertex` or `to`: it must have only one of them");
                }
                (None, Some(_), None) => return Err("drag has `vertex` but no `to`, the place where it goes"),
                (None, None, Some(_)) => return Err("drag has `to` but no `vertex` that goes there"),
                (None, None, None) => {
                    return Err("drag has neither `vertex` and `to` nor `points`: it needs one of them");
                }
            };
            Ok(Self { points, nodes: table.nodes })
        }
    }

    impl From<Drag> for Table {
        fn from(Drag { points, nodes }: Drag) -> Self {
            match points[..] {
                [PointRequest { vertex, to }] => Self { vertex: Some(vertex), to: Some(to), points: None, nodes },
                _ => Self { vertex: None, to: None, points: Some(points), nodes },
            }
        }
    }
}
