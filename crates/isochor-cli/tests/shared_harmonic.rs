//! Harmonic coordinates of real cages: what holds for them without error at any resolution, for all vertices of the models inside.

use std::path::PathBuf;

use glam::DVec3;
use isochor::{Cage, Harmonic, HarmonicOptions, Mesh};
use isochor_io::{Document, Format};

fn shared(path: &str) -> PathBuf {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    PathBuf::from(folder).join("models").join(path)
}

fn mesh(path: &str) -> Mesh {
    let format = Format::from_path(path.as_ref()).unwrap();
    Document::parse(std::fs::read(shared(path)).unwrap(), format).unwrap().mesh().clone()
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models")]
fn real_cages_have_coordinates_that_reproduce_points() {
    let text = std::fs::read_to_string(shared("CAGES.tsv")).unwrap();
    let mut pairs = 0;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split('\t').collect();
        let [model, cage] = [cells[0], cells[1]];
        if Format::from_path(model.as_ref()).is_err() {
            continue;
        }
        pairs += 1;
        let cage = Cage::new(mesh(cage)).unwrap();
        let harmonic = Harmonic::new(&cage, &HarmonicOptions::fitted(&cage)).unwrap();
        let report = harmonic.report();
        assert!(report.residual < 1e-13 && report.least_weight > -1e-14, "{model}: {report:?}");
        let mut row = vec![0.0; cage.vertices().len()];
        let mut inside = 0;
        for p in mesh(model).points() {
            let is_inside = harmonic.fill_row(*p, &mut row);
            assert_eq!(is_inside, cage.contains(*p), "{model} at {p}");
            if !is_inside {
                continue;
            }
            inside += 1;
            let sum: f64 = row.iter().sum();
            let at: DVec3 = row.iter().zip(cage.vertices()).map(|(w, v)| *w * *v).sum();
            assert!((sum - 1.0).abs() < 1e-11, "{model} at {p}: {sum}");
            assert!(at.distance(*p) < 1e-11 * cage.extent(), "{model} at {p}: {at}");
            assert!(row.iter().all(|w| *w > -1e-13), "{model} at {p}");
        }
        assert!(inside > 0, "{model}");
    }
    assert_eq!(pairs, 20);
}
