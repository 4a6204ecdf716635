//! A job: one whole request as data.
//!
//! The command line builds it from flags or reads it from a TOML or JSON file; every other front end builds the same
//! structure. [`Job::run`](crate::Job::run) does the work. Every default is what a newcomer gets, and a missing section
//! means its defaults: a deformation keeps the volume unless it says `volume = "free"`.

use std::path::PathBuf;
use std::str::FromStr;

use glam::DVec3;

use crate::cage_request::CageRequest;
use crate::edit::{Axis, Edit};
use crate::elastic_request::ElasticRequest;
use crate::lattice::Outside;
use crate::select::Selector;
use crate::surface_request::SurfaceRequest;
use crate::volume::OpenBoundaries;

/// One request: model, deformer, edits, what to preserve, output.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct Job {
    /// The model's file, or a built-in shape ([`ShapeName`](crate::ShapeName)). Relative paths refer to the job file's folder.
    pub model: Option<PathBuf>,
    /// Where the result goes; the format follows the extension.
    pub output: Option<PathBuf>,
    /// Where the report goes (`.json` for programs, `.html` for people), if anywhere.
    pub report: Option<PathBuf>,
    /// Where a picture goes (`.png`), if anywhere: the model at rest, deformed and corrected; of a film some of its frames.
    pub picture: Option<PathBuf>,
    /// Where the animated picture of a film goes (`.png`).
    pub animation: Option<PathBuf>,
    /// Where the lattice after the correction goes, if anywhere.
    pub save_controls: Option<PathBuf>,
    /// Number type of the written coordinates.
    pub precision: Precision,
    /// Whether the result has the same bits on every processor, not only for every number of threads.
    pub portable_bits: bool,
    /// A surface to lay the model along, before anything else. A lattice then lies round what comes of that.
    pub surface: Option<SurfaceRequest>,
    /// The lattice. Without it, edits act on the default lattice.
    pub lattice: Option<LatticeRequest>,
    /// The cage, instead of a lattice.
    pub cage: Option<CageRequest>,
    /// Edits of the control points, in order.
    pub edit: Vec<Edit>,
    /// What must hold in the end.
    pub preserve: Preserve,
    /// How nodes settle, with the method "elastic".
    pub elastic: Option<ElasticRequest>,
    /// How pictures look.
    pub view: ViewRequest,
}

/// How pictures look.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct ViewRequest {
    /// What colours say.
    pub color: ColorBy,
    /// Whether the lattice is drawn, or the flattening grid of a model along a surface.
    pub lattice: bool,
    /// Which way is up.
    pub up: Axis,
    /// From where the model is seen, about the upward axis, in degrees; −90 is from the front, where the other two axes of the model go
    /// to the right and into the picture.
    pub azimuth: f64,
    /// How far from above, in degrees.
    pub elevation: f64,
    /// Width and height of a pose in pixels; by default a size that suits what is drawn.
    pub size: Option<[u32; 2]>,
    /// How long a frame of an animation is shown.
    pub milliseconds: u16,
    /// Whether a film has pictures without being asked for them by name.
    pub film: bool,
}

impl Default for ViewRequest {
    /// Coloured by local volume change, with the lattice, from the front, a little from the right and above; z is up.
    fn default() -> Self {
        Self {
            color: ColorBy::Volume,
            lattice: true,
            up: Axis::Z,
            azimuth: -60.0,
            elevation: 22.0,
            size: None,
            milliseconds: 80,
            film: true,
        }
    }
}

/// What colours of a picture say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum ColorBy {
    /// By what factor the volume of a small piece changed.
    #[default]
    Volume,
    /// By what factor the last step changed it: the edits in the deformed pose, the correction in the corrected one.
    Steps,
    /// How far vertices moved.
    Displacement,
    /// By what angle directions turned, beyond rotations: local stress.
    Stress,
    /// Nothing.
    Plain,
}

/// Number type of written coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Precision {
    /// As the input file had.
    #[default]
    File,
    /// 64-bit floats.
    F64,
}

