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
//!
//! As in the second paper, a part of a surface stands for less where q is outside its box: w of the part is that of a fan over
//! its boundary. A surface of n triangles among k inward components is halved into parts of n/k triangles, so their tests take
//! about as long as one sum over all triangles, and `k √n` for the boundaries.

use std::f64::consts::PI;
use std::ops::Range;

use glam::DVec3;

use crate::mesh::Bounds;
use crate::volume::{Solid, Volumes, encloses_nothing};
use crate::{parallel, tolerances};

/// Parts of a surface of so many triangles are not divided. Larger: longer sums; smaller: boundaries as long as the parts.
const FEW_TRIANGLES: usize = 256;

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
/// Where no component is inward, no winding number is computed.
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
    let whole = Bounds::of(points).map_or(0.0, |b| b.extent());
    let bodies: Vec<usize> = (0..pieces.len()).filter(|&c| !pieces[c].encloses_nothing(volume(c), whole)).collect();
    let (inward, mut outward): (Vec<usize>, Vec<usize>) = bodies.iter().partition(|&&c| volume(c) < 0.0);
    outward.sort_by(|&a, &b| volume(a).total_cmp(&volume(b))); // stable: first component first
    let surface = |k: usize| {
        let piece: &Piece = &pieces[outward[k]];
        Surface::new(piece, (piece.triangles.len() / inward.len()).max(FEW_TRIANGLES))
    };
    let surfaces = parallel::map(if inward.is_empty() { 0 } else { outward.len() }, surface);
    let holders = parallel::map(inward.len(), |k| {
        let tests = pieces[inward[k]].test_points();
        surfaces.iter().position(|surface| surface.contains(&tests, orientation)).map(|o| outward[o])
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
}

impl<'a> Piece<'a> {
    fn new(triangles: &'a [[u32; 3]], points: &'a [DVec3]) -> Self {
        Self { triangles, points }
    }

    /// As [`Solid::encloses_nothing`], for the component alone; `whole` is the extent of the whole body.
    fn encloses_nothing(&self, volume: f64, whole: f64) -> bool {
        let doubled = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            (b - a).cross(c - a).length()
        };
        let area = || {
            let parts = parallel::map_chunks(self.triangles.len(), parallel::CHUNK, |range| {
                self.triangles[range].iter().map(doubled).sum::<f64>()
            });
            parts.iter().sum::<f64>() / 2.0
        };
        let count = self.triangles.len();
        // Most components are too large for that even in the box of the whole body, which is known.
        encloses_nothing(volume, count, whole, area)
            && encloses_nothing(volume, count, bounds(self.triangles, self.points).extent(), area)
    }

    /// Centroids of triangles, spread over the component.
    fn test_points(&self) -> Vec<DVec3> {
        /// More than there are answers to find: several may touch the other surface.
        const COUNT: usize = 16;
        let count = self.triangles.len().min(COUNT);
        let triangle = |k: usize| self.triangles[k * self.triangles.len() / count];
        (0..count).map(|k| triangle(k).map(|v| self.points[v as usize]).iter().sum::<DVec3>() / 3.0).collect()
    }
}

/// A closed surface, halved again and again by the places of its triangles.
struct Surface<'a> {
    triangles: Vec<[u32; 3]>,
    /// Vertices and apexes of the whole body.
    points: &'a [DVec3],
    /// Children before their parents; the last is the whole.
    parts: Vec<Part>,
}

/// A part of a surface.
struct Part {
    triangles: Range<usize>,
    bounds: Bounds,
    /// Its boundary: edges as its triangles run them, where they run them more often in one direction than in the other.
    rim: Vec<[u32; 2]>,
    halves: Option<[usize; 2]>,
}

impl<'a> Surface<'a> {
    /// Divided into parts of at most `most` triangles.
    fn new(piece: &Piece<'a>, most: usize) -> Self {
        let mut surface = Self { triangles: piece.triangles.to_vec(), points: piece.points, parts: Vec::new() };
        surface.divide(0..piece.triangles.len(), most);
        surface
    }

    /// Adds the part of `triangles` and, before it, those of which it consists; gives its index.
    fn divide(&mut self, triangles: Range<usize>, most: usize) -> usize {
        let (points, is_whole) = (self.points, triangles.len() == self.triangles.len());
        let these = &mut self.triangles[triangles.clone()];
        let bounds = bounds(these, points);
        let mut edges: Vec<[u32; 2]> = Vec::new(); // the whole is closed
        let halves = if these.len() > most {
            let axis = bounds.size().max_position();
            let place = |t: &[u32; 3]| t.iter().map(|v| points[*v as usize][axis]).sum::<f64>();
            let half = these.len() / 2;
            these.select_nth_unstable_by(half, |s, t| place(s).total_cmp(&place(t)).then_with(|| s.cmp(t)));
            let middle = triangles.start + half;
            Some([triangles.start..middle, middle..triangles.end].map(|range| self.divide(range, most)))
        } else {
            None
        };
        match halves {
            _ if is_whole => {}
            Some(halves) => edges.extend(halves.iter().flat_map(|&half| &self.parts[half].rim)),
            None => {
                edges.extend(self.triangles[triangles.clone()].iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]));
            }
        }
        self.parts.push(Part { triangles, bounds, rim: rim_of(edges), halves });
        self.parts.len() - 1
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
        let half_angle = |t: [u32; 3]| half_solid_angle(t.map(|v| self.points[v as usize] - q));
        let (mut sum, mut open) = (0.0, vec![self.parts.len() - 1]);
        while let Some(part) = open.pop() {
            let Part { triangles, bounds, rim, halves } = &self.parts[part];
            if q.cmplt(bounds.min).any() || q.cmpgt(bounds.max).any() {
                // The part and the fan over its rim enclose a body in the box, outside which q is.
                for [from, to] in rim {
                    sum += half_angle([rim[0][0], *from, *to])?;
                }
            } else if let Some(halves) = halves {
                open.extend(halves);
            } else {
                for t in &self.triangles[triangles.clone()] {
                    sum += half_angle(*t)?;
                }
            }
        }
        let winding_number = sum / (2.0 * PI);
        let whole = winding_number.round();
        ((winding_number - whole).abs() <= tolerances::WINDING).then_some(whole)
    }
}

