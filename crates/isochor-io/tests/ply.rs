//! PLY documents: encodings, elements, normals, precision, what is refused.

use glam::{DMat3, DVec3};
use isochor_io::{Document, Format, NumberType, Place, Precision, WriteError, WriteOptions};

fn read(bytes: &[u8]) -> Document {
    Document::parse(bytes.to_vec(), Format::Ply).unwrap()
}

fn refused(bytes: &[u8], place: Place, words: &str) {
    let error = Document::parse(bytes.to_vec(), Format::Ply).unwrap_err();
    assert!(error.to_string().contains(words), "{error}");
    assert_eq!(error.place(), Some(place), "{error}");
    assert!(error.hint().is_some(), "{error}");
}

fn unchanged(document: &Document) {
    let same = document.with_points(document.mesh().points(), &WriteOptions::default()).unwrap();
    assert!(same.bytes == document.bytes());
}

const HEAD: &str = "format ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
element face 1\nproperty list uchar int vertex_indices\nend_header\n";
const BODY: &str = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

/// The triangle in ascii, with `old` replaced by `new` wherever it stands.
fn triangle(old: &str, new: &str) -> Vec<u8> {
    let text = format!("ply\n{HEAD}{BODY}");
    assert!(text.contains(old), "{old}");
    text.replace(old, new).into_bytes()
}

/// An odd binary file: an element with lists first, faces before vertices, lists within the vertices, normals before
/// coordinates, mixed types. `big` is the byte order.
fn odd_binary(big: bool) -> Vec<u8> {
    let header = format!(
        "ply\r\nformat binary_{}_endian 1.0\r\ncomment end_header \u{e9}\r\nelement camera 2\r\nproperty list uint8 float32 view\r\n\
         property double t\r\nobj_info x\r\nelement face 2\r\nproperty uchar red\r\nproperty list ushort uint vertex_index\r\n\
         property list char double uv\r\nelement vertex 4\r\nproperty float nx\r\nproperty list uchar short more\r\n\
         property float32 x\r\nproperty double ny\r\nproperty double y\r\nproperty int16 z\r\nproperty float nz\r\n\
         property uint8 grey\r\nelement tail 1\r\nproperty int n\r\nend_header\r\n",
        if big { "big" } else { "little" }
    );
    let mut bytes = header.into_bytes();
    let mut put = |little: &[u8]| {
        if big {
            bytes.extend(little.iter().rev());
        } else {
            bytes.extend(little);
        }
    };
    for view in [&[1.5_f32, 2.5][..], &[]] {
        put(&[view.len() as u8]);
        view.iter().for_each(|x| put(&x.to_le_bytes()));
        put(&7.0_f64.to_le_bytes());
    }
    for face in [&[0_u32, 1, 2][..], &[3, 2, 1, 0]] {
        put(&[200]);
        put(&(face.len() as u16).to_le_bytes());
        face.iter().for_each(|v| put(&v.to_le_bytes()));
        put(&[1]);
        put(&0.5_f64.to_le_bytes());
    }
    for (k, [x, y, z]) in [[0.0, 0.0, 0.0], [0.5, 0.1, 1.0], [0.0, 1.0, -2.0], [1.0, 1.0, 3.0]].into_iter().enumerate()
    {
        put(&0_f32.to_le_bytes());
        put(&[k as u8]);
        (0..k).for_each(|i| put(&(i as i16).to_le_bytes()));
        put(&(x as f32).to_le_bytes());
        put(&0.0_f64.to_le_bytes());
        put(&f64::to_le_bytes(y));
        put(&(z as i16).to_le_bytes());
        put(&2_f32.to_le_bytes());
        put(&[9]);
    }
    put(&(-5_i32).to_le_bytes());
    bytes
}

#[test]
fn odd_binary_files_are_read_and_kept() {
    for big in [false, true] {
        let document = read(&odd_binary(big));
        let want = [[0.0, 0.0, 0.0], [0.5, 0.1, 1.0], [0.0, 1.0, -2.0], [1.0, 1.0, 3.0]].map(DVec3::from_array);
        assert_eq!(document.mesh().points(), want);
        let faces: Vec<_> = document.mesh().faces().iter().map(<[u32]>::to_vec).collect();
        assert_eq!(faces, [vec![0, 1, 2], vec![3, 2, 1, 0]]);
        assert_eq!((document.vertices_in_file(), document.faces_in_file()), (4, 2));
        assert_eq!(document.number_type(), NumberType::Integer);
        assert!(document.has_normals() && document.warnings().is_empty());
        unchanged(&document);
    }
}

