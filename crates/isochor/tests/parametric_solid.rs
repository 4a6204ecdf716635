//! Bodies bounded by parametric surfaces: against closed forms, theorems, and an independent program's torus.

mod numbers;

use std::f64::consts::PI;

use glam::{DMat3, DVec3};
use isochor::{
    Basis, Bounds, Curve, Frame, Lattice, Mesh, MeshError, OpenBoundaries, ParametricSolid, ParametricSolidError,
    Solid, Surface, SurfaceError, shapes, topology,
};
use numbers::{number, reference, vectors};
use proptest::prelude::*;

const FULL: [f64; 2] = [0.0, 360.0];

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A Bernstein lattice over a box, its control points moved by `map`.
fn posed(size: [usize; 3], bounds: Bounds, map: impl Fn(DVec3) -> DVec3) -> (Lattice, Vec<DVec3>) {
    let lattice =
        Lattice::new(size.map(|n| Basis::bernstein(n).unwrap()), Frame::fitted(bounds, 0.01).unwrap()).unwrap();
    let displacement = lattice.rest().iter().map(|c| map(*c) - *c).collect();
    (lattice, displacement)
}

fn volume(body: &ParametricSolid) -> f64 {
    let found = body.volume().unwrap();
    assert!(found.difference <= 1e-13 * found.volume.abs(), "{found:?}");
    found.volume
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-13, "{found}, not {expected}");
}

/// Boxes of 1 × 2 × 3 with one corner at 0, as six planes that point outwards.
fn sides() -> Vec<Surface> {
    let [x, y, z] = [v(1.0, 0.0, 0.0), v(0.0, 2.0, 0.0), v(0.0, 0.0, 3.0)];
    let side = |corner: DVec3, s: DVec3, t: DVec3| Surface::plane(corner, [s, t]);
    let zero = DVec3::ZERO;
    vec![side(zero, y, x), side(z, x, y), side(zero, z, y), side(x, y, z), side(zero, x, z), side(y, z, x)]
}

fn square_ring() -> Curve {
    Curve::polyline([[2.0, 0.0], [3.0, 0.0], [3.0, 1.0], [2.0, 1.0], [2.0, 0.0]].map(|[x, z]| v(x, 0.0, z)).to_vec())
        .unwrap()
}

/// From the axis to the axis, round and cusped: a cubic.
fn drop() -> Curve {
    let controls = [[0.0, -1.0], [1.5, -1.0], [0.3, 0.5], [0.0, 2.0]].map(|[x, z]| v(x, 0.0, z));
    Curve::new(Basis::bernstein(4).unwrap(), controls.to_vec(), None).unwrap()
}

fn patch_box() -> ParametricSolid {
    ParametricSolid::patches(sides(), OpenBoundaries::Refuse).unwrap()
}

/// A tin: a cylinder and two discs, which are revolutions of a radius.
fn tin() -> ParametricSolid {
    let radius = |z: f64, from: f64, to: f64| Curve::polyline(vec![v(from, 0.0, z), v(to, 0.0, z)]).unwrap();
    let disc = |curve| Surface::revolution(curve, [DVec3::ZERO, DVec3::Z], FULL).unwrap();
    let surfaces = vec![Surface::cylinder(0.5, 2.0), disc(radius(0.0, 0.0, 0.5)), disc(radius(2.0, 0.5, 0.0))];
    ParametricSolid::patches(surfaces, OpenBoundaries::Refuse).unwrap()
}

fn closed_bodies() -> Vec<ParametricSolid> {
    vec![
        ParametricSolid::sphere(1.5).unwrap(),
        ParametricSolid::torus(1.0, 0.4).unwrap(),
        ParametricSolid::club(),
        ParametricSolid::revolution(square_ring()).unwrap(),
        ParametricSolid::revolution(drop()).unwrap(),
        patch_box(),
        tin(),
    ]
}

/// `∫ over u of p`, p the coefficients of a polynomial.
fn integral(p: &[f64]) -> f64 {
    p.iter().zip(1..).map(|(c, k)| c / f64::from(k)).sum()
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, a) in a.iter().enumerate() {
        b.iter().enumerate().for_each(|(j, b)| product[i + j] += a * b);
    }
    product
}

