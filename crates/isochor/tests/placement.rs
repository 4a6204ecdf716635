//! Placements: closed forms of the similarity.

use glam::{DMat3, DVec2, DVec3};
use isochor::{Beyond, Bounds, Height, HeightWord, Placement, PlacementError, Sheet, SheetFit, SignedAxis, Surface};

/// A plane sheet of 4 × 2 with its corner at (1, −1).
fn sheet() -> Sheet {
    let corner = DVec3::new(1.0, -1.0, 0.0);
    let surface = Surface::plane(corner, [DVec3::X * 4.0, DVec3::Y * 2.0]);
    Sheet::new(surface, [1, 1], [[1.0, -1.0], [1.0, 1.0], [5.0, -1.0], [5.0, 1.0]].map(DVec2::from_array).into())
}

/// A box of 2 × 3 × 5 about (10, 20, 30).
fn bounds() -> Bounds {
    let (center, half) = (DVec3::new(10.0, 20.0, 30.0), DVec3::new(1.0, 1.5, 2.5));
    Bounds { min: center - half, max: center + half }
}

#[test]
fn by_default_the_model_stands_in_the_middle_of_the_sheet() {
    let placed = Placement::default().placed(bounds(), &sheet()).unwrap();
    assert_eq!(placed.point(bounds().center()), DVec3::new(3.0, 0.0, 2.5));
    assert_eq!(placed.point(bounds().min), DVec3::new(2.0, -1.5, 0.0));
    assert_eq!((placed.matrix(), placed.scale()), (DMat3::IDENTITY, 1.0));
}

#[test]
fn every_axis_can_be_up_and_nothing_is_mirrored() {
    let axes = [
        (SignedAxis::X, DVec3::X, 2.0),
        (SignedAxis::Y, DVec3::Y, 3.0),
        (SignedAxis::Z, DVec3::Z, 5.0),
        (SignedAxis::MinusX, DVec3::NEG_X, 2.0),
        (SignedAxis::MinusY, DVec3::NEG_Y, 3.0),
        (SignedAxis::MinusZ, DVec3::NEG_Z, 5.0),
    ];
    for (up, axis, thickness) in axes {
        let placed = Placement { up, height: Height::Base(0.25), ..Placement::default() };
        let placed = placed.placed(bounds(), &sheet()).unwrap();
        assert_eq!(placed.matrix() * axis, DVec3::Z, "{up:?}");
        assert_eq!(placed.matrix().determinant(), 1.0, "{up:?}");
        let corners = [bounds().min, bounds().max].map(|p| placed.point(p).z);
        assert_eq!(corners[0].min(corners[1]), 0.25, "{up:?}");
        assert_eq!(corners[0].max(corners[1]), 0.25 + thickness, "{up:?}");
    }
}

#[test]
fn quarter_turns_do_not_round() {
    for (rotate, x) in
        [(90.0, DVec3::Y), (180.0, DVec3::NEG_X), (-90.0, DVec3::NEG_Y), (450.0, DVec3::Y), (720.0, DVec3::X)]
    {
        let placed = Placement { rotate, ..Placement::default() }.placed(bounds(), &sheet()).unwrap();
        assert_eq!(placed.matrix() * DVec3::X, x, "{rotate}");
    }
    let placed = Placement { rotate: 30.0, scale: 2.0, ..Placement::default() }.placed(bounds(), &sheet()).unwrap();
    assert!((placed.matrix() * DVec3::X).distance(DVec3::new(3f64.sqrt(), 1.0, 0.0)) < 1e-15);
}

#[test]
fn the_sheet_can_be_in_the_middle_and_the_model_at_a_corner() {
    let placement = Placement { at: [0.0, 1.0], height: Height::Word(HeightWord::Middle), ..Placement::default() };
    let placed = placement.placed(bounds(), &sheet()).unwrap();
    assert_eq!(placed.point(bounds().center()), DVec3::new(1.0, 1.0, 0.0));
}

