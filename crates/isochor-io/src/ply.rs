//! PLY, the polygon file format.
//!
//! Read: x, y and z of `vertex`, the lists of `face` or the strips of `tristrips`, ascii or binary. All else is walked
//! over and kept.

use std::ops::Range;

use glam::{DMat3, DVec3};
use isochor::{Faces, Mesh};

use isochor::Precision;

use crate::document::{Change, Parsed};
use crate::normal::carried_direction;
use crate::number::{Storage, quoted};
use crate::ply_body::Body;
use crate::ply_header::{self, Element, Encoding, Header, Kind, Property, Scalar};
use crate::ply_rows::{VertexRows, triangles};
use crate::splice::Splice;
use crate::{NumberType, Place, ReadError};

/// Where things stand in a PLY file.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    encoding: Encoding,
    pub(crate) vertex: Element,
    /// What each property of a vertex is for.
    pub(crate) roles: Vec<Role>,
    /// Types of x, y and z.
    scalars: [Scalar; 3],
    has_normals: bool,
    /// Where the rows of the vertices start: an offset, and the line where they are text.
    rows: (usize, usize),
    faces_in_file: usize,
}

/// What a property of a vertex is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// x, y or z: 0, 1 or 2.
    Coordinate(usize),
    /// nx, ny or nz: 0, 1 or 2.
    Normal(usize),
    Other,
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Parsed<Layout>, ReadError> {
    let header = ply_header::parse(bytes)?;
    let vertex = header.elements.iter().find(|e| e.name == b"vertex").ok_or_else(|| {
        ReadError::new("the header announces no element 'vertex'").with_hint("the file holds no model").at_line(1)
    })?;
    let vertices = u32::try_from(vertex.rows).map_err(|_| too_many_vertices(vertex))?;
    let scalars = coordinate_types(vertex)?;
    let (roles, has_normals) = roles(vertex);
    let polygons = polygons(&header)?;

    let mut body = Body::new(bytes, header.encoding, header.body);
    let (mut rows, mut points) = (header.body, Vec::new());
    let mut reader = FaceReader { vertices, faces: Faces::new(), skipped: None, degenerate: 0 };
    let encoding = header.encoding;
    for element in &header.elements {
        body.check_room(element, &header)?;
        if element.name == b"vertex" {
            rows = body.position();
            let plain = VertexRows::of(element, encoding);
            points = match plain.and_then(|plain| plain.points(body.ahead(), element.rows as usize)) {
                Some((points, len)) => {
                    body.step_over(len);
                    points
                }
                None => read_points(&mut body, element, &roles)?,
            };
        } else if let Some((_, list)) = polygons.filter(|(e, _)| std::ptr::eq(*e, element)) {
            let plain = (element.name == b"face").then(|| triangles(element, encoding, body.ahead(), vertices));
            match plain.flatten() {
                Some((triangles, len)) => {
                    body.step_over(len);
                    reader.faces = triangles.into();
                }
                None => reader.read(&mut body, element, list)?,
            }
        } else {
            body.skip_element(element)?;
        }
    }
    let mut warnings = warnings(&header, polygons.map(|(e, _)| e), &reader);
    warnings.extend(body.end()?);
    let faces_in_file = match polygons {
        Some((element, _)) if element.name == b"face" => element.rows as usize,
        _ => reader.faces.len(),
    };
    let mesh = Mesh::new(points, reader.faces).map_err(|error| ReadError::new(error.to_string()))?;
    let vertex = vertex.clone();
    let layout = Layout { encoding: header.encoding, vertex, roles, scalars, has_normals, rows, faces_in_file };
    Ok(Parsed { mesh, layout, warnings })
}

fn too_many_vertices(vertex: &Element) -> ReadError {
    ReadError::new(format!("{} vertices are announced, more than 4294967295", vertex.rows))
        .with_hint("the count is wrong, or the model must be split")
        .at_line(vertex.line)
}

/// Types of x, y and z.
fn coordinate_types(vertex: &Element) -> Result<[Scalar; 3], ReadError> {
    let mut scalars = [Scalar::F64; 3];
    for (scalar, name) in scalars.iter_mut().zip(["x", "y", "z"]) {
        *scalar = match vertex.property(name).map(|p| vertex.properties[p].kind) {
            Some(Kind::Number(scalar)) => scalar,
            Some(Kind::List(..)) => {
                let error = ReadError::new(format!("the property '{name}' of the vertices is a list"));
                return Err(error.with_hint("a vertex needs one number each of x, y and z").at_line(vertex.line));
            }
            None => {
                let error = ReadError::new(format!("the vertices have no property '{name}'"));
                return Err(error.with_hint("a vertex needs x, y and z").at_line(vertex.line));
            }
        };
    }
    Ok(scalars)
}

