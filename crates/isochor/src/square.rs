//! Small square matrices: Gaussian elimination with partial pivoting.
//!
//! For the few equations that several wanted volumes make. In plain arithmetic of fixed order, so that bits depend on no processor.

/// A square matrix.
#[derive(Clone, Debug)]
pub(crate) struct Square {
    rows: Vec<Vec<f64>>,
}

impl Square {
    /// n × n numbers `f(row, column)`.
    pub(crate) fn of(n: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        Self { rows: (0..n).map(|i| (0..n).map(|j| f(i, j)).collect()).collect() }
    }

    pub(crate) fn transposed(&self) -> Self {
        Self::of(self.rows.len(), |i, j| self.rows[j][i])
    }

    /// 1, −1, or 0 for a singular matrix: the sign of the determinant.
    pub(crate) fn orientation(&self) -> f64 {
        let mut nothing = vec![0.0; self.rows.len()];
        let (rows, sign) = self.eliminated(&mut nothing);
        (0..rows.len()).fold(sign, |sign, i| if rows[i][i] == 0.0 { 0.0 } else { sign * rows[i][i].signum() })
    }

    /// x with `A x = b`; not finite for a singular matrix.
    pub(crate) fn solved(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        let (rows, _) = self.eliminated(&mut x);
        for i in (0..x.len()).rev() {
            let known: f64 = rows[i][i + 1..].iter().zip(&x[i + 1..]).map(|(a, x)| a * x).sum();
            x[i] = (x[i] - known) / rows[i][i];
        }
        x
    }

    /// An upper triangular matrix, `b` changed with it, and the sign of the row exchanges.
    fn eliminated(&self, b: &mut [f64]) -> (Vec<Vec<f64>>, f64) {
        let mut rows = self.rows.clone();
        let mut sign = 1.0;
        for k in 0..rows.len() {
            let pivot = (k..rows.len()).max_by(|i, j| rows[*i][k].abs().total_cmp(&rows[*j][k].abs())).unwrap_or(k);
            if pivot != k {
                rows.swap(k, pivot);
                b.swap(k, pivot);
                sign = -sign;
            }
            let (done, rest) = rows.split_at_mut(k + 1);
            let top = &done[k];
            for (i, row) in (k + 1..).zip(rest) {
                if row[k] != 0.0 {
                    let factor = row[k] / top[k];
                    row.iter_mut().zip(top).skip(k).for_each(|(x, above)| *x -= factor * above);
                    b[i] -= factor * b[k];
                }
            }
        }
        (rows, sign)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square<const N: usize>(rows: [[f64; N]; N]) -> Square {
        Square::of(N, |i, j| rows[i][j])
    }

    #[test]
    fn equations_with_whole_solutions() {
        let matrix = square([[0.0, 2.0, 1.0], [1.0, -2.0, -3.0], [-1.0, 1.0, 2.0]]);
        assert_eq!(matrix.solved(&[-8.0, 0.0, 3.0]), [-4.0, -5.0, 2.0]);
        // The transposed: Aᵀ (1, 2, 3)ᵀ = (−1, 1, 1)ᵀ.
        for (found, expected) in matrix.transposed().solved(&[-1.0, 1.0, 1.0]).into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-14);
        }
        assert!(Square::of(0, |_, _| 0.0).solved(&[]).is_empty());
    }

    #[test]
    fn orientations_are_signs_of_determinants() {
        assert_eq!(square([[0.0, 1.0], [1.0, 0.0]]).orientation(), -1.0);
        assert_eq!(square([[0.0, 2.0, 1.0], [1.0, -2.0, -3.0], [-1.0, 1.0, 2.0]]).orientation(), 1.0);
        assert_eq!(square([[1.0, 2.0], [2.0, 4.0]]).orientation(), 0.0);
        assert!(square([[1.0, 2.0], [2.0, 4.0]]).solved(&[1.0, 1.0]).iter().any(|x| !x.is_finite()));
    }
}
