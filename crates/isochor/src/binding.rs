//! The linear map from controls to vertices, and its transpose.
//!
//! Every space deformer here is linear in its controls: `P = P⁰ + W (C − C⁰)`. A [`Binding`] is W (#vertices ×
//! #controls): it *applies* W to something per control and its *adjoint* Wᵀ to something per vertex. The adjoint carries
//! any derivative from vertices to controls: `∂V/∂C = Wᵀ ∂V/∂P` is HB (10)–(12).
//!
//! Written so, controls at rest give back P⁰ bit for bit. Rows sum to 1 and reproduce positions (`W C⁰ = P⁰`), except the
//! rows of vertices that are kept where they are: those are zero.
//!
//! A lattice stores three short univariate rows per vertex and multiplies them on the fly: 12 numbers for a cubic lattice
//! instead of 64. (Weights of other deformers, stored in full, would become a second representation behind the same
//! verbs.)
//!
//! Vertices that follow one another and the same controls are a *run*. Cubic rows have a fast path: the 4 × 4 × 4 controls of a run
//! are brought together once, and products with them are taken 8 at a time. [`Binding::cell_order`] is the order with the longest
//! runs.
//!
//! Bits do not depend on the number of threads. They may depend on the processor: where it has fused multiply-adds these are used.

use std::ops::{AddAssign, Mul, Range};

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4, f64x8};
use glam::DVec3;

use crate::order;
use crate::parallel;

/// W (#vertices × #controls).
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    /// Control points along u, v, w. Flat control index: `(i · size[1] + j) · size[2] + k`.
    size: [usize; 3],
    /// Numbers per univariate row: degree + 1 along u, v, w.
    lengths: [usize; 3],
    /// First control index along u, v, w for each vertex.
    starts: Vec<[u16; 3]>,
    /// The three univariate rows of each vertex, one after the other.
    rows: Vec<f64>,
    kept: usize,
}

/// Numbers per vertex of three cubic rows.
const CUBIC: usize = 12;

/// The controls of a run with cubic rows, D coordinates of each: `block[2a + h][x]` has coordinate x of the controls (a, 2h, ·) and
/// (a, 2h + 1, ·).
type Block<S, const D: usize> = [[f64x8<S>; D]; 8];

/// What there is one of per control or vertex: a number or a vector, of D coordinates.
trait Entry<const D: usize>: Copy + Default + AddAssign + Mul<f64, Output = Self> + Send + Sync {
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

/// Most partial sums of an adjoint. More: better balance between many threads; fewer: less memory.
const PARTS: usize = 32;

impl Binding {
    /// A binding from one set of univariate rows per vertex. `row(v, values)` fills the three rows of vertex v and returns
    /// their first control indices, or `None` for a vertex that is kept where it is.
    pub(crate) fn from_tensor_rows(
        vertices: usize,
        size: [usize; 3],
        lengths: [usize; 3],
        row: impl Fn(usize, &mut [f64]) -> Option<[usize; 3]> + Sync,
    ) -> Self {
        let stride = lengths.iter().sum::<usize>();
        let mut rows = vec![0.0; vertices * stride];
        let mut starts: Vec<Option<[u16; 3]>> = vec![None; vertices];
        parallel::for_each_pair(&mut starts, &mut rows, stride, |v, start, values| {
            *start = row(v, values).map(|s| s.map(|i| i as u16)); // sizes are at most bspline::MAX_SIZE
        });
        let kept = starts.iter().filter(|s| s.is_none()).count();
        let starts = starts.into_iter().map(Option::unwrap_or_default).collect();
        Self { size, lengths, starts, rows, kept }
    }

    /// The rows of `vertices` alone, in that order: the binding of fewer vertices to the same controls.
    ///
    /// # Panics
    ///
    /// Panics where a vertex is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn rows_of(&self, vertices: &[u32]) -> Self {
        let stride = self.lengths.iter().sum::<usize>();
        let row = |v: &u32| &self.rows[*v as usize * stride..(*v as usize + 1) * stride];
        let rows: Vec<f64> = vertices.iter().flat_map(row).copied().collect();
        let kept = rows.chunks_exact(stride).filter(|row| row.iter().all(|w| *w == 0.0)).count();
        let starts = vertices.iter().map(|v| self.starts[*v as usize]).collect();
        Self { size: self.size, lengths: self.lengths, starts, rows, kept }
    }

