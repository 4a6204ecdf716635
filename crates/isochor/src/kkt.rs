//! Steps of Newton's method under linear conditions.
//!
//! Wanted is the least of `½ dᵀ H d + rᵀ d` with `Q d = 0`, Q orthonormal rows. It exists where H is positive definite on what Q leaves free:
//! where the matrix of both, `[H Qᵀ; Q 0]`, has as many negative eigenvalues as Q has rows (J. Nocedal, S. J. Wright, *Numerical
//! Optimization*, 2nd edition, 2006, theorem 16.3). H is factorised as L B Lᵀ, whose blocks B tell its own negative eigenvalues; those of
//! the rest are those of `−Q H⁻¹ Qᵀ`. Where the count is another one, τ is added to the diagonal, more and more (Nocedal, Wright, algorithm
//! 3.3; A. Wächter, L. T. Biegler, *On the implementation of an interior-point filter line-search algorithm*, 2006,
//! section 3.1).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SupernodalIntranodeLbltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, IntranodeLbltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::{Conj, Mat, MatMut, Par, Side};

use crate::block_matrix::BlockPattern;
use crate::rows::{add, dot, norm};

/// First τ, relative to the mean of the diagonal's magnitudes. More: steps are shorter than they need be; less: more factorisations until one
/// is large enough.
const FIRST_SHIFT: f64 = 1e-6;

/// By what τ grows from try to try. More: shorter steps; less: more tries.
const GROWTH: f64 = 8.0;

/// Largest τ, relative to the mean of the diagonal's magnitudes: there the step is that of steepest descent. Beyond, numbers are not finite.
const LAST_SHIFT: f64 = 1e12;

/// Numbers in a factor at most. More: gigabytes, and minutes.
const MOST_VALUES: usize = 1 << 28;

/// Factorises matrices of one pattern.
pub(crate) struct Kkt {
    symbolic: SymbolicCholesky<usize>,
    /// τ of the last step, relative.
    shift: f64,
}

/// A step.
pub(crate) struct KktStep {
    /// d (#unknowns).
    pub(crate) direction: Vec<f64>,
    /// A direction of negative curvature, where τ had to be added and one was found.
    pub(crate) curved: Option<Curved>,
    /// Whether H has no negative curvature on what Q leaves free, as far as is known.
    pub(crate) is_convex: bool,
}

/// A direction v with Q v = 0 along which H is negative.
pub(crate) struct Curved {
    /// v (#unknowns), of length 1, downhill.
    pub(crate) direction: Vec<f64>,
    /// vᵀ H v.
    pub(crate) curvature: f64,
}

impl Kkt {
    /// For matrices of this pattern; `None` where their factors are too large.
    pub(crate) fn new(pattern: &BlockPattern) -> Option<Self> {
        // `FORCE_SUPERNODAL` is 0, and a diagonal matrix takes no more than 0 operations for each entry.
        const ALWAYS: SupernodalThreshold = SupernodalThreshold(-1.0);
        let params =
            CholeskySymbolicParams { supernodal_flop_ratio_threshold: ALWAYS, ..CholeskySymbolicParams::default() };
        let symbolic =
            factorize_symbolic_cholesky(pattern.symbolic().as_ref(), Side::Upper, SymmetricOrdering::Amd, params)
                .ok()?;
        (symbolic.len_val() <= MOST_VALUES).then_some(Self { symbolic, shift: 0.0 })
    }

    /// The step for H with these values of its pattern, the rows Q (each #unknowns) and r (#unknowns), where H is positive definite on what Q
    /// leaves free; `None` where it is not.
    pub(crate) fn convex_step(
        &self,
        pattern: &BlockPattern,
        values: &[f64],
        q: &[Vec<f64>],
        r: &[f64],
    ) -> Option<Vec<f64>> {
        self.least(pattern, values, q, r).map(|(_, direction)| direction)
    }

