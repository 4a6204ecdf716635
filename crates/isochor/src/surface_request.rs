//! The surface of a job as data: its kind with the kind's own keys, or a file; where it stands; how it is flattened.

use std::path::PathBuf;

use glam::DVec3;

use crate::bspline::Basis;
use crate::curve::Curve;
use crate::interpolation::Smoothness;
use crate::patch::Patch;
use crate::placement::Placement;
use crate::surface::{Surface, SurfaceError};

/// Cells of the flattening grid along s and t where a request says nothing. More: finer sheets, but more time; fewer:
/// coarse ones.
const CELLS: [usize; 2] = [32, 32];

/// Grid steps over which distances are kept where a request says nothing: CO's r. More: more time; fewer: sheets fold
/// (CO, figure 2).
const REACH: usize = 3;

/// The surface to deform along: from a file, or made here.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct SurfaceRequest {
    /// What surface it is, if it is not from a file.
    pub kind: Option<SurfaceKind>,
    /// A file of patches instead of a kind and its keys.
    pub file: Option<PathBuf>,
    /// Which patch of the file, from 0; files with one need none.
    pub patch: Option<usize>,
    /// Radius of a cylinder or sphere.
    pub radius: Option<f64>,
    /// Radii of a cone at its base and top.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub radii: Option<[f64; 2]>,
    /// Radius of a torus from its axis to the middle of its tube.
    pub major: Option<f64>,
    /// Radius of a torus's tube.
    pub minor: Option<f64>,
    /// Height of a cylinder or cone.
    pub height: Option<f64>,
    /// Angles about the axis in degrees; a full turn by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub angles: Option<[f64; 2]>,
    /// Latitudes of a sphere in degrees; from pole to pole by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub latitudes: Option<[f64; 2]>,
    /// Angles about a torus's tube in degrees; a full turn by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub tube: Option<[f64; 2]>,
    /// Sides of a plane's parallelogram, from the origin.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vectors"))]
    pub sides: Option<[DVec3; 2]>,
    /// Sides of a height field's rectangle along x and y, from the origin; of a plane's instead of `sides`.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub size: Option<[f64; 2]>,
    /// Control points `[i][j]`, i along s.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_rows"))]
    pub controls: Option<Vec<Vec<DVec3>>>,
    /// Their weights `[i][j]`.
    pub weights: Option<Vec<Vec<f64>>>,
    /// Degrees of B-splines along s and t; 3 by default, or less where there are fewer control points.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub degree: Option<[usize; 2]>,
    /// Their knots along s and t; clamped by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub knots: Option<[Vec<f64>; 2]>,
    /// What is turned or extruded.
    pub profile: Option<ProfileRequest>,
    /// Direction of the line through the origin about which the profile is turned; z by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vector"))]
    pub axis: Option<DVec3>,
    /// The vector by which the profile is extruded.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vector"))]
    pub along: Option<DVec3>,
    /// Heights `[i][j]` of a height field over equidistant places, i along x.
    pub heights: Option<Vec<Vec<f64>>>,
    /// Points `[i][j]` of a grid, i along s.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_rows"))]
    pub points: Option<Vec<Vec<DVec3>>>,
    /// How a height field or grid goes through them.
    pub smoothness: Option<Smoothness>,
    /// Where the surface's origin stands.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_vector"))]
    pub at: Option<DVec3>,
    /// How the surface is turned about it.
    pub frame: Option<FrameRequest>,
    /// Whether normals point to the other side; s then runs backwards.
    pub flip: bool,
    /// Cells of the flattening grid along s and t; 32 each by default.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::optional_array"))]
    pub grid: Option<[usize; 2]>,
    /// Grid steps over which distances are kept: CO's r; 3 by default.
    pub reach: Option<usize>,
    /// How the grid is flattened.
    pub flatten: FlattenKind,
    /// Where the model lies on the flattened sheet.
    pub place: Placement,
    /// Where the model's faces are divided.
    pub refine: Refine,
    /// What happens where the model folds.
    pub folds: SurfaceFolds,
    /// Where the surface goes as a mesh to look at, if anywhere.
    pub save: Option<PathBuf>,
    /// Where the picture of the flattened sheet with the model's points goes (`.svg`), if anywhere.
    pub sheet: Option<PathBuf>,
}

