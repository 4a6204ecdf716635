//! The method "elastic" of jobs, as users write them.
#![cfg(feature = "serde")]

mod numbers;

use glam::DVec3;
use isochor::{
    ElasticReport, Film, Job, JobError, JobInput, Mesh, MomentTargets, OpenBoundaries, Outcome, Solid, Source, shapes,
    topology,
};
use numbers::{number, numbers, reference, vectors};

fn run(mesh: &Mesh, toml: &str) -> Result<Outcome, JobError> {
    let job = Job::from_toml(toml).unwrap_or_else(|error| panic!("{error}"));
    let input = JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage: None };
    let outcome = job.run(&input, &mut |_| {})?;
    if let Some(error) = outcome.report.volume.as_ref().and_then(|volume| volume.overall.relative_error) {
        assert!(error <= 1e-13, "{error:e}");
    }
    Ok(outcome)
}

fn settled(mesh: &Mesh, toml: &str) -> (Outcome, ElasticReport) {
    let outcome = run(mesh, toml).unwrap_or_else(|error| panic!("{error}: {toml}"));
    let elastic = outcome.report.elastic.clone().expect("a report of springs");
    assert_eq!(
        (outcome.report.correction.method.as_str(), outcome.report.correction.objective.as_str()),
        ("elastic", "springs")
    );
    (outcome, elastic)
}

fn refused(mesh: &Mesh, toml: &str) -> JobError {
    run(mesh, toml).expect_err(toml)
}

const LATTICE: &str = "lattice = { basis = 'bernstein', size = 3 }\n";
const SQUASH: &str = "edit = [{ scale = { by = [1, 1, 0.6], nodes = { k = [0, 2] } } }]\n";
const ELASTIC: &str = "[preserve]\nmethod = 'elastic'\n";

/// HML's torus: the energies that independent solvers found.
#[test]
fn the_papers_torus() {
    let file = reference("hirota_torus_reference.json");
    let mesh = shapes::uv_torus(1.0, 0.4, 64, 32);
    for case in file["cases"].as_array().unwrap().iter().filter(|case| number(&case["N_tri"]) == 4096.0) {
        let net =
            case["net"].as_str().unwrap().replace("n14kuhn", "14-kuhn").replace('n', "").replace("14-kuh", "14-kuhn");
        let section = format!("[elastic]\nnet = '{net}'\n");
        let (outcome, elastic) = settled(&mesh, &format!("{LATTICE}{SQUASH}{ELASTIC}{section}"));
        assert_eq!(
            (elastic.net.as_str(), elastic.status.as_str(), elastic.held, elastic.free),
            (net.as_str(), "settled", 18, 9)
        );
        assert!((elastic.energy / number(&case["E_opt"]) - 1.0).abs() < 1e-9, "{net}: {}", elastic.energy);
        assert!((elastic.energy_posed / number(&case["E_start"]) - 1.0).abs() < 1e-9);
        assert!((elastic.pressures[0] / number(&case["lambda_opt"]) - 1.0).abs() < 1e-6);
        assert!(outcome.report.correction.max_displacement > 0.1);
        let (optimum, nodes) = (vectors(&case["X_opt"]), outcome.controls.unwrap().posed);
        for node in numbers(&case["free_nodes"]).iter().map(|node| *node as usize) {
            assert!(nodes[node].distance(optimum[node]) < 1e-6, "{net}: node {node}");
        }
        // The same by the mesh, and nearly the same by HML's own solver.
        let (_, by_mesh) = settled(&mesh, &format!("{LATTICE}{SQUASH}{ELASTIC}{section}levels = 1\n"));
        assert_eq!((elastic.evaluation.as_str(), by_mesh.evaluation.as_str()), ("form", "mesh"));
        assert!((by_mesh.energy / elastic.energy - 1.0).abs() < 1e-12);
        let (_, by_levels) =
            settled(&mesh, &format!("{LATTICE}{SQUASH}{ELASTIC}{section}solver = 'augmented-lagrangian'\n"));
        assert_eq!(by_levels.status, "approximate");
        assert!(by_levels.levels.len() > 2 && (by_levels.energy / elastic.energy - 1.0).abs() < 0.01, "{by_levels:?}");
        let (_, alone) = settled(
            &mesh,
            &format!("{LATTICE}{SQUASH}{ELASTIC}{section}solver = 'augmented-lagrangian'\nlevels = 1\n"),
        );
        assert_eq!(alone.levels.len(), 1);
        let (_, two) = settled(
            &mesh,
            &format!("{LATTICE}{SQUASH}{ELASTIC}{section}solver = 'augmented-lagrangian'\nlevels = 2\n"),
        );
        assert_eq!(two.levels.len(), 2);
    }
}

