//! Models along surfaces: closed forms on planes and cylinders.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec2, DVec3};
use isochor::{OpenBoundaries, Placement, Sheet, Solid, Surface, Wrap, WrapError, shapes, topology};
use proptest::prelude::*;

/// The sheet of grid points at `flat(s, t)`.
fn sheet(surface: Surface, cells: [usize; 2], flat: impl Fn(f64, f64) -> [f64; 2]) -> Sheet {
    let [m, n] = cells;
    let at = |k: usize| flat((k / (n + 1)) as f64 / m as f64, (k % (n + 1)) as f64 / n as f64).into();
    Sheet::new(surface, cells, (0..(m + 1) * (n + 1)).map(at).collect())
}

/// A part of a cylinder, unrolled: x along the circumference, y up.
fn cylinder(radius: f64, height: f64, degrees: f64, cells: [usize; 2]) -> Sheet {
    let surface = Surface::cylinder_part(radius, height, [0.0, degrees]).unwrap();
    sheet(surface, cells, |s, t| [s * degrees.to_radians() * radius, t * height])
}

/// (x, y, h) rolled on a cylinder.
fn rolled(radius: f64, q: DVec3) -> DVec3 {
    let angle = q.x / radius;
    (radius + q.z) * DVec3::new(angle.cos(), angle.sin(), 0.0) + q.y * DVec3::Z
}

fn unit_plane() -> Surface {
    Surface::plane(DVec3::ZERO, [DVec3::X, DVec3::Y])
}

#[test]
fn on_a_plane_nothing_moves() {
    let places: Vec<DVec3> = shapes::icosphere(3).points().iter().map(|p| 0.5 * *p + DVec3::splat(0.5)).collect();
    let wrap = Wrap::new(&sheet(unit_plane(), [7, 5], |s, t| [s, t])).unwrap();
    let laid = wrap.laid(&places).unwrap();
    assert!(laid.points.iter().zip(&places).all(|(p, q)| p.distance(*q) < 1e-15));
    assert!(laid.jacobians.iter().all(|j| j.abs_diff_eq(DMat3::IDENTITY, 1e-14)));
    assert_eq!(laid.folds, None);
    assert_eq!(laid.points, wrap.points(&places).unwrap());
}

#[test]
fn on_a_cylinder_a_model_is_rolled() {
    let (radius, height) = (2.0, 3.0);
    let wrap = Wrap::new(&cylinder(radius, height, 360.0, [32, 8])).unwrap();
    let places: Vec<DVec3> = (0..2000)
        .map(|k| {
            DVec3::new(
                TAU * radius * (k as f64 / 1999.0),
                height * ((k * 7 % 2000) as f64 / 1999.0),
                (k % 13) as f64 / 10.0 - 0.6,
            )
        })
        .collect();
    let laid = wrap.laid(&places).unwrap();
    let feet = wrap.feet(&places).unwrap();
    for (v, q) in places.iter().enumerate() {
        let expected = rolled(radius, *q);
        assert!(laid.points[v].distance(expected) < 2e-14);
        assert!((feet.feet[v] + feet.offsets[v]).distance(expected) < 2e-14);
        assert!((feet.feet[v].truncate().length() - radius).abs() < 2e-14);
        let angle = q.x / radius;
        let (out, round) = (DVec3::new(angle.cos(), angle.sin(), 0.0), DVec3::new(-angle.sin(), angle.cos(), 0.0));
        let jacobian = DMat3::from_cols((1.0 + q.z / radius) * round, DVec3::Z, out);
        assert!(laid.jacobians[v].abs_diff_eq(jacobian, 1e-13));
    }
    assert_eq!(laid.folds, None);
}

/// The Jacobian matrix against central differences.
fn assert_jacobian(wrap: &Wrap, q: DVec3) {
    let step = 1e-5;
    let jacobian = wrap.laid(&[q]).unwrap().jacobians[0];
    for axis in 0..3 {
        let d = step * DVec3::AXES[axis];
        let ends = wrap.points(&[q + d, q - d]).unwrap();
        assert!(((ends[0] - ends[1]) / (2.0 * step)).distance(jacobian.col(axis)) < 1e-8, "{q} along {axis}");
    }
}

