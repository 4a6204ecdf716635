//! Measurements as text: tables.

use crate::bench_cage::CageBench;
use crate::bench_elastic::{ElasticBench, ElasticRow, LevelRow};
use crate::bench_lattice::{LatticeBench, ModelRow, Run, StageTime};
use crate::bench_surface::SurfaceBench;
use crate::paper::ElasticTimes;
use crate::stages::Stage;
use crate::stress_angle::StressAngles;
use crate::table::{Table, figure, grouped, stated, threads};

/// Bytes for a number of the matrix B: its 32-bit value and its 32-bit index.
const SPARSE: usize = 8;

/// Bytes that fit into a cache of most processors.
const IN_CACHE: usize = 4_000_000;

/// Megabytes as disks and memory buses have them.
const MEGA: f64 = 1e6;
const GIGA: f64 = 1e9;

/// All tables of `isochor bench lattice`.
pub fn of_lattice_bench(bench: &LatticeBench) -> String {
    let Some(model) = bench.models.first() else { return String::new() };
    let mut tables = vec![sizes(bench), times(bench), limits(bench)];
    for (run, Run { threads: count, .. }) in model.runs.iter().enumerate() {
        let on = threads(*count);
        tables.push(stages(bench, run, &format!("Milliseconds, {on}"), |time| figure(time.ms)));
    }
    for (run, Run { threads: count, .. }) in model.runs.iter().enumerate() {
        let title = format!("Sweeps over the bytes that must be touched, {}", threads(*count));
        tables.push(stages(bench, run, &title, |time| figure(time.sweeps)));
    }
    tables.push(bandwidths(bench));
    let times = bench.models.iter().flat_map(|model| &model.runs).flat_map(|run| &run.stages);
    let note = format!(
        "{} A sweep is the sum of an array of {:.0} MB. HB: {}.\n{}",
        medians(times.map(|time| time.runs)),
        bench.sweep_bytes as f64 / MEGA,
        bench.paper_machine,
        if bench.quick { quick_note("small models") } else { String::new() }
    );
    tables.push(note);
    tables.join("\n")
}

/// Of how many runs medians are.
fn medians(runs: impl Iterator<Item = usize> + Clone) -> String {
    format!("Medians of {} to {} runs each.", runs.clone().min().unwrap_or(0), runs.max().unwrap_or(0))
}

/// What figures of `--quick` are of, and that they are rough.
fn quick_note(of: &str) -> String {
    format!("These are quick measurements of {of}, with much noise: leave --quick out for figures.\n")
}

/// HB's table 1.
fn sizes(bench: &LatticeBench) -> String {
    let columns = ["model", "faces, HB", "here", "in 10³, HB", "here", "in 6³, HB", "here", "MB, as B", "as kept here"];
    let mut table = Table::new("HB, table 1: numbers other than 0 in the matrix B", &columns.map(str::to_owned));
    for row in &bench.models {
        let paper = |number: fn(&crate::paper::NonZeros) -> usize| {
            row.paper_non_zeros.as_ref().map_or("–".into(), |paper| grouped(number(paper)))
        };
        table.row(&[
            row.model.into(),
            paper(|paper| paper.faces),
            grouped(row.faces),
            paper(|paper| paper.in_10),
            grouped(row.non_zeros_in_10),
            paper(|paper| paper.in_6),
            grouped(row.non_zeros_in_6),
            figure((SPARSE * row.non_zeros_in_10) as f64 / MEGA),
            figure(row.kept_bytes as f64 / MEGA),
        ]);
    }
    table.into_text()
}

