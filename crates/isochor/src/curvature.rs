//! Curvatures of a surface from its derivatives.
//!
//! In the orthonormal basis `e₁ = S_s/|S_s|`, `e₂ = n × e₁` of the tangent plane the second fundamental form is the
//! symmetric matrix ((a, b), (b, c)) with, for E, F, G and L, M, N the coefficients of both forms and D = EG − F²,
//!
//! ```text
//! a = L/E,   b = (M − F L/E)/√D,   c = (N − 2 F M/E + F² L/E²) E/D
//! ```
//!
//! Its eigenvalues are the principal curvatures (M. do Carmo, *Differential Geometry of Curves and Surfaces*, section
//! 3.3). No difference of squares `H² − K` is taken, which would lose half the digits near umbilics.

use glam::DVec3;

use crate::surface::Jet;

/// Curvatures of a surface at a point. Positive where the surface bends towards the normal: a sphere of radius R whose
/// normals point outwards has −1/R everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curvature {
    /// Their product K, 1/length².
    pub gaussian: f64,
    /// Their mean H, 1/length.
    pub mean: f64,
    /// The larger and the smaller principal curvature, 1/length.
    pub principal: [f64; 2],
    /// Unit tangents along which the surface bends so; with the normal they are right-handed. Where both curvatures are
    /// the same, those of S_s and across it.
    pub directions: [DVec3; 2],
}

impl Curvature {
    /// The larger |principal curvature|: 1 over the height above which a model on this surface folds.
    #[must_use]
    pub fn strongest(&self) -> f64 {
        self.principal[0].abs().max(self.principal[1].abs())
    }
}

impl Jet {
    /// The curvatures; none where the surface has no tangent plane.
    #[must_use]
    pub fn curvature(&self) -> Option<Curvature> {
        let normal = self.normal()?;
        let along = self.s.try_normalize()?;
        let across = normal.cross(along);
        // S_t = shear S_s + height e₂: E, F, D in terms of lengths.
        let (length, height) = (self.s.dot(along), self.t.dot(across));
        let shear = self.t.dot(along) / length;
        let [l, m, n] = [self.ss, self.st, self.tt].map(|second| second.dot(normal));
        let a = l / length / length;
        let b = (m - shear * l) / length / height;
        let c = (n - 2.0 * shear * m + shear * shear * l) / height / height;
        let (mean, half) = ((a + c) / 2.0, (a - c) / 2.0);
        let radius = libm::hypot(half, b);
        // The eigenvector of the larger one, from the larger of two equivalent forms.
        let first = match (radius == 0.0, half >= 0.0) {
            (true, _) => along,
            (_, true) => ((half + radius) * along + b * across).normalize(),
            (_, false) => (b * along + (radius - half) * across).normalize(),
        };
        Some(Curvature {
            gaussian: a * c - b * b,
            mean,
            principal: [mean + radius, mean - radius],
            directions: [first, normal.cross(first)],
        })
    }
}
