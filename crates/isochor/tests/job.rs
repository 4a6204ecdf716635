//! Whole jobs, as users write them.
#![cfg(feature = "serde")]

use glam::{DMat3, DVec3};
use isochor::shapes::{bottle, cube, hollow_sphere, icosphere, uv_torus};
use isochor::{
    Basis, BasisError, Bounds, CorrectError, Energy, Faces, Frame, Job, JobError, JobInput, Lattice, LatticeError,
    Mesh, OpenBoundaries, Outcome, Outside, PosedLattice, Reason, SelectError, Solid, SolidError, Source, Stage,
    Verdict, displaced, topology,
};

const PROMISED: f64 = 1e-13;
/// Loses a third of its volume or so.
const EDITS: &str = "edit = [{ taper = { axis = \"z\", scale = 0.5 } }, { twist = { axis = \"z\", degrees = 80 } }]\n";

fn run_with(mesh: &Mesh, toml: &str, lattice: Option<&PosedLattice>) -> Result<Outcome, JobError> {
    let job = Job::from_toml(toml).unwrap();
    let input = JobInput { mesh, source: &Source::of(mesh), lattice, surface: None, cage: None };
    let outcome = job.run(&input, &mut |_| {})?;
    // What must hold of every outcome.
    assert_eq!(outcome.points.len(), mesh.points().len());
    if let Some(volume) = &outcome.report.volume {
        let near = Bounds::of(&outcome.points).unwrap().lossless_origin();
        let origin = mesh.bounds().unwrap().lossless_origin();
        let measured = volumes(mesh, &outcome.points).0;
        let rounding = 4.0 * f64::EPSILON * near.abs().max_element().max(origin.abs().max_element());
        let tolerance = 1e-13 * measured.abs() + rounding * 10.0 * mesh.bounds().unwrap().extent().powi(2);
        let inverted = outcome.report.model.verdict == Verdict::InsideOut;
        let expected = if inverted { -measured } else { measured };
        assert!(
            (volume.overall.corrected - expected).abs() <= tolerance,
            "{} is not {expected}",
            volume.overall.corrected
        );
        let sum = |part: fn(&isochor::VolumeRow) -> f64| volume.components.iter().map(part).sum::<f64>();
        for (total, sum) in [
            (volume.overall.rest, sum(|row| row.rest)),
            (volume.overall.posed, sum(|row| row.posed)),
            (volume.overall.corrected, sum(|row| row.corrected)),
        ] {
            assert!((total - sum).abs() <= 1e-14 * total.abs().max(1.0), "{sum} instead of {total}");
        }
        if let Some(target) = volume.overall.target {
            assert!(volume.overall.relative_error.unwrap() <= PROMISED);
            assert!((volume.overall.corrected / target - 1.0).abs() <= PROMISED);
        } else {
            assert_eq!((volume.overall.relative_error, outcome.report.correction.status.as_str()), (None, "not-asked"));
        }
    }
    Ok(outcome)
}

fn run(mesh: &Mesh, toml: &str) -> Result<Outcome, JobError> {
    run_with(mesh, toml, None)
}

/// Signed volumes with caps, total and by component.
fn volumes(mesh: &Mesh, points: &[DVec3]) -> (f64, Vec<f64>) {
    let volumes = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap().volumes(points);
    (volumes.total, volumes.components)
}

fn bits(points: &[DVec3]) -> Vec<[u64; 3]> {
    points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

fn moved(mesh: &Mesh, f: impl Fn(DVec3) -> DVec3) -> Mesh {
    mesh.with_points(mesh.points().iter().map(|p| f(*p)).collect()).unwrap()
}

/// Wound inwards, every polygon fanned from the same corner as before.
fn inverted(mesh: &Mesh) -> Mesh {
    let mut faces = Faces::new();
    for face in mesh.faces().iter() {
        faces.push(&face[..1].iter().chain(face[1..].iter().rev()).copied().collect::<Vec<_>>());
    }
    Mesh::new(mesh.points().to_vec(), faces).unwrap()
}

/// The bottle without its faces above z = 2.9: open at the neck.
fn open_bottle() -> Mesh {
    let bottle = bottle(24, 30);
    let is_lid = |face: &&[u32]| face.iter().all(|v| bottle.points()[*v as usize].z > 2.95);
    Mesh::new(bottle.points().to_vec(), bottle.faces().iter().filter(|f| !is_lid(f)).collect()).unwrap()
}

fn flipped_face() -> Mesh {
    let cube = cube(1);
    let mut faces: Vec<Vec<u32>> = cube.faces().iter().map(<[u32]>::to_vec).collect();
    faces[0].reverse();
    Mesh::new(cube.points().to_vec(), faces.iter().map(Vec::as_slice).collect()).unwrap()
}

fn assert_value(result: Result<Outcome, JobError>, expected: &str) {
    match result.map(|o| o.report) {
        Err(JobError::Value { key, problem }) => assert_eq!(key, expected, "{problem}"),
        other => panic!("{other:?}"),
    }
}

fn assert_all_near(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (v, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= tolerance, "{v}: {a} instead of {b}, tolerance {tolerance:e}");
    }
}

// Jobs that change nothing

#[test]
fn an_empty_job_gives_back_any_model_bit_for_bit() {
    let negative_zeros = moved(&cube(2), |p| DVec3::select(p.cmpeq(DVec3::ZERO), -p, p));
    let far = moved(&icosphere(1), |p| p + DVec3::splat(1e6 / 3.0));
    let points = Mesh::new(vec![DVec3::ONE, DVec3::NEG_ONE], Faces::new()).unwrap();
    let flat = Mesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], [&[0u32, 1, 2]].into_iter().collect()).unwrap();
    for mesh in [negative_zeros, far, open_bottle(), flipped_face(), inverted(&cube(1)), points, flat, Mesh::default()]
    {
        for job in ["", "preserve = { volume = \"free\" }"] {
            let outcome = run(&mesh, job).unwrap();
            assert_eq!(bits(&outcome.points), bits(mesh.points()));
            assert!(outcome.controls.is_none() && outcome.jacobians().is_none());
            let correction = &outcome.report.correction;
            assert_eq!((correction.method.as_str(), correction.status.as_str()), ("none", "not-asked"));
            assert_eq!((correction.max_displacement, correction.iterations), (0.0, 0));
        }
    }
}

#[test]
fn an_untouched_lattice_gives_back_the_model_bit_for_bit() {
    let negative_zeros = moved(&cube(3), |p| DVec3::select(p.cmpeq(DVec3::ZERO), -p, p));
    let straddling = moved(&icosphere(2), |p| p + DVec3::new(0.4, 0.0, 3e5));
    for mesh in [negative_zeros, straddling, open_bottle(), uv_torus(1.0, 0.25, 12, 8)] {
        for job in ["[lattice]\n", "[lattice]\nsize = [3, 4, 5]\ndegree = 2\nknots = \"uniform\"\nmargin = -0.05\n"] {
            let outcome = run(&mesh, job).unwrap();
            assert_eq!(bits(&outcome.points), bits(mesh.points()));
            assert_eq!(outcome.report.correction.status, "already-met");
            let volume = outcome.report.volume.as_ref().unwrap().overall;
            assert_eq!((volume.rest, volume.rest), (volume.posed, volume.corrected));
            let controls = outcome.controls.as_ref().unwrap();
            assert_eq!(controls.rest, controls.posed);
            assert!(outcome.jacobians().unwrap().iter().all(|j| *j == DMat3::IDENTITY));
        }
    }
}