/// HB's table 2.
fn times(bench: &LatticeBench) -> String {
    let counts: Vec<usize> = bench.models.first().map_or_else(Vec::new, |m| m.runs.iter().map(|r| r.threads).collect());
    let mut columns: Vec<String> = ["model", "vertices, HB", "here", "FFD: HB, GPU"].map(str::to_owned).into();
    columns.extend(counts.iter().map(|count| format!("here, {}", threads(*count))));
    columns.extend(["volume, one axis: HB, CPU", "HB, GPU"].map(str::to_owned));
    columns.extend(counts.iter().map(|count| format!("here, {}", threads(*count))));
    let mut table = Table::new("HB, table 2: milliseconds", &columns);
    for row in &bench.models {
        let paper = |number: fn(&crate::paper::Times) -> String| row.paper_times.as_ref().map_or("–".into(), number);
        let here = |stage: Stage| row.runs.iter().map(move |run: &Run| figure(run.ms(stage)));
        let mut cells = vec![
            row.model.into(),
            paper(|paper| grouped(paper.vertices)),
            grouped(row.vertices),
            paper(|paper| stated(paper.gpu_ffd_ms)),
        ];
        cells.extend(here(Stage::Apply));
        cells.extend([paper(|paper| stated(paper.cpu_volume_ms)), paper(|paper| stated(paper.gpu_volume_ms))]);
        cells.extend(here(Stage::Offsets));
        table.row(&cells);
    }
    table.into_text()
}

/// How long each stage takes for a vertex, of a model that fits into a cache and of the largest.
fn limits(bench: &LatticeBench) -> String {
    let Some((large, smaller)) = bench.models.split_last() else { return String::new() };
    let small = smaller.iter().rfind(|model| model.kept_bytes <= IN_CACHE);
    let of_small = small.iter().flat_map(|small| small.runs.iter().take(1).map(move |run| (*small, run)));
    let runs: Vec<(&ModelRow, &Run)> = of_small.chain(large.runs.iter().map(|run| (large, run))).collect();
    let name = |(model, run): &(&ModelRow, &Run)| format!("{}, {}", model.model, threads(run.threads));
    let mut columns = vec!["stage".to_owned()];
    columns.extend(runs.iter().map(name));
    columns.extend(runs.iter().map(|of| format!("sweeps: {}", name(of))));
    let mut table = Table::new("Nanoseconds for a vertex", &columns);
    for (k, stage) in Stage::ALL.iter().enumerate() {
        let mut cells = vec![stage.name().to_owned()];
        cells.extend(runs.iter().map(|(model, run)| figure(1e6 * run.stages[k].ms / model.vertices as f64)));
        cells.extend(runs.iter().map(|(_, run)| figure(run.stages[k].sweeps)));
        table.row(&cells);
    }
    table.into_text()
}

/// What the memory did meanwhile.
fn bandwidths(bench: &LatticeBench) -> String {
    let counts = bench.models.first().map_or(&[][..], |model| &model.runs).iter().map(|run| threads(run.threads));
    let mut columns = vec!["model".to_owned()];
    columns.extend(counts.flat_map(|count| [format!("sum, {count}"), format!("copy, {count}")]));
    let mut table = Table::new("Sweeps over the memory meanwhile, GB/s", &columns);
    for ModelRow { model, runs, .. } in &bench.models {
        let both = runs.iter().flat_map(|run| [run.bandwidth.read, run.bandwidth.copy]);
        let cells: Vec<String> =
            [(*model).to_owned()].into_iter().chain(both.map(|bandwidth| figure(bandwidth / GIGA))).collect();
        table.row(&cells);
    }
    table.into_text()
}

/// A cell for every stage of every model.
fn stages(bench: &LatticeBench, run: usize, title: &str, cell: impl Fn(&StageTime) -> String) -> String {
    let mut columns = vec!["model".to_owned(), "vertices".to_owned()];
    columns.extend(Stage::ALL.map(|stage| stage.name().to_owned()));
    let mut table = Table::new(title, &columns);
    for ModelRow { model, vertices, runs, .. } in &bench.models {
        let run = &runs[run];
        let mut cells = vec![(*model).into(), grouped(*vertices)];
        cells.extend(run.stages.iter().map(&cell));
        table.row(&cells);
    }
    table.into_text()
}

