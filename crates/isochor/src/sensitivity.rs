//! Derivatives of a correction: how the corrected controls and vertices follow the posed controls, the wanted volumes and the points.
//!
//! With posed controls C and the corrected ones y = C + δ, all methods determine y by equations in C, the volumes T and the points' targets;
//! their derivatives are linear equations, solved with the same matrix-free products as the correction itself. Forward products
//! (Jacobian · vector) and transposed ones (vector · Jacobian) cost about one correction each, whatever the number of unknowns.
//! Posed vertices are taken to follow the posed controls, `dX = W dC`.
//!
//! - *Nearest* (δ = R z, h = Rᵀ ∇V(y), A the points' rows): the condition `z = Σ μ h + Aᵀν` with `V(y) = T` gives `(I − RᵀHR) dz − Σ h dμ
//!   − Aᵀdν = RᵀH dC`, `∇V·dy = dT`, H = Σ μ ∇²V; pinned coordinates have dy = dC.
//! - *Gradient*: `y = C₁ + Σ t_c D_c` with `D_c = R Π h_c(C₁)`, C₁ = C + δ_p after the points: dt from `∇V(y)·dy = dT`.
//! - *Axes*: each exact step `δ = R Aᵀ(A Aᵀ)⁻¹ b` in turn.
//!
//! Source: the implicit function theorem; the matrix-free Hessian is that of [`crate::nearest`].

use glam::DVec3;

use crate::axes::{Axis, AxisPoints, Taken, split};
use crate::correct::{Correction, Normals, Problem, Solved, State};
use crate::rows::{add, dot};
use crate::square::Square;

/// A correction with its derivatives.
pub struct Sensitivity<'a> {
    problem: Problem<'a>,
    correction: Correction,
    way: Linear<'a>,
}

/// A change of what a correction was given.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// Of the posed controls (#controls × 3), which the posed vertices follow.
    pub controls: Vec<DVec3>,
    /// Of the wanted volumes (one for each). Volumes that follow from those before them cannot change alone: theirs do not count.
    pub volumes: Vec<f64>,
    /// Of the points' targets (one for each). Targets that follow from those before them do not count.
    pub points: Vec<DVec3>,
}

/// A change of what came out.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    /// Of the corrected controls (#controls × 3).
    pub controls: Vec<DVec3>,
    /// Of the corrected vertices (#vertices × 3).
    pub vertices: Vec<DVec3>,
}

/// The method's equations at the solution.
enum Linear<'a> {
    Nearest(Nearest),
    Gradient(Gradient),
    Axes(Axes<'a>),
}

struct Nearest {
    end: State,
    normals: Normals,
    /// ∇V(y) of each goal (#goals × #controls × 3).
    slopes: Vec<Vec<DVec3>>,
    /// μ (#goals).
    multipliers: Vec<f64>,
}

struct Gradient {
    /// C₁.
    start: State,
    normals: Normals,
    /// t (#goals).
    along: Vec<f64>,
    /// ∇V(y) of each goal (#goals × #controls × 3).
    slopes: Vec<Vec<DVec3>>,
    /// The goals that depend on the controls.
    free: Vec<usize>,
    /// ∇V_g(y) · D_c for these (#free × #free).
    jacobian: Square,
}

struct Axes<'a> {
    axes: &'a [Axis],
    points: AxisPoints,
    steps: Vec<AxisStep>,
    /// ∇V(C) of each goal (#goals × #controls × 3).
    first_slopes: Vec<Vec<DVec3>>,
}

struct AxisStep {
    taken: Taken,
    /// For each goal that took part ∇V before the step, and `∇²V (δ dᵀ)` (#controls × 3).
    slopes: Vec<(Vec<DVec3>, Vec<DVec3>)>,
}

impl<'a> Sensitivity<'a> {
    pub(crate) fn new(solved: Solved<'a>, axes: Option<&'a [Axis]>, posed: &[DVec3]) -> Self {
        let is_nearest = solved.residual.is_some();
        let (problem, start, end, trace, correction) = solved.into_parts(posed);
        let slopes = |state: &State| -> Vec<Vec<DVec3>> {
            problem.slopes(state).into_iter().map(|slope| slope.controls).collect()
        };
        let way = match axes {
            Some(axes) => {
                let points = AxisPoints::of(&problem, &start, axes).expect("a correction that was found");
                let steps = trace.into_iter().map(|taken| AxisStep::new(&problem, axes, taken)).collect();
                Linear::Axes(Axes { axes, points, steps, first_slopes: slopes(&start) })
            }
            None if is_nearest => {
                let normals = problem.normals(&problem.slopes(&end));
                let multipliers = normals.rows.multipliers(&problem.metric.coordinates(&end.displacement));
                let slopes = slopes(&end);
                Linear::Nearest(Nearest { end, normals, slopes, multipliers })
            }
            None => {
                let normals = problem.normals(&problem.slopes(&start));
                let pairs = end.displacement.iter().zip(&start.displacement);
                let delta: Vec<DVec3> = pairs.map(|(end, start)| *end - *start).collect();
                let along = normals.rows.multipliers(&problem.metric.coordinates(&delta));
                let at_end = problem.normals(&problem.slopes(&end));
                let free: Vec<usize> = (0..along.len()).filter(|goal| normals.rows.is_independent(*goal)).collect();
                let jacobian = Square::of(free.len(), |i, j| dot(&at_end.pulled[free[i]], &normals.pulled[free[j]]));
                let slopes = slopes(&end);
                Linear::Gradient(Gradient { start, normals, along, slopes, free, jacobian })
            }
        };
        Self { problem, correction, way }
    }

