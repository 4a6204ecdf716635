//! The linear map from controls to vertices, and its transpose.
//!
//! Every space deformer here is linear in its controls: `P = P⁰ + W (C − C⁰)`. A [`Binding`] is W (#vertices ×
//! #controls): it *applies* W to something per control and its *adjoint* Wᵀ to something per vertex. The adjoint carries
//! any derivative from vertices to controls: `∂V/∂C = Wᵀ ∂V/∂P` is HB (10)–(12).
//!
//! Written so, controls at rest give back P⁰ bit for bit. Rows sum to 1 and reproduce positions (`W C⁰ = P⁰`), except the
//! rows of vertices that are kept where they are: those are zero.
//!
//! The rows of a lattice are products, made on the fly ([`crate::tensor`]); those of cages are stored in full ([`crate::stored`]).
//!
//! Bits do not depend on the number of threads. They may depend on the processor: where it has fused multiply-adds these are used, unless
//! [`Binding::portable`] forbids it.

use std::ops::{AddAssign, Mul, Range};

use glam::DVec3;

use crate::bspline::Basis;
use crate::parallel;
use crate::stored::Stored;
use crate::tensor::Tensor;

/// W (#vertices × #controls).
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    rows: Rows,
}

/// The rows of W.
#[derive(Clone, Debug, PartialEq)]
enum Rows {
    Tensor(Tensor),
    Stored(Stored),
}

/// The same expression of rows of either kind.
macro_rules! of_rows {
    ($binding:expr, $rows:ident => $value:expr) => {
        match &$binding.rows {
            Rows::Tensor($rows) => $value,
            Rows::Stored($rows) => $value,
        }
    };
}

/// What there is one of per control or vertex: a number or a vector, of D coordinates.
pub(crate) trait Entry<const D: usize>:
    Copy + Default + AddAssign + Mul<f64, Output = Self> + Send + Sync
{
    fn coordinates(self) -> [f64; D];
    fn of(coordinates: [f64; D]) -> Self;
}

impl Entry<1> for f64 {
    #[inline(always)]
    fn coordinates(self) -> [f64; 1] {
        [self]
    }

    #[inline(always)]
    fn of([x]: [f64; 1]) -> Self {
        x
    }
}

impl Entry<3> for DVec3 {
    #[inline(always)]
    fn coordinates(self) -> [f64; 3] {
        self.to_array()
    }

    #[inline(always)]
    fn of(coordinates: [f64; 3]) -> Self {
        Self::from_array(coordinates)
    }
}

/// The vertices of a model at rest, and how they follow the controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundVertices<'a> {
    /// Rest positions P⁰ (#vertices × 3).
    pub rest: &'a [DVec3],
    /// W (#vertices × #controls).
    pub binding: &'a Binding,
}

impl Binding {
    /// A binding to controls with these bases. `parameters(v)` is where vertex v lies, or `None` where it is kept where it is.
    pub(crate) fn of_bases(
        vertices: usize,
        bases: &[Basis; 3],
        parameters: impl Fn(usize) -> Option<DVec3> + Sync + Send,
    ) -> Self {
        Self { rows: Rows::Tensor(Tensor::of_bases(vertices, bases, parameters)) }
    }

    /// A binding of any weights: row v of W is `weights[v · columns .. (v + 1) · columns]`. Vertices whose row is zero are kept.
    ///
    /// # Panics
    ///
    /// Panics where `columns` is 0 or does not divide the number of weights.
    #[must_use]
    pub fn of_weights(columns: usize, weights: &[f64]) -> Self {
        assert!(columns > 0 && weights.len().is_multiple_of(columns), "a row of weights for each vertex");
        Self::of_stored(Stored::filled(weights.len() / columns, columns, |v, row| {
            row.copy_from_slice(&weights[v * columns..(v + 1) * columns]);
        }))
    }

    pub(crate) fn of_stored(rows: Stored) -> Self {
        Self { rows: Rows::Stored(rows) }
    }

