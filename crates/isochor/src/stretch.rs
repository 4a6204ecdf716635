//! How well a sheet keeps lengths and areas.
//!
//! Each cell is cut along each of its diagonals, which gives four triangles. A triangle on the surface is taken to be the flat one with the
//! same geodesic lengths of its sides; the affine map from there to the sheet has singular values σ₁ ≥ σ₂, its stretches. So a sheet whose lengths
//! are those of the surface has no stretch at all, however coarse its cells.
//!
//! A fold is a cell in whose bilinear map `(s, t) → X` the determinant of the derivative is not positive at some corner: there
//! the cross product of the sides at the corner has the wrong sign.

use glam::{DMat2, DVec2};

use crate::flatten::FlattenStatus;
use crate::stress::Stress;

/// What became of lengths and areas in a flattened sheet, and how it was found.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FlattenReport {
    /// Why the search ended.
    pub status: FlattenStatus,
    /// Number of steps taken.
    pub iterations: usize,
    /// The stress, in the surface's unit of length squared (times weights).
    pub stress: f64,
    /// The stress of the start.
    pub start_stress: f64,
    /// The largest estimated relative error of geodesic lengths; 0 for closed forms.
    pub length_accuracy: f64,
    /// The largest linear stretch of any cell, in percent: 1 where something got 1 % longer. 0 or more.
    pub stretch: f64,
    /// The largest linear compression of any cell, in percent: 1 where something got 1 % shorter. 0 or more.
    pub compression: f64,
    /// Largest and smallest linear change of each cell, in percent, at `i · cells[1] + j`; both 0 in a cell without area on the surface.
    pub cells: Vec<CellStretch>,
    /// Relative errors of lengths within reach. Lengths of 0 do not count.
    pub length_error: SheetError,
    /// Relative errors of the areas of cells. Areas of 0 do not count.
    pub area_error: SheetError,
    /// Cells (i, j) that are folded.
    pub folds: Vec<[usize; 2]>,
}

/// The linear changes of a cell, in percent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CellStretch {
    /// The largest: 100 (σ₁ − 1).
    pub largest: f64,
    /// The smallest: 100 (σ₂ − 1), negative where something is compressed.
    pub smallest: f64,
}

/// Relative errors of what a sheet should have kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SheetError {
    /// The largest absolute value.
    pub max: f64,
    /// The root of the mean square.
    pub rms: f64,
}

impl SheetError {
    fn of(errors: &[f64]) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        let max = errors.iter().map(|e| e.abs()).fold(0.0, f64::max);
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        Self { max, rms: (squares / errors.len() as f64).sqrt() }
    }
}

/// What a flattened grid has kept.
pub(crate) struct Kept {
    pub(crate) cells: Vec<CellStretch>,
    pub(crate) length_error: SheetError,
    pub(crate) area_error: SheetError,
    pub(crate) folds: Vec<[usize; 2]>,
}

/// Of the grid of `cells` at `flat`, whose stress knows the lengths on the surface.
pub(crate) fn kept(stress: &Stress, cells: [usize; 2], flat: &[DVec2]) -> Kept {
    let mut lengths = Vec::new();
    stress.for_each_pair(|i, j, d, _| {
        if d > 0.0 {
            lengths.push(flat[i].distance(flat[j]) / d - 1.0);
        }
    });
    let mut stretches = Vec::with_capacity(cells[0] * cells[1]);
    let mut areas = Vec::with_capacity(cells[0] * cells[1]);
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            let cell = Cell::new(stress, cells, flat, [i, j]);
            stretches.push(cell.stretch());
            areas.extend(cell.area_error());
        }
    }
    let folds = folds(stress, cells, flat);
    Kept { cells: stretches, length_error: SheetError::of(&lengths), area_error: SheetError::of(&areas), folds }
}

/// The cells that are folded, each corner of which that is one point with the next along a side does not count.
pub(crate) fn folds(stress: &Stress, cells: [usize; 2], flat: &[DVec2]) -> Vec<[usize; 2]> {
    let all = (0..cells[0]).flat_map(|i| (0..cells[1]).map(move |j| [i, j]));
    all.filter(|cell| Cell::new(stress, cells, flat, *cell).is_folded()).collect()
}