/// Where a model's faces are divided.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize),
    serde(untagged, expecting = "`refine` must be a curvature in 1/extent, such as 0.05, or \"off\"")
)]
pub enum Refine {
    /// Where the surface's normal curvature is more than this, in 1 over the extent of the placed model: CO's ε.
    Above(f64),
    /// As a word.
    Word(RefineWord),
}

/// A word for how a model is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum RefineWord {
    /// Not at all.
    Off,
}

impl Default for Refine {
    /// Above 0.05: a face as long as the model that is straight where it should rise by more than half a percent of its length.
    fn default() -> Self {
        Self::Above(0.05)
    }
}

/// What happens where a model along a surface folds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum SurfaceFolds {
    /// It is said in the report.
    #[default]
    Report,
    /// It is an error.
    Refuse,
}

/// Kind of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum SurfaceKind {
    /// A parallelogram.
    Plane,
    /// A cylinder about the z axis.
    Cylinder,
    /// A cone about the z axis.
    Cone,
    /// A sphere about the origin.
    Sphere,
    /// A torus about the z axis.
    Torus,
    /// A Bézier patch, rational with weights.
    Bezier,
    /// A B-spline patch.
    Bspline,
    /// A B-spline patch with weights.
    Nurbs,
    /// A profile turned about an axis.
    Revolve,
    /// A profile moved along a vector.
    Extrude,
    /// Heights over a rectangle.
    Heightfield,
    /// A surface through a grid of points.
    Grid,
}

/// How a grid is flattened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum FlattenKind {
    /// Steps that learn how the stress curves.
    #[default]
    #[cfg_attr(feature = "serde", serde(rename = "quasi-newton"))]
    QuasiNewton,
    /// The paper's descent.
    Descent,
}

/// Directions of a surface's own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct FrameRequest {
    /// That of its z axis.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::vector"))]
    pub z: DVec3,
    /// That of its x axis; what of it is across z counts.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::vector"))]
    pub x: DVec3,
}

/// A profile.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize),
    serde(
        untagged,
        expecting = "a profile is a list of points [x, y, z], { through = points }, or { controls = points } with degree, knots, weights"
    )
)]
pub enum ProfileRequest {
    /// Straight lines from point to point.
    Polyline(#[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::list"))] Vec<DVec3>),
    /// A smooth curve through points.
    Through(ThroughRequest),
    /// A B-spline or NURBS curve.
    Spline(SplineRequest),
}

/// A twice continuously differentiable curve through points.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct ThroughRequest {
    /// The points.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::list"))]
    pub through: Vec<DVec3>,
}

/// A B-spline or NURBS curve.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize), serde(deny_unknown_fields))]
pub struct SplineRequest {
    /// Control points.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::list"))]
    pub controls: Vec<DVec3>,
    /// Degree; 3 by default, or less where there are fewer control points.
    pub degree: Option<usize>,
    /// Knots; clamped by default.
    pub knots: Option<Vec<f64>>,
    /// Weights; 1 by default.
    pub weights: Option<Vec<f64>>,
}

