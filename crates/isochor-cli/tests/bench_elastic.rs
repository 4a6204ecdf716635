//! `isochor bench elastic`: HML's numbers, and beside them examples that settle.
//!
//! No test asserts a time.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// HML, table 1: T₁ and T₂ in milliseconds, T₁/T₂, triangles, ΔV/V.
const TABLE_1: [(&str, f64, f64, f64, u64, f64); 4] = [
    ("Torus compression", 21_000.0, 1760.0, 12.0, 4096, 0.0005),
    ("Torus stretch", 677_400.0, 11_080.0, 61.0, 65_536, 0.0008),
    ("Club partial compression", 40_990.0, 3530.0, 12.0, 16_384, 0.0007),
    ("Cow bending", 15_810.0, 2240.0, 7.0, 5804, 0.0007),
];

/// What `bench elastic --quick` prints.
fn quick(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isochor"));
    let output = command.current_dir(folder).args(["bench", "elastic", "--quick"]).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    assert!(output.status.success(), "{}", text(output.stderr));
    text(output.stdout)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("{value} is no list"))
}

fn is_time(time: &Value) -> bool {
    number(&time["ms"]) > 0.0 && number(&time["runs"]) >= 1.0
}

/// One run for all that is asked of it: the report and the plot.
#[test]
fn examples_settle_beside_the_papers_rows() {
    let folder = tempfile::tempdir().unwrap();
    let text = quick(folder.path(), &["--json", "--threads", "2", "--plot", "plot.svg"]);
    let report: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&report["quick"], &report["threads"]), (&Value::Bool(true), &2.into()));
    assert_eq!(report["paper_machine"], "SGI Onyx2, 195 MHz R10000");
    let rows = list(&report["rows"]);
    assert_eq!(rows.len(), TABLE_1.len() + 1);
    for (row, (example, single, multi, ratio, triangles, volume_error)) in rows.iter().zip(TABLE_1) {
        let paper = &row["paper"];
        assert_eq!((&row["example"], &paper["example"]), (&example.into(), &example.into()));
        assert_eq!(paper["triangles"], triangles);
        let numbers = ["single_ms", "multi_ms", "ratio", "volume_error"].map(|key| number(&paper[key]));
        assert_eq!(numbers, [single, multi, ratio, volume_error]);
        // A closed mesh of every number of triangles there is not: the nearest that these shapes have.
        assert!((number(&row["triangles"]) / triangles as f64 - 1.0).abs() < 0.02, "{}", row["triangles"]);
    }
    assert_eq!((&rows[4]["paper"], &rows[4]["triangles"]), (&Value::Null, &65_536.into()));

    let circles = 5 + rows.iter().map(|row| list(&row["multi"]["levels"]).len()).sum::<usize>();
    for row in rows {
        for run in ["single", "multi"].map(|key| &row[key]) {
            assert_eq!(run["status"], "approximate", "{row}");
            assert!(is_time(&run["time"]) && number(&run["exact_error"]) <= 1e-13, "{row}");
            let mut cumulated = 0.0;
            for level in list(&run["levels"]) {
                // The paper's tolerance.
                assert!(number(&level["volume_error"]) <= 1e-3, "{level}");
                cumulated += number(&level["milliseconds"]);
                assert!((number(&level["cumulated_ms"]) / cumulated - 1.0).abs() < 1e-12, "{level}");
            }
        }
        for run in ["newton", "newton_on_mesh"].map(|key| &row[key]) {
            assert_eq!(run["status"], "settled", "{row}");
            assert!(is_time(&run["time"]) && number(&run["exact_error"]) <= 1e-13, "{row}");
            assert!(number(&run["residual"]) < 1e-9, "{row}");
        }
        // 27 and 20 nodes, of which some are held: few enough for a form.
        assert_eq!(row["newton"]["evaluations"], 0);
        assert!(number(&row["newton_on_mesh"]["evaluations"]) > 0.0);
        assert_eq!(row["form"]["status"], "settled");
        assert!(is_time(&row["form"]["setup"]) && is_time(&row["form"]["warm"]), "{row}");
        assert!(number(&row["form"]["exact_error"]) <= 1e-13, "{row}");
        let [single, multi] = ["single", "multi"].map(|key| number(&row[key]["evaluations"]));
        assert!(single > multi, "{row}");
        let triangles: Vec<f64> =
            list(&row["multi"]["levels"]).iter().map(|level| number(&level["triangles"])).collect();
        assert!(triangles.len() > 2 && triangles.windows(2).all(|pair| pair[0] < pair[1]), "{triangles:?}");
        assert_eq!(list(&row["single"]["levels"])[0]["triangles"], row["triangles"]);
    }

    // The torus of 65,536 triangles: the paper gains as much as that.
    let [single, multi] = ["single", "multi"].map(|key| number(&rows[4][key]["evaluations"]));
    assert!(multi <= single / 8.0, "{single} {multi}");
    // Table 2: nodes move less and less.
    let changes: Vec<f64> = list(&rows[0]["multi"]["levels"]).iter().map(|level| number(&level["change"])).collect();
    assert!(changes.windows(2).all(|pair| pair[1] < pair[0]), "{changes:?}");

    let svg = std::fs::read_to_string(folder.path().join("plot.svg")).unwrap();
    let svg = roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(svg.descendants().filter(|node| node.tag_name().name() == "circle").count(), circles);
    let words: Vec<&str> = svg.descendants().filter_map(|node| node.text()).map(str::trim).collect();
    for word in ["milliseconds", "farthest from balance, in extents", "Torus compression, 4,096 triangles"] {
        assert!(words.contains(&word), "{word}: {words:?}");
    }
}

