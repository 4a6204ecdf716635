//! Elastic deformation at constant volume: nodes that are moved or held, and the rest settles as springs between the nodes want while volumes
//! keep their values. HML.
//!
//! ```text
//! min E(C)  subject to  V(C) = V_ref                                                              (6), (15)
//! ```
//!
//! E is the energy of the springs ([`crate::Springs`]), C the places of the nodes, of which some coordinates are held. [`Elastic`] is one such body with
//! its state: nodes can be moved, and it settles again from where it was. It ends with the exact correction of the library
//! ([`crate::correct`]) over the free nodes, so that volumes and points are met as everywhere.
//!
//! The volume and its derivatives come
//!
//! - from a [`crate::VolumeForm`] of the nodes, where there are few;
//! - from the mesh, where it is small;
//! - from a coarse mesh that stands for it ([`crate::coarse`]) and is tilted, step by step, such that it agrees with the fine one, where both
//!   are many.
//!
//! HML = G. Hirota, R. Maheshwari, M. C. Lin, *Fast volume-preserving free form deformation using multi-level optimization*, Solid Modeling
//! 1999.
//!
//! # Changes versus the paper
//!
//! - Newton's method on poses of the wanted volume ([`crate::equilibrium`]). The paper's own method is [`ElasticSolver::AugmentedLagrangian`].
//! - Several volumes, points at exact places, centre of mass and inertia tensor, each by its own multiplier.
//! - A last exact correction: the paper ends at 0.05 to 0.08 % of the volume.

use std::borrow::Cow;
use std::time::Duration;

use glam::{BVec3, DMat3, DVec3};

use crate::augmented::{self, Augmented, LevelReport};
use crate::binding::{Binding, translated};
use crate::block_matrix::{BlockPattern, Neighbours};
use crate::coarse::Coarse;
use crate::correct::{CorrectError, CorrectOptions, Correction, Corrector, Method, Wanted, check_points};
use crate::equilibrium::{Conditions, Ended, PointCondition, Pose, Search};
use crate::goals::{Goals, VolumeGoal};
use crate::kkt::Kkt;
use crate::measure::{FormMeasure, Measure, MeshMeasure, Numbers, Tilted};
use crate::mesh::Bounds;
use crate::moments::{Moments, combinations};
use crate::points::PointTarget;
use crate::springs::Springs;
use crate::tolerances;
use crate::volume::Solid;

/// A model in an elastic lattice.
#[derive(Clone, Copy, Debug)]
pub struct ElasticModel<'a> {
    /// The body whose volume is meant.
    pub solid: &'a Solid,
    /// How its vertices follow the nodes.
    pub binding: &'a Binding,
    /// The vertices with the nodes at rest (#vertices × 3).
    pub points: &'a [DVec3],
    /// The nodes at rest (#nodes × 3): the controls of the lattice.
    pub rest: &'a [DVec3],
    /// Between the nodes.
    pub springs: &'a Springs,
}

/// What must hold where the nodes have settled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElasticWanted {
    /// Volumes, signed as [`Solid::volumes`] gives them. None: springs alone decide.
    pub volumes: Vec<VolumeGoal>,
    /// Points that must come to exact places. Their position is that with the nodes at rest.
    pub points: Vec<PointTarget>,
    /// Where the centre of mass is to be, and what the inertia tensor.
    pub moments: Option<MomentTargets>,
}

/// The centre of mass of a body of density 1, and its inertia tensor about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentTargets {
    /// The centre of mass.
    pub center: DVec3,
    /// The inertia tensor about the centre of mass, `∫ (|x|² 1 − x xᵀ) dV`; `None`: it may change.
    pub inertia: Option<DMat3>,
}

impl MomentTargets {
    /// What `solid` has in the pose `points` (#vertices × 3); the inertia tensor only where `with_inertia`.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn of(solid: &Solid, points: &[DVec3], with_inertia: bool) -> Self {
        let origin = Bounds::of(points).map_or(DVec3::ZERO, |bounds| bounds.center());
        let center = origin + Moments::of(solid, points, origin).center();
        Self { center, inertia: with_inertia.then(|| Moments::of(solid, points, center).inertia()) }
    }
}

