//! Edits: what is done to the control points before the volume is corrected.
//!
//! Twist, bend, taper and stretch follow A. H. Barr, *Global and local deformations of solid primitives*, SIGGRAPH 1984;
//! the page `docs/edit.md` has all formulas with examples.
//!
//! An edit is a map of space, p ↦ e(p), taken at the *current* position of each control point: edits in a row compose, as a
//! stack of modifiers does. Ranges and centres come from the lattice box at rest. A control point of weight w moves to
//! p + w (e(p) − p); those of weight 0 keep their bits, and so do all where e is the identity.
//!
//! Three are no maps of space: positions given for control points ([`crate::posed`]) and for vertices ([`crate::drag`]), and slides, which
//! keep the volume ([`crate::drag_plane`]).
//!
//! With c the centre, a an axis and `[f, g]` a range in fractions of the box along it, `s` is the linear function of
//! position along a that is 0 at f and 1 at g. It is not clamped: what lies beyond the range continues linearly.
//! Rotations follow the right-hand rule: by a positive angle about z, x turns towards y.
//!
//! # Changes versus the paper
//!
//! - Twist and taper are linear in s, and nothing is clamped.
//! - The bend is given by its angle and the plane in which it happens, not by a rate; it keeps the length of the line
//!   through the centre, and it is written so that it has no singularity at angle 0.

use glam::DVec3;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

use crate::binding::displaced;
use crate::drag::{Drag, DragError};
use crate::drag_plane::DragPlane;
#[cfg(feature = "serde")]
use crate::exact;
use crate::posed::{Posed, PosedError};
use crate::select::{ControlSpace, SelectError, Selector};

/// One edit of the control points.
///
/// ```toml
/// [[edit]]
/// twist = { axis = "z", degrees = 90 }
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Edit {
    /// Turns cross-sections about an axis, the more the further along it.
    Twist(Twist),
    /// Makes an arc of an axis.
    Bend(Bend),
    /// Scales cross-sections, the more the further along an axis.
    Taper(Taper),
    /// Scales along an axis.
    Stretch(Stretch),
    /// Moves by a vector.
    Move(Move),
    /// Moves by what of a vector keeps the volume: within the drag plane of the control points that it moves. Not with Green coordinates.
    Slide(Move),
    /// Turns about an axis.
    Rotate(Rotate),
    /// Scales about a centre.
    Scale(Scale),
    /// Moves at random.
    Noise(Noise),
    /// Puts control points at given positions.
    Posed(Posed),
    /// Brings vertices to given positions.
    Drag(Drag),
}

/// A coordinate axis of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second coordinate.
    Y,
    /// The third coordinate.
    #[default]
    Z,
}

/// A coordinate axis of the model, or its opposite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum SignedAxis {
    /// Along the first coordinate.
    X,
    /// Along the second coordinate.
    Y,
    /// Along the third coordinate.
    Z,
    /// Against the first coordinate.
    #[cfg_attr(feature = "serde", serde(rename = "-x"))]
    MinusX,
    /// Against the second coordinate.
    #[cfg_attr(feature = "serde", serde(rename = "-y"))]
    MinusY,
    /// Against the third coordinate.
    #[cfg_attr(feature = "serde", serde(rename = "-z"))]
    MinusZ,
}

/// What an axis of rotation points along.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(untagged, expecting = "`axis` must be \"x\", \"y\", \"z\" or a vector [x, y, z]")
)]
pub enum RotationAxis {
    /// A coordinate axis.
    Coordinate(Axis),
    /// Any vector but 0, of any length.
    Vector(#[cfg_attr(feature = "serde", serde(deserialize_with = "exact::vector"))] DVec3),
}

/// Factors of a scaling.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(untagged, expecting = "`by` must be a number or three of them: [x, y, z]")
)]
pub enum Factors {
    /// The same along all axes.
    Uniform(f64),
    /// One for each of x, y, z.
    PerAxis(#[cfg_attr(feature = "serde", serde(deserialize_with = "exact::vector"))] DVec3),
}

/// The unit in which a length is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum LengthUnit {
    /// The longest side of the model's bounding box at rest.
    Extent,
    /// The unit of the model's coordinates.
    Model,
}

