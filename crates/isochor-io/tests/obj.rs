//! OBJ documents: what is kept, what is changed, what is refused.

use glam::{DMat3, DVec3};
use isochor_io::{Document, Format, NumberType, Place, WriteOptions};

fn read(text: &[u8]) -> Document {
    Document::parse(text.to_vec(), Format::Obj).unwrap()
}

fn with_points(document: &Document, points: &[DVec3]) -> String {
    let written = document.with_points(points, &WriteOptions::default()).unwrap();
    assert_eq!(written.points, points);
    String::from_utf8(written.bytes).unwrap()
}

/// The text is refused in this line, with these words in the message.
fn refused(text: &[u8], line: usize, words: &str) {
    let error = Document::parse(text.to_vec(), Format::Obj).unwrap_err();
    assert_eq!(error.place(), Some(Place::Line(line)), "{error}");
    assert!(error.to_string().contains(words), "{error}");
    assert!(error.hint().is_some(), "{error}");
}

const ODD: &[u8] = b"\xef\xbb\xbf# \xe9t\xe9, not UTF-8 \\\r\nmtllib a b.mtl\r\n\r\n  v\t+1. 0 -.0e-3 # tail\rv 1.E+00 \\\n  2 \t 3.50\n\
v 0 1e-400 00012 0.5 .25 1\nv 1 1 1 1.0\nvt 0 1\nvn 0 0 1.000\no x\\y\ng a f 1 2 3\ns off\nusemtl red#1\n\
f 1/1/1 2//1 3/1 # f 9 9 9\nf -1 -2// -3/1/\\\r\n -4\nfo 1 2 4\nl 1 2\np 3\ncurv 0 1 1 2\nend";

#[test]
fn everything_odd_but_legal_is_read_and_kept() {
    let document = read(ODD);
    let points = [DVec3::X, DVec3::new(1.0, 2.0, 3.5), DVec3::new(0.0, 0.0, 12.0), DVec3::ONE];
    assert_eq!(document.mesh().points(), points);
    let faces: Vec<_> = document.mesh().faces().iter().map(<[u32]>::to_vec).collect();
    assert_eq!(faces, [vec![0, 1, 2], vec![3, 2, 1, 0], vec![0, 1, 3]]);
    assert_eq!((document.vertices_in_file(), document.faces_in_file()), (4, 3));
    assert_eq!(document.format(), Format::Obj);
    assert_eq!(document.number_type(), NumberType::F64);
    assert!(document.has_normals());
    assert!(document.warnings().is_empty(), "{:?}", document.warnings());
    let same = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(same.bytes, ODD);
}

#[test]
fn only_changed_coordinates_change() {
    let document = read(ODD);
    let mut points = document.mesh().points().to_vec();
    points[0].y = -0.1;
    points[1].x = 1e-300;
    points[2] = DVec3::new(0.25, 0.0, 1e20);
    let bytes = document.with_points(&points, &WriteOptions::default()).unwrap().bytes;
    let text = String::from_utf8_lossy(&bytes);
    let want = String::from_utf8_lossy(ODD)
        .replace("+1. 0 -.0e-3 # tail", "+1. -0.1 -.0e-3 # tail")
        .replace("v 1.E+00 \\\n", "v 1e-300 \\\n")
        .replace("v 0 1e-400 00012 0.5", "v 0.25 1e-400 1e20 0.5");
    assert_eq!(text, want);
}

#[test]
fn line_ends_of_every_kind_stay() {
    for text in [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3",
        "v 0 0 0\r\nv 1 0 0\rv 0 1 0\nf 1 2 3",
    ] {
        let document = read(text.as_bytes());
        assert_eq!(document.mesh().faces().len(), 1, "{text:?}");
        let moved = with_points(&document, &[DVec3::ZERO, DVec3::X * 2.0, DVec3::Y]);
        assert_eq!(moved, text.replace("v 1 0 0", "v 2 0 0"));
    }
}

#[test]
fn faces_may_stand_before_their_vertices() {
    let document = read(b"f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n");
    assert_eq!(document.mesh().faces().face(0), [0, 1, 2]);
}

