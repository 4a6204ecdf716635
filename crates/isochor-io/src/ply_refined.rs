//! What a refined mesh adds to a PLY file: rows of vertices behind the old ones, rows of faces in place of old ones.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::DVec3;
use isochor::Precision;

use crate::WriteError;
use crate::document::Change;
use crate::mix::Mix;
use crate::normal::mixed_direction;
use crate::ply::{Layout, Role, polygons};
use crate::ply_body::Body;
use crate::ply_header::{self, Element, Encoding, Kind, Property, Scalar};
use crate::refined::{Piece, Refined};
use crate::splice::Splice;
use crate::words::line_break;

/// Names of integers that are mixed: colours. Other integers may be labels, between which there is nothing.
const COLOURS: [&str; 9] = ["red", "green", "blue", "alpha", "gray", "grey", "intensity", "luminance", "brightness"];

/// What materials put before the names of their colours.
const COLOUR_PREFIXES: [&str; 4] = ["", "diffuse_", "ambient_", "specular_"];

/// Names of lists that hold numbers for each corner of a face, as many as one likes.
const CORNER_LISTS: [&str; 9] =
    ["texcoord", "texcoords", "texture_coordinates", "uv", "uvs", "color", "colors", "colour", "colours"];

/// Elements that name vertices of faces, and may not fit split ones.
const NEIGHBOURS: [&[u8]; 2] = [b"edge", b"tristrips"];

/// Numbers for each corner in lists that may have any name: a place in a texture.
const TEXTURE_NUMBERS: usize = 2;

impl Layout {
    /// A copy of `bytes` with the change and other faces in it, and warnings.
    pub(crate) fn refined(
        &self,
        bytes: &[u8],
        change: &Change,
        refined: &Refined,
    ) -> Result<(Vec<u8>, Vec<String>), WriteError> {
        let header = ply_header::parse(bytes)?;
        let polygons = polygons(&header)?;
        let is_face = |element: &Element| element.name == b"face";
        let splits = !refined.keeps_all();
        if splits && polygons.is_some_and(|(element, _)| !is_face(element)) {
            return Err(WriteError::Strips);
        }
        let faces = polygons.filter(|_| splits);
        let count = |element: &Element, old: usize, new: usize| {
            // Rows of faces that are no polygons stay.
            let rows = element.rows - old as u64 + new as u64;
            (element.rows_word.clone(), rows.to_string().into_bytes())
        };
        let mut words = vec![count(&self.vertex, refined.old_vertices(), change.stored.len())];
        words.extend(faces.map(|(element, _)| count(element, change.mesh.faces().len(), refined.faces())));
        words.extend(self.widened(bytes, change.precision).into_iter().map(|(at, word)| (at, word.to_vec())));
        words.sort_by_key(|(at, _)| at.start);

        let mut splice = Splice::new(bytes);
        words.iter().for_each(|(at, word)| splice.replace(at.clone(), word));
        let mut body = Body::new(bytes, header.encoding, header.body);
        let mut rows = Rows { bytes, encoding: header.encoding, out: Vec::new(), lists: BTreeSet::new(), unmixed: 0 };
        let mut kept = Vec::new();
        for element in &header.elements {
            if element.name == b"vertex" {
                let mut starts = Vec::with_capacity(refined.old_vertices());
                self.patch_rows(&mut body, change, &mut splice, |start| starts.push(start))?;
                let end = body.position().0;
                rows.vertices(self, &body, change, refined, &starts)?;
                splice.replace(end..end, &rows.out);
            } else if let Some((_, list)) = faces.filter(|_| is_face(element)) {
                rows.faces(element, list, &mut body, &mut splice, refined)?;
            } else {
                body.skip_element(element)?;
                if splits && element.rows > 0 && NEIGHBOURS.contains(&&element.name[..]) {
                    kept.push(String::from_utf8_lossy(&element.name).into_owned());
                }
            }
        }
        Ok((splice.finish(), rows.warnings(&kept)))
    }
}

/// Makes rows.
struct Rows<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
    /// The rows that were made last.
    out: Vec<u8>,
    /// Names of lists that were copied, though they may mean something else for what was added.
    lists: BTreeSet<String>,
    /// Number of vertices whose normals have no mean.
    unmixed: usize,
}

