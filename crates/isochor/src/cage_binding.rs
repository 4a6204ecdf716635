//! A model bound to a cage: coordinates of its vertices, and what follows from them.
//!
//! With C⁰ the cage at rest and C the posed one, `P = P⁰ + W (E(C) − E(C⁰))`. E(C) is C itself where coordinates are those of the cage's vertices
//! alone; with Green coordinates it is the vertices, and after them the stretched normals of the triangles, which depend on C. Then `∂V/∂C` is
//! `Wᵀ ∂V/∂P` pulled back by the derivative of E.
//!
//! | coordinates | where they are defined | outside the cage |
//! |---|---|---|
//! | mean value | everywhere | the same formula |
//! | harmonic | inside | mean value |
//! | Green | inside | continued through the closest triangle |
//! | tetrahedral (of a cage of four vertices) | everywhere | the same formula |

use std::fmt;
use std::sync::{Arc, OnceLock};

use glam::{DMat3, DMat4, DVec3};

use crate::binding::{Binding, displaced};
use crate::cage::Cage;
use crate::green::{fill_green, green_gradients, green_jacobians, pulled_back, stretched_normals};
use crate::harmonic::{Harmonic, HarmonicError, HarmonicOptions, HarmonicReport};
use crate::lattice::Outside;
use crate::mean_value::{fill_mean_value, fill_mean_value_gradients, jacobian_of, mean_value_jacobians};
use crate::parallel;
use crate::stored::Stored;
use crate::tolerances;
use crate::winding::winding_numbers;

/// Which generalised barycentric coordinates carry a cage's deformation to what is in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Coordinates {
    /// Mean value coordinates (Floater et al. 2005; Ju et al. 2005): a closed formula.
    #[default]
    MeanValue,
    /// Harmonic coordinates (Joshi et al. 2007): on a grid.
    Harmonic,
    /// Green coordinates (Lipman et al. 2008): a closed formula, of vertices and normals.
    Green,
    /// Barycentric coordinates of a tetrahedron.
    Tetrahedral,
}

impl Coordinates {
    /// Their word in a job.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::MeanValue => "mean-value",
            Self::Harmonic => "harmonic",
            Self::Green => "green",
            Self::Tetrahedral => "tetrahedral",
        }
    }
}

impl fmt::Display for Coordinates {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How a model is bound to a cage.
#[derive(Clone, Debug, PartialEq)]
pub struct CageOptions {
    /// The coordinates.
    pub coordinates: Coordinates,
    /// What happens to vertices outside the cage.
    pub outside: Outside,
    /// The grid of harmonic coordinates; `None`: one that suits the cage ([`HarmonicOptions::fitted`]).
    pub harmonic: Option<HarmonicOptions>,
}

impl Default for CageOptions {
    fn default() -> Self {
        Self { coordinates: Coordinates::default(), outside: Outside::Extend, harmonic: None }
    }
}

/// How well coordinates reproduce what they must.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CageReport {
    /// "mean-value", "harmonic", "green", "tetrahedral".
    pub coordinates: String,
    /// Vertices of the cage.
    pub vertices: usize,
    /// Its triangles.
    pub triangles: usize,
    /// Largest `|Σ α − 1|` of a vertex that follows the cage.
    pub constant_precision: f64,
    /// Largest `|Σ α c − p|` of such a vertex at rest, in extents of the cage; with Green coordinates the normals' part is in the sum.
    pub linear_precision: f64,
    /// Lebesgue constant: the largest `Σ |α|` of a vertex, which can go so many times as far as those of the cage. 1 where no coordinate is
    /// negative. (Of Green coordinates: without the normals' part.)
    pub lebesgue_constant: f64,
    /// That vertex of the model.
    pub lebesgue_vertex: usize,
    /// Vertices of the model outside the cage.
    pub outside: usize,
    /// How far the farthest of them is from the cage, in model units.
    pub farthest: f64,
    /// Of harmonic coordinates, the grid and its accuracy.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub harmonic: Option<HarmonicReport>,
}

