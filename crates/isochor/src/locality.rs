//! Automatic locality: mobilities that put the correction where the volume was lost.
//!
//! Every part of the body should have r times its rest volume, r = V_ref/V⁰. With J the Jacobian of the posed map `P = P⁰ + W (C −
//! C⁰)` relative to rest, a part that the pose left too small lacks `r − det J` of its rest volume. The loss round control point i
//! is the mean of that over its basis function B_i,
//!
//! ```text
//! ℓ_i = ∫ B_i max(0, r − det J) du / ∫ B_i du
//! ```
//!
//! and its mobility `m_i = ℓ_i / max ℓ`. Where the body is too large as a whole, gains count instead: max(0, det J − r). So places
//! that are too large are not made larger yet to make up for others.
//!
//! The integrals are over the knot cells that hold vertices, in parameters of the lattice. By Gauss and Legendre with 2p points
//! along a direction of degree p they are exact wherever r − det J has one sign in the cell: B_i det J has degree 4p − 1.
//!
//! HB, section 8, names the aim: to correct "only in regions where the loss of volume is the most important".
//!
//! # Changes versus the paper
//!
//! - It has no formula; this is ours. Mobilities are smooth, as basis functions are, where a choice of regions would have borders.
//! - Cells without vertices do not count: what happens there is not felt by the model. They would make controls at the border
//!   of the model too mobile.

use glam::DVec3;

use crate::bspline::Basis;
use crate::gauss::gauss_legendre;
use crate::lattice::{Lattice, Outside};
use crate::parallel;
use crate::tolerances;

/// What the volume is to be, and of what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalityOptions<'a> {
    /// Rest positions of the model's vertices (#vertices × 3): cells without any do not count. Empty: all cells count.
    pub vertices: &'a [DVec3],
    /// What happens to vertices outside the lattice: kept ones do not count.
    pub outside: Outside,
    /// Volume of the pose, relative to that at rest.
    pub posed: f64,
    /// The wanted volume, relative to that at rest.
    pub wanted: f64,
}

/// All cells; the wanted volume is that at rest, and losses count.
impl Default for LocalityOptions<'_> {
    fn default() -> Self {
        Self { vertices: &[], outside: Outside::Keep, posed: 1.0, wanted: 1.0 }
    }
}

/// Mobility of each control point (#controls), 0 to 1, for the pose with the control displacement C − C⁰ (#controls × 3): in
/// proportion to [`volume_loss`], 1 where it is largest. Exactly 0 where nothing is lost; 1 everywhere if nothing is lost anywhere.
///
/// # Panics
///
/// Panics where `displacement` does not have one entry per control.
#[must_use]
pub fn local_mobility(lattice: &Lattice, displacement: &[DVec3], options: &LocalityOptions) -> Vec<f64> {
    let losses = volume_loss(lattice, displacement, options);
    let largest = losses.iter().copied().fold(0.0, f64::max);
    let is_finite = losses.iter().all(|loss| loss.is_finite());
    if largest == 0.0 || !is_finite {
        return vec![1.0; losses.len()];
    }
    losses.into_iter().map(|loss| loss / largest).collect()
}

