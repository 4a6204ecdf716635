//! Whether two triangles of a mesh meet where they should not, exactly.
//!
//! All signs are those of J. R. Shewchuk, *Adaptive precision floating-point arithmetic and fast robust geometric predicates*, 1997
//! (crate `robust`). Triangles that share corners may meet there and nowhere else; others may not touch at all.

use glam::DVec3;
use robust::{Coord, Coord3D};

/// A triangle of a mesh: which vertices its corners are, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Facet {
    pub(crate) vertices: [u32; 3],
    pub(crate) corners: [DVec3; 3],
}

/// Whether two triangles have a point in common that is neither a common corner nor on a common edge. Both must have area.
pub(crate) fn is_improper(s: &Facet, t: &Facet) -> bool {
    let position = |vertex: u32, of: &Facet| of.vertices.iter().position(|v| *v == vertex);
    let shared: Vec<[usize; 2]> = (0..3).filter_map(|i| position(s.vertices[i], t).map(|j| [i, j])).collect();
    match shared[..] {
        [] if are_apart(&s.corners, &t.corners) => false,
        [] => (0..3).any(|k| meets(side(s, k), &t.corners) || meets(side(t, k), &s.corners)),
        // What they have in common is convex and holds the corner; where it is more, it ends on a side that is opposite to the corner.
        [[i, j]] => meets(side(s, i), &t.corners) || meets(side(t, j), &s.corners),
        [[i, j], [k, l]] => {
            let [p, q] = [s.corners[3 - i - k], t.corners[3 - j - l]];
            let edge = [s.corners[i], s.corners[k]];
            above(&s.corners, q) == 0.0
                && PROJECTIONS.iter().any(|axes| {
                    let [of_p, of_q] = [p, q].map(|r| left([edge[0], edge[1], r], *axes));
                    of_p * of_q > 0.0
                })
        }
        _ => true,
    }
}

/// Whether the boxes of two triangles have no point in common.
fn are_apart(s: &[DVec3; 3], t: &[DVec3; 3]) -> bool {
    let low = |[a, b, c]: &[DVec3; 3]| a.min(*b).min(*c);
    let high = |[a, b, c]: &[DVec3; 3]| a.max(*b).max(*c);
    high(s).cmplt(low(t)).any() || high(t).cmplt(low(s)).any()
}

/// The side of a triangle that is opposite to corner `k`.
fn side(of: &Facet, k: usize) -> [DVec3; 2] {
    [of.corners[(k + 1) % 3], of.corners[(k + 2) % 3]]
}

/// Six times the signed volume between a triangle and a point: positive where the triangle runs clockwise seen from the point. The sign is exact.
pub(crate) fn above(corners: &[DVec3; 3], p: DVec3) -> f64 {
    let coord = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    let [a, b, c] = corners.map(coord);
    robust::orient3d(a, b, c, coord(p))
}

/// The pairs of axes onto whose planes coplanar points are projected.
const PROJECTIONS: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Twice the signed area of the projection of three points.
fn left(corners: [DVec3; 3], [x, y]: [usize; 2]) -> f64 {
    let [a, b, c] = corners.map(|p| Coord { x: p[x], y: p[y] });
    robust::orient2d(a, b, c)
}

/// Whether a segment and a triangle, with their borders, have a point in common.
fn meets([p, q]: [DVec3; 2], corners: &[DVec3; 3]) -> bool {
    let [of_p, of_q] = [p, q].map(|r| above(corners, r));
    if of_p == 0.0 && of_q == 0.0 {
        let axes = PROJECTIONS.into_iter().find(|axes| left(*corners, *axes) != 0.0);
        return axes.is_none_or(|axes| meets_in_plane([p, q], corners, axes));
    }
    if of_p > 0.0 && of_q > 0.0 || of_p < 0.0 && of_q < 0.0 {
        return false;
    }
    let [a, b, c] = *corners;
    let turns = [[a, b], [b, c], [c, a]].map(|[from, to]| above(&[p, q, from], to));
    turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0)
}

