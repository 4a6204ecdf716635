//! A body with fewer triangles between some of its own vertices.
//!
//! Given triangles T between vertices at P, find fewer, T', that enclose nearly the same. Edges are collapsed in the order of the
//! quadric error (M. Garland, P. Heckbert, *Surface Simplification Using Quadric Error Metrics*, 1997) by the crate
//! `meshoptimizer-rs`: a vertex always goes to another vertex, so T' indexes the same positions, and whatever is linear in them
//! (a binding, a pose) serves T' too.
//!
//! T' is as well closed as T. Collapsing edges is a map f of vertices to vertices, and triangles that lose a corner are dropped:
//! `∂ f(T) = f(∂T)`. So a balanced mesh stays balanced whatever is collapsed, and where the vertices of a boundary are held it
//! stays as it was, and with it the virtual cap.
//!
//! # Changes versus the paper
//!
//! - Components are simplified one by one, each to its share of the triangles, so that none vanishes.
//! - A component is checked: balanced with its caps, volume within [`tolerances::COARSE_VOLUME`] of the fine one. If it is not, it
//!   gets twice the triangles, and again, in the end all that it had.

use glam::DVec3;
use meshoptimizer_rs::{
    Attributes, Limits, Positions, SimplifyOptions, SimplifySettings, VertexFlags, Workspace, simplify_sloppy,
    simplify_with_attributes,
};

use crate::mesh::{Bounds, Mesh, fan};
use crate::parallel;
use crate::tolerances;
use crate::topology::topology;
use crate::volume::{OpenBoundaries, Solid};

/// About `triangles` triangles between some of the vertices of `mesh`, for pictures of it and of any pose of it: those of
/// [`Solid::coarse`] where the mesh bounds a body. Where it bounds none, or a body of so many components that each has few
/// triangles already, edges are collapsed without regard to volume, and where that finds too little (triangles that do not
/// hang together), vertices that are near one another become one.
///
/// A mesh that has no more than `triangles` keeps all its triangles. In others coincident vertices count as one: the first of them is named.
#[must_use]
pub fn coarse_triangles(mesh: &Mesh, triangles: usize) -> Vec<[u32; 3]> {
    /// Twice as many are taken before shapes are given up for numbers.
    const SLACK: usize = 2;
    let is_few = |found: &[[u32; 3]]| found.len() <= SLACK * triangles;
    let all: Vec<[u32; 3]> = mesh.faces().iter().flat_map(fan).collect();
    if all.len() <= triangles {
        return all;
    }
    let topology = topology(mesh);
    if let Ok(solid) = Solid::new(mesh, &topology, OpenBoundaries::Cap) {
        let coarse = solid.coarse(mesh.points(), triangles);
        let surface: Vec<[u32; 3]> = (0..coarse.component_count()).flat_map(|c| coarse.surface_and_caps(c).0).collect();
        if is_few(&surface) {
            return surface;
        }
    }
    let welded = all.iter().map(|t| t.map(|v| topology.welded[v as usize]));
    let surface: Vec<[u32; 3]> = welded.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let Some(bounds) = mesh.bounds() else { return surface };
    let near = |p: &DVec3| ((*p - bounds.center()) / bounds.extent()).as_vec3().to_array();
    let points: Vec<[f32; 3]> = mesh.points().iter().map(near).collect();
    let collapsed = collapsed(&surface, &points, None, triangles).filter(|found| is_few(found));
    collapsed.or_else(|| clustered(&surface, &points, triangles)).unwrap_or(surface)
}

impl Solid {
    /// Number of triangles, those of virtual caps not counted.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        (0..self.component_count()).map(|c| self.surface_and_caps(c).0.len()).sum()
    }

    /// This body with about `triangles` triangles between some of its vertices, over the same vertices and in the same components;
    /// `points` (#vertices × 3) is the pose in which it is to look the same, rest or another. Vertices that are not needed any more
    /// have the gradient 0.
    ///
    /// The virtual caps are those of this body. Each component's volume in this pose is within [`tolerances::COARSE_VOLUME`] of what
    /// it was; components for which that takes more triangles than their share keep more. A body that has no more than
    /// `triangles` comes back as it is.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn coarse(&self, points: &[DVec3], triangles: usize) -> Self {
        assert_eq!(points.len(), self.vertex_count(), "one point for each vertex of the solid");
        let all = self.triangle_count();
        if all <= triangles {
            return self.clone();
        }
        let pieces = self.pieces(points);
        let surfaces = parallel::map(pieces.len(), |c| {
            let piece = &pieces[c];
            let share = (piece.surface.len() as f64 * triangles as f64 / all as f64).ceil() as usize;
            piece.simplified(share).unwrap_or_else(|| self.surface_and_caps(c).0)
        });
        self.resurfaced(&surfaces)
    }

    /// The components, each with vertices of its own.
    fn pieces(&self, points: &[DVec3]) -> Vec<Piece> {
        let welded = self.welded();
        let points = self.near_with_apexes(points);
        // Which component has numbered a vertex last, and how.
        let mut numbered = vec![(u32::MAX, 0); points.len()];
        let piece = |c: usize| {
            let (surface, caps) = self.surface_and_caps(c);
            let mut vertices = Vec::new();
            let mut number = |v: u32| {
                let v = welded.get(v as usize).copied().unwrap_or(v); // apexes are behind the vertices
                let slot = &mut numbered[v as usize];
                if slot.0 != c as u32 {
                    *slot = (c as u32, vertices.len() as u32);
                    vertices.push(v);
                }
                slot.1
            };
            let surface = surface.iter().map(|t| t.map(&mut number)).collect();
            let caps = caps.iter().map(|t| t.map(&mut number)).collect();
            let points = vertices.iter().map(|v| points[*v as usize]).collect();
            Piece { vertices, points, surface, caps }
        };
        (0..self.component_count()).map(piece).collect()
    }
}

