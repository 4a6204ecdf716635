//! Rows of one size in binary bodies of PLY files: the most common kind by far, read and written without a walk through every number.
//!
//! Whatever is not as it should be is left to the walk ([`crate::ply_body`]), which knows how to say it.

use glam::DVec3;

use crate::ply_header::{Element, Encoding, Kind, Scalar};

/// Rows of vertices whose coordinates are little-endian floats, at the same places in every row.
pub(crate) struct VertexRows {
    /// Bytes per row.
    stride: usize,
    /// Where x, y and z are in a row, and what.
    coordinates: [(usize, Scalar); 3],
}

impl VertexRows {
    /// The rows of `vertex`; `None` where they are not of this kind.
    pub(crate) fn of(vertex: &Element, encoding: Encoding) -> Option<Self> {
        let mut stride = 0;
        let mut coordinates = [(0, Scalar::I8); 3];
        for property in &vertex.properties {
            let Kind::Number(scalar) = property.kind else { return None };
            if let Some(axis) = [b"x", b"y", b"z"].iter().position(|name| property.name == *name) {
                coordinates[axis] = (stride, scalar);
            }
            stride += scalar.size();
        }
        let are_floats = coordinates.iter().all(|(_, scalar)| matches!(scalar, Scalar::F32 | Scalar::F64));
        (encoding == Encoding::LittleEndian && are_floats).then_some(Self { stride, coordinates })
    }

    /// The points in `count` rows from the first of `bytes` on, and how many bytes these are. `None` where a number is not finite or
    /// bytes are missing.
    pub(crate) fn points(&self, bytes: &[u8], count: usize) -> Option<(Vec<DVec3>, usize)> {
        let len = count.checked_mul(self.stride)?;
        let rows = bytes.get(..len)?.chunks_exact(self.stride);
        let number = |row: &[u8], (at, scalar): (usize, Scalar)| match scalar {
            Scalar::F32 => row[at..].first_chunk().map_or(f64::NAN, |x| f64::from(f32::from_le_bytes(*x))),
            _ => row[at..].first_chunk().map_or(f64::NAN, |x| f64::from_le_bytes(*x)),
        };
        let [x, y, z] = self.coordinates;
        let points: Vec<DVec3> = rows.map(|row| DVec3::new(number(row, x), number(row, y), number(row, z))).collect();
        points.iter().all(|p| p.is_finite()).then_some((points, len))
    }

    /// Puts the coordinates of `new` that are not those of `old` (both #rows) in place of those in `bytes`, which begin with the first row.
    /// `false` where bytes are missing; nothing is changed then.
    pub(crate) fn replace(&self, bytes: &mut [u8], old: &[DVec3], new: &[DVec3]) -> bool {
        let Some(rows) = new.len().checked_mul(self.stride).and_then(|len| bytes.get_mut(..len)) else { return false };
        for ((row, old), new) in rows.chunks_exact_mut(self.stride).zip(old).zip(new) {
            for (axis, &(at, scalar)) in self.coordinates.iter().enumerate() {
                if new[axis] == old[axis] {
                    continue;
                }
                match scalar {
                    Scalar::F32 => row[at..at + 4].copy_from_slice(&(new[axis] as f32).to_le_bytes()),
                    _ => row[at..at + 8].copy_from_slice(&new[axis].to_le_bytes()),
                }
            }
        }
        true
    }
}

/// The triangles in all rows of `element`, from the first of `bytes` on, among so many vertices; and how many bytes these are. `None`
/// where a row holds anything else.
pub(crate) fn triangles(
    element: &Element,
    encoding: Encoding,
    bytes: &[u8],
    vertices: u32,
) -> Option<(Vec<[u32; 3]>, usize)> {
    /// A count, and three indices.
    const STRIDE: usize = 1 + 3 * 4;
    let [list] = &element.properties[..] else { return None };
    let Kind::List(Scalar::U8 | Scalar::I8, Scalar::I32 | Scalar::U32) = list.kind else { return None };
    let count = usize::try_from(element.rows).ok().filter(|rows| *rows <= u32::MAX as usize / 3)?;
    let len = count.checked_mul(STRIDE)?;
    let rows = bytes.get(..len).filter(|_| encoding == Encoding::LittleEndian)?.as_chunks::<STRIDE>().0;
    if !rows.iter().all(|row| row[0] == 3) {
        return None;
    }
    let corner = |row: &[u8; STRIDE], at: usize| u32::from_le_bytes([row[at], row[at + 1], row[at + 2], row[at + 3]]);
    let triangles: Vec<[u32; 3]> = rows.iter().map(|row| [1, 5, 9].map(|at| corner(row, at))).collect();
    // Negative numbers are the largest.
    let is_known = triangles.as_flattened().iter().all(|v| *v < vertices);
    is_known.then_some((triangles, len))
}
