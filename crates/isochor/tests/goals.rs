//! Several wanted volumes at once, with points and pins.

mod bodies;
mod random;

use bodies::Bodies;
use glam::DVec3;
use isochor::shapes::icosphere;
use isochor::{
    Basis, Bounds, Components, CorrectError, CorrectOptions, Correction, Corrector, Faces, Frame, Lattice, Mesh,
    Method, OpenBoundaries, Outside, Pose, Reason, Solid, Status, VolumeGoal, Wanted, correct, displaced, topology,
};
use proptest::prelude::*;
use random::Random;

fn goal(components: &[usize], volume: f64) -> VolumeGoal {
    VolumeGoal { components: Components::These(components.to_vec()), volume }
}

/// Each component's rest volume times a factor.
fn each(bodies: &Bodies, factors: [f64; 3]) -> Vec<VolumeGoal> {
    let volumes = bodies.rest_volumes.components.iter().zip(factors).enumerate();
    volumes.map(|(c, (volume, factor))| goal(&[c], volume * factor)).collect()
}

fn extent(bodies: &Bodies) -> f64 {
    Bounds::of(&bodies.vertices).unwrap().extent()
}

fn methods() -> [Method; 3] {
    [Method::Nearest, Method::Gradient, Method::xyz()]
}

fn solve(bodies: &Bodies, wanted: &Wanted, options: &CorrectOptions) -> Result<Correction, CorrectError> {
    correct(&Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding }, wanted, options)
}

