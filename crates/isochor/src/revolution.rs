//! Surfaces of revolution: a profile C(t) turned about an axis by θ(s).

use glam::DVec3;

use crate::arc::Arc;
use crate::curve::Curve;
use crate::surface::{Jet, SurfaceError, Third, direction};
use crate::tolerances;

/// A profile turned about an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Revolution {
    profile: Curve,
    on_axis: DVec3,
    /// Unit vector.
    axis: DVec3,
    arc: Arc,
    /// Whether the profile begins and ends on the axis, and the normal there, if there is one.
    poles: [Option<Option<DVec3>>; 2],
}

impl Revolution {
    pub(crate) fn new(profile: Curve, [on_axis, axis]: [DVec3; 2], angles: [f64; 2]) -> Result<Self, SurfaceError> {
        if !on_axis.is_finite() {
            return Err(SurfaceError::NotFinite { what: "the axis's point", index: 0, value: on_axis });
        }
        let axis = direction("the axis", axis)?;
        let arc = Arc::new("angles", angles)?;
        let surface = Self { profile, on_axis, axis, arc, poles: [None; 2] };
        let extent = surface.profile.extent();
        let arm = |t: f64| axis.cross(surface.profile.jet(t).point - on_axis).length();
        let is_on_axis = |t: f64| arm(t) <= tolerances::SEAM * extent;
        let is_flat = |t: &f64| {
            let jet = surface.profile.jet(*t);
            let around = axis.cross(jet.point - on_axis);
            around.cross(jet.first).length()
                <= tolerances::FLAT_SURFACE * around.length().max(jet.first.length()) * extent
        };
        if surface.profile.sites().iter().all(is_flat) {
            return Err(SurfaceError::Flat { what: "the surface of revolution" });
        }
        let pole = |t: f64, inward: f64| {
            is_on_axis(t).then(|| {
                // With the profile leaving the axis along e, S_s × S_t goes with (axis × e) × e at t = 0, and against
                // it at t = 1.
                let tangent = surface.profile.jet(t).first.try_normalize()?;
                (tangent.dot(axis).abs() <= tolerances::POLE).then_some(-inward * axis)
            })
        };
        let poles = if surface.profile.closes() { [None; 2] } else { [pole(0.0, 1.0), pole(1.0, -1.0)] };
        Ok(Self { poles, ..surface })
    }

    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let curve = self.profile.jet(t);
        let (rate, axis) = (self.arc.rate(), self.axis);
        let [arm, t, tt] = self.turned(s, [curve.point - self.on_axis, curve.first, curve.second]);
        Jet {
            point: self.on_axis + arm,
            s: rate * axis.cross(arm),
            t,
            ss: rate * rate * axis.cross(axis.cross(arm)),
            st: rate * axis.cross(t),
            tt,
        }
    }

    pub(crate) fn third(&self, s: f64, t: f64) -> Third {
        let curve = self.profile.jet(t);
        let (rate, axis) = (self.arc.rate(), self.axis);
        let vectors = [curve.point - self.on_axis, curve.first, curve.second, self.profile.third(t)];
        let [arm, t, tt, ttt] = self.turned(s, vectors);
        let around = |v: DVec3| rate * axis.cross(v);
        Third { sss: around(around(around(arm))), sst: around(around(t)), stt: around(tt), ttt }
    }

    /// Vectors at the profile, turned about the axis.
    fn turned<const N: usize>(&self, s: f64, vectors: [DVec3; N]) -> [DVec3; N] {
        let ((sin, cos), axis) = (self.arc.sincos(s), self.axis);
        vectors.map(|v| {
            let along = v.dot(axis) * axis;
            along + cos * (v - along) + sin * axis.cross(v)
        })
    }

    /// Ends of the profile's pieces along t.
    pub(crate) fn breaks(&self) -> Vec<f64> {
        self.profile.breaks()
    }

    pub(crate) fn is_smooth(&self) -> bool {
        self.profile.is_smooth()
    }

    pub(crate) fn closes(&self) -> [bool; 2] {
        [self.arc.is_full(), self.profile.closes()]
    }

    /// The borders t = 0 and t = 1 that are poles, with the normal there, if there is one.
    pub(crate) fn poles(&self) -> [Option<Option<DVec3>>; 2] {
        self.poles
    }
}
