//! `isochor bench lattice` and `isochor bench surface`: what is measured is all there, and stands beside the numbers of the
//! papers. Also what `isochor bench elastic` has in common with them.
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

/// What `bench lattice` or `bench surface` prints.
fn quick(folder: &Path, of: &str, arguments: &[&str]) -> String {
    let (code, stdout, stderr) = isochor(folder, &[&["bench", of, "--quick"], arguments].concat());
    assert_eq!(code, Some(0), "{stdout} {stderr}");
    stdout
}

fn is_time(value: &Value) -> bool {
    value.as_f64().is_some_and(|x| x > 0.0 && x.is_finite())
}

#[test]
fn reports_have_every_stage_of_every_model_with_one_thread_and_with_all() {
    let folder = tempfile::tempdir().unwrap();
    let report: Value = serde_json::from_str(&quick(folder.path(), "lattice", &["--json", "--threads", "2"])).unwrap();
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
    let text = quick(folder.path(), "lattice", &["--threads", "1"]);
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
    for of in ["lattice", "surface"] {
        let (code, stdout, stderr) = isochor(folder.path(), &["bench", of, "--quick", "--quiet"]);
        assert_eq!((code, &stdout[..], &stderr[..]), (Some(0), "", ""), "{of}");
    }
}

#[test]
fn plots_are_xml_with_a_line_for_the_paper_and_for_this_machine() {
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path(), "lattice", &["--threads", "2", "--plot", "plot.svg"]);
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

/// CO, table 1 and section 4: figure, polygons, grid cells along both directions, milliseconds of flattening and deforming.
const CO: [(&str, &str, u64, f64, f64); 3] =
    [("Figure 8", "6", 10, 166.0, 12.0), ("Figure 9", "6", 10, 128.4, 16.0), ("Figure 10", "73,665", 16, 777.0, 186.2)];

#[test]
fn reports_of_surfaces_have_the_papers_rows_and_every_grid_and_reach() {
    let folder = tempfile::tempdir().unwrap();
    let report: Value = serde_json::from_str(&quick(folder.path(), "surface", &["--json", "--threads", "2"])).unwrap();
    assert_eq!((&report["quick"], &report["reach"]), (&Value::Bool(true), &3.into()));
    assert_eq!(report["paper_machine"], "Xeon 2 GHz");
    let with_threads = |row: &Value, times: &[&str]| {
        let runs = row["runs"].as_array().unwrap();
        assert_eq!(runs.iter().map(|run| &run["threads"]).collect::<Vec<_>>(), [1, 2]);
        for time in runs.iter().flat_map(|run| times.iter().map(|time| &run[time])) {
            assert!(is_time(&time["ms"]) && is_time(&time["runs"]), "{row}");
        }
    };
    let surfaces = report["surfaces"].as_array().unwrap();
    assert_eq!(surfaces.len(), CO.len());
    for (row, (figure, _, cells, flatten, deform)) in surfaces.iter().zip(CO) {
        assert_eq!((&row["paper"]["figure"], &row["paper"]["cells"]), (&figure.into(), &cells.into()));
        let times = ["flatten_ms", "deform_ms"].map(|key| row["paper"][key].as_f64().unwrap());
        assert_eq!(times, [flatten, deform]);
        with_threads(row, &["flatten", "deform"]);
    }
    // 2 n (n + 1) faces and n (2 n + 1) + 2 vertices of the dolphin for n = 191, which is not divided; the plate's 6 faces are.
    let size = |row: &Value| ["faces", "vertices"].map(|key| row[key].as_u64().unwrap());
    assert_eq!(size(&surfaces[2]), [2 * 191 * 192, 191 * 383 + 2]);
    let model_faces: Vec<&Value> = surfaces.iter().map(|row| &row["model_faces"]).collect();
    assert_eq!(model_faces, [6, 6, 2 * 191 * 192]);
    assert!(surfaces[..2].iter().all(|row| size(row)[0] > 6 && size(row)[1] > 8), "{surfaces:?}");
    // The wave is a cylinder over a curve, so it is laid out flat; the others curve in both directions.
    let stretch = |row: &Value| ["stretch", "compression"].map(|key| row[key].as_f64().unwrap());
    assert!(stretch(&surfaces[0]).iter().all(|percent| *percent < 1e-3), "{surfaces:?}");
    assert!(surfaces[1..].iter().all(|row| stretch(row).iter().all(|percent| *percent > 0.1)), "{surfaces:?}");

    let grids = report["grids"].as_array().unwrap();
    assert_eq!(grids.iter().map(|grid| &grid["cells"]).collect::<Vec<_>>(), [5, 10]);
    for grid in grids {
        let reaches = grid["reaches"].as_array().unwrap();
        assert_eq!(reaches.iter().map(|row| &row["reach"]).collect::<Vec<_>>(), [1, 2, 3]);
        for row in reaches {
            // Laid out flat, it does not fold.
            assert_eq!(row["folded"], 0, "{row}");
            with_threads(row, &["flatten"]);
        }
    }
}

