//! A model file: its bytes and the mesh in it.

use std::path::Path;

use glam::{DMat3, DVec3};
use isochor::{Mesh, Precision, Refinement};

use crate::number::{Storage, rounded, stored_points};
use crate::refined::Refined;
use crate::{Format, NumberType, ReadError, WriteError, obj, off, ply, stl};

/// A model file that keeps everything it holds but positions and normals.
///
/// It owns the bytes of the file. [`Document::with_points`] copies them and replaces only the numbers that changed.
#[derive(Clone, Debug)]
pub struct Document {
    bytes: Vec<u8>,
    mesh: Mesh,
    warnings: Vec<String>,
    layout: Layout,
}

#[derive(Clone, Debug)]
enum Layout {
    Obj(obj::Layout),
    Ply(ply::Layout),
    Stl(stl::Layout),
    Off(off::Layout),
}

/// What a parser found in a file.
pub(crate) struct Parsed<L> {
    pub(crate) mesh: Mesh,
    pub(crate) layout: L,
    pub(crate) warnings: Vec<String>,
}

/// What a writer is to put into a copy of the file.
pub(crate) struct Change<'a> {
    /// The mesh that was read.
    pub(crate) mesh: &'a Mesh,
    /// New positions, #vertices, as the file can hold them, and those of added vertices behind. Where one equals the old one, its bytes
    /// stay.
    pub(crate) stored: &'a [DVec3],
    /// Jacobians, for each position one, that carry the normals.
    pub(crate) jacobians: Option<&'a [DMat3]>,
    pub(crate) precision: Precision,
}

/// How [`Document::with_points`] writes.
#[derive(Clone, Copy, Debug, Default)]
pub struct WriteOptions<'a> {
    /// Number type of the coordinates.
    pub precision: Precision,
    /// ∂(deformed)/∂(rest) at each vertex, #vertices. Vertex normals are carried by them: direction cof(J) n, length
    /// as before. Without them vertex normals stay as they are. Facet normals of STL files do not need them.
    /// [`Document::refined`] takes those of added vertices behind.
    pub jacobians: Option<&'a [DMat3]>,
}

/// A file with other points.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// The whole file.
    pub bytes: Vec<u8>,
    /// The points in it, #vertices, after rounding to its number type: what reading it gives.
    pub points: Vec<DVec3>,
    /// What may surprise, a sentence each.
    pub warnings: Vec<String>,
}