    /// The correction itself.
    #[must_use]
    pub fn correction(&self) -> &Correction {
        &self.correction
    }

    /// The Jacobian times `cause`: how the result changes with it, to first order.
    ///
    /// # Panics
    ///
    /// Panics where a list does not have its length.
    #[must_use]
    pub fn forward(&self, cause: &Cause) -> Effect {
        let problem = &self.problem;
        assert_eq!(cause.controls.len(), problem.binding.control_count(), "one change for each control");
        let volumes = problem.of_goals(&cause.volumes);
        let moves = self.moves(cause);
        let controls = match &self.way {
            Linear::Nearest(nearest) => nearest.forward(problem, &cause.controls, &volumes, &moves),
            Linear::Gradient(gradient) => gradient.forward(problem, &cause.controls, &volumes, &moves),
            Linear::Axes(axes) => axes.forward(problem, &cause.controls, &volumes, &moves),
        };
        Effect { vertices: problem.returned(&problem.binding.apply(&controls), DVec3::ZERO), controls }
    }

    /// The Jacobian transposed times `effect`: the gradient, with respect to what the correction was given, of a function whose
    /// gradient with respect to the result is `effect`.
    ///
    /// # Panics
    ///
    /// Panics where a list does not have its length.
    #[must_use]
    pub fn transposed(&self, effect: &Effect) -> Cause {
        let problem = &self.problem;
        assert_eq!(effect.controls.len(), problem.binding.control_count(), "one change for each control");
        let through = problem.binding.adjoint(&problem.ordered(&effect.vertices));
        let y: Vec<DVec3> = effect.controls.iter().zip(through).map(|(c, v)| *c + v).collect();
        let (mut controls, volumes, points) = match &self.way {
            Linear::Nearest(nearest) => nearest.transposed(problem, y),
            Linear::Gradient(gradient) => gradient.transposed(problem, y),
            Linear::Axes(axes) => axes.transposed(problem, y),
        };
        // Points are posed by the controls too.
        for (point, by) in problem.points.iter().zip(&points) {
            point.weights.iter().for_each(|(c, w)| controls[*c] -= *w * *by);
        }
        Cause { controls, volumes: problem.to_wanted(&volumes), points }
    }

    /// By how much more each point is to move (#points).
    fn moves(&self, cause: &Cause) -> Vec<DVec3> {
        assert_eq!(cause.points.len(), self.problem.points.len(), "one change for each point");
        let left = |(point, to): (&crate::PointTarget, &DVec3)| {
            let posed: DVec3 = point.weights.iter().map(|(c, w)| *w * cause.controls[*c]).sum();
            *to - posed
        };
        self.problem.points.iter().zip(&cause.points).map(left).collect()
    }
}

/// Changes of the controls, the goals' volumes and the points' moves.
type Transposed = (Vec<DVec3>, Vec<f64>, Vec<DVec3>);

impl Nearest {
    fn forward(&self, problem: &Problem, controls: &[DVec3], volumes: &[f64], moves: &[DVec3]) -> Vec<DVec3> {
        let mut z = problem.least_moves(moves);
        let mut y = sum(controls, &problem.metric.displacement(&z));
        let open: Vec<f64> = self.slopes.iter().zip(volumes).map(|(slope, v)| v - inner(slope, &y)).collect();
        let (to_volume, _) = self.normals.rows.least(z.len(), &open);
        add(&mut z, 1.0, &to_volume);
        y = sum(controls, &problem.metric.displacement(&z));
        let pulled = problem.metric.pulled(&problem.slope_change(&self.end, &self.multipliers, &y));
        add(&mut z, 1.0, &self.tangential_solution(problem, pulled));
        sum(controls, &problem.metric.displacement(&z))
    }

