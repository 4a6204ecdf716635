//! STL documents: detection, welding, normals, what is refused.

use glam::DVec3;
use isochor_io::{Document, Format, NumberType, Place, Precision, WriteError, WriteOptions};

fn read(bytes: &[u8]) -> Document {
    Document::parse(bytes.to_vec(), Format::Stl).unwrap()
}

fn refused(bytes: &[u8], place: Place, words: &str) {
    let error = Document::parse(bytes.to_vec(), Format::Stl).unwrap_err();
    assert!(error.to_string().contains(words), "{error}");
    assert_eq!(error.place(), Some(place), "{error}");
    assert!(error.hint().is_some(), "{error}");
}

/// A tetrahedron: corners and unit normals of its facets.
const TETRAHEDRON: [[[f32; 3]; 4]; 4] = [
    [[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    [[0.0, -1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
    [[0.577, 0.577, 0.577], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.0, 0.0, 1.0]],
];

fn binary(title: &str) -> Vec<u8> {
    let mut bytes = format!("{title:80}").into_bytes();
    bytes.extend_from_slice(&4_u32.to_le_bytes());
    for (k, facet) in TETRAHEDRON.iter().enumerate() {
        bytes.extend(facet.iter().flatten().flat_map(|x| x.to_le_bytes()));
        bytes.extend_from_slice(&(k as u16 + 7).to_le_bytes());
    }
    bytes
}

fn text() -> String {
    let mut text = "solid te \\tra\n".to_owned();
    for [n, a, b, c] in TETRAHEDRON {
        text += &format!("  facet normal {:e} {:e} {:e}\r\n    outer loop\n", n[0], n[1], n[2]);
        for p in [a, b, c] {
            text += &format!("\tvertex {:.6} {:.6}  {:e}\n", p[0], p[1], p[2]);
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid te \\tra\n"
}

#[test]
fn both_encodings_weld_to_the_same_mesh() {
    for document in [read(&binary("solid but binary")), read(text().as_bytes())] {
        assert_eq!(document.mesh().points(), [DVec3::ZERO, DVec3::Y, DVec3::X, DVec3::Z]);
        assert_eq!(document.mesh().faces().corners(), [0, 1, 2, 0, 2, 3, 0, 3, 1, 2, 1, 3]);
        assert_eq!((document.vertices_in_file(), document.faces_in_file()), (12, 4));
        assert_eq!(document.number_type(), NumberType::F32);
        assert!(!document.has_normals() && document.warnings().is_empty());
        let same = document.with_points(document.mesh().points(), &WriteOptions::default()).unwrap();
        assert_eq!(same.bytes, document.bytes());
    }
}

/// z of the top goes from 1 to 2: the top facet's normal becomes (2, 2, 1)/3, those of the coordinate planes stay.
#[test]
fn a_moved_vertex_moves_all_its_corners_and_normals() {
    let moved = [DVec3::ZERO, DVec3::Y, DVec3::X, DVec3::Z * 2.0];
    let bytes = read(&binary("made")).with_points(&moved, &WriteOptions::default()).unwrap().bytes;
    let mut want = binary("made");
    let mut put = |facet: usize, vector: usize, axis: usize, x: f32| {
        let at = 84 + 50 * facet + 12 * vector + 4 * axis;
        want[at..at + 4].copy_from_slice(&x.to_le_bytes());
    };
    for (facet, corner) in [(1, 3), (2, 2), (3, 3)] {
        put(facet, corner, 2, 2.0);
    }
    for (axis, x) in [2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0].into_iter().enumerate() {
        put(3, 0, axis, x);
    }
    assert_eq!(bytes, want);

    let written = read(text().as_bytes()).with_points(&moved, &WriteOptions::default()).unwrap();
    let want = text()
        .replace("0.000000 0.000000  1e0", "0.000000 0.000000  2")
        .replace("-0.000000 0.000000  1e0", "-0.000000 0.000000  2")
        .replace("5.77e-1 5.77e-1 5.77e-1", "0.6666667 0.6666667 0.33333334");
    assert_eq!(String::from_utf8(written.bytes).unwrap(), want);
}

#[test]
fn zero_normals_stay_zero_and_nan_normals_are_recomputed() {
    for (stored, want) in [("0 0 0", "0 0 0"), ("nan 0 -1", "0 0 -1"), ("-1.#IND -nan x", "0 0 -1")] {
        let text = text().replace("0e0 0e0 -1e0", stored);
        let document = read(text.as_bytes());
        let same = document.with_points(document.mesh().points(), &WriteOptions::default()).unwrap();
        assert_eq!(same.bytes, text.as_bytes());
        let mut points = document.mesh().points().to_vec();
        points[1].y = 3.0;
        let bytes = document.with_points(&points, &WriteOptions::default()).unwrap().bytes;
        assert!(String::from_utf8(bytes).unwrap().contains(&format!("facet normal {want}")), "{stored}");
    }
}

#[test]
fn a_facet_that_loses_its_area_gets_the_normal_0() {
    let document = read(&binary("made"));
    let points = vec![DVec3::ZERO, DVec3::Y, DVec3::X, DVec3::X];
    let written = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(&written.bytes[84 + 50..84 + 62], &[0; 12]);
    let again = read(&written.bytes);
    assert_eq!(again.faces_in_file(), 4);
    assert!(again.warnings()[0].contains("more than once: 2"), "{:?}", again.warnings());
}

#[test]
fn numbers_are_rounded_to_32_bits() {
    let document = read(&binary("made"));
    let mut points = document.mesh().points().to_vec();
    points[1].y = 0.1;
    let written = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(written.points[1].y, f64::from(0.1_f32));
    assert_eq!(read(&written.bytes).mesh().points(), written.points);

    // Text is read in 64 bits, so what is stored is the decimal number, and not more of it than 32 bits need.
    let document = read(text().as_bytes());
    points[1].y = 0.123456789;
    let written = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(written.points[1].y, 0.12345679);
    assert_eq!(read(&written.bytes).mesh().points(), written.points);

    points[1].y = 1e39;
    let error = document.with_points(&points, &WriteOptions::default()).unwrap_err();
    assert_eq!(error, WriteError::BeyondF32 { vertex: 1, axis: 'y', value: 1e39 });
    let options = WriteOptions { precision: Precision::F64, ..Default::default() };
    let error = document.with_points(document.mesh().points(), &options).unwrap_err();
    assert!(error.to_string().contains("32-bit floats") && error.hint().is_some());
}

#[test]
fn lengths_and_counts_of_binary_files() {
    let whole = binary("made");
    let counted = |count: u32| [&whole[..80], &count.to_le_bytes(), &whole[84..]].concat();
    refused(&counted(u32::MAX), Place::Byte(80), "4294967295 facets are announced");
    refused(&counted(3), Place::Byte(80), "1 more stand behind them");
    refused(&counted(0), Place::Byte(80), "4 more stand behind them");
    refused(&whole[..whole.len() - 30], Place::Byte(80), "take 284 bytes, but there are 254");
    refused(&whole[..80], Place::Byte(80), "80 bytes are fewer");
    refused(&[&whole[..80], &[0; 9]].concat(), Place::Byte(80), "no facet is announced");
    assert_eq!(read(&[&whole[..80], &[0; 4]].concat()).faces_in_file(), 0);
    let trailing = [&whole[..], b"made by"].concat();
    let document = read(&trailing);
    assert!(document.warnings()[0].contains("kept but not read: 7"));
    let same = document.with_points(document.mesh().points(), &WriteOptions::default()).unwrap();
    assert_eq!(same.bytes, trailing);
    let mut nan = whole.clone();
    nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    refused(&nan, Place::Byte(96), "NaN is not a finite number");
}

#[test]
fn texts_that_are_read() {
    let text = text();
    for (odd, facets) in [
        (text.replace("endsolid te \\tra\n", ""), 4),
        (text.replacen("solid te", "  SOLID te", 1).replace("facet", "FaceT").replace("vertex", "VERTEX"), 4),
        (format!("{text}{text}"), 8),
        (text.replace('\n', "\r"), 4),
        (format!("\u{feff}{text}"), 4),
        ("solid empty\nendsolid empty".to_owned(), 0),
    ] {
        let document = read(odd.as_bytes());
        assert_eq!(document.faces_in_file(), facets, "{odd}");
        let same = document.with_points(document.mesh().points(), &WriteOptions::default()).unwrap();
        assert_eq!(same.bytes, odd.as_bytes());
    }
    let latin = [b"solid W\xfcrfel\n", &text.as_bytes()[14..]].concat();
    assert_eq!(read(&latin).faces_in_file(), 4);
}

#[test]
fn texts_that_are_refused() {
    let text = text();
    let cut = |at: &str| text.as_bytes()[..text.rfind(at).unwrap()].to_vec();
    refused(&cut("endfacet"), Place::Line(29), "within a facet");
    refused(&cut("  facet"), Place::Line(23), "'endsolid' is missing and 3 edges are open");
    let four = text.replacen("    endloop", "vertex 0 0 0\nendloop", 1);
    refused(four.as_bytes(), Place::Line(7), "'vertex' stands where 'endloop' should");
    let two = text.replacen("\tvertex 0.000000 0.000000  0e0\n", "", 1);
    refused(two.as_bytes(), Place::Line(6), "'endloop' stands where 'vertex' should");
    let bad = text.replacen("vertex 0.000000 1.000000", "vertex 0.000000 1,000000", 1);
    refused(bad.as_bytes(), Place::Line(5), "'1,000000' is not a number");
    let bad = text.replacen("vertex 0.000000 1.000000", "vertex 0.000000 inf", 1);
    refused(bad.as_bytes(), Place::Line(5), "'inf' is not a finite number");
    refused(format!("{text}facet").as_bytes(), Place::Line(31), "'facet' stands where 'solid' should");
    assert!(Document::parse(Vec::new(), Format::Stl).is_err());
}
