//! What do size, degree and kind of a lattice cost? 6³, 10³ and 20³ control points of degree 1 to 3, and Bernstein polynomials of 4³ to
//! 8³, with 100 000 vertices.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench lattices

mod stages;
mod stone;

use criterion::{Criterion, criterion_group, criterion_main};
use isochor::Basis;

/// More than fit into a processor's cache.
const VERTICES: usize = 100_000;

fn lattices(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("lattices");
    stages::hasten(&mut group);
    let pool = stages::pool(0);
    for size in [6, 10, 20] {
        for degree in 1..=3 {
            let bound = stone::bound(VERTICES, &Basis::uniform(size, degree).unwrap());
            stages::time(&mut group, &format!("{size}³ of degree {degree}"), &bound, &pool);
        }
    }
    for size in 4..=8 {
        let bound = stone::bound(VERTICES, &Basis::bernstein(size).unwrap());
        stages::time(&mut group, &format!("{size}³ Bernstein"), &bound, &pool);
    }
    group.finish();
}

criterion_group!(benches, lattices);
criterion_main!(benches);