/// All tables of `isochor bench surface`.
pub fn of_surface_bench(bench: &SurfaceBench) -> String {
    let of_surfaces = bench.surfaces.iter().flat_map(|row| &row.runs).flat_map(|run| [&run.flatten, &run.deform]);
    let of_grids = bench.grids.iter().flat_map(|row| &row.reaches).flat_map(|row| &row.runs).map(|run| &run.flatten);
    let note = format!(
        "{} CO: {}. Its figure 3 is a plot without numbers, so none of them stand here.\n{}",
        medians(of_surfaces.chain(of_grids).map(|time| time.runs)),
        bench.paper_machine,
        if bench.quick { quick_note("small grids") } else { String::new() }
    );
    [along_surfaces(bench), flattening(bench), note].join("\n")
}

/// CO's table 1.
fn along_surfaces(bench: &SurfaceBench) -> String {
    let counts: Vec<usize> =
        bench.surfaces.first().map_or_else(Vec::new, |row| row.runs.iter().map(|r| r.threads).collect());
    let here = || counts.iter().map(|count| format!("here, {}", threads(*count)));
    let mut columns: Vec<String> = ["surface", "faces: CO", "here", "grid", "flatten: CO"].map(str::to_owned).into();
    columns.extend(here());
    columns.push("deform: CO".into());
    columns.extend(here());
    columns.extend(["deformed: vertices", "faces", "sheet: stretch, %", "compression, %"].map(str::to_owned));
    let title = format!("CO, table 1: milliseconds, r = {}", bench.reach);
    let mut table = Table::new(&title, &columns);
    for row in &bench.surfaces {
        let mut cells = vec![
            format!("{}: {}", row.paper.figure, row.stand_in),
            grouped(row.paper.polygons),
            grouped(row.model_faces),
            grid(row.paper.cells),
            stated(row.paper.flatten_ms),
        ];
        cells.extend(row.runs.iter().map(|run| figure(run.flatten.ms)));
        cells.push(stated(row.paper.deform_ms));
        cells.extend(row.runs.iter().map(|run| figure(run.deform.ms)));
        cells.extend([grouped(row.vertices), grouped(row.faces), figure(row.stretch), figure(row.compression)]);
        table.row(&cells);
    }
    table.into_text()
}

/// CO's figure 3.
fn flattening(bench: &SurfaceBench) -> String {
    let mut columns = vec!["grid".to_owned()];
    for row in bench.grids.first().map_or(&[][..], |row| &row.reaches) {
        columns.extend(row.runs.iter().map(|run| format!("r = {}, {}", row.reach, threads(run.threads))));
        columns.push("folded cells".into());
    }
    let mut table = Table::new("CO, figure 3: milliseconds of flattening the surface of figure 9", &columns);
    for row in &bench.grids {
        let mut cells = vec![grid(row.cells)];
        for row in &row.reaches {
            cells.extend(row.runs.iter().map(|run| figure(run.flatten.ms)));
            cells.push(grouped(row.folded));
        }
        table.row(&cells);
    }
    table.into_text()
}

/// Cells along both directions.
fn grid(cells: usize) -> String {
    format!("{cells} × {cells}")
}

/// All tables of `isochor bench cage`.
pub fn of_cage_bench(bench: &CageBench) -> String {
    [of_cage_times(bench), of_stress_angles(&bench.stress)].join("\n")
}

/// CVB's figures 5 and 6 in numbers.
fn of_stress_angles(stress: &StressAngles) -> String {
    let columns = ["stretches", "pairs", "average error, °", "largest error, °"];
    let title = "CVB, figure 6: polynomials of degree 6 in s₁ and s₃ for the angle of local stress";
    let mut table = Table::new(title, &columns.map(str::to_owned));
    for fit in &stress.fits {
        table.row(&[
            format!("1/{0} to {0}", fit.factor),
            grouped(fit.pairs),
            figure(fit.average_error),
            figure(fit.largest_error),
        ]);
    }
    let note = format!(
        "CVB: {}° on average, over stretches that it does not state. The closed form has no error. CVB, figure 5: of {} directions the one that is turned most \
         is turned by the angle in closed form, whatever s₂ is, less {}° at most, for {} triplets of stretches.\n",
        stress.paper_average_error,
        grouped(stress.directions),
        figure(stress.largest_shortfall),
        stress.simulated.len()
    );
    [table.into_text(), note].join("\n")
}

