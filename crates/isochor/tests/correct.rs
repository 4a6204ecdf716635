//! Corrections against theorems: exactness, optimality, invariance; and every way in which there is none.

mod random;

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3};
use isochor::shapes::{bottle, cube, icosphere, plate};
use isochor::{
    Basis, Binding, Bounds, CorrectError, CorrectOptions, Correction, Frame, Lattice, Mesh, Method, OpenBoundaries,
    Outside, Pose, Reason, Solid, Status, Wanted, correct, displaced, tolerances, topology,
};
use proptest::prelude::*;
use random::Random;

/// The relative error that corrections promise.
const PROMISED: f64 = 1e-13;

fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.within(0.0, n as f64) as usize
    }

    fn rotation(&mut self) -> DMat3 {
        let [x, y, z] = [0; 3].map(|_| self.within(-1.0, 1.0));
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, 2.0).normalize())
    }

    /// Mobilities over two decades, three in ten of them 0.
    fn mobility(&mut self, controls: usize) -> Vec<DVec3> {
        let mut one = || if self.within(0.0, 1.0) < 0.3 { 0.0 } else { 10f64.powf(self.within(-1.0, 1.0)) };
        (0..controls).map(|_| DVec3::new(one(), one(), one())).collect()
    }

    /// One to four directions of any length at any angle, with shares, some of them 0.
    fn axes(&mut self) -> Method {
        let count = 1 + self.below(4);
        let directions = (0..count).map(|_| self.vector() * 10f64.powf(self.within(-3.0, 3.0))).collect();
        let mut shares: Vec<f64> = (0..count).map(|_| self.within(-0.5, 1.0).max(0.0)).collect();
        shares[self.below(count)] = 0.5;
        Method::Axes { directions, shares: (self.below(2) == 0).then_some(shares) }
    }
}

/// A posed model and what it is corrected with.
struct Posed {
    solid: Solid,
    lattice: Lattice,
    binding: Binding,
    vertices: Vec<DVec3>,
    volume: f64,
}

impl Posed {
    /// `mesh` in a lattice, its controls moved by `displacement`.
    fn new(mesh: &Mesh, lattice: Lattice, displacement: &[DVec3]) -> Self {
        let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let vertices = displaced(mesh.points(), &binding.apply(displacement));
        Self::of(mesh, lattice, binding, vertices)
    }

    fn of(mesh: &Mesh, lattice: Lattice, binding: Binding, vertices: Vec<DVec3>) -> Self {
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
        let volume = solid.volume(&vertices);
        Self { solid, lattice, binding, vertices, volume }
    }

    fn at_rest(mesh: &Mesh, bases: [Basis; 3]) -> Self {
        let lattice = Lattice::new(bases, Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap()).unwrap();
        let nothing = vec![DVec3::ZERO; lattice.control_count()];
        Self::new(mesh, lattice, &nothing)
    }

    /// A star-shaped blob in a random lattice of 2³ to 7³ controls, each moved by up to a tenth of the extent.
    fn random(random: &mut Random) -> Self {
        let sphere = icosphere(2);
        let points: Vec<DVec3> = sphere.points().iter().map(|p| *p * random.within(0.7, 1.3)).collect();
        let blob = sphere.with_points(points).unwrap();
        let bases = [0; 3].map(|_| {
            let size = 2 + random.below(6);
            let degree = 1 + random.below((size - 1).min(4));
            if random.below(2) == 0 { Basis::clamped(size, degree) } else { Basis::uniform(size, degree) }.unwrap()
        });
        let frame = Frame::fitted(blob.bounds().unwrap(), random.within(0.0, 0.2)).unwrap();
        let lattice = Lattice::new(bases, frame).unwrap();
        let displacement: Vec<DVec3> = (0..lattice.control_count()).map(|_| random.vector() * 0.1).collect();
        Self::new(&blob, lattice, &displacement)
    }

    fn pose(&self) -> Pose<'_> {
        Pose { solid: &self.solid, vertices: &self.vertices, binding: &self.binding }
    }

    fn correct(&self, target: f64, method: Method, mobility: Option<&[DVec3]>) -> Result<Correction, CorrectError> {
        let options = CorrectOptions { method, mobility: mobility.map(<[DVec3]>::to_vec), ..CorrectOptions::default() };
        correct(&self.pose(), &Wanted::volume(target), &options)
    }

    /// A correction that is possible, with everything checked that must hold of any.
    fn corrected(&self, target: f64, method: Method, mobility: Option<&[DVec3]>) -> Correction {
        let corrected = self.correct(target, method, mobility).unwrap();
        self.check(&corrected, target, mobility);
        corrected
    }

    fn check(&self, corrected: &Correction, target: f64, mobility: Option<&[DVec3]>) {
        let measured = self.solid.volume(&corrected.vertices);
        assert!(((measured - target) / target).abs() <= PROMISED, "{measured} instead of {target}");
        assert!(corrected.relative_error <= PROMISED, "{:e}", corrected.relative_error);
        assert_eq!(corrected.relative_error, ((corrected.volume - target) / target).abs());
        assert_eq!((corrected.volume_before, corrected.status), (self.volume, Status::Exact));
        assert!(corrected.steps > 0);
        // X + W δ, where displacements pile up rounding in proportion to their size.
        let expected = displaced(&self.vertices, &self.binding.apply(&corrected.displacement));
        assert_all_near(&corrected.vertices, &expected, 1e-13 * extent(&expected));
        for (c, m) in mobility.into_iter().flatten().enumerate() {
            for a in 0..3 {
                assert!(m[a] > 0.0 || corrected.displacement[c][a].to_bits() == 0, "control {c} is pinned");
            }
        }
    }

    /// ∂V/∂C = Wᵀ g, from the weights one by one.
    fn gradient(&self, vertices: &[DVec3]) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; self.binding.control_count()];
        for (v, g) in self.solid.volume_gradient(vertices).into_iter().enumerate() {
            self.binding.weights(v).into_iter().for_each(|(c, w)| sums[c] += g * w);
        }
        sums
    }

    /// The volume with the controls displaced by `t` times `direction`.
    fn volume_along(&self, direction: &[DVec3], t: f64) -> f64 {
        let shift = self.binding.apply(direction);
        let vertices: Vec<DVec3> = self.vertices.iter().zip(&shift).map(|(x, d)| *x + *d * t).collect();
        self.solid.volume(&vertices)
    }
}

