//! Harmonic coordinates of a cage.
//!
//! Wanted are functions αᵢ, one for each vertex of a closed triangle cage, with `Δαᵢ = 0` inside, and on each triangle the barycentric
//! coordinate of vertex i (P. Joshi, M. Meyer, T. DeRose, B. Green, T. Sanocki, *Harmonic coordinates for character articulation*, 2007).
//! So `Σ αᵢ = 1`, `Σ αᵢ(p) vᵢ = p`, `αᵢ ≥ 0`, and a vertex acts through the inside of the cage only: not across a gap. They
//! have no closed form.
//!
//! As in the paper Laplace's equation is solved on a grid of cubic cells. At a node inside, with arms of length θ cells along the axes
//! to the next node or to the cage,
//!
//! ```text
//! Σ_arms (α(end) − α(node)) / θ = 0.
//! ```
//!
//! *Changes versus the paper.* (1) Its cells are outside, inside or on the cage, and cells on it take values of the cage. Here arms are cut exactly where
//! they first meet the cage, and α has the value of that place there (F. Gibou, R. Fedkiw, L.-T. Cheng, M. Kang, *A second-order-accurate
//! symmetric discretization of the Poisson equation on irregular domains*, 2002): linear functions are solutions without error, the error of
//! others falls with the square of the step away from kinks of the cage, and α at nodes lies between 0 and 1 (a matrix M whose rows
//! have sums ≥ 0). (2) It lets heat spread until nothing changes much, on several grids. The equations are symmetric and positive definite;
//! their Cholesky factor (the crate `faer`) serves all vertices, so nothing has to converge. (3) Values between nodes are made by the
//! same equation ([`crate::harmonic_grid`]) instead of trilinearly only, so that they are exact on the cage, and for linear functions.
//!
//! *Errors.* Coordinates sum to 1 and reproduce p up to rounding at any resolution. α itself has an error that falls with the step; the report says
//! by how much a grid twice as coarse differs. It is largest next to edges of the cage; in the middle of a cube of 32 cells it is 4e-4.
//! Where lines between nodes do not meet the surroundings of a vertex at all, which happens in parts that are thinner than a cell, the
//! cage is refused.

use std::cmp::Ordering;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, Mat, Par, Side};
use glam::DVec3;

use crate::cage::Cage;
use crate::harmonic_grid::{End, Grid, Hit, Place};
use crate::parallel;

/// Cells along the longest side of a cage at least: a grid half as fine must be one.
const LEAST_RESOLUTION: usize = 2;

/// Cells along the longest side of a cage at most. More: gigabytes for the cells alone.
const MOST_RESOLUTION: usize = 256;

/// Nodes inside at most: a box of 64 cells along each side. More: gigabytes for the factor, and minutes.
const MOST_UNKNOWNS: usize = 1 << 18;

/// Numbers in a Cholesky factor at most. More: gigabytes, and minutes.
const MOST_VALUES: usize = 1 << 28;

/// Values of α at nodes at most. More: gigabytes.
const MOST_WEIGHTS: usize = 1 << 28;

/// Vertices whose α are solved for together. More: fewer threads have work; fewer: the factor is read more often.
const TOGETHER: usize = 16;

/// No unknown.
const NONE: u32 = u32::MAX;

/// How harmonic coordinates are computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HarmonicOptions {
    /// Cells along the longest side of the cage's box.
    pub resolution: usize,
}

impl Default for HarmonicOptions {
    /// 48 cells: up to 110,000 nodes, in a box.
    fn default() -> Self {
        Self { resolution: 48 }
    }
}

impl HarmonicOptions {
    /// As many cells as leave about 20,000 nodes inside `cage`: slender ones get finer grids, at about the same cost.
    #[must_use]
    pub fn fitted(cage: &Cage) -> Self {
        /// More: seconds become tens of seconds; fewer: thin parts are refused.
        const NODES: f64 = 20_000.0;
        let origin = cage.corners(0)[0];
        let sixfold = |t: usize| {
            let [a, b, c] = cage.corners(t).map(|p| (p - origin) / cage.extent());
            a.dot(b.cross(c))
        };
        let filled = (0..cage.triangles().len()).map(sixfold).sum::<f64>() / 6.0;
        let resolution = (NODES / filled).cbrt().round() as usize;
        Self { resolution: resolution.clamp(LEAST_RESOLUTION, MOST_RESOLUTION) }
    }
}

