//! A job's deformer and its controls: a lattice, made or from a file, or a cage.
//!
//! Everything here is relative to the job's origin, so that a model far from the origin of its file loses nothing.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::binding::{Binding, displaced, translated};
use crate::bspline::{Basis, BasisError};
use crate::cage::Cage;
use crate::cage_binding::{CageBinding, Coordinates};
use crate::cage_request::{CageInput, CageRequest, PosedCage};
use crate::job::{AxisKnots, BasisKind, KnotRule, LatticeRequest};
use crate::lattice::{Frame, Lattice, LatticeError, Outside};
use crate::mesh::Bounds;
use crate::outcome::{JobError, PosedLattice};
use crate::tolerances;

/// What carries a displacement of controls to vertices.
#[derive(Clone, Debug)]
pub(crate) enum Deformer {
    Lattice(Box<Lattice>, Outside),
    Cage(Arc<CageBinding>),
}

impl Deformer {
    /// W for the job's vertices; a cage has it already.
    pub(crate) fn binding(&self, points: &[DVec3], is_portable: bool) -> Result<Binding, LatticeError> {
        let binding = match self {
            Self::Lattice(lattice, outside) => lattice.bind(points, *outside)?,
            Self::Cage(cage) => cage.binding().clone(),
        };
        Ok(if is_portable { binding.portable() } else { binding })
    }

    /// Control points along u, v, w, as in [`crate::ControlSpace`].
    pub(crate) fn size(&self) -> [usize; 3] {
        match self {
            Self::Lattice(lattice, _) => lattice.size(),
            Self::Cage(cage) => [1, 1, cage.cage().vertices().len()],
        }
    }

    /// The box of the controls at rest.
    pub(crate) fn bounds(&self) -> Bounds {
        match self {
            Self::Lattice(lattice, _) => lattice.frame().bounds(),
            Self::Cage(cage) => cage.cage().mesh().bounds().expect("a cage has vertices"),
        }
    }

    /// The lattice, where it is one.
    pub(crate) fn lattice(&self) -> Option<(&Lattice, Outside)> {
        match self {
            Self::Lattice(lattice, outside) => Some((lattice, *outside)),
            Self::Cage(_) => None,
        }
    }

    /// The cage, where it is one.
    pub(crate) fn cage(&self) -> Option<&CageBinding> {
        match self {
            Self::Lattice(..) => None,
            Self::Cage(cage) => Some(cage),
        }
    }

    /// Whether vertices are an affine function of the controls.
    pub(crate) fn is_linear(&self) -> bool {
        self.cage().is_none_or(|cage| cage.coordinates() != Coordinates::Green)
    }

    /// What W is applied to, for controls displaced by `displacement` (#controls × 3) from `rest`.
    pub(crate) fn spread<'a>(&self, rest: &[DVec3], displacement: &'a [DVec3]) -> Cow<'a, [DVec3]> {
        match self.cage() {
            Some(cage) if !self.is_linear() => cage.displacement(&displaced(rest, displacement)).into(),
            _ => displacement.into(),
        }
    }

    /// Jacobian matrices at `points`, for controls displaced by `displacement` (#controls × 3) from `rest`. `None` where a cage is too thin for
    /// the grid of harmonic coordinates that were loaded.
    pub(crate) fn jacobians(&self, points: &[DVec3], rest: &[DVec3], displacement: &[DVec3]) -> Option<Vec<DMat3>> {
        match self {
            Self::Lattice(lattice, outside) => Some(lattice.jacobians(points, displacement, *outside)),
            Self::Cage(cage) => cage.jacobians(points, &displaced(rest, displacement)).ok(),
        }
    }
}

/// A deformer and its controls, relative to the job's origin.
pub(crate) struct Controls {
    pub(crate) deformer: Deformer,
    pub(crate) rest: Vec<DVec3>,
    pub(crate) posed: Vec<DVec3>,
    pub(crate) mobility: Option<Vec<DVec3>>,
    /// The file of the lattice or the cage, if there is one: model coordinates that did not change come back with their bits.
    file: Option<Saved>,
}

/// Controls in model coordinates.
pub(crate) enum Saved {
    Lattice(Box<PosedLattice>),
    Cage(PosedCage),
}

impl Controls {
    fn at_rest(lattice: Lattice, outside: Outside) -> Self {
        let rest = lattice.rest();
        Self {
            deformer: Deformer::Lattice(Box::new(lattice), outside),
            posed: rest.clone(),
            rest,
            mobility: None,
            file: None,
        }
    }

