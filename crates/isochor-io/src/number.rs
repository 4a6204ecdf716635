//! Numbers as text, and the types that files store them in.

use std::io::Write;

use glam::DVec3;
use isochor::Mesh;

use crate::{ReadError, WriteError};

/// What a file stores coordinates as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NumberType {
    /// 32-bit floats.
    F32,
    /// 64-bit floats.
    F64,
    /// Integers of any width.
    Integer,
}

/// Text outside this range of magnitudes gets an exponent: below it plain digits would be mostly zeros, and above it
/// they would pretend to more digits than a 64-bit float has.
const PLAIN_DIGITS: std::ops::Range<f64> = 1e-5..1e16;

/// Letters of a name or number that a message quotes at most.
const QUOTED: usize = 40;

/// `word` in quotes for a message, shortened where it is long.
pub(crate) fn quoted(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(QUOTED)]);
    format!("'{}{}'", text.escape_debug(), if word.len() > QUOTED { "…" } else { "" })
}

/// The number that `word` spells, correctly rounded to 64 bits; infinities and nan as they are spelled.
pub(crate) fn any(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The finite number that `word` spells, correctly rounded to 64 bits. Numbers too small for 64 bits become 0.
#[inline]
pub(crate) fn finite(word: &[u8]) -> Result<f64, ReadError> {
    match any(word) {
        Some(x) if x.is_finite() => Ok(x),
        other => Err(not_finite(word, other.is_some())),
    }
}

#[cold]
fn not_finite(word: &[u8], is_number: bool) -> ReadError {
    let has = |letters: &[u8]| word.iter().any(|b| letters.contains(b));
    if is_number && has(b"123456789") {
        ReadError::new(format!("{} is beyond 64-bit numbers", quoted(word))).with_hint("write a number up to 1.8e308")
    } else if is_number {
        ReadError::new(format!("{} is not a finite number", quoted(word))).with_hint("repair the coordinate")
    } else {
        let hint = match word {
            _ if has(b",") => "write decimal points, not commas",
            _ if has(b"xX") => "write decimal numbers",
            _ if has(b"dD") && has(b"0123456789") => "write exponents with the letter e",
            _ => "write a decimal number such as -1.5 or 2e-3",
        };
        ReadError::new(format!("{} is not a number", quoted(word))).with_hint(hint)
    }
}

/// The integer that `word` spells. `None` where it spells none, or one beyond 64 bits.
#[inline]
pub(crate) fn integer(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word.split_first()? {
        (b'-', rest) => (true, rest),
        (b'+', rest) => (false, rest),
        _ => (false, word),
    };
    if digits.is_empty() {
        return None;
    }
    let mut value = 0_i64;
    for &b in digits {
        if !b.is_ascii_digit() {
            return None;
        }
        value = value.checked_mul(10)?.checked_add(i64::from(b - b'0'))?;
    }
    Some(if negative { -value } else { value })
}

/// Appends to `text` the fewest digits that read back as `x` in the number type.
pub(crate) fn push_shortest(text: &mut Vec<u8>, x: f64, number: NumberType) {
    let plain = x == 0.0 || PLAIN_DIGITS.contains(&x.abs());
    let x32 = x as f32;
    // Writing to a vector cannot fail.
    let _ = match (number, plain) {
        (NumberType::F32, true) => write!(text, "{x32}"),
        (NumberType::F32, false) => write!(text, "{x32:e}"),
        (_, true) => write!(text, "{x}"),
        (_, false) => write!(text, "{x:e}"),
    };
}

/// How a file stores the three coordinates of a vertex.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Storage {
    /// Types of x, y and z.
    pub(crate) numbers: [NumberType; 3],
    /// Whether they are text. What text means is what it reads as in 64 bits.
    pub(crate) text: bool,
}