/// Fewest triangles to ask for: those of a tetrahedron.
const FEWEST: usize = 4;

/// One component with vertices of its own, the apexes of its caps among them.
struct Piece {
    /// The vertices in the whole body.
    vertices: Vec<u32>,
    /// Where they are.
    points: Vec<DVec3>,
    surface: Vec<[u32; 3]>,
    caps: Vec<[u32; 3]>,
}

impl Piece {
    /// About `share` triangles or more that enclose nearly the same, in the numbers of the whole body. `None` where it takes all.
    fn simplified(&self, share: usize) -> Option<Vec<[u32; 3]>> {
        let bounds = Bounds::of(&self.points)?;
        let (center, extent) = (bounds.center(), bounds.extent());
        let near: Vec<DVec3> = self.points.iter().map(|p| (*p - center) / extent).collect();
        let volume = self.volume(&self.surface, &near);
        let single: Vec<[f32; 3]> = near.iter().map(|p| p.as_vec3().to_array()).collect();
        let mut held = vec![VertexFlags::EMPTY; single.len()];
        self.caps.as_flattened().iter().for_each(|v| held[*v as usize] = VertexFlags::LOCK);
        let mut share = share.max(FEWEST);
        while share < self.surface.len() {
            let surface = collapsed(&self.surface, &single, Some(&held), share)?;
            let error = (self.volume(&surface, &near) - volume).abs();
            if error <= tolerances::COARSE_VOLUME * volume.abs() && self.is_balanced(&surface) {
                return Some(surface.iter().map(|t| t.map(|v| self.vertices[v as usize])).collect());
            }
            share *= 2;
        }
        None
    }

    /// Volume of `surface` with the caps, in f64 without further care.
    fn volume(&self, surface: &[[u32; 3]], points: &[DVec3]) -> f64 {
        let determinant = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            a.dot(b.cross(c))
        };
        surface.iter().chain(&self.caps).map(determinant).sum::<f64>() / 6.0
    }

    /// Whether `surface` and the caps together run every edge as often in one direction as in the other.
    fn is_balanced(&self, surface: &[[u32; 3]]) -> bool {
        let sides = |[a, b, c]: &[u32; 3]| [[*a, *b], [*b, *c], [*c, *a]];
        let triangles = surface.iter().chain(&self.caps);
        let mut edges: Vec<([u32; 2], i32)> = triangles
            .flat_map(sides)
            .map(|[from, to]| if from < to { ([from, to], 1) } else { ([to, from], -1) })
            .collect();
        edges.sort_unstable();
        edges.chunk_by(|a, b| a.0 == b.0).all(|group| group.iter().map(|side| side.1).sum::<i32>() == 0)
    }
}

/// Largest error that is accepted, in extents: the number of triangles alone decides.
const ANY_ERROR: f32 = 1.0;

/// About `share` triangles instead of `surface` by collapsing edges. With `held` vertices boundaries are held too.
fn collapsed(
    surface: &[[u32; 3]],
    points: &[[f32; 3]],
    held: Option<&[VertexFlags]>,
    share: usize,
) -> Option<Vec<[u32; 3]>> {
    let no_attributes = Attributes::from_interleaved(&[], points.len(), 0, 0, 0).ok()?;
    let options = if held.is_some() { SimplifyOptions::LOCK_BORDER } else { SimplifyOptions::EMPTY };
    let settings = SimplifySettings { target_index_count: 3 * share, target_error: ANY_ERROR, options };
    let (indices, positions) = (surface.as_flattened(), Positions::from_packed(points));
    let simplified = simplify_with_attributes(indices, positions, no_attributes, &[], held, settings, &mut workspace());
    Some(simplified.ok()?.indices.as_chunks().0.to_vec())
}

/// At most `most` triangles instead of `surface` by putting vertices together.
fn clustered(surface: &[[u32; 3]], points: &[[f32; 3]], most: usize) -> Option<Vec<[u32; 3]>> {
    let (indices, positions) = (surface.as_flattened(), Positions::from_packed(points));
    let simplified = simplify_sloppy(indices, positions, None, 3 * most, ANY_ERROR, &mut workspace());
    Some(simplified.ok()?.indices.as_chunks().0.to_vec())
}

/// Without limits of its own.
fn workspace() -> Workspace {
    Workspace::new(Limits { max_bytes: usize::MAX, max_work: u64::MAX })
}
