//! What a person sees on standard error, and a program on standard output.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use isochor::{ComponentHealth, FilmReport, Health, PartRow, Report, Role, Shell, VolumeReport};

use crate::args::OutputArgs;
use crate::failure::Failure;
use crate::pictures::FilmPictures;
use crate::request::{Request, Requests};
use crate::run::json;

/// Where output goes.
pub struct Terminal {
    json: bool,
    quiet: bool,
}

impl Terminal {
    pub fn new(args: &OutputArgs) -> Self {
        Self { json: args.json, quiet: args.quiet }
    }

    /// Says nothing.
    pub fn silent() -> Self {
        Self { json: false, quiet: true }
    }

    /// A line for people.
    pub fn say(&self, line: &str) {
        if !self.quiet {
            write(&mut std::io::stderr(), &format!("{line}\n"));
        }
    }

    /// Data for programs, if they asked for it.
    pub fn data(&self, data: &impl serde::Serialize) {
        if self.json {
            write(&mut std::io::stdout(), &json(data));
        }
    }

    /// What was asked for, as data for programs or as text for people, on standard output.
    pub fn answer(&self, data: &impl serde::Serialize, text: &str) {
        self.data(data);
        if !self.json && !self.quiet {
            write(&mut std::io::stdout(), text);
        }
    }

    /// Tells of a failure and gives its exit code.
    pub fn failure(&self, failure: &Failure) -> ExitCode {
        #[derive(serde::Serialize)]
        struct Reported<'a> {
            error: &'a Failure,
        }
        self.data(&Reported { error: failure });
        if !(self.json && self.quiet) {
            let text = format!("error: {}\n  where: {}\n   hint: {}\n", failure.what, failure.place, failure.hint);
            write(&mut std::io::stderr(), &text);
        }
        ExitCode::from(failure.exit)
    }

    /// Shows stages as they begin, where standard error is a terminal.
    pub fn progress(&self, stages: usize) -> Progress {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template("{bar:24.cyan} {msg} {elapsed}").expect("the template is well formed");
        Progress(ProgressBar::with_draw_target(Some(stages as u64), target).with_style(style))
    }

    /// Tells what a model is.
    pub fn health(&self, path: &Path, health: &Health) {
        self.data(health);
        if self.json || self.quiet {
            return;
        }
        let yes = |flag: bool| if flag { "yes" } else { "no" };
        let mut text = format!("{}: {}\n", path.display(), health.verdict.sentence());
        let rows = [
            ("format", health.format.clone()),
            (
                "vertices",
                format!(
                    "{} ({} unused, {} coincident)",
                    health.vertices, health.unused_vertices, health.coincident_vertices
                ),
            ),
            (
                "faces",
                format!("{} ({} triangles, {} without area)", health.faces, health.triangles, health.zero_area_faces),
            ),
            ("components", health.components.to_string()),
            ("boundary", format!("{} edges in {} loops", health.boundary_edges, health.boundary_loops)),
            ("closed", format!("{} ({} edges with more than two faces)", yes(health.closed), health.nonmanifold_edges)),
            ("oriented", yes(health.oriented).into()),
            ("balanced", yes(health.balanced).into()),
            ("genus", health.genus.map_or("undefined".into(), |g| g.to_string())),
            ("bounds", health.bounds.map_or("none".into(), |[low, high]| format!("{low:?} to {high:?}"))),
            ("area", format!("{}", health.area)),
            ("volume", health.volume.as_ref().map_or("undefined".into(), |v| v.total.to_string())),
        ];
        for (name, value) in rows {
            text += &format!("  {name:<11} {value}\n");
        }
        for line in component_lines(&health.roles) {
            text += &format!("  {line}\n");
        }
        for warning in &health.warnings {
            text += &format!("  note: {warning}\n");
        }
        write(&mut std::io::stdout(), &text);
    }

    /// Tells what a deformation did.
    pub fn report(&self, report: &Report, request: &Request) {
        self.data(report);
        for warning in &report.warnings {
            self.say(&format!("note: {warning}"));
        }
        for line in volume_lines(report) {
            self.say(&line);
        }
        let others = [&request.save_controls, &request.picture, &request.report];
        for path in [&request.output].into_iter().chain(others.into_iter().flatten()) {
            self.say(&format!("wrote {}", path.display()));
        }
    }

    /// Tells what became of a film.
    pub fn film(&self, report: &FilmReport, requests: &Requests) -> Result<(), Failure> {
        self.data(report);
        let frames = report.frames.len();
        for (number, frame) in report.frames.iter().enumerate() {
            for warning in &frame.warnings {
                // What holds of every frame is told once.
                if number == 0 || !report.frames[0].warnings.contains(warning) {
                    self.say(&format!("note: frame {}: {warning}", number + 1));
                }
            }
        }
        for line in film_lines(report) {
            self.say(&line);
        }
        let [first, last] = [0, frames - 1].map(|frame| requests.frame(frame));
        let (first, last) = (first?, last?);
        let ends =
            [(Some(&first.output), Some(&last.output)), (first.save_controls.as_ref(), last.save_controls.as_ref())];
        for (first, last) in ends {
            if let (Some(first), Some(last)) = (first, last) {
                self.say(&format!("wrote {frames} files, {} to {}", first.display(), last.display()));
            }
        }
        let FilmPictures { strip, animation, .. } = FilmPictures::of(requests)?;
        for path in [strip, animation, first.report].into_iter().flatten() {
            self.say(&format!("wrote {}", path.display()));
        }
        Ok(())
    }
}

