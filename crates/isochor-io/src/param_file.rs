//! Moves of cage vertices as CageModeler has them: files `*.param`.
//!
//! Numbers between blanks and line breaks: the smallest and the largest factor; how many moves there are; for each of them the index of a cage
//! vertex, from 0, and its displacement x, y, z in model units. At the factor f a vertex at p with the displacement d is posed at p + f d;
//! vertices without a move stay. The program takes as many factors as it is asked for, evenly spaced from the smallest to the largest, and
//! the largest where it is asked for one.
//!
//! Source: `readParams` in `cagedeformations/src/Parametrization.cpp`, and its caller in `app/main.cpp`, of the repository
//! DanStroeter/CageModeler (D. Ströter, Z. Bogdanov, *CageModeler: An Open-Source Project for Cage-Based Deformation*, 2025).
//!
//! Changes versus the source: it takes what is missing or no number as 0, passes over what stands behind the last move, lets the last of
//! several moves of a vertex count, and reaches beyond the cage. Here these are errors. Its factors are 32-bit floats, here all numbers are
//! read as 64-bit ones.

use glam::DVec3;

use crate::ReadError;
use crate::number::{finite, integer, quoted};
use crate::words::{Words, refuse_binary};

/// How the vertices of a cage move, at every factor.
#[derive(Clone, Debug, PartialEq)]
pub struct CageMoves {
    /// The smallest and the largest factor, in this order in the file. One pose is meant at the largest.
    pub factors: [f64; 2],
    /// Displacement of each vertex at the factor 1, #cage vertices, in model units; 0 where it has no move.
    pub displacements: Vec<DVec3>,
}

/// Reads a CageModeler file for a cage of so many vertices.
///
/// # Errors
///
/// What is no number or not finite; a vertex that the cage does not have, or that moves twice; a number of moves that does not fit the text;
/// with their lines.
pub fn cage_moves_from_param(bytes: &[u8], vertices: usize) -> Result<CageMoves, ReadError> {
    refuse_binary(bytes, "param")?;
    let mut numbers = Numbers { bytes, words: Words::plain(bytes, 0, 1) };
    let factors = [numbers.finite("the smallest factor")?, numbers.finite("the largest factor")?];
    let moves = numbers.index("the number of moves")?;
    let mut displacements = vec![DVec3::ZERO; vertices];
    // Lines in which vertices move; 0 where they do not.
    let mut lines = vec![0; vertices];
    for _ in 0..moves {
        let vertex = numbers.index("the vertex of a move")?;
        let line = numbers.words.line();
        let Some(known) = usize::try_from(vertex).ok().filter(|vertex| *vertex < vertices) else {
            let what = format!("a move names vertex {vertex}, but the cage has {vertices} vertices");
            return Err(ReadError::new(what)
                .with_hint("indices start at 0; is it a file for this cage?")
                .at_line(line));
        };
        if lines[known] > 0 {
            let what = format!("vertex {vertex} moves again, first in line {}", lines[known]);
            return Err(ReadError::new(what).with_hint("keep one of both moves").at_line(line));
        }
        lines[known] = line;
        let [x, y, z] = ["x of a move", "y of a move", "z of a move"];
        displacements[known] = DVec3::new(numbers.finite(x)?, numbers.finite(y)?, numbers.finite(z)?);
    }
    if let Some(word) = numbers.words.next() {
        let error = ReadError::new(format!("{} stands behind the last of {moves} moves", quoted(&bytes[word])));
        return Err(error.with_hint("correct the number of moves").at_line(numbers.words.line()));
    }
    Ok(CageMoves { factors, displacements })
}

/// A walk through the numbers of a text.
struct Numbers<'a> {
    bytes: &'a [u8],
    words: Words<'a>,
}

impl<'a> Numbers<'a> {
    fn word(&mut self, what: &str) -> Result<&'a [u8], ReadError> {
        let word = self.words.next().ok_or_else(|| {
            let error = ReadError::new(format!("the text ends where {what} must stand"));
            error.with_hint("the file is cut, or the number of moves is wrong").at_line(self.words.line())
        })?;
        Ok(&self.bytes[word])
    }

    fn finite(&mut self, what: &str) -> Result<f64, ReadError> {
        finite(self.word(what)?).map_err(|error| error.at_line(self.words.line()))
    }

    fn index(&mut self, what: &str) -> Result<u64, ReadError> {
        let word = self.word(what)?;
        integer(word).and_then(|index| u64::try_from(index).ok()).ok_or_else(|| {
            let error = ReadError::new(format!("{} is not {what}", quoted(word)));
            error.with_hint("write a whole number from 0 on").at_line(self.words.line())
        })
    }
}
