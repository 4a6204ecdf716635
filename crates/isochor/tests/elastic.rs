//! Elastic deformation at constant volume: against optima of independent solvers, and against theorems.

mod numbers;

use std::time::Duration;

use glam::{BVec3, DVec3};
use isochor::{
    Augmented, Basis, Binding, Elastic, ElasticError, ElasticModel, ElasticOptions, ElasticSolver, ElasticState, ElasticStatus,
    ElasticWanted, Evaluation, Frame, Lattice, Mesh, MomentTargets, Net, OpenBoundaries, Outside, PointTarget, Settled, Solid,
    Springs, Stiffness, VolumeGoal, Components, shapes, topology,
};
use numbers::{number, numbers, reference, vectors};

/// A mesh in a lattice with springs.
struct Case {
    solid: Solid,
    binding: Binding,
    points: Vec<DVec3>,
    rest: Vec<DVec3>,
    springs: Springs,
}

impl Case {
    fn of(mesh: &Mesh, lattice: &Lattice, net: Net) -> Self {
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
        let springs = Springs::of(lattice, net, Stiffness::default()).unwrap();
        Self { solid, binding, points: mesh.points().to_vec(), rest: lattice.rest(), springs }
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

    fn volume(&self) -> f64 {
        self.solid.volume(&self.points)
    }

    fn wanted(&self, factor: f64) -> ElasticWanted {
        let goal = VolumeGoal { components: Components::All, volume: factor * self.volume() };
        ElasticWanted { volumes: vec![goal], ..ElasticWanted::default() }
    }

    fn run(&self, start: &[DVec3], wanted: &ElasticWanted, options: &ElasticOptions) -> Result<(ElasticState, Settled), ElasticError> {
        let mut elastic = Elastic::new(&self.model(), start, wanted, options)?;
        let state = elastic.run(None, &mut |_| true)?;
        Ok((state, elastic.settled()?))
    }
}

fn bernstein(nodes: [usize; 3], low: DVec3, size: DVec3) -> Lattice {
    let axes = [0, 1, 2].map(|axis| size[axis] * DVec3::AXES[axis]);
    Lattice::new(nodes.map(|n| Basis::bernstein(n).unwrap()), Frame { origin: low, axes }).unwrap()
}

fn all_but(nodes: usize, held: impl Fn(usize) -> bool) -> Option<Vec<BVec3>> {
    Some((0..nodes).map(|node| BVec3::splat(!held(node))).collect())
}

/// HML's torus in 3 × 3 × 3 nodes, 2 nv² quads in two each.
fn torus(triangles: usize, net: Net) -> Case {
    let nv = (triangles as f64 / 4.0).sqrt() as usize;
    let lattice = bernstein([3; 3], DVec3::new(-1.4, -1.4, -0.4), DVec3::new(2.8, 2.8, 0.8));
    Case::of(&shapes::uv_torus(1.0, 0.4, 2 * nv, nv), &lattice, net)
}

#[test]
fn the_papers_torus_settles_where_independent_solvers_say() {
    let file = reference("hirota_torus_reference.json");
    let start = vectors(&file["start_lattice"]);
    for case in file["cases"].as_array().unwrap() {
        let net = match case["net"].as_str().unwrap() {
            "n26" => Net::TwentySix,
            "n14" => Net::Fourteen,
            _ => Net::FourteenKuhn,
        };
        let torus = torus(number(&case["N_tri"]) as usize, net);
        let free: Vec<usize> = numbers(&case["free_nodes"]).iter().map(|node| *node as usize).collect();
        let is_free = all_but(27, |node| !free.contains(&node));
        for evaluation in [Evaluation::Auto, Evaluation::Mesh] {
            let options = ElasticOptions { is_free: is_free.clone(), evaluation, ..ElasticOptions::default() };
            let (state, settled) = torus.run(&start, &torus.wanted(1.0), &options).unwrap();
            assert_eq!(state.status, ElasticStatus::Settled);
            println!("{} {} {evaluation:?}: {} steps, {} evaluations, residual {:.1e}", case["net"], case["N_tri"], state.steps, state.evaluations, state.residual);
            assert!((state.energy / number(&case["E_opt"]) - 1.0).abs() < 1e-9, "{}", state.energy);
            assert!((state.pressures[0] / number(&case["lambda_opt"]) - 1.0).abs() < 1e-6, "{:?}", state.pressures);
            let optimum = vectors(&case["X_opt"]);
            let apart = settled.places.iter().zip(&optimum).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            assert!(apart < 1e-6, "{apart:e}");
            assert!(settled.correction.relative_error <= 1e-13);
        }
    }
}