#[test]
fn relative_indices_count_from_where_they_stand() {
    let document = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -4 -3 -1\n");
    let faces: Vec<_> = document.mesh().faces().iter().map(<[u32]>::to_vec).collect();
    assert_eq!(faces, [[0, 1, 2], [0, 1, 3]]);
}

#[test]
fn a_face_of_two_corners_is_skipped_with_a_warning() {
    let document = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1// 2// 3//\nf 2\n");
    assert_eq!((document.mesh().faces().len(), document.faces_in_file()), (1, 3));
    assert!(document.warnings()[0].contains(": 2, the first in line 4"), "{:?}", document.warnings());
}

#[test]
fn a_repeated_corner_is_kept_with_a_warning() {
    let document = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 2\n");
    assert_eq!(document.mesh().faces().face(0), [0, 1, 2, 1]);
    assert!(document.warnings()[0].contains("more than once: 1"));
}

#[test]
fn a_weight_other_than_1_is_ignored_with_a_warning() {
    let document = read(b"v 2 2 2 1.0\nv 2 2 2 0.5\n");
    assert_eq!(document.mesh().points(), [DVec3::splat(2.0); 2]);
    assert!(document.warnings()[0].contains("line 2"), "{:?}", document.warnings());
}

#[test]
fn colours_may_be_anything() {
    let text = "v 0 0 0 nan nan nan\nv 1 0 0 1 0 0 1\n";
    assert_eq!(with_points(&read(text.as_bytes()), &[DVec3::Z, DVec3::X]), text.replace("v 0 0 0", "v 0 0 1"));
}

#[test]
fn a_text_without_vertices_is_empty() {
    for text in ["# nothing\n", "\n", "o x\ng y", "l\n"] {
        assert_eq!(read(text.as_bytes()).mesh().points().len(), 0, "{text:?}");
    }
}

#[test]
fn bad_numbers_are_refused_by_name() {
    for (number, words) in [
        ("nan", "'nan' is not a finite"),
        ("-inf", "'-inf'"),
        ("infinity", "'infinity'"),
        ("1e400", "'1e400' is beyond"),
        ("1,0", "'1,0' is not a number (write decimal points"),
        ("1.0D0", "'1.0D0'"),
        ("0x10", "'0x10'"),
        ("1.0.0", "'1.0.0'"),
        ("\\", "'\\\\'"),
        ("\u{ff11}", "is not a number"),
    ] {
        refused(format!("v 0 0 0\r\nv 1 {number} 0\n").as_bytes(), 2, words);
    }
}

#[test]
fn vertices_of_a_wrong_number_of_numbers_are_refused() {
    refused(b"v 0 0 0\nv 1 1 ", 2, "a vertex of 2 numbers");
    refused(b"v\n", 1, "a vertex of 0 numbers");
    refused(b"v 1 2 # 3\n", 1, "a vertex of 2 numbers");
    refused(b"v 1 2 3 4 5\n", 1, "a vertex of 5 numbers");
    refused(b"v 1 2 3 4 5 6 7 8\n", 1, "a vertex of 8 numbers");
}

#[test]
fn bad_indices_are_refused() {
    let with = |face: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf {face}\n").into_bytes();
    refused(&with("0 1 2"), 4, "vertex 0");
    refused(&with("1 2 4"), 4, "vertex 4, but the file has 3");
    refused(&with("1 2 -4"), 4, "vertex -4, but only 3");
    refused(&with("1 2 4294967298"), 4, "vertex 4294967298");
    refused(&with("1 2 99999999999999999999999"), 4, "'99999999999999999999999'");
    refused(&with("1 2 -9223372036854775808"), 4, "'-9223372036854775808'");
    refused(&with("1 2 3.0"), 4, "'3.0'");
    refused(&with("1 2 //3"), 4, "'//3'");
    refused(&with("1 2 3/x"), 4, "'3/x'");
    refused(&with("1 2 3//x"), 4, "'3//x'");
    refused(&with("1 2 3/1/1/1"), 4, "'3/1/1/1'");
    refused(&with("1 \\\n 2 \\\n 7"), 6, "vertex 7");
    refused(b"f 1 2 3\n", 1, "0 vertices");
}

