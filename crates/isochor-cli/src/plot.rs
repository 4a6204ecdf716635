//! HB, figure 9, time against vertices, CO, figure 3, time against grid cells, and HML, figures 5 to 8, error against time: drawn as SVG, both axes
//! logarithmic. CVB, figures 5 and 6, angles against stretches, one above the other.

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

use crate::bench_elastic::{ElasticBench, LevelsRun};
use crate::bench_lattice::{LatticeBench, ModelRow};
use crate::bench_surface::{GridRow, SurfaceBench};
use crate::failure::Failure;
use crate::files::Pending;
use crate::paper;
use crate::request::has_extension;
use crate::stages::Stage;
use crate::stress_angle::{AngleFit, BETWEEN, StressAngles, angle};
use crate::table::{grouped, threads};
use crate::terminal::Terminal;

/// Width and height of a chart in pixels.
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
    caption: String,
    /// What is along x.
    x: &'static str,
    /// And along y.
    y: &'static str,
    axes: Axes,
    series: Vec<Series>,
    names: SeriesLabelPosition,
}

/// How numbers lie along both axes.
#[derive(Clone, Copy)]
enum Axes {
    Logarithmic,
    /// From 0, or below where there is something.
    Even,
}

/// Points (x, y).
struct Series {
    /// `None`: it belongs to the one before.
    name: Option<String>,
    color: RGBColor,
    look: Look,
    points: Vec<(f64, f64)>,
}

/// What is seen of points.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Look {
    DottedLine,
    Line,
    Dots,
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
    let paper = |name: &str, color, time: fn(&paper::Times) -> f64| {
        let points = paper::TABLE_2.iter().map(|row| (row.vertices as f64, time(row))).collect();
        Series::dotted(Some(name.into()), color, points)
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
        series.push(Series::dotted(Some(name), color, here(run, Stage::Offsets)));
    }
    if let Some(last) = runs.checked_sub(1) {
        let name = format!("here, {}, nearest and moved", threads(last));
        series.push(Series::dotted(Some(name), NEAREST, here(last, Stage::Nearest)));
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
        series.push(Series::dotted(Some(name), color, bench.grids.iter().map(point).collect()));
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
        series.push(Series::dotted(Some(name), color, points(&row.multi)));
        series.push(Series::dotted(None, color, points(&row.single)));
    }
    Chart {
        caption: "Nodes that settle level after level; single dots: on the mesh alone".into(),
        x: "milliseconds",
        y: "farthest from balance, in extents",
        axes: Axes::Logarithmic,
        series,
        names: SeriesLabelPosition::UpperRight,
    }
    .svg()
}

/// The angle of local stress as the largest of many directions, and as a polynomial.
pub fn of_stress_angles(stress: &StressAngles) -> Result<String, Failure> {
    /// Places of a line. More: larger files; fewer: corners where it is steep.
    const PLACES: usize = 120;
    /// Dots of a polynomial.
    const DOTS: usize = 40;
    let parts = |count: usize| (0..=count).map(move |n| n as f64 / count as f64);
    // Closer together at the steep end.
    let line = |s1: f64, low: f64| {
        parts(PLACES).map(|part| low + (s1 - low) * part * part).map(|s3| (s3, angle([s1, s3, s3]))).collect()
    };

    let mut simulated =
        vec![Series { name: Some("closed form".into()), color: BLACK, look: Look::Line, points: line(1.0, 0.0) }];
    for (turn, (between, color)) in BETWEEN.into_iter().zip(EXAMPLES).enumerate() {
        let name = match between {
            0.0 => "s₂ = s₃".into(),
            1.0 => "s₂ = s₁".into(),
            part => format!("s₂ = s₃ + {part} (s₁ − s₃)"),
        };
        let rows = stress.simulated.iter().skip(turn).step_by(BETWEEN.len());
        let points = rows.map(|row| (row.stretches[2] / row.stretches[0], row.simulated)).collect();
        simulated.push(Series { name: Some(name), color, look: Look::Dots, points });
    }
    let simulated = Chart {
        caption: "CVB, figure 5: the largest angle of many directions".into(),
        x: "s₃/s₁",
        y: "degrees",
        axes: Axes::Even,
        series: simulated,
        names: SeriesLabelPosition::UpperRight,
    };

    /// s₁ of the lines of figure 6, in parts of the largest stretch.
    const PARTS: [f64; 4] = [0.1, 0.25, 0.5, 1.0];
    // Of the fits the one whose error is nearest to the paper's.
    let off = |fit: &&AngleFit| (fit.average_error - stress.paper_average_error).abs();
    let (mut fitted, mut caption) = (Vec::new(), String::new());
    if let Some(fit) = stress.fits.iter().min_by(|a, b| off(a).total_cmp(&off(b))) {
        caption = format!(
            "CVB, figure 6: the angle (lines) and a polynomial of degree 6 (dots), stretches from 1/{0} to {0}",
            fit.factor
        );
        for (part, color) in PARTS.into_iter().zip(EXAMPLES) {
            let s1 = part * fit.factor;
            let low = 1.0 / fit.factor;
            let dots = parts(DOTS).map(|part| low + (s1 - low) * part).map(|s3| (s3, fit.angle([s1, s3]))).collect();
            fitted.push(Series { name: Some(format!("s₁ = {s1}")), color, look: Look::Line, points: line(s1, low) });
            fitted.push(Series { name: None, color, look: Look::Dots, points: dots });
        }
    }
    let fitted = Chart {
        caption,
        x: "s₃",
        y: "degrees",
        axes: Axes::Even,
        series: fitted,
        names: SeriesLabelPosition::UpperRight,
    };
    Chart::svg_of(&[simulated, fitted])
}

