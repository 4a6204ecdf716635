//! Rows that are products of three short univariate ones, as those of lattices.
//!
//! What is stored is where a vertex lies in its cell, three numbers; the univariate rows and their products are made on the fly
//! ([`crate::pieces`]): for a cubic lattice instead of 64 weights. Sweeps over vertices are limited by memory.
//!
//! Vertices that follow one another in the same cell are a *run*. Cubic rows have a fast path: the 4 × 4 × 4 controls of a run are
//! brought together once, and eight vertices are taken at a time; where runs are short, vertices are sorted by cells first, some
//! thousands at a time. [`Tensor::cell_order`] is the order with the longest runs.

use std::ops::Range;
use std::sync::Arc;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4, f64x8};
use glam::DVec3;

use crate::binding::Entry;
use crate::bspline::Basis;
use crate::order;
use crate::parallel;
use crate::pieces::Pieces;

/// W (#vertices × #controls).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tensor {
    /// Control points along u, v, w. Flat control index: `(i · size[1] + j) · size[2] + k`.
    size: [usize; 3],
    /// The bases along u, v, w.
    pieces: Arc<[Pieces; 3]>,
    /// The pieces along u, v, w in which each vertex lies; [`KEPT`] for one that is kept where it is.
    cells: Vec<[u16; 3]>,
    /// Where in them, along u, v, w (#vertices each).
    local: [Vec<f64>; 3],
    kept: usize,
    /// Where each run ends, where the cells are in ascending order.
    ends: Option<Vec<u32>>,
    is_portable: bool,
}

/// No cell.
const KEPT: [u16; 3] = [u16::MAX; 3];

/// Vertices that are taken at a time.
const LANES: usize = 8;

/// The controls of a run with cubic rows, D coordinates of each: `controls[x][4a + b][c]` is coordinate x of control (a, b, c).
type Controls<const D: usize> = [[[f64; 4]; 16]; D];

/// Four numbers of eight vertices.
type Four<S> = [f64x8<S>; 4];

/// A cell with cubic rows.
struct Cell<'a> {
    /// First control along u, v, w.
    start: [usize; 3],
    /// Its polynomials along u, v, w, and whether they are tangents ([`Pieces`]).
    coefficients: [&'a [[f64; 4]]; 3],
    is_tangent: [bool; 3],
}

impl Cell<'_> {
    /// The Bernstein polynomials of eight vertices from the i-th on along u, v, w; of tangents 1, t, 0, 0.
    #[inline(always)]
    fn polynomials<S: Simd>(&self, simd: S, places: &Places, i: usize) -> [Four<S>; 3] {
        let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
        let mut polynomials = [[zero; 4]; 3];
        for (axis, polynomials) in polynomials.iter_mut().enumerate() {
            let t = places.eight(simd, axis, i);
            *polynomials = if self.is_tangent[axis] {
                [one, t, zero, zero]
            } else {
                let s = one - t;
                let (ss, tt) = (s * s, t * t);
                [ss * s, ss * t * 3.0, tt * s * 3.0, tt * t]
            };
        }
        polynomials
    }
}

/// Where some vertices lie.
#[derive(Clone, Copy)]
struct Places<'a> {
    cells: &'a [[u16; 3]],
    local: [&'a [f64]; 3],
    /// Which vertex the first of them is, and where runs end from the one on that it is in, if that is known.
    first: usize,
    ends: Option<&'a [u32]>,
}

/// The same in the order of cells.
struct Sorted {
    /// The vertex at each place.
    order: Vec<u32>,
    cells: Vec<[u16; 3]>,
    local: [Vec<f64>; 3],
}

impl Places<'_> {
    /// The runs one after the other: the cell of each, and where it ends among these vertices.
    #[inline(always)]
    fn runs(&self) -> impl Iterator<Item = ([u16; 3], usize)> {
        let (mut at, mut ends) = (0, self.ends.map(<[u32]>::iter));
        std::iter::from_fn(move || {
            let rest = self.cells.get(at..).filter(|rest| !rest.is_empty())?;
            at = match &mut ends {
                Some(ends) => self.cells.len().min(*ends.next()? as usize - self.first),
                None => at + rest.iter().take_while(|cell| **cell == rest[0]).count(),
            };
            Some((rest[0], at))
        })
    }

    /// Along an axis, eight vertices from the i-th on; what is beyond the last one is 0.
    #[inline(always)]
    fn eight<S: Simd>(&self, simd: S, axis: usize, i: usize) -> f64x8<S> {
        let local = self.local[axis];
        match local.get(i..i + LANES) {
            Some(eight) => f64x8::from_slice(simd, eight),
            None => {
                let mut padded = [0.0; LANES];
                padded[..local.len() - i].copy_from_slice(&local[i..]);
                f64x8::from_slice(simd, &padded)
            }
        }
    }
}

