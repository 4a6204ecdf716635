//! The nearest pose of the wanted volume: the true minimiser of `Σ δ²/m` subject to `V(X + W δ) = V_ref`.
//!
//! Its condition (Karush–Kuhn–Tucker) is `δ = μ M ∘ ∇V(δ)` with ∇V = Wᵀ g at the corrected vertices: the displacement that the
//! volume's gradient *at the end* would make, where [`crate::gradient`] takes that at the start.
//!
//! Method: Newton's method on the surface of poses of the wanted volume. With y = δ/√m, h = √m ∘ ∇V and the multiplier `μ =
//! (y·h)/(h·h)`, the tangential residual is `r = y − μ h`. A step d solves `P (I − μ H) P d = −r`, P the projection onto the
//! tangents of the surface and `H v = √m ∘ Wᵀ dg[W (√m ∘ v)]` the volume's Hessian, never assembled, by conjugate gradients,
//! which stop at negative curvature (T. Steihaug, *The conjugate gradient method and trust regions in large scale
//! optimization*, 1983). Each iterate is brought back to the surface by the exact cubic of [`crate::gradient`], so every one
//! has the wanted volume and the distance |y| falls from one to the next: the iteration cannot diverge, however large the
//! deficit is. Points that must come to exact places take their rows out of y, h and every step. The search starts from the
//! gradient's correction, or, where the volume turns back on that line, from that along the axes.
//!
//! # Changes versus the paper
//!
//! - HB states this problem, (3), and solves it axis by axis to stay explicit; here it is solved as it stands.

use glam::DVec3;

use crate::correct::{CorrectError, Problem, State};
use crate::gradient::Line;
use crate::tolerances;
use crate::{axes, gradient};

/// Newton steps at most. Ordinary poses take 3 to 6; more than 50 only where |y| is almost flat.
const STEPS: usize = 60;

/// Conjugate gradient steps for one Newton step at most. Ordinary poses take 4 to 8.
const INNER_STEPS: usize = 60;

/// Halvings of a step at most. More: hopeless steps cost time; fewer: steps on strongly curved surfaces are given up.
const HALVINGS: usize = 30;

/// A pose of the wanted volume.
struct Iterate {
    state: State,
    /// δ/√m (#controls × 3), 0 where m = 0.
    y: Vec<DVec3>,
    /// √m ∘ ∇V (#controls × 3), less what would move a point.
    h: Vec<DVec3>,
    /// μ.
    multiplier: f64,
    /// y − μ h, less what would move a point.
    residual: Vec<DVec3>,
    /// `‖δ − μ M ∘ ∇V‖∞`, in extents.
    residual_norm: f64,
}

/// Corrects by the smallest displacement.
///
/// Returns the residual `‖δ − μ M ∘ ∇V‖∞` too, in extents.
pub(crate) fn corrected(problem: &Problem, start: State) -> Result<(State, f64), CorrectError> {
    let first = gradient::corrected(problem, start.clone())
        .or_else(|error| axes::corrected(problem, start, &DVec3::AXES, None).map_err(|_| error))?;
    let search = Search { problem };
    let mut best = search.iterate(first);
    for _ in 0..STEPS {
        if best.residual_norm <= tolerances::KKT {
            break;
        }
        let Some(next) = search.next(&best) else { break };
        // Near the end |y| is constant to rounding, and the residual tells which pose is nearer.
        let is_nearer = dot(&next.y, &next.y) < dot(&best.y, &best.y) || next.residual_norm < best.residual_norm;
        let is_stuck = next.residual_norm > 0.5 * best.residual_norm && best.residual_norm <= tolerances::KKT_ENOUGH;
        if is_nearer {
            best = next;
        }
        if is_stuck || !is_nearer {
            break;
        }
    }
    let residual = best.residual_norm;
    let end = problem.finished(best.state, |state, deficit| {
        let line = Line::at(problem, state)?;
        Some(line.step(deficit / line.slope))
    });
    Ok((end, residual))
}

struct Search<'a> {
    problem: &'a Problem<'a>,
}

