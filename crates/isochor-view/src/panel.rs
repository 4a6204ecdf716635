//! One pose, drawn: surface, lattice and dots in a panel.

use std::ops::Range;

use glam::DVec3;
use isochor::{Bounds, DragPlane, NetKind};

use crate::camera::Camera;
use crate::color_scale::{ColorScale, NO_VALUE};
use crate::image::{Image, Rgb};
use crate::ink::{self, Stroke};
use crate::light::{color_of, light_of, shaded};
use crate::normals::Normals;
use crate::parallel;
use crate::raster::{BAND, NOTHING, Raster, SAMPLES, Screen};
use crate::show::ShownLattice;
use crate::surface::Surface;

/// The model without a scale: a light grey with a little blue.
const PLAIN: Rgb = [222, 225, 232];

/// The inside of open models: the warm counterpart.
const INSIDE: Rgb = [219, 164, 120];

/// Part of the light that is left on the inside of models with a scale. Larger: it looks like the outside; smaller: no
/// colour can be read there.
const BACK: f64 = 0.6;

/// Lattice lines and springs, control points, and nodes that are held while the others settle.
const LATTICE: Rgb = [46, 62, 92];
pub(crate) const CONTROLS: Rgb = [28, 64, 140];
pub(crate) const HELD: Rgb = [247, 170, 30];

/// Width of lattice lines, springs, lines of drag planes, control points, and nodes with springs, in pixels of a panel of [`REFERENCE`] pixels. Larger: they cover the
/// model; smaller: they vanish, or one cannot see which nodes are held.
const LINE_WIDTH: f64 = 1.0;
const SPRING_WIDTH: f64 = 0.7;
const PLANE_WIDTH: f64 = 1.5;
const DOT_WIDTH: f64 = 4.2;
const NODE_WIDTH: f64 = 5.6;
const REFERENCE: f64 = 480.0;

/// Of lattices with more control points than this along some axis only the six sides are drawn, with smaller dots.
/// Larger: nothing can be seen behind them; smaller: the inside of ordinary lattices is missing.
const ROOMY: f64 = 10.0;

/// Strength of lattice lines and control points, nearest and farthest: what is far away is paler. Larger: they cover
/// the model; smaller: they vanish. Springs are many, drag planes few: these have the strength of control points.
const LINE_STRENGTHS: [f64; 2] = [0.58, 0.26];
const SPRING_STRENGTHS: [f64; 2] = [0.42, 0.16];
const DOT_STRENGTHS: [f64; 2] = [0.95, 0.55];

/// Part of the strength that is left behind the model. Larger: one cannot tell what is before it; smaller: hidden lines
/// vanish.
const HIDDEN: f32 = 0.22;

/// Steps of a scale. More: memory; fewer: bands of colour.
const SHADES: usize = 1024;

/// What is drawn.
pub(crate) struct Panel<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) points: &'a [DVec3],
    /// Places of the vertices on the scale (not a number: none), and the scale.
    pub(crate) colored: Option<(&'a [f64], ColorScale)>,
    pub(crate) lattice: Option<&'a ShownLattice<'a>>,
    pub(crate) camera: &'a Camera,
    /// Width and height in pixels, and which of the rows are wanted.
    pub(crate) size: [usize; 2],
    pub(crate) rows: Range<usize>,
    pub(crate) background: Rgb,
    /// Whether triangles run clockwise seen from outside.
    pub(crate) is_inside_out: bool,
}

/// A panel with all that its bands need.
struct Prepared<'a> {
    panel: &'a Panel<'a>,
    raster: Raster<'a>,
    normals: Normals<'a>,
    strokes: Strokes,
    palette: Palette,
}

/// What is drawn over the surface.
#[derive(Default)]
struct Strokes {
    lines: Vec<Stroke>,
    dots: Vec<Stroke>,
    held: Vec<Stroke>,
}

/// Colours as light.
struct Palette {
    plain: DVec3,
    inside: DVec3,
    none: DVec3,
    background: DVec3,
    lattice: DVec3,
    controls: DVec3,
    held: DVec3,
    /// Of the scale from end to end; empty without a scale.
    shades: Vec<DVec3>,
}