impl Sorted {
    fn places(&self) -> Places<'_> {
        Places { cells: &self.cells, local: self.local.each_ref().map(|of| &of[..]), first: 0, ends: None }
    }
}

impl Tensor {
    /// A binding to `size` controls with these bases. `parameters(v)` is where vertex v lies, or `None` where it is kept where it is.
    pub(crate) fn of_bases(
        vertices: usize,
        bases: &[Basis; 3],
        parameters: impl Fn(usize) -> Option<DVec3> + Sync + Send,
    ) -> Self {
        let pieces = bases.each_ref().map(Pieces::of);
        let mut cells = vec![KEPT; vertices];
        let mut local = [0; 3].map(|_| vec![0.0; vertices]);
        parallel::for_each_chunk_of_four(&mut cells, &mut local, |first, cells, [us, vs, ws]| {
            for (i, cell) in cells.iter_mut().enumerate() {
                if let Some(parameters) = parameters(first + i) {
                    let [(a, u), (b, v), (c, w)] = [0, 1, 2].map(|axis| pieces[axis].place(parameters[axis]));
                    *cell = [a, b, c];
                    (us[i], vs[i], ws[i]) = (u, v, w);
                }
            }
        });
        Self::placed(bases.each_ref().map(Basis::size), Arc::new(pieces), cells, local, false)
    }

    /// A binding of vertices that lie there.
    fn placed(
        size: [usize; 3],
        pieces: Arc<[Pieces; 3]>,
        cells: Vec<[u16; 3]>,
        local: [Vec<f64>; 3],
        is_portable: bool,
    ) -> Self {
        let kept = cells.iter().filter(|cell| **cell == KEPT).count();
        let ends = cells.is_sorted().then(|| {
            let mut end = 0;
            let ends = cells.chunk_by(|a, b| a == b).map(|run| {
                end += run.len() as u32;
                end
            });
            ends.collect()
        });
        Self { size, pieces, cells, local, kept, ends, is_portable }
    }

    /// The rows of `vertices` alone, in that order.
    pub(crate) fn rows_of(&self, vertices: &[u32]) -> Self {
        let cells = parallel::collect(vertices.len(), |i| self.cells[vertices[i] as usize]);
        let local = self.local.each_ref().map(|of| parallel::collect(vertices.len(), |i| of[vertices[i] as usize]));
        Self::placed(self.size, Arc::clone(&self.pieces), cells, local, self.is_portable)
    }

    /// The same without fused multiply-adds.
    pub(crate) fn portable(self) -> Self {
        Self { is_portable: true, ..self }
    }

    /// Whether products have the same bits on every processor.
    pub(crate) fn is_portable(&self) -> bool {
        self.is_portable
    }

    /// Number of vertices: rows of W.
    pub(crate) fn vertex_count(&self) -> usize {
        self.cells.len()
    }

    /// Number of controls: columns of W.
    pub(crate) fn control_count(&self) -> usize {
        self.size.iter().product()
    }

    /// Vertices whose row is zero.
    pub(crate) fn kept_count(&self) -> usize {
        self.kept
    }

    /// Bytes of its arrays.
    pub(crate) fn memory(&self) -> usize {
        let ends = self.ends.as_ref().map_or(0, |ends| size_of_val(&ends[..]));
        size_of_val(&self.cells[..]) + self.local.iter().map(|of| size_of_val(&of[..])).sum::<usize>() + ends
    }

    /// Row v: the controls that vertex v depends on, with their weights, none of them 0.
    pub(crate) fn weights(&self, v: usize) -> Vec<(usize, f64)> {
        let mut weights = Vec::with_capacity(self.lengths().iter().product());
        self.for_each_line(v, &mut Vec::new(), |first, w, along_w| {
            weights.extend(along_w.iter().enumerate().map(|(c, x)| (first + c, w * x)));
        });
        weights.retain(|(_, w)| *w != 0.0);
        weights
    }

