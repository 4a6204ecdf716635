//! Numbers as people read them; the page has all their digits in a tooltip.

use maud::{Markup, html};

use crate::number::{NO_CHANGE, with_minus, with_power};

/// Significant digits that are shown. More: columns that nobody reads; fewer: a change of 0.01 % does not show.
const SHOWN: usize = 6;

/// Numbers from here on, and from its inverse down, are written with an exponent: as many digits as fit a column.
const LARGE: f64 = 1e7;

/// `value` in six digits, zeros at the end too, so that columns line up; all digits in the tooltip.
pub fn number(value: f64) -> Markup {
    with_tooltip(value, &six_digits(value))
}

/// `value` in at most six digits; all of them in the tooltip.
pub fn short_number(value: f64) -> Markup {
    with_tooltip(value, &significant(value))
}

/// A relative error, of which only the size matters.
pub fn size(value: f64) -> Markup {
    let text = if value == 0.0 { "0".into() } else { with_power(&format!("{value:.1e}")) };
    with_tooltip(value, &text)
}

/// By how many percent `value` differs from `from`; a dash where there is no answer.
pub fn change(value: f64, from: f64) -> Markup {
    let percent = 100.0 * (value / from - 1.0);
    if percent.is_finite() {
        with_tooltip(percent, &signed_percent(percent))
    } else {
        html! { "–" }
    }
}

/// `percent` with its sign; what is rounding is ±0.
pub fn signed_percent(percent: f64) -> String {
    let text = match percent.abs() {
        size if size <= 100.0 * NO_CHANGE => "±0".into(),
        // Three decimals would show nothing, or too much.
        size if !(0.001..1e5).contains(&size) => with_power(&format!("{percent:+.1e}")),
        _ => with_minus(&format!("{percent:+.3}")),
    };
    text + "\u{202f}%"
}

/// A count with its digits in groups of three.
pub fn count(value: usize) -> Markup {
    let digits = value.to_string();
    let head = digits.len() % 3;
    let groups = digits.as_bytes()[head..].chunks(3).map(|group| String::from_utf8_lossy(group).into_owned());
    let first = (head > 0).then(|| digits[..head].to_string());
    let text = first.into_iter().chain(groups).collect::<Vec<_>>().join("\u{202f}");
    html! { span title=(value) { (text) } }
}

/// `value` in at most six digits, for sentences.
pub fn significant(value: f64) -> String {
    let text = six_digits(value);
    let (digits, power) = text.split_at(text.find('·').unwrap_or(text.len()));
    let digits = if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { digits };
    format!("{digits}{power}")
}

fn six_digits(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return with_minus(&value.to_string());
    }
    if !(1.0 / LARGE..LARGE).contains(&size) {
        return with_power(&format!("{value:.*e}", SHOWN - 1));
    }
    let whole = size.log10().floor() as i32 + 1;
    let places = (SHOWN as i32 - whole).max(0) as usize;
    with_minus(&format!("{value:.places$}"))
}

fn with_tooltip(value: f64, text: &str) -> Markup {
    html! { span title=(format!("{value:?}")) { (text) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_sentences_have_at_most_six_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-2.5, "−2.5"),
            (4.188_790_204_786_391, "4.18879"),
            (123_456.789, "123457"),
            (0.000_123_456_789, "0.000123457"),
            (9_999_999.0, "9999999"),
            (1.5e7, "1.5·10⁷"),
            (-1.234_567_8e-12, "−1.23457·10⁻¹²"),
            (1e300, "1·10³⁰⁰"),
            (f64::NAN, "NaN"),
            (f64::NEG_INFINITY, "−inf"),
        ] {
            assert_eq!(significant(value), text);
        }
    }

    #[test]
    fn tooltips_have_all_digits() {
        let third = 1.0 / 3.0;
        assert_eq!(number(1.0).0, "<span title=\"1.0\">1.00000</span>");
        assert_eq!(number(third).0, "<span title=\"0.3333333333333333\">0.333333</span>");
        assert_eq!(size(2.2e-16).0, "<span title=\"2.2e-16\">2.2·10⁻¹⁶</span>");
        assert_eq!(count(1_234_567).0, "<span title=\"1234567\">1\u{202f}234\u{202f}567</span>");
        assert_eq!(count(12).0, "<span title=\"12\">12</span>");
    }

    #[test]
    fn changes_from_nothing_are_no_numbers() {
        assert_eq!(change(1.0, 0.0).0, "–");
        assert_eq!(change(0.0, 0.0).0, "–");
        assert_eq!(change(1.0 + 2e-16, 1.0).0, "<span title=\"2.220446049250313e-14\">±0\u{202f}%</span>");
        assert_eq!(
            change(1.0 + 2f64.powi(-24), 1.0).0,
            "<span title=\"5.9604644775390625e-6\">+6.0·10⁻⁶\u{202f}%</span>"
        );
        assert_eq!(change(0.5, 1.0).0, "<span title=\"-50.0\">−50.000\u{202f}%</span>");
    }
}
