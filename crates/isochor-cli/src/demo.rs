//! `isochor demo`: the main job on built-in shapes.

use std::path::Path;

use isochor::{Mesh, Report, VolumeTarget, shapes};
use isochor_io::{Document, Format, NumberType};
use isochor_view::IndexEntry;

use crate::args::DeformArgs;
use crate::failure::Failure;
use crate::files::Pending;
use crate::request::{Request, Requests};
use crate::run::{deform, json};
use crate::terminal::{Terminal, volume_lines};

/// A shape, what is done to it, and why one would want that.
struct Story {
    name: &'static str,
    about: &'static str,
    mesh: fn() -> Mesh,
    extension: &'static str,
    /// The job, less its files.
    job: &'static str,
}

const STORIES: [Story; 7] = [
    Story {
        name: "ball",
        about: "a ball is flattened to 40 % of its height; it grows sideways only, as squash and stretch should",
        mesh: || shapes::icosphere(5),
        extension: "ply",
        job: "[lattice]\nsize = 6\nknots = \"uniform\"\n\n[[edit]]\nstretch = { axis = \"z\", scale = 0.4 }\n\n[preserve]\naxes = \"xy\"\n",
    },
    Story {
        name: "cube",
        about: "a cube is twisted by 150 degrees; the correction leaves top and bottom flat",
        mesh: || shapes::cube(32),
        extension: "obj",
        job: "[lattice]\nsize = 8\n\n[[edit]]\ntwist = { axis = \"z\", degrees = 150 }\n\n[preserve]\naxes = \"xy\"\n",
    },
    Story {
        name: "bottle",
        about: "a bottle is tapered and holds 10 % more than before; its foot stays where it is",
        mesh: || shapes::bottle(96, 120),
        extension: "stl",
        job: "[lattice]\nsize = [6, 6, 10]\nmargin = 0.05\n\n[[edit]]\ntaper = { axis = \"z\", scale = 0.7 }\n\n[preserve]\nvolume = \"110%\"\npin = { k = [0, 1] }\n",
    },
    Story {
        name: "ring",
        about: "a ring is bent by 100 degrees and keeps its volume, corrected in all directions at once",
        mesh: || shapes::uv_torus(1.0, 0.3, 96, 48),
        extension: "ply",
        job: "[lattice]\nsize = [10, 6, 6]\n\n[[edit]]\nbend = { axis = \"x\", degrees = 100, towards = \"z\" }\n",
    },
    Story {
        name: "flask",
        about: "a hollow flask is twisted and narrowed; it holds 10 % more of the same amount of glass, and its foot stays",
        mesh: || shapes::hollow_bottle(96, 120, 0.05),
        extension: "ply",
        job: "[lattice]\nsize = [6, 6, 10]\nmargin = 0.05\n\n[[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n[[edit]]\ntaper = { axis = \"z\", scale = 0.7 }\n\n[preserve]\nvolume = { material = \"100%\", capacity = \"110%\" }\npin = { k = [0, 1] }\n",
    },
    Story {
        name: "ear",
        about: "the tip of an ear is pulled to an exact place; the correction of the volume stays near it",
        mesh: || shapes::eared_ball(5),
        extension: "ply",
        job: "[lattice]\nsize = 10\n\n[[edit]]\ndrag = { vertex = 3, to = [0, 1.2, 1.8] }\n\n[preserve]\nfalloff = { vertex = 3, radius = 0.1 }\n",
    },
    Story {
        name: "chain",
        about: "a chain is bent by 100 degrees, and every link keeps its own volume",
        mesh: || shapes::chain(5, 72, 36),
        extension: "ply",
        job: "[lattice]\nsize = [10, 6, 6]\n\n[[edit]]\nbend = { axis = \"x\", degrees = 100, towards = \"z\" }\n\n[preserve]\nvolume = \"each\"\n",
    },
];