/// Rotation about the line through `center` along `axis`, by `degrees · s`.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Twist {
    /// The axis.
    pub axis: Axis,
    /// The angle at s = 1, by the right-hand rule.
    pub degrees: f64,
    /// Where s is 0 and where it is 1, in fractions of the box along the axis; `None`: 0 and 1.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_array"))]
    pub range: Option<[f64; 2]>,
    /// A point of the line, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// The line through `center` along `axis` becomes an arc in the plane of `axis` and `towards`; lengths along it are kept.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Bend {
    /// The axis.
    pub axis: Axis,
    /// The angle of the arc between s = 0 and s = 1; positive bends to `towards`.
    pub degrees: f64,
    /// Where the end s = 1 turns to, not along `axis`; `None`: the next axis in the cycle x → y → z → x.
    #[cfg_attr(feature = "serde", serde(default))]
    pub towards: Option<SignedAxis>,
    /// Where s is 0 and where it is 1, in fractions of the box along the axis; `None`: 0 and 1. The point of the line at
    /// s = 0 stays where it is.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_array"))]
    pub range: Option<[f64; 2]>,
    /// A point of the line, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Scaling about the line through `center` along `axis`, at right angles to it, by `1 + (scale − 1) s`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Taper {
    /// The axis.
    pub axis: Axis,
    /// The factor at s = 1.
    pub scale: f64,
    /// Where s is 0 and where it is 1, in fractions of the box along the axis; `None`: 0 and 1.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_array"))]
    pub range: Option<[f64; 2]>,
    /// A point of the line, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Scaling along `axis`, by `scale`, about the plane through `center`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Stretch {
    /// The axis.
    pub axis: Axis,
    /// The factor.
    pub scale: f64,
    /// A point of the plane, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Translation.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Move {
    /// By what, in `unit`.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "exact::vector"))]
    pub by: DVec3,
    /// The unit of `by`; the model's by default.
    #[cfg_attr(feature = "serde", serde(default = "model_unit"))]
    pub unit: LengthUnit,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Rotation about the line through `center` along `axis`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Rotate {
    /// The axis.
    pub axis: RotationAxis,
    /// The angle, by the right-hand rule.
    pub degrees: f64,
    /// A point of the line, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Scaling about `center`. A negative factor mirrors.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Scale {
    /// The factors.
    pub by: Factors,
    /// The point that stays, in model coordinates; `None`: the middle of the box.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "exact::optional_vector"))]
    pub center: Option<DVec3>,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Every coordinate moves by `amplitude · U`, U uniform in (−1, 1).
///
/// The numbers U are the same everywhere for one seed: x, y, z of control after control, whether selected or not. U is
/// `(⌊r / 2¹²⌋ + ½) / 2⁵¹ − 1`, r the next output of PCG XSL-RR 128/64 (M. E. O'Neill, *PCG: a family of simple fast
/// space-efficient statistically good algorithms for random number generation*, 2014) with the seed as initial state and
/// the stream `0xa02bdbf7bb3c0a7ac28fa16a64abf96`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Noise {
    /// The longest move of a coordinate, in `unit`.
    pub amplitude: f64,
    /// Which random numbers.
    #[cfg_attr(feature = "serde", serde(default))]
    pub seed: u64,
    /// The unit of `amplitude`; the extent by default.
    #[cfg_attr(feature = "serde", serde(default = "extent_unit"))]
    pub unit: LengthUnit,
    /// The control points it moves.
    #[cfg_attr(feature = "serde", serde(default))]
    pub nodes: Selector,
}

