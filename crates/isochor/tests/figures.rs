//! The figures of HB and CO and the plates of HML as jobs, and the films: they lose what the paper says, and get back their volumes.

#![cfg(feature = "serde")]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use isochor::{
    Examination, Film, FlattenStatus, Job, JobInput, Mesh, Outcome, ProfileRequest, ShapeName, Source, ThroughRequest,
    VolumeTarget,
};

/// What the paper prints of each panel: its change of volume without correction, in percent. Figures 2, 5 and 7 have none.
const PAPER: [(&str, Option<f64>); 17] = [
    ("figure-1a", Some(-28.0)),
    ("figure-1b", Some(-51.0)),
    ("figure-1c", Some(-64.0)),
    ("figure-2", None),
    ("figure-3a", Some(300.0)),
    ("figure-3b", Some(200.0)),
    ("figure-4a", Some(-60.0)),
    ("figure-4b", Some(-60.0)),
    ("figure-4c", Some(-40.0)),
    ("figure-4d", Some(-40.0)),
    ("figure-5a", None),
    ("figure-5b", None),
    ("figure-6a", Some(-66.0)),
    ("figure-6a-film", Some(-66.0)),
    ("figure-6b", Some(-66.0)),
    ("figure-6b-film", Some(-66.0)),
    ("figure-7", None),
];

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/jobs").join(name)
}

/// Names without extension, in order.
fn jobs_in(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let jobs = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
    let mut names: Vec<String> = jobs.map(|path| path.file_stem().unwrap().to_str().unwrap().into()).collect();
    names.sort();
    names
}

/// A job file on a built-in shape.
struct Panel {
    text: String,
    film: Film,
    mesh: Mesh,
    examination: Examination,
}

