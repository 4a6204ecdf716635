//! The loops that a correction is made of, on a stone of 437 645 vertices and 875 286 faces in a cubic lattice of 10 × 10 × 10
//! control points.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench kernels

mod stone;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Basis, Binding, OpenBoundaries, Solid, displaced, topology};
use stone::{Bound, bound, twist};

fn prepared(solid: &Solid, binding: &Binding) -> (Vec<u32>, Solid, Binding) {
    let order = binding.cell_order();
    let (solid, binding) = (solid.permuted(&order), binding.permuted(&order));
    (order, solid, binding)
}

fn kernels(criterion: &mut Criterion) {
    let Bound { mesh, lattice, binding: in_file_order, solid: solid_in_file_order } =
        bound(437_645, &Basis::uniform(10, 3).unwrap());
    let topology = topology(&mesh);
    let (order, solid, binding) = prepared(&solid_in_file_order, &in_file_order);

    let rest: Vec<DVec3> = order.iter().map(|v| mesh.points()[*v as usize]).collect();
    let displacement = twist(&lattice.rest(), 0.6);
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