/// How to settle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElasticOptions {
    /// Which coordinates of the nodes may move (#nodes × 3). `None`: all.
    pub is_free: Option<Vec<BVec3>>,
    /// By which method.
    pub solver: ElasticSolver,
    /// Where volumes come from.
    pub evaluation: Evaluation,
}

/// By which method nodes settle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ElasticSolver {
    /// Newton's method on poses of the wanted volume.
    #[default]
    Newton,
    /// HML's: a penalty that grows, from the coarsest level of detail to the finest.
    AugmentedLagrangian(Augmented),
}

/// Where volumes and their derivatives come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Evaluation {
    /// A form where there are few nodes, and else the mesh.
    #[default]
    Auto,
    /// A form of the nodes: its set-up takes long for many nodes. Centre of mass and inertia have none, and come from the mesh with all else.
    Form,
    /// The mesh.
    Mesh,
}

/// Why nodes cannot settle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ElasticError {
    /// What is wanted is impossible, or not what can be wanted.
    #[error(transparent)]
    Correct(#[from] CorrectError),
    /// No coordinate may move.
    #[error("every node is held: there is nothing that could settle")]
    Held,
    /// A place that is not finite.
    #[error("node {node} is put at {place}: coordinates must be finite")]
    NotFinite {
        /// The node.
        node: usize,
        /// The place.
        place: DVec3,
    },
    /// A centre of mass or inertia tensor that is not finite, or a body without volume.
    #[error("the centre of mass and the inertia tensor must be finite, and the body must have a volume")]
    Moments,
    /// Something of another kind is wanted than at first.
    #[error("volumes of other components or other moments are wanted than at first: begin with a new body")]
    Changed,
    /// Too many nodes that are coupled.
    #[error("the matrix of {nodes} nodes is too large for memory")]
    TooLarge {
        /// Number of nodes.
        nodes: usize,
    },
    /// No pose with all that is wanted was found.
    #[error("from where the nodes are no pose was found that has all that is wanted at once")]
    NoPose,
}

/// How nodes have settled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ElasticStatus {
    /// Forces balance.
    Settled,
    /// Forces do not balance, and no step leads lower; the residual says how far off they are.
    Stuck,
    /// The steps were used up before forces balanced.
    StepLimit,
    /// The time was up, or the callback stopped it. It can go on from there.
    Stopped,
    /// HML's method ended as the paper ends it: volume within its tolerance, nodes that move no more from level to level.
    Approximate,
}

/// A body on its way.
#[derive(Clone, Debug, PartialEq)]
pub struct ElasticStep {
    /// Steps so far, since the last run began.
    pub step: usize,
    /// Where the nodes are (#nodes × 3).
    pub places: Vec<DVec3>,
    /// E.
    pub energy: f64,
    /// The largest force that no volume or point balances, in forces that stretch a spring by its own length.
    pub residual: f64,
}

/// What a run has come to.
#[derive(Clone, Debug, PartialEq)]
pub struct ElasticState {
    /// How it ended.
    pub status: ElasticStatus,
    /// Steps.
    pub steps: usize,
    /// Evaluations of the mesh.
    pub evaluations: usize,
    /// E.
    pub energy: f64,
    /// λ of each wanted volume: the pressure that keeps it, `dE/dV`. 0 for those that follow from others.
    pub pressures: Vec<f64>,
    /// As in [`ElasticStep`].
    pub residual: f64,
    /// What happened on each level of HML's method.
    pub levels: Vec<LevelReport>,
}

/// A settled body.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// Where the nodes are (#nodes × 3). What is held has its bits.
    pub places: Vec<DVec3>,
    /// The last correction. Its displacement is what it added; its vertices are those of the body (#vertices × 3).
    pub correction: Correction,
}

/// A body with nodes that settle.
pub struct Elastic<'a> {
    mesh: MeshMeasure<'a>,
    springs: &'a Springs,
    corrector: Corrector<'a>,
    wanted: ElasticWanted,
    is_free: Vec<BVec3>,
    solver: ElasticSolver,
    form: Option<FormMeasure>,
    /// A body that stands for a large one.
    coarse: Option<MeshMeasure<'static>>,
    matrix: Matrix,
    targets: Vec<f64>,
    scales: Vec<f64>,
    points: Vec<PointCondition>,
    extent: f64,
    /// Relative to `origin`.
    places: Vec<DVec3>,
    origin: DVec3,
    levels: Vec<MeshMeasure<'a>>,
}

