//! Lattices against independent evaluations of their bases, and against what makes them lattices.

mod random;

use glam::{DMat3, DQuat, DVec3};
use isochor::{
    Basis, BasisError, Bounds, Frame, Lattice, LatticeError, MAX_CONTROLS, MAX_SIZE, Outside, displaced, tolerances,
};
use proptest::prelude::*;
use random::Random;

fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.within(0.0, n as f64) as usize
    }

    fn vectors(&mut self, count: usize) -> Vec<DVec3> {
        (0..count).map(|_| self.vector()).collect()
    }

    fn rotation(&mut self) -> DMat3 {
        let [x, y, z] = [0; 3].map(|_| self.within(-1.0, 1.0));
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, 2.0).normalize())
    }

    /// Any degree from 1 to 7 and size to 64: clamped, uniform, Bernstein, or knots of any multiplicity that keeps the
    /// basis continuous.
    fn basis(&mut self) -> Basis {
        let degree = 1 + self.below(7);
        let size = degree + 1 + self.below(64 - degree);
        match self.below(4) {
            0 => Basis::clamped(size, degree),
            1 => Basis::uniform(size, degree),
            2 => Basis::bernstein(2 + self.below(63)),
            _ => {
                // Interior knots in runs of 1 to degree; clamped, uniform-like or mixed ends.
                let (mut interior, mut at) = (Vec::new(), 0.0);
                for _ in 0..self.below(8) {
                    at += self.within(0.05, 1.0);
                    interior.extend(vec![at; 1 + self.below(degree)]);
                }
                at += self.within(0.05, 1.0);
                let clamped = [self.below(2), self.below(2)];
                let before = |i: usize| if clamped[0] == 0 { 0.0 } else { -0.3 * i as f64 };
                let after = |i: usize| if clamped[1] == 0 { 1.0 } else { 1.0 + 0.2 * i as f64 };
                let mut knots: Vec<f64> = (0..=degree).rev().map(before).collect();
                knots.extend(interior.iter().map(|t| t / at));
                knots.extend((0..=degree).map(after));
                Basis::with_knots(knots, degree)
            }
        }
        .unwrap()
    }

    /// Edges of very different lengths, at angles from 40° on, anywhere up to `distance` extents from the origin.
    fn frame(&mut self, distance: f64) -> Frame {
        let (rotation, shear) = (self.rotation(), [0; 3].map(|_| self.within(-0.5, 0.5)));
        let axes = [DVec3::X, DVec3::new(shear[0], 1.0, 0.0), DVec3::new(shear[1], shear[2], 1.0)];
        let axes = axes.map(|a| rotation * a * self.within(0.2, 3.0));
        Frame { origin: self.vector() * distance, axes }
    }

    fn lattice(&mut self, distance: f64) -> Lattice {
        let bases = [0; 3].map(|_| self.basis());
        Lattice::new(bases, self.frame(distance)).unwrap()
    }

    /// A lattice of few controls, for what is compared in full.
    fn small_lattice(&mut self) -> Lattice {
        let basis = |random: &mut Self| {
            let size = 2 + random.below(5);
            let degree = 1 + random.below(size - 1);
            if random.below(2) == 0 { Basis::clamped(size, degree) } else { Basis::uniform(size, degree) }.unwrap()
        };
        let bases = [0; 3].map(|_| basis(self));
        Lattice::new(bases, self.frame(1.0)).unwrap()
    }

    /// Points with parameters between `low` and `high`.
    fn points(&mut self, frame: Frame, count: usize, [low, high]: [f64; 2]) -> Vec<DVec3> {
        (0..count).map(|_| at(frame, [0; 3].map(|_| self.within(low, high)))).collect()
    }
}

fn at(frame: Frame, [u, v, w]: [f64; 3]) -> DVec3 {
    frame.origin + frame.axes[0] * u + frame.axes[1] * v + frame.axes[2] * w
}

const UNIT: Frame = Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };

fn clamped(size: usize, degree: usize, frame: Frame) -> Lattice {
    Lattice::new([0; 3].map(|_| Basis::clamped(size, degree).unwrap()), frame).unwrap()
}