impl Panel {
    fn read(folder: &Path, name: &str) -> Self {
        let text = std::fs::read_to_string(folder.join(name).with_extension("toml")).unwrap();
        let film = Film::from_toml(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        let model = film.job(0).unwrap().model.unwrap();
        let mesh = model.to_str().unwrap().parse::<ShapeName>().unwrap().mesh();
        let examination = Examination::of(&mesh, &Source::of(&mesh));
        Self { text, film, mesh, examination }
    }

    fn run(&self, job: &Job) -> Outcome {
        let input =
            JobInput { mesh: &self.mesh, source: &Source::of(&self.mesh), lattice: None, surface: None, cage: None };
        job.run_examined(&self.examination, &input, &mut |_| {}).unwrap()
    }

    /// The number after a word in the comment that begins so.
    fn said(&self, line: &str, word: &str) -> Option<f64> {
        let line = self.text.lines().find_map(|text| text.strip_prefix("# ")?.strip_prefix(line))?;
        let number = line.split_once(word)?.1.trim();
        Some(number.split([' ', ',']).next()?.trim_end_matches('.').parse().unwrap())
    }

    /// The change of volume without correction in the last frame, in percent.
    fn plain_change(&self) -> f64 {
        let mut job = self.film.job(self.film.frames() - 1).unwrap();
        job.preserve.volume = VolumeTarget::Free;
        let volume = self.run(&job).report.volume.unwrap().overall;
        100.0 * (volume.posed / volume.rest - 1.0)
    }
}

#[test]
fn figures_lose_what_the_paper_says_and_get_it_back() {
    let folder = folder("figures");
    assert_eq!(jobs_in(&folder), PAPER.map(|(name, _)| name));
    for (name, paper) in PAPER {
        let panel = Panel::read(&folder, name);
        let change = panel.plain_change();
        // Two digits are said of ours; the paper has none after the point.
        let near = |said: f64| (change - said).abs() <= 0.005;
        assert_eq!(panel.said("Volume without correction:", "paper "), paper, "{name}");
        assert!(paper.is_none_or(near), "{name}: {change}");
        assert!(panel.said("Volume without correction:", "here ").is_some_and(near), "{name}: {change}");
        assert_eq!(panel.said("Vertices:", "here "), Some(panel.mesh.points().len() as f64), "{name}");
        for frame in 0..panel.film.frames() {
            let report = panel.run(&panel.film.job(frame).unwrap()).report;
            let volume = report.volume.unwrap().overall;
            assert_eq!(volume.target, Some(volume.rest), "{name}");
            assert!((volume.corrected / volume.rest - 1.0).abs() <= 1e-13, "{name}, frame {frame}: {volume:?}");
            assert!(
                report.correction.point_error <= 1e-12 && report.warnings.is_empty(),
                "{name}: {report:?}",
                report = report.correction
            );
        }
    }
    // "First the inner volume increases": the paper on Figure 7.
    assert!(Panel::read(&folder, "figure-7").plain_change() > 0.5);
    assert_eq!(Panel::read(&folder, "figure-6a").said("Vertices:", "paper "), Some(6146.0));
}

#[test]
fn the_page_of_figures_says_what_the_jobs_say() {
    let page = include_str!("../../../docs/figures.md");
    for (name, paper) in PAPER {
        let row =
            page.lines().find(|line| line.starts_with(&format!("| `{name}` |"))).unwrap_or_else(|| panic!("no {name}"));
        let cells: Vec<String> =
            row.split('|').skip(3).map(|cell| cell.replace([',', '%'], "").trim().into()).collect();
        let number = |cell: usize| cells[cell].parse::<f64>().ok();
        let panel = Panel::read(&folder("figures"), name);
        let said = ["Volume without correction:", "Vertices:"].map(|line| panel.said(line, "here "));
        assert_eq!([number(1), number(3)], said, "{name}");
        assert_eq!((number(0), number(2)), (paper, panel.said("Vertices:", "paper ")), "{name}");
        assert!(paper.is_some() || cells[0] == "none", "{name}");
    }
}

#[test]
fn top_and_bottom_of_the_twisting_cube_stay_flat_under_horizontal_corrections_only() {
    for (name, is_flat) in
        [("figure-6a", true), ("figure-6a-film", true), ("figure-6b", false), ("figure-6b-film", false)]
    {
        let panel = Panel::read(&folder("figures"), name);
        let last = panel.film.frames() - 1;
        for frame in if is_flat { 0..=last } else { last..=last } {
            let points = panel.run(&panel.film.job(frame).unwrap()).points;
            let pairs = panel.mesh.points().iter().zip(&points).filter(|(rest, _)| rest.z == 0.0 || rest.z == 1.0);
            let off = pairs.map(|(rest, end)| (end.z - rest.z).abs()).collect::<Vec<_>>();
            assert_eq!(off.len(), 2 * 33 * 33);
            let (least, most) = off.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), d| (a.min(*d), b.max(*d)));
            // Flat to rounding, or faces whose own points go up and down by different amounts.
            assert!(
                if is_flat { most <= 1e-14 } else { most - least > 0.05 },
                "{name}, frame {frame}: {least} to {most}"
            );
        }
    }
}

#[test]
fn films_have_their_volumes_in_every_frame() {
    let folder = folder("films");
    assert_eq!(jobs_in(&folder), ["bounce", "twist"]);
    for (name, volume_at) in
        [("bounce", (|_| 1.0) as fn(f64) -> f64), ("twist", |time| 1.0 + 0.2 * (1.0 - (2.0 * time - 1.0).abs()))]
    {
        let panel = Panel::read(&folder, name);
        let mut highest = f64::NEG_INFINITY;
        for frame in 0..panel.film.frames() {
            let outcome = panel.run(&panel.film.job(frame).unwrap());
            let volume = outcome.report.volume.as_ref().unwrap().overall;
            let wanted = volume.rest * volume_at(panel.film.time(frame));
            assert!((volume.corrected / wanted - 1.0).abs() <= 1e-13, "{name}, frame {frame}: {volume:?}");
            let heights = outcome.points.iter().map(|p| p.z);
            let foot = heights.clone().fold(f64::INFINITY, f64::min);
            highest = heights.fold(highest, f64::max);
            if name == "bounce" {
                assert!(foot >= -1.0 - 1e-12, "frame {frame}: the ball is below the ground, at {foot}");
                assert!(frame > 0 || foot < -0.99, "it begins on the ground, not at {foot}");
            }
        }
        assert!(name != "bounce" || highest > 3.9, "the ball flies only up to {highest}");
    }
}

