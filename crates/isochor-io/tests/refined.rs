//! Files whose mesh got added vertices and split faces. What depends linearly on the position in the old file must do so in the new one.

use glam::{DMat3, DVec3};
use isochor::{Faces, Mesh, MeshError, Refinement};
use isochor_io::{Document, Format, Precision, RefinementError, WriteError, WriteOptions, Written};
use proptest::prelude::*;

const DEFAULTS: WriteOptions = WriteOptions { precision: Precision::File, jacobians: None };

/// A corner that is corner `k` of its old face.
fn old(k: usize) -> [(u32, f64); 3] {
    [(k as u32, 1.0), (0, 0.0), (0, 0.0)]
}

/// The triangles from a point within each of some faces to its edges; the other faces stay. A point is a mix of the first three corners.
fn starred(mesh: &Mesh, stars: &[(usize, [f64; 3])]) -> Refinement {
    let mut all = Refinement::default();
    for (f, face) in mesh.faces().iter().enumerate() {
        let n = face.len();
        let Some(&(_, weights)) = stars.iter().find(|star| star.0 == f) else {
            all.faces.push(face);
            all.origins.push(f as u32);
            all.corners.extend((0..n).map(old));
            continue;
        };
        let vertex = (mesh.points().len() + all.vertices.len()) as u32;
        all.vertices.push(std::array::from_fn(|k| (face[k], weights[k])));
        for k in 0..n {
            all.faces.push(&[face[k], face[(k + 1) % n], vertex]);
            all.origins.push(f as u32);
            all.corners.extend([old(k), old((k + 1) % n), std::array::from_fn(|k| (k as u32, weights[k]))]);
        }
    }
    all
}

fn mixed_points(mesh: &Mesh, refinement: &Refinement) -> Vec<DVec3> {
    let point = |parts: &[(u32, f64); 3]| parts.iter().map(|(v, w)| mesh.points()[*v as usize] * *w).sum();
    mesh.points().iter().copied().chain(refinement.vertices.iter().map(point)).collect()
}

/// The file with its faces split and no old vertex moved.
fn split(document: &Document, stars: &[(usize, [f64; 3])]) -> Written {
    let refinement = starred(document.mesh(), stars);
    document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &DEFAULTS).unwrap()
}

fn obj(text: &str) -> Document {
    Document::parse(text.into(), Format::Obj).unwrap()
}

fn text(written: Written) -> String {
    String::from_utf8(written.bytes).unwrap()
}

/// 1/4, 1/4, 1/2: sums with them do not round in these tests.
const QUARTERS: [f64; 3] = [0.25, 0.25, 0.5];

const SQUARE: &str = "mtllib a.mtl\nv 0 0 0 1 0 0\nv 4 0 0 0 1 0 # c\nv 4.00 4 0 0 0 1\nv 0 4 0 1 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
vn 0 0 1\no x\ng a\nusemtl red\n  f 1/1/1 2/2/1 3/3/1 # split\ns 1\nf 1/1/1 3/3/1  4/4/1\nl 1 2\n";

#[test]
fn obj_faces_are_split_in_their_place() {
    let written = split(&obj(SQUARE), &[(0, QUARTERS)]);
    assert!(written.warnings.is_empty(), "{:?}", written.warnings);
    assert_eq!(written.points[4], DVec3::new(3.0, 2.0, 0.0));
    let want = SQUARE
        .replace("v 0 4 0 1 1 1\n", "v 0 4 0 1 1 1\nv 3 2 0 0.25 0.25 0.5\n")
        .replace("vt 0 1\n", "vt 0 1\nvt 0.75 0.5\n")
        .replace(
            "  f 1/1/1 2/2/1 3/3/1 # split\n",
            "  f 1/1/1 2/2/1 5/5/1\nf 2/2/1 3/3/1 5/5/1\nf 3/3/1 1/1/1 5/5/1 # split\n",
        );
    assert_eq!(text(written), want);
}

#[test]
fn old_vertices_move_as_without_a_refinement() {
    let document = obj(SQUARE);
    let refinement = starred(document.mesh(), &[(1, QUARTERS)]);
    let mut points = mixed_points(document.mesh(), &refinement);
    points[2].z = 0.5;
    points[4] = DVec3::new(1.5, 2.5, 0.125);
    let written = text(document.refined(&points, &refinement, &DEFAULTS).unwrap());
    assert!(written.contains("\nv 4.00 4 0.5 0 0 1\n") && written.contains("\nv 1.5 2.5 0.125 "), "{written}");
    let again = obj(&written);
    assert_eq!((again.mesh().points(), again.mesh().faces()), (&points[..], &refinement.faces));
}

#[test]
fn a_refinement_that_adds_nothing_writes_what_other_points_write() {
    let stl = Document::from_mesh(obj(SQUARE).mesh(), Format::Stl, isochor_io::NumberType::F32).unwrap();
    let strips = ply(
        "ascii",
        "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n\
        property list int int vertex_indices\n",
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    );
    for document in [obj(SQUARE), stl, strips] {
        let nothing = starred(document.mesh(), &[]);
        let mut points = document.mesh().points().to_vec();
        for _ in 0..2 {
            let want = document.with_points(&points, &DEFAULTS).unwrap();
            assert_eq!(document.refined(&points, &nothing, &DEFAULTS).unwrap(), want);
            points[1].x = 4.5;
        }
    }
}

/// The last face counts back from its own line, so added vertices stand behind it.
#[test]
fn relative_indices_of_faces_that_stay_still_resolve() {
    let head = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
    let document = obj(&format!("{head}f -4/-4 -3/-3 -2/-2\nf -4/1 -2/3 -1/4\n"));
    let written = split(&document, &[(0, QUARTERS)]);
    assert!(written.warnings[0].ends_with("which some programs cannot read: 1."), "{:?}", written.warnings);
    let want = format!(
        "{}f 1/1 2/2 5/5\nf 2/2 3/3 5/5\nf 3/3 1/1 5/5\nf -4/1 -2/3 -1/4\nv 0.75 0.5 0\n",
        head.replace("vt 0 1\n", "vt 0 1\nvt 0.75 0.5\n")
    );
    assert_eq!(text(written), want);
    // Nothing that stays counts back: added lines stand with their kind.
    let written = split(&document, &[(0, QUARTERS), (1, QUARTERS)]);
    assert!(written.warnings.is_empty());
    let written = text(written);
    assert!(written.starts_with(&head.replace("vt 0 0", "v 0.75 0.5 0\nv 0.25 0.75 0\nvt 0 0")), "{written}");
    for (statement, counts_back) in [("l -1 -2", true), ("p -1", true), ("curv 0 1 -1 -2", true), ("l 1 2", false)] {
        let written = text(split(&obj(&format!("{head}f 1 2 3\n{statement}\n")), &[(0, QUARTERS)]));
        assert_eq!(written.ends_with(&format!("{statement}\nv 0.75 0.5 0\n")), counts_back, "{written}");
    }
}

