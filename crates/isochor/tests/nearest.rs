//! The nearest correction against dense solutions of its condition, and against what nearest means.

mod elimination;
mod random;

use elimination::solved;
use glam::{DMat3, DVec3};
use isochor::shapes::{icosphere, plate, uv_torus};
use isochor::{
    Basis, Binding, Bounds, CorrectOptions, Correction, Corrector, Frame, Lattice, Mesh, Method, OpenBoundaries,
    Outside, Pose, Solid, Status, Wanted, correct, displaced, topology,
};
use proptest::prelude::*;
use random::Random;

fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// A posed model in a lattice.
struct Posed {
    solid: Solid,
    binding: Binding,
    vertices: Vec<DVec3>,
    rest_volume: f64,
}

impl Posed {
    fn new(mesh: &Mesh, size: [usize; 3], pose: impl Fn(DVec3) -> DVec3) -> Self {
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
        let frame = Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap();
        let bases = size.map(|n| Basis::clamped(n, (n - 1).min(3)).unwrap());
        let lattice = Lattice::new(bases, frame).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let displacement: Vec<DVec3> = lattice.rest().iter().map(|c| pose(*c) - *c).collect();
        let vertices = displaced(mesh.points(), &binding.apply(&displacement));
        Self { rest_volume: solid.volume(mesh.points()), solid, binding, vertices }
    }

    /// A blob in a small random lattice, its controls moved at random.
    fn random(random: &mut Random) -> Self {
        let size = [0; 3].map(|_| 2 + random.within(0.0, 3.0) as usize);
        let noise: Vec<DVec3> = (0..1000).map(|_| 0.15 * random.vector()).collect();
        let next = std::cell::Cell::new(0);
        Self::new(&blob(2), size, |c| {
            next.set(next.get() + 1);
            c + noise[next.get() - 1]
        })
    }

    fn correct(&self, target: f64, method: Method, mobility: Option<&[DVec3]>) -> Correction {
        let pose = Pose { solid: &self.solid, vertices: &self.vertices, binding: &self.binding };
        let options = CorrectOptions { method, mobility: mobility.map(<[DVec3]>::to_vec), ..CorrectOptions::default() };
        let corrected = correct(&pose, &Wanted::volume(target), &options).unwrap();
        assert!(corrected.relative_error <= 1e-13, "{:e}", corrected.relative_error);
        corrected
    }

    /// ∇V = Wᵀ g at the controls' displacement δ.
    fn gradient(&self, delta: &[DVec3]) -> Vec<DVec3> {
        self.binding.adjoint(&self.solid.volume_gradient(&displaced(&self.vertices, &self.binding.apply(delta))))
    }

    fn extent(&self) -> f64 {
        Bounds::of(&self.vertices).unwrap().extent()
    }
}

/// x = r(n) n over the sphere.
fn blob(level: usize) -> Mesh {
    let sphere = icosphere(level);
    let radius = |n: DVec3| 1.0 + 0.25 * (3.0 * n.x).sin() * (2.0 * n.y).cos() + 0.15 * (4.0 * n.z + 1.0).sin();
    sphere.with_points(sphere.points().iter().map(|n| *n * radius(*n)).collect()).unwrap()
}

/// Twisted by `degrees` over its height and scaled along z.
fn twisted(degrees: f64, squash: f64) -> impl Fn(DVec3) -> DVec3 {
    move |c| DMat3::from_rotation_z((degrees * c.z / 2.0).to_radians()) * DVec3::new(c.x, c.y, squash * c.z)
}

/// Σ δ²/m over the coordinates that may move.
fn cost(delta: &[DVec3], mobility: &[DVec3]) -> f64 {
    let terms = delta.iter().zip(mobility).flat_map(|(d, m)| d.to_array().into_iter().zip(m.to_array()));
    terms.filter(|(_, m)| *m > 0.0).map(|(d, m)| d * d / m).sum()
}

