//! Report pages without a browser: well formed, escaped, complete, and the embedded geometry is that of the model.

mod stories;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use isochor::{Axis, Faces, Mesh, Report, VolumeRow, fan, shapes};
use isochor_view::{Figure, IndexEntry, Page, Show, ShownLattice, ShownPose, index, page};
use scraper::{Html, Selector};
use serde_json::Value;
use sha2::{Digest, Sha256};
use stories::Story;

/// The page as a browser reads it; whatever a parser has to mend fails the test.
fn parsed(text: &str) -> Html {
    let html = Html::parse_document(text);
    assert_eq!(html.errors, [""; 0]);
    html
}

fn all<'a>(html: &'a Html, selector: &str) -> Vec<scraper::ElementRef<'a>> {
    html.select(&Selector::parse(selector).unwrap()).collect()
}

fn text(html: &Html, selector: &str) -> String {
    all(html, selector).iter().flat_map(|element| element.text()).collect()
}

fn bare(report: &Report) -> Page<'_> {
    Page { title: "model".into(), job: None, report, pictures: Vec::new(), show: None, up: Axis::Z }
}

fn with_show<'a>(report: &'a Report, show: &'a Show<'a>) -> Page<'a> {
    Page { show: Some(show), ..bare(report) }
}

fn geometry(html: &Html) -> Value {
    serde_json::from_str(&text(html, "#geometry")).unwrap()
}

fn bytes(value: &Value) -> Vec<u8> {
    STANDARD.decode(value.as_str().unwrap()).unwrap()
}

fn whole(value: &Value) -> Vec<u32> {
    bytes(value).as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()
}

fn single(value: &Value) -> Vec<f32> {
    bytes(value).as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// A show without a job.
fn shown<'a>(faces: &'a Faces, poses: Vec<Vec<DVec3>>) -> Show<'a> {
    let pose = |(k, points): (usize, Vec<DVec3>)| ShownPose {
        name: format!("pose {k}"),
        points: points.into(),
        lattice: None,
        volume: None,
        volume_change: None,
        stress: None,
    };
    Show { faces, poses: poses.into_iter().enumerate().map(pose).collect() }
}

#[test]
fn pages_of_all_kinds_of_jobs_are_well_formed() {
    for story in Story::all() {
        let run = story.run();
        let show = run.show();
        let contents = Page {
            job: Some(story.job.into()),
            pictures: vec![Figure { caption: "a picture".into(), png: b"not looked at".to_vec() }],
            ..with_show(&run.outcome.report, &show)
        };
        let html = parsed(&page(&contents));
        assert_eq!(all(&html, "h1").len(), 1);
        assert_eq!(all(&html, "[data-pose]").len(), show.poses.len(), "{}", story.job);
        // An id or a landmark twice would confuse those who do not see the page.
        for once in ["main", "header", "footer", "canvas", "#geometry", "title"] {
            assert_eq!(all(&html, once).len(), 1, "{once}");
        }
    }
}

#[test]
fn a_page_needs_no_network_and_may_use_none() {
    let run = Story::twisted_cube().run();
    let show = run.show();
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    let policy = all(&html, "meta[http-equiv='Content-Security-Policy']")[0].attr("content").unwrap();
    let programs: Vec<String> = all(&html, "script:not([type])").iter().map(|s| s.text().collect()).collect();
    assert_eq!(programs.len(), 1);
    let hash = STANDARD.encode(Sha256::digest(&programs[0]));
    assert_eq!(
        policy,
        format!(
            "default-src 'none'; script-src 'sha256-{hash}'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; \
             form-action 'none'"
        )
    );
    assert!(all(&html, "[src], [href], link, iframe, object, form, base").is_empty());
    assert!(!text(&html, "style").contains("url("));
}