impl Panel<'_> {
    /// The wanted rows of the panel as an image.
    pub(crate) fn image(&self) -> Image {
        let screen = Screen::new(self.camera, self.size);
        let points = &self.points[..self.surface.vertices()];
        let seen = parallel::collect(points.len(), |v| self.camera.seen(points[v]));
        let (raster, normals) = parallel::both(
            || Raster::new(screen, &self.surface.triangles, &seen),
            || Normals::new(self.surface, &seen),
        );
        let strokes = self.strokes(&screen);
        let prepared = Prepared { panel: self, raster, normals, strokes, palette: self.palette() };
        let first = self.rows.start / BAND;
        let bands = parallel::map(self.rows.end.div_ceil(BAND) - first, |band| prepared.pixels(first + band));
        let skipped = (self.rows.start - first * BAND) * self.size[0];
        let pixels = bands.into_iter().flatten().skip(skipped).take(self.rows.len() * self.size[0]).collect();
        Image::of_rows(self.size[0], pixels)
    }

    fn palette(&self) -> Palette {
        let shade = |scale: &ColorScale, i: usize| light_of(scale.color_at(i as f64 / (SHADES - 1) as f64));
        let shades = |(_, scale): &(&[f64], ColorScale)| (0..SHADES).map(|i| shade(scale, i)).collect();
        Palette {
            plain: light_of(PLAIN),
            inside: light_of(INSIDE),
            none: light_of(NO_VALUE),
            background: light_of(self.background),
            lattice: light_of(LATTICE),
            controls: light_of(CONTROLS),
            held: light_of(HELD),
            shades: self.colored.as_ref().map(shades).unwrap_or_default(),
        }
    }

    /// Lines between neighbouring control points, or springs; the control points; and those that are held. Of a grid the lines alone.
    fn strokes(&self, screen: &Screen) -> Strokes {
        let Some(lattice) = self.lattice else { return Strokes::default() };
        let seen: Vec<DVec3> = lattice.controls.iter().map(|c| self.camera.seen(*c)).collect();
        let distances = seen.iter().filter(|c| c.is_finite()).map(|c| -c.z);
        let [near, far] =
            distances.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], w| [low.min(w), high.max(w)]);
        let strength = |[nearest, farthest]: [f64; 2], place: DVec3| {
            let depth = if far > near { ((-place.z - near) / (far - near)).clamp(0.0, 1.0) } else { 0.0 };
            (nearest + (farthest - nearest) * depth) as f32
        };
        let zoom = (self.size[0].min(self.size[1]) as f64 / REFERENCE).max(1.0);
        let size = lattice.size;
        let seen = &seen[..nodes(size, seen.len())];
        // Vertices of a cage are not in each other's way.
        let is_cage = lattice.net.as_ref().is_some_and(|net| net.kind == NetKind::Cage);
        let most = if is_cage { 1 } else { size.into_iter().max().unwrap_or(0) };
        let crowd = (ROOMY / most as f64).min(1.0);
        // On one of the six sides, both of them.
        let is_shown = |[a, b]: [[usize; 3]; 2]| {
            let is_outer = |axis: usize| a[axis] == b[axis] && (a[axis] == 0 || a[axis] + 1 == size[axis]);
            crowd == 1.0 || (0..3).any(is_outer)
        };
        let line = |[a, b]: [usize; 2], width: f64, strengths: [f64; 2]| {
            let ends = [*seen.get(a)?, *seen.get(b)?];
            let strength = strength(strengths, (ends[0] + ends[1]) / 2.0);
            is_shown([a, b].map(|node| place(size, node)))
                .then(|| Stroke::line(screen, ends, zoom * width, strength))?
        };
        let dot = |node: usize, width: f64| {
            let strength = strength(DOT_STRENGTHS, seen[node]);
            let width = zoom * (width * crowd).max(2.0 * LINE_WIDTH);
            is_shown([place(size, node); 2]).then(|| Stroke::dot(screen, seen[node], width, strength))?
        };
        if let Some(net) = &lattice.net {
            let (width, strengths) = match net.kind {
                NetKind::Springs => (SPRING_WIDTH, SPRING_STRENGTHS),
                NetKind::Cage => (LINE_WIDTH, LINE_STRENGTHS),
            };
            let spring = |[a, b]: &[u32; 2]| line([*a as usize, *b as usize], width, strengths);
            let is_held = |node: usize| net.is_held.get(node) == Some(&true);
            let (held, free): (Vec<usize>, Vec<usize>) = (0..seen.len()).partition(|node| is_held(*node));
            let dots = |nodes: Vec<usize>| nodes.into_iter().filter_map(|node| dot(node, NODE_WIDTH)).collect();
            // A net of lines in each drag plane, about its vertex.
            let planes = plane_lines(lattice).into_iter().filter_map(|ends| {
                let ends = ends.map(|p| self.camera.seen(p));
                Stroke::line(screen, ends, zoom * PLANE_WIDTH, strength(DOT_STRENGTHS, (ends[0] + ends[1]) / 2.0))
            });
            return Strokes {
                lines: net.ends.iter().filter_map(spring).chain(planes).collect(),
                dots: dots(free),
                held: dots(held),
            };
        }
        let [u, v, w] = size;
        let is_grid = u > 1 && v > 1 && w == 1;
        Strokes {
            lines: edges(size, seen.len()).filter_map(|ends| line(ends, LINE_WIDTH, LINE_STRENGTHS)).collect(),
            dots: (0..if is_grid { 0 } else { seen.len() }).filter_map(|node| dot(node, DOT_WIDTH)).collect(),
            held: Vec::new(),
        }
    }
}

