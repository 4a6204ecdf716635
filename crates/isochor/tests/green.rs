//! Green coordinates reproduce points, and similarities of the cage.

use glam::{DMat3, DQuat, DVec3};
use isochor::{Cage, green_coordinates, shapes, stretched_normals};
use proptest::prelude::*;

fn cages() -> Vec<(&'static str, Cage)> {
    let cage = |mesh| Cage::new(mesh).unwrap();
    vec![
        ("cube", cage(shapes::cube(1))),
        ("cube with flat edges", cage(shapes::cube(2))),
        ("stone", cage(shapes::stone(92))),
        ("torus", cage(shapes::uv_torus(1.0, 0.4, 10, 8))),
        ("two links", cage(shapes::chain(2, 8, 6))),
        ("box with bosses", cage(shapes::embossed_box(5))),
    ]
}

fn unit_normal(cage: &Cage, triangle: usize) -> DVec3 {
    let [a, b, c] = cage.triangles()[triangle].map(|v| cage.vertices()[v as usize]);
    (b - a).cross(c - a).normalize()
}

/// What the cage brings points to, at the pose that `pose` gives each vertex.
fn deformed(cage: &Cage, pose: impl Fn(DVec3) -> DVec3, points: &[DVec3]) -> Vec<DVec3> {
    let posed: Vec<DVec3> = cage.vertices().iter().map(|v| pose(*v)).collect();
    let controls: Vec<DVec3> = posed.iter().copied().chain(stretched_normals(cage, &posed)).collect();
    let rows = green_coordinates(cage, points);
    rows.chunks(controls.len()).map(|row| row.iter().zip(&controls).map(|(x, c)| *x * *c).sum()).collect()
}

/// Some triangles, with their corners.
fn some_triangles(cage: &Cage) -> impl Iterator<Item = (usize, [DVec3; 3])> {
    let corners = |t: usize| cage.triangles()[t].map(|v| cage.vertices()[v as usize]);
    (0..cage.triangles().len()).step_by(cage.triangles().len().div_ceil(20)).map(move |t| (t, corners(t)))
}

/// Points at several distances from corners, sides and insides of some triangles, along their normals and slanted, on both sides.
fn near(cage: &Cage) -> Vec<DVec3> {
    let mut points = Vec::new();
    for (t, [a, b, c]) in some_triangles(cage) {
        let n = unit_normal(cage, t);
        let slanted = (n + 0.7 * (b - a).normalize() - 0.4 * (c - a).normalize()).normalize();
        for feature in [a, b, (b + c) / 2.0, 0.9 * a + 0.1 * c, (a + b + c) / 3.0, 0.7 * a + 0.2 * b + 0.1 * c] {
            for distance in [0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3] {
                points.extend([n, -n, slanted, -slanted].map(|to| feature + distance * cage.extent() * to));
            }
        }
    }
    points
}

#[track_caller]
fn assert_reproduced(name: &str, cage: &Cage, points: &[DVec3]) {
    let vertices = cage.vertices().len();
    let rows = green_coordinates(cage, points);
    let same = deformed(cage, |v| v, points);
    for ((p, row), same) in points.iter().zip(rows.chunks(vertices + cage.triangles().len())).zip(same) {
        let sum: f64 = row[..vertices].iter().sum();
        assert!((sum - 1.0).abs() <= 5e-13, "{name}, {p}: φ sums to 1 + {:e}", sum - 1.0);
        let error = (same - *p).length() / cage.extent();
        assert!(error <= 5e-13, "{name}, {p}: {error:e} extents away");
    }
}

#[test]
fn points_near_the_cage_are_reproduced() {
    for (name, cage) in cages() {
        assert_reproduced(name, &cage, &near(&cage));
    }
}

/// In the planes of faces and on the lines of edges, but outside the faces and edges.
#[test]
fn points_in_the_planes_of_far_faces_are_reproduced() {
    let cage = Cage::new(shapes::embossed_box(5)).unwrap();
    let around = |[a, b, c]: [DVec3; 3]| [2.0 * a - b, 3.0 * a - b - c, a + 5.0 * (b - c), 0.5 * (3.0 * a - c)];
    let points: Vec<DVec3> = some_triangles(&cage).flat_map(|(_, corners)| around(corners)).collect();
    assert_reproduced("box with bosses", &cage, &points);
}

