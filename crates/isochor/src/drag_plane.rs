//! Where control points can be dragged without changing the volume. CVB, section 3.3.
//!
//! Where control points move alike by δ, each times its weight w_q, all vertices move along δ, so the volume changes by `δ · Γ` exactly, however
//! large δ is (the module [`crate::correct`] says why), with `Γ = Σ w_q γ_q` and γ_q = ∂V/∂c_q. It does not change where δ lies in the plane with
//! normal Γ; and since that holds from everywhere, Γ is the same after every such move.
//!
//! *Changes versus the paper*: it states this for one cage vertex and δ in the plane; it holds for several, for any δ, and for lattices as well. It
//! does not hold for Green coordinates, whose normals turn as vertices move.

use glam::DVec3;

/// The plane in which control points can be dragged together at constant volume.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct DragPlane {
    /// A point of it: the weighted mean of the control points, model coordinates.
    pub origin: DVec3,
    /// Γ: by how much the volume changes per unit of length, along the normal of the plane. 0 where the volume does not depend on the control
    /// points: then they can be dragged anywhere.
    pub gradient: DVec3,
}

impl DragPlane {
    /// Of control points at `positions` (#controls × 3) that move alike, each times its weight (#controls), where the volume has the
    /// derivatives `gradients` (#controls × 3) by them.
    #[must_use]
    pub fn new(positions: &[DVec3], weights: &[f64], gradients: &[DVec3]) -> Self {
        let weighted = |of: &[DVec3]| of.iter().zip(weights).map(|(x, w)| *x * *w).sum::<DVec3>();
        Self { origin: weighted(positions) / weights.iter().sum::<f64>(), gradient: weighted(gradients) }
    }

    /// By how much the volume changes where the control points move by `by`, each times its weight: exactly.
    #[must_use]
    pub fn change(&self, by: DVec3) -> f64 {
        self.gradient.dot(by)
    }

    /// `by` without what would change the volume.
    #[must_use]
    pub fn projected(&self, by: DVec3) -> DVec3 {
        match self.gradient.try_normalize() {
            // A second time for what rounding left of the first.
            Some(normal) => [by, by].iter().fold(by, |left, _| left - normal * normal.dot(left)),
            None => by,
        }
    }

    /// By how much the volume changes where control points, whose derivatives of it are `gradients`, move by different lengths along one
    /// `direction`: exactly.
    #[must_use]
    pub fn change_along(gradients: &[DVec3], direction: DVec3, lengths: &[f64]) -> f64 {
        gradients.iter().zip(lengths).map(|(gradient, length)| gradient.dot(direction) * length).sum()
    }
}
