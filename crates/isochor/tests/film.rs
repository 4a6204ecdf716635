//! Films: values between keys, errors, and frames that are jobs like any other.

#![cfg(feature = "serde")]

use isochor::{
    Amount, Drag, Edit, Examination, Factors, Film, Job, JobInput, JobTextError, Move, Noise, PointRequest, Scale,
    Source, Twist, VolumeTarget, shapes,
};

/// The degrees of the twist in every frame of a film.
fn degrees(film: &Film) -> Vec<f64> {
    let of = |frame| match &film.job(frame).unwrap().edit[0] {
        Edit::Twist(Twist { degrees, .. }) => *degrees,
        other => panic!("{other:?}"),
    };
    (0..film.frames()).map(of).collect()
}

fn twist(frames: &str, degrees: &str) -> Film {
    let text = format!("{frames}\n[[edit]]\ntwist = {{ axis = \"z\", degrees = {degrees} }}");
    Film::from_toml(&text).unwrap()
}

fn assert_near(found: &[f64], expected: &[f64]) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-13 * b.abs().max(1.0);
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(near), "{found:?} instead of {expected:?}");
}

#[test]
fn values_between_keys_lie_on_lines() {
    let film = twist("frames = 9", "{ keys = [[0, 10], [0.5, 180], [1, -20]] }");
    // (1 − w) a + w b with w = 0, ¼, ½, ¾ from key to key
    let expected = [10.0, 52.5, 95.0, 137.5, 180.0, 130.0, 80.0, 30.0, -20.0];
    assert_near(&degrees(&film), &expected);
    let ends = [film.job(0), film.job(4), film.job(8)].map(|job| job.unwrap().edit);
    let at = |degrees| vec![Edit::Twist(Twist { degrees, ..Twist::default() })];
    assert_eq!(ends, [at(10.0), at(180.0), at(-20.0)], "keys are met exactly");
}

#[test]
fn smooth_values_follow_the_smooth_step() {
    let film = twist("frames = 9", "{ keys = [[0, 0], [1, 64]], ease = \"smooth\" }");
    // 64 w² (3 − 2w) at w = k/8: k² (24 − 2k) / 8
    let expected: Vec<f64> = (0..9).map(|k| f64::from(k * k * (24 - 2 * k)) / 8.0).collect();
    assert_near(&degrees(&film), &expected);
}

#[test]
fn steps_hold_until_the_next_key() {
    let film = twist("frames = 5", "{ keys = [[0, 1], [0.5, 2], [1, 3]], ease = \"step\" }");
    assert_eq!(degrees(&film), [1.0, 1.0, 2.0, 2.0, 3.0]);
    let text = "frames = 3\n[[edit]]\nnoise = { amplitude = 0.1, seed = { keys = [[0, 7], [1, 9]], ease = \"step\" } }";
    let film = Film::from_toml(text).unwrap();
    let seeds = [0, 1, 2].map(|frame| match &film.job(frame).unwrap().edit[0] {
        Edit::Noise(Noise { seed, .. }) => *seed,
        other => panic!("{other:?}"),
    });
    assert_eq!(seeds, [7, 7, 9], "whole numbers stay whole");
}

#[test]
fn values_hold_before_the_first_key_and_after_the_last() {
    let film = twist("frames = 5", "{ keys = [[0.25, 8], [0.75, 16]] }");
    assert_near(&degrees(&film), &[8.0, 8.0, 12.0, 16.0, 16.0]);
}

#[test]
fn a_loop_does_not_show_its_end() {
    let keys = "{ keys = [[0, 0], [1, 360]] }";
    let film = twist("frames = 4\nloop = true", keys);
    assert_eq!([0, 1, 2, 3].map(|frame| film.time(frame)), [0.0, 0.25, 0.5, 0.75]);
    assert_near(&degrees(&film), &[0.0, 90.0, 180.0, 270.0]);
    let film = twist("frames = 4\nloop = false", keys);
    assert_near(&degrees(&film), &[0.0, 120.0, 240.0, 360.0]);
    assert_eq!((film.time(0), film.time(3)), (0.0, 1.0));
}