/// What each property of a vertex is for, and whether there are normals to carry: all three, and floats.
fn roles(vertex: &Element) -> (Vec<Role>, bool) {
    let is_float = |p: usize| matches!(vertex.properties[p].kind, Kind::Number(Scalar::F32 | Scalar::F64));
    let has_normals = ["nx", "ny", "nz"].iter().all(|name| vertex.property(name).is_some_and(is_float));
    let role = |property: &Property| match property.name.as_slice() {
        b"x" => Role::Coordinate(0),
        b"y" => Role::Coordinate(1),
        b"z" => Role::Coordinate(2),
        b"nx" if has_normals => Role::Normal(0),
        b"ny" if has_normals => Role::Normal(1),
        b"nz" if has_normals => Role::Normal(2),
        _ => Role::Other,
    };
    (vertex.properties.iter().map(role).collect(), has_normals)
}

/// The element that holds the polygons and which of its properties lists them: faces, or strips where there are none.
pub(crate) fn polygons(header: &Header) -> Result<Option<(&Element, usize)>, ReadError> {
    let rows_of = |name: &[u8]| header.elements.iter().find(|e| e.name == name && e.rows > 0);
    let Some(element) = rows_of(b"face").or_else(|| rows_of(b"tristrips")) else { return Ok(None) };
    let list = element.property("vertex_indices").or_else(|| element.property("vertex_index"));
    match list.map(|p| (p, element.properties[p].kind)) {
        Some((p, Kind::List(_, item))) if !matches!(item, Scalar::F32 | Scalar::F64) => Ok(Some((element, p))),
        Some(_) => {
            Err(ReadError::new(format!("the vertex indices of {} are no list of integers", quoted(&element.name)))
                .with_hint("write 'property list uchar int vertex_indices'")
                .at_line(element.line))
        }
        None => Err(ReadError::new(format!("{} has no list 'vertex_indices'", quoted(&element.name)))
            .with_hint("write 'property list uchar int vertex_indices'")
            .at_line(element.line)),
    }
}

fn read_points(body: &mut Body, vertex: &Element, roles: &[Role]) -> Result<Vec<DVec3>, ReadError> {
    let mut points = Vec::with_capacity(vertex.rows as usize);
    for _ in 0..vertex.rows {
        body.begin_row(vertex)?;
        let mut point = DVec3::ZERO;
        for (property, role) in vertex.properties.iter().zip(roles) {
            match (property.kind, role) {
                (Kind::Number(scalar), Role::Coordinate(axis)) => {
                    let span = body.span(scalar)?;
                    point[*axis] = body.finite(span, scalar)?;
                }
                (kind, _) => body.skip(kind)?,
            }
        }
        body.end_row(vertex)?;
        points.push(point);
    }
    Ok(points)
}

/// Reads faces or strips.
struct FaceReader {
    /// Number of vertices.
    vertices: u32,
    faces: Faces,
    /// Number of faces of less than three corners, and where the first stands.
    skipped: Option<(usize, Place)>,
    /// Number of triangles of strips that name a vertex twice.
    degenerate: usize,
}

impl FaceReader {
    fn read(&mut self, body: &mut Body, element: &Element, list: usize) -> Result<(), ReadError> {
        let rows = element.rows as usize;
        // Three corners for each face; not more than there are bytes, which `Body::check_room` made sure of.
        self.faces = Faces::with_capacity(rows, rows.saturating_mul(3).min(body.bytes_ahead()));
        let strips = element.name == b"tristrips";
        let (mut items, mut corners) = (Vec::new(), Vec::new());
        for _ in 0..rows {
            body.begin_row(element)?;
            let place = body.place();
            for (p, property) in element.properties.iter().enumerate() {
                match property.kind {
                    Kind::List(count, item) if p == list => body.list(count, item, &mut items)?,
                    kind => body.skip(kind)?,
                }
            }
            if !strips && items.len() < 3 {
                body.end_row(element)?;
            } else {
                body.end_loose_row(element);
            }
            if strips {
                self.push_strip(&items, place)?;
            } else {
                self.push_face(&items, &mut corners, place)?;
            }
        }
        Ok(())
    }

