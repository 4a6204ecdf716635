//! Cameras: where known points appear, and that what should be framed is framed.

use glam::DVec3;
use isochor::{Axis, shapes};
use isochor_view::{Camera, View};

const SIZE: [f64; 2] = [640.0, 480.0];

/// Half the field of view across the shorter side.
const HALF_FIELD: f64 = 12.0;

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

fn inside(camera: &Camera, points: &[DVec3], size: [f64; 2]) {
    for p in points.iter().filter(|p| p.is_finite()) {
        let [x, y] = camera.projected(*p, size).unwrap();
        assert!((0.0..=size[0]).contains(&x) && (0.0..=size[1]).contains(&y), "{p} is at {x}, {y}");
    }
}

#[test]
fn a_point_is_where_perspective_puts_it() {
    // From (0, −10, 0) along +y: x to the right, z up, both divided by the distance.
    let camera = Camera::looking(DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO, DVec3::Z);
    let scale = 240.0 / HALF_FIELD.to_radians().tan();
    for p in [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.5), DVec3::new(-2.0, 5.0, 1.0), DVec3::new(0.3, -9.0, -0.1)] {
        let depth = p.y + 10.0;
        let expected = [320.0 + p.x / depth * scale, 240.0 - p.z / depth * scale];
        assert!(distance(camera.projected(p, SIZE).unwrap(), expected) < 1e-9, "{p}");
    }
    assert_eq!(camera.projected(DVec3::new(0.0, -11.0, 0.0), SIZE), None);
    assert_eq!(camera.projected(DVec3::new(5.0, -10.0, 0.0), SIZE), None);
    assert_eq!(camera.projected(DVec3::NAN, SIZE), None);
}

#[test]
fn a_framed_model_reaches_the_border_and_no_farther() {
    let mesh = shapes::uv_torus(1.0, 0.4, 48, 24);
    for size in [SIZE, [480.0, 640.0], [500.0, 500.0], [1000.0, 100.0]] {
        for (azimuth, elevation) in [(-60.0, 22.0), (0.0, 0.0), (30.0, 90.0), (200.0, -90.0), (10.0, 45.0)] {
            let view = View { azimuth, elevation, up: Axis::Z };
            let camera = Camera::framing(&[mesh.points()], &view, size);
            inside(&camera, mesh.points(), size);
            let places: Vec<_> = mesh.points().iter().map(|p| camera.projected(*p, size).unwrap()).collect();
            // 3 % of half of a side are free at either end of the tighter direction, and both ends have the same room.
            let room = |axis: usize| {
                let low = places.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
                let high = places.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
                [low / size[axis], (size[axis] - high) / size[axis]]
            };
            let tight = if room(0)[0] < room(1)[0] { room(0) } else { room(1) };
            assert!(tight.iter().all(|free| (free - 0.015).abs() < 1e-9), "{size:?} {azimuth} {elevation}: {tight:?}");
        }
    }
}

#[test]
fn all_poses_are_framed_by_one_camera() {
    let rest = shapes::icosphere(2);
    let moved: Vec<DVec3> = rest.points().iter().map(|p| *p * 0.5 + DVec3::new(4.0, -1.0, 2.0)).collect();
    let camera = Camera::framing(&[rest.points(), &moved], &View::default(), SIZE);
    inside(&camera, rest.points(), SIZE);
    inside(&camera, &moved, SIZE);
}

#[test]
fn places_do_not_depend_on_size_and_place_of_the_model() {
    let mesh = shapes::eared_ball(2);
    let camera = Camera::framing(&[mesh.points()], &View::default(), SIZE);
    for (scale, shift, tolerance) in [
        (1e-30, DVec3::ZERO, 1e-9),
        (1e30, DVec3::ZERO, 1e-9),
        (1e-300, DVec3::ZERO, 1e-9),
        (1e300, DVec3::ZERO, 1e-9),
        // A million extents away coordinates have 10 digits left.
        (1.0, DVec3::new(1e6, -2e6, 3e6), 1e-5),
    ] {
        let points: Vec<DVec3> = mesh.points().iter().map(|p| *p * scale + shift).collect();
        let other = Camera::framing(&[&points], &View::default(), SIZE);
        for (p, q) in mesh.points().iter().zip(&points) {
            let [a, b] = [camera.projected(*p, SIZE).unwrap(), other.projected(*q, SIZE).unwrap()];
            assert!(distance(a, b) < tolerance, "{scale} {shift}: {a:?} {b:?}");
        }
    }
}