#[test]
fn tables_of_surfaces_have_the_papers_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let text = quick(folder.path(), "surface", &["--threads", "1"]);
    let tables: Vec<Vec<Vec<&str>>> = text
        .split("**\n\n")
        .skip(1)
        .map(|table| {
            let rows = table.lines().take_while(|line| line.starts_with('|'));
            rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
        })
        .collect();
    let [along, flattening] = &tables[..] else { panic!("{text}") };
    assert_eq!(along.len(), 2 + CO.len(), "{text}");
    for (row, (figure, polygons, cells, flatten, deform)) in along[2..].iter().zip(CO) {
        assert!(row[0].starts_with(&format!("{figure}: ")), "{row:?}");
        let expected = [polygons.into(), format!("{cells} × {cells}"), flatten.to_string(), deform.to_string()];
        assert_eq!([row[1], row[3], row[4], row[6]], expected);
        assert_eq!(row.len(), along[0].len());
    }
    assert_eq!(flattening.len(), 2 + 2, "{text}");
    assert!(flattening.iter().all(|row| row.len() == 1 + 2 * 3), "{text}");
    assert_eq!([flattening[2][0], flattening[3][0]], ["5 × 5", "10 × 10"]);
    assert!(text.contains("CO: Xeon 2 GHz.") && text.contains("a plot without numbers"), "{text}");
    assert!(text.contains("leave --quick out") && !text.contains("2 threads"), "{text}");
}

#[test]
fn plots_of_flattening_have_a_line_for_every_reach() {
    let folder = tempfile::tempdir().unwrap();
    quick(folder.path(), "surface", &["--threads", "2", "--plot", "plot.svg"]);
    let text = std::fs::read_to_string(folder.path().join("plot.svg")).unwrap();
    let svg = roxmltree::Document::parse(&text).unwrap();
    // A point for each of two grids.
    assert_eq!(svg.descendants().filter(|node| node.tag_name().name() == "circle").count(), 2 * 3);
    let words: Vec<&str> = svg.descendants().filter_map(|node| node.text()).map(str::trim).collect();
    for word in ["r = 1, 2 threads", "r = 2, 2 threads", "r = 3, 2 threads", "grid cells", "milliseconds"] {
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
    let cases =
        [("plot.pdf", "is no .svg file"), ("nowhere/plot.svg", "does not exist"), ("folder.svg", "is a folder")];
    for of in ["lattice", "surface", "elastic", "cage"] {
        for (path, what) in cases {
            let (code, stdout, stderr) = isochor(folder.path(), &["bench", of, "--json", "--plot", path]);
            assert_eq!(code, Some(2), "{stdout} {stderr}");
            let report: Value = serde_json::from_str(&stdout).unwrap();
            assert_eq!((&report["error"]["code"], &report["error"]["where"]), (&"file".into(), &path.into()));
            assert!(report["error"]["what"].as_str().unwrap().contains(what), "{stdout}");
        }
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
        (&["bench", "surface", "--plot"], "--plot"),
        (&["bench", "surface", "model.ply"], "model.ply"),
        (&["bench", "elastic", "--plot"], "--plot"),
        (&["bench", "elastic", "model.ply"], "model.ply"),
        (&["bench", "cage", "--plot"], "--plot"),
        (&["bench", "cage", "model.ply"], "model.ply"),
        (&["bench", "lattice", "--quick", "--threads", "0"], "--threads"),
    ] {
        let (code, _, stderr) = isochor(folder.path(), arguments);
        assert!(code == Some(2) && stderr.contains(fragment), "{arguments:?}: {stderr}");
    }
    assert!(names(&folder).is_empty());
}
