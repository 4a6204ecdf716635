//! Derivatives of corrections: transposes agree, and central differences converge to them.

mod bodies;
mod random;

use bodies::Bodies;
use glam::DVec3;
use isochor::{
    Cause, Components, CorrectOptions, Corrector, Effect, Energy, Method, PointTarget, VolumeGoal, Wanted, displaced,
};
use random::Random;

/// A request with all that can be asked of it.
struct Request {
    bodies: Bodies,
    options: CorrectOptions,
    wanted: Wanted,
}

fn oblique() -> Method {
    let directions = vec![DVec3::new(1.0, 0.3, 0.0), DVec3::new(-0.2, 1.0, 0.4), DVec3::new(0.1, 0.1, 1.0), DVec3::X];
    Method::Axes { directions, shares: Some(vec![1.0, 2.0, 1.0, 0.5]) }
}

fn requests() -> Vec<(String, Request)> {
    let mut requests = Vec::new();
    let methods =
        [("nearest", Method::Nearest), ("gradient", Method::Gradient), ("xyz", Method::xyz()), ("oblique", oblique())];
    for (name, method) in methods {
        for kind in ["plain", "points", "pinned", "energy", "parts", "met"] {
            let mut random = Random(11);
            let bodies = Bodies::new(&mut random, [4, 3, 4], if kind == "met" { 0.0 } else { 0.08 });
            let mut options = CorrectOptions { method: method.clone(), ..CorrectOptions::default() };
            let mut wanted = Wanted::volume(1.15 * bodies.rest_volumes.total);
            if kind == "points" || kind == "parts" {
                wanted.points =
                    vec![bodies.point(3, 0.04 * random.vector()), bodies.point(170, 0.04 * random.vector())];
            }
            if kind == "pinned" {
                options.mobility = Some(match name {
                    // Along oblique axes a pinned coordinate pins the control.
                    "oblique" => bodies.mobility(&mut random, 0.1).iter().map(|m| DVec3::splat(m.x)).collect(),
                    _ => bodies.mobility(&mut random, 0.1),
                });
            }
            if kind == "energy" {
                options.energy = Some(Energy::edges(&bodies.lattice).unwrap());
            }
            if kind == "parts" {
                let v = &bodies.rest_volumes.components;
                let goal = |c: &[usize], volume| VolumeGoal { components: Components::These(c.to_vec()), volume };
                wanted.volumes =
                    vec![goal(&[0, 1], 1.05 * (v[0] + v[1])), goal(&[1], 1.1 * v[1]), goal(&[2], 0.9 * v[2])];
            }
            if kind == "met" {
                wanted = Wanted::volume(bodies.rest_volumes.total);
            }
            requests.push((format!("{name}, {kind}"), Request { bodies, options, wanted }));
        }
    }
    requests
}

impl Request {
    fn cause(&self, random: &mut Random) -> Cause {
        Cause {
            controls: (0..self.bodies.controls()).map(|_| random.vector()).collect(),
            volumes: self.wanted.volumes.iter().map(|_| random.within(-1.0, 1.0)).collect(),
            points: self.wanted.points.iter().map(|_| random.vector()).collect(),
        }
    }

    fn effect(&self, random: &mut Random) -> Effect {
        Effect {
            controls: (0..self.bodies.controls()).map(|_| random.vector()).collect(),
            vertices: (0..self.bodies.vertices.len()).map(|_| random.vector()).collect(),
        }
    }

    /// The corrected controls' displacement from the unchanged pose, and the vertices, with the causes changed by `step` times `cause`.
    fn result(&self, cause: &Cause, step: f64) -> Effect {
        let bodies = &self.bodies;
        let displacement: Vec<DVec3> = cause.controls.iter().map(|c| step * *c).collect();
        let vertices = displaced(&bodies.vertices, &bodies.binding.apply(&displacement));
        let mut wanted = self.wanted.clone();
        wanted.volumes.iter_mut().zip(&cause.volumes).for_each(|(goal, by)| goal.volume += step * by);
        for (point, by) in wanted.points.iter_mut().zip(&cause.points) {
            let moved: DVec3 = point.weights.iter().map(|(c, w)| *w * cause.controls[*c]).sum();
            let PointTarget { position, target, .. } = point;
            (*position, *target) = (*position + step * moved, *target + step * *by);
        }
        let corrector = Corrector::new(&bodies.solid, &bodies.binding, &self.options).unwrap();
        let corrected = corrector.correct(&vertices, &wanted).unwrap();
        let controls = displacement.iter().zip(&corrected.displacement).map(|(a, b)| *a + *b).collect();
        Effect { controls, vertices: corrected.vertices }
    }
}

fn dot(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
}

