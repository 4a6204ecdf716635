//! Moves of cage vertices in CageModeler's format.

use glam::DVec3;
use isochor_io::{Place, cage_moves_from_param};

#[test]
fn moves_are_read_however_they_are_spaced() {
    let text = "0 1\n2\n3 0.5 -1e-1 .25\n0 0 0 2\n";
    for text in [text.to_owned(), text.replace('\n', " "), text.replace(' ', "\r\n"), text.replace('\n', "\r\n\t")] {
        let moves = cage_moves_from_param(text.as_bytes(), 5).unwrap();
        assert_eq!(moves.factors, [0.0, 1.0]);
        let want = [DVec3::Z * 2.0, DVec3::ZERO, DVec3::ZERO, DVec3::new(0.5, -0.1, 0.25), DVec3::ZERO];
        assert_eq!(moves.displacements, want, "{text:?}");
    }
    let still = cage_moves_from_param(b"-1.5 2.5 0", 2).unwrap();
    assert_eq!((still.factors, still.displacements), ([-1.5, 2.5], vec![DVec3::ZERO; 2]));
}

#[test]
fn what_is_no_file_of_this_cage_says_why() {
    for (text, line, words) in [
        ("", 1, "ends where the smallest factor"),
        ("0\n1\n", 3, "ends where the number of moves"),
        ("0 1 2\n0 1 0 0\n1 0 0\n", 4, "ends where z of a move"),
        ("0 1 2\n0 1 0 0\n", 3, "ends where the vertex of a move"),
        ("0 1 1\n0 1 0 0\n1 0 0 0\n", 3, "'1' stands behind the last of 1 moves"),
        ("0 x 1\n", 1, "'x' is not a number"),
        ("0 1 1\n0 1 nan 0\n", 2, "'nan' is not a finite"),
        ("0 1 -1\n", 1, "'-1' is not the number of moves"),
        ("0 1 1.5\n", 1, "'1.5' is not the number of moves"),
        ("0 1 99999999999999999999\n", 1, "is not the number of moves"),
        ("0 1 18446744073709551\n0 1 0 0\n", 3, "ends where the vertex"),
        ("0 1 1\n2.0 1 0 0\n", 2, "'2.0' is not the vertex of a move"),
        ("0 1 1\n-1 1 0 0\n", 2, "'-1' is not the vertex of a move"),
        ("0 1 2\n0 1 0 0\n\n4 1 0 0\n", 4, "vertex 4, but the cage has 4 vertices"),
        ("0 1 2\n3 1 0 0\n3 1 0 0\n", 3, "vertex 3 moves again, first in line 2"),
    ] {
        let error = cage_moves_from_param(text.as_bytes(), 4).unwrap_err();
        assert_eq!(error.place(), Some(Place::Line(line)), "{text:?}: {error}");
        assert!(error.to_string().contains(words) && error.hint().is_some(), "{text:?}: {error}");
    }
    let binary = cage_moves_from_param(b"0 1 \0", 4).unwrap_err();
    assert_eq!(binary.place(), Some(Place::Byte(4)), "{binary}");
}
