//! Points of the model that must come to exact places.
//!
//! A point that follows the controls with the weights w (a vertex: its row of W) and stands at S is to come to T. Along one
//! direction that is one linear condition on the displacement δ per point, `w · δ = (T − S)·d`: HB (20) for one point. The
//! smallest displacement that meets several is found from an orthonormal basis of the rows `Rᵀ w` ([`crate::rows`]): what remains free
//! for the volume is what is orthogonal to them.
//!
//! # Changes versus the paper
//!
//! - Any number of points instead of one; HB (21) with its λ and μ is the case of one point and the volume.
//! - Rows that depend on others are found: they are met already, or they contradict, and then the point is named.

use glam::DVec3;

use crate::metric::{AxisMetric, Metric};
use crate::rows::{Missed, Rows};

/// A point that must come to a place.
#[derive(Clone, Debug, PartialEq)]
pub struct PointTarget {
    /// The controls that the point follows, with their weights: [`crate::Binding::weights`] of a vertex, or of a point that was
    /// bound for this.
    pub weights: Vec<(usize, f64)>,
    /// Where it is posed.
    pub position: DVec3,
    /// Where it must come.
    pub target: DVec3,
}

/// The rows `Rᵀ w` of `points` for displacements along one direction.
pub(crate) fn point_rows(points: &[PointTarget], controls: usize, metric: &AxisMetric) -> Rows {
    let mut rows = Rows::default();
    for point in points {
        let mut row = vec![0.0; controls];
        for &(control, weight) in &point.weights {
            row[control] += weight;
        }
        rows.push(metric.pulled(&row), 0.0);
    }
    rows
}

/// The rows for all three coordinates.
#[derive(Clone, Debug)]
pub(crate) struct PointRows([Rows; 3]);

impl PointRows {
    /// Of `points` in `metric`.
    pub(crate) fn new(points: &[PointTarget], metric: &Metric) -> Self {
        Self([0, 1, 2].map(|a| point_rows(points, metric.unknowns() / 3, metric.along(a))))
    }

    /// The smallest z (#unknowns) that moves the points by `moves` (#points), or the point that misses most, if by more than
    /// `tolerance`.
    pub(crate) fn least(&self, unknowns: usize, moves: &[DVec3], tolerance: f64) -> Result<Vec<f64>, Missed> {
        let mut z = Vec::with_capacity(unknowns);
        for (a, rows) in self.0.iter().enumerate() {
            let (part, missed) = rows.least(unknowns / 3, &moves.iter().map(|m| m[a]).collect::<Vec<_>>());
            match missed {
                Some(missed) if missed.by > tolerance => return Err(missed),
                _ => z.extend(part),
            }
        }
        Ok(z)
    }

    /// Takes away from z (#unknowns) what would move a point.
    pub(crate) fn project(&self, z: &mut [f64]) {
        let controls = z.len() / 3;
        for (rows, along) in self.0.iter().zip(z.chunks_mut(controls)) {
            rows.project(along);
        }
    }

    /// ν (#points) with `Aᵀ ν` nearest to z (#unknowns), A the rows.
    pub(crate) fn multipliers(&self, z: &[f64]) -> Vec<DVec3> {
        let controls = z.len() / 3;
        let [x, y, z] = [0, 1, 2].map(|a| self.0[a].multipliers(&z[a * controls..(a + 1) * controls]));
        (0..x.len()).map(|k| DVec3::new(x[k], y[k], z[k])).collect()
    }
}
