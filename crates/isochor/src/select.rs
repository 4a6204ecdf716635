//! Which control points: selectors, and the space in which users point at them.
//!
//! A selector gives every control point a weight in 0 ..= 1. It looks only at indices and at rest positions, so that it
//! picks the same points before and after an edit.
//!
//! | job file | command line | weight 1 for |
//! |---|---|---|
//! | `"all"` | `all` | every control point |
//! | `{ k = 0 }`, `{ i = 0, k = [0, 5] }` | `k=0`, `i=0 k=0,5` | these 0-based indices along u (i), v (j), w (k), all at once |
//! | `{ list = [[0, 0, 5], [1, 0, 5]] }` | | these (i, j, k) |
//! | `{ vertices = [3, 17] }` | `v=3,17` | these vertices of a cage, 0-based |
//! | `{ box = [[x, y, z], [x, y, z]] }` | | rest positions within the box |
//! | `{ sphere = { center = [x, y, z], radius = r, falloff = f } }` | | rest positions within r of the centre |
//!
//! Beyond the radius r of a sphere the weight falls as `1 − t² (3 − 2t)`, `t = (distance − r) / f`, to 0 at r + f.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;

use crate::binding::BoundVertices;
use crate::mesh::Bounds;
use crate::tolerances;
use crate::volume::Solid;

/// The control points of a lattice or a cage at rest, and how a user's numbers are to be read among them.
///
/// Positions here are relative to `origin`, so that nothing is lost where a model is far from the origin of its file;
/// users point with *model coordinates*, as in the file: model coordinates = position + `origin`.
#[derive(Clone, Copy, Debug)]
pub struct ControlSpace<'a> {
    /// Rest positions (#controls × 3), relative to `origin`; control (i, j, k) has the index
    /// `(i · size[1] + j) · size[2] + k`.
    pub rest: &'a [DVec3],
    /// Control points along u, v, w; their product is #controls. Vertices of a cage are 1 × 1 × #controls; lattices have at least two points
    /// along each axis.
    pub size: [usize; 3],
    /// The axis-parallel box of the lattice frame, or of the cage, at rest, relative to `origin`. Ranges are fractions of it, and its middle
    /// is the default centre.
    pub bounds: Bounds,
    /// The extent: longest side of the *model's* bounding box at rest, in its length unit.
    pub extent: f64,
    /// Where positions are measured from, in model coordinates.
    pub origin: DVec3,
    /// The model's vertices, relative to `origin`, and how they follow the control points: what a drag needs. `None`: there are
    /// no vertices.
    pub vertices: Option<BoundVertices<'a>>,
    /// The body that the vertices bound: what keeps its volume in a slide. `None`: there is none.
    pub solid: Option<&'a Solid>,
}

impl ControlSpace<'_> {
    /// Position of a point that is given in model coordinates.
    #[must_use]
    pub fn position(&self, model_coordinates: DVec3) -> DVec3 {
        model_coordinates - self.origin
    }

    /// Flat index of control point (i, j, k).
    ///
    /// # Errors
    ///
    /// An index beyond the lattice.
    pub fn index(&self, node: [usize; 3]) -> Result<usize, SelectError> {
        for (axis, &index) in node.iter().enumerate() {
            self.check_index(axis, index)?;
        }
        Ok((node[0] * self.size[1] + node[1]) * self.size[2] + node[2])
    }

    /// The (i, j, k) of a flat index.
    #[must_use]
    pub fn node(&self, index: usize) -> [usize; 3] {
        let [_, nv, nw] = self.size;
        [index / (nv * nw), index / nw % nv, index % nw]
    }

    /// Whether the control points are vertices of a cage.
    #[must_use]
    pub fn is_cage(&self) -> bool {
        self.size[..2] == [1, 1]
    }

    /// ∂V/∂C (#controls × 3) with the control points at `controls`. `None` where there are no vertices, or they bound no body.
    #[must_use]
    pub fn volume_gradient(&self, controls: &[DVec3]) -> Option<Vec<DVec3>> {
        let (vertices, solid) = (self.vertices?, self.solid?);
        let displacement: Vec<DVec3> = controls.iter().zip(self.rest).map(|(posed, rest)| *posed - *rest).collect();
        let posed = vertices.binding.displaced(vertices.rest, &displacement);
        Some(vertices.binding.adjoint(&solid.volume_gradient(&posed)))
    }

    fn check_index(&self, axis: usize, index: usize) -> Result<(), SelectError> {
        let size = self.size[axis];
        if index < size { Ok(()) } else { Err(SelectError::Index { axis: INDEX_NAMES[axis], index, size }) }
    }
}

