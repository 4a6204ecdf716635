//! Lengths of geodesics between two points of a surface.
//!
//! Given S and parameters a, b, find the length L of the geodesic x(σ) from S(a) to S(b), σ its arc length, that can be drawn out of the
//! straight line from a to b in the parameters. On a geodesic `x″ = κ N`, the normal curvature times the surface's normal; with x‴ = (κ N)′ the
//! quintic of Hermite has
//!
//! ```text
//! x(L) − x(0) = L/2 (T₀ + T₁) + L²/10 (x″₀ − x″₁) + L³/120 (x‴₀ + x‴₁) + O(L⁷)                     (1)
//! ```
//!
//! with unit tangents T₀, T₁: three equations for L and the directions of T₀ and T₁ in their tangent planes. κ and κ′ come from the surface's
//! derivatives at the ends, so an *arc* (1) takes no further point of the surface. Its relative error is `(κL)⁶/100800` on a circle.
//! Where that is too much, the geodesic is cut in halves at the middle of the quintic with the arc's parameters, velocities and accelerations
//! at its ends. Where arcs meet at an angle, the point between goes against `T₁ of the one − T₀ of the other`, the gradient of the
//! sum of lengths, until that would gain nothing.
//!
//! # Changes versus the paper
//!
//! CO's appendix has the "distance between P_i and P_j on the curved surface" and leaves open how it is found. The length of the straight line
//! in the parameters is too long (by 0.3 to 0.7 % on a cone three cells apart), and a sheet of such lengths is not isometric.

use fearless_simd::{Level, dispatch};
use glam::{DVec2, DVec3};

use crate::parallel;
use crate::surface::{Jet, Surface, Third};

/// The least relative error of lengths that is asked for. Larger: developable surfaces come out stretched by as much; smaller: more points of the
/// surface are needed.
pub(crate) const LENGTH: f64 = 1e-7;

/// Errors of (1) fall with this power of the length where third derivatives of the surface jump, as between the patches of cubic splines.
const ORDER: i32 = 4;

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
    /// The tangential parts of S_ss, S_st and S_tt in these coordinates: Christoffel's symbols.
    christoffel: [DVec2; 3],
    /// Their normal parts: the second fundamental form.
    form: [f64; 3],
    /// κ′ along a geodesic as a cubic form of its velocity: the covariant derivative of the second form, which is symmetric (Codazzi and
    /// Mainardi's equations). Coefficients of x³, x² y, x y² and y³.
    growth: [f64; 4],
}

/// A geodesic at a station.
#[derive(Clone, Copy, Debug)]
struct Motion {
    /// Unit vector.
    tangent: DVec3,
    /// Of the parameters, by arc length.
    velocity: DVec2,
    /// Normal curvature.
    curvature: f64,
    /// The point's third derivative by arc length.
    third: DVec3,
}

/// (1) between two stations.
#[derive(Clone, Copy, Debug)]
struct Arc {
    length: f64,
    /// Estimated relative error of the length on a smooth surface.
    error: f64,
    tangents: [DVec3; 2],
    /// Velocities of the parameters at both ends.
    velocities: [DVec2; 2],
}

impl Station {
    /// None where the surface has no tangent plane.
    #[inline(always)]
    pub(crate) fn new(parameters: DVec2, jet: &Jet, third: &Third) -> Option<Self> {
        let normal = jet.normal()?;
        let area = jet.s.cross(jet.t).dot(normal);
        let dual = [jet.t.cross(normal) / area, normal.cross(jet.s) / area];
        let is_finite = jet.point.is_finite() && dual[0].is_finite() && dual[1].is_finite();
        let second = [jet.ss, jet.st, jet.tt];
        let christoffel = second.map(|v| DVec2::new(dual[0].dot(v), dual[1].dot(v)));
        let form = second.map(|v| v.dot(normal));
        // κ′ = N·S_vvv + 3 II(v, a) with the acceleration a = −Γ(v, v).
        let [sss, sst, stt, ttt] = [third.sss, third.sst, third.stt, third.ttt].map(|v| v.dot(normal));
        let [ss, st, tt] = form;
        let with_s = |v: DVec2| ss * v.x + st * v.y;
        let with_t = |v: DVec2| st * v.x + tt * v.y;
        let [of_ss, of_st, of_tt] = christoffel;
        let growth = [
            sss - 3.0 * with_s(of_ss),
            3.0 * (sst - with_t(of_ss) - 2.0 * with_s(of_st)),
            3.0 * (stt - with_s(of_tt) - 2.0 * with_t(of_st)),
            ttt - 3.0 * with_t(of_tt),
        ];
        let first = [jet.s, jet.t];
        is_finite.then_some(Self { parameters, point: jet.point, normal, first, dual, christoffel, form, growth })
    }

