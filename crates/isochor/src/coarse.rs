//! A coarse stand-in for a posed body, over a few of its vertices.
//!
//! Vertices are put together by the cells of a cubic grid; each cluster is represented by the member nearest to the middle of the
//! cell, which lies on the surface. Any identification of vertices keeps a closed mesh balanced, so the stand-in is a body too. It is good for second
//! derivatives; volumes and gradients are corrected against the fine mesh by whoever uses it ([`crate::nearest`]).

use std::sync::Arc;

use glam::DVec3;

use crate::binding::Binding;
use crate::mesh::Bounds;
use crate::order;
use crate::parallel;
use crate::spare::Array;
use crate::volume::Solid;

/// Vertices below which a body is its own stand-in. More: medium models take longer than they need; fewer: the stand-in is hardly
/// coarser.
pub(crate) const LEAST_VERTICES: usize = 30_000;

/// Cells along the longest side of the body. More: fewer fine evaluations; fewer: cheaper coarse ones.
const CELLS: usize = 40;

/// A body of few vertices, their binding and their posed positions.
pub(crate) struct Coarse {
    pub(crate) solid: Solid,
    pub(crate) binding: Binding,
    pub(crate) posed: Arc<Array>,
}

impl Coarse {
    /// A stand-in for `solid` at the pose `posed` (#vertices × 3); `None` where it is small already.
    pub(crate) fn of(solid: &Solid, binding: &Binding, posed: &[DVec3]) -> Option<Self> {
        if posed.len() < LEAST_VERTICES {
            return None;
        }
        let Grid { cells, mut cluster_of_cell, representatives } = Grid::of(posed)?;
        // In the order of lattice cells, as products with the binding like it.
        let binding = binding.rows_of(&representatives);
        let order = binding.cell_order();
        let places = order::places(&order);
        cluster_of_cell.iter_mut().filter(|c| **c != u32::MAX).for_each(|c| *c = places[*c as usize]);
        Some(Self {
            solid: solid.clustered(&cells, &cluster_of_cell, representatives.len()),
            binding: binding.rows_of(&order),
            posed: Arc::new(Array::of(order.iter().map(|c| posed[representatives[*c as usize] as usize]).collect())),
        })
    }
}

/// Points put together by cells.
struct Grid {
    /// The cell of each point (#points).
    cells: Vec<u32>,
    /// The cluster of each cell; of one without points `u32::MAX`.
    cluster_of_cell: Vec<u32>,
    /// The point that stands for each cluster.
    representatives: Vec<u32>,
}

impl Grid {
    /// `None` without extent.
    fn of(points: &[DVec3]) -> Option<Self> {
        /// Cells along a side, the one at its end included.
        const SIDE: usize = CELLS + 1;
        /// Parts of the points that are taken at once at most. More: threads wait less for each other; fewer: fewer tables of all cells.
        const PARTS: usize = 4;
        let bounds = Bounds::of(points)?;
        let per_length = CELLS as f64 / bounds.extent();
        if !per_length.is_finite() {
            return None;
        }
        let mut cells = vec![0; points.len()];
        let nearest = parallel::map_parts(&mut cells, points.len().div_ceil(PARTS), |first, cells| {
            let mut nearest = vec![Nearest::NONE; SIDE * SIDE * SIDE];
            for ((v, cell), point) in (first..).zip(cells).zip(&points[first..]) {
                let place = (point - bounds.min) * per_length;
                let [x, y, z] = place.to_array().map(|x| (x as usize).min(CELLS));
                let middle = DVec3::new(x as f64, y as f64, z as f64) + 0.5;
                *cell = ((x * SIDE + y) * SIDE + z) as u32;
                nearest[*cell as usize].take(Nearest { distance: place.distance_squared(middle), vertex: v as u32 });
            }
            nearest
        });
        let mut cluster_of_cell = vec![u32::MAX; SIDE * SIDE * SIDE];
        let mut representatives = Vec::new();
        for (cell, cluster) in cluster_of_cell.iter_mut().enumerate() {
            let mut best = Nearest::NONE;
            nearest.iter().for_each(|of_part| best.take(of_part[cell]));
            if best.distance < f64::INFINITY {
                *cluster = representatives.len() as u32;
                representatives.push(best.vertex);
            }
        }
        Some(Self { cells, cluster_of_cell, representatives })
    }
}

/// The point of a cell that is nearest to its middle, the first of those.
#[derive(Clone, Copy)]
struct Nearest {
    distance: f64,
    vertex: u32,
}

impl Nearest {
    const NONE: Self = Self { distance: f64::INFINITY, vertex: 0 };

    fn take(&mut self, other: Self) {
        if other.distance < self.distance {
            *self = other;
        }
    }
}
