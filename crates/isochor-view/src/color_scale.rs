//! From numbers on a model to colours, and the ticks of the scale beside it.
//!
//! A local volume change is a factor: losing half is as much as doubling. So its scale is logarithmic, symmetric about
//! 1, and goes from blue (volume lost) over a neutral grey to red (volume gained): K. Moreland, *Diverging Color Maps
//! for Scientific Visualization*, ISVC 2009, made to be shaded. Displacements and local stress are on viridis by S. van
//! der Walt and N. Smith, whose lightness grows evenly.
//!
//! What is no number, infinite, a volume change that is not positive or a stress of more than a right angle (a piece
//! turned inside out) has no place on a scale and gets [`NO_VALUE`], a colour that no scale holds.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::{image::Rgb, number};

/// The colour of what has no place on a scale.
pub const NO_VALUE: Rgb = [255, 0, 200];

/// Moreland's map from blue to red in 33 colours, as published with the paper; linear between them.
const COOL_WARM: [Rgb; 33] = [
    [59, 76, 192],
    [68, 90, 204],
    [77, 104, 215],
    [87, 117, 225],
    [98, 130, 234],
    [108, 142, 241],
    [119, 154, 247],
    [130, 165, 251],
    [141, 176, 254],
    [152, 185, 255],
    [163, 194, 255],
    [174, 201, 253],
    [184, 208, 249],
    [194, 213, 244],
    [204, 217, 238],
    [213, 219, 230],
    [221, 221, 221],
    [229, 216, 209],
    [236, 211, 197],
    [241, 204, 185],
    [245, 196, 173],
    [247, 187, 160],
    [247, 177, 148],
    [247, 166, 135],
    [244, 154, 123],
    [241, 141, 111],
    [236, 127, 99],
    [229, 112, 88],
    [222, 96, 77],
    [213, 80, 66],
    [203, 62, 56],
    [192, 40, 47],
    [180, 4, 38],
];

/// The narrowest scale of volume changes ends at this factor, the widest at the other. Narrower: rounding is coloured;
/// wider: ticks have no room.
const FACTORS: [f64; 2] = [1.001, 1e6];

/// The narrowest and the widest scale of displacements, in extents.
const DISPLACEMENTS: [f64; 2] = [1e-9, 1e9];

/// The narrowest and the widest scale of local stress, in radians: a tenth of a degree, and what a piece that is flat has.
/// Narrower: rounding is coloured; wider: nothing is there.
const STRESSES: [f64; 2] = [0.1 / 180.0 * PI, FRAC_PI_2];

/// The largest number of ticks. More: labels overlap; fewer: nothing can be read between them.
const TICKS: usize = 7;

/// What is coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Factors by which small pieces changed their volume.
    VolumeChange,
    /// Distances from rest, relative to the extent of the model.
    Displacement,
    /// Local stress: angles by which directions turn at most, in radians, from 0 to π/2; π where a piece is turned
    /// inside out.
    Stress,
}

impl Quantity {
    /// What grows evenly along a scale: the logarithm of a factor, a displacement, an angle. `None` where `value` has no
    /// place on any scale.
    pub(crate) fn even(self, value: f64) -> Option<f64> {
        let even = match self {
            Self::VolumeChange if value > 0.0 => libm::log(value),
            Self::Displacement if value >= 0.0 => value,
            Self::Stress if (0.0..=FRAC_PI_2).contains(&value) => value,
            _ => return None,
        };
        even.is_finite().then_some(even)
    }
}

/// Colours of a range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorScale {
    quantity: Quantity,
    /// Logarithm of the largest factor, largest displacement or angle.
    limit: f64,
}

/// A tick of a scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Its place: 0 at the low end of the scale, 1 at the high end.
    pub at: f64,
    /// Such as "−50 %".
    pub label: String,
}

impl ColorScale {
    /// From 1/`factor` to `factor`, both at an end of the scale. What lies beyond has the colours of the ends.
    #[must_use]
    pub fn volume_change(factor: f64) -> Self {
        let factor = factor.max(1.0 / factor);
        let factor = if factor.is_nan() { FACTORS[0] } else { factor.clamp(FACTORS[0], FACTORS[1]) };
        Self { quantity: Quantity::VolumeChange, limit: libm::log(factor) }
    }

    /// From 0 to `largest`, in extents of the model.
    #[must_use]
    pub fn displacement(largest: f64) -> Self {
        Self::from_nothing(Quantity::Displacement, largest, DISPLACEMENTS)
    }

    /// From 0 to `largest`, in radians.
    #[must_use]
    pub fn stress(largest: f64) -> Self {
        Self::from_nothing(Quantity::Stress, largest, STRESSES)
    }

    /// From 0 to `largest`, within the ends of the narrowest and the widest scale.
    fn from_nothing(quantity: Quantity, largest: f64, [narrowest, widest]: [f64; 2]) -> Self {
        let limit = if largest.is_nan() { narrowest } else { largest.clamp(narrowest, widest) };
        Self { quantity, limit }
    }