    fn on(surface: &Surface, parameters: DVec2) -> Option<Self> {
        let (jet, third) = surface.jet_and_third(parameters.x, parameters.y);
        dispatch!(Level::new(), _simd => Self::new(parameters, &jet, &third))
    }

    /// The geodesic whose tangent is nearest to `direction`; none where no tangent is. Its second derivative is κ N, so that the third is κ′ N +
    /// κ N′ with N′ = −Σ (N·S_iv) dual_i, v the velocity.
    #[inline(always)]
    fn toward(&self, direction: DVec3) -> Option<Motion> {
        let along = direction - direction.dot(self.normal) * self.normal;
        let rate = along.length().recip();
        if !(rate > 0.0 && rate.is_finite()) {
            return None;
        }
        let velocity = rate * self.velocity(direction);
        let DVec2 { x, y } = velocity;
        let [ss, st, tt] = self.form;
        let turn = DVec2::new(ss * x + st * y, st * x + tt * y);
        let curvature = turn.dot(velocity);
        let [xxx, xxy, xyy, yyy] = self.growth;
        let growth = x * x * (x * xxx + y * xxy) + y * y * (x * xyy + y * yyy);
        let third = growth * self.normal - curvature * (turn.x * self.dual[0] + turn.y * self.dual[1]);
        Some(Motion { tangent: rate * along, velocity, curvature, third })
    }

    /// What of a vector is tangential, in the parameters.
    fn velocity(&self, v: DVec3) -> DVec2 {
        DVec2::new(self.dual[0].dot(v), self.dual[1].dot(v))
    }

    /// Second derivative of the parameters of a geodesic with the parameter velocity `v`, by arc length.
    fn acceleration(&self, v: DVec2) -> DVec2 {
        let [of_ss, of_st, of_tt] = self.christoffel;
        -(v.x * v.x * of_ss + 2.0 * v.x * v.y * of_st + v.y * v.y * of_tt)
    }
}

impl Arc {
    /// None where the ends are too far apart.
    fn between(p: &Station, q: &Station, accuracy: f64) -> Option<Self> {
        // The same bits with all registers: nothing is fused.
        dispatch!(Level::new(), _simd => Self::dispatched(p, q, accuracy))
    }

    #[inline(always)]
    fn dispatched(p: &Station, q: &Station, accuracy: f64) -> Option<Self> {
        /// Directions and length are repeated until the length is expected to change by less than this part of the accuracy. Larger: the
        /// error of (1) is drowned; smaller: a round more.
        const SETTLED: f64 = 0.1;
        /// The second change is taken to be the first one, times the square of the distance between both normals, times this. Larger: a round
        /// more; smaller: the directions of chords pass for those of geodesics (0.97 is reached on tori).
        const SECOND: f64 = 1.0;
        /// Where they do not settle in so many rounds, the ends are too far apart.
        const ROUNDS: usize = 12;
        let chord = q.point - p.point;
        let [mut from, mut to] = [p.toward(chord)?, q.toward(chord)?];
        let mut length = chord.length();
        let mut last_change = None;
        for _ in 0..ROUNDS {
            // (1) along the sum of tangents, a L + b L² + c L³ = d: a step of Newton's.
            let sum = from.tangent + to.tangent;
            let second = from.curvature * p.normal.dot(sum) - to.curvature * q.normal.dot(sum);
            let third = (from.third + to.third).dot(sum);
            let [a, b, c, d] = [0.5 * sum.length_squared(), second / 10.0, third / 120.0, chord.dot(sum)];
            let slope = a + length * (2.0 * b + 3.0 * length * c);
            let settled = length + (d - length * (a + length * (b + length * c))) / slope;
            let are_near = from.tangent.dot(to.tangent) >= NEAR && slope > 0.0 && settled > 0.0;
            if !are_near {
                return None;
            }
            let change = (settled - length).abs() / settled;
            // Changes fall by about the same factor from round to round.
            let factor = last_change.map_or_else(|| SECOND * p.normal.distance_squared(q.normal), |last| change / last);
            if factor * change <= SETTLED * accuracy {
                // Another way round, as over the seam of a cylinder, is not the one that was asked for.
                let missed = q.parameters - p.parameters - 0.5 * settled * (from.velocity + to.velocity);
                let missed = missed.x * p.first[0] + missed.y * p.first[1];
                let left =
                    to.curvature * q.normal - from.curvature * p.normal - 0.5 * settled * (from.third + to.third);
                let arc = Self {
                    length: settled,
                    error: error(settled, left.length(), from.curvature.abs().max(to.curvature.abs())),
                    tangents: [from.tangent, to.tangent],
                    velocities: [from.velocity, to.velocity],
                };
                return (missed.length() <= ASIDE * settled).then_some(arc);
            }
            (length, last_change) = (settled, Some(change));
            // L T₀ = x(L) − x(0) − L² (7/20 κ₀ N₀ + 3/20 κ₁ N₁) − L³ (x‴₀/20 − x‴₁/30) + O(L⁶), and the same from the other end.
            let [squared, cubed] = [0.15 * length * length, length * length * length / 60.0];
            let first = chord - squared * to.curvature * q.normal - cubed * (3.0 * from.third - 2.0 * to.third);
            let last = chord + squared * from.curvature * p.normal + cubed * (2.0 * from.third - 3.0 * to.third);
            (from, to) = (p.toward(first)?, q.toward(last)?);
        }
        None
    }

