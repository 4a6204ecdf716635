//! Files of patches: JSON, Newell's format and OBJ, read, written, and refused with their places.

use glam::DVec3;
use isochor::{Basis, Patch, Surface};
use isochor_io::{
    Place, ReadError, patch_from_bytes, patch_from_json, patch_to_json, patches_from_bytes, patches_from_newell,
    patches_from_obj,
};
use proptest::prelude::*;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn patch() -> Patch {
    let bases = [Basis::uniform(5, 2).unwrap(), Basis::with_knots(vec![0.0, 0.0, 0.1, 1.0, 1.0], 1).unwrap()];
    let controls = (0..15).map(|k| v(f64::from(k / 3) / 3.0, f64::from(k % 3), 1e6 + f64::from(k * k % 7))).collect();
    Patch::new(bases, controls, Some((0..15).map(|k| 1.0 + f64::from(k % 4) / 3.0).collect())).unwrap()
}

/// The place, with these words in the message.
fn refused(error: &ReadError, place: Option<usize>, words: &str) {
    assert_eq!(error.place(), place.map(Place::Line), "{error}");
    assert!(error.to_string().contains(words), "{error}: no {words}");
}

#[test]
fn json_that_is_written_is_read_back_bit_for_bit() {
    assert_eq!(patch_from_json(&patch_to_json(&patch())).unwrap(), patch());
    assert_eq!(patch_from_bytes(patch_to_json(&patch()).as_bytes(), Some(0)).unwrap(), patch());
}

#[test]
fn the_shortest_json() {
    let text = r#"{ "kind": "patch", "version": 1, "degree": [1, 2],
        "controls": [[[0,0,0], [0,1,1], [0,2,0]], [[1,0,0], [1,1,1], [1,2,0]]] }"#;
    let patch = patch_from_json(text).unwrap();
    assert_eq!(patch.bases(), &[Basis::bernstein(2).unwrap(), Basis::bernstein(3).unwrap()]);
    // At t = 1/2 half of the middle control point's height.
    assert_eq!(Surface::from(patch).jet(0.25, 0.5).point, v(0.25, 1.0, 0.5));
}