/// All basis functions, or their derivatives, at u.
fn row(basis: &Basis, u: f64, derivative: bool) -> Vec<f64> {
    let mut values = vec![f64::NAN; basis.degree() + 1];
    let first = if derivative { basis.row_derivative(u, &mut values) } else { basis.row(u, &mut values) };
    let mut all = vec![0.0; basis.size()];
    all[first..=first + basis.degree()].copy_from_slice(&values);
    all
}

/// The Cox–de Boor recursion as it stands in textbooks, 0/0 = 0: `B_{i,0}` is 1 on [t_i, t_{i+1}), on the last non-empty span of
/// the domain also at its end.
fn cox_de_boor(t: &[f64], i: usize, p: usize, u: f64) -> f64 {
    if p == 0 {
        return f64::from(if u == 1.0 { t[i] < 1.0 && t[i + 1] == 1.0 } else { t[i] <= u && u < t[i + 1] });
    }
    let share = |up: f64, down: f64| if down == 0.0 { 0.0 } else { up / down };
    share(u - t[i], t[i + p] - t[i]) * cox_de_boor(t, i, p - 1, u)
        + share(t[i + p + 1] - u, t[i + p + 1] - t[i + 1]) * cox_de_boor(t, i + 1, p - 1, u)
}

fn assert_all_near(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (v, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= tolerance, "{v}: {a} instead of {b}, tolerance {tolerance:e}");
    }
}

// Univariate bases

proptest! {
    #![proptest_config(cases(128))]

    #[test]
    fn basis_functions_are_those_of_the_recursion(seed: u64) {
        let mut random = Random(seed);
        let basis = random.basis();
        let (t, p) = (basis.knots(), basis.degree().min(7));
        prop_assume!(basis.degree() == p); // the naive recursion takes 2^degree steps
        for u in [0.0, 1.0, t[t.len() / 2].clamp(0.0, 1.0), random.within(0.0, 1.0), random.within(0.0, 1.0)] {
            for (i, found) in row(&basis, u, false).into_iter().enumerate() {
                let expected = cox_de_boor(t, i, p, u);
                prop_assert!((found - expected).abs() <= 1e-14, "B_{}({}) = {}, not {}", i, u, found, expected);
            }
            for (i, found) in row(&basis, u, true).into_iter().enumerate() {
                let share = |i: usize| {
                    let width = t[i + p] - t[i];
                    if width == 0.0 { 0.0 } else { p as f64 / width * cox_de_boor(t, i, p - 1, u) }
                };
                let expected = share(i) - share(i + 1);
                let size = (share(i).abs() + share(i + 1).abs()).max(1.0);
                prop_assert!((found - expected).abs() <= 1e-13 * size, "B'_{}({}) = {}, not {}", i, u, found, expected);
            }
        }
    }

    #[test]
    fn basis_functions_are_not_negative_sum_to_one_and_give_back_the_parameter(seed: u64) {
        let mut random = Random(seed);
        let basis = random.basis();
        let greville = basis.greville();
        prop_assert_eq!(greville.len(), basis.size());
        for u in [0.0, 1.0, random.within(0.0, 1.0), random.within(0.0, 1.0)] {
            let values = row(&basis, u, false);
            prop_assert!(values.iter().all(|b| *b >= 0.0));
            prop_assert!((values.iter().sum::<f64>() - 1.0).abs() <= 1e-14);
            let identity: f64 = values.iter().zip(&greville).map(|(b, x)| b * x).sum();
            prop_assert!((identity - u).abs() <= 1e-14);
        }
    }

    #[test]
    fn beyond_the_domain_the_functions_go_on_along_their_tangents(seed: u64, beyond in 0.0..3.0f64) {
        let basis = Random(seed).basis();
        for (end, sign) in [(0.0, -1.0), (1.0, 1.0)] {
            let u = end + sign * beyond;
            let (there, here, slopes) = (row(&basis, u, false), row(&basis, end, false), row(&basis, end, true));
            let size = slopes.iter().map(|s| s.abs()).sum::<f64>().max(1.0);
            for i in 0..basis.size() {
                let tangent = here[i] + slopes[i] * (u - end);
                prop_assert!((there[i] - tangent).abs() <= 1e-14 * size * (1.0 + beyond));
            }
            prop_assert_eq!(row(&basis, u, true), slopes);
            prop_assert!((there.iter().sum::<f64>() - 1.0).abs() <= 1e-14 * size * (1.0 + beyond));
            let identity: f64 = there.iter().zip(basis.greville()).map(|(b, x)| b * x).sum();
            prop_assert!((identity - u).abs() <= 1e-14 * size * (1.0 + beyond));
        }
    }
}

