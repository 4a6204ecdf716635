//! Volumes and their gradients against exact arithmetic, closed forms and theorems.

mod random;
mod voxels;

use std::collections::{BTreeSet, HashMap};
use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};
use isochor::shapes::{cube, cylinder, hollow_sphere, icosphere, plate, uv_torus};
use isochor::{
    Basis, Bounds, Faces, Frame, Lattice, Mesh, OpenBoundaries, Outside, Solid, SolidError, fan, tolerances, topology,
};
use num_bigint::BigInt;
use num_rational::BigRational;
use proptest::prelude::*;
use random::Random;
use voxels::voxels;

/// The last step of a volume rounds twice: the sum to one f64, and the division by 6.
const TWO_ROUNDINGS: f64 = 1.01 * f64::EPSILON;

fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

impl Random {
    fn rotation(&mut self) -> DMat3 {
        let [x, y, z, w] = [0; 4].map(|_| self.within(-1.0, 1.0));
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, w + 2.0).normalize())
    }

    fn permutation(&mut self, count: usize) -> Vec<u32> {
        let mut keyed: Vec<(u64, u32)> = (0..count as u32).map(|v| (self.within(0.0, 1.0).to_bits(), v)).collect();
        keyed.sort_unstable();
        keyed.into_iter().map(|(_, v)| v).collect()
    }

    fn vectors(&mut self, count: usize) -> Vec<DVec3> {
        (0..count).map(|_| self.vector()).collect()
    }
}

fn in_order<T: Copy>(values: &[T], order: &[u32]) -> Vec<T> {
    order.iter().map(|v| values[*v as usize]).collect()
}

fn mesh<const K: usize>(points: &[DVec3], faces: &[[u32; K]]) -> Mesh {
    Mesh::new(points.to_vec(), faces.iter().collect()).unwrap()
}

fn solid(mesh: &Mesh) -> Solid {
    Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap()
}

fn refused(mesh: &Mesh, open: OpenBoundaries) -> SolidError {
    Solid::new(mesh, &topology(mesh), open).unwrap_err()
}

fn volume(mesh: &Mesh) -> f64 {
    solid(mesh).volume(mesh.points())
}

fn moved(points: &[DVec3], f: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    points.iter().map(|p| f(*p)).collect()
}

fn extent(points: &[DVec3]) -> f64 {
    Bounds::of(points).unwrap().extent()
}

/// A sphere with a radius between 0.5 and 1.5 at each vertex: star-shaped.
fn blob(level: usize, random: &mut Random) -> Mesh {
    let sphere = icosphere(level);
    let points = sphere.points().iter().map(|p| *p * random.within(0.5, 1.5)).collect();
    sphere.with_points(points).unwrap()
}

fn kept_faces(mesh: &Mesh, keep: impl Fn(usize, &[u32]) -> bool) -> Mesh {
    let faces: Faces =
        mesh.faces().iter().enumerate().filter(|(f, face)| keep(*f, face)).map(|(_, face)| face).collect();
    Mesh::new(mesh.points().to_vec(), faces).unwrap()
}

/// The part of a random blob on one side of a random plane: open.
fn open_blob(random: &mut Random) -> Mesh {
    let (blob, up, height) = (blob(2, random), random.rotation().x_axis, random.within(-0.4, 0.4));
    kept_faces(&blob, |_, face| face.iter().map(|v| blob.points()[*v as usize].dot(up)).sum::<f64>() > 3.0 * height)
}

/// Every face with vertices of its own.
fn soup(mesh: &Mesh) -> Mesh {
    let points = mesh.faces().corners().iter().map(|v| mesh.points()[*v as usize]).collect();
    let mut faces = Faces::new();
    let mut next = 0;
    for face in mesh.faces().iter() {
        faces.push(&(next..next + face.len() as u32).collect::<Vec<_>>());
        next += face.len() as u32;
    }
    Mesh::new(points, faces).unwrap()
}

/// x = mantissa · 2^exponent exactly.
fn decoded(x: f64) -> (i64, i32) {
    let bits = x.to_bits();
    let (field, fraction) = ((bits >> 52 & 0x7ff) as i32, (bits & ((1 << 52) - 1)) as i64);
    let (mantissa, exponent) = if field == 0 { (fraction, -1074) } else { (fraction | 1 << 52, field - 1075) };
    if mantissa == 0 {
        return (0, 1024);
    }
    let zeros = mantissa.trailing_zeros();
    (if x < 0.0 { -mantissa } else { mantissa } >> zeros, exponent + zeros as i32)
}

/// `1/6 Σ det(p_l, p_m, p_n)` over the stored coordinates without any rounding, in whole numbers: every f64 is a multiple of a
/// power of 2. Each of `caps` adds a fan from the mean of its first part's points to its edges, from end to start.
fn exact_volume(mesh: &Mesh, points: &[DVec3], caps: &[(Vec<u32>, Vec<[u32; 2]>)]) -> BigRational {
    let unit = points.iter().flat_map(|p| p.to_array()).map(|x| decoded(x).1).min().unwrap();
    // Coordinates in units of 2^unit / scale, so that means are whole numbers too.
    let scale: usize = caps.iter().map(|(members, _)| members.len()).product();
    let whole = |x: f64| {
        let (mantissa, exponent) = decoded(x);
        if mantissa == 0 { BigInt::ZERO } else { (BigInt::from(mantissa) * scale) << (exponent - unit) }
    };
    let mut whole: Vec<[BigInt; 3]> = points.iter().map(|p| p.to_array().map(whole)).collect();
    let mut triangles: Vec<[usize; 3]> = mesh.faces().iter().flat_map(fan).map(|t| t.map(|v| v as usize)).collect();
    for (members, edges) in caps {
        let sum = |a: usize| members.iter().map(|v| &whole[*v as usize][a]).sum::<BigInt>();
        whole.push([0, 1, 2].map(|a| sum(a) / members.len()));
        triangles.extend(edges.iter().map(|[from, to]| [*to as usize, *from as usize, whole.len() - 1]));
    }
    let mut sum = BigInt::ZERO;
    for [a, b, c] in triangles.iter().map(|t| t.map(|v| &whole[v])) {
        for (p, q, r) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            sum += &a[p] * (&b[q] * &c[r] - &b[r] * &c[q]);
        }
    }
    let (up, down) = if unit < 0 { (0, -3 * unit) } else { (3 * unit, 0) };
    BigRational::new(sum << up, BigInt::from(6 * scale.pow(3)) << down)
}

