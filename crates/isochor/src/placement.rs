//! Where a model lies on a sheet: a similarity from the model's space to the sheet's.
//!
//! The sheet's space has coordinates (x, y, h): a place in the plane of the flattened grid, and a height over it. With c the middle of the
//! model's box, U the quarter or half turn that brings `up` to h, R the turn by `rotate` about h and k the factor,
//!
//! ```text
//! q = k R U (p − c) + (x₀, y₀, h₀),
//! ```
//!
//! where (x₀, y₀) is `at` in fractions of the box of the flattened grid, and h₀ is such that the base of the model has the height `height`.
//! U is (x, −z, y) for `up` = y, (−z, y, x) for x, (x, z, −y), (z, y, −x) and (x, −y, −z) for −y, −x and −z: nothing is mirrored.
//!
//! CO (B.-Y. Chen and others' free-form deformation along a parametric surface), section 3.2, projects the model on the sheet where its user put it; section
//! 5 moves the sheet to the middle of the model.

use glam::{DMat3, DVec2, DVec3};

use crate::edit::SignedAxis;
use crate::mesh::Bounds;
use crate::sheet::Sheet;

/// Where a model lies on a sheet.
///
/// ```toml
/// [surface]
/// place = { at = [0.5, 0.5], rotate = 30, scale = 1, height = 0, up = "z", fit = "none", outside = "refuse" }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default, deny_unknown_fields))]
pub struct Placement {
    /// Where the middle of the model's box goes, in fractions of the box of the flattened grid.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::exact::array"))]
    pub at: [f64; 2],
    /// Turn about the sheet's normal, degrees; from x towards y of the sheet.
    pub rotate: f64,
    /// Factor, more than 0; times the one that `fit` finds.
    pub scale: f64,
    /// Height of the model's base over the sheet.
    pub height: Height,
    /// The model's axis that points away from the sheet.
    pub up: SignedAxis,
    /// How large the model becomes.
    pub fit: SheetFit,
    /// What happens to what is beyond the sheet.
    pub outside: Beyond,
}

impl Default for Placement {
    /// In the middle, standing on the sheet, as large as it is, z up.
    fn default() -> Self {
        Self {
            at: [0.5; 2],
            rotate: 0.0,
            scale: 1.0,
            height: Height::default(),
            up: SignedAxis::Z,
            fit: SheetFit::default(),
            outside: Beyond::default(),
        }
    }
}

/// How high a model stands over its sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(untagged, expecting = "`height` must be a number or \"middle\"")
)]
pub enum Height {
    /// The base of the model at this height, in the surface's length unit.
    Base(f64),
    /// As a word.
    Word(HeightWord),
}

impl Default for Height {
    fn default() -> Self {
        Self::Base(0.0)
    }
}

/// A height that follows from the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum HeightWord {
    /// The sheet in the middle of the model: half of it above, half below. Distorts thick models least.
    Middle,
}

/// How large a model becomes on a sheet: the largest factor with which the box round its turned box fits the box of the flattened grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum SheetFit {
    /// As large as it is.
    #[default]
    None,
    /// As wide as the sheet, along x.
    Width,
    /// As high as the sheet, along y.
    Height,
    /// The smaller of both.
    Inside,
}

/// What happens to vertices beyond the boundary of a sheet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "lowercase"))]
pub enum Beyond {
    /// They are an error.
    #[default]
    Refuse,
    /// They go on along the boundary's tangents.
    Extend,
}

/// Why a model cannot be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// A number is infinite or none.
    #[error("place.{key} is {value}: it must be finite")]
    NotFinite {
        /// The key.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// A factor that is 0 or mirrors.
    #[error("place.scale is {scale}: it must be more than 0")]
    Scale {
        /// The factor.
        scale: f64,
    },
    /// A model without size along what is to fit.
    #[error(
        "place.fit: the turned model is {} × {} on a sheet of {} × {}, so there is no factor; give place.scale with fit = \"none\"",
        .model.x, .model.y, .sheet.x, .sheet.y
    )]
    NothingToFit {
        /// Sides of the box round the turned model, in its own unit.
        model: DVec2,
        /// Sides of the box of the flattened grid.
        sheet: DVec2,
    },
    /// The result is beyond the range of numbers.
    #[error("the placed model is {extent:e} large: place.scale is too large or too small for it")]
    Extent {
        /// Its longest side.
        extent: f64,
    },
}

/// A placement of one model on one sheet: the similarity q = M (p − c) + o.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    matrix: DMat3,
    center: DVec3,
    origin: DVec3,
    scale: f64,
}

