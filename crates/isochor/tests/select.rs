//! Selectors: which control points they pick, and what they say when they cannot.

use glam::DVec3;
use isochor::{Basis, ControlSpace, Frame, Lattice, SelectError, Selector};

/// A lattice of clamped cubics: 4 × 5 × 6 control points over the box from −1 to 1, 2, 3, but measured from `origin`.
fn lattice() -> Lattice {
    let frame = Frame { origin: DVec3::splat(-1.0), axes: [DVec3::X * 2.0, DVec3::Y * 3.0, DVec3::Z * 4.0] };
    Lattice::new([4, 5, 6].map(|size| Basis::clamped(size, 3).unwrap()), frame).unwrap()
}

const ORIGIN: DVec3 = DVec3::new(1000.0, -500.0, 0.0);

fn picked(selector: &Selector) -> Result<Vec<[usize; 3]>, SelectError> {
    let lattice = lattice();
    let weights = weights(selector)?;
    Ok((0..weights.len()).filter(|c| weights[*c] > 0.0).map(|c| lattice.node(c)).collect())
}

fn weights(selector: &Selector) -> Result<Vec<f64>, SelectError> {
    let lattice = lattice();
    let space = ControlSpace {
        rest: &lattice.rest(),
        size: lattice.size(),
        bounds: lattice.frame().bounds(),
        extent: 4.0,
        origin: ORIGIN,
        vertices: None,
        solid: None,
    };
    let weights = selector.weights(&space)?;
    assert_eq!(weights.len(), 4 * 5 * 6);
    assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
    Ok(weights)
}

fn nodes(keep: impl Fn([usize; 3]) -> bool) -> Vec<[usize; 3]> {
    (0..120).map(|c| lattice().node(c)).filter(|n| keep(*n)).collect()
}

#[test]
fn all_is_the_default() {
    assert_eq!(Selector::default(), Selector::All);
    assert_eq!(weights(&Selector::All).unwrap(), vec![1.0; 120]);
}

#[test]
fn indices_intersect() {
    assert_eq!(picked(&"k=0".parse().unwrap()), Ok(nodes(|[_, _, k]| k == 0)));
    assert_eq!(picked(&"k=0,5".parse().unwrap()), Ok(nodes(|[_, _, k]| k == 0 || k == 5)));
    assert_eq!(picked(&"i=3 k=5,0".parse().unwrap()), Ok(nodes(|[i, _, k]| i == 3 && (k == 0 || k == 5))));
    assert_eq!(picked(&"i=1 j=2 k=3".parse().unwrap()), Ok(vec![[1, 2, 3]]));
}

#[test]
fn lists_pick_their_nodes() {
    assert_eq!(picked(&Selector::List(vec![[3, 4, 5], [0, 0, 1], [3, 4, 5]])), Ok(vec![[0, 0, 1], [3, 4, 5]]));
}

#[test]
fn boxes_are_in_model_coordinates_and_closed() {
    // The face x = 1 of the lattice, corners in mixed order.
    let corners = [DVec3::new(1.0, 2.0, -1.0), DVec3::new(1.0, -1.0, 3.0)].map(|p| p + ORIGIN);
    assert_eq!(picked(&Selector::Box(corners)), Ok(nodes(|[i, _, _]| i == 3)));
    // Rounded away by less than the tolerance: 1e-9 of the longest side, 4.
    let corners = corners.map(|p| p + DVec3::X * 3e-9);
    assert_eq!(picked(&Selector::Box(corners)), Ok(nodes(|[i, _, _]| i == 3)));
    let corners = corners.map(|p| p + DVec3::X * 2e-9);
    assert!(matches!(picked(&Selector::Box(corners)), Err(SelectError::Nothing { .. })));
}

