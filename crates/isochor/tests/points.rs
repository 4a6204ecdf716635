//! Points that must come to exact places, together with exact volume and pins.

mod random;

use glam::DVec3;
use isochor::shapes::icosphere;
use isochor::{
    Basis, Binding, Bounds, CorrectError, CorrectOptions, Correction, Frame, Lattice, Mesh, Method, OpenBoundaries,
    Outside, PointTarget, Pose, Reason, Solid, Wanted, correct, displaced, topology,
};
use proptest::prelude::*;
use random::Random;

/// A blob in a lattice, its controls moved at random.
struct Posed {
    solid: Solid,
    lattice: Lattice,
    binding: Binding,
    displacement: Vec<DVec3>,
    vertices: Vec<DVec3>,
    rest_volume: f64,
}

impl Posed {
    fn new(random: &mut Random, size: usize) -> Self {
        let sphere = icosphere(2);
        let points = sphere.points().iter().map(|p| *p * (1.0 + 0.2 * (3.0 * p.x).sin())).collect();
        let mesh: Mesh = sphere.with_points(points).unwrap();
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let bases = [0; 3].map(|_| Basis::clamped(size, 3.min(size - 1)).unwrap());
        let lattice = Lattice::new(bases, Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap()).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let displacement: Vec<DVec3> = (0..binding.control_count()).map(|_| 0.1 * random.vector()).collect();
        let vertices = displaced(mesh.points(), &binding.apply(&displacement));
        Self { rest_volume: solid.volume(mesh.points()), solid, lattice, binding, displacement, vertices }
    }

    fn vertex(&self, v: usize, by: DVec3) -> PointTarget {
        let position = self.vertices[v];
        PointTarget { weights: self.binding.weights(v), position, target: position + by }
    }

    fn correct(
        &self,
        change: f64,
        method: Method,
        mobility: Option<Vec<DVec3>>,
        points: Vec<PointTarget>,
    ) -> Result<Correction, CorrectError> {
        let pose = Pose { solid: &self.solid, vertices: &self.vertices, binding: &self.binding };
        let wanted = Wanted { points, ..Wanted::volume(change * self.rest_volume) };
        correct(&pose, &wanted, &CorrectOptions { method, mobility, energy: None })
    }

    fn extent(&self) -> f64 {
        Bounds::of(&self.vertices).unwrap().extent()
    }
}

fn methods() -> [Method; 3] {
    [Method::Nearest, Method::Gradient, Method::xyz()]
}

fn reason(result: Result<Correction, CorrectError>) -> Reason {
    match result {
        Err(CorrectError::Impossible { reason, .. }) => reason,
        other => panic!("{other:?}"),
    }
}

