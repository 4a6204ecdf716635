//! Bodies with fewer triangles: closed as before, the same components, nearly the same volumes.

mod random;

use glam::DVec3;
use isochor::shapes::{bottle, cube, cylinder, hollow_sphere, icosphere, plate, uv_torus};
use isochor::{
    Basis, Bounds, Faces, Frame, Lattice, Mesh, OpenBoundaries, Outside, Solid, coarse_triangles, tolerances, topology,
};
use proptest::prelude::*;
use random::Random;

fn solid(mesh: &Mesh) -> Solid {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap()
}

fn shapes() -> Vec<Mesh> {
    vec![
        cube(12),
        plate(DVec3::new(2.0, 1.0, 0.01), [30, 20]),
        icosphere(4),
        hollow_sphere(4, 0.6),
        uv_torus(1.0, 0.3, 40, 24),
        cylinder(0.5, 2.0, 40, 20),
        bottle(30, 40),
        without_faces(&icosphere(4), |center| center.z < -0.3),
        without_faces(&icosphere(4), |center| center.z.abs() > 0.8),
    ]
}

/// `mesh` without the faces whose mean corner is chosen.
fn without_faces(mesh: &Mesh, chosen: impl Fn(DVec3) -> bool) -> Mesh {
    let center = |face: &[u32]| face.iter().map(|v| mesh.points()[*v as usize]).sum::<DVec3>() / face.len() as f64;
    let faces: Faces = mesh.faces().iter().filter(|face| !chosen(center(face))).collect();
    Mesh::new(mesh.points().to_vec(), faces).unwrap()
}

/// `mesh` with corners of its own for every face, as STL files have them.
fn exploded(mesh: &Mesh) -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for face in mesh.faces().iter() {
        let first = points.len() as u32;
        points.extend(face.iter().map(|v| mesh.points()[*v as usize]));
        faces.push(&(first..points.len() as u32).collect::<Vec<_>>());
    }
    Mesh::new(points, faces).unwrap()
}

/// Both meshes as one.
fn both(a: &Mesh, b: &Mesh) -> Mesh {
    let mut faces = a.faces().clone();
    let shift = a.points().len() as u32;
    b.faces().iter().for_each(|face| faces.push(&face.iter().map(|v| v + shift).collect::<Vec<_>>()));
    Mesh::new([a.points(), b.points()].concat(), faces).unwrap()
}

fn moved(points: &[DVec3], by: DVec3) -> Vec<DVec3> {
    points.iter().map(|p| *p + by).collect()
}

fn assert_near(coarse: &Solid, fine: &Solid, points: &[DVec3]) {
    let (a, b) = (coarse.volumes(points), fine.volumes(points));
    assert_eq!(coarse.component_count(), fine.component_count());
    assert_eq!(coarse.cap_count(), fine.cap_count());
    for (a, b) in a.components.iter().zip(&b.components) {
        assert!((a - b).abs() <= (tolerances::COARSE_VOLUME + 1e-12) * b.abs(), "{a} {b}");
    }
}

/// Fails where the volume changes when the pose is translated. Only a surface that the caps close passes.
fn assert_closed(coarse: &Solid, points: &[DVec3]) {
    let (here, there) = (coarse.volumes(points), coarse.volumes(&moved(points, DVec3::new(64.0, -32.0, 16.0))));
    for (a, b) in here.components.iter().zip(&there.components) {
        assert!((a - b).abs() <= 1e-11, "{a} {b}");
    }
    let sum: DVec3 = coarse.volume_gradient(points).iter().sum(); // ∂V/∂translation
    assert!(sum.length() <= 1e-12, "{sum}");
}

