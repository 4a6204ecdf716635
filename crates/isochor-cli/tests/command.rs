//! The `isochor` command from end to end: every flag, every exit code, every file it writes.
//!
//! Models are those of `isochor demo`, so that nothing has to be there before.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use base64::Engine as _;
use glam::DVec3;
use isochor::{Bounds, BuiltIn, Faces, Health, Mesh, Source, shapes, topology};
use isochor_io::{Document, Format, NumberType};
use serde_json::Value;
use tempfile::TempDir;

/// Where the stories of the demo are, written once for all tests.
fn demo() -> &'static Path {
    static DEMO: OnceLock<PathBuf> = OnceLock::new();
    DEMO.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("demo");
        let status = Command::new(env!("CARGO_BIN_EXE_isochor")).args(["demo", "--quiet"]).arg(&folder).status();
        assert!(status.unwrap().success());
        folder
    })
}

const STORIES: [(&str, &str); 7] = [
    ("ball", "ply"),
    ("cube", "obj"),
    ("bottle", "stl"),
    ("ring", "ply"),
    ("flask", "ply"),
    ("ear", "ply"),
    ("chain", "ply"),
];

/// The unit cube without its side at x = 1.
const OPEN: &str = "v 0 0 0\nv 0 0 1\nv 0 1 0\nv 0 1 1\nv 1 0 0\nv 1 0 1\nv 1 1 0\nv 1 1 1\n\
                    f 1 2 4 3\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";

/// How a command ended.
struct Ran {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Ran {
    fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {} {}", self.stdout, self.stderr))
    }

    fn succeeded(self) -> Self {
        assert_eq!(self.code, Some(0), "{} {}", self.stdout, self.stderr);
        self
    }
}

/// The folder of one test, with models in it.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (name, extension) in STORIES {
            let file = format!("{name}.{extension}");
            std::fs::copy(demo().join(&file), folder.path(&file)).unwrap();
        }
        folder.write("open.obj", OPEN);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.bytes(name)).unwrap()
    }

    fn document(&self, name: &str) -> Document {
        Document::parse(self.bytes(name), Format::from_path(name.as_ref()).unwrap()).unwrap()
    }

    fn points(&self, name: &str) -> Vec<DVec3> {
        self.document(name).mesh().points().to_vec()
    }

    /// Everything in the folder, by name; folders without what is in them.
    fn contents(&self) -> BTreeMap<OsString, Vec<u8>> {
        let entries = std::fs::read_dir(self.0.path()).unwrap().map(Result::unwrap);
        entries.map(|e| (e.file_name(), std::fs::read(e.path()).unwrap_or_default())).collect()
    }

    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
        command.current_dir(self.0.path()).env_remove("RAYON_NUM_THREADS");
        command
    }

    /// Runs `isochor` in the folder with the words of a line; single quotes hold words together.
    fn isochor(&self, line: &str) -> Ran {
        let mut command = self.command();
        for (i, part) in line.split('\'').enumerate() {
            if i % 2 == 1 {
                command.arg(part);
            } else {
                command.args(part.split_whitespace());
            }
        }
        ran(&mut command)
    }

    /// The JSON report of a deformation that succeeds.
    fn report(&self, line: &str) -> Value {
        self.isochor(&format!("deform --json --quiet {line}")).succeeded().json()
    }
}