    fn vertex(&self, index: i64, place: Place) -> Result<u32, ReadError> {
        match u32::try_from(index) {
            Ok(vertex) if vertex < self.vertices => Ok(vertex),
            _ => {
                let what = format!("a face names vertex {index}, but there are {} vertices", self.vertices);
                let hint = "indices start at 0; the file may be damaged or of the other byte order";
                Err(ReadError::new(what).with_hint(hint).at(place))
            }
        }
    }

    fn push_face(&mut self, items: &[i64], corners: &mut Vec<u32>, place: Place) -> Result<(), ReadError> {
        corners.clear();
        for &item in items {
            corners.push(self.vertex(item, place)?);
        }
        if corners.len() < 3 {
            let (n, first) = self.skipped.unwrap_or((0, place));
            self.skipped = Some((n + 1, first));
            return Ok(());
        }
        self.push(corners, place)
    }

    /// The triangles of a strip: each corner with the two before it, every other one turned round. −1 starts anew.
    fn push_strip(&mut self, items: &[i64], place: Place) -> Result<(), ReadError> {
        for strip in items.split(|&item| item == -1) {
            for &item in strip {
                self.vertex(item, place)?;
            }
            for (k, triangle) in strip.windows(3).enumerate() {
                let [a, b, c] = [triangle[0] as u32, triangle[1] as u32, triangle[2] as u32];
                if a == b || b == c || c == a {
                    self.degenerate += 1;
                } else {
                    self.push(&if k % 2 == 0 { [a, b, c] } else { [b, a, c] }, place)?;
                }
            }
        }
        Ok(())
    }

    fn push(&mut self, corners: &[u32], place: Place) -> Result<(), ReadError> {
        if self.faces.corners().len() + corners.len() > u32::MAX as usize {
            return Err(ReadError::new("more than 4294967295 corners").with_hint("split the model").at(place));
        }
        self.faces.push(corners);
        Ok(())
    }
}

fn warnings(header: &Header, polygons: Option<&Element>, reader: &FaceReader) -> Vec<String> {
    let strips = header.elements.iter().any(|e| e.name == b"tristrips" && e.rows > 0);
    let unread_strips = strips && polygons.is_some_and(|e| e.name == b"face");
    let warnings = [
        reader
            .skipped
            .map(|(n, place)| format!("Faces of fewer than 3 corners that are not read: {n}, the first at {place}.")),
        (reader.degenerate > 0)
            .then(|| format!("Triangles of strips that name a vertex twice and are not read: {}.", reader.degenerate)),
        unread_strips.then(|| "The file holds faces and triangle strips; only the faces are read.".to_owned()),
    ];
    warnings.into_iter().flatten().collect()
}

/// A number of a vertex row, where it stands and what it is.
struct Entry {
    span: Range<usize>,
    role: Role,
    scalar: Scalar,
}

impl Layout {
    pub(crate) fn faces_in_file(&self) -> usize {
        self.faces_in_file
    }

    pub(crate) fn has_normals(&self) -> bool {
        self.has_normals
    }

    pub(crate) fn storage(&self) -> Storage {
        Storage { numbers: self.scalars.map(Scalar::number_type), text: self.encoding == Encoding::Text }
    }

    /// A copy of `bytes` with the change in it, and warnings.
    pub(crate) fn patched(&self, bytes: &[u8], change: &Change) -> Result<(Vec<u8>, Vec<String>), ReadError> {
        let is_plain = change.precision == Precision::File && (change.jacobians.is_none() || !self.has_normals);
        if let Some(rows) = VertexRows::of(&self.vertex, self.encoding).filter(|_| is_plain) {
            let mut patched = bytes.to_vec();
            if rows.replace(&mut patched[self.rows.0..], change.mesh.points(), change.stored) {
                return Ok((patched, Vec::new()));
            }
        }
        let mut splice = Splice::new(bytes);
        for (word, name) in self.widened(bytes, change.precision) {
            splice.replace(word, name);
        }
        let mut body = Body::new(bytes, self.encoding, self.rows);
        self.patch_rows(&mut body, change, &mut splice, |_| {})?;
        Ok((splice.finish(), Vec::new()))
    }

