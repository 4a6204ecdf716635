//! Random small requests end exact, or with a reason that an independent judge confirms.

#[expect(dead_code, reason = "only the mesh is used")]
mod bodies;
mod judge;
mod random;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use isochor::{Pose, correct};
use judge::Judge;
use judge::case::Case;
use rayon::prelude::*;

/// How the request of this number ends, or what is wrong with its end.
fn ending(seed: u64) -> Result<&'static str, String> {
    let case = Case::new(seed);
    let pose = Pose { solid: &case.solid, vertices: &case.posed, binding: &case.binding };
    let answer = correct(&pose, &case.wanted, &case.options);
    let said = |wrong: String| {
        let answer =
            answer.as_ref().map_or_else(|error| error.to_string(), |corrected| format!("{:?}", corrected.status));
        format!("seed {seed}: {wrong}\n    answer: {answer}\n    {}", case.story)
    };
    Judge::new(&case).verdict(&answer).map_err(said)
}

/// How often requests end how.
fn endings(seeds: std::ops::Range<u64>) -> BTreeMap<&'static str, usize> {
    let guarded = |seed: u64| {
        catch_unwind(AssertUnwindSafe(|| ending(seed)))
            .unwrap_or_else(|_| Err(format!("seed {seed}: panics\n    {}", Case::new(seed).story)))
    };
    let all: Vec<Result<&'static str, String>> = seeds.into_par_iter().map(guarded).collect();
    let wrong: Vec<&String> = all.iter().filter_map(|ending| ending.as_ref().err()).collect();
    let mut counts = BTreeMap::new();
    all.iter().flatten().for_each(|name| *counts.entry(*name).or_insert(0) += 1);
    let list = wrong.iter().map(|w| w.as_str()).collect::<Vec<_>>().join("\n");
    assert!(wrong.is_empty(), "{} of {} wrong, {counts:?}:\n{list}", wrong.len(), all.len());
    counts
}

#[test]
fn ten_thousand_random_requests_end_exact_or_with_a_true_reason() {
    let counts = endings(0..10_000);
    println!("{counts:?}");
    let reasons = ["pinned", "nothing bound", "dead", "coupled", "follows", "turns", "contradiction", "off axes"];
    for reason in reasons.iter().chain(&["rounding", "overflow"]) {
        assert!(counts.get(reason).is_some_and(|count| *count >= 20), "{reason} is too rare: {counts:?}");
    }
}

#[test]
fn the_gradient_of_the_judge_is_that_of_its_volume() {
    for seed in 0..20 {
        let case = Case::new(seed);
        let error = Judge::new(&case).gradient_error();
        assert!(error <= 1e-9, "seed {seed}: {error:e}, {}", case.story);
    }
}