#[test]
fn bernstein_polynomials_and_their_derivatives_have_their_closed_form() {
    // b_i(u) = C(n, i) u^i (1 − u)^(n − i), b_i′ = n (b_{i−1} of degree n − 1 − b_i of degree n − 1)
    let bernstein = |n: usize, i: usize, u: f64| {
        let binomial = (0..i).fold(1.0, |c, k| c * (n - k) as f64 / (k + 1) as f64);
        binomial * u.powi(i as i32) * (1.0 - u).powi((n - i) as i32)
    };
    for size in [2, 3, 5, 13, 32, 64] {
        let (basis, n) = (Basis::bernstein(size).unwrap(), size - 1);
        assert!(basis.is_bernstein());
        assert_eq!((basis.size(), basis.degree()), (size, n));
        for (i, xi) in basis.greville().into_iter().enumerate() {
            assert!((xi - i as f64 / n as f64).abs() <= 1e-15);
        }
        for u in [0.0, 0.1, 0.37, 0.5, 0.95, 1.0] {
            let (values, slopes) = (row(&basis, u, false), row(&basis, u, true));
            for i in 0..size {
                assert!((values[i] - bernstein(n, i, u)).abs() <= 1e-14);
                let left = if i > 0 { bernstein(n - 1, i - 1, u) } else { 0.0 };
                let right = if i < n { bernstein(n - 1, i, u) } else { 0.0 };
                assert!((slopes[i] - n as f64 * (left - right)).abs() <= 1e-13 * n as f64);
            }
        }
    }
    assert!(!Basis::clamped(5, 3).unwrap().is_bernstein());
    assert!(!Basis::uniform(4, 3).unwrap().is_bernstein());
}

#[test]
fn derivatives_are_the_limit_of_difference_quotients() {
    // A ladder: the error of a central difference falls with the square of its width.
    let knots = vec![-0.2, 0.0, 0.0, 0.0, 0.3, 0.3, 0.6, 1.0, 1.0, 1.0, 1.5];
    for basis in [Basis::with_knots(knots, 3), Basis::clamped(9, 4), Basis::uniform(7, 5)].map(Result::unwrap) {
        for u in [0.11, 0.47, 0.87] {
            let error = |h: f64| {
                let (high, low, slopes) = (row(&basis, u + h, false), row(&basis, u - h, false), row(&basis, u, true));
                (0..basis.size()).map(|i| ((high[i] - low[i]) / (2.0 * h) - slopes[i]).abs()).fold(0.0, f64::max)
            };
            let (coarse, fine) = (error(1e-2), error(1e-3));
            assert!(coarse < 1.0 && (fine / coarse - 0.01).abs() < 1e-3, "{coarse:e} then {fine:e}");
        }
    }
}

#[test]
fn clamped_and_uniform_knots_have_their_closed_forms() {
    let clamped = Basis::clamped(6, 3).unwrap();
    let third = 1.0 / 3.0;
    assert_eq!(clamped.knots(), [0.0, 0.0, 0.0, 0.0, third, 2.0 / 3.0, 1.0, 1.0, 1.0, 1.0]);
    // t_i = (i − degree) / (size − degree); Greville: (i − (degree − 1) / 2) / (size − degree).
    let uniform = Basis::uniform(6, 2).unwrap();
    assert_eq!(uniform.knots(), [-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5]);
    assert_eq!(uniform.greville(), [-0.125, 0.125, 0.375, 0.625, 0.875, 1.125]);
}

#[test]
fn degree_0_is_refused() {
    for basis in [Basis::clamped(4, 0), Basis::uniform(4, 0), Basis::with_knots(vec![0.0, 1.0], 0)] {
        assert_eq!(basis, Err(BasisError::DegreeZero));
    }
    assert_eq!(Basis::bernstein(1), Err(BasisError::DegreeZero));
}