/// Half the side of a drag plane as it is drawn, in extents of the controls. Larger: it hides the model; smaller: one cannot tell how it lies.
const PLANE: f64 = 0.16;

/// Lines in all drag planes.
pub(crate) fn plane_lines(lattice: &ShownLattice) -> Vec<[DVec3; 2]> {
    let reach = PLANE * extent(&lattice.controls);
    lattice.planes.iter().flat_map(|plane| lines_of(plane, reach)).collect()
}

/// Lines in a drag plane through the vertex, up to `reach` from it, and its normal, half as long.
fn lines_of(plane: &DragPlane, reach: f64) -> Vec<[DVec3; 2]> {
    const LINES: i32 = 2; // on either side of the middle
    let Some(normal) = plane.gradient.try_normalize() else { return Vec::new() };
    let (u, v) = normal.any_orthonormal_pair();
    let line = |along: DVec3, across: DVec3, k: i32| {
        let middle = plane.origin + across * (reach * f64::from(k) / f64::from(LINES));
        [middle - along * reach, middle + along * reach]
    };
    let grid = (-LINES..=LINES).flat_map(|k| [line(u, v, k), line(v, u, k)]);
    grid.chain([[plane.origin, plane.origin + normal * (reach / 2.0)]]).collect()
}

/// The longest side of the box round finite points.
fn extent(points: &[DVec3]) -> f64 {
    let finite: Vec<DVec3> = points.iter().copied().filter(|p| p.is_finite()).collect();
    Bounds::of(&finite).map_or(0.0, |bounds| bounds.extent())
}

/// Number of control points that both a lattice of this size and its positions have.
fn nodes(size: [usize; 3], controls: usize) -> usize {
    size.into_iter().fold(1, usize::saturating_mul).min(controls)
}

/// Index of a control point along u, v, w.
fn place(size: [usize; 3], node: usize) -> [usize; 3] {
    [node / size[1].saturating_mul(size[2]), node / size[2] % size[1], node % size[2]]
}

/// Neighbours along u, v or w in a lattice of which `controls` positions are known. The second may be one whose position is not known.
fn edges(size: [usize; 3], controls: usize) -> impl Iterator<Item = [usize; 2]> {
    let strides = [size[1].saturating_mul(size[2]), size[2], 1];
    (0..nodes(size, controls)).flat_map(move |node| {
        let place = place(size, node);
        let axes = (0..3).filter(move |&axis| place[axis] + 1 < size[axis]);
        axes.map(move |axis| [node, node.saturating_add(strides[axis])])
    })
}