fn axes<const K: usize>(directions: [DVec3; K]) -> Method {
    Method::Axes { directions: directions.to_vec(), shares: None }
}

fn shared<const K: usize>(directions: [DVec3; K], shares: [f64; K]) -> Method {
    Method::Axes { directions: directions.to_vec(), shares: Some(shares.to_vec()) }
}

fn extent(points: &[DVec3]) -> f64 {
    Bounds::of(points).unwrap().extent()
}

fn longest(vectors: &[DVec3]) -> f64 {
    vectors.iter().map(|v| v.length()).fold(0.0, f64::max)
}

fn assert_all_near(found: &[DVec3], expected: &[DVec3], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (v, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((*a - *b).abs().max_element() <= tolerance, "{v}: {a} instead of {b}, tolerance {tolerance:e}");
    }
}

fn bernstein(size: usize) -> [Basis; 3] {
    [0; 3].map(|_| Basis::bernstein(size).unwrap())
}

fn assert_impossible(result: &Result<Correction, CorrectError>, expected: &Reason) {
    match result {
        Err(CorrectError::Impossible { reason, .. }) => assert_eq!(reason, expected),
        other => panic!("{other:?}"),
    }
}

// Exactness

proptest! {
    #![proptest_config(cases(192))]

    #[test]
    fn any_axes_give_the_wanted_volume_and_leave_pinned_coordinates_alone(seed: u64, change in 0.5..1.5f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let mobility = random.mobility(posed.binding.control_count());
        posed.corrected(change * posed.volume, random.axes(), None);
        let letters = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]][random.below(6)];
        let directions: Vec<DVec3> = letters[..1 + random.below(3)].iter().map(|a| DVec3::AXES[*a]).collect();
        let method = Method::Axes { directions: directions.clone(), shares: None };
        let corrected = posed.corrected(change * posed.volume, method, Some(&mobility));
        // Nothing moves along the axes that were not chosen.
        for a in (0..3).filter(|a| !directions.contains(&DVec3::AXES[*a])) {
            prop_assert!(corrected.displacement.iter().all(|d| d[a] == 0.0));
        }
    }

    #[test]
    fn the_gradient_gives_the_wanted_volume_or_says_where_it_turns(seed: u64, change in 0.5..1.5f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let target = change * posed.volume;
        let mobility = random.mobility(posed.binding.control_count());
        posed.corrected(target, Method::Gradient, None);
        match posed.correct(target, Method::Gradient, Some(&mobility)) {
            Ok(corrected) => posed.check(&corrected, target, Some(&mobility)),
            Err(CorrectError::Impossible { reason: Reason::Turns { limit }, .. }) => {
                let fraction = (limit - posed.volume) / (target - posed.volume);
                prop_assert!((0.0..1.0).contains(&fraction), "{} between {} and {}", limit, posed.volume, target);
            }
            Err(error) => prop_assert!(false, "{}", error),
        }
    }

    #[test]
    fn models_far_from_the_origin_are_as_exact_in_a_frame_near_them(seed: u64, change in 0.5..1.5f64) {
        let mut random = Random(seed);
        let mut posed = Posed::random(&mut random);
        let near = posed.corrected(change * posed.volume, Method::Gradient, None);
        for distance in [1e5, 1e6] {
            let by = random.vector().normalize() * distance * extent(&posed.vertices);
            // The far coordinates are what is given; taking their frame's origin away again is exact.
            let far: Vec<DVec3> = posed.vertices.iter().map(|p| *p + by).collect();
            let origin = Bounds::of(&far).unwrap().lossless_origin();
            posed.vertices = far.iter().map(|p| *p - origin).collect();
            let target = change * posed.volume;
            for method in [Method::Gradient, Method::xyz(), random.axes()] {
                let options = CorrectOptions { method: method.clone(), mobility: None, ..CorrectOptions::default() };
                let pose = Pose { vertices: &far, ..posed.pose() };
                let corrected = correct(&pose, &Wanted::volume(target), &options).unwrap();
                prop_assert!(corrected.relative_error <= PROMISED);
                let vertices = displaced(&posed.vertices, &posed.binding.apply(&corrected.displacement));
                let measured = posed.solid.volume(&vertices);
                prop_assert!(((measured - target) / target).abs() <= PROMISED, "{} instead of {}", measured, target);
                // Adding the origin back rounds to the grid of the coordinates there.
                let returned: Vec<DVec3> = vertices.iter().map(|p| *p + origin).collect();
                assert_all_near(&corrected.vertices, &returned, f64::EPSILON * (2.0 * by.length() + 10.0));
                if method == Method::Gradient {
                    assert_all_near(&corrected.displacement, &near.displacement, 1e-14 * distance);
                }
            }
        }
    }
}

#[test]
fn one_axis_reaches_any_volume_even_one_of_the_other_sign() {
    // The volume is affine along one direction.
    let posed = Posed::random(&mut Random(1));
    for factor in [0.1, 0.5, 3.0, 100.0, -1.0, -20.0] {
        for direction in DVec3::AXES {
            posed.corrected(factor * posed.volume, axes([direction]), None);
        }
    }
}