#[test]
fn too_few_controls_for_the_degree_are_refused() {
    let too_few = |size, degree| Err(BasisError::TooFewControls { size, degree });
    assert_eq!(Basis::clamped(3, 3), too_few(3, 3));
    assert_eq!(Basis::uniform(1, 1), too_few(1, 1));
    assert_eq!(Basis::with_knots(vec![0.0, 0.0, 1.0, 1.0], 2), too_few(1, 2));
    assert_eq!(Basis::with_knots(vec![], 3), too_few(0, 3));
    assert!(Basis::clamped(4, 3).is_ok());
}

#[test]
fn too_many_controls_along_an_axis_are_refused() {
    let too_many = Err(BasisError::TooManyControls { size: MAX_SIZE + 1 });
    assert_eq!(Basis::clamped(MAX_SIZE + 1, 3), too_many);
    assert_eq!(Basis::bernstein(MAX_SIZE + 1), too_many);
    assert!(Basis::uniform(MAX_SIZE, 3).is_ok());
}

#[test]
fn knots_that_decrease_or_are_not_finite_are_refused() {
    assert_eq!(
        Basis::with_knots(vec![0.0, 0.0, 0.6, 0.5, 1.0, 1.0], 1),
        Err(BasisError::NotAscending { index: 3, value: 0.5 })
    );
    let refused = Basis::with_knots(vec![0.0, 0.0, f64::NAN, 1.0, 1.0], 1);
    assert!(matches!(refused, Err(BasisError::NotAscending { index: 2, value }) if value.is_nan()));
    let refused = Basis::with_knots(vec![f64::NEG_INFINITY, 0.0, 0.5, 1.0, 1.0], 1);
    assert!(matches!(refused, Err(BasisError::NotAscending { index: 0, .. })));
}

#[test]
fn knots_over_another_domain_are_refused() {
    let domain = |low, high| Err(BasisError::Domain { low, high });
    assert_eq!(Basis::with_knots(vec![0.0, 0.0, 2.0, 2.0], 1), domain(0.0, 2.0));
    assert_eq!(Basis::with_knots(vec![-1.0, -1.0, 0.5, 1.0, 1.0], 1), domain(-1.0, 1.0));
    assert_eq!(Basis::with_knots(vec![0.5; 4], 1), domain(0.5, 0.5));
}

#[test]
fn knots_that_tear_the_deformation_are_refused() {
    let knots = |count: usize| [vec![0.0; 3], vec![0.5; count], vec![1.0; 3]].concat();
    assert_eq!(Basis::with_knots(knots(3), 2), Err(BasisError::Discontinuous { value: 0.5, count: 3, degree: 2 }));
    assert!(Basis::with_knots(knots(2), 2).is_ok());
}

