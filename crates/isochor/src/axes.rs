//! Volume correction along one direction after the other: HB, section 5.
//!
//! With all displacements along one direction d, the volume is affine in them: `V(C + δ dᵀ) = V + Σ α_i δ_i` with
//! `α = (Wᵀ g)·d`, g = ∂V/∂P (HB (7)–(12) for d = x, y, z). So the smallest displacement that changes the volume by a has a
//! closed form, HB (17), and is exact however large it is.
//!
//! # Changes versus the paper
//!
//! - Any directions, any shares, a mobility per control coordinate, any number of points to be met (HB, section 5.2, has one), any
//!   number of volumes: each is one more affine function.
//! - A direction on which the volume does not depend (*dead*: Σ m α² vanishes against the area) is found before it is used,
//!   and its share goes to the others. Dividing by its vanishing Σ α² would send controls to infinity. A *weak* direction, on
//!   which the volume depends by little more than the rounding of a file's 32-bit floats, is used only where there is no other.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::binding::moved;
use crate::correct::{CorrectError, Problem, Reason, Slope, State};
use crate::goals::Gradients;
use crate::metric::{AxisMetric, Factors, Metric};
use crate::parallel;
use crate::points::point_rows;
use crate::rows::{Missed, Rows, dot, norm};
use crate::spare::Array;
use crate::tolerances;

/// A direction to correct along.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// Unit vector.
    pub(crate) direction: DVec3,
    share: f64,
    pub(crate) metric: AxisMetric,
}

impl Axis {
    /// x, y and z, a third each.
    pub(crate) fn coordinates(metric: &Metric) -> Vec<Self> {
        let axis = |a| Self { direction: DVec3::AXES[a], share: 1.0, metric: metric.along(a).clone() };
        [0, 1, 2].map(axis).into()
    }
}

/// The axes of a request.
pub(crate) fn prepared(
    directions: &[DVec3],
    shares: Option<&[f64]>,
    mobility: &[DVec3],
    factors: &mut Factors,
    too_large: impl Fn() -> CorrectError,
) -> Result<Vec<Axis>, CorrectError> {
    if directions.is_empty() {
        return Err(CorrectError::NoDirection);
    }
    let equal = vec![1.0; directions.len()];
    let shares = shares.unwrap_or(&equal);
    if shares.len() != directions.len() {
        let (found, expected) = (shares.len(), directions.len());
        return Err(CorrectError::Length { what: "the list of shares", found, expected });
    }
    let sum: f64 = shares.iter().sum();
    if shares.iter().any(|s| !(*s >= 0.0 && s.is_finite())) || !(sum > 0.0 && sum.is_finite()) {
        return Err(CorrectError::Shares { shares: shares.to_vec() });
    }
    let axis = |(index, (&value, &share)): (usize, (&DVec3, &f64))| {
        // try_normalize refuses what is 0, not finite, or too small to have a direction
        let direction = value.try_normalize().ok_or(CorrectError::Direction { index, value })?;
        let along: Vec<f64> = mobility.iter().map(|m| mobility_along(*m, direction)).collect();
        Ok(Axis { direction, share, metric: factors.along(&along).ok_or_else(&too_large)? })
    };
    directions.iter().zip(shares).enumerate().map(axis).collect()
}

/// What a correction along the axes did, in order.
pub(crate) enum Taken {
    /// Points were moved along an axis.
    Points {
        /// Index of the axis.
        axis: usize,
    },
    /// Volumes were changed along an axis.
    Volumes {
        /// Index of the axis.
        axis: usize,
        /// The state before.
        before: Box<State>,
        /// α of each goal that took part, pulled into the metric: the conditions of the step.
        rows: Rows,
        /// The goals that took part.
        goals: Vec<usize>,
        /// What part of each one's deficit was to be left after the step.
        left: Vec<f64>,
        /// Displacement along the axis (#controls).
        delta: Vec<f64>,
        /// The rows' multipliers: `Σ u_g row_g` is the step in the metric.
        multipliers: Vec<f64>,
    },
}