#[test]
fn correcting_along_some_axes_only_moves_nothing_along_the_others() {
    let posed = Posed::random(&mut Random(2));
    let [x, y, z] = DVec3::AXES;
    let target = 1.3 * posed.volume;
    for (method, still) in
        [(axes([x]), vec![1, 2]), (axes([y]), vec![0, 2]), (axes([z]), vec![0, 1]), (axes([x, y]), vec![2])]
            .into_iter()
            .chain([(axes([z, x]), vec![1]), (axes([y, z]), vec![0]), (axes([z, y, x]), vec![])])
    {
        let corrected = posed.corrected(target, method, None);
        for a in 0..3 {
            let moves = corrected.displacement.iter().any(|d| d[a] != 0.0);
            assert_eq!(moves, !still.contains(&a));
        }
    }
}

#[test]
fn what_another_deformer_made_is_corrected_with_a_lattice_laid_around_it() {
    // Twisted by 240° per extent and bulged: no lattice of 5³ controls made this.
    let bottle = bottle(48, 60);
    let rest = Solid::new(&bottle, &topology(&bottle), OpenBoundaries::Cap).unwrap().volume(bottle.points());
    let twisted: Vec<DVec3> = bottle
        .points()
        .iter()
        .map(|p| {
            DMat3::from_rotation_z(p.z * 4.0 * PI / 9.0) * DVec3::new(p.x + 0.2 * p.z * p.z, p.y, p.z + 0.1 * p.x.sin())
        })
        .collect();
    let frame = Frame::fitted(Bounds::of(&twisted).unwrap(), 0.1).unwrap();
    let lattice = Lattice::new([0; 3].map(|_| Basis::clamped(5, 3).unwrap()), frame).unwrap();
    let binding = lattice.bind(&twisted, Outside::Refuse).unwrap();
    let posed = Posed::of(&bottle, lattice, binding, twisted);
    assert!((posed.volume / rest - 1.0).abs() > 1e-3);
    for method in [Method::Gradient, Method::xyz(), axes([DVec3::new(1.0, 1.0, 0.2)])] {
        let corrected = posed.corrected(rest, method, None);
        assert!(longest(&corrected.displacement) < 0.5 * extent(&posed.vertices));
    }
}

#[test]
fn an_inside_out_model_is_corrected_to_a_negative_volume() {
    let mut random = Random(3);
    let sphere = icosphere(2);
    let faces: Vec<[u32; 3]> = sphere.faces().iter().map(|f| [f[0], f[2], f[1]]).collect();
    let inverted = Mesh::new(sphere.points().to_vec(), faces.iter().collect()).unwrap();
    let bases = || [0; 3].map(|_| Basis::clamped(4, 2).unwrap());
    let (outward, inward) = (Posed::at_rest(&sphere, bases()), Posed::at_rest(&inverted, bases()));
    for method in [Method::Gradient, Method::xyz(), random.axes()] {
        let (a, b) = (outward.corrected(4.5, method.clone(), None), inward.corrected(-4.5, method, None));
        assert_all_near(&a.displacement, &b.displacement, 1e-13);
    }
}

#[test]
fn open_models_are_corrected_with_their_caps() {
    let sphere = icosphere(3);
    let is_low = |face: &&[u32]| face.iter().map(|v| sphere.points()[*v as usize].z).sum::<f64>() < 1.0;
    let bowl = Mesh::new(sphere.points().to_vec(), sphere.faces().iter().filter(is_low).collect()).unwrap();
    let posed = Posed::at_rest(&bowl, bernstein(4));
    assert_eq!(posed.solid.cap_count(), 1);
    for method in [Method::Gradient, Method::xyz()] {
        posed.corrected(1.4 * posed.volume, method, None);
    }
}

// Optimality

