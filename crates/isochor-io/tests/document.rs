//! Documents of every format: random files come back byte for byte but for what changed; new files of a mesh.

use glam::DVec3;
use isochor::{Faces, Mesh, Refinement};
use isochor_io::{Document, Format, NumberType, Place, WriteError, WriteOptions};
use proptest::prelude::*;

/// A part of a file.
#[derive(Clone, Debug)]
enum Piece {
    Fixed(Vec<u8>),
    /// A coordinate of a vertex as the file spells it.
    Coordinate {
        vertex: usize,
        axis: usize,
        bytes: Vec<u8>,
    },
}

/// How the coordinates of a file are spelled.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Spelling {
    /// Text, of 32 or 64 bits.
    Text { wide: bool },
    /// Binary, of 32 or 64 bits, of either byte order.
    Binary { wide: bool, big: bool },
}

impl Spelling {
    fn is_wide(self) -> bool {
        matches!(self, Self::Text { wide: true } | Self::Binary { wide: true, .. })
    }

    fn rounded(self, x: f64) -> f64 {
        if self.is_wide() { x } else { f64::from(x as f32) }
    }

    /// `x` as a file may spell it; `style` picks one of several ways.
    fn spelled(self, x: f64, style: u8) -> Vec<u8> {
        match self {
            Self::Text { .. } => [
                format!("{x}"),
                format!("{x:e}"),
                format!("{x:.3}"),
                format!("{x:+.4E}"),
                format!("{:.0}.", x.round()),
                format!("{x:+.20}"),
            ][usize::from(style) % 6]
                .clone()
                .into_bytes(),
            Self::Binary { wide: false, big: false } => (x as f32).to_le_bytes().to_vec(),
            Self::Binary { wide: false, big: true } => (x as f32).to_be_bytes().to_vec(),
            Self::Binary { wide: true, big: false } => x.to_le_bytes().to_vec(),
            Self::Binary { wide: true, big: true } => x.to_be_bytes().to_vec(),
        }
    }

    /// Length and value of the number at the start of `bytes`.
    fn number(self, bytes: &[u8]) -> (usize, f64) {
        match self {
            Self::Text { .. } => {
                let len = bytes.iter().position(|b| b" \t\r\n\\#".contains(b)).unwrap_or(bytes.len());
                (len, std::str::from_utf8(&bytes[..len]).unwrap().parse().unwrap())
            }
            Self::Binary { wide: false, big } => {
                let bits: [u8; 4] = bytes[..4].try_into().unwrap();
                (4, f64::from(if big { f32::from_be_bytes(bits) } else { f32::from_le_bytes(bits) }))
            }
            Self::Binary { wide: true, big } => {
                let bits: [u8; 8] = bytes[..8].try_into().unwrap();
                (8, if big { f64::from_be_bytes(bits) } else { f64::from_le_bytes(bits) })
            }
        }
    }
}

#[derive(Clone, Debug)]
struct File {
    format: Format,
    spelling: Spelling,
    pieces: Vec<Piece>,
}

impl File {
    fn new(format: Format, spelling: Spelling) -> Self {
        Self { format, spelling, pieces: Vec::new() }
    }

    fn fix(&mut self, bytes: impl AsRef<[u8]>) {
        self.pieces.push(Piece::Fixed(bytes.as_ref().to_vec()));
    }

    fn coordinate(&mut self, vertex: usize, axis: usize, x: f64, style: u8) {
        let bytes = self.spelling.spelled(x, style);
        self.pieces.push(Piece::Coordinate { vertex, axis, bytes });
    }

    fn bytes(&self) -> Vec<u8> {
        self.pieces.iter().flat_map(|(Piece::Fixed(bytes) | Piece::Coordinate { bytes, .. })| bytes.clone()).collect()
    }
}

/// Random bits that shape a file.
#[derive(Clone, Debug)]
struct Row {
    point: [f64; 3],
    styles: [u8; 3],
    odd: u8,
    end: u8,
}

fn rows() -> impl Strategy<Value = Vec<Row>> {
    let number =
        prop_oneof![4 => -100.0..100.0_f64, 1 => (-30..30_i32).prop_map(|e| 1.7 * 10.0_f64.powi(e)), 1 => Just(0.0)];
    let row = (prop::array::uniform3(number), any::<[u8; 3]>(), any::<u8>(), any::<u8>());
    prop::collection::vec(row.prop_map(|(point, styles, odd, end)| Row { point, styles, odd, end }), 1..12)
}

