//! Flattened surfaces: isometry of developable ones, the minimum, its invariants, and what is refused.

mod random;

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt::Write;
use std::process::Command;

use glam::{DMat3, DVec2, DVec3};
use isochor::{
    Basis, Curve, FlattenError, FlattenMethod, FlattenOptions, FlattenStart, FlattenStatus, FlattenWeights, Flattened,
    Patch, Surface, flatten,
};
use proptest::prelude::*;
use random::Random;

/// Heights of the control points of a bicubic Bézier patch over the unit square.
const WAVES: [[f64; 4]; 4] =
    [[0.0, 0.35, 0.2, 0.0], [0.3, 0.9, 0.5, 0.1], [0.1, 0.8, -0.3, -0.2], [0.0, 0.1, 0.2, 0.3]];

fn bezier(point: impl Fn(f64, f64, f64) -> DVec3) -> Surface {
    let basis = || Basis::clamped(4, 3).unwrap();
    let row = |i: usize| (0..4).map(move |j| (i, j));
    let controls = (0..4).flat_map(row).map(|(i, j)| point(i as f64 / 3.0, j as f64 / 3.0, WAVES[i][j]));
    Surface::from(Patch::new([basis(), basis()], controls.collect(), None).unwrap())
}

/// Waves of the given height.
fn waves(height: f64) -> Surface {
    bezier(|x, y, z| DVec3::new(x + 0.3 * x * y * y, y - 0.2 * x * (1.0 - y), height * z))
}

/// A patch whose controls are those of a curve, moved along y: a cylinder over the curve. Its weights differ along y, so that no closed form is known.
fn bent() -> Surface {
    let profile = |x: f64| DVec3::new(x, 0.0, 2.0 * x * (1.0 - x));
    let control = |k: usize| profile((k / 4) as f64 / 3.0) + DVec3::new(0.0, 0.8 * (k % 4) as f64 / 3.0, 0.0);
    let weights = (0..16).map(|k| [1.0, 1.2, 1.2, 1.0][k % 4]).collect();
    let bases = [0; 2].map(|_| Basis::bernstein(4).unwrap());
    Surface::from(Patch::new(bases, (0..16).map(control).collect(), Some(weights)).unwrap())
}

fn options(cells: [usize; 2]) -> FlattenOptions {
    FlattenOptions { cells, ..FlattenOptions::default() }
}

fn flat(surface: &Surface, options: &FlattenOptions) -> Flattened {
    let flattened = flatten(surface, options).unwrap();
    assert_eq!(flattened.report.status, FlattenStatus::Converged);
    assert!(flattened.course.windows(2).all(|two| two[1] < two[0]), "each step goes down");
    assert_eq!(flattened.course.len(), flattened.report.iterations + 1);
    flattened
}

fn extent(points: &[DVec2]) -> DVec2 {
    let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    high - low
}

/// All pairs of grid points within reach, twice, with geodesic lengths.
fn pairs(surface: &Surface, sheet: &isochor::Sheet, reach: isize) -> Vec<(usize, usize, f64)> {
    let [m, n] = sheet.cells().map(|c| c as isize);
    let mut pairs = Vec::new();
    for i in 0..=m {
        for j in 0..=n {
            for (k, l) in (i - reach..=i + reach).flat_map(|k| (j - reach..=j + reach).map(move |l| (k, l))) {
                if (k, l) != (i, j) && (0..=m).contains(&k) && (0..=n).contains(&l) {
                    let [a, b] = [(i, j), (k, l)].map(|(i, j)| sheet.parameters(i as usize, j as usize));
                    let length = surface.geodesic_length(a, b).unwrap().length;
                    pairs.push(((i * (n + 1) + j) as usize, (k * (n + 1) + l) as usize, length));
                }
            }
        }
    }
    pairs
}

#[test]
fn a_cylinder_is_a_rectangle() {
    let Flattened { sheet, report, .. } = flat(&Surface::cylinder(2.0, 3.0), &options([24, 5]));
    assert!((extent(sheet.flat()) - DVec2::new(TAU * 2.0, 3.0)).length() < 1e-12);
    assert!(report.length_error.max < 1e-12 && report.area_error.max < 1e-12 && report.folds.is_empty());
}