/// Why a cage has no harmonic coordinates on a grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HarmonicError {
    /// No such grid.
    #[error(
        "harmonic coordinates need {LEAST_RESOLUTION} to {MOST_RESOLUTION} cells along the longest side of the cage, not {resolution}"
    )]
    Resolution {
        /// What was asked for.
        resolution: usize,
    },
    /// Part of the cage is between the lines of the grid.
    #[error(
        "{resolution} cells along the cage's longest side are too few for what is round its vertex {vertex} at {position}: take a finer grid"
    )]
    Unresolved {
        /// The first vertex without influence.
        vertex: usize,
        /// Where it is.
        position: DVec3,
        /// What was asked for.
        resolution: usize,
    },
    /// The equations or their solutions do not fit.
    #[error("{unknowns} nodes of the grid inside the cage are too many for {vertices} vertices: take a coarser grid")]
    TooLarge {
        /// Nodes inside.
        unknowns: usize,
        /// Vertices of the cage.
        vertices: usize,
    },
    /// Coordinates are rounded to more than cells are wide.
    #[error(
        "the cage is too far from the origin: its coordinates are rounded to more than a cell of the grid; move it there"
    )]
    Far,
}

/// How large and how good a solution is.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct HarmonicReport {
    /// Cells along the longest side of the cage's box.
    pub resolution: usize,
    /// Nodes inside, each an unknown for each vertex of the cage.
    pub unknowns: usize,
    /// Largest error of an equation at a node, as a change of α there.
    pub residual: f64,
    /// Largest difference of α at a node from what a grid twice as coarse says there. Where the error falls at least as the step does, α at
    /// nodes is that precise.
    pub largest_error: f64,
    /// Root of the mean over all nodes and all α of the square of that difference.
    pub mean_error: f64,
    /// Least α at a node.
    pub least_weight: f64,
}

/// The harmonic coordinates of a cage, solved for on a grid.
#[derive(Clone, Debug)]
pub struct Harmonic {
    solution: Solution,
    report: HarmonicReport,
}

impl Harmonic {
    /// Solves for the coordinates of all vertices of `cage`.
    ///
    /// # Errors
    ///
    /// [`HarmonicError`]: a resolution that is none, a cage that has thinner parts, equations that are too large.
    pub fn new(cage: &Cage, options: &HarmonicOptions) -> Result<Self, HarmonicError> {
        let resolution = options.resolution;
        if !(LEAST_RESOLUTION..=MOST_RESOLUTION).contains(&resolution) {
            return Err(HarmonicError::Resolution { resolution });
        }
        let equations = Equations::new(cage, resolution)?;
        let vertices = cage.vertices().len();
        let mut is_met: Vec<bool> = vec![true; vertices];
        cage.triangles().as_flattened().iter().for_each(|v| is_met[*v as usize] = false);
        for cut in &equations.cuts {
            for (v, weight) in cage.triangles()[cut.triangle as usize].iter().zip(cut.weights) {
                is_met[*v as usize] |= weight > 0.0;
            }
        }
        if let Some(vertex) = is_met.iter().position(|is_met| !is_met) {
            return Err(HarmonicError::Unresolved { vertex, position: cage.vertices()[vertex], resolution });
        }
        let unknowns = equations.nodes.len();
        let (solution, residual) = equations.solved(cage)?;
        let (coarse, _) = Equations::new(cage, resolution / 2)?.solved(cage)?;
        let differences = parallel::map_chunks(unknowns, 64, |range| {
            let mut row = vec![0.0; vertices];
            let (mut largest, mut squares, mut least) = (0.0_f64, 0.0, f64::INFINITY);
            for unknown in range {
                let node = solution.grid.position(solution.grid.node(solution.nodes[unknown] as usize));
                coarse.fill_row(node, &mut row);
                for (fine, coarse) in solution.weights_at(unknown).iter().zip(&row) {
                    largest = largest.max((fine - coarse).abs());
                    squares += (fine - coarse).powi(2);
                    least = least.min(*fine);
                }
            }
            (largest, squares, least)
        });
        let squares: f64 = differences.iter().map(|d| d.1).sum();
        let report = HarmonicReport {
            resolution,
            unknowns,
            residual,
            largest_error: differences.iter().map(|d| d.0).fold(0.0, f64::max),
            mean_error: (squares / (unknowns * vertices) as f64).sqrt(),
            least_weight: differences.iter().map(|d| d.2).fold(f64::INFINITY, f64::min),
        };
        Ok(Self { solution, report })
    }

