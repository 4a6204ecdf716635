//! OFF documents: what is kept, what is changed, what is refused.

use glam::{DMat3, DVec3};
use isochor_io::{Document, Format, NumberType, Place, WriteOptions};

fn read(text: &str) -> Document {
    Document::parse(text.into(), Format::Off).unwrap()
}

fn faces(document: &Document) -> Vec<Vec<u32>> {
    document.mesh().faces().iter().map(<[u32]>::to_vec).collect()
}

/// The text is refused in this line, with these words in the message.
fn refused(text: &str, line: usize, words: &str) {
    let error = Document::parse(text.into(), Format::Off).unwrap_err();
    assert_eq!(error.place(), Some(Place::Line(line)), "{error}");
    assert!(error.to_string().contains(words), "{error}");
    assert!(error.hint().is_some(), "{error}");
}

const ODD: &str = "\u{feff}# \u{e9}\n\n\tOFF # keyword\r\n# counts\r 4 3 7 # of them\n\n  +1. 0 -.0e-3 # tail 1 2\n1.E+00\t2 \t 3.50\r\n\
                   #\n0 1e-400 00012\n1 1 1\n\n3 0 1 2  255 0 0 # red\n4\n 3 2 # half\n 1\r0 0.5 .5 5e-1 1\n2 0 1\n\n# end";

#[test]
fn everything_odd_but_legal_is_read_and_kept() {
    let document = read(ODD);
    let points = [DVec3::X, DVec3::new(1.0, 2.0, 3.5), DVec3::new(0.0, 0.0, 12.0), DVec3::ONE];
    assert_eq!(document.mesh().points(), points);
    assert_eq!(faces(&document), [vec![0, 1, 2], vec![3, 2, 1, 0]]);
    assert_eq!((document.vertices_in_file(), document.faces_in_file()), (4, 3));
    assert_eq!((document.format(), document.number_type()), (Format::Off, NumberType::F64));
    assert!(!document.has_normals());
    assert_eq!(document.warnings(), ["Faces of fewer than 3 corners that are not read: 1, the first in line 18."]);
    let same = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(String::from_utf8(same.bytes).unwrap(), ODD);
}

#[test]
fn only_changed_coordinates_change() {
    let document = read(ODD);
    let mut points = document.mesh().points().to_vec();
    points[0].y = -0.1;
    points[1].x = 1e-300;
    points[2] = DVec3::new(0.25, 0.0, 1e20);
    let written = document.with_points(&points, &WriteOptions::default()).unwrap();
    assert_eq!(written.points, points);
    let want = ODD
        .replace("+1. 0 -.0e-3 #", "+1. -0.1 -.0e-3 #")
        .replace("1.E+00\t2", "1e-300\t2")
        .replace("0 1e-400 00012", "0.25 1e-400 1e20");
    assert_eq!(String::from_utf8(written.bytes).unwrap(), want);
}

const POINTS: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

#[test]
fn keywords_tell_what_stands_in_the_line_of_a_vertex() {
    for (keyword, more) in [
        ("OFF\n", ""),
        ("", ""),
        ("COFF\n", " 255 0 0"),
        ("COFF\n", " 0.5 .5 1 1"),
        ("NOFF\n", " 0 0 1"),
        ("CNOFF\n", " 0 0 1 255 0 0 255"),
        ("STOFF\n", " 0.5 0.25"),
        ("STCNOFF\n", " 0 0 1 1 0 0 0.5 0.25"),
        ("4OFF\n", " 1.0"),
        ("ST4OFF\n", " 1 0.5 0.25"),
        ("nOFF\n3\n", ""),
        ("4nOFF 3\n", " 1"),
    ] {
        let text = format!("{keyword}3 1 3\n0 0 0{more}\n1 0 0{more}\n0 1 0{more}\n3 0 1 2\n");
        let document = read(&text);
        assert_eq!(document.mesh().points(), POINTS, "{text}");
        assert_eq!(document.has_normals(), keyword.contains('N'), "{text}");
        assert!(document.warnings().is_empty(), "{:?}", document.warnings());
        let moved = document.with_points(&POINTS.map(|p| p * 2.0), &WriteOptions::default()).unwrap();
        let want = text.replace("\n1 0 0", "\n2 0 0").replace("\n0 1 0", "\n0 2 0");
        assert_eq!(String::from_utf8(moved.bytes).unwrap(), want);
    }
}

