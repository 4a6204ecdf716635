//! Corrections on fewer triangles: approximate volumes that are measured truly, exact points and pins.

use glam::{DMat3, DVec3};
use isochor::shapes::{hollow_sphere, icosphere, uv_torus};
use isochor::{
    Basis, Binding, CorrectError, CorrectOptions, Faces, Frame, Lattice, Mesh, Method, OpenBoundaries, Outside,
    PointTarget, Pose, Preview, Reason, Solid, Status, Wanted, correct, displaced, topology,
};

struct Case {
    solid: Solid,
    binding: Binding,
    rest: Vec<DVec3>,
    posed: Vec<DVec3>,
}

impl Case {
    /// A mesh in a lattice, bulged and twisted.
    fn new(mesh: &Mesh) -> Self {
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
        let frame = Frame::fitted(mesh.bounds().unwrap(), 0.1).unwrap();
        let lattice = Lattice::new([0; 3].map(|_| Basis::clamped(5, 3).unwrap()), frame).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let turned = |c: &DVec3| DMat3::from_rotation_z(c.z) * *c * DVec3::new(1.0, 0.7 + 0.2 * c.x, 0.9) - *c;
        let displacement: Vec<DVec3> = lattice.rest().iter().map(turned).collect();
        let posed = displaced(mesh.points(), &binding.apply(&displacement));
        Self { solid, binding, rest: mesh.points().to_vec(), posed }
    }

    fn pose(&self) -> Pose<'_> {
        Pose { solid: &self.solid, vertices: &self.posed, binding: &self.binding }
    }

    fn rest_pose(&self) -> Pose<'_> {
        Pose { vertices: &self.rest, ..self.pose() }
    }
}

fn cases() -> Vec<Case> {
    let sphere = icosphere(4);
    let upper = sphere.faces().iter().filter(|face| face.iter().all(|v| sphere.points()[*v as usize].z > -0.4));
    let open = Mesh::new(sphere.points().to_vec(), upper.collect::<Faces>()).unwrap();
    [sphere, hollow_sphere(4, 0.5), uv_torus(1.0, 0.4, 60, 30), open].iter().map(Case::new).collect()
}

fn methods() -> [CorrectOptions; 3] {
    [Method::Nearest, Method::Gradient, Method::xyz()]
        .map(|method| CorrectOptions { method, ..CorrectOptions::default() })
}

#[test]
fn the_volume_is_near_and_its_error_is_the_true_one() {
    for case in cases() {
        let (pose, posed) = (case.pose(), case.solid.volume(&case.posed));
        for share in [4, 10, 20] {
            let preview = Preview::new(&pose, case.solid.triangle_count() / share).unwrap();
            assert!(preview.triangle_count() < case.solid.triangle_count());
            let coarse = case.solid.coarse(&case.posed, case.solid.triangle_count() / share).volume(&case.posed);
            for (target, options) in methods().iter().flat_map(|o| [(0.8 * posed, o), (1.3 * posed, o)]) {
                let corrected = preview.correct(&pose, &Wanted::volume(target), options).unwrap();
                assert_eq!(corrected.status, Status::Preview);
                assert_eq!(corrected.vertices, displaced(&case.posed, &case.binding.apply(&corrected.displacement)));
                let volumes = case.solid.volumes(&corrected.vertices);
                assert_eq!((corrected.volume, &corrected.component_volumes), (volumes.total, &volumes.components));
                assert_eq!(corrected.volume_before, posed);
                assert_eq!(corrected.relative_error, ((volumes.total - target) / target).abs());
                // What the correction changes in the layer between the surfaces.
                let layer = (coarse / posed - 1.0).abs();
                let limit = 2.0 * layer * (target / posed - 1.0).abs();
                assert!(corrected.relative_error <= limit, "{:e} {limit:e}", corrected.relative_error);
                assert!(corrected.relative_error > 1e-13, "no test of an approximation");
            }
        }
    }
}

