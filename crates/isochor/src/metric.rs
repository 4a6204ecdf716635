//! What a displacement costs, as a change of variables.
//!
//! Corrections minimise a quadratic form of the control displacement δ: `Σ δ²/m` with mobilities m, or `yᵀ S y` with `y = δ/√m` and an
//! [`Energy`] S. With `S = L Lᵀ` (Cholesky) and `δ = R z`, `R = √M L⁻ᵀ` (`√M` alone without an energy), it is |z|²: what all methods work
//! with is z, R and Rᵀ. A pinned coordinate has no z: R leaves it exactly 0.
//!
//! z of all three coordinates stands in one list: that of x (#controls), then y, then z.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::supernodal::SupernodalLltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side};
use glam::DVec3;

use crate::energy::Energy;

/// Numbers in a Cholesky factor at most. More: gigabytes, and minutes; fewer: 30³ control points must do.
const MOST_VALUES: usize = 1 << 27;

/// The metric of displacements along x, y and z.
#[derive(Clone, Debug)]
pub(crate) struct Metric {
    along: [AxisMetric; 3],
}

/// The metric of displacements along one direction.
#[derive(Clone, Debug)]
pub(crate) struct AxisMetric {
    /// √m (#controls).
    roots: Vec<f64>,
    factor: Option<Arc<Factor>>,
}

/// The Cholesky factor of an energy, restricted to the controls that may move.
struct Factor {
    /// Those controls, in the order of the factor's rows.
    order: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    energy: Arc<Energy>,
}

impl std::fmt::Debug for Factor {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "Factor of {} controls", self.order.len())
    }
}

/// Factors that have been made, by the controls that may move.
#[derive(Clone, Debug, Default)]
pub(crate) struct Factors {
    energy: Option<Arc<Energy>>,
    /// Whether bits are to be the same on every processor.
    is_portable: bool,
    made: Vec<(Vec<bool>, Arc<Factor>)>,
}

impl Factors {
    pub(crate) fn of(energy: Option<Energy>, is_portable: bool) -> Self {
        Self { energy: energy.map(Arc::new), is_portable, made: Vec::new() }
    }

    /// The metric for mobilities m (#controls) along a direction; `None` where the energy's matrix is too large to be factorised.
    pub(crate) fn along(&mut self, mobility: &[f64]) -> Option<AxisMetric> {
        let roots: Vec<f64> = mobility.iter().map(|m| m.sqrt()).collect();
        let Some(energy) = &self.energy else { return Some(AxisMetric { roots, factor: None }) };
        let is_free: Vec<bool> = mobility.iter().map(|m| *m > 0.0).collect();
        let made = self.made.iter().find(|(of, _)| *of == is_free).map(|(_, factor)| Arc::clone(factor));
        let factor = match made {
            Some(factor) => factor,
            None => {
                let factor = Arc::new(Factor::new(energy, &is_free, self.is_portable)?);
                self.made.push((is_free, Arc::clone(&factor)));
                factor
            }
        };
        Some(AxisMetric { roots, factor: Some(factor) })
    }

    /// The metric for mobilities per coordinate (#controls × 3).
    pub(crate) fn metric(&mut self, mobility: &[DVec3]) -> Option<Metric> {
        let mut along = |a: usize| self.along(&mobility.iter().map(|m| m[a]).collect::<Vec<_>>());
        Some(Metric { along: [along(0)?, along(1)?, along(2)?] })
    }
}

impl Factor {
    fn new(energy: &Arc<Energy>, is_free: &[bool], is_portable: bool) -> Option<Self> {
        let free: Vec<usize> = (0..is_free.len()).filter(|c| is_free[*c]).collect();
        let mut row = vec![usize::MAX; is_free.len()];
        free.iter().enumerate().for_each(|(r, c)| row[*c] = r);
        let entries: Vec<Triplet<usize, usize, f64>> = energy
            .upper_triangle()
            .iter()
            .filter(|(i, j, _)| is_free[*i] && is_free[*j])
            .map(|(i, j, s)| Triplet::new(row[*i], row[*j], *s))
            .collect();
        let matrix = SparseColMat::try_new_from_triplets(free.len(), free.len(), &entries).ok()?;
        // `FORCE_SUPERNODAL` is 0, and a diagonal matrix takes no more than 0 operations for each entry.
        const ALWAYS: SupernodalThreshold = SupernodalThreshold(-1.0);
        // Dense blocks are faster, but what they are multiplied with depends on the processor.
        let threshold = if is_portable { SupernodalThreshold::FORCE_SIMPLICIAL } else { ALWAYS };
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: threshold,
            supernodal_params: SymbolicSupernodalParams::default(),
            ..CholeskySymbolicParams::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(matrix.symbolic(), Side::Upper, SymmetricOrdering::Amd, params).ok()?;
        if symbolic.len_val() > MOST_VALUES {
            return None;
        }
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Upper,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .ok()?;
        let order = match symbolic.perm() {
            Some(permutation) => permutation.arrays().0.iter().map(|r| free[*r]).collect(),
            None => free,
        };
        Some(Self { order, symbolic, values, energy: Arc::clone(energy) })
    }