fn ran(command: &mut Command) -> Ran {
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ran { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// The volume of a mesh, caps included.
fn volume(mesh: &Mesh) -> f64 {
    Health::of(mesh, &topology(mesh), &Source::of(mesh)).0.volume.unwrap().total
}

/// The largest relative error of the volumes that were asked for.
fn relative_error(report: &Value) -> f64 {
    let parts = report["volume"]["parts"].as_array().unwrap();
    let errors: Vec<f64> = std::iter::once(&report["volume"])
        .chain(parts)
        .filter(|row| !row["target"].is_null())
        .map(|row| row["relative_error"].as_f64().unwrap())
        .collect();
    assert!(!errors.is_empty(), "nothing was asked for: {report}");
    errors.into_iter().fold(0.0, f64::max)
}

fn number(report: &Value, key: &str) -> f64 {
    report["volume"][key].as_f64().unwrap_or_else(|| panic!("no number {key} in {report}"))
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn assert_has(value: &Value, expected: &[&str]) {
    for key in expected {
        assert!(value.get(key).is_some(), "no {key} in {:?}", keys(value));
    }
}

/// The longest distance between points of the same number, in extents of the first.
fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / Bounds::of(a).unwrap().extent()
}

// The demo, help, pages

#[test]
fn demo_writes_what_its_readme_says() {
    let folder = TempDir::new().unwrap();
    let folder = Folder(folder);
    let ran = folder.isochor("demo --json stories").succeeded();
    let readme = std::fs::read_to_string(folder.path("stories/README.txt")).unwrap();
    let index = String::from_utf8(folder.bytes("stories/index.html")).unwrap();
    let mut expected = vec!["README.txt".to_owned(), "demo.json".into(), "index.html".into()];
    for (name, extension) in STORIES {
        assert!(readme.contains(&format!("\n{name}: ")), "{readme}");
        expected.extend(["", "-deformed", "-corrected"].map(|suffix| format!("{name}{suffix}.{extension}")));
        expected.extend(["toml", "png", "html"].map(|extension| format!("{name}.{extension}")));
        let report = folder.json("stories/demo.json")[name].clone();
        assert!(index.contains(&format!("{name}.png")) && index.contains(&format!("{name}.html")), "{name}");
        assert!(relative_error(&report) <= 1e-13, "{name}: {report}");
        assert!(ran.stderr.contains(&format!("{name}: ")), "{}", ran.stderr);

        // The plain deformation has the posed volume, the corrected one what is said of it.
        let tolerance = if extension == "stl" { 1e-6 } else { 1e-13 };
        for (file, key) in [("deformed", "posed"), ("corrected", "final"), ("corrected", "written")] {
            let found = volume(folder.document(&format!("stories/{name}-{file}.{extension}")).mesh());
            assert!((found / number(&report, key) - 1.0).abs() <= tolerance, "{name}: {key}");
        }
    }
    expected.sort();
    let mut found: Vec<String> = std::fs::read_dir(folder.path("stories"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    found.sort();
    assert_eq!(found, expected);
    assert_eq!(ran.json(), folder.json("stories/demo.json"));
}

#[test]
fn jobs_of_the_demo_run_again_and_give_the_same_bytes() {
    let folder = Folder(TempDir::new().unwrap());
    folder.isochor("demo --quiet").succeeded();
    for (name, extension) in STORIES {
        let output = format!("isochor-demo/{name}-corrected.{extension}");
        let before = folder.bytes(&output);
        std::fs::remove_file(folder.path(&output)).unwrap();
        folder.isochor(&format!("deform --job isochor-demo/{name}.toml")).succeeded();
        assert!(folder.bytes(&output) == before, "{name}");
    }
}

/// The jobs of cages run where they are, with the cages beside them, and are exact; what the docs say of the least stress is so.
#[test]
fn example_jobs_of_cages_do_what_the_docs_say() {
    let folder = Folder(TempDir::new().unwrap());
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let run = |name: &str| {
        let job = root.join("examples/jobs/cage").join(name);
        folder.report(&format!("--job {} -o out.ply --picture out.png --size 64x64", job.display()))
    };
    for name in ["bend.toml", "green.toml", "least-motion.toml"] {
        let report = run(name);
        assert!(relative_error(&report) <= 1e-13, "{name}: {report}");
        assert_eq!((&report["cage"]["outside"], &report["warnings"]), (&0.into(), &Value::Array(vec![])), "{name}");
    }
    let slid = run("slide.toml");
    assert!((number(&slid, "posed") / number(&slid, "rest") - 1.0).abs() <= 1e-13, "{slid}");
    let film = run("swing.toml");
    assert!(film["frames"].as_array().unwrap().iter().all(|frame| relative_error(frame) <= 1e-13), "{film}");
    let report = run("least-stress.toml");
    assert!(relative_error(&report) <= 1e-13, "{report}");
    let least = &report["cage"]["least_stress"];
    let degrees = |pose: &str| least[pose]["mean_degrees"].as_f64().unwrap();
    let said =
        format!("the mean angle is {:.1}°, by least motion {:.1}°", degrees("least_stress"), degrees("least_motion"));
    let page = std::fs::read_to_string(root.join("docs/cage.md")).unwrap();
    assert!(page.contains(&said), "docs/cage.md: {said}");
}

#[test]
fn example_jobs_run_on_the_models_of_the_demo() {
    let folder = Folder(TempDir::new().unwrap());
    folder.isochor("demo --quiet").succeeded();
    let jobs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/jobs");
    let mut ran = 0;
    for entry in std::fs::read_dir(jobs).unwrap() {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name().into_string().unwrap())).unwrap();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        ran += 1;
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("# "), "{name} begins with what it shows");
        assert!(text.contains(&format!("\n# In this folder: isochor demo && isochor deform --job {name}\n")), "{name}");
        folder.write(&name, &text);
        let report = folder.report(&format!("--job {name}"));
        assert_eq!((&report["correction"]["status"], &report["warnings"]), (&"exact".into(), &Value::Array(vec![])));
        assert!(relative_error(&report) <= 1e-13, "{name}: {report}");
        assert!(report["correction"]["point_error"].as_f64().unwrap() <= 1e-12, "{name}: {report}");
        let displacement = report["correction"]["max_displacement_relative"].as_f64().unwrap();
        assert!(displacement > 1e-4 && displacement < 0.3, "{name}: {displacement}");
        let written = name.replace(".toml", "");
        let report_file = text.split("report = \"").nth(1).unwrap().split('"').next().unwrap();
        assert_eq!(folder.json(report_file), report, "{written}");
    }
    assert!(ran >= 5, "only {ran} jobs");
}

#[test]
fn help_has_examples_for_every_command() {
    let folder = Folder::new();
    let help = folder.isochor("--help").succeeded().stdout;
    for command in ["demo", "info", "deform", "cage", "bench", "completions", "man"] {
        assert!(help.contains(&format!("\n  {command} ")), "{help}");
        for line in [format!("help {command}"), format!("{command} --help")] {
            let help = folder.isochor(&line).succeeded().stdout;
            assert!(help.contains("Examples:\n  isochor "), "{line}: {help}");
        }
    }
    let version = folder.isochor("--version").succeeded().stdout;
    assert_eq!(version.trim(), concat!("isochor ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn every_flag_in_the_help_stands_in_a_test() {
    let help = Folder::new().isochor("deform --help").succeeded().stdout;
    let flags = help.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).filter(|word| word.starts_with("--"));
    let tests = include_str!("command.rs");
    let is_tested = |flag: &str| {
        tests
            .match_indices(flag)
            .any(|(at, _)| !tests[at + flag.len()..].starts_with(|c: char| c.is_ascii_lowercase() || c == '-'))
    };
    let untested: Vec<&str> = flags.filter(|flag| !is_tested(flag)).collect();
    assert!(untested.is_empty(), "{untested:?}");
}

/// The unit cube as a cage, as it is and with its sides of y > 0.5 moved outward and its top pulled up.
fn write_cages(folder: &Folder) {
    let cube = shapes::cube(1);
    let moved = |f: &dyn Fn(DVec3) -> DVec3| cube.with_points(cube.points().iter().map(|p| f(*p)).collect()).unwrap();
    let round = |p: DVec3| (p - 0.5) * 2.6;
    let pulled = |p: DVec3| round(p) + DVec3::new(0.0, 0.8 * p.y, 0.5 * p.z * p.x);
    for (name, mesh) in [("cage.obj", moved(&round)), ("posed.obj", moved(&pulled))] {
        folder.write(name, Document::from_mesh(&mesh, Format::Obj, NumberType::F64).unwrap().bytes());
    }
}

#[test]
fn cages_deform_models_at_constant_volume() {
    let folder = Folder::new();
    write_cages(&folder);
    for coordinates in ["mean-value", "harmonic", "green"] {
        let keys = format!("posed=\"posed.obj\",coordinates=\"{coordinates}\",save_weights=\"{coordinates}.weights\"");
        let line = format!("shape:ball -o {coordinates}.ply --cage cage.obj:{keys} --save-controls {coordinates}.obj");
        let report = folder.report(&line);
        assert!(relative_error(&report) <= 1e-13, "{report}");
        assert_eq!(report["cage"]["coordinates"], coordinates);
        assert_eq!((&report["cage"]["vertices"], &report["cage"]["outside"]), (&8.into(), &0.into()));
        assert!(report["cage"]["linear_precision"].as_f64().unwrap() <= 1e-13);
        // The corrected cage, as a pose, has the volume already, and saved weights are the same.
        let again =
            format!("posed=\"{coordinates}.obj\",coordinates=\"{coordinates}\",weights=\"{coordinates}.weights\"");
        let report = folder.report(&format!("shape:ball -o again.ply --cage cage.obj:{again} --preserve free"));
        assert!((number(&report, "posed") / number(&report, "rest") - 1.0).abs() <= 1e-12, "{report}");
        assert!(farthest(&folder.points("again.ply"), &folder.points(&format!("{coordinates}.ply"))) <= 1e-12);
    }
    let other = "deform shape:cube -o no.ply --cage cage.obj:weights=\"green.weights\",coordinates=\"green\"";
    let ran = folder.isochor(other);
    assert!(ran.code == Some(2) && ran.stderr.contains("of another model"), "{}", ran.stderr);
    let ran = folder.isochor("deform shape:ball -o no.ply --cage cage.obj:weights=\"green.weights\"");
    assert!(ran.code == Some(2) && ran.stderr.contains("green coordinates, not mean-value"), "{}", ran.stderr);
    assert!(!folder.path("no.ply").exists());
}

/// A film from rest to the posed cage, and the pose again by least stress.
#[test]
fn cages_go_to_their_pose_in_films_and_are_completed_by_least_stress() {
    let folder = Folder::new();
    write_cages(&folder);
    folder.report("shape:ball -o rest.ply");
    folder.report("shape:ball -o posed.ply --cage cage.obj:posed=\"posed.obj\"");
    let film = "frames = 3\nmodel = \"shape:ball\"\noutput = \"film.ply\"\n[cage]\nfile = \"cage.obj\"\nposed = \"posed.obj\"\n\
                blend = { keys = [[0, 0], [1, 1]] }\n[view]\nfilm = false";
    folder.write("film.toml", film);
    let report = folder.report("--job film.toml");
    let frames = report["frames"].as_array().unwrap();
    assert!(frames.iter().all(|frame| relative_error(frame) <= 1e-13), "{report}");
    assert_eq!(folder.points("film-0001.ply"), folder.points("rest.ply"));
    assert_eq!(folder.points("film-0003.ply"), folder.points("posed.ply"));
    assert!(farthest(&folder.points("film-0002.ply"), &folder.points("rest.ply")) > 0.05);
    let ran = folder.isochor("deform shape:ball -o no.ply --cage cage.obj:blend=0.5");
    assert!(ran.code == Some(2) && ran.stderr.contains("name one with cage.posed"), "{}", ran.stderr);
    let keys = "posed=\"posed.obj\",free={vertices=[0,1,2]},witnesses=50";
    let report = folder.report(&format!("shape:ball -o least.ply --cage cage.obj:{keys} --objective stress"));
    assert!(relative_error(&report) <= 1e-13, "{report}");
    assert_eq!(report["correction"]["objective"], "stress");
    let least = &report["cage"]["least_stress"];
    assert_eq!((&least["free"], &least["is_settled"]), (&3.into(), &true.into()), "{report}");
    let [motion, stress] = [0, 1].map(|k| least["mean_squared_sine"][k].as_f64().unwrap());
    assert!(stress < motion && least["witnesses"].as_u64().unwrap() >= 50, "{report}");
}

#[test]
fn slides_and_handles_move_vertices_of_cages() {
    let folder = Folder::new();
    write_cages(&folder);
    let cage = "--cage cage.obj:planes={vertices=[7]}";
    folder.report("shape:ball -o rest.ply");
    let report = folder
        .report(&format!("shape:ball -o slid.ply {cage} --slide v=7:0.3,0.2,-0.1 --preserve free --picture slid.png"));
    assert!((number(&report, "posed") / number(&report, "rest") - 1.0).abs() <= 1e-13, "{report}");
    assert_eq!(report["cage"]["planes"][0]["vertex"], 7);
    assert!(farthest(&folder.points("slid.ply"), &folder.points("rest.ply")) > 0.1);
    folder.write("moves.param", "0 1 1\n7 0.2 0.4 0.6\n");
    let report = folder.report(
        "shape:ball -o moved.ply --cage cage.obj:posed=\"moves.param\",free={vertices=[0,1]} --save-controls moved.obj",
    );
    assert!(relative_error(&report) <= 1e-13);
    let (rest, posed) = (folder.points("cage.obj"), folder.points("moved.obj"));
    assert!(posed[7].distance(rest[7] + DVec3::new(0.2, 0.4, 0.6)) <= 1e-12);
    assert_eq!(posed[2..7], rest[2..7]);
    folder.write("moves.param", "0 1 1\n8 0.2 0.4 0.6\n");
    let ran = folder.isochor("deform shape:ball -o no.ply --cage cage.obj:posed=\"moves.param\"");
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    let ran = folder.isochor("deform shape:ball -o no.ply --cage cage.obj --pin k=0 --stretch z=0.8");
    assert!(ran.code == Some(2) && ran.stderr.contains("vertices of a cage"), "{}", ran.stderr);
    let ran = folder.isochor("deform shape:ball -o no.ply --cage cage.obj:posed=\"slid.ply\"");
    assert!(ran.code == Some(2) && ran.stderr.contains("must correspond in order"), "{}", ran.stderr);
    let ran = folder.isochor("deform shape:ball -o cage.obj --cage cage.obj:posed=\"posed.obj\"");
    assert!(ran.code == Some(2) && ran.stderr.contains("would overwrite the cage"), "{}", ran.stderr);
}

#[test]
fn completions_name_the_commands() {
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish"] {
        let text = folder.isochor(&format!("completions {shell}")).succeeded().stdout;
        for command in ["demo", "info", "deform", "cage", "bench", "completions", "man"] {
            assert!(text.contains(command), "{shell}: no {command}");
        }
        assert!(text.contains("lattice-file") && text.contains("save-controls"), "{shell}");
    }
    assert_eq!(folder.isochor("completions tcl").code, Some(2));
}

#[test]
fn manual_pages_name_the_commands() {
    let folder = Folder::new();
    let page = folder.isochor("man").succeeded().stdout;
    assert!(page.contains(".TH isochor 1"), "{page}");
    folder.isochor("man pages").succeeded();
    for command in ["demo", "info", "deform", "cage", "bench", "completions", "man"] {
        assert!(page.contains(command), "no {command} in {page}");
        let page = String::from_utf8(folder.bytes(&format!("pages/isochor-{command}.1"))).unwrap();
        assert!(page.contains(".TH isochor\\-") || page.contains(".TH isochor-"), "{page}");
    }
    let deform = String::from_utf8(folder.bytes("pages/isochor-deform.1")).unwrap();
    assert!(deform.contains("lattice") && deform.contains("Exit codes"), "{deform}");
    assert!(folder.path("pages/isochor.1").is_file());
}

// What is printed

#[test]
fn info_tells_the_health_of_a_model() {
    let folder = Folder::new();
    let text = folder.isochor("info ring.ply").succeeded();
    for word in ["ring.ply", "preserved exactly", "genus", "4608"] {
        assert!(text.stdout.contains(word) || text.stderr.contains(word), "no {word}");
    }
    let health = folder.isochor("info --json ring.ply").succeeded().json();
    assert_has(
        &health,
        &[
            "format",
            "vertices",
            "faces",
            "triangles",
            "components",
            "boundary_edges",
            "boundary_loops",
            "nonmanifold_edges",
            "closed",
            "oriented",
            "balanced",
            "zero_area_faces",
            "unused_vertices",
            "coincident_vertices",
            "genus",
            "bounds",
            "area",
            "volume",
            "roles",
            "verdict",
            "warnings",
        ],
    );
    assert_eq!((&health["format"], &health["genus"], &health["verdict"]), (&"ply".into(), &1.into(), &"ok".into()));
    assert_eq!((&health["vertices"], &health["triangles"]), (&4608.into(), &9216.into()));
    let expected = volume(&shapes::uv_torus(1.0, 0.3, 96, 48));
    assert!((health["volume"]["total"].as_f64().unwrap() / expected - 1.0).abs() <= 1e-15);
    assert_eq!(health["volume"]["components"].as_array().unwrap().len(), 1);

    let open = folder.isochor("info --json open.obj").succeeded().json();
    assert_eq!((&open["verdict"], &open["boundary_edges"]), (&"capped".into(), &4.into()));
    assert!(open["warnings"][0].as_str().unwrap().contains("open"), "{open}");
}

/// Cubes of side 1 in a row, 2 apart; those of the given numbers are wound inwards.
fn cubes_in_a_row(count: usize, inward: &[usize]) -> Mesh {
    let cube = shapes::cube(1);
    let mut points = Vec::new();
    let mut faces = Faces::new();
    for k in 0..count {
        let first = points.len() as u32;
        points.extend(cube.points().iter().map(|p| *p + 2.0 * k as f64 * DVec3::X));
        for face in cube.faces().iter() {
            let mut corners: Vec<u32> = face.iter().map(|v| v + first).collect();
            if inward.contains(&k) {
                corners.reverse();
            }
            faces.push(&corners);
        }
    }
    Mesh::new(points, faces).unwrap()
}

#[test]
fn info_lists_components_and_which_is_a_cavity_of_which() {
    let folder = Folder::new();
    let write = |name: &str, mesh: &Mesh| {
        folder.write(name, Document::from_mesh(mesh, Format::Ply, NumberType::F64).unwrap().bytes());
    };
    let bottle = shapes::hollow_bottle(24, 30, 0.1);
    write("hollow.ply", &bottle);
    let text = folder.isochor("info hollow.ply").succeeded().stdout;
    for line in ["shell with cavity 1: capacity ", ", material ", "component 1: cavity of component 0, capacity "] {
        assert!(text.contains(line), "{text}");
    }
    let health = folder.isochor("info --json hollow.ply").succeeded().json();
    let [shell, cavity] = &health["roles"].as_array().unwrap()[..] else { panic!("{health}") };
    assert_eq!((&shell["role"], &shell["outer"], &shell["cavities"]), (&"shell".into(), &0.into(), &vec![1].into()));
    assert_eq!((&cavity["role"], &cavity["of"], &cavity["capacity"]), (&"cavity".into(), &0.into(), &Value::Null));
    let [outer, inner] = [shell, cavity].map(|component| component["volume"].as_f64().unwrap());
    assert!(outer > 0.0 && inner < 0.0 && shell["capacity"] == -inner && shell["material"] == outer + inner);
    assert!((outer + inner - volume(&bottle)).abs() <= 1e-15);

    // Of many components some are listed, in JSON all of them.
    write("many.ply", &cubes_in_a_row(1000, &[3]));
    let text = folder.isochor("info many.ply").succeeded().stdout;
    assert!(text.contains("\n  … and 990 more; --json lists all\n"), "{text}");
    assert!(text.contains("\n  component 3: volume -1.000000000000, wound inwards, inside nothing\n"), "{text}");
    assert!(
        text.contains("\n  component 9: volume 1.000000000000, solid\n") && !text.contains("component 10"),
        "{text}"
    );
    let health = folder.isochor("info --json many.ply").succeeded().json();
    let roles: Vec<&Value> = health["roles"].as_array().unwrap().iter().map(|component| &component["role"]).collect();
    assert_eq!((roles.len(), roles[3], roles[999]), (1000, &"inward".into(), &"solid".into()));

    // One component is the model, and of a model without volume there is nothing to say.
    let text = folder.isochor("info ring.ply").succeeded().stdout;
    assert!(!text.contains("component 0"), "{text}");
    assert_eq!(folder.isochor("info --json ring.ply").succeeded().json()["roles"][0]["role"], "solid");
    folder.write("points.obj", "v 0 0 0\n");
    assert_eq!(folder.isochor("info --json points.obj").succeeded().json()["roles"], Value::Array(Vec::new()));
}

#[test]
fn a_report_has_the_fields_that_programs_rely_on() {
    let folder = Folder::new();
    let ran = folder.isochor("deform ball.ply -o out.ply --twist z=90 --json").succeeded();
    let report = ran.json();
    assert_has(&report, &["version", "model", "volume", "correction", "folds", "timings_ms", "warnings"]);
    assert_has(&report["model"], &["format", "vertices", "genus", "verdict", "volume"]);
    let row = ["rest", "posed", "target", "final", "written", "relative_error"];
    assert_has(&report["volume"], &row);
    assert_has(&report["volume"], &["components", "parts"]);
    assert_has(&report["volume"]["components"][0], &row);
    assert_has(
        &report["correction"],
        &[
            "method",
            "objective",
            "status",
            "iterations",
            "max_displacement",
            "max_displacement_relative",
            "rms_displacement",
            "rms_displacement_relative",
        ],
    );
    assert!(!keys(&report["timings_ms"]).is_empty());
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert!(ran.stderr.contains("wrote out.ply"), "people are told as well: {}", ran.stderr);
    let extent = 2.0; // of the unit ball
    let displacement = |key: &str| report["correction"][key].as_f64().unwrap();
    assert!((displacement("max_displacement") / extent / displacement("max_displacement_relative") - 1.0).abs() < 1e-9);
}

#[test]
fn quiet_prints_nothing() {
    let folder = Folder::new();
    for line in [
        "deform ball.ply -o out.ply --twist z=90 --quiet",
        "-q deform open.obj -o out.obj --stretch z=0.5",
        "demo --quiet stories",
    ] {
        let ran = folder.isochor(line).succeeded();
        assert_eq!((ran.stdout.as_str(), ran.stderr.as_str()), ("", ""), "{line}");
    }
    let failed = folder.isochor("deform nowhere.ply -o out.ply --quiet");
    assert_eq!(failed.stdout, "");
    assert!(failed.stderr.starts_with("error: "), "errors are told nevertheless: {}", failed.stderr);
    let failed = folder.isochor("deform nowhere.ply -o out.ply --quiet --json");
    assert_eq!((failed.stderr.as_str(), failed.code), ("", Some(2)), "once is enough");
    assert_eq!(failed.json()["error"]["code"], "file");
}

#[test]
fn quiet_info_prints_nothing_but_json_that_is_asked_for() {
    let folder = Folder::new();
    let ran = folder.isochor("info --quiet --json ball.ply").succeeded();
    assert_eq!((&ran.json()["verdict"], ran.stderr.as_str()), (&"ok".into(), ""));
    let ran = folder.isochor("info --quiet ball.ply").succeeded();
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str()), ("", ""));
}