#[test]
fn fewer_triangles_enclose_nearly_the_same() {
    for mesh in shapes() {
        let fine = solid(&mesh);
        let all = fine.triangle_count();
        for share in [2, 5, 10] {
            let coarse = fine.coarse(mesh.points(), all / share);
            assert!(coarse.triangle_count() < all, "{all}");
            assert!(
                coarse.triangle_count() >= all / share - 2 * coarse.component_count(),
                "{}",
                coarse.triangle_count()
            );
            assert_near(&coarse, &fine, mesh.points());
            assert_closed(&coarse, mesh.points());
        }
    }
}

#[test]
fn flat_sides_lose_their_triangles_and_no_volume() {
    let mesh = cube(16);
    let coarse = solid(&mesh).coarse(mesh.points(), 12);
    assert_eq!(coarse.triangle_count(), 12); // two for each side
    assert!((coarse.volume(mesh.points()) - 1.0).abs() <= 1e-15);
}

#[test]
fn a_body_with_few_triangles_comes_back_as_it_is() {
    for mesh in shapes() {
        let fine = solid(&mesh);
        let coarse = fine.coarse(mesh.points(), fine.triangle_count());
        assert_eq!(coarse.triangle_count(), fine.triangle_count());
        assert_eq!(coarse.volumes(mesh.points()), fine.volumes(mesh.points()));
        assert_eq!(coarse.volume_gradient(mesh.points()), fine.volume_gradient(mesh.points()));
    }
}

#[test]
fn no_component_vanishes_beside_a_large_one() {
    let small = cube(1).with_points(moved(cube(1).points(), DVec3::splat(3.0))).unwrap();
    let mesh = both(&both(&icosphere(4), &small), &hollow_sphere(1, 0.5));
    let fine = solid(&mesh);
    let coarse = fine.coarse(mesh.points(), 100);
    assert_near(&coarse, &fine, mesh.points());
    assert_eq!(coarse.volumes(mesh.points()).components[1], fine.volumes(mesh.points()).components[1]);
    assert_closed(&coarse, mesh.points());
}

#[test]
fn components_that_share_a_vertex_stay_apart() {
    let mesh = both(&cube(6), &cube(6).with_points(moved(cube(6).points(), DVec3::ONE)).unwrap());
    let fine = solid(&mesh);
    assert_eq!(fine.component_count(), 2);
    let coarse = fine.coarse(mesh.points(), 24);
    assert!(coarse.volumes(mesh.points()).components.iter().all(|v| (v - 1.0).abs() <= 1e-14));
    assert_eq!(coarse.triangle_count(), 24);
}

#[test]
fn corners_that_are_not_shared_are_welded_first() {
    let mesh = exploded(&icosphere(4));
    let fine = solid(&mesh);
    let coarse = fine.coarse(mesh.points(), 1000);
    assert!(coarse.triangle_count() <= 1000);
    assert_near(&coarse, &fine, mesh.points());
    assert_closed(&coarse, mesh.points());
}

#[test]
fn permuted_bodies_keep_their_caps() {
    let mesh = without_faces(&icosphere(4), |center| center.z < -0.3);
    let order: Vec<u32> = (0..mesh.points().len() as u32).rev().collect();
    let points: Vec<DVec3> = order.iter().map(|v| mesh.points()[*v as usize]).collect();
    let fine = solid(&mesh).permuted(&order);
    assert_eq!(fine.triangle_count(), solid(&mesh).triangle_count());
    let coarse = fine.coarse(&points, 500);
    assert!(coarse.triangle_count() < 700, "{}", coarse.triangle_count());
    assert_near(&coarse, &fine, &points);
    let scattered: Vec<DVec3> =
        points.iter().map(|p| DVec3::from_array((*p * 37.0).to_array().map(f64::sin))).collect();
    assert_closed(&coarse, &scattered);
}

#[test]
fn bodies_that_cannot_be_simplified_keep_their_triangles() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let tetrahedron =
        Mesh::new(corners.to_vec(), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].iter().collect()).unwrap();
    for mesh in [tetrahedron, cube(1)] {
        let fine = solid(&mesh);
        let coarse = fine.coarse(mesh.points(), 1);
        assert_eq!(coarse.triangle_count(), fine.triangle_count());
        assert_eq!(coarse.volumes(mesh.points()), fine.volumes(mesh.points()));
    }
}

