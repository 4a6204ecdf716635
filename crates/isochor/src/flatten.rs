//! A surface, flattened: a grid on it is laid into the plane so that lengths change as little as they can.
//!
//! Given grid points `P_i = S(s_i, t_j)`, find X_i in the plane that minimise
//!
//! ```text
//! C(X) = Σ_i Σ_{j∈Ω_i} w_ij (d_ij − |X_i − X_j|)²                                              (1)
//! ```
//!
//! where Ω_i are the grid points other than i within `reach` steps in both directions, and d_ij geodesic lengths. CO, section 3.1 and appendix,
//! after S. D. Ma, H. Lin, *Optimal texture mapping*, Eurographics 1988.
//!
//! A closed direction is cut at its seam, s = 0 ≡ 1 or t = 0 ≡ 1: both sides have grid points of their own, and Ω does not reach across.
//!
//! # Changes versus the paper
//!
//! - Lengths are those of geodesics ([`crate::Surface::geodesic_length`]), so that a developable surface comes out isometric.
//! - The search begins with the grid unrolled from its middle, which is the development of a developable surface, instead of a start that is not
//!   told.
//! - Steps are those of L-BFGS (J. Nocedal, S. J. Wright, *Numerical Optimization*, 2006, algorithm 7.4), on an approximate inverse of the second
//!   derivative by levels of grids, and only ever go down. The paper's descent with a fixed step, `X ← X − ρ ∂C/∂X`, is
//!   [`FlattenMethod::Descent`].
//! - The sheet has a place: its box is centred on the origin, s goes along +x in the middle of the sheet, and t to the left of it. It is never
//!   mirrored.

use glam::DVec2;

use crate::descent::{self, State, Way};
use crate::geodesic::{self, GridLengths, Station, grid_lengths, plane_lengths};
use crate::parallel;
use crate::sheet::Sheet;
use crate::stress::Stress;
use crate::stretch::{CellStretch, FlattenReport, Kept, folds, kept};
use crate::surface::{Jet, Surface, Third};
use crate::unroll::{Ribs, unrolled};

/// How a surface is flattened.
#[derive(Clone, Debug, PartialEq)]
pub struct FlattenOptions {
    /// Cells along s and t.
    pub cells: [usize; 2],
    /// How many grid steps lengths reach, in both directions. With 1 sheets may fold (CO, figure 2); more keep lengths over larger distances, and
    /// take longer.
    pub reach: usize,
    /// How the minimum is looked for.
    pub method: FlattenMethod,
    /// Where from.
    pub start: FlattenStart,
    /// What errors of lengths count.
    pub weights: FlattenWeights,
    /// Lengths on the surface are taken to this relative error; and to a fifth of what those on the sheet are off by, down to 1e-7, where that is
    /// less. Smaller: it takes longer.
    pub accuracy: f64,
    /// The search ends where a step lowers the stress by no more than this fraction of it.
    pub tolerance: f64,
    /// It ends after so many steps, too.
    pub iterations: usize,
}

impl Default for FlattenOptions {
    fn default() -> Self {
        Self {
            cells: [32, 32],
            reach: 3,
            method: FlattenMethod::default(),
            start: FlattenStart::default(),
            weights: FlattenWeights::default(),
            accuracy: 5e-4,
            tolerance: 1e-6,
            iterations: 1000,
        }
    }
}

/// How the least stress is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FlattenMethod {
    /// L-BFGS. It goes down with each step, and on below the tolerance while its model of the stress says that there is more than
    /// the tolerance to gain.
    #[default]
    QuasiNewton,
    /// The paper's descent with a fixed step.
    Descent {
        /// ρ: each point moves by ρ times the negative gradient. Below about `1 / (4 · number of points in Ω)` it goes down; with more it runs away.
        step: f64,
    },
}

