//! Exact volume correction: move the controls as little as possible so that the volume is what was asked.
//!
//! Given posed vertices X, a binding W and a wanted volume V_ref, find a control displacement δ (#controls × 3) with
//! `V(X + W δ) = V_ref` that keeps `Σ δ²/m` small. m is the *mobility* of a control coordinate: 0 pins it, 1 leaves it free,
//! 1/m is the weight ω of HB, section 3, remark 2.
//!
//! - [`Method::Axes`]: one direction after the other, each an explicit exact step. HB (13)–(17); [`crate::axes`].
//! - [`Method::Gradient`]: all coordinates at once along the gradient, an exact cubic; [`crate::gradient`].
//! - [`Method::Nearest`]: the smallest displacement of all, HB (3) solved as it stands; [`crate::nearest`].
//! - Points that must come to exact places go with all of them: HB (20)–(24); [`crate::points`].
//!
//! X need not come from W: the same correction finishes what another deformer posed, with a lattice laid round it.
//!
//! HB = S. Hahmann, G.-P. Bonneau, S. Barbier, G. Elber, H. Hagen, *Volume-preserving FFD for programmable graphics
//! hardware*, The Visual Computer 28 (2012).
//!
//! # Changes versus the paper
//!
//! - Final steps take away what rounding left (a few 1e-16 of the volume). Where a model is so thin that the rounding of its
//!   coordinates still shows, they are rounded up or down so that the volume comes out.
//! - Impossible requests are found before anything moves, and named.

use glam::DVec3;

use crate::binding::{Binding, displaced, translated};
use crate::mesh::Bounds;
use crate::points::{CoordinateRows, Missed, PointTarget};
use crate::tolerances;
use crate::volume::Solid;
use crate::{axes, gradient, nearest};

/// A posed model: what is to be corrected.
#[derive(Clone, Copy, Debug)]
pub struct Pose<'a> {
    /// The body whose volume is meant.
    pub solid: &'a Solid,
    /// Posed vertices X (#vertices × 3), from whatever deformer.
    pub vertices: &'a [DVec3],
    /// How vertices follow the controls that may move now.
    pub binding: &'a Binding,
}

/// How to correct.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CorrectOptions {
    /// Which way the controls go.
    pub method: Method,
    /// Mobility of each control coordinate (#controls × 3), ≥ 0; 0 pins it exactly. `None`: 1 everywhere.
    pub mobility: Option<Vec<DVec3>>,
    /// Points that must come to exact places as well, in the coordinates of the pose.
    pub points: Vec<PointTarget>,
}

/// Which way the controls go.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Method {
    /// The smallest displacement of all: the minimiser of Σ δ²/m at the wanted volume.
    #[default]
    Nearest,
    /// All coordinates at once, along M ∘ ∇V: one exact step, a few percent longer at most on ordinary poses.
    Gradient,
    /// One direction after the other (HB).
    Axes {
        /// The directions in order; any length but 0, not necessarily orthogonal.
        directions: Vec<DVec3>,
        /// Share of the volume change for each direction, relative to their sum. `None`: equal shares.
        shares: Option<Vec<f64>>,
    },
}

impl Method {
    /// Along x, y, z in turn, a third each: HB's general correction.
    #[must_use]
    pub fn xyz() -> Self {
        Self::Axes { directions: vec![DVec3::X, DVec3::Y, DVec3::Z], shares: None }
    }
}

/// A corrected pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// δ: what to add to the controls (#controls × 3). Exactly 0 where a coordinate is pinned.
    pub displacement: Vec<DVec3>,
    /// X + W δ (#vertices × 3), in the coordinates of the pose. Where a model is very thin, a coordinate may be the other
    /// neighbour of the exact number.
    pub vertices: Vec<DVec3>,
    /// Signed volume of the pose before.
    pub volume_before: f64,
    /// Signed volume after, measured near the model: before adding a far origin back rounds the coordinates.
    pub volume: f64,
    /// The same of each component, in the order of its first face.
    pub component_volumes: Vec<f64>,
    /// `|volume − target| / |target|`.
    pub relative_error: f64,
    /// How far the point that misses most is from its target, in extents of the pose; 0 without points.
    pub point_error: f64,
    /// How it ended.
    pub status: Status,
    /// Exact steps taken, the final ones against rounding included.
    pub steps: usize,
    /// How far [`Method::Nearest`] is from its condition: `‖δ − μ M ∘ ∇V‖∞`, in extents of the pose. `None` for other methods.
    pub residual: Option<f64>,
}

