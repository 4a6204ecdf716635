//! HML's own method: an augmented Lagrangian, minimised level after level of detail.
//!
//! ```text
//! L_a = E + σ/2 ΔV² − λ ΔV                                                                        (19)
//! ```
//!
//! is minimised by the nodes; then `λ ← λ − σ ΔV`, and again, until |ΔV| is within ε of the volume. λ begins at 0, and σ is doubled while |ΔV| does not
//! halve (figure 3). So on the coarsest level, and with the nodes, σ and λ found there on the next, until nodes move no more from
//! one to the next (figure 4). ΔV of a level is against that level's own volume at rest.
//!
//! # Changes versus the paper
//!
//! - Points and moments have terms of their own, in the unit of the volume.
//! - The minimiser is L-BFGS (the crate `argmin`); the paper has "typical gradient descent algorithms".
//! - The paper gives neither the first σ nor its ceiling: here both are stated relative to the springs' stiffness ([`Augmented`]).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use glam::DVec3;

use crate::elastic::{Clock, ElasticStatus};
use crate::equilibrium::{PointCondition, Pose, Search};
use crate::measure::{Measure, MeshMeasure, Survey};
use crate::rows::add;

/// How HML's method goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Augmented {
    /// ε: a level ends where volumes are this near, relatively. 0.001 as in the paper.
    pub tolerance: f64,
    /// Levels end where nodes moved less than this from one to the next, in extents. 0.001 as in the paper.
    pub change: f64,
    /// The first σ, in units of `k L² / V²`: k L the largest force of a spring that is stretched by its own length L, V the volume.
    pub penalty: f64,
    /// The largest σ, in the same unit: an excessively large one "leads to numerical instability".
    pub ceiling: f64,
    /// A minimisation ends where the gradient is below this, in units of k L. Larger: λ is updated from poses that are not minima; smaller: digits
    /// are sought that the next λ changes.
    pub gradient: f64,
}

impl Default for Augmented {
    fn default() -> Self {
        Self { tolerance: 1e-3, change: 1e-3, penalty: 10.0, ceiling: 1e7, gradient: 1e-3 }
    }
}

/// What happened on a level: a row of HML's table 2.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct LevelReport {
    /// Triangles of its mesh.
    pub triangles: usize,
    /// Steps of the minimiser.
    pub steps: usize,
    /// Evaluations of its volume.
    pub evaluations: usize,
    /// σ at its end.
    pub penalty: f64,
    /// By how much volumes are off there, relatively, on its own mesh.
    pub volume_error: f64,
    /// Farthest that a coordinate of a node moved on it, in extents.
    pub change: f64,
    /// How long it took; 0 where there is no clock.
    pub milliseconds: f64,
    /// Where the nodes were at its end (#nodes × 3).
    #[cfg_attr(feature = "serde", serde(skip))]
    pub places: Vec<DVec3>,
}

/// Minimisations of a level at most, and steps of one. Ordinary ones take 5 to 10, of 5 to 50.
const ROUNDS: usize = 60;
const STEPS: u64 = 500;

/// Steps that the minimiser remembers.
const MEMORY: usize = 8;

/// The augmented Lagrangian of a level.
struct Lagrangian<'a> {
    search: &'a Search<'a>,
    measure: &'a MeshMeasure<'a>,
    /// What each number of the measure must be on this level.
    targets: Vec<f64>,
    /// From errors of points along x, y, z, then of numbers, to the unit of the volume.
    units: Vec<f64>,
    start: &'a [DVec3],
    penalty: f64,
    multipliers: Vec<f64>,
    /// What a unit of the minimiser's unknowns is in those of the nodes: its first steps are then of the right size.
    unit: f64,
    /// What was found at the last place that was asked for.
    last: RefCell<Option<Found>>,
}

/// What there is at a place.
#[derive(Clone)]
struct Found {
    /// The minimiser's unknowns.
    x: Vec<f64>,
    places: Vec<DVec3>,
    survey: Survey,
    /// ΔV of all conditions with their gradients.
    errors: Vec<(f64, Vec<f64>)>,
}

