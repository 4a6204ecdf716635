//! Against PyGeM: its free-form deformation, and its VFFD, which keeps the volume.
//!
//! PyGeM (mathLab) is another program by other people; what it computed was recorded once in the folder of reference models.
//! It moves control point c of a Bernstein lattice by `R (lengths ∘ mu_c)`, with R = Rx Ry Rz, and leaves points outside the
//! box alone. VFFD then corrects along the axes of the box in turn, a third of the missing volume each, with as little
//! Σ mu² as possible over the entries of `mu` that its mask leaves free: mobilities 0 and 1.

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use isochor::{
    Basis, Bounds, CorrectOptions, Faces, Frame, Lattice, Mesh, Method, OpenBoundaries, Outside, Pose, Solid, Wanted,
    correct, displaced, topology,
};
use serde_json::Value;

fn shared(path: &str) -> PathBuf {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    PathBuf::from(folder).join(path)
}

fn text(path: &str) -> String {
    std::fs::read_to_string(shared(path)).unwrap()
}

fn cases(kind: &str) -> Vec<Value> {
    let file: Value = serde_json::from_str(&text("reference/pygem_cases.json")).unwrap();
    file["cases"].as_array().unwrap().iter().filter(|case| case["kind"] == kind).cloned().collect()
}

fn vector(value: &Value) -> DVec3 {
    let numbers: Vec<f64> = value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    DVec3::from_slice(&numbers)
}

fn vectors(value: &Value) -> Vec<DVec3> {
    value.as_array().unwrap().iter().map(vector).collect()
}

/// PyGeM's lattice: a Bernstein basis over a box that is turned about its corner.
struct PygemLattice {
    lattice: Lattice,
    /// mu: displacement of each control point along the edges of the box, in lengths of the edges.
    mu: Vec<DVec3>,
}

impl PygemLattice {
    fn new(size: [usize; 3], origin: DVec3, lengths: DVec3, degrees: DVec3, mu: Vec<DVec3>) -> Self {
        let [x, y, z] = degrees.to_array().map(f64::to_radians);
        let turn = DMat3::from_rotation_x(x) * DMat3::from_rotation_y(y) * DMat3::from_rotation_z(z);
        let axes = [0, 1, 2].map(|a| turn.col(a) * lengths[a]);
        let bases = size.map(|n| Basis::bernstein(n).unwrap());
        Self { lattice: Lattice::new(bases, Frame { origin, axes }).unwrap(), mu }
    }

    fn of_case(case: &Value) -> Self {
        let params = &case["params"];
        let [n, origin, lengths, degrees] =
            ["n_control_points", "box_origin", "box_length", "rot_angle_deg"].map(|key| vector(&params[key]));
        Self::new(n.to_array().map(|n| n as usize), origin, lengths, degrees, vectors(&case["mu_in"]))
    }

    fn displacement(&self) -> Vec<DVec3> {
        let [a, b, c] = self.lattice.frame().axes;
        self.mu.iter().map(|mu| a * mu.x + b * mu.y + c * mu.z).collect()
    }

    fn deformed(&self, points: &[DVec3]) -> Vec<DVec3> {
        let binding = self.lattice.bind(points, Outside::Keep).unwrap();
        displaced(points, &binding.apply(&self.displacement()))
    }
}

