//! Real and broken files: the folder of reference models, whose figures another program computed (`tools/analyse.py` there).

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::PathBuf;
use std::process::Command;

use glam::DVec3;
use isochor::{Health, Job, JobInput, Mesh, Role, Shell, Source, Verdict, fan, shapes, topology};
use isochor_io::{Document, Format, Place, ReadError, WriteOptions};
use serde_json::Value;

fn shared(path: &str) -> PathBuf {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    PathBuf::from(folder).join("models").join(path)
}

fn read(path: &str) -> Result<Document, ReadError> {
    Document::parse(std::fs::read(shared(path)).unwrap(), Format::from_path(path.as_ref()).unwrap())
}

fn source(document: &Document) -> Source {
    Source {
        format: document.format().name().into(),
        vertices: document.vertices_in_file(),
        faces: document.faces_in_file(),
        warnings: document.warnings().to_vec(),
    }
}

fn health(document: &Document) -> Health {
    let mesh = document.mesh();
    Health::of(mesh, &topology(mesh), &source(document)).0
}

/// A row of a table: cells by heading.
type Row = BTreeMap<String, String>;

/// The rows of a table of tab-separated values whose files are in a format that can be read.
fn table(path: &str) -> Vec<Row> {
    let text = std::fs::read_to_string(shared(path)).unwrap();
    let mut lines = text.lines().map(|line| line.split('\t').map(String::from).collect::<Vec<_>>());
    let headings = lines.next().unwrap();
    let rows = lines.map(|cells| headings.iter().cloned().zip(cells).collect::<Row>());
    rows.filter(|row| Format::from_path(row["file"].as_ref()).is_ok()).collect()
}

/// The rows of the manifest that have figures.
fn rows_with_figures() -> Vec<Row> {
    table("MANIFEST.tsv").into_iter().filter(|row| row["vertices"] != "-").collect()
}

/// Where manifest and reader part for a reason: file, column (or "refused"), reason.
const PARTINGS: [(&str, &str, &str); 2] = [
    (
        "formats/real/wallhole.obj",
        "faces without area",
        "the manifest counts flat triangles of the fans, here 11 of two large polygons; a polygon with area is none",
    ),
    (
        "broken/real/ply_empty_header.ply",
        "refused",
        "its header announces no element: the manifest takes that for a model of 0 vertices, a reader for a lost header",
    ),
];

/// Compares what was found with the cells of a row.
struct Comparison {
    row: Row,
    /// Column and both values, where they differ.
    differences: Vec<(String, String)>,
}

impl Comparison {
    fn cell(&mut self, column: &str, found: impl Display) {
        let found = found.to_string();
        let agree = self.row[column] == found;
        self.note(column, found, agree);
    }

    fn yes_or_no(&mut self, column: &str, found: bool) {
        self.cell(column, if found { "yes" } else { "no" });
    }

    /// Numbers that were printed with so many significant digits, and are uncertain by `noise` besides.
    fn printed(&mut self, column: &str, found: &[f64], digits: i32, noise: f64) {
        let cells: Vec<f64> = self.row[column].split(' ').map(|number| number.parse().unwrap()).collect();
        let half_a_digit = 5.001 * 10f64.powi(-digits);
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= half_a_digit * a.abs() + noise;
        let agree = cells.len() == found.len() && cells.iter().zip(found).all(near);
        self.note(column, format!("{found:?}"), agree);
    }

    fn note(&mut self, column: &str, found: String, agree: bool) {
        if !agree {
            self.differences.push((column.into(), format!("{found}, the manifest says {}", self.row[column])));
        }
    }
}

