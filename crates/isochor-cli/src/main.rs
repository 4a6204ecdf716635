//! The `isochor` command: reads models and jobs, hands them to the library, writes what comes back.

mod args;
mod bench;
mod bench_deform;
mod demo;
mod failure;
mod files;
mod flags;
mod frames;
mod info;
mod memory;
mod model;
mod pages;
mod pictures;
mod request;
mod run;
mod terminal;

use std::process::ExitCode;

fn main() -> ExitCode {
    run::command(args::parse())
}