/// Of the polynomial with these Bernstein coefficients: `Σ_i c_i C(4, i) u^i (1 − u)^(4 − i)`.
fn quartic(controls: [f64; 5]) -> Vec<f64> {
    let mut sum = vec![0.0; 5];
    for (i, (c, binomial)) in controls.into_iter().zip([1.0, 4.0, 6.0, 4.0, 1.0]).enumerate() {
        let mut term = vec![c * binomial];
        (0..i).for_each(|_| term = product(&term, &[0.0, 1.0]));
        (i..4).for_each(|_| term = product(&term, &[1.0, -1.0]));
        sum.iter_mut().zip(term).for_each(|(sum, t)| *sum += t);
    }
    sum
}

#[test]
fn volumes_in_closed_form() {
    assert_near(volume(&ParametricSolid::sphere(1.5).unwrap()), 4.0 / 3.0 * PI * 1.5_f64.powi(3));
    assert_near(volume(&ParametricSolid::torus(1.0, 0.4).unwrap()), 2.0 * PI * PI * 0.16);
    // Pappus: an area of 1 whose centre goes round at 2.5.
    assert_near(volume(&ParametricSolid::revolution(square_ring()).unwrap()), 2.0 * PI * 2.5);
    // π ∫ x² dz of x = 4.5 t (1 − t)² + 0.9 t² (1 − t), z = −1 + 4.5 t² − 1.5 t³.
    let x = [0.0, 4.5, -8.1, 3.6];
    let slope = [0.0, 9.0, -4.5];
    let drop = ParametricSolid::revolution(drop()).unwrap();
    assert_near(volume(&drop), PI * integral(&product(&product(&x, &x), &slope)));
    assert_near(volume(&patch_box()), 6.0);
    assert_near(volume(&tin()), PI * 0.25 * 2.0);
}

/// Its sections are circles of radius `√(1 − (2u − 1)²) h(u)` at x(u).
#[test]
fn the_volume_of_the_club_and_that_of_the_made_model() {
    let h = quartic([1.15, 1.0, 0.35, 0.6, 0.75]);
    let x = quartic([-3.0, -1.6, 0.0, 1.6, 3.0]);
    let slope: Vec<f64> = x.iter().zip(0..).skip(1).map(|(c, k)| c * f64::from(k)).collect();
    let squared = product(&[0.0, 4.0, -4.0], &product(&h, &h));
    let exact = PI * integral(&product(&squared, &slope));
    assert_near(volume(&ParametricSolid::club()), exact);
    // The model has 16 384 triangles and encloses 6.92866059; a volume of triangles within is a little smaller.
    assert!((6.928_660_59 / exact - 1.0).abs() < 2e-3 && exact > 6.928_660_59, "{exact}");
}

/// An affine map multiplies every volume by its determinant.
#[test]
fn lattices_that_map_space_affinely() {
    let map = DMat3::from_cols(v(1.2, 0.1, -0.3), v(0.4, 0.7, 0.2), v(-0.1, 0.3, 0.9));
    for body in closed_bodies() {
        let bounds = Bounds::of(body.sampled(5000).unwrap().points()).unwrap();
        let (lattice, displacement) = posed([4, 3, 2], bounds, |c| map * c + DVec3::splat(7.0));
        let deformed = body.clone().deformed(lattice, displacement);
        assert_near(volume(&deformed), volume(&body) * map.determinant());
    }
}

/// A lattice that is turned inside out gives the same volume, negative.
#[test]
fn mirrors_change_the_sign() {
    let body = ParametricSolid::torus(1.0, 0.4).unwrap();
    let bounds = Bounds { min: v(-1.4, -1.4, -0.4), max: v(1.4, 1.4, 0.4) };
    let (lattice, displacement) = posed([2, 2, 2], bounds, |c| v(-c.x, c.y, c.z));
    assert_near(volume(&body.clone().deformed(lattice, displacement)), -volume(&body));
}

