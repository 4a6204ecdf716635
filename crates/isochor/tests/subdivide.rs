//! Subdivision: closed models stay closed, faces keep their places, and what is kept follows the curvature.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use isochor::{
    Faces, Height, Mesh, OpenBoundaries, Placement, PointKind, Sheet, Solid, SubdivideError, SubdivideOptions,
    Subdivision, Surface, Wrap, shapes, subdivide, topology,
};
use proptest::prelude::*;

/// The sheet of grid points at `flat(s, t)`.
fn sheet(surface: Surface, cells: [usize; 2], flat: impl Fn(f64, f64) -> [f64; 2]) -> Sheet {
    let [m, n] = cells;
    let at = |k: usize| flat((k / (n + 1)) as f64 / m as f64, (k % (n + 1)) as f64 / n as f64).into();
    Sheet::new(surface, cells, (0..(m + 1) * (n + 1)).map(at).collect())
}

/// A square sheet from (0, 0) to (n, n) with n × n unit cells, on a plane.
fn squares(n: usize) -> Sheet {
    let side = n as f64;
    let surface = Surface::plane(DVec3::ZERO, [DVec3::X * side, DVec3::Y * side]);
    sheet(surface, [n, n], |s, t| [side * s, side * t])
}

/// The same square with lines that bend.
fn bent(n: usize) -> Sheet {
    let side = n as f64;
    let surface = Surface::plane(DVec3::ZERO, [DVec3::X * side, DVec3::Y * side]);
    let wave = |x: f64| 0.15 * side * (PI * x).sin();
    sheet(surface, [n, n], |s, t| [side * s + wave(t) * s * (1.0 - s) * 4.0, side * t - wave(s) * t * (1.0 - t) * 4.0])
}

fn all() -> SubdivideOptions {
    SubdivideOptions { threshold: 0.0 }
}

fn moved(mesh: &Mesh, map: impl Fn(DVec3) -> DVec3) -> Mesh {
    mesh.with_points(mesh.points().iter().map(|p| map(*p)).collect()).unwrap()
}

/// The subdivided model with its vertices on the sheet.
fn subdivided(mesh: &Mesh, sheet: &Sheet, options: &SubdivideOptions) -> (Mesh, Subdivision) {
    let found = subdivide(mesh, mesh.points(), &Wrap::new(sheet).unwrap(), options).unwrap();
    check(mesh, &found);
    (Mesh::new(found.mixed(mesh.points()), found.refinement.faces.clone()).unwrap(), found)
}

/// What holds for every subdivision.
fn check(mesh: &Mesh, found: &Subdivision) {
    let old = mesh.points().len();
    let refinement = &found.refinement;
    assert_eq!(refinement.origins.len(), refinement.faces.len());
    assert_eq!(refinement.corners.len(), refinement.faces.corners().len());
    assert_eq!(refinement.vertices.len(), found.kinds.len());
    assert!(refinement.origins.is_sorted());
    let is_mix = |mix: &[(u32, f64); 3]| {
        mix.iter().all(|(_, w)| *w >= 0.0) && (mix.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-15
    };
    assert!(refinement.vertices.iter().chain(&refinement.corners).all(is_mix));
    assert!(refinement.vertices.iter().flatten().all(|(v, _)| (*v as usize) < old));
    let points = found.mixed(mesh.points());
    assert_eq!(points[..old], *mesh.points());
    let size = mesh.bounds().unwrap().extent();
    let mut corner = 0;
    for (face, origin) in refinement.faces.iter().zip(&refinement.origins) {
        let of = mesh.faces().face(*origin as usize);
        for v in face {
            let place: DVec3 =
                refinement.corners[corner].iter().map(|(k, w)| *w * mesh.points()[of[*k as usize] as usize]).sum();
            assert!(place.distance(points[*v as usize]) <= 1e-14 * size, "the corner is where its vertex is");
            corner += 1;
        }
    }
}

/// Edge, how often it is run forwards and backwards.
fn runs(faces: &Faces) -> BTreeMap<[u32; 2], [usize; 2]> {
    let mut runs = BTreeMap::new();
    for face in faces.iter() {
        for (k, a) in face.iter().enumerate() {
            let b = face[(k + 1) % face.len()];
            runs.entry([*a.min(&b), *a.max(&b)]).or_insert([0; 2])[usize::from(*a > b)] += 1;
        }
    }
    runs
}

/// Whether every edge of a closed model is run once in each direction.
fn is_closed(mesh: &Mesh) -> bool {
    runs(mesh.faces()).values().all(|r| *r == [1, 1])
}

fn volume(mesh: &Mesh) -> f64 {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap().volume(mesh.points())
}

fn area(mesh: &Mesh) -> f64 {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Refuse).unwrap().area(mesh.points())
}