    /// Puts α at `point` into `row` (#vertices of the cage). `false`, and no change, where the point is outside; on the cage, up to
    /// [`crate::tolerances::INSIDE`] of its extent, α is exact. Elsewhere the sum is 1 and the point reproduced up to rounding, and no α is
    /// negative beyond it.
    ///
    /// # Panics
    ///
    /// Panics where `row` does not have an entry for each vertex.
    pub fn fill_row(&self, point: DVec3, row: &mut [f64]) -> bool {
        self.solution.fill_row(point, row)
    }

    /// Puts ∇α at `point` into `gradient` (#vertices of the cage): differences between the point and places one cell from it along the
    /// axes, or where the cage is nearer, there; exact for quadratic functions of each coordinate but for the error of α. The sum is 0, and
    /// `Σ vᵢ ⊗ ∇αᵢ` is the identity. `false`, and no change, where the point is outside or on the cage.
    ///
    /// # Panics
    ///
    /// Panics where `gradient` does not have an entry for each vertex.
    pub fn fill_gradient(&self, point: DVec3, gradient: &mut [DVec3]) -> bool {
        self.solution.fill_gradient(point, gradient)
    }

    /// How large and how good the solution is.
    #[must_use]
    pub fn report(&self) -> &HarmonicReport {
        &self.report
    }
}

/// Where an arm is cut.
struct Cut {
    unknown: u32,
    triangle: u32,
    /// Barycentric coordinates in the triangle.
    weights: [f64; 3],
    /// 1/θ.
    factor: f64,
}

/// Laplace's equation at nodes inside.
struct Equations {
    grid: Grid,
    /// By unknown: its node.
    nodes: Vec<u32>,
    /// By node: its unknown, or [`NONE`].
    unknowns: Vec<u32>,
    /// By unknown: the sum of 1/θ.
    diagonal: Vec<f64>,
    /// Pairs of neighbours without the cage between them, the smaller unknown first; sorted.
    links: Vec<[u32; 2]>,
    /// In the order of unknowns.
    cuts: Vec<Cut>,
}

impl Equations {
    fn new(cage: &Cage, resolution: usize) -> Result<Self, HarmonicError> {
        let grid = Grid::new(cage, resolution).ok_or(HarmonicError::Far)?;
        let nodes: Vec<u32> = (0..grid.node_count()).filter(|i| grid.is_inside(*i)).map(|i| i as u32).collect();
        if nodes.len() > MOST_UNKNOWNS {
            return Err(HarmonicError::TooLarge { unknowns: nodes.len(), vertices: cage.vertices().len() });
        }
        let mut unknowns = vec![NONE; grid.node_count()];
        nodes.iter().enumerate().for_each(|(unknown, node)| unknowns[*node as usize] = unknown as u32);
        let parts = parallel::map_chunks(nodes.len(), parallel::CHUNK / 8, |range| {
            let (mut diagonal, mut links, mut cuts) = (Vec::new(), Vec::new(), Vec::new());
            for unknown in range.clone() {
                let node = grid.node(nodes[unknown] as usize);
                let mut sum = 0.0;
                for axis in 0..3 {
                    for is_up in [false, true] {
                        let Some((hit, length)) = grid.cut_arm(node, axis, is_up) else {
                            let mut neighbour = node;
                            neighbour[axis] = if is_up { node[axis] + 1 } else { node[axis] - 1 };
                            if is_up {
                                links.push([unknown as u32, unknowns[grid.index(neighbour)]]);
                            }
                            sum += 1.0;
                            continue;
                        };
                        let (factor, Hit { triangle, weights, .. }) = (1.0 / length, hit);
                        cuts.push(Cut { unknown: unknown as u32, triangle, weights, factor });
                        sum += factor;
                    }
                }
                diagonal.push(sum);
            }
            (diagonal, links, cuts)
        });
        let (mut diagonal, mut links, mut cuts) = (Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            diagonal.extend(part.0);
            links.extend(part.1);
            cuts.extend(part.2);
        }
        Ok(Self { grid, nodes, unknowns, diagonal, links, cuts })
    }

