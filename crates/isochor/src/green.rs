//! Green coordinates: points by the vertices and the normals of a closed cage of triangles.
//!
//! Problem: with φ_i(p) for each vertex and ψ_j(p) for each triangle, such that `p = Σ φ_i v_i + Σ ψ_j n_j` with the unit normals n of
//! the cage at rest, a pose v′ of the vertices deforms what is inside by
//!
//! ```text
//! f(p) = Σ φ_i v′_i + Σ ψ_j s_j n′_j,   s² = (|u′|²|w|² − 2 (u′·w′)(u·w) + |w′|²|u|²) / (8 area²),
//! ```
//!
//! (Y. Lipman, D. Levin, D. Cohen-Or, *Green coordinates*, ACM Trans. Graph. 27 (2008)): u and w are two edges of a triangle, the stretch s
//! scales its normal. Rotations, shifts and uniform scalings of the cage are those of the points. f is linear in the vertices and the
//! stretched normals m = s n′, not in the vertices alone.
//!
//! Coordinates are Green's third identity for a linear function: with the hat function Γ_i of vertex i and r = |q − p|,
//!
//! ```text
//! φ_i = 1/4π Σ_T ∫_T Γ_i n·(q − p)/r³,   ψ_j = 1/4π ∫_j 1/r.
//! ```
//!
//! *Changes versus the paper*: instead of its appendix, the closed forms of potential theory (D. R. Wilton et al., *Potential integrals for uniform and
//! linear source distributions on polygonal and polyhedral domains*, IEEE Trans. Antennas Propag. 32 (1984)). For a triangle let h be n·(v − p), positive
//! where p is behind it; Ω its solid angle with the sign of h ([`crate::shells`]), ν_e the outward normal of a side in its plane, d_e =
//! ν_e·(v_e − p), and for the side from a to b of length l
//!
//! ```text
//! L_e = ∫_e 1/r = ln((|a| + |b| + l)/(|a| + |b| − l)),   a, b as seen from p.
//! ∫ 1/r = Σ_e d_e L_e − h Ω
//! ∫ Γ_i n·(q − p)/r³ = Γ_i Ω − h Σ_e (∇Γ_i·ν_e) L_e,   Γ_i = d_i/h_i,   ∇Γ_i = −ν_i/h_i,
//! ```
//!
//! with Γ_i at the foot of p; side i is opposite corner i, h_i the triangle's height over it. L_e and |a| are shared by the triangles round an
//! edge or a vertex. L_e cancels near an edge; there
//!
//! ```text
//! (|a| + |b| + l)/(|a| + |b| − l) = (|a| + |b| + l)² (|a||b| − a·b) / (2 |a × b|²)   where a·b < 0,
//!                                 = (|a| + |b| + l)² / (2 (|a||b| + a·b))            else.
//! ```
//!
//! On an edge L_e is infinite and only multiplied by zeros (d_e L_e → 0, h L_e → 0); it is set to 0.
//!
//! **On the cage and outside.** Each triangle adds Ω/4π times a combination that reproduces p, and what is left cancels edge by edge. So Σ φ is the
//! winding number w = Σ Ω/4π, and p is reproduced w times, *whatever rounding did to Ω*. What is missing, 1 − w, is given to
//! the coordinates of p in the frame of the closest triangle: its Γ_i, and −h for ψ. Outside (w = 0) that is the paper's continuation through a
//! face (section 4). On a face, an edge or a vertex, where the Ω of those that touch p are anything, it gives the limit from inside, because
//! the frames of all of them agree there. The map is continuous across the cage; far outside it jumps where another triangle becomes the closest.
//! Of several that are equally close, as beyond an edge, that counts over whose plane p is highest.
//!
//! **Derivatives** with respect to p: `∇h = −n`, `∇d_e = −ν_e`, and with `q = |a||b| + a·b`
//!
//! ```text
//! ∇L_e = l/q (a/|a| + b/|b|),   ∇Ω = Σ_e (a × b) (|a| + |b|) / (|a||b| q),   ∇∫1/r = n Ω − Σ_e ν_e L_e.
//! ```
//!
//! They have no limit on edges. Nothing is fused, four points go side by side and chunks are fixed, so bits do not depend on the processor, the
//! number of threads or the other points.

use std::f64::consts::TAU;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4};
use glam::{DMat3, DVec3};

use crate::cage::Cage;
use crate::closest::closest_on_triangle;
use crate::elementary::{atan2, ln_of_quotient};
use crate::{parallel, tolerances};

/// Points that are taken at a time.
const LANES: usize = 4;

/// Points in a chunk: many enough for one allocation of what is seen from them, few enough for all threads. A multiple of [`LANES`].
const POINTS: usize = 256;

const FOUR_PI: f64 = 2.0 * TAU;

/// A number for each of the points.
type Four = [f64; LANES];

/// A vector for each of the points, packed.
type Vectors<S> = [f64x4<S>; 3];

/// A cage at rest, prepared.
struct Rest<'a> {
    cage: &'a Cage,
    edges: Vec<Edge>,
    faces: Vec<Face>,
}

/// An edge of the cage.
struct Edge {
    ends: [usize; 2],
    /// From the first to the second, unit.
    along: DVec3,
    length: f64,
}

/// A triangle of the cage. Side i is opposite corner i.
struct Face {
    corners: [usize; 3],
    edges: [usize; 3],
    /// 1, or −1 where the triangle runs the edge backwards.
    directions: [f64; 3],
    normal: DVec3,
    doubled_area: f64,
    /// Unit normals of the sides in the plane, outward: ν.
    across: [DVec3; 3],
    /// 1/(height over the side): Γ_i = slope_i · d_i.
    slopes: [f64; 3],
    /// ν_1·ν_2, ν_2·ν_0, ν_0·ν_1.
    cosines: [f64; 3],
}