    /// Number of vertices: rows of W.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.starts.len()
    }

    /// Number of controls: columns of W.
    #[must_use]
    pub fn control_count(&self) -> usize {
        self.size.iter().product()
    }

    /// Vertices whose row is zero: they stay where they are whatever the controls do.
    #[must_use]
    pub fn kept_count(&self) -> usize {
        self.kept
    }

    /// Bytes of its arrays: what a product with W reads of W.
    #[must_use]
    pub fn memory(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.rows[..])
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
        self.product(c, out, |_, d| d);
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
        self.product(c, out, |v, d| moved(points[v], d));
    }

    /// `W c` for one number per control (#controls), as where all controls move along one direction.
    ///
    /// # Panics
    ///
    /// Panics where `c` does not have one entry per control.
    #[must_use]
    pub fn apply_scalar(&self, c: &[f64]) -> Vec<f64> {
        let mut product = Vec::new();
        self.product(c, &mut product, |_, d| d);
        product
    }

    /// `Wᵀ g`: from one vector per vertex (#vertices × 3) to one per control (#controls × 3).
    ///
    /// # Panics
    ///
    /// Panics where `g` does not have one entry per vertex.
    #[must_use]
    pub fn adjoint(&self, g: &[DVec3]) -> Vec<DVec3> {
        self.transposed_product(g)
    }

    /// `Wᵀ g` for one number per vertex (#vertices).
    ///
    /// # Panics
    ///
    /// Panics where `g` does not have one entry per vertex.
    #[must_use]
    pub fn adjoint_scalar(&self, g: &[f64]) -> Vec<f64> {
        self.transposed_product(g)
    }

    /// Row v of W: the controls that vertex v depends on, with their weights. Empty for a kept vertex.
    ///
    /// # Panics
    ///
    /// Panics where `v` is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn weights(&self, v: usize) -> Vec<(usize, f64)> {
        let mut weights = Vec::with_capacity(self.lengths.iter().product());
        self.for_each_line(v, |first, w, along_w| {
            weights.extend(along_w.iter().enumerate().map(|(c, x)| (first + c, w * x)));
        });
        weights.retain(|(_, w)| *w != 0.0);
        weights
    }

    /// Entries that [`Binding::gram`] goes through; `None` where there are too many to count.
    pub(crate) fn gram_len(&self) -> Option<usize> {
        self.reaches().into_iter().try_fold(self.control_count(), usize::checked_mul)
    }

    /// Controls that share a vertex with one, itself included, at most, along u, v, w.
    fn reaches(&self) -> [usize; 3] {
        self.lengths.map(|l| 2 * l - 1)
    }

    /// The entries (i, j, value), i ≤ j, of `Wᵀ W` (#controls × #controls) that can differ from 0, in no particular order, none twice.
    pub(crate) fn gram(&self) -> Vec<(usize, usize, f64)> {
        let [wide, deep, high] = self.reaches();
        let reach = self.lengths.map(|l| l - 1);
        // For each control its products with those around it, by difference of indices.
        let mut products = vec![0.0; self.control_count() * wide * deep * high];
        for v in 0..self.vertex_count() {
            let weights = self.weights(v);
            for &(i, x) in &weights {
                let a = self.node(i);
                for &(j, y) in weights.iter().filter(|(j, _)| i <= *j) {
                    let b = self.node(j);
                    let [u, v, w] = [0, 1, 2].map(|k| b[k] + reach[k] - a[k]);
                    products[((i * wide + u) * deep + v) * high + w] += x * y;
                }
            }
        }
        let around = wide * deep * high;
        let entry = |(slot, value): (usize, f64)| {
            let (i, difference) = (slot / around, slot % around);
            let d = [difference / (deep * high), difference / high % deep, difference % high];
            let a = self.node(i);
            let b = [0, 1, 2].map(|k| a[k] + d[k] - reach[k]);
            (i, (b[0] * self.size[1] + b[1]) * self.size[2] + b[2], value)
        };
        products.into_iter().enumerate().filter(|(_, value)| *value != 0.0).map(entry).collect()
    }

    fn node(&self, control: usize) -> [usize; 3] {
        let [_, nv, nw] = self.size;
        [control / (nv * nw), control / nw % nv, control % nw]
    }

    /// `Wᵀ g` of some vertices alone: `g(v)` for each of `vertices`, in their order.
    pub(crate) fn adjoint_among<T>(&self, vertices: &[u32], g: impl Fn(usize) -> T) -> Vec<T>
    where
        T: Copy + Default + AddAssign + Mul<f64, Output = T>,
    {
        let mut sum = vec![T::default(); self.control_count()];
        for v in vertices.iter().map(|v| *v as usize) {
            let of_vertex = g(v);
            self.for_each_line(v, |first, w, along_w| {
                let term = of_vertex * w;
                for (x, s) in along_w.iter().zip(&mut sum[first..first + along_w.len()]) {
                    *s += term * *x;
                }
            });
        }
        sum
    }

    /// Calls `f(first control, weight, univariate row along w)` for each line of controls along w that vertex v touches.
    #[inline]
    fn for_each_line(&self, v: usize, mut f: impl FnMut(usize, f64, &[f64])) {
        let [lu, lv, lw] = self.lengths;
        let [i, j, k] = self.starts[v].map(usize::from);
        let stride = lu + lv + lw;
        let rows = &self.rows[v * stride..(v + 1) * stride];
        let (along_u, rest) = rows.split_at(lu);
        let (along_v, along_w) = rest.split_at(lv);
        for (a, wu) in along_u.iter().enumerate() {
            for (b, wv) in along_v.iter().enumerate() {
                f(((i + a) * self.size[1] + j + b) * self.size[2] + k, wu * wv, along_w);
            }
        }
    }

    /// The vertices in ascending order of the first control they depend on, so that those that follow the same controls come one
    /// after the other. Vertices of the same cell keep their order; kept vertices come with the first cell.
    ///
    /// A model in this order ([`Binding::permuted`], [`crate::Solid::permuted`]) is deformed and corrected faster.
    #[must_use]
    pub fn cell_order(&self) -> Vec<u32> {
        let [_, nv, nw] = self.size;
        let first = |v: usize| {
            let [i, j, k] = self.starts[v].map(usize::from);
            ((i * nv + j) * nw + k) as u32 // at most lattice::MAX_CONTROLS
        };
        order::ascending(&parallel::collect(self.vertex_count(), first), self.control_count())
    }

    /// This binding with its vertices in another order: vertex i of the result is vertex `order[i]` of this one.
    ///
    /// # Panics
    ///
    /// Panics where an entry of `order` is not less than [`Binding::vertex_count`].
    #[must_use]
    pub fn permuted(&self, order: &[u32]) -> Self {
        let stride = self.lengths.iter().sum::<usize>();
        let mut starts = vec![[0; 3]; order.len()];
        let mut rows = vec![0.0; order.len() * stride];
        parallel::for_each_pair(&mut starts, &mut rows, stride, |i, start, row| {
            let v = order[i] as usize;
            *start = self.starts[v];
            row.copy_from_slice(&self.rows[v * stride..(v + 1) * stride]);
        });
        Self { size: self.size, lengths: self.lengths, starts, rows, kept: self.kept }
    }

    fn is_cubic(&self) -> bool {
        self.lengths == [4; 3]
    }

    /// `finish(v, (W c)_v)` for every vertex v.
    fn product<T: Entry<D>, const D: usize>(
        &self,
        c: &[T],
        out: &mut Vec<T>,
        finish: impl Fn(usize, T) -> T + Sync + Send,
    ) {
        assert_eq!(c.len(), self.control_count(), "one entry for each control");
        parallel::resize(out, self.vertex_count());
        if self.is_cubic() {
            let planes: [Vec<f64>; D] = std::array::from_fn(|x| c.iter().map(|c| c.coordinates()[x]).collect());
            let level = Level::new();
            parallel::for_each_chunk(out, parallel::CHUNK, |first, out| {
                dispatch!(level, simd => self.cubic_product(simd, &planes, first, out, &finish));
            });
            return;
        }
        parallel::for_each_chunk(out, parallel::CHUNK, |first, out| {
            for (v, out) in (first..).zip(out) {
                let mut sum = T::default();
                self.for_each_line(v, |first, w, along_w| {
                    let mut line = T::default();
                    for (x, c) in along_w.iter().zip(&c[first..first + along_w.len()]) {
                        line += *c * *x;
                    }
                    sum += line * w;
                });
                *out = finish(v, sum);
            }
        });
    }

    #[inline(always)]
    fn cubic_product<S: Simd, T: Entry<D>, const D: usize>(
        &self,
        simd: S,
        planes: &[Vec<f64>; D],
        first: usize,
        out: &mut [T],
        finish: impl Fn(usize, T) -> T,
    ) {
        let vertices = first..first + out.len();
        let (rows, _) = self.rows[CUBIC * vertices.start..CUBIC * vertices.end].as_chunks::<CUBIC>();
        let mut v = 0;
        for run in self.starts[vertices].chunk_by(|a, b| a == b) {
            let block = self.block(simd, planes, run[0]);
            let end = v + run.len();
            for (row, out) in rows[v..end].iter().zip(&mut out[v..end]) {
                let (along_u, vw) = cubic_weights(simd, row);
                let mut sums = [0.0; D];
                for x in 0..D {
                    let (mut low, mut high) = (block[0][x] * along_u[0], block[1][x] * along_u[0]);
                    for a in 1..4 {
                        low = block[2 * a][x].mul_add(along_u[a], low);
                        high = block[2 * a + 1][x].mul_add(along_u[a], high);
                    }
                    let (low, high) = low.mul_add(vw[0], high * vw[1]).split();
                    let (low, high) = (low + high).split();
                    let sum = low + high;
                    sums[x] = sum[0] + sum[1];
                }
                *out = finish(first + v, T::of(sums));
                v += 1;
            }
        }
    }

    /// The places of the lines (a, 2h, ·) and (a, 2h + 1, ·) of the block that starts at `start`.
    #[inline(always)]
    fn line_pair(&self, start: [u16; 3], pair: usize) -> [usize; 2] {
        let [i, j, k] = start.map(usize::from);
        let first = ((i + pair / 2) * self.size[1] + j + 2 * (pair % 2)) * self.size[2] + k;
        [first, first + self.size[2]]
    }

    #[inline(always)]
    fn block<S: Simd, const D: usize>(&self, simd: S, planes: &[Vec<f64>; D], start: [u16; 3]) -> Block<S, D> {
        let mut block = [[f64x8::splat(simd, 0.0); D]; 8];
        for (pair, block) in block.iter_mut().enumerate() {
            let [even, odd] = self.line_pair(start, pair);
            for (plane, pair) in planes.iter().zip(block) {
                let [even, odd] = [&plane[even..even + 4], &plane[odd..odd + 4]];
                *pair = f64x4::from_slice(simd, even).combine(f64x4::from_slice(simd, odd));
            }
        }
        block
    }

    fn transposed_product<T: Entry<D>, const D: usize>(&self, g: &[T]) -> Vec<T> {
        assert_eq!(g.len(), self.vertex_count(), "one entry for each vertex");
        let controls = self.control_count();
        // Partial sums over fixed parts of the vertices, each part at least as long as the sums themselves.
        let part = parallel::CHUNK.max(g.len().div_ceil(PARTS)).max(controls);
        let sums = parallel::map_chunks(g.len(), part, |range| self.part_of_transposed(range.clone(), &g[range]));
        self.sum_of_parts(sums)
    }

    /// What some vertices, with their `g`, add to `Wᵀ g` (#controls).
    fn part_of_transposed<T: Entry<D>, const D: usize>(&self, vertices: Range<usize>, g: &[T]) -> Vec<T> {
        if self.is_cubic() {
            return dispatch!(Level::new(), simd => self.cubic_transposed_product(simd, vertices, g));
        }
        let mut sum = vec![T::default(); self.control_count()];
        for (v, g) in vertices.zip(g) {
            self.for_each_line(v, |first, w, along_w| {
                let term = *g * w;
                for (x, s) in along_w.iter().zip(&mut sum[first..first + along_w.len()]) {
                    *s += term * *x;
                }
            });
        }
        sum
    }

    /// [`Binding::adjoint`] of some vertices alone, with their `g`: a part of the whole (#controls × 3).
    pub(crate) fn part_of_adjoint(&self, vertices: Range<usize>, g: &[DVec3]) -> Vec<DVec3> {
        self.part_of_transposed(vertices, g)
    }

    /// The whole of parts.
    pub(crate) fn sum_of_parts<T: Copy + Default + AddAssign>(&self, parts: Vec<Vec<T>>) -> Vec<T> {
        let mut total = vec![T::default(); self.control_count()];
        for part in parts {
            for (t, s) in total.iter_mut().zip(part) {
                *t += s;
            }
        }
        total
    }

    #[inline(always)]
    fn cubic_transposed_product<S: Simd, T: Entry<D>, const D: usize>(
        &self,
        simd: S,
        vertices: Range<usize>,
        g: &[T],
    ) -> Vec<T> {
        let mut planes: [Vec<f64>; D] = std::array::from_fn(|_| vec![0.0; self.control_count()]);
        let (rows, _) = self.rows[CUBIC * vertices.start..CUBIC * vertices.end].as_chunks::<CUBIC>();
        let mut v = 0;
        for run in self.starts[vertices].chunk_by(|a, b| a == b) {
            let end = v + run.len();
            let mut block: Block<S, D> = [[f64x8::splat(simd, 0.0); D]; 8];
            // Four vertices at a time: the block is read and written once for all of them.
            let (row_groups, last_rows) = rows[v..end].as_chunks::<4>();
            let (groups, last) = g[v..end].as_chunks::<4>();
            for (rows, g) in row_groups.iter().zip(groups) {
                add_outer_products(simd, &mut block, rows, g);
            }
            for (row, g) in last_rows.iter().zip(last) {
                add_outer_products(simd, &mut block, &[*row], &[*g]);
            }
            for (pair, sums) in block.iter().enumerate() {
                for (plane, sum) in planes.iter_mut().zip(sums) {
                    let (even, odd) = sum.split();
                    for (first, half) in self.line_pair(run[0], pair).into_iter().zip([even, odd]) {
                        let line = &mut plane[first..first + 4];
                        (f64x4::from_slice(simd, line) + half).store_slice(line);
                    }
                }
            }
            v = end;
        }
        (0..self.control_count()).map(|c| T::of(std::array::from_fn(|x| planes[x][c]))).collect()
    }
}

