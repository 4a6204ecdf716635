//! The nearest pose of the wanted volumes: the true minimiser of `Σ δ²/m` subject to `V(X + W δ) = V_ref`.
//!
//! Its condition (Karush–Kuhn–Tucker) is `δ = Σ_g μ_g M ∘ ∇V_g(δ)`, the sum over the wanted volumes, with ∇V = Wᵀ g at the corrected
//! vertices: the displacement that the volumes' gradients *at the end* would make, where [`crate::gradient`] takes those at the start.
//!
//! Method: Newton's method on the surface of poses of the wanted volumes. With δ = R z ([`crate::metric`]), h = Rᵀ ∇V and multipliers μ
//! such that the tangential residual `r = z − Σ μ h` is least, a step d solves `P (I − Σ μ RᵀHR) P d = −r`, P the projection onto the
//! tangents of the surface and `H v = Wᵀ dg[W v]` the volume's Hessian, never assembled, by conjugate gradients, which stop at
//! negative curvature (T. Steihaug, *The conjugate gradient method and trust regions in large scale optimization*, 1983). Each iterate
//! is brought back to the surface by the smallest steps, so every one has the wanted volumes and the distance |z| falls from
//! one to the next: the iteration cannot diverge, however large the deficit is. Points that must come to exact places take their
//! rows out of z, h and every step. The search starts from the gradient's correction, or, where the volume turns back on that
//! line, from that along the axes, or from where the gradients lead step by step.
//!
//! *Coarse level.* On a large mesh the search runs on a coarse stand-in ([`crate::coarse`]) whose volumes are tilted by a linear function
//! of δ such that they and their gradients agree with the fine ones at the last fine iterate; then the fine mesh is evaluated at what
//! was found, and so on (defect correction). The coarse Hessian is all that is not exact, so a few fine evaluations reach the fine
//! mesh's own condition, the fewer as earlier ones are mixed in (Anderson). Where that does not come nearer any more, the search goes on on the fine mesh.
//!
//! # Changes versus the paper
//!
//! - HB states this problem, (3), and solves it axis by axis to stay explicit; here it is solved as it stands.

use std::sync::Arc;

use glam::DVec3;

use crate::axes::{self, Axis};
use crate::coarse::Coarse;
use crate::correct::{CorrectError, Normals, Problem, Slope, State, Tilt};
use crate::gradient;
use crate::rows::{Rows, add, dot};
use crate::tolerances;
use crate::volume::Volumes;

/// Newton steps at most. Ordinary poses take 3 to 6; more than 50 only where |z| is almost flat.
const STEPS: usize = 60;

/// Conjugate gradient steps for one Newton step at most. Ordinary poses take 4 to 8.
const INNER_STEPS: usize = 60;

/// Length of a step along negative curvature, in |z|. More: more halvings; less: saddles are left in more steps.
const LONG: f64 = 0.5;

/// How near to the wanted volumes, relatively, a pose must come where rounding stops it: the last steps do the rest. More: poses are
/// compared that differ in volume; less: thin bodies cannot be searched.
const NEAR: f64 = 1e-10;

/// Halvings of a step at most. More: hopeless steps cost time; fewer: steps on strongly curved surfaces are given up.
const HALVINGS: usize = 30;

/// Evaluations of the fine mesh at most, while the coarse one stands for it. Ordinary poses take 5 to 8.
const ROUNDS: usize = 20;

/// How much nearer than the fine mesh is the coarse one is searched. More: fine evaluations are wasted; less: coarse ones are.
const BEYOND: f64 = 1e-3;

/// How near the coarse one is searched at first, in extents, before it is known how far it is off: rarely by less than this. More: the
/// first evaluation of the fine mesh is wasted; less: the first search is.
const FIRST: f64 = 1e-4;

/// A pose, on the surface or near it.
struct Iterate {
    state: State,
    /// δ = R z (#unknowns).
    z: Vec<f64>,
    /// ∇V (#goals).
    slopes: Vec<Slope>,
    normals: Normals,
    /// μ (#goals).
    multipliers: Vec<f64>,
    /// z − Σ μ h, less what would move a point.
    residual: Vec<f64>,
    /// `‖δ − Σ μ M ∘ ∇V‖∞`, in extents.
    residual_norm: f64,
}