fn shortest_edge(mesh: &Mesh) -> f64 {
    runs(mesh.faces())
        .keys()
        .map(|[a, b]| mesh.points()[*a as usize].distance(mesh.points()[*b as usize]))
        .fold(f64::INFINITY, f64::min)
}

fn count(found: &Subdivision, kind: PointKind) -> usize {
    found.kinds.iter().filter(|k| **k == kind).count()
}

/// A closed model keeps all that a plane must keep.
fn assert_same_body(before: &Mesh, after: &Mesh) {
    assert!(is_closed(after));
    let (a, b) = (topology(before), topology(after));
    assert!(b.is_closed() && b.is_balanced() && b.is_oriented());
    assert_eq!((a.euler_characteristic, a.components), (b.euler_characteristic, b.components));
    assert!((volume(after) / volume(before) - 1.0).abs() < 1e-12, "{} {}", volume(after), volume(before));
    assert!((area(after) / area(before) - 1.0).abs() < 1e-12);
}

/// A cube with quadrilaterals from (0, 0, 0) to (1, 1, 1).
fn quads() -> Mesh {
    let points = (0..8).map(|k| DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64)).collect();
    let faces: [&[u32]; 6] = [&[0, 2, 3, 1], &[4, 5, 7, 6], &[0, 1, 5, 4], &[1, 3, 7, 5], &[3, 2, 6, 7], &[2, 0, 4, 6]];
    Mesh::new(points, faces.into_iter().collect()).unwrap()
}

#[test]
fn a_square_on_squares_becomes_squares() {
    // From 0.5 to 3.5: three lines each way, 4 × 4 pieces on top and below, 4 on each side.
    let cube = moved(&quads(), |p| 3.0 * p + DVec3::new(0.5, 0.5, 0.0));
    let (fine, found) = subdivided(&cube, &squares(4), &all());
    assert_same_body(&cube, &fine);
    // Of 12 edges 8 are crossed three times; 9 face points above and below.
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (24, 18));
    assert_eq!(found.candidates, [24, 18]);
    assert_eq!(fine.faces().len(), 2 * 16 + 4 * 4);
    assert!(fine.faces().iter().all(|face| face.len() == 4));
    assert!((shortest_edge(&fine) - 0.5).abs() < 1e-15);
}

#[test]
fn a_cube_exactly_on_grid_lines_gets_points_at_grid_points_only() {
    let cube = moved(&quads(), |p| 2.0 * p + DVec3::new(1.0, 1.0, 0.0));
    let (fine, found) = subdivided(&cube, &squares(4), &all());
    assert_same_body(&cube, &fine);
    // The middles of 8 edges, and of 2 faces.
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (8, 2));
    assert_eq!(fine.faces().len(), 2 * 4 + 4 * 2);
    assert_eq!(shortest_edge(&fine), 1.0);
}

#[test]
fn a_cube_within_a_cell_or_on_its_border_is_left_alone() {
    for place in [DVec3::new(1.25, 1.25, 0.0), DVec3::new(1.0, 1.0, 0.0)] {
        let size = if place.x == 1.0 { 1.0 } else { 0.5 };
        let cube = moved(&quads(), |p| size * p + place);
        let (fine, found) = subdivided(&cube, &squares(4), &all());
        assert!(found.kinds.is_empty());
        assert_eq!(fine, cube);
    }
}

#[test]
fn a_cube_turned_by_45_degrees_about_a_grid_point() {
    let cube = moved(&quads(), |p| {
        let p = 2.0 * 2f64.sqrt() * (p - DVec3::splat(0.5));
        DVec3::new((p.x - p.y) / 2f64.sqrt(), (p.x + p.y) / 2f64.sqrt(), p.z) + DVec3::new(3.0, 3.0, 2.0)
    });
    // Its corners are on grid points, its edges go through grid points, up to rounding.
    let (fine, found) = subdivided(&cube, &squares(6), &all());
    assert_same_body(&cube, &fine);
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (8, 10));
    assert!(shortest_edge(&fine) > 0.99);
}