/// Names of the indices along u, v, w.
const INDEX_NAMES: [char; 3] = ['i', 'j', 'k'];

/// Which control points; the module lists the forms in which it can be written.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "form::Form", into = "form::Form")
)]
pub enum Selector {
    /// Every control point.
    #[default]
    All,
    /// The control points whose indices along u, v, w are all in these lists (0-based); `None` stands for any index.
    Indices([Option<Vec<usize>>; 3]),
    /// The control points (i, j, k), 0-based.
    List(Vec<[usize; 3]>),
    /// Vertices of a cage, 0-based.
    Vertices(Vec<usize>),
    /// Rest positions within the box between two opposite corners in model coordinates, its faces included (up to
    /// [`tolerances::INSIDE`] of the longest side of the lattice box).
    Box([DVec3; 2]),
    /// Rest positions in and near a sphere.
    Sphere {
        /// Its centre, in model coordinates.
        center: DVec3,
        /// Up to this distance from the centre the weight is 1 (up to [`tolerances::INSIDE`] of the longest side of the
        /// lattice box); in the model's length unit, not negative.
        radius: f64,
        /// At this distance beyond the radius the weight has fallen to 0; in the model's length unit, not negative.
        falloff: f64,
    },
}

/// Why a selector cannot be read, or picks nothing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SelectError {
    /// No control point has a weight above 0.
    #[error("no control point is selected by {selector}")]
    Nothing {
        /// The selector.
        selector: Selector,
    },
    /// An index beyond the lattice.
    #[error("{axis} = {index} is beyond the lattice: it has {size} control points there, {axis} = 0 to {}", .size.saturating_sub(1))]
    Index {
        /// 'i', 'j' or 'k'.
        axis: char,
        /// The index.
        index: usize,
        /// Control points along that axis.
        size: usize,
    },
    /// A vertex beyond the cage.
    #[error("vertex {vertex} is beyond the cage: it has {vertices}, 0 to {}", .vertices.saturating_sub(1))]
    Vertex {
        /// The vertex.
        vertex: usize,
        /// Vertices of the cage.
        vertices: usize,
    },
    /// Vertices of a cage where there is a lattice.
    #[error(
        "{selector} picks vertices of a cage, but the control points are those of a lattice: they have indices i, j, k"
    )]
    NoCage {
        /// The selector.
        selector: Selector,
    },
    /// Indices of a lattice where there is a cage.
    #[error(
        "{selector} picks points of a lattice, but the control points are vertices of a cage: write {{ vertices = [0, 1] }} or v=0,1"
    )]
    NoLattice {
        /// The selector.
        selector: Selector,
    },
    /// An infinite coordinate or length, or one that is not a number.
    #[error("{key} is {value}: it must be finite")]
    NotFinite {
        /// The key that has it.
        key: &'static str,
        /// The number.
        value: f64,
    },
    /// A length below 0.
    #[error("{key} is {value}: it must not be negative")]
    Negative {
        /// The key that has it.
        key: &'static str,
        /// The number.
        value: f64,
    },
    /// None of the forms, or several at once.
    #[error("a selector has either list, or vertices, or box, or sphere, or some of i, j and k; this one has {}", if .keys.is_empty() { "none of them" } else { .keys })]
    Form {
        /// The keys it has, separated by commas.
        keys: String,
    },
    /// Text that is no selector.
    #[error(
        "`{text}` selects no control points: write `all` or 0-based indices such as `k=0`, `k=0,5` or `i=0 k=5`, of a cage `v=0,5`"
    )]
    Text {
        /// The text.
        text: String,
    },
    /// An index named twice in a text.
    #[error("`{text}` gives {axis} twice: write several indices as `{axis}=0,5`")]
    Twice {
        /// The text.
        text: String,
        /// 'i', 'j' or 'k'.
        axis: char,
    },
}

