//! `isochor bench`: times and memory on this machine.

use crate::args::BenchCommand;
use crate::failure::Failure;
use crate::terminal::Terminal;
use crate::{bench_deform, bench_lattice};

/// Runs a measurement; commands that it runs get as many threads as this one.
pub fn run(bench: &BenchCommand, threads: Option<u16>, terminal: &Terminal) -> Result<(), Failure> {
    match bench {
        BenchCommand::Lattice(args) => bench_lattice::run(args, terminal),
        BenchCommand::Deform(args) => bench_deform::run(args, threads, terminal),
    }
}