    /// The step for H with these values of its pattern, the rows Q (each #unknowns) and r (#unknowns). `None` where numbers are not finite.
    pub(crate) fn step(
        &mut self,
        pattern: &BlockPattern,
        values: &[f64],
        q: &[Vec<f64>],
        r: &[f64],
    ) -> Option<KktStep> {
        let (diagonal, mean) = (pattern.diagonal(), mean(pattern, values));
        let mut relative = 0.0;
        let mut shifted = values.to_vec();
        while relative <= LAST_SHIFT {
            let shift = relative * mean;
            diagonal.iter().for_each(|at| shifted[*at as usize] = values[*at as usize] + shift);
            if let Some((factor, direction)) = self.least(pattern, &shifted, q, r) {
                let curved = (relative > 0.0).then(|| factor.curved(pattern, values, q, r, mean)).flatten();
                let is_convex = curved.is_none();
                self.shift = relative;
                return Some(KktStep { direction, curved, is_convex });
            }
            relative = if relative == 0.0 { FIRST_SHIFT.max(self.shift / GROWTH) } else { GROWTH * relative };
        }
        None
    }

    /// The least for H as it is, with its factor; `None` where there is none.
    fn least(
        &self,
        pattern: &BlockPattern,
        values: &[f64],
        q: &[Vec<f64>],
        r: &[f64],
    ) -> Option<(Factor<'_>, Vec<f64>)> {
        let mut factor = Factor::new(&self.symbolic, pattern, values);
        let negative = factor.negative_count() + factor.constrain(q)?;
        let direction = factor.tangent(q, r);
        let is_solved = direction.iter().all(|x| x.is_finite()) && dot(&direction, r) <= 0.0;
        (negative == q.len() && is_solved).then_some((factor, direction))
    }
}

/// The mean of the diagonal's magnitudes.
fn mean(pattern: &BlockPattern, values: &[f64]) -> f64 {
    let diagonal = pattern.diagonal();
    diagonal.iter().map(|at| values[*at as usize].abs()).sum::<f64>() / diagonal.len() as f64
}

/// H = L B Lᵀ.
struct Factor<'a> {
    symbolic: &'a SymbolicCholesky<usize>,
    values: Vec<f64>,
    below: Vec<f64>,
    order: Vec<usize>,
    place: Vec<usize>,
    /// H⁻¹ Qᵀ, column by column, and the eigenvectors and eigenvalues of Q H⁻¹ Qᵀ.
    solved: Vec<Vec<f64>>,
    vectors: Mat<f64>,
    eigenvalues: Vec<f64>,
}

impl<'a> Factor<'a> {
    fn new(symbolic: &'a SymbolicCholesky<usize>, pattern: &BlockPattern, values: &[f64]) -> Self {
        let unknowns = pattern.unknowns();
        let mut factor = Self {
            symbolic,
            values: vec![0.0; symbolic.len_val()],
            below: vec![0.0; unknowns],
            order: vec![0; unknowns],
            place: vec![0; unknowns],
            solved: Vec::new(),
            vectors: Mat::new(),
            eigenvalues: Vec::new(),
        };
        let mut memory =
            MemBuffer::new(symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(Par::Seq, Default::default()));
        symbolic.factorize_numeric_intranode_lblt(
            &mut factor.values,
            &mut factor.below,
            &mut factor.order,
            &mut factor.place,
            pattern.matrix(values),
            Side::Upper,
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        factor
    }

    fn permutation(&self) -> PermRef<'_, usize> {
        PermRef::new_checked(&self.order, &self.place, self.order.len())
    }

    /// Takes up the rows Q. Returns how many eigenvalues of −Q H⁻¹ Qᵀ are negative; `None` where numbers are not finite.
    fn constrain(&mut self, q: &[Vec<f64>]) -> Option<usize> {
        if q.is_empty() {
            return Some(0);
        }
        let mut columns = Mat::from_fn(self.order.len(), q.len(), |i, k| q[k][i]);
        self.solve(columns.as_mut());
        self.solved = (0..q.len()).map(|k| columns.col(k).iter().copied().collect()).collect();
        let solved = &self.solved;
        let schur = Mat::from_fn(q.len(), q.len(), |i, j| (dot(&q[i], &solved[j]) + dot(&q[j], &solved[i])) / 2.0);
        let eigen = schur.self_adjoint_eigen(Side::Lower).ok()?;
        self.vectors = eigen.U().to_owned();
        self.eigenvalues = eigen.S().column_vector().iter().copied().collect();
        Some(self.eigenvalues.iter().filter(|value| **value > 0.0).count())
    }

