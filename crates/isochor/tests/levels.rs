//! Levels of detail: indices, sizes, and errors that fall as their estimate says.

mod random;

use std::borrow::Cow;

use glam::DVec3;
use isochor::shapes::{chain, cube, hollow_sphere, icosphere, screwdriver, uv_torus};
use isochor::{
    Basis, Bounds, Faces, Frame, Lattice, Level, LevelOptions, Levels, Mesh, OpenBoundaries, Outside, ParametricSolid,
    Solid, TriangleError, topology,
};
use proptest::prelude::*;
use random::Random;

fn solid(mesh: &Mesh) -> Solid {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap()
}

/// Without the faces round its north pole.
fn open_ball() -> Mesh {
    let ball = icosphere(4);
    let is_low = |face: &&[u32]| face.iter().all(|v| ball.points()[*v as usize].z < 0.8);
    let faces: Faces = ball.faces().iter().filter(is_low).collect();
    Mesh::new(ball.points().to_vec(), faces).unwrap()
}

fn triangles(level: &Level) -> usize {
    level.solid.triangle_count()
}

/// Fails where the volume changes when the vertices, anywhere, are moved by one vector: unless the body is closed.
fn assert_closed(solid: &Solid, random: &mut Random) {
    let anywhere: Vec<DVec3> = (0..solid.vertex_count()).map(|_| random.vector()).collect();
    let along_translations: DVec3 = solid.volume_gradient(&anywhere).iter().sum();
    assert!(along_translations.length() < 1e-10, "{along_translations}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn levels_of_meshes_keep_vertices(shape in 0..5_usize, factor in 2..9_usize, coarsest in 1..800_usize, seed: u64) {
        let mesh = [icosphere(4), uv_torus(1.0, 0.3, 60, 24), hollow_sphere(4, 0.6), screwdriver(40), open_ball()][shape].clone();
        let model = solid(&mesh);
        let levels = Levels::of_mesh(&model, mesh.points(), &LevelOptions { factor, coarsest });
        let (last, coarse) = levels.as_slice().split_last().unwrap();
        prop_assert!(matches!((&last.solid, &last.points), (Cow::Borrowed(_), Cow::Borrowed(_))));
        prop_assert!(last.vertices.is_none());
        for level in coarse {
            let vertices = level.vertices.as_ref().unwrap();
            prop_assert!(vertices.is_sorted() && vertices.len() == level.solid.vertex_count());
            prop_assert!(level.points.iter().zip(vertices).all(|(p, v)| *p == mesh.points()[*v as usize]));
            prop_assert_eq!(level.solid.component_count(), model.component_count());
            prop_assert_eq!(level.solid.cap_count(), model.cap_count());
            assert_closed(&level.solid, &mut Random(seed));
        }
        for two in levels.as_slice().windows(2) {
            prop_assert!(3 * triangles(&two[0]) <= 2 * triangles(&two[1]));
        }
        // The collapse of an edge takes two triangles, in each of two components.
        prop_assert!(triangles(&levels.as_slice()[0]) + 4 >= coarsest.min(triangles(last)));
    }
}

#[test]
fn a_sphere_loses_three_quarters_of_its_triangles_from_level_to_level() {
    let mesh = icosphere(5);
    let model = solid(&mesh);
    let levels = Levels::of_mesh(&model, mesh.points(), &LevelOptions::default());
    let counts: Vec<usize> = levels.as_slice().iter().map(triangles).collect();
    // A quarter of 320 may enclose a tenth less, and then has twice as many.
    assert!(counts.len() == 5 && [80, 160].contains(&counts[0]), "{counts:?}");
    assert_eq!(counts[1..], [320, 1280, 5120, 20480]);
}

#[test]
fn what_cannot_be_made_coarser_is_its_only_level() {
    // Cubes that lose volume with any vertex; few triangles.
    let cubes = |count: usize| {
        let one = cube(1);
        let points =
            (0..count).flat_map(|k| one.points().iter().map(move |p| *p + 3.0 * k as f64 * DVec3::X)).collect();
        let moved =
            |k: usize| one.faces().iter().map(move |face| face.iter().map(|v| v + 8 * k as u32).collect::<Vec<_>>());
        let faces: Vec<Vec<u32>> = (0..count).flat_map(moved).collect();
        Mesh::new(points, faces.iter().map(Vec::as_slice).collect()).unwrap()
    };
    for mesh in [cubes(200), cubes(5), icosphere(1)] {
        let model = solid(&mesh);
        let levels = Levels::of_mesh(&model, mesh.points(), &LevelOptions::default());
        assert_eq!(levels.as_slice().len(), 1);
    }
    let links = chain(5, 36, 12);
    assert!(Levels::of_mesh(&solid(&links), links.points(), &LevelOptions::default()).as_slice().len() > 1);
}