#[test]
fn json_that_is_refused() {
    let good = r#"{"kind":"patch","version":1,"degree":[1,1],"controls":[[[0,0,0],[0,1,0]],[[1,0,0],[1,1,0]]]}"#;
    assert!(patch_from_json(good).is_ok());
    for (from, to, place, words) in [
        ("\"version\":1", "\"version\":2", None, "version is 2"),
        ("\"degree\"", "\n\"dgree\"", Some(2), "dgree"),
        ("\"patch\"", "\"lattice\"", Some(1), "lattice"),
        ("[1,1],", "[2,1],", None, "along s: 2 control points are too few"),
        ("[1,1],", "[1,18446744073709551615],", None, "along t"),
        (",[1,1,0]]", "]", None, "controls[1] has 1 entries: there must be 2"),
        ("]]]}", "]]],\"weights\":[[1,1],[1,0]]}", None, "weight 3 is 0"),
        ("]]]}", "]]],\"weights\":[[1,1]]}", None, "weights has 1 entries"),
        ("]]]}", "]]],\"knots\":[[0,0,1,1],[0,0,0.5,1,1]]}", None, "controls[0] has 2 entries: the knots make it 3"),
        ("]]]}", "]]],\"knots\":[[0,0,1,1],[0,0,2,2]]}", None, "along t: the domain"),
        ("[1,1,0]", "[0.5,0,0]", None, ""),
        ("[1,0,0],[1,1,0]", "[0,2,0],[0,3,0]", None, "no area"),
        ("[1,1,0]", "[1,1,1e400]", Some(1), ""),
    ] {
        let text = good.replacen(from, to, 1);
        match patch_from_json(&text) {
            Err(error) => refused(&error, place, words),
            // A patch that is a triangle has an area.
            Ok(_) => assert_eq!(words, "", "{text}"),
        }
    }
    refused(
        &patch_from_json(r#"{"kind":"patch","version":1,"degree":[1,1],"controls":[]}"#).unwrap_err(),
        None,
        "control points",
    );
}

/// Two flat patches that share a border: s along the rows of four.
fn newell() -> String {
    let mut text =
        "2\n1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16\n13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28\n28\n".to_owned();
    for k in 0..28 {
        text += &format!("{}.0,{},0\n", k % 4, k / 4);
    }
    text
}

#[test]
fn newell_s_format() {
    let patches = patches_from_newell(newell().as_bytes()).unwrap();
    assert_eq!(patches.len(), 2);
    let jet = Surface::from(patches[1].clone()).jet(0.5, 1.0);
    assert_eq!((jet.point, jet.s, jet.t), (v(1.5, 6.0, 0.0), v(3.0, 0.0, 0.0), v(0.0, 3.0, 0.0)));
    let with_blanks = newell().replace(',', " , ").replace('\n', "\r\n\r\n");
    assert_eq!(patches_from_bytes(with_blanks.as_bytes()).unwrap(), patches);
    assert_eq!(patch_from_bytes(newell().as_bytes(), Some(1)).unwrap(), patches[1]);
    refused(&patch_from_bytes(newell().as_bytes(), None).unwrap_err(), None, "2 patches (choose one: 0 to 1)");
    refused(&patch_from_bytes(newell().as_bytes(), Some(2)).unwrap_err(), None, "there is no patch 2");
}

#[test]
fn newell_s_format_that_is_refused() {
    for (from, to, line, words) in [
        ("2\n1,", "3\n1,", 4, "1 numbers: a patch has 16"),
        ("2\n1,", "0\n1,", 1, "'0' is not the number of patches"),
        ("2\n1,", "two\n1,", 1, "'two'"),
        ("27,28\n", "27,29\n", 3, "there is no point '29'"),
        ("27,28\n", "27,0\n", 3, "there is no point '0'"),
        ("27,28\n", "27,-9223372036854775807\n", 3, "there is no point"),
        ("\n28\n", "\n29\n", 32, "the text ends where a point must stand"),
        ("\n28\n", "\n27\n", 32, "text after the last of 27 points"),
        ("0.0,1,0", "0.0,nan,0", 9, "not a finite number"),
        ("0.0,1,0", "0.0,1", 9, "2 numbers: a point has 3"),
        (
            "1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16",
            "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1",
            2,
            "extent of the control points",
        ),
        ("1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16", "1,2,3,4,1,2,3,4,1,2,3,4,1,2,3,4", 2, "no area"),
    ] {
        refused(&patches_from_newell(newell().replacen(from, to, 1).as_bytes()).unwrap_err(), Some(line), words);
    }
    refused(&patches_from_newell(b"").unwrap_err(), Some(1), "ends where the number of patches");
    refused(&patches_from_bytes(b" \n").unwrap_err(), None, "empty");
}

const OBJ: &str = "# a quarter of a cylinder of radius 2, as a rational surface, and a strip
v 2 0 0 1
v 2 2 0 0.7071067811865476
v 0 2 0 1.0
v 2 0 5 1
v 2 2 5 0.7071067811865476
v 0 2 5 1
cstype rat bezier
deg 2 1
surf 0 1 -1 1 1/1/1 2//2 3/3 -3 \\
  -2 -1
parm u 0 1
parm v -1 1
end
cstype bspline
deg 1 1
surf 2 4 0 1 1 2 3 4 5 6
parm u 2 2 3 4 4
parm v 0 0 1 1
end
";

#[test]
fn obj_surfaces() {
    let patches = patches_from_obj(OBJ.as_bytes()).unwrap();
    let quarter = Surface::from(patches[0].clone());
    for (s, t) in [(0.0, 0.0), (0.3, 0.7), (1.0, 1.0)] {
        let (jet, normal) = quarter.jet_and_normal(s, t);
        let out = v(jet.point.x, jet.point.y, 0.0) / 2.0;
        assert!((out.length() - 1.0).abs() < 1e-15 && (jet.point.z - 5.0 * t).abs() < 1e-15);
        assert!(normal.unwrap().distance(out) < 1e-14);
    }
    assert_eq!(patches[1].bases()[0], Basis::clamped(3, 1).unwrap());
    assert_eq!((patches[1].weights(), patches[1].controls()[2]), (None, v(2.0, 2.0, 0.0)));
}

#[test]
fn several_bezier_pieces_are_one_patch() {
    let vertices: String = (0..10).map(|k| format!("v {} {} {}\n", k % 5, k / 5, (k % 5) * (k % 5))).collect();
    let text = vertices + "cstype bezier\ndeg 2 1\nsurf 0 4 0 1 1 2 3 4 5 6 7 8 9 10\nparm u 0 1 4\nparm v 0 1\nend\n";
    let patch = patch_from_bytes(text.as_bytes(), None).unwrap();
    assert_eq!(patch.bases()[0].knots(), [0.0, 0.0, 0.0, 0.25, 0.25, 1.0, 1.0, 1.0]);
    assert_eq!(Surface::from(patch).jet(0.25, 0.0).point, v(2.0, 0.0, 4.0));
}

#[test]
fn obj_surfaces_that_are_refused() {
    for (from, to, line, words) in [
        ("cstype rat bezier", "cstype cardinal", 10, "the type 'cardinal' of line 8 is not supported"),
        ("cstype rat bezier", "cstype", 8, "`cstype` without a type"),
        ("cstype rat bezier\n", "", 9, "`surf` before `cstype`"),
        ("deg 2 1\n", "deg 2\n", 10, "`surf` before `deg`"),
        ("deg 2 1\n", "deg two 1\n", 9, "'two' is not a degree"),
        ("deg 2 1\n", "deg 99999999999999999 1\n", 10, "too many"),
        ("parm u 0 1\n", "parm u 0 1\ntrim 0 1 1\n", 13, "`trim` is not supported"),
        ("parm u 0 1\n", "parm w 0 1\n", 12, "neither u nor v"),
        ("parm u 0 1\n", "", 10, "0 numbers after `parm u`"),
        ("parm u 0 1\n", "parm u 0 2\n", 10, "the domain along u is from 0 to 1"),
        ("parm u 2 2 3 4 4\n", "parm u 2 2 3 4\n", 17, "the domain along u"),
        ("parm u 2 2 3 4 4\n", "parm u 2 2 3 3.5 4 4\n", 17, "make it 4 by 2"),
        ("parm u 2 2 3 4 4\n", "parm u 2 2 3.5 3 4 4\n", 17, "along u: knot"),
        ("-2 -1", "-2 7", 10, "there is no vertex 7"),
        ("-2 -1", "-2 -7", 11, "there is no vertex '-7'"),
        ("-2 -1", "-2 0", 11, "there is no vertex '0'"),
        ("end\ncstype bspline", "cstype bspline", 10, "`surf` without `end`"),
        ("v 2 0 0 1\n", "v 2 0\n", 2, "a vertex of 2 numbers"),
        ("v 2 0 0 1\n", "v 2 0 0 -1\n", 10, "weight 0 is -1"),
        ("v 2 0 0 1\n", "v 2 0 0 x\n", 2, "'x' is not a number"),
    ] {
        let text = OBJ.replacen(from, to, 1);
        assert_ne!(text, OBJ);
        refused(&patches_from_obj(text.as_bytes()).unwrap_err(), Some(line), words);
    }
    let cut = OBJ.strip_suffix("end\n").unwrap();
    refused(&patches_from_obj(cut.as_bytes()).unwrap_err(), Some(17), "`surf` without `end`");
    refused(&patches_from_obj(b"v 1 2 3\n").unwrap_err(), None, "no free-form surface");
    assert_eq!(patches_from_obj(b"v 1\0 2 3\n").unwrap_err().place(), Some(Place::Byte(3)));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever bytes are changed, left out or doubled: patches or an error, no panic.
    #[test]
    fn mutated_bytes_do_not_panic(
        which in 0_usize..3,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0_u8..4), 1..8),
    ) {
        let mut bytes = [newell(), OBJ.to_owned(), patch_to_json(&patch())][which].clone().into_bytes();
        for (at, byte, how) in changes {
            let at = at.index(bytes.len());
            match how {
                0 => bytes[at] = byte,
                1 => bytes[at] = b"0123456789-,. \n"[usize::from(byte) % 15],
                2 => { bytes.remove(at); }
                _ => { let copied = bytes[at]; bytes.insert(at, copied); }
            }
            if bytes.is_empty() {
                bytes.push(byte);
            }
        }
        if let Err(error) = patches_from_bytes(&bytes) {
            prop_assert!(!error.what().is_empty());
        }
    }
}
