//! Point location in a flattened grid: for a point x in the plane the cell (i, j) and the place (u, v) in it with
//!
//! ```text
//! x = (1 − u)(1 − v) a + u (1 − v) b + u v c + (1 − u) v d,                                         (1)
//! ```
//!
//! a, b, c, d the flattened grid points (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1). CO, section 3.2, says that it is done and not how.
//!
//! Cells are convex, so x is in one where it is to the right of none of its sides. Those signs are exact (J. R. Shewchuk, *Adaptive precision
//! floating-point arithmetic and fast robust geometric predicates*, 1997; crate `robust`), so a point near a side that two cells share is in at
//! least one of them; on the side it is in both, and the first counts. Cells are looked up by bins.
//!
//! (1) is quadratic in v: with r = x − a, e = b − a, f = d − a, g = c − b − d + a, `A v² + B v + C = 0` for A = g × f, B = r × g + e × f,
//! C = r × e. At a root 2 A v + B is the Jacobian determinant of (1), which is not negative in a convex cell, so the root is the one with +√ of
//! the discriminant, `(√D − B)/2A = −2C/(B + √D)`: the form without cancellation is taken. It holds for parallelograms (A = 0), trapezoids and
//! triangles. Newton's steps take away what rounding left.
//!
//! Beyond the boundary (1) goes on with u or v outside [0, 1]: grid lines go on straight. A *ring* of such cells round the grid, `r` cells
//! wide, is part of it where a model may stick out.

use glam::{DMat2, DVec2};
use robust::{Coord, orient2d};

use crate::sheet::Sheet;

/// Why no point can be located on a sheet.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// A grid point is nowhere.
    #[error("grid point ({}, {}) of the flattened sheet is at ({}, {}): coordinates must be finite", .point[0], .point[1], .place.x, .place.y)]
    NotFinite {
        /// Its (i, j).
        point: [usize; 2],
        /// Where it is.
        place: DVec2,
    },
    /// Cells that are mirrored or not convex.
    #[error(
        "the flattened sheet folds: {count} of its cells are mirrored or not convex, the first is ({}, {}); flatten with a larger reach or \
         more cells",
        .cell[0], .cell[1]
    )]
    Folded {
        /// How many.
        count: usize,
        /// (i, j) of the first.
        cell: [usize; 2],
    },
    /// All cells have no area.
    #[error("the flattened sheet has no area")]
    NoArea,
    /// Parts of the sheet lie over one another.
    #[error(
        "the flattened sheet lies over itself: its boundary crosses itself near ({}, {}); take a smaller part of the surface, or \
         let the model stick out less",
        .near.x, .near.y
    )]
    Overlap {
        /// A grid point near the crossing.
        near: DVec2,
    },
    /// Grid lines meet before they have gone far enough beyond the boundary.
    #[error(
        "the sheet cannot be extended as far as the model goes: the grid lines that leave it at cell ({}, {}) meet within {cells} cells; \
         move the model or make it smaller",
        .cell[0], .cell[1]
    )]
    Meet {
        /// (i, j) of the cell at the boundary.
        cell: [usize; 2],
        /// Width of the ring that was tried, in cells.
        cells: f64,
    },
}

/// Where a point is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    /// Parameters (s, t) of the surface.
    pub(crate) parameters: DVec2,
    /// ∂(x, y)/∂(s, t).
    pub(crate) slope: DMat2,
}

/// A flattened grid, prepared for location.
#[derive(Clone, Debug)]
pub(crate) struct Locator {
    grid: Grid,
    corners: Vec<Corners>,
    /// A cell without area holds no point.
    is_empty: Vec<bool>,
    bins: Bins,
    extent: f64,
}

/// Grid points with what they stand for: those of a sheet, and round them those of a ring, if there is one.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// Cells along both directions, those of the ring among them.
    pub(crate) cells: [usize; 2],
    /// Place of point (i, j) at `i · (cells[1] + 1) + j`.
    pub(crate) points: Vec<DVec2>,
    /// Cells of the sheet.
    sheet: [usize; 2],
    /// Width of the ring in cells; 0 without one.
    ring: f64,
}

