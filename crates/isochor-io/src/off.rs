//! OFF, Geomview's object file format.
//!
//! A keyword `[ST][C][N][4][n]OFF`, which may be missing; the dimension, for `n`; a line with the numbers of vertices, faces and edges; for
//! each vertex a line with its position and, where the keyword announces them, a weight (`4`), a normal (`N`), a colour of 3 or 4 numbers
//! (`C`) and a texture coordinate (`ST`), in this order; for each face the number of its corners and their indices from 0, over as many lines
//! as one likes, and behind the last, in its line, a colour. `#` begins a comment.
//!
//! Read: positions, normals and corners. All else is kept. Three dimensions and weights of 1 are read; others, which would make the position
//! a quotient or a projection, are refused, and so are binary files.
//!
//! The manual puts `C` before `N` in the keyword and normals before colours in the lines. Programs that write `NC` put colours first, so
//! normals behind such a keyword are kept as they are.

use std::ops::Range;

use glam::{DMat3, DVec3};
use isochor::{Faces, Mesh};

use crate::document::{Change, Parsed};
use crate::normal::carried_direction;
use crate::number::{finite, integer, push_shortest, quoted};
use crate::obj::{count, replace_changed};
use crate::splice::Splice;
use crate::words::{Words, refuse_binary};
use crate::{NumberType, ReadError};

/// Fewest bytes of a vertex, `0 0 0` and a line break, and of a face, `0` and a line break.
const LEAST_VERTEX: u64 = 6;
const LEAST_FACE: u64 = 2;

/// Most numbers of a colour behind the corners of a face.
const FACE_COLOUR: usize = 4;

/// What the keyword announces.
#[derive(Clone, Copy, Debug, Default)]
struct Keyword {
    has_dimension: bool,
    has_weights: bool,
    has_normals: bool,
    has_colours: bool,
    has_textures: bool,
    /// Whether `N` stands before `C`.
    is_normal_first: bool,
}

impl Keyword {
    /// The keyword that `word` begins with, and its length.
    fn of(word: &[u8]) -> Option<(Self, usize)> {
        let (mut keyword, mut rest) = (Self::default(), word);
        loop {
            let (seen, length) = match rest {
                [b'O', b'F', b'F', ..] => return Some((keyword, word.len() - rest.len() + 3)),
                [b'S', b'T', ..] => (&mut keyword.has_textures, 2),
                [b'C', ..] => {
                    keyword.is_normal_first = keyword.has_normals;
                    (&mut keyword.has_colours, 1)
                }
                [b'N', ..] => (&mut keyword.has_normals, 1),
                [b'4', ..] => (&mut keyword.has_weights, 1),
                [b'n', ..] => (&mut keyword.has_dimension, 1),
                _ => return None,
            };
            if std::mem::replace(seen, true) {
                return None;
            }
            rest = &rest[length..];
        }
    }
}

/// Whether `bytes` begin with a keyword of OFF.
pub(crate) fn looks_like(bytes: &[u8]) -> bool {
    words(bytes).next().is_some_and(|word| Keyword::of(&bytes[word]).is_some())
}

/// The words of `bytes`, without a UTF-8 byte order mark.
fn words(bytes: &[u8]) -> Words<'_> {
    Words::commented(bytes, if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 }, 1)
}

/// Where things stand in an OFF file.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    keyword: Keyword,
    /// The numbers of vertices, faces and edges.
    pub(crate) counts: [u64; 3],
    /// Where they stand.
    pub(crate) count_words: [Range<usize>; 3],
    /// Where the lines of the vertices begin: an offset, and a line.
    vertices: (usize, usize),
    /// Where the faces begin.
    faces: (usize, usize),
}

/// Where the numbers of a vertex stand in the words of its line.
pub(crate) struct Columns {
    /// The normal, where there is one to carry.
    pub(crate) normal: Option<usize>,
    /// The colour, empty where there is none.
    pub(crate) colour: Range<usize>,
    /// Whether it is known what stands behind the position.
    pub(crate) are_known: bool,
}

