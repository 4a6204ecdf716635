//! Jobs whose models go along a surface.
#![cfg(feature = "serde")]

use std::f64::consts::TAU;

use glam::DVec3;
use isochor::{Film, Job, JobError, JobInput, Mesh, Outcome, Source, shapes, stress_angles, topology};

fn run(mesh: &Mesh, toml: &str) -> Result<Outcome, JobError> {
    let input = JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage: None };
    Job::from_toml(toml).unwrap().run(&input, &mut |_| {})
}

fn error(mesh: &Mesh, toml: &str) -> JobError {
    run(mesh, toml).expect_err("the job is impossible")
}

/// A plate of 1.2 × 0.8 × 0.1 of six faces.
fn plate() -> Mesh {
    shapes::plate(DVec3::new(1.2, 0.8, 0.1), [1, 1])
}

const CYLINDER: &str = "[surface]\nkind = 'cylinder'\nradius = 0.5\nheight = 2\ngrid = [48, 8]\n";

#[test]
fn a_plate_on_a_cylinder_has_its_analytic_volume_and_lengths() {
    let outcome = run(&plate(), &format!("{CYLINDER}[preserve]\nvolume = 'free'")).unwrap();
    // The sheet is π × 2, and the plate's middle is on its middle. It is divided at grid lines and ends between them.
    let step = TAU / 48.0;
    let half = 1.2 / 2.0 / 0.5;
    let (first, last) = ((std::f64::consts::PI - half) / step, (std::f64::consts::PI + half) / step);
    let mut angles = vec![first * step];
    angles.extend((first.ceil() as usize..=last.floor() as usize).map(|k| k as f64 * step));
    angles.push(last * step);
    // Between two angles there is a prism over a trapezium with area (r₁² − r₀²) sin(φ)/2.
    let area: f64 = angles.windows(2).map(|pair| (0.36 - 0.25) * (pair[1] - pair[0]).sin() / 2.0).sum();
    let volume = outcome.report.volume.as_ref().unwrap().overall;
    assert!((volume.rest - 0.096).abs() < 1e-15);
    assert!((volume.posed - 0.8 * area).abs() < 1e-6 * area, "{} instead of {}", volume.posed, 0.8 * area);
    let mut found: Vec<f64> = outcome.points.iter().map(|p| p.y.atan2(p.x).rem_euclid(TAU)).collect();
    found.sort_by(f64::total_cmp);
    for (k, angle) in angles.iter().enumerate() {
        assert!((found[4 * k] - angle).abs() < 1e-6 && (found[4 * k + 3] - angle).abs() < 1e-6);
    }
    assert_eq!(found.len(), 4 * angles.len());
    for p in &outcome.points {
        let radius = p.truncate().length();
        assert!((radius - 0.5).abs().min((radius - 0.6).abs()) < 1e-12, "{radius}");
        assert!((p.z - 0.6).abs().min((p.z - 1.4).abs()) < 1e-6, "{}", p.z);
    }
    let surface = outcome.report.surface.unwrap();
    assert_eq!((surface.edge_points, surface.face_points, surface.folds), (4 * (angles.len() - 2), 0, None));
    assert!(surface.flattening.length_error.max < 1e-6);
}

