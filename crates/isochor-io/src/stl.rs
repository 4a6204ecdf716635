//! STL, stereolithography facets.
//!
//! Binary where the length fits the number of facets, text where it starts with `solid` and goes on like it, else
//! binary. Corners at one place are one vertex of the mesh; in the file each facet keeps its own.

use std::ops::Range;

use glam::DVec3;
use isochor::{Faces, Mesh, fan};

use crate::document::{Change, Parsed};
use crate::normal::direction;
use crate::number::{any, finite, push_shortest, quoted};
use crate::refined::Refined;
use crate::splice::Splice;
use crate::weld::Weld;
use crate::words::{Words, line_break, line_of};
use crate::{NumberType, Place, ReadError, WriteError};

/// Bytes before the count of facets of a binary file.
const TITLE: usize = 80;
/// Bytes before the facets of a binary file.
const HEAD: usize = 84;
/// Bytes of a facet of a binary file: normal, three corners, two bytes of attributes.
const FACET: usize = 50;

/// Where things stand in an STL file.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    text: bool,
    facets: usize,
}

/// Where one facet stands, from `facet` to `endfacet` where it is text, and its numbers.
struct Facet {
    all: Range<usize>,
    normal: [Range<usize>; 3],
    corners: [[Range<usize>; 3]; 3],
}

/// Whether `bytes` are those of an STL file, whatever it is called.
pub(crate) fn looks_like(bytes: &[u8]) -> bool {
    fits_binary(bytes) || is_text(bytes)
}

/// Number of facets that a binary file announces.
fn announced(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(TITLE..HEAD)?;
    Some(count.iter().rev().fold(0, |n, &b| n << 8 | usize::from(b)))
}

/// Bytes of a binary file of so many facets.
fn binary_size(facets: usize) -> u64 {
    HEAD as u64 + FACET as u64 * facets as u64
}

fn fits_binary(bytes: &[u8]) -> bool {
    announced(bytes).is_some_and(|facets| binary_size(facets) == bytes.len() as u64)
}

/// Whether the file starts with `solid` and a word of an STL text follows before any NUL byte.
fn is_text(bytes: &[u8]) -> bool {
    let mut words = words(bytes);
    if !words.next().is_some_and(|word| bytes[word].eq_ignore_ascii_case(b"solid")) {
        return false;
    }
    while let Some(word) = words.next() {
        let word = &bytes[word];
        if word.contains(&0) {
            return false;
        }
        if word.eq_ignore_ascii_case(b"facet") || word.eq_ignore_ascii_case(b"endsolid") {
            return true;
        }
    }
    false
}

/// The words of `bytes`, without a UTF-8 byte order mark.
fn words(bytes: &[u8]) -> Words<'_> {
    Words::plain(bytes, if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 }, 1)
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Parsed<Layout>, ReadError> {
    let mut warnings = Vec::new();
    let text = !fits_binary(bytes) && is_text(bytes);
    let mut facets = if text { Facets::text(bytes) } else { Facets::binary(bytes, &mut warnings)? };
    let mut weld = Weld::new();
    let mut faces = match &facets.walk {
        Walk::Binary { ahead, .. } => Faces::with_capacity(*ahead, 3 * ahead),
        Walk::Text(_) => Faces::new(),
    };
    while let Some(facet) = facets.next()? {
        if faces.corners().len() + 3 > u32::MAX as usize {
            return Err(ReadError::new("more than 1431655765 facets").with_hint("split the model").at(facets.place()));
        }
        let mut corners = [0; 3];
        for (corner, spans) in corners.iter_mut().zip(&facet.corners) {
            *corner = weld.vertex(facets.point(spans)?);
        }
        faces.push(&corners);
    }
    if facets.solid_is_open {
        let open = unpaired_edges(&faces);
        if open > 0 {
            return Err(ReadError::new(format!("'endsolid' is missing and {open} edges are open: the file seems cut"))
                .with_hint("export it again, or add a line 'endsolid' where it is whole")
                .at(facets.place()));
        }
        warnings.push("'endsolid' is missing behind the last facet.".to_owned());
    }
    let layout = Layout { text, facets: faces.len() };
    let mesh = Mesh::new(weld.into_points(), faces).map_err(|error| ReadError::new(error.to_string()))?;
    Ok(Parsed { mesh, layout, warnings })
}

