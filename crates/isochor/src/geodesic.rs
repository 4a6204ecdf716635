//! Lengths of geodesics between two points of a surface.
//!
//! Given S and parameters a, b, find the length L of the geodesic x(σ) from S(a) to S(b), σ its arc length, that can be drawn out of the
//! straight line from a to b in the parameters. On a geodesic `x'' = κ N`, the normal curvature times the surface's normal, so
//! that by Euler and Maclaurin
//!
//! ```text
//! x(L) − x(0) = L/2 (T₀ + T₁) + L²/12 (κ₀ N₀ − κ₁ N₁) + O(L⁵)                                  (1)
//! ```
//!
//! with unit tangents T₀, T₁: three equations for L and the directions of T₀ and T₁ in their tangent planes. κ comes from the jets at the ends, so
//! an *arc* (1) takes no further point of the surface. Its relative error is `(κL)⁴/720` on a circle. Where that is too much, the
//! geodesic is cut in halves at the middle of the quintic with the arc's parameters, velocities and accelerations at its ends. Where
//! arcs meet at an angle, the point between goes against `T₁ of the one − T₀ of the other`, the gradient of the sum of lengths, until
//! that would gain nothing. Halving takes the error to a 16th, so `(16 L₂ − L₁)/15` has two orders more, two of these once
//! more, and their differences say how good they are.
//!
//! # Changes versus the paper
//!
//! CO's appendix has the "distance between P_i and P_j on the curved surface" and leaves open how it is found. The length of the straight line
//! in the parameters is too long (by 0.3 to 0.7 % on a cone three cells apart), and a sheet of such lengths is not isometric.

use glam::{DVec2, DVec3};

use crate::parallel;
use crate::surface::{Jet, Surface};

/// Lengths are taken to this relative error. Larger: developable surfaces come out stretched by as much; smaller: more points of the surface are
/// needed.
pub(crate) const LENGTH: f64 = 5e-7;

/// The error of a length extrapolated once, O(L⁶), is taken to be this times the change by halving, O(L⁴), to the power 3/2. Larger:
/// more geodesics are halved twice; smaller: errors are larger than they are said to be (2.2 is reached on cones).
const SIXTH: f64 = 4.0;

/// So often is a geodesic halved. Larger: surfaces with creases, on which no number of halves is enough, take longer; smaller: geodesics
/// half round a sphere, or along ripples, are not found.
const HALVINGS: u32 = 6;

/// So often do the points between arcs move before arcs are halved. Larger: time is spent on arcs that are too long to be right; smaller: more
/// arcs are needed for the same length.
const MOVES: usize = 12;

/// Ends of an arc whose tangents are at a larger angle than this cosine says are too far apart for (1). Larger: some arcs are halved for nothing;
/// smaller: (1) is used where its terms grow.
const NEAR: f64 = 0.5;

/// An arc whose mean velocity misses the difference of parameters by more than this fraction of its length is not the geodesic between them.
/// Larger: ways round the other side of a closed surface pass for it; smaller: arcs are halved for nothing.
const ASIDE: f64 = 0.5;

/// The length of a geodesic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodesic {
    /// Length, in the unit of the surface.
    pub length: f64,
    /// Estimated relative error of the length; 0 for closed forms.
    pub error: f64,
}

/// A point of a surface, prepared for arcs that end there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Station {
    parameters: DVec2,
    point: DVec3,
    normal: DVec3,
    first: [DVec3; 2],
    /// A tangent T has the parameter velocity `(dual[0]·T, dual[1]·T)`.
    dual: [DVec3; 2],
    second: [DVec3; 3],
    /// The normal parts of these: the second fundamental form.
    form: [f64; 3],
}

/// (1) between two stations.
#[derive(Clone, Copy, Debug)]
struct Arc {
    length: f64,
    tangents: [DVec3; 2],
    /// Parameters by arc length at both ends.
    velocities: [DVec2; 2],
}