impl<'a> Rest<'a> {
    fn of(cage: &'a Cage) -> Self {
        let edges = cage.edges().iter().map(|ends| {
            let ends = ends.map(|v| v as usize);
            let edge = cage.vertices()[ends[1]] - cage.vertices()[ends[0]];
            Edge { ends, along: edge.normalize(), length: edge.length() }
        });
        let faces = (0..cage.triangles().len()).map(|t| {
            let [a, b, c] = cage.corners(t);
            let sides = [c - b, a - c, b - a];
            let (lengths, doubled) = (sides.map(DVec3::length), sides[2].cross(-sides[1]));
            let (doubled_area, normal) = (doubled.length(), doubled.normalize());
            let across = [0, 1, 2].map(|i| (sides[i] / lengths[i]).cross(normal));
            let opposite = [1, 2, 0].map(|i| cage.sides()[t][i]);
            Face {
                corners: cage.triangles()[t].map(|v| v as usize),
                edges: opposite.map(|side| side.edge as usize),
                directions: opposite.map(|side| if side.is_backward { -1.0 } else { 1.0 }),
                normal,
                doubled_area,
                across,
                slopes: lengths.map(|length| length / doubled_area),
                cosines: [across[1].dot(across[2]), across[2].dot(across[0]), across[0].dot(across[1])],
            }
        });
        Self { cage, edges: edges.collect(), faces: faces.collect() }
    }

    /// Brings together what `kernel`s share: all vertices and edges as seen from four points.
    #[inline(always)]
    fn see<S: Simd>(&self, simd: S, points: &[DVec3; LANES], seen: &mut Seen) {
        let coordinates = [0, 1, 2].map(|x| points.map(|p| p[x]));
        let [x, y, z] = [
            f64x4::from_slice(simd, &coordinates[0]),
            f64x4::from_slice(simd, &coordinates[1]),
            f64x4::from_slice(simd, &coordinates[2]),
        ];
        for (v, seen) in self.cage.vertices().iter().zip(&mut seen.vertices) {
            let to = [f64x4::splat(simd, v.x) - x, f64x4::splat(simd, v.y) - y, f64x4::splat(simd, v.z) - z];
            seen.set(to, dot(&to, &to).sqrt());
        }
        let (zero, one) = (f64x4::splat(simd, 0.0), f64x4::splat(simd, 1.0));
        for (Edge { ends, along, length }, edge) in self.edges.iter().zip(&mut seen.edges) {
            let ((a, ra), (b, rb)) = (seen.vertices[ends[0]].of(simd), seen.vertices[ends[1]].of(simd));
            let (rr, ab, away) = (ra * rb, dot(&a, &b), cross(&a, *along));
            let sum = ra + rb + *length;
            let is_between = ab.simd_lt(zero);
            let n = sum * sum * is_between.select((rr - ab) * (1.0 / (length * length)), one);
            let d = is_between.select(dot(&away, &away), rr + ab) * 2.0;
            // Nearer than about 1e-125 lengths the point is on the edge, where products with L are 0.
            let is_apart = d.simd_gt(n * 1e-250);
            is_apart.select(ln_of_quotient(simd, n, d), zero).store_slice(&mut edge.logarithm);
            ab.store_slice(&mut edge.product);
        }
    }

    /// What is missing of a point of winding number `w` is given to the frame of a triangle; `None` where nothing is.
    fn missing(&self, p: DVec3, w: f64) -> Option<(f64, usize)> {
        let missing = 1.0 - w;
        (missing.abs() > tolerances::WHOLE_WINDING).then(|| (missing, self.closest_frame(p)))
    }

    /// The triangle whose frame continues the coordinates to `p`: the closest, of several the one over whose plane `p` is highest.
    fn closest_frame(&self, p: DVec3) -> usize {
        /// Distances that differ by less, relative to the extent, are the same. Larger: a triangle that is not the closest takes its place near
        /// the border of its realm; smaller: beyond an edge rounding decides between its triangles.
        const SAME: f64 = 1e-12;
        let distance = |t: usize| {
            let corners = self.cage.corners(t).map(|v| v - p);
            let weights = closest_on_triangle(DVec3::ZERO, corners);
            weights.iter().zip(corners).map(|(w, c)| *w * c).sum::<DVec3>().length()
        };
        let distances: Vec<f64> = (0..self.faces.len()).map(distance).collect();
        let most = distances.iter().copied().fold(f64::INFINITY, f64::min) + SAME * self.cage.extent();
        let height = |t: usize| self.height(t, p).abs();
        let close = (0..self.faces.len()).filter(|&t| distances[t] <= most);
        close.min_by(|s, t| height(*t).total_cmp(&height(*s))).unwrap_or(0) // none for a point that is not finite
    }

    /// How high `p` is over the plane of a triangle: −h.
    fn height(&self, triangle: usize, p: DVec3) -> f64 {
        let face = &self.faces[triangle];
        face.normal.dot(p - self.cage.vertices()[face.corners[0]])
    }

    /// Γ at the foot of `p` in the plane of a triangle; they sum to 1.
    fn barycentric(&self, triangle: usize, p: DVec3) -> [f64; 3] {
        let face = &self.faces[triangle];
        let at = |i: usize| {
            let d = face.across[i].dot(self.cage.vertices()[face.corners[(i + 1) % 3]] - p);
            face.slopes[i] * d
        };
        let [y, z] = [at(1), at(2)];
        [1.0 - y - z, y, z]
    }

