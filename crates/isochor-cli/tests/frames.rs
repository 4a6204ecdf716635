//! Films from end to end: a model for every frame, all of them or none.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use glam::DVec3;
use isochor::{OpenBoundaries, Solid, shapes, topology};
use isochor_io::{Document, Format};
use serde_json::Value;
use tempfile::TempDir;

const TWIST: &str = "model = \"shape:cube?n=6\"\noutput = \"out.ply\"\nreport = \"report.json\"\nframes = 5\n\
    [[edit]]\ntwist = { axis = \"z\", degrees = { keys = [[0, 0], [1, 180]] } }\n\
    [preserve]\nvolume = { keys = [[0, \"100%\"], [1, \"120%\"]] }\n";

struct Folder(TempDir);

impl Folder {
    fn with(job: &str) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        std::fs::write(folder.path("film.toml"), job).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn isochor(&self, line: &str) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
        command.current_dir(self.0.path()).args(line.split_whitespace()).output().unwrap()
    }

    /// The report of a film that succeeds.
    fn film(&self, line: &str) -> Value {
        let ran = self.isochor(&format!("deform --json --quiet {line}"));
        assert_eq!(ran.status.code(), Some(0), "{}", String::from_utf8_lossy(&ran.stdout));
        serde_json::from_slice(&ran.stdout).unwrap()
    }

    /// The failure of one that does not, with its exit code.
    fn failure(&self, line: &str) -> (Option<i32>, Value) {
        let ran = self.isochor(&format!("deform --json --quiet {line}"));
        let report: Value = serde_json::from_slice(&ran.stdout).unwrap();
        (ran.status.code(), report["error"].clone())
    }

    /// Names of all files, in order.
    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn points(&self, name: &str) -> Vec<DVec3> {
        let format = Format::from_path(Path::new(name)).unwrap();
        Document::parse(std::fs::read(self.path(name)).unwrap(), format).unwrap().mesh().points().to_vec()
    }
}

#[test]
fn a_film_is_a_model_for_every_frame_and_one_report() {
    let folder = Folder::with(TWIST);
    let report = folder.film("--job film.toml --save-controls controls.json");
    let mut expected = ["film.toml", "report.json", "out-strip.png", "out-film.png"].map(str::to_owned).to_vec();
    expected.extend((1..=5).flat_map(|f| [format!("out-000{f}.ply"), format!("controls-000{f}.json")]));
    expected.sort();
    assert_eq!(folder.names(), expected);
    let written: Value = serde_json::from_slice(&std::fs::read(folder.path("report.json")).unwrap()).unwrap();
    assert_eq!(written, report);
    assert_eq!((&report["model"]["vertices"], &report["model"]["verdict"]), (&218.into(), &"ok".into()));

    let cube = shapes::cube(6);
    let solid = Solid::new(&cube, &topology(&cube), OpenBoundaries::Refuse).unwrap();
    let frames = report["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 5);
    for (f, frame) in frames.iter().enumerate() {
        let time = f as f64 / 4.0;
        assert_eq!(frame["time"].as_f64(), Some(time));
        for key in ["volume", "correction", "timings_ms", "warnings"] {
            assert!(frame.get(key).is_some(), "no {key} in {frame}");
        }
        let points = folder.points(&format!("out-000{}.ply", f + 1));
        let volume = solid.volume(&points);
        assert!((volume / (1.0 + 0.2 * time) - 1.0).abs() <= 1e-13, "frame {f}: {volume}");
        assert_eq!(frame["volume"]["written"].as_f64().map(|written| (written - volume).abs() < 1e-14), Some(true));
    }
    assert_eq!(folder.points("out-0001.ply"), cube.points(), "nothing has happened yet");
    let people = folder.isochor("deform --job film.toml");
    let text = String::from_utf8(people.stderr).unwrap();
    for line in
        ["volume at rest   1.000000000000", "relative error at most", "wrote 5 files, out-0001.ply to out-0005.ply"]
    {
        assert!(text.contains(line), "{text}");
    }
    assert!(people.stdout.is_empty());
}

#[test]
fn each_frame_is_the_job_with_its_values() {
    let folder = Folder::with(TWIST);
    folder.film("--job film.toml");
    folder.film("shape:cube?n=6 -o single.ply --twist z=90 --volume 110%");
    assert_eq!(folder.points("single.ply"), folder.points("out-0003.ply"));
    let json = r#"{ "model": "shape:cube?n=6", "output": "json.ply", "frames": 5,
        "edit": [{ "twist": { "axis": "z", "degrees": { "keys": [[0, 0], [1, 180]] } } }],
        "preserve": { "volume": { "keys": [[0, "100%"], [1, "120%"]] } } }"#;
    std::fs::write(folder.path("film.json"), json).unwrap();
    folder.film("--job film.json");
    for f in 1..=5 {
        let [toml, json] =
            ["out", "json"].map(|name| std::fs::read(folder.path(&format!("{name}-000{f}.ply"))).unwrap());
        assert!(toml == json, "frame {f}");
    }
}