/// `‖δ − μ M ∘ ∇V‖∞` with the best μ.
fn kkt_residual(posed: &Posed, delta: &[DVec3], mobility: &[DVec3]) -> f64 {
    let gradient = posed.gradient(delta);
    let pull: Vec<DVec3> = gradient.iter().zip(mobility).map(|(g, m)| *g * *m).collect();
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
    let mu = dot(delta, &gradient) / dot(&pull, &gradient);
    delta.iter().zip(&pull).map(|(d, p)| (*d - mu * *p).abs().max_element()).fold(0.0, f64::max)
}

/// Newton's method on the dense condition `δ − μ M ∘ ∇V = 0, V = target`, from `delta`. The Hessian's columns are half the
/// differences of ∇V between unit steps, which is exact as ∇V is a quadratic polynomial along every line.
fn dense_minimiser(posed: &Posed, target: f64, mobility: &[DVec3], mut delta: Vec<DVec3>) -> Vec<DVec3> {
    let flat = |v: &[DVec3]| v.iter().flat_map(|v| v.to_array()).collect::<Vec<f64>>();
    let m = flat(mobility);
    let n = m.len();
    let gradient = flat(&posed.gradient(&delta));
    let pulled: f64 = gradient.iter().zip(&m).map(|(g, m)| g * g * m).sum();
    let mut mu = flat(&delta).iter().zip(&gradient).map(|(d, g)| d * g).sum::<f64>() / pulled;
    for _ in 0..30 {
        let gradient = flat(&posed.gradient(&delta));
        let mut matrix = vec![vec![0.0; n + 1]; n + 1];
        for j in 0..n {
            let (mut ahead, mut behind) = (delta.clone(), delta.clone());
            ahead[j / 3][j % 3] += 1.0;
            behind[j / 3][j % 3] -= 1.0;
            let (ahead, behind) = (flat(&posed.gradient(&ahead)), flat(&posed.gradient(&behind)));
            for i in 0..n {
                matrix[i][j] = f64::from(i == j) - mu * m[i] * (ahead[i] - behind[i]) / 2.0;
            }
        }
        for i in 0..n {
            matrix[i][n] = -m[i] * gradient[i];
            matrix[n][i] = gradient[i];
        }
        let volume = posed.solid.volume(&displaced(&posed.vertices, &posed.binding.apply(&delta)));
        let mut right: Vec<f64> = (0..n).map(|i| mu * m[i] * gradient[i] - delta[i / 3][i % 3]).collect();
        right.push(target - volume);
        let step = solved(matrix, right);
        (0..n).for_each(|i| delta[i / 3][i % 3] += step[i]);
        mu += step[n];
        if step[..n].iter().all(|s| s.abs() < 1e-14) {
            break;
        }
    }
    delta
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn it_solves_the_dense_condition(seed: u64, change in 0.7..1.4f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let free = || if random.within(0.0, 1.0) < 0.2 { 0.0 } else { random.within(0.2, 2.0) };
        let draws: Vec<f64> = std::iter::repeat_with(free).take(3 * posed.binding.control_count()).collect();
        let mobility: Vec<DVec3> = draws.chunks(3).map(DVec3::from_slice).collect();
        let target = change * posed.rest_volume;
        let nearest = posed.correct(target, Method::Nearest, Some(&mobility));
        let dense = dense_minimiser(&posed, target, &mobility, nearest.displacement.clone());
        for (found, expected) in nearest.displacement.iter().zip(&dense) {
            prop_assert!((*found - *expected).abs().max_element() <= 1e-10 * posed.extent(), "{found} {expected}");
        }
        prop_assert!(kkt_residual(&posed, &nearest.displacement, &mobility) <= 1e-10 * posed.extent());
        for (d, m) in nearest.displacement.iter().zip(&mobility) {
            (0..3).for_each(|a| assert!(m[a] > 0.0 || d[a] == 0.0));
        }
    }

    #[test]
    fn no_other_pose_of_the_wanted_volume_is_nearer(seed: u64, change in 0.6..1.5f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let mobility = vec![DVec3::ONE; posed.binding.control_count()];
        let target = change * posed.rest_volume;
        let nearest = posed.correct(target, Method::Nearest, None);
        let least = cost(&nearest.displacement, &mobility);
        for method in [Method::Gradient, Method::xyz()] {
            prop_assert!(least <= cost(&posed.correct(target, method, None).displacement, &mobility) * (1.0 + 1e-12));
        }
        // Random moves from it, small and large, brought back to the volume: never nearer.
        for size in [1e-4, 1e-3, 1e-2, 0.1, 0.3] {
            let moved: Vec<DVec3> = nearest.displacement.iter().map(|d| *d + size * random.vector()).collect();
            let vertices = displaced(&posed.vertices, &posed.binding.apply(&moved));
            let pose = Pose { solid: &posed.solid, vertices: &vertices, binding: &posed.binding };
            let options = CorrectOptions { method: Method::Gradient, mobility: None, ..CorrectOptions::default() };
            let Ok(back) = correct(&pose, &Wanted::volume(target), &options) else { continue };
            let other: Vec<DVec3> = moved.iter().zip(&back.displacement).map(|(a, b)| *a + *b).collect();
            prop_assert!(cost(&other, &mobility) >= least * (1.0 - 1e-12), "size {size}");
        }
    }
}

