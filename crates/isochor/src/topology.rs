//! What a mesh is: edges, boundaries, orientation, components.
//!
//! All of it is taken after vertices at bit-equal places have been welded (0 and −0 count as equal) and corners that fell
//! together have been dropped, and it is counted on polygons, not on the triangles they are fanned into.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rustc_hash::FxHashMap;

use crate::mesh::{Faces, Mesh};
use crate::order;
use crate::parallel;

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

/// No corner.
const NONE: u32 = u32::MAX;

/// The topology of `mesh`. Time and memory are linear in the number of corners.
///
/// Whatever is to be known of edges is told by the corners at their ends, so corners are filed under their vertices, and the
/// vertices are looked at in any order, by many threads. Of triangles that takes 4 bytes per corner and 4 per vertex beside the result; of
/// other polygons 8 per corner, and where vertices stand at one place or corners fall together a copy of the faces.
#[must_use]
pub fn topology(mesh: &Mesh) -> Topology {
    let (welded, coincident_vertices) = welded_vertices(mesh.points());
    let (vertices, face_count) = (welded.len(), mesh.faces().len());
    let (polygons, collapsed_faces) = polygons(mesh.faces(), &welded, coincident_vertices);
    let corners = Corners::of(&polygons, vertices);
    let pieces = SharedSets::new(face_count);
    let parts = parallel::map_chunks(vertices, parallel::CHUNK, |range| {
        let mut part = Part::default();
        let mut fan = Fan::default();
        range.for_each(|v| fan.add_to(&mut part, v as u32, &corners, &pieces));
        part
    });

    let mut all = Part::default();
    parts.into_iter().for_each(|part| all.append(part));
    let unused_vertices = match &polygons {
        Cow::Borrowed(_) => vertices - all.vertices,
        Cow::Owned(_) => unnamed(mesh.faces(), vertices),
    };
    drop(corners);
    let (component_of_face, components) = pieces.numbered(|face| !polygons.face(face).is_empty());
    Topology {
        coincident_vertices,
        welded,
        unused_vertices,
        collapsed_faces,
        boundary_edges: all.boundary.len(),
        boundary_loops: loops(&all.boundary, vertices),
        nonmanifold_edges: all.nonmanifold_edges,
        first_nonmanifold_edge: all.first_nonmanifold_edge,
        inconsistent_edges: all.inconsistent_edges,
        nonmanifold_vertices: all.nonmanifold_vertices,
        unbalanced: all.unbalanced,
        components,
        component_of_face,
        euler_characteristic: all.vertices as i64 - all.edges as i64 + (face_count - collapsed_faces) as i64,
    }
}

/// What there is at some vertices and at those edges of which they are the lower end.
#[derive(Default)]
struct Part {
    /// Vertices with corners.
    vertices: usize,
    edges: usize,
    /// Edges with one face.
    boundary: Vec<[u32; 2]>,
    nonmanifold_edges: usize,
    first_nonmanifold_edge: Option<[u32; 2]>,
    inconsistent_edges: usize,
    nonmanifold_vertices: usize,
    unbalanced: Vec<UnbalancedEdge>,
}

impl Part {
    /// Adds a part of later vertices.
    fn append(&mut self, mut later: Self) {
        self.vertices += later.vertices;
        self.edges += later.edges;
        self.boundary.append(&mut later.boundary);
        self.nonmanifold_edges += later.nonmanifold_edges;
        self.first_nonmanifold_edge = self.first_nonmanifold_edge.or(later.first_nonmanifold_edge);
        self.inconsistent_edges += later.inconsistent_edges;
        self.nonmanifold_vertices += later.nonmanifold_vertices;
        self.unbalanced.append(&mut later.unbalanced);
    }
}

/// A corner of a polygon, as its vertex sees it.
#[derive(Clone, Copy, Default)]
struct Corner {
    face: u32,
    /// The vertex behind it round the polygon.
    next: u32,
    /// The vertex before it.
    previous: u32,
}

