//! How does time grow with vertices? 2562 to a million of them, in a lattice of 10 × 10 × 10 cubic B-splines.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench sizes

mod stages;
mod stone;

use criterion::{Criterion, criterion_group, criterion_main};
use isochor::Basis;

/// The smallest and largest are those of HB's table 2, but for the last.
const VERTICES: [usize; 5] = [2562, 19_851, 137_062, 437_645, 1_000_000];

fn sizes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sizes");
    stages::hasten(&mut group);
    let pool = stages::pool(0);
    for vertices in VERTICES {
        let bound = stone::bound(vertices, &Basis::uniform(10, 3).unwrap());
        stages::time(&mut group, &format!("{vertices} vertices"), &bound, &pool);
    }
    group.finish();
}

criterion_group!(benches, sizes);
criterion_main!(benches);
