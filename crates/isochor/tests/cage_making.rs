//! Cages round shapes: every claim about them, and that the check of claims finds what is wrong.

use glam::{DVec3, dvec3};
use isochor::{
    CageCheck, CageFault, CageMakingError, CageMakingOptions, Faces, Mesh, cage_round, fan, shapes, topology,
};
use proptest::prelude::*;

fn moved(mesh: &Mesh, by: impl Fn(DVec3) -> DVec3) -> Mesh {
    mesh.with_points(mesh.points().iter().map(|p| by(*p)).collect()).unwrap()
}

fn together(meshes: &[Mesh]) -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for mesh in meshes {
        let first = points.len() as u32;
        points.extend_from_slice(mesh.points());
        mesh.faces().iter().for_each(|face| faces.push(&face.iter().map(|v| v + first).collect::<Vec<_>>()));
    }
    Mesh::new(points, faces).unwrap()
}

fn triangles(faces: &[[u32; 3]], points: &[[f64; 3]]) -> Mesh {
    Mesh::new(points.iter().map(|p| DVec3::from_array(*p)).collect(), faces.iter().collect()).unwrap()
}

/// A cage that was made, checked.
fn checked(mesh: &Mesh, options: CageMakingOptions) -> (Mesh, CageCheck) {
    let cage = cage_round(mesh, &options).unwrap();
    let wanted = options.distance * mesh.bounds().unwrap().extent();
    let report = CageCheck::of(&cage, mesh, wanted);
    assert!(report.faults.is_empty(), "{report:?}");
    assert!(report.faces <= options.faces && report.least_distance.unwrap() >= wanted, "{report:?}");
    (cage, report)
}

/// By formulas of their own: the solid angles of all triangles, and the distances of points from planes and segments.
#[test]
fn every_vertex_is_inside_at_the_distance() {
    let mesh = shapes::uv_torus(2.0, 0.5, 24, 16);
    let options = CageMakingOptions { faces: 120, distance: 0.02 };
    let (cage, report) = checked(&mesh, options);
    let (mut least, tau) = (f64::INFINITY, std::f64::consts::TAU);
    for p in mesh.points() {
        let mut angle = 0.0;
        for face in cage.faces().iter() {
            let [a, b, c] = [0, 1, 2].map(|k| cage.points()[face[k] as usize] - *p);
            let [la, lb, lc] = [a, b, c].map(|v| v.length());
            let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
            angle += 2.0 * a.dot(b.cross(c)).atan2(denominator);
            let n = (b - a).cross(c - a).normalize();
            let foot = n * n.dot(a);
            let sides = [[a, b], [b, c], [c, a]];
            if sides.iter().all(|[p, q]| (*q - *p).cross(foot - *p).dot(n) >= 0.0) {
                least = foot.length().min(least);
            }
            for [p, q] in sides {
                let t = (-p.dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0);
                least = least.min(p.lerp(q, t).length());
            }
        }
        assert!((angle - 2.0 * tau).abs() < 1e-9, "{p}: {angle}");
    }
    assert!((least - report.least_distance.unwrap()).abs() < 1e-12 && least >= 0.02 * 5.0);
}

#[test]
fn cages_have_the_shape_of_the_model() {
    let genus = |cage: &Mesh| topology(cage).genus();
    let usual = CageMakingOptions::default();
    let (ball, report) = checked(&shapes::icosphere(3), usual);
    assert_eq!((genus(&ball), report.components), (Some(0), 1));
    // Between the ball that must be inside and one that is a quarter larger.
    let volume = report.volume.unwrap() / (4.0 / 3.0 * std::f64::consts::PI);
    assert!((1.04f64.powi(3) * 0.97..1.25f64.powi(3)).contains(&volume), "{volume}");
    let torus = shapes::uv_torus(2.0, 0.5, 24, 16);
    assert_eq!(genus(&checked(&torus, usual).0), Some(1));
    // A tube of radius 0.5 + 1.5 and more fills the hole.
    assert_eq!(genus(&checked(&torus, CageMakingOptions { distance: 0.3, ..usual }).0), Some(0));
    let cubes = together(&[shapes::cube(2), moved(&shapes::cube(2), |p| p + dvec3(3.0, 0.0, 0.0))]);
    assert_eq!(checked(&cubes, usual).1.components, 2);
    let (shell, report) = checked(&shapes::hollow_sphere(2, 0.8), usual);
    assert_eq!((genus(&shell), report.components), (Some(0), 1));
}

