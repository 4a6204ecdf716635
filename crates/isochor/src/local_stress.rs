//! Local stress: by how much a deformation turns directions beyond its own rotation. CVB, section 4.
//!
//! The Jacobian matrix M of a deformation at a point is a rotation, a stretch `S = diag(s₁, s₂, s₃)` along three directions, and another rotation; s₁ ≥ s₂
//! ≥ |s₃|, and s₃ has the sign of det M: below 0 the deformation turns inside out there. The stress is the largest angle between a vector g and S g,
//!
//! ```text
//! θ = max arccos(g · S g / |S g|) = arccos(2 √(s₁ s₃) / (s₁ + s₃))
//! ```
//!
//! reached in the plane of s₁ and s₃, where `tan² = s₁/s₃`; the tangent of θ is `(s₁ − s₃) / (2 √(s₁ s₃))`. Where s₃ = 0 it is a right angle, and below
//! that the third direction itself is turned over: π.
//!
//! *Changes versus the paper*: it says that θ depends on s₁ and s₃ alone, from simulations, and fits a polynomial of degree 6 in s₁ and s₃ to it, with an
//! average error of 0.44° over values that it does not state; the closed form has none. Such polynomials by least squares are off by 0.001° on average between 1/2
//! and 2, by 0.13° between 1/5 and 5, by 0.44° between 1/10 and 10, where the largest error is 12°, and by 0.75° between 1/20 and 20 (`isochor bench cage`).

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use crate::parallel;

/// How a deformation stretches a small piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalStress {
    /// s₁ ≥ s₂ ≥ |s₃|, the last with the sign of the determinant.
    pub singular_values: [f64; 3],
}

/// Local stress at many points.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct StressReport {
    /// Points at which it was measured.
    pub points: usize,
    /// Mean angle, in degrees; 180 where the deformation turns inside out.
    pub mean_degrees: f64,
    /// Largest angle, in degrees.
    pub largest_degrees: f64,
    /// The first point with the largest angle.
    pub largest_at: usize,
    /// Points at which the deformation turns inside out.
    pub inverted: usize,
    /// The first of them.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub first_inverted: Option<usize>,
    /// Smallest s₃ and largest s₁.
    pub stretches: [f64; 2],
}

impl LocalStress {
    /// Of a Jacobian matrix, by Jacobi's method on its columns: singular values to a few roundings, however small (J. Demmel, K. Veselić, *Jacobi's method
    /// is more accurate than QR*, 1992).
    #[must_use]
    pub fn of(jacobian: &DMat3) -> Self {
        let images = Stretched::of(jacobian).images;
        let mut singular_values = images.map(DVec3::length);
        // Vectors at right angles tell the sign of their determinant, whatever their lengths.
        let [a, b, c] = images.map(DVec3::normalize_or_zero);
        if a.dot(b.cross(c)) < 0.0 {
            singular_values[2] = -singular_values[2];
        }
        Self { singular_values }
    }

    /// θ, in radians: 0 for similarities, π where the deformation turns inside out.
    #[must_use]
    pub fn angle(&self) -> f64 {
        let [s1, _, s3] = self.singular_values;
        if s3 < 0.0 { PI } else { libm::atan2(s1 - s3, 2.0 * (s1 * s3).sqrt()) }
    }

    /// sin θ, `(s₁ − s₃) / (s₁ + s₃)`; where the deformation turns inside out the same quotient, which grows there from 1 on.
    #[must_use]
    pub fn sine(&self) -> f64 {
        let [s1, _, s3] = self.singular_values;
        (s1 - s3) / (s1 + s3)
    }

    /// Whether the deformation turns inside out.
    #[must_use]
    pub fn is_inverted(&self) -> bool {
        self.singular_values[2] < 0.0
    }
}

/// The angles θ of a deformation's Jacobian matrices at some points (#points), in radians: 0 for similarities, π where it turns inside out.
#[must_use]
pub fn stress_angles(jacobians: &[DMat3]) -> Vec<f64> {
    parallel::collect(jacobians.len(), |i| LocalStress::of(&jacobians[i]).angle())
}