    /// φ and ψ of some points, as [`fill_green`].
    #[inline(always)]
    fn fill<S: Simd>(&self, simd: S, points: &[DVec3], stride: usize, out: &mut [f64]) {
        let mut seen = Seen::new(self);
        let (vertices, faces) = (self.cage.vertices().len(), self.faces.len());
        let (mut phi, mut psi) = (vec![[0.0; LANES]; vertices], vec![[0.0; LANES]; faces]);
        for (points, rows) in points.chunks(LANES).zip(out.chunks_mut(LANES * stride)) {
            self.see(simd, &padded(points), &mut seen);
            let windings = self.coordinates(simd, &seen, &mut phi, &mut psi);
            for (lane, (p, row)) in points.iter().zip(rows.chunks_mut(stride)).enumerate() {
                let (of_vertices, of_faces) = row[..vertices + faces].split_at_mut(vertices);
                of_vertices.iter_mut().zip(&phi).for_each(|(out, phi)| *out = phi[lane]);
                of_faces.iter_mut().zip(&psi).for_each(|(out, psi)| *out = psi[lane]);
                if let Some((missing, t)) = self.missing(*p, windings[lane]) {
                    let barycentric = self.barycentric(t, *p);
                    self.faces[t].corners.iter().zip(barycentric).for_each(|(v, x)| of_vertices[*v] += missing * x);
                    of_faces[t] += missing * self.height(t, *p);
                }
            }
        }
    }

    /// φ (#vertices) and ψ (#triangles) of four points by the integrals alone; returns their winding numbers.
    #[inline(always)]
    fn coordinates<S: Simd>(&self, simd: S, seen: &Seen, phi: &mut [Four], psi: &mut [Four]) -> Four {
        phi.fill([0.0; LANES]);
        let mut winding = f64x4::splat(simd, 0.0);
        for (face, psi) in self.faces.iter().zip(psi) {
            let View { h, angle, distances: d, logarithms: l } = face.view(simd, seen);
            winding += angle;
            let flux = [
                l[0] + l[1] * face.cosines[2] + l[2] * face.cosines[1],
                l[0] * face.cosines[2] + l[1] + l[2] * face.cosines[0],
                l[0] * face.cosines[1] + l[1] * face.cosines[0] + l[2],
            ];
            for i in 0..3 {
                let sum = &mut phi[face.corners[i]];
                let of_face = (d[i] * angle + h * flux[i]) * (face.slopes[i] / FOUR_PI);
                (f64x4::from_slice(simd, sum) + of_face).store_slice(sum);
            }
            let potential = d[0] * l[0] + d[1] * l[1] + d[2] * l[2] - h * angle;
            (potential * (1.0 / FOUR_PI)).store_slice(psi);
        }
        let mut windings = [0.0; LANES];
        (winding * (1.0 / FOUR_PI)).store_slice(&mut windings);
        windings
    }

    /// The Jacobian matrices of some points away from the cage's edges.
    #[inline(always)]
    fn jacobians<S: Simd>(&self, simd: S, points: &[DVec3], posed: &[PosedFace]) -> Vec<DMat3> {
        let mut seen = Seen::new(self);
        let mut jacobians = Vec::with_capacity(points.len());
        for points in points.chunks(LANES) {
            self.see(simd, &padded(points), &mut seen);
            self.see_slopes(simd, &mut seen);
            let (sums, windings) = self.jacobian(simd, &seen, posed);
            for (lane, p) in points.iter().enumerate() {
                let column = |k: usize| DVec3::from_array([0, 1, 2].map(|x| sums[3 * x + k][lane]));
                let mut jacobian = DMat3::from_cols(column(0), column(1), column(2));
                if let Some((missing, t)) = self.missing(*p, windings[lane]) {
                    jacobian += (posed[t].linear + outer(posed[t].stretched, self.faces[t].normal)) * missing;
                }
                jacobians.push(jacobian);
            }
        }
        jacobians
    }

    /// Adds the derivatives of what [`Rest::see`] has brought together.
    #[inline(always)]
    fn see_slopes<S: Simd>(&self, simd: S, seen: &mut Seen) {
        let zero = f64x4::splat(simd, 0.0);
        for ((Edge { ends, along, length }, edge), slopes) in self.edges.iter().zip(&seen.edges).zip(&mut seen.slopes) {
            let ((a, ra), (b, rb)) = (seen.vertices[ends[0]].of(simd), seen.vertices[ends[1]].of(simd));
            let (rr, ab, away) = (ra * rb, f64x4::from_slice(simd, &edge.product), cross(&a, *along));
            let near = dot(&away, &away) * (length * length) / (rr - ab);
            let q = ab.simd_lt(zero).select(near, rr + ab);
            let turn = (ra + rb) * *length / (rr * q);
            let pull = f64x4::splat(simd, *length) / q;
            for x in 0..3 {
                (away[x] * turn).store_slice(&mut slopes.angle[x]);
                (pull * (a[x] / ra + b[x] / rb)).store_slice(&mut slopes.logarithm[x]);
            }
        }
    }

    /// The Jacobian matrices (entry 3x + k: ∂f_x/∂p_k) of four points by the integrals alone, and their winding numbers.
    #[inline(always)]
    fn jacobian<S: Simd>(&self, simd: S, seen: &Seen, posed: &[PosedFace]) -> ([Four; 9], Four) {
        let zero = f64x4::splat(simd, 0.0);
        let (mut sums, mut winding) = ([zero; 9], zero);
        for (face, posed) in self.faces.iter().zip(posed) {
            let Part { angle, jacobian, .. } = face.part(simd, seen, posed);
            winding += angle;
            for (sum, part) in sums.iter_mut().zip(jacobian) {
                *sum += part;
            }
        }
        let (mut out, mut windings) = ([[0.0; LANES]; 9], [0.0; LANES]);
        for (sum, out) in sums.iter().zip(&mut out) {
            (*sum * (1.0 / FOUR_PI)).store_slice(out);
        }
        (winding * (1.0 / FOUR_PI)).store_slice(&mut windings);
        (out, windings)
    }

