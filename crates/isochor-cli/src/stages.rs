//! What a correction consists of, stage by stage: how long each takes, and how many bytes it must touch at least once.
//!
//! The model is a [`isochor::shapes::stone`] in a lattice of uniform cubic B-splines that fits it tightly, twisted and squashed so that it
//! loses 40 % of its volume; corrections give that back. Stages up to [`Stage::Offsets`] work on vertices in the order of lattice cells,
//! as a prepared [`Corrector`] does inside; corrections, and moving the vertices by the lattice before them, in the order of the model.
//!
//! # Bytes
//!
//! Counted are arrays of the length of the model, each once however often a stage goes through it, as the structures say that they are:
//! W is [`Binding::memory`], S is [`Solid::memory`] (a byte for a vertex of it, whether it has a twin, is read by corrections alone), T
//! is 12 for each triangle, and n is the number of vertices. Positions and gradients have 24 bytes for a vertex. What there is one of
//! for a control point is small.
//!
//! | stage | reads | writes |
//! |---|---|---|
//! | prepare | W + S | W + S and two orders, 4 n each |
//! | apply | W | 24 n |
//! | volumes | T + 24 n | |
//! | ∂V/∂p | S + 24 n | 24 n |
//! | adjoint of one axis | W + 8 n | |
//! | δ of one axis | W + S + 24 n | |
//! | corrections | W + S + 24 n and the order, 4 n | 24 n |

use glam::DVec3;
use isochor::{
    Basis, Binding, CorrectOptions, Corrector, Frame, Lattice, Method, OpenBoundaries, Outside, Solid, Wanted, shapes,
    topology,
};
use rayon::prelude::*;

use crate::median::{Median, Patience, median};

/// A part of the work, or all of it in one of the ways that there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// [`Corrector::new`]: copies in the order of lattice cells.
    Prepare,
    /// W c, three coordinates.
    Apply,
    /// The volume.
    Volumes,
    /// Its gradient.
    Gradient,
    /// Wᵀ g for one coordinate: HB (10).
    Adjoint,
    /// From a pose to the displacement of the control points along x, HB (5), (10), (17): what the paper's times are of.
    Offsets,
    /// From a pose to corrected vertices along x, their volume measured again.
    OneAxis,
    /// The same along x, y and z.
    ThreeAxes,
    /// The same along the gradient.
    AlongGradient,
    /// The same with the smallest displacement of all.
    Nearest,
}

impl Stage {
    /// In the order in which they are shown.
    pub const ALL: [Self; 10] = [
        Self::Prepare,
        Self::Apply,
        Self::Volumes,
        Self::Gradient,
        Self::Adjoint,
        Self::Offsets,
        Self::OneAxis,
        Self::ThreeAxes,
        Self::AlongGradient,
        Self::Nearest,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Prepare => "prepare",
            Self::Apply => "apply",
            Self::Volumes => "volumes",
            Self::Gradient => "∂V/∂p",
            Self::Adjoint => "adjoint",
            Self::Offsets => "δ, one axis",
            Self::OneAxis => "one axis",
            Self::ThreeAxes => "three axes",
            Self::AlongGradient => "gradient",
            Self::Nearest => "nearest",
        }
    }
}

/// What part of its height the model keeps.
const SQUASH: f64 = 0.6;

/// Radians by which the upper end is turned against the lower one. With more the twist folds the lattice.
const TWIST: f64 = 0.9;

/// A model in a lattice, posed.
pub struct Bound {
    solid: Solid,
    binding: Binding,
    posed: Vec<DVec3>,
    /// Of the control points (#controls × 3).
    displacement: Vec<DVec3>,
    /// That of the model at rest.
    volume: f64,
    /// The same solid, binding and pose in the order of lattice cells.
    in_order: (Solid, Binding, Vec<DVec3>),
    /// ∂V/∂x there.
    slopes: Vec<f64>,
}

/// How a model with so many vertices is bound to a lattice of `size`³ control points.
pub fn lattice_binding(points: &[DVec3], frame: Frame, size: usize) -> (Lattice, Binding) {
    let bases = [0; 3].map(|_| Basis::uniform(size, 3).expect("a cubic basis has four functions or more"));
    let lattice = Lattice::new(bases, frame).expect("a fitted frame is not flat");
    let binding = lattice.bind(points, Outside::Keep).expect("vertices outside are kept");
    (lattice, binding)
}

