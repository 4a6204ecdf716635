//! A cage round a model.
//!
//! The surface at a distance from the model ([`offset_surface`]), whatever the model is, with its edges collapsed ([`collapsed`]) until it has few triangles.
//! What comes out is checked ([`CageCheck`]). Where a surface near the model cannot have so few triangles, because of holes through it or of many
//! parts, one that is farther away is tried: holes close and parts grow together.

use glam::DVec3;

use crate::cage_check::{CageCheck, CageFault};
use crate::edge_collapse::collapsed;
use crate::local_frame::LocalFrame;
use crate::mesh::{Bounds, Faces, Mesh, MeshError, fan};
use crate::offset_surface::offset_surface;
use crate::point_tree::PointTree;
use crate::tolerances;

/// What a cage is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CageMakingOptions {
    /// At most so many triangles, 8 or more.
    pub faces: usize,
    /// Least distance of every vertex of the model from the cage, as a fraction of the model's extent, in [`CageMakingOptions::DISTANCES`].
    pub distance: f64,
}

impl CageMakingOptions {
    /// The least number of triangles that can be asked for.
    pub const LEAST_FACES: usize = 8;
    /// The distances that can be asked for. Below, grids and points on faces become too many; above, every cage is round.
    pub const DISTANCES: std::ops::RangeInclusive<f64> = 0.002..=1.0;
}

impl Default for CageMakingOptions {
    /// 200 triangles, 2 % of the extent.
    fn default() -> Self {
        Self { faces: 200, distance: 0.02 }
    }
}

/// Why there is no cage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CageMakingError {
    /// A model without vertices.
    #[error("the model has no vertices, so there is nothing to make a cage round")]
    Nothing,
    /// All vertices in one place, or beyond what f64 can hold.
    #[error("the extent of the model is {extent:e}: a cage needs one between {:e} and {:e}", tolerances::EXTENTS.start(), tolerances::EXTENTS.end())]
    Extent {
        /// Longest side of the box.
        extent: f64,
    },
    /// Too few triangles.
    #[error("a cage of {faces} triangles was asked for: ask for {} or more", CageMakingOptions::LEAST_FACES)]
    Faces {
        /// What was asked for.
        faces: usize,
    },
    /// A distance that is too small, too large or no number.
    #[error("a distance of {distance} extents was asked for: it must be between {} and {}", CageMakingOptions::DISTANCES.start(), CageMakingOptions::DISTANCES.end())]
    Distance {
        /// What was asked for.
        distance: f64,
    },
    /// No surface that was tried can have so few triangles.
    #[error(
        "only {reached} triangles were reached, and {wanted} were asked for: ask for more triangles or a larger distance"
    )]
    TooMany {
        /// The fewest of those that were tried.
        reached: usize,
        /// What was asked for.
        wanted: usize,
    },
    /// What came out is no cage, because of rounding.
    #[error("what came out is no cage: {}; the model may be too far from the origin for its size", .faults[0])]
    Faulty {
        /// What is wrong with it; never empty.
        faults: Vec<CageFault>,
    },
    /// Coordinates that f64 cannot hold.
    #[error("the cage: {0}")]
    Mesh(#[from] MeshError),
}

/// The distance of the surface from the model grows by this factor from one try to the next. Larger: cages that need it are farther away than need be;
/// smaller: more tries.
const FARTHER: f64 = 1.5;

/// The surface is tried at distances below this fraction of the extent, if that many were not asked for. Larger: cages that have no shape of the model any
/// more; smaller: models with many holes have none.
const FARTHEST: f64 = 0.2;

/// The distance grows by this fraction while the cage is made. Larger: the cage is farther away than was asked; smaller: the check finds it too near, by the
/// rounding of a distance.
const ROUNDING: f64 = 1e-9;

/// A grid has at least and at most so many steps along the extent. Larger: it takes longer; smaller: the surface does not follow the model.
const STEPS: [f64; 2] = [25.0, 100.0];

