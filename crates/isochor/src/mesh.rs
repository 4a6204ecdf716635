//! Polygon meshes: points and faces, nothing else.
//!
//! What a file holds beside them (normals, texture coordinates, groups, comments) stays with the document that was
//! read; the mathematics needs only this.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use crate::parallel;

/// Polygons as lists of corner indices, stored one after the other.
///
/// A face with corners `c0 c1 c2 … ck` stands for the triangle fan `(c0 c1 c2) (c0 c2 c3) …`, at rest and posed alike.
/// Corners run counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    corners: Vec<u32>,
    /// Where each face ends in `corners`; empty where all faces are triangles.
    ends: Vec<u32>,
}

impl Faces {
    /// No faces.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// No faces yet, with room for `faces` faces of `corners` corners in all.
    #[must_use]
    pub fn with_capacity(faces: usize, corners: usize) -> Self {
        let ends = if corners == faces.saturating_mul(3) { 0 } else { faces };
        Self { corners: Vec::with_capacity(corners), ends: Vec::with_capacity(ends) }
    }

    /// Appends a face.
    ///
    /// # Panics
    ///
    /// Panics where all faces together would have more than `u32::MAX` corners.
    pub fn push(&mut self, corners: &[u32]) {
        if self.are_triangles() && corners.len() != 3 {
            self.ends.extend((1..=self.len() as u32).map(|f| 3 * f));
        }
        let is_mixed = !self.are_triangles() || corners.len() != 3;
        self.corners.extend_from_slice(corners);
        let end = u32::try_from(self.corners.len()).expect("a mesh has at most u32::MAX corners");
        if is_mixed {
            self.ends.push(end);
        }
    }

    /// Number of faces.
    #[must_use]
    pub fn len(&self) -> usize {
        if self.are_triangles() { self.corners.len() / 3 } else { self.ends.len() }
    }

    /// Whether there is no face.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether all faces have three corners.
    #[must_use]
    pub fn are_triangles(&self) -> bool {
        self.ends.is_empty()
    }

    /// Where in [`Faces::corners`] those of face `f` are.
    #[inline]
    pub(crate) fn range(&self, f: usize) -> Range<usize> {
        if self.are_triangles() {
            return 3 * f..3 * f + 3;
        }
        let start = if f == 0 { 0 } else { self.ends[f - 1] as usize };
        start..self.ends[f] as usize
    }

    /// Corner indices of face `f`.
    ///
    /// # Panics
    ///
    /// Panics where `f` is not less than [`Faces::len`].
    #[must_use]
    pub fn face(&self, f: usize) -> &[u32] {
        &self.corners[self.range(f)]
    }

    /// All faces in order.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.len()).map(|f| self.face(f))
    }

    /// Corner indices of all faces, one after the other.
    #[must_use]
    pub fn corners(&self) -> &[u32] {
        &self.corners
    }
}

impl From<Vec<[u32; 3]>> for Faces {
    /// Triangles, without copying them.
    ///
    /// # Panics
    ///
    /// Panics where they have more than `u32::MAX` corners.
    fn from(triangles: Vec<[u32; 3]>) -> Self {
        let corners = triangles.into_flattened();
        assert!(u32::try_from(corners.len()).is_ok(), "a mesh has at most u32::MAX corners");
        Self { corners, ends: Vec::new() }
    }
}

impl<'a> FromIterator<&'a [u32]> for Faces {
    fn from_iter<I: IntoIterator<Item = &'a [u32]>>(faces: I) -> Self {
        let mut all = Self::new();
        for face in faces {
            all.push(face);
        }
        all
    }
}

impl<'a, const K: usize> FromIterator<&'a [u32; K]> for Faces {
    fn from_iter<I: IntoIterator<Item = &'a [u32; K]>>(faces: I) -> Self {
        faces.into_iter().map(|face| &face[..]).collect()
    }
}

/// The triangles of one polygon, fanned from its first corner.
pub fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    (2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]])
}

/// Points (#vertices × 3, finite, any length unit) and the faces between them.
///
/// Clones, and meshes of the same faces over other points, share what they have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    points: Arc<Vec<DVec3>>,
    faces: Arc<Faces>,
}