impl Station {
    /// None where the surface has no tangent plane.
    pub(crate) fn new(parameters: DVec2, jet: &Jet) -> Option<Self> {
        let normal = jet.normal()?;
        let area = jet.s.cross(jet.t).dot(normal);
        let dual = [jet.t.cross(normal) / area, normal.cross(jet.s) / area];
        let is_finite = jet.point.is_finite() && dual[0].is_finite() && dual[1].is_finite();
        let second = [jet.ss, jet.st, jet.tt];
        let form = second.map(|v| v.dot(normal));
        is_finite.then_some(Self { parameters, point: jet.point, normal, first: [jet.s, jet.t], dual, second, form })
    }

    fn on(surface: &Surface, parameters: DVec2) -> Option<Self> {
        Self::new(parameters, &surface.jet(parameters.x, parameters.y))
    }

    fn velocity(&self, tangent: DVec3) -> DVec2 {
        DVec2::new(self.dual[0].dot(tangent), self.dual[1].dot(tangent))
    }

    /// Second derivative of the surface along a straight line in the parameters.
    fn second_along(&self, v: DVec2) -> DVec3 {
        v.x * v.x * self.second[0] + 2.0 * v.x * v.y * self.second[1] + v.y * v.y * self.second[2]
    }

    /// Normal curvature along a unit tangent with the parameter velocity `v`.
    fn curvature(&self, v: DVec2) -> f64 {
        self.form[0] * v.x * v.x + 2.0 * self.form[1] * v.x * v.y + self.form[2] * v.y * v.y
    }

    /// Second derivative of the parameters of a geodesic with the parameter velocity `v`, by arc length.
    fn acceleration(&self, v: DVec2) -> DVec2 {
        -self.velocity(self.second_along(v))
    }

    /// The unit tangent nearest to `direction`.
    fn tangent(&self, direction: DVec3) -> Option<DVec3> {
        (direction - direction.dot(self.normal) * self.normal).try_normalize()
    }
}

impl Arc {
    /// None where the ends are too far apart.
    fn between(p: &Station, q: &Station) -> Option<Self> {
        /// Directions and length are repeated until the length is expected to change by less than this fraction. Larger: the error of
        /// (1) is drowned; smaller: a round more.
        const SETTLED: f64 = 1e-9;
        /// Where they do not settle in so many rounds, the ends are too far apart.
        const ROUNDS: usize = 12;
        let chord = q.point - p.point;
        let mut tangents = [p.tangent(chord)?, q.tangent(chord)?];
        let mut length = chord.length();
        let mut last_change = f64::INFINITY;
        for _ in 0..ROUNDS {
            let velocities = [p.velocity(tangents[0]), q.velocity(tangents[1])];
            let curvatures = [p.curvature(velocities[0]), q.curvature(velocities[1])];
            // (1) along the sum of tangents: a L² + b L = c.
            let sum = tangents[0] + tangents[1];
            let bent = curvatures[0] * p.normal.dot(sum) - curvatures[1] * q.normal.dot(sum);
            let [a, b, c] = [bent / 12.0, 0.5 * sum.length_squared(), chord.dot(sum)];
            let discriminant = b * b + 4.0 * a * c;
            if discriminant < 0.0 || tangents[0].dot(tangents[1]) < NEAR {
                return None;
            }
            let settled = 2.0 * c / (b + discriminant.sqrt());
            let change = (settled - length).abs() / settled;
            // Changes fall by about the same factor from round to round.
            if change * change <= SETTLED * last_change.min(1.0) {
                // Another way round, as over the seam of a cylinder, is not the one that was asked for.
                let missed = q.parameters - p.parameters - 0.5 * settled * (velocities[0] + velocities[1]);
                let missed = missed.x * p.first[0] + missed.y * p.first[1];
                let arc = Self { length: settled, tangents, velocities };
                return (missed.length() <= ASIDE * settled).then_some(arc);
            }
            (length, last_change) = (settled, change);
            // x(L) − x(0) = L T₀ + L² (κ₀ N₀/3 + κ₁ N₁/6) + O(L⁴), and the same from the other end.
            let squared = length * length / 6.0;
            let first = p.tangent(chord - squared * curvatures[1] * q.normal)?;
            tangents = [first, q.tangent(chord + squared * curvatures[0] * p.normal)?];
        }
        None
    }

