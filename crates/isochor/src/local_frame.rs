//! Places relative to an origin near a model, in units about as large as it.

use glam::DVec3;

use crate::mesh::Bounds;

/// An origin and a unit with which places inside a box become coordinates near 1, without rounding on the way there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalFrame {
    origin: DVec3,
    /// A power of two between half the extent of the box and the extent.
    pub(crate) unit: f64,
}

impl LocalFrame {
    /// For places in a box with an extent in [`crate::tolerances::EXTENTS`].
    pub(crate) fn of(bounds: Bounds) -> Self {
        Self { origin: bounds.lossless_origin(), unit: bounds.extent().log2().floor().exp2() }
    }

    pub(crate) fn local(&self, p: DVec3) -> DVec3 {
        (p - self.origin) / self.unit
    }

    /// Rounded to the nearest place that can be had.
    pub(crate) fn global(&self, p: DVec3) -> DVec3 {
        p * self.unit + self.origin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn places_come_back_as_they_were() {
        for (at, extent) in [(0.0, 3.0), (7e5, 0.3), (-1e9, 1e3), (0.0, 1e-60), (1e80, 1e79)] {
            let min = DVec3::splat(at);
            let frame = LocalFrame::of(Bounds { min, max: min + extent });
            for p in [min, min + extent, min + dvec3(0.1, 0.7, 0.3) * extent] {
                assert_eq!(frame.global(frame.local(p)), p);
                assert!(frame.local(p).abs().max_element() <= 3.0);
            }
        }
    }
}
