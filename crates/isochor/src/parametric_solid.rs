//! Bodies bounded by parametric surfaces: sampled as triangles, or integrated.
//!
//! Given surfaces S(s, t) that close a body, and a deformation φ, the volume of the deformed body is
//!
//! ```text
//! V = 1/3 Σ ∫∫ x · (x_s × x_t) ds dt,   x = φ(S(s, t)),   x_s = φ′ S_s,   x_t = φ′ S_t          (25)
//! ```
//!
//! ([`ParametricSolid::volume`]), and that of triangles between samples of x tends to it as fast as their number grows
//! ([`ParametricSolid::sampled`]). HML, sections 4.1 and 4.2.
//!
//! **How many points.** Where S is a polynomial of degree p in s, and φ a lattice of total degree n (the sum of its degrees along u, v, w), the integrand
//! is a polynomial in s of degree
//!
//! ```text
//! 3p − 2             without a lattice: `x = a s^p + …` gives s^(3p−1) the coefficient a · (p a × a_t) = 0
//! 3np − 2p − 1       with one: x = D f + g, the monomial f of degree np, D a constant, g of degree (n − 1) p;
//!                    terms with D twice vanish, and so do, for g = b s^((n−1)p) + …, all but −p f det(D, b, b_t)
//! ```
//!
//! at most, and likewise in t; behind another lattice p is the degree of what that one has made. Gauss and Legendre's rule of K points is exact up to
//! the degree 2K − 1, which gives K along s and t, in each cell between the knots of S. Other surfaces (spheres, tori, revolutions, rational patches) and
//! lattices with knots inside have no such number: the points are doubled until two rules agree.
//!
//! **Joints.** Borders that are the same curve at the same parameters, run in either direction, are joined: they are sampled once. A border that is one
//! point is sampled once. Borders that no other runs along are open. They are closed by the virtual caps of [`Solid`](crate::Solid): its apex is the mean of the
//! boundary's samples and goes where they go. The volume has the limit of these caps, `1/6 ∮ det(A, x, x′)` round each boundary, A the mean of x along it, equal
//! shares to all its borders.
//!
//! ```
//! use isochor::{OpenBoundaries, ParametricSolid, Solid, topology};
//!
//! let torus = ParametricSolid::torus(1.0, 0.4)?;
//! let mesh = torus.sampled(1000)?;
//! let triangles = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse)?.volume(mesh.points());
//! let exact = torus.volume()?.volume;
//! assert!(triangles > 0.95 * exact && triangles < exact);
//! # Ok::<(), isochor::ParametricSolidError>(())
//! ```
//!
//! HML = G. Hirota, R. Maheshwari, M. C. Lin, *Fast volume-preserving free form deformation using multi-level optimization* (1999).
//!
//! # Changes versus the paper
//!
//! - (23) and (25) take ∫ z n_z: a third of ∫ x · n is the same for a closed body, and does not prefer an axis.
//! - The paper measures with triangles alone, because boundaries of trimmed patches are irregular. Here there are no trimmed patches.
//! - The paper starts with 16 triangles, which enclose nothing when a torus is sampled evenly. [`LEAST_TRIANGLES`] is the least here.

use glam::DVec3;

use crate::bspline::Basis;
use crate::curve::Curve;
use crate::gauss::gauss_legendre;
use crate::lattice::{Frame, Lattice, LatticeError, Outside};
use crate::mesh::{Bounds, Faces, Mesh, MeshError};
use crate::parallel;
use crate::surface::{Surface, SurfaceError};
use crate::tolerances;
use crate::topology::DisjointSets;
use crate::volume::{OpenBoundaries, SolidError};

/// A body is sampled by no fewer triangles. More: coarse levels cost more; fewer: they enclose little of what they stand for.
pub const LEAST_TRIANGLES: usize = 64;

/// Angles of a full turn, degrees.
const FULL: [f64; 2] = [0.0, 360.0];

/// Points along s and t to begin with where no number is exact, and at most. More to begin with: time is wasted on simple shapes; fewer: another
/// doubling. More at most: lattices with knots inside, for which rules converge slowly, take long; fewer: deformations of high degree are not
/// met to rounding.
const POINTS: [usize; 2] = [16, 128];