    /// Parameters of the middle, by the quintic between the ends.
    fn middle(&self, p: &Station, q: &Station) -> DVec2 {
        let v = self.velocities;
        let a = [p.acceleration(v[0]), q.acceleration(v[1])];
        0.5 * (p.parameters + q.parameters)
            + self.length * (5.0 / 32.0 * (v[0] - v[1]) + self.length / 64.0 * (a[0] + a[1]))
    }
}

/// The length of (1) between two stations; none where they are too far apart.
pub(crate) fn arc_length(p: &Station, q: &Station) -> Option<f64> {
    Arc::between(p, q).map(|arc| arc.length)
}

/// A way from station to station by arcs, none where stations are too far apart, in memory that is used again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Path {
    stations: Vec<Station>,
    arcs: Vec<Option<Arc>>,
    spare: Vec<Station>,
}

impl Path {
    /// One arc.
    fn begin(&mut self, p: &Station, q: &Station) {
        self.stations.clear();
        self.stations.extend([p, q]);
        self.span();
    }

    fn span(&mut self) {
        self.arcs.clear();
        self.arcs.extend(self.stations.windows(2).map(|ends| Arc::between(&ends[0], &ends[1])));
    }

    /// The sum of lengths, where no arc is missing.
    fn length(&self) -> Option<f64> {
        self.arcs.iter().map(|arc| arc.as_ref().map(|arc| arc.length)).sum()
    }

    /// Two arcs for each. None where a station has no tangent plane.
    fn halve(&mut self, surface: &Surface) -> Option<()> {
        self.spare.clear();
        for (ends, arc) in self.stations.windows(2).zip(&self.arcs) {
            let straight = 0.5 * (ends[0].parameters + ends[1].parameters);
            let middle = arc.as_ref().map_or(straight, |arc| arc.middle(&ends[0], &ends[1]));
            self.spare.extend([ends[0], Station::on(surface, middle)?]);
        }
        self.spare.extend(self.stations.last().copied());
        std::mem::swap(&mut self.stations, &mut self.spare);
        self.span();
        Some(())
    }
}

/// The geodesic between two stations; none where a point between them has no tangent plane, or no geodesic is found.
pub(crate) fn between(surface: &Surface, p: &Station, q: &Station, path: &mut Path) -> Option<Geodesic> {
    path.begin(p, q);
    // The last sum of arcs, and the last extrapolated one.
    let (mut last_sum, mut last_extrapolated) = (path.length(), None);
    let mut found: Option<Geodesic> = None;
    for _ in 0..HALVINGS {
        path.halve(surface)?;
        let Some(excess) = straightened(surface, &mut path.stations, &mut path.arcs)? else { continue };
        let Some(sum) = path.length() else { continue };
        let Some(coarse) = last_sum.replace(sum) else { continue };
        // The error of the sum falls as L⁴, that of the extrapolated one as L⁶, that of the one extrapolated twice as L⁸.
        let extrapolated = sum + (sum - coarse) / 15.0;
        let (length, error) = match last_extrapolated.replace(extrapolated) {
            None => {
                let change = ((sum - coarse) / sum).abs();
                (extrapolated, SIXTH * change * change.sqrt())
            }
            Some(last) => {
                let change = (extrapolated - last) / 63.0;
                (extrapolated + change, (change / sum).abs())
            }
        };
        let geodesic = Geodesic { length, error: error + excess / sum };
        if geodesic.error <= LENGTH {
            return Some(geodesic);
        }
        found = Some(geodesic);
    }
    found
}

