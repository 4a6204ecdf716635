//! Against numbers from independent programs: `tests/reference/` says which in each file's `about`.

mod numbers;

use glam::DVec3;
use isochor::{
    Basis, Bounds, CorrectOptions, Faces, Frame, Lattice, Mesh, Method, OpenBoundaries, Outside, PointTarget, Pose,
    Solid, Wanted, correct, topology,
};
use numbers::{number, numbers, reference, vectors};
use serde_json::Value;

fn indices<const K: usize>(v: &Value) -> Vec<[u32; K]> {
    let row = |f: &Value| numbers(f).iter().map(|x| *x as u32).collect::<Vec<_>>().try_into().unwrap();
    v.as_array().unwrap().iter().map(row).collect()
}

fn size(v: &Value) -> [usize; 3] {
    indices::<3>(&Value::Array(vec![v.clone()]))[0].map(|i| i as usize)
}

fn unit_lattice(bases: [Basis; 3]) -> Lattice {
    Lattice::new(bases, Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] }).unwrap()
}

fn assert_close(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    let scale = Bounds::of(expected).unwrap().extent();
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= tolerance * scale, "{i}: {a} instead of {b}");
    }
}

#[test]
fn clamped_and_uniform_b_spline_volumes_agree_with_scipy() {
    let file = reference("bspline_reference.json");
    let params = vectors(&file["params"]);
    let mut cases: Vec<(&Value, [Basis; 3])> = Vec::new();
    for case in file["clamped"].as_array().unwrap() {
        let degree = number(&case["degree"]) as usize;
        let bases = size(&case["dims"]).map(|n| Basis::clamped(n, degree).unwrap());
        for (basis, knots) in bases.iter().zip(case["knots"].as_array().unwrap()) {
            let explicit = Basis::with_knots(numbers(knots), degree).unwrap();
            assert_eq!(basis.size(), explicit.size());
            for (a, b) in basis.knots().iter().zip(explicit.knots()) {
                assert!((a - b).abs() <= 1e-15);
            }
        }
        cases.push((case, bases));
    }
    let uniform = &file["uniform"];
    cases.push((uniform, size(&uniform["dims"]).map(|n| Basis::uniform(n, 3).unwrap())));
    let explicit = Basis::with_knots(numbers(&uniform["knots"]), 3).unwrap();
    cases.push((uniform, [explicit.clone(), explicit.clone(), explicit]));
    for (case, bases) in cases {
        let binding = unit_lattice(bases).bind(&params, Outside::Refuse).unwrap();
        assert_close(&binding.apply(&vectors(&case["control_points"])), &vectors(&case["values"]), 1e-14);
    }
}

#[test]
fn bernstein_volumes_agree_with_the_closed_form() {
    let file = reference("bernstein_reference.json");
    let params = vectors(&file["params"]);
    for case in file["cases"].as_array().unwrap() {
        let lattice = unit_lattice(size(&case["dims"]).map(|n| Basis::bernstein(n).unwrap()));
        let binding = lattice.bind(&params, Outside::Refuse).unwrap();
        assert_close(&binding.apply(&vectors(&case["control_points"])), &vectors(&case["values"]), 1e-14);
    }
}

#[test]
fn hahmanns_correction_agrees_with_an_independent_solver() {
    let file = reference("hahmann_cases.json");
    let faces: Faces = indices::<3>(&file["faces"]).iter().collect();
    let mesh = Mesh::new(vectors(&file["vertices"]), faces).unwrap();
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    let n = number(&file["n"]) as usize;
    let lattice = unit_lattice([0; 3].map(|_| Basis::uniform(n, 3).unwrap()));
    let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
    let rest = lattice.rest();
    let mut checked = 0;
    for case in file["cases"].as_array().unwrap() {
        let posed = vectors(&case["lattice_deformed"]);
        let displacement: Vec<DVec3> = posed.iter().zip(&rest).map(|(p, r)| *p - *r).collect();
        let vertices: Vec<DVec3> =
            mesh.points().iter().zip(binding.apply(&displacement)).map(|(p, d)| *p + d).collect();
        assert_close(&vertices, &vectors(&case["vertices_before"]), 1e-14);

        // α, β, γ before the first step: the three columns of Wᵀ g
        let gradient = binding.adjoint(&solid.volume_gradient(&vertices));
        for (axis, name) in ["alpha_before", "beta_before", "gamma_before"].into_iter().enumerate() {
            for (found, expected) in gradient.iter().zip(numbers(&case[name])) {
                assert!((found[axis] - expected).abs() <= 1e-15, "{name}");
            }
        }

        let mobility = case["weights"].as_array().map(|w| w.iter().map(|w| DVec3::splat(1.0 / number(w))).collect());
        let directions = numbers(&case["axes"]).iter().map(|a| DVec3::AXES[*a as usize]).collect();
        let method = Method::Axes { directions, shares: Some(numbers(&case["shares"])) };
        let pose = Pose { solid: &solid, vertices: &vertices, binding: &binding };
        let point = case["point_vertex"].as_u64().map(|v| PointTarget {
            weights: binding.weights(v as usize),
            position: vertices[v as usize],
            target: DVec3::from_slice(&numbers(&case["point_target"])),
        });
        let points = point.into_iter().collect();
        let target = number(&case["V_ref"]);
        let wanted = Wanted { points, ..Wanted::volume(target) };
        let corrected = correct(&pose, &wanted, &CorrectOptions { method, mobility, energy: None }).unwrap();
        assert!((corrected.volume_before - number(&case["V_before"])).abs() <= 1e-15);
        assert!(corrected.relative_error <= 1e-15, "{}", corrected.relative_error);
        let lattice_corrected: Vec<DVec3> = posed.iter().zip(&corrected.displacement).map(|(p, d)| *p + *d).collect();
        assert_close(&lattice_corrected, &vectors(&case["lattice_corrected"]), 1e-12);
        assert_close(&corrected.vertices, &vectors(&case["vertices_corrected"]), 1e-12);
        checked += 1;
    }
    assert_eq!(checked, 3);
}