/// Where the search begins.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum FlattenStart {
    /// The grid unrolled from a line in its middle, along the direction that makes for less stress and no fold; the rectangle where
    /// both fold.
    #[default]
    Unrolled,
    /// A rectangle whose rows and columns have the mean lengths of those on the surface. It never folds.
    Rectangle,
    /// Given places of the grid points, (i, j) at `i · (cells[1] + 1) + j`.
    Places(Vec<DVec2>),
}

/// What an error of a length counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FlattenWeights {
    /// 1: errors of lengths count, those of long ones more; the paper's.
    #[default]
    Uniform,
    /// `(d̄/d)²`, d̄ the mean length: relative errors count. For grids whose cells differ much in size. Lengths of 0, at poles, have none.
    Relative,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "kebab-case"))]
pub enum FlattenStatus {
    /// There is no more to gain than the tolerance, or than rounding allows.
    Converged,
    /// It took all its steps.
    IterationLimit,
    /// The stress went up: the step of the descent is too large. The sheet is the best that was found.
    Diverged,
}

/// A flattened surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Flattened {
    /// The sheet.
    pub sheet: Sheet,
    /// How good it is.
    pub report: FlattenReport,
    /// The stress of the start and after each step. Where lengths were taken anew, all steps before that count as one.
    pub course: Vec<f64>,
}

/// Why a surface is not flattened.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FlattenError {
    /// No cells in one direction.
    #[error("the grid has {} by {} cells: it needs at least one in each direction", .cells[0], .cells[1])]
    NoCells {
        /// Along s and t.
        cells: [usize; 2],
    },
    /// A reach of 0.
    #[error("a reach of 0 holds no lengths: it needs at least 1, and 3 keeps sheets from folding")]
    NoReach,
    /// An accuracy that is not a positive number.
    #[error("the accuracy of lengths is {0}: it must be above 0; 5e-4 is good for surfaces that are not developable")]
    Accuracy(f64),
    /// A tolerance that is negative or not a number.
    #[error("the tolerance is {0}: it must be 0 or more")]
    Tolerance(f64),
    /// A step that is not a positive number.
    #[error("the descent's step is {0}: it must be above 0; about 1 / (4 · number of points within reach) is good")]
    Step(f64),
    /// A start with another number of places than grid points.
    #[error("the start has {places} places, but the grid has {points} points")]
    Places {
        /// Given places.
        places: usize,
        /// Grid points.
        points: usize,
    },
    /// A place of the start that is infinite or not a number.
    #[error("the start's place {index} is not finite")]
    PlaceNotFinite {
        /// Its index.
        index: usize,
    },
    /// A point or derivative of the surface that is infinite or not a number, or too large to be squared.
    #[error("the surface is not finite, or too large, at s = {}, t = {}", .at.x, .at.y)]
    NotFinite {
        /// Parameters.
        at: DVec2,
    },
    /// A place where the surface has no tangent plane.
    #[error(
        "the surface has no tangent plane at s = {}, t = {}: a pole, an apex or a crease; take a part of the surface without it", .at.x, .at.y
    )]
    NoTangentPlane {
        /// Parameters.
        at: DVec2,
    },
    /// Two grid points between which no geodesic is found.
    #[error(
        "no geodesic is found from s = {}, t = {} to s = {}, t = {}: more cells or a smaller reach make the way shorter", .from.x, .from.y, .to.x, .to.y
    )]
    NoGeodesic {
        /// Parameters of one end.
        from: DVec2,
        /// Parameters of the other.
        to: DVec2,
    },
    /// A length of 0, which has no relative error.
    #[error(
        "the grid points at s = {}, t = {} and s = {}, t = {} are one point of the surface, a pole, and relative weights do not count \
         lengths of 0: take uniform ones, or a part of the surface without it", .from.x, .from.y, .to.x, .to.y
    )]
    NoWeight {
        /// Parameters of one.
        from: DVec2,
        /// Parameters of the other.
        to: DVec2,
    },
}