/// Why a model cannot be bound to a cage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CageBindingError {
    /// Vertices outside, and these were to be refused.
    #[error("{count} vertices are outside the cage, vertex {vertex} by {distance:.3e}")]
    Outside {
        /// How many.
        count: usize,
        /// The farthest of them.
        vertex: usize,
        /// How far it is from the cage.
        distance: f64,
    },
    /// Tetrahedral coordinates in another cage.
    #[error(
        "tetrahedral coordinates need a cage of 4 vertices and 4 triangles; this one has {vertices} and {triangles}"
    )]
    NoTetrahedron {
        /// Vertices of the cage.
        vertices: usize,
        /// Its triangles.
        triangles: usize,
    },
    /// No harmonic coordinates.
    #[error(transparent)]
    Harmonic(#[from] HarmonicError),
    /// Coordinates that are not numbers, as in cages that cross themselves.
    #[error(
        "the {coordinates} coordinates of vertex {vertex} are not finite: the cage crosses itself there, or is too large or small for products of three"
    )]
    NotFinite {
        /// Which coordinates.
        coordinates: Coordinates,
        /// The vertex.
        vertex: usize,
    },
    /// Stored weights of another number of vertices or controls.
    #[error("the stored weights are {found} numbers; {vertices} vertices and {controls} controls take {}", .vertices * .controls)]
    Weights {
        /// How many there are.
        found: usize,
        /// Vertices of the model.
        vertices: usize,
        /// Controls: vertices of the cage, with Green coordinates and triangles.
        controls: usize,
    },
}

/// Points per chunk whose derivatives are taken. More: threads wait for one another; fewer: chunks cost more than points.
const GRADIENTS: usize = 64;

/// A model bound to a cage.
#[derive(Clone, Debug)]
pub struct CageBinding {
    cage: Arc<Cage>,
    options: CageOptions,
    binding: Binding,
    report: CageReport,
    /// The grid of harmonic coordinates, once it is known.
    harmonic: OnceLock<Arc<Harmonic>>,
}

impl Cage {
    /// Coordinates of `points` (#points × 3, finite) in this cage.
    ///
    /// # Errors
    ///
    /// Points outside, where these are refused; tetrahedral coordinates in a cage that is no tetrahedron; a cage too thin for the grid of
    /// harmonic coordinates; coordinates that are not finite.
    pub fn bind(&self, points: &[DVec3], options: &CageOptions) -> Result<CageBinding, CageBindingError> {
        CageBinding::new(self, points, options)
    }

    /// Which of `points` are outside, with their distances from the cage.
    fn outside(&self, points: &[DVec3]) -> Vec<(usize, f64)> {
        let windings = winding_numbers(self, points);
        let slack = tolerances::INSIDE * self.extent();
        let suspects: Vec<usize> = (0..points.len()).filter(|i| windings[*i] < 0.5).collect();
        let distances = parallel::map_chunks(suspects.len(), 64, |range| {
            suspects[range].iter().map(|i| (*i, self.distance(points[*i]))).collect::<Vec<_>>()
        });
        distances.into_iter().flatten().filter(|(_, distance)| *distance > slack).collect()
    }

    /// Whether each of `points` is outside.
    pub(crate) fn are_outside(&self, points: &[DVec3]) -> Vec<bool> {
        let mut are_outside = vec![false; points.len()];
        self.outside(points).into_iter().for_each(|(i, _)| are_outside[i] = true);
        are_outside
    }
}

impl CageBinding {
    fn new(cage: &Cage, points: &[DVec3], options: &CageOptions) -> Result<Self, CageBindingError> {
        let outside = checked_outside(cage, points, options)?;
        let harmonic = match options.coordinates {
            Coordinates::Harmonic => Some(Arc::new(harmonic_of(cage, options)?)),
            _ => None,
        };
        let mut is_kept = vec![false; points.len()];
        if options.outside == Outside::Keep {
            outside.iter().for_each(|(i, _)| is_kept[*i] = true);
        }
        let tetrahedron = match options.coordinates {
            Coordinates::Tetrahedral => Some(tetrahedron(cage)?),
            _ => None,
        };
        let rows = Stored::filled_by_parts(points.len(), controls(cage, options.coordinates), |first, stride, rows| {
            let count = rows.len() / stride;
            let points = &points[first..first + count];
            match options.coordinates {
                Coordinates::MeanValue => fill_mean_value(cage, points, stride, rows),
                Coordinates::Green => fill_green(cage, points, stride, rows),
                Coordinates::Harmonic => {
                    for (point, row) in points.iter().zip(rows.chunks_exact_mut(stride)) {
                        let is_inside =
                            harmonic.as_ref().is_some_and(|h| h.fill_row(*point, &mut row[..cage.vertices().len()]));
                        if !is_inside {
                            fill_mean_value(cage, &[*point], stride, row);
                        }
                    }
                }
                Coordinates::Tetrahedral => {
                    let inverse = tetrahedron.unwrap_or(DMat4::NAN);
                    for (point, row) in points.iter().zip(rows.chunks_exact_mut(stride)) {
                        row.copy_from_slice(&(inverse * point.extend(1.0)).to_array());
                    }
                }
            }
            for (row, _) in rows.chunks_exact_mut(stride).zip(&is_kept[first..]).filter(|(_, is_kept)| **is_kept) {
                row.fill(0.0);
            }
        });
        Self::checked(cage, points, options, rows, &outside, harmonic)
    }

