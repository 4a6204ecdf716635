//! B-spline lattices: the free-form deformation of HB, section 2.
//!
//! `D(u, v, w) = Σ_ijk C_ijk B_i(u) B_j(v) B_k(w)` (HB (1)), in the form `P = P⁰ + W (C − C⁰)`: an untouched lattice gives
//! back the model bit for bit.
//!
//! # Changes versus the paper
//!
//! - Any degree, knots and size per axis, Bernstein polynomials among them; any parallelepiped as frame.
//! - The rest positions C⁰ stand at the Greville abscissae, so that `W C⁰ = P⁰` whatever the knots are.
//! - Vertices outside the frame are kept, carried by the linear extension of the basis, or refused.

use glam::{DMat3, DVec3};

use crate::binding::Binding;
use crate::bspline::{Basis, BasisError};
use crate::mesh::Bounds;
use crate::parallel;
use crate::tolerances;

/// A parallelepiped: parameters (u, v, w) ∈ [0, 1]³ stand for `origin + u·axes[0] + v·axes[1] + w·axes[2]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its corner at u = v = w = 0.
    pub origin: DVec3,
    /// Its edges, whole lengths, in the length unit of the model.
    pub axes: [DVec3; 3],
}

impl Frame {
    /// The box `bounds`, grown on every side by `margin` times its extent. A side without thickness is widened to a tenth
    /// of the extent, so that flat models have parameters too.
    ///
    /// # Errors
    ///
    /// A box of no extent at all, or a margin that leaves nothing of it.
    pub fn fitted(bounds: Bounds, margin: f64) -> Result<Self, LatticeError> {
        let extent = bounds.extent();
        let widen = |side: f64| if side > tolerances::FLAT_SIDE * extent { side } else { 0.1 * extent };
        let size = DVec3::from_array(bounds.size().to_array().map(widen)) + 2.0 * margin * extent;
        if !(extent > 0.0 && size.min_element() > 0.0 && size.is_finite()) {
            return Err(LatticeError::NothingToFit { size: bounds.size(), margin });
        }
        let origin = bounds.center() - size / 2.0;
        Ok(Self { origin, axes: [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z] })
    }

    /// The corners of the box that holds the whole frame.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let corner = |c: usize| {
            (0..3).filter(|a| c >> a & 1 == 1).map(|a| self.axes[a]).fold(self.origin, |sum, axis| sum + axis)
        };
        let corners: [DVec3; 8] = std::array::from_fn(corner);
        Bounds::of(&corners).expect("a frame has eight corners")
    }

    /// Length of the longest edge.
    #[must_use]
    pub fn extent(&self) -> f64 {
        self.axes.iter().map(|a| a.length()).fold(0.0, f64::max)
    }

    /// The same frame moved by `by`.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        Self { origin: self.origin + by, ..*self }
    }
}

/// A B-spline lattice at rest. Controls are indexed `(i · size[1] + j) · size[2] + k`, i along u, j along v, k along w.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    bases: [Basis; 3],
    frame: Frame,
    /// Rows are the gradients of u, v, w in model coordinates.
    inverse: [DVec3; 3],
}

/// What happens to vertices outside the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Outside {
    /// They stay where they are.
    #[default]
    Keep,
    /// They follow the linear extension of the basis beyond its domain.
    Extend,
    /// They are an error.
    Refuse,
}

