//! Levels of detail: bodies that stand for a model, each with about α = 4 times the triangles of the one before. HML, sections 4.2 and 4.3.
//!
//! What is found on a coarse level costs little and is near what a fine level would find, so a search begins on the coarsest and ends on the model
//! itself. Meshes are simplified ([`Levels::of_mesh`]), parametric bodies sampled ([`Levels::of_samples`]).
//!
//! How fine is fine enough follows from two levels. Let ΔV_N be the change of volume by a deformation, measured with N triangles. Its error is about C/N, so
//!
//! ```text
//! ΔV_N − ΔV = R(N) ≈ C/N,                                        (28)
//! C ≈ (ΔV_N − ΔV_M) / (1/N − 1/M)                                (29), there for M = 2N
//! ```
//!
//! ([`TriangleError`]). It holds for triangles between samples of a smooth surface that halve their steps together.
//!
//! HML = G. Hirota, R. Maheshwari, M. C. Lin, *Fast volume-preserving free form deformation using multi-level optimization* (1999).
//!
//! # Changes versus the paper
//!
//! - Simplified levels are made of the model's own vertices ([`Solid::coarse`]), so a binding of the model has rows for them.
//! - Each is simplified from the next finer one, which took a fifth to a seventh of the time that it took from the model for scans of 86,000 to 270,000 triangles.
//!   Changes of volume under a lattice were as near. Volumes are within a tenth of the next finer level's, so the coarsest level can lack more than
//!   that of the model's.
//! - The coarsest level has 64 triangles, not 16: see `parametric_solid.rs`.

use std::borrow::Cow;

use glam::DVec3;

use crate::parametric_solid::{LEAST_TRIANGLES, ParametricSolid, ParametricSolidError};
use crate::topology::topology;
use crate::volume::{OpenBoundaries, Solid};

/// A body that stands for a model at one fineness.
#[derive(Clone, Debug)]
pub struct Level<'a> {
    /// The body, over its own vertices.
    pub solid: Cow<'a, Solid>,
    /// Its vertices at rest (#vertices × 3).
    pub points: Cow<'a, [DVec3]>,
    /// Which vertices of the model these are (#vertices, ascending), where the level is a simplification of it.
    pub vertices: Option<Vec<u32>>,
}

/// Levels of detail, the coarsest first, the model itself last.
#[derive(Clone, Debug)]
pub struct Levels<'a>(Vec<Level<'a>>);

/// How levels are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelOptions {
    /// α: about how many times more triangles the next finer level has, at least 2.
    pub factor: usize,
    /// The coarsest level has at least about so many triangles.
    pub coarsest: usize,
}

impl Default for LevelOptions {
    /// α = 4, as in the paper, and [`LEAST_TRIANGLES`].
    fn default() -> Self {
        Self { factor: 4, coarsest: LEAST_TRIANGLES }
    }
}

/// A level is left out where the next finer one has less than this times its triangles. Larger: steps between levels are far from α; smaller: levels
/// are made that save nothing.
const HARDLY_SMALLER: f64 = 1.5;

impl<'a> Levels<'a> {
    /// Of a mesh: `solid` is the body, `points` (#vertices × 3) its vertices at rest. Virtual caps are those of `solid` on every level. Where a level cannot be made
    /// much coarser (many components, rough surfaces), the coarser ones are left out.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices, or the factor is less than 2.
    #[must_use]
    pub fn of_mesh(solid: &'a Solid, points: &'a [DVec3], options: &LevelOptions) -> Self {
        assert!(options.factor >= 2, "levels differ by a factor of at least 2, not {}", options.factor);
        let mut levels = vec![Level { solid: Cow::Borrowed(solid), points: Cow::Borrowed(points), vertices: None }];
        loop {
            let finer = &levels[levels.len() - 1];
            let count = finer.solid.triangle_count();
            let wanted = count / options.factor;
            if wanted < options.coarsest.max(1) {
                break;
            }
            let (coarse, named) = finer.solid.coarse(&finer.points, wanted).compacted();
            if coarse.triangle_count() as f64 * HARDLY_SMALLER > count as f64 {
                break;
            }
            let in_model = |v: &u32| finer.vertices.as_ref().map_or(*v, |vertices| vertices[*v as usize]);
            let vertices: Vec<u32> = named.iter().map(in_model).collect();
            let at_rest = vertices.iter().map(|v| points[*v as usize]).collect();
            levels.push(Level { solid: Cow::Owned(coarse), points: at_rest, vertices: Some(vertices) });
        }
        levels.reverse();
        Self(levels)
    }
}

impl Levels<'static> {
    /// Of a parametric body, its finest level with at least `finest` triangles; from one level to the next coarser the steps between samples become √α times
    /// as long.
    ///
    /// # Errors
    ///
    /// Those of [`ParametricSolid::sampled`]; samples that bound no body.
    ///
    /// # Panics
    ///
    /// Panics where the factor is less than 2.
    pub fn of_samples(
        solid: &ParametricSolid,
        finest: usize,
        options: &LevelOptions,
    ) -> Result<Self, ParametricSolidError> {
        assert!(options.factor >= 2, "levels differ by a factor of at least 2, not {}", options.factor);
        let step = (options.factor as f64).sqrt();
        let mut divisions = vec![solid.divisions(finest)?];
        loop {
            let finer = divisions[divisions.len() - 1];
            let coarser = (divisions[0] as f64 / step.powi(divisions.len() as i32)).round() as usize;
            let is_level = coarser < finer
                && coarser >= solid.least_divisions()
                && solid.triangle_count(coarser) >= options.coarsest;
            if !is_level {
                break;
            }
            divisions.push(coarser);
        }
        let level = |divisions: &usize| {
            let mesh = solid.mesh(*divisions)?;
            let sampled = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap)?;
            Ok(Level { solid: Cow::Owned(sampled), points: Cow::Owned(mesh.points().to_vec()), vertices: None })
        };
        divisions.iter().rev().map(level).collect::<Result<_, _>>().map(Self)
    }
}

impl<'a> Levels<'a> {
    /// The levels, the coarsest first.
    #[must_use]
    pub fn as_slice(&self) -> &[Level<'a>] {
        &self.0
    }
}

/// The error of volumes of triangles, `R(N) ≈ C/N`; HML (28).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleError {
    /// C, in the cube of the length unit.
    pub c: f64,
}

impl TriangleError {
    /// From the volumes, or changes of volume, of two levels with that many triangles; HML (29).
    ///
    /// # Panics
    ///
    /// Panics where both numbers of triangles are the same, or one of them is 0.
    #[must_use]
    pub fn between(triangles: [usize; 2], volumes: [f64; 2]) -> Self {
        let [n, m] = triangles;
        assert!(n != m && n > 0 && m > 0, "two levels of different numbers of triangles, not {n} and {m}");
        Self { c: (volumes[0] - volumes[1]) / (1.0 / n as f64 - 1.0 / m as f64) }
    }

    /// About by how much the volume of so many triangles is too large.
    #[must_use]
    pub fn at(&self, triangles: usize) -> f64 {
        self.c / triangles as f64
    }

    /// The fewest triangles with an error of about `tolerance` (in the cube of the length unit) at most.
    ///
    /// # Panics
    ///
    /// Panics where the tolerance is not positive.
    #[must_use]
    pub fn triangles(&self, tolerance: f64) -> usize {
        assert!(tolerance > 0.0, "a tolerance is more than 0, not {tolerance}");
        (self.c.abs() / tolerance).ceil() as usize
    }
}
