//! What does a second thread bring? 437 645 vertices in a lattice of 10 × 10 × 10 cubic B-splines, with one thread and with two.
//!
//!     cargo bench -p isochor --bench threads

mod stages;
mod stone;

use criterion::{Criterion, criterion_group, criterion_main};
use isochor::Basis;

fn threads(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("threads");
    stages::hasten(&mut group);
    let bound = stone::bound(437_645, &Basis::uniform(10, 3).unwrap());
    for threads in [1, 2] {
        stages::time(&mut group, &format!("threads: {threads}"), &bound, &stages::pool(threads));
    }
    group.finish();
}

criterion_group!(benches, threads);
criterion_main!(benches);