/// The sector between the slant heights R/sin α and r/sin α, sin α = (R − r)/slant, over the angle 2π sin α.
#[test]
fn a_frustum_is_a_sector_of_a_ring() {
    let [big, small, height] = [1.0, 0.4, 0.8_f64];
    let slant = (big - small).hypot(height);
    let sine = (big - small) / slant;
    let angle = FRAC_PI_2 * sine;
    let cone = Surface::cone([big, small], height, [0.0, 90.0]).unwrap();
    for start in [FlattenStart::Unrolled, FlattenStart::Rectangle] {
        let Flattened { sheet, report, .. } = flat(&cone, &FlattenOptions { start, ..options([12, 7]) });
        let corners = [[0, 0], [12, 0], [12, 7], [0, 7]].map(|[i, j]| sheet.flat()[i * 8 + j]);
        let chord = |radius: f64| 2.0 * radius / sine * (0.5 * angle).sin();
        let sides = [chord(big), slant, chord(small), slant];
        for (k, side) in sides.into_iter().enumerate() {
            let found = corners[k].distance(corners[(k + 1) % 4]);
            assert!((found - side).abs() < 1e-6, "side {k}: {found} for {side}");
        }
        assert!(report.length_error.max < 1e-6 && report.area_error.max < 1e-6);
        assert!(report.stretch < 1e-4 && report.compression < 1e-4);
    }
}

#[test]
fn an_apex_is_one_point_of_a_sector() {
    let cone = Surface::cone([1.0, 0.0], 1.0, [0.0, 200.0]).unwrap();
    let Flattened { sheet, report, .. } = flat(&cone, &options([10, 6]));
    let apex: Vec<DVec2> = (0..=10).map(|i| sheet.flat()[i * 7 + 6]).collect();
    assert!(apex.iter().all(|p| p.distance(apex[0]) < 1e-12));
    assert!(report.length_error.max < 1e-12 && report.folds.is_empty());
}

