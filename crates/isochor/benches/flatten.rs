//! How long does it take to flatten a surface? A bicubic Bézier patch and a cylinder; 10 × 10 and 16 × 16 are the grids of CO's table 1.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench flatten

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, SamplingMode, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{Basis, FlattenOptions, Patch, Surface, flatten};

/// Of the control points over the unit square: a bump beside a hollow.
const HEIGHTS: [[f64; 4]; 4] =
    [[0.0, 0.1, 0.1, 0.0], [0.1, 0.4, 0.2, 0.0], [0.0, 0.3, -0.2, -0.1], [0.0, 0.0, 0.1, 0.1]];

fn patch() -> Surface {
    let bases = [0, 1].map(|_| Basis::clamped(4, 3).unwrap());
    let control = |k: usize| DVec3::new((k / 4) as f64 / 3.0, (k % 4) as f64 / 3.0, HEIGHTS[k / 4][k % 4]);
    Surface::from(Patch::new(bases, (0..16).map(control).collect(), None).unwrap())
}

fn surfaces(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("flatten");
    group.sample_size(20).sampling_mode(SamplingMode::Flat);
    group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(500));
    for (name, surface) in [("patch", patch()), ("cylinder", Surface::cylinder(1.0, 3.0))] {
        for n in [10, 16, 32, 100] {
            let options = FlattenOptions { cells: [n, n], ..FlattenOptions::default() };
            group.bench_function(BenchmarkId::new(name, n), |b| {
                b.iter(|| flatten(black_box(&surface), &options).unwrap())
            });
        }
    }
    group.finish();
}

criterion_group!(benches, surfaces);
criterion_main!(benches);