#[test]
fn odd_binary_files_are_changed_in_place() {
    for big in [false, true] {
        let document = read(&odd_binary(big));
        let mut points = document.mesh().points().to_vec();
        points[1].x = 0.3;
        points[3].y = 0.3;
        let written = document.with_points(&points, &WriteOptions::default()).unwrap();
        assert_eq!((written.points[1].x, written.points[3].y), (f64::from(0.3_f32), 0.3));
        assert_eq!(read(&written.bytes).mesh().points(), written.points);
        assert_eq!(written.bytes.len(), document.bytes().len());
        let differing = written.bytes.iter().zip(document.bytes()).filter(|(a, b)| a != b).count();
        assert!((1..=12).contains(&differing), "{differing} bytes differ");

        points[2].z = -2.5;
        let error = document.with_points(&points, &WriteOptions::default()).unwrap_err();
        assert_eq!(error, WriteError::Integer { vertex: 2, axis: 'z', value: -2.5 });
        assert!(error.hint().unwrap().contains("f64"));
    }
}

#[test]
fn precision_f64_widens_only_the_coordinates() {
    for big in [false, true] {
        let document = read(&odd_binary(big));
        let mut points = document.mesh().points().to_vec();
        points[1].x = 0.3;
        points[2].z = -2.5;
        let options = WriteOptions { precision: Precision::F64, ..Default::default() };
        let written = document.with_points(&points, &options).unwrap();
        assert_eq!(written.points, points);
        let again = read(&written.bytes);
        assert_eq!((again.mesh().points(), again.number_type()), (&points[..], NumberType::F64));
        assert_eq!(again.mesh().faces(), document.mesh().faces());
        let text = |bytes: &[u8]| String::from_utf8_lossy(&bytes[..bytes.len().min(600)]).into_owned();
        let header = |text: String| text[..text.rfind("end_header\r\n").unwrap()].to_owned();
        let want = header(text(document.bytes()))
            .replace("property float32 x", "property float64 x")
            .replace("property int16 z", "property float64 z");
        assert_eq!(header(text(&written.bytes)), want);
        // 4 rows of x (4 to 8 bytes) and z (2 to 8 bytes); the header grows by 2 letters for z.
        assert_eq!(written.bytes.len(), document.bytes().len() + 4 * 10 + 2);
        assert_eq!(written.bytes[written.bytes.len() - 4..], document.bytes()[document.bytes().len() - 4..]);
        // Once widened, nothing is left to do.
        assert_eq!(again.with_points(&points, &options).unwrap().bytes, written.bytes);
    }
}

#[test]
fn ascii_rows_keep_all_but_the_changed_numbers() {
    let text = "ply\r\nformat ascii 1.0\ncomment x\nelement vertex 3\rproperty list uchar int l\nproperty double x\n\
                property float y\r\nproperty int z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\n\
                end_header\n\n 2 7 8\t1.50  0 +3 255 \r\n0 1e0 0.1 -0 0\n\n1 5 0 1.000 3 9\r3 0 1 2\n\n  \n";
    let document = read(text.as_bytes());
    assert_eq!(document.mesh().points()[1], DVec3::new(1.0, 0.1, 0.0));
    assert!(document.warnings().is_empty());
    unchanged(&document);
    let points = [DVec3::new(0.1, 0.1, 3.0), DVec3::new(1.0, 0.123456789, 0.0), DVec3::new(0.0, 1.0, 3.0)];
    let written = document.with_points(&points, &WriteOptions::default()).unwrap();
    let want = text.replace("1.50  0 +3", "0.1  0.1 +3").replace("1e0 0.1 -0", "1e0 0.12345679 -0");
    assert_eq!(String::from_utf8(written.bytes.clone()).unwrap(), want);
    assert_eq!(read(&written.bytes).mesh().points(), written.points);

    let points = [DVec3::new(0.1, 0.1, 3.5), DVec3::new(1.0, 0.123456789, 0.0), DVec3::new(0.0, 1.0, 3.0)];
    let options = WriteOptions { precision: Precision::F64, ..Default::default() };
    let written = document.with_points(&points, &options).unwrap();
    let want = text
        .replace("float y", "double y")
        .replace("int z", "double z")
        .replace("1.50  0 +3", "0.1  0.1 3.5")
        .replace("1e0 0.1 -0", "1e0 0.123456789 -0");
    assert_eq!(String::from_utf8(written.bytes).unwrap(), want);
    assert_eq!(written.points, points);
}

