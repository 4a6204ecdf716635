//! Weighted control points as points of space of one more dimension.
//!
//! A rational curve or surface is `A/w`, A and w polynomials of the parameters: with control points P and weights ω, of
//! `(ω (P − o), ω)`. The origin o is lossless near the points ([`Bounds::lossless_origin`]), so derivatives of surfaces
//! far away keep their digits.
//!
//! Source: L. Piegl, W. Tiller, *The NURBS Book* (1997), sections 1.4, 4.3 and 4.5.

use glam::{DVec3, DVec4};

use crate::mesh::Bounds;
use crate::surface::{SurfaceError, size};

/// Control points, weighted and relative to an origin.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Homogeneous {
    pub(crate) origin: DVec3,
    /// (ω (P − o), ω).
    pub(crate) points: Vec<DVec4>,
    /// Whether there are different weights. Equal ones are left out.
    pub(crate) rational: bool,
    /// Longest side of the control points' box.
    pub(crate) extent: f64,
}

impl Homogeneous {
    pub(crate) fn new(controls: &[DVec3], weights: Option<&[f64]>) -> Result<Self, SurfaceError> {
        if let Some(weights) = weights {
            if weights.len() != controls.len() {
                let (found, expected) = (weights.len(), controls.len());
                return Err(SurfaceError::Count { what: "weights", found, expected });
            }
            if let Some(index) = weights.iter().position(|w| !(*w > 0.0 && w.is_finite())) {
                return Err(SurfaceError::Weight { index, value: weights[index] });
            }
        }
        if let Some(index) = controls.iter().position(|p| !p.is_finite()) {
            return Err(SurfaceError::NotFinite { what: "control point", index, value: controls[index] });
        }
        let Some(bounds) = Bounds::of(controls) else {
            return Err(SurfaceError::Count { what: "control points", found: 0, expected: 2 });
        };
        let (origin, extent) = (bounds.lossless_origin(), bounds.extent());
        let weights = weights.filter(|all| all.iter().any(|w| *w != all[0]));
        let point = |(i, p): (usize, &DVec3)| {
            let weight = weights.map_or(1.0, |all| all[i]);
            (weight * (p - origin)).extend(weight)
        };
        let points = controls.iter().enumerate().map(point).collect();
        Ok(Self {
            origin,
            points,
            rational: weights.is_some(),
            extent: size("the extent of the control points", extent)?,
        })
    }
}