// Volumes

#[test]
fn edits_keep_the_volume_at_rest_unless_told_otherwise() {
    for mesh in [bottle(24, 30), open_bottle(), hollow_sphere(2, 0.6), uv_torus(1.0, 0.25, 24, 12)] {
        let outcome = run(&mesh, EDITS).unwrap();
        let rest = volumes(&mesh, mesh.points()).0;
        let row = outcome.report.volume.as_ref().unwrap().overall;
        assert_eq!((row.rest, row.target, row.written), (rest, Some(rest), None));
        assert!(row.posed < 0.9 * rest);
        assert!((volumes(&mesh, &outcome.points).0 / rest - 1.0).abs() <= PROMISED);
        assert_eq!(
            (outcome.report.correction.method.as_str(), outcome.report.correction.status.as_str()),
            ("nearest", "exact")
        );
    }
}

#[test]
fn free_volume_is_measured_and_not_corrected() {
    let mesh = bottle(24, 30);
    let outcome = run(&mesh, &format!("{EDITS}preserve = {{ volume = \"free\" }}")).unwrap();
    let row = outcome.report.volume.as_ref().unwrap().overall;
    assert_eq!((row.posed, row.target, row.relative_error), (row.corrected, None, None));
    assert_eq!(row.posed, volumes(&mesh, &outcome.points).0);
    assert_eq!(outcome.report.correction.status, "not-asked");
    // Any mesh will do.
    for mesh in [flipped_face(), Mesh::new(vec![DVec3::ZERO, DVec3::ONE], Faces::new()).unwrap()] {
        let outcome =
            run(&mesh, "edit = [{ scale = { by = 2, center = [0, 0, 0] } }]\npreserve = { volume = \"free\" }")
                .unwrap();
        assert!(outcome.report.volume.is_none());
        let doubled: Vec<DVec3> = mesh.points().iter().map(|p| *p * 2.0).collect();
        assert_all_near(&outcome.points, &doubled, 1e-14);
        assert!(outcome.jacobians().unwrap().iter().all(|j| j.abs_diff_eq(DMat3::IDENTITY * 2.0, 1e-13)));
    }
}

#[test]
fn derivatives_before_the_correction_are_those_without_one() {
    let mesh = icosphere(2);
    let corrected = run(&mesh, EDITS).unwrap();
    let free = run(&mesh, &format!("{EDITS}[preserve]\nvolume = 'free'\n")).unwrap();
    assert_eq!(corrected.posed_jacobians(), free.jacobians());
    assert_eq!(free.posed_jacobians(), free.jacobians());
    assert_ne!(corrected.posed_jacobians(), corrected.jacobians());
    // Nothing was deformed.
    let untouched = run(&mesh, "").unwrap();
    assert!(untouched.posed_jacobians().is_none() && untouched.jacobians().is_none());
}

#[test]
fn percentages_and_numbers_are_targets() {
    let mesh = bottle(24, 30);
    let rest = volumes(&mesh, mesh.points()).0;
    for (volume, target) in [("\"120%\"", 1.2 * rest), ("\"35%\"", 0.35 * rest), ("2.5", 2.5), ("\"0.75\"", 0.75)] {
        for (edits, method) in [("", "gradient"), (EDITS, "gradient"), (EDITS, "axes")] {
            let job = format!("{edits}preserve = {{ volume = {volume}, method = \"{method}\" }}");
            let outcome = run(&mesh, &job).unwrap();
            let row = outcome.report.volume.as_ref().unwrap().overall;
            assert!((row.target.unwrap() / target - 1.0).abs() <= 4.0 * f64::EPSILON);
            assert!((volumes(&mesh, &outcome.points).0 / target - 1.0).abs() <= PROMISED);
            assert_eq!(outcome.report.correction.method, method);
        }
    }
}

#[test]
fn a_range_corrects_only_to_its_nearer_end() {
    let mesh = bottle(24, 30);
    let rest = volumes(&mesh, mesh.points()).0;
    let with = |volume: &str| run(&mesh, &format!("{EDITS}preserve = {{ volume = {volume} }}")).unwrap();
    let free = with("\"free\"");
    let posed = free.report.volume.as_ref().unwrap().overall.posed;
    assert!(posed > 0.5 * rest && posed < 0.9 * rest);
    for inside in ["{ min = \"50%\", max = \"90%\" }", "{ max = \"90%\" }", "{ min = 0.1 }", "\"50%..90%\""] {
        let outcome = with(inside);
        assert_eq!(outcome.report.correction.status, "already-met");
        assert_eq!(bits(&outcome.points), bits(&free.points));
    }
    for (outside, target) in [
        ("{ min = \"95%\" }", 0.95 * rest),
        ("{ min = \"95%\", max = 100.0 }", 0.95 * rest),
        ("{ max = \"40%\" }", 0.4 * rest),
        ("{ min = 0.1, max = 0.5 }", 0.5),
    ] {
        assert!((volumes(&mesh, &with(outside).points).0 / target - 1.0).abs() <= PROMISED);
    }
    let crossed = run(&mesh, &format!("{EDITS}preserve = {{ volume = {{ min = \"110%\", max = \"90%\" }} }}"));
    assert_value(crossed, "preserve.volume");
}

#[test]
fn an_inside_out_model_is_corrected_outwards_and_reported_positive() {
    let (outward, inward) = (bottle(24, 30), inverted(&bottle(24, 30)));
    for volume in ["\"rest\"", "\"130%\"", "3.0", "{ min = \"90%\" }"] {
        let job = format!("{EDITS}preserve = {{ volume = {volume} }}");
        let (a, b) = (run(&outward, &job).unwrap(), run(&inward, &job).unwrap());
        assert_eq!(b.report.model.verdict, Verdict::InsideOut);
        assert_all_near(&b.points, &a.points, 1e-12);
        let (a, b) = (a.report.volume.unwrap(), b.report.volume.unwrap());
        for (a, b) in [(a.overall, b.overall), (a.components[0], b.components[0])] {
            for (a, b) in [(a.rest, b.rest), (a.posed, b.posed), (a.corrected, b.corrected)] {
                assert!(b > 0.0 && (a / b - 1.0).abs() < 1e-12, "{b} instead of {a}");
            }
        }
        assert!((a.overall.target.unwrap() / b.overall.target.unwrap() - 1.0).abs() < 1e-12);
    }
    // Errors speak of outward volumes too.
    let refused = run(&inward, &format!("{EDITS}preserve = {{ pin = \"all\" }}")).unwrap_err();
    let JobError::Correct(CorrectError::Impossible { target, volume, reason, .. }) = &refused else {
        panic!("{refused}")
    };
    assert!(*target > 0.0 && *volume > 0.0 && *reason == Reason::Pinned);
}

