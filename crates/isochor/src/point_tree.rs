//! Points in a tree of boxes, to ask which of them are near a triangle or in a tetrahedron.

use std::ops::Range;

use glam::DVec3;

use crate::closest::closest_on_triangle;
use crate::intersection::above;

/// Points per leaf. Larger: more points are looked at that are far away; smaller: more boxes are.
const LEAF: usize = 8;

/// A ball is passed over where it is too far away by more than this fraction of the distance. Larger: more boxes are looked at; smaller: rounding hides
/// a point.
const ROUNDING: f64 = 1e-12;

/// Points, in an order in which those of a box stand together.
pub(crate) struct PointTree {
    points: Vec<DVec3>,
    /// The root is the last; empty without points.
    parts: Vec<Part>,
}

/// The points of a box, and a ball round them.
struct Part {
    points: Range<usize>,
    center: DVec3,
    radius: f64,
    halves: Option<[usize; 2]>,
}

impl PointTree {
    pub(crate) fn new(points: Vec<DVec3>) -> Self {
        let mut tree = Self { points, parts: Vec::new() };
        if !tree.points.is_empty() {
            tree.divide(0..tree.points.len());
        }
        tree
    }

    fn divide(&mut self, range: Range<usize>) -> usize {
        let these = &mut self.points[range.clone()];
        let low = these.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = these.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let center = low.midpoint(high);
        let radius = these.iter().fold(0.0, |radius: f64, p| radius.max(p.distance(center)));
        let halves = if these.len() > LEAF && radius > 0.0 {
            let axis = (high - low).max_position();
            let half = these.len() / 2;
            these.select_nth_unstable_by(half, |p, q| p[axis].total_cmp(&q[axis]));
            let middle = range.start + half;
            Some([range.start..middle, middle..range.end].map(|half| self.divide(half)))
        } else {
            None
        };
        self.parts.push(Part { points: range, center, radius, halves });
        self.parts.len() - 1
    }

    /// The least distance of a point from the triangle, or `limit` where that is less.
    pub(crate) fn distance(&self, corners: &[DVec3; 3], limit: f64) -> f64 {
        let from = |p: DVec3| {
            let weights = closest_on_triangle(p, *corners);
            let closest: DVec3 = weights.iter().zip(corners).map(|(w, c)| *w * *c).sum();
            closest.distance(p)
        };
        let mut least = limit;
        let mut open = Vec::from_iter(self.parts.len().checked_sub(1));
        while let Some(part) = open.pop() {
            let Part { points, center, radius, halves } = &self.parts[part];
            if from(*center) - radius >= least + ROUNDING * (radius + least) {
                continue;
            }
            match halves {
                Some(halves) => open.extend(halves),
                None => least = self.points[points.clone()].iter().fold(least, |least, p| least.min(from(*p))),
            }
        }
        least
    }

    /// Whether a point lies in or on the tetrahedron between the triangle and an apex below it, from which it runs clockwise.
    pub(crate) fn is_any_in(&self, [a, b, c]: [DVec3; 3], apex: DVec3) -> bool {
        // Clockwise seen from inside.
        let sides = [[a, b, c], [b, a, apex], [c, b, apex], [a, c, apex]];
        let normals = sides.map(|[p, q, r]| (q - p).cross(r - p).normalize_or_zero());
        let mut open = Vec::from_iter(self.parts.len().checked_sub(1));
        while let Some(part) = open.pop() {
            let Part { points, center, radius, halves } = &self.parts[part];
            // Of a ball, or a point as one without radius.
            let is_beyond = |center: DVec3, radius: f64| {
                sides.iter().zip(normals).any(|(side, n)| {
                    let from = center - side[0];
                    from.dot(n) > radius + ROUNDING * (radius + from.length())
                })
            };
            if is_beyond(*center, *radius) {
                continue;
            }
            match halves {
                Some(halves) => open.extend(halves),
                None => {
                    let is_in = |p: &DVec3| !is_beyond(*p, 0.0) && sides.iter().all(|side| above(side, *p) >= 0.0);
                    if self.points[points.clone()].iter().any(is_in) {
                        return true;
                    }
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn the_tree_says_what_all_points_say(
            points in prop::collection::vec(point(), 0..200), corners in prop::array::uniform3(point()), apex in point(), limit in 0.0..2.0,
        ) {
            let tree = PointTree::new(points.clone());
            let from = |p: &DVec3| {
                let weights = closest_on_triangle(*p, corners);
                weights.iter().zip(corners).map(|(w, c)| *w * c).sum::<DVec3>().distance(*p)
            };
            prop_assert_eq!(tree.distance(&corners, limit), points.iter().map(from).fold(limit, f64::min));
            // By barycentric coordinates.
            let [a, b, c] = if above(&corners, apex) > 0.0 { corners } else { [corners[0], corners[2], corners[1]] };
            let frame = glam::DMat3::from_cols(a - apex, b - apex, c - apex).inverse();
            let is_in = |p: &DVec3| {
                let weights = frame * (*p - apex);
                weights.min_element() >= 0.0 && weights.element_sum() <= 1.0
            };
            prop_assert_eq!(tree.is_any_in([a, b, c], apex), points.iter().any(is_in));
        }
    }

    #[test]
    fn points_at_one_place_are_a_leaf() {
        let tree = PointTree::new(vec![DVec3::Z; 100]);
        assert_eq!(tree.distance(&[DVec3::ZERO, DVec3::X, DVec3::Y], 5.0), 1.0);
        assert_eq!(PointTree::new(Vec::new()).distance(&[DVec3::ZERO; 3], 5.0), 5.0);
    }
}
