//! A placed model laid on its sheet's surface: `p = S(s, t) + h n(s, t)`.
//!
//! A vertex at (x, y, h) over the flattened grid is located in a cell, carried to (s, t) by the inverse of the cell's bilinear map
//! ([`crate::locate`]), and displaced along the surface's unit normal by its height. CO, section 3.2.
//!
//! With F the map of parameters to the flattened grid, the Jacobian matrix of the whole is
//!
//! ```text
//! ∂p/∂(x, y, h) = (S_s + h n_s, S_t + h n_t, n) · diag((∂F/∂(s, t))⁻¹, 1).                           (1)
//! ```
//!
//! As n_s and n_t are −κ S along the principal directions, the map is orientation-preserving where `1 − h κ > 0` for both principal
//! curvatures: a model *folds* where it is higher than a radius of curvature on the side to which the surface bends.
//!
//! # Changes versus the paper
//!
//! - Vertices beyond the sheet can go on along the boundary's tangents. With (s₀, t₀) the nearest parameters in [0, 1]² and d = (s, t) − (s₀,
//!   t₀), `S = S⁰ + d_s S⁰_s + d_t S⁰_t + d_s d_t S⁰_st` and n = n⁰: the surface goes on continuously with its tangents, normals
//!   continuously.
//! - Folds are found and reported.

use glam::{DMat2, DMat3, DVec2, DVec3};

use crate::locate::{LocateError, Locator, Place};
use crate::parallel;
use crate::sheet::Sheet;
use crate::surface::{Jet, Tangents};
use crate::tolerances;

/// A sheet, prepared for laying models on its surface.
#[derive(Clone, Debug)]
pub struct Wrap {
    sheet: Sheet,
    locator: Locator,
    /// Places so far beyond the located grid count as inside.
    tolerance: f64,
}

/// A model along a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Laid {
    /// Where the vertices are (#vertices × 3).
    pub points: Vec<DVec3>,
    /// ∂p/∂(x, y, h) at each (#vertices); times [`crate::Placed::matrix`] it is ∂p/∂(model coordinates), which carries normals.
    pub jacobians: Vec<DMat3>,
    /// Where the model folds, if it does.
    pub folds: Option<WrapFolds>,
}

/// Vertices at which a model is folded along its surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct WrapFolds {
    /// How many.
    pub count: usize,
    /// The first of them.
    pub first: usize,
    /// The most folded.
    pub worst: usize,
    /// `1 − h κ` there, h its height and κ the principal curvature that makes it smallest; not positive.
    pub factor: f64,
}

/// Feet of vertices on a surface, and the ways from there: p = foot + offset.
#[derive(Clone, Debug, PartialEq)]
pub struct Feet {
    /// S(s, t) (#vertices × 3).
    pub feet: Vec<DVec3>,
    /// h n(s, t) (#vertices × 3).
    pub offsets: Vec<DVec3>,
}

/// Why a model cannot be laid on a surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WrapError {
    /// The sheet is no good.
    #[error(transparent)]
    Sheet(#[from] LocateError),
    /// Vertices beyond the sheet.
    #[error(
        "{count} vertices are beyond the sheet; vertex {vertex} is {distance:e} beyond its boundary, vertex {farthest} is {most:e}; move the model, \
         make it smaller (place.fit = \"inside\"), or let it go on along the tangents (place.outside = \"extend\")"
    )]
    Beyond {
        /// How many.
        count: usize,
        /// The first of them.
        vertex: usize,
        /// Its distance from the boundary of the flattened grid, in the surface's length unit.
        distance: f64,
        /// The farthest.
        farthest: usize,
        /// Its distance.
        most: f64,
    },
    /// Vertices where the surface has no tangent plane.
    #[error(
        "{count} vertices stand where the surface has no normal, as at an apex; the first is vertex {vertex} at (s, t) = ({}, {}); \
         move the model",
        .parameters.x, .parameters.y
    )]
    NoNormal {
        /// How many.
        count: usize,
        /// The first of them.
        vertex: usize,
        /// Its (s, t).
        parameters: DVec2,
    },
    /// Vertices where the sheet is not flattened one to one, such as poles.
    #[error(
        "{count} vertices stand where the surface's map has no derivative, as at a pole, so normals cannot be carried; the first is vertex \
         {vertex} at (s, t) = ({}, {}); move the model",
        .parameters.x, .parameters.y
    )]
    Singular {
        /// How many.
        count: usize,
        /// The first of them.
        vertex: usize,
        /// Its (s, t).
        parameters: DVec2,
    },
    /// Folds, and these were to be refused.
    #[error(
        "the model folds at {} vertices, the first is vertex {}: it is higher than the surface's radius of curvature there (1 − height × \
         curvature is {} at vertex {}); make the model thinner or the surface flatter",
        .0.count, .0.first, .0.factor, .0.worst
    )]
    Folded(WrapFolds),
}