fn line_end(end: u8) -> &'static str {
    ["\n", "\r\n", "\r", "\n\n", "\n \t\r\n"][usize::from(end) % 5]
}

fn obj_file(rows: &[Row]) -> File {
    let mut file = File::new(Format::Obj, Spelling::Text { wide: true });
    let other =
        ["", "vt 0 1\n", "# v 1 2 3\r", "g a b\r\n", "usemtl x # y\n", "f 1 -1 1 # f\n", "l 1 2\n", "s off \\\n on\n"];
    for (vertex, row) in rows.iter().enumerate() {
        // Relative indices need a vertex before them.
        file.fix(other[usize::from(row.odd) % if vertex == 0 { 5 } else { 8 }]);
        file.fix([" v ", "v\t", "v \\\n ", "v  "][usize::from(row.odd) / 8 % 4]);
        for axis in 0..3 {
            file.coordinate(vertex, axis, row.point[axis], row.styles[axis]);
            file.fix([" ", "\t ", "\\\r\n ", "  "][usize::from(row.styles[axis]) / 6 % 4]);
        }
        file.fix(["", "1.0", "0.5 .5 5e-1", "# 1 2 3", "1 1 1 1 #"][usize::from(row.odd) / 32 % 5]);
        file.fix(line_end(row.end));
    }
    file.fix(format!("f{}", " 1//".repeat(3)));
    file
}

fn off_file(rows: &[Row], keyword: u8) -> File {
    let mut file = File::new(Format::Off, Spelling::Text { wide: true });
    let (keyword, more) = [
        ("OFF\n", ""),
        ("# 1 2 3\nCOFF ", " 255 0 00"),
        ("\tNOFF\r\n", " 0 .5 1"),
        ("STCN4OFF", " 1 0 0 1 9 9 9 9 1 0 # x"),
        ("nOFF 3\r", "\t#"),
    ][usize::from(keyword) % 5];
    file.fix(format!("{keyword}{} 2 0 # counts\n", rows.len()));
    for (vertex, row) in rows.iter().enumerate() {
        file.fix(["", "# 1 2 3\r\n", "\n \t", "  "][usize::from(row.odd) % 4]);
        for axis in 0..3 {
            file.coordinate(vertex, axis, row.point[axis], row.styles[axis]);
            if axis < 2 {
                file.fix([" ", "\t ", "  "][usize::from(row.styles[axis]) / 6 % 3]);
            }
        }
        file.fix(more);
        file.fix(line_end(row.end));
    }
    file.fix("3 0\n0 # half\n 0 255 0.5 # colour\n\n4 0 0 0 0");
    file
}

fn ply_file(rows: &[Row], spelling: Spelling, order: u8) -> File {
    let mut file = File::new(Format::Ply, spelling);
    let (text, big) = match spelling {
        Spelling::Text { .. } => (true, false),
        Spelling::Binary { big, .. } => (false, big),
    };
    let format = if text {
        "ascii"
    } else if big {
        "binary_big_endian"
    } else {
        "binary_little_endian"
    };
    let scalar = match (spelling.is_wide(), order % 2) {
        (true, 0) => "double",
        (true, _) => "float64",
        (false, 0) => "float",
        (false, _) => "float32",
    };
    let axes = [[0, 1, 2], [2, 1, 0], [1, 0, 2]][usize::from(order) % 3];
    let list = order & 4 != 0;
    let end = if order & 8 != 0 { "\r\n" } else { "\n" };
    let header = format!(
        "ply\nformat {format} 1.0\ncomment \u{e9}\nelement cell 1\nproperty list uint8 char n\nelement vertex {}\n{}{}property \
         uchar grey\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n",
        rows.len(),
        if list { "property list uchar char tags\n" } else { "" },
        axes.map(|axis| format!("property {scalar} {}\n", ["x", "y", "z"][axis])).concat(),
    );
    file.fix(header.replace('\n', end));
    file.fix(if text { &b"2 5 -6\n"[..] } else { &[2, 5, 250] });
    for (vertex, row) in rows.iter().enumerate() {
        if list {
            file.fix(if text { &b"1 65 "[..] } else { &[1, 65] });
        }
        for axis in axes {
            file.coordinate(vertex, axis, row.point[axis], row.styles[axis]);
            file.fix(if text { &b" \t"[..1 + usize::from(row.odd & 1)] } else { &[] });
        }
        file.fix(if text { format!("{}{}", row.odd, line_end(row.end)).into_bytes() } else { vec![row.odd] });
    }
    let corners = [3, 0, 0, (rows.len() - 1) as i32];
    if text {
        file.fix(corners.map(|c| c.to_string()).join(" "));
    } else {
        file.fix([3]);
        corners[1..].iter().for_each(|c| file.fix(if big { c.to_be_bytes() } else { c.to_le_bytes() }));
    }
    file
}