/// What docs/correct.md says under the pictures of automatic locality.
#[test]
fn the_foot_of_a_squeezed_bottle_stays_where_the_correction_is_local() {
    let folder = folder("locality");
    assert_eq!(jobs_in(&folder), ["auto", "uniform"]);
    for name in ["auto", "uniform"] {
        let panel = Panel::read(&folder, name);
        let job = panel.film.job(0).unwrap();
        let corrected = panel.run(&job);
        let volume = corrected.report.volume.as_ref().unwrap().overall;
        assert!((volume.corrected / volume.rest - 1.0).abs() <= 1e-13, "{name}: {volume:?}");
        // The edit takes a factor 0.6 of both x and y at most.
        let least = corrected.course().unwrap().posed_change.into_iter().fold(f64::INFINITY, f64::min);
        assert!((least - 0.36).abs() <= 1e-9, "{name}: {least}");

        let mut free = job;
        free.preserve.volume = VolumeTarget::Free;
        let posed = panel.run(&free).points;
        let heights = panel.mesh.points().iter().map(|p| p.z);
        let [foot, top] = [heights.clone().fold(f64::INFINITY, f64::min), heights.fold(f64::NEG_INFINITY, f64::max)];
        let triples = panel.mesh.points().iter().zip(&posed).zip(&corrected.points);
        let moved = triples
            .filter(|((rest, _), _)| rest.z < foot + 0.15 * (top - foot))
            .map(|((_, before), after)| before.distance(*after) / (top - foot))
            .fold(0.0, f64::max);
        assert!(if name == "auto" { moved < 0.002 } else { moved > 0.06 }, "{name}: {moved}");
    }
}

/// Jobs along surfaces (CO, figures 5 to 13), and how many polygons their comments say that the paper has.
const ALONG: [(&str, Option<f64>); 7] = [
    ("cylinder", Some(6.0)),
    ("figure-10", Some(73_665.0)),
    ("figure-12", Some(73_665.0)),
    ("figure-5", None),
    ("figure-8", Some(6.0)),
    ("figure-9", Some(6.0)),
    ("lattice", None),
];

#[test]
fn models_along_surfaces_have_their_volumes_and_are_divided_where_the_paper_says() {
    let folder = folder("surface");
    assert_eq!(jobs_in(&folder), ALONG.map(|(name, _)| name));
    for (name, polygons) in ALONG {
        let panel = Panel::read(&folder, name);
        assert_eq!(panel.said("Polygons:", "paper "), polygons, "{name}");
        let faces = panel.mesh.faces().len();
        assert_eq!(panel.said("Polygons:", "here "), polygons.map(|_| faces as f64), "{name}");
        for frame in 0..panel.film.frames() {
            let outcome = panel.run(&panel.film.job(frame).unwrap());
            let volume = outcome.report.volume.as_ref().unwrap().overall;
            assert!((volume.corrected / volume.rest - 1.0).abs() <= 1e-13, "{name}, frame {frame}: {volume:?}");
            assert!((volume.posed / volume.rest - 1.0).abs() > 1e-6, "{name}, frame {frame}: there was nothing to do");
            let surface = outcome.report.surface.as_ref().unwrap();
            assert!(surface.folds.is_none() && surface.flattening.folds.is_empty(), "{name}, frame {frame}");
            assert_eq!(surface.flattening.status, FlattenStatus::Converged, "{name}, frame {frame}");
            assert!(outcome.report.warnings.iter().all(|text| text.contains("times as large")), "{name}: {outcome:?}");
            // The plate and the cube have larger polygons than the grid. "Since each polygon of the original dolphin model is smaller than
            // the grid of the flattened surface, there is no subdivision" (CO, section 4), but for the triangles at its end, at x = 3.
            let own = panel.mesh.points().len();
            assert_eq!(outcome.points.len(), own + surface.edge_points + surface.face_points, "{name}");
            let rest = outcome.divided().map_or(panel.mesh.points(), |(mesh, _)| mesh.points());
            let added = &rest[own..];
            assert!(faces > 6 || !added.is_empty(), "{name}");
            assert!(faces == 6 || added.iter().all(|p| (p.x - 3.0).abs() < 1e-12), "{name}: {added:?}");
        }
    }
}