impl Placement {
    /// The placement of a model with the box `bounds` on `sheet`.
    ///
    /// # Errors
    ///
    /// Numbers that are not finite; a factor that is not positive; nothing to fit; a result that is beyond all numbers.
    pub fn placed(&self, bounds: Bounds, sheet: &Sheet) -> Result<Placed, PlacementError> {
        self.check()?;
        let upright = upright(self.up);
        let turn = turn(self.rotate) * upright;
        let half = bounds.size() / 2.0;
        let flat = Bounds::of(&sheet.flat().iter().map(|x| x.extend(0.0)).collect::<Vec<_>>());
        let flat = flat.expect("a sheet has grid points");
        let scale = self.scale * self.fitting(reach(turn, half), flat.size().truncate())?;
        let size = 2.0 * scale * bounds.extent();
        if !(size.is_finite() && (size > 0.0 || bounds.extent() == 0.0)) {
            return Err(PlacementError::Extent { extent: size / 2.0 });
        }
        let h = match self.height {
            Height::Base(base) => base + scale * reach(upright, half).z,
            Height::Word(HeightWord::Middle) => 0.0,
        };
        let origin = DVec3::new(flat.min.x + self.at[0] * flat.size().x, flat.min.y + self.at[1] * flat.size().y, h);
        Ok(Placed { matrix: turn * scale, center: bounds.center(), origin, scale })
    }

    fn check(&self) -> Result<(), PlacementError> {
        let base = match self.height {
            Height::Base(base) => base,
            Height::Word(_) => 0.0,
        };
        let numbers =
            [("at", self.at[0]), ("at", self.at[1]), ("rotate", self.rotate), ("scale", self.scale), ("height", base)];
        if let Some(&(key, value)) = numbers.iter().find(|(_, value)| !value.is_finite()) {
            return Err(PlacementError::NotFinite { key, value });
        }
        if self.scale <= 0.0 {
            return Err(PlacementError::Scale { scale: self.scale });
        }
        Ok(())
    }

    /// The factor of `fit` for a turned box with the half sides `half` on a sheet with the sides `sheet`.
    fn fitting(&self, half: DVec3, sheet: DVec2) -> Result<f64, PlacementError> {
        let model = 2.0 * half.truncate();
        let [x, y] = (sheet / model).to_array(); // infinite along an axis that the model does not fill
        let factor = match self.fit {
            SheetFit::None => return Ok(1.0),
            SheetFit::Width => x,
            SheetFit::Height => y,
            SheetFit::Inside => f64::min(x, y),
        };
        if factor.is_finite() && factor > 0.0 { Ok(factor) } else { Err(PlacementError::NothingToFit { model, sheet }) }
    }
}

impl Placed {
    /// The place of the model's point p on the sheet: (x, y, h).
    #[must_use]
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.matrix * (p - self.center) + self.origin
    }

    /// The places of all `points` (#vertices × 3).
    #[must_use]
    pub fn points(&self, points: &[DVec3]) -> Vec<DVec3> {
        crate::parallel::collect(points.len(), |v| self.point(points[v]))
    }

    /// M = ∂q/∂p: a turn times the factor.
    #[must_use]
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }

    /// The factor k.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

/// Half the sides of the box round a turned box with the half sides `half`.
fn reach(turn: DMat3, half: DVec3) -> DVec3 {
    DMat3::from_cols(turn.x_axis.abs(), turn.y_axis.abs(), turn.z_axis.abs()) * half
}

/// The turn by quarters that brings `up` to z.
fn upright(up: SignedAxis) -> DMat3 {
    use DVec3 as V;
    let rows = match up {
        SignedAxis::Z => [V::X, V::Y, V::Z],
        SignedAxis::MinusZ => [V::X, V::NEG_Y, V::NEG_Z],
        SignedAxis::Y => [V::X, V::NEG_Z, V::Y],
        SignedAxis::MinusY => [V::X, V::Z, V::NEG_Y],
        SignedAxis::X => [V::NEG_Z, V::Y, V::X],
        SignedAxis::MinusX => [V::Z, V::Y, V::NEG_X],
    };
    DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
}

/// The turn about z by `degrees`, without rounding at quarters.
fn turn(degrees: f64) -> DMat3 {
    let rest = degrees % 360.0;
    let quarters = (rest / 90.0).round();
    let (sin, cos) = libm::sincos((rest - 90.0 * quarters).to_radians());
    let (sin, cos) = match quarters.rem_euclid(4.0) as u8 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    };
    DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z)
}
