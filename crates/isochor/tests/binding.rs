//! A binding is a matrix: against its own dense form.

mod random;

use glam::{DMat3, DQuat, DVec3};
use isochor::{Basis, Binding, Frame, Lattice, Outside, displaced};
use proptest::prelude::*;
use random::Random;

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.within(0.0, n as f64) as usize
    }

    fn vectors(&mut self, count: usize) -> Vec<DVec3> {
        (0..count).map(|_| self.vector()).collect()
    }

    fn basis(&mut self) -> Basis {
        let size = 2 + self.below(6);
        let degree = 1 + self.below(size - 1);
        if self.below(2) == 0 { Basis::clamped(size, degree) } else { Basis::uniform(size, degree) }.unwrap()
    }

    /// Random bases over a rotated frame that holds about half of the cube [−1, 1]³.
    fn lattice(&mut self) -> Lattice {
        let [x, y, z] = [0; 3].map(|_| self.within(-1.0, 1.0));
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, 2.0).normalize());
        let axes = [0, 1, 2].map(|a| rotation.col(a) * self.within(1.2, 1.8));
        let origin = -(axes[0] + axes[1] + axes[2]) / 2.0;
        let bases = [0; 3].map(|_| self.basis());
        Lattice::new(bases, Frame { origin, axes }).unwrap()
    }

    fn outside(&mut self) -> Outside {
        [Outside::Keep, Outside::Extend][self.below(2)]
    }
}

/// W as rows of numbers.
fn dense(binding: &Binding) -> Vec<Vec<f64>> {
    let row = |v| {
        let mut row = vec![0.0; binding.control_count()];
        binding.weights(v).into_iter().for_each(|(c, w)| row[c] = w);
        row
    };
    (0..binding.vertex_count()).map(row).collect()
}

fn dot(a: &[DVec3], b: &[DVec3]) -> (f64, f64) {
    let terms = || a.iter().zip(b).map(|(a, b)| a.dot(*b));
    (terms().sum(), terms().map(f64::abs).sum())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_adjoint_is_the_transpose(seed: u64) {
        let mut random = Random(seed);
        let (lattice, outside, points) = (random.lattice(), random.outside(), random.vectors(200));
        let binding = lattice.bind(&points, outside).unwrap();
        let (c, g) = (random.vectors(binding.control_count()), random.vectors(200));
        let ((left, size), (right, _)) = (dot(&binding.apply(&c), &g), dot(&c, &binding.adjoint(&g)));
        // ⟨W c, g⟩ = ⟨c, Wᵀ g⟩. Weights beyond the domain can exceed 1, and then cancel.
        let largest = dense(&binding).iter().map(|row| row.iter().map(|w| w.abs()).sum::<f64>()).fold(1.0, f64::max);
        prop_assert!((left - right).abs() <= 1e-14 * (size + 200.0 * largest), "{} and {}", left, right);
    }

    #[test]
    fn apply_and_adjoint_are_products_with_the_matrix_of_weights(seed: u64) {
        let mut random = Random(seed);
        let (lattice, outside, points) = (random.lattice(), random.outside(), random.vectors(60));
        let binding = lattice.bind(&points, outside).unwrap();
        let matrix = dense(&binding);
        let (c, g) = (random.vectors(binding.control_count()), random.vectors(60));
        for (row, found) in matrix.iter().zip(binding.apply(&c)) {
            let expected: DVec3 = row.iter().zip(&c).map(|(w, c)| *c * *w).sum();
            let size: f64 = row.iter().map(|w| w.abs()).sum();
            prop_assert!((found - expected).abs().max_element() <= 4e-15 * size);
        }
        for (control, found) in binding.adjoint(&g).into_iter().enumerate() {
            let column = || matrix.iter().map(|row| row[control]);
            let expected: DVec3 = column().zip(&g).map(|(w, g)| *g * w).sum();
            let size: f64 = column().map(f64::abs).sum();
            prop_assert!((found - expected).abs().max_element() <= 4e-15 * size);
        }
    }

    #[test]
    fn one_number_per_entry_gives_the_bits_of_a_column(seed: u64) {
        let mut random = Random(seed);
        let (lattice, outside, points) = (random.lattice(), random.outside(), random.vectors(50));
        let binding = lattice.bind(&points, outside).unwrap();
        let (c, g) = (random.vectors(binding.control_count()), random.vectors(50));
        let column = |vectors: &[DVec3], a: usize| vectors.iter().map(|v| v[a]).collect::<Vec<_>>();
        for a in 0..3 {
            prop_assert_eq!(binding.apply_scalar(&column(&c, a)), column(&binding.apply(&c), a));
            prop_assert_eq!(binding.adjoint_scalar(&column(&g, a)), column(&binding.adjoint(&g), a));
        }
    }

    #[test]
    fn rows_sum_to_one_and_rows_of_kept_vertices_are_empty(seed: u64) {
        let mut random = Random(seed);
        let (lattice, points) = (random.lattice(), random.vectors(200));
        let kept = lattice.bind(&points, Outside::Keep).unwrap();
        let extended = lattice.bind(&points, Outside::Extend).unwrap();
        prop_assert_eq!(extended.kept_count(), 0);
        let mut empty = 0;
        for (v, point) in points.iter().enumerate() {
            let parameters = lattice.parameters(*point);
            let is_inside = parameters.min_element() >= 0.0 && parameters.max_element() <= 1.0;
            prop_assert_eq!(kept.weights(v).is_empty(), !is_inside);
            empty += usize::from(!is_inside);
            let sum: f64 = extended.weights(v).iter().map(|(_, w)| w).sum();
            let size: f64 = extended.weights(v).iter().map(|(_, w)| w.abs()).sum();
            prop_assert!((sum - 1.0).abs() <= 1e-14 * size);
            if is_inside {
                prop_assert_eq!(kept.weights(v), extended.weights(v));
                prop_assert!(kept.weights(v).iter().all(|(_, w)| *w > 0.0));
            }
        }
        prop_assert_eq!((kept.kept_count(), kept.vertex_count()), (empty, 200));
        let unit = vec![1.0; kept.control_count()];
        for (v, sum) in kept.apply_scalar(&unit).into_iter().enumerate() {
            let expected = f64::from(!kept.weights(v).is_empty());
            prop_assert!((sum - expected).abs() <= 1e-14);
        }
    }
}