/// The lattice to deform with: from a file, or made here.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct LatticeRequest {
    /// A lattice file instead of everything below but `outside`.
    pub file: Option<PathBuf>,
    /// Basis; B-splines by default.
    pub basis: Option<BasisKind>,
    /// Degree of B-splines along u, v, w; 3 by default.
    pub degree: Option<PerAxis<usize>>,
    /// Knots of B-splines; clamped by default.
    pub knots: Option<Knots>,
    /// Control points along u, v, w; 6 each by default, or what explicit knots say.
    pub size: Option<PerAxis<usize>>,
    /// Fit the frame to the model's bounding box; the default unless `origin` and `axes` are given.
    pub fit: Option<Fit>,
    /// Grows a fitted box by this fraction of its extent on every side.
    pub margin: Option<f64>,
    /// Corner of an explicit frame, model coordinates.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vector"))]
    pub origin: Option<DVec3>,
    /// Whole edge vectors of an explicit frame, one per row.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vectors"))]
    pub axes: Option<[DVec3; 3]>,
    /// What happens to vertices outside.
    pub outside: Outside,
}

/// Kind of basis functions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum BasisKind {
    /// B-splines of a chosen degree.
    #[default]
    Bspline,
    /// Bernstein polynomials of degree size − 1.
    Bernstein,
}

/// How a frame is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Fit {
    /// The model's bounding box.
    #[default]
    Bounds,
}

/// One value for all three axes, or one for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize),
    serde(try_from = "PerAxisForm<T>", bound = "T: serde::Deserialize<'de>")
)]
pub enum PerAxis<T> {
    /// The same along u, v, w.
    All(T),
    /// Along u, v, w.
    Each([T; 3]),
}

#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
#[serde(untagged, expecting = "expected one whole number of at least 0, or a list of three")]
enum PerAxisForm<T> {
    One(T),
    List(Vec<T>),
}

#[cfg(feature = "serde")]
impl<T> TryFrom<PerAxisForm<T>> for PerAxis<T> {
    type Error = String;

    fn try_from(form: PerAxisForm<T>) -> Result<Self, String> {
        match form {
            PerAxisForm::One(value) => Ok(Self::All(value)),
            PerAxisForm::List(list) => <[T; 3]>::try_from(list)
                .map(Self::Each)
                .map_err(|list| format!("a list of {} numbers: there must be one number, or three", list.len())),
        }
    }
}

impl<T: Copy> PerAxis<T> {
    /// The values along u, v, w.
    #[must_use]
    pub fn each(self) -> [T; 3] {
        match self {
            Self::All(value) => [value; 3],
            Self::Each(values) => values,
        }
    }
}

/// Knots of B-splines.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize),
    serde(
        untagged,
        expecting = "\"clamped\", \"uniform\", or a list of three: each of them a rule or an explicit knot vector"
    )
)]
pub enum Knots {
    /// One rule for all axes.
    All(KnotRule),
    /// Along u, v, w.
    Each([AxisKnots; 3]),
}

impl Default for Knots {
    fn default() -> Self {
        Self::All(KnotRule::Clamped)
    }
}

impl Knots {
    /// The knots along u, v, w.
    #[must_use]
    pub fn each(&self) -> [AxisKnots; 3] {
        match self {
            Self::All(rule) => [0; 3].map(|_| AxisKnots::Rule(*rule)),
            Self::Each(knots) => knots.clone(),
        }
    }
}

/// Knots along one axis.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(untagged))]
pub enum AxisKnots {
    /// A rule.
    Rule(KnotRule),
    /// A full knot vector: size + degree + 1 numbers with the domain [0, 1].
    Explicit(Vec<f64>),
}

/// A rule that makes knots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum KnotRule {
    /// 0 and 1 repeated degree + 1 times, equidistant between.
    Clamped,
    /// `t_i = (i − degree) / (size − degree)`.
    Uniform,
}

/// What must hold after the deformation.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct Preserve {
    /// The wanted volume.
    pub volume: VolumeTarget,
    /// How to reach it; "axes" if `axes` or `shares` is given, else "nearest".
    pub method: Option<MethodKind>,
    /// Directions of the method "axes", in order; "xyz" by default. The other methods move controls along these axes only;
    /// they take letters.
    pub axes: Option<Directions>,
    /// Relative share of each direction; equal by default.
    pub shares: Option<Vec<f64>>,
    /// What is kept small.
    pub objective: Objective,
    /// Control points that do not move.
    pub pin: Option<Selector>,
    /// Mobility of the control points.
    pub mobility: MobilityKind,
    /// Mobility that falls with the distance from a vertex: HB's local preservation.
    pub falloff: Option<Falloff>,
    /// Vertices that must come to exact places as well.
    pub points: Vec<PointRequest>,
    /// What to do about boundaries.
    pub open: OpenBoundaries,
    /// Whether foldings are looked for.
    pub folds: Folds,
    /// Correct a mesh of about so many triangles instead of the model: the volume is then approximate.
    pub preview: Option<usize>,
}