/// Corrects along `axes` in order, each taking its share of the deficits.
pub(crate) fn corrected(
    problem: &Problem,
    mut state: State,
    axes: &[Axis],
    mut trace: Option<&mut Vec<Taken>>,
) -> Result<State, CorrectError> {
    let points = AxisPoints::of(problem, &state, axes)?;
    // Volumes are taken once, before the first axis: each step is exact, so after the last one all of the deficits are gone.
    let deficits = problem.deficits(&state);
    let goals = deficits.len();
    let surface_of = |state: &State| Surface::of(problem, state, axes.len());
    let mut here = Some(surface_of(&state));
    let mut strengths = Vec::with_capacity(axes.len());
    for (k, axis) in axes.iter().enumerate() {
        let surface = here.get_or_insert_with(|| surface_of(&state));
        surface.pull(problem, axis, k, &points);
        strengths.push(surface.strengths(problem, k));
    }
    let plan = Plan::new(axes, &strengths, goals);
    if let (Some(goal), true) = (plan.dead(problem, &deficits), problem.points.is_empty()) {
        return Err(problem.impossible(Some(goal), Reason::Dead));
    }
    // What is open of each deficit, and what part of it later axes are to take. What an axis that died on the way could not take goes to
    // the next; a second pass takes what the last one left.
    let mut open = deficits.clone();
    let mut left = vec![1.0; goals];
    let mut last: Option<(usize, Rows, Vec<usize>)> = None;
    for pass in 0..3 {
        for (k, axis) in axes.iter().enumerate() {
            if pass == 0
                && let Some(delta) = points.delta(problem, &state, axis, k)?
            {
                // The points' share of this axis changes the volumes too, and linearly.
                let surface = here.get_or_insert_with(|| surface_of(&state));
                surface.pull(problem, axis, k, &points);
                surface.take(k, &delta, &mut open);
                here = None;
                state = moved_along(problem, state, axis, &delta);
                if let Some(trace) = &mut trace {
                    trace.push(Taken::Points { axis: k });
                }
            }
            let threshold = |goal: usize| if pass == 2 { Strength::Weak } else { plan.least[goal] };
            let taken: Vec<usize> = (0..goals).filter(|goal| strengths[k][*goal] >= threshold(*goal)).collect();
            for &goal in &taken {
                left[goal] = if pass == 0 { plan.left_after(goal, left[goal], axis) } else { 0.0 };
            }
            let wanted = |goal: usize| open[goal] - left[goal] * deficits[goal];
            if taken.iter().all(|goal| wanted(*goal) == 0.0) && (trace.is_none() || pass > 0 || taken.is_empty()) {
                continue;
            }
            let surface = here.get_or_insert_with(|| surface_of(&state));
            surface.pull(problem, axis, k, &points);
            let Some((rows, part)) = surface.rows(problem, k, &taken, threshold) else { continue };
            let changes: Vec<f64> = part.iter().map(|goal| wanted(*goal)).collect();
            let (z, _) = rows.least(problem.binding.control_count(), &changes);
            let delta = axis.metric.displacement(&z);
            surface.take(k, &delta, &mut open);
            part.iter().for_each(|goal| open[*goal] = left[*goal] * deficits[*goal]);
            here = None;
            let before = trace.is_some().then(|| Box::new(state.clone()));
            state = moved_along(problem, state, axis, &delta);
            if let (Some(trace), Some(before)) = (&mut trace, before) {
                let (multipliers, rows, goals) = (rows.multipliers(&z), rows.clone(), part.clone());
                let left = part.iter().map(|goal| left[*goal]).collect();
                trace.push(Taken::Volumes { axis: k, before, rows, goals, left, delta, multipliers });
            }
            last = Some((k, rows, part));
        }
    }
    // Points that rounding left off, where energies are stiff in some directions.
    if problem.point_error(&state) > f64::EPSILON {
        let points = AxisPoints::of(problem, &state, axes)?;
        for (k, axis) in axes.iter().enumerate() {
            if let Some(delta) = points.delta(problem, &state, axis, k)? {
                state = moved_along(problem, state, axis, &delta);
            }
        }
    }
    if let Some(goal) = (0..goals).find(|goal| open[*goal] != 0.0 && !problem.is_within_rounding(*goal, open[*goal])) {
        let mut surface = surface_of(&state);
        surface.pull(problem, &axes[0], 0, &points);
        let spread = surface.spread[goal];
        if !(spread * spread).is_finite() {
            return Err(problem.impossible(Some(goal), Reason::Overflow));
        }
        let is_alone = strengths.iter().all(|s| s[goal] == Strength::Dead);
        let reason = if is_alone || goals == 1 { Reason::Dead } else { Reason::Coupled { by: open[goal].abs() } };
        return Err(problem.impossible(Some(goal), reason));
    }
    Ok(problem.finished(problem.measured(state), |state, deficits, round| {
        let (k, rows, part) = match &last {
            // Steps along an axis leave its α as it is, so the last one's rows still hold.
            Some((k, rows, part)) if part.len() == goals => (*k, rows.clone(), part.clone()),
            Some((k, ..)) => {
                let k = (k + round) % axes.len();
                let mut surface = surface_of(state);
                surface.pull(problem, &axes[k], k, &points);
                let all: Vec<usize> = (0..goals).collect();
                let (rows, part) = surface.rows(problem, k, &all, |_| Strength::Weak)?;
                (k, rows, part)
            }
            None => return None,
        };
        let changes: Vec<f64> = part.iter().map(|goal| deficits[*goal]).collect();
        let (z, _) = rows.least(problem.binding.control_count(), &changes);
        Some(moved_along(problem, state.clone(), &axes[k], &axes[k].metric.displacement(&z)))
    }))
}