    /// Parameters of the middle, by the quintic between the ends.
    fn middle(&self, p: &Station, q: &Station) -> DVec2 {
        let [v0, v1] = self.velocities;
        let [a0, a1] = [p.acceleration(v0), q.acceleration(v1)];
        0.5 * (p.parameters + q.parameters) + self.length * (5.0 / 32.0 * (v0 - v1) + self.length / 64.0 * (a0 + a1))
    }
}

/// A way from station to station by arcs, none where stations are too far apart, in memory that is used again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Path {
    stations: Vec<Station>,
    arcs: Vec<Option<Arc>>,
    spare: Vec<Station>,
}

impl Path {
    /// One arc, if there is one.
    fn begin(&mut self, p: &Station, q: &Station, arc: Option<Arc>) {
        self.stations.clear();
        self.stations.extend([p, q]);
        self.arcs.clear();
        self.arcs.push(arc);
    }

    /// The sum of lengths, where no arc is missing.
    fn length(&self) -> Option<f64> {
        self.arcs.iter().map(|arc| arc.as_ref().map(|arc| arc.length)).sum()
    }

    /// The estimated error of that.
    fn off(&self) -> f64 {
        self.arcs.iter().flatten().map(|arc| arc.error * arc.length).sum()
    }

    /// Two arcs for each. None where a station has no tangent plane.
    fn halve(&mut self, surface: &Surface, accuracy: f64) -> Option<()> {
        self.spare.clear();
        for (ends, arc) in self.stations.windows(2).zip(&self.arcs) {
            let straight = 0.5 * (ends[0].parameters + ends[1].parameters);
            let middle = arc.as_ref().map_or(straight, |arc| arc.middle(&ends[0], &ends[1]));
            self.spare.extend([ends[0], Station::on(surface, middle)?]);
        }
        self.spare.extend(self.stations.last().copied());
        std::mem::swap(&mut self.stations, &mut self.spare);
        self.arcs.clear();
        self.arcs.extend(self.stations.windows(2).map(|ends| Arc::between(&ends[0], &ends[1], accuracy)));
        Some(())
    }
}

/// The estimated relative error of (1), with `left` = |x″₁ − x″₀ − L/2 (x‴₀ + x‴₁)| and the largest curvature at both ends. On a circle it is
/// `(κL)⁶/100800`; in general the sixth derivative of the tangent takes the place of κ⁶. What is left is L³/12 times the fourth one, and the
/// size of that to the power 3/2 stands for that of the sixth.
fn error(length: f64, left: f64, curvature: f64) -> f64 {
    /// Larger: geodesics are halved for nothing; smaller: errors are larger than they are said to be (55 is reached on patches).
    const SAFETY: f64 = 60.0;
    let fourth = 12.0 * length * left;
    let bent = (length * curvature) * (length * curvature);
    SAFETY / 100_800.0 * (fourth * fourth.sqrt()).max(bent * bent * bent)
}