/// Moves the stations between arcs until the sum of lengths is least; what more could be gained, or none where an arc is
/// missing. The outer none: a station without tangent plane.
fn straightened(surface: &Surface, stations: &mut [Station], arcs: &mut [Option<Arc>]) -> Option<Option<f64>> {
    /// What may be left to gain, relative to the length.
    const LEFT: f64 = 0.1 * LENGTH;
    for round in 0..=MOVES {
        let mut excess = 0.0;
        let mut length = 0.0;
        for k in 1..stations.len() {
            let Some(after) = &arcs[k - 1] else { return Some(None) };
            length += after.length;
            let Some(next) = arcs.get(k) else { break };
            let Some(next) = next else { return Some(None) };
            // The second derivative of the sum of both lengths is 1/L₀ + 1/L₁ across them.
            let kink = next.tangents[0] - after.tangents[1];
            let stiffness = 1.0 / after.length + 1.0 / next.length;
            let gain = 0.5 * kink.length_squared() / stiffness;
            excess += gain;
            if gain > LEFT * after.length && round < MOVES {
                let parameters = stations[k].parameters + stations[k].velocity(kink) / stiffness;
                stations[k] = Station::on(surface, parameters)?;
                for side in [k - 1, k] {
                    arcs[side] = Arc::between(&stations[side], &stations[side + 1]);
                }
            }
        }
        if excess <= LEFT * length || round == MOVES {
            return Some(Some(excess));
        }
    }
    Some(None)
}

impl Surface {
    /// The geodesic from `a` to `b` (parameters) that can be drawn out of the straight line between them in the parameters; it may leave [0, 1]² on
    /// its way where it is shorter outside. None where the surface has no tangent plane at one of its ends, or on its way, or no geodesic
    /// is found.
    #[must_use]
    pub fn geodesic_length(&self, a: DVec2, b: DVec2) -> Option<Geodesic> {
        if a == b {
            return Some(Geodesic { length: 0.0, error: 0.0 });
        }
        between(self, &Station::on(self, a)?, &Station::on(self, b)?, &mut Path::default())
    }
}

/// Half of the steps from a grid point to those within `reach` steps in both directions: the other half are their opposites.
pub(crate) fn half_steps(reach: usize) -> Vec<[isize; 2]> {
    let r = isize::try_from(reach).unwrap_or(isize::MAX);
    (0..=r).flat_map(|a| (-r..=r).map(move |b| [a, b])).filter(|&[a, b]| a > 0 || b > 0).collect()
}

/// Geodesic lengths between the points of a grid.
#[derive(Clone, Debug)]
pub(crate) struct GridLengths {
    /// Half the steps of the reach.
    pub(crate) steps: Vec<[isize; 2]>,
    /// Lengths from grid point (i, j) along `steps[o]` at `(i · #steps + o) · (cells[1] + 1) + j`; NaN where the other end is no grid point.
    pub(crate) lengths: Vec<f64>,
    /// The largest estimated relative error.
    pub(crate) error: f64,
}

impl GridLengths {
    /// The mean of all lengths.
    pub(crate) fn mean(&self) -> f64 {
        let known = || self.lengths.iter().filter(|d| !d.is_nan());
        known().sum::<f64>() / known().count() as f64
    }
}

/// The fourth power of a step's larger side.
fn fourth_power([a, b]: [isize; 2]) -> f64 {
    (a.abs().max(b.abs()) as f64).powi(4)
}

/// Lengths of a row, and the largest error.
type Row = Result<(Vec<f64>, f64), ([usize; 2], [usize; 2])>;

/// Distances between all points of a grid in the plane within `reach` steps; (i, j) is at `i · (cells[1] + 1) + j`.
pub(crate) fn plane_lengths(points: &[DVec2], cells: [usize; 2], reach: usize) -> GridLengths {
    let steps = half_steps(reach);
    let columns = cells[1] + 1;
    let rows = parallel::map_chunks(cells[0] + 1, ROWS, |part| {
        let mut lengths = Vec::with_capacity(part.len() * steps.len() * columns);
        for i in part {
            for step in &steps {
                let length = |j: usize| {
                    let end = grid_end(cells, [i, j], *step);
                    end.map_or(f64::NAN, |[k, l]| points[i * columns + j].distance(points[k * columns + l]))
                };
                lengths.extend((0..columns).map(length));
            }
        }
        lengths
    });
    GridLengths { steps, lengths: rows.concat(), error: 0.0 }
}

