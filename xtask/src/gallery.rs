//! `cargo xtask gallery`: runs the example jobs and the demo, and makes the gallery page and its pictures anew.
//!
//! What the page says of a job is the comment at the job's head, up to its first empty line. There, a line `Volume without correction: paper
//! -28 %, here …` has the paper's number, `Vertices: paper 710322 …, here …` its number of vertices, and `Polygons: paper 6, here …` that of
//! polygons; the numbers of ours are those of the run's report.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Where the page and its pictures go, and where the demo and all models are.
const PAGE: &str = "docs/gallery.md";
const PICTURES: &str = "docs/gallery";
const WORK: &str = "target/gallery";

/// Width and height of a pose. More: larger files in the repository; less: details are lost.
const OF_PICTURE: &str = "260x260";
const OF_FILM: &str = "112x124";

const HEAD: &str = "# Gallery

Made by `cargo xtask gallery` from the jobs in `examples/jobs` and those of the demo; the numbers of ours are those of the runs. Pictures show the
model at rest, deformed by the edits, and corrected, all with one camera; here they are smaller than what the commands write. Their colours are
those of the surface, where a corrected model may still be blue: what was lost there was given back inside. Models along surfaces are at rest on
the flattened sheet, deformed along the surface, and corrected, all with the lines of the flattening grid. Nodes that settle are shown with their
springs, those of a cage with its edges; those that are held are orange. More of colours is on [pictures.md](pictures.md), more of HB's figures on
[figures.md](figures.md), more of surfaces on [surface.md](surface.md), of cages on [cage.md](cage.md).
";

/// Jobs of one kind.
struct Section {
    title: &'static str,
    /// Where the jobs are.
    from: &'static str,
    /// Where they run: there are the models that they name.
    place: &'static str,
    /// Where the page says that they are.
    shown: &'static str,
    /// What their pictures' names begin with, so that no two have the same.
    prefix: &'static str,
    /// What the page says before their commands.
    before: &'static str,
    /// What they run with besides: lattices of small pictures hide the models.
    flags: &'static [&'static str],
}

const SECTIONS: [Section; 8] = [
    Section {
        title: "The paper's figures",
        from: "examples/jobs/figures",
        place: "examples/jobs/figures",
        shown: "examples/jobs/figures",
        prefix: "",
        before: "",
        flags: &[],
    },
    Section {
        title: "Films",
        from: "examples/jobs/films",
        place: "examples/jobs/films",
        shown: "examples/jobs/films",
        prefix: "films-",
        before: "",
        flags: &[],
    },
    Section {
        title: "Locality",
        from: "examples/jobs/locality",
        place: "examples/jobs/locality",
        shown: "examples/jobs/locality",
        prefix: "locality-",
        before: "",
        flags: &[],
    },
    Section {
        title: "Along surfaces",
        from: "examples/jobs/surface",
        place: "examples/jobs/surface",
        shown: "examples/jobs/surface",
        prefix: "surface-",
        before: "",
        flags: &[],
    },
    Section {
        title: "Elastic",
        from: "examples/jobs/elastic",
        place: "examples/jobs/elastic",
        shown: "examples/jobs/elastic",
        prefix: "elastic-",
        before: "",
        flags: &[],
    },
    Section {
        title: "Cages",
        from: "examples/jobs/cage",
        place: "examples/jobs/cage",
        shown: "examples/jobs/cage",
        prefix: "cage-",
        before: "",
        flags: &[],
    },
    Section {
        title: "Jobs to try",
        from: "examples/jobs",
        place: WORK,
        shown: "examples/jobs",
        prefix: "jobs-",
        before: "isochor demo examples/jobs/isochor-demo && ",
        flags: &[],
    },
    Section {
        title: "The demo",
        from: "target/gallery/isochor-demo",
        place: "target/gallery/isochor-demo",
        shown: "isochor-demo",
        prefix: "demo-",
        before: "isochor demo && ",
        flags: &["--no-lattice"],
    },
];