#[test]
fn the_page_of_surfaces_says_what_the_jobs_do() {
    let page = include_str!("../../../docs/surface.md");
    for (name, polygons) in ALONG {
        let start = format!("| `{name}.toml` |");
        let row = page.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("no {name}"));
        let cells: Vec<String> = row.split('|').skip(3).map(|cell| cell.replace(',', "")).collect();
        let said = |cell: usize| cells[cell].split_whitespace().next().unwrap().parse::<f64>().ok();
        let panel = Panel::read(&folder("surface"), name);
        assert_eq!(said(0), polygons, "{name}");
        assert_eq!(said(1), Some(panel.mesh.faces().len() as f64), "{name}");
        assert_eq!(said(2), Some(panel.mesh.points().len() as f64), "{name}");
        let (mut change, mut stretch, mut compression) = (0.0f64, 0.0f64, 0.0f64);
        for frame in 0..panel.film.frames() {
            let report = panel.run(&panel.film.job(frame).unwrap()).report;
            let volume = report.volume.unwrap().overall;
            let this = 100.0 * (volume.posed / volume.rest - 1.0);
            change = if this.abs() > change.abs() { this } else { change };
            let surface = report.surface.unwrap();
            assert_eq!(said(3), Some((surface.edge_points + surface.face_points) as f64), "{name}, frame {frame}");
            stretch = stretch.max(surface.flattening.stretch);
            compression = compression.max(surface.flattening.compression);
        }
        let sheet: Vec<f64> = cells[5].split('%').filter_map(|number| number.trim().parse().ok()).collect();
        for (said, found) in
            [(said(4), change), (sheet.first().copied(), stretch), (sheet.get(1).copied(), compression)]
        {
            assert!(said.is_some_and(|said| (said - found).abs() <= 0.005 + 1e-6), "{name}: {found}, but {said:?}");
        }
    }
}

/// The control nets of CO's surfaces, which are the same wherever they are used.
#[test]
fn jobs_along_bezier_surfaces_have_the_nets_that_the_docs_say() {
    type Height = fn(usize, usize) -> f64;
    let wave: Height = |i, _| 1.2 * [0.0, 1.0, -1.0, 0.0][i];
    let twisted: Height = |i, j| 0.8 * [0.0, 1.0, 1.0, 0.0][i] * [1.0, 0.5, -0.5, -1.0][j];
    let bend: Height = |i, j| [0.0, 1.6, 1.6, 0.0][i] * (1.0 + 0.15 * [0.0, 1.0, 1.0, 0.0][j]);
    for (name, length, height) in [
        ("figure-5", 4.0, twisted),
        ("figure-8", 4.0, wave),
        ("figure-9", 4.0, twisted),
        ("figure-10", 8.0, bend),
        ("lattice", 8.0, bend),
    ] {
        let controls = Panel::read(&folder("surface"), name).film.job(0).unwrap().surface.unwrap().controls.unwrap();
        assert_eq!((controls.len(), controls[0].len()), (4, 4), "{name}");
        for (i, j) in (0..16).map(|k| (k / 4, k % 4)) {
            let along = |side: f64, k: usize| side * (k as f64 / 3.0 - 0.5);
            let expected = DVec3::new(along(length, i), along(4.0, j), height(i, j));
            assert!(controls[i][j].distance(expected) < 1e-12, "{name}: {} at {i}, {j}", controls[i][j]);
        }
    }
}

#[test]
fn the_plate_on_a_cylinder_stands_on_it_and_is_divided_across_its_axis_only() {
    let panel = Panel::read(&folder("surface"), "cylinder");
    let outcome = panel.run(&panel.film.job(0).unwrap());
    let surface = outcome.report.surface.as_ref().unwrap();
    assert_eq!(surface.face_points, 0);
    assert!(surface.flattening.stretch.max(surface.flattening.compression) < 1e-9, "{:?}", surface.flattening);
    // The axis is y, at the height −1; the plate is 3.5 · 0.05 high, times the factor of the heights.
    let high = 1.0 + 0.175 * surface.height_scale.unwrap();
    let radii: Vec<f64> = outcome.points.iter().map(|p| DVec2::new(p.x, p.z + 1.0).length()).collect();
    assert!(radii.iter().all(|r| (r - 1.0).abs().min((r - high).abs()) < 1e-12), "{radii:?}");
    assert_eq!(radii.iter().filter(|r| **r < 1.01).count(), radii.len() / 2);
}

