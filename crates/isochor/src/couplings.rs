//! Second derivatives, by the nodes of a lattice, of what is a sum over the triangles of a mesh.
//!
//! With `F = Σ_f F_f(p_l, p_m, p_n)` and `p_v = Σ_a φ_a(v) c_a`,
//!
//! ```text
//! ∂²F/∂c_a∂c_b = Σ_v φ_a(v) Y_v,b,   Y_v,b = Σ_w φ_b(w) ∂²F/∂p_v∂p_w
//! ```
//!
//! v over the vertices, w over the corners of the triangles at v. Both follow few nodes, so that few pairs (a, b) are coupled. Vertices that follow the
//! same nodes, and whose neighbours do, are taken together: their sum is a matrix product.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

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
    /// Vertices that follow nodes, those of a batch one after another.
    order: Vec<u32>,
    batches: Vec<Batch>,
}

/// Vertices that are taken together.
#[derive(Clone, Debug)]
struct Batch {
    /// The nodes that they follow.
    own: NodeBox,
    /// Those that the corners of their triangles follow.
    window: NodeBox,
    /// Where they are in the order.
    vertices: Range<usize>,
}

/// Vertices of a batch at most. More: its matrices leave the processor's cache; fewer: products are slower.
const BATCH: usize = 128;

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
        let neighbours = Neighbours { size, reach };
        let mut couplings =
            Self { rows, neighbours, starts, triangles: of_vertices, order: Vec::new(), batches: Vec::new() };
        let boxes = |v: usize| {
            let corners = couplings.at(v).iter().flat_map(|t| triangles[*t as usize]);
            (
                couplings.rows.nodes(v).bare(),
                corners.fold(NodeBox::default(), |nodes, w| nodes.with(couplings.rows.nodes(w as usize))),
            )
        };
        let is_moved = |v: &usize| couplings.rows.nodes(*v).count() > 0 && !couplings.at(*v).is_empty();
        let mut keys: Vec<_> = (0..couplings.rows.len()).filter(is_moved).map(|v| (boxes(v), v as u32)).collect();
        keys.sort_unstable();
        for run in keys.chunk_by(|a, b| a.0 == b.0) {
            for part in run.chunks(BATCH) {
                let first = couplings.order.len();
                let (own, window) = part[0].0;
                couplings.order.extend(part.iter().map(|(_, v)| *v));
                couplings.batches.push(Batch { own, window, vertices: first..couplings.order.len() });
            }
        }
        couplings
    }

    /// The triangles at a vertex.
    fn at(&self, v: usize) -> &[u32] {
        &self.triangles[self.starts[v] as usize..self.starts[v + 1] as usize]
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
        let of_part = |range: Range<usize>| {
            let mut sums = vec![[0.0; D]; places];
            let mut scratch = Scratch::default();
            self.batches[range].iter().for_each(|batch| self.add(solid, batch, &of_corner, &mut scratch, &mut sums));
            sums
        };
        let batches = self.batches.len();
        let mut parts = parallel::map_chunks(batches, batches.div_ceil(PARTS).max(1), of_part).into_iter();
        let mut sums = parts.next().unwrap_or_else(|| vec![[0.0; D]; places]);
        for part in parts {
            sums.iter_mut().zip(part).for_each(|(sum, part)| (0..D).for_each(|d| sum[d] += part[d]));
        }
        sums
    }

    /// Adds what belongs to the vertices of a batch.
    fn add<const D: usize>(
        &self,
        solid: &Solid,
        Batch { own, window, vertices }: &Batch,
        of_corner: &impl Fn(usize, [u32; 3]) -> [[f64; D]; 3],
        Scratch { values, of_windows, product }: &mut Scratch<D>,
        sums: &mut [[f64; D]],
    ) {
        let (nodes, others, count) = (own.count(), window.count(), vertices.len());
        values.clear();
        of_windows.clear();
        of_windows.resize(count * others, [0.0; D]);
        for (v, of_window) in self.order[vertices.clone()].iter().zip(of_windows.chunks_mut(others)) {
            values.extend_from_slice(self.rows.row(*v as usize));
            for t in self.at(*v as usize) {
                let [a, b, c] = solid.all_triangles()[*t as usize];
                let corners = if a == *v {
                    [a, b, c]
                } else if b == *v {
                    [b, c, a]
                } else {
                    [c, a, b]
                };
                let component = solid.component_ranges().partition_point(|range| range.end <= *t as usize);
                for (w, derivative) in corners.into_iter().zip(of_corner(component, corners)) {
                    if derivative != [0.0; D] {
                        self.add_row(w as usize, derivative, *window, of_window);
                    }
                }
            }
        }
        product.clear();
        product.resize(nodes * others, [0.0; D]);
        let columns = D * others;
        let values = MatRef::from_row_major_slice(&values[..], count, nodes);
        let of_windows = MatRef::from_row_major_slice(of_windows.as_flattened(), count, columns);
        let into = MatMut::from_row_major_slice_mut(product.as_flattened_mut(), nodes, columns);
        matmul(into, Accum::Replace, values.transpose(), of_windows, 1.0, Par::Seq);
        let [_, wide, long] = window.size;
        for (i, of_node) in product.chunks(others).enumerate() {
            let node = [i / (own.size[1] * own.size[2]), i / own.size[2] % own.size[1], i % own.size[2]];
            let node = [0, 1, 2].map(|a| own.first[a] + node[a]);
            let a = self.neighbours.index(node);
            for u in node[0] - window.first[0]..window.size[0] {
                for line in 0..wide {
                    let b = [window.first[0] + u, window.first[1] + line, window.first[2]];
                    let place = self.neighbours.place(a, b);
                    let from = &of_node[(u * wide + line) * long..][..long];
                    for (to, y) in sums[place..place + long].iter_mut().zip(from) {
                        (0..D).for_each(|d| to[d] += y[d]);
                    }
                }
            }
        }
    }

    /// Adds the row of a vertex, times D numbers, to an array over `window`.
    fn add_row<const D: usize>(&self, v: usize, numbers: [f64; D], window: NodeBox, to: &mut [[f64; D]]) {
        let (nodes, row) = (self.rows.nodes(v), self.rows.row(v));
        for (place, at) in nodes.lines_in(window) {
            let line = &row[at..at + nodes.size[2]];
            for (to, x) in to[place..place + line.len()].iter_mut().zip(line) {
                (0..D).for_each(|d| to[d] += x * numbers[d]);
            }
        }
    }
}

/// Memory of a batch.
struct Scratch<const D: usize> {
    /// φ of its vertices (#vertices × #own nodes).
    values: Vec<f64>,
    /// Y (#vertices × #nodes of the window × D).
    of_windows: Vec<[f64; D]>,
    /// Their product (#own nodes × #nodes of the window × D).
    product: Vec<[f64; D]>,
}

impl<const D: usize> Default for Scratch<D> {
    fn default() -> Self {
        Self { values: Vec::new(), of_windows: Vec::new(), product: Vec::new() }
    }
}
