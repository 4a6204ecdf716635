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
use std::sync::OnceLock;

use fearless_simd::{Level, dispatch};
use glam::DVec3;

use crate::double::{Double, is_fused};
use crate::mesh::{Bounds, Mesh, fan};
use crate::order;
use crate::parallel;
use crate::spare::Spare;
use crate::sweep::{self, PackedSum};
use crate::tolerances;
use crate::topology::{DisjointSets, Topology};
use crate::triangles::Triangles;

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
    triangles: Triangles,
    components: Vec<Range<usize>>,
    caps: Vec<Cap>,
    /// Known from the first gradient on.
    touching: OnceLock<Touching>,
    /// Pairs of vertices at one place at rest.
    twins: Vec<[u32; 2]>,
    /// Whether a vertex shares its place with another (#vertices; empty where none does).
    has_twin: Vec<bool>,
}

/// Triangles by the parts of the vertices that they touch.
#[derive(Clone, Debug)]
struct Touching {
    /// Vertices per part. Larger: fewer triangles lie across the border of two parts, and are computed twice; smaller: better balance
    /// between threads.
    part: usize,
    /// Those of part b, the vertices `part · b ..`, are `triangles[starts[b]..starts[b + 1]]`, ascending.
    starts: Vec<u32>,
    triangles: Vec<u32>,
    /// For sums over them.
    sums: Spare<PackedSum>,
}

/// A boundary that is closed virtually.
#[derive(Clone, Debug)]
struct Cap {
    /// The vertices of the boundary, one for each place, in a fixed order.
    members: Vec<u32>,
    /// The triangles of the fan, ascending. The apex comes last in each.
    fan: Vec<u32>,
}