/// The matrix of Newton's method.
struct Matrix {
    pattern: BlockPattern,
    kkt: Kkt,
}

impl Matrix {
    fn new(neighbours: Neighbours, is_free: &[BVec3]) -> Result<Self, ElasticError> {
        let too_large = || ElasticError::TooLarge { nodes: is_free.len() };
        let pattern = BlockPattern::new(neighbours, is_free).ok_or_else(too_large)?;
        let kkt = Kkt::new(&pattern).ok_or_else(too_large)?;
        Ok(Self { pattern, kkt })
    }
}

/// Nodes of a form at most, where its set-up pays for many runs. More: it takes seconds for a large mesh; fewer: steps that could take
/// microseconds take milliseconds.
const MOST_NODES: usize = 40;

/// The same where it must pay in one run: as many evaluations of the mesh as a run needs.
const MOST_NODES_ONCE: usize = 24;

/// Steps of Newton's method at most. Ordinary poses take 5 to 15, strongly bent ones some tens.
const STEPS: usize = 500;

/// Evaluations of a large mesh at most, while a coarse one stands for it.
const ROUNDS: usize = 20;

/// How much nearer than the fine mesh is the coarse one is searched. More: fine evaluations are wasted; less: coarse ones are.
const BEYOND: f64 = 1e-2;

impl<'a> Elastic<'a> {
    /// A body whose nodes are at `places` (#nodes × 3), for many runs: nodes can be moved.
    ///
    /// # Errors
    ///
    /// Arrays that do not fit together, values out of range, a request that contradicts itself; no node that may move.
    pub fn new(
        model: &ElasticModel<'a>,
        places: &[DVec3],
        wanted: &ElasticWanted,
        options: &ElasticOptions,
    ) -> Result<Self, ElasticError> {
        Self::prepared(model, places, wanted, options, false)
    }

    /// The same for one run: nodes that are held do not move any more.
    pub(crate) fn prepared(
        model: &ElasticModel<'a>,
        places: &[DVec3],
        wanted: &ElasticWanted,
        options: &ElasticOptions,
        is_once: bool,
    ) -> Result<Self, ElasticError> {
        let &ElasticModel { solid, binding, points, rest, springs } = model;
        let nodes = binding.control_count();
        for (what, found, expected) in [
            ("the vertices at rest", points.len(), solid.vertex_count()),
            ("the nodes at rest", rest.len(), nodes),
            ("the places of the nodes", places.len(), nodes),
            ("the nodes of the springs", springs.node_count(), nodes),
            ("the coordinates that may move", options.is_free.as_ref().map_or(nodes, Vec::len), nodes),
        ] {
            if found != expected {
                return Err(CorrectError::Length { what, found, expected }.into());
            }
        }
        if let Some((node, place)) = places.iter().enumerate().find(|(_, place)| !place.is_finite()) {
            return Err(ElasticError::NotFinite { node, place: *place });
        }
        let is_free = options.is_free.clone().unwrap_or_else(|| vec![BVec3::TRUE; nodes]);
        if !is_free.iter().any(|free| free.any()) {
            return Err(ElasticError::Held);
        }
        let mobility = is_free.iter().map(|free| DVec3::select(*free, DVec3::ONE, DVec3::ZERO)).collect();
        let correct_options = CorrectOptions { method: Method::Gradient, mobility: Some(mobility), energy: None };
        let corrector = Corrector::borrowed(solid, binding, &correct_options)?;

        let origin = Bounds::of(points).map_or(DVec3::ZERO, |bounds| bounds.lossless_origin());
        let near = |vectors: &'a [DVec3]| match origin {
            DVec3::ZERO => Cow::Borrowed(vectors),
            _ => Cow::Owned(translated(vectors, -origin)),
        };
        let goals = goals_of(wanted, &corrector, || points.to_vec())?.of(solid);
        let with_inertia = wanted.moments.is_some_and(|moments| moments.inertia.is_some());
        let moments = wanted.moments.map(|_| combinations(with_inertia)).unwrap_or_default();
        let about = wanted.moments.map_or(DVec3::ZERO, |moments| moments.center - origin);
        let numbers = Numbers { goals, moments, about };
        let mesh = MeshMeasure::new(Cow::Borrowed(solid), Cow::Borrowed(binding), near(points), near(rest), numbers);
        let places = translated(places, -origin);
        let extent = Bounds::of(points).map_or(0.0, |bounds| bounds.extent());

