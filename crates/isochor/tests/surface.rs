//! Surfaces against their closed forms: curvatures, normals, seams, poles, developments, geodesics.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3};
use isochor::{Basis, Curve, OpenBoundaries, Patch, Smoothness, Solid, Surface, SurfaceError, topology};
use proptest::prelude::*;

const FULL: [f64; 2] = [0.0, 360.0];
const Z_AXIS: [DVec3; 2] = [DVec3::ZERO, DVec3::Z];

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A half circle in the plane y = 0 from the south pole to the north pole, as a rational curve.
fn half_circle(radius: f64) -> Curve {
    let knots = vec![0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.0];
    let controls = [v(0.0, 0.0, -1.0), v(1.0, 0.0, -1.0), v(1.0, 0.0, 0.0), v(1.0, 0.0, 1.0), v(0.0, 0.0, 1.0)];
    let half = 0.5_f64.sqrt();
    let basis = Basis::with_knots(knots, 2).unwrap();
    Curve::new(basis, controls.map(|c| radius * c).to_vec(), Some(vec![1.0, half, 1.0, half, 1.0])).unwrap()
}

/// Enneper's surface over [−1, 1]², which is a polynomial of degrees (3, 3).
fn enneper(u: f64, w: f64) -> DVec3 {
    v(u - u * u * u / 3.0 + u * w * w, w - w * w * w / 3.0 + w * u * u, u * u - w * w)
}

fn grid(n: usize, m: usize, f: impl Fn(f64, f64) -> DVec3) -> Vec<DVec3> {
    let at = |i: usize, n: usize| i as f64 / (n - 1) as f64;
    (0..n * m).map(|k| f(at(k / m, n), at(k % m, m))).collect()
}

fn enneper_patch() -> Patch {
    let points = grid(4, 4, |s, t| enneper(2.0 * s - 1.0, 2.0 * t - 1.0));
    Patch::through([4, 4], &points, Smoothness::Bicubic).unwrap()
}

fn wave() -> Curve {
    Curve::through((0..7).map(|i| v(f64::from(i), libm::sin(f64::from(i)), 0.0)).collect()).unwrap()
}

/// One of each kind, and parts, and placed and flipped ones.
fn surfaces() -> Vec<(&'static str, Surface)> {
    let bumps = grid(6, 5, |s, t| v(3.0 * s, 2.0 * t, libm::sin(3.0 * s) * libm::cos(2.0 * t)));
    vec![
        ("plane", Surface::plane(v(1.0, 2.0, 3.0), [v(2.0, 0.0, 1.0), v(0.5, 1.0, 0.0)])),
        ("cylinder", Surface::cylinder(0.7, 2.0)),
        ("part of a cylinder", Surface::cylinder_part(2.0, 1.0, [30.0, 200.0]).unwrap()),
        ("cone", Surface::cone([2.0, 0.5], 3.0, FULL).unwrap()),
        ("opening cone", Surface::cone([0.0, 1.5], 2.0, [-45.0, 135.0]).unwrap()),
        ("sphere", Surface::sphere(1.3, FULL, [-90.0, 90.0]).unwrap()),
        ("part of a sphere", Surface::sphere(2.0, [10.0, 100.0], [-20.0, 60.0]).unwrap()),
        ("torus", Surface::torus([2.0, 0.5], FULL, FULL).unwrap()),
        ("patch", enneper_patch().into()),
        ("spline", Patch::through([6, 5], &bumps, Smoothness::Bicubic).unwrap().into()),
        ("revolution", Surface::revolution(wave(), [v(0.0, 5.0, 1.0), v(1.0, 0.2, 0.3)], [0.0, 250.0]).unwrap()),
        ("extrusion", Surface::extrusion(wave(), v(0.3, 0.2, 1.5)).unwrap()),
        ("patch swept along t", swept(1, None)),
        ("patch swept along s", swept(0, None)),
        ("rational patch swept along t", swept(1, Some(|i, _| 1.0 + 0.3 * i as f64))),
        ("flipped cone", Surface::cone([2.0, 0.5], 3.0, [0.0, 300.0]).unwrap().flipped()),
        (
            "placed",
            Surface::torus([3.0, 1.0], [0.0, 90.0], [20.0, 140.0])
                .unwrap()
                .placed(v(1.0, -2.0, 0.5), v(1.0, 1.0, 1.0), v(1.0, 0.0, 0.0))
                .unwrap(),
        ),
    ]
}