impl Grid {
    fn of(sheet: &Sheet) -> Self {
        Self { cells: sheet.cells(), points: sheet.flat().to_vec(), sheet: sheet.cells(), ring: 0.0 }
    }

    /// With a ring `width` cells wide.
    fn ringed(sheet: &Sheet, width: f64) -> Self {
        let inner = Self::of(sheet);
        let [m, n] = inner.cells;
        let mut ringed = Self { cells: [m + 2, n + 2], points: Vec::new(), sheet: inner.sheet, ring: width };
        for i in 0..m + 3 {
            for j in 0..n + 3 {
                let ([i, u], [j, v]) = (ringed.along(i, 0), ringed.along(j, 1));
                ringed.points.push(inner.corners([i as usize, j as usize]).at(u, v));
            }
        }
        ringed
    }

    /// For line `k` along an axis the cell of the sheet that it belongs to and where in it the line is.
    fn along(&self, k: usize, axis: usize) -> [f64; 2] {
        let n = self.sheet[axis];
        match k {
            0 => [0.0, -self.ring],
            k if k == n + 2 => [(n - 1) as f64, 1.0 + self.ring],
            k if k == n + 1 => [(n - 1) as f64, 1.0],
            k => [(k - 1) as f64, 0.0],
        }
    }

    pub(crate) fn index(&self, [i, j]: [usize; 2]) -> usize {
        i * (self.cells[1] + 1) + j
    }

    fn cell(&self, index: usize) -> [usize; 2] {
        [index / self.cells[1], index % self.cells[1]]
    }

    pub(crate) fn corners(&self, [i, j]: [usize; 2]) -> Corners {
        Corners([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|at| self.points[self.index(at)]))
    }

    /// Line number (fraction between lines) along an axis in cell `k` at `u`, in cells of the sheet.
    fn parameter(&self, k: usize, u: f64, axis: usize) -> f64 {
        let n = self.sheet[axis];
        let line = match (self.ring == 0.0, k) {
            (true, k) => k as f64 + u,
            (_, 0) => self.ring * (u - 1.0),
            (_, k) if k == n + 1 => n as f64 + self.ring * u,
            (_, k) => (k - 1) as f64 + u,
        };
        line / n as f64
    }

    /// ∂u/∂s in cell `k`.
    fn rate(&self, k: usize, axis: usize) -> f64 {
        let n = self.sheet[axis];
        let is_ring = self.ring != 0.0 && (k == 0 || k == n + 1);
        n as f64 / if is_ring { self.ring } else { 1.0 }
    }
}

/// Corners a, b, c, d of a cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Corners(pub(crate) [DVec2; 4]);

impl Corners {
    /// (1).
    pub(crate) fn at(&self, u: f64, v: f64) -> DVec2 {
        let [a, b, c, d] = self.0;
        let (e, f) = (b - a, d - a);
        a + u * e + v * f + u * v * ((c - d) - e)
    }

    /// ∂x/∂(u, v).
    pub(crate) fn slope(&self, u: f64, v: f64) -> DMat2 {
        let [a, b, c, d] = self.0;
        DMat2::from_cols((1.0 - v) * (b - a) + v * (c - d), (1.0 - u) * (d - a) + u * (c - b))
    }

    /// Sides, counter-clockwise.
    fn sides(&self) -> [[DVec2; 2]; 4] {
        let [a, b, c, d] = self.0;
        [[a, b], [b, c], [c, d], [d, a]]
    }

    /// Whether x is on none of the right sides of its sides: inside or on the border of a convex cell.
    fn hold(&self, x: DVec2) -> bool {
        self.sides().iter().all(|[p, q]| turn(*p, *q, x) >= 0.0)
    }

