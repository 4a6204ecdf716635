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
//! - Several volumes at once, of parts of a body: [`crate::goals`].
//! - Other costs than Σ δ²/m: [`crate::Energy`].
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

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use crate::axes::Axis;
use crate::binding::{Binding, moved};
use crate::energy::Energy;
use crate::goals::{Components, GoalFault, Goals, Gradients, VolumeGoal};
use crate::mesh::Bounds;
use crate::metric::{Factors, Metric};
use crate::points::{PointRows, PointTarget};
use crate::rows::{Missed, Rows, norm};
use crate::sensitivity::Sensitivity;
use crate::spare::{Array, Spare};
use crate::tolerances;
use crate::volume::{PartGradient, Solid, Volumes, spread_and_products};
use crate::{axes, coarse, gradient, nearest, order, parallel};

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
    /// What is kept small, of `δ/√m`. `None`: its square, summed over the controls.
    pub energy: Option<Energy>,
}

/// What must hold after a correction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Volumes, in the pose's length unit cubed, signed as [`Solid::volumes`] gives them. None: only points are met.
    pub volumes: Vec<VolumeGoal>,
    /// Points that must come to exact places, in the coordinates of the pose.
    pub points: Vec<PointTarget>,
}

impl Wanted {
    /// This signed volume for the whole body.
    #[must_use]
    pub fn volume(volume: f64) -> Self {
        Self { volumes: vec![VolumeGoal { components: Components::All, volume }], points: Vec::new() }
    }
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
    /// `|volume − target| / |target|`, the largest of all wanted volumes.
    pub relative_error: f64,
    /// How far the point that misses most is from its target, in extents of the pose; 0 without points.
    pub point_error: f64,
    /// How it ended.
    pub status: Status,
    /// Exact steps taken, the final ones against rounding included.
    pub steps: usize,
    /// How far [`Method::Nearest`] is from its condition: `‖δ − Σ μ M ∘ ∇V‖∞`, in extents of the pose; with an energy `S = L Lᵀ`,
    /// `√m ‖L⁻¹(S y − Σ μ √M ∘ ∇V)‖∞` with the largest mobility m. `None` for other methods.
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
    /// A wanted volume of a component that does not exist.
    #[error("wanted volume {goal} names component {component} of {components}")]
    MissingComponent {
        /// Its index in the list.
        goal: usize,
        /// The component.
        component: usize,
        /// Number of components.
        components: usize,
    },
    /// A wanted volume of no component, or of one twice.
    #[error("wanted volume {goal} must name at least one component, and none twice")]
    Components {
        /// Its index in the list.
        goal: usize,
    },
    /// An energy whose matrix cannot be factorised.
    #[error("the matrix of the energy of {controls} controls is too large for memory")]
    Energy {
        /// Number of controls.
        controls: usize,
    },
    /// A point that names a control that does not exist, or a place that is not finite.
    #[error("point {point} is not a point of this binding: {what}")]
    Point {
        /// Its index in the list.
        point: usize,
        /// What is wrong with it.
        what: String,
    },
    /// No displacement of the kind asked for gives what is wanted.
    #[error("{}: impossible, because {reason}", unmet(*.goal, *.target, *.volume))]
    Impossible {
        /// Index of the wanted volume that cannot be met; `None` where it is points alone.
        goal: Option<usize>,
        /// The wanted volume; 0 without one.
        target: f64,
        /// That volume of the pose.
        volume: f64,
        /// Why not.
        reason: Reason,
    },
}

/// The beginning of an error message.
fn unmet(goal: Option<usize>, target: f64, volume: f64) -> String {
    match goal {
        None => "the points cannot all come to their places".into(),
        Some(0) => format!("the volume cannot become {target:?} (it is {volume:?})"),
        Some(goal) => format!("wanted volume {goal} cannot become {target:?} (it is {volume:?})"),
    }
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
    /// The volume changes only together with other wanted volumes, which want something else.
    #[error(
        "the controls that can move change it only together with other wanted volumes, so that it misses by {by:.1e}"
    )]
    Coupled {
        /// By how far it misses.
        by: f64,
    },
    /// Other wanted volumes leave no choice.
    #[error("it follows from other wanted volumes, which make it {follows:?}")]
    Follows {
        /// What it is, given the others.
        follows: f64,
    },
    /// The volume along the gradient line turns back before the target.
    #[error(
        "along the gradient the volume can only reach {limit:?}, then it turns back; give more controls freedom, choose axes, \
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
    /// A point that was brought to its target is off it by the rounding of a very large displacement.
    #[error("the displacement it takes is so large that its rounding leaves point {point} {by:e} from its target")]
    PointRounding {
        /// Index of the point.
        point: usize,
        /// How far it is from its target.
        by: f64,
    },
    /// The numbers left the range of f64 on the way.
    #[error("the displacement it takes leaves the range of numbers")]
    Overflow,
}

impl CorrectError {
    /// The same for a body whose volumes are counted with `orientation` (1 or −1).
    pub(crate) fn oriented(mut self, orientation: f64) -> Self {
        if let Self::Impossible { target, volume, reason, .. } = &mut self {
            *target *= orientation;
            *volume *= orientation;
            if let Reason::Turns { limit: volume } | Reason::Follows { follows: volume } = reason {
                *volume *= orientation;
            }
        }
        self
    }
}

