//! Measurements as text: tables in GitHub's flavour of Markdown, so that they can stand in a document as they are.

use crate::bench_lattice::{LatticeBench, ModelRow, Run, StageTime};
use crate::stages::Stage;

/// Bytes for a number of the matrix B: its 32-bit value and its 32-bit index.
const SPARSE: usize = 8;

/// Bytes that fit into a cache of most processors.
const IN_CACHE: usize = 4_000_000;

/// Megabytes as disks and memory buses have them.
const MEGA: f64 = 1e6;
const GIGA: f64 = 1e9;

/// A table: the first column is text, the others are numbers.
struct Table(String);

impl Table {
    fn new(title: &str, columns: &[String]) -> Self {
        let mut table = Self(format!("**{title}**\n\n"));
        table.row(columns);
        table.0 += &format!("|---|{}\n", "--:|".repeat(columns.len() - 1));
        table
    }

    fn row(&mut self, cells: &[String]) {
        self.0 += &format!("| {} |\n", cells.join(" | "));
    }
}

/// All tables.
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
    let runs: Vec<usize> =
        bench.models.iter().flat_map(|model| &model.runs).flat_map(|run| &run.stages).map(|time| time.runs).collect();
    let (least, most) = (runs.iter().min().unwrap_or(&0), runs.iter().max().unwrap_or(&0));
    let mut text = tables.join("\n");
    text += &format!(
        "\nMedians of {least} to {most} runs each. A sweep is the sum of an array of {:.0} MB. HB: {}.\n",
        bench.sweep_bytes as f64 / MEGA,
        bench.paper_machine
    );
    if bench.quick {
        text += "These are quick measurements of small models, with much noise: leave --quick out for figures.\n";
    }
    text
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
    table.0
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
    table.0
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
    table.0
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
    table.0
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
    table.0
}

fn threads(count: usize) -> String {
    format!("{count} thread{}", if count == 1 { "" } else { "s" })
}

/// A measured number: three digits, for more are noise.
fn figure(x: f64) -> String {
    const DIGITS: i32 = 3;
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    // After rounding, for 9.999 is 10.0.
    let rounded = format!("{x:.*e}", DIGITS as usize - 1);
    let exponent: i32 = rounded.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or_default();
    match usize::try_from(DIGITS - 1 - exponent) {
        Ok(decimals) => format!("{x:.decimals$}"),
        Err(_) => grouped(x.round() as usize),
    }
}

/// A number as the paper has it.
fn stated(x: f64) -> String {
    if x.fract() == 0.0 { grouped(x as usize) } else { x.to_string() }
}

/// A whole number with commas.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_and_whole_numbers_commas() {
        let cases =
            [(0.0, "0"), (0.012_34, "0.0123"), (1.0, "1.00"), (9.999, "10.0"), (99.96, "100"), (1206.4, "1,206")];
        for (x, expected) in cases {
            assert_eq!(figure(x), expected);
        }
        assert_eq!(figure(f64::NAN), "NaN");
        assert_eq!([0.02, 6.0, 1206.0].map(stated), ["0.02", "6", "1,206"]);
        for (n, expected) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_087_716, "1,087,716")] {
            assert_eq!(grouped(n), expected);
        }
    }
}
