//! Where volume was lost: closed forms, invariance, and what jobs do with it.

mod random;

use glam::{DMat3, DVec3};
use isochor::shapes::cube;
use isochor::{
    Basis, Frame, Lattice, LocalityOptions, OpenBoundaries, Outside, Solid, displaced, local_mobility, topology,
    volume_loss,
};
use random::Random;

fn lattice(bases: [Basis; 3]) -> Lattice {
    Lattice::new(bases, Frame { origin: DVec3::ZERO, axes: DVec3::AXES }).unwrap()
}

fn clamped(size: [usize; 3], degree: usize) -> Lattice {
    lattice(size.map(|size| Basis::clamped(size, degree.min(size - 1)).unwrap()))
}

/// The displacement that takes the controls to `f` of their rest positions.
fn displacement(lattice: &Lattice, mut f: impl FnMut([usize; 3], DVec3) -> DVec3) -> Vec<DVec3> {
    lattice.rest().iter().enumerate().map(|(c, p)| f(lattice.node(c), *p) - *p).collect()
}

/// A wanted volume of r times that at rest, losses counting.
fn wanted(wanted: f64) -> LocalityOptions<'static> {
    LocalityOptions { wanted, posed: wanted, ..LocalityOptions::default() }
}

fn assert_near(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (c, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "control {c}: {a} instead of {b}");
    }
}

fn all_kinds() -> Vec<Lattice> {
    vec![
        clamped([5, 4, 6], 3),
        clamped([2, 3, 4], 1),
        lattice([4, 5, 6].map(|size| Basis::uniform(size, 3).unwrap())),
        lattice([2, 4, 9].map(|size| Basis::bernstein(size).unwrap())),
        lattice([0; 3].map(|_| Basis::with_knots(vec![0.0, 0.0, 0.0, 0.25, 0.25, 0.6, 1.0, 1.0, 1.0], 2).unwrap())),
    ]
}

#[test]
fn where_nothing_is_lost_mobility_is_uniform() {
    let turn = DMat3::from_rotation_y(1.0) * DMat3::from_rotation_x(2.0);
    let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.7, 1.0, -0.3), DVec3::Z);
    for lattice in all_kinds() {
        for map in [DMat3::IDENTITY, turn, shear] {
            let moves =
                displacement(&lattice, |_, p| map * p + DVec3::new(3.0, 2.0, 1.0) * f64::from(map != DMat3::IDENTITY));
            let options = LocalityOptions::default();
            assert_eq!(volume_loss(&lattice, &moves, &options), vec![0.0; moves.len()]);
            assert_eq!(local_mobility(&lattice, &moves, &options), vec![1.0; moves.len()]);
            // Another volume is missing everywhere alike.
            assert_near(&volume_loss(&lattice, &moves, &wanted(1.25)), &vec![0.25; moves.len()], 1e-13);
            assert_near(&local_mobility(&lattice, &moves, &wanted(1.25)), &vec![1.0; moves.len()], 1e-12);
        }
    }
}

#[test]
fn an_affine_map_loses_its_determinant_everywhere() {
    let map = DMat3::from_cols(DVec3::new(0.5, 0.1, 0.0), DVec3::new(-0.2, 0.9, 0.3), DVec3::new(0.0, 0.1, 0.8));
    for lattice in all_kinds() {
        let moves = displacement(&lattice, |_, p| map * p);
        let expected = vec![1.0 - map.determinant(); moves.len()];
        assert_near(&volume_loss(&lattice, &moves, &LocalityOptions::default()), &expected, 1e-13);
        // As a gain, where the body is too large.
        let moves = displacement(&lattice, |_, p| map.inverse() * p);
        let expected = vec![1.0 / map.determinant() - 1.0; moves.len()];
        let options = LocalityOptions { posed: 1.5, wanted: 1.0, ..LocalityOptions::default() };
        assert_near(&volume_loss(&lattice, &moves, &options), &expected, 1e-12);
        assert_eq!(volume_loss(&lattice, &moves, &LocalityOptions::default()), vec![0.0; moves.len()]);
    }
}

