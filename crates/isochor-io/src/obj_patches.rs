//! Free-form surfaces of Wavefront OBJ.
//!
//! Read: `v` with weights, `cstype` (`bezier`, `bspline`, with `rat`), `deg`, `surf`, `parm`, `end`. The control points
//! of a `surf` run along u first; u becomes s and v becomes t, each with the domain [0, 1]. Curves and connections are
//! passed over. Other bases and trimmed surfaces are errors: what is left of them would be another surface.

use std::ops::Range;

use glam::DVec3;
use isochor::{Basis, Patch};

use crate::number::{finite, integer, quoted};
use crate::words::Words;
use crate::{Place, ReadError};

/// What `cstype` says.
#[derive(Clone, Copy)]
struct Type {
    rational: bool,
    bezier: bool,
}

/// A surface, read and not yet made.
struct Statement {
    line: usize,
    /// None where another `cstype` was given: its line and name.
    of: Result<Type, (usize, String)>,
    degree: [usize; 2],
    /// s0, s1, t0, t1.
    domain: [f64; 4],
    /// Vertices from 0 (those beyond the file are found out later).
    controls: Vec<u64>,
    /// Numbers after `parm u` and `parm v`.
    parameters: [Vec<f64>; 2],
}

struct Reader<'a> {
    bytes: &'a [u8],
    words: Words<'a>,
    points: Vec<DVec3>,
    weights: Vec<f64>,
    of: Option<Result<Type, (usize, String)>>,
    degree: Option<[usize; 2]>,
    /// The surface between `surf` and `end`.
    open: Option<Statement>,
    /// Whether a curve is between its statement and `end`.
    in_curve: bool,
    surfaces: Vec<Statement>,
}

/// Reads the free-form surfaces of an OBJ file; polygons and other statements are passed over.
///
/// # Errors
///
/// Statements that are incomplete or unsupported, vertices that do not exist, numbers that do not fit together,
/// surfaces without area, with their lines; a file without free-form surfaces.
pub fn patches_from_obj(bytes: &[u8]) -> Result<Vec<Patch>, ReadError> {
    if let Some(offset) = bytes.iter().position(|b| *b == 0) {
        let error = ReadError::new("a NUL byte: the file is binary data, not OBJ text").at(Place::Byte(offset));
        return Err(error.with_hint("export the surface again"));
    }
    let mut words = Words::obj(bytes);
    if bytes.starts_with(b"\xef\xbb\xbf") {
        words.skip(3);
    }
    let (points, weights, surfaces) = (Vec::new(), Vec::new(), Vec::new());
    let mut reader =
        Reader { bytes, words, points, weights, of: None, degree: None, open: None, in_curve: false, surfaces };
    while !reader.words.is_done() {
        let line = reader.words.line();
        reader.read_line().map_err(|error| if error.place().is_some() { error } else { error.at_line(line) })?;
        reader.words.end_line();
    }
    if let Some(open) = &reader.open {
        let error = ReadError::new("`surf` without `end`").with_hint("the file was cut off");
        return Err(error.at_line(open.line));
    }
    if reader.surfaces.is_empty() {
        let error = ReadError::new("no free-form surface: there is no `surf` statement");
        return Err(error.with_hint("export the surface itself, not its polygons"));
    }
    let patch = |surface: &Statement| reader.patch(surface).map_err(|error| error.at_line(surface.line));
    reader.surfaces.iter().map(patch).collect()
}