    /// ∇φ (#vertices) and ∇ψ (#triangles) of some points away from the cage's edges, one point after the other. `units` are the triangles with
    /// corners at x, y and z and normals of no length.
    #[inline(always)]
    fn gradients<S: Simd>(&self, simd: S, points: &[DVec3], units: &[PosedFace], out: &mut [DVec3]) {
        let mut seen = Seen::new(self);
        let (vertices, faces) = (self.cage.vertices().len(), self.faces.len());
        out.fill(DVec3::ZERO);
        for (points, rows) in points.chunks(LANES).zip(out.chunks_mut(LANES * (vertices + faces))) {
            self.see(simd, &padded(points), &mut seen);
            self.see_slopes(simd, &mut seen);
            let mut windings = [0.0; LANES];
            for (t, (face, unit)) in self.faces.iter().zip(units).enumerate() {
                let Part { angle, jacobian, of_potential } = face.part(simd, &seen, unit);
                let (mut of_corners, mut of_face, mut seen_angle) =
                    ([[0.0; LANES]; 9], [[0.0; LANES]; 3], [0.0; LANES]);
                for (part, out) in jacobian.iter().zip(&mut of_corners) {
                    (*part * (1.0 / FOUR_PI)).store_slice(out);
                }
                for (part, out) in of_potential.iter().zip(&mut of_face) {
                    (*part * (1.0 / FOUR_PI)).store_slice(out);
                }
                (angle * (1.0 / FOUR_PI)).store_slice(&mut seen_angle);
                for (lane, row) in rows.chunks_mut(vertices + faces).enumerate() {
                    for (i, v) in face.corners.iter().enumerate() {
                        row[*v] += DVec3::from_array([0, 1, 2].map(|k| of_corners[3 * i + k][lane]));
                    }
                    row[vertices + t] = DVec3::from_array([0, 1, 2].map(|k| of_face[k][lane]));
                    windings[lane] += seen_angle[lane];
                }
            }
            for ((p, row), winding) in points.iter().zip(rows.chunks_mut(vertices + faces)).zip(windings) {
                if let Some((missing, t)) = self.missing(*p, winding) {
                    let face = &self.faces[t];
                    for (i, v) in face.corners.iter().enumerate() {
                        row[*v] += missing * units[t].linear.row(i);
                    }
                    row[vertices + t] += missing * face.normal;
                }
            }
        }
    }
}

/// What is seen from four points.
struct Seen {
    vertices: Vec<SeenVertex>,
    edges: Vec<SeenEdge>,
    slopes: Vec<Slopes>,
}

/// A vertex less the points, x, y and z, and its distances.
#[derive(Clone, Default)]
struct SeenVertex([Four; 4]);

/// An edge: the scalar product of its ends as seen from the points, and L.
#[derive(Clone, Default)]
struct SeenEdge {
    product: Four,
    logarithm: Four,
}

/// What an edge adds to ∇Ω where it is run forwards, and ∇L.
#[derive(Clone, Default)]
struct Slopes {
    angle: [Four; 3],
    logarithm: [Four; 3],
}

impl Seen {
    fn new(rest: &Rest) -> Self {
        Self {
            vertices: vec![SeenVertex::default(); rest.cage.vertices().len()],
            edges: vec![SeenEdge::default(); rest.edges.len()],
            slopes: vec![Slopes::default(); rest.edges.len()],
        }
    }
}

impl SeenVertex {
    #[inline(always)]
    fn set<S: Simd>(&mut self, [x, y, z]: Vectors<S>, distance: f64x4<S>) {
        x.store_slice(&mut self.0[0]);
        y.store_slice(&mut self.0[1]);
        z.store_slice(&mut self.0[2]);
        distance.store_slice(&mut self.0[3]);
    }

    #[inline(always)]
    fn of<S: Simd>(&self, simd: S) -> (Vectors<S>, f64x4<S>) {
        let [x, y, z, distance] = &self.0;
        let vector = [f64x4::from_slice(simd, x), f64x4::from_slice(simd, y), f64x4::from_slice(simd, z)];
        (vector, f64x4::from_slice(simd, distance))
    }
}

/// A triangle as seen from four points: h, Ω, and d and L of its sides.
struct View<S: Simd> {
    h: f64x4<S>,
    angle: f64x4<S>,
    distances: [f64x4<S>; 3],
    logarithms: [f64x4<S>; 3],
}

/// What a triangle adds to derivatives at four points, times 4 π.
struct Part<S: Simd> {
    /// The angle under which it is seen: Ω.
    angle: f64x4<S>,
    /// To ∂f_x/∂p_k, entry 3x + k.
    jacobian: [f64x4<S>; 9],
    /// ∇∫1/r = n Ω − Σ ν L
    of_potential: [f64x4<S>; 3],
}