#[test]
fn output_that_nobody_reads_does_not_crash_the_command() {
    let folder = Folder::new();
    for line in
        ["info ball.ply", "info --json ball.ply", "deform --json ball.ply -o out.ply", "man", "completions bash"]
    {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let child = folder.command().args(line.split(' ')).stdout(writer).stderr(Stdio::piped()).spawn().unwrap();
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(!stderr.contains("panicked") && output.status.code() != Some(101), "{line}: {stderr}");
    }
}

// Flags

/// What all flags below are added to, and compared with.
const TWIST: &str = "cube.obj --twist z=90";

#[test]
fn flags_change_the_result() {
    let folder = Folder::new();
    folder.report(&format!("{TWIST} -o base.obj"));
    let mut results = vec![("", folder.bytes("base.obj"))];
    for flags in [
        "--lattice 5",
        "--lattice 4x5x6",
        "--basis bernstein",
        "--degree 2",
        "--degree 1,2,3",
        "--knots uniform",
        "--margin 0.25",
        "--twist x=10",
        "--bend z=45",
        "--bend z=45,-x",
        "--taper z=0.5",
        "--stretch z=0.5",
        "--rotate x=30",
        "--scale 1.2",
        "--scale 1,1,-2",
        "--move k=5:0,0,-0.4",
        "--move 'i=0,5 k=2:0.1,0,0'",
        "--noise 0.05",
        "--noise 0.05,7",
        "--drag 0:0.1,0.2,0.05",
        "--drag 0:0.1,0.2,0.05 --drag 9:0.5,0.5,0.5",
        "--edit 'twist = { axis = \"z\", degrees = 90, range = [0.5, 1] }'",
        "--preserve x",
        "--preserve xy",
        "--preserve gradient",
        "--preserve xy --method nearest",
        "--preserve xy --method gradient",
        "--method axes",
        "--point 0:0.1,0.2,0.05",
        "--point 0:0.1,0.2,0.05 --point 9:0.5,0.5,0.5",
        "--preserve yx",
        "--preserve free",
        "--preserve xy --shares 1,2",
        "--volume 120%",
        "--volume 0.5",
        "--pin k=0",
        "--pin 'i=0,5 k=2'",
        "--falloff 0:0.3",
        "--mobility auto",
        "--mobility auto --pin k=0",
        "--objective surface",
        "--objective edges",
        "--objective bending",
        "--objective bending --preserve xy",
    ] {
        let report = folder.report(&format!("{TWIST} -o out.obj {flags}"));
        if flags != "--preserve free" {
            assert!(number(&report, "relative_error") <= 1e-13, "{flags}: {report}");
        }
        results.push((flags, folder.bytes("out.obj")));
    }
    for (i, (flags, bytes)) in results.iter().enumerate() {
        for (others, other) in &results[..i] {
            assert!(bytes != other, "\"{flags}\" gives what \"{others}\" gives");
        }
    }
}

#[test]
fn a_preview_is_asked_for_and_says_that_it_is_one() {
    let folder = Folder::new();
    folder.report("ball.ply -o exact.ply --twist z=90 --stretch z=0.6");
    let report = folder.report("ball.ply -o out.ply --twist z=90 --stretch z=0.6 --preview 100");
    assert_eq!(report["correction"]["status"], "preview");
    let error = number(&report, "relative_error");
    assert!(error > 1e-13 && error < 0.05, "{report}");
    assert!((number(&report, "final") / number(&report, "target") - 1.0).abs() <= 1.0001 * error);
    let note = report["warnings"].as_array().unwrap().iter().find(|w| w.as_str().unwrap().contains("approximate"));
    assert!(note.is_some(), "{report}");
    assert!(folder.bytes("out.ply") != folder.bytes("exact.ply"));
    let ran = folder.isochor("deform ball.ply -o out.ply --twist z=90 --stretch z=0.6 --preview 100");
    assert_eq!(ran.code, Some(0));
    assert!(
        ran.stderr.contains("the volume is approximate") && ran.stderr.contains("nearest, preview"),
        "{}",
        ran.stderr
    );

    folder.write("preview.toml", "[preserve]\npreview = 100\n");
    folder.report("ball.ply -o job.ply --twist z=90 --stretch z=0.6 --job preview.toml");
    assert!(folder.bytes("job.ply") == folder.bytes("out.ply"));
}

#[test]
fn defaults_spelled_out_change_nothing() {
    let folder = Folder::new();
    folder.report(&format!("{TWIST} --output base.obj"));
    for flags in [
        "--lattice 6x6x6 --basis bspline --degree 3 --knots clamped --margin 0",
        "--outside keep",
        "--outside extend",
        "--preserve nearest",
        "--method nearest",
        "--volume rest",
        "--volume 100%",
        "--mobility uniform",
        "--objective controls",
        "--open cap",
        "--open refuse",
        "--precision file",
        "--precision f64",
        "--threads 3",
    ] {
        folder.report(&format!("{TWIST} -o out.obj {flags}"));
        assert!(folder.bytes("out.obj") == folder.bytes("base.obj"), "{flags}");
    }
}

#[test]
fn volumes_come_out_as_asked_for() {
    let folder = Folder::new();
    // The unit cube at half its height holds 0.5.
    for (wanted, expected) in [
        ("rest", 1.0),
        ("120%", 1.2),
        ("0.25", 0.25),
        ("95%..105%", 0.95),
        ("10%..40%", 0.4),
        ("40%..60%", 0.5),
        ("..0.3", 0.3),
        ("0.7..", 0.7),
        ("each", 1.0),
        ("each=120%", 1.2),
        ("free", 0.5),
    ] {
        let report = folder.report(&format!("cube.obj -o out.obj --stretch z=0.5 --volume {wanted}"));
        assert!((number(&report, "posed") - 0.5).abs() <= 1e-15, "{wanted}");
        for key in ["final", "written"] {
            assert!((number(&report, key) / expected - 1.0).abs() <= 1e-13, "{wanted}: {report}");
        }
        assert!((volume(folder.document("out.obj").mesh()) / expected - 1.0).abs() <= 1e-13, "{wanted}");
        let status = if wanted == "free" {
            "not-asked"
        } else if expected == 0.5 {
            "already-met"
        } else {
            "exact"
        };
        assert_eq!(report["correction"]["status"], status, "{wanted}");
    }
    folder.report("cube.obj -o free.obj --stretch z=0.5 --preserve free");
    folder.report("cube.obj -o asked.obj --stretch z=0.5 --volume free");
    assert_eq!(folder.bytes("free.obj"), folder.bytes("asked.obj"));
}

#[test]
fn a_volume_can_be_asked_for_without_an_edit() {
    let folder = Folder::new();
    let report = folder.report("ball.ply -o out.ply --volume 50%");
    assert!((number(&report, "written") / number(&report, "rest") - 0.5).abs() <= 1e-13);
}

#[test]
fn axes_that_are_not_named_keep_their_coordinates() {
    let folder = Folder::new();
    folder.report("ball.ply -o free.ply --twist z=90 --stretch y=0.5 --preserve free");
    folder.report("ball.ply -o out.ply --twist z=90 --stretch y=0.5 --preserve xy");
    for (free, out) in folder.points("free.ply").iter().zip(folder.points("out.ply")) {
        assert_eq!(free.z, out.z);
    }
    folder.report("ball.ply -o shares.ply --twist z=90 --stretch y=0.5 --preserve xy --shares 0,3");
    for (free, out) in folder.points("free.ply").iter().zip(folder.points("shares.ply")) {
        assert_eq!((free.x, free.z), (out.x, out.z));
    }
}

#[test]
fn pinned_control_points_stay() {
    let folder = Folder::new();
    folder.report("cube.obj -o out.obj --move k=5:0,0,0.5 --pin k=0 --save-controls controls.json");
    let (before, after) = (folder.points("cube.obj"), folder.points("out.obj"));
    let bottom = before.iter().zip(&after).filter(|(before, _)| before.z == 0.0);
    assert!(bottom.clone().count() > 1000 && bottom.clone().all(|(before, after)| before == after));
    let controls = folder.json("controls.json");
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        let [rest, posed] = ["rest", "posed"].map(|key| &controls[key][i][j]);
        assert_eq!(rest[0], posed[0]);
        assert_ne!(rest[5], posed[5]);
    }
}

#[test]
fn falloff_corrects_near_its_vertex() {
    let folder = Folder::new();
    folder.report("cube.obj -o free.obj --stretch z=0.9 --preserve free");
    folder.report("cube.obj -o out.obj --stretch z=0.9 --falloff 0:0.1 --volume 92%");
    let rest = folder.points("cube.obj");
    let moved: Vec<f64> =
        folder.points("free.obj").iter().zip(folder.points("out.obj")).map(|(a, b)| a.distance(b)).collect();
    let most = |near: bool| {
        let vertices = (0..rest.len()).filter(|&v| (rest[v].distance(rest[0]) < 0.5) == near);
        vertices.map(|v| moved[v]).fold(0.0, f64::max)
    };
    assert!(most(true) > 10.0 * most(false), "{} and {}", most(true), most(false));
}

#[test]
fn vertices_outside_are_kept_or_carried_along() {
    let folder = Folder::new();
    // The lattice reaches to ±0.8 of the unit ball.
    let report = folder.report("ball.ply -o kept.ply --margin -0.1 --rotate z=20 --preserve free");
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("stay where they are"), "{warnings}");
    folder.report("ball.ply -o carried.ply --margin=-0.1 --rotate z=20 --outside extend --preserve free");
    let (rest, kept, carried) = (folder.points("ball.ply"), folder.points("kept.ply"), folder.points("carried.ply"));
    let mut outside = 0;
    for v in 0..rest.len() {
        let is_outside = rest[v].abs().max_element() > 0.8 + 1e-8;
        outside += usize::from(is_outside);
        assert_eq!(kept[v] == rest[v], is_outside, "vertex {v} at {}", rest[v]);
        let turned = glam::DMat3::from_rotation_z(20f64.to_radians()) * rest[v];
        assert!(carried[v].distance(turned) <= 1e-14, "vertex {v} at {}", rest[v]);
    }
    assert!(outside > 100);
    let report = folder.report("ball.ply -o exact.ply --margin -0.1 --stretch z=0.7");
    assert!(number(&report, "relative_error") <= 1e-13);
}

