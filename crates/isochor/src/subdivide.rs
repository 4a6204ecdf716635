//! Faces of a model split along the grid lines of the sheet under it, where the surface curves.
//!
//! A face larger than a cell of the flattened grid would stay flat where the surface is not. CO, section 3.2, adds, above the grid: *edge
//! points*, where an edge crosses a grid line, and *face points*, where grid lines cross inside a face; and leaves out those that are not
//! needed. With κ_e the normal curvature of the surface along the direction e, ε the threshold and L the extent of the placed model:
//!
//! 1. An edge point is kept where |κ_e| L ≥ ε for the direction e of its edge: there the edge must bend.
//! 2. A grid line through a face is kept as a whole, with its face points, where one of its ends is kept (CO, figure 6a); so is the other end.
//!    An edge point is one for all faces at its edge, so the line goes on through the next face.
//! 3. A kept grid line is an edge to be: where |κ_e| L ≥ ε along it at one of its face points, the other grid line there is kept too (figure
//!    6b). Then again, until nothing changes.
//! 4. Where a grid line ends at a vertex, which needs no point, that end counts as kept where the surface curves so along an edge of the face there.
//!
//! Faces are cut along kept lines into the pieces over cells, and these into triangles and quadrilaterals. No piece has a vertex inside an edge of another:
//! the edges of a closed model stay closed, whatever ε is. New points lie on the model's faces, each the mix of two vertices of an edge or three of a
//! face.
//!
//! Over a face seen edge-on there is no face point. It is cut along the vertical lines over the crossings of its edges with the grid.
//!
//! # Changes versus the paper
//!
//! - What "the curvature of a projected edge" is, is said above; the paper leaves it open.
//! - Plane convex polygons are cut as they are, all others as the triangle fans that they stand for ([`crate::Faces`]).
//! - Points on grid points and lines, and edges along them, add nothing: what is nearer than [`crate::tolerances::INSIDE`] counts as on them.

use std::collections::VecDeque;

use glam::{DVec2, DVec3};
use rustc_hash::FxHashMap;

use crate::crossings::{Crossings, Feature, Net};
use crate::cut::Cut;
use crate::mesh::{Bounds, Faces, Mesh};
use crate::parallel;
use crate::refinement::Refinement;
use crate::topology::topology;
use crate::wrap::Wrap;

/// How finely a model is subdivided.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SubdivideOptions {
    /// ε: points are kept where |curvature| × extent of the placed model is at least that; 0 keeps all. The edges of a model on a cylinder of
    /// radius R turn by about edge length / R, so with 0.05 a model a twentieth of R large is left alone.
    pub threshold: f64,
}

impl Default for SubdivideOptions {
    /// A threshold of 0.05.
    fn default() -> Self {
        Self { threshold: 0.05 }
    }
}

/// A subdivided model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Subdivision {
    /// Faces, and where they and the new vertices come from. Old vertices keep their numbers.
    pub refinement: Refinement,
    /// What each new vertex is (#new vertices).
    pub kinds: Vec<PointKind>,
    /// Edge points and face points that there could have been.
    pub candidates: [usize; 2],
}

/// What a new vertex is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointKind {
    /// Where an edge crosses a grid line, or a diagonal of a face that was fanned.
    Edge,
    /// Where grid lines cross inside a face.
    Face,
}

/// Why a model cannot be subdivided.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    /// A threshold that is none.
    #[error("the curvature threshold is {threshold}: it must be finite and at least 0")]
    Threshold {
        /// It.
        threshold: f64,
    },
    /// More vertices than can be numbered.
    #[error(
        "subdivision would make {vertices} vertices, more than fit 32 bits: use a coarser grid or a larger threshold"
    )]
    TooMany {
        /// How many.
        vertices: usize,
    },
}

impl Subdivision {
    /// Values of old vertices followed by those of the new ones (#old × 3 to #all × 3), for all that lies on a mesh linearly: points, their
    /// places on a sheet.
    ///
    /// # Panics
    ///
    /// Panics where there are not as many values as old vertices.
    #[must_use]
    pub fn mixed(&self, values: &[DVec3]) -> Vec<DVec3> {
        let mix = |mix: &[(u32, f64); 3]| {
            let [(a, x), (b, y), (c, z)] = *mix;
            let both = x * values[a as usize] + y * values[b as usize];
            if z == 0.0 { both } else { both + z * values[c as usize] }
        };
        let new = &self.refinement.vertices;
        parallel::collect(values.len() + new.len(), |v| match values.get(v) {
            Some(value) => *value,
            None => mix(&new[v - values.len()]),
        })
    }
}

