//! Ways down to the least stress of a flattened grid.
//!
//! L-BFGS ([`crate::quasi_newton`]): J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd edition, 2006, algorithm 7.5, with the inverse by levels of grids
//! ([`crate::stress`]) as its first guess. CO's descent: `X ← X − ρ ∂C/∂X`.
//!
//! # Changes versus the book
//!
//! Steps are shortened until the stress falls by a stated part of what the slope promises (algorithm 3.1); they are not made longer for the
//! curvature condition. A step without it is not remembered.

use glam::DVec2;

use crate::flatten::FlattenStatus;
use crate::quasi_newton::{Memory, dot};
use crate::stress::{Inverse, Stress};

/// Steps that L-BFGS remembers. Larger: each step takes longer; smaller: more steps.
const MEMORY: usize = 8;

/// Part of the slope's promise that a step must keep (Nocedal, Wright: c₁). Larger: steps are shortened that are good enough; smaller: steps
/// that gain hardly anything.
const KEPT: f64 = 1e-4;

/// L-BFGS ends only where its model says that less is left to gain than this fraction of the tolerance. Larger: it ends too early on
/// surfaces whose stress falls slowly; smaller: steps that nobody needs.
const LEFT: f64 = 0.1;

/// A sheet whose stress is below this fraction of that of a point is isometric: lengths are right to its root, a tenth of
/// [`crate::geodesic::LENGTH`]. Larger: developable surfaces are not quite flattened; smaller: errors of lengths are chased.
const ISOMETRIC: f64 = 1e-16;

/// A step shorter than this fraction of the direction changes nothing but rounding.
const SHORTEST: f64 = 1e-8;

/// Places, all x, then all y, with their stress and its gradient.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub(crate) x: Vec<f64>,
    pub(crate) stress: f64,
    pub(crate) gradient: Vec<f64>,
}

impl State {
    pub(crate) fn new(stress: &Stress, x: Vec<f64>) -> Self {
        let (value, gradient) = stress.at(&x);
        Self { x, stress: value, gradient }
    }

    pub(crate) fn at(stress: &Stress, places: &[DVec2]) -> Self {
        Self::new(stress, places.iter().map(|p| p.x).chain(places.iter().map(|p| p.y)).collect())
    }

    pub(crate) fn places(&self) -> Vec<DVec2> {
        let (x, y) = self.x.split_at(self.x.len() / 2);
        x.iter().zip(y).map(|(x, y)| DVec2::new(*x, *y)).collect()
    }
}

/// Where a way ended, and the stress all along it.
#[derive(Clone, Debug)]
pub(crate) struct Way {
    pub(crate) state: State,
    pub(crate) status: FlattenStatus,
    pub(crate) course: Vec<f64>,
}

/// L-BFGS from `state`, at most `iterations` steps.
pub(crate) fn quasi_newton(stress: &Stress, mut state: State, tolerance: f64, iterations: usize) -> Way {
    let mut course = vec![state.stress];
    let isometric = ISOMETRIC * stress.scale();
    let mut memory = Memory::new(MEMORY);
    let mut inverse = None;
    let mut size = 1.0;
    let mut is_slow = false;
    let status = loop {
        if state.stress <= isometric {
            break FlattenStatus::Converged;
        }
        let inverse = inverse.get_or_insert_with(|| Inverse::new(stress, &state.x));
        let times = |g: &[f64]| inverse.as_ref().map_or_else(|| g.to_vec(), |inverse| inverse.times(g));
        let mut direction = memory.direction(&state.gradient, times, size);
        let mut slope = dot(&direction, &state.gradient);
        if slope >= 0.0 {
            memory.clear();
            direction = times(&state.gradient).iter().map(|d| -size * d).collect();
            slope = dot(&direction, &state.gradient);
        }
        if slope >= 0.0 || (is_slow && -0.5 * slope <= LEFT * tolerance * state.stress) {
            break FlattenStatus::Converged;
        }
        if course.len() > iterations {
            break FlattenStatus::IterationLimit;
        }
        let Some(next) = lower(stress, &state, &direction, slope) else { break FlattenStatus::Converged };
        is_slow = state.stress - next.stress <= tolerance * next.stress;
        let moved: Vec<f64> = next.x.iter().zip(&state.x).map(|(a, b)| a - b).collect();
        let turned: Vec<f64> = next.gradient.iter().zip(&state.gradient).map(|(a, b)| a - b).collect();
        let curvature = dot(&moved, &turned);
        if curvature > 0.0 {
            if memory.is_empty() {
                size = curvature / dot(&turned, &times(&turned));
            }
            memory.push(moved, turned, curvature);
        }
        state = next;
        course.push(state.stress);
    };
    Way { state, status, course }
}

/// The first state along `direction` that is low enough; none where only rounding is left.
fn lower(stress: &Stress, state: &State, direction: &[f64], slope: f64) -> Option<State> {
    let mut share = 1.0;
    while share > SHORTEST {
        let x = state.x.iter().zip(direction).map(|(x, d)| x + share * d).collect();
        let next = State::new(stress, x);
        if next.stress < state.stress && next.stress <= state.stress + KEPT * share * slope {
            return Some(next);
        }
        // The least value of the parabola through both values with the slope.
        let least = -slope * share * share / (2.0 * (next.stress - state.stress - slope * share));
        share = if least.is_finite() { least.clamp(0.1 * share, 0.5 * share) } else { 0.1 * share };
    }
    None
}

/// CO's descent from `state` with the step ρ, at most `iterations` steps.
pub(crate) fn fixed(stress: &Stress, mut state: State, step: f64, tolerance: f64, iterations: usize) -> Way {
    let mut course = vec![state.stress];
    let status = loop {
        if course.len() > iterations {
            break FlattenStatus::IterationLimit;
        }
        let x = state.x.iter().zip(&state.gradient).map(|(x, g)| x - step * g).collect();
        let next = State::new(stress, x);
        if next.stress.is_nan() || next.stress > state.stress {
            break FlattenStatus::Diverged;
        }
        let is_slow = state.stress - next.stress <= tolerance * next.stress;
        state = next;
        course.push(state.stress);
        if is_slow {
            break FlattenStatus::Converged;
        }
    };
    Way { state, status, course }
}
