//! Wavefront OBJ.
//!
//! Read: `v` (three numbers; a weight or colours behind them are kept), `f` (with texture and normal indices, relative
//! indices, vertices that come later) and `vn`. Every other statement is kept. Lines may be joined by `\`.

use std::ops::Range;

use glam::{DMat3, DVec3};
use isochor::{Faces, Mesh};

use crate::document::{Change, Parsed};
use crate::normal::{carried_direction, direction};
use crate::number::{finite, integer, push_shortest, quoted};
use crate::obj_refined::Additions;
use crate::refined::Refined;
use crate::splice::Splice;
use crate::words::{Words, refuse_binary};
use crate::{NumberType, ReadError, WriteError};

/// Marks a corner without a normal.
pub(crate) const NO_NORMAL: u32 = u32::MAX;

/// Marks a corner whose normal does not exist; beyond any number of normals.
const MISSING_NORMAL: u32 = u32::MAX - 1;

/// Above this cosine (1 degree) the normals that the vertices of one shared `vn` would get count as the same. Lower
/// would hide creases that open, higher would report every bent surface.
const SAME_NORMAL: f64 = 0.999_847_695_156_391_3;

/// Statements of OBJ. A file without vertices and with none of these is no OBJ.
const STATEMENTS: &[&[u8]] = &[
    b"v",
    b"vt",
    b"vn",
    b"vp",
    b"f",
    b"fo",
    b"l",
    b"p",
    b"g",
    b"o",
    b"s",
    b"mg",
    b"usemtl",
    b"mtllib",
    b"usemap",
    b"maplib",
    b"cstype",
    b"deg",
    b"bmat",
    b"step",
    b"curv",
    b"curv2",
    b"surf",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
    b"con",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"shadow_obj",
    b"trace_obj",
    b"ctech",
    b"stech",
    b"call",
    b"csh",
];

/// Where things stand in an OBJ file, beside what its text tells.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    faces_in_file: usize,
    /// Index of the normal at each corner of the mesh; empty where no corner has one.
    pub(crate) corner_normals: Vec<u32>,
    /// Number of `vt` lines.
    pub(crate) textures: usize,
    /// Number of `vn` lines.
    pub(crate) normals: usize,
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Parsed<Layout>, ReadError> {
    refuse_binary(bytes, "OBJ")?;
    let mut reader = Reader::new(bytes);
    while !reader.words.is_done() {
        reader.read_line()?;
    }
    reader.finish()
}

/// The words of `bytes`, without a UTF-8 byte order mark.
pub(crate) fn words(bytes: &[u8]) -> Words<'_> {
    let mut words = Words::obj(bytes);
    if bytes.starts_with(b"\xef\xbb\xbf") {
        words.skip(3);
    }
    words
}

/// What was read so far.
struct Reader<'a> {
    bytes: &'a [u8],
    words: Words<'a>,
    points: Vec<DVec3>,
    faces: Faces,
    corner_normals: Vec<u32>,
    textures: usize,
    normals: usize,
    faces_in_file: usize,
    /// Largest vertex index that was named (from 0), and its line.
    largest: Option<(u64, usize)>,
    /// First statement that is none of OBJ, and its line.
    unknown: Option<(Range<usize>, usize)>,
    /// Number of faces of less than three corners, and the line of the first.
    skipped: (usize, usize),
    /// Number of vertices with a weight that is not 1, and the line of the first.
    weighted: (usize, usize),
    face: Vec<u32>,
    face_normals: Vec<u32>,
}