#[test]
fn open_flat_crossing_and_inward_models_have_cages() {
    let usual = CageMakingOptions { faces: 100, distance: 0.05 };
    let sheet = triangles(&[[0, 1, 2], [0, 2, 3]], &[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let (cage, _) = checked(&sheet, usual);
    // The middle of the sheet is inside, too.
    let middle = Mesh::new(vec![dvec3(0.5, 0.5, 0.0), dvec3(0.3, 0.5, 0.0)], Faces::new()).unwrap();
    assert!(CageCheck::of(&cage, &middle, 0.04).faults.is_empty());
    let cube = shapes::cube(1);
    let inward: Faces = cube.faces().iter().flat_map(fan).map(|[a, b, c]| [a, c, b]).collect::<Vec<_>>().into();
    checked(&Mesh::new(cube.points().to_vec(), inward).unwrap(), usual);
    checked(&together(&[cube.clone(), moved(&cube, |p| p + 0.5)]), usual);
    // Three triangles on an edge, and a vertex alone.
    let fin = triangles(
        &[[0, 1, 2], [0, 1, 3], [1, 0, 4]],
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.5, 0.5, 0.5]],
    );
    checked(&fin, usual);
}

#[test]
fn far_and_tiny_models_have_cages() {
    let ball = shapes::icosphere(2);
    let options = CageMakingOptions { faces: 60, distance: 0.05 };
    checked(&moved(&ball, |p| p + dvec3(2e6, -3e6, 1e6)), options);
    for scale in [1e-60, 1e-9, 1e60] {
        checked(&moved(&ball, |p| p * scale), options);
    }
}

#[test]
fn what_cannot_be_had_is_said() {
    let ball = shapes::icosphere(2);
    let usual = CageMakingOptions::default();
    let error = |mesh: &Mesh, options| cage_round(mesh, &options).unwrap_err();
    assert_eq!(error(&ball, CageMakingOptions { faces: 7, ..usual }), CageMakingError::Faces { faces: 7 });
    for distance in [0.0, -1.0, 1.5, f64::INFINITY] {
        assert_eq!(error(&ball, CageMakingOptions { distance, ..usual }), CageMakingError::Distance { distance });
    }
    assert_eq!(error(&Mesh::new(Vec::new(), Faces::new()).unwrap(), usual), CageMakingError::Nothing);
    let point = Mesh::new(vec![DVec3::ONE; 3], Faces::new()).unwrap();
    assert_eq!(error(&point, usual), CageMakingError::Extent { extent: 0.0 });
    let far = [DVec3::ZERO, dvec3(10.0, 0.0, 0.0), dvec3(5.0, 9.0, 0.0)];
    let few = CageMakingOptions { faces: 10, ..usual };
    // Three surfaces of four triangles each are the fewest.
    let error = error(&Mesh::new(far.to_vec(), Faces::new()).unwrap(), few);
    assert!(matches!(error, CageMakingError::TooMany { reached: 12.., wanted: 10 }), "{error}");
}

#[test]
fn cages_have_the_same_bits_for_any_number_of_threads() {
    let made = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cage_round(&shapes::icosphere(3), &CageMakingOptions::default()).unwrap())
    };
    assert_eq!(made(1), made(3));
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
const SIDES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