#[test]
fn an_extrusion_is_as_wide_as_its_profile_is_long() {
    let points = [[0.0, 0.0], [0.4, 0.9], [1.1, -0.6], [1.7, 0.2]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let curve = Curve::new(Basis::clamped(4, 3).unwrap(), points.to_vec(), None).unwrap();
    // By the trapezoidal rule and Richardson.
    let speed = |u: f64| curve.jet(u).first.length();
    let trapezoid = |n: usize| {
        let inner: f64 = (1..n).map(|k| speed(k as f64 / n as f64)).sum();
        (inner + 0.5 * (speed(0.0) + speed(1.0))) / n as f64
    };
    let length = (4.0 * trapezoid(20_000) - trapezoid(10_000)) / 3.0;
    let surface = Surface::extrusion(curve, DVec3::new(0.0, 0.8, 0.0)).unwrap();
    let Flattened { sheet, report, .. } = flat(&surface, &options([16, 4]));
    assert!((extent(sheet.flat()) - DVec2::new(length, 0.8)).length() < 1e-9);
    assert!(report.length_error.max < 1e-9);
}

/// The profile `z = 2 x (1 − x)` of Bézier points on itself: as a cubic, `x = u`, `z = (4/3) u (1 − u)`.
#[test]
fn a_developable_patch_is_isometric_without_a_closed_form() {
    let integral = |slope: f64| 0.5 * (slope * slope.hypot(1.0) + slope.asinh());
    let length = 2.0 * integral(4.0 / 3.0) / (8.0 / 3.0);
    for cells in [[6, 4], [17, 9]] {
        let Flattened { sheet, report, .. } = flat(&bent(), &options(cells));
        let off = extent(sheet.flat()) - DVec2::new(length, 0.8);
        assert!(off.abs().max_element() < 1e-6, "{off}");
        assert!(report.length_error.max < 2e-6, "{:?}", report.length_error);
        assert!(report.length_accuracy <= 1e-6);
    }
}

#[test]
fn lengths_are_better_than_the_sheet() {
    for (height, cells) in [(0.4, [8, 7]), (0.05, [8, 7]), (0.01, [12, 12]), (0.001, [6, 6])] {
        let report = flat(&waves(height), &options(cells)).report;
        let needed = f64::max(0.2 * report.length_error.rms, 1e-6);
        assert!(
            report.length_accuracy <= needed,
            "{height}: {} for {}",
            report.length_accuracy,
            report.length_error.rms
        );
    }
    let fine = FlattenOptions { accuracy: 1e-7, ..options([8, 7]) };
    assert!(flat(&waves(0.4), &fine).report.length_accuracy <= 1e-7);
}

#[test]
fn the_gradient_vanishes() {
    let surface = waves(0.4);
    let options = FlattenOptions { tolerance: 1e-12, accuracy: 5e-7, ..options([8, 7]) };
    let Flattened { sheet, report, .. } = flat(&surface, &options);
    let x = sheet.flat();
    let mut gradient = vec![DVec2::ZERO; x.len()];
    let (mut stress, mut longest) = (0.0, 0.0_f64);
    for (i, j, d) in pairs(&surface, &sheet, 3) {
        let apart = x[i] - x[j];
        let off = apart.length() - d;
        stress += off * off;
        gradient[i] += 4.0 * off * apart.normalize();
        longest = longest.max(d);
    }
    assert!((report.stress / stress - 1.0).abs() < 1e-4, "{} and {stress}", report.stress);
    let largest = gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
    // Of 48 lengths each is known to 1e-6.
    assert!(largest < 4.0 * 48.0 * 1e-6 * longest, "{largest} for lengths up to {longest}");
    assert!(report.stress < 0.2 * report.start_stress);
}

#[test]
fn other_starts_come_to_the_same_stress() {
    let unrolled = flat(&waves(0.3), &options([9, 9]));
    let rectangle = flat(&waves(0.3), &FlattenOptions { start: FlattenStart::Rectangle, ..options([9, 9]) });
    let mut random = Random(3);
    let shaken = unrolled.sheet.flat().iter().map(|p| *p + 0.02 * random.vector().truncate()).collect();
    let shaken = flat(&waves(0.3), &FlattenOptions { start: FlattenStart::Places(shaken), ..options([9, 9]) });
    for other in [rectangle, shaken] {
        assert!((other.report.stress / unrolled.report.stress - 1.0).abs() < 2e-6);
    }
}

#[test]
fn the_papers_descent_comes_to_the_same_stress_with_a_small_step() {
    let best = flat(&waves(0.3), &options([7, 7])).report;
    let method = FlattenMethod::Descent { step: 1.0 / (4.0 * 48.0) };
    let descent = FlattenOptions { method, tolerance: 1e-9, iterations: 100_000, ..options([7, 7]) };
    let report = flat(&waves(0.3), &descent).report;
    assert!(report.stress > best.stress * (1.0 - 1e-6) && report.stress < best.stress * (1.0 + 1e-3));
    assert!(report.iterations > 5 * best.iterations);
}

#[test]
fn a_descent_with_a_large_step_runs_away_and_says_so() {
    let method = FlattenMethod::Descent { step: 0.1 };
    let report = flatten(&waves(0.3), &FlattenOptions { method, ..options([7, 7]) }).unwrap().report;
    assert_eq!(report.status, FlattenStatus::Diverged);
    assert!(report.stress <= report.start_stress);
}

#[test]
fn a_search_that_takes_all_its_steps_says_so() {
    let report = flatten(&waves(0.3), &FlattenOptions { iterations: 2, ..options([7, 7]) }).unwrap().report;
    assert_eq!((report.status, report.iterations), (FlattenStatus::IterationLimit, 2));
}

/// The paper's figures 1 and 2: with a reach of 1 the result is unusable, with 3 it is not.
#[test]
fn a_short_reach_folds_in_the_papers_descent() {
    let surface = waves(2.0);
    let parameters = |k: usize| DVec2::new((k / 17) as f64, (k % 17) as f64) / 16.0;
    let report = |reach: usize| {
        let start = FlattenStart::Places((0..17 * 17).map(parameters).collect());
        let method = FlattenMethod::Descent { step: 0.004 };
        let options = FlattenOptions { reach, start, method, tolerance: 1e-8, iterations: 20_000, ..options([16, 16]) };
        flat(&surface, &options).report
    };
    let [near, far] = [1, 3].map(report);
    assert!(!near.folds.is_empty() && far.folds.is_empty());
    // It is folded because that is less stress than there is without.
    let sound = flat(&surface, &FlattenOptions { reach: 1, ..options([16, 16]) }).report;
    assert!(sound.folds.is_empty() && sound.stress > near.stress);
}

/// The paper's section 3.1: "when the number of grids is increased, the result with a small r becomes unusable".
#[test]
fn a_short_reach_folds_from_an_unrolled_start_too_where_cells_are_small() {
    let report = |reach: usize| flat(&waves(2.0), &FlattenOptions { reach, ..options([30, 30]) }).report;
    assert!(!report(1).folds.is_empty());
    assert!(report(3).folds.is_empty());
}

#[test]
fn relative_weights_make_for_smaller_relative_errors() {
    let surface = bezier(|x, y, z| DVec3::new(x * x, y, 0.3 * z));
    let uniform = flat(&surface, &options([10, 10])).report;
    let weights = FlattenWeights::Relative;
    let relative = flat(&surface, &FlattenOptions { weights, ..options([10, 10]) }).report;
    assert!(relative.length_error.rms < uniform.length_error.rms);
}

#[test]
fn a_sheet_has_its_place() {
    let [m, n] = [9, 8];
    let sheet = flat(&waves(0.3), &options([m, n])).sheet;
    let x = sheet.flat();
    let low = x.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = x.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    assert!((low + high).length() < 1e-15);
    let along = x[5 * (n + 1) + 4] - x[4 * (n + 1) + 4];
    assert!(along.x > 0.0 && along.y.abs() < 1e-12);
    let up = x[4 * (n + 1) + 5] - x[4 * (n + 1) + 3];
    assert!(along.perp_dot(up) > 0.0);
}

#[test]
fn a_mirrored_start_is_mirrored_back() {
    let sheet = flat(&waves(0.3), &options([9, 9])).sheet;
    let mirrored = sheet.flat().iter().map(|p| DVec2::new(-p.x, p.y)).collect();
    let start = FlattenStart::Places(mirrored);
    let again = flat(&waves(0.3), &FlattenOptions { start, ..options([9, 9]) }).sheet;
    assert!(again.flat().iter().zip(sheet.flat()).all(|(p, q)| p.distance(*q) < 1e-4));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn rigid_motions_scales_and_mirrors_of_the_surface_change_nothing(
        seed in any::<u64>(), exponent in -20..20_i32, mirror in any::<bool>()
    ) {
        let mut random = Random(seed);
        let turn = DMat3::from_rotation_y(3.0 * random.vector().x) * DMat3::from_rotation_x(3.0 * random.vector().y);
        let scale = 10.0_f64.powi(exponent);
        let flip = DVec3::new(1.0, 1.0, if mirror { -1.0 } else { 1.0 });
        let offset = random.vector();
        let point = |x: f64, y: f64, z: f64| DVec3::new(x + 0.3 * x * y * y, y - 0.2 * x * (1.0 - y), 0.3 * z);
        let there = bezier(|x, y, z| scale * (turn * (flip * point(x, y, z)) + offset));
        let options = FlattenOptions { tolerance: 1e-9, ..options([6, 7]) };
        let [here, there] = [bezier(point), there].map(|surface| flat(&surface, &options));
        prop_assert!((there.report.stress / (scale * scale * here.report.stress) - 1.0).abs() < 1e-6);
        for (p, q) in here.sheet.flat().iter().zip(there.sheet.flat()) {
            prop_assert!(p.distance(*q / scale) < 1e-4, "{p} {q}");
        }
    }
}

#[test]
fn bits_are_the_same_for_any_number_of_threads() {
    let in_pool = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| flatten(&waves(0.3), &options([40, 40])).unwrap())
    };
    assert_eq!(in_pool(1), in_pool(3));
}

