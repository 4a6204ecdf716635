//! A closed surface round points, with fewer triangles, that keeps its distance from them.
//!
//! Given a closed, embedded surface that holds points at a distance of at least D, find one of few triangles that does so, too. Edges are collapsed in the
//! order of the quadric error (M. Garland, P. Heckbert, *Surface simplification using quadric error metrics*, 1997): an edge (u, v) becomes a vertex w
//! where `Q_u + Q_v` is smallest. As in progressive hulls (P. V. Sander and others, *Silhouette clipping*, 2000) w goes outward where that is needed.
//!
//! A collapse is allowed where the surface stays what it is:
//!
//! - *two-manifold*: u and v have two common neighbours (T. K. Dey and others, *Topology preserving edge contraction*, 1999) and are not of a tetrahedron;
//! - *embedded*: none of the new triangles meets another where it should not, exactly ([`is_improper`]);
//! - *round the points*: the solid between the old triangles and the new ones is that of the cones of the old triangles over w, with signs. No point may be
//!   in a cone that lies inside;
//! - *at a distance*: no point is nearer than D to a new triangle;
//! - *not folded*: a triangle's normal turns by less than 90°, and new triangles are of some shape.
//!
//! # Changes versus the papers
//!
//! - Hulls only grow, by a linear programme for each edge. Here what has to be inside is known, so the surface may move inward as long as it is, and w goes
//!   outward along the mean normal only as far as it must.
//! - Quadrics have a part that pulls w to the middles of the triangles ([`EVEN`]), so that triangles are of like sizes and w is always well defined.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DMat3, DVec3};

use crate::buckets::Buckets;
use crate::intersection::{Facet, above, is_improper};
use crate::point_tree::PointTree;

/// Weight of the squared distance to middles of triangles, relative to that to their planes. Larger: triangles are more even, and the surface is rounder than
/// what it holds; smaller: long triangles.
const EVEN: f64 = 0.03;

/// New triangles have at least these shapes, one after the other: `4 √3 area / Σ edges²`, which is 1 for equal sides. Larger: fewer edges can be
/// collapsed; smaller: needles.
const SHAPES: [f64; 2] = [0.3, 0.05];

/// How far w may go outward, in lengths of the edge. Larger: more edges can be collapsed, to less compact surfaces; smaller: fewer.
const OUTWARD: f64 = 2.0;

/// Steps in which w is brought back from there to where it is just allowed. Larger: more compact; smaller: faster.
const HALVINGS: usize = 4;

/// The squared distance from planes and middles of triangles: `x·A x + 2 b·x + c`.
#[derive(Clone, Copy)]
struct Quadric {
    a: DMat3,
    b: DVec3,
    c: f64,
}

impl Quadric {
    const ZERO: Self = Self { a: DMat3::ZERO, b: DVec3::ZERO, c: 0.0 };

    /// A third of a triangle's.
    fn of_corner(corners: [DVec3; 3]) -> Self {
        let [p, q, r] = corners;
        let normal = (q - p).cross(r - p);
        let middle = (p + q + r) / 3.0;
        let weight = normal.length() / 6.0;
        let n = normal.normalize_or_zero();
        let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        let a = (outer + DMat3::IDENTITY * EVEN) * weight;
        Self { a, b: -(a * middle), c: middle.dot(a * middle) }
    }

    fn plus(self, other: Self) -> Self {
        Self { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }

    fn at(&self, x: DVec3) -> f64 {
        x.dot(self.a * x) + 2.0 * self.b.dot(x) + self.c
    }

    /// Where it is smallest. The matrix is positive definite: its condition is at most 1/EVEN + 1.
    fn minimum(&self) -> DVec3 {
        -(self.a.inverse() * self.b)
    }
}

/// What a collapse would make of an edge.
struct Collapse {
    place: DVec3,
    cost: f64,
    /// The triangles that go, of which the first two vanish.
    old: Vec<u32>,
    /// Those that take the place of the others.
    new: Vec<[u32; 3]>,
}

/// A candidate of the queue: a cost, and the ends of an edge with their numbers of changes. Costs are not negative, so their bits are in their order.
type Candidate = Reverse<(u64, [u32; 2], [u32; 2])>;

/// A surface whose edges are collapsed.
struct Surface<'a> {
    points: Vec<DVec3>,
    /// None where a triangle has gone.
    triangles: Vec<Option<[u32; 3]>>,
    /// Triangles round each vertex.
    around: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    /// How often what is round a vertex has changed.
    changes: Vec<u32>,
    buckets: Buckets,
    held: &'a PointTree,
    distance: f64,
    /// Least shape of new triangles.
    shape: f64,
}