/// The row along u, and the outer product of the rows along v and w: (2h, ·) and (2h + 1, ·) for h = 0, 1.
#[inline(always)]
fn cubic_weights<S: Simd>(simd: S, row: &[f64; CUBIC]) -> ([f64x8<S>; 4], [f64x8<S>; 2]) {
    let mut along_u = [f64x8::splat(simd, row[0]); 4];
    for a in 1..4 {
        along_u[a] = f64x8::splat(simd, row[a]);
    }
    let along_w = f64x4::from_slice(simd, &row[8..12]);
    let [low, high] = [along_w * row[4], along_w * row[6]];
    (along_u, [low.combine(along_w * row[5]), high.combine(along_w * row[7])])
}

/// Adds `row ⊗ g` of N vertices to a block, one after the other.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "x is an index of the block and of every g")]
fn add_outer_products<S: Simd, T: Entry<D>, const D: usize, const N: usize>(
    simd: S,
    block: &mut Block<S, D>,
    rows: &[[f64; CUBIC]; N],
    g: &[T; N],
) {
    let mut weights = [cubic_weights(simd, &rows[0]); N];
    for n in 1..N {
        weights[n] = cubic_weights(simd, &rows[n]);
    }
    for x in 0..D {
        for h in 0..2 {
            let mut terms = [weights[0].1[h] * g[0].coordinates()[x]; N];
            for n in 1..N {
                terms[n] = weights[n].1[h] * g[n].coordinates()[x];
            }
            for a in 0..4 {
                let mut sum = block[2 * a + h][x];
                for n in 0..N {
                    sum = terms[n].mul_add(weights[n].0[a], sum);
                }
                block[2 * a + h][x] = sum;
            }
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Basis, Frame, Lattice, Outside};

    #[test]
    fn products_are_the_same_to_rounding_on_processors_of_every_level() {
        let points = crate::shapes::icosphere(3).points().to_vec();
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| 2.5 * a);
        let lattice =
            Lattice::new([0; 3].map(|_| Basis::uniform(6, 3).unwrap()), Frame { origin: DVec3::splat(-1.25), axes });
        let binding = lattice.unwrap().bind(&points, Outside::Refuse).unwrap();
        let c: Vec<DVec3> = (0..216).map(|i| DVec3::new(1.0, 2.0, 3.0) * f64::from(i % 7)).collect();
        let planes = [0, 1, 2].map(|x| c.iter().map(|c| c[x]).collect());
        let (apply, adjoint) = (binding.apply(&c), binding.adjoint(&points));
        let mut found = vec![DVec3::ZERO; points.len()];
        let level = Level::baseline();
        dispatch!(level, simd => binding.cubic_product(simd, &planes, 0, &mut found, |_, d: DVec3| d));
        assert!(found.iter().zip(&apply).all(|(a, b)| (*a - *b).length() <= 1e-14));
        let found = dispatch!(level, simd => binding.cubic_transposed_product(simd, 0..points.len(), &points));
        assert!(found.iter().zip(&adjoint).all(|(a, b)| (*a - *b).length() <= 1e-13));
    }
}