/// How the volume is corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum MethodKind {
    /// The smallest displacement.
    Nearest,
    /// One exact step in all coordinates.
    Gradient,
    /// One direction after the other.
    Axes,
    /// A common factor of all heights over a surface.
    Height,
    /// Nodes that are not held settle as springs between them want (HML).
    Elastic,
}

/// What a correction keeps small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Objective {
    /// The squared displacement of the control points, over their mobilities.
    #[default]
    Controls,
    /// The squared displacement of the vertices.
    Surface,
    /// The squared changes of the lattice's edges.
    Edges,
    /// The squared second differences of the displacement.
    Bending,
    /// Local stress at witness points of a cage.
    Stress,
}

impl Objective {
    /// Its word in a job.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Controls => "controls",
            Self::Surface => "surface",
            Self::Edges => "edges",
            Self::Bending => "bending",
            Self::Stress => "stress",
        }
    }
}

/// Where mobilities come from, before pins and falloff.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum MobilityKind {
    /// 1 everywhere, or what the lattice file says.
    #[default]
    Uniform,
    /// The more, the more volume was lost: [`local_mobility`](crate::local_mobility), times what the lattice file says.
    Auto,
}

/// Whether foldings are looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Folds {
    /// No.
    #[default]
    Off,
}

/// Mobility `m = exp(−d / radius)`, d the distance at rest between control point and vertex (HB, section 5.2).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct Falloff {
    /// The vertex, 0-based in file order (STL: distinct corners in order of appearance).
    pub vertex: usize,
    /// Distance at which the mobility has fallen to 1/e, in extents of the model.
    pub radius: f64,
}

/// A vertex that must come to an exact place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct PointRequest {
    /// The vertex, 0-based in file order (STL: distinct corners in order of appearance).
    pub vertex: usize,
    /// Where it must come, in model coordinates.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::vector"))]
    pub to: DVec3,
}

/// Directions to correct along.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(try_from = "DirectionsForm"))]
pub enum Directions {
    /// Coordinate axes by their letters.
    Letters(AxisLetters),
    /// Any vectors.
    Vectors(Vec<DVec3>),
}

#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
#[serde(untagged, expecting = "expected letters such as \"xy\" or a list of vectors [x, y, z]")]
enum DirectionsForm {
    Letters(String),
    Vectors(Vec<DVec3>),
}

#[cfg(feature = "serde")]
impl TryFrom<DirectionsForm> for Directions {
    type Error = ValueError;

    fn try_from(form: DirectionsForm) -> Result<Self, ValueError> {
        match form {
            DirectionsForm::Letters(text) => AxisLetters::try_from(text).map(Self::Letters),
            DirectionsForm::Vectors(vectors) => Ok(Self::Vectors(vectors)),
        }
    }
}

/// Axes x, y, z in an order, each at most once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisLetters(String);

impl Default for AxisLetters {
    fn default() -> Self {
        Self("xyz".into())
    }
}

impl TryFrom<String> for AxisLetters {
    type Error = ValueError;

    fn try_from(text: String) -> Result<Self, ValueError> {
        let known = text.chars().all(|c| "xyz".contains(c));
        let once = text.chars().all(|c| text.matches(c).count() == 1);
        if text.is_empty() || !known || !once {
            return Err(ValueError {
                what: "axes",
                value: text,
                expected: "letters x, y, z, each at most once, such as \"xy\"",
            });
        }
        Ok(Self(text))
    }
}

impl Directions {
    /// The directions as vectors.
    #[must_use]
    pub fn vectors(&self) -> Vec<DVec3> {
        match self {
            Self::Letters(letters) => letters.0.bytes().map(|c| DVec3::AXES[usize::from(c - b'x')]).collect(),
            Self::Vectors(vectors) => vectors.clone(),
        }
    }
}

/// A text that is no value of its kind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} cannot be \"{value}\": it is {expected}")]
pub struct ValueError {
    /// What the text was to be.
    pub what: &'static str,
    /// The text.
    pub value: String,
    /// What is possible.
    pub expected: &'static str,
}

