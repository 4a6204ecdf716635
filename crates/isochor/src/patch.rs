//! Tensor-product patches: Bézier, B-spline and NURBS surfaces of any degrees.
//!
//! `S(s, t) = Σ_ij ω_ij P_ij B_i(s) B_j(t) / Σ_ij ω_ij B_i(s) B_j(t)` and its derivatives, for bases B on any knots (L.
//! Piegl, W. Tiller, *The NURBS Book*, 1997, (4.11) and (4.20)); the bases' Bézier coefficients are tabulated once, so
//! that an evaluation divides little and, up to degree [`ROW`] − 1, asks for no memory.

use glam::{DVec3, DVec4};

use crate::bspline::Basis;
use crate::homogeneous::Homogeneous;
use crate::interpolation::{Interpolation, Smoothness};
use crate::pieces::Pieces;
use crate::surface::{Jet, SurfaceError, size as side};
use crate::tolerances;

/// Basis functions of one parameter that fit the stack. Larger: every evaluation clears more memory; smaller: more
/// degrees need the heap.
const ROW: usize = 10;

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
}

/// Derivatives that are only needed beyond the domain, beside a jet.
struct Third {
    sst: DVec3,
    stt: DVec3,
}

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
        let mut patch = Self { bases, controls, weights, net, pieces, closes: [false; 2], poles: [None; 4] };
        if patch.is_flat() {
            return Err(SurfaceError::Flat { what: "the patch" });
        }
        patch.closes = [0, 1].map(|axis| patch.meets(axis));
        patch.poles = [0, 1, 2, 3].map(|border| patch.pole_at(border));
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

    /// Whether s = 0 and s = 1, and t = 0 and t = 1, are the same curve.
    pub(crate) fn closes(&self) -> [bool; 2] {
        self.closes
    }

    /// The borders s = 0, s = 1, t = 0, t = 1 that are one point, with the normal there, if there is one.
    pub(crate) fn poles(&self) -> &[Option<Option<DVec3>>; 4] {
        &self.poles
    }

    /// The jet at (s, t). A closed patch goes round; another goes on along its tangents at the border.
    pub(crate) fn jet(&self, s: f64, t: f64) -> Jet {
        let (s_in, ds) = inside(s, self.closes[0]);
        let (t_in, dt) = inside(t, self.closes[1]);
        let (jet, third) = self.with_rows(s_in, t_in);
        if ds == 0.0 && dt == 0.0 { jet } else { beyond(&jet, &third, ds, dt) }
    }

    /// The jet in the domain.
    fn with_rows(&self, s: f64, t: f64) -> (Jet, Third) {
        match [self.pieces[0].length(), self.pieces[1].length()] {
            [4, 4] => self.contracted([s, t], [&mut [0.0; 12], &mut [0.0; 12]], &mut [0.0; 12]),
            [3, 3] => self.contracted([s, t], [&mut [0.0; 9], &mut [0.0; 9]], &mut [0.0; 9]),
            [2, 2] => self.contracted([s, t], [&mut [0.0; 6], &mut [0.0; 6]], &mut [0.0; 6]),
            [p, q] if p <= ROW && q <= ROW => {
                let [mut along_s, mut along_t, mut scratch] = [[0.0; 3 * ROW]; 3];
                self.contracted([s, t], [&mut along_s[..3 * p], &mut along_t[..3 * q]], &mut scratch)
            }
            [p, q] => {
                let [mut along_s, mut along_t, mut scratch] = [p, q, p.max(q)].map(|length| vec![0.0; 3 * length]);
                self.contracted([s, t], [&mut along_s, &mut along_t], &mut scratch)
            }
        }
    }

    /// Inlined, so that rows of known lengths become loops of these lengths.
    #[inline(always)]
    fn contracted(&self, [s, t]: [f64; 2], [along_s, along_t]: [&mut [f64]; 2], scratch: &mut [f64]) -> (Jet, Third) {
        let [p, q] = [along_s.len() / 3, along_t.len() / 3];
        let first_s = self.pieces[0].jet_row(s, along_s, &mut scratch[..3 * p]);
        let first_t = self.pieces[1].jet_row(t, along_t, &mut scratch[..3 * q]);
        let (v0, v12) = along_t.split_at(q);
        let (v1, v2) = v12.split_at(q);
        let [mut a, mut a_s, mut a_t, mut a_ss, mut a_st, mut a_tt, mut a_sst, mut a_stt] = [DVec4::ZERO; 8];
        let m = self.bases[1].size();
        for i in 0..p {
            let start = (first_s + i) * m + first_t;
            let [mut b, mut b_t, mut b_tt] = [DVec4::ZERO; 3];
            for (((point, v0), v1), v2) in self.net.points[start..start + q].iter().zip(v0).zip(v1).zip(v2) {
                b += *v0 * *point;
                b_t += *v1 * *point;
                b_tt += *v2 * *point;
            }
            let [u0, u1, u2] = [along_s[i], along_s[p + i], along_s[2 * p + i]];
            a += u0 * b;
            a_s += u1 * b;
            a_t += u0 * b_t;
            a_ss += u2 * b;
            a_st += u1 * b_t;
            a_tt += u0 * b_tt;
            a_sst += u2 * b_t;
            a_stt += u1 * b_tt;
        }
        let local = [a, a_s, a_t, a_ss, a_st, a_tt, a_sst, a_stt].map(DVec4::truncate);
        let [mut point, mut s, mut t, mut ss, mut st, mut tt, mut sst, mut stt] = local;
        if self.net.rational {
            // A = w S, differentiated by Leibniz's rule and solved for the derivatives of S: (4.20).
            let w = a.w;
            point /= w;
            s = (s - a_s.w * point) / w;
            t = (t - a_t.w * point) / w;
            ss = (ss - 2.0 * a_s.w * s - a_ss.w * point) / w;
            st = (st - a_s.w * t - a_t.w * s - a_st.w * point) / w;
            tt = (tt - 2.0 * a_t.w * t - a_tt.w * point) / w;
            sst = (sst - a_t.w * ss - 2.0 * a_s.w * st - a_ss.w * t - 2.0 * a_st.w * s - a_sst.w * point) / w;
            stt = (stt - a_s.w * tt - 2.0 * a_t.w * st - a_tt.w * s - 2.0 * a_st.w * t - a_stt.w * point) / w;
        }
        (Jet { point: self.net.origin + point, s, t, ss, st, tt }, Third { sst, stt })
    }

    /// Whether `|S_s × S_t|` is nothing wherever it is looked at: so often that a polynomial that is not 0 cannot hide.
    fn is_flat(&self) -> bool {
        let [over_s, over_t] = [0, 1].map(|axis| sites(&self.bases[axis]));
        let is_flat = |s: f64, t: f64| {
            let jet = self.with_rows(s, t).0;
            let longer = jet.s.length().max(jet.t.length());
            jet.s.cross(jet.t).length() <= tolerances::FLAT_SURFACE * longer * self.net.extent
        };
        over_s.iter().all(|s| over_t.iter().all(|t| is_flat(*s, *t)))
    }

    /// Whether the borders at 0 and 1 along an axis are the same curve, and no pole.
    fn meets(&self, axis: usize) -> bool {
        let at = |end: f64, along: f64| {
            let (s, t) = if axis == 0 { (end, along) } else { (along, end) };
            self.with_rows(s, t).0.point
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
        let jet = |along: f64| if axis == 0 { self.with_rows(end, along).0 } else { self.with_rows(along, end).0 };
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

/// The jet ds and dt beyond the domain, with the jet at its border: `S + ds S_s + dt S_t + ds dt S_st`.
fn beyond(jet: &Jet, third: &Third, ds: f64, dt: f64) -> Jet {
    Jet {
        point: jet.point + ds * jet.s + dt * jet.t + ds * dt * jet.st,
        s: jet.s + dt * jet.st,
        t: jet.t + ds * jet.st,
        ss: if ds == 0.0 { jet.ss + dt * third.sst } else { DVec3::ZERO },
        st: jet.st,
        tt: if dt == 0.0 { jet.tt + ds * third.stt } else { DVec3::ZERO },
    }
}

/// Parameters in every span of a basis, 2 (degree + 1) of them and both ends: more than polynomials of twice the degree
/// have zeros.
pub(crate) fn sites(basis: &Basis) -> Vec<f64> {
    let mut breaks = basis.knots()[basis.degree()..=basis.size()].to_vec();
    breaks.dedup();
    let count = 2 * (basis.degree() + 1);
    let in_span = |ends: &[f64]| {
        let [from, to] = [ends[0], ends[1]];
        (0..count).map(move |k| from + (to - from) * (k as f64 / count as f64)).collect::<Vec<_>>()
    };
    breaks.windows(2).flat_map(in_span).chain([1.0]).collect()
}