impl Prepared<'_> {
    /// Pixels of a band, row after row.
    fn pixels(&self, band: usize) -> Vec<Rgb> {
        let screen = &self.raster.screen;
        let depths = self.raster.depths(band);
        let Strokes { lines, dots, held } = &self.strokes;
        let [lines, dots, held] =
            [lines, dots, held].map(|strokes| ink::strengths(screen, band, strokes, &depths, HIDDEN));
        let rows = screen.rows(band);
        let mut brush = Brush::new(self);
        let mut pixels = Vec::with_capacity(rows.len() / SAMPLES * screen.size[0]);
        for top in rows.clone().step_by(SAMPLES) {
            for left in (0..screen.row()).step_by(SAMPLES) {
                let first = (top - rows.start) * screen.row() + left;
                let samples: [usize; SAMPLES * SAMPLES] =
                    std::array::from_fn(|i| first + i / SAMPLES * screen.row() + i % SAMPLES);
                let light = brush.lights(samples.map(|sample| depths.triangle[sample]), [left, top]);
                let inked = |(sample, light): (usize, DVec3)| {
                    let lined = light.lerp(self.palette.lattice, f64::from(lines[sample]));
                    // The nearer of two nodes is the stronger.
                    let (ink, color) = if held[sample] > dots[sample] {
                        (held[sample], self.palette.held)
                    } else {
                        (dots[sample], self.palette.controls)
                    };
                    lined.lerp(color, f64::from(ink))
                };
                let sum: DVec3 = samples.into_iter().zip(light).map(inked).sum();
                pixels.push(color_of(sum / samples.len() as f64));
            }
        }
        pixels
    }
}

/// So many triangles of a pixel are shaded, each once; others look like their mean. More: time; fewer: pixels with more
/// triangles than this are noisy.
const SHADED: usize = 4;

/// Shades samples; knows the triangle of the last one, because the next is mostly on the same.
struct Brush<'a> {
    prepared: &'a Prepared<'a>,
    triangle: u32,
    /// Products of its corners seen from the eye: of the second and third, the third and first, the first and second.
    /// The weights of the corners along a line of sight are their products with it.
    products: [DVec3; 3],
    normals: [DVec3; 3],
    /// Places of its corners on the scale.
    places: [f64; 3],
    /// Normal on the side that is seen.
    side: DVec3,
    is_back: bool,
}

impl<'a> Brush<'a> {
    fn new(prepared: &'a Prepared<'a>) -> Self {
        let (triangle, products, normals) = (NOTHING, [DVec3::ZERO; 3], [DVec3::ZERO; 3]);
        Self { prepared, triangle, products, normals, places: [0.0; 3], side: DVec3::Z, is_back: false }
    }

    /// The light from all samples of the pixel whose first sample is `first` from the left and the top.
    fn lights(&mut self, triangles: [u32; SAMPLES * SAMPLES], first: [usize; 2]) -> [DVec3; SAMPLES * SAMPLES] {
        let mut known = [(NOTHING, self.prepared.palette.background); SHADED + 1];
        let mut count = 1;
        let [left, top] = first.map(|x| x as f64 + 0.5);
        let is_alike = triangles.iter().all(|t| *t == triangles[0]);
        if is_alike {
            // Of one triangle the light of the pixel's middle will do.
            let middle = (SAMPLES - 1) as f64 / 2.0;
            return [self.light(triangles[0], [left + middle, top + middle]); SAMPLES * SAMPLES];
        }
        for (i, &triangle) in triangles.iter().enumerate() {
            if count <= SHADED && known[..count].iter().all(|(t, _)| *t != triangle) {
                let at = [left + (i % SAMPLES) as f64, top + (i / SAMPLES) as f64];
                known[count] = (triangle, self.light(triangle, at));
                count += 1;
            }
        }
        let shaded = &known[1..count];
        let mean = shaded.iter().map(|(_, light)| *light).sum::<DVec3>() / shaded.len().max(1) as f64;
        triangles.map(|triangle| known[..count].iter().find(|(t, _)| *t == triangle).map_or(mean, |(_, light)| *light))
    }

