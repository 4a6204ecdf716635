//! Simplification of all reference models that bound a body.

use std::path::PathBuf;

use glam::DVec3;
use isochor::{OpenBoundaries, Solid, tolerances, topology};
use isochor_io::{Document, Format};

fn shared(path: &str) -> PathBuf {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    PathBuf::from(folder).join("models").join(path)
}

/// The models with at most 60 000 faces that can be read and bound a body.
fn bodies() -> Vec<(String, Document, Solid)> {
    let text = std::fs::read_to_string(shared("MANIFEST.tsv")).unwrap();
    let file = |line: &str| line.split('\t').next().unwrap().to_owned();
    let body = |file: String| {
        let format = Format::from_path(file.as_ref()).ok()?;
        let document = Document::parse(std::fs::read(shared(&file)).unwrap(), format).ok()?;
        let mesh = document.mesh();
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Cap).ok()?;
        (mesh.faces().len() <= 60_000).then_some((file, document, solid))
    };
    text.lines().skip(1).map(file).filter_map(body).collect()
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn a_tenth_of_the_triangles_is_closed_as_before_and_encloses_nearly_the_same() {
    let (mut closed, mut small, mut faults) = (0, 0, Vec::new());
    for (file, document, fine) in bodies() {
        let points = document.mesh().points();
        let coarse = fine.coarse(points, fine.triangle_count() / 10);
        assert_eq!(
            (coarse.component_count(), coarse.cap_count()),
            (fine.component_count(), fine.cap_count()),
            "{file}"
        );
        let (of_coarse, of_fine) = (coarse.volumes(points).components, fine.volumes(points).components);
        let is_near = |(a, b): (&f64, &f64)| (a - b).abs() <= (tolerances::COARSE_VOLUME + 1e-9) * b.abs();
        if !of_coarse.iter().zip(&of_fine).all(is_near) {
            faults.push(format!("{file}: {of_coarse:?}, {of_fine:?}"));
        }
        // Vertices anywhere, one place at one place: the volume hangs on translations unless every edge is run as often in both
        // directions.
        let extent = document.mesh().bounds().unwrap().extent();
        let mixed = |p: &DVec3| DVec3::new(p.dot(DVec3::new(137.0, 211.0, 59.0)), p.y * 97.0 - p.z, p.z * 173.0 + p.x);
        let waves = |q: DVec3| DVec3::new(q.x.sin(), q.y.cos(), q.z.sin());
        let scattered: Vec<DVec3> = points.iter().map(|p| waves(mixed(&(*p / extent)))).collect();
        let along_translations: DVec3 = coarse.volume_gradient(&scattered).iter().sum();
        if along_translations.length() > 1e-9 {
            faults.push(format!("{file}: not balanced, {along_translations}"));
        }
        closed += usize::from(fine.cap_count() == 0);
        small += usize::from(coarse.triangle_count() * 8 <= fine.triangle_count());
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(closed > 100 && small > 50, "only {closed} closed models, only {small} simplified as far as asked");
}