/// Reference numbers of an independent program, which samples the torus in the same way, and moves a lattice so that it has the volume at rest.
#[test]
fn the_torus_is_sampled_as_the_reference_is() {
    let torus = ParametricSolid::torus(1.0, 0.4).unwrap();
    let all = reference("hirota_torus_reference.json");
    let rest = vectors(&all["rest_lattice"]);
    let bases = [3; 3].map(|n| Basis::bernstein(n).unwrap());
    let size = v(2.8, 2.8, 0.8);
    let axes = [0, 1, 2].map(|a| size[a] * DVec3::AXES[a]);
    let lattice = Lattice::new(bases, Frame { origin: -size / 2.0, axes }).unwrap();
    assert!(lattice.rest().iter().zip(&rest).all(|(a, b)| a.distance(*b) < 1e-15));
    let mut seen = 0;
    for case in all["cases"].as_array().unwrap() {
        let (triangles, expected) = (number(&case["N_tri"]) as usize, number(&case["V0"]));
        let mesh = torus.sampled(triangles).unwrap();
        let nv = ((triangles / 4) as f64).sqrt() as usize;
        let built_in = shapes::uv_torus(1.0, 0.4, 2 * nv, nv);
        assert_eq!(mesh.faces(), built_in.faces());
        // Angles in radians are rounded by up to 4e-16, and lengths are up to 1.4.
        assert!(mesh.points().iter().zip(built_in.points()).all(|(a, b)| a.distance(*b) < 2e-15));
        assert_near(solid(&mesh, OpenBoundaries::Refuse).volume(mesh.points()), expected);
        let displacement = vectors(&case["X_opt"]).iter().zip(&rest).map(|(c, r)| *c - *r).collect();
        let mesh = torus.clone().deformed(lattice.clone(), displacement).sampled(triangles).unwrap();
        assert_near(solid(&mesh, OpenBoundaries::Refuse).volume(mesh.points()), expected);
        seen += 1;
    }
    assert!(seen > 5);
}

fn solid(mesh: &Mesh, open: OpenBoundaries) -> Solid {
    Solid::new(mesh, &topology(mesh), open).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn any_number_of_triangles_is_closed_and_faces_outwards(body in 0..7_usize, triangles in 0..6000_usize) {
        let body = &closed_bodies()[body];
        let mesh = body.sampled(triangles).unwrap();
        prop_assert!(mesh.faces().len() >= triangles.max(64) && mesh.faces().len() <= 3 * triangles.max(64));
        let topology = topology(&mesh);
        prop_assert!(topology.is_closed() && topology.is_balanced() && topology.is_oriented());
        prop_assert_eq!(topology.nonmanifold_vertices + topology.coincident_vertices + topology.unused_vertices, 0);
        prop_assert_eq!((topology.components, topology.collapsed_faces), (1, 0));
        let area = |face: &[u32]| {
            let [a, b, c] = [0, 1, 2].map(|k| mesh.points()[face[k] as usize]);
            (b - a).cross(c - a).length()
        };
        prop_assert!(mesh.faces().iter().all(|face| area(face) > 1e-9));
        let volume = solid(&mesh, OpenBoundaries::Refuse).volume(mesh.points());
        let exact = body.volume().unwrap().volume;
        prop_assert!(volume > 0.4 * exact && volume < 1.4 * exact, "{} of {}", volume, exact);
    }
}

#[test]
fn bodies_that_were_given_inside_out_are_turned() {
    let inward = sides().into_iter().map(Surface::flipped).collect();
    let body = ParametricSolid::patches(inward, OpenBoundaries::Refuse).unwrap();
    assert_near(volume(&body), 6.0);
    let mesh = body.sampled(100).unwrap();
    assert_near(solid(&mesh, OpenBoundaries::Refuse).volume(mesh.points()), 6.0);
}

/// A shell: the inner sphere faces inwards.
#[test]
fn cavities_stay_cavities() {
    let sphere = |radius: f64| Surface::sphere(radius, FULL, [-90.0, 90.0]).unwrap();
    let body = ParametricSolid::patches(vec![sphere(0.5).flipped(), sphere(1.0)], OpenBoundaries::Refuse).unwrap();
    assert_near(volume(&body), 4.0 / 3.0 * PI * (1.0 - 0.125));
    let mesh = body.sampled(2000).unwrap();
    let volumes = solid(&mesh, OpenBoundaries::Refuse).volumes(mesh.points());
    assert!(volumes.components.len() == 2 && volumes.components[0] < 0.0 && volumes.components[1] > 0.0);
}

/// Two boxes that touch in an edge, along which four borders run.
#[test]
fn bodies_that_touch_in_an_edge() {
    let beside = sides().into_iter().map(|side| side.placed(v(-1.0, -2.0, 0.0), DVec3::Z, DVec3::X).unwrap());
    let surfaces: Vec<Surface> = sides().into_iter().chain(beside).collect();
    let body = ParametricSolid::patches(surfaces, OpenBoundaries::Refuse).unwrap();
    assert_near(volume(&body), 12.0);
    let mesh = body.sampled(500).unwrap();
    assert_near(solid(&mesh, OpenBoundaries::Refuse).volume(mesh.points()), 12.0);
}