/// Number of edges that are not run equally often in both directions.
fn unpaired_edges(faces: &Faces) -> usize {
    let mut edges: Vec<(u32, u32, i32)> = faces
        .iter()
        .flat_map(|f| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])])
        .filter(|(a, b)| a != b)
        .map(|(a, b)| if a < b { (a, b, 1) } else { (b, a, -1) })
        .collect();
    edges.sort_unstable();
    edges
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .filter(|same| same.iter().map(|edge| edge.2).sum::<i32>() != 0)
        .count()
}

/// A walk through the facets of a file.
struct Facets<'a> {
    bytes: &'a [u8],
    walk: Walk<'a>,
    /// Whether the last solid has not ended yet.
    solid_is_open: bool,
}

enum Walk<'a> {
    Text(Words<'a>),
    Binary { at: usize, ahead: usize },
}

impl<'a> Facets<'a> {
    fn text(bytes: &'a [u8]) -> Self {
        Self { bytes, walk: Walk::Text(words(bytes)), solid_is_open: false }
    }

    fn binary(bytes: &'a [u8], warnings: &mut Vec<String>) -> Result<Self, ReadError> {
        let size = bytes.len() as u64;
        let Some(ahead) = announced(bytes) else {
            return Err(ReadError::new(format!("{size} bytes are fewer than the 84 of the shortest binary STL file"))
                .with_hint("the file is cut, or no STL file")
                .at(Place::Byte(bytes.len())));
        };
        let due = binary_size(ahead);
        if size < due {
            return Err(ReadError::new(format!(
                "{ahead} facets are announced, which take {due} bytes, but there are {size}"
            ))
            .with_hint("the file is cut, or no STL file")
            .at(Place::Byte(TITLE)));
        }
        let behind = size - due;
        if behind > 0 && behind.is_multiple_of(FACET as u64) {
            let more = behind / FACET as u64;
            return Err(ReadError::new(format!("{ahead} facets are announced, but {more} more stand behind them"))
                .with_hint("the count is wrong: export the file again")
                .at(Place::Byte(TITLE)));
        }
        if behind > 0 && ahead == 0 {
            return Err(ReadError::new(format!("no facet is announced, but {behind} bytes stand behind the header"))
                .with_hint("the count is wrong, or the file is no STL file")
                .at(Place::Byte(TITLE)));
        }
        if behind > 0 {
            warnings.push(format!("Bytes behind the last facet, kept but not read: {behind}."));
        }
        Ok(Self { bytes, walk: Walk::Binary { at: HEAD, ahead }, solid_is_open: false })
    }

    /// The same file again, which was read before.
    fn again(bytes: &'a [u8], layout: &Layout) -> Self {
        if layout.text {
            return Self::text(bytes);
        }
        Self { bytes, walk: Walk::Binary { at: HEAD, ahead: layout.facets }, solid_is_open: false }
    }

    /// Where the walk is.
    fn at(&self) -> usize {
        match &self.walk {
            Walk::Text(words) => words.at(),
            Walk::Binary { at, .. } => *at,
        }
    }

    /// Where the walk is, for a message.
    fn place(&self) -> Place {
        match &self.walk {
            Walk::Text(words) => Place::Line(words.line()),
            Walk::Binary { at, .. } => Place::Byte(*at),
        }
    }

