//! Volume correction in all coordinates at once, along the gradient of the volume.
//!
//! Along `D = M ∘ Wᵀ g` the volume is exactly a cubic: `V(C + t D) = V + a₁ t + a₂ t² + a₃ t³`. With d = W D and the volume's
//! gradient g(·) as a function of positions, `a₁ = Σ m (Wᵀ g)² ≥ 0`, `a₂ = Σ_v g(d)_v · x_v`, `a₃ = Σ_v g(d)_v · d_v / 3`, since V is
//! a symmetric trilinear form T(x, x, x) and g(x) = 3 T(x, x, ·). So one root of a cubic gives a correction that is exact,
//! rotates with the model, and needs no order of axes. On ordinary poses it is a few percent longer than the smallest
//! displacement that any correction could make ([`crate::nearest`]).
//!
//! The root is the one that is reached from t = 0 without the volume turning back on the way. Several volumes at once go along all
//! their gradients, `Σ t_c D_c`: coupled polynomials, followed from t = 0 in the same way.

use crate::correct::{CorrectError, Problem, Reason, State, Step};
use crate::rows::{add, dot, norm};
use crate::square::Square;
use crate::tolerances;

/// Corrects by one step along the gradient, or along the gradients of several volumes.
pub(crate) fn corrected(problem: &Problem, state: State) -> Result<State, CorrectError> {
    match problem.goals.len() {
        1 if !problem.is_met(&state) => return along_line(problem, &state),
        0 | 1 => {}
        _ if problem.is_met(&state) => {}
        _ => {
            let end = problem.with_points(along_all(problem, &state)?)?;
            return Ok(problem.finished(end, |state, deficits, _| problem.after_least(state, deficits)));
        }
    }
    Ok(problem.finished(problem.with_points(state)?, |state, deficits, _| problem.after_least(state, deficits)))
}

/// The exact step for one goal.
fn along_line(problem: &Problem, state: &State) -> Result<State, CorrectError> {
    let line = Line::at(problem, state).ok_or_else(|| problem.impossible(Some(0), Reason::Dead))?;
    let cubic = line.cubic(problem, state);
    let volume = problem.goal_volumes(state)[0];
    let turns = |reach| problem.impossible(Some(0), Reason::Turns { limit: volume + reach });
    let t = cubic.first_root(problem.goals.targets[0] - volume).map_err(turns)?;
    let Line { z, unit, .. } = line;
    let end = problem.with_points(problem.measured(state.after_part(unit, t)))?;
    // What rounding left is taken away along the same line, where the volume is not about to turn.
    let slope = cubic.slope(t);
    Ok(problem.finished(end, |state, deficits, round| match round {
        0 | 1 if slope > 0.5 * cubic.a1 => {
            let z: Vec<f64> = z.iter().map(|z| z * deficits[0] / slope).collect();
            Some(problem.after(state, &z))
        }
        _ => problem.after_least(state, deficits),
    }))
}

/// The line `C + t D` through a state, for one goal.
struct Line {
    /// h/|h| (#unknowns).
    z: Vec<f64>,
    /// D = R h/|h| (#controls × 3) with h = Rᵀ Wᵀ g, less what would move a point, and d = W D (#vertices × 3).
    unit: Step,
    /// a₁ = (Wᵀ g) · D = |h|.
    slope: f64,
}

impl Line {
    /// `None` where the volume depends on no control.
    fn at(problem: &Problem, state: &State) -> Option<Self> {
        let normals = problem.normals(&problem.slopes(state));
        normals.rows.is_independent(0).then(|| {
            let slope = norm(&normals.pulled[0]);
            let z: Vec<f64> = normals.pulled[0].iter().map(|h| h / slope).collect();
            Self { unit: problem.step(&z), z, slope }
        })
    }

    /// a₁, a₂, a₃. Coefficients below the rounding of their summed terms are 0: they are noise, and noise can bend a line
    /// back that in truth goes on.
    fn cubic(&self, problem: &Problem, state: &State) -> Cubic {
        /// Roundings in a term. More: true curvature is dropped; less: noise is kept.
        const ROUNDINGS: f64 = 16.0 * f64::EPSILON;
        let is_counted = |component| problem.goals.counts(0, component);
        let significant = |(sum, magnitude): (f64, f64)| if sum.abs() <= ROUNDINGS * magnitude { 0.0 } else { sum };
        let [a2, a3] = problem.solid.bends(&state.vertices, &self.unit.vertices, is_counted).map(significant);
        Cubic { a1: self.slope, a2, a3 }
    }
}