/// An edge at a vertex, as one of its corners sees it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// The other end.
    far: u32,
    /// Index of the corner at the vertex.
    corner: u32,
    /// Whether the polygon runs along the edge away from the vertex.
    is_outward: bool,
}

/// The corners at one vertex, in memory that serves many.
#[derive(Default)]
struct Fan {
    corners: Vec<Corner>,
    sides: Vec<Side>,
}

/// Corners of a vertex up to which all pairs are looked at. More: it takes long; fewer: ordinary vertices are sorted.
const FEW_CORNERS: usize = 16;

impl Fan {
    /// Adds to `part` what there is at vertex v, and unites the faces that share an edge of which it is the lower end.
    fn add_to(&mut self, part: &mut Part, v: u32, corners: &Corners, pieces: &SharedSets) {
        corners.collect_at(v, &mut self.corners);
        if self.corners.is_empty() {
            return;
        }
        part.vertices += 1;
        if !self.add_closed(part, v, pieces) {
            self.add_any(part, v, pieces);
        }
    }

    /// Goes once round the vertex: from each corner over the edge before it to the corner behind that edge. Where this comes to each
    /// corner before it is back, every edge here has two faces, run once in each direction. `false`: it does not, and nothing was added.
    fn add_closed(&self, part: &mut Part, v: u32, pieces: &SharedSets) -> bool {
        let corners = &self.corners[..];
        if corners.len() > FEW_CORNERS {
            return false;
        }
        let mut round = [0; FEW_CORNERS];
        let mut at = 0;
        for turn in &mut round[..corners.len()] {
            *turn = at;
            let Some(next) = corners.iter().position(|corner| corner.next == corners[at].previous) else {
                return false;
            };
            at = next;
            if at == 0 {
                break;
            }
        }
        // Places of `round` that were not reached are 0.
        let is_closed = at == 0 && (corners.len() == 1 || round[corners.len() - 1] != 0);
        if !is_closed {
            return false;
        }
        for (turn, &at) in round[..corners.len()].iter().enumerate() {
            let Corner { face, previous, .. } = corners[at];
            if previous > v {
                part.edges += 1;
                let across = round[..corners.len()].get(turn + 1).map_or(0, |next| *next);
                pieces.unite(face, corners[across].face);
            }
        }
        true
    }

    /// The same for any corners.
    fn add_any(&mut self, part: &mut Part, v: u32, pieces: &SharedSets) {
        self.sides.clear();
        for (corner, &Corner { next, previous, .. }) in (0..).zip(&self.corners) {
            self.sides.push(Side { far: next, corner, is_outward: true });
            self.sides.push(Side { far: previous, corner, is_outward: false });
        }
        self.sides.sort_unstable();
        let mut fans = DisjointSets::new(self.corners.len());
        for edge in self.sides.chunk_by(|a, b| a.far == b.far) {
            if let [a, b] = edge {
                fans.union(a.corner, b.corner);
            }
            if edge[0].far > v {
                self.add_edge(part, v, edge, pieces);
            }
        }
        let is_whole = (0..self.corners.len() as u32).all(|corner| fans.root(corner) == 0);
        part.nonmanifold_vertices += usize::from(!is_whole);
    }

    /// Adds the edge from v with these sides, v being its lower end.
    fn add_edge(&self, part: &mut Part, v: u32, edge: &[Side], pieces: &SharedSets) {
        let face = |side: &Side| self.corners[side.corner as usize].face;
        let far = edge[0].far;
        part.edges += 1;
        edge.windows(2).for_each(|pair| pieces.unite(face(&pair[0]), face(&pair[1])));
        match edge {
            [_] => part.boundary.push([v, far]),
            [a, b] => part.inconsistent_edges += usize::from(a.is_outward == b.is_outward),
            _ => {
                part.nonmanifold_edges += 1;
                part.first_nonmanifold_edge.get_or_insert([v, far]);
            }
        }
        let outward = edge.iter().filter(|side| side.is_outward).count();
        let inward = edge.len() - outward;
        if outward != inward {
            let is_outward = outward > inward;
            let (from, to) = if is_outward { (v, far) } else { (far, v) };
            let face = edge.iter().filter(|side| side.is_outward == is_outward).map(face).min();
            let face = face.expect("the surplus direction is run at least once");
            part.unbalanced.push(UnbalancedEdge { from, to, surplus: outward.abs_diff(inward) as u32, face });
        }
    }
}