fn cost(delta: &[DVec3]) -> f64 {
    delta.iter().map(|d| d.length_squared()).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn points_volume_and_pins_are_met_together(seed: u64, change in 0.7..1.3f64, count in 1..5usize) {
        let mut random = Random(seed);
        let posed = Posed::new(&mut random, 5);
        let points: Vec<PointTarget> = (0..count).map(|k| posed.vertex(37 * k + 5, 0.05 * random.vector())).collect();
        let pinned = |random: &mut Random| if random.within(0.0, 1.0) < 0.15 { 0.0 } else { random.within(0.3, 2.0) };
        let mobility: Vec<DVec3> = (0..posed.binding.control_count())
            .map(|_| DVec3::new(pinned(&mut random), pinned(&mut random), pinned(&mut random)))
            .collect();
        for method in methods() {
            let corrected = posed.correct(change, method, Some(mobility.clone()), points.clone()).unwrap();
            let volume = posed.solid.volume(&corrected.vertices);
            prop_assert!((volume / (change * posed.rest_volume) - 1.0).abs() <= 1e-13);
            for (k, point) in points.iter().enumerate() {
                let miss = corrected.vertices[37 * k + 5].distance(point.target);
                prop_assert!(miss <= 1e-12 * posed.extent(), "point {k} misses by {miss:e}");
            }
            prop_assert!(corrected.point_error <= 1e-12);
            for (d, m) in corrected.displacement.iter().zip(&mobility) {
                (0..3).for_each(|a| assert!(m[a] > 0.0 || d[a] == 0.0));
            }
        }
    }

    #[test]
    fn nearest_is_nearer_than_any_other_pose_that_meets_points_and_volume(seed: u64, change in 0.8..1.2f64) {
        let mut random = Random(seed);
        let posed = Posed::new(&mut random, 4);
        let points = vec![posed.vertex(3, 0.1 * random.vector()), posed.vertex(90, 0.1 * random.vector())];
        let nearest = posed.correct(change, Method::Nearest, None, points.clone()).unwrap();
        let least = cost(&nearest.displacement);
        for method in [Method::Gradient, Method::xyz()] {
            let other = posed.correct(change, method, None, points.clone()).unwrap();
            prop_assert!(least <= cost(&other.displacement) * (1.0 + 1e-12));
        }
        // Random moves from it, brought back to points and volume.
        for size in [1e-3, 1e-2, 0.1] {
            let moved: Vec<DVec3> = nearest.displacement.iter().map(|d| *d + size * random.vector()).collect();
            let vertices = displaced(&posed.vertices, &posed.binding.apply(&moved));
            let pose = Pose { solid: &posed.solid, vertices: &vertices, binding: &posed.binding };
            let here = [3, 90].map(|v: usize| vertices[v]);
            let again = points.iter().zip(here).map(|(p, position)| PointTarget { position, ..p.clone() }).collect();
            let options = CorrectOptions { method: Method::Gradient, ..CorrectOptions::default() };
            let wanted = Wanted { points: again, ..Wanted::volume(change * posed.rest_volume) };
            let Ok(back) = correct(&pose, &wanted, &options) else { continue };
            let other: Vec<DVec3> = moved.iter().zip(&back.displacement).map(|(a, b)| *a + *b).collect();
            prop_assert!(cost(&other) >= least * (1.0 - 1e-12), "size {size}");
        }
    }
}

#[test]
fn one_point_agrees_with_hahmanns_closed_form() {
    // HB (21) with its λ and μ, along x alone: δ = λ B/2 − μ α/2.
    let mut random = Random(11);
    let posed = Posed::new(&mut random, 5);
    let by = DVec3::new(0.07, 0.0, 0.0);
    let point = posed.vertex(20, by);
    let method = Method::Axes { directions: vec![DVec3::X], shares: None };
    let corrected = posed.correct(1.1, method, None, vec![point.clone()]).unwrap();
    let alpha: Vec<f64> =
        posed.binding.adjoint(&posed.solid.volume_gradient(&posed.vertices)).iter().map(|g| g.x).collect();
    let mut b = vec![0.0; alpha.len()];
    point.weights.iter().for_each(|(c, w)| b[*c] = *w);
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let (aa, ab, bb) = (dot(&alpha, &alpha), dot(&alpha, &b), dot(&b, &b));
    let a = 1.1 * posed.rest_volume - posed.solid.volume(&posed.vertices);
    let determinant = aa * bb - ab * ab;
    let lambda = (2.0 * by.x * aa - 2.0 * a * ab) / determinant;
    let mu = (2.0 * by.x * ab - 2.0 * a * bb) / determinant;
    for (c, d) in corrected.displacement.iter().enumerate() {
        let expected = lambda * b[c] / 2.0 - mu * alpha[c] / 2.0;
        assert!((*d - DVec3::X * expected).length() <= 1e-13, "{d} {expected}");
    }
}

#[test]
fn a_consistent_duplicate_changes_nothing_and_a_contradiction_is_named() {
    let mut random = Random(2);
    let posed = Posed::new(&mut random, 5);
    let by = DVec3::new(0.02, -0.05, 0.03);
    for method in methods() {
        let once = posed.correct(1.1, method.clone(), None, vec![posed.vertex(9, by)]).unwrap();
        let twice = posed.correct(1.1, method.clone(), None, vec![posed.vertex(9, by), posed.vertex(9, by)]).unwrap();
        for (a, b) in once.displacement.iter().zip(&twice.displacement) {
            assert!((*a - *b).length() <= 1e-12);
        }
        let off = posed.vertex(9, by + DVec3::new(0.0, 0.25, 0.0));
        let points = vec![posed.vertex(40, by), posed.vertex(9, by), off];
        let Reason::Contradiction { point, by } = reason(posed.correct(1.1, method, None, points)) else { panic!() };
        assert_eq!(point, 2);
        assert!((by - 0.25).abs() < 1e-12);
    }
}