#[test]
fn headers_of_every_line_end_before_a_binary_body() {
    // The first coordinate starts with the byte of a LF.
    let rows: Vec<u8> = [f32::from_bits(0x3f80_000a), 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for end in ["\n", "\r\n", "\r"] {
        let document = read(&[head.replace('\n', end).as_bytes(), &rows].concat());
        assert_eq!(document.mesh().points()[0].z, 3.0, "{end:?}");
        assert!(document.warnings().is_empty());
    }
}

/// −1 starts a new strip; 2 2 in a strip makes triangles without area.
#[test]
fn triangle_strips_alternate() {
    let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n12 0 1 2 3 -1 0 1 2 2 3 4 -1\n";
    let document = read(text.as_bytes());
    let faces: Vec<_> = document.mesh().faces().iter().map(<[u32]>::to_vec).collect();
    assert_eq!(faces, [[0, 1, 2], [2, 1, 3], [0, 1, 2], [3, 2, 4]]);
    assert_eq!(document.faces_in_file(), 4);
    assert!(document.warnings()[0].contains("more than once") || document.warnings()[0].contains("twice"));
    unchanged(&document);
    refused(text.replace("12 0 1", "12 0 5").as_bytes(), Place::Line(15), "vertex 5");
    refused(text.replace("12 0 1", "12 0 -2").as_bytes(), Place::Line(15), "vertex -2");
}

#[test]
fn empty_models_are_read_where_the_header_says_so() {
    assert_eq!(read(&triangle("face 1", "face 0")).mesh().faces().len(), 0);
    let nothing = format!("ply\n{HEAD}").replace("vertex 3", "vertex 0").replace("face 1", "face 0");
    assert_eq!(read(nothing.as_bytes()).mesh().points().len(), 0);
    let points = format!("ply\n{HEAD}0 0 0\n1 0 0\n0 1 0")
        .replace("element face 1\nproperty list uchar int vertex_indices\n", "");
    assert_eq!(read(points.as_bytes()).mesh().points().len(), 3);
}

#[test]
fn faces_of_few_corners_are_skipped_with_a_warning() {
    let document =
        read(&triangle("element face 1", "element face 3").iter().copied().chain(*b"0\n2 0 1\n").collect::<Vec<_>>());
    assert_eq!((document.mesh().faces().len(), document.faces_in_file()), (1, 3));
    assert!(document.warnings()[0].contains(": 2, the first at line 14"), "{:?}", document.warnings());
    unchanged(&document);
}

#[test]
fn bytes_behind_the_body_are_kept_with_a_warning() {
    let document = read(&triangle("3 0 1 2\n", "3 0 1 2\n\nbye\n"));
    assert!(document.warnings()[0].contains("not read: 4"), "{:?}", document.warnings());
    unchanged(&document);
}

/// Some programs announce four colours and write ten.
#[test]
fn surplus_numbers_behind_a_face_are_kept_with_a_warning() {
    let document = read(&triangle("3 0 1 2\n", "3 0 1 2 9 1 1\n"));
    assert_eq!(document.mesh().faces().len(), 1);
    assert!(document.warnings()[0].contains(": 1, the first in line 13"), "{:?}", document.warnings());
    // With rows left over it means that a count is wrong.
    refused(&triangle("3 0 1 2\n", "3 0 1 2 9 1 1\n3 0 1 2\n"), Place::Line(13), "'9' is one number too many");
}

#[test]
fn headers_that_are_refused() {
    refused(&triangle("ply\n", ""), Place::Line(1), "line 'ply'");
    refused(&triangle("ply\n", "plymouth\n"), Place::Line(1), "line 'ply'");
    refused(&triangle("format ascii 1.0", "format binary_middle_endian 1.0"), Place::Line(2), "'binary_middle_endian'");
    refused(&triangle("1.0", "2.0"), Place::Line(2), "'2.0'");
    refused(&triangle("end_header\n", ""), Place::Line(9), "not understood");
    refused(format!("ply\n{HEAD}").replace("end_header\n", "").as_bytes(), Place::Line(9), "no 'end_header'");
    refused(&triangle("float y", "half y"), Place::Line(5), "'half'");
    refused(&triangle("float z", "float w"), Place::Line(3), "no property 'z'");
    refused(&triangle("float z", "float y"), Place::Line(6), "property 'y' is announced twice");
    refused(
        &triangle("property float z", "property list uchar float z"),
        Place::Line(3),
        "'z' of the vertices is a list",
    );
    refused(&triangle("element face", "element vertex"), Place::Line(7), "element 'vertex' is announced twice");
    refused(&triangle("element vertex", "element point"), Place::Line(1), "no element 'vertex'");
    refused(&triangle("vertex 3", "vertex -3"), Place::Line(3), "'-3'");
    refused(&triangle("vertex 3", "vertex 3.0"), Place::Line(3), "'3.0'");
    refused(&triangle("vertex 3", "vertex 99999999999999999999"), Place::Line(3), "'99999999999999999999'");
    refused(&triangle("list uchar int", "list float int"), Place::Line(8), "count type 'float'");
    refused(&triangle("list uchar int", "list uchar float"), Place::Line(7), "no list of integers");
    refused(&triangle("vertex_indices", "corners"), Place::Line(7), "no list 'vertex_indices'");
    refused(&triangle("property float x", "property float"), Place::Line(4), "not understood");
    refused(&triangle("element vertex 3\n", ""), Place::Line(3), "before any element");
    let error = Document::parse(triangle("format ascii 1.0\n", ""), Format::Ply).unwrap_err();
    assert!(error.what().contains("no 'format' line"));
}

#[test]
fn counts_are_checked_before_memory_is_taken() {
    for count in ["4000000000", "18446744073709551615"] {
        refused(&triangle("face 1", &format!("face {count}")), Place::Line(7), "announced");
        for format in ["ascii", "binary_big_endian"] {
            let text = format!("ply\n{HEAD}{BODY}").replace("ascii", format);
            refused(text.replace("vertex 3", &format!("vertex {count}")).as_bytes(), Place::Line(3), "announced");
        }
    }
    refused(&triangle("3 0 1 2", "300000000 0 1 2"), Place::Line(13), "a list of 300000000 numbers");
    refused(&triangle("3 0 1 2", "-3 0 1 2"), Place::Line(13), "a list of -3 numbers");
}

#[test]
fn ascii_rows_that_are_refused() {
    refused(&triangle("\n1 0 0\n", "\n1 0\n"), Place::Line(11), "too few numbers");
    refused(&triangle("\n1 0 0\n", "\n1 0 0 0\n"), Place::Line(11), "'0' is one number too many");
    refused(&triangle("\n1 0 0\n", "\n1 nan 0\n"), Place::Line(11), "'nan'");
    refused(&triangle("\n1 0 0\n", "\n1 0,5 0\n"), Place::Line(11), "'0,5'");
    refused(&triangle("3 0 1 2", "3 0 1 3"), Place::Line(13), "vertex 3, but there are 3");
    refused(&triangle("3 0 1 2", "3 0 1 -1"), Place::Line(13), "vertex -1");
    refused(&triangle("3 0 1 2", "3 0 1"), Place::Line(13), "too few numbers");
    refused(&triangle("3 0 1 2", "3 0 1 2.5"), Place::Line(13), "'2.5' is not an integer");
    refused(&triangle("element vertex 3", "element vertex 2"), Place::Line(12), "one number too many");
    refused(&triangle("element face 1", "element face 2"), Place::Line(14), "the text ends before the last of 2 rows");
    refused(
        &triangle("float x", "int x").iter().map(|&b| if b == b'1' { b'.' } else { b }).collect::<Vec<_>>(),
        Place::Line(2),
        "'.",
    );
    assert!(Document::parse(Vec::new(), Format::Ply).is_err());
}

#[test]
fn binary_bodies_that_are_refused() {
    let document = read(&triangle("ply", "ply"));
    let whole = Document::from_mesh(document.mesh(), Format::Ply, NumberType::F32).unwrap().bytes().to_vec();
    let body = whole.len() - 36 - 13;
    assert!(Document::parse(whole.clone(), Format::Ply).is_ok());
    refused(&whole[..body], Place::Line(3), "but only 0 bytes are left");
    refused(&whole[..body + 20], Place::Line(3), "but only 20 bytes are left");
    refused(&whole[..body + 36 + 9], Place::Byte(body + 36), "a list of 3 numbers, but only 8 bytes are left");
    let put = |at: usize, bytes: &[u8]| [&whole[..at], bytes, &whole[at + bytes.len()..]].concat();
    refused(&put(body + 4, &f32::NAN.to_le_bytes()), Place::Byte(body + 4), "NaN is not a finite");
    refused(&put(body + 36 + 9, &3_i32.to_le_bytes()), Place::Byte(body + 36), "vertex 3, but there are 3");
    refused(&put(body + 36 + 9, &(-1_i32).to_le_bytes()), Place::Byte(body + 36), "vertex -1");
    let text = |old: &str, new: &str| {
        let at = whole.windows(old.len()).position(|w| w == old.as_bytes()).unwrap();
        [&whole[..at], new.as_bytes(), &whole[at + old.len()..]].concat()
    };
    refused(&text("face 1", "face 2"), Place::Byte(whole.len()), "within a row");
    let error = Document::parse(text("little", "big"), Format::Ply).unwrap_err();
    assert!(error.hint().unwrap().contains("byte order"), "{error}");
    let error = Document::parse(text("uchar int", "char int"), Format::Ply);
    assert!(error.is_ok());
}

const WITH_NORMALS: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
property double nx\nproperty double ny\nproperty double nz\nend_header\n\
0 0 0 0 0 2.00\n1 0 0 0.6 0 0.8\n0 1 0 0 0 0\n0 0 1 nan 0 1\n";

/// A shear x' = x + y/2 has cof(J) = (1 0 0; −1/2 1 0; 0 0 1): (0.6, 0, 0.8) goes to the direction (0.6, −0.3, 0.8).
#[test]
fn vertex_normals_are_carried() {
    let document = read(WITH_NORMALS.as_bytes());
    assert!(document.has_normals());
    let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.5, 1.0, 0.0), DVec3::Z);
    let jacobians = [shear; 4];
    let options = WriteOptions { jacobians: Some(&jacobians), ..Default::default() };
    let written = document.with_points(document.mesh().points(), &options).unwrap();
    let text = String::from_utf8(written.bytes).unwrap();
    let row = |text: &str, k: usize| {
        let line = text.lines().nth(10 + k).unwrap();
        DVec3::from_slice(&line.split(' ').skip(3).map(|word| word.parse().unwrap()).collect::<Vec<f64>>())
    };
    assert!((row(&text, 1) - DVec3::new(0.6, -0.3, 0.8).normalize()).length() < 1e-15);
    assert!(text.contains("0 0 0 0 0 2.00\n"), "a normal that stays keeps its bytes: {text}");
    assert!(text.contains("0 1 0 0 0 0\n0 0 1 nan 0 1\n"), "normals without a direction stay: {text}");

    let rotation = DMat3::from_rotation_x(0.4);
    let jacobians = [rotation, DMat3::IDENTITY, rotation, rotation];
    let options = WriteOptions { jacobians: Some(&jacobians), ..Default::default() };
    let text = String::from_utf8(document.with_points(document.mesh().points(), &options).unwrap().bytes).unwrap();
    assert!((row(&text, 0) - rotation * DVec3::Z * 2.0).length() < 1e-15);
    assert!(text.contains("1 0 0 0.6 0 0.8\n"));

    let integers = WITH_NORMALS.replace("double nz", "char nz");
    assert!(!read(integers.as_bytes()).has_normals());
}