/// ℓ: the part of the rest volume that is missing round each control point (#controls), ≥ 0; or that is too much, where the whole
/// body is too large. Below [`tolerances::NO_LOSS`] it is 0, and so it is for controls that no vertex follows.
///
/// # Panics
///
/// Panics where `displacement` does not have one entry per control.
#[must_use]
pub fn volume_loss(lattice: &Lattice, displacement: &[DVec3], options: &LocalityOptions) -> Vec<f64> {
    /// Cells per chunk. More: less balance between threads; fewer: more overhead.
    const CHUNK: usize = 4;
    assert_eq!(displacement.len(), lattice.control_count(), "one displacement for each control");
    let axes = lattice.bases().each_ref().map(Axis::new);
    let cells = cells(lattice, &axes, options);
    let sign = if options.posed > options.wanted { -1.0 } else { 1.0 };
    let loss = |det: f64| (sign * (options.wanted - det)).max(0.0);
    let sums = parallel::map_chunks(cells.len(), CHUNK, |range| {
        let cell_losses = |cell: &[usize; 3]| Cell::new(*cell, &axes).integrals(lattice, displacement, loss);
        cells[range].iter().map(cell_losses).collect::<Vec<_>>()
    });
    let (mut losses, mut volumes) = (vec![0.0; displacement.len()], vec![0.0; displacement.len()]);
    for (cell, sums) in cells.iter().zip(sums.iter().flatten()) {
        Cell::new(*cell, &axes).for_each_control(lattice, |local, control, volume| {
            losses[control] += sums[local];
            volumes[control] += volume;
        });
    }
    let mean = |(loss, volume): (f64, f64)| if volume > 0.0 { loss / volume } else { 0.0 };
    let is_lost = |loss: f64| if loss <= tolerances::NO_LOSS { 0.0 } else { loss };
    losses.into_iter().zip(volumes).map(mean).map(is_lost).collect()
}

/// The cells that count, by their indices along u, v, w, in order.
fn cells(lattice: &Lattice, axes: &[Axis; 3], options: &LocalityOptions) -> Vec<[usize; 3]> {
    let [nu, nv, nw] = axes.each_ref().map(|axis| axis.spans.len());
    let mut counts = vec![options.vertices.is_empty(); nu * nv * nw];
    for vertex in options.vertices {
        let parameters = lattice.parameters(*vertex);
        if options.outside == Outside::Keep && !lattice.is_inside(parameters) {
            continue;
        }
        // A vertex on the border of cells belongs to all of them.
        let [us, vs, ws] = [0, 1, 2].map(|a| axes[a].spans_at(parameters[a]));
        for u in us {
            for v in vs.clone() {
                ws.clone().for_each(|w| counts[(u * nv + v) * nw + w] = true);
            }
        }
    }
    let counted = (0..counts.len()).filter(|cell| counts[*cell]);
    counted.map(|cell| [cell / (nv * nw), cell / nw % nv, cell % nw]).collect()
}

/// Quadrature along one direction.
struct Axis {
    /// Ends of the non-empty knot spans of [0, 1].
    breaks: Vec<f64>,
    spans: Vec<Span>,
}

/// One knot span.
struct Span {
    /// Index of the first function that does not vanish.
    start: usize,
    /// Weights of the quadrature points.
    weights: Vec<f64>,
    /// For each quadrature point the functions that do not vanish, and their derivatives.
    rows: Vec<Vec<f64>>,
    slopes: Vec<Vec<f64>>,
    /// Integrals of these functions over the span.
    integrals: Vec<f64>,
}

impl Axis {
    fn new(basis: &Basis) -> Self {
        let degree = basis.degree();
        let breaks = basis.breaks();
        let points = gauss_legendre(2 * degree);
        let span = |ends: &[f64]| {
            let length = ends[1] - ends[0];
            let mut span = Span {
                start: 0,
                weights: points.iter().map(|[_, weight]| weight * length).collect(),
                rows: Vec::new(),
                slopes: Vec::new(),
                integrals: vec![0.0; degree + 1],
            };
            for ([x, _], weight) in points.iter().zip(&span.weights) {
                let (mut row, mut slope) = (vec![0.0; degree + 1], vec![0.0; degree + 1]);
                span.start = basis.row(ends[0] + x * length, &mut row);
                basis.row_derivative(ends[0] + x * length, &mut slope);
                span.integrals.iter_mut().zip(&row).for_each(|(sum, b)| *sum += weight * b);
                span.rows.push(row);
                span.slopes.push(slope);
            }
            span
        };
        let spans = breaks.windows(2).map(span).collect();
        Self { breaks, spans }
    }

    /// The spans that hold `u`, which may lie on a border; the nearest one for u outside.
    fn spans_at(&self, u: f64) -> std::ops::RangeInclusive<usize> {
        let interior = &self.breaks[1..self.breaks.len() - 1];
        let before = interior.partition_point(|t| *t < u - tolerances::INSIDE);
        before..=interior.partition_point(|t| *t <= u + tolerances::INSIDE)
    }
}

