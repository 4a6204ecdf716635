//! The stress of a flattened grid, and an approximate inverse of its second derivative.
//!
//! For grid points at X_i, geodesic lengths d_ij and weights w_ij between those within `reach` steps,
//!
//! ```text
//! C(X) = Σ_i Σ_{j∈Ω_i} w_ij (d_ij − |X_i − X_j|)²                                              (1)
//! ```
//!
//! CO, appendix; Ω_i does not hold i, and each pair stands there twice. With u the unit vector from X_j to X_i, l their distance, each pair puts
//! `4 w (l − d) u` on ∂C/∂X_i, its negative on ∂C/∂X_j, and the block `4 w (u uᵀ + (1 − d/l) (1 − u uᵀ))` on the second derivative. Without its
//! negative part, where 1 < d/l, that is Gauss and Newton's.
//!
//! On smooth displacements the second derivative acts as that of an elastic sheet, whose energy in two dimensions is the same on a
//! grid twice as coarse. So it is inverted by levels (J. H. Bramble, J. E. Pasciak, J. Xu, *Parallel multilevel preconditioners*,
//! 1990): the blocks of its diagonal on each of a row of grids, every second point of the one before, and the whole of it on the
//! coarsest.

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use fearless_simd::dispatch;
use glam::{DMat2, DVec2};

use crate::geodesic::{GridLengths, step_index};
use crate::parallel;

/// Pairs of a part of the grid that one thread sums. Larger: small grids leave threads idle; smaller: rows at the borders of parts
/// are added twice.
const PAIRS: usize = 16_384;

/// The coarsest grid has at most so many points, or this part of those of the finest. Larger: factorising it takes longer; smaller: more
/// iterations.
const COARSEST: usize = 81;
const COARSEST_PART: f64 = 0.02;

/// What is added to diagonals, relative to their mean, for sheets in which some displacement costs nothing. Larger: slow bends take more
/// iterations; smaller: a start with points on one line has no inverse.
const SOFT: f64 = 1e-8;

/// (1) over a grid of `size` points; vectors over the grid are all x, then all y (2 · #points).
#[derive(Clone, Debug)]
pub(crate) struct Stress {
    size: [usize; 2],
    steps: Vec<[usize; 2]>,
    /// For steps whose second part goes backwards.
    is_backward: Vec<bool>,
    /// Rows of a part.
    part: usize,
    /// d and w, part after part, in each step after step from all its points, so that sums go over long rows; 0 where a step leads out of the grid.
    lengths: Vec<f64>,
    weights: Vec<f64>,
}

/// One step from the points of a row: where both ends and the pairs are.
struct Run {
    from: usize,
    to: usize,
    pairs: usize,
    len: usize,
}

impl Stress {
    /// Of the lengths of a grid of `size` points, with the weights of `weight(d)`.
    pub(crate) fn new(grid: &GridLengths, size: [usize; 2], weight: impl Fn(f64) -> f64 + Send + Sync) -> Self {
        let steps: Vec<[usize; 2]> = grid.steps.iter().map(|&[a, b]| [a.unsigned_abs(), b.unsigned_abs()]).collect();
        let is_backward = grid.steps.iter().map(|s| s[1] < 0).collect();
        let reach = steps.iter().map(|s| s[0]).max().unwrap_or(0);
        let part = PAIRS.div_ceil(steps.len() * size[1]).max(reach);
        let [lengths, weights] = [0; 2].map(|_| vec![0.0; grid.lengths.len()]);
        let mut stress = Self { size, steps, is_backward, part, lengths, weights };
        for (i, o) in (0..size[0]).flat_map(|i| (0..grid.steps.len()).map(move |o| (i, o))) {
            let Some(Run { from, pairs, len, .. }) = stress.run(i, o) else { continue };
            let first = (i * grid.steps.len() + o) * size[1] + from - i * size[1];
            let lengths = &grid.lengths[first..first + len];
            stress.lengths[pairs..pairs + len].copy_from_slice(lengths);
            stress.weights[pairs..pairs + len].iter_mut().zip(lengths).for_each(|(w, d)| *w = weight(*d));
        }
        stress
    }

