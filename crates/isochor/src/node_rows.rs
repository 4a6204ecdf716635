//! Rows of W as boxes of nodes, for sums over pairs of nodes.
//!
//! A vertex follows a box of nodes: those of its cell in the lattice. The apex of a virtual cap is the mean of the vertices of its boundary,
//! and so is its row.

use crate::binding::Binding;
use crate::parallel;
use crate::volume::Solid;

/// The rows of a body's vertices, followed by those of the apexes of its caps.
#[derive(Clone, Debug)]
pub(crate) struct NodeRows {
    /// Nodes of the lattice along u, v, w.
    size: [usize; 3],
    boxes: Vec<NodeBox>,
    values: Vec<f64>,
}

/// Nodes `first[a]..first[a] + size[a]` along each axis a.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct NodeBox {
    pub(crate) first: [usize; 3],
    pub(crate) size: [usize; 3],
    /// Where the values begin.
    at: usize,
}

impl NodeBox {
    pub(crate) fn count(&self) -> usize {
        self.size.iter().product()
    }

    fn is_empty(&self) -> bool {
        self.count() == 0
    }

    /// The same box without values.
    pub(crate) fn bare(self) -> Self {
        Self { at: 0, ..self }
    }

    /// The smallest box that holds both; an empty one holds nothing.
    pub(crate) fn with(self, other: Self) -> Self {
        if self.is_empty() {
            return Self { at: 0, ..other };
        }
        if other.is_empty() {
            return Self { at: 0, ..self };
        }
        let first = [0, 1, 2].map(|a| self.first[a].min(other.first[a]));
        let end = |a: usize| (self.first[a] + self.size[a]).max(other.first[a] + other.size[a]);
        Self { first, size: [0, 1, 2].map(|a| end(a) - first[a]), at: 0 }
    }

    /// For each line of nodes along the last axis: its place in an array over `outer`, which holds this box, and where it begins in the values of
    /// this box.
    pub(crate) fn lines_in(self, outer: Self) -> impl Iterator<Item = (usize, usize)> {
        // An empty box is nowhere, and has no lines.
        let offset = |a: usize| if self.is_empty() { 0 } else { self.first[a] - outer.first[a] };
        let [i0, j0, k0] = [0, 1, 2].map(offset);
        let line = move |(i, j)| {
            (((i0 + i) * outer.size[1] + j0 + j) * outer.size[2] + k0, (i * self.size[1] + j) * self.size[2])
        };
        (0..self.size[0]).flat_map(move |i| (0..self.size[1]).map(move |j| (i, j))).map(line)
    }
}

impl NodeRows {
    /// Of the vertices of `solid`, which follow nodes as `binding` says, and of its apexes.
    pub(crate) fn of(solid: &Solid, binding: &Binding) -> Self {
        let size = binding.size();
        let whole = NodeBox { first: [0; 3], size, at: 0 };
        let mut boxes = Vec::with_capacity(binding.vertex_count() + solid.cap_count());
        let mut at = 0;
        for v in 0..binding.vertex_count() {
            let (first, size) = binding.reach_of(v);
            boxes.push(NodeBox { first, size, at });
            at += size.iter().product::<usize>();
        }
        let mut values = vec![0.0; at];
        let bound: Vec<usize> = (0..boxes.len()).filter(|v| !boxes[*v].is_empty()).collect();
        if let Some(length) = bound.first().map(|v| boxes[*v].count()) {
            parallel::for_each_chunk(&mut values, length * parallel::CHUNK, |first, values| {
                let mut scratch = Vec::new();
                for (v, row) in bound[first / length..].iter().zip(values.chunks_mut(length)) {
                    binding.fill_row(*v, row, &mut scratch);
                }
            });
        }
        let mut rows = Self { size, boxes, values };
        for members in solid.cap_members() {
            let mut mean = vec![0.0; whole.count()];
            members.iter().for_each(|v| rows.add_to(*v as usize, 1.0 / members.len() as f64, whole, &mut mean));
            rows.boxes.push(NodeBox { at: rows.values.len(), ..whole });
            rows.values.extend(mean);
        }
        rows
    }

    /// Nodes of the lattice along u, v, w.
    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Number of rows: vertices and apexes.
    pub(crate) fn len(&self) -> usize {
        self.boxes.len()
    }

    /// The nodes that a vertex follows.
    pub(crate) fn nodes(&self, v: usize) -> NodeBox {
        self.boxes[v]
    }

    /// The values of its row, the last axis first.
    pub(crate) fn row(&self, v: usize) -> &[f64] {
        let of = self.boxes[v];
        &self.values[of.at..of.at + of.count()]
    }

    /// Adds `factor` times row v to an array over `outer`.
    pub(crate) fn add_to(&self, v: usize, factor: f64, outer: NodeBox, to: &mut [f64]) {
        let (of, row) = (self.boxes[v], self.row(v));
        for (place, at) in of.lines_in(outer) {
            let line = &row[at..at + of.size[2]];
            to[place..place + line.len()].iter_mut().zip(line).for_each(|(to, x)| *to += factor * x);
        }
    }
}
