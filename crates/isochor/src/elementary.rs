//! Arctangents and logarithms of four numbers at a time.
//!
//! The arctangent is the rational approximation of S. L. Moshier's library Cephes (`atan.c`): of t between −0.21 and 0.66, to which
//! quotients are brought by the formula of the difference from π/4. The logarithm of a quotient is
//!
//! ```text
//! ln(n/d) = k ln 2 + 2 artanh s,   s = (n − 2^k d)/(n + 2^k d),   |s| ≤ 1/5,
//! ```
//!
//! with k from the exponents and as many terms of the Taylor series of artanh as rounding leaves. It takes one division, as the quotient
//! alone would, and keeps all digits where n and d are nearly the same.
//!
//! Relative errors are at most 4e-16. Nothing branches, and there are no fused multiply-adds, so bits are the same in every lane and on
//! every processor.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use fearless_simd::prelude::*;
use fearless_simd::{f64x4, u64x4};

/// `atan(t) = t + t z P(z)/Q(z)`, `z = t²`: P, highest power first. Cephes, `atan.c`.
const ATAN_P: [f64; 5] = [
    -8.750_608_600_031_904_e-1,
    -1.615_753_718_733_365e1,
    -7.500_855_792_314_705e1,
    -1.228_866_684_490_136_1e2,
    -6.485_021_904_942_025e1,
];

/// Q, highest power first, after its leading 1.
const ATAN_Q: [f64; 5] = [
    2.485_846_490_142_306_4e1,
    1.650_270_098_316_988_6e2,
    4.328_810_604_912_903e2,
    4.853_903_996_359_137e2,
    1.945_506_571_482_614e2,
];

/// What π has beyond the digits of [`PI`].
const PI_REST: f64 = 1.224_646_799_147_353_2e-16;

/// `(artanh(s) − s)/s³ = 1/3 + s²/5 + s⁴/7 + …`, highest power first. For |s| ≤ 1/5 the next term is 7e-19 of artanh s.
const ARTANH: [f64; 11] = [
    1.0 / 23.0,
    1.0 / 21.0,
    1.0 / 19.0,
    1.0 / 17.0,
    1.0 / 15.0,
    1.0 / 13.0,
    1.0 / 11.0,
    1.0 / 9.0,
    1.0 / 7.0,
    1.0 / 5.0,
    1.0 / 3.0,
];

/// ln 2 to 33 bits, whose multiples by exponents are exact, and the rest.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// A polynomial, highest power first.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(x: f64x4<S>, first: f64x4<S>, rest: &[f64; N]) -> f64x4<S> {
    let mut sum = first;
    for c in rest {
        sum = sum * x + *c;
    }
    sum
}

/// The angle of (x, y) in −π ..= π, finite numbers whose sum does not overflow. It has the sign of y; that of a zero x does not count, and
/// the angle of the origin is 0.
#[inline(always)]
pub(crate) fn atan2<S: Simd>(simd: S, y: f64x4<S>, x: f64x4<S>) -> f64x4<S> {
    // Closures would not be compiled for the processor at hand.
    let (zero, one) = (f64x4::splat(simd, 0.0), f64x4::splat(simd, 1.0));
    let (high, wide) = (y.abs(), x.abs());
    let is_steep = high.simd_gt(wide);
    let (low, long) = (is_steep.select(wide, high), is_steep.select(high, wide));
    // The angle between 0 and π/4, as t or as π/4 + t.
    let is_oblique = low.simd_gt(long * 0.66);
    let divisor = is_oblique.select(low + long, long);
    let t = is_oblique.select(low - long, low) / long.simd_eq(zero).select(one, divisor);
    let z = t * t;
    let tail = t * (z * polynomial(z, zero, &ATAN_P) / polynomial(z, one, &ATAN_Q));
    // ± t with its tail, from a multiple of π/4.
    let quarter = is_oblique.select(f64x4::splat(simd, FRAC_PI_4), zero);
    let (t, tail) = (is_steep.select(-t, t), is_steep.select(-tail, tail));
    let base = is_steep.select(f64x4::splat(simd, FRAC_PI_2) - quarter, quarter);
    let is_left = x.simd_lt(zero);
    let (t, tail) = (is_left.select(-t, t), is_left.select(-tail, tail));
    let base = is_left.select(f64x4::splat(simd, PI) - base, base);
    (base + (t + (tail + base * (PI_REST / PI)))).copysign(y)
}