/// On the cage and 1e-12 extents from it on both sides coordinates differ by little: by what logarithms change on the way, not by the jumps of
/// the integrals.
#[test]
fn coordinates_do_not_jump_at_the_cage() {
    for (name, cage) in cages() {
        let vertices = cage.vertices().len();
        for (t, [a, b, c]) in some_triangles(&cage) {
            let step = 1e-12 * cage.extent() * unit_normal(&cage, t);
            for at in [(a + b + c) / 3.0, 0.7 * a + 0.2 * b + 0.1 * c, (a + b) / 2.0, c] {
                let rows = green_coordinates(&cage, &[at - step, at, at + step]);
                let [inside, on_it, outside] = [0, 1, 2].map(|k| &rows[k * rows.len() / 3..][..rows.len() / 3]);
                for i in 0..inside.len() {
                    let unit = if i < vertices { 1.0 } else { cage.extent() };
                    let three = [inside[i], on_it[i], outside[i]];
                    let difference = (three[0] - three[1]).abs().max((three[2] - three[1]).abs());
                    assert!(difference <= 1e-9 * unit, "{name}, {at}, {i}: {three:?}");
                }
            }
        }
    }
}

/// Over the middle of the upper face of a cube. ∫ 1/r over a square of side 1 at the height h over its middle is `2 ln((r + ½)/(r − ½)) − h Ω`,
/// `Ω = 4 atan(1/(4 h r))`, r the distance of its corners.
#[test]
fn points_outside_are_continued_through_the_closest_face() {
    let cage = Cage::new(shapes::cube(1)).unwrap();
    let vertices = cage.vertices().len();
    let row = green_coordinates(&cage, &[DVec3::new(0.5, 0.5, 1.75)]);
    let upper: f64 = (0..vertices).filter(|v| cage.vertices()[*v].z > 0.5).map(|v| row[v]).sum();
    let normals: f64 = (0..12).map(|t| row[vertices + t] * unit_normal(&cage, t).z).sum();
    assert!((upper + normals - 1.75).abs() <= 1e-14, "{upper} {normals}");
    let over_square = |h: f64| {
        let r = (0.5 + h * h).sqrt();
        2.0 * ((r + 0.5) / (r - 0.5)).ln() - 4.0 * h * (0.25 / (h * r)).atan()
    };
    let expected = (over_square(0.75) - over_square(1.75)) / (4.0 * std::f64::consts::PI) + 0.75;
    assert!((normals - expected).abs() <= 1e-14, "{normals}, not {expected}");
}

fn vector() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
}

/// A rotation with a uniform scaling, and its factor.
fn similarity() -> impl Strategy<Value = (DMat3, f64)> {
    let axis = vector().prop_filter("no axis", |axis| axis.length() > 0.1);
    (axis, -3.0..3.0, 0.2..5.0).prop_map(|(axis, angle, size)| {
        (DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle)) * size, size)
    })
}

proptest! {
    #[test]
    fn similarities_of_the_cage_are_those_of_points(
        (turn, size) in similarity(),
        shift in vector(),
        p in vector(),
        which in 0usize..6,
    ) {
        let (name, cage) = cages().swap_remove(which);
        let moved = |p: DVec3| turn * p + shift;
        let found = deformed(&cage, moved, &[p])[0];
        prop_assert!((found - moved(p)).length() <= 1e-12 * size * cage.extent(), "{name}: {found}, not {}", moved(p));
    }

    /// The same cage elsewhere gives the same coordinates, ψ in its length unit.
    #[test]
    fn coordinates_do_not_depend_on_the_frame((turn, size) in similarity(), p in vector()) {
        let cage = Cage::new(shapes::stone(92)).unwrap();
        let p = p * 0.5 * cage.extent();
        prop_assume!(cage.contains(p));
        let mesh = cage.mesh().with_points(cage.vertices().iter().map(|v| turn * *v).collect()).unwrap();
        let turned = green_coordinates(&Cage::new(mesh).unwrap(), &[turn * p]);
        for (i, (x, turned)) in green_coordinates(&cage, &[p]).iter().zip(&turned).enumerate() {
            let expected = if i < cage.vertices().len() { *x } else { *x * size };
            let most = 1e-13 * size.max(1.0) * cage.extent();
            prop_assert!((turned - expected).abs() <= most, "{i}: {turned}, not {expected}");
        }
    }
}