    /// The binding of weights that were computed before (#points × #controls, [`CageBinding::weights`]): of the same points, cage and options.
    ///
    /// # Errors
    ///
    /// Weights of another number, or that are not finite; points outside, where these are refused.
    pub fn of_weights(
        cage: &Cage,
        points: &[DVec3],
        options: &CageOptions,
        weights: &[f64],
    ) -> Result<Self, CageBindingError> {
        let columns = controls(cage, options.coordinates);
        if Some(weights.len()) != points.len().checked_mul(columns) {
            return Err(CageBindingError::Weights { found: weights.len(), vertices: points.len(), controls: columns });
        }
        let outside = checked_outside(cage, points, options)?;
        let rows = Stored::filled(points.len(), columns, |v, row| {
            row.copy_from_slice(&weights[v * columns..(v + 1) * columns]);
        });
        Self::checked(cage, points, options, rows, &outside, None)
    }

    fn checked(
        cage: &Cage,
        points: &[DVec3],
        options: &CageOptions,
        rows: Stored,
        outside: &[(usize, f64)],
        harmonic: Option<Arc<Harmonic>>,
    ) -> Result<Self, CageBindingError> {
        let coordinates = options.coordinates;
        let cage = Arc::new(cage.clone());
        let vertices = cage.vertices().len();
        let magnitudes = parallel::collect(points.len(), |v| magnitude(&rows.row(v)[..vertices]));
        let largest_magnitude = (0..points.len()).max_by(|a, b| magnitudes[*a].total_cmp(&magnitudes[*b]));
        let binding = Binding::of_stored(rows);
        let rest = with_normals(&cage, cage.vertices(), coordinates);
        let ones: Vec<f64> = (0..rest.len()).map(|i| if i < vertices { 1.0 } else { 0.0 }).collect();
        let (sums, images) = (binding.apply_scalar(&ones), binding.apply(&rest));
        if let Some(vertex) = (0..points.len()).find(|v| !(sums[*v].is_finite() && images[*v].is_finite())) {
            return Err(CageBindingError::NotFinite { coordinates, vertex });
        }
        // A row that is kept is zero, and so is its sum.
        let follows = |v: &usize| options.outside != Outside::Keep || sums[*v] != 0.0;
        let largest = |of: &dyn Fn(usize) -> f64| (0..points.len()).filter(follows).map(of).fold(0.0, f64::max);
        let report = CageReport {
            coordinates: coordinates.name().into(),
            vertices,
            triangles: cage.triangles().len(),
            constant_precision: largest(&|v| (sums[v] - 1.0).abs()),
            linear_precision: largest(&|v| images[v].distance(points[v])) / cage.extent(),
            lebesgue_constant: largest_magnitude.map_or(0.0, |v| magnitudes[v]),
            lebesgue_vertex: largest_magnitude.unwrap_or_default(),
            outside: outside.len(),
            farthest: outside.iter().map(|(_, distance)| *distance).fold(0.0, f64::max),
            harmonic: harmonic.as_ref().map(|h| h.report().clone()),
        };
        let known = OnceLock::new();
        if let Some(harmonic) = harmonic {
            let _ = known.set(harmonic); // it is new, so nothing was set
        }
        Ok(Self { cage, options: options.clone(), binding, report, harmonic: known })
    }

    /// The cage at rest.
    #[must_use]
    pub fn cage(&self) -> &Cage {
        &self.cage
    }

    /// The coordinates.
    #[must_use]
    pub fn coordinates(&self) -> Coordinates {
        self.options.coordinates
    }

    /// W (#points × #controls): the controls are the cage's vertices; with Green coordinates its triangles come after them.
    #[must_use]
    pub fn binding(&self) -> &Binding {
        &self.binding
    }

    /// How good the coordinates are.
    #[must_use]
    pub fn report(&self) -> &CageReport {
        &self.report
    }

    /// This binding with products that have the same bits on every processor ([`Binding::portable`]).
    #[must_use]
    pub fn portable(self) -> Self {
        Self { binding: self.binding.portable(), ..self }
    }

