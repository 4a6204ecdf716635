//! Where points and edges over a flattened grid meet its lines.
//!
//! All that is nearer to one another than a tolerance counts as one place: a point is *on* a grid point or a grid side, an edge goes *through*
//! a grid point, or crosses the inside of a side. So no two crossings of an edge, and no crossing and its end, are nearer than that.

use glam::DVec2;

use crate::locate::Locator;
use crate::topology::DisjointSets;

/// What something is on: a grid point, or the inside of a side of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Feature {
    /// A grid point, by [`Net::point`].
    Point(u32),
    /// A side, by its number.
    Side(u32),
}

/// A place of an edge on grid lines.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Crossing {
    /// How far along the edge, from 0 to 1, ends excluded.
    pub(crate) t: f64,
    pub(crate) features: Vec<Feature>,
}

/// An edge on grid lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Crossings {
    /// In order.
    pub(crate) inner: Vec<Crossing>,
    /// What its ends turn out to be on.
    pub(crate) ends: [Vec<Feature>; 2],
}

/// The lines of a flattened grid.
#[derive(Debug)]
pub(crate) struct Net<'a> {
    locator: &'a Locator,
    /// The first grid point at the same place as each.
    first: Vec<u32>,
    /// The sides at each first point.
    sides_at: Vec<Vec<u32>>,
    tolerance: f64,
}

impl<'a> Net<'a> {
    pub(crate) fn new(locator: &'a Locator, tolerance: f64) -> Self {
        let grid = locator.grid();
        let mut places = DisjointSets::new(grid.points.len());
        let mut net = Self { locator, first: Vec::new(), sides_at: vec![Vec::new(); grid.points.len()], tolerance };
        // Poles, and both sides of a seam that closes in the plane.
        let mut by_x: Vec<u32> = (0..grid.points.len() as u32).collect();
        let place = |p: u32| grid.points[p as usize];
        by_x.sort_by(|p, q| place(*p).x.total_cmp(&place(*q).x));
        for (k, p) in by_x.iter().enumerate() {
            let near = by_x[k + 1..].iter().take_while(|q| place(**q).x - place(*p).x <= tolerance);
            near.filter(|q| place(**q).distance(place(*p)) <= tolerance).for_each(|q| places.union(*p, *q));
        }
        net.first = (0..grid.points.len() as u32).map(|p| places.root(p)).collect();
        for side in 0..2 * grid.points.len() as u32 {
            if let Some(ends) = net.side(side) {
                ends.iter().for_each(|p| net.sides_at[*p as usize].push(side));
            }
        }
        net
    }

    /// Ends of side number 2p + a, which goes from grid point p along axis a; none where there is no such side, or it is the outer border of
    /// a ring.
    fn ends_of(&self, side: u32) -> Option<[u32; 2]> {
        let grid = self.locator.grid();
        let (p, axis) = (side as usize / 2, side as usize % 2);
        let columns = grid.cells[1] + 1;
        let at = [p / columns, p % columns];
        grid.line(at[1 - axis], 1 - axis)?;
        (at[axis] < grid.cells[axis]).then(|| [p as u32, (p + [columns, 1][axis]) as u32])
    }

    /// Ends of a side that has a length.
    pub(crate) fn side(&self, side: u32) -> Option<[u32; 2]> {
        let ends = self.ends_of(side)?.map(|p| self.first[p as usize]);
        (ends[0] != ends[1]).then_some(ends)
    }

    /// The grid line on which a side is.
    pub(crate) fn line(&self, side: u32) -> u32 {
        let (p, axis) = (side / 2, side % 2);
        let columns = self.locator.grid().cells[1] as u32 + 1;
        2 * [p % columns, p / columns][axis as usize] + axis
    }

    /// The sides at a point.
    pub(crate) fn sides_at(&self, point: u32) -> &[u32] {
        &self.sides_at[point as usize]
    }

    pub(crate) fn point(&self, point: u32) -> DVec2 {
        self.locator.grid().points[point as usize]
    }

    pub(crate) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Points near a box, each once, ascending.
    pub(crate) fn points_near(&self, low: DVec2, high: DVec2) -> Vec<u32> {
        let grid = self.locator.grid();
        let mut cells = Vec::new();
        self.locator.cells_near(low - self.tolerance, high + self.tolerance, &mut cells);
        let corners = |cell: &u32| {
            let [i, j] = self.locator.cell(*cell);
            [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]].map(|at| self.first[grid.index(at)])
        };
        let mut points: Vec<u32> = cells.iter().flat_map(corners).collect();
        points.sort_unstable();
        points.dedup();
        points
    }

    /// The sides at these points, each once, ascending.
    fn sides_of(&self, points: &[u32]) -> Vec<u32> {
        let mut sides: Vec<u32> = points.iter().flat_map(|p| self.sides_at(*p)).copied().collect();
        sides.sort_unstable();
        sides.dedup();
        sides
    }

    /// What x is on: points, or else sides.
    pub(crate) fn features(&self, x: DVec2) -> Vec<Feature> {
        let points = self.points_near(x, x);
        let is_at = |p: &&u32| self.point(**p).distance(x) <= self.tolerance;
        let at: Vec<Feature> = points.iter().filter(is_at).map(|p| Feature::Point(*p)).collect();
        if !at.is_empty() {
            return at;
        }
        let is_on = |side: &u32| {
            self.side(*side).is_some_and(|ends| {
                let [p, q] = ends.map(|p| self.point(p));
                let along = (x - p).dot(q - p) / (q - p).length_squared();
                (0.0..=1.0).contains(&along) && ((q - p).perp_dot(x - p)).abs() <= self.tolerance * p.distance(q)
            })
        };
        self.sides_of(&points).into_iter().filter(is_on).map(Feature::Side).collect()
    }

    /// Where the edge from a to b is on grid lines.
    pub(crate) fn crossings(&self, a: DVec2, b: DVec2) -> Crossings {
        let (length, tolerance) = (a.distance(b), self.tolerance);
        let mut found = Crossings::default();
        if length <= tolerance {
            return found;
        }
        let points = self.points_near(a.min(b), a.max(b));
        let along = (b - a) / length;
        let aside = |p: u32| along.perp_dot(self.point(p) - a);
        for &p in points.iter().filter(|p| aside(**p).abs() <= tolerance) {
            let at = along.dot(self.point(p) - a);
            let feature = Feature::Point(p);
            if (tolerance..=length - tolerance).contains(&at) {
                found.inner.push(Crossing { t: at / length, features: vec![feature] });
            } else if (-tolerance..=tolerance).contains(&at) {
                found.ends[0].push(feature);
            } else if (-tolerance..=tolerance).contains(&(at - length)) {
                found.ends[1].push(feature);
            }
        }
        let parts = |x: f64, y: f64| (x > tolerance && y < -tolerance) || (x < -tolerance && y > tolerance);
        for side in self.sides_of(&points) {
            let Some(ends) = self.side(side).filter(|[p, q]| parts(aside(*p), aside(*q))) else { continue };
            let [p, q] = ends.map(|p| self.point(p));
            let across = (q - p) / p.distance(q);
            let [of_a, of_b] = [a, b].map(|x| across.perp_dot(x - p));
            if parts(of_a, of_b) {
                found.inner.push(Crossing { t: of_a / (of_a - of_b), features: vec![Feature::Side(side)] });
            }
        }
        found.inner.sort_by(|x, y| x.t.total_cmp(&y.t));
        found.inner.dedup_by(|next, kept| {
            let is_one = (next.t - kept.t) * length <= tolerance;
            if is_one {
                kept.features.append(&mut next.features);
            }
            is_one
        });
        found
    }
}