    /// The solution for all vertices, and the largest error of an equation, as a change of α.
    fn solved(self, cage: &Cage) -> Result<(Solution, f64), HarmonicError> {
        let (count, vertices) = (self.nodes.len(), cage.vertices().len());
        let too_large = HarmonicError::TooLarge { unknowns: count, vertices };
        if count.checked_mul(vertices).is_none_or(|weights| weights > MOST_WEIGHTS) {
            return Err(too_large);
        }
        let mut residual = 0.0;
        let mut weights = vec![0.0; count * vertices];
        if count > 0 {
            let factor = self.factor().ok_or(too_large)?;
            let solved = parallel::map(vertices.div_ceil(TOGETHER), |part| {
                let first = part * TOGETHER;
                let columns = TOGETHER.min(vertices - first);
                let mut known = Mat::zeros(count, columns);
                for cut in &self.cuts {
                    for (v, weight) in cage.triangles()[cut.triangle as usize].iter().zip(cut.weights) {
                        if let Some(column) = (*v as usize).checked_sub(first).filter(|c| *c < columns) {
                            known[(cut.unknown as usize, column)] += cut.factor * weight;
                        }
                    }
                }
                let mut found = known.clone();
                factor.solve(&mut found);
                let residual = (0..columns).map(|k| self.residual(found.col_as_slice(k), known.col_as_slice(k)));
                let residual = residual.fold(0.0, f64::max);
                (found, residual)
            });
            residual = solved.iter().map(|part| part.1).fold(0.0, f64::max);
            parallel::for_each_chunk(&mut weights, vertices, |first, row| {
                row.iter_mut()
                    .enumerate()
                    .for_each(|(v, x)| *x = solved[v / TOGETHER].0[(first / vertices, v % TOGETHER)]);
            });
        }
        let triangles = cage.triangles().to_vec();
        Ok((
            Solution { grid: self.grid, nodes: self.nodes, unknowns: self.unknowns, triangles, vertices, weights },
            residual,
        ))
    }

    /// `None` where it is too large.
    fn factor(&self) -> Option<Factor> {
        let count = self.nodes.len();
        let diagonal = self.diagonal.iter().enumerate().map(|(i, d)| Triplet::new(i, i, *d));
        let links = self.links.iter().map(|[i, j]| Triplet::new(*i as usize, *j as usize, -1.0));
        let entries: Vec<_> = diagonal.chain(links).collect();
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(count, count, &entries).ok()?;
        let order = self.order();
        let mut inverse = vec![0; count];
        order.iter().enumerate().for_each(|(place, unknown)| inverse[*unknown] = place);
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&order, &inverse, count));
        let params = CholeskySymbolicParams::default();
        let symbolic = factorize_symbolic_cholesky(matrix.symbolic(), Side::Upper, ordering, params).ok()?;
        if symbolic.len_val() > MOST_VALUES {
            return None;
        }
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        let stack = MemStack::new(&mut memory);
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Upper,
                Default::default(),
                Par::Seq,
                stack,
                Default::default(),
            )
            .ok()?;
        Some(Factor { symbolic, values })
    }

    /// Unknowns in an order for elimination: those of both sides of a plane in the middle, then those on it, and so on inside the sides
    /// (A. George, *Nested dissection of a regular finite element mesh*, 1973).
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.nodes.len()).collect();
        let places: Vec<Place> = self.nodes.iter().map(|n| self.grid.node(*n as usize)).collect();
        dissect(&mut order, &places);
        order
    }

    /// The largest error of the equations, each over its diagonal entry.
    fn residual(&self, found: &[f64], known: &[f64]) -> f64 {
        let mut left: Vec<f64> = self.diagonal.iter().zip(found).zip(known).map(|((d, x), b)| d * x - b).collect();
        for [i, j] in self.links.iter().map(|link| link.map(|unknown| unknown as usize)) {
            left[i] -= found[j];
            left[j] -= found[i];
        }
        left.iter().zip(&self.diagonal).map(|(left, d)| left.abs() / d).fold(0.0, f64::max)
    }
}