/// The corners of all polygons by vertex: from the last corner of each vertex to the one before it, and so on.
struct Corners<'a> {
    polygons: &'a Faces,
    face_of_corner: FaceOfCorner,
    /// The last corner at each vertex (#vertices).
    last: Vec<u32>,
    /// The corner before each at the same vertex (#corners).
    before: Vec<u32>,
}

/// Which face a corner belongs to.
enum FaceOfCorner {
    /// Corner c to face c / 3.
    Triangles,
    /// As listed (#corners).
    Any(Vec<u32>),
}

impl<'a> Corners<'a> {
    fn of(polygons: &'a Faces, vertices: usize) -> Self {
        let mut last = vec![NONE; vertices];
        let mut before = Vec::with_capacity(polygons.corners().len());
        for (corner, &v) in (0..).zip(polygons.corners()) {
            before.push(std::mem::replace(&mut last[v as usize], corner));
        }
        let face_of_corner = if polygons.are_triangles() {
            FaceOfCorner::Triangles
        } else {
            let faces = (0..).zip(polygons.iter());
            FaceOfCorner::Any(faces.flat_map(|(face, polygon)| std::iter::repeat_n(face, polygon.len())).collect())
        };
        Self { polygons, face_of_corner, last, before }
    }

    /// The corners at vertex v in place of what `found` held, last first.
    #[inline]
    fn collect_at(&self, v: u32, found: &mut Vec<Corner>) {
        found.clear();
        let mut c = self.last[v as usize];
        while c != NONE {
            found.push(self.corner(c as usize));
            c = self.before[c as usize];
        }
    }

    #[inline]
    fn corner(&self, c: usize) -> Corner {
        let all = self.polygons.corners();
        match &self.face_of_corner {
            FaceOfCorner::Triangles => {
                let (face, k) = (c / 3, c % 3);
                let of = |k: usize| all[3 * face + k];
                Corner { face: face as u32, next: of((k + 1) % 3), previous: of((k + 2) % 3) }
            }
            FaceOfCorner::Any(faces) => {
                let face = faces[c];
                let Range { start, end } = self.polygons.range(face as usize);
                let next = if c + 1 < end { c + 1 } else { start };
                let previous = if c > start { c - 1 } else { end - 1 };
                Corner { face, next: all[next], previous: all[previous] }
            }
        }
    }
}

/// For each of `points` the first at the same place, and how many come after another one.
fn welded_vertices(points: &[DVec3]) -> (Vec<u32>, usize) {
    /// Points that are looked up together, about. More: they leave the cache; fewer: more to do per group.
    const GROUP: usize = 2048;
    /// Odd and without pattern: the upper half of a sum of products depends on all digits of a place.
    const MIX: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb];
    let place = |v: usize| points[v].to_array().map(|x| (x + 0.0).to_bits()); // −0 + 0 = 0
    // Points at one place come into one group, in their order.
    let groups = points.len().div_ceil(GROUP);
    let group = |v: usize| {
        let mixed = place(v).iter().zip(MIX).fold(0u64, |sum, (x, by)| sum.wrapping_add(x.wrapping_mul(by)));
        (((mixed >> 32) * groups as u64) >> 32) as u32
    };
    let (order, ends) = order::grouped(&parallel::collect(points.len(), group), groups);
    let twins = parallel::map(groups, |g| {
        let group = &order[g.checked_sub(1).map_or(0, |g| ends[g] as usize)..ends[g] as usize];
        let mut first_at = FxHashMap::with_capacity_and_hasher(group.len(), Default::default());
        let pair =
            |&v: &u32| Some([*first_at.entry(place(v as usize)).or_insert(v), v]).filter(|[first, v]| first != v);
        group.iter().filter_map(pair).collect::<Vec<_>>()
    });
    let mut welded: Vec<u32> = (0..points.len() as u32).collect();
    twins.iter().flatten().for_each(|[first, v]| welded[*v as usize] = *first);
    (welded, twins.iter().map(Vec::len).sum())
}

