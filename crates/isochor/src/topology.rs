//! What a mesh is: edges, boundaries, orientation, components.
//!
//! All of it is taken after vertices at bit-equal places have been welded (0 and −0 count as equal) and corners that fell
//! together have been dropped, and it is counted on polygons, not on the triangles they are fanned into.

use rustc_hash::FxHashMap;

use crate::mesh::Mesh;

/// Counts and labels of a mesh; see the module for what is counted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topology {
    /// For each vertex the first vertex at the same place (#vertices).
    pub welded: Vec<u32>,
    /// Vertices whose place an earlier vertex has already.
    pub coincident_vertices: usize,
    /// Vertices that no face names.
    pub unused_vertices: usize,
    /// Faces with fewer than three distinct corners; they count nowhere else.
    pub collapsed_faces: usize,
    /// Edges with exactly one face.
    pub boundary_edges: usize,
    /// Connected pieces of the boundary edges.
    pub boundary_loops: usize,
    /// Edges with more than two faces.
    pub nonmanifold_edges: usize,
    /// The first of them: its welded vertices.
    pub first_nonmanifold_edge: Option<[u32; 2]>,
    /// Edges with two faces that both run along it in the same direction.
    pub inconsistent_edges: usize,
    /// Vertices where the faces form more than one fan.
    pub nonmanifold_vertices: usize,
    /// Edges that are not run equally often in both directions. Empty: the mesh is *balanced*, its volume does not depend
    /// on the origin.
    pub unbalanced: Vec<UnbalancedEdge>,
    /// Number of pieces that hang together through edges.
    pub components: usize,
    /// Component of each face, numbered by first face (#faces); `u32::MAX` for collapsed faces.
    pub component_of_face: Vec<u32>,
    /// Vertices − edges + faces.
    pub euler_characteristic: i64,
}

/// An edge that faces run more often in one direction than in the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnbalancedEdge {
    /// Where the surplus direction starts (welded vertex).
    pub from: u32,
    /// Where it ends (welded vertex).
    pub to: u32,
    /// By how much one direction outnumbers the other; 1 at a boundary.
    pub surplus: u32,
    /// The first face in file order that runs the surplus direction.
    pub face: u32,
}

impl Topology {
    /// Whether every edge has exactly two faces.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0 && self.nonmanifold_edges == 0 && self.components > 0
    }

    /// Whether every edge with two faces is run once in each direction.
    #[must_use]
    pub fn is_oriented(&self) -> bool {
        self.inconsistent_edges == 0
    }

    /// Whether every edge is run equally often in both directions: all that a volume needs.
    #[must_use]
    pub fn is_balanced(&self) -> bool {
        self.unbalanced.is_empty() && self.components > 0
    }

    /// Handles, summed over components: `(2 · components − χ) / 2`. `None` unless closed, two-manifold and oriented.
    #[must_use]
    pub fn genus(&self) -> Option<i64> {
        let defined = self.is_closed() && self.nonmanifold_vertices == 0 && self.is_oriented();
        defined.then(|| self.components as i64 - self.euler_characteristic / 2)
    }
}

/// One side of a polygon.
struct HalfEdge {
    from: u32,
    to: u32,
    face: u32,
    /// The half-edge that follows it round its polygon.
    next: u32,
}

/// A half-edge, filed under its edge.
#[derive(Clone, Copy, Default)]
struct Side {
    low: u32,
    high: u32,
    half_edge: u32,
    /// Whether it runs from `low` to `high`.
    is_forward: bool,
}

