//! The gallery names every job that it is made from, and shows all of its pictures and no others.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Names of the files of a folder that end so.
fn files(folder: &str, ending: &str) -> BTreeSet<String> {
    let entries = std::fs::read_dir(root().join(folder)).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.ends_with(ending)).collect()
}

/// Names of the gallery's pictures: of models, and of flattened sheets.
fn pictures() -> BTreeSet<String> {
    [".png", ".svg"].into_iter().flat_map(|ending| files("docs/gallery", ending)).collect()
}

/// The gallery's pictures on a page of the docs.
fn pictures_on(page: &str) -> BTreeSet<String> {
    page.split("](gallery/").skip(1).map(|rest| rest.split(')').next().unwrap().to_owned()).collect()
}

fn page(name: &str) -> String {
    std::fs::read_to_string(root().join("docs").join(name)).unwrap()
}

#[test]
fn the_gallery_says_its_command_and_names_every_job() {
    let page = page("gallery.md");
    assert!(page.contains("`cargo xtask gallery`"));
    for folder in [
        "examples/jobs/figures",
        "examples/jobs/films",
        "examples/jobs/locality",
        "examples/jobs/surface",
        "examples/jobs/elastic",
        "examples/jobs/cage",
        "examples/jobs",
    ] {
        let jobs = files(folder, ".toml");
        assert!(!jobs.is_empty(), "{folder}");
        for job in jobs {
            assert!(page.contains(&format!("isochor deform --job {folder}/{job}\n")), "{folder}/{job}: make it anew");
        }
    }
}

#[test]
fn the_gallery_shows_the_pictures_that_are_there() {
    let shown = pictures_on(&page("gallery.md"));
    assert_eq!(shown, pictures());
    assert!(shown.len() >= 30, "only {} pictures", shown.len());
    let bytes: Vec<Vec<u8>> =
        shown.iter().map(|name| std::fs::read(root().join("docs/gallery").join(name)).unwrap()).collect();
    for (bytes, name) in bytes.iter().zip(&shown) {
        let start: &[u8] = if name.ends_with(".svg") { b"<svg " } else { b"\x89PNG\r\n\x1a\n" };
        assert_eq!(&bytes[..start.len()], start, "{name}");
    }
    let total: usize = bytes.iter().map(Vec::len).sum();
    // Before the nine plates of HML it was 3.9 million.
    assert!(total < 5_400_000, "{total} bytes are much to carry in a repository");
}

#[test]
fn other_pages_show_pictures_of_the_gallery() {
    let there = pictures();
    for name in files("docs", ".md") {
        let missing: Vec<String> = pictures_on(&page(&name)).difference(&there).cloned().collect();
        assert!(missing.is_empty(), "{name} shows {missing:?}");
    }
    // A picture for every figure job, of which films are a strip and an animation.
    let figures = pictures_on(&page("figures.md"));
    for job in files("examples/jobs/figures", ".toml") {
        let stem = job.trim_end_matches(".toml");
        assert!(figures.contains(&format!("{stem}.png")), "figures.md has no picture of {stem}");
    }
    let along = pictures_on(&page("surface.md"));
    let made = there.iter().filter(|name| name.starts_with("surface-"));
    let missing: Vec<&String> = made.filter(|name| !along.contains(*name)).collect();
    assert!(missing.is_empty(), "surface.md has no {missing:?}");
    for job in files("examples/jobs/surface", ".toml") {
        assert!(page("surface.md").contains(&job), "surface.md does not name {job}");
    }
}
