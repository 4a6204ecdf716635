//! Levels of published models: simplified scans, and sampled patches of the tea set.

use std::path::PathBuf;

use glam::DVec3;
use isochor::{
    Basis, Bounds, Frame, Lattice, Level, LevelOptions, Levels, OpenBoundaries, Outside, ParametricSolid, Solid,
    Surface, TriangleError, tolerances, topology,
};
use isochor_io::{Document, Format, patches_from_bytes};

fn shared(path: &str) -> Vec<u8> {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    std::fs::read(PathBuf::from(folder).join("models").join(path)).unwrap()
}

fn surfaces(name: &str) -> Vec<Surface> {
    let patches = patches_from_bytes(&shared(&format!("nurbs/{name}"))).unwrap();
    patches.into_iter().map(Surface::from).collect()
}

/// Nodes of 3 × 3 × 3: the first and last layers along an axis 40 % nearer to the middle, those between moved outwards by 30 %.
fn squash(bounds: Bounds, axis: usize) -> (Lattice, Vec<DVec3>) {
    let bases = [3; 3].map(|n| Basis::bernstein(n).unwrap());
    let lattice = Lattice::new(bases, Frame::fitted(bounds, 0.01).unwrap()).unwrap();
    let moved = |(c, rest): (usize, &DVec3)| {
        let d = *rest - bounds.center();
        let along = d * DVec3::AXES[axis];
        if lattice.node(c)[axis] == 1 { 0.3 * (d - along) } else { -0.4 * along }
    };
    let displacement = lattice.rest().iter().enumerate().map(moved).collect();
    (lattice, displacement)
}

fn change(level: &Level, lattice: &Lattice, displacement: &[DVec3]) -> f64 {
    let binding = lattice.bind(&level.points, Outside::Refuse).unwrap();
    level.solid.volume(&binding.displaced(&level.points, displacement)) - level.solid.volume(&level.points)
}

/// The cup and its saucer have no bottoms, and the handle ends in the wall of the cup; the spoon is open at both ends of its stem, by less than a thousandth.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn errors_of_sampled_patches_are_as_estimated() {
    for (name, axis, open, components, caps) in [("teacup", 1, 8, 2, 4), ("teaspoon", 2, 0, 1, 2)] {
        let refused = ParametricSolid::patches(surfaces(name), OpenBoundaries::Refuse).unwrap_err();
        assert!(refused.to_string().contains(&format!("surface {open} is open at t = 0")), "{name}: {refused}");
        let body = ParametricSolid::patches(surfaces(name), OpenBoundaries::Cap).unwrap();
        let levels = Levels::of_samples(&body, 50_000, &LevelOptions::default()).unwrap();
        let bounds = Bounds::of(&levels.as_slice().last().unwrap().points).unwrap();
        let (lattice, displacement) = squash(bounds, axis);
        let posed = body.clone().deformed(lattice.clone(), displacement.clone()).volume().unwrap();
        let exact = posed.volume - body.volume().unwrap().volume;
        assert!(posed.difference == 0.0 && exact < 0.0, "{name}");
        assert_eq!(levels.as_slice().len(), 5, "{name}");
        for two in levels.as_slice().windows(2) {
            assert_eq!((two[0].solid.component_count(), two[0].solid.cap_count()), (components, caps), "{name}");
            let counts = [0, 1].map(|k| two[k].solid.triangle_count());
            let changes = [0, 1].map(|k| change(&two[k], &lattice, &displacement));
            let estimate = TriangleError::between(counts, changes);
            let scaled = [0, 1].map(|k| counts[k] as f64 * (changes[k] - exact));
            for scaled in scaled {
                assert!((estimate.c / scaled - 1.0).abs() < 0.1, "{name}, {counts:?}: {} for {scaled}", estimate.c);
            }
            assert!((scaled[0] / scaled[1] - 1.0).abs() < 0.1, "{name}, {counts:?}: {scaled:?}");
        }
    }
}

/// Sections of the model are circles of radius `√(1 − (2u − 1)²) h(u)` at x(u), as those of the built-in club, rounded to 32 bits.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn the_made_club_is_the_built_in_one() {
    let document = Document::parse(shared("procedural/club-16384f.ply"), Format::Ply).unwrap();
    let quartic = |c: [f64; 5], u: f64| {
        let mut row = [0.0; 5];
        Basis::bernstein(5).unwrap().row(u, &mut row);
        row.iter().zip(c).map(|(b, c)| b * c).sum::<f64>()
    };
    for p in document.mesh().points() {
        let [mut low, mut high] = [0.0, 1.0];
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            let is_below = quartic([-3.0, -1.6, 0.0, 1.6, 3.0], middle) < p.x;
            *(if is_below { &mut low } else { &mut high }) = middle;
        }
        let radius = (4.0_f64 * low * (1.0 - low)).sqrt() * quartic([1.15, 1.0, 0.35, 0.6, 0.75], low);
        // At the poles the radius goes with the root of x.
        assert!((p.y.hypot(p.z) - radius).abs() < 1e-5, "{p}: {radius}");
    }
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn levels_of_scans() {
    for file in ["closed/armadillo-43243v.ply", "derived/bunny-filled-derived.ply"] {
        let document = Document::parse(shared(file), Format::Ply).unwrap();
        let mesh = document.mesh();
        let model = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).unwrap();
        let levels = Levels::of_mesh(&model, mesh.points(), &LevelOptions::default());
        assert!(levels.as_slice().len() >= 5, "{file}");
        for two in levels.as_slice().windows(2) {
            let vertices = two[0].vertices.as_ref().unwrap();
            assert!(two[0].points.iter().zip(vertices).all(|(p, v)| *p == mesh.points()[*v as usize]), "{file}");
            let [coarse, fine] = [0, 1].map(|k| two[k].solid.volume(&two[k].points));
            assert!((coarse / fine - 1.0).abs() <= tolerances::COARSE_VOLUME + 1e-9, "{file}: {coarse}, {fine}");
        }
    }
}