#[test]
fn poses_that_enclose_nothing_keep_their_triangles() {
    let mesh = icosphere(3);
    let fine = solid(&mesh);
    let flat: Vec<DVec3> = mesh.points().iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
    let at_one_place = vec![DVec3::ONE; flat.len()];
    let not_finite = vec![DVec3::NAN; flat.len()];
    for points in [flat, at_one_place, not_finite] {
        assert_eq!(fine.coarse(&points, 20).triangle_count(), fine.triangle_count());
    }
}

#[test]
fn no_triangles_at_all_may_be_asked_for() {
    let mesh = icosphere(4);
    let fine = solid(&mesh);
    assert_near(&fine.coarse(mesh.points(), 0), &fine, mesh.points());
}

#[test]
fn very_large_small_and_far_models_are_simplified_alike() {
    let mesh = uv_torus(1.0, 0.3, 40, 24);
    let fine = solid(&mesh);
    let triangles = fine.coarse(mesh.points(), 400).triangle_count();
    for scale in [2f64.powi(-200), 2f64.powi(250)] {
        let scaled: Vec<DVec3> = mesh.points().iter().map(|p| *p * scale).collect();
        let coarse = fine.coarse(&scaled, 400);
        assert_eq!(coarse.triangle_count(), triangles);
        assert_near(&coarse, &fine, &scaled);
    }
    let far = moved(mesh.points(), DVec3::splat(1e6));
    let coarse = fine.coarse(&far, 400);
    assert!(coarse.triangle_count() <= 500);
    assert_near(&coarse, &fine, &far);
}

#[test]
fn the_compacted_body_has_the_same_volumes_and_gradients() {
    for mesh in shapes() {
        let fine = solid(&mesh);
        let coarse = fine.coarse(mesh.points(), fine.triangle_count() / 8);
        let (compact, vertices) = coarse.compacted();
        let few: Vec<DVec3> = vertices.iter().map(|v| mesh.points()[*v as usize]).collect();
        assert_eq!(compact.vertex_count(), vertices.len());
        assert!(vertices.len() < mesh.points().len() && vertices.is_sorted());
        let (a, b) = (compact.volumes(&few), coarse.volumes(mesh.points()));
        assert!(a.components.iter().zip(&b.components).all(|(a, b)| (a - b).abs() <= 1e-14 * b.abs()));
        let (of_few, of_all) = (compact.volume_gradient(&few), coarse.volume_gradient(mesh.points()));
        let mut expected = vec![DVec3::ZERO; mesh.points().len()];
        vertices.iter().zip(of_few).for_each(|(v, g)| expected[*v as usize] = g);
        assert!(expected.iter().zip(of_all).all(|(a, b)| a.distance(b) <= 1e-15));
    }
}

#[test]
fn rows_of_some_vertices_bind_as_all_rows_do() {
    let mesh = icosphere(3);
    let frame = Frame::fitted(Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(0.7) }, 0.0).unwrap();
    let lattice = Lattice::new([0; 3].map(|_| Basis::clamped(5, 3).unwrap()), frame).unwrap();
    let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let vertices: Vec<u32> = (0..mesh.points().len() as u32).rev().step_by(7).collect();
    let rows = binding.rows_of(&vertices);
    assert_eq!((rows.vertex_count(), rows.control_count()), (vertices.len(), binding.control_count()));
    let is_kept = |v: &&u32| binding.weights(**v as usize).is_empty();
    assert_eq!(rows.kept_count(), vertices.iter().filter(is_kept).count());
    assert!(rows.kept_count() > 0);
    for (k, v) in vertices.iter().enumerate() {
        assert_eq!(rows.weights(k), binding.weights(*v as usize));
    }
}