/// The topology of `mesh`. Time and memory are linear in the number of corners.
#[must_use]
pub fn topology(mesh: &Mesh) -> Topology {
    let welded = welded_vertices(mesh);
    let (vertices, face_count) = (welded.len(), mesh.faces().len());
    let (half_edges, collapsed_faces) = half_edges(mesh, &welded);
    let edges = sides(&half_edges, vertices);

    let mut faces = DisjointSets::new(face_count);
    let mut fans = DisjointSets::new(half_edges.len());
    let mut boundary = DisjointSets::new(vertices);
    let (mut edge_count, mut boundary_edges, mut nonmanifold_edges, mut inconsistent_edges) = (0, 0, 0, 0);
    let mut first_nonmanifold_edge = None;
    let mut boundary_vertices = Vec::new();
    let mut unbalanced = Vec::new();
    for group in edges.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        edge_count += 1;
        let Side { low, high, .. } = group[0];
        let forward = group.iter().filter(|side| side.is_forward).count();
        for pair in group.windows(2) {
            faces.union(half_edges[pair[0].half_edge as usize].face, half_edges[pair[1].half_edge as usize].face);
        }
        match group {
            [_] => {
                boundary_edges += 1;
                boundary.union(low, high);
                boundary_vertices.push(low);
            }
            [a, b] => {
                // Both corners of the edge belong to one fan each.
                let (a, b) = (a.half_edge, b.half_edge);
                let (a_next, b_next) = (half_edges[a as usize].next, half_edges[b as usize].next);
                if forward == 1 {
                    fans.union(a, b_next);
                    fans.union(a_next, b);
                } else {
                    inconsistent_edges += 1;
                    fans.union(a, b);
                    fans.union(a_next, b_next);
                }
            }
            _ => {
                nonmanifold_edges += 1;
                first_nonmanifold_edge.get_or_insert([low, high]);
            }
        }
        let backward = group.len() - forward;
        if forward != backward {
            let (from, to) = if forward > backward { (low, high) } else { (high, low) };
            let surplus = group.iter().filter(|side| side.is_forward == (from == low));
            let face = surplus.map(|side| half_edges[side.half_edge as usize].face).min();
            let face = face.expect("the surplus direction is run at least once");
            unbalanced.push(UnbalancedEdge { from, to, surplus: forward.abs_diff(backward) as u32, face });
        }
    }

    let mut component_of_face = vec![u32::MAX; face_count];
    let mut component_of_root = vec![u32::MAX; face_count];
    let mut components = 0;
    let mut live_faces = 0i64;
    for h in &half_edges {
        if component_of_face[h.face as usize] == u32::MAX {
            live_faces += 1;
            let root = faces.root(h.face) as usize;
            if component_of_root[root] == u32::MAX {
                component_of_root[root] = components;
                components += 1;
            }
            component_of_face[h.face as usize] = component_of_root[root];
        }
    }

    // Half-edge h stands for the corner at its start.
    let mut fan_of_vertex = vec![u32::MAX; vertices];
    let mut pinched = vec![false; vertices];
    let mut live_vertices = 0i64;
    for (h, half_edge) in half_edges.iter().enumerate() {
        let (v, fan) = (half_edge.from as usize, fans.root(h as u32));
        if fan_of_vertex[v] == u32::MAX {
            live_vertices += 1;
            fan_of_vertex[v] = fan;
        }
        pinched[v] |= fan_of_vertex[v] != fan;
    }
    let mut named = vec![false; vertices];
    for &v in mesh.faces().corners() {
        named[v as usize] = true;
    }
    boundary_vertices.iter_mut().for_each(|v| *v = boundary.root(*v));
    boundary_vertices.sort_unstable();
    boundary_vertices.dedup();

    Topology {
        coincident_vertices: welded.iter().enumerate().filter(|&(v, &w)| v != w as usize).count(),
        welded,
        unused_vertices: named.iter().filter(|named| !**named).count(),
        collapsed_faces,
        boundary_edges,
        boundary_loops: boundary_vertices.len(),
        nonmanifold_edges,
        first_nonmanifold_edge,
        inconsistent_edges,
        nonmanifold_vertices: pinched.iter().filter(|p| **p).count(),
        unbalanced,
        components: components as usize,
        component_of_face,
        euler_characteristic: live_vertices - edge_count + live_faces,
    }
}

/// For each vertex the first vertex at the same place.
fn welded_vertices(mesh: &Mesh) -> Vec<u32> {
    let mut first_at = FxHashMap::with_capacity_and_hasher(mesh.points().len(), Default::default());
    let place = |p: &glam::DVec3| p.to_array().map(|x| (x + 0.0).to_bits()); // −0 + 0 = 0
    mesh.points().iter().zip(0..).map(|(p, v)| *first_at.entry(place(p)).or_insert(v)).collect()
}

/// The sides of all polygons between welded vertices, and the number of polygons that collapsed.
fn half_edges(mesh: &Mesh, welded: &[u32]) -> (Vec<HalfEdge>, usize) {
    let mut half_edges = Vec::with_capacity(mesh.faces().corners().len());
    let mut collapsed = 0;
    let mut corners: Vec<u32> = Vec::new();
    for (face, polygon) in mesh.faces().iter().enumerate() {
        corners.clear();
        corners.extend(polygon.iter().map(|&v| welded[v as usize]));
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if corners.len() < 3 {
            collapsed += 1;
            continue;
        }
        let start = half_edges.len() as u32;
        let n = corners.len();
        half_edges.extend((0..n).map(|k| HalfEdge {
            from: corners[k],
            to: corners[(k + 1) % n],
            face: face as u32,
            next: start + ((k + 1) % n) as u32,
        }));
    }
    (half_edges, collapsed)
}

/// All half-edges by their lower and higher vertex, in file order within an edge: a counting sort by lower vertex, then a small
/// sort per vertex.
fn sides(half_edges: &[HalfEdge], vertices: usize) -> Vec<Side> {
    let mut starts = vec![0u32; vertices + 1];
    for h in half_edges {
        starts[h.from.min(h.to) as usize + 1] += 1;
    }
    for v in 0..vertices {
        starts[v + 1] += starts[v];
    }
    let mut next = starts.clone();
    let mut sides = vec![Side::default(); half_edges.len()];
    for (half_edge, h) in (0..).zip(half_edges) {
        let (low, high) = (h.from.min(h.to), h.from.max(h.to));
        let slot = &mut next[low as usize];
        sides[*slot as usize] = Side { low, high, half_edge, is_forward: h.from == low };
        *slot += 1;
    }
    for bucket in starts.windows(2) {
        sides[bucket[0] as usize..bucket[1] as usize].sort_unstable_by_key(|side| (side.high, side.half_edge));
    }
    sides
}

/// Disjoint sets of 0..n under union; the root of a set is its least member.
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    pub(crate) fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    pub(crate) fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