    /// All weights (#points × #controls), to be stored.
    #[must_use]
    pub fn weights(&self) -> Vec<f64> {
        let columns = self.binding.control_count();
        let mut weights = vec![0.0; self.binding.vertex_count() * columns];
        parallel::for_each_chunk(&mut weights, columns * 64, |first, rows| {
            for (v, row) in (first / columns..).zip(rows.chunks_exact_mut(columns)) {
                self.binding.weights(v).into_iter().for_each(|(c, w)| row[c] = w);
            }
        });
        weights
    }

    /// E(C) − E(C⁰) (#controls × 3): what W is applied to, for the cage's vertices at `posed` (#vertices × 3).
    ///
    /// # Panics
    ///
    /// Panics where `posed` does not have one entry per vertex of the cage.
    #[must_use]
    pub fn displacement(&self, posed: &[DVec3]) -> Vec<DVec3> {
        self.controls(posed)
            .iter()
            .zip(self.controls(self.cage.vertices()))
            .map(|(posed, rest)| *posed - rest)
            .collect()
    }

    /// The posed points P for the cage's vertices at `posed`, of the points at rest that were bound. Where the cage is at rest they keep their
    /// bits.
    ///
    /// # Panics
    ///
    /// Panics where an array does not have one entry per point, or vertex of the cage.
    #[must_use]
    pub fn deformed(&self, rest: &[DVec3], posed: &[DVec3]) -> Vec<DVec3> {
        self.binding.displaced(rest, &self.displacement(posed))
    }

    /// From ∂f/∂P (#points × 3) to ∂f/∂C (#vertices of the cage × 3), at a pose of the cage.
    ///
    /// # Panics
    ///
    /// Panics where an array does not have one entry per point, or vertex of the cage.
    #[must_use]
    pub fn gradient(&self, posed: &[DVec3], by_point: &[DVec3]) -> Vec<DVec3> {
        self.pulled(posed, self.binding.adjoint(by_point))
    }

    /// The same from ∂f/∂E (#controls × 3).
    pub(crate) fn pulled(&self, posed: &[DVec3], mut by_control: Vec<DVec3>) -> Vec<DVec3> {
        let by_normal = by_control.split_off(self.cage.vertices().len());
        if !by_normal.is_empty() {
            let of_normals = pulled_back(&self.cage, posed, &by_normal);
            by_control = displaced(&by_control, &of_normals);
        }
        by_control
    }

    /// Jacobian matrices ∂P/∂P⁰ at `points` (any points, #points), for the cage's vertices at `posed`. On the cage, where most coordinates have
    /// no derivative, those a little inside ([`tolerances::BESIDE_CAGE`]). With `outside` "keep" the identity outside the cage.
    ///
    /// # Errors
    ///
    /// A cage too thin for the grid of harmonic coordinates, where weights were loaded.
    pub fn jacobians(&self, points: &[DVec3], posed: &[DVec3]) -> Result<Vec<DMat3>, CageBindingError> {
        let mut jacobians = match self.coordinates() {
            Coordinates::MeanValue => mean_value_jacobians(&self.cage, points, posed),
            Coordinates::Green => green_jacobians(&self.cage, points, posed),
            Coordinates::Tetrahedral => {
                let image = corners_of(posed) * tetrahedron(&self.cage)?;
                vec![DMat3::from_mat4(image); points.len()]
            }
            Coordinates::Harmonic => self.harmonic_jacobians(points, posed)?,
        };
        if self.options.outside == Outside::Keep {
            self.cage.outside(points).into_iter().for_each(|(i, _)| jacobians[i] = DMat3::IDENTITY);
        }
        Ok(jacobians)
    }

    fn harmonic_jacobians(&self, points: &[DVec3], posed: &[DVec3]) -> Result<Vec<DMat3>, CageBindingError> {
        let harmonic = self.harmonic()?;
        let parts = parallel::map_chunks(points.len(), GRADIENTS, |range| {
            let mut gradients = vec![DVec3::ZERO; posed.len()];
            let jacobian = |point: &DVec3| {
                self.fill_harmonic_gradients(harmonic, *point, &mut gradients);
                jacobian_of(&gradients, posed)
            };
            points[range].iter().map(jacobian).collect::<Vec<_>>()
        });
        Ok(parts.concat())
    }

    /// ∇α on the grid, outside those of mean value coordinates (#vertices of the cage).
    fn fill_harmonic_gradients(&self, harmonic: &Harmonic, point: DVec3, gradients: &mut [DVec3]) {
        let point = self.cage.beside(point);
        if !harmonic.fill_gradient(point, gradients) {
            fill_mean_value_gradients(&self.cage, point, gradients);
        }
    }