/// The patch of four control points of a curve, swept along a vector in three uneven steps, t for `axis` 1, s for 0; `weight` of curve and step.
fn swept(axis: usize, weight: Option<fn(usize, usize) -> f64>) -> Surface {
    let curve = [v(0.0, 0.0, 0.0), v(0.4, 0.1, 0.9), v(1.1, -0.2, -0.6), v(1.7, 0.3, 0.2)];
    let bases = [Basis::bernstein(4).unwrap(), Basis::bernstein(3).unwrap()];
    let all: Vec<(usize, usize)> = match axis {
        1 => (0..4).flat_map(|i| (0..3).map(move |j| (i, j))).collect(),
        _ => (0..3).flat_map(|j| (0..4).map(move |i| (i, j))).collect(),
    };
    let controls = all.iter().map(|(i, j)| curve[*i] + [0.0, 0.7, 1.0][*j] * v(0.2, 1.5, 0.3)).collect();
    let weights = weight.map(|weight| all.iter().map(|(i, j)| weight(*i, *j)).collect());
    let [of_curve, of_steps] = bases;
    let bases = if axis == 1 { [of_curve, of_steps] } else { [of_steps, of_curve] };
    Patch::new(bases, controls, weights).unwrap().into()
}

#[test]
fn swept_patches_are_developable_and_others_are_not() {
    for (name, surface) in surfaces() {
        let is_developable = ["plane", "cylinder", "cone", "extrusion", "swept"].iter().any(|word| name.contains(word));
        assert_eq!(surface.is_developable(), is_developable, "{name}");
    }
    // A quarter of a circle, exactly, is as long as it is.
    let corner = [v(1.0, 0.0, 0.0), v(1.0, 1.0, 0.0), v(0.0, 1.0, 0.0)];
    let controls = corner.iter().flat_map(|p| [*p, *p + 2.0 * DVec3::Z]).collect();
    let weights = [1.0, 0.5f64.sqrt(), 1.0].iter().flat_map(|w| [*w; 2]).collect();
    let bases = [Basis::bernstein(3).unwrap(), Basis::bernstein(2).unwrap()];
    let quarter = Surface::from(Patch::new(bases, controls, Some(weights)).unwrap());
    let [from, to] = [DVec2::ZERO, DVec2::ONE].map(|at| quarter.development(at.x, at.y).unwrap());
    assert!((to - from).distance(DVec2::new(FRAC_PI_2, 2.0)) < 1e-12);
    assert!((quarter.geodesic(DVec2::ZERO, DVec2::ONE).unwrap() - FRAC_PI_2.hypot(2.0)).abs() < 1e-12);
    // Weights that differ along the rulings change where (s, t) is; such patches have no closed form here.
    assert!(!swept(1, Some(|_, j| 1.0 + 0.3 * j as f64)).is_developable());
    // One control point aside.
    let mut controls: Vec<DVec3> =
        (0..9).map(|k| v((k / 3) as f64, (k % 3) as f64, ((k / 3) * (k / 3)) as f64)).collect();
    let of = |controls: &[DVec3]| {
        Surface::from(Patch::new([0; 2].map(|_| Basis::bernstein(3).unwrap()), controls.to_vec(), None).unwrap())
    };
    assert!(of(&controls).is_developable());
    controls[4].z += 1e-9;
    assert!(!of(&controls).is_developable());
}

/// No knot of the splines is there.
const INNER: [(f64, f64); 5] = [(0.52, 0.47), (0.13, 0.82), (0.91, 0.27), (0.37, 0.61), (0.71, 0.43)];