#[test]
fn edits_act_in_the_order_in_which_they_are_typed() {
    let folder = Folder::new();
    folder.report("cube.obj -o ab.obj --stretch z=0.5 --rotate x=30 --preserve free");
    folder.report("cube.obj -o ba.obj --rotate x=30 --stretch z=0.5 --preserve free");
    assert!(farthest(&folder.points("ab.obj"), &folder.points("ba.obj")) > 0.01);

    folder.report(
        "cube.obj -o line.obj --stretch z=0.5 --rotate x=30 --move k=0:0,0,-0.1 --stretch z=1.5 --noise 0.01,3",
    );
    folder.write(
        "job.toml",
        r#"model = "cube.obj"
output = "job.obj"
[[edit]]
stretch = { axis = "z", scale = 0.5 }
[[edit]]
rotate = { axis = "x", degrees = 30 }
[[edit]]
move = { nodes = { k = 0 }, by = [0, 0, -0.1], unit = "extent" }
[[edit]]
stretch = { axis = "z", scale = 1.5 }
[[edit]]
noise = { amplitude = 0.01, seed = 3 }
"#,
    );
    folder.report("--job job.toml");
    assert!(folder.bytes("line.obj") == folder.bytes("job.obj"));
}

#[test]
fn dragged_vertices_stay_where_they_were_put() {
    let folder = Folder::new();
    let rest = folder.points("cube.obj");
    let (place, later) = (rest[9] + DVec3::new(0.2, -0.1, 0.3), rest[9] + DVec3::new(-0.2, 0.0, 0.1));
    let drag = |p: DVec3| format!("--drag 9:{},{},{}", p.x, p.y, p.z);
    for (flags, end) in [
        (format!("{} --twist z=40", drag(place)), place),
        (format!("--twist z=40 {}", drag(place)), place),
        (format!("{} --stretch z=0.5 {} --preserve xyz", drag(place), drag(later)), later),
        (format!("--twist z=40 {} --point 9:{},{},{}", drag(place), later.x, later.y, later.z), later),
        (format!("--twist z=40 {} --preserve free", drag(place)), place),
    ] {
        let report = folder.report(&format!("cube.obj -o out.obj {flags}"));
        assert!(folder.points("out.obj")[9].distance(end) <= 1e-12, "{flags}");
        if !flags.contains("free") {
            assert!((volume(folder.document("out.obj").mesh()) - 1.0).abs() <= 1e-13, "{flags}: {report}");
            assert!(report["correction"]["point_error"].as_f64().unwrap() <= 1e-12, "{flags}");
        }
    }
    // The order of edits counts where nothing holds afterwards.
    folder.report(&format!("cube.obj -o ab.obj --preserve free {} --stretch z=0.5", drag(place)));
    folder.report(&format!("cube.obj -o ba.obj --preserve free --stretch z=0.5 {}", drag(place)));
    assert!(farthest(&folder.points("ab.obj"), &folder.points("ba.obj")) > 0.01);
}

#[test]
fn automatic_mobility_leaves_what_lost_nothing_alone() {
    let folder = Folder::new();
    let report = folder.report("cube.obj -o out.obj --move k=5:0,0,-0.4 --mobility auto --save-controls out.json");
    assert!(number(&report, "relative_error") <= 1e-13 && number(&report, "posed") < 0.9, "{report}");
    // Of three cubic cells the uppermost alone was deformed; it has layers 2 to 5.
    let lattice = folder.json("out.json");
    let mut layers = [0; 6];
    for i in 0..6 {
        for j in 0..6 {
            for (k, moved) in layers.iter_mut().enumerate() {
                *moved += usize::from(lattice["rest"][i][j][k] != lattice["posed"][i][j][k]);
            }
        }
    }
    // Control points inside move no vertex of the cube's surface.
    assert_eq!(layers, [0, 0, 20, 20, 20, 36]);
    let bottom = folder.points("cube.obj").into_iter().zip(folder.points("out.obj")).filter(|(rest, _)| rest.z == 0.0);
    assert!(bottom.clone().count() > 9 && bottom.clone().all(|(rest, out)| rest == out));
}

#[test]
fn the_report_names_the_objective() {
    let folder = Folder::new();
    for objective in ["controls", "surface", "edges", "bending"] {
        let report = folder.report(&format!("{TWIST} -o out.obj --objective {objective}"));
        assert_eq!(report["correction"]["objective"], objective);
    }
    let report = folder.report(&format!("{TWIST} -o out.obj --objective edges --preserve free"));
    assert_eq!(report["correction"]["objective"], "none");
}

/// Volumes of the components of a model in the folder, cavities negative.
fn component_volumes(folder: &Folder, name: &str) -> Vec<f64> {
    let document = folder.document(name);
    Health::of(document.mesh(), &topology(document.mesh()), &Source::of(document.mesh())).0.volume.unwrap().components
}

#[test]
fn several_volumes_come_out_as_asked_for() {
    let folder = Folder::new();
    let rest = component_volumes(&folder, "flask.ply");
    let [outer, cavity] = rest[..] else { panic!("{rest:?}") };
    let place = folder.points("flask.ply")[5000] + DVec3::new(0.05, -0.02, 0.1);
    let at = format!("5000:{},{},{}", place.x, place.y, place.z);
    for (wanted, outer, cavity) in [
        ("--volume each", outer, cavity),
        ("--volume each=110%", 1.1 * outer, 1.1 * cavity),
        ("--volume material=100%,capacity=110%", outer - 0.1 * cavity, 1.1 * cavity),
        ("--part 1=3.5 --part 0,1=90%", 3.5 + 0.9 * (outer + cavity), -3.5),
    ] {
        for flags in [
            "",
            "--pin k=0",
            "--preserve xyz",
            "--method gradient",
            "--objective edges",
            "--mobility auto",
            &format!("--point {at}"),
            &format!("--drag {at} --pin k=0 --preserve gradient"),
        ] {
            let line = format!("flask.ply -o out.ply --twist z=40 --taper z=0.7 {flags} {wanted}");
            let report = folder.report(&line);
            let found = component_volumes(&folder, "out.ply");
            assert!((found[0] / outer - 1.0).abs() <= 1e-13 && (found[1] / cavity - 1.0).abs() <= 1e-13, "{line}");
            assert!(relative_error(&report) <= 1e-13, "{line}: {report}");
            let parts = report["volume"]["parts"].as_array().unwrap();
            assert_eq!(parts.len(), 2, "{line}");
            assert!(
                parts.iter().all(|part| part["target"].as_f64().unwrap() > 0.0),
                "cavities count positive: {report}"
            );
            if flags.contains("5000") {
                assert!(folder.points("out.ply")[5000].distance(place) <= 3e-12, "{line}");
            }
        }
    }
    // Capacity alone leaves the material to itself.
    let report = folder.report("flask.ply -o out.ply --taper z=0.7 --volume capacity=120%");
    assert!((component_volumes(&folder, "out.ply")[1] / cavity - 1.2).abs() <= 1e-13);
    assert_eq!(report["volume"]["parts"].as_array().unwrap().len(), 1);
}

#[test]
fn every_body_of_many_keeps_its_own_volume() {
    let folder = Folder::new();
    let rest = component_volumes(&folder, "chain.ply");
    assert_eq!(rest.len(), 5);
    for (flags, factors) in [
        ("--volume each", [1.0; 5]),
        ("--volume each=80% --pin i=0", [0.8; 5]),
        ("--part 0=110% --part 2=100% --part 4=90%", [1.1, 0.0, 1.0, 0.0, 0.9]),
        ("--part 0,1=105% --part 1=100% --part 2,3,4=100% --part 3=100% --part 4=100%", [1.1, 1.0, 1.0, 1.0, 1.0]),
    ] {
        let line = format!("chain.ply -o out.ply --bend x=60,z --lattice 10x6x6 {flags}");
        let report = folder.report(&line);
        assert!(relative_error(&report) <= 1e-13, "{line}");
        let found = component_volumes(&folder, "out.ply");
        for c in (0..5).filter(|&c| factors[c] > 0.0) {
            assert!((found[c] / rest[c] / factors[c] - 1.0).abs() <= 1e-13, "{line}: component {c}");
        }
    }
}

#[test]
fn several_volumes_are_told_to_people_with_capacities_positive() {
    let folder = Folder::new();
    let told = |flags: &str| {
        let line = format!("deform flask.ply -o out.ply --taper z=0.7 {flags}");
        folder.isochor(&line).succeeded().stderr
    };
    let text = told("--volume material=100%,capacity=110%");
    assert!(text.contains("\nmaterial: posed 0.") && text.contains("\ncavity 1: posed "), "{text}");
    assert!(text.contains("(+10.000 %), relative error "), "{text}");
    let text = told("--volume each");
    assert!(text.contains("\ncomponent 0: posed ") && text.contains("\ncavity 1: posed "), "{text}");
    let info = folder.isochor("info flask.ply").succeeded().stdout;
    assert!(info.contains("\n  component 1: cavity of component 0, capacity 3.340758968533\n"), "{info}");
    assert!(!text.contains(" -3.") && !info.contains("component 1: volume"), "{text}");
}

#[test]
fn threads_do_not_change_a_byte() {
    let folder = Folder::new();
    for threads in [1, 2] {
        for (name, extension) in STORIES {
            let files = format!("-o {name}-{threads}.{extension} --save-controls {name}-{threads}.json");
            folder.report(&format!("{name}.{extension} {files} --twist z=70 --bend x=30 --threads {threads}"));
        }
    }
    for (name, extension) in STORIES {
        for extension in [extension, "json"] {
            let [one, two] = [1, 2].map(|threads| folder.bytes(&format!("{name}-{threads}.{extension}")));
            assert!(one == two, "{name}.{extension}");
        }
    }
}

// Jobs

#[test]
fn paths_of_a_job_are_relative_to_its_folder() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sub")).unwrap();
    folder.write(
        "sub/job.toml",
        "model = \"../cube.obj\"\noutput = \"out.obj\"\nreport = \"report.json\"\nsave_controls = \"controls.json\"\n\
         [[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n",
    );
    folder.isochor("deform --job sub/job.toml").succeeded();
    folder.report(&format!("{TWIST} -o out.obj"));
    assert!(folder.bytes("sub/out.obj") == folder.bytes("out.obj"));
    assert!(number(&folder.json("sub/report.json"), "relative_error") <= 1e-13);
    assert_eq!(folder.json("sub/controls.json")["kind"], "lattice");

    folder.write(
        "sub/again.json",
        r#"{ "model": "../cube.obj", "output": "again.obj", "lattice": { "file": "controls.json" },
             "preserve": { "volume": "free" } }"#,
    );
    folder.isochor("deform --job sub/again.json").succeeded();
    assert!(farthest(&folder.points("sub/again.obj"), &folder.points("out.obj")) <= 1e-14);
    assert_eq!(std::fs::read_dir(folder.path("sub")).unwrap().count(), 6);
}

#[test]
fn flags_override_a_job_and_add_to_its_edits() {
    let folder = Folder::new();
    folder.write(
        "job.toml",
        "model = \"ball.ply\"\noutput = \"never.ply\"\nreport = \"never.json\"\n[lattice]\nsize = 4\ndegree = 2\n\
         [[edit]]\nstretch = { axis = \"z\", scale = 0.7 }\n[preserve]\nvolume = \"150%\"\naxes = \"xy\"\n",
    );
    folder.report(
        "cube.obj --job job.toml -o job.obj --report job-report.json --lattice 5 --twist z=45 --volume 80% \
         --preserve nearest",
    );
    folder.report("cube.obj -o flags.obj --lattice 5 --degree 2 --stretch z=0.7 --twist z=45 --volume 80%");
    assert!(folder.bytes("job.obj") == folder.bytes("flags.obj"));
    assert!(folder.path("job-report.json").exists());
    assert!(!folder.path("never.ply").exists() && !folder.path("never.json").exists());
}

// Built-in shapes

#[test]
fn shapes_are_models_by_name() {
    let folder = Folder::new();
    let report = folder.report("shape:cube?n=5 -o cube-out.obj --twist z=90");
    assert_eq!((&report["model"]["format"], &report["model"]["vertices"]), (&"shape".into(), &152.into()));
    assert!(relative_error(&report) <= 1e-13 && number(&report, "written") == number(&report, "final"), "{report}");
    assert_eq!(report["warnings"], Value::Array(Vec::new()));
    // The same as from a file with 64-bit floats, whatever format it is written in.
    for (name, format) in [("five.obj", Format::Obj), ("five.ply", Format::Ply)] {
        folder.write(name, Document::from_mesh(&shapes::cube(5), format, NumberType::F64).unwrap().bytes());
        let extension = format.name();
        folder.report(&format!("{name} -o file.{extension} --twist z=90"));
        folder.report(&format!("shape:cube?n=5 -o shape.{extension} --twist z=90"));
        assert!(folder.bytes(&format!("file.{extension}")) == folder.bytes(&format!("shape.{extension}")), "{name}");
    }
    // STL has 32-bit floats and no shared corners: vertices are those of the shape all the same.
    let report = folder.report("shape:ears -o ears.stl --drag 3:0,1.2,1.8");
    assert_eq!((&report["model"]["vertices"], &report["warnings"]), (&10242.into(), &Value::Array(Vec::new())));
    assert!((number(&report, "written") / number(&report, "final") - 1.0).abs() < 1e-6);
    let error = folder.isochor("deform --json shape:ball -o b.stl --precision f64 --twist z=9");
    assert_eq!((error.code, folder.path("b.stl").exists()), (Some(2), false));
    // Without anything to do it is written as it is.
    folder.report("shape:ring -o ring-out.ply");
    assert_eq!(folder.points("ring-out.ply"), shapes::uv_torus(1.0, 0.3, 96, 48).points());
}