/// The polygons between welded vertices, and how many collapsed: these have no corners.
fn polygons<'a>(faces: &'a Faces, welded: &[u32], coincident_vertices: usize) -> (Cow<'a, Faces>, usize) {
    let has_double = |polygon: &[u32]| polygon.windows(2).any(|w| w[0] == w[1]) || polygon.first() == polygon.last();
    let is_plain = |faces: &Faces| {
        let parts = |range: Range<usize>| range.into_iter().any(|f| has_double(faces.face(f)));
        !parallel::map_chunks(faces.len(), parallel::CHUNK, parts).contains(&true)
    };
    if coincident_vertices == 0 && is_plain(faces) {
        return (Cow::Borrowed(faces), 0);
    }
    let mut polygons = Faces::with_capacity(faces.len(), faces.corners().len());
    let mut collapsed = 0;
    let mut corners: Vec<u32> = Vec::new();
    for polygon in faces.iter() {
        corners.clear();
        corners.extend(polygon.iter().map(|&v| welded[v as usize]));
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if corners.len() < 3 {
            collapsed += 1;
            corners.clear();
        }
        polygons.push(&corners);
    }
    (Cow::Owned(polygons), collapsed)
}

/// Vertices that no face names.
fn unnamed(faces: &Faces, vertices: usize) -> usize {
    let mut named = vec![false; vertices];
    faces.corners().iter().for_each(|v| named[*v as usize] = true);
    named.iter().filter(|named| !**named).count()
}

/// Connected pieces of `edges`.
fn loops(edges: &[[u32; 2]], vertices: usize) -> usize {
    if edges.is_empty() {
        return 0;
    }
    let mut pieces = DisjointSets::new(vertices);
    edges.iter().for_each(|[a, b]| pieces.union(*a, *b));
    let mut roots: Vec<u32> = edges.iter().map(|[a, _]| pieces.root(*a)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

/// [`DisjointSets`] that many threads unite at once. The root of a set is its least member, whoever comes first.
struct SharedSets {
    /// A member that is not greater; a root is its own.
    parent: Vec<AtomicU32>,
}

impl SharedSets {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).map(AtomicU32::new).collect() }
    }

    fn root(&self, mut i: u32) -> u32 {
        loop {
            let parent = self.parent[i as usize].load(Relaxed);
            let up = self.parent[parent as usize].load(Relaxed);
            if up == parent {
                return up;
            }
            // Any ancestor will do, so it does not matter which thread writes last.
            self.parent[i as usize].store(up, Relaxed);
            i = up;
        }
    }

    fn unite(&self, mut a: u32, mut b: u32) {
        loop {
            (a, b) = (self.root(a), self.root(b));
            if a == b {
                return;
            }
            let (least, other) = (a.min(b), a.max(b));
            // Only roots are tied to others.
            if self.parent[other as usize].compare_exchange(other, least, Relaxed, Relaxed).is_ok() {
                return;
            }
        }
    }

    /// The number of the set of each member, by first member that `is_live`, and how many there are; `u32::MAX` for others, which are
    /// sets of their own.
    fn numbered(self, is_live: impl Fn(usize) -> bool) -> (Vec<u32>, usize) {
        let mut numbers: Vec<u32> = self.parent.into_iter().map(AtomicU32::into_inner).collect();
        let mut sets = 0;
        for i in 0..numbers.len() {
            let parent = numbers[i] as usize;
            numbers[i] = match parent < i {
                true => numbers[parent],
                false if is_live(i) => {
                    sets += 1;
                    sets - 1
                }
                false => u32::MAX,
            };
        }
        (numbers, sets as usize)
    }
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
