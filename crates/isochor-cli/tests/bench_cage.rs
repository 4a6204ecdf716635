//! `isochor bench cage`: CVB's numbers, and beside them models in cages.
//!
//! No test asserts a time.

use std::process::Command;

use serde_json::Value;

fn quick(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    let output = command.args(["bench", "cage", "--quick"]).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    assert!(output.status.success(), "{}", text(output.stderr));
    text(output.stdout)
}

#[test]
fn small_models_are_measured_beside_the_papers() {
    let bench: Value = serde_json::from_str(&quick(&["--json"])).unwrap();
    // CVB, table 3: vertices, triangles, gradient, deformation on the GPU and on the processor.
    let expected = [
        ("Teapot", 530, 1024, [1.98, 0.18, 7.43]),
        ("Semi-sphere", 2524, 1054, [2.03, 0.37, 3.38]),
        ("Monkey", 2868, 968, [1.86, 0.19, 3.78]),
    ];
    let rows = bench["models"].as_array().unwrap();
    assert_eq!(rows.len(), expected.len());
    assert_eq!((&bench["cage_vertices"], &bench["cage_triangles"]), (&92.into(), &180.into()));
    for (row, (model, vertices, triangles, times)) in rows.iter().zip(expected) {
        let paper = &row["paper"];
        assert_eq!(
            (&paper["model"], &paper["vertices"], &paper["triangles"]),
            (&model.into(), &vertices.into(), &triangles.into())
        );
        for (key, ms) in ["gradient_ms", "gpu_deform_ms", "cpu_deform_ms"].into_iter().zip(times) {
            assert_eq!(paper[key], ms, "{model} {key}");
        }
        assert_eq!(row["vertices"], vertices);
        for run in row["runs"].as_array().unwrap() {
            for stage in ["bind", "gradient", "deform"] {
                assert!(run[stage]["ms"].as_f64().unwrap() > 0.0, "{run}");
            }
        }
    }
    let text = quick(&[]);
    for word in ["CVB, table 3", "Teapot", "2,868", "7.43", "GTX280"] {
        assert!(text.contains(word), "no {word} in {text}");
    }
}