/// The wanted volume, or volumes. Amounts refer to the outward orientation.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum VolumeTarget {
    /// As at rest.
    #[default]
    Rest,
    /// Whatever comes out: no correction.
    Free,
    /// This much.
    Amount(Amount),
    /// Nothing is corrected within the range; outside, its nearer end is wanted.
    Range {
        /// At least this much.
        min: Option<Amount>,
        /// At most this much.
        max: Option<Amount>,
    },
    /// Every component that encloses a volume gets this much: percent of its own rest volume, or so much each. Cavities count
    /// positive.
    Each(Amount),
    /// Groups of components.
    Parts(Vec<PartTarget>),
    /// Of a model with cavities.
    Hollow {
        /// The volume of the whole model, less its cavities.
        material: Option<Amount>,
        /// What all cavities hold together.
        capacity: Option<Amount>,
    },
}

/// The wanted volume of some components together.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct PartTarget {
    /// The components, 0-based in the order of their first faces, each once: as [`Volumes::components`] has them.
    ///
    /// [`Volumes::components`]: crate::Volumes::components
    pub components: Vec<usize>,
    /// The sum of their signed volumes; a group whose sum is negative at rest (cavities) is counted positive: what it holds.
    pub volume: Amount,
}

/// A volume.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(try_from = "AmountForm"))]
pub enum Amount {
    /// Percent of the rest volume.
    Percent(f64),
    /// In the model's unit cubed.
    Absolute(f64),
}

impl Amount {
    /// The volume meant, for a rest volume.
    #[must_use]
    pub fn of(self, rest: f64) -> f64 {
        match self {
            Self::Percent(100.0) => rest,
            Self::Percent(percent) => rest * percent / 100.0,
            Self::Absolute(volume) => volume,
        }
    }

    fn checked(self, text: impl FnOnce() -> String) -> Result<Self, ValueError> {
        let (Self::Percent(value) | Self::Absolute(value)) = self;
        if value.is_finite() && value > 0.0 {
            return Ok(self);
        }
        Err(ValueError {
            what: "a volume",
            value: text(),
            expected: "more than 0: a number or a percentage such as \"120%\"",
        })
    }
}

impl FromStr for Amount {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let (number, amount): (_, fn(f64) -> Self) = match text.trim().strip_suffix('%') {
            Some(percent) => (percent.trim(), Self::Percent),
            None => (text.trim(), Self::Absolute),
        };
        amount(number.parse().unwrap_or(f64::NAN)).checked(|| text.into())
    }
}

impl FromStr for VolumeTarget {
    type Err = ValueError;

    /// `rest`, `free`, `120%`, `0.5`, a range: `95%..105%`, `95%..`, `..0.5`; `each`, `each=110%`; `material=100%`,
    /// `capacity=110%`, or both with a comma.
    fn from_str(text: &str) -> Result<Self, ValueError> {
        if let Some((min, max)) = text.split_once("..") {
            let end = |text: &str| if text.trim().is_empty() { Ok(None) } else { text.parse().map(Some) };
            return Self::range(end(min)?, end(max)?);
        }
        let unknown = || ValueError {
            what: "volume",
            value: text.into(),
            expected: "\"rest\", \"free\", a percentage such as \"120%\", a number above 0, a range { min, max }, \"each\", or \
                       for several volumes { each }, { parts }, { material, capacity }",
        };
        match text.trim() {
            "rest" => Ok(Self::Rest),
            "free" => Ok(Self::Free),
            "each" => Ok(Self::Each(Amount::Percent(100.0))),
            words if words.contains('=') => {
                let (mut each, mut material, mut capacity) = (None, None, None);
                for word in words.split(',') {
                    let (name, amount) = word.split_once('=').ok_or_else(unknown)?;
                    let place = match name.trim() {
                        "each" => &mut each,
                        "material" => &mut material,
                        "capacity" => &mut capacity,
                        _ => return Err(unknown()),
                    };
                    if place.replace(amount.parse()?).is_some() {
                        return Err(unknown());
                    }
                }
                match (each, material, capacity) {
                    (Some(each), None, None) => Ok(Self::Each(each)),
                    (Some(_), ..) => Err(unknown()),
                    (None, material, capacity) => Ok(Self::Hollow { material, capacity }),
                }
            }
            amount => amount.parse().map(Self::Amount).map_err(|_: ValueError| unknown()),
        }
    }
}

