//! Adaptive subdivision of a model that lies on a sheet: CO, section 3.2, figures 5 and 6.
//!
//! Three kinds of points are looked at: *vertex points*, the model's own; *edge points*, where its edges, projected on the flattened
//! sheet, cross grid lines; *face points*, the grid points within its projected faces. An edge point is kept where the surface curves
//! along the edge by more than a threshold. With it the other edge points of the same grid line on the same face are kept (figure 6 a);
//! where the surface curves along the grid line itself at a face point between them by more than the threshold, that face point is kept
//! too, and with it the edge points of the other grid line through it (figure 6 b); and so on, on every face that shares a marked edge
//! point, until nothing changes. So an edge point is kept on all faces that share the edge, and no crack opens.
//!
//! # Changes versus the paper
//!
//! - What curves is defined: |normal curvature| of the surface along the projected edge or grid line.
//! - Only edges that are longer than a crossed cell in grid coordinates have edge points ("if the size of the polygon of the model is
//!   larger than the size of the grid"), so that fine models do not get points that they do not need.
//! - Face points in a bump that no edge passes over mark grid lines too, each the one across that curved along which the surface does.
//! - The parts of a face between its points are triangles of a Delaunay triangulation, not cells: what was not kept needs no merging.
//! - Polygons that are flat are divided as a whole, all others as the fans that volumes are measured by. Faces seen edge-on have
//!   edge points, and are cut between them.

use glam::{DVec2, DVec3};

use crate::crossing::{Crossing, Grid, GridLine, orientation};
use crate::mesh::{Faces, Mesh, fan};
use crate::parallel;
use crate::refinement::Refinement;
use crate::sheet::Sheet;
use crate::triangulation::Border;

/// A model divided where its sheet curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Subdivision {
    /// The divided faces, and where new vertices come from: kept edge points, then kept face points.
    pub refinement: Refinement,
    /// Edge points, edge after edge.
    pub edge_points: Vec<SubdivisionPoint>,
    /// Face points, face after face.
    pub face_points: Vec<SubdivisionPoint>,
}

/// An edge or face point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SubdivisionPoint {
    /// Its place on the flattened sheet.
    pub flat: DVec2,
    /// Whether the model gets a vertex there.
    pub is_kept: bool,
}

/// Why a model cannot be divided.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SubdivideError {
    /// The threshold is negative or not a number.
    #[error("refine is {threshold}: it must be a curvature of at least 0, in 1/extent, or \"off\"")]
    Threshold {
        /// What was given.
        threshold: f64,
    },
    /// A placed point is not finite.
    #[error("vertex {vertex} lies at {position} on the sheet: coordinates must be finite")]
    NotFinite {
        /// Its index.
        vertex: usize,
        /// Where it is.
        position: DVec3,
    },
    /// More vertices than can be counted.
    #[error(
        "the divided model would have {vertices} vertices, more than can be counted: take a coarser grid or a higher threshold"
    )]
    TooMany {
        /// Their number.
        vertices: usize,
    },
}

/// Divides a model placed on a sheet (positions are x and y of the flattened grid, and height) where |normal curvature| is above
/// `threshold`, 1/length.
///
/// # Errors
///
/// A negative threshold, points that are not finite, more vertices than 2³².
pub fn subdivide(sheet: &Sheet, placed: &Mesh, threshold: f64) -> Result<Subdivision, SubdivideError> {
    if threshold.is_nan() || threshold < 0.0 {
        return Err(SubdivideError::Threshold { threshold });
    }
    let points = placed.points();
    if let Some(vertex) = points.iter().position(|p| !p.is_finite()) {
        return Err(SubdivideError::NotFinite { vertex, position: points[vertex] });
    }
    let mut division = Division::new(sheet, placed);
    division.mark(threshold);
    division.divided(placed)
}

