//! Dragged vertices: direct manipulation against its closed form, normal equations and the property that defines it.

mod elimination;
mod random;

use elimination::solved;
use glam::DVec3;
use isochor::shapes::icosphere;
use isochor::{
    Basis, Binding, BoundVertices, Bounds, ControlSpace, Drag, DragError, Edit, EditError, Frame, Lattice, Outside,
    PointError, PointRequest, PointTarget, Selector, displaced, least_displacement,
};
use proptest::prelude::*;
use random::Random;

/// A ball in a lattice whose controls stand at random places, `origin` from the origin of its file.
struct Posed {
    lattice: Lattice,
    binding: Binding,
    rest: Vec<DVec3>,
    vertices: Vec<DVec3>,
    controls: Vec<DVec3>,
    origin: DVec3,
}

impl Posed {
    fn new(seed: u64, outside: Outside, margin: f64) -> Self {
        let mut random = Random(seed);
        let vertices = icosphere(2).points().to_vec();
        let frame = Frame::fitted(Bounds::of(&vertices).unwrap(), margin).unwrap();
        let lattice = Lattice::new([5, 4, 6].map(|size| Basis::clamped(size, 3).unwrap()), frame).unwrap();
        let binding = lattice.bind(&vertices, outside).unwrap();
        let rest = lattice.rest();
        let controls = rest.iter().map(|c| *c + 0.2 * random.vector()).collect();
        Self { lattice, binding, rest, vertices, controls, origin: DVec3::ZERO }
    }

    /// The controls after a drag.
    fn dragged(&self, points: &[(usize, DVec3)], nodes: &Selector) -> Result<Vec<DVec3>, EditError> {
        let space = ControlSpace {
            rest: &self.rest,
            size: self.lattice.size(),
            bounds: self.lattice.frame().bounds(),
            extent: 2.0,
            origin: self.origin,
            vertices: Some(BoundVertices { rest: &self.vertices, binding: &self.binding }),
            solid: None,
        };
        let points = points.iter().map(|&(vertex, to)| PointRequest { vertex, to: to + self.origin }).collect();
        let mut controls = self.controls.clone();
        let result = Edit::Drag(Drag { points, nodes: nodes.clone() }).apply(&mut controls, &space);
        if result.is_err() {
            assert_eq!(controls, self.controls, "untouched");
        }
        result.map(|()| controls)
    }

    /// Where the vertices stand, given the controls.
    fn posed(&self, controls: &[DVec3]) -> Vec<DVec3> {
        let moves: Vec<DVec3> = controls.iter().zip(&self.rest).map(|(c, r)| *c - *r).collect();
        displaced(&self.vertices, &self.binding.apply(&moves))
    }

    fn target(&self, v: usize, by: DVec3) -> PointTarget {
        let position = self.posed(&self.controls)[v];
        PointTarget { weights: self.binding.weights(v), position, target: position + by }
    }

    /// Weights of a selector, where its sphere has them: 1 to 0 between the distances 0.5 and 2.5 from (0, 0, 1).
    fn mobility(&self) -> Vec<f64> {
        let fraction = |c: &DVec3| ((c.distance(DVec3::Z) - 0.5) / 2.0).clamp(0.0, 1.0);
        self.rest.iter().map(fraction).map(|t| 1.0 - t * t * (3.0 - 2.0 * t)).collect()
    }
}

fn sphere() -> Selector {
    Selector::Sphere { center: DVec3::Z, radius: 0.5, falloff: 2.0 }
}

fn drag_error(result: Result<Vec<DVec3>, EditError>) -> DragError {
    match result {
        Err(EditError::Drag(error)) => error,
        other => panic!("{other:?}"),
    }
}

fn cost(delta: &[DVec3], mobility: &[DVec3]) -> f64 {
    let term = |d: f64, m: f64| if m > 0.0 { d * d / m } else { 0.0 };
    delta.iter().zip(mobility).map(|(d, m)| term(d.x, m.x) + term(d.y, m.y) + term(d.z, m.z)).sum()
}