#[test]
fn requests_that_are_refused() {
    let document = read(&triangle("ply", "ply"));
    let points = document.mesh().points().to_vec();
    let error = |points: &[DVec3], options: &WriteOptions| document.with_points(points, options).unwrap_err();
    let options = WriteOptions::default();
    assert_eq!(error(&points[1..], &options), WriteError::PointCount { points: 2, vertices: 3 });
    let jacobians = [DMat3::IDENTITY; 2];
    let few = WriteOptions { jacobians: Some(&jacobians), ..options };
    assert_eq!(error(&points, &few), WriteError::JacobianCount { jacobians: 2, vertices: 3 });
    let jacobians = [DMat3::IDENTITY, DMat3::NAN, DMat3::IDENTITY];
    let nan = WriteOptions { jacobians: Some(&jacobians), ..options };
    assert_eq!(error(&points, &nan), WriteError::JacobianNotFinite { vertex: 1 });
    let mut bad = points.clone();
    bad[2].z = f64::INFINITY;
    assert_eq!(error(&bad, &options), WriteError::NotFinite { vertex: 2, axis: 'z', value: f64::INFINITY });
    bad[2].z = -4e38;
    assert_eq!(error(&bad, &options), WriteError::BeyondF32 { vertex: 2, axis: 'z', value: -4e38 });
    let f64 = WriteOptions { precision: Precision::F64, ..options };
    assert_eq!(document.with_points(&bad, &f64).unwrap().points, bad);
}