/// Why there is no lattice, or no binding to it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LatticeError {
    /// A basis is impossible.
    #[error("along {axis}: {source}")]
    Basis {
        /// "u", "v" or "w".
        axis: char,
        /// What is wrong with it.
        source: BasisError,
    },
    /// Edges that are not finite, zero or in one plane.
    #[error("the frame of the lattice is flat or not finite: its edges {} , {} , {} span a volume of {volume:e}", .axes[0], .axes[1], .axes[2])]
    FlatFrame {
        /// The edges.
        axes: [DVec3; 3],
        /// Their determinant.
        volume: f64,
    },
    /// More control points than fit into memory sensibly.
    #[error("{} × {} × {} control points are too many: at most {MAX_CONTROLS} in all", .size[0], .size[1], .size[2])]
    TooManyControls {
        /// Control points along u, v, w.
        size: [usize; 3],
    },
    /// A model without extent, or a margin that leaves no box.
    #[error("no lattice can be fitted to a box of {} × {} × {} with margin {margin}", .size.x, .size.y, .size.z)]
    NothingToFit {
        /// Sides of the box.
        size: DVec3,
        /// The margin.
        margin: f64,
    },
    /// Vertices outside, and these were to be refused.
    #[error("{count} vertices are outside the lattice; vertex {vertex} has parameters ({}, {}, {}), beyond [0, 1] by more than the tolerance", .parameters.x, .parameters.y, .parameters.z)]
    Outside {
        /// How many.
        count: usize,
        /// The first of them.
        vertex: usize,
        /// Its (u, v, w).
        parameters: DVec3,
    },
}

/// Most control points in all. More: rows of 2²⁴ controls need gigabytes; fewer: 64³ and far beyond must fit.
pub const MAX_CONTROLS: usize = 1 << 24;

impl Lattice {
    /// A lattice of three bases (along u, v, w) over `frame`.
    ///
    /// # Errors
    ///
    /// A frame that is flat or not finite; too many control points.
    pub fn new(bases: [Basis; 3], frame: Frame) -> Result<Self, LatticeError> {
        let size = [0, 1, 2].map(|a| bases[a].size());
        if size.iter().product::<usize>() > MAX_CONTROLS {
            return Err(LatticeError::TooManyControls { size });
        }
        let [a, b, c] = frame.axes;
        let volume = a.dot(b.cross(c));
        let lengths = a.length() * b.length() * c.length();
        if !(volume.abs() > tolerances::FLAT_FRAME * lengths && lengths.is_finite() && frame.origin.is_finite()) {
            return Err(LatticeError::FlatFrame { axes: frame.axes, volume });
        }
        let inverse = [b.cross(c) / volume, c.cross(a) / volume, a.cross(b) / volume];
        Ok(Self { bases, frame, inverse })
    }

    /// The bases along u, v, w.
    #[must_use]
    pub fn bases(&self) -> &[Basis; 3] {
        &self.bases
    }

    /// The frame.
    #[must_use]
    pub fn frame(&self) -> Frame {
        self.frame
    }

    /// Control points along u, v, w.
    #[must_use]
    pub fn size(&self) -> [usize; 3] {
        [0, 1, 2].map(|a| self.bases[a].size())
    }

    /// Number of control points.
    #[must_use]
    pub fn control_count(&self) -> usize {
        self.size().iter().product()
    }