/// Where a face stands.
pub(crate) struct FaceSpans {
    /// From its number of corners to its last corner.
    pub(crate) corners: Range<usize>,
    /// From there to the last word of the line: a colour.
    pub(crate) colour: Range<usize>,
    /// Number of words of the colour.
    numbers: usize,
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Parsed<Layout>, ReadError> {
    let mut layout = Layout::of_header(bytes)?;
    let mut words = layout.words_at(bytes, layout.vertices);
    let mut warnings = Vec::new();
    if layout.keyword.is_normal_first {
        warnings.push("Normals and colours in an order on which programs differ, kept as they are.".to_owned());
    }
    let points = layout.read_points(bytes, &mut words, &mut warnings)?;
    layout.faces = (words.at(), words.line());
    let faces = layout.read_faces(bytes, &mut words, &mut warnings)?;
    if let Some(word) = words.next() {
        let count = layout.counts[1];
        return Err(ReadError::new(format!("{} stands behind the last of {count} faces", quoted(&bytes[word])))
            .with_hint("a count at the start of the file is wrong")
            .at_line(words.line()));
    }
    let mesh = Mesh::new(points, faces).map_err(|error| ReadError::new(error.to_string()))?;
    Ok(Parsed { mesh, layout, warnings })
}

impl Layout {
    fn of_header(bytes: &[u8]) -> Result<Self, ReadError> {
        let mut words = words(bytes);
        let first = words.next().unwrap_or_default();
        let (keyword, length) = match Keyword::of(&bytes[first.clone()]) {
            Some(found) => found,
            // Without a keyword the counts come first.
            None if integer(&bytes[first.clone()]).is_some() => Default::default(),
            None => {
                refuse_binary(bytes, "OFF")?;
                return Err(ReadError::new(format!("{} is no keyword of OFF", quoted(&bytes[first])))
                    .with_hint("the first word is OFF, maybe with ST, C, N, 4 and n before it")
                    .at_line(words.line()));
            }
        };
        // The first count may be glued to the keyword.
        let mut next = Some(first.start + length..first.end).filter(|rest| !rest.is_empty());
        if next.is_none() {
            next = words.next();
        }
        if next.clone().is_some_and(|word| bytes[word].eq_ignore_ascii_case(b"BINARY")) {
            return Err(ReadError::new("a binary OFF file, which cannot be read")
                .with_hint("export it as text, or as binary PLY")
                .at_line(words.line()));
        }
        refuse_binary(bytes, "OFF")?;
        if keyword.has_dimension {
            let word = next.map(|word| &bytes[word]).unwrap_or_default();
            if integer(word) != Some(3) {
                return Err(ReadError::new(format!("points of {} dimensions", quoted(word)))
                    .with_hint("only points of 3 dimensions can be read")
                    .at_line(words.line()));
            }
            next = words.next();
        }
        let line = words.line();
        let [second, third, surplus] = std::array::from_fn(|_| words.next_in_line());
        let (Some(first), Some(second), Some(third), None) = (next, second, third, surplus) else {
            return Err(ReadError::new("the numbers of vertices, faces and edges are not three numbers in a line")
                .with_hint("write all three; that of edges may be 0")
                .at_line(line));
        };
        let count_words = [first, second, third];
        let mut counts = [0; 3];
        for ((count, word), thing) in counts.iter_mut().zip(&count_words).zip(["vertices", "faces", "edges"]) {
            let word = &bytes[word.clone()];
            *count = integer(word).and_then(|count| u64::try_from(count).ok()).ok_or_else(|| {
                ReadError::new(format!("{} is no number of {thing}", quoted(word)))
                    .with_hint("write a whole number from 0 on")
                    .at_line(line)
            })?;
        }
        words.end_line();
        let left = (bytes.len() - words.at()) as u64;
        let size = |count: u64, least: u64| count.saturating_mul(least);
        // The last line may lack its end.
        if size(counts[0], LEAST_VERTEX).saturating_add(size(counts[1], LEAST_FACE)) > left + 1 {
            let [vertices, faces, _] = counts;
            let what = format!("{vertices} vertices and {faces} faces are announced, but only {left} bytes are left");
            return Err(ReadError::new(what).with_hint("the file is cut, or a count is wrong").at_line(line));
        }
        if u32::try_from(counts[0]).is_err() {
            let what = format!("{} vertices are announced, more than 4294967295", counts[0]);
            return Err(ReadError::new(what).with_hint("split the model").at_line(line));
        }
        let vertices = (words.at(), words.line());
        Ok(Self { keyword, counts, count_words, vertices, faces: vertices })
    }