/// The surface with at most `wanted` triangles, or as few as were reached. `place` rounds a position to one that can be had.
pub(crate) fn collapsed(
    (points, triangles): (Vec<DVec3>, Vec<[u32; 3]>),
    held: &PointTree,
    distance: f64,
    wanted: usize,
    place: impl Fn(DVec3) -> DVec3,
) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut surface = Surface::new(points, triangles, held, distance);
    let mut count = surface.triangles.len();
    for shape in SHAPES {
        surface.shape = shape;
        // What could not be collapsed may become so by other collapses.
        loop {
            let before = count;
            count = surface.collapse_down_to(wanted, count, &place);
            if count <= wanted || count == before {
                break;
            }
        }
    }
    surface.compacted()
}

impl<'a> Surface<'a> {
    fn new(points: Vec<DVec3>, triangles: Vec<[u32; 3]>, held: &'a PointTree, distance: f64) -> Self {
        let mut around = vec![Vec::new(); points.len()];
        let mut quadrics = vec![Quadric::ZERO; points.len()];
        let mut buckets = Buckets::over(&points);
        for (t, triangle) in triangles.iter().enumerate() {
            let corners = triangle.map(|v| points[v as usize]);
            let quadric = Quadric::of_corner(corners);
            for v in triangle {
                around[*v as usize].push(t as u32);
                quadrics[*v as usize] = quadrics[*v as usize].plus(quadric);
            }
            buckets.insert(t as u32, corners);
        }
        let changes = vec![0; points.len()];
        let triangles = triangles.into_iter().map(Some).collect();
        Self { points, triangles, around, quadrics, changes, buckets, held, distance, shape: 0.0 }
    }