    fn transposed(&self, problem: &Problem, y: Vec<DVec3>) -> Transposed {
        let mut z = problem.metric.pulled(&y);
        let v = self.tangential_solution(problem, z.clone());
        let change = problem.slope_change(&self.end, &self.multipliers, &problem.metric.displacement(&v));
        let mut controls = sum(&y, &change);
        add(&mut z, 1.0, &problem.metric.pulled(&change));
        let volumes = self.normals.rows.multipliers(&z);
        for (slope, volume) in self.slopes.iter().zip(&volumes) {
            let through: Vec<DVec3> = slope.iter().map(|s| *s * -volume).collect();
            add(&mut z, 1.0, &problem.metric.pulled(&through));
            controls = sum(&controls, &through);
        }
        (controls, volumes, problem.move_multipliers(&z))
    }

    /// v with `P (I − RᵀHR) P v = P b`, by conjugate gradients.
    fn tangential_solution(&self, problem: &Problem, mut b: Vec<f64>) -> Vec<f64> {
        /// Steps at most. Ordinary poses take 10 to 20.
        const STEPS: usize = 500;
        /// Smaller: rounding is chased; larger: derivatives lose digits.
        const RELATIVE: f64 = 1e-14;
        let tangential = |v: &mut Vec<f64>| {
            problem.project(v);
            self.normals.rows.project(v);
        };
        tangential(&mut b);
        let mut v = vec![0.0; b.len()];
        let mut p = b.clone();
        let mut square = dot(&b, &b);
        let enough = RELATIVE * RELATIVE * square;
        for _ in 0..STEPS {
            if square <= enough {
                break;
            }
            let change = problem.slope_change(&self.end, &self.multipliers, &problem.metric.displacement(&p));
            let mut ap = p.clone();
            add(&mut ap, -1.0, &problem.metric.pulled(&change));
            tangential(&mut ap);
            let step = square / dot(&p, &ap);
            add(&mut v, step, &p);
            add(&mut b, -step, &ap);
            let next = dot(&b, &b);
            p.iter_mut().zip(&b).for_each(|(p, b)| *p = *b + next / square * *p);
            square = next;
        }
        v
    }
}

impl Gradient {
    fn forward(&self, problem: &Problem, controls: &[DVec3], volumes: &[f64], moves: &[DVec3]) -> Vec<DVec3> {
        let mut y = sum(controls, &problem.metric.displacement(&problem.least_moves(moves)));
        let mut z = self.turned(problem, &y);
        y = sum(&y, &problem.metric.displacement(&z));
        let open: Vec<f64> = self.free.iter().map(|g| volumes[*g] - inner(&self.slopes[*g], &y)).collect();
        let along = self.jacobian.solved(&open);
        z.fill(0.0);
        for (k, goal) in self.free.iter().enumerate() {
            add(&mut z, along[k], &self.normals.pulled[*goal]);
        }
        sum(&y, &problem.metric.displacement(&z))
    }

    fn transposed(&self, problem: &Problem, mut y: Vec<DVec3>) -> Transposed {
        let z = problem.metric.pulled(&y);
        let by_direction: Vec<f64> = self.free.iter().map(|goal| dot(&self.normals.pulled[*goal], &z)).collect();
        let multipliers = self.jacobian.transposed().solved(&by_direction);
        let mut volumes = vec![0.0; self.slopes.len()];
        for (k, goal) in self.free.iter().enumerate() {
            volumes[*goal] = multipliers[k];
            y.iter_mut().zip(&self.slopes[*goal]).for_each(|(y, s)| *y -= volumes[*goal] * *s);
        }
        // K of the forward product is R Π Rᵀ H, so its transpose is H R Π Rᵀ.
        let mut z = problem.metric.pulled(&y);
        problem.project(&mut z);
        let change = problem.slope_change(&self.start, &self.along, &problem.metric.displacement(&z));
        let controls = sum(&y, &change);
        let points = problem.move_multipliers(&problem.metric.pulled(&controls));
        (controls, volumes, points)
    }

    /// How `Σ t_c h_c` turns with the controls.
    fn turned(&self, problem: &Problem, controls: &[DVec3]) -> Vec<f64> {
        let mut z = problem.metric.pulled(&problem.slope_change(&self.start, &self.along, controls));
        problem.project(&mut z);
        z
    }
}

impl AxisStep {
    fn new(problem: &Problem, axes: &[Axis], taken: Taken) -> Self {
        let Taken::Volumes { axis, before, goals, delta, .. } = &taken else {
            return Self { taken, slopes: Vec::new() };
        };
        let controls: Vec<DVec3> = delta.iter().map(|d| axes[*axis].direction * *d).collect();
        let slopes = problem.slopes(before);
        let slope = |goal: &usize| {
            let mut alone = vec![0.0; slopes.len()];
            alone[*goal] = 1.0;
            (slopes[*goal].controls.clone(), problem.slope_change(before, &alone, &controls))
        };
        Self { slopes: goals.iter().map(slope).collect(), taken }
    }
}