#[test]
fn text_from_outside_stays_text() {
    let evil = "</script><script>alert(1)</script>\"'&<!-- <img src=x onerror=alert(1)>";
    let run = Story::twisted_cube().run();
    let mut report = run.outcome.report.clone();
    report.warnings = vec![evil.into()];
    report.model.warnings = vec![evil.into()];
    report.model.format = evil.into();
    report.correction.method = evil.into();
    report.timings_ms.0 = vec![(evil.into(), 1.0)];
    let mut show = run.show();
    show.poses[0].name = evil.into();
    let contents = Page {
        title: evil.into(),
        job: Some(evil.into()),
        report: &report,
        pictures: vec![Figure { caption: evil.into(), png: Vec::new() }],
        show: Some(&show),
        up: Axis::Z,
    };
    let html = parsed(&page(&contents));
    assert_eq!(all(&html, "script").len(), 2); // the geometry and its program
    assert_eq!(all(&html, "img").len(), 1);
    assert_eq!(all(&html, "[onerror]").len(), 0);
    for place in ["h1", "title", "pre code", ".warnings li", ".bar .name", "figcaption", "dd", "[data-pose]"] {
        let found = all(&html, place).iter().any(|element| element.text().collect::<String>() == evil);
        assert!(found, "{place}");
    }
}

#[test]
fn a_script_element_cannot_be_ended_by_what_is_in_it() {
    let run = Story::twisted_cube().run();
    let show = run.show();
    let text = page(&with_show(&run.outcome.report, &show));
    assert_eq!(text.matches("</script").count(), 2);
    assert_eq!(text.matches("<!--").count(), 0);
}

#[test]
fn all_numbers_are_there_with_all_digits() {
    let run = Story::hollow().run();
    let mut report = run.outcome.report.clone();
    let volume = report.volume.as_mut().unwrap();
    volume.overall.written = Some(volume.overall.corrected * (1.0 + 1e-9));
    volume.components[0].written = Some(volume.components[0].corrected * (1.0 + 1e-9));
    let html = parsed(&page(&bare(&report)));
    let tooltips: Vec<&str> = all(&html, "[title]").iter().map(|element| element.attr("title").unwrap()).collect();
    let volume = report.volume.as_ref().unwrap();
    let rows =
        std::iter::once(&volume.overall).chain(&volume.components).chain(volume.parts.iter().map(|part| &part.row));
    let of_row = |row: &VolumeRow| {
        let optional = [row.target, row.written, row.relative_error];
        [row.rest, row.posed, row.corrected].into_iter().chain(optional.into_iter().flatten()).collect::<Vec<_>>()
    };
    let correction = &report.correction;
    let model = &report.model;
    let others = [
        correction.max_displacement,
        correction.rms_displacement,
        correction.residual.unwrap(),
        correction.point_error,
        model.area,
        model.volume.as_ref().unwrap().total,
    ];
    let corners = model.bounds.unwrap().concat();
    for number in rows.flat_map(of_row).chain(others).chain(corners) {
        assert!(tooltips.contains(&&*format!("{number:?}")), "{number:?}");
    }
    let counts = [model.vertices, model.faces, model.triangles, model.components, correction.iterations];
    for count in counts {
        assert!(tooltips.contains(&&*count.to_string()), "{count}");
    }
    for (stage, ms) in &report.timings_ms.0 {
        assert!(text(&html, ".times").contains(stage));
        assert!(tooltips.contains(&&*format!("{ms:?} ms")), "{stage}");
    }
}

/// A point p is stored as the f32 nearest to (p − center) / unit, unit a power of two: expected by that formula.
#[test]
fn the_embedded_geometry_is_that_of_the_model() {
    let run = Story::twisted_cube().run();
    let show = run.show();
    let geometry = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
    let triangles = whole(&geometry["triangles"]);
    let fanned: Vec<u32> = run.mesh.faces().iter().flat_map(fan).flatten().collect();
    assert_eq!(triangles.len(), fanned.len());
    let center = DVec3::from_array(std::array::from_fn(|a| number(&geometry["center"][a])));
    let unit = number(&geometry["unit"]);
    assert_eq!(unit.log2().fract(), 0.0);
    let near = |p: &DVec3| ((*p - center) / unit).as_vec3().to_array();
    for (embedded, pose) in geometry["poses"].as_array().unwrap().iter().zip(&show.poses) {
        let points = single(&embedded["points"]);
        assert_eq!(points.len(), 3 * run.mesh.points().len()); // no two coincide
        assert!(points.iter().all(|x| x.abs() <= 1.0));
        for (found, of) in triangles.iter().zip(&fanned) {
            let found = *found as usize;
            assert_eq!(points[3 * found..3 * found + 3], near(&pose.points[*of as usize]));
        }
        match &pose.volume_change {
            Some(change) => {
                let embedded = single(&embedded["change"]);
                for (found, of) in triangles.iter().zip(&fanned) {
                    assert_eq!(embedded[*found as usize], change[*of as usize] as f32);
                }
            }
            None => assert!(embedded["change"].is_null()),
        }
        let ShownLattice { size, controls, .. } = pose.lattice.as_ref().unwrap();
        assert_eq!(embedded["lattice"]["size"], serde_json::json!(size));
        let expected: Vec<f32> = controls.iter().flat_map(near).collect();
        assert_eq!(single(&embedded["lattice"]["controls"]), expected);
    }
}

