//! Where springs settle while volumes, moments and points keep their values: Newton's method on the surface of such poses.
//!
//! ```text
//! min E(C)  subject to  V(C) = V_ref,  w · C = T,  …
//! ```
//!
//! Each step d is the least of `½ dᵀ H d + ∇Eᵀ d` along the tangents of the surface, `H = ∇²E − Σ λ ∇²V`, with the multipliers λ that leave least of
//! `∇E − Σ λ ∇V` ([`crate::kkt`]). What it leads to is brought back to the surface by the smallest steps, so that every pose has the wanted
//! volumes, and the energy falls from one to the next. Where H is not positive definite on the tangents, a pose may be on a ridge, where forces balance
//! too; then a direction of negative curvature leads down. With H as it is, convergence is quadratic; without `∇²V`, which is most of it, linear
//! (λ is 45 to 125 for HML's torus).
//!
//! # Changes versus the paper
//!
//! HML, section 3.5, has the volume by a penalty that grows; here no pose has another.

use glam::{DMat3, DVec3};

use crate::block_matrix::BlockPattern;
use crate::kkt::{Curved, Kkt, KktStep};
use crate::measure::{Measure, Survey};
use crate::rows::{Missed, Rows, dot};
use crate::springs::{Spring, Springs};
use crate::tolerances;

/// Halvings of a step at most. More: hopeless steps cost time; fewer: steps on strongly curved surfaces are given up.
const HALVINGS: usize = 30;

/// Part of the slope's promise that a step must keep (Nocedal, Wright: c₁). Larger: good steps are shortened; smaller: steps that gain hardly
/// anything.
const KEPT: f64 = 1e-4;

/// Where H is not convex, a step that promises more than this part of the energy is taken without looking for negative curvature. Larger: it is
/// looked for where the slope leads further; smaller: ridges are approached slowly.
const FAR: f64 = 1e-3;

/// Energies this close are equal to rounding.
const ROUNDING: f64 = 1e-13;

/// A point of the model, or any other combination of nodes, that must come to a place.
#[derive(Clone, Debug)]
pub(crate) struct PointCondition {
    /// Nodes and their weights.
    pub(crate) weights: Vec<(usize, f64)>,
    /// What the weighted sum of their places must be.
    pub(crate) sum: DVec3,
}

/// What must hold.
#[derive(Clone, Copy)]
pub(crate) struct Conditions<'a> {
    pub(crate) measure: &'a dyn Measure,
    /// What each number of the measure must be.
    pub(crate) targets: &'a [f64],
    /// What errors of each are relative to.
    pub(crate) scales: &'a [f64],
    pub(crate) points: &'a [PointCondition],
    /// What errors of points are relative to.
    pub(crate) extent: f64,
}

/// The nodes at some places.
#[derive(Clone, Debug)]
pub(crate) struct Pose {
    pub(crate) places: Vec<DVec3>,
    pub(crate) energy: f64,
    /// What is left to the values wanted: of points along x, y, z, then of numbers.
    open: Vec<f64>,
    /// Gradients of both (each #unknowns).
    rows: Rows,
    /// λ of each.
    pub(crate) multipliers: Vec<f64>,
    /// ∇E − Σ λ ∇V (#unknowns).
    forces: Vec<f64>,
    /// Its largest entry, in forces that stretch a spring by its own length.
    pub(crate) residual: f64,
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// Forces balance.
    Balanced,
    /// No step leads lower, and forces do not balance.
    Stuck,
    /// The steps were used up.
    Limit,
    /// It was stopped.
    Stopped,
}

/// Searches among the poses of a pattern of unknowns.
#[derive(Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) conditions: Conditions<'a>,
    pub(crate) springs: &'a Springs,
    pub(crate) pattern: &'a BlockPattern,
}

impl Conditions<'_> {
    /// What errors of a row are relative to: points along x, y, z come first.
    fn scale(&self, row: usize) -> f64 {
        row.checked_sub(3 * self.points.len()).map_or(self.extent, |number| self.scales[number])
    }

    /// The largest relative error of a pose.
    pub(crate) fn error_of(&self, pose: &Pose) -> f64 {
        self.error(&pose.open)
    }

    fn error(&self, open: &[f64]) -> f64 {
        open.iter().enumerate().map(|(row, open)| (open / self.scale(row)).abs()).fold(0.0, f64::max)
    }
}

