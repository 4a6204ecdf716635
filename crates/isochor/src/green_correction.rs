//! Volume corrections of cages with Green coordinates, over the vertices of the cage.
//!
//! With Green coordinates vertices are no affine function of the cage, since its normals turn, so the closed forms of [`crate::correct`] do not
//! hold. What holds is the chain rule ([`crate::CageBinding::gradient`]). With A the derivatives of all wanted volumes and point coordinates by the
//! cage's vertices at C + δ, r what they lack there and M the mobilities, the smallest displacement is a fixed point of
//!
//! ```text
//! δ ← M Aᵀ (A M Aᵀ)⁻¹ (r + A δ)
//! ```
//!
//! Steps to it are halved until they make the displacement smaller, and after each of them Newton's method brings r to rounding again, so every
//! state on the way has what is wanted, as in [`crate::Method::Nearest`]. Along the gradient, A in the direction stays that of the pose, and r
//! alone is brought to rounding.

use glam::DVec3;

use crate::binding::displaced;
use crate::cage_binding::CageBinding;
use crate::correct::{CorrectError, Correction, Reason, Status, Wanted};
use crate::goals::{Components, VolumeGoal};
use crate::square::Square;
use crate::tolerances;
use crate::volume::{Solid, Volumes};

/// Most steps. They gain a digit in one to four; more: minutes on large models.
const STEPS: usize = 200;

/// Most halvings of a step.
const HALVINGS: usize = 30;

/// Longest step, in promised ones. Larger: steps that must be halved; smaller: flat directions take long.
const LONGEST: f64 = 30.0;

/// Part of the decrease of the cost that a step promises which it must bring. Larger: short steps; smaller: steps that bring nothing.
const DECREASE: f64 = 1e-4;

/// What is corrected.
#[derive(Clone, Copy)]
pub(crate) struct GreenPose<'a> {
    pub(crate) cage: &'a CageBinding,
    pub(crate) solid: &'a Solid,
    /// Points at rest (#points × 3), to which the cage is bound.
    pub(crate) rest: &'a [DVec3],
    /// The cage's vertices (#vertices × 3).
    pub(crate) posed: &'a [DVec3],
    /// Mobility of their coordinates (#vertices × 3).
    pub(crate) mobility: &'a [DVec3],
    /// Longest side of the model's box.
    pub(crate) extent: f64,
}

/// A displacement of the cage and what comes of it.
struct State {
    displacement: Vec<DVec3>,
    vertices: Vec<DVec3>,
    volumes: Volumes,
    /// What each volume, then each coordinate of each point, lacks.
    lacks: Vec<f64>,
    /// The largest of them, of volumes relative to what is wanted, of points in extents.
    miss: f64,
}