#[test]
fn faces_before_the_last_vertices_name_what_stands_behind_them() {
    let document = obj("o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 4 5 6\n");
    let written = split(&document, &[(0, QUARTERS), (1, QUARTERS)]);
    assert!(written.warnings[0].ends_with(": 1."), "{:?}", written.warnings);
    let written = text(written);
    assert!(
        written.contains("f 1 2 7\nf 2 3 7\nf 3 1 7\no b\n")
            && written.contains("\nv 0 1 1\nv 0.25 0.5 0\nv 0.25 0.5 1\nf")
    );
}

#[test]
fn obj_line_ends_stay_and_a_missing_one_is_no_harm() {
    for end in ["\n", "\r\n", "\r"] {
        let lines = ["f 1 2 \\", " 3", "v 0 0 0", "v 1 0 0", "v 0 1 0 # last"].join(end);
        let written = text(split(&obj(&lines), &[(0, QUARTERS)]));
        let want = ["f 1 2 4", "f 2 3 4", "f 3 1 4", "v 0 0 0", "v 1 0 0", "v 0 1 0 # last", "v 0.25 0.5 0"].join(end);
        assert_eq!(written, want);
    }
    // A backslash at the very end must not join the line that comes behind it.
    let written =
        split(&obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 3/3\nvt 0 0\nvt 1 0\nvt 1 1 \\"), &[(0, [0.5, 0.5, 0.0])]);
    assert!(String::from_utf8_lossy(&written.bytes).ends_with("\nvt 1 1 \\\n\nvt 0.5 0"));
}

#[test]
fn faces_that_are_none_and_other_elements_stay() {
    let lines = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nl 1 2\np 3\nfo 1 2 3\nf 2\n";
    let written = text(split(&obj(lines), &[(0, QUARTERS)]));
    let want = lines.replace("f 1 2\n", "v 0.25 0.5 0\nf 1 2\n").replace("p 3\nv 0.25 0.5 0\n", "p 3\n");
    assert_eq!(
        written.replace("v 0.25 0.5 0\n", ""),
        want.replace("v 0.25 0.5 0\n", "").replace("fo 1 2 3", "fo 1 2 4\nfo 2 3 4\nfo 3 1 4")
    );
    assert!(written.contains("v 0 1 0\nv 0.25 0.5 0\nf 1 2\n"));
}

/// Two triangles with a common edge, which gets a vertex in its middle.
fn edge_split() -> Refinement {
    let middle = [(1, 0.5), (2, 0.5), (0, 0.0)];
    Refinement {
        faces: Faces::from_iter(&[[0, 1, 4], [0, 4, 2], [2, 4, 3], [4, 1, 3]]),
        vertices: vec![middle],
        origins: vec![0, 0, 1, 1],
        corners: [
            [old(0), old(1), middle],
            [old(0), middle, old(2)],
            // The second face begins with vertex 2, then comes vertex 1.
            [old(0), [(1, 0.5), (0, 0.5), (2, 0.0)], old(2)],
            [[(0, 0.5), (1, 0.5), (2, 0.0)], old(1), old(2)],
        ]
        .concat(),
    }
}

#[test]
fn neighbours_share_added_texture_coordinates_but_not_across_a_seam() {
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0.1 0\nvt 0.7 0\nvt 0 0.3\nvt 1 1\nvt 2 0\nvt 2 1\n";
    let write = |faces: &str| {
        let document = obj(&format!("{head}{faces}"));
        let refinement = edge_split();
        text(document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &DEFAULTS).unwrap())
    };
    let smooth = write("f 1/1 2/2 3/3\nf 3/3 2/2 4/4\n");
    assert!(smooth.ends_with("f 1/1 2/2 5/7\nf 1/1 5/7 3/3\nf 3/3 5/7 4/4\nf 5/7 2/2 4/4\n"), "{smooth}");
    assert_eq!(smooth.matches("vt ").count(), 7);
    let seam = write("f 1/1 2/2 3/3\nf 3/6 2/5 4/4\n");
    assert!(seam.contains("\nvt 0.35 0.15\nvt 2 0.5\nf 1/1 2/2 5/7\n"), "{seam}");
    assert!(seam.ends_with("f 3/6 5/8 4/4\nf 5/8 2/5 4/4\n"), "{seam}");
    // All the same at both ends: no new line.
    let flat = write("f 1/1 2/2 3/2\nf 3/2 2/2 4/4\n");
    assert!(flat.contains("f 1/1 2/2 5/2\n") && flat.matches("vt ").count() == 6, "{flat}");
}