/// Two rules agree where their difference is below this fraction of `1/3 ∫∫ |x · (x_s × x_t)|`. Larger: digits are lost; smaller: rounding is doubled.
const AGREE: f64 = 1e-14;

/// Places in each part of a border where it is compared with another: more than twice the degree of a polynomial for degrees up to 9.
const SITES: usize = 20;

/// A body bounded by parametric surfaces, deformed by lattices.
#[derive(Clone, Debug, PartialEq)]
pub struct ParametricSolid {
    surfaces: Vec<Surface>,
    /// Lattices, each with the displacement of its control points, in the order in which they act.
    deformations: Vec<(Lattice, Vec<DVec3>)>,
    /// Borders that are one point.
    poles: Vec<Border>,
    /// Pairs of borders that are one curve, and whether they are run in opposite directions.
    joints: Vec<([Border; 2], bool)>,
    /// For each corner of a surface the first one at its place; [`corner`] numbers them.
    corners: Vec<usize>,
    /// Borders that are open, by boundary.
    boundaries: Vec<Vec<Border>>,
    /// Whether the surfaces face inwards.
    is_turned: bool,
}

/// A border of a surface: s = 0, s = 1, t = 0, t = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Border {
    surface: usize,
    side: usize,
}

/// A volume by quadrature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussVolume {
    /// The volume, caps included, in the cube of the length unit.
    pub volume: f64,
    /// By how much the last two rules differ, far more than the error of the last where the surfaces are smooth. 0 where the rule is exact but for rounding.
    pub difference: f64,
    /// Points of the last rule, on all surfaces.
    pub points: usize,
}