/// CVB's table 3.
fn of_cage_times(bench: &CageBench) -> String {
    let counts: Vec<usize> =
        bench.models.first().map_or_else(Vec::new, |row| row.runs.iter().map(|r| r.threads).collect());
    let here = |what: &'static str| counts.iter().map(move |count| format!("{what}, {}", threads(*count)));
    let mut columns: Vec<String> =
        ["model", "vertices", "triangles: CVB", "here", "gradient of one: CVB"].map(str::to_owned).into();
    columns.extend(here("of all, here"));
    columns.extend(["deform, GPU: CVB", "CPU: CVB"].map(str::to_owned));
    columns.extend(here("here"));
    columns.extend(here("bind, here"));
    let title = format!(
        "CVB, table 3: milliseconds; here a stone in a cage of {} vertices and {} triangles",
        bench.cage_vertices, bench.cage_triangles
    );
    let mut table = Table::new(&title, &columns);
    for row in &bench.models {
        let paper = &row.paper;
        let mut cells = vec![
            paper.model.into(),
            grouped(row.vertices),
            grouped(paper.triangles),
            grouped(row.faces),
            stated(paper.gradient_ms),
        ];
        cells.extend(row.runs.iter().map(|run| figure(run.gradient.ms)));
        cells.extend([stated(paper.gpu_deform_ms), stated(paper.cpu_deform_ms)]);
        cells.extend(row.runs.iter().map(|run| figure(run.deform.ms)));
        cells.extend(row.runs.iter().map(|run| figure(run.bind.ms)));
        table.row(&cells);
    }
    let times = bench.models.iter().flat_map(|row| &row.runs).flat_map(|run| [&run.bind, &run.gradient, &run.deform]);
    let note = format!(
        "{} CVB: {}.\n{}",
        medians(times.map(|time| time.runs)),
        bench.paper_machine,
        if bench.quick { quick_note("small models") } else { String::new() }
    );
    [table.into_text(), note].join("\n")
}

/// All tables of `isochor bench elastic`.
pub fn of_elastic_bench(bench: &ElasticBench) -> String {
    let mut tables = vec![of_solver(bench), of_newton(bench)];
    tables.extend(bench.rows.first().map(|row| of_levels(bench, row)));
    tables.extend(bench.rows.iter().enumerate().map(|(k, row)| convergence(k, row)));
    let abouts = bench.rows.iter().map(|row| format!("- {}: {}.\n", row.example, row.about));
    tables.push(abouts.collect());
    let times = bench.rows.iter().flat_map(|row| {
        [&row.single.time, &row.multi.time, &row.newton.time, &row.newton_on_mesh.time, &row.form.setup, &row.form.warm]
    });
    tables.push(format!(
        "{} On {}. HML: {}. It does not state how far nodes are moved, so amounts are chosen here; its figures 5 to 8 are plots without numbers, so none of \
         them stand here.\n{}",
        medians(times.map(|time| time.runs)),
        threads(bench.threads),
        bench.paper_machine,
        if bench.quick { quick_note("all examples") } else { String::new() }
    ));
    tables.join("\n")
}

/// HML's table 1.
fn of_solver(bench: &ElasticBench) -> String {
    let columns = [
        "example",
        "triangles: HML",
        "here",
        "T₁, ms: HML",
        "here",
        "T₂, ms: HML",
        "here",
        "T₁/T₂: HML",
        "here",
        "ΔV/V, %: HML",
        "here",
        "mesh evaluated: T₁",
        "T₂",
    ];
    let title = "HML, table 1: the paper's solver, from the mesh alone (T₁) and from level to level (T₂)";
    let mut table = Table::new(title, &columns.map(str::to_owned));
    for row in &bench.rows {
        let paper = |number: fn(&ElasticTimes) -> String| row.paper.as_ref().map_or("–".into(), number);
        table.row(&[
            row.example.into(),
            paper(|paper| grouped(paper.triangles)),
            grouped(row.triangles),
            paper(|paper| stated(paper.single_ms)),
            figure(row.single.time.ms),
            paper(|paper| stated(paper.multi_ms)),
            figure(row.multi.time.ms),
            paper(|paper| stated(paper.ratio)),
            figure(row.single.time.ms / row.multi.time.ms),
            paper(|paper| stated_percent(paper.volume_error)),
            figure(1e2 * row.multi.volume_error),
            grouped(row.single.evaluations),
            grouped(row.multi.evaluations),
        ]);
    }
    table.into_text()
}