impl Rows<'_> {
    fn is_text(&self) -> bool {
        self.encoding == Encoding::Text
    }

    /// Sets a number apart from the one before it.
    fn begin_number(&mut self) {
        let is_first = self.out.last().is_none_or(|b| matches!(b, b'\n' | b'\r'));
        if self.is_text() && !is_first {
            self.out.push(b' ');
        }
    }

    fn copy(&mut self, span: Range<usize>) {
        self.begin_number();
        self.out.extend_from_slice(&self.bytes[span]);
    }

    fn push(&mut self, x: f64, scalar: Scalar, body: &Body) {
        self.begin_number();
        body.encode(x, scalar, &mut self.out);
    }

    /// The rows of all added vertices; those of the old ones start at `starts`, and `body` stands behind them.
    fn vertices(
        &mut self,
        layout: &Layout,
        body: &Body,
        change: &Change,
        refined: &Refined,
        starts: &[usize],
    ) -> Result<(), WriteError> {
        self.out.clear();
        let line_break = line_break(self.bytes);
        let before = &self.bytes[..body.position().0];
        if self.is_text() && !matches!(before.last(), Some(b'\n' | b'\r')) {
            self.out.extend_from_slice(line_break);
        }
        let mut spans = [Vec::new(), Vec::new(), Vec::new()];
        for (vertex, mix) in (refined.old_vertices()..).zip(refined.added()) {
            for (spans, &(part, _)) in spans.iter_mut().zip(mix.parts()) {
                let mut row = body.again(starts[part as usize]);
                spans.clear();
                for property in &layout.vertex.properties {
                    spans.push(row.property(property.kind)?);
                }
            }
            self.vertex(layout, body, change, vertex, &mix, &spans);
            if self.is_text() {
                self.out.extend_from_slice(line_break);
            }
        }
        Ok(())
    }

    /// The row of a vertex that is mixed of others, whose properties stand at `spans`.
    fn vertex(
        &mut self,
        layout: &Layout,
        body: &Body,
        change: &Change,
        vertex: usize,
        mix: &Mix,
        spans: &[Vec<Range<usize>>; 3],
    ) {
        let place = |k: u32| mix.parts().iter().position(|part| part.0 == k).unwrap_or_default();
        let number =
            |k: u32, p: usize, scalar: Scalar| body.finite(spans[place(k)][p].clone(), scalar).unwrap_or(f64::NAN);
        let old_normal = |k: u32| {
            let mut normal = DVec3::ZERO;
            for (p, (property, role)) in layout.vertex.properties.iter().zip(&layout.roles).enumerate() {
                if let (Role::Normal(axis), Kind::Number(scalar)) = (role, property.kind) {
                    normal[*axis] = number(k, p, scalar);
                }
            }
            normal
        };
        let jacobian = change.jacobians.map(|jacobians| &jacobians[vertex]);
        let is_copied = !layout.has_normals() || (mix.only().is_some() && jacobian.is_none());
        let normal = if is_copied { None } else { mixed_direction(mix, old_normal, jacobian) };
        self.unmixed += usize::from(!is_copied && normal.is_none());
        for (p, (property, role)) in layout.vertex.properties.iter().zip(&layout.roles).enumerate() {
            let heaviest = spans[0][p].clone();
            match (property.kind, role, normal) {
                (Kind::Number(scalar), Role::Coordinate(axis), _) => {
                    let scalar = if change.precision == Precision::F64 { Scalar::F64 } else { scalar };
                    self.push(change.stored[vertex][*axis], scalar, body);
                }
                (Kind::Number(scalar), Role::Normal(axis), Some(normal)) => self.push(normal[*axis], scalar, body),
                (Kind::Number(scalar), Role::Other, _) => {
                    match mixed(property, scalar, mix, |k| number(k, p, scalar)) {
                        Some(x) => self.push(x, scalar, body),
                        None => self.copy(heaviest),
                    }
                }
                (Kind::List(..), ..) => {
                    self.lists.insert(format!("'{}' of vertices", String::from_utf8_lossy(&property.name)));
                    self.copy(heaviest);
                }
                _ => self.copy(heaviest),
            }
        }
    }

    /// Puts rows of new faces in place of those of split ones.
    fn faces(
        &mut self,
        element: &Element,
        list: usize,
        body: &mut Body,
        splice: &mut Splice,
        refined: &Refined,
    ) -> Result<(), WriteError> {
        let (mut spans, mut corners, mut items) = (Vec::new(), Vec::new(), Vec::new());
        let mut face = 0;
        for _ in 0..element.rows {
            body.begin_row(element)?;
            let start = body.position().0;
            spans.clear();
            for (p, property) in element.properties.iter().enumerate() {
                spans.push(body.property(property.kind)?);
                if let (true, Kind::List(count, item)) = (p == list, property.kind) {
                    body.items(spans[p].clone(), count, item, &mut corners)?;
                }
            }
            let (last, end) = (body.position().0, body.row_end());
            body.end_row(element)?;
            if corners.len() < 3 {
                continue;
            }
            face += 1;
            if refined.keeps(face - 1) {
                continue;
            }
            self.out.clear();
            for (k, piece) in refined.pieces(face - 1).enumerate() {
                if k > 0 && self.is_text() {
                    self.out.extend_from_slice(line_break(self.bytes));
                }
                for (p, property) in element.properties.iter().enumerate() {
                    match property.kind {
                        Kind::List(count, item) if p == list => {
                            self.index_list(property, (count, item), &piece, body)?
                        }
                        Kind::List(count, item) => {
                            body.items(spans[p].clone(), count, item, &mut items)?;
                            match numbers_per_corner(property, item, items.len(), corners.len()) {
                                Some(per) => self.corner_list(property, (count, item), &piece, &items, per, body)?,
                                None => {
                                    if !items.is_empty() {
                                        let name = String::from_utf8_lossy(&property.name);
                                        self.lists.insert(format!("'{name}' of faces"));
                                    }
                                    self.copy(spans[p].clone());
                                }
                            }
                        }
                        Kind::Number(_) => self.copy(spans[p].clone()),
                    }
                }
                // Numbers that the header does not announce.
                self.out.extend_from_slice(&self.bytes[last..end]);
            }
            // Without a new face its line goes, too.
            let end = if refined.pieces(face - 1).len() == 0 { body.position().0 } else { end };
            splice.replace(start..end, &self.out);
        }
        Ok(())
    }

    /// A list that holds so many numbers for each corner of a face, for the corners of a piece of it.
    fn corner_list(
        &mut self,
        property: &Property,
        (count, item): (Scalar, Scalar),
        piece: &Piece,
        items: &[Range<usize>],
        per: usize,
        body: &Body,
    ) -> Result<(), WriteError> {
        self.push_count(property, per * piece.vertices.len(), count, body)?;
        for (_, mix) in piece.corners() {
            for n in 0..per {
                let span = |k: u32| items[k as usize * per + n].clone();
                let is_one = mix.only().is_some();
                match mix.value(|k| body.finite(span(k), item).unwrap_or(f64::NAN)).filter(|_| !is_one) {
                    Some(x) => self.push(if is_float(item) { x } else { rounded(x) }, item, body),
                    None => self.copy(span(mix.heaviest())),
                }
            }
        }
        Ok(())
    }

    /// The indices of a piece.
    fn index_list(
        &mut self,
        property: &Property,
        (count, item): (Scalar, Scalar),
        piece: &Piece,
        body: &Body,
    ) -> Result<(), WriteError> {
        self.push_count(property, piece.vertices.len(), count, body)?;
        for &vertex in piece.vertices {
            check_range(property, u64::from(vertex), item)?;
            self.push(f64::from(vertex), item, body);
        }
        Ok(())
    }

    fn push_count(&mut self, property: &Property, len: usize, count: Scalar, body: &Body) -> Result<(), WriteError> {
        check_range(property, len as u64, count)?;
        self.push(len as f64, count, body);
        Ok(())
    }

    fn warnings(&self, kept: &[String]) -> Vec<String> {
        let quoted = || self.lists.iter().cloned().collect::<Vec<_>>().join(", ");
        let warnings = [
            (!self.lists.is_empty())
                .then(|| format!("Lists that are copied from old to added rows as they are: {}.", quoted())),
            (self.unmixed > 0).then(|| {
                format!(
                    "Added vertices with the normal of their nearest old vertex, because it cannot be mixed: {}.",
                    self.unmixed
                )
            }),
            (!kept.is_empty())
                .then(|| format!("Elements that stay as they are beside split faces: {}.", kept.join(", "))),
        ];
        warnings.into_iter().flatten().collect()
    }
}