#[test]
fn texture_coordinates_of_one_two_and_three_numbers_are_mixed() {
    let written = split(&obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1\nvt 0 1\nvt 0 0 1\nf 1/1 2/2 3/3\n"), &[(0, QUARTERS)]);
    assert!(text(written).contains("vt 0 0 1\nvt 0.25 0.25 0.5\n"));
}

/// An old vertex that a neighbour's cut made a corner of a face: a new mix at an old vertex.
#[test]
fn corners_at_old_vertices_may_be_mixed() {
    let document = obj("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
    let middle = [(1, 0.5), (2, 0.5), (0, 0.0)];
    let refinement = Refinement {
        faces: [&[0, 1, 3, 2][..]].into_iter().collect(),
        vertices: vec![],
        origins: vec![0],
        corners: vec![old(0), old(1), middle, old(2)],
    };
    let written = text(document.refined(document.mesh().points(), &refinement, &DEFAULTS).unwrap());
    assert!(written.ends_with("vt 0 1\nvt 0.5 0.5\nf 1/1 2/2 4/4 3/3\n"), "{written}");
}

#[test]
fn faces_without_pieces_go() {
    let document = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 # a\nf 3 2 1 # b\n");
    let one = Refinement {
        faces: Faces::from_iter(&[[2, 1, 0]]),
        origins: vec![1],
        corners: (0..3).map(old).collect(),
        vertices: vec![],
    };
    let points = document.mesh().points();
    assert_eq!(
        text(document.refined(points, &one, &DEFAULTS).unwrap()),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\n # a\nf 3 2 1 # b\n"
    );
    let ply = ply("ascii", &ply_head(3, "", 2), "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 2 1 0");
    let written = text(ply.refined(points, &one, &DEFAULTS).unwrap());
    assert!(written.contains("element face 1\n") && written.ends_with("0 1 0\n3 2 1 0"), "{written}");
    let stl = Document::from_mesh(document.mesh(), Format::Stl, isochor_io::NumberType::F32).unwrap();
    assert_eq!(stl.refined(points, &one, &DEFAULTS).unwrap().bytes.len(), 84 + 50);
}

#[test]
fn normals_are_mixed_and_carried() {
    let lines = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 1 0 0\nvn 0 3 0\nf 1//1 2//2 3//3\n";
    let document = obj(lines);
    let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
    let points = mixed_points(document.mesh(), &refinement);
    let added = |jacobians: Option<&[DMat3]>| {
        let options = WriteOptions { jacobians, ..DEFAULTS };
        let written = text(document.refined(&points, &refinement, &options).unwrap());
        assert!(written.contains("f 1//1 2//2 4//4\n"), "{written}");
        numbers(&written, "vn")[3].clone()
    };
    // Directions count, not lengths: (1/4) z + (1/4) x + (1/2) y.
    let direction = DVec3::new(0.25, 0.5, 0.25).normalize();
    let close =
        |found: Vec<f64>, want: DVec3| assert!((DVec3::from_slice(&found) - want).length() < 1e-15, "{found:?}");
    close(added(None), direction);
    // The Jacobian of the added vertex carries it.
    let turn = DMat3::from_rotation_x(0.7);
    close(added(Some(&[DMat3::IDENTITY, DMat3::IDENTITY, DMat3::IDENTITY, turn])), turn * direction);
    let stretch = DMat3::from_diagonal(DVec3::new(1.0, 2.0, 4.0));
    close(added(Some(&[stretch; 4])), DVec3::new(0.25, 0.25, 0.0625).normalize());
}

/// A face of one normal needs no other without Jacobians, and one of its own with them.
#[test]
fn one_normal_of_a_flat_face() {
    let document = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n");
    assert!(text(split(&document, &[(0, QUARTERS)])).contains("f 1//1 2//1 4//1\n"));
    let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
    let (still, turn) = (DMat3::IDENTITY, DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2));
    let options = WriteOptions { jacobians: Some(&[still, still, still, turn]), ..DEFAULTS };
    let written = text(document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &options).unwrap());
    let normal = DVec3::from_slice(&numbers(&written, "vn")[1]);
    assert!((normal - DVec3::NEG_Y).length() < 1e-15 && written.contains("f 1//1 2//1 4//2\n"), "{written}");
}

#[test]
fn what_cannot_be_mixed_is_said() {
    let said = |lines: &str, words: &str| {
        let written = split(&obj(lines), &[(0, QUARTERS)]);
        assert!(written.warnings.iter().any(|w| w.contains(words)), "{:?}", written.warnings);
        text(written)
    };
    let bare = said(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2 3/1\n",
        "without a texture coordinate, because an old corner has none: 3",
    );
    assert!(bare.contains("f 1/1 2 4\n"), "{bare}");
    let unread = said("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt x 0\nvt 1 1\nf 1/1 2/2 3/3\n", "cannot be mixed: 3");
    assert!(unread.contains("f 1/1 2/2 4/3\n"), "{unread}");
    let opposite = said(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 0 -1\nf 1//1 2//1 3//2\n",
        "with the normal of the nearest old corner",
    );
    assert!(opposite.contains("f 1//1 2//1 4//1\n"), "{opposite}");
    let grey = said("v 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n", "without colours");
    assert!(grey.contains("v 0.25 0.5 0\n"), "{grey}");
    said("v 0 0 0 1 1 nan\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n", "without colours");
}

/// Vertex 4 does not exist before, and would be the added one.
#[test]
fn indices_of_what_does_not_exist_are_not_made_to_mean_something() {
    let refused = |lines: &str, want: WriteError| {
        let document = obj(lines);
        let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
        let error = document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &DEFAULTS).unwrap_err();
        assert_eq!(error, want);
        assert!(error.hint().is_some());
    };
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    refused(&format!("{head}l 1 4\n"), WriteError::StrayIndex { line: 8, thing: "vertex", index: 4, count: 3 });
    refused(
        &format!("{head}f 1/9 2/4 3/3\n"),
        WriteError::StrayIndex { line: 8, thing: "texture coordinate", index: 4, count: 3 },
    );
    // Beyond what is added, and in a face that is split, they are none as before.
    let far = text(split(&obj(&format!("{head}l 1 5\n")), &[(0, QUARTERS)]));
    assert!(far.ends_with("l 1 5\n"));
    let own = split(&obj(&head.replace("3/3", "3/7")), &[(0, QUARTERS)]);
    assert!(text(own).ends_with("f 1/1 2/2 4\nf 2/2 3 4\nf 3 1/1 4\n"));
}

/// The numbers of all lines of a kind.
fn numbers(text: &str, keyword: &str) -> Vec<Vec<f64>> {
    let rows = text.lines().filter(|line| line.split_whitespace().next() == Some(keyword));
    rows.map(|line| line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect()).collect()
}

fn ply(format: &str, elements: &str, body: &str) -> Document {
    let text = format!("ply\nformat {format} 1.0\n{elements}end_header\n{body}");
    Document::parse(text.into(), Format::Ply).unwrap()
}

fn ply_head(vertices: usize, more: &str, faces: usize) -> String {
    format!(
        "element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n{more}element face {faces}\n\
         property list uchar int vertex_indices\n"
    )
}

#[test]
fn ascii_ply_rows_are_added_and_replaced() {
    let head = "comment c\nelement vertex 4\nproperty uchar red\nproperty float x\nproperty float y\nproperty int label\nproperty float z\n\
                property double heat\nproperty uchar Diffuse_Blue\nelement edge 1\nproperty int vertex1\nproperty int vertex2\n\
                element face 3\nproperty uchar tag\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n";
    let body = "0 0 0 5 0 0.5 0\n255 4.0 0 6 0 1 10\n100 4 4 7 0 1.5 20\n9 0 4 8 0 nan 1\n0 1\n\
                40 3 0 1 2 6 0 0 1 0 1 1 99\n7 2 0 1 0\n41 3 0 2 3 0\n";
    let written = split(&ply("ascii", head, body), &[(0, QUARTERS)]);
    assert_eq!(written.warnings, ["Elements that stay as they are beside split faces: edge."]);
    // red: 255/4 + 100/2 = 113.75; heat: 0.125 + 0.25 + 0.75; blue: 2.5 + 10 = 12.5, rounded away from 0; the label of most weight.
    let want_head = head.replace("vertex 4", "vertex 5").replace("face 3", "face 5");
    let want_body = body.replace("0 1\n40", "114 3 2 7 0 1.125 13\n0 1\n40").replace(
        "40 3 0 1 2 6 0 0 1 0 1 1 99\n",
        "40 3 0 1 4 6 0 0 1 0 0.75 0.5 99\n40 3 1 2 4 6 1 0 1 1 0.75 0.5 99\n40 3 2 0 4 6 1 1 0 0 0.75 0.5 99\n",
    );
    assert_eq!(text(written), format!("ply\nformat ascii 1.0\n{want_head}end_header\n{want_body}"));
}