/// A part of a face that is divided as a whole: a triangle, or a flat polygon.
struct Piece {
    face: u32,
    /// Its corners as positions in the face.
    corners: Vec<u32>,
    /// The edge from each corner to the next.
    edges: Vec<u32>,
}

/// An edge of pieces.
struct PieceEdge {
    /// Its ends, the smaller first.
    ends: [u32; 2],
    crossings: Vec<Crossing>,
    is_kept: Vec<bool>,
    /// Pieces at it.
    pieces: Vec<u32>,
}

/// A grid point within a piece.
struct FacePoint {
    at: [usize; 2],
    /// Curvature along `s = s_i` and `t = t_j` there.
    bends: [f64; 2],
    is_kept: bool,
}

impl FacePoint {
    fn lines(&self) -> [GridLine; 2] {
        [GridLine::OfS(self.at[0] as u32), GridLine::OfT(self.at[1] as u32)]
    }
}

struct Division<'a> {
    grid: Grid<'a>,
    pieces: Vec<Piece>,
    edges: Vec<PieceEdge>,
    /// Face points of each piece.
    within: Vec<Vec<FacePoint>>,
}

impl<'a> Division<'a> {
    fn new(sheet: &'a Sheet, placed: &Mesh) -> Self {
        let (points, faces) = (placed.points(), placed.faces());
        let flat = |v: u32| points[v as usize].truncate();
        let grid = Grid::new(sheet);
        let mut pieces: Vec<Piece> = Vec::with_capacity(faces.len());
        for (f, face) in faces.iter().enumerate() {
            let piece = |corners: Vec<u32>| Piece { face: f as u32, edges: Vec::with_capacity(corners.len()), corners };
            let positions: Vec<u32> = (0..face.len() as u32).collect();
            if face.len() > 3 && !is_flat_and_simple(face, points) {
                pieces.extend(fan(&positions).map(|triangle| piece(triangle.to_vec())));
            } else {
                pieces.push(piece(positions));
            }
        }
        // Edges by their ends; each piece's edges find theirs by their places in the sorted list.
        let mut sides: Vec<([u32; 2], u32, u32)> = Vec::new();
        for (p, piece) in pieces.iter().enumerate() {
            let face = faces.face(piece.face as usize);
            for k in 0..piece.corners.len() {
                let [a, b] = [piece.corners[k], piece.corners[(k + 1) % piece.corners.len()]].map(|c| face[c as usize]);
                sides.push(([a.min(b), a.max(b)], p as u32, k as u32));
            }
        }
        sides.sort_unstable();
        let runs: Vec<_> = sides.chunk_by(|a, b| a.0 == b.0).collect();
        let edges: Vec<PieceEdge> = parallel::collect(runs.len(), |e| {
            let ends = runs[e][0].0;
            let crossings = grid.crossings(flat(ends[0]), flat(ends[1]));
            let pieces = if crossings.is_empty() { Vec::new() } else { runs[e].iter().map(|side| side.1).collect() };
            PieceEdge { ends, is_kept: vec![false; crossings.len()], crossings, pieces }
        });
        for piece in &mut pieces {
            piece.edges.resize(piece.corners.len(), 0);
        }
        for (e, run) in runs.iter().enumerate() {
            for (_, piece, k) in *run {
                pieces[*piece as usize].edges[*k as usize] = e as u32;
            }
        }
        let within = parallel::collect(pieces.len(), |p| {
            let piece = &pieces[p];
            if piece.edges.iter().all(|e| edges[*e as usize].crossings.is_empty()) {
                return Vec::new();
            }
            let face = faces.face(piece.face as usize);
            let polygon: Vec<DVec2> = piece.corners.iter().map(|c| flat(face[*c as usize])).collect();
            let found = grid.points_within(&polygon).into_iter();
            found.map(|at| FacePoint { at, bends: grid.bends(at), is_kept: false }).collect()
        });
        Self { grid, pieces, edges, within }
    }

