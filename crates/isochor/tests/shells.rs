//! Which component is a cavity of which: arrangements of solids whose answer is plain.

use glam::{DMat3, DVec3};
use isochor::shapes::{cube, hollow_sphere, icosphere, uv_torus};
use isochor::{Faces, Health, Mesh, OpenBoundaries, Role, Shell, Solid, Source, Verdict, Volumes, roles, topology};
use proptest::prelude::*;

/// A mesh at a place: scaled, then moved, and turned inside out where it is a cavity.
struct Piece<'a> {
    mesh: &'a Mesh,
    scale: f64,
    at: DVec3,
    inward: bool,
}

fn out(mesh: &Mesh, scale: f64, at: DVec3) -> Piece<'_> {
    Piece { mesh, scale, at, inward: false }
}

fn cavity(mesh: &Mesh, scale: f64, at: DVec3) -> Piece<'_> {
    Piece { mesh, scale, at, inward: true }
}

fn together(pieces: &[Piece]) -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for Piece { mesh, scale, at, inward } in pieces {
        let first = points.len() as u32;
        points.extend(mesh.points().iter().map(|p| *p * *scale + *at));
        for face in mesh.faces().iter() {
            let mut corners: Vec<u32> = face.iter().map(|v| v + first).collect();
            if *inward {
                corners[1..].reverse();
            }
            faces.push(&corners);
        }
    }
    Mesh::new(points, faces).unwrap()
}

/// The unit cube about the origin.
fn box_of(n: usize) -> Mesh {
    let cube = cube(n);
    cube.with_points(cube.points().iter().map(|p| *p - 0.5).collect()).unwrap()
}

fn inverted(mesh: &Mesh) -> Mesh {
    together(&[cavity(mesh, 1.0, DVec3::ZERO)])
}

fn roles_of(mesh: &Mesh) -> (Vec<Role>, Volumes) {
    let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
    let volumes = solid.volumes(mesh.points());
    (roles(&solid, mesh.points(), &volumes), volumes)
}

fn shell(outer: usize, cavities: &[usize]) -> Role {
    Role::Shell(Shell { outer, cavities: cavities.to_vec() })
}

fn of(of: usize) -> Role {
    Role::Cavity { of }
}

/// The roles, which must be the same for the model inside out.
fn roles_both_ways(pieces: &[Piece]) -> Vec<Role> {
    let mesh = together(pieces);
    let (roles, _) = roles_of(&mesh);
    assert_eq!(roles, roles_of(&inverted(&mesh)).0, "inside out");
    roles
}

#[test]
fn a_cube_in_a_cube_is_its_cavity() {
    let cube = box_of(3);
    let pieces = [out(&cube, 4.0, DVec3::ZERO), cavity(&cube, 2.0, DVec3::splat(0.5))];
    assert_eq!(roles_both_ways(&pieces), [shell(0, &[1]), of(0)]);
    // 4³ and 2³.
    let mesh = together(&pieces);
    let (roles, volumes) = roles_of(&mesh);
    let Role::Shell(shell) = &roles[0] else { panic!() };
    assert_eq!((shell.capacity(&volumes), shell.material(&volumes)), (8.0, 56.0));
    let (roles, volumes) = roles_of(&inverted(&mesh));
    let Role::Shell(shell) = &roles[0] else { panic!() };
    assert_eq!((shell.capacity(&volumes), shell.material(&volumes)), (8.0, 56.0));
}

#[test]
fn nested_shells_have_their_own_cavities() {
    let ball = icosphere(2);
    let at = DVec3::new(0.1, -0.2, 0.3);
    let pieces = [
        cavity(&ball, 1.0, at),
        out(&ball, 2.0, at),
        cavity(&ball, 3.0, at),
        out(&ball, 4.0, at),
        cavity(&ball, 5.0, at),
        out(&ball, 6.0, at),
        out(&ball, 0.5, at),
    ];
    let expected = [of(1), shell(1, &[0]), of(3), shell(3, &[2]), of(5), shell(5, &[4]), Role::Solid];
    assert_eq!(roles_both_ways(&pieces), expected);
}