impl Search<'_> {
    /// A state on the surface with all that the next step needs.
    fn iterate(&self, state: State) -> Iterate {
        let divided = |d: DVec3, s: DVec3| DVec3::select(s.cmpeq(DVec3::ZERO), DVec3::ZERO, d / s);
        let y: Vec<DVec3> = state.displacement.iter().zip(&self.problem.roots).map(|(d, s)| divided(*d, *s)).collect();
        let gradient = self.problem.solid.volume_gradient(&state.vertices);
        let mut h = self.problem.scaled(&self.problem.binding.adjoint(&gradient));
        self.problem.project(&mut h);
        // Where the points leave nothing free, h is 0 and there is nothing to minimise.
        let square = dot(&h, &h);
        let multiplier = if square == 0.0 { 0.0 } else { dot(&y, &h) / square };
        let mut free = y.clone();
        self.problem.project(&mut free);
        let residual: Vec<DVec3> = free.iter().zip(&h).map(|(y, h)| *y - multiplier * *h).collect();
        let largest = self.problem.scaled(&residual).iter().map(|r| r.abs().max_element()).fold(0.0, f64::max);
        Iterate { state, y, h, multiplier, residual, residual_norm: largest / self.problem.extent }
    }

    /// The next pose on the surface that is nearer, by a Newton step or a fraction of it.
    fn next(&self, at: &Iterate) -> Option<Iterate> {
        let direction = self.newton_direction(at);
        let length = dot(&at.y, &at.y);
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            let y: Vec<DVec3> = at.y.iter().zip(&direction).map(|(y, d)| *y + fraction * *d).collect();
            if let Some(state) = self.on_surface(&y, at.state.steps) {
                let next = self.iterate(state);
                /// Distances this close are equal to rounding.
                const ROUNDING: f64 = 1e-14;
                if dot(&next.y, &next.y) <= length * (1.0 + ROUNDING) {
                    return Some(next);
                }
            }
            fraction /= 2.0;
        }
        None
    }

    /// The pose of y, brought back to the surface along the gradient there.
    fn on_surface(&self, y: &[DVec3], steps: usize) -> Option<State> {
        let problem = self.problem;
        let displacement = problem.scaled(y);
        let shift = problem.binding.apply(&displacement);
        let vertices: Vec<DVec3> = problem.posed.iter().zip(shift).map(|(p, d)| *p + d).collect();
        let volume = problem.solid.volume(&vertices);
        let state = State { displacement, vertices, volume, steps };
        let line = Line::at(problem, &state)?;
        let t = line.cubic(problem, &state).first_root(problem.target - volume).ok()?;
        let state = state.after(&line.step(t));
        Some(state)
    }

    /// Conjugate gradients on `P (I − μ H) P d = −r`, as far as curvature is positive.
    fn newton_direction(&self, at: &Iterate) -> Vec<DVec3> {
        let tangential = |mut v: Vec<DVec3>| {
            self.problem.project(&mut v);
            let along = dot(&v, &at.h) / dot(&at.h, &at.h);
            v.iter().zip(&at.h).map(|(v, h)| *v - along * *h).collect::<Vec<_>>()
        };
        let operator = |v: &[DVec3]| {
            let moved = self.problem.binding.apply(&self.problem.scaled(v));
            let change = self.problem.solid.volume_gradient_change(&at.state.vertices, &moved);
            let hv = self.problem.scaled(&self.problem.binding.adjoint(&change));
            tangential(v.iter().zip(hv).map(|(v, hv)| *v - at.multiplier * hv).collect())
        };
        let mut rest = tangential(at.residual.iter().map(|r| -*r).collect());
        let mut d = vec![DVec3::ZERO; rest.len()];
        let mut p = rest.clone();
        let mut square = dot(&rest, &rest);
        // Superlinear: the nearer the end, the more exact.
        let relative = (square / dot(&at.y, &at.y)).sqrt();
        let enough = square * relative.clamp(1e-12, 0.01);
        for inner in 0..INNER_STEPS {
            if square == 0.0 {
                break;
            }
            let ap = operator(&p);
            let curvature = dot(&p, &ap);
            if curvature <= 0.0 {
                if inner == 0 {
                    d = p; // steepest descent
                }
                break;
            }
            let step = square / curvature;
            add(&mut d, step, &p);
            add(&mut rest, -step, &ap);
            let next = dot(&rest, &rest);
            if next <= enough {
                break;
            }
            let ratio = next / square;
            p = rest.iter().zip(&p).map(|(r, p)| *r + ratio * *p).collect();
            square = next;
        }
        d
    }
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// a += factor · b
fn add(a: &mut [DVec3], factor: f64, b: &[DVec3]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * *b);
}