#[test]
fn what_is_held_stays_and_what_is_not_moves() {
    let mesh = shapes::icosphere(3);
    let lattice = "lattice = { size = 6 }\n";
    let edit = "edit = [{ twist = { axis = 'z', degrees = 60 } }, { stretch = { axis = 'z', scale = 0.7 } }]\n";
    let moved = |section: &str| -> (Vec<bool>, Vec<[usize; 3]>) {
        let (outcome, _) = settled(&mesh, &format!("{lattice}{edit}{ELASTIC}{section}"));
        let posed = run(&mesh, &format!("{lattice}{edit}preserve = {{ volume = 'free' }}")).unwrap().controls.unwrap();
        let controls = outcome.controls.unwrap();
        let moved = controls.posed.iter().zip(&posed.posed).map(|(a, b)| a != b).collect();
        (moved, (0..216).map(|node| controls.lattice.node(node)).collect())
    };
    let (is_moved, nodes) = moved("[elastic]\nhold = { k = [0, 5] }\n");
    assert!(is_moved.iter().zip(&nodes).all(|(moved, node)| *moved != (node[2] == 0 || node[2] == 5)));
    // A pin adds to them; along z nothing moves where axes say so.
    let (is_moved, nodes) = moved("pin = { i = 2 }\naxes = 'xy'\n[elastic]\nhold = { k = [0, 5] }\n");
    assert!(is_moved.iter().zip(&nodes).all(|(moved, node)| *moved != (node[2] == 0 || node[2] == 5 || node[0] == 2)));
    // All of them were edited.
    let error = refused(&mesh, &format!("{lattice}{edit}{ELASTIC}"));
    assert!(error.is_unreachable() && error.place() == "elastic.hold" && error.code() == "impossible", "{error}");
    assert!(error.to_string().contains("every node is held"), "{error}");
    assert!(matches!(
        refused(&mesh, &format!("{lattice}{edit}{ELASTIC}[elastic]\nhold = 'all'\n")),
        JobError::Elastic(_)
    ));
}

/// Values and derivatives up to the order agree with the identity at the border of the lattice.
#[test]
fn continuity_holds_border_layers_at_rest() {
    let mesh = shapes::icosphere(3);
    let job = |lattice: &str, word: &str| {
        format!(
            "lattice = {{ {lattice} }}\nedit = [{{ move = {{ by = [0.1, 0, 0.1], nodes = {{ list = [[4, 4, 4]] }} }} }}]\n{ELASTIC}[elastic]\ncontinuity = '{word}'\n"
        )
    };
    for (lattice, layers) in [
        ("size = 9", [1, 2, 3]),
        ("basis = 'bernstein', size = 8", [1, 2, 3]),
        ("size = 9, knots = 'uniform'", [3, 3, 3]),
    ] {
        for (word, layers) in ["c0", "c1", "c2"].into_iter().zip(layers) {
            let (outcome, elastic) = settled(&mesh, &job(lattice, word));
            let controls = outcome.controls.unwrap();
            let size = controls.lattice.size();
            let is_border = |node: [usize; 3]| (0..3).any(|a| node[a] < layers || node[a] + layers >= size[a]);
            let border: Vec<usize> =
                (0..controls.rest.len()).filter(|n| is_border(controls.lattice.node(*n))).collect();
            assert!(border.iter().all(|node| controls.posed[*node] == controls.rest[*node]), "{lattice} {word}");
            assert_eq!(elastic.held, border.len() + 1, "{lattice} {word}");
        }
    }
    let error = refused(&mesh, &job("size = 9", "c2").replace("[4, 4, 4]", "[2, 4, 4]"));
    assert_eq!((error.place().as_str(), error.is_unreachable()), ("elastic.continuity", false));
    assert!(error.to_string().contains("(2, 4, 4)"), "{error}");
}

