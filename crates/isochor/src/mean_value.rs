//! Mean value coordinates of points in a cage.
//!
//! M. S. Floater, G. Kós, M. Reimers, *Mean value coordinates in 3D*, 2005; T. Ju, S. Schaefer, J. Warren, *Mean value coordinates for closed
//! triangular meshes*, 2005; CVB (3). With u_i the unit vector from the point p to vertex i of the cage, d_i its distance, and for each
//! triangle the integral m of u over what p sees of it,
//!
//! ```text
//! m = ½ Σ θ (u_a × u_b) / sin θ,    w_i = (u_j × u_k) · m / (d_i det(u_i, u_j, u_k)),    α_i = Σ w_i / ΣΣ w
//! ```
//!
//! the first sum over the triangle's sides, from a to b, seen under the angle θ. The w solve `Σ w_i (v_i − p) = m`, and the m of all triangles
//! sum to 0: that is linear precision. Sides are shared by two triangles, so what rounding adds to one m it takes from another, and `Σ α_i v_i`
//! is p to rounding wherever p is.
//!
//! The coordinates are defined everywhere, outside as well, and on the cage; there they are the barycentric ones of the triangle, to which they
//! tend from both sides. Where p lies in the plane of a triangle that it does not touch, the closed form is 0/0, and near that plane it loses
//! digits. There, with N the triangle's normal, h = N · (v − p), and for the side e, opposite corner i, of length s: t its direction, ν = t × N, a =
//! ν · (v − p) and l = t · (v − p) for its ends, ρ² = a² + h²,
//!
//! ```text
//! m = ½ Σ θ (a N − h ν)/ρ,    w_i = s (a m·N − h ν·m) / (2 area h)
//! ```
//!
//! and m·N is ½ Σ (θ a/ρ − φ), because the angles φ under which the foot of p sees the sides sum to 0. With q = h²/(ρ + |a|) and x = l q / (|a| ρ + l²),
//! each term is `−sign(a) (q θ/ρ + arctan x₂ − arctan x₁)`: nothing cancels, and w_i = h f_i with f_i as accurate in the plane as beside it.
//!
//! *Changes versus the papers*: no triangle is left out because p is near its plane; the formula for that is ours. Derivatives, which the papers
//! do not give, follow from `P ∂w = ∂m + Σ w`, P the matrix of the v_i − p; near a plane from `∂w = −N f + h ∂f`.
//!
//! Four points are taken at a time, without fused multiply-adds: the same bits on every processor.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4};
use glam::{DMat3, DVec3};

use crate::cage::{Cage, Side};
use crate::closest::closest_on_triangle;
use crate::elementary;
use crate::parallel;
use crate::tolerances;

/// Points that are taken at a time.
const LANES: usize = 4;

/// A triangle seen from where `|det(u_i, u_j, u_k)|` is below this fraction of the square of its longest side, as seen, is seen from near its
/// plane. Larger: time where the closed form does; smaller: digits are lost, about `ε / EDGE_ON`.
const EDGE_ON: f64 = 1e-3;

/// Unless |m| is at least so much: then p is near the triangle itself, where the closed form is accurate. Larger: the foot of p is in the triangle;
/// smaller: digits are lost.
const FACED: f64 = 0.3;

/// A point that sees a side under an angle whose sine is below this, or less, is looked at alone: it may lie on the cage.
const GRAZING: f64 = 1e-12;

/// A side is seen nearly end on where its line is nearer than this fraction of its nearer end. Larger: more terms; smaller: digits are lost.
const END_ON: f64 = 0.1;

/// Terms of its series, each a hundredth of the one before.
const END_ON_TERMS: u32 = 8;

/// Steps of differences of f, relative to the distance from the triangle: their errors are about its square, and count times h. Larger: these;
/// smaller: rounding.
const STEP: f64 = 1e-3;

/// Jacobian matrices that one thread takes at a time. Each takes microseconds.
const JACOBIANS: usize = 64;

/// Writes the coordinates of each point (#vertices of the cage) to `out[i · stride ..]`. What is beyond them there is left.
pub(crate) fn fill_mean_value(cage: &Cage, points: &[DVec3], stride: usize, out: &mut [f64]) {
    dispatch!(Level::new(), simd => fill(simd, cage, points, stride, out));
}

/// A vector of each of the points.
pub(crate) type Vector<S> = [f64x4<S>; 3];

