//! The same bits for any number of threads.

use glam::DVec3;
use isochor::shapes::{icosphere, uv_torus};
use isochor::{
    Basis, CorrectOptions, Frame, Lattice, LocalityOptions, Mesh, Method, OpenBoundaries, Outside, Pose, Solid, Wanted,
    correct, displaced, local_mobility, topology,
};

/// All that is computed in parallel, for one mesh: as bits.
fn everything(mesh: &Mesh) -> Vec<(&'static str, Vec<u64>)> {
    let vectors = |v: &[DVec3]| v.iter().flat_map(|v| v.to_array()).map(f64::to_bits).collect::<Vec<_>>();
    let numbers = |v: &[f64]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();

    let frame = Frame::fitted(mesh.bounds().unwrap(), -0.05).unwrap(); // some vertices are outside
    let bases = [Basis::clamped(5, 3), Basis::uniform(6, 2), Basis::bernstein(4)].map(Result::unwrap);
    let lattice = Lattice::new(bases, frame).unwrap();
    let binding = lattice.bind(mesh.points(), Outside::Extend).unwrap();
    let kept = lattice.bind(mesh.points(), Outside::Keep).unwrap();
    assert!(kept.kept_count() > 0 && kept.kept_count() < kept.vertex_count());
    let wave = |c: usize| DVec3::new((c as f64).sin(), (2.0 * c as f64).cos(), (3.0 * c as f64 + 1.0).sin()) * 0.1;
    let displacement: Vec<DVec3> = (0..binding.control_count()).map(wave).collect();
    let posed = displaced(mesh.points(), &binding.apply(&displacement));

    let topology = topology(mesh);
    let solid = Solid::new(mesh, &topology, OpenBoundaries::Cap).unwrap();
    let gradient = solid.volume_gradient(&posed);
    let scalars: Vec<f64> = gradient.iter().map(|g| g.x).collect();
    let volumes = solid.volumes(&posed);
    let jacobians = lattice.jacobians(mesh.points(), &displacement, Outside::Keep);
    let mut all = vec![
        (
            "rows of W",
            (0..binding.vertex_count()).step_by(97).flat_map(|v| binding.weights(v)).map(|w| w.1.to_bits()).collect(),
        ),
        ("apply", vectors(&binding.apply(&displacement))),
        ("apply, some kept", vectors(&kept.apply(&displacement))),
        ("adjoint", vectors(&binding.adjoint(&gradient))),
        ("adjoint of numbers", numbers(&binding.adjoint_scalar(&scalars))),
        ("volumes", numbers(&[&[volumes.total][..], &volumes.components].concat())),
        ("area", numbers(&[solid.area(&posed)])),
        ("gradient", vectors(&gradient)),
        ("jacobians", jacobians.iter().flat_map(|j| j.to_cols_array()).map(f64::to_bits).collect()),
        ("local mobility", {
            let options = LocalityOptions { vertices: mesh.points(), ..LocalityOptions::default() };
            numbers(&local_mobility(&lattice, &displacement, &options))
        }),
    ];
    // Cubic rows and long runs: the fast path.
    let cubic = Lattice::new([0; 3].map(|_| Basis::uniform(7, 3).unwrap()), frame).unwrap();
    let cubic = cubic.bind(mesh.points(), Outside::Keep).unwrap();
    let c: Vec<DVec3> = (0..cubic.control_count()).map(wave).collect();
    let order = cubic.cell_order();
    let (ordered, ordered_solid) = (cubic.permuted(&order), solid.permuted(&order));
    let ordered_posed: Vec<DVec3> = order.iter().map(|v| posed[*v as usize]).collect();
    let weights: Vec<f64> = volumes.components.iter().map(|v| 1.0 + v).collect();
    let ordered_gradient = ordered_solid.weighted_gradient(&ordered_posed, &weights);
    let change = ordered_solid.volume_gradient_change(&ordered_posed, &ordered.apply(&c));
    all.extend([
        ("cubic apply", vectors(&cubic.apply(&c))),
        ("cubic adjoint", vectors(&cubic.adjoint(&gradient))),
        ("cubic adjoint of numbers", numbers(&cubic.adjoint_scalar(&scalars))),
        ("order of cells", order.iter().map(|v| u64::from(*v)).collect()),
        ("cubic apply in the order of cells", vectors(&ordered.apply(&c))),
        ("displaced in the order of cells", vectors(&ordered.displaced(&ordered_posed, &c))),
        ("cubic adjoint in the order of cells", vectors(&ordered.adjoint(&ordered_gradient))),
        ("volumes in the order of cells", numbers(&ordered_solid.volumes(&ordered_posed).components)),
        ("gradient in the order of cells", vectors(&ordered_gradient)),
        ("gradient change in the order of cells", vectors(&change)),
    ]);
    let pose = Pose { solid: &solid, vertices: &posed, binding: &binding };
    for (name, method) in
        [("gradient method", Method::Gradient), ("axes method", Method::xyz()), ("nearest method", Method::Nearest)]
    {
        let options = CorrectOptions { method, mobility: None, ..CorrectOptions::default() };
        let corrected = correct(&pose, &Wanted::volume(1.1 * volumes.total), &options).unwrap();
        let summary = [corrected.volume, corrected.volume_before, corrected.relative_error, corrected.steps as f64];
        all.push((name, [vectors(&corrected.displacement), vectors(&corrected.vertices), numbers(&summary)].concat()));
    }
    all
}

fn assert_same_bits_for_any_number_of_threads(mesh: &Mesh) {
    let inside = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| everything(mesh))
    };
    let alone = inside(1);
    for threads in [2, 7] {
        for ((name, expected), (_, found)) in alone.iter().zip(inside(threads)) {
            assert!(*expected == found, "{name} has other bits with {threads} threads");
        }
    }
}

#[test]
fn a_sphere_of_five_chunks_of_vertices_has_the_same_bits_with_1_2_and_7_threads() {
    let sphere = icosphere(6);
    assert_eq!(sphere.points().len(), 40962);
    assert_same_bits_for_any_number_of_threads(&sphere);
}

#[test]
fn a_torus_of_six_chunks_of_vertices_has_the_same_bits_with_1_2_and_7_threads() {
    assert_same_bits_for_any_number_of_threads(&uv_torus(1.0, 0.3, 300, 150));
}

#[test]
fn an_open_sphere_with_a_long_rim_has_the_same_bits_with_1_2_and_7_threads() {
    let sphere = icosphere(6);
    let is_low = |face: &&[u32]| face.iter().map(|v| sphere.points()[*v as usize].z).sum::<f64>() < 1.0;
    let open = Mesh::new(sphere.points().to_vec(), sphere.faces().iter().filter(is_low).collect()).unwrap();
    assert!(topology(&open).boundary_edges > 100);
    assert_same_bits_for_any_number_of_threads(&open);
}