proptest! {
    #![proptest_config(cases(96))]

    #[test]
    fn one_axis_step_is_the_least_displacement_of_all_that_give_the_volume(seed: u64, change in 0.5..1.5f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let mobility = random.mobility(posed.binding.control_count());
        let d = if seed.is_multiple_of(2) { DVec3::AXES[random.below(3)] } else { random.vector().normalize() };
        let a = change * posed.volume - posed.volume; // exact, as the deficit is
        // Moving by δ along d costs Σ_c (δ d_c)²/m_c = δ²/m.
        let along = |m: &DVec3| {
            let pairs = m.to_array().into_iter().zip(d.to_array()).filter(|(_, d)| *d != 0.0);
            1.0 / pairs.map(|(m, d)| d * d / m).sum::<f64>()
        };
        let m: Vec<f64> = mobility.iter().map(along).collect();
        let alpha: Vec<f64> = posed.gradient(&posed.vertices).iter().map(|g| g.dot(d)).collect();
        let norm: f64 = alpha.iter().zip(&m).map(|(a, m)| m * a * a).sum();
        prop_assume!(norm > 1e-12);
        let corrected = posed.corrected(change * posed.volume, axes([d]), Some(&mobility));

        // HB (17): δ_i = a m_i α_i / Σ m α², the minimiser of Σ δ²/m over α·δ = a.
        let delta: Vec<f64> = corrected.displacement.iter().map(|x| x.dot(d)).collect();
        let largest = delta.iter().fold(0.0f64, |l, x| l.max(x.abs()));
        for c in 0..delta.len() {
            prop_assert!((delta[c] - a * m[c] * alpha[c] / norm).abs() <= 1e-12 * largest);
            prop_assert!((corrected.displacement[c] - d * delta[c]).length() <= 1e-15 * largest);
        }
        // Its cost is a²/Σ m α², and any other way to the same volume costs more.
        let cost = |delta: &[f64]| -> f64 {
            delta.iter().zip(&m).filter(|(_, m)| **m > 0.0).map(|(x, m)| x * x / m).sum()
        };
        prop_assert!((cost(&delta) / (a * a / norm) - 1.0).abs() <= 1e-11);
        let mut other: Vec<f64> = m.iter().map(|m| if *m > 0.0 { random.within(-1.0, 1.0) * largest } else { 0.0 }).collect();
        let excess: f64 = other.iter().zip(&alpha).map(|(x, a)| x * a).sum();
        other.iter_mut().zip(&alpha).zip(&m).for_each(|((x, a), m)| *x -= excess * m * a / norm); // now α·other = 0
        for step in [1e-3, 0.1, 1.0] {
            let feasible: Vec<f64> = delta.iter().zip(&other).map(|(x, o)| x + step * o).collect();
            let volume = posed.volume_along(&feasible.iter().map(|x| d * *x).collect::<Vec<_>>(), 1.0);
            prop_assert!((volume / corrected.volume - 1.0).abs() <= 1e-12);
            prop_assert!(cost(&feasible) >= cost(&delta) * (1.0 - 1e-12));
        }
    }

    #[test]
    fn axes_in_turn_are_single_axes_with_their_shares_of_the_change(seed: u64, change in 0.5..1.5f64) {
        let mut random = Random(seed);
        let mut posed = Posed::random(&mut random);
        let directions = [random.vector(), random.vector(), random.vector()];
        let shares = [random.within(0.1, 1.0), random.within(0.1, 1.0), random.within(0.1, 1.0)];
        let (start, target) = (posed.volume, change * posed.volume);
        let whole = posed.corrected(target, shared(directions, shares), None);
        let mut total = vec![DVec3::ZERO; posed.binding.control_count()];
        let mut reached = 0.0;
        for (direction, share) in directions.into_iter().zip(shares) {
            reached += share / shares.iter().sum::<f64>();
            let step = posed.correct(start + reached * (target - start), axes([direction]), None).unwrap();
            total = displaced(&total, &step.displacement);
            posed.vertices = step.vertices;
        }
        assert_all_near(&whole.displacement, &total, 1e-10 * longest(&total).max(1.0));
    }

    #[test]
    fn the_gradient_method_goes_along_the_gradient_where_the_volume_is_a_monotone_cubic(seed: u64, change in 0.6..1.5f64) {
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let mobility: Vec<DVec3> = random.mobility(posed.binding.control_count());
        let target = change * posed.volume;
        let Ok(corrected) = posed.correct(target, Method::Gradient, Some(&mobility)) else { return Ok(()) };
        // δ = t D, D = M ∘ ∇V.
        let gradient = posed.gradient(&posed.vertices);
        let direction: Vec<DVec3> = gradient.iter().zip(&mobility).map(|(g, m)| *g * *m).collect();
        let squared: f64 = direction.iter().map(|d| d.length_squared()).sum();
        let t = corrected.displacement.iter().zip(&direction).map(|(x, d)| x.dot(*d)).sum::<f64>() / squared;
        let expected: Vec<DVec3> = direction.iter().map(|d| *d * t).collect();
        assert_all_near(&corrected.displacement, &expected, 1e-12 * longest(&expected));
        prop_assert!(t * (change - 1.0) > 0.0);
        // Four values determine the cubic; it predicts all others.
        let v = [0.0, 1.0, 2.0, 3.0].map(|k| posed.volume_along(&direction, k * t));
        let size = v.iter().fold(0.0f64, |l, v| l.max(v.abs()));
        let (d1, d2, d3) = (v[1] - v[0], v[2] - 2.0 * v[1] + v[0], v[3] - 3.0 * (v[2] - v[1]) - v[0]);
        let cubic = |s: f64| v[0] + s * (d1 + (s - 1.0) / 2.0 * (d2 + (s - 2.0) / 3.0 * d3));
        let mut last = v[0];
        for k in 1..=20 {
            let s = f64::from(k) / 20.0;
            let volume = posed.volume_along(&direction, s * t);
            prop_assert!((volume - cubic(s)).abs() <= 1e-13 * size);
            prop_assert!((volume - last) * (target - v[0]) > 0.0, "it turns at {}", s);
            last = volume;
        }
        prop_assert!((cubic(-1.0) - posed.volume_along(&direction, -t)).abs() <= 1e-12 * size);
    }

    #[test]
    fn corrections_follow_rotation_translation_scale_and_mirroring(seed: u64, change in 0.7..1.4f64, scale in -3.0..3.0f64) {
        // Rotated coordinates are rounded, and so is their volume: of a deficit of 1e-5, 1e-10 is left certain.
        prop_assume!((change - 1.0).abs() > 1e-5);
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        // One mobility for all coordinates of a control: then nothing but the model itself has directions.
        let mobility: Vec<DVec3> = (0..posed.binding.control_count()).map(|_| DVec3::splat(random.within(0.1, 1.0))).collect();
        let (s, by) = (10f64.powf(scale), 3.0 * random.vector());
        let mirror = if seed & 1 == 0 { DVec3::ONE } else { DVec3::new(1.0, -1.0, 1.0) };
        let map = random.rotation() * DMat3::from_diagonal(mirror);
        let image = |p: DVec3| s * (map * p + by);
        // The same weights, from a frame that was moved along.
        let frame = posed.lattice.frame();
        let frame = Frame { origin: image(frame.origin), axes: frame.axes.map(|a| s * (map * a)) };
        let lattice = Lattice::new(posed.lattice.bases().clone(), frame).unwrap();
        let vertices: Vec<DVec3> = posed.vertices.iter().map(|p| image(*p)).collect();
        let other = Posed { solid: posed.solid.clone(), lattice, binding: posed.binding.clone(), volume: 0.0, vertices };
        let other = Posed { volume: other.solid.volume(&other.vertices), ..other };
        let target = map.determinant().signum() * s.powi(3) * change * posed.volume;
        let directions = [random.vector(), random.vector()];
        for (method, moved) in
            [(Method::Gradient, Method::Gradient), (axes(directions), axes(directions.map(|d| map * d)))]
        {
            let here = posed.correct(change * posed.volume, method, Some(&mobility)).unwrap();
            let there = other.corrected(target, moved, Some(&mobility));
            let expected: Vec<DVec3> = here.displacement.iter().map(|d| s * (map * *d)).collect();
            assert_all_near(&there.displacement, &expected, 1e-10 * longest(&expected));
        }
    }
}