/// Why an edit cannot be done.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EditError {
    /// An infinite number, or one that is not a number.
    #[error("{edit}: {key} is {value}: it must be finite")]
    NotFinite {
        /// Name of the edit.
        edit: &'static str,
        /// The key that has it.
        key: &'static str,
        /// The number.
        value: f64,
    },
    /// The control points it should move.
    #[error("{edit}: nodes: {source}")]
    Nodes {
        /// Name of the edit.
        edit: &'static str,
        /// What is wrong with the selector.
        source: SelectError,
    },
    /// A range without length.
    #[error("{edit}: the range [{}, {}] along {axis} of the lattice box (there {side} long) has no length: its ends must differ", .range[0], .range[1])]
    Range {
        /// Name of the edit.
        edit: &'static str,
        /// 'x', 'y' or 'z'.
        axis: char,
        /// The range, in fractions of the box.
        range: [f64; 2],
        /// Side of the box along the axis.
        side: f64,
    },
    /// A bend along its own axis.
    #[error("bend: the axis {axis} cannot be bent towards itself: `towards` must be another axis")]
    Towards {
        /// 'x', 'y' or 'z'.
        axis: char,
    },
    /// An axis of rotation without direction.
    #[error("rotate: the axis [0, 0, 0] has no direction")]
    NoDirection,
    /// Positions that do not fit the lattice.
    #[error("posed: {0}")]
    Posed(#[from] PosedError),
    /// Vertices that cannot be dragged to their places.
    #[error("drag: {0}")]
    Drag(#[from] DragError),
    /// A slide where no volume depends on the control points alone.
    #[error(
        "slide: there is no volume that could be kept: the model bounds no body, or Green coordinates carry it, whose normals turn as \
         vertices of the cage move"
    )]
    NoVolume,
    /// Finite numbers whose result is not.
    #[error("{edit}: control point [{}, {}, {}] would move out of the range of numbers", .node[0], .node[1], .node[2])]
    Overflow {
        /// Name of the edit.
        edit: &'static str,
        /// The control point.
        node: [usize; 3],
    },
}

impl EditError {
    /// Whether the edit is sound but cannot be done with this lattice; otherwise it is wrong in itself.
    #[must_use]
    pub fn is_unreachable(&self) -> bool {
        matches!(self, Self::Drag(DragError::Unmoved { .. } | DragError::Contradiction { .. }))
    }
}

/// The identity.
impl Default for Taper {
    fn default() -> Self {
        Self { axis: Axis::Z, scale: 1.0, range: None, center: None, nodes: Selector::All }
    }
}

/// The identity.
impl Default for Stretch {
    fn default() -> Self {
        Self { axis: Axis::Z, scale: 1.0, center: None, nodes: Selector::All }
    }
}

/// The identity.
impl Default for Move {
    fn default() -> Self {
        Self { by: DVec3::ZERO, unit: LengthUnit::Model, nodes: Selector::All }
    }
}

/// The identity.
impl Default for Rotate {
    fn default() -> Self {
        Self { axis: RotationAxis::Coordinate(Axis::Z), degrees: 0.0, center: None, nodes: Selector::All }
    }
}

/// The identity.
impl Default for Scale {
    fn default() -> Self {
        Self { by: Factors::Uniform(1.0), center: None, nodes: Selector::All }
    }
}

/// The identity.
impl Default for Noise {
    fn default() -> Self {
        Self { amplitude: 0.0, seed: 0, unit: LengthUnit::Extent, nodes: Selector::All }
    }
}

impl Axis {
    /// 0, 1, 2 for x, y, z.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// Its direction, of length 1.
    #[must_use]
    pub fn direction(self) -> DVec3 {
        DVec3::AXES[self.index()]
    }

    /// The next in the cycle x → y → z → x.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::X => Self::Y,
            Self::Y => Self::Z,
            Self::Z => Self::X,
        }
    }

    fn name(self) -> char {
        ['x', 'y', 'z'][self.index()]
    }
}