#[test]
fn a_model_far_from_the_origin_is_as_exact_in_a_frame_near_it() {
    let near = bottle(24, 30);
    for distance in [1e5, 3e6] {
        let by = DVec3::new(distance, -distance / 3.0, 2.0 * distance);
        let far = moved(&near, |p| p + by);
        let outcome = run(&far, EDITS).unwrap();
        let row = outcome.report.volume.as_ref().unwrap().overall;
        assert_eq!(row.rest, volumes(&far, far.points()).0);
        assert_eq!(row.target, Some(row.rest));
        assert!((row.corrected / row.rest - 1.0).abs() <= PROMISED);
        // The result is that of the near model, up to the rounding of the far coordinates; so are the controls.
        let expected = run(&moved(&far, |p| p - by), EDITS).unwrap();
        let at_home: Vec<DVec3> = outcome.points.iter().map(|p| *p - by).collect();
        assert_all_near(&at_home, &expected.points, 4e-16 * by.abs().max_element() + 1e-12);
        let controls: Vec<DVec3> = outcome.controls.unwrap().posed.iter().map(|p| *p - by).collect();
        assert_all_near(&controls, &expected.controls.unwrap().posed, 4e-16 * by.abs().max_element() + 1e-12);
    }
}

#[test]
fn results_follow_rotation_by_quarters_translation_and_scale_of_the_model() {
    // A quarter turn about z and the scale 2^10 take box and axes to box and axes.
    let mesh = bottle(24, 30);
    let job = |center: DVec3| {
        let [x, y, z] = center.to_array();
        format!(
            "edit = [{{ rotate = {{ axis = \"z\", degrees = 30, center = [{x}, {y}, {z}], nodes = {{ k = [4, 5] }} }} }}]\n"
        )
    };
    let (quarter, by) = (DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z), DVec3::new(8.0, -4.0, 16.0));
    let image = |p: DVec3| 1024.0 * (quarter * p + by);
    let here = run(&mesh, &job(DVec3::ZERO)).unwrap();
    let there = run(&moved(&mesh, image), &job(image(DVec3::ZERO))).unwrap();
    let expected: Vec<DVec3> = here.points.iter().map(|p| image(*p)).collect();
    assert_all_near(&there.points, &expected, 1e-10);
    let relative = |outcome: &Outcome| outcome.report.correction.max_displacement_relative;
    assert!(relative(&here) > 1e-3 && (relative(&here) / relative(&there) - 1.0).abs() < 1e-9);
}

// Lattices

#[test]
fn the_default_lattice_is_a_cubic_one_of_6_controls_per_axis_fitted_to_the_model() {
    let mesh = bottle(24, 30);
    let default = run(&mesh, EDITS).unwrap();
    let spelled_out = "[lattice]\nbasis = \"bspline\"\ndegree = 3\nsize = 6\nknots = \"clamped\"\nfit = \"bounds\"\nmargin = 0.0\noutside = \"keep\"\n";
    let explicit = run(&mesh, &format!("{EDITS}{spelled_out}")).unwrap();
    assert_eq!(bits(&default.points), bits(&explicit.points));
    let lattice = default.controls.unwrap().lattice;
    assert_eq!(lattice.bases().clone(), [0; 3].map(|_| Basis::clamped(6, 3).unwrap()));
    assert_eq!(lattice.frame(), Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap());
}

#[test]
fn an_explicit_frame_is_taken_as_it_is() {
    // A sheared frame round the unit cube, in model coordinates far from the origin.
    let by = DVec3::new(1000.0, 0.0, -500.0);
    let mesh = moved(&cube(3), |p| p + by);
    let job = "edit = [{ move = { by = [0.25, 0, 0], nodes = { i = 1 } } }]\npreserve = { volume = \"free\" }\n[lattice]\nsize = 2\n\
        origin = [999.0, -1.0, -501.0]\naxes = [[3, 0, 0], [0, 3, 0], [0, 1, 3]]\n";
    let outcome = run(&mesh, job).unwrap();
    // Trilinear: p moves by a quarter of u, u = (x − 999) / 3.
    let expected: Vec<DVec3> = mesh.points().iter().map(|p| *p + DVec3::X * 0.25 * (p.x - 999.0) / 3.0).collect();
    assert_all_near(&outcome.points, &expected, 1e-12);
    let frame = outcome.controls.as_ref().unwrap().lattice.frame();
    assert_eq!(frame.axes, [DVec3::X * 3.0, DVec3::Y * 3.0, DVec3::new(0.0, 1.0, 3.0)]);
    assert_eq!(frame.origin, DVec3::new(999.0, -1.0, -501.0));
    assert_eq!(
        outcome.report.warnings,
        [
            "Along u, 2 control points lower the degree to 1.",
            "Along v, 2 control points lower the degree to 1.",
            "Along w, 2 control points lower the degree to 1."
        ]
    );
}

#[test]
fn half_of_an_explicit_frame_or_a_fit_beside_it_is_refused() {
    let frame = "origin = [0, 0, 0]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n";
    let lattice = |text: &str| run(&cube(2), &format!("[lattice]\n{text}"));
    assert!(lattice(frame).is_ok());
    assert_value(lattice("origin = [0, 0, 0]"), "lattice.origin");
    assert_value(lattice("axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"), "lattice.axes");
    assert_value(lattice(&format!("{frame}fit = \"bounds\"")), "lattice.fit");
    assert_value(lattice(&format!("{frame}margin = 0.1")), "lattice.margin");
    assert_value(lattice("margin = inf"), "lattice.margin");
    let flat = lattice("origin = [0, 0, 0]\naxes = [[1, 0, 0], [0, 1, 0], [1, 1, 0]]");
    assert!(matches!(flat.unwrap_err(), JobError::Lattice(LatticeError::FlatFrame { .. })));
    assert!(matches!(lattice("margin = -0.5").unwrap_err(), JobError::Lattice(LatticeError::NothingToFit { .. })));
}

#[test]
fn sizes_below_the_degree_lower_it_with_a_note() {
    let outcome = run(&cube(2), "[lattice]\nsize = [3, 6, 2]\n").unwrap();
    let degrees = outcome.controls.as_ref().unwrap().lattice.bases().clone().map(|b| b.degree());
    assert_eq!(degrees, [2, 3, 1]);
    let notes =
        ["Along u, 3 control points lower the degree to 2.", "Along w, 2 control points lower the degree to 1."];
    assert_eq!(outcome.report.warnings, notes);
}

#[test]
fn bernstein_lattices_ignore_degree_and_knots_with_a_note() {
    let bare = run(&cube(2), "[lattice]\nbasis = \"bernstein\"\nsize = [4, 5, 6]\n").unwrap();
    assert!(bare.report.warnings.is_empty());
    for extra in ["degree = 2", "knots = \"uniform\"", "knots = [[0, 1], [0, 1], [0, 1]]"] {
        let outcome = run(&cube(2), &format!("[lattice]\nbasis = \"bernstein\"\nsize = [4, 5, 6]\n{extra}\n")).unwrap();
        let lattice = outcome.controls.unwrap().lattice;
        assert_eq!(lattice.bases().clone(), [4, 5, 6].map(|n| Basis::bernstein(n).unwrap()));
        assert_eq!(outcome.report.warnings.len(), 1);
        assert!(outcome.report.warnings[0].contains("Bernstein"), "{}", outcome.report.warnings[0]);
    }
}