#[test]
fn every_shape_is_in_the_help_and_well() {
    let folder = Folder::new();
    let help = folder.isochor("help").succeeded().stdout;
    for BuiltIn { name, range, usual, .. } in BuiltIn::ALL {
        assert!(help.contains(&format!("\n  shape:{name}?n={usual} ")), "{help}");
        let usual = folder.isochor(&format!("info --json shape:{name}")).succeeded().json();
        let coarse = folder.isochor(&format!("info --json shape:{name}?n={}", range.start())).succeeded().json();
        for health in [&usual, &coarse] {
            assert_eq!((&health["verdict"], &health["format"]), (&"ok".into(), &"shape".into()), "{name}");
            assert!(
                health["volume"]["total"].as_f64().unwrap() > 0.0 && health["warnings"] == Value::Array(Vec::new())
            );
        }
        assert!(usual["vertices"].as_u64() > coarse["vertices"].as_u64(), "{name}");
    }
}

#[test]
fn names_that_are_no_shapes_are_named() {
    let folder = Folder::new();
    for (name, fragment) in [
        ("shape:cub", "did you mean shape:cube?"),
        ("shape:", "no built-in shape \\\"\\\""),
        ("shape:Ball", "did you mean shape:ball?"),
        ("shape:cube?n=0", "n=1 to n=800"),
        ("shape:ball?n=10", "n=0 to n=9"),
        ("shape:cube?n=-1", "n=1 to n=800"),
        ("shape:cube?m=3", "\\\"m=3\\\" does not follow cube"),
        ("shape:cube?", "leave the number out"),
        ("shape:cube?n=99999999999999999999", "n=1 to n=800"),
    ] {
        for command in ["info --json", "deform -o never.ply --json"] {
            let ran = folder.isochor(&format!("{command} {name}"));
            assert!(ran.code == Some(2) && ran.stdout.contains(fragment), "{name}: {}", ran.stdout);
            assert_eq!(ran.json()["error"]["where"], name);
        }
    }
    let ran = folder.isochor("deform --json shape:ball --in-place --twist z=9");
    assert!(ran.code == Some(2) && ran.stdout.contains("no file that could be replaced"), "{}", ran.stdout);
    assert!(!folder.path("never.ply").exists());
}

#[test]
fn jobs_name_shapes_and_files_come_before_shapes() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sub")).unwrap();
    let job = "output = \"out.obj\"\n[[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n";
    folder.write("sub/job.toml", format!("model = \"shape:cube?n=2\"\n{job}"));
    assert_eq!(folder.report("--job sub/job.toml")["model"]["vertices"], 26);
    assert!(folder.path("sub/out.obj").exists());
    // Elsewhere such names cannot exist.
    if cfg!(unix) {
        folder.write("shape:cube.obj", OPEN);
        assert_eq!(folder.isochor("info --json shape:cube.obj").succeeded().json()["format"], "obj");
        folder.write("sub/shape:ball.obj", OPEN);
        folder.write("sub/job.toml", format!("model = \"shape:ball.obj\"\n{job}"));
        assert_eq!(folder.report("--job sub/job.toml")["model"]["vertices"], 8);
    }
    // A drive is no shape.
    let drive = folder.isochor("info --json C:\\models\\cube.obj");
    assert!(drive.code == Some(2) && drive.stdout.contains("cannot be read"), "{}", drive.stdout);
}

// Files

#[test]
fn reports_and_controls_are_written_to_files() {
    let folder = Folder::new();
    let printed =
        folder.report("bottle.stl -o out.stl --taper z=0.8 --report report.json --save-controls controls.json");
    assert_eq!(folder.json("report.json"), printed);
    let controls = folder.json("controls.json");
    assert_has(&controls, &["kind", "version", "basis", "degree", "knots", "frame", "rest", "posed"]);
    assert_eq!((&controls["basis"], &controls["degree"]), (&"bspline".into(), &vec![3, 3, 3].into()));
    assert_eq!(controls["posed"][5][5].as_array().unwrap().len(), 6);
}

#[test]
fn saved_controls_give_the_same_vertices_again() {
    let folder = Folder::new();
    for (flags, name) in [
        ("--lattice 5x4x6 --margin 0.1", "clamped"),
        ("--knots uniform --degree 2", "uniform"),
        ("--basis bernstein --lattice 4", "bernstein"),
    ] {
        let controls = format!("{name}.json");
        let edits = "--twist z=120 --bend x=30,z";
        folder.report(&format!("ball.ply -o out.ply {flags} {edits} --save-controls {controls}"));
        folder.report(&format!("ball.ply -o again.ply --lattice-file {controls} --preserve free"));
        let apart = farthest(&folder.points("out.ply"), &folder.points("again.ply"));
        assert!(apart <= 1e-14, "{name}: {apart:e}");
        assert!(farthest(&folder.points("ball.ply"), &folder.points("again.ply")) > 0.1);
    }
    let report = folder.report("ball.ply -o more.ply --lattice-file clamped.json --outside extend --stretch z=0.5");
    assert!(number(&report, "relative_error") <= 1e-13, "edits act on the pose of a file");
}

#[test]
fn a_model_comes_back_byte_for_byte_where_nothing_is_asked() {
    let folder = Folder::new();
    folder.write("odd.obj", "# by hand\r\nv 0 0 0 1\r\nv 1.50 0 0\nv +0 1e0 0\n\no it\nf 1// 2// \\\n3//\n#end");
    folder.write(
        "odd.off",
        "COFF # by hand\r\n3 1 2\n\n0 0 0 255 0 0\r1.50 0 0 255 0 0\n+0 1e0 0 9 9 9 # c\n3 0 1\n2 0.5 0 0\n#end",
    );
    for model in ["ball.ply", "cube.obj", "bottle.stl", "odd.obj", "odd.off"] {
        let copy = format!("copy-{model}");
        folder.report(&format!("{model} -o {copy}"));
        assert!(folder.bytes(model) == folder.bytes(&copy), "{model}");
    }
    folder.report("ball.ply -o lattice.ply --lattice 4");
    assert!(folder.bytes("ball.ply") == folder.bytes("lattice.ply"), "a lattice at rest moves nothing");
}

#[test]
fn off_models_are_examined_deformed_and_divided_along_surfaces() {
    let folder = Folder::new();
    folder.report("shape:cube?n=4 -o cube.off");
    let info = folder.isochor("info --json cube.off").succeeded().json();
    assert_eq!((info["format"].as_str(), info["closed"].as_bool()), (Some("off"), Some(true)), "{info}");
    let head = |name: &str| String::from_utf8(folder.bytes(name)).unwrap().lines().nth(1).unwrap().to_owned();
    let before = head("cube.off");
    let report = folder.report("cube.off --in-place --twist z=90 --preserve gradient");
    assert!(number(&report, "relative_error") <= 1e-13, "{report}");
    assert_eq!(head("cube.off"), before);
    let found = volume(folder.document("cube.off").mesh());
    assert!((found / number(&report, "written") - 1.0).abs() <= 1e-13, "{found}");

    folder.report("shape:plate?n=1 -o plate.off");
    let report = folder.report("plate.off -o arch.off --surface cylinder:radius=0.5,height=2 --grid 24");
    assert!(report["surface"]["edge_points"].as_u64().unwrap() > 0, "{report}");
    let [flat, arch] = ["plate.off", "arch.off"].map(|name| folder.document(name).mesh().faces().len());
    assert!(arch > flat, "{arch} faces of {flat}");
}

#[test]
fn a_model_can_be_replaced_in_place() {
    let folder = Folder::new();
    folder.report("ball.ply -o expected.ply --twist z=90");
    let names = |folder: &Folder| folder.contents().into_keys().collect::<Vec<_>>();
    let before = names(&folder);
    folder.report("ball.ply --in-place --twist z=90");
    assert!(folder.bytes("ball.ply") == folder.bytes("expected.ply"));
    assert_eq!(names(&folder), before, "nothing else is left behind");
}

#[cfg(unix)]
#[test]
fn output_goes_through_a_link_and_keeps_permissions() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = Folder::new();
    std::fs::create_dir(folder.path("far")).unwrap();
    folder.write("far/target.ply", "old");
    std::fs::set_permissions(folder.path("far/target.ply"), std::fs::Permissions::from_mode(0o640)).unwrap();
    symlink("far/target.ply", folder.path("link.ply")).unwrap();
    folder.report("ball.ply -o link.ply --twist z=90");
    assert!(std::fs::symlink_metadata(folder.path("link.ply")).unwrap().is_symlink());
    folder.report("ball.ply -o out.ply --twist z=90");
    assert!(folder.bytes("far/target.ply") == folder.bytes("out.ply"));
    let mode = |name: &str| std::fs::metadata(folder.path(name)).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode("far/target.ply"), 0o640);
    folder.write("new", "");
    assert_eq!(mode("out.ply"), mode("new"), "a new file is as any other");

    symlink("ball.ply", folder.path("same.ply")).unwrap();
    let before = folder.bytes("ball.ply");
    assert_eq!(folder.isochor("deform ball.ply -o same.ply --twist z=90").code, Some(2));
    assert!(folder.bytes("ball.ply") == before, "a link to the model is the model");
}

#[test]
fn conversion_keeps_the_volume() {
    let folder = Folder::new();
    let rest = volume(folder.document("cube.obj").mesh());
    let report = folder.report("cube.obj -o a.ply");
    assert!(report["warnings"].to_string().contains("converted from obj to ply"), "{report}");
    folder.report("a.ply -o b.stl");
    folder.report("b.stl -o c.obj --precision f64");
    folder.report("a.ply -o e.off");
    for (name, tolerance) in [("a.ply", 0.0), ("b.stl", 1e-7), ("c.obj", 1e-7), ("e.off", 0.0)] {
        let found = volume(folder.document(name).mesh());
        assert!((found / rest - 1.0).abs() <= tolerance, "{name}: {found}");
    }
    let report = folder.report("cube.obj -o d.stl --twist z=90 --volume 150%");
    assert!((number(&report, "final") / rest - 1.5).abs() <= 1e-13);
    assert!((number(&report, "written") / rest - 1.5).abs() <= 1e-6);
    let found = volume(folder.document("d.stl").mesh());
    assert!((found / number(&report, "written") - 1.0).abs() <= 1e-13, "{found}");
}

#[test]
fn portable_bits_are_a_flag_and_a_key() {
    // What they are is shown on other processors, in portable.rs.
    let folder = Folder::new();
    let line = "shape:bottle?n=12 -o flag.ply --precision f64 --twist z=90 --portable-bits";
    assert_eq!(folder.report(line)["correction"]["status"], "exact");
    let job = "model = \"shape:bottle?n=12\"\noutput = \"key.ply\"\nprecision = \"f64\"\nportable_bits = true\n\
               [[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n";
    folder.write("portable.toml", job);
    folder.report("--job portable.toml");
    assert!(folder.bytes("flag.ply") == folder.bytes("key.ply"));
}

#[test]
fn precision_f64_writes_what_floats_cannot_hold() {
    let folder = Folder::new();
    let ring = Document::from_mesh(&shapes::uv_torus(1.0, 0.3, 48, 24), Format::Ply, NumberType::F32).unwrap();
    folder.write("float.ply", ring.bytes());
    let error = |report: &Value| (number(report, "written") / number(report, "target") - 1.0).abs();
    let report = folder.report("float.ply -o float-out.ply --twist x=90 --precision file");
    assert!((1e-13..1e-6).contains(&error(&report)), "{report}");
    let report = folder.report("float.ply -o double.ply --twist x=90 --precision f64");
    assert!(error(&report) <= 1e-13, "{report}");
    assert_eq!(folder.document("float-out.ply").number_type(), NumberType::F32);
    let double = folder.document("double.ply");
    assert_eq!(double.number_type(), NumberType::F64);
    assert!((volume(double.mesh()) / number(&report, "written") - 1.0).abs() <= 1e-15);
}