#[test]
fn spheres_fall_off_smoothly() {
    let rest = lattice().rest();
    let center = rest[0];
    let far = rest[119].distance(center);
    let sphere = Selector::Sphere { center: center + ORIGIN, radius: 1.0, falloff: far - 1.0 };
    for (p, weight) in rest.iter().zip(weights(&sphere).unwrap()) {
        let t = ((p.distance(center) - 1.0) / (far - 1.0)).max(0.0);
        assert!((weight - (1.0 - 3.0 * t * t + 2.0 * t * t * t)).abs() < 1e-12, "{p}: {weight}");
    }
    // Half-way between the radius and its end the weight is 1/2.
    let half = Selector::Sphere { center: center + ORIGIN, radius: 0.0, falloff: 2.0 * far };
    assert!((weights(&half).unwrap()[119] - 0.5).abs() < 1e-12);
    // Without falloff: a ball; of radius 0: a point.
    let ball = Selector::Sphere { center: center + ORIGIN, radius: 1.5, falloff: 0.0 };
    assert_eq!(picked(&ball), Ok(nodes(|n| rest[lattice().index(n)].distance(center) <= 1.5)));
    let point = Selector::Sphere { center: center + ORIGIN, radius: 0.0, falloff: 0.0 };
    assert_eq!(picked(&point), Ok(vec![[0, 0, 0]]));
}

fn message(selector: &Selector) -> String {
    weights(selector).unwrap_err().to_string()
}

#[test]
fn what_picks_nothing_is_an_error() {
    assert_eq!(
        message(&Selector::Box([DVec3::ZERO; 2])),
        "no control point is selected by the box from [0, 0, 0] to [0, 0, 0]"
    );
    assert_eq!(message(&Selector::List(vec![])), "no control point is selected by a list of 0 control points");
    assert_eq!(message(&Selector::Indices([Some(vec![]), None, None])), "no control point is selected by i=");
    let sphere = Selector::Sphere { center: DVec3::ZERO, radius: 1.0, falloff: 0.5 };
    assert_eq!(
        message(&sphere),
        "no control point is selected by the sphere round [0, 0, 0] of radius 1 and falloff 0.5"
    );
}

#[test]
fn wrong_numbers_are_named() {
    let beyond = "k = 6 is beyond the lattice: it has 6 control points there, k = 0 to 5";
    assert_eq!(message(&"k=6".parse().unwrap()), beyond);
    assert_eq!(message(&Selector::List(vec![[0, 0, 0], [3, 4, 6]])), beyond);
    let sphere = |radius, falloff| Selector::Sphere { center: ORIGIN, radius, falloff };
    assert_eq!(message(&sphere(-1.0, 0.0)), "radius is -1: it must not be negative");
    assert_eq!(message(&sphere(1.0, f64::NAN)), "falloff is NaN: it must be finite");
    assert_eq!(message(&Selector::Box([DVec3::INFINITY, DVec3::ZERO])), "box is inf: it must be finite");
    // Finite but beyond all reason: no panic.
    assert!(matches!(weights(&Selector::Box([DVec3::MAX, DVec3::MAX])), Err(SelectError::Nothing { .. })));
    let far = Selector::Sphere { center: DVec3::MAX, radius: 0.0, falloff: f64::MIN_POSITIVE };
    assert!(matches!(weights(&far), Err(SelectError::Nothing { .. })));
}

#[test]
fn text_is_read_back() {
    for text in ["all", "k=0", "k=0,5", "i=0 k=5", "i=1,2 j=0 k=3"] {
        assert_eq!(text.parse::<Selector>().unwrap().to_string(), text);
    }
    assert_eq!("  k=5  i=0 ".parse::<Selector>(), "i=0 k=5".parse());
    for text in ["", "everything", "k", "k=", "k=-1", "k=1.5", "k = 0", "w=0", "kk=0", "k=0,", "all k=0", "i=0,k=5"] {
        let error = text.parse::<Selector>().unwrap_err();
        assert_eq!(error, SelectError::Text { text: text.to_owned() });
    }
    let twice = "k=0 k=5".parse::<Selector>().unwrap_err();
    assert_eq!(twice.to_string(), "`k=0 k=5` gives k twice: write several indices as `k=0,5`");
}

#[cfg(feature = "serde")]
mod written {
    use super::*;