#[test]
fn flags_hold_for_all_frames() {
    let folder = Folder::with(TWIST);
    let report = folder.film("--job film.toml -o other.obj --report other.json --preserve free --stretch z=0.5");
    let row = |f: usize, key: &str| report["frames"][f]["volume"][key].clone();
    for f in 0..5 {
        assert_eq!((row(f, "target"), row(f, "final")), (Value::Null, row(f, "posed")));
    }
    assert!((row(0, "posed").as_f64().unwrap() - 0.5).abs() < 1e-14);
    let names = folder.names();
    assert!(names.contains(&"other-0005.obj".into()) && names.contains(&"other.json".into()), "{names:?}");
    assert!(!names.contains(&"report.json".into()) && names.len() == 9, "{names:?}");
}

#[test]
fn a_frame_that_fails_leaves_nothing() {
    // Everything is pinned: what has another volume cannot get it back. The first frame has the one it had.
    let pinned =
        TWIST.replace("[preserve]\nvolume = { keys = [[0, \"100%\"], [1, \"120%\"]] }", "[preserve]\npin = \"all\"");
    let folder = Folder::with(&pinned);
    let (code, error) = folder.failure("--job film.toml");
    assert_eq!((code, &error["code"]), (Some(1), &"impossible".into()), "{error}");
    assert!(error["where"].as_str().unwrap().ends_with(", frame 2 at time 0.25"), "{error}");
    assert_eq!(folder.names(), ["film.toml"]);

    // A vertex between two whole numbers, in the middle.
    let folder =
        Folder::with(&format!("{TWIST}falloff = {{ vertex = {{ keys = [[0, 3], [0.5, 3], [1, 5]] }}, radius = 1 }}\n"));
    let (code, error) = folder.failure("--job film.toml");
    assert_eq!(code, Some(2));
    assert!(error["what"].as_str().unwrap().starts_with("preserve.falloff.vertex at time 0.75"), "{error}");
    assert!(error["where"].as_str().unwrap().contains("film.toml, line 9"), "{error}");
    assert_eq!(folder.names(), ["film.toml"]);

    // A folder in the way of a later frame.
    let folder = Folder::with(TWIST);
    std::fs::create_dir(folder.path("out-0004.ply")).unwrap();
    let (code, error) = folder.failure("--job film.toml");
    assert_eq!((code, &error["where"]), (Some(2), &"out-0004.ply".into()));
    assert_eq!(folder.names(), ["film.toml", "out-0004.ply"]);
}

#[test]
fn bad_films_end_with_2() {
    for (job, flags, fragment, place) in [
        (TWIST.replace("frames = 5", "frames = 1"), "", "from 2 to 10000", "film.toml, line 4"),
        (TWIST.replace("frames = 5\n", ""), "", "add frames = 36", "film.toml, line 5"),
        (TWIST.replace("[1, 180]", "[0, 180]"), "", "edit[0].twist.degrees: keys[1] is at time 0", "film.toml, line 6"),
        (TWIST.into(), "--in-place", "a film has many models", "--in-place"),
        (TWIST.replace("\"out.ply\"", "\"out\""), "", "extension", "out"),
        (TWIST.replace("\"report.json\"", "\"report.txt\""), "", "JSON", "report.txt"),
        (
            TWIST.replace(
                "\"out.ply\"",
                "\"out.ply\"\nsave_controls = \"out.json\"\nlattice = { file = \"out-0001.json\" }",
            ),
            "",
            "overwrite",
            "out-0001.json",
        ),
    ] {
        let folder = Folder::with(&job);
        let (code, error) = folder.failure(&format!("--job film.toml {flags}"));
        assert_eq!(code, Some(2), "{error}");
        assert!(error["what"].as_str().unwrap().contains(fragment), "{fragment}: {error}");
        assert!(error["where"].as_str().unwrap().contains(place), "{place}: {error}");
        assert_eq!(folder.names(), ["film.toml"]);
    }
}

#[test]
fn more_frames_than_a_process_may_have_open_files() {
    let many = TWIST.replace("n=6", "n=1").replace("frames = 5", "frames = 1100").replace("out.ply", "many.stl");
    let folder = Folder::with(&many.replace("[[edit]]", "lattice.size = 2\nview.film = false\n[[edit]]"));
    let report = folder.film("--job film.toml");
    assert_eq!(report["frames"].as_array().unwrap().len(), 1100);
    assert_eq!(folder.names().len(), 1102);
    assert!(folder.path("many-1100.stl").is_file());
}