/// Fails where points are further apart than 1e-12 of the extent.
fn assert_close(found: &[DVec3], expected: &[DVec3], name: &Value) {
    assert_eq!(found.len(), expected.len());
    let extent = Bounds::of(expected).unwrap().extent();
    for (v, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= 1e-12 * extent, "{name}: {v} is {a} instead of {b}");
    }
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn deformation_agrees_with_pygem() {
    let cases = cases("FFD");
    assert_eq!(cases.len(), 2);
    for case in &cases {
        let points = vectors(&case["points"]);
        assert_close(&PygemLattice::of_case(case).deformed(&points), &vectors(&case["points_out"]), &case["name"]);
    }
    let turned = &cases[1];
    let stay = vectors(&turned["points"]).iter().zip(vectors(&turned["points_out"])).filter(|(a, b)| *a == b).count();
    assert!(stay > 0, "the turned box leaves points outside");
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn correction_along_the_axes_agrees_with_pygem() {
    let cases = cases("VFFD");
    assert_eq!(cases.len(), 4);
    for case in &cases {
        let name = &case["name"];
        let pygem = PygemLattice::of_case(case);
        let faces: Faces = vectors(&case["triangles"])
            .iter()
            .map(|t| t.to_array().map(|v| v as u32))
            .collect::<Vec<_>>()
            .iter()
            .collect();
        let mesh = Mesh::new(vectors(&case["points"]), faces).unwrap();
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let binding = pygem.lattice.bind(mesh.points(), Outside::Refuse).unwrap();

        let vertices = pygem.deformed(mesh.points());
        assert_close(&vertices, &vectors(&case["points_before"]), name);
        let sixfold = |key: &str| case[key].as_f64().unwrap() / 6.0;
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
        assert!(close(solid.volume(mesh.points()), sixfold("six_volume_rest")), "{name}");
        assert!(close(solid.volume(&vertices), sixfold("six_volume_before")), "{name}");

        let mask = case["mask"].as_array().unwrap().iter();
        let free = |row: &Value, a: usize| if row[a].as_bool().unwrap() { 1.0 } else { 0.0 };
        let mobility = mask.map(|row| DVec3::new(free(row, 0), free(row, 1), free(row, 2))).collect();
        let options = CorrectOptions { method: Method::xyz(), mobility: Some(mobility), ..CorrectOptions::default() };
        let pose = Pose { solid: &solid, vertices: &vertices, binding: &binding };
        let corrected = correct(&pose, &Wanted::volume(sixfold("six_volume_target")), &options).unwrap();
        assert!(corrected.relative_error <= 1e-15, "{name}: {}", corrected.relative_error);
        assert_close(&corrected.vertices, &vectors(&case["points_out"]), name);
        let lengths = vector(&case["params"]["box_length"]);
        let mu: Vec<DVec3> = pygem.mu.iter().zip(&corrected.displacement).map(|(mu, d)| *mu + *d / lengths).collect();
        assert_close(&mu, &vectors(&case["mu_out"]), name);
    }
}

/// A `.prm` file as PyGeM writes it: settings `name: number`, and tables of `i j k weight` that go on over several lines.
fn pygem_parameters(text: &str) -> PygemLattice {
    let mut rows: Vec<(String, Vec<f64>)> = Vec::new();
    for line in text.lines().filter(|line| !line.starts_with(['#', '['])) {
        let values = match line.split_once(':') {
            Some((name, values)) => {
                rows.push((name.trim().into(), Vec::new()));
                values
            }
            None => line,
        };
        if let Some((_, numbers)) = rows.last_mut() {
            numbers.extend(values.split_whitespace().map(|number| number.parse::<f64>().unwrap()));
        }
    }
    let numbers = |name: String| &rows.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("no {name}")).1;
    let setting = |name: &str| DVec3::from_array(['x', 'y', 'z'].map(|axis| numbers(format!("{name} {axis}"))[0]));

    let size = setting("n control points").to_array().map(|n| n as usize);
    let mut mu = vec![DVec3::ZERO; size.iter().product()];
    for (a, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
        for row in numbers(format!("parameter {axis}")).chunks(4) {
            let [i, j, k] = [0, 1, 2].map(|b| row[b] as usize);
            mu[(i * size[1] + j) * size[2] + k][a] = row[3];
        }
    }
    PygemLattice::new(size, setting("box origin"), setting("box length"), setting("rotation angle"), mu)
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn pygems_own_test_sphere_comes_out_as_in_its_repository() {
    let lattice = pygem_parameters(&text("models/ffd/pygem-parameters_test_ffd_sphere.prm"));
    assert_eq!(lattice.lattice.size(), [3, 2, 2]);
    let table = text("models/ffd/pygem-ffd-sphere-points-derived.tsv");
    let row = |line: &str| -> [DVec3; 2] {
        let numbers: Vec<f64> = line.split('\t').map(|number| number.parse().unwrap()).collect();
        [DVec3::from_slice(&numbers[..3]), DVec3::from_slice(&numbers[3..])]
    };
    let (points, expected): (Vec<DVec3>, Vec<DVec3>) =
        table.lines().skip(1).map(|line| <(DVec3, DVec3)>::from(row(line))).unzip();
    assert_eq!(points.len(), 401);
    let moved = points.iter().zip(&expected).filter(|(a, b)| a.distance(**b) > 1e-6).count();
    assert!((100..401).contains(&moved), "{moved} of the points are inside the box");
    assert_close(&lattice.deformed(&points), &expected, &Value::from("PyGeM's test sphere"));
}