fn unit_lattice(size: usize) -> Lattice {
    let frame = Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
    Lattice::new([0; 3].map(|_| Basis::clamped(size, size.min(4) - 1).unwrap()), frame).unwrap()
}

#[test]
fn adjoints_over_many_vertices_add_up_all_of_them() {
    // Many chunks of vertices, all with one vector: Wᵀ g = g Σ_v W_v, and Σ over controls gives #vertices · g.
    let mut random = Random(1);
    let n = 50_000;
    let points: Vec<DVec3> = (0..n).map(|_| (random.vector() + 1.0) / 2.0).collect();
    let binding = unit_lattice(5).bind(&points, Outside::Refuse).unwrap();
    let g = DVec3::new(1.0, -2.0, 0.5);
    let adjoint = binding.adjoint(&vec![g; n]);
    let mut columns = vec![0.0; binding.control_count()];
    (0..n).flat_map(|v| binding.weights(v)).for_each(|(c, w)| columns[c] += w);
    for (found, sum) in adjoint.iter().zip(&columns) {
        assert!((*found - g * *sum).abs().max_element() <= 1e-12 * sum);
    }
    let total: DVec3 = adjoint.iter().sum();
    assert!((total - g * n as f64).abs().max_element() <= 1e-12 * n as f64);
}

#[test]
fn trilinear_weights_at_the_middle_of_a_cell_are_an_eighth_each() {
    let binding = unit_lattice(2).bind(&[DVec3::splat(0.5), DVec3::ZERO], Outside::Refuse).unwrap();
    assert_eq!(binding.weights(0), (0..8).map(|c| (c, 0.125)).collect::<Vec<_>>());
    // Weights of 0 are not listed.
    assert_eq!(binding.weights(1), [(0, 1.0)]);
}

