//! Gauss and Legendre's rules for integrals over [0, 1].
//!
//! The points are the zeros of the Legendre polynomial of degree n, by Newton's method from Tricomi's estimate; their weights are
//! `1 / ((1 − x²) P′(x)²)` (M. Abramowitz, I. Stegun, *Handbook of Mathematical Functions*, 1964, 25.4.29, for an interval of length 1).

/// The rule of `n` points in (0, 1), each with its weight; exact for polynomials of degree 2n − 1.
pub(crate) fn gauss_legendre(n: usize) -> Vec<[f64; 2]> {
    // P and P′ at x by the recurrence k P_k = (2 k − 1) x P_(k−1) − (k − 1) P_(k−2).
    let legendre = |x: f64| {
        let (mut before, mut p) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
        }
        (p, n as f64 * (x * p - before) / (x * x - 1.0))
    };
    let point = |i: usize| {
        let mut x = -libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5));
        // Quadratic from three digits on: five steps are two more than rounding needs.
        for _ in 0..5 {
            let (p, slope) = legendre(x);
            x -= p / slope;
        }
        let slope = legendre(x).1;
        [(1.0 + x) / 2.0, 1.0 / ((1.0 - x * x) * slope * slope)]
    };
    (0..n).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `∫ x^k = 1/(k + 1)` up to degree 2n − 1. For k = 2n the sum is less by the square of the monic Legendre polynomial's norm,
    /// `(n!)⁴ / ((2n + 1) ((2n)!)²)`: 1/180 for n = 2.
    #[test]
    fn polynomials_of_twice_the_degree_are_integrated() {
        for n in [1, 2, 3, 5, 16, 40, 128] {
            let rule = gauss_legendre(n);
            for k in 0..2 * n as i32 {
                let sum: f64 = rule.iter().map(|[x, weight]| weight * x.powi(k)).sum();
                assert!((sum * f64::from(k + 1) - 1.0).abs() < 1e-13, "{n}, {k}: {sum}");
            }
        }
        let sum: f64 = gauss_legendre(2).iter().map(|[x, weight]| weight * x.powi(4)).sum();
        assert!((0.2 - sum - 1.0 / 180.0).abs() < 1e-15, "{sum}");
    }

    #[test]
    fn rules_of_one_two_and_three_points() {
        let [a, b] = [1.0 / 3.0_f64.sqrt(), 0.6_f64.sqrt()];
        let known: [&[[f64; 2]]; 3] =
            [&[[0.0, 1.0]], &[[-a, 0.5], [a, 0.5]], &[[-b, 5.0 / 18.0], [0.0, 8.0 / 18.0], [b, 5.0 / 18.0]]];
        for rule in known {
            for (found, [x, weight]) in gauss_legendre(rule.len()).iter().zip(rule) {
                let expected = [(1.0 + x) / 2.0, *weight];
                assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-15), "{found:?}, not {expected:?}");
            }
        }
    }
}