#[test]
fn centre_of_mass_and_inertia_in_jobs() {
    let mesh = shapes::bottle(24, 30);
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    let edit = "edit = [{ bend = { axis = 'z', degrees = 50, towards = 'x', nodes = { k = [4, 5] } } }]\n";
    let extent = mesh.bounds().unwrap().extent();
    let at_rest = MomentTargets::of(&solid, mesh.points(), true);
    let center = |section: &str| {
        let (outcome, elastic) = settled(&mesh, &format!("{edit}{ELASTIC}[elastic]\n{section}"));
        let found = MomentTargets::of(&solid, &outcome.points, true);
        (found, elastic)
    };
    let (free, elastic) = center("");
    assert!(free.center.distance(at_rest.center) > 1e-3 * extent && elastic.center_of_mass.is_none());
    let (kept, elastic) = center("center_of_mass = 'keep'\n");
    assert!(kept.center.distance(at_rest.center) < 1e-12 * extent, "{} {}", kept.center, at_rest.center);
    let [rest, posed, end] = elastic.center_of_mass.unwrap().map(DVec3::from_array);
    assert!(rest.distance(end) < 1e-12 * extent && rest.distance(posed) > 1e-3 * extent);
    let to = at_rest.center + DVec3::new(0.02, -0.01, 0.03) * extent;
    let (there, _) = center(&format!("center_of_mass = [{:?}, {:?}, {:?}]\n", to.x, to.y, to.z));
    assert!(there.center.distance(to) < 1e-12 * extent);
    let (same, elastic) = center("inertia = 'keep'\n");
    let (tensor, wanted) = (same.inertia.unwrap(), at_rest.inertia.unwrap());
    let scale = (0..3).map(|a| wanted.col(a)[a]).fold(0.0, f64::max);
    assert!(tensor.abs_diff_eq(wanted, 1e-11 * scale) && elastic.inertia_error.unwrap() < 1e-11, "{tensor} {wanted}");
    assert!(same.center.distance(at_rest.center) < 1e-12 * extent);
}

#[test]
fn points_are_met_and_dragged_vertices_hold_no_nodes() {
    let mesh = shapes::icosphere(3);
    let to = mesh.points()[0] + DVec3::new(0.2, 0.1, 0.3);
    let drag =
        format!("edit = [{{ drag = {{ points = [{{ vertex = 0, to = [{}, {}, {}] }}] }} }}]\n", to.x, to.y, to.z);
    let (outcome, elastic) = settled(&mesh, &format!("{drag}{ELASTIC}"));
    assert!(outcome.points[0].distance(to) < 1e-12);
    assert_eq!(elastic.held, 0);
    let points = format!("points = [{{ vertex = 0, to = [{}, {}, {}] }}]\nvolume = '120%'\n", to.x, to.y, to.z);
    let (outcome, _) = settled(&mesh, &format!("{ELASTIC}{points}"));
    assert!(outcome.points[0].distance(to) < 1e-12);
}

#[test]
fn springs_alone_decide_where_the_volume_is_free() {
    let mesh = shapes::icosphere(2);
    let (outcome, elastic) = settled(&mesh, &format!("{LATTICE}{SQUASH}{ELASTIC}volume = 'free'\n"));
    assert!(elastic.pressures.is_empty() && elastic.energy <= elastic.energy_posed);
    assert_eq!(outcome.report.volume.unwrap().overall.target, None);
    // Several volumes at once.
    let chain = shapes::chain(3, 16, 8);
    let (outcome, elastic) = settled(
        &chain,
        &format!(
            "edit = [{{ stretch = {{ axis = 'y', scale = 0.7, nodes = {{ i = 0 }} }} }}]\n{ELASTIC}volume = 'each'\n"
        ),
    );
    assert_eq!(elastic.pressures.len(), 3);
    assert!(outcome.report.volume.unwrap().components.iter().all(|row| row.relative_error.unwrap() <= 1e-13));
}

#[test]
fn a_job_without_edits_stays_where_it_is() {
    let mesh = shapes::icosphere(2);
    let (outcome, elastic) = settled(&mesh, &format!("lattice = {{ size = 5 }}\n{ELASTIC}"));
    assert_eq!((outcome.points, elastic.energy, elastic.steps), (mesh.points().to_vec(), 0.0, 0));
    let (_, elastic) = settled(&mesh, &format!("lattice = {{ size = 5 }}\n{ELASTIC}volume = '150%'\n"));
    assert!(elastic.pressures[0] > 0.0 && elastic.energy > 0.0);
}