#[test]
fn large_deficits_converge() {
    // (twist, squash): losses of 40 % to 98 % of the volume, and a gain
    for (degrees, squash) in [(60.0, 0.6), (90.0, 0.4), (90.0, 0.2), (200.0, 0.05), (60.0, 3.0)] {
        let posed = Posed::new(&blob(3), [6, 6, 6], twisted(degrees, squash));
        let nearest = posed.correct(posed.rest_volume, Method::Nearest, None);
        assert_eq!(nearest.status, Status::Exact);
        let mobility = vec![DVec3::ONE; posed.binding.control_count()];
        assert!(kkt_residual(&posed, &nearest.displacement, &mobility) <= 1e-10 * posed.extent());
    }
}

#[test]
fn a_large_mesh_meets_its_own_condition_not_that_of_its_stand_in() {
    // 40,962 vertices: the search runs on a coarse stand-in.
    for (degrees, squash) in [(60.0, 0.6), (90.0, 0.3)] {
        let posed = Posed::new(&blob(6), [5, 6, 5], twisted(degrees, squash));
        let mobility = vec![DVec3::ONE; posed.binding.control_count()];
        let nearest = posed.correct(posed.rest_volume, Method::Nearest, None);
        assert_eq!(nearest.status, Status::Exact);
        assert!(kkt_residual(&posed, &nearest.displacement, &mobility) <= 1e-10 * posed.extent());
        // The same through a prepared corrector, which has another order of the vertices.
        let options = CorrectOptions::default();
        let corrector = Corrector::new(&posed.solid, &posed.binding, &options).unwrap();
        let prepared = corrector.correct(&posed.vertices, &Wanted::volume(posed.rest_volume)).unwrap();
        let apart = prepared.vertices.iter().zip(&nearest.vertices).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(apart <= 1e-9 * posed.extent(), "{apart:e}");
        let cost = |d: &[DVec3]| d.iter().map(|d| d.length_squared()).sum::<f64>();
        let gradient = posed.correct(posed.rest_volume, Method::Gradient, None);
        assert!(cost(&nearest.displacement) <= cost(&gradient.displacement));
    }
}

