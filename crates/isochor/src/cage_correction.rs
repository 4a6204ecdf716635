//! Volume corrections over the vertices of a cage by derivatives, for any coordinates.
//!
//! With Green coordinates vertices are no affine function of the cage, since its normals turn, so the closed forms of [`crate::correct`] do not
//! hold. What holds is the chain rule ([`crate::CageBinding::gradient`]). With A the derivatives of all wanted volumes and point coordinates by the
//! cage's vertices at C + δ, r what they lack there and M the mobilities, the smallest displacement is a fixed point of
//!
//! ```text
//! δ ← M Aᵀ (A M Aᵀ)⁻¹ (r + A δ)
//! ```
//!
//! Steps to it are halved until they make the displacement smaller, and after each of them Newton's method brings r to rounding again, so every
//! state on the way has what is wanted, as in [`crate::Method::Nearest`]. Along the gradient, A in the direction stays that of the pose, and r
//! alone is brought to rounding. Rows of A that depend on those before them are left out: they are met together, or they contradict, and are named.

use glam::DVec3;

use crate::binding::displaced;
use crate::cage_binding::CageBinding;
use crate::correct::{CorrectError, Correction, Reason, Status, Wanted, check_points, of_fault};
use crate::goals::{Components, Goals, VolumeGoal};
use crate::rows::{Missed, Rows};
use crate::square::Square;
use crate::tolerances;
use crate::volume::{Solid, Volumes};

/// Most steps. They gain a digit in one to four; more: minutes on large models.
const STEPS: usize = 200;

/// Most halvings of a step.
const HALVINGS: usize = 30;

/// Longest step, in promised ones. Larger: steps that must be halved; smaller: flat directions take long.
const LONGEST: f64 = 30.0;

/// Part of the decrease of the cost that a step promises which it must bring. Larger: short steps; smaller: steps that bring nothing.
const DECREASE: f64 = 1e-4;

/// What is corrected.
#[derive(Clone, Copy)]
pub(crate) struct CagePose<'a> {
    pub(crate) cage: &'a CageBinding,
    pub(crate) solid: &'a Solid,
    /// Points at rest (#points × 3), to which the cage is bound.
    pub(crate) rest: &'a [DVec3],
    /// The cage's vertices (#vertices × 3).
    pub(crate) posed: &'a [DVec3],
    /// Mobility of their coordinates (#vertices × 3).
    pub(crate) mobility: &'a [DVec3],
    /// Longest side of the model's box.
    pub(crate) extent: f64,
}

/// A displacement of the cage and what comes of it.
pub(crate) struct State {
    pub(crate) displacement: Vec<DVec3>,
    vertices: Vec<DVec3>,
    volumes: Volumes,
    /// What each volume, then each coordinate of each point, lacks.
    lacks: Vec<f64>,
    /// The largest of them, of volumes relative to what is wanted, of points in extents.
    miss: f64,
}

/// What is wanted, without volumes that follow from others.
pub(crate) struct Wishes<'a> {
    /// As it was asked for.
    wanted: &'a Wanted,
    /// Volumes that do not follow from one another.
    volumes: Vec<&'a VolumeGoal>,
}

/// How a search ended.
pub(crate) struct Found {
    pub(crate) state: State,
    pub(crate) status: Status,
    pub(crate) steps: usize,
    pub(crate) residual: Option<f64>,
}

/// Corrects by the smallest displacement of the cage's vertices, or, if `is_nearest` is not so, along the gradients at the pose.
pub(crate) fn corrected(pose: &CagePose, wanted: &Wanted, is_nearest: bool) -> Result<Correction, CorrectError> {
    let (wishes, start) = pose.checked(wanted)?;
    let volume_before = start.volumes.total;
    let found = pose.searched(&wishes, start, is_nearest)?;
    Ok(pose.correction(&wishes, volume_before, found))
}