/// |found − exact| / |exact|, itself to 40 digits after the point.
fn relative_error(found: f64, exact: &BigRational) -> f64 {
    let ten_to_40 = BigRational::from_integer(BigInt::from(10).pow(40));
    let error = (BigRational::from_float(found).unwrap() - exact) / exact * ten_to_40;
    (error.to_integer().to_string().parse::<f64>().unwrap() / 1e40).abs()
}

fn assert_exact(mesh: &Mesh, points: &[DVec3]) {
    let found = solid(mesh).volume(points);
    let error = relative_error(found, &exact_volume(mesh, points, &[]));
    assert!(error <= TWO_ROUNDINGS, "{found} is off by {error:e}");
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}, tolerance {tolerance:e}");
}

fn assert_all_near(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (v, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= tolerance, "{v}: {a} instead of {b}, tolerance {tolerance:e}");
    }
}

// Volumes against exact arithmetic

#[test]
fn volumes_are_those_of_the_stored_coordinates_to_two_roundings_near_and_a_million_extents_away() {
    let mut random = Random(1);
    let shapes = [cube(3), icosphere(3), uv_torus(1.0, 0.3, 24, 12), blob(3, &mut random), hollow_sphere(2, 0.9)];
    for shape in shapes {
        let (rotation, size) = (random.rotation(), extent(shape.points()));
        assert_exact(&shape, shape.points());
        for distance in [0.0, 0.3, 1.0, 2.0, 1e3, 1e6] {
            for direction in [DVec3::X, DVec3::NEG_ONE, random.vector()] {
                let far = moved(shape.points(), |p| rotation * p + direction * (distance * size));
                assert_exact(&shape, &far);
            }
        }
    }
}

#[test]
fn volumes_of_rotated_plates_a_millionth_thick_are_exact_to_two_roundings() {
    let mut random = Random(2);
    for thickness in [1e-3, 1e-6, 1e-9] {
        let plate = plate(DVec3::new(1.0, 0.7, thickness), [12, 9]);
        for distance in [0.0, 1.0, 1e3] {
            let (rotation, by) = (random.rotation(), random.vector() * distance);
            let points = moved(plate.points(), |p| rotation * p + by);
            assert_exact(&plate, &points);
            // What rotating cost is another matter: a rounding of every coordinate, over the thickness.
            let rounding = 4.0 * f64::EPSILON * (1.0 + distance) * solid(&plate).area(&points);
            assert_near(solid(&plate).volume(&points), 0.7 * thickness, rounding);
        }
    }
}

#[test]
fn volumes_with_virtual_caps_are_those_of_the_stored_coordinates_wherever_the_model_is() {
    let mut random = Random(3);
    let tub = kept_faces(&cube(2), |_, face| face.iter().any(|v| cube(2).points()[*v as usize].z < 1.0));
    let tube = kept_faces(&cylinder(1.0, 2.0, 9, 3), |_, face| face.len() == 4);
    for (open, loops) in [(tub, 1), (tube, 2), (open_blob(&mut random), 1)] {
        let (topology, solid) = (topology(&open), solid(&open));
        assert_eq!(solid.cap_count(), loops);
        // The loops by walking along their edges.
        let mut next: HashMap<u32, u32> = topology.unbalanced.iter().map(|e| (e.from, e.to)).collect();
        let mut caps = Vec::new();
        while let Some(&start) = next.keys().min() {
            let (mut members, mut edges, mut at) = (Vec::new(), Vec::new(), start);
            while let Some(to) = next.remove(&at) {
                members.push(at);
                edges.push([at, to]);
                at = to;
            }
            assert_eq!(at, start);
            caps.push((members, edges));
        }
        assert_eq!(caps.len(), loops);
        let rotation = random.rotation();
        for distance in [0.0, 3.0, 1e3, 1e6] {
            let points = moved(open.points(), |p| rotation * p + DVec3::new(distance, -distance, distance / 3.0));
            let found = solid.volume(&points);
            let error = relative_error(found, &exact_volume(&open, &points, &caps));
            // The apex is rounded once: ε · extent · area of the cap.
            assert!(error <= 4.0 * f64::EPSILON, "{found} at distance {distance:e} is off by {error:e}");
        }
    }
}

#[test]
fn volumes_scale_bit_for_bit_with_powers_of_two_over_the_whole_range_of_extents() {
    let blob = blob(2, &mut Random(4));
    let solid = solid(&blob);
    let unit = solid.volume(blob.points());
    for exponent in [-230, -100, -1, 1, 100, 297] {
        let factor = 2f64.powi(exponent);
        let scaled = blob.with_points(moved(blob.points(), |p| p * factor)).unwrap();
        assert_eq!(solid.volume(scaled.points()), unit * factor * factor * factor);
        assert_eq!(volume(&scaled), unit * factor * factor * factor);
    }
}

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn volumes_of_random_blobs_at_random_places_are_exact_to_two_roundings(seed: u64, distance in -2.0..7.0f64) {
        let mut random = Random(seed);
        let (blob, by) = (blob(1, &mut random), random.vector() * 10f64.powf(distance));
        assert_exact(&blob, &moved(blob.points(), |p| p + by));
    }

    #[test]
    fn any_set_of_grid_cells_has_one_unit_of_volume_per_cell_and_of_area_per_square(
        filled in prop::collection::btree_set([0..3, 0..3, 0..3], 1..20),
        seed: u64,
    ) {
        // Edges with four faces and vertices with several fans among them: balanced all the same.
        let mesh = voxels(&filled);
        let (topology, solid) = (topology(&mesh), solid(&mesh));
        prop_assert!(topology.is_balanced());
        prop_assert_eq!(solid.cap_count(), 0);
        let volumes = solid.volumes(mesh.points());
        prop_assert_eq!(volumes.total, filled.len() as f64);
        prop_assert_eq!(volumes.components.iter().sum::<f64>(), filled.len() as f64);
        prop_assert_eq!(volumes.components.len(), topology.components);
        prop_assert_eq!(solid.area(mesh.points()), mesh.faces().len() as f64);
        let mut random = Random(seed);
        let (rotation, by) = (random.rotation(), 10.0 * random.vector());
        let points = moved(mesh.points(), |p| rotation * p + by);
        let tolerance = 64.0 * f64::EPSILON * mesh.faces().len() as f64;
        assert_near(solid.volume(&points), filled.len() as f64, tolerance);
    }
}

