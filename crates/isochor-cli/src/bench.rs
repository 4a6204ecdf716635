//! `isochor bench`: times and memory on this machine.

use crate::args::BenchCommand;
use crate::failure::Failure;
use crate::terminal::Terminal;
use crate::{bench_cage, bench_deform, bench_elastic, bench_lattice, bench_surface};

/// Runs a measurement; commands that it runs get as many threads as this one.
pub fn run(bench: &BenchCommand, threads: Option<u16>, terminal: &Terminal) -> Result<(), Failure> {
    match bench {
        BenchCommand::Lattice(args) => bench_lattice::run(args, terminal),
        BenchCommand::Surface(args) => bench_surface::run(args, terminal),
        BenchCommand::Elastic(args) => bench_elastic::run(args, terminal),
        BenchCommand::Cage(args) => bench_cage::run(args, terminal),
        BenchCommand::Deform(args) => bench_deform::run(args, threads, terminal),
    }
}

/// Threads to measure with: one, and all where there are more.
pub fn pools() -> Result<Vec<rayon::ThreadPool>, Failure> {
    let mut threads = vec![1, rayon::current_num_threads()];
    threads.dedup();
    let failed = |error: rayon::ThreadPoolBuildError| {
        Failure::usage("--threads", error.to_string(), "ask for fewer threads, or leave it out to use all cores")
    };
    let pool = |threads: &usize| rayon::ThreadPoolBuilder::new().num_threads(*threads).build().map_err(failed);
    threads.iter().map(pool).collect()
}