impl Document {
    /// Reads the file at `path`; its extension tells the format.
    ///
    /// # Errors
    ///
    /// An unknown extension, a file that cannot be read, and as [`Document::parse`]. The error names the path.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let format = Format::from_path(path)?;
        let bytes = std::fs::read(path).map_err(|error| ReadError::io(path, error))?;
        Self::parse(bytes, format).map_err(|error| error.in_file(path))
    }

    /// Reads a file from its bytes.
    ///
    /// # Errors
    ///
    /// Anything that would make the mesh another one than its author's: numbers that are not finite, rows too short or
    /// too long, indices out of range, counts that do not fit the bytes, a file of another format, no bytes at all. The
    /// error tells the line or byte offset and what to do.
    pub fn parse(bytes: Vec<u8>, format: Format) -> Result<Self, ReadError> {
        if bytes.is_empty() {
            return Err(ReadError::new("the file is empty").with_hint("export or copy it again"));
        }
        let other = Format::of_bytes(&bytes).filter(|other| *other != format).map(Format::name);
        Self::parse_any(bytes, format).map_err(|error| match other {
            Some(name) => error.with_hint(format!("it looks like {name}: name it .{name}")),
            None => error,
        })
    }

    fn parse_any(bytes: Vec<u8>, format: Format) -> Result<Self, ReadError> {
        fn split<L>(parsed: Parsed<L>, wrap: fn(L) -> Layout) -> (Mesh, Layout, Vec<String>) {
            (parsed.mesh, wrap(parsed.layout), parsed.warnings)
        }
        let (mesh, layout, mut warnings) = match format {
            Format::Obj => split(obj::parse(&bytes)?, Layout::Obj),
            Format::Ply => split(ply::parse(&bytes)?, Layout::Ply),
            Format::Stl => split(stl::parse(&bytes)?, Layout::Stl),
            Format::Off => split(off::parse(&bytes)?, Layout::Off),
        };
        let repeating = mesh.faces().iter().filter(|face| repeats(face)).count();
        if repeating > 0 {
            warnings.push(format!("Faces that name a vertex more than once: {repeating}."));
        }
        Ok(Self { bytes, mesh, warnings, layout })
    }

    /// A new, plain file of `mesh`: OBJ or OFF text, little-endian PLY, or binary STL (polygons fanned from their first corner).
    ///
    /// The points are rounded to `number`. An STL document welds corners at one place, so its vertices are numbered
    /// anew and those that no face uses are gone.
    ///
    /// # Errors
    ///
    /// [`NumberType::Integer`]; 64-bit floats for STL; a coordinate beyond 32-bit floats; more triangles than an STL
    /// file can count.
    pub fn from_mesh(mesh: &Mesh, format: Format, number: NumberType) -> Result<Self, WriteError> {
        if number == NumberType::Integer {
            return Err(WriteError::NewInteger);
        }
        if format == Format::Stl && number == NumberType::F64 {
            return Err(WriteError::StlPrecision);
        }
        let mut points = mesh.points().to_vec();
        for (vertex, point) in points.iter_mut().enumerate() {
            for axis in 0..3 {
                point[axis] = rounded(point[axis], number, vertex, axis)?;
            }
        }
        let bytes = match format {
            Format::Obj => obj::new_file(&points, mesh.faces(), number),
            Format::Ply => ply::new_file(&points, mesh.faces(), number),
            Format::Stl => stl::new_file(&points, mesh.faces())?,
            Format::Off => off::new_file(&points, mesh.faces(), number),
        };
        Ok(Self::parse_any(bytes, format)?)
    }

    /// The mesh in the file. Vertices keep the order of the file, faces too.
    ///
    /// The corners of an STL file that stand at one place (0 is −0) are one vertex; vertices are numbered by their first
    /// appearance.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The format of the file.
    #[must_use]
    pub fn format(&self) -> Format {
        match self.layout {
            Layout::Obj(_) => Format::Obj,
            Layout::Ply(_) => Format::Ply,
            Layout::Stl(_) => Format::Stl,
            Layout::Off(_) => Format::Off,
        }
    }

    /// The whole file.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Number of vertices in the file: 3 for each facet of an STL file, else those of the mesh.
    #[must_use]
    pub fn vertices_in_file(&self) -> usize {
        match &self.layout {
            Layout::Stl(layout) => 3 * layout.facets(),
            _ => self.mesh.points().len(),
        }
    }

    /// Number of faces in the file, with those that were skipped. Triangle strips count as their triangles.
    #[must_use]
    pub fn faces_in_file(&self) -> usize {
        match &self.layout {
            Layout::Obj(layout) => layout.faces_in_file(),
            Layout::Ply(layout) => layout.faces_in_file(),
            Layout::Stl(layout) => layout.facets(),
            Layout::Off(layout) => layout.faces_in_file(),
        }
    }

    /// What the file stores coordinates as; the weakest where x, y and z differ (integer, then 32-bit, then 64-bit).
    #[must_use]
    pub fn number_type(&self) -> NumberType {
        let numbers = self.storage(Precision::File).numbers;
        let weakest = [NumberType::Integer, NumberType::F32].into_iter().find(|n| numbers.contains(n));
        weakest.unwrap_or(NumberType::F64)
    }

    /// Whether there are vertex normals that [`Document::with_points`] carries.
    #[must_use]
    pub fn has_normals(&self) -> bool {
        match &self.layout {
            Layout::Obj(layout) => layout.has_normals(),
            Layout::Ply(layout) => layout.has_normals(),
            Layout::Stl(_) => false,
            Layout::Off(layout) => layout.has_normals(),
        }
    }

    /// Oddities that were read past, a sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The file with `points` (#vertices of [`Document::mesh`]) in place of its points.
    ///
    /// A coordinate that equals the one that was read, or rounds to it, keeps its bytes; so does everything that is
    /// neither a coordinate nor a normal. Facet normals of STL files are recomputed where a corner moved, by the
    /// right-hand rule from the points that are written; those that were 0 0 0 stay so.
    ///
    /// # Errors
    ///
    /// Not one point or Jacobian for each vertex; a number that is not finite; a coordinate beyond the 32-bit floats of
    /// the file; a changed coordinate that the file holds as an integer; [`Precision::F64`] for STL.
    pub fn with_points(&self, points: &[DVec3], options: &WriteOptions) -> Result<Written, WriteError> {
        self.written(points, None, options)
    }

    /// The file with the faces of `refinement` in place of its faces and with `points`, those of added vertices behind those of
    /// [`Document::mesh`], in place of its points. Jacobians, too, are those of all vertices.
    ///
    /// Old vertices are written as by [`Document::with_points`] and keep their indices. Faces stand where the old ones stood, so groups,
    /// materials, objects and comments keep their meaning; faces that stay as they were keep their bytes. What vertices, corners and faces
    /// carry goes on to added ones:
    ///
    /// - Colours, texture coordinates and other floats are mixed. Normals are mixed as directions, carried by the Jacobian of their vertex, and
    ///   of length 1.
    /// - OBJ: corners that are one old corner keep its texture coordinate and normal; mixed ones that come out bit-equal share a line. New lines
    ///   stand behind the last old line of their kind and behind all statements that count back. A corner is without what one of its old
    ///   corners is without.
    /// - PLY, vertices: integers that are colours (red, green, blue, alpha, gray, intensity, and such) are mixed and rounded to the nearest;
    ///   other integers, which may be labels, and lists are those of the old vertex of most weight, of equal ones the first.
    /// - PLY, faces: lists of floats with two numbers for each corner, and lists named `texcoord`, `uv` or `color` with any number, are mixed for
    ///   each corner. All else is that of the old face.
    /// - STL: facets have three corners, so larger faces are fanned. Attributes are those of the old facet, normals are computed (0 0 0 stays).
    ///   Reading the file numbers its vertices anew.
    /// - OFF: colours that are whole numbers from 0 to 255 are rounded to the nearest; what stands behind the position without being announced is
    ///   that of the old vertex of most weight. Faces have the colour of their old face. A number of edges becomes 0, which says nothing.
    ///
    /// Statements and elements that name vertices beside the faces (lines, edges, curves) stay as they are. `warnings` say what could not be
    /// carried on.
    ///
    /// # Errors
    ///
    /// As [`Document::with_points`]; a refinement of another mesh, or with weights that are no mix; triangle strips that are to be split; lists
    /// of a PLY file whose types are too small; an OBJ file that names vertices, texture coordinates or normals that it has not, where
    /// added ones would take their place; more facets than an STL file can count.
    pub fn refined(
        &self,
        points: &[DVec3],
        refinement: &Refinement,
        options: &WriteOptions,
    ) -> Result<Written, WriteError> {
        let refined = Refined::new(&self.mesh, refinement)?;
        self.written(points, Some(&refined), options)
    }

    /// The file with other points, and other faces where there are any.
    fn written(
        &self,
        points: &[DVec3],
        refined: Option<&Refined>,
        options: &WriteOptions,
    ) -> Result<Written, WriteError> {
        let vertices = self.mesh.points().len() + refined.map_or(0, |refined| refined.added().len());
        if points.len() != vertices {
            return Err(WriteError::PointCount { points: points.len(), vertices });
        }
        if let Some(jacobians) = options.jacobians {
            if jacobians.len() != vertices {
                return Err(WriteError::JacobianCount { jacobians: jacobians.len(), vertices });
            }
            if let Some(vertex) = jacobians.iter().position(|j| !j.is_finite()) {
                return Err(WriteError::JacobianNotFinite { vertex });
            }
        }
        if options.precision == Precision::F64 && self.format() == Format::Stl {
            return Err(WriteError::StlPrecision);
        }
        let stored = stored_points(&self.mesh, points, &self.storage(options.precision))?;
        let change =
            Change { mesh: &self.mesh, stored: &stored, jacobians: options.jacobians, precision: options.precision };
        let refined = refined.filter(|refined| refined.added().len() > 0 || !refined.keeps_all());
        let (bytes, warnings) = match (&self.layout, refined) {
            (Layout::Obj(layout), _) => layout.patched(&self.bytes, &change, refined)?,
            (Layout::Ply(layout), None) => layout.patched(&self.bytes, &change)?,
            (Layout::Ply(layout), Some(refined)) => layout.refined(&self.bytes, &change, refined)?,
            (Layout::Stl(layout), None) => layout.patched(&self.bytes, &change)?,
            (Layout::Stl(layout), Some(refined)) => layout.refined(&self.bytes, &change, refined)?,
            (Layout::Off(layout), None) => layout.patched(&self.bytes, &change),
            (Layout::Off(layout), Some(refined)) => layout.refined(&self.bytes, &change, refined)?,
        };
        Ok(Written { bytes, points: stored, warnings })
    }

    fn storage(&self, precision: Precision) -> Storage {
        match (&self.layout, precision) {
            (Layout::Obj(_) | Layout::Off(_), _) => Storage { numbers: [NumberType::F64; 3], text: true },
            (Layout::Ply(layout), Precision::File) => layout.storage(),
            (Layout::Ply(layout), Precision::F64) => Storage { numbers: [NumberType::F64; 3], ..layout.storage() },
            (Layout::Stl(layout), _) => Storage { numbers: [NumberType::F32; 3], text: layout.is_text() },
        }
    }
}

/// Corners up to which looking at all pairs is faster than sorting.
const FEW_CORNERS: usize = 8;

/// Whether a polygon names a vertex more than once.
fn repeats(polygon: &[u32]) -> bool {
    if polygon.len() <= FEW_CORNERS {
        return (1..polygon.len()).any(|k| polygon[..k].contains(&polygon[k]));
    }
    let mut sorted = polygon.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}