#[test]
fn a_single_cell_is_a_sheet() {
    let report = flat(&waves(0.3), &options([1, 1])).report;
    assert!(report.folds.is_empty() && report.length_error.max < 0.1);
}

#[test]
fn a_ball_is_flattened_with_its_poles() {
    let ball = Surface::sphere(1.0, [0.0, 360.0], [-90.0, 90.0]).unwrap();
    let Flattened { sheet, report, .. } = flat(&ball, &options([12, 8]));
    assert!(sheet.flat().iter().all(|p| p.is_finite()));
    // Nothing that is cut along a meridian only is flat: area 4π, Gauss.
    assert!(report.stretch > 10.0 && report.area_error.rms > 0.01);
}

#[test]
fn part_of_a_sphere_is_stretched_in_the_middle_or_at_the_border() {
    let cap = Surface::sphere(1.0, [0.0, 40.0], [-20.0, 20.0]).unwrap();
    let report = flat(&cap, &options([8, 8])).report;
    // K = 1 over a radius ρ of about 20°: strains are of the order ρ²/12 to ρ²/4.
    let rho: f64 = 20.0 * PI / 180.0;
    assert!(report.stretch > 100.0 * rho * rho / 24.0 && report.stretch < 100.0 * rho * rho / 2.0);
    assert!(report.folds.is_empty());
}