/// A cell's corners in the sheet, counter-clockwise from (i, j), and lengths on the surface.
struct Cell {
    corners: [DVec2; 4],
    /// From each corner to the next.
    sides: [f64; 4],
    /// From corner 0 to 2, and from 1 to 3.
    diagonals: [f64; 2],
}

impl Cell {
    fn new(stress: &Stress, cells: [usize; 2], flat: &[DVec2], [i, j]: [usize; 2]) -> Self {
        let at = |i: usize, j: usize| flat[i * (cells[1] + 1) + j];
        Self {
            corners: [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            sides: [
                stress.length([i, j], [1, 0]),
                stress.length([i + 1, j], [0, 1]),
                stress.length([i, j + 1], [1, 0]),
                stress.length([i, j], [0, 1]),
            ],
            diagonals: [stress.length([i, j], [1, 1]), stress.length([i, j + 1], [1, -1])],
        }
    }

    /// Lengths on the surface of the sides from corner k to the next and to the one before, and between these two.
    fn triangle(&self, k: usize) -> [f64; 3] {
        [self.sides[k], self.sides[(k + 3) % 4], self.diagonals[(k + 1) % 2]]
    }

    fn stretch(&self) -> CellStretch {
        let mut found: Option<[f64; 2]> = None;
        for k in 0..4 {
            let [a, b, c] = self.triangle(k);
            let double_area = 2.0 * area(a, b, c);
            if double_area > 0.0 {
                let x = (a * a + b * b - c * c) / (2.0 * a);
                let surface = DMat2::from_cols(DVec2::new(a, 0.0), DVec2::new(x, double_area / a));
                let corner = self.corners[k];
                let sheet = DMat2::from_cols(self.corners[(k + 1) % 4] - corner, self.corners[(k + 3) % 4] - corner);
                let [largest, smallest] = singular_values(sheet * surface.inverse());
                let [most, least] = found.unwrap_or([largest, smallest]);
                found = Some([most.max(largest), least.min(smallest)]);
            }
        }
        let [largest, smallest] = found.unwrap_or([1.0, 1.0]);
        CellStretch { largest: 100.0 * (largest - 1.0), smallest: 100.0 * (smallest - 1.0) }
    }

    /// Relative; none where it has no area on the surface, for which the mean of both ways to cut it is taken.
    fn area_error(&self) -> Option<f64> {
        let on_surface = 0.5 * (0..4).map(|k| self.triangle(k)).map(|[a, b, c]| area(a, b, c)).sum::<f64>();
        let [p, q, r, s] = self.corners;
        let flat = 0.5 * (r - p).perp_dot(s - q);
        (on_surface > 0.0).then(|| flat / on_surface - 1.0)
    }

    fn is_folded(&self) -> bool {
        (0..4).any(|k| {
            let [next, last] = [self.corners[(k + 1) % 4], self.corners[(k + 3) % 4]];
            let is_corner = self.sides[k] > 0.0 && self.sides[(k + 3) % 4] > 0.0;
            is_corner && (next - self.corners[k]).perp_dot(last - self.corners[k]) <= 0.0
        })
    }
}

/// Of the triangle with the given sides; 0 where there is none. W. Kahan, *Miscalculating Area and Angles of a Needle-like Triangle*, 2014.
fn area(a: f64, b: f64, c: f64) -> f64 {
    let mut sides = [a, b, c];
    sides.sort_by(f64::total_cmp);
    let [c, b, a] = sides;
    let square = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    if square > 0.0 { 0.25 * square.sqrt() } else { 0.0 }
}

/// The larger first.
fn singular_values(m: DMat2) -> [f64; 2] {
    let turned = DVec2::new(m.x_axis.x + m.y_axis.y, m.x_axis.y - m.y_axis.x).length();
    let mirrored = DVec2::new(m.x_axis.x - m.y_axis.y, m.x_axis.y + m.y_axis.x).length();
    [0.5 * (turned + mirrored), 0.5 * (turned - mirrored).abs()]
}
