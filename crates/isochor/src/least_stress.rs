//! Completion of a cage's pose by least local stress: of all poses of the free vertices with the wanted volumes, the one at whose witness points the
//! deformation turns directions least. CVB, section 4.
//!
//! The paper plans this and leaves open what of the stress at many points is to be small. Here it is the mean of `sin² θ`, for which there is
//! `sin θ = (s₁ − s₃) / (s₁ + s₃)` ([`crate::LocalStress::sine`]): smooth where θ itself is not, at s₃ = 0, and beyond that it grows, so pieces that
//! are inside out turn back. As in [`crate::cage_correction`] every state on the way has what is wanted: steps go along the surface of such poses, and Newton's
//! method leads back to it. They are those of the BFGS method with limited memory, in the metric of the mobilities, with derivatives less what would change
//! a wish. Where two singular values are the same the stress has an edge, and minima lie in edges; so the search along a line is the one for such functions
//! (A. Lewis, M. Overton, *Nonsmooth optimization via quasi-Newton methods*, 2013), and what it has come to is told, not promised: no nearby pose is better along the
//! directions that were tried.

use glam::DVec3;

use crate::binding::displaced;
use crate::cage_binding::{CageBinding, CageBindingError};
use crate::cage_correction::{CagePose, Found, State, Wishes, scaled};
use crate::correct::{CorrectError, Correction, Status, Wanted};
use crate::local_stress::{LocalStress, StressReport, sine_with_slope};
use crate::mean_value::jacobian_of;
use crate::quasi_newton::{Memory, dot};
use crate::rows::Rows;

/// Most steps. Poses settle in tens; more: minutes on large models.
const STEPS: usize = 400;

/// Steps that the directions remember. More: memory; fewer: slower near edges.
const MEMORY: usize = 30;

/// Most tries along a direction.
const TRIES: usize = 40;

/// Longest first try of a step, in extents. Larger: poses that cannot be brought back; smaller: slow from far.
const LONGEST: f64 = 0.1;

/// Part of the promised decrease that a step must bring, and part of the slope that it may leave. Larger and smaller: more tries.
const DECREASE: f64 = 1e-4;
const SLOPE: f64 = 0.9;

/// The search ends where the cost's derivative, times the extent, is below this part of the cost, or where the last [`WINDOW`] steps together lowered the cost by
/// less than this part of it. Larger: stress is left; smaller: time, for what nobody sees.
const SETTLED: f64 = 1e-8;
const WINDOW: usize = 10;

/// A mean of sin² θ below this is none: angles of a hundredth of a degree. Larger: they would be seen; smaller: the search goes on for what nobody sees.
const NONE: f64 = 1e-8;

/// Witness points in a cage.
pub(crate) struct Witnesses {
    /// ∇α of each control at each point (#points × #controls).
    gradients: Vec<DVec3>,
    controls: usize,
}

/// What the search for least stress brought.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct LeastStressReport {
    /// Points at which stress was measured.
    pub witnesses: usize,
    /// Vertices of the cage that could move.
    pub free: usize,
    /// Steps from the pose by least motion.
    pub steps: usize,
    /// Whether ten steps together brought less than 1e-8 of what is left, or no direction that was tried led to less, or there is no stress
    /// left; otherwise the steps were used up.
    pub is_settled: bool,
    /// Mean of sin² θ by least motion, and in the end.
    pub mean_squared_sine: [f64; 2],
    /// Stress of the pose before the volume was restored.
    pub posed: StressReport,
    /// Stress where the volume is restored by least motion.
    pub least_motion: StressReport,
    /// Stress in the end.
    pub least_stress: StressReport,
}

/// Why there is no pose of least stress.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum StressError {
    /// What is wanted cannot be.
    #[error(transparent)]
    Correct(#[from] CorrectError),
    /// A witness that least motion leaves without a measure.
    #[error("witness {witness} is squeezed into a point, or as much inside out as it is stretched")]
    NoMeasure {
        /// Its index.
        witness: usize,
    },
}

/// A state with its cost.
struct Place {
    state: State,
    cost: f64,
    /// Its derivative by the displacement over √M, less what would change a wish (3 #vertices).
    slope: Vec<f64>,
    /// Basis of what would.
    rows: Rows,
}

