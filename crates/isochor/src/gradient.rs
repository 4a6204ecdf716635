//! Volume correction in all coordinates at once, along the gradient of the volume.
//!
//! Along `D = M ∘ Wᵀ g` the volume is exactly a cubic: `V(C + t D) = V + a₁ t + a₂ t² + a₃ t³`. With d = W D and the volume's
//! gradient g(·) as a function of positions, `a₁ = Σ m (Wᵀ g)² ≥ 0`, `a₂ = Σ_v g(d)_v · x_v`, `a₃ = Σ_v g(d)_v · d_v / 3`, since V is
//! a symmetric trilinear form T(x, x, x) and g(x) = 3 T(x, x, ·). So one root of a cubic gives a correction that is exact,
//! rotates with the model, and needs no order of axes. On ordinary poses it is a few percent longer than the smallest
//! displacement that any correction could make ([`crate::nearest`]).
//!
//! The root is the one that is reached from t = 0 without the volume turning back on the way.

use crate::correct::{CorrectError, Problem, Reason, State, Step};
use crate::double;
use crate::tolerances;

/// Corrects by one step along the gradient.
pub(crate) fn corrected(problem: &Problem, state: State) -> Result<State, CorrectError> {
    let mut state = state;
    if !problem.is_met(state.volume) {
        let line = Line::at(problem, &state).ok_or_else(|| problem.impossible(Reason::Dead))?;
        let turns = |reach| problem.impossible(Reason::Turns { limit: state.volume + reach });
        let t = line.cubic(problem, &state).first_root(problem.target - state.volume).map_err(turns)?;
        state = state.after(&line.step(t));
    }
    Ok(problem.finished(state, |state, deficit| {
        let line = Line::at(problem, state)?;
        Some(line.step(deficit / line.slope))
    }))
}

/// The line `C + t D` through a state.
pub(crate) struct Line {
    /// D = M ∘ Wᵀ g (#controls × 3), less what would move a point, and d = W D (#vertices × 3).
    unit: Step,
    /// a₁ = (Wᵀ g) · D.
    pub(crate) slope: f64,
}

impl Line {
    /// `None` where the volume depends on no control.
    pub(crate) fn at(problem: &Problem, state: &State) -> Option<Self> {
        let gradient = problem.binding.adjoint(&problem.solid.volume_gradient(&state.vertices));
        let controls = problem.pull(&gradient);
        let slope = gradient.iter().zip(&controls).map(|(g, d)| g.dot(*d)).sum::<f64>();
        let most = problem.mobility.iter().map(|m| m.max_element()).fold(0.0, f64::max);
        let limit = tolerances::DEAD_AXIS * problem.solid.area(&state.vertices);
        if slope <= limit * limit * most {
            return None;
        }
        let vertices = problem.binding.apply(&controls);
        Some(Self { unit: Step { controls, vertices }, slope })
    }

    /// a₁, a₂, a₃. Coefficients below the rounding of their summed terms are 0: they are noise, and noise can bend a line
    /// back that in truth goes on.
    pub(crate) fn cubic(&self, problem: &Problem, state: &State) -> Cubic {
        /// Roundings in a term. More: true curvature is dropped; less: noise is kept.
        const ROUNDINGS: f64 = 16.0 * f64::EPSILON;
        let d = &self.unit.vertices;
        let g = problem.solid.volume_gradient(d);
        let products = |x: &'_ [glam::DVec3]| {
            let pairs = g.iter().zip(x).flat_map(|(g, x)| g.to_array().into_iter().zip(x.to_array()));
            let (sum, magnitude) = double::dot(pairs);
            if sum.abs() <= ROUNDINGS * magnitude { 0.0 } else { sum }
        };
        Cubic { a1: self.slope, a2: products(&state.vertices), a3: products(d) / 3.0 }
    }

    pub(crate) fn step(&self, t: f64) -> Step {
        let scaled = |vectors: &[glam::DVec3]| vectors.iter().map(|v| *v * t).collect();
        Step { controls: scaled(&self.unit.controls), vertices: scaled(&self.unit.vertices) }
    }
}

/// `a₁ t + a₂ t² + a₃ t³`, a₁ > 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cubic {
    a1: f64,
    a2: f64,
    a3: f64,
}

impl Cubic {
    /// The t nearest 0 with value `wanted`, such that the cubic is monotone between 0 and t. `Err`: the value at which it
    /// turns back before.
    pub(crate) fn first_root(self, wanted: f64) -> Result<f64, f64> {
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
