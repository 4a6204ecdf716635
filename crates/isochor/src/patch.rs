//! Tensor-product patches: Bézier, B-spline and NURBS surfaces of any degrees.
//!
//! `S(s, t) = Σ_ij ω_ij P_ij B_i(s) B_j(t) / Σ_ij ω_ij B_i(s) B_j(t)` and its derivatives, for bases B on any knots (L.
//! Piegl, W. Tiller, *The NURBS Book*, 1997, (4.11) and (4.20)); the bases' Bézier coefficients are tabulated once, so
//! that an evaluation divides little and, up to degree [`ROW`] − 1, asks for no memory.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4};
use glam::{DVec2, DVec3, DVec4, Vec2Swizzles};

use crate::bspline::Basis;
use crate::curve::Curve;
use crate::extrusion::Extrusion;
use crate::homogeneous::Homogeneous;
use crate::interpolation::{Interpolation, Smoothness};
use crate::pieces::Pieces;
use crate::surface::{Jet, SurfaceError, size as side};
use crate::tolerances;

/// Basis functions of one parameter that fit the stack. Larger: every evaluation clears more memory; smaller: more
/// degrees need the heap.
const ROW: usize = 10;

/// Binomial coefficients.
pub(crate) const BINOMIAL: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1.0, 2.0, 1.0, 0.0], [1.0, 3.0, 3.0, 1.0]];

/// A patch: control points, weights and two bases.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    bases: [Basis; 2],
    controls: Vec<DVec3>,
    weights: Option<Vec<f64>>,
    net: Homogeneous,
    pieces: [Pieces; 2],
    closes: [bool; 2],
    /// The borders s = 0, s = 1, t = 0, t = 1: those that are one point, and the normal there, if there is one.
    poles: [Option<Option<DVec3>>; 4],
    /// The extrusion of a curve that the patch is, if it is one, and the axis along which that goes.
    extrusion: Option<(usize, Box<Extrusion>)>,
}

/// Point and derivatives: `∂^{k+l} S / ∂s^k ∂t^l` at [k][l], k and l below N.
pub(crate) type Partials<const N: usize> = [[DVec3; N]; N];

impl Patch {
    /// The patch of `controls` (n × m, those of one i after the other: P_ij is `controls[i · m + j]`) for bases of n
    /// and m functions along s and t, with as many `weights`, all 1 where there are none.
    ///
    /// # Errors
    ///
    /// Counts that disagree; coordinates that are not finite; weights that are not positive; a patch without area.
    pub fn new(bases: [Basis; 2], controls: Vec<DVec3>, weights: Option<Vec<f64>>) -> Result<Self, SurfaceError> {
        let expected = bases[0].size() * bases[1].size();
        if controls.len() != expected {
            return Err(SurfaceError::Count { what: "control points", found: controls.len(), expected });
        }
        let net = Homogeneous::new(&controls, weights.as_deref())?;
        let pieces = [Pieces::of(&bases[0]), Pieces::of(&bases[1])];
        let (closes, poles) = ([false; 2], [None; 4]);
        let mut patch = Self { bases, controls, weights, net, pieces, closes, poles, extrusion: None };
        if patch.is_flat() {
            return Err(SurfaceError::Flat { what: "the patch" });
        }
        patch.closes = [0, 1].map(|axis| patch.meets(axis));
        patch.poles = [0, 1, 2, 3].map(|border| patch.pole_at(border));
        patch.extrusion = [1, 0].into_iter().find_map(|axis| Some((axis, Box::new(patch.extruded(axis)?))));
        Ok(patch)
    }

    /// The patch through `points` (`size[0]` × `size[1]`, those of one i after the other), which are met at the
    /// parameters `(i / (size[0] − 1), j / (size[1] − 1))`.
    ///
    /// # Errors
    ///
    /// Fewer than two points along s or t, or more than [`MAX_SIZE`](crate::MAX_SIZE); otherwise as [`Patch::new`].
    pub fn through(size: [usize; 2], points: &[DVec3], smoothness: Smoothness) -> Result<Self, SurfaceError> {
        let [n, m] = size;
        // A product beyond usize is beyond any list, too.
        let expected = n.saturating_mul(m);
        if points.len() != expected {
            return Err(SurfaceError::Count { what: "points", found: points.len(), expected });
        }
        // Points that are all one would give control points that rounding spreads.
        Homogeneous::new(points, None)?;
        let along = |axis: usize| {
            Interpolation::new(size[axis], smoothness)
                .map_err(|source| SurfaceError::Basis { axis: ["s", "t"][axis], source })
        };
        let [over_s, over_t] = [along(0)?, along(1)?];
        let mut controls = points.to_vec();
        controls.chunks_exact_mut(m).for_each(|row| over_t.solve(row, 1));
        (0..m).for_each(|j| over_s.solve(&mut controls[j..], m));
        Self::new([over_s.into_basis(), over_t.into_basis()], controls, None)
    }

