//! Cages: coordinates of 36,000 points inside a stone of 92 vertices and 180 triangles; products with the weights of larger models, beside a
//! sweep over the same memory; all volume gradients of a cage.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench cage

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Cage, CageOptions, OpenBoundaries, Solid, green_coordinates, shapes, topology};
use rayon::prelude::*;

/// Vertices of the models whose weights are swept over: about those of HB's and CVB's largest.
const LARGE: [usize; 2] = [437_000, 900_000];

fn cages(criterion: &mut Criterion) {
    let cage = Cage::new(shapes::stone(92)).unwrap();
    // At all depths, the first in the middle.
    let points: Vec<DVec3> =
        shapes::stone(36_000).points().iter().enumerate().map(|(i, p)| *p * (0.9 * i as f64 / 36_000.0)).collect();
    assert!(points.iter().step_by(100).all(|p| cage.contains(*p)));

    let mut group = criterion.benchmark_group("cage");
    group.sample_size(20);
    // With the precision and the winding numbers of all points.
    group.bench_function("mean value", |b| b.iter(|| cage.bind(black_box(&points), &CageOptions::default()).unwrap()));
    group.bench_function("green", |b| b.iter(|| green_coordinates(&cage, black_box(&points))));
    for vertices in LARGE {
        let mesh = shapes::stone(vertices);
        let mesh = mesh.with_points(mesh.points().iter().map(|p| *p * 0.9).collect()).unwrap();
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let bound = cage.bind(mesh.points(), &CageOptions::default()).unwrap();
        let posed: Vec<DVec3> = cage.vertices().iter().map(|c| *c * DVec3::new(1.2, 0.8, 1.0)).collect();
        let deformed = bound.deformed(mesh.points(), &posed);
        let weights = bound.weights();
        let sum = |part: &[f64]| part.chunks(8).map(|x| x.iter().sum::<f64>()).sum::<f64>();
        group.bench_function(format!("sweep {vertices}"), |b| {
            b.iter(|| black_box(&weights).par_chunks(1 << 16).map(sum).sum::<f64>());
        });
        drop(weights);
        let displacement = bound.displacement(&posed);
        group.bench_function(format!("apply {vertices}"), |b| {
            b.iter(|| bound.binding().apply(black_box(&displacement)))
        });
        group.bench_function(format!("gradients {vertices}"), |b| {
            b.iter(|| bound.gradient(&posed, &solid.volume_gradient(black_box(&deformed))));
        });
    }
    group.finish();
}

criterion_group!(benches, cages);
criterion_main!(benches);