#[test]
fn samples_of_a_torus_have_the_papers_numbers_of_triangles() {
    let torus = ParametricSolid::torus(1.0, 0.4).unwrap();
    let sizes = |finest: usize, factor: usize, coarsest: usize| {
        let levels = Levels::of_samples(&torus, finest, &LevelOptions { factor, coarsest }).unwrap();
        assert!(levels.as_slice().iter().all(|level| level.vertices.is_none()));
        levels.as_slice().iter().map(triangles).collect::<Vec<_>>()
    };
    assert_eq!(sizes(4096, 4, 64), [64, 256, 1024, 4096]);
    assert_eq!(sizes(4096, 4, 257), [1024, 4096]);
    // 4 · 33² with steps four times as long: m = 33, 8.25.
    assert_eq!(sizes(4097, 16, 64), [256, 4356]);
    // 4 m² with m = 32, 22.6, 16, …
    assert_eq!(sizes(4096, 2, 400), [484, 1024, 2116, 4096]);
    assert_eq!(sizes(0, 4, 64), [64]);
}

#[test]
fn an_error_of_c_over_n_is_found_and_met() {
    let volume = |n: usize| 3.0 + 12.0 / n as f64;
    let error = TriangleError::between([64, 256], [64, 256].map(volume));
    assert!((error.c - 12.0).abs() < 1e-12 && (error.at(1000) - 0.012).abs() < 1e-15);
    let falling = TriangleError { c: -12.0 };
    assert_eq!((falling.triangles(0.01), falling.triangles(0.007)), (1200, 1715));
}

/// HML's torus compression, in nodes of 3 × 3 × 3: the upper and lower ones 40 % nearer to the middle, and those between moved outwards by 30 %.
fn squash(bounds: Bounds) -> (Lattice, Vec<DVec3>) {
    let bases = [3; 3].map(|n| Basis::bernstein(n).unwrap());
    let lattice = Lattice::new(bases, Frame::fitted(bounds, 0.01).unwrap()).unwrap();
    let moved = |(c, rest): (usize, &DVec3)| {
        let d = *rest - bounds.center();
        if lattice.node(c)[2] == 1 { 0.3 * DVec3::new(d.x, d.y, 0.0) } else { -0.4 * DVec3::new(0.0, 0.0, d.z) }
    };
    let displacement = lattice.rest().iter().enumerate().map(moved).collect();
    (lattice, displacement)
}

/// ΔV of triangles against ΔV by quadrature: two levels predict the errors of both within 13 %, and N R(N) is the same on both within 10 %.
#[test]
fn two_levels_predict_the_error() {
    let bodies = [
        ("sphere", ParametricSolid::sphere(1.0).unwrap()),
        ("torus", ParametricSolid::torus(1.0, 0.4).unwrap()),
        ("club", ParametricSolid::club()),
    ];
    for (name, body) in bodies {
        let levels = Levels::of_samples(&body, 16384, &LevelOptions::default()).unwrap();
        let bounds = Bounds::of(&levels.as_slice().last().unwrap().points).unwrap();
        let (lattice, displacement) = squash(bounds);
        let change = |level: &Level| {
            let binding = lattice.bind(&level.points, Outside::Refuse).unwrap();
            let posed = binding.displaced(&level.points, &displacement);
            level.solid.volume(&posed) - level.solid.volume(&level.points)
        };
        let changes: Vec<f64> = levels.as_slice().iter().map(change).collect();
        let exact = body.clone().deformed(lattice.clone(), displacement.clone()).volume().unwrap().volume
            - body.volume().unwrap().volume;
        assert!(levels.as_slice().len() > 3 && exact < -0.1 * body.volume().unwrap().volume);
        for (two, changes) in levels.as_slice().windows(2).zip(changes.windows(2)) {
            let counts = [triangles(&two[0]), triangles(&two[1])];
            let estimate = TriangleError::between(counts, [changes[0], changes[1]]);
            let scaled = [0, 1].map(|k| counts[k] as f64 * (changes[k] - exact));
            for scaled in scaled {
                assert!((estimate.c / scaled - 1.0).abs() < 0.13, "{name}, {counts:?}: {} for {scaled}", estimate.c);
            }
            assert!((scaled[0] / scaled[1] - 1.0).abs() < 0.1, "{name}, {counts:?}: {scaled:?}");
        }
    }
}
