//! Where straight edges over a flattened sheet cross its grid lines.
//!
//! Grid line i along t is the polyline through the flattened points (i, ·), grid line j along s that through (·, j). Signs of
//! orientations are exact (the crate `robust`), so that an edge crosses a grid line, or passes through a grid point, or does neither. They are CO's
//! edge points (section 3.2 (b)).
//!
//! # Changes versus the paper
//!
//! CO does not say what becomes of an edge through a grid point, or along a grid line: there is one point of two lines at each grid point on the edge.

use glam::DVec2;
use robust::Coord;

use crate::sheet::Sheet;
use crate::surface::Jet;

/// A grid line: its index counts along s where it runs along t (`s = s_i`), and along t where it runs along s (`t = t_j`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum GridLine {
    /// s = s_i.
    OfS(u32),
    /// t = t_j.
    OfT(u32),
}

/// A crossing of an edge with one grid line or, at a grid point, with two.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Crossing {
    /// How far along the edge, in (0, 1).
    pub(crate) along: f64,
    pub(crate) lines: Vec<GridLine>,
    /// |Normal curvature| of the surface along the edge, 1/length.
    pub(crate) bend: f64,
}

/// Crossings that are closer to each other, or to an end of the edge, than this part of it are one. Larger: triangles of a cell's width
/// lose points; smaller: slivers.
pub(crate) const MERGE: f64 = 1e-9;

/// A sheet's grid, to be crossed.
pub(crate) struct Grid<'a> {
    sheet: &'a Sheet,
    /// Boxes of the strips of cells between grid lines i and i + 1 along s; that of the last line alone at the end.
    strips: Vec<[DVec2; 2]>,
}

impl<'a> Grid<'a> {
    pub(crate) fn new(sheet: &'a Sheet) -> Self {
        let [cells, points] = [sheet.cells()[0], sheet.cells()[1] + 1];
        let strip = |i: usize| {
            let of_strip = &sheet.flat()[i * points..sheet.flat().len().min((i + 2) * points)];
            let low = of_strip.iter().fold(DVec2::INFINITY, |low, p| low.min(*p));
            [low, of_strip.iter().fold(DVec2::NEG_INFINITY, |high, p| high.max(*p))]
        };
        Self { sheet, strips: (0..=cells).map(strip).collect() }
    }

    fn point(&self, i: usize, j: usize) -> DVec2 {
        self.sheet.flat()[i * (self.sheet.cells()[1] + 1) + j]
    }

    /// The surface at fractional grid coordinates.
    fn jet(&self, at: DVec2) -> Jet {
        let [n, m] = self.sheet.cells().map(|cells| cells as f64);
        self.sheet.surface().jet(at.x / n, at.y / m)
    }

    /// The grid points strictly within a polygon in the plane, and not on its edges to [`MERGE`]: their indices along s and t.
    pub(crate) fn points_within(&self, polygon: &[DVec2]) -> Vec<[usize; 2]> {
        let low = polygon.iter().fold(DVec2::INFINITY, |low, p| low.min(*p));
        let high = polygon.iter().fold(DVec2::NEG_INFINITY, |high, p| high.max(*p));
        let side = |k: usize| (polygon[k], polygon[(k + 1) % polygon.len()]);
        let is_within = |x: DVec2| {
            // A ray to the right crosses the border an odd number of times.
            let is_crossed = |(a, b): (DVec2, DVec2)| {
                let is_up = a.y <= x.y;
                is_up != (b.y <= x.y) && (orientation(a, b, x) > 0.0) == is_up
            };
            (0..polygon.len()).filter(|k| is_crossed(side(*k))).count() % 2 == 1
                && (0..polygon.len()).all(|k| !is_near(side(k), x))
        };
        let mut found = Vec::new();
        for (i, [strip_low, strip_high]) in self.strips.iter().enumerate() {
            if strip_low.cmpgt(high).any() || strip_high.cmplt(low).any() {
                continue;
            }
            for j in 0..=self.sheet.cells()[1] {
                let x = self.point(i, j);
                if x.cmpge(low).all() && x.cmple(high).all() && is_within(x) {
                    found.push([i, j]);
                }
            }
        }
        found
    }

    /// Place of a grid point in the plane.
    pub(crate) fn place(&self, [i, j]: [usize; 2]) -> DVec2 {
        self.point(i, j)
    }

    /// |Normal curvature| along both grid lines through a grid point: along t on `s = s_i`, along s on `t = t_j`; 1/length.
    pub(crate) fn bends(&self, [i, j]: [usize; 2]) -> [f64; 2] {
        let jet = self.jet(DVec2::new(i as f64, j as f64));
        [bend(&jet, DVec2::Y), bend(&jet, DVec2::X)]
    }

