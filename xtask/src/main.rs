//! One word for what is done to the whole workspace: `cargo xtask test`, `cargo xtask lint`, `cargo xtask viewer`, `cargo xtask gallery`,
//! `cargo xtask performance`.

mod gallery;
mod performance;

use std::process::{Command, ExitCode};

const USAGE: &str = "cargo xtask test   fetches what is missing and runs all tests
cargo xtask lint   rustfmt, clippy and documentation, all warnings are errors
cargo xtask viewer bundles the 3D view of report pages anew; needs Node.js
cargo xtask gallery runs the example jobs and makes docs/gallery.md and its pictures anew
cargo xtask performance measures this machine and makes the tables and the plot of docs/performance.md anew; leave it alone meanwhile";

/// Where the 3D view of report pages is.
const VIEWER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/isochor-view/src/viewer");

/// The versions of package-lock.json, no scripts of theirs; then build.mjs.
const BUNDLE: &[&str] = &["ci --ignore-scripts --no-audit --no-fund", "run --silent build"];

/// The core without threads first, then everything.
const TEST: &[&str] = &[
    "fetch --locked",
    "test --locked -p isochor --no-default-features --test reference --test correct --test volume",
    "test --locked --workspace --all-features",
];

const LINT: &[&str] = &[
    "fmt --all --check",
    "clippy --locked --workspace --all-features --all-targets -- -D warnings",
    "doc --locked --workspace --all-features --no-deps",
];

fn main() -> ExitCode {
    let succeeded = match std::env::args().nth(1).as_deref() {
        Some("test") => TEST.iter().all(|step| cargo(step)),
        Some("gallery") => gallery::make().map_err(|error| eprintln!("{error}")).is_ok(),
        Some("performance") => performance::make().map_err(|error| eprintln!("{error}")).is_ok(),
        Some("viewer") => BUNDLE.iter().all(|step| npm(step)),
        Some("lint") => add_components() && LINT.iter().all(|step| cargo(step)),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    if succeeded { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs cargo with `arguments`, and says so.
fn cargo(arguments: &str) -> bool {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.env("RUSTDOCFLAGS", "-D warnings");
    succeeds("cargo", command, arguments)
}

/// Runs npm with `arguments` for the 3D view, and says so.
fn npm(arguments: &str) -> bool {
    let mut command = Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" });
    command.current_dir(VIEWER);
    succeeds("npm", command, arguments)
}

fn succeeds(name: &str, mut command: Command, arguments: &str) -> bool {
    eprintln!("$ {name} {arguments}");
    match command.args(arguments.split(' ')).status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("{name} cannot be run: {error}");
            false
        }
    }
}

/// Toolchains made by rustup may lack rustfmt and clippy.
fn add_components() -> bool {
    let is_there = |tool: &str| Command::new(tool).arg("--version").output().is_ok_and(|out| out.status.success());
    if is_there("cargo-fmt") && is_there("cargo-clippy") {
        return true;
    }
    eprintln!("$ rustup component add rustfmt clippy");
    let status = Command::new("rustup").args(["component", "add", "rustfmt", "clippy"]).status();
    if !status.is_ok_and(|status| status.success()) {
        eprintln!("install rustfmt and clippy for this toolchain, then try again");
        return false;
    }
    true
}