/// Rounded, for gradients: products are much faster than divisions.
const SIXTH: f64 = 1.0 / 6.0;

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
        check(mesh, topology, open)?;
        let vertices = mesh.points().len();
        let (caps, cap_triangles) = caps(topology, vertices);
        let (triangles, components) = by_component(mesh, topology, &cap_triangles);
        let welded = &topology.welded;
        let twins: Vec<[u32; 2]> = (0..).zip(welded).filter(|(v, w)| v != *w).map(|(v, &w)| [w, v]).collect();
        let mut has_twin = vec![false; if twins.is_empty() { 0 } else { vertices }];
        twins.iter().flatten().for_each(|v: &u32| has_twin[*v as usize] = true);
        Ok(Self::indexed(Self { vertices, triangles, components, caps, touching: OnceLock::new(), twins, has_twin }))
    }

    /// Fills in what follows from the triangles: the fans of the caps.
    fn indexed(mut self) -> Self {
        if !self.caps.is_empty() {
            for (t, [_, _, apex]) in (0..).zip(&*self.triangles) {
                if let Some(cap) = (*apex as usize).checked_sub(self.vertices) {
                    self.caps[cap].fan.push(t);
                }
            }
        }
        self
    }

    /// This solid with its vertices in another order: vertex i of the result is vertex `order[i]` of this one. Within each component
    /// the triangles follow the new order too, so that neighbours lie close together in memory.
    ///
    /// # Panics
    ///
    /// Panics where `order` is not a permutation of the vertices.
    #[must_use]
    pub fn permuted(&self, order: &[u32]) -> Self {
        assert_eq!(order.len(), self.vertices, "one entry for each vertex of the solid");
        let places = order::places(order);
        let place = |v: u32| places.get(v as usize).copied().unwrap_or(v); // apexes stay
        let triangles = &*self.triangles;
        let least = |t: usize| triangles[t].map(place).into_iter().min().unwrap_or_default();
        let mut by_vertex = order::ascending(&parallel::collect(triangles.len(), least), self.vertices);
        if self.components.len() > 1 {
            let mut component = vec![0; triangles.len()];
            for (c, range) in (0..).zip(&self.components) {
                component[range.clone()].fill(c);
            }
            let keys = parallel::collect(triangles.len(), |i| component[by_vertex[i] as usize]);
            let by_component = order::ascending(&keys, self.components.len());
            by_vertex = parallel::collect(triangles.len(), |i| by_vertex[by_component[i] as usize]);
        }
        let ordered = parallel::collect(triangles.len(), |i| triangles[by_vertex[i] as usize].map(place));
        let cap = |cap: &Cap| Cap { members: cap.members.iter().map(|&v| place(v)).collect(), fan: Vec::new() };
        Self::indexed(Self {
            vertices: self.vertices,
            triangles: ordered.into(),
            components: self.components.clone(),
            caps: self.caps.iter().map(cap).collect(),
            touching: OnceLock::new(),
            twins: self.twins.iter().map(|pair| pair.map(place)).collect(),
            has_twin: self.twins_among(order),
        })
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

    /// Bytes of its arrays: 12 for each triangle, 4 for each in the list of a part of the vertices, and what caps and coincident
    /// vertices take.
    #[must_use]
    pub fn memory(&self) -> usize {
        let caps: usize = self.caps.iter().map(|cap| size_of_val(&cap.members[..]) + size_of_val(&cap.fan[..])).sum();
        let triangles = size_of_val(&self.triangles[..]) + size_of_val(&self.components[..]);
        let touching = self.touching();
        let lists = size_of_val(&touching.starts[..]) + size_of_val(&touching.triangles[..]);
        triangles + lists + caps + size_of_val(&self.twins[..]) + size_of_val(&self.has_twin[..])
    }

    /// Vertices that stood at one place at rest and stand apart in `points` (#vertices × 3): there the surface is torn
    /// and encloses no defined volume. The first such pair.
    #[must_use]
    pub fn torn_vertices(&self, points: &[DVec3]) -> Option<[u32; 2]> {
        self.twins.iter().copied().find(|[a, b]| points[*a as usize] != points[*b as usize])
    }

    /// Whether vertex `v` stood at one place with another at rest.
    pub(crate) fn has_twin(&self, v: usize) -> bool {
        self.has_twin.get(v).is_some_and(|has| *has)
    }

    /// [`Solid::has_twin`] of each of `vertices`; empty where no vertex has one.
    fn twins_among(&self, vertices: &[u32]) -> Vec<bool> {
        let among = if self.twins.is_empty() { &[] } else { vertices };
        among.iter().map(|v| self.has_twin[*v as usize]).collect()
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
            .flat_map(|(c, range)| chunks(range).map(move |chunk| (c, chunk)))
            .collect();
        let level = Level::new();
        let parts = parallel::map(chunks.len(), |k| {
            let triangles = &self.triangles[chunks[k].1.clone()];
            dispatch!(level, simd => match is_fused(simd) {
                true => sweep::determinants::<_, true>(simd, triangles, &points),
                false => sweep::determinants::<_, false>(simd, triangles, &points),
            })
        });
        self.volumes_of(chunks.iter().map(|(c, _)| *c).zip(parts))
    }

    /// The volumes of sums of determinants, each of triangles of one component.
    fn volumes_of(&self, determinants: impl Iterator<Item = (usize, Double)>) -> Volumes {
        let mut total = Double::default();
        let mut components = vec![Double::default(); self.components.len()];
        for (c, part) in determinants {
            components[c] += part;
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
        let mut gradient = Vec::new();
        self.gradient_into(points, None, &mut gradient);
        gradient
    }

    /// `Σ_c w_c ∂V_c/∂P` (#vertices × 3) at the pose `points`, with one weight per component, in the order of
    /// [`Volumes::components`]. With all weights 1 it is [`Solid::volume_gradient`].
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices, or that of weights not that of components.
    #[must_use]
    pub fn weighted_gradient(&self, points: &[DVec3], weights: &[f64]) -> Vec<DVec3> {
        let mut gradient = Vec::new();
        self.gradient_into(points, Some(weights), &mut gradient);
        gradient
    }

    /// [`Solid::weighted_gradient`] in the memory of `out`; without weights [`Solid::volume_gradient`].
    pub(crate) fn gradient_into(&self, points: &[DVec3], weights: Option<&[f64]>, out: &mut Vec<DVec3>) {
        let points = self.near_with_apexes(points);
        self.gather(weights, out, |t| doubled_area_vector(t, &points));
    }

    /// The volumes of the pose `points` and, of the gradient of their sum, what `of_part(vertices, g)` makes of its fixed parts while they
    /// are near the processor, in order. Without what caps share out: there must be none.
    pub(crate) fn survey<R: Send>(
        &self,
        points: &[DVec3],
        of_part: impl Fn(Range<usize>, &PartGradient) -> R + Send + Sync,
    ) -> (Volumes, Vec<R>) {
        let level = Level::new();
        let add = |points: &[DVec3], first: usize, sums: &mut [PackedSum]| {
            let (triangles, runs) = (&self.triangles[..], self.runs(first));
            let determinants = runs.map(|(component, run)| {
                let sum = dispatch!(level, simd => match is_fused(simd) {
                    true => sweep::add_area_vectors_and_determinants::<_, true>(simd, triangles, run, points, first, sums),
                    false => sweep::add_area_vectors_and_determinants::<_, false>(simd, triangles, run, points, first, sums),
                });
                (component, sum)
            });
            determinants.collect::<Vec<_>>()
        };
        let of_parts = self.gradient_parts(points, add, |determinants, part, g| (determinants, of_part(part, g)));
        let (determinants, of_parts): (Vec<_>, Vec<R>) = of_parts.into_iter().unzip();
        (self.volumes_of(determinants.into_iter().flatten()), of_parts)
    }

    /// [`Solid::survey`] without the volumes.
    pub(crate) fn slope_survey<R: Send>(
        &self,
        points: &[DVec3],
        of_part: impl Fn(Range<usize>, &PartGradient) -> R + Send + Sync,
    ) -> Vec<R> {
        let level = Level::new();
        let add = |points: &[DVec3], first: usize, sums: &mut [PackedSum]| {
            let list = self.triangles_at(first);
            dispatch!(level, simd => sweep::add_area_vectors(simd, &self.triangles, list, points, first, sums));
        };
        self.gradient_parts(points, add, |(), part, g| of_part(part, g))
    }

    /// For each part of the vertices `finish(what add returns, part, g)`, g the part's share of the volume's gradient: `add(points, first,
    /// sums)` adds six times as much to the sums of the part's vertices, which are those from `first` on.
    fn gradient_parts<A, R: Send>(
        &self,
        points: &[DVec3],
        add: impl Fn(&[DVec3], usize, &mut [PackedSum]) -> A + Send + Sync,
        finish: impl Fn(A, Range<usize>, &PartGradient) -> R + Send + Sync,
    ) -> Vec<R> {
        debug_assert!(self.caps.is_empty(), "a body without caps");
        let points = self.near_with_apexes(points);
        let touching = self.touching(); // threads do not wait for one another
        parallel::map_chunks(self.vertices, touching.part, |part| {
            let mut scratch = touching.sums.array();
            let sums = scratch.memory();
            sums.clear();
            sums.resize(part.len(), PackedSum::default());
            let added = add(&points, part.start, sums);
            finish(added, part, &PartGradient(sums))
        })
    }

    /// This solid with all that is otherwise made when it is first needed.
    pub(crate) fn ready(self) -> Self {
        self.touching();
        self
    }

    fn touching(&self) -> &Touching {
        self.touching.get_or_init(|| Touching::of(&self.triangles, self.vertices))
    }

    /// The triangles that touch the part of the vertices that begins with `first`, ascending.
    fn triangles_at(&self, first: usize) -> &[u32] {
        let Touching { part, starts, triangles, .. } = self.touching();
        let part = first / part;
        &triangles[starts[part] as usize..starts[part + 1] as usize]
    }

    /// The same, component by component.
    fn runs(&self, first: usize) -> impl Iterator<Item = (usize, &[u32])> {
        let mut rest = self.triangles_at(first);
        std::iter::from_fn(move || {
            let first = *rest.first()? as usize;
            let component = self.components.partition_point(|range| range.end <= first);
            let end = self.components[component].end;
            let (run, others) = rest.split_at(rest.partition_point(|t| (*t as usize) < end));
            rest = others;
            Some((component, run))
        })
    }

    /// Gives each vertex of a cap its share of what belongs to the apex.
    fn share_of_caps(&self, weights: Option<&[f64]>, sums: &mut [DVec3], of_triangle: impl Fn([u32; 3]) -> DVec3) {
        for cap in &self.caps {
            let Some(first) = cap.fan.first() else { continue };
            let component = self.components.partition_point(|range| range.end <= *first as usize);
            let weight = weights.map_or(1.0, |w| w[component]);
            let of_apex: DVec3 = cap.fan.iter().map(|t| of_triangle(self.triangles[*t as usize]) * weight).sum();
            let share = of_apex * SIXTH / cap.members.len() as f64;
            for &v in &cap.members {
                sums[v as usize] += share;
            }
        }
    }

    /// The second derivative `∇²V · q` (#vertices × 3) at the pose `points` along the displacement `q` (both #vertices × 3): how
    /// [`Solid::volume_gradient`] changes to first order.
    ///
    /// # Panics
    ///
    /// Panics where the number of points or displacements is not the number of vertices.
    #[must_use]
    pub fn volume_gradient_change(&self, points: &[DVec3], q: &[DVec3]) -> Vec<DVec3> {
        let mut change = Vec::new();
        self.gradient_change_into(points, q, None, &mut change);
        change
    }

    /// `Σ_c w_c ∇²V_c · q` (#vertices × 3): how [`Solid::weighted_gradient`] changes along `q`.
    ///
    /// # Panics
    ///
    /// Panics where the number of points or displacements is not the number of vertices, or that of weights not that of
    /// components.
    #[must_use]
    pub fn weighted_gradient_change(&self, points: &[DVec3], q: &[DVec3], weights: &[f64]) -> Vec<DVec3> {
        let mut change = Vec::new();
        self.gradient_change_into(points, q, Some(weights), &mut change);
        change
    }

    /// [`Solid::weighted_gradient_change`] in the memory of `out`; without weights [`Solid::volume_gradient_change`].
    pub(crate) fn gradient_change_into(
        &self,
        points: &[DVec3],
        q: &[DVec3],
        weights: Option<&[f64]>,
        out: &mut Vec<DVec3>,
    ) {
        let (points, q) = (self.near_with_apexes(points), self.near_with_apexes(q));
        self.gather(weights, out, |[a, b, c]| {
            let edges = |x: &[DVec3]| (x[b as usize] - x[a as usize], x[c as usize] - x[a as usize]);
            let ((pb, pc), (qb, qc)) = (edges(&points), edges(&q));
            qb.cross(pc) + pb.cross(qc)
        });
    }

    /// A sixth of the sum over the triangles at each vertex (#vertices × 3), each times the weight of its component; what belongs to
    /// apexes goes back to their members.
    fn gather(
        &self,
        weights: Option<&[f64]>,
        sums: &mut Vec<DVec3>,
        of_triangle: impl Fn([u32; 3]) -> DVec3 + Send + Sync,
    ) {
        assert!(weights.is_none_or(|w| w.len() == self.components.len()), "one weight for each component of the solid");
        let Touching { part, .. } = *self.touching(); // threads do not wait for one another
        let triangles = &*self.triangles;
        parallel::resize(sums, self.vertices);
        parallel::for_each_chunk(sums, part, |first, sums| {
            sums.fill(DVec3::ZERO);
            for (component, run) in self.runs(first) {
                let weight = weights.map_or(1.0, |w| w[component]);
                for triangle in run.iter().map(|t| triangles[*t as usize]) {
                    let vector = of_triangle(triangle) * weight;
                    for v in triangle {
                        if let Some(sum) = sums.get_mut((v as usize).wrapping_sub(first)) {
                            *sum += vector;
                        }
                    }
                }
            }
            sums.iter_mut().for_each(|sum| *sum *= SIXTH);
        });
        self.share_of_caps(weights, sums, of_triangle);
    }

    /// `a₂` and `a₃` of the cubic `V(x + t d) = V + a₁ t + a₂ t² + a₃ t³`, the volume of some components along a straight way of the vertices
    /// (both #vertices × 3), each with the sum of the magnitudes of its terms.
    ///
    /// V is a symmetric trilinear form T(x, x, x) with gradient 3 T(x, x, ·): `a₂ = Σ_v g(d)_v · x_v` and `a₃ = Σ_v g(d)_v · d_v / 3`.
    pub(crate) fn bends(&self, x: &[DVec3], d: &[DVec3], is_counted: impl Fn(usize) -> bool) -> [(f64, f64); 2] {
        let (x, d) = (self.near_with_apexes(x), self.near_with_apexes(d));
        let chunks: Vec<Range<usize>> =
            (0..self.components.len()).filter(|c| is_counted(*c)).flat_map(|c| chunks(&self.components[c])).collect();
        let level = Level::new();
        let parts = parallel::map(chunks.len(), |k| {
            let triangles = &self.triangles[chunks[k].clone()];
            dispatch!(level, simd => sweep::area_products(simd, triangles, &x, &d))
        });
        let mut sums = [(0.0, 0.0); 2];
        for part in parts {
            sums.iter_mut().zip(part).for_each(|(sum, part)| *sum = (sum.0 + part.0, sum.1 + part.1));
        }
        let [with_x, with_d] = sums;
        [(with_x.0 / 6.0, with_x.1 / 6.0), (with_d.0 / 18.0, with_d.1 / 18.0)]
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
        encloses_nothing(volume, self.triangles.len(), extent, || self.area(points))
    }

    /// The body over `clusters` of vertices: `cluster_of[cell_of[v]]` is that of vertex v. Each cell is one cluster. Triangles that collapse
    /// are dropped.
    pub(crate) fn clustered(&self, cell_of: &[u32], cluster_of: &[u32], clusters: usize) -> Self {
        let cells = cluster_of.len();
        // Apexes are clusters of their own.
        let cell = |v: u32| match cell_of.get(v as usize) {
            Some(cell) => *cell,
            None => (cells + (v as usize - self.vertices)) as u32,
        };
        let cluster = |cell: u32| match cluster_of.get(cell as usize) {
            Some(cluster) => *cluster,
            None => (clusters + (cell as usize - cells)) as u32,
        };
        let mut triangles = Vec::new();
        let mut components = Vec::with_capacity(self.components.len());
        for range in &self.components {
            let start = triangles.len();
            let of_component = &self.triangles[range.clone()];
            let left = parallel::map_chunks(of_component.len(), parallel::CHUNK, |chunk| -> Vec<[u32; 3]> {
                let in_cells = of_component[chunk].iter().map(|t| t.map(cell));
                in_cells.filter(|[a, b, c]| a != b && b != c && c != a).map(|t| t.map(cluster)).collect()
            });
            left.iter().for_each(|of_chunk| triangles.extend(of_chunk));
            components.push(start..triangles.len());
        }
        let members = |cap: &Cap| {
            let mut members: Vec<u32> = cap.members.iter().map(|v| cluster(cell(*v))).collect();
            members.sort_unstable();
            members.dedup();
            Cap { members, fan: Vec::new() }
        };
        Self::indexed(Self {
            vertices: clusters,
            triangles: triangles.into(),
            components,
            caps: self.caps.iter().map(members).collect(),
            touching: OnceLock::new(),
            twins: Vec::new(),
            has_twin: Vec::new(),
        })
    }

    /// The points relative to an origin near them, which does not round, followed by the apexes of the caps.
    pub(crate) fn near_with_apexes<'a>(&self, points: &'a [DVec3]) -> Cow<'a, [DVec3]> {
        assert_eq!(points.len(), self.vertices, "one point for each vertex of the solid");
        let origin = lossless_origin(points);
        if self.caps.is_empty() && origin == DVec3::ZERO {
            return Cow::Borrowed(points);
        }
        let near = |v: usize| points.get(v).map_or(DVec3::ZERO, |p| *p - origin);
        let mut near = parallel::collect(points.len() + self.caps.len(), near);
        for (c, cap) in self.caps.iter().enumerate() {
            let sum: DVec3 = cap.members.iter().map(|&v| near[v as usize]).sum();
            near[self.vertices + c] = sum / cap.members.len() as f64;
        }
        Cow::Owned(near)
    }

    /// Triangles of component `c`, caps included; their indices from the number of vertices on are apexes of caps.
    pub(crate) fn triangles_of(&self, c: usize) -> &[[u32; 3]] {
        &self.triangles[self.components[c].clone()]
    }

    /// The triangles of all components, caps included.
    pub(crate) fn all_triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Of each component where its triangles are in [`Solid::all_triangles`].
    pub(crate) fn component_ranges(&self) -> &[Range<usize>] {
        &self.components
    }

    /// The vertices of each cap, whose mean its apex is.
    pub(crate) fn cap_members(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.caps.iter().map(|cap| &cap.members[..])
    }

    /// The points relative to an origin near them, followed by the apexes of the caps.
    pub(crate) fn points_with_apexes<'a>(&self, points: &'a [DVec3]) -> Cow<'a, [DVec3]> {
        self.near_with_apexes(points)
    }

    /// The triangles of component `c` without those of its caps, and those of its caps.
    pub(crate) fn surface_and_caps(&self, c: usize) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
        self.triangles_of(c).iter().partition(|[_, _, last]| (*last as usize) < self.vertices)
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
            triangles.extend(self.surface_and_caps(c).1);
            components.push(start..triangles.len());
        }
        let cap = |cap: &Cap| Cap { members: cap.members.clone(), fan: Vec::new() };
        Self::indexed(Self {
            vertices: self.vertices,
            triangles: triangles.into(),
            components,
            caps: self.caps.iter().map(cap).collect(),
            touching: OnceLock::new(),
            twins: self.twins.clone(),
            has_twin: self.has_twin.clone(),
        })
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
        let cap = |cap: &Cap| Cap { members: cap.members.iter().map(renumbered).collect(), fan: Vec::new() };
        let twins =
            self.twins.iter().map(|pair| pair.each_ref().map(renumbered)).filter(|pair| !pair.contains(&u32::MAX));
        let solid = Self::indexed(Self {
            vertices,
            triangles: triangles.into(),
            components: self.components.clone(),
            caps: self.caps.iter().map(cap).collect(),
            touching: OnceLock::new(),
            twins: twins.collect(),
            has_twin: self.twins_among(&named[..vertices]),
        });
        (solid, named[..vertices].to_vec())
    }
}