/// A cage round `mesh`: a closed, two-manifold mesh of triangles, wound outward, that does not cross itself, with every vertex of the model inside, at the
/// distance that was asked for and more. Faces of the model are inside, too, at four fifths of it and more. They may be wound anyhow, open, flat, or cross.
/// Cavities are filled; parts that are far from each other have components of their own. It is the same for any number of threads.
///
/// # Errors
///
/// A model without extent, options that are out of range, or a number of triangles that could not be reached.
pub fn cage_round(mesh: &Mesh, options: &CageMakingOptions) -> Result<Mesh, CageMakingError> {
    let CageMakingOptions { faces, distance } = *options;
    if faces < CageMakingOptions::LEAST_FACES {
        return Err(CageMakingError::Faces { faces });
    }
    if !CageMakingOptions::DISTANCES.contains(&distance) {
        return Err(CageMakingError::Distance { distance });
    }
    let bounds = mesh.bounds().ok_or(CageMakingError::Nothing)?;
    let extent = bounds.extent();
    if !tolerances::EXTENTS.contains(&extent) {
        return Err(CageMakingError::Extent { extent });
    }
    let wanted = distance * extent;
    // Nothing is farther away than the surface with its grid and what goes outward from there.
    let margin = DVec3::splat(2.0 * distance.max(FARTHEST) * extent);
    let frame = LocalFrame::of(Bounds { min: bounds.min - margin, max: bounds.max + margin });
    let [distance, extent] = [wanted * (1.0 + ROUNDING), extent].map(|length| length / frame.unit);
    let triangles = body(mesh, frame);
    let held = PointTree::new(points_on(&triangles, distance));

    let mut fewest = usize::MAX;
    let mut away = distance;
    loop {
        // Triangles of a cage are about this long, where the model is a ball; steps are at most a quarter.
        let length = extent * (2.0 * std::f64::consts::PI / faces as f64).sqrt();
        let step = away.min(length / 4.0).clamp(extent / STEPS[1], extent / STEPS[0]);
        let place = |p: DVec3| frame.local(frame.global(p));
        let (points, found) = offset_surface(&triangles, away, step);
        let surface = (points.into_iter().map(place).collect(), found);
        let (points, found) = collapsed(surface, &held, distance, faces, place);
        if found.len() <= faces {
            let points = points.into_iter().map(|p| frame.global(p)).collect();
            let cage = Mesh::new(points, Faces::from(found))?;
            return match CageCheck::of(&cage, mesh, wanted).faults {
                faults if faults.is_empty() => Ok(cage),
                faults => Err(CageMakingError::Faulty { faults }),
            };
        }
        fewest = fewest.min(found.len());
        away *= FARTHER;
        if away > FARTHEST * extent {
            return Err(CageMakingError::TooMany { reached: fewest, wanted: faces });
        }
    }
}

/// The triangles of the fanned faces, and vertices without faces as triangles without area.
fn body(mesh: &Mesh, frame: LocalFrame) -> Vec<[DVec3; 3]> {
    let mut is_alone = vec![true; mesh.points().len()];
    mesh.faces().corners().iter().for_each(|v| is_alone[*v as usize] = false);
    let alone = (0..mesh.points().len() as u32).filter(|v| is_alone[*v as usize]).map(|v| [v; 3]);
    let all = mesh.faces().iter().flat_map(fan).chain(alone);
    all.map(|t| t.map(|v| frame.local(mesh.points()[v as usize]))).collect()
}

/// The corners of triangles, and as many points on them that no point of a triangle is farther than `spacing/√3` from the nearest: where these keep a distance
/// of `spacing`, triangles keep one of `spacing √(2/3)`.
fn points_on(triangles: &[[DVec3; 3]], spacing: f64) -> Vec<DVec3> {
    let mut points = Vec::new();
    for [a, b, c] in triangles {
        let longest = a.distance(*b).max(b.distance(*c)).max(c.distance(*a));
        let parts = (longest / spacing).ceil().max(1.0) as usize;
        for i in 0..=parts {
            for j in 0..=parts - i {
                let [u, v, w] = [parts - i - j, i, j].map(|n| n as f64 / parts as f64);
                points.push(u * *a + v * *b + w * *c);
            }
        }
    }
    points.sort_unstable_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z)));
    points.dedup();
    points
}
