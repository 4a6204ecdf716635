//! How long it takes until nodes have settled: HML's compressed torus of 65,536 triangles, and one of a million.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{BVec3, DVec3};
use isochor::{
    Augmented, Basis, Binding, Components, Elastic, ElasticModel, ElasticOptions, ElasticSolver, ElasticWanted,
    Evaluation, Frame, Lattice, Net, OpenBoundaries, Outside, Solid, Springs, Stiffness, VolumeForm, VolumeGoal,
    shapes, topology,
};

/// The torus in its lattice.
struct Torus {
    solid: Solid,
    points: Vec<DVec3>,
    binding: Binding,
    rest: Vec<DVec3>,
    springs: Springs,
}

impl Torus {
    /// Of 4 nv² triangles.
    fn new(nv: usize) -> Self {
        let mesh = shapes::uv_torus(1.0, 0.4, 2 * nv, nv);
        let axes = [DVec3::X * 2.8, DVec3::Y * 2.8, DVec3::Z * 0.8];
        let frame = Frame { origin: DVec3::new(-1.4, -1.4, -0.4), axes };
        let lattice = Lattice::new([0; 3].map(|_| Basis::bernstein(3).unwrap()), frame).unwrap();
        Self {
            solid: Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap(),
            binding: lattice.bind(mesh.points(), Outside::Refuse).unwrap(),
            points: mesh.points().to_vec(),
            rest: lattice.rest(),
            springs: Springs::of(&lattice, Net::TwentySix, Stiffness::default()).unwrap(),
        }
    }

    fn model(&self) -> ElasticModel<'_> {
        ElasticModel {
            solid: &self.solid,
            binding: &self.binding,
            points: &self.points,
            rest: &self.rest,
            springs: &self.springs,
        }
    }

    fn wanted(&self) -> ElasticWanted {
        let volume = self.solid.volume(&self.points);
        ElasticWanted { volumes: vec![VolumeGoal { components: Components::All, volume }], ..ElasticWanted::default() }
    }

    /// The upper and lower layers moved to the centre by 40 %.
    fn squashed(&self) -> Vec<DVec3> {
        self.rest.iter().map(|c| DVec3::new(c.x, c.y, 0.6 * c.z)).collect()
    }
}

/// Those of the middle layer.
fn is_free() -> Vec<BVec3> {
    (0..27).map(|node| BVec3::splat(node % 3 == 1)).collect()
}

fn benches(c: &mut Criterion) {
    let torus = Torus::new(128);
    let (start, wanted) = (torus.squashed(), torus.wanted());
    let mut group = c.benchmark_group("elastic");
    group.sample_size(20);
    for (name, evaluation) in [("auto", Evaluation::Auto), ("mesh", Evaluation::Mesh)] {
        let options = ElasticOptions { is_free: Some(is_free()), evaluation, ..ElasticOptions::default() };
        group.bench_function(format!("torus 65536/newton {name}"), |b| {
            b.iter(|| {
                let settled = isochor::relaxed(&torus.model(), &start, &wanted, &options).unwrap();
                black_box(settled)
            });
        });
    }
    let augmented = ElasticSolver::AugmentedLagrangian(Augmented::default());
    let options = ElasticOptions { is_free: Some(is_free()), solver: augmented, ..ElasticOptions::default() };
    group.bench_function("torus 65536/augmented, one level", |b| {
        b.iter(|| {
            let mut elastic = Elastic::new(&torus.model(), &start, &wanted, &options).unwrap();
            black_box(elastic.run(None, &mut |_| true).unwrap())
        });
    });
    let coarse: Vec<Torus> = [4, 8, 16, 32, 64].into_iter().map(Torus::new).collect();
    let models: Vec<ElasticModel> = coarse.iter().map(Torus::model).collect();
    group.bench_function("torus 65536/augmented, six levels", |b| {
        b.iter(|| {
            let elastic = Elastic::new(&torus.model(), &start, &wanted, &options).unwrap();
            let mut elastic = elastic.with_levels(&models).unwrap();
            black_box(elastic.run(None, &mut |_| true).unwrap())
        });
    });

    let large = Torus::new(500);
    group.sample_size(10);
    group.bench_function("torus 1000000/form", |b| {
        b.iter(|| black_box(VolumeForm::new(&large.solid, &large.points, &large.binding, &large.rest)));
    });
    let options = ElasticOptions { is_free: Some(is_free()), ..ElasticOptions::default() };
    let mut elastic = Elastic::new(&large.model(), &large.squashed(), &large.wanted(), &options).unwrap();
    elastic.run(None, &mut |_| true).unwrap();
    let mut is_moved = false;
    group.sample_size(100);
    group.bench_function("torus 1000000/warm after a move by 1 %", |b| {
        b.iter(|| {
            is_moved = !is_moved;
            let z = 0.24 - if is_moved { 0.028 } else { 0.0 };
            let handles: Vec<(usize, DVec3)> =
                (2..27).step_by(3).map(|node| (node, DVec3 { z, ..large.rest[node] })).collect();
            elastic.move_nodes(&handles).unwrap();
            black_box(elastic.run(None, &mut |_| true).unwrap())
        });
    });
    group.finish();
}

criterion_group!(elastic, benches);
criterion_main!(elastic);