#[test]
fn counts_may_stand_behind_the_keyword_or_be_glued_to_it() {
    for head in ["OFF 3 1 0", "OFF3 1 0 # or so", " \t OFF\n\n3 1 0"] {
        let document = read(&format!("{head}\n0 0 0\n1 0 0\n0 1 0\n3 2 0 1"));
        assert_eq!((document.mesh().points(), faces(&document)), (&POINTS[..], vec![vec![2, 0, 1]]), "{head}");
    }
}

#[test]
fn line_ends_of_every_kind_stay() {
    for end in ["\n", "\r", "\r\n"] {
        let text = ["OFF", "3 1 0", "0 0 0", "1 0 0", "0 1 0", "3 0 1 2"].join(end);
        let written = read(&text).with_points(&[DVec3::ZERO, DVec3::X * 2.0, DVec3::Y], &WriteOptions::default());
        assert_eq!(String::from_utf8(written.unwrap().bytes).unwrap(), text.replace("1 0 0", "2 0 0"));
    }
}

#[test]
fn oddities_are_said() {
    let said = |text: &str, words: &str| {
        let document = read(text);
        assert!(document.warnings().iter().any(|w| w.contains(words)), "{:?}", document.warnings());
        document
    };
    let more = said(
        "OFF\n3 1 0\n0 0 0\n1 0 0 9 9 9\n0 1 0 9 9 9 9\n3 0 1 2\n",
        "announces, kept as they are: 2, the first in line 4",
    );
    assert_eq!(more.mesh().points(), POINTS);
    said(
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 1 2 3 4 5\n",
        "than a colour has, kept as they are: 1, the first in line 6",
    );
    said("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1\n", "more than once: 1");
    // Programs that write N before C put the colours first.
    let mixed = said(
        "NCOFF\n3 1 0\n0 0 0 9 9 9 9 0 0 1\n1 0 0 9 9 9 9 0 0 1\n0 1 0 9 9 9 9 0 0 1\n3 0 1 2\n",
        "programs differ",
    );
    assert!(!mixed.has_normals());
}

#[test]
fn bad_numbers_are_refused_by_name() {
    for (number, words) in
        [("nan", "'nan' is not a finite"), ("1e400", "'1e400' is beyond"), ("1,0", "points, not commas"), ("x", "'x'")]
    {
        refused(&format!("OFF\n3 1 0\n0 0 0\n1 {number} 0\n0 1 0\n3 0 1 2\n"), 4, words);
    }
}

#[test]
fn heads_that_are_none_are_refused() {
    refused("COFFEE\n", 1, "are not three numbers");
    refused("FFO\n3 1 0\n", 1, "'FFO' is no keyword of OFF");
    refused("CCOFF\n3 1 0\n", 1, "'CCOFF' is no keyword of OFF");
    refused("ply\nformat ascii 1.0\n", 1, "'ply' is no keyword of OFF");
    refused("# nothing\n", 2, "'' is no keyword");
    refused("OFF BINARY\n\0\0\0\x03", 1, "a binary OFF file");
    refused("nOFF\n4\n3 1 0\n", 2, "points of '4' dimensions");
    refused("nOFF\n", 2, "points of '' dimensions");
    refused("OFF\n", 2, "are not three numbers");
    refused("OFF\n3 1\n0 0 0\n", 2, "are not three numbers");
    refused("OFF\n3 1 0 0\n", 2, "are not three numbers");
    refused("OFF\n-3 1 0\n", 2, "'-3' is no number of vertices");
    refused("OFF\n3 1.5 0\n", 2, "'1.5' is no number of faces");
    refused("OFF\n3 1 99999999999999999999\n", 2, "is no number of edges");
    let error = Document::parse(b"OFF\n3 1 0\n0 0 \0\n".to_vec(), Format::Off).unwrap_err();
    assert_eq!(error.place(), Some(Place::Byte(14)), "{error}");
    assert!(Document::parse(b"OFF\n3 1 0\n".to_vec(), Format::Obj).unwrap_err().hint().unwrap().contains(".off"));
}

