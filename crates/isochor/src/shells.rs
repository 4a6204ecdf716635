//! Which component of a body is a cavity of which.
//!
//! A component whose signed volume has the model's orientation is *outward*, one of the other sign *inward*. An inward
//! component that lies inside an outward one is a cavity of it: of the smallest that contains it, so shells in cavities of
//! shells come out right. Sizes are volumes; components that enclose nothing are neither.
//!
//! Whether a point q is inside a closed surface is told by its winding number, the sum of the solid angles of its triangles:
//!
//! ```text
//! w(q) = 1/4π Σ ω,   tan(ω/2) = det(a, b, c) / (|a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b|),   a = p_l − q, …
//! ```
//!
//! (A. van Oosterom, J. Strackee, *The solid angle of a plane triangle*, IEEE Trans. Biomed. Eng. 30 (1983), (8); as a test of
//! containment: A. Jacobson, L. Kavan, O. Sorkine-Hornung, *Robust inside-outside segmentation using generalized winding
//! numbers*, 2013.) Virtual caps close what is open, so w is a whole number away from the surface.
//!
//! *Changes versus the papers*: on the surface w is not used at all. A component is tested by the centroids of some of its
//! triangles, spread over it; one that touches the other surface, or whose w is not near a whole number, says nothing, and the
//! next is taken. The majority of the first [`tolerances::CLEAR_ANSWERS`] clear answers decides, so of two surfaces that cross
//! it depends on the triangles which contains which. Without a clear answer a component counts as outside.

use std::f64::consts::PI;

use glam::DVec3;

use crate::mesh::Bounds;
use crate::volume::{Solid, Volumes};
use crate::{parallel, tolerances};

/// What a component of a body is to the others.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(tag = "role", rename_all = "kebab-case"))]
pub enum Role {
    /// Outward, without cavities.
    Solid,
    /// Outward, with cavities.
    Shell(Shell),
    /// Inward, inside an outward component.
    Cavity {
        /// The smallest outward component that contains it.
        of: usize,
    },
    /// Inward, but inside no outward component.
    Inward,
    /// It encloses no volume.
    Nothing,
}

/// An outward component and the cavities in it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Shell {
    /// The outer component.
    pub outer: usize,
    /// Its cavities, ascending.
    pub cavities: Vec<usize>,
}

impl Shell {
    /// What the cavities hold together, positive; `volumes` are those of any pose, in whose length unit cubed it is.
    ///
    /// # Panics
    ///
    /// Panics where `volumes` are of a body with fewer components.
    #[must_use]
    pub fn capacity(&self, volumes: &Volumes) -> f64 {
        self.cavities.iter().map(|&c| volumes.components[c].abs()).sum()
    }

    /// The volume of the material: that of the outer component less its cavities, outward orientation.
    ///
    /// # Panics
    ///
    /// Panics where `volumes` are of a body with fewer components.
    #[must_use]
    pub fn material(&self, volumes: &Volumes) -> f64 {
        volumes.components[self.outer].abs() - self.capacity(volumes)
    }
}

/// What each component of `solid` is to the others in the pose `points` (#vertices × 3), whose volumes are `volumes`.
///
/// Takes time only where there are inward components: no winding number is computed otherwise.
///
/// # Panics
///
/// Panics where the number of points is not the number of vertices, or `volumes` are of another body.
#[must_use]
pub fn roles(solid: &Solid, points: &[DVec3], volumes: &Volumes) -> Vec<Role> {
    let points = &*solid.points_with_apexes(points);
    let pieces = parallel::map(solid.component_count(), |c| Piece::new(solid.triangles_of(c), points));
    let orientation = if volumes.total < 0.0 { -1.0 } else { 1.0 };
    let volume = |c: usize| volumes.components[c] * orientation;
    let bodies: Vec<usize> = (0..pieces.len()).filter(|&c| !pieces[c].encloses_nothing(volume(c))).collect();
    let (inward, mut outward): (Vec<usize>, Vec<usize>) = bodies.iter().partition(|&&c| volume(c) < 0.0);
    outward.sort_by(|&a, &b| volume(a).total_cmp(&volume(b))); // stable: first component first
    let holders = parallel::map(inward.len(), |k| {
        let tests = pieces[inward[k]].test_points();
        outward.iter().copied().find(|&o| pieces[o].contains(&tests, orientation))
    });

    let mut cavities = vec![Vec::new(); pieces.len()];
    let mut roles = vec![Role::Nothing; pieces.len()];
    for (&c, holder) in inward.iter().zip(&holders) {
        roles[c] = holder.map_or(Role::Inward, |of| Role::Cavity { of });
        holder.iter().for_each(|&of| cavities[of].push(c));
    }
    for outer in outward {
        let cavities = std::mem::take(&mut cavities[outer]);
        roles[outer] = if cavities.is_empty() { Role::Solid } else { Role::Shell(Shell { outer, cavities }) };
    }
    roles
}