/// A knot cell: one span along each of u, v, w.
struct Cell<'a>([&'a Span; 3]);

impl<'a> Cell<'a> {
    fn new(cell: [usize; 3], axes: &'a [Axis; 3]) -> Self {
        Self([0, 1, 2].map(|a| &axes[a].spans[cell[a]]))
    }

    /// Functions per direction that do not vanish here.
    fn lengths(&self) -> [usize; 3] {
        self.0.map(|span| span.integrals.len())
    }

    /// Calls `f(local index, control, ∫ B)` for each control whose function does not vanish here.
    fn for_each_control(&self, lattice: &Lattice, mut f: impl FnMut(usize, usize, f64)) {
        let [u, v, w] = self.0;
        let mut local = 0;
        for (a, x) in u.integrals.iter().enumerate() {
            for (b, y) in v.integrals.iter().enumerate() {
                for (c, z) in w.integrals.iter().enumerate() {
                    f(local, lattice.index([u.start + a, v.start + b, w.start + c]), x * y * z);
                    local += 1;
                }
            }
        }
    }

    /// `∫ B f(det J) du` over the cell for each function B that does not vanish here, direction by direction.
    fn integrals(&self, lattice: &Lattice, displacement: &[DVec3], f: impl Fn(f64) -> f64) -> Vec<f64> {
        let [u, v, w] = self.0;
        let [lu, lv, lw] = self.lengths();
        let [edge_u, edge_v, edge_w] = lattice.frame().axes;
        let frame = edge_u.dot(edge_v.cross(edge_w));
        let mut controls = Vec::with_capacity(lu * lv * lw);
        self.for_each_control(lattice, |_, control, _| controls.push(displacement[control]));
        let mut integrals = vec![0.0; lu * lv * lw];
        for (q, weight_u) in u.weights.iter().enumerate() {
            // The displacement and its derivative by u, as functions of v and w.
            let along_u = contracted(&controls, &u.rows[q]);
            let by_u = contracted(&controls, &u.slopes[q]);
            let mut slab = vec![0.0; lv * lw];
            for (r, weight_v) in v.weights.iter().enumerate() {
                let along_uv = contracted(&along_u, &v.rows[r]);
                let by_v = contracted(&along_u, &v.slopes[r]);
                let by_uv = contracted(&by_u, &v.rows[r]);
                let mut line = vec![0.0; lw];
                for (s, weight_w) in w.weights.iter().enumerate() {
                    let (row, slope) = (&w.rows[s], &w.slopes[s]);
                    // ∂P/∂u, ∂P/∂v, ∂P/∂w; at rest they are the edges of the frame.
                    let [du, dv, dw] = [(&by_uv, row), (&by_v, row), (&along_uv, slope)].map(|(d, b)| sum(d, b));
                    let det = (edge_u + du).dot((edge_v + dv).cross(edge_w + dw)) / frame;
                    let value = weight_u * weight_v * weight_w * f(det);
                    line.iter_mut().zip(row).for_each(|(sum, b)| *sum += value * b);
                }
                for (part, b) in slab.chunks_mut(lw).zip(&v.rows[r]) {
                    part.iter_mut().zip(&line).for_each(|(sum, x)| *sum += b * x);
                }
            }
            for (part, b) in integrals.chunks_mut(lv * lw).zip(&u.rows[q]) {
                part.iter_mut().zip(&slab).for_each(|(sum, x)| *sum += b * x);
            }
        }
        integrals
    }
}

/// `Σ_a b_a d[a][·]`: the first index summed away.
fn contracted(d: &[DVec3], b: &[f64]) -> Vec<DVec3> {
    let rest = d.len() / b.len();
    let mut sum = vec![DVec3::ZERO; rest];
    for (part, b) in d.chunks(rest).zip(b) {
        sum.iter_mut().zip(part).for_each(|(sum, d)| *sum += *b * *d);
    }
    sum
}

fn sum(d: &[DVec3], b: &[f64]) -> DVec3 {
    d.iter().zip(b).map(|(d, b)| *b * *d).sum()
}