    /// Control points along u, v, w.
    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The first control along u, v, w that vertex v follows, and how many there are; none for a kept vertex.
    pub(crate) fn reach_of(&self, v: usize) -> ([usize; 3], [usize; 3]) {
        match self.cells[v] {
            KEPT => ([0; 3], [0; 3]),
            cell => ([0, 1, 2].map(|axis| self.pieces[axis].start(cell[axis])), self.lengths()),
        }
    }

    /// Row v of W over [`Tensor::reach_of`], the last axis first; `scratch` may hold anything.
    pub(crate) fn fill_row(&self, v: usize, row: &mut [f64], scratch: &mut Vec<f64>) {
        let mut lines = row.chunks_mut(self.lengths()[2]);
        self.for_each_line(v, scratch, |_, w, along_w| {
            let line = lines.next().expect("a line for each of the row");
            line.iter_mut().zip(along_w).for_each(|(to, x)| *to = w * x);
        });
    }

    /// Entries that [`Tensor::gram`] goes through; `None` where there are too many to count.
    pub(crate) fn gram_len(&self) -> Option<usize> {
        self.reaches().into_iter().try_fold(self.control_count(), usize::checked_mul)
    }

    /// Controls that share a vertex with one, itself included, at most, along u, v, w.
    fn reaches(&self) -> [usize; 3] {
        self.lengths().map(|l| 2 * l - 1)
    }

    /// Numbers per univariate row: degree + 1 along u, v, w.
    fn lengths(&self) -> [usize; 3] {
        self.pieces.each_ref().map(Pieces::length)
    }