#[test]
fn springs_and_held_nodes_are_in_the_page() {
    let run = Story::settled().run();
    let show = run.show();
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    let springs = run.outcome.net().unwrap();
    for pose in geometry(&html)["poses"].as_array().unwrap() {
        assert_eq!(whole(&pose["lattice"]["springs"]), springs.ends.as_flattened());
        // Of three layers along k the outer ones are edited.
        assert_eq!(bytes(&pose["lattice"]["held"]), [1, 0, 1].repeat(9));
    }
    assert!(text(&html, ".hint").contains("Nodes in orange are held"));
    let run = Story::twisted_cube().run();
    let show = run.show();
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    let lattice = &geometry(&html)["poses"][0]["lattice"];
    assert!(lattice["springs"].is_null() && lattice["held"].is_null());
    assert!(!text(&html, ".hint").contains("springs"));
}

/// A square's fan (0 1 2)(0 2 3) has the diagonal as its last side, then as its first.
#[test]
fn diagonals_of_polygons_are_no_edges() {
    let mesh = shapes::cube(1);
    let show = shown(mesh.faces(), vec![mesh.points().to_vec()]);
    let run = Story::twisted_cube().run();
    let found = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
    assert_eq!(bytes(&found["edges"]), [0b011, 0b110].repeat(6));
    let ball = shapes::icosphere(1);
    let show = shown(ball.faces(), vec![ball.points().to_vec()]);
    let found = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
    assert!(found["edges"].is_null());
}

/// Far away by 10⁹ extents, and 10³⁰ times smaller, the same numbers are stored: differences are taken in f64.
#[test]
fn far_and_tiny_and_huge_models_keep_their_shape() {
    let run = Story::twisted_cube().run();
    let mesh = shapes::cube(2);
    let stored = |map: &dyn Fn(DVec3) -> DVec3| {
        let show = shown(mesh.faces(), vec![mesh.points().iter().map(|p| map(*p)).collect()]);
        single(&geometry(&parsed(&page(&with_show(&run.outcome.report, &show))))["poses"][0]["points"])
    };
    let expected = stored(&|p| p);
    assert!(expected.iter().all(|x| [-1.0, 0.0, 1.0].contains(x)));
    assert_eq!(stored(&|p| p + DVec3::splat(1e9)), expected);
    assert_eq!(stored(&|p| p * 2f64.powi(-300)), expected);
    assert_eq!(stored(&|p| (p * 2.0 - 1.0) * 2f64.powi(1023)), expected);
}

#[test]
fn unused_and_coincident_vertices_are_not_embedded() {
    // An octahedron's upper half as loose triangles, and two points that nothing names.
    let rim = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y];
    let (mut points, mut faces) = (vec![DVec3::splat(9.0); 2], Faces::new());
    for k in 0..4 {
        let first = points.len() as u32;
        points.extend([rim[k], rim[(k + 1) % 4], DVec3::Z]);
        faces.push(&[first, first + 1, first + 2]);
    }
    let run = Story::twisted_cube().run();
    let show = shown(&faces, vec![points]);
    let found = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
    assert_eq!(whole(&found["triangles"]), [0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2]);
    assert_eq!(single(&found["poses"][0]["points"]).len(), 3 * 5);
    // What nothing names does not count for the frame either.
    assert_eq!(number(&found["center"][0]), 0.0);
}