#[test]
fn with_all_triangles_it_is_the_correction_itself() {
    for case in cases() {
        let pose = case.pose();
        let target = 1.2 * case.solid.volume(&case.posed);
        let preview = Preview::new(&pose, case.solid.triangle_count()).unwrap();
        for options in methods() {
            let exact = correct(&pose, &Wanted::volume(target), &options).unwrap();
            let corrected = preview.correct(&pose, &Wanted::volume(target), &options).unwrap();
            assert!(corrected.relative_error <= 1e-13);
            let apart = exact.displacement.iter().zip(&corrected.displacement).map(|(a, b)| a.distance(*b));
            assert!(apart.fold(0.0, f64::max) <= 1e-10);
        }
    }
}

#[test]
fn a_preview_made_at_rest_serves_other_poses() {
    for case in cases() {
        let preview = Preview::new(&case.rest_pose(), case.solid.triangle_count() / 10).unwrap();
        let target = case.solid.volume(&case.rest);
        let corrected = preview.correct(&case.pose(), &Wanted::volume(target), &CorrectOptions::default()).unwrap();
        assert_eq!(corrected.status, Status::Preview);
        assert!(corrected.relative_error < 0.02, "{}", corrected.relative_error);
    }
}

#[test]
fn points_and_pins_hold_exactly() {
    for case in cases() {
        let pose = case.pose();
        let preview = Preview::new(&pose, case.solid.triangle_count() / 8).unwrap();
        let vertex = (0..case.posed.len()).rev().find(|v| !case.binding.weights(*v).is_empty()).unwrap();
        let to = case.posed[vertex] + DVec3::new(0.02, -0.01, 0.03);
        let weights = case.binding.weights(vertex);
        let point = PointTarget { weights: weights.clone(), position: case.posed[vertex], target: to };
        let mut mobility = vec![DVec3::ONE; case.binding.control_count()];
        let pinned: Vec<usize> = (0..mobility.len()).step_by(4).collect();
        pinned.iter().for_each(|c| mobility[*c] = DVec3::ZERO);
        for options in methods() {
            let options = CorrectOptions { mobility: Some(mobility.clone()), ..options };
            let wanted = Wanted { points: vec![point.clone()], ..Wanted::volume(1.1 * case.solid.volume(&case.posed)) };
            let corrected = preview.correct(&pose, &wanted, &options).unwrap();
            assert!(pinned.iter().all(|c| corrected.displacement[*c] == DVec3::ZERO));
            assert!(corrected.vertices[vertex].distance(to) <= 1e-11);
            assert!(corrected.point_error <= 1e-12);
            assert!(corrected.relative_error < 0.05);
        }
    }
}

#[test]
fn a_volume_that_is_met_already_moves_nothing() {
    for case in cases() {
        let pose = case.pose();
        let preview = Preview::new(&pose, case.solid.triangle_count() / 8).unwrap();
        let corrected = preview
            .correct(&pose, &Wanted::volume(case.solid.volume(&case.posed)), &CorrectOptions::default())
            .unwrap();
        assert_eq!(corrected.status, Status::AlreadyMet);
        assert_eq!(corrected.vertices, case.posed);
    }
}

#[test]
fn a_pose_that_encloses_nothing_or_is_inside_out_is_previewed_too() {
    let case = Case::new(&icosphere(4));
    let preview = Preview::new(&case.rest_pose(), 500).unwrap();
    let target = case.solid.volume(&case.rest);
    let options = CorrectOptions { method: Method::xyz(), ..CorrectOptions::default() };
    for z in [0.0, 1e-17, -0.1] {
        let vertices: Vec<DVec3> = case.rest.iter().map(|p| *p * DVec3::new(1.0, 1.0, z)).collect();
        let pose = Pose { vertices: &vertices, ..case.pose() };
        let corrected = preview.correct(&pose, &Wanted::volume(target), &options).unwrap();
        assert!(corrected.relative_error < 0.1, "{z}: {}", corrected.relative_error);
    }
}

