//! The section `[elastic]` of a job: what is held, which springs there are, how nodes settle.

use glam::{BVec3, DMat3, DVec3};

use crate::bspline::Basis;
use crate::lattice::Lattice;
use crate::select::Selector;
use crate::springs::{Net, Stiffness};

/// How nodes settle, with `preserve.method = "elastic"`.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct ElasticRequest {
    /// Which nodes stay where the edits put them; pins and pinned mobilities add to them.
    pub hold: Hold,
    /// Which nodes springs connect.
    pub net: Net,
    /// By which method nodes settle.
    pub solver: ElasticSolverKind,
    /// Levels of detail of the solver "augmented-lagrangian".
    pub levels: LevelCount,
    /// k of the springs.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "form::stiffness"))]
    pub stiffness: Stiffness,
    /// How smoothly the deformation goes over into what lies outside of the lattice: that many layers of nodes at its border are held at rest.
    pub continuity: Option<Continuity>,
    /// Where the centre of mass is to be.
    pub center_of_mass: Option<CenterOfMass>,
    /// Whether the inertia tensor about the centre of mass, and that centre, are to be kept.
    pub inertia: Option<Inertia>,
}

/// Which nodes stay where they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Hold {
    /// Those that an edit or the lattice file moved; a dragged vertex holds its place and no node.
    #[default]
    Edited,
    /// These; of spheres with falloff those with at least half weight.
    Nodes(Selector),
}

/// By which method nodes settle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum ElasticSolverKind {
    /// Newton's method on poses of the wanted volume.
    #[default]
    Newton,
    /// HML's.
    AugmentedLagrangian,
}

impl ElasticSolverKind {
    /// Its word in a job.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Newton => "newton",
            Self::AugmentedLagrangian => "augmented-lagrangian",
        }
    }
}

/// How many levels of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LevelCount {
    /// As many as it takes to come from 64 triangles to all by factors of about four.
    #[default]
    Auto,
    /// At most this many, the model among them; 1 is the model alone.
    AtMost(usize),
}

/// Smoothness at the border of the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Continuity {
    /// Without gaps.
    C0,
    /// Without kinks.
    C1,
    /// With continuous curvature.
    C2,
}

impl Continuity {
    /// Derivatives that are continuous.
    #[must_use]
    pub fn order(self) -> usize {
        match self {
            Self::C0 => 0,
            Self::C1 => 1,
            Self::C2 => 2,
        }
    }

    /// Which nodes of `lattice` must be at rest (#nodes), for the identity to go on beyond its frame: those on which values and derivatives up to
    /// the order depend there.
    #[must_use]
    pub fn border(self, lattice: &Lattice) -> Vec<bool> {
        let ends = lattice.bases().each_ref().map(|basis| [0, 1].map(|end| layers(basis, end == 1, self.order())));
        let size = lattice.size();
        let is_border = |node: [usize; 3]| (0..3).any(|a| node[a] < ends[a][0] || node[a] + ends[a][1] >= size[a]);
        (0..lattice.control_count()).map(|index| is_border(lattice.node(index))).collect()
    }
}

/// Basis functions, counted from an end of the domain, whose derivatives up to `order` are not all 0 there.
///
/// A function whose support begins at the end with a knot of multiplicity m in its own knots vanishes to order `degree + 1 − m`; one whose support
/// begins before it does not vanish.
fn layers(basis: &Basis, is_last: bool, order: usize) -> usize {
    let degree = basis.degree();
    let mut knots = basis.knots().to_vec();
    if is_last {
        knots.reverse();
        knots.iter_mut().for_each(|t| *t = 1.0 - *t);
    }
    let vanishes = |function: usize| {
        let own = &knots[function..=function + degree + 1];
        let multiplicity = own.iter().filter(|t| **t == 0.0).count();
        own[0] == 0.0 && degree + 1 - multiplicity > order
    };
    (0..basis.size()).find(|function| vanishes(*function) || knots[*function] > 0.0).unwrap_or(basis.size())
}