    /// The next facet. `None` behind the last.
    fn next(&mut self) -> Result<Option<Facet>, ReadError> {
        match &mut self.walk {
            Walk::Binary { ahead: 0, .. } => Ok(None),
            Walk::Binary { at, ahead } => {
                let vector = |n: usize| {
                    std::array::from_fn(|axis| {
                        let start = *at + 12 * n + 4 * axis;
                        start..start + 4
                    })
                };
                let all = *at..*at + FACET;
                let facet = Facet { all, normal: vector(0), corners: [vector(1), vector(2), vector(3)] };
                *at += FACET;
                *ahead -= 1;
                Ok(Some(facet))
            }
            Walk::Text(_) => {
                if self.at_facet()? {
                    self.text_facet().map(Some)
                } else {
                    Ok(None)
                }
            }
        }
    }

    /// Steps over the starts and ends of solids and over the word `facet`. Whether there is one.
    fn at_facet(&mut self) -> Result<bool, ReadError> {
        let Walk::Text(words) = &mut self.walk else { return Ok(false) };
        while let Some(span) = words.next() {
            let word = &self.bytes[span];
            if !self.solid_is_open && word.eq_ignore_ascii_case(b"solid") {
                self.solid_is_open = true;
                words.end_line();
            } else if self.solid_is_open && word.eq_ignore_ascii_case(b"endsolid") {
                self.solid_is_open = false;
                words.end_line();
            } else if self.solid_is_open && word.eq_ignore_ascii_case(b"facet") {
                return Ok(true);
            } else {
                let due = if self.solid_is_open { "'facet' or 'endsolid'" } else { "'solid'" };
                return Err(ReadError::new(format!("{} stands where {due} should", quoted(word)))
                    .with_hint("the file is damaged, or no STL file")
                    .at_line(words.line()));
            }
        }
        Ok(false)
    }

    /// A facet of a text, behind the word `facet`.
    fn text_facet(&mut self) -> Result<Facet, ReadError> {
        let start = self.at() - "facet".len();
        self.expect("normal")?;
        // Slivers have normals such as nan or 1.#QNAN; what these spell does not matter.
        let normal = self.three_words()?;
        self.expect("outer")?;
        self.expect("loop")?;
        let mut corners: [[Range<usize>; 3]; 3] = Default::default();
        for corner in &mut corners {
            self.expect("vertex")?;
            *corner = self.three_words()?;
        }
        self.expect("endloop")?;
        self.expect("endfacet")?;
        Ok(Facet { all: start..self.at(), normal, corners })
    }

    fn word(&mut self) -> Result<Range<usize>, ReadError> {
        let Walk::Text(words) = &mut self.walk else { return Ok(0..0) };
        words.next().ok_or_else(|| {
            ReadError::new("the text ends within a facet").with_hint("the file is cut").at_line(words.line())
        })
    }

    fn three_words(&mut self) -> Result<[Range<usize>; 3], ReadError> {
        Ok([self.word()?, self.word()?, self.word()?])
    }

    fn expect(&mut self, due: &str) -> Result<(), ReadError> {
        let span = self.word()?;
        let word = &self.bytes[span];
        if word.eq_ignore_ascii_case(due.as_bytes()) {
            return Ok(());
        }
        let hint = match due {
            "endloop" => "a facet has exactly three corners",
            "vertex" => "a facet has three corners",
            _ => "the file is damaged",
        };
        Err(ReadError::new(format!("{} stands where '{due}' should", quoted(word))).with_hint(hint).at(self.place()))
    }

    /// The corner whose coordinates stand at `spans`.
    fn point(&self, spans: &[Range<usize>; 3]) -> Result<DVec3, ReadError> {
        let mut point = DVec3::ZERO;
        for (axis, span) in spans.iter().enumerate() {
            point[axis] = match &self.walk {
                Walk::Text(_) => {
                    finite(&self.bytes[span.clone()]).map_err(|error| error.at_line(line_of(self.bytes, span.start)))?
                }
                Walk::Binary { .. } => {
                    let x = self.float(span.clone());
                    if !x.is_finite() {
                        let error =
                            ReadError::new(format!("{x} is not a finite number")).with_hint("repair the coordinate");
                        return Err(error.at(Place::Byte(span.start)));
                    }
                    x
                }
            };
        }
        Ok(point)
    }