#[test]
fn coincident_vertices_that_part_in_another_pose_stay_two() {
    let faces: Faces = [[0, 1, 2], [3, 1, 2]].iter().collect();
    let rest = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ZERO];
    let mut torn = rest.clone();
    torn[3] = DVec3::Z;
    let run = Story::twisted_cube().run();
    let show = shown(&faces, vec![rest, torn]);
    let found = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
    assert_eq!(whole(&found["triangles"]), [0, 1, 2, 3, 1, 2]);
}

#[test]
fn a_large_model_is_simplified_and_the_page_says_so() {
    let mesh = shapes::icosphere(7); // 20 · 4⁷ = 327 680 triangles
    let run = Story::twisted_cube().run();
    let stretched = mesh.points().iter().map(|p| *p * DVec3::new(1.0, 1.0, 2.0)).collect();
    let show = shown(mesh.faces(), vec![mesh.points().to_vec(), stretched]);
    let text_of_page = page(&with_show(&run.outcome.report, &show));
    assert!(text_of_page.len() < 10_000_000, "{}", text_of_page.len());
    let html = parsed(&text_of_page);
    assert!(text(&html, ".hint").contains("of the model’s 327\u{202f}680 triangles"));
    let found = geometry(&html);
    let triangles = whole(&found["triangles"]).len() / 3;
    assert!((100_000..=150_000).contains(&triangles), "{triangles}");
    // Vertices are those of the model: on the ball, and twice as high in the other pose.
    let [ball, high] = [0, 1].map(|pose| single(&found["poses"][pose]["points"]));
    let radius = 1.0 / number(&found["unit"]) as f32;
    for (a, b) in ball.chunks(3).zip(high.chunks(3)) {
        let length = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
        assert!((length - radius).abs() < 1e-6);
        assert_eq!([b[0], b[1], b[2]], [a[0], a[1], 2.0 * a[2]]);
    }
}

/// 140 000 loose triangles are few enough, but they share no vertices: in four poses they are 21 MB.
#[test]
fn loose_triangles_in_many_poses_are_bounded_in_bytes() {
    let (mut points, mut faces) = (Vec::new(), Faces::new());
    for t in 0..140_000_u32 {
        let place = DVec3::new(f64::from(t % 374), f64::from(t / 374), 0.0);
        points.extend([place, place + 0.5 * DVec3::X, place + 0.5 * DVec3::Y]);
        faces.push(&[3 * t, 3 * t + 1, 3 * t + 2]);
    }
    let poses = (0..4).map(|k| points.iter().map(|p| *p + f64::from(k) * DVec3::Z).collect()).collect();
    let run = Story::twisted_cube().run();
    let show = shown(&faces, poses);
    let text_of_page = page(&with_show(&run.outcome.report, &show));
    assert!(text_of_page.len() < 10_000_000, "{}", text_of_page.len());
    assert!(whole(&geometry(&parsed(&text_of_page))["triangles"]).len() > 300);
}

#[test]
fn long_tables_show_twenty_rows_and_fold_the_others() {
    let mut report = Story::twisted_cube().run().outcome.report;
    let row = report.volume.as_ref().unwrap().overall;
    report.volume.as_mut().unwrap().components = vec![row; 21];
    let html = parsed(&page(&bare(&report)));
    assert_eq!(all(&html, "section > .scroll tbody tr").len(), 20);
    assert_eq!(all(&html, "details tbody tr").len(), 1);
    assert!(text(&html, ".note").contains("The first 20 of 21 are shown."));
    report.volume.as_mut().unwrap().components = vec![row; 20];
    assert!(all(&parsed(&page(&bare(&report))), "details").is_empty());
    report.volume.as_mut().unwrap().components = vec![row; 100_000];
    let text_of_page = page(&bare(&report));
    assert!(text_of_page.len() < 3_000_000);
    assert!(text(&parsed(&text_of_page), ".note").contains("And 98\u{202f}000 more, which the JSON report lists."));
}

#[test]
fn a_model_without_volume_has_a_page() {
    let run = Story::sheet().run();
    assert!(run.outcome.report.volume.is_none());
    let show = run.show();
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    assert!(text(&html, ".headline").contains("The volume was left free."));
    assert!(all(&html, "tbody").is_empty());
    assert_eq!(all(&html, "[data-pose]").len(), 2);
}