    /// The entries (i, j, value), i ≤ j, of `Wᵀ W` (#controls × #controls) that can differ from 0, in no particular order, none twice.
    pub(crate) fn gram(&self) -> Vec<(usize, usize, f64)> {
        let [wide, deep, high] = self.reaches();
        let reach = self.lengths().map(|l| l - 1);
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

    /// Calls `f(first control, weight, univariate row along w)` for each line of controls along w that vertex v touches. `scratch` may hold
    /// anything.
    #[inline]
    fn for_each_line(&self, v: usize, scratch: &mut Vec<f64>, mut f: impl FnMut(usize, f64, &[f64])) {
        let cell = self.cells[v];
        if cell == KEPT {
            return;
        }
        let [lu, lv, lw] = self.lengths();
        scratch.resize(lu + lv + lw + lu.max(lv).max(lw), 0.0);
        let (along_u, rest) = scratch.split_at_mut(lu);
        let (along_v, rest) = rest.split_at_mut(lv);
        let (along_w, rest) = rest.split_at_mut(lw);
        for (axis, row) in [&mut *along_u, &mut *along_v, &mut *along_w].into_iter().enumerate() {
            let length = row.len();
            self.pieces[axis].row(cell[axis], self.local[axis][v], row, &mut rest[..length]);
        }
        let [i, j, k] = [0, 1, 2].map(|axis| self.pieces[axis].start(cell[axis]));
        for (a, wu) in along_u.iter().enumerate() {
            for (b, wv) in along_v.iter().enumerate() {
                f(((i + a) * self.size[1] + j + b) * self.size[2] + k, wu * wv, along_w);
            }
        }
    }

    /// The vertices in ascending order of their cells. Vertices of the same cell keep their order; kept vertices come last.
    pub(crate) fn cell_order(&self) -> Vec<u32> {
        let [nu, nv, nw] = self.pieces.each_ref().map(Pieces::count);
        let last = nu * nv * nw;
        let number = |v: usize| match self.cells[v] {
            KEPT => last as u32, // little more than lattice::MAX_CONTROLS
            cell => {
                let [i, j, k] = cell.map(usize::from);
                ((i * nv + j) * nw + k) as u32
            }
        };
        order::ascending(&parallel::collect(self.vertex_count(), number), last + 1)
    }

    fn is_cubic(&self) -> bool {
        self.lengths() == [4; 3]
    }

    /// `finish(v, (W c)_v, out_v)` for every vertex v, to `out`, which has an entry for each.
    pub(crate) fn product<T: Entry<D>, U: Copy + Default + Send, const D: usize>(
        &self,
        c: &[T],
        out: &mut [U],
        finish: impl Fn(usize, T, U) -> U + Sync + Send,
    ) {
        if self.is_cubic() {
            let planes: [Vec<f64>; D] = std::array::from_fn(|x| c.iter().map(|c| c.coordinates()[x]).collect());
            let level = Level::new();
            let chunk = parallel::chunk(out.len());
            parallel::for_each_chunk(out, chunk, |first, out| {
                let places = self.places(first..first + out.len());
                let Some(sorted) = self.sorted(&places) else {
                    let finish = |i: usize, sum, was| finish(first + i, sum, was);
                    return self.dispatched_product(level, &planes, places, out, finish);
                };
                let vertex = |i: usize| sorted.order[i] as usize;
                let mut there: Vec<U> = (0..out.len()).map(|i| out[vertex(i)]).collect();
                let finish = |i: usize, sum, was| finish(first + vertex(i), sum, was);
                self.dispatched_product(level, &planes, sorted.places(), &mut there, finish);
                there.into_iter().enumerate().for_each(|(i, x)| out[vertex(i)] = x);
            });
            return;
        }
        let chunk = parallel::chunk(out.len());
        parallel::for_each_chunk(out, chunk, |first, out| {
            let mut scratch = Vec::new();
            for (v, out) in (first..).zip(out) {
                let mut sum = T::default();
                self.for_each_line(v, &mut scratch, |first, w, along_w| {
                    let mut line = T::default();
                    for (x, c) in along_w.iter().zip(&c[first..first + along_w.len()]) {
                        line += *c * *x;
                    }
                    sum += line * w;
                });
                *out = finish(v, sum, *out);
            }
        });
    }

    /// These places in the order of cells, where runs are short and become longer so.
    fn sorted(&self, Places { cells, local, .. }: &Places) -> Option<Sorted> {
        /// Vertices in a run, on average, below which sorting takes less time than it saves.
        const LONG: usize = 16;
        if self.ends.is_some() || cells.chunk_by(|a, b| a == b).count() * LONG <= cells.len() || cells.is_sorted() {
            return None;
        }
        let mut keys: Vec<([u16; 3], u32)> = cells.iter().copied().zip(0..).collect();
        keys.sort_unstable();
        let order: Vec<u32> = keys.iter().map(|(_, i)| *i).collect();
        let local = local.map(|of| order.iter().map(|i| of[*i as usize]).collect());
        Some(Sorted { order, cells: keys.into_iter().map(|(cell, _)| cell).collect(), local })
    }

    fn dispatched_product<T: Entry<D>, U: Copy, const D: usize>(
        &self,
        level: Level,
        planes: &[Vec<f64>; D],
        places: Places,
        out: &mut [U],
        finish: impl Fn(usize, T, U) -> U,
    ) {
        dispatch!(level, simd => match self.is_portable {
            false => self.cubic_product::<_, T, U, D, true>(simd, planes, places, out, &finish),
            true => self.cubic_product::<_, T, U, D, false>(simd, planes, places, out, &finish),
        });
    }

    /// `finish(i, the sum, out_i)` for the i-th of some vertices, to `out`.
    #[inline(always)]
    fn cubic_product<S: Simd, T: Entry<D>, U: Copy, const D: usize, const FUSED: bool>(
        &self,
        simd: S,
        planes: &[Vec<f64>; D],
        places: Places,
        out: &mut [U],
        finish: impl Fn(usize, T, U) -> U,
    ) {
        let mut i = 0;
        for (cell, end) in places.runs() {
            let Some(cell) = self.cubic_cell(cell) else {
                (i..end).zip(&mut out[i..end]).for_each(|(i, out)| *out = finish(i, T::default(), *out));
                i = end;
                continue;
            };
            let controls = self.bezier_controls(planes, &cell);
            while i < end {
                let count = LANES.min(end - i);
                let polynomials = cell.polynomials(simd, &places, i);
                let mut sums = [[0.0; LANES]; D];
                for x in 0..D {
                    blended::<S, FUSED>(simd, &polynomials, &controls[x]).store_slice(&mut sums[x]);
                }
                for (lane, out) in out[i..i + count].iter_mut().enumerate() {
                    let mut coordinates = [0.0; D];
                    for x in 0..D {
                        coordinates[x] = sums[x][lane];
                    }
                    *out = finish(i + lane, T::of(coordinates), *out);
                }
                i += count;
            }
        }
    }

    /// Where some vertices lie.
    fn places(&self, vertices: Range<usize>) -> Places<'_> {
        Places {
            cells: &self.cells[vertices.clone()],
            local: self.local.each_ref().map(|of| &of[vertices.clone()]),
            first: vertices.start,
            ends: self.ends.as_ref().map(|ends| &ends[ends.partition_point(|end| *end as usize <= vertices.start)..]),
        }
    }