    /// The number at `span`, maybe not finite. What is no number reads as nan.
    fn float(&self, span: Range<usize>) -> f64 {
        let bytes = &self.bytes[span];
        match &self.walk {
            Walk::Text(_) => any(bytes).unwrap_or(f64::NAN),
            Walk::Binary { .. } => f64::from(f32::from_le_bytes(bytes.try_into().unwrap_or_default())),
        }
    }

    /// Appends a facet to `out` that is spelled as `facet`, with other corners and their normal. A normal of 0 stays.
    fn push_facet(&self, facet: &Facet, corners: [DVec3; 3], out: &mut Vec<u8>) {
        let mut splice = Splice::of_part(self.bytes, facet.all.clone());
        let mut digits = Vec::with_capacity(32);
        let normal = facet_normal(corners);
        if facet.normal.iter().any(|span| self.float(span.clone()) != 0.0) {
            for (axis, span) in facet.normal.iter().enumerate() {
                digits.clear();
                self.encode(normal[axis], &mut digits);
                splice.replace(span.clone(), &digits);
            }
        }
        for (spans, corner) in facet.corners.iter().zip(corners) {
            for (axis, span) in spans.iter().enumerate() {
                digits.clear();
                match &self.walk {
                    // An old corner may have more digits than 32 bits need; it must stay one with that of its neighbours.
                    Walk::Text(_) => push_shortest(&mut digits, corner[axis], NumberType::F64),
                    Walk::Binary { .. } => self.encode(corner[axis], &mut digits),
                }
                splice.replace(span.clone(), &digits);
            }
        }
        out.extend_from_slice(&splice.finish());
    }

    /// Appends `x` to `out` as the file writes numbers.
    fn encode(&self, x: f64, out: &mut Vec<u8>) {
        match &self.walk {
            Walk::Text(_) => push_shortest(out, x, NumberType::F32),
            Walk::Binary { .. } => out.extend_from_slice(&(x as f32).to_le_bytes()),
        }
    }
}

impl Layout {
    pub(crate) fn facets(&self) -> usize {
        self.facets
    }

    pub(crate) fn is_text(&self) -> bool {
        self.text
    }

    /// A copy of `bytes` with the change in it, and warnings.
    pub(crate) fn patched(&self, bytes: &[u8], change: &Change) -> Result<(Vec<u8>, Vec<String>), ReadError> {
        let (old, new) = (change.mesh.points(), change.stored);
        let mut splice = Splice::new(bytes);
        let mut facets = Facets::again(bytes, self);
        let mut encoded = Vec::with_capacity(32);
        let mut corners = change.mesh.faces().iter();
        while let (Some(facet), Some(corners)) = (facets.next()?, corners.next()) {
            let at = [corners[0] as usize, corners[1] as usize, corners[2] as usize];
            if at.iter().any(|&v| old[v] != new[v]) {
                move_facet(&mut splice, &facets, facet, at.map(|v| (old[v], new[v])), &mut encoded);
            }
        }
        Ok((splice.finish(), Vec::new()))
    }

    /// A copy of `bytes` with the change and other facets in it, and warnings.
    pub(crate) fn refined(
        &self,
        bytes: &[u8],
        change: &Change,
        refined: &Refined,
    ) -> Result<(Vec<u8>, Vec<String>), WriteError> {
        let (old, new) = (change.mesh.points(), change.stored);
        let mut splice = Splice::new(bytes);
        if !self.text {
            let triangles =
                (0..self.facets).flat_map(|f| refined.pieces(f)).map(|piece| piece.vertices.len() - 2).sum();
            splice.replace(TITLE..HEAD, &facet_count(triangles)?);
        }
        let mut facets = Facets::again(bytes, self);
        let mut encoded = Vec::with_capacity(32);
        for (f, corners) in change.mesh.faces().iter().enumerate() {
            let Some(facet) = facets.next()? else { break };
            if refined.keeps(f) {
                let at = [corners[0] as usize, corners[1] as usize, corners[2] as usize];
                if at.iter().any(|&v| old[v] != new[v]) {
                    move_facet(&mut splice, &facets, facet, at.map(|v| (old[v], new[v])), &mut encoded);
                }
                continue;
            }
            let mut parts = Vec::new();
            for triangle in refined.pieces(f).flat_map(|piece| fan(piece.vertices)) {
                if self.text && !parts.is_empty() {
                    parts.extend_from_slice(line_start(bytes, facet.all.start));
                }
                facets.push_facet(&facet, triangle.map(|v| new[v as usize]), &mut parts);
            }
            splice.replace(facet.all, &parts);
        }
        Ok((splice.finish(), Vec::new()))
    }
}