impl Selector {
    /// The weights of all control points (#controls), each in 0 ..= 1; some are above 0.
    ///
    /// # Errors
    ///
    /// A selector that picks no control point; an index beyond the lattice; a number that is not finite; a negative radius
    /// or falloff.
    pub fn weights(&self, controls: &ControlSpace) -> Result<Vec<f64>, SelectError> {
        // Like the border of a lattice, the border of a box or sphere holds what was rounded to just outside it.
        let slack = tolerances::INSIDE * controls.bounds.extent();
        let selector = self.clone();
        match self {
            Self::Indices(_) | Self::List(_) if controls.is_cage() => return Err(SelectError::NoLattice { selector }),
            Self::Vertices(_) if !controls.is_cage() => return Err(SelectError::NoCage { selector }),
            _ => {}
        }
        let weights: Vec<f64> = match self {
            Self::All => vec![1.0; controls.rest.len()],
            Self::Indices(indices) => index_weights(indices, controls)?,
            Self::List(nodes) => {
                let mut weights = vec![0.0; controls.rest.len()];
                for &node in nodes {
                    weights[controls.index(node)?] = 1.0;
                }
                weights
            }
            Self::Vertices(vertices) => {
                let mut weights = vec![0.0; controls.rest.len()];
                for &vertex in vertices {
                    let missing = SelectError::Vertex { vertex, vertices: controls.rest.len() };
                    *weights.get_mut(vertex).ok_or(missing)? = 1.0;
                }
                weights
            }
            Self::Box(corners) => {
                for corner in corners {
                    check_finite("box", &corner.to_array())?;
                }
                let [a, b] = corners.map(|corner| controls.position(corner));
                let (low, high) = (a.min(b) - slack, a.max(b) + slack);
                let inside = |p: &DVec3| low.cmple(*p).all() && high.cmpge(*p).all();
                controls.rest.iter().map(|p| if inside(p) { 1.0 } else { 0.0 }).collect()
            }
            Self::Sphere { center, radius, falloff } => {
                check_finite("center", &center.to_array())?;
                check_length("radius", *radius)?;
                check_length("falloff", *falloff)?;
                let center = controls.position(*center);
                let weight = |p: &DVec3| match p.distance(center) - radius {
                    beyond if beyond <= slack => 1.0,
                    beyond if beyond < *falloff => {
                        let t = beyond / falloff;
                        1.0 - t * t * (3.0 - 2.0 * t)
                    }
                    _ => 0.0,
                };
                controls.rest.iter().map(weight).collect()
            }
        };
        if weights.iter().any(|w| *w > 0.0) {
            Ok(weights)
        } else {
            Err(SelectError::Nothing { selector: self.clone() })
        }
    }
}

fn index_weights(indices: &[Option<Vec<usize>>; 3], controls: &ControlSpace) -> Result<Vec<f64>, SelectError> {
    let mut picked = controls.size.map(|size| vec![true; size]);
    for (axis, list) in indices.iter().enumerate() {
        let Some(list) = list else { continue };
        picked[axis].fill(false);
        for &index in list {
            controls.check_index(axis, index)?;
            picked[axis][index] = true;
        }
    }
    let is_picked = |[i, j, k]: [usize; 3]| picked[0][i] && picked[1][j] && picked[2][k];
    Ok((0..controls.rest.len()).map(|c| if is_picked(controls.node(c)) { 1.0 } else { 0.0 }).collect())
}

fn check_finite(key: &'static str, values: &[f64]) -> Result<(), SelectError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(SelectError::NotFinite { key, value }),
        None => Ok(()),
    }
}

