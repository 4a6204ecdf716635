//! The loops that a correction is made of, on a closed blob of 436 812 vertices and 873 620 faces in a cubic lattice of 10 × 10 × 10
//! control points.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench kernels

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Basis, Binding, Faces, Frame, Lattice, Mesh, OpenBoundaries, Outside, Solid, displaced, topology};

/// Vertices along an edge of the icosahedron whose faces are split: 10 f² + 2 vertices in all.
const FREQUENCY: usize = 209;

/// Corners and faces of the icosahedron.
fn icosahedron() -> ([DVec3; 12], [[usize; 3]; 20]) {
    let t = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, t, 0.0],
        [1.0, t, 0.0],
        [-1.0, -t, 0.0],
        [1.0, -t, 0.0],
        [0.0, -1.0, t],
        [0.0, 1.0, t],
        [0.0, -1.0, -t],
        [0.0, 1.0, -t],
        [t, 0.0, -1.0],
        [t, 0.0, 1.0],
        [-t, 0.0, -1.0],
        [-t, 0.0, 1.0],
    ];
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    (corners.map(DVec3::from_array), faces)
}

/// A geodesic sphere with bumps, inside the unit cube. Vertices in ascending order of their places on the sphere.
fn blob() -> Mesh {
    let f = FREQUENCY;
    let (corners, icosahedron) = icosahedron();
    let key = |p: DVec3| p.to_array().map(|x| (x * 1e7).round() as i64);
    let mut sphere: Vec<([i64; 3], DVec3)> = Vec::new();
    let mut corner_keys: Vec<[[i64; 3]; 3]> = Vec::new();
    for [a, b, c] in icosahedron.map(|face| face.map(|v| corners[v])) {
        let at = |i: usize, j: usize| (a * (f - i - j) as f64 + b * i as f64 + c * j as f64).normalize();
        for i in 0..=f {
            sphere.extend((0..=f - i).map(|j| (key(at(i, j)), at(i, j))));
        }
        for i in 0..f {
            for j in 0..f - i {
                corner_keys.push([at(i, j), at(i + 1, j), at(i, j + 1)].map(key));
                if i + j + 1 < f {
                    corner_keys.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)].map(key));
                }
            }
        }
    }
    sphere.sort_by_key(|(key, _)| *key);
    sphere.dedup_by_key(|(key, _)| *key);
    let index = |key: [i64; 3]| sphere.partition_point(|(k, _)| *k < key) as u32;
    let faces: Faces = corner_keys.iter().map(|corners| corners.map(index)).collect::<Vec<_>>().iter().collect();
    let radius = |n: DVec3| 1.0 + 0.25 * (3.0 * n.x).sin() * (2.0 * n.y).cos() + 0.15 * (4.0 * n.z + 1.0).sin();
    let points: Vec<DVec3> = sphere.iter().map(|(_, n)| *n * radius(*n)).collect();
    let bounds = isochor::Bounds::of(&points).unwrap();
    let scale = 0.96 / bounds.extent();
    let points: Vec<DVec3> = points.iter().map(|p| (*p - bounds.center()) * scale + 0.5).collect();
    assert_eq!((points.len(), faces.len()), (10 * f * f + 2, 20 * f * f));
    Mesh::new(points, faces).unwrap()
}

/// How far each control point of a lattice goes in a twist of half a radian.
fn twist(rest: &[DVec3]) -> Vec<DVec3> {
    let moved = |c: &DVec3| {
        let from_middle = *c - 0.5;
        let (sin, cos) = (0.9 * from_middle.z).sin_cos();
        DVec3::new(
            cos * from_middle.x - sin * from_middle.y,
            sin * from_middle.x + cos * from_middle.y,
            0.6 * from_middle.z,
        ) - from_middle
    };
    rest.iter().map(moved).collect()
}

fn prepared(solid: &Solid, binding: &Binding) -> (Vec<u32>, Solid, Binding) {
    let order = binding.cell_order();
    let (solid, binding) = (solid.permuted(&order), binding.permuted(&order));
    (order, solid, binding)
}

fn kernels(criterion: &mut Criterion) {
    let mesh = blob();
    let frame = Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
    let lattice = Lattice::new([0; 3].map(|_| Basis::uniform(10, 3).unwrap()), frame).unwrap();
    let in_file_order = lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let topology = topology(&mesh);
    let solid_in_file_order = Solid::new(&mesh, &topology, OpenBoundaries::Refuse).unwrap();
    let (order, solid, binding) = prepared(&solid_in_file_order, &in_file_order);

    let rest: Vec<DVec3> = order.iter().map(|v| mesh.points()[*v as usize]).collect();
    let displacement = twist(&lattice.rest());
    let q = binding.apply(&displacement);
    let posed = displaced(&rest, &q);
    let heights: Vec<f64> = displacement.iter().map(|d| d.z).collect();
    let gradient = solid.volume_gradient(&posed);
    let along: Vec<f64> = gradient.iter().map(|g| g.x).collect();

    let mut group = criterion.benchmark_group("kernels");
    group.sample_size(20);
    group.bench_function("solid", |b| b.iter(|| Solid::new(&mesh, &topology, OpenBoundaries::Refuse)));
    group.bench_function("prepare", |b| b.iter(|| prepared(black_box(&solid_in_file_order), &in_file_order)));
    group.bench_function("apply in file order", |b| b.iter(|| in_file_order.apply(black_box(&displacement))));
    group.bench_function("adjoint in file order", |b| b.iter(|| in_file_order.adjoint(black_box(&gradient))));
    group.bench_function("gradient in file order", |b| {
        b.iter(|| solid_in_file_order.volume_gradient(black_box(mesh.points())))
    });
    group.bench_function("volumes in file order", |b| b.iter(|| solid_in_file_order.volumes(black_box(mesh.points()))));
    group.bench_function("apply", |b| b.iter(|| binding.apply(black_box(&displacement))));
    group.bench_function("apply scalar", |b| b.iter(|| binding.apply_scalar(black_box(&heights))));
    group.bench_function("displaced", |b| b.iter(|| displaced(black_box(&rest), black_box(&q))));
    group.bench_function("adjoint", |b| b.iter(|| binding.adjoint(black_box(&gradient))));
    group.bench_function("adjoint scalar", |b| b.iter(|| binding.adjoint_scalar(black_box(&along))));
    group.bench_function("volumes", |b| b.iter(|| solid.volumes(black_box(&posed))));
    group.bench_function("gradient", |b| b.iter(|| solid.volume_gradient(black_box(&posed))));
    group.bench_function("gradient change", |b| {
        b.iter(|| solid.volume_gradient_change(black_box(&posed), black_box(&q)))
    });
    group.finish();
}

criterion_group!(benches, kernels);
criterion_main!(benches);