/// The faces of `mesh`, whose vertices lie at `places` ((x, y, h), #vertices × 3) on the sheet of `wrap`, split where its surface curves.
///
/// # Errors
///
/// A threshold that is negative or not finite; more vertices than 32 bits can number.
///
/// # Panics
///
/// Panics where there is not one place for each vertex.
pub fn subdivide(
    mesh: &Mesh,
    places: &[DVec3],
    wrap: &Wrap,
    options: &SubdivideOptions,
) -> Result<Subdivision, SubdivideError> {
    assert_eq!(places.len(), mesh.points().len(), "one place for each vertex");
    let threshold = options.threshold;
    if !(threshold.is_finite() && threshold >= 0.0) {
        return Err(SubdivideError::Threshold { threshold });
    }
    let extent = Bounds::of(places).map_or(0.0, |b| b.extent());
    let net = Net::new(wrap.locator(), wrap.tolerance());
    let skeleton = Skeleton::of(mesh, places, &net);
    let does_curve = |x: DVec2, along: DVec2| wrap.curvature_along(x, along) * extent >= threshold;
    let paths_of = |p: usize| skeleton.paths(&skeleton.pieces[p], &net, &does_curve);
    let mut woven = Woven { pieces: parallel::map(skeleton.pieces.len(), paths_of), is_kept: Vec::new() };
    woven.keep(&skeleton, &does_curve);
    Output::new(&skeleton, &woven).finished(mesh)
}

/// An edge, from the lower to the higher of its welded vertices, or a diagonal of a face.
struct Edge {
    ends: [u32; 2],
}

/// A side of a piece.
#[derive(Clone, Copy)]
struct Side {
    edge: u32,
    /// Whether the piece runs it from its second end to its first.
    is_reversed: bool,
}

/// A plane convex part of a face.
struct Piece {
    face: u32,
    /// Which corners of the face it has, in order.
    corners: Vec<u32>,
    /// From each corner to the next.
    sides: Vec<Side>,
}

/// How a face is cut up.
enum Parts {
    /// Not at all; at most it gets the edge points of these sides.
    Whole,
    /// Into these pieces.
    Pieces(std::ops::Range<usize>),
}

/// A model over a grid: edges with their crossings, faces with their pieces.
struct Skeleton<'a> {
    mesh: &'a Mesh,
    places: &'a [DVec3],
    welded: Vec<u32>,
    edges: Vec<Edge>,
    crossings: Vec<Crossings>,
    /// Number of the first crossing of each edge.
    first_crossing: Vec<u32>,
    /// What each welded vertex is on.
    features: Vec<Vec<Feature>>,
    pieces: Vec<Piece>,
    /// How each face is cut up, and its own sides.
    faces: Vec<(Parts, Vec<Side>)>,
}

/// A corner of what a piece is cut into.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Node {
    /// The k-th corner of the piece.
    Corner(u32),
    /// The k-th crossing of the edge of its s-th side.
    Crossing { side: u32, k: u32 },
    /// A grid point inside.
    Inner(u32),
}

/// A grid line through a piece, from one node of its border to another.
struct Path {
    nodes: Vec<u32>,
    /// Whether the surface curves along it at each of its nodes.
    bends: Vec<bool>,
}

/// A piece with all that could be added to it.
#[derive(Default)]
struct Web {
    /// Those of the border first, in order.
    nodes: Vec<Node>,
    border: usize,
    /// Places of the nodes in a plane in which the border runs counter-clockwise.
    plane: Vec<DVec2>,
    paths: Vec<Path>,
    /// Whether a path is kept whatever the others are.
    is_started: Vec<bool>,
}

/// A polygon whose corners are within this part of its size of a plane is plane. Larger: cutting it changes the volume of the model; smaller:
/// rounding makes fans of squares.
const PLANE: f64 = 1e-13;

impl<'a> Skeleton<'a> {
    fn of(mesh: &'a Mesh, places: &'a [DVec3], net: &Net) -> Self {
        let welded = topology(mesh).welded;
        let mut skeleton = Self {
            mesh,
            places,
            welded,
            edges: Vec::new(),
            crossings: Vec::new(),
            first_crossing: Vec::new(),
            features: Vec::new(),
            pieces: Vec::new(),
            faces: Vec::new(),
        };
        skeleton.take_apart();
        let flat = |v: u32| skeleton.places[v as usize].truncate();
        let crossings = parallel::map_chunks(skeleton.edges.len(), parallel::CHUNK, |range| {
            let of = |edge: &Edge| net.crossings(flat(edge.ends[0]), flat(edge.ends[1]));
            skeleton.edges[range].iter().map(of).collect::<Vec<_>>()
        });
        let features = parallel::map_chunks(places.len(), parallel::CHUNK, |range| {
            let of =
                |v: usize| if skeleton.welded[v] as usize == v { net.features(flat(v as u32)) } else { Vec::new() };
            range.map(of).collect::<Vec<_>>()
        });
        skeleton.crossings = crossings.into_iter().flatten().collect();
        skeleton.features = features.into_iter().flatten().collect();
        for (edge, crossings) in skeleton.edges.iter().zip(&skeleton.crossings) {
            for (v, found) in edge.ends.iter().zip(&crossings.ends) {
                let features = &mut skeleton.features[*v as usize];
                for feature in found {
                    if !features.contains(feature) {
                        features.push(*feature);
                    }
                }
            }
        }
        let counts = skeleton.crossings.iter().scan(0, |sum, crossings| {
            let first = *sum;
            *sum += crossings.inner.len() as u32;
            Some(first)
        });
        skeleton.first_crossing = counts.collect();
        skeleton
    }