/// Corrects a pose to what is wanted.
///
/// Controls pinned by the mobility keep their bits; the result has the same bits for any number of threads. Coordinates far
/// from the origin are taken relative to the model, so nothing is lost there until `vertices` are rounded. For many corrections
/// of one model, prepare a [`Corrector`].
///
/// # Errors
///
/// Arrays that do not fit together, values out of range, a torn surface; [`CorrectError::Impossible`] with the reason.
pub fn correct(pose: &Pose, wanted: &Wanted, options: &CorrectOptions) -> Result<Correction, CorrectError> {
    let prepare = if is_long(pose, options) { Corrector::new } else { Corrector::borrowed };
    prepare(pose.solid, pose.binding, options)?.correct(pose.vertices, wanted)
}

/// [`correct`] for the last time with `binding`: where there is a copy of it, its memory is free meanwhile.
pub(crate) fn correct_last(
    solid: &Solid,
    binding: Binding,
    vertices: &[DVec3],
    wanted: &Wanted,
    options: &CorrectOptions,
) -> Result<Correction, CorrectError> {
    let pose = Pose { solid, vertices, binding: &binding };
    if !is_long(&pose, options) {
        return correct(&pose, wanted, options);
    }
    let corrector = Corrector::new(solid, &binding, options)?.detached();
    drop(binding);
    let solved = corrector.solved(vertices, wanted, false)?;
    corrector.spare.clear();
    Ok(solved.correction(vertices))
}

/// Whether the copies of a [`Corrector`] are worth their time for a single correction: many evaluations of a large mesh are.
fn is_long(pose: &Pose, options: &CorrectOptions) -> bool {
    options.method == Method::Nearest && pose.vertices.len() >= coarse::LEAST_VERTICES
}

/// A body, a binding and how to correct, prepared for any number of poses and wishes.
///
/// It has its own copies of both with the vertices in the order of lattice cells, which memory likes; callers see their own order.
#[derive(Clone, Debug)]
pub struct Corrector<'a> {
    solid: Cow<'a, Solid>,
    binding: Cow<'a, Binding>,
    /// The order of the copies; `None`: as given.
    order: Option<Order>,
    way: Way,
    metric: Metric,
    is_movable: bool,
    spare: Spare,
}

/// Another order of the vertices.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    /// The vertex at each place.
    vertices: Vec<u32>,
    /// The place of each vertex.
    places: Vec<u32>,
}

/// [`Method`] with what it needs.
#[derive(Clone, Debug)]
enum Way {
    Nearest,
    Gradient,
    Axes(Vec<Axis>),
}

/// A correction that has been found, and on what way.
pub(crate) struct Solved<'a> {
    pub(crate) problem: Problem<'a>,
    /// After the points have been brought to their targets, for the ways that begin with that.
    pub(crate) start: State,
    pub(crate) end: State,
    /// What the axes did, where that was asked for.
    pub(crate) trace: Vec<axes::Taken>,
    /// Of [`Method::Nearest`].
    pub(crate) residual: Option<f64>,
    has_moved: bool,
}

impl<'a> Corrector<'a> {
    /// Prepares corrections of `solid` by the controls of `binding`.
    ///
    /// # Errors
    ///
    /// Arrays that do not fit together, values out of range.
    pub fn new(solid: &'a Solid, binding: &'a Binding, options: &CorrectOptions) -> Result<Self, CorrectError> {
        let mut corrector = Self::borrowed(solid, binding, options)?;
        let vertices = binding.cell_order();
        corrector.solid = Cow::Owned(solid.permuted(&vertices).ready());
        corrector.binding = Cow::Owned(binding.permuted(&vertices));
        corrector.order = Some(Order { places: order::places(&vertices), vertices });
        Ok(corrector)
    }