/// Whether `volume` is rounding noise for a surface of that area, of so many triangles in a box of that extent.
pub(crate) fn encloses_nothing(volume: f64, triangles: usize, extent: f64, area: impl FnOnce() -> f64) -> bool {
    // No triangle in a cube is larger than one of its sides, so most bodies need no area.
    let most = triangles as f64 * extent * extent;
    let is_noise = |area: f64| volume.abs() <= tolerances::NO_VOLUME * area * extent;
    (is_noise(most) || !most.is_finite()) && is_noise(area())
}

/// [`Bounds::lossless_origin`] of the points.
pub(crate) fn lossless_origin(points: &[DVec3]) -> DVec3 {
    /// Points of a first look. More: a longer look; fewer: it decides less often.
    const SAMPLE: usize = 256;
    let origin = |bounds: Option<Bounds>| bounds.map_or(DVec3::ZERO, |b| b.lossless_origin());
    // Where some of the points span a box too wide for an origin other than 0, so do all of them.
    let sample: Vec<DVec3> = points.iter().step_by(points.len() / SAMPLE + 1).copied().collect();
    if origin(Bounds::of(&sample)) == DVec3::ZERO {
        return DVec3::ZERO;
    }
    origin(Bounds::of(points))
}

/// ∂V/∂P of some vertices.
pub(crate) struct PartGradient<'a>(&'a [PackedSum]);