#[test]
fn fits_are_the_largest_factors_at_which_the_turned_box_fits() {
    let scale =
        |fit, rotate| Placement { fit, rotate, ..Placement::default() }.placed(bounds(), &sheet()).unwrap().scale();
    assert_eq!(scale(SheetFit::Width, 0.0), 4.0 / 2.0);
    assert_eq!(scale(SheetFit::Height, 0.0), 2.0 / 3.0);
    assert_eq!(scale(SheetFit::Inside, 0.0), 2.0 / 3.0);
    assert_eq!(scale(SheetFit::Width, 90.0), 4.0 / 3.0);
    assert_eq!(scale(SheetFit::Inside, 90.0), 1.0);
    // (2 + 3)/√2 along both axes.
    assert!((scale(SheetFit::Inside, 45.0) - 2.0 * 2f64.sqrt() / 5.0).abs() < 1e-15);
    let twice = Placement { fit: SheetFit::Width, scale: 0.5, ..Placement::default() };
    assert_eq!(twice.placed(bounds(), &sheet()).unwrap().scale(), 1.0);
}

#[test]
fn a_model_without_width_has_no_factor() {
    let line = Bounds { min: DVec3::ZERO, max: DVec3::Y };
    let placement = Placement { fit: SheetFit::Width, ..Placement::default() };
    assert!(matches!(placement.placed(line, &sheet()), Err(PlacementError::NothingToFit { .. })));
    let placement = Placement { fit: SheetFit::Inside, ..Placement::default() };
    assert_eq!(placement.placed(line, &sheet()).unwrap().scale(), 2.0);
}

#[test]
fn numbers_must_be_finite_and_the_factor_positive() {
    let wrong = |placement: Placement| placement.placed(bounds(), &sheet()).unwrap_err().to_string();
    assert_eq!(wrong(Placement { rotate: f64::NAN, ..Placement::default() }), "place.rotate is NaN: it must be finite");
    assert_eq!(
        wrong(Placement { at: [0.0, f64::INFINITY], ..Placement::default() }),
        "place.at is inf: it must be finite"
    );
    assert_eq!(wrong(Placement { scale: 0.0, ..Placement::default() }), "place.scale is 0: it must be more than 0");
    assert_eq!(wrong(Placement { scale: -1.0, ..Placement::default() }), "place.scale is -1: it must be more than 0");
    let height = Height::Base(f64::NEG_INFINITY);
    assert_eq!(wrong(Placement { height, ..Placement::default() }), "place.height is -inf: it must be finite");
    let huge = Placement { scale: f64::MAX, ..Placement::default() };
    assert!(matches!(huge.placed(bounds(), &sheet()), Err(PlacementError::Extent { .. })));
}

#[cfg(feature = "serde")]
#[test]
fn placements_are_read_from_jobs() {
    let read = |text: &str| serde_json::from_str::<Placement>(text);
    assert_eq!(read("{}").unwrap(), Placement::default());
    let all = r#"{ "at": [0.25, 1], "rotate": 30, "scale": 2, "height": "middle", "up": "-y", "fit": "inside", "outside": "extend" }"#;
    let expected = Placement {
        at: [0.25, 1.0],
        rotate: 30.0,
        scale: 2.0,
        height: Height::Word(HeightWord::Middle),
        up: SignedAxis::MinusY,
        fit: SheetFit::Inside,
        outside: Beyond::Extend,
    };
    assert_eq!(read(all).unwrap(), expected);
    assert_eq!(read(r#"{ "height": 0.5 }"#).unwrap().height, Height::Base(0.5));
    for wrong in [r#"{ "turn": 3 }"#, r#"{ "at": [1, 2, 3] }"#, r#"{ "height": "top" }"#, r#"{ "up": "w" }"#] {
        assert!(read(wrong).is_err(), "{wrong}");
    }
    assert!(read(r#"{ "height": "top" }"#).unwrap_err().to_string().contains("a number or \"middle\""));
}

#[cfg(not(feature = "serde"))]
#[test]
fn what_is_beyond_the_sheet_is_refused_by_default() {
    assert_eq!(Placement::default().outside, Beyond::Refuse);
}