// Closed forms

#[test]
fn boxes_and_tetrahedra_have_their_volumes_and_areas() {
    let size = DVec3::new(3.0, 0.5, 7.0);
    let points = moved(cube(2).points(), |p| p * size);
    assert_eq!(solid(&cube(2)).volume(&points), 10.5);
    assert_near(solid(&cube(2)).area(&points), 2.0 * (1.5 + 3.5 + 21.0), 1e-14);
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let tetrahedron = mesh(&corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
    assert_eq!(volume(&tetrahedron), 1.0 / 6.0);
    assert_near(solid(&tetrahedron).area(&corners), 1.5 + 0.75f64.sqrt(), 1e-15);
}

#[test]
fn two_components_are_measured_one_by_one_in_the_order_of_their_first_faces() {
    let (mut points, mut faces) = (cube(1).points().to_vec(), Faces::new());
    points.extend(cube(1).points().iter().map(|p| *p * 2.0 + DVec3::splat(5.0)));
    // Faces of both in turn, the larger cube first.
    for face in cube(1).faces().iter() {
        faces.push(&[face[0] + 8, face[1] + 8, face[2] + 8, face[3] + 8]);
        faces.push(face);
    }
    let mesh = Mesh::new(points, faces).unwrap();
    let volumes = solid(&mesh).volumes(mesh.points());
    assert_eq!((volumes.total, volumes.components), (9.0, vec![8.0, 1.0]));
    assert_eq!(solid(&mesh).component_count(), 2);
}

#[test]
fn a_cavity_is_a_component_of_negative_volume() {
    let (outer, hollow) = (volume(&icosphere(2)), hollow_sphere(2, 0.5));
    let volumes = solid(&hollow).volumes(hollow.points());
    assert_eq!(volumes.components, [outer, -outer / 8.0]);
    assert_near(volumes.total, outer * 7.0 / 8.0, 1e-15);
}

#[test]
fn two_cubes_that_share_an_edge_enclose_two_units() {
    let mesh = voxels(&BTreeSet::from([[0, 0, 0], [1, 1, 0]]));
    assert_eq!(topology(&mesh).nonmanifold_edges, 1);
    assert_eq!(volume(&mesh), 2.0);
    assert_eq!(solid(&mesh).volumes(mesh.points()).components, [2.0]);
}

#[test]
fn a_fin_on_a_cube_adds_no_volume() {
    // A triangle along one edge of the cube: that edge has three faces, and the cap over the fin lies on the fin.
    let mut points = cube(1).points().to_vec();
    let edge = [cube(1).faces().face(0)[0], cube(1).faces().face(0)[1]];
    points.push(DVec3::new(-1.0, -2.0, 0.5));
    let mut faces = cube(1).faces().clone();
    faces.push(&[edge[0], edge[1], 8]);
    let mesh = Mesh::new(points, faces).unwrap();
    assert_eq!(topology(&mesh).nonmanifold_edges, 1);
    assert_near(volume(&mesh), 1.0, 1e-15);
}

/// The unit cube with corner 7 = (1, 1, 1); `first` says whether polygons round that corner start there or one later.
fn cube_with_fans(first: usize) -> Mesh {
    let points: Vec<DVec3> =
        (0..8u32).map(|v| DVec3::new(f64::from(v & 1), f64::from(v >> 1 & 1), f64::from(v >> 2))).collect();
    let mut faces = [[0, 2, 3, 1], [0, 1, 5, 4], [0, 4, 6, 2], [7, 3, 2, 6], [7, 5, 1, 3], [7, 6, 4, 5]];
    faces[3..].iter_mut().for_each(|face| face.rotate_left(first));
    mesh(&points, &faces)
}

#[test]
fn quads_that_are_not_planar_are_fanned_from_their_first_corner() {
    // Corner 7 touches both triangles of a fan that starts there or opposite, and one of a fan that starts beside it; each
    // has the doubled area 1. So V = 1 + (dx + dy + dz)/3 or 1 + (dx + dy + dz)/6 when the corner moves by d.
    let d = DVec3::new(0.5, 0.25, -0.125);
    for (first, share) in [(0, 3.0), (1, 6.0), (2, 3.0), (3, 6.0)] {
        let cube = cube_with_fans(first);
        let mut points = cube.points().to_vec();
        points[7] += d;
        assert_near(solid(&cube).volume(&points), 1.0 + d.element_sum() / share, 1e-15);
        assert_near(volume(&cube.with_points(points).unwrap()), 1.0 + d.element_sum() / share, 1e-15);
    }
}

#[test]
fn concave_polygons_have_their_volume_whichever_corner_comes_first() {
    // An L of area 3, one unit high.
    let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let points: Vec<DVec3> =
        (0..12).map(|v| DVec3::new(outline[v % 6][0], outline[v % 6][1], (v / 6) as f64)).collect();
    for first in 0..6u32 {
        let mut faces = Faces::new();
        faces.push(&(0..6).map(|c| 6 + (first + c) % 6).collect::<Vec<_>>());
        faces.push(&(0..6).map(|c| (6 + first - c) % 6).collect::<Vec<_>>());
        (0..6).for_each(|c| faces.push(&[c, (c + 1) % 6, 6 + (c + 1) % 6, 6 + c]));
        assert_near(volume(&Mesh::new(points.clone(), faces).unwrap()), 3.0, 1e-15);
    }
}

#[test]
fn a_pillow_of_two_skew_quads_is_a_tetrahedron_or_nothing_depending_on_their_diagonals() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y];
    // (0 1 2)(0 2 3) and (0 3 2)(0 2 1) share the diagonal; (3 2 1)(3 1 0) has the other one, and the four triangles are the
    // faces of the tetrahedron: |det(X, ONE, Y)| / 6 = 1/6.
    assert_eq!(volume(&mesh(&corners, &[[0, 1, 2, 3], [0, 3, 2, 1]])), 0.0);
    assert_near(volume(&mesh(&corners, &[[0, 1, 2, 3], [3, 2, 1, 0]])).abs(), 1.0 / 6.0, 1e-16);
}