    /// Solves with L or Lᵀ in place of `x` (#controls), which must be 0 where a control is pinned.
    fn solve(&self, x: &mut [f64], is_transposed: bool) {
        if self.order.is_empty() {
            return;
        }
        let mut in_order: Vec<f64> = self.order.iter().map(|c| x[*c]).collect();
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factor = SupernodalLltRef::new(symbolic, &self.values);
                let rhs = MatMut::from_column_major_slice_mut(&mut in_order, self.order.len(), 1);
                let mut memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
                let stack = MemStack::new(&mut memory);
                if is_transposed {
                    factor.l_transpose_solve_with_conj(Conj::No, rhs, Par::Seq, stack);
                } else {
                    factor.l_solve_with_conj(Conj::No, rhs, Par::Seq, stack);
                }
            }
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                // The diagonal comes first in each column of L.
                let column = |k: usize| {
                    let entries = symbolic.col_ptr()[k]..symbolic.col_ptr()[k + 1];
                    (&symbolic.row_idx()[entries.clone()], &self.values[entries])
                };
                let columns = self.order.len();
                if is_transposed {
                    for k in (0..columns).rev() {
                        let (rows, values) = column(k);
                        let known: f64 = rows[1..].iter().zip(&values[1..]).map(|(i, l)| l * in_order[*i]).sum();
                        in_order[k] = (in_order[k] - known) / values[0];
                    }
                } else {
                    for k in 0..columns {
                        let (rows, values) = column(k);
                        in_order[k] /= values[0];
                        let solved = in_order[k];
                        rows[1..].iter().zip(&values[1..]).for_each(|(i, l)| in_order[*i] -= l * solved);
                    }
                }
            }
        }
        self.order.iter().zip(in_order).for_each(|(c, value)| x[*c] = value);
    }
}

impl AxisMetric {
    /// The largest mobility.
    pub(crate) fn largest_mobility(&self) -> f64 {
        self.roots.iter().map(|root| root * root).fold(0.0, f64::max)
    }

    /// δ = R z (#controls).
    pub(crate) fn displacement(&self, z: &[f64]) -> Vec<f64> {
        let mut y = z.to_vec();
        if let Some(factor) = &self.factor {
            factor.solve(&mut y, true);
        }
        y.iter_mut().zip(&self.roots).for_each(|(y, root)| *y *= root);
        y
    }

    /// Rᵀ g (#controls).
    pub(crate) fn pulled(&self, g: &[f64]) -> Vec<f64> {
        let mut z: Vec<f64> = g.iter().zip(&self.roots).map(|(g, root)| g * root).collect();
        if let Some(factor) = &self.factor {
            factor.solve(&mut z, false);
        }
        z
    }

    /// z of a displacement that is 0 where controls are pinned (#controls): `Lᵀ y = L⁻¹ S y`.
    pub(crate) fn coordinates(&self, delta: &[f64]) -> Vec<f64> {
        let divided = |(d, root): (&f64, &f64)| if *root == 0.0 { 0.0 } else { d / root };
        let y: Vec<f64> = delta.iter().zip(&self.roots).map(divided).collect();
        let Some(factor) = &self.factor else { return y };
        let mut z = vec![0.0; y.len()];
        for &(i, j, s) in factor.energy.upper_triangle() {
            z[i] += s * y[j];
            if i != j {
                z[j] += s * y[i];
            }
        }
        z.iter_mut().zip(&self.roots).filter(|(_, root)| **root == 0.0).for_each(|(z, _)| *z = 0.0);
        factor.solve(&mut z, false);
        z
    }
}

impl Metric {
    /// The metric along x, y or z.
    pub(crate) fn along(&self, axis: usize) -> &AxisMetric {
        &self.along[axis]
    }

    /// Number of unknowns: three for each control.
    pub(crate) fn unknowns(&self) -> usize {
        3 * self.along[0].roots.len()
    }

    /// The largest coordinate of the displacement of z (#unknowns); of √m z, m the largest mobility, where there is an energy: there R
    /// magnifies rounding by up to 1/√[`crate::tolerances::ENERGY_FLOOR`] more.
    pub(crate) fn residual(&self, z: &[f64]) -> f64 {
        match self.along[0].factor {
            Some(_) => self.largest_mobility().sqrt() * z.iter().map(|z| z.abs()).fold(0.0, f64::max),
            None => self.displacement(z).iter().map(|d| d.abs().max_element()).fold(0.0, f64::max),
        }
    }

    /// The largest mobility.
    pub(crate) fn largest_mobility(&self) -> f64 {
        self.along.iter().map(AxisMetric::largest_mobility).fold(0.0, f64::max)
    }

    /// δ = R z (#controls × 3).
    pub(crate) fn displacement(&self, z: &[f64]) -> Vec<DVec3> {
        let controls = self.along[0].roots.len();
        let [x, y, z] = [0, 1, 2].map(|a| self.along[a].displacement(&z[a * controls..(a + 1) * controls]));
        (0..controls).map(|c| DVec3::new(x[c], y[c], z[c])).collect()
    }

    /// Rᵀ g (#unknowns) of something per control (#controls × 3).
    pub(crate) fn pulled(&self, g: &[DVec3]) -> Vec<f64> {
        self.by_axis(g, AxisMetric::pulled)
    }

    /// z (#unknowns) of a displacement δ (#controls × 3).
    pub(crate) fn coordinates(&self, delta: &[DVec3]) -> Vec<f64> {
        self.by_axis(delta, AxisMetric::coordinates)
    }

    fn by_axis(&self, vectors: &[DVec3], f: impl Fn(&AxisMetric, &[f64]) -> Vec<f64>) -> Vec<f64> {
        let along = |a: usize| f(&self.along[a], &vectors.iter().map(|v| v[a]).collect::<Vec<_>>());
        [along(0), along(1), along(2)].concat()
    }
}
