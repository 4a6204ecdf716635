//! Rows of weights that are stored in full, as those of cages.
//!
//! Row after row, each filled up with zeros to a multiple of four: what a product takes of W is read once, in order, and time is that of a
//! sweep over memory. Four rows at a time share what they need of the controls, or of the sums over the vertices.

use std::ops::Range;
use std::sync::Arc;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4};

use crate::binding::Entry;
use crate::parallel;
use crate::tensor::times_plus_four;

/// W (#vertices × #controls), every weight of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stored {
    columns: usize,
    /// Numbers from one row to the next.
    stride: usize,
    /// Rows (#vertices × stride).
    weights: Arc<Vec<f64>>,
    kept: usize,
    is_portable: bool,
}

/// Weights that are taken at a time, and rows.
const LANES: usize = 4;

/// Numbers in a part of the weights that one thread takes: about half of what a core has of fast memory.
const PART: usize = 1 << 16;

impl Stored {
    /// Rows that `fill(vertex, row)` writes (#controls); they are zero at first. Vertices whose row stays zero are kept.
    pub(crate) fn filled(vertices: usize, columns: usize, fill: impl Fn(usize, &mut [f64]) + Send + Sync) -> Self {
        Self::filled_by_parts(vertices, columns, |first, stride, rows| {
            rows.chunks_exact_mut(stride).enumerate().for_each(|(i, row)| fill(first + i, &mut row[..columns]));
        })
    }

    /// The same with rows of several vertices at a time: `fill(first vertex, stride, rows)`, of which each row's first #controls numbers are
    /// to be written.
    pub(crate) fn filled_by_parts(
        vertices: usize,
        columns: usize,
        fill: impl Fn(usize, usize, &mut [f64]) + Send + Sync,
    ) -> Self {
        let stride = columns.next_multiple_of(LANES);
        let mut weights = vec![0.0; vertices * stride];
        let kept = parallel::map_parts(&mut weights, Self::rows_in_part(stride) * stride, |first, rows| {
            fill(first / stride, stride, rows);
            rows.chunks_exact(stride).filter(|row| row.iter().all(|w| *w == 0.0)).count()
        });
        Self { columns, stride, weights: Arc::new(weights), kept: kept.iter().sum(), is_portable: false }
    }

    /// Rows that one thread takes at a time, a multiple of [`LANES`].
    fn rows_in_part(stride: usize) -> usize {
        (PART / stride).next_multiple_of(LANES).max(LANES)
    }

    /// The rows of `vertices` alone, in that order.
    pub(crate) fn rows_of(&self, vertices: &[u32]) -> Self {
        if vertices.len() == self.vertex_count() && vertices.iter().zip(0..).all(|(v, i)| *v == i) {
            return self.clone(); // which shares the weights
        }
        let rows =
            Self::filled(vertices.len(), self.columns, |i, row| row.copy_from_slice(self.row(vertices[i] as usize)));
        Self { is_portable: self.is_portable, ..rows }
    }

    /// The same without fused multiply-adds.
    pub(crate) fn portable(self) -> Self {
        Self { is_portable: true, ..self }
    }

    pub(crate) fn is_portable(&self) -> bool {
        self.is_portable
    }

    pub(crate) fn vertex_count(&self) -> usize {
        self.weights.len() / self.stride
    }

    pub(crate) fn control_count(&self) -> usize {
        self.columns
    }

    /// Vertices whose row is zero.
    pub(crate) fn kept_count(&self) -> usize {
        self.kept
    }

    /// Bytes of the weights.
    pub(crate) fn memory(&self) -> usize {
        size_of_val(&self.weights[..])
    }

    /// Row v (#controls).
    pub(crate) fn row(&self, v: usize) -> &[f64] {
        &self.weights[v * self.stride..][..self.columns]
    }

    /// Row v: the controls with their weights, none of them 0.
    pub(crate) fn weights(&self, v: usize) -> Vec<(usize, f64)> {
        self.row(v).iter().copied().enumerate().filter(|(_, w)| *w != 0.0).collect()
    }

    pub(crate) fn size(&self) -> [usize; 3] {
        [1, 1, self.columns]
    }

    /// All controls.
    pub(crate) fn reach_of(&self, _: usize) -> ([usize; 3], [usize; 3]) {
        ([0; 3], self.size())
    }

    /// Entries of [`Stored::gram`].
    pub(crate) fn gram_len(&self) -> Option<usize> {
        self.columns.checked_mul(self.columns)
    }