fn check_length(key: &'static str, value: f64) -> Result<(), SelectError> {
    check_finite(key, &[value])?;
    if value < 0.0 { Err(SelectError::Negative { key, value }) } else { Ok(()) }
}

/// Reads `all` and lists of 0-based indices such as `k=0`, `k=0,5` or `i=0 k=5`.
impl FromStr for Selector {
    type Err = SelectError;

    fn from_str(text: &str) -> Result<Self, SelectError> {
        if text.trim() == "all" {
            return Ok(Self::All);
        }
        let no_selector = || SelectError::Text { text: text.to_owned() };
        let numbers =
            |list: &str| list.split(',').map(str::parse).collect::<Result<Vec<usize>, _>>().map_err(|_| no_selector());
        if let Some(list) = text.trim().strip_prefix("v=") {
            return Ok(Self::Vertices(numbers(list)?));
        }
        let mut indices = [None, None, None];
        for part in text.split_whitespace() {
            let (name, list) = part.split_once('=').ok_or_else(no_selector)?;
            let axis = INDEX_NAMES.iter().position(|n| name == n.to_string()).ok_or_else(no_selector)?;
            if indices[axis].replace(numbers(list)?).is_some() {
                return Err(SelectError::Twice { text: text.to_owned(), axis: INDEX_NAMES[axis] });
            }
        }
        if indices.iter().all(Option::is_none) { Err(no_selector()) } else { Ok(Self::Indices(indices)) }
    }
}

/// Index selectors are written as [`FromStr`] reads them.
impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Indices(indices) => {
                let mut gap = "";
                for (name, list) in INDEX_NAMES.iter().zip(indices) {
                    if let Some(list) = list {
                        let list = list.iter().map(usize::to_string).collect::<Vec<_>>().join(",");
                        write!(f, "{gap}{name}={list}")?;
                        gap = " ";
                    }
                }
                Ok(())
            }
            Self::List(nodes) => write!(f, "a list of {} control points", nodes.len()),
            Self::Vertices(vertices) => {
                write!(f, "v={}", vertices.iter().map(usize::to_string).collect::<Vec<_>>().join(","))
            }
            Self::Box([a, b]) => write!(f, "the box from {a} to {b}"),
            Self::Sphere { center, radius, falloff } => {
                write!(f, "the sphere round {center} of radius {radius} and falloff {falloff}")
            }
        }
    }
}

/// How a selector stands in a job file.
#[cfg(feature = "serde")]
mod form {
    use std::fmt;

    use glam::DVec3;
    use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
    use serde::de::{Error, MapAccess, SeqAccess, Visitor};
    use serde::{Deserialize, Deserializer, Serialize};

    use super::{SelectError, Selector};
    use crate::exact::{self, Exact};

    #[derive(Serialize)]
    #[serde(untagged)]
    pub enum Form {
        Text(String),
        Table(Table),
    }