/// What must hold of any correction.
fn check(bodies: &Bodies, wanted: &Wanted, mobility: Option<&[DVec3]>, corrected: &Correction) {
    assert!(corrected.relative_error <= 1e-13, "{:e}", corrected.relative_error);
    assert!(corrected.point_error <= 1e-12);
    let vertices = displaced(&bodies.vertices, &bodies.binding.apply(&corrected.displacement));
    let volumes = bodies.solid.volumes(&vertices);
    for goal in &wanted.volumes {
        assert!(((goal.of(&volumes) - goal.volume) / goal.volume).abs() <= 1e-13, "{goal:?}: {}", goal.of(&volumes));
    }
    for point in &wanted.points {
        let moved: DVec3 = point.weights.iter().map(|(c, w)| *w * corrected.displacement[*c]).sum();
        assert!((point.position + moved - point.target).length() <= 1e-12 * extent(bodies));
    }
    for (m, d) in mobility.unwrap_or_default().iter().zip(&corrected.displacement) {
        assert!((0..3).all(|a| m[a] > 0.0 || d[a].to_bits() == 0), "a pinned coordinate moved");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn every_component_gets_its_own_volume(seed: u64, f in 0.7..1.4f64, g in 0.7..1.3f64, h in 0.6..1.5f64) {
        let mut random = Random(seed);
        let bodies = Bodies::new(&mut random, [5, 4, 4], 0.1);
        let mobility = bodies.mobility(&mut random, 0.1);
        for points in [vec![], vec![bodies.point(3, 0.05 * random.vector()), bodies.point(400, 0.05 * random.vector())]] {
            let wanted = Wanted { volumes: each(&bodies, [f, g, h]), points };
            for method in methods() {
                let options = CorrectOptions { method, mobility: Some(mobility.clone()), energy: None };
                let corrected = solve(&bodies, &wanted, &options).unwrap();
                prop_assert_eq!(corrected.status, Status::Exact);
                check(&bodies, &wanted, Some(&mobility), &corrected);
            }
        }
    }

    #[test]
    fn the_nearest_pose_is_nearest_and_meets_its_condition(seed: u64, f in 0.8..1.2f64, g in 0.8..1.2f64) {
        let mut random = Random(seed);
        let bodies = Bodies::new(&mut random, [4, 4, 4], 0.1);
        let wanted = Wanted { volumes: each(&bodies, [f, g, 1.0]), points: vec![] };
        let nearest = solve(&bodies, &wanted, &CorrectOptions::default()).unwrap();
        check(&bodies, &wanted, None, &nearest);
        prop_assert!(nearest.residual.unwrap() <= 1e-10);
        // δ = Σ μ_c ∇V_c, the gradients taken one component at a time by differences of affine functions.
        let vertices = displaced(&bodies.vertices, &bodies.binding.apply(&nearest.displacement));
        let flat = |v: &[DVec3]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<f64>>();
        let delta = flat(&nearest.displacement);
        let mut basis: Vec<Vec<f64>> = Vec::new();
        let slopes = slopes(&bodies, &vertices);
        for mut row in slopes {
            for _ in 0..2 {
                for q in &basis {
                    let part: f64 = row.iter().zip(q).map(|(a, b)| a * b).sum();
                    row.iter_mut().zip(q).for_each(|(a, b)| *a -= part * b);
                }
            }
            let norm = row.iter().map(|x| x * x).sum::<f64>().sqrt();
            basis.push(row.iter().map(|x| x / norm).collect());
        }
        let mut rest = delta.clone();
        for q in &basis {
            let part: f64 = rest.iter().zip(q).map(|(a, b)| a * b).sum();
            rest.iter_mut().zip(q).for_each(|(a, b)| *a -= part * b);
        }
        prop_assert!(rest.iter().all(|r| r.abs() <= 1e-10 * extent(&bodies)), "{:?}", rest);
        // No other correction is nearer.
        let cost = |delta: &[DVec3]| delta.iter().map(|d| d.length_squared()).sum::<f64>();
        for method in [Method::Gradient, Method::xyz()] {
            let options = CorrectOptions { method, ..CorrectOptions::default() };
            let other = solve(&bodies, &wanted, &options).unwrap();
            prop_assert!(cost(&nearest.displacement) <= cost(&other.displacement) * (1.0 + 1e-12));
        }
    }
}

/// ∇V of each component (#components × 3 #controls): half the differences between unit steps, exact along coordinates.
fn slopes(bodies: &Bodies, vertices: &[DVec3]) -> Vec<Vec<f64>> {
    let components = bodies.rest_volumes.components.len();
    let mut slopes = vec![vec![0.0; 3 * bodies.controls()]; components];
    for j in 0..3 * bodies.controls() {
        let mut unit = vec![DVec3::ZERO; bodies.controls()];
        unit[j / 3][j % 3] = 1.0;
        let by = bodies.binding.apply(&unit);
        let behind: Vec<DVec3> = vertices.iter().zip(&by).map(|(p, d)| *p - *d).collect();
        let (ahead, behind) = (bodies.solid.volumes(&displaced(vertices, &by)), bodies.solid.volumes(&behind));
        for (c, slope) in slopes.iter_mut().enumerate() {
            slope[j] = (ahead.components[c] - behind.components[c]) / 2.0;
        }
    }
    slopes
}

#[test]
fn along_one_axis_the_step_is_the_closed_form() {
    // δ = Aᵀ (A Aᵀ)⁻¹ b with the rows α of two components, 2 × 2 solved by hand.
    let bodies = Bodies::new(&mut Random(5), [4, 3, 3], 0.1);
    let wanted = Wanted { volumes: vec![goal(&[0], 5.0), goal(&[2], 0.6)], points: vec![] };
    let method = Method::Axes { directions: vec![DVec3::Y], shares: None };
    let corrected = solve(&bodies, &wanted, &CorrectOptions { method, ..CorrectOptions::default() }).unwrap();
    let slopes = slopes(&bodies, &bodies.vertices);
    let alpha = |c: usize| slopes[c].iter().skip(1).step_by(3).copied().collect::<Vec<f64>>();
    let (a, b) = (alpha(0), alpha(2));
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let before = bodies.solid.volumes(&bodies.vertices).components;
    let (p, q) = (5.0 - before[0], 0.6 - before[2]);
    let (aa, ab, bb) = (dot(&a, &a), dot(&a, &b), dot(&b, &b));
    let (s, t) = ((bb * p - ab * q) / (aa * bb - ab * ab), (aa * q - ab * p) / (aa * bb - ab * ab));
    for (i, d) in corrected.displacement.iter().enumerate() {
        assert!((*d - DVec3::Y * (s * a[i] + t * b[i])).length() <= 1e-12, "{d}");
    }
}

#[test]
fn groups_capacity_and_material_can_be_combined() {
    let bodies = Bodies::new(&mut Random(6), [5, 4, 4], 0.08);
    let v = &bodies.rest_volumes.components;
    // The shell keeps its material while it holds 10 % more; the blob beside it is free.
    let wanted = Wanted { volumes: vec![goal(&[0, 1], v[0] + v[1]), goal(&[1], 1.1 * v[1])], points: vec![] };
    for method in methods() {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let corrected = solve(&bodies, &wanted, &options).unwrap();
        check(&bodies, &wanted, None, &corrected);
        assert!((corrected.component_volumes[1] / v[1] - 1.1).abs() < 1e-13);
    }
}

#[test]
fn volumes_that_follow_from_others_agree_or_contradict() {
    let bodies = Bodies::new(&mut Random(7), [4, 4, 4], 0.1);
    let mut volumes = each(&bodies, [1.0, 1.1, 0.9]);
    let whole: f64 = volumes.iter().map(|goal| goal.volume).sum();
    volumes.push(VolumeGoal { components: Components::All, volume: whole });
    for method in methods() {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let wanted = Wanted { volumes: volumes.clone(), points: vec![] };
        check(&bodies, &wanted, None, &solve(&bodies, &wanted, &options).unwrap());
        let mut wrong = wanted.clone();
        wrong.volumes[3].volume *= 1.01;
        match solve(&bodies, &wrong, &options) {
            Err(CorrectError::Impossible { goal: Some(3), reason: Reason::Follows { follows }, .. }) => {
                assert!((follows - whole).abs() <= 1e-12 * whole);
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_component_that_no_control_moves_keeps_its_volume_or_is_dead() {
    // Controls with i < 3 do not reach the blob beside (x from 1.3 on) when only they may move.
    let bodies = Bodies::new(&mut Random(8), [8, 4, 4], 0.0);
    let last = (0..bodies.controls()).map(|c| if bodies.lattice.node(c)[0] < 2 { DVec3::ONE } else { DVec3::ZERO });
    let mobility: Vec<DVec3> = last.collect();
    for method in methods() {
        let options = CorrectOptions { method, mobility: Some(mobility.clone()), energy: None };
        let wanted = Wanted { volumes: each(&bodies, [1.02, 1.0, 1.0]), points: vec![] };
        check(&bodies, &wanted, Some(&mobility), &solve(&bodies, &wanted, &options).unwrap());
        let wanted = Wanted { volumes: each(&bodies, [1.02, 1.0, 1.1]), points: vec![] };
        match solve(&bodies, &wanted, &options) {
            Err(CorrectError::Impossible { goal: Some(2), reason: Reason::Dead, .. }) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn volumes_that_can_only_change_together_are_coupled() {
    // One control may move, along x only: one degree of freedom for two volumes.
    let bodies = Bodies::new(&mut Random(9), [4, 4, 4], 0.05);
    let one = |c| if c == bodies.lattice.index([1, 1, 1]) { DVec3::X } else { DVec3::ZERO };
    let mobility: Vec<DVec3> = (0..bodies.controls()).map(one).collect();
    for method in methods() {
        let options = CorrectOptions { method, mobility: Some(mobility.clone()), energy: None };
        let volumes = bodies.solid.volumes(&bodies.vertices).components;
        let wanted =
            Wanted { volumes: vec![goal(&[0], 1.01 * volumes[0]), goal(&[1], 1.1 * volumes[1])], points: vec![] };
        match solve(&bodies, &wanted, &options) {
            Err(CorrectError::Impossible { goal: Some(1), reason: Reason::Coupled { by }, .. }) => assert!(by > 1e-3),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn sixty_four_bodies_keep_sixty_four_volumes() {
    let ball = icosphere(1);
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for k in 0..64_usize {
        let center = DVec3::new((k / 16) as f64, (k / 4 % 4) as f64, (k % 4) as f64);
        let first = points.len() as u32;
        points.extend(ball.points().iter().map(|p| center + 0.3 * *p));
        ball.faces().iter().for_each(|face| faces.push(&[face[0] + first, face[1] + first, face[2] + first]));
    }
    let mesh = Mesh::new(points, faces).unwrap();
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    let lattice = Lattice::new(
        [0; 3].map(|_| Basis::clamped(8, 3).unwrap()),
        Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap(),
    );
    let binding = lattice.unwrap().bind(mesh.points(), Outside::Refuse).unwrap();
    let mut random = Random(13);
    let moved: Vec<DVec3> = (0..binding.control_count()).map(|_| 0.1 * random.vector()).collect();
    let vertices = displaced(mesh.points(), &binding.apply(&moved));
    let rest = solid.volumes(mesh.points()).components;
    let volumes = rest.iter().enumerate().map(|(c, v)| goal(&[c], v * random.within(0.95, 1.05))).collect();
    let wanted = Wanted { volumes, points: vec![] };
    for method in methods() {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let pose = Pose { solid: &solid, vertices: &vertices, binding: &binding };
        let corrected = correct(&pose, &wanted, &options).unwrap();
        assert_eq!(corrected.status, Status::Exact);
        for (goal, volume) in wanted.volumes.iter().zip(&corrected.component_volumes) {
            assert!((volume / goal.volume - 1.0).abs() <= 1e-13);
        }
    }
}

#[test]
fn bad_goals_are_named() {
    let bodies = Bodies::new(&mut Random(10), [3, 3, 3], 0.05);
    let refused =
        |volumes| solve(&bodies, &Wanted { volumes, points: vec![] }, &CorrectOptions::default()).unwrap_err();
    assert_eq!(
        refused(vec![goal(&[0], 1.0), goal(&[3], 1.0)]),
        CorrectError::MissingComponent { goal: 1, component: 3, components: 3 }
    );
    assert_eq!(refused(vec![goal(&[0, 0], 1.0)]), CorrectError::Components { goal: 0 });
    assert_eq!(refused(vec![goal(&[], 1.0)]), CorrectError::Components { goal: 0 });
    assert_eq!(refused(vec![goal(&[0], 0.0)]), CorrectError::Target { target: 0.0 });
    assert!(matches!(refused(vec![goal(&[0], f64::NAN)]), CorrectError::Target { target } if target.is_nan()));
}

#[test]
fn without_volumes_only_points_are_met() {
    let bodies = Bodies::new(&mut Random(11), [4, 4, 4], 0.05);
    let wanted = Wanted { volumes: vec![], points: vec![bodies.point(7, DVec3::new(0.1, 0.0, -0.2))] };
    for method in methods() {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let corrected = solve(&bodies, &wanted, &options).unwrap();
        check(&bodies, &wanted, None, &corrected);
        // δ_i = w_i (T − S)/Σ w²
        let weights = &wanted.points[0].weights;
        let square: f64 = weights.iter().map(|(_, w)| w * w).sum();
        for (c, w) in weights {
            let expected = DVec3::new(0.1, 0.0, -0.2) * (w / square);
            assert!((corrected.displacement[*c] - expected).length() < 1e-14);
        }
    }
}

#[test]
fn a_prepared_corrector_gives_the_same_as_one_off_corrections() {
    let bodies = Bodies::new(&mut Random(12), [4, 4, 4], 0.1);
    for method in methods() {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let corrector = Corrector::new(&bodies.solid, &bodies.binding, &options).unwrap();
        for factor in [0.8, 1.0, 1.3] {
            let wanted = Wanted { volumes: each(&bodies, [factor, 1.0, 1.0]), points: vec![] };
            let once = solve(&bodies, &wanted, &options).unwrap();
            let prepared = corrector.correct(&bodies.vertices, &wanted).unwrap();
            let far = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            assert!(far(&once.displacement, &prepared.displacement) <= 1e-12);
            assert!(far(&once.vertices, &prepared.vertices) <= 1e-12);
            check(&bodies, &wanted, None, &prepared);
        }
    }
}

#[test]
fn squares_of_gradients_may_leave_the_range_of_numbers() {
    let mut bodies = Bodies::new(&mut Random(13), [4, 4, 4], 0.05);
    bodies.vertices.iter_mut().for_each(|p| *p *= 1e82);
    let volumes = each(&bodies, [1.05, 0.97, 1.1]);
    let volumes: Vec<VolumeGoal> = volumes.into_iter().map(|g| VolumeGoal { volume: g.volume * 1e246, ..g }).collect();
    for count in [1, 3] {
        for method in methods() {
            let options = CorrectOptions { method, ..CorrectOptions::default() };
            let wanted = Wanted { volumes: volumes[..count].to_vec(), points: vec![] };
            check(&bodies, &wanted, None, &solve(&bodies, &wanted, &options).unwrap());
        }
    }
}