// Lattices

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn the_rest_positions_reproduce_every_point(seed: u64, distance in 0.0..6.0f64) {
        let mut random = Random(seed);
        let lattice = random.lattice(if seed.is_multiple_of(3) { 10f64.powf(distance) } else { 1.0 });
        let frame = lattice.frame();
        let points = random.points(frame, 50, [0.0, 1.0]);
        let rest = lattice.rest();
        prop_assert_eq!(rest.len(), lattice.control_count());
        let binding = lattice.bind(&points, Outside::Keep).unwrap();
        // To 1e−14 of the extent near the origin; far from it, of the coordinates. Six times: u, v, w amplify the rounding of
        // the point by the ratio of the longest edge to the lowest height of the frame, up to 60.
        let scale = frame.extent() + frame.origin.abs().max_element();
        let heights = [0, 1, 2].map(|a| {
            let [p, q] = [frame.axes[(a + 1) % 3], frame.axes[(a + 2) % 3]];
            frame.axes[a].dot(p.cross(q)).abs() / p.cross(q).length()
        });
        let skew = frame.extent() / heights.into_iter().fold(f64::INFINITY, f64::min);
        prop_assert_eq!(binding.kept_count(), points.iter().filter(|p| {
            let u = lattice.parameters(**p);
            u.min_element() < -tolerances::INSIDE * skew || u.max_element() > 1.0 + tolerances::INSIDE * skew
        }).count());
        assert_all_near(&binding.apply(&rest), &points, 1e-14 * scale * (skew / 10.0).max(1.0));
    }

    #[test]
    fn affine_maps_of_the_controls_are_affine_maps_of_the_points_inside_and_outside(seed: u64) {
        let mut random = Random(seed);
        let lattice = random.small_lattice();
        let points = random.points(lattice.frame(), 50, [-0.7, 1.7]);
        let map = DMat3::from_cols(random.vector(), random.vector(), random.vector());
        let by = random.vector();
        let controls: Vec<DVec3> = lattice.rest().iter().map(|c| map * *c + by).collect();
        let expected: Vec<DVec3> = points.iter().map(|p| map * *p + by).collect();
        let binding = lattice.bind(&points, Outside::Extend).unwrap();
        assert_all_near(&binding.apply(&controls), &expected, 1e-12);
        // The Jacobian of such a map is its matrix.
        let displacement: Vec<DVec3> = controls.iter().zip(lattice.rest()).map(|(c, r)| *c - r).collect();
        for jacobian in lattice.jacobians(&points, &displacement, Outside::Extend) {
            prop_assert!(jacobian.abs_diff_eq(map, 1e-12));
        }
    }

    #[test]
    fn jacobians_are_difference_quotients_inside_and_outside(seed: u64) {
        let mut random = Random(seed);
        let lattice = random.small_lattice();
        let points = random.points(lattice.frame(), 20, [-0.3, 1.3]);
        let displacement = random.vectors(lattice.control_count());
        let deformed = |by: DVec3| {
            let points: Vec<DVec3> = points.iter().map(|p| *p + by).collect();
            displaced(&points, &lattice.bind(&points, Outside::Extend).unwrap().apply(&displacement))
        };
        let jacobians = lattice.jacobians(&points, &displacement, Outside::Extend);
        let h = 1e-6;
        for a in 0..3 {
            let (high, low) = (deformed(DVec3::AXES[a] * h), deformed(DVec3::AXES[a] * -h));
            for (v, jacobian) in jacobians.iter().enumerate() {
                // Second derivatives jump at knots of degree 2, first ones at knots of degree 1: leave a step's width.
                let u = lattice.parameters(points[v]);
                let near_knot = (0..3).any(|b| lattice.bases()[b].knots().iter().any(|t| (u[b] - t).abs() < 1e-4));
                let quotient = (high[v] - low[v]) / (2.0 * h);
                prop_assert!(near_knot || (jacobian.col(a) - quotient).abs().max_element() < 1e-5);
            }
        }
    }
}

#[test]
fn jacobians_are_the_limit_of_difference_quotients() {
    // A ladder: the error of a central difference falls with the square of its width.
    let mut random = Random(1);
    let frame = random.frame(1.0);
    let lattice = Lattice::new([4, 5, 6].map(|n| Basis::bernstein(n).unwrap()), frame).unwrap();
    let displacement = random.vectors(lattice.control_count());
    let point = at(frame, [0.3, 0.6, 0.45]);
    let jacobian = lattice.jacobians(&[point], &displacement, Outside::Refuse)[0];
    let error = |h: f64| {
        let deformed = |p: DVec3| p + lattice.bind(&[p], Outside::Refuse).unwrap().apply(&displacement)[0];
        let quotient =
            |a: usize| (deformed(point + DVec3::AXES[a] * h) - deformed(point - DVec3::AXES[a] * h)) / (2.0 * h);
        (0..3).map(|a| (quotient(a) - jacobian.col(a)).length()).fold(0.0, f64::max)
    };
    let errors = [1e-2, 1e-3, 1e-4].map(|h| error(h * frame.extent() / 10.0));
    for pair in errors.windows(2) {
        assert!((pair[1] / pair[0] - 0.01).abs() < 1e-3, "{errors:?}");
    }
}

#[test]
fn jacobians_are_the_identity_where_nothing_moves() {
    let mut random = Random(2);
    let lattice = random.small_lattice();
    let points = random.points(lattice.frame(), 30, [-0.5, 1.5]);
    let nothing = vec![DVec3::ZERO; lattice.control_count()];
    assert_eq!(lattice.jacobians(&points, &nothing, Outside::Extend), [DMat3::IDENTITY; 30]);
    // Vertices that are kept do not move whatever the controls do.
    let displacement = random.vectors(lattice.control_count());
    let outside = random.points(lattice.frame(), 30, [1.1, 1.5]);
    assert_eq!(lattice.jacobians(&outside, &displacement, Outside::Keep), [DMat3::IDENTITY; 30]);
    assert_ne!(lattice.jacobians(&outside, &displacement, Outside::Extend)[0], DMat3::IDENTITY);
}