/// What became of the volume in all frames, for people.
fn film_lines(report: &FilmReport) -> Vec<String> {
    let rows: Vec<&VolumeReport> = report.frames.iter().filter_map(|frame| frame.volume.as_ref()).collect();
    let Some(first) = rows.first() else { return vec!["volume: the model bounds no body".into()] };
    let rest = first.overall.rest;
    let span = |name: &str, volume: fn(&VolumeReport) -> f64| {
        let ends = |ends: (f64, f64), row: &&VolumeReport| (ends.0.min(volume(row)), ends.1.max(volume(row)));
        let (low, high) = rows.iter().fold((f64::INFINITY, f64::NEG_INFINITY), ends);
        let [less, more] = [low, high].map(|volume| 100.0 * (volume / rest - 1.0));
        format!("       {name:<9} {} to {} ({less:+.3} % to {more:+.3} %)", significant(low), significant(high))
    };
    let parts = |row: &VolumeReport| row.parts.iter().map(|part| part.row).chain([row.overall]).collect::<Vec<_>>();
    let errors: Vec<f64> = rows.iter().flat_map(|row| parts(row)).filter_map(|row| row.relative_error).collect();
    let mut last = span("final", |row| row.overall.corrected);
    if !errors.is_empty() {
        last += &format!(", relative error at most {:.1e}", errors.into_iter().fold(0.0, f64::max));
    }
    vec![format!("volume at rest   {}", significant(rest)), span("posed", |row| row.overall.posed), last]
}

/// More components, or cavities of one, than anybody reads.
const MOST_LISTED: usize = 10;

/// The components of a model that has several, for people.
fn component_lines(components: &[ComponentHealth]) -> Vec<String> {
    if components.len() < 2 {
        return Vec::new();
    }
    let line = |(c, component): (usize, &ComponentHealth)| {
        let ComponentHealth { volume, role, capacity, material } = component;
        let role = match role {
            Role::Cavity { of } => {
                return format!("component {c}: cavity of component {of}, capacity {}", significant(volume.abs()));
            }
            Role::Solid => "solid".into(),
            Role::Shell(Shell { cavities, .. }) => format!(
                "shell with {} {}: capacity {}, material {}",
                if cavities.len() == 1 { "cavity" } else { "cavities" },
                listed(cavities),
                significant(capacity.unwrap_or_default()),
                significant(material.unwrap_or_default())
            ),
            Role::Inward => "wound inwards, inside nothing".into(),
            Role::Nothing => "encloses nothing".into(),
        };
        format!("component {c}: volume {}, {role}", significant(*volume))
    };
    let mut lines: Vec<String> = components.iter().enumerate().take(MOST_LISTED).map(line).collect();
    if components.len() > MOST_LISTED {
        lines.push(format!("… and {} more; --json lists all", components.len() - MOST_LISTED));
    }
    lines
}

