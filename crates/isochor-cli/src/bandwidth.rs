//! How fast this machine reads and copies memory: what every other sweep is compared with.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::median::middle;

/// Numbers that one task sweeps at a time, 1 MiB. More: worse balance between threads; fewer: tasks begin and end all the time.
const PART: usize = 1 << 17;

/// Sums side by side, so that additions do not wait for one another. More than 16 do not fit into the registers of every processor.
const LANES: usize = 16;

/// Two large arrays and the times of sweeps over them.
pub struct Sweeps {
    from: Vec<f64>,
    to: Vec<f64>,
    reads: Vec<Duration>,
    copies: Vec<Duration>,
}

/// Bytes per second.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Bandwidth {
    /// Read, of a sum over an array.
    pub read: f64,
    /// Read and written together, of a copy.
    pub copy: f64,
}

impl Sweeps {
    /// Sweeps over arrays of so many bytes.
    pub fn over(bytes: usize) -> Self {
        let len = (bytes / size_of::<f64>()).max(1);
        // Not zero, so that the memory is really there.
        Self { from: vec![1.0; len], to: vec![2.0; len], reads: Vec::new(), copies: Vec::new() }
    }

    /// Bytes of one array.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.from[..])
    }

    /// Sweeps once more in each way, with the threads of the pool it is called in.
    pub fn take(&mut self) {
        let start = Instant::now();
        std::hint::black_box(self.from.par_chunks(PART).map(sum).sum::<f64>());
        self.reads.push(start.elapsed());
        let start = Instant::now();
        self.to.par_chunks_mut(PART).zip(self.from.par_chunks(PART)).for_each(|(to, from)| to.copy_from_slice(from));
        std::hint::black_box(&mut self.to);
        self.copies.push(start.elapsed());
    }

    /// The medians since the last call; of one sweep where there was none since.
    pub fn bandwidth(&mut self) -> Bandwidth {
        if self.reads.is_empty() {
            self.take();
        }
        let bytes = self.bytes() as f64;
        let median = |times: &mut Vec<Duration>| middle(&mut std::mem::take(times)).as_secs_f64();
        Bandwidth { read: bytes / median(&mut self.reads), copy: 2.0 * bytes / median(&mut self.copies) }
    }
}

fn sum(part: &[f64]) -> f64 {
    let (groups, rest) = part.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for group in groups {
        lanes.iter_mut().zip(group).for_each(|(lane, x)| *lane += x);
    }
    lanes.iter().chain(rest).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_take_every_number_once() {
        // Whole numbers add up exactly: n (n − 1) / 2.
        for len in [0, 1, 31, 32, 33, 1000] {
            let part: Vec<f64> = (0..len).map(f64::from).collect();
            assert_eq!(sum(&part), f64::from(len) * (f64::from(len) - 1.0) / 2.0);
        }
    }

    #[test]
    fn bandwidths_are_positive_for_arrays_of_any_length() {
        for bytes in [0, 8, 1 << 20] {
            let mut sweeps = Sweeps::over(bytes);
            sweeps.take();
            let Bandwidth { read, copy } = sweeps.bandwidth();
            assert!(read > 0.0 && copy > 0.0, "{read} {copy}");
            assert_eq!(sweeps.to, sweeps.from);
        }
    }
}
