//! Given positions of control points, from another program or by hand.

use glam::DVec3;

use crate::select::{ControlSpace, SelectError, Selector};

/// Given positions, in place of what earlier edits did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "form::Table", into = "form::Table")
)]
pub struct Posed {
    /// The positions.
    pub to: PosedTo,
    /// The control points it moves, among those that have a position.
    pub nodes: Selector,
}

/// Positions of control points, in model coordinates. A coordinate that equals the one at rest (in model coordinates) stands
/// for it bit for bit, however far from the origin the model is.
#[derive(Clone, Debug, PartialEq)]
pub enum PosedTo {
    /// Of single control points, each at most once; the others stay where they are.
    Points(Vec<PosedPoint>),
    /// Of all control points: `[i][j][k]`, as many as the lattice has along u, v, w.
    Lattice(Vec<Vec<Vec<DVec3>>>),
}

/// Position of one control point.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct PosedPoint {
    /// The control point (i, j, k), 0-based.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::array"))]
    pub node: [usize; 3],
    /// Where it goes, in model coordinates.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::vector"))]
    pub to: DVec3,
}

/// Why positions do not fit the lattice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PosedError {
    /// An infinite coordinate, or one that is not a number.
    #[error("{place} is ({}, {}, {}): coordinates must be finite", .to.x, .to.y, .to.z)]
    NotFinite {
        /// `points[…].to` or `lattice[i][j][k]`.
        place: String,
        /// The position.
        to: DVec3,
    },
    /// A control point that does not exist.
    #[error("points[{point}]: {source}")]
    Missing {
        /// Index in `points`.
        point: usize,
        /// What is wrong with it.
        source: SelectError,
    },
    /// A control point with two positions.
    #[error("points[{point}] is node [{}, {}, {}], which an earlier point has posed already", .node[0], .node[1], .node[2])]
    Twice {
        /// Index in `points`.
        point: usize,
        /// The control point.
        node: [usize; 3],
    },
    /// Positions for a lattice of another size.
    #[error("{place} has {found} entries, expected {expected}: the lattice has {} × {} × {} control points", .size[0], .size[1], .size[2])]
    Size {
        /// `lattice`, `lattice[i]` or `lattice[i][j]`.
        place: String,
        /// How many entries it has.
        found: usize,
        /// How many it should have.
        expected: usize,
        /// Control points along u, v, w.
        size: [usize; 3],
    },
}

impl Posed {
    /// Where control points go (#controls × 3, relative to the origin of `space`); `None` for those without position.
    pub(crate) fn targets(&self, space: &ControlSpace) -> Result<Vec<Option<DVec3>>, PosedError> {
        let mut targets = vec![None; space.rest.len()];
        match &self.to {
            PosedTo::Points(points) => {
                for (point, &PosedPoint { node, to }) in points.iter().enumerate() {
                    if !to.is_finite() {
                        return Err(PosedError::NotFinite { place: format!("points[{point}].to"), to });
                    }
                    let c = space.index(node).map_err(|source| PosedError::Missing { point, source })?;
                    if targets[c].replace(to).is_some() {
                        return Err(PosedError::Twice { point, node });
                    }
                }
            }
            PosedTo::Lattice(lattice) => {
                check_size(lattice, space.size)?;
                for (c, (target, &to)) in targets.iter_mut().zip(lattice.iter().flatten().flatten()).enumerate() {
                    if !to.is_finite() {
                        let [i, j, k] = space.node(c);
                        return Err(PosedError::NotFinite { place: format!("lattice[{i}][{j}][{k}]"), to });
                    }
                    *target = Some(to);
                }
            }
        }
        for (target, &rest) in targets.iter_mut().zip(space.rest) {
            if let Some(to) = target {
                *to = DVec3::select(to.cmpeq(rest + space.origin), rest, space.position(*to));
            }
        }
        Ok(targets)
    }
}

fn check_size(lattice: &[Vec<Vec<DVec3>>], size: [usize; 3]) -> Result<(), PosedError> {
    let wrong = |place, found, expected| Err(PosedError::Size { place, found, expected, size });
    if lattice.len() != size[0] {
        return wrong("lattice".to_owned(), lattice.len(), size[0]);
    }
    for (i, slice) in lattice.iter().enumerate() {
        if slice.len() != size[1] {
            return wrong(format!("lattice[{i}]"), slice.len(), size[1]);
        }
        if let Some(j) = slice.iter().position(|row| row.len() != size[2]) {
            return wrong(format!("lattice[{i}][{j}]"), slice[j].len(), size[2]);
        }
    }
    Ok(())
}

/// How given positions stand in a job file.
#[cfg(feature = "serde")]
mod form {
    use glam::DVec3;
    use serde::{Deserialize, Deserializer, Serialize};

    use super::{Posed, PosedPoint, PosedTo};
    use crate::exact::Exact;
    use crate::select::Selector;

    /// Positions `[i][j][k]`.
    type Nested = Vec<Vec<Vec<DVec3>>>;

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Table {
        #[serde(default, skip_serializing_if = "Option::is_none")]
        points: Option<Vec<PosedPoint>>,
        #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "lattice")]
        lattice: Option<Nested>,
        #[serde(default)]
        nodes: Selector,
    }

    fn lattice<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Nested>, D::Error> {
        let read = Option::<Vec<Vec<Vec<Exact<f64, 3>>>>>::deserialize(from)?;
        let row = |row: Vec<Exact<f64, 3>>| row.into_iter().map(DVec3::from).collect::<Vec<_>>();
        let slice = |slice: Vec<Vec<_>>| slice.into_iter().map(row).collect::<Vec<_>>();
        Ok(read.map(|slices| slices.into_iter().map(slice).collect()))
    }

    impl TryFrom<Table> for Posed {
        type Error = &'static str;

        fn try_from(Table { points, lattice, nodes }: Table) -> Result<Self, &'static str> {
            match (points, lattice) {
                (Some(points), None) => Ok(Self { to: PosedTo::Points(points), nodes }),
                (None, Some(lattice)) => Ok(Self { to: PosedTo::Lattice(lattice), nodes }),
                (None, None) => Err("posed has neither `points` nor `lattice`: it needs one of them"),
                (Some(_), Some(_)) => Err("posed has both `points` and `lattice`: it must have only one of them"),
            }
        }
    }

    impl From<Posed> for Table {
        fn from(Posed { to, nodes }: Posed) -> Self {
            match to {
                PosedTo::Points(points) => Self { points: Some(points), lattice: None, nodes },
                PosedTo::Lattice(lattice) => Self { points: None, lattice: Some(lattice), nodes },
            }
        }
    }
}