/// What is in the folder afterwards, for whoever opens it.
const README: &str =
    "Open index.html. Each story NAME has its model NAME.*, its job NAME.toml, the plain deformation NAME-deformed.*, the one with exact
volume NAME-corrected.*, a picture NAME.png and a report page NAME.html. demo.json holds all reports.
Change a job and run it again: isochor deform --job NAME.toml

";

/// Writes the stories to `folder` and runs them.
pub fn run(folder: &Path, terminal: &Terminal) -> Result<(), Failure> {
    let failed = |error: std::io::Error| {
        Failure::file(folder, format!("the folder cannot be made: {error}"), "choose a folder that can be written to")
    };
    std::fs::create_dir_all(folder).map_err(failed)?;
    let silent = Terminal::silent();
    let mut reports = serde_json::Map::new();
    let mut readme = String::from(README);
    let mut entries = Vec::with_capacity(STORIES.len());
    for story in &STORIES {
        let report = story.run(folder, &silent)?;
        terminal.say(&format!("{}: {}", story.name, story.about));
        for line in volume_lines(&report) {
            terminal.say(&format!("  {line}"));
        }
        readme += &format!("{}: {}.\n", story.name, story.about);
        entries.push(story.entry(&report));
        reports.insert(story.name.into(), serde_json::to_value(&report).expect("reports hold plain data"));
    }
    let mut pending = Pending::default();
    pending.add(&folder.join("demo.json"), json(&reports).as_bytes())?;
    pending.add(&folder.join("README.txt"), readme.as_bytes())?;
    let page = folder.join("index.html");
    pending.add(&page, isochor_view::index("Exact volume: what isochor does", &entries).as_bytes())?;
    pending.commit()?;
    terminal.data(&reports);
    terminal.say(&format!("open {}", page.display()));
    Ok(())
}

impl Story {
    /// Writes the model and the job, runs the job with and without correction, and gives the report of the former.
    fn run(&self, folder: &Path, terminal: &Terminal) -> Result<Report, Failure> {
        let Self { name, extension, .. } = self;
        let model = folder.join(format!("{name}.{extension}"));
        let format = Format::from_path(&model).map_err(|error| Failure::read(&model, &error))?;
        let number = if format == Format::Stl { NumberType::F32 } else { NumberType::F64 };
        let document =
            Document::from_mesh(&(self.mesh)(), format, number).map_err(|error| Failure::write(&model, &error))?;
        let job = format!(
            "# {}\nmodel = \"{name}.{extension}\"\noutput = \"{name}-corrected.{extension}\"\npicture = \
             \"{name}.png\"\nreport = \"{name}.html\"\n\n{}",
            self.about, self.job
        );
        let path = folder.join(format!("{name}.toml"));
        let mut pending = Pending::default();
        pending.add(&model, document.bytes())?;
        pending.add(&path, job.as_bytes())?;
        pending.commit()?;

        let corrected = Requests::from_args(&DeformArgs { job: Some(path), ..DeformArgs::default() })?.frame(0)?;
        let mut plain = corrected.job.clone();
        plain.output = Some(folder.join(format!("{name}-deformed.{extension}")));
        (plain.report, plain.picture) = (None, None);
        plain.preserve.volume = VolumeTarget::Free;
        deform(&Request::from_job(plain, None, false)?, &job, terminal)?;
        deform(&corrected, &job, terminal)
    }

    /// What the index page says of it.
    fn entry(&self, report: &Report) -> IndexEntry {
        let Self { name, extension, .. } = self;
        let file = |what: &str, path: String| (what.to_owned(), path);
        IndexEntry {
            title: (*name).into(),
            sentence: format!("{}.", self.about),
            picture: Some(format!("{name}.png")),
            lines: volume_lines(report),
            files: vec![
                file("report", format!("{name}.html")),
                file("job", format!("{name}.toml")),
                file("at rest", format!("{name}.{extension}")),
                file("deformed", format!("{name}-deformed.{extension}")),
                file("corrected", format!("{name}-corrected.{extension}")),
            ],
        }
    }
}