#[test]
fn a_free_volume_has_no_target_and_no_error() {
    let run = Story {
        job: "[[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n[preserve]\nvolume = \"free\"\n",
        ..Story::twisted_cube()
    }
    .run();
    let html = parsed(&page(&bare(&run.outcome.report)));
    assert!(text(&html, ".headline").contains("The volume was left free."));
    assert!(all(&html, ".target").is_empty());
    assert!(!text(&html, "main").contains("relative error"));
}

#[test]
fn a_job_that_deforms_nothing_has_one_pose_and_no_pose_buttons() {
    let run = Story { job: "", ..Story::twisted_cube() }.run();
    let show = run.show();
    assert_eq!(show.poses.len(), 1);
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    assert_eq!(all(&html, "canvas").len(), 1);
    assert!(all(&html, "[data-pose], [data-legend], [data-toggle='lattice'], [data-toggle='colour']").is_empty());
}

#[test]
fn without_a_show_there_is_no_canvas_and_no_script() {
    let run = Story::twisted_cube().run();
    let text_of_page = page(&bare(&run.outcome.report));
    let html = parsed(&text_of_page);
    assert!(all(&html, "canvas, script").is_empty());
    assert!(text_of_page.contains("script-src &#39;none&#39;") || text_of_page.contains("script-src 'none'"));
    let no_poses = Show { faces: &Faces::new(), poses: Vec::new() };
    assert_eq!(page(&with_show(&run.outcome.report, &no_poses)), text_of_page);
}

#[test]
fn a_show_without_faces_has_an_empty_view() {
    let run = Story::twisted_cube().run();
    for points in [vec![], vec![DVec3::ONE]] {
        let faces = Faces::new();
        let show = shown(&faces, vec![points]);
        let found = geometry(&parsed(&page(&with_show(&run.outcome.report, &show))));
        assert!(whole(&found["triangles"]).is_empty());
        assert_eq!(number(&found["unit"]), 1.0);
    }
}

#[test]
fn faces_with_coordinates_that_are_no_numbers_are_left_out_and_counted() {
    let run = Story::twisted_cube().run();
    let mesh = shapes::cube(2);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut spoilt = mesh.points().to_vec();
        spoilt[0].y = bad; // a corner of the cube: of three faces
        let show = shown(mesh.faces(), vec![mesh.points().to_vec(), spoilt]);
        let html = parsed(&page(&with_show(&run.outcome.report, &show)));
        assert!(text(&html, ".hint").contains("3 faces with infinite or undefined coordinates are not shown."));
        let found = geometry(&html);
        assert_eq!(whole(&found["triangles"]).len(), 3 * 2 * 21);
        for pose in 0..2 {
            assert!(single(&found["poses"][pose]["points"]).iter().all(|x| x.is_finite()));
        }
    }
}

#[test]
fn faces_of_fewer_than_three_corners_are_not_shown() {
    let run = Story::twisted_cube().run();
    let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    let faces: Faces = [&[0, 1][..], &[], &[0, 1, 2], &[2]].into_iter().collect();
    let html = parsed(&page(&with_show(&run.outcome.report, &shown(&faces, vec![points]))));
    assert_eq!(whole(&geometry(&html)["triangles"]), [0, 1, 2]);
    assert!(!text(&html, ".hint").contains("not shown"));
}

#[test]
fn a_lattice_with_coordinates_that_are_no_numbers_is_not_shown() {
    let run = Story::twisted_cube().run();
    let mut show = run.show();
    for bad in [f64::NAN, f64::INFINITY, 1e60] {
        for pose in &mut show.poses {
            pose.lattice.as_mut().unwrap().controls.to_mut()[5].z = bad; // 1e60 is too large for an f32
        }
        let html = parsed(&page(&with_show(&run.outcome.report, &show)));
        assert!(geometry(&html)["poses"][0]["lattice"].is_null());
        assert!(all(&html, "[data-toggle='lattice']").is_empty());
    }
}

#[test]
fn numbers_that_are_none_are_said_as_such() {
    let mut report = Story::twisted_cube().run().outcome.report;
    let row = &mut report.volume.as_mut().unwrap().overall;
    *row = VolumeRow { rest: 0.0, posed: f64::NAN, target: Some(0.0), corrected: f64::INFINITY, ..*row };
    report.timings_ms.0.clear();
    let html = parsed(&page(&bare(&report)));
    assert_eq!(text(&html, ".bar .value"), "0NaNinf");
    assert_eq!(text(&html, ".bar .change"), "––");
    assert!(all(&html, ".times").is_empty());
}

