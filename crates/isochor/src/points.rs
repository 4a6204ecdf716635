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

use crate::binding::displaced;
use crate::metric::{AxisMetric, Factors, Metric};
use crate::rows::{Missed, Rows};
use crate::tolerances;

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

/// Why points cannot be brought to their places.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PointError {
    /// A mobility that is negative, infinite or not a number.
    #[error("the mobility of control {control} is {value}: it must be finite and at least 0")]
    Mobility {
        /// The control.
        control: usize,
        /// Its mobility.
        value: DVec3,
    },
    /// A point that follows a control that does not exist, or has numbers that are not finite.
    #[error("point {point}: {what}")]
    Value {
        /// Index of the point.
        point: usize,
        /// What is wrong with it.
        what: String,
    },
    /// A point that follows no movable control.
    #[error("point {point} follows no movable control and misses its target by {by:e}")]
    Unmoved {
        /// Index of the point.
        point: usize,
        /// How far it is from its target.
        by: f64,
    },
    /// Points that contradict one another.
    #[error("point {point} misses its target by {by:e} whatever the movable controls do, given the other points")]
    Contradiction {
        /// Index of the point that misses most.
        point: usize,
        /// By how far it misses along one coordinate.
        by: f64,
    },
    /// Finite numbers whose result is not.
    #[error("the displacement it takes leaves the range of numbers")]
    Overflow,
}

/// The smallest displacement δ of controls (#controls × 3), the minimiser of `Σ δ²/m`, that brings `points` to their targets: to
/// [`tolerances::POINT`] of `extent`. `mobility` is m of each control coordinate (#controls × 3), ≥ 0; where it is 0, δ is
/// exactly 0. Points that repeat one another are met together.
///
/// # Errors
///
/// Values out of range; points that contradict one another or follow no movable control, unless they are at their targets.
pub fn least_displacement(points: &[PointTarget], mobility: &[DVec3], extent: f64) -> Result<Vec<DVec3>, PointError> {
    if let Some(control) = mobility.iter().position(|m| !(m.is_finite() && m.min_element() >= 0.0)) {
        return Err(PointError::Mobility { control, value: mobility[control] });
    }
    for (point, PointTarget { weights, position, target }) in points.iter().enumerate() {
        let controls = mobility.len();
        if let Some((control, _)) = weights.iter().find(|(control, _)| *control >= controls) {
            return Err(PointError::Value { point, what: format!("it follows control {control} of {controls}") });
        }
        if !(position.is_finite() && target.is_finite() && weights.iter().all(|(_, w)| w.is_finite())) {
            return Err(PointError::Value { point, what: "its numbers must be finite".into() });
        }
    }
    let metric = Factors::default().metric(mobility).expect("a metric without an energy");
    let rows = PointRows::new(points, &metric);
    let tolerance = tolerances::POINT * extent;
    let missed = |Missed { row: point, by }: Missed| {
        let is_moved = |a: usize| points[point].weights.iter().any(|(c, w)| *w != 0.0 && mobility[*c][a] > 0.0);
        match (0..3).any(is_moved) {
            true => PointError::Contradiction { point, by },
            false => PointError::Unmoved { point, by: points[point].target.distance(points[point].position) },
        }
    };
    let left = |displacement: &[DVec3]| -> Vec<DVec3> {
        let moved = |point: &PointTarget| -> DVec3 { point.weights.iter().map(|(c, w)| *w * displacement[*c]).sum() };
        points.iter().map(|point| point.target - point.position - moved(point)).collect()
    };
    // Once for the points, once for what rounding left.
    let mut displacement = vec![DVec3::ZERO; mobility.len()];
    for _ in 0..2 {
        let z = rows.least(metric.unknowns(), &left(&displacement), tolerance).map_err(missed)?;
        displacement = displaced(&displacement, &metric.displacement(&z));
    }
    if displacement.iter().any(|d| !d.is_finite()) {
        return Err(PointError::Overflow);
    }
    let misses = left(&displacement).into_iter().map(DVec3::length).enumerate();
    let (point, by) = misses.fold((0, 0.0), |worst, miss| if miss.1 > worst.1 { miss } else { worst });
    if by > tolerance {
        return Err(missed(Missed { row: point, by }));
    }
    Ok(displacement)
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