#[test]
fn simplification_has_the_same_bits_for_any_number_of_threads() {
    let mesh = both(&hollow_sphere(4, 0.7), &uv_torus(3.0, 0.5, 60, 30));
    let fine = solid(&mesh);
    let inside = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fine.coarse(mesh.points(), 900).volume_gradient(mesh.points()))
    };
    let alone = inside(1);
    assert_eq!(alone, inside(4));
    assert_eq!(alone, inside(4));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the pose, torn open or turned inside out.
    #[test]
    fn any_pose_of_any_shape_stays_closed(seed in any::<u64>(), which in 0..9usize, share in 2..40usize) {
        let mesh = &shapes()[which];
        let mut random = Random(seed);
        let noise = random.within(0.0, 0.3);
        let posed: Vec<DVec3> = mesh.points().iter().map(|p| *p + random.vector() * noise).collect();
        let fine = solid(mesh);
        let coarse = fine.coarse(&posed, fine.triangle_count() / share);
        assert_near(&coarse, &fine, &posed);
        assert_closed(&coarse, &posed);
    }
}

#[test]
fn pictures_of_a_body_show_its_coarse_body() {
    for mesh in shapes() {
        let all: usize = mesh.faces().iter().map(|face| face.len() - 2).sum();
        let found = coarse_triangles(&mesh, all / 3);
        let faces: Faces = found.iter().collect();
        let drawn = solid(&Mesh::new(mesh.points().to_vec(), faces).unwrap());
        assert_eq!(drawn.triangle_count(), solid(&mesh).coarse(mesh.points(), all / 3).triangle_count());
        let (before, after) = (solid(&mesh).volume(mesh.points()), drawn.volume(mesh.points()));
        assert!((after - before).abs() <= tolerances::COARSE_VOLUME * before.abs(), "{before} became {after}");
    }
}

#[test]
fn pictures_of_a_small_mesh_show_all_its_triangles() {
    let mesh = cube(2);
    let fanned: Vec<[u32; 3]> = mesh.faces().iter().flat_map(isochor::fan).collect();
    assert_eq!(coarse_triangles(&mesh, 48), fanned);
    assert!(coarse_triangles(&Mesh::default(), 10).is_empty());
}

/// Two fans wound against each other bound nothing.
#[test]
fn pictures_of_what_bounds_nothing_have_few_triangles_too() {
    let ball = icosphere(4);
    let turned = ball.faces().iter().enumerate().map(|(f, face)| match f % 2 {
        0 => face.to_vec(),
        _ => face.iter().rev().copied().collect(),
    });
    let mut faces = Faces::new();
    turned.for_each(|face| faces.push(&face));
    let mesh = Mesh::new(ball.points().to_vec(), faces).unwrap();
    assert!(Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).is_err());
    let found = coarse_triangles(&mesh, 500);
    assert!((100..=1000).contains(&found.len()), "{}", found.len());
}

/// 5000 triangles that do not hang together cannot lose an edge each and stay.
#[test]
fn pictures_of_loose_triangles_have_few_of_them() {
    let (mut random, mut points, mut faces) = (Random(3), Vec::new(), Faces::new());
    for t in 0..5000 {
        let place = random.vector();
        points.extend([0; 3].map(|_| place + 0.05 * random.vector()));
        faces.push(&[3 * t, 3 * t + 1, 3 * t + 2]);
    }
    let found = coarse_triangles(&Mesh::new(points, faces).unwrap(), 500);
    assert!((1..=1000).contains(&found.len()), "{}", found.len());
}

#[test]
fn pictures_of_one_place_show_nothing() {
    let faces: Faces = [[0, 1, 2], [1, 2, 3]].iter().collect();
    let mesh = Mesh::new(vec![DVec3::ONE; 4], faces).unwrap();
    assert!(coarse_triangles(&mesh, 1).is_empty());
}