#[test]
fn a_volume_beyond_the_turning_point_is_refused_with_the_maximum_of_the_cubic() {
    let (mut reached, mut refused) = (0, 0);
    for seed in 0..200 {
        // Six free controls: little freedom, so the line often bends back on the way.
        let mut random = Random(seed);
        let posed = Posed::random(&mut random);
        let free = [(); 6].map(|()| random.below(posed.binding.control_count()));
        let mobility: Vec<DVec3> =
            (0..posed.binding.control_count()).map(|c| DVec3::splat(f64::from(free.contains(&c)))).collect();
        let gradient = posed.gradient(&posed.vertices);
        let direction: Vec<DVec3> = gradient.iter().zip(&mobility).map(|(g, m)| *g * *m).collect();
        let slope: f64 = direction.iter().map(|d| d.length_squared()).sum();
        if slope < 1e-6 {
            continue;
        }
        let target = [-posed.volume, 0.2 * posed.volume, 3.0 * posed.volume, 30.0 * posed.volume][seed as usize % 4];
        // The cubic from four values along the line, in steps that would reach the target if it were straight.
        let step = (target - posed.volume) / slope;
        let v = [0.0, 1.0, 2.0, 3.0].map(|k| posed.volume_along(&direction, k * step));
        let (d1, d2, d3) = (v[1] - v[0], v[2] - 2.0 * v[1] + v[0], v[3] - 3.0 * (v[2] - v[1]) - v[0]);
        let (a1, a2, a3) = (d1 - d2 / 2.0 + d3 / 3.0, d2 / 2.0 - d3 / 2.0, d3 / 6.0);
        let cubic = |s: f64| v[0] + s * (a1 + s * (a2 + s * a3));
        // The smaller positive root of a₁ + 2 a₂ s + 3 a₃ s².
        let root = (a2 * a2 - 3.0 * a1 * a3).sqrt();
        let turn =
            [a1 / (-a2 + root), a1 / (-a2 - root)].into_iter().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
        let fraction = if turn < 1e3 { (cubic(turn) - v[0]) / (target - v[0]) } else { f64::INFINITY };
        if (fraction - 1.0).abs() < 1e-3 {
            continue; // on the border
        }
        match posed.correct(target, Method::Gradient, Some(&mobility)) {
            Ok(corrected) => {
                assert!(fraction > 1.0, "{seed}: the volume turns at {}", cubic(turn));
                posed.check(&corrected, target, Some(&mobility));
                reached += 1;
            }
            Err(CorrectError::Impossible { reason: Reason::Turns { limit }, volume, .. }) => {
                assert!(fraction < 1.0, "{seed}: the target is reached before {}", cubic(turn));
                assert_eq!(volume, posed.volume);
                let expected = cubic(turn);
                assert!((limit - expected).abs() <= 1e-9 * (target - volume).abs(), "{limit} instead of {expected}");
                refused += 1;
            }
            Err(error) => panic!("{seed}: {error}"),
        }
    }
    assert!(reached > 30 && refused > 30, "{reached} reached, {refused} refused");
}

// Axes on which the volume does not depend

/// A sphere in a quadratic Bernstein lattice turned by `rotation`, of which only the middle layer along u is free. By
/// symmetry the middle basis function has no slope on average, so the volume does not depend on moves along u: α = 0 but
/// for rounding.
fn dead_along_u(rotation: DMat3) -> (Posed, Vec<DVec3>) {
    let sphere = icosphere(3);
    let turned = sphere.with_points(sphere.points().iter().map(|p| rotation * *p).collect()).unwrap();
    let axes = [0, 1, 2].map(|a| rotation.col(a) * 2.0);
    let frame = Frame { origin: -(axes[0] + axes[1] + axes[2]) / 2.0, axes };
    let lattice = Lattice::new(bernstein(3), frame).unwrap();
    let mobility = (0..27).map(|c| DVec3::splat(f64::from(lattice.node(c)[0] == 1))).collect();
    (Posed::new(&turned, lattice, &[DVec3::ZERO; 27]), mobility)
}

#[test]
fn the_share_of_a_dead_axis_goes_to_the_others_and_no_control_runs_away() {
    let mut random = Random(4);
    let mut traps = 0;
    for rotation in [DMat3::IDENTITY, random.rotation(), random.rotation(), random.rotation()] {
        let (posed, mobility) = dead_along_u(rotation);
        let [x, y, z] = [0, 1, 2].map(|a| rotation.col(a));
        // The trap: HB (17) with this α is rounding noise divided by its square.
        let alpha: Vec<f64> =
            posed.gradient(&posed.vertices).iter().zip(&mobility).map(|(g, m)| g.dot(x) * m.x).collect();
        let norm: f64 = alpha.iter().map(|a| a * a).sum();
        assert!(norm < (1e-14 * 4.0 * PI).powi(2), "the axis is alive: {norm:e}");
        traps += usize::from(norm > 0.0 && 0.1 * posed.volume / norm.sqrt() > 1e10);

        for change in [0.6, 0.9, 1.2, 1.5] {
            let target = change * posed.volume;
            let only_live = posed.corrected(target, axes([y, z]), Some(&mobility));
            for method in [axes([x, y, z]), axes([y, x, z]), axes([y, z, x])] {
                let corrected = posed.corrected(target, method, Some(&mobility));
                assert_eq!(corrected.displacement, only_live.displacement);
                assert!(longest(&corrected.displacement) < 2.0 * extent(&posed.vertices));
            }
            let uneven = posed.corrected(target, shared([x, y, z], [10.0, 1.0, 3.0]), Some(&mobility));
            let expected = posed.corrected(target, shared([y, z], [1.0, 3.0]), Some(&mobility));
            assert_eq!(uneven.displacement, expected.displacement);
            assert_impossible(&posed.correct(target, axes([x]), Some(&mobility)), &Reason::Dead);
            assert_impossible(&posed.correct(target, axes([x, -2.0 * x]), Some(&mobility)), &Reason::Dead);
            // All of the change on the dead axis: nothing is left for the others.
            let all_on_x = posed.correct(target, shared([x, y], [1.0, 0.0]), Some(&mobility));
            assert_impossible(&all_on_x, &Reason::Dead);
        }
    }
    assert!(traps >= 2, "only {traps} of these would have been traps");
}

