//! Triangles between points on the border of a polygon and points inside it, such that neighbours along the border stay neighbours.
//!
//! A constrained Delaunay triangulation (the crate `spade`) in the plane of the polygon. Points on an edge are on it to rounding only,
//! so the border is held by constraints, and what is outside of it is left out. Where rounding is larger than the polygon is thin, the
//! triangulation is done over coordinates in which points on edges are exactly there: the result is sound, if not well shaped.

use glam::DVec2;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};

/// Points of a polygon without self-intersections, counter-clockwise.
#[derive(Clone, Debug, Default)]
pub(crate) struct Border {
    /// Corners in the plane of the polygon.
    pub(crate) corners: Vec<DVec2>,
    /// How far points are along the side from each corner to the next, ascending, in (0, 1).
    pub(crate) along: Vec<Vec<f64>>,
    /// Points inside.
    pub(crate) inside: Vec<DVec2>,
}

impl Border {
    /// The border points in order: each corner, then the points on the side after it. Sides bulge, so that rounding bends none inwards,
    /// where a Delaunay triangulation would have slivers.
    fn points(&self) -> Vec<DVec2> {
        /// Height of a bulge over the length of its side. More: well-shaped triangles are lost; less: rounding shows.
        const BULGE: f64 = 1e-6;
        let mut points = Vec::new();
        for (k, (corner, along)) in self.corners.iter().zip(&self.along).enumerate() {
            let side = self.corners[(k + 1) % self.corners.len()] - corner;
            let bulge = |a: f64| *corner + side * a - side.perp() * (4.0 * BULGE * a * (1.0 - a));
            points.push(*corner);
            points.extend(along.iter().map(|a| bulge(*a)));
        }
        points
    }

    /// The triangles, counter-clockwise, over border points followed by those inside: b + 2 i − 2 of them. Where rounding is larger than
    /// the polygon is thick, only their connections are right.
    pub(crate) fn triangles(&self) -> Vec<[u32; 3]> {
        self.well_shaped().unwrap_or_else(|| {
            let counts: Vec<usize> = self.along.iter().map(Vec::len).collect();
            let mut triangles = triangles_of_border(&counts);
            let border = counts.iter().sum::<usize>() + counts.len();
            for x in (border..border + self.inside.len()).map(|x| x as u32) {
                let [a, b, c] = triangles.pop().expect("a polygon has a triangle");
                triangles.extend([[a, b, x], [b, c, x], [c, a, x]]);
            }
            triangles
        })
    }

    /// A constrained Delaunay triangulation; `None` where rounding gets in the way.
    fn well_shaped(&self) -> Option<Vec<[u32; 3]>> {
        let points = self.points();
        let all = || points.iter().chain(&self.inside);
        let low = all().fold(DVec2::INFINITY, |low, p| low.min(*p));
        let size = all().fold(DVec2::ZERO, |size, p| size.max(*p - low)).max_element();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let mut triangulation = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
        let mut handles = Vec::with_capacity(points.len() + self.inside.len());
        for p in all() {
            let p = (*p - low) / size;
            // The smallest coordinates that the crate takes are far below rounding.
            let [x, y] = p.to_array().map(|x| if x < f64::EPSILON * f64::EPSILON { 0.0 } else { x });
            let handle: FixedVertexHandle = triangulation.insert(Point2::new(x, y)).ok()?;
            if handle.index() != handles.len() {
                return None; // at the place of another one
            }
            handles.push(handle);
        }
        let border = points.len();
        for k in 0..border {
            let (from, to) = (handles[k], handles[(k + 1) % border]);
            if !triangulation.can_add_constraint(from, to) {
                return None;
            }
            triangulation.add_constraint(from, to);
        }
        // A constraint that met another point was cut there.
        let is_whole = (0..border).all(|k| {
            let edge = triangulation.get_edge_from_neighbors(handles[k], handles[(k + 1) % border]);
            edge.is_some_and(|edge| edge.is_constraint_edge())
        });
        if !is_whole || triangulation.num_constraints() != border {
            return None;
        }
        // Inside is on the left of the border, and what is connected with that without crossing it.
        let mut is_inside = vec![false; triangulation.num_all_faces()];
        let mut open = Vec::new();
        for k in 0..border {
            let edge = triangulation.get_edge_from_neighbors(handles[k], handles[(k + 1) % border])?;
            open.push(edge.face().as_inner()?.fix());
        }
        while let Some(face) = open.pop() {
            if std::mem::replace(&mut is_inside[face.index()], true) {
                continue;
            }
            for edge in triangulation.face(face).adjacent_edges() {
                if !edge.is_constraint_edge() {
                    open.push(edge.rev().face().as_inner()?.fix());
                }
            }
        }
        let triangles: Vec<[u32; 3]> = triangulation
            .inner_faces()
            .filter(|face| is_inside[face.fix().index()])
            .map(|face| face.vertices().map(|v| v.fix().index() as u32))
            .collect();
        let sides = sides(self.along.iter().map(Vec::len));
        let is_flat = |t: &[u32; 3]| {
            let of = |p: u32| sides.get(p as usize);
            let [Some(a), Some(b), Some(c)] = t.map(of) else { return false };
            a.iter().any(|side| b.contains(side) && c.contains(side))
        };
        let is_sound = triangles.len() == border + 2 * self.inside.len() - 2 && !triangles.iter().any(is_flat);
        is_sound.then_some(triangles)
    }
}

