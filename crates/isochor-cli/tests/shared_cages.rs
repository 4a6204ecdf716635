//! Cages round published models: those that have published cages, and some that are open, in many pieces or flat.

use std::path::PathBuf;

use isochor::{Cage, CageCheck, CageMakingOptions, Mesh, cage_round};
use isochor_io::{Document, Format};

fn shared(path: &str) -> PathBuf {
    let Some(folder) = option_env!("ISOCHOR_SHARED_DIR") else { panic!("build.rs found no folder") };
    PathBuf::from(folder).join("models").join(path)
}

/// The models of published cages that can be read, and some open ones.
fn models() -> Vec<(String, Document)> {
    let text = std::fs::read_to_string(shared("CAGES.tsv")).unwrap();
    let mut files: Vec<String> = text.lines().skip(1).map(|line| line.split('\t').next().unwrap().to_owned()).collect();
    let open = std::fs::read_dir(shared("open")).unwrap().map(|e| format!("open/{}", e.unwrap().file_name().display()));
    files.extend(open);
    files.sort();
    files.dedup();
    let document = |file: String| {
        let format = Format::from_path(file.as_ref()).ok()?;
        let document = Document::parse(std::fs::read(shared(&file)).unwrap(), format).ok()?;
        (document.mesh().faces().len() <= 100_000).then_some((file, document))
    };
    files.into_iter().filter_map(document).collect()
}

fn assert_caged(file: &str, mesh: &Mesh) {
    let options = CageMakingOptions::default();
    let cage = cage_round(mesh, &options).unwrap_or_else(|error| panic!("{file}: {error}"));
    let report = CageCheck::of(&cage, mesh, options.distance * mesh.bounds().unwrap().extent());
    assert!(report.faults.is_empty() && report.faces <= options.faces, "{file}: {report:?}");
    let cage = Cage::new(cage).unwrap();
    assert!(mesh.points().iter().step_by(97).all(|p| cage.contains(*p)), "{file}");
}

#[test]
#[cfg_attr(not(isochor_shared), ignore = "needs the folder of reference models (ISOCHOR_SHARED)")]
fn some_published_models_have_cages_that_hold_them() {
    for file in ["cages/fish-low.obj", "closed/dolphin.off", "derived/suzanne-filled-derived.ply"] {
        let format = Format::from_path(file.as_ref()).unwrap();
        assert_caged(file, Document::parse(std::fs::read(shared(file)).unwrap(), format).unwrap().mesh());
    }
}

#[test]
#[ignore = "takes minutes: all models of published cages and the open ones, with ISOCHOR_SHARED"]
fn all_published_models_have_cages_that_hold_them() {
    let models = models();
    assert!(models.len() > 20, "only {} models", models.len());
    for (file, document) in models {
        assert_caged(&file, document.mesh());
    }
}