    fn words_at<'a>(&self, bytes: &'a [u8], (at, line): (usize, usize)) -> Words<'a> {
        Words::commented(bytes, at, line)
    }

    /// A walk through the lines of the vertices.
    pub(crate) fn vertex_words<'a>(&self, bytes: &'a [u8]) -> Words<'a> {
        self.words_at(bytes, self.vertices)
    }

    /// A walk through the faces.
    pub(crate) fn face_words<'a>(&self, bytes: &'a [u8]) -> Words<'a> {
        self.words_at(bytes, self.faces)
    }

    pub(crate) fn faces_in_file(&self) -> usize {
        self.counts[1] as usize
    }

    pub(crate) fn has_normals(&self) -> bool {
        self.keyword.has_normals && !self.keyword.is_normal_first
    }

    /// Number of words before the normal.
    fn position_words(&self) -> usize {
        3 + usize::from(self.keyword.has_weights)
    }

    /// Number of words in the line of a vertex, less those of a colour.
    fn plain_words(&self) -> usize {
        self.position_words() + 3 * usize::from(self.keyword.has_normals) + 2 * usize::from(self.keyword.has_textures)
    }

    /// Where the numbers of a vertex stand, whose line has so many words.
    pub(crate) fn columns(&self, words: usize) -> Columns {
        let normal = self.has_normals().then(|| self.position_words());
        let colour = self.position_words() + 3 * usize::from(self.keyword.has_normals);
        let colour = colour..colour + words.saturating_sub(self.plain_words());
        let are_known = !self.keyword.is_normal_first && (self.keyword.has_colours || colour.is_empty());
        Columns { normal, colour, are_known }
    }

    fn read_points(
        &self,
        bytes: &[u8],
        words: &mut Words,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<DVec3>, ReadError> {
        let mut points = Vec::with_capacity(self.counts[0] as usize);
        let mut row = Vec::new();
        let mut surplus = (0, 0);
        for _ in 0..self.counts[0] {
            if !next_row(words, &mut row) {
                let what = format!("the text ends before the last of {} vertices", self.counts[0]);
                return Err(ReadError::new(what)
                    .with_hint("the file is cut, or the number of vertices is wrong")
                    .at_line(words.line()));
            }
            let line = words.line();
            let more = row.len().checked_sub(self.plain_words());
            match (more, self.keyword.has_colours) {
                (Some(0), false) | (Some(3 | 4), true) => {}
                (Some(3 | 4), false) => count(&mut surplus, line),
                _ => return Err(self.row_error(row.len()).at_line(line)),
            }
            let mut point = DVec3::ZERO;
            for (axis, word) in row[..3].iter().enumerate() {
                point[axis] = finite(&bytes[word.clone()]).map_err(|error| error.at_line(line))?;
            }
            if self.keyword.has_weights {
                let word = &bytes[row[3].clone()];
                if finite(word).map_err(|error| error.at_line(line))? != 1.0 {
                    return Err(ReadError::new(format!("a vertex with the weight {}, not 1", quoted(word)))
                        .with_hint("divide x, y and z by it, and write 1")
                        .at_line(line));
                }
            }
            points.push(point);
        }
        if surplus.0 > 0 {
            let (n, line) = surplus;
            warnings.push(format!(
                "Vertices with 3 or 4 numbers more than the keyword announces, kept as they are: {n}, the first in line {line}."
            ));
        }
        Ok(points)
    }

    fn row_error(&self, words: usize) -> ReadError {
        let (least, colour) = (self.plain_words(), self.keyword.has_colours);
        let due = if colour { format!("{} or {}", least + 3, least + 4) } else { least.to_string() };
        ReadError::new(format!("a vertex of {words} numbers"))
            .with_hint(format!("a vertex is a line of {due} numbers; a count at the start of the file may be wrong"))
    }

    fn read_faces(&self, bytes: &[u8], words: &mut Words, warnings: &mut Vec<String>) -> Result<Faces, ReadError> {
        let announced = self.faces_in_file();
        // Three corners for each face; not more than there are bytes.
        let mut faces = Faces::with_capacity(announced, announced.saturating_mul(3).min(bytes.len()));
        let mut corners = Vec::new();
        let (mut skipped, mut surplus) = ((0, 0), (0, 0));
        for _ in 0..announced {
            let spans = self.next_face(bytes, words, &mut corners)?;
            let line = words.line();
            if spans.numbers > FACE_COLOUR {
                count(&mut surplus, line);
            }
            if corners.len() < 3 {
                count(&mut skipped, line);
                continue;
            }
            if faces.corners().len() + corners.len() > u32::MAX as usize {
                let error = ReadError::new("more than 4294967295 corners");
                return Err(error.with_hint("split the model").at_line(line));
            }
            faces.push(&corners);
        }
        let tallies = [
            (skipped, "Faces of fewer than 3 corners that are not read"),
            (surplus, "Faces with more numbers behind their corners than a colour has, kept as they are"),
        ];
        let tallies = tallies.iter().filter(|((n, _), _)| *n > 0);
        warnings.extend(tallies.map(|((n, line), what)| format!("{what}: {n}, the first in line {line}.")));
        Ok(faces)
    }

    /// Steps over the next face, and puts its corners in place of what `corners` held.
    pub(crate) fn next_face(
        &self,
        bytes: &[u8],
        words: &mut Words,
        corners: &mut Vec<u32>,
    ) -> Result<FaceSpans, ReadError> {
        corners.clear();
        let cut = |words: &Words| {
            ReadError::new(format!("the text ends before the last of {} faces", self.counts[1]))
                .with_hint("the file is cut, or the number of faces is wrong")
                .at_line(words.line())
        };
        let first = words.next().ok_or_else(|| cut(words))?;
        let due = integer(&bytes[first.clone()]).and_then(|due| usize::try_from(due).ok()).ok_or_else(|| {
            ReadError::new(format!("{} is no number of corners", quoted(&bytes[first.clone()])))
                .with_hint(
                    "a face begins with the number of its corners; a count at the start of the file may be wrong",
                )
                .at_line(words.line())
        })?;
        let left = bytes.len() - words.at();
        // A blank and a digit each.
        if due > left / 2 {
            return Err(ReadError::new(format!("a face of {due} corners, but only {left} bytes are left"))
                .with_hint("the file is cut, or the number of corners is wrong")
                .at_line(words.line()));
        }
        let mut end = first.end;
        for _ in 0..due {
            let word = words.next().ok_or_else(|| cut(words))?;
            corners.push(self.corner(&bytes[word.clone()]).map_err(|error| error.at_line(words.line()))?);
            end = word.end;
        }
        let (mut last, mut numbers) = (end, 0);
        while let Some(word) = words.next_in_line() {
            (last, numbers) = (word.end, numbers + 1);
        }
        Ok(FaceSpans { corners: first.start..end, colour: end..last, numbers })
    }

    fn corner(&self, word: &[u8]) -> Result<u32, ReadError> {
        let vertices = self.counts[0];
        match integer(word) {
            Some(index) => u32::try_from(index).ok().filter(|vertex| u64::from(*vertex) < vertices).ok_or_else(|| {
                ReadError::new(format!("a face names vertex {index}, but there are {vertices} vertices"))
                    .with_hint("indices start at 0; a count at the start of the file may be wrong")
            }),
            None => Err(ReadError::new(format!("{} is not the index of a vertex", quoted(word)))
                .with_hint("a face is the number of its corners, then as many indices")),
        }
    }

    /// A copy of `bytes` with the change in it, and warnings.
    pub(crate) fn patched(&self, bytes: &[u8], change: &Change) -> (Vec<u8>, Vec<String>) {
        let mut splice = Splice::new(bytes);
        let warnings = self.patch_rows(bytes, change, &mut splice, |_, _| {});
        (splice.finish(), warnings)
    }

    /// Puts the change into the lines of the old vertices. `each` hears where the words of a line stand, and where the line ends.
    pub(crate) fn patch_rows(
        &self,
        bytes: &[u8],
        change: &Change,
        splice: &mut Splice,
        mut each: impl FnMut(&[Range<usize>], usize),
    ) -> Vec<String> {
        let mut words = self.vertex_words(bytes);
        let (mut row, mut unread) = (Vec::new(), 0);
        for (vertex, (old, new)) in change.mesh.points().iter().zip(change.stored).enumerate() {
            next_row(&mut words, &mut row);
            let spans = |first: usize| [0, 1, 2].map(|axis| row.get(first + axis).cloned());
            replace_changed(splice, spans(0), *old, *new);
            let jacobian = change.jacobians.map(|jacobians| &jacobians[vertex]).filter(|j| **j != DMat3::IDENTITY);
            if let (Some(jacobian), Some(first)) = (jacobian, self.columns(row.len()).normal) {
                match normal_of(bytes, &row, first) {
                    Some(old) => {
                        let new = carried_direction(old, jacobian).map(|direction| direction * old.length());
                        if let Some(new) = new.filter(|new| new.is_finite()) {
                            replace_changed(splice, spans(first), old, new);
                        }
                    }
                    None => unread += 1,
                }
            }
            each(&row, words.line_end());
        }
        let unread =
            (unread > 0).then(|| format!("Normals that are not three finite numbers and stay as they are: {unread}."));
        unread.into_iter().collect()
    }
}