/// Columns in which the figures of a model differ from its row.
fn differences(row: &Row, document: &Document) -> Vec<(String, String)> {
    let health = health(document);
    let mut compare = Comparison { row: row.clone(), differences: Vec::new() };
    compare.cell("vertices", health.vertices);
    compare.cell("faces", health.faces);
    match health.bounds {
        Some(bounds) => compare.printed("bounding box", &bounds.concat(), 6, 0.0),
        None => compare.cell("bounding box", "-"),
    }
    if row["triangles if fanned"] == "-" {
        return compare.differences;
    }
    compare.cell("triangles if fanned", health.triangles);
    compare.yes_or_no("watertight", health.closed);
    compare.yes_or_no("consistently oriented", health.oriented);
    compare.yes_or_no("balanced", health.balanced);
    compare.cell("components", health.components);
    compare.cell("boundary edges", health.boundary_edges);
    compare.cell("edges of >2 faces", health.nonmanifold_edges);
    compare.cell("genus", health.genus.map_or("-".into(), |genus| genus.to_string()));
    compare.cell("unused vertices", health.unused_vertices);
    compare.cell("coincident vertices", health.coincident_vertices);
    compare.cell("faces without area", health.zero_area_faces);
    if let (true, Some(volume), Some(bounds)) = (health.balanced, &health.volume, document.mesh().bounds()) {
        // The manifest's sum was rounded to about 1e-13 of its terms.
        compare.printed("signed volume", &[volume.total], 9, 1e-14 * bounds.extent().powi(3));
    }
    compare.differences
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn every_model_has_the_figures_of_the_manifest() {
    let mut found = Vec::new();
    let rows = rows_with_figures();
    for row in &rows {
        let file = row["file"].as_str();
        let here = match read(file) {
            Ok(document) => differences(row, &document),
            Err(_) if row["note"].contains("-> refuse") => Vec::new(),
            Err(error) => vec![("refused".into(), error.to_string())],
        };
        found.extend(here.into_iter().map(|(column, what)| (file.to_owned(), column, what)));
    }
    let known = |file: &str, column: &str| PARTINGS.iter().any(|(f, c, _)| (*f, *c) == (file, column));
    let surprises: Vec<_> = found.iter().filter(|(file, column, _)| !known(file, column)).collect();
    assert!(surprises.is_empty(), "{surprises:#?}");
    assert_eq!(found.len(), PARTINGS.len(), "a parting of ways is none any more: {found:#?}");
    assert!(rows.len() > 200, "only {} rows of the manifest have figures", rows.len());
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn every_file_comes_back_byte_for_byte_where_no_point_moves() {
    for row in table("MANIFEST.tsv") {
        let Ok(document) = read(&row["file"]) else { continue };
        let points = document.mesh().points();
        let written = document.with_points(points, &WriteOptions::default()).unwrap();
        assert!(written.bytes == document.bytes(), "{} changed", row["file"]);
        assert_eq!(written.points, points, "{}", row["file"]);
    }
}

/// The volume that the notes say a file has.
fn volume_said(file: &str, sentence: &str) -> Option<f64> {
    match file {
        "obj-repeated-corner.obj" | "obj-two-corner-face.obj" | "ply-list-of-zero.ply" => return Some(1.0), // a cube still
        "topo-ngon-3000.obj" => return Some(1500.0 * (std::f64::consts::TAU / 3000.0).sin()),
        _ => {}
    }
    let word = sentence.split("volume ").nth(1)?.split([' ', ',', ';', ':', ')']).next()?;
    match word.split_once('/') {
        Some((a, b)) => Some(a.parse::<f64>().ok()? / b.parse::<f64>().ok()?),
        None => word.parse().ok(),
    }
}

/// What the notes say of a file in words that are not "refuse" or a volume.
fn verdict_said(file: &str) -> Option<Verdict> {
    match file {
        "topo-flipped-face.obj" | "topo-klein.obj" => Some(Verdict::Inconsistent),
        "topo-inward.obj" => Some(Verdict::InsideOut),
        "topo-missing-face.obj" | "topo-missing-side-shifted.obj" | "topo-t-junction.obj" | "topo-fin.obj" => {
            Some(Verdict::Capped)
        }
        "topo-single-triangle.obj" | "topo-flat.obj" | "topo-quad-pillow.obj" | "stl-jitter.stl" => {
            Some(Verdict::NoVolume)
        }
        "topo-all-one-point.obj" => Some(Verdict::NoFaces),
        _ => None,
    }
}

/// Files that are read and of which the manifest says all there is to check: edges of three faces, volume by the fan rule.
const IN_THE_MANIFEST: [&str; 2] = ["topo-duplicate-face.obj", "topo-nonplanar-quads.obj"];

/// What is wrong with a refusal, if anything.
fn fault_of_error(file: &str, sentence: &str, error: &ReadError) -> Option<&'static str> {
    let bytes = std::fs::read(shared(&format!("broken/made/{file}"))).unwrap();
    let is_text = !bytes.contains(&0) && (file.ends_with(".obj") || file.ends_with(".off") || file.contains("ascii"));
    if !sentence.contains("refuse") {
        Some("it can be read")
    } else if error.what().is_empty() || error.hint().is_none() {
        Some("the error is no help")
    } else if error.place().is_none() && !bytes.is_empty() {
        Some("the error names no place")
    } else if is_text && matches!(error.place(), Some(Place::Byte(_))) {
        Some("the error names no line of the text")
    } else {
        None
    }
}

/// What is wrong with the health of a file that was read, if anything.
fn fault_of_health(file: &str, sentence: &str, health: &Health) -> Option<&'static str> {
    let must_refuse = sentence.starts_with("refuse") && !sentence.contains(", or ");
    let verdict = if sentence.contains("read as empty") { Some(Verdict::NoFaces) } else { verdict_said(file) };
    let volume = volume_said(file, sentence).filter(|_| verdict.is_none());
    let total = health.volume.as_ref().map_or(f64::NAN, |volume| volume.total);
    // The corners of the large polygon were printed with nine digits.
    let tolerance = if file == "topo-ngon-3000.obj" { 1e-8 } else { 1e-15 };
    if must_refuse {
        Some("it must not be read")
    } else if sentence.contains("say so") && health.warnings.is_empty() {
        Some("no warning")
    } else if verdict.is_some_and(|verdict| health.verdict != verdict) {
        Some("another verdict was said")
    } else if volume.is_some_and(|volume| total.is_nan() || (total - volume).abs() > tolerance * volume.abs()) {
        Some("another volume was said")
    } else if verdict.is_none() && volume.is_none() && !IN_THE_MANIFEST.contains(&file) {
        Some("no test covers it")
    } else {
        None
    }
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn broken_files_are_met_as_a_careful_reader_would() {
    let rows = table("broken/made/NOTES.tsv");
    let mut faults = Vec::new();
    for row in &rows {
        let (file, sentence) = (row["file"].as_str(), row["what a careful reader does"].as_str());
        let (fault, met) = match read(&format!("broken/made/{file}")) {
            Ok(document) => {
                let health = health(&document);
                (fault_of_health(file, sentence, &health), format!("{:?}, {:?}", health.verdict, health.volume))
            }
            Err(error) => (fault_of_error(file, sentence, &error), error.to_string()),
        };
        faults.extend(fault.map(|fault| format!("{file} ({sentence}): {fault}: {met}")));
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(rows.len() > 90, "only {} rows", rows.len());
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_porsche_with_a_lying_header_is_refused_at_its_first_vertex() {
    let error = read("broken/real/porsche.ply").unwrap_err();
    assert_eq!(error.place(), Some(Place::Line(14)), "{error}");
    assert!(error.what().contains("too few numbers"), "{error}");
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn every_model_keeps_its_volume_exactly_or_says_why_it_has_none() {
    let job = "[[edit]]\ntwist = { axis = \"z\", degrees = 60 }\n[[edit]]\nstretch = { axis = \"x\", scale = 1.5 }\n";
    let job = Job::from_toml(job).unwrap();
    let (mut closed, mut faults) = (0, Vec::new());
    for row in rows_with_figures() {
        if row["faces"].parse::<usize>().unwrap() > 60_000 {
            continue;
        }
        let Ok(document) = read(&row["file"]) else { continue };
        let (source, health) = (source(&document), health(&document));
        let outcome = job.run(
            &JobInput { mesh: document.mesh(), source: &source, lattice: None, surface: None, cage: None },
            &mut |_| {},
        );
        let fault = match outcome {
            Ok(outcome) => {
                let volume = outcome.report.volume.unwrap().overall;
                let error = volume.relative_error.unwrap();
                closed += usize::from(health.closed);
                (error.is_nan() || error > 1e-13).then(|| format!("{error:e}, {volume:?}"))
            }
            Err(error) => health.verdict.is_preservable().then(|| error.to_string()),
        };
        faults.extend(fault.map(|fault| format!("{}: {fault}", row["file"])));
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(closed > 100, "only {closed} closed models");
}

/// What the components of a model are, less their volumes.
fn roles(mesh: &Mesh) -> Vec<Role> {
    let health = Health::of(mesh, &topology(mesh), &Source::of(mesh)).0;
    health.roles.into_iter().map(|component| component.role).collect()
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn components_of_many_bodied_models_have_roles_that_add_up() {
    let mut several = 0;
    for row in rows_with_figures() {
        let Ok(document) = read(&row["file"]) else { continue };
        let health = health(&document);
        let Some(volumes) = health.volume.filter(|volumes| volumes.components.len() > 1) else { continue };
        several += 1;
        let file = &row["file"];
        assert_eq!(health.roles.len(), health.components, "{file}");
        // Solids, material and what is inward or nothing make the whole; capacities are those of the cavities.
        let outwards = if volumes.total < 0.0 { -1.0 } else { 1.0 };
        let (mut total, mut capacity, mut cavities) = (0.0, 0.0, 0.0);
        for (c, component) in health.roles.iter().enumerate() {
            let volume = volumes.components[c] * outwards;
            assert_eq!(component.volume, volumes.components[c], "{file}");
            match &component.role {
                Role::Solid => assert!(volume > 0.0),
                Role::Shell(shell) => {
                    assert!(volume > 0.0 && shell.outer == c && !shell.cavities.is_empty(), "{file}");
                    assert!(shell.cavities.iter().all(|&k| health.roles[k].role == Role::Cavity { of: c }), "{file}");
                    capacity += component.capacity.unwrap();
                }
                Role::Cavity { of } => {
                    assert!(
                        matches!(&health.roles[*of].role, Role::Shell(shell) if shell.cavities.contains(&c)),
                        "{file}"
                    );
                    assert!(volume < 0.0, "{file}");
                    cavities -= volume;
                }
                Role::Inward => assert!(volume < 0.0, "{file}"),
                Role::Nothing => {}
            }
            total += match component.role {
                Role::Cavity { .. } => 0.0,
                _ => component.material.unwrap_or(volume),
            };
        }
        let size: f64 = volumes.components.iter().map(|v| v.abs()).sum();
        assert!((total - volumes.total * outwards).abs() <= 1e-13 * size, "{file}");
        assert!((capacity - cavities).abs() <= 1e-13 * size, "{file}");
    }
    assert!(several > 20, "only {several} models of several components");
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn a_cavity_is_one_only_where_it_is_wound_inwards() {
    let of = |file: &str| roles(read(file).unwrap().mesh());
    let shell = Role::Shell(Shell { outer: 0, cavities: vec![1] });
    assert_eq!(of("broken/made/topo-cavity.obj"), [shell, Role::Cavity { of: 0 }]);
    assert_eq!(of("broken/made/topo-cavity-wrong.obj"), [Role::Solid, Role::Solid]);
    assert_eq!(of("broken/made/topo-overlapping-cubes.obj"), [Role::Solid, Role::Solid]);
    assert_eq!(of("closed/ant.ply"), [const { Role::Solid }; 15]);
}

/// Whether a ray from `q` leaves `mesh` an odd number of times.
fn is_inside(mesh: &Mesh, q: DVec3) -> bool {
    let direction = DVec3::new(0.531_234, 0.612_357, 0.585_611);
    let crosses = |t: [u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.points()[v as usize] - q);
        let [u, v, w] = [(b, c), (c, a), (a, b)].map(|(p, q)| direction.dot(p.cross(q)));
        let (sum, height) = (u + v + w, a.dot((b - a).cross(c - a)));
        (u.min(v).min(w) >= 0.0 || u.max(v).max(w) <= 0.0) && sum != 0.0 && height / sum > 0.0
    };
    mesh.faces().iter().flat_map(fan).filter(|t| crosses(*t)).count() % 2 == 1
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn tiny_balls_in_real_models_are_cavities_where_a_ray_says_that_they_are_inside() {
    for file in [
        "closed/armadillo-43243v.ply",
        "closed/horse-48485v-inward.ply",
        "closed/spot-2928quads.obj",
        "closed/wingnut.obj",
        "closed/rocker-arm.ply",
    ] {
        let document = read(file).unwrap();
        let mesh = document.mesh();
        let (bounds, volume) = (mesh.bounds().unwrap(), health(&document).volume.unwrap().total);
        let ball = shapes::icosphere(0);
        let (mut points, mut faces) = (mesh.points().to_vec(), mesh.faces().clone());
        let fraction = |k: usize, step: usize| (k * step % 211) as f64 / 211.0 + 1e-3;
        let centers: Vec<DVec3> = (1..200)
            .map(|k| bounds.min + bounds.size() * DVec3::new(fraction(k, 1), fraction(k, 37), fraction(k, 101)))
            .collect();
        for center in &centers {
            let first = points.len() as u32;
            points.extend(ball.points().iter().map(|p| *center + *p * (1e-7 * bounds.extent())));
            for face in ball.faces().iter() {
                let [a, b, c] = [face[0], face[1], face[2]].map(|v| v + first);
                faces.push(&if volume < 0.0 { [a, b, c] } else { [a, c, b] });
            }
        }
        let roles = roles(&Mesh::new(points, faces).unwrap());
        let inside: Vec<bool> = centers.iter().map(|center| is_inside(mesh, *center)).collect();
        let found: Vec<bool> = roles[1..].iter().map(|role| *role == Role::Cavity { of: 0 }).collect();
        assert_eq!(found, inside, "{file}");
        let count = inside.iter().filter(|inside| **inside).count();
        assert!((20..180).contains(&count), "{file}: {count} of {} are inside", inside.len());
    }
}

/// Halves the upper end of models; what was not deformed stays, and the volume is exact all the same.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn automatic_mobility_corrects_real_models_where_they_lost_volume() {
    let toml = |mobility: &str| {
        format!(
            "lattice = {{ size = 8 }}\npreserve = {{ mobility = \"{mobility}\" }}\n\
             [[edit]]\nscale = {{ by = 0.5, nodes = {{ k = [6, 7] }} }}\n"
        )
    };
    for file in ["derived/bunny-filled-derived.ply", "open/bunny-35947v.ply", "closed/armadillo-43243v.ply"] {
        let document = read(file).unwrap();
        let input =
            JobInput { mesh: document.mesh(), source: &source(&document), lattice: None, surface: None, cage: None };
        let [auto, uniform] = ["auto", "uniform"].map(|mobility| {
            let outcome = Job::from_toml(&toml(mobility)).unwrap().run(&input, &mut |_| {}).unwrap();
            let volume = outcome.report.volume.as_ref().unwrap().overall;
            assert!(volume.relative_error.unwrap() <= 1e-13, "{file}: {volume:?}");
            assert!(
                (volume.corrected / volume.rest - 1.0).abs() <= 1e-13 && volume.posed < 0.99 * volume.rest,
                "{file}"
            );
            outcome
        });
        // Cubic on 5 cells: layers 6 and 7 deform the two uppermost, which layers 3 to 7 touch; layers 0 to 2 stay.
        let controls = auto.controls.as_ref().unwrap();
        for (c, (posed, rest)) in controls.posed.iter().zip(&controls.rest).enumerate() {
            assert!(c % 8 > 2 || posed == rest, "{file}: layer {} moved", c % 8);
        }
        // The lowest fifth, which the edit left alone, moves much less than with uniform mobilities.
        let (low, side) = (document.mesh().bounds().unwrap().min.z, document.mesh().bounds().unwrap().size().z);
        let moves = |outcome: &isochor::Outcome| -> f64 {
            let pairs = outcome.points.iter().zip(document.mesh().points());
            pairs.filter(|(_, rest)| rest.z < low + 0.2 * side).map(|(end, rest)| end.distance(*rest)).sum()
        };
        assert!(moves(&auto) < 0.1 * moves(&uniform), "{file}: {} of {}", moves(&auto), moves(&uniform));
    }
}

/// Every body of real models of many bodies keeps, or gets, its own volume.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn bodies_of_real_models_have_their_own_volumes() {
    for (file, count) in [("closed/ant.ply", 15), ("formats/real/rabbit.obj", 9)] {
        let rest = read(file).unwrap();
        let point = rest.mesh().points()[7] + 0.05 * DVec3::Y * rest.mesh().bounds().unwrap().extent();
        let rest = health(&rest).volume.unwrap().components;
        assert_eq!(rest.len(), count, "{file}");
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join(file.rsplit('/').next().unwrap());
        let point = format!("7:{},{},{}", point.x, point.y, point.z);
        for (flags, wanted) in [
            (vec!["--volume", "each"], (0..count).map(|c| (c, 1.0)).collect::<Vec<_>>()),
            (vec!["--volume", "each=115%", "--preserve", "gradient"], (0..count).map(|c| (c, 1.15)).collect()),
            (
                vec!["--part", "0=120%", "--part", "3=80%", "--pin", "i=0", "--objective", "edges"],
                vec![(0, 1.2), (3, 0.8)],
            ),
            (vec!["--volume", "each", "--drag", &point], (0..count).map(|c| (c, 1.0)).collect()),
        ] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
            command.args(["deform", "--json", "--quiet", "--lattice", "10", "--bend", "z=40,x", "--precision", "f64"]);
            let line = flags.join(" ");
            let ran = command.args(&flags).arg("--output").arg(&output).arg(shared(file)).output().unwrap();
            assert!(ran.status.success(), "{file} {line}: {}", String::from_utf8_lossy(&ran.stdout));
            let format = Format::from_path(&output).unwrap();
            let after = health(&Document::parse(std::fs::read(&output).unwrap(), format).unwrap()).volume.unwrap();
            for (c, factor) in wanted {
                let error = (after.components[c] / rest[c] / factor - 1.0).abs();
                assert!(error <= 1e-12, "{file} {line}: component {c} is off by {error:e}");
            }
        }
    }
}

/// The text of the header, and the bytes behind the vertices: `float x, y, z` each, as in all models that are tried here.
fn header_and_faces(ply: &[u8]) -> (&str, &[u8]) {
    let end = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&ply[..end]).unwrap();
    let vertices = header.split("element vertex ").nth(1).unwrap();
    assert!(vertices.contains("\nproperty float x\nproperty float y\nproperty float z\nelement face "), "{header}");
    let count: usize = vertices.lines().next().unwrap().parse().unwrap();
    (header, &ply[end + 12 * count..])
}

/// Fails where anything but the three coordinates of `v` lines differs, or of the lines of vertices behind both first ones in OFF.
fn assert_only_coordinates_differ(format: Format, before: &[u8], after: &[u8]) {
    let [before, after] = [before, after].map(|bytes| std::str::from_utf8(bytes).unwrap());
    assert_eq!(before.lines().count(), after.lines().count());
    let counts = before.lines().nth(1).unwrap().split(' ').next().unwrap();
    let rows = if format == Format::Off { 2..2 + counts.parse::<usize>().unwrap() } else { 0..0 };
    for (k, (a, b)) in before.lines().zip(after.lines()).enumerate() {
        if a.starts_with("v ") || rows.contains(&k) {
            let first = usize::from(a.starts_with("v "));
            let [a, b] = [a, b].map(|line| line.split(' ').collect::<Vec<_>>());
            assert_eq!((a.len(), &a[..first], &a[first + 3..]), (b.len(), &b[..first], &b[first + 3..]));
        } else {
            assert_eq!(a, b);
        }
    }
}

/// Twists and bends a model through the command, corrected in four ways.
fn deform_and_check(file: &str) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join(file.rsplit('/').next().unwrap());
    let before = std::fs::read(shared(file)).unwrap();
    let format = Format::from_path(&output).unwrap();
    let ways = [["--preserve", "gradient"], ["--preserve", "xy"], ["--preserve", "z"], ["--volume", "120%"]];
    for way in ways {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
        command.args(["deform", "--json", "--quiet", "--twist", "z=60", "--bend", "x=40,z", "--output"]);
        let ran = command.arg(&output).arg(shared(file)).args(way).output().unwrap();
        assert!(ran.status.success(), "{file} {way:?}: {}", String::from_utf8_lossy(&ran.stdout));
        let report: Value = serde_json::from_slice(&ran.stdout).unwrap();
        let number = |key: &str| report["volume"][key].as_f64().unwrap();

        let wanted = if way[0] == "--volume" { 1.2 } else { 1.0 } * number("rest");
        assert!((number("target") / wanted - 1.0).abs() <= 1e-15, "{file} {way:?}");
        assert!((number("posed") / wanted - 1.0).abs() > 1e-4, "{file} {way:?}: nothing to correct");
        assert!(number("relative_error") <= 1e-13, "{file} {way:?}: {:e}", number("relative_error"));
        let held = if matches!(format, Format::Obj | Format::Off) { 1e-13 } else { 1e-6 };
        assert!((number("written") / wanted - 1.0).abs() <= held, "{file} {way:?}: {}", number("written"));

        let after = std::fs::read(&output).unwrap();
        assert!(before != after);
        match format {
            Format::Obj | Format::Off => assert_only_coordinates_differ(format, &before, &after),
            _ => assert!(header_and_faces(&before) == header_and_faces(&after), "{file} {way:?}"),
        }
        let again = health(&Document::parse(after, format).unwrap()).volume.unwrap().total;
        assert!((again.abs() / number("written") - 1.0).abs() <= 1e-13, "{file} {way:?}: {again}");
    }
}

/// One test for each model that is run through the command.
macro_rules! deformed {
    ($($name:ident: $file:literal,)*) => {$(
        #[test]
        #[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
        fn $name() {
            deform_and_check($file);
        }
    )*};
}

deformed! {
    the_open_bunny_keeps_its_capped_volume: "open/bunny-35947v.ply",
    the_armadillo_keeps_its_volume: "closed/armadillo-43243v.ply",
    the_horse_that_is_inside_out_keeps_its_volume: "closed/horse-48485v-inward.ply",
    spot_of_quads_keeps_its_volume: "closed/spot-2928quads.obj",
    the_porsche_with_edges_of_four_faces_keeps_its_volume: "derived/porsche-repaired-derived.ply",
    the_dolphin_of_an_off_file_keeps_its_volume: "closed/dolphin.off",
    the_cow_with_two_fans_at_a_vertex_keeps_its_volume: "open/cow-2903v.obj",
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_bunny_is_not_deformed_where_open_models_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    command.args(["deform", "--json", "--twist", "z=60", "--open", "refuse", "--output"]);
    let ran = command.arg(folder.path().join("bunny.ply")).arg(shared("open/bunny-35947v.ply")).output().unwrap();
    assert_eq!(ran.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!(report["error"]["code"], "open");
    assert!(report["error"]["what"].as_str().unwrap().contains("223 boundary edges"), "{report}");
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
}
