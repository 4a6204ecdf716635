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
//! Bits do not depend on the number of threads.

use std::ops::{AddAssign, Mul};

use glam::DVec3;

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

    /// `W c`: from one vector per control (#controls × 3) to one per vertex (#vertices × 3).
    ///
    /// # Panics
    ///
    /// Panics where `c` does not have one entry per control.
    #[must_use]
    pub fn apply(&self, c: &[DVec3]) -> Vec<DVec3> {
        self.product(c)
    }

    /// `W c` for one number per control (#controls), as where all controls move along one direction.
    ///
    /// # Panics
    ///
    /// Panics where `c` does not have one entry per control.
    #[must_use]
    pub fn apply_scalar(&self, c: &[f64]) -> Vec<f64> {
        self.product(c)
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

    fn product<T>(&self, c: &[T]) -> Vec<T>
    where
        T: Copy + Default + AddAssign + Mul<f64, Output = T> + Send + Sync,
    {
        assert_eq!(c.len(), self.control_count(), "one entry for each control");
        parallel::collect(self.vertex_count(), |v| {
            let mut sum = T::default();
            self.for_each_line(v, |first, w, along_w| {
                let mut line = T::default();
                for (x, c) in along_w.iter().zip(&c[first..first + along_w.len()]) {
                    line += *c * *x;
                }
                sum += line * w;
            });
            sum
        })
    }

    fn transposed_product<T>(&self, g: &[T]) -> Vec<T>
    where
        T: Copy + Default + AddAssign + Mul<f64, Output = T> + Send + Sync,
    {
        assert_eq!(g.len(), self.vertex_count(), "one entry for each vertex");
        let controls = self.control_count();
        // Partial sums over fixed parts of the vertices, each part at least as long as the sums themselves.
        let part = parallel::CHUNK.max(g.len().div_ceil(PARTS)).max(controls);
        let sums = parallel::map_chunks(g.len(), part, |range| {
            let mut sum = vec![T::default(); controls];
            for v in range {
                self.for_each_line(v, |first, w, along_w| {
                    let term = g[v] * w;
                    for (x, s) in along_w.iter().zip(&mut sum[first..first + along_w.len()]) {
                        *s += term * *x;
                    }
                });
            }
            sum
        });
        let mut total = vec![T::default(); controls];
        for sum in sums {
            for (t, s) in total.iter_mut().zip(sum) {
                *t += s;
            }
        }
        total
    }
}

/// `points + displacement` (both #vertices × 3). Where nothing moves the point keeps its bits, the sign of a zero included.
#[must_use]
pub fn displaced(points: &[DVec3], displacement: &[DVec3]) -> Vec<DVec3> {
    points.iter().zip(displacement).map(|(p, d)| moved(*p, *d)).collect()
}

/// `points + by`, in the same way.
pub(crate) fn translated(points: &[DVec3], by: DVec3) -> Vec<DVec3> {
    points.iter().map(|p| moved(*p, by)).collect()
}

fn moved(p: DVec3, d: DVec3) -> DVec3 {
    DVec3::select(d.cmpeq(DVec3::ZERO), p, p + d)
}
