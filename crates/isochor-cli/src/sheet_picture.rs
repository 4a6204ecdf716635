//! A flattened sheet with a model on it, as SVG: grid lines, projected edges, and the three kinds of points between which faces are
//! divided (CO, figures 5 and 6).

use std::path::Path;

use glam::DVec2;
use isochor::{SheetDrawing, SubdivisionPoint};
use plotters::prelude::*;

use crate::failure::Failure;

/// Longer side in pixels.
const SIDE: f64 = 900.0;

/// Room round the sheet, in pixels.
const MARGIN: f64 = 20.0;

/// Most edges and points that are drawn. More: files that no program shows; fewer: large models look unfinished.
const MOST: usize = 200_000;

const GRID: RGBColor = RGBColor(205, 205, 205);
const EDGE: RGBColor = RGBColor(120, 120, 120);
const VERTEX: RGBColor = RGBColor(20, 20, 20);
/// The colours of the paper's figures.
const EDGE_POINT: RGBColor = RGBColor(40, 70, 200);
const FACE_POINT: RGBColor = RGBColor(200, 40, 40);

/// The picture. Vertex points are black, edge points blue, face points red; those that are not kept are hollow.
pub fn svg(drawing: &SheetDrawing, path: &Path) -> Result<String, Failure> {
    drawn(drawing).map_err(|error| Failure::file(path, format!("the sheet cannot be drawn: {error}"), "leave it out"))
}

fn drawn(drawing: &SheetDrawing) -> Result<String, DrawingAreaErrorKind<std::io::Error>> {
    let sheet = drawing.sheet();
    let flat = sheet.flat();
    let on_sheet: Vec<DVec2> = drawing.placed.points().iter().map(|q| q.truncate()).collect();
    let all = || flat.iter().chain(&on_sheet);
    let low = all().fold(DVec2::INFINITY, |low, p| low.min(*p));
    let high = all().fold(DVec2::NEG_INFINITY, |high, p| high.max(*p));
    let per_length = SIDE / (high - low).max_element();
    let pixel = |p: DVec2| {
        let d = (p - low) * per_length + MARGIN;
        (d.x as i32, ((high - low).y * per_length + 2.0 * MARGIN - d.y) as i32)
    };
    let size = (high - low) * per_length + 2.0 * MARGIN;
    let mut text = String::new();
    let root = SVGBackend::with_string(&mut text, (size.x.ceil() as u32, size.y.ceil() as u32)).into_drawing_area();
    root.fill(&WHITE)?;
    let [n, m] = sheet.cells();
    let at = |i: usize, j: usize| pixel(flat[i * (m + 1) + j]);
    for i in 0..=n {
        root.draw(&PathElement::new((0..=m).map(|j| at(i, j)).collect::<Vec<_>>(), GRID))?;
    }
    for j in 0..=m {
        root.draw(&PathElement::new((0..=n).map(|i| at(i, j)).collect::<Vec<_>>(), GRID))?;
    }
    let edges = drawing
        .placed
        .faces()
        .iter()
        .flat_map(|face| (0..face.len()).map(|k| [face[k], face[(k + 1) % face.len()]]).filter(|[a, b]| a < b));
    for edge in edges.take(MOST) {
        root.draw(&PathElement::new(edge.map(|v| pixel(on_sheet[v as usize])).to_vec(), EDGE))?;
    }
    let draw_points = |points: &[SubdivisionPoint], color: RGBColor| {
        points.iter().take(MOST).try_for_each(|point| {
            let style = if point.is_kept { color.filled() } else { color.stroke_width(1) };
            root.draw(&Circle::new(pixel(point.flat), 3, style))
        })
    };
    if let Some(division) = drawing.division {
        draw_points(&division.face_points, FACE_POINT)?;
        draw_points(&division.edge_points, EDGE_POINT)?;
    }
    for p in on_sheet[..drawing.vertex_points()].iter().take(MOST) {
        root.draw(&Circle::new(pixel(*p), 3, VERTEX.filled()))?;
    }
    root.present()?;
    drop(root);
    Ok(text)
}