/// Where the centre of mass is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CenterOfMass {
    /// Where it is at rest.
    Keep,
    /// Here, in model coordinates.
    At(DVec3),
}

/// What the inertia tensor about the centre of mass is to be, of density 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inertia {
    /// As at rest.
    Keep,
    /// This: rows, in the fifth power of the model's length unit.
    Tensor(DMat3),
}

impl Inertia {
    /// This tensor, which must be symmetric.
    ///
    /// # Errors
    ///
    /// Rows that differ from the columns by more than rounding.
    pub fn tensor(rows: [DVec3; 3]) -> Result<Self, &'static str> {
        let tensor = DMat3::from_cols(rows[0], rows[1], rows[2]);
        let scale = rows.iter().map(|row| row.abs().max_element()).fold(0.0, f64::max);
        match tensor.abs_diff_eq(tensor.transpose(), 1e-12 * scale) {
            true => Ok(Self::Tensor(0.5 * (tensor + tensor.transpose()))),
            false => Err("an inertia tensor is symmetric: entry [i][j] is entry [j][i]"),
        }
    }
}

/// Coordinates that are free: of nodes that are not held, along the axes `along`.
pub(crate) fn free_coordinates(is_held: &[bool], along: DVec3, mobility: Option<&[DVec3]>) -> Vec<BVec3> {
    let free = |node: usize| {
        let of_file = mobility.map_or(DVec3::ONE, |mobility| mobility[node]);
        let is_free = |a: usize| !is_held[node] && along[a] > 0.0 && of_file[a] > 0.0;
        BVec3::new(is_free(0), is_free(1), is_free(2))
    };
    (0..is_held.len()).map(free).collect()
}

/// How values stand in a job file: words, or what they mean.
#[cfg(feature = "serde")]
mod form {
    use std::marker::PhantomData;

    use glam::DVec3;
    use serde::de::{Error, value::MapAccessDeserializer, value::SeqAccessDeserializer};
    use serde::de::{MapAccess, SeqAccess, Visitor};
    use serde::{Deserialize, Deserializer};

    use super::{CenterOfMass, Hold, Inertia, LevelCount};
    use crate::exact::Exact;
    use crate::select::Selector;
    use crate::springs::Stiffness;

    impl<'de> Deserialize<'de> for Hold {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            struct HoldVisitor;
            impl<'de> Visitor<'de> for HoldVisitor {
                type Value = Hold;

                fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                    f.write_str("\"edited\", \"all\", or nodes such as { k = 0 }")
                }

                fn visit_str<E: Error>(self, text: &str) -> Result<Hold, E> {
                    match text {
                        "edited" => Ok(Hold::Edited),
                        text => text.parse().map(Hold::Nodes).map_err(E::custom),
                    }
                }

                fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Hold, A::Error> {
                    Selector::deserialize(MapAccessDeserializer::new(table)).map(Hold::Nodes)
                }
            }
            from.deserialize_any(HoldVisitor)
        }
    }

    impl<'de> Deserialize<'de> for LevelCount {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            struct LevelsVisitor;
            impl Visitor<'_> for LevelsVisitor {
                type Value = LevelCount;

                fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                    f.write_str("\"auto\" or a whole number of at least 1")
                }

                fn visit_str<E: Error>(self, text: &str) -> Result<LevelCount, E> {
                    match text {
                        "auto" => Ok(LevelCount::Auto),
                        text => Err(E::invalid_value(serde::de::Unexpected::Str(text), &self)),
                    }
                }

                fn visit_u64<E: Error>(self, count: u64) -> Result<LevelCount, E> {
                    match usize::try_from(count) {
                        Ok(count) if count > 0 => Ok(LevelCount::AtMost(count)),
                        _ => Err(E::invalid_value(serde::de::Unexpected::Unsigned(count), &self)),
                    }
                }

                fn visit_i64<E: Error>(self, count: i64) -> Result<LevelCount, E> {
                    let count = u64::try_from(count);
                    count.or_else(|_| Ok(0)).and_then(|count| self.visit_u64(count))
                }
            }
            from.deserialize_any(LevelsVisitor)
        }
    }

    impl<'de> Deserialize<'de> for CenterOfMass {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            let expected = "\"keep\" or a point [x, y, z]";
            let given = from.deserialize_any(KeepVisitor::<f64> { expected, numbers: PhantomData })?;
            Ok(given.map_or(Self::Keep, |point| Self::At(DVec3::from(point))))
        }
    }

    impl<'de> Deserialize<'de> for Inertia {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            let expected = "\"keep\" or a symmetric matrix of three rows";
            let given = from.deserialize_any(KeepVisitor::<Exact<f64, 3>> { expected, numbers: PhantomData })?;
            let Some(Exact(rows)) = given else { return Ok(Self::Keep) };
            Self::tensor(rows.map(DVec3::from)).map_err(D::Error::custom)
        }
    }

    /// "keep", which is `None`, or three of something.
    struct KeepVisitor<T> {
        expected: &'static str,
        numbers: PhantomData<T>,
    }

    impl<'de, T: Deserialize<'de>> Visitor<'de> for KeepVisitor<T> {
        type Value = Option<Exact<T, 3>>;

        fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
            f.write_str(self.expected)
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
            match text {
                "keep" => Ok(None),
                text => Err(E::invalid_value(serde::de::Unexpected::Str(text), &self)),
            }
        }

        fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
            Exact::deserialize(SeqAccessDeserializer::new(list)).map(Some)
        }
    }

    #[derive(Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct StiffnessTable {
        edge: f64,
        face: f64,
        cell: f64,
    }

    impl Default for StiffnessTable {
        fn default() -> Self {
            let Stiffness { edge, face, cell } = Stiffness::default();
            Self { edge, face, cell }
        }
    }

    pub fn stiffness<'de, D: Deserializer<'de>>(from: D) -> Result<Stiffness, D::Error> {
        struct StiffnessVisitor;
        impl<'de> Visitor<'de> for StiffnessVisitor {
            type Value = Stiffness;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number, or a table of edge, face and cell")
            }

            fn visit_f64<E: Error>(self, k: f64) -> Result<Stiffness, E> {
                Ok(Stiffness::uniform(k))
            }

            fn visit_i64<E: Error>(self, k: i64) -> Result<Stiffness, E> {
                Ok(Stiffness::uniform(k as f64))
            }

            fn visit_u64<E: Error>(self, k: u64) -> Result<Stiffness, E> {
                Ok(Stiffness::uniform(k as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Stiffness, A::Error> {
                let StiffnessTable { edge, face, cell } =
                    StiffnessTable::deserialize(MapAccessDeserializer::new(table))?;
                Ok(Stiffness { edge, face, cell })
            }
        }
        from.deserialize_any(StiffnessVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_those_whose_derivatives_do_not_vanish() {
        let basis = Basis::bernstein(5).unwrap();
        assert_eq!([0, 1, 2].map(|order| layers(&basis, false, order)), [1, 2, 3]);
        assert_eq!([0, 1, 2].map(|order| layers(&basis, true, order)), [1, 2, 3]);
        // Uniform cubics: at the end of the domain three functions have a value, and the fourth vanishes to third order.
        let uniform = Basis::uniform(7, 3).unwrap();
        assert_eq!([0, 1, 2].map(|order| layers(&uniform, false, order)), [3; 3]);
        assert_eq!([0, 1, 2].map(|order| layers(&uniform, true, order)), [3; 3]);
        // Linear: a second layer is all there is.
        let linear = Basis::clamped(4, 1).unwrap();
        assert_eq!([0, 1, 2].map(|order| layers(&linear, false, order)), [1, 2, 2]);
    }
}