    /// `None` for vertices that are kept.
    #[inline(always)]
    fn cubic_cell(&self, cell: [u16; 3]) -> Option<Cell<'_>> {
        if cell == KEPT {
            return None;
        }
        let of = |axis: usize| (&self.pieces[axis], cell[axis]);
        Some(Cell {
            start: [0, 1, 2].map(|axis| of(axis).0.start(cell[axis])),
            coefficients: [0, 1, 2].map(|axis| of(axis).0.coefficients(cell[axis]).as_chunks().0),
            is_tangent: [0, 1, 2].map(|axis| of(axis).0.is_tangent(cell[axis])),
        })
    }

    /// The first control of each line (a, b, ·) that begins at `start`.
    #[inline(always)]
    fn line(&self, [i, j, k]: [usize; 3], a: usize, b: usize) -> usize {
        ((i + a) * self.size[1] + j + b) * self.size[2] + k
    }

    /// The control points of a cell as those of its polynomials.
    #[inline(always)]
    fn bezier_controls<const D: usize>(&self, planes: &[Vec<f64>; D], cell: &Cell) -> Controls<D> {
        let mut controls = [[[0.0; 4]; 16]; D];
        for (plane, controls) in planes.iter().zip(&mut controls) {
            for (line, controls) in controls.iter_mut().enumerate() {
                let first = self.line(cell.start, line / 4, line % 4);
                controls.copy_from_slice(&plane[first..first + 4]);
            }
            *controls = tensor_product(&cell.coefficients, controls);
        }
        controls
    }

    /// What some vertices, with their `g(v)`, add to `Wᵀ g` (#controls).
    pub(crate) fn part_of_transposed<T: Entry<D>, const D: usize>(
        &self,
        vertices: Range<usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        if self.is_cubic() {
            let (first, places) = (vertices.start, self.places(vertices));
            return match self.sorted(&places) {
                None => self.dispatched_transposed_product(places, |i| g(first + i)),
                Some(sorted) => {
                    self.dispatched_transposed_product(sorted.places(), |i| g(first + sorted.order[i] as usize))
                }
            };
        }
        self.sum_of_rows(vertices, g)
    }

    /// `Wᵀ g` of some vertices alone, with their `g(v)`, in their order.
    pub(crate) fn sum_of_rows<T: Entry<D>, const D: usize>(
        &self,
        vertices: impl IntoIterator<Item = usize>,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        let mut sum = vec![T::default(); self.control_count()];
        let mut scratch = Vec::new();
        for v in vertices {
            let of_vertex = g(v);
            self.for_each_line(v, &mut scratch, |first, w, along_w| {
                let term = of_vertex * w;
                for (x, s) in along_w.iter().zip(&mut sum[first..first + along_w.len()]) {
                    *s += term * *x;
                }
            });
        }
        sum
    }

    fn dispatched_transposed_product<T: Entry<D>, const D: usize>(
        &self,
        places: Places,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        dispatch!(Level::new(), simd => match self.is_portable {
            false => self.cubic_transposed_product::<_, T, D, true>(simd, places, &g),
            true => self.cubic_transposed_product::<_, T, D, false>(simd, places, &g),
        })
    }

    /// What some vertices, with `g(i)` of the i-th of them, add to `Wᵀ g` (#controls).
    #[inline(always)]
    fn cubic_transposed_product<S: Simd, T: Entry<D>, const D: usize, const FUSED: bool>(
        &self,
        simd: S,
        places: Places,
        g: impl Fn(usize) -> T,
    ) -> Vec<T> {
        let mut planes: [Vec<f64>; D] = std::array::from_fn(|_| vec![0.0; self.control_count()]);
        let mut batch = Batch::<D>::zero();
        let mut i = 0;
        for (cell, end) in places.runs() {
            let Some(cell) = self.cubic_cell(cell) else {
                i = end;
                continue;
            };
            let mut sums: Sums<D> = [[[[0.0; QUARTET]; 16]; 4]; D];
            while i < end {
                let count = BATCH.min(end - i);
                batch.set_g(count, |k| g(i + k));
                for first in (0..count).step_by(LANES) {
                    batch.set(simd, first, &cell.polynomials(simd, &places, i + first));
                }
                batch.add_to::<S, FUSED>(simd, count, &mut sums);
                i += count;
            }
            self.add_sums(&cell, &sums, &mut planes);
        }
        (0..self.control_count()).map(|c| T::of(std::array::from_fn(|x| planes[x][c]))).collect()
    }

    /// Adds the sums of a cell, which are for its polynomials, to the planes of all controls.
    #[inline(always)]
    fn add_sums<const D: usize>(&self, cell: &Cell, sums: &Sums<D>, planes: &mut [Vec<f64>; D]) {
        let transposed = [0, 1, 2].map(|axis| transposed(cell.coefficients[axis]));
        let coefficients = transposed.each_ref().map(|matrix| &matrix[..]);
        for (sums, plane) in sums.iter().zip(planes) {
            let mut lines = [[0.0; 4]; 16];
            for (line, of_line) in lines.iter_mut().enumerate() {
                *of_line = std::array::from_fn(|c| added(sums[c][line]));
            }
            for (line, of_line) in tensor_product(&coefficients, &lines).iter().enumerate() {
                let first = self.line(cell.start, line / 4, line % 4);
                plane[first..first + 4].iter_mut().zip(of_line).for_each(|(total, sum)| *total += sum);
            }
        }
    }
}