/// `ln(n/d)` of positive numbers whose quotient is between 2^−1000 and 2^1000; of others it means nothing.
#[inline(always)]
pub(crate) fn ln_of_quotient<S: Simd>(simd: S, n: f64x4<S>, d: f64x4<S>) -> f64x4<S> {
    const FRACTION: u32 = 52;
    const BIAS: u64 = 1023;
    // Bits count logarithms to base 2, up to 0.09: k is their rounded difference, so n/(2^k d) is between 2/3 and 3/2.
    let (of_n, of_d): (u64x4<S>, u64x4<S>) = (n.bitcast(), d.bitcast());
    let biased = of_n - of_d + ((BIAS << FRACTION) + (1 << (FRACTION - 1)));
    let power: f64x4<S> = (biased & (0x7ff << FRACTION)).bitcast();
    // 2^52 + a whole number, written by its bits.
    let whole: f64x4<S> = ((biased >> FRACTION) | 2f64.powi(52).to_bits()).bitcast();
    let k = whole - (2f64.powi(52) + BIAS as f64);
    let d = d * power;
    let s = (n - d) / (n + d);
    let z = s * s;
    let series = polynomial(z, f64x4::splat(simd, 0.0), &ARTANH);
    let s = s + s;
    k * LN_2[0] + (s + (s * z * series + k * LN_2[1]))
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    use super::*;

    /// A function of two arguments on this processor and on the lowest level, which must agree to the bit, in every lane.
    fn in_lanes(of: impl Fn(Level, [f64; 4], [f64; 4]) -> [f64; 4], a: f64, b: f64) -> f64 {
        let value = of(Level::new(), [a; 4], [b; 4])[0];
        for level in [Level::new(), Level::baseline()] {
            for lane in 0..4 {
                let (mut others, mut more) = ([0.3, -2.0, 5.0, 1e-9], [1.0, 7.0, -0.2, 3.0]);
                (others[lane], more[lane]) = (a, b);
                assert_eq!(
                    of(level, others, more)[lane].to_bits(),
                    value.to_bits(),
                    "{level:?}, lane {lane}: {a}, {b}"
                );
            }
        }
        value
    }

    fn angle(y: f64, x: f64) -> f64 {
        let of = |level, y: [f64; 4], x: [f64; 4]| {
            dispatch!(level, simd => {
                let (y, x) = (f64x4::from_slice(simd, &y), f64x4::from_slice(simd, &x));
                *atan2(simd, y, x).as_slice().first_chunk().unwrap()
            })
        };
        in_lanes(of, y, x)
    }

    fn logarithm(n: f64, d: f64) -> f64 {
        let of = |level, n: [f64; 4], d: [f64; 4]| {
            dispatch!(level, simd => {
                let (n, d) = (f64x4::from_slice(simd, &n), f64x4::from_slice(simd, &d));
                *ln_of_quotient(simd, n, d).as_slice().first_chunk().unwrap()
            })
        };
        in_lanes(of, n, d)
    }

    /// Numbers of all magnitudes.
    fn magnitude() -> impl Strategy<Value = f64> {
        (1.0..2.0, -150..150).prop_map(|(m, k)| m * 2f64.powi(k))
    }

    /// Relative error of libm's logarithms: one unit in the last place.
    const LIBM: f64 = f64::EPSILON;

    /// `ln(n/d)` where n and d are within a factor of 2: their difference is exact, and what its quotient is rounded by is added.
    fn near_zero(n: f64, d: f64) -> f64 {
        let quotient = (n - d) / d;
        let rest = (-quotient).mul_add(d, n - d) / d;
        libm::log1p(quotient) + rest / (1.0 + quotient)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn angles_are_those_of_libm(y in -1.0..1.0, x in -1.0..1.0) {
            let expected = libm::atan2(y, x);
            prop_assert!((angle(y, x) - expected).abs() <= 4e-16 * expected.abs(), "{y}, {x}: {} {expected}", angle(y, x));
        }

        #[test]
        fn angles_of_all_magnitudes_are_those_of_libm(y in magnitude(), x in magnitude(), signs in 0..4) {
            let (y, x) = (if signs & 1 > 0 { -y } else { y }, if signs & 2 > 0 { -x } else { x });
            let expected = libm::atan2(y, x);
            prop_assert!((angle(y, x) - expected).abs() <= 4e-16 * expected.abs(), "{y}, {x}: {} {expected}", angle(y, x));
        }

        #[test]
        fn logarithms_of_quotients_of_all_magnitudes_are_those_of_libm(n in magnitude(), d in magnitude()) {
            let expected = if n / d > 0.5 && n / d < 2.0 { near_zero(n, d) } else { libm::log(n / d) };
            prop_assert!((logarithm(n, d) - expected).abs() <= (4e-16 + LIBM) * expected.abs(), "{n}, {d}: {} {expected}", logarithm(n, d));
        }

        #[test]
        fn logarithms_of_quotients_near_one_keep_their_digits(d in 1.0..2.0, k in -52..-2, m in -2.0..2.0) {
            let n = d + m * 2f64.powi(k);
            let expected = near_zero(n, d);
            prop_assert!((logarithm(n, d) - expected).abs() <= (4e-16 + LIBM) * expected.abs(), "{n}, {d}: {} {expected}", logarithm(n, d));
        }
    }

    #[test]
    fn angles_on_the_axes_and_their_bisectors() {
        let quarter = |x: f64| x * FRAC_PI_4;
        for size in [1e-300, 1e-9, 1.0, 3.0, 1e300] {
            let known = [(0.0, size, 0.0), (size, size, 1.0), (size, 0.0, 2.0), (size, -size, 3.0), (0.0, -size, 4.0)];
            for (y, x, quarters) in known {
                assert_eq!(angle(y, x).to_bits(), quarter(quarters).to_bits(), "{y}, {x}");
                assert_eq!(angle(-y, x).to_bits(), quarter(-quarters).to_bits(), "{}, {x}", -y);
            }
        }
        for zero in [0.0, -0.0] {
            assert_eq!(angle(0.0, zero).to_bits(), 0.0_f64.to_bits());
            assert_eq!(angle(-0.0, zero).to_bits(), (-0.0_f64).to_bits());
            assert_eq!(angle(2.0, zero), FRAC_PI_2);
        }
    }

    #[test]
    fn angles_of_unequal_sides_do_not_round_away() {
        assert_eq!(angle(1e-200, 1.0), 1e-200);
        assert_eq!(angle(1e-200, -1.0), PI);
        assert_eq!(angle(1.0, 1e-200), FRAC_PI_2);
        // Just beside a straight angle.
        assert_eq!(angle(1e-10, -1.0), PI - 1e-10);
    }

    #[test]
    fn logarithms_of_powers_of_two() {
        for k in [-1000, -52, -1, 0, 1, 2, 53, 1000] {
            let expected = f64::from(k) * std::f64::consts::LN_2;
            assert!((logarithm(2f64.powi(k), 1.0) - expected).abs() <= f64::EPSILON * expected.abs(), "{k}");
        }
        assert_eq!(logarithm(1e-300, 1e-300), 0.0);
    }
}
