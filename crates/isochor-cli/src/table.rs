//! Tables in GitHub's flavour of Markdown, so that they can stand in a document as they are, and numbers in them.

/// A table: the first column is text, the others are numbers.
pub struct Table(String);

impl Table {
    pub fn new(title: &str, columns: &[String]) -> Self {
        let mut table = Self(format!("**{title}**\n\n"));
        table.row(columns);
        table.0 += &format!("|---|{}\n", "--:|".repeat(columns.len() - 1));
        table
    }

    pub fn row(&mut self, cells: &[String]) {
        self.0 += &format!("| {} |\n", cells.join(" | "));
    }

    pub fn into_text(self) -> String {
        self.0
    }
}

pub fn threads(count: usize) -> String {
    format!("{count} thread{}", if count == 1 { "" } else { "s" })
}

/// A measured number: three digits, for more are noise.
pub fn figure(x: f64) -> String {
    const DIGITS: i32 = 3;
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    // After rounding, for 9.999 is 10.0.
    let rounded = format!("{x:.*e}", DIGITS as usize - 1);
    let exponent: i32 = rounded.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or_default();
    match usize::try_from(DIGITS - 1 - exponent) {
        Ok(decimals) => format!("{x:.decimals$}"),
        Err(_) => grouped(x.round() as usize),
    }
}

/// A number as the paper has it.
pub fn stated(x: f64) -> String {
    if x.fract() == 0.0 { grouped(x as usize) } else { x.to_string() }
}

/// A whole number with commas.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_and_whole_numbers_commas() {
        let cases =
            [(0.0, "0"), (0.012_34, "0.0123"), (1.0, "1.00"), (9.999, "10.0"), (99.96, "100"), (1206.4, "1,206")];
        for (x, expected) in cases {
            assert_eq!(figure(x), expected);
        }
        assert_eq!(figure(f64::NAN), "NaN");
        assert_eq!([0.02, 6.0, 1206.0].map(stated), ["0.02", "6", "1,206"]);
        for (n, expected) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_087_716, "1,087,716")] {
            assert_eq!(grouped(n), expected);
        }
    }
}