/// The default solver on HML's examples.
fn of_newton(bench: &ElasticBench) -> String {
    let columns = [
        "example",
        "one run, ms",
        "steps",
        "mesh evaluated",
        "on the mesh, ms",
        "steps",
        "mesh evaluated",
        "form of all nodes, ms",
        "handles moved, ms",
        "steps",
    ];
    let mut table = Table::new(
        "The default solver, exact; volumes from a form of the nodes, and from the mesh",
        &columns.map(str::to_owned),
    );
    for ElasticRow { example, newton, newton_on_mesh, form, .. } in &bench.rows {
        let mut cells = vec![(*example).into()];
        for run in [newton, newton_on_mesh] {
            cells.extend([figure(run.time.ms), grouped(run.steps), grouped(run.evaluations)]);
        }
        cells.extend([figure(form.setup.ms), figure(form.warm.ms), grouped(form.steps)]);
        table.row(&cells);
    }
    table.into_text()
}

/// HML's table 2, of its first example.
fn of_levels(bench: &ElasticBench, row: &ElasticRow) -> String {
    let columns = [
        "triangles",
        "ΔX, %: HML",
        "here",
        "steps: HML",
        "here",
        "T, ms: HML",
        "here",
        "T cumulated, ms: HML",
        "here",
        "σ here",
    ];
    let mut table = Table::new("HML, table 2: levels of the torus compression", &columns.map(str::to_owned));
    for paper in &bench.paper_levels {
        let here = row.multi.levels.iter().find(|level| level.report.triangles == paper.triangles);
        let here = |number: fn(&LevelRow) -> String| here.map_or("–".into(), number);
        table.row(&[
            grouped(paper.triangles),
            stated_percent(paper.change),
            here(|level| figure(1e2 * level.report.change)),
            grouped(paper.steps),
            here(|level| grouped(level.report.steps)),
            stated(paper.ms),
            here(|level| figure(level.report.milliseconds)),
            stated(paper.cumulated_ms),
            here(|level| figure(level.cumulated_ms)),
            here(|level| figure(level.report.penalty)),
        ]);
    }
    table.into_text()
}

/// What HML's figures 5 to 8 show, for this machine.
fn convergence(k: usize, row: &ElasticRow) -> String {
    /// Of the first example.
    const FIGURE: usize = 5;
    let columns = ["triangles", "steps", "T, ms", "T cumulated, ms", "ΔV/V, %", "node error, %", "from balance, %"];
    let title = match &row.paper {
        Some(_) => format!("HML, figure {}: {}", FIGURE + k, row.example),
        None => row.example.into(),
    };
    let mut table = Table::new(&title, &columns.map(str::to_owned));
    let of_single = row.single.levels.iter().map(|level| (" alone", level));
    for (alone, level) in row.multi.levels.iter().map(|level| ("", level)).chain(of_single) {
        table.row(&[
            format!("{}{alone}", grouped(level.report.triangles)),
            grouped(level.report.steps),
            figure(level.report.milliseconds),
            figure(level.cumulated_ms),
            figure(1e2 * level.report.volume_error),
            figure(1e2 * level.node_error),
            figure(1e2 * level.from_balance),
        ]);
    }
    table.into_text()
}

/// A share as the paper has it, in percent.
fn stated_percent(share: f64) -> String {
    // 100 times 0.033 is not 3.3.
    stated((1e8 * share).round() / 1e6)
}
