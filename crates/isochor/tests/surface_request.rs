//! Surfaces as data: every kind from its text, and what is said about wrong keys and values.
#![cfg(feature = "serde")]

use glam::DVec3;
use isochor::{FlattenKind, Surface, SurfaceRequest, SurfaceRequestError};

fn request(text: &str) -> Result<SurfaceRequest, String> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

fn surface(text: &str) -> Result<Surface, SurfaceRequestError> {
    request(text).unwrap().surface(None)
}

/// The point at (s, t).
fn assert_at(text: &str, [s, t]: [f64; 2], expected: [f64; 3]) {
    let found = surface(text).unwrap().jet(s, t).point;
    assert!(found.distance(DVec3::from_array(expected)) < 1e-14, "{text}: {found}");
}

#[test]
fn every_kind() {
    assert_at(r#"{"kind": "plane", "size": [2, 3]}"#, [0.5, 1.0], [1.0, 3.0, 0.0]);
    assert_at(r#"{"kind": "plane", "sides": [[1, 0, 1], [0, 1, 0]]}"#, [1.0, 0.5], [1.0, 0.5, 1.0]);
    assert_at(r#"{"kind": "cylinder", "radius": 2, "height": 3}"#, [0.25, 0.5], [0.0, 2.0, 1.5]);
    assert_at(r#"{"kind": "cone", "radii": [2, 0], "height": 3, "angles": [0, 90]}"#, [1.0, 0.5], [0.0, 1.0, 1.5]);
    assert_at(r#"{"kind": "sphere", "radius": 2, "latitudes": [0, 90]}"#, [0.5, 0.0], [-2.0, 0.0, 0.0]);
    assert_at(r#"{"kind": "torus", "major": 3, "minor": 1, "tube": [90, 270]}"#, [0.0, 0.5], [2.0, 0.0, 0.0]);
    let controls = r#""controls": [[[0, 0, 0], [0, 2, 0]], [[1, 0, 2], [1, 2, 2]], [[2, 0, 0], [2, 2, 0]]]"#;
    assert_at(&format!(r#"{{"kind": "bezier", {controls}}}"#), [0.5, 0.5], [1.0, 1.0, 1.0]);
    assert_at(&format!(r#"{{"kind": "bspline", "degree": [1, 1], {controls}}}"#), [0.5, 0.5], [1.0, 1.0, 2.0]);
    // The middle of weight 3 against two ends of weight 1 each: (0 + 2 · 3 · 2 + 0) / (1 + 2 · 3 + 1).
    let weights = r#""weights": [[1, 1], [3, 3], [1, 1]]"#;
    assert_at(&format!(r#"{{"kind": "nurbs", {controls}, {weights}}}"#), [0.5, 0.5], [1.0, 1.0, 1.5]);
    let knots = r#""degree": [1, 1], "knots": [[0, 0, 0.25, 1, 1], [0, 0, 1, 1]]"#;
    assert_at(&format!(r#"{{"kind": "bspline", {knots}, {controls}}}"#), [0.25, 0.0], [1.0, 0.0, 2.0]);
    assert_at(r#"{"kind": "revolve", "profile": [[2, 0, 0], [1, 0, 3]]}"#, [0.25, 1.0], [0.0, 1.0, 3.0]);
    assert_at(
        r#"{"kind": "revolve", "axis": [1, 0, 0], "profile": {"through": [[0, 1, 0], [1, 2, 0], [2, 5, 0]]}}"#,
        [0.25, 0.25],
        [0.5, 0.0, 1.25],
    );
    assert_at(
        r#"{"kind": "extrude", "along": [0, 0, 4], "profile": {"controls": [[0, 0, 0], [1, 2, 0], [2, 0, 0]], "degree": 2}}"#,
        [0.5, 0.25],
        [1.0, 1.0, 1.0],
    );
    assert_at(
        r#"{"kind": "heightfield", "size": [4, 6], "heights": [[0, 0], [1, 1], [4, 4]]}"#,
        [0.25, 0.5],
        [1.0, 3.0, 0.25],
    );
    let points = r#""points": [[[0, 0, 0], [0, 1, 0]], [[1, 0, 1], [1, 1, 1]], [[2, 0, 4], [2, 1, 4]]]"#;
    assert_at(&format!(r#"{{"kind": "grid", {points}}}"#), [0.25, 0.0], [0.5, 0.0, 0.25]);
    assert_at(&format!(r#"{{"kind": "grid", "smoothness": "bilinear", {points}}}"#), [0.25, 0.0], [0.5, 0.0, 0.5]);
}

#[test]
fn places_and_sides() {
    let text =
        r#"{"kind": "cylinder", "radius": 1, "height": 2, "at": [0, 0, 5], "frame": {"z": [1, 0, 0], "x": [0, 1, 0]}}"#;
    assert_at(text, [0.25, 0.5], [1.0, 0.0, 6.0]);
    let [out, inward] = ["false", "true"].map(|flip| {
        let text = format!(r#"{{"kind": "sphere", "radius": 1, "flip": {flip}}}"#);
        surface(&text).unwrap().normal(0.5, 0.5).unwrap()
    });
    assert_eq!((out, inward), (-DVec3::X, DVec3::X));
}

#[test]
fn flattening_has_defaults() {
    let default = request(r#"{"kind": "sphere", "radius": 1}"#).unwrap();
    assert_eq!((default.cells(), default.steps(), default.flatten), ([32, 32], 3, FlattenKind::QuasiNewton));
    let given =
        request(r#"{"kind": "sphere", "radius": 1, "grid": [4, 5], "reach": 1, "flatten": "descent"}"#).unwrap();
    assert_eq!((given.cells(), given.steps(), given.flatten), ([4, 5], 1, FlattenKind::Descent));
}

#[test]
fn what_is_wrong_names_key_and_kind() {
    for (text, words) in [
        ("{}", "neither `kind` nor `file`"),
        (r#"{"kind": "cylinder", "height": 1}"#, "the kind \"cylinder\" needs `radius`"),
        (
            r#"{"kind": "cylinder", "radius": 1, "height": 1, "major": 2}"#,
            "`major` does not belong to a surface of the kind \"cylinder\", but to \"torus\"",
        ),
        (r#"{"kind": "plane", "radius": 1}"#, "but to \"cylinder\", \"sphere\""),
        (r#"{"kind": "plane", "size": [1, 1], "patch": 1}"#, "but to a `file`"),
        (r#"{"kind": "plane", "size": [1, 1], "sides": [[1, 0, 0], [0, 1, 0]]}"#, "a plane without `sides`"),
        (r#"{"kind": "plane"}"#, "needs `size`"),
        (r#"{"kind": "plane", "size": [1, 0]}"#, "side 1 is (0, 0, 0)"),
        (r#"{"kind": "sphere", "radius": -1}"#, "the radius is -1"),
        (r#"{"kind": "sphere", "radius": 1, "angles": [90, 0]}"#, "from 90 to 0 degrees"),
        (r#"{"kind": "torus", "major": 1, "minor": 2}"#, "the minor radius 2"),
        (r#"{"kind": "nurbs", "controls": [[[0, 0, 0]]]}"#, "needs `weights`"),
        (r#"{"kind": "bezier", "controls": []}"#, "0 control points"),
        (r#"{"kind": "bezier", "controls": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0]]]}"#, "controls[1] has 1 entries"),
        (
            r#"{"kind": "bezier", "controls": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]], "weights": [[1, 1]]}"#,
            "1 rows of weights: there must be 2",
        ),
        (
            r#"{"kind": "bezier", "controls": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]], "weights": [[1], [1]]}"#,
            "1 weights in a row: there must be 2",
        ),
        (
            r#"{"kind": "bspline", "degree": [3, 1], "controls": [[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]]}"#,
            "along s: 2 control points are too few",
        ),
        (r#"{"kind": "revolve"}"#, "needs `profile`"),
        (r#"{"kind": "extrude", "profile": [[0, 0, 0], [1, 0, 0]]}"#, "needs `along`"),
        (r#"{"kind": "extrude", "profile": [[0, 0, 0]], "along": [0, 0, 1]}"#, "extent of the control points is 0"),
        (r#"{"kind": "heightfield", "heights": [[0, 1], [1, 0]]}"#, "needs `size`"),
        (r#"{"kind": "heightfield", "size": [1, -1], "heights": [[0, 1], [1, 0]]}"#, "side along y is -1"),
        (r#"{"kind": "heightfield", "size": [1, 1], "heights": [[0, 1]]}"#, "along s: 1 control points"),
        (r#"{"kind": "heightfield", "size": [1, 1], "heights": [[], []]}"#, "control points"),
        (r#"{"kind": "grid", "points": [[], []]}"#, "control points"),
        (r#"{"kind": "sphere", "radius": 1, "grid": [0, 4]}"#, "`grid` is 0"),
        (r#"{"kind": "sphere", "radius": 1, "reach": 0}"#, "`reach` is 0"),
        (r#"{"kind": "sphere", "radius": 1, "frame": {"z": [1, 0, 0], "x": [2, 0, 0]}}"#, "parallel"),
        (r#"{"kind": "sphere", "file": "a.json"}"#, "`kind` has no meaning beside `file`"),
        (r#"{"radius": 1, "file": "a.json"}"#, "`radius` has no meaning beside `file`"),
        (r#"{"file": "a.json"}"#, "not read"),
    ] {
        let error = surface(text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn texts_that_are_no_request() {
    for (text, words) in [
        (r#"{"knid": "plane"}"#, "unknown field `knid`, expected one of `kind`"),
        (r#"{"kind": "cilinder"}"#, "unknown variant `cilinder`, expected one of `plane`, `cylinder`"),
        (r#"{"angles": [0, 90, 180]}"#, "a list of 2"),
        (r#"{"at": [0, 0]}"#, "a list of 3"),
        (r#"{"controls": [[[0, 0, 0, 0]]]}"#, "a list of 3"),
        (r#"{"frame": {"z": [0, 0, 1]}}"#, "missing field `x`"),
        (r#"{"profile": [[0, 0]]}"#, "a profile is a list of points"),
        (r#"{"grid": [-1, 2]}"#, "-1"),
        (r#"{"flatten": "quasi"}"#, "expected `quasi-newton` or `descent`"),
    ] {
        let error = request(text).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn a_file_s_surface_is_placed_and_flipped() {
    let read = Surface::plane(DVec3::ZERO, [DVec3::X, DVec3::Y]);
    let made = request(r#"{"file": "a.json", "at": [0, 0, 1], "flip": true}"#).unwrap().surface(Some(read)).unwrap();
    assert_eq!((made.jet(0.25, 0.5).point, made.normal(0.5, 0.5)), (DVec3::new(0.75, 0.5, 1.0), Some(-DVec3::Z)));
}
