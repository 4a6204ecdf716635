//! `isochor bench`: what is measured is all there, and stands beside the numbers of the paper.
//!
//! No test asserts a time.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

/// Exit code, standard output, standard error.
fn isochor(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    let output = command.current_dir(folder).env_remove("RAYON_NUM_THREADS").args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

fn quick(folder: &Path, arguments: &[&str]) -> String {
    let (code, stdout, stderr) = isochor(folder, &[&["bench", "lattice", "--quick"], arguments].concat());
    assert_eq!(code, Some(0), "{stdout} {stderr}");
    stdout
}

fn is_time(value: &Value) -> bool {
    value.as_f64().is_some_and(|x| x > 0.0 && x.is_finite())
}

#[test]
fn reports_have_every_stage_of_every_model_with_one_thread_and_with_all() {
    let folder = tempfile::tempdir().unwrap();
    let report: Value = serde_json::from_str(&quick(folder.path(), &["--json", "--threads", "2"])).unwrap();
    assert_eq!((&report["quick"], &report["lattice"]), (&Value::Bool(true), &10.into()));
    let models = report["models"].as_array().unwrap();
    let names: Vec<&str> = models.iter().map(|model| model["model"].as_str().unwrap()).collect();
    assert_eq!(names, ["Sphere", "Porsche"]);
    for model in models {
        let [vertices, faces] = ["vertices", "faces"].map(|key| model[key].as_u64().unwrap());
        assert_eq!((faces, faces), (2 * vertices - 4, model["paper_non_zeros"]["faces"].as_u64().unwrap()));
        // 64 where all corners of a face are in one cell, fewer where one is on the border of the lattice.
        for key in ["non_zeros_in_10", "non_zeros_in_6"] {
            assert!((60..80).contains(&(model[key].as_u64().unwrap() / faces)), "{key}: {}", model[key]);
        }
        assert!(model["kept_bytes"].as_u64().unwrap() > 24 * vertices);
        let runs = model["runs"].as_array().unwrap();
        assert_eq!(runs.iter().map(|run| &run["threads"]).collect::<Vec<_>>(), [1, 2]);
        for run in runs {
            assert!(is_time(&run["bandwidth"]["read"]) && is_time(&run["bandwidth"]["copy"]));
            let stages = run["stages"].as_array().unwrap();
            assert_eq!(stages.len(), 10);
            for stage in stages {
                assert!(is_time(&stage["ms"]) && is_time(&stage["sweeps"]) && is_time(&stage["bytes"]), "{stage}");
                // Its time, in times that a sweep takes for its bytes.
                let sweep = 1e3 * stage["bytes"].as_f64().unwrap() / run["bandwidth"]["read"].as_f64().unwrap();
                let sweeps = stage["ms"].as_f64().unwrap() / sweep;
                assert!((stage["sweeps"].as_f64().unwrap() / sweeps - 1.0).abs() < 1e-12, "{stage}");
            }
        }
    }
}

#[test]
fn one_thread_has_one_run_and_tables_are_markdown() {
    let folder = tempfile::tempdir().unwrap();
    let text = quick(folder.path(), &["--threads", "1"]);
    // Two tables of the paper, one of limits, two of stages, and one of the memory.
    assert_eq!(text.lines().filter(|line| line.starts_with("**")).count(), 6, "{text}");
    let columns = |line: &str| line.matches('|').count();
    let tables = text.split("**\n\n").skip(1);
    for table in tables {
        let rows: Vec<&str> = table.lines().take_while(|line| line.starts_with('|')).collect();
        let of_models = !rows[0].starts_with("| stage |");
        assert_eq!(rows.len(), 2 + if of_models { 2 } else { 10 }, "{table}");
        assert!(rows.iter().all(|row| columns(row) == columns(rows[0])), "{table}");
        let first = if of_models { "| Sphere |" } else { "| prepare |" };
        assert!(rows[1].starts_with("|---|--:|") && rows[2].starts_with(first), "{table}");
    }
    assert!(text.contains("| 322,598 |") && text.contains("| 301,916 |") && !text.contains("2 threads"), "{text}");
    assert!(text.contains("leave --quick out"), "{text}");
}

#[test]
fn quiet_measurements_say_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (code, stdout, stderr) = isochor(folder.path(), &["bench", "lattice", "--quick", "--quiet"]);
    assert_eq!((code, &stdout[..], &stderr[..]), (Some(0), "", ""));
}

#[test]
fn plots_are_xml_with_a_line_for_the_paper_and_for_this_machine() {
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path(), &["--threads", "2", "--plot", "plot.svg"]);
    let text = std::fs::read_to_string(folder.path().join("plot.svg")).unwrap();
    let svg = roxmltree::Document::parse(&text).unwrap();
    assert_eq!(svg.root_element().tag_name().name(), "svg");
    let count = |name: &str| svg.descendants().filter(|node| node.tag_name().name() == name).count();
    // 8 points of each line of the paper's, 2 of each of ours.
    assert_eq!(count("circle"), 2 * 8 + 3 * 2);
    let words: Vec<&str> = svg.descendants().filter_map(|node| node.text()).map(str::trim).collect();
    for word in ["HB, CPU", "HB, GPU", "here, 1 thread", "here, 2 threads", "vertices", "milliseconds"] {
        assert!(words.contains(&word), "{word}: {words:?}");
    }
}

fn names(folder: &TempDir) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path()).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn plots_that_cannot_be_written_are_told_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("folder.svg")).unwrap();
    for (path, what) in
        [("plot.pdf", "is no .svg file"), ("nowhere/plot.svg", "does not exist"), ("folder.svg", "is a folder")]
    {
        let (code, stdout, stderr) = isochor(folder.path(), &["bench", "lattice", "--json", "--plot", path]);
        assert_eq!(code, Some(2), "{stdout} {stderr}");
        let report: Value = serde_json::from_str(&stdout).unwrap();
        assert_eq!((&report["error"]["code"], &report["error"]["where"]), (&"file".into(), &path.into()));
        assert!(report["error"]["what"].as_str().unwrap().contains(what), "{stdout}");
    }
    assert_eq!(names(&folder), ["folder.svg"]);
}

#[test]
fn bad_usage_ends_with_2() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, fragment) in [
        (&["bench"][..], "subcommand"),
        (&["bench", "latice"], "lattice"),
        (&["bench", "lattice", "--plot"], "--plot"),
        (&["bench", "lattice", "model.ply"], "model.ply"),
        (&["bench", "lattice", "--quick", "--threads", "0"], "--threads"),
    ] {
        let (code, _, stderr) = isochor(folder.path(), arguments);
        assert!(code == Some(2) && stderr.contains(fragment), "{arguments:?}: {stderr}");
    }
    assert!(names(&folder).is_empty());
}