#[test]
fn knots_are_clamped_uniform_or_explicit() {
    let bases =
        |text: &str| run(&cube(2), &format!("[lattice]\n{text}")).map(|o| o.controls.unwrap().lattice.bases().clone());
    let uniform = bases("knots = \"uniform\"\nsize = [5, 6, 7]\ndegree = [2, 3, 4]").unwrap();
    assert_eq!(uniform, [(5, 2), (6, 3), (7, 4)].map(|(size, degree)| Basis::uniform(size, degree).unwrap()));
    let knots = "knots = [[0, 0, 1, 1], [0, 0, 0.5, 1, 1], [0, 0, 0.2, 0.6, 1, 1]]\ndegree = 1\n";
    let explicit = bases(knots).unwrap();
    assert_eq!(explicit.clone().map(|b| b.size()), [2, 3, 4]);
    assert_eq!(explicit[2].knots(), [0.0, 0.0, 0.2, 0.6, 1.0, 1.0]);
    assert_eq!(bases(&format!("{knots}size = [2, 3, 4]")).unwrap(), explicit);
    let mixed =
        bases("knots = [\"uniform\", [0, 0, 0.3, 1, 1], \"clamped\"]\ndegree = [2, 1, 3]\nsize = [5, 3, 7]").unwrap();
    let expected = [Basis::uniform(5, 2), Basis::with_knots(vec![0.0, 0.0, 0.3, 1.0, 1.0], 1), Basis::clamped(7, 3)];
    assert_eq!(mixed, expected.map(Result::unwrap));
    match bases(&format!("{knots}size = [2, 4, 4]")) {
        Err(JobError::Value { key: "lattice.knots", .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn bases_that_are_impossible_name_their_axis() {
    let refused = |text: &str| run(&cube(2), &format!("[lattice]\n{text}")).unwrap_err();
    let basis = |axis, source| JobError::Lattice(LatticeError::Basis { axis, source });
    assert_eq!(refused("degree = [3, 0, 3]"), basis('v', BasisError::DegreeZero));
    assert_eq!(refused("size = [2000, 2, 2]"), basis('u', BasisError::TooManyControls { size: 2000 }));
    let torn = "degree = 1\nknots = [[0, 0, 1, 1], [0, 0, 1, 1], [0, 0, 0.5, 0.5, 1, 1]]";
    assert_eq!(refused(torn), basis('w', BasisError::Discontinuous { value: 0.5, count: 2, degree: 1 }));
    assert!(matches!(refused("size = 1"), JobError::Lattice(LatticeError::Basis { axis: 'u', .. })));
    assert!(matches!(
        refused("size = 300"),
        JobError::Lattice(LatticeError::TooManyControls { size: [300, 300, 300] })
    ));
    assert_eq!((refused("size = 300").code(), refused("size = 300").is_unreachable()), ("lattice", false));
}

#[test]
fn a_flat_model_gets_a_lattice_with_thickness_and_a_note() {
    let sheet = moved(&cube(2), |p| p * DVec3::new(1.0, 1.0, 0.0));
    let job = "edit = [{ scale = { by = 2 } }]\npreserve = { volume = \"free\" }";
    let outcome = run(&sheet, job).unwrap();
    assert!(outcome.report.warnings.iter().any(|w| w.contains("flat")), "{:?}", outcome.report.warnings);
    let expected: Vec<DVec3> = sheet.points().iter().map(|p| *p * 2.0 - DVec3::new(0.5, 0.5, 0.0)).collect();
    assert_all_near(&outcome.points, &expected, 1e-14);
    let refused = run(&sheet, "edit = [{ scale = { by = 2 } }]").unwrap_err();
    assert!(matches!(refused, JobError::NoVolume { .. }), "{refused}");
    assert_eq!((refused.code(), refused.is_unreachable()), ("no-volume", true));
}

#[test]
fn vertices_outside_are_kept_with_a_note_extended_or_refused() {
    let mesh = bottle(24, 30);
    let job = |outside: &str| run(&mesh, &format!("{EDITS}[lattice]\nmargin = -0.05\noutside = \"{outside}\"\n"));
    let (kept, extended) = (job("keep").unwrap(), job("extend").unwrap());
    let binding = kept.controls.as_ref().unwrap().lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let still: Vec<usize> = (0..mesh.points().len()).filter(|v| binding.weights(*v).is_empty()).collect();
    assert!(
        !still.is_empty()
            && kept.report.warnings[0].starts_with(&format!("{} of {}", still.len(), mesh.points().len()))
    );
    for v in still {
        assert_eq!(kept.points[v].to_array().map(f64::to_bits), mesh.points()[v].to_array().map(f64::to_bits));
        assert_ne!(extended.points[v], mesh.points()[v]);
    }
    assert!(extended.report.warnings.is_empty());
    let refused = job("refuse").unwrap_err();
    assert!(matches!(refused, JobError::Lattice(LatticeError::Outside { .. })));
    assert_eq!(
        (refused.code(), refused.place().as_str(), refused.is_unreachable()),
        ("outside", "lattice.outside", true)
    );
}

/// A lattice round the bottle, its upper controls turned, as a file would hold it; `mobility` all 1.
fn posed_lattice(mesh: &Mesh) -> PosedLattice {
    let frame = Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap();
    let lattice = Lattice::new([0; 3].map(|_| Basis::uniform(5, 2).unwrap()), frame).unwrap();
    let rest = lattice.rest();
    let turned =
        |p: &DVec3| DMat3::from_rotation_z(0.3 * (p.z - frame.origin.z)) * *p * (1.0 - 0.1 / 3.0 * p.z.abs().min(1.0));
    let posed = rest.iter().map(turned).collect();
    PosedLattice { lattice, rest, posed, mobility: None }
}

#[test]
fn a_lattice_file_deforms_as_it_says_and_pinned_controls_keep_their_bits() {
    for by in [DVec3::ZERO, DVec3::new(1e4 / 3.0, -7e5, 1e3)] {
        let mesh = moved(&bottle(24, 30), |p| p + by);
        let mut file = posed_lattice(&bottle(24, 30));
        file.lattice = Lattice::new(file.lattice.bases().clone(), file.lattice.frame().moved(by)).unwrap();
        file.rest.iter_mut().chain(&mut file.posed).for_each(|p| *p += by);
        let free =
            run_with(&mesh, "lattice = { file = \"l.json\" }\npreserve = { volume = \"free\" }", Some(&file)).unwrap();
        let binding = file.lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let displacement: Vec<DVec3> = file.posed.iter().zip(&file.rest).map(|(p, r)| *p - *r).collect();
        let expected = displaced(mesh.points(), &binding.apply(&displacement));
        assert_all_near(&free.points, &expected, 1e-14 + 1e-15 * by.length());
        assert_eq!(bits(&free.controls.unwrap().posed), bits(&file.posed));

        let pinned = "lattice = { file = \"l.json\" }\npreserve = { pin = { k = [0, 4] } }";
        let outcome = run_with(&mesh, pinned, Some(&file)).unwrap();
        assert_eq!(outcome.report.correction.status, "exact");
        let controls = outcome.controls.unwrap();
        assert_eq!((&controls.rest, &controls.mobility), (&file.rest, &file.mobility));
        for c in 0..125 {
            let is_pinned = [0, 4].contains(&file.lattice.node(c)[2]);
            assert_eq!(bits(&controls.posed[c..=c]) == bits(&file.posed[c..=c]), is_pinned, "{c}");
        }
        // Loaded again, what was saved gives the same model, with nothing left to correct.
        let mut again =
            run_with(&mesh, "lattice = { file = \"l.json\" }\npreserve = { volume = \"free\" }", Some(&controls))
                .unwrap();
        assert_all_near(&again.points, &outcome.points, 1e-13 + 1e-15 * by.length());
        again.measure_written(&outcome.points);
    }
}

#[test]
fn the_mobility_of_a_lattice_file_pins_single_coordinates() {
    let mesh = bottle(24, 30);
    let mut file = posed_lattice(&mesh);
    let only_y = |c: usize| if c.is_multiple_of(3) { DVec3::Y } else { DVec3::ONE };
    file.mobility = Some((0..125).map(only_y).collect());
    for method in ["gradient", "axes"] {
        let job = format!("lattice = {{ file = \"l.json\" }}\npreserve = {{ method = \"{method}\" }}");
        let posed = run_with(&mesh, &job, Some(&file)).unwrap().controls.unwrap().posed;
        for c in (0..125).step_by(3) {
            assert_eq!(
                (posed[c].x.to_bits(), posed[c].z.to_bits()),
                (file.posed[c].x.to_bits(), file.posed[c].z.to_bits())
            );
        }
        assert!((0..125).step_by(3).any(|c| posed[c].y != file.posed[c].y));
    }
}

#[test]
fn a_lattice_file_excludes_what_it_says_itself() {
    let mesh = bottle(24, 30);
    let file = posed_lattice(&mesh);
    for (key, value) in [
        ("size", "5"),
        ("degree", "2"),
        ("basis", "\"bspline\""),
        ("knots", "\"uniform\""),
        ("fit", "\"bounds\""),
        ("margin", "0.1"),
        ("origin", "[0, 0, 0]"),
        ("axes", "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"),
    ] {
        let refused =
            run_with(&mesh, &format!("[lattice]\nfile = \"l.json\"\n{key} = {value}\n"), Some(&file)).unwrap_err();
        assert_eq!(refused.place(), format!("lattice.{key}"));
        assert_eq!((refused.code(), refused.is_unreachable()), ("value", false));
    }
    assert!(run_with(&mesh, "[lattice]\nfile = \"l.json\"\noutside = \"extend\"\n", Some(&file)).is_ok());
    assert_value(run(&mesh, "[lattice]\nfile = \"l.json\"\n"), "lattice.file");
}

#[test]
fn a_lattice_file_whose_rest_positions_do_not_reproduce_the_model_is_noted() {
    let mesh = bottle(24, 30);
    let mut file = posed_lattice(&mesh);
    let job = "lattice = { file = \"l.json\" }\npreserve = { volume = \"free\" }";
    assert!(run_with(&mesh, job, Some(&file)).unwrap().report.warnings.is_empty());
    let before = run_with(&mesh, job, Some(&file)).unwrap().points;
    // Both moved alike: the difference, and so the deformation, is the same.
    file.rest.iter_mut().chain(&mut file.posed).for_each(|p| *p += DVec3::splat(0.125));
    let outcome = run_with(&mesh, job, Some(&file)).unwrap();
    assert_eq!(outcome.report.warnings.len(), 1);
    assert!(outcome.report.warnings[0].contains("1.250e-1") || outcome.report.warnings[0].contains("2.165e-1"));
    assert_all_near(&outcome.points, &before, 1e-14);
}

// What is preserved, and how

#[test]
fn axes_and_shares_choose_the_method() {
    let mesh = bottle(24, 30);
    let with = |preserve: &str| run(&mesh, &format!("{EDITS}preserve = {{ {preserve} }}"));
    let free = with("volume = \"free\"").unwrap();
    for (preserve, method, still) in [
        ("axes = \"x\"", "axes", vec![1, 2]),
        ("axes = \"zx\"", "axes", vec![1]),
        ("axes = [[0, 1, 0], [0, 1, 1]], shares = [1, 2]", "axes", vec![0]),
        ("method = \"axes\"", "axes", vec![]),
        ("shares = [1, 1, 2]", "axes", vec![]),
        ("method = \"gradient\"", "gradient", vec![]),
        ("method = \"gradient\", axes = \"zx\"", "gradient", vec![1]),
        ("method = \"nearest\", axes = \"y\"", "nearest", vec![0, 2]),
        ("", "nearest", vec![]),
    ] {
        let outcome = with(preserve).unwrap();
        assert_eq!(outcome.report.correction.method, method);
        for a in 0..3 {
            let same = outcome.points.iter().zip(&free.points).all(|(p, q)| p[a] == q[a]);
            assert_eq!(same, still.contains(&a), "{preserve}");
        }
    }
    for preserve in [
        "method = \"gradient\", axes = [[1, 1, 0]]",
        "method = \"nearest\", axes = [[1, 1, 0]]",
        "method = \"gradient\", shares = [1, 1, 1]",
    ] {
        assert_value(with(preserve), "preserve.method");
    }
    let refused = with("axes = \"xy\", shares = [1, 1, 1]").unwrap_err();
    assert!(matches!(refused, JobError::Correct(CorrectError::Length { found: 3, expected: 2, .. })), "{refused}");
    assert_eq!((refused.code(), refused.place().as_str(), refused.is_unreachable()), ("correct", "preserve", false));
}

#[test]
fn each_objective_is_least_where_it_was_asked_for() {
    let mesh = bottle(24, 30);
    let of = |objective: &str| {
        let job = format!("{EDITS}preserve = {{ objective = \"{objective}\", pin = {{ k = 0 }}, volume = \"105%\" }}");
        let outcome = run(&mesh, &job).unwrap();
        assert_eq!(outcome.report.correction.objective, objective);
        outcome.controls.unwrap()
    };
    let free = run(&mesh, &format!("{EDITS}preserve = {{ volume = \"free\" }}")).unwrap();
    assert_eq!(free.report.correction.objective, "none");
    let free = free.controls.unwrap();
    let binding = free.lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let energies = [
        None,
        Some(Energy::surface(&binding).unwrap()),
        Some(Energy::edges(&free.lattice).unwrap()),
        Some(Energy::bending(&free.lattice).unwrap()),
    ];
    let cost = |energy: &Option<Energy>, controls: &PosedLattice| -> f64 {
        let delta: Vec<DVec3> = controls.posed.iter().zip(&free.posed).map(|(a, b)| *a - *b).collect();
        energy.as_ref().map_or_else(|| delta.iter().map(|d| d.length_squared()).sum(), |energy| energy.of(&delta))
    };
    let results = ["controls", "surface", "edges", "bending"].map(of);
    for (k, energy) in energies.iter().enumerate() {
        let costs: Vec<f64> = results.iter().map(|controls| cost(energy, controls)).collect();
        for (other, found) in costs.iter().enumerate().filter(|(other, _)| *other != k) {
            assert!(costs[k] < 0.99 * found, "{k}: {} with {other}: {found}", costs[k]);
        }
    }
}

#[test]
fn objectives_whose_matrix_is_too_large_are_refused_with_a_way_out() {
    let job =
        format!("{EDITS}lattice = {{ basis = \"bernstein\", size = 24 }}\npreserve = {{ objective = \"surface\" }}");
    let refused = run(&cube(2), &job).unwrap_err();
    assert_eq!(refused, JobError::Correct(CorrectError::Energy { controls: 24 * 24 * 24 }));
    assert_eq!((refused.code(), refused.is_unreachable()), ("memory", true));
    assert_eq!(refused.place(), "preserve.objective");
    assert!(refused.hint().contains("\"controls\""), "{}", refused.hint());
}

#[test]
fn pinned_controls_do_not_move_in_the_correction() {
    let mesh = bottle(24, 30);
    let posed = |preserve: &str| run(&mesh, &format!("{EDITS}preserve = {{ {preserve} }}")).unwrap().controls.unwrap();
    let free = posed("volume = \"free\"");
    let pinned = posed("pin = { k = [0, 1] }");
    let moves: Vec<usize> = (0..216).filter(|c| bits(&pinned.posed[*c..=*c]) != bits(&free.posed[*c..=*c])).collect();
    assert!(moves.iter().all(|c| free.lattice.node(*c)[2] >= 2));
    assert!(moves.len() > 100); // the others are in the corners of the box, where the bottle is not
    let refused = run(&mesh, &format!("{EDITS}preserve = {{ pin = \"all\" }}")).unwrap_err();
    assert!(matches!(refused, JobError::Correct(CorrectError::Impossible { reason: Reason::Pinned, .. })));
    assert_eq!((refused.code(), refused.is_unreachable()), ("impossible", true));
    let nothing = run(&mesh, &format!("{EDITS}preserve = {{ pin = {{ i = 9 }} }}")).unwrap_err();
    assert_eq!(nothing, JobError::Pin(SelectError::Index { axis: 'i', index: 9, size: 6 }));
    assert_eq!((nothing.code(), nothing.place().as_str()), ("pin", "preserve.pin"));
}

#[test]
fn a_falloff_makes_the_correction_local() {
    // The gradient method moves controls along M ∘ ∇V, so its displacement over ∇V is m = exp(−d / (radius · extent)) times
    // one number.
    let mesh = bottle(24, 30);
    let (vertex, radius) = (100, 0.2);
    let free = run(&mesh, &format!("{EDITS}preserve = {{ volume = \"free\" }}")).unwrap();
    let local = run(
        &mesh,
        &format!("{EDITS}preserve = {{ method = \"gradient\", falloff = {{ vertex = {vertex}, radius = {radius} }} }}"),
    )
    .unwrap();
    let (free_controls, controls) = (free.controls.unwrap(), local.controls.unwrap());
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).unwrap();
    let binding = controls.lattice.bind(mesh.points(), Outside::Refuse).unwrap();
    let gradient = binding.adjoint(&solid.volume_gradient(&free.points));
    let center = mesh.points()[vertex];
    let mut factors = Vec::new();
    for (c, g) in gradient.iter().enumerate().filter(|(_, g)| g.length() > 1e-6) {
        let moved = controls.posed[c] - free_controls.posed[c];
        let m = (-controls.rest[c].distance(center) / (radius * mesh.bounds().unwrap().extent())).exp();
        factors.push(moved.dot(*g) / g.length_squared() / m);
        assert!(moved.cross(*g).length() <= 1e-6 * moved.length() * g.length() + 1e-14);
    }
    assert!(factors.len() > 100);
    factors.iter().for_each(|f| assert!((f / factors[0] - 1.0).abs() < 1e-6, "{f} and {}", factors[0]));
}

#[test]
fn a_falloff_round_a_vertex_that_does_not_exist_is_refused() {
    let mesh = bottle(24, 30);
    let n = mesh.points().len();
    let falloff = |vertex: usize, radius: &str| {
        run(&mesh, &format!("{EDITS}preserve = {{ falloff = {{ vertex = {vertex}, radius = {radius} }} }}"))
    };
    let missing = falloff(n, "0.1").unwrap_err();
    assert_eq!(missing, JobError::MissingVertex { key: "preserve.falloff", vertex: n, vertices: n });
    assert_eq!(
        (missing.code(), missing.place().as_str(), missing.is_unreachable()),
        ("missing-vertex", "preserve.falloff", false)
    );
    assert!(falloff(n - 1, "0.1").is_ok());
    for radius in ["0.0", "-1.0", "nan", "inf"] {
        assert_value(falloff(0, radius), "preserve.falloff");
    }
}

#[test]
fn open_models_are_capped_or_refused() {
    let mesh = open_bottle();
    let outcome = run(&mesh, EDITS).unwrap();
    assert_eq!(outcome.report.model.verdict, Verdict::Capped);
    let refused = run(&mesh, &format!("{EDITS}preserve = {{ open = \"refuse\" }}")).unwrap_err();
    assert!(
        matches!(refused, JobError::Solid(SolidError::Open { boundary_edges: 24, boundary_loops: 1, .. })),
        "{refused}"
    );
    assert_eq!((refused.code(), refused.place().as_str(), refused.is_unreachable()), ("open", "preserve.open", true));
    assert!(run(&bottle(24, 30), &format!("{EDITS}preserve = {{ open = \"refuse\" }}")).is_ok());
}

#[test]
fn models_that_bound_no_body_are_refused_with_the_reason() {
    let refused = run(&flipped_face(), EDITS).unwrap_err();
    assert!(matches!(refused, JobError::Solid(SolidError::Winding { edges: 4, .. })), "{refused}");
    assert_eq!((refused.code(), refused.place().as_str(), refused.is_unreachable()), ("winding", "model", true));
    let points = Mesh::new(vec![DVec3::ZERO, DVec3::ONE], Faces::new()).unwrap();
    assert_eq!(run(&points, EDITS).unwrap_err(), JobError::Solid(SolidError::NoFaces));
    let at_a_point = moved(&cube(1), |_| DVec3::ONE);
    assert!(run(&at_a_point, EDITS).is_err());
    assert!(run(&Mesh::default(), EDITS).is_err());
}

#[test]
fn an_impossible_edit_is_named_by_its_place() {
    let job = "edit = [{ scale = { by = 2 } }, { move = { by = [nan, 0, 0] } }]";
    let refused = run(&cube(2), job).unwrap_err();
    assert!(matches!(refused, JobError::Edit { index: 1, .. }), "{refused}");
    assert_eq!((refused.code(), refused.place().as_str(), refused.is_unreachable()), ("edit", "edit[1]", false));
    assert!(refused.to_string().starts_with("edit 2: "), "{refused}");
}

// Reports

#[test]
fn the_report_tells_how_far_the_correction_moved_vertices() {
    let mesh = bottle(24, 30);
    let free = run(&mesh, &format!("{EDITS}preserve = {{ volume = \"free\" }}")).unwrap();
    let corrected = run(&mesh, EDITS).unwrap();
    let squared: Vec<f64> = free.points.iter().zip(&corrected.points).map(|(a, b)| a.distance_squared(*b)).collect();
    let report = &corrected.report.correction;
    let (most, rms) = (
        squared.iter().fold(0.0f64, |m, s| m.max(*s)).sqrt(),
        (squared.iter().sum::<f64>() / squared.len() as f64).sqrt(),
    );
    assert!(most > 1e-3 && rms > 1e-3);
    let extent = mesh.bounds().unwrap().extent();
    for (found, expected) in [
        (report.max_displacement, most),
        (report.rms_displacement, rms),
        (report.max_displacement_relative, most / extent),
        (report.rms_displacement_relative, rms / extent),
    ] {
        assert!((found / expected - 1.0).abs() < 1e-12, "{found} instead of {expected}");
    }
}

#[test]
fn every_component_has_its_row_and_a_cavity_is_negative() {
    let mesh = hollow_sphere(2, 0.5);
    let outcome = run(&mesh, EDITS).unwrap();
    let report = outcome.report.volume.unwrap();
    let (rest, corrected) = (volumes(&mesh, mesh.points()).1, volumes(&mesh, &outcome.points).1);
    assert_eq!(report.components.len(), 2);
    for (c, row) in report.components.iter().enumerate() {
        assert_eq!((row.rest, row.corrected), (rest[c], corrected[c]));
        assert_eq!((row.target, row.relative_error), (None, None));
    }
    assert!(report.components[0].rest > 0.0 && report.components[1].rest < 0.0);
}

#[test]
fn written_volumes_are_those_of_the_rounded_points() {
    for mesh in [hollow_sphere(2, 0.5), inverted(&bottle(24, 30)), moved(&bottle(24, 30), |p| p + 100.0)] {
        let mut outcome = run(&mesh, EDITS).unwrap();
        let single = |x: f64| f64::from(x as f32);
        let written: Vec<DVec3> = outcome.points.iter().map(|p| DVec3::from_array(p.to_array().map(single))).collect();
        outcome.measure_written(&written);
        let (total, components) = volumes(&mesh, &written);
        let sign = total.signum();
        let report = outcome.report.volume.unwrap();
        assert_eq!(report.overall.written, Some(sign * total));
        assert_ne!(report.overall.written, Some(report.overall.corrected));
        let rows: Vec<Option<f64>> = report.components.iter().map(|row| row.written).collect();
        assert_eq!(rows, components.iter().map(|v| Some(sign * v)).collect::<Vec<_>>());
    }
    // Where there is no body there is nothing to add.
    let mut outcome = run(&flipped_face(), "").unwrap();
    outcome.measure_written(flipped_face().points());
    assert!(outcome.report.volume.is_none());
}

#[test]
fn stages_are_announced_in_order_and_timed() {
    let mesh = cube(2);
    let stages = |toml: &str| {
        let mut seen = Vec::new();
        let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
        let outcome = Job::from_toml(toml).unwrap().run(&input, &mut |stage| seen.push(stage)).unwrap();
        let timed: Vec<String> = outcome.report.timings_ms.0.into_iter().map(|(name, _)| name).collect();
        assert_eq!(timed, seen.iter().map(|s| s.name()).collect::<Vec<_>>());
        seen
    };
    assert_eq!(stages(EDITS), Stage::ALL);
    assert_eq!(stages(""), [Stage::Examine]);
}

#[test]
fn reports_are_json_with_the_names_that_programs_read() {
    let outcome = run(&bottle(24, 30), EDITS).unwrap();
    let json = serde_json::to_value(&outcome.report).unwrap();
    let row = outcome.report.volume.unwrap();
    assert_eq!(json["volume"]["final"].as_f64(), Some(row.overall.corrected));
    assert_eq!(json["volume"]["rest"].as_f64(), Some(row.overall.rest));
    assert_eq!(json["volume"]["components"][0]["posed"].as_f64(), Some(row.components[0].posed));
    assert!(json["volume"]["written"].is_null());
    assert_eq!(json["correction"]["status"], "exact");
    assert_eq!(json["model"]["verdict"], "ok");
    assert!(json["timings_ms"]["correct"].as_f64().unwrap() >= 0.0);
}

#[test]
fn a_model_that_an_edit_moves_far_away_is_exact_before_its_coordinates_are_rounded() {
    let mesh = icosphere(3);
    for extents in [1e2, 1e4, 1e6] {
        let edits = format!(
            "edit = [{{ stretch = {{ axis = \"z\", scale = 0.6 }} }}, {{ move = {{ by = [{extents}, 0, 0], unit = \"extent\" }} }}]"
        );
        for method in ["nearest", "gradient", "axes"] {
            let outcome = run(&mesh, &format!("{edits}\npreserve = {{ method = \"{method}\" }}")).unwrap();
            let row = outcome.report.volume.unwrap().overall;
            assert!(row.relative_error.unwrap() <= PROMISED, "{method} at {extents}: {row:?}");
            assert_eq!(row.relative_error, Some(((row.corrected - row.rest) / row.rest).abs()));
        }
    }
}

#[test]
fn points_come_to_their_places_near_the_origin_and_far_from_it() {
    for shift in [DVec3::ZERO, DVec3::new(2e5, -3e5, 1e5)] {
        let near = bottle(24, 30);
        let mesh = near.with_points(near.points().iter().map(|p| *p + shift).collect()).unwrap();
        let to = |v: usize, by: DVec3| mesh.points()[v] + by;
        let places = [(100, to(100, DVec3::new(0.1, 0.0, 0.2))), (400, to(400, DVec3::ZERO))];
        let list: Vec<String> =
            places.iter().map(|(v, p)| format!("{{ vertex = {v}, to = [{:?}, {:?}, {:?}] }}", p.x, p.y, p.z)).collect();
        for method in ["nearest", "gradient", "axes"] {
            let preserve =
                format!("preserve = {{ method = \"{method}\", points = [{}], pin = {{ k = 0 }} }}", list.join(", "));
            let outcome = run(&mesh, &format!("{EDITS}{preserve}")).unwrap();
            for (v, place) in places {
                let rounding = 4.0 * f64::EPSILON * shift.length();
                assert!(outcome.points[v].distance(place) <= 1e-12 * 3.0 + rounding, "{method}");
            }
            assert!(outcome.report.correction.point_error <= 1e-12);
            assert!(outcome.report.volume.unwrap().overall.relative_error.unwrap() <= PROMISED);
        }
    }
}

#[test]
fn points_that_cannot_be_met_are_named() {
    let mesh = bottle(24, 30);
    let refused = |preserve: &str| run(&mesh, &format!("{EDITS}preserve = {{ {preserve} }}")).unwrap_err();
    let missing = refused("points = [{ vertex = 99999, to = [0, 0, 0] }]");
    assert!(
        matches!(missing, JobError::MissingVertex { key: "preserve.points", vertex: 99999, .. })
            && !missing.is_unreachable()
    );
    let twice = refused("points = [{ vertex = 5, to = [0, 0, 0] }, { vertex = 5, to = [0, 0, 1] }]");
    assert_eq!(
        (twice.code(), twice.place().as_str(), twice.is_unreachable()),
        ("impossible", "preserve.points[1]", true)
    );
    let off = refused("axes = \"xy\", points = [{ vertex = 5, to = [0, 0, 9] }]");
    assert_eq!((off.place().as_str(), off.is_unreachable()), ("preserve.points[0]", true));
    assert!(off.to_string().contains("across the chosen axes"), "{off}");
}

/// A drag of each of these vertices, as an edit.
fn drag(places: &[(usize, DVec3)]) -> String {
    let point = |(v, to): &(usize, DVec3)| format!("{{ vertex = {v}, to = [{:?}, {:?}, {:?}] }}", to.x, to.y, to.z);
    format!("{{ drag = {{ points = [{}] }} }}", places.iter().map(point).collect::<Vec<_>>().join(", "))
}

#[test]
fn dragged_vertices_are_at_their_targets_after_the_correction() {
    for shift in [DVec3::ZERO, DVec3::new(2e5, -3e5, 1e5)] {
        let mesh = moved(&bottle(24, 30), |p| p + shift);
        let at = |v: usize, by: DVec3| (v, mesh.points()[v] + by);
        let places = [at(100, DVec3::new(0.2, 0.0, 0.1)), at(400, DVec3::new(0.0, -0.1, 0.3))];
        let taper = "{ taper = { axis = \"z\", scale = 0.5 } }";
        let last = "{ move = { by = [0.5, 0, -0.5], nodes = \"k=3,4\" } }";
        for edits in [format!("{taper}, {}", drag(&places)), format!("{}, {taper}, {last}", drag(&places))] {
            for method in ["nearest", "gradient", "axes"] {
                let job = format!("edit = [{edits}]\npreserve = {{ method = \"{method}\", volume = \"90%\" }}");
                let outcome = run(&mesh, &job).unwrap();
                for (v, place) in places {
                    let rounding = 4.0 * f64::EPSILON * shift.length();
                    assert!(outcome.points[v].distance(place) <= 1e-12 * 3.0 + rounding, "{method}");
                }
                assert!(outcome.report.volume.unwrap().overall.relative_error.unwrap() <= PROMISED);
            }
        }
    }
}

#[test]
fn a_drag_alone_that_keeps_the_volume_moves_controls_as_least_displacement_says() {
    let mesh = icosphere(2);
    let (vertex, by) = (7, DVec3::new(0.3, -0.2, 0.1));
    let job = format!("edit = [{}]\npreserve = {{ volume = \"free\" }}", drag(&[(vertex, mesh.points()[vertex] + by)]));
    let controls = run(&mesh, &job).unwrap().controls.unwrap();
    let row = controls.lattice.bind(mesh.points(), Outside::Refuse).unwrap().weights(vertex);
    // δ_i = w_i (T − S) / Σ w²
    let square: f64 = row.iter().map(|(_, w)| w * w).sum();
    let mut expected = controls.rest.clone();
    row.iter().for_each(|(c, w)| expected[*c] += by * (w / square));
    assert_all_near(&controls.posed, &expected, 1e-14);
}

#[test]
fn the_last_target_of_a_vertex_holds() {
    let mesh = icosphere(2);
    let at = |v: usize, by: DVec3| (v, mesh.points()[v] + by);
    let (first, second, third) = (at(5, DVec3::X * 0.1), at(5, DVec3::Y * 0.2), at(5, DVec3::Z * 0.3));
    let ends_at = |edits: String, preserve: &str, place: (usize, DVec3)| {
        let outcome = run(&mesh, &format!("edit = [{edits}]\npreserve = {{ {preserve} }}")).unwrap();
        assert!(outcome.points[place.0].distance(place.1) <= 2e-12, "{preserve}");
        outcome
    };
    ends_at(format!("{}, {}", drag(&[first]), drag(&[second])), "", second);
    ends_at(drag(&[first, first]), "", first);
    let point = format!("points = [{{ vertex = 5, to = [{:?}, {:?}, {:?}] }}]", third.1.x, third.1.y, third.1.z);
    ends_at(format!("{}, {}", drag(&[first]), drag(&[second])), &point, third);

    // With free volume a drag holds as later edits leave it.
    let lift = "{ move = { by = [0, 0, 1] } }";
    ends_at(drag(&[first]), "volume = \"free\"", first);
    let lifted = (5, first.1 + DVec3::Z);
    let outcome = ends_at(format!("{}, {lift}", drag(&[first])), "volume = \"free\"", lifted);
    assert_eq!(outcome.report.correction.status, "not-asked");
    // Else the correction brings it back, even where the volume is right already: all move back.
    ends_at(format!("{}, {lift}", drag(&[first])), "", first);
    ends_at(format!("{}, {lift}", drag(&[first])), "volume = { min = \"1%\" }", first);
}

#[test]
fn drags_that_cannot_hold_are_named() {
    let mesh = icosphere(2);
    let at = |v: usize, by: DVec3| (v, mesh.points()[v] + by);
    let scale = "{ scale = { by = 1.1 } }";
    let (here, there) = (at(5, DVec3::X * 0.1), at(5, DVec3::Y * 0.1));
    let refused = |edits: String, preserve: &str| {
        let error = run(&mesh, &format!("edit = [{edits}]\npreserve = {{ {preserve} }}")).unwrap_err();
        (error.place(), error.code(), error.is_unreachable(), error.to_string())
    };
    let assert_names = |found: (String, &str, bool, String), place: &str, code: &str, reachable: bool, text: &str| {
        assert_eq!((found.0.as_str(), found.1, found.2), (place, code, !reachable), "{}", found.3);
        assert!(found.3.contains(text), "{}", found.3);
    };
    // In the edit itself.
    let found = refused(format!("{scale}, {}", drag(&[here, at(6, DVec3::ZERO), there])), "");
    assert_names(found, "edit[1]", "impossible", false, "edit 2: drag: vertex 5 misses its target by 1.000e-1");
    let found = refused(drag(&[(4096, DVec3::ZERO)]), "");
    assert_names(found, "edit[0]", "edit", true, "names vertex 4096, but the model has 162 (0 to 161)");
    let unselected = "{ drag = { vertex = 5, to = [0, 0, 0], nodes = { list = [[0, 0, 0]] } } }";
    assert_names(
        refused(unselected.into(), ""),
        "edit[0]",
        "impossible",
        false,
        "vertex 5 follows none of the selected",
    );
    // In the correction: a later edit moved the vertex where axes or pins leave it.
    let east = (0..162).max_by(|a, b| mesh.points()[*a].x.total_cmp(&mesh.points()[*b].x)).unwrap();
    let edits = format!("{scale}, {}, {{ move = {{ by = [0, 0, 1] }} }}", drag(&[at(east, DVec3::ZERO)]));
    let text = format!("edit 2: drag: vertex {east} misses its target by 1.000e0");
    for preserve in ["axes = \"xy\"", "axes = \"xy\", method = \"nearest\"", "pin = { i = [1, 2, 3, 4, 5] }"] {
        assert_names(refused(edits.clone(), preserve), "edit[1]", "impossible", false, &text);
    }
}
