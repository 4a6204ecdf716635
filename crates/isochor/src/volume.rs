//! The signed volume that a mesh encloses, and its gradient.
//!
//! `V(P) = 1/6 Σ det(p_l, p_m, p_n)` over the triangles (l, m, n), counter-clockwise seen from outside; HB (5) is the same
//! sum, grouped by prisms over the xy-plane. `∂V/∂p_v = 1/6 Σ (p_b − p_v) × (p_c − p_v)` over the triangles (v, b, c): a
//! third of their area vectors.
//!
//! The fact on which all corrections stand: if every vertex moves along *one* direction d, by s_v, then
//! `V(P + s dᵀ) = V(P) + Σ_v s_v (∂V/∂p_v · d)` **exactly**, however large s is (HB, section 5: (7)–(9) for d = x, y, z).
//!
//! Volumes are summed in doubled precision over coordinates taken relative to [`Bounds::lossless_origin`]: the result is
//! the exact volume of the stored coordinates to about one rounding, anywhere in space and for any number of threads.
//!
//! # Open meshes
//!
//! A boundary that the file leaves open is closed by a *virtual cap*: an apex at the mean of the boundary's vertices and a
//! fan from it to the boundary's edges. Caps are part of every volume, area and gradient here, and never written. As the
//! apex moves with the boundary, its share of the gradient goes back to the boundary's L vertices, 1/L each.
//!
//! HB = S. Hahmann, G.-P. Bonneau, S. Barbier, G. Elber, H. Hagen, *Volume-preserving FFD for programmable graphics
//! hardware*, The Visual Computer 28 (2012).

use std::borrow::Cow;
use std::ops::Range;

use glam::DVec3;

use crate::double::Double;
use crate::mesh::{Bounds, Mesh, fan};
use crate::parallel;
use crate::tolerances;
use crate::topology::{DisjointSets, Topology};

/// What to do about a mesh with boundaries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum OpenBoundaries {
    /// Close each boundary with a virtual cap.
    #[default]
    Cap,
    /// Refuse the mesh.
    Refuse,
}

/// A mesh as a bounded body: what is needed to measure the volume of any pose of it.
///
/// Positions are handed in with every call (#vertices × 3), so that one solid serves all poses.
#[derive(Clone, Debug)]
pub struct Solid {
    vertices: usize,
    /// Triangles of component after component, caps last within each. Indices from `vertices` on are cap apexes.
    triangles: Vec<[u32; 3]>,
    components: Vec<Range<usize>>,
    caps: Vec<Cap>,
    /// Triangles at vertex v: `incident[starts[v]..starts[v + 1]]`; apexes follow the vertices.
    incident_starts: Vec<u32>,
    incident: Vec<u32>,
    /// Pairs of vertices at one place at rest.
    twins: Vec<[u32; 2]>,
    /// Whether a vertex shares its place with another (#vertices).
    has_twin: Vec<bool>,
}

/// A boundary that is closed virtually.
#[derive(Clone, Debug)]
struct Cap {
    /// The vertices of the boundary, one for each place, ascending.
    members: Vec<u32>,
}

/// Signed volumes of a pose, in the cube of its length unit: positive where faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Volumes {
    /// The whole mesh: the sum of the components.
    pub total: f64,
    /// Each piece that hangs together through edges, in the order of its first face. A cavity is negative.
    pub components: Vec<f64>,
}

/// Why a mesh bounds no body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolidError {
    /// No face with three distinct corners.
    #[error("the model has no faces, so it encloses nothing")]
    NoFaces,
    /// The mesh has boundaries and these were to be refused.
    #[error(
        "the model is open: {boundary_edges} boundary edges in {boundary_loops} loops, the first from vertex {from} to \
         vertex {to} of face {face}"
    )]
    Open {
        /// Number of boundary edges.
        boundary_edges: usize,
        /// Number of boundary loops.
        boundary_loops: usize,
        /// Start of the first unbalanced edge.
        from: u32,
        /// End of the first unbalanced edge.
        to: u32,
        /// A face there.
        face: u32,
    },
    /// Two faces run along an edge in the same direction, so inside and outside are not defined.
    #[error(
        "faces are not wound consistently: {edges} edges are run {surplus} times more often in one direction than in the \
         other, the first from vertex {from} to vertex {to} of face {face}"
    )]
    Winding {
        /// Number of such edges.
        edges: usize,
        /// Surplus at the first of them.
        surplus: u32,
        /// Where that edge starts.
        from: u32,
        /// Where it ends.
        to: u32,
        /// A face that runs it in the surplus direction.
        face: u32,
    },
    /// All vertices at one place, or coordinates too large or too small for products of three.
    #[error("the extent of the model is {extent:e}: volumes need one between {:e} and {:e}", tolerances::EXTENTS.start(), tolerances::EXTENTS.end())]
    Extent {
        /// Longest side of the bounding box.
        extent: f64,
    },
}