    /// Makes edges and pieces of the faces.
    fn take_apart(&mut self) {
        let mut numbers: FxHashMap<[u32; 2], u32> = FxHashMap::default();
        let faces = self.mesh.faces();
        for (f, face) in (0..).zip(faces.iter()) {
            let welded = |k: u32| self.welded[face[k as usize] as usize];
            let corners = distinct_corners(face, &self.welded);
            let n = corners.len();
            if n < 3 {
                self.faces.push((Parts::Whole, Vec::new()));
                continue;
            }
            let ends = |i: u32, j: u32| {
                let (a, b) = (welded(i), welded(j));
                (a.min(b), a.max(b), a > b)
            };
            let mut edges = std::mem::take(&mut self.edges);
            let mut side = |i: u32, j: u32| {
                let (a, b, is_reversed) = ends(i, j);
                let edge = *numbers.entry([a, b]).or_insert_with(|| {
                    edges.push(Edge { ends: [a, b] });
                    edges.len() as u32 - 1
                });
                Side { edge, is_reversed }
            };
            let sides: Vec<Side> = (0..n).map(|k| side(corners[k], corners[(k + 1) % n])).collect();
            let first = self.pieces.len();
            let has_twice = {
                let mut all: Vec<u32> = corners.iter().map(|k| welded(*k)).collect();
                all.sort_unstable();
                all.windows(2).any(|w| w[0] == w[1])
            };
            if has_twice {
                self.edges = edges;
                self.faces.push((Parts::Whole, sides));
                continue;
            }
            let points: Vec<DVec3> = corners.iter().map(|k| self.places[face[*k as usize] as usize]).collect();
            if n == 3 || is_plane_and_convex(&points) {
                self.pieces.push(Piece { face: f, corners, sides: sides.clone() });
            } else {
                let mut before = sides[0];
                for k in 2..n {
                    let (a, b, is_reversed) = ends(corners[k], corners[0]);
                    let after = if k + 1 < n {
                        edges.push(Edge { ends: [a, b] });
                        Side { edge: edges.len() as u32 - 1, is_reversed }
                    } else {
                        sides[n - 1]
                    };
                    let corners = vec![corners[0], corners[k - 1], corners[k]];
                    self.pieces.push(Piece { face: f, corners, sides: vec![before, sides[k - 1], after] });
                    before = Side { is_reversed: !after.is_reversed, ..after };
                }
            }
            self.edges = edges;
            self.faces.push((Parts::Pieces(first..self.pieces.len()), sides));
        }
    }

    /// The vertex of the k-th corner of a piece.
    fn vertex(&self, piece: &Piece, k: u32) -> u32 {
        self.mesh.faces().face(piece.face as usize)[piece.corners[k as usize] as usize]
    }

    fn place(&self, piece: &Piece, k: u32) -> DVec3 {
        self.places[self.vertex(piece, k) as usize]
    }

    /// The place of a crossing.
    fn crossing(&self, edge: u32, k: u32) -> DVec3 {
        let [a, b] = self.edges[edge as usize].ends.map(|v| self.places[v as usize]);
        let t = self.crossings[edge as usize].inner[k as usize].t;
        (1.0 - t) * a + t * b
    }

    /// The flat direction of an edge.
    fn direction(&self, edge: u32) -> DVec2 {
        let [a, b] = self.edges[edge as usize].ends.map(|v| self.places[v as usize].truncate());
        b - a
    }

    /// The corners and crossings of sides, in order.
    fn border(&self, sides: &[Side]) -> Vec<Node> {
        let mut nodes = Vec::new();
        for (s, side) in (0..).zip(sides) {
            nodes.push(Node::Corner(s));
            let count = self.crossings[side.edge as usize].inner.len() as u32;
            let along = (0..count).map(|k| if side.is_reversed { count - 1 - k } else { k });
            nodes.extend(along.map(|k| Node::Crossing { side: s, k }));
        }
        nodes
    }

    fn features(&self, piece: &Piece, node: Node) -> &[Feature] {
        match node {
            Node::Corner(k) => &self.features[self.welded[self.vertex(piece, k) as usize] as usize],
            Node::Crossing { side, k } => {
                &self.crossings[piece.sides[side as usize].edge as usize].inner[k as usize].features
            }
            Node::Inner(_) => &[],
        }
    }

