//! Models along surfaces: a stone of 36 834 vertices and 73 664 faces on a bicubic Bézier patch, flattened in 16 × 16 cells; its subdivision; and a
//! large flat box subdivided everywhere.
//!
//!     RAYON_NUM_THREADS=2 cargo bench -p isochor --bench wrap

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use isochor::{
    Basis, FlattenOptions, Height, HeightWord, OpenBoundaries, Patch, Placement, Sheet, SheetFit, Solid, Surface, Wrap,
    flatten, scaled_heights, shapes, subdivide, topology,
};

/// A patch like the paper's: a square of side 3 whose inner control points go up and down.
fn patch() -> Surface {
    let height = [[0.0, 0.5, -0.5, 0.0], [0.4, 1.2, -0.8, 0.2], [-0.3, 0.6, -1.0, 0.5], [0.0, -0.4, 0.6, 0.0]];
    let control = |k: usize| DVec3::new((k / 4) as f64, (k % 4) as f64, height[k / 4][k % 4]);
    let bases = [0; 2].map(|_| Basis::bernstein(4).unwrap());
    Surface::from(Patch::new(bases, (0..16).map(control).collect(), None).unwrap())
}

fn sheet() -> Sheet {
    flatten(&patch(), &FlattenOptions { cells: [16, 16], ..FlattenOptions::default() }).unwrap().sheet
}

fn wraps(criterion: &mut Criterion) {
    let sheet = sheet();
    let wrap = Wrap::new(&sheet).unwrap();
    let stone = shapes::stone(36_834);
    let placement = Placement {
        fit: SheetFit::Inside,
        scale: 0.6,
        height: Height::Word(HeightWord::Middle),
        ..Placement::default()
    };
    let placed = placement.placed(stone.bounds().unwrap(), &sheet).unwrap();
    let places: Vec<DVec3> = placed.points(stone.points()).iter().map(|q| DVec3::new(q.x, q.y, 0.1 * q.z)).collect();
    let solid = Solid::new(&stone, &topology(&stone), OpenBoundaries::Refuse).unwrap();
    let feet = wrap.feet(&places).unwrap();
    let wanted = solid.volume(&places);

    let mut group = criterion.benchmark_group("wrap");
    group.sample_size(20);
    group.bench_function("prepare", |b| b.iter(|| Wrap::new(black_box(&sheet))));
    group.bench_function("place", |b| b.iter(|| placed.points(black_box(stone.points()))));
    group.bench_function("points", |b| b.iter(|| wrap.points(black_box(&places))));
    group.bench_function("with Jacobians", |b| b.iter(|| wrap.laid(black_box(&places))));
    let heights = |b: &mut criterion::Bencher| {
        b.iter(|| scaled_heights(black_box(&solid), &feet.feet, &feet.offsets, wanted).unwrap());
    };
    group.bench_function("heights", heights);
    let stone = stone.with_points(places.clone()).unwrap();
    group.bench_function("subdivide the stone", |b| b.iter(|| subdivide(&sheet, black_box(&stone), 0.05)));
    let slab = shapes::plate(DVec3::new(10.0, 10.0, 1.0), [1, 1]);
    let placement = Placement { fit: SheetFit::Inside, scale: 0.8, ..Placement::default() };
    let placed = placement.placed(slab.bounds().unwrap(), &sheet).unwrap().points(slab.points());
    let slab = slab.with_points(placed).unwrap();
    group.bench_function("subdivide a plate", |b| b.iter(|| subdivide(&sheet, black_box(&slab), 0.05)));
    group.finish();
}

criterion_group!(benches, wraps);
criterion_main!(benches);