#[test]
fn triangles_are_cut_into_plane_pieces_too() {
    let cube = moved(&shapes::cube(1), |p| 3.0 * p + DVec3::new(0.5, 0.5, 0.0));
    let (fine, _) = subdivided(&cube, &squares(4), &all());
    assert_same_body(&cube, &fine);
    assert!(shortest_edge(&fine) > 0.1);
}

#[test]
fn bent_lines_and_round_bodies() {
    for (mesh, n) in [(shapes::icosphere(2), 8), (shapes::uv_torus(1.0, 0.3, 24, 12), 16), (shapes::icosphere(0), 5)] {
        let side = n as f64;
        let body = moved(&mesh, |p| 0.3 * side * p + side / 2.0);
        for sheet in [squares(n), bent(n)] {
            let (fine, found) = subdivided(&body, &sheet, &all());
            assert_same_body(&body, &fine);
            assert!(found.kinds.len() > n);
        }
    }
}

#[test]
fn a_concave_polygon_is_cut_as_its_fan() {
    // An L-shaped prism; the fans of both L's from corner 0 are valid.
    let l: [[f64; 2]; 6] = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let points = [0.0, 1.0].iter().flat_map(|h| l.map(|[x, y]| DVec3::new(x, y, *h))).collect();
    let mut faces = Faces::new();
    faces.push(&[3, 2, 1, 0, 5, 4]); // from the reflex corner
    faces.push(&[9, 10, 11, 6, 7, 8]);
    (0..6).for_each(|k| faces.push(&[k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6]));
    let prism = moved(&Mesh::new(points, faces).unwrap(), |p| 1.3 * p + DVec3::new(0.6, 0.7, 0.0));
    let (fine, found) = subdivided(&prism, &squares(4), &all());
    assert_same_body(&prism, &fine);
    assert!((volume(&prism) - 3.0 * 1.3f64.powi(3)).abs() < 1e-12);
    assert!(found.kinds.len() > 20);
}

#[test]
fn an_open_sheet_keeps_its_boundary() {
    let square = Mesh::new(
        [[0.5, 0.5], [3.5, 0.5], [3.5, 2.5], [0.5, 2.5]].map(|[x, y]| DVec3::new(x, y, 0.2)).into(),
        [&[0u32, 1, 2, 3]].into_iter().collect(),
    )
    .unwrap();
    let (fine, found) = subdivided(&square, &squares(4), &all());
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (10, 6));
    assert_eq!(fine.faces().len(), 12);
    let topology = topology(&fine);
    assert_eq!((topology.boundary_edges, topology.boundary_loops, topology.euler_characteristic), (14, 1, 1));
    assert_eq!(topology.nonmanifold_edges, 0);
}

#[test]
fn faces_seen_edge_on_are_cut_upwards() {
    let wall = Mesh::new(
        [[0.5, 0.0], [3.5, 0.0], [3.5, 1.0], [0.5, 1.0]].map(|[x, h]| DVec3::new(x, 0.25 + x / 2.0, h)).into(),
        [&[0u32, 1, 2, 3]].into_iter().collect(),
    )
    .unwrap();
    let (fine, found) = subdivided(&wall, &squares(4), &all());
    // Lines x = 1, 2, 3 and y = 1 (x = 1.5).
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (8, 0));
    assert_eq!(fine.faces().len(), 5);
    assert!(fine.faces().iter().all(|face| face.len() == 4));
    for face in fine.faces().iter() {
        let x = |k: usize| fine.points()[face[k] as usize].x;
        assert!((x(0) - x(3)).abs() < 1e-15 || (x(0) - x(1)).abs() < 1e-15, "cut upwards");
    }
}

#[test]
fn a_wall_on_a_grid_line_is_cut_at_grid_points() {
    let wall = Mesh::new(
        [[0.5, 0.0], [3.5, 0.0], [3.5, 1.0], [0.5, 1.0]].map(|[x, h]| DVec3::new(x, 2.0, h)).into(),
        [&[0u32, 1, 2, 3]].into_iter().collect(),
    )
    .unwrap();
    let (fine, found) = subdivided(&wall, &squares(4), &all());
    assert_eq!(count(&found, PointKind::Edge), 6);
    assert_eq!(fine.faces().len(), 4);
}

