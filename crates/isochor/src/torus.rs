//! Tori about the z axis: `S(s, t) = (R + r cos φ)(cos θ, sin θ, 0) + r sin φ e_z`, s along θ round the axis, t along φ
//! round the tube.

use glam::DVec3;

use crate::arc::Arc;
use crate::surface::{Jet, SurfaceError, Third, size};

/// A torus, or a part of one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Torus {
    major: f64,
    minor: f64,
    arc: Arc,
    tube: Arc,
}

impl Torus {
    pub(crate) fn new(major: f64, minor: f64, angles: [f64; 2], tube: [f64; 2]) -> Result<Self, SurfaceError> {
        let [major, minor] = [size("the major radius", major)?, size("the minor radius", minor)?];
        if minor >= major {
            return Err(SurfaceError::Tube { major, minor });
        }
        Ok(Self { major, minor, arc: Arc::new("angles", angles)?, tube: Arc::new("tube", tube)? })
    }

    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let ((sin, cos), (rise, reach)) = (self.arc.sincos(s), self.tube.sincos(t));
        let [r_s, r_t] = [self.arc.rate(), self.tube.rate()];
        let [out, along] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        let r = self.minor;
        let from_axis = self.major + r * reach;
        Jet {
            point: from_axis * out + r * rise * DVec3::Z,
            s: r_s * from_axis * along,
            t: r * r_t * (reach * DVec3::Z - rise * out),
            ss: -r_s * r_s * from_axis * out,
            st: -r_s * r_t * r * rise * along,
            tt: -r * r_t * r_t * (reach * out + rise * DVec3::Z),
        }
    }

    pub(crate) fn third(&self, s: f64, t: f64) -> Third {
        let ((sin, cos), (rise, reach)) = (self.arc.sincos(s), self.tube.sincos(t));
        let [r_s, r_t] = [self.arc.rate(), self.tube.rate()];
        let [out, along] = [DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0)];
        let r = self.minor;
        Third {
            sss: -r_s * r_s * r_s * (self.major + r * reach) * along,
            sst: r * r_s * r_s * r_t * rise * out,
            stt: -r * r_s * r_t * r_t * reach * along,
            ttt: r * r_t * r_t * r_t * (rise * out - reach * DVec3::Z),
        }
    }

    pub(crate) fn closes(&self) -> [bool; 2] {
        [self.arc.is_full(), self.tube.is_full()]
    }
}