impl VolumeTarget {
    fn range(min: Option<Amount>, max: Option<Amount>) -> Result<Self, ValueError> {
        if min.is_none() && max.is_none() {
            let (what, value) = ("a range of volumes", "..".into());
            return Err(ValueError { what, value, expected: "{ min, max }, at least one of them" });
        }
        Ok(Self::Range { min, max })
    }
}

#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
#[serde(untagged, expecting = "a volume is a number or a percentage such as \"120%\"")]
enum AmountForm {
    Number(f64),
    Text(String),
}

#[cfg(feature = "serde")]
impl TryFrom<AmountForm> for Amount {
    type Error = ValueError;

    fn try_from(form: AmountForm) -> Result<Self, ValueError> {
        match form {
            AmountForm::Number(volume) => Self::Absolute(volume).checked(|| volume.to_string()),
            AmountForm::Text(text) => text.parse(),
        }
    }
}

/// How volumes stand in a job file: a number, a text, or a table.
#[cfg(feature = "serde")]
mod volume_form {
    use std::fmt;

    use serde::de::value::MapAccessDeserializer;
    use serde::de::{Error, MapAccess, Visitor};
    use serde::{Deserialize, Deserializer};

    use super::{Amount, PartTarget, ValueError, VolumeTarget};

    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Table {
        min: Option<Amount>,
        max: Option<Amount>,
        each: Option<Amount>,
        parts: Option<Vec<PartTarget>>,
        material: Option<Amount>,
        capacity: Option<Amount>,
    }

    impl TryFrom<Table> for VolumeTarget {
        type Error = ValueError;

        fn try_from(table: Table) -> Result<Self, ValueError> {
            let given = [
                ("min", table.min.is_some()),
                ("max", table.max.is_some()),
                ("each", table.each.is_some()),
                ("parts", table.parts.is_some()),
                ("material", table.material.is_some()),
                ("capacity", table.capacity.is_some()),
            ];
            match table {
                Table { min, max, each: None, parts: None, material: None, capacity: None }
                    if min.is_some() || max.is_some() =>
                {
                    Ok(Self::Range { min, max })
                }
                Table { min: None, max: None, each: Some(each), parts: None, material: None, capacity: None } => {
                    Ok(Self::Each(each))
                }
                Table { min: None, max: None, each: None, parts: Some(parts), material: None, capacity: None } => {
                    Ok(Self::Parts(parts))
                }
                Table { min: None, max: None, each: None, parts: None, material, capacity }
                    if material.is_some() || capacity.is_some() =>
                {
                    Ok(Self::Hollow { material, capacity })
                }
                _ => {
                    let keys: Vec<&str> = given.iter().filter(|(_, given)| *given).map(|(key, _)| *key).collect();
                    Err(ValueError {
                        what: "volume",
                        value: format!("{{ {} }}", keys.join(", ")).replace("{  }", "{}"),
                        expected: "{ min, max }, { each }, { parts }, or { material, capacity }, one of these",
                    })
                }
            }
        }
    }

    impl<'de> Deserialize<'de> for VolumeTarget {
        fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            struct FormVisitor;
            impl<'de> Visitor<'de> for FormVisitor {
                type Value = VolumeTarget;

                fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                    f.write_str(
                        "\"rest\", \"free\", \"each\", a percentage such as \"120%\", a number above 0, { min, max }, { each }, \
                         { parts }, or { material, capacity }",
                    )
                }

                fn visit_f64<E: Error>(self, volume: f64) -> Result<VolumeTarget, E> {
                    let amount = Amount::Absolute(volume).checked(|| volume.to_string());
                    amount.map(VolumeTarget::Amount).map_err(E::custom)
                }

                fn visit_i64<E: Error>(self, volume: i64) -> Result<VolumeTarget, E> {
                    self.visit_f64(volume as f64)
                }

                fn visit_u64<E: Error>(self, volume: u64) -> Result<VolumeTarget, E> {
                    self.visit_f64(volume as f64)
                }

                fn visit_str<E: Error>(self, text: &str) -> Result<VolumeTarget, E> {
                    text.parse().map_err(E::custom)
                }

                fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<VolumeTarget, A::Error> {
                    let table = Table::deserialize(MapAccessDeserializer::new(table))?;
                    table.try_into().map_err(A::Error::custom)
                }
            }
            from.deserialize_any(FormVisitor)
        }
    }
}
