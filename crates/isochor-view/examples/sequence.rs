//! An animation and a strip of frames: a bottle is bent, and keeps its volume.
//!
//! `cargo run --release -p isochor-view --example sequence -- ANIMATION.png STRIP.png`

use isochor::{Job, JobInput, Source, shapes};
use isochor_view::{
    Coloring, PictureOptions, Show, ShownLattice, ShownPose, StripOptions, animated_png, frames, strip,
};

/// Number of frames.
const FRAMES: usize = 24;

/// The largest bend in degrees.
const DEGREES: f64 = 120.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [animation, sheet] = &paths[..] else { return Err("sequence ANIMATION.png STRIP.png".into()) };
    let mesh = shapes::bottle(96, 120);
    let mut poses = Vec::new();
    for frame in 0..FRAMES {
        let degrees = DEGREES * frame as f64 / (FRAMES - 1) as f64;
        let bend = format!("bend = {{ axis = 'z', towards = 'x', degrees = {degrees} }}");
        let job = format!("[lattice]\nsize = [4, 4, 8]\n[[edit]]\n{bend}\n[preserve]\nvolume = '100%'");
        let job = Job::from_toml(&job)?;
        let outcome = job.run(
            &JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None },
            &mut |_stage| {},
        )?;
        let course = outcome.course().ok_or("a bend deforms")?;
        let controls = outcome.controls.ok_or("a bend deforms")?;
        poses.push(ShownPose {
            name: format!("{degrees:.0}°"),
            points: outcome.points.into(),
            lattice: Some(ShownLattice {
                size: controls.lattice.size(),
                controls: controls.posed.into(),
                net: None,
                planes: Vec::new(),
            }),
            volume: outcome.report.volume.map(|volume| volume.overall.corrected),
            volume_change: Some(course.corrected_change.into()),
            stress: None,
        });
    }
    let show = Show { faces: mesh.faces(), poses };
    let picture = PictureOptions { panel: [360, 360], coloring: Coloring::VolumeChange, ..PictureOptions::default() };
    let there = frames(&show, &picture);
    let back = there.iter().rev().skip(1).take(FRAMES - 2).cloned();
    let film: Vec<_> = there.iter().cloned().chain(back).collect();
    std::fs::write(animation, animated_png(&film, 50)?)?;
    let title = Some("A bottle, bent at constant volume".to_owned());
    let chosen = Some((0..FRAMES).step_by(3).collect());
    let options = StripOptions { picture: PictureOptions { title, ..picture }, chosen, columns: Some(4) };
    std::fs::write(sheet, strip(&show, &options).png())?;
    Ok(())
}