#[test]
fn an_untouched_lattice_gives_back_points_bit_for_bit() {
    let mut random = Random(3);
    for distance in [0.0, 1.0, 1e6] {
        let lattice = random.lattice(distance);
        let mut points = random.points(lattice.frame(), 100, [-0.5, 1.5]);
        points.push(DVec3::new(-0.0, 0.0, -0.0));
        for outside in [Outside::Keep, Outside::Extend] {
            let binding = lattice.bind(&points, outside).unwrap();
            let rest = lattice.rest();
            let untouched: Vec<DVec3> = rest.iter().zip(&rest).map(|(posed, rest)| *posed - *rest).collect();
            for (found, expected) in displaced(&points, &binding.apply(&untouched)).iter().zip(&points) {
                assert_eq!(found.to_array().map(f64::to_bits), expected.to_array().map(f64::to_bits));
            }
        }
    }
}

#[test]
fn the_extension_is_linear_and_continues_the_deformation_smoothly() {
    let mut random = Random(4);
    for lattice in [random.small_lattice(), random.small_lattice(), clamped(5, 3, UNIT)] {
        let frame = lattice.frame();
        let displacement = random.vectors(lattice.control_count());
        let deformed = |parameters: [f64; 3]| {
            let p = at(frame, parameters);
            p + lattice.bind(&[p], Outside::Extend).unwrap().apply(&displacement)[0]
        };
        for u in [[0.3, 0.6, 1.0], [0.0, 0.2, 0.7], [0.4, 1.0, 0.9]] {
            let a = (0..3).find(|a| u[*a] == 0.0 || u[*a] == 1.0).unwrap();
            let beyond = |t: f64| {
                let mut u = u;
                u[a] += if u[a] == 1.0 { t } else { -t };
                deformed(u)
            };
            // Linear: no second differences. C¹: slopes from both sides agree up to the width of the difference.
            let second = beyond(2.0) - 2.0 * beyond(1.0) + beyond(0.0);
            assert!(second.length() < 1e-12, "{second}");
            let (out, inward) = (beyond(1.0) - beyond(0.0), (beyond(0.0) - beyond(-1e-6)) / 1e-6);
            assert!((out - inward).length() < 1e-3 * out.length().max(1.0), "{out} and {inward}");
        }
    }
}

#[test]
fn parameters_and_indices_go_both_ways() {
    let mut random = Random(5);
    let lattice = random.lattice(3.0);
    for _ in 0..20 {
        let u = [0; 3].map(|_| random.within(-1.0, 2.0));
        let found = lattice.parameters(at(lattice.frame(), u));
        assert!((found - DVec3::from_array(u)).abs().max_element() < 1e-12);
    }
    let lattice = Lattice::new([2, 3, 4].map(|n| Basis::clamped(n, 1).unwrap()), UNIT).unwrap();
    assert_eq!((lattice.size(), lattice.control_count()), ([2, 3, 4], 24));
    assert_eq!((lattice.index([0, 0, 3]), lattice.index([0, 1, 0]), lattice.index([1, 0, 0])), (3, 4, 12));
    for c in 0..24 {
        let [i, j, k] = lattice.node(c);
        assert_eq!(lattice.index([i, j, k]), c);
        let expected = DVec3::new(i as f64, j as f64 / 2.0, k as f64 / 3.0);
        assert!((lattice.rest()[c] - expected).abs().max_element() <= 1e-16);
    }
}