fn matches(
    file: &File,
    mesh: &Mesh,
    requested: &[DVec3],
    stored: &[DVec3],
    written: &[u8],
) -> Result<(), TestCaseError> {
    let mut at = 0;
    for piece in &file.pieces {
        match piece {
            Piece::Coordinate { vertex, axis, .. } if requested[*vertex][*axis] != mesh.points()[*vertex][*axis] => {
                let (len, x) = file.spelling.number(&written[at..]);
                prop_assert_eq!(file.spelling.rounded(x), file.spelling.rounded(requested[*vertex][*axis]));
                prop_assert_eq!(x, stored[*vertex][*axis]);
                at += len;
            }
            Piece::Fixed(bytes) | Piece::Coordinate { bytes, .. } => {
                prop_assert!(written[at..].starts_with(bytes), "at {}: {:?}", at, String::from_utf8_lossy(written));
                at += bytes.len();
            }
        }
    }
    prop_assert_eq!(at, written.len());
    Ok(())
}

/// Changes the coordinates that `choice` picks and looks at every byte that comes out.
fn check(file: &File, choice: &[(usize, usize, f64)]) -> Result<(), TestCaseError> {
    let bytes = file.bytes();
    let document = Document::parse(bytes.clone(), file.format);
    let document =
        document.map_err(|error| TestCaseError::fail(format!("{error}: {}", String::from_utf8_lossy(&bytes))))?;
    let mesh = document.mesh();
    for piece in &file.pieces {
        if let Piece::Coordinate { vertex, axis, bytes } = piece {
            prop_assert_eq!(mesh.points()[*vertex][*axis], file.spelling.number(bytes).1);
        }
    }
    let same = document.with_points(mesh.points(), &WriteOptions::default()).unwrap();
    prop_assert!(same.bytes == bytes && same.points == mesh.points());

    let mut requested = mesh.points().to_vec();
    for &(vertex, axis, x) in choice {
        requested[vertex % mesh.points().len()][axis] = x;
    }
    let written = document.with_points(&requested, &WriteOptions::default()).unwrap();
    matches(file, mesh, &requested, &written.points, &written.bytes)?;
    let again = Document::parse(written.bytes, file.format).unwrap();
    prop_assert_eq!(again.mesh().points(), &written.points[..]);
    prop_assert_eq!(again.mesh().faces(), mesh.faces());
    Ok(())
}

fn choice() -> impl Strategy<Value = Vec<(usize, usize, f64)>> {
    let number = prop_oneof![-10.0..10.0_f64, (-35..35_i32).prop_map(|e| -2.3 * 10.0_f64.powi(e))];
    prop::collection::vec((0..12_usize, 0..3_usize, number), 0..8)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    #[test]
    fn random_obj_files(rows in rows(), choice in choice()) {
        check(&obj_file(&rows), &choice)?;
    }

    #[test]
    fn random_off_files(rows in rows(), choice in choice(), keyword: u8) {
        check(&off_file(&rows, keyword), &choice)?;
    }

    #[test]
    fn random_ply_files(rows in rows(), choice in choice(), order: u8, text: bool, wide: bool, big: bool) {
        let spelling = if text { Spelling::Text { wide } } else { Spelling::Binary { wide, big } };
        check(&ply_file(&rows, spelling, order), &choice)?;
    }

    /// No bytes may bring a panic, and what is read must come back.
    #[test]
    fn damaged_files_never_panic(rows in rows(), order: u8, which in 0..6, at: prop::sample::Index, byte: u8, cut: bool) {
        let mut bytes = match which {
            0 => obj_file(&rows).bytes(),
            1 => ply_file(&rows, Spelling::Text { wide: false }, order).bytes(),
            2 => ply_file(&rows, Spelling::Binary { wide: true, big: false }, order).bytes(),
            3 => off_file(&rows, order).bytes(),
            4 => Document::from_mesh(&tetrahedron(), Format::Stl, NumberType::F32).unwrap().bytes().to_vec(),
            _ => b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n".to_vec(),
        };
        let at = at.index(bytes.len());
        if cut {
            bytes.truncate(at);
        } else {
            bytes[at] = byte;
        }
        for format in Format::ALL {
            if let Ok(document) = Document::parse(bytes.clone(), format) {
                let points = document.mesh().points();
                let same = document.with_points(points, &WriteOptions::default()).unwrap();
                prop_assert!(same.bytes == bytes);
                let moved: Vec<_> = points.iter().map(|p| *p * 0.5 + DVec3::X).collect();
                let _ = document.with_points(&moved, &WriteOptions::default());
                split_first_face(&document)?;
            }
        }
    }
}