/// What a file will hold once `points` (#vertices, and added ones behind) were written over the points of `mesh`.
///
/// A coordinate that rounds to the number that is there keeps it.
pub(crate) fn stored_points(mesh: &Mesh, points: &[DVec3], storage: &Storage) -> Result<Vec<DVec3>, WriteError> {
    let mut digits = Vec::new();
    let mut all = Vec::with_capacity(points.len());
    for (vertex, new) in points.iter().enumerate() {
        let old = mesh.points().get(vertex);
        let mut stored = *new;
        for axis in 0..3 {
            let number = storage.numbers[axis];
            if let Some(old) = old.filter(|old| old[axis] == new[axis]) {
                // The sign of 0 may differ.
                stored[axis] = old[axis];
                continue;
            }
            let value = rounded(new[axis], number, vertex, axis)?;
            stored[axis] =
                if let Some(old) = old.filter(|old| number == NumberType::F32 && value as f32 == old[axis] as f32) {
                    old[axis]
                } else if number == NumberType::F32 && storage.text {
                    digits.clear();
                    push_shortest(&mut digits, value, number);
                    any(&digits).unwrap_or(value)
                } else {
                    value
                };
        }
        all.push(stored);
    }
    Ok(all)
}

/// `value`, the coordinate number `axis` of a vertex, rounded to the number type.
pub(crate) fn rounded(value: f64, number: NumberType, vertex: usize, axis: usize) -> Result<f64, WriteError> {
    let name = ['x', 'y', 'z'][axis];
    match number {
        _ if !value.is_finite() => Err(WriteError::NotFinite { vertex, axis: name, value }),
        NumberType::F64 => Ok(value),
        NumberType::Integer => Err(WriteError::Integer { vertex, axis: name, value }),
        NumberType::F32 if (value as f32).is_infinite() => Err(WriteError::BeyondF32 { vertex, axis: name, value }),
        NumberType::F32 => Ok(f64::from(value as f32)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shortest(x: f64, number: NumberType) -> String {
        let mut text = Vec::new();
        push_shortest(&mut text, x, number);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn shortest_digits_read_back() {
        assert_eq!(shortest(0.1, NumberType::F64), "0.1");
        assert_eq!(shortest(f64::from(0.1_f32), NumberType::F64), "0.10000000149011612");
        assert_eq!(shortest(0.1, NumberType::F32), "0.1");
        assert_eq!(shortest(1e-300, NumberType::F64), "1e-300");
        assert_eq!(shortest(-2.5e20, NumberType::F32), "-2.5e20");
        assert_eq!(shortest(1e15, NumberType::F64), "1000000000000000");
        assert_eq!(shortest(-0.0, NumberType::F64), "-0");
        for x in [f64::MAX, f64::MIN_POSITIVE, 5e-324, -1.0 / 3.0, 1e16, 9_999_999_999_999_998.0] {
            assert_eq!(shortest(x, NumberType::F64).parse::<f64>().unwrap(), x);
        }
    }

    #[test]
    fn legal_but_unusual_numbers() {
        for (word, x) in [("+1.", 1.0), ("1.E+00", 1.0), ("-.0e-3", 0.0), (".5", 0.5), ("1e-400", 0.0), ("00012", 12.0)]
        {
            assert_eq!(finite(word.as_bytes()).unwrap(), x, "{word}");
        }
    }

    #[test]
    fn refused_numbers_are_named_with_advice() {
        for (word, what, advice) in [
            ("nan", "'nan' is not a finite number", "repair"),
            ("-inf", "'-inf' is not a finite number", "repair"),
            ("1e400", "'1e400' is beyond 64-bit numbers", "1.8e308"),
            ("1,0", "'1,0' is not a number", "points"),
            ("1.0D0", "'1.0D0' is not a number", "letter e"),
            ("0x1p3", "'0x1p3' is not a number", "decimal"),
            ("1_000", "'1_000' is not a number", "decimal"),
            ("\0\0", "'\\0\\0' is not a number", "decimal"),
        ] {
            let error = finite(word.as_bytes()).unwrap_err();
            assert_eq!(error.what(), what);
            assert!(error.hint().unwrap().contains(advice), "{word}: {error}");
        }
    }

    #[test]
    fn integers_do_not_wrap() {
        assert_eq!(integer(b"-12"), Some(-12));
        assert_eq!(integer(b"+7"), Some(7));
        assert_eq!(integer(b"9223372036854775807"), Some(i64::MAX));
        for word in ["9223372036854775808", "", "-", "1.0", "0x1", "1 "] {
            assert_eq!(integer(word.as_bytes()), None, "{word}");
        }
    }
}