impl Face {
    #[inline(always)]
    fn part<S: Simd>(&self, simd: S, seen: &Seen, posed: &PosedFace) -> Part<S> {
        let zero = f64x4::splat(simd, 0.0);
        let View { h, angle, distances: d, logarithms: l } = self.view(simd, seen);
        // ∇Ω
        let mut of_angle = [zero; 3];
        let n = self.normal.to_array();
        let mut of_potential = [angle * n[0], angle * n[1], angle * n[2]];
        for (i, logarithm) in l.iter().enumerate() {
            let (slopes, across) = (&seen.slopes[self.edges[i]], self.across[i].to_array());
            for k in 0..3 {
                of_angle[k] += f64x4::from_slice(simd, &slopes.angle[k]) * self.directions[i];
                of_potential[k] -= *logarithm * across[k];
            }
        }
        // (Γ v′) ⊗ ∇Ω + D Ω + (Σ Dν L) ⊗ n − h Σ Dν ⊗ ∇L + m ⊗ ∇∫1/r
        let mut jacobian = [zero; 9];
        for x in 0..3 {
            let foot = d[0] * (self.slopes[0] * posed.corners[0][x])
                + d[1] * (self.slopes[1] * posed.corners[1][x])
                + d[2] * (self.slopes[2] * posed.corners[2][x]);
            let flux = l[0] * posed.across[0][x] + l[1] * posed.across[1][x] + l[2] * posed.across[2][x];
            for k in 0..3 {
                let mut pulled = zero;
                for i in 0..3 {
                    let slope = f64x4::from_slice(simd, &seen.slopes[self.edges[i]].logarithm[k]);
                    pulled += slope * posed.across[i][x];
                }
                jacobian[3 * x + k] = foot * of_angle[k]
                    + angle * posed.linear.col(k)[x]
                    + flux * n[k]
                    + of_potential[k] * posed.stretched[x]
                    - h * pulled;
            }
        }
        Part { angle, jacobian, of_potential }
    }

    #[inline(always)]
    fn view<S: Simd>(&self, simd: S, seen: &Seen) -> View<S> {
        let [i, j, k] = self.corners;
        let ((a, ra), (b, rb), (c, rc)) =
            (seen.vertices[i].of(simd), seen.vertices[j].of(simd), seen.vertices[k].of(simd));
        let [opposite_a, opposite_b, opposite_c] =
            [&seen.edges[self.edges[0]], &seen.edges[self.edges[1]], &seen.edges[self.edges[2]]];
        let h = along(&a, self.normal);
        // van Oosterom and Strackee (8)
        let denominator = ra * rb * rc
            + f64x4::from_slice(simd, &opposite_a.product) * ra
            + f64x4::from_slice(simd, &opposite_b.product) * rb
            + f64x4::from_slice(simd, &opposite_c.product) * rc;
        View {
            h,
            angle: atan2(simd, h * self.doubled_area, denominator) * 2.0,
            distances: [along(&b, self.across[0]), along(&c, self.across[1]), along(&a, self.across[2])],
            logarithms: [
                f64x4::from_slice(simd, &opposite_a.logarithm),
                f64x4::from_slice(simd, &opposite_b.logarithm),
                f64x4::from_slice(simd, &opposite_c.logarithm),
            ],
        }
    }
}

#[inline(always)]
fn dot<S: Simd>([ax, ay, az]: &Vectors<S>, [bx, by, bz]: &Vectors<S>) -> f64x4<S> {
    *ax * *bx + *ay * *by + *az * *bz
}

#[inline(always)]
fn along<S: Simd>([x, y, z]: &Vectors<S>, axis: DVec3) -> f64x4<S> {
    *x * axis.x + *y * axis.y + *z * axis.z
}

#[inline(always)]
fn cross<S: Simd>([x, y, z]: &Vectors<S>, b: DVec3) -> Vectors<S> {
    [*y * b.z - *z * b.y, *z * b.x - *x * b.z, *x * b.y - *y * b.x]
}

/// `a bᵀ`
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Up to four points as four: the last one again.
fn padded(points: &[DVec3]) -> [DVec3; LANES] {
    [0, 1, 2, 3].map(|lane| points[lane.min(points.len() - 1)])
}

/// Green coordinates of points: a row of φ (#vertices) and ψ (#triangles, in the length unit of the cage) for each (#points × (#vertices + #triangles)).
///
/// φ sums to 1, and `Σ φ v + Σ ψ n` is the point, inside, on and outside the cage, with its vertices v and unit outward normals n. Outside the
/// coordinates are continued through the closest triangle. Times posed vertices and [`stretched_normals`] they are the deformed points.
#[must_use]
pub fn green_coordinates(cage: &Cage, points: &[DVec3]) -> Vec<f64> {
    let length = cage.vertices().len() + cage.triangles().len();
    let mut rows = vec![0.0; points.len() * length];
    fill_green(cage, points, length, &mut rows);
    rows
}

/// Writes φ (#vertices) and then ψ (#triangles) of each point to `out[p · stride ..]` (#points × stride, stride ≥ #vertices + #triangles); the
/// rest is left.
pub(crate) fn fill_green(cage: &Cage, points: &[DVec3], stride: usize, out: &mut [f64]) {
    fill_on(Level::new(), cage, points, stride, out);
}

fn fill_on(level: Level, cage: &Cage, points: &[DVec3], stride: usize, out: &mut [f64]) {
    assert_eq!(out.len(), points.len() * stride, "a row for each point");
    let rest = Rest::of(cage);
    parallel::for_each_chunk(out, POINTS * stride, |first, out| {
        let points = &points[first / stride..][..out.len() / stride];
        dispatch!(level, simd => rest.fill(simd, points, stride, out));
    });
}

/// A triangle of a posed cage.
struct PosedFace {
    corners: [DVec3; 3],
    stretched: DVec3,
    /// D = Σ v′_i ⊗ ∇Γ_i: the linear part of the map of the plane, 0 along the normal.
    linear: DMat3,
    /// D ν of the sides.
    across: [DVec3; 3],
}