impl Witnesses {
    /// At `points` (#points) of a cage.
    ///
    /// # Errors
    ///
    /// As [`CageBinding::jacobians`].
    pub(crate) fn new(cage: &CageBinding, points: &[DVec3]) -> Result<Self, CageBindingError> {
        let gradients = cage.gradients_of_coordinates(points)?;
        Ok(Self { controls: gradients.len() / points.len().max(1), gradients })
    }

    fn rows(&self) -> impl ExactSizeIterator<Item = &[DVec3]> {
        self.gradients.chunks_exact(self.controls)
    }

    /// Stress for controls at `posed` (#controls); `None` without witnesses.
    pub(crate) fn report(&self, posed: &[DVec3]) -> Option<StressReport> {
        StressReport::of(&self.rows().map(|row| jacobian_of(row, posed)).collect::<Vec<_>>())
    }

    /// Mean of sin² θ; infinite where a piece is a point, or as much inside out as it is stretched.
    fn cost(&self, posed: &[DVec3]) -> f64 {
        let squares = self.rows().map(|row| LocalStress::of(&jacobian_of(row, posed)).sine().powi(2));
        let mean = squares.sum::<f64>() / self.rows().len() as f64;
        if mean.is_nan() { f64::INFINITY } else { mean }
    }

    /// Its derivatives by the controls (#controls × 3).
    fn slope(&self, posed: &[DVec3]) -> Vec<DVec3> {
        let mut slope = vec![DVec3::ZERO; self.controls];
        let count = self.rows().len() as f64;
        for row in self.rows() {
            let (sine, by_entry) = sine_with_slope(&jacobian_of(row, posed));
            let by_entry = by_entry * (2.0 * sine / count);
            slope.iter_mut().zip(row).for_each(|(slope, gradient)| *slope += by_entry * *gradient);
        }
        slope
    }
}

/// Restores what is `wanted` by the pose of least stress at `witnesses`, and tells how it went unless the wishes are not met.
pub(crate) fn relaxed(
    pose: &CagePose,
    wanted: &Wanted,
    witnesses: &Witnesses,
) -> Result<(Correction, Option<LeastStressReport>), StressError> {
    let (wishes, start) = pose.checked(wanted)?;
    let volume_before = start.volume();
    let posed = witnesses.report(&pose.cage.controls(pose.posed));
    let found = pose.searched(&wishes, start, true)?;
    if !pose.is_met(&found.state, &wishes) {
        return Ok((pose.correction(&wishes, volume_before, found), None));
    }
    let least_motion = witnesses.report(&pose.controls(&found.state));
    let Found { state, status, steps: before, .. } = found;
    let mut at = pose.place(state, &wishes, witnesses);
    let cost = at.cost;
    if !cost.is_finite() {
        let controls = pose.controls(&at.state);
        let has_none = |row: &[DVec3]| !LocalStress::of(&jacobian_of(row, &controls)).sine().is_finite();
        let witness = witnesses.rows().position(has_none).unwrap_or_default();
        return Err(StressError::NoMeasure { witness });
    }
    let (mut memory, mut size) = (Memory::new(MEMORY), 1.0);
    let (mut costs, mut is_settled) = (vec![cost], false);
    while costs.len() <= STEPS {
        let before = costs.len().checked_sub(WINDOW + 1).map(|k| costs[k]);
        if at.cost <= NONE
            || largest(&at.slope) * pose.extent <= SETTLED * at.cost
            || before.is_some_and(|before| before - at.cost <= SETTLED * before)
        {
            is_settled = true;
            break;
        }
        let mut next = pose.stepped(&at, (&memory, size), &wishes, witnesses);
        if next.is_none() && !memory.is_empty() {
            // Along the slope itself.
            (memory, size) = (Memory::new(MEMORY), 1.0);
            next = pose.stepped(&at, (&memory, size), &wishes, witnesses);
        }
        let Some((next, step)) = next else {
            is_settled = true;
            break;
        };
        let change: Vec<f64> = next.slope.iter().zip(&at.slope).map(|(a, b)| a - b).collect();
        let product = dot(&step, &change);
        if product > 0.0 {
            size = product / dot(&change, &change);
            memory.push(step, change, product);
        }
        at = next;
        costs.push(at.cost);
    }
    let steps = costs.len() - 1;
    let report = |(posed, least_motion): (StressReport, StressReport)| {
        Some(LeastStressReport {
            witnesses: witnesses.rows().len(),
            free: pose.mobility.iter().filter(|m| **m != DVec3::ZERO).count(),
            steps,
            is_settled,
            mean_squared_sine: [cost, at.cost],
            posed,
            least_motion,
            least_stress: witnesses.report(&pose.controls(&at.state))?,
        })
    };
    let report = posed.zip(least_motion).and_then(report);
    let residual = Some(largest(&at.slope) * pose.extent);
    let has_moved = before + steps > 0;
    let status = if has_moved || status != Status::AlreadyMet { Status::Exact } else { Status::AlreadyMet };
    let found = Found { state: at.state, status, steps: before + steps, residual };
    Ok((pose.correction(&wishes, volume_before, found), report))
}

