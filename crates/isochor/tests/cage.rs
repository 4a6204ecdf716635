//! Cages: coordinates against another program, drag planes, corrections over cage vertices, jobs with `[cage]`.

mod numbers;

use glam::{DMat3, DVec3};
use isochor::{
    Cage, CageBinding, CageBindingError, CageOptions, Coordinates, CorrectOptions, DragPlane, Energy, Faces,
    LocalStress, Mesh, Method, OpenBoundaries, Outside, PointTarget, Pose, Solid, Wanted, correct, displaced, shapes,
    topology,
};
use numbers::{numbers, reference, vectors};
use proptest::prelude::*;

const ALL: [Coordinates; 3] = [Coordinates::MeanValue, Coordinates::Harmonic, Coordinates::Green];

/// A cage of 42 vertices round the unit ball.
fn round_cage() -> Cage {
    let sphere = shapes::icosphere(1);
    Cage::new(sphere.with_points(sphere.points().iter().map(|p| *p * 1.3).collect()).unwrap()).unwrap()
}

/// A unit cube as a cage, of quadrilaterals.
fn box_cage() -> Cage {
    Cage::new(shapes::cube(1)).unwrap()
}

struct Case {
    solid: Solid,
    points: Vec<DVec3>,
    cage: CageBinding,
    posed: Vec<DVec3>,
}

/// A ball in a bent cage.
fn ball(coordinates: Coordinates) -> Case {
    let mesh = shapes::icosphere(3);
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    let cage = round_cage();
    let bent = |v: &DVec3| DVec3::new(v.x * 1.2 + 0.3 * v.z * v.z, v.y - 0.2 * v.x, v.z * 0.7 + 0.1 * v.x * v.y);
    let posed = cage.vertices().iter().map(bent).collect();
    let cage = cage.bind(mesh.points(), &CageOptions { coordinates, ..CageOptions::default() }).unwrap();
    Case { solid, points: mesh.points().to_vec(), cage, posed }
}

impl Case {
    fn volume(&self, posed: &[DVec3]) -> f64 {
        self.solid.volume(&self.cage.deformed(&self.points, posed))
    }

    /// ∂V/∂C.
    fn gradient(&self, posed: &[DVec3]) -> Vec<DVec3> {
        let by_point = self.solid.volume_gradient(&self.cage.deformed(&self.points, posed));
        self.cage.gradient(posed, &by_point)
    }

    fn moved(&self, vertex: usize, by: DVec3) -> Vec<DVec3> {
        let mut posed = self.posed.clone();
        posed[vertex] += by;
        posed
    }
}

#[test]
fn mean_value_coordinates_are_those_of_another_program() {
    let file = reference("mvc_reference.json");
    let mut faces = Faces::new();
    for face in file["cage_faces"].as_array().unwrap() {
        faces.push(&numbers(face).iter().map(|v| *v as u32).collect::<Vec<_>>());
    }
    let cage = Cage::new(Mesh::new(vectors(&file["cage_vertices"]), faces).unwrap()).unwrap();
    let points = vectors(&file["points"]);
    let bound = cage.bind(&points, &CageOptions::default()).unwrap();
    for (found, expected) in bound.weights().chunks(92).zip(file["weights"].as_array().unwrap()) {
        assert!(found.iter().zip(numbers(expected)).all(|(a, b)| (a - b).abs() <= 1e-12));
    }
    let deformed = bound.deformed(&points, &vectors(&file["cage_deformed"]));
    assert!(deformed.iter().zip(vectors(&file["deformed_points"])).all(|(a, b)| a.distance(b) <= 1e-12));
    assert_eq!(bound.report().outside, 0);
}

/// CVB's tables 1 and 2, the rows of three dimensions: barycentric coordinates are for simplices, the others for any cage; those of Green alone
/// take normals, and give rotations of a cage's own with a uniform scale back exactly, as a conformal map must.
#[test]
fn what_the_papers_tables_say_of_three_dimensions_holds() {
    let point = [DVec3::new(0.3, 0.2, 0.4)];
    let simplex = Cage::new(
        Mesh::new(
            vec![DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0],
            vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].into(),
        )
        .unwrap(),
    )
    .unwrap();
    let tetrahedral = CageOptions { coordinates: Coordinates::Tetrahedral, ..CageOptions::default() };
    let expected = [0.55, 0.15, 0.1, 0.2];
    let weights = simplex.bind(&point, &tetrahedral).unwrap().weights();
    assert!(weights.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-15), "{weights:?}");
    let refused = box_cage().bind(&point, &tetrahedral).unwrap_err();
    assert_eq!(refused, CageBindingError::NoTetrahedron { vertices: 8, triangles: 12 });
    // In a simplex mean value and harmonic coordinates are the barycentric ones: both are unique there by linear precision.
    for coordinates in [Coordinates::MeanValue, Coordinates::Harmonic] {
        let bound = simplex.bind(&point, &CageOptions { coordinates, ..CageOptions::default() }).unwrap();
        assert!(bound.weights().iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-12), "{coordinates}");
    }
    for coordinates in ALL {
        for cage in [box_cage(), concave_cage()] {
            let bound = cage.bind(&point, &CageOptions { coordinates, ..CageOptions::default() }).unwrap();
            let report = bound.report();
            assert!(report.constant_precision <= 1e-12 && report.linear_precision <= 1e-12, "{report:?}");
            let columns =
                cage.vertices().len() + if coordinates == Coordinates::Green { cage.triangles().len() } else { 0 };
            assert_eq!(bound.binding().control_count(), columns);
            let turned = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1) * 1.7;
            let posed: Vec<DVec3> = cage.vertices().iter().map(|v| turned * *v + DVec3::Y).collect();
            let error = bound.deformed(&point, &posed)[0].distance(turned * point[0] + DVec3::Y);
            assert!(error <= 1e-12, "{coordinates}: {error}");
        }
    }
}