/// Why surfaces bound no body, or none that can be sampled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParametricSolidError {
    /// A surface is impossible.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// No surface at all.
    #[error("there are no surfaces, so nothing is enclosed")]
    NoSurfaces,
    /// A border along which no other runs, and open boundaries were to be refused.
    #[error(
        "surface {surface} is open at {border}: no other border is the same curve; add what closes it, or ask for caps"
    )]
    Open {
        /// Which surface, from 0.
        surface: usize,
        /// Its border.
        border: &'static str,
    },
    /// Two surfaces of which one faces inwards, the other outwards.
    #[error("surfaces {} and {} run along their common border in the same direction: flip one of them", .surfaces[0], .surfaces[1])]
    Winding {
        /// Which surfaces, from 0.
        surfaces: [usize; 2],
    },
    /// Too little volume for the size of the body, or coordinates beyond the range of numbers.
    #[error("surfaces of the extent {extent:e} enclose {volume:e}, which is nothing")]
    NoVolume {
        /// What they enclose.
        volume: f64,
        /// Longest side of their box.
        extent: f64,
    },
    /// More triangles than can be numbered.
    #[error("{triangles} triangles are too many: at most {most} can be made of these surfaces")]
    TooMany {
        /// How many were asked for.
        triangles: usize,
        /// How many there can be.
        most: usize,
    },
    /// Samples outside a lattice that deforms the body.
    #[error("a lattice must hold the whole body, but {0}")]
    Lattice(#[from] LatticeError),
    /// Samples beyond the range of numbers.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Samples that bound no body.
    #[error(transparent)]
    Solid(#[from] SolidError),
}

impl ParametricSolid {
    /// The ball of that radius about the origin.
    ///
    /// # Errors
    ///
    /// A radius that is not positive.
    pub fn sphere(radius: f64) -> Result<Self, ParametricSolidError> {
        Self::closed(Surface::sphere(radius, FULL, [-90.0, 90.0])?)
    }

    /// The torus about the z axis: `major` is the radius of its tube's middle, `minor` that of the tube.
    ///
    /// # Errors
    ///
    /// Radii that are not positive; a tube as wide as the torus, or wider.
    pub fn torus(major: f64, minor: f64) -> Result<Self, ParametricSolidError> {
        Self::closed(Surface::torus([major, minor], FULL, FULL)?)
    }

    /// HML's rounded club (plate 3), "a sphere deformed by the FFD": the unit sphere, its poles on the x axis, in a Bernstein lattice of 5 × 2 × 2 control
    /// points over [−1, 1]³. Those of the layers along x go to −3, −1.6, 0, 1.6, 3, and their y and z to the 1.15, 1, 0.35, 0.6, 0.75-fold. The paper
    /// does not state its numbers.
    ///
    /// # Panics
    ///
    /// Never: these numbers make a body.
    #[must_use]
    pub fn club() -> Self {
        const LAYERS: [[f64; 2]; 5] = [[-3.0, 1.15], [-1.6, 1.0], [0.0, 0.35], [1.6, 0.6], [3.0, 0.75]];
        let frame = Frame { origin: DVec3::splat(-1.0), axes: DVec3::AXES.map(|axis| 2.0 * axis) };
        let bases = [5, 2, 2].map(|size| Basis::bernstein(size).expect("sizes above 1"));
        let lattice = Lattice::new(bases, frame).expect("a cube");
        let pulled = |(c, rest): (usize, &DVec3)| {
            let [x, width] = LAYERS[lattice.node(c)[0]];
            DVec3::new(x, width * rest.y, width * rest.z) - *rest
        };
        let displacement = lattice.rest().iter().enumerate().map(pulled).collect();
        let sphere = Surface::sphere(1.0, FULL, [-90.0, 90.0])
            .and_then(|sphere| sphere.placed(DVec3::ZERO, DVec3::X, DVec3::Y))
            .expect("a sphere");
        Self::closed(sphere).expect("a sphere is closed").deformed(lattice, displacement)
    }

    /// The body that the profile `curve` bounds when it is turned about the z axis: it begins and ends on the axis, or is a closed loop beside it.
    ///
    /// # Errors
    ///
    /// A profile that does neither; one that encloses nothing.
    pub fn revolution(curve: Curve) -> Result<Self, ParametricSolidError> {
        Self::closed(Surface::revolution(curve, [DVec3::ZERO, DVec3::Z], FULL)?)
    }

    /// The body that one surface bounds by itself.
    fn closed(surface: Surface) -> Result<Self, ParametricSolidError> {
        Self::patches(vec![surface], OpenBoundaries::Refuse)
    }

    /// The body that `surfaces` bound together. Their normals point outwards, or all of them inwards: a body of negative volume is turned. Open
    /// boundaries get caps, or are refused.
    ///
    /// # Errors
    ///
    /// No surfaces; normals that disagree at a common border; open boundaries, if they are to be refused; nothing enclosed.
    pub fn patches(surfaces: Vec<Surface>, open: OpenBoundaries) -> Result<Self, ParametricSolidError> {
        if surfaces.is_empty() {
            return Err(ParametricSolidError::NoSurfaces);
        }
        let rims: Vec<Rim> = (0..4 * surfaces.len()).map(|b| Rim::of(&surfaces, Border::numbered(b))).collect();
        let middles = surfaces.iter().map(|surface| surface.jet(0.5, 0.5).point);
        let places: Vec<DVec3> = rims.iter().flat_map(|rim| rim.points.iter().copied()).chain(middles).collect();
        let extent = Bounds::of(&places).map_or(0.0, |bounds| bounds.extent());
        let near = tolerances::SEAM * extent;
        let corner_places: Vec<DVec3> =
            (0..4 * surfaces.len()).map(|c| surfaces[c / 4].jet((c / 2 % 2) as f64, (c % 2) as f64).point).collect();
        let first_there = |c: usize| (0..c).find(|d| corner_places[*d].distance(corner_places[c]) <= near);
        let corners: Vec<usize> = (0..corner_places.len()).map(|c| first_there(c).unwrap_or(c)).collect();

        let (mut poles, mut joints, mut open_rims) = (Vec::new(), Vec::new(), Vec::<&Rim>::new());
        for rim in &rims {
            if rim.points.iter().all(|p| p.distance(rim.points[0]) <= near) {
                poles.push(rim.border);
                continue;
            }
            let joined = |(k, other): (usize, &&Rim)| Some((k, other.joins(rim, &surfaces, near)?));
            // Both surfaces are on their left.
            let fits = |k: usize, is_reversed: bool| {
                let [a, b] = [open_rims[k].border, rim.border].map(Border::is_counter_clockwise);
                (a == b) == is_reversed
            };
            let candidates: Vec<(usize, bool)> = open_rims.iter().enumerate().filter_map(joined).collect();
            let fitting = candidates.iter().find(|(k, is_reversed)| fits(*k, *is_reversed)).copied();
            let Some((k, is_reversed)) = fitting else {
                if let Some((k, _)) = candidates.first() {
                    let surfaces = [open_rims[*k].border.surface, rim.border.surface];
                    return Err(ParametricSolidError::Winding { surfaces });
                }
                open_rims.push(rim);
                continue;
            };
            let pair = [open_rims.remove(k).border, rim.border];
            joints.push((pair, is_reversed));
        }
        if let (Some(rim), OpenBoundaries::Refuse) = (open_rims.first(), open) {
            let Border { surface, side } = rim.border;
            return Err(ParametricSolidError::Open { surface, border: ["s = 0", "s = 1", "t = 0", "t = 1"][side] });
        }
        let boundaries = boundaries(&open_rims.iter().map(|rim| rim.border).collect::<Vec<_>>(), &corners);
        let deformations = Vec::new();
        let body = Self { surfaces, deformations, poles, joints, corners, boundaries, is_turned: false };
        let volume = body.volume()?.volume;
        if !(volume.abs() > tolerances::NO_VOLUME * extent.powi(3) && tolerances::EXTENTS.contains(&extent)) {
            return Err(ParametricSolidError::NoVolume { volume, extent });
        }
        Ok(Self { is_turned: volume < 0.0, ..body })
    }

    /// The body deformed by a lattice that holds all of it, for the displacement C − C⁰ of its control points (#controls × 3), after what
    /// has deformed it already.
    ///
    /// # Panics
    ///
    /// Panics where `displacement` does not have one entry per control.
    #[must_use]
    pub fn deformed(mut self, lattice: Lattice, displacement: Vec<DVec3>) -> Self {
        assert_eq!(displacement.len(), lattice.control_count(), "one displacement for each control");
        self.deformations.push((lattice, displacement));
        self
    }

    /// Triangles between samples at equidistant parameters, at least so many, and no fewer than [`LEAST_TRIANGLES`]: four times as many have half
    /// the steps. Every cell of parameters is cut from its corner (s, t) to the opposite one; a torus has twice as many cells along s as along t. Boundaries
    /// that are open stay so in the mesh.
    ///
    /// # Errors
    ///
    /// More triangles than can be numbered; samples outside a lattice, or beyond the range of numbers.
    pub fn sampled(&self, triangles: usize) -> Result<Mesh, ParametricSolidError> {
        self.mesh(self.divisions(triangles)?)
    }

    /// The volume by Gauss and Legendre's rules: the triangles' limit. Exact but for rounding where surfaces and lattices are polynomials.
    ///
    /// # Errors
    ///
    /// Points outside a lattice.
    pub fn volume(&self) -> Result<GaussVolume, ParametricSolidError> {
        if let Some(counts) = self.exact_counts() {
            let Integral { volume, points, .. } = self.integral(&counts)?;
            return Ok(GaussVolume { volume, difference: 0.0, points });
        }
        let [mut count, most] = POINTS;
        let mut before = self.integral(&vec![[count; 2]; self.surfaces.len()])?;
        loop {
            count *= 2;
            let last = self.integral(&vec![[count; 2]; self.surfaces.len()])?;
            let difference = (last.volume - before.volume).abs();
            if difference <= AGREE * last.size || count >= most {
                return Ok(GaussVolume { volume: last.volume, difference, points: last.points });
            }
            before = last;
        }
    }

    /// How many cells along t are needed for that many triangles.
    pub(crate) fn divisions(&self, triangles: usize) -> Result<usize, ParametricSolidError> {
        let can_be_numbered = |m: &usize| {
            let [a, b] = self.cells(*m).map(|cells| cells as u64 + 1);
            (a * b).saturating_mul(6 * self.surfaces.len() as u64) <= u64::from(u32::MAX)
        };
        let all = (self.least_divisions()..).take_while(can_be_numbered);
        let wanted = triangles.max(LEAST_TRIANGLES);
        let mut most = 0;
        for m in all {
            most = self.triangle_count(m);
            if most >= wanted {
                return Ok(m);
            }
        }
        Err(ParametricSolidError::TooMany { triangles, most })
    }

    /// The fewest divisions with which closed surfaces enclose something.
    pub(crate) fn least_divisions(&self) -> usize {
        let is_round = |surface: &Surface| {
            let [closes_s, closes_t] = surface.closes();
            closes_t || (closes_s && !self.is_round())
        };
        if self.surfaces.iter().any(is_round) { 3 } else { 2 }
    }

    /// Whether s goes round on all surfaces. Then borders along s are joined with such, so that s may have cells of its own.
    fn is_round(&self) -> bool {
        self.surfaces.iter().all(|surface| surface.closes()[0])
    }

    /// Cells along s and t for so many divisions.
    fn cells(&self, divisions: usize) -> [usize; 2] {
        [if self.is_round() { 2 * divisions } else { divisions }, divisions]
    }

    /// Number of triangles with so many divisions: two in a cell, one at a pole.
    pub(crate) fn triangle_count(&self, divisions: usize) -> usize {
        let cells = self.cells(divisions);
        let at_poles: usize = self.poles.iter().map(|pole| cells[1 - pole.axis()]).sum();
        2 * cells[0] * cells[1] * self.surfaces.len() - at_poles
    }

    /// The triangles of so many divisions, at least [`ParametricSolid::least_divisions`].
    pub(crate) fn mesh(&self, divisions: usize) -> Result<Mesh, ParametricSolidError> {
        let cells = self.cells(divisions);
        let of_surface = (cells[0] + 1) * (cells[1] + 1);
        let node = |surface: usize, [i, j]: [usize; 2]| (surface * of_surface + i * (cells[1] + 1) + j) as u32;
        let mut sets = DisjointSets::new(self.surfaces.len() * of_surface);
        let along = |border: &Border, k: usize| node(border.surface, border.node(k, cells));
        for pole in &self.poles {
            (1..=cells[1 - pole.axis()]).for_each(|k| sets.union(along(pole, 0), along(pole, k)));
        }
        for ([a, b], is_reversed) in &self.joints {
            let count = cells[1 - a.axis()];
            (0..=count).for_each(|k| sets.union(along(a, k), along(b, if *is_reversed { count - k } else { k })));
        }
        let at_corner = |c: usize| node(c / 4, [c / 2 % 2 * cells[0], c % 2 * cells[1]]);
        for (c, first) in self.corners.iter().enumerate() {
            sets.union(at_corner(*first), at_corner(c));
        }

        let mut numbers = vec![u32::MAX; self.surfaces.len() * of_surface];
        let mut points = Vec::new();
        for surface in 0..self.surfaces.len() {
            let mut places = Vec::new();
            for (i, j) in (0..=cells[0]).flat_map(|i| (0..=cells[1]).map(move |j| (i, j))) {
                let node = node(surface, [i, j]);
                if sets.root(node) == node {
                    numbers[node as usize] = (points.len() + places.len()) as u32;
                    places.push([i as f64 / cells[0] as f64, j as f64 / cells[1] as f64]);
                }
            }
            points.extend(self.samples(surface, &places)?.iter().map(|[point, ..]| *point));
        }
        let mut faces = Faces::with_capacity(self.triangle_count(divisions), 3 * self.triangle_count(divisions));
        for surface in 0..self.surfaces.len() {
            for (i, j) in (0..cells[0]).flat_map(|i| (0..cells[1]).map(move |j| (i, j))) {
                let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]
                    .map(|at| numbers[sets.root(node(surface, at)) as usize]);
                for [a, b, c] in [[a, b, c], [a, c, d]] {
                    if a != b && b != c && c != a {
                        faces.push(&if self.is_turned { [a, c, b] } else { [a, b, c] });
                    }
                }
            }
        }
        Ok(Mesh::new(points, faces)?)
    }

    /// x, x_s and x_t at places (s, t) of a surface.
    fn samples(&self, surface: usize, places: &[[f64; 2]]) -> Result<Vec<[DVec3; 3]>, ParametricSolidError> {
        let surface = &self.surfaces[surface];
        let mut samples = parallel::collect(places.len(), |i| {
            let jet = surface.jet(places[i][0], places[i][1]);
            [jet.point, jet.s, jet.t]
        });
        for (lattice, displacement) in &self.deformations {
            let points: Vec<DVec3> = samples.iter().map(|[point, ..]| *point).collect();
            let posed = lattice.bind(&points, Outside::Refuse)?.displaced(&points, displacement);
            let jacobians = lattice.jacobians(&points, displacement, Outside::Extend);
            for ((sample, posed), jacobian) in samples.iter_mut().zip(posed).zip(jacobians) {
                let [_, s, t] = *sample;
                *sample = [posed, jacobian * s, jacobian * t];
            }
        }
        Ok(samples)
    }

    /// Points along s and t of each surface that make the rules exact, where there are such numbers.
    fn exact_counts(&self) -> Option<Vec<[usize; 2]>> {
        let mut totals = Vec::new();
        for (lattice, _) in &self.deformations {
            let bases = lattice.bases();
            if bases.iter().any(|basis| basis.breaks().len() > 2) {
                return None;
            }
            totals.push(bases.iter().map(Basis::degree).sum::<usize>());
        }
        let count = |mut p: usize| {
            let mut degree = 3 * p - 2;
            for n in &totals {
                degree = 3 * n * p - 2 * p - 1;
                p *= n;
            }
            degree / 2 + 1
        };
        self.surfaces.iter().map(|surface| Some(surface.degrees()?.map(count))).collect()
    }

    /// (25), with so many points along s and t in each cell of the surfaces.
    fn integral(&self, counts: &[[usize; 2]]) -> Result<Integral, ParametricSolidError> {
        let [origin, ..] = self.samples(0, &[[0.5; 2]])?[0];
        let of_surface = |k: usize| -> Result<Integral, ParametricSolidError> {
            let breaks = self.surfaces[k].breaks();
            let [over_s, over_t] = [0, 1].map(|axis| rule(&breaks[axis], counts[k][axis]));
            let places: Vec<[f64; 2]> = over_s.iter().flat_map(|[s, _]| over_t.iter().map(|[t, _]| [*s, *t])).collect();
            let weights = over_s.iter().flat_map(|[_, a]| over_t.iter().map(move |[_, b]| a * b));
            let mut sum = Integral { volume: 0.0, size: 0.0, points: places.len() };
            for ([x, s, t], weight) in self.samples(k, &places)?.into_iter().zip(weights) {
                let term = weight * (x - origin).dot(s.cross(t)) / 3.0;
                sum.volume += term;
                sum.size += term.abs();
            }
            Ok(sum)
        };
        let mut all = Integral { volume: 0.0, size: 0.0, points: 0 };
        for part in parallel::map(self.surfaces.len(), of_surface) {
            let part = part?;
            all.volume += part.volume;
            all.size += part.size;
            all.points += part.points;
        }
        for boundary in &self.boundaries {
            let cap = self.cap(boundary, counts, origin)?;
            all.volume += cap;
            all.size += cap.abs();
        }
        let sign = if self.is_turned { -1.0 } else { 1.0 };
        Ok(Integral { volume: sign * all.volume, ..all })
    }

    /// The volume between `origin` and the cap of a boundary.
    fn cap(&self, boundary: &[Border], counts: &[[usize; 2]], origin: DVec3) -> Result<f64, ParametricSolidError> {
        let (mut apex, mut swept) = (DVec3::ZERO, DVec3::ZERO);
        for border in boundary {
            let along = 1 - border.axis();
            let rule = rule(&self.surfaces[border.surface].breaks()[along], counts[border.surface][along]);
            let places: Vec<[f64; 2]> = rule.iter().map(|[u, _]| border.at(*u)).collect();
            let sign = if border.is_counter_clockwise() { 1.0 } else { -1.0 };
            for (sample, [_, weight]) in self.samples(border.surface, &places)?.into_iter().zip(&rule) {
                let x = sample[0] - origin;
                apex += *weight / boundary.len() as f64 * x;
                swept += sign * *weight * x.cross(sample[1 + along]);
            }
        }
        // The cap runs round the boundary the other way.
        Ok(-apex.dot(swept) / 6.0)
    }
}