/// Corrects by the smallest displacement.
///
/// Returns the residual `‖δ − Σ μ M ∘ ∇V‖∞` too, in extents.
pub(crate) fn corrected(problem: &Problem, start: State) -> Result<(State, f64), CorrectError> {
    let search = Search { problem };
    let best = match Coarse::of(problem.solid, problem.binding, &problem.posed) {
        Some(coarse) => {
            let best = search.by_levels(&coarse, start)?;
            Iterate { state: problem.measured(best.state), ..best }
        }
        None => search.minimum(search.first(start)?, tolerances::KKT),
    };
    let (residual, normals) = (best.residual_norm, best.normals);
    let end = problem.with_points(best.state)?;
    let end = problem.finished(end, |state, deficits, round| match round {
        // The last condition's normals are those of a pose that differs by rounding.
        0 => problem.after_least_along(&normals, state, deficits),
        _ => problem.after_least(state, deficits),
    });
    Ok((end, residual))
}

struct Search<'a> {
    problem: &'a Problem<'a>,
}

impl Search<'_> {
    /// A pose on the surface to start from.
    fn first(&self, start: State) -> Result<Iterate, CorrectError> {
        let problem = self.problem;
        let along_axes = |start| {
            let axes = Axis::coordinates(problem.metric);
            axes::corrected(problem, start, &axes, None)
        };
        let straight = gradient::corrected(problem, start.clone());
        match straight.or_else(|error| along_axes(start.clone()).map_err(|_| error)) {
            Ok(first) => {
                let z = problem.metric.coordinates(&first.displacement);
                Ok(self.iterate(first, z))
            }
            Err(error) => self.followed(&start).ok_or(error),
        }
    }

    /// The nearest pose, searched from a pose on the surface until its residual is `enough`.
    fn minimum(&self, first: Iterate, enough: f64) -> Iterate {
        let mut best = first;
        for _ in 0..STEPS {
            if best.residual_norm <= enough {
                break;
            }
            let Some(next) = self.next(&best) else { break };
            // Near the end |z| is constant to rounding, and the residual tells which pose is nearer.
            let is_nearer = dot(&next.z, &next.z) < dot(&best.z, &best.z) || next.residual_norm < best.residual_norm;
            let is_stuck =
                next.residual_norm > 0.5 * best.residual_norm && best.residual_norm <= tolerances::KKT_ENOUGH;
            if is_nearer {
                best = next;
            }
            if is_stuck || !is_nearer {
                break;
            }
        }
        best
    }

    /// The nearest pose, searched on the coarse level as long as that helps.
    fn by_levels(&self, coarse: &Coarse, start: State) -> Result<Iterate, CorrectError> {
        let problem = self.problem;
        let z = problem.metric.coordinates(&start.displacement);
        let mut best = self.iterate(start.clone(), z);
        let mut missing = f64::INFINITY;
        let mut mixed = Mixed::default();
        for _ in 0..ROUNDS {
            let enough = (BEYOND * missing).clamp(tolerances::KKT, FIRST);
            let Some(found) = self.coarse_minimum(coarse, &best, enough) else { break };
            let z = mixed.next(&best.z, found);
            let next = self.iterate(self.unmeasured(&z, best.state.steps + 1), z);
            let volumes = next.slopes.iter().map(|slope| slope.rough_volume);
            let deficits: Vec<f64> = problem.goals.targets.iter().zip(volumes).map(|(t, v)| t - v).collect();
            let Ok(to_surface) = problem.least(&next.normals, &deficits) else { break };
            let off = problem.metric.residual(&to_surface) / problem.extent;
            let still_missing = next.residual_norm.max(off);
            let is_nearer = still_missing <= 0.5 * missing;
            if !is_nearer {
                break;
            }
            (best, missing) = (next, still_missing);
            if missing <= tolerances::KKT_ENOUGH {
                return Ok(best);
            }
        }
        // The fine mesh must do the rest.
        let near = if missing.is_finite() { self.on_surface(&best.z, best.state.steps) } else { None };
        let first = match near {
            Some((state, z)) => self.iterate(state, z),
            None => self.first(start)?,
        };
        Ok(self.minimum(first, tolerances::KKT))
    }

    /// z of the nearest pose of the coarse mesh, to a residual that is `enough`; its volumes agree with the fine ones to first order at
    /// `at`.
    fn coarse_minimum(&self, coarse: &Coarse, at: &Iterate, enough: f64) -> Option<Vec<f64>> {
        let problem = self.problem;
        let goals = problem.goals.len();
        let controls = at.state.displacement.len();
        let level = Tilt { offset: vec![0.0; goals], slope: vec![vec![DVec3::ZERO; controls]; goals] };
        let plain = problem.standing_for(&coarse.solid, &coarse.binding, &coarse.posed, level);
        let there = Search { problem: &plain }.state_at(&at.z, 0);
        let mut tilt = Tilt { offset: Vec::new(), slope: Vec::new() };
        for ((fine, coarse), coarse_volume) in
            at.slopes.iter().zip(plain.slopes(&there)).zip(plain.goal_volumes(&there))
        {
            let slope: Vec<DVec3> = fine.controls.iter().zip(&coarse.controls).map(|(f, c)| *f - *c).collect();
            let linear: f64 = slope.iter().zip(&at.state.displacement).map(|(s, d)| s.dot(*d)).sum();
            tilt.offset.push(fine.rough_volume - coarse_volume - linear);
            tilt.slope.push(slope);
        }
        let tilted = problem.standing_for(&coarse.solid, &coarse.binding, &coarse.posed, tilt);
        let search = Search { problem: &tilted };
        let first = match search.on_surface(&at.z, 0) {
            Some((state, z)) => search.iterate(state, z),
            None => search.first(search.state_at(&at.z, 0)).ok()?,
        };
        Some(search.minimum(first, enough).z)
    }

    /// A state with all that the next step needs.
    fn iterate(&self, state: State, z: Vec<f64>) -> Iterate {
        let problem = self.problem;
        let slopes = problem.slopes(&state);
        let normals = problem.normals(&slopes);
        let multipliers = normals.rows.multipliers(&z);
        let mut residual = z.clone();
        problem.project(&mut residual);
        for (multiplier, h) in multipliers.iter().zip(&normals.pulled) {
            add(&mut residual, -multiplier, h);
        }
        let residual_norm = problem.metric.residual(&residual) / problem.extent;
        Iterate { state, z, slopes, normals, multipliers, residual, residual_norm }
    }

    /// The pose of z.
    fn state_at(&self, z: &[f64], steps: usize) -> State {
        self.problem.measured(self.unmeasured(z, steps))
    }

    /// The pose of z, its volumes not measured.
    fn unmeasured(&self, z: &[f64], steps: usize) -> State {
        let problem = self.problem;
        let displacement = problem.metric.displacement(z);
        let mut vertices = problem.spare.array();
        problem.binding.displace_into(&problem.posed, &displacement, vertices.memory());
        let volumes = Volumes { total: f64::NAN, components: Vec::new() };
        State { displacement, vertices: Arc::new(vertices), volumes, slope: None, steps }
    }

    /// The next pose on the surface that is nearer, by a Newton step or a fraction of it.
    fn next(&self, at: &Iterate) -> Option<Iterate> {
        /// Distances this close are equal to rounding.
        const ROUNDING: f64 = 1e-14;
        let direction = self.newton_direction(at);
        let length = dot(&at.z, &at.z);
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            let mut z = at.z.clone();
            add(&mut z, fraction, &direction);
            if let Some((state, z)) = self.on_surface(&z, at.state.steps)
                && dot(&z, &z) <= length * (1.0 + ROUNDING)
            {
                return Some(self.iterate(state, z));
            }
            fraction /= 2.0;
        }
        None
    }

    /// The pose of z, brought to the surface by the smallest steps. `None` where that fails.
    fn on_surface(&self, z: &[f64], steps: usize) -> Option<(State, Vec<f64>)> {
        self.brought(z, steps, &vec![0.0; self.problem.goals.len()])
    }

    /// The pose of z, brought by the smallest steps to where the deficits are `left` (#goals): Newton's method. `None` where that fails.
    fn brought(&self, z: &[f64], steps: usize, left: &[f64]) -> Option<(State, Vec<f64>)> {
        let problem = self.problem;
        let open = |state: &State| -> Vec<f64> {
            problem.deficits(state).iter().zip(left).map(|(deficit, left)| deficit - left).collect()
        };
        let size = |open: &[f64]| -> f64 { open.iter().zip(&problem.goals.targets).map(|(o, t)| (o / t).abs()).sum() };
        let mut z = z.to_vec();
        let mut state = self.state_at(&z, steps + 1);
        let mut missing = open(&state);
        while missing.iter().enumerate().any(|(goal, open)| !problem.is_within_rounding(goal, *open)) {
            let normals = problem.normals(&problem.slopes(&state));
            let mut further = problem.least(&normals, &missing).ok()?;
            add(&mut further, 1.0, &z);
            let next = self.state_at(&further, steps + 1);
            let still_missing = open(&next);
            let is_nearer = size(&still_missing) <= 0.5 * size(&missing);
            if !is_nearer {
                let is_rounding = size(&missing) <= NEAR * problem.goals.len() as f64;
                return is_rounding.then_some((state, z));
            }
            (state, z, missing) = (next, further, still_missing);
        }
        Some((state, z))
    }

    /// A pose on the surface, followed from `start` along the gradients while the wanted volumes go from what they are to what they shall
    /// be. `None` where they turn back on the way.
    fn followed(&self, start: &State) -> Option<Iterate> {
        /// The shortest part of the way that is tried. Shorter: more time is lost where there is no way.
        const SHORTEST: f64 = 1e-12;
        let problem = self.problem;
        let deficits = problem.deficits(start);
        let mut z = problem.metric.coordinates(&start.displacement);
        let mut state = start.clone();
        let (mut done, mut part) = (0.0, 0.25);
        while done < 1.0 {
            let next = f64::min(1.0, done + part);
            let left: Vec<f64> = deficits.iter().map(|deficit| (1.0 - next) * deficit).collect();
            match self.brought(&z, start.steps, &left) {
                Some(there) => ((state, z), done, part) = (there, next, 2.0 * part),
                None => part /= 2.0,
            }
            if part < SHORTEST {
                return None;
            }
        }
        Some(self.iterate(state, z))
    }

    /// Conjugate gradients on `P (I − Σ μ RᵀHR) P d = −r`, as far as curvature is positive.
    fn newton_direction(&self, at: &Iterate) -> Vec<f64> {
        let problem = self.problem;
        let tangential = |v: &mut Vec<f64>| {
            problem.project(v);
            at.normals.rows.project(v);
        };
        let operator = |v: &[f64]| {
            let change = problem.slope_change(&at.state, &at.multipliers, &problem.metric.displacement(v));
            let mut result = v.to_vec();
            add(&mut result, -1.0, &problem.metric.pulled(&change));
            tangential(&mut result);
            result
        };
        let mut rest: Vec<f64> = at.residual.iter().map(|r| -r).collect();
        tangential(&mut rest);
        let mut d = vec![0.0; rest.len()];
        let mut p = rest.clone();
        let mut square = dot(&rest, &rest);
        // Superlinear: the nearer the end, the more exact.
        let relative = (square / dot(&at.z, &at.z)).sqrt();
        let enough = square * relative.clamp(1e-12, 0.01);
        for _ in 0..INNER_STEPS {
            if square == 0.0 {
                break;
            }
            let ap = operator(&p);
            let curvature = dot(&p, &ap);
            if curvature <= 0.0 {
                // |z| falls along p for good: a long step, which the search shortens as far as it must.
                let long = LONG * (dot(&at.z, &at.z) / dot(&p, &p)).sqrt();
                add(&mut d, long, &p);
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

/// A fixed-point iteration z ← G(z), hastened: D. G. Anderson, *Iterative procedures for nonlinear integral equations*, 1965.
#[derive(Default)]
struct Mixed {
    /// G(z) and G(z) − z of the last round.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Differences of G(z) between rounds.
    steps: Vec<Vec<f64>>,
    /// Differences of G(z) − z between rounds.
    changes: Rows,
}

impl Mixed {
    /// The next z, where `found` is G(z): the combination of all G so far of which the same combination of G(z) − z is least.
    fn next(&mut self, z: &[f64], found: Vec<f64>) -> Vec<f64> {
        let mut gap = found.clone();
        add(&mut gap, -1.0, z);
        if let Some((last_found, last_gap)) = &self.last {
            let (mut step, mut change) = (found.clone(), gap.clone());
            add(&mut step, -1.0, last_found);
            add(&mut change, -1.0, last_gap);
            self.steps.push(step);
            self.changes.push(change, 0.0);
        }
        let mut next = found.clone();
        for (part, step) in self.changes.multipliers(&gap).iter().zip(&self.steps) {
            add(&mut next, -part, step);
        }
        self.last = Some((found, gap));
        next
    }
}