impl Solid {
    /// The body that `mesh` bounds. `topology` is that of the same mesh ([`crate::topology`]).
    ///
    /// # Errors
    ///
    /// No faces; boundaries, if they are to be refused; inconsistent winding; an extent out of range.
    pub fn new(mesh: &Mesh, topology: &Topology, open: OpenBoundaries) -> Result<Self, SolidError> {
        if topology.components == 0 {
            return Err(SolidError::NoFaces);
        }
        let extent = mesh.bounds().map_or(0.0, |b| b.extent());
        if !tolerances::EXTENTS.contains(&extent) {
            return Err(SolidError::Extent { extent });
        }
        let mut twisted = topology.unbalanced.iter().filter(|edge| edge.surplus > 1);
        if let Some(first) = twisted.next() {
            return Err(SolidError::Winding {
                edges: 1 + twisted.count(),
                surplus: first.surplus,
                from: first.from,
                to: first.to,
                face: first.face,
            });
        }
        if let (OpenBoundaries::Refuse, Some(first)) = (open, topology.unbalanced.first()) {
            return Err(SolidError::Open {
                boundary_edges: topology.boundary_edges,
                boundary_loops: topology.boundary_loops,
                from: first.from,
                to: first.to,
                face: first.face,
            });
        }

        let vertices = mesh.points().len();
        let (caps, cap_triangles) = caps(topology, vertices);
        let welded = &topology.welded;
        let distinct = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| welded[v as usize]);
            a != b && b != c && c != a
        };
        let labelled = mesh.faces().iter().zip(&topology.component_of_face).filter(|(_, c)| **c != u32::MAX);
        let mut all: Vec<(u32, [u32; 3])> =
            labelled.flat_map(|(polygon, &c)| fan(polygon).filter(distinct).map(move |t| (c, t))).collect();
        all.extend(cap_triangles.iter().map(|(face, t)| (topology.component_of_face[*face as usize], *t)));
        all.sort_by_key(|(component, _)| *component); // stable: file order within a component
        let ends = (0..topology.components).map(|c| all.partition_point(|t| t.0 as usize <= c));
        let components = ends.scan(0, |start, end| Some(std::mem::replace(start, end)..end)).collect();
        let triangles: Vec<[u32; 3]> = all.into_iter().map(|(_, t)| t).collect();

        let (incident_starts, incident) = incidence(&triangles, vertices + caps.len());
        let twins: Vec<[u32; 2]> = (0..).zip(welded).filter(|(v, w)| v != *w).map(|(v, &w)| [w, v]).collect();
        let mut has_twin = vec![false; vertices];
        twins.iter().flatten().for_each(|v: &u32| has_twin[*v as usize] = true);
        Ok(Self { vertices, triangles, components, caps, incident_starts, incident, twins, has_twin })
    }

    /// Number of vertices that every pose must have.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.vertices
    }

    /// Number of virtual caps.
    #[must_use]
    pub fn cap_count(&self) -> usize {
        self.caps.len()
    }

    /// Number of pieces that hang together through edges.
    #[must_use]
    pub fn component_count(&self) -> usize {
        self.components.len()
    }

    /// Vertices that stood at one place at rest and stand apart in `points` (#vertices × 3): there the surface is torn
    /// and encloses no defined volume. The first such pair.
    #[must_use]
    pub fn torn_vertices(&self, points: &[DVec3]) -> Option<[u32; 2]> {
        self.twins.iter().copied().find(|[a, b]| points[*a as usize] != points[*b as usize])
    }

    /// Whether vertex `v` stood at one place with another at rest.
    pub(crate) fn has_twin(&self, v: usize) -> bool {
        self.has_twin[v]
    }

    /// Signed volumes of the pose `points` (#vertices × 3), caps included.
    ///
    /// The error is about one rounding of the result, wherever the points are.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn volumes(&self, points: &[DVec3]) -> Volumes {
        let points = self.near_with_apexes(points);
        // Fixed chunks within each component.
        let chunks: Vec<(usize, Range<usize>)> = self
            .components
            .iter()
            .enumerate()
            .flat_map(|(c, range)| {
                range.clone().step_by(parallel::CHUNK).map(move |i| (c, i..range.end.min(i + parallel::CHUNK)))
            })
            .collect();
        let parts = parallel::map(chunks.len(), |k| {
            let mut sum = Double::default();
            for t in &self.triangles[chunks[k].1.clone()] {
                sum += determinant(t.map(|v| points[v as usize]));
            }
            sum
        });
        let mut total = Double::default();
        let mut components = vec![Double::default(); self.components.len()];
        for ((c, _), part) in chunks.iter().zip(parts) {
            components[*c] += part;
            total += part;
        }
        Volumes { total: total.value() / 6.0, components: components.iter().map(|v| v.value() / 6.0).collect() }
    }

    /// Signed volume of the pose `points`: [`Volumes::total`].
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn volume(&self, points: &[DVec3]) -> f64 {
        self.volumes(points).total
    }

    /// `g = ∂V/∂P` (#vertices × 3) at the pose `points`: a third of the area vectors of the incident faces and caps,
    /// pointing outwards. HB (10)–(12) are `Wᵀ g`.
    ///
    /// At vertices that share a place the sum over them is meant.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn volume_gradient(&self, points: &[DVec3]) -> Vec<DVec3> {
        let points = self.near_with_apexes(points);
        self.gathered(|t| doubled_area_vector(t, &points))
    }

    /// The second derivative `∇²V · q` (#vertices × 3) at the pose `points` along the displacement `q` (both #vertices × 3): how
    /// [`Solid::volume_gradient`] changes to first order.
    ///
    /// # Panics
    ///
    /// Panics where the number of points or displacements is not the number of vertices.
    #[must_use]
    pub fn volume_gradient_change(&self, points: &[DVec3], q: &[DVec3]) -> Vec<DVec3> {
        let (points, q) = (self.near_with_apexes(points), self.near_with_apexes(q));
        self.gathered(|[a, b, c]| {
            let edges = |x: &[DVec3]| (x[b as usize] - x[a as usize], x[c as usize] - x[a as usize]);
            let ((pb, pc), (qb, qc)) = (edges(&points), edges(&q));
            qb.cross(pc) + pb.cross(qc)
        })
    }

    /// A sixth of the sum over the triangles at each vertex (#vertices × 3); what belongs to apexes goes back to their members.
    fn gathered(&self, of_triangle: impl Fn([u32; 3]) -> DVec3 + Send + Sync) -> Vec<DVec3> {
        let vectors = parallel::collect(self.triangles.len(), |t| of_triangle(self.triangles[t]));
        let sixth = |v: usize| {
            let incident = &self.incident[self.incident_starts[v] as usize..self.incident_starts[v + 1] as usize];
            incident.iter().map(|&t| vectors[t as usize]).sum::<DVec3>() / 6.0
        };
        let mut sums = parallel::collect(self.vertices, sixth);
        for (c, cap) in self.caps.iter().enumerate() {
            let share = sixth(self.vertices + c) / cap.members.len() as f64;
            for &v in &cap.members {
                sums[v as usize] += share;
            }
        }
        sums
    }

    /// Surface area of the pose `points` (#vertices × 3), caps included.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn area(&self, points: &[DVec3]) -> f64 {
        let points = self.near_with_apexes(points);
        let parts = parallel::map_chunks(self.triangles.len(), parallel::CHUNK, |range| {
            self.triangles[range].iter().map(|t| doubled_area_vector(*t, &points).length()).sum::<f64>()
        });
        parts.iter().sum::<f64>() / 2.0
    }

    /// Whether a volume is so small for this pose's area and extent that it is rounding noise ([`tolerances::NO_VOLUME`]).
    #[must_use]
    pub fn encloses_nothing(&self, points: &[DVec3], volume: f64) -> bool {
        let extent = Bounds::of(points).map_or(0.0, |b| b.extent());
        volume.abs() <= tolerances::NO_VOLUME * self.area(points) * extent
    }

    /// The points relative to an origin near them, which does not round, followed by the apexes of the caps.
    pub(crate) fn near_with_apexes<'a>(&self, points: &'a [DVec3]) -> Cow<'a, [DVec3]> {
        assert_eq!(points.len(), self.vertices, "one point for each vertex of the solid");
        let origin = Bounds::of(points).map_or(DVec3::ZERO, |b| b.lossless_origin());
        if self.caps.is_empty() && origin == DVec3::ZERO {
            return Cow::Borrowed(points);
        }
        let mut near = Vec::with_capacity(points.len() + self.caps.len());
        near.extend(points.iter().map(|p| *p - origin));
        for cap in &self.caps {
            let sum: DVec3 = cap.members.iter().map(|&v| near[v as usize]).sum();
            near.push(sum / cap.members.len() as f64);
        }
        Cow::Owned(near)
    }

    /// The triangles of component `c` without those of its caps, and those of its caps.
    pub(crate) fn component(&self, c: usize) -> (&[[u32; 3]], &[[u32; 3]]) {
        let triangles = &self.triangles[self.components[c].clone()];
        let caps = triangles.iter().rev().take_while(|t| t[2] as usize >= self.vertices).count();
        triangles.split_at(triangles.len() - caps)
    }

    /// For each vertex the first at the same place at rest (#vertices).
    pub(crate) fn welded(&self) -> Vec<u32> {
        let mut welded: Vec<u32> = (0..self.vertices as u32).collect();
        self.twins.iter().for_each(|[first, v]| welded[*v as usize] = *first);
        welded
    }

    /// The same body with other triangles: those of each component in order. Its caps stay.
    pub(crate) fn resurfaced(&self, surfaces: &[Vec<[u32; 3]>]) -> Self {
        let (mut triangles, mut components) = (Vec::new(), Vec::new());
        for (c, surface) in surfaces.iter().enumerate() {
            let start = triangles.len();
            triangles.extend_from_slice(surface);
            triangles.extend_from_slice(self.component(c).1);
            components.push(start..triangles.len());
        }
        let (incident_starts, incident) = incidence(&triangles, self.vertices + self.caps.len());
        let (caps, twins, has_twin) = (self.caps.clone(), self.twins.clone(), self.has_twin.clone());
        Self { vertices: self.vertices, triangles, components, caps, incident_starts, incident, twins, has_twin }
    }

    /// The same body over those vertices alone that its triangles name, and which these are (ascending): for a
    /// [`Solid::coarse`] one, whose other vertices do not count.
    #[must_use]
    pub fn compacted(&self) -> (Self, Vec<u32>) {
        let mut number = vec![u32::MAX; self.vertices + self.caps.len()];
        self.triangles.as_flattened().iter().for_each(|v| number[*v as usize] = 0);
        let named: Vec<u32> = (0..number.len() as u32).filter(|v| number[*v as usize] == 0).collect();
        (0..).zip(&named).for_each(|(n, v)| number[*v as usize] = n);
        let vertices = named.partition_point(|v| (*v as usize) < self.vertices);
        let renumbered = |v: &u32| number[*v as usize];
        let triangles: Vec<[u32; 3]> = self.triangles.iter().map(|t| t.each_ref().map(renumbered)).collect();
        let cap = |cap: &Cap| Cap { members: cap.members.iter().map(renumbered).collect() };
        let twins =
            self.twins.iter().map(|pair| pair.each_ref().map(renumbered)).filter(|pair| !pair.contains(&u32::MAX));
        let (incident_starts, incident) = incidence(&triangles, named.len());
        let solid = Self {
            vertices,
            triangles,
            components: self.components.clone(),
            caps: self.caps.iter().map(cap).collect(),
            incident_starts,
            incident,
            twins: twins.collect(),
            has_twin: named[..vertices].iter().map(|v| self.has_twin[*v as usize]).collect(),
        };
        (solid, named[..vertices].to_vec())
    }
}

