//! `cargo xtask gallery`: runs the example jobs and makes the gallery page and its pictures anew.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Where pages and pictures of the gallery go.
const PAGE: &str = "docs/gallery.md";
const PICTURES: &str = "docs/gallery";

/// Width and height of a pose. More: larger files in the repository; less: details are lost.
const OF_PICTURE: &str = "300x300";
const OF_FILM: &str = "220x240";

const HEAD: &str = "# Gallery

Made by `cargo xtask gallery` from the jobs in `examples/jobs`; the numbers are those of the runs. Each job is run by
`isochor deform --job JOB.toml`. Pictures show the model at rest, deformed, and corrected to its volume at rest; colours say by what factor the
volume of a small piece changed ([pictures.md](pictures.md)). What the paper prints of its figures is on [figures.md](figures.md).
";

/// Runs all jobs and writes the page; says why where that fails.
pub fn make() -> Result<(), String> {
    let status = Command::new("cargo").args(["build", "--release", "--locked", "-p", "isochor-cli"]).status();
    if !status.is_ok_and(|status| status.success()) {
        return Err("the command does not build".into());
    }
    std::fs::create_dir_all(PICTURES).map_err(|error| format!("{PICTURES}: {error}"))?;
    let models = Path::new("target/gallery");
    std::fs::create_dir_all(models).map_err(|error| format!("{}: {error}", models.display()))?;
    let mut page = HEAD.to_owned();
    for (title, folder) in [("The paper's figures", "figures"), ("Films", "films"), ("Locality", "locality")] {
        writeln!(page, "\n## {title}").expect("text");
        for job in jobs(&format!("examples/jobs/{folder}"))? {
            page += &entry(&job, folder, models)?;
        }
    }
    std::fs::write(PAGE, page).map_err(|error| format!("{PAGE}: {error}"))
}

/// The job files of a folder, in order of their names.
fn jobs(folder: &str) -> Result<Vec<String>, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{folder}: {error}"))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path().to_str()?.to_owned()));
    let mut jobs: Vec<String> = paths.filter(|path| path.ends_with(".toml")).collect();
    jobs.sort();
    Ok(jobs)
}

/// Runs a job and gives its part of the page.
fn entry(job: &str, folder: &str, models: &Path) -> Result<String, String> {
    let text = std::fs::read_to_string(job).map_err(|error| format!("{job}: {error}"))?;
    let stem = Path::new(job).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = if folder == "figures" { stem.clone() } else { format!("{folder}-{stem}") };
    let is_film = text.lines().any(|line| line.starts_with("frames"));
    let (picture, animation) = (format!("{PICTURES}/{name}.png"), format!("{PICTURES}/{name}-film.png"));
    let model = models.join(format!("{name}.ply"));
    let mut command = Command::new("target/release/isochor");
    command.args(["deform", "--json", "--quiet", "--job", job, "--picture", &picture]).arg("-o").arg(&model);
    command
        .args(["--size", if is_film { OF_FILM } else { OF_PICTURE }])
        .arg("--report")
        .arg(model.with_extension("json"));
    if is_film {
        command.args(["--animation", &animation, "--no-lattice"]);
    }
    eprintln!("{job}");
    let ran = command.output().map_err(|error| format!("{job}: {error}"))?;
    let report: Value = serde_json::from_slice(&ran.stdout).map_err(|error| format!("{job}: {error}"))?;
    if !ran.status.success() {
        return Err(format!("{job}: {report}"));
    }

    let comments: Vec<&str> = text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim).collect();
    let about = comments.iter().take_while(|line| !line.is_empty()).copied().collect::<Vec<_>>().join(" ");
    let mut part = format!("\n### {name}\n\n{about}\n\n![{name}](gallery/{name}.png)\n");
    if is_film {
        writeln!(part, "![{name}, animated](gallery/{name}-film.png)").expect("text");
    }
    let volumes: Vec<&Value> = match report["frames"].as_array() {
        Some(frames) => frames.iter().map(|frame| &frame["volume"]).collect(),
        None => vec![&report["volume"]],
    };
    let number = |volume: &Value, key: &str| volume[key].as_f64().unwrap_or(f64::NAN);
    let changes = volumes.iter().map(|volume| 100.0 * (number(volume, "posed") / number(volume, "rest") - 1.0));
    let farthest = changes.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN);
    let error = volumes.iter().map(|volume| number(volume, "relative_error")).fold(0.0, f64::max);
    writeln!(
        part,
        "\nVolume by the edits alone: {farthest:+.2} %{}; after the correction it is met to {error:.1e}. `{job}`",
        if is_film { " in the frame that changes it most" } else { "" }
    )
    .expect("text");
    Ok(part)
}