impl Search<'_> {
    /// The nodes at `places` (#nodes × 3).
    fn pose(&self, places: Vec<DVec3>) -> Pose {
        let survey = self.conditions.measure.survey(&places);
        self.surveyed(places, &survey)
    }

    /// The nodes at `places`, where the measure says `survey`.
    pub(crate) fn surveyed(&self, places: Vec<DVec3>, survey: &Survey) -> Pose {
        let Conditions { targets, points, .. } = &self.conditions;
        let (mut rows, mut open) = (Rows::default(), Vec::new());
        for PointCondition { weights, sum } in *points {
            let found: DVec3 = weights.iter().map(|(node, w)| *w * places[*node]).sum();
            for axis in 0..3 {
                let mut row = vec![DVec3::ZERO; places.len()];
                weights.iter().for_each(|(node, w)| row[*node][axis] += w);
                rows.push(self.pattern.pulled(&row), 0.0);
                open.push(sum[axis] - found[axis]);
            }
        }
        for ((value, target), gradient) in survey.values.iter().zip(*targets).zip(&survey.gradients) {
            rows.push(self.pattern.pulled(gradient), 0.0);
            open.push(target - value);
        }
        let slope = self.pattern.pulled(&self.springs.gradient(&places));
        let multipliers = rows.multipliers(&slope);
        let mut forces = slope;
        rows.project(&mut forces);
        let residual = forces.iter().fold(0.0, |most: f64, f| most.max(f.abs())) / self.springs.force();
        Pose { energy: self.springs.energy(&places), places, open, rows, multipliers, forces, residual }
    }

    /// A pose where all holds, from `places` by the smallest steps; if that fails, by small parts of what is wanted. `None` where that fails too.
    pub(crate) fn first(&self, places: &[DVec3]) -> Option<Pose> {
        let start = self.pose(places.to_vec());
        let whole: Vec<f64> = vec![0.0; start.open.len()];
        self.brought(start.clone(), &whole).or_else(|| self.followed(start))
    }

    /// `pose` brought to where `left` (#rows) is open, by the smallest steps: Newton's method.
    fn brought(&self, mut pose: Pose, left: &[f64]) -> Option<Pose> {
        /// How near a pose must come where rounding stops it.
        const NEAR: f64 = 1e-11;
        let still = |pose: &Pose| -> Vec<f64> { pose.open.iter().zip(left).map(|(open, left)| open - left).collect() };
        let mut open = still(&pose);
        let mut error = self.conditions.error(&open);
        while error > tolerances::VOLUME_ROUNDING {
            let (step, missed) = pose.rows.least(self.pattern.unknowns(), &open);
            if let Some(Missed { row, by }) = missed
                && by > NEAR * self.conditions.scale(row)
            {
                return None;
            }
            let next = self.pose(self.pattern.moved(&pose.places, 1.0, &step));
            let still_open = still(&next);
            let next_error = self.conditions.error(&still_open);
            let is_nearer = next_error <= 0.5 * error;
            if !is_nearer {
                return (error <= NEAR).then_some(pose);
            }
            (pose, open, error) = (next, still_open, next_error);
        }
        Some(pose)
    }

    /// A pose where all holds, followed from `start` while what is wanted goes from what it is to what it shall be.
    fn followed(&self, start: Pose) -> Option<Pose> {
        /// The shortest part of the way that is tried. Shorter: more time is lost where there is no way.
        const SHORTEST: f64 = 1e-9;
        let wanted = start.open.clone();
        let (mut pose, mut done, mut part) = (start, 0.0, 0.25);
        while done < 1.0 {
            let next = f64::min(1.0, done + part);
            let left: Vec<f64> = wanted.iter().map(|open| (1.0 - next) * open).collect();
            match self.brought(pose.clone(), &left) {
                Some(there) => (pose, done, part) = (there, next, 2.0 * part),
                None => part /= 2.0,
            }
            if part < SHORTEST {
                return None;
            }
        }
        Some(pose)
    }

    /// The step from a pose; `None` where numbers are not finite.
    fn step(&self, at: &Pose, kkt: &mut Kkt) -> Option<KktStep> {
        let q = at.rows.basis();
        let mut of_measure = vec![0.0; self.pattern.values()];
        let factors: Vec<f64> = at.multipliers[3 * self.conditions.points.len()..].iter().map(|l| -l).collect();
        if factors.iter().any(|factor| *factor != 0.0) {
            self.conditions.measure.add_second(&at.places, &factors, self.pattern, &mut of_measure);
        }
        let mut exact = of_measure.clone();
        self.springs.hessian(&at.places).for_each(|(spring, block)| self.add_spring(&mut exact, spring, block));
        if let Some(direction) = kkt.convex_step(self.pattern, &exact, q, &at.forces) {
            return Some(KktStep { direction, curved: None, is_convex: true });
        }
        // Far from where forces balance the part of H that is convex for certain leads down faster than H with something added to all of it.
        let mut convex = of_measure;
        self.springs.convex_hessian(&at.places).for_each(|(spring, block)| self.add_spring(&mut convex, spring, block));
        match kkt.convex_step(self.pattern, &convex, q, &at.forces) {
            Some(direction) if dot(&at.forces, &direction).abs() > FAR * at.energy => {
                Some(KktStep { direction, curved: None, is_convex: false })
            }
            _ => kkt.step(self.pattern, &exact, q, &at.forces),
        }
    }

    fn add_spring(&self, values: &mut [f64], spring: Spring, block: DMat3) {
        let [s, e] = spring.ends.map(|end| end as usize);
        self.pattern.add(values, s, s, block);
        self.pattern.add(values, e, e, block);
        self.pattern.add(values, s, e, -block);
    }

    /// The next pose, lower or nearer to balance; `None` where there is none.
    fn next(&self, at: &Pose, step: &KktStep) -> Option<Pose> {
        let promise = dot(&at.forces, &step.direction);
        let newton = || self.along(at, &step.direction, promise, 0.0);
        let Some(Curved { direction, curvature }) = &step.curved else { return newton() };
        // As far as springs are long: what is found there is cut back where it is too far.
        let length = self.springs.mean_length();
        let direction: Vec<f64> = direction.iter().map(|x| length * x).collect();
        let [slope, bend] = [dot(&at.forces, &direction), curvature * length * length];
        let curved = || self.along(at, &direction, slope, bend);
        if slope + bend / 2.0 < promise / 2.0 { curved().or_else(newton) } else { newton().or_else(curved) }
    }

    /// The first pose along a direction that is low enough for its slope and curvature, or nearer to balance at the same energy.
    fn along(&self, at: &Pose, direction: &[f64], slope: f64, bend: f64) -> Option<Pose> {
        let held = vec![0.0; at.open.len()];
        let mut fraction = 1.0;
        for _ in 0..HALVINGS {
            let trial = self.pose(self.pattern.moved(&at.places, fraction, direction));
            if let Some(next) = self.brought(trial, &held) {
                let promise = fraction * slope + fraction * fraction * bend / 2.0;
                let is_lower = next.energy <= at.energy + KEPT * promise;
                let is_level = next.energy <= at.energy + ROUNDING * at.energy && next.residual < at.residual;
                if is_lower || is_level {
                    return Some(next);
                }
            }
            fraction /= 2.0;
        }
        None
    }

    /// Goes on from `pose` until forces balance to `enough`, at most `steps` steps. `on_step` sees each pose and says whether to go on.
    pub(crate) fn settle(
        &self,
        mut pose: Pose,
        kkt: &mut Kkt,
        enough: f64,
        steps: usize,
        on_step: &mut dyn FnMut(&Pose) -> bool,
    ) -> (Pose, Ended) {
        // Balance on a ridge is none: whether the last step came from where the energy is convex.
        let mut is_convex = false;
        for _ in 0..steps {
            if pose.residual <= enough && is_convex {
                return (pose, Ended::Balanced);
            }
            let Some(step) = self.step(&pose, kkt) else { return (pose, Ended::Stuck) };
            is_convex = step.is_convex;
            if pose.residual <= enough && is_convex {
                return (pose, Ended::Balanced);
            }
            let Some(next) = self.next(&pose, &step) else {
                let is_balanced = pose.residual <= tolerances::BALANCE_ENOUGH && is_convex;
                return (pose, if is_balanced { Ended::Balanced } else { Ended::Stuck });
            };
            let is_rounding = next.residual > 0.5 * pose.residual && pose.residual <= tolerances::BALANCE_ENOUGH;
            pose = next;
            if !on_step(&pose) {
                return (pose, Ended::Stopped);
            }
            if is_rounding && is_convex {
                return (pose, Ended::Balanced);
            }
        }
        let ended = if pose.residual <= enough && is_convex { Ended::Balanced } else { Ended::Limit };
        (pose, ended)
    }
}
