//! Sparse symmetric matrices of 3 × 3 blocks between nodes of a lattice, over the coordinates that may move.
//!
//! Two nodes have a block where they are less than a *reach* apart along each axis: springs reach one node far, a mesh as far as its triangles
//! lead from one box of nodes to another ([`crate::node_rows`]).

use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use glam::{BVec3, DMat3, DVec3};

/// Which pairs of nodes have a block, and where its entries are among the values of a sparse matrix.
#[derive(Clone, Debug)]
pub(crate) struct BlockPattern {
    neighbours: Neighbours,
    /// The unknown of each coordinate of each node, x, y and z of a node after one another; [`HELD`] where it may not move.
    unknowns: Vec<[u32; 3]>,
    count: usize,
    /// By place of a pair ([`Neighbours::place`]): its index among the blocks, or [`HELD`].
    blocks: Vec<u32>,
    /// By block: where its entries are, row by row; [`HELD`] for those that are not in the upper triangle or held.
    entries: Vec<[u32; 9]>,
    /// Of the upper triangle.
    symbolic: SymbolicSparseColMat<usize>,
    /// Where the diagonal is.
    diagonal: Vec<u32>,
}

/// No unknown, no block.
const HELD: u32 = u32::MAX;

/// Entries at most. More: gigabytes for the factors; fewer: 14³ nodes of cubic B-splines must do.
const MOST_ENTRIES: usize = 1 << 27;

/// Pairs of nodes (a, b) of a lattice with b less than a reach from a, and not before it along the first axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Neighbours {
    /// Nodes along u, v, w.
    pub(crate) size: [usize; 3],
    /// How far pairs may be apart.
    pub(crate) reach: [usize; 3],
}

impl Neighbours {
    /// Places for each node.
    fn around(&self) -> usize {
        let [u, v, w] = self.reach;
        (u + 1) * (2 * v + 1) * (2 * w + 1)
    }

    /// Places for all pairs; `None` where they are too many.
    pub(crate) fn count(&self) -> Option<usize> {
        let nodes: usize = self.size.iter().product();
        nodes.checked_mul(self.around()).filter(|count| *count <= MOST_ENTRIES)
    }

    pub(crate) fn node(&self, index: usize) -> [usize; 3] {
        let [_, v, w] = self.size;
        [index / (v * w), index / w % v, index % w]
    }

    pub(crate) fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.size[1] + j) * self.size[2] + k
    }

    /// Where the pair of node `a` and a node at `b` is, which is not before it along the first axis. Places of neighbours along the last
    /// axis follow one another.
    pub(crate) fn place(&self, a: usize, b: [usize; 3]) -> usize {
        let at = self.node(a);
        let [_, rv, rw] = self.reach;
        let [u, v, w] = [b[0] - at[0], b[1] + rv - at[1], b[2] + rw - at[2]];
        a * self.around() + (u * (2 * rv + 1) + v) * (2 * rw + 1) + w
    }
}

impl BlockPattern {
    /// Of the nodes with coordinates that may move (#nodes × 3). `None` where the matrix is too large.
    pub(crate) fn new(neighbours: Neighbours, is_free: &[BVec3]) -> Option<Self> {
        let places = neighbours.count()?;
        let mut count = 0;
        let mut number = |is_free: bool| if is_free { (count, count += 1).0 } else { HELD };
        let unknowns: Vec<[u32; 3]> = is_free.iter().map(|free| [free.x, free.y, free.z].map(&mut number)).collect();
        let mut blocks = vec![HELD; places];
        let mut entries = Vec::new();
        let mut columns: Vec<(u32, u32, u32, usize)> = Vec::new(); // column, row, block, which of its entries
        for a in (0..is_free.len()).filter(|a| is_free[*a].any()) {
            let at = neighbours.node(a);
            let [us, vs, ws] = [0, 1, 2].map(|axis| {
                let low = if axis == 0 { at[0] } else { at[axis].saturating_sub(neighbours.reach[axis]) };
                low..(at[axis] + neighbours.reach[axis] + 1).min(neighbours.size[axis])
            });
            for b in
                us.flat_map(|u| vs.clone().map(move |v| [u, v])).flat_map(|[u, v]| ws.clone().map(move |w| [u, v, w]))
            {
                let (place, b) = (neighbours.place(a, b), neighbours.index(b));
                if b < a || !is_free[b].any() {
                    continue;
                }
                blocks[place] = entries.len() as u32;
                for (row, i) in unknowns[a].into_iter().enumerate() {
                    for (column, j) in unknowns[b].into_iter().enumerate() {
                        if i != HELD && j != HELD && i <= j {
                            columns.push((j, i, entries.len() as u32, 3 * row + column));
                        }
                    }
                }
                entries.push([HELD; 9]);
                if columns.len() > MOST_ENTRIES {
                    return None;
                }
            }
        }
        columns.sort_unstable();
        let mut starts = vec![0; count as usize + 1];
        let mut diagonal = Vec::with_capacity(count as usize);
        for (at, (column, row, block, entry)) in columns.iter().enumerate() {
            starts[*column as usize + 1] += 1;
            entries[*block as usize][*entry] = at as u32;
            if row == column {
                diagonal.push(at as u32);
            }
        }
        (0..count as usize).for_each(|j| starts[j + 1] += starts[j]);
        let rows = columns.iter().map(|(_, row, ..)| *row as usize).collect();
        let symbolic = SymbolicSparseColMat::new_checked(count as usize, count as usize, starts, None, rows);
        Some(Self { neighbours, unknowns, count: count as usize, blocks, entries, symbolic, diagonal })
    }