#[test]
fn shells_side_by_side_keep_their_cavities_apart() {
    let (cube, ball) = (box_of(2), icosphere(1));
    let pieces = [
        out(&cube, 4.0, DVec3::ZERO),
        out(&ball, 3.0, DVec3::X * 10.0),
        cavity(&ball, 0.5, DVec3::X * 10.0 - DVec3::Y),
        cavity(&cube, 1.0, DVec3::splat(-1.0)),
        cavity(&ball, 0.5, DVec3::X * 10.0 + DVec3::Y),
        out(&ball, 1.0, DVec3::Z * 9.0),
    ];
    let expected = [shell(0, &[3]), shell(1, &[2, 4]), of(1), of(0), of(1), Role::Solid];
    assert_eq!(roles_both_ways(&pieces), expected);
}

#[test]
fn inside_the_box_is_not_inside_the_body() {
    // In the hole of a ring, in the ring itself, and in a corner of the box of a ball.
    let (ring, ball) = (uv_torus(3.0, 1.0, 24, 12), icosphere(2));
    let hole = roles_both_ways(&[out(&ring, 1.0, DVec3::ZERO), cavity(&ball, 0.4, DVec3::ZERO)]);
    assert_eq!(hole, [Role::Solid, Role::Inward]);
    let tube = roles_both_ways(&[out(&ring, 1.0, DVec3::ZERO), cavity(&ball, 0.4, DVec3::Y * 3.0)]);
    assert_eq!(tube, [shell(0, &[1]), of(0)]);
    let corner = roles_both_ways(&[out(&ball, 1.0, DVec3::ZERO), cavity(&ball, 0.1, DVec3::splat(0.85))]);
    assert_eq!(corner, [Role::Solid, Role::Inward]);
}

#[test]
fn an_inward_component_beside_the_others_is_inside_nothing() {
    let cube = box_of(1);
    let pieces = [out(&cube, 2.0, DVec3::ZERO), cavity(&cube, 1.0, DVec3::X * 3.0)];
    assert_eq!(roles_both_ways(&pieces), [Role::Solid, Role::Inward]);
    // Round the outward component, larger than it: then the model is inside out.
    let round = [out(&cube, 2.0, DVec3::ZERO), cavity(&cube, 4.0, DVec3::ZERO)];
    assert_eq!(roles_both_ways(&round), [of(1), shell(1, &[0])]);
    // Alone, it is the body.
    assert_eq!(roles_both_ways(&[cavity(&cube, 1.0, DVec3::ZERO)]), [Role::Solid]);
}

#[test]
fn a_cavity_may_touch_the_wall_at_a_vertex() {
    let (cube, ball) = (box_of(2), icosphere(0));
    // The octahedron with its six corners in the middles of the cube's sides, where the cube has vertices and where it has none.
    let points = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|e| [-0.5 * e, 0.5 * e]).collect();
    let faces: Faces =
        [[1, 3, 5], [3, 0, 5], [0, 2, 5], [2, 1, 5], [3, 1, 4], [0, 3, 4], [2, 0, 4], [1, 2, 4]].iter().collect();
    let octahedron = Mesh::new(points, faces).unwrap();
    for cube in [&cube, &box_of(1), &box_of(3)] {
        let pieces = [out(cube, 1.0, DVec3::ZERO), cavity(&octahedron, 1.0, DVec3::ZERO)];
        assert_eq!(roles_both_ways(&pieces), [shell(0, &[1]), of(0)]);
    }
    // A small ball inside that shares one vertex with the large one, and one outside.
    let vertex = ball.points()[0];
    for (at, expected) in [(vertex * 0.75, [shell(0, &[1]), of(0)]), (vertex * 1.25, [Role::Solid, Role::Inward])] {
        assert_eq!(roles_both_ways(&[out(&ball, 1.0, DVec3::ZERO), cavity(&ball, 0.25, at)]), expected);
    }
}