/// Why a request makes no surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceRequestError {
    /// Neither kind nor file.
    #[error("the surface has neither `kind` nor `file`: give one of them, such as kind = \"cylinder\"")]
    Nothing,
    /// A kind's key beside a file, or the kind itself.
    #[error("`{key}` has no meaning beside `file`: leave out one of them")]
    BesideFile {
        /// The key.
        key: &'static str,
    },
    /// A file is named, but no surface of it was handed over; or the other way round.
    #[error("the surface's file was not read")]
    Unread,
    /// A key that the kind needs.
    #[error("a surface of the kind \"{kind}\" needs `{key}`")]
    Missing {
        /// The kind.
        kind: &'static str,
        /// The key.
        key: &'static str,
    },
    /// A key that belongs to other kinds.
    #[error("`{key}` does not belong to a surface of the kind \"{kind}\", but to {of}")]
    Foreign {
        /// The kind.
        kind: &'static str,
        /// The key.
        key: &'static str,
        /// Kinds that have it.
        of: String,
    },
    /// Rows of different lengths.
    #[error("{key}[{row}] has {found} entries: all rows must have as many as {key}[0], {expected}")]
    Ragged {
        /// The key.
        key: &'static str,
        /// Which row, from 0.
        row: usize,
        /// Its length.
        found: usize,
        /// That of row 0.
        expected: usize,
    },
    /// A number of cells or steps that is 0.
    #[error("`{key}` is 0: it must be at least 1")]
    Zero {
        /// The key.
        key: &'static str,
    },
    /// Values that make no surface.
    #[error("surface: {0}")]
    Surface(#[from] SurfaceError),
}

impl SurfaceKind {
    const ALL: [Self; 12] = [
        Self::Plane,
        Self::Cylinder,
        Self::Cone,
        Self::Sphere,
        Self::Torus,
        Self::Bezier,
        Self::Bspline,
        Self::Nurbs,
        Self::Revolve,
        Self::Extrude,
        Self::Heightfield,
        Self::Grid,
    ];

    /// Its word in a job.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Cylinder => "cylinder",
            Self::Cone => "cone",
            Self::Sphere => "sphere",
            Self::Torus => "torus",
            Self::Bezier => "bezier",
            Self::Bspline => "bspline",
            Self::Nurbs => "nurbs",
            Self::Revolve => "revolve",
            Self::Extrude => "extrude",
            Self::Heightfield => "heightfield",
            Self::Grid => "grid",
        }
    }

    /// Its own keys.
    fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Plane => &["sides", "size"],
            Self::Cylinder => &["radius", "height", "angles"],
            Self::Cone => &["radii", "height", "angles"],
            Self::Sphere => &["radius", "angles", "latitudes"],
            Self::Torus => &["major", "minor", "angles", "tube"],
            Self::Bezier => &["controls", "weights"],
            Self::Bspline => &["controls", "degree", "knots"],
            Self::Nurbs => &["controls", "weights", "degree", "knots"],
            Self::Revolve => &["profile", "axis", "angles"],
            Self::Extrude => &["profile", "along"],
            Self::Heightfield => &["heights", "size", "smoothness"],
            Self::Grid => &["points", "smoothness"],
        }
    }
}

impl ProfileRequest {
    fn curve(&self) -> Result<Curve, SurfaceError> {
        match self {
            Self::Polyline(points) => Curve::polyline(points.clone()),
            Self::Through(ThroughRequest { through }) => Curve::through(through.clone()),
            Self::Spline(SplineRequest { controls, degree, knots, weights }) => {
                let basis = basis(controls.len(), *degree, knots.as_deref())
                    .map_err(|source| SurfaceError::Basis { axis: "the profile", source })?;
                Curve::new(basis, controls.clone(), weights.clone())
            }
        }
    }
}

/// A basis of explicit knots, or a clamped one of `size` functions.
fn basis(size: usize, degree: Option<usize>, knots: Option<&[f64]>) -> Result<Basis, crate::bspline::BasisError> {
    let degree = degree.unwrap_or_else(|| size.saturating_sub(1).clamp(1, 3));
    match knots {
        Some(knots) => Basis::with_knots(knots.to_vec(), degree),
        None => Basis::clamped(size, degree),
    }
}

