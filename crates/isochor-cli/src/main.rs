//! The `isochor` command: reads models and jobs, hands them to the library, writes what comes back.

mod args;
mod bandwidth;
mod bench;
mod bench_cage;
mod bench_deform;
mod bench_elastic;
mod bench_lattice;
mod bench_surface;
mod bench_tables;
mod cage;
mod demo;
mod elastic_examples;
mod failure;
mod files;
mod flags;
mod frames;
mod info;
mod inputs;
mod median;
mod memory;
mod model;
mod non_zeros;
mod pages;
mod paper;
mod pictures;
mod plot;
mod request;
mod run;
mod sheet_picture;
mod stages;
mod stand_in;
mod stress_angle;
mod table;
mod terminal;

use std::process::ExitCode;

fn main() -> ExitCode {
    run::command(args::parse())
}
