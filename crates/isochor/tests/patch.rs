//! Patches against independent evaluations, circles, and what makes interpolation.

mod random;

use glam::DVec3;
use isochor::{Basis, Curve, Patch, Smoothness, Surface, SurfaceError};
use random::Random;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Σ ω P B B / Σ ω B B by the rows of the bases.
fn by_rows(patch: &Patch, s: f64, t: f64) -> DVec3 {
    let [along_s, along_t] = patch.bases();
    let row = |basis: &Basis, u: f64| {
        let mut all = vec![0.0; basis.size()];
        let mut values = vec![0.0; basis.degree() + 1];
        let start = basis.row(u, &mut values);
        all[start..start + values.len()].copy_from_slice(&values);
        all
    };
    let [row_s, row_t] = [row(along_s, s), row(along_t, t)];
    let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
    for (i, b_s) in row_s.iter().enumerate() {
        for (j, b_t) in row_t.iter().enumerate() {
            let k = i * row_t.len() + j;
            let w = patch.weights().map_or(1.0, |all| all[k]) * b_s * b_t;
            sum += w * patch.controls()[k];
            weight += w;
        }
    }
    sum / weight
}

/// Any degrees, to those that do not fit the stack.
#[test]
fn patches_are_what_their_bases_say() {
    let mut random = Random(7);
    for degrees in [[1, 1], [3, 3], [2, 5], [9, 4], [10, 3], [12, 14]] {
        for weighted in [false, true] {
            for far in [0.0, 1e6] {
                let bases = [
                    Basis::clamped(degrees[0] + 4, degrees[0]).unwrap(),
                    Basis::uniform(degrees[1] + 3, degrees[1]).unwrap(),
                ];
                let count = bases[0].size() * bases[1].size();
                let place = |k: usize| v((k / bases[1].size()) as f64 + far, (k % bases[1].size()) as f64, 0.0);
                let controls = (0..count).map(|k| place(k) + random.vector()).collect();
                let weights = weighted.then(|| (0..count).map(|_| random.within(0.5, 2.0)).collect());
                let patch = Patch::new(bases, controls, weights).unwrap();
                let surface = Surface::from(patch.clone());
                for _ in 0..20 {
                    let [s, t] = [0; 2].map(|_| random.within(0.0, 1.0));
                    let found = surface.jet(s, t).point;
                    assert!(found.distance(by_rows(&patch, s, t)) < 1e-13 * (1.0 + 100.0 * far), "{degrees:?}");
                }
                // Far away derivatives keep their digits, because differences are taken near an origin of their own.
                let near = Patch::new(
                    patch.bases().clone(),
                    patch.controls().iter().map(|p| p - v(far, 0.0, 0.0)).collect(),
                    patch.weights().map(<[f64]>::to_vec),
                )
                .unwrap();
                let (far, near) = (surface.jet(0.3, 0.6), Surface::from(near).jet(0.3, 0.6));
                let size = 1.0 + near.ss.length() + near.st.length() + near.tt.length();
                for (a, b) in
                    [(far.s, near.s), (far.t, near.t), (far.ss, near.ss), (far.st, near.st), (far.tt, near.tt)]
                {
                    assert!(a.distance(b) < 1e-12 * size, "{degrees:?}: {a} {b}");
                }
            }
        }
    }
}

/// Weights that are all the same are none.
#[test]
fn equal_weights_change_nothing() {
    let bases = || [Basis::bernstein(3).unwrap(), Basis::bernstein(2).unwrap()];
    let controls: Vec<_> = (0..6).map(|k| v(f64::from(k / 2), f64::from(k % 2), f64::from(k * k))).collect();
    let plain = Surface::from(Patch::new(bases(), controls.clone(), None).unwrap());
    let weighted = Surface::from(Patch::new(bases(), controls, Some(vec![3.0; 6])).unwrap());
    assert_eq!(plain.jet(0.3, 0.4), weighted.jet(0.3, 0.4));
}