/// Why one vertex fails.
#[derive(Clone, Copy)]
enum Failure {
    /// So far beyond.
    Beyond(f64),
    NoNormal(DVec2),
    Singular(DVec2),
}

/// The surface below a vertex.
struct Foot {
    /// S, with what is beyond the sheet.
    point: DVec3,
    normal: DVec3,
}

/// Vertices per part. Larger: threads wait for one another in models of some ten thousand vertices; smaller: more to hand out.
const PART: usize = 1024;

/// The width of a ring round the sheet is doubled at most so often: it is a million cells wide then.
const DOUBLINGS: usize = 20;

impl Wrap {
    /// For models that do not leave the sheet.
    ///
    /// # Errors
    ///
    /// A sheet that folds, lies over itself, or has no area.
    pub fn new(sheet: &Sheet) -> Result<Self, WrapError> {
        let locator = Locator::new(sheet)?;
        let tolerance = tolerances::INSIDE * locator.extent();
        Ok(Self { sheet: sheet.clone(), locator, tolerance })
    }

    /// For a model with vertices at `places` ((x, y, h), #vertices × 3), and all between them: what is beyond the sheet goes on along the
    /// boundary's tangents.
    ///
    /// # Errors
    ///
    /// As [`Wrap::new`]; grid lines that meet before they have gone on far enough.
    pub fn covering(sheet: &Sheet, places: &[DVec3]) -> Result<Self, WrapError> {
        let mut wrap = Self::new(sheet)?;
        let is_covered = |wrap: &Self| {
            let all = |range: std::ops::Range<usize>| places[range].iter().all(|q| wrap.place(q.truncate()).is_ok());
            !parallel::map_chunks(places.len(), PART, all).contains(&false)
        };
        let mut width = 1.0;
        for _ in 0..DOUBLINGS {
            if is_covered(&wrap) {
                break;
            }
            wrap.locator = Locator::ringed(sheet, width)?;
            width *= 2.0;
        }
        Ok(wrap)
    }

    /// The sheet.
    #[must_use]
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// Where vertices at `places` ((x, y, h), #vertices × 3) come to lie.
    ///
    /// # Errors
    ///
    /// Vertices beyond the sheet, or where the surface has no normal.
    pub fn points(&self, places: &[DVec3]) -> Result<Vec<DVec3>, WrapError> {
        self.each(places, |q| {
            let Foot { point, normal } = self.foot(self.place(q.truncate())?)?;
            Ok(point + q.z * normal)
        })
    }

    /// The feet of vertices at `places` ((x, y, h), #vertices × 3), and their offsets from there.
    ///
    /// # Errors
    ///
    /// As [`Wrap::points`].
    pub fn feet(&self, places: &[DVec3]) -> Result<Feet, WrapError> {
        let both = self.each(places, |q| {
            let Foot { point, normal } = self.foot(self.place(q.truncate())?)?;
            Ok((point, q.z * normal))
        })?;
        let (feet, offsets) = both.into_iter().unzip();
        Ok(Feet { feet, offsets })
    }

    /// Where vertices at `places` ((x, y, h), #vertices × 3) come to lie, with the derivatives there, and where that folds.
    ///
    /// # Errors
    ///
    /// As [`Wrap::points`]; vertices where the map has no derivative.
    pub fn laid(&self, places: &[DVec3]) -> Result<Laid, WrapError> {
        let all = self.each(places, |q| self.derived(q))?;
        let mut folds: Option<WrapFolds> = None;
        for (v, (_, _, factor)) in all.iter().enumerate().filter(|(_, (_, _, factor))| *factor <= 0.0) {
            let folds = folds.get_or_insert(WrapFolds { count: 0, first: v, worst: v, factor: *factor });
            folds.count += 1;
            if *factor < folds.factor {
                (folds.worst, folds.factor) = (v, *factor);
            }
        }
        let points = parallel::collect(all.len(), |v| all[v].0);
        let jacobians = parallel::collect(all.len(), |v| all[v].1);
        Ok(Laid { points, jacobians, folds })
    }

    /// `of` each place, or what is wrong with some.
    fn each<T: Copy + Default + Send>(
        &self,
        places: &[DVec3],
        of: impl Fn(DVec3) -> Result<T, Failure> + Send + Sync,
    ) -> Result<Vec<T>, WrapError> {
        let mut out = Vec::new();
        parallel::resize(&mut out, places.len());
        let failures = parallel::map_parts(&mut out, PART, |first, part| {
            let mut failures = Vec::new();
            for ((v, out), q) in (first..).zip(part.iter_mut()).zip(&places[first..]) {
                match of(*q) {
                    Ok(value) => *out = value,
                    Err(failure) => failures.push((v, failure)),
                }
            }
            failures
        });
        let failures = failures.concat();
        if failures.is_empty() { Ok(out) } else { Err(error_of(&failures)) }
    }