/// The step for several goals: `Σ t_c D_c` with `D_c = R h_c`, h_c the goals' normals at the start, such that all volumes come out. t is
/// followed from 0 while the wanted volumes go from what they are to what they shall be; where the volumes' Jacobian matrix by t turns
/// singular on the way, they turn back.
fn along_all(problem: &Problem, start: &State) -> Result<State, CorrectError> {
    /// The shortest part of the way that is tried. Shorter: more ends are reached that lie just before a turn.
    const SHORTEST: f64 = 1.0 / 1024.0;
    /// How near to the way Newton's steps must come where rounding stops them: the last steps start from there. More: a path may jump;
    /// less: rounding passes for a turn.
    const NEAR: f64 = 1e-9;
    let normals = problem.normals(&problem.slopes(start));
    let deficits = problem.deficits(start);
    problem.least(&normals, &deficits)?; // names goals that no displacement meets
    let goals = deficits.len();
    let free: Vec<usize> = (0..goals).filter(|goal| normals.rows.is_independent(*goal)).collect();
    // In units in which the Jacobian matrix has numbers near 1.
    let lengths: Vec<f64> = free.iter().map(|goal| norm(&normals.pulled[*goal])).collect();
    let unit = |(goal, length): (&usize, &f64)| normals.pulled[*goal].iter().map(|h| h / length).collect();
    let lines: Vec<Vec<f64>> = free.iter().zip(&lengths).map(unit).collect();
    let state_at = |t: &[f64]| {
        let mut z = vec![0.0; problem.metric.unknowns()];
        lines.iter().zip(t).for_each(|(line, t)| add(&mut z, *t, line));
        problem.measured(problem.after(start, &z))
    };
    let jacobian = |state: &State| {
        let at = problem.normals(&problem.slopes(state));
        Square::of(free.len(), |i, j| dot(&at.pulled[free[i]], &lines[j]) / lengths[i])
    };
    let size = |missing: &[f64]| -> f64 {
        missing.iter().zip(&free).map(|(m, goal)| (m / problem.goals.targets[*goal]).abs()).sum()
    };
    let mut t = vec![0.0; free.len()];
    let mut state = start.clone();
    let mut slope = jacobian(&state);
    let orientation = slope.orientation();
    let (mut done, mut part) = (0.0, 1.0);
    while done < 1.0 {
        let goal_part = f64::min(1.0, done + part);
        let missing = |state: &State| -> Vec<f64> {
            let open = problem.deficits(state);
            free.iter().map(|goal| open[*goal] - (1.0 - goal_part) * deficits[*goal]).collect()
        };
        let (mut next, mut next_slope, mut at) = (state.clone(), slope.clone(), t.clone());
        let mut has_arrived = false;
        loop {
            let open = missing(&next);
            if size(&open) <= tolerances::VOLUME_ROUNDING * goals as f64 {
                has_arrived = true;
                break;
            }
            let scaled: Vec<f64> = open.iter().zip(&lengths).map(|(open, length)| open / length).collect();
            let step = next_slope.solved(&scaled);
            let further: Vec<f64> = at.iter().enumerate().map(|(k, t)| t + step[k]).collect();
            let there = state_at(&further);
            let left = size(&missing(&there));
            // Newton's steps shrink quadratically; what does not at least halve is no longer on its way, or has arrived.
            let is_on_its_way = left <= 0.5 * size(&open);
            if !is_on_its_way {
                has_arrived = size(&open) <= NEAR * goals as f64;
                break;
            }
            (next_slope, next, at) = (jacobian(&there), there, further);
            if next_slope.orientation() != orientation {
                break;
            }
        }
        if has_arrived {
            (state, slope, t, done, part) = (next, next_slope, at, goal_part, 2.0 * part);
        } else {
            part /= 2.0;
            if part < SHORTEST {
                let goal = problem.unmet_goal(&state);
                let limit = goal.map_or(0.0, |goal| problem.goal_volumes(&state)[goal]);
                return Err(problem.impossible(goal, Reason::Turns { limit }));
            }
        }
    }
    state.steps = start.steps + 1;
    Ok(state)
}

