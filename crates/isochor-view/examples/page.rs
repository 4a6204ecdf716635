//! Report pages of real jobs: `cargo run -p isochor-view --example page -- FOLDER [MODEL JOB.toml [UP]]`.
//!
//! Without a model, some built-in shapes; with one, that model and a job file; y is up if UP is `y`. An index page leads to them.

use std::error::Error;
use std::path::{Path, PathBuf};

use isochor::{Axis, Job, JobInput, Mesh, Source, shapes};
use isochor_io::{Document, Format};
use isochor_view::{IndexEntry, Page, Show, index, page};

/// A built-in shape and its job.
struct Story {
    name: &'static str,
    mesh: fn() -> Mesh,
    job: &'static str,
}

const STORIES: [Story; 4] = [
    Story {
        name: "cube",
        mesh: || shapes::cube(32),
        job: "[lattice]\nsize = 8\n\n[[edit]]\ntwist = { axis = \"z\", degrees = 150 }\n\n[preserve]\naxes = \"xy\"\n",
    },
    Story {
        name: "flask",
        mesh: || shapes::hollow_bottle(96, 120, 0.05),
        job: "[lattice]\nsize = [6, 6, 10]\nmargin = 0.05\n\n[[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n[[edit]]\ntaper = { axis = \"z\", scale = 0.7 }\n\n[preserve]\nvolume = { material = \"100%\", capacity = \"110%\" }\npin = { k = [0, 1] }\n",
    },
    Story {
        name: "chain",
        mesh: || shapes::chain(24, 36, 18),
        job: "[lattice]\nsize = [10, 6, 6]\n\n[[edit]]\nbend = { axis = \"x\", degrees = 100, towards = \"z\" }\n\n[preserve]\nvolume = \"each\"\n",
    },
    Story {
        name: "large ball",
        mesh: || shapes::icosphere(7),
        job: "[[edit]]\nstretch = { axis = \"z\", scale = 0.4 }\n\n[preserve]\naxes = \"xy\"\n",
    },
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let folder = arguments.next().ok_or("name a folder for the pages")?;
    std::fs::create_dir_all(&folder)?;
    let mut entries = Vec::new();
    match (arguments.next(), arguments.next()) {
        (Some(model), Some(job)) => {
            let up = if arguments.next().is_some_and(|up| up == Path::new("y")) { Axis::Y } else { Axis::Z };
            let document = Document::parse(std::fs::read(&model)?, Format::from_path(&model)?)?;
            let name = model.file_stem().map_or_else(|| "model".into(), |name| name.to_string_lossy().into_owned());
            entries.push(written(&folder, &name, document.mesh(), &std::fs::read_to_string(job)?, up)?);
        }
        _ => {
            for story in &STORIES {
                entries.push(written(&folder, story.name, &(story.mesh)(), story.job, Axis::Z)?);
            }
        }
    }
    std::fs::write(folder.join("index.html"), index("Pages", &entries))?;
    Ok(())
}

/// Runs the job, writes its page, and gives what the index says of it.
fn written(folder: &Path, name: &str, mesh: &Mesh, text: &str, up: Axis) -> Result<IndexEntry, Box<dyn Error>> {
    let job = Job::from_toml(text)?;
    let outcome =
        job.run(&JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage: None }, &mut |_| {})?;
    let course = outcome.course();
    let show = Show::of_job(mesh, &outcome, course.as_ref());
    let report = &outcome.report;
    let contents =
        Page { title: name.into(), job: Some(text.into()), report, pictures: Vec::new(), show: Some(&show), up };
    let html = page(&contents);
    let file = format!("{name}.html");
    std::fs::write(folder.join(&file), &html)?;
    println!("{file}: {:.1} MB", html.len() as f64 / 1e6);
    let row = report.volume.as_ref().map(|volume| volume.overall);
    Ok(IndexEntry {
        title: name.into(),
        sentence: format!("{} faces", mesh.faces().len()),
        picture: None,
        lines: row.iter().map(|row| format!("volume {} → {} → {}", row.rest, row.posed, row.corrected)).collect(),
        files: vec![("report".into(), file)],
    })
}
