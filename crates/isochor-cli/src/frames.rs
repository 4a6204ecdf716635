//! `isochor deform` of a film: one model after the other, written all or not at all.

use isochor::{Examination, FilmReport, FrameReport, Health, Outcome, Stopwatch};
use isochor_io::Document;

use crate::failure::Failure;
use crate::files::Pending;
use crate::inputs::Inputs;
use crate::pictures::FilmPictures;
use crate::request::{Request, Requests};
use crate::run::{json, write};
use crate::terminal::{Progress, Terminal};

/// What there is of a frame when it has been computed.
pub struct Frame<'a> {
    /// When it is, from 0 to 1.
    pub time: f64,
    /// What was asked of it.
    pub request: &'a Request,
    /// The model at rest: read and examined once for all frames.
    pub document: &'a Document,
    /// What became of it.
    pub outcome: Outcome,
}

/// Runs a film and writes its models and its report: all files, or none.
pub fn run(requests: &Requests, terminal: &Terminal) -> Result<FilmReport, Failure> {
    let progress = terminal.progress(requests.frames() + 2);
    let mut pending = Pending::default();
    let mut frames = Vec::with_capacity(requests.frames());
    let mut pictures = FilmPictures::of(requests)?;
    let model = each(requests, &progress, &mut |frame| {
        let Frame { time, request, document, mut outcome } = frame;
        let mut writing = Stopwatch::start();
        write(request, document, &mut outcome, &mut pending)?;
        writing.lap("write");
        pictures.keep(time, request, document.mesh(), &outcome)?;
        let mut report = FrameReport::of(time, outcome.report);
        report.timings_ms.0.extend(writing.timings().0);
        frames.push(report);
        Ok(())
    })?;
    let first = requests.frame(0)?;
    progress.begin("draw");
    pictures.draw(&first.job.view, &mut pending)?;
    let report = FilmReport { version: env!("CARGO_PKG_VERSION").into(), model, frames };
    if let Some(path) = &first.report {
        pending.add(path, json(&report).as_bytes())?;
    }
    pending.commit()?;
    progress.end();
    Ok(report)
}

/// Computes all frames in order and hands each to `on_frame`. Gives what the model is.
pub fn each(
    requests: &Requests,
    progress: &Progress,
    on_frame: &mut dyn FnMut(Frame) -> Result<(), Failure>,
) -> Result<Health, Failure> {
    let first = requests.frame(0)?;
    progress.begin("read");
    let document = first.model.document(first.output_format)?;
    let (source, inputs) = (first.model.source(&document), Inputs::read(&first, document.mesh())?);
    let input = inputs.with(&document, &source);
    let examination = Examination::of(input.mesh, &source);
    for number in 0..requests.frames() {
        progress.begin("frames");
        let (request, time) = (requests.frame(number)?, requests.time(number));
        let outcome = request.job.run_examined(&examination, &input, &mut |_| {});
        let outcome = outcome.map_err(|error| Failure::from(error).at_time(number, time))?;
        on_frame(Frame { time, request: &request, document: &document, outcome })?;
    }
    Ok(examination.health)
}
