//! `isochor bench cage`: CVB's numbers, and beside them models in cages.
//!
//! No test asserts a time.

use std::f64::consts::PI;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

fn quick(arguments: &[&str]) -> String {
    quick_in(Path::new("."), arguments)
}

fn quick_in(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    let output = command.current_dir(folder).args(["bench", "cage", "--quick"]).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    assert!(output.status.success(), "{}", text(output.stderr));
    text(output.stdout)
}

#[test]
fn small_models_are_measured_beside_the_papers() {
    let bench: Value = serde_json::from_str(&quick(&["--json"])).unwrap();
    // CVB, table 3: vertices, triangles, gradient, deformation on the GPU and on the processor.
    let expected = [
        ("Teapot", 530, 1024, [1.98, 0.18, 7.43]),
        ("Semi-sphere", 2524, 1054, [2.03, 0.37, 3.38]),
        ("Monkey", 2868, 968, [1.86, 0.19, 3.78]),
    ];
    let rows = bench["models"].as_array().unwrap();
    assert_eq!(rows.len(), expected.len());
    assert_eq!((&bench["cage_vertices"], &bench["cage_triangles"]), (&92.into(), &180.into()));
    for (row, (model, vertices, triangles, times)) in rows.iter().zip(expected) {
        let paper = &row["paper"];
        assert_eq!(
            (&paper["model"], &paper["vertices"], &paper["triangles"]),
            (&model.into(), &vertices.into(), &triangles.into())
        );
        for (key, ms) in ["gradient_ms", "gpu_deform_ms", "cpu_deform_ms"].into_iter().zip(times) {
            assert_eq!(paper[key], ms, "{model} {key}");
        }
        assert_eq!(row["vertices"], vertices);
        for run in row["runs"].as_array().unwrap() {
            for stage in ["bind", "gradient", "deform"] {
                assert!(run[stage]["ms"].as_f64().unwrap() > 0.0, "{run}");
            }
        }
    }
    let text = quick(&[]);
    for word in ["CVB, table 3", "Teapot", "2,868", "7.43", "GTX280"] {
        assert!(text.contains(word), "no {word} in {text}");
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Degrees: CVB's angle in closed form.
fn angle(s1: f64, s3: f64) -> f64 {
    (2.0 * (s1 * s3).sqrt() / (s1 + s3)).min(1.0).acos().to_degrees()
}

fn stress() -> Value {
    let bench: Value = serde_json::from_str(&quick(&["--json"])).unwrap();
    bench["stress"].clone()
}

/// CVB, figure 5. Of N directions one is √(4π/N) or less from that which is turned most, where the angle is less by (1 − k)/√k times the square of the
/// distance at most, k = s₃/s₁.
#[test]
fn no_direction_is_turned_by_more_than_the_closed_form_and_some_nearly_by_it() {
    let stress = stress();
    let directions = stress["directions"].as_f64().unwrap();
    let rows = stress["simulated"].as_array().unwrap();
    assert_eq!(rows.len(), 60);
    let mut largest_shortfall = 0.0f64;
    let mut places = Vec::new();
    for row in rows {
        let [s1, s2, s3] = numbers(&row["stretches"])[..] else { panic!("{row}") };
        assert!(s1 >= s2 && s2 >= s3 && s3 > 0.0, "{row}");
        places.push(if s1 > s3 { (s2 - s3) / (s1 - s3) } else { 0.0 });
        let [simulated, exact] = ["simulated", "exact"].map(|key| row[key].as_f64().unwrap());
        assert!((exact - angle(s1, s3)).abs() <= 1e-5, "{row}");
        let most = ((1.0 - s3 / s1) / (s3 / s1).sqrt() * 4.0 * PI / directions).to_degrees();
        assert!(simulated <= exact + 1e-9 && exact - simulated <= most + 1e-9, "{row}: {most}");
        largest_shortfall = largest_shortfall.max(exact - simulated);
    }
    assert_eq!(stress["largest_shortfall"].as_f64().unwrap(), largest_shortfall);
    for place in [0.0, 0.25, 0.5, 0.75, 1.0] {
        assert!(places.iter().filter(|p| (*p - place).abs() < 1e-9).count() >= 11, "{place}: {places:?}");
    }
}

/// CVB, figure 6: the polynomials' errors are those of their coefficients, and those that numpy.linalg.lstsq finds.
#[test]
fn errors_of_polynomials_are_those_of_their_coefficients() {
    let stress = stress();
    assert_eq!(stress["paper_average_error"], 0.44);
    let fits = stress["fits"].as_array().unwrap();
    let expected = [
        (2.0, 0.0013684757498998914, 0.024341321019178075),
        (5.0, 0.13104622755543316, 3.0877215635130497),
        (10.0, 0.4363417570371748, 11.533207542830922),
        (20.0, 0.7490990623617864, 21.194857120409267),
    ];
    assert_eq!(fits.len(), expected.len());
    for (fit, (factor, average, largest)) in fits.iter().zip(expected) {
        assert_eq!((&fit["factor"], &fit["pairs"]), (&factor.into(), &5050.into()));
        let coefficients = numbers(&fit["coefficients"]);
        assert_eq!(coefficients.len(), 28);
        let stretch = |n: usize| 1.0 / factor + (factor - 1.0 / factor) * n as f64 / 99.0;
        let scaled = |s: f64| (2.0 * s - factor - 1.0 / factor) / (factor - 1.0 / factor);
        let error = |(i, j): (usize, usize)| {
            let (x, y) = (scaled(stretch(i)), scaled(stretch(j)));
            let powers = (0..=6).flat_map(|i| (0..=6 - i).map(move |j| x.powi(i) * y.powi(j)));
            let polynomial: f64 = coefficients.iter().zip(powers).map(|(c, power)| c * power).sum();
            (polynomial - angle(stretch(i), stretch(j))).abs()
        };
        let errors: Vec<f64> = (0..100).flat_map(|i| (0..=i).map(move |j| (i, j))).map(error).collect();
        let mean = errors.iter().sum::<f64>() / 5050.0;
        let most = errors.into_iter().fold(0.0, f64::max);
        let [found, found_largest] = ["average_error", "largest_error"].map(|key| fit[key].as_f64().unwrap());
        // The arc cosine here is off by 1e-6° where stretches are nearly the same.
        assert!((found - mean).abs() < 1e-8 && (found_largest - most).abs() < 1e-6, "{fit}: {mean} {most}");
        assert!((found - average).abs() < 1e-9 && (found_largest - largest).abs() < 1e-8, "{fit}");
    }
    let text = quick(&[]);
    for words in [
        "| 1/2 to 2 | 5,050 | 0.00137 | 0.0243 |",
        "| 1/5 to 5 | 5,050 | 0.131 | 3.09 |",
        "| 1/10 to 10 | 5,050 | 0.436 | 11.5 |",
        "| 1/20 to 20 | 5,050 | 0.749 | 21.2 |",
        "CVB: 0.44° on average",
        "of 100,000 directions",
    ] {
        assert!(text.contains(words), "no {words} in {text}");
    }
}

#[test]
fn both_figures_are_in_the_plot() {
    let folder = tempfile::tempdir().unwrap();
    quick_in(folder.path(), &["--plot", "stress.svg"]);
    let text = std::fs::read_to_string(folder.path().join("stress.svg")).unwrap();
    let svg = roxmltree::Document::parse(&text).unwrap();
    let count = |name: &str| svg.descendants().filter(|node| node.tag_name().name() == name).count();
    // 60 triplets, 5 dots in the key, 4 polynomials at 41 places.
    assert_eq!(count("circle"), 60 + 5 + 4 * 41);
    let words: Vec<&str> = svg.descendants().filter_map(|node| node.text()).map(str::trim).collect();
    for word in [
        "CVB, figure 5: the largest angle of many directions",
        "CVB, figure 6: the angle (lines) and a polynomial of degree 6 (dots), stretches from 1/10 to 10",
        "closed form",
        "s₂ = s₃",
        "s₂ = s₁",
        "s₁ = 10",
        "s₃/s₁",
    ] {
        assert!(words.contains(&word), "{word}: {words:?}");
    }
}