    pub(crate) fn of_cage(
        request: &CageRequest,
        input: &CageInput,
        points: &[DVec3],
        origin: DVec3,
        warnings: &mut Vec<String>,
    ) -> Result<Self, JobError> {
        let options = request.options();
        let cage = Cage::new(input.mesh.clone())?.moved(-origin)?;
        let vertices = cage.vertices().len();
        if let Some(posed) = input.posed.as_ref().filter(|posed| posed.len() != vertices) {
            let problem =
                format!("has {} vertices, but the cage has {vertices}; they must correspond in order", posed.len());
            return Err(JobError::Value { key: "cage.posed", problem });
        }
        let bound = match &input.weights {
            None => cage.bind(points, &options)?,
            Some(weights) => CageBinding::of_weights(&cage, points, &options, weights)?,
        };
        let report = bound.report();
        if report.outside > 0 {
            let what = match options.outside {
                Outside::Keep => "they stay where they are",
                _ => match options.coordinates {
                    Coordinates::MeanValue | Coordinates::Tetrahedral => {
                        "their coordinates are those of the same formula"
                    }
                    Coordinates::Harmonic => "they have mean value coordinates",
                    Coordinates::Green => "their coordinates are continued through the closest face",
                },
            };
            warnings.push(format!(
                "{} of {} vertices are outside the cage, by up to {:.3e}; {what}.",
                report.outside,
                points.len(),
                report.farthest
            ));
        }
        if report.lebesgue_constant > tolerances::LEBESGUE_CONSTANT {
            warnings.push(format!(
                "Vertex {} can go {:.0} times as far as the cage's vertices, so great are its coordinates, as where a cage crosses itself or the model. \
                 Mend it, or choose coordinates = \"harmonic\" or objective = \"surface\".",
                report.lebesgue_vertex, report.lebesgue_constant
            ));
        }
        let rest = cage.vertices().to_vec();
        let in_file = blended(input.mesh.points(), input.posed.as_deref(), request.blend)?;
        let posed = in_file.iter().map(|p| *p - origin).collect();
        let file = PosedCage { mesh: input.mesh.clone(), posed: in_file };
        Ok(Self {
            deformer: Deformer::Cage(Arc::new(bound)),
            rest,
            posed,
            mobility: None,
            file: Some(Saved::Cage(file)),
        })
    }

    pub(crate) fn of_file(
        request: &LatticeRequest,
        file: &PosedLattice,
        origin: DVec3,
        warnings: &mut Vec<String>,
    ) -> Result<Self, JobError> {
        let LatticeRequest { basis, degree, knots, size, fit, margin, origin: corner, axes, file: _, outside } =
            request;
        let given = [
            ("lattice.basis", basis.is_some()),
            ("lattice.degree", degree.is_some()),
            ("lattice.knots", knots.is_some()),
            ("lattice.size", size.is_some()),
            ("lattice.fit", fit.is_some()),
            ("lattice.margin", margin.is_some()),
            ("lattice.origin", corner.is_some()),
            ("lattice.axes", axes.is_some()),
        ];
        if let Some((key, _)) = given.into_iter().find(|(_, given)| *given) {
            let problem = "cannot be combined with lattice.file, which says it already".into();
            return Err(JobError::Value { key, problem });
        }
        let lattice = Lattice::new(file.lattice.bases().clone(), file.lattice.frame().moved(-origin))?;
        let near = |positions: &[DVec3]| positions.iter().map(|p| *p - origin).collect::<Vec<_>>();
        let greville = file.lattice.rest();
        let apart = file.rest.iter().zip(&greville).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        if apart > tolerances::INSIDE * lattice.frame().extent() {
            warnings.push(format!(
                "The rest positions of the lattice file are up to {apart:.3e} away from those that reproduce the model; only \
                 the difference between rest and posed deforms it."
            ));
        }
        Ok(Self {
            deformer: Deformer::Lattice(Box::new(lattice), *outside),
            rest: near(&file.rest),
            posed: near(&file.posed),
            mobility: file.mobility.clone(),
            file: Some(Saved::Lattice(Box::new(file.clone()))),
        })
    }

    pub(crate) fn made(
        request: &LatticeRequest,
        bounds: Bounds,
        origin: DVec3,
        warnings: &mut Vec<String>,
    ) -> Result<Self, JobError> {
        let bases = bases(request, warnings)?;
        let frame = match (request.origin, request.axes) {
            (Some(corner), Some(axes)) => {
                for (key, given) in
                    [("lattice.fit", request.fit.is_some()), ("lattice.margin", request.margin.is_some())]
                {
                    if given {
                        let problem = "cannot be combined with an explicit origin and axes".into();
                        return Err(JobError::Value { key, problem });
                    }
                }
                Frame { origin: corner - origin, axes }
            }
            (None, None) => {
                let sides = bounds.size();
                if sides.min_element() <= tolerances::FLAT_SIDE * bounds.extent() {
                    warnings.push("The model is flat, so its lattice is a tenth of the extent thick.".into());
                }
                let margin = request.margin.unwrap_or(0.0);
                if !margin.is_finite() {
                    let problem = format!("is {margin}: it must be a finite fraction of the extent");
                    return Err(JobError::Value { key: "lattice.margin", problem });
                }
                Frame::fitted(bounds, margin)?
            }
            (Some(_), None) => {
                let problem = "needs axes = [[…], […], […]] beside it, the edges of the frame".into();
                return Err(JobError::Value { key: "lattice.origin", problem });
            }
            (None, Some(_)) => {
                let problem = "needs origin = [x, y, z] beside it, the corner of the frame".into();
                return Err(JobError::Value { key: "lattice.axes", problem });
            }
        };
        Ok(Self::at_rest(Lattice::new(bases, frame)?, request.outside))
    }

