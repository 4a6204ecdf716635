//! `isochor bench lattice`: the paper's tables 1 and 2, this machine beside them.
//!
//! For each model of the paper there is a [`isochor::shapes::stone`] with as many triangles. Between the stages of a model the memory is
//! swept, so that a time is compared with what the memory did at that time.

use isochor::{Frame, shapes};

use crate::args::BenchLatticeArgs;
use crate::bandwidth::{Bandwidth, Sweeps};
use crate::bench::pools;
use crate::bench_tables;
use crate::failure::Failure;
use crate::median::Patience;
use crate::non_zeros::non_zeros;
use crate::paper::{self, NonZeros, Times};
use crate::plot::{self, Plot};
use crate::stages::{Bound, Stage, lattice_binding};
use crate::terminal::Terminal;

/// What was measured.
#[derive(Debug, serde::Serialize)]
pub struct LatticeBench {
    /// Whether only small models were measured, and roughly.
    pub quick: bool,
    /// Control points along each side of the lattice of all times.
    pub lattice: usize,
    /// Bytes of an array that is swept.
    pub sweep_bytes: usize,
    pub paper_machine: &'static str,
    /// The smaller first.
    pub models: Vec<ModelRow>,
}

/// A model of the paper, and one of as many faces here.
#[derive(Debug, serde::Serialize)]
pub struct ModelRow {
    pub model: &'static str,
    /// Its row of table 1.
    pub paper_non_zeros: Option<NonZeros>,
    /// Its row of table 2.
    pub paper_times: Option<Times>,
    pub vertices: usize,
    pub faces: usize,
    /// Numbers in the matrix B in a lattice of 10³ control points, and of 6³.
    pub non_zeros_in_10: usize,
    pub non_zeros_in_6: usize,
    /// Bytes of what is kept instead of B.
    pub kept_bytes: usize,
    /// With one thread, and with all.
    pub runs: Vec<Run>,
}

/// Times of a model.
#[derive(Debug, serde::Serialize)]
pub struct Run {
    pub threads: usize,
    /// Bytes per second.
    pub bandwidth: Bandwidth,
    /// One for each of [`Stage::ALL`].
    pub stages: Vec<StageTime>,
}

/// The time of a stage.
#[derive(Debug, serde::Serialize)]
pub struct StageTime {
    pub stage: &'static str,
    /// The median.
    pub ms: f64,
    /// Of so many runs.
    pub runs: usize,
    /// What the stage must touch at least once.
    pub bytes: usize,
    /// The time, in times that a reading sweep takes for these bytes.
    pub sweeps: f64,
}

impl Run {
    /// Milliseconds of a stage.
    pub fn ms(&self, stage: Stage) -> f64 {
        self.stages.iter().find(|time| time.stage == stage.name()).map_or(f64::NAN, |time| time.ms)
    }
}

/// How thoroughly to measure.
struct Effort {
    patience: Patience,
    /// Bytes of an array to sweep. More: safer from caches; less: less memory.
    sweep: usize,
    most_faces: usize,
}

/// Caches of processors have up to some hundred megabytes.
const THOROUGH: Effort = Effort { patience: Patience::THOROUGH, sweep: 512 << 20, most_faces: usize::MAX };

/// Small models are enough to see that all works.
const QUICK: Effort = Effort { patience: Patience::QUICK, sweep: 16 << 20, most_faces: 12_000 };

/// Measures, prints the tables and draws the plot.
pub fn run(args: &BenchLatticeArgs, terminal: &Terminal) -> Result<(), Failure> {
    let plot = Plot::to(args.plot.as_deref())?;
    let bench = measured(args.quick, terminal)?;
    plot.write(|| plot::of_lattice_bench(&bench))?;
    terminal.answer(&bench, &bench_tables::of_lattice_bench(&bench));
    plot.tell(terminal);
    Ok(())
}

fn measured(quick: bool, terminal: &Terminal) -> Result<LatticeBench, Failure> {
    let effort = if quick { &QUICK } else { &THOROUGH };
    let pools = pools()?;
    let mut sweeps = Sweeps::over(effort.sweep);
    let mut models = paper::models();
    models.retain(|model| model.faces() <= effort.most_faces);
    let progress = terminal.progress(models.len());
    let mut rows = Vec::with_capacity(models.len());
    for model in &models {
        progress.begin(model.name);
        let bound = Bound::stone(model.vertices(), paper::SIZE);
        let runs = pools.iter().map(|pool| pool.install(|| run_of(&bound, effort, &mut sweeps))).collect();
        rows.push(row(model, &bound, runs));
    }
    progress.end();
    Ok(LatticeBench {
        quick,
        lattice: paper::SIZE,
        sweep_bytes: sweeps.bytes(),
        paper_machine: paper::MACHINE,
        models: rows,
    })
}

/// All stages of a model with the threads of the pool it is called in.
fn run_of(bound: &Bound, effort: &Effort, sweeps: &mut Sweeps) -> Run {
    let timed = Stage::ALL.map(|stage| {
        sweeps.take();
        (stage, bound.time(stage, effort.patience))
    });
    let bandwidth = sweeps.bandwidth();
    let stage_time = |(stage, median): (Stage, crate::median::Median)| {
        let (bytes, seconds) = (bound.bytes(stage), median.time.as_secs_f64());
        let sweeps = seconds / (bytes as f64 / bandwidth.read);
        StageTime { stage: stage.name(), ms: 1e3 * seconds, runs: median.runs, bytes, sweeps }
    };
    Run { threads: rayon::current_num_threads(), bandwidth, stages: timed.map(stage_time).into() }
}

fn row(model: &paper::Model, bound: &Bound, runs: Vec<Run>) -> ModelRow {
    let mesh = shapes::stone(model.vertices());
    let count = |size: usize| {
        let frame = Frame::fitted(mesh.bounds().expect("a stone has vertices"), 0.0).expect("a stone has an extent");
        non_zeros(&lattice_binding(mesh.points(), frame, size).1, mesh.faces(), size)
    };
    ModelRow {
        model: model.name,
        paper_non_zeros: model.non_zeros,
        paper_times: model.times,
        vertices: model.vertices(),
        faces: model.faces(),
        non_zeros_in_10: count(paper::SIZE),
        non_zeros_in_6: count(paper::SMALLER_SIZE),
        kept_bytes: bound.memory(),
        runs,
    }
}