    /// 1: a convex cell, counter-clockwise, perhaps with a side of no length; 0: no area; −1: mirrored or not convex.
    fn orientation(&self) -> i8 {
        let [a, b, c, d] = self.0;
        let turns = [turn(d, a, b), turn(a, b, c), turn(b, c, d), turn(c, d, a)];
        // No reflex corner and one turn in all: the diagonals part the other corners as well.
        let is_convex = turns.iter().all(|t| *t >= 0.0);
        match (is_convex, turns.iter().any(|t| *t > 0.0)) {
            (true, true) => 1,
            (true, false) => 0,
            (false, _) => -1,
        }
    }

    /// (u, v) of x by (1), also beyond the cell where its sides go on.
    pub(crate) fn inverse(&self, x: DVec2) -> DVec2 {
        /// Newton's steps. More: none changes the result; fewer: long thin cells keep the rounding of the closed form.
        const STEPS: usize = 3;
        let [a, b, c, d] = self.0;
        let (r, e, f) = (x - a, b - a, d - a);
        let g = (c - d) - e;
        let (qa, qb, qc) = (g.perp_dot(f), r.perp_dot(g) + e.perp_dot(f), r.perp_dot(e));
        // The square of a Jacobian determinant: below 0 by rounding alone, where that is 0.
        let root = (qb * qb - 4.0 * qa * qc).max(0.0).sqrt();
        let v = match (qb >= 0.0 && qb + root > 0.0, qa == 0.0) {
            (true, _) => -2.0 * qc / (qb + root),
            (false, false) => (root - qb) / (2.0 * qa),
            // On a side of no length all v are one point: its middle stands for them.
            (false, true) => 0.5,
        };
        let along = e + v * g;
        let length = along.length_squared();
        // The same for u.
        let u = if length > 0.0 { (r - v * f).dot(along) / length } else { 0.5 };
        /// What is missing is rounding where it is less than this part of the place. Larger: digits are lost; smaller: steps that change nothing.
        const ROUNDING: f64 = 2.0 * f64::EPSILON;
        let mut best = DVec2::new(u, v);
        let mut missing = x - self.at(u, v);
        for _ in 0..STEPS {
            let slope = self.slope(best.x, best.y);
            if missing.length_squared() <= ROUNDING * ROUNDING * x.length_squared() || slope.determinant() == 0.0 {
                break;
            }
            let next = best + slope.inverse() * missing;
            let left = x - self.at(next.x, next.y);
            let is_better = left.length_squared() < missing.length_squared();
            if !is_better {
                break;
            }
            (best, missing) = (next, left);
        }
        best
    }
}

/// More than 0 where x is to the left of the way from p to q, 0 on their line: exact.
pub(crate) fn turn(p: DVec2, q: DVec2, x: DVec2) -> f64 {
    let coord = |x: DVec2| Coord { x: x.x, y: x.y };
    orient2d(coord(p), coord(q), coord(x))
}

/// Which cells come near a place.
#[derive(Clone, Debug)]
struct Bins {
    low: DVec2,
    high: DVec2,
    per_length: DVec2,
    counts: [usize; 2],
    /// Cells of bin b, ascending: `cells[starts[b]..starts[b + 1]]`.
    starts: Vec<u32>,
    cells: Vec<u32>,
}

/// Bins per cell. More: more memory, and cells that are in more bins; fewer: more cells to try for each point.
const BINS: f64 = 4.0;

impl Bins {
    fn of(grid: &Grid) -> Self {
        let (low, high) = box_of(&grid.points);
        let size = high - low;
        let cells = grid.cells[0] * grid.cells[1];
        let per_side = (BINS * cells as f64 / (size.x * size.y)).sqrt(); // bins per length
        let counts = size.to_array().map(|side| ((side * per_side).ceil() as usize).clamp(1, 4 * cells));
        let per_length = DVec2::new(counts[0] as f64, counts[1] as f64) / size;
        let mut bins = Self { low, high, per_length, counts, starts: Vec::new(), cells: Vec::new() };
        let mut lists = vec![Vec::new(); counts[0] * counts[1]];
        for cell in 0..cells {
            let (low, high) = box_of(&grid.corners(grid.cell(cell)).0);
            bins.touched(low, high).for_each(|bin| lists[bin].push(cell as u32));
        }
        bins.starts = std::iter::once(0)
            .chain(lists.iter().scan(0, |end, list| {
                *end += list.len() as u32;
                Some(*end)
            }))
            .collect();
        bins.cells = lists.concat();
        bins
    }

