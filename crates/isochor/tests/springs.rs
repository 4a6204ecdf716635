//! Springs between control points: against ranks and optima of independent programs, and against differences.

mod numbers;

use faer::{Mat, Side};
use glam::{DQuat, DVec3};
use isochor::{
    Basis, Frame, Lattice, Net, OpenBoundaries, Outside, Solid, Springs, SpringsError, Stiffness, shapes, topology,
};
use numbers::{number, numbers, reference, vectors};
use proptest::prelude::*;

/// Of Bernstein polynomials in the box from `low` of `size`.
fn lattice(nodes: [usize; 3], low: DVec3, size: DVec3) -> Lattice {
    let axes = [0, 1, 2].map(|axis| size[axis] * DVec3::AXES[axis]);
    Lattice::new(nodes.map(|n| Basis::bernstein(n).unwrap()), Frame { origin: low, axes }).unwrap()
}

/// Of cells of side 1.
fn cells(nodes: [usize; 3]) -> Lattice {
    lattice(nodes, DVec3::ZERO, DVec3::from_array(nodes.map(|n| (n - 1) as f64)))
}

fn net(name: &str) -> Option<Net> {
    match name {
        "n26" => Some(Net::TwentySix),
        "n14" => Some(Net::Fourteen),
        "n14kuhn" => Some(Net::FourteenKuhn),
        _ => None,
    }
}

/// ∂²E/∂C², x, y and z of a node after one another.
fn hessian(springs: &Springs, places: &[DVec3]) -> Mat<f64> {
    let mut matrix = Mat::<f64>::zeros(3 * places.len(), 3 * places.len());
    for (spring, block) in springs.hessian(places) {
        let [s, e] = spring.ends.map(|end| end as usize);
        for (row, column, sign) in [(s, s, 1.0), (e, e, 1.0), (s, e, -1.0), (e, s, -1.0)] {
            for c in 0..3 {
                for r in 0..3 {
                    matrix[(3 * row + r, 3 * column + c)] += sign * block.col(c)[r];
                }
            }
        }
    }
    matrix
}

#[test]
fn nets_are_as_rigid_as_the_rank_of_their_rigidity_matrix_says() {
    let mut seen = 0;
    for row in reference("spring_rigidity.json").as_array().unwrap() {
        let Some(net) = net(row["net"].as_str().unwrap()) else { continue };
        let nodes: Vec<usize> = numbers(&row["lattice"]).iter().map(|n| *n as usize).collect();
        let lattice = cells([nodes[0], nodes[1], nodes[2]]);
        let springs = Springs::of(&lattice, net, Stiffness::default()).unwrap();
        assert_eq!(springs.springs().len() as f64, number(&row["springs"]), "{row}");
        let mut degrees = vec![0.0; lattice.control_count()];
        springs.springs().iter().flat_map(|spring| spring.ends).for_each(|end| degrees[end as usize] += 1.0);
        assert_eq!(degrees.iter().fold(0.0, |most: f64, d| most.max(*d)), number(&row["max_degree"]), "{row}");
        // At rest the second derivative is RᵀR, R the rigidity matrix.
        let values = hessian(&springs, &lattice.rest()).self_adjoint_eigenvalues(Side::Lower).unwrap();
        let rank = values.iter().filter(|value| **value > 1e-9).count();
        assert_eq!(rank as f64, number(&row["rank"]), "{row}");
        assert_eq!(values.len() as f64 - 6.0 - rank as f64, number(&row["nullity_beyond_rigid"]), "{row}");
        seen += 1;
    }
    assert_eq!(seen, 12);
}