impl PartGradient<'_> {
    /// ∂V/∂p of the i-th of them.
    #[inline(always)]
    pub(crate) fn at(&self, i: usize) -> DVec3 {
        sweep::unpacked(self.0[i]) * SIXTH
    }

    /// One after the other.
    pub(crate) fn iter(&self) -> impl Iterator<Item = DVec3> {
        (0..self.0.len()).map(|i| self.at(i))
    }
}

/// Σ |g|₁ and Σ g · p.
pub(crate) fn spread_and_products(g: impl Iterator<Item = DVec3>, p: &[DVec3]) -> [f64; 2] {
    let (mut spread, mut products) = (DVec3::ZERO, DVec3::ZERO);
    for (g, p) in g.zip(p) {
        spread += g.abs();
        products += g * *p;
    }
    [spread.element_sum(), products.element_sum()]
}

/// Fixed chunks of the triangles of a component.
fn chunks(range: &Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
    let (end, chunk) = (range.end, parallel::chunk(range.len()));
    range.clone().step_by(chunk).map(move |i| i..end.min(i + chunk))
}

/// `(b − a) × (c − a)`: twice the area vector of a triangle.
#[inline]
fn doubled_area_vector(triangle: [u32; 3], points: &[DVec3]) -> DVec3 {
    sweep::doubled_area_vector(triangle.map(|v| points[v as usize]))
}