    /// The same, borrowing nothing.
    fn detached(self) -> Corrector<'static> {
        Corrector {
            solid: Cow::Owned(self.solid.into_owned()),
            binding: Cow::Owned(self.binding.into_owned()),
            order: self.order,
            way: self.way,
            metric: self.metric,
            is_movable: self.is_movable,
            spare: self.spare,
        }
    }

    /// For one correction: nothing is copied.
    pub(crate) fn borrowed(
        solid: &'a Solid,
        binding: &'a Binding,
        options: &CorrectOptions,
    ) -> Result<Self, CorrectError> {
        let controls = binding.control_count();
        length("the binding", binding.vertex_count(), solid.vertex_count())?;
        let mobility = options.mobility.clone().unwrap_or_else(|| vec![DVec3::ONE; controls]);
        length("the mobility", mobility.len(), controls)?;
        if let Some(control) = mobility.iter().position(|m| !(m.is_finite() && m.min_element() >= 0.0)) {
            return Err(CorrectError::Mobility { control, value: mobility[control] });
        }
        if let Some(energy) = &options.energy {
            length("the energy", energy.control_count(), controls)?;
        }
        let mut factors = Factors::of(options.energy.clone(), binding.is_portable());
        let too_large = || CorrectError::Energy { controls };
        let metric = factors.metric(&mobility).ok_or_else(too_large)?;
        let way = match &options.method {
            Method::Nearest => Way::Nearest,
            Method::Gradient => Way::Gradient,
            Method::Axes { directions, shares } => {
                Way::Axes(axes::prepared(directions, shares.as_deref(), &mobility, &mut factors, too_large)?)
            }
        };
        let is_movable = mobility.iter().any(|m| *m != DVec3::ZERO);
        let (solid, binding) = (Cow::Borrowed(solid), Cow::Borrowed(binding));
        Ok(Self { solid, binding, order: None, way, metric, is_movable, spare: Spare::default() })
    }

    /// Corrects the posed vertices (#vertices × 3) to what is wanted.
    ///
    /// # Errors
    ///
    /// As [`correct`].
    pub fn correct(&self, vertices: &[DVec3], wanted: &Wanted) -> Result<Correction, CorrectError> {
        Ok(self.solved(vertices, wanted, false)?.correction(vertices))
    }

    /// Corrects the posed vertices (#vertices × 3) to what is wanted, and keeps what derivatives need.
    ///
    /// Where the method is `nearest` and its status is [`Status::NotNearest`], derivatives are not those of a minimiser.
    ///
    /// # Errors
    ///
    /// As [`correct`].
    pub fn sensitivity<'b>(&'b self, vertices: &[DVec3], wanted: &'b Wanted) -> Result<Sensitivity<'b>, CorrectError> {
        let axes = match &self.way {
            Way::Axes(axes) => Some(&axes[..]),
            Way::Nearest | Way::Gradient => None,
        };
        Ok(Sensitivity::new(self.solved(vertices, wanted, true)?, axes, vertices))
    }

    /// Solves; `is_traced` makes all steps, those by nothing included, and keeps them.
    pub(crate) fn solved<'b>(
        &'b self,
        posed: &[DVec3],
        wanted: &'b Wanted,
        is_traced: bool,
    ) -> Result<Solved<'b>, CorrectError> {
        let problem = self.problem(posed, wanted)?;
        let start = problem.posed_state();
        let mut trace = Vec::new();
        let mut residual = None;
        let is_met = problem.is_met(&start) && problem.point_error(&start) <= f64::EPSILON;
        if is_met && !(is_traced && self.is_movable) {
            let end = start.clone();
            return Ok(Solved { problem, start, end, trace, residual, has_moved: false });
        }
        if !self.is_movable {
            return Err(problem.impossible(problem.unmet_goal(&start), Reason::Pinned));
        }
        if self.binding.kept_count() == self.binding.vertex_count() {
            return Err(problem.impossible(problem.unmet_goal(&start), Reason::NothingBound));
        }
        let (start, end) = match &self.way {
            Way::Gradient => {
                let start = problem.with_points(start)?;
                let end = gradient::corrected(&problem, start.clone())?;
                (start, end)
            }
            Way::Nearest => {
                let start = problem.with_points(start)?;
                let (end, reached) = nearest::corrected(&problem, start.clone())?;
                residual = Some(reached);
                (start, end)
            }
            Way::Axes(axes) => {
                let end = axes::corrected(&problem, start.clone(), axes, is_traced.then_some(&mut trace))?;
                (start, end)
            }
        };
        problem.check(&end)?;
        let end = if is_met { problem.posed_state() } else { end };
        Ok(Solved { problem, start, end, trace, residual, has_moved: !is_met })
    }

    /// Controls of the binding.
    pub(crate) fn control_count(&self) -> usize {
        self.binding.control_count()
    }

    /// Components of the body.
    pub(crate) fn component_count(&self) -> usize {
        self.solid.component_count()
    }

    /// The checked request.
    pub(crate) fn problem<'b>(&'b self, posed: &[DVec3], wanted: &'b Wanted) -> Result<Problem<'b>, CorrectError> {
        let (solid, binding) = (&*self.solid, &*self.binding);
        length("the posed vertices", posed.len(), solid.vertex_count())?;
        check_points(&wanted.points, binding.control_count())?;
        let order = self.order.as_ref();
        let vertex = |i: usize| order.map_or(i, |order| order.vertices[i] as usize);
        let mut near = self.spare.array();
        let bounds = match order {
            Some(order) => Bounds::filled(near.memory(), posed.len(), |i| posed[order.vertices[i] as usize]),
            None => Bounds::filled(near.memory(), posed.len(), |i| posed[i]),
        };
        if !bounds.is_none_or(|bounds| bounds.is_finite()) {
            let vertex = posed.iter().position(|p| !p.is_finite()).unwrap_or_default();
            return Err(CorrectError::NotFinite { vertex, position: posed[vertex] });
        }
        let (origin, extent) = bounds.map_or((DVec3::ZERO, 0.0), |bounds| (bounds.lossless_origin(), bounds.extent()));
        if origin != DVec3::ZERO {
            parallel::fill(near.memory(), posed.len(), |i| posed[vertex(i)] - origin);
        }
        let posed = near;
        if let Some(pair) = solid.torn_vertices(&posed) {
            let [a, b] = pair.map(|v| vertex(v as usize) as u32);
            return Err(CorrectError::Torn { a: a.min(b), b: a.max(b) });
        }
        let goals = Goals::new(&wanted.volumes, solid.component_count());
        let is_whole = goals.as_ref().is_ok_and(Goals::is_whole);
        let (volumes, slope) = match is_whole.then(|| Slope::with_volumes(solid, binding, &posed)).flatten() {
            Some((volumes, slope)) => (volumes, Some(Arc::new(slope))),
            None => (solid.volumes(&posed), None),
        };
        let posed = Arc::new(posed);
        let goals = goals.map_err(|fault| of_fault(fault, &wanted.volumes, &volumes))?;
        let goals = goals.of(solid);
        let points = &wanted.points[..];
        let rows = (!points.is_empty()).then(|| PointRows::new(points, &self.metric));
        Ok(Problem {
            solid,
            binding,
            metric: &self.metric,
            wanted,
            goals,
            points,
            rows,
            posed,
            origin,
            order,
            volumes,
            slope,
            extent,
            tilt: None,
            spare: self.spare.clone(),
        })
    }
}