    /// Flat index of control point (i, j, k).
    #[must_use]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        let [_, nv, nw] = self.size();
        (i * nv + j) * nw + k
    }

    /// The (i, j, k) of a flat index.
    #[must_use]
    pub fn node(&self, index: usize) -> [usize; 3] {
        let [_, nv, nw] = self.size();
        [index / (nv * nw), index / nw % nv, index % nw]
    }

    /// The rest positions C⁰ (#controls × 3), at the Greville abscissae.
    #[must_use]
    pub fn rest(&self) -> Vec<DVec3> {
        let [a, b, c] = self.frame.axes;
        let [us, vs, ws] = [0, 1, 2].map(|axis| self.bases[axis].greville());
        let mut rest = Vec::with_capacity(self.control_count());
        for u in &us {
            for v in &vs {
                rest.extend(ws.iter().map(|w| self.frame.origin + a * *u + b * *v + c * *w));
            }
        }
        rest
    }

    /// Parameters (u, v, w) of a point; inside the frame all are in [0, 1].
    #[must_use]
    pub fn parameters(&self, point: DVec3) -> DVec3 {
        let p = point - self.frame.origin;
        DVec3::from_array(self.inverse.map(|row| row.dot(p)))
    }

    /// Whether parameters are inside, [`tolerances::INSIDE`] included.
    pub(crate) fn is_inside(&self, parameters: DVec3) -> bool {
        let extent = self.frame.extent();
        (0..3).all(|a| {
            let slack = tolerances::INSIDE * extent / self.frame.axes[a].length();
            (-slack..=1.0 + slack).contains(&parameters[a])
        })
    }

    /// W for `points` (#points × 3, finite, model coordinates).
    ///
    /// # Errors
    ///
    /// Points outside, where `outside` refuses them.
    pub fn bind(&self, points: &[DVec3], outside: Outside) -> Result<Binding, LatticeError> {
        if outside == Outside::Refuse {
            let is_out = |p: &DVec3| !self.is_inside(self.parameters(*p));
            if let Some(vertex) = points.iter().position(is_out) {
                let count = points.iter().filter(|p| is_out(p)).count();
                return Err(LatticeError::Outside { count, vertex, parameters: self.parameters(points[vertex]) });
            }
        }
        Ok(Binding::of_bases(points.len(), &self.bases, |v| {
            let parameters = self.parameters(points[v]);
            (outside != Outside::Keep || self.is_inside(parameters)).then_some(parameters)
        }))
    }

    /// Jacobian matrices ∂P/∂P⁰ (#points) of the deformation `P = P⁰ + W (C − C⁰)` at `points` (#points × 3), for the
    /// control displacement C − C⁰ (#controls × 3). The identity where nothing moves.
    ///
    /// # Panics
    ///
    /// Panics where `displacement` does not have one entry per control.
    #[must_use]
    pub fn jacobians(&self, points: &[DVec3], displacement: &[DVec3], outside: Outside) -> Vec<DMat3> {
        assert_eq!(displacement.len(), self.control_count(), "one displacement for each control");
        let parts = parallel::map_chunks(points.len(), parallel::CHUNK, |range| {
            let mut rows = [0, 1, 2].map(|a| vec![0.0; self.bases[a].degree() + 1]);
            let mut slopes = rows.clone();
            let jacobian = |p: &DVec3| self.jacobian(*p, displacement, outside, &mut rows, &mut slopes);
            points[range].iter().map(jacobian).collect::<Vec<_>>()
        });
        parts.concat()
    }

    /// [`Lattice::jacobians`] at one point; `rows` and `slopes` are scratch space.
    fn jacobian(
        &self,
        point: DVec3,
        displacement: &[DVec3],
        outside: Outside,
        rows: &mut [Vec<f64>; 3],
        slopes: &mut [Vec<f64>; 3],
    ) -> DMat3 {
        let parameters = self.parameters(point);
        if outside == Outside::Keep && !self.is_inside(parameters) {
            return DMat3::IDENTITY;
        }
        let mut starts = [0; 3];
        for a in 0..3 {
            starts[a] = self.bases[a].row(parameters[a], &mut rows[a]);
            self.bases[a].row_derivative(parameters[a], &mut slopes[a]);
        }
        let mut by_parameter = [DVec3::ZERO; 3];
        for a in 0..rows[0].len() {
            for b in 0..rows[1].len() {
                for c in 0..rows[2].len() {
                    let d = displacement[self.index([starts[0] + a, starts[1] + b, starts[2] + c])];
                    by_parameter[0] += d * (slopes[0][a] * rows[1][b] * rows[2][c]);
                    by_parameter[1] += d * (rows[0][a] * slopes[1][b] * rows[2][c]);
                    by_parameter[2] += d * (rows[0][a] * rows[1][b] * slopes[2][c]);
                }
            }
        }
        // ∂(W d)/∂x = Σ_a ∂(W d)/∂u_a ⊗ ∇u_a
        (0..3).fold(DMat3::IDENTITY, |sum, a| {
            let (column, gradient) = (by_parameter[a], self.inverse[a]);
            sum + DMat3::from_cols(column * gradient.x, column * gradient.y, column * gradient.z)
        })
    }
}