    /// The light from `triangle` at a place of the screen, in samples from the left and the top.
    fn light(&mut self, triangle: u32, at: [f64; 2]) -> DVec3 {
        let Prepared { panel, raster, palette, .. } = self.prepared;
        if triangle == NOTHING {
            return palette.background;
        }
        if triangle != self.triangle {
            self.take(triangle);
        }
        let sight = raster.screen.sight(at);
        let weights = self.products.map(|product| product.dot(sight));
        let sum: f64 = weights.iter().sum();
        // Samples at the border may be a little outside; of a triangle that is seen from its side nothing is known.
        let inner = weights.map(|w| (w / sum).clamp(0.0, 1.0));
        let sum: f64 = inner.iter().sum();
        let weights = if sum > 0.0 { inner.map(|w| w / sum) } else { [1.0 / 3.0; 3] };

        let smooth: DVec3 = (0..3).map(|i| self.normals[i] * weights[i]).sum();
        let normal = smooth.try_normalize().unwrap_or(self.side);
        let base = if palette.shades.is_empty() {
            if self.is_back { palette.inside } else { palette.plain }
        } else {
            let place: f64 = (0..3).map(|i| self.places[i] * weights[i]).sum();
            let shade = (place.clamp(0.0, 1.0) * (SHADES - 1) as f64).round();
            let side = if self.is_back { BACK } else { 1.0 };
            if shade.is_nan() { palette.none } else { palette.shades[shade as usize] * side }
        };
        shaded(base, normal, -sight.normalize(), panel.camera.zenith())
    }

    /// Makes `triangle` the one that is shaded.
    fn take(&mut self, triangle: u32) {
        let Prepared { panel, raster, normals, .. } = self.prepared;
        let corners = raster.triangles[triangle as usize];
        let [a, b, c] = corners.map(|v| raster.seen[v as usize]);
        self.triangle = triangle;
        self.products = [b.cross(c), c.cross(a), a.cross(b)];
        // The eye is at 0: it is on the side of the normal n where n · a < 0.
        let is_clockwise = a.dot(self.products[0]) > 0.0;
        self.is_back = is_clockwise != panel.is_inside_out;
        let sign = if is_clockwise { -1.0 } else { 1.0 };
        self.normals = normals.at_corners(triangle as usize).map(|n| n * sign);
        self.side = ((b - a).cross(c - a) * sign).try_normalize().unwrap_or(DVec3::Z);
        if let Some((places, _)) = panel.colored {
            self.places = corners.map(|v| places[v as usize]);
        }
    }
}

/// Whether a surface over `points` is inside out: its signed volume about the middle of the points is clearly negative.
pub(crate) fn is_inside_out(surface: &Surface, points: &[DVec3], camera: &Camera) -> bool {
    let pieces = |range: Range<usize>| {
        let volume = |[a, b, c]: [DVec3; 3]| a.cross(b).dot(c);
        let corners = |t: &[u32; 3]| t.map(|v| camera.centered(points[v as usize]));
        surface.triangles[range].iter().map(corners).map(volume).filter(|v| v.is_finite()).sum::<f64>()
    };
    parallel::map_chunks(surface.triangles.len(), parallel::CHUNK, pieces).into_iter().sum::<f64>() < -CLEARLY
}

/// Six times the volume, in cubed half extents, from which on a surface counts as inside out. Larger: thin bodies that
/// are inside out show their inside; smaller: open sheets show either side, as rounding wants.
const CLEARLY: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_has_an_edge_between_neighbours() {
        // l (m − 1) n and so on.
        for [l, m, n] in [[2, 2, 2], [3, 4, 5], [1, 1, 1], [1, 2, 3]] {
            let count = (l - 1) * m * n + l * (m - 1) * n + l * m * (n - 1);
            assert_eq!(edges([l, m, n], l * m * n).count(), count);
        }
        let pairs = edges([2, 1, 2], 4);
        assert_eq!(pairs.collect::<Vec<_>>(), [[0, 2], [0, 1], [1, 3], [2, 3]]);
    }

    #[test]
    fn a_lattice_without_control_points_has_no_edges() {
        assert_eq!(edges([0, 3, 3], 9).count(), 0);
        assert_eq!(edges([usize::MAX; 3], 0).count(), 0);
    }
}