#[test]
fn the_check_finds_whatever_is_wrong() {
    let inside = Mesh::new(vec![dvec3(0.5, 0.5, 0.75), dvec3(1.0, 1.0, 1.0)], Faces::new()).unwrap();
    let report = |cage: &Mesh| CageCheck::of(cage, &inside, 0.5);
    let good = report(&triangles(&SIDES, &CORNERS));
    assert_eq!((good.faults.len(), good.vertices, good.faces, good.components), (0, 4, 4, 1));
    // 4³/6; the nearer point is 1/2 from two sides.
    assert!((good.volume.unwrap() - 64.0 / 6.0).abs() < 1e-14 && good.least_distance == Some(0.5));

    let open = report(&triangles(&SIDES[..3], &CORNERS));
    assert!(open.faults.contains(&CageFault::Open { edges: 3 }) && open.volume.is_none(), "{open:?}");
    let mut turned = SIDES;
    turned[3] = [1, 3, 2];
    let turned = report(&triangles(&turned, &CORNERS));
    assert!(turned.faults.contains(&CageFault::Inconsistent { edges: 3 }), "{turned:?}");
    let inward = report(&triangles(&SIDES.map(|[a, b, c]| [a, c, b]), &CORNERS));
    assert!(matches!(inward.faults[0], CageFault::Inward { component: 0, volume } if volume < 0.0), "{inward:?}");
    assert!(inward.faults.contains(&CageFault::Outside { vertex: 0 }));

    // A second one that touches the first from outside with a corner, at a vertex, crosses it, or goes round it.
    let second = |f: &dyn Fn(DVec3) -> DVec3| {
        let first = triangles(&SIDES, &CORNERS);
        report(&together(&[first.clone(), moved(&first, f)]))
    };
    let touching = second(&|p| p + dvec3(1.0, 1.0, 2.0));
    assert!(matches!(touching.faults[..], [CageFault::Crossing { .. }]), "{touching:?}");
    let at_a_vertex = second(&|p| p + dvec3(4.0, 0.0, 0.0));
    assert!(at_a_vertex.faults.contains(&CageFault::NonManifold { edges: 0, vertices: 1 }), "{at_a_vertex:?}");
    let crossing = second(&|p| p + dvec3(2.0, 0.5, 0.5));
    assert!(crossing.faults.iter().any(|fault| matches!(fault, CageFault::Crossing { .. })), "{crossing:?}");
    let round = second(&|p| 3.0 * p - 1.5);
    assert!(matches!(round.faults[..], [CageFault::Outside { vertex: 0 }]), "{round:?}");

    let flat = report(&triangles(&SIDES, &[[0.0; 3], [4.0, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 0.0, 4.0]]));
    assert!(flat.faults.contains(&CageFault::NoArea { face: 0 }), "{flat:?}");
    let mut faces = Faces::new();
    [&[0, 1, 3, 2][..], &[0, 2, 1]].iter().for_each(|face| faces.push(face));
    let points = CORNERS.map(DVec3::from_array).to_vec();
    let quad = report(&Mesh::new(points, faces).unwrap());
    assert!(quad.faults.contains(&CageFault::NoTriangle { face: 0, corners: 4 }), "{quad:?}");

    let cage = triangles(&SIDES, &CORNERS);
    let near = CageCheck::of(&cage, &inside, 0.5 + 1e-9);
    assert!(matches!(near.faults[..], [CageFault::TooNear { distance: 0.5, .. }]), "{near:?}");
    let beyond = Mesh::new(vec![DVec3::ONE * 0.5, DVec3::ONE * 2.0], Faces::new()).unwrap();
    assert!(CageCheck::of(&cage, &beyond, 0.1).faults.contains(&CageFault::Outside { vertex: 1 }));
    let nothing = report(&Mesh::new(Vec::new(), Faces::new()).unwrap());
    assert!(nothing.faults.contains(&CageFault::Open { edges: 0 }) && nothing.least_distance.is_none(), "{nothing:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn triangle_soups_have_cages(corners in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 9..30)) {
        let points: Vec<DVec3> = corners.iter().map(|p| DVec3::from_array(*p)).collect();
        let faces: Vec<[u32; 3]> = (0..points.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        checked(&Mesh::new(points, faces.into()).unwrap(), CageMakingOptions { faces: 150, distance: 0.05 });
    }
}