/// `a₁ t + a₂ t² + a₃ t³`, a₁ > 0.
#[derive(Clone, Copy, Debug)]
struct Cubic {
    a1: f64,
    a2: f64,
    a3: f64,
}

impl Cubic {
    /// Its derivative at t.
    fn slope(self, t: f64) -> f64 {
        self.a1 + t * (2.0 * self.a2 + t * 3.0 * self.a3)
    }

    /// The t nearest 0 with value `wanted`, such that the cubic is monotone between 0 and t. `Err`: the value at which it
    /// turns back before.
    fn first_root(self, wanted: f64) -> Result<f64, f64> {
        // t = r · wanted/a₁ with r > 0 makes it r + b r² + c r³ = 1: near 1 where the volume is almost linear.
        let unit = wanted / self.a1;
        let (b, c) = (self.a2 * unit / self.a1, self.a3 * unit * unit / self.a1);
        let value = |r: f64| r * (1.0 + r * (b + r * c));
        let slope = |r: f64| 1.0 + r * (2.0 * b + r * 3.0 * c);
        let mut high = match first_positive_root(1.0, 2.0 * b, 3.0 * c) {
            Some(turn) if value(turn) < 1.0 => return Err(value(turn) * wanted),
            Some(turn) => turn,
            None => {
                // Monotone for ever, so it passes 1.
                let mut high = 1.0;
                while value(high) < 1.0 {
                    high *= 2.0;
                }
                high
            }
        };
        let mut low = 0.0;
        let mut r = high.min(1.0);
        // Newton, kept inside the bracket by bisection. 200 halvings pass through all of f64's range.
        for _ in 0..200 {
            let excess = value(r) - 1.0;
            if excess < 0.0 {
                low = r;
            } else {
                high = r;
            }
            let newton = r - excess / slope(r);
            let next = if newton > low && newton < high { newton } else { low + (high - low) / 2.0 };
            if next == r || excess == 0.0 {
                break;
            }
            r = next;
        }
        Ok(r * unit)
    }
}

/// The smallest r > 0 with `c0 + c1 r + c2 r² = 0`, c0 > 0.
fn first_positive_root(c0: f64, c1: f64, c2: f64) -> Option<f64> {
    let discriminant = c1 * c1 - 4.0 * c0 * c2;
    if discriminant < 0.0 {
        return None;
    }
    // Both roots without cancellation: q/c2 and c0/q.
    let q = -0.5 * (c1 + discriminant.sqrt().copysign(c1));
    [q / c2, c0 / q].into_iter().filter(|r| *r > 0.0 && r.is_finite()).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(a1: f64, a2: f64, a3: f64, wanted: f64) -> Result<f64, f64> {
        Cubic { a1, a2, a3 }.first_root(wanted)
    }

    #[test]
    fn linear_quadratic_and_cubic_with_known_roots() {
        assert_eq!(root(2.0, 0.0, 0.0, 3.0), Ok(1.5));
        assert_eq!(root(1.0, 1.0, 0.0, 2.0), Ok(1.0));
        // (1 + t)³ − 1 = 3t + 3t² + t³ takes 7 at t = 1 and −1 at t = −1, a triple root, known to ε^(1/3) only.
        assert_eq!(root(3.0, 3.0, 1.0, 7.0), Ok(1.0));
        assert!((root(3.0, 3.0, 1.0, -1.0).unwrap() + 1.0).abs() < 2e-5);
    }

    #[test]
    fn a_volume_beyond_the_turning_point_is_refused_with_what_can_be_reached() {
        // t − t² rises to 1/4 at t = 1/2.
        assert!((root(1.0, -1.0, 0.0, 0.2).unwrap() - (1.0 - 0.2f64.sqrt()) / 2.0).abs() < 1e-15);
        assert_eq!(root(1.0, -1.0, 0.0, 0.3), Err(0.25));
        // In the other direction it falls for ever.
        assert_eq!(root(1.0, -1.0, 0.0, -2.0), Ok(-1.0));
    }
}
