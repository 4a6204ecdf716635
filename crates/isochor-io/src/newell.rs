//! The patch format of M. Newell's tea set.
//!
//! The number of patches; for each of them a line with the 16 numbers, from 1, of its control points; the number of
//! points; for each of them a line with its coordinates. Commas or blanks separate numbers. The patches are bicubic
//! Bézier patches; the points of a row of four go along s, the rows along t.

use glam::DVec3;
use isochor::{Basis, Patch};

use crate::ReadError;
use crate::number::{finite, integer, quoted};

/// Control points of a patch.
const CONTROLS: usize = 16;

/// Lines of text that are not blank.
struct Lines<'a> {
    rest: &'a [u8],
    /// Number of the last line, from 1.
    last: usize,
}

impl<'a> Lines<'a> {
    fn of(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, last: 0 }
    }

    /// The fields of the next line that has any, and its number.
    fn next(&mut self) -> Option<(usize, Vec<&'a [u8]>)> {
        while !self.rest.is_empty() {
            let length = self.rest.iter().position(|b| *b == b'\n').unwrap_or(self.rest.len());
            let line = &self.rest[..length];
            self.rest = self.rest.get(length + 1..).unwrap_or_default();
            self.last += 1;
            let is_between = |b: &u8| *b == b',' || b.is_ascii_whitespace();
            let fields: Vec<&[u8]> = line.split(is_between).filter(|field| !field.is_empty()).collect();
            if !fields.is_empty() {
                return Some((self.last, fields));
            }
        }
        None
    }

    /// The fields of the next line, N of them.
    fn fields<const N: usize>(&mut self, what: &str) -> Result<(usize, [&'a [u8]; N]), ReadError> {
        let Some((line, fields)) = self.next() else {
            let error = ReadError::new(format!("the text ends where {what} must stand"));
            return Err(error.with_hint("the file was cut off").at_line(self.last.max(1)));
        };
        match <[&[u8]; N]>::try_from(fields) {
            Ok(fields) => Ok((line, fields)),
            Err(fields) => {
                let what = format!("{} numbers: {what} has {N}", fields.len());
                Err(ReadError::new(what).with_hint("separate numbers by commas").at_line(line))
            }
        }
    }

    /// A count, alone in its line.
    fn count(&mut self, what: &str) -> Result<usize, ReadError> {
        let (line, [word]) = self.fields::<1>(what)?;
        integer(word).and_then(|count| usize::try_from(count).ok()).filter(|count| *count > 0).ok_or_else(|| {
            let error = ReadError::new(format!("{} is not {what}", quoted(word)));
            error.with_hint("write a whole number of at least 1").at_line(line)
        })
    }
}

/// Reads a file of Newell's format.
///
/// # Errors
///
/// Lines of another form, numbers of points that do not exist, patches without area; with their lines.
pub fn patches_from_newell(bytes: &[u8]) -> Result<Vec<Patch>, ReadError> {
    let mut lines = Lines::of(bytes);
    let mut rows = Vec::new();
    for _ in 0..lines.count("the number of patches")? {
        rows.push(lines.fields::<CONTROLS>("a patch")?);
    }
    let mut points = Vec::new();
    for _ in 0..lines.count("the number of points")? {
        let (line, words) = lines.fields::<3>("a point")?;
        let mut point = DVec3::ZERO;
        for (axis, word) in words.into_iter().enumerate() {
            point[axis] = finite(word).map_err(|error| error.at_line(line))?;
        }
        points.push(point);
    }
    if let Some((line, _)) = lines.next() {
        let error = ReadError::new(format!("text after the last of {} points", points.len()));
        return Err(error.with_hint("correct the number of points").at_line(line));
    }
    let patch = |(line, words): &(usize, [&[u8]; CONTROLS])| {
        let point = |word: &&[u8]| {
            let index = integer(word).and_then(|index| usize::try_from(index - 1).ok());
            index.and_then(|index| points.get(index)).copied().ok_or_else(|| {
                let error = ReadError::new(format!("there is no point {}", quoted(word)));
                error.with_hint(format!("points have the numbers 1 to {}", points.len()))
            })
        };
        let read = words.iter().map(point).collect::<Result<Vec<_>, _>>();
        let controls = |read: Vec<DVec3>| (0..CONTROLS).map(|k| read[k % 4 * 4 + k / 4]).collect();
        let bases = || [0; 2].map(|_| Basis::bernstein(4).expect("there are cubic polynomials"));
        read.and_then(|read| {
            Patch::new(bases(), controls(read), None).map_err(|error| ReadError::new(error.to_string()))
        })
        .map_err(|error| error.at_line(*line))
    };
    rows.iter().map(patch).collect()
}