    /// The stationary point of `½ dᵀ H d + rᵀ d` with `Q d = 0`.
    fn tangent(&self, q: &[Vec<f64>], r: &[f64]) -> Vec<f64> {
        let mut column = Mat::from_fn(r.len(), 1, |i, _| -r[i]);
        self.solve(column.as_mut());
        let mut direction: Vec<f64> = column.col(0).iter().copied().collect();
        if q.is_empty() {
            return direction;
        }
        // ν = S⁻¹ Q H⁻¹ r
        let right = Mat::from_fn(q.len(), 1, |i, _| -dot(&q[i], &direction));
        let mut turned = self.vectors.transpose() * right;
        self.eigenvalues.iter().enumerate().for_each(|(i, value)| turned[(i, 0)] /= *value);
        let multipliers = &self.vectors * turned;
        self.solved.iter().enumerate().for_each(|(k, column)| add(&mut direction, multipliers[(k, 0)], column));
        direction
    }

    /// A direction of negative curvature of the matrix that has `values` where this is a factor of it with τ added: by inverse iteration, which
    /// finds the eigenvector whose eigenvalue is next to −τ. `mean` is that of the diagonal's magnitudes.
    fn curved(&self, pattern: &BlockPattern, values: &[f64], q: &[Vec<f64>], r: &[f64], mean: f64) -> Option<Curved> {
        /// More: nearer to the most negative curvature, for longer; fewer: weakly negative curvature is missed.
        const ITERATIONS: usize = 20;
        /// Curvature that is less than this, relative to `mean`, is none: motions that cost nothing. Larger: nodes rest on weak ridges; smaller:
        /// rounding passes for curvature.
        const NONE: f64 = 1e-9;
        // No symmetry of a lattice leaves this as it is.
        let mut direction: Vec<f64> =
            (0..r.len()).map(|i| ((i + 1) as f64 * 0.618_033_988_749_895).fract() - 0.5).collect();
        for _ in 0..ITERATIONS {
            direction = self.tangent(q, &direction);
            let length = norm(&direction);
            direction.iter_mut().for_each(|x| *x /= length);
        }
        let mut product = vec![0.0; r.len()];
        for entry in pattern.matrix(values).triplet_iter() {
            product[entry.row] += *entry.val * direction[entry.col];
            if entry.row != entry.col {
                product[entry.col] += *entry.val * direction[entry.row];
            }
        }
        let curvature = dot(&direction, &product);
        if dot(&direction, r) > 0.0 {
            direction.iter_mut().for_each(|x| *x = -*x);
        }
        (curvature < -NONE * mean).then_some(Curved { direction, curvature })
    }

