//! `isochor bench deform` on small models: what it tells, and that it leaves nothing behind.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// The command with a folder of temporary files of its own.
fn bench(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    command.args(["bench", "deform"]).args(line.split_whitespace());
    command.env("TMPDIR", folder).env("TMP", folder).env("TEMP", folder).output().unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn sizes_times_and_memory_are_told_as_data() {
    let folder = tempfile::tempdir().unwrap();
    let output = bench(folder.path(), "--vertices 200 --vertices 800 --runs 2 --json --quiet --threads 1");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    let runs = report["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2);
    // Sections of √(n/2) corners, and n divided by that many: rings of 10 × 20 and 20 × 40 vertices.
    for (run, vertices) in runs.iter().zip([200, 800]) {
        assert_eq!(run["vertices"], vertices);
        assert_eq!(run["faces"], 2 * vertices);
        // Three floats a vertex; a count and three indices a face.
        let body = 3 * 4 * vertices + (1 + 3 * 4) * 2 * vertices;
        let header = run["file_bytes"].as_u64().unwrap() - body;
        assert!((100..400).contains(&header), "{header}");
        let stages = ["read", "examine", "bind", "deform", "correct", "write"];
        let names: Vec<&String> = run["timings_ms"].as_object().unwrap().keys().collect();
        assert!(stages.iter().all(|stage| names.iter().any(|name| name == stage)) && names.len() == stages.len());
        let sum: f64 = run["timings_ms"].as_object().unwrap().values().map(|ms| ms.as_f64().unwrap()).sum();
        assert!(run["whole_ms"].as_f64().unwrap() >= sum, "the stages are parts of the whole");
        if cfg!(target_os = "linux") {
            let beyond = run["peak_memory"].as_f64().unwrap() - run["file_bytes"].as_f64().unwrap();
            let per_vertex = run["peak_bytes_per_vertex"].as_f64().unwrap();
            assert!((per_vertex * vertices as f64 - beyond).abs() < 1.0);
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "models are removed");
}

#[test]
fn people_get_a_table_in_markdown() {
    let folder = tempfile::tempdir().unwrap();
    let output = bench(folder.path(), "--vertices 200 --runs 1");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let lines: Vec<&str> = text(&output.stdout).lines().collect();
    let [head, rule, row] = lines[..] else { panic!("{lines:?}") };
    assert!(head.starts_with("| vertices | faces | file, MB | whole, ms | ") && head.contains(" | correct, ms | "));
    assert!(row.starts_with("| 200 | 400 | 0.0 | "), "{row}");
    let columns = |line: &str| line.matches('|').count();
    assert_eq!((columns(rule), columns(row)), (columns(head), columns(head)));
}

#[test]
fn sizes_out_of_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for line in ["--vertices 10", "--vertices 25000001", "--vertices many", "--runs 0"] {
        let output = bench(folder.path(), line);
        assert_eq!(output.status.code(), Some(2), "{line}");
        let flag = line.split_whitespace().next().unwrap();
        assert!(text(&output.stderr).contains(flag), "{line}: {}", text(&output.stderr));
    }
}

#[cfg(unix)]
#[test]
fn a_folder_that_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    let output = bench(&missing, "--vertices 200 --json --quiet");
    assert_eq!(output.status.code(), Some(2));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["error"]["code"], "file");
    assert_eq!(report["error"]["where"], missing.display().to_string());
    assert!(report["error"]["hint"].as_str().unwrap().contains("TMPDIR"));
}
