//! Whole corrections of a stone of 437 645 vertices and 875 286 faces, twisted and squashed in a cubic lattice of 10 × 10 × 10
//! control points: back to the rest volume from which 40 % (and 60 %) was lost, and the product with the transposed Jacobian.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench correct

mod stone;

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Basis, CorrectOptions, Corrector, Effect, Method, Pose, Wanted, correct, displaced};
use stone::{Bound, bound, twist};

fn corrections(criterion: &mut Criterion) {
    let Bound { mesh, lattice, binding, solid } = bound(437_645, &Basis::uniform(10, 3).unwrap());
    let wanted = Wanted::volume(solid.volume(mesh.points()));

    let mut group = criterion.benchmark_group("correct");
    group.sample_size(10);
    for (lost, squash) in [("lost 40 %", 0.6), ("lost 60 %", 0.4)] {
        let displacement = twist(&lattice.rest(), squash);
        let posed = displaced(mesh.points(), &binding.apply(&displacement));
        let effect = Effect { controls: displacement, vertices: vec![DVec3::ONE; posed.len()] };
        for (name, method) in [("gradient", Method::Gradient), ("axes", Method::xyz()), ("nearest", Method::Nearest)] {
            let options = CorrectOptions { method, ..CorrectOptions::default() };
            let corrector = Corrector::new(&solid, &binding, &options).unwrap();
            let id = |what: &str| BenchmarkId::new(format!("{name}, {what}"), lost);
            group.bench_function(id("prepared"), |b| b.iter(|| corrector.correct(black_box(&posed), &wanted)));
            let sensitivity = corrector.sensitivity(&posed, &wanted).unwrap();
            group.bench_function(id("transposed product"), |b| b.iter(|| sensitivity.transposed(black_box(&effect))));
            let pose = Pose { solid: &solid, vertices: &posed, binding: &binding };
            group.bench_function(id("one-off"), |b| b.iter(|| correct(black_box(&pose), &wanted, &options)));
        }
    }
    let options = CorrectOptions::default();
    group.bench_function("prepare", |b| b.iter(|| Corrector::new(black_box(&solid), &binding, &options)));
    group.finish();
}

criterion_group!(benches, corrections);
criterion_main!(benches);
