//! Cages: coordinates of 36,000 points inside a stone of 92 vertices and 180 triangles.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench cage

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Cage, green_coordinates, shapes};

fn cages(criterion: &mut Criterion) {
    let cage = Cage::new(shapes::stone(92)).unwrap();
    // At all depths, the first in the middle.
    let points: Vec<DVec3> =
        shapes::stone(36_000).points().iter().enumerate().map(|(i, p)| *p * (0.9 * i as f64 / 36_000.0)).collect();
    assert!(points.iter().step_by(100).all(|p| cage.contains(*p)));

    let mut group = criterion.benchmark_group("cage");
    group.sample_size(20);
    group.bench_function("green", |b| b.iter(|| green_coordinates(&cage, black_box(&points))));
    group.finish();
}

criterion_group!(benches, cages);
criterion_main!(benches);
