//! `isochor bench`: times and memory on this machine.

use crate::args::BenchCommand;
use crate::bench_deform;
use crate::failure::Failure;
use crate::terminal::Terminal;

/// Runs a measurement; its commands get as many threads as this one.
pub fn run(bench: &BenchCommand, threads: Option<u16>, terminal: &Terminal) -> Result<(), Failure> {
    match bench {
        BenchCommand::Deform(args) => bench_deform::run(args, threads, terminal),
    }
}
