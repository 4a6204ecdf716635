//! Corrections that keep something else small than the displacement of the controls.

mod bodies;
mod elimination;
mod random;

use bodies::Bodies;
use elimination::solved;
use glam::DVec3;
use isochor::{CorrectError, CorrectOptions, Energy, Method, Pose, Wanted, correct, displaced, tolerances};
use random::Random;

fn energies(bodies: &Bodies) -> [(&'static str, Energy); 3] {
    [
        ("surface", Energy::surface(&bodies.binding).unwrap()),
        ("edges", Energy::edges(&bodies.lattice).unwrap()),
        ("bending", Energy::bending(&bodies.lattice).unwrap()),
    ]
}

/// S as a full matrix.
fn dense(energy: &Energy) -> Vec<Vec<f64>> {
    let n = energy.control_count();
    let mut matrix = vec![vec![0.0; n]; n];
    for &(i, j, s) in energy.upper_triangle() {
        (matrix[i][j], matrix[j][i]) = (s, s);
    }
    matrix
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The value of S per unit of an unscaled energy: mean diagonal 1.
fn scale(unscaled_trace: f64, controls: usize) -> f64 {
    controls as f64 / unscaled_trace
}

#[test]
fn the_surface_energy_is_the_squared_distance_of_the_vertices() {
    let bodies = Bodies::new(&mut Random(1), [4, 3, 5], 0.1);
    let energy = Energy::surface(&bodies.binding).unwrap();
    let trace: f64 = (0..bodies.vertices.len()).flat_map(|v| bodies.binding.weights(v)).map(|(_, w)| w * w).sum();
    let y: Vec<DVec3> = (0..bodies.controls()).map(|_| Random(3).vector()).collect();
    let mut random = Random(4);
    let y: Vec<DVec3> = y.iter().map(|y| *y + random.vector()).collect();
    let distance: f64 = bodies.binding.apply(&y).iter().map(|d| d.length_squared()).sum();
    let floor = tolerances::SURFACE_FLOOR * y.iter().map(|y| y.length_squared()).sum::<f64>();
    let expected = scale(trace, bodies.controls()) * distance + floor;
    assert!((energy.of(&y) - expected).abs() <= 1e-13 * expected);
}

#[test]
fn matrices_beyond_memory_are_refused() {
    let lattice = |size: usize, degree: usize| {
        let bases = [0; 3].map(|_| isochor::Basis::clamped(size, degree).unwrap());
        let frame = isochor::Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
        isochor::Lattice::new(bases, frame).unwrap()
    };
    let too_large = |controls| Err(CorrectError::Energy { controls });
    let large = lattice(200, 1);
    assert_eq!(Energy::edges(&large), too_large(8_000_000));
    assert_eq!(Energy::bending(&large), too_large(8_000_000));
    let dense = lattice(24, 23).bind(&[DVec3::splat(0.5)], isochor::Outside::Refuse).unwrap();
    assert_eq!(Energy::surface(&dense), too_large(13_824));
    assert!(Energy::surface(&lattice(8, 7).bind(&[DVec3::splat(0.5)], isochor::Outside::Refuse).unwrap()).is_ok());
}

#[test]
fn translations_change_no_edge_and_affine_maps_bend_nothing() {
    let bodies = Bodies::new(&mut Random(2), [5, 4, 6], 0.0);
    let rest = bodies.lattice.rest();
    let floor = |y: &[DVec3]| tolerances::ENERGY_FLOOR * y.iter().map(|y| y.length_squared()).sum::<f64>();
    let translated = vec![DVec3::new(1.0, -2.0, 0.5); rest.len()];
    let edges = Energy::edges(&bodies.lattice).unwrap();
    assert!((edges.of(&translated) - floor(&translated)).abs() <= 1e-12);
    let affine: Vec<DVec3> = rest.iter().map(|c| DVec3::new(c.x + 2.0 * c.y, 1.0 - c.z, 3.0 * c.x)).collect();
    let bending = Energy::bending(&bodies.lattice).unwrap();
    assert!((bending.of(&affine) - floor(&affine)).abs() <= 1e-9, "{}", bending.of(&affine));
    assert!(edges.of(&affine) > 1.0);
    let bent: Vec<DVec3> = rest.iter().map(|c| DVec3::Z * c.x * c.x).collect();
    assert!(bending.of(&bent) > 1e-3);
}

#[test]
fn the_energy_of_edges_of_a_unit_move_is_that_of_its_edges() {
    // One control of a lattice with unit edges moves by 1: its edges change by 1 each.
    let bases = [0; 3].map(|_| isochor::Basis::clamped(4, 1).unwrap());
    let frame = isochor::Frame { origin: DVec3::ZERO, axes: [DVec3::X * 3.0, DVec3::Y * 3.0, DVec3::Z * 3.0] };
    let lattice = isochor::Lattice::new(bases, frame).unwrap();
    let energy = Energy::edges(&lattice).unwrap();
    let mean = 2.0 * (3.0 * 3.0 * 16.0) / 64.0; // edges end at two controls each
    for (node, edges) in [([0, 0, 0], 3.0), ([1, 0, 0], 4.0), ([1, 2, 0], 5.0), ([1, 1, 2], 6.0)] {
        let mut y = vec![DVec3::ZERO; 64];
        y[lattice.index(node)] = DVec3::Y;
        assert!((energy.of(&y) - (edges / mean + tolerances::ENERGY_FLOOR)).abs() <= 1e-14, "{node:?}");
    }
}

#[test]
fn along_one_axis_the_step_is_the_dense_closed_form() {
    // δ = a H⁻¹α / (α·H⁻¹α) with H = M^-½ S M^-½, pinned rows and columns struck out.
    let mut random = Random(5);
    let bodies = Bodies::new(&mut random, [4, 3, 4], 0.1);
    let volume = bodies.solid.volume(&bodies.vertices);
    for pinned in [0.0, 0.2] {
        let m: Vec<f64> = bodies.mobility(&mut random, pinned).iter().map(|m| m.z).collect();
        let free: Vec<usize> = (0..m.len()).filter(|c| m[*c] > 0.0).collect();
        let gradient = bodies.binding.adjoint(&bodies.solid.volume_gradient(&bodies.vertices));
        for (name, energy) in energies(&bodies) {
            let s = dense(&energy);
            let h = free.iter().map(|i| free.iter().map(|j| s[*i][*j] / (m[*i] * m[*j]).sqrt()).collect()).collect();
            let alpha: Vec<f64> = free.iter().map(|c| gradient[*c].z).collect();
            let direction = solved(h, alpha.clone());
            let factor = 0.2 * volume / dot(&alpha, &direction);
            let options = CorrectOptions {
                method: Method::Axes { directions: vec![DVec3::Z], shares: None },
                mobility: Some(m.iter().map(|m| DVec3::splat(*m)).collect()),
                energy: Some(energy),
            };
            let pose = Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding };
            let corrected = correct(&pose, &Wanted::volume(1.2 * volume), &options).unwrap();
            let largest = direction.iter().map(|d| (factor * d).abs()).fold(0.0, f64::max);
            for (c, d) in corrected.displacement.iter().enumerate() {
                let expected = free.iter().position(|f| *f == c).map_or(0.0, |r| factor * direction[r]);
                assert!((*d - DVec3::Z * expected).length() <= 1e-9 * largest, "{name}: {d} instead of {expected}");
                assert!(m[c] > 0.0 || d.z.to_bits() == 0);
            }
        }
    }
}

#[test]
fn nearest_meets_the_dense_condition_and_costs_least() {
    let mut random = Random(6);
    let bodies = Bodies::new(&mut random, [4, 4, 3], 0.08);
    let target = 1.25 * bodies.rest_volumes.total;
    let pose = Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding };
    let point = bodies.point(20, DVec3::new(0.05, 0.02, -0.04));
    for (name, energy) in energies(&bodies) {
        for points in [vec![], vec![point.clone()]] {
            let wanted = Wanted { points, ..Wanted::volume(target) };
            let solve = |method| {
                let options = CorrectOptions { method, mobility: None, energy: Some(energy.clone()) };
                let corrected = correct(&pose, &wanted, &options).unwrap();
                assert!(corrected.relative_error <= 1e-13 && corrected.point_error <= 1e-12);
                corrected
            };
            let nearest = solve(Method::Nearest);
            let cost = energy.of(&nearest.displacement);
            assert!(cost <= energy.of(&solve(Method::Gradient).displacement) * (1.0 + 1e-12), "{name}");
            assert!(cost <= energy.of(&solve(Method::xyz()).displacement) * (1.0 + 1e-12), "{name}");
            if wanted.points.is_empty() {
                // S δ is parallel to ∇V at the end.
                let at_end = displaced(&bodies.vertices, &bodies.binding.apply(&nearest.displacement));
                let gradient = bodies.binding.adjoint(&bodies.solid.volume_gradient(&at_end));
                let s = dense(&energy);
                let flat = |f: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
                    (0..3 * bodies.controls()).map(|k| f(k / 3, k % 3)).collect()
                };
                let g = flat(&|c, a| gradient[c][a]);
                let pulled = flat(&|c, a| (0..bodies.controls()).map(|j| s[c][j] * nearest.displacement[j][a]).sum());
                let mu = dot(&pulled, &g) / dot(&g, &g);
                let largest = g.iter().map(|g| (mu * g).abs()).fold(0.0, f64::max);
                assert!(pulled.iter().zip(&g).all(|(p, g)| (p - mu * g).abs() <= 1e-8 * largest), "{name}");
            }
        }
    }
}