/// The Jacobian matrices ∂f/∂p at points for the vertices `posed` (#vertices): `Σ v′_i ⊗ ∇φ_i + Σ s_j n′_j ⊗ ∇ψ_j`.
///
/// On the cage they have no value. Points nearer to it than [`NEAR`] of its extent stand for one inside: their closest triangle's point, by a
/// millionth of the way nearer to its middle, [`BELOW`] of the extent below it.
pub(crate) fn green_jacobians(cage: &Cage, points: &[DVec3], posed: &[DVec3]) -> Vec<DMat3> {
    let rest = Rest::of(cage);
    let of = |(face, stretched): (&Face, DVec3)| PosedFace::of(face, face.corners.map(|v| posed[v]), stretched);
    let faces: Vec<PosedFace> = rest.faces.iter().zip(stretched_normals(cage, posed)).map(of).collect();
    let level = Level::new();
    let parts = parallel::map_chunks(points.len(), POINTS, |range| {
        let points: Vec<DVec3> = points[range].iter().map(|p| rest.off_the_cage(*p)).collect();
        dispatch!(level, simd => rest.jacobians(simd, &points, &faces))
    });
    parts.concat()
}

/// ∇φ (#vertices) and ∇ψ (#triangles) at each point (#points × (#vertices + #triangles)), where [`green_jacobians`] has them.
pub(crate) fn green_gradients(cage: &Cage, points: &[DVec3]) -> Vec<DVec3> {
    let rest = Rest::of(cage);
    let units: Vec<PosedFace> = rest.faces.iter().map(|face| PosedFace::of(face, DVec3::AXES, DVec3::ZERO)).collect();
    let level = Level::new();
    let columns = cage.vertices().len() + rest.faces.len();
    let mut gradients = vec![DVec3::ZERO; points.len() * columns];
    parallel::for_each_chunk(&mut gradients, POINTS * columns, |first, rows| {
        let points = &points[first / columns..][..rows.len() / columns];
        let points: Vec<DVec3> = points.iter().map(|p| rest.off_the_cage(*p)).collect();
        dispatch!(level, simd => rest.gradients(simd, &points, &units, rows))
    });
    gradients
}

/// Points nearer to the cage have the Jacobian matrix of a point beside them; relative to its extent. Larger: the matrix is of elsewhere; smaller: it loses digits,
/// ε/NEAR, at edges.
const NEAR: f64 = 1e-7;

/// How far below a triangle that point is, relative to the extent. Less than a millionth of most triangles, so that it is below it for sharp edges, too.
const BELOW: f64 = 1e-9;

impl Rest<'_> {
    fn off_the_cage(&self, p: DVec3) -> DVec3 {
        /// Larger: the matrix is of elsewhere; smaller: it loses digits at edges and vertices.
        const TO_THE_MIDDLE: f64 = 1e-6;
        let closest = self.cage.closest(p);
        if closest.distance > NEAR * self.cage.extent() {
            return p;
        }
        let corners = self.cage.corners(closest.triangle);
        let at: DVec3 = closest.weights.iter().zip(corners).map(|(w, c)| *w * c).sum();
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        at + TO_THE_MIDDLE * (middle - at) - BELOW * self.cage.extent() * self.faces[closest.triangle].normal
    }
}

impl PosedFace {
    fn of(face: &Face, corners: [DVec3; 3], stretched: DVec3) -> Self {
        let linear = (0..3).map(|i| outer(corners[i] - corners[0], -face.slopes[i] * face.across[i])).sum();
        Self { corners, stretched, linear, across: face.across.map(|across| linear * across) }
    }
}

/// The stretched normals m = s n′ (#triangles × 3) for the vertices `posed` (#vertices); without unit. A triangle without area has no normal: its m is 0.
/// So m jumps where a triangle loses its area without losing its size.
///
/// # Panics
///
/// Panics where `posed` does not have one position per vertex.
#[must_use]
pub fn stretched_normals(cage: &Cage, posed: &[DVec3]) -> Vec<DVec3> {
    stretched(cage, posed).map(|stretched| stretched.map_or(DVec3::ZERO, |of| of.stretch * of.normal)).collect()
}

/// How a triangle's normal is stretched.
struct Stretched {
    /// Corners of the triangle.
    corners: [usize; 3],
    /// The edges from the first corner in the pose.
    edges: [DVec3; 2],
    /// n′
    normal: DVec3,
    doubled_area: f64,
    /// s
    stretch: f64,
    /// ∂s/∂u′ and ∂s/∂w′.
    slopes: [DVec3; 2],
}

/// For each triangle; `None` where the pose has no area.
fn stretched(cage: &Cage, posed: &[DVec3]) -> impl Iterator<Item = Option<Stretched>> {
    assert_eq!(posed.len(), cage.vertices().len(), "one position for each vertex");
    cage.triangles().iter().enumerate().map(|(t, corners)| {
        let [a, b, c] = cage.corners(t);
        let (u, w) = (b - a, c - a);
        let corners = corners.map(|v| v as usize);
        let [a, b, c] = corners.map(|v| posed[v]);
        let edges = [b - a, c - a];
        let doubled = edges[0].cross(edges[1]);
        let (uu, uw, ww) = (u.dot(u), u.dot(w), w.dot(w));
        // Half the derivative of the paper's radicand.
        let halves = [ww * edges[0] - uw * edges[1], uu * edges[1] - uw * edges[0]];
        let divisor = 2.0 * u.cross(w).length_squared(); // 8 area²
        let stretch = ((edges[0].dot(halves[0]) + edges[1].dot(halves[1])).max(0.0) / divisor).sqrt();
        let normal = doubled.try_normalize()?;
        Some(Stretched {
            corners,
            edges,
            normal,
            doubled_area: doubled.length(),
            stretch,
            slopes: halves.map(|half| half / (divisor * stretch)),
        })
    })
}