#[test]
fn numbers_that_are_not_finite_are_not_mixed() {
    let head = ply_head(3, "property float heat\n", 1);
    let written = text(split(&ply("ascii", &head, "0 0 0 1\n1 0 0 nan\n0 1 0 2.50\n3 0 1 2\n"), &[(0, QUARTERS)]));
    assert!(written.contains("\n0.25 0.5 0 2.50\n"), "{written}");
}

#[test]
fn lists_of_unknown_meaning_are_copied_and_said() {
    let head = format!("{}property list uchar int ids\n", ply_head(3, "property list uchar short more\n", 1));
    let written = split(&ply("ascii", &head, "0 0 0 0\n1 0 0 1 7\n0 1 0 2 8 9\n3 0 1 2 3 4 5 6\n"), &[(0, QUARTERS)]);
    assert!(written.warnings[0].ends_with("'ids' of faces, 'more' of vertices."), "{:?}", written.warnings);
    let written = text(written);
    assert!(written.contains("\n0.25 0.5 0 2 8 9\n") && written.ends_with("\n3 2 0 3 3 4 5 6\n"), "{written}");
}

#[test]
fn ply_text_without_a_last_line_end() {
    let elements = "element face 1\nproperty list uchar int vertex_indices\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let written = text(split(&ply("ascii", elements, "3 0 1 2\n0 0 0\n1 0 0\n0 1 0"), &[(0, QUARTERS)]));
    assert!(written.ends_with("3 0 1 3\n3 1 2 3\n3 2 0 3\n0 0 0\n1 0 0\n0 1 0\n0.25 0.5 0\n"), "{written}");
    let lone_cr = "ply\nformat ascii 1.0\n".to_owned() + elements + "end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n";
    let document = Document::parse(lone_cr.replace('\n', "\r").into(), Format::Ply).unwrap();
    assert_eq!(text(split(&document, &[(0, QUARTERS)])), written.replace('\n', "\r"));
}

#[test]
fn wider_coordinates_and_carried_normals_of_ply() {
    let more = "property float nx\nproperty float ny\nproperty float nz\n";
    let document = ply("ascii", &ply_head(3, more, 1), "0 0 0 0 0 1\n1 0 0 1 0 0\n0 1 0 0 1 0\n3 0 1 2\n");
    let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
    let mut points = mixed_points(document.mesh(), &refinement);
    points[3].z = 0.1;
    let turn = DMat3::from_rotation_z(0.4);
    let still = DMat3::IDENTITY;
    let options = WriteOptions { precision: Precision::F64, jacobians: Some(&[still, still, still, turn]) };
    let written = document.refined(&points, &refinement, &options).unwrap();
    assert_eq!(written.points, points);
    let again = Document::parse(written.bytes.clone(), Format::Ply).unwrap();
    assert_eq!((again.mesh().points(), again.mesh().faces()), (&points[..], &refinement.faces));
    let all = elements(&written.bytes);
    let normal = DVec3::new(all[0].1[3][3][0], all[0].1[3][4][0], all[0].1[3][5][0]);
    assert!((normal - turn * DVec3::new(0.25, 0.5, 0.25).normalize()).length() < 1e-7);
}

fn off(text: &str) -> Document {
    Document::parse(text.into(), Format::Off).unwrap()
}

#[test]
fn off_faces_are_split_in_their_place_and_keep_their_colour() {
    let lines = "OFF # a\n4 3 5\n0 0 0\n4 0 0 # c\n4.00 4 0\n0 4 0 # last\n\n 3 0 1 # half\n2  255 0.5 # red\n2 0 1\n3 0 2  3 # kept\n";
    let written = split(&off(lines), &[(0, QUARTERS)]);
    assert!(written.warnings.is_empty(), "{:?}", written.warnings);
    let want = lines
        .replace("4 3 5", "5 5 0")
        .replace("# last\n", "# last\n3 2 0\n")
        .replace("3 0 1 # half\n2  255 0.5 # red", "3 0 1 4  255 0.5\n3 1 2 4  255 0.5\n3 2 0 4  255 0.5 # red");
    assert_eq!(text(written), want);
}

#[test]
fn what_off_vertices_carry_is_mixed() {
    let body = |rows: [&str; 3]| {
        let [a, b, c] = rows;
        format!("3 1 0\n0 0 0 {a}\n4 0 0 {b}\n0 4 0 {c}\n3 0 1 2")
    };
    let added = |keyword: &str, rows: [&str; 3]| {
        let written = split(&off(&format!("{keyword}\n{}", body(rows))), &[(0, QUARTERS)]);
        let warnings = written.warnings.clone();
        let line = text(written).lines().nth(5).unwrap().to_owned();
        (line.strip_prefix("1 2 0 ").map(str::to_owned).unwrap_or(line), warnings)
    };
    // 255/4 + 100/2 = 113.75: whole, as all others are; between 0 and 1 they are parts.
    assert_eq!(added("COFF", ["0 0 1 255", "255 0 1 255", "100 0 0 255"]), ("114 0 1 255".into(), Vec::new()));
    assert_eq!(added("COFF", ["0 0 1", "1 0 1", "1 0 0"]).0, "0.75 0 0.5");
    assert_eq!(added("COFF", ["0 0 1.", "255 0 1", "100 0 0"]).0, "113.75 0 0.5");
    assert_eq!(added("STOFF", ["0 0.25", "1 0.25", "0 0.25"]).0, "0.25 0.25");
    assert_eq!(added("4OFF", ["1", "1.0", "1"]).0, "1");
    let (normal, _) = added("STNOFF", ["0 0 2 0 0", "0 0 1 4 0", "0 0 3 0 1"]);
    assert_eq!(normal, "0 0 1 1 0.5", "directions count, not lengths");
    let unmixed = |keyword, rows, want: &str| {
        let (line, warnings) = added(keyword, rows);
        assert!(warnings[0].ends_with("because they cannot be mixed: 1."), "{warnings:?}");
        assert_eq!(line, want);
    };
    unmixed("COFF", ["1 1 1 1", "0 0 0", "9 9 9.0"], "9 9 9.0");
    unmixed("OFF", ["1 1 1", "0 0 0", "9 9 9"], "9 9 9");
    unmixed("OFF", ["1 1 1", "0 0 0", ""], "1 2 0");
    unmixed("COFF", ["1 1 nan", "0 0 0", "9 9 9"], "4.75 4.75 9");
    unmixed("NOFF", ["0 0 1", "0 0 1", "0 0 -1.0"], "0 0 -1.0");
    unmixed("NCOFF", ["1 1 1 0 0 1", "2 1 1 0 0 1", "9 1 1 0 0 1"], "9 1 1 0 0 1");
}