    /// Puts the change into the rows of the vertices, which `body` walks over; `each` hears where a row starts.
    pub(crate) fn patch_rows(
        &self,
        body: &mut Body,
        change: &Change,
        splice: &mut Splice,
        mut each: impl FnMut(usize),
    ) -> Result<(), ReadError> {
        let mut entries = Vec::with_capacity(6);
        let mut encoded = Vec::with_capacity(32);
        for vertex in 0..change.mesh.points().len() {
            body.begin_row(&self.vertex)?;
            each(body.position().0);
            self.read_entries(body, &mut entries)?;
            let normals = change.jacobians.filter(|_| self.has_normals);
            let normal = normals.and_then(|jacobians| carried_normal(body, &entries, &jacobians[vertex]));
            let (old, new) = (change.mesh.points()[vertex], change.stored[vertex]);
            for Entry { span, role, scalar } in entries.drain(..) {
                encoded.clear();
                match (role, normal) {
                    (Role::Coordinate(axis), _) => {
                        let widened = change.precision == Precision::F64 && scalar != Scalar::F64;
                        if new[axis] == old[axis] && (!widened || body.is_text()) {
                            continue;
                        }
                        body.encode(new[axis], if widened { Scalar::F64 } else { scalar }, &mut encoded);
                    }
                    (Role::Normal(axis), Some((old, new))) => {
                        if is_same(new[axis], old[axis], scalar) {
                            continue;
                        }
                        body.encode(new[axis], scalar, &mut encoded);
                    }
                    _ => continue,
                }
                splice.replace(span, &encoded);
            }
        }
        Ok(())
    }

    /// Words of the header and what is to stand in their place, so that x, y and z have the precision: `double`, or `float64` where types
    /// are spelled with their width.
    pub(crate) fn widened(&self, bytes: &[u8], precision: Precision) -> Vec<(Range<usize>, &'static [u8])> {
        let is_narrow = |(property, role): &(&Property, &Role)| {
            matches!(role, Role::Coordinate(_)) && property.kind != Kind::Number(Scalar::F64)
        };
        let all = self.vertex.properties.iter().zip(&self.roles);
        let narrow = all.filter(|pair| precision == Precision::F64 && is_narrow(pair));
        let widened = narrow.map(|(property, _)| {
            let word = property.type_word.clone();
            let with_width = bytes[word.clone()].last().is_some_and(u8::is_ascii_digit);
            (word, if with_width { &b"float64"[..] } else { b"double" })
        });
        widened.collect()
    }

    /// The coordinates and normals of the row, in the order of the file.
    fn read_entries(&self, body: &mut Body, entries: &mut Vec<Entry>) -> Result<(), ReadError> {
        for (property, &role) in self.vertex.properties.iter().zip(&self.roles) {
            match (property.kind, role) {
                (Kind::Number(scalar), Role::Coordinate(_) | Role::Normal(_)) => {
                    entries.push(Entry { span: body.span(scalar)?, role, scalar });
                }
                (kind, _) => body.skip(kind)?,
            }
        }
        body.end_row(&self.vertex)
    }
}

fn is_same(a: f64, b: f64, scalar: Scalar) -> bool {
    if scalar == Scalar::F32 { a as f32 == b as f32 } else { a == b }
}

/// The normal of a row before and after. `None` where it stays as it is.
fn carried_normal(body: &Body, entries: &[Entry], jacobian: &DMat3) -> Option<(DVec3, DVec3)> {
    if *jacobian == DMat3::IDENTITY {
        return None;
    }
    let mut old = DVec3::ZERO;
    for entry in entries {
        if let Role::Normal(axis) = entry.role {
            old[axis] = body.finite(entry.span.clone(), entry.scalar).ok()?;
        }
    }
    let new = carried_direction(old, jacobian)? * old.length();
    new.is_finite().then_some((old, new))
}

/// A plain little-endian PLY file.
pub(crate) fn new_file(points: &[DVec3], faces: &Faces, number: NumberType) -> Vec<u8> {
    let scalar = if number == NumberType::F32 { "float" } else { "double" };
    let long_faces = faces.iter().any(|face| face.len() > usize::from(u8::MAX));
    let count = if long_faces { "uint" } else { "uchar" };
    let index = if points.len() > i32::MAX as usize { "uint" } else { "int" };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty {scalar} x\nproperty {scalar} y\n\
         property {scalar} z\nelement face {}\nproperty list {count} {index} vertex_indices\nend_header\n",
        points.len(),
        faces.len()
    )
    .into_bytes();
    for x in points.iter().flat_map(|point| point.to_array()) {
        if number == NumberType::F32 {
            bytes.extend_from_slice(&(x as f32).to_le_bytes());
        } else {
            bytes.extend_from_slice(&x.to_le_bytes());
        }
    }
    for face in faces.iter() {
        if long_faces {
            bytes.extend_from_slice(&(face.len() as u32).to_le_bytes());
        } else {
            bytes.push(face.len() as u8);
        }
        for corner in face {
            bytes.extend_from_slice(&corner.to_le_bytes());
        }
    }
    bytes
}
