//! Splines through given values at equidistant parameters.
//!
//! Cubic ones are twice continuously differentiable, with de Boor's *not-a-knot* ends: there is no knot at the second
//! value and at the last but one, so that cubic polynomials come back (C. de Boor, *A Practical Guide to Splines*,
//! 1978, chapters IV and XIII). The control points C solve `Σ_j B_j(u_i) C_j = P_i`. That matrix is banded and totally
//! positive: elimination without pivoting is stable (de Boor, Pinkus 1977).

use glam::DVec3;

use crate::bspline::{Basis, BasisError};

/// How a surface goes through its points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Smoothness {
    /// Twice continuously differentiable: cubic along s and t; of degree n − 1 along one that has n < 4 points.
    #[default]
    Bicubic,
    /// Straight between neighbours: continuous, with creases.
    Bilinear,
}

/// The splines through n values at i / (n − 1), prepared.
pub(crate) struct Interpolation {
    basis: Basis,
    /// L and U of the collocation matrix: entry (i, j) at `i (2 p + 1) + j + p − i`; L has 1 on its diagonal.
    factors: Vec<f64>,
}

impl Interpolation {
    pub(crate) fn new(count: usize, smoothness: Smoothness) -> Result<Self, BasisError> {
        let most = match smoothness {
            Smoothness::Bicubic => 3,
            Smoothness::Bilinear => 1,
        };
        let p = most.min(count.saturating_sub(1)).max(1);
        // Too few points, or too many, are errors of the basis.
        let mut basis = Basis::clamped(count, p)?;
        let site = |i: usize| i as f64 / (count - 1) as f64;
        if p == 3 {
            let ends = |at: f64| std::iter::repeat_n(at, p + 1);
            let interior = (2..count - 2).map(site);
            basis = Basis::with_knots(ends(0.0).chain(interior).chain(ends(1.0)).collect(), p)?;
        }
        let width = 2 * p + 1;
        let mut factors = vec![0.0; count * width];
        let mut row = vec![0.0; p + 1];
        for i in 0..count {
            let start = basis.row(site(i), &mut row);
            // A function more than p columns from the diagonal vanishes at its row's parameter.
            for (j, value) in (start..).zip(&row).filter(|(_, value)| **value != 0.0) {
                factors[i * width + j + p - i] = *value;
            }
        }
        for k in 0..count {
            for i in k + 1..count.min(k + p + 1) {
                let factor = factors[i * width + k + p - i] / factors[k * width + p];
                factors[i * width + k + p - i] = factor;
                for j in k + 1..count.min(k + p + 1) {
                    factors[i * width + j + p - i] -= factor * factors[k * width + j + p - k];
                }
            }
        }
        Ok(Self { basis, factors })
    }

    /// Turns values, those at multiples of `stride`, into control points.
    pub(crate) fn solve(&self, values: &mut [DVec3], stride: usize) {
        let (count, p) = (self.basis.size(), self.basis.degree());
        let entry = |i: usize, j: usize| self.factors[i * (2 * p + 1) + j + p - i];
        for i in 0..count {
            for j in i.saturating_sub(p)..i {
                let known = entry(i, j) * values[j * stride];
                values[i * stride] -= known;
            }
        }
        for i in (0..count).rev() {
            for j in i + 1..count.min(i + p + 1) {
                let known = entry(i, j) * values[j * stride];
                values[i * stride] -= known;
            }
            values[i * stride] /= entry(i, i);
        }
    }

    pub(crate) fn into_basis(self) -> Basis {
        self.basis
    }
}