/// Refuses a number that the list cannot hold as so typed.
fn check_range(property: &Property, value: u64, scalar: Scalar) -> Result<(), WriteError> {
    let limit = scalar.largest() as u64;
    let list = || String::from_utf8_lossy(&property.name).into_owned();
    if value > limit { Err(WriteError::ListRange { list: list(), value, limit }) } else { Ok(()) }
}

fn is_float(scalar: Scalar) -> bool {
    matches!(scalar, Scalar::F32 | Scalar::F64)
}

/// The nearest integer, never −0.
fn rounded(x: f64) -> f64 {
    x.round() + 0.0
}

/// The mixed number of an added vertex. `None` where it is that of its heaviest part.
fn mixed(property: &Property, scalar: Scalar, mix: &Mix, number: impl Fn(u32) -> f64) -> Option<f64> {
    let is_colour = || {
        let name = String::from_utf8_lossy(&property.name).to_lowercase();
        COLOUR_PREFIXES.iter().any(|prefix| name.strip_prefix(prefix).is_some_and(|rest| COLOURS.contains(&rest)))
    };
    if mix.only().is_some() {
        None
    } else if is_float(scalar) {
        mix.value(number)
    } else if is_colour() {
        mix.value(number).map(rounded)
    } else {
        None
    }
}

/// How many numbers a list of so many items holds for each corner of a face. `None` where it is none of corners.
fn numbers_per_corner(property: &Property, item: Scalar, items: usize, corners: usize) -> Option<usize> {
    let per = items / corners;
    let is_named = CORNER_LISTS.iter().any(|name| property.name.eq_ignore_ascii_case(name.as_bytes()));
    let is_one = per > 0 && items == per * corners && (is_named || is_float(item) && per == TEXTURE_NUMBERS);
    is_one.then_some(per)
}