/// An L of unit cubes.
fn concave_cage() -> Cage {
    let outline = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)];
    let points = [0.0, 1.0].iter().flat_map(|z| outline.map(|(x, y)| DVec3::new(x, y, *z))).collect();
    let mut faces = Faces::new();
    (0..6).for_each(|i| faces.push(&[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6]));
    for [a, b, c, d] in [[0, 1, 2, 3], [0, 3, 4, 5]] {
        faces.push(&[d, c, b, a]);
        faces.push(&[a + 6, b + 6, c + 6, d + 6]);
    }
    Cage::new(Mesh::new(points, faces).unwrap()).unwrap()
}

#[test]
fn a_cage_at_rest_changes_no_bit() {
    for coordinates in ALL {
        let Case { points, cage, .. } = ball(coordinates);
        assert_eq!(cage.deformed(&points, cage.cage().vertices()), points, "{coordinates}");
    }
}

/// By the chain rule, against differences of fourth order.
#[test]
fn gradients_are_the_derivatives_of_the_volume() {
    for coordinates in ALL {
        let case = ball(coordinates);
        let gradient = case.gradient(&case.posed);
        for vertex in [0, 11, 30] {
            for axis in DVec3::AXES {
                let h = 1e-3;
                let at = |k: f64| case.volume(&case.moved(vertex, axis * (k * h)));
                let measured = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * h);
                let apart = (gradient[vertex].dot(axis) - measured).abs();
                assert!(apart <= 1e-9, "{coordinates} {vertex} {axis}: {apart:e}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// CVB, section 3.3: in its drag plane a vertex moves at constant volume, and its gradient stays; any other move changes the volume as predicted.
    #[test]
    fn drag_planes_predict_volumes(vertex in 0..42_usize, by in prop::array::uniform3(-2.0..2.0), harmonic: bool) {
        let case = ball(if harmonic { Coordinates::Harmonic } else { Coordinates::MeanValue });
        let by = DVec3::from_array(by);
        let gradients = case.gradient(&case.posed);
        let mut weights = vec![0.0; 42];
        weights[vertex] = 1.0;
        let plane = DragPlane::new(&case.posed, &weights, &gradients);
        prop_assert_eq!(plane.gradient, gradients[vertex]);
        let before = case.volume(&case.posed);
        let within = case.moved(vertex, plane.projected(by));
        prop_assert!((case.volume(&within) - before).abs() <= 1e-13 * before, "{:e}", case.volume(&within) - before);
        prop_assert!(case.gradient(&within)[vertex].distance(gradients[vertex]) <= 1e-13 * gradients[vertex].length());
        let anywhere = case.moved(vertex, by);
        let predicted = before + plane.change(by);
        prop_assert!((case.volume(&anywhere) - predicted).abs() <= 1e-13 * before.max(predicted.abs()));
        prop_assert!(case.gradient(&anywhere)[vertex].distance(gradients[vertex]) <= 1e-13 * gradients[vertex].length());
    }

    /// Several vertices along one direction, by different lengths; and together as one.
    #[test]
    fn several_vertices_along_one_direction_are_predicted(
        lengths in prop::collection::vec(-1.0..1.0, 42),
        direction in prop::array::uniform3(-1.0..1.0),
    ) {
        let case = ball(Coordinates::MeanValue);
        let direction = DVec3::from_array(direction);
        let gradients = case.gradient(&case.posed);
        let posed: Vec<DVec3> = case.posed.iter().zip(&lengths).map(|(c, l)| *c + direction * *l).collect();
        let before = case.volume(&case.posed);
        let predicted = before + DragPlane::change_along(&gradients, direction, &lengths);
        let scale = before.max(predicted.abs());
        prop_assert!((case.volume(&posed) - predicted).abs() <= 1e-13 * scale, "{:e}", case.volume(&posed) - predicted);
        let plane = DragPlane::new(&case.posed, &lengths, &gradients);
        let by = plane.projected(direction);
        let slid: Vec<DVec3> = case.posed.iter().zip(&lengths).map(|(c, l)| *c + by * *l).collect();
        prop_assert!((case.volume(&slid) - before).abs() <= 1e-13 * before);
    }
}

/// All methods of the correction, with points, axes and energies, over the vertices of a cage.
#[test]
fn every_method_corrects_over_the_vertices_of_a_cage() {
    for coordinates in [Coordinates::MeanValue, Coordinates::Harmonic] {
        let case = ball(coordinates);
        let vertices = case.cage.deformed(&case.points, &case.posed);
        let binding = case.cage.binding();
        let pose = Pose { solid: &case.solid, vertices: &vertices, binding };
        let target = case.solid.volume(&case.points);
        let point = PointTarget { weights: binding.weights(17), position: vertices[17], target: vertices[17] + 0.05 };
        let axes = |directions: Vec<DVec3>| Method::Axes { directions, shares: None };
        let methods = [Method::Nearest, Method::Gradient, axes(DVec3::AXES.to_vec()), axes(vec![DVec3::Y])];
        for method in methods {
            for energy in
                [None, Some(Energy::of_cage(case.cage.cage()).unwrap()), Some(Energy::surface(binding).unwrap())]
            {
                for points in [vec![], vec![point.clone()]] {
                    if matches!(&method, Method::Axes { directions, .. } if directions.len() == 1 && !points.is_empty())
                    {
                        continue; // the point is to move across the axis
                    }
                    let wanted = Wanted { points, ..Wanted::volume(target) };
                    let options = CorrectOptions { method: method.clone(), energy: energy.clone(), mobility: None };
                    let corrected = correct(&pose, &wanted, &options).unwrap();
                    assert!(
                        corrected.relative_error <= 1e-13,
                        "{coordinates} {method:?}: {}",
                        corrected.relative_error
                    );
                    let posed = displaced(&case.posed, &corrected.displacement);
                    assert!((case.volume(&posed) - target).abs() <= 1e-12 * target, "the cage alone gives the model");
                    let at = corrected.vertices[17];
                    assert!(wanted.points.iter().all(|point| at.distance(point.target) <= 1e-12));
                }
            }
        }
    }
}

/// Green's vertices are no affine function of the cage, but what they make is a pose like any other: X + W δ with mean value weights.
#[test]
fn any_binding_finishes_a_green_pose() {
    let green = ball(Coordinates::Green);
    let vertices = green.cage.deformed(&green.points, &green.posed);
    let other = ball(Coordinates::MeanValue);
    let pose = Pose { solid: &green.solid, vertices: &vertices, binding: other.cage.binding() };
    let target = green.solid.volume(&green.points);
    for directions in [vec![DVec3::X], vec![DVec3::Z, DVec3::Y]] {
        let options = CorrectOptions { method: Method::Axes { directions, shares: None }, ..CorrectOptions::default() };
        let corrected = correct(&pose, &Wanted::volume(target), &options).unwrap();
        assert!(corrected.relative_error <= 1e-13);
    }
}

#[test]
fn vertices_outside_are_kept_carried_or_refused() {
    let points = [DVec3::splat(0.5), DVec3::new(0.5, 0.5, 1.25), DVec3::new(1.5, 0.5, 0.5)];
    for coordinates in ALL {
        let bind = |outside| box_cage().bind(&points, &CageOptions { coordinates, outside, harmonic: None });
        let posed: Vec<DVec3> = box_cage().vertices().iter().map(|v| *v * 2.0).collect();
        let extended = bind(Outside::Extend).unwrap();
        assert_eq!((extended.report().outside, extended.report().farthest), (2, 0.5), "{coordinates}");
        assert!(extended.report().linear_precision <= 1e-13);
        for (from, to) in points.iter().zip(extended.deformed(&points, &posed)) {
            assert!(to.distance(2.0 * from) <= 1e-12, "{coordinates}: {to}");
        }
        let kept = bind(Outside::Keep).unwrap();
        assert_eq!(kept.deformed(&points, &posed)[1..], points[1..]);
        assert_eq!(kept.binding().kept_count(), 2);
        assert!(kept.report().linear_precision <= 1e-13);
        assert_eq!(kept.jacobians(&points, &posed).unwrap()[1], DMat3::IDENTITY);
        let refused = bind(Outside::Refuse).unwrap_err();
        assert_eq!(refused, CageBindingError::Outside { count: 2, vertex: 2, distance: 0.5 });
    }
}

#[test]
fn weights_are_taken_again() {
    for coordinates in ALL {
        let case = ball(coordinates);
        let options = CageOptions { coordinates, ..CageOptions::default() };
        let cage = case.cage.cage();
        let again = CageBinding::of_weights(cage, &case.points, &options, &case.cage.weights()).unwrap();
        assert_eq!(again.deformed(&case.points, &case.posed), case.cage.deformed(&case.points, &case.posed));
        let some = &case.points[..9];
        assert_eq!(again.jacobians(some, &case.posed).unwrap(), case.cage.jacobians(some, &case.posed).unwrap());
        let fewer = CageBinding::of_weights(cage, &case.points, &options, &case.cage.weights()[1..]).unwrap_err();
        assert!(matches!(fewer, CageBindingError::Weights { .. }), "{fewer}");
    }
}

#[cfg(feature = "serde")]
mod jobs {
    use super::*;
    use isochor::{CageInput, Job, JobError, JobInput, Outcome, Source};

    /// A ball of radius 1, far away, with a cage.
    fn run(toml: &str, posed: bool) -> Result<Outcome, JobError> {
        let far = DVec3::new(1e6, -2e6, 0.0);
        let moved = |mesh: &Mesh| mesh.with_points(mesh.points().iter().map(|p| *p + far).collect()).unwrap();
        let mesh = moved(&shapes::icosphere(2));
        let cage = moved(round_cage().mesh());
        let bent = |v: &DVec3| {
            let v = *v - far;
            far + DVec3::new(v.x * 1.2 + 0.3 * v.z * v.z, v.y, v.z * 0.7)
        };
        let posed = posed.then(|| cage.points().iter().map(bent).collect());
        of_cage(&mesh, &CageInput { mesh: cage, posed, weights: None }, toml)
    }

    fn of_mesh(mesh: &Mesh, cage: &Mesh, toml: &str) -> Result<Outcome, JobError> {
        of_cage(mesh, &CageInput { mesh: cage.clone(), posed: None, weights: None }, toml)
    }

    fn of_cage(mesh: &Mesh, cage: &CageInput, toml: &str) -> Result<Outcome, JobError> {
        let cage = toml.contains("cage =").then_some(cage);
        let input = JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage };
        Job::from_toml(toml).unwrap().run(&input, &mut |_| {})
    }

    /// With corners at 0 and at x, y, z.
    fn tetrahedron() -> Mesh {
        let mut faces = Faces::new();
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].iter().for_each(|face| faces.push(face));
        Mesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z], faces).unwrap()
    }

    fn relative_error(outcome: &Outcome) -> f64 {
        outcome.report.volume.as_ref().unwrap().overall.relative_error.unwrap()
    }

    /// Barycentric coordinates of (t, t, t) are 1 − 3t, t, t, t.
    #[test]
    fn models_far_outside_a_cage_are_warned_of() {
        let cage = CageInput { mesh: tetrahedron(), posed: None, weights: None };
        let toml = "cage = { file = 'cage.obj', coordinates = 'tetrahedral' }\nedit = [{ stretch = { axis = 'z', scale = 0.9 } }]";
        for (t, is_said) in [(0.25, false), (3.0, false), (4.0, true)] {
            let shrunk = |p: &DVec3| if *p == DVec3::ZERO { DVec3::splat(t) } else { *p * 0.2 };
            let model = tetrahedron();
            let model = model.with_points(model.points().iter().map(shrunk).collect()).unwrap();
            let outcome = of_cage(&model, &cage, toml).unwrap();
            let report = &outcome.report.cage.as_ref().unwrap().binding;
            let expected = if t < 1.0 { 1.0 } else { 6.0 * t - 1.0 };
            assert!((report.lebesgue_constant - expected).abs() <= 1e-13, "{}", report.lebesgue_constant);
            assert!(t < 1.0 || report.lebesgue_vertex == 0);
            let of_size = |text: &&String| text.contains("Vertex 0 can go 23 times as far");
            assert_eq!(
                outcome.report.warnings.iter().any(|text| of_size(&text)),
                is_said,
                "{:?}",
                outcome.report.warnings
            );
        }
    }

    #[test]
    fn posed_cages_deform_at_constant_volume() {
        for coordinates in ["mean-value", "harmonic", "green"] {
            for method in ["nearest", "gradient"] {
                let toml = format!(
                    "cage = {{ file = 'cage.obj', posed = 'p.obj', coordinates = '{coordinates}' }}\npreserve = {{ method = '{method}' }}"
                );
                let outcome = run(&toml, true).unwrap();
                assert!(relative_error(&outcome) <= 1e-13, "{coordinates} {method}");
                let cage = outcome.report.cage.as_ref().unwrap();
                assert_eq!((cage.binding.coordinates.as_str(), cage.binding.outside), (coordinates, 0));
                // The cage that is saved, with the same coordinates, gives the points.
                let saved = outcome.cage.as_ref().unwrap();
                let bound = outcome.cage_binding().unwrap();
                let origin = saved.mesh.points()[0] - bound.cage().vertices()[0];
                let near: Vec<DVec3> = saved.posed.iter().map(|p| *p - origin).collect();
                let rest: Vec<DVec3> =
                    shapes::icosphere(2).points().iter().map(|p| *p + DVec3::new(1e6, -2e6, 0.0) - origin).collect();
                for (p, q) in bound.deformed(&rest, &near).iter().zip(&outcome.points) {
                    assert!((*p + origin).distance(*q) <= 1e-8, "{coordinates} {method}: {p} {q}");
                }
            }
        }
    }

    #[test]
    fn points_and_several_axes_hold_with_cages() {
        let to = shapes::icosphere(2).points()[3] * DVec3::new(1.1, 1.2, 0.7) + DVec3::new(1e6, -2e6, 0.0);
        for coordinates in ["mean-value", "green"] {
            let toml = format!(
                "cage = {{ file = 'c', coordinates = '{coordinates}' }}\n[[edit]]\nstretch = {{ axis = 'z', scale = 0.6 }}\n\
                 [preserve]\npoints = [{{ vertex = 3, to = [{:?}, {:?}, {:?}] }}]",
                to.x, to.y, to.z
            );
            let outcome = run(&toml, false).unwrap();
            assert!(relative_error(&outcome) <= 1e-13);
            assert!(outcome.points[3].distance(to) <= 1e-9, "{coordinates}: {}", outcome.points[3]);
        }
        // A place that no cage with these coordinates comes near is not come to.
        let far = "cage = { file = 'c', coordinates = 'green' }\n[preserve]\npoints = [{ vertex = 3, to = [1000090, -1999990, 70] }]";
        assert!(run(far, false).is_err_and(|error| error.is_unreachable()));
        let outcome = run(
            "cage = { file = 'c' }\n[[edit]]\nstretch = { axis = 'z', scale = 0.6 }\n[preserve]\naxes = 'xy'",
            false,
        );
        assert!(relative_error(&outcome.unwrap()) <= 1e-13);
    }

    /// Completion by least motion: the free vertices restore the volume, the others stay.
    #[test]
    fn free_vertices_restore_the_volume() {
        let toml = "cage = { file = 'c', free = { vertices = [0, 1, 2, 3] } }\n[[edit]]\nmove = { nodes = { vertices = [7] }, by = [0.5, 0.2, 0.1] }";
        let outcome = run(toml, false).unwrap();
        assert!(relative_error(&outcome) <= 1e-13);
        let cage = outcome.cage.as_ref().unwrap();
        for (v, (rest, posed)) in cage.mesh.points().iter().zip(&cage.posed).enumerate() {
            assert_eq!(rest != posed, [0, 1, 2, 3, 7].contains(&v), "{v}");
        }
        let refused = run(
            "cage = { file = 'c', free = { vertices = [42] } }\n[[edit]]\nstretch = { axis = 'z', scale = 0.6 }",
            false,
        );
        assert_eq!(refused.unwrap_err().to_string(), "cage.free: vertex 42 is beyond the cage: it has 42, 0 to 41");
    }

    #[test]
    fn slides_keep_the_volume_without_a_correction() {
        let toml = "cage = { file = 'c', planes = { vertices = [5, 9] } }\n[[edit]]\nslide = { nodes = { vertices = [5] }, by = [0.9, -0.3, 0.4] }\n\
                    [[edit]]\nslide = { nodes = { vertices = [9, 12] }, by = [0.1, 0.5, -0.2], unit = 'extent' }\n[preserve]\nvolume = 'free'";
        let outcome = run(toml, false).unwrap();
        let volume = outcome.report.volume.as_ref().unwrap().overall;
        assert!((volume.posed - volume.rest).abs() <= 1e-13 * volume.rest, "{:e}", volume.posed - volume.rest);
        let planes = &outcome.report.cage.as_ref().unwrap().planes;
        assert_eq!(planes.iter().map(|row| row.vertex).collect::<Vec<_>>(), [5, 9]);
        assert_eq!(planes[0].plane.origin, outcome.cage.as_ref().unwrap().posed[5]);
    }

    /// An affine map has one stress everywhere: stretches of 3, 2 and 1 turn vectors by up to 30°. Green coordinates reproduce similarities alone.
    #[test]
    fn local_stress_is_reported() {
        for (coordinates, by, degrees) in [
            ("mean-value", [3.0, 2.0, 1.0], 30.0),
            ("harmonic", [3.0, 2.0, 1.0], 30.0),
            ("green", [2.0; 3], 0.0),
            ("mean-value", [1.0, 1.0, -1.0], 180.0),
        ] {
            let toml = format!(
                "cage = {{ file = 'c', coordinates = '{coordinates}', stress = true }}\n[[edit]]\nscale = {{ by = {by:?} }}\n[preserve]\nvolume = 'free'"
            );
            let outcome = run(&toml, false).unwrap();
            let stress = outcome.report.cage.as_ref().unwrap().stress.as_ref().unwrap();
            assert_eq!(stress.points, 162);
            assert!((stress.mean_degrees - degrees).abs() <= 1e-5, "{coordinates}: {stress:?}");
            assert!((stress.largest_degrees - degrees).abs() <= 1e-5, "{coordinates}: {stress:?}");
            assert_eq!(stress.inverted, if degrees == 180.0 { 162 } else { 0 });
        }
    }

    #[test]
    fn what_cages_cannot_do_says_why() {
        let said = |toml: &str| run(toml, true).unwrap_err().to_string();
        let with = |keys: &str, rest: &str| format!("cage = {{ file = 'c'{keys} }}\n{rest}");
        assert!(said("cage = { }").contains("cage.file is missing"));
        assert!(said(&with("", "lattice = { size = 4 }")).contains("there is at most one of them"));
        assert!(
            said(&with("", "preserve = { method = 'elastic' }"))
                .contains("springs lie between the points of a lattice")
        );
        assert!(said(&with("", "preserve = { mobility = 'auto' }")).contains("name the vertices of the cage"));
        assert!(said(&with("", "preserve = { objective = 'bending' }")).contains("lines of a lattice"));
        assert!(said(&with("", "preserve = { pin = { k = 0 } }")).contains("vertices of a cage"));
        assert!(said(&with(", coordinates = 'tetrahedral'", "")).contains("need a cage of 4 vertices"));
        let green = ", coordinates = 'green'";
        assert!(said(&with(green, "preserve = { axes = 'x' }")).contains("preserve.axes go with closed forms"));
        assert!(said(&with(", coordinates = 'green', planes = 'all'", "")).contains("no affine function"));
        let slide = "[[edit]]\nslide = { nodes = 'all', by = [1, 0, 0] }";
        assert!(said(&with(green, slide)).contains("there is no volume that could be kept"));
        let impossible = run(&with("", "preserve = { pin = 'all' }"), true).unwrap_err();
        assert!(impossible.is_unreachable(), "{impossible}");
        let impossible = run(&with(green, "preserve = { pin = 'all' }"), true).unwrap_err();
        assert!(
            impossible.is_unreachable() && impossible.to_string().contains("every control is pinned"),
            "{impossible}"
        );
    }

    #[test]
    fn several_volumes_and_boundaries_hold_with_green_coordinates() {
        let mesh = shapes::chain(2, 24, 12);
        let bounds = mesh.bounds().unwrap();
        let cage = shapes::cube(1);
        let size = bounds.size() + 0.2;
        let around: Vec<DVec3> = cage.points().iter().map(|p| bounds.min - 0.1 + *p * size).collect();
        let cage = cage.with_points(around).unwrap();
        for method in ["nearest", "gradient"] {
            let toml = format!(
                "cage = {{ file = 'c', coordinates = 'green' }}\n[[edit]]\ntwist = {{ axis = 'x', degrees = 30 }}\n\
                 [preserve]\nmethod = '{method}'\nvolume = {{ each = '100%' }}"
            );
            let cage = CageInput { mesh: cage.clone(), posed: None, weights: None };
            let input =
                JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: Some(&cage) };
            let outcome = Job::from_toml(&toml).unwrap().run(&input, &mut |_| {}).unwrap();
            let report = outcome.report.volume.as_ref().unwrap();
            for row in &report.components {
                assert!((row.corrected - row.rest).abs() <= 1e-13 * row.rest, "{method}: {row:?}");
            }
        }
    }

    /// What is asked for twice, or follows from other wishes, is met with Green coordinates as with others, and what contradicts is named.
    #[test]
    fn wishes_that_depend_on_others_are_met_or_named() {
        let far = "[999999.1, -1999999.9, 0.4]";
        for coordinates in ["mean-value", "green"] {
            for method in ["nearest", "gradient"] {
                let job = |preserve: &str| {
                    run(
                        &format!(
                            "cage = {{ file = 'c', posed = 'p', coordinates = '{coordinates}' }}\n[preserve]\nmethod = '{method}'\n{preserve}"
                        ),
                        true,
                    )
                };
                let point = format!("{{ vertex = 5, to = {far} }}");
                let other = "{ vertex = 5, to = [999999.1, -1999999.9, 0.5] }";
                let outcome = job(&format!("points = [{point}, {point}]"));
                let outcome = outcome.unwrap_or_else(|error| panic!("{coordinates}, {method}: {error}"));
                assert!(relative_error(&outcome) <= 1e-13 && outcome.report.correction.point_error <= 1e-12);
                let error = job(&format!("points = [{point}, {other}]")).unwrap_err();
                assert!(error.is_unreachable(), "{coordinates}: {error}");
                assert!(error.to_string().contains("given the other points"), "{coordinates}: {error}");
                let outcome = job(
                    "volume = { parts = [{ components = [0], volume = '100%' }, { components = [0], volume = '100%' }] }",
                );
                assert!(outcome.is_ok_and(|outcome| relative_error(&outcome) <= 1e-13), "{coordinates}");
                let error = job("points = [{ vertex = 5, to = [nan, 0, 0] }]").unwrap_err();
                assert!(error.to_string().contains("finite"), "{coordinates}: {error}");
            }
        }
    }

    /// A point that only vertices could move that are pinned.
    #[test]
    fn points_that_nothing_moves_are_named() {
        for coordinates in ["mean-value", "green"] {
            let toml = format!(
                "cage = {{ file = 'c', coordinates = '{coordinates}', free = {{ vertices = [3] }} }}\npreserve = {{ pin = {{ vertices = [3] }}, points = [{{ vertex = 5, to = [1000000, -2000000, 1] }}] }}"
            );
            let error = run(&toml, false).unwrap_err();
            assert!(error.is_unreachable() && error.to_string().contains("pinned"), "{coordinates}: {error}");
        }
    }

    /// A tetrahedron whose first edge from corner 0 was stretched by a: the two other corners restore the volume. Every map has a singular value ≥ a (≤ a where a < 1),
    /// and the product of all three is 1, so no stress is less than that of a, a^(−1/2), a^(−1/2).
    #[test]
    fn the_least_stress_of_a_tetrahedron_is_that_of_the_theorem() {
        for (a, witnesses) in [(1.6_f64, "8"), (0.55, "[[0.1, 0.2, 0.3]]"), (1.0, "8")] {
            let mesh = tetrahedron();
            let toml = format!(
                "cage = {{ file = 'c', coordinates = 'tetrahedral', free = {{ vertices = [2, 3] }}, witnesses = {witnesses} }}\n[preserve]\nobjective = 'stress'\n\
                 [[edit]]\nmove = {{ nodes = {{ vertices = [1] }}, by = [{}, 0, 0] }}\n[[edit]]\nmove = {{ nodes = {{ vertices = [2] }}, by = [0.3, 0.4, -0.2] }}",
                a - 1.0
            );
            let outcome = of_mesh(&mesh, &mesh, &toml).unwrap();
            assert!(relative_error(&outcome) <= 1e-13);
            let least = outcome.report.cage.as_ref().unwrap().least_stress.clone().unwrap();
            let ratio = a.max(1.0 / a).powf(1.5);
            let sine: f64 = (ratio - 1.0) / (ratio + 1.0);
            assert!((least.mean_squared_sine[1] - sine.powi(2)).abs() <= 1e-7, "{a}: {least:?}");
            assert!((least.least_stress.mean_degrees - sine.asin().to_degrees()).abs() <= 1e-2, "{a}: {least:?}");
            assert!(least.mean_squared_sine[1] < least.mean_squared_sine[0], "{a}: {least:?}");
            assert!(least.is_settled && least.free == 2, "{a}: {least:?}");
            let cage = outcome.cage.as_ref().unwrap();
            assert_eq!(cage.posed[0], DVec3::ZERO);
            assert_eq!(cage.posed[1], DVec3::new(1.0 + (a - 1.0), 0.0, 0.0));
        }
    }

    /// Of all poses of the free vertices with the volume none nearby has less stress: its derivative along moves that keep the volume is 0.
    #[test]
    fn no_pose_nearby_has_less_stress() {
        let far = DVec3::new(1e6, -2e6, 0.0);
        let free = [0, 1, 4, 12];
        let places: Vec<DVec3> = shapes::icosphere(1).points().iter().map(|p| *p * 0.7).collect();
        let witnesses: Vec<[f64; 3]> = places.iter().map(|p| (*p + far).to_array()).collect();
        for coordinates in ["mean-value", "harmonic", "green"] {
            let job = |objective: &str, more: &str| {
                let toml = format!(
                    "cage = {{ file = 'c', coordinates = '{coordinates}', witnesses = {witnesses:?}, free = {{ vertices = [0, 1, 4, 12] }} }}\n[preserve]\nobjective = '{objective}'\n{more}\n\
                     [[edit]]\nmove = {{ nodes = {{ vertices = [7, 9] }}, by = [0.5, 0.2, 0.1] }}"
                );
                run(&toml, false).unwrap()
            };
            let point = "points = [{ vertex = 0, to = [1000000.02, -2000000.55, -0.88] }]";
            for more in ["", point] {
                let outcome = job("stress", more);
                assert!(relative_error(&outcome) <= 1e-13 && outcome.report.correction.point_error <= 1e-12);
                let least = outcome.report.cage.as_ref().unwrap().least_stress.clone().unwrap();
                assert!(least.is_settled, "{coordinates}: {least:?}");
                assert!(least.mean_squared_sine[1] < least.mean_squared_sine[0], "{coordinates}: {least:?}");
                assert_eq!((least.free, least.witnesses), (4, 42));
            }
            let outcome = job("stress", "");
            let cage = outcome.cage_binding().unwrap();
            let posed: Vec<DVec3> = outcome.cage.as_ref().unwrap().posed.iter().map(|p| *p - far).collect();
            let mesh = shapes::icosphere(2);
            let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
            let vertices: Vec<DVec3> = outcome.points.iter().map(|p| *p - far).collect();
            let mut by_volume = cage.gradient(&posed, &solid.volume_gradient(&vertices));
            (0..42).filter(|v| !free.contains(v)).for_each(|held| by_volume[held] = DVec3::ZERO);
            let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
            let cost = |by: &[DVec3], step: f64| {
                let moved: Vec<DVec3> = posed.iter().zip(by).map(|(p, d)| *p + *d * step).collect();
                let jacobians = cage.jacobians(&places, &moved).unwrap();
                jacobians.iter().map(|j| LocalStress::of(j).sine().powi(2)).sum::<f64>() / places.len() as f64
            };
            let slope = |by: &[DVec3]| (cost(by, 1e-4) - cost(by, -1e-4)) / 2e-4;
            for seed in 1..8_u32 {
                let x = |k: usize| f64::from((seed * 7919 + k as u32 * 104_729) % 2001) / 1000.0 - 1.0;
                let mut by: Vec<DVec3> = (0..42).map(|v| DVec3::new(x(3 * v), x(3 * v + 1), x(3 * v + 2))).collect();
                (0..42).filter(|v| !free.contains(v)).for_each(|held| by[held] = DVec3::ZERO);
                let part = dot(&by, &by_volume) / dot(&by_volume, &by_volume);
                let along: Vec<DVec3> = by.iter().zip(&by_volume).map(|(d, g)| *d - *g * part).collect();
                assert!(slope(&along).abs() <= 2e-6, "{coordinates}: {}", slope(&along));
            }
            let length = dot(&by_volume, &by_volume).sqrt();
            by_volume.iter_mut().for_each(|g| *g /= length);
            assert!(slope(&by_volume).abs() > 5e-5, "{coordinates}: the volume matters: {}", slope(&by_volume));
        }
    }

    #[test]
    fn what_least_stress_cannot_do_says_why() {
        let said = |keys: &str, preserve: &str| {
            let toml =
                format!("cage = {{ file = 'c', free = 'all'{keys} }}\n[preserve]\nobjective = 'stress'\n{preserve}");
            run(&toml, true).unwrap_err().to_string()
        };
        assert!(said(", witnesses = 0", "").contains("cage.witnesses is 0"));
        assert!(said(", witnesses = 1000000", "").contains("at most 100000"));
        assert!(said(", witnesses = []", "").contains("name at least one point"));
        assert!(said(", witnesses = [[1000000, -2000000, 1.31]]", "").contains("outside the cage"));
        assert!(said(", witnesses = [[nan, 0, 0]]", "").contains("must be finite"));
        for wrong in ["'many'", "-3", "[[0, 0]]"] {
            let toml = format!("cage = {{ file = 'c', witnesses = {wrong} }}");
            assert!(Job::from_toml(&toml).unwrap_err().to_string().contains("or a list of places"), "{wrong}");
        }
        assert!(said("", "axes = 'x'\nmethod = 'axes'").contains("preserve.axes go with closed forms"));
        assert!(said("", "method = 'gradient'").contains("must be \"nearest\""));
        assert!(said("", "preview = 100").contains("preserve.preview cannot be with the objective"));
        let all_moved = "cage = { file = 'c' }\n[preserve]\nobjective = 'stress'\n[[edit]]\nscale = { by = [1.2, 1, 1.1], center = [1e6, -2e6, 7] }";
        let all_held = run(all_moved, false).unwrap_err();
        assert!(all_held.is_unreachable() && all_held.to_string().contains("every control is pinned"), "{all_held}");
        let lattice = run("lattice = { size = 3 }\n[preserve]\nobjective = 'stress'", false).unwrap_err();
        assert!(lattice.to_string().contains("measured at points in a cage"), "{lattice}");
    }

    /// The smallest displacement of a Green cage: none of many others of the same volume is smaller, and Lagrange's condition holds.
    #[test]
    fn green_corrections_are_the_smallest() {
        let outcome = run("cage = { file = 'c', posed = 'p', coordinates = 'green' }", true).unwrap();
        assert!(outcome.report.correction.residual.unwrap() <= 1e-10);
        let along =
            run("cage = { file = 'c', posed = 'p', coordinates = 'green' }\npreserve = { method = 'gradient' }", true)
                .unwrap();
        let length = |outcome: &Outcome| {
            let cage = outcome.cage.as_ref().unwrap();
            let far = DVec3::new(1e6, -2e6, 0.0);
            let bent = |v: &DVec3| {
                let v = *v - far;
                far + DVec3::new(v.x * 1.2 + 0.3 * v.z * v.z, v.y, v.z * 0.7)
            };
            cage.mesh.points().iter().zip(&cage.posed).map(|(r, p)| p.distance_squared(bent(r))).sum::<f64>()
        };
        assert!(length(&outcome) < length(&along), "{} {}", length(&outcome), length(&along));
    }
}