/// Whether points follow controls that exist, with numbers that are finite.
pub(crate) fn check_points(points: &[PointTarget], controls: usize) -> Result<(), CorrectError> {
    for (point, PointTarget { weights, position, target }) in points.iter().enumerate() {
        if let Some((control, _)) = weights.iter().find(|(control, _)| *control >= controls) {
            let what = format!("it follows control {control} of {controls}");
            return Err(CorrectError::Point { point, what });
        }
        if !(position.is_finite() && target.is_finite() && weights.iter().all(|(_, w)| w.is_finite())) {
            return Err(CorrectError::Point { point, what: "its numbers must be finite".into() });
        }
    }
    Ok(())
}

/// Why there is no correction to the volumes `wanted` of a pose that has `volumes`.
pub(crate) fn of_fault(fault: GoalFault, wanted: &[VolumeGoal], volumes: &Volumes) -> CorrectError {
    match fault {
        GoalFault::Missing { goal, component } => {
            CorrectError::MissingComponent { goal, component, components: volumes.components.len() }
        }
        GoalFault::Target { goal } => CorrectError::Target { target: wanted[goal].volume },
        GoalFault::Components { goal } => CorrectError::Components { goal },
        GoalFault::Contradiction { goal, follows } => {
            let VolumeGoal { volume: target, .. } = wanted[goal];
            let volume = wanted[goal].of(volumes);
            CorrectError::Impossible { goal: Some(goal), target, volume, reason: Reason::Follows { follows } }
        }
    }
}

/// Whether an array has the length that it must have.
fn length(what: &'static str, found: usize, expected: usize) -> Result<(), CorrectError> {
    match found == expected {
        true => Ok(()),
        false => Err(CorrectError::Length { what, found, expected }),
    }
}

impl<'a> Solved<'a> {
    /// The problem, the states at the start and the end, what the axes did, and what is told of it.
    pub(crate) fn into_parts(self, posed: &[DVec3]) -> (Problem<'a>, State, State, Vec<axes::Taken>, Correction) {
        let correction = self.correction(posed);
        (self.problem, self.start, self.end, self.trace, correction)
    }

    /// What is told of it, for the pose `posed` as it was given.
    fn correction(&self, posed: &[DVec3]) -> Correction {
        let Self { problem, end, residual, has_moved, .. } = self;
        let status = match residual {
            _ if !has_moved => Status::AlreadyMet,
            Some(residual) if *residual > tolerances::KKT_ENOUGH => Status::NotNearest,
            _ => Status::Exact,
        };
        Correction {
            vertices: if *has_moved { problem.returned(&end.vertices, problem.origin) } else { posed.to_vec() },
            volume_before: problem.volumes.total,
            volume: end.volumes.total,
            relative_error: problem.relative_error(end),
            point_error: problem.point_error(end),
            status,
            steps: end.steps,
            residual: *residual,
            displacement: end.displacement.clone(),
            component_volumes: end.volumes.components.clone(),
        }
    }
}

/// A checked request, in coordinates near the model.
pub(crate) struct Problem<'a> {
    pub(crate) solid: &'a Solid,
    pub(crate) binding: &'a Binding,
    pub(crate) metric: &'a Metric,
    wanted: &'a Wanted,
    pub(crate) goals: Goals,
    pub(crate) points: &'a [PointTarget],
    /// What moves a point, where there are points.
    pub(crate) rows: Option<PointRows>,
    /// The posed vertices (#vertices × 3), relative to `origin`.
    pub(crate) posed: Arc<Array>,
    origin: DVec3,
    /// The order of vertices here; `None`: as the caller has them.
    order: Option<&'a Order>,
    /// Of the posed vertices.
    volumes: Volumes,
    /// Of the posed vertices, where the volume of the whole body is the only goal.
    slope: Option<Arc<Slope>>,
    /// Of the posed vertices.
    pub(crate) extent: f64,
    /// What is added to the volumes, where another body stands for the one that is meant.
    tilt: Option<Tilt>,
    pub(crate) spare: Spare,
}

/// A linear function of the displacement, added to each goal's volume.
pub(crate) struct Tilt {
    /// Its value without displacement (#goals).
    pub(crate) offset: Vec<f64>,
    /// Its gradient (#goals × #controls × 3).
    pub(crate) slope: Vec<Vec<DVec3>>,
}