/// How a correction ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The pose had the wanted volume already, to rounding: nothing moved.
    AlreadyMet,
    /// The wanted volume is met to [`tolerances::VOLUME`].
    Exact,
    /// The wanted volume is met, but [`Method::Nearest`] has not come to the smallest displacement: its residual is above
    /// [`tolerances::KKT_ENOUGH`].
    NotNearest,
    /// The volume is approximate: the correction was made on fewer triangles by [`crate::Preview`].
    Preview,
}

/// Why there is no correction. Nothing was changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CorrectError {
    /// Array lengths that do not fit together.
    #[error("{what} has {found} entries: {expected} are needed")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A posed vertex is infinite or not a number.
    #[error("posed vertex {vertex} is at {position}: coordinates must be finite")]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: DVec3,
    },
    /// Vertices that were one at rest were posed apart.
    #[error("vertices {a} and {b} were at one place at rest and are posed apart: the surface is torn there")]
    Torn {
        /// One vertex.
        a: u32,
        /// The other.
        b: u32,
    },
    /// A mobility that is negative or not finite.
    #[error("the mobility of control {control} is {value}: it must be finite and at least 0")]
    Mobility {
        /// The control.
        control: usize,
        /// Its mobility along x, y, z.
        value: DVec3,
    },
    /// A direction that has no length.
    #[error("direction {index} is {value}: it must be finite and not 0")]
    Direction {
        /// Its place in the list.
        index: usize,
        /// The vector.
        value: DVec3,
    },
    /// No direction at all.
    #[error("no direction to correct along is given")]
    NoDirection,
    /// Shares that cannot be shares.
    #[error("the shares of the axes are {shares:?}: each must be finite and at least 0, and their sum more than 0")]
    Shares {
        /// The shares.
        shares: Vec<f64>,
    },
    /// A target to which no relative error exists.
    #[error("the wanted volume is {target:e}: it must be finite and not 0")]
    Target {
        /// The target.
        target: f64,
    },
    /// A point that names a control that does not exist, or a place that is not finite.
    #[error("point {point} is not a point of this binding: {what}")]
    Point {
        /// Its index in the list.
        point: usize,
        /// What is wrong with it.
        what: String,
    },
    /// No displacement of the kind asked for gives the wanted volume.
    #[error("the volume cannot become {target:e} (it is {volume:e}): impossible, because {reason}")]
    Impossible {
        /// The wanted volume.
        target: f64,
        /// The volume of the pose.
        volume: f64,
        /// Why not.
        reason: Reason,
    },
}

/// Why a volume cannot be reached.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Every coordinate that could move is pinned.
    #[error("every control is pinned")]
    Pinned,
    /// No vertex follows any control.
    #[error("no vertex of the model lies inside the lattice")]
    NothingBound,
    /// The volume does not depend on any control along the chosen directions.
    #[error("the volume does not depend on any movable control along the chosen directions")]
    Dead,
    /// The volume along the gradient line turns back before the target.
    #[error(
        "along the gradient the volume can only reach {limit:e}, then it turns back; give more controls freedom, choose axes, \
         or ask for less change"
    )]
    Turns {
        /// The last volume before it turns back.
        limit: f64,
    },
    /// Points cannot all come to their targets: they contradict one another, follow no movable control, or only pinned ones.
    #[error("point {point} misses its target by {by:e} whatever the movable controls do, given the other points")]
    Contradiction {
        /// Index of the point that misses most.
        point: usize,
        /// By how far it misses along one direction.
        by: f64,
    },
    /// A target lies off the axes along which controls may move.
    #[error("point {point} is to move by {by:e} across the chosen axes, along which alone controls move")]
    OffAxes {
        /// Index of the point.
        point: usize,
        /// By how far its target is off.
        by: f64,
    },
    /// The model is so thin, or its vertices would have to go so far, that moving one of them by one rounding changes the
    /// volume by more than is allowed.
    #[error(
        "the rounding of coordinates leaves a relative error of {relative_error:.1e}, more than {:e}: the model is too thin, \
         or its vertices would have to go too far",
        tolerances::VOLUME
    )]
    Rounding {
        /// What could be reached.
        relative_error: f64,
    },
    /// The numbers left the range of f64 on the way.
    #[error("the displacement it takes leaves the range of numbers")]
    Overflow,
}