        let free_nodes: Vec<usize> = (0..nodes).filter(|node| is_free[*node].any()).collect();
        let of_form = if is_once { free_nodes } else { (0..nodes).collect() };
        let is_small = of_form.len() <= if is_once { MOST_NODES_ONCE } else { MOST_NODES };
        let has_form = match options.evaluation {
            Evaluation::Auto => is_small,
            Evaluation::Form => true,
            Evaluation::Mesh => false,
        } && mesh.numbers.moments.is_empty()
            && options.solver == ElasticSolver::Newton;
        let form = has_form.then(|| FormMeasure::of(&mesh, of_form, &places));
        let coarse =
            (form.is_none() && options.evaluation == Evaluation::Auto && options.solver == ElasticSolver::Newton)
                .then(|| Coarse::of(solid, binding, &mesh.points))
                .flatten()
                .map(|Coarse { solid, binding, posed }| {
                    let rest = Cow::Owned(mesh.rest.to_vec());
                    let numbers = Numbers { goals: mesh.numbers.goals.clone().of(&solid), ..mesh.numbers.clone() };
                    MeshMeasure::new(Cow::Owned(solid), Cow::Owned(binding), Cow::Owned(posed.to_vec()), rest, numbers)
                });
        let neighbours = match options.solver {
            ElasticSolver::Newton => searched(form.as_ref(), coarse.as_ref(), &mesh).neighbours(),
            // No second derivatives, but a number for each coordinate.
            ElasticSolver::AugmentedLagrangian(_) => Neighbours { size: binding.size(), reach: [0; 3] },
        };
        let matrix = Matrix::new(neighbours, &is_free)?;
        let mut elastic = Self {
            mesh,
            springs,
            corrector,
            wanted: ElasticWanted::default(),
            is_free,
            solver: options.solver,
            form,
            coarse,
            matrix,
            targets: Vec::new(),
            scales: Vec::new(),
            points: Vec::new(),
            extent,
            places,
            origin,
            levels: Vec::new(),
        };
        elastic.set_wanted(wanted.clone())?;
        Ok(elastic)
    }

    /// Bodies that stand for this one, the coarsest first, for [`ElasticSolver::AugmentedLagrangian`]: each as a model of its own over the same
    /// nodes.
    ///
    /// # Errors
    ///
    /// Arrays that do not fit together.
    pub fn with_levels(mut self, levels: &[ElasticModel<'a>]) -> Result<Self, ElasticError> {
        for level in levels {
            for (what, found, expected) in [
                ("the vertices of a level", level.points.len(), level.solid.vertex_count()),
                ("the binding of a level", level.binding.vertex_count(), level.solid.vertex_count()),
                ("the nodes of a level", level.binding.control_count(), self.places.len()),
                ("the components of a level", level.solid.component_count(), self.mesh.solid.component_count()),
            ] {
                if found != expected {
                    return Err(CorrectError::Length { what, found, expected }.into());
                }
            }
            let numbers =
                Numbers { goals: self.mesh.numbers.goals.clone().of(level.solid), ..self.mesh.numbers.clone() };
            let points = translated(level.points, -self.origin);
            let (solid, binding) = (Cow::Borrowed(level.solid), Cow::Borrowed(level.binding));
            self.levels.push(MeshMeasure::new(solid, binding, Cow::Owned(points), self.mesh.rest.clone(), numbers));
        }
        Ok(self)
    }

    /// Where the nodes are (#nodes × 3).
    #[must_use]
    pub fn places(&self) -> Vec<DVec3> {
        translated(&self.places, self.origin)
    }

    /// Where volumes come from: "form" (of the nodes), "mesh", or "coarse" (a coarse mesh that is tilted to the fine one).
    #[must_use]
    pub fn evaluation(&self) -> &'static str {
        match (&self.form, &self.coarse) {
            (Some(_), _) => "form",
            (None, Some(_)) => "coarse",
            (None, None) => "mesh",
        }
    }

    /// Puts nodes where they are wanted: handles that a user drags, or any other. What is held stays there; what is free starts from there.
    ///
    /// # Errors
    ///
    /// A node that does not exist, a place that is not finite.
    pub fn move_nodes(&mut self, nodes: &[(usize, DVec3)]) -> Result<(), ElasticError> {
        for &(node, place) in nodes {
            if node >= self.places.len() {
                let (what, expected) = ("a node that is moved", self.places.len());
                return Err(CorrectError::Length { what, found: node, expected }.into());
            }
            if !place.is_finite() {
                return Err(ElasticError::NotFinite { node, place });
            }
        }
        nodes.iter().for_each(|(node, place)| self.places[*node] = *place - self.origin);
        Ok(())
    }

    /// Changes what must hold: how much, and which points. Whose volumes and which moments are wanted stays as it was.
    ///
    /// # Errors
    ///
    /// A request that contradicts itself or is not what can be wanted; volumes of other components, or other moments.
    pub fn set_wanted(&mut self, wanted: ElasticWanted) -> Result<(), ElasticError> {
        check_points(&wanted.points, self.corrector.control_count())?;
        let goals = goals_of(&wanted, &self.corrector, || translated(&self.mesh.points, self.origin))?;
        let with_inertia = wanted.moments.is_some_and(|moments| moments.inertia.is_some());
        let moments = wanted.moments.map_or(0, |_| combinations(with_inertia).len());
        if !goals.are_of_the_same(&self.mesh.numbers.goals) || moments != self.mesh.numbers.moments.len() {
            return Err(ElasticError::Changed);
        }
        let mut targets = goals.targets;
        let mut scales: Vec<f64> = targets.iter().map(|target| target.abs()).collect();
        if let Some(MomentTargets { center, inertia }) = wanted.moments {
            let about = center - self.origin;
            self.mesh.numbers.about = about;
            self.coarse.iter_mut().for_each(|coarse| coarse.numbers.about = about);
            self.levels.iter_mut().for_each(|level| level.numbers.about = about);
            let volume = self.mesh.solid.volume(&self.mesh.points);
            let half_trace = |i: DMat3| (0..3).map(|a| i.col(a)[a]).sum::<f64>() / 2.0;
            let second = inertia.map_or(DMat3::ZERO, |i| DMat3::from_diagonal(DVec3::splat(half_trace(i))) - i);
            let is_finite = center.is_finite() && (0..3).all(|a| second.col(a).is_finite());
            if !is_finite || self.mesh.solid.encloses_nothing(&self.mesh.points, volume) {
                return Err(ElasticError::Moments);
            }
            let wanted = Moments { volume, first: DVec3::ZERO, second };
            for combination in &self.mesh.numbers.moments {
                targets.push(wanted.of_combination(combination));
                let degree = if combination.first == DVec3::ZERO { 2 } else { 1 };
                scales.push(volume.abs() * self.extent.powi(degree));
            }
        }
        let condition = |point: &PointTarget| {
            let at_rest: DVec3 = point.weights.iter().map(|(node, w)| *w * self.mesh.rest[*node]).sum();
            PointCondition { weights: point.weights.clone(), sum: point.target - point.position + at_rest }
        };
        self.points = wanted.points.iter().map(condition).collect();
        (self.targets, self.scales, self.wanted) = (targets, scales, wanted);
        Ok(())
    }

    /// Settles, from where the nodes are. `on_step` sees each step and says whether to go on; after `time` it stops by itself.
    ///
    /// Where it stops, nodes are on their way: [`Elastic::settled`] gives an exact pose there too, and another run goes on.
    ///
    /// # Errors
    ///
    /// No pose with all that is wanted, with the reason. The nodes are then where they were.
    pub fn run(
        &mut self,
        time: Option<Duration>,
        on_step: &mut dyn FnMut(&ElasticStep) -> bool,
    ) -> Result<ElasticState, ElasticError> {
        let clock = Clock::start(time);
        let before = self.mesh.surveys();
        let mut steps = 0;
        let origin = self.origin;
        let mut each = |pose: &Pose| {
            steps += 1;
            let places = translated(&pose.places, origin);
            let step = ElasticStep { step: steps, places, energy: pose.energy, residual: pose.residual };
            on_step(&step) && !clock.is_over()
        };
        let conditions = Conditions {
            measure: searched(self.form.as_ref(), self.coarse.as_ref(), &self.mesh),
            targets: &self.targets,
            scales: &self.scales,
            points: &self.points,
            extent: self.extent,
        };
        let search = Search { conditions, springs: self.springs, pattern: &self.matrix.pattern };
        let mut levels = Vec::new();
        let (pose, status) = if let ElasticSolver::AugmentedLagrangian(options) = self.solver {
            let (pose, reports, status) =
                augmented::settle(&self.levels, &search, &self.mesh, &self.places, &options, &mut each);
            levels = reports;
            levels.iter_mut().for_each(|level| level.places = translated(&level.places, origin));
            (pose, status)
        } else {
            let found = match (&self.form, &self.coarse) {
                (None, Some(coarse)) => {
                    by_levels(&search, &self.mesh, coarse, &self.places, &mut self.matrix.kkt, &mut each)
                }
                _ => search
                    .first(&self.places)
                    .map(|first| search.settle(first, &mut self.matrix.kkt, tolerances::BALANCE, STEPS, &mut each))
                    .map(|(pose, ended)| (pose, Some(ended))),
            };
            let (pose, ended) = match found {
                Some((pose, Some(ended))) => (pose, ended),
                Some((pose, None)) => {
                    // The coarse mesh has led as far as it can: the fine one must do the rest.
                    let mut matrix = Matrix::new(self.mesh.neighbours(), &self.is_free)?;
                    let search = Search {
                        conditions: Conditions { measure: &self.mesh, ..search.conditions },
                        pattern: &matrix.pattern,
                        ..search
                    };
                    let first = search.first(&pose.places).ok_or_else(|| self.reason())?;
                    search.settle(first, &mut matrix.kkt, tolerances::BALANCE, STEPS, &mut each)
                }
                None => return Err(self.reason()),
            };
            let status = match ended {
                Ended::Balanced => ElasticStatus::Settled,
                Ended::Stuck => ElasticStatus::Stuck,
                Ended::Limit => ElasticStatus::StepLimit,
                Ended::Stopped => ElasticStatus::Stopped,
            };
            (pose, status)
        };
        let mut pressures = vec![0.0; self.wanted.volumes.len()];
        let of_numbers = &pose.multipliers[3 * self.points.len()..];
        self.mesh.numbers.goals.index.iter().zip(of_numbers).for_each(|(index, l)| pressures[*index] = *l);
        self.places.clone_from(&pose.places);
        Ok(ElasticState {
            status,
            steps,
            evaluations: self.mesh.surveys() - before,
            energy: pose.energy,
            pressures,
            residual: pose.residual,
            levels,
        })
    }

    /// Why there is no pose with all that is wanted: what a correction says.
    fn reason(&self) -> ElasticError {
        match self.corrected() {
            Err(error) => error,
            Ok(_) => ElasticError::NoPose,
        }
    }

    /// The body as it is now, corrected exactly over the free coordinates.
    ///
    /// # Errors
    ///
    /// As [`crate::correct`].
    pub fn settled(&self) -> Result<Settled, ElasticError> {
        let correction = self.corrected()?;
        let add = |(place, by): (&DVec3, &DVec3)| if *by == DVec3::ZERO { *place } else { *place + *by };
        let places: Vec<DVec3> = self.places.iter().zip(&correction.displacement).map(add).collect();
        Ok(Settled { places: translated(&places, self.origin), correction })
    }

    fn corrected(&self) -> Result<Correction, ElasticError> {
        let vertices = self.mesh.vertices(&self.places);
        let moved = |point: &PointTarget| {
            let by: DVec3 =
                point.weights.iter().map(|(node, w)| *w * (self.places[*node] - self.mesh.rest[*node])).sum();
            PointTarget {
                position: point.position - self.origin + by,
                target: point.target - self.origin,
                weights: point.weights.clone(),
            }
        };
        let wanted = plain(&self.wanted, self.wanted.points.iter().map(moved).collect());
        let mut correction = self.corrector.correct(&vertices, &wanted)?;
        if self.origin != DVec3::ZERO {
            correction.vertices = translated(&correction.vertices, self.origin);
        }
        Ok(correction)
    }
}

