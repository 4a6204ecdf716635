//! Mean value coordinates in the cages of published models.

use std::path::PathBuf;

use glam::DVec3;
use isochor::{Cage, CageOptions, Mesh, OpenBoundaries, Solid, topology};
use isochor_io::{Document, Format};

fn shared(path: &str) -> Vec<u8> {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    std::fs::read(PathBuf::from(folder).join(path)).unwrap()
}

fn mesh(name: &str) -> Mesh {
    let document = Document::parse(shared(&format!("models/{name}")), Format::from_path(name.as_ref()).unwrap());
    document.unwrap().mesh().clone()
}

/// Of all pairs: positions come back to 5e-12 of the extent, inside and outside; as many vertices are inside as another program found; and where
/// there is a posed cage the model's volume is an affine function of each of its vertices.
#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn positions_come_back_in_published_cages() {
    let table = String::from_utf8(shared("models/CAGES.tsv")).unwrap();
    let mut rows = 0;
    for row in table.lines().skip(1) {
        let columns: Vec<&str> = row.split('\t').collect();
        let (model, cage) = (mesh(columns[0]), Cage::new(mesh(columns[1])).unwrap());
        let bound = cage.bind(model.points(), &CageOptions::default()).unwrap();
        let report = bound.report();
        assert!(report.linear_precision <= 5e-12, "{}: {}", columns[1], report.linear_precision);
        assert!(report.constant_precision <= 1e-12, "{}: {}", columns[1], report.constant_precision);
        let inside: usize = columns[7].split(' ').next().unwrap().parse().unwrap();
        assert_eq!(report.vertices.to_string(), columns[3]);
        // Vertices on the cage are inside here.
        let found = model.points().len() - report.outside;
        assert!(found >= inside && found <= inside + inside / 50, "{}: {found} instead of {inside}", columns[1]);
        rows += 1;

        if columns[2] == "-" {
            continue;
        }
        let posed = mesh(columns[2]).points().to_vec();
        let Ok(solid) = Solid::new(&model, &topology(&model), OpenBoundaries::Cap) else { continue };
        let deformed = bound.deformed(model.points(), &posed);
        let gradient = bound.gradient(&posed, &solid.volume_gradient(&deformed));
        let before = solid.volume(&deformed);
        let by = DVec3::new(0.1, -0.2, 0.15) * cage.extent();
        let mut moved = posed.clone();
        moved[2] += by;
        let after = solid.volume(&bound.deformed(model.points(), &moved));
        let predicted = before + gradient[2].dot(by);
        let scale = before.abs().max(predicted.abs());
        assert!((after - predicted).abs() <= 1e-13 * scale, "{}: {:e}", columns[2], (after - predicted).abs() / scale);
    }
    assert_eq!(rows, 20);
}