/// [`LocalStress::sine`] of a Jacobian matrix and its derivatives by the entries. Where two singular values are the same it has no derivative; then that of
/// one side.
pub(crate) fn sine_with_slope(jacobian: &DMat3) -> (f64, DMat3) {
    let Stretched { images: [a, b, _], axes: [v1, _, v3] } = Stretched::of(jacobian);
    let (u1, s1) = (a.normalize(), a.length());
    // Right-handed as the axes are, so that s₃ has its sign.
    let u3 = u1.cross(b.normalize_or(u1.any_orthonormal_vector()));
    let s3 = u3.dot(*jacobian * v3);
    // ds = u dM v
    let outer = |u: DVec3, v: DVec3| DMat3::from_cols(u * v.x, u * v.y, u * v.z);
    let slope = (outer(u1, v1) * s3 - outer(u3, v3) * s1) * (2.0 / (s1 + s3).powi(2));
    ((s1 - s3) / (s1 + s3), slope)
}

/// The axes along which a matrix stretches, longest image first.
struct Stretched {
    /// M v, at right angles.
    images: [DVec3; 3],
    /// v: orthonormal, right-handed.
    axes: [DVec3; 3],
}

impl Stretched {
    fn of(matrix: &DMat3) -> Self {
        /// Sweeps. They converge quadratically: few are needed.
        const SWEEPS: usize = 30;
        let mut columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
        let mut axes = DVec3::AXES;
        for _ in 0..SWEEPS {
            let mut is_done = true;
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                let (a, b): (DVec3, DVec3) = (columns[i], columns[j]);
                let (aa, bb, ab) = (a.dot(a), b.dot(b), a.dot(b));
                if ab.abs() <= f64::EPSILON * (aa * bb).sqrt() {
                    continue;
                }
                is_done = false;
                let zeta = (bb - aa) / (2.0 * ab);
                let tangent = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
                let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                let turned = |a: DVec3, b: DVec3| ((a - b * tangent) * cosine, (b + a * tangent) * cosine);
                (columns[i], columns[j]) = turned(a, b);
                (axes[i], axes[j]) = turned(axes[i], axes[j]);
            }
            if is_done {
                break;
            }
        }
        // An even permutation: the next axis takes the place of the longest, and the last ones change with a sign.
        let mut order = [0, 1, 2];
        order.sort_by(|i, j| columns[*j].length().total_cmp(&columns[*i].length()));
        let sign = if (order[1] + 3 - order[0]) % 3 == 1 { 1.0 } else { -1.0 };
        let ordered = |of: [DVec3; 3]| [of[order[0]], of[order[1]], of[order[2]] * sign];
        Self { images: ordered(columns), axes: ordered(axes) }
    }
}