/// `(b − a) × (c − a)`: twice the area vector of a triangle.
#[inline]
fn doubled_area_vector([a, b, c]: [u32; 3], points: &[DVec3]) -> DVec3 {
    let p = points[a as usize];
    (points[b as usize] - p).cross(points[c as usize] - p)
}

/// `det(a, b, c)` in doubled precision.
#[inline]
fn determinant([a, b, c]: [DVec3; 3]) -> Double {
    let minor = |p: usize, q: usize| Double::product(b[p], c[q]) - Double::product(b[q], c[p]);
    minor(1, 2) * a.x + minor(2, 0) * a.y + minor(0, 1) * a.z
}

/// One cap for each connected piece of the unbalanced edges, and its triangles, each with the face whose edge it closes.
fn caps(topology: &Topology, vertices: usize) -> (Vec<Cap>, Vec<(u32, [u32; 3])>) {
    if topology.unbalanced.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let mut pieces = DisjointSets::new(vertices);
    for edge in &topology.unbalanced {
        pieces.union(edge.from, edge.to);
    }
    let mut members: Vec<(u32, u32)> =
        topology.unbalanced.iter().flat_map(|e| [e.from, e.to]).map(|v| (pieces.root(v), v)).collect();
    members.sort_unstable();
    members.dedup();
    let groups: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
    let triangles = topology
        .unbalanced
        .iter()
        .map(|edge| {
            let root = pieces.root(edge.from);
            let cap = groups.partition_point(|group| group[0].0 < root);
            (edge.face, [edge.to, edge.from, (vertices + cap) as u32])
        })
        .collect();
    (groups.iter().map(|group| Cap { members: group.iter().map(|m| m.1).collect() }).collect(), triangles)
}

/// The triangles at each vertex, as starts and one list.
fn incidence(triangles: &[[u32; 3]], vertices: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; vertices + 1];
    for &v in triangles.as_flattened() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..vertices {
        starts[v + 1] += starts[v];
    }
    let mut next = starts.clone();
    let mut incident = vec![0; triangles.len() * 3];
    for (t, triangle) in (0..).zip(triangles) {
        for &v in triangle {
            incident[next[v as usize] as usize] = t;
            next[v as usize] += 1;
        }
    }
    (starts, incident)
}