    /// Marks what must be kept.
    fn mark(&mut self, threshold: f64) {
        // Grid lines that are kept on a piece.
        let mut kept: Vec<Vec<GridLine>> = vec![Vec::new(); self.pieces.len()];
        let mut open: Vec<(usize, GridLine)> = Vec::new();
        for edge in &self.edges {
            for crossing in edge.crossings.iter().filter(|crossing| crossing.bend > threshold) {
                let lines = || crossing.lines.iter().copied();
                open.extend(edge.pieces.iter().flat_map(|p| lines().map(move |line| (*p as usize, line))));
            }
        }
        for (p, points) in self.within.iter().enumerate() {
            for point in points {
                let [of_s, of_t] = point.lines();
                let across = [(point.bends[0], of_t), (point.bends[1], of_s)];
                open.extend(across.iter().filter(|(bend, _)| *bend > threshold).map(|(_, line)| (p, *line)));
            }
        }
        while let Some((p, line)) = open.pop() {
            if kept[p].contains(&line) {
                continue;
            }
            kept[p].push(line);
            for e in &self.pieces[p].edges {
                let PieceEdge { crossings, is_kept, pieces, .. } = &mut self.edges[*e as usize];
                for (crossing, is_kept) in crossings.iter().zip(is_kept) {
                    if crossing.lines.contains(&line) && !std::mem::replace(is_kept, true) {
                        let lines = || crossing.lines.iter().copied();
                        open.extend(pieces.iter().flat_map(|p| lines().map(move |line| (*p as usize, line))));
                    }
                }
            }
            for point in &mut self.within[p] {
                let along = point.lines().iter().position(|other| *other == line);
                point.is_kept |= along.is_some_and(|along| point.bends[along] > threshold);
            }
        }
    }

    fn divided(self, placed: &Mesh) -> Result<Subdivision, SubdivideError> {
        let (points, faces) = (placed.points(), placed.faces());
        let flat = |v: u32| points[v as usize].truncate();
        // Kept edge points are numbered after the vertices, edge after edge; then kept face points, piece after piece.
        let mut next = points.len();
        let mut first = |count: usize| {
            let first = next;
            next += count;
            first
        };
        let count = |kept: &[bool]| kept.iter().filter(|is_kept| **is_kept).count();
        let first_of_edge: Vec<usize> = self.edges.iter().map(|edge| first(count(&edge.is_kept))).collect();
        let first_of_piece: Vec<usize> =
            self.within.iter().map(|within| first(within.iter().filter(|point| point.is_kept).count())).collect();
        if u32::try_from(next).is_err() {
            return Err(SubdivideError::TooMany { vertices: next });
        }
        let mut refinement = Refinement::default();
        let (mut edge_points, mut face_points) = (Vec::new(), Vec::new());
        for PieceEdge { ends: [a, b], crossings, is_kept, .. } in &self.edges {
            for (crossing, is_kept) in crossings.iter().zip(is_kept) {
                let place = flat(*a).lerp(flat(*b), crossing.along);
                edge_points.push(SubdivisionPoint { flat: place, is_kept: *is_kept });
                if *is_kept {
                    refinement.vertices.push([(*a, 1.0 - crossing.along), (*b, crossing.along), (*a, 0.0)]);
                }
            }
        }
        let cut: Vec<Option<Cut>> =
            parallel::collect(self.pieces.len(), |p| self.cut(p, points, faces, &first_of_edge, first_of_piece[p]));
        let mut pieces = self.pieces.iter().zip(cut).zip(&self.within).peekable();
        for (f, face) in faces.iter().enumerate() {
            let mut of_face = Vec::new();
            while let Some(((piece, cut), within)) = pieces.next_if(|((piece, _), _)| piece.face as usize == f) {
                let kept = within.iter().map(|p| SubdivisionPoint { flat: self.grid.place(p.at), is_kept: p.is_kept });
                face_points.extend(kept);
                if let Some(cut) = &cut {
                    refinement.vertices.extend(cut.inside.iter().map(|mix| mix.map(|(c, w)| (face[c as usize], w))));
                }
                of_face.push((piece, cut));
            }
            let mut push = |corners: &[(u32, [(u32, f64); 3])]| {
                refinement.faces.push(&corners.iter().map(|(vertex, _)| *vertex).collect::<Vec<_>>());
                refinement.origins.push(f as u32);
                refinement.corners.extend(corners.iter().map(|(_, mix)| *mix));
            };
            let whole = |c: u32| (face[c as usize], [(c, 1.0), (c, 0.0), (c, 0.0)]);
            if of_face.iter().all(|(_, cut)| cut.is_none()) {
                push(&(0..face.len() as u32).map(whole).collect::<Vec<_>>());
                continue;
            }
            for (piece, cut) in of_face {
                match cut {
                    None => push(&piece.corners.iter().map(|c| whole(*c)).collect::<Vec<_>>()),
                    Some(cut) => cut.triangles.iter().for_each(|t| push(&t.map(|c| cut.corners[c as usize]))),
                }
            }
        }
        Ok(Subdivision { refinement, edge_points, face_points })
    }