    #[derive(Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Table {
        #[serde(skip_serializing_if = "Option::is_none")]
        i: Option<Indices>,
        #[serde(skip_serializing_if = "Option::is_none")]
        j: Option<Indices>,
        #[serde(skip_serializing_if = "Option::is_none")]
        k: Option<Indices>,
        #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "list")]
        list: Option<Vec<[usize; 3]>>,
        #[serde(skip_serializing_if = "Option::is_none")]
        vertices: Option<Indices>,
        #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "corners")]
        r#box: Option<[DVec3; 2]>,
        #[serde(skip_serializing_if = "Option::is_none")]
        sphere: Option<Sphere>,
    }

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Sphere {
        #[serde(deserialize_with = "exact::vector")]
        center: DVec3,
        radius: f64,
        #[serde(default)]
        falloff: f64,
    }

    fn list<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<[usize; 3]>>, D::Error> {
        let nodes = Option::<Vec<Exact<_, 3>>>::deserialize(from)?;
        Ok(nodes.map(|nodes| nodes.into_iter().map(|Exact(node)| node).collect()))
    }

    fn corners<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[DVec3; 2]>, D::Error> {
        let corners: Option<[Exact<f64, 3>; 2]> = exact::optional_array(from)?;
        Ok(corners.map(|corners| corners.map(DVec3::from)))
    }

    /// One index or a list of them.
    #[derive(Serialize)]
    struct Indices(Vec<usize>);

    // By hand, not as an untagged enum, whose messages would not name the unknown key or the wrong value.
    impl<'de> Deserialize<'de> for Form {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            struct FormVisitor;
            impl<'de> Visitor<'de> for FormVisitor {
                type Value = Form;

                fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                    f.write_str("a selector: \"all\" or a table with i, j, k, list, vertices, box or sphere")
                }

                fn visit_str<E: Error>(self, text: &str) -> Result<Form, E> {
                    Ok(Form::Text(text.to_owned()))
                }

                fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Form, A::Error> {
                    Table::deserialize(MapAccessDeserializer::new(map)).map(Form::Table)
                }
            }
            deserializer.deserialize_any(FormVisitor)
        }
    }

    impl<'de> Deserialize<'de> for Indices {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            struct IndicesVisitor;
            impl<'de> Visitor<'de> for IndicesVisitor {
                type Value = Indices;

                fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                    f.write_str("an index (0 or more) or a list of them")
                }

                fn visit_u64<E: Error>(self, index: u64) -> Result<Indices, E> {
                    // An index too large for the machine is beyond every lattice.
                    Ok(Indices(vec![usize::try_from(index).unwrap_or(usize::MAX)]))
                }

                fn visit_i64<E: Error>(self, index: i64) -> Result<Indices, E> {
                    let unexpected = || E::invalid_value(serde::de::Unexpected::Signed(index), &self);
                    u64::try_from(index).map_err(|_| unexpected()).and_then(|index| self.visit_u64(index))
                }

                fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Indices, A::Error> {
                    Vec::deserialize(SeqAccessDeserializer::new(list)).map(Indices)
                }
            }
            deserializer.deserialize_any(IndicesVisitor)
        }
    }

    impl TryFrom<Form> for Selector {
        type Error = SelectError;

        fn try_from(form: Form) -> Result<Self, SelectError> {
            let Table { i, j, k, list, vertices, r#box, sphere } = match form {
                Form::Text(text) => return text.parse(),
                Form::Table(table) => table,
            };
            let has = [
                ("i", i.is_some()),
                ("j", j.is_some()),
                ("k", k.is_some()),
                ("list", list.is_some()),
                ("vertices", vertices.is_some()),
                ("box", r#box.is_some()),
                ("sphere", sphere.is_some()),
            ];
            let any_index = has[..3].iter().any(|(_, there)| *there);
            match (any_index, list, vertices, r#box, sphere) {
                (true, None, None, None, None) => {
                    Ok(Self::Indices([i, j, k].map(|indices| indices.map(|Indices(list)| list))))
                }
                (false, Some(list), None, None, None) => Ok(Self::List(list)),
                (false, None, Some(Indices(vertices)), None, None) => Ok(Self::Vertices(vertices)),
                (false, None, None, Some(corners), None) => Ok(Self::Box(corners)),
                (false, None, None, None, Some(Sphere { center, radius, falloff })) => {
                    Ok(Self::Sphere { center, radius, falloff })
                }
                _ => {
                    let keys = has.iter().filter(|(_, there)| *there).map(|(key, _)| *key).collect::<Vec<_>>();
                    Err(SelectError::Form { keys: keys.join(", ") })
                }
            }
        }
    }

    impl From<Selector> for Form {
        fn from(selector: Selector) -> Self {
            let mut table = Table::default();
            match selector {
                Selector::All => return Self::Text("all".to_owned()),
                Selector::Indices(indices) => [table.i, table.j, table.k] = indices.map(|list| list.map(Indices)),
                Selector::List(list) => table.list = Some(list),
                Selector::Vertices(vertices) => table.vertices = Some(Indices(vertices)),
                Selector::Box(corners) => table.r#box = Some(corners),
                Selector::Sphere { center, radius, falloff } => {
                    table.sphere = Some(Sphere { center, radius, falloff });
                }
            }
            Self::Table(table)
        }
    }
}
