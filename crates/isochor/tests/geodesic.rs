//! Lengths of geodesics against closed forms, and against the geodesic equation, integrated.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, DVec3};
use isochor::Surface;

const FAR: f64 = 1e-6;

fn length(surface: &Surface, a: DVec2, b: DVec2) -> f64 {
    let geodesic = surface.geodesic_length(a, b).unwrap();
    assert!(geodesic.error <= FAR, "{a} to {b}: {}", geodesic.error);
    geodesic.length
}

/// The ways from the middle of the square, in eight directions, of a ladder of sizes.
fn ways() -> impl Iterator<Item = [DVec2; 2]> {
    let directions = (0..8).map(|k| DVec2::from_angle(TAU * (f64::from(k) + 0.3) / 8.0));
    directions.flat_map(|d| [0.01, 0.03, 0.1, 0.2, 0.4].map(|size| [0.5 - 0.5 * size * d, 0.5 + 0.5 * size * d]))
}

#[test]
fn on_a_sphere_they_are_great_circles() {
    let sphere = Surface::sphere(3.0, [0.0, 120.0], [-60.0, 60.0]).unwrap();
    for [a, b] in ways() {
        let [p, q] = [a, b].map(|at| sphere.jet(at.x, at.y).point);
        let exact = 3.0 * p.cross(q).length().atan2(p.dot(q));
        assert!((length(&sphere, a, b) / exact - 1.0).abs() < FAR, "{a} {b}");
    }
}

#[test]
fn on_cylinders_and_cones_they_are_straight_in_the_development() {
    for cone in [Surface::cylinder(2.0, 3.0), Surface::cone([2.0, 0.5], 1.0, [0.0, 300.0]).unwrap()] {
        for [a, b] in ways() {
            let [p, q] = [a, b].map(|at| cone.development(at.x, at.y).unwrap());
            let off = length(&cone, a, b) / p.distance(q) - 1.0;
            assert!(off.abs() < FAR, "{a} to {b}: {off:.2e}");
        }
    }
}

/// On a torus with radii R and r, u along the axis and v round the tube: `u'' = 2 r sin v/(R + r cos v) u' v'` and
/// `v'' = −(R + r cos v) sin v/r u'²`.
#[test]
fn on_a_torus_they_solve_the_geodesic_equation() {
    const STEPS: usize = 4000;
    let [big, small] = [2.0, 0.7];
    let torus = Surface::torus([big, small], [0.0, 90.0], [-45.0, 135.0]).unwrap();
    let rate = |[_, v, du, dv]: [f64; 4]| {
        let out = big + small * v.cos();
        [du, dv, 2.0 * small * v.sin() / out * du * dv, -out * v.sin() / small * du * du]
    };
    let parameters =
        |[u, v, ..]: [f64; 4]| DVec2::new(u / FRAC_PI_2, (v + 0.25 * std::f64::consts::PI) / std::f64::consts::PI);
    for k in 0..7 {
        let (sin, cos) = (0.9 * f64::from(k)).sin_cos();
        let start = [0.8, 0.6, cos / (big + small * 0.6_f64.cos()), sin / small];
        for wanted in [0.05, 0.2, 0.6, 1.2] {
            let h = wanted / STEPS as f64;
            let mut x = start;
            for _ in 0..STEPS {
                let on = |r: [f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * r[i]);
                let r0 = rate(x);
                let r1 = rate(on(r0, 0.5 * h));
                let r2 = rate(on(r1, 0.5 * h));
                let r3 = rate(on(r2, h));
                x = std::array::from_fn(|i| x[i] + h / 6.0 * (r0[i] + 2.0 * r1[i] + 2.0 * r2[i] + r3[i]));
            }
            let found = length(&torus, parameters(start), parameters(x));
            assert!((found / wanted - 1.0).abs() < FAR, "{k}: {found} for {wanted}");
        }
    }
}

#[test]
fn both_directions_are_as_long() {
    let torus = Surface::torus([2.0, 0.7], [0.0, 90.0], [0.0, 90.0]).unwrap();
    for [a, b] in ways() {
        assert!((length(&torus, a, b) / length(&torus, b, a) - 1.0).abs() < FAR);
    }
}

#[test]
fn they_go_the_way_round_that_parameters_go() {
    let cylinder = Surface::cylinder(1.0, 1.0);
    for turns in [0.5, 0.75, 1.0] {
        let found = length(&cylinder, DVec2::new(0.0, 0.2), DVec2::new(turns, 0.7));
        assert!((found / (TAU * turns).hypot(0.5) - 1.0).abs() < FAR, "{turns}: {found}");
    }
}

#[test]
fn in_a_plane_they_are_exact() {
    let plane = Surface::plane(DVec3::ONE, [DVec3::new(1.0, 2.0, 0.5), DVec3::new(-1.0, 1.0, 3.0)]);
    let [a, b] = [DVec2::new(0.1, 0.9), DVec2::new(0.7, 0.2)];
    let [p, q] = [a, b].map(|at| plane.jet(at.x, at.y).point);
    assert!((length(&plane, a, b) - p.distance(q)).abs() < 1e-14);
}

#[test]
fn from_a_point_to_itself_there_is_no_way_to_go() {
    let sphere = Surface::sphere(3.0, [0.0, 120.0], [-60.0, 60.0]).unwrap();
    assert_eq!(length(&sphere, DVec2::splat(0.3), DVec2::splat(0.3)), 0.0);
}

#[test]
fn from_a_pole_there_is_no_tangent_to_start_with() {
    let ball = Surface::sphere(1.0, [0.0, 360.0], [-90.0, 90.0]).unwrap();
    assert_eq!(ball.geodesic_length(DVec2::new(0.2, 0.0), DVec2::new(0.2, 0.1)), None);
}