#[test]
fn heights_and_lattices_restore_the_volume_exactly() {
    for (mesh, place) in
        [(plate(), "scale = 1.1, rotate = 20"), (shapes::dolphin(24), "fit = 'inside', scale = 0.8, height = 'middle'")]
    {
        for preserve in [
            "",
            "method = 'height'\nvolume = '103%'",
            "method = 'nearest'",
            "axes = 'xyz'",
            "method = 'gradient'\nvolume = '98%'",
        ] {
            let sheet = "[surface]\nkind = 'bezier'\ngrid = [20, 20]\nfolds = 'refuse'\ncontrols = [[[0,0,0],[0,1,0.2],[0,2,0],[0,3,0.1]],\
                [[1,0,0.6],[1,1,0.8],[1,2,0.6],[1,3,0.5]],[[2,0,0.6],[2,1,0.5],[2,2,0.7],[2,3,0.4]],[[3,0,0],[3,1,0.1],[3,2,0],[3,3,0.2]]]\n";
            let outcome = run(&mesh, &format!("{sheet}place = {{ {place} }}\n[preserve]\n{preserve}")).unwrap();
            let volume = outcome.report.volume.as_ref().unwrap().overall;
            assert!(volume.relative_error.unwrap() <= 1e-13, "{preserve}: {:?}", volume.relative_error);
            assert!((volume.posed / volume.corrected - 1.0).abs() > 1e-4, "{preserve}: there was something to do");
            let (rest, refinement) = outcome.divided().map_or((&mesh, None), |(mesh, r)| (mesh, Some(r)));
            assert_eq!(rest.points().len(), outcome.points.len());
            assert_eq!(rest.points()[..mesh.points().len()], *mesh.points());
            assert_eq!(refinement.is_some(), outcome.points.len() > mesh.points().len());
            let result = rest.with_points(outcome.points.clone()).unwrap();
            assert!(topology(&result).is_closed() && topology(&result).is_balanced());
            // Measured anew, from the result alone.
            let solid = isochor::Solid::new(&result, &topology(&result), isochor::OpenBoundaries::Refuse).unwrap();
            assert!((solid.volume(result.points()) / volume.corrected - 1.0).abs() < 1e-13);
            let jacobians = outcome.jacobians().unwrap();
            assert!(jacobians.iter().all(|j| j.determinant() > 0.0));
            assert_eq!(outcome.course().unwrap().corrected_change.len(), outcome.points.len());
        }
    }
}

#[test]
fn jacobians_are_the_derivatives_of_what_was_done() {
    // Rigid placement on a plane: the turn itself. Upright y goes to z.
    let toml = "[surface]\nkind = 'plane'\nsize = [8, 8]\nplace = { up = 'y', rotate = 90, scale = 2 }\n";
    let outcome = run(&plate(), toml).unwrap();
    let matrix = outcome.jacobians().unwrap()[3];
    assert!(
        (matrix * DVec3::Y - 2.0 * DVec3::Z).length() < 1e-14 && (matrix * DVec3::X - 2.0 * DVec3::Y).length() < 1e-14
    );
    let volume = outcome.report.volume.unwrap().overall;
    assert!((volume.rest - 8.0 * 0.096).abs() < 1e-13 && (volume.posed - volume.corrected).abs() < 1e-13);
    assert!(outcome.report.warnings.iter().any(|w| w.contains("2 times as large")));
    let course = run(&plate(), toml).unwrap().course().unwrap();
    assert!(course.posed_change.iter().chain(&course.corrected_change).all(|change| (change - 1.0).abs() < 1e-13));
}

/// On a cylinder of radius R a piece at height h is stretched by 1 + h/R around and by 1 along; where heights are scaled by s, by 1 + s h/R, 1 and s.
#[test]
fn stress_along_a_cylinder_is_that_of_its_stretches() {
    let outcome = run(&plate(), CYLINDER).unwrap();
    let scale = outcome.report.surface.as_ref().unwrap().height_scale.unwrap();
    assert!((0.85..0.95).contains(&scale), "{scale}");
    let angle = |largest: f64, least: f64| (2.0 * (largest * least).sqrt() / (largest + least)).min(1.0).acos();
    // At the top of the plate, 0.1 high; its lower side is on the cylinder.
    let expected = |top: bool, scale: f64| angle(if top { 1.0 + 0.2 * scale } else { 1.0 }, scale);
    for (jacobians, points, scale) in [
        (outcome.posed_jacobians(), &outcome.course().unwrap().posed, 1.0),
        (outcome.jacobians(), &outcome.points, scale),
    ] {
        for (found, p) in stress_angles(&jacobians.unwrap()).iter().zip(points) {
            let expected = expected(p.truncate().length() > 0.51, scale);
            assert!((found - expected).abs() < 1e-5, "{found} instead of {expected} at {p}");
        }
    }
}

#[test]
fn without_refinement_faces_stay_as_they_are() {
    let outcome = run(&plate(), &format!("{CYLINDER}refine = 'off'")).unwrap();
    assert!(outcome.divided().is_none());
    assert_eq!(outcome.points.len(), 8);
}