/// Which axis takes what part of which deficit.
struct Plan {
    /// What an axis must be good for to take a part (#goals): weak axes are used only where there are no others.
    least: Vec<Strength>,
    /// The shares of all that do (#goals).
    shares: Vec<f64>,
    axes: usize,
}

impl Plan {
    fn new(axes: &[Axis], strengths: &[Vec<Strength>], goals: usize) -> Self {
        let sum = |goal: usize, least: Strength| -> f64 {
            let able = axes.iter().zip(strengths).filter(|(_, s)| s[goal] >= least);
            able.map(|(axis, _)| axis.share).sum()
        };
        let best = |goal| if sum(goal, Strength::Good) > 0.0 { Strength::Good } else { Strength::Weak };
        let least: Vec<Strength> = (0..goals).map(best).collect();
        let shares = least.iter().enumerate().map(|(goal, least)| sum(goal, *least)).collect();
        Self { least, shares, axes: axes.len() }
    }

    /// A goal that no axis can change and that is not met.
    fn dead(&self, problem: &Problem, deficits: &[f64]) -> Option<usize> {
        (0..deficits.len()).find(|g| self.shares[*g] <= 0.0 && !problem.is_within_rounding(*g, deficits[*g]))
    }

    /// What part of a goal's deficit is left after `axis`, if `left` was before.
    fn left_after(&self, goal: usize, left: f64, axis: &Axis) -> f64 {
        let share = if self.shares[goal] > 0.0 { axis.share / self.shares[goal] } else { 0.0 };
        // The last shares sum to 1 but for rounding.
        let is_rounding = (left - share).abs() <= f64::EPSILON * self.axes as f64;
        if is_rounding { 0.0 } else { left - share }
    }
}

/// `state` after displacements `delta` (#controls) along an axis, its volumes not yet measured. Its vertices move where they are unless others
/// refer to them.
fn moved_along(problem: &Problem, mut state: State, axis: &Axis, delta: &[f64]) -> State {
    let Axis { direction, .. } = *axis;
    match Arc::get_mut(&mut state.vertices) {
        Some(vertices) => {
            let finish = |_, shift: f64, p| moved(p, direction * shift);
            problem.binding.product(delta, vertices.memory(), finish);
        }
        None => {
            let mut vertices = problem.spare.array();
            let finish = |v: usize, shift: f64, _| moved(state.vertices[v], direction * shift);
            problem.binding.product(delta, vertices.memory(), finish);
            state.vertices = Arc::new(vertices);
        }
    }
    state.displacement.iter_mut().zip(delta).for_each(|(d, by)| *d = moved(*d, direction * *by));
    State { slope: None, steps: state.steps + 1, ..state }
}

/// How much a volume depends on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Strength {
    /// Not at all, to rounding.
    Dead,
    /// By so little that controls would have to go far away.
    Weak,
    Good,
}

/// How the volumes depend on the surface as it stands.
struct Surface<'a> {
    slopes: Slopes<'a>,
    /// Σ |∂V/∂p|₁ of each, once an axis was asked for.
    spread: Vec<f64>,
    /// How they depend on displacements along each axis, once that was asked for.
    pulls: Vec<Option<Pulls>>,
}

/// From where dependences on displacements come.
enum Slopes<'a> {
    /// ∇V of the only goal.
    Known(Arc<Slope>),
    /// The only goal is the whole body, at these vertices: each axis is a sweep.
    OfWhole(Arc<Array>),
    /// ∂V/∂P of each goal.
    OfVertices(Gradients<'a>),
}

/// How the volumes depend on displacements along an axis.
struct Pulls {
    /// α of each goal (#goals × #controls).
    alphas: Vec<Vec<f64>>,
    /// Rᵀ α of each goal, less what would move a point (#goals × #controls).
    pulled: Vec<Vec<f64>>,
    /// √ of the largest mobility.
    root: f64,
}

