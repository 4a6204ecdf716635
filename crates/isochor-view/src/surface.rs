//! The surface that all poses share: triangles, and which of them meet where.

use glam::DVec3;
use isochor::{Faces, fan};
use rustc_hash::FxHashMap;

/// Triangles of polygons, fanned from their first corners, and which of them meet at each place.
///
/// Vertices at bit-equal places of the first pose count as one here, so that a surface that was torn along the seams of
/// a texture, or into single triangles, is smooth nevertheless.
pub(crate) struct Surface {
    /// Vertices of each triangle. All of them exist in every pose.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// For each vertex the first vertex at the same place.
    welded: Vec<u32>,
    /// The triangles at welded vertex v are `incident[starts[v]..starts[v + 1]]`.
    starts: Vec<u32>,
    incident: Vec<u32>,
}

impl Surface {
    /// The surface of `faces` over `points`, the first pose. Faces that name vertices beyond the first `vertices` are
    /// left out.
    pub(crate) fn new(faces: &Faces, points: &[DVec3], vertices: usize) -> Self {
        let exists = |corners: &[u32; 3]| corners.iter().all(|&v| (v as usize) < vertices);
        let mut triangles = Vec::with_capacity(faces.corners().len().saturating_sub(2 * faces.len()));
        triangles.extend(faces.iter().flat_map(fan).filter(exists));

        let mut first_at = FxHashMap::with_capacity_and_hasher(vertices, Default::default());
        let place = |p: &DVec3| p.to_array().map(|x| (x + 0.0).to_bits()); // −0 + 0 = 0
        let welded: Vec<u32> =
            points[..vertices].iter().zip(0..).map(|(p, v)| *first_at.entry(place(p)).or_insert(v)).collect();

        let mut starts = vec![0u32; vertices + 1];
        for &v in triangles.as_flattened() {
            starts[welded[v as usize] as usize + 1] += 1;
        }
        for v in 0..vertices {
            starts[v + 1] += starts[v];
        }
        let mut ends = starts.clone();
        let mut incident = vec![0u32; triangles.len() * 3];
        for (corners, t) in triangles.iter().zip(0u32..) {
            for &v in corners {
                let end = &mut ends[welded[v as usize] as usize];
                incident[*end as usize] = t;
                *end += 1;
            }
        }
        Self { triangles, welded, starts, incident }
    }

    /// Number of vertices that every pose has.
    pub(crate) fn vertices(&self) -> usize {
        self.welded.len()
    }

    /// The first vertex at the place of `vertex`.
    pub(crate) fn welded(&self, vertex: u32) -> usize {
        self.welded[vertex as usize] as usize
    }

    /// The triangles at a welded vertex.
    pub(crate) fn around(&self, welded: usize) -> &[u32] {
        &self.incident[self.starts[welded] as usize..self.starts[welded + 1] as usize]
    }
}