/// What a rule gives.
struct Integral {
    volume: f64,
    /// The sum of the terms' sizes.
    size: f64,
    points: usize,
}

impl Border {
    fn numbered(b: usize) -> Self {
        Self { surface: b / 4, side: b % 4 }
    }

    /// Which parameter does not change along it: 0 for s, 1 for t.
    fn axis(self) -> usize {
        self.side / 2
    }

    /// (s, t) at u along it.
    fn at(self, u: f64) -> [f64; 2] {
        let end = (self.side % 2) as f64;
        if self.axis() == 0 { [end, u] } else { [u, end] }
    }

    /// The k-th grid point along it.
    fn node(self, k: usize, cells: [usize; 2]) -> [usize; 2] {
        let end = self.side % 2 * cells[self.axis()];
        if self.axis() == 0 { [end, k] } else { [k, end] }
    }

    /// Whether it goes round the surface counter-clockwise, seen from the tips of the normals.
    fn is_counter_clockwise(self) -> bool {
        matches!(self.side, 1 | 2)
    }

    /// The corners at its ends.
    fn corners(self) -> [usize; 2] {
        [0, 1].map(|k| {
            let [s, t] = self.node(k, [1, 1]);
            4 * self.surface + 2 * s + t
        })
    }
}

/// A border at parameters where it is compared with others.
struct Rim {
    border: Border,
    sites: Vec<f64>,
    points: Vec<DVec3>,
}