#[test]
fn upwards_is_upwards_whatever_axis_it_is() {
    for (up, axis) in [(Axis::X, DVec3::X), (Axis::Y, DVec3::Y), (Axis::Z, DVec3::Z)] {
        let camera = Camera::framing(&[&[-DVec3::ONE, DVec3::ONE]], &View { up, ..View::default() }, SIZE);
        let [low, high] = [-axis, axis].map(|p| camera.projected(p * 0.5, SIZE).unwrap());
        assert!((low[0] - high[0]).abs() < 60.0 && low[1] - high[1] > 60.0, "{up:?}: {low:?} {high:?}");
    }
}

#[test]
fn one_point_is_in_the_middle() {
    for p in [DVec3::ZERO, DVec3::splat(1e6), DVec3::splat(-1e300), DVec3::splat(1e-320)] {
        let camera = Camera::framing(&[&[p, p]], &View::default(), SIZE);
        assert!(distance(camera.projected(p, SIZE).unwrap(), [320.0, 240.0]) < 1e-9, "{p}");
    }
}

#[test]
fn flat_models_and_needles_are_framed_from_everywhere() {
    let flat: Vec<DVec3> = (0..100).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10), 0.0)).collect();
    for direction in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(0.46, -0.8, 0.37)] {
        let needle: Vec<DVec3> = (0..10).map(|i| direction * f64::from(i)).collect();
        for (azimuth, elevation) in [(-60.0, 22.0), (0.0, 0.0), (90.0, 0.0), (0.0, 90.0)] {
            let view = View { azimuth, elevation, up: Axis::Z };
            inside(&Camera::framing(&[&flat], &view, SIZE), &flat, SIZE);
            inside(&Camera::framing(&[&needle], &view, SIZE), &needle, SIZE);
        }
    }
}

#[test]
fn points_that_are_not_finite_do_not_count() {
    let sound = [DVec3::ZERO, DVec3::ONE, DVec3::new(0.5, 0.0, 2.0)];
    let mut points = sound.to_vec();
    points.extend([DVec3::NAN, DVec3::new(f64::INFINITY, 0.0, 0.0), DVec3::new(0.0, f64::NAN, 9.0)]);
    let framing = |points: &[DVec3]| Camera::framing(&[points], &View::default(), SIZE);
    assert_eq!(framing(&points), framing(&sound));
    // Nothing at all, and nothing finite.
    assert!(framing(&[]).projected(DVec3::ZERO, SIZE).is_some());
    assert_eq!(framing(&[DVec3::NAN]), framing(&[]));
}

#[test]
fn the_largest_coordinates_are_framed() {
    let points = [DVec3::splat(f64::MAX), DVec3::splat(f64::MIN), DVec3::ZERO];
    inside(&Camera::framing(&[&points], &View::default(), SIZE), &points, SIZE);
}

#[test]
fn a_view_that_is_no_number_is_some_view() {
    let view = View { azimuth: f64::NAN, elevation: f64::INFINITY, up: Axis::Z };
    inside(&Camera::framing(&[shapes::cube(1).points()], &view, SIZE), shapes::cube(1).points(), SIZE);
}

#[test]
fn looking_nowhere_looks_somewhere() {
    for (eye, at, up) in
        [(DVec3::ONE, DVec3::ONE, DVec3::Z), (DVec3::ZERO, DVec3::Z, DVec3::Z), (DVec3::ZERO, DVec3::X, DVec3::ZERO)]
    {
        let camera = Camera::looking(eye, at, up);
        let seen = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|d| [eye + d, eye - d]);
        assert!(seen.filter_map(|p| camera.projected(p, SIZE)).count() >= 1, "{eye} {at} {up}");
    }
}
