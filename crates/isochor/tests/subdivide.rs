//! Subdivision of models on sheets.

use std::f64::consts::TAU;

use glam::{DMat2, DVec2, DVec3};
use isochor::{
    Faces, Mesh, OpenBoundaries, Sheet, Solid, SubdivideError, Subdivision, Surface, shapes, subdivide, topology,
};
use proptest::prelude::*;

/// A full cylinder of radius 1 and height 4, flattened in closed form: x from 0 to τ, y from 0 to 4.
fn cylinder(cells: [usize; 2]) -> Sheet {
    sheet(Surface::cylinder(1.0, 4.0), cells, |s, t| DVec2::new(TAU * s, 4.0 * t))
}

/// Part of a sphere of radius 2, curved in all directions by 1/2, on a skewed and bent grid.
fn ball(cells: [usize; 2]) -> Sheet {
    let surface = Surface::sphere(2.0, [-60.0, 60.0], [-50.0, 50.0]).unwrap();
    sheet(surface, cells, |s, t| {
        let (x, y) = (4.0 * s, 3.5 * t);
        DVec2::new(x + 0.3 * y + 0.1 * (2.0 * y).sin(), y - 0.05 * x * x)
    })
}

fn sheet(surface: Surface, cells: [usize; 2], flat: impl Fn(f64, f64) -> DVec2) -> Sheet {
    let [n, m] = cells;
    let point = |i: usize, j: usize| flat(i as f64 / n as f64, j as f64 / m as f64);
    let points = (0..=n).flat_map(|i| (0..=m).map(move |j| (i, j))).map(|(i, j)| point(i, j)).collect();
    Sheet::new(surface, cells, points)
}

/// The mesh turned about z, scaled and moved.
fn placed(mesh: &Mesh, degrees: f64, scale: f64, to: DVec3) -> Mesh {
    let turn = DMat2::from_angle(degrees.to_radians());
    let place = |p: &DVec3| (scale * (turn * p.truncate())).extend(scale * p.z) + to;
    mesh.with_points(mesh.points().iter().map(place).collect()).unwrap()
}