#[test]
fn a_model_that_is_symmetric_but_for_the_rounding_of_its_file_sends_no_control_away() {
    // The sphere of `dead_along_u` as f32 coordinates: its volume depends on moves along u by 1e−8 of what it does on the others.
    let mut random = Random(17);
    for _ in 0..4 {
        let rotation = random.rotation();
        let (exact, mobility) = dead_along_u(rotation);
        let single = |x: f64| f64::from(x as f32);
        let points: Vec<DVec3> = exact.vertices.iter().map(|p| DVec3::from_array(p.to_array().map(single))).collect();
        let mesh = icosphere(3).with_points(points.clone()).unwrap();
        let binding = exact.lattice.bind(&points, Outside::Extend).unwrap();
        let posed = Posed::of(&mesh, exact.lattice, binding, points);
        let [x, y, z] = [0, 1, 2].map(|a| rotation.col(a));
        for method in [axes([x, y, z]), axes([y, z, x])] {
            let corrected = posed.corrected(1.2 * posed.volume, method, Some(&mobility));
            let farthest = longest(&corrected.displacement) / extent(&posed.vertices);
            assert!(farthest < 2.0, "a control moves by {farthest:e} extents");
        }
    }
}

#[test]
fn an_axis_along_which_everything_is_pinned_is_dead() {
    let posed = Posed::random(&mut Random(5));
    let pinned_x = vec![DVec3::new(0.0, 1.0, 1.0); posed.binding.control_count()];
    let target = 1.2 * posed.volume;
    let [x, y, z] = DVec3::AXES;
    assert_impossible(&posed.correct(target, axes([x]), Some(&pinned_x)), &Reason::Dead);
    // A direction with any part along x is pinned too.
    assert_impossible(&posed.correct(target, axes([DVec3::new(1e-3, 1.0, 0.0)]), Some(&pinned_x)), &Reason::Dead);
    let corrected = posed.corrected(target, Method::xyz(), Some(&pinned_x));
    assert_eq!(corrected.displacement, posed.corrected(target, axes([y, z]), Some(&pinned_x)).displacement);
}

#[test]
fn the_gradient_is_dead_where_the_volume_depends_on_nothing_that_may_move() {
    let (posed, mobility) = dead_along_u(DMat3::IDENTITY);
    let only_x: Vec<DVec3> = mobility.iter().map(|m| *m * DVec3::X).collect();
    assert_impossible(&posed.correct(1.2 * posed.volume, Method::Gradient, Some(&only_x)), &Reason::Dead);
    posed.corrected(1.2 * posed.volume, Method::Gradient, Some(&mobility));
}

#[test]
fn an_axis_that_dies_on_the_way_gives_its_share_to_the_next_and_the_last_one_to_the_first() {
    // A sphere at rest is symmetric in y, and of the moves along y only the middle layer's are free: there y is dead, as in
    // `dead_along_u`. Moves along x change neither the gradient along x nor each other's effect. So start from the sphere
    // less one step τ m α along x, with mobilities m that are not symmetric: y is alive there, and half of the change 2 τ Σ m α²
    // leads back to the sphere, where y dies.
    let mut random = Random(6);
    let sphere = Posed::at_rest(&icosphere(3), bernstein(3));
    let middle = |c: usize| f64::from(sphere.lattice.node(c)[1] == 1);
    let mobility: Vec<DVec3> = (0..27).map(|c| DVec3::new(random.within(0.2, 2.0), middle(c), 0.0)).collect();
    let alpha = sphere.gradient(&sphere.vertices);
    let norm: f64 = alpha.iter().zip(&mobility).map(|(a, m)| m.x * a.x * a.x).sum();
    let step = 0.2 * sphere.volume / norm;
    let back: Vec<DVec3> = alpha.iter().zip(&mobility).map(|(a, m)| DVec3::X * (-step * m.x * a.x)).collect();
    let vertices = displaced(&sphere.vertices, &sphere.binding.apply(&back));
    let posed = Posed { volume: sphere.solid.volume(&vertices), vertices, ..sphere };
    let alive: f64 = posed.gradient(&posed.vertices).iter().zip(&mobility).map(|(a, m)| m.y * a.y * a.y).sum();
    assert!(alive > 1e-10, "y is dead from the start: {alive:e}");

    let target = posed.volume + 2.0 * step * norm;
    let corrected = posed.corrected(target, axes([DVec3::X, DVec3::Y]), Some(&mobility));
    let expected: Vec<DVec3> = back.iter().map(|d| *d * -2.0).collect();
    assert_all_near(&corrected.displacement, &expected, 1e-12);
    // With z behind it, y's share goes to z.
    let with_z: Vec<DVec3> = mobility.iter().map(|m| m.with_z(1.0)).collect();
    let target = posed.volume + 3.0 * step * norm;
    let corrected = posed.corrected(target, Method::xyz(), Some(&with_z));
    for (found, expected) in corrected.displacement.iter().zip(&back) {
        assert!((found.x + expected.x).abs() <= 1e-12 && found.y == 0.0);
    }
    assert!(corrected.displacement.iter().any(|d| d.z.abs() > 1e-3));
}

