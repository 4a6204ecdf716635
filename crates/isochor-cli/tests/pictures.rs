//! `--color steps`, `--color stress` and `--size` of pictures.

use std::process::Command;

/// The picture of a cube that is pressed to half its height and corrected along x and y.
fn picture(folder: &tempfile::TempDir, name: &str, flags: &[&str]) -> Vec<u8> {
    let path = folder.path().join(name);
    let model = folder.path().join("out.ply");
    let ran = Command::new(env!("CARGO_BIN_EXE_isochor"))
        .args(["deform", "shape:cube?n=4", "--stretch", "z=0.5", "--no-lattice", "--quiet"])
        .arg("-o")
        .arg(&model)
        .arg("--picture")
        .arg(&path)
        .args(flags)
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    std::fs::read(path).unwrap()
}

/// Width and height of a PNG: in `IHDR`, after 16 bytes.
fn sides(png: &[u8]) -> [u32; 2] {
    [16, 20].map(|at| u32::from_be_bytes(png[at..at + 4].try_into().unwrap()))
}

#[test]
fn steps_differ_from_the_whole_change_where_there_is_a_correction() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |name: &str, flags: &[&str]| picture(&folder, name, flags);
    let size = ["--size", "100x100"];
    let corrected = |color: &'static str| draw("a.png", &[size[0], size[1], "--preserve", "xy", "--color", color]);
    assert!(corrected("steps") != corrected("volume"));
    // Without correction the one step is the whole change.
    let plain = |color: &'static str| draw("b.png", &[size[0], size[1], "--preserve", "free", "--color", color]);
    assert!(plain("steps") == plain("volume"));
}

/// A stretch to a half has the same stress everywhere, arccos(2√0.5/1.5): the top of the scale, so that the model has one hue. Its volume is all that a uniform
/// scale changes: no stress, the bottom of the scale.
#[test]
fn stress_is_drawn_in_the_colours_of_its_scale() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["--size", "100x100", "--preserve", "free", "--color", "stress"];
    // The middle of the second of two poses: its upper half, where the cube is.
    let of = |name: &str, more: &[&str]| {
        let png = picture(&folder, name, &[&flags[..], more].concat());
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        let (x, y) = (info.width as usize * 3 / 4, info.height as usize / 3);
        let at = 3 * (y * info.width as usize + x);
        [bytes[at], bytes[at + 1], bytes[at + 2]]
    };
    // Viridis ends in yellow and begins in violet.
    let [red, green, blue] = of("a.png", &[]);
    assert!(red > 150 && green > 130 && blue < 100, "{red} {green} {blue}");
    let [red, green, blue] = of("b.png", &["--stretch", "x=0.5", "--stretch", "y=0.5"]);
    assert!(red < 120 && green < 60 && blue > 60, "{red} {green} {blue}");
}

#[test]
fn a_size_is_that_of_a_pose() {
    let folder = tempfile::tempdir().unwrap();
    let wide = |size: &str| sides(&picture(&folder, "a.png", &["--size", size]))[0];
    // Three poses side by side; margins and gaps are the same for both.
    assert_eq!(wide("300x300") - wide("200x200"), 3 * 100);
}
