//! The gallery names every job that it is made from, and all its pictures are there.

use std::path::Path;

#[test]
fn the_gallery_names_every_job_and_its_pictures_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = std::fs::read_to_string(root.join("docs/gallery.md")).unwrap();
    for folder in ["figures", "films", "locality"] {
        for entry in std::fs::read_dir(root.join("examples/jobs").join(folder)).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".toml") {
                assert!(
                    page.contains(&format!("`examples/jobs/{folder}/{name}`")),
                    "{folder}/{name}: cargo xtask gallery"
                );
            }
        }
    }
    let pictures: Vec<&str> = page.split("](gallery/").skip(1).map(|rest| rest.split(')').next().unwrap()).collect();
    assert!(pictures.len() >= 20, "only {} pictures", pictures.len());
    for picture in pictures {
        let bytes = std::fs::read(root.join("docs/gallery").join(picture)).unwrap();
        assert_eq!(&bytes[1..4], b"PNG", "{picture}");
    }
}
