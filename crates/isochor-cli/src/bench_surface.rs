//! `isochor bench surface`: table 1 of the paper about surfaces, this machine beside it, and its figure 3 for this machine.
//!
//! For each surface of the paper, and what is laid along it, there is a [`StandIn`]. *Flatten* is all of [`isochor::flatten`], with its
//! report; *deform* is all that follows when the model has its place on the sheet: its faces are divided, and its vertices go to the surface.

use isochor::{FlattenOptions, Flattened, Surface, flatten};

use crate::args::BenchSurfaceArgs;
use crate::bench::pools;
use crate::bench_tables;
use crate::failure::Failure;
use crate::median::{Median, Patience, median};
use crate::paper::{self, SurfaceTimes};
use crate::plot::{self, Plot};
use crate::stand_in::{StandIn, stand_ins};
use crate::terminal::Terminal;

/// Cells along both directions for figure 3.
const GRIDS: [usize; 7] = [5, 10, 16, 20, 32, 50, 100];

/// Those up to this are enough to see that all works.
const QUICK_GRID: usize = 10;

/// Grid steps over which lengths are kept for figure 3: the paper's r.
const REACHES: [usize; 3] = [1, 2, 3];

/// What was measured.
#[derive(Debug, serde::Serialize)]
pub struct SurfaceBench {
    /// Whether only small grids were measured, and roughly.
    pub quick: bool,
    pub paper_machine: &'static str,
    /// Grid steps over which lengths are kept along `surfaces`.
    pub reach: usize,
    /// One for each row of the paper's table 1.
    pub surfaces: Vec<SurfaceRow>,
    /// For the paper's figure 3, the smaller first: of the second of the surfaces, which cannot be flattened without stretch.
    pub grids: Vec<GridRow>,
}

/// A row of the paper's table 1, and what stands in for its surface and model here.
#[derive(Debug, serde::Serialize)]
pub struct SurfaceRow {
    pub paper: SurfaceTimes,
    pub stand_in: &'static str,
    /// Of its model.
    pub model_faces: usize,
    /// Of the deformed model, with what dividing added.
    pub vertices: usize,
    pub faces: usize,
    /// Largest stretch and compression of the sheet, in percent.
    pub stretch: f64,
    pub compression: f64,
    /// With one thread, and with all.
    pub runs: Vec<SurfaceRun>,
}

/// Times along a surface.
#[derive(Debug, serde::Serialize)]
pub struct SurfaceRun {
    pub threads: usize,
    pub flatten: Time,
    pub deform: Time,
}

/// A number of grid cells.
#[derive(Debug, serde::Serialize)]
pub struct GridRow {
    /// Along both directions.
    pub cells: usize,
    /// One for each of r = 1, 2, 3.
    pub reaches: Vec<ReachRow>,
}

/// A grid, flattened with lengths kept so far.
#[derive(Debug, serde::Serialize)]
pub struct ReachRow {
    pub reach: usize,
    /// Cells of the sheet that are folded.
    pub folded: usize,
    /// With one thread, and with all.
    pub runs: Vec<ReachRun>,
}

/// The time of flattening.
#[derive(Debug, serde::Serialize)]
pub struct ReachRun {
    pub threads: usize,
    pub flatten: Time,
}

/// A median time.
#[derive(Debug, serde::Serialize)]
pub struct Time {
    pub ms: f64,
    /// Of so many runs.
    pub runs: usize,
}

impl From<Median> for Time {
    fn from(median: Median) -> Self {
        Self { ms: 1e3 * median.time.as_secs_f64(), runs: median.runs }
    }
}

/// Measures, prints the tables and draws the plot.
pub fn run(args: &BenchSurfaceArgs, terminal: &Terminal) -> Result<(), Failure> {
    let plot = Plot::to(args.plot.as_deref())?;
    let bench = measured(args.quick, terminal)?;
    plot.write(|| plot::of_surface_bench(&bench))?;
    terminal.answer(&bench, &bench_tables::of_surface_bench(&bench));
    plot.tell(terminal);
    Ok(())
}

/// How to measure.
struct Effort {
    pools: Vec<rayon::ThreadPool>,
    patience: Patience,
}

fn measured(quick: bool, terminal: &Terminal) -> Result<SurfaceBench, Failure> {
    let effort = Effort { pools: pools()?, patience: if quick { Patience::QUICK } else { Patience::THOROUGH } };
    let most_cells = if quick { QUICK_GRID } else { usize::MAX };
    let grids: Vec<usize> = GRIDS.into_iter().filter(|cells| *cells <= most_cells).collect();
    let stand_ins = stand_ins();
    let progress = terminal.progress(stand_ins.len() + grids.len());
    let of_surface = |(stand_in, paper): (&StandIn, SurfaceTimes)| {
        progress.begin(paper.figure);
        effort.surface_row(stand_in, paper)
    };
    let surfaces = stand_ins.iter().zip(paper::SURFACES).map(of_surface).collect();
    let of_grid = |cells: usize| {
        progress.begin("Figure 3");
        let reaches = REACHES.map(|reach| effort.reach_row(&stand_ins[1].surface, cells, reach));
        GridRow { cells, reaches: reaches.into() }
    };
    let grids = grids.into_iter().map(of_grid).collect();
    progress.end();
    Ok(SurfaceBench { quick, paper_machine: paper::SURFACE_MACHINE, reach: paper::SURFACE_REACH, surfaces, grids })
}

impl Effort {
    fn surface_row(&self, stand_in: &StandIn, paper: SurfaceTimes) -> SurfaceRow {
        let flattened = || flattened(&stand_in.surface, paper.cells, paper::SURFACE_REACH);
        let Flattened { sheet, report, .. } = flattened();
        let placed = stand_in.placed(&sheet);
        let deformed = || stand_in.deformed(&sheet, &placed);
        let mesh = deformed();
        let run = || SurfaceRun {
            threads: rayon::current_num_threads(),
            flatten: median(self.patience, flattened).into(),
            deform: median(self.patience, deformed).into(),
        };
        SurfaceRow {
            paper,
            stand_in: stand_in.name,
            model_faces: stand_in.model.faces().len(),
            vertices: mesh.points().len(),
            faces: mesh.faces().len(),
            stretch: report.stretch,
            compression: report.compression,
            runs: self.pools.iter().map(|pool| pool.install(run)).collect(),
        }
    }

    fn reach_row(&self, surface: &Surface, cells: usize, reach: usize) -> ReachRow {
        let flattened = || flattened(surface, cells, reach);
        let run =
            || ReachRun { threads: rayon::current_num_threads(), flatten: median(self.patience, flattened).into() };
        ReachRow {
            reach,
            folded: flattened().report.folds.len(),
            runs: self.pools.iter().map(|pool| pool.install(run)).collect(),
        }
    }
}

fn flattened(surface: &Surface, cells: usize, reach: usize) -> Flattened {
    let options = FlattenOptions { cells: [cells; 2], reach, ..FlattenOptions::default() };
    flatten(surface, &options).expect("the surface is smooth")
}