fn largest(numbers: &[f64]) -> f64 {
    numbers.iter().map(|x| x.abs()).fold(0.0, f64::max)
}

impl CagePose<'_> {
    /// E(C + δ)
    fn controls(&self, state: &State) -> Vec<DVec3> {
        self.cage.controls(&displaced(self.posed, &state.displacement))
    }

    fn place(&self, state: State, wishes: &Wishes, witnesses: &Witnesses) -> Place {
        let posed = displaced(self.posed, &state.displacement);
        let controls = self.cage.controls(&posed);
        let by_vertex = self.cage.pulled(&posed, witnesses.slope(&controls));
        let rows = self.independent(&self.rows(&state, wishes));
        let mut slope = scaled(&by_vertex, self.mobility);
        rows.project(&mut slope);
        Place { cost: witnesses.cost(&controls), state, slope, rows }
    }

    /// The next place, and the step to it over √M; `None` where none is better.
    fn stepped(
        &self,
        at: &Place,
        (memory, size): (&Memory, f64),
        wishes: &Wishes,
        witnesses: &Witnesses,
    ) -> Option<(Place, Vec<f64>)> {
        let mut direction = memory.direction(&at.slope, <[f64]>::to_vec, size);
        at.rows.project(&mut direction);
        let falls = dot(&direction, &at.slope);
        if falls >= 0.0 {
            return None;
        }
        let moves = self.unscaled(&direction);
        let length = moves.iter().map(|d| d.length()).fold(0.0, f64::max);
        let mut share = (LONGEST * self.extent / length).min(if memory.is_empty() { f64::INFINITY } else { 1.0 });
        let (mut low, mut high) = (0.0, f64::INFINITY);
        let mut best: Option<Place> = None;
        for _ in 0..TRIES {
            let partial = at.state.displacement.iter().zip(&moves).map(|(at, d)| *at + *d * share).collect();
            let (state, _) = self.restored(self.state(partial, wishes), wishes, None);
            let is_lower = self.is_met(&state, wishes)
                && witnesses.cost(&self.controls(&state)) <= at.cost + DECREASE * share * falls;
            if is_lower {
                let place = self.place(state, wishes, witnesses);
                let is_flatter = dot(&direction, &place.slope) >= SLOPE * falls;
                best = Some(place);
                low = share;
                if is_flatter {
                    break;
                }
            } else {
                high = share;
            }
            share = if high.is_finite() { (low + high) / 2.0 } else { 2.0 * low };
            // Something was found, and what lies beyond is no better.
            if best.is_some() && high - low <= DECREASE * high {
                break;
            }
        }
        let best = best.filter(|best| best.cost < at.cost)?;
        let step = self.over_mobility(&best.state, &at.state);
        Some((best, step))
    }

    /// What lies between two displacements, over √M (3 #vertices); 0 where nothing moves.
    fn over_mobility(&self, to: &State, from: &State) -> Vec<f64> {
        let over = |d: f64, m: f64| if m > 0.0 { d / m.sqrt() } else { 0.0 };
        let pairs = to.displacement.iter().zip(&from.displacement).zip(self.mobility);
        let of = |((to, from), m): ((&DVec3, &DVec3), &DVec3)| {
            let d = *to - *from;
            [over(d.x, m.x), over(d.y, m.y), over(d.z, m.z)]
        };
        pairs.flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cage::Cage;
    use crate::cage_binding::{CageOptions, Coordinates};
    use crate::shapes;

    /// A cage, points inside, on and outside it, and a pose.
    fn case(coordinates: Coordinates) -> (CageBinding, Vec<DVec3>, Vec<DVec3>) {
        let cage = match coordinates {
            Coordinates::Tetrahedral => {
                let mut faces = crate::Faces::new();
                [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].iter().for_each(|face| faces.push(face));
                crate::Mesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z], faces).unwrap()
            }
            _ => shapes::icosphere(1),
        };
        let cage = Cage::new(cage).unwrap();
        let bent = |v: &DVec3| DVec3::new(1.3 * v.x + 0.2 * v.y * v.z, v.y - 0.3 * v.x * v.x, 0.8 * v.z + 0.1 * v.x);
        let posed = cage.vertices().iter().map(bent).collect();
        let points: Vec<DVec3> = (0..9).map(|k| DVec3::new(0.1, 0.2, 0.3) * f64::from(k) * 0.4).collect();
        let binding = cage.bind(&points, &CageOptions { coordinates, ..CageOptions::default() }).unwrap();
        (binding, points, posed)
    }

    const ALL: [Coordinates; 4] =
        [Coordinates::MeanValue, Coordinates::Harmonic, Coordinates::Green, Coordinates::Tetrahedral];

    #[test]
    fn gradients_of_coordinates_make_jacobians() {
        for coordinates in ALL {
            let (cage, points, posed) = case(coordinates);
            let gradients = cage.gradients_of_coordinates(&points).unwrap();
            let controls = cage.controls(&posed);
            let jacobians = cage.jacobians(&points, &posed).unwrap();
            for (row, jacobian) in gradients.chunks_exact(controls.len()).zip(jacobians) {
                let found = jacobian_of(row, &controls);
                assert!(found.abs_diff_eq(jacobian, 1e-11), "{coordinates}: {found}, not {jacobian}");
            }
        }
    }

    /// A mirrored tetrahedron, of which the mirrored volume is wanted.
    #[test]
    fn mirrored_witnesses_have_no_measure() {
        let (cage, points, _) = case(Coordinates::Tetrahedral);
        let mesh = cage.cage().mesh().clone();
        let bound = cage
            .cage()
            .bind(mesh.points(), &CageOptions { coordinates: Coordinates::Tetrahedral, ..CageOptions::default() });
        let bound = bound.unwrap();
        let solid = crate::Solid::new(&mesh, &crate::topology(&mesh), crate::OpenBoundaries::Refuse).unwrap();
        let posed: Vec<DVec3> = mesh.points().iter().map(|p| DVec3::new(-p.x, p.y, p.z)).collect();
        let pose = CagePose {
            cage: &bound,
            solid: &solid,
            rest: mesh.points(),
            posed: &posed,
            mobility: &[DVec3::ONE; 4],
            extent: 1.0,
        };
        let wanted = Wanted::volume(solid.volume(&posed));
        let witnesses = Witnesses::new(&bound, &points[..2]).unwrap();
        assert_eq!(relaxed(&pose, &wanted, &witnesses).unwrap_err(), StressError::NoMeasure { witness: 0 });
    }

    #[test]
    fn slopes_are_derivatives_of_the_cost() {
        for coordinates in ALL {
            let (cage, points, posed) = case(coordinates);
            let witnesses = Witnesses::new(&cage, &points[..6]).unwrap();
            let slope = cage.pulled(&posed, witnesses.slope(&cage.controls(&posed)));
            for v in [0, 1, 3] {
                for axis in DVec3::AXES {
                    let at = |step: f64| {
                        let mut moved = posed.clone();
                        moved[v] += axis * step;
                        witnesses.cost(&cage.controls(&moved))
                    };
                    let measured = (at(1e-5) - at(-1e-5)) / 2e-5;
                    assert!((measured - slope[v].dot(axis)).abs() <= 1e-7, "{coordinates}: {measured}, {}", slope[v]);
                }
            }
        }
    }
}
