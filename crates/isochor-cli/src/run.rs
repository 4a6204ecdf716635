//! Running commands.

use std::path::Path;
use std::process::ExitCode;

use isochor::{Outcome, PosedCage, Precision, Report, Stage, Stopwatch};
use isochor_io::{
    Document, Format, NumberType, SavedBinding, WriteOptions, Written, hash_of_cage, hash_of_points, lattice_to_json,
};
use isochor_view::{Figure, Page, Show};

use crate::args::{Cli, Command};
use crate::failure::Failure;
use crate::files::Pending;
use crate::inputs::Inputs;
use crate::model::Model;
use crate::request::{Request, Requests, has_extension};
use crate::terminal::Terminal;
use crate::{bench, cage, demo, frames, info, inputs, memory, pages, pictures, sheet_picture};

/// Runs what was asked and says with which code to end.
pub fn command(cli: Cli) -> ExitCode {
    let terminal = Terminal::new(&cli.output);
    if let Some(threads) = cli.output.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        if let Err(error) = pool.build_global() {
            return terminal.failure(&Failure::usage("--threads", error.to_string(), "leave it out to use all cores"));
        }
    }
    let result = match &cli.command {
        Command::Demo { folder } => demo::run(folder, &terminal),
        Command::Info { model } => info::run(model, &terminal),
        Command::Deform(args) => Requests::from_args(args).and_then(|requests| {
            if requests.frames() > 1 {
                let report = frames::run(&requests, &terminal)?;
                return terminal.film(&report, &requests);
            }
            let request = requests.frame(0)?;
            let report = deform(&request, &requests.text()?, &terminal)?;
            terminal.report(&report, &request);
            Ok(())
        }),
        Command::Cage(args) => cage::run(args, &terminal),
        Command::Bench { bench } => bench::run(bench, cli.output.threads, &terminal),
        Command::Completions { shell } => pages::completions(*shell),
        Command::Man { folder } => pages::man(folder.as_deref()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => terminal.failure(&failure),
    }
}

/// Runs a deformation and writes its files: all of them, or none. `asked` is the request as it was given.
pub fn deform(request: &Request, asked: &str, terminal: &Terminal) -> Result<Report, Failure> {
    let progress = terminal.progress(Stage::ALL.len() + 3);
    let mut watch = Stopwatch::start();
    progress.begin("read");
    let document = request.model.document(request.output_format)?;
    let source = request.model.source(&document);
    let inputs = Inputs::read(request, document.mesh())?;
    watch.lap("read");

    let mut outcome = request.job.run(&inputs.with(&document, &source), &mut |stage| progress.begin(stage.name()))?;

    let mut writing = Stopwatch::start();
    progress.begin("write");
    let mut pending = Pending::default();
    write(request, &document, &mut outcome, &mut pending)?;
    writing.lap("write");
    let page = request.report.as_ref().filter(|path| has_extension(path, "html"));
    let is_drawn = page.is_some() || request.picture.is_some();
    let course = is_drawn.then(|| outcome.course()).flatten();
    let rest = outcome.divided().map_or(document.mesh(), |(mesh, _)| mesh);
    let show = is_drawn.then(|| Show::of_job(rest, &outcome, course.as_ref()));
    let drawn = show.as_ref().map(|show| {
        progress.begin("draw");
        let png = pictures::of_job(show, &outcome, &request.job.view);
        writing.lap("draw");
        png
    });
    if let (Some(path), Some(png)) = (&request.picture, &drawn) {
        pending.add(path, png)?;
    }
    let mut report = outcome.report.clone();
    report.timings_ms.0.splice(0..0, watch.timings().0);
    report.timings_ms.0.extend(writing.timings().0);
    report.peak_memory = memory::peak();
    if let Some(path) = page {
        let caption =
            show.iter().flat_map(|show| &show.poses).map(|pose| &pose.name[..]).collect::<Vec<_>>().join(", ");
        let page = Page {
            title: request.model.name(),
            job: Some(asked.into()),
            report: &report,
            pictures: drawn.into_iter().map(|png| Figure { caption: caption.clone(), png }).collect(),
            show: show.as_ref(),
            up: request.job.view.up,
        };
        pending.add(path, isochor_view::page(&page).as_bytes())?;
    } else if let Some(path) = &request.report {
        pending.add(path, json(&report).as_bytes())?;
    }
    pending.commit()?;
    progress.end();
    Ok(report)
}