    /// What grid lines there are in a piece.
    fn paths(&self, piece: &Piece, net: &Net, does_curve: &impl Fn(DVec2, DVec2) -> bool) -> Web {
        let corners: Vec<DVec3> = (0..piece.corners.len() as u32).map(|k| self.place(piece, k)).collect();
        let flat: Vec<DVec2> = corners.iter().map(|q| q.truncate()).collect();
        let area = doubled_area(&flat);
        let diameter = flat.iter().map(|x| x.distance(flat[0])).fold(0.0, f64::max);
        let is_edge_on = area.abs() <= 2.0 * net.tolerance() * diameter;
        let nodes = self.border(&piece.sides);
        let border = nodes.len();
        let mut web = Web { nodes, border, ..Web::default() };
        if !is_edge_on {
            web.nodes.extend(points_inside(&flat, area, net).into_iter().map(Node::Inner));
        }
        if web.nodes.len() == border && web.nodes.iter().all(|node| self.features(piece, *node).is_empty()) {
            web.plane = if is_edge_on { upright(&corners, &corners) } else { counter_clockwise(flat, area) };
            return web;
        }
        let places: Vec<DVec3> = web
            .nodes
            .iter()
            .map(|node| match *node {
                Node::Corner(k) => corners[k as usize],
                Node::Crossing { side, k } => self.crossing(piece.sides[side as usize].edge, k),
                Node::Inner(point) => net.point(point).extend(0.0),
            })
            .collect();
        let chords = if is_edge_on {
            self.vertical_chords(piece, &web, &places, net)
        } else {
            self.chords(piece, &web, &places, net)
        };
        web.paths = joined(&chords, border, &places, does_curve);
        web.is_started = web.paths.iter().map(|path| self.starts(piece, &web, path, does_curve)).collect();
        web.plane = if is_edge_on {
            upright(&corners, &places)
        } else {
            counter_clockwise(places.iter().map(|q| q.truncate()).collect(), area)
        };
        web
    }

    /// Whether both nodes are on one side of the piece.
    fn share_side(piece: &Piece, a: Node, b: Node) -> bool {
        let n = piece.sides.len() as u32;
        let sides = |node: Node| match node {
            Node::Corner(k) => [k, (k + n - 1) % n],
            Node::Crossing { side, .. } => [side; 2],
            Node::Inner(_) => [u32::MAX; 2],
        };
        let (a, b) = (sides(a), sides(b));
        a[0] != u32::MAX && b[0] != u32::MAX && a.iter().any(|side| b.contains(side))
    }

    /// The parts of grid sides in a piece: line, and both nodes.
    fn chords(&self, piece: &Piece, web: &Web, places: &[DVec3], net: &Net) -> Vec<(u32, [u32; 2])> {
        // Nodes by the sides on which they are.
        let mut on: Vec<(u32, u32)> = Vec::new();
        for (k, node) in (0..).zip(&web.nodes) {
            let at_point =
                |on: &mut Vec<(u32, u32)>, point: u32| on.extend(net.sides_at(point).iter().map(|side| (*side, k)));
            if let Node::Inner(point) = node {
                at_point(&mut on, *point);
            }
            for feature in self.features(piece, *node) {
                match feature {
                    Feature::Point(point) => at_point(&mut on, *point),
                    Feature::Side(side) => on.push((*side, k)),
                }
            }
        }
        on.sort_unstable();
        on.dedup();
        let mut chords = Vec::new();
        for of_side in on.chunk_by(|a, b| a.0 == b.0).filter(|of_side| of_side.len() > 1) {
            let side = of_side[0].0;
            let Some(ends) = net.side(side) else { continue };
            let [p, q] = ends.map(|p| net.point(p));
            let along = |k: u32| (places[k as usize].truncate() - p).dot(q - p);
            let mut nodes: Vec<u32> = of_side.iter().map(|(_, k)| *k).collect();
            nodes.sort_by(|a, b| along(*a).total_cmp(&along(*b)));
            let pairs = nodes.windows(2).map(|w| [w[0], w[1]]);
            let is_inside =
                |[a, b]: &[u32; 2]| !Self::share_side(piece, web.nodes[*a as usize], web.nodes[*b as usize]);
            chords.extend(pairs.filter(is_inside).map(|pair| (net.line(side), pair)));
        }
        chords
    }

    /// Over a piece seen edge-on: between nodes over one another on the same grid point or side. Each is a line of its own.
    fn vertical_chords(&self, piece: &Piece, web: &Web, places: &[DVec3], net: &Net) -> Vec<(u32, [u32; 2])> {
        /// Places over one another differ by a tolerance at each of both edges, along them by somewhat more.
        const NEAR: f64 = 4.0;
        let mut chords = Vec::new();
        for (b, above) in (0..).zip(&web.nodes) {
            for (a, below) in (0..b).zip(&web.nodes) {
                let of_above = self.features(piece, *above);
                let meets = self.features(piece, *below).iter().any(|feature| of_above.contains(feature));
                let distance = places[a as usize].truncate().distance(places[b as usize].truncate());
                if meets && distance <= NEAR * net.tolerance() && !Self::share_side(piece, *above, *below) {
                    chords.push((chords.len() as u32, [a, b]));
                }
            }
        }
        chords
    }