    /// What is coloured.
    #[must_use]
    pub fn quantity(&self) -> Quantity {
        self.quantity
    }

    /// Where `value` (a factor, a displacement in extents, an angle in radians) is on the scale: 0 at the low end, 1 at the high end,
    /// beyond where it is beyond. `None` where it has no place.
    #[must_use]
    pub fn place(&self, value: f64) -> Option<f64> {
        let even = self.quantity.even(value)? / self.limit;
        let place = if self.quantity == Quantity::VolumeChange { 0.5 + 0.5 * even } else { even };
        place.is_finite().then_some(place)
    }

    /// The colour of `value`.
    #[must_use]
    pub fn color(&self, value: f64) -> Rgb {
        self.place(value).map_or(NO_VALUE, |place| self.color_at(place))
    }

    /// The colour at a place of the scale; at an end beyond it.
    #[must_use]
    pub fn color_at(&self, place: f64) -> Rgb {
        let place = place.clamp(0.0, 1.0);
        match self.quantity {
            Quantity::VolumeChange => {
                let steps = place * (COOL_WARM.len() - 1) as f64;
                let step = (steps as usize).min(COOL_WARM.len() - 2);
                let (low, high, part) = (COOL_WARM[step], COOL_WARM[step + 1], steps - step as f64);
                let between = |a: u8, b: u8| (f64::from(a) + (f64::from(b) - f64::from(a)) * part).round() as u8;
                std::array::from_fn(|i| between(low[i], high[i]))
            }
            Quantity::Displacement | Quantity::Stress => colorous::VIRIDIS.eval_continuous(place).as_array(),
        }
    }

    /// Ticks at round percentages or degrees, from low to high.
    #[must_use]
    pub fn ticks(&self) -> Vec<Tick> {
        let tick = |round: f64| {
            let (value, label) = match self.quantity {
                Quantity::VolumeChange => (1.0 + round / 100.0, number::signed_percent(round)),
                Quantity::Displacement => (round / 100.0, number::percent(round)),
                // So a right angle comes out as one.
                Quantity::Stress => (round / 180.0 * PI, number::degrees(round)),
            };
            let at = self.place(value)?;
            // Rounding must not take away the tick at an end.
            (-1e-9..=1.0 + 1e-9).contains(&at).then(|| Tick { at: at.clamp(0.0, 1.0), label })
        };
        self.round_values().into_iter().filter_map(tick).collect()
    }

    /// Percentages or degrees with ticks, some of them perhaps beyond the ends.
    fn round_values(&self) -> Vec<f64> {
        let powers = |base: f64| {
            let count = (self.limit / libm::log(base) + 1e-9) as i32;
            let stride = (2 * count as usize + 1).div_ceil(TICKS);
            let exponents = (-count..=count).filter(|k| (k.unsigned_abs() as usize).is_multiple_of(stride));
            exponents.map(|k| (power(base, k) - 1.0) * 100.0).collect()
        };
        match self.quantity {
            Quantity::Displacement => multiples(0.0, self.limit * 100.0),
            // Parts of a right angle; smaller ones in decimal steps.
            Quantity::Stress => match self.limit / PI * 180.0 {
                degrees if degrees > 60.0 * (1.0 + 1e-9) => (0..=6).map(|k| 15.0 * f64::from(k)).collect(),
                degrees => multiples(0.0, degrees),
            },
            Quantity::VolumeChange => match libm::exp(self.limit) * (1.0 + 1e-9) {
                // Equal steps in percent, while they look about equal.
                factor if factor < 2.1 => multiples((1.0 / factor - 1.0) * 100.0, (factor - 1.0) * 100.0),
                factor if factor < 10.0 => powers(2.0),
                _ => powers(10.0),
            },
        }
    }
}

/// The multiples of the smallest round step of which no more than [`TICKS`] are between `low` and `high`.
fn multiples(low: f64, high: f64) -> Vec<f64> {
    let steps = (-12..=12).flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| (digit, decade)));
    for (digit, decade) in steps {
        // Of whole numbers, so that round numbers come out round.
        let of = |k: i64| {
            if decade < 0 { k as f64 * digit / power(10.0, -decade) } else { k as f64 * digit * power(10.0, decade) }
        };
        let [first, last] = [(low / of(1) - 1e-9).ceil(), (high / of(1) + 1e-9).floor()];
        if last - first < TICKS as f64 {
            return (first as i64..=last as i64).map(of).collect();
        }
    }
    Vec::new()
}

/// base^exponent. Negative powers are inverses of positive ones, so that round numbers come out round.
fn power(base: f64, exponent: i32) -> f64 {
    let positive = (0..exponent.unsigned_abs()).fold(1.0, |product, _| product * base);
    if exponent < 0 { 1.0 / positive } else { positive }
}