#[test]
fn no_vertices_bind_to_an_empty_matrix() {
    let binding = unit_lattice(3).bind(&[], Outside::Refuse).unwrap();
    assert_eq!((binding.vertex_count(), binding.control_count(), binding.kept_count()), (0, 27, 0));
    assert_eq!(binding.apply(&[DVec3::ONE; 27]), []);
    assert_eq!(binding.adjoint(&[]), [DVec3::ZERO; 27]);
}

#[test]
fn displacing_by_nothing_keeps_every_bit() {
    let points = [DVec3::new(-0.0, 0.0, 1e-320), DVec3::new(f64::MAX, -1.5, -0.0)];
    for nothing in [0.0, -0.0] {
        let same = displaced(&points, &[DVec3::splat(nothing); 2]);
        for (a, b) in same.iter().zip(&points) {
            assert_eq!(a.to_array().map(f64::to_bits), b.to_array().map(f64::to_bits));
        }
    }
    assert_eq!(displaced(&[DVec3::ONE], &[DVec3::new(0.0, 1.0, -3.0)]), [DVec3::new(1.0, 2.0, -2.0)]);
}

#[test]
#[should_panic(expected = "one entry for each control")]
fn controls_of_another_number_are_refused() {
    let _ = unit_lattice(2).bind(&[DVec3::ZERO], Outside::Keep).unwrap().apply(&[DVec3::ZERO; 7]);
}

