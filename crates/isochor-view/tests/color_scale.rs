//! Colour scales: the published map against its formula, places, ticks.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use isochor_view::{ColorScale, NO_VALUE, Quantity};

/// A colour of Moreland's construction: polar coordinates (M, s, h) in CIELAB, then sRGB. White point D65.
fn from_msh([m, s, h]: [f64; 3]) -> [f64; 3] {
    let (lightness, a, b) = (m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin());
    let y = (lightness + 16.0) / 116.0;
    let cube = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { (t - 16.0 / 116.0) * 3.0 * (6.0f64 / 29.0).powi(2) };
    let [x, y, z] = [0.95047 * cube(y + a / 500.0), cube(y), 1.08883 * cube(y - b / 200.0)];
    let linear = [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ];
    linear.map(|c| 255.0 * if c > 0.003_130_8 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c })
}

#[test]
fn the_diverging_map_is_morelands() {
    // K. Moreland 2009: from (80, 1.08, −1.1) to white (88, 0) and on to (80, 1.08, 0.5); at the white the hue is
    // turned on outwards by s √(M² − m²) / (m sin s), with M = 88, m = 80, so that lightness grows evenly.
    let spin = 1.08 * (88.0f64.powi(2) - 80.0f64.powi(2)).sqrt() / (80.0 * 1.08f64.sin());
    let scale = ColorScale::volume_change(2.0);
    for i in 0..=32 {
        let place = f64::from(i) / 32.0;
        let away = (2.0 * place - 1.0).abs();
        let (end, turn) = if place < 0.5 { (-1.1, -spin) } else { (0.5, spin) };
        let hue = end + turn * (1.0 - away);
        let expected = from_msh([88.0 + (80.0 - 88.0) * away, 1.08 * away, hue]);
        for (have, want) in scale.color_at(place).iter().zip(expected) {
            assert!((f64::from(*have) - want).abs() <= 2.0, "{place}: {:?} {expected:?}", scale.color_at(place));
        }
    }
}

#[test]
fn no_change_is_in_the_middle_and_inverse_changes_are_opposite() {
    for factor in [1.01, 1.5, 2.0, 10.0, 1e5] {
        let scale = ColorScale::volume_change(factor);
        assert_eq!(scale.quantity(), Quantity::VolumeChange);
        assert_eq!(scale.place(1.0), Some(0.5));
        assert_eq!(scale.color(1.0), [221, 221, 221]);
        for c in [1.001, 1.2, 3.0, factor] {
            assert!((scale.place(c).unwrap() + scale.place(1.0 / c).unwrap() - 1.0).abs() < 1e-12);
        }
        assert!((scale.place(factor).unwrap() - 1.0).abs() < 1e-12);
        // Beyond the ends the colours of the ends: blue and red.
        assert_eq!(scale.color(1e-300), [59, 76, 192]);
        assert_eq!(scale.color(1e300), [180, 4, 38]);
    }
    assert_eq!(ColorScale::volume_change(0.5), ColorScale::volume_change(2.0));
}

#[test]
fn what_has_no_place_has_its_own_colour() {
    let scale = ColorScale::volume_change(2.0);
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0] {
        assert_eq!((scale.place(value), scale.color(value)), (None, NO_VALUE), "{value}");
    }
    let scale = ColorScale::displacement(0.3);
    for value in [f64::NAN, f64::INFINITY, -0.1] {
        assert_eq!(scale.color(value), NO_VALUE, "{value}");
    }
    let stress = ColorScale::stress(1.0);
    for value in [f64::NAN, f64::INFINITY, -0.1, FRAC_PI_2.next_up(), PI] {
        assert_eq!((stress.place(value), stress.color(value)), (None, NO_VALUE), "{value}");
    }
    for scale in [ColorScale::volume_change(2.0), scale, stress] {
        assert!((0..=1000).all(|i| scale.color_at(f64::from(i) / 1000.0) != NO_VALUE));
    }
}