// How corrections end

#[test]
fn a_volume_that_is_met_already_moves_nothing() {
    let posed = Posed::random(&mut Random(7));
    let pinned = vec![DVec3::ZERO; posed.binding.control_count()];
    for target in [posed.volume, posed.volume * (1.0 + 2.0 * f64::EPSILON)] {
        for mobility in [None, Some(&pinned[..])] {
            let corrected = posed.correct(target, Method::Gradient, mobility).unwrap();
            assert_eq!((corrected.status, corrected.steps), (Status::AlreadyMet, 0));
            assert_eq!(corrected.displacement, pinned);
            let bits = |points: &[DVec3]| points.iter().map(|p| p.to_array().map(f64::to_bits)).collect::<Vec<_>>();
            assert_eq!(bits(&corrected.vertices), bits(&posed.vertices));
            assert!(corrected.relative_error <= tolerances::VOLUME_ROUNDING);
        }
    }
}

#[test]
fn vertices_that_follow_no_control_keep_their_bits() {
    // The lower half of the cube is in the lattice; the upper half is kept, negative zeros and all.
    let cube = cube(4);
    let points = cube
        .points()
        .iter()
        .map(|p| *p - DVec3::new(0.0, 0.5, 0.0))
        .map(|p| if p.y == 0.0 { p.with_y(-0.0) } else { p });
    let cube = cube.with_points(points.collect()).unwrap();
    let frame = Frame { origin: DVec3::new(0.0, -0.5, 0.0), axes: [DVec3::X, DVec3::Y, DVec3::Z * 0.4] };
    let lattice = Lattice::new(bernstein(3), frame).unwrap();
    let binding = lattice.bind(cube.points(), Outside::Keep).unwrap();
    let posed = Posed::of(&cube, lattice, binding, cube.points().to_vec());
    for (method, target) in [(Method::Gradient, 1.1), (Method::xyz(), 1.1), (Method::Gradient, 1.0)] {
        let corrected = posed.correct(target, method, None).unwrap();
        let kept: Vec<usize> = (0..posed.vertices.len()).filter(|v| posed.binding.weights(*v).is_empty()).collect();
        assert!(kept.iter().any(|v| posed.vertices[*v].y.to_bits() == (-0.0f64).to_bits()));
        for v in kept {
            assert_eq!(
                corrected.vertices[v].to_array().map(f64::to_bits),
                posed.vertices[v].to_array().map(f64::to_bits)
            );
        }
    }
}

