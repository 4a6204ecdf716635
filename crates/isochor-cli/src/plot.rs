//! HB, figure 9: time against vertices, drawn as SVG, both axes logarithmic.

use plotters::prelude::*;

use crate::bench_lattice::{LatticeBench, ModelRow};
use crate::failure::Failure;
use crate::paper;
use crate::stages::Stage;

/// Width and height in pixels.
const SIZE: (u32, u32) = (880, 560);

/// A line through points (vertices, milliseconds).
struct Series {
    name: String,
    color: RGBColor,
    points: Vec<(f64, f64)>,
}

/// Colours of the paper's figure for its own, darker and lighter ones for others.
const CPU: RGBColor = RGBColor(200, 40, 40);
const GPU: RGBColor = RGBColor(40, 70, 200);
const ONE_AXIS: [RGBColor; 2] = [RGBColor(20, 120, 60), RGBColor(90, 190, 120)];
const NEAREST: RGBColor = RGBColor(150, 110, 20);

/// The times of one axis here and in the paper, and of the smallest displacement with all threads.
pub fn of_lattice_bench(bench: &LatticeBench) -> Result<String, Failure> {
    let paper = |name: &str, color, time: fn(&paper::Times) -> f64| Series {
        name: name.into(),
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
    let threads = |run: usize| match bench.models[0].runs[run].threads {
        1 => "1 thread".into(),
        threads => format!("{threads} threads"),
    };
    for (run, color) in (0..runs).zip(ONE_AXIS) {
        let name = format!("here, {}", threads(run));
        series.push(Series { name, color, points: here(run, Stage::Offsets) });
    }
    if let Some(last) = runs.checked_sub(1) {
        let name = format!("here, {}, nearest and moved", threads(last));
        series.push(Series { name, color: NEAREST, points: here(last, Stage::Nearest) });
    }
    drawn(&series).map_err(|error| Failure {
        exit: 2,
        code: "plot",
        what: format!("the plot cannot be drawn: {error}"),
        place: "--plot".into(),
        hint: "leave --plot out".into(),
    })
}

/// From the power of ten below the least to that above the largest.
fn decades(numbers: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let ends = numbers.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    10f64.powf(ends.0.log10().floor())..10f64.powf(ends.1.log10().ceil())
}

fn drawn(series: &[Series]) -> Result<String, DrawingAreaErrorKind<std::io::Error>> {
    let points = || series.iter().flat_map(|series| &series.points);
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (x, y) = (decades(points().map(|p| p.0)), decades(points().map(|p| p.1)));
    let mut chart = ChartBuilder::on(&root)
        .caption("Volume correction along one axis", ("sans-serif", 18))
        .margin(16)
        .margin_right(40)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(x.log_scale(), y.log_scale())?;
    chart
        .configure_mesh()
        .x_desc("vertices")
        .y_desc("milliseconds")
        .x_label_formatter(&|x| x.to_string())
        .y_label_formatter(&|y| y.to_string())
        .draw()?;
    for Series { name, color, points } in series {
        let line = LineSeries::new(points.iter().copied(), color.stroke_width(2));
        let key = *color;
        chart
            .draw_series(line)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], key.stroke_width(2)));
        chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, color.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE)
        .border_style(BLACK)
        .draw()?;
    root.present()?;
    drop(chart);
    drop(root);
    Ok(text)
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