/// Whether `mesh` with this `topology` bounds a body.
fn check(mesh: &Mesh, topology: &Topology, open: OpenBoundaries) -> Result<(), SolidError> {
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
    match opening(topology) {
        Some(opening) if open == OpenBoundaries::Refuse => Err(opening),
        _ => Ok(()),
    }
}

/// Why a mesh is refused whose boundaries are not to be closed; `None` where it is balanced.
pub(crate) fn opening(topology: &Topology) -> Option<SolidError> {
    topology.unbalanced.first().map(|first| SolidError::Open {
        boundary_edges: topology.boundary_edges,
        boundary_loops: topology.boundary_loops,
        from: first.from,
        to: first.to,
        face: first.face,
    })
}

/// The triangles of component after component, in file order, those of its caps last; and where each component's are.
fn by_component(mesh: &Mesh, topology: &Topology, of_caps: &[(u32, [u32; 3])]) -> (Triangles, Vec<Range<usize>>) {
    let (faces, welded) = (mesh.faces(), &topology.welded);
    let all_distinct = topology.coincident_vertices == 0 && topology.collapsed_faces == 0;
    if all_distinct && faces.are_triangles() && topology.components == 1 && of_caps.is_empty() {
        let all = 0..faces.len();
        return (Triangles::OfMesh(mesh.shared_faces()), vec![all]);
    }
    let distinct = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| welded[v as usize]);
        a != b && b != c && c != a
    };
    let of_faces = || {
        let labelled = faces.iter().zip(&topology.component_of_face).filter(|(_, c)| **c != u32::MAX);
        labelled.flat_map(|(polygon, &c)| fan(polygon).filter(distinct).map(move |t| (c as usize, t)))
    };
    let of_caps = || of_caps.iter().map(|(face, t)| (topology.component_of_face[*face as usize] as usize, *t));
    let mut next = vec![0; topology.components + 1];
    of_faces().chain(of_caps()).for_each(|(c, _)| next[c + 1] += 1);
    for c in 0..topology.components {
        next[c + 1] += next[c];
    }
    let components = next.windows(2).map(|ends| ends[0]..ends[1]).collect();
    let mut triangles = vec![[0; 3]; next[topology.components]];
    for (c, triangle) in of_faces().chain(of_caps()) {
        triangles[next[c]] = triangle;
        next[c] += 1;
    }
    (triangles.into(), components)
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
    let cap = |group: &&[(u32, u32)]| Cap { members: group.iter().map(|m| m.1).collect(), fan: Vec::new() };
    (groups.iter().map(cap).collect(), triangles)
}

