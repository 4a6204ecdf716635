//! Points of the model that must come to exact places.
//!
//! A point that follows the controls with the weights w (a vertex: its row of W) and stands at S is to come to T. Along one
//! direction that is one linear condition on the displacement δ per point, `w · δ = (T − S)·d`: HB (20) for one point. The
//! smallest displacement that meets several, `δ = M Aᵀ (A M Aᵀ)⁻¹ b` with the rows A, is found from an orthonormal basis of the rows
//! √m ∘ w: what remains free for the volume is what is orthogonal to them.
//!
//! # Changes versus the paper
//!
//! - Any number of points instead of one; HB (21) with its λ and μ is the case of one point and the volume.
//! - Rows that depend on others are found: they are met already, or they contradict, and then the point is named.

use glam::DVec3;

use crate::binding::displaced;
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
    let roots: Vec<DVec3> = mobility.iter().map(|m| DVec3::from_array(m.to_array().map(f64::sqrt))).collect();
    let rows = CoordinateRows::new(points, &roots);
    let tolerance = tolerances::POINT * extent;
    let missed = |Missed { point, by }: Missed| {
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
        let more = rows.least(&left(&displacement), tolerance).map_err(missed)?;
        displacement = displaced(&displacement, &more);
    }
    if displacement.iter().any(|d| !d.is_finite()) {
        return Err(PointError::Overflow);
    }
    let misses = left(&displacement).into_iter().map(DVec3::length).enumerate();
    let (point, by) = misses.fold((0, 0.0), |worst, miss| if miss.1 > worst.1 { miss } else { worst });
    if by > tolerance {
        return Err(missed(Missed { point, by }));
    }
    Ok(displacement)
}

/// A point that cannot come to its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Missed {
    /// Its index in the list.
    pub(crate) point: usize,
    /// By how far it would miss.
    pub(crate) by: f64,
}

/// The rows √m ∘ w of all points for displacements along one direction, orthonormalised in order (Gram–Schmidt, twice).
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    /// √m along the direction (#controls).
    roots: Vec<f64>,
    /// Orthonormal rows (#independent points × #controls).
    basis: Vec<Vec<f64>>,
    /// For each point the components of its row on the basis so far; an independent row ends with its own.
    components: Vec<Vec<f64>>,
    /// Whether a point's row brought a new basis row.
    is_independent: Vec<bool>,
}

impl Rows {
    /// The rows of `points` for controls of mobility m, given `roots` = √m (#controls).
    pub(crate) fn new(points: &[PointTarget], roots: Vec<f64>) -> Self {
        let mut rows = Self { roots, basis: Vec::new(), components: Vec::new(), is_independent: Vec::new() };
        for point in points {
            let mut row = vec![0.0; rows.roots.len()];
            for &(control, weight) in &point.weights {
                row[control] += weight * rows.roots[control];
            }
            let whole = norm(&row);
            let mut components = vec![0.0; rows.basis.len()];
            for _ in 0..2 {
                for (component, q) in components.iter_mut().zip(&rows.basis) {
                    let part = dot(&row, q);
                    *component += part;
                    row.iter_mut().zip(q).for_each(|(x, q)| *x -= part * q);
                }
            }
            let rest = norm(&row);
            let is_independent = rest > tolerances::DEPENDENT_ROW * whole;
            if is_independent {
                row.iter_mut().for_each(|x| *x /= rest);
                components.push(rest);
                rows.basis.push(row);
            }
            rows.components.push(components);
            rows.is_independent.push(is_independent);
        }
        rows
    }

    /// The smallest y = δ/√m (#controls) that moves the points by `moves` (#points), or the point that misses most, if by more
    /// than `tolerance`.
    pub(crate) fn least(&self, moves: &[f64], tolerance: f64) -> Result<Vec<f64>, Missed> {
        let mut coefficients: Vec<f64> = Vec::with_capacity(self.basis.len());
        let mut worst = Missed { point: 0, by: 0.0 };
        for (point, (components, wanted)) in self.components.iter().zip(moves).enumerate() {
            let met: f64 = components.iter().zip(&coefficients).map(|(a, b)| a * b).sum();
            if self.is_independent[point] {
                coefficients.push((wanted - met) / components[components.len() - 1]);
            } else if (wanted - met).abs() > worst.by {
                worst = Missed { point, by: (wanted - met).abs() };
            }
        }
        if worst.by > tolerance {
            return Err(worst);
        }
        let mut y = vec![0.0; self.roots.len()];
        for (coefficient, q) in coefficients.iter().zip(&self.basis) {
            y.iter_mut().zip(q).for_each(|(y, q)| *y += coefficient * q);
        }
        Ok(y)
    }

    /// Takes away from `v` (#controls) what would move a point.
    pub(crate) fn project(&self, v: &mut [f64]) {
        for _ in 0..2 {
            for q in &self.basis {
                let part = dot(v, q);
                v.iter_mut().zip(q).for_each(|(v, q)| *v -= part * q);
            }
        }
    }

    /// √m (#controls).
    pub(crate) fn roots(&self) -> &[f64] {
        &self.roots
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The rows for all three coordinates.
#[derive(Clone, Debug)]
pub(crate) struct CoordinateRows([Rows; 3]);

impl CoordinateRows {
    /// Of `points` for controls of mobility `roots`² per coordinate (#controls × 3).
    pub(crate) fn new(points: &[PointTarget], roots: &[DVec3]) -> Self {
        Self([0, 1, 2].map(|a| Rows::new(points, roots.iter().map(|s| s[a]).collect())))
    }

    /// The smallest displacement δ (#controls × 3) that moves the points by `moves` (#points).
    pub(crate) fn least(&self, moves: &[DVec3], tolerance: f64) -> Result<Vec<DVec3>, Missed> {
        let mut displacement = vec![DVec3::ZERO; self.0[0].roots.len()];
        for (a, rows) in self.0.iter().enumerate() {
            let y = rows.least(&moves.iter().map(|m| m[a]).collect::<Vec<_>>(), tolerance)?;
            for ((d, y), root) in displacement.iter_mut().zip(y).zip(rows.roots()) {
                d[a] = y * root;
            }
        }
        Ok(displacement)
    }

    /// Takes away from y = δ/√m (#controls × 3) what would move a point.
    pub(crate) fn project(&self, y: &mut [DVec3]) {
        for (a, rows) in self.0.iter().enumerate() {
            let mut along: Vec<f64> = y.iter().map(|y| y[a]).collect();
            rows.project(&mut along);
            y.iter_mut().zip(along).for_each(|(y, x)| y[a] = x);
        }
    }
}