    /// The height field through `heights` (`counts[0]` × `counts[1]`, those of one i after the other), i at x =
    /// `size[0]` i / (`counts[0]` − 1), j likewise along y; normals point upwards.
    ///
    /// # Errors
    ///
    /// Sides that are not positive; otherwise as [`Patch::through`].
    pub fn over_rectangle(
        size: [f64; 2],
        counts: [usize; 2],
        heights: &[f64],
        smoothness: Smoothness,
    ) -> Result<Self, SurfaceError> {
        let [width, depth] =
            [side("the rectangle's side along x", size[0])?, side("the rectangle's side along y", size[1])?];
        let [n, m] = counts;
        // No smaller than 1, so that a single row, an error of the bases, has coordinates.
        let at = |i: usize, count: usize| i as f64 / count.saturating_sub(1).max(1) as f64;
        let point = |(k, height): (usize, &f64)| {
            let (i, j) = (k / m.max(1), k % m.max(1));
            DVec3::new(width * at(i, n), depth * at(j, m), *height)
        };
        let points: Vec<DVec3> = heights.iter().enumerate().map(point).collect();
        Self::through(counts, &points, smoothness)
    }

    /// Bases along s and t.
    #[must_use]
    pub fn bases(&self) -> &[Basis; 2] {
        &self.bases
    }

    /// Control points, n × m, P_ij at `i · m + j`.
    #[must_use]
    pub fn controls(&self) -> &[DVec3] {
        &self.controls
    }

    /// Weights, n × m, if there are any.
    #[must_use]
    pub fn weights(&self) -> Option<&[f64]> {
        self.weights.as_deref()
    }

    /// The extrusion that the patch is, with the axis along which it goes.
    pub(crate) fn extrusion(&self) -> Option<(usize, &Extrusion)> {
        self.extrusion.as_ref().map(|(axis, extrusion)| (*axis, &**extrusion))
    }

    /// Where (s, t) is when the patch is unrolled, if it is an extrusion: x along s, y along t.
    pub(crate) fn development(&self, s: f64, t: f64) -> Option<DVec2> {
        let (axis, extrusion) = self.extrusion()?;
        let along_curve = [t, s][axis];
        let unrolled = extrusion.unrolled(along_curve, self.partials::<2>(s, t)[0][0]);
        Some(if axis == 1 { unrolled } else { unrolled.yx() })
    }

    /// What sweeps the patch along an axis: `P_ij = C_i + τ_j a` with rising τ, and weights that differ along the curve C alone.
    fn extruded(&self, axis: usize) -> Option<Extrusion> {
        let (columns, count) = (self.bases[1].size(), self.bases[axis].size());
        let at = |along_curve: usize, j: usize| {
            if axis == 1 { along_curve * columns + j } else { j * columns + along_curve }
        };
        let curve = 0..self.bases[1 - axis].size();
        let along = self.controls[at(0, count - 1)] - self.controls[at(0, 0)];
        if along == DVec3::ZERO {
            return None;
        }
        let share = |j: usize| (self.controls[at(0, j)] - self.controls[at(0, 0)]).dot(along) / along.length_squared();
        let shares: Vec<f64> = (0..count).map(share).collect();
        let near = tolerances::SEAM * self.net.extent;
        let is_swept = |i: usize, j: usize| {
            let swept = self.controls[at(i, 0)] + shares[j] * along;
            self.controls[at(i, j)].distance(swept) <= near
                && self.weights.as_ref().is_none_or(|weights| weights[at(i, j)] == weights[at(i, 0)])
        };
        let rises = shares.windows(2).all(|two| two[0] < two[1]);
        if !rises || !curve.clone().all(|i| (0..count).all(|j| is_swept(i, j))) {
            return None;
        }
        let controls = curve.clone().map(|i| self.controls[at(i, 0)]).collect();
        let weights = self.weights.as_ref().map(|weights| curve.map(|i| weights[at(i, 0)]).collect());
        Extrusion::new(Curve::new(self.bases[1 - axis].clone(), controls, weights).ok()?, along).ok()
    }

    /// Whether it is a single polynomial, or quotient of two.
    pub(crate) fn is_smooth(&self) -> bool {
        self.pieces.iter().all(Pieces::is_single)
    }