#[test]
fn a_cavity_may_touch_the_wall_along_an_edge_and_over_a_face() {
    let cube = box_of(4);
    // The small cube lies in a corner, at an edge, at a side of the large one; rotated by a quarter that changes nothing.
    for at in [DVec3::splat(1.5), DVec3::new(1.5, 1.5, 0.2), DVec3::new(1.5, 0.1, 0.2)] {
        let inside = [out(&cube, 4.0, DVec3::ZERO), cavity(&cube, 1.0, at)];
        assert_eq!(roles_both_ways(&inside), [shell(0, &[1]), of(0)], "{at}");
        let outside = [out(&cube, 4.0, DVec3::ZERO), cavity(&cube, 1.0, at + DVec3::X)];
        assert_eq!(roles_both_ways(&outside), [Role::Solid, Role::Inward], "{at}");
    }
}

#[test]
fn a_component_that_lies_in_the_surface_of_another_counts_as_outside() {
    // The surface of a cube once with squares and once, turned inwards, with other squares: no vertex or centroid is off it.
    let (coarse, fine) = (box_of(1), box_of(3));
    let with_room =
        [out(&coarse, 1.0, DVec3::ZERO), cavity(&fine, 1.0, DVec3::ZERO), out(&coarse, 2.0, DVec3::X * 9.0)];
    assert_eq!(roles_of(&together(&with_room)).0, [Role::Solid, Role::Inward, Role::Solid]);
}

#[test]
fn open_shells_are_closed_by_their_caps() {
    // A hollow cube without its lids: the outer opening and the inner one have a cap each.
    let cube = box_of(4);
    let lidless = |mesh: &Mesh| {
        let is_lid = |face: &&[u32]| face.iter().all(|v| mesh.points()[*v as usize].z == 0.5);
        Mesh::new(mesh.points().to_vec(), mesh.faces().iter().filter(|f| !is_lid(f)).collect()).unwrap()
    };
    let open = lidless(&cube);
    let pieces = [out(&open, 4.0, DVec3::ZERO), cavity(&open, 2.0, DVec3::ZERO), cavity(&cube, 0.5, DVec3::Z * 1.7)];
    assert_eq!(roles_both_ways(&pieces), [shell(0, &[1, 2]), of(0), of(0)]);
    let above = [out(&open, 4.0, DVec3::ZERO), cavity(&open, 2.0, DVec3::ZERO), cavity(&cube, 0.5, DVec3::Z * 2.3)];
    assert_eq!(roles_both_ways(&above), [shell(0, &[1]), of(0), Role::Inward]);
}

#[test]
fn components_that_enclose_nothing_are_neither() {
    let cube = box_of(2);
    let flat = cube.with_points(cube.points().iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect()).unwrap();
    let sheet = Mesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], [&[0u32, 1, 2]].into_iter().collect()).unwrap();
    let pieces = [
        out(&cube, 4.0, DVec3::ZERO),
        cavity(&flat, 1.0, DVec3::splat(0.3)),
        out(&flat, 1.0, DVec3::X * 9.0),
        out(&sheet, 1.0, DVec3::splat(-0.3)),
    ];
    assert_eq!(roles_both_ways(&pieces), [Role::Solid, Role::Nothing, Role::Nothing, Role::Nothing]);
}

#[test]
fn a_face_that_leaves_no_triangle_is_a_component_that_encloses_nothing() {
    // Forth and back along two edges: three corners, and each triangle of the fan repeats one of them.
    let cube = box_of(1);
    let mut points = cube.points().to_vec();
    let mut faces = cube.faces().clone();
    points.extend([DVec3::X * 9.0, DVec3::X * 8.0, DVec3::Y * 7.0]);
    faces.push(&[8, 9, 8, 10]);
    let mesh = Mesh::new(points, faces).unwrap();
    assert_eq!(roles_of(&mesh).0, [Role::Solid, Role::Nothing]);
    assert_eq!(roles_of(&inverted(&mesh)).0, [Role::Solid, Role::Nothing]);
}

#[test]
fn a_model_far_from_the_origin_has_the_same_shells() {
    let ball = icosphere(2);
    let mesh =
        together(&[out(&ball, 1.0, DVec3::ZERO), cavity(&ball, 0.9, DVec3::ZERO), cavity(&ball, 0.5, DVec3::X * 9.0)]);
    let expected = roles_of(&mesh).0;
    assert_eq!(expected, [shell(0, &[1]), of(0), Role::Inward]);
    for shift in [1e3, 1e6, -3e8] {
        let far = mesh.with_points(mesh.points().iter().map(|p| *p + shift).collect()).unwrap();
        assert_eq!(roles_of(&far).0, expected, "{shift:e}");
    }
    for scale in [1e-20, 1e20] {
        let scaled = mesh.with_points(mesh.points().iter().map(|p| *p * scale).collect()).unwrap();
        assert_eq!(roles_of(&scaled).0, expected, "{scale:e}");
    }
}