/// Where a correction stands.
#[derive(Clone, Debug)]
pub(crate) struct State {
    /// δ so far (#controls × 3).
    pub(crate) displacement: Vec<DVec3>,
    /// X + W δ (#vertices × 3).
    pub(crate) vertices: Arc<Array>,
    /// Its volumes.
    pub(crate) volumes: Volumes,
    /// How the volume depends on the controls there, where it is known: with the whole body as the only goal, at the pose itself.
    pub(crate) slope: Option<Arc<Slope>>,
    pub(crate) steps: usize,
}

/// One exact step: a control displacement (#controls × 3) and what it does to the vertices (#vertices × 3).
pub(crate) struct Step {
    pub(crate) controls: Vec<DVec3>,
    pub(crate) vertices: Array,
}

/// How a goal's volume depends on the controls at a state.
#[derive(Clone, Debug)]
pub(crate) struct Slope {
    /// ∇V (#controls × 3).
    pub(crate) controls: Vec<DVec3>,
    /// Σ |∂V/∂p|₁ over the vertices: about the surface's area, and the scale on which ∇V is rounded.
    pub(crate) spread: f64,
    /// V, with the rounding of a plain sum, and without what a [`Tilt`] adds.
    pub(crate) rough_volume: f64,
}

impl Slope {
    /// Of the whole body at a pose, with its volumes: one sweep for both. `None` where that cannot be.
    pub(crate) fn with_volumes(solid: &Solid, binding: &Binding, points: &[DVec3]) -> Option<(Volumes, Self)> {
        let of_part = |vertices, g: &PartGradient| SlopePart::of(binding, points, vertices, g);
        let (volumes, parts) = is_swept(solid, binding).then(|| solid.survey(points, of_part))?;
        Some((volumes, SlopePart::whole(binding, parts)))
    }
}

/// Whether the slope of the whole body can be had in one sweep that keeps no gradient: a body without caps, which share out their parts of
/// it last, and controls so few that partial sums, one per chunk of vertices, take no more memory than the vertices.
fn is_swept(solid: &Solid, binding: &Binding) -> bool {
    solid.cap_count() == 0 && binding.control_count() <= parallel::CHUNK
}

/// What some vertices are of a [`Slope`].
struct SlopePart {
    controls: Vec<DVec3>,
    spread_and_products: [f64; 2],
}

impl SlopePart {
    fn of(binding: &Binding, points: &[DVec3], vertices: Range<usize>, g: &PartGradient) -> Self {
        let first = vertices.start;
        let spread_and_products = spread_and_products(g.iter(), &points[vertices.clone()]);
        Self { controls: binding.part_of_transposed(vertices, |v| g.at(v - first)), spread_and_products }
    }

    fn whole(binding: &Binding, parts: Vec<Self>) -> Slope {
        let [mut spread, mut products] = [0.0; 2];
        for part in &parts {
            spread += part.spread_and_products[0];
            products += part.spread_and_products[1];
        }
        let controls = binding.sum_of_parts(parts.into_iter().map(|part| part.controls));
        Slope { controls, spread, rough_volume: products / 3.0 }
    }
}

/// The slopes of all goals in the metric.
pub(crate) struct Normals {
    /// Rᵀ ∇V, less what would move a point (#goals × #unknowns).
    pub(crate) pulled: Vec<Vec<f64>>,
    /// The same as rows; a goal that depends on no control is none of them.
    pub(crate) rows: Rows,
    /// Whether a goal depends on no control.
    is_dead: Vec<bool>,
}

impl State {
    /// This state after `t` times `step`, in whose memory its vertices are then; its volumes are not yet measured.
    pub(crate) fn after_part(&self, step: Step, t: f64) -> Self {
        let Step { controls, mut vertices } = step;
        parallel::for_each_chunk(vertices.memory(), parallel::CHUNK, |first, part| {
            part.iter_mut().zip(&self.vertices[first..]).for_each(|(d, p)| *d = moved(*p, *d * t));
        });
        self.after_moves(vertices, controls.into_iter().map(|by| by * t))
    }

    /// This state with its controls moved and its vertices at new places.
    fn after_moves(&self, vertices: Array, controls: impl Iterator<Item = DVec3>) -> Self {
        Self {
            displacement: self.displacement.iter().zip(controls).map(|(d, by)| moved(*d, by)).collect(),
            vertices: Arc::new(vertices),
            volumes: self.volumes.clone(),
            slope: None,
            steps: self.steps + 1,
        }
    }
}

impl<'a> Problem<'a> {
    /// That `goal` (an index of [`Goals`]; `None`: the points) cannot be met.
    pub(crate) fn impossible(&self, goal: Option<usize>, reason: Reason) -> CorrectError {
        match goal {
            None => CorrectError::Impossible { goal: None, target: 0.0, volume: 0.0, reason },
            Some(goal) => {
                let (index, target) = (self.goals.index[goal], self.goals.targets[goal]);
                let volume = self.wanted.volumes[index].of(&self.volumes);
                CorrectError::Impossible { goal: Some(index), target, volume, reason }
            }
        }
    }

    /// Vectors per vertex in the caller's order, moved by `by`.
    pub(crate) fn returned(&self, vectors: &[DVec3], by: DVec3) -> Vec<DVec3> {
        match self.order {
            Some(order) => parallel::collect(vectors.len(), |v| moved(vectors[order.places[v] as usize], by)),
            None => parallel::collect(vectors.len(), |v| moved(vectors[v], by)),
        }
    }