/// The geodesic between two stations, `arc` the arc between them if there is one, to the relative error `accuracy` if [`HALVINGS`] are enough;
/// none where a point between them has no tangent plane, or no geodesic is found.
fn between(
    surface: &Surface,
    [p, q]: [&Station; 2],
    arc: Option<Arc>,
    accuracy: f64,
    path: &mut Path,
) -> Option<Geodesic> {
    let halved = 2.0_f64.powi(ORDER) - 1.0;
    let mut last = arc.map(|arc| arc.length);
    path.begin(p, q, arc);
    let mut found: Option<Geodesic> = None;
    for _ in 0..HALVINGS {
        path.halve(surface, accuracy)?;
        let Some(excess) = straightened(surface, &mut path.stations, &mut path.arcs, accuracy)? else { continue };
        let Some(length) = path.length() else { continue };
        // Arcs do not tell where the surface is not smooth.
        let change = match (surface.is_smooth(), last.replace(length)) {
            (true, _) => 0.0,
            (false, Some(coarse)) => (length - coarse).abs() / halved,
            (false, None) => continue,
        };
        let error = (change.max(path.off()) + excess) / length;
        found = Some(Geodesic { length, error });
        if error <= accuracy {
            break;
        }
    }
    found
}

/// Moves the stations between arcs until the sum of lengths is least; what more could be gained, or none where an arc is
/// missing. The outer none: a station without tangent plane.
fn straightened(
    surface: &Surface,
    stations: &mut [Station],
    arcs: &mut [Option<Arc>],
    accuracy: f64,
) -> Option<Option<f64>> {
    /// What may be left to gain, as a part of the accuracy.
    const LEFT: f64 = 0.1;
    let left = LEFT * accuracy;
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
            if gain > left * after.length && round < MOVES {
                let parameters = stations[k].parameters + stations[k].velocity(kink) / stiffness;
                stations[k] = Station::on(surface, parameters)?;
                for side in [k - 1, k] {
                    arcs[side] = Arc::between(&stations[side], &stations[side + 1], accuracy);
                }
            }
        }
        if excess <= left * length || round == MOVES {
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
        let [p, q] = [Station::on(self, a)?, Station::on(self, b)?];
        between(self, [&p, &q], Arc::between(&p, &q, LENGTH), LENGTH, &mut Path::default())
    }
}

/// Half of the steps from a grid point to those within `reach` steps in both directions: the other half are their opposites.
pub(crate) fn half_steps(reach: usize) -> Vec<[isize; 2]> {
    let r = isize::try_from(reach).unwrap_or(isize::MAX);
    (0..=r).flat_map(|a| (-r..=r).map(move |b| [a, b])).filter(|&[a, b]| a > 0 || b > 0).collect()
}

/// Where among [`half_steps`] a step is; none where it is none of them.
pub(crate) fn step_index(reach: usize, [a, b]: [isize; 2]) -> Option<usize> {
    let width = 2 * reach + 1;
    let [a, b] = [usize::try_from(a).ok()?, b.checked_add_unsigned(reach).and_then(|b| usize::try_from(b).ok())?];
    // Of the steps with a = 0, only those with b > 0 are there.
    (a <= reach && b < width).then(|| (a * width + b).checked_sub(reach + 1))?
}

/// Geodesic lengths between the points of a grid.
#[derive(Clone, Debug)]
pub(crate) struct GridLengths {
    /// Half the steps of the reach.
    pub(crate) steps: Vec<[isize; 2]>,
    /// Lengths from grid point (i, j) along `steps[o]` at `(i · #steps + o) · (cells[1] + 1) + j`; NaN where the other end is no grid point.
    pub(crate) lengths: Vec<f64>,
    /// Their estimated relative errors.
    errors: Vec<f64>,
}

impl GridLengths {
    /// The largest estimated relative error.
    pub(crate) fn error(&self) -> f64 {
        self.errors.iter().fold(0.0, |most, error| error.max(most))
    }

    /// Those known to `accuracy`.
    fn known(&self, k: usize, accuracy: f64) -> Option<Geodesic> {
        let [length, error] = [self.lengths[k], self.errors[k]];
        (error <= accuracy).then_some(Geodesic { length, error })
    }

    /// The mean of all lengths.
    pub(crate) fn mean(&self) -> f64 {
        let known = || self.lengths.iter().filter(|d| !d.is_nan());
        known().sum::<f64>() / known().count() as f64
    }
}