/// A cylinder whose radius grows, with a plate that is laid round it.
#[test]
fn films_along_surfaces_report_the_surface_of_every_frame() {
    let folder = Folder::with(
        "model = \"shape:plate?n=12\"\noutput = \"out.ply\"\nframes = 3\nview.size = [100, 120]\n[surface]\nkind = \"cylinder\"\n\
         radius = { keys = [[0, 0.5], [1, 1]] }\nheight = 2\ngrid = [8, 4]\nrefine = \"off\"\n",
    );
    let report = folder.film("--job film.toml");
    for (f, frame) in report["frames"].as_array().unwrap().iter().enumerate() {
        assert_eq!(frame["surface"]["cells"], serde_json::json!([8, 4]));
        let scale = frame["surface"]["height_scale"].as_f64().unwrap();
        let radius = 0.5 + 0.25 * f as f64;
        let heights: Vec<f64> =
            folder.points(&format!("out-000{}.ply", f + 1)).iter().map(|p| p.truncate().length() - radius).collect();
        // The plate is 0.05 high.
        assert!(heights.iter().all(|h| h.abs().min((h - 0.05 * scale).abs()) < 1e-12), "frame {f}: {heights:?}");
        assert!(frame["volume"]["relative_error"].as_f64().unwrap() <= 1e-13);
    }
    // The grid of the surface is drawn, or not.
    let [with, without] = ["", "--no-lattice"].map(|flags| {
        folder.film(&format!("--job film.toml {flags}"));
        std::fs::read(folder.path("out-strip.png")).unwrap()
    });
    assert!(with != without);
}

#[test]
fn example_films_run() {
    let films = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/jobs/films");
    for (name, frames) in [("bounce", 24), ("twist", 36)] {
        let folder = Folder::with(&std::fs::read_to_string(films.join(name).with_extension("toml")).unwrap());
        let report = folder.film("--job film.toml");
        assert_eq!((report["frames"].as_array().unwrap().len(), folder.names().len()), (frames, frames + 4));
        let last = &report["frames"][frames - 1];
        assert!(last["time"].as_f64().unwrap() < 1.0 && last["volume"]["relative_error"].as_f64().unwrap() <= 1e-13);
    }
}

/// Frames of an animated PNG, the milliseconds of each, and its width and height.
fn animation(bytes: &[u8]) -> (u32, Vec<u32>, [u32; 2]) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let control = *reader.info().animation_control().expect("it is animated");
    assert_eq!(control.num_plays, 0, "for ever");
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let mut delays = Vec::new();
    for _ in 0..control.num_frames {
        reader.next_frame(&mut pixels).unwrap();
        let frame = *reader.info().frame_control().unwrap();
        delays.push(1000 * u32::from(frame.delay_num) / u32::from(frame.delay_den));
    }
    (control.num_frames, delays, [reader.info().width, reader.info().height])
}

/// Width and height of a PNG file of one image.
fn image(bytes: &[u8]) -> [u32; 2] {
    let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    assert!(reader.info().animation_control().is_none(), "it moves");
    [reader.info().width, reader.info().height]
}