    /// Whether s = 0 and s = 1, and t = 0 and t = 1, are the same curve.
    pub(crate) fn closes(&self) -> [bool; 2] {
        self.closes
    }

    /// The borders s = 0, s = 1, t = 0, t = 1 that are one point, with the normal there, if there is one.
    pub(crate) fn poles(&self) -> &[Option<Option<DVec3>>; 4] {
        &self.poles
    }

    /// The jet at (s, t); see [`Patch::partials`].
    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        jet(&self.partials::<3>(s, t))
    }

    /// Point and derivatives at (s, t). A closed patch goes round; another goes on along its tangents at the border.
    #[inline]
    pub(crate) fn partials<const N: usize>(&self, s: f64, t: f64) -> Partials<N> {
        let (s_in, ds) = inside(s, self.closes[0]);
        let (t_in, dt) = inside(t, self.closes[1]);
        let mut partials = self.in_domain(s_in, t_in);
        if ds != 0.0 {
            let slopes = partials[1];
            partials[0].iter_mut().zip(slopes).for_each(|(value, slope)| *value += ds * slope);
            partials[2..].fill([DVec3::ZERO; N]);
        }
        if dt != 0.0 {
            partials.iter_mut().for_each(|row| go_on(row, dt));
        }
        partials
    }

    /// The same in the domain.
    #[inline]
    fn in_domain<const N: usize>(&self, s: f64, t: f64) -> Partials<N> {
        // The same bits with all registers: nothing is fused.
        dispatch!(Level::new(), simd => self.of_lengths(simd, s, t))
    }

    #[inline(always)]
    fn of_lengths<S: Simd, const N: usize>(&self, simd: S, s: f64, t: f64) -> Partials<N> {
        let zero = [0.0; N];
        match [self.pieces[0].length(), self.pieces[1].length()] {
            [4, 4] => self.contracted(simd, [s, t], [&mut [zero; 4], &mut [zero; 4]], &mut [zero; 4]),
            [3, 3] => self.contracted(simd, [s, t], [&mut [zero; 3], &mut [zero; 3]], &mut [zero; 3]),
            [2, 2] => self.contracted(simd, [s, t], [&mut [zero; 2], &mut [zero; 2]], &mut [zero; 2]),
            [p, q] if p <= ROW && q <= ROW => {
                let [mut along_s, mut along_t, mut scratch] = [[zero; ROW]; 3];
                self.contracted(simd, [s, t], [&mut along_s[..p], &mut along_t[..q]], &mut scratch)
            }
            [p, q] => {
                let [mut along_s, mut along_t, mut scratch] = [p, q, p.max(q)].map(|length| vec![zero; length]);
                self.contracted(simd, [s, t], [&mut along_s, &mut along_t], &mut scratch)
            }
        }
    }

    /// Inlined, so that rows of known lengths become loops of these lengths.
    #[inline(always)]
    fn contracted<S: Simd, const N: usize>(
        &self,
        simd: S,
        [s, t]: [f64; 2],
        [along_s, along_t]: [&mut [[f64; N]]; 2],
        scratch: &mut [[f64; N]],
    ) -> Partials<N> {
        let [p, q] = [along_s.len(), along_t.len()];
        let first_s = self.pieces[0].derivatives(s, along_s, &mut scratch[..p]);
        let first_t = self.pieces[1].derivatives(t, along_t, &mut scratch[..q]);
        let m = self.bases[1].size();
        let zero = f64x4::splat(simd, 0.0);
        let mut sums = [[zero; N]; N];
        for (i, u) in along_s.iter().enumerate() {
            let start = (first_s + i) * m + first_t;
            let mut row = [zero; N];
            for (point, v) in self.net.points[start..start + q].iter().zip(&*along_t) {
                let point = f64x4::from_slice(simd, &point.to_array());
                for (sum, v) in row.iter_mut().zip(v) {
                    *sum += point * *v;
                }
            }
            for (sums, u) in sums.iter_mut().zip(u) {
                for (sum, of_row) in sums.iter_mut().zip(row) {
                    *sum += of_row * *u;
                }
            }
        }
        let mut stored = [[DVec4::ZERO; N]; N];
        for (stored, sums) in stored.iter_mut().zip(sums) {
            for (stored, sum) in stored.iter_mut().zip(sums) {
                *stored = DVec4::from_array(sum.into());
            }
        }
        let sums = stored;
        let mut partials = if self.net.rational { quotient(&sums) } else { sums.map(|row| row.map(DVec4::truncate)) };
        partials[0][0] += self.net.origin;
        partials
    }

    /// Whether `|S_s × S_t|` is nothing wherever it is looked at: so often that a polynomial that is not 0 cannot hide.
    fn is_flat(&self) -> bool {
        let [over_s, over_t] = [0, 1].map(|axis| sites(&self.bases[axis]));
        let is_flat = |s: f64, t: f64| {
            let jet = self.jet(s, t);
            let longer = jet.s.length().max(jet.t.length());
            jet.s.cross(jet.t).length() <= tolerances::FLAT_SURFACE * longer * self.net.extent
        };
        over_s.iter().all(|s| over_t.iter().all(|t| is_flat(*s, *t)))
    }

    /// Whether the borders at 0 and 1 along an axis are the same curve, and no pole.
    fn meets(&self, axis: usize) -> bool {
        let at = |end: f64, along: f64| {
            let (s, t) = if axis == 0 { (end, along) } else { (along, end) };
            self.jet(s, t).point
        };
        let near = tolerances::SEAM * self.net.extent;
        let sites = sites(&self.bases[1 - axis]);
        let is_point = sites.iter().all(|x| at(0.0, *x).distance(at(0.0, 0.0)) <= near);
        !is_point && sites.iter().all(|x| at(0.0, *x).distance(at(1.0, *x)) <= near)
    }

    /// Whether a border is one point, and the normal there. Near the pole t = 0 is `S_s ≈ t S_st`, so the normal
    /// towards it along s is that of `S_st × S_t`; likewise at the other borders.
    fn pole_at(&self, border: usize) -> Option<Option<DVec3>> {
        let (axis, end) = (border / 2, (border % 2) as f64);
        let sites = sites(&self.bases[1 - axis]);
        let jet = |along: f64| if axis == 0 { self.jet(end, along) } else { self.jet(along, end) };
        let corner = jet(0.0).point;
        if sites.iter().any(|x| jet(*x).point.distance(corner) > tolerances::SEAM * self.net.extent) {
            return None;
        }
        let normal = |along: f64| {
            let jet = jet(along);
            let across = if axis == 0 { jet.s.cross(jet.st) } else { jet.st.cross(jet.t) };
            (if end == 0.0 { across } else { -across }).try_normalize()
        };
        let first = normal(0.0);
        let agrees = |x: &f64| first.zip(normal(*x)).is_some_and(|(a, b)| a.distance(b) <= tolerances::POLE);
        Some(first.filter(|_| sites.iter().all(agrees)))
    }
}