impl Bound {
    /// A stone of so many vertices in a lattice of `size`³ control points, posed.
    pub fn stone(vertices: usize, size: usize) -> Self {
        let mesh = shapes::stone(vertices);
        let points = mesh.points();
        let bounds = mesh.bounds().expect("a stone has vertices");
        let frame = Frame::fitted(bounds, 0.0).expect("a stone has an extent");
        let (lattice, binding) = lattice_binding(points, frame, size);
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).expect("a stone is closed");
        let displacement: Vec<DVec3> = lattice.rest().iter().map(|c| twisted(*c - bounds.center())).collect();
        let posed = binding.displaced(points, &displacement);
        let order = binding.cell_order();
        let (ordered_solid, ordered_binding) = (solid.permuted(&order), binding.permuted(&order));
        let ordered_pose: Vec<DVec3> = order.iter().map(|v| posed[*v as usize]).collect();
        Self {
            volume: solid.volume(points),
            slopes: ordered_solid.volume_gradient(&ordered_pose).iter().map(|g| g.x).collect(),
            in_order: (ordered_solid, ordered_binding, ordered_pose),
            solid,
            binding,
            posed,
            displacement,
        }
    }

    /// Bytes of the arrays that a correction needs: of W and of the solid.
    pub fn memory(&self) -> usize {
        self.binding.memory() + self.solid.memory()
    }

    /// Bytes that a stage must touch at least once; the table is at the head of this file.
    pub fn bytes(&self, stage: Stage) -> usize {
        let (w, s, t) = (self.binding.memory(), self.solid.memory(), 12 * self.solid.triangle_count());
        let vertices = self.posed.len();
        let vectors = 24 * vertices;
        match stage {
            Stage::Prepare => 2 * (w + s) + 8 * vertices,
            Stage::Apply => w + vectors,
            Stage::Volumes => t + vectors,
            Stage::Gradient => s + 2 * vectors,
            Stage::Adjoint => w + 8 * vertices,
            Stage::Offsets => w + s + vectors,
            Stage::OneAxis | Stage::ThreeAxes | Stage::AlongGradient | Stage::Nearest => {
                w + s + 2 * vectors + 4 * vertices
            }
        }
    }

    /// The time that a stage takes in the pool it is called in.
    pub fn time(&self, stage: Stage, patience: Patience) -> Median {
        let (solid, binding, posed) = &self.in_order;
        match stage {
            Stage::Prepare => median(patience, || self.corrector(Method::Nearest)),
            Stage::Apply => median(patience, || binding.apply(&self.displacement)),
            Stage::Volumes => median(patience, || solid.volumes(posed)),
            Stage::Gradient => median(patience, || solid.volume_gradient(posed)),
            Stage::Adjoint => median(patience, || binding.adjoint_scalar(&self.slopes)),
            Stage::Offsets => median(patience, || self.offsets()),
            Stage::OneAxis => self.correction_time(along_x(), patience),
            Stage::ThreeAxes => self.correction_time(Method::xyz(), patience),
            Stage::AlongGradient => self.correction_time(Method::Gradient, patience),
            Stage::Nearest => self.correction_time(Method::Nearest, patience),
        }
    }

    fn corrector(&self, method: Method) -> Corrector<'_> {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        Corrector::new(&self.solid, &self.binding, &options).expect("solid and binding are of one model")
    }

    fn correction_time(&self, method: Method, patience: Patience) -> Median {
        let corrector = self.corrector(method);
        let wanted = Wanted::volume(self.volume);
        median(patience, || corrector.correct(&self.posed, &wanted).expect("the volume can be given back"))
    }

    /// δ along x (#controls) that gives the volume back.
    fn offsets(&self) -> Vec<f64> {
        let (solid, binding, posed) = &self.in_order;
        let missing = self.volume - solid.volume(posed);
        let slopes: Vec<f64> = solid.volume_gradient(posed).par_iter().map(|g| g.x).collect();
        let alpha = binding.adjoint_scalar(&slopes); // HB (10)
        let multiplier = missing / alpha.iter().map(|a| a * a).sum::<f64>();
        alpha.iter().map(|a| multiplier * a).collect() // HB (17)
    }
}

fn along_x() -> Method {
    Method::Axes { directions: vec![DVec3::X], shares: None }
}

/// How far the pose takes a control point at this place from the middle.
fn twisted(from_middle: DVec3) -> DVec3 {
    let (sin, cos) = (TWIST / 2.0 * from_middle.z).sin_cos();
    let DVec3 { x, y, z } = from_middle;
    DVec3::new(cos * x - sin * y, sin * x + cos * y, SQUASH * z) - from_middle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pose_keeps_what_the_squash_leaves_and_offsets_give_the_rest_back() {
        let bound = Bound::stone(1000, 10);
        let (solid, binding, posed) = &bound.in_order;
        // The twist keeps volumes but for the facets and the smoothing of the lattice.
        assert!((solid.volume(posed) / (SQUASH * bound.volume) - 1.0).abs() < 0.01);
        let delta: Vec<DVec3> = bound.offsets().iter().map(|d| DVec3::X * *d).collect();
        let corrected = solid.volume(&binding.displaced(posed, &delta));
        assert!((corrected / bound.volume - 1.0).abs() < 1e-13);
    }

    #[test]
    fn every_stage_takes_time_and_touches_bytes() {
        let bound = Bound::stone(500, 6);
        let patience = Patience { budget: std::time::Duration::ZERO, least_runs: 1 };
        for stage in Stage::ALL {
            assert!(!bound.time(stage, patience).time.is_zero(), "{stage:?}");
            assert!(bound.bytes(stage) >= 24 * 500, "{stage:?}");
        }
    }
}
