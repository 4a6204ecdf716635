//! HB, figure 9, time against vertices, CO, figure 3, time against grid cells, and HML, figures 5 to 8, error against time: drawn as SVG, both axes
//! logarithmic.

use std::path::Path;

use plotters::prelude::*;

use crate::bench_elastic::{ElasticBench, LevelsRun};
use crate::bench_lattice::{LatticeBench, ModelRow};
use crate::bench_surface::{GridRow, SurfaceBench};
use crate::failure::Failure;
use crate::files::Pending;
use crate::paper;
use crate::request::has_extension;
use crate::stages::Stage;
use crate::table::{grouped, threads};
use crate::terminal::Terminal;

/// Width and height in pixels.
const SIZE: (u32, u32) = (880, 560);

/// A plot's file, if there is to be one.
pub struct Plot<'a>(Option<&'a Path>);

impl<'a> Plot<'a> {
    /// Finds out whether it can be written before minutes are spent.
    pub fn to(path: Option<&'a Path>) -> Result<Self, Failure> {
        if let Some(path) = path {
            if !has_extension(path, "svg") {
                return Err(Failure::file(path, "is no .svg file", "plots are drawn as SVG: let the name end in .svg"));
            }
            Pending::default().add(path, &[])?;
        }
        Ok(Self(path))
    }

    pub fn write(&self, svg: impl FnOnce() -> Result<String, Failure>) -> Result<(), Failure> {
        let Some(path) = self.0 else { return Ok(()) };
        let mut pending = Pending::default();
        pending.add(path, svg()?.as_bytes())?;
        pending.commit()
    }

    /// Says that it is written.
    pub fn tell(&self, terminal: &Terminal) {
        if let Some(path) = self.0 {
            terminal.say(&format!("wrote {}", path.display()));
        }
    }
}

/// Something against something.
struct Chart {
    caption: &'static str,
    /// What is along x.
    x: &'static str,
    /// And along y.
    y: &'static str,
    series: Vec<Series>,
    names: SeriesLabelPosition,
}

/// A line through points (x, y).
struct Series {
    /// `None`: it belongs to the one before.
    name: Option<String>,
    color: RGBColor,
    points: Vec<(f64, f64)>,
}

/// Colours of the paper's figure for its own, darker and lighter ones for others.
const CPU: RGBColor = RGBColor(200, 40, 40);
const GPU: RGBColor = RGBColor(40, 70, 200);
const ONE_AXIS: [RGBColor; 2] = [RGBColor(20, 120, 60), RGBColor(90, 190, 120)];
const NEAREST: RGBColor = RGBColor(150, 110, 20);

/// For r = 1, 2, 3.
const REACHES: [RGBColor; 3] = [CPU, ONE_AXIS[0], GPU];

/// For HML's examples.
const EXAMPLES: [RGBColor; 5] = [CPU, GPU, ONE_AXIS[0], NEAREST, RGBColor(150, 60, 170)];

/// The times of one axis here and in the paper, and of the smallest displacement with all threads.
pub fn of_lattice_bench(bench: &LatticeBench) -> Result<String, Failure> {
    let paper = |name: &str, color, time: fn(&paper::Times) -> f64| Series {
        name: Some(name.into()),
        color,
        points: paper::TABLE_2.iter().map(|row| (row.vertices as f64, time(row))).collect(),
    };
    let mut series =
        vec![paper("HB, CPU", CPU, |row| row.cpu_volume_ms), paper("HB, GPU", GPU, |row| row.gpu_volume_ms)];
    let runs = bench.models.first().map_or(0, |model| model.runs.len());
    let here = |run: usize, stage: Stage| -> Vec<(f64, f64)> {
        let point = |row: &ModelRow| (row.vertices as f64, row.runs[run].ms(stage));
        bench.models.iter().map(point).collect()
    };
    let threads = |run: usize| threads(bench.models[0].runs[run].threads);
    for (run, color) in (0..runs).zip(ONE_AXIS) {
        let name = format!("here, {}", threads(run));
        series.push(Series { name: Some(name), color, points: here(run, Stage::Offsets) });
    }
    if let Some(last) = runs.checked_sub(1) {
        let name = format!("here, {}, nearest and moved", threads(last));
        series.push(Series { name: Some(name), color: NEAREST, points: here(last, Stage::Nearest) });
    }
    Chart::of_times("Volume correction along one axis", "vertices", series).svg()
}

