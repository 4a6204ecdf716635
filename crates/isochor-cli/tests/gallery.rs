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
    for folder in ["examples/jobs/figures", "examples/jobs/films", "examples/jobs/locality", "examples/jobs"] {
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
    assert_eq!(shown, files("docs/gallery", ".png"));
    assert!(shown.len() >= 30, "only {} pictures", shown.len());
    let bytes: Vec<Vec<u8>> =
        shown.iter().map(|name| std::fs::read(root().join("docs/gallery").join(name)).unwrap()).collect();
    for (bytes, name) in bytes.iter().zip(&shown) {
        assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n", "{name}");
    }
    let total: usize = bytes.iter().map(Vec::len).sum();
    assert!(total < 4_000_000, "{total} bytes are much to carry in a repository");
}

#[test]
fn other_pages_show_pictures_of_the_gallery() {
    let there = files("docs/gallery", ".png");
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
}