impl Touching {
    fn of(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let part = parallel::chunk(vertices);
        let parts = vertices.div_ceil(part);
        // The parts of a triangle's corners, each once; apexes have none.
        let parts_of = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|v| v as usize / part);
            let c = if (triangle[2] as usize) < vertices { c } else { a };
            [Some(a), (b != a).then_some(b), (c != a && c != b).then_some(c)].into_iter().flatten()
        };
        let mut starts = vec![0u32; parts + 1];
        for part in triangles.iter().flat_map(parts_of) {
            starts[part + 1] += 1;
        }
        for part in 0..parts {
            starts[part + 1] += starts[part];
        }
        let mut next = starts.clone();
        let mut touching = vec![0; starts[parts] as usize];
        for (t, triangle) in (0..).zip(triangles) {
            for part in parts_of(triangle) {
                touching[next[part] as usize] = t;
                next[part] += 1;
            }
        }
        Self { part, starts, triangles: touching, sums: Spare::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of 3 × 3 vertices, fewer than the vertices; a torus has twice as many triangles as vertices.
    #[test]
    fn a_torus_over_clusters_is_a_torus() {
        let mesh = crate::shapes::uv_torus(1.0, 0.3, 33, 18);
        let solid = Solid::new(&mesh, &crate::topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let cell_of: Vec<u32> = (0..33 * 18).map(|v| v / 18 / 3 * 6 + v % 18 / 3).collect();
        let cluster_of: Vec<u32> = (0..66).rev().collect();
        let coarse = solid.clustered(&cell_of, &cluster_of, 66);
        assert_eq!((coarse.vertex_count(), coarse.triangles.len()), (66, 132));
        let mut middles = vec![DVec3::ZERO; 66];
        cell_of
            .iter()
            .zip(mesh.points())
            .for_each(|(cell, p)| middles[cluster_of[*cell as usize] as usize] += *p / 9.0);
        let ratio = coarse.volume(&middles) / solid.volume(mesh.points());
        assert!(ratio > 0.6 && ratio < 1.0, "{ratio}");
    }

    #[test]
    fn volumes_have_the_same_bits_with_and_without_fused_multiply_adds() {
        let mesh = crate::shapes::uv_torus(1.0, 0.3, 33, 17);
        let solid = Solid::new(&mesh, &crate::topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let points: Vec<DVec3> = mesh.points().iter().map(|p| *p + DVec3::new(0.3, 0.1, -0.2)).collect();
        let of =
            |level| dispatch!(level, simd => sweep::determinants::<_, false>(simd, &solid.triangles, &points).value());
        for level in [Level::baseline(), Level::new()] {
            assert_eq!(of(level) / 6.0, solid.volume(&points));
        }
    }
}