/// Orders nodes for elimination, in place.
fn dissect(nodes: &mut [usize], places: &[Place]) {
    /// So few nodes are left as they are.
    const FEW: usize = 8;
    if nodes.len() <= FEW {
        return;
    }
    let range = |axis: usize| {
        let along = || nodes.iter().map(|n| places[*n][axis]);
        (along().min().unwrap_or(0), along().max().unwrap_or(0))
    };
    let axis = (0..3).max_by_key(|axis| range(*axis).1 - range(*axis).0).unwrap_or(0);
    let (low, high) = range(axis);
    if low == high {
        return;
    }
    let mut along: Vec<usize> = nodes.iter().map(|n| places[*n][axis]).collect();
    let plane = *along.select_nth_unstable(nodes.len() / 2).1;
    let side = |n: &usize| match places[*n][axis].cmp(&plane) {
        Ordering::Less => 0,
        Ordering::Greater => 1,
        Ordering::Equal => 2,
    };
    nodes.sort_by_key(side);
    let below = nodes.partition_point(|n| side(n) < 1);
    let above = nodes.partition_point(|n| side(n) < 2) - below;
    let (first, rest) = nodes.split_at_mut(below);
    let (second, on) = rest.split_at_mut(above);
    dissect(first, places);
    dissect(second, places);
    dissect(on, places);
}

/// A Cholesky factor.
struct Factor {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl Factor {
    fn solve(&self, columns: &mut Mat<f64>) {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(columns.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        let factor = LltRef::new(&self.symbolic, &self.values);
        factor.solve_in_place_with_conj(Conj::No, columns.as_mut(), Par::Seq, MemStack::new(&mut memory));
    }
}

/// α at nodes of a grid.
#[derive(Clone, Debug)]
struct Solution {
    grid: Grid,
    /// By unknown: its node.
    nodes: Vec<u32>,
    /// By node: its unknown, or [`NONE`].
    unknowns: Vec<u32>,
    /// Of the cage.
    triangles: Vec<[u32; 3]>,
    /// Of the cage.
    vertices: usize,
    /// #unknowns × #vertices.
    weights: Vec<f64>,
}

impl Solution {
    /// α at a node inside.
    fn weights_at(&self, unknown: usize) -> &[f64] {
        &self.weights[unknown * self.vertices..(unknown + 1) * self.vertices]
    }

    /// Adds a multiple of α at a place on the cage.
    fn add_on_cage(&self, triangle: u32, weights: [f64; 3], factor: f64, row: &mut [f64]) {
        let vertices = self.triangles[triangle as usize];
        vertices.iter().zip(weights).for_each(|(v, w)| row[*v as usize] += factor * w);
    }

    /// Adds a multiple of α at a point inside, which is in a cell.
    fn add_inside(&self, cell: Place, point: DVec3, factor: f64, row: &mut [f64]) {
        let mixture = self.grid.mixture(cell, point);
        for (corner, weight) in mixture.corners.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
            let node = [cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2)];
            let unknown = self.unknowns[self.grid.index(node)] as usize;
            row.iter_mut().zip(self.weights_at(unknown)).for_each(|(x, w)| *x += factor * weight * w);
        }
        mixture.hits.iter().for_each(|(hit, weight)| self.add_on_cage(hit.triangle, hit.weights, factor * weight, row));
    }

    fn fill_row(&self, point: DVec3, row: &mut [f64]) -> bool {
        assert_eq!(row.len(), self.vertices, "one entry for each vertex of the cage");
        let Some(cell) = self.grid.cell(point) else { return false };
        if let Some((triangle, weights)) = self.grid.touched(cell, point) {
            row.fill(0.0);
            self.add_on_cage(triangle, weights, 1.0, row);
            return true;
        }
        if self.grid.winding(cell, point) < 1 {
            return false;
        }
        row.fill(0.0);
        self.add_inside(cell, point, 1.0, row);
        true
    }