/// Settles nodes once, from `places` (#nodes × 3), and corrects exactly.
///
/// # Errors
///
/// As [`Elastic::new`], [`Elastic::run`] and [`Elastic::settled`].
pub fn relaxed(
    model: &ElasticModel,
    places: &[DVec3],
    wanted: &ElasticWanted,
    options: &ElasticOptions,
) -> Result<(ElasticState, Settled), ElasticError> {
    let mut elastic = Elastic::prepared(model, places, wanted, options, true)?;
    let state = elastic.run(None, &mut |_| true)?;
    Ok((state, elastic.settled()?))
}

/// What the search looks at.
fn searched<'b>(
    form: Option<&'b FormMeasure>,
    coarse: Option<&'b MeshMeasure<'static>>,
    mesh: &'b MeshMeasure,
) -> &'b dyn Measure {
    match (form, coarse) {
        (Some(form), _) => form,
        (None, Some(coarse)) => coarse,
        (None, None) => mesh,
    }
}

/// The volumes that are wanted, of a body that stands at `points()`.
fn goals_of(
    wanted: &ElasticWanted,
    corrector: &Corrector,
    points: impl FnOnce() -> Vec<DVec3>,
) -> Result<Goals, ElasticError> {
    Goals::new(&wanted.volumes, corrector.component_count()).map_err(|_| {
        // A correction names what is wrong with them.
        corrector.problem(&points(), &plain(wanted, Vec::new())).err().map_or(ElasticError::NoPose, Into::into)
    })
}