/// The line break and blanks before the word at `at`, or a line break where another word stands before it.
fn line_start(bytes: &[u8], at: usize) -> &[u8] {
    let blanks = bytes[..at].iter().rev().take_while(|b| matches!(b, b' ' | b'\t')).count();
    let line_break = line_break(bytes);
    let start = (at - blanks).saturating_sub(line_break.len());
    if bytes[start..at].starts_with(line_break) { &bytes[start..at] } else { line_break }
}

/// Moves the corners of a facet from the first to the second of their places, and turns its normal.
fn move_facet(splice: &mut Splice, facets: &Facets, facet: Facet, corners: [(DVec3, DVec3); 3], encoded: &mut Vec<u8>) {
    let normal = DVec3::from_array(facet.normal.clone().map(|span| facets.float(span)));
    if normal != DVec3::ZERO {
        replace_changed(splice, facets, facet.normal, normal, facet_normal(corners.map(|c| c.1)), encoded);
    }
    for (spans, (old, new)) in facet.corners.into_iter().zip(corners) {
        replace_changed(splice, facets, spans, old, new, encoded);
    }
}

/// Replaces the numbers at `spans` that differ as 32-bit floats.
fn replace_changed(
    splice: &mut Splice,
    facets: &Facets,
    spans: [Range<usize>; 3],
    old: DVec3,
    new: DVec3,
    encoded: &mut Vec<u8>,
) {
    for (axis, span) in spans.into_iter().enumerate() {
        if old[axis] as f32 != new[axis] as f32 {
            encoded.clear();
            facets.encode(new[axis], encoded);
            splice.replace(span, encoded);
        }
    }
}

/// Unit normal of a triangle by the right-hand rule; 0 where it has none.
fn facet_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    let (p, q) = (b - a, c - a);
    let size = p.abs().max_element().max(q.abs().max_element());
    if size > 0.0 { direction((p / size).cross(q / size)).unwrap_or_default() } else { DVec3::ZERO }
}

/// So many triangles as a binary file counts them.
fn facet_count(triangles: usize) -> Result<[u8; 4], WriteError> {
    let limit = u64::from(u32::MAX);
    let error = WriteError::TooMany { count: triangles, things: "triangles", limit, format: "STL" };
    u32::try_from(triangles).map(u32::to_le_bytes).map_err(|_| error)
}

/// A plain binary STL file.
pub(crate) fn new_file(points: &[DVec3], faces: &Faces) -> Result<Vec<u8>, WriteError> {
    let triangles: usize = faces.iter().map(|face| face.len() - 2).sum();
    let mut bytes = Vec::with_capacity(HEAD + FACET * triangles);
    bytes.resize(TITLE, b' ');
    bytes.extend_from_slice(&facet_count(triangles)?);
    for triangle in faces.iter().flat_map(fan) {
        let corners = triangle.map(|v| points[v as usize]);
        for vector in [facet_normal(corners), corners[0], corners[1], corners[2]] {
            for x in vector.to_array() {
                bytes.extend_from_slice(&(x as f32).to_le_bytes());
            }
        }
        bytes.extend_from_slice(&[0, 0]);
    }
    Ok(bytes)
}