/// Why points and faces do not make a [`Mesh`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex} is at ({}, {}, {}): coordinates must be finite", .position.x, .position.y, .position.z)]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// Its position.
        position: DVec3,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are only {vertices} vertices (0 to {})", .vertices.saturating_sub(1))]
    MissingVertex {
        /// Index of the face.
        face: usize,
        /// The index it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A face has fewer than three corners.
    #[error("face {face} has {corners} corners: a polygon needs at least 3")]
    TooFewCorners {
        /// Index of the face.
        face: usize,
        /// Number of its corners.
        corners: usize,
    },
}

impl Mesh {
    /// A mesh of `points` (#vertices × 3) and `faces` that index them.
    ///
    /// # Errors
    ///
    /// A coordinate that is not finite, a face with fewer than three corners, an index beyond the points.
    pub fn new(points: Vec<DVec3>, faces: Faces) -> Result<Self, MeshError> {
        check_points(&points)?;
        let wrong = |range: Range<usize>| range.into_iter().find(|&f| !is_polygon(faces.face(f), points.len()));
        let wrong = parallel::map_chunks(faces.len(), parallel::CHUNK, wrong);
        if let Some(f) = wrong.into_iter().flatten().next() {
            let face = faces.face(f);
            let missing = face.iter().find(|v| **v as usize >= points.len());
            return Err(match missing {
                Some(&vertex) if face.len() >= 3 => {
                    MeshError::MissingVertex { face: f, vertex, vertices: points.len() }
                }
                _ => MeshError::TooFewCorners { face: f, corners: face.len() },
            });
        }
        Ok(Self { points: Arc::new(points), faces: Arc::new(faces) })
    }

    /// The points, #vertices × 3.
    #[must_use]
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The faces.
    #[must_use]
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// The same faces over other points.
    ///
    /// # Errors
    ///
    /// As [`Mesh::new`].
    pub fn with_points(&self, points: Vec<DVec3>) -> Result<Self, MeshError> {
        if points.len() < self.points.len() {
            return Self::new(points, Faces::clone(&self.faces));
        }
        check_points(&points)?;
        Ok(Self { points: Arc::new(points), faces: Arc::clone(&self.faces) })
    }

    /// The faces, to be kept beside the mesh.
    pub(crate) fn shared_faces(&self) -> Arc<Faces> {
        Arc::clone(&self.faces)
    }

    /// The points, to be kept beside the mesh.
    pub(crate) fn shared_points(&self) -> Arc<Vec<DVec3>> {
        Arc::clone(&self.points)
    }

    /// Bounding box of all points, used by a face or not. `None` without points.
    #[must_use]
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(&self.points)
    }
}

fn check_points(points: &[DVec3]) -> Result<(), MeshError> {
    if Bounds::of(points).is_none_or(|bounds| bounds.is_finite()) {
        return Ok(());
    }
    match points.iter().position(|p| !p.is_finite()) {
        Some(vertex) => Err(MeshError::NotFinite { vertex, position: points[vertex] }),
        None => Ok(()),
    }
}

/// Whether a face has at least three corners, all of them among so many vertices.
fn is_polygon(face: &[u32], vertices: usize) -> bool {
    face.len() >= 3 && face.iter().all(|v| (*v as usize) < vertices)
}

/// An axis-parallel box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lowest corner.
    pub min: DVec3,
    /// Highest corner.
    pub max: DVec3,
}

impl Bounds {
    /// The smallest box round `points`, not finite where one of them is not. `None` without points.
    #[must_use]
    pub fn of(points: &[DVec3]) -> Option<Self> {
        let spans = parallel::map_chunks(points.len(), parallel::CHUNK, |range| {
            points[range].iter().fold(Span::EMPTY, |span, p| span.with(*p))
        });
        Self::of_spans(points.len(), &spans)
    }

