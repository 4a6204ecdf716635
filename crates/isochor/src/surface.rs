//! Parametric surfaces `S(s, t)` to deform along, over (s, t) ∈ [0, 1]².
//!
//! A surface gives its value with first and second derivatives ([`Jet`]); normals and curvatures follow from these.

use std::f64::consts::TAU;

use glam::DVec3;

/// A surface's point and derivatives at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// S.
    pub point: DVec3,
    /// ∂S/∂s.
    pub s: DVec3,
    /// ∂S/∂t.
    pub t: DVec3,
    /// ∂²S/∂s².
    pub ss: DVec3,
    /// ∂²S/∂s∂t.
    pub st: DVec3,
    /// ∂²S/∂t².
    pub tt: DVec3,
}

impl Jet {
    /// The unit normal `S_s × S_t / |S_s × S_t|`; none where the surface has no tangent plane, as at a pole.
    #[must_use]
    pub fn normal(&self) -> Option<DVec3> {
        self.s.cross(self.t).try_normalize()
    }
}

/// A surface `S(s, t)` over [0, 1]².
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Plane { corner: DVec3, sides: [DVec3; 2] },
    Cylinder { radius: f64, height: f64 },
}

impl Surface {
    /// The parallelogram `corner + s sides[0] + t sides[1]`.
    #[must_use]
    pub fn plane(corner: DVec3, sides: [DVec3; 2]) -> Self {
        Self { kind: Kind::Plane { corner, sides } }
    }

    /// A full cylinder about the z axis, its base in the plane z = 0: s goes once round from the positive x axis towards y, t goes up;
    /// normals point outwards. Its seam is s = 0.
    #[must_use]
    pub fn cylinder(radius: f64, height: f64) -> Self {
        Self { kind: Kind::Cylinder { radius, height } }
    }

    /// Point and derivatives at (s, t), also a little outside [0, 1]², where the kind's formula goes on.
    #[must_use]
    pub fn jet(&self, s: f64, t: f64) -> Jet {
        match &self.kind {
            Kind::Plane { corner, sides } => Jet {
                point: corner + s * sides[0] + t * sides[1],
                s: sides[0],
                t: sides[1],
                ss: DVec3::ZERO,
                st: DVec3::ZERO,
                tt: DVec3::ZERO,
            },
            Kind::Cylinder { radius, height } => {
                let (sin, cos) = libm::sincos(TAU * s);
                let out = radius * DVec3::new(cos, sin, 0.0);
                let along = TAU * radius * DVec3::new(-sin, cos, 0.0);
                Jet {
                    point: out + t * height * DVec3::Z,
                    s: along,
                    t: height * DVec3::Z,
                    ss: -TAU * TAU * out,
                    st: DVec3::ZERO,
                    tt: DVec3::ZERO,
                }
            }
        }
    }
}
