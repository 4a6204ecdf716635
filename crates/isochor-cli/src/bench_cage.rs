//! `isochor bench cage`: table 3 of the paper about cages, this machine beside it, and its figures 5 and 6.
//!
//! For each model of the paper there is a stone of as many vertices in a cage of 92 vertices and 180 triangles, a coarser stone; the paper does not say
//! how many vertices its cages have. *Gradient* is that of the volume with respect to all vertices of the cage at once, where the paper's is with respect to
//! one; *deform* moves all vertices of the model; *bind* finds their mean value coordinates, which the paper does not time.

use isochor::{Cage, CageBinding, CageOptions, Mesh, OpenBoundaries, Solid, shapes, topology};

use crate::args::BenchCageArgs;
use crate::bench::pools;
use crate::bench_surface::Time;
use crate::bench_tables;
use crate::failure::Failure;
use crate::median::{Patience, median};
use crate::paper::{self, CageTimes};
use crate::plot::{self, Plot};
use crate::stress_angle::StressAngles;
use crate::terminal::Terminal;

/// Vertices of the cage.
const CAGE: usize = 92;

/// The model's size in the cage, about the middle of both.
const INSIDE: f64 = 0.9;

/// Models up to this are enough to see that all works.
const QUICK_VERTICES: usize = 3000;

/// What was measured.
#[derive(Debug, serde::Serialize)]
pub struct CageBench {
    /// Whether only small models were measured, and roughly.
    pub quick: bool,
    pub paper_machine: &'static str,
    pub cage_vertices: usize,
    pub cage_triangles: usize,
    /// One for each row of the paper's table 3.
    pub models: Vec<CageRow>,
    /// The paper's figures 5 and 6.
    pub stress: StressAngles,
}

/// A row of the paper's table 3, and what stands in for its model here.
#[derive(Debug, serde::Serialize)]
pub struct CageRow {
    pub paper: CageTimes,
    pub vertices: usize,
    pub faces: usize,
    /// With one thread, and with all.
    pub runs: Vec<CageRun>,
}

/// Times of a model in a cage.
#[derive(Debug, serde::Serialize)]
pub struct CageRun {
    pub threads: usize,
    pub bind: Time,
    pub gradient: Time,
    pub deform: Time,
}

/// Measures, prints the tables and draws the plot.
pub fn run(args: &BenchCageArgs, terminal: &Terminal) -> Result<(), Failure> {
    let plot = Plot::to(args.plot.as_deref())?;
    let (pools, patience) = (pools()?, if args.quick { Patience::QUICK } else { Patience::THOROUGH });
    let most = if args.quick { QUICK_VERTICES } else { usize::MAX };
    let papers: Vec<CageTimes> = paper::CAGES.into_iter().filter(|row| row.vertices <= most).collect();
    let cage = Cage::new(shapes::stone(CAGE)).expect("a stone is closed");
    let progress = terminal.progress(papers.len() + 1);
    let row = |paper: CageTimes| {
        progress.begin(paper.model);
        measured(&cage, paper, &pools, patience)
    };
    let models = papers.into_iter().map(row).collect();
    progress.begin("local stress");
    let stress = StressAngles::computed();
    progress.end();
    let bench = CageBench {
        quick: args.quick,
        paper_machine: paper::CAGE_MACHINE,
        cage_vertices: cage.vertices().len(),
        cage_triangles: cage.triangles().len(),
        models,
        stress,
    };
    plot.write(|| plot::of_stress_angles(&bench.stress))?;
    terminal.answer(&bench, &bench_tables::of_cage_bench(&bench));
    plot.tell(terminal);
    Ok(())
}

fn measured(cage: &Cage, paper: CageTimes, pools: &[rayon::ThreadPool], patience: Patience) -> CageRow {
    let stone = shapes::stone(paper.vertices);
    let points = stone.points().iter().map(|p| *p * INSIDE).collect();
    let mesh: Mesh = stone.with_points(points).expect("a smaller stone");
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).expect("a stone is closed");
    let bind = || -> CageBinding { cage.bind(mesh.points(), &CageOptions::default()).expect("a cage that is no knot") };
    let bound = bind();
    let posed: Vec<_> = cage.vertices().iter().map(|c| *c * glam::DVec3::new(1.2, 0.8, 1.0)).collect();
    let displacement = bound.displacement(&posed);
    let deform = || bound.binding().displaced(mesh.points(), &displacement);
    let deformed = deform();
    let run = || CageRun {
        threads: rayon::current_num_threads(),
        bind: median(patience, bind).into(),
        gradient: median(patience, || bound.gradient(&posed, &solid.volume_gradient(&deformed))).into(),
        deform: median(patience, deform).into(),
    };
    CageRow {
        paper,
        vertices: mesh.points().len(),
        faces: mesh.faces().len(),
        runs: pools.iter().map(|pool| pool.install(run)).collect(),
    }
}