/// The Jacobian of the added vertex carries its normal, as a turn about x by 90 degrees does z to −y.
#[test]
fn added_normals_of_off_are_carried() {
    let document = off("NOFF\n3 1 0\n0 0 0 0 0 1\n4 0 0 0 0 1\n0 4 0 0 0 1\n3 0 1 2");
    let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
    let (still, turn) = (DMat3::IDENTITY, DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2));
    let options = WriteOptions { jacobians: Some(&[still, still, still, turn]), ..DEFAULTS };
    let written = text(document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &options).unwrap());
    let line: Vec<f64> = written.lines().nth(5).unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
    assert!((DVec3::from_slice(&line[3..]) - DVec3::NEG_Y).length() < 1e-15, "{written}");
    assert!(written.ends_with("3 0 1 3\n3 1 2 3\n3 2 0 3"), "{written}");
}

#[test]
fn points_without_faces_are_added() {
    let document =
        ply("ascii", "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n", "0 0 0\n1 0 0\n");
    let refinement = Refinement { vertices: vec![[(0, 0.5), (1, 0.5), (7, 0.0)]], ..Default::default() };
    let written = document.refined(&mixed_points_loose(&document), &refinement, &DEFAULTS).unwrap();
    assert!(text(written).ends_with(
        "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 0 0\n0.5 0 0\n"
    ));
}

fn mixed_points_loose(document: &Document) -> Vec<DVec3> {
    let points = document.mesh().points();
    vec![points[0], points[1], (points[0] + points[1]) / 2.0]
}

#[test]
fn strips_and_small_types_are_refused() {
    let refuse = |document: &Document, stars: &[(usize, [f64; 3])]| {
        let refinement = starred(document.mesh(), stars);
        let error = document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &DEFAULTS).unwrap_err();
        assert!(error.hint().is_some());
        error
    };
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let strips = format!("element vertex 3\n{xyz}element tristrips 1\nproperty list int int vertex_indices\n");
    assert_eq!(refuse(&ply("ascii", &strips, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), &[(0, QUARTERS)]), WriteError::Strips);
    // 128 vertices fit a char, which ends at 127.
    let small = format!("element vertex 128\n{xyz}element face 1\nproperty list uchar char vertex_indices\n");
    let body = format!("1 0 0\n0 1 0\n{}3 0 1 2\n", "0 0 0\n".repeat(126));
    let range = WriteError::ListRange { list: "vertex_indices".into(), value: 128, limit: 127 };
    assert_eq!(refuse(&ply("ascii", &small, &body), &[(0, QUARTERS)]), range);
    // 43 corners have 129 numbers.
    let lists = format!("{}property list char float uv\n", ply_head(43, "", 1));
    let (points, uv) = ("0 0 0\n".repeat(43), vec!["0"; 43].join(" "));
    let corners: Vec<_> = (0..43).map(|k| k.to_string()).collect();
    let many = ply("ascii", &lists, &format!("{points}43 {} 43 {uv}\n", corners.join(" ")));
    let mut refinement = starred(many.mesh(), &[]);
    let twice: Vec<u32> = (0..43).flat_map(|k| [k; 3]).collect();
    refinement.faces = [&twice[..]].into_iter().collect();
    refinement.corners = (0..43).flat_map(|k| [old(k); 3]).collect();
    let error = many.refined(many.mesh().points(), &refinement, &DEFAULTS).unwrap_err();
    assert_eq!(error, WriteError::ListRange { list: "uv".into(), value: 129, limit: 127 });
    // An added vertex needs floats.
    let whole = ply("ascii", &ply_head(3, "", 1).replace("float z", "int z"), "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    assert!(matches!(refuse(&whole, &[(0, QUARTERS)]), WriteError::Integer { vertex: 3, axis: 'z', .. }));
}

const FACETS: &str = "solid a b\n  facet normal 0 0 1\n    outer loop\n      vertex 0 0 0\n      vertex 4.0 0 0\n      vertex 0.123456789012 4 0\n\
                      \tendloop\n  endfacet\n  facet normal 0 0 0 outer loop vertex 0 0 0 vertex 0.123456789012 4 0 vertex 0 0 4 endloop endfacet\nendsolid a b\n";

#[test]
fn stl_facets_are_split_as_they_are_spelled() {
    let document = Document::parse(FACETS.into(), Format::Stl).unwrap();
    let refinement = starred(document.mesh(), &[(0, [0.5, 0.5, 0.0])]);
    let points = mixed_points(document.mesh(), &refinement);
    let written = text(document.refined(&points, &refinement, &DEFAULTS).unwrap());
    let facet = |normal: &str, corners: [&str; 3]| {
        let [a, b, c] = corners;
        format!(
            "  facet normal {normal}\n    outer loop\n      vertex {a}\n      vertex {b}\n      vertex {c}\n\tendloop\n  endfacet\n"
        )
    };
    let (a, b, c, middle) = ("0 0 0", "4 0 0", "0.123456789012 4 0", "2 0 0");
    // The first triangle has no area, so no normal.
    let parts =
        [facet("0 0 0", [a, b, middle]), facet("0 0 1", [b, c, middle]), facet("0 0 1", [c, a, middle])].concat();
    let at = FACETS.find("  facet").unwrap();
    let end = FACETS.find("  facet normal 0 0 0").unwrap();
    assert_eq!(written, FACETS[..at].to_owned() + &parts + &FACETS[end..]);
    // The other facet: its normal stays 0, and the line it shares with another one is its own.
    let written = text(split(&document, &[(1, QUARTERS)]));
    assert_eq!(written.matches("  facet normal 0 0 0 outer loop vertex").count(), 3);
    let again = Document::parse(written.into(), Format::Stl).unwrap();
    assert_eq!((again.mesh().points().len(), again.mesh().faces().len()), (5, 4));
}

#[test]
fn binary_facets_keep_their_attributes() {
    let mesh = Mesh::new(
        vec![DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0, DVec3::Z],
        Faces::from_iter(&[[0, 1, 2], [0, 2, 3]]),
    );
    let mut bytes =
        Document::from_mesh(&mesh.unwrap(), Format::Stl, isochor_io::NumberType::F32).unwrap().bytes().to_vec();
    bytes[84 + 48..84 + 50].copy_from_slice(b"ab");
    bytes[134 + 48..134 + 50].copy_from_slice(b"cd");
    bytes[..7].copy_from_slice(b"my head");
    let document = Document::parse(bytes.clone(), Format::Stl).unwrap();
    // Quadrilaterals are fanned.
    let middle = [(1, 0.5), (2, 0.5), (0, 0.0)];
    let refinement = Refinement {
        faces: [&[0, 1, 4, 2][..], &[0, 2, 3]].into_iter().collect(),
        vertices: vec![middle],
        origins: vec![0, 1],
        corners: [old(0), old(1), middle, old(2), old(0), old(1), old(2)].to_vec(),
    };
    let written = document.refined(&mixed_points(document.mesh(), &refinement), &refinement, &DEFAULTS).unwrap().bytes;
    assert_eq!(written.len(), 84 + 3 * 50);
    assert_eq!((&written[..80], &written[80..84]), (&bytes[..80], &[3, 0, 0, 0][..]));
    let floats = |facet: usize| -> Vec<f32> {
        written[84 + 50 * facet..][..48].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    assert_eq!(floats(0), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 2.0, 2.0, 0.0]);
    assert_eq!(floats(1), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 4.0, 0.0]);
    assert_eq!((&written[132..134], &written[182..184], &written[184..]), (&b"ab"[..], &b"ab"[..], &bytes[134..]));
}