#[test]
fn binary_data_is_refused_with_a_guess() {
    let hint = |bytes: Vec<u8>| Document::parse(bytes, Format::Obj).unwrap_err().hint().unwrap().to_owned();
    assert!(hint(b"v 0 0 \0\n".to_vec()).contains("export"));
    assert!(hint(vec![0; 84]).contains("looks like stl"));
    assert!(hint(b"ply\nformat binary_little_endian 1.0\n\0".to_vec()).contains("looks like ply"));
    assert!(hint(b"solid x\nfacet normal 0 0 1\n".to_vec()).contains("looks like stl"));
    assert!(hint(b"\xff\xfev\0 \0".to_vec()).contains("UTF-16"));
    refused(b"OFF\n8 6 12\n", 1, "'OFF' is not an OBJ statement");
    assert!(Document::parse(Vec::new(), Format::Obj).unwrap_err().what().contains("empty"));
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 0.6 0 0.8\nvn 1 0 0\nf 1//1 2//2 3//1\n";

fn with_jacobians(text: &str, jacobians: &[DMat3]) -> (String, Vec<String>) {
    let document = read(text.as_bytes());
    let options = WriteOptions { jacobians: Some(jacobians), ..Default::default() };
    let written = document.with_points(document.mesh().points(), &options).unwrap();
    (String::from_utf8(written.bytes).unwrap(), written.warnings)
}

fn normal(text: &str, k: usize) -> DVec3 {
    let line = text.lines().filter(|line| line.starts_with("vn")).nth(k).unwrap();
    let numbers: Vec<f64> = line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
    DVec3::from_slice(&numbers)
}

/// diag(2, 3, 4) carries (0.6, 0, 0.8) to the direction of (0.6/2, 0, 0.8/4) = (0.3, 0, 0.2), length 1 as before.
#[test]
fn normals_are_carried_at_their_length() {
    let (text, warnings) = with_jacobians(TRIANGLE, &[DMat3::from_diagonal(DVec3::new(2.0, 3.0, 4.0)); 3]);
    assert!(warnings.is_empty());
    assert!((normal(&text, 1) - DVec3::new(0.3, 0.0, 0.2).normalize()).length() < 1e-15);
    assert!(text.contains("vn 0 0 2\n"), "a direction that stays keeps its bytes: {text}");
    assert!(text.contains("vn 1 0 0\n"), "no corner uses it: {text}");
    let rotation = DMat3::from_rotation_y(0.3);
    let (text, _) = with_jacobians(TRIANGLE, &[rotation; 3]);
    assert!((normal(&text, 0) - rotation * DVec3::Z * 2.0).length() < 1e-15);
}

/// Two vertices turn the shared normal by +a and −a about y: the mean stays z. It is reported where a is over 1 degree.
#[test]
fn a_shared_normal_gets_the_mean() {
    let turned = |degrees: f64| {
        let turn = |sign: f64| DMat3::from_rotation_y(sign * degrees.to_radians());
        with_jacobians(TRIANGLE, &[turn(1.0), DMat3::IDENTITY, turn(-1.0)])
    };
    let (text, warnings) = turned(30.0);
    assert!((normal(&text, 0) - DVec3::Z * 2.0).length() < 1e-15);
    assert!(warnings[0].starts_with("1 shared normals"), "{warnings:?}");
    assert!(turned(0.9).1.is_empty());
}

#[test]
fn normals_without_a_direction_stay() {
    let text = TRIANGLE.replace("vn 0 0 2", "vn 0 0 0").replace("vn 0.6 0 0.8", "vn nan x");
    let (same, warnings) = with_jacobians(&text, &[DMat3::from_rotation_x(1.0); 3]);
    assert_eq!(same, text);
    assert!(warnings[0].contains("not three finite numbers"), "{warnings:?}");
    assert_eq!(warnings.len(), 1);
    let (same, warnings) = with_jacobians(TRIANGLE, &[DMat3::ZERO; 3]);
    assert_eq!((same.as_str(), warnings.len()), (TRIANGLE, 0));
}

#[test]
fn normals_that_do_not_exist_are_reported() {
    let document = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//0 3//-5\n");
    assert!(!document.has_normals());
    assert!(document.warnings()[0].contains("does not exist: 3"), "{:?}", document.warnings());
    let late = read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1//2 2 3\nvn 0 0 1\nvn 0 0 1\n");
    assert!(late.has_normals() && late.warnings().is_empty());
}