#[test]
fn jacobians_are_those_of_the_map() {
    // Skewed, curved and uneven: what the grid is does not matter, only that the map is what it says.
    let surface = Surface::sphere(1.5, [0.0, 120.0], [-50.0, 60.0]).unwrap();
    let flat = |s: f64, t: f64| [2.0 * s + 0.3 * t + 0.2 * (3.0 * t).sin(), 1.7 * t + 0.2 * s * s];
    let wrap = Wrap::new(&sheet(surface, [6, 5], flat)).unwrap();
    let places = [DVec3::new(1.11, 0.72, 0.1), DVec3::new(0.72, 1.03, -0.2), DVec3::new(1.93, 1.41, 0.0)];
    places.iter().for_each(|q| assert_jacobian(&wrap, *q));
}

#[test]
fn a_plate_on_a_cylinder_has_its_volume_and_its_lengths() {
    let (radius, thickness, width, segments) = (1.0, 0.1, 0.8, 4000);
    for degrees in [360.0f64, 210.0] {
        let angle = degrees.to_radians();
        let plate = shapes::plate(DVec3::new(angle * radius, width, thickness), [segments, 1]);
        let sheet = cylinder(radius, width, degrees, [24, 6]);
        let placed = Placement::default().placed(plate.bounds().unwrap(), &sheet).unwrap();
        let points = Wrap::new(&sheet).unwrap().points(&placed.points(plate.points())).unwrap();
        let solid = Solid::new(&plate, &topology(&plate), OpenBoundaries::Refuse).unwrap();
        let volume = solid.volume(&points);
        // n slices of a regular polygon: ½ n sin(φ/n) ((R + d)² − R²) w, which tends to ½ φ ((R + d)² − R²) w.
        let ring = ((radius + thickness).powi(2) - radius * radius) * width / 2.0;
        let n = segments as f64;
        assert!((volume / (n * (angle / n).sin() * ring) - 1.0).abs() < 1e-12);
        assert!((volume / (angle * ring) - 1.0).abs() < 1e-6);
        // The base keeps its area: circumference times width.
        let at_base = |v: &u32| placed.point(plate.points()[*v as usize]).z.abs() < 1e-12;
        let base = plate.faces().iter().filter(|face| face.iter().all(at_base)).flat_map(isochor::fan);
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| points[v as usize]);
            (b - a).cross(c - a).length() / 2.0
        };
        assert!((base.map(area).sum::<f64>() / (angle * radius * width) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn heights_beyond_the_radius_of_curvature_fold() {
    let wrap = Wrap::new(&cylinder(1.0, 1.0, 180.0, [8, 2])).unwrap();
    let places = [-0.5, -1.0, -1.5, 0.5, -0.999].map(|h| DVec3::new(1.0, 0.5, h));
    let laid = wrap.laid(&places).unwrap();
    // 1 − h κ with κ = −1: 1 + h.
    let folds = laid.folds.unwrap();
    assert_eq!((folds.count, folds.first, folds.worst), (2, 1, 2));
    assert!((folds.factor + 0.5).abs() < 1e-13);
    assert_eq!(laid.unfolded(), Err(WrapError::Folded(folds)));
}

#[test]
fn a_model_turned_over_twice_is_folded_all_the_same() {
    // Beyond the middle of a sphere both factors are negative, and the determinant is positive.
    let surface = Surface::sphere(1.0, [0.0, 90.0], [-40.0, 40.0]).unwrap();
    let wrap = Wrap::new(&sheet(surface, [4, 4], |s, t| [1.5 * s, 1.4 * t])).unwrap();
    let laid = wrap.laid(&[DVec3::new(0.7, 0.7, -2.0)]).unwrap();
    assert!(laid.jacobians[0].determinant() > 0.0);
    assert!((laid.folds.unwrap().factor + 1.0).abs() < 1e-13);
}

#[test]
fn what_is_beyond_the_sheet_is_refused_with_how_far_it_is() {
    let wrap = Wrap::new(&cylinder(1.0, 1.0, 180.0, [8, 2])).unwrap();
    let places = [[0.5, 0.5], [PI + 0.25, 0.5], [PI + 0.3, 1.4], [PI + 1e-10, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.1));
    match wrap.points(&places) {
        Err(WrapError::Beyond { count: 2, vertex: 1, distance, farthest: 2, most }) => {
            assert!((distance - 0.25).abs() < 1e-12 && (most - 0.5).abs() < 1e-12);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_is_beyond_the_sheet_goes_on_along_its_tangents() {
    let sheet = cylinder(1.0, 1.0, 180.0, [8, 2]);
    let places = [[0.5, 0.5, 0.2], [-0.7, 0.5, 0.2], [PI + 5.0, 0.25, -0.1], [1.0, 2.5, 0.3], [-2.0, -1.0, 0.4]]
        .map(DVec3::from_array);
    let wrap = Wrap::covering(&sheet, &places).unwrap();
    let laid = wrap.laid(&places).unwrap();
    // Beyond s = 0 the tangent is −y, beyond s = 1 too; normals are x and −x.
    let expected = [
        rolled(1.0, places[0]),
        DVec3::new(1.2, -0.7, 0.5),
        DVec3::new(-0.9, -5.0, 0.25),
        rolled(1.0, places[3]),
        DVec3::new(1.4, -2.0, -1.0),
    ];
    for (found, expected) in laid.points.iter().zip(expected) {
        assert!(found.distance(expected) < 1e-13, "{found} {expected}");
    }
    let tangent = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
    assert!(laid.jacobians[1].abs_diff_eq(tangent, 1e-13) && laid.jacobians[4].abs_diff_eq(tangent, 1e-13));
    assert_eq!(laid.folds, None);
}

#[test]
fn beyond_the_boundary_jacobians_are_those_of_the_map_too() {
    let surface = Surface::sphere(1.5, [0.0, 120.0], [-50.0, 60.0]).unwrap();
    let sheet = sheet(surface, [6, 5], |s, t| [2.0 * s + 0.3 * t, 1.7 * t + 0.1 * s * s]);
    let places = [[-0.3, 0.7, 0.1], [1.1, -0.4, -0.2], [2.6, 2.3, 0.1], [-0.5, -0.6, 0.2]].map(DVec3::from_array);
    let wide: Vec<DVec3> = places.iter().map(|q| 1.5 * *q).chain(places).collect();
    let wrap = Wrap::covering(&sheet, &wide).unwrap();
    places.iter().for_each(|q| assert_jacobian(&wrap, *q));
}

#[test]
fn at_the_apex_of_a_cone_there_is_no_normal() {
    let surface = Surface::cone([1.0, 0.0], 1.0, [0.0, 180.0]).unwrap();
    let flat = |s: f64, t: f64| {
        let (radius, angle) = ((1.0 - t) * 2f64.sqrt(), s * PI / 2f64.sqrt());
        [radius * angle.sin(), -radius * angle.cos()]
    };
    // The apex is a side of no length of the last row of cells.
    let wrap = Wrap::new(&sheet(surface, [8, 4], flat)).unwrap();
    match wrap.points(&[DVec3::new(0.3, 0.0, 0.1), DVec3::new(0.0, 0.0, 0.1)]) {
        Err(WrapError::NoNormal { count: 1, vertex: 1, parameters }) => assert_eq!(parameters.y, 1.0),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_pole_has_a_place_and_no_derivative() {
    let surface = Surface::sphere(1.0, [0.0, 360.0], [0.0, 90.0]).unwrap();
    let flat = |s: f64, t: f64| {
        let (sin, cos) = (TAU * s).sin_cos();
        [(1.0 - t) * PI / 2.0 * cos, (1.0 - t) * PI / 2.0 * sin]
    };
    let wrap = Wrap::new(&sheet(surface, [16, 4], flat)).unwrap();
    let pole = [DVec3::new(0.0, 0.0, 0.5)];
    assert!(wrap.points(&pole).unwrap()[0].distance(1.5 * DVec3::Z) < 1e-15);
    assert!(matches!(wrap.laid(&pole), Err(WrapError::Singular { count: 1, vertex: 0, .. })));
}

#[test]
fn sheets_that_fold_are_refused() {
    let wrong =
        |flat: &dyn Fn(f64, f64) -> [f64; 2]| Wrap::new(&sheet(unit_plane(), [4, 4], flat)).unwrap_err().to_string();
    assert!(wrong(&|s, t| [-s, t]).contains("16 of its cells are mirrored or not convex, the first is (0, 0)"));
    assert!(wrong(&|s, t| [if s == 0.5 { 0.9 } else { s }, t]).contains("the first is (2, 0)"));
    assert!(wrong(&|s, _| [s, s]).contains("no area"));
    assert!(wrong(&|s, _| [s, f64::NAN]).contains("grid point (0, 0)"));
    // A band that goes round more than once.
    let spiral = |s: f64, t: f64| {
        let (sin, cos) = (3.0 * PI * s).sin_cos();
        [(2.0 - t) * cos, (2.0 - t) * sin]
    };
    let long = Wrap::new(&sheet(unit_plane(), [40, 2], spiral)).unwrap_err();
    assert!(long.to_string().contains("lies over itself"), "{long}");
}

#[test]
fn grid_lines_that_meet_beyond_the_boundary_are_refused() {
    // A ring segment: its inner rim bends inwards, so the lines meet in the middle.
    let flat = |s: f64, t: f64| {
        let (sin, cos) = (PI * s).sin_cos();
        [(2.0 - t) * cos, (2.0 - t) * sin]
    };
    let sheet = sheet(unit_plane(), [20, 2], flat);
    let near = Wrap::covering(&sheet, &[DVec3::new(0.0, 0.7, 0.0)]).unwrap();
    assert!(near.points(&[DVec3::new(0.0, 0.7, 0.0)]).is_ok());
    let far = Wrap::covering(&sheet, &[DVec3::new(0.0, -0.5, 0.0)]).unwrap_err();
    assert!(far.to_string().contains("meet") || far.to_string().contains("over itself"), "{far}");
}

#[test]
fn results_do_not_depend_on_threads() {
    let surface = Surface::torus([2.0, 0.7], [0.0, 300.0], [-100.0, 150.0]).unwrap();
    let sheet = sheet(surface, [12, 9], |s, t| [9.0 * s + t, 3.0 * t + 0.5 * s * s]);
    let ball = shapes::icosphere(5);
    let places: Vec<DVec3> = ball.points().iter().map(|p| *p + DVec3::new(5.0, 1.7, 0.0)).collect();
    let wrap = Wrap::new(&sheet).unwrap();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (wrap.laid(&places).unwrap(), wrap.points(&places).unwrap()))
    };
    assert!(with(1) == with(3));
}

proptest! {
    #[test]
    fn every_place_in_the_sheet_is_found(seed in prop::collection::vec(-0.2f64..0.2, 50), x in 0.0f64..=1.0, y in 0.0f64..=1.0) {
        // A grid of 4 × 4 cells with its inner points shaken, over the unit square of a plane: S is found by the inverse of F alone.
        let flat = |k: usize| {
            let (i, j) = (k / 5, k % 5);
            let is_inner = |k: usize| (1..4).contains(&k);
            let shake = |by: f64, inner: bool| if inner { 0.6 * by } else { 0.0 };
            let inner = is_inner(i) && is_inner(j);
            DVec2::new((i as f64 + shake(seed[2 * k], inner)) / 4.0, (j as f64 + shake(seed[2 * k + 1], inner)) / 4.0)
        };
        let sheet = Sheet::new(unit_plane(), [4, 4], (0..25).map(flat).collect());
        let wrap = Wrap::new(&sheet).unwrap();
        let found = wrap.points(&[DVec3::new(x, y, 0.0)]).unwrap()[0];
        // F(s, t) is the place again.
        let (s, t) = (4.0 * found.x, 4.0 * found.y);
        let (i, j) = ((s as usize).min(3), (t as usize).min(3));
        let (u, v) = (s - i as f64, t - j as f64);
        let at = |i: usize, j: usize| sheet.flat()[5 * i + j];
        let back = (1.0 - u) * ((1.0 - v) * at(i, j) + v * at(i, j + 1)) + u * ((1.0 - v) * at(i + 1, j) + v * at(i + 1, j + 1));
        prop_assert!(back.distance(DVec2::new(x, y)) <= 2e-15);
    }
}