/// Vertices of a cell on their way to `Σ u_a v_b w_c g_x`, a product of matrices: of what is along u and v with what is along w and of g.
struct Batch<const D: usize> {
    /// `u_a v_b` at [4a + b][vertex].
    uv: [[f64; BATCH]; 16],
    /// `w_c g_x` at [x][c][vertex].
    wg: [[[f64; BATCH]; 4]; D],
    /// `g_x` at [x][vertex]: brought together long before it is read, so that packed reads need not wait for single writes.
    g: [[f64; BATCH]; D],
}

/// Vertices in a batch: few enough to stay near the processor, many enough that reading and writing the sums costs little. A multiple of
/// [`LANES`].
const BATCH: usize = 64;

/// `Σ u_a v_b w_c g_x` of a cell's vertices at [x][c][4a + b], a sum for each vertex in four. They are added at the cell's end.
type Sums<const D: usize> = [[[[f64; QUARTET]; 16]; 4]; D];

/// Vertices that are added side by side: with four, eight packed sums stay in registers beside what they take up.
const QUARTET: usize = 4;

impl<const D: usize> Batch<D> {
    fn zero() -> Self {
        Self { uv: [[0.0; BATCH]; 16], wg: [[[0.0; BATCH]; 4]; D], g: [[0.0; BATCH]; D] }
    }

    /// Puts `g(i)` of the first `count` vertices there, and 0 for what is beyond them in their last eight.
    #[inline(always)]
    fn set_g<T: Entry<D>>(&mut self, count: usize, g: impl Fn(usize) -> T) {
        for i in 0..count {
            for (of_x, x) in self.g.iter_mut().zip(g(i).coordinates()) {
                of_x[i] = x;
            }
        }
        self.g.iter_mut().for_each(|of_x| of_x[count..count.next_multiple_of(LANES)].fill(0.0));
    }

    /// Puts eight vertices there, from place `first` on, whose g is there.
    #[inline(always)]
    fn set<S: Simd>(&mut self, simd: S, first: usize, [u, v, w]: &[Four<S>; 3]) {
        let place = first..first + LANES;
        for (uv, (a, b)) in self.uv.iter_mut().zip((0..4).flat_map(|a| (0..4).map(move |b| (a, b)))) {
            (u[a] * v[b]).store_slice(&mut uv[place.clone()]);
        }
        for (of_x, wg) in self.g.iter().zip(&mut self.wg) {
            let of_x = f64x8::from_slice(simd, &of_x[place.clone()]);
            for (w, wg) in w.iter().zip(wg) {
                (*w * of_x).store_slice(&mut wg[place.clone()]);
            }
        }
    }