#[test]
fn linear_layers_share_the_loss_of_their_cells() {
    // Three layers of linear cells; the upper half of the upper cell is cut off: det J = 1, 1/2.
    let lattice = clamped([2, 2, 3], 1);
    let moves = displacement(&lattice, |[.., k], p| p - DVec3::Z * if k == 2 { 0.25 } else { 0.0 });
    let layers = [0.0, 0.25, 0.5];
    let expected: Vec<f64> = (0..12).map(|c| layers[c % 3]).collect();
    assert_near(&volume_loss(&lattice, &moves, &LocalityOptions::default()), &expected, 1e-15);
    let m = local_mobility(&lattice, &moves, &LocalityOptions::default());
    assert!((0..12).all(|c| c % 3 != 0 || m[c] == 0.0));
    assert_near(&m, &expected.iter().map(|x| 2.0 * x).collect::<Vec<_>>(), 1e-15);
}

#[test]
fn a_bernstein_lattice_has_a_closed_form() {
    // d = −h w² along w: det J = 1 − 2 h w, and ∫ B_k w / ∫ B_k = 1/4, 1/2, 3/4 for k = 0, 1, 2.
    let lattice = lattice([4, 2, 3].map(|size| Basis::bernstein(size).unwrap()));
    let h = 0.3;
    let moves = displacement(&lattice, |[.., k], p| p - DVec3::Z * if k == 2 { h } else { 0.0 });
    let layers = [0.25, 0.5, 0.75];
    let expected: Vec<f64> = (0..24).map(|c| 2.0 * h * layers[c % 3]).collect();
    assert_near(&volume_loss(&lattice, &moves, &LocalityOptions::default()), &expected, 1e-15);
}

#[test]
fn losses_add_up_to_the_volume_of_the_deformed_box() {
    // Σ ℓ_i ∫ B_i = ∫ (r − det J) = r − V, with ∫ B_i = (t_{i+p+1} − t_i) / (p + 1) on clamped knots and r so large that no
    // det J is larger. V is that of finer and finer meshes, extrapolated twice in h².
    let mut random = Random(1);
    for lattice in [clamped([5, 4, 6], 3), lattice([3, 5, 4].map(|size| Basis::bernstein(size).unwrap()))] {
        let moves = displacement(&lattice, |_, p| p + 0.1 * random.vector());
        let losses = volume_loss(&lattice, &moves, &wanted(20.0));
        let integral = |a: usize, i: usize| {
            let (basis, p) = (&lattice.bases()[a], lattice.bases()[a].degree());
            (basis.knots()[i + p + 1] - basis.knots()[i]) / (p + 1) as f64
        };
        let weight = |c: usize| -> f64 { (0..3).map(|a| integral(a, lattice.node(c)[a])).product() };
        let total: f64 = losses.iter().enumerate().map(|(c, loss)| loss * weight(c)).sum();
        let [v1, v2, v3] = [12, 24, 48].map(|n| {
            let mesh = cube(n);
            let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
            let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
            solid.volume(&displaced(mesh.points(), &binding.apply(&moves)))
        });
        let (a, b) = (v2 + (v2 - v1) / 3.0, v3 + (v3 - v2) / 3.0);
        let expected = b + (b - a) / 15.0;
        assert!((20.0 - total - expected).abs() <= 1e-7, "{} instead of {expected}", 20.0 - total);
    }
}

#[test]
fn mobility_does_not_depend_on_where_and_how_large_a_model_is() {
    let mut random = Random(2);
    let here = clamped([5, 4, 6], 3);
    let moves = displacement(&here, |_, p| p + 0.15 * random.vector());
    let points = cube(5).points().iter().map(|p| *p * 0.6).collect::<Vec<_>>();
    let options = LocalityOptions { vertices: &points, posed: 0.9, ..LocalityOptions::default() };
    let expected = local_mobility(&here, &moves, &options);
    assert!(expected.contains(&1.0) && expected.iter().any(|m| *m < 0.1));
    let turn = DMat3::from_rotation_y(1.0) * DMat3::from_rotation_x(2.0);
    let mirror = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    for map in [turn, mirror, 1e-5 * turn, 1e7 * turn] {
        let shift = map * DVec3::new(30.0, -20.0, 10.0);
        let frame = Frame { origin: shift, axes: DVec3::AXES.map(|a| map * a) };
        let there = Lattice::new(here.bases().clone(), frame).unwrap();
        let moves: Vec<DVec3> = moves.iter().map(|d| map * *d).collect();
        let points: Vec<DVec3> = points.iter().map(|p| map * *p + shift).collect();
        let found = local_mobility(&there, &moves, &LocalityOptions { vertices: &points, ..options });
        assert_near(&found, &expected, 1e-12);
    }
}