    /// Number of points.
    pub(crate) fn points(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The pairs along step `o` that begin in row `i`.
    fn run(&self, i: usize, o: usize) -> Option<Run> {
        let ([rows, columns], [a, b]) = (self.size, self.steps[o]);
        if i + a >= rows || b >= columns {
            return None;
        }
        let (first, last) = if self.is_backward[o] { (b, 0) } else { (0, b) };
        let pairs = self.pair([i, first], o);
        Some(Run { from: i * columns + first, to: (i + a) * columns + last, pairs, len: columns - b })
    }

    /// The pair along step `o` from grid point (i, j).
    fn pair(&self, [i, j]: [usize; 2], o: usize) -> usize {
        let first = i - i % self.part;
        let rows = self.part.min(self.size[0] - first);
        (first * self.steps.len() + o * rows + i - first) * self.size[1] + j
    }

    /// Calls `f(i, j, d, w)` for every pair of points i and j.
    pub(crate) fn for_each_pair(&self, mut f: impl FnMut(usize, usize, f64, f64)) {
        for i in 0..self.size[0] {
            for run in (0..self.steps.len()).filter_map(|o| self.run(i, o)) {
                for k in 0..run.len {
                    f(run.from + k, run.to + k, self.lengths[run.pairs + k], self.weights[run.pairs + k]);
                }
            }
        }
    }

    /// The geodesic length from grid point (i, j) along one of the steps of the reach.
    ///
    /// # Panics
    ///
    /// Panics where it is none of them.
    pub(crate) fn length(&self, [i, j]: [usize; 2], step: [isize; 2]) -> f64 {
        let reach = self.steps.last().map_or(0, |step| step[0]);
        let o = step_index(reach, step).expect("a step of the reach");
        self.lengths[self.pair([i, j], o)]
    }

    /// C at `x`, and its gradient.
    pub(crate) fn at(&self, x: &[f64]) -> (f64, Vec<f64>) {
        let [rows, columns] = self.size;
        let points = self.points();
        let reach = self.steps.iter().map(|s| s[0]).max().unwrap_or(0);
        let parts = parallel::map_chunks(rows, self.part, |part| {
            let [first, count] = [part.start * columns, part.len() * columns];
            let end = rows.min(part.end + reach) * columns;
            let mut gradient = [vec![0.0; end - first], vec![0.0; end - first]];
            let mut pulls = [vec![0.0; count], vec![0.0; count]];
            let mut squares = vec![0.0; count];
            // The same numbers whatever the width of registers: nothing is fused, and each point has a sum of its own.
            dispatch!(fearless_simd::Level::new(), _simd => {
                for (o, &[a, b]) in self.steps.iter().enumerate() {
                    if a >= rows || b >= columns {
                        continue;
                    }
                    // At the ends of rows the other ends are in other rows: there d and w are 0.
                    let to = first + a * columns + b - if self.is_backward[o] { 2 * b } else { 0 };
                    if to >= end {
                        continue;
                    }
                    let len = count.min(end - to);
                    let pairs = first * self.steps.len() + o * count;
                    let [x0, x1] = [&x[first..first + len], &x[to..to + len]];
                    let [y0, y1] = [&x[points + first..points + first + len], &x[points + to..points + to + len]];
                    let [d, w] = [&self.lengths[pairs..pairs + len], &self.weights[pairs..pairs + len]];
                    let [px, py] = &mut pulls;
                    let (px, py, squares) = (&mut px[..len], &mut py[..len], &mut squares[..len]);
                    for k in 0..len {
                        let [dx, dy] = [x0[k] - x1[k], y0[k] - y1[k]];
                        let l = (dx * dx + dy * dy).sqrt();
                        let off = l - d[k];
                        // Points at one place have no direction to part in.
                        let pull = if l > 0.0 { 4.0 * w[k] * off / l } else { 0.0 };
                        px[k] = pull * dx;
                        py[k] = pull * dy;
                        squares[k] += w[k] * (off * off);
                    }
                    for (gradient, pulls) in gradient.iter_mut().zip([px, py]) {
                        let plus = &mut gradient[..len];
                        plus.iter_mut().zip(&*pulls).for_each(|(g, p)| *g += p);
                        let minus = &mut gradient[to - first..to - first + len];
                        minus.iter_mut().zip(&*pulls).for_each(|(g, p)| *g -= p);
                    }
                }
            });
            (first, 2.0 * squares.iter().sum::<f64>(), gradient)
        });
        let mut value = 0.0;
        let mut sum = vec![0.0; 2 * points];
        for (first, part, gradient) in parts {
            value += part;
            for (axis, gradient) in gradient.iter().enumerate() {
                sum[axis * points + first..].iter_mut().zip(gradient).for_each(|(s, g)| *s += g);
            }
        }
        (value, sum)
    }

    /// `Σ_i Σ_j w d²`, the stress of a sheet shrunk to a point.
    pub(crate) fn scale(&self) -> f64 {
        let mut scale = 0.0;
        self.for_each_pair(|_, _, d, w| scale += 2.0 * w * d * d);
        scale
    }
}

/// Gauss and Newton's block of a pair.
fn block(u: DVec2, d: f64, w: f64) -> DMat2 {
    let l = u.length();
    if l == 0.0 {
        return 4.0 * w * DMat2::IDENTITY;
    }
    let along = DMat2::from_cols(u * u.x, u * u.y) * (1.0 / (l * l));
    4.0 * w * (along + (1.0 - d / l).max(0.0) * (DMat2::IDENTITY - along))
}

/// A block with [`SOFT`] on its diagonal.
fn stiffened(block: DMat2) -> DMat2 {
    block + 0.5 * SOFT * (block.x_axis.x + block.y_axis.y) * DMat2::IDENTITY
}

/// Every second point of a grid, and its last.
#[derive(Clone, Debug)]
struct Level {
    /// Points in rows and columns.
    size: [usize; 2],
    /// Inverse blocks of the diagonal.
    inverse: Vec<DMat2>,
}

/// An approximate inverse of the second derivative of a [`Stress`], symmetric and positive.
#[derive(Debug)]
pub(crate) struct Inverse {
    levels: Vec<Level>,
    coarsest: Llt<f64>,
}

/// Points of the next coarser grid.
fn halved(size: usize) -> usize {
    if size <= 3 { size } else { (size - 1).div_ceil(2) + 1 }
}

/// Index in a grid of `size` points of the point `k` of the next coarser.
fn finer(k: usize, size: usize) -> usize {
    if halved(size) == size { k } else { (2 * k).min(size - 1) }
}

/// The points of the next coarser grid between which point `f` lies, one or two.
fn coarser(f: usize, size: usize) -> [usize; 2] {
    if halved(size) == size {
        [f, f]
    } else if f + 1 == size {
        [halved(size) - 1; 2]
    } else {
        [f / 2, f.div_ceil(2)]
    }
}

impl Inverse {
    /// About `x`.
    pub(crate) fn new(stress: &Stress, x: &[f64]) -> Option<Self> {
        let points = stress.points();
        let at = |k: usize| DVec2::new(x[k], x[points + k]);
        let mut diagonal = vec![DMat2::ZERO; points];
        stress.for_each_pair(|i, j, d, w| {
            let block = block(at(i) - at(j), d, w);
            diagonal[i] += block;
            diagonal[j] += block;
        });
        let mut size = stress.size;
        let mut levels = Vec::new();
        // Where the points of this level are in the finest grid.
        let mut places = size.map(|n| (0..n).collect::<Vec<usize>>());
        let mut width = 1;
        let coarsest = COARSEST.max((COARSEST_PART * points as f64) as usize);
        while size[0] * size[1] > coarsest && size.iter().any(|n| *n > 3) {
            let factor = hat_energy(width, &stress.steps);
            let inverse = places[0].iter().flat_map(|i| places[1].iter().map(move |j| i * stress.size[1] + j));
            let inverse = inverse.map(|k| stiffened(diagonal[k] * factor).inverse()).collect();
            levels.push(Level { size, inverse });
            let next = size.map(halved);
            places = [0, 1].map(|a| (0..next[a]).map(|k| places[a][finer(k, size[a])]).collect());
            size = next;
            width *= 2;
        }
        let coarsest = coarse_matrix(stress, &places, at).llt(Side::Lower).ok()?;
        Some(Self { levels, coarsest })
    }

