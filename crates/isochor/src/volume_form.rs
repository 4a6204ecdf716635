//! The volume as a form of the nodes alone, for small lattices.
//!
//! With vertices `p_v = Σ_a φ_a(v) c_a` the volume is
//!
//! ```text
//! V = Σ_{a<b<c} T_abc det(c_a, c_b, c_c),   T_abc = 1/6 Σ_f det[φ_a φ_b φ_c](corners of f)             (1)
//! ```
//!
//! Once T is known, an evaluation takes about n³/2 products for n nodes, *whatever the mesh is*. T is made as a matrix product: each face gives
//! one of its corners, v, the two-form `φ(m) ∧ φ(n)` of the other two, and T is `Σ_v φ(v) ⊗ (its two-forms)`, made alternating.
//!
//! Vertices that are not combinations of nodes alone have an *offset* h(v) ∈ ℝ³: `p_v = h(v) + Σ φ_a(v) c_a`. Its coordinates are three more
//! functions, whose nodes stand at (1, 0, 0), (0, 1, 0) and (0, 0, 1). So nodes that do not move can be taken out of a form.
//!
//! # Changes versus the paper
//!
//! HML, section 4.1, gives this up: coefficients integrated over parametric patches one by one. On a mesh they are sums over triangles.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use glam::DVec3;

use crate::binding::Binding;
use crate::order;
use crate::parallel;
use crate::volume::Solid;

/// (1).
#[derive(Clone, Debug)]
pub struct VolumeForm {
    /// Functions φ_a: nodes, then those of the offset.
    functions: usize,
    has_offset: bool,
    /// T_abc for each c, and for each pair a < b in lexicographic order.
    coefficients: Vec<f64>,
}

/// A form at some places.
#[derive(Clone, Debug)]
pub(crate) struct FormState {
    /// ∂V/∂c_a (#nodes × 3).
    pub(crate) gradient: Vec<DVec3>,
    pub(crate) volume: f64,
    /// Σ_c T_abc c_c for each pair a < b.
    pairs: Vec<DVec3>,
    functions: usize,
}

/// Values of the functions at the vertices and apexes of a body, one row each.
struct Functions {
    count: usize,
    values: Vec<f64>,
}

impl Functions {
    /// Of the nodes `nodes`, and of an offset (#vertices × 3).
    fn of(solid: &Solid, binding: &Binding, nodes: &[usize], offset: Option<&[DVec3]>) -> Self {
        let count = nodes.len() + if offset.is_some() { 3 } else { 0 };
        let mut column = vec![usize::MAX; binding.control_count()];
        nodes.iter().enumerate().for_each(|(k, node)| column[*node] = k);
        let [_, size_v, size_w] = binding.size();
        let vertices = solid.vertex_count();
        let mut values = Vec::new();
        parallel::resize(&mut values, count * (vertices + solid.cap_count()));
        let (of_vertices, of_apexes) = values.split_at_mut(count * vertices);
        parallel::for_each_chunk(of_vertices, count * parallel::CHUNK, |first, rows| {
            let (mut scratch, mut weights) = (Vec::new(), Vec::new());
            for (v, row) in (first / count..).zip(rows.chunks_mut(count)) {
                let (start, size) = binding.reach_of(v);
                weights.resize(size.iter().product(), 0.0);
                binding.fill_row(v, &mut weights, &mut scratch);
                row.fill(0.0);
                for (line, weights) in weights.chunks(size[2].max(1)).enumerate() {
                    let [i, j] = [line / size[1], line % size[1]];
                    let first = ((start[0] + i) * size_v + start[1] + j) * size_w + start[2];
                    for (column, weight) in column[first..].iter().zip(weights) {
                        if let Some(to) = row.get_mut(*column) {
                            *to = *weight;
                        }
                    }
                }
                if let Some(offset) = offset {
                    row[nodes.len()..].copy_from_slice(&offset[v].to_array());
                }
            }
        });
        for (members, row) in solid.cap_members().zip(of_apexes.chunks_mut(count.max(1))) {
            row.fill(0.0);
            for v in members {
                let of_vertex = &of_vertices[*v as usize * count..][..count];
                row.iter_mut().zip(of_vertex).for_each(|(sum, x)| *sum += x / members.len() as f64);
            }
        }
        Self { count, values }
    }

    fn row(&self, v: u32) -> &[f64] {
        &self.values[v as usize * self.count..][..self.count]
    }
}