/// Lengths on a sheet are to be off, in root mean square, by at least so many times the error of those on the surface, or these are taken anew. Larger: they are
/// better than can be seen in the sheet; smaller: their errors are.
const TIMES: f64 = 5.0;

/// Grid points whose jets one thread evaluates. Larger: small grids leave threads idle; smaller: threads are woken for little.
const JETS: usize = 32;

/// The sheet of least stress of `surface`.
///
/// Costs about `iterations · (cells[0] + 1) · (cells[1] + 1) · (2 reach + 1)²/2` square roots, and as many geodesics as one iteration has
/// square roots.
///
/// # Errors
///
/// A grid without cells or lengths; a surface that is not finite, has no tangent plane at a grid point or no geodesics between them; numbers out of
/// range in the options. A search that does not converge is no error: see [`FlattenReport::status`].
pub fn flatten(surface: &Surface, options: &FlattenOptions) -> Result<Flattened, FlattenError> {
    let &FlattenOptions { cells, tolerance, .. } = options;
    if cells.contains(&0) {
        return Err(FlattenError::NoCells { cells });
    }
    if options.reach == 0 {
        return Err(FlattenError::NoReach);
    }
    if !(options.accuracy > 0.0 && options.accuracy.is_finite()) {
        return Err(FlattenError::Accuracy(options.accuracy));
    }
    if tolerance.is_nan() || tolerance < 0.0 {
        return Err(FlattenError::Tolerance(tolerance));
    }
    let points = (cells[0] + 1) * (cells[1] + 1);
    let both = parallel::map_chunks(points, JETS, |part| {
        let at = |k| parameters(cells, k);
        part.map(|k| surface.jet_and_third(at(k).x, at(k).y)).collect::<Vec<_>>()
    });
    let (jets, thirds): (Vec<Jet>, Vec<Third>) = both.into_iter().flatten().unzip();
    if let Some(k) = jets.iter().position(|jet| !is_finite(jet)) {
        return Err(FlattenError::NotFinite { at: parameters(cells, k) });
    }
    let mut accuracy = options.accuracy;
    let mut lengths = None;
    let mut last: Option<Way> = None;
    let (stress, length_accuracy, way) = loop {
        let taken = measured(surface, options, &jets, &thirds, accuracy, lengths.as_ref())?;
        let (stress, error) = (stressed(&taken, options)?, taken.error());
        let start = start(surface, options, &jets, &stress)?;
        let way = searched(&stress, start, last.take(), options)?;
        let off = (way.state.stress / stress.scale()).sqrt();
        if off >= TIMES * error || accuracy <= geodesic::LENGTH {
            break (stress, error, way);
        }
        accuracy = (off / TIMES).max(geodesic::LENGTH);
        (lengths, last) = (Some(taken), Some(way));
    };
    let flat = placed(way.state.places(), cells);
    let Kept { cells: stretches, length_error, area_error, folds } = kept(&stress, cells, &flat);
    let most = |of: fn(&CellStretch) -> f64| stretches.iter().map(of).fold(0.0, f64::max);
    let report = FlattenReport {
        status: way.status,
        iterations: way.course.len() - 1,
        stress: way.state.stress,
        start_stress: way.course[0],
        length_accuracy,
        stretch: most(|cell| cell.largest),
        compression: most(|cell| -cell.smallest),
        cells: stretches,
        length_error,
        area_error,
        folds,
    };
    Ok(Flattened { sheet: Sheet::new(surface.clone(), cells, flat), report, course: way.course })
}

/// Parameters of the grid point with index k.
fn parameters(cells: [usize; 2], k: usize) -> DVec2 {
    let [i, j] = [k / (cells[1] + 1), k % (cells[1] + 1)];
    DVec2::new(i as f64 / cells[0] as f64, j as f64 / cells[1] as f64)
}

