//! Parametric surfaces `S(s, t)` to deform along, over (s, t) ∈ [0, 1]².
//!
//! A surface gives its value with first and second derivatives ([`Jet`]); normals and curvatures follow from these. The
//! kinds with formulas of their own (cylinders, cones, spheres, tori) stand about the z axis, and [`Surface::placed`]
//! puts any kind anywhere.
//!
//! Where two opposite borders are the same curve there is a seam ([`Surface::closes`]); the sheet is cut there. A
//! border that is one point is a pole ([`Surface::poles`]).

use glam::{DMat3, DVec2, DVec3};

use crate::bspline::{Basis, BasisError};
use crate::cone::Cone;
use crate::curve::Curve;
use crate::extrusion::Extrusion;
use crate::patch::{self, Patch};
use crate::revolution::Revolution;
use crate::sphere::Sphere;
use crate::tolerances;
use crate::torus::Torus;

/// A full turn, degrees.
const FULL: [f64; 2] = [0.0, 360.0];

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
    /// The unit normal `S_s × S_t / |S_s × S_t|`; none where that is nothing. At a pole, where S_s is nothing but
    /// rounding, ask [`Surface::normal`].
    #[must_use]
    pub fn normal(&self) -> Option<DVec3> {
        Tangents::from(*self).normal()
    }

    fn map(self, f: impl Fn(DVec3) -> DVec3) -> Self {
        let [point, s, t, ss, st, tt] = [self.point, self.s, self.t, self.ss, self.st, self.tt].map(f);
        Self { point, s, t, ss, st, tt }
    }
}

/// Point and first derivatives at one place, and the mixed one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tangents {
    pub(crate) point: DVec3,
    pub(crate) s: DVec3,
    pub(crate) t: DVec3,
    pub(crate) st: DVec3,
}

impl Tangents {
    /// See [`Jet::normal`].
    pub(crate) fn normal(&self) -> Option<DVec3> {
        self.s.cross(self.t).try_normalize()
    }

    /// The point `d` = (s, t) further on, where both families of parameter lines go on straight.
    pub(crate) fn beyond(&self, d: DVec2) -> DVec3 {
        self.point + d.x * self.s + d.y * self.t + d.x * d.y * self.st
    }
}

impl From<Jet> for Tangents {
    fn from(Jet { point, s, t, st, .. }: Jet) -> Self {
        Self { point, s, t, st }
    }
}

/// Third derivatives at one place.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Third {
    pub(crate) sss: DVec3,
    pub(crate) sst: DVec3,
    pub(crate) stt: DVec3,
    pub(crate) ttt: DVec3,
}

/// A surface `S(s, t)` over [0, 1]².
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    kind: Kind,
    place: Option<Place>,
    /// Whether s runs backwards, which turns the normals.
    flipped: bool,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Plane { corner: DVec3, sides: [DVec3; 2] },
    Cone(Cone),
    Sphere(Sphere),
    Torus(Torus),
    Patch(Patch),
    Revolution(Revolution),
    Extrusion(Extrusion),
}

/// A rigid motion.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    origin: DVec3,
    turn: DMat3,
}

