//! `isochor cage`: what it writes and tells, and what it refuses.

use std::path::Path;
use std::process::{Command, Output};

use isochor::{CageCheck, Mesh, shapes};
use isochor_io::{Document, Format, NumberType};
use serde_json::Value;

fn isochor(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn mesh(folder: &Path, name: &str) -> Mesh {
    let format = Format::from_path(name.as_ref()).unwrap();
    Document::parse(std::fs::read(folder.join(name)).unwrap(), format).unwrap().mesh().clone()
}

#[test]
fn cages_are_written_as_obj_and_ply_and_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let ball = shapes::icosphere(2);
    let bytes = Document::from_mesh(&ball, Format::Obj, NumberType::F64).unwrap().bytes().to_vec();
    std::fs::write(folder.path().join("ball.obj"), bytes).unwrap();
    for name in ["cage.obj", "cage.ply"] {
        let line = format!("cage ball.obj -o {name} --faces 60 --distance 0.05 --json --quiet");
        let output = isochor(folder.path(), &line);
        assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), ""));
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        let distance = 0.05 * ball.bounds().unwrap().extent();
        let report = CageCheck::of(&mesh(folder.path(), name), &ball, distance);
        assert!(report.faults.is_empty() && report.faces <= 60, "{report:?}");
        assert_eq!(told["output"], name);
        assert_eq!(told["distance"], distance);
        assert_eq!(told["faces"], report.faces);
        assert_eq!(told["components"], 1);
        assert_eq!(told["least_distance"].as_f64(), report.least_distance);
        assert_eq!(told["volume"].as_f64(), report.volume);
        assert_eq!(told["faults"], Value::Array(Vec::new()));
    }
    assert_eq!(mesh(folder.path(), "cage.obj"), mesh(folder.path(), "cage.ply"));
    let output = isochor(folder.path(), "cage shape:ball -o said.obj");
    let said = text(&output.stderr);
    assert!(said.contains("triangles, one piece") && said.contains("wrote said.obj"), "{said}");
    assert_eq!(text(&output.stdout), "");
}

#[test]
fn what_cannot_be_made_is_refused_and_nothing_written() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("model.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path().join("point.obj"), "v 1 1 1\n").unwrap();
    // Two triangles so far apart that no surface round both is near enough to have one piece of 8 triangles.
    let far = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 10 0 0\nv 10.1 0 0\nv 10 0.1 0\nv 5 9 0\nv 5.1 9 0\nv 5 9.1 0\nf 1 2 3\nf 4 5 6\nf 7 8 9\n";
    std::fs::write(folder.path().join("far.obj"), far).unwrap();
    let cases = [
        ("model.obj -o model.obj", 2, "would overwrite the model"),
        ("model.obj -o cage.stl", 2, "OBJ or PLY"),
        ("model.obj -o cage.txt", 2, "not a format"),
        ("missing.obj -o cage.obj", 2, "cannot be read"),
        ("model.obj -o cage.obj --faces 7", 2, "ask for 8 or more"),
        ("model.obj -o cage.obj --distance 0", 2, "must be between"),
        ("model.obj -o cage.obj --distance nan", 2, "must be between"),
        ("point.obj -o cage.obj", 2, "extent of the model is 0"),
        // Three closed surfaces have four triangles each.
        ("far.obj -o cage.obj --faces 10", 1, "triangles were reached, and 10 were asked for"),
        ("model.obj", 2, "--output"),
    ];
    for (line, code, what) in cases {
        let output = isochor(folder.path(), &format!("cage {line}"));
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(what), "{line}: {:?} {said}", output.status);
        let told = isochor(folder.path(), &format!("cage {line} --json --quiet")).stdout;
        let told: Value = serde_json::from_slice(&told).unwrap();
        assert!(told["error"]["what"].as_str().is_some_and(|said| !said.is_empty()), "{line}: {told}");
    }
    let mut left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["far.obj", "model.obj", "point.obj"]);
}