fn is_finite(jet: &Jet) -> bool {
    let Jet { point, s, t, ss, st, tt } = jet;
    [point, s, t, ss, st, tt].into_iter().all(|v| v.length_squared().is_finite())
}

/// The way down from a start; the last way is its first step where that ends lower.
fn searched(stress: &Stress, start: State, last: Option<Way>, options: &FlattenOptions) -> Result<Way, FlattenError> {
    let &FlattenOptions { cells, tolerance, iterations, .. } = options;
    if !start.stress.is_finite() {
        return Err(FlattenError::NotFinite { at: parameters(cells, 0) });
    }
    let start_stress = start.stress;
    let last = last.map(|way| State::new(stress, way.state.x)).filter(|state| state.stress < start_stress);
    let (from, steps) = last.map_or((start, 0), |state| (state, 1));
    let iterations = iterations.saturating_sub(steps);
    let mut way = match options.method {
        FlattenMethod::QuasiNewton => descent::quasi_newton(stress, from, tolerance, iterations),
        FlattenMethod::Descent { step } if step > 0.0 && step.is_finite() => {
            descent::fixed(stress, from, step, tolerance, iterations)
        }
        FlattenMethod::Descent { step } => return Err(FlattenError::Step(step)),
    };
    if steps > 0 {
        way.course.insert(0, start_stress);
    }
    Ok(way)
}

/// Lengths with relative errors of no more than `accuracy` where that can be had; those taken `before` are kept where they are so good.
fn measured(
    surface: &Surface,
    options: &FlattenOptions,
    jets: &[Jet],
    thirds: &[Third],
    accuracy: f64,
    before: Option<&GridLengths>,
) -> Result<GridLengths, FlattenError> {
    let &FlattenOptions { cells, reach, .. } = options;
    // Steps longer than the grid reach nothing.
    let reach = reach.min(cells[0].max(cells[1]));
    if let Some(flat) = developed(surface, cells) {
        return Ok(plane_lengths(&flat, cells, reach));
    }
    let at = |[i, j]: [usize; 2]| parameters(cells, i * (cells[1] + 1) + j);
    let station = |k: usize| Station::new(parameters(cells, k), &jets[k], &thirds[k]);
    let stations: Vec<_> = (0..jets.len()).map(station).collect();
    grid_lengths(surface, &stations, at, cells, reach, accuracy, before).map_err(|(from, to)| {
        let pole = [from, to].into_iter().find(|[i, j]| stations[i * (cells[1] + 1) + j].is_none());
        match pole {
            Some(pole) => FlattenError::NoTangentPlane { at: at(pole) },
            None => FlattenError::NoGeodesic { from: at(from), to: at(to) },
        }
    })
}

/// The stress of the grid with these lengths.
fn stressed(lengths: &GridLengths, options: &FlattenOptions) -> Result<Stress, FlattenError> {
    let &FlattenOptions { cells, weights, .. } = options;
    let mean = match weights {
        FlattenWeights::Uniform => None,
        FlattenWeights::Relative => Some(lengths.mean()),
    };
    let weight = |d: f64| mean.map_or(1.0, |mean| (mean / d) * (mean / d));
    let stress = Stress::new(lengths, cells.map(|n| n + 1), weight);
    let mut missing = None;
    if mean.is_some() {
        stress.for_each_pair(|i, j, _, w| {
            if w.is_infinite() {
                missing.get_or_insert([i, j]);
            }
        });
    }
    match missing.map(|ends| ends.map(|k| parameters(cells, k))) {
        Some([from, to]) => Err(FlattenError::NoWeight { from, to }),
        None => Ok(stress),
    }
}

/// The grid in the development of a surface that has one in closed form.
fn developed(surface: &Surface, cells: [usize; 2]) -> Option<Vec<DVec2>> {
    let points = (cells[0] + 1) * (cells[1] + 1);
    (0..points).map(|k| parameters(cells, k)).map(|at| surface.development(at.x, at.y)).collect()
}

