//! `isochor bench elastic`: HML's tables 1 and 2 and its figures 5 to 8, this machine beside them.
//!
//! Each of the [`examples`] settles by the paper's solver, from its mesh alone and from level to level of detail; by the default solver, with all
//! that one run needs, as it chooses and on the mesh; and by a form of all nodes that is there already, after its handles have moved. Times of the paper's
//! solver are those of the search alone, without levels, bindings and the exact correction.

use std::time::Duration;

use glam::DVec3;
use isochor::{
    Augmented, Bounds, Elastic, ElasticModel, ElasticSolver, ElasticState, ElasticStatus, Evaluation, LevelReport,
    Settled, VolumeForm, relaxed,
};

use crate::args::BenchElasticArgs;
use crate::bench_surface::Time;
use crate::bench_tables;
use crate::elastic_examples::{Example, Title, examples};
use crate::failure::Failure;
use crate::median::{Patience, median, middle};
use crate::paper::{self, ElasticLevel, ElasticTimes};
use crate::plot::{self, Plot};
use crate::terminal::Terminal;

/// Nodes that were moved go so much of their way back, and forth again, for times of a form that is there already.
const BACK: f64 = 0.05;

/// What was measured.
#[derive(Debug, serde::Serialize)]
pub struct ElasticBench {
    /// Whether it was measured roughly.
    pub quick: bool,
    pub threads: usize,
    pub paper_machine: &'static str,
    /// The paper's table 2, of the first row.
    pub paper_levels: [ElasticLevel; 5],
    /// One for each row of the paper's table 1, then what it has no row for.
    pub rows: Vec<ElasticRow>,
}

/// An example.
#[derive(Debug, serde::Serialize)]
pub struct ElasticRow {
    pub paper: Option<ElasticTimes>,
    pub example: &'static str,
    /// The body, and what is done to it.
    pub about: &'static str,
    /// Nodes of the lattice along each axis.
    pub lattice: [usize; 3],
    /// Nodes that are held.
    pub held: usize,
    pub triangles: usize,
    /// The paper's solver from the mesh alone.
    pub single: LevelsRun,
    /// And from level to level.
    pub multi: LevelsRun,
    /// The default solver.
    pub newton: NewtonRun,
    /// The same on the mesh alone.
    pub newton_on_mesh: NewtonRun,
    pub form: FormRun,
}

/// The paper's solver.
#[derive(Debug, serde::Serialize)]
pub struct LevelsRun {
    pub status: &'static str,
    pub time: Time,
    /// Evaluations of the mesh itself.
    pub evaluations: usize,
    /// By how much the volume is off, relatively, before it is corrected exactly, and then.
    pub volume_error: f64,
    pub exact_error: f64,
    /// dE/dV where it ends.
    pub pressure: f64,
    /// Those that it went through, the coarsest first.
    pub levels: Vec<LevelRow>,
}

/// A level of detail.
#[derive(Debug, serde::Serialize)]
pub struct LevelRow {
    /// Its milliseconds are the median.
    #[serde(flatten)]
    pub report: LevelReport,
    /// Up to its end.
    pub cumulated_ms: f64,
    /// The farthest that a coordinate of a node is from where it ends, in extents: the paper's figures 5 to 8.
    pub node_error: f64,
    /// And from where the default solver ends.
    pub from_balance: f64,
}

/// The default solver: all that a single run takes, with the exact correction.
#[derive(Debug, serde::Serialize)]
pub struct NewtonRun {
    pub status: &'static str,
    pub time: Time,
    pub steps: usize,
    /// Evaluations of the mesh; none where the volume is a form of the nodes.
    pub evaluations: usize,
    pub exact_error: f64,
    pub residual: f64,
}

/// The default solver with a form of all nodes.
#[derive(Debug, serde::Serialize)]
pub struct FormRun {
    /// Making the form.
    pub setup: Time,
    pub status: &'static str,
    /// Settling after all handles have moved, from where the nodes were.
    pub warm: Time,
    pub steps: usize,
    pub exact_error: f64,
}

/// Measures, prints the tables and draws the plot.
pub fn run(args: &BenchElasticArgs, terminal: &Terminal) -> Result<(), Failure> {
    let plot = Plot::to(args.plot.as_deref())?;
    let patience = if args.quick { Patience::QUICK } else { Patience::THOROUGH };
    let examples = examples();
    let progress = terminal.progress(examples.len());
    let row = |example: &Example| {
        progress.begin(example.title.name);
        Effort { patience, example }.row()
    };
    let rows = examples.iter().map(row).collect();
    progress.end();
    let bench = ElasticBench {
        quick: args.quick,
        threads: rayon::current_num_threads(),
        paper_machine: paper::ELASTIC_MACHINE,
        paper_levels: paper::ELASTIC_LEVELS,
        rows,
    };
    plot.write(|| plot::of_elastic_bench(&bench))?;
    terminal.answer(&bench, &bench_tables::of_elastic_bench(&bench));
    plot.tell(terminal);
    Ok(())
}

/// An example, and how to measure it.
struct Effort<'a> {
    patience: Patience,
    example: &'a Example,
}