/// Counts one more and keeps the line of the first.
pub(crate) fn count(tally: &mut (usize, usize), line: usize) {
    if tally.0 == 0 {
        tally.1 = line;
    }
    tally.0 += 1;
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            words: words(bytes),
            points: Vec::new(),
            faces: Faces::new(),
            corner_normals: Vec::new(),
            textures: 0,
            normals: 0,
            faces_in_file: 0,
            largest: None,
            unknown: None,
            skipped: (0, 0),
            weighted: (0, 0),
            face: Vec::new(),
            face_normals: Vec::new(),
        }
    }

    fn read_line(&mut self) -> Result<(), ReadError> {
        if let Some(keyword) = self.words.next_in_line() {
            match &self.bytes[keyword.clone()] {
                b"v" => self.read_vertex()?,
                b"f" | b"fo" => self.read_face()?,
                b"vn" => self.normals += 1,
                b"vt" => self.textures += 1,
                other => {
                    if self.unknown.is_none() && !STATEMENTS.contains(&other) {
                        self.unknown = Some((keyword, self.words.line()));
                    }
                }
            }
        }
        self.words.end_line();
        Ok(())
    }

    fn read_vertex(&mut self) -> Result<(), ReadError> {
        let mut point = DVec3::ZERO;
        for axis in 0..3 {
            let word = self.words.next_in_line();
            let read = match word {
                Some(word) => finite(&self.bytes[word]),
                None => Err(ReadError::new(format!("a vertex of {axis} numbers")).with_hint("write x, y and z")),
            };
            point[axis] = read.map_err(|error| error.at_line(self.words.line()))?;
        }
        let line = self.words.line();
        let mut more = 0;
        let mut weight = None;
        while let Some(word) = self.words.next_in_line() {
            weight = weight.or(Some(word));
            more += 1;
        }
        match (more, weight) {
            (1, Some(word)) => {
                if finite(&self.bytes[word]).map_err(|error| error.at_line(line))? != 1.0 {
                    count(&mut self.weighted, line);
                }
            }
            (0 | 3 | 4, _) => {}
            _ => {
                return Err(ReadError::new(format!("a vertex of {} numbers", 3 + more))
                    .with_hint("write x y z, then nothing, a weight, or a colour")
                    .at_line(line));
            }
        }
        if self.points.len() >= u32::MAX as usize {
            return Err(ReadError::new("more than 4294967295 vertices").with_hint("split the model").at_line(line));
        }
        self.points.push(point);
        Ok(())
    }

    fn read_face(&mut self) -> Result<(), ReadError> {
        let first_line = self.words.line();
        self.faces_in_file += 1;
        self.face.clear();
        self.face_normals.clear();
        let mut has_normal = false;
        while let Some(word) = self.words.next_in_line() {
            let (vertex, normal) = self.corner(&self.bytes[word]).map_err(|error| error.at_line(self.words.line()))?;
            if self.largest.is_none_or(|(largest, _)| vertex > largest) {
                self.largest = Some((vertex, self.words.line()));
            }
            // Indices beyond u32 are beyond the vertices too, and refused at the end of the file.
            self.face.push(vertex as u32);
            self.face_normals.push(normal);
            has_normal |= normal != NO_NORMAL;
        }
        if self.face.len() < 3 {
            count(&mut self.skipped, first_line);
            return Ok(());
        }
        let corners = self.faces.corners().len();
        if corners + self.face.len() > u32::MAX as usize {
            return Err(ReadError::new("more than 4294967295 corners")
                .with_hint("split the model")
                .at_line(first_line));
        }
        if has_normal || !self.corner_normals.is_empty() {
            self.corner_normals.resize(corners, NO_NORMAL);
            self.corner_normals.extend_from_slice(&self.face_normals);
        }
        self.faces.push(&self.face);
        Ok(())
    }

    /// Indices from 0 of the vertex and the normal of a corner `i`, `i/j`, `i//k` or `i/j/k`.
    fn corner(&self, word: &[u8]) -> Result<(u64, u32), ReadError> {
        let mut fields = word.split(|&b| b == b'/');
        let vertex = fields.next().unwrap_or_default();
        let (texture, normal) = (fields.next().unwrap_or_default(), fields.next().unwrap_or_default());
        if fields.next().is_some() {
            return Err(bad_corner(word));
        }
        if !texture.is_empty() && integer(texture).is_none() {
            return Err(bad_corner(word));
        }
        let normal = match integer(normal) {
            None if normal.is_empty() => NO_NORMAL,
            None => return Err(bad_corner(word)),
            Some(index) => resolved(index, self.normals)
                .and_then(|i| u32::try_from(i).ok())
                .unwrap_or(MISSING_NORMAL)
                .min(MISSING_NORMAL),
        };
        match integer(vertex) {
            None => Err(bad_corner(word)),
            Some(0) => Err(ReadError::new("a face names vertex 0").with_hint("indices start at 1")),
            Some(index) => resolved(index, self.points.len()).map(|i| (i, normal)).ok_or_else(|| {
                let before = self.points.len();
                ReadError::new(format!("a face names vertex {index}, but only {before} vertices stand before it"))
                    .with_hint("relative indices count back from the last vertex")
            }),
        }
    }

    fn finish(mut self) -> Result<Parsed<Layout>, ReadError> {
        let vertices = self.points.len();
        if let Some((index, line)) = self.largest.filter(|&(index, _)| index >= vertices as u64) {
            let what = format!("a face names vertex {}, but the file has {vertices} vertices", index + 1);
            return Err(ReadError::new(what).with_hint("indices start at 1; the file may be cut").at_line(line));
        }
        if let Some((word, line)) = self.unknown.filter(|_| vertices == 0) {
            let error = ReadError::new(format!("{} is not an OBJ statement", quoted(&self.bytes[word]))).at_line(line);
            return Err(error.with_hint("the file has no vertices: is it an OBJ?"));
        }
        if !self.corner_normals.is_empty() {
            self.corner_normals.resize(self.faces.corners().len(), NO_NORMAL);
        }
        let missing = forget_missing(&mut self.corner_normals, self.normals);
        let warnings = [
            (self.skipped.0 > 0).then(|| {
                let (n, line) = self.skipped;
                format!("Faces of fewer than 3 corners that are not read: {n}, the first in line {line}.")
            }),
            (self.weighted.0 > 0).then(|| {
                let (n, line) = self.weighted;
                format!("Vertices with a weight other than 1, which is ignored: {n}, the first in line {line}.")
            }),
            (missing > 0).then(|| format!("Corners that name a normal that does not exist: {missing}.")),
        ];
        let mesh = Mesh::new(self.points, self.faces).map_err(|error| ReadError::new(error.to_string()))?;
        Ok(Parsed {
            mesh,
            layout: Layout {
                faces_in_file: self.faces_in_file,
                corner_normals: self.corner_normals,
                textures: self.textures,
                normals: self.normals,
            },
            warnings: warnings.into_iter().flatten().collect(),
        })
    }
}