    /// Collapses edges until there are `wanted` triangles or every edge has been looked at since it last changed; gives the number of triangles.
    fn collapse_down_to(&mut self, wanted: usize, mut count: usize, place: &impl Fn(DVec3) -> DVec3) -> usize {
        let mut queue: BinaryHeap<Candidate> = BinaryHeap::new();
        for t in self.triangles.iter().flatten() {
            for edge in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if edge[0] < edge[1] {
                    queue.push(self.candidate(edge, self.least_cost(edge)));
                }
            }
        }
        while count > wanted {
            let Some(Reverse((cost, edge, changes))) = queue.pop() else { break };
            if changes != edge.map(|v| self.changes[v as usize]) {
                continue;
            }
            let Some(collapse) = self.collapse(edge, place) else { continue };
            // It may cost more than at best; others come first then.
            if collapse.cost.to_bits() > cost && queue.peek().is_some_and(|next| next.0.0 < collapse.cost.to_bits()) {
                queue.push(self.candidate(edge, collapse.cost));
                continue;
            }
            count -= 2;
            self.apply(edge, collapse);
            for v in self.neighbours(edge[0]) {
                let edge = [edge[0].min(v), edge[0].max(v)];
                queue.push(self.candidate(edge, self.least_cost(edge)));
            }
        }
        count
    }

    fn candidate(&self, edge: [u32; 2], cost: f64) -> Candidate {
        Reverse((cost.to_bits(), edge, edge.map(|v| self.changes[v as usize])))
    }

    /// The cost of a collapse that nothing hinders.
    fn least_cost(&self, [u, v]: [u32; 2]) -> f64 {
        let quadric = self.quadrics[u as usize].plus(self.quadrics[v as usize]);
        quadric.at(quadric.minimum()).max(0.0)
    }

    fn corners(&self, t: [u32; 3]) -> [DVec3; 3] {
        t.map(|v| self.points[v as usize])
    }

    fn triangle(&self, t: u32) -> [u32; 3] {
        self.triangles[t as usize].expect("the triangle has not gone")
    }

    /// The vertices that share an edge with `v`, in order.
    fn neighbours(&self, v: u32) -> Vec<u32> {
        let mut all: Vec<u32> =
            self.around[v as usize].iter().flat_map(|t| self.triangle(*t)).filter(|w| *w != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The best allowed collapse of an edge.
    fn collapse(&self, [u, v]: [u32; 2], place: &impl Fn(DVec3) -> DVec3) -> Option<Collapse> {
        let [of_u, of_v] = [u, v].map(|w| self.neighbours(w));
        let common = of_u.iter().filter(|w| of_v.binary_search(w).is_ok()).count();
        if common != 2 || (of_u.len() == 3 && of_v.len() == 3) {
            return None;
        }
        let (mut old, remaining): (Vec<u32>, Vec<u32>) =
            self.around[u as usize].iter().copied().partition(|t| self.triangle(*t).contains(&v));
        old.extend(remaining);
        old.extend(self.around[v as usize].iter().filter(|t| !self.triangle(**t).contains(&u)));
        let new: Vec<[u32; 3]> =
            old[2..].iter().map(|t| self.triangle(*t).map(|w| if w == v { u } else { w })).collect();

        let quadric = self.quadrics[u as usize].plus(self.quadrics[v as usize]);
        let best = quadric.minimum();
        let normal: DVec3 = old
            .iter()
            .map(|t| {
                let [a, b, c] = self.corners(self.triangle(*t));
                (b - a).cross(c - a)
            })
            .sum();
        let reach = OUTWARD * self.points[u as usize].distance(self.points[v as usize]);
        let at = |outward: f64| place(best + reach * outward * normal.normalize_or_zero());
        let holds = |w: DVec3| self.holds(u, w, &old, &new);
        let mut w = at(0.0);
        if !self.is_shaped(u, w, &old, &new) {
            return None;
        }
        if !holds(w) {
            // Out until it is allowed, and back.
            let (mut low, mut high) = (0.0, [0.125, 1.0].into_iter().find(|h| holds(at(*h)))?);
            for _ in 0..HALVINGS {
                let middle = (low + high) / 2.0;
                if holds(at(middle)) { high = middle } else { low = middle }
            }
            w = at(high);
            if !self.is_shaped(u, w, &old, &new) {
                return None;
            }
        }
        if !self.is_embedded(u, w, &old, &new) {
            return None;
        }
        Some(Collapse { place: w, cost: quadric.at(w).max(0.0), old, new })
    }

    /// The triangles `new` with vertex `u` at `w`.
    fn facets(&self, u: u32, w: DVec3, new: &[[u32; 3]]) -> Vec<Facet> {
        let corner = |v: u32| if v == u { w } else { self.points[v as usize] };
        new.iter().map(|t| Facet { vertices: *t, corners: t.map(corner) }).collect()
    }

    /// Whether no triangle of `new` is turned away from its old place, or thinner than it may be and the worst was.
    fn is_shaped(&self, u: u32, w: DVec3, old: &[u32], new: &[[u32; 3]]) -> bool {
        let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
        let shape = |corners: [DVec3; 3]| {
            let [a, b, c] = corners;
            let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
            2.0 * 3f64.sqrt() * normal(corners).length() / edges
        };
        let before: Vec<[DVec3; 3]> = old.iter().map(|t| self.corners(self.triangle(*t))).collect();
        let least = before.iter().fold(self.shape, |least, corners| least.min(shape(*corners)));
        let facets = self.facets(u, w, new);
        before[2..]
            .iter()
            .zip(&facets)
            .all(|(corners, facet)| normal(*corners).dot(normal(facet.corners)) > 0.0 && shape(facet.corners) >= least)
    }

    /// Whether all points stay inside, at their distance.
    fn holds(&self, u: u32, w: DVec3, old: &[u32], new: &[[u32; 3]]) -> bool {
        let holds_no_point = |t: &u32| {
            let corners = self.corners(self.triangle(*t));
            above(&corners, w) <= 0.0 || !self.held.is_any_in(corners, w)
        };
        let is_away = |f: &Facet| self.held.distance(&f.corners, self.distance) >= self.distance;
        self.facets(u, w, new).iter().all(is_away) && old.iter().all(holds_no_point)
    }

    /// Whether no triangle of `new` meets another where it should not.
    fn is_embedded(&self, u: u32, w: DVec3, old: &[u32], new: &[[u32; 3]]) -> bool {
        let facets = self.facets(u, w, new);
        facets.iter().enumerate().all(|(i, f)| facets[..i].iter().all(|g| !is_improper(f, g)))
            && facets.iter().all(|f| !self.meets_another(f, old))
    }

    /// Whether a facet meets a triangle of the surface that is not among `old`.
    fn meets_another(&self, facet: &Facet, old: &[u32]) -> bool {
        self.buckets.near(facet.corners).any(|t| {
            !old.contains(&t) && {
                let vertices = self.triangle(t);
                is_improper(facet, &Facet { vertices, corners: self.corners(vertices) })
            }
        })
    }

    fn apply(&mut self, [u, v]: [u32; 2], Collapse { place, old, new, .. }: Collapse) {
        for t in &old {
            self.buckets.remove(*t, self.corners(self.triangle(*t)));
        }
        for t in &old[..2] {
            for w in self.triangle(*t) {
                self.around[w as usize].retain(|of_w| of_w != t);
            }
            self.triangles[*t as usize] = None;
        }
        self.points[u as usize] = place;
        let of_v = std::mem::take(&mut self.around[v as usize]);
        self.around[u as usize].extend(of_v);
        self.quadrics[u as usize] = self.quadrics[u as usize].plus(self.quadrics[v as usize]);
        self.changes[u as usize] += 1;
        self.changes[v as usize] += 1;
        for (t, triangle) in old[2..].iter().zip(new) {
            self.triangles[*t as usize] = Some(triangle);
            self.buckets.insert(*t, self.corners(triangle));
        }
    }

    /// The vertices and triangles that are left.
    fn compacted(self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let is_used = |v: &usize| !self.around[*v].is_empty();
        let used: Vec<usize> = (0..self.points.len()).filter(is_used).collect();
        let mut numbers = vec![0; self.points.len()];
        used.iter().enumerate().for_each(|(new, v)| numbers[*v] = new as u32);
        let triangles = self.triangles.iter().flatten().map(|t| t.map(|v| numbers[v as usize])).collect();
        (used.iter().map(|v| self.points[*v]).collect(), triangles)
    }
}