/// HML's compressed torus: energies at the start and at the optimum, where the forces of springs and pressure balance.
#[test]
fn at_the_papers_optima_springs_and_pressure_balance() {
    let file = reference("hirota_torus_reference.json");
    let rest = lattice([3; 3], DVec3::new(-1.4, -1.4, -0.4), DVec3::new(2.8, 2.8, 0.8));
    let start = vectors(&file["start_lattice"]);
    let mut seen = 0;
    for case in file["cases"].as_array().unwrap() {
        let springs = Springs::of(&rest, net(case["net"].as_str().unwrap()).unwrap(), Stiffness::default()).unwrap();
        assert_eq!(springs.springs().len() as f64, number(&case["n_springs"]));
        let (optimum, energy) = (vectors(&case["X_opt"]), number(&case["E_opt"]));
        assert!((springs.energy(&start) / number(&case["E_start"]) - 1.0).abs() < 1e-12);
        assert!((springs.energy(&optimum) / energy - 1.0).abs() < 1e-12);

        // 2 nv² quads in two each.
        let nv = (number(&case["N_tri"]) / 4.0).sqrt() as usize;
        let torus = shapes::uv_torus(1.0, 0.4, 2 * nv, nv);
        let solid = Solid::new(&torus, &topology(&torus), OpenBoundaries::Refuse).unwrap();
        let binding = rest.bind(torus.points(), Outside::Refuse).unwrap();
        let displaced: Vec<DVec3> = optimum.iter().zip(rest.rest()).map(|(c, at)| *c - at).collect();
        let moved: Vec<DVec3> = binding.apply(&displaced).iter().zip(torus.points()).map(|(by, p)| *p + *by).collect();
        assert!((solid.volume(&moved) / number(&case["V0"]) - 1.0).abs() < 1e-10, "{}", case["N_tri"]);
        let pressure = binding.adjoint(&solid.volume_gradient(&moved));
        let gradient = springs.gradient(&optimum);
        let lambda = number(&case["lambda_opt"]);
        for node in numbers(&case["free_nodes"]).iter().map(|node| *node as usize) {
            let force = gradient[node] - lambda * pressure[node];
            assert!(force.length() < 1e-9 * energy, "{force} at {node} for {} faces", case["N_tri"]);
        }
        seen += 1;
    }
    assert_eq!(seen, 18);
}

#[test]
fn a_spring_has_hookes_energy() {
    // A cell of 1 × 2 × 2, stretched to 4 along x: of its springs only those along x change by 3, those across by what Pythagoras says.
    let lattice = lattice([2; 3], DVec3::ZERO, DVec3::new(1.0, 2.0, 2.0));
    let stretched: Vec<DVec3> = lattice.rest().iter().map(|p| DVec3::new(4.0 * p.x, p.y, p.z)).collect();
    let energy =
        |net, edge, face, cell| Springs::of(&lattice, net, Stiffness { edge, face, cell }).unwrap().energy(&stretched);
    let by = |across: f64| (16.0 + across).sqrt() - (1.0 + across).sqrt();
    let [along, face, cell] = [0.5 * 4.0 * 9.0, 0.5 * 8.0 * by(4.0).powi(2), 0.5 * 4.0 * by(8.0).powi(2)];
    let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-14, "{a} {b}");
    close(energy(Net::TwentySix, 1.0, 1.0, 1.0), along + face + cell);
    close(energy(Net::TwentySix, 2.0, 0.0, 0.0), 2.0 * along);
    close(energy(Net::TwentySix, 0.0, 3.0, 0.0), 3.0 * face);
    close(energy(Net::Fourteen, 1.0, 7.0, 1.0), along + cell);
    // Of the four diagonals of cells Kuhn's net has one, of the twelve of faces one for each face, four of them along x.
    close(energy(Net::FourteenKuhn, 1.0, 1.0, 1.0), along + 0.5 * face + 0.25 * cell);
}

#[test]
fn ends_at_one_place_push_nowhere() {
    let lattice = cells([2; 3]);
    let springs = Springs::of(&lattice, Net::TwentySix, Stiffness::default()).unwrap();
    let nowhere = [DVec3::ONE; 8];
    assert_eq!(springs.gradient(&nowhere), [DVec3::ZERO; 8]);
    assert_eq!(springs.hessian(&nowhere).count(), 0);
    assert!((springs.energy(&nowhere) - 0.5 * (12.0 + 12.0 * 2.0 + 4.0 * 3.0)).abs() < 1e-14);
}