#[test]
fn every_measure_follows_rotation_translation_scale_and_mirroring_of_the_frame() {
    let mut random = Random(6);
    let lattice = random.small_lattice();
    let frame = lattice.frame();
    let points = random.points(frame, 30, [-0.2, 1.2]);
    let (rotation, by) = (random.rotation(), random.vector());
    for map in [rotation, rotation * 1e-3, rotation * 1e3, rotation * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))]
    {
        let image = |p: DVec3| map * p + map * by;
        let frame = Frame { origin: image(frame.origin), axes: frame.axes.map(|a| map * a) };
        let other = Lattice::new(lattice.bases().clone(), frame).unwrap();
        let images: Vec<DVec3> = points.iter().map(|p| image(*p)).collect();
        let rest: Vec<DVec3> = lattice.rest().into_iter().map(image).collect();
        assert_all_near(&other.rest(), &rest, 1e-13 * frame.extent());
        let weights = |lattice: &Lattice, points: &[DVec3]| {
            let binding = lattice.bind(points, Outside::Extend).unwrap();
            let unit: Vec<f64> = (0..binding.control_count()).map(|c| (c as f64).sin()).collect();
            binding.apply_scalar(&unit)
        };
        for (a, b) in weights(&lattice, &points).into_iter().zip(weights(&other, &images)) {
            assert!((a - b).abs() < 1e-11, "{a} and {b}");
        }
    }
}

// Inside and outside

#[test]
fn vertices_outside_are_kept_extended_or_refused() {
    let frame = Frame { origin: DVec3::ONE, axes: [DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0] };
    let lattice = clamped(4, 3, frame);
    let points = [DVec3::splat(2.0), DVec3::new(2.0, 2.0, 3.5), DVec3::new(0.5, 2.0, 2.0)];
    let by = vec![DVec3::new(0.0, 1.0, 0.0); 64];
    let kept = lattice.bind(&points, Outside::Keep).unwrap();
    assert_eq!(kept.kept_count(), 2);
    assert_all_near(&kept.apply(&by), &[DVec3::Y, DVec3::ZERO, DVec3::ZERO], 1e-15);
    let extended = lattice.bind(&points, Outside::Extend).unwrap();
    assert_eq!(extended.kept_count(), 0);
    assert_all_near(&extended.apply(&by), &[DVec3::Y; 3], 1e-14);
    let refused = lattice.bind(&points, Outside::Refuse).unwrap_err();
    let parameters = DVec3::new(0.5, 0.5, 1.25);
    assert_eq!(refused, LatticeError::Outside { count: 2, vertex: 1, parameters });
    assert!(lattice.bind(&points[..1], Outside::Refuse).is_ok());
}

#[test]
fn a_trillionth_outside_is_inside_and_a_thousandth_is_not() {
    let lattice = clamped(4, 3, UNIT);
    for a in 0..3 {
        for (end, sign) in [(0.0, -1.0), (1.0, 1.0)] {
            let point = |out: f64| {
                let mut p = DVec3::splat(0.5);
                p[a] = end + sign * out;
                [p]
            };
            for (out, is_inside) in [(0.0, true), (1e-12, true), (5e-10, true), (2e-9, false), (1e-3, false)] {
                assert_eq!(lattice.bind(&point(out), Outside::Refuse).is_ok(), is_inside, "{out:e}");
                let kept = lattice.bind(&point(out), Outside::Keep).unwrap().kept_count();
                assert_eq!(kept == 0, is_inside, "{out:e}");
            }
        }
    }
}

#[test]
fn the_tolerance_is_relative_to_the_longest_edge() {
    // Along the short edge a step of 1e−10 extents is 1e−7 in parameters, and inside all the same.
    let frame = Frame { origin: DVec3::ZERO, axes: [DVec3::X * 50.0, DVec3::Y * 50.0, DVec3::Z * 0.05] };
    let lattice = clamped(4, 3, frame);
    let above = |height: f64| [DVec3::new(1.0, 1.0, 0.05 + height)];
    assert!(lattice.bind(&above(5e-9), Outside::Refuse).is_ok());
    assert!(lattice.bind(&above(5e-7), Outside::Refuse).is_err());
}

// Frames

#[test]
fn a_fitted_frame_is_the_box_grown_by_its_margin() {
    let bounds = Bounds { min: DVec3::new(-1.0, 2.0, 0.0), max: DVec3::new(3.0, 4.0, 1.0) };
    let frame = Frame::fitted(bounds, 0.0).unwrap();
    assert_eq!((frame.bounds(), frame.extent()), (bounds, 4.0));
    // A quarter of the extent 4 on every side.
    let frame = Frame::fitted(bounds, 0.25).unwrap();
    assert_eq!(frame.bounds(), Bounds { min: bounds.min - 1.0, max: bounds.max + 1.0 });
    assert_eq!(frame.moved(DVec3::ONE).bounds(), Bounds { min: bounds.min, max: bounds.max + 2.0 });
    let frame = Frame::fitted(bounds, -0.1).unwrap();
    assert!((frame.axes[2].z - 0.2).abs() < 1e-15);
}