#[test]
fn refinements_that_do_not_fit_are_refused() {
    let document = obj(SQUARE);
    let good = starred(document.mesh(), &[(0, QUARTERS)]);
    let points = mixed_points(document.mesh(), &good);
    let refuse = |change: &dyn Fn(&mut Refinement)| {
        let mut bad = good.clone();
        change(&mut bad);
        match document.refined(&points, &bad, &DEFAULTS) {
            Err(WriteError::Refinement(error)) => error,
            other => panic!("{other:?}"),
        }
    };
    use RefinementError as Error;
    let face = |corners: &[u32]| std::iter::once(corners).chain((1..4).map(|f| good.faces.face(f))).collect::<Faces>();
    assert_eq!(refuse(&|r| _ = r.origins.pop()), Error::OriginCount { origins: 3, faces: 4 });
    assert_eq!(refuse(&|r| _ = r.corners.pop()), Error::CornerCount { mixes: 11, corners: 12 });
    assert_eq!(refuse(&|r| r.origins[3] = 2), Error::MissingOrigin { face: 3, origin: 2, faces: 2 });
    assert_eq!(refuse(&|r| r.origins[0] = 1), Error::OriginOrder { face: 1, origin: 0, before: 1 });
    assert_eq!(refuse(&|r| r.vertices[0][1].0 = 4), Error::MissingVertex { vertex: 4, part: 4, vertices: 4 });
    assert_eq!(refuse(&|r| r.corners[4][0].0 = 3), Error::MissingCorner { face: 1, corner: 1, part: 3, corners: 3 });
    let missing = MeshError::MissingVertex { face: 0, vertex: 5, vertices: 5 };
    assert_eq!(refuse(&|r| r.faces = face(&[0, 1, 5])), Error::Face(missing));
    let few = MeshError::TooFewCorners { face: 0, corners: 2 };
    assert_eq!(
        refuse(&|r| {
            r.faces = face(&[0, 1]);
            r.corners.remove(0);
        }),
        Error::Face(few)
    );
    for bad in [f64::NAN, f64::INFINITY, -0.25, 0.3] {
        let vertex = refuse(&|r| r.vertices[0][0].1 = bad);
        assert!(matches!(vertex, Error::VertexWeights { vertex: 4, .. }), "{vertex}");
        let corner = refuse(&|r| r.corners[2][0].1 = bad);
        assert!(matches!(corner, Error::CornerWeights { face: 0, corner: 2, .. }), "{corner}");
    }
}

#[test]
fn counts_and_numbers_that_do_not_fit_are_refused() {
    let document = obj(SQUARE);
    let refinement = starred(document.mesh(), &[(0, QUARTERS)]);
    let mut points = mixed_points(document.mesh(), &refinement);
    let few = document.refined(&points[..4], &refinement, &DEFAULTS).unwrap_err();
    assert_eq!(few, WriteError::PointCount { points: 4, vertices: 5 });
    let jacobians = |all| WriteOptions { jacobians: Some(all), ..DEFAULTS };
    let few = document.refined(&points, &refinement, &jacobians(&[DMat3::IDENTITY; 4])).unwrap_err();
    assert_eq!(few, WriteError::JacobianCount { jacobians: 4, vertices: 5 });
    let odd = document.refined(&points, &refinement, &jacobians(&[DMat3::NAN; 5])).unwrap_err();
    assert_eq!(odd, WriteError::JacobianNotFinite { vertex: 0 });
    points[4].y = f64::INFINITY;
    let odd = document.refined(&points, &refinement, &DEFAULTS).unwrap_err();
    assert_eq!(odd, WriteError::NotFinite { vertex: 4, axis: 'y', value: f64::INFINITY });
}

/// The elements of a PLY file: name, and rows of properties of numbers.
fn elements(bytes: &[u8]) -> Vec<(String, Vec<Vec<Vec<f64>>>)> {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut reader = Reader { bytes: &bytes[end..], text: header.contains("ascii"), big: header.contains("big") };
    let mut all: Vec<(String, usize, Vec<Vec<&str>>)> = Vec::new();
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["element", name, count] => all.push((name.into(), count.parse().unwrap(), vec![])),
            ["property", ..] => all.last_mut().unwrap().2.push(words[1..words.len() - 1].to_vec()),
            _ => {}
        }
    }
    let read = |(name, count, properties): (String, usize, Vec<Vec<&str>>)| {
        let rows = (0..count).map(|_| properties.iter().map(|types| reader.property(types)).collect()).collect();
        (name, rows)
    };
    let elements = all.into_iter().map(read).collect();
    assert!(reader.bytes.trim_ascii().is_empty(), "bytes are left");
    elements
}

struct Reader<'a> {
    bytes: &'a [u8],
    text: bool,
    big: bool,
}

impl Reader<'_> {
    fn property(&mut self, types: &[&str]) -> Vec<f64> {
        match types {
            ["list", count, item] => {
                let len = self.number(count) as usize;
                (0..len).map(|_| self.number(item)).collect()
            }
            _ => vec![self.number(types[0])],
        }
    }

    fn number(&mut self, kind: &str) -> f64 {
        if self.text {
            self.bytes = self.bytes.trim_ascii_start();
            let len = self.bytes.iter().position(u8::is_ascii_whitespace).unwrap_or(self.bytes.len());
            let (word, rest) = self.bytes.split_at(len);
            self.bytes = rest;
            return std::str::from_utf8(word).unwrap().parse().unwrap();
        }
        let size = match kind {
            "uchar" => 1,
            "short" => 2,
            "int" | "float" => 4,
            _ => 8,
        };
        let (number, rest) = self.bytes.split_at(size);
        self.bytes = rest;
        let mut little = [0; 8];
        little[..size].copy_from_slice(number);
        if self.big {
            little[..size].reverse();
        }
        match kind {
            "uchar" => f64::from(little[0]),
            "short" => f64::from(i16::from_le_bytes([little[0], little[1]])),
            "int" => f64::from(i32::from_le_bytes(*little.first_chunk().unwrap())),
            "float" => f64::from(f32::from_le_bytes(*little.first_chunk().unwrap())),
            _ => f64::from_le_bytes(little),
        }
    }
}