#[test]
fn derivatives_are_those_of_central_differences() {
    for (name, surface) in surfaces() {
        for (s, t) in INNER.into_iter().chain([(-0.03, 0.4), (0.63, 1.04), (1.02, -0.01)]) {
            let (jet, h) = (surface.jet(s, t), 1e-5);
            let by = |ds: f64, dt: f64| surface.jet(s + ds, t + dt);
            let [s_plus, s_minus, t_plus, t_minus] = [by(h, 0.0), by(-h, 0.0), by(0.0, h), by(0.0, -h)];
            for (what, found, difference) in [
                ("s", jet.s, (s_plus.point - s_minus.point) / (2.0 * h)),
                ("t", jet.t, (t_plus.point - t_minus.point) / (2.0 * h)),
                ("ss", jet.ss, (s_plus.s - s_minus.s) / (2.0 * h)),
                ("st", jet.st, (t_plus.s - t_minus.s) / (2.0 * h)),
                ("st", jet.st, (s_plus.t - s_minus.t) / (2.0 * h)),
                ("tt", jet.tt, (t_plus.t - t_minus.t) / (2.0 * h)),
            ] {
                let size = 1.0 + jet.s.length() + jet.ss.length() + jet.tt.length();
                assert!(
                    found.distance(difference) < 3e-7 * size,
                    "{name} {what} at ({s}, {t}): {found}, not {difference}"
                );
            }
        }
    }
}

/// K, the larger and the smaller principal curvature.
fn assert_curvatures(surface: &Surface, s: f64, t: f64, principal: [f64; 2]) {
    let jet = surface.jet(s, t);
    let curvature = jet.curvature().unwrap();
    let near = |a: f64, b: f64| (a - b).abs() <= 2e-12 * (1.0 + b.abs());
    let [large, small] = principal;
    assert!(
        near(curvature.principal[0], large) && near(curvature.principal[1], small),
        "{curvature:?}, not {principal:?}"
    );
    assert!(near(curvature.gaussian, large * small) && near(curvature.mean, (large + small) / 2.0), "{curvature:?}");
    assert!(near(curvature.strongest(), large.abs().max(small.abs())));
    let [a, b] = curvature.directions;
    assert!(a.cross(b).distance(jet.normal().unwrap()) < 1e-12);
}

#[test]
fn curvatures_of_a_sphere() {
    let sphere = Surface::sphere(1.3, FULL, [-90.0, 90.0]).unwrap();
    for (s, t) in INNER {
        assert_curvatures(&sphere, s, t, [-1.0 / 1.3; 2]);
        assert_curvatures(&sphere.clone().flipped(), s, t, [1.0 / 1.3; 2]);
        assert!(sphere.normal(s, t).unwrap().distance(sphere.jet(s, t).point / 1.3) < 1e-15);
    }
}

#[test]
fn curvatures_of_a_cylinder_and_their_directions() {
    let cylinder = Surface::cylinder(0.7, 2.0);
    for (s, t) in INNER {
        assert_curvatures(&cylinder, s, t, [0.0, -1.0 / 0.7]);
        let [straight, round] = cylinder.jet(s, t).curvature().unwrap().directions;
        assert!(straight.z.abs() > 1.0 - 1e-15 && round.z.abs() < 1e-15);
    }
}

/// Across its ruling a cone bends as the plane section of the circle of radius r / cos α, α the half angle.
#[test]
fn curvatures_of_a_cone() {
    let (radii, height) = ([2.0, 0.5], 3.0);
    let cone = Surface::cone(radii, height, FULL).unwrap();
    let cos = height / libm::hypot(height, radii[1] - radii[0]);
    for (s, t) in INNER {
        let r = radii[0] + t * (radii[1] - radii[0]);
        assert_curvatures(&cone, s, t, [0.0, -cos / r]);
    }
}

/// −1/r along the tube's circle, −cos φ / (R + r cos φ) round the axis.
#[test]
fn curvatures_of_a_torus() {
    let (major, minor) = (2.0, 0.5);
    let torus = Surface::torus([major, minor], FULL, FULL).unwrap();
    for (s, t) in INNER {
        let cos = libm::cos(TAU * t);
        assert_curvatures(&torus, s, t, [-cos / (major + minor * cos), -1.0 / minor]);
    }
}

/// Enneper's surface is minimal with κ = ± 2/(1 + u² + v²)², along its parameter lines.
#[test]
fn curvatures_of_enneper_s_surface() {
    let surface = Surface::from(enneper_patch());
    for (s, t) in INNER {
        let (u, w) = (2.0 * s - 1.0, 2.0 * t - 1.0);
        assert!(surface.jet(s, t).point.distance(enneper(u, w)) < 1e-14);
        let kappa = 2.0 / (1.0 + u * u + w * w).powi(2);
        assert_curvatures(&surface, s, t, [kappa, -kappa]);
    }
}