#[test]
fn thin_models_are_corrected_by_the_choice_of_roundings_or_refused() {
    // One rounding of a coordinate changes the volume of a plate by about ε over its thickness: far more than promised.
    let mut random = Random(8);
    for thickness in [1e-3, 1e-5, 1e-7] {
        let plate = plate(DVec3::new(1.0, 1.0, thickness), [9, 9]);
        let rotation = random.rotation();
        let turned = plate.with_points(plate.points().iter().map(|p| rotation * *p).collect()).unwrap();
        let posed = Posed::at_rest(&turned, bernstein(3));
        for method in [Method::Gradient, Method::xyz()] {
            posed.corrected(1.5 * posed.volume, method, None);
        }
    }
    // Eight vertices leave too few roundings to choose from.
    let thin = DVec3::new(1.0, 1.0, 1e-12);
    for _ in 0..5 {
        let rotation = random.rotation();
        let turned = cube(1).with_points(cube(1).points().iter().map(|p| rotation * (*p * thin)).collect()).unwrap();
        let posed = Posed::at_rest(&turned, bernstein(2));
        for method in [Method::Gradient, Method::xyz()] {
            match posed.correct(1.5 * posed.volume, method, None) {
                Err(CorrectError::Impossible { reason: Reason::Rounding { relative_error }, .. }) => {
                    assert!(relative_error > PROMISED && relative_error < f64::EPSILON / thin.z, "{relative_error:e}");
                }
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn only_coordinates_that_moved_are_rounded_otherwise() {
    // The upper half of a thin plate is outside the lattice and keeps its bits, however much its roundings would help.
    let plate = plate(DVec3::new(1.0, 1.0, 1e-6), [8, 8]);
    let rotation = Random(16).rotation();
    let turned = plate.with_points(plate.points().iter().map(|p| rotation * *p).collect()).unwrap();
    let edges = [DVec3::X, DVec3::Y * 0.5, DVec3::Z].map(|e| rotation * e);
    let frame = Frame { origin: rotation * (DVec3::Z * -0.5), axes: edges };
    let lattice = Lattice::new(bernstein(3), frame).unwrap();
    let binding = lattice.bind(turned.points(), Outside::Keep).unwrap();
    assert!(binding.kept_count() > 50 && binding.kept_count() < 100);
    let posed = Posed::of(&turned, lattice, binding, turned.points().to_vec());
    for method in [Method::Gradient, Method::xyz()] {
        let corrected = posed.corrected(1.2 * posed.volume, method, None);
        for v in (0..posed.vertices.len()).filter(|v| posed.binding.weights(*v).is_empty()) {
            assert_eq!(corrected.vertices[v], posed.vertices[v]);
        }
    }
}

// Errors

#[test]
fn a_lattice_with_every_coordinate_pinned_is_pinned() {
    let posed = Posed::random(&mut Random(9));
    let pinned = vec![DVec3::ZERO; posed.binding.control_count()];
    for method in [Method::Gradient, Method::xyz()] {
        assert_impossible(&posed.correct(1.1 * posed.volume, method, Some(&pinned)), &Reason::Pinned);
    }
}

#[test]
fn a_lattice_that_holds_no_vertex_binds_nothing() {
    let cube = cube(2);
    let frame = Frame { origin: DVec3::splat(5.0), axes: DVec3::AXES };
    let lattice = Lattice::new(bernstein(3), frame).unwrap();
    let binding = lattice.bind(cube.points(), Outside::Keep).unwrap();
    let posed = Posed::of(&cube, lattice, binding, cube.points().to_vec());
    for method in [Method::Gradient, Method::xyz()] {
        assert_impossible(&posed.correct(1.1, method, None), &Reason::NothingBound);
    }
}

#[test]
fn a_displacement_beyond_the_range_of_numbers_is_an_overflow() {
    let posed = Posed::at_rest(&cube(2), bernstein(2));
    for method in [axes([DVec3::X]), Method::xyz()] {
        assert_impossible(&posed.correct(1e308, method, None), &Reason::Overflow);
    }
}

#[test]
fn a_surface_torn_at_a_vertex_is_refused() {
    let soup: Vec<DVec3> = cube(1).faces().corners().iter().map(|v| cube(1).points()[*v as usize]).collect();
    let faces: Vec<[u32; 4]> = (0..6).map(|f| [4 * f, 4 * f + 1, 4 * f + 2, 4 * f + 3]).collect();
    let mut posed = Posed::at_rest(&Mesh::new(soup, faces.iter().collect()).unwrap(), bernstein(2));
    posed.corrected(1.5, Method::Gradient, None);
    let torn = (0..24).find(|v| posed.vertices[..*v].contains(&posed.vertices[*v])).unwrap();
    let twin = posed.vertices.iter().position(|p| *p == posed.vertices[torn]).unwrap();
    posed.vertices[torn].x += 1e-9;
    let Err(CorrectError::Torn { a, b }) = posed.correct(1.5, Method::Gradient, None) else { panic!("not torn") };
    assert_eq!([a.min(b), a.max(b)], [twin as u32, torn as u32]);
}

#[test]
fn mobilities_that_are_negative_or_not_finite_are_refused() {
    let posed = Posed::random(&mut Random(10));
    for bad in [-1.0, -1e-300, f64::NAN, f64::INFINITY] {
        for a in 0..3 {
            let mut mobility = vec![DVec3::ONE; posed.binding.control_count()];
            mobility[5][a] = bad;
            match posed.correct(1.1 * posed.volume, Method::Gradient, Some(&mobility)) {
                Err(CorrectError::Mobility { control: 5, value }) => assert_eq!(value[a].to_bits(), bad.to_bits()),
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn shares_that_are_no_shares_are_refused() {
    let posed = Posed::random(&mut Random(11));
    let refused = |shares: [f64; 2]| posed.correct(1.1 * posed.volume, shared([DVec3::X, DVec3::Y], shares), None);
    for bad in [[0.0, 0.0], [-1.0, 2.0], [f64::NAN, 1.0], [f64::INFINITY, 1.0], [f64::MAX, f64::MAX]] {
        assert!(matches!(refused(bad), Err(CorrectError::Shares { .. })), "{bad:?}");
    }
    assert!(refused([0.0, 1e-3]).is_ok());
}

#[test]
fn directions_without_direction_are_refused() {
    let posed = Posed::random(&mut Random(12));
    for bad in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
        match posed.correct(1.1 * posed.volume, axes([DVec3::X, bad]), None) {
            Err(CorrectError::Direction { index: 1, .. }) => {}
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(posed.correct(1.1 * posed.volume, axes([]), None), Err(CorrectError::NoDirection));
}

#[test]
fn targets_without_relative_error_are_refused() {
    let posed = Posed::random(&mut Random(13));
    for bad in [0.0, -0.0, f64::NAN, f64::INFINITY] {
        match posed.correct(bad, Method::Gradient, None) {
            Err(CorrectError::Target { target }) => assert_eq!(target.to_bits(), bad.to_bits()),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn vertices_that_are_not_finite_are_refused() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut posed = Posed::random(&mut Random(14));
        posed.vertices[3].y = bad;
        let refused = posed.correct(1.0, Method::Gradient, None);
        assert!(matches!(refused, Err(CorrectError::NotFinite { vertex: 3, .. })), "{refused:?}");
    }
}

#[test]
fn arrays_of_other_lengths_are_refused_by_name() {
    let posed = Posed::random(&mut Random(15));
    let (n, controls) = (posed.vertices.len(), posed.binding.control_count());
    let length = |result, name: &str, sizes: (usize, usize)| match result {
        Err(CorrectError::Length { what, found, expected }) => {
            assert!(what.contains(name), "{what}");
            assert_eq!((found, expected), sizes);
        }
        other => panic!("{other:?}"),
    };
    let options = CorrectOptions::default();
    let fewer = Pose { vertices: &posed.vertices[1..], ..posed.pose() };
    length(correct(&fewer, &Wanted::volume(1.0), &options), "posed vertices", (n - 1, n));
    let other = posed.lattice.bind(&posed.vertices[2..], Outside::Extend).unwrap();
    length(correct(&Pose { binding: &other, ..posed.pose() }, &Wanted::volume(1.0), &options), "binding", (n - 2, n));
    length(posed.correct(1.0, Method::Gradient, Some(&[DVec3::ONE; 3])), "mobility", (3, controls));
    let method = Method::Axes { directions: vec![DVec3::X; 3], shares: Some(vec![1.0; 2]) };
    length(posed.correct(1.0, method, None), "shares", (2, 3));
}
