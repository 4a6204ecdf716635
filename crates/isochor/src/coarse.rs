//! A coarse stand-in for a posed body, over a few of its vertices.
//!
//! Vertices are put together by the cells of a cubic grid; each cluster is represented by the member nearest to its mean, which lies on
//! the surface. Any identification of vertices keeps a closed mesh balanced, so the stand-in is a body too. It is good for second
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
const CELLS: usize = 32;

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
        let (cluster_of, representatives) = clusters(posed)?;
        // In the order of lattice cells, as products with the binding like it.
        let binding = binding.rows_of(&representatives);
        let order = binding.cell_order();
        let places = order::places(&order);
        let cluster_of = parallel::collect(cluster_of.len(), |v| places[cluster_of[v] as usize]);
        Some(Self {
            solid: solid.clustered(&cluster_of, representatives.len()),
            binding: binding.rows_of(&order),
            posed: Arc::new(Array::of(order.iter().map(|c| posed[representatives[*c as usize] as usize]).collect())),
        })
    }
}

/// The cluster of each point (#points), numbered by first member, and the representative of each cluster. `None` without extent.
fn clusters(points: &[DVec3]) -> Option<(Vec<u32>, Vec<u32>)> {
    /// Cells along a side, the one at its end included.
    const SIDE: usize = CELLS + 1;
    let bounds = Bounds::of(points)?;
    let per_length = CELLS as f64 / bounds.extent();
    if !per_length.is_finite() {
        return None;
    }
    let cells = parallel::collect(points.len(), |v| {
        let [x, y, z] = ((points[v] - bounds.min) * per_length).to_array().map(|x| (x as usize).min(CELLS));
        ((x * SIDE + y) * SIDE + z) as u32
    });
    let mut sums = vec![(DVec3::ZERO, 0.0); SIDE * SIDE * SIDE];
    for (point, &cell) in points.iter().zip(&cells) {
        let (sum, count) = &mut sums[cell as usize];
        *sum += *point;
        *count += 1.0;
    }
    let mut cluster_of_cell = vec![u32::MAX; sums.len()];
    let mut nearest: Vec<(f64, u32)> = Vec::new();
    let mut cluster_of = cells;
    for ((v, point), cluster) in (0..).zip(points).zip(&mut cluster_of) {
        let (sum, count) = sums[*cluster as usize];
        let distance = point.distance_squared(sum / count);
        let known = &mut cluster_of_cell[*cluster as usize];
        if *known == u32::MAX {
            *known = nearest.len() as u32;
            nearest.push((f64::INFINITY, v));
        }
        *cluster = *known;
        let best = &mut nearest[*known as usize];
        if distance < best.0 {
            *best = (distance, v);
        }
    }
    Some((cluster_of, nearest.into_iter().map(|(_, v)| v).collect()))
}
