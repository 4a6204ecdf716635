//! The point of a triangle that is closest to a given one.
//!
//! C. Ericson, *Real-time collision detection*, 2005, section 5.1.5: by the region of the corner, the edge or the inside to which the point
//! projects.

use glam::DVec3;

/// Barycentric coordinates, each in 0 ..= 1, of the point of the triangle `[a, b, c]` that is closest to `p`. Triangles without area have
/// closest points, too.
pub(crate) fn closest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (along_b, along_c) = ((p - a).dot(ab), (p - a).dot(ac));
    if along_b <= 0.0 && along_c <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (from_b, towards_c) = ((p - b).dot(ab), (p - b).dot(ac));
    if from_b >= 0.0 && towards_c <= from_b {
        return [0.0, 1.0, 0.0];
    }
    let of_c = along_b * towards_c - from_b * along_c;
    if of_c <= 0.0 && along_b >= 0.0 && from_b <= 0.0 {
        let t = along_b / (along_b - from_b);
        return [1.0 - t, t, 0.0];
    }
    let (towards_b, from_c) = ((p - c).dot(ab), (p - c).dot(ac));
    if from_c >= 0.0 && towards_b <= from_c {
        return [0.0, 0.0, 1.0];
    }
    let of_b = towards_b * along_c - along_b * from_c;
    if of_b <= 0.0 && along_c >= 0.0 && from_c <= 0.0 {
        let t = along_c / (along_c - from_c);
        return [1.0 - t, 0.0, t];
    }
    let of_a = from_b * from_c - towards_b * towards_c;
    let (to_c, to_b) = (towards_c - from_b, towards_b - from_c);
    if of_a <= 0.0 && to_c >= 0.0 && to_b >= 0.0 {
        let t = to_c / (to_c + to_b);
        return [0.0, 1.0 - t, t];
    }
    let sum = of_a + of_b + of_c;
    let (v, w) = (of_b / sum, of_c / sum);
    [1.0 - v - w, v, w]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
    }

    proptest! {
        /// The condition of a minimum over a convex set: no corner lies beyond the plane through the closest point that faces p.
        #[test]
        fn no_corner_is_nearer_to_the_side_of_p(p in point(), corners in prop::array::uniform3(point())) {
            let weights = closest_on_triangle(p, corners);
            prop_assert!(weights.iter().all(|w| (-1e-15..=1.0).contains(w)));
            let closest: DVec3 = weights.iter().zip(corners).map(|(w, c)| *w * c).sum();
            for corner in corners {
                prop_assert!((p - closest).dot(corner - closest) <= 1e-12);
            }
        }
    }

    #[test]
    fn triangles_without_area_have_closest_points() {
        let line = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
        let weights = closest_on_triangle(DVec3::new(0.5, 1.0, 0.0), line);
        let closest: DVec3 = weights.iter().zip(line).map(|(w, c)| *w * c).sum();
        assert_eq!(closest, 0.5 * DVec3::X);
        assert_eq!(closest_on_triangle(DVec3::Y, [DVec3::ZERO; 3]), [1.0, 0.0, 0.0]);
    }
}