/// Corrects by the smallest displacement of the cage's vertices, or, if `is_nearest` is not so, along the gradients at the pose.
pub(crate) fn corrected(pose: &GreenPose, wanted: &Wanted, is_nearest: bool) -> Result<Correction, CorrectError> {
    let start = pose.state(vec![DVec3::ZERO; pose.posed.len()], wanted);
    let volume_before = start.volumes.total;
    let ended = |state: State, status, steps, residual| Correction {
        relative_error: relative_error(&wanted.volumes, &state.volumes),
        point_error: state.lacks[wanted.volumes.len()..].iter().map(|lack| lack.abs()).fold(0.0, f64::max)
            / pose.extent,
        volume: state.volumes.total,
        component_volumes: state.volumes.components.clone(),
        displacement: state.displacement,
        vertices: state.vertices,
        volume_before,
        status,
        steps,
        residual,
    };
    if start.miss <= tolerances::VOLUME_ROUNDING {
        return Ok(ended(start, Status::AlreadyMet, 0, is_nearest.then_some(0.0)));
    }
    let impossible = |reason| {
        let (goal, target) = match wanted.volumes.first() {
            Some(goal) => (Some(0), goal.volume),
            None => (None, volume_before),
        };
        CorrectError::Impossible { goal, target, volume: volume_before, reason }
    };
    if pose.mobility.iter().all(|m| *m == DVec3::ZERO) {
        return Err(impossible(Reason::Pinned));
    }
    let first = pose.rows(&start, wanted);
    let lines = (!is_nearest).then_some(&first[..]);
    let (mut state, mut steps) = pose.restored(start, wanted, lines);
    let mut residual = f64::INFINITY;
    // The displacement before the last step, and the step that was promised there.
    let mut last: Option<(Vec<DVec3>, Vec<DVec3>)> = None;
    while is_nearest && state.miss <= tolerances::NEAR_VOLUME && steps < STEPS {
        let rows = pose.rows(&state, wanted);
        let asked: Vec<f64> =
            state.lacks.iter().zip(&rows).map(|(lack, row)| lack + dot(row, &state.displacement)).collect();
        let to = pose.combined(&rows, &rows, &asked).ok_or_else(|| impossible(Reason::Dead))?;
        let step: Vec<DVec3> = to.iter().zip(&state.displacement).map(|(a, b)| *a - *b).collect();
        let was = residual;
        residual = step.iter().map(|d| d.abs().max_element()).fold(0.0, f64::max) / pose.extent;
        // Where rounding is reached, steps no longer become shorter.
        if residual <= tolerances::KKT || (residual >= was && residual <= tolerances::KKT_ENOUGH) {
            break;
        }
        let (cost, gain) = (pose.cost(&state.displacement), pose.cost(&step));
        // How much of it to go at first: as the last step changed it (J. Barzilai, J. Borwein, *Two-point step size gradient methods*, 1988).
        let mut share = last.as_ref().map_or(1.0, |(at, promised)| {
            let moved: Vec<DVec3> = state.displacement.iter().zip(at).map(|(a, b)| *a - *b).collect();
            let turned: Vec<DVec3> = promised.iter().zip(&step).map(|(a, b)| *a - *b).collect();
            let quotient = pose.product(&moved, &moved) / pose.product(&moved, &turned);
            if quotient > 0.0 { quotient.clamp(1.0 / LONGEST, LONGEST) } else { 1.0 }
        });
        let next = (0..HALVINGS).find_map(|_| {
            let partial = state.displacement.iter().zip(&step).map(|(at, d)| *at + *d * share).collect();
            let (next, _) = pose.restored(pose.state(partial, wanted), wanted, None);
            let is_less = pose.cost(&next.displacement) <= cost - DECREASE * share * gain;
            // Near the end costs differ by less than rounding.
            let is_near = residual <= tolerances::NEAR_VOLUME && next.miss <= tolerances::VOLUME;
            share /= 2.0;
            (is_near || (is_less && next.miss <= tolerances::NEAR_VOLUME)).then_some(next)
        });
        let Some(next) = next else { break };
        last = Some((std::mem::replace(&mut state, next).displacement, step));
        steps += 1;
    }
    let of_points = state.lacks[wanted.volumes.len()..].iter().map(|lack| lack.abs()).fold(0.0, f64::max);
    let is_met = relative_error(&wanted.volumes, &state.volumes) <= tolerances::VOLUME
        && of_points <= tolerances::POINT * pose.extent;
    if !is_met && !is_nearest {
        return Err(impossible(Reason::Turns { limit: state.volumes.total }));
    }
    // The search for the nearest pose has not ended where something is lacking.
    let residual = if is_met { residual } else { residual.max(state.miss) };
    let status =
        if is_nearest && (!is_met || residual > tolerances::KKT_ENOUGH) { Status::NotNearest } else { Status::Exact };
    Ok(ended(state, status, steps, is_nearest.then_some(residual)))
}

