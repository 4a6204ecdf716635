//! Sweeps over the triangles of a body: the sums that volumes and their gradients are made of.
//!
//! `Σ det(p_l, p_m, p_n)` is six times the volume, HB (5); `Σ (p_b − p_v) × (p_c − p_v)` at a vertex v is six times its gradient there, what
//! HB (10)–(12) multiply by Wᵀ ([`crate::volume`] has both in full). Determinants cancel, so they are summed in doubled precision
//! ([`crate::double`]), eight at a time: the corners of a batch of triangles are brought together once, coordinate by coordinate. All
//! other sums are plain, without fused multiply-adds, so that bits do not depend on the processor.

use fearless_simd::prelude::*;
use fearless_simd::{f64x4, f64x8};
use glam::DVec3;

use crate::double::{Double, Lanes};

/// Triangles in a batch: few enough to stay near the processor, many enough to be worth a loop. A multiple of [`WIDTH`].
const BATCH: usize = 64;

/// Numbers in a packed one.
const WIDTH: usize = 8;

/// One number per triangle of a batch.
type Column = [f64; BATCH];

/// A vector per triangle, packed.
type Vectors<S> = [f64x8<S>; 3];

/// The corners of a batch of triangles: corner k, coordinate x, triangle i at `[k][x][i]`. What is beyond the last triangle is 0 or old.
struct Corners([[Column; 3]; 3]);

impl Corners {
    fn zero() -> Self {
        Self([[[0.0; BATCH]; 3]; 3])
    }

    /// Puts triangle `i` of the batch there.
    #[inline(always)]
    fn set(&mut self, i: usize, [l, m, n]: [u32; 3], points: &[DVec3]) {
        let triangle = [points[l as usize], points[m as usize], points[n as usize]];
        for (corner, p) in self.0.iter_mut().zip(triangle) {
            corner[0][i] = p.x;
            corner[1][i] = p.y;
            corner[2][i] = p.z;
        }
    }

    /// Corner `k` of the eight triangles from `first` on.
    #[inline(always)]
    fn packed<S: Simd>(&self, simd: S, k: usize, first: usize) -> Vectors<S> {
        let [x, y, z] = &self.0[k];
        let range = first..first + WIDTH;
        // Closures would not be compiled for the processor at hand.
        [
            f64x8::from_slice(simd, &x[range.clone()]),
            f64x8::from_slice(simd, &y[range.clone()]),
            f64x8::from_slice(simd, &z[range]),
        ]
    }

    /// All corners of the eight triangles from `first` on.
    #[inline(always)]
    fn eight<S: Simd>(&self, simd: S, first: usize) -> [Vectors<S>; 3] {
        [self.packed(simd, 0, first), self.packed(simd, 1, first), self.packed(simd, 2, first)]
    }
}

/// `(b − a) × (c − a)`: twice the area vector of a triangle.
#[inline(always)]
pub(crate) fn doubled_area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// `det(l, m, n)` in doubled precision, added to `sum`; with the first corner times `share`, which is 0 or 1.
#[inline(always)]
fn add_determinants<S: Simd, const FUSED: bool>(
    sum: Lanes<S>,
    [l, m, n]: [Vectors<S>; 3],
    share: f64x8<S>,
) -> Lanes<S> {
    let mut sum = sum;
    for [x, y, z] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        let minor = Lanes::product::<FUSED>(m[y], n[z]).minus(Lanes::product::<FUSED>(m[z], n[y]));
        sum = sum.plus(minor.times::<FUSED>(l[x] * share));
    }
    sum
}

/// `Σ det(p_l, p_m, p_n)` in doubled precision. `FUSED` is [`crate::double::is_fused`].
#[inline(always)]
pub(crate) fn determinants<S: Simd, const FUSED: bool>(simd: S, triangles: &[[u32; 3]], points: &[DVec3]) -> Double {
    let mut sum = Lanes::zero(simd);
    let mut corners = Corners::zero();
    let one = f64x8::splat(simd, 1.0);
    for triangles in triangles.chunks(BATCH) {
        if triangles.len() < BATCH {
            corners = Corners::zero();
        }
        for (i, triangle) in triangles.iter().enumerate() {
            corners.set(i, *triangle, points);
        }
        for first in (0..triangles.len()).step_by(WIDTH) {
            sum = add_determinants::<S, FUSED>(sum, corners.eight(simd, first), one);
        }
    }
    sum.total()
}

/// A sum of vectors, as z, x, y and a number without meaning: packed cross products come in this order.
pub(crate) type PackedSum = [f64; 4];

/// The vector of a packed sum.
#[inline(always)]
pub(crate) fn unpacked([z, x, y, _]: PackedSum) -> DVec3 {
    DVec3::new(x, y, z)
}

/// x, y, z of point `v` of `coordinates` (#points · 3), and a number without meaning.
#[inline(always)]
fn packed<S: Simd>(simd: S, coordinates: &[f64], v: u32) -> f64x4<S> {
    let first = 3 * v as usize;
    match coordinates.get(first..first + 4) {
        Some(four) => f64x4::from_slice(simd, four),
        None => {
            let [x, y, z] = [coordinates[first], coordinates[first + 1], coordinates[first + 2]];
            f64x4::from_slice(simd, &[x, y, z, 0.0])
        }
    }
}

