//! The method "elastic" of a job: from what is asked to nodes that have settled.

use glam::{DMat3, DVec3};

use crate::augmented::Augmented;
use crate::binding::Binding;
use crate::elastic::{
    Elastic, ElasticModel, ElasticOptions, ElasticSolver, ElasticState, ElasticStatus, ElasticWanted, Evaluation,
    MomentTargets, Settled,
};
use crate::elastic_request::{
    CenterOfMass, ElasticRequest, ElasticSolverKind, Hold, Inertia, LevelCount, free_coordinates,
};
use crate::job::{Directions, Job, MethodKind, MobilityKind, Objective, Preserve};
use crate::lattice::Lattice;
use crate::levels::{LevelOptions, Levels};
use crate::moments::Moments;
use crate::outcome::{JobError, NetDrawing, NetKind};
use crate::report::ElasticReport;
use crate::select::{ControlSpace, Selector};
use crate::springs::Springs;
use crate::volume::Solid;

/// What settles, in coordinates near the model.
pub(crate) struct ElasticTask<'a> {
    pub(crate) request: &'a ElasticRequest,
    pub(crate) lattice: &'a Lattice,
    pub(crate) solid: &'a Solid,
    pub(crate) binding: &'a Binding,
    /// The vertices and nodes at rest.
    pub(crate) points: &'a [DVec3],
    pub(crate) rest: &'a [DVec3],
    /// Where the edits put the nodes, and which they moved.
    pub(crate) posed: &'a [DVec3],
    pub(crate) is_edited: &'a [bool],
    /// Mobilities of the lattice file, and the axes along which nodes may move.
    pub(crate) mobility: Option<&'a [DVec3]>,
    pub(crate) along: DVec3,
    pub(crate) pin: Option<&'a Selector>,
    pub(crate) space: &'a ControlSpace<'a>,
}

impl Job {
    /// The section `[elastic]` where the method is "elastic"; refuses keys that belong to other methods.
    pub(crate) fn elastic_request(&self) -> Result<Option<ElasticRequest>, JobError> {
        let refused = |key, problem: &str| Err(JobError::Value { key, problem: problem.into() });
        if self.preserve.method != Some(MethodKind::Elastic) {
            return match &self.elastic {
                Some(_) => refused(
                    "elastic",
                    "is for the method \"elastic\": add preserve.method = \"elastic\", or leave it out",
                ),
                None => Ok(None),
            };
        }
        let Preserve { axes, shares, objective, mobility, falloff, preview, .. } = &self.preserve;
        let request = self.elastic.clone().unwrap_or_default();
        if shares.is_some() {
            return refused("preserve.shares", "are for the method \"axes\": the springs decide how nodes move");
        }
        if let Some(Directions::Vectors(_)) = axes {
            return refused(
                "preserve.axes",
                "takes letters with the method \"elastic\", such as \"xy\": along these nodes may move",
            );
        }
        if *objective != Objective::Controls {
            return refused(
                "preserve.objective",
                "is the energy of the springs with the method \"elastic\"; leave it out",
            );
        }
        if *mobility != MobilityKind::Uniform {
            return refused(
                "preserve.mobility",
                "is all or nothing with the method \"elastic\": hold nodes, or leave it out",
            );
        }
        if falloff.is_some() {
            return refused("preserve.falloff", "is for other methods than \"elastic\": hold nodes instead");
        }
        if preview.is_some() {
            return refused(
                "preserve.preview",
                "is for other methods than \"elastic\", which makes its own coarse meshes; leave it out",
            );
        }
        if self.portable_bits {
            return refused(
                "portable_bits",
                "is for other methods than \"elastic\", whose linear algebra rounds as the processor likes",
            );
        }
        if request.solver == ElasticSolverKind::Newton && matches!(request.levels, LevelCount::AtMost(2..)) {
            return refused(
                "elastic.levels",
                "is \"auto\" or 1 with the solver \"newton\"; more are for \"augmented-lagrangian\"",
            );
        }
        Ok(Some(request))
    }
}