/// A bowl is half a ball, because its rim's mean is the centre; a box without lid is a box. Deformed, the caps of the mesh are those of the quadrature, too:
/// four times the triangles are four times as near.
#[test]
fn open_boundaries_have_the_caps_of_solids() {
    let bowl = Surface::sphere(1.0, FULL, [-90.0, 0.0]).unwrap();
    let bowl = ParametricSolid::patches(vec![bowl], OpenBoundaries::Cap).unwrap();
    assert_near(volume(&bowl), 2.0 / 3.0 * PI);
    let open_box = ParametricSolid::patches(sides()[..5].to_vec(), OpenBoundaries::Cap).unwrap();
    assert_near(volume(&open_box), 6.0);
    let pipe = ParametricSolid::patches(vec![Surface::cylinder(0.5, 2.0)], OpenBoundaries::Cap).unwrap();
    assert_near(volume(&pipe), PI * 0.25 * 2.0);
    for body in [bowl, open_box, pipe] {
        let bounds = Bounds::of(body.sampled(5000).unwrap().points()).unwrap();
        let (lattice, displacement) =
            posed([3, 4, 3], bounds, |c| c + 0.3 * v((2.0 * c.y + c.z).sin(), c.x * c.z, (3.0 * c.x).cos() * c.y));
        let deformed = body.deformed(lattice, displacement);
        let exact = volume(&deformed);
        let error = |triangles: usize| {
            let mesh = deformed.sampled(triangles).unwrap();
            solid(&mesh, OpenBoundaries::Cap).volume(mesh.points()) - exact
        };
        let [coarse, fine] = [2000, 8000].map(error);
        assert!((coarse / fine - 4.0).abs() < 0.4, "{coarse}, {fine}");
    }
}

#[test]
fn what_bounds_no_body_is_refused() {
    let patches = |surfaces: Vec<Surface>| ParametricSolid::patches(surfaces, OpenBoundaries::Refuse).unwrap_err();
    assert_eq!(patches(Vec::new()), ParametricSolidError::NoSurfaces);
    let error = patches(sides()[..5].to_vec());
    assert!(error.to_string().contains("surface 0 is open at s = 1"), "{error}");
    let mut turned = sides();
    turned[3] = turned[3].clone().flipped();
    let error = patches(turned);
    assert!(error.to_string().contains("surfaces 0 and 3 run along"), "{error}");
    // A plane and its back.
    let side = sides().remove(0);
    let error = patches(vec![side.clone(), side.clone().flipped()]);
    assert!(matches!(error, ParametricSolidError::NoVolume { volume, extent: 2.0 } if volume.abs() < 1e-15), "{error}");
    let error = ParametricSolid::patches(vec![side], OpenBoundaries::Cap).unwrap_err();
    assert!(matches!(error, ParametricSolidError::NoVolume { .. }), "{error}");
    assert!(matches!(
        ParametricSolid::sphere(-1.0),
        Err(ParametricSolidError::Surface(SurfaceError::Size { value: -1.0, .. }))
    ));
    let beside = Curve::polyline(vec![v(1.0, 0.0, 0.0), v(1.0, 0.0, 1.0)]).unwrap();
    let error = ParametricSolid::revolution(beside).unwrap_err();
    assert!(error.to_string().contains("surface 0 is open at t = 0"), "{error}");
}

#[test]
fn what_cannot_be_sampled_is_refused() {
    let sphere = ParametricSolid::sphere(1.0).unwrap();
    let error = sphere.sampled(usize::MAX).unwrap_err();
    assert!(
        matches!(error, ParametricSolidError::TooMany { triangles: usize::MAX, most } if most > 1 << 29),
        "{error}"
    );
    let bounds = Bounds { min: v(0.0, -1.0, -1.0), max: v(1.0, 1.0, 1.0) };
    let (lattice, displacement) = posed([2, 2, 2], bounds, |c| c);
    let half = sphere.clone().deformed(lattice, displacement);
    let [a, b] = [half.sampled(100).unwrap_err(), half.volume().unwrap_err()];
    assert!(a.to_string().contains("must hold the whole body") && b.to_string().contains("must hold the whole body"));
    let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
    let (lattice, displacement) = posed([2, 2, 2], bounds, |c| f64::MAX * c);
    let beyond = sphere.deformed(lattice, displacement);
    assert!(matches!(beyond.sampled(100), Err(ParametricSolidError::Mesh(MeshError::NotFinite { .. }))));
}