/// From the derivative of something with respect to each m (#triangles × 3), what it adds to that with respect to each vertex (#vertices
/// × 3), at the pose `posed`.
pub(crate) fn pulled_back(cage: &Cage, posed: &[DVec3], by_normal: &[DVec3]) -> Vec<DVec3> {
    let mut by_vertex = vec![DVec3::ZERO; posed.len()];
    for (of, by) in stretched(cage, posed).zip(by_normal) {
        let Some(of) = of else { continue };
        let by_stretch = by.dot(of.normal);
        let by_area = by.reject_from_normalized(of.normal) * (of.stretch / of.doubled_area);
        let by_edges = [
            by_stretch * of.slopes[0] + of.edges[1].cross(by_area),
            by_stretch * of.slopes[1] + by_area.cross(of.edges[0]),
        ];
        let [a, b, c] = of.corners;
        by_vertex[a] -= by_edges[0] + by_edges[1];
        by_vertex[b] += by_edges[0];
        by_vertex[c] += by_edges[1];
    }
    by_vertex
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gauss::gauss_legendre;
    use crate::{Faces, Mesh, shapes};

    /// The change of each m (#triangles × 3) for a `change` of the vertices (#vertices × 3), at the pose `posed`; 0 for triangles without area.
    fn pushed_forward(cage: &Cage, posed: &[DVec3], change: &[DVec3]) -> Vec<DVec3> {
        let of = |of: Stretched| {
            let [a, b, c] = of.corners.map(|v| change[v]);
            let (du, dw) = (b - a, c - a);
            let area = du.cross(of.edges[1]) + of.edges[0].cross(dw);
            let turn = area.reject_from_normalized(of.normal) / of.doubled_area;
            (of.slopes[0].dot(du) + of.slopes[1].dot(dw)) * of.normal + of.stretch * turn
        };
        stretched(cage, posed).map(|stretched| stretched.map_or(DVec3::ZERO, of)).collect()
    }

    /// A cage that is not convex: an L of three cubes.
    fn bracket() -> Cage {
        let outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)];
        let points = [0.0, 1.0].iter().flat_map(|z| outline.map(|(x, y)| DVec3::new(x, y, *z))).collect();
        let mut faces = Faces::new();
        for i in 0..6 {
            faces.push(&[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6]);
        }
        for [a, b, c, d] in [[0, 1, 2, 3], [0, 3, 4, 5]] {
            faces.push(&[d, c, b, a]);
            faces.push(&[a + 6, b + 6, c + 6, d + 6]);
        }
        Cage::new(Mesh::new(points, faces).unwrap()).unwrap()
    }

    /// Another place for each vertex.
    fn pose(cage: &Cage) -> Vec<DVec3> {
        let bent =
            |v: &DVec3| DVec3::new(v.x + 0.3 * v.y * v.z, 1.2 * v.y - 0.2 * v.x * v.x, v.z + 0.1 * v.x - 0.3 * v.y);
        cage.vertices().iter().map(bent).collect()
    }

    /// f(p)
    fn deformed(cage: &Cage, posed: &[DVec3], points: &[DVec3]) -> Vec<DVec3> {
        let controls: Vec<DVec3> = posed.iter().copied().chain(stretched_normals(cage, posed)).collect();
        let rows = green_coordinates(cage, points);
        rows.chunks(controls.len()).map(|row| row.iter().zip(&controls).map(|(x, c)| *x * *c).sum()).collect()
    }

    fn inside() -> [DVec3; 4] {
        [(0.5, 0.5, 0.5), (1.6, 0.45, 0.3), (0.8, 0.9, 0.75), (0.3, 1.5, 0.6)].map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn outside() -> [DVec3; 3] {
        [(2.7, 0.4, 0.6), (0.4, 0.7, -0.8), (0.3, 2.6, 0.35)].map(|(x, y, z)| DVec3::new(x, y, z))
    }

    /// φ and ψ by their integrals, over squares that are folded to triangles.
    #[test]
    fn coordinates_are_their_integrals() {
        let cage = bracket();
        let vertices = cage.vertices().len();
        let rule = gauss_legendre(80);
        let rows = green_coordinates(&cage, &inside());
        for (p, row) in inside().iter().zip(rows.chunks(vertices + cage.triangles().len())) {
            let mut expected = vec![0.0; row.len()];
            for (t, corners) in cage.triangles().iter().enumerate() {
                let [a, b, c] = cage.corners(t);
                let doubled = (b - a).cross(c - a);
                for [x, of_x] in &rule {
                    for [y, of_y] in &rule {
                        let weights = [1.0 - x, x * (1.0 - y), x * y];
                        let to = weights[0] * a + weights[1] * b + weights[2] * c - *p;
                        let (r, weight) = (to.length(), of_x * of_y * x / FOUR_PI);
                        for (v, gamma) in corners.iter().zip(weights) {
                            expected[*v as usize] += weight * gamma * doubled.dot(to) / r.powi(3);
                        }
                        expected[vertices + t] += weight * doubled.length() / r;
                    }
                }
            }
            for (i, (x, expected)) in row.iter().zip(&expected).enumerate() {
                assert!((x - expected).abs() <= 1e-13, "{p}, {i}: {x}, not {expected}");
            }
        }
    }

    #[test]
    fn rows_do_not_depend_on_the_processor_the_place_or_the_stride() {
        let cage = bracket();
        let length = cage.vertices().len() + cage.triangles().len();
        let points: Vec<DVec3> = inside().into_iter().chain(outside()).cycle().take(2 * POINTS + 3).collect();
        let rows = green_coordinates(&cage, &points);
        for (p, row) in points.iter().zip(rows.chunks(length)) {
            assert_eq!(green_coordinates(&cage, &[*p]), row);
        }
        let mut wide = vec![7.0; points.len() * (length + 3)];
        fill_on(Level::baseline(), &cage, &points, length + 3, &mut wide);
        for (row, wide) in rows.chunks(length).zip(wide.chunks(length + 3)) {
            assert_eq!((row, &[7.0; 3][..]), wide.split_at(length));
        }
    }

    /// Central differences of step 1e-5: an error of about 1e-10 from the third derivatives and 1e-11 from rounding.
    #[test]
    fn jacobians_are_slopes_inside_and_outside() {
        let cage = bracket();
        let posed = pose(&cage);
        let points: Vec<DVec3> = inside().into_iter().chain(outside()).collect();
        for (p, jacobian) in points.iter().zip(green_jacobians(&cage, &points, &posed)) {
            for axis in DVec3::AXES {
                let h = 1e-5;
                let ends = deformed(&cage, &posed, &[*p + h * axis, *p - h * axis]);
                let slope = (ends[0] - ends[1]) / (2.0 * h);
                assert!((jacobian * axis - slope).length() <= 2e-9, "{p}: {}, not {slope}", jacobian * axis);
            }
        }
    }

    /// The rest pose gives every point back: the identity, also on faces, edges and vertices.
    #[test]
    fn jacobians_at_rest_are_the_identity_everywhere() {
        let cage = bracket();
        let on_it: Vec<DVec3> = (0..cage.triangles().len())
            .flat_map(|t| {
                let [a, b, c] = cage.corners(t);
                [a, (a + b) / 2.0, 0.3 * b + 0.7 * c, (a + b + c) / 3.0, 0.6 * a + 0.3 * b + 0.1 * c]
            })
            .collect();
        let points: Vec<DVec3> = inside().into_iter().chain(outside()).chain(on_it).collect();
        for (p, jacobian) in points.iter().zip(green_jacobians(&cage, &points, cage.vertices())) {
            assert!(jacobian.abs_diff_eq(DMat3::IDENTITY, 1e-8), "{p}: {jacobian}");
        }
    }

    /// From inside, because the map is smooth up to the inside of a face.
    #[test]
    fn the_jacobian_on_a_face_is_the_limit() {
        let cage = bracket();
        let posed = pose(&cage);
        let on_it = DVec3::new(1.2, 0.4, 1.0);
        let jacobians = green_jacobians(&cage, &[on_it, on_it - 1e-5 * DVec3::Z], &posed);
        assert!(jacobians[0].abs_diff_eq(jacobians[1], 1e-3), "{} {}", jacobians[0], jacobians[1]);
    }

    #[test]
    fn the_chain_rule_is_the_slope_and_its_transposed() {
        let cage = bracket();
        let posed = pose(&cage);
        let wave = |n: usize, k: f64| -> Vec<DVec3> {
            let of = |x: f64| DVec3::new(x.sin(), (x + 1.0).cos(), (2.0 * x).sin());
            (0..n).map(|i| of(k * i as f64)).collect()
        };
        let (change, by_normal) = (wave(posed.len(), 0.7), wave(cage.triangles().len(), 1.3));
        let forward = pushed_forward(&cage, &posed, &change);
        let h = 1e-5;
        let moved = |h: f64| -> Vec<DVec3> { posed.iter().zip(&change).map(|(p, d)| *p + h * *d).collect() };
        let [more, less] = [h, -h].map(|h| stretched_normals(&cage, &moved(h)));
        for ((more, less), forward) in more.iter().zip(less).zip(&forward) {
            let slope = (*more - less) / (2.0 * h);
            assert!((slope - *forward).length() <= 1e-9 * (1.0 + forward.length()), "{forward}, not {slope}");
        }
        let product = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let of_normals = product(&forward, &by_normal);
        let of_vertices = product(&change, &pulled_back(&cage, &posed, &by_normal));
        assert!((of_normals - of_vertices).abs() <= 1e-13 * of_normals.abs(), "{of_normals}, not {of_vertices}");
    }

    #[test]
    fn stretches_of_known_poses() {
        let cage = Cage::new(shapes::cube(1)).unwrap();
        let larger: Vec<DVec3> = cage.vertices().iter().map(|v| 3.0 * *v).collect();
        let rest = stretched_normals(&cage, cage.vertices());
        for (large, rest) in stretched_normals(&cage, &larger).iter().zip(&rest) {
            assert!((*large - 3.0 * *rest).length() <= 3e-15);
        }
        // Two edges at a right angle, of length 1, or one of them and a diagonal: s² = (2² + 3²)/2 all the same. The sides become lines, which have no
        // normal.
        let flat: Vec<DVec3> = cage.vertices().iter().map(|v| DVec3::new(2.0 * v.x, 3.0 * v.y, 0.0)).collect();
        for (t, (flat, rest)) in stretched_normals(&cage, &flat).iter().zip(&rest).enumerate() {
            let expected = if rest.z.abs() > 0.5 { 6.5_f64.sqrt() * *rest } else { DVec3::ZERO };
            assert!((*flat - expected).length() <= 3e-15, "{t}: {flat}, not {expected}");
        }
        let changes = pushed_forward(&cage, &flat, cage.vertices());
        assert!(changes.iter().zip(&rest).all(|(d, rest)| d.is_finite() && (rest.z.abs() > 0.5 || *d == DVec3::ZERO)));
        assert!(pulled_back(&cage, &flat, &rest).iter().all(|g| g.is_finite()));
    }
}