#[test]
fn displacements_and_stress_go_from_dark_to_light() {
    for (scale, largest) in [(ColorScale::displacement(0.25), 0.25), (ColorScale::stress(FRAC_PI_4), FRAC_PI_4)] {
        // The ends of viridis.
        assert_eq!(scale.color(0.0), [68, 1, 84]);
        assert_eq!(scale.color(largest), [253, 231, 37]);
        assert_eq!(scale.place(largest / 2.0), Some(0.5));
        let lightness = |i: u32| {
            let [r, g, b] = scale.color_at(f64::from(i) / 50.0).map(|c| (f64::from(c) / 255.0).powf(2.2));
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        assert!((0..50).all(|i| lightness(i) < lightness(i + 1)));
    }
    let stress = ColorScale::stress(FRAC_PI_4);
    assert_eq!(stress.quantity(), Quantity::Stress);
    // Beyond the end, up to what is flat: the colour of the end.
    assert_eq!(stress.color(FRAC_PI_2), [253, 231, 37]);
    // There are no scales beyond a right angle, and none of rounding.
    assert_eq!(ColorScale::stress(PI), ColorScale::stress(FRAC_PI_2));
    assert_eq!(ColorScale::stress(1e-15), ColorScale::stress(0.0));
}

#[test]
fn ticks_are_round_and_where_they_belong() {
    let labels = |scale: ColorScale| scale.ticks().into_iter().map(|tick| tick.label).collect::<Vec<_>>();
    let change = ColorScale::volume_change;
    assert_eq!(labels(change(1.1)), ["−5 %", "0 %", "+5 %", "+10 %"]);
    assert_eq!(labels(change(1.5)), ["−20 %", "0 %", "+20 %", "+40 %"]);
    assert_eq!(labels(change(2.0)), ["−50 %", "0 %", "+50 %", "+100 %"]);
    assert_eq!(labels(change(4.0)), ["−75 %", "−50 %", "0 %", "+100 %", "+300 %"]);
    assert_eq!(labels(change(10.0)), ["−90 %", "0 %", "+900 %"]);
    assert_eq!(labels(change(1.001)), ["−0.05 %", "0 %", "+0.05 %", "+0.1 %"]);
    assert_eq!(labels(ColorScale::displacement(0.3)), ["0 %", "5 %", "10 %", "15 %", "20 %", "25 %", "30 %"]);
    assert_eq!(labels(ColorScale::displacement(0.73)), ["0 %", "20 %", "40 %", "60 %"]);
    let stress = |degrees: f64| labels(ColorScale::stress(degrees.to_radians()));
    assert_eq!(stress(90.0), ["0°", "15°", "30°", "45°", "60°", "75°", "90°"]);
    assert_eq!(stress(61.0), ["0°", "15°", "30°", "45°", "60°"]);
    assert_eq!(stress(60.0), ["0°", "10°", "20°", "30°", "40°", "50°", "60°"]);
    assert_eq!(stress(31.0), ["0°", "5°", "10°", "15°", "20°", "25°", "30°"]);
    assert_eq!(stress(0.0), ["0°", "0.02°", "0.04°", "0.06°", "0.08°", "0.1°"]);
    assert!((ColorScale::stress(61f64.to_radians()).ticks()[2].at - 30.0 / 61.0).abs() < 1e-12);
    let ticks = change(4.0).ticks();
    for (tick, expected) in ticks.iter().zip([0.0, 0.25, 0.5, 0.75, 1.0]) {
        assert!((tick.at - expected).abs() < 1e-12, "{tick:?}");
    }
}

#[test]
fn every_scale_has_ticks_but_not_too_many() {
    for exponent in -400..400 {
        let size = 10f64.powf(f64::from(exponent) / 20.0);
        for scale in [ColorScale::volume_change(1.0 + size), ColorScale::displacement(size), ColorScale::stress(size)] {
            let ticks = scale.ticks();
            assert!((2..=7).contains(&ticks.len()), "{scale:?}: {ticks:?}");
            assert!(ticks.windows(2).all(|pair| pair[0].at < pair[1].at), "{ticks:?}");
            assert!(ticks.iter().all(|tick| (0.0..=1.0).contains(&tick.at)), "{ticks:?}");
        }
    }
}

#[test]
fn scales_of_nothing_are_scales() {
    for size in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for scale in [ColorScale::volume_change(size), ColorScale::displacement(size), ColorScale::stress(size)] {
            assert!(!scale.ticks().is_empty(), "{size}");
        }
    }
}
