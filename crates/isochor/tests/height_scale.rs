//! Volumes by a factor of the heights: bodies whose volume is a known polynomial of it.

use glam::DVec3;
use isochor::{HeightScaleError, Mesh, OpenBoundaries, Solid, scaled_heights, shapes, tolerances, topology};

fn solid(mesh: &Mesh) -> Solid {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap()
}

/// What becomes of every point.
fn mapped(mesh: &Mesh, map: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    mesh.points().iter().map(|p| map(*p)).collect()
}

#[test]
fn on_a_plane_the_volume_is_proportional_to_the_heights() {
    let cube = shapes::cube(3);
    let feet = mapped(&cube, |p| DVec3::new(p.x, p.y, 0.0));
    let offsets = mapped(&cube, |p| DVec3::new(0.0, 0.0, p.z));
    let found = scaled_heights(&solid(&cube), &feet, &offsets, 1.3).unwrap();
    assert!((found.scale - 1.3).abs() < 1e-15);
    assert!(found.relative_error <= tolerances::VOLUME);
    assert_eq!(found.volume, solid(&cube).volume(&found.vertices));
}

#[test]
fn on_a_sphere_it_is_the_cube_of_the_radius() {
    // V(λ) = (1 + λ/2)³ V(0)
    let ball = shapes::icosphere(2);
    let body = solid(&ball);
    let offsets = mapped(&ball, |p| 0.5 * p);
    let rest = body.volume(ball.points());
    let found = scaled_heights(&body, ball.points(), &offsets, 3.0 * rest).unwrap();
    assert!((found.scale - 2.0 * (3f64.cbrt() - 1.0)).abs() < 1e-14);
    assert!(found.relative_error <= tolerances::VOLUME);
}

#[test]
fn a_volume_that_is_right_keeps_its_heights() {
    let ball = shapes::icosphere(1);
    let offsets = mapped(&ball, |p| 0.5 * p);
    let vertices: Vec<DVec3> = ball.points().iter().zip(&offsets).map(|(p, d)| *p + *d).collect();
    let found = scaled_heights(&solid(&ball), ball.points(), &offsets, solid(&ball).volume(&vertices)).unwrap();
    assert_eq!((found.scale, found.vertices), (1.0, vertices));
}

#[test]
fn what_is_out_of_reach_is_told_with_what_is_within() {
    // V(λ) = (1 + λ)(1 − λ) = 1 − λ²
    let cube = shapes::cube(2);
    let offsets = mapped(&cube, |p| DVec3::new(p.x, -p.y, 0.0));
    let found = scaled_heights(&solid(&cube), cube.points(), &offsets, 0.75).unwrap();
    assert!((found.scale - 0.5).abs() < 1e-14);
    match scaled_heights(&solid(&cube), cube.points(), &offsets, 2.0) {
        Err(HeightScaleError::Unreachable { low, high, .. }) => {
            assert_eq!(low, f64::NEG_INFINITY);
            assert!((high - 1.0).abs() < 1e-15);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn of_two_factors_the_one_nearer_to_1_is_taken() {
    // V(λ) = λ (2.2 − λ), 1.05 at 0.7 and 1.5
    let cube = shapes::cube(2);
    let feet = mapped(&cube, |p| DVec3::new(0.0, 2.2 * p.y, p.z));
    let offsets = mapped(&cube, |p| DVec3::new(p.x, -p.y, 0.0));
    let found = scaled_heights(&solid(&cube), &feet, &offsets, 1.05).unwrap();
    assert!((found.scale - 0.7).abs() < 1e-14);
}

#[test]
fn heights_of_nothing_change_nothing() {
    let cube = shapes::cube(2);
    let offsets = vec![DVec3::ZERO; cube.points().len()];
    let error = scaled_heights(&solid(&cube), cube.points(), &offsets, 2.0).unwrap_err();
    assert_eq!(error, HeightScaleError::Constant { volume: 1.0, wanted: 2.0 });
    for wanted in [0.0, f64::NAN, f64::INFINITY] {
        let error = scaled_heights(&solid(&cube), cube.points(), &offsets, wanted).unwrap_err();
        assert!(matches!(error, HeightScaleError::Wanted { .. }));
    }
}

#[test]
fn inside_out_bodies_have_negative_volumes() {
    let cube = shapes::cube(2);
    let feet = mapped(&cube, |p| DVec3::new(p.y, p.x, 0.0));
    let offsets = mapped(&cube, |p| DVec3::new(0.0, 0.0, p.z));
    assert!((scaled_heights(&solid(&cube), &feet, &offsets, -0.5).unwrap().scale - 0.5).abs() < 1e-15);
    assert!(matches!(
        scaled_heights(&solid(&cube), &feet, &offsets, 0.5),
        Err(HeightScaleError::Unreachable { high: 0.0, .. })
    ));
}