/// The times of flattening with all threads.
pub fn of_surface_bench(bench: &SurfaceBench) -> Result<String, Failure> {
    let reaches = bench.grids.first().map_or(&[][..], |row| &row.reaches);
    let mut series = Vec::with_capacity(reaches.len());
    for (k, (row, color)) in reaches.iter().zip(REACHES).enumerate() {
        let Some(last) = row.runs.len().checked_sub(1) else { continue };
        let point = |grid: &GridRow| (grid.cells.pow(2) as f64, grid.reaches[k].runs[last].flatten.ms);
        let name = format!("r = {}, {}", row.reach, threads(row.runs[last].threads));
        series.push(Series { name: Some(name), color, points: bench.grids.iter().map(point).collect() });
    }
    Chart::of_times("Flattening a surface", "grid cells", series).svg()
}

/// How far nodes are from where forces balance, level after level, and where the mesh alone leads.
pub fn of_elastic_bench(bench: &ElasticBench) -> Result<String, Failure> {
    let mut series = Vec::new();
    for (row, color) in bench.rows.iter().zip(EXAMPLES) {
        let points =
            |run: &LevelsRun| run.levels.iter().map(|level| (level.cumulated_ms, level.from_balance)).collect();
        let name = format!("{}, {} triangles", row.example, grouped(row.triangles));
        series.push(Series { name: Some(name), color, points: points(&row.multi) });
        series.push(Series { name: None, color, points: points(&row.single) });
    }
    Chart {
        caption: "Nodes that settle level after level; single dots: on the mesh alone",
        x: "milliseconds",
        y: "farthest from balance, in extents",
        series,
        names: SeriesLabelPosition::UpperRight,
    }
    .svg()
}

/// From the power of ten below the least to that above the largest.
fn decades(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let ends = numbers.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    10f64.powf(ends.0.log10().floor())..10f64.powf(ends.1.log10().ceil())
}

impl Chart {
    /// Of milliseconds that grow with what is along x.
    fn of_times(caption: &'static str, x: &'static str, series: Vec<Series>) -> Self {
        Self { caption, x, y: "milliseconds", series, names: SeriesLabelPosition::UpperLeft }
    }

    fn svg(&self) -> Result<String, Failure> {
        self.drawn().map_err(|error| Failure {
            exit: 2,
            code: "plot",
            what: format!("the plot cannot be drawn: {error}"),
            place: "--plot".into(),
            hint: "leave --plot out".into(),
        })
    }

    fn drawn(&self) -> Result<String, DrawingAreaErrorKind<std::io::Error>> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let mut text = String::new();
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let (x, y) = (decades(points().map(|p| p.0)), decades(points().map(|p| p.1)));
        let mut chart = ChartBuilder::on(&root)
            .caption(self.caption, ("sans-serif", 18))
            .margin(16)
            .margin_right(40)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(x.log_scale(), y.log_scale())?;
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .x_label_formatter(&|x| x.to_string())
            .y_label_formatter(&|y| y.to_string())
            .draw()?;
        for Series { name, color, points } in &self.series {
            let line = LineSeries::new(points.iter().copied(), color.stroke_width(2));
            let key = *color;
            let drawn = chart.draw_series(line)?;
            if let Some(name) = name {
                drawn.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], key.stroke_width(2)));
            }
            chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, color.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(self.names.clone())
            .background_style(WHITE)
            .border_style(BLACK)
            .draw()?;
        root.present()?;
        drop(chart);
        drop(root);
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_hold_all_numbers() {
        assert_eq!(decades([2562.0, 543_860.0].into_iter()), 1e3..1e6);
        assert_eq!(decades([0.02, 1.0].into_iter()), 0.01..1.0);
    }
}