#[test]
fn what_cannot_be_flattened_is_refused() {
    let surface = waves(0.3);
    let refused = |options: FlattenOptions| flatten(&surface, &options).unwrap_err();
    assert_eq!(refused(options([0, 3])), FlattenError::NoCells { cells: [0, 3] });
    assert_eq!(refused(FlattenOptions { reach: 0, ..options([3, 3]) }), FlattenError::NoReach);
    for accuracy in [0.0, -1.0, f64::INFINITY] {
        assert_eq!(refused(FlattenOptions { accuracy, ..options([3, 3]) }), FlattenError::Accuracy(accuracy));
    }
    assert_eq!(refused(FlattenOptions { tolerance: -1.0, ..options([3, 3]) }), FlattenError::Tolerance(-1.0));
    for step in [0.0, -1.0, f64::INFINITY] {
        let method = FlattenMethod::Descent { step };
        assert_eq!(refused(FlattenOptions { method, ..options([3, 3]) }), FlattenError::Step(step));
    }
    let start = FlattenStart::Places(vec![DVec2::ZERO; 3]);
    assert_eq!(refused(FlattenOptions { start, ..options([3, 3]) }), FlattenError::Places { places: 3, points: 16 });
    let start = FlattenStart::Places(vec![DVec2::NAN; 16]);
    assert_eq!(refused(FlattenOptions { start, ..options([3, 3]) }), FlattenError::PlaceNotFinite { index: 0 });
}

#[test]
fn relative_weights_have_none_for_poles() {
    let cone = Surface::cone([1.0, 0.0], 1.0, [0.0, 200.0]).unwrap();
    let weights = FlattenWeights::Relative;
    let error = flatten(&cone, &FlattenOptions { weights, ..options([4, 4]) }).unwrap_err();
    assert!(matches!(error, FlattenError::NoWeight { from, to } if from.y == 1.0 && to.y == 1.0), "{error}");
}

#[test]
fn a_patch_with_a_pole_is_refused_with_its_place() {
    let triangle = bezier(|x, y, z| DVec3::new(x * y, y, 0.3 * z * y));
    let error = flatten(&triangle, &options([4, 4])).unwrap_err();
    assert!(matches!(error, FlattenError::NoTangentPlane { at } if at.y == 0.0), "{error}");
}

#[test]
fn a_start_on_one_line_or_point_is_left() {
    for places in [vec![DVec2::ZERO; 49], (0..49).map(|k| DVec2::new(f64::from(k), 0.0)).collect()] {
        let start = FlattenStart::Places(places);
        let flattened = flatten(&waves(0.3), &FlattenOptions { start, ..options([6, 6]) }).unwrap();
        assert!(flattened.sheet.flat().iter().all(|p| p.is_finite()));
    }
}

/// L-BFGS-B of SciPy on the same stress, from the same start.
#[test]
#[ignore = "needs python3 with SciPy on the path"]
fn scipy_finds_no_less_stress() {
    for (surface, cells) in [(waves(0.3), [10, 10]), (waves(1.0), [16, 16]), (bent(), [8, 8])] {
        // The same lengths there.
        let options = FlattenOptions { start: FlattenStart::Rectangle, accuracy: 1e-9, ..options(cells) };
        let start = flatten(&surface, &FlattenOptions { iterations: 0, ..options.clone() }).unwrap();
        let sheet = flat(&surface, &options).sheet;
        let mut text = String::new();
        for p in start.sheet.flat() {
            writeln!(text, "{} {}", p.x, p.y).unwrap();
        }
        let pairs = pairs(&surface, &start.sheet, 3);
        pairs.iter().for_each(|(i, j, d)| writeln!(text, "{i} {j} {d}").unwrap());
        let file = std::env::temp_dir().join(format!("isochor-stress-{}.txt", std::process::id()));
        std::fs::write(&file, text).unwrap();
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reference/stress.py");
        let output = Command::new("python3").args([script.as_ref(), file.as_os_str()]).output().unwrap();
        std::fs::remove_file(file).unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let found: f64 = String::from_utf8(output.stdout).unwrap().trim().parse().unwrap();
        let x = sheet.flat();
        let squares = |(i, j, d): &(usize, usize, f64)| (x[*i].distance(x[*j]) - d) * (x[*i].distance(x[*j]) - d);
        let here: f64 = pairs.iter().map(squares).sum();
        // What is isometric to 1e-7 is not searched further.
        let isometric: f64 = pairs.iter().map(|(_, _, d)| 1e-14 * d * d).sum();
        assert!(here <= found * (1.0 + 1e-6) + isometric, "{here} here, {found} there");
    }
}