/// Values `[i][j]` one after the other, with their number along i and j.
fn flat<T: Copy>(key: &'static str, rows: &[Vec<T>]) -> Result<([usize; 2], Vec<T>), SurfaceRequestError> {
    let expected = rows.first().map_or(0, Vec::len);
    if let Some(row) = rows.iter().position(|row| row.len() != expected) {
        return Err(SurfaceRequestError::Ragged { key, row, found: rows[row].len(), expected });
    }
    Ok(([rows.len(), expected], rows.concat()))
}

impl SurfaceRequest {
    /// Cells of the flattening grid along s and t.
    #[must_use]
    pub fn cells(&self) -> [usize; 2] {
        self.grid.unwrap_or(CELLS)
    }

    /// Grid steps over which distances are kept.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.reach.unwrap_or(REACH)
    }

    /// The surface, `file` being what was read from the file, if one is named.
    ///
    /// # Errors
    ///
    /// Neither kind nor file, or both; keys that are missing or belong to other kinds; values that make no surface; a
    /// grid or a reach of 0.
    pub fn surface(&self, file: Option<Surface>) -> Result<Surface, SurfaceRequestError> {
        if self.cells().contains(&0) {
            return Err(SurfaceRequestError::Zero { key: "grid" });
        }
        if self.steps() == 0 {
            return Err(SurfaceRequestError::Zero { key: "reach" });
        }
        let made = match (&self.file, self.kind, file) {
            (Some(_), kind, read) => {
                let beside = kind.map(|_| "kind").or_else(|| self.given().first().copied());
                if let Some(key) = beside {
                    return Err(SurfaceRequestError::BesideFile { key });
                }
                read.ok_or(SurfaceRequestError::Unread)?
            }
            (None, _, Some(_)) => return Err(SurfaceRequestError::Unread),
            (None, None, None) => return Err(SurfaceRequestError::Nothing),
            (None, Some(kind), None) => self.made(kind)?,
        };
        let made = match (self.at, self.frame) {
            (None, None) => made,
            (at, frame) => {
                let FrameRequest { z, x } = frame.unwrap_or(FrameRequest { z: DVec3::Z, x: DVec3::X });
                made.placed(at.unwrap_or(DVec3::ZERO), z, x)?
            }
        };
        Ok(if self.flip { made.flipped() } else { made })
    }

    /// Keys of kinds that are given.
    fn given(&self) -> Vec<&'static str> {
        let given = [
            ("radius", self.radius.is_some()),
            ("radii", self.radii.is_some()),
            ("major", self.major.is_some()),
            ("minor", self.minor.is_some()),
            ("height", self.height.is_some()),
            ("angles", self.angles.is_some()),
            ("latitudes", self.latitudes.is_some()),
            ("tube", self.tube.is_some()),
            ("sides", self.sides.is_some()),
            ("size", self.size.is_some()),
            ("controls", self.controls.is_some()),
            ("weights", self.weights.is_some()),
            ("degree", self.degree.is_some()),
            ("knots", self.knots.is_some()),
            ("profile", self.profile.is_some()),
            ("axis", self.axis.is_some()),
            ("along", self.along.is_some()),
            ("heights", self.heights.is_some()),
            ("points", self.points.is_some()),
            ("smoothness", self.smoothness.is_some()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(key, _)| key).collect()
    }

    fn made(&self, kind: SurfaceKind) -> Result<Surface, SurfaceRequestError> {
        let name = kind.name();
        if self.patch.is_some() {
            return Err(SurfaceRequestError::Foreign { kind: name, key: "patch", of: "a `file`".into() });
        }
        if let Some(key) = self.given().into_iter().find(|key| !kind.keys().contains(key)) {
            let kinds = SurfaceKind::ALL.iter().filter(|kind| kind.keys().contains(&key));
            let of = kinds.map(|kind| format!("\"{}\"", kind.name())).collect::<Vec<_>>().join(", ");
            return Err(SurfaceRequestError::Foreign { kind: name, key, of });
        }
        let missing = |key| SurfaceRequestError::Missing { kind: name, key };
        let number = |value: Option<f64>, key| value.ok_or_else(|| missing(key));
        let angles = self.angles.unwrap_or([0.0, 360.0]);
        let profile =
            || self.profile.as_ref().ok_or_else(|| missing("profile"))?.curve().map_err(SurfaceRequestError::from);
        let surface = match kind {
            SurfaceKind::Plane => {
                let sides = match (self.sides, self.size) {
                    (Some(_), Some(_)) => {
                        let of = "a plane without `sides`".into();
                        return Err(SurfaceRequestError::Foreign { kind: name, key: "size", of });
                    }
                    (Some(sides), None) => sides,
                    (None, size) => {
                        let [width, depth] = size.ok_or_else(|| missing("size"))?;
                        [width * DVec3::X, depth * DVec3::Y]
                    }
                };
                Surface::parallelogram(DVec3::ZERO, sides)
            }
            SurfaceKind::Cylinder => {
                Surface::cylinder_part(number(self.radius, "radius")?, number(self.height, "height")?, angles)
            }
            SurfaceKind::Cone => {
                let radii = self.radii.ok_or_else(|| missing("radii"))?;
                Surface::cone(radii, number(self.height, "height")?, angles)
            }
            SurfaceKind::Sphere => {
                Surface::sphere(number(self.radius, "radius")?, angles, self.latitudes.unwrap_or([-90.0, 90.0]))
            }
            SurfaceKind::Torus => {
                let radii = [number(self.major, "major")?, number(self.minor, "minor")?];
                Surface::torus(radii, angles, self.tube.unwrap_or([0.0, 360.0]))
            }
            SurfaceKind::Bezier | SurfaceKind::Bspline | SurfaceKind::Nurbs => {
                let controls = self.controls.as_ref().ok_or_else(|| missing("controls"))?;
                if kind == SurfaceKind::Nurbs && self.weights.is_none() {
                    return Err(missing("weights"));
                }
                let (size, controls) = flat("controls", controls)?;
                let weights = self.weights.as_ref().map(|rows| flat("weights", rows)).transpose()?;
                if let Some((found, _)) = weights.as_ref().filter(|(found, _)| *found != size) {
                    let axis = usize::from(found[0] == size[0]);
                    let what = ["rows of weights", "weights in a row"][axis];
                    let (found, expected) = (found[axis], size[axis]);
                    return Err(SurfaceError::Count { what, found, expected }.into());
                }
                let along = |axis: usize| {
                    let made = match kind {
                        // A single row is too few for degree 1, not a patch of degree 0.
                        SurfaceKind::Bezier => Basis::clamped(size[axis], size[axis].saturating_sub(1).max(1)),
                        _ => basis(
                            size[axis],
                            self.degree.map(|degree| degree[axis]),
                            self.knots.as_ref().map(|knots| &knots[axis][..]),
                        ),
                    };
                    made.map_err(|source| SurfaceError::Basis { axis: ["s", "t"][axis], source })
                };
                Patch::new([along(0)?, along(1)?], controls, weights.map(|(_, weights)| weights)).map(Surface::from)
            }
            SurfaceKind::Revolve => {
                Surface::revolution(profile()?, [DVec3::ZERO, self.axis.unwrap_or(DVec3::Z)], angles)
            }
            SurfaceKind::Extrude => Surface::extrusion(profile()?, self.along.ok_or_else(|| missing("along"))?),
            SurfaceKind::Heightfield => {
                let (counts, heights) = flat("heights", self.heights.as_ref().ok_or_else(|| missing("heights"))?)?;
                let size = self.size.ok_or_else(|| missing("size"))?;
                Patch::over_rectangle(size, counts, &heights, self.smoothness.unwrap_or_default()).map(Surface::from)
            }
            SurfaceKind::Grid => {
                let (counts, points) = flat("points", self.points.as_ref().ok_or_else(|| missing("points"))?)?;
                Patch::through(counts, &points, self.smoothness.unwrap_or_default()).map(Surface::from)
            }
        };
        Ok(surface?)
    }
}
