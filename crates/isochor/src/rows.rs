//! Linear conditions `A z = b`, from an orthonormal basis of their rows.
//!
//! With rows `A = L Q`, Q orthonormal and L lower triangular (Gram–Schmidt in the given order, twice), the smallest z that meets them is
//! `Qᵀ L⁻¹ b`, and what is orthogonal to Q is what they leave free. A row that depends on those before it brings no basis row: it is
//! met already, or it contradicts them.

use crate::tolerances;

/// Rows, orthonormalised in order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    /// Orthonormal rows (#independent rows × #unknowns).
    basis: Vec<Vec<f64>>,
    /// For each row its components on the basis so far; an independent row ends with its own.
    components: Vec<Vec<f64>>,
    /// Whether a row brought a new basis row.
    is_independent: Vec<bool>,
}

/// A condition that cannot be met beside the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Missed {
    /// Index of its row.
    pub(crate) row: usize,
    /// By how far it would miss.
    pub(crate) by: f64,
}

impl Rows {
    /// Adds a row (#unknowns) and returns the length of what is new in it. It counts as dependent where that is at most `least`, or
    /// below [`tolerances::DEPENDENT_ROW`] of the whole.
    pub(crate) fn push(&mut self, mut row: Vec<f64>, least: f64) -> f64 {
        let whole = norm(&row);
        let mut components = vec![0.0; self.basis.len()];
        for _ in 0..2 {
            for (component, q) in components.iter_mut().zip(&self.basis) {
                let part = dot(&row, q);
                *component += part;
                add(&mut row, -part, q);
            }
        }
        let rest = norm(&row);
        let is_independent = rest > (tolerances::DEPENDENT_ROW * whole).max(least);
        if is_independent {
            row.iter_mut().for_each(|x| *x /= rest);
            components.push(rest);
            self.basis.push(row);
        }
        self.components.push(components);
        self.is_independent.push(is_independent);
        rest
    }

    /// Whether [`Rows::push`] would find `row` independent.
    pub(crate) fn is_new(&self, row: &[f64], least: f64) -> bool {
        let mut rest = row.to_vec();
        self.project(&mut rest);
        norm(&rest) > (tolerances::DEPENDENT_ROW * norm(row)).max(least)
    }

    /// Orthonormal rows that span those given (#independent rows × #unknowns).
    pub(crate) fn basis(&self) -> &[Vec<f64>] {
        &self.basis
    }

    /// Whether row `k` is independent of those before it.
    pub(crate) fn is_independent(&self, k: usize) -> bool {
        self.is_independent[k]
    }

    /// The smallest z that meets the independent rows, and the dependent row that it misses most, if any (#rows numbers `wanted`).
    pub(crate) fn least(&self, unknowns: usize, wanted: &[f64]) -> (Vec<f64>, Option<Missed>) {
        let mut coefficients: Vec<f64> = Vec::with_capacity(self.basis.len());
        let mut worst: Option<Missed> = None;
        for (row, (components, wanted)) in self.components.iter().zip(wanted).enumerate() {
            let met: f64 = components.iter().zip(&coefficients).map(|(a, b)| a * b).sum();
            let by = (wanted - met).abs();
            if self.is_independent[row] {
                coefficients.push((wanted - met) / components[components.len() - 1]);
            } else if worst.is_none_or(|worst| by > worst.by) {
                worst = Some(Missed { row, by });
            }
        }
        let mut z = vec![0.0; unknowns];
        for (coefficient, q) in coefficients.iter().zip(&self.basis) {
            add(&mut z, *coefficient, q);
        }
        (z, worst)
    }

    /// Takes away from `v` (#unknowns) what would change a condition.
    pub(crate) fn project(&self, v: &mut [f64]) {
        for _ in 0..2 {
            for q in &self.basis {
                let part = dot(v, q);
                add(v, -part, q);
            }
        }
    }

    /// μ with `Aᵀ μ` nearest to `z` (#rows; 0 for dependent rows).
    pub(crate) fn multipliers(&self, z: &[f64]) -> Vec<f64> {
        let mut on_basis: Vec<f64> = self.basis.iter().map(|q| dot(z, q)).collect();
        let mut multipliers = vec![0.0; self.components.len()];
        let mut last = self.basis.len();
        for (row, components) in self.components.iter().enumerate().rev().filter(|(row, _)| self.is_independent[*row]) {
            last -= 1;
            let multiplier = on_basis[last] / components[last];
            multipliers[row] = multiplier;
            add(&mut on_basis[..=last], -multiplier, components);
        }
        multipliers
    }
}

/// a · b
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// a += factor · b
pub(crate) fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * *b);
}

/// |a|, also where its square leaves the range of numbers.
pub(crate) fn norm(a: &[f64]) -> f64 {
    let square = dot(a, a);
    if square.is_normal() {
        return square.sqrt();
    }
    let largest = a.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    largest * a.iter().map(|x| (x / largest) * (x / largest)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(rows: &[[f64; 3]]) -> Rows {
        let mut all = Rows::default();
        rows.iter().for_each(|row| {
            all.push(row.to_vec(), 0.0);
        });
        all
    }

    #[test]
    fn the_smallest_solution_of_independent_rows() {
        // z = Aᵀ (A Aᵀ)⁻¹ b by hand: A Aᵀ = [[2, 1], [1, 1]].
        let a = rows(&[[1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        let (z, missed) = a.least(3, &[3.0, 1.0]);
        assert!((z[0] - 2.0).abs() < 1e-15 && (z[1] - 1.0).abs() < 1e-15 && z[2] == 0.0);
        assert_eq!(missed, None);
        let multipliers = a.multipliers(&[5.0, 7.0, 11.0]);
        assert!((multipliers[0] - 5.0).abs() < 1e-14 && (multipliers[1] - 2.0).abs() < 1e-14);
    }

    #[test]
    fn dependent_rows_are_met_or_miss() {
        let a = rows(&[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!([0, 1, 2].map(|k| a.is_independent(k)), [true, false, true]);
        let (z, missed) = a.least(3, &[1.0, 5.0, 7.0]);
        assert_eq!((z, missed), (vec![1.0, 0.0, 7.0], Some(Missed { row: 1, by: 3.0 })));
        assert_eq!(a.multipliers(&[4.0, 9.0, 2.0]), [4.0, 0.0, 2.0]);
        let mut v = [1.0, 2.0, 3.0];
        a.project(&mut v);
        assert_eq!(v, [0.0, 2.0, 0.0]);
    }
}