impl Effort<'_> {
    fn row(&self) -> ElasticRow {
        let (newton, balance) = self.newton(Evaluation::Auto);
        let (newton_on_mesh, _) = self.newton(Evaluation::Mesh);
        let Title { paper, name, about } = &self.example.title;
        ElasticRow {
            paper: *paper,
            example: name,
            about,
            lattice: self.example.size,
            held: self.example.held_count(),
            triangles: self.example.model().solid.triangle_count(),
            single: self.levels(&[], &balance),
            multi: self.levels(&self.example.coarser(), &balance),
            newton,
            newton_on_mesh,
            form: self.form(),
        }
    }

    /// The default solver, and where its nodes end.
    fn newton(&self, evaluation: Evaluation) -> (NewtonRun, Vec<DVec3>) {
        let (model, start, wanted) = (self.example.model(), self.example.start(), self.example.wanted());
        let options = self.example.options(ElasticSolver::Newton, evaluation);
        let run = || relaxed(&model, &start, &wanted, &options).expect("the example has a pose of its volume");
        let (state, settled) = run();
        let run = NewtonRun {
            status: word(state.status),
            time: median(self.patience, run).into(),
            steps: state.steps,
            evaluations: state.evaluations,
            exact_error: settled.correction.relative_error,
            residual: state.residual,
        };
        (run, settled.places)
    }

    /// The paper's solver over `coarser` levels.
    fn levels(&self, coarser: &[ElasticModel], balance: &[DVec3]) -> LevelsRun {
        let (model, wanted) = (self.example.model(), self.example.wanted());
        let solver = ElasticSolver::AugmentedLagrangian(Augmented::default());
        let options = self.example.options(solver, Evaluation::Mesh);
        let start = self.example.start();
        let elastic = Elastic::new(&model, &start, &wanted, &options).and_then(|elastic| elastic.with_levels(coarser));
        let mut elastic = elastic.expect("levels in the same lattice");
        let (state, settled) = settle(&mut elastic);
        let all: Vec<(usize, DVec3)> = start.into_iter().enumerate().collect();
        let mut times: Vec<Vec<Duration>> = vec![Vec::new(); state.levels.len()];
        let time = median(self.patience, || {
            elastic.move_nodes(&all).expect("nodes of the lattice");
            let state = elastic.run(None, &mut |_| true).expect("it has settled before");
            for (times, level) in times.iter_mut().zip(&state.levels) {
                times.push(Duration::from_secs_f64(1e-3 * level.milliseconds));
            }
        });
        let extent = Bounds::of(model.points).map_or(0.0, |bounds| bounds.extent());
        let mut cumulated_ms = 0.0;
        let row = |(report, times): (&LevelReport, &mut Vec<Duration>)| {
            let milliseconds = 1e3 * middle(times).as_secs_f64();
            cumulated_ms += milliseconds;
            LevelRow {
                report: LevelReport { milliseconds, ..report.clone() },
                cumulated_ms,
                node_error: farthest(&report.places, &settled.places) / extent,
                from_balance: farthest(&report.places, balance) / extent,
            }
        };
        LevelsRun {
            status: word(state.status),
            time: time.into(),
            evaluations: state.evaluations,
            volume_error: (settled.correction.volume_before / wanted.volumes[0].volume - 1.0).abs(),
            exact_error: settled.correction.relative_error,
            pressure: state.pressures[0],
            levels: state.levels.iter().zip(&mut times).map(row).collect(),
        }
    }

    fn form(&self) -> FormRun {
        let (model, wanted) = (self.example.model(), self.example.wanted());
        let ElasticModel { solid, points, binding, rest, .. } = model;
        let options = self.example.options(ElasticSolver::Newton, Evaluation::Form);
        let elastic = Elastic::new(&model, &self.example.start(), &wanted, &options);
        let mut elastic = elastic.expect("an example that can settle");
        settle(&mut elastic);
        let handles = [1.0 - BACK, 1.0].map(|share| self.example.handles(share));
        let mut at = 0;
        let mut moved = || {
            elastic.move_nodes(&handles[at]).expect("nodes of the lattice");
            at = 1 - at;
            elastic.run(None, &mut |_| true).expect("it has settled before")
        };
        let warm = median(self.patience, &mut moved).into();
        let state = moved();
        FormRun {
            setup: median(self.patience, || VolumeForm::new(solid, points, binding, rest)).into(),
            status: word(state.status),
            warm,
            steps: state.steps,
            exact_error: elastic.settled().expect("it has settled").correction.relative_error,
        }
    }
}

fn settle(elastic: &mut Elastic) -> (ElasticState, Settled) {
    let state = elastic.run(None, &mut |_| true).expect("the example has a pose of its volume");
    (state, elastic.settled().expect("it is near that volume"))
}

/// The farthest between coordinates of the same node.
fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max)
}

fn word(status: ElasticStatus) -> &'static str {
    match status {
        ElasticStatus::Settled => "settled",
        ElasticStatus::Approximate => "approximate",
        ElasticStatus::Stuck => "stuck",
        ElasticStatus::StepLimit => "step limit",
        ElasticStatus::Stopped => "stopped",
    }
}
