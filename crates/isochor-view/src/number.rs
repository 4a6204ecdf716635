//! Numbers as captions show them: few digits, a true minus sign, powers of ten where there would be many zeros.

/// Digits of a volume. More: nobody reads them; fewer: poses look alike.
const DIGITS: usize = 4;

/// A relative change below this is rounding, and shows as none.
pub(crate) const NO_CHANGE: f64 = 1e-12;

/// `value` with four digits that count, such as "0.04175" or "1.235·10⁶".
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return with_minus(&value.to_string());
    }
    let scientific = format!("{value:.*e}", DIGITS - 1);
    match exponent(&scientific) {
        exponent @ -3..=5 => {
            with_minus(&format!("{value:.*}", usize::try_from(DIGITS as i32 - 1 - exponent).unwrap_or(0)))
        }
        _ => with_power(&scientific),
    }
}

/// The change from `reference` to `value` in percent, such as "−39.16 %"; "±0 %" where it is rounding. `None` where it
/// cannot be said.
pub(crate) fn change(value: f64, reference: f64) -> Option<String> {
    let change = (value - reference) / reference.abs();
    match change.abs() {
        c if !c.is_finite() => None,
        c if c <= NO_CHANGE => Some("±0 %".into()),
        // Two decimals would show nothing.
        c if !(5e-5..1e4).contains(&c) => Some(with_power(&format!("{:+.1e}", change * 100.0)) + " %"),
        _ => Some(with_minus(&format!("{:+.2} %", change * 100.0))),
    }
}

/// A percentage without needless digits: "12.5 %".
pub(crate) fn percent(percent: f64) -> String {
    format!("{} %", plain(percent))
}

/// The same with its sign, "+12.5 %", unless it is 0.
pub(crate) fn signed_percent(percent: f64) -> String {
    if percent > 0.0 { format!("+{} %", plain(percent)) } else { format!("{} %", plain(percent)) }
}

/// An angle: "12.5°".
pub(crate) fn degrees(degrees: f64) -> String {
    format!("{}°", plain(degrees))
}

/// Up to six digits, no zeros behind them.
fn plain(value: f64) -> String {
    let scientific = format!("{value:e}");
    let exponent = exponent(&scientific);
    if !(-6..=6).contains(&exponent) {
        return with_power(&scientific);
    }
    let decimals = usize::try_from(5 - exponent).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text };
    if text == "-0" { "0".into() } else { with_minus(&text) }
}

/// The power of ten of a number in scientific notation; 0 of what is none.
fn exponent(scientific: &str) -> i32 {
    scientific.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0)
}

/// `1.5e-3` as 1.5·10⁻³; other texts with a minus as long as a plus.
pub(crate) fn with_power(text: &str) -> String {
    let Some((digits, exponent)) = text.split_once('e') else { return with_minus(text) };
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => digit.to_digit(10).and_then(|digit| char::from_u32(0x2070 + digit)).unwrap_or(digit),
    };
    format!("{}·10{}", with_minus(digits), exponent.chars().map(raised).collect::<String>())
}

/// With a minus as long as a plus.
pub(crate) fn with_minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volumes_have_four_digits() {
        for (value, text) in [
            (0.041_750_498_989, "0.04175"),
            (0.068_618_693_872, "0.06862"),
            (1.0, "1.000"),
            (-12.345_6, "−12.35"),
            (123_456.0, "123456"),
            (1_234_567.0, "1.235·10⁶"),
            (1.5e-7, "1.500·10⁻⁷"),
            (9.999_99, "10.00"),
            (0.0, "0"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "−inf"),
            (1e300, "1.000·10³⁰⁰"),
        ] {
            assert_eq!(short(value), text, "{value}");
        }
    }

    #[test]
    fn changes_are_percentages() {
        let text = |value: f64| change(value, 0.5).unwrap();
        assert_eq!(text(0.25), "−50.00 %");
        assert_eq!(text(0.75), "+50.00 %");
        assert_eq!(text(0.5), "±0 %");
        assert_eq!(text(0.5 * (1.0 + 2.5e-13)), "±0 %");
        assert_eq!(text(0.5 * (1.0 - 1e-7)), "−1.0·10⁻⁵ %");
        assert_eq!(change(-0.25, -0.5).unwrap(), "+50.00 %");
        for (value, reference) in [(1.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert_eq!(change(value, reference), None);
        }
    }

    #[test]
    fn percentages_have_no_needless_digits() {
        for (value, text) in
            [(0.0, "0 %"), (12.5, "+12.5 %"), (-50.0, "−50 %"), (100.0, "+100 %"), (-99.99, "−99.99 %")]
        {
            assert_eq!(signed_percent(value), text);
        }
        assert_eq!(percent(0.05), "0.05 %");
        assert_eq!(percent(2e-8), "2·10⁻⁸ %");
        assert_eq!((degrees(0.02), degrees(30.0)), ("0.02°".into(), "30°".into()));
    }
}
