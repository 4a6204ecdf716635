//! Normals carried by a deformation.
//!
//! A surface with normal n whose points move with the Jacobian J has the normal cof(J) n, with the cofactor matrix
//! cof(J) = det(J) J⁻ᵀ. Nothing is divided, so a singular J does no harm, and where det(J) < 0 the result still agrees
//! with the winding of the faces.

use glam::{DMat3, DVec3};

use crate::mix::Mix;

/// Direction (length 1) of the normal `normal` after a deformation with Jacobian `jacobian`. `None` where it has none.
pub(crate) fn carried_direction(normal: DVec3, jacobian: &DMat3) -> Option<DVec3> {
    let size = jacobian.to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if size == 0.0 {
        return None;
    }
    let (a, b, c) = (jacobian.x_axis / size, jacobian.y_axis / size, jacobian.z_axis / size);
    let n = direction(normal)?;
    direction(b.cross(c) * n.x + c.cross(a) * n.y + a.cross(b) * n.z)
}

/// `v` scaled to length 1, however long or short it is. `None` where it has no direction.
pub(crate) fn direction(v: DVec3) -> Option<DVec3> {
    let size = v.abs().max_element();
    (size > 0.0 && v.is_finite()).then(|| (v / size).normalize())
}

/// Direction of the normals `normal` (any lengths) mixed, carried where there is a Jacobian. `None` where there is none.
pub(crate) fn mixed_direction(mix: &Mix, normal: impl Fn(u32) -> DVec3, jacobian: Option<&DMat3>) -> Option<DVec3> {
    let mut sum = DVec3::ZERO;
    for &(k, weight) in mix.parts() {
        sum += direction(normal(k))? * weight;
    }
    match jacobian {
        Some(jacobian) => carried_direction(sum, jacobian),
        None => direction(sum),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: DVec3, b: DVec3) {
        assert!((a - b).length() < 4e-16, "{a} is not {b}");
    }

    /// diag(2, 3, 4): J⁻ᵀ n ∝ (n.x/2, n.y/3, n.z/4).
    #[test]
    fn under_a_diagonal_matrix() {
        let jacobian = DMat3::from_diagonal(DVec3::new(2.0, 3.0, 4.0));
        let n = DVec3::new(1.0, 1.0, 1.0);
        close(carried_direction(n, &jacobian).unwrap(), DVec3::new(6.0, 4.0, 3.0).normalize());
    }

    #[test]
    fn under_a_rotation() {
        let jacobian = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 0.8);
        let n = DVec3::new(0.6, 0.0, 0.8);
        close(carried_direction(n, &jacobian).unwrap(), jacobian * n);
    }

    /// x' = x + s y keeps z-normals; the plane x = 0 becomes x − s y = 0.
    #[test]
    fn under_a_shear() {
        let s = 0.5;
        let jacobian = DMat3::from_cols(DVec3::X, DVec3::new(s, 1.0, 0.0), DVec3::Z);
        close(carried_direction(DVec3::Z, &jacobian).unwrap(), DVec3::Z);
        close(carried_direction(DVec3::X, &jacobian).unwrap(), DVec3::new(1.0, -s, 0.0).normalize());
    }

    /// A mirror keeps the corners' order, so faces turn inside out and their normals with them.
    #[test]
    fn under_a_mirror_it_agrees_with_the_winding() {
        let jacobian = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let (p, q) = (DVec3::new(0.3, 1.0, 0.2), DVec3::new(0.1, -0.4, 2.0));
        let rest = p.cross(q).normalize();
        let posed = (jacobian * p).cross(jacobian * q).normalize();
        close(carried_direction(rest, &jacobian).unwrap(), posed);
    }

    #[test]
    fn extreme_and_singular_matrices() {
        let flat = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0));
        close(carried_direction(DVec3::new(1.0, 0.0, 1.0), &flat).unwrap(), DVec3::Z);
        assert_eq!(carried_direction(DVec3::X, &flat), None);
        assert_eq!(carried_direction(DVec3::X, &DMat3::ZERO), None);
        close(carried_direction(DVec3::X * 1e-300, &DMat3::from_diagonal(DVec3::splat(1e300))).unwrap(), DVec3::X);
        assert_eq!(carried_direction(DVec3::ZERO, &DMat3::IDENTITY), None);
        assert_eq!(carried_direction(DVec3::NAN, &DMat3::IDENTITY), None);
    }
}