impl Lagrangian<'_> {
    /// What there is at x.
    fn at(&self, x: &[f64]) -> Found {
        if let Some(found) = &*self.last.borrow()
            && found.x == x
        {
            return found.clone();
        }
        let places = self.search.pattern.moved(self.start, self.unit, x);
        let mut errors = Vec::new();
        for PointCondition { weights, sum } in self.search.conditions.points {
            let found: DVec3 = weights.iter().map(|(node, w)| *w * places[*node]).sum();
            for axis in 0..3 {
                let mut row = vec![DVec3::ZERO; places.len()];
                weights.iter().for_each(|(node, w)| row[*node][axis] += w);
                errors.push((found[axis] - sum[axis], self.search.pattern.pulled(&row)));
            }
        }
        let survey = self.measure.survey(&places);
        for ((value, target), gradient) in survey.values.iter().zip(&self.targets).zip(&survey.gradients) {
            errors.push((value - target, self.search.pattern.pulled(gradient)));
        }
        for ((error, gradient), unit) in errors.iter_mut().zip(&self.units) {
            *error *= unit;
            gradient.iter_mut().for_each(|g| *g *= unit);
        }
        let found = Found { x: x.to_vec(), places, survey, errors };
        *self.last.borrow_mut() = Some(found.clone());
        found
    }

    /// L_a there.
    fn value(&self, found: &Found) -> f64 {
        let term = |((error, _), multiplier): (&(f64, Vec<f64>), &f64)| {
            self.penalty / 2.0 * error * error - multiplier * error
        };
        self.search.springs.energy(&found.places) + found.errors.iter().zip(&self.multipliers).map(term).sum::<f64>()
    }

    /// Its gradient there, by the minimiser's unknowns.
    fn gradient(&self, found: &Found) -> Vec<f64> {
        let mut gradient = self.search.pattern.pulled(&self.search.springs.gradient(&found.places));
        for ((error, of_error), multiplier) in found.errors.iter().zip(&self.multipliers) {
            add(&mut gradient, self.penalty * error - multiplier, of_error);
        }
        gradient.iter_mut().for_each(|g| *g *= self.unit);
        gradient
    }
}

/// Where a Lagrangian with its multipliers is least.
struct Minimised {
    found: Found,
    /// Steps of the minimiser.
    steps: usize,
    /// How far the conditions are missed, relatively.
    error: f64,
    /// Why the search is over, where it is before conditions hold to the tolerance.
    ended: Option<ElasticStatus>,
}

impl Lagrangian<'_> {
    /// Minimises, and changes multipliers and penalty until the conditions hold to the tolerance: HML, figure 3. Errors are relative to `volume`, gradients to
    /// `force`, penalties to `unit`.
    fn minimised(
        &mut self,
        options: &Augmented,
        [volume, force, unit]: [f64; 3],
        on_step: &mut dyn FnMut(&Pose) -> bool,
    ) -> Minimised {
        let mut x = vec![0.0; self.search.pattern.unknowns()];
        let (mut steps, mut error) = (0, f64::INFINITY);
        for round in 1.. {
            let (lowest, taken) = least(self, &x, options.gradient * force * self.unit);
            x = lowest;
            steps += taken;
            let found = self.at(&x);
            let most = |most: f64, (error, _): &(f64, Vec<f64>)| most.max(error.abs());
            let still = found.errors.iter().fold(0.0, most) / volume;
            let is_over = !on_step(&self.search.surveyed(found.places.clone(), &found.survey));
            let is_met = still <= options.tolerance;
            let is_limit = !is_met && (round >= ROUNDS || !still.is_finite());
            let ended = is_over.then_some(ElasticStatus::Stopped).or(is_limit.then_some(ElasticStatus::StepLimit));
            if is_met || ended.is_some() {
                return Minimised { found, steps, error: still, ended };
            }
            if still > 0.5 * error && self.penalty < options.ceiling * unit {
                self.penalty *= 2.0;
            } else {
                for (multiplier, (error, _)) in self.multipliers.iter_mut().zip(&found.errors) {
                    *multiplier -= self.penalty * error;
                }
                error = still;
            }
        }
        unreachable!("rounds are limited")
    }
}

/// For the library.
struct Asked<'a>(&'a Lagrangian<'a>);

impl CostFunction for Asked<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, x: &Self::Param) -> Result<f64, argmin::core::Error> {
        Ok(self.0.value(&self.0.at(x)))
    }
}