#[test]
fn parts_that_only_turn_have_lost_nothing() {
    // Linear cells: what turns and moves as a whole keeps its volume, what is between does not.
    let lattice = clamped([3, 3, 7], 1);
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(0.4);
    let moves = displacement(&lattice, |[.., k], p| if k >= 4 { turn * p + DVec3::X } else { p });
    let m = local_mobility(&lattice, &moves, &LocalityOptions { wanted: 2.0, ..LocalityOptions::default() });
    assert!(m.iter().all(|m| *m > 0.0), "all want to be twice as large");
    let m = local_mobility(&lattice, &moves, &LocalityOptions::default());
    for (c, m) in m.iter().enumerate() {
        assert!([3, 4].contains(&(c % 7)) || *m == 0.0, "layer {} has mobility {m}", c % 7);
    }
    assert!(m.contains(&1.0));
}

#[test]
fn places_that_gained_do_not_make_up_for_those_that_lost() {
    // The lower end is half as wide, the upper one larger by a tenth.
    let lattice = clamped([2, 2, 9], 1);
    let scaled =
        |[.., k]: [usize; 3], p: DVec3| p * DVec3::new([0.5, 1.0, 1.1][k.saturating_sub(3).min(4) / 2], 1.0, 1.0);
    let moves = displacement(&lattice, scaled);
    let lost = local_mobility(&lattice, &moves, &LocalityOptions { posed: 0.9, ..LocalityOptions::default() });
    let gained = local_mobility(&lattice, &moves, &LocalityOptions { posed: 1.1, ..LocalityOptions::default() });
    for c in 0..lost.len() {
        let k = c % 9;
        assert!((lost[c] > 0.0) == (k <= 5), "{k}: {}", lost[c]);
        assert!((gained[c] > 0.0) == (k >= 6), "{k}: {}", gained[c]);
    }
    assert!(lost[0] == 1.0 && gained[8] == 1.0);
}

#[test]
fn cells_without_vertices_do_not_count() {
    // Layers of four linear cells; the top one is crushed most, but the model ends below it.
    let lattice = clamped([2, 2, 5], 1);
    let heights = [0.0, 0.25, 0.5, 0.7, 0.75];
    let moves = displacement(&lattice, |[.., k], p| DVec3::new(p.x, p.y, heights[k]));
    let losses = |vertices: &[DVec3], outside| {
        volume_loss(&lattice, &moves, &LocalityOptions { vertices, outside, ..LocalityOptions::default() })[..5]
            .to_vec()
    };
    assert_near(&losses(&[], Outside::Keep), &[0.0, 0.0, 0.1, 0.5, 0.8], 1e-14);
    let low = DVec3::new(0.5, 0.5, 0.6);
    assert_near(&losses(&[low], Outside::Keep), &[0.0, 0.0, 0.2, 0.2, 0.0], 1e-14);
    // A vertex on a border belongs to both cells.
    let border = DVec3::new(0.5, 0.5, 0.75 + 1e-12);
    assert_near(&losses(&[border], Outside::Keep), &[0.0, 0.0, 0.2, 0.5, 0.8], 1e-14);
    // One outside counts where it follows the lattice.
    let above = DVec3::new(0.5, 0.5, 1.5);
    assert_near(&losses(&[low, above], Outside::Keep), &[0.0, 0.0, 0.2, 0.2, 0.0], 1e-14);
    assert_near(&losses(&[low, above], Outside::Extend), &[0.0, 0.0, 0.2, 0.5, 0.8], 1e-14);
    let nobody =
        local_mobility(&lattice, &moves, &LocalityOptions { vertices: &[above], ..LocalityOptions::default() });
    assert_eq!(nobody, vec![1.0; 20]);
}

#[test]
fn numbers_out_of_range_do_not_panic() {
    let lattice = clamped([3, 3, 3], 2);
    let moves = displacement(&lattice, |[i, ..], p| if i == 1 { DVec3::splat(1e200) } else { p });
    let m = local_mobility(&lattice, &moves, &LocalityOptions::default());
    assert!(m.iter().all(|m| (0.0..=1.0).contains(m)));
}

#[cfg(feature = "serde")]
mod jobs {
    use glam::DVec3;
    use isochor::shapes::cube;
    use isochor::{Job, JobError, JobInput, Mesh, Outcome, Source};