    /// Number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.count
    }

    /// The upper triangle.
    pub(crate) fn symbolic(&self) -> &SymbolicSparseColMat<usize> {
        &self.symbolic
    }

    /// Where the diagonal is among the values.
    pub(crate) fn diagonal(&self) -> &[u32] {
        &self.diagonal
    }

    /// Number of values.
    pub(crate) fn values(&self) -> usize {
        self.symbolic.row_idx().len()
    }

    /// The matrix with these values.
    pub(crate) fn matrix<'a>(&'a self, values: &'a [f64]) -> SparseColMatRef<'a, usize, f64> {
        SparseColMatRef::new(self.symbolic.as_ref(), values)
    }

    /// Adds `block`, the derivative by the places of nodes a and then b, and its transpose on the other side.
    pub(crate) fn add(&self, values: &mut [f64], a: usize, b: usize, block: DMat3) {
        let (a, b, block) = if a <= b { (a, b, block) } else { (b, a, block.transpose()) };
        if self.unknowns[a] == [HELD; 3] || self.unknowns[b] == [HELD; 3] {
            return;
        }
        let at = self.entries[self.blocks[self.neighbours.place(a, self.neighbours.node(b))] as usize];
        for (entry, at) in at.into_iter().enumerate().filter(|(_, at)| *at != HELD) {
            values[at as usize] += block.col(entry % 3)[entry / 3];
        }
    }

    /// Calls `f(values, a, b, place)` for every block, a ≤ b; `place` as [`Neighbours::place`] has it.
    pub(crate) fn for_each_block(&self, mut f: impl FnMut(usize, usize, usize)) {
        for (place, _) in self.blocks.iter().enumerate().filter(|(_, block)| **block != HELD) {
            let around = self.neighbours.around();
            let (a, offset) = (place / around, place % around);
            let [_, rv, rw] = self.neighbours.reach;
            let [w, v, u] =
                [offset % (2 * rw + 1), offset / (2 * rw + 1) % (2 * rv + 1), offset / (2 * rw + 1) / (2 * rv + 1)];
            let at = self.neighbours.node(a);
            f(a, self.neighbours.index([at[0] + u, at[1] + v - rv, at[2] + w - rw]), place);
        }
    }

    /// The unknowns of something per node (#nodes × 3).
    pub(crate) fn pulled(&self, vectors: &[DVec3]) -> Vec<f64> {
        let mut pulled = vec![0.0; self.count];
        for (unknowns, vector) in self.unknowns.iter().zip(vectors) {
            for (axis, unknown) in unknowns.iter().enumerate().filter(|(_, unknown)| **unknown != HELD) {
                pulled[*unknown as usize] = vector[axis];
            }
        }
        pulled
    }

    /// `places + factor · d` (#nodes × 3) of d (#unknowns). What is held keeps its bits.
    pub(crate) fn moved(&self, places: &[DVec3], factor: f64, d: &[f64]) -> Vec<DVec3> {
        let moved = |(unknowns, place): (&[u32; 3], &DVec3)| {
            let mut place = *place;
            for (axis, unknown) in unknowns.iter().enumerate().filter(|(_, unknown)| **unknown != HELD) {
                place[axis] += factor * d[*unknown as usize];
            }
            place
        };
        self.unknowns.iter().zip(places).map(moved).collect()
    }
}