#[test]
fn keys_of_other_methods_are_refused() {
    let mesh = shapes::icosphere(1);
    for (toml, place) in [
        ("[elastic]\nnet = '14'\n".to_owned(), "elastic"),
        (format!("{ELASTIC}shares = [1, 2]\n"), "preserve.shares"),
        (format!("{ELASTIC}axes = [[0, 0, 1]]\n"), "preserve.axes"),
        (format!("{ELASTIC}objective = 'bending'\n"), "preserve.objective"),
        (format!("{ELASTIC}mobility = 'auto'\n"), "preserve.mobility"),
        (format!("{ELASTIC}falloff = {{ vertex = 0, radius = 0.3 }}\n"), "preserve.falloff"),
        (format!("{ELASTIC}preview = 100\n"), "preserve.preview"),
        (format!("portable_bits = true\n{ELASTIC}"), "portable_bits"),
        (format!("{ELASTIC}[elastic]\nlevels = 3\n"), "elastic.levels"),
        (format!("{ELASTIC}[elastic]\nstiffness = 0\n"), "elastic.stiffness"),
        (format!("{ELASTIC}[elastic]\nstiffness = {{ face = -1 }}\n"), "elastic.stiffness"),
        (format!("{ELASTIC}[elastic]\nhold = {{ k = 9 }}\n"), "elastic.hold"),
    ] {
        let error = refused(&mesh, &toml);
        assert_eq!((error.place().as_str(), error.is_unreachable()), (place, false), "{toml}: {error}");
    }
    for text in [
        "hold = 'some'",
        "levels = 0",
        "levels = -1",
        "levels = 'few'",
        "net = 15",
        "continuity = 'c3'",
        "center_of_mass = 'here'",
        "inertia = [[1, 2, 3], [0, 1, 0], [0, 0, 1]]",
        "stifness = 1",
        "solver = 'gradient'",
    ] {
        let error = Job::from_toml(&format!("[elastic]\n{text}\n")).expect_err(text);
        assert_eq!(error.line, Some(2), "{text}: {error}");
    }
    assert_eq!(Job::from_toml("[elastic]\nstifness = 1\n").unwrap_err().nearest.as_deref(), Some("stiffness"));
}

#[test]
fn values_of_the_section_are_read() {
    let job = |text: &str| Job::from_toml(&format!("[elastic]\n{text}\n")).unwrap().elastic.unwrap();
    assert_eq!(job("stiffness = 2").stiffness, isochor::Stiffness::uniform(2.0));
    let stiffness = isochor::Stiffness { edge: 1.0, face: 0.5, cell: 1.0 };
    assert_eq!(job("stiffness = { face = 0.5 }").stiffness, stiffness);
    assert_eq!(job("levels = 4").levels, isochor::LevelCount::AtMost(4));
    assert_eq!(job("levels = 'auto'").levels, isochor::LevelCount::Auto);
    assert_eq!(job("hold = 'edited'").hold, isochor::Hold::Edited);
    assert_eq!(job("hold = 'all'").hold, isochor::Hold::Nodes(isochor::Selector::All));
}

#[test]
fn films_settle_frame_by_frame() {
    let mesh = shapes::uv_torus(1.0, 0.4, 24, 12);
    let text = format!(
        "frames = 3\n{LATTICE}[[edit]]\nscale = {{ by = {{ keys = [[0, [1, 1, 1]], [1, [1, 1, 0.6]]] }}, nodes = {{ k = [0, 2] }} }}\n{ELASTIC}[elastic]\nhold = {{ k = [0, 2] }}\nstiffness = {{ keys = [[0, 1], [1, 3]] }}\n"
    );
    let film = Film::from_toml(&text).unwrap();
    let energies: Vec<f64> = (0..3)
        .map(|frame| {
            let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
            let outcome = film.job(frame).unwrap().run(&input, &mut |_| {}).unwrap();
            assert!(outcome.report.volume.unwrap().overall.relative_error.unwrap() <= 1e-13);
            outcome.report.elastic.unwrap().energy
        })
        .collect();
    assert!(energies[0] == 0.0 && energies[1] > 0.0 && energies[2] > energies[1], "{energies:?}");
}