/// A correction's part of what is wanted, with these points.
fn plain(wanted: &ElasticWanted, points: Vec<PointTarget>) -> Wanted {
    Wanted { volumes: wanted.volumes.clone(), points }
}

/// Settles a large mesh by a coarse one that stands for it, as far as that leads; without an end where that is not far enough.
fn by_levels(
    search: &Search,
    mesh: &MeshMeasure,
    coarse: &MeshMeasure,
    places: &[DVec3],
    kkt: &mut Kkt,
    on_step: &mut dyn FnMut(&Pose) -> bool,
) -> Option<(Pose, Option<Ended>)> {
    let mut survey = mesh.survey(places);
    let mut best = search.surveyed(places.to_vec(), &survey);
    let mut missing = f64::INFINITY;
    for _ in 0..ROUNDS {
        let tilted = Tilted::to(coarse, &best.places, &survey);
        let tilted = Search { conditions: Conditions { measure: &tilted, ..search.conditions }, ..*search };
        let Some(first) = tilted.first(&best.places) else { break };
        let enough = (BEYOND * missing).clamp(tolerances::BALANCE, BEYOND);
        let (found, ended) = tilted.settle(first, kkt, enough, STEPS, on_step);
        survey = mesh.survey(&found.places);
        let next = search.surveyed(found.places, &survey);
        if ended == Ended::Stopped {
            return Some((next, Some(ended)));
        }
        let still_missing = next.residual.max(search.conditions.error_of(&next));
        let is_nearer = still_missing <= 0.5 * missing;
        if !is_nearer {
            break;
        }
        (best, missing) = (next, still_missing);
        if missing <= tolerances::BALANCE_ENOUGH {
            // Volumes and points are corrected exactly at last, moments here.
            let fine = Search { conditions: Conditions { measure: mesh, ..search.conditions }, ..*search };
            let has_moments = !mesh.numbers.moments.is_empty();
            let end = if has_moments { fine.first(&best.places) } else { Some(best) };
            return end.map(|pose| (pose, Some(Ended::Balanced)));
        }
    }
    Some((best, None))
}

/// How long something has taken; nothing where the platform has no clock (browsers).
pub(crate) struct Clock {
    #[cfg(not(target_family = "wasm"))]
    begin: std::time::Instant,
    #[cfg(not(target_family = "wasm"))]
    time: Option<Duration>,
}

impl Clock {
    /// Begins now.
    pub(crate) fn start(time: Option<Duration>) -> Self {
        #[cfg(target_family = "wasm")]
        let _ = time;
        Self {
            #[cfg(not(target_family = "wasm"))]
            begin: std::time::Instant::now(),
            #[cfg(not(target_family = "wasm"))]
            time,
        }
    }

    /// Whether `time` is over.
    fn is_over(&self) -> bool {
        #[cfg(not(target_family = "wasm"))]
        return self.time.is_some_and(|time| self.begin.elapsed() >= time);
        #[cfg(target_family = "wasm")]
        false
    }

    pub(crate) fn milliseconds(&self) -> f64 {
        #[cfg(not(target_family = "wasm"))]
        return self.begin.elapsed().as_secs_f64() * 1e3;
        #[cfg(target_family = "wasm")]
        0.0
    }
}
