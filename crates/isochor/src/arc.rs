//! A range of angles about an axis, in degrees.
//!
//! Whole turns and quarters are exact: angles are reduced to (−45°, 45°] before they become radians, so that a full
//! circle ends with the bits with which it begins, and the sine of 180° is 0.

use crate::surface::SurfaceError;

/// Angles from `start` on over `sweep`, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arc {
    start: f64,
    sweep: f64,
}

impl Arc {
    /// From `angles[0]` up to `angles[1]`, at most one turn.
    pub(crate) fn new(what: &'static str, angles: [f64; 2]) -> Result<Self, SurfaceError> {
        let [start, end] = angles;
        let sweep = end - start;
        // Both ends are finite where the difference is.
        if sweep > 0.0 && sweep <= 360.0 {
            Ok(Self { start, sweep })
        } else {
            Err(SurfaceError::Angles { what, start, end })
        }
    }

    /// Whether it is a full turn.
    pub(crate) fn is_full(&self) -> bool {
        self.sweep == 360.0
    }

    /// The angle at s ∈ [0, 1], in degrees, and a full turn less where there is one.
    pub(crate) fn degrees(&self, s: f64) -> f64 {
        (s * self.sweep) % 360.0 + self.start
    }

    /// Sine and cosine of the angle at s.
    pub(crate) fn sincos(&self, s: f64) -> (f64, f64) {
        sincos(self.degrees(s))
    }

    /// Radians per s.
    pub(crate) fn rate(&self) -> f64 {
        self.sweep.to_radians()
    }
}

/// Sine and cosine of an angle in degrees.
pub(crate) fn sincos(degrees: f64) -> (f64, f64) {
    let quarters = (degrees / 90.0).round();
    let (sin, cos) = libm::sincos((degrees - 90.0 * quarters).to_radians());
    match quarters.rem_euclid(4.0) as u8 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_are_exact() {
        for (degrees, expected) in
            [(0.0, (0.0, 1.0)), (90.0, (1.0, 0.0)), (180.0, (0.0, -1.0)), (-90.0, (-1.0, 0.0)), (450.0, (1.0, 0.0))]
        {
            assert_eq!(sincos(degrees), expected, "{degrees}");
        }
        let (sin, cos) = sincos(30.0);
        assert!((sin - 0.5).abs() < 1e-16 && (cos - 0.75_f64.sqrt()).abs() < 2e-16);
    }

    #[test]
    fn a_full_turn_ends_where_it_begins() {
        for start in [0.0, 0.1, -77.7, 1e3] {
            let arc = Arc::new("angles", [start, start + 360.0]).unwrap();
            assert!(arc.is_full());
            assert_eq!(arc.sincos(0.0), arc.sincos(1.0));
        }
    }

    #[test]
    fn ranges_that_are_none() {
        for angles in
            [[0.0, 0.0], [10.0, 0.0], [0.0, 361.0], [f64::NAN, 1.0], [0.0, f64::INFINITY], [f64::NEG_INFINITY; 2]]
        {
            assert!(Arc::new("angles", angles).is_err(), "{angles:?}");
        }
    }
}
