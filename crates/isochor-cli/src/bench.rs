//! `isochor bench`: how fast this machine is.

use crate::args::BenchCommand;
use crate::bench_lattice;
use crate::failure::Failure;
use crate::terminal::Terminal;

/// Runs one of the measurements.
pub fn run(bench: &BenchCommand, terminal: &Terminal) -> Result<(), Failure> {
    match bench {
        BenchCommand::Lattice(args) => bench_lattice::run(args, terminal),
    }
}