/// Numbers of components, as many as one reads.
fn listed(components: &[usize]) -> String {
    let names: Vec<String> = components.iter().take(MOST_LISTED).map(usize::to_string).collect();
    let more = components.len() - names.len();
    names.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

/// The way of the volume through a job, for people.
pub fn volume_lines(report: &Report) -> Vec<String> {
    let Some(volume) = &report.volume else { return vec!["volume: the model bounds no body".into()] };
    let row = volume.overall;
    let change = |volume: f64| format!("{} ({:+.3} %)", significant(volume), 100.0 * (volume / row.rest - 1.0));
    let mut lines =
        vec![format!("volume at rest   {}", significant(row.rest)), format!("       posed     {}", change(row.posed))];
    if let (Some(target), Some(error)) = (row.target, row.relative_error) {
        lines.push(format!("       target    {}", change(target)));
        lines.push(format!("       final     {}, relative error {error:.1e}", change(row.corrected)));
        if let Some(written) = row.written {
            let error = ((written - target) / target).abs();
            lines.push(format!("       written   {}, relative error {error:.1e}", change(written)));
        }
    } else if !volume.parts.is_empty() {
        lines.push(format!("       final     {}", change(row.corrected)));
    }
    lines.extend(part_lines(&volume.parts, &report.model.roles));
    if row.target.is_some() || !volume.parts.is_empty() {
        let correction = &report.correction;
        lines.push(format!(
            "correction: {}, {}, {} step{}; vertices moved by at most {:.3e} ({:.2} % of the extent)",
            correction.method,
            correction.status,
            correction.iterations,
            if correction.iterations == 1 { "" } else { "s" },
            correction.max_displacement,
            100.0 * correction.max_displacement_relative
        ));
    }
    if let Some(elastic) = &report.elastic {
        lines.push(format!(
            "elastic: {} of {} nodes settled by {} steps ({}), energy {} → {}",
            elastic.free,
            elastic.free + elastic.held,
            elastic.steps,
            elastic.solver,
            significant(elastic.energy_posed),
            significant(elastic.energy)
        ));
    }
    lines
}

/// What became of each of several volumes of a model with these components, for people.
fn part_lines(parts: &[PartRow], model: &[ComponentHealth]) -> Vec<String> {
    let is_cavity = |c: &usize| matches!(model[*c].role, Role::Cavity { .. });
    let cavities = (0..model.len()).filter(is_cavity).count();
    let name = |components: &[usize]| {
        let are_cavities = components.iter().all(is_cavity);
        match components.len() {
            1 if are_cavities => format!("cavity {}", listed(components)),
            1 => format!("component {}", listed(components)),
            all if all == model.len() && cavities > 0 => "material".into(),
            _ if are_cavities => format!("cavities {}", listed(components)),
            _ => format!("components {}", listed(components)),
        }
    };
    let line = |PartRow { components, row }: &PartRow| {
        let change = |volume: f64| format!("{} ({:+.3} %)", significant(volume), 100.0 * (volume / row.rest - 1.0));
        let error = row.relative_error.map_or_else(String::new, |error| format!(", relative error {error:.1e}"));
        let (posed, end) = (change(row.posed), change(row.corrected));
        format!("{}: posed {posed}, final {end}{error}", name(components))
    };
    let mut lines: Vec<String> = parts.iter().take(MOST_LISTED).map(line).collect();
    if parts.len() > MOST_LISTED {
        lines.push(format!("… and {} more volumes; --json lists all", parts.len() - MOST_LISTED));
    }
    lines
}

/// Writes what can be written: a reader that has gone away (`| head`) is no failure.
pub fn write(stream: &mut dyn Write, text: &str) {
    let _ = stream.write_all(text.as_bytes()).and_then(|()| stream.flush());
}

/// A number with 13 significant digits, without an exponent where that reads well.
fn significant(x: f64) -> String {
    const DIGITS: i32 = 13;
    let exponent = if x == 0.0 { 0 } else { x.abs().log10().floor() as i32 };
    match exponent {
        -5..DIGITS => format!("{x:.*}", (DIGITS - 1 - exponent) as usize),
        _ => format!("{x:.*e}", DIGITS as usize - 1),
    }
}

/// The stages of a job on a progress bar.
pub struct Progress(ProgressBar);

impl Progress {
    pub fn begin(&self, stage: &'static str) {
        self.0.set_message(stage);
        self.0.inc(1);
    }

    pub fn end(&self) {
        self.0.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use isochor::{Job, JobInput, Source, VolumeRow, shapes};

    use super::*;

    #[test]
    fn several_volumes_have_a_line_each_up_to_a_limit() {
        let mesh = shapes::hollow_sphere(1, 0.5);
        let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
        let mut report = Job::default().run(&input, &mut |_| {}).unwrap().report;
        assert_eq!(volume_lines(&report).len(), 2, "nothing was asked");
        let (target, relative_error) = (Some(2.0), Some(0.0));
        let row = VolumeRow { rest: 1.0, posed: 0.5, target, corrected: 2.0, written: None, relative_error };
        let parts = |components: &[usize]| PartRow { components: components.to_vec(), row };
        let volume = report.volume.as_mut().unwrap();
        volume.parts = vec![parts(&[1]), parts(&[0, 1])];
        volume.parts.extend([0; 20].map(|c| parts(&[c])));
        let lines = volume_lines(&report);
        let change = "posed 0.5000000000000 (-50.000 %), final 2.000000000000 (+100.000 %), relative error 0.0e0";
        assert_eq!(lines[3], format!("cavity 1: {change}"));
        assert_eq!(lines[4], format!("material: {change}"));
        assert_eq!(lines[13], "… and 12 more volumes; --json lists all");
        assert!(lines[14].starts_with("correction: ") && lines.len() == 15, "{lines:?}");
        assert_eq!(listed(&(0..12).collect::<Vec<_>>()), "0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more");
    }
}