#[test]
fn forward_and_transposed_products_are_transposes() {
    for (name, request) in requests() {
        let corrector = Corrector::new(&request.bodies.solid, &request.bodies.binding, &request.options).unwrap();
        let sensitivity = corrector.sensitivity(&request.bodies.vertices, &request.wanted).unwrap();
        assert!(sensitivity.correction().relative_error <= 1e-13);
        let mut random = Random(21);
        for _ in 0..3 {
            let (cause, effect) = (request.cause(&mut random), request.effect(&mut random));
            let ahead = sensitivity.forward(&cause);
            let back = sensitivity.transposed(&effect);
            let volumes: f64 = back.volumes.iter().zip(&cause.volumes).map(|(a, b)| a * b).sum();
            let left = dot(&ahead.controls, &effect.controls) + dot(&ahead.vertices, &effect.vertices);
            let right = dot(&back.controls, &cause.controls) + volumes + dot(&back.points, &cause.points);
            let size = (dot(&ahead.controls, &ahead.controls) + dot(&ahead.vertices, &ahead.vertices)).sqrt()
                * (dot(&effect.controls, &effect.controls) + dot(&effect.vertices, &effect.vertices)).sqrt();
            assert!((left - right).abs() <= 1e-11 * size, "{name}: {left} against {right}");
        }
    }
}

#[test]
fn central_differences_converge_to_the_forward_product() {
    for (name, request) in requests() {
        let corrector = Corrector::new(&request.bodies.solid, &request.bodies.binding, &request.options).unwrap();
        let sensitivity = corrector.sensitivity(&request.bodies.vertices, &request.wanted).unwrap();
        let cause = request.cause(&mut Random(31));
        let exact = sensitivity.forward(&cause);
        let size = dot(&exact.controls, &exact.controls).sqrt();
        // The error falls as the square of the step until rounding shows: a factor of 100 for a tenth of the step.
        let error = |step: f64| {
            let (ahead, behind) = (request.result(&cause, step), request.result(&cause, -step));
            let off = |a: &[DVec3], b: &[DVec3], exact: &[DVec3]| -> f64 {
                let slopes = a.iter().zip(b).zip(exact);
                slopes.map(|((a, b), e)| ((*a - *b) / (2.0 * step) - *e).length_squared()).sum::<f64>().sqrt()
            };
            let controls = off(&ahead.controls, &behind.controls, &exact.controls);
            let vertices = off(&ahead.vertices, &behind.vertices, &exact.vertices);
            assert!(vertices <= 60.0 * controls + 1e-7 * size, "{name}: vertices off by {vertices:e}");
            controls / size
        };
        let ladder = [1e-2, 1e-3, 1e-4, 1e-5].map(error);
        assert!(ladder[2] <= 2e-6, "{name}: {ladder:?}");
        assert!(ladder[1] <= ladder[0] / 50.0 || ladder[1] < 1e-7, "{name}: {ladder:?}");
        assert!(ladder[2] <= ladder[1] / 20.0 || ladder[2] < 1e-7, "{name}: {ladder:?}");
        // Energies that are stiff in some directions leave more of the rounding.
        assert!(ladder[3] < if name.ends_with("energy") { 2e-6 } else { 1e-7 }, "{name}: {ladder:?}");
    }
}

#[test]
fn pinned_controls_follow_the_pose_and_nothing_else() {
    for (name, request) in requests().into_iter().filter(|(name, _)| name.ends_with("pinned")) {
        let corrector = Corrector::new(&request.bodies.solid, &request.bodies.binding, &request.options).unwrap();
        let sensitivity = corrector.sensitivity(&request.bodies.vertices, &request.wanted).unwrap();
        let cause = request.cause(&mut Random(41));
        let effect = sensitivity.forward(&cause);
        let mobility = request.options.mobility.as_ref().unwrap();
        for (c, m) in mobility.iter().enumerate() {
            for a in (0..3).filter(|a| m[*a] == 0.0) {
                assert_eq!(effect.controls[c][a], cause.controls[c][a], "{name}");
            }
        }
    }
}

#[test]
fn volumes_and_points_follow_their_targets_exactly() {
    for (name, request) in requests() {
        let bodies = &request.bodies;
        let corrector = Corrector::new(&bodies.solid, &bodies.binding, &request.options).unwrap();
        let sensitivity = corrector.sensitivity(&bodies.vertices, &request.wanted).unwrap();
        let cause = request.cause(&mut Random(51));
        let effect = sensitivity.forward(&cause);
        if request.wanted.volumes[0].components == Components::All {
            let gradient = bodies.solid.volume_gradient(&sensitivity.correction().vertices);
            let change = dot(&gradient, &effect.vertices);
            assert!((change - cause.volumes[0]).abs() <= 1e-9, "{name}: {change} instead of {}", cause.volumes[0]);
        }
        for (point, by) in request.wanted.points.iter().zip(&cause.points) {
            let moved: DVec3 = point.weights.iter().map(|(c, w)| *w * effect.controls[*c]).sum();
            assert!((moved - *by).length() <= 1e-9, "{name}");
        }
    }
}