    /// Rule 4, for the ends of a path at corners.
    fn starts(&self, piece: &Piece, web: &Web, path: &Path, does_curve: &impl Fn(DVec2, DVec2) -> bool) -> bool {
        let n = piece.sides.len() as u32;
        [path.nodes[0], path.nodes[path.nodes.len() - 1]].iter().any(|node| match web.nodes[*node as usize] {
            Node::Corner(k) => [k, (k + n - 1) % n].iter().any(|side| {
                let along = self.direction(piece.sides[*side as usize].edge);
                does_curve(self.place(piece, k).truncate(), along)
            }),
            _ => false,
        })
    }

    /// The number of a crossing among those of all edges.
    fn number(&self, piece: &Piece, node: Node) -> Option<u32> {
        match node {
            Node::Crossing { side, k } => Some(self.first_crossing[piece.sides[side as usize].edge as usize] + k),
            Node::Corner(_) | Node::Inner(_) => None,
        }
    }
}

/// Twice the signed area of a polygon.
fn doubled_area(polygon: &[DVec2]) -> f64 {
    polygon.windows(2).map(|w| (w[0] - polygon[0]).perp_dot(w[1] - polygon[0])).sum()
}

/// Places of a polygon with this signed area, mirrored where it runs clockwise.
fn counter_clockwise(mut places: Vec<DVec2>, area: f64) -> Vec<DVec2> {
    if area < 0.0 {
        places.iter_mut().for_each(|x| x.y = -x.y);
    }
    places
}

/// Places over the line on which a polygon is seen edge-on, as (along, h), mirrored where the polygon runs clockwise.
fn upright(polygon: &[DVec3], places: &[DVec3]) -> Vec<DVec2> {
    let from = polygon[0].truncate();
    let farthest = |best: DVec2, q: &DVec3| {
        let to = q.truncate() - from;
        if to.length_squared() > best.length_squared() { to } else { best }
    };
    let along = polygon.iter().fold(DVec2::ZERO, farthest).try_normalize().unwrap_or(DVec2::X);
    let over = |q: &DVec3| DVec2::new((q.truncate() - from).dot(along), q.z);
    let area = doubled_area(&polygon.iter().map(over).collect::<Vec<_>>());
    let mirror = if area < 0.0 { -1.0 } else { 1.0 };
    places.iter().map(|q| over(q) * DVec2::new(mirror, 1.0)).collect()
}

/// Grid points farther inside a convex polygon of this signed area than the tolerance.
fn points_inside(polygon: &[DVec2], area: f64, net: &Net) -> Vec<u32> {
    let (low, high) =
        polygon.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)));
    let is_inside = |p: &u32| {
        let x = net.point(*p);
        (0..polygon.len()).all(|k| {
            let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            (b - a).perp_dot(x - a) * area.signum() > net.tolerance() * a.distance(b)
        })
    };
    net.points_near(low, high).into_iter().filter(is_inside).collect()
}

/// Chords of one line that meet at nodes inside, as ways from border to border. At a pole lines end: there the first two are one way, and
/// the others end in the middle of it.
fn joined(
    chords: &[(u32, [u32; 2])],
    border: usize,
    places: &[DVec3],
    does_curve: &impl Fn(DVec2, DVec2) -> bool,
) -> Vec<Path> {
    let is_inner = |node: u32| node as usize >= border;
    let mut is_used = vec![false; chords.len()];
    let mut ways: Vec<Vec<u32>> = Vec::new();
    let mut ending: Vec<Vec<u32>> = Vec::new();
    for start in 0..chords.len() {
        let (line, ends) = chords[start];
        let Some(from) = (0..2).find(|end| !is_inner(ends[*end])).filter(|_| !is_used[start]) else { continue };
        is_used[start] = true;
        let mut nodes = vec![ends[from], ends[1 - from]];
        while let Some(at) = nodes.last().copied().filter(|at| is_inner(*at)) {
            let next = (0..chords.len()).find(|c| !is_used[*c] && chords[*c].0 == line && chords[*c].1.contains(&at));
            let Some(next) = next else { break };
            is_used[next] = true;
            let [a, b] = chords[next].1;
            nodes.push(if a == at { b } else { a });
        }
        let ends_inside = is_inner(nodes[nodes.len() - 1]);
        if ends_inside { &mut ending } else { &mut ways }.push(nodes);
    }
    let bends = |nodes: &[u32], k: usize| {
        let flat = |k: usize| places[nodes[k] as usize].truncate();
        k > 0 && k + 1 < nodes.len() && does_curve(flat(k), flat(k + 1) - flat(k - 1))
    };
    let mut paths: Vec<Path> = ways
        .into_iter()
        .map(|nodes| Path { bends: (0..nodes.len()).map(|k| bends(&nodes, k)).collect(), nodes })
        .collect();
    // A line that ends inside alone, as rounding may have it, cuts nothing.
    let last = |nodes: &Vec<u32>| nodes[nodes.len() - 1];
    ending.sort_by_key(last);
    for at_pole in ending.chunk_by(|a, b| last(a) == last(b)).filter(|at_pole| at_pole.len() > 1) {
        let pole = last(&at_pole[0]);
        let mut first = at_pole[0].clone();
        first.extend(at_pole[1].iter().rev().skip(1));
        for nodes in std::iter::once(first).chain(at_pole[2..].iter().cloned()) {
            // One is kept with all others.
            let bends = (0..nodes.len()).map(|k| nodes[k] == pole || bends(&nodes, k)).collect();
            paths.push(Path { bends, nodes });
        }
    }
    paths
}

