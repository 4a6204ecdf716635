//! `isochor bench deform`: how long whole deformations of files take, and how much memory.
//!
//! The models are closed rings of triangles, written as binary PLY files with 32-bit floats. Each is twisted and squashed in a lattice of
//! 10 × 10 × 10 control points by `isochor deform` in a process of its own, which reads it, gives it back its volume and writes it, and
//! whose report tells the stages and the memory.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use isochor::{Stage, Timings, shapes};
use isochor_io::{Document, Format, NumberType};
use serde::Serialize;
use serde_json::Value;

use crate::args::BenchDeformArgs;
use crate::failure::Failure;
use crate::terminal::Terminal;

/// Vertices of the models unless they are named: from small ones to scans, with one of 0.9 million faces.
const SIZES: [u32; 6] = [2_500, 10_000, 50_000, 200_000, 450_000, 1_000_000];

/// What is done to each model.
const REQUEST: [&str; 6] = ["--lattice", "10", "--twist", "x=60", "--stretch", "x=0.7"];

/// What was measured.
#[derive(Serialize)]
struct Measured {
    version: &'static str,
    request: String,
    runs: Vec<Run>,
}

/// The fastest run on one model.
#[derive(Serialize)]
struct Run {
    vertices: usize,
    faces: usize,
    file_bytes: usize,
    /// From the start of the process to its end.
    whole_ms: f64,
    /// As in its report.
    timings_ms: Timings,
    /// In bytes; `None` where the system does not tell.
    peak_memory: Option<u64>,
    /// What the peak has beyond the bytes of the file.
    peak_bytes_per_vertex: Option<f64>,
}

pub fn run(args: &BenchDeformArgs, threads: Option<u16>, terminal: &Terminal) -> Result<(), Failure> {
    let sizes = if args.vertices.is_empty() { &SIZES[..] } else { &args.vertices };
    let progress = terminal.progress(sizes.len() * usize::from(args.runs));
    let mut runs = Vec::with_capacity(sizes.len());
    for &vertices in sizes {
        // A folder for each, so that only one model takes room.
        let folder = tempfile::tempdir().map_err(|error| {
            let place = std::env::temp_dir();
            Failure::file(&place, format!("cannot hold a folder: {error}"), "name another place in TMPDIR")
        })?;
        let model = folder.path().join("ring.ply");
        let written = ring(vertices, &model)?;
        let mut fastest: Option<Run> = None;
        for _ in 0..args.runs {
            progress.begin("deform");
            let run = deformed(&written, &model, threads)?;
            fastest = [fastest, Some(run)].into_iter().flatten().min_by(|a, b| a.whole_ms.total_cmp(&b.whole_ms));
        }
        runs.extend(fastest);
    }
    progress.end();
    let measured = Measured { version: env!("CARGO_PKG_VERSION"), request: REQUEST.join(" "), runs };
    terminal.answer(&measured, &table(&measured.runs));
    Ok(())
}

/// A model that was written.
struct Ring {
    vertices: usize,
    faces: usize,
    bytes: usize,
}

/// Writes a ring of about so many vertices to `path`: twice as many sections as corners in each.
fn ring(vertices: u32, path: &Path) -> Result<Ring, Failure> {
    let corners = (f64::from(vertices) / 2.0).sqrt().round().max(3.0) as usize;
    let sections = (vertices as usize / corners).max(3);
    let mesh = shapes::uv_torus(1.0, 0.4, sections, corners);
    let document = Document::from_mesh(&mesh, Format::Ply, NumberType::F32);
    let document = document.map_err(|error| Failure::write(path, &error))?;
    std::fs::write(path, document.bytes()).map_err(|error| {
        Failure::file(path, format!("cannot be written: {error}"), "name a place with more room in TMPDIR")
    })?;
    Ok(Ring { vertices: mesh.points().len(), faces: mesh.faces().len(), bytes: document.bytes().len() })
}

/// One run of `isochor deform`.
fn deformed(ring: &Ring, model: &Path, threads: Option<u16>) -> Result<Run, Failure> {
    let failed = |what: String| Failure {
        exit: 2,
        code: "bench",
        what,
        place: format!("isochor deform of {} vertices", ring.vertices),
        hint: "ask for fewer --vertices, or make room for more memory and larger files".into(),
    };
    let program = std::env::current_exe().map_err(|error| failed(format!("this program is not found: {error}")))?;
    let mut command = Command::new(program);
    command.arg("deform").arg(model).args(REQUEST).args(["--json", "--quiet", "-o"]);
    command.arg(model.with_file_name("deformed.ply"));
    if let Some(threads) = threads {
        command.args(["--threads", &threads.to_string()]);
    }
    let start = Instant::now();
    let output = command.output().map_err(|error| failed(format!("it does not start: {error}")))?;
    let whole_ms = start.elapsed().as_secs_f64() * 1e3;
    let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    if !output.status.success() {
        let why = report["error"]["what"].as_str().map_or_else(|| output.status.to_string(), str::to_owned);
        return Err(failed(format!("it failed: {why}")));
    }
    let time = |stage: &str| report["timings_ms"][stage].as_f64().map(|ms| (stage.to_owned(), ms));
    let timings_ms = Timings(stages().into_iter().filter_map(time).collect());
    let peak_memory = report["peak_memory"].as_u64();
    let beyond = |peak: u64| (peak as f64 - ring.bytes as f64) / ring.vertices as f64;
    Ok(Run {
        vertices: ring.vertices,
        faces: ring.faces,
        file_bytes: ring.bytes,
        whole_ms,
        timings_ms,
        peak_memory,
        peak_bytes_per_vertex: peak_memory.map(beyond),
    })
}

/// The stages that a report tells of, in order.
fn stages() -> Vec<&'static str> {
    let of_job = Stage::ALL.iter().map(|stage| stage.name());
    std::iter::once("read").chain(of_job).chain(std::iter::once("write")).collect()
}

/// The runs as a table in GitHub's Markdown.
fn table(runs: &[Run]) -> String {
    let mut head = vec!["vertices".to_owned(), "faces".into(), "file, MB".into(), "whole, ms".into()];
    head.extend(stages().iter().map(|stage| format!("{stage}, ms")));
    head.extend(["memory, MB".into(), "bytes per vertex beyond the file".into()]);
    let or_none = |number: Option<f64>| number.map_or_else(|| "not given".into(), |x| format!("{x:.0}"));
    let row = |run: &Run| {
        let mut row = vec![run.vertices.to_string(), run.faces.to_string()];
        row.push(format!("{:.1}", run.file_bytes as f64 / 1e6));
        row.push(format!("{:.0}", run.whole_ms));
        let time = |stage: &str| run.timings_ms.0.iter().find(|(name, _)| name == stage).map(|(_, ms)| *ms);
        row.extend(stages().iter().map(|stage| or_none(time(stage))));
        row.push(or_none(run.peak_memory.map(|peak| peak as f64 / 1e6)));
        row.push(or_none(run.peak_bytes_per_vertex));
        row
    };
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rule = line(&vec!["---:".to_owned(); head.len()]);
    let rows: String = runs.iter().map(|run| line(&row(run))).collect();
    line(&head) + &rule + &rows
}