#[test]
fn stiffnesses_that_hold_nothing_are_refused() {
    let lattice = cells([2; 3]);
    let refused = |net, stiffness| Springs::of(&lattice, net, stiffness).unwrap_err();
    assert_eq!(refused(Net::TwentySix, Stiffness::uniform(-1.0)), SpringsError::Stiffness(-1.0));
    assert_eq!(
        refused(Net::TwentySix, Stiffness { face: f64::INFINITY, ..Stiffness::default() }),
        SpringsError::Stiffness(f64::INFINITY)
    );
    assert_eq!(refused(Net::TwentySix, Stiffness::uniform(0.0)), SpringsError::Slack);
    assert_eq!(refused(Net::Fourteen, Stiffness { edge: 0.0, face: 1.0, cell: 0.0 }), SpringsError::Slack);
}

fn places(count: usize) -> impl Strategy<Value = Vec<DVec3>> {
    prop::collection::vec(prop::array::uniform3(-0.3..0.3f64).prop_map(DVec3::from_array), count)
}

fn nets() -> impl Strategy<Value = Net> {
    prop::sample::select(vec![Net::TwentySix, Net::Fourteen, Net::FourteenKuhn])
}

proptest! {
    #[test]
    fn gradients_and_second_derivatives_are_those_of_the_energy(net in nets(), by in places(12), along in places(12)) {
        let lattice = cells([3, 2, 2]);
        let springs = Springs::of(&lattice, net, Stiffness { edge: 1.0, face: 0.5, cell: 2.0 }).unwrap();
        let at: Vec<DVec3> = lattice.rest().iter().zip(&by).map(|(p, by)| *p + *by).collect();
        let h = 1e-5;
        let off = |h: f64| -> Vec<DVec3> { at.iter().zip(&along).map(|(p, d)| *p + h * *d).collect() };
        let slope = (springs.energy(&off(h)) - springs.energy(&off(-h))) / (2.0 * h);
        let gradient = springs.gradient(&at);
        let expected: f64 = gradient.iter().zip(&along).map(|(g, d)| g.dot(*d)).sum();
        prop_assert!((slope - expected).abs() < 1e-7, "{slope} {expected}");
        let matrix = hessian(&springs, &at);
        let [high, low] = [h, -h].map(|h| springs.gradient(&off(h)));
        for node in 0..12 {
            let rate = (high[node] - low[node]) / (2.0 * h);
            for r in 0..3 {
                let expected: f64 = (0..36).map(|k| matrix[(3 * node + r, k)] * along[k / 3][k % 3]).sum();
                prop_assert!((rate[r] - expected).abs() < 1e-6, "{} {expected}", rate[r]);
            }
        }
    }

    #[test]
    fn rigid_motions_cost_nothing(net in nets(), by in places(18), turn in prop::array::uniform3(-3.0..3.0f64)) {
        let lattice = cells([3, 3, 2]);
        let springs = Springs::of(&lattice, net, Stiffness::default()).unwrap();
        let at: Vec<DVec3> = lattice.rest().iter().zip(&by).map(|(p, by)| *p + *by).collect();
        let turn = DQuat::from_scaled_axis(DVec3::from_array(turn));
        let moved = |places: &[DVec3]| -> Vec<DVec3> { places.iter().map(|p| turn * *p + DVec3::new(3.0, -1.0, 2.0)).collect() };
        prop_assert!(springs.energy(&moved(&lattice.rest())) < 1e-26);
        prop_assert!((springs.energy(&moved(&at)) - springs.energy(&at)).abs() < 1e-12 * (1.0 + springs.energy(&at)));
        // Forces and their moments cancel.
        let gradient = springs.gradient(&at);
        let force: DVec3 = gradient.iter().sum();
        let moment: DVec3 = gradient.iter().zip(&at).map(|(g, p)| p.cross(*g)).sum();
        prop_assert!(force.length() < 1e-12 && moment.length() < 1e-12);
    }
}