/// A bent sheet of quadrilaterals and pairs of triangles; `wide` of them beside each other in two rows.
fn sheet(wide: usize, cut: &[bool]) -> Mesh {
    let at = |i: usize, j: usize| DVec3::new(i as f64, j as f64, (i * i) as f64 / 8.0);
    let points = (0..3).flat_map(|j| (0..=wide).map(move |i| at(i, j))).collect();
    let mut faces = Faces::new();
    for k in 0..2 * wide {
        let a = (k / wide * (wide + 1) + k % wide) as u32;
        let [b, c, d] = [a + 1, a + wide as u32 + 2, a + wide as u32 + 1];
        if cut[k % cut.len()] {
            faces.push(&[a, b, c]);
            faces.push(&[a, c, d]);
        } else {
            faces.push(&[a, b, c, d]);
        }
    }
    Mesh::new(points, faces).unwrap()
}

/// Linear in the position.
fn uv(p: DVec3) -> [f64; 2] {
    [p.x / 8.0 + p.z, 1.0 - p.y / 4.0]
}

/// Linear in the position, from 0 to 240.
fn red(p: DVec3) -> f64 {
    20.0 * p.x + 60.0 * p.y
}

fn close(found: &[f64], want: &[f64], tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(found.len(), want.len());
    for (a, b) in found.iter().zip(want) {
        prop_assert!((a - b).abs() <= tolerance, "{:?} is not {:?}", found, want);
    }
    Ok(())
}

/// Stars in random faces, at random places.
fn stars() -> impl Strategy<Value = Vec<(prop::sample::Index, [f64; 3])>> {
    let weights = [1..100_u32, 1..100_u32, 0..100_u32].prop_map(|w| {
        let sum = f64::from(w[0] + w[1] + w[2]);
        w.map(|w| f64::from(w) / sum)
    });
    prop::collection::vec((any::<prop::sample::Index>(), weights), 0..6)
}

fn in_mesh(stars: &[(prop::sample::Index, [f64; 3])], mesh: &Mesh) -> Vec<(usize, [f64; 3])> {
    stars.iter().map(|(face, weights)| (face.index(mesh.faces().len()), *weights)).collect()
}

/// The file of a mesh with texture coordinates, colours, and a material for each face; indices count back from it where `back` says so.
fn painted_obj(mesh: &Mesh, back: &[bool]) -> String {
    let n = mesh.points().len() as i64;
    let mut text = String::new();
    for p in mesh.points() {
        text += &format!("v {} {} {} {} 0.5 1\n", p.x, p.y, p.z, red(*p));
    }
    for p in mesh.points() {
        text += &format!("vt {} {}\n", uv(*p)[0], uv(*p)[1]);
    }
    for (f, face) in mesh.faces().iter().enumerate() {
        text += &format!("usemtl m{f}\nf");
        for &v in face {
            let index = if back[f % back.len()] { i64::from(v) - n } else { i64::from(v) + 1 };
            text += &format!(" {index}/{index}");
        }
        text += "\n";
    }
    text
}

fn painted_ply(mesh: &Mesh, format: &str, order: [usize; 3], float: &str) -> Vec<u8> {
    let axes = order.map(|axis| format!("property {float} {}\n", ["x", "y", "z"][axis])).concat();
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement vertex {}\nproperty uchar red\n{axes}property short id\nproperty double u\nelement face {}\n\
         property list uchar float texcoord\nproperty int part\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.points().len(),
        mesh.faces().len()
    )
    .into_bytes();
    let mut put = |x: f64, kind: &str| match (format, kind) {
        ("ascii", _) => bytes.extend_from_slice(format!("{x} ").as_bytes()),
        (_, _) => {
            let mut number = match kind {
                "uchar" => vec![x as u8],
                "short" => (x as i16).to_le_bytes().to_vec(),
                "int" => (x as i32).to_le_bytes().to_vec(),
                "float" => (x as f32).to_le_bytes().to_vec(),
                "line" => vec![],
                _ => x.to_le_bytes().to_vec(),
            };
            if format == "binary_big_endian" {
                number.reverse();
            }
            bytes.extend_from_slice(&number);
        }
    };
    for (v, p) in mesh.points().iter().enumerate() {
        put(red(*p), "uchar");
        order.iter().for_each(|axis| put(p[*axis], float));
        put(v as f64, "short");
        put(uv(*p)[0], "double");
    }
    for (f, face) in mesh.faces().iter().enumerate() {
        put(2.0 * face.len() as f64, "uchar");
        face.iter().flat_map(|v| uv(mesh.points()[*v as usize])).for_each(|x| put(x, "float"));
        put(f as f64, "int");
        put(face.len() as f64, "uchar");
        face.iter().for_each(|v| put(f64::from(*v), "int"));
    }
    bytes
}