    /// The grid of harmonic coordinates.
    fn harmonic(&self) -> Result<&Harmonic, CageBindingError> {
        if let Some(harmonic) = self.harmonic.get() {
            return Ok(harmonic);
        }
        let harmonic = harmonic_of(&self.cage, &self.options)?;
        Ok(self.harmonic.get_or_init(|| Arc::new(harmonic))) // another thread may have been first: with the same
    }

    /// Gradients of the coordinates by the place, ∇α of each control at each point (#points × #controls): with them a Jacobian matrix is
    /// `Σ E(C) ⊗ ∇α`. Places as in [`CageBinding::jacobians`].
    ///
    /// # Errors
    ///
    /// As [`CageBinding::jacobians`].
    pub(crate) fn gradients_of_coordinates(&self, points: &[DVec3]) -> Result<Vec<DVec3>, CageBindingError> {
        let columns = controls(&self.cage, self.coordinates());
        let filled = |fill: &(dyn Fn(DVec3, &mut [DVec3]) + Sync)| {
            let mut gradients = vec![DVec3::ZERO; points.len() * columns];
            parallel::for_each_chunk(&mut gradients, GRADIENTS * columns, |first, rows| {
                points[first / columns..].iter().zip(rows.chunks_mut(columns)).for_each(|(p, row)| fill(*p, row));
            });
            gradients
        };
        Ok(match self.coordinates() {
            Coordinates::MeanValue => filled(&|p, row| fill_mean_value_gradients(&self.cage, self.cage.beside(p), row)),
            Coordinates::Green => green_gradients(&self.cage, points),
            Coordinates::Harmonic => {
                let harmonic = self.harmonic()?;
                filled(&|p, row| self.fill_harmonic_gradients(harmonic, p, row))
            }
            Coordinates::Tetrahedral => {
                let inverse = tetrahedron(&self.cage)?;
                filled(&|_, row| row.iter_mut().enumerate().for_each(|(i, g)| *g = inverse.row(i).truncate()))
            }
        })
    }

    /// E(C): the cage's vertices at `posed` (#vertices × 3), with Green coordinates followed by its stretched normals.
    pub(crate) fn controls(&self, posed: &[DVec3]) -> Vec<DVec3> {
        with_normals(&self.cage, posed, self.coordinates())
    }
}

/// The grid of harmonic coordinates.
fn harmonic_of(cage: &Cage, options: &CageOptions) -> Result<Harmonic, HarmonicError> {
    Harmonic::new(cage, &options.harmonic.clone().unwrap_or_else(|| HarmonicOptions::fitted(cage)))
}

/// Controls of a cage with these coordinates.
fn controls(cage: &Cage, coordinates: Coordinates) -> usize {
    cage.vertices().len() + if coordinates == Coordinates::Green { cage.triangles().len() } else { 0 }
}

/// Σ |α|, eight sums side by side.
fn magnitude(row: &[f64]) -> f64 {
    let (eights, rest) = row.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for eight in eights {
        sums.iter_mut().zip(eight).for_each(|(sum, a)| *sum += a.abs());
    }
    sums.iter().sum::<f64>() + rest.iter().map(|a| a.abs()).sum::<f64>()
}

/// E(C).
fn with_normals(cage: &Cage, posed: &[DVec3], coordinates: Coordinates) -> Vec<DVec3> {
    assert_eq!(posed.len(), cage.vertices().len(), "one entry for each vertex of the cage");
    let mut all = posed.to_vec();
    if coordinates == Coordinates::Green {
        all.extend(stretched_normals(cage, posed));
    }
    all
}

/// The points outside, or an error where these are refused.
fn checked_outside(
    cage: &Cage,
    points: &[DVec3],
    options: &CageOptions,
) -> Result<Vec<(usize, f64)>, CageBindingError> {
    let outside = cage.outside(points);
    match (options.outside, outside.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))) {
        (Outside::Refuse, Some((vertex, distance))) => {
            Err(CageBindingError::Outside { count: outside.len(), vertex, distance })
        }
        _ => Ok(outside),
    }
}

/// The corners of a tetrahedron as columns, each with a 1 below.
fn corners_of(vertices: &[DVec3]) -> DMat4 {
    let column = |i: usize| vertices[i].extend(1.0);
    DMat4::from_cols(column(0), column(1), column(2), column(3))
}

/// The matrix from a point, with a 1 below, to its barycentric coordinates.
fn tetrahedron(cage: &Cage) -> Result<DMat4, CageBindingError> {
    let (vertices, triangles) = (cage.vertices().len(), cage.triangles().len());
    if (vertices, triangles) != (4, 4) {
        return Err(CageBindingError::NoTetrahedron { vertices, triangles });
    }
    Ok(corners_of(cage.vertices()).inverse())
}