    /// The rows of `vertices` alone, in that order: the binding of fewer vertices to the same controls.
    ///
    /// # Panics
    ///
    /// Panics where a vertex is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn rows_of(&self, vertices: &[u32]) -> Self {
        let rows = match &self.rows {
            Rows::Tensor(rows) => Rows::Tensor(rows.rows_of(vertices)),
            Rows::Stored(rows) => Rows::Stored(rows.rows_of(vertices)),
        };
        Self { rows }
    }

    /// This binding without fused multiply-adds: products with it, and corrections by it, have the same bits on every processor. They take
    /// a little longer.
    #[must_use]
    pub fn portable(self) -> Self {
        let rows = match self.rows {
            Rows::Tensor(rows) => Rows::Tensor(rows.portable()),
            Rows::Stored(rows) => Rows::Stored(rows.portable()),
        };
        Self { rows }
    }

    /// Whether products have the same bits on every processor.
    #[must_use]
    pub fn is_portable(&self) -> bool {
        of_rows!(self, rows => rows.is_portable())
    }

    /// Number of vertices: rows of W.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        of_rows!(self, rows => rows.vertex_count())
    }

    /// Number of controls: columns of W.
    #[must_use]
    pub fn control_count(&self) -> usize {
        of_rows!(self, rows => rows.control_count())
    }

    /// Vertices whose row is zero: they stay where they are whatever the controls do.
    #[must_use]
    pub fn kept_count(&self) -> usize {
        of_rows!(self, rows => rows.kept_count())
    }

    /// Bytes of its arrays: what a product with W reads of W.
    #[must_use]
    pub fn memory(&self) -> usize {
        of_rows!(self, rows => rows.memory())
    }

    /// `W c`: from one vector per control (#controls × 3) to one per vertex (#vertices × 3).
    ///
    /// # Panics
    ///
    /// Panics where `c` does not have one entry per control.
    #[must_use]
    pub fn apply(&self, c: &[DVec3]) -> Vec<DVec3> {
        let mut product = Vec::new();
        self.apply_into(c, &mut product);
        product
    }

    /// [`Binding::apply`] in the memory of `out`.
    pub(crate) fn apply_into(&self, c: &[DVec3], out: &mut Vec<DVec3>) {
        self.product(c, out, |_, d: DVec3, _| d);
    }

    /// `points + W c` (#vertices × 3) in one go: [`displaced`] by [`Binding::apply`], with the same bits.
    ///
    /// # Panics
    ///
    /// Panics where `points` does not have one entry per vertex or `c` one per control.
    #[must_use]
    pub fn displaced(&self, points: &[DVec3], c: &[DVec3]) -> Vec<DVec3> {
        let mut displaced = Vec::new();
        self.displace_into(points, c, &mut displaced);
        displaced
    }

    /// [`Binding::displaced`] in the memory of `out`.
    pub(crate) fn displace_into(&self, points: &[DVec3], c: &[DVec3], out: &mut Vec<DVec3>) {
        assert_eq!(points.len(), self.vertex_count(), "one entry for each vertex");
        self.product(c, out, |v, d: DVec3, _| moved(points[v], d));
    }

    /// `W c` for one number per control (#controls), as where all controls move along one direction.
    ///
    /// # Panics
    ///
    /// Panics where `c` does not have one entry per control.
    #[must_use]
    pub fn apply_scalar(&self, c: &[f64]) -> Vec<f64> {
        let mut product = Vec::new();
        self.product(c, &mut product, |_, d: f64, _| d);
        product
    }

    /// `Wᵀ g`: from one vector per vertex (#vertices × 3) to one per control (#controls × 3).
    ///
    /// # Panics
    ///
    /// Panics where `g` does not have one entry per vertex.
    #[must_use]
    pub fn adjoint(&self, g: &[DVec3]) -> Vec<DVec3> {
        assert_eq!(g.len(), self.vertex_count(), "one entry for each vertex");
        self.transposed_product(|v| g[v])
    }

    /// `Wᵀ g` for one number per vertex (#vertices).
    ///
    /// # Panics
    ///
    /// Panics where `g` does not have one entry per vertex.
    #[must_use]
    pub fn adjoint_scalar(&self, g: &[f64]) -> Vec<f64> {
        assert_eq!(g.len(), self.vertex_count(), "one entry for each vertex");
        self.transposed_product(|v| g[v])
    }

    /// Row v of W: the controls that vertex v depends on, with their weights. Empty for a kept vertex.
    ///
    /// # Panics
    ///
    /// Panics where `v` is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn weights(&self, v: usize) -> Vec<(usize, f64)> {
        of_rows!(self, rows => rows.weights(v))
    }

    /// Control points along u, v, w; all along w where they are no lattice.
    pub(crate) fn size(&self) -> [usize; 3] {
        of_rows!(self, rows => rows.size())
    }

    /// The first control along u, v, w that vertex v follows, and how many there are; none for a kept vertex.
    pub(crate) fn reach_of(&self, v: usize) -> ([usize; 3], [usize; 3]) {
        of_rows!(self, rows => rows.reach_of(v))
    }

    /// Row v of W over [`Binding::reach_of`], the last axis first; `scratch` may hold anything.
    pub(crate) fn fill_row(&self, v: usize, row: &mut [f64], scratch: &mut Vec<f64>) {
        match &self.rows {
            Rows::Tensor(rows) => rows.fill_row(v, row, scratch),
            Rows::Stored(rows) => row.copy_from_slice(rows.row(v)),
        }
    }

    /// Entries that [`Binding::gram`] goes through; `None` where there are too many to count.
    pub(crate) fn gram_len(&self) -> Option<usize> {
        of_rows!(self, rows => rows.gram_len())
    }

    /// The entries (i, j, value), i ≤ j, of `Wᵀ W` (#controls × #controls) that can differ from 0, in no particular order, none twice.
    pub(crate) fn gram(&self) -> Vec<(usize, usize, f64)> {
        of_rows!(self, rows => rows.gram())
    }

    /// `Wᵀ g` of some vertices alone: `g(v)` for each of `vertices`, in their order.
    pub(crate) fn adjoint_among<T: Entry<D>, const D: usize>(
        &self,
        vertices: &[u32],
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        of_rows!(self, rows => rows.sum_of_rows(vertices.iter().map(|v| *v as usize), g))
    }

    /// The vertices in ascending order of their cells, so that those that follow the same controls come one after the other. Vertices of
    /// the same cell keep their order; kept vertices come last. Where weights are stored it is the order that there is.
    ///
    /// A model in this order ([`Binding::permuted`], [`crate::Solid::permuted`]) is deformed and corrected faster.
    #[must_use]
    pub fn cell_order(&self) -> Vec<u32> {
        match &self.rows {
            Rows::Tensor(rows) => rows.cell_order(),
            Rows::Stored(rows) => (0..rows.vertex_count() as u32).collect(),
        }
    }

    /// This binding with its vertices in another order: vertex i of the result is vertex `order[i]` of this one.
    ///
    /// # Panics
    ///
    /// Panics where an entry of `order` is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn permuted(&self, order: &[u32]) -> Self {
        self.rows_of(order)
    }

    /// `finish(v, (W c)_v, out_v)` for every vertex v, to `out`: what is there already stays where it has an entry for each vertex.
    pub(crate) fn product<T: Entry<D>, U: Copy + Default + Send, const D: usize>(
        &self,
        c: &[T],
        out: &mut Vec<U>,
        finish: impl Fn(usize, T, U) -> U + Sync + Send,
    ) {
        assert_eq!(c.len(), self.control_count(), "one entry for each control");
        parallel::resize(out, self.vertex_count());
        of_rows!(self, rows => rows.product(c, out, finish));
    }

    /// `Wᵀ g` for `g(v)`.
    pub(crate) fn transposed_product<T: Entry<D>, const D: usize>(
        &self,
        g: impl Fn(usize) -> T + Sync + Send,
    ) -> Vec<T> {
        // Partial sums over fixed parts of the vertices, each part at least as long as the sums themselves.
        let vertices = self.vertex_count();
        let part = parallel::chunk(vertices).max(vertices.div_ceil(parallel::PARTS)).max(self.control_count());
        let sums = parallel::map_chunks(vertices, part, |range| self.part_of_transposed(range, &g));
        self.sum_of_parts(sums)
    }

    /// What some vertices, with their `g(v)`, add to `Wᵀ g` (#controls).
    pub(crate) fn part_of_transposed<T: Entry<D>, const D: usize>(
        &self,
        vertices: Range<usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        of_rows!(self, rows => rows.part_of_transposed(vertices, g))
    }

    /// The whole of parts.
    pub(crate) fn sum_of_parts<T: Copy + Default + AddAssign>(
        &self,
        parts: impl IntoIterator<Item = Vec<T>>,
    ) -> Vec<T> {
        let mut total = vec![T::default(); self.control_count()];
        for part in parts {
            for (t, s) in total.iter_mut().zip(part) {
                *t += s;
            }
        }
        total
    }
}

/// `points + displacement` (both #vertices × 3). Where nothing moves the point keeps its bits, the sign of a zero included.
#[must_use]
pub fn displaced(points: &[DVec3], displacement: &[DVec3]) -> Vec<DVec3> {
    parallel::collect(points.len().min(displacement.len()), |v| moved(points[v], displacement[v]))
}

/// `points + by`, in the same way.
pub(crate) fn translated(points: &[DVec3], by: DVec3) -> Vec<DVec3> {
    parallel::collect(points.len(), |v| moved(points[v], by))
}

pub(crate) fn moved(p: DVec3, d: DVec3) -> DVec3 {
    DVec3::select(d.cmpeq(DVec3::ZERO), p, p + d)
}
