//! Volume correction along one direction after the other: HB, section 5.
//!
//! With all displacements along one direction d, the volume is affine in them: `V(C + δ dᵀ) = V + Σ α_i δ_i` with
//! `α = (Wᵀ g)·d`, g = ∂V/∂P (HB (7)–(12) for d = x, y, z). So the smallest displacement that changes the volume by a has a
//! closed form, HB (17), and is exact however large it is.
//!
//! # Changes versus the paper
//!
//! - Any directions, any shares, a mobility per control coordinate, any number of points to be met (HB, section 5.2, has one).
//! - A direction on which the volume does not depend (*dead*: Σ m α² vanishes against the area) is found before it is used,
//!   and its share goes to the others. Dividing by its vanishing Σ α² would send controls to infinity. A *weak* direction, on
//!   which the volume depends by little more than the rounding of a file's 32-bit floats, is used only where there is no other.

use glam::{DMat3, DVec3};

use crate::correct::{CorrectError, Problem, Reason, State, Step};
use crate::double;
use crate::mesh::Bounds;
use crate::points::{Missed, Rows};
use crate::tolerances;

/// Corrects along `directions` in order, `shares` of the deficit each (equal by default).
pub(crate) fn corrected(
    problem: &Problem,
    mut state: State,
    directions: &[DVec3],
    shares: Option<&[f64]>,
) -> Result<State, CorrectError> {
    let axes = axes(problem, &state, directions, shares)?;
    // V is taken once, before the first axis: each step is exact, so after the last one all of the deficit is gone.
    let deficit = problem.target - problem.volume_before;
    let mut surface = Surface::of(problem, &state);
    let strengths: Vec<Strength> =
        axes.iter().map(|axis| axis.sensitivity(problem, &surface).map_or(Strength::Dead, |s| s.strength)).collect();
    let shared =
        |least: Strength| axes.iter().zip(&strengths).filter(move |(_, s)| **s >= least).map(|(axis, _)| axis.share);
    // Weak axes are used only where there are no others.
    let least = if shared(Strength::Good).sum::<f64>() > 0.0 { Strength::Good } else { Strength::Weak };
    let all_shares: f64 = shared(least).sum();
    if all_shares <= 0.0 && problem.points.is_empty() {
        return Err(problem.impossible(Reason::Dead));
    }
    let mut last = None;
    // What an axis that died on the way could not take goes to the next; a second pass takes what the last one left.
    let mut open = 0.0;
    for (is_first, least) in [(true, least), (false, least), (false, Strength::Weak)] {
        for (axis, strength) in axes.iter().zip(&strengths) {
            if is_first && let Some(step) = axis.point_step(problem)? {
                // The points' share of this axis changes the volume too, and linearly: α stays as it is.
                open -= axis.change(&surface, &step);
                state = state.after(&step);
                surface = Surface::of(problem, &state);
            }
            if *strength < least {
                continue;
            }
            open += if is_first && all_shares > 0.0 { deficit * (axis.share / all_shares) } else { 0.0 };
            if open == 0.0 {
                continue;
            }
            if let Some(sensitivity) = axis.sensitivity(problem, &surface).filter(|s| s.strength >= least) {
                state = state.after(&axis.step(problem, &sensitivity, open));
                surface = Surface::of(problem, &state);
                open = 0.0;
                last = Some(axis);
            }
        }
    }
    match last {
        Some(axis) if open == 0.0 => Ok(problem.finished(state, |state, deficit| {
            let sensitivity = axis.sensitivity(problem, &Surface::of(problem, state))?;
            Some(axis.step(problem, &sensitivity, deficit))
        })),
        None if problem.is_met(problem.solid.volume(&state.vertices)) => Ok(problem.finished(state, |_, _| None)),
        _ if !(surface.area * surface.area).is_finite() => Err(problem.impossible(Reason::Overflow)),
        _ => Err(problem.impossible(Reason::Dead)),
    }
}

/// A direction to correct along.
struct Axis {
    /// Unit vector.
    direction: DVec3,
    share: f64,
    /// m along the direction (#controls).
    mobility: Vec<f64>,
    /// What moves a point along the direction, and by how much each point is to move along it, where there are points.
    points: Option<(Rows, Vec<f64>)>,
}

/// How the volume depends on displacements along an axis.
struct Sensitivity {
    /// m α, less what would move a point (#controls).
    pull: Vec<f64>,
    /// Σ m α², less the same.
    norm: f64,
    strength: Strength,
}

/// How much the volume depends on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Strength {
    /// Not at all, to rounding.
    Dead,
    /// By so little that controls would have to go far away.
    Weak,
    Good,
}

/// What sensitivities need of the surface as it stands.
struct Surface {
    /// g = ∂V/∂P (#vertices × 3).
    gradient: Vec<DVec3>,
    area: f64,
    extent: f64,
}

impl Surface {
    fn of(problem: &Problem, state: &State) -> Self {
        let (solid, vertices) = (problem.solid, &state.vertices);
        let extent = Bounds::of(vertices).map_or(0.0, |b| b.extent());
        Self { gradient: solid.volume_gradient(vertices), area: solid.area(vertices), extent }
    }
}

