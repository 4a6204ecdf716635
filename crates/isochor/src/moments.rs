//! First and second moments of the body that a mesh bounds, and their derivatives.
//!
//! A triangle (p₁, p₂, p₃) and the origin span a tetrahedron of the signed volume d/6, `d = det(p₁, p₂, p₃)`. With `s = p₁ + p₂ + p₃`,
//!
//! ```text
//! ∫ x dV = d/6 · s/4,    ∫ x xᵀ dV = d/6 · (Σ p_i p_iᵀ + s sᵀ)/20
//! ```
//!
//! and the moments of the body are the sums over its triangles: polynomials of degree 4 and 5 in its vertices. A combination `λ V + μ · ∫ x +
//! N : ∫ x xᵀ` (N symmetric) is `d/6 · q` for each triangle, `q = λ + μ·s/4 + (Σ p_iᵀ N p_i + sᵀ N s)/20`, and its derivatives follow by the
//! product rule.
//!
//! HML, section 6, plans "the preservation of inertia tensor and center of mass".

use glam::{DMat3, DVec3};

use crate::binding::Binding;
use crate::volume::Solid;

/// A linear function of volume and moments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Combination {
    /// λ.
    pub(crate) volume: f64,
    /// μ.
    pub(crate) first: DVec3,
    /// N.
    pub(crate) second: DMat3,
}

/// Moments about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// V.
    pub volume: f64,
    /// ∫ x dV.
    pub first: DVec3,
    /// ∫ x xᵀ dV.
    pub second: DMat3,
}

impl Moments {
    /// Of the body `solid` in the pose `points` (#vertices × 3), virtual caps included, about the point `about`: x is the distance from it.
    ///
    /// # Panics
    ///
    /// Panics where the number of points is not the number of vertices.
    #[must_use]
    pub fn of(solid: &Solid, points: &[DVec3], about: DVec3) -> Self {
        let points = relative(solid, points, about);
        let mut sum = Self { volume: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };
        for t in solid.all_triangles() {
            let p = t.map(|v| points[v as usize]);
            let sixth = p[0].dot(p[1].cross(p[2])) / 6.0;
            let s: DVec3 = p.iter().sum();
            sum.volume += sixth;
            sum.first += sixth / 4.0 * s;
            let squares = p.iter().fold(outer(s, s), |squares, p| squares + outer(*p, *p));
            sum.second += sixth / 20.0 * squares;
        }
        sum
    }

    /// The centre of mass, relative to the point about which these are. Without volume there is none.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        self.first / self.volume
    }

    /// The inertia tensor of density 1 about the point about which these are: `∫ (|x|² 1 − x xᵀ) dV`.
    #[must_use]
    pub fn inertia(&self) -> DMat3 {
        let trace = (0..3).map(|a| self.second.col(a)[a]).sum::<f64>();
        DMat3::from_diagonal(DVec3::splat(trace)) - self.second
    }
}

impl Combination {
    /// 0.
    pub(crate) const ZERO: Self = Self { volume: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };

    /// `q`, `∂q/∂p_i`.
    fn factor(&self, p: &[DVec3; 3]) -> (f64, [DVec3; 3]) {
        let s: DVec3 = p.iter().sum();
        let squares: f64 = p.iter().map(|p| p.dot(self.second * *p)).sum();
        let q = self.volume + self.first.dot(s) / 4.0 + (squares + s.dot(self.second * s)) / 20.0;
        (q, p.map(|p| self.first / 4.0 + self.second * (p + s) / 10.0))
    }