/// Index from 0 of what `index` names, where `before` of its kind were read. `None` for 0 and before the first.
pub(crate) fn resolved(index: i64, before: usize) -> Option<u64> {
    match index {
        1.. => Some(index as u64 - 1),
        0 => None,
        _ => (before as u64).checked_sub(index.unsigned_abs()),
    }
}

/// Drops indices of normals that do not exist, and says how many.
fn forget_missing(corner_normals: &mut Vec<u32>, normals: usize) -> usize {
    let mut missing = 0;
    for normal in corner_normals.iter_mut().filter(|n| **n != NO_NORMAL && **n as usize >= normals) {
        *normal = NO_NORMAL;
        missing += 1;
    }
    if corner_normals.iter().all(|&n| n == NO_NORMAL) {
        corner_normals.clear();
    }
    missing
}

fn bad_corner(word: &[u8]) -> ReadError {
    let error = ReadError::new(format!("{} is not a corner of a face", quoted(word)));
    let digits = word.strip_prefix(b"-").unwrap_or(word);
    if digits.len() > 18 && digits.iter().all(u8::is_ascii_digit) {
        error.with_hint("the index is beyond any vertex")
    } else {
        error.with_hint("write vertex, vertex/texture, vertex//normal or vertex/texture/normal as integers")
    }
}

impl Layout {
    pub(crate) fn faces_in_file(&self) -> usize {
        self.faces_in_file
    }

    pub(crate) fn has_normals(&self) -> bool {
        !self.corner_normals.is_empty()
    }

    /// A copy of `bytes` with the change in it, and other faces where there are any, and warnings.
    pub(crate) fn patched(
        &self,
        bytes: &[u8],
        change: &Change,
        refined: Option<&Refined>,
    ) -> Result<(Vec<u8>, Vec<String>), WriteError> {
        let mut additions = refined.map(|refined| Additions::new(self, bytes, change, refined)).transpose()?;
        let jacobians = change.jacobians.filter(|_| self.has_normals());
        let mut carrier = jacobians.map(|jacobians| NormalCarrier::new(self, change.mesh, jacobians));
        let mut splice = Splice::new(bytes);
        let mut words = words(bytes);
        let mut points = change.mesh.points().iter().zip(change.stored);
        let mut normal = 0;
        while !words.is_done() {
            let keyword = words.next_in_line();
            match keyword.clone().map(|word| &bytes[word]) {
                Some(b"v") => {
                    if let Some((old, new)) = points.next().filter(|(old, new)| old != new) {
                        let spans = std::array::from_fn(|_| words.next_in_line());
                        replace_changed(&mut splice, spans, *old, *new);
                    }
                }
                Some(b"vn") => {
                    if let Some(carrier) = &mut carrier {
                        let spans = std::array::from_fn(|_| words.next_in_line());
                        if let Some((old, new)) = carrier.carried(bytes, &spans, normal) {
                            replace_changed(&mut splice, spans, old, new);
                        }
                    }
                    normal += 1;
                }
                Some(b"f" | b"fo") => {
                    if let (Some(additions), Some(keyword)) = (&mut additions, keyword) {
                        additions.replace_face(&mut splice, keyword, &mut words);
                    }
                }
                _ => {}
            }
            if let Some(additions) = &additions {
                additions.add_lines(&mut splice, words.line_end());
            }
            words.end_line();
        }
        let warnings = carrier.map(NormalCarrier::warnings).into_iter().chain(additions.map(Additions::warnings));
        Ok((splice.finish(), warnings.flatten().collect()))
    }
}