/// The sides that each border point lies on, one or two, for the points between each corner and the next.
fn sides(counts: impl ExactSizeIterator<Item = usize>) -> Vec<[usize; 2]> {
    let corners = counts.len();
    let mut sides = Vec::new();
    for (k, count) in counts.enumerate() {
        sides.push([k, (k + corners - 1) % corners]);
        sides.resize(sides.len() + count, [k, k]);
    }
    sides
}

/// Triangles between the points on the edges of a polygon alone: `counts[k]` points between corners k and k + 1, border points in order.
/// No coordinate is looked at, so that it always works: ears are cut off at corners until all points are used up.
fn triangles_of_border(counts: &[usize]) -> Vec<[u32; 3]> {
    let sides = sides(counts.iter().copied());
    let border = sides.len();
    let is_on = |point: usize, side: usize| sides[point].contains(&side);
    let is_flat = |points: &[usize]| (0..counts.len()).any(|side| points.iter().all(|p| is_on(*p, side)));
    let mut left: Vec<usize> = (0..border).collect();
    let mut triangles = Vec::with_capacity(border - 2);
    while left.len() > 3 {
        let n = left.len();
        let ear = |k: usize| [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
        // An ear with area, that leaves a polygon with area.
        let is_good = |k: &usize| {
            let rest: Vec<usize> = left.iter().enumerate().filter(|(i, _)| i != k).map(|(_, p)| *p).collect();
            !is_flat(&ear(*k)) && !is_flat(&rest)
        };
        let k = (0..n).find(is_good).unwrap_or(0);
        triangles.push(ear(k).map(|p| p as u32));
        left.remove(k);
    }
    triangles.push([left[0], left[1], left[2]].map(|p| p as u32));
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[DVec2], triangles: &[[u32; 3]]) -> f64 {
        let corner = |t: &[u32; 3], k: usize| points[t[k] as usize];
        triangles.iter().map(|t| (corner(t, 1) - corner(t, 0)).perp_dot(corner(t, 2) - corner(t, 0)) / 2.0).sum()
    }

    /// The directed border edges are there once, and all others in both directions.
    fn assert_bounded_by(border: usize, triangles: &[[u32; 3]]) {
        let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
        edges.sort_unstable();
        assert!(edges.windows(2).all(|pair| pair[0] != pair[1]), "an edge occurs twice");
        let single: Vec<_> = edges.iter().filter(|[a, b]| edges.binary_search(&[*b, *a]).is_err()).copied().collect();
        let mut expected: Vec<[u32; 2]> = (0..border as u32).map(|k| [k, (k + 1) % border as u32]).collect();
        expected.sort_unstable();
        assert_eq!(single, expected);
    }

    #[test]
    fn points_on_edges_and_inside_are_all_used() {
        let corners = [DVec2::new(0.1, 0.3), DVec2::new(7.3, -0.7), DVec2::new(3.1, 5.9)];
        let along = vec![(1..7).map(|part| f64::from(part) / 7.0).collect(); 3];
        let mut border = Border { corners: corners.to_vec(), along, inside: Vec::new() };
        border.inside = (1..6).map(|k| DVec2::new(1.0 + 0.9 * f64::from(k), 0.5 + 0.3 * f64::from(k % 3))).collect();
        let triangles = border.well_shaped().unwrap();
        assert_bounded_by(21, &triangles);
        let all = [border.points(), border.inside.clone()].concat();
        let expected = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) / 2.0;
        assert!((area(&all, &triangles) - expected).abs() < 1e-5 * expected);
        assert_eq!(triangles, border.triangles());
    }

    #[test]
    fn polygons_without_area_or_with_doubled_points_are_divided_by_their_connections() {
        let flat = [DVec2::ZERO, 2.0 * DVec2::X, DVec2::X];
        for corners in [&flat[..], &[DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::Y], &[DVec2::ONE; 3]] {
            let along = vec![vec![0.25, 0.5]; corners.len()];
            let border = Border { corners: corners.to_vec(), along, inside: vec![DVec2::new(0.5, 0.0)] };
            assert_bounded_by(3 * corners.len(), &border.triangles());
        }
    }

    #[test]
    fn borders_alone_are_triangulated_without_flat_triangles() {
        for counts in [[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 2], [1, 1, 1], [5, 2, 0], [2, 0, 7], [3, 4, 5]] {
            let triangles = triangles_of_border(&counts);
            let border = counts.iter().sum::<usize>() + 3;
            assert_bounded_by(border, &triangles);
            let corners = [DVec2::ZERO, DVec2::X, DVec2::Y];
            let points: Vec<DVec2> = (0..3)
                .flat_map(|k| {
                    let part = move |p: usize| p as f64 / (counts[k] + 1) as f64;
                    (0..=counts[k]).map(move |p| corners[k].lerp(corners[(k + 1) % 3], part(p)))
                })
                .collect();
            for t in &triangles {
                assert!(area(&points, &[*t]) > 1e-3, "{counts:?}: {t:?} is flat or turned");
            }
        }
    }
}