#[test]
fn one_vertex_has_a_closed_form() {
    let ball = Posed::new(1, Outside::Refuse, 0.1);
    let (v, by) = (17, DVec3::new(0.3, -0.4, 0.2));
    for (nodes, m) in [(Selector::All, vec![1.0; 120]), (sphere(), ball.mobility())] {
        let to = ball.posed(&ball.controls)[v] + by;
        let controls = ball.dragged(&[(v, to)], &nodes).unwrap();
        // δ_i = m_i w_i (T − S) / Σ m w²
        let row = ball.binding.weights(v);
        let sum: f64 = row.iter().map(|(c, w)| m[*c] * w * w).sum();
        let mut expected = ball.controls.clone();
        row.iter().for_each(|(c, w)| expected[*c] += m[*c] * w / sum * by);
        for (found, expected) in controls.iter().zip(expected) {
            assert!(found.distance(expected) <= 1e-15, "{found} instead of {expected}");
        }
        assert!(ball.posed(&controls)[v].distance(to) <= 1e-15);
    }
}

#[test]
fn several_vertices_solve_the_normal_equations() {
    let ball = Posed::new(2, Outside::Refuse, 0.1);
    let mut random = Random(3);
    let vertices = [3, 40, 77, 120, 151];
    let m = ball.mobility();
    let posed = ball.posed(&ball.controls);
    let moves: Vec<DVec3> = vertices.iter().map(|_| 0.3 * random.vector()).collect();
    let points: Vec<(usize, DVec3)> = vertices.iter().zip(&moves).map(|(v, by)| (*v, posed[*v] + *by)).collect();
    let controls = ball.dragged(&points, &sphere()).unwrap();
    // δ = M Aᵀ (A M Aᵀ)⁻¹ b with the rows A of the vertices.
    let mut a = vec![vec![0.0; 120]; vertices.len()];
    for (row, v) in a.iter_mut().zip(vertices) {
        ball.binding.weights(v).into_iter().for_each(|(c, w)| row[c] = w);
    }
    let product = |x: &[f64], y: &[f64]| -> f64 { x.iter().zip(y).zip(&m).map(|((x, y), m)| x * y * m).sum() };
    let normal: Vec<Vec<f64>> = a.iter().map(|x| a.iter().map(|y| product(x, y)).collect()).collect();
    let along = |axis: usize| solved(normal.clone(), moves.iter().map(|m| m[axis]).collect());
    let [x, y, z] = [0, 1, 2].map(along);
    let lambda: Vec<DVec3> = (0..moves.len()).map(|k| DVec3::new(x[k], y[k], z[k])).collect();
    for (c, found) in controls.iter().enumerate() {
        let delta: DVec3 = a.iter().zip(&lambda).map(|(row, l)| m[c] * row[c] * *l).sum();
        assert!((*found - ball.controls[c] - delta).length() <= 1e-13 * (1.0 + delta.length()), "control {c}");
    }
    for (v, to) in points {
        assert!(ball.posed(&controls)[v].distance(to) <= 1e-14);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever keeps the points where they are is orthogonal to the displacement, in the metric of 1/m.
    #[test]
    fn no_other_displacement_that_meets_the_points_is_smaller(seed: u64, count in 1..6usize) {
        let ball = Posed::new(seed, Outside::Refuse, 0.05);
        let mut random = Random(seed ^ 1);
        let mobility: Vec<DVec3> = (0..120)
            .map(|_| DVec3::from_array([0; 3].map(|_| random.within(-0.3, 2.0).max(0.0))))
            .collect();
        let points: Vec<PointTarget> = (0..count).map(|k| ball.target(29 * k + 5, 0.5 * random.vector())).collect();
        let delta = least_displacement(&points, &mobility, 2.0).unwrap();
        let moved = ball.binding.apply(&delta);
        for (k, point) in points.iter().enumerate() {
            prop_assert!((point.position + moved[29 * k + 5]).distance(point.target) <= 2e-12);
        }
        for (d, m) in delta.iter().zip(&mobility) {
            (0..3).for_each(|a| assert!(m[a] > 0.0 || d[a] == 0.0));
        }
        // A random displacement less what it does to the points.
        let random: Vec<DVec3> = mobility.iter().map(|m| random.vector() * *m).collect();
        let image = ball.binding.apply(&random);
        let back = |(k, point): (usize, &PointTarget)| PointTarget {
            position: DVec3::ZERO,
            target: image[29 * k + 5],
            ..point.clone()
        };
        let taken = least_displacement(&points.iter().enumerate().map(back).collect::<Vec<_>>(), &mobility, 2.0).unwrap();
        let other: Vec<DVec3> = (0..120).map(|c| delta[c] + random[c] - taken[c]).collect();
        let free: Vec<DVec3> = (0..120).map(|c| random[c] - taken[c]).collect();
        let (least, rest) = (cost(&delta, &mobility), cost(&free, &mobility));
        prop_assert!((cost(&other, &mobility) - least - rest).abs() <= 1e-10 * (least + rest), "Pythagoras");
    }
}

#[test]
fn control_points_that_are_not_selected_keep_their_bits() {
    let ball = Posed::new(4, Outside::Refuse, 0.1);
    let nodes: Selector = "k=3,4,5".parse().unwrap();
    let controls = ball.dragged(&[(0, DVec3::new(0.2, 0.3, 1.5))], &nodes).unwrap();
    for (c, (found, before)) in controls.iter().zip(&ball.controls).enumerate() {
        assert!(c % 6 >= 3 || found.to_array().map(f64::to_bits) == before.to_array().map(f64::to_bits));
    }
    assert_ne!(controls, ball.controls);
    // A vertex that is where it should be moves nothing, whether it could or not.
    let there = ball.posed(&ball.controls)[9];
    for nodes in [Selector::All, Selector::List(vec![[0, 0, 0]])] {
        let controls = ball.dragged(&[(9, there)], &nodes).unwrap();
        assert!(controls.iter().zip(&ball.controls).all(|(a, b)| a.distance(*b) <= 1e-15));
    }
}

#[test]
fn far_from_the_origin_nothing_is_lost_but_the_rounding_of_the_target() {
    let mut ball = Posed::new(5, Outside::Refuse, 0.1);
    let points = [(3, DVec3::new(0.5, 0.25, 1.5)), (99, DVec3::new(-0.75, -1.0, 0.125))];
    let near = ball.dragged(&points, &Selector::All).unwrap();
    ball.origin = DVec3::new(2e6, -3e6, 1e6); // these targets and origins have exact sums
    assert_eq!(ball.dragged(&points, &Selector::All).unwrap(), near);
}

#[test]
fn targets_may_be_far_away() {
    let ball = Posed::new(6, Outside::Refuse, 0.1);
    let to = DVec3::new(2e6, 1e6, -3e6);
    let controls = ball.dragged(&[(3, to)], &Selector::All).unwrap();
    assert!(ball.posed(&controls)[3].distance(to) <= 1e-12 * to.length());
}

#[test]
fn duplicates_that_agree_are_met_and_those_that_contradict_are_named() {
    let ball = Posed::new(7, Outside::Refuse, 0.1);
    let (a, b) = (DVec3::new(0.5, 0.5, 0.5), DVec3::new(0.0, 0.9, 0.0));
    let once = ball.dragged(&[(3, a), (60, b)], &Selector::All).unwrap();
    let twice = ball.dragged(&[(3, a), (60, b), (3, a), (3, a)], &Selector::All).unwrap();
    assert_eq!(twice, once);
    let apart = a + DVec3::Y * 0.125;
    match drag_error(ball.dragged(&[(3, a), (60, b), (3, apart)], &Selector::All)) {
        DragError::Contradiction { point: 2, vertex: 3, by } => assert!((by - 0.125).abs() <= 1e-14),
        other => panic!("{other:?}"),
    }
    // One control point can follow one vertex only.
    let node = Selector::List(vec![[2, 2, 3]]);
    let posed = ball.posed(&ball.controls);
    let weight =
        |v: usize| ball.binding.weights(v).iter().find(|(c, _)| *c == 2 * 24 + 2 * 6 + 3).map_or(0.0, |(_, w)| *w);
    let mut followers = (0..posed.len()).filter(|v| weight(*v) > 0.01);
    let (v, w) = (followers.next().unwrap(), followers.nth(5).unwrap());
    ball.dragged(&[(v, posed[v] + DVec3::X)], &node).unwrap();
    match drag_error(ball.dragged(&[(v, posed[v] + DVec3::X), (w, posed[w])], &node)) {
        DragError::Contradiction { point: 1, vertex, by } => {
            assert_eq!(vertex, w);
            assert!((by - weight(w) / weight(v)).abs() <= 1e-13 * by);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn vertices_outside_the_lattice_cannot_be_dragged_unless_it_extends_to_them() {
    let kept = Posed::new(8, Outside::Keep, -0.1);
    let top = (0..162).max_by(|a, b| kept.vertices[*a].z.total_cmp(&kept.vertices[*b].z)).unwrap();
    let to = kept.vertices[top] + DVec3::new(0.0, 3.0, 4.0);
    assert_eq!(drag_error(kept.dragged(&[(top, to)], &Selector::All)), DragError::Unmoved { vertex: top, by: 5.0 });
    kept.dragged(&[(top, kept.vertices[top])], &Selector::All).unwrap();
    let extended = Posed::new(8, Outside::Extend, -0.1);
    let controls = extended.dragged(&[(top, to)], &Selector::All).unwrap();
    assert!(extended.posed(&controls)[top].distance(to) <= 1e-13);
}

#[test]
fn wrong_drags_say_what_is_wrong() {
    let ball = Posed::new(9, Outside::Refuse, 0.1);
    let nan = DVec3::new(0.0, f64::NAN, 0.0);
    let missing = drag_error(ball.dragged(&[(3, DVec3::ZERO), (162, DVec3::ZERO)], &Selector::All));
    assert_eq!(missing, DragError::MissingVertex { vertex: 162, vertices: 162 });
    assert!(matches!(drag_error(ball.dragged(&[(3, nan)], &Selector::All)), DragError::NotFinite { vertex: 3, .. }));
    let huge = DVec3::splat(f64::MAX);
    assert_eq!(drag_error(ball.dragged(&[(3, huge), (4, -huge)], &Selector::All)), DragError::Overflow);
    let nobody = ball.dragged(&[(3, DVec3::ZERO)], &Selector::List(vec![]));
    assert!(matches!(nobody, Err(EditError::Nodes { edit: "drag", .. })));
    // Without vertices.
    let space = ControlSpace {
        rest: &ball.rest,
        size: ball.lattice.size(),
        bounds: ball.lattice.frame().bounds(),
        extent: 2.0,
        origin: DVec3::ZERO,
        vertices: None,
        solid: None,
    };
    let drag = Drag { points: vec![PointRequest { vertex: 0, to: DVec3::ZERO }], nodes: Selector::All };
    let error = Edit::Drag(drag).apply(&mut ball.rest.clone(), &space).unwrap_err();
    assert_eq!(error, EditError::Drag(DragError::MissingVertex { vertex: 0, vertices: 0 }));
}

#[test]
fn least_displacement_says_what_is_wrong() {
    let ball = Posed::new(10, Outside::Refuse, 0.1);
    let free = vec![DVec3::ONE; 120];
    let good = ball.target(5, DVec3::X);
    let mut mobility = free.clone();
    mobility[7].y = -1.0;
    let error = least_displacement(&[], &mobility, 2.0).unwrap_err();
    assert_eq!(error, PointError::Mobility { control: 7, value: DVec3::new(1.0, -1.0, 1.0) });
    let beyond = PointTarget { weights: vec![(120, 1.0)], ..good.clone() };
    let error = least_displacement(&[good.clone(), beyond], &free, 2.0).unwrap_err();
    assert!(matches!(error, PointError::Value { point: 1, .. }), "{error}");
    let infinite = PointTarget { target: DVec3::INFINITY, ..good.clone() };
    assert!(matches!(least_displacement(&[infinite], &free, 2.0), Err(PointError::Value { point: 0, .. })));
    let still = vec![DVec3::new(0.0, 1.0, 1.0); 120];
    let error = least_displacement(std::slice::from_ref(&good), &still, 2.0).unwrap_err();
    assert!(matches!(error, PointError::Contradiction { point: 0, .. }), "x is pinned: {error}");
    let error = least_displacement(&[good], &vec![DVec3::ZERO; 120], 2.0).unwrap_err();
    assert!(matches!(error, PointError::Unmoved { point: 0, .. }), "{error}");
    assert_eq!(least_displacement(&[], &free, 2.0), Ok(vec![DVec3::ZERO; 120]));
}