impl<'a> Surface<'a> {
    fn of(problem: &'a Problem, state: &State, axes: usize) -> Self {
        let (slopes, spread) = match &state.slope {
            Some(slope) => (Slopes::Known(Arc::clone(slope)), vec![slope.spread]),
            None if problem.is_swept() => (Slopes::OfWhole(Arc::clone(&state.vertices)), Vec::new()),
            None => {
                let gradients = problem.gradients(state);
                let spread_of = |goal| gradients.spread_and_rough_volume(goal, &state.vertices).0;
                let spread = (0..problem.goals.len()).map(spread_of).collect();
                (Slopes::OfVertices(gradients), spread)
            }
        };
        Self { slopes, spread, pulls: (0..axes).map(|_| None).collect() }
    }

    /// Finds how the volumes depend on axis `k`, unless that is known.
    fn pull(&mut self, problem: &Problem, axis: &Axis, k: usize, points: &AxisPoints) {
        if self.pulls[k].is_some() {
            return;
        }
        // HB (10)–(12)
        let alphas: Vec<Vec<f64>> = match &self.slopes {
            Slopes::Known(slope) => vec![slope.controls.iter().map(|c| c.dot(axis.direction)).collect()],
            Slopes::OfWhole(vertices) => {
                let (alpha, spread) = problem.slope_along(vertices, axis.direction);
                self.spread = vec![spread];
                vec![alpha]
            }
            Slopes::OfVertices(gradients) => parallel::map(problem.goals.len(), |goal| {
                gradients.adjoint_along(goal, problem.binding, axis.direction)
            }),
        };
        let pulled = |alpha: &Vec<f64>| {
            let mut pulled = axis.metric.pulled(alpha);
            if let Some(rows) = &points.rows[k] {
                rows.project(&mut pulled);
            }
            pulled
        };
        let root = axis.metric.largest_mobility().sqrt();
        self.pulls[k] = Some(Pulls { pulled: alphas.iter().map(pulled).collect(), alphas, root });
    }

    /// What was found for axis `k`.
    fn pulls(&self, k: usize) -> &Pulls {
        self.pulls[k].as_ref().expect("an axis whose pulls were found")
    }

    /// Takes what displacements `delta` (#controls) along axis `k` change of the volumes, exactly, from what is `open`.
    fn take(&self, k: usize, delta: &[f64], open: &mut [f64]) {
        open.iter_mut().zip(&self.pulls(k).alphas).for_each(|(open, alpha)| *open -= dot(alpha, delta));
    }

    /// Below this, `√(Σ m α²)` has at most the strength before `strength`.
    fn least(&self, problem: &Problem, k: usize, goal: usize, strength: Strength) -> f64 {
        // A healthy axis changes the volume by about itself when controls move by the extent.
        let limit = match strength {
            Strength::Good => tolerances::WEAK_AXIS * problem.volume_scale(goal) / problem.extent,
            _ => tolerances::DEAD_AXIS * self.spread[goal],
        };
        limit * self.pulls(k).root
    }

    /// How strong each goal's dependence on axis `k` is.
    fn strengths(&self, problem: &Problem, k: usize) -> Vec<Strength> {
        let strength = |(goal, pulled): (usize, &Vec<f64>)| {
            let norm = norm(pulled);
            let exceeds = |strength| norm > self.least(problem, k, goal, strength);
            match (exceeds(Strength::Weak), exceeds(Strength::Good)) {
                (false, _) => Strength::Dead,
                (true, false) => Strength::Weak,
                (true, true) => Strength::Good,
            }
        };
        self.pulls(k).pulled.iter().enumerate().map(strength).collect()
    }

    /// The rows of those of `goals` that are at least as strong along axis `k` as they must be beside those before them, and which they
    /// are; `None` where there is none.
    fn rows(
        &self,
        problem: &Problem,
        k: usize,
        goals: &[usize],
        threshold: impl Fn(usize) -> Strength,
    ) -> Option<(Rows, Vec<usize>)> {
        let mut rows = Rows::default();
        let mut part = Vec::new();
        for &goal in goals {
            let weak = self.least(problem, k, goal, Strength::Weak);
            let least = weak.max(self.least(problem, k, goal, threshold(goal)));
            let pulled = &self.pulls(k).pulled[goal];
            if rows.is_new(pulled, least) {
                rows.push(pulled.clone(), least);
                part.push(goal);
            }
        }
        (!part.is_empty()).then_some((rows, part))
    }
}