#[test]
fn what_does_not_fit_together_is_named() {
    let (case, other) = (Case::new(&icosphere(3)), Case::new(&icosphere(2)));
    let options = CorrectOptions::default();
    let preview = Preview::new(&case.pose(), 100).unwrap();
    let volume = case.solid.volume(&case.posed);
    let misfits = [Pose { vertices: &other.posed, ..case.pose() }, Pose { binding: &other.binding, ..case.pose() }];
    for pose in misfits {
        assert!(matches!(Preview::new(&pose, 100), Err(CorrectError::Length { .. })));
        assert!(matches!(preview.correct(&pose, &Wanted::volume(volume), &options), Err(CorrectError::Length { .. })));
    }
    assert!(matches!(
        preview.correct(&other.pose(), &Wanted::volume(volume), &options),
        Err(CorrectError::Length { .. })
    ));
    let lattice = Lattice::new(
        [0; 3].map(|_| Basis::clamped(4, 3).unwrap()),
        Frame::fitted(icosphere(1).bounds().unwrap(), 0.0).unwrap(),
    );
    let other_lattice = lattice.unwrap().bind(&case.rest, Outside::Extend).unwrap();
    let pose = Pose { binding: &other_lattice, ..case.pose() };
    assert!(matches!(preview.correct(&pose, &Wanted::volume(volume), &options), Err(CorrectError::Length { .. })));
    let refused = |vertices: &[DVec3], target: f64| {
        preview.correct(&Pose { vertices, ..case.pose() }, &Wanted::volume(target), &options).unwrap_err()
    };
    let last = case.posed.len() - 1;
    let mut broken = case.posed.clone();
    broken[last] = DVec3::NAN;
    assert!(matches!(refused(&broken, volume), CorrectError::NotFinite { vertex, .. } if vertex == last));
    for target in [0.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(&case.posed, target), CorrectError::Target { .. }));
    }
}

#[test]
fn a_torn_surface_is_refused_even_where_the_coarse_one_is_whole() {
    let whole = icosphere(3);
    // The last vertex twice, one for a face of its own.
    let mut points = whole.points().to_vec();
    let last = points.len() as u32 - 1;
    points.push(points[last as usize]);
    let mut faces: Vec<Vec<u32>> = whole.faces().iter().map(<[u32]>::to_vec).collect();
    let corner = faces.iter_mut().flatten().find(|v| **v == last).unwrap();
    *corner = last + 1;
    let mesh = Mesh::new(points, faces.iter().map(Vec::as_slice).collect()).unwrap();
    let mut case = Case::new(&mesh);
    let preview = Preview::new(&case.pose(), 100).unwrap();
    *case.posed.last_mut().unwrap() += DVec3::X;
    let error = preview.correct(&case.pose(), &Wanted::volume(4.0), &CorrectOptions::default()).unwrap_err();
    assert!(matches!(error, CorrectError::Torn { .. }), "{error}");
}

#[test]
fn what_is_impossible_is_said_of_the_fine_body() {
    let case = Case::new(&icosphere(4));
    let (pose, volume) = (case.pose(), case.solid.volume(&case.posed));
    let preview = Preview::new(&pose, 300).unwrap();
    let pinned =
        CorrectOptions { mobility: Some(vec![DVec3::ZERO; case.binding.control_count()]), ..CorrectOptions::default() };
    let error = preview.correct(&pose, &Wanted::volume(5.0), &pinned).unwrap_err();
    assert_eq!(error, CorrectError::Impossible { goal: Some(0), target: 5.0, volume, reason: Reason::Pinned });
    let gradient = CorrectOptions { method: Method::Gradient, ..CorrectOptions::default() };
    let of = |result: Result<_, CorrectError>| match result {
        Err(CorrectError::Impossible { target, volume: before, reason: Reason::Turns { limit }, .. }) => {
            assert_eq!((target, before), (-5.0, volume));
            limit
        }
        other => panic!("{other:?}"),
    };
    let exact = of(correct(&pose, &Wanted::volume(-5.0), &gradient).map(|_| ()));
    let approximate = of(preview.correct(&pose, &Wanted::volume(-5.0), &gradient).map(|_| ()));
    assert!((approximate - exact).abs() <= 0.1 * volume, "{approximate} {exact}");
}