    /// The controls with `posed` instead of their pose, in model coordinates.
    pub(crate) fn in_model_coordinates(&self, posed: &[DVec3], origin: DVec3) -> Result<Saved, JobError> {
        let far = |positions: &[DVec3]| translated(positions, origin);
        // What did not move has the bits of the file.
        let moved = |file: &[DVec3]| -> Vec<DVec3> {
            let unmoved = |i: usize, a: usize| posed[i][a] == self.posed[i][a];
            let coordinate = |i: usize, a: usize| if unmoved(i, a) { file[i][a] } else { posed[i][a] + origin[a] };
            (0..posed.len()).map(|i| DVec3::from_array([0, 1, 2].map(|a| coordinate(i, a)))).collect()
        };
        Ok(match (&self.file, &self.deformer) {
            (Some(Saved::Lattice(file)), _) => {
                Saved::Lattice(Box::new(PosedLattice { posed: moved(&file.posed), ..PosedLattice::clone(file) }))
            }
            (Some(Saved::Cage(file)), _) => Saved::Cage(PosedCage { posed: moved(&file.posed), ..file.clone() }),
            (None, Deformer::Lattice(lattice, _)) => {
                let lattice = Lattice::new(lattice.bases().clone(), lattice.frame().moved(origin))?;
                Saved::Lattice(Box::new(PosedLattice {
                    lattice,
                    rest: far(&self.rest),
                    posed: far(posed),
                    mobility: None,
                }))
            }
            (None, Deformer::Cage(_)) => unreachable!("a cage comes from a file"),
        })
    }
}

/// The bases that a request asks for.
fn bases(request: &LatticeRequest, warnings: &mut Vec<String>) -> Result<[Basis; 3], JobError> {
    /// Control points per axis for a newcomer: enough to bend and twist, few enough to grasp.
    const SIZE: usize = 6;
    /// Cubic: curvature is continuous.
    const DEGREE: usize = 3;
    let is_bernstein = request.basis == Some(BasisKind::Bernstein);
    if is_bernstein && (request.degree.is_some() || request.knots.is_some()) {
        warnings
            .push("Degree and knots belong to B-splines; a Bernstein basis has degree size − 1 and needs none.".into());
    }
    let degree = request.degree.map_or([DEGREE; 3], |d| d.each());
    let size = request.size.map(|s| s.each());
    let knots = request.knots.clone().unwrap_or_default().each();
    let mut bases = Vec::with_capacity(3);
    for (a, (axis, knots)) in ['u', 'v', 'w'].into_iter().zip(knots).enumerate() {
        let size_or_default = size.map_or(SIZE, |size| size[a]);
        let basis = match knots {
            _ if is_bernstein => Basis::bernstein(size_or_default),
            AxisKnots::Explicit(knots) => {
                let basis = Basis::with_knots(knots, degree[a]);
                if let (Ok(basis), Some(size)) = (&basis, size)
                    && basis.size() != size[a]
                {
                    let problem =
                        format!("along {axis} makes {} control points, but size says {}", basis.size(), size[a]);
                    return Err(JobError::Value { key: "lattice.knots", problem });
                }
                basis
            }
            AxisKnots::Rule(rule) => {
                let most = size_or_default.saturating_sub(1).max(1);
                if degree[a] > most {
                    warnings
                        .push(format!("Along {axis}, {size_or_default} control points lower the degree to {most}."));
                }
                let made = match rule {
                    KnotRule::Clamped => Basis::clamped,
                    KnotRule::Uniform => Basis::uniform,
                };
                made(size_or_default, degree[a].min(most))
            }
        };
        bases.push(basis.map_err(|source: BasisError| LatticeError::Basis { axis, source })?);
    }
    Ok(bases.try_into().expect("three axes"))
}

/// The vertices of a cage so far on their way from rest to their pose (each #vertices × 3).
fn blended(rest: &[DVec3], posed: Option<&[DVec3]>, blend: Option<f64>) -> Result<Vec<DVec3>, JobError> {
    let refused = |problem: String| Err(JobError::Value { key: "cage.blend", problem });
    match (posed, blend) {
        (None, Some(_)) => refused("is a part of the way to a posed cage: name one with cage.posed".into()),
        (_, Some(blend)) if !blend.is_finite() => refused(format!("is {blend}: it must be finite")),
        (None, None) => Ok(rest.to_vec()),
        (Some(posed), None | Some(1.0)) => Ok(posed.to_vec()),
        (Some(posed), Some(blend)) => Ok(rest.iter().zip(posed).map(|(r, p)| *r + (*p - *r) * blend).collect()),
    }
}