/// A tetrahedron in a binary body with a property beside x, y and z; `counts` are those of its four faces, which all name 0 2 1 3.
fn plain_binary(big: bool, counts: [u8; 4]) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float y\nproperty uchar grey\nproperty double x\n\
         property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut put = |little: &[u8]| match big {
        true => bytes.extend(little.iter().rev()),
        false => bytes.extend(little),
    };
    for v in 0..4u8 {
        put(&(f32::from(v) + 0.5).to_le_bytes());
        put(&[v]);
        put(&(f64::from(v) / 3.0).to_le_bytes());
        put(&(-f32::from(v * v)).to_le_bytes());
    }
    for count in counts {
        put(&[count]);
        [0i32, 2, 1, 3][..usize::from(count)].iter().for_each(|v| put(&v.to_le_bytes()));
    }
    bytes
}

#[test]
fn rows_of_one_size_are_read_and_written_like_any_others() {
    for counts in [[3; 4], [3, 3, 4, 3], [4; 4], [3, 2, 3, 3]] {
        let [little, big] = [false, true].map(|big| read(&plain_binary(big, counts)));
        assert_eq!(little.mesh(), big.mesh(), "{counts:?}");
        assert_eq!(little.warnings().len(), big.warnings().len());
        let at = |v: f64| DVec3::new(v / 3.0, v + 0.5, -v * v);
        assert_eq!(little.mesh().points(), [0.0, 1.0, 2.0, 3.0].map(at));
        unchanged(&little);
        // One coordinate changes, in its own row.
        let mut points = little.mesh().points().to_vec();
        points[2].x = 0.1;
        points[3].z = -0.25;
        let [a, b] = [&little, &big].map(|d| d.with_points(&points, &WriteOptions::default()).unwrap());
        assert_eq!(a.points, points);
        assert_eq!(read(&a.bytes).mesh(), read(&b.bytes).mesh());
        let changed = (0..a.bytes.len()).filter(|i| a.bytes[*i] != little.bytes()[*i]).count();
        assert!((2..=12).contains(&changed), "{changed} bytes: a double and a float");
    }
}

#[test]
fn rows_of_one_size_are_refused_like_any_others() {
    let whole = plain_binary(false, [3; 4]);
    let body = whole.len() - 4 * 13 - 4 * 17;
    let with = |at: usize, number: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + number.len()].copy_from_slice(number);
        bytes
    };
    refused(&with(body + 17, &f32::NAN.to_le_bytes()), Place::Byte(body + 17), "finite");
    refused(&with(body + 2 * 17 + 5, &f64::INFINITY.to_le_bytes()), Place::Byte(body + 2 * 17 + 5), "finite");
    let faces = body + 4 * 17;
    refused(&with(faces + 13 + 1, &4u32.to_le_bytes()), Place::Byte(faces + 13), "names vertex 4");
    refused(&with(faces + 13 + 5, &(-1i32).to_le_bytes()), Place::Byte(faces + 13), "names vertex -1");
    for missing in 1..14 {
        assert!(Document::parse(whole[..whole.len() - missing].to_vec(), Format::Ply).is_err(), "{missing}");
    }
}