/// The points of a request along each axis.
pub(crate) struct AxisPoints {
    /// What moves a point (#axes), where there are points.
    pub(crate) rows: Vec<Option<Rows>>,
    /// By how much each point is to move along each axis (#axes × #points).
    moves: Vec<Vec<f64>>,
}

impl AxisPoints {
    pub(crate) fn of(problem: &Problem, state: &State, axes: &[Axis]) -> Result<Self, CorrectError> {
        if problem.points.is_empty() {
            return Ok(Self { rows: vec![None; axes.len()], moves: Vec::new() });
        }
        let controls = problem.binding.control_count();
        let rows = axes.iter().map(|axis| Some(point_rows(problem.points, controls, &axis.metric))).collect();
        let split = split(axes);
        let mut moves = vec![vec![0.0; problem.points.len()]; axes.len()];
        for (point, whole) in problem.moves(state).into_iter().enumerate() {
            let parts = split.to_parts * whole;
            split.chosen.iter().enumerate().for_each(|(c, k)| moves[*k][point] = parts[c]);
            let by = (split.chosen.len()..3).map(|c| parts[c].abs()).fold(0.0, f64::max);
            if by > tolerances::POINT * problem.extent {
                return Err(problem.impossible(problem.unmet_goal(state), Reason::OffAxes { point, by }));
            }
        }
        Ok(Self { rows, moves })
    }

    /// The smallest displacement along axis `k` (#controls) that brings the points to their targets; nothing without points.
    fn delta(&self, problem: &Problem, state: &State, axis: &Axis, k: usize) -> Result<Option<Vec<f64>>, CorrectError> {
        let Some(rows) = &self.rows[k] else { return Ok(None) };
        let (z, missed) = rows.least(problem.binding.control_count(), &self.moves[k]);
        match missed {
            Some(Missed { row, by }) if by > tolerances::POINT * problem.extent => Err(problem.misses(state, row, by)),
            _ => Ok(Some(axis.metric.displacement(&z))),
        }
    }
}

/// How a vector splits into components along axes.
pub(crate) struct Split {
    /// The first axes that are independent, three at most.
    pub(crate) chosen: Vec<usize>,
    /// To components along these, then across them.
    pub(crate) to_parts: DMat3,
}

pub(crate) fn split(axes: &[Axis]) -> Split {
    let mut chosen: Vec<usize> = Vec::new();
    // The chosen directions, completed by directions across them.
    let mut frame = [DVec3::ZERO; 3];
    for (k, Axis { direction, .. }) in axes.iter().enumerate() {
        let is_independent = match chosen.len() {
            0 => true,
            1 => frame[0].cross(*direction).length() > tolerances::DEPENDENT_ROW,
            2 => frame[0].cross(frame[1]).dot(*direction).abs() > tolerances::DEPENDENT_ROW,
            _ => false,
        };
        if is_independent {
            frame[chosen.len()] = *direction;
            chosen.push(k);
        }
    }
    match chosen.len() {
        1 => (frame[1], frame[2]) = frame[0].any_orthonormal_pair(),
        2 => frame[2] = frame[0].cross(frame[1]).normalize(),
        _ => {}
    }
    Split { chosen, to_parts: DMat3::from_cols(frame[0], frame[1], frame[2]).inverse() }
}

/// The mobility m along `direction` of a control with mobility `by_coordinate` per coordinate: moving by δ along d costs
/// `Σ_c (δ d_c)²/m_c = δ²/m`. A pinned coordinate with d_c ≠ 0 pins the control.
fn mobility_along(by_coordinate: DVec3, direction: DVec3) -> f64 {
    let mut cost = 0.0;
    for (m, d) in by_coordinate.to_array().into_iter().zip(direction.to_array()) {
        if d != 0.0 {
            cost += if m == 0.0 { f64::INFINITY } else { d * d / m };
        }
    }
    1.0 / cost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mobility_along_a_direction_is_that_of_the_coordinates_it_moves() {
        let by_coordinate = DVec3::new(4.0, 0.0, 1.0);
        assert_eq!(mobility_along(by_coordinate, DVec3::X), 4.0);
        assert_eq!(mobility_along(by_coordinate, DVec3::Y), 0.0);
        // 1/m = (1/2)/4 + (1/2)/1
        let diagonal = DVec3::new(1.0, 0.0, 1.0).normalize();
        assert!((mobility_along(by_coordinate, diagonal) - 1.6).abs() < 1e-15);
        // However little of a direction moves a pinned coordinate, it pins.
        assert_eq!(mobility_along(by_coordinate, DVec3::new(1.0, 1e-200, 0.0)), 0.0);
    }
}