/// Puts the words of the next line that has any in place of what `row` held. Whether there is one.
fn next_row(words: &mut Words, row: &mut Vec<Range<usize>>) -> bool {
    row.clear();
    let is_there = words.skip_blank_lines();
    row.extend(std::iter::from_fn(|| words.next_in_line()));
    is_there
}

/// The normal that begins at word `first` of a line. `None` where it is not three finite numbers.
pub(crate) fn normal_of(bytes: &[u8], row: &[Range<usize>], first: usize) -> Option<DVec3> {
    let mut normal = DVec3::ZERO;
    for axis in 0..3 {
        normal[axis] = finite(&bytes[row.get(first + axis)?.clone()]).ok()?;
    }
    Some(normal)
}

/// A plain OFF text.
pub(crate) fn new_file(points: &[DVec3], faces: &Faces, number: NumberType) -> Vec<u8> {
    let mut text = format!("OFF\n{} {} 0\n", points.len(), faces.len()).into_bytes();
    text.reserve(points.len() * 32 + faces.corners().len() * 8);
    for point in points {
        for axis in 0..3 {
            if axis > 0 {
                text.push(b' ');
            }
            push_shortest(&mut text, point[axis], number);
        }
        text.push(b'\n');
    }
    for face in faces.iter() {
        push_face(&mut text, face);
        text.push(b'\n');
    }
    text
}

/// Appends the number of corners of a face, and the corners.
pub(crate) fn push_face(text: &mut Vec<u8>, face: &[u32]) {
    text.extend_from_slice(face.len().to_string().as_bytes());
    for corner in face {
        text.extend_from_slice(format!(" {corner}").as_bytes());
    }
}