    /// Adds `Σ u_a v_b w_c g_x` of the first `count` vertices, rounded up to whole eights.
    #[inline(always)]
    fn add_to<S: Simd, const FUSED: bool>(&self, simd: S, count: usize, sums: &mut Sums<D>) {
        let count = count.next_multiple_of(LANES);
        for (wg, sums) in self.wg.iter().zip(sums) {
            for line in (0..16).step_by(2) {
                let of = |c: usize, line: usize| f64x4::from_slice(simd, &sums[c][line]);
                let mut even = [of(0, line), of(1, line), of(2, line), of(3, line)];
                let mut odd = [of(0, line + 1), of(1, line + 1), of(2, line + 1), of(3, line + 1)];
                for first in (0..count).step_by(QUARTET) {
                    let place = first..first + QUARTET;
                    let even_uv = f64x4::from_slice(simd, &self.uv[line][place.clone()]);
                    let odd_uv = f64x4::from_slice(simd, &self.uv[line + 1][place.clone()]);
                    for c in 0..4 {
                        let wg = f64x4::from_slice(simd, &wg[c][place.clone()]);
                        even[c] = times_plus_four::<S, FUSED>(even_uv, wg, even[c]);
                        odd[c] = times_plus_four::<S, FUSED>(odd_uv, wg, odd[c]);
                    }
                }
                for c in 0..4 {
                    even[c].store_slice(&mut sums[c][line]);
                    odd[c].store_slice(&mut sums[c][line + 1]);
                }
            }
        }
    }
}