#[test]
#[should_panic(expected = "points of the pose")]
fn poses_of_different_models_are_refused() {
    let report = Story::twisted_cube().run().outcome.report;
    let faces = Faces::new();
    let _ = page(&with_show(&report, &shown(&faces, vec![vec![DVec3::ZERO], vec![]])));
}

#[test]
fn pictures_are_embedded_as_they_are() {
    let report = Story::twisted_cube().run().outcome.report;
    let png: Vec<u8> = (0..=255).collect();
    let pictures = vec![Figure { caption: "all bytes".into(), png: png.clone() }];
    let html = parsed(&page(&Page { pictures, ..bare(&report) }));
    let image = all(&html, "figure img")[0];
    let data = image.attr("src").unwrap().strip_prefix("data:image/png;base64,").unwrap();
    assert_eq!(STANDARD.decode(data).unwrap(), png);
    assert_eq!(image.attr("alt"), Some("all bytes"));
}

/// The bundle's first line names the SHA-256 of its sources and of what follows that line: `cargo xtask viewer` writes it.
#[test]
fn the_viewer_was_built_from_its_sources() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/viewer");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap().replace("\r\n", "\n");
    let hash = |text: &str| Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let sources = ["viewer.js", "build.mjs", "package.json", "package-lock.json"].map(read).concat();
    let bundle = read("viewer.min.js");
    let (head, body) = bundle.split_once('\n').unwrap();
    let expected = format!("/* isochor viewer, sources {}, bundle {} */", hash(&sources), hash(body));
    assert_eq!(head, expected, "run `cargo xtask viewer`");
    assert!(bundle.contains("Permission is hereby granted, free of charge"), "every copy carries three.js's licence");
    assert!(bundle.len() < 600_000, "{}", bundle.len());
}

/// Colours are listed for the legend and for the surface.
#[test]
fn the_legend_has_the_colours_of_the_surface() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let colours =
        |text: &str| -> Vec<String> { text.match_indices('#').map(|(at, _)| text[at..at + 7].to_string()).collect() };
    let (style, viewer) = (read("page.css"), read("viewer/viewer.js"));
    let of_legend = style.split_once("linear-gradient(90deg,").unwrap().1.split_once(')').unwrap().0;
    let of_surface = viewer.split_once("const CHANGES = [").unwrap().1.split_once(']').unwrap().0;
    assert_eq!(colours(of_legend), colours(of_surface));
    assert_eq!(colours(of_legend).len(), 9);
}

#[test]
fn an_index_leads_to_its_files() {
    let entry = IndexEntry {
        title: "ball <b>".into(),
        sentence: "a ball & more".into(),
        picture: Some("ball 1.png".into()),
        lines: vec!["volume 1".into(), "volume 2".into()],
        files: vec![("report".into(), "ball.html".into()), ("model".into(), "javascript:x".into())],
    };
    let html = parsed(&index("Gallery", &[entry, IndexEntry::default()]));
    assert_eq!(all(&html, "article").len(), 2);
    assert_eq!(text(&html, "article h2 a"), "ball <b>");
    assert_eq!(text(&html, "article pre"), "volume 1\nvolume 2");
    let links: Vec<_> = all(&html, "a").iter().map(|a| a.attr("href").unwrap()).collect();
    assert_eq!(links, ["./ball.html", "./ball.html", "./ball.html", "./javascript%3Ax"]);
    assert_eq!(all(&html, "img")[0].attr("src"), Some("./ball%201.png"));
    assert!(all(&html, "script").is_empty());
}

#[test]
fn an_empty_index_says_so() {
    assert!(text(&parsed(&index("Gallery", &[])), "main").contains("Nothing is here yet."));
}

/// An empty mesh has a report where the volume is free.
#[test]
fn an_empty_mesh_has_a_page() {
    let run = stories::run(Mesh::default(), "[preserve]\nvolume = \"free\"\n");
    let show = run.show();
    let html = parsed(&page(&with_show(&run.outcome.report, &show)));
    assert!(text(&html, "main").contains("It has no faces, so it has no volume to preserve."));
}
