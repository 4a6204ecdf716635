//! A coarse stand-in for a posed body, over a few of its vertices.
//!
//! Vertices are put together by the cells of a cubic grid; each cluster is represented by the member nearest to its mean, which lies on
//! the surface. Any identification of vertices keeps a closed mesh balanced, so the stand-in is a body too. It is good for second
//! derivatives; volumes and gradients are corrected against the fine mesh by whoever uses it ([`crate::nearest`]).

use std::sync::Arc;

use glam::DVec3;
use rustc_hash::FxHashMap;

use crate::binding::Binding;
use crate::mesh::Bounds;
use crate::volume::Solid;

/// Vertices below which a body is its own stand-in. More: medium models take longer than they need; fewer: the stand-in is hardly
/// coarser.
const LEAST_VERTICES: usize = 30_000;

/// Cells along the longest side of the body. More: fewer fine evaluations; fewer: cheaper coarse ones.
const CELLS: f64 = 32.0;

/// A body of few vertices, their binding and their posed positions.
pub(crate) struct Coarse {
    pub(crate) solid: Solid,
    pub(crate) binding: Binding,
    pub(crate) posed: Arc<Vec<DVec3>>,
}

impl Coarse {
    /// A stand-in for `solid` at the pose `posed` (#vertices × 3); `None` where it is small already.
    pub(crate) fn of(solid: &Solid, binding: &Binding, posed: &[DVec3]) -> Option<Self> {
        if posed.len() < LEAST_VERTICES {
            return None;
        }
        let (cluster_of, representatives) = clusters(posed)?;
        Some(Self {
            solid: solid.clustered(&cluster_of, representatives.len()),
            binding: binding.selected(&representatives),
            posed: Arc::new(representatives.iter().map(|v| posed[*v as usize]).collect()),
        })
    }
}

/// The cluster of each point (#points), numbered by first member, and the representative of each cluster. `None` without extent.
fn clusters(points: &[DVec3]) -> Option<(Vec<u32>, Vec<u32>)> {
    let bounds = Bounds::of(points)?;
    let per_length = CELLS / bounds.extent();
    if !per_length.is_finite() {
        return None;
    }
    let mut by_cell = FxHashMap::default();
    let cell = |p: &DVec3| ((*p - bounds.min) * per_length).to_array().map(|x| x as u32);
    let cluster_of: Vec<u32> = points
        .iter()
        .map(|p| {
            let next = by_cell.len() as u32;
            *by_cell.entry(cell(p)).or_insert(next)
        })
        .collect();
    let mut means = vec![(DVec3::ZERO, 0.0); by_cell.len()];
    for (point, &cluster) in points.iter().zip(&cluster_of) {
        let (sum, count) = &mut means[cluster as usize];
        *sum += *point;
        *count += 1.0;
    }
    let mut nearest = vec![(f64::INFINITY, u32::MAX); means.len()];
    for ((v, point), &cluster) in (0..).zip(points).zip(&cluster_of) {
        let (sum, count) = means[cluster as usize];
        let distance = point.distance_squared(sum / count);
        if distance < nearest[cluster as usize].0 {
            nearest[cluster as usize] = (distance, v);
        }
    }
    Some((cluster_of, nearest.into_iter().map(|(_, v)| v).collect()))
}