    /// Vectors per vertex, in the caller's order, in the order here.
    pub(crate) fn ordered<'b>(&self, vectors: &'b [DVec3]) -> Cow<'b, [DVec3]> {
        match self.order {
            Some(order) => Cow::Owned(parallel::collect(vectors.len(), |i| vectors[order.vertices[i] as usize])),
            None => Cow::Borrowed(vectors),
        }
    }

    /// The pose itself.
    fn posed_state(&self) -> State {
        let displacement = vec![DVec3::ZERO; self.binding.control_count()];
        State {
            displacement,
            vertices: Arc::clone(&self.posed),
            volumes: self.volumes.clone(),
            slope: self.slope.clone(),
            steps: 0,
        }
    }

    /// The same request for another body and binding with the volumes tilted.
    pub(crate) fn standing_for<'b>(
        &'b self,
        solid: &'b Solid,
        binding: &'b Binding,
        posed: &Arc<Array>,
        tilt: Tilt,
    ) -> Problem<'b> {
        Problem {
            solid,
            binding,
            metric: self.metric,
            wanted: self.wanted,
            goals: self.goals.clone().of(solid),
            points: self.points,
            rows: self.rows.clone(),
            volumes: solid.volumes(posed),
            posed: Arc::clone(posed),
            origin: self.origin,
            order: None,
            slope: None,
            extent: self.extent,
            tilt: Some(tilt),
            spare: posed.spare().clone(),
        }
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
    pub(crate) fn point_error(&self, state: &State) -> f64 {
        self.moves(state).iter().map(|m| m.length()).fold(0.0, f64::max) / self.extent
    }

    /// The volumes of the goals (#goals).
    pub(crate) fn goal_volumes(&self, state: &State) -> Vec<f64> {
        let mut volumes = self.goals.volumes(&state.volumes);
        if let Some(tilt) = &self.tilt {
            for ((volume, offset), slope) in volumes.iter_mut().zip(&tilt.offset).zip(&tilt.slope) {
                *volume += offset + slope.iter().zip(&state.displacement).map(|(s, d)| s.dot(*d)).sum::<f64>();
            }
        }
        volumes
    }

    /// The scale of a goal's volume: before or after, what is less.
    pub(crate) fn volume_scale(&self, goal: usize) -> f64 {
        let before = self.goals.volumes(&self.volumes)[goal];
        before.abs().min(self.goals.targets[goal].abs())
    }

    /// What each goal's volume still lacks (#goals).
    pub(crate) fn deficits(&self, state: &State) -> Vec<f64> {
        self.goals.targets.iter().zip(self.goal_volumes(state)).map(|(target, volume)| target - volume).collect()
    }

    /// The largest of the goals' relative errors, those included that follow from others.
    fn relative_error(&self, state: &State) -> f64 {
        let error = |goal: &VolumeGoal| ((goal.of(&state.volumes) - goal.volume) / goal.volume).abs();
        self.wanted.volumes.iter().map(error).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Whether every goal is met, to its own rounding.
    pub(crate) fn is_met(&self, state: &State) -> bool {
        self.deficits(state).iter().enumerate().all(|(goal, deficit)| self.is_within_rounding(goal, *deficit))
    }

    /// Whether a deficit is no more than the rounding of its goal.
    pub(crate) fn is_within_rounding(&self, goal: usize, deficit: f64) -> bool {
        deficit.abs() <= tolerances::VOLUME_ROUNDING * self.goals.targets[goal].abs()
    }

    /// The goal that is missed most, relatively; none without goals.
    pub(crate) fn unmet_goal(&self, state: &State) -> Option<usize> {
        let errors = self.deficits(state).into_iter().zip(&self.goals.targets).map(|(d, t)| (d / t).abs());
        errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(goal, _)| goal)
    }

    /// Whether the end of a correction is what was wanted.
    fn check(&self, end: &State) -> Result<(), CorrectError> {
        if self.point_error(end).is_infinite() {
            return Err(self.impossible(self.unmet_goal(end), Reason::Overflow));
        }
        if self.point_error(end) > tolerances::POINT {
            let misses = self.moves(end).into_iter().map(|m| m.length()).enumerate();
            let (point, by) = misses.fold((0, 0.0), |worst, miss| if miss.1 > worst.1 { miss } else { worst });
            return Err(self.impossible(self.unmet_goal(end), Reason::PointRounding { point, by }));
        }
        let relative_error = self.relative_error(end);
        if !relative_error.is_finite() {
            return Err(self.impossible(self.unmet_goal(end), Reason::Overflow));
        }
        if relative_error > tolerances::VOLUME {
            return Err(self.impossible(self.unmet_goal(end), Reason::Rounding { relative_error }));
        }
        Ok(())
    }

    /// Of numbers for each wanted volume those of the goals.
    pub(crate) fn of_goals(&self, wanted: &[f64]) -> Vec<f64> {
        assert_eq!(wanted.len(), self.wanted.volumes.len(), "one number for each wanted volume");
        self.goals.index.iter().map(|index| wanted[*index]).collect()
    }

    /// Numbers of the goals as numbers for each wanted volume; 0 for those that follow from others.
    pub(crate) fn to_wanted(&self, goals: &[f64]) -> Vec<f64> {
        let mut wanted = vec![0.0; self.wanted.volumes.len()];
        self.goals.index.iter().zip(goals).for_each(|(index, number)| wanted[*index] = *number);
        wanted
    }

    /// The smallest z (#unknowns) that moves the points by `moves` (#points), as far as they do not depend on one another.
    pub(crate) fn least_moves(&self, moves: &[DVec3]) -> Vec<f64> {
        let unknowns = self.metric.unknowns();
        let least = self.rows.as_ref().map(|rows| rows.least(unknowns, moves, f64::INFINITY));
        least.map_or_else(|| vec![0.0; unknowns], |least| least.expect("a tolerance that all meet"))
    }

    /// The transpose of [`Problem::least_moves`] (#points).
    pub(crate) fn move_multipliers(&self, z: &[f64]) -> Vec<DVec3> {
        self.rows.as_ref().map_or_else(Vec::new, |rows| rows.multipliers(z))
    }

    /// `state` with the points brought to their targets by the smallest displacement, once more where rounding shows.
    pub(crate) fn with_points(&self, mut state: State) -> Result<State, CorrectError> {
        /// More: nothing left to gain; fewer: energies that are stiff in some directions leave points off by rounding.
        const ROUNDS: usize = 3;
        let Some(rows) = &self.rows else { return Ok(state) };
        for _ in 0..ROUNDS {
            if self.point_error(&state) <= f64::EPSILON {
                break;
            }
            let z = rows
                .least(self.metric.unknowns(), &self.moves(&state), tolerances::POINT * self.extent)
                .map_err(|Missed { row, by }| self.misses(&state, row, by))?;
            state = self.measured(self.after(&state, &z));
        }
        Ok(state)
    }

    /// That a point contradicts others.
    pub(crate) fn misses(&self, state: &State, point: usize, by: f64) -> CorrectError {
        self.impossible(self.unmet_goal(state), Reason::Contradiction { point, by })
    }

    /// What z (#unknowns) does.
    pub(crate) fn step(&self, z: &[f64]) -> Step {
        let controls = self.metric.displacement(z);
        let mut vertices = self.spare.array();
        self.binding.apply_into(&controls, vertices.memory());
        Step { controls, vertices }
    }

    /// `state` after what z (#unknowns) does, its volumes not yet measured.
    pub(crate) fn after(&self, state: &State, z: &[f64]) -> State {
        let controls = self.metric.displacement(z);
        let mut vertices = self.spare.array();
        self.binding.displace_into(&state.vertices, &controls, vertices.memory());
        state.after_moves(vertices, controls.into_iter())
    }

    /// `state` with its volumes measured.
    pub(crate) fn measured(&self, mut state: State) -> State {
        state.volumes = self.solid.volumes(&state.vertices);
        state
    }

    /// ∂V/∂P of each goal at a state.
    pub(crate) fn gradients(&self, state: &State) -> Gradients<'_> {
        self.goals.gradients(self.solid, &state.vertices, &self.spare)
    }

    /// ∇V of each goal (#goals).
    pub(crate) fn slopes(&self, state: &State) -> Vec<Slope> {
        if let Some(slope) = &state.slope {
            return vec![Slope::clone(slope)];
        }
        let mut slopes = if self.is_swept() {
            let points = &state.vertices;
            let of_part = |vertices, g: &PartGradient| SlopePart::of(self.binding, points, vertices, g);
            vec![SlopePart::whole(self.binding, self.solid.slope_survey(points, of_part))]
        } else {
            let gradients = self.gradients(state);
            parallel::map(self.goals.len(), |goal| {
                let (spread, rough_volume) = gradients.spread_and_rough_volume(goal, &state.vertices);
                Slope { controls: gradients.adjoint(goal, self.binding), spread, rough_volume }
            })
        };
        for (slope, of_tilt) in slopes.iter_mut().zip(self.tilt.iter().flat_map(|tilt| &tilt.slope)) {
            slope.controls.iter_mut().zip(of_tilt).for_each(|(c, s)| *c += *s);
        }
        slopes
    }

    /// Whether the whole body is the only goal and its slope can be had in one sweep.
    pub(crate) fn is_swept(&self) -> bool {
        self.goals.is_whole() && is_swept(self.solid, self.binding)
    }

    /// ∇V along `direction` (#controls) of the whole body with these vertices, and Σ |∂V/∂p|₁, where [`Problem::is_swept`].
    pub(crate) fn slope_along(&self, points: &[DVec3], direction: DVec3) -> (Vec<f64>, f64) {
        let parts = self.solid.slope_survey(points, |vertices, g| {
            let first = vertices.start;
            let spread = g.iter().fold(DVec3::ZERO, |sum, g| sum + g.abs()).element_sum();
            (self.binding.part_of_transposed(vertices, |v| g.at(v - first).dot(direction)), spread)
        });
        let spread = parts.iter().map(|part| part.1).sum();
        (self.binding.sum_of_parts(parts.into_iter().map(|part| part.0)), spread)
    }

    /// The slopes in the metric.
    pub(crate) fn normals(&self, slopes: &[Slope]) -> Normals {
        let root = self.metric.largest_mobility().sqrt();
        let mut normals = Normals { pulled: Vec::new(), rows: Rows::default(), is_dead: Vec::new() };
        for slope in slopes {
            let mut pulled = self.metric.pulled(&slope.controls);
            self.project(&mut pulled);
            let least = tolerances::DEAD_AXIS * slope.spread * root;
            normals.is_dead.push(norm(&pulled) <= least);
            normals.rows.push(pulled.clone(), least);
            normals.pulled.push(pulled);
        }
        normals
    }

    /// The smallest z that changes the goals' volumes by `wanted` to first order, or why there is none.
    pub(crate) fn least(&self, normals: &Normals, wanted: &[f64]) -> Result<Vec<f64>, CorrectError> {
        let (z, missed) = normals.rows.least(self.metric.unknowns(), wanted);
        match missed {
            Some(Missed { row, by }) if by > tolerances::VOLUME * self.goals.targets[row].abs() => {
                let reason = if normals.is_dead[row] { Reason::Dead } else { Reason::Coupled { by } };
                Err(self.impossible(Some(row), reason))
            }
            _ => Ok(z),
        }
    }

    /// `Σ factor · ∇²V v` over the goals (#controls × 3) at `state` along the control displacement v (#controls × 3).
    pub(crate) fn slope_change(&self, state: &State, factors: &[f64], v: &[DVec3]) -> Vec<DVec3> {
        let q = self.binding.apply(v);
        self.binding.adjoint(&self.goals.gradient_change(factors, self.solid, &state.vertices, &q))
    }

    /// Takes away from z (#unknowns) what would move a point.
    pub(crate) fn project(&self, z: &mut [f64]) {
        if let Some(rows) = &self.rows {
            rows.project(z);
        }
    }

    /// Takes away what rounding left of the deficits of `state`, which are measured: by small steps of the same kind, `after(state,
    /// deficits, round)` (`None` where no such step exists any more), and at last by the choice of roundings.
    pub(crate) fn finished(&self, mut state: State, after: impl Fn(&State, &[f64], usize) -> Option<State>) -> State {
        /// More: nothing left to gain after two or three; fewer: thin models end further off than they need.
        const ROUNDS: usize = 4;
        let error =
            |deficits: &[f64]| -> f64 { deficits.iter().zip(&self.goals.targets).map(|(d, t)| (d / t).abs()).sum() };
        for round in 0..2 * ROUNDS {
            let deficits = self.deficits(&state);
            let is_good =
                deficits.iter().zip(&self.goals.targets).all(|(d, t)| d.abs() <= tolerances::VOLUME * t.abs());
            if self.is_met(&state) || !error(&deficits).is_finite() || (is_good && round >= ROUNDS) {
                break;
            }
            let next = if round < ROUNDS {
                after(&state, &deficits, round)
            } else {
                Some(self.rounded_otherwise(&state, &deficits))
            };
            let Some(next) = next else { continue };
            let next = self.measured(next);
            if error(&self.deficits(&next)) < error(&deficits) {
                state = next;
            }
        }
        state
    }

    /// `state` with some coordinates that the correction moved rounded up or down by one unit in the last place, such that
    /// the deficits shrink: the largest effects first, where a vertex concerns one goal only.
    fn rounded_otherwise(&self, state: &State, deficits: &[f64]) -> State {
        let gradients = self.gradients(state);
        let of_goals: Vec<Vec<(usize, DVec3)>> =
            (0..self.goals.len()).map(|goal| gradients.of_vertices(goal)).collect();
        let moved = |v: usize, a: usize| state.vertices[v][a] != self.posed[v][a];
        let mut concerns = vec![0; state.vertices.len()];
        of_goals.iter().flatten().for_each(|(v, _)| concerns[*v] += 1);
        let is_free = |v: usize| !self.solid.has_twin(v) && concerns[v] == 1;
        let mut next = state.clone();
        let vertices = Arc::make_mut(&mut next.vertices).memory();
        next.slope = None;
        for (gradient, &deficit) in of_goals.iter().zip(deficits) {
            let mut units: Vec<(f64, usize, usize)> = gradient
                .iter()
                .filter(|(v, _)| is_free(*v))
                .flat_map(|(v, g)| (0..3).map(move |a| (*v, a, g[a])))
                .filter(|(v, a, _)| moved(*v, *a))
                .map(|(v, a, g)| (g * (state.vertices[v][a].next_up() - state.vertices[v][a]), v, a))
                .collect();
            units.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
            let mut open = deficit;
            for (effect, v, a) in units {
                let x = &mut vertices[v][a];
                if (open - effect).abs() < open.abs() {
                    (*x, open) = (x.next_up(), open - effect);
                } else if (open + effect).abs() < open.abs() {
                    (*x, open) = (x.next_down(), open + effect);
                }
            }
        }
        next.steps += 1;
        next
    }

    /// `state` after the smallest step that takes away `deficits` to first order; `None` where there is none.
    pub(crate) fn after_least(&self, state: &State, deficits: &[f64]) -> Option<State> {
        self.after_least_along(&self.normals(&self.slopes(state)), state, deficits)
    }

    /// [`Problem::after_least`] with normals that are known.
    pub(crate) fn after_least_along(&self, normals: &Normals, state: &State, deficits: &[f64]) -> Option<State> {
        Some(self.after(state, &self.least(normals, deficits).ok()?))
    }
}
