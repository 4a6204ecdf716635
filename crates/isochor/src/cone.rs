//! Cylinders and cones about the z axis, and their developments.
//!
//! `S(s, t) = r (cos θ, sin θ, 0) + t h e_z` with the radius `r = R₀ + t (R₁ − R₀)` and θ = θ₀ + s Δθ. With the slant
//! height `ℓ = √(h² + (R₁ − R₀)²)`, `k = (R₁ − R₀)/ℓ` and the angle ψ from the middle, unrolling keeps distances from
//! the apex, which are r/|k|, and turns ψ to k ψ. From the middle of the base that is
//!
//! ```text
//! D = (r ψ sinc(k ψ),  t ℓ − r ψ sin(k ψ/2) sinc(k ψ/2)),   sinc x = sin x / x
//! ```
//!
//! which is the cylinder's development (r ψ, t h) at k = 0, with no distance from an apex far away.

use glam::{DVec2, DVec3};

use crate::arc::Arc;
use crate::surface::{Jet, SurfaceError, Tangents, Third, size};

/// A cylinder or cone, or a part of one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cone {
    radii: [f64; 2],
    height: f64,
    arc: Arc,
}

impl Cone {
    pub(crate) fn cylinder(radius: f64, height: f64, angles: [f64; 2]) -> Result<Self, SurfaceError> {
        let radius = size("the radius", radius)?;
        Ok(Self { radii: [radius; 2], height: size("the height", height)?, arc: Arc::new("angles", angles)? })
    }

    pub(crate) fn new(radii: [f64; 2], height: f64, angles: [f64; 2]) -> Result<Self, SurfaceError> {
        for (radius, what) in radii.into_iter().zip(["the radius at the base", "the radius at the top"]) {
            // One of them may be 0: the apex.
            if radius != 0.0 || radii == [0.0; 2] {
                size(what, radius)?;
            }
        }
        Ok(Self { radii, height: size("the height", height)?, arc: Arc::new("angles", angles)? })
    }

    fn radius(&self, t: f64) -> f64 {
        self.radii[0] + t * (self.radii[1] - self.radii[0])
    }

    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let (sin, cos) = self.arc.sincos(s);
        let [out, along] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        let (rate, r, growth) = (self.arc.rate(), self.radius(t), self.radii[1] - self.radii[0]);
        let up = self.height * DVec3::Z;
        Jet {
            point: r * out + t * up,
            s: rate * r * along,
            t: growth * out + up,
            ss: -rate * rate * r * out,
            st: rate * growth * along,
            tt: DVec3::ZERO,
        }
    }

    pub(crate) fn third(&self, s: f64, t: f64) -> Third {
        let ((sin, cos), rate) = (self.arc.sincos(s), self.arc.rate());
        let [out, along] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        Third {
            sss: -rate * rate * rate * self.radius(t) * along,
            sst: -rate * rate * (self.radii[1] - self.radii[0]) * out,
            ..Third::default()
        }
    }

    /// None at the apex.
    pub(crate) fn normal(&self, t: f64, tangents: &Tangents) -> Option<DVec3> {
        if self.radius(t) == 0.0 { None } else { tangents.normal() }
    }

    pub(crate) fn is_full(&self) -> bool {
        self.arc.is_full()
    }

    /// Whether the borders t = 0 and t = 1 are the apex.
    pub(crate) fn is_apex(&self) -> [bool; 2] {
        self.radii.map(|r| r == 0.0)
    }

    /// sin of the half angle at the apex, negative where the cone narrows upwards; and the slant height.
    fn slope(&self) -> (f64, f64) {
        let growth = self.radii[1] - self.radii[0];
        let slant = libm::hypot(self.height, growth);
        (growth / slant, slant)
    }

    pub(crate) fn development(&self, s: f64, t: f64) -> DVec2 {
        let ((k, slant), r) = (self.slope(), self.radius(t));
        let psi = (s - 0.5) * self.arc.rate();
        let sinc = |x: f64| if x == 0.0 { 1.0 } else { libm::sin(x) / x };
        let half = k * psi / 2.0;
        DVec2::new(r * psi * sinc(k * psi), t * slant - r * psi * libm::sin(half) * sinc(half))
    }

    /// Whether the straight line between two developed points, given by their parameters, stays in the sheet: it does
    /// not on the way round the apex, nor where it comes nearer to it than both ends and the narrower rim.
    pub(crate) fn sees(&self, a: DVec2, b: DVec2) -> bool {
        let (k, _) = self.slope();
        let angle = (k * (b.x - a.x) * self.arc.rate()).abs();
        if angle == 0.0 {
            return true;
        }
        if angle >= std::f64::consts::PI {
            return false;
        }
        // Distances from the apex times |k| are radii: the line's nearest point is its foot, if that is between the
        // ends.
        let [ra, rb] = [self.radius(a.y), self.radius(b.y)];
        let (sin, cos) = libm::sincos(angle);
        let length = (ra * ra + rb * rb - 2.0 * ra * rb * cos).sqrt();
        let foot_is_between = ra * cos < rb && rb * cos < ra;
        let nearest = if foot_is_between { ra * rb * sin / length } else { ra.min(rb) };
        nearest >= self.radii[0].min(self.radii[1]).min(ra).min(rb)
    }
}