/// Rows of a grid of points in the plane that one thread measures. Larger: small grids leave threads idle; smaller: threads are woken for
/// little.
const ROWS: usize = 16;

/// Where a step ends; none outside the grid.
fn grid_end(cells: [usize; 2], [i, j]: [usize; 2], [a, b]: [isize; 2]) -> Option<[usize; 2]> {
    let end = [i.checked_add_signed(a)?, j.checked_add_signed(b)?];
    (end[0] <= cells[0] && end[1] <= cells[1]).then_some(end)
}

/// Lengths between all grid points within `reach` steps, or two for which none was found; `stations` are the grid's, (i, j) at
/// `i · (cells[1] + 1) + j`, none where there is no tangent plane.
///
/// Closed forms come first. Elsewhere the longest steps from each grid point, straight and diagonal, are halved. Errors of (1) grow with the fourth
/// power of the length, so these say for which of the steps between them (1) alone is good enough.
pub(crate) fn grid_lengths(
    surface: &Surface,
    stations: &[Option<Station>],
    parameters: impl Fn([usize; 2]) -> DVec2 + Send + Sync,
    cells: [usize; 2],
    reach: usize,
) -> Result<GridLengths, ([usize; 2], [usize; 2])> {
    let steps = half_steps(reach);
    let columns = cells[1] + 1;
    let row = steps.len() * columns;
    let at = |[i, j]: [usize; 2]| stations[i * columns + j].as_ref();
    // Patches have no closed forms: time is not spent on asking.
    let is_patch = surface.patch().is_some();
    let refined = |p: [usize; 2], q: [usize; 2], path: &mut Path| {
        let exact = if is_patch { None } else { surface.geodesic(parameters(p), parameters(q)) };
        let exact = exact.map(|length| Geodesic { length, error: 0.0 });
        exact.or_else(|| between(surface, at(p)?, at(q)?, path)).ok_or((p, q))
    };
    let arc = |p: [usize; 2], q: [usize; 2]| arc_length(at(p)?, at(q)?);
    let rows: Vec<Row> = parallel::map(cells[0] + 1, |i| {
        let mut lengths = vec![f64::NAN; row];
        let mut path = Path::default();
        let mut worst: f64 = 0.0;
        for j in 0..columns {
            let p = [i, j];
            // Relative error of (1) by the fourth power of steps.
            let mut rate: f64 = 0.0;
            let longest = [[1, 0], [0, 1], [1, 1], [1, -1]].map(|[a, b]| {
                let multiples = (1..=reach as isize).rev().map(|m| [m * a, m * b]);
                multiples.filter_map(|step| grid_end(cells, p, step).map(|q| (step, q))).next()
            });
            for (step, q) in longest.into_iter().flatten() {
                let geodesic = refined(p, q, &mut path)?;
                let off = |length: f64| (length - geodesic.length).abs() / geodesic.length;
                rate = rate.max(arc(p, q).map_or(f64::INFINITY, off) / fourth_power(step));
                worst = worst.max(geodesic.error);
                let o = steps.binary_search(&step).expect("it is within reach");
                lengths[o * columns + j] = geodesic.length;
            }
            for (o, &step) in steps.iter().enumerate() {
                let Some(q) = grid_end(cells, p, step).filter(|_| lengths[o * columns + j].is_nan()) else { continue };
                let error = rate * fourth_power(step);
                let good = if error <= LENGTH { arc(p, q) } else { None };
                let geodesic = match good {
                    Some(length) => Geodesic { length, error },
                    None => refined(p, q, &mut path)?,
                };
                worst = worst.max(geodesic.error);
                lengths[o * columns + j] = geodesic.length;
            }
        }
        Ok((lengths, worst))
    });
    let mut all = Vec::with_capacity(row * (cells[0] + 1));
    let mut error: f64 = 0.0;
    for row in rows {
        let (lengths, worst) = row?;
        all.extend(lengths);
        error = error.max(worst);
    }
    Ok(GridLengths { steps, lengths: all, error })
}