impl VolumeForm {
    /// The volume of `solid`, whose vertices stand at `points` (#vertices × 3) when the nodes of `binding` stand at `rest` (#controls × 3), as a
    /// form of all nodes. Coordinates should be near the origin: terms of (1) grow with the cube of the distance.
    ///
    /// # Panics
    ///
    /// Panics where numbers of vertices or controls do not agree.
    #[must_use]
    pub fn new(solid: &Solid, points: &[DVec3], binding: &Binding, rest: &[DVec3]) -> Self {
        /// What W C⁰ may be off by rounding, relative to the places that it comes of.
        const ROUNDING: f64 = 16.0 * f64::EPSILON;
        let nodes: Vec<usize> = (0..rest.len()).collect();
        let offset = offset(points, binding, rest, rest, &nodes);
        let largest = |vectors: &[DVec3]| vectors.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let is_rounding = largest(&offset) <= ROUNDING * largest(rest);
        Self::of(solid, binding, &nodes, (!is_rounding).then_some(&offset), |_| true)
    }

    /// The volume of the components that are `counted`, as a form of the nodes `nodes` and an offset (#vertices × 3).
    pub(crate) fn of(
        solid: &Solid,
        binding: &Binding,
        nodes: &[usize],
        offset: Option<&[DVec3]>,
        is_counted: impl Fn(usize) -> bool,
    ) -> Self {
        /// Vertices that are multiplied at once. More: their two-forms leave the processor's cache; fewer: the product is slower.
        const BATCH: usize = 128;
        /// Sums that are made at the same time. More: more memory.
        const PARTS: usize = 16;
        let functions = Functions::of(solid, binding, nodes, offset);
        let count = functions.count;
        let pairs = count * count.saturating_sub(1) / 2;
        let stars = Stars::of(solid, is_counted);
        let mut parts = parallel::map_chunks(stars.len(), stars.len().div_ceil(PARTS).max(1), |range| {
            let mut sum: Mat<f64> = Mat::zeros(pairs, count);
            let mut forms = vec![0.0; pairs * BATCH];
            let mut values = vec![0.0; count * BATCH];
            let mut first = range.start;
            while first < range.end {
                let batch = BATCH.min(range.end - first);
                forms[..pairs * batch].fill(0.0);
                for i in 0..batch {
                    let (center, others) = stars.star(first + i);
                    values[i * count..][..count].copy_from_slice(functions.row(center));
                    let form = &mut forms[i * pairs..][..pairs];
                    for [m, n] in others {
                        add_wedge(functions.row(*m), functions.row(*n), form);
                    }
                }
                let forms = MatRef::from_column_major_slice(&forms[..pairs * batch], pairs, batch);
                let values = MatRef::from_row_major_slice(&values[..count * batch], batch, count);
                matmul(sum.as_mut(), Accum::Add, forms, values, 1.0, Par::Seq);
                first += batch;
            }
            sum
        })
        .into_iter();
        let mut sum = parts.next().unwrap_or_else(|| Mat::zeros(pairs, count));
        parts.for_each(|part| sum += part);
        Self { functions: count, has_offset: offset.is_some(), coefficients: alternating(&sum) }
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.functions - if self.has_offset { 3 } else { 0 }
    }

    /// V with the nodes at `places` (#nodes × 3).
    ///
    /// # Panics
    ///
    /// Panics where the number of places is not that of the nodes.
    #[must_use]
    pub fn volume(&self, places: &[DVec3]) -> f64 {
        self.at(places).volume
    }

    /// ∂V/∂C (#nodes × 3) with the nodes at `places` (#nodes × 3).
    ///
    /// # Panics
    ///
    /// As [`VolumeForm::volume`].
    #[must_use]
    pub fn gradient(&self, places: &[DVec3]) -> Vec<DVec3> {
        self.at(places).gradient
    }

    /// All at once.
    pub(crate) fn at(&self, places: &[DVec3]) -> FormState {
        assert_eq!(places.len(), self.node_count(), "a place for each node");
        let functions = self.functions;
        let mut all = places.to_vec();
        if self.has_offset {
            all.extend(DVec3::AXES);
        }
        let count = functions * functions.saturating_sub(1) / 2;
        let mut sums = [0, 1, 2].map(|_| vec![0.0; count]);
        for (c, place) in all.iter().enumerate() {
            let coefficients = &self.coefficients[c * count..][..count];
            for (sum, x) in sums.iter_mut().zip(place.to_array()) {
                sum.iter_mut().zip(coefficients).for_each(|(sum, t)| *sum += t * x);
            }
        }
        let [xs, ys, zs] = sums;
        let pairs: Vec<DVec3> = (0..count).map(|k| DVec3::new(xs[k], ys[k], zs[k])).collect();
        let mut gradient = vec![DVec3::ZERO; functions];
        let mut pair = pairs.iter();
        for a in 0..functions {
            for b in a + 1..functions {
                let s = pair.next().expect("a sum for each pair");
                gradient[a] += 0.5 * all[b].cross(*s);
                gradient[b] -= 0.5 * all[a].cross(*s);
            }
        }
        let volume = all.iter().zip(&gradient).map(|(c, g)| c.dot(*g)).sum::<f64>() / 3.0;
        gradient.truncate(places.len());
        FormState { gradient, volume, pairs, functions }
    }
}