/// A component in a pose.
struct Piece<'a> {
    triangles: &'a [[u32; 3]],
    /// Vertices and apexes of the whole body.
    points: &'a [DVec3],
    bounds: Bounds,
}

impl<'a> Piece<'a> {
    fn new(triangles: &'a [[u32; 3]], points: &'a [DVec3]) -> Self {
        let first = points[triangles[0][0] as usize];
        let bounds = triangles.as_flattened().iter().fold(Bounds { min: first, max: first }, |b, &v| {
            let p = points[v as usize];
            Bounds { min: b.min.min(p), max: b.max.max(p) }
        });
        Self { triangles, points, bounds }
    }

    /// As [`Solid::encloses_nothing`], for the component alone.
    fn encloses_nothing(&self, volume: f64) -> bool {
        let doubled = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            (b - a).cross(c - a).length()
        };
        let area = self.triangles.iter().map(doubled).sum::<f64>() / 2.0;
        volume.abs() <= tolerances::NO_VOLUME * area * self.bounds.extent()
    }

    /// Centroids of triangles, spread over the component.
    fn test_points(&self) -> Vec<DVec3> {
        /// More than there are answers to find: several may touch the other surface.
        const COUNT: usize = 16;
        let count = self.triangles.len().min(COUNT);
        let triangle = |k: usize| self.triangles[k * self.triangles.len() / count];
        (0..count).map(|k| triangle(k).map(|v| self.points[v as usize]).iter().sum::<DVec3>() / 3.0).collect()
    }

    /// Whether the majority of the first clear answers is that a test point is inside.
    fn contains(&self, tests: &[DVec3], orientation: f64) -> bool {
        let answers = tests.iter().filter_map(|q| self.winding_number(*q)).take(tolerances::CLEAR_ANSWERS);
        let (mut inside, mut outside) = (0, 0);
        for winding_number in answers {
            if winding_number * orientation >= 1.0 { inside += 1 } else { outside += 1 }
        }
        inside > outside
    }

    /// How often the surface winds round `q`; `None` where it touches the surface or no whole number comes out.
    fn winding_number(&self, q: DVec3) -> Option<f64> {
        if q.cmplt(self.bounds.min).any() || q.cmpgt(self.bounds.max).any() {
            return Some(0.0);
        }
        let parts = parallel::map_chunks(self.triangles.len(), parallel::CHUNK, |range| {
            let corners = |t: &[u32; 3]| t.map(|v| self.points[v as usize] - q);
            self.triangles[range].iter().map(|t| half_solid_angle(corners(t))).sum::<Option<f64>>()
        });
        let winding_number = parts.into_iter().sum::<Option<f64>>()? / (2.0 * PI);
        let whole = winding_number.round();
        ((winding_number - whole).abs() <= tolerances::WINDING).then_some(whole)
    }
}

/// Half the signed solid angle of a triangle seen from the origin: positive where it is clockwise from there. `None` where the
/// triangle touches the origin.
fn half_solid_angle([a, b, c]: [DVec3; 3]) -> Option<f64> {
    let [la, lb, lc] = [a, b, c].map(DVec3::length);
    let determinant = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb; // van Oosterom and Strackee (8)
    let touches = tolerances::TOUCHES * la * lb * lc;
    if determinant.abs() <= touches && denominator <= touches {
        return None;
    }
    Some(determinant.atan2(denominator))
}