/// A line beside the axis sweeps the hyperboloid x² + y² − z² = 1, with K = −1/(x² + y² + z²)².
#[test]
fn curvature_of_a_hyperboloid_of_revolution() {
    let line = Curve::polyline(vec![v(1.0, -1.0, -1.0), v(1.0, 1.0, 1.0)]).unwrap();
    let surface = Surface::revolution(line, Z_AXIS, FULL).unwrap();
    for (s, t) in INNER {
        let jet = surface.jet(s, t);
        let p = jet.point;
        assert!((p.x * p.x + p.y * p.y - p.z * p.z - 1.0).abs() < 1e-14);
        let curvature = jet.curvature().unwrap();
        assert!((curvature.gaussian + 1.0 / p.length_squared().powi(2)).abs() < 1e-13);
    }
}

/// A ladder: the mean curvature of a catenoid is 0, that of the turned spline through points of cosh falls with their distance squared.
#[test]
fn a_catenoid_from_ever_more_points() {
    let mean = |n: i32| {
        let points = (0..=n).map(|i| f64::from(2 * i - n) / f64::from(n)).map(|z| v(libm::cosh(z), 0.0, z)).collect();
        let surface = Surface::revolution(Curve::through(points).unwrap(), Z_AXIS, FULL).unwrap();
        (0..=40)
            .map(|k| surface.jet(0.1, 0.25 + f64::from(k) / 80.0).curvature().unwrap().mean.abs())
            .fold(0.0, f64::max)
    };
    let errors = [20, 40, 80, 160].map(mean);
    assert!(errors[3] < 2e-5, "{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[1] < 0.3 * pair[0]), "{errors:?}");
}

#[test]
fn a_rational_profile_turned_is_a_sphere() {
    let surface = Surface::revolution(half_circle(2.0), Z_AXIS, FULL).unwrap();
    for (s, t) in INNER {
        let (jet, normal) = surface.jet_and_normal(s, t);
        assert!((jet.point.length() - 2.0).abs() < 1e-15);
        assert!(normal.unwrap().distance(jet.point / 2.0) < 1e-14);
        assert_curvatures(&surface, s, t, [-0.5; 2]);
    }
    assert_eq!((surface.closes(), surface.poles()), ([true, false], [false, false, true, true]));
    assert_eq!((surface.normal(0.3, 0.0), surface.normal(0.8, 1.0)), (Some(-DVec3::Z), Some(DVec3::Z)));
}

#[test]
fn normals_at_the_poles_of_a_sphere_are_limits() {
    let sphere = Surface::sphere(3.0, FULL, [-90.0, 90.0]).unwrap();
    for s in [0.0, 0.4, 1.0] {
        assert_eq!((sphere.normal(s, 0.0), sphere.normal(s, 1.0)), (Some(-DVec3::Z), Some(DVec3::Z)));
        assert_eq!(sphere.jet(s, 1.0).point, 3.0 * DVec3::Z);
    }
    assert_eq!(sphere.poles(), [false, false, true, true]);
}

#[test]
fn the_apex_of_a_cone_has_no_normal() {
    for (radii, t) in [([1.0, 0.0], 1.0), ([0.0, 1.0], 0.0)] {
        let cone = Surface::cone(radii, 2.0, FULL).unwrap();
        assert_eq!(cone.normal(0.3, t), None);
        assert_eq!(cone.jet(0.3, t).curvature(), None);
        assert!(cone.normal(0.3, 0.5).is_some());
    }
    let line = Curve::polyline(vec![v(1.0, 0.0, 0.0), v(0.0, 0.0, 2.0)]).unwrap();
    let cone = Surface::revolution(line, Z_AXIS, FULL).unwrap();
    assert_eq!((cone.poles(), cone.normal(0.3, 1.0)), ([false, false, false, true], None));
}

#[test]
fn seams_have_the_same_bits_on_both_sides() {
    for (surface, closes) in [
        (Surface::cylinder_part(1.7, 2.0, [17.3, 377.3]).unwrap(), [true, false]),
        (Surface::sphere(1.7, FULL, [-90.0, 90.0]).unwrap(), [true, false]),
        (Surface::torus([2.0, 0.7], FULL, [-11.0, 349.0]).unwrap(), [true, true]),
        (Surface::cylinder_part(1.7, 2.0, [0.0, 359.0]).unwrap(), [false, false]),
    ] {
        assert_eq!(surface.closes(), closes);
        for (s, t) in INNER {
            assert_eq!(surface.jet(0.0, t) == surface.jet(1.0, t), closes[0]);
            assert_eq!(surface.jet(s, 0.0) == surface.jet(s, 1.0), closes[1]);
        }
    }
}

/// The metric of the development is that of the surface, and it is not mirrored.
#[test]
fn developments_keep_lengths_and_angles() {
    for (name, surface) in surfaces() {
        for (s, t) in INNER {
            let Some(_) = surface.development(s, t) else { continue };
            assert!(surface.is_developable());
            let (jet, h) = (surface.jet(s, t), 1e-4);
            let at = |ds: f64, dt: f64| surface.development(s + ds, t + dt).unwrap();
            // Differences of fourth order.
            let slope = |x: DVec2| {
                let by = |k: f64| at(k * h * x.x, k * h * x.y);
                (8.0 * (by(1.0) - by(-1.0)) - (by(2.0) - by(-2.0))) / (12.0 * h)
            };
            let [d_s, d_t] = [slope(DVec2::X), slope(DVec2::Y)];
            let scale = jet.s.length().max(jet.t.length()).powi(2);
            for (flat, curved) in [
                (d_s.dot(d_s), jet.s.dot(jet.s)),
                (d_s.dot(d_t), jet.s.dot(jet.t)),
                (d_t.dot(d_t), jet.t.dot(jet.t)),
                (d_s.perp_dot(d_t), jet.s.cross(jet.t).length()),
            ] {
                assert!((flat - curved).abs() < 1e-10 * scale, "{name} at ({s}, {t}): {flat}, not {curved}");
            }
        }
    }
    assert!(!Surface::sphere(1.0, FULL, [-90.0, 90.0]).unwrap().is_developable());
}

#[test]
fn a_cone_that_is_almost_a_cylinder_unrolls_like_one() {
    let [cylinder, cone] = [[1.0, 1.0], [1.0, 1.0 + 1e-13]].map(|radii| Surface::cone(radii, 2.0, FULL).unwrap());
    for (s, t) in INNER {
        let [a, b] = [&cylinder, &cone].map(|surface| surface.development(s, t).unwrap());
        assert!(a.distance(b) < 2e-12, "{a} {b}");
        assert!(a.distance(DVec2::new((s - 0.5) * TAU, 2.0 * t)) < 1e-15);
    }
}

fn at(s: f64, t: f64) -> DVec2 {
    DVec2::new(s, t)
}

#[test]
fn geodesics_of_developable_surfaces() {
    let cylinder = Surface::cylinder(2.0, 3.0);
    // A helix: a quarter round and up.
    let helix = cylinder.geodesic(at(0.1, 0.0), at(0.35, 1.0)).unwrap();
    assert!((helix - libm::hypot(PI, 3.0)).abs() < 1e-14);
    let plane = Surface::plane(v(1.0, 1.0, 1.0), [v(3.0, 0.0, 0.0), v(0.0, 0.0, 4.0)]);
    assert!((plane.geodesic(at(0.0, 0.0), at(1.0, 1.0)).unwrap() - 5.0).abs() < 1e-15);
    // The half angle is 30°, so a full cone of slant height 2 unrolls to half a disc: a right angle between a quarter and three quarters.
    let cone = Surface::cone([1.0, 0.0], 3.0_f64.sqrt(), FULL).unwrap();
    let chord = cone.geodesic(at(0.25, 0.0), at(0.75, 0.0)).unwrap();
    assert!((chord - 8.0_f64.sqrt()).abs() < 1e-14, "{chord}");
    // The same way passes a frustum's upper rim only if that is high enough: the line is √2 from the apex, at radius √2/2.
    for (upper, there) in [(0.7, true), (0.71, false)] {
        let frustum = Surface::cone([1.0, upper], 3.0_f64.sqrt() * (1.0 - upper), FULL).unwrap();
        assert_eq!(frustum.geodesic(at(0.25, 0.0), at(0.75, 0.0)).is_some(), there, "{upper}");
        assert!(frustum.geodesic(at(0.25, 0.0), at(0.25, 1.0)).is_some());
    }
    // A blunt cone unrolls to more than half a disc: the other way round the apex is shorter.
    let blunt = Surface::cone([1.0, 0.0], 0.1, FULL).unwrap();
    assert_eq!(blunt.geodesic(at(0.05, 0.0), at(0.95, 0.0)), None);
    assert!(blunt.geodesic(at(0.05, 0.0), at(0.45, 0.0)).is_some());
}

#[test]
fn geodesics_of_extrusions_follow_the_profile() {
    let along = v(0.0, 0.0, 2.0);
    // A quarter circle of radius 3, and the same tilted.
    let controls = vec![v(3.0, 0.0, 0.0), v(3.0, 3.0, 0.0), v(0.0, 3.0, 0.0)];
    let weights = Some(vec![1.0, 0.5_f64.sqrt(), 1.0]);
    let quarter = Curve::new(Basis::bernstein(3).unwrap(), controls.clone(), weights.clone()).unwrap();
    let surface = Surface::extrusion(quarter, along).unwrap();
    let length = surface.geodesic(at(0.0, 0.0), at(1.0, 1.0)).unwrap();
    assert!((length / libm::hypot(3.0 * FRAC_PI_2, 2.0) - 1.0).abs() < 1e-14);
    let tilted = controls.iter().map(|p| p + v(0.0, 0.0, p.y)).collect();
    let tilted = Curve::new(Basis::bernstein(3).unwrap(), tilted, weights).unwrap();
    let surface = Surface::extrusion(tilted, along).unwrap();
    assert_eq!(surface.geodesic(at(0.0, 0.0), at(1.0, 1.0)), None);
    assert!((surface.development(1.0, 0.0).unwrap() - DVec2::new(3.0 * FRAC_PI_2, 3.0)).length() < 1e-13);
}

#[test]
fn geodesics_of_spheres_are_great_circles_that_stay_in_the_sheet() {
    let r = 2.0;
    let sphere = Surface::sphere(r, FULL, [-90.0, 90.0]).unwrap();
    let near = |found: Option<f64>, angle: f64| assert!((found.unwrap() - r * angle).abs() < 1e-14, "{found:?}");
    near(sphere.geodesic(at(0.1, 0.5), at(0.35, 0.5)), FRAC_PI_2);
    near(sphere.geodesic(at(0.1, 0.0), at(0.9, 1.0)), PI);
    near(sphere.geodesic(at(0.1, 1.0), at(0.9, 0.5)), FRAC_PI_2);
    near(sphere.geodesic(at(0.3, 0.3), at(0.3, 0.3)), 0.0);
    near(sphere.geodesic(at(0.0, 0.75), at(0.5, 0.75)), FRAC_PI_2);
    // Across the seam.
    assert_eq!(sphere.geodesic(at(0.1, 0.5), at(0.9, 0.5)), None);
    // Over the northern border of a part: the great circle between places at 45° north, a quarter apart, is at 54.7° in the middle.
    for (north, there) in [(54.0, false), (55.0, true)] {
        let part = Surface::sphere(r, [0.0, 90.0], [-45.0, north]).unwrap();
        let t = 90.0 / (north + 45.0);
        let found = part.geodesic(at(0.0, t), at(1.0, t));
        assert_eq!(found.is_some(), there);
        found.into_iter().for_each(|length| near(Some(length), PI / 3.0));
    }
    // Along the equator that is a border.
    let north = Surface::sphere(r, [0.0, 90.0], [0.0, 50.0]).unwrap();
    near(north.geodesic(at(0.0, 0.0), at(1.0, 0.0)), FRAC_PI_2);
    assert_eq!(Surface::torus([2.0, 1.0], FULL, FULL).unwrap().geodesic(at(0.0, 0.0), at(0.1, 0.1)), None);
}

#[test]
fn meshes_of_closed_surfaces_are_closed() {
    let volume = |surface: &Surface, cells: [usize; 2]| {
        let mesh = surface.mesh(cells).unwrap();
        Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap().volume(mesh.points())
    };
    let sphere = Surface::sphere(1.0, FULL, [-90.0, 90.0]).unwrap();
    // Positive: wound outwards. The error falls with the square of the cells' size.
    let errors = [16, 32, 64].map(|n| 4.0 / 3.0 * PI - volume(&sphere, [2 * n, n]));
    assert!(
        errors[2] > 0.0 && errors[2] < 0.01 && errors.windows(2).all(|pair| pair[1] < 0.26 * pair[0]),
        "{errors:?}"
    );
    let turned = Surface::revolution(half_circle(1.0), Z_AXIS, FULL).unwrap();
    assert!((volume(&turned, [64, 32]) / (4.0 / 3.0 * PI) - 1.0).abs() < 0.01);
    let torus = Surface::torus([2.0, 0.5], FULL, FULL).unwrap();
    assert!((volume(&torus, [96, 96]) / (2.0 * PI * PI * 2.0 * 0.25) - 1.0).abs() < 0.01);
    assert!(volume(&torus.flipped(), [9, 7]) < 0.0);
    let mesh = sphere.mesh([8, 4]).unwrap();
    assert_eq!((mesh.points().len(), mesh.faces().len()), (2 + 3 * 8, 32));
    let mesh = Surface::cylinder(1.0, 1.0).mesh([5, 2]).unwrap();
    assert_eq!((mesh.points().len(), mesh.faces().len()), (15, 10));
}

#[test]
fn placed_surfaces_are_moved_rigidly() {
    let torus = Surface::torus([2.0, 0.5], FULL, FULL).unwrap();
    let (origin, z, x) = (v(5.0, -3.0, 2.0), v(0.0, 3.0, 4.0), v(2.0, 1.0, 0.0));
    let placed = torus.clone().placed(origin, z, x).unwrap();
    let z = z.normalize();
    let x = (x - x.dot(z) * z).normalize();
    for (s, t) in INNER {
        let (jet, p) = (torus.jet(s, t), torus.jet(s, t).point);
        let expected = origin + p.x * x + p.y * z.cross(x) + p.z * z;
        assert!(placed.jet(s, t).point.distance(expected) < 1e-14);
        let curvature = placed.jet(s, t).curvature().unwrap();
        assert!((curvature.gaussian - jet.curvature().unwrap().gaussian).abs() < 1e-13);
    }
    // Twice is one after the other.
    let twice = Surface::cylinder(1.0, 1.0).placed(DVec3::X, DVec3::X, DVec3::Y).unwrap();
    let twice = twice.placed(DVec3::Y, DVec3::X, DVec3::Y).unwrap();
    // (cos, sin, z) → (z + 1, cos, sin) → (sin, z + 1, cos) + Y
    assert!(twice.jet(0.25, 0.5).point.distance(v(1.0, 2.5, 0.0)) < 1e-15);
}

#[test]
fn sizes_that_make_no_surface() {
    let size = |result: Result<Surface, SurfaceError>, words: &str| {
        let error = result.unwrap_err();
        assert!(matches!(error, SurfaceError::Size { .. }), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-200] {
        size(Surface::cylinder_part(bad, 1.0, FULL), "the radius is");
        size(Surface::cylinder_part(1.0, bad, FULL), "the height is");
        size(Surface::sphere(bad, FULL, [-90.0, 90.0]), "the radius is");
        size(Surface::torus([bad, 1.0], FULL, FULL), "the major radius is");
        size(Surface::torus([2.0, bad], FULL, FULL), "the minor radius is");
        if bad != 0.0 {
            size(Surface::cone([1.0, bad], 1.0, FULL), "the radius at the top is");
        }
    }
    size(Surface::cone([0.0, 0.0], 1.0, FULL), "the radius at the base is 0");
    assert!(matches!(Surface::torus([1.0, 1.0], FULL, FULL), Err(SurfaceError::Tube { .. })));
}

#[test]
fn angles_that_make_no_surface() {
    for angles in [[0.0, 0.0], [90.0, 0.0], [0.0, 361.0], [f64::NAN, 90.0]] {
        let error = Surface::cylinder_part(1.0, 1.0, angles).unwrap_err();
        assert!(matches!(error, SurfaceError::Angles { what: "angles", .. }));
        let error = Surface::torus([2.0, 1.0], FULL, angles).unwrap_err();
        assert!(matches!(error, SurfaceError::Angles { what: "tube", .. }));
    }
    for latitudes in [[-91.0, 0.0], [0.0, 91.0], [10.0, 10.0], [0.0, f64::NAN]] {
        assert!(matches!(Surface::sphere(1.0, FULL, latitudes), Err(SurfaceError::Latitudes { .. })));
    }
}

#[test]
fn surfaces_without_area_are_refused() {
    let line = || Curve::polyline(vec![DVec3::ZERO, 2.0 * DVec3::Z]).unwrap();
    for result in [
        Surface::parallelogram(DVec3::ZERO, [DVec3::X, 2.0 * DVec3::X]),
        Surface::extrusion(line(), DVec3::Z),
        Surface::revolution(line(), Z_AXIS, FULL),
        Patch::new([Basis::bernstein(4).unwrap(), Basis::bernstein(3).unwrap()], vec![DVec3::ONE; 12], None)
            .map(Surface::from),
        Patch::through([4, 5], &grid(4, 5, |s, t| (s + t * t) * v(1.0, 2.0, 3.0)), Smoothness::Bicubic)
            .map(Surface::from),
        Patch::through([4, 5], &grid(4, 5, |s, _| v(s, s * s, 1.0)), Smoothness::Bicubic).map(Surface::from),
    ] {
        let error = result.unwrap_err();
        assert!(matches!(error, SurfaceError::Flat { .. } | SurfaceError::Size { .. }), "{error}");
    }
    // A disc is not one of these: its profile only begins on the axis.
    let disc = Curve::polyline(vec![DVec3::ZERO, DVec3::X]).unwrap();
    let disc = Surface::revolution(disc, Z_AXIS, FULL).unwrap();
    assert_eq!(disc.normal(0.2, 0.0), Some(-DVec3::Z));
    assert!(disc.normal(0.2, 0.5).unwrap().distance(-DVec3::Z) < 1e-15);
}

#[test]
fn directions_that_are_none() {
    let cylinder = || Surface::cylinder(1.0, 1.0);
    for bad in [DVec3::ZERO, DVec3::NAN, v(f64::INFINITY, 0.0, 0.0)] {
        assert!(matches!(
            cylinder().placed(DVec3::ZERO, bad, DVec3::X),
            Err(SurfaceError::NoDirection { what: "z", .. })
        ));
        assert!(matches!(
            cylinder().placed(DVec3::ZERO, DVec3::X, bad),
            Err(SurfaceError::NoDirection { what: "x", .. })
        ));
        assert!(Surface::extrusion(wave(), bad).is_err());
        assert!(Surface::revolution(wave(), [DVec3::ZERO, bad], FULL).is_err());
    }
    assert_eq!(cylinder().placed(DVec3::ZERO, DVec3::X, -2.0 * DVec3::X), Err(SurfaceError::Parallel));
    assert!(cylinder().placed(DVec3::NAN, DVec3::X, DVec3::Y).is_err());
    assert!(Surface::revolution(wave(), [DVec3::NAN, DVec3::X], FULL).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// The straight line of the development is at least as long as the chord in space and no longer than a polyline on the surface.
    #[test]
    fn geodesics_are_between_the_chord_and_the_parameter_line(
        a in (0.0..1.0, 0.0..1.0), b in (0.0..1.0, 0.0..1.0), kind in 0_usize..14
    ) {
        let (name, surface) = surfaces().swap_remove(kind);
        let [a, b] = [a, b].map(|(s, t)| at(s, t));
        if let Some(length) = surface.geodesic(a, b) {
            let points: Vec<DVec3> = (0..=400)
                .map(|k| a.lerp(b, f64::from(k) / 400.0))
                .map(|x| surface.jet(x.x, x.y).point)
                .collect();
            let line: f64 = points.windows(2).map(|ends| ends[0].distance(ends[1])).sum();
            prop_assert!(length >= points[0].distance(points[400]) - 1e-12, "{name}");
            // Chords of the parameter line are shorter than it is, by less than this.
            prop_assert!(length <= line * (1.0 + 1e-4) + 1e-12, "{name}: {length} {line}");
        }
    }
}