/// Runs all jobs and writes the page; says why where that fails.
pub fn make() -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    std::env::set_current_dir(&root).map_err(|error| format!("{}: {error}", root.display()))?;
    for folder in [PICTURES, WORK] {
        std::fs::create_dir_all(folder).map_err(|error| format!("{folder}: {error}"))?;
    }
    for picture in [files(PICTURES, ".png")?, files(PICTURES, ".svg")?].concat() {
        std::fs::remove_file(&picture).map_err(|error| format!("{picture}: {error}"))?;
    }
    isochor(&["demo", &format!("{WORK}/isochor-demo")])?;
    let mut page = HEAD.to_owned();
    for section in &SECTIONS {
        writeln!(page, "\n## {}", section.title).expect("text");
        for job in files(section.from, ".toml")? {
            page += &entry(&job, section)?;
        }
    }
    std::fs::write(PAGE, page).map_err(|error| format!("{PAGE}: {error}"))
}

/// The files of a folder that end so, in order of their names.
fn files(folder: &str, ending: &str) -> Result<Vec<String>, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{folder}: {error}"))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut files: Vec<String> =
        names.filter(|name| name.ends_with(ending)).map(|name| format!("{folder}/{name}")).collect();
    files.sort_by(|a, b| a.trim_end_matches(ending).cmp(b.trim_end_matches(ending)));
    Ok(files)
}

/// Runs the command and gives its report.
fn isochor(arguments: &[&str]) -> Result<Value, String> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["run", "--release", "--locked", "--quiet", "-p", "isochor-cli", "--"]).args(arguments);
    let line = arguments.join(" ");
    eprintln!("$ isochor {line}");
    let ran = command.args(["--json", "--quiet"]).output().map_err(|error| format!("{line}: {error}"))?;
    if !ran.status.success() {
        return Err(format!(
            "{line}: {}{}",
            String::from_utf8_lossy(&ran.stderr),
            String::from_utf8_lossy(&ran.stdout)
        ));
    }
    serde_json::from_slice(&ran.stdout).map_err(|error| format!("{line}: {error}"))
}

/// Runs a job and gives its part of the page.
fn entry(job: &str, section: &Section) -> Result<String, String> {
    let text = std::fs::read_to_string(job).map_err(|error| format!("{job}: {error}"))?;
    let file = Path::new(job).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = file.trim_end_matches(".toml");
    let has = |key: &str| text.lines().any(|line| line.starts_with(key));
    let is_film = has("frames");
    let placed = format!("{}/{file}", section.place);
    if placed != job {
        std::fs::write(&placed, &text).map_err(|error| format!("{placed}: {error}"))?;
    }

    let base = format!("{}{}", section.prefix, stem.trim_end_matches("-film"));
    let sheet = has("sheet").then(|| format!("{base}-sheet.svg"));
    let mut names = if is_film {
        vec![format!("{base}-strip.png"), format!("{base}-film.png")]
    } else {
        vec![format!("{base}.png")]
    };
    let pictures: Vec<String> = names.iter().map(|name| format!("{PICTURES}/{name}")).collect();
    let sheet_picture = sheet.as_ref().map(|name| format!("{PICTURES}/{name}"));
    names.extend(sheet);
    let model = format!("{WORK}/{}{stem}.ply", section.prefix);
    let report = format!("{WORK}/{}{stem}.json", section.prefix);
    let size = if is_film { OF_FILM } else { OF_PICTURE };
    let mut arguments =
        vec!["deform", "--job", &placed, "-o", &model, "--report", &report, "--size", size, "--picture", &pictures[0]];
    arguments.extend(section.flags);
    if let Some(animation) = pictures.get(1) {
        arguments.extend(["--animation", animation]);
    }
    if let Some(sheet) = &sheet_picture {
        arguments.extend(["--sheet", sheet]);
    }
    let report = isochor(&arguments)?;

    let comment = text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim);
    let (mut about, mut of_paper) = (Vec::new(), OfPaper::default());
    for line in comment.take_while(|line| !line.is_empty() && !line.starts_with("In this folder")) {
        let paper = |line: &str| Some(line.strip_prefix(" paper ")?.rsplit_once(", here")?.0.to_owned());
        match line.split_once(':') {
            Some(("Volume without correction", numbers)) => of_paper.volume = paper(numbers),
            Some(("Vertices", numbers)) => of_paper.vertices = paper(numbers),
            Some(("Polygons", numbers)) => of_paper.polygons = paper(numbers),
            _ => about.push(line),
        }
    }
    let mut about = about.join(" ");
    if let Some(first) = about.get(..1).map(str::to_uppercase) {
        about.replace_range(..1, &first);
    }
    let end = if about.ends_with('.') { "" } else { "." };
    let shown = match stem.split_once('-') {
        Some((word, rest)) => format!("{word} {}", rest.replace("-film", ", film")),
        None => stem.to_owned(),
    };
    let title = format!("{}{}", shown[..1].to_uppercase(), &shown[1..]);
    let mut part = format!("\n### {title}\n\n{about}{end}\n\n");
    for name in &names {
        writeln!(part, "![{title}](gallery/{name})").expect("text");
    }
    part += &numbers(&report, of_paper);
    let flags: String = section.flags.iter().map(|flag| format!(" {flag}")).collect();
    let (before, shown) = (section.before, section.shown);
    write!(part, "\n```sh\n{before}isochor deform --job {shown}/{file}{flags}\n```\n").expect("text");
    Ok(part)
}