#[test]
fn the_surface_moves_least_with_the_surface_energy() {
    let bodies = Bodies::new(&mut Random(7), [6, 5, 5], 0.08);
    let pose = Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding };
    let wanted = Wanted::volume(1.1 * bodies.rest_volumes.total);
    let moved = |energy: Option<Energy>| {
        let corrected = correct(&pose, &wanted, &CorrectOptions { energy, ..CorrectOptions::default() }).unwrap();
        bodies.binding.apply(&corrected.displacement).iter().map(|d| d.length_squared()).sum::<f64>()
    };
    let least = moved(Some(Energy::surface(&bodies.binding).unwrap()));
    assert!(least < moved(None));
    assert!(least < moved(Some(Energy::edges(&bodies.lattice).unwrap())));
    assert!(least < moved(Some(Energy::bending(&bodies.lattice).unwrap())));
}

#[test]
fn an_energy_for_other_controls_is_refused() {
    let bodies = Bodies::new(&mut Random(8), [3, 3, 3], 0.05);
    let other = Bodies::new(&mut Random(8), [3, 3, 4], 0.05);
    let options = CorrectOptions { energy: Some(Energy::edges(&other.lattice).unwrap()), ..CorrectOptions::default() };
    let pose = Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding };
    let refused = correct(&pose, &Wanted::volume(1.0), &options).unwrap_err();
    assert!(refused.to_string().contains("energy has 36 entries: 27"), "{refused}");
}

#[test]
fn an_energy_of_controls_that_do_not_touch_has_a_diagonal_factor() {
    // One control may move: the factor is a number. Two corners: a diagonal.
    let bodies = Bodies::new(&mut Random(9), [4, 4, 4], 0.05);
    let pose = Pose { solid: &bodies.solid, vertices: &bodies.vertices, binding: &bodies.binding };
    let target = 1.001 * bodies.solid.volume(&bodies.vertices);
    for free in [&[[1, 1, 1]][..], &[[0, 0, 0], [3, 3, 3]]] {
        let mut mobility = vec![DVec3::ZERO; bodies.controls()];
        free.iter().for_each(|node| mobility[bodies.lattice.index(*node)] = DVec3::ONE);
        for method in [Method::Nearest, Method::Gradient, Method::xyz()] {
            for (name, energy) in energies(&bodies) {
                let (method, mobility) = (method.clone(), Some(mobility.clone()));
                let options = CorrectOptions { method, mobility, energy: Some(energy) };
                let corrected = correct(&pose, &Wanted::volume(target), &options).unwrap();
                assert!(corrected.relative_error <= 1e-13, "{name}");
            }
        }
    }
}
