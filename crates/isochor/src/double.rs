//! Sums and products in twice the precision of f64.
//!
//! Problem: the volume of a mesh is a long sum of terms that cancel almost completely where the mesh is thin, and its
//! error must stay below 1e-15 all the same. Error-free transformations carry the rounding error of every operation
//! along: T. J. Dekker, *A floating-point technique for extending the available precision* (1971); T. Ogita, S. M. Rump,
//! S. Oishi, *Accurate sum and dot product* (2005), algorithms 3.1 (`two_sum`) and 3.3 (`two_product`).

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// The unevaluated sum `hi + lo`, |lo| ≤ ulp(hi)/2: about 106 significant bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Double {
    hi: f64,
    lo: f64,
}

/// `a + b` exactly.
#[inline]
fn two_sum(a: f64, b: f64) -> Double {
    let hi = a + b;
    let t = hi - a;
    Double { hi, lo: (a - (hi - t)) + (b - t) }
}

/// `a + b` exactly, where |a| ≥ |b| or a = 0.
#[inline]
fn fast_two_sum(a: f64, b: f64) -> Double {
    let hi = a + b;
    Double { hi, lo: b - (hi - a) }
}

/// `a` as a sum of two numbers of 26 bits each.
#[inline]
fn split(a: f64) -> (f64, f64) {
    const FACTOR: f64 = 134_217_729.0; // 2^27 + 1
    let t = FACTOR * a;
    let hi = t - (t - a);
    (hi, a - hi)
}

/// `a · b` exactly, unless it overflows or underflows. Both ways give the same bits; the first is one instruction where
/// the target has it and a slow library call where it has not.
#[inline]
fn two_product(a: f64, b: f64) -> Double {
    let hi = a * b;
    if cfg!(target_feature = "fma") {
        return Double { hi, lo: a.mul_add(b, -hi) };
    }
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    Double { hi, lo: al * bl - (((hi - ah * bh) - al * bh) - ah * bl) }
}

impl Double {
    /// `a · b` exactly.
    #[inline]
    pub(crate) fn product(a: f64, b: f64) -> Self {
        two_product(a, b)
    }

    /// The nearest f64.
    #[inline]
    pub(crate) fn value(self) -> f64 {
        self.hi + self.lo
    }
}

impl From<f64> for Double {
    #[inline]
    fn from(hi: f64) -> Self {
        Self { hi, lo: 0.0 }
    }
}

impl Add for Double {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        let (s, t) = (two_sum(self.hi, other.hi), two_sum(self.lo, other.lo));
        let s = fast_two_sum(s.hi, s.lo + t.hi);
        fast_two_sum(s.hi, s.lo + t.lo)
    }
}

impl AddAssign for Double {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for Double {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }
}

impl Sub for Double {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul<f64> for Double {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f64) -> Self {
        let p = two_product(self.hi, factor);
        fast_two_sum(p.hi, p.lo + self.lo * factor)
    }
}

/// `Σ a_i b_i` with the error of one rounding, and `Σ |a_i b_i|`, which tells how much cancelled.
pub(crate) fn dot(terms: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let (mut sum, mut magnitude) = (Double::default(), 0.0);
    for (a, b) in terms {
        let p = two_product(a, b);
        sum += p;
        magnitude += p.hi.abs();
    }
    (sum.value(), magnitude)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_that_cancel_keep_what_is_left() {
        let tiny = 2f64.powi(-50);
        let sum = Double::from(1e16) + Double::from(1.0) + Double::from(tiny) + Double::from(-1e16);
        assert_eq!((sum - Double::from(1.0)).value(), tiny);
    }

    #[test]
    fn products_are_exact() {
        // (1 + 2^-30)(1 − 2^-30) = 1 − 2^-60
        let e = 2f64.powi(-30);
        assert_eq!((Double::product(1.0 + e, 1.0 - e) - Double::from(1.0)).value(), -2f64.powi(-60));
        assert_eq!(dot([(1.0 + e, 1.0 - e), (1.0, -1.0)].into_iter()).0, -2f64.powi(-60));
    }
}