impl Rim {
    fn of(surfaces: &[Surface], border: Border) -> Self {
        let surface = &surfaces[border.surface];
        let breaks = &surface.breaks()[1 - border.axis()];
        let inside = |ends: &[f64]| {
            let [from, to] = [ends[0], ends[1]];
            (0..SITES).map(move |k| from + (to - from) * (k as f64 / SITES as f64)).collect::<Vec<_>>()
        };
        let sites: Vec<f64> = breaks.windows(2).flat_map(inside).chain([1.0]).collect();
        let points = sites.iter().map(|u| point(surface, border, *u)).collect();
        Self { border, sites, points }
    }

    /// Whether both borders are one curve, and if so, whether one is run in the opposite direction.
    fn joins(&self, other: &Self, surfaces: &[Surface], near: f64) -> Option<bool> {
        let is_on = |a: &Self, b: &Self, is_reversed: bool| {
            a.sites.iter().zip(&a.points).all(|(u, p)| {
                let u = if is_reversed { 1.0 - u } else { *u };
                point(&surfaces[b.border.surface], b.border, u).distance(*p) <= near
            })
        };
        [false, true]
            .into_iter()
            .find(|is_reversed| is_on(self, other, *is_reversed) && is_on(other, self, *is_reversed))
    }
}

fn point(surface: &Surface, border: Border, u: f64) -> DVec3 {
    let [s, t] = border.at(u);
    surface.jet(s, t).point
}

