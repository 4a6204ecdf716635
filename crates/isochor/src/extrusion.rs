//! Extrusions: a profile C(s) moved along a vector a, `S(s, t) = C(s) + t a`, and their developments.
//!
//! Such a cylinder on any curve unrolls to `D = (σ(s), C(s)·â + t |a|)`, σ the length of the profile seen along a.

use glam::{DVec2, DVec3};

use crate::arc_length::ArcLength;
use crate::curve::Curve;
use crate::surface::{Jet, SurfaceError, Third, direction, size};
use crate::tolerances;

/// A profile moved along a vector.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Extrusion {
    profile: Curve,
    along: DVec3,
    lengths: ArcLength,
    /// Whether the profile lies across `along`, so that its development is a rectangle.
    is_straight: bool,
}

impl Extrusion {
    pub(crate) fn new(profile: Curve, along: DVec3) -> Result<Self, SurfaceError> {
        let unit = direction("`along`", along)?;
        size("the length of `along`", along.length())?;
        let is_flat = |s: &f64| {
            let first = profile.jet(*s).first;
            first.cross(unit).length() <= tolerances::FLAT_SURFACE * first.length().max(profile.extent())
        };
        if profile.sites().iter().all(is_flat) {
            return Err(SurfaceError::Flat { what: "the extrusion" });
        }
        let lengths = ArcLength::across(&profile, unit);
        let start = profile.controls()[0];
        let is_across = |p: &DVec3| (p - start).dot(unit).abs() <= tolerances::SEAM * profile.extent();
        let is_straight = profile.controls().iter().all(is_across);
        Ok(Self { profile, along, lengths, is_straight })
    }

    /// C.
    pub(crate) fn profile(&self) -> &Curve {
        &self.profile
    }

    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let curve = self.profile.jet(s);
        let zero = DVec3::ZERO;
        Jet { point: curve.point + t * self.along, s: curve.first, t: self.along, ss: curve.second, st: zero, tt: zero }
    }

    pub(crate) fn third(&self, s: f64) -> Third {
        Third { sss: self.profile.third(s), ..Third::default() }
    }

    pub(crate) fn is_smooth(&self) -> bool {
        self.profile.is_smooth()
    }

    pub(crate) fn closes(&self) -> bool {
        self.profile.closes()
    }

    pub(crate) fn development(&self, s: f64, t: f64) -> DVec2 {
        self.unrolled(s, self.profile.jet(s).point + t * self.along)
    }

    /// The same for any point of the straight line along a through C(s).
    pub(crate) fn unrolled(&self, s: f64, point: DVec3) -> DVec2 {
        let rise = (point - self.profile.controls()[0]).dot(self.along) / self.along.length();
        DVec2::new(self.lengths.at(&self.profile, s), rise)
    }

    /// Whether straight lines of the development stay in the sheet.
    pub(crate) fn is_straight(&self) -> bool {
        self.is_straight
    }
}