/// Whether a polygon with at least three corners lies in a plane and bulges everywhere.
fn is_plane_and_convex(points: &[DVec3]) -> bool {
    let n = points.len();
    let from = |k: usize| points[k] - points[0];
    let normal: DVec3 = (2..n).map(|k| from(k - 1).cross(from(k))).sum();
    let size = (1..n).map(|k| from(k).length()).fold(0.0, f64::max);
    let Some(normal) = normal.try_normalize() else { return false };
    let is_plane = (1..n).all(|k| from(k).dot(normal).abs() <= PLANE * size);
    let turn = |k: usize| {
        let (a, b, c) = (points[k], points[(k + 1) % n], points[(k + 2) % n]);
        (b - a).cross(c - b).dot(normal)
    };
    let is_fan = (2..n).all(|k| from(k - 1).cross(from(k)).dot(normal) >= 0.0);
    is_plane && is_fan && (0..n).all(|k| turn(k) >= 0.0)
}

/// All pieces with their paths, and what of it is kept.
struct Woven {
    pieces: Vec<Web>,
    /// Whether a crossing is kept, by its number.
    is_kept: Vec<bool>,
}

impl Woven {
    /// Rules 1 to 4; of the paths those that are not kept are dropped.
    fn keep(&mut self, skeleton: &Skeleton, does_curve: &(impl Fn(DVec2, DVec2) -> bool + Send + Sync)) {
        let curved = parallel::map_chunks(skeleton.edges.len(), parallel::CHUNK, |range| {
            let of_edge = |edge: usize| {
                let count = skeleton.crossings[edge].inner.len() as u32;
                let edge = edge as u32;
                (0..count)
                    .map(|k| does_curve(skeleton.crossing(edge, k).truncate(), skeleton.direction(edge)))
                    .collect::<Vec<_>>()
            };
            range.flat_map(of_edge).collect::<Vec<_>>()
        });
        let curved = curved.concat();
        self.is_kept = vec![false; curved.len()];
        // Paths by number; where a crossing is the end of which.
        let paths: Vec<(usize, usize)> =
            self.pieces.iter().enumerate().flat_map(|(p, web)| (0..web.paths.len()).map(move |k| (p, k))).collect();
        let mut path_is_kept = vec![false; paths.len()];
        let mut ending_at = vec![Vec::new(); curved.len()];
        let mut first_path = Vec::with_capacity(self.pieces.len());
        let mut count = 0;
        for (piece, web) in skeleton.pieces.iter().zip(&self.pieces) {
            first_path.push(count);
            for path in &web.paths {
                for end in [path.nodes[0], path.nodes[path.nodes.len() - 1]] {
                    if let Some(number) = skeleton.number(piece, web.nodes[end as usize]) {
                        ending_at[number as usize].push(count);
                    }
                }
                count += 1;
            }
        }
        let mut queue: VecDeque<usize> = VecDeque::new();
        for (number, _) in curved.iter().enumerate().filter(|(_, is_curved)| **is_curved) {
            self.is_kept[number] = true;
            queue.extend(&ending_at[number]);
        }
        queue.extend((0..paths.len()).filter(|path| self.pieces[paths[*path].0].is_started[paths[*path].1]));
        while let Some(path) = queue.pop_front() {
            if std::mem::replace(&mut path_is_kept[path], true) {
                continue;
            }
            let (p, k) = paths[path];
            let web = &self.pieces[p];
            let Path { nodes, bends } = &web.paths[k];
            for end in [nodes[0], nodes[nodes.len() - 1]] {
                if let Some(number) = skeleton.number(&skeleton.pieces[p], web.nodes[end as usize])
                    && !std::mem::replace(&mut self.is_kept[number as usize], true)
                {
                    queue.extend(&ending_at[number as usize]);
                }
            }
            for (node, _) in nodes.iter().zip(bends).filter(|(_, bends)| **bends) {
                let others = (0..web.paths.len()).filter(|other| web.paths[*other].nodes.contains(node));
                queue.extend(others.map(|other| first_path[p] + other));
            }
        }
        let mut kept = path_is_kept.into_iter();
        for web in &mut self.pieces {
            web.paths.retain(|_| kept.next() == Some(true));
        }
    }
}