#[test]
fn faces_without_area_and_faces_that_fell_together_stay_closed() {
    // A tetrahedron, one edge of which is split on one side: the triangle (0, 1, 4) has no area.
    let points = [[0.3, 0.3, 0.0], [3.7, 0.4, 0.0], [1.0, 3.6, 0.0], [1.4, 1.5, 2.0], [2.0, 0.35, 0.0]];
    let faces = [[0u32, 2, 1], [0, 4, 3], [4, 1, 3], [1, 2, 3], [2, 0, 3], [0, 1, 4], [2, 2, 3], [3, 3, 3]];
    let mesh = Mesh::new(points.map(DVec3::from_array).into(), faces.iter().collect()).unwrap();
    let (fine, _) = subdivided(&mesh, &squares(4), &all());
    let topology = topology(&fine);
    assert!(topology.is_balanced());
    assert!((volume(&fine) / volume(&mesh) - 1.0).abs() < 1e-12);
    // What fell together is left alone.
    assert!(fine.faces().iter().any(|face| face == [2, 2, 3]));
}

#[test]
fn a_face_that_touches_itself_gets_the_points_of_its_edges() {
    // A square with a slit: its corner 1 comes twice.
    let points = [[0.5, 0.5], [2.0, 2.0], [3.5, 0.5], [3.5, 3.5], [0.5, 3.5]].map(|[x, y]| DVec3::new(x, y, 0.0));
    let faces: [&[u32]; 2] = [&[0, 1, 2, 1, 3, 4], &[2, 1, 0]];
    let mesh = Mesh::new(points.into(), faces.into_iter().collect()).unwrap();
    let (fine, _) = subdivided(&mesh, &squares(4), &all());
    let before = topology(&mesh).unbalanced.len();
    assert!(before > 0);
    // Boundary edges 2-1, 1-3, 3-4, 4-0 of the first face and 0-2 of the second are in parts.
    assert!(topology(&fine).unbalanced.iter().all(|edge| edge.surplus == 1));
    assert!((volume(&fine) - volume(&mesh)).abs() < 1e-13);
}