impl ElasticTask<'_> {
    /// Which nodes are held.
    fn held(&self) -> Result<Vec<bool>, JobError> {
        /// A node whose weight in a selector is less than this is not picked.
        const PICKED: f64 = 0.5;
        let picked = |selector: &Selector, error: fn(_) -> JobError| -> Result<Vec<bool>, JobError> {
            Ok(selector.weights(self.space).map_err(error)?.iter().map(|weight| *weight >= PICKED).collect())
        };
        let mut is_held = match &self.request.hold {
            Hold::Edited => self.is_edited.to_vec(),
            Hold::Nodes(selector) => picked(selector, JobError::Hold)?,
        };
        if let Some(pin) = self.pin {
            is_held.iter_mut().zip(picked(pin, JobError::Pin)?).for_each(|(held, pinned)| *held |= pinned);
        }
        if let Some(continuity) = self.request.continuity {
            let border = continuity.border(self.lattice);
            if let Some(node) = (0..border.len()).find(|node| border[*node] && self.posed[*node] != self.rest[*node]) {
                let [i, j, k] = self.lattice.node(node);
                let problem = format!(
                    "keeps the nodes at the border of the lattice at rest, but node ({i}, {j}, {k}) has been moved"
                );
                return Err(JobError::Value { key: "elastic.continuity", problem });
            }
            is_held.iter_mut().zip(border).for_each(|(held, border)| *held |= border);
        }
        Ok(is_held)
    }

    /// The centre of mass and the inertia tensor that are wanted.
    fn moments(&self, origin: DVec3) -> Option<MomentTargets> {
        let ElasticRequest { center_of_mass, inertia, .. } = self.request;
        if center_of_mass.is_none() && inertia.is_none() {
            return None;
        }
        let at_rest = MomentTargets::of(self.solid, self.points, true);
        Some(MomentTargets {
            center: match center_of_mass {
                Some(CenterOfMass::At(center)) => *center - origin,
                Some(CenterOfMass::Keep) | None => at_rest.center,
            },
            inertia: match inertia {
                Some(Inertia::Tensor(tensor)) => Some(*tensor),
                Some(Inertia::Keep) => at_rest.inertia,
                None => None,
            },
        })
    }

    /// Lets the nodes settle. `wanted` has the volumes and points; `origin` is where coordinates here begin.
    pub(crate) fn settled(
        &self,
        mut wanted: ElasticWanted,
        origin: DVec3,
    ) -> Result<(Settled, ElasticReport, NetDrawing), JobError> {
        let &Self { request, solid, binding, points, rest, posed, .. } = self;
        let springs = Springs::between(self.lattice.size(), rest, request.net, request.stiffness)
            .map_err(|error| JobError::Value { key: "elastic.stiffness", problem: format!("cannot be: {error}") })?;
        let is_free = free_coordinates(&self.held()?, self.along, self.mobility);
        let free = is_free.iter().filter(|free| free.any()).count();
        let drawing = NetDrawing {
            kind: NetKind::Springs,
            ends: springs.springs().iter().map(|spring| spring.ends).collect(),
            is_held: is_free.iter().map(|free| !free.any()).collect(),
        };
        wanted.moments = self.moments(origin);
        let is_newton = request.solver == ElasticSolverKind::Newton;
        let solver =
            if is_newton { ElasticSolver::Newton } else { ElasticSolver::AugmentedLagrangian(Augmented::default()) };
        let evaluation = if request.levels == LevelCount::AtMost(1) { Evaluation::Mesh } else { Evaluation::Auto };
        let options = ElasticOptions { is_free: Some(is_free), solver, evaluation };
        let model = ElasticModel { solid, binding, points, rest, springs: &springs };
        let levels = match request.levels {
            _ if is_newton => None,
            LevelCount::AtMost(1) => None,
            LevelCount::Auto | LevelCount::AtMost(_) => Some(Levels::of_mesh(solid, points, &LevelOptions::default())),
        };
        let most = match request.levels {
            LevelCount::AtMost(count) => count,
            LevelCount::Auto => usize::MAX,
        };
        let coarser = levels.iter().flat_map(|levels| levels.as_slice().iter().rev().skip(1).take(most - 1));
        let mut coarser: Vec<_> =
            coarser.filter_map(|level| Some((level, binding.rows_of(level.vertices.as_ref()?)))).collect();
        coarser.reverse();
        let models: Vec<ElasticModel> = coarser
            .iter()
            .map(|(level, rows)| ElasticModel { solid: &level.solid, binding: rows, points: &level.points, ..model })
            .collect();
        let elastic = Elastic::prepared(&model, posed, &wanted, &options, true)?;
        let mut elastic = elastic.with_levels(&models)?;
        let state = elastic.run(None, &mut |_| true)?;
        let settled = elastic.settled()?;
        let status = match state.status {
            ElasticStatus::Settled => "settled",
            ElasticStatus::Approximate => "approximate",
            ElasticStatus::Stuck | ElasticStatus::StepLimit | ElasticStatus::Stopped => {
                return Err(JobError::NotSettled { residual: state.residual, steps: state.steps });
            }
        };
        let evaluation = elastic.evaluation();
        let ElasticState { steps, evaluations, pressures, residual, levels, .. } = state;
        let report = ElasticReport {
            net: request.net.name().into(),
            solver: request.solver.name().into(),
            status: status.into(),
            evaluation: evaluation.into(),
            springs: springs.springs().len(),
            held: rest.len() - free,
            free,
            steps,
            evaluations,
            energy_posed: springs.energy(posed),
            energy: springs.energy(&settled.places),
            pressures,
            residual,
            center_of_mass: wanted.moments.map(|_| self.centers(&settled, origin)),
            inertia_error: wanted.moments.and_then(|moments| {
                let tensor = moments.inertia?;
                let found = Moments::of(solid, &settled.correction.vertices, moments.center).inertia();
                let largest = |m: DMat3| (0..3).map(|a| m.col(a).abs().max_element()).fold(0.0, f64::max);
                Some(largest(found - tensor) / largest(tensor))
            }),
            levels,
        };
        Ok((settled, report, drawing))
    }

    /// The centre of mass at rest, posed and settled, in model coordinates.
    fn centers(&self, settled: &Settled, origin: DVec3) -> [[f64; 3]; 3] {
        let by: Vec<DVec3> = self.posed.iter().zip(self.rest).map(|(c, at)| *c - *at).collect();
        let posed = self.binding.displaced(self.points, &by);
        [self.points, &posed, &settled.correction.vertices]
            .map(|points| (MomentTargets::of(self.solid, points, false).center + origin).to_array())
    }
}