/// Puts a triangle of two of its corners and their middle in place of the first face. What is written must be what was asked for.
fn split_first_face(document: &Document) -> Result<(), TestCaseError> {
    let mesh = document.mesh();
    let Some(face) = (!mesh.faces().is_empty()).then(|| mesh.faces().face(0)) else { return Ok(()) };
    let middle = [(0, 0.5), (1, 0.5), (2, 0.0)];
    let old = |k| [(k, 1.0), (0, 0.0), (0, 0.0)];
    let mut all = Refinement { vertices: vec![middle.map(|(k, w)| (face[k as usize], w))], ..Default::default() };
    all.faces.push(&[face[0], mesh.points().len() as u32, face[2]]);
    all.corners.extend([old(0), middle, old(2)]);
    for other in mesh.faces().iter().skip(1) {
        all.faces.push(other);
        all.corners.extend((0..other.len() as u32).map(old));
    }
    all.origins.extend(0..mesh.faces().len() as u32);
    let mut points = mesh.points().to_vec();
    points.push(points[face[0] as usize] / 2.0 + points[face[1] as usize] / 2.0);
    if let Ok(written) = document.refined(&points, &all, &WriteOptions::default()) {
        let again = Document::parse(written.bytes, document.format()).unwrap();
        let places =
            |points: &[DVec3], faces: &Faces| faces.corners().iter().map(|v| points[*v as usize]).collect::<Vec<_>>();
        prop_assert_eq!(places(again.mesh().points(), again.mesh().faces()), places(&written.points, &all.faces));
    }
    Ok(())
}

fn tetrahedron() -> Mesh {
    let points = vec![DVec3::new(0.1, 0.0, 0.0), DVec3::X, DVec3::Y, DVec3::Z];
    Mesh::new(points, Faces::from_iter(&[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])).unwrap()
}

#[test]
fn new_files_hold_the_mesh() {
    let mesh = tetrahedron();
    for (format, number, x) in [
        (Format::Obj, NumberType::F64, 0.1),
        (Format::Obj, NumberType::F32, 0.1),
        (Format::Ply, NumberType::F64, 0.1),
        (Format::Ply, NumberType::F32, f64::from(0.1_f32)),
        (Format::Stl, NumberType::F32, f64::from(0.1_f32)),
        (Format::Off, NumberType::F64, 0.1),
        (Format::Off, NumberType::F32, 0.1),
    ] {
        let document = Document::from_mesh(&mesh, format, number).unwrap();
        assert_eq!(document.mesh().points()[0].x, x, "{format:?} {number:?}");
        assert_eq!(document.mesh().points().len(), 4);
        assert_eq!(document.faces_in_file(), 4);
        assert_eq!(document.format(), format);
        assert!(document.warnings().is_empty());
        let again = Document::parse(document.bytes().to_vec(), format).unwrap();
        assert_eq!(again.mesh(), document.mesh());
    }
    let obj = Document::from_mesh(&mesh, Format::Obj, NumberType::F64).unwrap();
    assert!(obj.bytes().starts_with(b"v 0.1 0 0\nv 1 0 0\n") && obj.bytes().ends_with(b"f 2 3 4\n"));
    let off = Document::from_mesh(&mesh, Format::Off, NumberType::F64).unwrap();
    assert!(off.bytes().starts_with(b"OFF\n4 4 0\n0.1 0 0\n1 0 0\n") && off.bytes().ends_with(b"3 1 2 3\n"));
    let ply = Document::from_mesh(&mesh, Format::Ply, NumberType::F64).unwrap();
    assert_eq!((ply.number_type(), obj.number_type()), (NumberType::F64, NumberType::F64));
}

