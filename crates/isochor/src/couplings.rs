//! Second derivatives, by the nodes of a lattice, of what is a sum over the triangles of a mesh.
//!
//! With `F = Σ_f F_f(p_l, p_m, p_n)` and `p_v = Σ_a φ_a(v) c_a`,
//!
//! ```text
//! ∂²F/∂c_a∂c_b = Σ_v φ_a(v) Y_v,b,   Y_v,b = Σ_w φ_b(w) ∂²F/∂p_v∂p_w
//! ```
//!
//! v over the vertices, w over the corners of the triangles at v. Both follow few nodes, so that few pairs (a, b) are coupled.

use std::ops::Range;

use crate::binding::Binding;
use crate::block_matrix::Neighbours;
use crate::node_rows::{NodeBox, NodeRows};
use crate::parallel;
use crate::volume::Solid;

/// A body and the pairs of nodes that it couples.
#[derive(Clone, Debug)]
pub(crate) struct Couplings {
    rows: NodeRows,
    neighbours: Neighbours,
    /// The triangles at each vertex: `triangles[starts[v]..starts[v + 1]]`.
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Couplings {
    /// Of `solid`, whose vertices follow nodes as `binding` says.
    pub(crate) fn of(solid: &Solid, binding: &Binding) -> Self {
        let rows = NodeRows::of(solid, binding);
        let triangles = solid.all_triangles();
        let mut reach = [1; 3];
        let mut starts = vec![0; rows.len() + 1];
        for triangle in triangles {
            let nodes = triangle.iter().fold(NodeBox::default(), |nodes, v| nodes.with(rows.nodes(*v as usize)));
            reach = [0, 1, 2].map(|a| reach[a].max(nodes.size[a].saturating_sub(1)));
            triangle.iter().for_each(|v| starts[*v as usize + 1] += 1);
        }
        (0..rows.len()).for_each(|v| starts[v + 1] += starts[v]);
        let mut next = starts.clone();
        let mut of_vertices = vec![0; 3 * triangles.len()];
        for (t, triangle) in (0..).zip(triangles) {
            for v in triangle {
                of_vertices[next[*v as usize] as usize] = t;
                next[*v as usize] += 1;
            }
        }
        let size = rows.size();
        let reach = [0, 1, 2].map(|a| reach[a].min(size[a] - 1));
        Self { neighbours: Neighbours { size, reach }, rows, starts, triangles: of_vertices }
    }

    /// Which pairs are coupled.
    pub(crate) fn neighbours(&self) -> Neighbours {
        self.neighbours
    }

    /// The sums for each pair, by [`Neighbours::place`], each of D numbers. `of_corner(component, [v, w, x])` gives, for a triangle and one of its
    /// corners v, the second derivatives by p_v and by p_v, p_w and p_x.
    pub(crate) fn sums<const D: usize>(
        &self,
        solid: &Solid,
        of_corner: impl Fn(usize, [u32; 3]) -> [[f64; D]; 3] + Sync + Send,
    ) -> Vec<[f64; D]> {
        /// Sums that are made at the same time. More: more memory.
        const PARTS: usize = 8;
        let places = self.neighbours.count().unwrap_or_default();
        let vertices = self.rows.len();
        let of_part = |range: Range<usize>| {
            let mut sums = vec![[0.0; D]; places];
            let mut of_window = Vec::new();
            range.for_each(|v| self.add(solid, v, &of_corner, &mut of_window, &mut sums));
            sums
        };
        let mut parts = parallel::map_chunks(vertices, vertices.div_ceil(PARTS).max(1), of_part).into_iter();
        let mut sums = parts.next().unwrap_or_default();
        for part in parts {
            sums.iter_mut().zip(part).for_each(|(sum, part)| (0..D).for_each(|d| sum[d] += part[d]));
        }
        sums
    }

    /// Adds what belongs to vertex v; `of_window` may hold anything.
    fn add<const D: usize>(
        &self,
        solid: &Solid,
        v: usize,
        of_corner: &impl Fn(usize, [u32; 3]) -> [[f64; D]; 3],
        of_window: &mut Vec<[f64; D]>,
        sums: &mut [[f64; D]],
    ) {
        let own = self.rows.nodes(v);
        let at = &self.triangles[self.starts[v] as usize..self.starts[v + 1] as usize];
        if own.count() == 0 || at.is_empty() {
            return;
        }
        let turned = |t: u32| {
            let [a, b, c] = solid.all_triangles()[t as usize];
            let v = v as u32;
            if a == v { [a, b, c] } else if b == v { [b, c, a] } else { [c, a, b] }
        };
        let corners = || at.iter().flat_map(|t| turned(*t));
        let window = corners().fold(NodeBox::default(), |nodes, w| nodes.with(self.rows.nodes(w as usize)));
        of_window.clear();
        of_window.resize(window.count(), [0.0; D]);
        for t in at {
            let corners = turned(*t);
            let component = solid.component_ranges().partition_point(|range| range.end <= *t as usize);
            for (w, derivative) in corners.into_iter().zip(of_corner(component, corners)) {
                let (nodes, row) = (self.rows.nodes(w as usize), self.rows.row(w as usize));
                for (place, at) in nodes.lines_in(window) {
                    let line = &row[at..at + nodes.size[2]];
                    for (to, x) in of_window[place..place + line.len()].iter_mut().zip(line) {
                        (0..D).for_each(|d| to[d] += x * derivative[d]);
                    }
                }
            }
        }
        let [_, wide, long] = window.size;
        for (i, x) in self.rows.row(v).iter().enumerate() {
            let node = [i / (own.size[1] * own.size[2]), i / own.size[2] % own.size[1], i % own.size[2]];
            let node = [0, 1, 2].map(|a| own.first[a] + node[a]);
            let a = self.neighbours.index(node);
            for u in node[0] - window.first[0]..window.size[0] {
                for line in 0..wide {
                    let b = [window.first[0] + u, window.first[1] + line, window.first[2]];
                    let place = self.neighbours.place(a, b);
                    let from = &of_window[(u * wide + line) * long..][..long];
                    for (to, y) in sums[place..place + long].iter_mut().zip(from) {
                        (0..D).for_each(|d| to[d] += x * y[d]);
                    }
                }
            }
        }
    }
}