impl CorrectError {
    /// The same for a body whose volumes are counted with `orientation` (1 or −1).
    pub(crate) fn oriented(mut self, orientation: f64) -> Self {
        if let Self::Impossible { target, volume, reason } = &mut self {
            *target *= orientation;
            *volume *= orientation;
            if let Reason::Turns { limit } = reason {
                *limit *= orientation;
            }
        }
        self
    }
}

/// Corrects a pose to the signed volume `target` (in the pose's length unit cubed, sign as [`Solid::volume`] gives it).
///
/// Controls pinned by the mobility keep their bits; the result has the same bits for any number of threads. Coordinates far
/// from the origin are taken relative to the model, so nothing is lost there until `vertices` are rounded.
///
/// # Errors
///
/// Arrays that do not fit together, values out of range, a torn surface; [`CorrectError::Impossible`] with the reason.
pub fn correct(pose: &Pose, target: f64, options: &CorrectOptions) -> Result<Correction, CorrectError> {
    let (solid, binding) = (pose.solid, pose.binding);
    let controls = binding.control_count();
    let length = |what, found, expected| match found == expected {
        true => Ok(()),
        false => Err(CorrectError::Length { what, found, expected }),
    };
    length("the posed vertices", pose.vertices.len(), solid.vertex_count())?;
    length("the binding", binding.vertex_count(), solid.vertex_count())?;
    let mobility = options.mobility.clone().unwrap_or_else(|| vec![DVec3::ONE; controls]);
    length("the mobility", mobility.len(), controls)?;
    if let Some(control) = mobility.iter().position(|m| !(m.is_finite() && m.min_element() >= 0.0)) {
        return Err(CorrectError::Mobility { control, value: mobility[control] });
    }
    if let Some(vertex) = pose.vertices.iter().position(|p| !p.is_finite()) {
        return Err(CorrectError::NotFinite { vertex, position: pose.vertices[vertex] });
    }
    if let Some([a, b]) = solid.torn_vertices(pose.vertices) {
        return Err(CorrectError::Torn { a, b });
    }
    if !target.is_finite() || target == 0.0 {
        return Err(CorrectError::Target { target });
    }
    for (point, PointTarget { weights, position, target }) in options.points.iter().enumerate() {
        if let Some((control, _)) = weights.iter().find(|(control, _)| *control >= controls) {
            let what = format!("it follows control {control} of {controls}");
            return Err(CorrectError::Point { point, what });
        }
        if !(position.is_finite() && target.is_finite() && weights.iter().all(|(_, w)| w.is_finite())) {
            return Err(CorrectError::Point { point, what: "its numbers must be finite".into() });
        }
    }

    let bounds = Bounds::of(pose.vertices);
    let (origin, extent) = bounds.map_or((DVec3::ZERO, 0.0), |b| (b.lossless_origin(), b.extent()));
    let vertices: Vec<DVec3> = pose.vertices.iter().map(|p| *p - origin).collect();
    let volume_before = solid.volume(&vertices);
    let points = &options.points[..];
    let roots: Vec<DVec3> = mobility.iter().map(|m| DVec3::from_array(m.to_array().map(f64::sqrt))).collect();
    let rows = (!points.is_empty()).then(|| CoordinateRows::new(points, &roots));
    let posed = vertices.clone();
    let problem = Problem { solid, binding, mobility, roots, posed, target, volume_before, extent, points, rows };
    let start = State { displacement: vec![DVec3::ZERO; controls], vertices, volume: volume_before, steps: 0 };

    let mut residual = None;
    let (end, has_moved) = if problem.is_met(volume_before) && problem.point_error(&start) <= f64::EPSILON {
        (start, false)
    } else {
        problem.check_movable()?;
        let end = match &options.method {
            Method::Gradient => gradient::corrected(&problem, problem.with_points(start)?)?,
            Method::Nearest => {
                let (end, reached) = nearest::corrected(&problem, problem.with_points(start)?)?;
                residual = Some(reached);
                end
            }
            Method::Axes { directions, shares } => axes::corrected(&problem, start, directions, shares.as_deref())?,
        };
        (end, true)
    };
    let point_error = problem.point_error(&end);
    if point_error > tolerances::POINT {
        let reason = problem.worst_point(&end);
        return Err(problem.impossible(reason));
    }
    let relative_error = ((end.volume - target) / target).abs();
    if !relative_error.is_finite() {
        return Err(problem.impossible(Reason::Overflow));
    }
    if relative_error > tolerances::VOLUME {
        return Err(problem.impossible(Reason::Rounding { relative_error }));
    }
    let status = match residual {
        _ if !has_moved => Status::AlreadyMet,
        Some(residual) if residual > tolerances::KKT_ENOUGH => Status::NotNearest,
        _ => Status::Exact,
    };
    let vertices = match has_moved {
        true => translated(&end.vertices, origin),
        false => pose.vertices.to_vec(),
    };
    Ok(Correction {
        displacement: end.displacement,
        vertices,
        volume_before,
        volume: end.volume,
        component_volumes: solid.volumes(&end.vertices).components,
        relative_error,
        point_error,
        status,
        steps: end.steps,
        residual,
    })
}