#[test]
fn stl_files_fan_polygons_with_unit_normals() {
    let square = [[0.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 3.0, 2.0], [0.0, 3.0, 2.0]].map(DVec3::from_array);
    let mesh = Mesh::new(square.to_vec(), Faces::from_iter([&[0_u32, 1, 2, 3][..]])).unwrap();
    let stl = Document::from_mesh(&mesh, Format::Stl, NumberType::F32).unwrap();
    assert_eq!(stl.mesh().faces().corners(), [0, 1, 2, 0, 2, 3]);
    let normal: Vec<_> = stl.bytes()[84..96].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(normal, [0.0, 0.0, 1.0]);
}

#[test]
fn new_ply_files_count_many_corners() {
    let points: Vec<_> = (0..300).map(|k| DVec3::new(f64::from(k).cos(), f64::from(k).sin(), 0.0)).collect();
    let face: Vec<u32> = (0..300).collect();
    let mesh = Mesh::new(points, Faces::from_iter([&face[..], &[0, 1, 2]])).unwrap();
    let ply = Document::from_mesh(&mesh, Format::Ply, NumberType::F64).unwrap();
    assert_eq!(ply.mesh(), &mesh);
    assert!(String::from_utf8_lossy(ply.bytes()).contains("property list uint int vertex_indices"));
}

#[test]
fn new_files_without_vertices_can_be_read_again() {
    for format in Format::ALL {
        let document = Document::from_mesh(&Mesh::default(), format, NumberType::F32).unwrap();
        assert_eq!(Document::parse(document.bytes().to_vec(), format).unwrap().mesh(), &Mesh::default());
    }
}

#[test]
fn new_files_that_are_refused() {
    let mesh = tetrahedron();
    assert_eq!(Document::from_mesh(&mesh, Format::Ply, NumberType::Integer).unwrap_err(), WriteError::NewInteger);
    assert_eq!(Document::from_mesh(&mesh, Format::Stl, NumberType::F64).unwrap_err(), WriteError::StlPrecision);
    let far = Mesh::new(vec![DVec3::ZERO, DVec3::Y * 1e39], Faces::new()).unwrap();
    let error = Document::from_mesh(&far, Format::Ply, NumberType::F32).unwrap_err();
    assert_eq!(error, WriteError::BeyondF32 { vertex: 1, axis: 'y', value: 1e39 });
}

#[test]
fn errors_name_the_file_the_place_and_what_to_do() {
    let folder = std::env::temp_dir().join(format!("isochor-io-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("Cube.OBJ");
    std::fs::write(&path, "v 0 0 0\nv 1 oops 0\n").unwrap();
    let error = Document::read(&path).unwrap_err();
    assert_eq!((error.path(), error.place()), (Some(path.as_path()), Some(Place::Line(2))));
    assert_eq!(error.what(), "'oops' is not a number");
    assert_eq!(error.to_string(), format!("{}: line 2: {} ({})", path.display(), error.what(), error.hint().unwrap()));
    std::fs::write(&path, "v 0 0 0\n").unwrap();
    assert_eq!(Document::read(&path).unwrap().mesh().points().len(), 1);
    let missing = Document::read(&folder.join("none.ply")).unwrap_err();
    assert!(missing.to_string().contains("no such file") && std::error::Error::source(&missing).is_some());
    assert!(Document::read(&folder.join("cube.step")).unwrap_err().what().contains("'.step'"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn formats_by_extension() {
    for (path, format) in
        [("a.obj", Format::Obj), ("b/c.PLY", Format::Ply), ("x.y.Stl", Format::Stl), ("d.OFF", Format::Off)]
    {
        assert_eq!(Format::from_path(path.as_ref()).unwrap(), format);
    }
    assert_eq!(Format::ALL.map(Format::name), ["obj", "ply", "stl", "off"]);
    for path in ["obj", "a.", "a.glb", ""] {
        assert!(Format::from_path(path.as_ref()).unwrap_err().hint().is_some());
    }
}