/// Replaces the numbers at `spans` that differ.
pub(crate) fn replace_changed(splice: &mut Splice, spans: [Option<Range<usize>>; 3], old: DVec3, new: DVec3) {
    let mut digits = Vec::with_capacity(32);
    for (axis, span) in spans.into_iter().enumerate() {
        if let Some(span) = span.filter(|_| old[axis] != new[axis]) {
            digits.clear();
            push_shortest(&mut digits, new[axis], NumberType::F64);
            splice.replace(span, &digits);
        }
    }
}

/// Carries each `vn` by the Jacobians of the vertices whose corners use it.
struct NormalCarrier<'a> {
    jacobians: &'a [DMat3],
    /// Distinct vertices of normal k: `vertices[starts[k]..starts[k + 1]]`, maybe with repetitions.
    starts: Vec<usize>,
    vertices: Vec<u32>,
    distinct: Vec<u32>,
    shared: usize,
    unread: usize,
}

impl<'a> NormalCarrier<'a> {
    fn new(layout: &Layout, mesh: &Mesh, jacobians: &'a [DMat3]) -> Self {
        let pairs = || layout.corner_normals.iter().zip(mesh.faces().corners()).filter(|(n, _)| **n != NO_NORMAL);
        let mut starts = vec![0; layout.normals + 1];
        for (&normal, _) in pairs() {
            starts[normal as usize + 1] += 1;
        }
        for normal in 0..layout.normals {
            starts[normal + 1] += starts[normal];
        }
        let mut next = starts.clone();
        let mut vertices = vec![0; starts[layout.normals]];
        for (&normal, &vertex) in pairs() {
            vertices[next[normal as usize]] = vertex;
            next[normal as usize] += 1;
        }
        Self { jacobians, starts, vertices, distinct: Vec::new(), shared: 0, unread: 0 }
    }

    /// Normal `k`, which stands at `spans`, before and after. `None` where it stays as it is.
    fn carried(&mut self, bytes: &[u8], spans: &[Option<Range<usize>>; 3], k: usize) -> Option<(DVec3, DVec3)> {
        self.distinct.clear();
        self.distinct.extend_from_slice(&self.vertices[self.starts[k]..self.starts[k + 1]]);
        self.distinct.sort_unstable();
        self.distinct.dedup();
        if self.distinct.iter().all(|&v| self.jacobians[v as usize] == DMat3::IDENTITY) {
            return None;
        }
        let number = |span: &Option<Range<usize>>| span.clone().and_then(|span| finite(&bytes[span]).ok());
        let [Some(x), Some(y), Some(z)] = std::array::from_fn(|axis| number(&spans[axis])) else {
            self.unread += 1;
            return None;
        };
        let old = DVec3::new(x, y, z);
        let new = self.mean_direction(old)? * old.length();
        new.is_finite().then_some((old, new))
    }

    /// Mean of the directions that the vertices give the normal `old`.
    fn mean_direction(&mut self, old: DVec3) -> Option<DVec3> {
        let each = |&v: &u32| carried_direction(old, &self.jacobians[v as usize]);
        if let [vertex] = self.distinct.as_slice() {
            return each(vertex);
        }
        let sum: DVec3 = self.distinct.iter().filter_map(each).sum();
        let mean = direction(sum);
        let is_off = |d: DVec3| mean.is_none_or(|mean| d.dot(mean) < SAME_NORMAL);
        if self.distinct.iter().filter_map(each).any(is_off) {
            self.shared += 1;
        }
        mean
    }

    fn warnings(self) -> Vec<String> {
        let shared = (self.shared > 0).then(|| {
            let n = self.shared;
            format!("{n} shared normals turn differently (by more than 1 degree) at their vertices and got the mean.")
        });
        let unread = (self.unread > 0)
            .then(|| format!("Normals that are not three finite numbers and stay as they are: {}.", self.unread));
        shared.into_iter().chain(unread).collect()
    }
}

/// A plain OBJ text.
pub(crate) fn new_file(points: &[DVec3], faces: &Faces, number: NumberType) -> Vec<u8> {
    let mut text = Vec::with_capacity(points.len() * 32 + faces.corners().len() * 8);
    for point in points {
        text.push(b'v');
        for axis in 0..3 {
            text.push(b' ');
            push_shortest(&mut text, point[axis], number);
        }
        text.push(b'\n');
    }
    for face in faces.iter() {
        text.push(b'f');
        for &corner in face {
            text.extend_from_slice(format!(" {}", u64::from(corner) + 1).as_bytes());
        }
        text.push(b'\n');
    }
    if text.is_empty() {
        // A file without a byte would be taken for a failed export.
        text.extend_from_slice(b"# no vertices\n");
    }
    text
}