impl SignedAxis {
    /// The axis without its sign.
    #[must_use]
    pub fn axis(self) -> Axis {
        match self {
            Self::X | Self::MinusX => Axis::X,
            Self::Y | Self::MinusY => Axis::Y,
            Self::Z | Self::MinusZ => Axis::Z,
        }
    }

    /// 1 or −1.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::X | Self::Y | Self::Z => 1.0,
            Self::MinusX | Self::MinusY | Self::MinusZ => -1.0,
        }
    }
}

/// Where the control point of an index goes from a position.
type Law<'a> = Box<dyn Fn(usize, DVec3) -> DVec3 + 'a>;

impl Edit {
    /// Its key in a job file.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Twist(_) => "twist",
            Self::Bend(_) => "bend",
            Self::Taper(_) => "taper",
            Self::Stretch(_) => "stretch",
            Self::Move(_) => "move",
            Self::Slide(_) => "slide",
            Self::Rotate(_) => "rotate",
            Self::Scale(_) => "scale",
            Self::Noise(_) => "noise",
            Self::Posed(_) => "posed",
            Self::Drag(_) => "drag",
        }
    }

    /// The control points that it moves.
    #[must_use]
    pub fn nodes(&self) -> &Selector {
        match self {
            Self::Twist(edit) => &edit.nodes,
            Self::Bend(edit) => &edit.nodes,
            Self::Taper(edit) => &edit.nodes,
            Self::Stretch(edit) => &edit.nodes,
            Self::Move(edit) | Self::Slide(edit) => &edit.nodes,
            Self::Rotate(edit) => &edit.nodes,
            Self::Scale(edit) => &edit.nodes,
            Self::Noise(edit) => &edit.nodes,
            Self::Posed(edit) => &edit.nodes,
            Self::Drag(edit) => &edit.nodes,
        }
    }

    /// Moves `controls` (#controls × 3, current positions relative to the origin of `space`).
    ///
    /// # Errors
    ///
    /// A selector that picks nothing; a number that is not finite or for which the edit is not defined; positions that do
    /// not fit the lattice; vertices that cannot be dragged to their places. Then `controls` are as they were.
    ///
    /// # Panics
    ///
    /// Panics where `controls` or the binding of `space` does not have one entry for each control point of `space`, or its
    /// vertices not one row each.
    pub fn apply(&self, controls: &mut [DVec3], space: &ControlSpace) -> Result<(), EditError> {
        assert_eq!(controls.len(), space.rest.len(), "one position for each control point");
        assert_eq!(controls.len(), space.size.iter().product::<usize>(), "a size that fits the control points");
        let edit = self.name();
        let weights = self.nodes().weights(space).map_err(|source| EditError::Nodes { edit, source })?;
        let blended = |law: Law| -> Vec<DVec3> {
            let blend = |(c, (&p, &weight)): (usize, (&DVec3, &f64))| match weight {
                0.0 => p,
                1.0 => law(c, p),
                _ => p + weight * (law(c, p) - p),
            };
            controls.iter().zip(&weights).enumerate().map(blend).collect()
        };
        let moved = match self {
            Self::Twist(twist) => blended(twist.law(space)?),
            Self::Bend(bend) => blended(bend.law(space)?),
            Self::Taper(taper) => blended(taper.law(space)?),
            Self::Stretch(stretch) => blended(stretch.law(space)?),
            Self::Move(by) => blended(by.law(space)?),
            Self::Slide(by) => blended(by.slide(controls, &weights, space)?),
            Self::Rotate(rotate) => blended(rotate.law(space)?),
            Self::Scale(scale) => blended(scale.law(space)?),
            Self::Noise(noise) => blended(noise.law(space)?),
            Self::Posed(posed) => {
                let targets = posed.targets(space)?;
                blended(Box::new(|c, p| targets[c].unwrap_or(p)))
            }
            Self::Drag(drag) => displaced(controls, &drag.displacement(controls, &weights, space)?),
        };
        if let Some(c) = moved.iter().position(|p| !p.is_finite()) {
            return Err(EditError::Overflow { edit, node: space.node(c) });
        }
        controls.copy_from_slice(&moved);
        Ok(())
    }
}