#[test]
fn flat_models_get_a_frame_of_a_tenth_of_their_extent() {
    for flat in [[1.0, 2.0, 0.0], [0.0, 2.0, 0.0], [2.0, 0.0, 1.0], [2.0, 1.0, 1e-13]] {
        let size = DVec3::from_array(flat);
        let bounds = Bounds { min: DVec3::splat(5.0), max: DVec3::splat(5.0) + size };
        let frame = Frame::fitted(bounds, 0.0).unwrap();
        for (a, side) in flat.into_iter().enumerate() {
            let expected = if side > 1e-12 { side } else { 0.2 };
            assert!((frame.axes[a][a] - expected).abs() < 1e-15);
        }
        // The model stays in its middle, and binds.
        let lattice = clamped(4, 3, frame);
        let middle = lattice.parameters(bounds.center());
        assert!((middle - 0.5).abs().max_element() < 1e-14);
        let binding = lattice.bind(&[bounds.min, bounds.max], Outside::Refuse).unwrap();
        assert_all_near(&binding.apply(&lattice.rest()), &[bounds.min, bounds.max], 1e-14);
    }
}

#[test]
fn points_and_margins_that_leave_nothing_cannot_be_fitted() {
    let refused = |bounds: Bounds, margin: f64| match Frame::fitted(bounds, margin) {
        Err(LatticeError::NothingToFit { size, .. }) => assert_eq!(size, bounds.size()),
        other => panic!("{other:?}"),
    };
    let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
    let unit = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
    refused(point, 0.0);
    refused(point, 1.0);
    refused(unit, -0.5);
    refused(unit, f64::NAN);
    refused(unit, f64::INFINITY);
}

#[test]
fn flat_frames_and_frames_that_are_not_finite_are_refused() {
    let bases = || [0; 3].map(|_| Basis::clamped(4, 3).unwrap());
    let refused = |frame: Frame| match Lattice::new(bases(), frame) {
        Err(LatticeError::FlatFrame { .. }) => {}
        other => panic!("{other:?}"),
    };
    let with_axes = |axes: [DVec3; 3]| Frame { origin: DVec3::ZERO, axes };
    refused(with_axes([DVec3::X, DVec3::Y, DVec3::ZERO]));
    refused(with_axes([DVec3::X, DVec3::Y, DVec3::X + DVec3::Y]));
    refused(with_axes([DVec3::X, DVec3::Y, DVec3::X + 1e-10 * DVec3::Z]));
    refused(with_axes([DVec3::X, DVec3::Y, DVec3::Z * f64::NAN]));
    refused(with_axes([DVec3::X, DVec3::Y, DVec3::Z * f64::INFINITY]));
    refused(Frame { origin: DVec3::splat(f64::NAN), ..UNIT });
    refused(Frame { origin: DVec3::splat(f64::INFINITY), ..UNIT });
    // Thin is not flat, and a left-handed frame is as good as a right-handed one.
    assert!(Lattice::new(bases(), with_axes([DVec3::X, DVec3::Y, DVec3::Z * 1e-12])).is_ok());
    assert!(Lattice::new(bases(), with_axes([DVec3::Y, DVec3::X, DVec3::Z])).is_ok());
}

#[test]
fn more_controls_than_memory_holds_are_refused() {
    let bases = |size: [usize; 3]| size.map(|n| Basis::clamped(n, 1).unwrap());
    assert_eq!(256 * 256 * 256, MAX_CONTROLS);
    assert!(Lattice::new(bases([256; 3]), UNIT).is_ok());
    let size = [256, 256, 257];
    assert_eq!(Lattice::new(bases(size), UNIT), Err(LatticeError::TooManyControls { size }));
    assert!(Lattice::new(bases([1024; 3]), UNIT).is_err());
}