    /// A piece between its points; `None` where it has none beside its corners.
    fn cut(
        &self,
        p: usize,
        points: &[DVec3],
        faces: &Faces,
        first_of_edge: &[usize],
        first_of_piece: usize,
    ) -> Option<Cut> {
        let piece = &self.pieces[p];
        let face = faces.face(piece.face as usize);
        let inside: Vec<&FacePoint> = self.within[p].iter().filter(|point| point.is_kept).collect();
        let mut corners = Vec::new();
        let mut along: Vec<Vec<f64>> = Vec::with_capacity(piece.corners.len());
        for (k, e) in piece.edges.iter().enumerate() {
            let (corner, next) = (piece.corners[k], piece.corners[(k + 1) % piece.corners.len()]);
            corners.push((face[corner as usize], [(corner, 1.0), (corner, 0.0), (corner, 0.0)]));
            let edge = &self.edges[*e as usize];
            let kept = edge.crossings.iter().zip(&edge.is_kept).filter(|(_, is_kept)| **is_kept);
            let kept = kept.zip(first_of_edge[*e as usize] as u32..).map(|((crossing, _), v)| (v, crossing.along));
            let is_forward = face[corner as usize] == edge.ends[0];
            let mut on_edge: Vec<(u32, f64)> =
                kept.map(|(v, part)| (v, if is_forward { part } else { 1.0 - part })).collect();
            if !is_forward {
                on_edge.reverse();
            }
            corners.extend(on_edge.iter().map(|(v, part)| (*v, [(corner, 1.0 - part), (next, *part), (corner, 0.0)])));
            along.push(on_edge.into_iter().map(|(_, part)| part).collect());
        }
        if inside.is_empty() && along.iter().all(Vec::is_empty) {
            return None;
        }
        // In the plane of the piece, lengths as they are.
        let position =
            |mix: &[(u32, f64); 3]| mix.iter().map(|(c, w)| points[face[*c as usize] as usize] * *w).sum::<DVec3>();
        let origin = points[face[piece.corners[0] as usize] as usize];
        let normal = area_vector(&piece.corners.iter().map(|c| points[face[*c as usize] as usize]).collect::<Vec<_>>());
        let normal = normal.try_normalize().unwrap_or(DVec3::Z);
        let (x, y) = normal.any_orthonormal_pair();
        let in_plane = |mix: &[(u32, f64); 3]| {
            let d = position(mix) - origin;
            DVec2::new(d.dot(x), d.dot(y))
        };
        let mixes: Vec<[(u32, f64); 3]> = inside.iter().map(|point| self.mix(piece, face, points, point)).collect();
        let whole = |corner: &u32| in_plane(&[(*corner, 1.0), (*corner, 0.0), (*corner, 0.0)]);
        let border = Border {
            corners: piece.corners.iter().map(whole).collect(),
            along,
            inside: mixes.iter().map(in_plane).collect(),
        };
        let triangles = border.triangles();
        corners.extend((first_of_piece as u32..).zip(mixes.iter().copied()));
        Some(Cut { corners, inside: mixes, triangles })
    }