#[test]
#[should_panic(expected = "one entry for each vertex")]
fn vertices_of_another_number_are_refused() {
    let _ = unit_lattice(2).bind(&[DVec3::ZERO], Outside::Keep).unwrap().adjoint(&[DVec3::ZERO; 2]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_binding_in_the_order_of_cells_has_the_same_rows_and_products(seed: u64) {
        let mut random = Random(seed);
        let (lattice, outside, points) = (random.lattice(), random.outside(), random.vectors(300));
        let binding = lattice.bind(&points, outside).unwrap();
        let order = binding.cell_order();
        let mut vertices = order.clone();
        vertices.sort_unstable();
        prop_assert_eq!(vertices, (0..300).collect::<Vec<_>>());
        let permuted = binding.permuted(&order);
        prop_assert_eq!((permuted.kept_count(), permuted.control_count()), (binding.kept_count(), binding.control_count()));
        for (i, v) in order.iter().enumerate() {
            prop_assert_eq!(permuted.weights(i), binding.weights(*v as usize));
        }
        // First controls ascend, and vertices of one cell keep their order.
        let firsts: Vec<_> = order.iter().filter_map(|v| Some((binding.weights(*v as usize).first()?.0, *v))).collect();
        prop_assert!(outside == Outside::Extend || firsts.is_sorted());
        let (c, g) = (random.vectors(binding.control_count()), random.vectors(300));
        let (whole, there) = (binding.apply(&c), permuted.apply(&c));
        for (i, v) in order.iter().enumerate() {
            prop_assert!((there[i] - whole[*v as usize]).abs().max_element() <= 1e-14 * (1.0 + whole[*v as usize].length()));
        }
        let permuted_g: Vec<_> = order.iter().map(|v| g[*v as usize]).collect();
        let size: f64 = dense(&binding).iter().flatten().map(|w| w.abs()).sum();
        for (a, b) in permuted.adjoint(&permuted_g).iter().zip(binding.adjoint(&g)) {
            prop_assert!((*a - b).abs().max_element() <= 1e-15 * size);
        }
    }
}

/// A lattice over the unit cube with basis functions of these degrees.
fn of_degrees(degrees: [usize; 3]) -> Lattice {
    let frame = Frame { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
    let sizes = [7, 6, 8];
    Lattice::new([0, 1, 2].map(|a| Basis::uniform(sizes[a], degrees[a]).unwrap()), frame).unwrap()
}

/// W c and Wᵀ g from the rows of W, with the sizes of the sums.
fn products(binding: &Binding, c: &[DVec3], g: &[DVec3]) -> [Vec<(DVec3, f64)>; 2] {
    let mut adjoint = vec![(DVec3::ZERO, 0.0); binding.control_count()];
    let mut apply = vec![(DVec3::ZERO, 0.0); binding.vertex_count()];
    for (v, sum) in apply.iter_mut().enumerate() {
        for (control, w) in binding.weights(v) {
            *sum = (sum.0 + c[control] * w, sum.1 + w.abs());
            let sum = &mut adjoint[control];
            *sum = (sum.0 + g[v] * w, sum.1 + w.abs());
        }
    }
    [apply, adjoint]
}

fn assert_products(binding: &Binding, random: &mut Random) {
    let (c, g) = (random.vectors(binding.control_count()), random.vectors(binding.vertex_count()));
    let [apply, adjoint] = products(binding, &c, &g);
    for (found, (expected, size)) in
        binding.apply(&c).iter().zip(&apply).chain(binding.adjoint(&g).iter().zip(&adjoint))
    {
        assert!((*found - *expected).abs().max_element() <= 1e-14 * size, "{found} instead of {expected}");
    }
    // Points displaced in one go have the bits of two steps; numbers those of a column.
    let points = random.vectors(binding.vertex_count());
    assert_eq!(binding.displaced(&points, &c), displaced(&points, &binding.apply(&c)));
    for a in 0..3 {
        let column = |vectors: &[DVec3]| vectors.iter().map(|v| v[a]).collect::<Vec<_>>();
        assert_eq!(binding.apply_scalar(&column(&c)), column(&binding.apply(&c)));
        assert_eq!(binding.adjoint_scalar(&column(&g)), column(&binding.adjoint(&g)));
    }
}

#[test]
fn products_of_degrees_one_to_five_and_mixed_ones_are_those_with_the_rows() {
    let mut random = Random(31);
    let points: Vec<DVec3> = (0..700).map(|_| (random.vector() + 1.0) / 2.0).collect();
    for degrees in [[1; 3], [2; 3], [3; 3], [4; 3], [5; 3], [1, 2, 3], [3, 3, 2], [3, 1, 3], [5, 3, 3], [4, 3, 5]] {
        let binding = of_degrees(degrees).bind(&points, Outside::Refuse).unwrap();
        assert_products(&binding, &mut random);
        assert_products(&binding.permuted(&binding.cell_order()), &mut random);
    }
}

#[test]
fn products_over_runs_of_every_length_are_those_with_the_rows() {
    // Runs of 1 to 9 vertices in two cells in turn: whole groups of four, rests, and lone vertices.
    let mut random = Random(32);
    let mut points = Vec::new();
    for length in 1..10 {
        for cell in [DVec3::splat(0.01), DVec3::splat(0.9)] {
            points.extend((0..length).map(|_| cell + 0.01 * random.vector().abs()));
        }
    }
    assert_products(&of_degrees([3; 3]).bind(&points, Outside::Refuse).unwrap(), &mut random);
}

#[test]
fn products_with_kept_vertices_between_others_leave_them_out() {
    let mut random = Random(33);
    let points: Vec<DVec3> = (0..500).map(|_| (random.vector() + 0.6) / 1.2).collect();
    let binding = of_degrees([3; 3]).bind(&points, Outside::Keep).unwrap();
    assert!(binding.kept_count() > 100 && binding.kept_count() < 400);
    assert_products(&binding, &mut random);
    let ordered = binding.permuted(&binding.cell_order());
    assert_products(&ordered, &mut random);
    let c = random.vectors(ordered.control_count());
    for (v, found) in ordered.apply(&c).iter().enumerate() {
        assert_eq!(*found == DVec3::ZERO, ordered.weights(v).is_empty());
    }
}

#[test]
fn memory_grows_with_vertices_and_for_cubic_lattices_by_at_most_an_eighth_of_a_kilobyte_each() {
    let points: Vec<DVec3> = (0..1000).map(|v| DVec3::splat(f64::from(v) / 1000.0)).collect();
    let lattice = of_degrees([3; 3]);
    let memory = |points: &[DVec3]| lattice.bind(points, Outside::Refuse).unwrap().memory();
    let (none, half, all) = (memory(&[]), memory(&points[..500]), memory(&points));
    assert!(none < half && half < all && all - none <= 128 * points.len(), "{none}, {half}, {all} bytes");
}