    /// The entries (i, j, value), i ≤ j, of `Wᵀ W`.
    pub(crate) fn gram(&self) -> Vec<(usize, usize, f64)> {
        let columns = self.columns;
        let part = parallel::CHUNK.max(self.vertex_count().div_ceil(parallel::PARTS));
        let parts = parallel::map_chunks(self.vertex_count(), part, |vertices| {
            let mut sums = vec![0.0; columns * columns];
            for row in vertices.map(|v| self.row(v)) {
                for (i, w) in row.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                    let sums = &mut sums[i * columns + i..(i + 1) * columns];
                    sums.iter_mut().zip(&row[i..]).for_each(|(sum, other)| *sum += w * other);
                }
            }
            sums
        });
        let value = |i: usize, j: usize| parts.iter().map(|sums| sums[i * columns + j]).sum::<f64>();
        let pairs = (0..columns).flat_map(|i| (i..columns).map(move |j| (i, j)));
        pairs.map(|(i, j)| (i, j, value(i, j))).filter(|(_, _, value)| *value != 0.0).collect()
    }

    /// `Wᵀ g` of some vertices alone, with their `g(v)`, in their order.
    pub(crate) fn sum_of_rows<T: Entry<D>, const D: usize>(
        &self,
        vertices: impl IntoIterator<Item = usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        let mut sum = vec![T::default(); self.columns];
        for v in vertices {
            let of_vertex = g(v);
            sum.iter_mut().zip(self.row(v)).for_each(|(sum, w)| *sum += of_vertex * *w);
        }
        sum
    }

    /// `finish(v, (W c)_v, out_v)` for every vertex v, to `out`, which has an entry for each.
    pub(crate) fn product<T: Entry<D>, U: Copy + Send, const D: usize>(
        &self,
        c: &[T],
        out: &mut [U],
        finish: impl Fn(usize, T, U) -> U + Sync + Send,
    ) {
        let mut planes: [Vec<f64>; D] = std::array::from_fn(|_| vec![0.0; self.stride]);
        for (i, c) in c.iter().enumerate() {
            planes.iter_mut().zip(c.coordinates()).for_each(|(plane, x)| plane[i] = x);
        }
        let level = Level::new();
        parallel::for_each_chunk(out, Self::rows_in_part(self.stride), |first, out| {
            dispatch!(level, simd => match self.is_portable {
                false => self.part_of_product::<_, T, U, D, true>(simd, &planes, first, out, &finish),
                true => self.part_of_product::<_, T, U, D, false>(simd, &planes, first, out, &finish),
            });
        });
    }

    /// That of the vertices from the first on.
    #[inline(always)]
    fn part_of_product<S: Simd, T: Entry<D>, U: Copy, const D: usize, const FUSED: bool>(
        &self,
        simd: S,
        planes: &[Vec<f64>; D],
        first: usize,
        out: &mut [U],
        finish: impl Fn(usize, T, U) -> U,
    ) {
        let rows = &self.weights[first * self.stride..][..out.len() * self.stride];
        for (k, (rows, out)) in rows.chunks(LANES * self.stride).zip(out.chunks_mut(LANES)).enumerate() {
            // Where less than four rows are left, the last one stands in for those that are not there.
            let row = |i: usize| &rows[i.min(out.len() - 1) * self.stride..][..self.stride];
            let rows = [row(0), row(1), row(2), row(3)];
            let mut sums = [[f64x4::splat(simd, 0.0); LANES]; D];
            for at in (0..self.stride).step_by(LANES) {
                let weights = rows.map(|row| f64x4::from_slice(simd, &row[at..at + LANES]));
                for (plane, sums) in planes.iter().zip(&mut sums) {
                    let c = f64x4::from_slice(simd, &plane[at..at + LANES]);
                    for (sum, w) in sums.iter_mut().zip(&weights) {
                        *sum = times_plus_four::<S, FUSED>(*w, c, *sum);
                    }
                }
            }
            for (i, out) in out.iter_mut().enumerate() {
                let whole = |sum: f64x4<S>| {
                    let [a, b, c, d]: [f64; LANES] = sum.into();
                    (a + b) + (c + d)
                };
                let coordinates = std::array::from_fn(|x| whole(sums[x][i]));
                *out = finish(first + LANES * k + i, T::of(coordinates), *out);
            }
        }
    }

    /// What some vertices, with their `g(v)`, add to `Wᵀ g` (#controls).
    pub(crate) fn part_of_transposed<T: Entry<D>, const D: usize>(
        &self,
        vertices: Range<usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        dispatch!(Level::new(), simd => match self.is_portable {
            false => self.transposed_product::<_, T, D, true>(simd, vertices, &g),
            true => self.transposed_product::<_, T, D, false>(simd, vertices, &g),
        })
    }

    #[inline(always)]
    fn transposed_product<S: Simd, T: Entry<D>, const D: usize, const FUSED: bool>(
        &self,
        simd: S,
        vertices: Range<usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        let mut planes: [Vec<f64>; D] = std::array::from_fn(|_| vec![0.0; self.stride]);
        let zeros = vec![0.0; self.stride];
        for first in vertices.clone().step_by(LANES) {
            let is_there = |i: usize| first + i < vertices.end;
            let row =
                |i: usize| if is_there(i) { &self.weights[(first + i) * self.stride..][..self.stride] } else { &zeros };
            let rows = [row(0), row(1), row(2), row(3)];
            let g: [[f64; D]; LANES] =
                std::array::from_fn(|i| if is_there(i) { g(first + i).coordinates() } else { [0.0; D] });
            let g: [[f64x4<S>; LANES]; D] = std::array::from_fn(|x| g.map(|g| f64x4::splat(simd, g[x])));
            for at in (0..self.stride).step_by(LANES) {
                let weights = rows.map(|row| f64x4::from_slice(simd, &row[at..at + LANES]));
                for (plane, g) in planes.iter_mut().zip(&g) {
                    let place = &mut plane[at..at + LANES];
                    let mut sum = f64x4::from_slice(simd, place);
                    for (w, g) in weights.iter().zip(g) {
                        sum = times_plus_four::<S, FUSED>(*w, *g, sum);
                    }
                    sum.store_slice(place);
                }
            }
        }
        (0..self.columns).map(|c| T::of(std::array::from_fn(|x| planes[x][c]))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Binding;
    use glam::DVec3;
    use proptest::prelude::*;

    fn matrix() -> impl Strategy<Value = (usize, usize, Vec<f64>)> {
        (1_usize..20, 1_usize..30).prop_flat_map(|(n, m)| (Just(n), Just(m), prop::collection::vec(-1.0..1.0, n * m)))
    }

    fn vectors(count: usize) -> Vec<DVec3> {
        (0..count).map(|i| DVec3::new(i as f64 * 0.7 - 1.0, 1.0 / (i + 1) as f64, (i % 5) as f64)).collect()
    }

    proptest! {
        #[test]
        fn products_are_those_of_the_matrix((n, m, weights) in matrix()) {
            let binding = Binding::of_weights(m, &weights);
            let (c, g) = (vectors(m), vectors(n));
            let row = |v: usize| &weights[v * m..(v + 1) * m];
            for (v, moved) in binding.apply(&c).iter().enumerate() {
                let expected: DVec3 = row(v).iter().zip(&c).map(|(w, c)| *c * *w).sum();
                prop_assert!((*moved - expected).length() <= 1e-12);
            }
            let scalar: Vec<f64> = c.iter().map(|c| c.x).collect();
            prop_assert!(binding.apply_scalar(&scalar).iter().zip(binding.apply(&c)).all(|(a, b)| (a - b.x).abs() <= 1e-13));
            for (i, of_control) in binding.adjoint(&g).iter().enumerate() {
                let expected: DVec3 = (0..n).map(|v| g[v] * row(v)[i]).sum();
                prop_assert!((*of_control - expected).length() <= 1e-12);
            }
            let among = binding.adjoint_among(&[0, n as u32 - 1], |v| g[v]);
            for (i, of_control) in among.iter().enumerate() {
                let expected = g[0] * row(0)[i] + g[n - 1] * row(n - 1)[i];
                prop_assert!((*of_control - expected).length() <= 1e-12);
            }
            for (i, j, value) in binding.gram() {
                let expected: f64 = (0..n).map(|v| row(v)[i] * row(v)[j]).sum();
                prop_assert!((value - expected).abs() <= 1e-12 && i <= j);
            }
            let turned: Vec<u32> = (0..n as u32).rev().collect();
            prop_assert_eq!(binding.rows_of(&turned).weights(0), binding.weights(n - 1));
        }
    }

    #[test]
    fn portable_products_are_the_same_on_processors_of_every_level() {
        let weights: Vec<f64> = (0..37 * 11).map(|i| f64::from(i * 7919 % 101) / 101.0 - 0.4).collect();
        let rows = Stored::filled(37, 11, |v, row| row.copy_from_slice(&weights[v * 11..(v + 1) * 11])).portable();
        let (c, g) = (vectors(11), vectors(37));
        let planes = [0, 1, 2].map(|x| c.iter().map(|c| c[x]).chain([0.0]).collect::<Vec<f64>>());
        let mut at_baseline = vec![DVec3::ZERO; 37];
        dispatch!(Level::baseline(), simd =>
            rows.part_of_product::<_, DVec3, _, 3, false>(simd, &planes, 0, &mut at_baseline, |_, d, _| d));
        let mut product = vec![DVec3::ZERO; 37];
        rows.product(&c, &mut product, |_, d: DVec3, _| d);
        assert_eq!(product, at_baseline);
        let transposed = dispatch!(Level::baseline(), simd =>
            rows.transposed_product::<_, DVec3, 3, false>(simd, 0..37, |v| g[v]));
        assert_eq!(rows.part_of_transposed(0..37, |v| g[v]), transposed);
    }

    #[test]
    fn rows_of_zeros_are_kept() {
        let rows = Stored::filled(5, 3, |v, row| row.fill(f64::from(v as u32 % 2)));
        assert_eq!((rows.kept_count(), rows.vertex_count(), rows.control_count()), (3, 5, 3));
        assert!(rows.weights(0).is_empty());
    }
}