    /// A face point as a mix of corners of its face: barycentric coordinates of its place in the fan of the projected piece.
    fn mix(&self, piece: &Piece, face: &[u32], points: &[DVec3], point: &FacePoint) -> [(u32, f64); 3] {
        let place = self.grid.place(point.at);
        let weights = |triangle: [u32; 3]| {
            let [a, b, c] = triangle.map(|corner| points[face[corner as usize] as usize].truncate());
            let area = (b - a).perp_dot(c - a);
            let (of_b, of_c) = ((place - a).perp_dot(c - a) / area, (b - a).perp_dot(place - a) / area);
            let least = of_b.min(of_c).min(1.0 - of_b - of_c);
            (least, [(triangle[0], 1.0 - of_b - of_c), (triangle[1], of_b), (triangle[2], of_c)])
        };
        // The triangle that it is in, or that it is least outside of by rounding.
        let best = fan(&piece.corners).map(weights).max_by(|a, b| a.0.total_cmp(&b.0));
        best.expect("a piece has three corners").1.map(|(corner, weight)| (corner, weight.clamp(0.0, 1.0)))
    }
}

/// The parts of a piece.
struct Cut {
    /// Points on its border, then inside: vertex, and the mix of the face's corners.
    corners: Vec<(u32, [(u32, f64); 3])>,
    /// Mixes of the face's corners for those inside.
    inside: Vec<[(u32, f64); 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Twice the area of a polygon along its normal.
fn area_vector(corners: &[DVec3]) -> DVec3 {
    let origin = corners[0];
    corners.windows(2).map(|pair| (pair[0] - origin).cross(pair[1] - origin)).sum()
}

/// Whether a polygon lies in a plane to rounding, has a turn at every corner, and does not meet itself. Large ones are not looked at.
fn is_flat_and_simple(face: &[u32], points: &[DVec3]) -> bool {
    /// Distance from the plane, and least sine at a corner. More: polygons change shape; less: rounded ones are divided as fans.
    const ROUNDING: f64 = 1e-12;
    /// Corners at most: all pairs of sides are compared.
    const MOST: usize = 64;
    let n = face.len();
    let corners: Vec<DVec3> = face.iter().map(|v| points[*v as usize]).collect();
    let Some(normal) = area_vector(&corners).try_normalize() else { return false };
    let extent = corners.iter().map(|p| p.distance(corners[0])).fold(0.0, f64::max);
    let (x, y) = normal.any_orthonormal_pair();
    let flat: Vec<DVec2> = corners.iter().map(|p| *p - corners[0]).map(|d| DVec2::new(d.dot(x), d.dot(y))).collect();
    let side = |k: usize| [flat[k % n], flat[(k + 1) % n]];
    let is_turn = |k: usize| {
        let [[a, b], [_, c]] = [side(k), side(k + 1)];
        (b - a).perp_dot(c - b).abs() > ROUNDING * a.distance(b) * b.distance(c)
    };
    let is_apart = |k: usize, other: usize| {
        let ([a, b], [c, d]) = (side(k), side(other));
        orientation(a, b, c) * orientation(a, b, d) > 0.0 || orientation(c, d, a) * orientation(c, d, b) > 0.0
    };
    n <= MOST
        && corners.iter().all(|p| (*p - corners[0]).dot(normal).abs() <= ROUNDING * extent)
        && (0..n).all(is_turn)
        && (0..n).all(|k| (k + 2..n).all(|other| (other + 1) % n == k || is_apart(k, other)))
}