/// A checked request, in coordinates near the model.
pub(crate) struct Problem<'a> {
    pub(crate) solid: &'a Solid,
    pub(crate) binding: &'a Binding,
    /// m (#controls × 3).
    pub(crate) mobility: Vec<DVec3>,
    /// √m (#controls × 3).
    pub(crate) roots: Vec<DVec3>,
    /// The posed vertices (#vertices × 3).
    pub(crate) posed: Vec<DVec3>,
    pub(crate) target: f64,
    pub(crate) volume_before: f64,
    /// Of the posed vertices.
    pub(crate) extent: f64,
    pub(crate) points: &'a [PointTarget],
    /// What moves a point, where there are points.
    rows: Option<CoordinateRows>,
}

/// Where a correction stands.
#[derive(Clone)]
pub(crate) struct State {
    /// δ so far (#controls × 3).
    pub(crate) displacement: Vec<DVec3>,
    /// X + W δ (#vertices × 3).
    pub(crate) vertices: Vec<DVec3>,
    /// Its volume.
    pub(crate) volume: f64,
    pub(crate) steps: usize,
}

/// One exact step: a control displacement (#controls × 3) and what it does to the vertices (#vertices × 3).
pub(crate) struct Step {
    pub(crate) controls: Vec<DVec3>,
    pub(crate) vertices: Vec<DVec3>,
}

impl State {
    /// This state after `step`, its volume not yet measured.
    pub(crate) fn after(&self, step: &Step) -> Self {
        Self {
            displacement: displaced(&self.displacement, &step.controls),
            vertices: displaced(&self.vertices, &step.vertices),
            volume: self.volume,
            steps: self.steps + 1,
        }
    }
}