/// Borders by the boundaries that they hang together in, at corners.
fn boundaries(open: &[Border], corners: &[usize]) -> Vec<Vec<Border>> {
    let mut sets = DisjointSets::new(corners.len());
    let ends = |border: &Border| border.corners().map(|c| corners[c] as u32);
    for [a, b] in open.iter().map(ends) {
        sets.union(a, b);
    }
    let mut by_root: Vec<(u32, Vec<Border>)> = Vec::new();
    for border in open {
        let root = sets.root(ends(border)[0]);
        match by_root.iter_mut().find(|(of, _)| *of == root) {
            Some((_, boundary)) => boundary.push(*border),
            None => by_root.push((root, vec![*border])),
        }
    }
    by_root.into_iter().map(|(_, boundary)| boundary).collect()
}

/// The rule of `count` points in each part between `breaks`.
fn rule(breaks: &[f64], count: usize) -> Vec<[f64; 2]> {
    let of_unit = gauss_legendre(count);
    let part = |ends: &[f64]| {
        let [from, length] = [ends[0], ends[1] - ends[0]];
        of_unit.iter().map(|[x, weight]| [from + length * x, length * weight]).collect::<Vec<_>>()
    };
    breaks.windows(2).flat_map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patch::Patch;

    /// A hexahedron with bilinear sides in a lattice of `size` control points, all of them anywhere. Its volume is ∫∫∫ det (φ ∘ H)′, a polynomial of degree
    /// 3n − 1 in each parameter, H the trilinear map of the unit cube to it.
    #[test]
    fn the_rule_is_exact_and_one_with_a_point_less_is_not() {
        let anywhere = |k: usize| {
            let k = k as f64;
            DVec3::new((7.0 * k + 1.0).sin(), (5.0 * k).cos(), (3.0 * k).sin())
        };
        let corner =
            |[i, j, k]: [usize; 3]| DVec3::new(i as f64, j as f64, k as f64) - 0.5 + 0.4 * anywhere(4 * i + 2 * j + k);
        let side = |axis: usize, end: usize| {
            let at = |s: usize, t: usize| {
                let mut node = [end; 3];
                (node[(axis + 1) % 3], node[(axis + 2) % 3]) = if end == 1 { (s, t) } else { (t, s) };
                corner(node)
            };
            let bases = [0; 2].map(|_| Basis::bernstein(2).unwrap());
            Patch::new(bases, vec![at(0, 0), at(0, 1), at(1, 0), at(1, 1)], None).unwrap().into()
        };
        let surfaces: Vec<Surface> = (0..6).map(|k| side(k / 2, k % 2)).collect();
        let body = ParametricSolid::patches(surfaces, OpenBoundaries::Refuse).unwrap();
        let line = gauss_legendre(10);
        for (size, count) in [([2, 2, 2], 4), ([3, 2, 2], 5)] {
            let frame = Frame { origin: DVec3::splat(-0.9), axes: DVec3::AXES.map(|axis| 1.8 * axis) };
            let lattice = Lattice::new(size.map(|n| Basis::bernstein(n).unwrap()), frame).unwrap();
            let displacement: Vec<DVec3> = (0..lattice.control_count()).map(anywhere).collect();
            let mut exact = 0.0;
            for (a, b, c) in (0..1000).map(|k| (line[k / 100], line[k / 10 % 10], line[k % 10])) {
                let mut place = DVec3::ZERO;
                let mut columns = [DVec3::ZERO; 3];
                for node in (0..8).map(|k| [k / 4, k / 2 % 2, k % 2]) {
                    let weights = [0, 1, 2].map(|d| [1.0 - [a, b, c][d][0], [a, b, c][d][0]][node[d]]);
                    let signs = node.map(|end| [-1.0, 1.0][end]);
                    place += weights[0] * weights[1] * weights[2] * corner(node);
                    columns[0] += signs[0] * weights[1] * weights[2] * corner(node);
                    columns[1] += weights[0] * signs[1] * weights[2] * corner(node);
                    columns[2] += weights[0] * weights[1] * signs[2] * corner(node);
                }
                let jacobian = lattice.jacobians(&[place], &displacement, Outside::Extend)[0];
                let [x, y, z] = columns.map(|column| jacobian * column);
                exact += a[1] * b[1] * c[1] * x.dot(y.cross(z));
            }
            let body = body.clone().deformed(lattice, displacement);
            assert_eq!(body.exact_counts().unwrap(), [[count; 2]; 6]);
            let error = |count: usize| (body.integral(&[[count; 2]; 6]).unwrap().volume / exact - 1.0).abs();
            assert!(error(count) < 1e-14, "{count}: {}", error(count));
            assert!(error(count - 1) > 1e-10, "{count}: {}", error(count - 1));
            assert_eq!(body.volume().unwrap().difference, 0.0);
        }
    }

    /// Without a lattice the degree is 3p − 2: 3 points for biquadratic patches, 4 for bicubic ones.
    #[test]
    fn the_rule_for_patches_alone() {
        for (degree, count) in [(2, 3), (3, 4)] {
            let bases = [0; 2].map(|_| Basis::bernstein(degree + 1).unwrap());
            let across = (degree + 1) as f64;
            let height = |k: usize| 0.4 * DVec3::new((7.0 * k as f64).sin(), (5.0 * k as f64).cos(), (k as f64).sin());
            let place = |k: usize| DVec3::new((k / (degree + 1)) as f64, (k % (degree + 1)) as f64, across) + height(k);
            let patch = Patch::new(bases, (0..(degree + 1).pow(2)).map(place).collect(), None).unwrap();
            let body = ParametricSolid::patches(vec![patch.into()], OpenBoundaries::Cap).unwrap();
            assert_eq!(body.exact_counts().unwrap(), [[count; 2]]);
            let volume = |count: usize| body.integral(&[[count; 2]]).unwrap().volume;
            let exact = volume(20);
            assert!((volume(count) / exact - 1.0).abs() < 1e-13, "{degree}: {}", volume(count) / exact - 1.0);
            assert!((volume(count - 1) / exact - 1.0).abs() > 1e-6, "{degree}: {}", volume(count - 1) / exact - 1.0);
        }
    }
}
