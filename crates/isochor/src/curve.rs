//! Curves in space: Bézier, B-spline and NURBS curves of any degree, and polylines, which have degree 1.
//!
//! `C(u) = Σ_i ω_i P_i B_i(u) / Σ_i ω_i B_i(u)` (L. Piegl, W. Tiller, *The NURBS Book*, 1997, (4.1) and (4.8)): the
//! profiles of surfaces of revolution and of extrusions.

use glam::{DVec3, DVec4};

use crate::bspline::Basis;
use crate::homogeneous::Homogeneous;
use crate::interpolation::{Interpolation, Smoothness};
use crate::patch::{BINOMIAL, go_on, inside, sites};
use crate::pieces::Pieces;
use crate::surface::SurfaceError;
use crate::tolerances;

/// Basis functions that fit the stack; see `patch.rs`.
const ROW: usize = 10;

/// A curve over [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    basis: Basis,
    controls: Vec<DVec3>,
    weights: Option<Vec<f64>>,
    net: Homogeneous,
    pieces: Pieces,
    closes: bool,
}

/// A curve's point and derivatives at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveJet {
    /// C.
    pub point: DVec3,
    /// C′.
    pub first: DVec3,
    /// C″.
    pub second: DVec3,
}

impl Curve {
    /// The curve of as many `controls` as the basis has functions, with as many `weights`, all 1 where there are none.
    ///
    /// # Errors
    ///
    /// Counts that disagree; coordinates that are not finite; weights that are not positive; control points that are
    /// all one.
    pub fn new(basis: Basis, controls: Vec<DVec3>, weights: Option<Vec<f64>>) -> Result<Self, SurfaceError> {
        if controls.len() != basis.size() {
            let (found, expected) = (controls.len(), basis.size());
            return Err(SurfaceError::Count { what: "control points", found, expected });
        }
        let net = Homogeneous::new(&controls, weights.as_deref())?;
        let pieces = Pieces::of(&basis);
        let mut curve = Self { basis, controls, weights, net, pieces, closes: false };
        let ends = [0.0, 1.0].map(|u| curve.jet(u).point);
        curve.closes = ends[0].distance(ends[1]) <= tolerances::SEAM * curve.net.extent;
        Ok(curve)
    }

    /// The straight lines from one point to the next, run through at one speed.
    ///
    /// # Errors
    ///
    /// Fewer than two points or more than [`MAX_SIZE`](crate::MAX_SIZE); neighbours at one place; coordinates that are
    /// not finite.
    pub fn polyline(points: Vec<DVec3>) -> Result<Self, SurfaceError> {
        // Checks the coordinates, and that there are points.
        Homogeneous::new(&points, None)?;
        let mut lengths = vec![0.0];
        for (index, ends) in points.windows(2).enumerate() {
            let length = ends[0].distance(ends[1]);
            if length == 0.0 {
                return Err(SurfaceError::Coincide { index });
            }
            lengths.push(lengths[index] + length);
        }
        let total = lengths[points.len() - 1];
        let interior = lengths.iter().map(|length| length / total);
        let knots = [0.0].into_iter().chain(interior).chain([1.0]).collect();
        let basis =
            Basis::with_knots(knots, 1).map_err(|source| SurfaceError::Basis { axis: "the profile", source })?;
        Self::new(basis, points, None)
    }

    /// The twice continuously differentiable curve through `points` at the parameters i / (n − 1): cubic, of degree n −
    /// 1 where there are n < 4.
    ///
    /// # Errors
    ///
    /// As [`Curve::new`].
    pub fn through(mut points: Vec<DVec3>) -> Result<Self, SurfaceError> {
        // Points that are all one would give control points that rounding spreads.
        Homogeneous::new(&points, None)?;
        let splines = Interpolation::new(points.len(), Smoothness::Bicubic)
            .map_err(|source| SurfaceError::Basis { axis: "the profile", source })?;
        splines.solve(&mut points, 1);
        Self::new(splines.into_basis(), points, None)
    }

    /// The basis.
    #[must_use]
    pub fn basis(&self) -> &Basis {
        &self.basis
    }

    /// Control points, one for each function.
    #[must_use]
    pub fn controls(&self) -> &[DVec3] {
        &self.controls
    }

    /// Weights, if there are any.
    #[must_use]
    pub fn weights(&self) -> Option<&[f64]> {
        self.weights.as_deref()
    }

    /// Whether it ends where it begins.
    #[must_use]
    pub fn closes(&self) -> bool {
        self.closes
    }

    /// Whether it is a single polynomial, or quotient of two.
    pub(crate) fn is_smooth(&self) -> bool {
        self.pieces.is_single()
    }

    /// Longest side of the control points' box.
    pub(crate) fn extent(&self) -> f64 {
        self.net.extent
    }

    /// Point and derivatives at u. A closed curve goes round; another goes on along its tangents at the ends.
    #[must_use]
    pub fn jet(&self, u: f64) -> CurveJet {
        let [point, first, second] = self.derivatives(u);
        CurveJet { point, first, second }
    }

    /// The third derivative at u.
    pub(crate) fn third(&self, u: f64) -> DVec3 {
        let [.., third] = self.derivatives::<4>(u);
        third
    }

    /// The point at u and N − 1 derivatives.
    fn derivatives<const N: usize>(&self, u: f64) -> [DVec3; N] {
        let (at, du) = inside(u, self.closes);
        let mut derivatives = self.in_domain(at);
        if du != 0.0 {
            go_on(&mut derivatives, du);
        }
        derivatives
    }

    fn in_domain<const N: usize>(&self, u: f64) -> [DVec3; N] {
        let length = self.pieces.length();
        if length <= ROW {
            let [mut row, mut scratch] = [[[0.0; N]; ROW]; 2];
            self.contracted(u, &mut row[..length], &mut scratch[..length])
        } else {
            let [mut row, mut scratch] = [0; 2].map(|_| vec![[0.0; N]; length]);
            self.contracted(u, &mut row, &mut scratch)
        }
    }

    fn contracted<const N: usize>(&self, u: f64, row: &mut [[f64; N]], scratch: &mut [[f64; N]]) -> [DVec3; N] {
        let start = self.pieces.derivatives(u, row, scratch);
        let mut sums = [DVec4::ZERO; N];
        for (point, b) in self.net.points[start..].iter().zip(&*row) {
            sums.iter_mut().zip(b).for_each(|(sum, b)| *sum += *b * *point);
        }
        let mut derivatives = sums.map(DVec4::truncate);
        if self.net.rational {
            // As for patches: (4.8).
            for k in 0..N {
                let lower = (1..=k).map(|i| BINOMIAL[k][i] * sums[i].w * derivatives[k - i]).sum::<DVec3>();
                derivatives[k] = (derivatives[k] - lower) / sums[0].w;
            }
        }
        derivatives[0] += self.net.origin;
        derivatives
    }

    /// Ends of its polynomial pieces: 0 first, 1 last.
    pub(crate) fn breaks(&self) -> Vec<f64> {
        self.basis.breaks()
    }

    /// Parameters at which a polynomial of twice its degree cannot vanish everywhere without being 0.
    pub(crate) fn sites(&self) -> Vec<f64> {
        sites(&self.basis)
    }
}