/// The parameter in [0, 1], and how far beyond it is; a closed one goes round.
pub(crate) fn inside(u: f64, closes: bool) -> (f64, f64) {
    if (0.0..=1.0).contains(&u) {
        (u, 0.0)
    } else if closes {
        (u - u.floor(), 0.0)
    } else {
        let end = u.clamp(0.0, 1.0);
        (end, u - end)
    }
}

/// What was at the border, d beyond it along the tangent: value and derivatives.
pub(crate) fn go_on<const N: usize>(row: &mut [DVec3; N], d: f64) {
    row[0] += d * row[1];
    row[2..].fill(DVec3::ZERO);
}

/// The derivatives of S where those of A = w S are (x, y, z) of `sums` and those of w their w: Leibniz's rule, solved for the derivatives
/// of S one after the other; (4.20).
fn quotient<const N: usize>(sums: &[[DVec4; N]; N]) -> Partials<N> {
    let mut partials = [[DVec3::ZERO; N]; N];
    for k in 0..N {
        for l in 0..N {
            let mut rest = sums[k][l].truncate();
            for i in 0..=k {
                for j in 0..=l {
                    // That of S itself is 0 yet.
                    rest -= BINOMIAL[k][i] * BINOMIAL[l][j] * sums[i][j].w * partials[k - i][l - j];
                }
            }
            partials[k][l] = rest / sums[0][0].w;
        }
    }
    partials
}

/// The jet among derivatives.
pub(crate) fn jet<const N: usize>(partials: &Partials<N>) -> Jet {
    let [s, t] = [partials[1][0], partials[0][1]];
    Jet { point: partials[0][0], s, t, ss: partials[2][0], st: partials[1][1], tt: partials[0][2] }
}

/// Parameters in every span of a basis, 2 (degree + 1) of them and both ends: more than polynomials of twice the degree
/// have zeros.
pub(crate) fn sites(basis: &Basis) -> Vec<f64> {
    let count = 2 * (basis.degree() + 1);
    let in_span = |ends: &[f64]| {
        let [from, to] = [ends[0], ends[1]];
        (0..count).map(move |k| from + (to - from) * (k as f64 / count as f64)).collect::<Vec<_>>()
    };
    basis.breaks().windows(2).flat_map(in_span).chain([1.0]).collect()
}