#[test]
fn models_whose_vertices_are_not_shared_have_the_same_bits_on_both_sides() {
    let ball = moved(&shapes::icosphere(1), |p| 2.0 * p + 3.0);
    let loose: Vec<DVec3> = ball.faces().corners().iter().map(|v| ball.points()[*v as usize]).collect();
    let corners: Vec<[u32; 3]> = (0..ball.faces().len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
    let soup = Mesh::new(loose, corners.into()).unwrap();
    for threshold in [0.0, 0.5] {
        let (fine, _) = subdivided(&soup, &bent(6), &SubdivideOptions { threshold });
        let topology = topology(&fine);
        assert!(topology.is_closed() && topology.is_balanced());
        assert_eq!(topology.euler_characteristic, 2);
    }
}

/// A full cylinder, unrolled.
fn cylinder(radius: f64, height: f64, cells: [usize; 2]) -> Sheet {
    sheet(Surface::cylinder(radius, height), cells, |s, t| [s * TAU * radius, t * height])
}

#[test]
fn on_a_cylinder_only_lines_along_its_axis_are_kept() {
    let (radius, height) = (1.0, 2.0);
    let sheet = cylinder(radius, height, [16, 8]);
    let plate = moved(&quads(), |p| p * DVec3::new(5.0, 1.7, 0.2));
    let placed = Placement::default().placed(plate.bounds().unwrap(), &sheet).unwrap();
    let places = placed.points(plate.points());
    let wrap = Wrap::new(&sheet).unwrap();
    let found = subdivide(&plate, &places, &wrap, &SubdivideOptions::default()).unwrap();
    // Lines are 2π/16 apart; the plate reaches 2.5 to both sides of the middle one: 13 of them cross four edges; between, inside, 2 × 6 or 7 points
    // each at the lines across, which are not kept.
    let across = 7;
    assert_eq!((count(&found, PointKind::Edge), count(&found, PointKind::Face)), (4 * 13, 2 * 13 * across));
    let edges_across = found.refinement.vertices.iter().zip(&found.kinds).filter(|(mix, kind)| {
        let [(a, _), (b, _), _] = mix;
        **kind == PointKind::Edge && plate.points()[*a as usize].x == plate.points()[*b as usize].x
    });
    assert_eq!(edges_across.count(), 0);
    let laid = wrap.points(&found.mixed(&places)).unwrap();
    let body = Mesh::new(laid, found.refinement.faces).unwrap();
    assert!(topology(&body).is_closed() && topology(&body).is_balanced());
    // Strips between lines, exact as polygons: ½ sin α ((R + d)² − R²) w each.
    let sector = |angle: f64| ((radius + 0.2) * (radius + 0.2) - radius * radius) * 1.7 * angle.sin() / 2.0;
    let step = TAU / 16.0;
    let expected = 12.0 * sector(step) + 2.0 * sector(2.5 - 6.0 * step);
    assert!((volume(&body) / expected - 1.0).abs() < 1e-12);
}

#[test]
fn on_a_plane_and_above_the_threshold_nothing_is_added() {
    let plate = moved(&quads(), |p| p * DVec3::new(3.0, 3.0, 0.2) + DVec3::new(0.5, 0.5, 0.0));
    let (fine, found) = subdivided(&plate, &squares(4), &SubdivideOptions { threshold: 1e-12 });
    assert_eq!((&fine, found.kinds.len(), found.candidates), (&plate, 0, [24, 18]));
    // On a cylinder of radius 1 a plate of length 5 has κ L = 5 along it.
    let sheet = cylinder(1.0, 2.0, [16, 8]);
    let plate = moved(&quads(), |p| p * DVec3::new(5.0, 1.7, 0.2) + DVec3::new(0.6, 0.1, 0.0));
    let points = |threshold| subdivided(&plate, &sheet, &SubdivideOptions { threshold }).1.kinds.len();
    assert_eq!(points(5.1), 0);
    assert!(points(4.9) > 0);
}

#[test]
fn a_line_through_two_corners_of_a_face_is_kept_where_the_surface_bends() {
    // A square that stands on a corner, over the line between two cells of a cylinder.
    let sheet = cylinder(1.0, 2.0, [8, 2]);
    let step = TAU / 8.0;
    let square = Mesh::new(
        [[0.5, 1.4], [1.0, 1.2], [1.5, 1.4], [1.0, 1.6]].map(|[i, y]| DVec3::new(i * step, y, 0.0)).into(),
        [&[0u32, 1, 2, 3]].into_iter().collect(),
    )
    .unwrap();
    let (fine, found) = subdivided(&square, &sheet, &SubdivideOptions::default());
    assert!(found.kinds.is_empty());
    assert_eq!(fine.faces().len(), 2);
    assert!(runs(fine.faces()).contains_key(&[1, 3]));
}

#[test]
fn face_points_over_a_pole_are_one() {
    let surface = Surface::sphere(1.0, [0.0, 360.0], [0.0, 90.0]).unwrap();
    let flat = |s: f64, t: f64| {
        let (sin, cos) = (TAU * s).sin_cos();
        [(1.0 - t) * PI / 2.0 * cos, (1.0 - t) * PI / 2.0 * sin]
    };
    let cap = sheet(surface, [12, 4], flat);
    let cube = moved(&quads(), |p| (p - DVec3::new(0.53, 0.45, 0.0)) * DVec3::new(1.6, 1.7, 0.2));
    let (fine, found) = subdivided(&cube, &cap, &SubdivideOptions::default());
    assert_same_body(&cube, &fine);
    let poles = fine.points().iter().filter(|p| p.truncate().length() < 1e-9).count();
    assert_eq!(poles, 2, "one above, one below");
    assert!(found.kinds.len() > 50 && shortest_edge(&fine) > 1e-6);
}

#[test]
fn beyond_the_sheet_extended_lines_cut_too() {
    let sheet = cylinder(1.0, 2.0, [8, 4]);
    let plate = moved(&quads(), |p| p * DVec3::new(9.0, 3.3, 0.2) + DVec3::new(-1.2, -0.6, 0.0));
    let wrap = Wrap::covering(&sheet, plate.points()).unwrap();
    let found = subdivide(&plate, plate.points(), &wrap, &SubdivideOptions::default()).unwrap();
    check(&plate, &found);
    let laid = wrap.points(&found.mixed(plate.points())).unwrap();
    let body = Mesh::new(laid, found.refinement.faces.clone()).unwrap();
    assert!(is_closed(&body));
    // All nine lines along the axis, on four edges.
    assert!(count(&found, PointKind::Edge) >= 4 * 9);
}

#[test]
fn thresholds_are_numbers_from_0_on() {
    let wrap = Wrap::new(&squares(2)).unwrap();
    for threshold in [-1.0, f64::NAN, f64::INFINITY] {
        let found = subdivide(&quads(), quads().points(), &wrap, &SubdivideOptions { threshold });
        assert!(matches!(found, Err(SubdivideError::Threshold { .. })));
    }
    let empty = Mesh::new(Vec::new(), Faces::new()).unwrap();
    assert_eq!(subdivide(&empty, &[], &wrap, &all()), Ok(Subdivision::default()));
}

#[test]
fn results_do_not_depend_on_threads() {
    let body = moved(&shapes::icosphere(4), |p| 2.5 * p + 4.0);
    let wrap = Wrap::new(&bent(8)).unwrap();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| subdivide(&body, body.points(), &wrap, &all()).unwrap())
    };
    assert!(with(1) == with(3));
}