/// Whether the stress of `a` is less than that of `b` by more than rounding, which must not choose between the two of symmetric surfaces.
fn is_less(a: &State, b: &State) -> bool {
    /// Larger: a worse start is taken; smaller: rounding chooses.
    const SAME: f64 = 1e-9;
    a.stress < (1.0 - SAME) * b.stress
}

/// Where the search begins.
fn start(surface: &Surface, options: &FlattenOptions, jets: &[Jet], stress: &Stress) -> Result<State, FlattenError> {
    let cells = options.cells;
    match &options.start {
        FlattenStart::Unrolled => {
            if let Some(flat) = developed(surface, cells) {
                return Ok(State::at(stress, &flat));
            }
            let states = [Ribs::AlongT, Ribs::AlongS].map(|ribs| unrolled(jets, cells, ribs));
            let unfolded = states.into_iter().filter(|flat| folds(stress, cells, flat).is_empty());
            let least =
                unfolded.map(|flat| State::at(stress, &flat)).reduce(|a, b| if is_less(&b, &a) { b } else { a });
            Ok(least.unwrap_or_else(|| State::at(stress, &rectangle(stress, cells))))
        }
        FlattenStart::Rectangle => Ok(State::at(stress, &rectangle(stress, cells))),
        FlattenStart::Places(places) => {
            if places.len() != stress.points() {
                return Err(FlattenError::Places { places: places.len(), points: stress.points() });
            }
            match places.iter().position(|place| !place.is_finite()) {
                Some(index) => Err(FlattenError::PlaceNotFinite { index }),
                None => Ok(State::at(stress, places)),
            }
        }
    }
}

/// Rows and columns at the mean lengths between those on the surface.
fn rectangle(stress: &Stress, cells: [usize; 2]) -> Vec<DVec2> {
    let mut lines = [vec![0.0], vec![0.0]];
    for i in 0..cells[0] {
        let sum: f64 = (0..=cells[1]).map(|j| stress.length([i, j], [1, 0])).sum();
        lines[0].push(lines[0][i] + sum / (cells[1] + 1) as f64);
    }
    for j in 0..cells[1] {
        let sum: f64 = (0..=cells[0]).map(|i| stress.length([i, j], [0, 1])).sum();
        lines[1].push(lines[1][j] + sum / (cells[0] + 1) as f64);
    }
    let [x, y] = lines;
    x.iter().flat_map(|x| y.iter().map(move |y| DVec2::new(*x, *y))).collect()
}

/// The sheet where it belongs: not mirrored, s along +x in its middle, its box centred on the origin.
fn placed(mut flat: Vec<DVec2>, cells: [usize; 2]) -> Vec<DVec2> {
    let columns = cells[1] + 1;
    let at = |i: usize, j: usize| i * columns + j;
    let diagonals = |k: usize| {
        let [i, j] = [k / cells[1], k % cells[1]];
        (flat[at(i + 1, j + 1)] - flat[at(i, j)]).perp_dot(flat[at(i, j + 1)] - flat[at(i + 1, j)])
    };
    if (0..cells[0] * cells[1]).map(diagonals).sum::<f64>() < 0.0 {
        flat.iter_mut().for_each(|p| p.y = -p.y);
    }
    let middle = cells.map(|n| [n / 2, n.div_ceil(2)]);
    let [before, after] = if cells[0].is_multiple_of(2) { [middle[0][0] - 1, middle[0][1] + 1] } else { middle[0] };
    let along: DVec2 = middle[1].iter().map(|j| flat[at(after, *j)] - flat[at(before, *j)]).sum();
    let turn = along.try_normalize().unwrap_or(DVec2::X);
    flat.iter_mut().for_each(|p| *p = DVec2::new(turn.dot(*p), turn.perp_dot(*p)));
    let low = flat.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = flat.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let center = 0.5 * (low + high);
    flat.iter_mut().for_each(|p| *p -= center);
    flat
}