    /// Of a gradient, a displacement.
    pub(crate) fn times(&self, gradient: &[f64]) -> Vec<f64> {
        let mut restricted = vec![gradient.to_vec()];
        for level in &self.levels {
            let last = restricted.last().expect("the finest is there");
            restricted.push(restriction(last, level.size));
        }
        let coarse = restricted.pop().expect("the coarsest is there");
        let points = coarse.len() / 2;
        let right = Mat::from_fn(2 * points, 1, |k, _| coarse[(k % 2) * points + k / 2]);
        let solved = self.coarsest.solve(&right);
        let mut result: Vec<f64> = (0..2 * points).map(|k| solved[(2 * (k % points) + k / points, 0)]).collect();
        for (level, residual) in self.levels.iter().zip(restricted).rev() {
            let points = level.inverse.len();
            let mut finer = prolongation(&result, level.size);
            for (k, inverse) in level.inverse.iter().enumerate() {
                let step = *inverse * DVec2::new(residual[k], residual[points + k]);
                finer[k] += step.x;
                finer[points + k] += step.y;
            }
            result = finer;
        }
        result
    }
}

/// The energy of a hat over `width` grid steps to both sides, relative to that of a single point.
fn hat_energy(width: usize, steps: &[[usize; 2]]) -> f64 {
    let hat = |x: isize| (1.0 - x.unsigned_abs() as f64 / width as f64).max(0.0);
    let w = width as isize;
    let overlap = |by: usize| (-w..=w).map(|x| hat(x) * hat(x + by as isize)).sum::<f64>();
    let full = overlap(0) * overlap(0);
    steps.iter().map(|s| full - overlap(s[0]) * overlap(s[1])).sum::<f64>() / steps.len() as f64
}

/// The stress's second derivative on the coarsest grid, with lengths as they are at `at`, x and y of a point beside each other.
fn coarse_matrix(stress: &Stress, places: &[Vec<usize>; 2], at: impl Fn(usize) -> DVec2 + Copy) -> Mat<f64> {
    let columns = stress.size[1];
    let size = [places[0].len(), places[1].len()];
    let mut matrix = Mat::<f64>::zeros(2 * size[0] * size[1], 2 * size[0] * size[1]);
    for (o, &[a, b]) in stress.steps.iter().enumerate() {
        for i in 0..size[0].saturating_sub(a) {
            for j in 0..size[1].saturating_sub(b) {
                let (j, l) = if stress.is_backward[o] { (j + b, j) } else { (j, j + b) };
                let [p, q] = [places[0][i] * columns + places[1][j], places[0][i + a] * columns + places[1][l]];
                let pair = stress.pair([places[0][i], places[1][j]], o);
                let u = at(p) - at(q);
                let block = block(u, u.length(), stress.weights[pair]);
                let [p, q] = [i * size[1] + j, (i + a) * size[1] + l];
                for (row, column, sign) in [(p, p, 1.0), (q, q, 1.0), (p, q, -1.0), (q, p, -1.0)] {
                    for c in 0..2 {
                        for r in 0..2 {
                            matrix[(2 * row + r, 2 * column + c)] += sign * block.col(c)[r];
                        }
                    }
                }
            }
        }
    }
    // Rigid motions cost nothing; here each costs as much as the mean displacement, so that the sheet does not turn.
    let unknowns = matrix.nrows();
    let mean = (0..unknowns).map(|k| matrix[(k, k)]).sum::<f64>() / unknowns as f64;
    let nodes = places[0].iter().flat_map(|i| places[1].iter().map(move |j| at(i * columns + j)));
    let nodes: Vec<DVec2> = nodes.collect();
    let center = nodes.iter().sum::<DVec2>() / nodes.len() as f64;
    for motion in [|_| DVec2::X, |_| DVec2::Y, DVec2::perp] {
        let moved: Vec<f64> = nodes.iter().flat_map(|p| motion(*p - center).to_array()).collect();
        let square: f64 = moved.iter().map(|m| m * m).sum();
        for (column, c) in moved.iter().enumerate() {
            moved.iter().enumerate().for_each(|(row, r)| matrix[(row, column)] += mean * r * c / square);
        }
    }
    (0..unknowns).for_each(|k| matrix[(k, k)] += SOFT * mean);
    matrix
}

/// Pᵀ of a vector over a grid of `size` points, P the bilinear interpolation from the next coarser grid.
fn restriction(fine: &[f64], size: [usize; 2]) -> Vec<f64> {
    let coarse = size.map(halved);
    let mut result = vec![0.0; 2 * coarse[0] * coarse[1]];
    for (row, fine) in fine.chunks_exact(size[1]).enumerate() {
        let (axis, i) = (row / size[0], row % size[0]);
        for k in coarser(i, size[0]) {
            let first = (axis * coarse[0] + k) * coarse[1];
            let into = &mut result[first..first + coarse[1]];
            for (j, value) in fine.iter().enumerate() {
                coarser(j, size[1]).into_iter().for_each(|l| into[l] += 0.25 * value);
            }
        }
    }
    result
}

/// P of a vector over the next coarser grid.
fn prolongation(coarse: &[f64], size: [usize; 2]) -> Vec<f64> {
    let from = size.map(halved);
    let mut result = Vec::with_capacity(2 * size[0] * size[1]);
    for axis in 0..2 {
        for i in 0..size[0] {
            let rows = coarser(i, size[0]).map(|k| &coarse[(axis * from[0] + k) * from[1]..][..from[1]]);
            for j in 0..size[1] {
                let [l, m] = coarser(j, size[1]);
                result.push(0.25 * (rows[0][l] + rows[0][m] + rows[1][l] + rows[1][m]));
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesic::plane_lengths;

    /// In several parts, the last of one row or of a few, the sums are those over all pairs.
    #[test]
    fn parts_make_the_whole() {
        for (rows, columns, reach) in [(3, 5, 3), (37, 40, 3), (41, 40, 3), (19, 300, 2), (2, 700, 5), (1, 4, 2)] {
            let cells = [rows - 1, columns - 1];
            let wave = |k: usize| {
                let (i, j) = ((k / columns) as f64, (k % columns) as f64);
                DVec2::new(i + 0.1 * libm::sin(j), j - 0.2 * libm::sin(0.7 * i))
            };
            let rest: Vec<DVec2> = (0..rows * columns).map(wave).collect();
            let stress = Stress::new(&plane_lengths(&rest, cells, reach), [rows, columns], |d| 1.0 / (1.0 + d));
            let at = |k: usize| 1.1 * rest[k] + 0.3 * DVec2::new(libm::sin(k as f64), libm::cos(0.3 * k as f64));
            let (mut value, mut gradient) = (0.0, vec![DVec2::ZERO; rows * columns]);
            let mut pairs = 0;
            stress.for_each_pair(|i, j, d, w| {
                assert_eq!((d, w), (rest[i].distance(rest[j]), 1.0 / (1.0 + d)));
                let (u, l) = (at(i) - at(j), at(i).distance(at(j)));
                value += 2.0 * w * (d - l) * (d - l);
                gradient[i] += 4.0 * w * (l - d) / l * u;
                gradient[j] -= 4.0 * w * (l - d) / l * u;
                pairs += 1;
            });
            let within = |n: usize, step: usize| n.saturating_sub(step);
            let expected: usize = (0..=reach)
                .flat_map(|a| (0..=reach).map(move |b| (a, b)))
                .map(|(a, b)| within(rows, a) * within(columns, b) * if a > 0 && b > 0 { 2 } else { 1 })
                .sum::<usize>()
                - rows * columns;
            assert_eq!(pairs, expected);
            let x: Vec<f64> =
                (0..rows * columns).map(|k| at(k).x).chain((0..rows * columns).map(|k| at(k).y)).collect();
            let (found, slope) = stress.at(&x);
            assert!((found - value).abs() <= 1e-12 * value, "{rows} x {columns}: {found}, not {value}");
            for (k, g) in gradient.iter().enumerate() {
                assert!(
                    g.distance(DVec2::new(slope[k], slope[rows * columns + k])) <= 1e-12 * value,
                    "{rows} x {columns}: {k}"
                );
            }
        }
    }
}