impl Axes<'_> {
    fn forward(&self, problem: &Problem, controls: &[DVec3], volumes: &[f64], moves: &[DVec3]) -> Vec<DVec3> {
        let split = split(self.axes);
        let mut y = controls.to_vec();
        for step in &self.steps {
            let (k, z) = match &step.taken {
                Taken::Points { axis } => {
                    let part = split.chosen.iter().position(|k| k == axis);
                    let along = |by: &DVec3| part.map_or(0.0, |part| (split.to_parts * *by)[part]);
                    let wanted: Vec<f64> = moves.iter().map(along).collect();
                    let rows = self.points.rows[*axis].as_ref().expect("a step that moved points");
                    (*axis, rows.least(controls.len(), &wanted).0)
                }
                Taken::Volumes { axis, before, rows, goals, left, multipliers, .. } => {
                    let change = problem.slope_change(before, &on_goals(goals, multipliers, volumes.len()), &y);
                    let mut z = self.pulled(*axis, &change);
                    rows.project(&mut z);
                    let open = |g: usize| {
                        let (slope, turn) = &step.slopes[g];
                        let first = inner(&self.first_slopes[goals[g]], controls);
                        (1.0 - left[g]) * volumes[goals[g]] + left[g] * first - inner(slope, &y) - inner(turn, &y)
                    };
                    let open: Vec<f64> = (0..goals.len()).map(open).collect();
                    add(&mut z, 1.0, &rows.least(controls.len(), &open).0);
                    (*axis, z)
                }
            };
            let delta = self.axes[k].metric.displacement(&z);
            y.iter_mut().zip(delta).for_each(|(y, d)| *y += self.axes[k].direction * d);
        }
        y
    }

    fn transposed(&self, problem: &Problem, mut y: Vec<DVec3>) -> Transposed {
        let split = split(self.axes);
        let mut first = vec![DVec3::ZERO; y.len()];
        let mut volumes = vec![0.0; self.first_slopes.len()];
        let mut points = vec![DVec3::ZERO; problem.points.len()];
        for step in self.steps.iter().rev() {
            match &step.taken {
                Taken::Points { axis } => {
                    let Some(part) = split.chosen.iter().position(|k| k == axis) else { continue };
                    let rows = self.points.rows[*axis].as_ref().expect("a step that moved points");
                    let multipliers = rows.multipliers(&self.axes[*axis].metric.pulled(&self.along(*axis, &y)));
                    let direction = split.to_parts.transpose().col(part);
                    points.iter_mut().zip(multipliers).for_each(|(p, m)| *p += direction * m);
                }
                Taken::Volumes { axis, before, rows, goals, left, multipliers, .. } => {
                    let mut z = self.pulled(*axis, &y);
                    let by_goal = rows.multipliers(&z);
                    rows.project(&mut z);
                    let delta = self.axes[*axis].metric.displacement(&z);
                    let moved: Vec<DVec3> = delta.iter().map(|d| self.axes[*axis].direction * *d).collect();
                    let mut next =
                        sum(&y, &problem.slope_change(before, &on_goals(goals, multipliers, volumes.len()), &moved));
                    for (g, by) in by_goal.iter().enumerate() {
                        let (slope, turn) = &step.slopes[g];
                        volumes[goals[g]] += (1.0 - left[g]) * by;
                        for c in 0..next.len() {
                            next[c] -= *by * (slope[c] + turn[c]);
                            first[c] += left[g] * *by * self.first_slopes[goals[g]][c];
                        }
                    }
                    y = next;
                }
            }
        }
        (sum(&y, &first), volumes, points)
    }

    /// What is along axis `k` of something per control (#controls).
    fn along(&self, k: usize, vectors: &[DVec3]) -> Vec<f64> {
        vectors.iter().map(|v| v.dot(self.axes[k].direction)).collect()
    }

    /// `Π Rᵀ` of what is along axis `k` (#controls).
    fn pulled(&self, k: usize, vectors: &[DVec3]) -> Vec<f64> {
        let mut z = self.axes[k].metric.pulled(&self.along(k, vectors));
        if let Some(rows) = &self.points.rows[k] {
            rows.project(&mut z);
        }
        z
    }
}

/// Numbers for some of the goals as numbers for all of them.
fn on_goals(goals: &[usize], numbers: &[f64], all: usize) -> Vec<f64> {
    let mut on_all = vec![0.0; all];
    goals.iter().zip(numbers).for_each(|(goal, number)| on_all[*goal] = *number);
    on_all
}

fn sum(a: &[DVec3], b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a + *b).collect()
}

fn inner(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}