#[inline(always)]
pub(crate) fn dot<S: Simd>(a: Vector<S>, b: Vector<S>) -> f64x4<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<S: Simd>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn sum<S: Simd>(a: Vector<S>, b: Vector<S>) -> Vector<S> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn scaled<S: Simd>(a: Vector<S>, by: f64x4<S>) -> Vector<S> {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// From the points, whose coordinates are given, to a vertex.
#[inline(always)]
pub(crate) fn towards<S: Simd>(simd: S, v: DVec3, from: Vector<S>) -> Vector<S> {
    [f64x4::splat(simd, v.x) - from[0], f64x4::splat(simd, v.y) - from[1], f64x4::splat(simd, v.z) - from[2]]
}

/// The coordinates of four points, of which the last stands in for those that are not there.
#[inline(always)]
pub(crate) fn places<S: Simd>(simd: S, points: &[DVec3]) -> Vector<S> {
    let of = |lane: usize| points[lane.min(points.len() - 1)];
    let [a, b, c, d] = [of(0), of(1), of(2), of(3)];
    [
        f64x4::from_slice(simd, &[a.x, b.x, c.x, d.x]),
        f64x4::from_slice(simd, &[a.y, b.y, c.y, d.y]),
        f64x4::from_slice(simd, &[a.z, b.z, c.z, d.z]),
    ]
}

/// An edge as the points see it.
#[derive(Clone, Copy)]
struct Edge<S: Simd> {
    /// The cross product of the unit vectors to its ends.
    cross: Vector<S>,
    /// `θ / sin θ`.
    ratio: f64x4<S>,
}

#[inline(always)]
fn fill<S: Simd>(simd: S, cage: &Cage, points: &[DVec3], stride: usize, out: &mut [f64]) {
    let zero = f64x4::splat(simd, 0.0);
    let (half, one) = (f64x4::splat(simd, 0.5), f64x4::splat(simd, 1.0));
    let vertices = cage.vertices();
    let mut unit = vec![[zero; 3]; vertices.len()];
    let mut distance = vec![zero; vertices.len()];
    let mut edges = vec![Edge { cross: [zero; 3], ratio: zero }; cage.edges().len()];
    let mut weights = vec![zero; vertices.len()];
    for (points, out) in points.chunks(LANES).zip(out.chunks_mut(LANES * stride)) {
        // No closures with lanes: they would not be compiled for the processor at hand.
        let place = places(simd, points);
        // Whether each point may be on the cage.
        let mut is_grazing = [false; LANES];
        let mut note = |mask: [bool; LANES]| is_grazing.iter_mut().zip(mask).for_each(|(is, it)| *is |= it);
        let least = f64x4::splat(simd, GRAZING * cage.extent());
        for ((v, unit), distance) in vertices.iter().zip(&mut unit).zip(&mut distance) {
            let to = towards(simd, *v, place);
            *distance = dot(to, to).sqrt();
            *unit = scaled(to, one / *distance);
            if distance.simd_le(least).any_true() {
                note(lanes_of(*distance).map(|d| d <= GRAZING * cage.extent()));
            }
        }
        for ([a, b], edge) in cage.edges().iter().zip(&mut edges) {
            let (a, b) = (unit[*a as usize], unit[*b as usize]);
            let (cross, cosine) = (cross(a, b), dot(a, b));
            let sine = dot(cross, cross).sqrt();
            let angle = elementary::atan2(simd, sine, cosine);
            let is_seen = sine.simd_gt(zero);
            *edge = Edge { cross, ratio: is_seen.select(angle / sine, one) };
            let grazes = sine.simd_le(f64x4::splat(simd, GRAZING)) & cosine.simd_lt(zero);
            if grazes.any_true() {
                let (sine, cosine) = (lanes_of(sine), lanes_of(cosine));
                note([0, 1, 2, 3].map(|lane| sine[lane] <= GRAZING && cosine[lane] < 0.0));
            }
        }
        weights.fill(zero);
        let mut edge_on: Vec<(usize, usize)> = Vec::new(); // lane and triangle
        for (t, (corners, sides)) in cage.triangles().iter().zip(cage.sides()).enumerate() {
            let sides = [seen(&edges, sides[0]), seen(&edges, sides[1]), seen(&edges, sides[2])];
            let m = sum(sum(weighted(&sides[0]), weighted(&sides[1])), weighted(&sides[2]));
            let m = scaled(m, half);
            let [i, j, k] = *corners;
            let unit = [unit[i as usize], unit[j as usize], unit[k as usize]];
            let determinant = dot(unit[0], sides[1].cross);
            // The longest of its squared sides, as seen.
            let cosine = dot(unit[0], unit[1]).min(dot(unit[1], unit[2])).min(dot(unit[2], unit[0]));
            let longest = (one - cosine) * 2.0;
            let is_edge_on = determinant.abs().simd_lt(longest * EDGE_ON);
            let mut scale = one / determinant;
            if is_edge_on.any_true() {
                let size = lanes_of(dot(m, m).sqrt());
                let (determinant, limit) = (lanes_of(determinant.abs()), lanes_of(longest * EDGE_ON));
                let mut of_lanes = lanes_of(scale);
                for lane in (0..LANES).filter(|lane| determinant[*lane] < limit[*lane]) {
                    if size[lane] < FACED {
                        of_lanes[lane] = 0.0;
                        if lane < points.len() {
                            edge_on.push((lane, t));
                        }
                    } else if determinant[lane] <= GRAZING {
                        is_grazing[lane] = true;
                    }
                }
                scale = f64x4::from_slice(simd, &of_lanes);
            }
            for (k, v) in corners.iter().enumerate() {
                let opposite = sides[(k + 1) % 3].cross;
                let v = *v as usize;
                weights[v] += dot(opposite, m) * scale / distance[v];
            }
        }
        for (i, (point, row)) in points.iter().zip(out.chunks_mut(stride)).enumerate() {
            let row = &mut row[..vertices.len()];
            if is_grazing[i]
                && let Some((corners, on_cage)) = on_cage(cage, *point)
            {
                row.fill(0.0);
                corners.iter().zip(on_cage).for_each(|(v, w)| row[*v as usize] = w);
                continue;
            }
            for (to, w) in row.iter_mut().zip(&weights) {
                *to = lanes_of(*w)[i];
            }
            for (_, t) in edge_on.iter().filter(|(lane, _)| *lane == i) {
                let corners = cage.corners(*t).map(|v| v - *point);
                let weights =
                    EdgeOn::new(corners).map_or_else(|| weights_with_slopes(corners).0, |seen| seen.weights());
                cage.triangles()[*t].iter().zip(weights).for_each(|(v, w)| row[*v as usize] += w);
            }
            let whole: f64 = row.iter().sum();
            row.iter_mut().for_each(|w| *w /= whole);
        }
    }
}

#[inline(always)]
fn lanes_of<S: Simd>(x: f64x4<S>) -> [f64; LANES] {
    x.into()
}

/// An edge as a side of a triangle.
#[inline(always)]
fn seen<S: Simd>(edges: &[Edge<S>], side: Side) -> Edge<S> {
    let edge = edges[side.edge as usize];
    let [x, y, z] = edge.cross;
    if side.is_backward { Edge { cross: [-x, -y, -z], ..edge } } else { edge }
}

/// What a side adds to 2 m.
#[inline(always)]
fn weighted<S: Simd>(side: &Edge<S>) -> Vector<S> {
    scaled(side.cross, side.ratio)
}

/// The corners of the triangle on which a point lies, up to [`tolerances::ON_CAGE`] of the cage's extent, with its barycentric coordinates.
pub(crate) fn on_cage(cage: &Cage, point: DVec3) -> Option<([u32; 3], [f64; 3])> {
    let closest = cage.closest(point);
    let is_on = closest.distance <= tolerances::ON_CAGE * cage.extent();
    is_on.then(|| (cage.triangles()[closest.triangle], closest.weights))
}

/// Jacobian matrices ∂(Σ c_i α_i)/∂p at `points`, for the vertices of a cage at `posed` (#vertices × 3). Where a point is on the cage they are
/// those at [`tolerances::BESIDE_CAGE`] of its extent inside.
pub(crate) fn mean_value_jacobians(cage: &Cage, points: &[DVec3], posed: &[DVec3]) -> Vec<DMat3> {
    let parts = parallel::map_chunks(points.len(), JACOBIANS, |range| {
        let mut gradients = vec![DVec3::ZERO; posed.len()];
        let jacobian = |p: &DVec3| {
            fill_mean_value_gradients(cage, cage.beside(*p), &mut gradients);
            jacobian_of(&gradients, posed)
        };
        points[range].iter().map(jacobian).collect::<Vec<_>>()
    });
    parts.concat()
}

/// `Σ c_i ⊗ ∇α_i` of controls at `posed` (#controls) with coordinates α.
pub(crate) fn jacobian_of(gradients: &[DVec3], posed: &[DVec3]) -> DMat3 {
    let terms = gradients.iter().zip(posed);
    terms.fold(DMat3::ZERO, |sum, (g, c)| sum + DMat3::from_cols(*c * g.x, *c * g.y, *c * g.z))
}

/// Puts ∇α of the cage's vertices at `point`, which is not on the cage, into `gradients` (#vertices).
pub(crate) fn fill_mean_value_gradients(cage: &Cage, point: DVec3, gradients: &mut [DVec3]) {
    let mut of_vertex = vec![0.0; gradients.len()];
    gradients.fill(DVec3::ZERO);
    for (t, triangle) in cage.triangles().iter().enumerate() {
        let (weights, slopes) = weights_with_slopes(cage.corners(t).map(|v| v - point));
        for ((v, w), slope) in triangle.iter().zip(weights).zip(slopes) {
            of_vertex[*v as usize] += w;
            gradients[*v as usize] += slope;
        }
    }
    // α_i = w_i / Σ w
    let (whole, slope): (f64, DVec3) = (of_vertex.iter().sum(), gradients.iter().sum());
    for (gradient, w) in gradients.iter_mut().zip(of_vertex) {
        *gradient = (*gradient - slope * (w / whole)) / whole;
    }
}

/// The weights w of a triangle and their derivatives by p, for its corners as seen from p.
fn weights_with_slopes(corners: [DVec3; 3]) -> ([f64; 3], [DVec3; 3]) {
    let distances = corners.map(DVec3::length);
    let unit = [0, 1, 2].map(|i| corners[i] / distances[i]);
    let (mut m, mut slope) = (DVec3::ZERO, DMat3::ZERO);
    let mut crosses = [DVec3::ZERO; 3];
    for (i, cross) in crosses.iter_mut().enumerate() {
        let j = (i + 1) % 3;
        let (a, b) = (unit[i], unit[j]);
        *cross = a.cross(b);
        let (sine, cosine) = (cross.length(), a.dot(b));
        let ratio = if sine > 0.0 { libm::atan2(sine, cosine) / sine } else { 1.0 };
        m += 0.5 * ratio * *cross;
        // θ n with n = a × b / sin θ: the angle changes by the ends' moves in the plane, the normal by those across it.
        let n = *cross / sine;
        let by_angle = n.cross(a) / distances[i] - n.cross(b) / distances[j];
        let across = corners[i] - corners[j];
        // p moved by d turns n to (1 − n nᵀ) (d × across) / |a × b|, with the ends' whole lengths.
        let turned = |d: DVec3| {
            let turned = d.cross(across);
            (turned - n * n.dot(turned)) * (ratio / (distances[i] * distances[j]))
        };
        let column = |d: DVec3| 0.5 * (n * by_angle.dot(d) + turned(d));
        slope += DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
    }
    let determinant = unit[0].dot(crosses[1]);
    let longest = 2.0 - 2.0 * [0, 1, 2].map(|i| unit[i].dot(unit[(i + 1) % 3])).into_iter().fold(1.0, f64::min);
    let is_edge_on = determinant.abs() < EDGE_ON * longest && m.length() < FACED;
    if is_edge_on && let Some(both) = EdgeOn::weights_with_slopes(corners) {
        return both;
    }
    let opposite = |i: usize| crosses[(i + 1) % 3];
    let weights = [0, 1, 2].map(|i| opposite(i).dot(m) / (distances[i] * determinant));
    let whole: f64 = weights.iter().sum();
    let transposed = slope.transpose();
    let slopes = [0, 1, 2].map(|i| (transposed * opposite(i) + opposite(i) * whole) / (distances[i] * determinant));
    (weights, slopes)
}

/// `θ/ρ` and `(θ a/ρ − φ)/h²` of a side whose ends are at l₁ and l₂ along its line, which is a from the foot of the point, for h².
fn seen_side([l1, l2]: [f64; 2], a: f64, squared: f64) -> (f64, f64) {
    let (near, rho) = (a.abs(), (a * a + squared).sqrt());
    let [inner, outer] = [l1, l2].map(|l| 1.0 / l);
    if l1 * l2 > 0.0 && rho * inner.abs().max(outer.abs()) < END_ON {
        // Nearly end on, where q and x do not help: θ/ρ = G(ρ²) and φ/a = G(a²) with G(s) = Σ (−s)^k (1/l₁^(2k+1) − 1/l₂^(2k+1)) / (2k + 1).
        let (mut powers, mut sign) = ([inner, outer], 1.0);
        let (mut ratio, mut difference) = (inner - outer, 0.0);
        // ρ^(2k) and (ρ^(2k) − a^(2k))/h².
        let (mut of_rho, mut quotient) = (1.0, 0.0);
        for k in 1..=END_ON_TERMS {
            quotient = of_rho + a * a * quotient;
            of_rho *= rho * rho;
            powers = [powers[0] * inner * inner, powers[1] * outer * outer];
            sign = -sign;
            let coefficient = sign * (powers[0] - powers[1]) / f64::from(2 * k + 1);
            ratio += coefficient * of_rho;
            difference += coefficient * quotient;
        }
        return (ratio, a * difference);
    }
    let length = l2 - l1;
    let angle = libm::atan2(length * rho, l1 * l2 + rho * rho);
    // q, x and arctan x₂ − arctan x₁, over h².
    let q = 1.0 / (rho + near);
    let [x1, x2] = [l1, l2].map(|l| l * q / (near * rho + l * l));
    let rise = (x2 - x1) / (1.0 + x1 * x2 * squared * squared);
    let tangent = rise * squared;
    let turn = if tangent == 0.0 { rise } else { rise * (libm::atan(tangent) / tangent) };
    (angle / rho, -a.signum() * (q * angle / rho + turn))
}

/// A triangle that is seen from near its plane, by a point whose foot is outside it: `w_i = h f_i`.
struct EdgeOn {
    normal: DVec3,
    /// How far the plane is from the point, along the normal.
    height: f64,
    factors: [f64; 3],
}

impl EdgeOn {
    /// Of the triangle whose corners are given as seen from the point. `None` where the foot of the point is in the triangle, as it can be where
    /// that is a needle: then the angles φ sum to 2 π.
    fn new(corners: [DVec3; 3]) -> Option<Self> {
        let doubled = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let doubled_area = doubled.length();
        let normal = doubled / doubled_area;
        let height = normal.dot(corners[0]);
        let squared = height * height;
        // For each side: its length and a; `m·N / h²`; and `Σ θ ν/ρ`, which is `−2 m/h` in the plane.
        let (mut lengths, mut offsets, mut across) = ([0.0; 3], [0.0; 3], [DVec3::ZERO; 3]);
        let (mut along_normal, mut in_plane) = (0.0, DVec3::ZERO);
        for side in 0..3 {
            let [from, to] = [corners[side], corners[(side + 1) % 3]];
            let length = (to - from).length();
            let direction = (to - from) / length;
            let outward = direction.cross(normal);
            let a = outward.dot(from);
            (lengths[side], offsets[side], across[side]) = (length, a, outward);
            let (ratio, rise) = seen_side([direction.dot(from), direction.dot(to)], a, squared);
            in_plane += outward * ratio;
            along_normal += 0.5 * rise;
        }
        if offsets.iter().all(|a| *a >= 0.0) {
            return None;
        }
        let factor = |corner: usize| {
            let opposite = (corner + 1) % 3;
            let both = offsets[opposite] * along_normal + 0.5 * across[opposite].dot(in_plane);
            lengths[opposite] * both / doubled_area
        };
        Some(Self { normal, height, factors: [0, 1, 2].map(factor) })
    }

    /// The weights.
    fn weights(&self) -> [f64; 3] {
        self.factors.map(|f| f * self.height)
    }

    /// The weights and their derivatives by the point.
    fn weights_with_slopes(corners: [DVec3; 3]) -> Option<([f64; 3], [DVec3; 3])> {
        let this = Self::new(corners)?;
        let nearest = closest_on_triangle(DVec3::ZERO, corners);
        let nearest: DVec3 = corners.iter().zip(nearest).map(|(corner, b)| *corner * b).sum();
        let step = STEP * nearest.length();
        let mut slopes = this.factors.map(|f| this.normal * -f);
        for axis in DVec3::AXES {
            // The point goes forward where the corners go back.
            let by = axis * step;
            let (after, before) = (Self::new(corners.map(|c| c - by))?, Self::new(corners.map(|c| c + by))?);
            for (i, slope) in slopes.iter_mut().enumerate() {
                *slope += axis * (this.height * (after.factors[i] - before.factors[i]) / (2.0 * step));
            }
        }
        Some((this.weights(), slopes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gauss::gauss_legendre;
    use crate::shapes;
    use proptest::prelude::*;

    fn coordinates(cage: &Cage, points: &[DVec3]) -> Vec<Vec<f64>> {
        let stride = cage.vertices().len();
        let mut rows = vec![f64::NAN; points.len() * stride];
        fill_mean_value(cage, points, stride, &mut rows);
        rows.chunks(stride).map(<[f64]>::to_vec).collect()
    }

    fn sphere() -> Cage {
        Cage::new(shapes::icosphere(1)).unwrap()
    }

    fn error(cage: &Cage, row: &[f64], point: DVec3) -> f64 {
        let image: DVec3 = row.iter().zip(cage.vertices()).map(|(w, v)| *v * *w).sum();
        (row.iter().sum::<f64>() - 1.0).abs().max(image.distance(point))
    }

    /// `w_i = det ∫∫ b_i / |p(b)|⁴ db`, the definition `∫ b_i / r dω` over the triangle, by the square's rule of Gauss and Legendre, collapsed.
    fn integrated(corners: [DVec3; 3]) -> [f64; 3] {
        let line = gauss_legendre(40);
        let mut sum = [0.0; 3];
        for [x, wx] in &line {
            for [y, wy] in &line {
                let b = [*x, (1.0 - x) * y, (1.0 - x) * (1.0 - y)];
                let p = corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2];
                let value = wx * wy * (1.0 - x) / p.length_squared().powi(2);
                (0..3).for_each(|i| sum[i] += b[i] * value);
            }
        }
        let [a, b, c] = corners;
        sum.map(|s| s * a.dot(b.cross(c)))
    }

    #[test]
    fn the_closed_form_is_the_integral() {
        let corners = [DVec3::new(1.0, 0.1, 0.3), DVec3::new(0.2, 1.1, 0.1), DVec3::new(0.1, -0.2, 0.9)];
        let (closed, _) = weights_with_slopes(corners);
        assert!(closed.iter().zip(integrated(corners)).all(|(a, b)| (a - b).abs() <= 1e-12), "{closed:?}");
    }

    /// At heights of all sizes and on both sides; in the plane the weights are 0, and f is what it is beside it.
    #[test]
    fn near_the_plane_of_a_triangle_the_other_form_is_the_integral() {
        for foot in [
            DVec3::new(2.0, 0.3, 0.0),
            DVec3::new(-0.5, -0.4, 0.0),
            DVec3::new(1.5, 0.0, 0.0),
            DVec3::new(0.9, 0.9, 0.0),
        ] {
            let corners = |h: f64| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| v - foot + DVec3::Z * h);
            let beside = EdgeOn::new(corners(1e-9)).unwrap().factors;
            for h in [-0.3, 0.3, 1e-2, -1e-3, 1e-6, 1e-9, 0.0] {
                let this = EdgeOn::new(corners(h)).unwrap();
                let (found, expected) = (this.weights(), integrated(corners(h)));
                assert!(
                    found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 2e-13 * b.abs()),
                    "{foot} {h}: {found:?} {expected:?}"
                );
                if h.abs() <= 1e-6 {
                    assert!(this.factors.iter().zip(beside).all(|(a, b)| (a - b).abs() <= 1e-10 * b.abs()));
                }
                let (_, slopes) = EdgeOn::weights_with_slopes(corners(h)).unwrap();
                for (axis, by) in DVec3::AXES.into_iter().map(|axis| axis * 1e-4).enumerate() {
                    let at = |k: f64| integrated(corners(h).map(|c| c - by * k));
                    let [far, near] = [2.0, 1.0].map(|k| (at(k), at(-k)));
                    for (i, slope) in slopes.iter().enumerate() {
                        let measured = (8.0 * (near.0[i] - near.1[i]) - (far.0[i] - far.1[i])) / (12.0 * 1e-4);
                        assert!((slope[axis] - measured).abs() <= 1e-5 * h.abs() + 1e-9, "{foot} {h} {i} {axis}");
                    }
                }
            }
        }
    }

    /// A needle is seen under a small determinant from above, too.
    #[test]
    fn needles_are_no_planes_seen_from_their_side() {
        let corners = [DVec3::new(-0.5, -1e-4, 0.7), DVec3::new(0.5, -1e-4, 0.7), DVec3::new(0.1, 3e-4, 0.7)];
        assert!(EdgeOn::new(corners).is_none());
        let (found, expected) = (weights_with_slopes(corners).0, integrated(corners));
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-12), "{found:?} {expected:?}");
        let cage = sphere();
        let mut points = cage.vertices().to_vec();
        points.extend([
            DVec3::new(-0.5, -1e-4, 3.0),
            DVec3::new(0.5, -1e-4, 3.0),
            DVec3::new(0.1, 3e-4, 3.0),
            DVec3::new(0.1, 0.0, 2.9),
        ]);
        let n = cage.vertices().len() as u32;
        let mut faces = cage.triangles().to_vec();
        faces.extend([[n, n + 1, n + 2], [n + 1, n, n + 3], [n + 2, n + 1, n + 3], [n, n + 2, n + 3]]);
        let cage = Cage::new(crate::Mesh::new(points, faces.into()).unwrap()).unwrap();
        for p in [DVec3::new(0.1, 0.0, 0.2), DVec3::new(0.05, 1e-5, 2.0)] {
            let row = &coordinates(&cage, &[p])[0];
            assert!(error(&cage, row, p) <= 1e-13, "{}", error(&cage, row, p));
        }
    }

    #[test]
    fn an_octahedron_shares_its_centre_equally() {
        let points = vec![DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
        let mut faces = Vec::new();
        for (x, y, z) in (0..8).map(|s| (s & 1, 2 + (s >> 1 & 1), 4 + (s >> 2 & 1))) {
            let is_turned = (x + y + z) % 2 == 1;
            faces.push(if is_turned { [x, z, y] } else { [x, y, z] });
        }
        let cage = Cage::new(crate::Mesh::new(points, faces.into()).unwrap()).unwrap();
        let rows = coordinates(&cage, &[DVec3::ZERO]);
        assert!(rows[0].iter().all(|w| (w - 1.0 / 6.0).abs() <= 1e-15), "{rows:?}");
    }

    #[test]
    fn points_on_the_cage_have_the_coordinates_of_their_triangle() {
        let cage = sphere();
        let corners = cage.triangles()[7];
        let [a, b, c] = cage.corners(7);
        let points = [a, (a + b) / 2.0, a * 0.2 + b * 0.3 + c * 0.5];
        let expected = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.2, 0.3, 0.5]];
        for (row, expected) in coordinates(&cage, &points).iter().zip(expected) {
            let mut whole = vec![0.0; row.len()];
            corners.iter().zip(expected).for_each(|(v, w)| whole[*v as usize] = w);
            assert!(row.iter().zip(&whole).all(|(a, b)| (a - b).abs() <= 1e-13), "{row:?}");
        }
    }

    /// The coordinates are continuous: near a triangle, an edge and a vertex they are those on it, up to about the distance.
    #[test]
    fn near_the_cage_nothing_is_lost() {
        let cage = sphere();
        let [a, b, c] = cage.corners(7);
        let normal = (b - a).cross(c - a).normalize();
        let places = [a, a * 0.4 + b * 0.6, a * 0.2 + b * 0.3 + c * 0.5, b * 0.999_999 + c * 0.000_001];
        for on in places {
            let there = &coordinates(&cage, &[on])[0];
            for exponent in 1..=18 {
                for sign in [-1.0, 1.0] {
                    let direction = (normal + DVec3::new(0.1, -0.2, 0.15)).normalize();
                    let distance = 10.0_f64.powi(-exponent);
                    let point = on + direction * (sign * distance);
                    let row = &coordinates(&cage, &[point])[0];
                    assert!(error(&cage, row, point) <= 2e-14, "{on} {exponent} {sign} {}", error(&cage, row, point));
                    let apart = row.iter().zip(there).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(apart <= 40.0 * distance + 1e-14, "{on} {exponent} {sign}: {apart:e}");
                }
            }
        }
    }

    /// Points in the planes of faces that they do not touch, and near them: the coordinates agree with those of points a little farther on, to which
    /// the closed form applies.
    #[test]
    fn planes_of_far_faces_are_crossed_smoothly() {
        // An L-shaped cage: the planes of its inner faces cut through its inside.
        let cage = Cage::new(l_shape()).unwrap();
        for at in [DVec3::new(0.4, 1.0, 0.5), DVec3::new(1.0, 0.4, 0.3), DVec3::new(0.2, 1.0, 0.999)] {
            for normal in [DVec3::X, DVec3::Y] {
                let row = |h: f64| coordinates(&cage, &[at + normal * h]).remove(0);
                let slope = |h: f64| {
                    let (up, down) = (row(h), row(-h));
                    up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * h)).collect::<Vec<f64>>()
                };
                let mean: Vec<f64> = row(0.01).iter().zip(row(-0.01)).map(|(a, b)| 0.5 * (a + b)).collect();
                assert!(row(0.0).iter().zip(&mean).all(|(a, b)| (a - b).abs() <= 2e-3));
                let wide = slope(1e-2);
                for h in [1e-3, 1e-4, 1e-5] {
                    let apart = slope(h).iter().zip(&wide).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(apart <= 0.2, "{at} {normal} {h}: {apart}");
                }
                // Across the border of the two formulas there is no step.
                let (a, b) = (row(EDGE_ON * 0.999), row(EDGE_ON * 1.001));
                assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= 1e-4));
                for h in [0.0, 1e-17, 1e-12, 1e-8, 1e-4] {
                    let point = at + normal * h;
                    assert!(error(&cage, &row(h), point) <= 5e-15, "{at} {h} {}", error(&cage, &row(h), point));
                }
            }
        }
    }

    fn l_shape() -> crate::Mesh {
        let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let level = |z: f64| outline.map(|[x, y]| DVec3::new(x, y, z));
        let points = [level(0.0), level(1.0)].concat();
        let mut faces = crate::Faces::new();
        for corners in [[0, 1, 2, 3], [0, 3, 4, 5]] {
            faces.push(&[corners[0], corners[3], corners[2], corners[1]]);
            faces.push(&corners.map(|v| v + 6));
        }
        (0..6).for_each(|i| faces.push(&[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i]));
        crate::Mesh::new(points, faces).unwrap()
    }

    proptest! {
        #[test]
        fn constants_and_positions_are_reproduced_everywhere(p in prop::array::uniform3(-2.0..2.0)) {
            let p = DVec3::from_array(p);
            for cage in [sphere(), Cage::new(l_shape()).unwrap()] {
                let row = &coordinates(&cage, &[p])[0];
                let scale: f64 = row.iter().map(|w| w.abs()).sum();
                prop_assert!(error(&cage, row, p) <= 2e-14 * scale, "{}", error(&cage, row, p));
            }
        }

        /// The same row whatever points stand beside it.
        #[test]
        fn rows_do_not_depend_on_their_neighbours(p in prop::array::uniform3(-1.0..1.0), q in prop::array::uniform3(-1.0..1.0)) {
            let (p, q) = (DVec3::from_array(p), DVec3::from_array(q));
            let cage = sphere();
            let alone = coordinates(&cage, &[p]);
            let beside = coordinates(&cage, &[q, q, p, DVec3::ZERO, p]);
            prop_assert_eq!(&alone[0], &beside[2]);
            prop_assert_eq!(&alone[0], &beside[4]);
        }

        #[test]
        fn jacobians_are_the_derivatives(p in prop::array::uniform3(-0.5..0.5), x in 0..3_usize) {
            let p = DVec3::from_array(p);
            for cage in [sphere(), Cage::new(l_shape()).unwrap()] {
                let p = if cage.extent() == 2.0 && !cage.contains(DVec3::ZERO) { p + DVec3::new(0.5, 0.5, 0.5) } else { p };
                prop_assume!(cage.distance(p) > 0.05);
                let posed: Vec<DVec3> =
                    cage.vertices().iter().map(|v| *v + DVec3::new(v.y * v.y, 0.3 * v.x, v.x * v.y * v.z)).collect();
                let at = |p: DVec3| -> DVec3 { coordinates(&cage, &[p])[0].iter().zip(&posed).map(|(w, c)| *c * *w).sum() };
                let h = 1e-4;
                let step = DVec3::AXES[x] * h;
                let measured = ((at(p + step) - at(p - step)) * 8.0 - (at(p + 2.0 * step) - at(p - 2.0 * step))) / (12.0 * h);
                let jacobian = mean_value_jacobians(&cage, &[p], &posed)[0];
                prop_assert!(jacobian.col(x).distance(measured) <= 1e-7, "{} {measured}", jacobian.col(x));
            }
        }
    }

    #[test]
    fn a_cage_at_rest_has_the_identity_for_a_jacobian() {
        let cage = sphere();
        let points = [DVec3::ZERO, DVec3::new(0.3, 0.2, -0.1), cage.vertices()[3], cage.corners(4)[0]];
        for jacobian in mean_value_jacobians(&cage, &points, cage.vertices()) {
            assert!(jacobian.abs_diff_eq(DMat3::IDENTITY, 1e-7), "{jacobian}");
        }
    }
}
