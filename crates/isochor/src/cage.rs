//! Cages: closed polygon meshes round a model, whose vertices are controls. CVB, sections 1 and 3.
//!
//! Polygons are fanned from their first corner, at rest and posed alike. A cage may be wound either way; its triangles here are turned so
//! that they face outward.

use glam::DVec3;

use crate::closest::closest_on_triangle;
use crate::mesh::{Mesh, MeshError, fan};
use crate::shells::half_solid_angle;
use crate::tolerances;
use crate::topology::topology;
use crate::volume::{OpenBoundaries, Solid, SolidError};

/// A closed cage at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Cage {
    mesh: Mesh,
    triangles: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    sides: Vec<[Side; 3]>,
    extent: f64,
}

/// A side of a triangle: an edge of the cage, run forwards or backwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Side {
    /// Index of the edge.
    pub(crate) edge: u32,
    /// Whether the triangle runs it from its second end to its first.
    pub(crate) is_backward: bool,
}

/// Why a mesh is no cage.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CageError {
    /// It is open, wound inconsistently, without faces, or too large or small.
    #[error("the cage does not close: {0}")]
    Solid(#[from] SolidError),
    /// It encloses nothing.
    #[error("the cage encloses no volume: |{volume:e}| is rounding noise for its area and extent")]
    NoVolume {
        /// What was measured.
        volume: f64,
    },
    /// A triangle of a face has no area, so it has no normal.
    #[error("face {face} of the cage has a triangle without area, between its vertices {}, {} and {}", .corners[0], .corners[1], .corners[2])]
    NoArea {
        /// The face.
        face: usize,
        /// The corners of the triangle.
        corners: [u32; 3],
    },
    /// Positions that are not finite.
    #[error("the cage: {0}")]
    Mesh(#[from] MeshError),
}

/// The point of a cage that is closest to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Closest {
    pub(crate) triangle: usize,
    /// Barycentric coordinates in it.
    pub(crate) weights: [f64; 3],
    pub(crate) distance: f64,
}

