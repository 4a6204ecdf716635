//! The stages of a correction, and corrections in all ways, of a pose that lost 40 % of its volume.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, SamplingMode};
use glam::DVec3;
use isochor::{CorrectOptions, Corrector, Method, Wanted};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::stone::{Bound, twist};

/// So many threads; with 0 as many as there are processors, or as RAYON_NUM_THREADS says.
pub fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Few and short samples, so that all stages of many models are done in minutes.
pub fn hasten(group: &mut BenchmarkGroup<WallTime>) {
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(500));
}

/// Times all stages of `bound` under the name `of`, in `pool`. Stages before corrections have the vertices in the order of lattice cells.
pub fn time(group: &mut BenchmarkGroup<WallTime>, of: &str, bound: &Bound, pool: &ThreadPool) {
    let Bound { mesh, lattice, binding, solid } = bound;
    let displacement = twist(&lattice.rest(), 0.6);
    let posed = binding.displaced(mesh.points(), &displacement);
    let order = binding.cell_order();
    let (ordered_binding, ordered_solid) = (binding.permuted(&order), solid.permuted(&order));
    let ordered: Vec<DVec3> = order.iter().map(|v| posed[*v as usize]).collect();
    let gradient = ordered_solid.volume_gradient(&ordered);

    group.bench_function(BenchmarkId::new("apply", of), |b| {
        b.iter(|| pool.install(|| ordered_binding.apply(black_box(&displacement))))
    });
    group.bench_function(BenchmarkId::new("adjoint", of), |b| {
        b.iter(|| pool.install(|| ordered_binding.adjoint(black_box(&gradient))))
    });
    group.bench_function(BenchmarkId::new("volumes", of), |b| {
        b.iter(|| pool.install(|| ordered_solid.volumes(black_box(&ordered))))
    });
    group.bench_function(BenchmarkId::new("volume gradient", of), |b| {
        b.iter(|| pool.install(|| ordered_solid.volume_gradient(black_box(&ordered))))
    });
    let wanted = Wanted::volume(solid.volume(mesh.points()));
    for (name, method) in [("axes", Method::xyz()), ("gradient", Method::Gradient), ("nearest", Method::Nearest)] {
        let options = CorrectOptions { method, ..CorrectOptions::default() };
        let corrector = Corrector::new(solid, binding, &options).unwrap();
        group.bench_function(BenchmarkId::new(format!("correct, {name}"), of), |b| {
            b.iter(|| pool.install(|| corrector.correct(black_box(&posed), &wanted).unwrap()))
        });
    }
}