    #[derive(Debug, serde::Serialize, serde::Deserialize)]
    struct Job {
        nodes: Selector,
    }

    fn read(toml: &str) -> Result<Selector, String> {
        toml::from_str::<Job>(&format!("nodes = {toml}")).map(|job| job.nodes).map_err(|e| e.message().to_owned())
    }

    #[test]
    fn all_forms_are_read_and_written() {
        let corners = [DVec3::new(0.0, 1.0, 2.0), DVec3::new(3.5, 4.0, -5.0)];
        let cases = [
            ("\"all\"", Selector::All),
            ("\"i=0 k=5\"", "i=0 k=5".parse().unwrap()),
            ("{ i = 0 }", "i=0".parse().unwrap()),
            ("{ k = [0, 5], j = 2 }", "j=2 k=0,5".parse().unwrap()),
            ("{ list = [[0, 1, 2], [3, 4, 5]] }", Selector::List(vec![[0, 1, 2], [3, 4, 5]])),
            ("{ box = [[0, 1, 2], [3.5, 4, -5]] }", Selector::Box(corners)),
            (
                "{ sphere = { center = [0, 1, 2], radius = 1 } }",
                Selector::Sphere { center: corners[0], radius: 1.0, falloff: 0.0 },
            ),
            (
                "{ sphere = { center = [0, 1, 2], radius = 1, falloff = 0.25 } }",
                Selector::Sphere { center: corners[0], radius: 1.0, falloff: 0.25 },
            ),
        ];
        for (toml, selector) in cases {
            assert_eq!(read(toml).as_ref(), Ok(&selector), "{toml}");
            let job = Job { nodes: selector.clone() };
            let toml = toml::to_string(&job).unwrap();
            assert_eq!(toml::from_str::<Job>(&toml).unwrap().nodes, selector, "{toml}");
            let json = serde_json::to_string(&job).unwrap();
            assert_eq!(serde_json::from_str::<Job>(&json).unwrap().nodes, selector, "{json}");
        }
        assert_eq!(serde_json::to_string(&read("{ k = 0 }").unwrap()).unwrap(), r#"{"k":[0]}"#);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (toml, expected) in [
            ("\"some\"", "`some` selects no control points"),
            (
                "3",
                "invalid type: integer `3`, expected a selector: \"all\" or a table with i, j, k, list, vertices, box or sphere",
            ),
            ("{ }", "this one has none of them"),
            ("{ k = 0, list = [[0, 0, 0]] }", "this one has k, list"),
            ("{ kk = 0 }", "unknown field `kk`, expected one of `i`, `j`, `k`, `list`, `vertices`, `box`, `sphere`"),
            ("{ k = -1 }", "invalid value: integer `-1`, expected an index (0 or more) or a list of them"),
            ("{ k = 0.5 }", "invalid type: floating point `0.5`, expected an index (0 or more) or a list of them"),
            ("{ k = [0, -2] }", "invalid value: integer `-2`, expected usize"),
            ("{ list = [[0, 1]] }", "invalid length 2, expected a list of 3"),
            ("{ box = [[0, 1, 2]] }", "invalid length 1, expected a list of 2"),
            ("{ sphere = { center = [0, 0, 0] } }", "missing field `radius`"),
            (
                "{ sphere = { center = [0, 0, 0], r = 1 } }",
                "unknown field `r`, expected one of `center`, `radius`, `falloff`",
            ),
        ] {
            let error = read(toml).unwrap_err();
            assert!(error.contains(expected), "{toml}: {error}");
        }
        // Numbers too many are no better than too few.
        for toml in [
            "{ list = [[0, 1, 2, 3]] }",
            "{ box = [[0, 1, 2], [0, 1, 2], [0, 1, 2]] }",
            "{ box = [[0, 1, 2], [0, 1, 2, 3]] }",
            "{ sphere = { center = [0, 1, 2, 3], radius = 1 } }",
        ] {
            assert!(read(toml).is_err(), "{toml}");
        }
    }
}