#[test]
fn counts_that_do_not_fit_are_refused() {
    refused("OFF\n4000000000 12 0\n0 0 0\n", 2, "only 6 bytes are left");
    refused("OFF\n0 9223372036854775807 0\n0 0 0\n", 2, "only 6 bytes are left");
    let body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0\n";
    refused(&format!("OFF\n4 1 0\n{body}"), 6, "a vertex of 4 numbers");
    refused(&format!("OFF\n2 3 0\n{body}"), 6, "names vertex 2, but there are 2 vertices");
    refused(&format!("OFF\n3 1 0\n{body}"), 7, "'3' stands behind the last of 1 faces");
    refused(&format!("OFF\n3 3 0\n{body}"), 8, "the text ends before the last of 3 faces");
    refused("OFF\n0 0 0\n0 0 0\n", 3, "stands behind the last of 0 faces");
    refused("OFF\n2 0 0\n0 0 0\n # 1 0 0\n", 5, "the text ends before the last of 2 vertices");
}

#[test]
fn vertices_of_a_wrong_number_of_numbers_are_refused() {
    let with = |keyword: &str, row: &str| format!("{keyword}\n3 1 0\n0 0 0\n{row}\n0 1 0\n3 0 1 2\n");
    refused(&with("OFF", "1 0"), 4, "a vertex of 2 numbers");
    refused(&with("OFF", "1 0 0 0"), 4, "a vertex of 4 numbers");
    refused(&with("OFF", "1 0 0 0 0 0 0 0"), 4, "a vertex of 8 numbers");
    refused(&with("COFF", "1 0 0"), 3, "a vertex is a line of 6 or 7 numbers");
    refused(&with("4NOFF", "1 0 0"), 3, "a vertex is a line of 7 numbers");
    refused("4OFF\n1 0 0\n1 0 0 0.5\n", 3, "the weight '0.5'");
}

#[test]
fn bad_faces_are_refused() {
    let with = |face: &str| format!("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n{face}\n");
    refused(&with("3 0 1 3"), 6, "vertex 3, but there are 3 vertices");
    refused(&with("3 0 1 -1"), 6, "vertex -1");
    refused(&with("3 0 1 4294967296"), 6, "vertex 4294967296");
    refused(&with("3 0 1 2.0"), 6, "'2.0' is not the index");
    refused(&with("-3 0 1 2"), 6, "'-3' is no number of corners");
    refused(&with("300000000 0 1 2"), 6, "a face of 300000000 corners");
    refused(&with("3 0 1 # cut"), 7, "the text ends");
}

/// diag(2, 3, 4) carries (0.6, 0, 0.8) to the direction of (0.6/2, 0, 0.8/4) = (0.3, 0, 0.2), length 1 as before.
#[test]
fn normals_are_carried_at_their_length() {
    let text =
        "CNOFF\n4 1 0\n0 0 0 0 0 2 1 0 0\n1 0 0 0.6 0 0.8 1 0 0\n0 1 0 0 nan 1 1 0 0\n0 0 1 0 0 0 1 0 0\n3 0 1 2\n";
    let document = read(text);
    let with = |jacobian: DMat3| {
        let options = WriteOptions { jacobians: Some(&[jacobian; 4]), ..Default::default() };
        let written = document.with_points(document.mesh().points(), &options).unwrap();
        (String::from_utf8(written.bytes).unwrap(), written.warnings)
    };
    let (written, warnings) = with(DMat3::from_diagonal(DVec3::new(2.0, 3.0, 4.0)));
    assert_eq!(warnings, ["Normals that are not three finite numbers and stay as they are: 1."]);
    let numbers: Vec<f64> = written.lines().nth(3).unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    let found = DVec3::from_slice(&numbers[3..6]);
    assert!((found - DVec3::new(0.3, 0.0, 0.2).normalize()).length() < 1e-15);
    let others = |text: &str| {
        text.lines().enumerate().filter(|line| line.0 != 3).map(|line| line.1.to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(others(&written), others(text), "a direction that stays keeps its bytes, and so does what is none");
    assert_eq!(with(DMat3::IDENTITY), (text.to_owned(), Vec::new()));
}