/// Why numbers make no surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// A length that is not positive, or beyond what can be computed with.
    #[error("{what} is {value}: it must be more than 0, between {:e} and {:e}", tolerances::EXTENTS.start(), tolerances::EXTENTS.end())]
    Size {
        /// Which length.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A coordinate that is infinite or not a number.
    #[error("{what} {index} is at ({}, {}, {}): coordinates must be finite", .value.x, .value.y, .value.z)]
    NotFinite {
        /// What has it.
        what: &'static str,
        /// Which one of several, from 0.
        index: usize,
        /// Its coordinates.
        value: DVec3,
    },
    /// A vector that gives no direction.
    #[error("{what} is ({}, {}, {}), which is no direction: its length must be finite and more than 0", .value.x, .value.y, .value.z)]
    NoDirection {
        /// Which vector.
        what: &'static str,
        /// Its coordinates.
        value: DVec3,
    },
    /// The two directions of a place are one.
    #[error("the directions of z and x are parallel: x must point aside")]
    Parallel,
    /// Angles that make no range.
    #[error("{what} are from {start} to {end} degrees: they must rise, by at most 360")]
    Angles {
        /// Which angles.
        what: &'static str,
        /// The first, in degrees.
        start: f64,
        /// The last, in degrees.
        end: f64,
    },
    /// Latitudes that make no range.
    #[error("latitudes are from {south} to {north} degrees: they must rise, between -90 and 90")]
    Latitudes {
        /// The first, in degrees.
        south: f64,
        /// The last, in degrees.
        north: f64,
    },
    /// A torus that meets itself.
    #[error("the minor radius {minor} is not smaller than the major radius {major}: the torus would meet itself")]
    Tube {
        /// Radius from the axis to the middle of the tube.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// Lists whose lengths disagree.
    #[error("there are {found} {what}: there must be {expected}")]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A weight that is not positive.
    #[error("weight {index} is {value}: weights must be finite and more than 0")]
    Weight {
        /// Which one, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// Degree, knots and number of control points do not fit.
    #[error("along {axis}: {source}")]
    Basis {
        /// s, t, or the profile.
        axis: &'static str,
        /// What does not fit.
        source: BasisError,
    },
    /// Two neighbours of a polyline at one place.
    #[error("points {index} and {} of the profile are at one place: leave out one of them", .index + 1)]
    Coincide {
        /// The first of them, from 0.
        index: usize,
    },
    /// A surface without area.
    #[error("{what} has no area: its two directions coincide, or all of it is a line or a point")]
    Flat {
        /// What has none.
        what: &'static str,
    },
}

/// A length, if it is one to compute with.
pub(crate) fn size(what: &'static str, value: f64) -> Result<f64, SurfaceError> {
    if tolerances::EXTENTS.contains(&value) { Ok(value) } else { Err(SurfaceError::Size { what, value }) }
}

/// A vector's direction, of length 1.
pub(crate) fn direction(what: &'static str, value: DVec3) -> Result<DVec3, SurfaceError> {
    // Scaled first, so that squares neither overflow nor vanish.
    let scaled = value / value.abs().max_element();
    if scaled.is_finite() { Ok(scaled.normalize()) } else { Err(SurfaceError::NoDirection { what, value }) }
}

impl From<Patch> for Surface {
    fn from(patch: Patch) -> Self {
        Self::new(Kind::Patch(patch))
    }
}

impl Surface {
    fn new(kind: Kind) -> Self {
        Self { kind, place: None, flipped: false }
    }

    /// [`Surface::parallelogram`] of sides that are known to be good.
    ///
    /// # Panics
    ///
    /// Panics where that is an error.
    #[must_use]
    pub fn plane(corner: DVec3, sides: [DVec3; 2]) -> Self {
        Self::parallelogram(corner, sides).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The parallelogram `corner + s sides[0] + t sides[1]`.
    ///
    /// # Errors
    ///
    /// Coordinates that are not finite; sides that are parallel, or nothing.
    pub fn parallelogram(corner: DVec3, sides: [DVec3; 2]) -> Result<Self, SurfaceError> {
        if !corner.is_finite() {
            return Err(SurfaceError::NotFinite { what: "corner", index: 0, value: corner });
        }
        let [s, t] = [direction("side 0", sides[0])?, direction("side 1", sides[1])?];
        for side in sides {
            size("the length of a side", side.length())?;
        }
        if s.cross(t).length() <= tolerances::FLAT_SURFACE {
            return Err(SurfaceError::Flat { what: "the parallelogram" });
        }
        Ok(Self::new(Kind::Plane { corner, sides }))
    }

    /// A full [`Surface::cylinder_part`] whose sizes are known to be good, from the positive x axis on.
    ///
    /// # Panics
    ///
    /// Panics where that is an error.
    #[must_use]
    pub fn cylinder(radius: f64, height: f64) -> Self {
        Self::cylinder_part(radius, height, FULL).unwrap_or_else(|error| panic!("{error}"))
    }

    /// A cylinder about the z axis, its base in the plane z = 0: s goes round from `angles[0]` to `angles[1]` (degrees
    /// from the positive x axis towards y), t goes up; normals point outwards.
    ///
    /// # Errors
    ///
    /// Sizes that are not positive; angles that do not rise, or by more than a full turn.
    pub fn cylinder_part(radius: f64, height: f64, angles: [f64; 2]) -> Result<Self, SurfaceError> {
        Cone::cylinder(radius, height, angles).map(Kind::Cone).map(Self::new)
    }

    /// As [`Surface::cylinder_part`] with the radius `radii[0]` at the base and `radii[1]` at the top; one of them may
    /// be 0.
    ///
    /// # Errors
    ///
    /// As [`Surface::cylinder_part`]; two radii of 0.
    pub fn cone(radii: [f64; 2], height: f64, angles: [f64; 2]) -> Result<Self, SurfaceError> {
        Cone::new(radii, height, angles).map(Kind::Cone).map(Self::new)
    }

    /// A sphere about the origin: s goes round from `angles[0]` to `angles[1]` (degrees from the positive x axis
    /// towards y), t goes up from the latitude `latitudes[0]` to `latitudes[1]` (degrees, −90 to 90); normals point
    /// outwards.
    ///
    /// # Errors
    ///
    /// As [`Surface::cylinder_part`]; latitudes that do not rise or are beyond the poles.
    pub fn sphere(radius: f64, angles: [f64; 2], latitudes: [f64; 2]) -> Result<Self, SurfaceError> {
        Sphere::new(radius, angles, latitudes).map(Kind::Sphere).map(Self::new)
    }

    /// A torus about the z axis: s goes round it from `angles[0]` to `angles[1]` (degrees from the positive x axis
    /// towards y), t round its tube from `tube[0]` to `tube[1]` (degrees from the outer equator upwards); normals point
    /// out of the tube. `radii` are those of the tube's middle and of the tube.
    ///
    /// # Errors
    ///
    /// As [`Surface::cylinder_part`]; a tube as wide as the torus, or wider.
    pub fn torus(radii: [f64; 2], angles: [f64; 2], tube: [f64; 2]) -> Result<Self, SurfaceError> {
        Torus::new(radii[0], radii[1], angles, tube).map(Kind::Torus).map(Self::new)
    }

    /// The profile `curve` (t) turned about the line through `axis[0]` along `axis[1]` from `angles[0]` to `angles[1]`
    /// (degrees, right-handed; s). Normals of a profile that goes up beside its axis point outwards.
    ///
    /// # Errors
    ///
    /// As [`Surface::cylinder_part`]; an axis without direction; a profile on the axis.
    pub fn revolution(curve: Curve, axis: [DVec3; 2], angles: [f64; 2]) -> Result<Self, SurfaceError> {
        Revolution::new(curve, axis, angles).map(Kind::Revolution).map(Self::new)
    }

    /// The profile `curve` (s) moved by the vector `along` (t).
    ///
    /// # Errors
    ///
    /// A vector without direction; a profile that is straight along it.
    pub fn extrusion(curve: Curve, along: DVec3) -> Result<Self, SurfaceError> {
        Extrusion::new(curve, along).map(Kind::Extrusion).map(Self::new)
    }

    /// The surface, its origin moved to `origin`, its z axis turned to the direction `z`, its x axis to the part of the
    /// direction `x` across `z`.
    ///
    /// # Errors
    ///
    /// Coordinates that are not finite; directions that are none, or parallel.
    pub fn placed(self, origin: DVec3, z: DVec3, x: DVec3) -> Result<Self, SurfaceError> {
        if !origin.is_finite() {
            return Err(SurfaceError::NotFinite { what: "origin", index: 0, value: origin });
        }
        let [z, x] = [direction("z", z)?, direction("x", x)?];
        let across = x - x.dot(z) * z;
        if across.length() <= tolerances::FLAT_SURFACE {
            return Err(SurfaceError::Parallel);
        }
        let x = across.normalize();
        let place = Place { origin, turn: DMat3::from_cols(x, z.cross(x), z) };
        let place = match self.place {
            Some(inner) => Place { origin: place.turn * inner.origin + origin, turn: place.turn * inner.turn },
            None => place,
        };
        Ok(Self { place: Some(place), ..self })
    }

    /// The surface with s running backwards: its normals are turned.
    #[must_use]
    pub fn flipped(self) -> Self {
        Self { flipped: !self.flipped, ..self }
    }

    /// The patch, if the surface is one that was not placed.
    #[must_use]
    pub fn patch(&self) -> Option<&Patch> {
        match &self.kind {
            Kind::Patch(patch) if self.place.is_none() && !self.flipped => Some(patch),
            _ => None,
        }
    }

    /// Point and derivatives at (s, t), also a little outside [0, 1]²: there the kind's formula goes on, a patch or a
    /// profile along its tangents at the border, or round where it closes.
    #[must_use]
    pub fn jet(&self, s: f64, t: f64) -> Jet {
        let jet = self.kind_jet(self.kind_s(s), t);
        self.outward(jet)
    }

    /// The jet, and the unit normal there as a limit: at a smooth pole too, where the jet has none. None at the apex of
    /// a cone and wherever else a surface has no tangent plane.
    ///
    /// The normal is that of S_s × S_t: to the left of t when s goes right, seen from its tip.
    #[must_use]
    pub fn jet_and_normal(&self, s: f64, t: f64) -> (Jet, Option<DVec3>) {
        let s = self.kind_s(s);
        let jet = self.kind_jet(s, t);
        (self.outward(jet), self.outward_normal(self.kind_normal(s, t, &jet.into())))
    }

    /// As [`Surface::jet_and_normal`], in less time.
    pub(crate) fn tangents_and_normal(&self, s: f64, t: f64) -> (Tangents, Option<DVec3>) {
        let s = self.kind_s(s);
        let tangents = match &self.kind {
            Kind::Patch(patch) => {
                let [[point, t], [s, st]] = patch.partials(s, t);
                Tangents { point, s, t, st }
            }
            _ => self.kind_jet(s, t).into(),
        };
        let normal = self.outward_normal(self.kind_normal(s, t, &tangents));
        let Tangents { point, s, t, st } = tangents;
        let [s, st] = if self.flipped { [-s, -st] } else { [s, st] };
        let tangents = match self.place {
            None => Tangents { point, s, t, st },
            Some(Place { origin, turn }) => {
                Tangents { point: turn * point + origin, s: turn * s, t: turn * t, st: turn * st }
            }
        };
        (tangents, normal)
    }

    /// The jet, and third derivatives.
    pub(crate) fn jet_and_third(&self, s: f64, t: f64) -> (Jet, Third) {
        let s = self.kind_s(s);
        let (jet, third) = match &self.kind {
            Kind::Patch(patch) => {
                let partials = patch.partials::<4>(s, t);
                let [sss, sst] = [partials[3][0], partials[2][1]];
                (patch::jet(&partials), Third { sss, sst, stt: partials[1][2], ttt: partials[0][3] })
            }
            Kind::Plane { .. } => (self.kind_jet(s, t), Third::default()),
            Kind::Cone(cone) => (cone.jet(s, t), cone.third(s, t)),
            Kind::Sphere(sphere) => (sphere.jet(s, t), sphere.third(s, t)),
            Kind::Torus(torus) => (torus.jet(s, t), torus.third(s, t)),
            Kind::Revolution(revolution) => (revolution.jet(s, t), revolution.third(s, t)),
            Kind::Extrusion(extrusion) => (extrusion.jet(s, t), extrusion.third(s)),
        };
        let Third { sss, sst, stt, ttt } = third;
        let [sss, stt] = if self.flipped { [-sss, -stt] } else { [sss, stt] };
        let [sss, sst, stt, ttt] = [sss, sst, stt, ttt].map(|v| self.place.map_or(v, |place| place.turn * v));
        (self.outward(jet), Third { sss, sst, stt, ttt })
    }

    /// The unit normal at (s, t) as a limit; see [`Surface::jet_and_normal`].
    #[must_use]
    pub fn normal(&self, s: f64, t: f64) -> Option<DVec3> {
        self.tangents_and_normal(s, t).1
    }

    /// Whether s = 0 and s = 1 are the same curve, and whether t = 0 and t = 1 are: there is a seam.
    #[must_use]
    pub fn closes(&self) -> [bool; 2] {
        match &self.kind {
            Kind::Plane { .. } => [false, false],
            Kind::Cone(cone) => [cone.is_full(), false],
            Kind::Sphere(sphere) => [sphere.is_full(), false],
            Kind::Torus(torus) => torus.closes(),
            Kind::Patch(patch) => patch.closes(),
            Kind::Revolution(revolution) => revolution.closes(),
            Kind::Extrusion(extrusion) => [extrusion.closes(), false],
        }
    }

    /// Whether the borders s = 0, s = 1, t = 0, t = 1 are one point each: poles and apexes.
    #[must_use]
    pub fn poles(&self) -> [bool; 4] {
        let along_t = |[low, high]: [bool; 2]| [false, false, low, high];
        let [s0, s1, t0, t1] = match &self.kind {
            Kind::Plane { .. } | Kind::Torus(_) | Kind::Extrusion(_) => [false; 4],
            Kind::Cone(cone) => along_t(cone.is_apex()),
            Kind::Sphere(sphere) => along_t(sphere.is_pole()),
            Kind::Patch(patch) => patch.poles().map(|pole| pole.is_some()),
            Kind::Revolution(revolution) => along_t(revolution.poles().map(|pole| pole.is_some())),
        };
        if self.flipped { [s1, s0, t0, t1] } else { [s0, s1, t0, t1] }
    }

    /// Ends of the parts along s and along t within which S is one formula: 0 first, 1 last.
    pub(crate) fn breaks(&self) -> [Vec<f64>; 2] {
        let whole = || vec![0.0, 1.0];
        let [s, t] = match &self.kind {
            Kind::Plane { .. } | Kind::Cone(_) | Kind::Sphere(_) | Kind::Torus(_) => [whole(), whole()],
            Kind::Patch(patch) => patch.bases().each_ref().map(Basis::breaks),
            Kind::Revolution(revolution) => [whole(), revolution.breaks()],
            Kind::Extrusion(extrusion) => [extrusion.profile().breaks(), whole()],
        };
        [if self.flipped { s.iter().rev().map(|s| 1.0 - s).collect() } else { s }, t]
    }

    /// Degrees in s and in t, where S is a polynomial in each of these parts.
    pub(crate) fn degrees(&self) -> Option<[usize; 2]> {
        match &self.kind {
            Kind::Plane { .. } => Some([1, 1]),
            Kind::Patch(patch) if patch.weights().is_none() => Some(patch.bases().each_ref().map(Basis::degree)),
            Kind::Extrusion(extrusion) if extrusion.profile().weights().is_none() => {
                Some([extrusion.profile().basis().degree(), 1])
            }
            _ => None,
        }
    }

    /// Whether all derivatives are continuous, as formulas' are, and those of polynomials that have no knots inside.
    pub(crate) fn is_smooth(&self) -> bool {
        match &self.kind {
            Kind::Plane { .. } | Kind::Cone(_) | Kind::Sphere(_) | Kind::Torus(_) => true,
            Kind::Patch(patch) => patch.is_smooth(),
            Kind::Revolution(revolution) => revolution.is_smooth(),
            Kind::Extrusion(extrusion) => extrusion.is_smooth(),
        }
    }

    /// Whether [`Surface::development`] has an answer: planes, cylinders, cones, extrusions, and patches that are extrusions.
    #[must_use]
    pub fn is_developable(&self) -> bool {
        match &self.kind {
            Kind::Plane { .. } | Kind::Cone(_) | Kind::Extrusion(_) => true,
            Kind::Patch(patch) => patch.extrusion().is_some(),
            Kind::Sphere(_) | Kind::Torus(_) | Kind::Revolution(_) => false,
        }
    }

    /// Where (s, t) is when the surface, cut at its seam, is unrolled into the plane without stretching: lengths and
    /// angles on the sheet are those on the surface, and the turn from S_s to S_t is counter-clockwise. Exact for
    /// planes, cylinders and cones; for extrusions the profile's length is good to 1e-12. None for other kinds.
    #[must_use]
    pub fn development(&self, s: f64, t: f64) -> Option<DVec2> {
        let s = self.kind_s(s);
        let developed = match &self.kind {
            Kind::Plane { sides, .. } => {
                let along = sides[0].length();
                let across = sides[0].cross(sides[1]).length() / along;
                let shear = sides[0].dot(sides[1]) / along;
                DVec2::new(s * along + t * shear, t * across)
            }
            Kind::Cone(cone) => cone.development(s, t),
            Kind::Extrusion(extrusion) => extrusion.development(s, t),
            Kind::Patch(patch) => patch.development(s, t)?,
            _ => return None,
        };
        Some(if self.flipped { DVec2::new(-developed.x, developed.y) } else { developed })
    }

    /// The length of the shortest way on the surface, cut at its seam, between the points at `a` and `b` = (s, t),
    /// where that is a straight line of the development or an arc of a great circle. None for other kinds, and where
    /// that would leave the sheet: round the apex or over the inner rim of a cone, over a border of a part of a sphere,
    /// across a seam, or over the uneven border of an extrusion whose profile is not across its direction.
    #[must_use]
    pub fn geodesic(&self, a: DVec2, b: DVec2) -> Option<f64> {
        let [p, q] = [a, b].map(|at| DVec2::new(self.kind_s(at.x), at.y));
        let stays = match &self.kind {
            Kind::Plane { .. } => true,
            Kind::Cone(cone) => cone.sees(p, q),
            Kind::Extrusion(extrusion) => extrusion.is_straight(),
            Kind::Patch(patch) => patch.extrusion().is_some_and(|(_, extrusion)| extrusion.is_straight()),
            Kind::Sphere(sphere) => return sphere.geodesic(p, q),
            _ => false,
        };
        let [p, q] = [a, b].map(|at| self.development(at.x, at.y));
        p.zip(q).filter(|_| stays).map(|(p, q)| p.distance(q))
    }

    /// The kind's own s.
    fn kind_s(&self, s: f64) -> f64 {
        if self.flipped { 1.0 - s } else { s }
    }

    fn kind_jet(&self, s: f64, t: f64) -> Jet {
        match &self.kind {
            Kind::Plane { corner, sides } => Jet {
                point: corner + s * sides[0] + t * sides[1],
                s: sides[0],
                t: sides[1],
                ss: DVec3::ZERO,
                st: DVec3::ZERO,
                tt: DVec3::ZERO,
            },
            Kind::Cone(cone) => cone.jet(s, t),
            Kind::Sphere(sphere) => sphere.jet(s, t),
            Kind::Torus(torus) => torus.jet(s, t),
            Kind::Patch(patch) => patch.jet(s, t),
            Kind::Revolution(revolution) => revolution.jet(s, t),
            Kind::Extrusion(extrusion) => extrusion.jet(s, t),
        }
    }

    fn kind_normal(&self, s: f64, t: f64, tangents: &Tangents) -> Option<DVec3> {
        let pole = match &self.kind {
            Kind::Cone(cone) => return cone.normal(t, tangents),
            Kind::Sphere(sphere) => return Some(sphere.normal(t, tangents.point)),
            Kind::Patch(patch) => on_border(patch.poles(), s, t),
            Kind::Revolution(revolution) => {
                let [low, high] = revolution.poles();
                on_border(&[None, None, low, high], s, t)
            }
            _ => None,
        };
        pole.unwrap_or_else(|| tangents.normal())
    }

    /// A normal of the kind as one of the surface.
    fn outward_normal(&self, normal: Option<DVec3>) -> Option<DVec3> {
        let turned = normal.map(|normal| self.place.map_or(normal, |place| place.turn * normal));
        turned.map(|normal| if self.flipped { -normal } else { normal })
    }

    /// A jet of the kind as one of the surface.
    fn outward(&self, jet: Jet) -> Jet {
        let jet = if self.flipped { Jet { s: -jet.s, st: -jet.st, ..jet } } else { jet };
        match self.place {
            None => jet,
            Some(Place { origin, turn }) => {
                let turned = jet.map(|v| turn * v);
                Jet { point: turned.point + origin, ..turned }
            }
        }
    }
}

/// The pole whose border (s, t) is on.
fn on_border<T: Copy>([s0, s1, t0, t1]: &[Option<T>; 4], s: f64, t: f64) -> Option<T> {
    let at = |pole: &Option<T>, is_there: bool| pole.filter(|_| is_there);
    at(t0, t == 0.0).or(at(t1, t == 1.0)).or(at(s0, s == 0.0)).or(at(s1, s == 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Third derivatives are the differences of second ones, for every kind, placed and flipped.
    #[test]
    fn third_derivatives_are_rates_of_second_ones() {
        let profile = || {
            let points = [[1.0, 0.0], [1.4, 0.5], [0.8, 1.1], [1.2, 1.6]].map(|[x, z]| DVec3::new(x, 0.1 * z, z));
            Curve::new(Basis::clamped(4, 3).unwrap(), points.to_vec(), Some(vec![1.0, 2.0, 0.7, 1.0])).unwrap()
        };
        let net = |k: usize| DVec3::new((k / 5) as f64, (k % 5) as f64, ((k * 7) % 11) as f64 / 5.0);
        let weights = (0..25).map(|k| 1.0 + 0.1 * ((k * 3) % 7) as f64).collect();
        let bases = [Basis::clamped(5, 3).unwrap(), Basis::bernstein(5).unwrap()];
        let patch = Patch::new(bases, (0..25).map(net).collect(), Some(weights)).unwrap();
        let axis = [DVec3::ZERO, DVec3::new(0.1, -0.2, 1.0)];
        let kinds = [
            Surface::plane(DVec3::ONE, [DVec3::X, DVec3::new(0.3, 1.0, 0.2)]),
            Surface::cylinder_part(1.3, 2.0, [10.0, 200.0]).unwrap(),
            Surface::cone([2.0, 0.5], 1.5, [0.0, 300.0]).unwrap(),
            Surface::sphere(1.2, [0.0, 120.0], [-60.0, 70.0]).unwrap(),
            Surface::torus([2.0, 0.7], [0.0, 90.0], [-45.0, 135.0]).unwrap(),
            Surface::from(patch),
            Surface::revolution(profile(), axis, [0.0, 250.0]).unwrap(),
            Surface::extrusion(profile(), DVec3::new(0.2, 1.0, 0.0)).unwrap(),
        ];
        let turned = |kind: Surface| kind.flipped().placed(DVec3::ONE, DVec3::new(1.0, 2.0, 3.0), DVec3::X).unwrap();
        let all = kinds.iter().cloned().chain(kinds.iter().cloned().map(turned));
        for (number, surface) in all.enumerate() {
            // Beyond the border, too, where parameter lines go on straight; not on the patch's knot, where they jump.
            for (s, t) in [(0.3, 0.6), (0.71, 0.2), (0.47, 0.9), (1.2, 0.4), (0.6, -0.3), (1.3, 1.1)] {
                let h = 1e-4;
                let rate = |of: fn(&Jet) -> DVec3, ds: f64, dt: f64| {
                    (of(&surface.jet(s + ds, t + dt)) - of(&surface.jet(s - ds, t - dt))) / (2.0 * h)
                };
                let (jet, Third { sss, sst, stt, ttt }) = surface.jet_and_third(s, t);
                assert!(jet.tt.distance(surface.jet(s, t).tt) <= 1e-13 * jet.tt.length());
                let expected = [
                    rate(|jet| jet.ss, h, 0.0),
                    rate(|jet| jet.ss, 0.0, h),
                    rate(|jet| jet.tt, h, 0.0),
                    rate(|jet| jet.tt, 0.0, h),
                ];
                for (found, expected) in [sss, sst, stt, ttt].into_iter().zip(expected) {
                    let size = expected.length() + jet.ss.length() + jet.tt.length() + 1.0;
                    assert!(found.distance(expected) < 1e-5 * size, "{number} at {s}, {t}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn tangents_and_normals_are_those_of_jets() {
        let net = |k: usize| DVec3::new((k / 5) as f64, (k % 5) as f64, ((k * 7) % 11) as f64 / 5.0);
        let bases = [0; 2].map(|_| Basis::clamped(5, 3).unwrap());
        let patch = Surface::from(Patch::new(bases, (0..25).map(net).collect(), None).unwrap());
        let cone = Surface::cone([2.0, 0.5], 1.5, [0.0, 300.0]).unwrap().flipped();
        let placed = patch.clone().flipped().placed(DVec3::ONE, DVec3::ONE, DVec3::X).unwrap();
        for surface in [patch, cone, placed] {
            for (s, t) in [(0.3, 0.6), (0.0, 1.0), (0.5, 0.5), (1.2, 0.4)] {
                let ((jet, normal), (tangents, same)) =
                    (surface.jet_and_normal(s, t), surface.tangents_and_normal(s, t));
                assert!(normal.unwrap().distance(same.unwrap()) < 1e-14);
                let pairs =
                    [(jet.point, tangents.point), (jet.s, tangents.s), (jet.t, tangents.t), (jet.st, tangents.st)];
                assert!(pairs.iter().all(|(a, b)| a.distance(*b) <= 1e-13 * (1.0 + a.length())));
            }
        }
    }
}