fn axes(
    problem: &Problem,
    state: &State,
    directions: &[DVec3],
    shares: Option<&[f64]>,
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
    // try_normalize refuses what is 0, not finite, or too small to have a direction
    let unit =
        |(index, value): (usize, &DVec3)| value.try_normalize().ok_or(CorrectError::Direction { index, value: *value });
    let units = directions.iter().enumerate().map(unit).collect::<Result<Vec<_>, _>>()?;
    let mut moves = moves_along(problem, state, &units)?.into_iter();
    let axis = |(&direction, &share): (&DVec3, &f64)| {
        let mobility: Vec<f64> = problem.mobility.iter().map(|m| mobility_along(*m, direction)).collect();
        let rows = || Rows::new(problem.points, mobility.iter().map(|m| m.sqrt()).collect());
        let points = moves.next().map(|moves| (rows(), moves));
        Axis { direction, share, mobility, points }
    };
    Ok(units.iter().zip(shares).map(axis).collect())
}

/// By how much each point is to move along each direction (#directions × #points; nothing without points): `T − S` split once, into
/// components along the first directions that are independent.
fn moves_along(problem: &Problem, state: &State, units: &[DVec3]) -> Result<Vec<Vec<f64>>, CorrectError> {
    if problem.points.is_empty() {
        return Ok(Vec::new());
    }
    let mut chosen: Vec<usize> = Vec::new();
    // The chosen directions, completed by directions across them.
    let mut frame = [DVec3::ZERO; 3];
    for (k, unit) in units.iter().enumerate() {
        let is_independent = match chosen.len() {
            0 => true,
            1 => frame[0].cross(*unit).length() > tolerances::DEPENDENT_ROW,
            2 => frame[0].cross(frame[1]).dot(*unit).abs() > tolerances::DEPENDENT_ROW,
            _ => false,
        };
        if is_independent {
            frame[chosen.len()] = *unit;
            chosen.push(k);
        }
    }
    match chosen.len() {
        1 => (frame[1], frame[2]) = frame[0].any_orthonormal_pair(),
        2 => frame[2] = frame[0].cross(frame[1]).normalize(),
        _ => {}
    }
    let split = DMat3::from_cols(frame[0], frame[1], frame[2]).inverse();
    let mut moves = vec![vec![0.0; problem.points.len()]; units.len()];
    for (point, whole) in problem.moves(state).into_iter().enumerate() {
        let parts = split * whole;
        chosen.iter().enumerate().for_each(|(c, k)| moves[*k][point] = parts[c]);
        let by = (chosen.len()..3).map(|c| parts[c].abs()).fold(0.0, f64::max);
        if by > tolerances::POINT * problem.extent {
            return Err(problem.impossible(Reason::OffAxes { point, by }));
        }
    }
    Ok(moves)
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

impl Axis {
    /// `None` where the axis is dead.
    fn sensitivity(&self, problem: &Problem, surface: &Surface) -> Option<Sensitivity> {
        let along: Vec<f64> = surface.gradient.iter().map(|g| g.dot(self.direction)).collect();
        let alpha = problem.binding.adjoint_scalar(&along); // HB (10)–(12)
        let pull: Vec<f64> = match &self.points {
            None => alpha.iter().zip(&self.mobility).map(|(a, m)| m * a).collect(),
            Some((rows, _)) => {
                let mut y: Vec<f64> = alpha.iter().zip(rows.roots()).map(|(a, s)| a * s).collect();
                rows.project(&mut y);
                y.iter().zip(rows.roots()).map(|(y, s)| y * s).collect()
            }
        };
        let norm = alpha.iter().zip(&pull).map(|(a, p)| a * p).sum::<f64>();
        let most = self.mobility.iter().copied().fold(0.0, f64::max);
        let exceeds = |limit: f64| norm > limit * limit * most;
        // A healthy axis changes the volume by about itself when controls move by the extent.
        let volume = problem.volume_before.abs().min(problem.target.abs());
        let is_good = exceeds(tolerances::WEAK_AXIS * volume / surface.extent);
        let strength = if is_good { Strength::Good } else { Strength::Weak };
        exceeds(tolerances::DEAD_AXIS * surface.area).then_some(Sensitivity { pull, norm, strength })
    }

    /// HB (17) with mobilities: `δ_i = a m_i α_i / Σ_j m_j α_j²`.
    fn step(&self, problem: &Problem, sensitivity: &Sensitivity, a: f64) -> Step {
        let factor = a / sensitivity.norm;
        self.step_of(problem, &sensitivity.pull.iter().map(|p| factor * p).collect::<Vec<_>>())
    }

    /// The smallest displacement along this axis that brings the points to their targets; nothing without points.
    fn point_step(&self, problem: &Problem) -> Result<Option<Step>, CorrectError> {
        let Some((rows, moves)) = &self.points else { return Ok(None) };
        let y = rows
            .least(moves, tolerances::POINT * problem.extent)
            .map_err(|Missed { point, by }| problem.impossible(Reason::Contradiction { point, by }))?;
        let delta: Vec<f64> = y.iter().zip(rows.roots()).map(|(y, s)| y * s).collect();
        Ok(Some(self.step_of(problem, &delta)))
    }

    /// What displacements `delta` (#controls) along this axis do.
    fn step_of(&self, problem: &Problem, delta: &[f64]) -> Step {
        let shift = problem.binding.apply_scalar(delta);
        Step {
            controls: delta.iter().map(|d| self.direction * *d).collect(),
            vertices: shift.iter().map(|s| self.direction * *s).collect(),
        }
    }

    /// By how much a step along this axis changes the volume, exactly.
    fn change(&self, surface: &Surface, step: &Step) -> f64 {
        let terms = step.vertices.iter().zip(&surface.gradient);
        double::dot(terms.map(|(s, g)| (s.dot(self.direction), g.dot(self.direction)))).0
    }
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