impl<'a> Reader<'a> {
    fn next(&mut self) -> Option<&'a [u8]> {
        let word: Range<usize> = self.words.next_in_line()?;
        Some(&self.bytes[word])
    }

    /// The numbers up to the end of the line.
    fn numbers(&mut self) -> Result<Vec<f64>, ReadError> {
        let mut numbers = Vec::new();
        while let Some(word) = self.next() {
            numbers.push(finite(word)?);
        }
        Ok(numbers)
    }

    fn read_line(&mut self) -> Result<(), ReadError> {
        let Some(keyword) = self.next() else { return Ok(()) };
        match keyword {
            b"v" => self.read_vertex(),
            b"cstype" => self.read_type(),
            b"deg" => self.read_degree(),
            b"surf" => self.read_surface(),
            b"curv" | b"curv2" => {
                self.in_curve = true;
                Ok(())
            }
            b"parm" => self.read_parameters(),
            b"trim" | b"hole" | b"scrv" | b"sp" if self.open.is_some() => {
                let what = format!("`{}` is not supported: surfaces are whole", String::from_utf8_lossy(keyword));
                Err(ReadError::new(what).with_hint("export the surface untrimmed"))
            }
            b"end" => {
                self.in_curve = false;
                self.surfaces.extend(self.open.take());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn read_vertex(&mut self) -> Result<(), ReadError> {
        let numbers = self.numbers()?;
        let weight = match numbers.len() {
            4 => numbers[3],
            // Nothing, or colours.
            3 | 6 | 7 => 1.0,
            count => {
                let error = ReadError::new(format!("a vertex of {count} numbers"));
                return Err(error.with_hint("write x y z, then nothing, a weight, or a colour"));
            }
        };
        self.points.push(DVec3::from_slice(&numbers));
        self.weights.push(weight);
        Ok(())
    }

    fn read_type(&mut self) -> Result<(), ReadError> {
        let line = self.words.line();
        let (rational, name) = match self.next() {
            Some(b"rat") => (true, self.next()),
            name => (false, name),
        };
        let name =
            name.ok_or_else(|| ReadError::new("`cstype` without a type").with_hint("write bezier or bspline"))?;
        self.of = Some(match name {
            b"bezier" => Ok(Type { rational, bezier: true }),
            b"bspline" => Ok(Type { rational, bezier: false }),
            other => Err((line, quoted(other))),
        });
        Ok(())
    }

    fn read_degree(&mut self) -> Result<(), ReadError> {
        let mut degrees = Vec::new();
        while let Some(word) = self.next() {
            let degree = integer(word).and_then(|degree| usize::try_from(degree).ok());
            degrees.push(degree.ok_or_else(|| {
                ReadError::new(format!("{} is not a degree", quoted(word)))
                    .with_hint("write a whole number of at least 1")
            })?);
        }
        self.degree = match degrees[..] {
            [p, q] => Some([p, q]),
            // A curve's.
            [_] => None,
            _ => {
                let error = ReadError::new(format!("{} degrees", degrees.len()));
                return Err(error.with_hint("a surface has two: `deg 3 3`"));
            }
        };
        Ok(())
    }

    fn read_surface(&mut self) -> Result<(), ReadError> {
        let line = self.words.line();
        if let Some(open) = &self.open {
            let error = ReadError::new("`surf` without `end`").with_hint("end every surface with a line `end`");
            return Err(error.at_line(open.line));
        }
        let missing = |what: &str| {
            ReadError::new(format!("`surf` before {what}"))
                .with_hint("write `cstype bspline` and `deg 3 3` before surfaces")
        };
        let of = self.of.clone().ok_or_else(|| missing("`cstype`"))?;
        let degree = self.degree.ok_or_else(|| missing("`deg` with two degrees"))?;
        let mut domain = [0.0; 4];
        for end in &mut domain {
            let word = self.next().ok_or_else(|| {
                ReadError::new("`surf` without its domain").with_hint("write s0 s1 t0 t1 before the control points")
            })?;
            *end = finite(word)?;
        }
        let mut controls = Vec::new();
        while let Some(word) = self.next() {
            let index = word.split(|b| *b == b'/').next().unwrap_or(word);
            controls.push(match integer(index) {
                Some(index) if index > 0 => index as u64 - 1,
                // Relative: −1 is the last vertex so far.
                Some(index) if index < 0 && index.unsigned_abs() <= self.points.len() as u64 => {
                    self.points.len() as u64 - index.unsigned_abs()
                }
                _ => {
                    let error = ReadError::new(format!("there is no vertex {}", quoted(word)));
                    return Err(error.with_hint("vertices have the numbers from 1 on").at_line(self.words.line()));
                }
            });
        }
        let parameters = [Vec::new(), Vec::new()];
        self.open = Some(Statement { line, of, degree, domain, controls, parameters });
        Ok(())
    }

    fn read_parameters(&mut self) -> Result<(), ReadError> {
        if self.in_curve {
            return Ok(());
        }
        let axis = match self.next() {
            Some(b"u") => 0,
            Some(b"v") => 1,
            _ => return Err(ReadError::new("`parm` of neither u nor v").with_hint("write `parm u 0 1`")),
        };
        let numbers = self.numbers()?;
        match &mut self.open {
            Some(open) => open.parameters[axis] = numbers,
            None => {
                return Err(ReadError::new("`parm` outside a surface").with_hint("write it between `surf` and `end`"));
            }
        }
        Ok(())
    }

    fn patch(&self, surface: &Statement) -> Result<Patch, ReadError> {
        let of = surface.of.as_ref().map_err(|(line, name)| {
            let what = format!("the type {name} of line {line} is not supported");
            ReadError::new(what).with_hint("export the surface as bezier or bspline, with rat for weights")
        })?;
        let [over_s, over_t] = [basis(surface, of, 0)?, basis(surface, of, 1)?];
        let [n, m] = [over_s.size(), over_t.size()];
        if surface.controls.len() != n * m {
            let what = format!("{} control points: `deg` and `parm` make it {n} by {m}", surface.controls.len());
            return Err(ReadError::new(what)
                .with_hint("`parm` has the knots of B-splines, all of them, or the ends of Bezier pieces"));
        }
        let missing = surface.controls.iter().find(|index| **index >= self.points.len() as u64);
        if let Some(index) = missing {
            let error = ReadError::new(format!("there is no vertex {}", index + 1));
            return Err(error.with_hint(format!("vertices have the numbers 1 to {}", self.points.len())));
        }
        // u runs fastest in the file.
        let order = || (0..n * m).map(|k| surface.controls[k % m * n + k / m] as usize);
        let controls = order().map(|v| self.points[v]).collect();
        let weights = of.rational.then(|| order().map(|v| self.weights[v]).collect());
        Patch::new([over_s, over_t], controls, weights).map_err(|error| ReadError::new(error.to_string()))
    }
}

/// The basis along u or v, on knots that are brought to [0, 1].
fn basis(surface: &Statement, of: &Type, axis: usize) -> Result<Basis, ReadError> {
    let (degree, name) = (surface.degree[axis], ["u", "v"][axis]);
    let parameters = &surface.parameters[axis];
    let [low, high] = [surface.domain[2 * axis], surface.domain[2 * axis + 1]];
    let first = if of.bezier { 0 } else { degree };
    let last = parameters.len().checked_sub(first.saturating_add(1));
    let ends = last.filter(|last| *last > first).map(|last| [parameters[first], parameters[last]]);
    let Some([from, to]) = ends else {
        let what = format!("{} numbers after `parm {name}` are too few for degree {degree}", parameters.len());
        return Err(ReadError::new(what).with_hint("write all knots of B-splines, or the ends of Bezier pieces"));
    };
    if [from, to] != [low, high] {
        let what = format!("the domain along {name} is from {low} to {high}, but `parm` makes it {from} to {to}");
        return Err(ReadError::new(what).with_hint("parts of surfaces are not supported: export the whole surface"));
    }
    let normal = |u: &f64| (u - low) / (high - low);
    let knots = if of.bezier {
        let pieces = parameters.len() - 1;
        let size = pieces.saturating_mul(degree).saturating_add(1);
        if size > isochor::MAX_SIZE {
            return Err(ReadError::new(format!("along {name}: {}", isochor::BasisError::TooManyControls { size })));
        }
        // Where two pieces meet their end is repeated as often as the degree; the surface's ends once more.
        let repeated = |(k, u)| std::iter::repeat_n(normal(u), degree + usize::from(k == 0 || k == pieces));
        parameters.iter().enumerate().flat_map(repeated).collect()
    } else {
        parameters.iter().map(normal).collect()
    };
    Basis::with_knots(knots, degree).map_err(|error| ReadError::new(format!("along {name}: {error}")))
}