#[test]
fn a_film_has_a_strip_and_an_animation_beside_its_models() {
    let folder = Folder::with(&TWIST.replace("frames = 5", "frames = 5\nview.size = [100, 120]"));
    folder.film("--job film.toml");
    let [strip, film] = ["out-strip.png", "out-film.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    let (frames, delays, [width, height]) = animation(&film);
    assert_eq!((frames, delays), (5, vec![80; 5]));
    assert!((100..130).contains(&width) && (40..240).contains(&height), "{width} × {height}");
    // Five panels in rows of four: the fewest whose square is at least twice five.
    let [width, height] = image(&strip);
    assert!((400..500).contains(&width) && height > 2 * 40, "{width} × {height}");

    let people = String::from_utf8(folder.isochor("deform --job film.toml").stderr).unwrap();
    for name in ["out-strip.png", "out-film.png", "report.json"] {
        assert_eq!(people.matches(&format!("wrote {name}\n")).count(), 1, "{people}");
    }
    assert!(std::fs::read(folder.path("out-film.png")).unwrap() == film, "the same bytes again");

    // Relative to the folder of the job file, as its models are.
    std::fs::create_dir(folder.path("sub")).unwrap();
    std::fs::rename(folder.path("film.toml"), folder.path("sub/film.toml")).unwrap();
    folder.film("--job sub/film.toml");
    assert!(std::fs::read(folder.path("sub/out-strip.png")).unwrap() == strip);
}

#[test]
fn films_are_coloured_by_stress() {
    let strip = |color: &str| {
        let view = format!("frames = 5\nview = {{ size = [100, 120], color = \"{color}\" }}");
        let folder = Folder::with(&TWIST.replace("frames = 5", &view));
        folder.film("--job film.toml");
        std::fs::read(folder.path("out-strip.png")).unwrap()
    };
    // Neither plain, which pictures without values are, nor the usual colours.
    let stress = strip("stress");
    assert!(stress != strip("plain") && stress != strip("volume"));
}

#[test]
fn strips_of_wide_panels_have_fewer_in_a_row() {
    let wide = "frames = 12\npicture = \"strip.png\"\nview = { film = false, size = [8192, 64] }";
    let folder = Folder::with(&TWIST.replace("frames = 5", wide));
    folder.film("--job film.toml");
    let [width, height] = image(&std::fs::read(folder.path("strip.png")).unwrap());
    // Three in a row, none of them cut off; an image has at most 32,768 pixels across.
    assert!((3 * 8192..32_768).contains(&width) && height > 4 * 16, "{width} × {height}");
}

#[test]
fn films_that_are_too_large_to_draw_say_so_and_are_written_without() {
    let long = TWIST.replace("frames = 5", "frames = 10000");
    for (job, fragment) in [
        (long.clone(), "10000 frames of 400 × 400 pixels"),
        (TWIST.replace("frames = 5", "frames = 36\nview.size = [8192, 4096]"), "36 frames of 8192 × 4096 pixels"),
        (
            TWIST
                .replace("frames = 5", "frames = 5\nview.film = false\nview.size = [8192, 8192]\npicture = \"p.png\"")
                .replace("frames = 5", "frames = 12"),
            "12 frames of 8192 × 8192 pixels",
        ),
        // 6 · 30² + 2 vertices.
        (
            long.replace("n=6", "n=30").replace("frames", "view.size = [64, 64]\nframes"),
            "10000 frames of 5402 vertices",
        ),
    ] {
        let folder = Folder::with(&job);
        let (code, error) = folder.failure("--job film.toml");
        assert_eq!((code, &error["code"]), (Some(2), &"file".into()), "{error}");
        assert!(error["what"].as_str().unwrap().starts_with(fragment), "{fragment}: {error}");
        assert!(error["hint"].as_str().unwrap().contains("film = false"), "{error}");
        assert_eq!(folder.names(), ["film.toml"]);
    }
    let folder = Folder::with(&TWIST.replace("frames = 5", "frames = 5\nview.film = false\nview.size = [8192, 8192]"));
    folder.film("--job film.toml");
    assert_eq!(folder.names().len(), 7, "nothing is drawn, so nothing is too large");
}

#[test]
fn films_are_drawn_where_they_say_or_not_at_all() {
    let named = TWIST
        .replace("frames = 5", "frames = 5\npicture = \"some.png\"\nanimation = \"all.png\"\nview.milliseconds = 120");
    let folder = Folder::with(&named);
    folder.film("--job film.toml");
    let names = folder.names();
    assert!(names.contains(&"some.png".into()) && names.contains(&"all.png".into()) && names.len() == 9, "{names:?}");
    let (frames, delays, _) = animation(&std::fs::read(folder.path("all.png")).unwrap());
    assert_eq!((frames, delays), (5, vec![120; 5]));
    image(&std::fs::read(folder.path("some.png")).unwrap());

    let folder = Folder::with(&TWIST.replace("frames = 5", "frames = 5\nview.film = false"));
    folder.film("--job film.toml");
    assert_eq!(folder.names().iter().filter(|name| name.ends_with("png")).count(), 0);
    folder.film("--job film.toml --animation all.png");
    assert_eq!(folder.names().iter().filter(|name| name.ends_with("png")).count(), 1);

    for (flags, fragment) in [
        ("--report film.html", "reported as JSON"),
        ("--animation film.gif", "written as PNG"),
        ("--picture film.jpg", "written as PNG"),
        ("--picture out-film.png", "the animation would overwrite the picture"),
        ("--picture ./out-film.png", "the animation would overwrite the picture"),
        ("--animation out-strip.png", "the animation would overwrite the picture"),
        ("--picture p.png --animation ./p.png", "the animation would overwrite the picture"),
        ("--lattice-file out-strip.png", "the picture would overwrite the lattice file"),
        ("--lattice-file ./out-film.png", "the animation would overwrite the lattice file"),
    ] {
        let folder = Folder::with(TWIST);
        let (code, error) = folder.failure(&format!("--job film.toml {flags}"));
        assert_eq!(code, Some(2), "{error}");
        assert!(error["what"].as_str().unwrap().contains(fragment), "{error}");
        assert_eq!(folder.names(), ["film.toml"]);
    }
}