/// y, z, x, y
#[inline(always)]
fn rotated<S: Simd>(v: f64x4<S>) -> f64x4<S> {
    let (low, high) = v.split();
    low.slide::<1>(high).combine(low)
}

/// [`doubled_area_vector`] of a triangle with packed corners, packed as z, x, y.
#[inline(always)]
fn packed_area_vector<S: Simd>([a, b, c]: [f64x4<S>; 3]) -> f64x4<S> {
    let (b, c) = (b - a, c - a);
    b * rotated(c) - rotated(b) * c
}

/// The corners of a triangle, packed.
#[inline(always)]
fn packed_corners<S: Simd>(simd: S, coordinates: &[f64], [l, m, n]: [u32; 3]) -> [f64x4<S>; 3] {
    [packed(simd, coordinates, l), packed(simd, coordinates, m), packed(simd, coordinates, n)]
}

/// Adds a vector to the sums of those corners of a triangle that are among the vertices from `first` on.
#[inline(always)]
fn add_at_corners<S: Simd>(simd: S, triangle: [u32; 3], vector: f64x4<S>, first: usize, sums: &mut [PackedSum]) {
    for v in triangle {
        if let Some(sum) = sums.get_mut((v as usize).wrapping_sub(first)) {
            (f64x4::from_slice(simd, sum) + vector).store_slice(sum);
        }
    }
}

/// Adds to `sums`, those of the vertices from `first` on, twice the area vectors of the triangles of `list` at each.
#[inline(always)]
pub(crate) fn add_area_vectors<S: Simd>(
    simd: S,
    triangles: &[[u32; 3]],
    list: &[u32],
    points: &[DVec3],
    first: usize,
    sums: &mut [PackedSum],
) {
    let coordinates = bytemuck::cast_slice(points);
    for t in list {
        let triangle = triangles[*t as usize];
        add_at_corners(simd, triangle, packed_area_vector(packed_corners(simd, coordinates, triangle)), first, sums);
    }
}

/// [`add_area_vectors`]; returns `Σ det(p_l, p_m, p_n)` in doubled precision over those triangles whose first corner is among these vertices.
#[inline(always)]
pub(crate) fn add_area_vectors_and_determinants<S: Simd, const FUSED: bool>(
    simd: S,
    triangles: &[[u32; 3]],
    list: &[u32],
    points: &[DVec3],
    first: usize,
    sums: &mut [PackedSum],
) -> Double {
    let mut sum = Lanes::zero(simd);
    let mut corners = Corners::zero();
    let mut own: Column = [0.0; BATCH];
    let coordinates = bytemuck::cast_slice(points);
    for list in list.chunks(BATCH) {
        for (i, t) in list.iter().enumerate() {
            let triangle = triangles[*t as usize];
            corners.set(i, triangle, points);
            own[i] = f64::from(u8::from((triangle[0] as usize).wrapping_sub(first) < sums.len()));
            add_at_corners(
                simd,
                triangle,
                packed_area_vector(packed_corners(simd, coordinates, triangle)),
                first,
                sums,
            );
        }
        own[list.len()..].fill(0.0);
        for at in (0..list.len()).step_by(WIDTH) {
            let share = f64x8::from_slice(simd, &own[at..at + WIDTH]);
            sum = add_determinants::<S, FUSED>(sum, corners.eight(simd, at), share);
        }
    }
    sum.total()
}

/// Σ A(d)·(x_l + x_m + x_n) and Σ A(d)·(d_l + d_m + d_n), each with the sum of its terms' magnitudes; A(d) is twice the area vector of a
/// triangle with corners d.
#[inline(always)]
pub(crate) fn area_products<S: Simd>(simd: S, triangles: &[[u32; 3]], x: &[DVec3], d: &[DVec3]) -> [(f64, f64); 2] {
    let (x, d): (&[f64], &[f64]) = (bytemuck::cast_slice(x), bytemuck::cast_slice(d));
    let zero = f64x4::splat(simd, 0.0);
    let mut sums = [(0.0, 0.0); 2];
    for triangles in triangles.chunks(BATCH) {
        // Sums of a batch first, so that rounding stays small beside the magnitudes.
        let (mut with_x, mut size_x, mut with_d, mut size_d) = (zero, zero, zero, zero);
        for triangle in triangles {
            let of_d = packed_corners(simd, d, *triangle);
            let area = rotated(packed_area_vector(of_d)); // x, y, z
            let term = area * total(packed_corners(simd, x, *triangle));
            (with_x, size_x) = (with_x + term, size_x + term.abs());
            let term = area * total(of_d);
            (with_d, size_d) = (with_d + term, size_d + term.abs());
        }
        for (all, (sum, magnitude)) in sums.iter_mut().zip([(with_x, size_x), (with_d, size_d)]) {
            *all = (all.0 + of_three(sum), all.1 + of_three(magnitude));
        }
    }
    sums
}

#[inline(always)]
fn total<S: Simd>([l, m, n]: [f64x4<S>; 3]) -> f64x4<S> {
    l + m + n
}

/// The sum of the first three numbers.
#[inline(always)]
fn of_three<S: Simd>(v: f64x4<S>) -> f64 {
    let [x, y, z, _]: [f64; 4] = v.into();
    x + y + z
}