impl Gradient for Asked<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, x: &Self::Param) -> Result<Self::Gradient, argmin::core::Error> {
        Ok(self.0.gradient(&self.0.at(x)))
    }
}

/// The least of a Lagrangian from x, and the steps it took. Where the line search finds nothing lower any more, that is it.
fn least(lagrangian: &Lagrangian, x: &[f64], enough: f64) -> (Vec<f64>, usize) {
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY).with_tolerance_grad(enough);
    let Ok(solver) = solver else { return (x.to_vec(), 0) };
    let run = Executor::new(Asked(lagrangian), solver)
        .configure(|state| state.param(x.to_vec()).max_iters(STEPS))
        .timer(false)
        .run();
    match run {
        Ok(result) => {
            let steps = result.state().get_iter() as usize;
            (result.state().get_best_param().cloned().unwrap_or_else(|| x.to_vec()), steps)
        }
        Err(_) => (x.to_vec(), 0),
    }
}

/// Settles the nodes, level after level, `mesh` the last. `on_step` sees each pose at the end of a minimisation and says whether to go on.
pub(crate) fn settle<'a>(
    levels: &'a [MeshMeasure<'a>],
    search: &'a Search<'a>,
    mesh: &'a MeshMeasure<'a>,
    places: &[DVec3],
    options: &Augmented,
    on_step: &mut dyn FnMut(&Pose) -> bool,
) -> (Pose, Vec<LevelReport>, ElasticStatus) {
    let conditions = &search.conditions;
    let goals = mesh.numbers.goals.len();
    let of_rest = mesh.solid.volumes(&mesh.points);
    let rest_volumes = mesh.numbers.goals.volumes(&of_rest);
    // Without a wanted volume that of the model's box stands for it.
    let volume = if goals > 0 { conditions.scales[0] } else { conditions.extent.powi(3) };
    let force = search.springs.force();
    let length = search.springs.springs().iter().map(|spring| spring.length).fold(0.0, f64::max);
    let unit = force * length / (volume * volume);
    let mut units = vec![volume / conditions.extent; 3 * conditions.points.len()];
    units.extend(conditions.scales.iter().map(|scale| volume / scale));
    // The root of what a node is held with, on average.
    let held: f64 = search.springs.hessian(places).map(|(spring, _)| 2.0 * spring.stiffness).sum();
    let stiffness = (held / search.springs.node_count() as f64).sqrt();
    let mut penalty = options.penalty * unit;
    let mut multipliers = vec![0.0; units.len()];
    let mut places = places.to_vec();
    let mut reports: Vec<LevelReport> = Vec::new();
    let mut status = ElasticStatus::Approximate;
    let mut on_mesh = None;
    let last = levels.len();
    for (index, measure) in levels.iter().chain([mesh]).enumerate() {
        let clock = Clock::start(None);
        let own = measure.numbers.goals.volumes(&measure.solid.volumes(&measure.points));
        let targets = conditions.targets.iter().enumerate().map(|(k, target)| match k < goals {
            true => target * own[k] / rest_volumes[k],
            false => *target,
        });
        let before = measure.surveys();
        let start = places.clone();
        let mut lagrangian = Lagrangian {
            search,
            measure,
            targets: targets.collect(),
            units: units.clone(),
            start: &start,
            penalty,
            multipliers: multipliers.clone(),
            unit: stiffness.recip(),
            last: RefCell::new(None),
        };
        let Minimised { found, steps, error, ended } = lagrangian.minimised(options, [volume, force, unit], on_step);
        if let Some(ended) = ended {
            status = ended;
        }
        let there = &found.places;
        let change = start.iter().zip(there).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
        (penalty, multipliers) = (lagrangian.penalty, lagrangian.multipliers);
        places.clone_from(there);
        on_mesh = (index == last).then_some(found.survey);
        reports.push(LevelReport {
            triangles: measure.solid.triangle_count(),
            steps,
            evaluations: measure.surveys() - before,
            penalty,
            volume_error: error,
            change: change / conditions.extent,
            milliseconds: clock.milliseconds(),
            places: places.clone(),
        });
        let has_settled = index > 0 && change / conditions.extent <= options.change;
        if ended.is_some() || has_settled {
            break;
        }
    }
    let survey = on_mesh.unwrap_or_else(|| mesh.survey(&places));
    (search.surveyed(places, &survey), reports, status)
}
