//! The median time of something that is done again and again.

use std::time::{Duration, Instant};

/// How often to measure.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Time for one median. More: less noise; less: a table of many is done sooner.
    pub budget: Duration,
    /// Runs that are made even where they take longer.
    pub least_runs: usize,
}

impl Patience {
    /// For figures.
    pub const THOROUGH: Self = Self { budget: Duration::from_millis(400), least_runs: 5 };
    /// Enough to see that all works.
    pub const QUICK: Self = Self { budget: Duration::from_millis(5), least_runs: 1 };
}

/// Runs after which a median has settled. More: small models take longer than they need.
const MOST_RUNS: usize = 101;

/// A median and of how many runs it is.
#[derive(Clone, Copy, Debug)]
pub struct Median {
    pub time: Duration,
    pub runs: usize,
}

/// The median time of `work`, after a first run that does not count. What it returns is dropped outside of the time.
pub fn median<R>(patience: Patience, mut work: impl FnMut() -> R) -> Median {
    let mut timed = || {
        let start = Instant::now();
        let result = std::hint::black_box(work());
        let time = start.elapsed();
        drop(result);
        time
    };
    timed();
    let begin = Instant::now();
    let mut times = Vec::new();
    while times.len() < patience.least_runs || (begin.elapsed() < patience.budget && times.len() < MOST_RUNS) {
        times.push(timed());
    }
    Median { runs: times.len(), time: middle(&mut times) }
}

/// The middle one in order of their length, 0 of none; of an even number, the longer of the two in the middle.
pub fn middle(times: &mut [Duration]) -> Duration {
    times.sort_unstable();
    times.get(times.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_that_of_sorted_times() {
        for (times, expected) in [(&[][..], 0), (&[3], 3), (&[9, 1], 9), (&[5, 1, 3], 3), (&[2, 9, 1, 7], 7)] {
            let mut times: Vec<Duration> = times.iter().map(|ms| Duration::from_millis(*ms)).collect();
            assert_eq!(middle(&mut times), Duration::from_millis(expected));
        }
    }

    #[test]
    fn the_first_run_does_not_count() {
        let mut runs = 0;
        let found = median(Patience { budget: Duration::ZERO, least_runs: 3 }, || runs += 1);
        assert_eq!((runs, found.runs), (4, 3));
    }

    #[test]
    fn what_takes_no_time_is_not_done_for_ever() {
        let patience = Patience { budget: Duration::from_secs(3600), least_runs: 1 };
        assert_eq!(median(patience, || ()).runs, MOST_RUNS);
    }
}