    fn run(mesh: &Mesh, preserve: &str) -> Result<Outcome, JobError> {
        let job = format!(
            "lattice = {{ size = [4, 4, 8] }}\npreserve = {{ {preserve} }}\n[[edit]]\n\
             scale = {{ by = [0.5, 0.5, 1], nodes = {{ k = [6, 7] }} }}"
        );
        Job::from_toml(&job)
            .unwrap()
            .run(&JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage: None }, &mut |_| {})
    }

    fn bits(p: DVec3) -> [u64; 3] {
        p.to_array().map(f64::to_bits)
    }

    #[test]
    fn controls_where_nothing_was_lost_keep_their_bits() {
        let mesh = cube(8);
        let free = run(&mesh, "volume = \"free\"").unwrap();
        for method in ["nearest", "gradient", "axes"] {
            let local = run(&mesh, &format!("mobility = \"auto\", method = \"{method}\"")).unwrap();
            let row = local.report.volume.as_ref().unwrap().overall;
            assert!(row.relative_error.unwrap() <= 1e-13 && (row.corrected - 1.0).abs() <= 1e-13);
            // Cubic on 5 cells: layers 6 and 7 deform the two uppermost, which layers 3 to 7 touch.
            let controls = local.controls.as_ref().unwrap();
            for (c, (found, rest)) in controls.posed.iter().zip(&controls.rest).enumerate() {
                assert!(c % 8 > 2 || bits(*found) == bits(*rest), "{method}: layer {} moved", c % 8);
            }
            for (v, p) in mesh.points().iter().enumerate() {
                assert!(p.z > 0.0 || bits(local.points[v]) == bits(*p), "{method}");
            }
            // Uniformly, all of them move.
            let uniform = run(&mesh, &format!("mobility = \"uniform\", method = \"{method}\"")).unwrap();
            let moved = |v: usize| uniform.points[v] != free.points[v];
            assert!((0..mesh.points().len()).filter(|v| moved(*v)).count() > mesh.points().len() / 2);
        }
    }

    #[test]
    fn where_nothing_is_lost_auto_is_uniform() {
        let mesh = cube(4);
        let source = Source::of(&mesh);
        let run = |toml: &str| {
            let input = JobInput { mesh: &mesh, source: &source, lattice: None, surface: None, cage: None };
            Job::from_toml(toml).unwrap().run(&input, &mut |_| {}).unwrap().points
        };
        for volume in ["80%", "120%", "rest"] {
            let [auto, uniform] = ["auto", "uniform"].map(|mobility| {
                run(&format!("lattice = {{}}\npreserve = {{ volume = \"{volume}\", mobility = \"{mobility}\" }}"))
            });
            for (a, b) in auto.iter().zip(&uniform) {
                assert!(a.distance(*b) <= 1e-12, "{volume}: {a} instead of {b}");
            }
        }
    }

    #[test]
    fn pins_and_falloff_multiply_with_it() {
        let mesh = cube(8);
        let pinned =
            run(&mesh, "mobility = \"auto\", pin = { k = 7 }, falloff = { vertex = 0, radius = 0.5 }").unwrap();
        let free = run(&mesh, "volume = \"free\"").unwrap();
        let (pinned, free) = (pinned.controls.unwrap(), free.controls.unwrap());
        let moved = |k: usize| (0..128).filter(|c| c % 8 == k).any(|c| bits(pinned.posed[c]) != bits(free.posed[c]));
        assert_eq!([0, 1, 2, 3, 6, 7].map(moved), [false, false, false, true, true, false]);
    }

    #[test]
    fn what_it_makes_impossible_is_said() {
        let mesh = cube(8);
        let error = run(&mesh, "mobility = \"auto\", pin = { k = [3, 4, 5, 6, 7] }").unwrap_err();
        assert_eq!(
            (error.place().as_str(), error.code(), error.is_unreachable()),
            ("preserve.mobility", "impossible", true)
        );
        assert!(error.to_string().contains("only control points where volume was lost"), "{error}");
        assert!(error.hint().contains("uniform"));
        run(&mesh, "pin = { k = [3, 4, 5, 6, 7] }").unwrap();
        let point = "points = [{ vertex = 0, to = [-0.1, -0.1, -0.1] }]";
        let error = run(&mesh, &format!("mobility = \"auto\", {point}")).unwrap_err();
        assert_eq!((error.place().as_str(), error.code()), ("preserve.points[0]", "impossible"));
        assert!(error.to_string().contains("only control points where volume was lost"), "{error}");
        run(&mesh, point).unwrap();
    }
}