impl Cage {
    /// The cage of a mesh that is closed: every edge is run as often in one direction as in the other. It may have several components, and
    /// faces that cross one another.
    ///
    /// # Errors
    ///
    /// A mesh that is open or wound inconsistently, encloses nothing, or has a triangle without area.
    pub fn new(mesh: Mesh) -> Result<Self, CageError> {
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse)?;
        let volume = solid.volume(mesh.points());
        if solid.encloses_nothing(mesh.points(), volume) {
            return Err(CageError::NoVolume { volume });
        }
        let turned = |[a, b, c]: [u32; 3]| if volume < 0.0 { [a, c, b] } else { [a, b, c] };
        let mut triangles = Vec::new();
        for (face, polygon) in mesh.faces().iter().enumerate() {
            for corners in fan(polygon) {
                let [a, b, c] = corners.map(|v| mesh.points()[v as usize]);
                let (ab, ac) = (b - a, c - a);
                if ab.cross(ac).length() <= tolerances::FLAT_FRAME * ab.length() * ac.length() {
                    return Err(CageError::NoArea { face, corners });
                }
                triangles.push(turned(corners));
            }
        }
        let ends = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]];
        let mut edges: Vec<[u32; 2]> =
            triangles.iter().flat_map(|t| ends(*t)).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        let side = |[a, b]: [u32; 2]| Side {
            edge: edges.binary_search(&[a.min(b), a.max(b)]).expect("an edge for every side") as u32,
            is_backward: a > b,
        };
        let sides = triangles.iter().map(|t| ends(*t).map(side)).collect();
        let extent = mesh.bounds().map_or(0.0, |bounds| bounds.extent());
        Ok(Self { mesh, triangles, edges, sides, extent })
    }

    /// The mesh, as it was given.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The vertices at rest, C⁰ (#controls × 3).
    #[must_use]
    pub fn vertices(&self) -> &[DVec3] {
        self.mesh.points()
    }

    /// The triangles of the fanned faces, in their order, counter-clockwise seen from outside.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The edges of the triangles, each once, its smaller end first.
    #[must_use]
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The edges of the faces, each once, its smaller end first: those of the triangles without the diagonals of polygons.
    #[must_use]
    pub fn mesh_edges(&self) -> Vec<[u32; 2]> {
        let sides = |face: &[u32]| (0..face.len()).map(|i| [face[i], face[(i + 1) % face.len()]]).collect::<Vec<_>>();
        let mut edges: Vec<[u32; 2]> =
            self.mesh.faces().iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// For each triangle its sides: from the first to the second corner, from the second to the third, from the third to the first.
    pub(crate) fn sides(&self) -> &[[Side; 3]] {
        &self.sides
    }

    /// Longest side of its bounding box.
    #[must_use]
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// The corners of a triangle at rest.
    pub(crate) fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.vertices()[v as usize])
    }

    /// The same cage moved by `by`.
    ///
    /// # Errors
    ///
    /// Positions that are not finite there.
    pub fn moved(&self, by: DVec3) -> Result<Self, MeshError> {
        let mesh = self.mesh.with_points(self.vertices().iter().map(|p| *p + by).collect())?;
        Ok(Self { mesh, ..self.clone() })
    }

    /// Whether `point` is inside or on the cage, up to [`tolerances::INSIDE`] of its extent: the cage winds round it.
    #[must_use]
    pub fn contains(&self, point: DVec3) -> bool {
        self.winds_round(point) || self.closest(point).distance <= tolerances::INSIDE * self.extent
    }

    /// Distance of `point` from the surface of the cage, inside and outside.
    #[must_use]
    pub fn distance(&self, point: DVec3) -> f64 {
        self.closest(point).distance
    }

    /// Whether the cage winds round `point` at least once. Of points on it nothing is said.
    fn winds_round(&self, point: DVec3) -> bool {
        let half_angle = |t: &[u32; 3]| half_solid_angle(t.map(|v| self.vertices()[v as usize] - point)).unwrap_or(0.0);
        self.triangles.iter().map(half_angle).sum::<f64>() > std::f64::consts::PI
    }

    /// `point`, or where it is nearer to the cage than [`tolerances::BESIDE_CAGE`] of its extent, the point so far inside the closest triangle's
    /// plane.
    pub(crate) fn beside(&self, point: DVec3) -> DVec3 {
        let closest = self.closest(point);
        let least = tolerances::BESIDE_CAGE * self.extent;
        if closest.distance >= least {
            return point;
        }
        let [a, b, c] = self.corners(closest.triangle);
        let on: DVec3 = closest.weights.iter().zip([a, b, c]).map(|(w, corner)| *w * corner).sum();
        on - (b - a).cross(c - a).normalize() * least
    }

    /// The point of the cage that is closest to `point`; of several that of the first triangle.
    pub(crate) fn closest(&self, point: DVec3) -> Closest {
        let of = |triangle: usize| {
            let corners = self.corners(triangle);
            let weights = closest_on_triangle(point, corners);
            let at: DVec3 = weights.iter().zip(corners).map(|(w, c)| *w * c).sum();
            Closest { triangle, weights, distance: at.distance(point) }
        };
        let nearer = |a: Closest, b: Closest| if b.distance < a.distance { b } else { a };
        (1..self.triangles.len()).map(of).fold(of(0), nearer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Faces, shapes};

    #[test]
    fn cages_of_either_winding_face_outward() {
        let cube = shapes::cube(1);
        let cage = Cage::new(cube.clone()).unwrap();
        let inside_out: Faces = cube.faces().iter().map(|f| f.iter().rev().copied().collect::<Vec<_>>()).fold(
            Faces::new(),
            |mut faces, face| {
                faces.push(&face);
                faces
            },
        );
        let turned = Cage::new(Mesh::new(cube.points().to_vec(), inside_out).unwrap()).unwrap();
        for cage in [cage, turned] {
            assert_eq!((cage.triangles().len(), cage.edges().len(), cage.extent()), (12, 18, 1.0));
            assert!(cage.contains(DVec3::splat(0.5)) && cage.contains(DVec3::new(0.5, 0.5, 1.0)));
            assert!(!cage.contains(DVec3::splat(1.1)));
            assert_eq!(cage.distance(DVec3::new(0.5, 0.5, 1.5)), 0.5);
            for ([a, b, c], sides) in cage.triangles().iter().zip(cage.sides()) {
                let [p, q, r] = [a, b, c].map(|v| cage.vertices()[*v as usize] - 0.5);
                assert!(p.dot(q.cross(r)) > 0.0);
                for (from, side) in [a, b, c].into_iter().zip(sides) {
                    assert_eq!(cage.edges()[side.edge as usize][usize::from(side.is_backward)], *from);
                }
            }
        }
    }

    #[test]
    fn what_is_no_cage_says_why() {
        let points = || vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let cage = |faces: &[[u32; 3]]| Cage::new(Mesh::new(points(), faces.iter().collect()).unwrap());
        let open = cage(&[[0, 2, 1], [0, 1, 3], [0, 3, 2]]).unwrap_err();
        assert!(matches!(open, CageError::Solid(SolidError::Open { .. })), "{open}");
        let flat = cage(&[[0, 1, 2], [0, 2, 1]]).unwrap_err();
        assert!(matches!(flat, CageError::NoVolume { .. }), "{flat}");
        let mut faces = Faces::new();
        [&[0, 2, 1, 1][..], &[0, 1, 3], &[1, 2, 3], &[0, 3, 2]].iter().for_each(|face| faces.push(face));
        let pinched = Cage::new(Mesh::new(points(), faces).unwrap()).unwrap_err();
        assert_eq!(pinched, CageError::NoArea { face: 0, corners: [0, 1, 1] });
    }
}