/// One row a line, as text wants it.
fn rows_to_lines(bytes: Vec<u8>, mesh: &Mesh) -> Vec<u8> {
    let text = String::from_utf8(bytes).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    let mut words = body.split_whitespace();
    let mut lines = format!("{header}end_header\n");
    let rows =
        mesh.points().iter().map(|_| 6).chain(mesh.faces().iter().map(|face| 1 + 2 * face.len() + 1 + 1 + face.len()));
    for len in rows {
        let row: Vec<&str> = words.by_ref().take(len).collect();
        lines += &(row.join(" ") + "\n");
    }
    lines.into_bytes()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]

    #[test]
    fn random_splits_of_obj(
        wide in 1..5_usize,
        cut in prop::collection::vec(any::<bool>(), 1..5),
        back in prop::collection::vec(any::<bool>(), 1..4),
        stars in stars(),
    ) {
        let mesh = sheet(wide, &cut);
        let document = obj(&painted_obj(&mesh, &back));
        prop_assert_eq!(document.mesh(), &mesh);
        let refinement = starred(&mesh, &in_mesh(&stars, &mesh));
        let points = mixed_points(&mesh, &refinement);
        let written = document.refined(&points, &refinement, &DEFAULTS).unwrap();
        prop_assert_eq!(&written.points, &points);
        let again = Document::parse(written.bytes.clone(), Format::Obj).unwrap();
        prop_assert_eq!(again.mesh().points(), &points[..]);
        prop_assert_eq!(again.mesh().faces(), &refinement.faces);
        let text = text(written);
        for (p, numbers) in points.iter().zip(numbers(&text, "v")) {
            close(&numbers[3..], &[red(*p), 0.5, 1.0], 1e-12)?;
        }
        let textures = numbers(&text, "vt");
        let (mut material, mut face) = (0, 0);
        for line in text.lines() {
            if let Some(name) = line.strip_prefix("usemtl m") {
                material = name.parse().unwrap();
            } else if let Some(corners) = line.strip_prefix("f ") {
                prop_assert_eq!(refinement.origins[face], material);
                for (word, v) in corners.split(' ').zip(refinement.faces.face(face)) {
                    let index: i64 = word.split('/').nth(1).unwrap().parse().unwrap();
                    let k = if index < 0 { mesh.points().len() as i64 + index } else { index - 1 };
                    close(&textures[k as usize], &uv(points[*v as usize]), 1e-14)?;
                }
                face += 1;
            }
        }
        prop_assert_eq!(face, refinement.faces.len());
    }

    #[test]
    fn random_splits_of_ply(
        wide in 1..5_usize,
        cut in prop::collection::vec(any::<bool>(), 1..5),
        stars in stars(),
        format in prop::sample::select(vec!["ascii", "binary_little_endian", "binary_big_endian"]),
        order in prop::sample::select(vec![[0, 1, 2], [2, 0, 1], [1, 0, 2]]),
        float in prop::sample::select(vec!["float", "double"]),
        widen: bool,
    ) {
        let mesh = sheet(wide, &cut);
        let mut bytes = painted_ply(&mesh, format, order, float);
        if format == "ascii" {
            bytes = rows_to_lines(bytes, &mesh);
        }
        let document = Document::parse(bytes, Format::Ply).unwrap();
        prop_assert_eq!(document.mesh(), &mesh);
        let refinement = starred(&mesh, &in_mesh(&stars, &mesh));
        let points = mixed_points(&mesh, &refinement);
        let precision = if widen { Precision::F64 } else { Precision::File };
        let written = document.refined(&points, &refinement, &WriteOptions { precision, jacobians: None }).unwrap();
        prop_assert!(written.warnings.is_empty(), "{:?}", written.warnings);
        let again = Document::parse(written.bytes.clone(), Format::Ply).unwrap();
        prop_assert_eq!(again.mesh().points(), &written.points[..]);
        prop_assert_eq!(again.mesh().faces(), &refinement.faces);
        let all = elements(&written.bytes);
        for (v, (row, p)) in all[0].1.iter().zip(&points).enumerate() {
            let tolerance = if widen || float == "double" { 0.0 } else { 1e-6 };
            close(&order.map(|axis| p[axis]), &[row[1][0], row[2][0], row[3][0]], tolerance)?;
            // To the nearest; a half may go either way by rounding.
            close(&row[0], &[red(*p)], 0.5 + 1e-12)?;
            close(&row[5], &[uv(*p)[0]], 1e-14)?;
            let most = |parts: &[(u32, f64); 3]| parts.iter().map(|part| part.1).fold(0.0, f64::max);
            if let Some(parts) = v.checked_sub(mesh.points().len()).map(|k| &refinement.vertices[k]) {
                prop_assert!(parts.iter().any(|part| f64::from(part.0) == row[4][0] && part.1 == most(parts)));
            }
        }
        for (f, row) in all[1].1.iter().enumerate() {
            let face = refinement.faces.face(f);
            let want: Vec<f64> = face.iter().flat_map(|v| uv(points[*v as usize])).collect();
            close(&row[0], &want, 2e-7)?;
            prop_assert_eq!(&row[1], &[f64::from(refinement.origins[f])]);
        }
    }

    #[test]
    fn random_splits_of_off(wide in 1..5_usize, cut in prop::collection::vec(any::<bool>(), 1..5), stars in stars(), crlf: bool) {
        let mesh = sheet(wide, &cut);
        let mut lines = format!("STCOFF\n{} {} 0\n", mesh.points().len(), mesh.faces().len());
        for p in mesh.points() {
            let [u, v] = uv(*p);
            lines += &format!("{} {} {} {} 0.5 1 {u} {v}\n", p.x, p.y, p.z, red(*p));
        }
        for (f, face) in mesh.faces().iter().enumerate() {
            let corners: String = face.iter().map(|v| format!(" {v}")).collect();
            lines += &format!("{}{corners} {f}\n", face.len());
        }
        let document = off(&if crlf { lines.replace('\n', "\r\n") } else { lines });
        prop_assert_eq!(document.mesh(), &mesh);
        let refinement = starred(&mesh, &in_mesh(&stars, &mesh));
        let points = mixed_points(&mesh, &refinement);
        let written = document.refined(&points, &refinement, &DEFAULTS).unwrap();
        prop_assert!(written.warnings.is_empty(), "{:?}", written.warnings);
        let again = Document::parse(written.bytes.clone(), Format::Off).unwrap();
        prop_assert_eq!(again.mesh().points(), &points[..]);
        prop_assert_eq!(again.mesh().faces(), &refinement.faces);
        let text = text(written);
        let rows: Vec<Vec<f64>> = text.lines().skip(2).map(|l| l.split_whitespace().map(|w| w.parse().unwrap()).collect()).collect();
        for (p, row) in points.iter().zip(&rows) {
            let [u, v] = uv(*p);
            close(&row[3..], &[red(*p), 0.5, 1.0, u, v], 1e-12)?;
        }
        let colours: Vec<u32> = rows[points.len()..].iter().map(|row| row[row.len() - 1] as u32).collect();
        prop_assert_eq!(colours, refinement.origins);
    }

    /// Areas and places: a facet for each triangle, corner for corner.
    #[test]
    fn random_splits_of_stl(wide in 1..5_usize, stars in stars(), binary: bool) {
        let mesh = sheet(wide, &[true]);
        let mut document = Document::from_mesh(&mesh, Format::Stl, isochor_io::NumberType::F32).unwrap();
        if !binary {
            let mut text = String::from("solid\n");
            for face in document.mesh().faces().iter() {
                text += "facet normal 0 0 1\nouter loop\n";
                for v in face {
                    let p = document.mesh().points()[*v as usize];
                    text += &format!("vertex {} {} {}\n", p.x, p.y, p.z);
                }
                text += "endloop\nendfacet\n";
            }
            document = Document::parse((text + "endsolid\n").into(), Format::Stl).unwrap();
        }
        let mesh = document.mesh();
        let refinement = starred(mesh, &in_mesh(&stars, mesh));
        let written = document.refined(&mixed_points(mesh, &refinement), &refinement, &DEFAULTS).unwrap();
        let again = Document::parse(written.bytes, Format::Stl).unwrap();
        prop_assert_eq!(again.mesh().faces().len(), refinement.faces.len());
        for (found, want) in again.mesh().faces().corners().iter().zip(refinement.faces.corners()) {
            prop_assert_eq!(again.mesh().points()[*found as usize], written.points[*want as usize]);
        }
    }
}
