//! `cargo xtask performance`: measures this machine and puts the tables and the plot into the page on performance.

use std::process::Command;

const PAGE: &str = "docs/performance.md";
const PLOT: &str = "docs/performance.svg";

/// Between these lines stands what `isochor bench lattice` prints.
const BEGIN: &str = "<!-- isochor bench lattice -->\n";
const END: &str = "<!-- end -->\n";

/// Measures, and makes the page and its plot anew.
pub fn make() -> Result<(), String> {
    let page = std::fs::read_to_string(PAGE).map_err(|error| format!("{PAGE}: {error}"))?;
    let parts = page.split_once(BEGIN).and_then(|(head, rest)| Some((head, rest.split_once(END)?.1)));
    let (head, tail) = parts.ok_or_else(|| format!("{PAGE}: the comments between which tables stand are missing"))?;
    let tables = tables()?;
    std::fs::write(PAGE, format!("{head}{BEGIN}\n{tables}\n{END}{tail}")).map_err(|error| format!("{PAGE}: {error}"))
}

/// What the command prints.
fn tables() -> Result<String, String> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["run", "--release", "--locked", "--quiet", "-p", "isochor-cli", "--"]);
    command.args(["bench", "lattice", "--plot", PLOT]);
    eprintln!("$ isochor bench lattice --plot {PLOT}");
    let ran = command.output().map_err(|error| error.to_string())?;
    if !ran.status.success() {
        return Err(String::from_utf8_lossy(&ran.stderr).into_owned());
    }
    String::from_utf8(ran.stdout).map_err(|error| error.to_string())
}