fn relative_error(goals: &[VolumeGoal], volumes: &Volumes) -> f64 {
    goals.iter().map(|goal| (goal.volume - goal.of(volumes)).abs() / goal.volume.abs()).fold(0.0, f64::max)
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

/// A row times √M (3 #vertices).
pub(crate) fn scaled(row: &[DVec3], mobility: &[DVec3]) -> Vec<f64> {
    let of = |(x, m): (&DVec3, &DVec3)| [x.x * m.x.sqrt(), x.y * m.y.sqrt(), x.z * m.z.sqrt()];
    row.iter().zip(mobility).flat_map(of).collect()
}

impl CagePose<'_> {
    /// What is wanted, where that makes sense, and the pose itself.
    pub(crate) fn checked<'w>(&self, wanted: &'w Wanted) -> Result<(Wishes<'w>, State), CorrectError> {
        check_points(&wanted.points, self.cage.binding().control_count())?;
        let (vertices, volumes) = self.carried(self.posed);
        let goals = Goals::new(&wanted.volumes, self.solid.component_count())
            .map_err(|fault| of_fault(fault, &wanted.volumes, &volumes))?;
        let wishes = Wishes { wanted, volumes: goals.index.iter().map(|k| &wanted.volumes[*k]).collect() };
        let start = self.state_of(vec![DVec3::ZERO; self.posed.len()], vertices, volumes, &wishes);
        Ok((wishes, start))
    }

    /// Searches from `start`, the pose itself.
    pub(crate) fn searched(&self, wishes: &Wishes, start: State, is_nearest: bool) -> Result<Found, CorrectError> {
        if start.miss <= tolerances::VOLUME_ROUNDING {
            let residual = is_nearest.then_some(0.0);
            return Ok(Found { state: start, status: Status::AlreadyMet, steps: 0, residual });
        }
        let volume_before = start.volumes.total;
        let impossible = |reason| self.impossible(wishes, volume_before, reason);
        if self.mobility.iter().all(|m| *m == DVec3::ZERO) {
            return Err(impossible(Reason::Pinned));
        }
        let first = self.rows(&start, wishes);
        let lines = (!is_nearest).then_some(&first[..]);
        let (mut state, mut steps) = self.restored(start, wishes, lines);
        let mut residual = f64::INFINITY;
        // The displacement before the last step, and the step that was promised there.
        let mut last: Option<(Vec<DVec3>, Vec<DVec3>)> = None;
        while is_nearest && state.miss <= tolerances::NEAR_VOLUME && steps < STEPS {
            let rows = self.rows(&state, wishes);
            let asked: Vec<f64> =
                state.lacks.iter().zip(&rows).map(|(lack, row)| lack + dot(row, &state.displacement)).collect();
            let to = self.combined(&rows, None, &asked);
            let step: Vec<DVec3> = to.iter().zip(&state.displacement).map(|(a, b)| *a - *b).collect();
            let was = residual;
            residual = step.iter().map(|d| d.abs().max_element()).fold(0.0, f64::max) / self.extent;
            // Where rounding is reached, steps no longer become shorter.
            if residual <= tolerances::KKT || (residual >= was && residual <= tolerances::KKT_ENOUGH) {
                break;
            }
            let (cost, gain) = (self.cost(&state.displacement), self.cost(&step));
            // How much of it to go at first: as the last step changed it (J. Barzilai, J. Borwein, *Two-point step size gradient methods*, 1988).
            let mut share = last.as_ref().map_or(1.0, |(at, promised)| {
                let moved: Vec<DVec3> = state.displacement.iter().zip(at).map(|(a, b)| *a - *b).collect();
                let turned: Vec<DVec3> = promised.iter().zip(&step).map(|(a, b)| *a - *b).collect();
                let quotient = self.product(&moved, &moved) / self.product(&moved, &turned);
                if quotient > 0.0 { quotient.clamp(1.0 / LONGEST, LONGEST) } else { 1.0 }
            });
            let next = (0..HALVINGS).find_map(|_| {
                let partial = state.displacement.iter().zip(&step).map(|(at, d)| *at + *d * share).collect();
                let (next, _) = self.restored(self.state(partial, wishes), wishes, None);
                let is_less = self.cost(&next.displacement) <= cost - DECREASE * share * gain;
                // Near the end costs differ by less than rounding.
                let is_near = residual <= tolerances::NEAR_VOLUME && next.miss <= tolerances::VOLUME;
                share /= 2.0;
                (is_near || (is_less && next.miss <= tolerances::NEAR_VOLUME)).then_some(next)
            });
            let Some(next) = next else { break };
            last = Some((std::mem::replace(&mut state, next).displacement, step));
            steps += 1;
        }
        let is_met = self.is_met(&state, wishes);
        if !is_met && let Some(reason) = self.contradiction(&state, wishes) {
            return Err(impossible(reason));
        }
        if !is_met && !is_nearest {
            return Err(impossible(Reason::Turns { limit: state.volumes.total }));
        }
        // The search for the nearest pose has not ended where something is lacking.
        let residual = if is_met { residual } else { residual.max(state.miss) };
        let is_nearest_pose = is_met && residual <= tolerances::KKT_ENOUGH;
        let status = if is_nearest && !is_nearest_pose { Status::NotNearest } else { Status::Exact };
        Ok(Found { state, status, steps, residual: is_nearest.then_some(residual) })
    }

    /// What is told of the end of a search.
    pub(crate) fn correction(&self, wishes: &Wishes, volume_before: f64, found: Found) -> Correction {
        let Found { state, status, steps, residual } = found;
        Correction {
            relative_error: relative_error(&wishes.wanted.volumes, &state.volumes),
            point_error: state.point_lack(wishes) / self.extent,
            volume: state.volumes.total,
            component_volumes: state.volumes.components,
            displacement: state.displacement,
            vertices: state.vertices,
            volume_before,
            status,
            steps,
            residual,
        }
    }

    fn impossible(&self, wishes: &Wishes, volume_before: f64, reason: Reason) -> CorrectError {
        let (goal, target) = match wishes.wanted.volumes.first() {
            Some(goal) => (Some(0), goal.volume),
            None => (None, volume_before),
        };
        CorrectError::Impossible { goal, target, volume: volume_before, reason }
    }

    /// Whether `state` has what is wanted.
    pub(crate) fn is_met(&self, state: &State, wishes: &Wishes) -> bool {
        relative_error(&wishes.wanted.volumes, &state.volumes) <= tolerances::VOLUME
            && state.point_lack(wishes) <= tolerances::POINT * self.extent
    }

    /// What contradicts other wishes most in `state`, or depends on nothing that can move.
    fn contradiction(&self, state: &State, wishes: &Wishes) -> Option<Reason> {
        let rows = self.rows(state, wishes);
        let (_, missed) = self.independent(&rows).least(3 * self.posed.len(), &state.lacks);
        let Missed { row, by } = missed?;
        match wishes.volumes.get(row) {
            Some(goal) if by > tolerances::VOLUME * goal.volume.abs() => {
                let is_dead = scaled(&rows[row], self.mobility).iter().all(|x| *x == 0.0);
                Some(if is_dead { Reason::Dead } else { Reason::Coupled { by } })
            }
            None if by > tolerances::POINT * self.extent => {
                Some(Reason::Contradiction { point: (row - wishes.volumes.len()) / 3, by })
            }
            _ => None,
        }
    }

    /// What a displacement costs: `Σ δ²/m`.
    fn cost(&self, displacement: &[DVec3]) -> f64 {
        self.product(displacement, displacement)
    }

    /// `Σ a b/m`.
    fn product(&self, a: &[DVec3], b: &[DVec3]) -> f64 {
        let of = |a: f64, b: f64, m: f64| if m > 0.0 { a * b / m } else { 0.0 };
        let pairs = a.iter().zip(b).zip(self.mobility);
        pairs.map(|((a, b), m)| of(a.x, b.x, m.x) + of(a.y, b.y, m.y) + of(a.z, b.z, m.z)).sum()
    }

    /// A state that lacks nothing, if Newton's method comes to one: by the smallest steps, or along given directions. And how many steps it took.
    pub(crate) fn restored(&self, mut state: State, wishes: &Wishes, lines: Option<&[Vec<DVec3>]>) -> (State, usize) {
        let mut steps = 0;
        while state.miss > tolerances::VOLUME_ROUNDING && steps < STEPS {
            let rows = self.rows(&state, wishes);
            let step = self.combined(&rows, lines, &state.lacks);
            let mut share = 1.0;
            // What rounding left does not go away by shorter steps.
            let tries = if state.miss <= tolerances::VOLUME { 1 } else { HALVINGS };
            let next = (0..tries).find_map(|_| {
                let partial = state.displacement.iter().zip(&step).map(|(at, d)| *at + *d * share).collect();
                let next = self.state(partial, wishes);
                share /= 2.0;
                (next.miss < state.miss).then_some(next)
            });
            let Some(next) = next else { break };
            state = next;
            steps += 1;
        }
        (state, steps)
    }

    /// The model's vertices for the cage's at `posed`, and its volumes.
    fn carried(&self, posed: &[DVec3]) -> (Vec<DVec3>, Volumes) {
        let vertices = self.cage.deformed(self.rest, posed);
        let volumes = self.solid.volumes(&vertices);
        (vertices, volumes)
    }

    pub(crate) fn state(&self, displacement: Vec<DVec3>, wishes: &Wishes) -> State {
        let (vertices, volumes) = self.carried(&displaced(self.posed, &displacement));
        self.state_of(displacement, vertices, volumes, wishes)
    }

    fn state_of(&self, displacement: Vec<DVec3>, vertices: Vec<DVec3>, volumes: Volumes, wishes: &Wishes) -> State {
        let posed = displaced(self.posed, &displacement);
        let (before, after) = (self.cage.displacement(self.posed), self.cage.displacement(&posed));
        let of_volumes = wishes.volumes.iter().map(|goal| goal.volume - goal.of(&volumes));
        let of_points = wishes.wanted.points.iter().flat_map(|point| {
            let moved: DVec3 = point.weights.iter().map(|(c, w)| (after[*c] - before[*c]) * *w).sum();
            (point.target - point.position - moved).to_array()
        });
        let lacks: Vec<f64> = of_volumes.chain(of_points).collect();
        let miss = relative_error(&wishes.wanted.volumes, &volumes);
        let mut state = State { displacement, vertices, volumes, lacks, miss };
        state.miss = state.miss.max(state.point_lack(wishes) / self.extent);
        state
    }

    /// The derivatives A of what is wanted by the cage's vertices.
    pub(crate) fn rows(&self, state: &State, wishes: &Wishes) -> Vec<Vec<DVec3>> {
        let posed = displaced(self.posed, &state.displacement);
        let of_goal = |goal: &&VolumeGoal| {
            let by_point = match &goal.components {
                Components::All => self.solid.volume_gradient(&state.vertices),
                Components::These(these) => {
                    let weight = |c: usize| if these.contains(&c) { 1.0 } else { 0.0 };
                    let weights: Vec<f64> = (0..self.solid.component_count()).map(weight).collect();
                    self.solid.weighted_gradient(&state.vertices, &weights)
                }
            };
            self.cage.gradient(&posed, &by_point)
        };
        let of_point = |(weights, axis): (&Vec<(usize, f64)>, usize)| {
            let mut by_control = vec![DVec3::ZERO; self.cage.binding().control_count()];
            weights.iter().for_each(|(c, w)| by_control[*c][axis] = *w);
            self.cage.pulled(&posed, by_control)
        };
        let coordinates = wishes.wanted.points.iter().flat_map(|point| (0..3).map(move |axis| (&point.weights, axis)));
        wishes.volumes.iter().map(of_goal).chain(coordinates.map(of_point)).collect()
    }

    /// An orthonormal basis of `rows` times √M: what `Σ δ²/m` sees of them.
    pub(crate) fn independent(&self, rows: &[Vec<DVec3>]) -> Rows {
        let mut independent = Rows::default();
        for row in rows {
            independent.push(scaled(row, self.mobility), 0.0);
        }
        independent
    }

    /// The smallest step that changes what is wanted by what is `asked`, or, along the lines D, `M Dᵀ (A M Dᵀ)⁻¹ b`; of rows that depend on
    /// others nothing is asked.
    fn combined(&self, rows: &[Vec<DVec3>], lines: Option<&[Vec<DVec3>]>, asked: &[f64]) -> Vec<DVec3> {
        let Some(lines) = lines else {
            let (z, _) = self.independent(rows).least(3 * self.posed.len(), asked);
            return self.unscaled(&z);
        };
        let independent = self.independent(lines);
        let kept: Vec<usize> = (0..lines.len()).filter(|k| independent.is_independent(*k)).collect();
        let mobile: Vec<Vec<DVec3>> =
            lines.iter().map(|row| row.iter().zip(self.mobility).map(|(x, m)| *x * *m).collect()).collect();
        let sizes: Vec<f64> = kept.iter().map(|k| dot(&lines[*k], &mobile[*k]).sqrt()).collect();
        let matrix = Square::of(kept.len(), |i, j| dot(&rows[kept[i]], &mobile[kept[j]]) / (sizes[i] * sizes[j]));
        let multipliers = matrix.solved(&kept.iter().zip(&sizes).map(|(k, size)| asked[*k] / size).collect::<Vec<_>>());
        let mut sum = vec![DVec3::ZERO; self.posed.len()];
        for ((k, multiplier), size) in kept.iter().zip(multipliers).zip(sizes) {
            sum.iter_mut().zip(&mobile[*k]).for_each(|(sum, x)| *sum += *x * (multiplier / size));
        }
        sum
    }

    /// √M z
    pub(crate) fn unscaled(&self, z: &[f64]) -> Vec<DVec3> {
        let of = |(z, m): (&[f64], &DVec3)| DVec3::new(z[0] * m.x.sqrt(), z[1] * m.y.sqrt(), z[2] * m.z.sqrt());
        z.chunks_exact(3).zip(self.mobility).map(of).collect()
    }
}

impl State {
    /// How far the coordinate of a point that misses most is from its target.
    fn point_lack(&self, wishes: &Wishes) -> f64 {
        self.lacks[wishes.volumes.len()..].iter().map(|lack| lack.abs()).fold(0.0, f64::max)
    }

    /// The volume of the whole body.
    pub(crate) fn volume(&self) -> f64 {
        self.volumes.total
    }
}