#[test]
fn repeated_corners_and_collapsed_faces_do_not_change_the_volume() {
    let mut faces = Faces::new();
    for face in cube(1).faces().iter() {
        faces.push(&[face[0], face[0], face[1], face[2], face[2], face[3], face[0]]);
    }
    faces.push(&[0, 1, 0]);
    faces.push(&[3, 3, 3, 3]);
    let mesh = Mesh::new(cube(1).points().to_vec(), faces).unwrap();
    assert_eq!(topology(&mesh).collapsed_faces, 2);
    assert_eq!(volume(&mesh), 1.0);
    assert_eq!(solid(&mesh).area(mesh.points()), 6.0);
}

#[test]
fn a_face_without_area_does_not_change_the_volume() {
    // One side of the cube has a corner in the middle of its edge, and a triangle without area fills the gap.
    let mut points = cube(1).points().to_vec();
    let side = cube(1).faces().face(0).to_vec();
    points.push((points[side[0] as usize] + points[side[1] as usize]) / 2.0);
    let mut faces = Faces::new();
    faces.push(&[side[0], 8, side[1], side[2], side[3]]);
    cube(1).faces().iter().skip(1).for_each(|face| faces.push(face));
    faces.push(&[side[0], side[1], 8]);
    let mesh = Mesh::new(points, faces).unwrap();
    assert!(topology(&mesh).is_closed());
    assert_eq!(volume(&mesh), 1.0);
}

// The gradient

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn moving_along_one_direction_changes_the_volume_by_exactly_the_gradient(seed: u64, size in 0.0..4.0f64) {
        let mut random = Random(seed);
        let blob = blob(2, &mut random);
        let (solid, d) = (solid(&blob), random.vector());
        let s: Vec<f64> = blob.points().iter().map(|_| random.within(-1.0, 1.0) * 10f64.powf(size)).collect();
        let posed: Vec<DVec3> = blob.points().iter().zip(&s).map(|(p, s)| *p + d * *s).collect();
        let terms = solid.volume_gradient(blob.points()).into_iter().zip(&s).map(|(g, s)| s * g.dot(d));
        let change = solid.volume(&posed) - solid.volume(blob.points());
        // Rounding `p + s d` moves each vertex off the line by half an ulp of its coordinates.
        let tolerance = 2.0 * f64::EPSILON * extent(&posed) * solid.area(&posed);
        assert_near(change, terms.sum(), tolerance);
    }

    #[test]
    fn moving_along_one_direction_on_a_grid_changes_the_volume_to_the_last_digits(seed: u64) {
        // Nothing rounds here but sums: coordinates are multiples of 2⁻¹², s of 1/8, d is whole.
        let mut random = Random(seed);
        let blob = blob(1, &mut random);
        let points = moved(blob.points(), |p| (p * 4096.0).round() / 4096.0);
        let (solid, d) = (solid(&blob), (random.vector() * 5.0).round());
        let s: Vec<f64> = points.iter().map(|_| (random.within(-1.0, 1.0) * 800.0).round() / 8.0).collect();
        let posed: Vec<DVec3> = points.iter().zip(&s).map(|(p, s)| *p + d * *s).collect();
        let terms: Vec<f64> =
            solid.volume_gradient(&points).into_iter().zip(&s).map(|(g, s)| s * g.dot(d)).collect();
        let change = solid.volume(&posed) - solid.volume(&points);
        let magnitude: f64 = terms.iter().map(|t| t.abs()).sum();
        assert_near(change, terms.iter().sum(), 8.0 * f64::EPSILON * (magnitude + 10.0));
    }

    #[test]
    fn the_gradient_is_the_difference_quotient_of_any_width_with_and_without_caps(seed: u64, width in -2.0..3.0f64) {
        let mut random = Random(seed);
        let open: bool = random.within(0.0, 1.0) < 0.7;
        let mesh = if open { open_blob(&mut random) } else { blob(1, &mut random) };
        let solid = solid(&mesh);
        prop_assert_eq!(solid.cap_count() > 0, open);
        let gradient = solid.volume_gradient(mesh.points());
        let h = 10f64.powf(width);
        for v in (0..mesh.points().len()).step_by(7) {
            for a in 0..3 {
                let displaced = |by: f64| {
                    let mut points = mesh.points().to_vec();
                    points[v][a] += by;
                    solid.volume(&points)
                };
                let quotient = (displaced(h) - displaced(-h)) / (2.0 * h);
                assert_near(quotient, gradient[v][a], 1e-14 * (1.0 + 1.0 / h));
            }
        }
    }

    #[test]
    fn gradients_sum_to_nothing_have_no_moment_and_give_three_volumes(seed: u64) {
        // V does not change under translation and rotation and is homogeneous of degree 3 (Euler), caps or not.
        let mut random = Random(seed);
        let mesh = if seed.is_multiple_of(2) { open_blob(&mut random) } else { blob(2, &mut random) };
        let gradient = solid(&mesh).volume_gradient(mesh.points());
        let pairs = || gradient.iter().zip(mesh.points());
        assert_near(gradient.iter().sum::<DVec3>().abs().max_element(), 0.0, 1e-13);
        assert_near(pairs().map(|(g, p)| p.cross(*g)).sum::<DVec3>().abs().max_element(), 0.0, 1e-13);
        assert_near(pairs().map(|(g, p)| p.dot(*g)).sum(), 3.0 * volume(&mesh), 1e-13);
    }

    #[test]
    fn volume_area_and_gradient_follow_rotation_translation_scale_and_mirroring(seed: u64, scale in -3.0..3.0f64) {
        let mut random = Random(seed);
        let mesh = if seed.is_multiple_of(2) { open_blob(&mut random) } else { blob(2, &mut random) };
        let solid = solid(&mesh);
        let (s, by) = (10f64.powf(scale), 3.0 * random.vector());
        let mirror = if seed & 2 == 0 { DVec3::ONE } else { DVec3::new(-1.0, 1.0, 1.0) };
        let map = random.rotation() * DMat3::from_diagonal(mirror);
        let sign = map.determinant().signum();
        let points = moved(mesh.points(), |p| s * (map * p + by));
        let (v, area, g) = (solid.volume(mesh.points()), solid.area(mesh.points()), solid.volume_gradient(mesh.points()));
        assert_near(solid.volume(&points), sign * s.powi(3) * v, 1e-14 * s.powi(3) * area);
        assert_near(solid.area(&points), s * s * area, 1e-14 * s * s * area);
        let expected: Vec<DVec3> = g.iter().map(|g| sign * s * s * (map * *g)).collect();
        assert_all_near(&solid.volume_gradient(&points), &expected, 1e-14 * s * s);
    }
}