/// The subdivision as it grows.
struct Output<'a> {
    skeleton: &'a Skeleton<'a>,
    woven: &'a Woven,
    result: Subdivision,
    /// The first new vertex of an edge between two vertices, and of a diagonal, by its edge.
    of_edge: FxHashMap<[u32; 2], u32>,
    of_diagonal: FxHashMap<u32, u32>,
    old: usize,
}

/// A corner of a new face: its vertex, and its mix of corners of the old face.
type Corner = (u32, [(u32, f64); 3]);

impl<'a> Output<'a> {
    fn new(skeleton: &'a Skeleton<'a>, woven: &'a Woven) -> Self {
        let is_inner = |web: &Web| web.nodes.len() - web.border;
        let candidates = [woven.is_kept.len(), woven.pieces.iter().map(is_inner).sum()];
        let result = Subdivision { candidates, ..Subdivision::default() };
        let old = skeleton.places.len();
        Self { skeleton, woven, result, of_edge: FxHashMap::default(), of_diagonal: FxHashMap::default(), old }
    }

    fn finished(mut self, mesh: &Mesh) -> Result<Subdivision, SubdivideError> {
        let faces = mesh.faces();
        self.result.refinement.faces = Faces::with_capacity(faces.len(), faces.corners().len());
        for (f, face) in faces.iter().enumerate() {
            self.add_face(f, face);
            let vertices = self.old + self.result.refinement.vertices.len();
            if u32::try_from(vertices).is_err() {
                return Err(SubdivideError::TooMany { vertices });
            }
        }
        Ok(self.result)
    }

    fn add_face(&mut self, f: usize, face: &[u32]) {
        let (skeleton, woven) = (self.skeleton, self.woven);
        let (parts, sides) = &skeleton.faces[f];
        let has_point = |side: &Side| {
            let first = skeleton.first_crossing[side.edge as usize] as usize;
            let count = skeleton.crossings[side.edge as usize].inner.len();
            woven.is_kept[first..first + count].contains(&true)
        };
        let is_cut = match parts {
            Parts::Whole => sides.iter().any(has_point),
            Parts::Pieces(pieces) => pieces
                .clone()
                .any(|p| !woven.pieces[p].paths.is_empty() || skeleton.pieces[p].sides.iter().any(has_point)),
        };
        let corner = |k: u32| (face[k as usize], alone(k));
        match parts {
            _ if !is_cut => self.push(f, &(0..face.len() as u32).map(corner).collect::<Vec<_>>()),
            Parts::Pieces(pieces) => pieces.clone().for_each(|p| self.add_piece(p)),
            Parts::Whole => {
                // A face that touches itself only gets the points of its edges.
                let corners = distinct_corners(face, &skeleton.welded);
                let piece = Piece { face: f as u32, corners, sides: sides.clone() };
                let mut round = Vec::new();
                for node in skeleton.border(&piece.sides) {
                    if self.is_kept(&piece, node) {
                        round.push(self.corner(&piece, node, &[]));
                    }
                }
                self.push(f, &round);
            }
        }
    }

    fn is_kept(&self, piece: &Piece, node: Node) -> bool {
        self.skeleton.number(piece, node).is_none_or(|number| self.woven.is_kept[number as usize])
    }

    fn add_piece(&mut self, p: usize) {
        let (piece, web) = (&self.skeleton.pieces[p], &self.woven.pieces[p]);
        let border = (0..web.border as u32).filter(|k| self.is_kept(piece, web.nodes[*k as usize])).collect();
        let mut cut = Cut::new(&web.plane, border);
        web.paths.iter().for_each(|path| cut.along(&path.nodes));
        // Straight lines: the sides, and the paths.
        let share = |a: u32, b: u32| {
            Skeleton::share_side(piece, web.nodes[a as usize], web.nodes[b as usize])
                || web.paths.iter().any(|path| path.nodes.contains(&a) && path.nodes.contains(&b))
        };
        let pieces = cut.pieces(share);
        let corners: Vec<DVec2> =
            (0..piece.corners.len() as u32).map(|k| self.skeleton.place(piece, k).truncate()).collect();
        let mut made: FxHashMap<u32, Corner> = FxHashMap::default();
        for polygon in pieces {
            let round: Vec<Corner> = polygon
                .iter()
                .map(|k| match made.get(k) {
                    Some(corner) => *corner,
                    None => {
                        let inside = inner_mix(piece, web, *k, &corners);
                        let corner = self.corner(piece, web.nodes[*k as usize], &inside);
                        made.insert(*k, corner);
                        corner
                    }
                })
                .collect();
            self.push(piece.face as usize, &round);
        }
    }