impl FormState {
    /// `s` for each pair of nodes a < b: the second derivative of V by c_a and c_b is `v ↦ v × s`.
    pub(crate) fn for_each_pair(&self, mut f: impl FnMut(usize, usize, DVec3)) {
        let nodes = self.gradient.len();
        let mut pair = 0;
        for a in 0..nodes {
            (a + 1..nodes).for_each(|b| f(a, b, self.pairs[pair + b - a - 1]));
            pair += self.functions - a - 1;
        }
    }
}

/// What of the vertices (#vertices × 3) is not a combination of the nodes `own`, with the other nodes at `places`, when vertices are at `points`
/// with the nodes at `rest` (both #controls × 3).
pub(crate) fn offset(
    points: &[DVec3],
    binding: &Binding,
    rest: &[DVec3],
    places: &[DVec3],
    own: &[usize],
) -> Vec<DVec3> {
    let mut by: Vec<DVec3> = places.iter().zip(rest).map(|(c, at)| *c - *at).collect();
    own.iter().for_each(|node| by[*node] = -rest[*node]);
    binding.displaced(points, &by)
}

/// Faces by one of their corners, such that few vertices are such a corner.
struct Stars {
    centers: Vec<u32>,
    starts: Vec<usize>,
    /// The other two corners of each face, in its sense of rotation.
    others: Vec<[u32; 2]>,
}

impl Stars {
    fn of(solid: &Solid, is_counted: impl Fn(usize) -> bool) -> Self {
        let vertices = solid.vertex_count() + solid.cap_count();
        let mut is_center = vec![false; vertices];
        let mut faces: Vec<[u32; 3]> = Vec::with_capacity(solid.all_triangles().len());
        for (component, range) in solid.component_ranges().iter().enumerate() {
            if !is_counted(component) {
                continue;
            }
            for &[a, b, c] in &solid.all_triangles()[range.clone()] {
                let turned = [[a, b, c], [b, c, a], [c, a, b]];
                let chosen = turned.into_iter().find(|t| is_center[t[0] as usize]).unwrap_or([a, b, c]);
                is_center[chosen[0] as usize] = true;
                faces.push(chosen);
            }
        }
        let keys: Vec<u32> = faces.iter().map(|face| face[0]).collect();
        let sorted = order::ascending(&keys, vertices);
        let mut stars = Self { centers: Vec::new(), starts: Vec::new(), others: Vec::with_capacity(faces.len()) };
        for [center, m, n] in sorted.into_iter().map(|f| faces[f as usize]) {
            if stars.centers.last() != Some(&center) {
                stars.centers.push(center);
                stars.starts.push(stars.others.len());
            }
            stars.others.push([m, n]);
        }
        stars.starts.push(stars.others.len());
        stars
    }

    fn len(&self) -> usize {
        self.centers.len()
    }

    fn star(&self, i: usize) -> (u32, &[[u32; 2]]) {
        (self.centers[i], &self.others[self.starts[i]..self.starts[i + 1]])
    }
}

/// Adds `f_a g_b − g_a f_b` for each pair a < b.
fn add_wedge(f: &[f64], g: &[f64], mut form: &mut [f64]) {
    for a in 0..f.len() {
        let (of_a, rest) = form.split_at_mut(f.len() - a - 1);
        for ((form, f_b), g_b) in of_a.iter_mut().zip(&f[a + 1..]).zip(&g[a + 1..]) {
            *form += f[a] * g_b - g[a] * f_b;
        }
        form = rest;
    }
}

/// T_abc for each c and each pair a < b, of sums (pairs × functions) over some corners of the faces.
fn alternating(sum: &Mat<f64>) -> Vec<f64> {
    let functions = sum.ncols();
    let pair = |a: usize, b: usize| a * functions - a * (a + 1) / 2 + b - a - 1;
    let of = |a: usize, b: usize, c: usize| if a < b { sum[(pair(a, b), c)] } else { -sum[(pair(b, a), c)] };
    let mut coefficients = Vec::with_capacity(functions * sum.nrows());
    for c in 0..functions {
        for a in 0..functions {
            for b in a + 1..functions {
                let is_distinct = a != c && b != c;
                coefficients.push(if is_distinct { (of(a, b, c) + of(b, c, a) + of(c, a, b)) / 6.0 } else { 0.0 });
            }
        }
    }
    coefficients
}