/// A model, by a number.
fn model(which: usize) -> Mesh {
    match which {
        0 => moved(&quads(), |p| 2.0 * p - 1.0),
        1 => moved(&shapes::cube(2), |p| 2.0 * p - 1.0),
        2 => shapes::icosphere(1),
        3 => shapes::uv_torus(0.75, 0.25, 9, 6),
        4 => moved(&shapes::cylinder(0.7, 1.0, 7, 2), |p| p - 0.3),
        _ => moved(&shapes::embossed_box(6), |p| p - 0.5),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    #[test]
    fn closed_models_stay_closed_on_planes(
        which in 0usize..6, n in 1usize..7, rotate in prop_oneof![Just(0.0), Just(45.0), Just(90.0), -180.0f64..180.0],
        at in prop::array::uniform2(prop_oneof![Just(0.5), Just(0.375), 0.3f64..0.7]),
        size in prop_oneof![Just(0.25), 0.01f64..0.25], is_bent in any::<bool>(),
    ) {
        let mesh = model(which);
        let sheet = if is_bent { bent(n) } else { squares(n) };
        let placement = Placement { at, rotate, scale: size * n as f64 / 1.6, height: Height::Base(0.1), ..Placement::default() };
        let placed = placement.placed(mesh.bounds().unwrap(), &sheet).unwrap();
        let body = mesh.with_points(placed.points(mesh.points())).unwrap();
        let (fine, _) = subdivided(&body, &sheet, &all());
        assert_same_body(&body, &fine);
        let longest = body.bounds().unwrap().extent();
        prop_assert!(shortest_edge(&fine) > 1e-10 * longest);
    }

    #[test]
    fn closed_models_stay_closed_for_any_threshold(
        which in 0usize..6, rotate in -180.0f64..180.0, threshold in prop_oneof![Just(0.0), 0.01f64..3.0], size in 0.2f64..0.9,
    ) {
        let mesh = model(which);
        let surface = Surface::torus([2.0, 0.9], [0.0, 160.0], [-80.0, 120.0]).unwrap();
        let sheet = sheet(surface, [9, 7], |s, t| [5.0 * s + 0.4 * t * t, 3.0 * t + 0.3 * s]);
        let placement = Placement { rotate, scale: size, ..Placement::default() };
        let placed = placement.placed(mesh.bounds().unwrap(), &sheet).unwrap();
        let places = placed.points(mesh.points());
        let wrap = Wrap::new(&sheet).unwrap();
        let found = subdivide(&mesh, &places, &wrap, &SubdivideOptions { threshold }).unwrap();
        check(&mesh, &found);
        let laid = wrap.points(&found.mixed(&places)).unwrap();
        let body = Mesh::new(laid, found.refinement.faces.clone()).unwrap();
        prop_assert!(is_closed(&body));
        let (before, after) = (topology(&mesh), topology(&body));
        prop_assert!(after.is_closed() && after.is_balanced());
        prop_assert_eq!(before.euler_characteristic, after.euler_characteristic);
        // Each line that is kept is kept from end to end: no edge point is the end of half a line.
        let flat: Vec<DVec2> = found.mixed(&places).iter().map(|q| q.truncate()).collect();
        prop_assert!(flat.iter().all(|x| x.is_finite()));
    }
}