    /// The box of `out`, filled with `len` points `point(i)`; `None` without points.
    pub(crate) fn filled(
        out: &mut Vec<DVec3>,
        len: usize,
        point: impl Fn(usize) -> DVec3 + Send + Sync,
    ) -> Option<Self> {
        parallel::resize(out, len);
        let spans = parallel::map_parts(out, parallel::CHUNK, |first, part| {
            // Apart from each other: where points come from all over memory, a loop that does nothing else waits for more of them at once.
            part.iter_mut().zip(first..).for_each(|(p, i)| *p = point(i));
            part.iter().fold(Span::EMPTY, |span, p| span.with(*p))
        });
        Self::of_spans(len, &spans)
    }

    fn of_spans(points: usize, spans: &[Span]) -> Option<Self> {
        let all = spans.iter().fold(Span::EMPTY, |all, span| Span {
            min: DVec3::select(span.min.cmplt(all.min), span.min, all.min),
            max: DVec3::select(span.max.cmpgt(all.max), span.max, all.max),
            zero: all.zero + span.zero,
        });
        (points > 0).then_some(Self { min: all.min + all.zero, max: all.max + all.zero })
    }

    /// Whether all corners are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// Edge lengths of the box.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The *extent*: the longest side. All tolerances are relative to it.
    #[must_use]
    pub fn extent(&self) -> f64 {
        self.size().max_element()
    }

    /// Middle of the box.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        self.min + self.size() / 2.0
    }

    /// An origin near the points from which their coordinates are **exact** in f64: `p − origin` does not round.
    ///
    /// Per axis it is the middle of the box where the box is at least its own width away from 0 (then `origin/2 ≤ p ≤
    /// 2·origin`, and the difference is exact by Sterbenz's lemma), and 0 elsewhere. Coordinates relative to it are at
    /// most 1.5 widths of the box.
    #[must_use]
    pub fn lossless_origin(&self) -> DVec3 {
        let (center, size) = (self.center(), self.size());
        DVec3::from_array(std::array::from_fn(|a| if center[a].abs() >= size[a] { center[a] } else { 0.0 }))
    }
}

/// A box that grows.
#[derive(Clone, Copy)]
struct Span {
    min: DVec3,
    max: DVec3,
    /// 0, or not a number where a point was not finite: comparisons pass over that.
    zero: DVec3,
}

impl Span {
    const EMPTY: Self =
        Self { min: DVec3::splat(f64::INFINITY), max: DVec3::splat(f64::NEG_INFINITY), zero: DVec3::ZERO };

    #[inline]
    fn with(self, p: DVec3) -> Self {
        Self {
            min: DVec3::select(p.cmplt(self.min), p, self.min),
            max: DVec3::select(p.cmpgt(self.max), p, self.max),
            zero: self.zero + p * 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_the_same_however_they_were_listed() {
        let lists: [&[&[u32]]; 5] = [
            &[],
            &[&[0, 1, 2], &[2, 1, 3]],
            &[&[0, 1, 2], &[0, 1, 2, 3], &[1, 2, 3]],
            &[&[0, 1, 2, 3]],
            &[&[], &[0, 1, 2]],
        ];
        for list in lists {
            let faces: Faces = list.iter().copied().collect();
            let mut roomy = Faces::with_capacity(10, 40);
            list.iter().for_each(|face| roomy.push(face));
            assert_eq!(faces, roomy);
            assert_eq!((faces.len(), faces.is_empty()), (list.len(), list.is_empty()));
            assert!(faces.iter().eq(list.iter().copied()));
            assert_eq!(faces.corners(), list.concat());
            assert_eq!(faces.are_triangles(), list.iter().all(|face| face.len() == 3));
        }
        assert_eq!(Faces::from(vec![[0, 1, 2], [2, 1, 3]]), lists[1].iter().copied().collect());
    }

    #[test]
    fn a_box_is_finite_where_all_points_are() {
        let points = [DVec3::ZERO, DVec3::new(1.0, -2.0, 3.0), DVec3::splat(0.5)];
        let bounds = Bounds::of(&points).unwrap();
        assert_eq!((bounds.min, bounds.max), (DVec3::new(0.0, -2.0, 0.0), DVec3::new(1.0, 0.5, 3.0)));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for (point, axis) in [(0, 0), (1, 1), (2, 2)] {
                let mut points = points;
                points[point][axis] = bad;
                assert!(!Bounds::of(&points).unwrap().is_finite(), "{bad} at {point}");
            }
        }
    }
}