impl StressReport {
    /// Of a deformation's Jacobian matrices at some points. `None` without points.
    #[must_use]
    pub fn of(jacobians: &[DMat3]) -> Option<Self> {
        let all: Vec<LocalStress> = jacobians.iter().map(LocalStress::of).collect();
        let first = all.first()?;
        let (mut largest_at, mut sum) = (0, 0.0);
        let mut stretches = [first.singular_values[2], first.singular_values[0]];
        for (i, stress) in all.iter().enumerate() {
            sum += stress.angle();
            if stress.angle() > all[largest_at].angle() {
                largest_at = i;
            }
            stretches = [stretches[0].min(stress.singular_values[2]), stretches[1].max(stress.singular_values[0])];
        }
        Some(Self {
            points: all.len(),
            mean_degrees: (sum / all.len() as f64).to_degrees(),
            largest_degrees: all[largest_at].angle().to_degrees(),
            largest_at,
            inverted: all.iter().filter(|stress| stress.is_inverted()).count(),
            first_inverted: all.iter().position(LocalStress::is_inverted),
            stretches,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn turned(angle: f64) -> DMat3 {
        DMat3::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), angle)
    }

    proptest! {
        /// Those of U S Vᵀ, down to values that are far below the largest's rounding.
        #[test]
        fn singular_values_are_found(exponents in prop::array::uniform3(-20.0..2.0), is_inside_out: bool, a in 0.0..6.0, b in 0.0..6.0) {
            let mut s = exponents.map(|x: f64| 10.0_f64.powf(x));
            s.sort_unstable_by(|a, b| b.total_cmp(a));
            if is_inside_out {
                s[2] = -s[2];
            }
            // Columns of different sizes at right angles: what Jacobi's method keeps.
            let jacobian = turned(a) * DMat3::from_diagonal(DVec3::from_array(s));
            let found = LocalStress::of(&jacobian).singular_values;
            prop_assert!(found.iter().zip(s).all(|(found, s)| (found - s).abs() <= 1e-14 * s.abs()), "{found:?} {s:?}");
            let found = LocalStress::of(&(jacobian * turned(b))).singular_values;
            prop_assert!(found.iter().zip(s).all(|(one, s)| (one - s).abs() <= 1e-14 * s.abs() + 2e-15 * found[0]), "{found:?} {s:?}");
        }

        /// The paper's simulation: no direction turns by more than θ, and one in the plane of s₁ and s₃ does turn so.
        #[test]
        fn the_angle_is_the_largest_of_all_directions(s in prop::array::uniform3(0.05..3.0), g in prop::array::uniform3(-1.0..1.0)) {
            let stretch = DMat3::from_diagonal(DVec3::from_array(s));
            let stress = LocalStress::of(&(turned(1.0) * stretch * turned(2.0)));
            let [s1, s2, s3] = stress.singular_values;
            let turn = |g: DVec3| { let image = DVec3::new(s1, s2, s3) * g; (g.dot(image) / (g.length() * image.length())).min(1.0).acos() };
            let g = DVec3::from_array(g);
            prop_assume!(g.length() > 0.01);
            prop_assert!(turn(g) <= stress.angle() + 1e-7);
            let worst = DVec3::new(s3.sqrt(), 0.0, s1.sqrt());
            prop_assert!((turn(worst) - stress.angle()).abs() <= 1e-7);
            prop_assert!((libm::acos((2.0 * (s1 * s3).sqrt() / (s1 + s3)).min(1.0)) - stress.angle()).abs() <= 1e-7);
        }
    }

    proptest! {
        /// The sine is that of the angle, and its derivatives are its slopes.
        #[test]
        fn sines_have_slopes(
            s1 in 1.5..3.0,
            s2 in 1.1..1.4,
            s3 in -0.9..1.0,
            angle in 0.0..6.0,
            by in prop::array::uniform9(-1.0..1.0),
        ) {
            let jacobian = turned(angle) * DMat3::from_diagonal(DVec3::new(s2, s3, s1)) * turned(2.0 * angle);
            let (sine, slope) = sine_with_slope(&jacobian);
            let stress = LocalStress::of(&jacobian);
            prop_assert!((sine - stress.sine()).abs() <= 1e-14 * sine && (sine - (s1 - s3) / (s1 + s3)).abs() <= 1e-13 * sine);
            prop_assert!(s3 < 0.0 || (sine - libm::sin(stress.angle())).abs() <= 1e-13);
            let by = DMat3::from_cols_array(&by);
            let at = |step: f64| LocalStress::of(&(jacobian + by * step)).sine();
            let measured = (at(1e-6) - at(-1e-6)) / 2e-6;
            let expected: f64 = (0..3).map(|k| slope.col(k).dot(by.col(k))).sum();
            prop_assert!((measured - expected).abs() <= 1e-6 * (1.0 + expected.abs()), "{measured}, not {expected}");
        }
    }

    #[test]
    fn degenerate_pieces_have_angles() {
        let angle = |s: [f64; 3]| LocalStress::of(&DMat3::from_diagonal(DVec3::from_array(s))).angle();
        assert_eq!(angle([2.0, 2.0, 2.0]), 0.0);
        assert_eq!(angle([2.0, 1.0, 0.0]), PI / 2.0);
        assert_eq!(angle([2.0, 1.0, -0.1]), PI);
        assert_eq!(angle([0.0; 3]), 0.0);
        assert!((angle([3.0, 2.0, 1.0]) - PI / 6.0).abs() <= 1e-15);
    }

    #[test]
    fn reports_name_the_worst_point() {
        let of = |s: [f64; 3]| DMat3::from_diagonal(DVec3::from_array(s));
        let report = StressReport::of(&[of([1.0; 3]), of([3.0, 1.0, 1.0]), of([1.0, 0.5, -0.5])]).unwrap();
        assert_eq!((report.points, report.largest_at, report.inverted, report.first_inverted), (3, 2, 1, Some(2)));
        assert!((report.mean_degrees - 70.0).abs() <= 1e-12 && report.largest_degrees == 180.0);
        assert_eq!(report.stretches, [-0.5, 3.0]);
        assert_eq!(StressReport::of(&[]), None);
    }
}