    /// Along both axes the bin of a place; places beyond belong to the nearest.
    fn bin(&self, x: DVec2) -> [usize; 2] {
        let at = (x - self.low) * self.per_length;
        [0, 1].map(|axis| (at[axis] as usize).min(self.counts[axis] - 1)) // below 0 becomes 0
    }

    fn touched(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = usize> + use<> {
        let ([i0, j0], [i1, j1], columns) = (self.bin(low), self.bin(high), self.counts[1]);
        (i0..=i1).flat_map(move |i| (j0..=j1).map(move |j| i * columns + j))
    }

    fn cells(&self, bin: usize) -> &[u32] {
        &self.cells[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }
}

fn box_of(points: &[DVec2]) -> (DVec2, DVec2) {
    points.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
}

impl Locator {
    /// For the places on `sheet`.
    pub(crate) fn new(sheet: &Sheet) -> Result<Self, LocateError> {
        let grid = Grid::of(sheet);
        if let Some(at) = grid.points.iter().position(|x| !x.is_finite()) {
            let columns = grid.cells[1] + 1;
            return Err(LocateError::NotFinite { point: [at / columns, at % columns], place: grid.points[at] });
        }
        Self::over(grid, |count, cell| LocateError::Folded { count, cell })
    }

    /// For the places on `sheet`, which is good for [`Locator::new`], and on a ring round it.
    pub(crate) fn ringed(sheet: &Sheet, width: f64) -> Result<Self, LocateError> {
        let clamped = |[i, j]: [usize; 2]| {
            [i.saturating_sub(1).min(sheet.cells()[0] - 1), j.saturating_sub(1).min(sheet.cells()[1] - 1)]
        };
        Self::over(Grid::ringed(sheet, width), |_, cell| LocateError::Meet { cell: clamped(cell), cells: width })
    }

    fn over(grid: Grid, folded: impl Fn(usize, [usize; 2]) -> LocateError) -> Result<Self, LocateError> {
        let corners: Vec<Corners> =
            (0..grid.cells[0] * grid.cells[1]).map(|cell| grid.corners(grid.cell(cell))).collect();
        let orientations: Vec<i8> = corners.iter().map(Corners::orientation).collect();
        if let Some(first) = orientations.iter().position(|o| *o < 0) {
            let count = orientations.iter().filter(|o| **o < 0).count();
            return Err(folded(count, grid.cell(first)));
        }
        if orientations.iter().all(|o| *o == 0) {
            return Err(LocateError::NoArea);
        }
        let (low, high) = box_of(&grid.points);
        let is_empty = orientations.iter().map(|o| *o == 0).collect();
        let located = Self { bins: Bins::of(&grid), corners, is_empty, grid, extent: (high - low).max_element() };
        match located.crossing() {
            Some(near) => Err(LocateError::Overlap { near }),
            None => Ok(located),
        }
    }

    /// Longest side of the grid's box.
    pub(crate) fn extent(&self) -> f64 {
        self.extent
    }

    /// Where x is; none beyond the grid.
    pub(crate) fn place(&self, x: DVec2) -> Option<Place> {
        let holds = |cell: &&u32| !self.is_empty[**cell as usize] && self.corners[**cell as usize].hold(x);
        self.near(x)?.iter().find(holds).map(|cell| self.place_in(*cell as usize, x))
    }

    /// Cells that may hold x, ascending; none beyond the box of the grid.
    fn near(&self, x: DVec2) -> Option<&[u32]> {
        let Bins { low, high, .. } = self.bins;
        let [i, j] = self.bins.bin(x);
        let is_in_box = (x.cmpge(low) & x.cmple(high)).all();
        is_in_box.then(|| self.bins.cells(i * self.bins.counts[1] + j))
    }

    fn place_in(&self, number: usize, x: DVec2) -> Place {
        /// Parameters so near the borders of the surface are on it. Larger: places near a pole are taken for it; smaller: the pole itself, where a
        /// surface knows its normal, is missed by rounding.
        const ROUNDINGS: f64 = 16.0 * f64::EPSILON;
        let (corners, cell) = (&self.corners[number], self.grid.cell(number));
        let at = corners.inverse(x);
        let slope = corners.slope(at.x, at.y);
        let parameter = |axis: usize| {
            let parameter = self.grid.parameter(cell[axis], at[axis], axis);
            [0.0, 1.0].into_iter().find(|border| (parameter - border).abs() <= ROUNDINGS).unwrap_or(parameter)
        };
        Place {
            parameters: DVec2::new(parameter(0), parameter(1)),
            slope: DMat2::from_cols(
                slope.x_axis * self.grid.rate(cell[0], 0),
                slope.y_axis * self.grid.rate(cell[1], 1),
            ),
        }
    }

    /// Where x is, if it were on the cell whose border is nearest; and how far that is.
    pub(crate) fn nearest(&self, x: DVec2) -> (Place, f64) {
        let near = |[p, q]: [DVec2; 2]| {
            let length = (q - p).length_squared();
            let along = if length > 0.0 { ((x - p).dot(q - p) / length).clamp(0.0, 1.0) } else { 0.0 };
            x.distance(p.lerp(q, along))
        };
        let sides = self.boundary().map(|(cell, side)| (cell, near(side)));
        let (cell, distance) = sides.min_by(|a, b| a.1.total_cmp(&b.1)).expect("a grid has a boundary");
        (self.place_in(cell[0] * self.grid.cells[1] + cell[1], x), distance)
    }

    /// The sides of cells at the boundary, counter-clockwise, cells without area left out.
    fn boundary(&self) -> impl Iterator<Item = ([usize; 2], [DVec2; 2])> {
        let [m, n] = self.grid.cells;
        let bottom = (0..m).map(|i| ([i, 0], 0));
        let right = (0..n).map(move |j| ([m - 1, j], 1));
        let top = (0..m).rev().map(move |i| ([i, n - 1], 2));
        let left = (0..n).rev().map(|j| ([0, j], 3));
        let all = bottom.chain(right).chain(top).chain(left);
        let kept = all.filter(|([i, j], _)| !self.is_empty[i * self.grid.cells[1] + j]);
        kept.map(|(cell, side)| (cell, self.grid.corners(cell).sides()[side]))
    }

    /// A point near which two sides of the boundary cross: a grid of convex cells whose boundary does not cross itself covers no place twice.
    fn crossing(&self) -> Option<DVec2> {
        let mut sides: Vec<[DVec2; 2]> = self.boundary().map(|(_, side)| side).collect();
        sides.sort_by(|p, q| p[0].x.min(p[1].x).total_cmp(&q[0].x.min(q[1].x)));
        for (k, [p, q]) in sides.iter().enumerate() {
            let right = p.x.max(q.x);
            let rivals = sides[k + 1..].iter().take_while(|[r, s]| r.x.min(s.x) <= right);
            for [r, s] in rivals {
                let parts = |a: f64, b: f64| (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0);
                if parts(turn(*p, *q, *r), turn(*p, *q, *s)) && parts(turn(*r, *s, *p), turn(*r, *s, *q)) {
                    return Some(*p);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(places: [[f64; 2]; 4]) -> Corners {
        Corners(places.map(DVec2::from_array))
    }

    /// Cells of all kinds, counter-clockwise.
    fn cells() -> Vec<(&'static str, Corners)> {
        vec![
            ("square", corners([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])),
            ("parallelogram", corners([[0.0, 0.0], [2.0, 0.5], [2.5, 1.5], [0.5, 1.0]])),
            ("trapezoid along u", corners([[0.0, 0.0], [3.0, 0.0], [2.0, 1.0], [1.0, 1.0]])),
            ("trapezoid along v", corners([[0.0, 0.0], [1.0, 1.0], [1.0, 2.0], [0.0, 3.0]])),
            ("almost a parallelogram", corners([[0.0, 0.0], [1.0, 0.0], [1.0 + 1e-13, 1.0], [0.0, 1.0]])),
            ("triangle, first side", corners([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [-1.0, 1.0]])),
            ("triangle, second side", corners([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])),
            ("triangle, third side", corners([[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [0.5, 1.0]])),
            ("triangle, fourth side", corners([[0.0, 0.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0]])),
            ("straight corner", corners([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [0.0, 1.0]])),
            ("thin", corners([[0.0, 0.0], [1.0, 0.0], [1.0, 1e-9], [0.0, 2e-9]])),
            ("far away", corners([[1e6, 0.0], [1e6 + 1.0, 0.25], [1e6 + 1.25, 1.5], [1e6, 1.0]])),
        ]
    }

    #[test]
    fn places_in_cells_are_found_again() {
        for (name, cell) in cells() {
            assert_eq!(cell.orientation(), 1, "{name}");
            let extent = cell.0.iter().map(|x| x.abs().max_element()).fold(0.0, f64::max);
            for k in 0..=400 {
                let x = cell.at((k % 20) as f64 / 20.0, (k / 20) as f64 / 20.0);
                let at = cell.inverse(x);
                assert!(cell.at(at.x, at.y).distance(x) <= 1e-15 * extent, "{name} {at}");
                let tolerance = DVec2::splat(1e-6); // corners without derivative are roots of rounding
                assert!((at.cmpge(-tolerance) & at.cmple(1.0 + tolerance)).all(), "{name} {at}");
            }
        }
    }

    #[test]
    fn a_point_on_a_side_of_no_length_stands_for_its_middle() {
        let cell = corners([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [-1.0, 1.0]]);
        assert_eq!(cell.inverse(DVec2::ZERO), DVec2::new(0.5, 0.0));
    }

    #[test]
    fn cells_are_convex_counter_clockwise_or_refused() {
        let of = |places| corners(places).orientation();
        assert_eq!(of([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]), -1, "mirrored");
        assert_eq!(of([[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]]), -1, "an arrow");
        assert_eq!(of([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]), -1, "a bow tie");
        assert_eq!(of([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.5, 0.0]]), 0, "a line");
        assert_eq!(of([[1.0, 1.0]; 4]), 0, "a point");
    }

    #[test]
    fn a_point_on_a_shared_side_is_in_the_first_cell() {
        let flat = (0..9).map(|k| DVec2::new((k / 3) as f64, (k % 3) as f64 * 0.1)).collect();
        let plane = crate::Surface::plane(glam::DVec3::ZERO, [glam::DVec3::X, glam::DVec3::Y]);
        let locator = Locator::new(&Sheet::new(plane, [2, 2], flat)).unwrap();
        for (x, expected) in [([1.0, 0.05], [0.5, 0.25]), ([1.0, 0.1], [0.5, 0.5]), ([2.0, 0.2], [1.0, 1.0])] {
            let place = locator.place(x.into()).unwrap();
            assert!(place.parameters.distance(expected.into()) < 1e-15);
            assert!(place.slope.abs_diff_eq(DMat2::from_diagonal(DVec2::new(2.0, 0.2)), 1e-15));
        }
        assert_eq!(locator.place(DVec2::new(1.0, -1e-300)), None);
        assert_eq!(locator.nearest(DVec2::new(1.5, 0.5)).1, 0.3);
    }
}