/// The same in the plane of the triangle, seen along the axis that is not among `axes`.
fn meets_in_plane([p, q]: [DVec3; 2], corners: &[DVec3; 3], axes: [usize; 2]) -> bool {
    let [a, b, c] = *corners;
    let sides = [[a, b], [b, c], [c, a]];
    let is_inside = |r: DVec3| {
        let turns = sides.map(|[from, to]| left([from, to, r], axes));
        turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0)
    };
    // Whether the ends of one segment are on both sides of the other's line; segments on one line meet where an end is inside.
    let parts = |[from, to]: [DVec3; 2], [r, s]: [DVec3; 2]| {
        let [of_r, of_s] = [r, s].map(|end| left([from, to, end], axes));
        of_r <= 0.0 && of_s >= 0.0 || of_r >= 0.0 && of_s <= 0.0
    };
    let is_crossed = |edge: [DVec3; 2]| {
        let on_one_line = [p, q].iter().all(|r| left([edge[0], edge[1], *r], axes) == 0.0);
        !on_one_line && parts([p, q], edge) && parts(edge, [p, q])
    };
    let holds_a_corner = || {
        // A segment along a side that is longer than it.
        let is_between = |r: DVec3| left([p, q, r], axes) == 0.0 && (p - r).dot(q - r) <= 0.0;
        corners.iter().any(|r| is_between(*r))
    };
    is_inside(p) || is_inside(q) || sides.into_iter().any(is_crossed) || holds_a_corner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;
    use proptest::prelude::*;

    fn facet(vertices: [u32; 3], corners: [DVec3; 3]) -> Facet {
        Facet { vertices, corners }
    }

    const FLAT: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    #[test]
    fn triangles_without_common_corners_may_not_touch() {
        let flat = facet([0, 1, 2], FLAT);
        let other = |corners: [[f64; 3]; 3]| facet([3, 4, 5], corners.map(DVec3::from_array));
        let meeting = [
            ("pierces", other([[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [3.0, 3.0, 0.0]])),
            ("is pierced", other([[-1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [0.3, 0.3, 0.0]])),
            ("touches with a corner", other([[0.25, 0.25, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])),
            ("touches along a side", other([[0.25, 0.0, 0.0], [0.75, 0.0, 0.0], [0.5, -1.0, 0.0]])),
            ("touches along more than a side", other([[-1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, -1.0, 0.0]])),
            ("lies in it", other([[0.1, 0.1, 0.0], [0.3, 0.1, 0.0], [0.1, 0.3, 0.0]])),
            ("holds it", other([[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]])),
            ("has the same places", other(FLAT.map(|p| p.to_array()))),
        ];
        for (what, t) in meeting {
            assert!(is_improper(&flat, &t) && is_improper(&t, &flat), "{what}");
        }
        let apart = [
            ("above", other([[0.0, 0.0, 1e-300], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])),
            ("beside, in the plane", other([[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 2.0, 0.0]])),
            ("through the plane, beside", other([[0.6, 0.6, -1.0], [0.6, 0.6, 1.0], [2.0, 2.0, 0.0]])),
        ];
        for (what, t) in apart {
            assert!(!is_improper(&flat, &t) && !is_improper(&t, &flat), "{what}");
        }
    }

    #[test]
    fn neighbours_may_meet_in_what_they_share_only() {
        let flat = facet([0, 1, 2], FLAT);
        // One corner: 0.
        let at_0 = |p: DVec3, q: DVec3| facet([0, 3, 4], [DVec3::ZERO, p, q]);
        let apart = [[DVec3::Z, -DVec3::X], [-DVec3::X, -DVec3::Y], [dvec3(1.0, 1.0, 1e-300), DVec3::Z]];
        for [p, q] in apart {
            assert!(!is_improper(&flat, &at_0(p, q)) && !is_improper(&at_0(p, q), &flat), "{p} {q}");
        }
        let meeting = [
            ("crosses the opposite side", [dvec3(1.0, 1.0, -1.0), dvec3(1.0, 1.0, 1.0)]),
            ("ends inside", [dvec3(0.1, 0.1, -0.1), dvec3(0.1, 0.1, 0.1)]),
            ("lies in it", [dvec3(0.1, 0.0, 0.0), dvec3(0.0, 0.1, 0.0)]),
            ("has a side in it", [dvec3(0.1, 0.1, 0.0), DVec3::Z]),
            ("goes along its side", [dvec3(2.0, 0.0, 0.0), DVec3::Z]),
        ];
        for (what, [p, q]) in meeting {
            assert!(is_improper(&flat, &at_0(p, q)) && is_improper(&at_0(p, q), &flat), "{what}");
        }
        // One edge: 0 1.
        let over = |p: DVec3| facet([1, 0, 3], [DVec3::X, DVec3::ZERO, p]);
        for (p, is_bad) in [
            (dvec3(0.3, -1.0, 0.0), false),
            (DVec3::Z, false),
            (dvec3(0.3, 1.0, 1e-300), false),
            (dvec3(0.3, 1.0, 0.0), true),
            (dvec3(0.1, 0.1, 0.0), true),
        ] {
            assert_eq!((is_improper(&flat, &over(p)), is_improper(&over(p), &flat)), (is_bad, is_bad), "{p}");
        }
        assert!(is_improper(&flat, &facet([0, 2, 1], [DVec3::ZERO, DVec3::Y, DVec3::X])));
    }

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-3i8..=3).prop_map(|p| DVec3::from_array(p.map(f64::from)))
    }

    proptest! {
        /// Of two convex sets: they meet where no plane separates them. Planes through faces, and parallel to two sides, suffice; whole numbers are exact.
        #[test]
        fn triangles_meet_where_no_axis_separates_them(s in prop::array::uniform3(point()), t in prop::array::uniform3(point())) {
            let sides = |c: [DVec3; 3]| [c[1] - c[0], c[2] - c[1], c[0] - c[2]];
            let normal = |c: [DVec3; 3]| (c[1] - c[0]).cross(c[2] - c[0]);
            prop_assume!(normal(s) != DVec3::ZERO && normal(t) != DVec3::ZERO);
            let mut axes = vec![normal(s), normal(t)];
            for of_s in sides(s) {
                axes.extend(sides(t).map(|of_t| of_s.cross(of_t)));
                axes.push(of_s.cross(normal(s)));
            }
            axes.extend(sides(t).map(|of_t| of_t.cross(normal(t))));
            let span = |c: [DVec3; 3], axis: DVec3| {
                let along = c.map(|p| p.dot(axis));
                [along.iter().copied().fold(f64::INFINITY, f64::min), along.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
            };
            let is_separated = axes.iter().any(|axis| {
                let [[low_s, high_s], [low_t, high_t]] = [span(s, *axis), span(t, *axis)];
                high_s < low_t || high_t < low_s
            });
            let (s, t) = (facet([0, 1, 2], s), facet([3, 4, 5], t));
            prop_assert_eq!(is_improper(&s, &t), !is_separated);
            prop_assert_eq!(is_improper(&t, &s), !is_separated);
        }
    }
}