/// Adds the files of an outcome to those that are pending, all but its report, and to its report what was written.
pub fn write(
    request: &Request,
    document: &Document,
    outcome: &mut Outcome,
    pending: &mut Pending,
) -> Result<(), Failure> {
    let jacobians = if document.has_normals() { outcome.jacobians() } else { None };
    let (written, notes) = written(request, document, outcome, jacobians.as_deref())?;
    outcome.report.warnings.extend(notes);
    outcome.measure_written(&written.points);
    pending.add(&request.output, &written.bytes)?;
    if let Some(path) = &request.save_controls {
        match (&outcome.controls, &outcome.cage) {
            (Some(controls), _) => pending.add(path, lattice_to_json(controls).as_bytes())?,
            (None, Some(cage)) => pending.add(path, &posed_cage(request, cage, path)?)?,
            (None, None) => {
                let what = "there is no lattice to save: the job has neither a lattice nor a cage nor an edit";
                return Err(Failure::file(path, what, "leave save-controls out, or name a lattice"));
            }
        }
    }
    if let (Some(cage), Some(bound)) = (&request.job.cage, outcome.cage_binding())
        && let (Some(path), Some(posed)) = (&cage.save_weights, &outcome.cage)
    {
        let binding = SavedBinding {
            coordinates: cage.coordinates.name().into(),
            settings: inputs::settings(cage),
            model: hash_of_points(document.mesh().points()),
            cage: hash_of_cage(&posed.mesh),
            points: bound.binding().vertex_count(),
            columns: bound.binding().control_count(),
            weights: bound.weights(),
        };
        pending.add(path, &binding.to_bytes())?;
    }
    let Some(drawing) = outcome.sheet() else { return Ok(()) };
    if let Some((path, format)) = &request.save_surface {
        let sheet = drawing.sheet();
        let failed = |error: isochor_io::WriteError| Failure::write(path, &error);
        let mesh = sheet.surface().mesh(sheet.cells());
        let mesh = mesh.map_err(|error| failed(isochor_io::WriteError::Document(error.to_string())))?;
        let number = if *format == Format::Stl { NumberType::F32 } else { NumberType::F64 };
        pending.add(path, Document::from_mesh(&mesh, *format, number).map_err(failed)?.bytes())?;
    }
    if let Some(path) = &request.sheet {
        pending.add(path, sheet_picture::svg(&drawing, path)?.as_bytes())?;
    }
    Ok(())
}

/// The posed cage as a file: in the format of the cage's own, everything else that it holds is kept.
fn posed_cage(request: &Request, cage: &PosedCage, path: &Path) -> Result<Vec<u8>, Failure> {
    let failed = |error: isochor_io::WriteError| Failure::write(path, &error);
    let format = Format::from_path(path).map_err(|error| Failure::read(path, &error))?;
    let file = request.job.cage.as_ref().and_then(|cage| cage.file.as_deref());
    if let Some(file) = file.filter(|file| Format::from_path(file).is_ok_and(|of_file| of_file == format)) {
        let options = WriteOptions { precision: Precision::F64, jacobians: None };
        return Ok(inputs::document(file)?.with_points(&cage.posed, &options).map_err(failed)?.bytes);
    }
    let mesh = cage.mesh.with_points(cage.posed.clone());
    let mesh = mesh.map_err(|error| failed(isochor_io::WriteError::Document(error.to_string())))?;
    let number = if format == Format::Stl { NumberType::F32 } else { NumberType::F64 };
    Ok(Document::from_mesh(&mesh, format, number).map_err(failed)?.bytes().to_vec())
}

/// The output file's bytes, and what a user should know about them.
fn written(
    request: &Request,
    document: &Document,
    outcome: &Outcome,
    jacobians: Option<&[glam::DMat3]>,
) -> Result<(Written, Vec<String>), Failure> {
    let (points, divided) = (&outcome.points[..], outcome.divided());
    let failed = |error| Failure::write(&request.output, &error);
    let precision = request.job.precision;
    if request.output_format == document.format() {
        let options = WriteOptions { precision, jacobians };
        let written = match divided {
            Some((_, refinement)) => document.refined(points, refinement, &options),
            None => document.with_points(points, &options),
        };
        let written = written.map_err(failed)?;
        let notes = written.warnings.clone();
        return Ok((written, notes));
    }
    let number = match (precision, document.number_type()) {
        (Precision::File, NumberType::F32) => NumberType::F32,
        _ if request.output_format == Format::Stl && precision == Precision::File => NumberType::F32,
        _ => NumberType::F64,
    };
    let mesh = divided
        .map_or(document.mesh(), |(mesh, _)| mesh)
        .with_points(points.to_vec())
        .map_err(|error| Failure::write(&request.output, &isochor_io::WriteError::Document(error.to_string())))?;
    let new = Document::from_mesh(&mesh, request.output_format, number).map_err(failed)?;
    let note = format!(
        "Only points and faces were converted from {} to {}; whatever else the file holds stayed behind.",
        document.format().name(),
        request.output_format.name()
    );
    let points = match request.output_format {
        // Welded corners have other numbers there; the coordinates are 32-bit floats.
        Format::Stl => points.iter().map(|p| p.as_vec3().as_dvec3()).collect(),
        Format::Obj | Format::Ply | Format::Off => new.mesh().points().to_vec(),
    };
    let notes = match request.model {
        Model::File { .. } => vec![note],
        Model::Shape(_) => Vec::new(), // there was no file
    };
    Ok((Written { bytes: new.bytes().to_vec(), points, warnings: Vec::new() }, notes))
}

/// A report as JSON text.
pub fn json(report: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(report).expect("reports hold plain data") + "\n"
}