/// Lengths of a row, where there are other ends; or two points between which there is none.
type Row = Result<Vec<Option<Geodesic>>, ([usize; 2], [usize; 2])>;

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
    let lengths = rows.concat();
    GridLengths { steps, errors: vec![0.0; lengths.len()], lengths }
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
/// Closed forms come first. Elsewhere arcs are halved that are not good enough. Where the surface is not smooth, they do not tell; then the longest
/// steps from each grid point, straight and diagonal, are halved first. Errors of (1) grow with a power of the length, so these say for which
/// of the steps between them (1) alone is good enough. Lengths that were taken `before` are kept where they are.
pub(crate) fn grid_lengths(
    surface: &Surface,
    stations: &[Option<Station>],
    parameters: impl Fn([usize; 2]) -> DVec2 + Send + Sync,
    cells: [usize; 2],
    reach: usize,
    accuracy: f64,
    before: Option<&GridLengths>,
) -> Result<GridLengths, ([usize; 2], [usize; 2])> {
    let steps = half_steps(reach);
    let columns = cells[1] + 1;
    let row = steps.len() * columns;
    let is_smooth = surface.is_smooth();
    let at = |[i, j]: [usize; 2]| stations[i * columns + j].as_ref();
    // Patches have no closed forms: time is not spent on asking.
    let is_patch = surface.patch().is_some();
    let exact = |p, q| if is_patch { None } else { surface.geodesic(parameters(p), parameters(q)) };
    let power = |[a, b]: [isize; 2]| (a.abs().max(b.abs()) as f64).powi(ORDER);
    let rows: Vec<Row> = parallel::map(cells[0] + 1, |i| {
        // Without samples there are no rates.
        let before = before.filter(|_| is_smooth);
        let mut lengths: Vec<Option<Geodesic>> = (i * row..(i + 1) * row).map(|k| before?.known(k, accuracy)).collect();
        let mut path = Path::default();
        for j in 0..columns {
            let p = [i, j];
            // Relative error of (1) by the power of steps.
            let mut rate: f64 = 0.0;
            let mut measure = |step: [isize; 2], q: [usize; 2], is_sample: bool| {
                if let Some(length) = exact(p, q) {
                    return Some(Geodesic { length, error: 0.0 });
                }
                let ends = [at(p)?, at(q)?];
                let arc = Arc::between(ends[0], ends[1], accuracy);
                if !is_sample {
                    let single = arc.map(|Arc { length, error, .. }| (length, error.max(rate * power(step))));
                    if let Some((length, error)) = single.filter(|(_, error)| *error <= accuracy) {
                        return Some(Geodesic { length, error });
                    }
                }
                let geodesic = between(surface, ends, arc, accuracy, &mut path)?;
                if is_sample {
                    let off = |arc: Arc| (arc.length - geodesic.length).abs() / geodesic.length + geodesic.error;
                    rate = rate.max(arc.map_or(f64::INFINITY, off) / power(step));
                }
                Some(geodesic)
            };
            let longest = [[1, 0], [0, 1], [1, 1], [1, -1]].map(|[a, b]| {
                let multiples = (1..=reach as isize).rev().map(|m| [m * a, m * b]);
                multiples.filter_map(|step| grid_end(cells, p, step).map(|q| (step, q))).next()
            });
            let samples = longest.into_iter().flatten().filter(|_| !is_smooth).map(|(step, q)| (step, q, true));
            let all = steps.iter().filter_map(|step| grid_end(cells, p, *step).map(|q| (*step, q, false)));
            for (step, q, is_sample) in samples.chain(all) {
                let o = step_index(reach, step).expect("it is within reach");
                let length = &mut lengths[o * columns + j];
                if length.is_none() {
                    *length = Some(measure(step, q, is_sample).ok_or((p, q))?);
                }
            }
        }
        Ok(lengths)
    });
    let [mut lengths, mut errors] = [0; 2].map(|_| Vec::with_capacity(row * (cells[0] + 1)));
    for row in rows {
        for found in row? {
            let Geodesic { length, error } = found.unwrap_or(Geodesic { length: f64::NAN, error: 0.0 });
            lengths.push(length);
            errors.push(error);
        }
    }
    Ok(GridLengths { steps, lengths, errors })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_know_their_places() {
        for reach in 1..5 {
            let steps = half_steps(reach);
            for (o, step) in steps.iter().enumerate() {
                assert_eq!(step_index(reach, *step), Some(o));
            }
            let r = reach as isize;
            let others = [[0, 0], [0, -1], [-1, 1], [0, r + 1], [1, r + 1], [1, -r - 1], [r + 1, 0]];
            assert_eq!(others.map(|step| step_index(reach, step)), [None; 7]);
        }
    }
}