/// The curve of the surface is a wave that goes from nose to flukes, and the film goes on where it begins anew.
#[test]
fn the_dolphin_swims_in_a_loop() {
    let panel = Panel::read(&folder("surface"), "figure-12");
    let frames = panel.film.frames();
    let points = |frame: usize| panel.run(&panel.film.job(frame).unwrap()).points;
    let first = points(0);
    let (mut before, mut steps) = (first.clone(), Vec::new());
    for frame in 1..=frames {
        let after = if frame < frames { points(frame) } else { first.clone() };
        steps.push(before.iter().zip(&after).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max));
        before = after;
    }
    let last = steps.pop().unwrap();
    let most = steps.iter().copied().fold(0.0, f64::max);
    assert!(last <= 1.05 * most && most > 0.0, "{last} after {steps:?}");

    // Keys are at every third of the 24 frames, and have four digits.
    for frame in (0..frames).step_by(3) {
        let time = panel.film.time(frame);
        let Some(ProfileRequest::Through(ThroughRequest { through })) =
            panel.film.job(frame).unwrap().surface.unwrap().profile
        else {
            panic!("no profile through points")
        };
        for (k, p) in through.iter().enumerate() {
            let u = k as f64 / (through.len() - 1) as f64;
            let z = (0.08 + 0.42 * u * u) * (TAU * (time - u)).sin();
            assert!(p.distance(DVec3::new(3.3 * u - 1.65, 0.0, z)) < 1e-4, "frame {frame}: {p}");
        }
    }
}

#[test]
fn plates_settle_with_their_volumes() {
    let folder = folder("elastic");
    let names = jobs_in(&folder);
    assert_eq!(names.join(" "), "center plate-1 plate-2 plate-3 plate-4 plate-5 plate-6a plate-6b plate-7");
    let mut energies = Vec::new();
    for name in &names {
        let panel = Panel::read(&folder, name);
        let outcome = panel.run(&panel.film.job(0).unwrap());
        let (volume, elastic) =
            (outcome.report.volume.as_ref().unwrap().overall, outcome.report.elastic.as_ref().unwrap());
        assert_eq!((&elastic.status[..], volume.target), ("settled", Some(volume.rest)), "{name}");
        assert!((volume.corrected / volume.rest - 1.0).abs() <= 1e-13, "{name}: {volume:?}");
        // The lattice of the one with continuity ends within the model.
        let is_continued = |warning: &String| name == "center" && warning.contains("outside the lattice and stay");
        assert!(outcome.report.warnings.iter().all(is_continued), "{name}: {:?}", outcome.report.warnings);
        let drawing = outcome.net().unwrap();
        assert_eq!(
            (drawing.ends.len(), drawing.is_held.len()),
            (elastic.springs, elastic.held + elastic.free),
            "{name}"
        );
        let controls = outcome.controls.as_ref().unwrap();
        match &name[..] {
            // The nodes between those that are held go outwards, and stay at their height.
            "plate-1" => {
                for (at, rest) in controls.posed.iter().zip(&controls.rest).filter(|(_, rest)| rest.z.abs() < 1e-9) {
                    assert!(at.z.abs() < 1e-9 && at.length() >= rest.length() - 1e-9, "{rest} goes to {at}");
                }
            }
            // "The central 2×2 nodes have moved all the way across to the diagonal sides."
            "plate-2" => {
                for node in 8..12 {
                    let (at, rest) = (controls.posed[node], controls.rest[node]);
                    assert!(at.z * rest.z < 0.0 && at.y * rest.y > 0.0, "{rest} goes to {at}");
                }
            }
            "plate-6a" | "plate-6b" => {
                energies.push(elastic.energy);
                assert!(
                    panel.text.contains(&format!("The energy is {:.3}, ", elastic.energy)),
                    "{name}: {}",
                    elastic.energy
                );
            }
            "center" => {
                let [rest, posed, settled] = elastic.center_of_mass.unwrap().map(DVec3::from_array);
                assert!(posed.distance(rest) > 0.01 && settled.distance(rest) < 1e-12, "{rest} {posed} {settled}");
            }
            _ => {}
        }
    }
    assert!((energies[0] - energies[1]).abs() > 0.02, "{energies:?}");
}
