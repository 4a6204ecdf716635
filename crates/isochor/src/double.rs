//! Sums and products in twice the precision of f64.
//!
//! Problem: the volume of a mesh is a long sum of terms that cancel almost completely where the mesh is thin, and its
//! error must stay below 1e-15 all the same. Error-free transformations carry the rounding error of every operation
//! along: T. J. Dekker, *A floating-point technique for extending the available precision* (1971); T. Ogita, S. M. Rump,
//! S. Oishi, *Accurate sum and dot product* (2005), algorithms 3.1 (`two_sum`), 3.3 (`two_product`) and 5.3 (`Dot2`).
//!
//! Long sums are taken in eight lanes, as in `Dot2`: the roundings of all operations are carried along, those of the roundings
//! themselves are not. With n terms t per lane the error is at most about n ε² Σ|t| before the last rounding; ε² = 1.2e-32.
//!
//! Products are exact by a fused multiply-add where the processor has one and by splitting where it has not, so bits do not depend
//! on the processor.

use std::ops::{Add, AddAssign};

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x8};

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

impl Double {
    /// The nearest f64.
    #[inline]
    pub(crate) fn value(self) -> f64 {
        self.hi + self.lo
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

/// Eight unevaluated sums `hi + lo`, where lo is of the size of the roundings of hi.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    hi: f64x8<S>,
    lo: f64x8<S>,
}

/// Whether `mul_add` rounds once.
#[inline(always)]
pub(crate) fn is_fused<S: Simd>(simd: S) -> bool {
    let (a, b) = (1.0 + f64::EPSILON, 1.0 - f64::EPSILON); // a b = 1 − ε²
    f64x8::splat(simd, a).mul_add(f64x8::splat(simd, b), f64x8::splat(simd, -1.0))[0] != 0.0
}

/// `a` as a sum of two numbers of 26 bits each.
#[inline(always)]
fn split<S: Simd>(a: f64x8<S>) -> (f64x8<S>, f64x8<S>) {
    const FACTOR: f64 = 134_217_729.0; // 2^27 + 1
    let t = a * FACTOR;
    let hi = t - (t - a);
    (hi, a - hi)
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn zero(simd: S) -> Self {
        let zero = f64x8::splat(simd, 0.0);
        Self { hi: zero, lo: zero }
    }

    /// `a · b` exactly, unless it overflows or underflows. `FUSED` is [`is_fused`].
    #[inline(always)]
    pub(crate) fn product<const FUSED: bool>(a: f64x8<S>, b: f64x8<S>) -> Self {
        let hi = a * b;
        if FUSED {
            return Self { hi, lo: a.mul_add(b, -hi) };
        }
        let ((ah, al), (bh, bl)) = (split(a), split(b));
        Self { hi, lo: al * bl - (((hi - ah * bh) - al * bh) - ah * bl) }
    }

    #[inline(always)]
    pub(crate) fn plus(self, other: Self) -> Self {
        let hi = self.hi + other.hi;
        let t = hi - self.hi;
        let error = (self.hi - (hi - t)) + (other.hi - t); // two_sum
        Self { hi, lo: (self.lo + other.lo) + error }
    }

    #[inline(always)]
    pub(crate) fn minus(self, other: Self) -> Self {
        self.plus(Self { hi: -other.hi, lo: -other.lo })
    }

    #[inline(always)]
    pub(crate) fn times<const FUSED: bool>(self, factor: f64x8<S>) -> Self {
        let p = Self::product::<FUSED>(self.hi, factor);
        Self { hi: p.hi, lo: p.lo + self.lo * factor }
    }

    /// The sum of all eight.
    #[inline(always)]
    pub(crate) fn total(self) -> Double {
        let mut total = Double::default();
        for lane in 0..8 {
            total += two_sum(self.hi[lane], self.lo[lane]);
        }
        total
    }
}

/// `Σ a_i b_i` with the error of one rounding, and `Σ |a_i b_i|`, which tells how much cancelled.
pub(crate) fn dot(terms: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    dispatch!(Level::new(), simd => match is_fused(simd) {
        true => lanes_dot::<_, true>(simd, terms),
        false => lanes_dot::<_, false>(simd, terms),
    })
}

#[inline(always)]
fn lanes_dot<S: Simd, const FUSED: bool>(simd: S, mut terms: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    const BATCH: usize = 64;
    let (mut a, mut b) = ([0.0; BATCH], [0.0; BATCH]);
    let (mut sum, mut magnitude) = (Lanes::zero(simd), f64x8::splat(simd, 0.0));
    loop {
        let mut count = 0;
        for (x, y) in terms.by_ref().take(BATCH) {
            (a[count], b[count]) = (x, y);
            count += 1;
        }
        if count == 0 {
            break;
        }
        a[count..].fill(0.0);
        for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)).take(count.div_ceil(8)) {
            let p = Lanes::product::<FUSED>(f64x8::from_slice(simd, a), f64x8::from_slice(simd, b));
            magnitude += p.hi.abs();
            sum = sum.plus(p);
        }
    }
    let mut total = 0.0;
    for lane in 0..8 {
        total += magnitude[lane];
    }
    (sum.total().value(), total)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_that_cancel_keep_what_is_left() {
        let tiny = 2f64.powi(-50);
        let sum = [1e16, 1.0, tiny, -1e16].into_iter().fold(Double::default(), |sum, x| sum + two_sum(x, 0.0));
        assert_eq!((sum + two_sum(-1.0, 0.0)).value(), tiny);
    }

    #[test]
    fn products_are_exact_with_and_without_fused_multiply_adds() {
        // (1 + 2^-30)(1 − 2^-30) = 1 − 2^-60
        let e = 2f64.powi(-30);
        assert_eq!(dot([(1.0 + e, 1.0 - e), (1.0, -1.0)].into_iter()).0, -2f64.powi(-60));
        let factors =
            |k: i32| [0, 1, 2, 3, 4, 5, 6, 7].map(|i| f64::from(7 * i + 3 - k).sqrt() * 10f64.powi(k * (i - 3)));
        let (a, b) = (factors(2), factors(-5));
        let expected = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| a[i].mul_add(b[i], -(a[i] * b[i])));
        dispatch!(Level::new(), simd => {
            let (a, b) = (f64x8::from_slice(simd, &a), f64x8::from_slice(simd, &b));
            assert_eq!(Lanes::product::<false>(a, b).lo.as_slice(), expected);
            if is_fused(simd) {
                assert_eq!(Lanes::product::<true>(a, b).lo.as_slice(), expected);
            }
        });
    }

    #[test]
    fn dots_of_any_length_take_every_term_once() {
        for n in [0, 1, 7, 8, 9, 63, 64, 65, 1000] {
            let (sum, magnitude) = dot((1..=n).map(|i| (f64::from(i), if i % 2 == 0 { 1.0 } else { -1.0 })));
            let whole = f64::from(n * (n + 1) / 2);
            assert_eq!((sum, magnitude), (if n % 2 == 0 { f64::from(n / 2) } else { -f64::from((n + 1) / 2) }, whole));
        }
    }
}