/// From the power of ten below the least to that above the largest.
fn decades(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let ends = numbers.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    10f64.powf(ends.0.log10().floor())..10f64.powf(ends.1.log10().ceil())
}

/// From the least to the largest, and 0.
fn from_nothing(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = numbers.fold((0.0, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    low..high
}

/// A number at an axis, without what rounding adds to it.
fn label(x: &f64) -> String {
    let rounded: f64 = format!("{x:.9e}").parse().unwrap_or(*x);
    (rounded + 0.0).to_string() // −0 + 0 = 0
}

type DrawingError = DrawingAreaErrorKind<std::io::Error>;

impl Series {
    fn dotted(name: Option<String>, color: RGBColor, points: Vec<(f64, f64)>) -> Self {
        Self { name, color, look: Look::DottedLine, points }
    }
}

impl Chart {
    /// Of milliseconds that grow with what is along x.
    fn of_times(caption: &'static str, x: &'static str, series: Vec<Series>) -> Self {
        let (axes, names) = (Axes::Logarithmic, SeriesLabelPosition::UpperLeft);
        Self { caption: caption.into(), x, y: "milliseconds", axes, series, names }
    }

    fn svg(&self) -> Result<String, Failure> {
        Self::svg_of(std::slice::from_ref(self))
    }

    /// One above the other.
    fn svg_of(charts: &[Self]) -> Result<String, Failure> {
        Self::drawn(charts).map_err(|error| Failure {
            exit: 2,
            code: "plot",
            what: format!("the plot cannot be drawn: {error}"),
            place: "--plot".into(),
            hint: "leave --plot out".into(),
        })
    }

    fn drawn(charts: &[Self]) -> Result<String, DrawingError> {
        let mut text = String::new();
        let size = (SIZE.0, SIZE.1 * charts.len() as u32);
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE)?;
        for (chart, area) in charts.iter().zip(root.split_evenly((charts.len(), 1))) {
            chart.draw(&area)?;
        }
        root.present()?;
        drop(root);
        Ok(text)
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), DrawingError> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let mut builder = ChartBuilder::on(area);
        builder
            .caption(&self.caption, ("sans-serif", 18))
            .margin(16)
            .margin_right(40)
            .x_label_area_size(44)
            .y_label_area_size(64);
        match self.axes {
            Axes::Logarithmic => {
                let (x, y) = (decades(points().map(|p| p.0)), decades(points().map(|p| p.1)));
                self.fill(builder.build_cartesian_2d(x.log_scale(), y.log_scale())?, 10)
            }
            Axes::Even => {
                let (x, y) = (from_nothing(points().map(|p| p.0)), from_nothing(points().map(|p| p.1)));
                self.fill(builder.build_cartesian_2d(x, y)?, 2)
            }
        }
    }

    /// Draws all but the axes' scales, with so many light lines between two others.
    fn fill<'a, 'b: 'a, X, Y>(
        &self,
        mut chart: ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>,
        light_lines: usize,
    ) -> Result<(), DrawingError>
    where
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        chart
            .configure_mesh()
            .max_light_lines(light_lines)
            .x_desc(self.x)
            .y_desc(self.y)
            .x_label_formatter(&label)
            .y_label_formatter(&label)
            .draw()?;
        for Series { name, color, look, points } in &self.series {
            let key = *color;
            let line = if *look == Look::Dots { &[][..] } else { points };
            let drawn = chart.draw_series(LineSeries::new(line.iter().copied(), color.stroke_width(2)))?;
            if let Some(name) = name {
                drawn.label(name);
                match look {
                    Look::Dots => drawn.legend(move |(x, y)| Circle::new((x + 10, y), 3, key.filled())),
                    Look::Line | Look::DottedLine => {
                        drawn.legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], key.stroke_width(2)))
                    }
                };
            }
            let dots = if *look == Look::Line { &[][..] } else { points };
            chart.draw_series(dots.iter().map(|point| Circle::new(*point, 3, color.filled())))?;
        }
        chart.configure_series_labels().position(self.names.clone()).background_style(WHITE).border_style(BLACK).draw()
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

    #[test]
    fn even_axes_hold_all_numbers_and_nothing() {
        assert_eq!(from_nothing([0.5, 9.0].into_iter()), 0.0..9.0);
        assert_eq!(from_nothing([-2.0, -1.0].into_iter()), -2.0..0.0);
    }

    #[test]
    fn labels_are_round() {
        for (x, expected) in
            [(0.1 + 0.2, "0.3"), (0.0, "0"), (-0.0, "0"), (1e-12, "0.000000000001"), (1e6, "1000000"), (-40.0, "-40")]
        {
            assert_eq!(label(&x), expected);
        }
    }
}