    fn solve(&self, columns: MatMut<f64>) {
        let count = columns.ncols();
        let factor = IntranodeLbltRef::new(self.symbolic, &self.values, &self.below, self.permutation());
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(count, Par::Seq));
        factor.solve_in_place_with_conj(Conj::No, columns, Par::Seq, MemStack::new(&mut memory));
    }

    /// Negative eigenvalues of H: of the blocks B, by Sylvester's law of inertia.
    fn negative_count(&self) -> usize {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.symbolic.raw() else {
            unreachable!("supernodes were asked for")
        };
        let factor = SupernodalIntranodeLbltRef::new(symbolic, &self.values, &self.below, self.permutation());
        let of_node = |s: usize| {
            let block = factor.supernode(s).val();
            (0..block.ncols()).map(|i| block[(i, i)]).collect::<Vec<_>>()
        };
        let diagonal: Vec<f64> = (0..symbolic.n_supernodes()).flat_map(of_node).collect();
        let (mut negative, mut i) = (0, 0);
        while i < diagonal.len() {
            let below = self.below[i];
            if below == 0.0 {
                negative += usize::from(diagonal[i] < 0.0);
                i += 1;
            } else {
                let [a, d] = [diagonal[i], diagonal[i + 1]];
                let is_mixed = a * d - below * below < 0.0;
                negative += if is_mixed { 1 } else { 2 * usize::from(a < 0.0) };
                i += 2;
            }
        }
        negative
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block_matrix::Neighbours;
    use glam::{BVec3, DMat3, DVec3};
    use proptest::prelude::*;

    const SIZE: [usize; 3] = [3, 2, 2];

    fn pattern(reach: [usize; 3]) -> BlockPattern {
        let mut is_free = vec![BVec3::TRUE; 12];
        is_free[3] = BVec3::FALSE;
        is_free[7] = BVec3::new(true, false, true);
        BlockPattern::new(Neighbours { size: SIZE, reach }, &is_free).unwrap()
    }

    /// A symmetric matrix of the pattern, and its values.
    fn filled(pattern: &BlockPattern, numbers: &[f64], diagonal: f64) -> (Mat<f64>, Vec<f64>) {
        let mut values = vec![0.0; pattern.values()];
        let mut next = numbers.iter().cycle();
        pattern.for_each_block(|a, b, _| {
            let mut block = DMat3::from_cols_array(&std::array::from_fn(|_| *next.next().unwrap()));
            if a == b {
                block = (block + block.transpose()) / 2.0 + DMat3::from_diagonal(DVec3::splat(diagonal));
            }
            pattern.add(&mut values, a, b, block);
        });
        let mut full = Mat::zeros(pattern.unknowns(), pattern.unknowns());
        let matrix = pattern.matrix(&values);
        for triplet in matrix.triplet_iter() {
            full[(triplet.row, triplet.col)] = *triplet.val;
            full[(triplet.col, triplet.row)] = *triplet.val;
        }
        (full, values)
    }

    proptest! {
        /// Against the eigenvalues of the whole matrix [H Qᵀ; Q 0] and its solution, dense.
        #[test]
        fn steps_are_those_of_the_whole_matrix(
            numbers in prop::collection::vec(-1.0..1.0f64, 101),
            diagonal in -1.0..6.0f64,
            conditions in 0usize..4,
            is_near in any::<bool>(),
        ) {
            let pattern = pattern(if is_near { [1, 1, 0] } else { [2, 1, 1] });
            let unknowns = pattern.unknowns();
            prop_assert_eq!(unknowns, 32);
            let (full, values) = filled(&pattern, &numbers, diagonal);
            let mut rows = crate::rows::Rows::default();
            for k in 0..conditions {
                rows.push((0..unknowns).map(|i| numbers[(7 * i + 13 * k) % 101]).collect(), 0.0);
            }
            let q = rows.basis();
            let r: Vec<f64> = (0..unknowns).map(|i| numbers[(5 * i + 3) % 101]).collect();
            let size = unknowns + q.len();
            let whole = |shift: f64| Mat::from_fn(size, size, |i, j| match (i < unknowns, j < unknowns) {
                (true, true) => full[(i, j)] + if i == j { shift } else { 0.0 },
                (false, true) => q[i - unknowns][j],
                (true, false) => q[j - unknowns][i],
                (false, false) => 0.0,
            });
            let negative = |shift: f64| {
                let values = whole(shift).self_adjoint_eigenvalues(Side::Lower).unwrap();
                values.iter().filter(|value| **value < 0.0).count()
            };
            let mut kkt = Kkt::new(&pattern).unwrap();
            let step = kkt.step(&pattern, &values, q, &r).unwrap();
            let shift = kkt.shift * mean(&pattern, &values);
            prop_assert_eq!(negative(shift), q.len());
            prop_assert_eq!(shift == 0.0, negative(0.0) == q.len());
            prop_assert_eq!(kkt.convex_step(&pattern, &values, q, &r).is_some(), shift == 0.0);
            prop_assert_eq!(step.is_convex, step.curved.is_none());
            // The solution of the whole matrix with the right side −r.
            let d = &step.direction;
            for row in q {
                prop_assert!(dot(row, d).abs() < 1e-9);
            }
            let mut residual: Vec<f64> = (0..unknowns).map(|i| r[i] + shift * d[i] + (0..unknowns).map(|j| full[(i, j)] * d[j]).sum::<f64>()).collect();
            rows.project(&mut residual);
            let scale = 1.0 + d.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            prop_assert!(residual.iter().all(|x| x.abs() < 1e-8 * scale), "{residual:?}");
            prop_assert!(shift > 0.0 || step.is_convex);
            if let Some(Curved { direction: v, curvature }) = &step.curved {
                let product: f64 = (0..unknowns).map(|i| v[i] * (0..unknowns).map(|j| full[(i, j)] * v[j]).sum::<f64>()).sum();
                prop_assert!((product - curvature).abs() < 1e-9 && *curvature < 0.0);
                prop_assert!(q.iter().all(|row| dot(row, v).abs() < 1e-9) && dot(v, &r) <= 0.0);
            }
        }
    }
}