/// Rational of degrees 2 and 2: the octant of the unit sphere, with a pole at t = 1.
fn octant() -> Patch {
    let half = 0.5_f64.sqrt();
    let basis = || Basis::bernstein(3).unwrap();
    let [arc, weights] = [[(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [(1.0, 0.0), (half, 0.0), (1.0, 0.0)]];
    let pairs = |f: &dyn Fn(usize, usize) -> DVec3| (0..9).map(|k| f(k / 3, k % 3)).collect::<Vec<_>>();
    let controls = pairs(&|i, j| v(arc[j].0 * arc[i].0, arc[j].0 * arc[i].1, arc[j].1));
    let weights = (0..9).map(|k| weights[k / 3].0 * weights[k % 3].0).collect();
    Patch::new([basis(), basis()], controls, Some(weights)).unwrap()
}

#[test]
fn an_octant_of_a_sphere_as_a_rational_patch() {
    let surface = Surface::from(octant());
    for (s, t) in [(0.1, 0.2), (0.5, 0.5), (0.9, 0.7), (0.3, 0.99)] {
        let (jet, normal) = surface.jet_and_normal(s, t);
        assert!((jet.point.length() - 1.0).abs() < 1e-15);
        assert!(normal.unwrap().distance(jet.point) < 1e-13);
        let curvature = jet.curvature().unwrap();
        assert!((curvature.gaussian - 1.0).abs() < 1e-10 && (curvature.mean + 1.0).abs() < 1e-10, "{curvature:?}");
    }
    assert_eq!(surface.poles(), [false, false, false, true]);
    assert!(surface.normal(0.3, 1.0).unwrap().distance(DVec3::Z) < 1e-15);
    let mesh = surface.mesh([4, 4]).unwrap();
    assert_eq!((mesh.points().len(), mesh.faces().len()), (5 * 4 + 1, 16));
}

#[test]
fn a_pointed_patch_has_no_normal_at_its_tip() {
    // A quarter of a cone: the same tip, straight rulings.
    let controls = vec![v(1.0, 0.0, 0.0), DVec3::Z, v(1.0, 1.0, 0.0), DVec3::Z, v(0.0, 1.0, 0.0), DVec3::Z];
    let patch = Patch::new([Basis::bernstein(3).unwrap(), Basis::bernstein(2).unwrap()], controls, None).unwrap();
    let surface = Surface::from(patch);
    assert_eq!((surface.poles(), surface.normal(0.5, 1.0)), ([false, false, false, true], None));
    assert!(surface.normal(0.5, 0.99).is_some());
}

/// Periodic uniform knots with the first controls repeated: a closed tube, smooth across the seam.
#[test]
fn a_closed_patch_goes_round() {
    let (n, p) = (8, 3);
    let ring = |i: usize| {
        let angle = std::f64::consts::TAU * (i % n) as f64 / n as f64;
        v(libm::cos(angle), libm::sin(angle), 0.0)
    };
    let controls = (0..(n + p) * 2).map(|k| ring(k / 2) + (k % 2) as f64 * DVec3::Z).collect();
    let patch = Patch::new([Basis::uniform(n + p, p).unwrap(), Basis::bernstein(2).unwrap()], controls, None).unwrap();
    let surface = Surface::from(patch);
    assert_eq!((surface.closes(), surface.poles()), ([true, false], [false; 4]));
    let [beyond, round] = [surface.jet(1.25, 0.5), surface.jet(0.25, 0.5)];
    assert!(beyond.point.distance(round.point) < 1e-15);
    let [start, end] = [surface.jet(0.0, 0.5), surface.jet(1.0, 0.5)];
    assert!(start.s.distance(end.s) < 1e-13 && start.ss.distance(end.ss) < 1e-11);
}

#[test]
fn beyond_its_border_a_patch_goes_on_along_its_tangents() {
    let surface = Surface::from(octant());
    for t in [0.0, 0.3] {
        let border = surface.jet(1.0, t);
        let beyond = surface.jet(1.2, t);
        assert!(beyond.point.distance(border.point + 0.2 * border.s) < 1e-15);
        assert_eq!((beyond.s, beyond.ss), (border.s, DVec3::ZERO));
    }
}

/// Not-a-knot splines bring back cubic polynomials, for all numbers of points from the degree on.
#[test]
fn interpolation_brings_back_cubic_polynomials() {
    let exact = |s: f64, t: f64| v(s, t, (1.0 + s - 3.0 * s.powi(3)) * (2.0 - t * t + t.powi(3)));
    for size in [[4, 4], [5, 9], [20, 6], [300, 40]] {
        let at = |i: usize, n: usize| i as f64 / (n - 1) as f64;
        let points: Vec<_> =
            (0..size[0] * size[1]).map(|k| exact(at(k / size[1], size[0]), at(k % size[1], size[1]))).collect();
        let surface = Surface::from(Patch::through(size, &points, Smoothness::Bicubic).unwrap());
        for (s, t) in [(0.123, 0.456), (0.9, 0.03), (0.5, 1.0)] {
            let jet = surface.jet(s, t);
            assert!(jet.point.distance(exact(s, t)) < 1e-14, "{size:?}");
            let slope = (1.0 - 9.0 * s * s) * (2.0 - t * t + t.powi(3));
            assert!(jet.s.distance(v(1.0, 0.0, slope)) < 2e-12, "{size:?}: {}", jet.s);
        }
    }
}

#[test]
fn interpolation_meets_its_points() {
    let mut random = Random(11);
    for size in [[2, 2], [2, 3], [3, 4], [7, 5], [30, 2]] {
        for smoothness in [Smoothness::Bicubic, Smoothness::Bilinear] {
            let points: Vec<_> = (0..size[0] * size[1])
                .map(|k| v((k / size[1]) as f64, (k % size[1]) as f64, 0.0) + random.vector())
                .collect();
            let surface = Surface::from(Patch::through(size, &points, smoothness).unwrap());
            for (k, point) in points.iter().enumerate() {
                let at = |i: usize, n: usize| i as f64 / (n - 1) as f64;
                let found = surface.jet(at(k / size[1], size[0]), at(k % size[1], size[1])).point;
                assert!(found.distance(*point) < 1e-13 * 30.0, "{size:?} {smoothness:?}");
            }
        }
    }
    // Between its corners a bilinear cell is the mean.
    let points = [v(0.0, 0.0, 0.0), v(0.0, 1.0, 1.0), v(1.0, 0.0, 2.0), v(1.0, 1.0, 7.0)];
    let surface = Surface::from(Patch::through([2, 2], &points, Smoothness::Bilinear).unwrap());
    assert_eq!(surface.jet(0.5, 0.5).point, v(0.5, 0.5, 2.5));
}

#[test]
fn controls_and_weights_that_make_no_patch() {
    let bases = || [Basis::bernstein(2).unwrap(), Basis::bernstein(2).unwrap()];
    let good = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
    let error = |controls: Vec<DVec3>, weights: Option<Vec<f64>>| Patch::new(bases(), controls, weights).unwrap_err();
    assert!(matches!(error(good[..3].to_vec(), None), SurfaceError::Count { found: 3, expected: 4, .. }));
    assert!(matches!(error(good.clone(), Some(vec![1.0; 5])), SurfaceError::Count { what: "weights", .. }));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = error(good.clone(), Some(vec![1.0, 1.0, bad, 1.0]));
        assert!(matches!(error, SurfaceError::Weight { index: 2, .. }), "{error}");
    }
    let mut bad = good.clone();
    bad[1].y = f64::NAN;
    assert!(matches!(error(bad, None), SurfaceError::NotFinite { index: 1, .. }));
    assert!(matches!(error(good.iter().map(|p| p * 1e300).collect(), None), SurfaceError::Size { .. }));
    let through = |size, count| Patch::through(size, &vec![DVec3::ZERO; count], Smoothness::Bicubic).unwrap_err();
    assert!(matches!(through([2, 3], 5), SurfaceError::Count { .. }));
    let through = |size: [usize; 2]| {
        Patch::through(
            size,
            &(0..size[0] * size[1]).map(|k| v(k as f64, 0.0, 0.0)).collect::<Vec<_>>(),
            Smoothness::Bicubic,
        )
        .unwrap_err()
    };
    assert!(matches!(through([1, 3]), SurfaceError::Basis { axis: "s", .. }));
    assert!(matches!(through([3, 1]), SurfaceError::Basis { axis: "t", .. }));
    assert!(matches!(Patch::through([0, 0], &[], Smoothness::Bilinear), Err(SurfaceError::Count { .. })));
    assert!(matches!(Patch::through([usize::MAX, 2], &good, Smoothness::Bilinear), Err(SurfaceError::Count { .. })));
}

#[test]
fn controls_that_make_no_curve() {
    assert!(matches!(Curve::polyline(vec![]), Err(SurfaceError::Count { .. })));
    assert!(Curve::polyline(vec![DVec3::X]).is_err());
    assert_eq!(
        Curve::polyline(vec![DVec3::ZERO, DVec3::X, DVec3::X, DVec3::Y]),
        Err(SurfaceError::Coincide { index: 1 })
    );
    assert!(Curve::through(vec![DVec3::ONE]).is_err());
    assert!(Curve::through(vec![DVec3::ONE; 5]).is_err());
    let square = vec![DVec3::ZERO, DVec3::X, v(1.0, 1.0, 0.0), DVec3::Y, DVec3::ZERO];
    let square = Curve::polyline(square).unwrap();
    assert!(square.closes());
    assert_eq!((square.jet(0.375).point, square.jet(1.125).point), (v(1.0, 0.5, 0.0), v(0.5, 0.0, 0.0)));
}