    /// The crossings of the edge from p to q in the plane, in order; none where no crossed cell is shorter than the edge.
    pub(crate) fn crossings(&self, p: DVec2, q: DVec2) -> Vec<Crossing> {
        let mut found = self.all_crossings(p, q);
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.retain(|(along, ..)| *along > MERGE && *along < 1.0 - MERGE);
        let is_long =
            found.iter().any(|(_, _, at)| self.step(*at, q - p).is_none_or(|step| step.abs().max_element() > 1.0));
        if !is_long {
            return Vec::new();
        }
        let mut crossings: Vec<Crossing> = Vec::new();
        for (along, line, at) in found {
            match crossings.last_mut() {
                Some(last) if along - last.along <= MERGE => {
                    if !last.lines.contains(&line) {
                        last.lines.push(line);
                    }
                }
                _ => crossings.push(Crossing { along, lines: vec![line], bend: self.bend_at(at, q - p) }),
            }
        }
        crossings
    }

    /// How far along, with which line, and where in grid coordinates.
    fn all_crossings(&self, p: DVec2, q: DVec2) -> Vec<(f64, GridLine, DVec2)> {
        let (low, high) = (p.min(q), p.max(q));
        let [n, m] = self.sheet.cells();
        let mut found = Vec::new();
        if p == q {
            return found;
        }
        for (i, [strip_low, strip_high]) in self.strips.iter().enumerate() {
            if strip_low.cmpgt(high).any() || strip_high.cmplt(low).any() {
                continue;
            }
            for j in 0..=m {
                let a = self.point(i, j);
                let at = DVec2::new(i as f64, j as f64);
                let of_a = orientation(p, q, a);
                if of_a == 0.0 {
                    let along = (a - p).dot(q - p) / p.distance_squared(q);
                    found.extend([GridLine::OfS(i as u32), GridLine::OfT(j as u32)].map(|line| (along, line, at)));
                }
                let next = [
                    (j < m).then(|| (self.point(i, j + 1), GridLine::OfS(i as u32), DVec2::Y)),
                    (i < n).then(|| (self.point(i + 1, j), GridLine::OfT(j as u32), DVec2::X)),
                ];
                for (b, line, direction) in next.into_iter().flatten() {
                    if a.max(b).cmplt(low).any() || a.min(b).cmpgt(high).any() {
                        continue;
                    }
                    let of_b = orientation(p, q, b);
                    if of_a * of_b >= 0.0 {
                        continue;
                    }
                    let (of_p, of_q) = (orientation(a, b, p), orientation(a, b, q));
                    if of_p * of_q < 0.0 {
                        found.push((of_p / (of_p - of_q), line, at + direction * (of_a / (of_a - of_b))));
                    }
                }
            }
        }
        found
    }

    /// A step in the plane in grid coordinates at some of them, by the bilinear map of the cell; `None` where that has no inverse.
    fn step(&self, at: DVec2, step: DVec2) -> Option<DVec2> {
        let [n, m] = self.sheet.cells();
        let (i, j) = ((at.x as usize).min(n - 1), (at.y as usize).min(m - 1));
        let [a, b] = [at.x - i as f64, at.y - j as f64];
        let [x00, x10, x01, x11] =
            [self.point(i, j), self.point(i + 1, j), self.point(i, j + 1), self.point(i + 1, j + 1)];
        let along_s = (1.0 - b) * (x10 - x00) + b * (x11 - x01);
        let along_t = (1.0 - a) * (x01 - x00) + a * (x11 - x10);
        let area = along_s.perp_dot(along_t);
        let in_grid = DVec2::new(step.perp_dot(along_t), along_s.perp_dot(step)) / area;
        in_grid.is_finite().then_some(in_grid)
    }

    fn bend_at(&self, at: DVec2, direction: DVec2) -> f64 {
        let Some(in_grid) = self.step(at, direction) else { return f64::INFINITY };
        let [n, m] = self.sheet.cells().map(|cells| cells as f64);
        bend(&self.jet(at), DVec2::new(in_grid.x / n, in_grid.y / m))
    }
}

/// |Normal curvature| along a direction of the parameters; infinite where there is no tangent plane.
fn bend(jet: &Jet, direction: DVec2) -> f64 {
    let DVec2 { x: s, y: t } = direction;
    let Some(normal) = jet.normal() else { return f64::INFINITY };
    let tangent = s * jet.s + t * jet.t;
    let second = s * s * jet.ss + 2.0 * s * t * jet.st + t * t * jet.tt;
    (second.dot(normal) / tangent.length_squared()).abs()
}

/// Whether a point is on a side to [`MERGE`].
fn is_near((a, b): (DVec2, DVec2), x: DVec2) -> bool {
    let square = a.distance_squared(b);
    let along = if square > 0.0 { ((x - a).dot(b - a) / square).clamp(0.0, 1.0) } else { 0.0 };
    a.lerp(b, along).distance_squared(x) <= MERGE * MERGE * square
}

/// Twice the signed area of a triangle, its sign exact.
pub(crate) fn orientation(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| Coord { x: p.x, y: p.y });
    robust::orient2d(a, b, c)
}
