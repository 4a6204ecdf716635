//! A picture of a job: at rest, deformed, corrected, coloured by local volume change.
//!
//! `cargo run --release -p isochor-view --example picture -- PICTURE.png [MODEL [JOB.toml]]`
//!
//! Without a model: a torus; without a job: a twist and a squash. The words `plain`, `displacement`, `stress` and `y-up`
//! change how it looks.

use std::path::Path;

use isochor::{Axis, Job, JobInput, Source, shapes};
use isochor_io::Document;
use isochor_view::{Coloring, PictureOptions, Show, View, picture};

const JOB: &str = "
    [lattice]
    size = [5, 5, 5]
    [[edit]]
    twist = { axis = 'z', degrees = 100 }
    [[edit]]
    stretch = { axis = 'z', scale = 0.7 }
    [preserve]
    volume = '100%'
";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (words, paths): (Vec<_>, Vec<_>) =
        std::env::args().skip(1).partition(|word| ["plain", "displacement", "stress", "y-up"].contains(&word.as_str()));
    let has = |word: &str| words.iter().any(|w| w == word);
    let path = paths.first().ok_or("where should the picture go? picture PICTURE.png [MODEL [JOB.toml]]")?;
    let mesh = match paths.get(1) {
        Some(model) => Document::read(Path::new(model))?.mesh().clone(),
        None => shapes::uv_torus(1.0, 0.45, 128, 64),
    };
    let job = match paths.get(2) {
        Some(job) => Job::from_toml(&std::fs::read_to_string(job)?)?,
        None => Job::from_toml(JOB)?,
    };
    let outcome = job.run(
        &JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None },
        &mut |_stage| {},
    )?;
    let course = outcome.course();
    let mut show = Show::of_job(&mesh, &outcome, course.as_ref());
    let colorings =
        [("plain", Coloring::Plain), ("displacement", Coloring::Displacement), ("stress", Coloring::Stress)];
    let coloring = colorings.into_iter().find(|(word, _)| has(word)).map_or(Coloring::VolumeChange, |named| named.1);
    if coloring == Coloring::Stress {
        show = show.with_stress(&outcome);
    }
    let view = View { up: if has("y-up") { Axis::Y } else { Axis::Z }, ..View::default() };
    let options = PictureOptions { coloring, view, ..PictureOptions::default() };
    let start = std::time::Instant::now();
    let png = picture(&show, &options).png();
    println!("{} faces, {} poses: drawn in {:.0?}", mesh.faces().len(), show.poses.len(), start.elapsed());
    std::fs::write(path, png)?;
    Ok(())
}