#[test]
fn thousand_balls_and_a_thousand_cavities() {
    let ball = icosphere(1);
    let grid = |k: usize| DVec3::new((k % 10) as f64, (k / 10 % 10) as f64, (k / 100) as f64) * 3.0;
    let solids: Vec<Piece> = (0..1000).map(|k| out(&ball, 1.0, grid(k))).collect();
    assert!(roles_of(&together(&solids)).0.iter().all(|role| *role == Role::Solid));
    // Cavities in another order.
    let place = |k: usize| k * 7 % 1000;
    let hollow: Vec<Piece> = (0..1000)
        .map(|k| out(&ball, 1.0, grid(k)))
        .chain((0..1000).map(|k| cavity(&ball, 0.5, grid(place(k)))))
        .collect();
    let roles = roles_of(&together(&hollow)).0;
    for k in 0..1000 {
        assert_eq!(roles[1000 + k], of(place(k)));
        assert_eq!(roles[place(k)], shell(place(k), &[1000 + k]));
    }
    // All in one.
    let foam: Vec<Piece> = std::iter::once(out(&ball, 100.0, DVec3::splat(13.5)))
        .chain((0..1000).map(|k| cavity(&ball, 1.0, grid(k))))
        .collect();
    let roles = roles_of(&together(&foam)).0;
    assert_eq!(roles[0], shell(0, &(1..=1000).collect::<Vec<_>>()));
}

#[test]
fn health_tells_roles_with_capacity_and_material() {
    let mesh = hollow_sphere(2, 0.5);
    let health = |mesh: &Mesh| Health::of(mesh, &topology(mesh), &Source::of(mesh)).0;
    let found = health(&mesh);
    let volumes = found.volume.unwrap();
    let [outer, inner] = &found.roles[..] else { panic!() };
    assert_eq!((&outer.role, &inner.role), (&shell(0, &[1]), &of(0)));
    assert_eq!([outer.volume, inner.volume], volumes.components[..]);
    assert_eq!((outer.capacity, outer.material), (Some(-inner.volume), Some(outer.volume + inner.volume)));
    assert_eq!((inner.capacity, inner.material), (None, None));
    // A half has an eighth of the volume.
    assert!((outer.capacity.unwrap() / outer.volume - 0.125).abs() < 1e-15);
    // Of one component, and of none.
    assert_eq!(health(&icosphere(0)).roles.iter().map(|c| c.role.clone()).collect::<Vec<_>>(), [Role::Solid]);
    let points = health(&Mesh::new(vec![DVec3::ZERO], Faces::new()).unwrap());
    assert_eq!((points.verdict, points.roles.len()), (Verdict::NoFaces, 0));
}

proptest! {
    /// The ball inside the unit ball or beside it, in any position: the distance of centres says which.
    #[test]
    fn balls_are_inside_where_their_distance_says_so(
        seed in prop::array::uniform3(-1.0..1.0f64),
        distance in 0.0..2.5f64,
        radius in 0.05..0.6f64,
        turn in 0.0..6.0f64,
    ) {
        let direction = DVec3::from_array(seed).try_normalize().unwrap_or(DVec3::X);
        // The icosphere of level 2 holds a ball of this radius and is held by the unit ball.
        let held = 0.93;
        let inside = distance + radius < held;
        let outside = distance - radius > 1.0;
        prop_assume!(inside || outside);
        let ball = icosphere(2);
        let turned = ball.with_points(ball.points().iter().map(|p| DMat3::from_rotation_y(turn) * *p).collect()).unwrap();
        let found = roles_of(&together(&[out(&ball, 1.0, DVec3::ZERO), cavity(&turned, radius, direction * distance)])).0;
        prop_assert_eq!(found, if inside { vec![shell(0, &[1]), of(0)] } else { vec![Role::Solid, Role::Inward] });
    }
}