impl Problem<'_> {
    pub(crate) fn impossible(&self, reason: Reason) -> CorrectError {
        CorrectError::Impossible { target: self.target, volume: self.volume_before, reason }
    }

    /// How far each point still has to go (#points).
    pub(crate) fn moves(&self, state: &State) -> Vec<DVec3> {
        let left = |point: &PointTarget| {
            let moved: DVec3 = point.weights.iter().map(|(c, w)| *w * state.displacement[*c]).sum();
            point.target - point.position - moved
        };
        self.points.iter().map(left).collect()
    }

    /// The largest miss of a point, in extents.
    fn point_error(&self, state: &State) -> f64 {
        self.moves(state).iter().map(|m| m.length()).fold(0.0, f64::max) / self.extent
    }

    fn worst_point(&self, state: &State) -> Reason {
        let misses = self.moves(state).into_iter().map(|m| m.length()).enumerate();
        let (point, by) = misses.fold((0, 0.0), |worst, miss| if miss.1 > worst.1 { miss } else { worst });
        Reason::Contradiction { point, by }
    }

    /// `state` with the points brought to their targets by the smallest displacement.
    fn with_points(&self, state: State) -> Result<State, CorrectError> {
        let Some(rows) = &self.rows else { return Ok(state) };
        let controls = rows
            .least(&self.moves(&state), tolerances::POINT * self.extent)
            .map_err(|Missed { point, by }| self.impossible(Reason::Contradiction { point, by }))?;
        let vertices = self.binding.apply(&controls);
        let mut state = state.after(&Step { controls, vertices });
        state.volume = self.solid.volume(&state.vertices);
        Ok(state)
    }

    /// M ∘ g (#controls × 3), less what would move a point.
    pub(crate) fn pull(&self, gradient: &[DVec3]) -> Vec<DVec3> {
        let Some(rows) = &self.rows else {
            return gradient.iter().zip(&self.mobility).map(|(g, m)| *g * *m).collect();
        };
        let mut y = self.scaled(gradient);
        rows.project(&mut y);
        self.scaled(&y)
    }

    /// √m ∘ v (#controls × 3).
    pub(crate) fn scaled(&self, v: &[DVec3]) -> Vec<DVec3> {
        v.iter().zip(&self.roots).map(|(v, s)| *v * *s).collect()
    }

    /// Takes away from y = δ/√m (#controls × 3) what would move a point.
    pub(crate) fn project(&self, y: &mut [DVec3]) {
        if let Some(rows) = &self.rows {
            rows.project(y);
        }
    }

    /// Whether `volume` is the target, to its own rounding.
    pub(crate) fn is_met(&self, volume: f64) -> bool {
        (volume - self.target).abs() <= tolerances::VOLUME_ROUNDING * self.target.abs()
    }

    fn check_movable(&self) -> Result<(), CorrectError> {
        if self.mobility.iter().all(|m| *m == DVec3::ZERO) {
            return Err(self.impossible(Reason::Pinned));
        }
        if self.binding.kept_count() == self.binding.vertex_count() {
            return Err(self.impossible(Reason::NothingBound));
        }
        Ok(())
    }

    /// Measures `state` and takes away what rounding left of the deficit: by small steps of the same kind, `step(state,
    /// deficit)` (`None` where no such step exists any more), and at last by the choice of roundings.
    pub(crate) fn finished(&self, mut state: State, step: impl Fn(&State, f64) -> Option<Step>) -> State {
        /// More: nothing left to gain after two or three; fewer: thin models end further off than they need.
        const ROUNDS: usize = 4;
        state.volume = self.solid.volume(&state.vertices);
        for round in 0..2 * ROUNDS {
            let deficit = self.target - state.volume;
            let is_good = deficit.abs() <= tolerances::VOLUME * self.target.abs();
            if self.is_met(state.volume) || !deficit.is_finite() || (is_good && round >= ROUNDS) {
                break;
            }
            let next = if round < ROUNDS {
                step(&state, deficit).map(|step| state.after(&step))
            } else {
                Some(self.rounded_otherwise(&state, deficit))
            };
            let Some(mut next) = next else { continue };
            next.volume = self.solid.volume(&next.vertices);
            if (self.target - next.volume).abs() < deficit.abs() {
                state = next;
            }
        }
        state
    }

    /// `state` with some coordinates that the correction moved rounded up or down by one unit in the last place, such that
    /// the deficit shrinks: the largest effects first.
    fn rounded_otherwise(&self, state: &State, deficit: f64) -> State {
        let gradient = self.solid.volume_gradient(&state.vertices);
        let moved = |v: usize, a: usize| state.vertices[v][a] != self.posed[v][a];
        let mut units: Vec<(f64, usize, usize)> = (0..gradient.len())
            .filter(|v| !self.solid.has_twin(*v))
            .flat_map(|v| (0..3).map(move |a| (v, a)))
            .filter(|(v, a)| moved(*v, *a))
            .map(|(v, a)| (gradient[v][a] * (state.vertices[v][a].next_up() - state.vertices[v][a]), v, a))
            .collect();
        units.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let mut state = state.clone();
        let mut open = deficit;
        for (effect, v, a) in units {
            let x = &mut state.vertices[v][a];
            if (open - effect).abs() < open.abs() {
                (*x, open) = (x.next_up(), open - effect);
            } else if (open + effect).abs() < open.abs() {
                (*x, open) = (x.next_down(), open + effect);
            }
        }
        state.steps += 1;
        state
    }
}