/// The divided mesh, with all that must hold of it.
fn checked(mesh: &Mesh, division: &Subdivision) -> Mesh {
    let refinement = &division.refinement;
    let mix = |of: &[(u32, f64); 3], at: &dyn Fn(u32) -> DVec3| of.iter().map(|(v, w)| at(*v) * *w).sum::<DVec3>();
    let mut points = mesh.points().to_vec();
    points.extend(refinement.vertices.iter().map(|of| mix(of, &|v| mesh.points()[v as usize])));
    let new = Mesh::new(points, refinement.faces.clone()).unwrap();
    let kept = |points: &[isochor::SubdivisionPoint]| points.iter().filter(|p| p.is_kept).count();
    assert_eq!(refinement.vertices.len(), kept(&division.edge_points) + kept(&division.face_points));
    for (of, flat) in refinement
        .vertices
        .iter()
        .zip(division.edge_points.iter().chain(&division.face_points).filter(|p| p.is_kept).map(|p| p.flat))
    {
        let there = mix(of, &|v| mesh.points()[v as usize]);
        assert!(there.truncate().distance(flat) < 1e-12, "{there} projects beside {flat}");
        assert!((of.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-14 && of.iter().all(|(_, w)| *w >= 0.0));
    }
    // Corners are mixes of corners of the face they come from.
    assert_eq!((refinement.origins.len(), refinement.corners.len()), (new.faces().len(), new.faces().corners().len()));
    assert!(refinement.origins.is_sorted());
    let mut corners = refinement.corners.iter();
    for (face, origin) in new.faces().iter().zip(&refinement.origins) {
        let old = mesh.faces().face(*origin as usize);
        for v in face {
            let there = mix(corners.next().unwrap(), &|c| mesh.points()[old[c as usize] as usize]);
            assert!(there.distance(new.points()[*v as usize]) < 1e-12);
        }
    }
    let (before, after) = (topology(mesh), topology(&new));
    assert_eq!(
        (before.is_closed(), before.is_balanced(), before.genus(), before.components, before.unused_vertices),
        (after.is_closed(), after.is_balanced(), after.genus(), after.components, after.unused_vertices)
    );
    assert_eq!(before.boundary_loops, after.boundary_loops);
    if before.is_balanced() {
        let volume =
            |mesh: &Mesh, topology| Solid::new(mesh, topology, OpenBoundaries::Cap).unwrap().volume(mesh.points());
        let (old, new) = (volume(mesh, &before), volume(&new, &after));
        let scale = mesh.bounds().unwrap().extent().powi(3);
        assert!((old - new).abs() <= 1e-13 * scale, "{old} became {new}");
    }
    new
}

#[test]
fn a_plate_on_a_cylinder_is_cut_into_strips_along_it() {
    // 3 × 2 at x from 0.5 on: grid lines s = s_i at τ i/20, i = 2 … 11, cross its four edges along x. Nothing curves along y.
    let sheet = cylinder([20, 8]);
    let plate = placed(&shapes::plate(DVec3::new(3.0, 2.0, 0.1), [1, 1]), 0.0, 1.0, DVec3::new(0.5, 1.0, 0.0));
    let division = subdivide(&sheet, &plate, 0.5).unwrap();
    let new = checked(&plate, &division);
    assert_eq!(new.points().len(), 8 + 4 * 10);
    assert_eq!(division.face_points.iter().filter(|p| p.is_kept).count(), 0);
    // Face points at 10 × 3 crossings inside, on both sides of the plate.
    assert_eq!(division.face_points.len(), 2 * 10 * 3);
    let edge_points = division.edge_points.iter().filter(|p| !p.is_kept).count();
    assert_eq!(edge_points, 4 * 3, "those on the edges along y are not needed");
}

#[test]
fn a_plate_on_a_ball_keeps_all_its_points() {
    let sheet = ball([16, 14]);
    let plate = placed(&shapes::plate(DVec3::new(2.0, 1.5, 0.1), [1, 1]), 20.0, 1.0, DVec3::new(1.7, 0.6, 0.3));
    let division = subdivide(&sheet, &plate, 0.1).unwrap();
    assert!(division.edge_points.iter().chain(&division.face_points).all(|p| p.is_kept));
    assert!(division.face_points.len() > 80 && division.edge_points.len() > 50);
    let new = checked(&plate, &division);
    // Nothing is finer than it need be: vertices are those of the grid.
    assert_eq!(new.points().len(), 8 + division.edge_points.len() + division.face_points.len());
}

#[test]
fn above_the_threshold_nothing_is_added() {
    let plate = placed(&shapes::plate(DVec3::new(2.0, 1.5, 0.1), [1, 1]), 20.0, 1.0, DVec3::new(1.7, 0.6, 0.3));
    for (sheet, bend) in [(ball([16, 14]), 0.5), (cylinder([16, 14]), 1.0)] {
        let division = subdivide(&sheet, &plate, bend * 1.001).unwrap();
        assert!(division.refinement.vertices.is_empty() && !division.edge_points.is_empty());
        assert_eq!(division.refinement.faces, *plate.faces());
        assert!(!subdivide(&sheet, &plate, bend * 0.9).unwrap().refinement.vertices.is_empty());
    }
}

#[test]
fn models_finer_than_the_grid_get_no_points() {
    let fine = placed(&shapes::icosphere(4), 10.0, 1.0, DVec3::new(3.0, 2.0, 1.0));
    let division = subdivide(&cylinder([12, 8]), &fine, 0.0).unwrap();
    assert!(division.edge_points.is_empty() && division.face_points.is_empty());
    assert_eq!(division.refinement.faces, *fine.faces());
}

#[test]
fn a_cube_whose_edges_are_grid_lines_has_no_points_twice() {
    // Grid lines at quarters; the cube from 1 to 2 has its edges on them, and is crossed by three in each direction.
    let flat = |s: f64, t: f64| DVec2::new(4.0 * s, 4.0 * t);
    let sheet = sheet(Surface::sphere(2.0, [-60.0, 60.0], [-50.0, 50.0]).unwrap(), [16, 16], flat);
    let cube = placed(&shapes::cube(1), 0.0, 1.0, DVec3::new(1.0, 1.0, 0.0));
    let division = subdivide(&sheet, &cube, 0.0).unwrap();
    let new = checked(&cube, &division);
    assert_eq!(new.points().len(), 8 + 8 * 3 + 2 * 9);
    assert_eq!(topology(&new).coincident_vertices, 0);
    // Turned by 45° its corners and diagonals are on grid points.
    let cube = placed(&shapes::cube(1), 45.0, 2f64.sqrt(), DVec3::new(2.0, 1.0, 0.0));
    let new = checked(&cube, &subdivide(&sheet, &cube, 0.0).unwrap());
    assert_eq!(topology(&new).coincident_vertices, 0);
}

#[test]
fn quads_triangles_and_polygons_that_are_bent_or_concave_are_divided() {
    // An L of thickness 1, two concave polygons of 6 corners and 6 sides; and a cube with one corner moved, so that three quads are bent.
    let outline = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let mut points: Vec<DVec3> = outline.iter().map(|[x, y]| DVec3::new(*x, *y, 0.0)).collect();
    points.extend(outline.iter().map(|[x, y]| DVec3::new(*x, *y, 1.0)));
    let mut faces = Faces::new();
    faces.push(&[5, 4, 3, 2, 1, 0]);
    faces.push(&[6, 7, 8, 9, 10, 11]);
    (0..6u32).for_each(|k| faces.push(&[k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k]));
    let l = Mesh::new(points, faces).unwrap();
    let mut bent = shapes::cube(1);
    let mut points = bent.points().to_vec();
    points[3] += DVec3::new(0.3, 0.2, 0.4);
    bent = bent.with_points(points).unwrap();
    for (mesh, scale) in [(l, 0.6), (bent, 1.2)] {
        for degrees in [0.0, 30.0, 211.0] {
            let mesh = placed(&mesh, degrees, scale, DVec3::new(2.2, 1.5, -0.1));
            let division = subdivide(&ball([24, 20]), &mesh, 0.0).unwrap();
            assert!(division.refinement.vertices.len() > 50);
            checked(&mesh, &division);
        }
    }
}

#[test]
fn open_sheets_and_models_beyond_the_sheet_are_divided() {
    let mut faces = Faces::new();
    faces.push(&[0, 1, 2, 3]);
    let corners = [[-1.0, 0.5], [8.0, 0.7], [7.5, 3.0], [-2.0, 5.0]];
    let mesh = Mesh::new(corners.iter().map(|[x, y]| DVec3::new(*x, *y, 0.5)).collect(), faces).unwrap();
    let division = subdivide(&cylinder([20, 8]), &mesh, 0.1).unwrap();
    assert!(division.refinement.vertices.len() > 40);
    checked(&mesh, &division);
}

#[test]
fn faces_without_area_stay_closed() {
    // A tetrahedron one of whose faces is divided by a vertex on its edge: a triangle without area closes it.
    let points = [[0.0, 0.0, 0.0], [3.0, 0.2, 0.0], [1.0, 2.0, 0.0], [1.2, 0.8, 1.0], [1.5, 0.1, 0.0]];
    let mesh = Mesh::new(
        points.iter().map(|p| DVec3::from_array(*p) + DVec3::new(1.0, 0.8, 0.0)).collect(),
        Faces::from(vec![[0, 2, 4], [4, 2, 1], [0, 4, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]),
    )
    .unwrap();
    let division = subdivide(&cylinder([20, 8]), &mesh, 0.1).unwrap();
    assert!(division.refinement.vertices.len() > 10);
    checked(&mesh, &division);
    // Four faces at one place, and edges of no length.
    let point = mesh.with_points(vec![DVec3::ONE; 5]).unwrap();
    let division = subdivide(&cylinder([20, 8]), &point, 0.1).unwrap();
    assert_eq!(division.refinement.faces, *point.faces());
}

#[test]
fn upright_faces_are_cut_above_grid_lines() {
    // A wall over the x axis: seen from above it is a line.
    let mut faces = Faces::new();
    faces.push(&[0, 1, 2, 3]);
    let points = [[0.5, 1.0, 0.0], [3.5, 1.0, 0.0], [3.5, 1.0, 1.0], [0.5, 1.0, 1.0]];
    let wall = Mesh::new(points.map(DVec3::from_array).to_vec(), faces).unwrap();
    let new = checked(&wall, &subdivide(&cylinder([20, 7]), &wall, 0.5).unwrap());
    assert_eq!(new.points().len(), 4 + 2 * 10);
    let upright = new.faces().iter().flat_map(|f| (0..3).map(move |k| [f[k], f[(k + 1) % 3]]));
    let steps: Vec<f64> =
        upright.map(|[a, b]| (new.points()[a as usize].x - new.points()[b as usize].x).abs()).collect();
    assert!(steps.iter().all(|dx| *dx < TAU / 20.0 + 1e-12), "no edge reaches over a grid line");
}

#[test]
fn thresholds_and_positions_that_mean_nothing_are_refused() {
    let cube = shapes::cube(1);
    for threshold in [-0.1, f64::NAN] {
        let refused = subdivide(&cylinder([4, 4]), &cube, threshold);
        assert!(matches!(refused, Err(SubdivideError::Threshold { .. })));
    }
    let mut points = cube.points().to_vec();
    points[2].y = 1e308;
    let far = cube.with_points(points).unwrap();
    checked(&cube, &subdivide(&cylinder([4, 4]), &cube, 0.0).unwrap());
    assert!(subdivide(&cylinder([4, 4]), &far, 0.0).is_ok());
}

#[test]
fn a_model_without_faces_stays_so() {
    let empty = Mesh::new(Vec::new(), Faces::new()).unwrap();
    assert_eq!(subdivide(&cylinder([4, 4]), &empty, 0.0).unwrap().refinement, isochor::Refinement::default());
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let cup = placed(&shapes::cup(2), 33.0, 0.7, DVec3::new(2.0, 1.5, 0.0));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| subdivide(&ball([30, 30]), &cup, 0.0).unwrap())
    };
    assert_eq!(run(1), run(3));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn closed_models_stay_closed_balanced_and_as_large(
        shape in 0usize..6,
        degrees in 0.0..360.0f64,
        scale in 0.3..1.6f64,
        to in [0.5..3.5f64, 0.3..2.5, -1.0..1.0],
        cells in [3usize..30, 3usize..30],
        share in 0.0..1.2f64,
        on_ball in any::<bool>(),
    ) {
        let mesh = match shape {
            0 => shapes::cube(1),
            1 => shapes::cube(2),
            2 => shapes::icosphere(0),
            3 => shapes::cylinder(0.5, 1.0, 5, 1),
            4 => shapes::uv_torus(0.8, 0.3, 5, 4),
            _ => shapes::cup(1),
        };
        let mesh = placed(&mesh, degrees, scale, DVec3::from_array(to));
        let (sheet, bend) = if on_ball { (ball(cells), 0.5) } else { (cylinder(cells), 1.0) };
        checked(&mesh, &subdivide(&sheet, &mesh, share * bend).unwrap());
    }
}