#[test]
fn tables_have_the_papers_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let text = quick(folder.path(), &[]);
    let tables: Vec<Vec<Vec<&str>>> = text
        .split("**\n\n")
        .skip(1)
        .map(|table| {
            let rows = table.lines().take_while(|line| line.starts_with('|'));
            rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
        })
        .collect();
    // Tables 1 and 2 of the paper, one of the default solver, and a convergence for each example.
    assert_eq!(tables.len(), 3 + 5, "{text}");
    for table in &tables {
        assert!(table.iter().all(|row| row.len() == table[0].len()), "{text}");
    }
    let column = |table: usize, row: usize| tables[table][2 + row].clone();
    let paper = |row: Vec<&str>, columns: &[usize]| columns.iter().map(|k| row[*k].to_owned()).collect::<Vec<_>>();
    let table_1 = [
        ["4,096", "21,000", "1,760", "12", "0.05"],
        ["65,536", "677,400", "11,080", "61", "0.08"],
        ["16,384", "40,990", "3,530", "12", "0.07"],
        ["5,804", "15,810", "2,240", "7", "0.07"],
        ["–"; 5],
    ];
    for (k, expected) in table_1.iter().enumerate() {
        assert_eq!(paper(column(0, k), &[1, 3, 5, 7, 9]), expected);
    }
    let table_2 = [
        ["16", "25", "90", "120", "120"],
        ["64", "7.9", "15", "60", "180"],
        ["256", "3.3", "19", "290", "470"],
        ["1,024", "0.4", "13", "700", "1,170"],
        ["4,096", "0.01", "3", "590", "1,760"],
    ];
    for (k, expected) in table_2.iter().enumerate() {
        assert_eq!(paper(column(2, k), &[0, 1, 3, 5, 7]), expected);
    }
    for figure in 5..=8 {
        assert!(text.contains(&format!("**HML, figure {figure}: ")), "{text}");
    }
    assert!(text.contains("a dolphin stands in for the cow") && text.contains("amounts are chosen here"), "{text}");
    assert!(text.contains("leave --quick out"), "{text}");
}