// All laws have the form p + displacement, with a displacement that is exactly 0 where nothing should move.

impl Twist {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("twist", "degrees", &[self.degrees])?;
        let along = Along::new("twist", self.axis, self.range, space)?;
        let center = center("twist", self.center, space)?;
        let (axis, degrees) = (self.axis.direction(), self.degrees);
        Ok(Box::new(move |_, p| p + turn(p - center, axis, degrees * along.fraction(p))))
    }
}

impl Bend {
    /// With t the distance from s = 0 along the axis, ξ that from the centre line along `towards`, θ the angle,
    /// φ = θ s and R = L / θ the radius of the arc:
    ///
    /// ```text
    /// t′ = (R − ξ) sin φ          =  t sinc φ − ξ sin φ
    /// ξ′ = R − (R − ξ) cos φ      =  ξ cos φ + t sin(φ/2) sinc(φ/2)
    /// ```
    ///
    /// as R φ = t. The right-hand sides have no R and hold at θ = 0 too.
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("bend", "degrees", &[self.degrees])?;
        let along = Along::new("bend", self.axis, self.range, space)?;
        let center = center("bend", self.center, space)?;
        let (towards, sign) = self.towards.map_or((self.axis.next(), 1.0), |t| (t.axis(), t.sign()));
        if towards == self.axis {
            return Err(EditError::Towards { axis: self.axis.name() });
        }
        let (a, b) = (self.axis.index(), towards.index());
        let (theta, up) = (self.degrees.to_radians(), along.length.signum());
        Ok(Box::new(move |_, p| {
            let t = up * (p[a] - along.start);
            let xi = sign * (p[b] - center[b]);
            let phi = theta * along.fraction(p);
            let half = libm::sin(phi / 2.0);
            let mut moved = p;
            moved[a] += up * (t * (sinc(phi) - 1.0) - xi * libm::sin(phi));
            moved[b] += sign * (t * half * sinc(phi / 2.0) - 2.0 * xi * half * half);
            moved
        }))
    }
}

impl Taper {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("taper", "scale", &[self.scale])?;
        let along = Along::new("taper", self.axis, self.range, space)?;
        let center = center("taper", self.center, space)?;
        let (growth, across) = (self.scale - 1.0, DVec3::ONE - self.axis.direction());
        Ok(Box::new(move |_, p| p + (growth * along.fraction(p)) * (p - center) * across))
    }
}

impl Stretch {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("stretch", "scale", &[self.scale])?;
        let center = center("stretch", self.center, space)?;
        let growth = (self.scale - 1.0) * self.axis.direction();
        Ok(Box::new(move |_, p| p + growth * (p - center)))
    }
}

impl Move {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("move", "by", &self.by.to_array())?;
        let by = self.by * self.unit.length(space);
        Ok(Box::new(move |_, p| p + by))
    }

    /// The move without what would change the volume.
    fn slide(&self, controls: &[DVec3], weights: &[f64], space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("slide", "by", &self.by.to_array())?;
        let gradients = space.volume_gradient(controls).ok_or(EditError::NoVolume)?;
        let by = DragPlane::new(controls, weights, &gradients).projected(self.by * self.unit.length(space));
        Ok(Box::new(move |_, p| p + by))
    }
}

impl Rotate {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        check_finite("rotate", "degrees", &[self.degrees])?;
        let axis = match self.axis {
            RotationAxis::Coordinate(axis) => axis.direction(),
            RotationAxis::Vector(vector) => {
                check_finite("rotate", "axis", &vector.to_array())?;
                let longest = vector.abs().max_element();
                if longest == 0.0 {
                    return Err(EditError::NoDirection);
                }
                (vector / longest).normalize() // in two steps: the square of a tiny or huge vector is 0 or infinite
            }
        };
        let center = center("rotate", self.center, space)?;
        let degrees = self.degrees;
        Ok(Box::new(move |_, p| p + turn(p - center, axis, degrees)))
    }
}