#[test]
fn a_model_turned_inside_out_by_its_pose_is_brought_back() {
    // The gradient's line turns back before the target; axes reach it, and the search goes on from there.
    let posed = Posed::new(&blob(2), [4, 4, 4], |c| -c);
    assert!(posed.solid.volume(&posed.vertices) < 0.0);
    let pose = Pose { solid: &posed.solid, vertices: &posed.vertices, binding: &posed.binding };
    let options = CorrectOptions { method: Method::Gradient, mobility: None, ..CorrectOptions::default() };
    assert!(correct(&pose, &Wanted::volume(posed.rest_volume), &options).is_err());
    posed.correct(posed.rest_volume, Method::Nearest, None);
}

#[test]
fn it_turns_scales_and_mirrors_with_the_model() {
    let mesh = blob(2);
    let correction = |map: DMat3| {
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).unwrap();
        let bases = [4, 5, 4].map(|n| Basis::clamped(n, 3).unwrap());
        let fitted = Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap();
        let frame = Frame { origin: map * fitted.origin, axes: fitted.axes.map(|a| map * a) };
        let points: Vec<DVec3> = mesh.points().iter().map(|p| map * *p).collect();
        let binding = Lattice::new(bases, frame).unwrap().bind(&points, Outside::Refuse).unwrap();
        let vertices: Vec<DVec3> = mesh.points().iter().map(|p| map * twisted(80.0, 0.6)(*p)).collect();
        let pose = Pose { solid: &solid, vertices: &vertices, binding: &binding };
        correct(&pose, &Wanted::volume(solid.volume(&points)), &CorrectOptions::default()).unwrap().displacement
    };
    let plain = correction(DMat3::IDENTITY);
    let rotation = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 1.1);
    for map in [rotation, DMat3::from_diagonal(DVec3::splat(1e-3)), DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))] {
        let scale = map.determinant().abs().cbrt();
        for (mapped, d) in correction(map).iter().zip(&plain) {
            assert!((*mapped - map * *d).length() <= 1e-9 * scale, "{mapped} {d}");
        }
    }
}

#[test]
fn open_thin_and_ring_shaped_models_converge() {
    let sphere = icosphere(3);
    let open = sphere.faces().iter().filter(|f| f.iter().any(|v| sphere.points()[*v as usize].z < 0.5)).collect();
    let cup = Mesh::new(sphere.points().to_vec(), open).unwrap();
    for mesh in [cup, plate(DVec3::new(1.0, 0.7, 1e-3), [12, 9]), uv_torus(1.0, 0.2, 40, 16)] {
        let posed = Posed::new(&mesh, [5, 5, 4], twisted(70.0, 0.7));
        let nearest = posed.correct(1.1 * posed.rest_volume, Method::Nearest, None);
        assert_eq!(nearest.status, Status::Exact);
        let gradient = posed.correct(1.1 * posed.rest_volume, Method::Gradient, None);
        let mobility = vec![DVec3::ONE; posed.binding.control_count()];
        assert!(cost(&nearest.displacement, &mobility) <= cost(&gradient.displacement, &mobility));
    }
}

#[test]
fn the_gradients_change_is_exact_along_a_line() {
    // ∇V is quadratic along P + t q, so half the difference at t = ±1 is its derivative at t = 0; caps included.
    let mut random = Random(3);
    let sphere = icosphere(2);
    let open = sphere.faces().iter().filter(|f| f.iter().any(|v| sphere.points()[*v as usize].z < 0.3)).collect();
    for mesh in [blob(2), Mesh::new(sphere.points().to_vec(), open).unwrap()] {
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).unwrap();
        let q: Vec<DVec3> = mesh.points().iter().map(|_| random.vector()).collect();
        let at =
            |t: f64| solid.volume_gradient(&mesh.points().iter().zip(&q).map(|(p, q)| *p + t * *q).collect::<Vec<_>>());
        for ((change, ahead), behind) in
            solid.volume_gradient_change(mesh.points(), &q).iter().zip(at(1.0)).zip(at(-1.0))
        {
            assert!((*change - (ahead - behind) / 2.0).length() <= 1e-14);
        }
    }
}
