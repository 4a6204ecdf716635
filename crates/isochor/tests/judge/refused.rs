//! Whether the reason for which a request was refused is true.

use glam::{DMat3, DVec3};
use isochor::{Method, Reason};
use num_rational::BigRational;

use super::dense::{Decomposed, determinant, dot, independence, norm};
use super::metric::Space;
use super::{Goal, Judge, Place, Verdict, across, ensure};

/// A volume that changes by less than this, relative to Σ |∂V/∂p| √m, does not depend on what moves: ten times the documented limit.
const DEAD: f64 = 1e-11;

/// A row of which less than this is new depends on the others: a hundred times the documented limit.
const DEPENDENT: f64 = 1e-8;

impl Judge<'_> {
    /// Checks a reason.
    pub(super) fn refused(&self, goal: Option<usize>, reason: &Reason) -> Verdict {
        let volume = self.unit.powi(3);
        match reason {
            Reason::Pinned => {
                let is_pinned = self.case.mobility().iter().all(|m| *m == DVec3::ZERO);
                ensure(is_pinned, || "not all is pinned".into()).map(|()| "pinned")
            }
            Reason::NothingBound => {
                let is_free = self.weights.iter().all(Vec::is_empty);
                ensure(is_free, || "some vertex is bound".into()).map(|()| "nothing bound")
            }
            Reason::Contradiction { point, by } => self.contradicts(*point, by / self.unit),
            Reason::OffAxes { point, by } => {
                let Method::Axes { directions, .. } = &self.case.options.method else { return Err("no axes".into()) };
                let (off, by) = (norm(&across(directions, self.moves[*point]).to_array()), by / self.unit);
                let is_off = by > 1e-12 * self.extent && off >= 0.999 * by && off <= 1.5 * by;
                ensure(is_off, || format!("point {point} is {off:e} off the axes, it says {by:e}")).map(|()| "off axes")
            }
            Reason::Follows { follows } => self.follows(goal.ok_or("no goal")?, follows / volume),
            Reason::Dead => self.is_dead(goal.ok_or("no goal")?),
            Reason::Coupled { .. } => self.is_coupled(goal.ok_or("no goal")?),
            Reason::Turns { limit } => self.turns(goal.ok_or("no goal")?, limit / volume),
            Reason::Overflow => self.overflows(),
            Reason::PointRounding { point, by } => {
                // Nothing contradicts it, so only roundings can leave it.
                let is_off = by / self.unit > 1e-12 * self.extent && !self.misses(*point, by / self.unit);
                ensure(is_off, || format!("point {point} contradicts others")).map(|()| "rounding")
            }
            Reason::Rounding { relative_error } => self.is_rounding(*relative_error),
        }
    }

    /// Along which the points are moved, one after the other, and each one's parts along them.
    fn ways(&self) -> Vec<(Space, Vec<f64>)> {
        let points = |along: &dyn Fn(DVec3) -> f64| self.moves.iter().map(|m| along(*m)).collect::<Vec<f64>>();
        let mobility = self.case.mobility();
        let energy = self.case.options.energy.as_ref();
        let Method::Axes { directions, .. } = &self.case.options.method else {
            let way = |a: usize| (Space::along(&[DVec3::AXES[a]], &mobility, energy), points(&|m| m[a]));
            return (0..3).map(way).collect();
        };
        let mut chosen: Vec<DVec3> = Vec::new();
        for direction in directions {
            if across(&chosen, *direction).length() > 1e-9 * direction.length() {
                chosen.push(direction.normalize());
            }
        }
        let mut frame = chosen.clone();
        for axis in DVec3::AXES {
            if frame.len() < 3 && across(&frame, axis).length() > 0.3 {
                frame.push(across(&frame, axis).normalize());
            }
        }
        let parts = DMat3::from_cols(frame[0], frame[1], frame[2]).inverse();
        // Pieces across the chosen ones are 0 or refused.
        let way = |(k, d): (usize, &DVec3)| {
            let split = if frame.len() == chosen.len() { parts } else { left_inverse(&chosen) };
            (Space::along(&[*d], &mobility, energy), points(&|m| (split * m)[k]))
        };
        chosen.iter().enumerate().map(way).collect()
    }

    /// Whether the point depends on those before it along one of the axes, and misses by so much.
    fn misses(&self, point: usize, by: f64) -> bool {
        for (space, wanted) in self.ways() {
            let rows = self.point_rows(&space);
            let mut before: Vec<Vec<f64>> = Vec::new();
            let mut asked = Vec::new();
            for k in 0..point {
                if independence(&rows[k], &before) > DEPENDENT {
                    before.push(rows[k].clone());
                    asked.push(wanted[k]);
                }
            }
            if independence(&rows[point], &before) > DEPENDENT {
                continue;
            }
            let z = Decomposed::of(&before).least(space.unknowns(), &asked);
            let misses = (wanted[point] - dot(&rows[point], &z)).abs();
            if misses > 0.5e-12 * self.extent && (misses - by).abs() <= 1e-6 * by + 1e-12 * self.extent {
                return true;
            }
        }
        false
    }

    /// That the point cannot come to its place along one of the axes beside those before it.
    fn contradicts(&self, point: usize, by: f64) -> Verdict {
        if self.misses(point, by) {
            return Ok("contradiction");
        }
        let mut closest = f64::INFINITY;
        // Points so close together that bringing them to different places takes huge moves, whose rounding is what misses.
        for (space, _) in self.ways() {
            let rows = self.point_rows(&space);
            for k in 0..rows.len() {
                let new = independence(&rows[k], &[&rows[..k], &rows[k + 1..]].concat());
                closest = if new > 0.0 { closest.min(new) } else { closest };
            }
        }
        // Energies have a floor of 1e-6, so they make moves up to 1e3 times as long.
        let longer = if self.case.options.energy.is_some() { 1e3 } else { 1.0 };
        let far = longer * self.moves.iter().map(|m| m.length()).fold(0.0, f64::max) / closest;
        ensure(by <= 64.0 * f64::EPSILON * far, || format!("point {point} does not miss by {by:e} ({closest:e})"))
            .map(|()| "contradiction")
    }

    /// That the target contradicts those before it, in whole fractions.
    fn follows(&self, goal: usize, follows: f64) -> Verdict {
        let exact = |x: f64| BigRational::from_float(x).unwrap();
        let mut rows: Vec<(usize, Vec<BigRational>, BigRational)> = Vec::new();
        for (k, Goal { members, target }) in self.goals[..=goal].iter().enumerate() {
            let mut row: Vec<BigRational> = members.iter().map(|m| exact(*m)).collect();
            let mut left = exact(*target);
            for (pivot, other, value) in &rows {
                let factor = row[*pivot].clone();
                row.iter_mut().zip(other).for_each(|(x, y)| *x -= &factor * y);
                left -= &factor * value;
            }
            let zero = exact(0.0);
            if let Some(pivot) = row.iter().position(|x| *x != zero) {
                let scale = row[pivot].clone();
                row.iter_mut().for_each(|x| *x /= &scale);
                rows.push((pivot, row, left / scale));
                ensure(k < goal, || "the goal is free".into())?;
            } else if k == goal {
                let truth = exact(*target) - left;
                let off = num_rational::Ratio::to_integer(&((exact(follows) - &truth) * exact(1e15 / target.abs())));
                let by = num_rational::Ratio::to_integer(&((exact(*target) - &truth) * exact(1e15 / target.abs())));
                let limit = num_bigint::BigInt::from(100);
                let is_true = off.magnitude() < limit.magnitude() && by.magnitude() > limit.magnitude();
                ensure(is_true, || format!("it follows as {off}e-15 off, and differs by {by}e-15"))?;
            }
        }
        Ok("follows")
    }

    /// The pose with the points at their places, by the smallest displacements along each way.
    fn at_points(&self) -> Place {
        let mut delta = vec![DVec3::ZERO; self.controls];
        for (space, wanted) in self.ways() {
            let z = Decomposed::of(&self.point_rows(&space)).least(space.unknowns(), &wanted);
            delta.iter_mut().zip(space.displacement(&z)).for_each(|(d, by)| *d += by);
        }
        self.place(delta)
    }

    /// The directions that volumes may be changed along: one after the other, or all at once.
    fn spaces(&self) -> Vec<Space> {
        let (mobility, energy) = (self.case.mobility(), self.case.options.energy.as_ref());
        match &self.case.options.method {
            Method::Axes { directions, .. } => {
                directions.iter().map(|d| Space::along(&[*d], &mobility, energy)).collect()
            }
            _ => vec![Space::along(&DVec3::AXES, &mobility, energy)],
        }
    }

    /// Rᵀ ∇V of all goals, less what would move a point, and what length counts as none.
    fn normals(&self, space: &Space, place: &Place) -> Vec<(Vec<f64>, f64)> {
        let points = Decomposed::of(&self.point_rows(space));
        let normal = |goal: &Goal| {
            let slope = self.slope(goal, &place.vertices);
            let mut pulled = space.pulled(&slope.controls);
            points.project(&mut pulled);
            (pulled, DEAD * slope.spread * space.largest_root())
        };
        self.goals.iter().map(normal).collect()
    }

    /// That nothing changes the volume.
    fn is_dead(&self, goal: usize) -> Verdict {
        let mut said = String::new();
        for place in [self.at_points(), self.place(vec![DVec3::ZERO; self.controls])] {
            let strength = |space: &Space| {
                let (normal, least) = &self.normals(space, &place)[goal];
                norm(normal) / least * DEAD
            };
            let strengths: Vec<f64> = self.spaces().iter().map(strength).collect();
            if strengths.iter().all(|s| s.is_nan() || *s <= DEAD) {
                return Ok("dead");
            }
            said += &format!("strengths {strengths:?}; ");
        }
        Err(format!("goal {goal} is not dead: {said}"))
    }

    /// That the volume changes only as the others do.
    fn is_coupled(&self, goal: usize) -> Verdict {
        let mut said = String::new();
        for place in [self.at_points(), self.place(vec![DVec3::ZERO; self.controls])] {
            let new = |space: &Space| {
                let normals = self.normals(space, &place);
                let others: Vec<Vec<f64>> = (0..normals.len())
                    .filter(|k| *k != goal && norm(&normals[*k].0) > normals[*k].1)
                    .map(|k| normals[k].0.clone())
                    .collect();
                let (normal, least) = &normals[goal];
                if norm(normal) <= *least { 0.0 } else { independence(normal, &others) }
            };
            let new: Vec<f64> = self.spaces().iter().map(new).collect();
            if new.iter().all(|new| *new <= DEPENDENT) {
                return Ok("coupled");
            }
            said += &format!("new {new:?}; ");
        }
        Err(format!("goal {goal} is not coupled: {said}"))
    }

    /// Goals that do not follow from those before.
    fn free_goals(&self) -> Vec<usize> {
        let mut free: Vec<usize> = Vec::new();
        for g in 0..self.goals.len() {
            let others: Vec<Vec<f64>> = free.iter().map(|k| self.goals[*k].members.clone()).collect();
            if independence(&self.goals[g].members, &others) > 1e-6 {
                free.push(g);
            }
        }
        free
    }

    /// What each of `goals` lacks.
    fn deficits(&self, goals: &[usize], place: &Place) -> Vec<f64> {
        let volumes = self.volumes_at(place);
        goals.iter().map(|g| self.goals[*g].target - self.goals[*g].of(&volumes)).collect()
    }

    /// That the volume turns back.
    fn turns(&self, goal: usize, limit: f64) -> Verdict {
        let start = self.at_points();
        let goals = self.free_goals();
        if matches!(self.case.options.method, Method::Nearest) {
            let way = self.flow(&start, &goals);
            return ensure(way < 1.0, || "a flow along the gradients reaches the targets".into()).map(|()| "turns");
        }
        if goals.len() == 1 {
            self.turns_on_line(&start, goal, limit)
        } else {
            let way = self.followed(&start, &goals);
            ensure(way < 1.0 - 1.0 / 512.0, || format!("the curve of gradients goes {way} of the way"))
                .map(|()| "turns")
        }
    }

    /// That V along `C + t R Rᵀ ∇V` turns back at `limit`, before the target.
    fn turns_on_line(&self, start: &Place, goal: usize, limit: f64) -> Verdict {
        let space = &self.coordinates;
        let (normal, _) = self.normals(space, start)[goal].clone();
        let line = space.displacement(&normal);
        let at = |t: f64| self.place(start.delta.iter().zip(&line).map(|(d, l)| *d + t * *l).collect());
        let slope = |t: f64| -> f64 {
            let controls = self.slope(&self.goals[goal], &at(t).vertices).controls;
            controls.iter().zip(&line).map(|(g, l)| g.dot(*l)).sum()
        };
        // V′ is a quadratic function of t: three values say all. A unit of t closes the gap were V linear.
        let missing = self.deficits(&[goal], start)[0];
        let step = missing / slope(0.0);
        let (low, middle, high) = (slope(-step), slope(0.0), slope(step));
        let (b, c) = ((high - low) / 2.0, (high + low) / 2.0 - middle);
        let derivative = |r: f64| middle + r * (b + r * c);
        // The first sign change by steps, then by bisection.
        let turn = (1..200_000).map(|k| f64::from(k) * 1e-3).find(|r| derivative(*r) * middle <= 0.0);
        let Some(mut high) = turn else { return Err("the volume does not turn back".into()) };
        let mut low = high - 1e-3;
        for _ in 0..60 {
            let half = (low + high) / 2.0;
            if derivative(half) * middle <= 0.0 { high = half } else { low = half }
        }
        let reached = missing - self.deficits(&[goal], &at(high * step))[0];
        let said = limit - (self.goals[goal].target - missing);
        let is_true = reached / missing < 1.0 && (reached - said).abs() <= 1e-6 * missing.abs();
        ensure(is_true, || format!("it turns at {} of the way, not {}", reached / missing, said / missing))
            .map(|()| "turns")
    }

    /// What part of the way to all targets small steps along the gradients, taken anew after each, can go.
    fn flow(&self, start: &Place, goals: &[usize]) -> f64 {
        let space = &self.coordinates;
        self.small_steps(start, goals, |place, missing| {
            let normals = self.normals(space, place);
            let rows: Vec<Vec<f64>> = goals.iter().map(|g| normals[*g].0.clone()).collect();
            let by = space.displacement(&Decomposed::of(&rows).least(space.unknowns(), missing));
            Some(self.place(place.delta.iter().zip(by).map(|(d, by)| *d + by).collect()))
        })
    }

    /// What part of the way `C + Σ t R Rᵀ ∇V`, gradients at the start, can go until the Jacobian matrix by t turns singular.
    fn followed(&self, start: &Place, goals: &[usize]) -> f64 {
        let space = &self.coordinates;
        let rows: Vec<Vec<f64>> = goals.iter().map(|g| self.normals(space, start)[*g].0.clone()).collect();
        let lines: Vec<Vec<DVec3>> = rows.iter().map(|row| space.displacement(row)).collect();
        let jacobian = |place: &Place| -> Vec<Vec<f64>> {
            let slope = |g: &usize| {
                let slope = self.slope(&self.goals[*g], &place.vertices).controls;
                lines.iter().map(|line| line.iter().zip(&slope).map(|(l, s)| l.dot(*s)).sum()).collect()
            };
            goals.iter().map(slope).collect()
        };
        let sign = determinant(jacobian(start)).signum();
        self.small_steps(start, goals, |place, missing| {
            let jacobian = jacobian(place);
            if determinant(jacobian.clone()).signum() != sign {
                return None;
            }
            let t = Decomposed::of(&jacobian).least(goals.len(), missing);
            let by = |c: usize| lines.iter().zip(&t).map(|(line, t)| *t * line[c]).sum::<DVec3>();
            Some(self.place((0..self.controls).map(|c| place.delta[c] + by(c)).collect()))
        })
    }

    /// Follows a path on which all volumes go from what they are to what they shall be in proportion; `step` corrects a place to first
    /// order. Returns what part of it could be gone.
    fn small_steps(&self, start: &Place, goals: &[usize], step: impl Fn(&Place, &[f64]) -> Option<Place>) -> f64 {
        /// Longer: a path may jump to another branch; shorter: it takes long.
        const LONGEST: f64 = 0.004;
        let all = self.deficits(goals, start);
        let size =
            |missing: &[f64]| missing.iter().zip(goals).map(|(m, g)| (m / self.goals[*g].target).abs()).sum::<f64>();
        let (mut place, mut done, mut part) = (start.clone(), 0.0, LONGEST);
        while done < 1.0 {
            let to = f64::min(1.0, done + part);
            let missing = |place: &Place| -> Vec<f64> {
                self.deficits(goals, place).iter().zip(&all).map(|(m, a)| m - (1.0 - to) * a).collect()
            };
            let mut next = Some(place.clone());
            let mut left = f64::INFINITY;
            for _ in 0..6 {
                let Some(at) = next else { break };
                let open = missing(&at);
                left = size(&open);
                if left <= 1e-12 || !left.is_finite() {
                    next = Some(at);
                    break;
                }
                next = step(&at, &open);
            }
            match next {
                // Small steps stay small: no jump to another branch.
                Some(at) if left <= 1e-12 && moved(&place, &at) <= 0.02 * self.extent => {
                    (place, done, part) = (at, to, f64::min(LONGEST, 1.5 * part));
                }
                _ if part < 1e-6 => return done,
                _ => part /= 2.0,
            }
        }
        1.0
    }

    /// That the numbers leave the range of f64.
    fn overflows(&self) -> Verdict {
        let start = self.place(vec![DVec3::ZERO; self.controls]);
        let way = self.moves.iter().map(|m| m.length() * self.unit).fold(0.0, f64::max);
        let is_far = !way.powi(3).is_finite();
        let area = self.goals.iter().map(|goal| self.slope(goal, &start.vertices).spread).fold(0.0, f64::max);
        let square = (area * self.unit * self.unit).powi(2);
        ensure(is_far || !square.is_finite(), || format!("the square of the area is {square:e}")).map(|()| "overflow")
    }

    /// That moving coordinates by a rounding changes a volume by more than is allowed.
    fn is_rounding(&self, relative_error: f64) -> Verdict {
        let start = self.at_points();
        let normals: Vec<f64> = self
            .goals
            .iter()
            .map(|goal| f64::EPSILON * self.slope(goal, &start.vertices).moment / goal.target.abs())
            .collect();
        let rounding = normals.iter().copied().fold(0.0, f64::max);
        let is_true = relative_error > 1e-13 && relative_error <= rounding;
        ensure(is_true, || format!("{relative_error:e} is left, roundings are {rounding:e}")).map(|()| "rounding")
    }
}

/// The largest distance between controls of two places.
fn moved(a: &Place, b: &Place) -> f64 {
    a.delta.iter().zip(&b.delta).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

/// Of one or two columns: to components along them.
fn left_inverse(columns: &[DVec3]) -> DMat3 {
    let rows: Vec<Vec<f64>> = columns.iter().map(|d| d.to_array().to_vec()).collect();
    // The rows of (AᵀA)⁻¹Aᵀ by the smallest solutions for unit right-hand sides.
    let decomposed = Decomposed::of(&rows);
    let row = |k: usize| {
        let unit: Vec<f64> = (0..rows.len()).map(|j| f64::from(u8::from(j == k))).collect();
        let x = decomposed.least(3, &unit);
        DVec3::new(x[0], x[1], x[2])
    };
    let zero = |k: usize| if k < columns.len() { row(k) } else { DVec3::ZERO };
    DMat3::from_cols(zero(0), zero(1), zero(2)).transpose()
}
