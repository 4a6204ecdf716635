//! Built-in shapes by name: each is a body, and texts that name none say why.

use isochor::{BuiltIn, Health, ShapeName, ShapeNameError, Source, Verdict, shapes, topology};

#[test]
fn every_built_in_shape_bounds_a_body_at_its_usual_and_its_least_resolution() {
    for shape in BuiltIn::ALL {
        for n in [shape.usual, *shape.range.start()] {
            let mesh = ShapeName { shape, n }.mesh();
            let (health, _) = Health::of(&mesh, &topology(&mesh), &Source::of(&mesh));
            assert!(health.verdict == Verdict::Ok && health.warnings.is_empty(), "{}: {health:?}", shape.name);
            assert!(health.volume.is_some_and(|volume| volume.total > 0.0), "{}", shape.name);
        }
        assert!(shape.range.contains(&shape.usual));
    }
    let names: Vec<&str> = BuiltIn::ALL.iter().map(|shape| shape.name).collect();
    assert!(names.is_sorted(), "{names:?}");
}

#[test]
fn names_are_read_with_and_without_prefix_and_number() {
    for text in ["shape:cube?n=5", "cube?n=5"] {
        let name: ShapeName = text.parse().unwrap();
        assert_eq!((name.shape.name, name.n, name.to_string().as_str()), ("cube", 5, "shape:cube?n=5"));
        assert_eq!(name.mesh(), shapes::cube(5));
    }
    assert_eq!("shape:cube".parse::<ShapeName>().unwrap().mesh().points().len(), 6146);
}

#[test]
fn other_texts_name_the_nearest_shape_or_the_numbers_that_are_possible() {
    for (text, near) in [("screwdrver", "screwdriver"), ("shape:cub", "cube"), ("Ball", "ball"), ("flask2", "flask")] {
        let Err(ShapeNameError::Unknown { nearest, .. }) = text.parse::<ShapeName>() else { panic!("{text}") };
        assert_eq!(nearest, near);
    }
    for text in [
        "",
        "shape:",
        "?",
        "?n=3",
        "C:\\cube.obj",
        "cube?n=5?n=6",
        "cube?",
        "cube?n=",
        "cube?n=0",
        "cube?n=801",
        "cube?n=1.5",
    ] {
        assert!(text.parse::<ShapeName>().is_err(), "{text}");
    }
    let error = "ball?n=10".parse::<ShapeName>().unwrap_err().to_string();
    assert!(error.contains("\"n=10\" does not follow ball: it takes n=0 to n=9"), "{error}");
}
