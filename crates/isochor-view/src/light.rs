//! Light on a surface, and colours in which light can be added up.
//!
//! Lamps turn with the viewer: a key light from the upper left, a fill light from the right, and a sky that is brighter
//! above. Both are broad, so that no part of a model is black. What turns away from the viewer darkens a little, which
//! sets the model off from a white page.
//!
//! Light is proportional to the square of what files hold (sRGB's curve is nearly that): squares and roots round the
//! same on all machines, which powers do not.

use glam::DVec3;

use crate::image::Rgb;

/// Towards the lamps: x to the right, y up, z towards the viewer. Of length 1 to three digits.
const KEY: DVec3 = DVec3::new(-0.43, 0.58, 0.692);
const FILL: DVec3 = DVec3::new(0.76, 0.05, 0.648);

/// Brightness of the lamps and of the sky straight above and below. Their sum on a face towards the key lamp is about
/// 1. Larger: colours wash out; smaller: the model is gloomy.
const KEY_BRIGHTNESS: f64 = 0.62;
const FILL_BRIGHTNESS: f64 = 0.22;
const SKY: f64 = 0.36;
const GROUND: f64 = 0.18;

/// How much of the light is left where the surface turns away. Larger: outlines vanish on a white page; smaller: like a
/// drawing in ink.
const RIM: f64 = 0.62;

/// Strength of the highlight of the key lamp, whose width is that of a cosine to the power of 32. Larger: like plastic;
/// smaller: like chalk.
const HIGHLIGHT: f64 = 0.07;

/// A colour as light: red, green and blue, 0 to 1.
pub(crate) fn light_of(color: Rgb) -> DVec3 {
    DVec3::from_array(color.map(|c| (f64::from(c) / 255.0) * (f64::from(c) / 255.0)))
}

/// Light as a colour; more than 1 is 1.
pub(crate) fn color_of(light: DVec3) -> Rgb {
    light.to_array().map(|x| (x.clamp(0.0, 1.0).sqrt() * 255.0).round() as u8)
}

/// The light from a surface of colour `base`, with the unit `normal` on the side that is seen, towards the unit
/// direction `viewer`. `zenith` is the model's upward direction. All directions: x to the right, y up, z towards the
/// viewer.
pub(crate) fn shaded(base: DVec3, normal: DVec3, viewer: DVec3, zenith: DVec3) -> DVec3 {
    let sky = GROUND + (SKY - GROUND) * (0.5 + 0.5 * normal.dot(zenith));
    // Half the lamp is still seen from where its middle is at the horizon.
    let broad = |lamp: DVec3| {
        let height = ((normal.dot(lamp) + 0.25) / 1.25).max(0.0);
        height * (0.5 + 0.5 * height)
    };
    let facing = normal.dot(viewer).clamp(0.0, 1.0);
    let away = (1.0 - facing) * (1.0 - facing);
    let rim = 1.0 - (1.0 - RIM) * away;
    let half = (KEY + viewer).normalize_or_zero();
    let highlight = HIGHLIGHT * (0..5).fold(normal.dot(half).max(0.0), |power, _| power * power);
    base * ((sky + KEY_BRIGHTNESS * broad(KEY) + FILL_BRIGHTNESS * broad(FILL)) * rim) + highlight
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_come_back() {
        (0..=255).for_each(|c| assert_eq!(color_of(light_of([c, 255 - c, c / 2])), [c, 255 - c, c / 2]));
    }

    #[test]
    fn a_white_face_is_neither_black_nor_blown_out() {
        let directions = (0..400).map(|i| {
            // A spiral over the half of the sphere that is seen.
            let z = (f64::from(i) + 0.5) / 400.0;
            let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cos, r * sin, z)
        });
        for normal in directions {
            let light = shaded(DVec3::splat(0.8), normal, DVec3::Z, DVec3::Y).x;
            assert!((0.08..=1.0).contains(&light), "{normal}: {light}");
        }
    }
}