fn relative_error(goals: &[VolumeGoal], volumes: &Volumes) -> f64 {
    goals.iter().map(|goal| (goal.volume - goal.of(volumes)).abs() / goal.volume.abs()).fold(0.0, f64::max)
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

impl GreenPose<'_> {
    /// What a displacement costs: `Σ δ²/m`.
    fn cost(&self, displacement: &[DVec3]) -> f64 {
        self.product(displacement, displacement)
    }

    /// `Σ a b/m`.
    fn product(&self, a: &[DVec3], b: &[DVec3]) -> f64 {
        let of = |a: f64, b: f64, m: f64| if m > 0.0 { a * b / m } else { 0.0 };
        let pairs = a.iter().zip(b).zip(self.mobility);
        pairs.map(|((a, b), m)| of(a.x, b.x, m.x) + of(a.y, b.y, m.y) + of(a.z, b.z, m.z)).sum()
    }

    /// A state that lacks nothing, if Newton's method comes to one: by the smallest steps, or along given directions. And how many steps it took.
    fn restored(&self, mut state: State, wanted: &Wanted, lines: Option<&[Vec<DVec3>]>) -> (State, usize) {
        let mut steps = 0;
        while state.miss > tolerances::VOLUME_ROUNDING && steps < STEPS {
            let rows = self.rows(&state, wanted);
            let Some(step) = self.combined(&rows, lines.unwrap_or(&rows), &state.lacks) else { break };
            let mut share = 1.0;
            // What rounding left does not go away by shorter steps.
            let tries = if state.miss <= tolerances::VOLUME { 1 } else { HALVINGS };
            let next = (0..tries).find_map(|_| {
                let partial = state.displacement.iter().zip(&step).map(|(at, d)| *at + *d * share).collect();
                let next = self.state(partial, wanted);
                share /= 2.0;
                (next.miss < state.miss).then_some(next)
            });
            let Some(next) = next else { break };
            state = next;
            steps += 1;
        }
        (state, steps)
    }

    fn state(&self, displacement: Vec<DVec3>, wanted: &Wanted) -> State {
        let posed = displaced(self.posed, &displacement);
        let (before, after) = (self.cage.displacement(self.posed), self.cage.displacement(&posed));
        let vertices = self.cage.binding().displaced(self.rest, &after);
        let volumes = self.solid.volumes(&vertices);
        let of_volumes = wanted.volumes.iter().map(|goal| goal.volume - goal.of(&volumes));
        let of_points = wanted.points.iter().flat_map(|point| {
            let moved: DVec3 = point.weights.iter().map(|(c, w)| (after[*c] - before[*c]) * *w).sum();
            (point.target - point.position - moved).to_array()
        });
        let lacks: Vec<f64> = of_volumes.chain(of_points).collect();
        let far = lacks[wanted.volumes.len()..].iter().map(|lack| lack.abs()).fold(0.0, f64::max) / self.extent;
        let miss = relative_error(&wanted.volumes, &volumes).max(far);
        State { displacement, vertices, volumes, lacks, miss }
    }

    /// The derivatives A of what is wanted by the cage's vertices.
    fn rows(&self, state: &State, wanted: &Wanted) -> Vec<Vec<DVec3>> {
        let posed = displaced(self.posed, &state.displacement);
        let of_goal = |goal: &VolumeGoal| {
            let by_point = match &goal.components {
                Components::All => self.solid.volume_gradient(&state.vertices),
                Components::These(these) => {
                    let weight = |c: usize| if these.contains(&c) { 1.0 } else { 0.0 };
                    let weights: Vec<f64> = (0..self.solid.component_count()).map(weight).collect();
                    self.solid.weighted_gradient(&state.vertices, &weights)
                }
            };
            self.cage.gradient(&posed, &by_point)
        };
        let of_point = |(weights, axis): (&Vec<(usize, f64)>, usize)| {
            let mut by_control = vec![DVec3::ZERO; self.cage.binding().control_count()];
            weights.iter().for_each(|(c, w)| by_control[*c][axis] = *w);
            self.cage.pulled(&posed, by_control)
        };
        let coordinates = wanted.points.iter().flat_map(|point| (0..3).map(move |axis| (&point.weights, axis)));
        wanted.volumes.iter().map(of_goal).chain(coordinates.map(of_point)).collect()
    }

    /// `M Dᵀ (A M Dᵀ)⁻¹ b` for the rows A and the directions D; `None` where the matrix is singular.
    fn combined(&self, rows: &[Vec<DVec3>], directions: &[Vec<DVec3>], asked: &[f64]) -> Option<Vec<DVec3>> {
        let mobile: Vec<Vec<DVec3>> =
            directions.iter().map(|row| row.iter().zip(self.mobility).map(|(x, m)| *x * *m).collect()).collect();
        let size = |k: usize| dot(&rows[k], &mobile[k]).abs().sqrt();
        let sizes: Vec<f64> = (0..rows.len()).map(size).collect();
        if sizes.contains(&0.0) {
            return None;
        }
        let gram = Square::of(rows.len(), |i, j| dot(&rows[i], &mobile[j]) / (sizes[i] * sizes[j]));
        let scaled: Vec<f64> = asked.iter().zip(&sizes).map(|(b, size)| b / size).collect();
        let multipliers = gram.solved(&scaled);
        if !multipliers.iter().all(|x| x.is_finite()) {
            return None;
        }
        let mut sum = vec![DVec3::ZERO; self.posed.len()];
        for ((mobile, multiplier), size) in mobile.iter().zip(multipliers).zip(sizes) {
            sum.iter_mut().zip(mobile).for_each(|(sum, x)| *sum += *x * (multiplier / size));
        }
        Some(sum)
    }
}