    fn fill_gradient(&self, point: DVec3, gradient: &mut [DVec3]) -> bool {
        assert_eq!(gradient.len(), self.vertices, "one entry for each vertex of the cage");
        let Some(cell) = self.grid.cell(point) else { return false };
        if self.grid.touched(cell, point).is_some() || self.grid.winding(cell, point) < 1 {
            return false;
        }
        let mut here = vec![0.0; self.vertices];
        self.add_inside(cell, point, 1.0, &mut here);
        let mut slope = vec![0.0; self.vertices];
        for axis in 0..3 {
            let [(low, a), (high, b)] =
                [-1.0, 1.0].map(|sign| self.grid.walk(cell, point, axis, sign * self.grid.step()));
            // The derivative of the parabola through the three values.
            let [of_low, of_high] = [-b / (a * (a + b)), a / (b * (a + b))];
            slope.iter_mut().zip(&here).for_each(|(slope, here)| *slope = -(of_low + of_high) * here);
            for (end, factor) in [(low, of_low), (high, of_high)] {
                match end {
                    End::Cage(hit) => self.add_on_cage(hit.triangle, hit.weights, factor, &mut slope),
                    End::Inside(cell, at) => self.add_inside(cell, at, factor, &mut slope),
                }
            }
            gradient.iter_mut().zip(&slope).for_each(|(gradient, slope)| gradient[axis] = *slope);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Faces, Mesh};
    use crate::{Bounds, shapes, tolerances};
    use glam::{DMat3, DQuat};
    use std::f64::consts::PI;

    fn harmonic(cage: &Cage, resolution: usize) -> Harmonic {
        Harmonic::new(cage, &HarmonicOptions { resolution }).unwrap()
    }

    fn cage(mesh: &Mesh, turn: DQuat) -> Cage {
        Cage::new(mesh.with_points(mesh.points().iter().map(|p| turn * *p).collect()).unwrap()).unwrap()
    }

    /// Some rotation under which nothing lies along an axis.
    fn turn() -> DQuat {
        DQuat::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 0.7)
    }

    /// Points spread over a box (low-discrepancy, M. Roberts's R₃).
    fn points(bounds: Bounds, count: usize) -> impl Iterator<Item = DVec3> {
        let fractions = |k: usize| {
            DVec3::new(0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9).to_array().map(|a| (k as f64 * a).fract())
        };
        (1..=count).map(move |k| bounds.min + bounds.size() * DVec3::from_array(fractions(k)))
    }