    /// Its gradient by the vertices (#vertices × 3) in the pose whose points, with those of apexes, are `points`; the share of an apex goes to the
    /// vertices of its boundary.
    fn gradient(&self, solid: &Solid, points: &[DVec3]) -> Vec<DVec3> {
        let mut gradient = vec![DVec3::ZERO; points.len()];
        for t in solid.all_triangles() {
            let p = t.map(|v| points[v as usize]);
            let (q, slopes) = self.factor(&p);
            let areas = [p[1].cross(p[2]), p[2].cross(p[0]), p[0].cross(p[1])];
            let d = p[0].dot(areas[0]);
            for (i, v) in t.iter().enumerate() {
                gradient[*v as usize] += (q * areas[i] + d * slopes[i]) / 6.0;
            }
        }
        for (cap, members) in solid.cap_members().enumerate() {
            let share = gradient[solid.vertex_count() + cap] / members.len() as f64;
            members.iter().for_each(|v| gradient[*v as usize] += share);
        }
        gradient.truncate(solid.vertex_count());
        gradient
    }

    /// Of the triangle with the corners p (p₁ first): the second derivatives by p₁ and by each corner, row by row.
    pub(crate) fn second_derivatives(&self, p: [DVec3; 3]) -> [[f64; 9]; 3] {
        let (q, slopes) = self.factor(&p);
        let areas = [p[1].cross(p[2]), p[2].cross(p[0]), p[0].cross(p[1])];
        let d = p[0].dot(areas[0]);
        // Of d by p₁ and p₂, p₃: v ↦ v × p₃ and v ↦ p₂ × v.
        let turns = [DMat3::ZERO, -cross_matrix(p[2]), cross_matrix(p[1])];
        [0, 1, 2].map(|j| {
            let curve = self.second * if j == 0 { 0.2 } else { 0.1 };
            let block = outer(areas[0], slopes[j]) + outer(slopes[0], areas[j]) + d * curve + q * turns[j];
            let rows = (block * (1.0 / 6.0)).transpose();
            rows.to_cols_array()
        })
    }
}

/// What is measured, in the order of its numbers: ∫ x, then the six entries of ∫ x xᵀ on and above the diagonal, row by row.
pub(crate) fn combinations(with_second: bool) -> Vec<Combination> {
    let first = |a: usize| Combination { first: DVec3::AXES[a], ..Combination::ZERO };
    let second = |[a, b]: [usize; 2]| {
        let product = outer(DVec3::AXES[a], DVec3::AXES[b]);
        Combination { second: (product + product.transpose()) * 0.5, ..Combination::ZERO }
    };
    let mut all: Vec<Combination> = (0..3).map(first).collect();
    if with_second {
        all.extend([[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]].map(second));
    }
    all
}

impl Moments {
    /// The number of a combination.
    pub(crate) fn of_combination(&self, combination: &Combination) -> f64 {
        let second: f64 = (0..3).map(|a| combination.second.col(a).dot(self.second.col(a))).sum();
        combination.volume * self.volume + combination.first.dot(self.first) + second
    }
}

/// Gradients of `combinations` by the controls (each #controls × 3), in the pose `points` (#vertices × 3), about a point.
pub(crate) fn control_gradients(
    combinations: &[Combination],
    solid: &Solid,
    binding: &Binding,
    points: &[DVec3],
    about: DVec3,
) -> Vec<Vec<DVec3>> {
    let points = relative(solid, points, about);
    combinations.iter().map(|combination| binding.adjoint(&combination.gradient(solid, &points))).collect()
}

/// Points relative to one, followed by the apexes of caps.
pub(crate) fn relative(solid: &Solid, points: &[DVec3], about: DVec3) -> Vec<DVec3> {
    assert_eq!(points.len(), solid.vertex_count(), "one point for each vertex of the solid");
    let mut relative: Vec<DVec3> = points.iter().map(|p| *p - about).collect();
    for members in solid.cap_members() {
        let sum: DVec3 = members.iter().map(|v| relative[*v as usize]).sum();
        relative.push(sum / members.len() as f64);
    }
    relative
}

/// a bᵀ
pub(crate) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// v ↦ a × v
pub(crate) fn cross_matrix(a: DVec3) -> DMat3 {
    DMat3::from_cols(a.cross(DVec3::X), a.cross(DVec3::Y), a.cross(DVec3::Z))
}