impl Scale {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        let factors = match self.by {
            Factors::Uniform(by) => DVec3::splat(by),
            Factors::PerAxis(by) => by,
        };
        check_finite("scale", "by", &factors.to_array())?;
        let center = center("scale", self.center, space)?;
        Ok(Box::new(move |_, p| p + (factors - 1.0) * (p - center)))
    }
}

impl Noise {
    fn law(&self, space: &ControlSpace) -> Result<Law<'_>, EditError> {
        /// The default stream of PCG; any other would do.
        const STREAM: u128 = 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96;
        check_finite("noise", "amplitude", &[self.amplitude])?;
        let amplitude = self.amplitude * self.unit.length(space);
        let mut generator = Pcg64::new(self.seed.into(), STREAM);
        // Without rounding: 53 bits before the subtraction, fewer after it.
        let mut uniform = || ((generator.next_u64() >> 12) as f64 + 0.5) / (1_u64 << 51) as f64 - 1.0;
        let mut draw = || DVec3::from_array([uniform(), uniform(), uniform()]);
        let draws: Vec<DVec3> = (0..space.rest.len()).map(|_| draw()).collect();
        Ok(Box::new(move |c, p| p + amplitude * draws[c]))
    }
}

/// The linear function of position that is 0 and 1 at the ends of a range.
#[derive(Clone, Copy)]
struct Along {
    axis: usize,
    /// Coordinate where it is 0.
    start: f64,
    /// From there to where it is 1; negative if the range runs downwards, never 0.
    length: f64,
}

impl Along {
    fn new(edit: &'static str, axis: Axis, range: Option<[f64; 2]>, space: &ControlSpace) -> Result<Self, EditError> {
        let range = range.unwrap_or([0.0, 1.0]);
        check_finite(edit, "range", &range)?;
        let side = space.bounds.size()[axis.index()];
        let length = (range[1] - range[0]) * side;
        if length == 0.0 {
            return Err(EditError::Range { edit, axis: axis.name(), range, side });
        }
        Ok(Self { axis: axis.index(), start: space.bounds.min[axis.index()] + range[0] * side, length })
    }

    fn fraction(&self, p: DVec3) -> f64 {
        (p[self.axis] - self.start) / self.length
    }
}

impl LengthUnit {
    fn length(self, space: &ControlSpace) -> f64 {
        match self {
            Self::Extent => space.extent,
            Self::Model => 1.0,
        }
    }
}

/// Position of a centre, by default the middle of the lattice box.
fn center(edit: &'static str, center: Option<DVec3>, space: &ControlSpace) -> Result<DVec3, EditError> {
    let Some(center) = center else { return Ok(space.bounds.center()) };
    check_finite(edit, "center", &center.to_array())?;
    Ok(space.position(center))
}

/// By how much `r` moves when it is turned about `axis` (of length 1): Rodrigues' formula, with 1 − cos θ = 2 sin²(θ/2)
/// lest it cancel for small angles.
fn turn(r: DVec3, axis: DVec3, degrees: f64) -> DVec3 {
    let theta = (degrees % 360.0).to_radians(); // the remainder is exact: full turns are the identity
    let half = libm::sin(theta / 2.0);
    let across = axis.cross(r);
    libm::sin(theta) * across + 2.0 * half * half * axis.cross(across)
}

/// sin x / x, continued to 1 at 0.
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(x) / x }
}

fn check_finite(edit: &'static str, key: &'static str, values: &[f64]) -> Result<(), EditError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(EditError::NotFinite { edit, key, value }),
        None => Ok(()),
    }
}

#[cfg(feature = "serde")]
fn model_unit() -> LengthUnit {
    LengthUnit::Model
}

#[cfg(feature = "serde")]
fn extent_unit() -> LengthUnit {
    LengthUnit::Extent
}