    /// The unit cube whose faces have no diagonal at the origin, vertex 0.
    fn cube() -> Mesh {
        let corners = (0..8).map(|v| DVec3::new((v & 1) as f64, (v >> 1 & 1) as f64, (v >> 2) as f64)).collect();
        let mut faces = Faces::new();
        for axis in 0..3 {
            let [u, v] = [1_u32 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
            for far in [0, 1_u32 << axis] {
                let mut face = [far, far + u, far + u + v, far + v];
                if far == 0 {
                    face.reverse();
                }
                // The diagonal joins corners with one or three coordinates 1.
                let is_even = face[0].count_ones() % 2 == 0;
                face.rotate_left(usize::from(is_even));
                let [a, b, c, d] = face;
                faces.push(&[a, b, c]);
                faces.push(&[a, c, d]);
            }
        }
        Mesh::new(corners, faces).unwrap()
    }

    /// α of the vertex of [`cube`] at the origin. On each of the three faces there it is `max(0, 1 − x − y) = Σ c_mn sin mπx sin nπy` with
    /// `c_mn = 4/π² (1/(m n) + (−1)^m δ_mn / (2 n²))`, and inside each term falls as `sinh γ(1 − z) / sinh γ`, `γ = π √(m² + n²)`.
    fn at_origin(p: DVec3) -> f64 {
        let face = |x: f64, y: f64, z: f64| {
            let mut sum = 0.0;
            for m in 1..=40 {
                for n in 1..=40 {
                    let [i, j] = [m, n].map(f64::from);
                    let diagonal = if m == n { if m % 2 == 0 { 0.5 } else { -0.5 } } else { 0.0 };
                    let c = 4.0 / PI.powi(2) * (1.0 + diagonal) / (i * j);
                    let gamma = PI * i.hypot(j);
                    let fall = ((-gamma * z).exp() - (-gamma * (2.0 - z)).exp()) / (1.0 - (-2.0 * gamma).exp());
                    sum += c * (i * PI * x).sin() * (j * PI * y).sin() * fall;
                }
            }
            sum
        };
        face(p.x, p.y, p.z) + face(p.y, p.z, p.x) + face(p.z, p.x, p.y)
    }

    #[test]
    fn a_cube_has_the_coordinates_and_gradients_of_its_fourier_series() {
        let inner = Bounds { min: DVec3::splat(0.2), max: DVec3::splat(0.8) };
        for turn in [DQuat::IDENTITY, turn()] {
            let cage = cage(&cube(), turn);
            let errors = [8, 16, 32].map(|resolution| {
                let harmonic = harmonic(&cage, resolution);
                let (mut row, mut gradient) = (vec![0.0; 8], vec![DVec3::ZERO; 8]);
                let (mut of_value, mut of_gradient) = (0.0_f64, 0.0_f64);
                for p in points(inner, 60) {
                    assert!(harmonic.fill_row(turn * p, &mut row) && harmonic.fill_gradient(turn * p, &mut gradient));
                    of_value = of_value.max((row[0] - at_origin(p)).abs());
                    let slope = |e: DVec3| (at_origin(p + 1e-5 * e) - at_origin(p - 1e-5 * e)) / 2e-5;
                    let expected = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
                    of_gradient = of_gradient.max((turn.inverse() * gradient[0] - expected).length());
                }
                let report = harmonic.report();
                assert!(of_value <= report.largest_error, "{of_value:e} {report:?}");
                assert!(report.residual < 1e-14 && report.least_weight > -1e-15, "{report:?}");
                [of_value, of_gradient]
            });
            for k in 0..2 {
                // Of second order: a sixteenth is expected.
                assert!(errors[2][k] < errors[0][k] / 8.0, "{errors:?}");
            }
            assert!(errors[2][0] < 1e-3 && errors[2][1] < 2e-2, "{errors:?}");
        }
    }

    #[test]
    fn finer_cages_carry_harmonic_functions_better() {
        let errors = [0, 1, 2].map(|levels| {
            let cage = cage(&shapes::icosphere(levels), turn());
            let f = |p: DVec3| p.x * p.x - p.y * p.y;
            let known: Vec<f64> = cage.vertices().iter().map(|v| f(*v)).collect();
            // Between nodes x² − y² is off by up to h²/4, here 0.002.
            let harmonic = harmonic(&cage, 24);
            let mut row = vec![0.0; known.len()];
            let inner = Bounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) };
            let error = points(inner, 200).map(|p| {
                assert!(harmonic.fill_row(p, &mut row));
                (row.iter().zip(&known).map(|(w, f)| w * f).sum::<f64>() - f(p)).abs()
            });
            error.fold(0.0, f64::max)
        });
        assert!(errors[1] < errors[0] / 2.0 && errors[2] < errors[1] / 2.0, "{errors:?}");
    }

    #[test]
    fn coordinates_sum_to_one_reproduce_the_point_and_are_positive() {
        let meshes = [
            shapes::cube(2),
            shapes::icosphere(1),
            shapes::uv_torus(2.0, 0.8, 12, 8),
            shapes::hollow_sphere(1, 0.5),
            shapes::chain(2, 12, 8),
        ];
        for (mesh, turn) in meshes.iter().flat_map(|mesh| [(mesh, DQuat::IDENTITY), (mesh, turn())]) {
            let cage = cage(mesh, turn);
            let harmonic = harmonic(&cage, 30);
            let (mut row, mut gradient) = (vec![7.0; mesh.points().len()], vec![DVec3::ZERO; mesh.points().len()]);
            let mut inside = 0;
            for p in points(cage.mesh().bounds().unwrap(), 600) {
                let is_inside = harmonic.fill_row(p, &mut row);
                assert_eq!(is_inside, cage.contains(p), "{p}");
                if !is_inside {
                    assert!(!harmonic.fill_gradient(p, &mut gradient));
                    continue;
                }
                inside += 1;
                let at: DVec3 = row.iter().zip(cage.vertices()).map(|(w, v)| *w * *v).sum();
                assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12 && at.distance(p) < 1e-12 * cage.extent());
                assert!(row.iter().all(|w| *w >= -1e-14), "{row:?}");
                if harmonic.fill_gradient(p, &mut gradient) {
                    let outer = |(v, g): (&DVec3, &DVec3)| DMat3::from_cols(*v * g.x, *v * g.y, *v * g.z);
                    let jacobian = cage.vertices().iter().zip(&gradient).map(outer).fold(DMat3::ZERO, |a, b| a + b);
                    let sum: DVec3 = gradient.iter().sum();
                    assert!(jacobian.abs_diff_eq(DMat3::IDENTITY, 1e-7) && sum.length() * cage.extent() < 1e-7);
                }
            }
            assert!(inside > 20, "{inside}");
        }
    }

    /// The sum of slopes along a way is the difference of its ends.
    #[test]
    fn gradients_are_slopes_of_rows() {
        let cage = cage(&shapes::icosphere(1), turn());
        let vertices = cage.vertices().len();
        let (from, to) = (DVec3::new(-0.4, -0.3, 0.1), DVec3::new(0.3, 0.4, -0.2));
        let errors = [10, 20, 40].map(|resolution| {
            let harmonic = harmonic(&cage, resolution);
            let (mut start, mut end, mut sum) = (vec![0.0; vertices], vec![0.0; vertices], vec![0.0; vertices]);
            assert!(harmonic.fill_row(from, &mut start) && harmonic.fill_row(to, &mut end));
            let mut gradient = vec![DVec3::ZERO; vertices];
            for k in 0..400 {
                assert!(harmonic.fill_gradient(from.lerp(to, (k as f64 + 0.5) / 400.0), &mut gradient));
                sum.iter_mut().zip(&gradient).for_each(|(sum, slope)| *sum += slope.dot(to - from) / 400.0);
            }
            let error = |v: usize| (sum[v] - (end[v] - start[v])).abs();
            (0..vertices).map(error).fold(0.0, f64::max)
        });
        assert!(errors[1] < errors[0] / 2.0 && errors[2] < errors[1] / 2.0 && errors[2] < 2e-3, "{errors:?}");
    }

    #[test]
    fn on_the_cage_coordinates_are_those_of_the_triangle() {
        let cage = cage(&shapes::uv_torus(2.0, 0.8, 12, 8), turn());
        let harmonic = harmonic(&cage, 24);
        let mut row = vec![0.0; cage.vertices().len()];
        for (t, corners) in cage.triangles().iter().enumerate() {
            for weights in [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.25, 0.5, 0.25], [0.1, 0.2, 0.7]] {
                let p: DVec3 = weights.iter().zip(cage.corners(t)).map(|(w, c)| *w * c).sum();
                assert!(harmonic.fill_row(p, &mut row));
                let mut expected = vec![0.0; row.len()];
                corners.iter().zip(weights).for_each(|(v, w)| expected[*v as usize] = w);
                assert!(row.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{row:?}");
            }
        }
        // Next to it they hardly differ: each changes by at most about the distance over the height of a triangle.
        for t in 0..cage.triangles().len() {
            let [a, b, c] = cage.corners(t);
            let inward = -(b - a).cross(c - a).normalize() * 1e3 * tolerances::INSIDE * cage.extent();
            assert!(harmonic.fill_row((a + b + c) / 3.0 + inward, &mut row));
            assert!(cage.triangles()[t].iter().all(|v| (row[*v as usize] - 1.0 / 3.0).abs() < 1e-4));
        }
    }

    #[test]
    fn what_the_grid_does_not_show_is_refused() {
        let thin = cage(&shapes::plate(DVec3::new(1.0, 1.0, 0.01), [4, 4]), turn());
        let refused = Harmonic::new(&thin, &HarmonicOptions { resolution: 8 }).unwrap_err();
        assert!(matches!(refused, HarmonicError::Unresolved { resolution: 8, .. }), "{refused}");
        let cube = Cage::new(shapes::cube(1)).unwrap();
        for resolution in [0, 1, 257] {
            let refused = Harmonic::new(&cube, &HarmonicOptions { resolution }).unwrap_err();
            assert_eq!(refused, HarmonicError::Resolution { resolution });
        }
        let refused = Harmonic::new(&cube, &HarmonicOptions { resolution: 70 }).unwrap_err();
        assert_eq!(refused, HarmonicError::TooLarge { unknowns: 70 * 70 * 70, vertices: 8 });
        let far = cube.moved(DVec3::splat(1e15)).unwrap();
        assert_eq!(Harmonic::new(&far, &HarmonicOptions::default()).unwrap_err(), HarmonicError::Far);
        assert_eq!(HarmonicOptions::fitted(&cube).resolution, 27); // 27³ = 19,683
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn bits_do_not_depend_on_threads() {
        let cage = cage(&shapes::icosphere(1), turn());
        let solved = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| harmonic(&cage, 24))
        });
        let bits = |harmonic: &Harmonic| harmonic.solution.weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&solved[0]), bits(&solved[1]));
        assert_eq!(solved[0].report, solved[1].report);
    }
}