// Surfaces

/// The plate of six faces on a cylinder, with all that can be asked for.
const ARCH: &str = "shape:plate?n=1 -o arch.obj --surface cylinder:radius=0.5,height=2 --grid 24x8 --reach 3 --refine 0.05 \
                    --place at=[0.5,0.4],rotate=90,outside=\"refuse\" --save-surface cylinder.obj --sheet sheet.svg --picture arch.png";

#[test]
fn a_plate_is_laid_along_a_cylinder_and_keeps_its_volume() {
    let folder = Folder::new();
    let report = folder.report(ARCH);
    assert!(
        (number(&report, "final") / 0.05 - 1.0).abs() <= 1e-13 && (number(&report, "posed") / 0.05 - 1.0).abs() > 0.01
    );
    assert_eq!(report["correction"]["method"], "height");
    let surface = &report["surface"];
    assert_eq!(surface["cells"], serde_json::json!([24, 8]));
    let arch = folder.document("arch.obj");
    assert_eq!(arch.mesh().points().len() as u64, 8 + surface["edge_points"].as_u64().unwrap());
    assert!(topology(arch.mesh()).is_closed() && (volume(arch.mesh()) / 0.05 - 1.0).abs() <= 1e-13);
    let cylinder = folder.document("cylinder.obj");
    assert!(cylinder.mesh().points().iter().all(|p| (p.truncate().length() - 0.5).abs() < 1e-15));
    let svg = String::from_utf8(folder.bytes("sheet.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.matches("<circle").count() > 20);
    assert!(folder.bytes("arch.png").starts_with(b"\x89PNG"));
    // As a job, through a lattice, and in a file of another format.
    let job = "model = \"shape:plate?n=1\"\noutput = \"job.ply\"\n[surface]\nkind = \"cylinder\"\nradius = 0.5\nheight = 2\n\
               [preserve]\nmethod = \"nearest\"\n";
    folder.write("arch.toml", job);
    let report = folder.report("--job arch.toml --precision f64");
    assert_eq!(report["correction"]["method"], "nearest");
    assert!((number(&report, "written") / 0.05 - 1.0).abs() <= 1e-13);
    assert!(folder.report("--job arch.toml -o flat.stl --refine off --method height")["surface"]["edge_points"] == 0);
}

#[test]
fn a_file_keeps_what_it_holds_along_a_surface() {
    let folder = Folder::new();
    folder.write("p.obj", "mtllib a.mtl\no plate\nv 0 0 0\nv 3 0 0\nv 3 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3 4/4\n");
    folder.report("p.obj -o q.obj --surface cylinder:radius=1,height=2 --volume free");
    let text = String::from_utf8(folder.bytes("q.obj")).unwrap();
    assert!(text.starts_with("mtllib a.mtl\no plate\n") && text.contains("usemtl red\nf "), "{text}");
    assert!(text.matches("\nvt ").count() > 8 && text.matches("\nf ").count() > 8);
}

#[test]
fn a_patch_of_a_file_is_a_surface() {
    let folder = Folder::new();
    let rows: Vec<Value> =
        (0..4).map(|i| (0..4).map(|j| serde_json::json!([i, j, 0.2 * f64::from(i * j)])).collect()).collect();
    let patch = serde_json::json!({ "kind": "patch", "version": 1, "degree": [3, 3], "controls": rows });
    folder.write("patch.json", patch.to_string());
    let report =
        folder.report("shape:dolphin?n=12 -o out.ply --surface patch.json --place scale=0.6,height=\"middle\"");
    assert!(relative_error(&report) <= 1e-13);
    let missing = folder.isochor("deform shape:cube -o c.ply --surface patch.json:patch=7 --json");
    assert_eq!((missing.code, missing.json()["error"]["code"].as_str()), (Some(2), Some("surface-file")));
    assert!(!folder.path("c.ply").exists());
}

#[test]
fn surfaces_that_cannot_be_are_refused() {
    let folder = Folder::new();
    for (line, code, place) in [
        ("--surface cylinder:radius=0.1,height=2", 1, "surface.place"),
        ("--surface cylinder:radius=-1,height=2", 2, "surface"),
        ("--surface cylindre:radius=1", 2, "--surface"),
        ("--surface cylinder:radios=1", 2, "--surface"),
        ("--surface torus:major=4,minor=1,angles=0..90", 2, "--surface"),
        ("--grid 4", 2, "--grid"),
        ("--surface cylinder:radius=1,height=2 --grid 4x", 2, "--grid"),
        ("--surface cylinder:radius=1,height=2 --refine much", 2, "--refine"),
        ("--surface cylinder:radius=1,height=2 --place rotat=4", 2, "--place"),
        ("--surface cylinder:radius=1,height=2 --sheet sheet.png", 2, "sheet.png"),
        ("--method height", 2, "preserve.method"),
    ] {
        let ran = folder.isochor(&format!("deform shape:plate?n=1 -o out.ply {line} --json"));
        assert_eq!(ran.code, Some(code), "{line}: {}", ran.stdout);
        assert_eq!(ran.json()["error"]["where"], place, "{line}");
        assert!(!folder.path("out.ply").exists());
    }
}

// Pictures and pages

/// Width, height and pixels of a PNG file.
fn decoded(bytes: &[u8]) -> (usize, usize, Vec<[u8; 3]>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((frame.color_type, frame.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    (frame.width as usize, frame.height as usize, pixels.as_chunks().0.to_vec())
}

/// Checks that a picture has so many poses of so many pixels, and that something is drawn of each.
fn assert_shows(bytes: &[u8], poses: usize, [width, height]: [usize; 2]) {
    let (wide, high, pixels) = decoded(bytes);
    assert!((poses * width..poses * width + (poses + 1) * width / 8).contains(&wide), "{poses} poses: {wide} wide");
    // Rows without anything in them are cut off, down to a quarter; captions and a scale are below.
    assert!((height / 4..2 * height).contains(&high), "{high} high");
    for pose in 0..poses {
        let columns = pose * wide / poses..(pose + 1) * wide / poses;
        let colors: BTreeSet<[u8; 3]> =
            pixels.chunks(wide).flat_map(|row| row[columns.clone()].iter().copied()).collect();
        assert!(colors.len() > 50, "pose {pose} has {} colours", colors.len());
    }
}

#[test]
fn a_picture_shows_the_model_at_rest_deformed_and_corrected() {
    let folder = Folder::new();
    // An identity is not drawn three times; a free pose has no correction.
    for (line, poses) in [
        ("ball.ply -o same.ply", 1),
        ("ball.ply -o free.ply --twist z=90 --volume free", 2),
        ("ball.ply -o out.ply --twist z=90", 3),
        ("ball.ply -o out.obj --twist z=90", 3),
        ("open.obj -o open-out.obj --twist z=30", 3),
        ("shape:ring?n=12 -o ring-out.ply --bend x=90", 3),
    ] {
        let report = folder.report(line);
        let drawn = folder.report(&format!("{line} --picture poses.png --size 260x200"));
        assert_eq!(drawn["volume"], report["volume"], "{line}: drawing changes nothing");
        assert_shows(&folder.bytes("poses.png"), poses, [260, 200]);
    }
    folder.report("ball.ply -o out.ply --twist z=90 --picture poses.PNG");
    assert_shows(&folder.bytes("poses.PNG"), 3, [520, 520]);
}

#[test]
fn models_without_a_body_are_drawn_too() {
    let folder = Folder::new();
    folder.write("square.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n");
    folder.write("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n");
    folder.write("point.obj", "v 0 0 0\n");
    for (line, poses) in [
        ("square.obj -o out.obj --margin 0.1 --twist x=90 --volume free", 2),
        ("points.obj -o out.obj --twist z=90 --volume free", 2),
        ("point.obj -o out.obj --volume free", 1),
    ] {
        let report = folder.report(&format!("{line} --picture out.png --report out.html --size 130x130"));
        assert_eq!(report["volume"]["target"], Value::Null, "{line}: {report}");
        let (wide, ..) = decoded(&folder.bytes("out.png"));
        assert!((130 * poses..160 * poses).contains(&wide), "{line}: {wide}");
        assert!(folder.bytes("out.html").starts_with(b"<!DOCTYPE html>"));
    }
}

#[test]
fn every_flag_of_pictures_changes_them() {
    let folder = Folder::new();
    let picture = |flags: &str| {
        folder.report(&format!("shape:bottle?n=16 -o out.ply --bend z=60,x --picture out.png --size 200x240 {flags}"));
        folder.bytes("out.png")
    };
    let usual = picture("");
    assert!(picture("") == usual && picture("--threads 1") == usual, "the same bytes for the same job");
    assert!(picture("--color volume --up z --view -60,22") == usual, "these are the defaults");
    let mut seen = BTreeSet::from([usual]);
    for flags in [
        "--color steps",
        "--color displacement",
        "--color stress",
        "--color plain",
        "--up x",
        "--up y",
        "--view 30,10",
        "--view 0,-90",
        "--no-lattice",
    ] {
        assert!(seen.insert(picture(flags)), "{flags} changes nothing");
    }
    // Sections of a job file mean the same; flags win.
    let view = "[view]\ncolor = \"displacement\"\nlattice = false\nup = \"y\"\nazimuth = 30\nelevation = 10\nsize = [200, 240]\n";
    folder.write("view.toml", format!("picture = \"job.png\"\n{view}"));
    folder.report("shape:bottle?n=16 -o out.ply --bend z=60,x --job view.toml");
    let same = picture("--color displacement --no-lattice --up y --view 30,10");
    assert!(folder.bytes("job.png") == same);
    let other = picture("--job view.toml --color plain --up z --view -60,22");
    assert!(other == picture("--color plain --no-lattice"));
}

#[test]
fn a_report_page_holds_the_request_the_volume_and_the_picture() {
    let folder = Folder::new();
    let flags = "--twist z=90 --picture out.png --report out.html --size 200x200";
    let report = folder.report(&format!("cube.obj -o out.obj {flags} --edit 'scale = {{ by = 1.1 }}'"));
    assert!(relative_error(&report) <= 1e-13, "{report}");
    let page = String::from_utf8(folder.bytes("out.html")).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>"), "{}", &page[..80]);
    assert!(page.contains("isochor deform --json --quiet cube.obj -o out.obj --twist z=90"));
    assert!(page.contains("--edit 'scale = { by = 1.1 }'"), "as it is typed");
    assert!(page.contains(&format!("{:?}", number(&report, "final"))), "all digits of the final volume");
    assert_eq!(pictures_of(&page), [folder.bytes("out.png")]);

    // A picture is in it that nobody asked for by name, and the flags that were put over a job file.
    let job = "# What a page shows.\nmodel = \"ball.ply\"\noutput = \"out.ply\"\nreport = \"job.html\"\nview.size = [150, 150]\n";
    folder.write("job.toml", job);
    let report = folder.report("--job job.toml --stretch z=0.5 --volume 110%");
    let page = String::from_utf8(folder.bytes("job.html")).unwrap();
    assert!(page.contains("# What a page shows.") && page.contains("--job job.toml --stretch z=0.5 --volume 110%"));
    assert!(page.contains(&format!("{:?}", number(&report, "final"))));
    assert!(
        !page.contains("let the volume") && !page.contains("keep the volume"),
        "words of the file alone would be wrong"
    );
    let [picture] = &pictures_of(&page)[..] else { panic!("one picture") };
    assert_shows(picture, 3, [150, 150]);
}

/// The files of a page's embedded pictures.
fn pictures_of(page: &str) -> Vec<Vec<u8>> {
    let texts = page.split("data:image/png;base64,").skip(1).map(|rest| rest.split('"').next().unwrap());
    texts.map(|text| base64::engine::general_purpose::STANDARD.decode(text).unwrap()).collect()
}

// Failures

/// Runs a line that must fail, as text and as JSON, and checks that nothing was written.
fn assert_fails(folder: &Folder, line: &str, exit: i32, code: &str, fragment: &str) {
    let before = folder.contents();
    let text = folder.isochor(line);
    assert_eq!(text.code, Some(exit), "{line}: {}", text.stderr);
    assert_eq!(text.stdout, "", "{line}");
    let json = folder.isochor(&format!("{line} --json"));
    assert_eq!(json.code, Some(exit), "{line}");
    let report = json.json();
    assert_eq!(keys(&report), ["error"], "{line}");
    let mut found = keys(&report["error"]);
    found.sort_unstable();
    assert_eq!(found, ["code", "hint", "what", "where"], "{line}");
    let part = |key: &str| report["error"][key].as_str().unwrap().to_owned();
    for key in ["code", "hint", "what", "where"] {
        assert!(!part(key).is_empty(), "{line}: no {key}");
    }
    assert_eq!(part("code"), code, "{line}: {report}");
    let all = format!("{} | {} | {}", part("what"), part("where"), part("hint"));
    assert!(all.contains(fragment), "{line}: no \"{fragment}\" in {all}");
    let is_told = fragment.split(" | ").all(|part| text.stderr.contains(part));
    assert!(is_told || code == "usage", "{line}: {}", text.stderr);
    assert!(folder.contents() == before, "{line}: files changed");
}

#[test]
fn requests_that_cannot_be_met_end_with_1_and_write_nothing() {
    let folder = Folder::new();
    folder.write("flipped.obj", OPEN.replace("f 1 2 4 3", "f 3 4 2 1"));
    folder.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n");
    folder.write("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 1\n");
    folder.write("away.toml", "[lattice]\norigin = [9, 9, 9]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n");
    for (line, code, fragment) in [
        ("deform cube.obj -o out.obj --twist z=90 --pin all", "impossible", "pinned"),
        ("deform cube.obj -o out.obj --volume 2 --job away.toml", "impossible", "inside the lattice"),
        (
            "deform cube.obj -o out.obj --move k=5:0,0,-0.4 --mobility auto --pin k=2,3,4,5",
            "impossible",
            "only control points where volume was lost",
        ),
        ("deform cube.obj -o out.obj --scale -1 --preserve gradient", "impossible", "turns back"),
        (
            "deform flask.ply -o out.ply --twist z=40 --part 0=110% --part 1=100% --part 0,1=100%",
            "impossible",
            "the volume of all components cannot become ",
        ),
        (
            "deform flask.ply -o out.ply --twist z=40 --part 0=110% --part 1=100% --part 0,1=100%",
            "impossible",
            "preserve.volume.parts[2] | leave out one of the volumes that contradict",
        ),
        (
            "deform flask.ply -o out.ply --twist z=40 --part 0=110% --part 1=100% --part 0,1=100%",
            "impossible",
            "it follows from other wanted volumes, which make it ",
        ),
        // Two layers along z change both volumes in the same way.
        (
            "deform flask.ply -o out.ply --lattice 2 --preserve z --volume material=100%,capacity=110%",
            "impossible",
            "the capacity cannot become 3.67",
        ),
        (
            "deform flask.ply -o out.ply --lattice 2 --preserve z --volume material=100%,capacity=110%",
            "impossible",
            "only together with other wanted volumes",
        ),
        (
            "deform flask.ply -o out.ply --lattice 2 --preserve z --volume material=100%,capacity=110%",
            "impossible",
            "preserve.volume.capacity | free more controls",
        ),
        ("deform chain.ply -o out.ply --volume each=110% --pin all", "impossible", "the volume of component "),
        (
            "deform chain.ply -o out.ply --volume each --bend x=60,z --lattice 20x6x6 --pin i=0,1,2,3,4,5,6,7,8",
            "impossible",
            "the volume of component 0 cannot",
        ),
        (
            "deform flask.ply -o out.ply --twist z=90 --basis bernstein --lattice 24 --objective surface",
            "memory",
            "13824 controls is too large for memory | preserve.objective | choose objective = \"controls\"",
        ),
        ("deform ball.ply -o out.ply --margin -0.1 --outside refuse", "outside", "vertices are outside"),
        ("deform open.obj -o out.obj --twist z=90 --open refuse", "open", "4 boundary edges"),
        ("deform flipped.obj -o out.obj --twist z=90", "winding", "volume = \"free\""),
        ("deform flat.obj -o out.obj --twist z=90", "no-volume", "no volume"),
        (
            "deform cube.obj -o out.obj --drag 9:0,0,0 --stretch z=0.5 --preserve xy",
            "impossible",
            "edit 1: drag: vertex 9",
        ),
        (
            "deform cube.obj -o out.obj --edit 'drag = { points = [{ vertex = 9, to = [0, 0, 0] }, { vertex = 9, to = [0, 0, 1] }] }'",
            "impossible",
            "vertex 9 misses its target by 1.000e0",
        ),
        ("deform cube.obj -o out.obj --drag 0:1e308,-1e308,1e308", "impossible", "range of numbers"),
        ("deform ball.ply -o out.ply --margin -0.1 --drag 0:2,2,2", "impossible", "outside the lattice"),
        ("deform points.obj -o out.obj --twist z=90", "no-volume", "no faces"),
    ] {
        assert_fails(&folder, line, 1, code, fragment);
        assert_fails(&folder, &format!("{line} --report report.json --save-controls controls.json"), 1, code, fragment);
    }
}

#[test]
fn bad_input_ends_with_2_and_writes_nothing() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("folder.obj")).unwrap();
    folder.write("cut.obj", "v 0 0 0\nv 1 0 0\nv 0 1\n");
    folder.write("point.obj", "v 0 0 0\n");
    folder.write("lattice.json", "{ \"kind\": \"lattice\" }");
    folder.write("none.toml", "[preserve]\npreview = 0\n");
    folder.write("half.toml", "[preserve]\npreview = 0.5\n");
    folder.write("yes.toml", "[preserve]\npreview = true\n");
    folder.report("cube.obj -o unused.obj --lattice 4 --save-controls controls.json");
    std::fs::copy(folder.path("controls.json"), folder.path("lattice.png")).unwrap();
    for (line, code, fragment) in [
        ("info nowhere.obj", "file", "nowhere.obj"),
        ("info cut.obj", "read", "line 3"),
        ("info lattice.json", "read", ".obj, .ply, .stl or .off"),
        ("deform nowhere.obj -o out.obj", "file", "nowhere.obj"),
        ("deform cut.obj -o out.obj", "read", "line 3"),
        ("deform cube.obj -o out.xyz", "read", "'.xyz'"),
        ("deform cube.obj -o out", "read", "no extension"),
        ("deform cube.obj -o cube.obj --twist z=90", "file", "--in-place"),
        ("deform cube.obj -o ./cube.obj --twist z=90", "file", "--in-place"),
        ("deform cube.obj -o folder.obj --twist z=90", "file", "is a folder"),
        ("deform cube.obj -o nowhere/out.obj --twist z=90", "file", "nowhere"),
        ("deform cube.obj -o out.obj --twist z=90 --report nowhere/report.json", "file", "nowhere"),
        ("deform cube.obj -o out.obj --twist z=90 --report report.txt", "file", ".html"),
        ("deform cube.obj -o out.obj --twist z=90 --picture out.gif", "file", ".png"),
        ("deform cube.obj -o out.obj --twist z=90 --animation out.png", "file", "frames = 36"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view 30", "usage", "-60,22"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --size 300", "usage", "520x520"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --size 9x9", "usage", "pixels"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view 0,100", "usage", "-90 to 90"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view nan,0", "usage", "-60,22"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view 1,2,3", "usage", "-60,22"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view front", "usage", "\"front\""),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --view ''", "usage", "-60,22"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --size 100x9000", "usage", "64 to 8192"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --size=-100x100", "usage", "520x520"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --color red", "usage", "red"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.png --up w", "usage", "w"),
        ("deform cube.obj -o out.obj --twist z=90 --picture p.jpg", "file", ".png"),
        ("deform cube.obj -o out.obj --twist z=90 --picture png", "file", ".png"),
        ("deform cube.obj -o out.obj --twist z=90 --picture nowhere/p.png", "file", "nowhere"),
        ("deform cube.obj -o p.png --twist z=90 --picture p.png", "read", "'.png'"),
        ("deform cube.obj -o out.obj --twist z=90 --report p.png --picture p.png", "file", ".json or .html"),
        (
            "deform cube.obj -o out.obj --lattice-file lattice.png --picture lattice.png",
            "file",
            "overwrite the lattice",
        ),
        (
            "deform cube.obj -o out.obj --lattice-file lattice.png --picture ./lattice.png",
            "file",
            "overwrite the lattice",
        ),
        ("deform cube.obj -o out.obj --twist z=90 --save-controls controls.txt", "file", ".json"),
        ("deform cube.obj -o out.obj --twist z=90 --report a.json --save-controls a.json", "file", "overwrite"),
        ("deform cube.obj -o out.obj --lattice-file controls.json --report controls.json", "file", "overwrite"),
        ("deform cube.obj -o out.obj --save-controls none.json", "file", "no lattice to save"),
        ("deform cube.obj -o out.stl --twist z=90 --precision f64", "write", "32-bit"),
        ("deform cube.obj -o out.obj --lattice-file nowhere.json", "file", "nowhere.json"),
        ("deform cube.obj -o out.obj --lattice-file lattice.json", "lattice-file", "version"),
        ("deform cube.obj -o out.obj --lattice 1", "lattice", "too few"),
        ("deform cube.obj -o out.obj --lattice 1000", "lattice", "too many"),
        ("deform cube.obj -o out.obj --lattice 100000", "lattice", "too many"),
        ("deform cube.obj -o out.obj --degree 0", "lattice", "at least 1"),
        ("deform cube.obj -o out.obj --margin -0.5", "lattice", "margin"),
        ("deform cube.obj -o out.obj --margin nan", "value", "margin"),
        ("deform point.obj -o out.obj --lattice 4", "lattice", "no lattice can be fitted"),
        ("deform cube.obj -o out.obj --bend z=45,z", "edit", "towards itself"),
        ("deform cube.obj -o out.obj --move k=9:0,0,1", "edit", "beyond the lattice"),
        ("deform cube.obj -o out.obj --drag 9999:0,0,1", "edit", "vertex 9999"),
        ("deform cube.obj -o out.obj --edit 'drag = { vertex = 0, to = [0, nan, 0] }'", "edit", "finite"),
        ("deform cube.obj -o out.obj --edit 'twist = { axis = \"z\", degrees = inf }'", "edit", "finite"),
        ("deform cube.obj -o out.obj --twist z=90 --pin k=9", "pin", "beyond the lattice"),
        ("deform cube.obj -o out.obj --twist z=90 --falloff 9999:0.3", "missing-vertex", "9999"),
        ("deform cube.obj -o out.obj --twist z=90 --falloff 0:-1", "value", "radius"),
        ("deform cube.obj -o out.obj --twist z=90 --preserve gradient --shares 1,2", "value", "takes no shares"),
        ("deform cube.obj -o out.obj --twist z=90 --shares 1,2", "correct", "3 are needed"),
        ("deform cube.obj -o out.obj --twist z=90 --preserve xy --shares 1,-1", "correct", "at least 0"),
        ("deform cube.obj -o out.obj --twist z=90 --volume 105%..95%", "value", "min must not exceed max"),
        (
            "deform cube.obj -o out.obj --twist z=90 --part 0,1=110%",
            "missing-component",
            "component 1, but the model has 1",
        ),
        ("deform cube.obj -o out.obj --twist z=90 --part 0=110% --part 7=1", "missing-component", "parts[1]"),
        ("deform cube.obj -o out.obj --twist z=90 --part 0,0=110%", "value", "component 0 twice"),
        ("deform cube.obj -o out.obj --twist z=90 --volume capacity=110%", "no-cavities", "isochor info"),
        (
            "deform cube.obj -o out.obj --twist z=90 --volume material=100%,capacity=110%",
            "no-cavities",
            "has no cavities",
        ),
        ("deform cube.obj -o out.obj --twist z=90 --job none.toml", "value", "number of triangles"),
        ("deform cube.obj -o out.obj --twist z=90 --job half.toml", "job", "line 2"),
        ("deform cube.obj -o out.obj --twist z=90 --job yes.toml", "job", "line 2"),
        ("demo cube.obj", "file", "cube.obj"),
        ("man cube.obj", "file", "cube.obj"),
    ] {
        assert_fails(&folder, line, 2, code, fragment);
    }
}

#[test]
fn bad_views_of_jobs_are_named_by_their_key() {
    let folder = Folder::new();
    for (view, code, fragment) in [
        ("azimuth = nan", "usage", "view.azimuth"),
        ("azimuth = inf", "usage", "view.azimuth"),
        ("elevation = 100", "usage", "from -90 to 90"),
        ("elevation = nan", "usage", "view.elevation"),
        ("milliseconds = 0", "usage", "view.milliseconds"),
        ("milliseconds = 65536", "job", "line 2"),
        ("size = [63, 100]", "usage", "64 to 8192"),
        ("size = [100, 8193]", "usage", "64 to 8192"),
        ("size = [100]", "job", "line 2"),
        ("size = [-100, 100]", "job", "line 2"),
        ("colour = \"plain\"", "job", "did you mean `color`?"),
        ("color = \"volumes\"", "job", "did you mean `volume`?"),
        ("up = \"-z\"", "job", "line 2"),
    ] {
        folder.write("job.toml", format!("[view]\n{view}\n"));
        let line = "deform cube.obj -o out.obj --twist z=90 --job job.toml --picture p.png";
        assert_fails(&folder, line, 2, code, fragment);
    }
    folder.write("job.toml", "pictures = \"p.png\"\n");
    assert_fails(&folder, "deform cube.obj -o out.obj --job job.toml", 2, "job", "did you mean `picture`?");
}

#[cfg(unix)]
#[test]
fn a_picture_never_replaces_the_model_through_a_link() {
    let folder = Folder::new();
    for name in ["cube.obj", "job.toml", "out.obj"] {
        folder.write("job.toml", "");
        let _ = std::fs::remove_file(folder.path("p.png"));
        std::os::unix::fs::symlink(folder.path(name), folder.path("p.png")).unwrap();
        folder.write("out.obj", OPEN);
        let line = "deform cube.obj -o out.obj --job job.toml --twist z=90 --picture p.png";
        assert_fails(&folder, line, 2, "file", "the picture would overwrite");
    }
}

#[test]
fn bad_usage_ends_with_2_and_writes_nothing() {
    let folder = Folder::new();
    for (line, fragment) in [
        ("", "subcommand"),
        ("deforms cube.obj", "deform"),
        ("info cube.obj ball.ply", "ball.ply"),
        ("deform -o out.obj", "model is missing"),
        ("deform cube.obj", "output is missing"),
        ("deform cube.obj -o out.obj --in-place", "--in-place"),
        ("deform cube.obj -o out.obj --twits z=90", "--twits"),
        ("deform cube.obj -o out.obj --twist", "--twist"),
        ("deform cube.obj -o out.obj --threads 0", "--threads"),
        ("deform cube.obj -o out.obj --preview 0", "--preview"),
        ("deform cube.obj -o out.obj --preview -5", "-5"),
        ("deform cube.obj -o out.obj --preview 1e4", "1e4"),
        ("deform cube.obj -o out.obj --preview", "--preview"),
        ("deform cube.obj -o out.obj --basis cubic", "cubic"),
        ("deform cube.obj -o out.obj --knots tight", "tight"),
        ("deform cube.obj -o out.obj --outside drop", "drop"),
        ("deform cube.obj -o out.obj --open maybe", "maybe"),
        ("deform cube.obj -o out.obj --precision f16", "f16"),
        ("deform cube.obj -o out.obj --margin wide", "wide"),
        ("deform cube.obj -o out.obj --lattice 6x6", "6x6"),
        ("deform cube.obj -o out.obj --lattice six", "--lattice"),
        ("deform cube.obj -o out.obj --degree 3,3", "--degree"),
        ("deform cube.obj -o out.obj --twist 90", "--twist"),
        ("deform cube.obj -o out.obj --twist q=90", "write for example z=90"),
        ("deform cube.obj -o out.obj --twist z=nan", "--twist"),
        ("deform cube.obj -o out.obj --bend z=45,up", "--bend"),
        ("deform cube.obj -o out.obj --taper z", "--taper"),
        ("deform cube.obj -o out.obj --stretch z=half", "--stretch"),
        ("deform cube.obj -o out.obj --rotate z=1e999", "--rotate"),
        ("deform cube.obj -o out.obj --scale 1,2", "--scale"),
        ("deform cube.obj -o out.obj --move k=5", "--move"),
        ("deform cube.obj -o out.obj --move k=5:0,0", "--move"),
        ("deform cube.obj -o out.obj --noise 0.1,x", "--noise"),
        ("deform cube.obj -o out.obj --drag 0,0,1", "--drag"),
        ("deform cube.obj -o out.obj --drag 9:0,1", "write for example 1204:0.1,0.2,0.9"),
        ("deform cube.obj -o out.obj --edit 'drag = { vertex = 1 }'", "no `to`"),
        ("deform cube.obj -o out.obj --edit 'twsit = { axis = \"z\", degrees = 90 }'", "did you mean `twist`?"),
        ("deform cube.obj -o out.obj --edit 'twist = { axis = \"z\", degres = 90 }'", "did you mean `degrees`?"),
        ("deform cube.obj -o out.obj --edit [preserve]", "--edit"),
        ("deform cube.obj -o out.obj --preserve xx", "each at most once"),
        ("deform cube.obj -o out.obj --preserve free --volume 120%", "contradicts"),
        ("deform cube.obj -o out.obj --volume 0", "--volume"),
        ("deform cube.obj -o out.obj --volume=-5%", "--volume"),
        ("deform cube.obj -o out.obj --volume much", "much"),
        ("deform cube.obj -o out.obj --volume ..", "--volume"),
        ("deform cube.obj -o out.obj --volume each=", "--volume"),
        ("deform cube.obj -o out.obj --volume each=100%,capacity=110%", "--volume"),
        ("deform cube.obj -o out.obj --volume capacity=full", "more than 0"),
        ("deform cube.obj -o out.obj --part 110%", "write for example 0,2=110%"),
        ("deform cube.obj -o out.obj --part a=110%", "--part"),
        ("deform cube.obj -o out.obj --part 0=-1", "--part"),
        ("deform cube.obj -o out.obj --part 0=110% --volume each", "contradicts --volume"),
        ("deform cube.obj -o out.obj --part 0=110% --preserve free", "contradicts --part"),
        ("deform cube.obj -o out.obj --shares 1,x", "--shares"),
        ("deform cube.obj -o out.obj --pin top", "--pin"),
        ("deform cube.obj -o out.obj --pin 'k=0 k=1'", "twice"),
        ("deform cube.obj -o out.obj --falloff 0.3", "--falloff"),
        ("deform cube.obj -o out.obj --mobility some", "some"),
        ("deform cube.obj -o out.obj --objective area", "area"),
        ("deform cube.obj -o out.obj --falloff=-1:0.3", "--falloff"),
        ("deform cube.obj -o out.obj --lattice-file controls.json --lattice 4", "--lattice-file"),
    ] {
        assert_fails(&folder, line, 2, "usage", fragment);
    }
}

#[test]
fn missing_arguments_are_named_in_json_too() {
    let folder = Folder::new();
    assert_fails(&folder, "info", 2, "usage", "MODEL");
    assert_fails(&folder, "completions", 2, "usage", "SHELL");
}

#[test]
fn bad_jobs_name_the_line_and_the_nearest_key() {
    let folder = Folder::new();
    for (job, fragment) in [
        ("modle = \"cube.obj\"\n", "did you mean `model`?"),
        ("modle = \"cube.obj\"\n", "job.toml, line 1"),
        ("[lattice]\nsizes = 4\n", "did you mean `size`?"),
        ("[preserve]\n\nvolme = \"rest\"\n", "job.toml, line 3"),
        ("[preserve]\nvolme = \"rest\"\n", "did you mean `volume`?"),
        ("[preserve]\nfalloff = { vertx = 0, radius = 1 }\n", "did you mean `vertex`?"),
        ("[preserve]\npin = { lst = [[0, 0, 0]] }\n", "did you mean `list`?"),
        ("[[edit]]\ntwsit = { axis = \"z\", degrees = 9 }\n", "did you mean `twist`?"),
        ("[[edit]]\ntwist = { axis = \"z\", degrees = 9, rnage = [0, 1] }\n", "did you mean `range`?"),
        ("[preserve]\nvolume = -1\n", "more than 0"),
        ("[preserve]\nvolume = { eahc = \"100%\" }\n", "did you mean `each`?"),
        ("[preserve]\nvolume = { each = 1, parts = [] }\n", "{ each, parts }"),
        ("[preserve]\nvolume = { parts = [{ components = [0] }] }\n", "missing field `volume`"),
        ("[preserve]\nvolume = { parts = [{ component = [0], volume = 1 }] }\n", "did you mean `components`?"),
        ("[preserve]\naxes = \"xyy\"\n", "\"xyy\""),
        ("[preserve]\nobjective = \"surfaces\"\n", "did you mean `surface`?"),
        ("[lattice]\nsize = [4, 4]\n", "a list of 2 numbers"),
        ("[lattice\n", "line 1"),
    ] {
        folder.write("job.toml", job);
        assert_fails(&folder, "deform cube.obj -o out.obj --job job.toml", 2, "job", fragment);
    }
    folder.write("job.json", "{\n\"presrve\": {} }");
    assert_fails(&folder, "deform cube.obj -o out.obj --job job.json", 2, "job", "did you mean `preserve`?");
    assert_fails(&folder, "deform cube.obj -o out.obj --job job.json", 2, "job", "job.json, line 2");
    folder.write("job.txt", "");
    assert_fails(&folder, "deform cube.obj -o out.obj --job job.txt", 2, "file", ".toml or .json");
    assert_fails(&folder, "deform --job nowhere.toml", 2, "file", "nowhere.toml");
}

#[test]
fn a_job_file_is_never_overwritten() {
    let folder = Folder::new();
    folder.write("job.json", r#"{ "edit": [{ "twist": { "axis": "z", "degrees": 90 } }] }"#);
    let line = "deform cube.obj -o out.obj --job job.json";
    assert_fails(&folder, &format!("{line} --report job.json"), 2, "file", "overwrite");
    assert_fails(&folder, &format!("{line} --save-controls ./job.json"), 2, "file", "overwrite");
}

#[cfg(unix)]
#[test]
fn names_that_are_not_unicode_are_names_too() {
    use std::os::unix::ffi::OsStrExt;
    let folder = Folder::new();
    let name = std::ffi::OsStr::from_bytes(b"caf\xe9.obj");
    std::fs::copy(folder.path("cube.obj"), folder.0.path().join(name)).unwrap();
    let ran_with = |flags: &[&str]| ran(folder.command().arg("deform").arg(name).args(flags));
    ran_with(&["-o", "out.obj", "--twist", "z=90"]).succeeded();
    let failed = ran_with(&["-o", "out.obj", "--twits", "z=90", "--json"]);
    assert_eq!(failed.code, Some(2), "{}", failed.stderr);
    assert_eq!(failed.json()["error"]["code"], "usage");
}

#[test]
fn elastic_flags_say_what_a_job_file_says() {
    let folder = Folder::new();
    let squash = "--lattice 3 --basis bernstein --edit 'scale = { by = [1, 1, 0.6], nodes = { k = [0, 2] } }'";
    let run = |flags: &str| folder.report(&format!("shape:ring?n=24 -o out.ply {squash} {flags}"));
    let report = run("--preserve elastic");
    assert!(relative_error(&report) <= 1e-13, "{report}");
    assert_eq!((&report["elastic"]["net"], &report["elastic"]["held"]), (&"26".into(), &18.into()));
    assert_eq!(run("--method elastic")["elastic"]["energy"], report["elastic"]["energy"]);
    let other = run("--elastic 'net=\"14\",stiffness=2'");
    assert_eq!(other["elastic"]["net"], "14");
    folder.write("job.toml", "preserve = { method = \"elastic\" }\nelastic = { net = \"14\", stiffness = 2 }\n");
    assert_eq!(run("--job job.toml")["elastic"]["energy"], other["elastic"]["energy"]);
    // Flags win, and keep what they do not name.
    let both = run("--job job.toml --elastic 'net=\"14-kuhn\"'");
    assert_eq!(both["elastic"]["net"], "14-kuhn");
    let alone = run("--elastic 'net=\"14-kuhn\"'");
    let ratio = both["elastic"]["energy"].as_f64().unwrap() / alone["elastic"]["energy"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 1e-9, "{ratio}");

    let refused = folder.isochor(&format!("shape:ring -o no.ply {squash} --elastic net=26 --json").replacen(
        "shape",
        "deform shape",
        1,
    ));
    assert_eq!(refused.code, Some(2));
    assert!(refused.json()["error"]["hint"].as_str().unwrap().contains("hold={k=[0,2]}"), "{}", refused.stdout);
    let held = folder.isochor(&format!("deform shape:ring -o no.ply {squash} --elastic 'hold=\"all\"' --json"));
    assert_eq!(
        (held.code, held.json()["error"]["where"].as_str().unwrap()),
        (Some(1), "elastic.hold"),
        "{}",
        held.stdout
    );
    assert!(!folder.path("no.ply").exists());
}
