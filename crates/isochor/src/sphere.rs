//! Spheres about the origin, and their geodesics: great circles.
//!
//! `S(s, t) = R (cos φ cos θ, cos φ sin θ, sin φ)`: s goes with the longitude θ, t with the latitude φ from south to
//! north.

use glam::{DVec2, DVec3};

use crate::arc::{Arc, sincos};
use crate::surface::{Jet, SurfaceError, Third, size};
use crate::tolerances;

/// A sphere, or a part of one between two meridians and two parallels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sphere {
    radius: f64,
    longitudes: Arc,
    /// Degrees.
    latitudes: [f64; 2],
}

impl Sphere {
    pub(crate) fn new(radius: f64, longitudes: [f64; 2], latitudes: [f64; 2]) -> Result<Self, SurfaceError> {
        let [south, north] = latitudes;
        if !(-90.0 <= south && south < north && north <= 90.0) {
            return Err(SurfaceError::Latitudes { south, north });
        }
        let longitudes = Arc::new("angles", longitudes)?;
        Ok(Self { radius: size("the radius", radius)?, longitudes, latitudes })
    }

    fn latitude(&self, t: f64) -> f64 {
        let [south, north] = self.latitudes;
        // Both ends exactly.
        if t == 1.0 { north } else { south + t * (north - south) }
    }

    fn rates(&self) -> [f64; 2] {
        [self.longitudes.rate(), (self.latitudes[1] - self.latitudes[0]).to_radians()]
    }

    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let ((sin, cos), (up, out)) = (self.longitudes.sincos(s), sincos(self.latitude(t)));
        let [r_s, r_t] = self.rates();
        let r = self.radius;
        let [equator, east] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        let radial = out * equator + up * DVec3::Z;
        Jet {
            point: r * radial,
            s: r * r_s * out * east,
            t: r * r_t * (out * DVec3::Z - up * equator),
            ss: -r * r_s * r_s * out * equator,
            st: -r * r_s * r_t * up * east,
            tt: -r * r_t * r_t * radial,
        }
    }

    pub(crate) fn third(&self, s: f64, t: f64) -> Third {
        let ((sin, cos), (up, out)) = (self.longitudes.sincos(s), sincos(self.latitude(t)));
        let [r_s, r_t] = self.rates();
        let r = self.radius;
        let [equator, east] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        Third {
            sss: -r * r_s * r_s * r_s * out * east,
            sst: r * r_s * r_s * r_t * up * equator,
            stt: -r * r_s * r_t * r_t * out * east,
            ttt: r * r_t * r_t * r_t * (up * equator - out * DVec3::Z),
        }
    }

    /// Outwards, also at the poles. Beyond a pole the formula comes down on the other side, and S_s × S_t points
    /// inwards.
    pub(crate) fn normal(&self, t: f64, point: DVec3) -> DVec3 {
        let outward = point / self.radius;
        if self.latitude(t).abs() > 90.0 { -outward } else { outward }
    }

    pub(crate) fn is_full(&self) -> bool {
        self.longitudes.is_full()
    }

    /// Whether the borders t = 0 and t = 1 are poles.
    pub(crate) fn is_pole(&self) -> [bool; 2] {
        self.latitudes.map(|latitude| latitude.abs() == 90.0)
    }

    /// The length of the great circle's shorter arc between the points of two parameters, where that stays in the
    /// sheet.
    pub(crate) fn geodesic(&self, a: DVec2, b: DVec2) -> Option<f64> {
        let [p, q] = [a, b].map(|at| self.jet(at.x, at.y).point / self.radius);
        let across = p.cross(q);
        let angle = libm::atan2(across.length(), p.dot(q));
        let at_pole = [a, b].iter().any(|at| self.latitude(at.y).abs() == 90.0);
        let turn = ((b.x - a.x) * self.longitudes.rate()).abs();
        // Over half a turn the shorter arc is on the other side of the seam.
        if turn > std::f64::consts::PI && !at_pole {
            return None;
        }
        let whole = self.is_pole();
        let Some(n) = across.try_normalize() else {
            // At one point, or at opposite ones, between which all ways are as long.
            return (p.dot(q) > 0.0 || whole == [true; 2]).then_some(self.radius * angle);
        };
        // The great circle is highest at `top`, and as low on the other side.
        let (top, height) = (DVec3::Z - n.z * n, libm::hypot(n.x, n.y));
        let is_between = |x: DVec3| p.cross(x).dot(n) > 0.0 && x.cross(q).dot(n) > 0.0;
        let ends = [self.latitude(a.y), self.latitude(b.y)];
        let [south, north] = self.latitudes;
        let [highest, lowest] = [north.max(ends[0]).max(ends[1]), south.min(ends[0]).min(ends[1])].map(|l| sincos(l).0);
        let leaves_north = !whole[1] && is_between(top) && height > highest + tolerances::SEAM;
        let leaves_south = !whole[0] && is_between(-top) && -height < lowest - tolerances::SEAM;
        (!leaves_north && !leaves_south).then_some(self.radius * angle)
    }
}