#[test]
fn lists_volumes_and_single_entries_can_be_keyed() {
    let film = Film::from_toml(
        "frames = 3
        [[edit]]
        move = { by = { keys = [[0, [0, 0, 1]], [1, [2, 4, 1]]] } }
        [[edit]]
        scale = { by = [1, 1, { keys = [[0, 1.0], [1, 0.5]] }] }
        [[edit]]
        drag = { points = [{ vertex = 3, to = { keys = [[0, [0, 0, 0]], [1, [1, 0, 0]]] } }] }
        [preserve.volume]
        keys = [[0, \"100%\"], [1, \"150%\"]]
        [preserve.falloff]
        vertex = { keys = [[0, 3], [1, 3]] }
        radius.keys = [[0, 1], [1, 2]]",
    )
    .unwrap();
    let job = film.job(1).unwrap();
    let expected = Job::from_toml(
        "[[edit]]
        move = { by = [1, 2, 1] }
        [[edit]]
        scale = { by = [1, 1, 0.75] }
        [[edit]]
        drag = { vertex = 3, to = [0.5, 0, 0] }
        [preserve]
        volume = \"125%\"
        falloff = { vertex = 3, radius = 1.5 }",
    )
    .unwrap();
    assert_eq!(job, expected);
    assert!(matches!(&job.edit[..], [Edit::Move(Move { .. }), Edit::Scale(Scale { by: Factors::PerAxis(_), .. }), _]));
    let Edit::Drag(Drag { points, .. }) = &job.edit[2] else { panic!("{job:?}") };
    assert_eq!(points[..], [PointRequest { vertex: 3, to: glam::DVec3::new(0.5, 0.0, 0.0) }]);

    let volume = |volume: &str, frame| {
        let text = format!("frames = 3\n[preserve]\nvolume = {volume}");
        Film::from_toml(&text).unwrap().job(frame).unwrap().preserve.volume
    };
    let absolute = "{ keys = [[0, 1], [1, 2.5]] }";
    assert_eq!(volume(absolute, 1), VolumeTarget::Amount(Amount::Absolute(1.75)));
    let range = "{ min = { keys = [[0, \"80%\"], [1, \"100%\"]] }, max = 4 }";
    let (min, max) = (Some(Amount::Percent(90.0)), Some(Amount::Absolute(4.0)));
    assert_eq!(volume(range, 1), VolumeTarget::Range { min, max });
    let parts = "{ parts = [{ components = [0], volume = { keys = [[0, \"100%\"], [1, \"120%\"]] } }] }";
    let VolumeTarget::Parts(parts) = volume(parts, 1) else { panic!() };
    assert_eq!(parts[0].volume, Amount::Percent(110.0));
}

#[test]
fn constant_values_give_the_jobs_of_the_text_without_keys() {
    let text = |value: &dyn Fn(&str) -> String, head: &str| {
        format!(
            "{head}model = \"a.ply\"\n[lattice]\nsize = [4, 5, 6]\n[[edit]]\ntwist = {{ axis = \"z\", degrees = {}, range = {} }}\n\
             [[edit]]\nmove = {{ by = {}, nodes = {{ sphere = {{ center = [0, 0, 0], radius = {} }} }} }}\n\
             [preserve]\nvolume = {}\npoints = [{{ vertex = {}, to = [0.1, 0, 0] }}]\n",
            value("90"),
            value("[0.1, 0.30000000000000004]"),
            value("[0.1, 1e-300, -7]"),
            value("2.5"),
            value("\"110.1%\""),
            value("12"),
        )
    };
    let job = Job::from_toml(&text(&str::to_owned, "")).unwrap();
    for ease in ["linear", "smooth", "step"] {
        let keyed =
            |value: &str| format!("{{ keys = [[0, {value}], [0.3, {value}], [1, {value}]], ease = \"{ease}\" }}");
        let film = Film::from_toml(&text(&keyed, "frames = 7\n")).unwrap();
        for frame in 0..7 {
            assert_eq!(film.job(frame), Ok(job.clone()), "{ease}, frame {frame}");
        }
    }
    let film = Film::from_toml(&text(&str::to_owned, "frames = 7\n")).unwrap();
    assert_eq!((film.frames(), film.job(6)), (7, Ok(job)));
}

#[test]
fn json_films_are_those_of_toml() {
    let toml = "frames = 5\nloop = true\n[[edit]]\ntwist = { axis = \"z\", degrees = { keys = [[0, 0], [1, 90]], ease = \"smooth\" } }\n\
                [preserve]\nvolume = { keys = [[0, \"100%\"], [1, \"120%\"]] }";
    let json = r#"{ "frames": 5, "loop": true, "report": null,
        "edit": [{ "twist": { "axis": "z", "degrees": { "keys": [[0, 0], [1, 90]], "ease": "smooth" }, "range": null } }],
        "preserve": { "volume": { "keys": [[0, "100%"], [1, "120%"]] } } }"#;
    let [toml, json] = [Film::from_toml(toml), Film::from_json(json)].map(Result::unwrap);
    for frame in 0..5 {
        assert_eq!(toml.job(frame), json.job(frame));
        assert_eq!(toml.time(frame), json.time(frame));
    }
}

#[test]
fn a_text_without_frames_is_a_film_of_one_frame() {
    for text in ["", "model = \"a.ply\"\n[[edit]]\ntwist = { axis = \"z\", degrees = 9 }"] {
        let film = Film::from_toml(text).unwrap();
        assert_eq!((film.frames(), film.time(0), film.job(0)), (1, 0.0, Job::from_toml(text)));
    }
    let film =
        Film::from_json(r#"{ "edit": [{ "noise": { "amplitude": 1, "seed": 18446744073709551615 } }] }"#).unwrap();
    let Edit::Noise(noise) = &film.job(0).unwrap().edit[0] else { panic!() };
    assert_eq!((film.frames(), noise.seed), (1, u64::MAX), "beyond the integers of TOML");
}

/// The error of a TOML text, as a film or in its first frame.
fn error(text: &str) -> JobTextError {
    Film::from_toml(text).and_then(|film| film.job(0)).unwrap_err()
}

#[test]
fn bad_numbers_of_frames_are_refused() {
    for frames in ["0", "1", "-3", "10001", "2.0", "\"36\"", "[2]", "99999999999999999999"] {
        let error = error(&format!("model = \"a\"\nframes = {frames}"));
        assert!(error.what.contains("from 2 to 10000") && error.what.contains("leave it out"), "{frames}: {error}");
        assert_eq!(error.line, Some(2), "{frames}");
    }
    let json = Film::from_json("{ \"frames\": 1 }").unwrap_err();
    assert!(json.what.contains("from 2 to 10000") && json.line.is_none(), "{json}");
    let alone = error("loop = true");
    assert!(alone.what.contains("add frames = 36"), "{alone}");
    let word = error("frames = 2\nloop = \"yes\"");
    assert_eq!((word.what.as_str(), word.line), ("loop must be true or false", Some(2)));
}

#[test]
fn bad_keys_are_named_with_their_place() {
    for (value, fragment) in [
        ("{ keys = [] }", "two keys [time, value] or more"),
        ("{ keys = [[0, 1]] }", "two keys [time, value] or more"),
        ("{ keys = 3 }", "two keys [time, value] or more"),
        ("{ keys = [[0, 1], 3] }", "keys[1] must be a list [time, value]"),
        ("{ keys = [[0, 1], [1, 2, 3]] }", "keys[1] must be a list [time, value]"),
        ("{ keys = [[0, 1], [1.5, 2]] }", "keys[1] must begin with a time from 0"),
        ("{ keys = [[-0.1, 1], [1, 2]] }", "keys[0] must begin with a time from 0"),
        ("{ keys = [[\"0%\", 1], [1, 2]] }", "keys[0] must begin with a time from 0"),
        ("{ keys = [[nan, 1], [1, 2]] }", "keys[0] must begin with a time from 0"),
        ("{ keys = [[0, 1], [0.5, 2], [0.5, 3]] }", "keys[2] is at time 0.5, not after 0.5"),
        ("{ keys = [[0.5, 1], [0.2, 2]] }", "order them by time"),
        ("{ keys = [[0, inf], [1, 2]] }", "keys[0] must end with a finite number"),
        ("{ keys = [[0, 1], [1, nan]] }", "keys[1] must end with a finite number"),
        ("{ keys = [[0, 1], [1, \"much\"]] }", "keys[1] must end with a finite number, a percentage"),
        ("{ keys = [[0, true], [1, 2]] }", "keys[0] must end with a finite number"),
        ("{ keys = [[0, { keys = [[0, 1], [1, 2]] }], [1, 2]] }", "keys[0] must end with a finite number"),
        ("{ keys = [[0, 1], [1, \"120%\"]] }", "keys[1] is of another kind"),
        ("{ keys = [[0, [1, 2]], [1, [1, 2, 3]]] }", "lists of one length"),
        ("{ keys = [[0, 1], [1, 2]], ease = \"smoth\" }", "unknown ease `smoth`"),
        ("{ keys = [[0, 1], [1, 2]], ease = 3 }", "unknown ease ``"),
        ("{ keys = [[0, 1], [1, 2]], eas = \"step\" }", "unknown field `eas`"),
    ] {
        let error =
            error(&format!("frames = 3\n[[edit]]\nmove = {{ by = [0, 0, 1] }}\n[[edit]]\ntwist.degrees = {value}"));
        assert!(error.what.starts_with("edit[1].twist.degrees: "), "{value}: {error}");
        assert!(error.what.contains(fragment), "{value}: {error}");
        assert_eq!(error.line, Some(5), "{value}");
        assert!(error.column.is_some_and(|column| column > 10), "{value}: {error:?}");
    }
    let nearest =
        |ease: &str| error(&format!("frames = 2\n[preserve]\nvolume = {{ keys = [[0, 1], [1, 2]], {ease} }}")).nearest;
    assert_eq!(nearest("ease = \"smoth\"").as_deref(), Some("smooth"));
    assert_eq!(nearest("eas = 1").as_deref(), Some("ease"));
}

#[test]
fn keyed_values_of_the_wrong_kind_are_named_with_their_place() {
    for (line, path, fragment) in [
        (
            "[[edit]]\ntwist = { axis = \"z\", degrees = { keys = [[0, [1]], [1, [2]]] } }",
            "edit[0].twist.degrees",
            "f64",
        ),
        ("[[edit]]\nmove = { by = { keys = [[0, 1], [1, 2]] } }", "edit[0].move.by", "list of 3"),
        ("[[edit]]\nmove = { by = { keys = [[0, [1, 2]], [1, [2, 2]]] } }", "edit[0].move.by", "3"),
        ("[preserve]\nvolume = { keys = [[0, \"-5%\"], [1, \"5%\"]] }", "preserve.volume", "percentage such as"),
    ] {
        let error = error(&format!("frames = 3\n{line}"));
        assert!(
            error.what.starts_with(&format!("{path} at time 0: ")) && error.what.contains(fragment),
            "{line}: {error}"
        );
        assert_eq!(error.line, Some(3), "{line}");
    }
    // A whole number has none between 3 and 4.
    let text = "frames = 3\n[preserve]\nfalloff = { vertex = { keys = [[0, 3], [1, 4]] }, radius = 1 }";
    let film = Film::from_toml(text).unwrap();
    assert!(film.job(0).is_ok() && film.job(2).is_ok());
    let error = film.job(1).unwrap_err();
    assert!(error.what.starts_with("preserve.falloff.vertex at time 0.5: ") && error.what.contains("3.5"), "{error}");
    let json = r#"{ "frames": 3, "preserve": { "volume": { "keys": [[0, -1], [1, 1]] } } }"#;
    let error = Film::from_json(json).unwrap().job(0).unwrap_err();
    assert!(error.what.starts_with("preserve.volume at time 0: ") && error.line.is_none(), "{error:?}");
}

#[test]
fn other_errors_in_films_keep_their_place() {
    let error = error("frames = 3\n[lattice]\ndegre = 3\n");
    assert_eq!((error.line, error.column, error.nearest.as_deref()), (Some(3), Some(1), Some("degree")));
    let error = self::error("frames = 3\n[preserve\n");
    assert_eq!(error.line, Some(2));
}

#[test]
fn keys_belong_into_films_and_there_into_edits_and_what_is_preserved() {
    let keys = "{ keys = [[0, 0.1], [1, 0.2]] }";
    for (text, path) in [
        (format!("frames = 2\n[lattice]\nmargin = {keys}"), "lattice.margin"),
        (format!("frames = 2\n# comment\noutput = {keys}"), "output"),
    ] {
        let error = error(&text);
        assert!(
            error.what.starts_with(path)
                && error.what.contains("[[edit]], [preserve], [surface], [elastic] and [cage]"),
            "{error}"
        );
        assert_eq!(error.line, Some(3));
    }
    let text = format!("[[edit]]\ntaper = {{ axis = \"z\", scale = {keys} }}");
    for error in [Film::from_toml(&text).unwrap_err(), Job::from_toml(&text).unwrap_err()] {
        assert!(
            error.what.starts_with("edit[0].taper.scale has keys") && error.what.contains("add frames = 36"),
            "{error}"
        );
        assert_eq!(error.line, Some(2));
    }
    let json = r#"{ "edit": [{ "taper": { "axis": "z", "scale": { "keys": [[0, 1], [1, 2]] } } }] }"#;
    let error = Job::from_json(json).unwrap_err();
    assert!(
        error.what.starts_with("edit[0].taper.scale has keys") && error.what.contains("add frames = 36"),
        "{error}"
    );
}

#[test]
fn a_film_is_no_job() {
    for error in [
        Job::from_toml("model = \"a.ply\"\nframes = 36").unwrap_err(),
        Job::from_json("{ \"model\": \"a.ply\", \"frames\": 36 }").unwrap_err(),
    ] {
        assert!(error.what.contains("a film of 36 frames"), "{error}");
    }
    assert_eq!(Job::from_toml("model = \"a.ply\"\nframes = 36").unwrap_err().line, Some(2));
}

#[test]
#[should_panic(expected = "a film of 2 frames has no frame 2")]
fn a_frame_after_the_last_is_refused() {
    let _ = Film::from_toml("frames = 2").unwrap().job(2);
}

#[test]
fn every_frame_of_a_twisting_cube_has_its_volume() {
    let film = Film::from_toml(
        "frames = 9
        [[edit]]
        twist = { axis = \"z\", degrees = { keys = [[0, 0], [0.5, 180], [1, 0]], ease = \"smooth\" } }
        [preserve]
        volume = { keys = [[0, \"100%\"], [1, \"120%\"]] }
        axes = \"xy\"",
    )
    .unwrap();
    let cube = shapes::cube(8);
    let source = Source::of(&cube);
    let (input, examination) = (
        JobInput { mesh: &cube, source: &source, lattice: None, surface: None, cage: None },
        Examination::of(&cube, &source),
    );
    for frame in 0..9 {
        let job = film.job(frame).unwrap();
        let outcome = job.run_examined(&examination, &input, &mut |_| {}).unwrap();
        let volume = outcome.report.volume.as_ref().unwrap().overall;
        let target = 1.0 + 0.2 * film.time(frame);
        assert!((volume.corrected / target - 1.0).abs() <= 1e-13, "frame {frame}: {volume:?}");
        assert!((volume.target.unwrap() / target - 1.0).abs() <= 1e-15, "frame {frame}: {volume:?}");
        let again = job.run(&input, &mut |_| {}).unwrap();
        assert_eq!(again.points, outcome.points, "examined before or not");
        assert_eq!(again.report.model, outcome.report.model);
    }
}