#[test]
fn a_point_that_follows_only_pinned_controls_contradicts_unless_it_stays() {
    let posed = Posed::new(&mut Random(4), 5);
    let mut mobility = vec![DVec3::ONE; posed.binding.control_count()];
    posed.binding.weights(7).iter().for_each(|(c, _)| mobility[*c] = DVec3::ZERO);
    for method in methods() {
        let moved = vec![posed.vertex(7, DVec3::new(0.0, 0.0, 0.1))];
        let found = reason(posed.correct(1.05, method.clone(), Some(mobility.clone()), moved));
        assert!(matches!(found, Reason::Contradiction { point: 0, .. }), "{found:?}");
        let stays = vec![posed.vertex(7, DVec3::ZERO)];
        let corrected = posed.correct(1.05, method, Some(mobility.clone()), stays).unwrap();
        assert_eq!(corrected.vertices[7], posed.vertices[7]);
    }
}

#[test]
fn a_target_off_the_axes_is_named() {
    let posed = Posed::new(&mut Random(6), 5);
    let points = vec![posed.vertex(1, DVec3::new(0.1, 0.0, 0.0)), posed.vertex(60, DVec3::new(0.05, 0.0, -0.2))];
    let axes = |directions: Vec<DVec3>| Method::Axes { directions, shares: None };
    let found = reason(posed.correct(1.1, axes(vec![DVec3::X, DVec3::Y]), None, points.clone()));
    let Reason::OffAxes { point: 1, by } = found else { panic!("{found:?}") };
    assert!((by - 0.2).abs() < 1e-15);
    // Oblique directions that span the moves are fine, also where one of them is superfluous.
    for directions in [
        vec![DVec3::new(1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 2.0)],
        vec![DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, 0.0, 1.0), DVec3::X],
    ] {
        let corrected = posed.correct(1.1, axes(directions), None, points.clone()).unwrap();
        assert!(corrected.point_error <= 1e-13 && corrected.relative_error <= 1e-13);
    }
}

#[test]
fn a_point_of_the_domain_that_is_no_vertex_is_met() {
    let posed = Posed::new(&mut Random(8), 5);
    let rest = DVec3::new(0.2, -0.1, 0.3);
    let inside = posed.lattice.bind(&[rest], Outside::Refuse).unwrap();
    let position = rest + inside.apply(&posed.displacement)[0];
    let target = position + DVec3::new(0.1, 0.1, -0.1);
    for method in methods() {
        let point = PointTarget { weights: inside.weights(0), position, target };
        let corrected = posed.correct(0.9, method, None, vec![point]).unwrap();
        let arrived = position + inside.apply(&corrected.displacement)[0];
        assert!(arrived.distance(target) <= 1e-14 && corrected.relative_error <= 1e-13);
    }
}

#[test]
fn points_of_another_binding_are_refused() {
    let posed = Posed::new(&mut Random(9), 4);
    let point = posed.vertex(0, DVec3::X);
    let beyond = PointTarget { weights: vec![(64, 1.0)], ..point.clone() };
    let endless = PointTarget { target: DVec3::new(f64::NAN, 0.0, 0.0), ..point };
    for bad in [beyond, endless] {
        let result = posed.correct(1.1, Method::Nearest, None, vec![bad]);
        assert!(matches!(result, Err(CorrectError::Point { point: 0, .. })), "{result:?}");
    }
}

#[test]
fn points_that_leave_nothing_free_determine_the_volume() {
    // A target for each of the 8 controls of a trilinear lattice: the volume is what it becomes, or it cannot be had.
    let mut random = Random(12);
    let posed = Posed::new(&mut random, 2);
    let moves: Vec<DVec3> = (0..8).map(|_| 0.1 * random.vector()).collect();
    let points: Vec<PointTarget> =
        (0..8).map(|c| PointTarget { weights: vec![(c, 1.0)], position: DVec3::ZERO, target: moves[c] }).collect();
    let vertices = displaced(&posed.vertices, &posed.binding.apply(&moves));
    let change = posed.solid.volume(&vertices) / posed.rest_volume;
    for method in methods() {
        let corrected = posed.correct(change, method.clone(), None, points.clone()).unwrap();
        for (d, m) in corrected.displacement.iter().zip(&moves) {
            assert!((*d - *m).length() <= 1e-14, "{method:?}");
        }
        assert_eq!(reason(posed.correct(1.3 * change, method, None, points.clone())), Reason::Dead);
    }
}