#[test]
fn edits_act_on_a_lattice_round_what_lies_along_the_surface() {
    let free = format!("{CYLINDER}[preserve]\nvolume = 'free'");
    let laid = run(&plate(), &free).unwrap();
    let moved = run(&plate(), &format!("{free}\n[[edit]]\nmove = {{ by = [0, 0, 3], unit = 'model' }}")).unwrap();
    let apart =
        laid.points.iter().zip(&moved.points).map(|(a, b)| (*b - *a - 3.0 * DVec3::Z).length()).fold(0.0, f64::max);
    assert!(apart < 1e-12, "{apart}");
    let exact = run(&plate(), &format!("{CYLINDER}[[edit]]\ntwist = {{ axis = 'z', degrees = 40 }}")).unwrap();
    assert!(exact.report.volume.unwrap().overall.relative_error.unwrap() <= 1e-13);
}

#[test]
fn what_cannot_be_is_refused() {
    let beyond = error(&plate(), "[surface]\nkind = 'cylinder'\nradius = 0.1\nheight = 2");
    assert!(beyond.is_unreachable() && beyond.code() == "outside" && beyond.place() == "surface.place", "{beyond}");
    assert!(
        run(&plate(), "[surface]\nkind = 'cylinder'\nradius = 0.5\nheight = 0.6\nplace = { outside = 'extend' }")
            .is_ok()
    );
    let folded = error(&plate(), &format!("{CYLINDER}flip = true\nfolds = 'refuse'\nplace = {{ height = 0.5 }}"));
    assert!(folded.is_unreachable() && folded.code() == "folds", "{folded}");
    let reported =
        run(&plate(), &format!("{CYLINDER}flip = true\nplace = {{ height = 0.45 }}\n[preserve]\nvolume = 'free'"))
            .unwrap();
    assert!(reported.report.surface.unwrap().folds.is_some_and(|folds| folds.count > 0));
    let height = error(&plate(), "[[edit]]\ntwist = { axis = 'z', degrees = 40 }\n[preserve]\nmethod = 'height'");
    assert_eq!((height.place().as_str(), height.is_unreachable()), ("preserve.method", false));
    let several = error(
        &shapes::chain(2, 12, 8),
        &format!("{CYLINDER}place = {{ scale = 0.1 }}\n[preserve]\nmethod = 'height'\nvolume = {{ each = '100%' }}"),
    );
    assert_eq!((several.place().as_str(), several.is_unreachable()), ("preserve.method", false));
    let sheet = error(&plate(), &format!("{CYLINDER}place = {{ scale = 0 }}"));
    assert_eq!((sheet.place().as_str(), sheet.is_unreachable()), ("surface.place", false));
    let grid = error(&plate(), "[surface]\nkind = 'cylinder'\nradius = 0.5\nheight = 2\ngrid = [0, 4]");
    assert_eq!((grid.place().as_str(), grid.is_unreachable()), ("surface", false));
    let refine = error(&plate(), &format!("{CYLINDER}refine = -1"));
    assert_eq!(refine.place(), "surface.refine");
    let kind = error(&plate(), "[surface]\nkind = 'cylinder'\nmajor = 2");
    assert_eq!((kind.place().as_str(), kind.is_unreachable()), ("surface", false));
}

#[test]
fn several_bodies_keep_each_its_volume_along_a_surface() {
    let toml = format!(
        "{CYLINDER}place = {{ scale = 0.15, rotate = 45 }}\n[lattice]\nsize = 8\n[preserve]\nvolume = {{ each = '100%' }}"
    );
    let report = run(&shapes::chain(3, 16, 8), &toml).unwrap().report.volume.unwrap();
    assert_eq!(report.components.len(), 3);
    for row in &report.components {
        assert!((row.corrected / row.rest - 1.0).abs() <= 1e-12 && (row.posed / row.rest - 1.0).abs() > 1e-6);
    }
}

#[test]
fn films_move_models_along_surfaces() {
    let text = format!("frames = 3\n{CYLINDER}place = {{ at = [{{ keys = [[0, 0.3], [1, 0.7]] }}, 0.5] }}");
    let film = Film::from_toml(&text).unwrap();
    let mesh = plate();
    let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
    let angles: Vec<f64> = (0..3)
        .map(|frame| {
            let points = film.job(frame).unwrap().run(&input, &mut |_| {}).unwrap().points;
            let sum: DVec3 = points[..8].iter().sum();
            sum.y.atan2(sum.x).rem_euclid(TAU) / TAU
        })
        .collect();
    for (angle, expected) in angles.iter().zip([0.3, 0.5, 0.7]) {
        assert!((angle - expected).abs() < 1e-6, "{angles:?}");
    }
}