/// `a b + c`, as [`times_plus`].
#[inline(always)]
pub(crate) fn times_plus_four<S: Simd, const FUSED: bool>(a: f64x4<S>, b: f64x4<S>, c: f64x4<S>) -> f64x4<S> {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// `a b + c`, with one rounding where the processor can and `FUSED` allows it.
#[inline(always)]
fn times_plus<S: Simd, const FUSED: bool>(a: f64x8<S>, b: f64x8<S>, c: f64x8<S>) -> f64x8<S> {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// `Σ u_a v_b w_c · controls[4a + b][c]` of eight vertices.
#[inline(always)]
fn blended<S: Simd, const FUSED: bool>(simd: S, [u, v, w]: &[Four<S>; 3], controls: &[[f64; 4]; 16]) -> f64x8<S> {
    let mut sum = f64x8::splat(simd, 0.0);
    for a in 0..4 {
        let mut of_plane = f64x8::splat(simd, 0.0);
        for b in 0..4 {
            let [c0, c1, c2, c3] = controls[4 * a + b];
            let line = times_plus::<S, FUSED>(w[1], f64x8::splat(simd, c1), w[0] * c0);
            let line = times_plus::<S, FUSED>(w[2], f64x8::splat(simd, c2), line);
            let line = times_plus::<S, FUSED>(w[3], f64x8::splat(simd, c3), line);
            of_plane = times_plus::<S, FUSED>(v[b], line, of_plane);
        }
        sum = times_plus::<S, FUSED>(u[a], of_plane, sum);
    }
    sum
}

/// `Σ_abc u_ia v_jb w_kc · x_abc` at [4i + j][k].
#[inline(always)]
fn tensor_product([u, v, w]: &[&[[f64; 4]]; 3], x: &[[f64; 4]; 16]) -> [[f64; 4]; 16] {
    let (mut along_w, mut along_vw, mut product) = ([[0.0; 4]; 16], [[0.0; 4]; 16], [[0.0; 4]; 16]);
    for (along_w, x) in along_w.iter_mut().zip(x) {
        for k in 0..4 {
            along_w[k] = w[k][0] * x[0] + w[k][1] * x[1] + w[k][2] * x[2] + w[k][3] * x[3];
        }
    }
    for (line, along_vw) in along_vw.iter_mut().enumerate() {
        let (a, j) = (4 * (line / 4), line % 4);
        for k in 0..4 {
            along_vw[k] = v[j][0] * along_w[a][k]
                + v[j][1] * along_w[a + 1][k]
                + v[j][2] * along_w[a + 2][k]
                + v[j][3] * along_w[a + 3][k];
        }
    }
    for (line, product) in product.iter_mut().enumerate() {
        let (i, j) = (line / 4, line % 4);
        for k in 0..4 {
            product[k] = u[i][0] * along_vw[j][k]
                + u[i][1] * along_vw[4 + j][k]
                + u[i][2] * along_vw[8 + j][k]
                + u[i][3] * along_vw[12 + j][k];
        }
    }
    product
}

#[inline(always)]
fn added([a, b, c, d]: [f64; QUARTET]) -> f64 {
    (a + b) + (c + d)
}

/// The transposed of a matrix.
#[inline(always)]
fn transposed(matrix: &[[f64; 4]]) -> [[f64; 4]; 4] {
    let mut transposed = [[0.0; 4]; 4];
    for (i, row) in matrix.iter().enumerate() {
        for (j, x) in row.iter().enumerate() {
            transposed[j][i] = *x;
        }
    }
    transposed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Basis, Frame, Lattice};

    /// Of a lattice of 6 × 6 × 6 points, with vertices in the order of cells, as products take them.
    fn tensor(points: &[DVec3]) -> Tensor {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| 2.5 * a);
        let frame = Frame { origin: DVec3::splat(-1.25), axes };
        let lattice = Lattice::new([0; 3].map(|_| Basis::uniform(6, 3).unwrap()), frame).unwrap();
        let tensor = Tensor::of_bases(points.len(), lattice.bases(), |v| Some(lattice.parameters(points[v])));
        tensor.rows_of(&tensor.cell_order())
    }

    /// W c and Wᵀ g.
    fn products(tensor: &Tensor, c: &[DVec3], g: &[DVec3]) -> (Vec<DVec3>, Vec<DVec3>) {
        let mut apply = vec![DVec3::ZERO; g.len()];
        tensor.product(c, &mut apply, |_, d, _| d);
        (apply, tensor.part_of_transposed(0..g.len(), |v| g[v]))
    }

    /// The same on the processor's lowest level.
    fn at_baseline<const FUSED: bool>(tensor: &Tensor, c: &[DVec3], g: &[DVec3]) -> (Vec<DVec3>, Vec<DVec3>) {
        let planes = [0, 1, 2].map(|x| c.iter().map(|c| c[x]).collect());
        let mut apply = vec![DVec3::ZERO; g.len()];
        let (level, places) = (Level::baseline(), tensor.places(0..g.len()));
        let same = |_, d: DVec3, _| d;
        dispatch!(level, simd => tensor.cubic_product::<_, _, _, 3, FUSED>(simd, &planes, places, &mut apply, same));
        let adjoint =
            dispatch!(level, simd => tensor.cubic_transposed_product::<_, _, 3, FUSED>(simd, places, |v| g[v]));
        (apply, adjoint)
    }

    #[test]
    fn runs_that_are_known_are_those_that_cells_show() {
        let tensor = tensor(crate::shapes::icosphere(3).points());
        let count = tensor.vertex_count();
        for range in [0..count, 0..1, 5..17, 300..300, 100..count - 1, count - 1..count] {
            let known = tensor.places(range.clone());
            let unknown = Places { ends: None, ..known };
            assert!(known.ends.is_some());
            let runs: Vec<_> = known.runs().collect();
            assert_eq!(runs, unknown.runs().collect::<Vec<_>>());
            assert_eq!(runs.last().map_or(0, |run| run.1), range.len());
        }
        let reversed: Vec<u32> = (0..count as u32).rev().collect();
        assert_eq!(tensor.rows_of(&reversed).ends, None);
    }

    #[test]
    fn products_are_the_same_to_rounding_on_processors_of_every_level() {
        let points = crate::shapes::icosphere(3).points().to_vec();
        let tensor = tensor(&points);
        let c: Vec<DVec3> = (0..216).map(|i| DVec3::new(1.0, 2.0, 3.0) * f64::from(i % 7)).collect();
        let (apply, adjoint) = at_baseline::<true>(&tensor, &c, &points);
        let (applied, adjoined) = products(&tensor, &c, &points);
        assert!(apply.iter().zip(&applied).all(|(a, b)| (*a - *b).length() <= 1e-14));
        assert!(adjoint.iter().zip(&adjoined).all(|(a, b)| (*a - *b).length() <= 1e-13));
        // Portable ones to the last bit.
        let tensor = tensor.portable();
        assert_eq!(at_baseline::<false>(&tensor, &c, &points), products(&tensor, &c, &points));
    }
}