#[test]
fn the_gradient_of_a_model_a_million_extents_away_is_that_of_the_same_model_near() {
    let mut random = Random(5);
    for mesh in [blob(2, &mut random), open_blob(&mut random)] {
        let far = moved(mesh.points(), |p| p + DVec3::new(2e6, -1e6, 3e6));
        let near = moved(&far, |p| p - DVec3::new(2e6, -1e6, 3e6)); // exact: the same bits that `far` holds
        let solid = solid(&mesh);
        assert_all_near(&solid.volume_gradient(&far), &solid.volume_gradient(&near), 1e-15);
    }
}

#[test]
fn a_mesh_turned_inside_out_has_the_opposite_volume_and_gradient() {
    let blob = blob(2, &mut Random(6));
    let mut faces = Faces::new();
    blob.faces().iter().for_each(|f| faces.push(&[f[0], f[2], f[1]]));
    let inverted = Mesh::new(blob.points().to_vec(), faces).unwrap();
    assert_eq!(volume(&inverted), -volume(&blob));
    let opposite = moved(&solid(&blob).volume_gradient(blob.points()), |g| -g);
    assert_all_near(&solid(&inverted).volume_gradient(blob.points()), &opposite, 1e-15);
}

// Open meshes

fn cube_without_lid() -> Mesh {
    let cube = cube(1);
    kept_faces(&cube, |_, face| face.iter().any(|v| cube.points()[*v as usize].z < 1.0))
}

#[test]
fn a_cube_without_its_lid_is_closed_by_a_virtual_one() {
    let open = cube_without_lid();
    let mut random = Random(7);
    assert_eq!(open.faces().len(), 5);
    for distance in [0.0, 1.0, 10.0, 1e3] {
        let (rotation, by) = (random.rotation(), random.vector() * distance);
        let points = moved(open.points(), |p| rotation * p + by);
        assert_near(solid(&open).volume(&points), 1.0, 1e-14 * (1.0 + distance));
        assert_near(solid(&open).area(&points), 6.0, 1e-13 * (1.0 + distance));
    }
    assert_eq!(solid(&open).cap_count(), 1);
}