/// The box round some triangles; of none, the origin.
fn bounds(triangles: &[[u32; 3]], points: &[DVec3]) -> Bounds {
    let first = triangles.first().map_or(DVec3::ZERO, |t| points[t[0] as usize]);
    let with = |b: Bounds, p: DVec3| Bounds { min: b.min.min(p), max: b.max.max(p) };
    let parts = parallel::map_chunks(triangles.len(), parallel::CHUNK, |range| {
        let corners = triangles[range].as_flattened();
        corners.iter().fold(Bounds { min: first, max: first }, |b, &v| with(b, points[v as usize]))
    });
    parts.iter().fold(Bounds { min: first, max: first }, |b, part| with(with(b, part.min), part.max))
}

/// The edges that are left where opposite ones cancel.
fn rim_of(mut edges: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    let ends = |[from, to]: [u32; 2]| [from.min(to), from.max(to)];
    edges.sort_unstable_by_key(|&edge| (ends(edge), edge));
    let same_ends = edges.chunk_by(|a, b| ends(*a) == ends(*b));
    let left = same_ends.flat_map(|group| {
        // Those of one direction stand before those of the other.
        let forward = group.partition_point(|edge| *edge == group[0]);
        let backward = group.len() - forward;
        if forward > backward { &group[backward..forward] } else { &group[2 * forward..] }
    });
    left.copied().collect()
}

/// Half the signed solid angle of a triangle seen from the origin: positive where it is clockwise from there. `None` where the
/// triangle touches the origin.
pub(crate) fn half_solid_angle([a, b, c]: [DVec3; 3]) -> Option<f64> {
    let [la, lb, lc] = [a, b, c].map(DVec3::length);
    let determinant = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb; // van Oosterom and Strackee (8)
    let touches = tolerances::TOUCHES * la * lb * lc;
    if determinant.abs() <= touches && denominator <= touches {
        return None;
    }
    Some(determinant.atan2(denominator))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn edges_that_are_run_both_ways_cancel() {
        let edges = vec![[1, 2], [2, 1], [3, 4], [4, 3], [3, 4], [6, 5], [6, 5], [5, 6], [6, 5], [7, 8]];
        assert_eq!(rim_of(edges), [[3, 4], [6, 5], [6, 5], [7, 8]]);
        assert!(rim_of(Vec::new()).is_empty());
    }

    #[test]
    fn a_divided_surface_winds_as_often_as_the_whole_and_as_the_formula_of_the_torus_says() {
        let mesh = shapes::uv_torus(2.0, 0.8, 60, 40);
        // Once with shared vertices, and once with three of its own for each triangle, whose edges never cancel.
        let shared: Vec<[u32; 3]> = mesh.faces().iter().map(|face| [face[0], face[1], face[2]]).collect();
        let corners: Vec<DVec3> = mesh.faces().corners().iter().map(|&v| mesh.points()[v as usize]).collect();
        let single: Vec<[u32; 3]> = (0..shared.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        for (points, triangles) in [(mesh.points(), &shared), (&corners, &single)] {
            let piece = Piece::new(triangles, points);
            let whole = Surface::new(&piece, triangles.len());
            let divided = [1, 7, 100, 1000].map(|most| Surface::new(&piece, most));
            let mut inside = 0;
            for k in 0..400 {
                let fraction = |step: usize| (k * step % 997) as f64 / 997.0 - 0.5;
                let q = DVec3::new(6.0 * fraction(1), 6.0 * fraction(31), 2.0 * fraction(211));
                // Distance from the circle in the middle of the tube; the polygons lie within 2 % of its radius.
                let tube = (q.truncate().length() - 2.0).hypot(q.z) / 0.8;
                if (tube - 0.99).abs() < 0.02 {
                    continue;
                }
                let expected = Some(if tube < 1.0 { 1.0 } else { 0.0 });
                inside += usize::from(tube < 1.0);
                assert_eq!(whole.winding_number(q), expected, "{q}");
                for surface in &divided {
                    assert_eq!(surface.winding_number(q), expected, "{q}");
                }
            }
            assert!(inside > 40);
            let on_the_surface = (points[0] + points[1]) / 2.0;
            assert_eq!((divided[1].winding_number(on_the_surface), whole.winding_number(on_the_surface)), (None, None));
            assert_eq!(whole.winding_number(points[0]), None);
        }
    }
}