/// What the paper says of a job, as its comment has it.
#[derive(Default)]
struct OfPaper {
    /// Change without correction.
    volume: Option<String>,
    vertices: Option<String>,
    polygons: Option<String>,
}

/// A table of the paper's numbers and ours; without its column where it has none.
fn numbers(report: &Value, of_paper: OfPaper) -> String {
    let frames = report["frames"].as_array();
    let each = |key: &str| -> Vec<&Value> {
        match frames {
            Some(frames) => frames.iter().map(|frame| &frame[key]).collect(),
            None => vec![&report[key]],
        }
    };
    let volumes = each("volume");
    let number = |volume: &Value, key: &str| volume[key].as_f64().unwrap_or(f64::NAN);
    let changes = volumes.iter().map(|volume| 100.0 * (number(volume, "posed") / number(volume, "rest") - 1.0));
    let farthest = changes.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN);
    let error =
        volumes.iter().flat_map(|volume| errors(volume)).reduce(f64::max).map_or("none was asked".into(), |error| {
            match error {
                0.0 => "0".into(),
                error => format!("{error:.1e}"),
            }
        });
    let at = if frames.is_some() { " (the frame that changes it most)" } else { "" };
    let model = &report["model"];
    let mut rows = vec![
        (format!("volume without correction{at}"), of_paper.volume, format!("{farthest:+.2} %")),
        ("vertices".into(), of_paper.vertices, model["vertices"].to_string()),
        ("largest relative error of corrected volumes".into(), None, error),
    ];
    let surfaces = each("surface");
    if surfaces.iter().all(|surface| surface.is_object()) {
        let most = |number: &dyn Fn(&Value) -> f64| surfaces.iter().map(|surface| number(surface)).fold(0.0, f64::max);
        let added = most(&|surface| number(surface, "edge_points") + number(surface, "face_points"));
        let after = number(model, "vertices") + added;
        let [stretch, compression] =
            ["stretch", "compression"].map(|key| most(&|surface| number(&surface["flattening"], key)));
        rows.splice(
            2..2,
            [
                ("vertices after subdivision".into(), None, after.to_string()),
                ("polygons".into(), of_paper.polygons, model["faces"].to_string()),
                (
                    "largest stretch and compression of the sheet".into(),
                    None,
                    format!("{stretch:.2} %, {compression:.2} %"),
                ),
            ],
        );
    }
    let has_paper = rows.iter().any(|row| row.1.is_some());
    let mut table = if has_paper { "\n| | paper | here |\n|---|---|---|\n" } else { "\n| | |\n|---|---|\n" }.to_owned();
    for (what, paper, here) in rows {
        let paper = if has_paper { format!(" {} |", paper.unwrap_or_default()) } else { String::new() };
        writeln!(table, "| {what} |{paper} {here} |").expect("text");
    }
    table
}

/// All relative errors in a report's volumes: of the whole, of components and of parts, where a volume was asked.
fn errors(volume: &Value) -> Vec<f64> {
    let rows = ["components", "parts"].iter().filter_map(|rows| volume[rows].as_array()).flatten();
    volume["relative_error"].as_f64().into_iter().chain(rows.flat_map(errors)).collect()
}