#[test]
fn the_apex_of_a_cap_gives_each_of_its_boundary_vertices_an_equal_share() {
    // A tent over the square (±1, ±1, z_i) with its top at (0, 0, h). The cap's apex is at (0, 0, m), m = Σ z_i / 4, and the four
    // tetrahedra (apex, edge, top) have the volume (h − m) 2 / 6 each: V = 4 (h − m) / 3. So ∂V/∂z_i = −1/3, and ∂V/∂h = 4/3.
    let z = [0.5, -0.25, 0.125, 1.0];
    let h = 3.0;
    let corner = |i: usize, x: f64, y: f64| DVec3::new(x, y, z[i]);
    let points = [corner(0, 1.0, 1.0), corner(1, -1.0, 1.0), corner(2, -1.0, -1.0), corner(3, 1.0, -1.0), DVec3::Z * h];
    let tent = mesh(&points, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
    assert_near(volume(&tent), 4.0 * (h - z.iter().sum::<f64>() / 4.0) / 3.0, 1e-15);
    let gradient = solid(&tent).volume_gradient(&points);
    (0..4).for_each(|v| assert_near(gradient[v].z, -1.0 / 3.0, 1e-15));
    assert_near(gradient[4].z, 4.0 / 3.0, 1e-15);
}

#[test]
fn every_loop_of_a_tube_gets_its_own_cap() {
    let (n, radius, height) = (7, 0.5, 3.0);
    let tube = kept_faces(&cylinder(radius, height, n, 4), |_, face| face.len() == 4);
    assert_eq!(solid(&tube).cap_count(), 2);
    let area = n as f64 / 2.0 * (TAU / n as f64).sin() * radius * radius;
    assert_near(volume(&tube), area * height, 1e-15);
}

#[test]
fn two_loops_that_touch_at_a_vertex_are_closed_by_one_cap() {
    // Of the lid's four squares two stay, corner to corner at its middle; the rim's seven vertices lie in the lid's plane and
    // are symmetric to its middle.
    let cube = cube(2);
    let is_open = |face: &[u32]| {
        let middle = face.iter().map(|v| cube.points()[*v as usize]).sum::<DVec3>() / 4.0;
        middle.z == 1.0 && middle.x == middle.y
    };
    let open = kept_faces(&cube, |_, face| !is_open(face));
    assert_eq!(open.faces().len(), 22);
    assert_eq!((topology(&open).boundary_edges, solid(&open).cap_count()), (8, 1));
    assert_near(volume(&open), 1.0, 1e-15);
    // The apex is the mean of seven places: each boundary vertex has 1/7 of the gradient of the apex, so V is affine in it.
    let mut points = open.points().to_vec();
    let v = points.iter().position(|p| *p == DVec3::new(0.5, 0.5, 1.0)).unwrap();
    let slope = solid(&open).volume_gradient(&points)[v];
    points[v] += DVec3::new(0.0, 0.0, 8.0);
    assert_near(solid(&open).volume(&points), 1.0 + 8.0 * slope.z, 1e-14);
}

#[test]
fn two_components_with_touching_loops_have_volumes_that_do_not_depend_on_the_place() {
    // Two cubes without lids that share one corner of their rims: one cap, triangles in both components.
    let filled = voxels(&BTreeSet::from([[0, 0, 0], [1, 1, -1]]));
    let is_lid = |face: &[u32]| {
        let middle = face.iter().map(|v| filled.points()[*v as usize]).sum::<DVec3>() / 4.0;
        middle == DVec3::new(0.5, 0.5, 0.0) || middle == DVec3::new(1.5, 1.5, 0.0)
    };
    let open = kept_faces(&filled, |_, face| !is_lid(face));
    let solid = solid(&open);
    assert_eq!((solid.component_count(), solid.cap_count()), (2, 1));
    for by in [DVec3::ZERO, DVec3::new(16.0, -32.0, 8.0)] {
        let volumes = solid.volumes(&moved(open.points(), |p| p + by));
        assert_near(volumes.components[0], 1.0, 1e-14);
        assert_near(volumes.components[1], 1.0, 1e-14);
        assert_near(volumes.total, 2.0, 1e-14);
    }
}

#[test]
fn a_mobius_strip_is_refused_at_its_seam() {
    let n = 9;
    let point = |c: usize| {
        let (angle, across) = (TAU * (c / 2) as f64 / n as f64, (c % 2) as f64 - 0.5);
        let out = DVec3::new(angle.cos(), angle.sin(), 0.0);
        2.0 * out + across * ((angle / 2.0).cos() * out + (angle / 2.0).sin() * DVec3::Z)
    };
    let points: Vec<DVec3> = (0..2 * n).map(point).collect();
    let last = 2 * n as u32;
    // The last section meets the first one upside down.
    let quad = |u: u32| if u + 2 < last { [u, u + 2, u + 3, u + 1] } else { [u, 1, 0, u + 1] };
    let strip = mesh(&points, &(0..last).step_by(2).map(quad).collect::<Vec<_>>());
    assert_eq!(topology(&strip).inconsistent_edges, 1);
    let error = refused(&strip, OpenBoundaries::Cap);
    assert!(matches!(error, SolidError::Winding { edges: 1, surplus: 2, .. }), "{error}");
}

#[test]
fn a_klein_bottle_is_refused_at_its_seam() {
    let (nu, nv) = (8, 6);
    let point = |c: usize| {
        let (u, v) = (TAU * (c / nv) as f64 / nu as f64, TAU * ((c % nv) as f64 + 0.5) / nv as f64);
        let ((sin_half, cos_half), eight) = ((u / 2.0).sin_cos(), [v.sin(), (2.0 * v).sin()]);
        let r = 2.0 + cos_half * eight[0] - sin_half * eight[1];
        DVec3::new(r * u.cos(), r * u.sin(), sin_half * eight[0] + cos_half * eight[1])
    };
    let points: Vec<DVec3> = (0..nu * nv).map(point).collect();
    let corner = |u: usize, v: usize| (if u < nu { u * nv + v % nv } else { nv - 1 - v % nv }) as u32;
    let quad = |c: usize| {
        let (u, v) = (c / nv, c % nv);
        [corner(u, v), corner(u + 1, v), corner(u + 1, v + 1), corner(u, v + 1)]
    };
    let bottle = mesh(&points, &(0..nu * nv).map(quad).collect::<Vec<_>>());
    let topology = topology(&bottle);
    assert!(topology.is_closed());
    assert_eq!((topology.inconsistent_edges, topology.euler_characteristic), (nv, 0));
    let error = refused(&bottle, OpenBoundaries::Cap);
    assert!(matches!(error, SolidError::Winding { edges, surplus: 2, .. } if edges == nv), "{error}");
}

#[test]
fn a_flipped_face_is_refused_and_named() {
    for flipped in 0..6 {
        let mut faces = Faces::new();
        for (f, face) in cube(1).faces().iter().enumerate() {
            let mut face = face.to_vec();
            if f == flipped {
                face.reverse();
            }
            faces.push(&face);
        }
        let error = refused(&Mesh::new(cube(1).points().to_vec(), faces.clone()).unwrap(), OpenBoundaries::Cap);
        let SolidError::Winding { edges, surplus, from, to, face } = error else { panic!("{error}") };
        assert_eq!((edges, surplus), (4, 2));
        let named = faces.face(face as usize);
        let runs = (0..4).any(|c| (named[c], named[(c + 1) % 4]) == (from, to));
        assert!(runs, "face {face} does not run from {from} to {to}");
    }
}

#[test]
fn open_meshes_can_be_refused_with_their_boundary() {
    let open = cube_without_lid();
    let error = refused(&open, OpenBoundaries::Refuse);
    let SolidError::Open { boundary_edges: 4, boundary_loops: 1, from, to, face } = error else { panic!("{error}") };
    let named = open.faces().face(face as usize);
    assert!((0..4).any(|c| (named[c], named[(c + 1) % 4]) == (from, to)));
    assert!([from, to].iter().all(|v| open.points()[*v as usize].z == 1.0));
    assert!(Solid::new(&cube(1), &topology(&cube(1)), OpenBoundaries::Refuse).is_ok());
}

// Degenerate meshes

#[test]
fn flat_and_doubled_sheets_enclose_nothing_and_thin_plates_enclose_something() {
    let mut random = Random(8);
    let sheet = plate(DVec3::new(1.0, 2.0, 1.0), [5, 8]);
    let rotation = random.rotation();
    for by in [DVec3::ZERO, DVec3::new(3.0, -2.0, 7.0)] {
        let thin = |thickness: f64| moved(sheet.points(), |p| rotation * (p * DVec3::new(1.0, 1.0, thickness)) + by);
        let is_nothing = |points: &[DVec3]| {
            let solid = solid(&sheet);
            solid.encloses_nothing(points, solid.volume(points))
        };
        // Thickness t: volume 2 t, area 4, extent about 2. The limit is between a hundredth and a hundredfold of NO_VOLUME.
        assert!(is_nothing(&thin(0.0)));
        assert!(is_nothing(&thin(0.01 * tolerances::NO_VOLUME)));
        assert!(!is_nothing(&thin(100.0 * tolerances::NO_VOLUME)));
    }
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let doubled = mesh(&triangle, &[[0, 1, 2], [0, 2, 1]]);
    assert!(solid(&doubled).encloses_nothing(&triangle, volume(&doubled)));
    // A single open triangle lies on its own cap.
    let single = mesh(&triangle, &[[0, 1, 2]]);
    assert_eq!(solid(&single).cap_count(), 1);
    assert!(solid(&single).encloses_nothing(&triangle, volume(&single)));
}

#[test]
fn a_mesh_without_faces_is_no_solid() {
    assert_eq!(refused(&Mesh::default(), OpenBoundaries::Cap), SolidError::NoFaces);
    assert_eq!(refused(&mesh::<3>(&[DVec3::X, DVec3::Y], &[]), OpenBoundaries::Cap), SolidError::NoFaces);
}

#[test]
fn a_mesh_with_all_vertices_at_one_place_is_no_solid() {
    let at_a_point = cube(2).with_points(vec![DVec3::new(1.0, 2.0, 3.0); 26]).unwrap();
    assert_eq!(refused(&at_a_point, OpenBoundaries::Cap), SolidError::NoFaces);
}

#[test]
fn extents_beyond_the_range_of_products_are_refused() {
    for scale in [1e-80, 1e-71, 1e91, 1e120] {
        let scaled = cube(1).with_points(moved(cube(1).points(), |p| p * scale)).unwrap();
        assert_eq!(refused(&scaled, OpenBoundaries::Cap), SolidError::Extent { extent: scale });
    }
}

#[test]
fn a_soup_of_faces_has_the_volume_area_and_gradient_of_the_welded_mesh() {
    let mut random = Random(9);
    for mesh in [cube(2), blob(2, &mut random), open_blob(&mut random), voxels(&BTreeSet::from([[0, 0, 0], [1, 1, 0]]))]
    {
        let soup = soup(&mesh);
        let (welded, loose) = (solid(&mesh), solid(&soup));
        assert_eq!(loose.cap_count(), welded.cap_count());
        assert_near(loose.volume(soup.points()), welded.volume(mesh.points()), 1e-15 * welded.area(mesh.points()));
        assert_near(loose.area(soup.points()), welded.area(mesh.points()), 1e-14 * welded.area(mesh.points()));
        // The gradient at a place is the sum over the vertices there.
        let mut sums = vec![DVec3::ZERO; mesh.points().len()];
        for (v, g) in mesh.faces().corners().iter().zip(loose.volume_gradient(soup.points())) {
            sums[*v as usize] += g;
        }
        assert_all_near(&sums, &welded.volume_gradient(mesh.points()), 1e-15);
        // So the controls of a lattice feel the same.
        let basis = || Basis::clamped(5, 3).unwrap();
        let frame = Frame::fitted(mesh.bounds().unwrap(), 0.1).unwrap();
        let lattice = Lattice::new([basis(), basis(), basis()], frame).unwrap();
        let felt = |mesh: &Mesh, solid: &Solid| {
            lattice.bind(mesh.points(), Outside::Refuse).unwrap().adjoint(&solid.volume_gradient(mesh.points()))
        };
        assert_all_near(&felt(&soup, &loose), &felt(&mesh, &welded), 1e-14);
    }
}

#[test]
fn vertices_posed_apart_from_their_twins_are_found() {
    let soup = soup(&cube(1));
    let solid = solid(&soup);
    assert_eq!(solid.torn_vertices(soup.points()), None);
    assert_eq!(solid.torn_vertices(&moved(soup.points(), |p| p * 3.0 + 1.0)), None);
    // Signs of zeros are no places.
    let mut points = soup.points().to_vec();
    let v = (0..24).find(|v| points[*v].x == 0.0 && points[..*v].contains(&points[*v])).unwrap();
    points[v].x = -0.0;
    assert_eq!(solid.torn_vertices(&points), None);
    points[v].x = f64::MIN_POSITIVE;
    let first = points.iter().position(|p| *p == soup.points()[v]).unwrap();
    let mut pair = solid.torn_vertices(&points).unwrap();
    pair.sort_unstable();
    assert_eq!(pair, [first as u32, v as u32]);
    // A welded mesh cannot tear.
    assert_eq!(self::solid(&cube(1)).torn_vertices(&[DVec3::ZERO; 8]), None);
}

#[test]
#[should_panic(expected = "one point for each vertex of the solid")]
fn a_pose_with_another_number_of_points_is_refused() {
    let _ = solid(&cube(1)).volume(&[DVec3::ZERO; 7]);
}

// Other orders, and components apart

/// Several bodies of their own side by side, some open, some sharing a vertex: more than one part of vertices in all.
fn many_bodies(random: &mut Random) -> Mesh {
    let mut bodies: Vec<Mesh> = vec![blob(5, random), open_blob(random), open_blob(random), uv_torus(1.0, 0.3, 24, 12)];
    bodies.push(two_cubes_that_share_a_vertex());
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for (i, body) in bodies.iter().enumerate() {
        let first = points.len() as u32;
        let (rotation, by) = (random.rotation(), DVec3::X * (3.0 * i as f64));
        points.extend(body.points().iter().map(|p| rotation * *p + by));
        body.faces().iter().for_each(|face| faces.push(&face.iter().map(|v| v + first).collect::<Vec<_>>()));
    }
    Mesh::new(points, faces).unwrap()
}

fn two_cubes_that_share_a_vertex() -> Mesh {
    voxels(&BTreeSet::from([[0, 0, 0], [1, 1, 1]]))
}

#[test]
fn a_solid_in_another_order_has_the_same_volumes_areas_gradients_and_twins() {
    let mut random = Random(21);
    for mesh in [many_bodies(&mut random), soup(&icosphere(3)), cube(1)] {
        let (points, solid) = (mesh.points(), solid(&mesh));
        for far in [DVec3::ZERO, DVec3::new(1e5, -3e4, 7e5)] {
            let points = moved(points, |p| p + far);
            let order = random.permutation(points.len());
            let (there, permuted) = (in_order(&points, &order), solid.permuted(&order));
            let (volumes, found) = (solid.volumes(&points), permuted.volumes(&there));
            assert_near(found.total, volumes.total, 2.0 * f64::EPSILON * volumes.total);
            assert_eq!(found.components.len(), volumes.components.len());
            for (a, b) in found.components.iter().zip(&volumes.components) {
                assert_near(*a, *b, 2.0 * f64::EPSILON * b.abs());
            }
            assert_near(permuted.area(&there), solid.area(&points), 1e-13 * solid.area(&points));
            let q = random.vectors(points.len());
            let weights: Vec<f64> = volumes.components.iter().map(|_| random.within(-2.0, 2.0)).collect();
            for (expected, found) in [
                (solid.volume_gradient(&points), permuted.volume_gradient(&there)),
                (solid.weighted_gradient(&points, &weights), permuted.weighted_gradient(&there, &weights)),
                (
                    solid.weighted_gradient_change(&points, &q, &weights),
                    permuted.weighted_gradient_change(&there, &in_order(&q, &order), &weights),
                ),
            ] {
                assert_all_near(&found, &in_order(&expected, &order), 1e-14);
            }
            assert_eq!(permuted.torn_vertices(&there), None);
        }
    }
}

#[test]
fn a_vertex_torn_from_its_twin_is_found_in_any_order() {
    let mut random = Random(22);
    let soup = soup(&cube(2));
    let order = random.permutation(soup.points().len());
    let (mut points, solid) = (in_order(soup.points(), &order), solid(&soup).permuted(&order));
    assert_eq!(solid.torn_vertices(&points), None);
    points[5] += DVec3::X;
    let [a, b] = solid.torn_vertices(&points).unwrap();
    assert!(a == 5 || b == 5);
    // They stood at one place.
    assert_eq!(soup.points()[order[a as usize] as usize], soup.points()[order[b as usize] as usize]);
}

#[test]
fn weights_per_component_give_the_weighted_sum_of_the_components_gradients() {
    let mut random = Random(23);
    let mesh = many_bodies(&mut random);
    let (points, solid, labels) = (mesh.points(), solid(&mesh), topology(&mesh).component_of_face);
    let count = solid.component_count();
    assert!(count >= 6, "{count}");
    let q = random.vectors(points.len());
    let weights: Vec<f64> = (0..count).map(|_| random.within(-2.0, 2.0)).collect();
    let (mut gradient, mut change) = (vec![DVec3::ZERO; points.len()], vec![DVec3::ZERO; points.len()]);
    for (c, weight) in weights.iter().enumerate() {
        // The component as a solid of its own.
        let alone = self::solid(&kept_faces(&mesh, |face, _| labels[face] as usize == c));
        let (of_points, of_q) = (alone.volume_gradient(points), alone.volume_gradient_change(points, &q));
        for v in 0..points.len() {
            gradient[v] += *weight * of_points[v];
            change[v] += *weight * of_q[v];
        }
    }
    assert_all_near(&solid.weighted_gradient(points, &weights), &gradient, 1e-14);
    assert_all_near(&solid.weighted_gradient_change(points, &q, &weights), &change, 1e-14);
    let ones = vec![1.0; count];
    assert_eq!(solid.weighted_gradient(points, &ones), solid.volume_gradient(points));
    assert_eq!(solid.weighted_gradient_change(points, &q, &ones), solid.volume_gradient_change(points, &q));
}

#[test]
fn the_vertex_of_two_components_that_touch_follows_both() {
    // Two unit cubes that share one vertex, on opposite sides of it.
    let mesh = two_cubes_that_share_a_vertex();
    let solid = solid(&mesh);
    assert_eq!(solid.component_count(), 2);
    let shared = mesh.points().iter().position(|p| *p == DVec3::ONE).unwrap();
    let [one, other] = [[1.0, 0.0], [0.0, 1.0]].map(|w| solid.weighted_gradient(mesh.points(), &w)[shared]);
    assert!(one.dot(other) < 0.0);
    for weights in [[1.0, 1.0], [2.0, -3.0]] {
        let found = solid.weighted_gradient(mesh.points(), &weights)[shared];
        assert_all_near(&[found], &[one * weights[0] + other * weights[1]], 1e-15);
    }
}

#[test]
#[should_panic(expected = "one weight for each component of the solid")]
fn weights_of_another_number_are_refused() {
    let _ = solid(&cube(1)).weighted_gradient(cube(1).points(), &[1.0, 1.0]);
}

#[test]
fn memory_holds_at_least_the_triangles_and_grows_with_caps() {
    let closed = cube(8);
    let open = kept_faces(&closed, |face, _| face != 0);
    let [closed, open] = [&closed, &open].map(solid);
    assert!(closed.memory() >= 12 * closed.triangle_count() && closed.memory() <= 24 * closed.triangle_count());
    assert_eq!((open.cap_count(), open.triangle_count()), (1, closed.triangle_count() - 2));
    // A fan of four triangles in place of two.
    assert!(open.memory() > closed.memory());
}
