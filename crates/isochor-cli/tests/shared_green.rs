//! Green coordinates in the cages of published models, and beside those of another program.

use std::path::PathBuf;

use glam::DVec3;
use isochor::{Cage, Faces, Mesh, green_coordinates, stretched_normals};
use isochor_io::{Document, Format};
use serde_json::Value;

fn shared(path: &str) -> Vec<u8> {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    std::fs::read(PathBuf::from(folder).join(path)).unwrap()
}

fn mesh(name: &str) -> Mesh {
    let document = Document::parse(shared(&format!("models/{name}")), Format::from_path(name.as_ref()).unwrap());
    document.unwrap().mesh().clone()
}

/// Rows times vertices and stretched normals.
fn deformed(cage: &Cage, posed: &[DVec3], rows: &[f64]) -> Vec<DVec3> {
    let controls: Vec<DVec3> = posed.iter().copied().chain(stretched_normals(cage, posed)).collect();
    rows.chunks(controls.len()).map(|row| row.iter().zip(&controls).map(|(x, c)| *x * *c).sum()).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn vectors(value: &Value) -> Vec<DVec3> {
    value.as_array().unwrap().iter().map(|v| DVec3::from_slice(&numbers(v))).collect()
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn coordinates_stretches_and_places_are_those_of_another_program() {
    let reference: Value = serde_json::from_slice(&shared("reference/green_reference.json")).unwrap();
    let mut faces = Faces::new();
    for face in reference["cage_faces"].as_array().unwrap() {
        faces.push(&numbers(face).iter().map(|v| *v as u32).collect::<Vec<_>>());
    }
    let cage = Cage::new(Mesh::new(vectors(&reference["cage_vertices"]), faces).unwrap()).unwrap();
    let points = vectors(&reference["points"]);
    let rows = green_coordinates(&cage, &points);
    let (vertices, length) = (cage.vertices().len(), rows.len() / points.len());
    for (k, row) in rows.chunks(length).enumerate() {
        let expected = [numbers(&reference["phi"][k]), numbers(&reference["psi"][k])].concat();
        for (i, (x, expected)) in row.iter().zip(&expected).enumerate() {
            assert!((x - expected).abs() <= 1e-12, "point {k}, {i} of {vertices}: {x}, not {expected}");
        }
    }
    let posed = vectors(&reference["cage_deformed"]);
    let stretches: Vec<f64> = stretched_normals(&cage, &posed).iter().map(|m| m.length()).collect();
    for (t, (found, expected)) in stretches.iter().zip(numbers(&reference["scale"])).enumerate() {
        assert!((found - expected).abs() <= 1e-12, "triangle {t}: {found}, not {expected}");
    }
    for (found, expected) in deformed(&cage, &posed, &rows).iter().zip(vectors(&reference["deformed_points"])) {
        assert!((*found - expected).length() <= 1e-12, "{found}, not {expected}");
    }
}

/// Corners, middles of sides and of triangles, and points up to a thousandth of the extent over and under them.
fn near(cage: &Cage) -> Vec<DVec3> {
    let mut points = Vec::new();
    for triangle in cage.triangles() {
        let [a, b, c] = triangle.map(|v| cage.vertices()[v as usize]);
        let normal = (b - a).cross(c - a).normalize() * cage.extent();
        for at in [a, (a + b) / 2.0, (a + b + c) / 3.0] {
            points.push(at);
            points.extend([1e-12, 1e-9, 1e-6, 1e-3].iter().flat_map(|h| [at - *h * normal, at + *h * normal]));
        }
    }
    points
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn models_in_their_cages_are_reproduced() {
    /// Vertices of a model that are looked at, at most.
    const VERTICES: usize = 4000;
    let table = String::from_utf8(shared("models/CAGES.tsv")).unwrap();
    let (mut outside, mut worst) = (0, (0.0, 0.0));
    for row in table.lines().skip(1) {
        let cells: Vec<&str> = row.split('\t').collect();
        let (model, cage) = (mesh(cells[0]), Cage::new(mesh(cells[1])).unwrap());
        let vertices = model.points().iter().step_by(model.points().len().div_ceil(VERTICES)).copied();
        let points: Vec<DVec3> = vertices.chain(near(&cage)).collect();
        outside += points.iter().step_by(10).filter(|p| !cage.contains(**p)).count();
        let rows = green_coordinates(&cage, &points);
        let count = cage.vertices().len();
        for (p, row) in points.iter().zip(rows.chunks(rows.len() / points.len())) {
            let error = (row[..count].iter().sum::<f64>() - 1.0).abs();
            assert!(error <= 5e-12, "{}, {p}: φ sums to 1 ± {error:e}", cells[1]);
            worst.0 = f64::max(worst.0, error);
        }
        for (p, same) in points.iter().zip(deformed(&cage, cage.vertices(), &rows)) {
            let error = (same - *p).length() / cage.extent();
            assert!(error <= 5e-12, "{}, {p}: {error:e} extents away", cells[1]);
            worst.1 = f64::max(worst.1, error);
        }
    }
    println!("φ sums to 1 ± {:e}; points come out to {:e} extents", worst.0, worst.1);
    assert!(outside > 100, "{outside}");
}