    /// The corner at a node; `inside` are the corners of the face that an inner one mixes.
    fn corner(&mut self, piece: &Piece, node: Node, inside: &[(u32, f64)]) -> Corner {
        let skeleton = self.skeleton;
        let face = skeleton.mesh.faces().face(piece.face as usize);
        match node {
            Node::Corner(k) => {
                let k = piece.corners[k as usize];
                (face[k as usize], alone(k))
            }
            Node::Crossing { side, k } => {
                let Side { edge, is_reversed } = piece.sides[side as usize];
                let n = piece.corners.len();
                let ends = [piece.corners[side as usize], piece.corners[(side as usize + 1) % n]];
                let [a, b] = if is_reversed { [ends[1], ends[0]] } else { ends };
                let (u, v) = (face[a as usize], face[b as usize]);
                let base = self.base(piece, edge, [u, v]);
                let first = skeleton.first_crossing[edge as usize] as usize;
                let before = self.woven.is_kept[first..first + k as usize].iter().filter(|is_kept| **is_kept).count();
                let t = skeleton.crossings[edge as usize].inner[k as usize].t;
                (base + before as u32, [(a, 1.0 - t), (b, t), (a, 0.0)])
            }
            Node::Inner(_) => {
                let mix = [inside[0], inside[1], inside[2]];
                let vertex = (self.old + self.result.refinement.vertices.len()) as u32;
                self.result.refinement.vertices.push(mix.map(|(k, w)| (face[k as usize], w)));
                self.result.kinds.push(PointKind::Face);
                (vertex, mix)
            }
        }
    }

    /// The first new vertex on an edge, whose kept crossings become vertices between u and v where they are not yet.
    fn base(&mut self, piece: &Piece, edge: u32, [u, v]: [u32; 2]) -> u32 {
        let skeleton = self.skeleton;
        let next = (self.old + self.result.refinement.vertices.len()) as u32;
        let is_diagonal = !skeleton.faces[piece.face as usize].1.iter().any(|side| side.edge == edge);
        let base = if is_diagonal {
            *self.of_diagonal.entry(edge).or_insert(next)
        } else {
            *self.of_edge.entry([u, v]).or_insert(next)
        };
        if base == next {
            let first = skeleton.first_crossing[edge as usize] as usize;
            for (k, crossing) in skeleton.crossings[edge as usize].inner.iter().enumerate() {
                if self.woven.is_kept[first + k] {
                    let t = crossing.t;
                    self.result.refinement.vertices.push([(u, 1.0 - t), (v, t), (u, 0.0)]);
                    self.result.kinds.push(PointKind::Edge);
                }
            }
        }
        base
    }

    fn push(&mut self, face: usize, corners: &[Corner]) {
        let refinement = &mut self.result.refinement;
        refinement.faces.push(&corners.iter().map(|corner| corner.0).collect::<Vec<_>>());
        refinement.origins.push(face as u32);
        refinement.corners.extend(corners.iter().map(|corner| corner.1));
    }
}

/// The mix that is one corner.
fn alone(k: u32) -> [(u32, f64); 3] {
    [(k, 1.0), (k, 0.0), (k, 0.0)]
}

/// The corners of a face that do not stand where the one before does.
fn distinct_corners(face: &[u32], welded: &[u32]) -> Vec<u32> {
    let at = |k: u32| welded[face[k as usize] as usize];
    let mut corners: Vec<u32> = (0..face.len() as u32).collect();
    corners.dedup_by(|next, kept| at(*next) == at(*kept));
    while corners.len() > 1 && at(corners[0]) == at(corners[corners.len() - 1]) {
        corners.pop();
    }
    corners
}

/// An inner node as a mix of the corners of the triangle of the piece's fan in which it is; empty for others.
fn inner_mix(piece: &Piece, web: &Web, node: u32, corners: &[DVec2]) -> Vec<(u32, f64)> {
    let Node::Inner(_) = web.nodes[node as usize] else { return Vec::new() };
    let mirrored = doubled_area(corners) < 0.0;
    let x = web.plane[node as usize] * DVec2::new(1.0, if mirrored { -1.0 } else { 1.0 });
    let weights = |k: usize| {
        let [a, b, c] = [corners[0], corners[k - 1], corners[k]];
        let whole = (b - a).perp_dot(c - a);
        let (of_b, of_c) = ((x - a).perp_dot(c - a) / whole, (b - a).perp_dot(x - a) / whole);
        [1.0 - of_b - of_c, of_b, of_c]
    };
    // Where it is least outside; by rounding alone where it is on a diagonal.
    let least = |w: [f64; 3]| w.into_iter().fold(f64::INFINITY, f64::min);
    let inside = (2..corners.len()).map(|k| (k, weights(k))).filter(|(_, w)| w.iter().all(|w| w.is_finite()));
    let best = inside.max_by(|a, b| least(a.1).total_cmp(&least(b.1)));
    let (k, [_, of_b, of_c]) = best.expect("a polygon with points inside has an area");
    let of_b = of_b.clamp(0.0, 1.0);
    let of_c = of_c.clamp(0.0, 1.0 - of_b);
    vec![(piece.corners[0], 1.0 - of_b - of_c), (piece.corners[k - 1], of_b), (piece.corners[k], of_c)]
}