    /// Where x is on the sheet, or in its ring.
    fn place(&self, x: DVec2) -> Result<Place, Failure> {
        if let Some(place) = self.locator.place(x) {
            return Ok(place);
        }
        let (place, distance) = self.locator.nearest(x);
        if distance <= self.tolerance { Ok(place) } else { Err(Failure::Beyond(distance)) }
    }

    fn foot(&self, place: Place) -> Result<Foot, Failure> {
        let (inner, beyond) = parted(place.parameters);
        let (tangents, normal) = self.sheet.surface().tangents_and_normal(inner.x, inner.y);
        let normal = normal.ok_or(Failure::NoNormal(place.parameters))?;
        Ok(Foot { point: tangents.beyond(beyond), normal })
    }

    /// p, (1), and the least of `1 − h κ`.
    fn derived(&self, q: DVec3) -> Result<(DVec3, DMat3, f64), Failure> {
        let place = self.place(q.truncate())?;
        let (inner, beyond) = parted(place.parameters);
        let (jet, normal) = self.sheet.surface().jet_and_normal(inner.x, inner.y);
        let normal = normal.ok_or(Failure::NoNormal(place.parameters))?;
        let singular = Failure::Singular(place.parameters);
        let [n_s, n_t] = normal_changes(&jet, normal, beyond).ok_or(singular)?;
        let along_s = jet.s + beyond.y * jet.st + q.z * n_s;
        let along_t = jet.t + beyond.x * jet.st + q.z * n_t;
        if place.slope.determinant() == 0.0 {
            return Err(singular);
        }
        let DMat2 { x_axis, y_axis } = place.slope.inverse();
        let column = |rate: DVec2| rate.x * along_s + rate.y * along_t;
        let jacobian = DMat3::from_cols(column(x_axis), column(y_axis), normal);
        let factor = if beyond == DVec2::ZERO {
            let [high, low] = jet.curvature().ok_or(singular)?.principal;
            f64::min(1.0 - q.z * high, 1.0 - q.z * low)
        } else {
            // One of both directions is straight, so there is one factor to turn over.
            along_s.cross(along_t).dot(normal) / jet.s.cross(jet.t).length()
        };
        Ok((Tangents::from(jet).beyond(beyond) + q.z * normal, jacobian, factor))
    }
}

/// Parameters in [0, 1]², where the surface's formulas are taken, and what is beyond.
fn parted(parameters: DVec2) -> (DVec2, DVec2) {
    let inner = parameters.clamp(DVec2::ZERO, DVec2::ONE);
    (inner, parameters - inner)
}

/// n_s and n_t; 0 across a boundary beyond which the vertex is. None where that is undefined.
fn normal_changes(jet: &Jet, normal: DVec3, beyond: DVec2) -> Option<[DVec3; 2]> {
    let Jet { s, t, ss, st, tt, .. } = jet;
    let cross = s.cross(*t);
    let length = cross.length();
    let change = |of_cross: DVec3| (of_cross - normal * normal.dot(of_cross)) / length;
    let [n_s, n_t] = [change(ss.cross(*t) + s.cross(*st)), change(st.cross(*t) + s.cross(*tt))];
    let [n_s, n_t] = [(n_s, beyond.x), (n_t, beyond.y)].map(|(n, d)| if d == 0.0 { n } else { DVec3::ZERO });
    (length > 0.0).then_some([n_s, n_t])
}

impl Laid {
    /// An error if the model folds.
    ///
    /// # Errors
    ///
    /// [`WrapError::Folded`].
    pub fn unfolded(self) -> Result<Self, WrapError> {
        match self.folds {
            Some(folds) => Err(WrapError::Folded(folds)),
            None => Ok(self),
        }
    }
}

/// What is wrong with some vertices: the first kind of all that there are.
fn error_of(failures: &[(usize, Failure)]) -> WrapError {
    let beyond = failures.iter().filter_map(|(v, failure)| match failure {
        Failure::Beyond(distance) => Some((*v, *distance)),
        _ => None,
    });
    if let Some((vertex, distance)) = beyond.clone().next() {
        let (farthest, most) =
            beyond.clone().fold((vertex, distance), |most, far| if far.1 > most.1 { far } else { most });
        return WrapError::Beyond { count: beyond.count(), vertex, distance, farthest, most };
    }
    let without_normal = failures.iter().filter_map(|(v, failure)| match failure {
        Failure::NoNormal(parameters) => Some((*v, *parameters)),
        _ => None,
    });
    if let Some((vertex, parameters)) = without_normal.clone().next() {
        return WrapError::NoNormal { count: without_normal.count(), vertex, parameters };
    }
    match failures {
        [(vertex, Failure::Singular(parameters)), ..] => {
            WrapError::Singular { count: failures.len(), vertex: *vertex, parameters: *parameters }
        }
        _ => unreachable!("the other kinds are told before"),
    }
}
