//! `--portable-bits`: the same bytes on processors of different levels, which an emulator stands for.

use std::path::Path;
use std::process::Command;

/// Requests that take every way through the arithmetic whose bits depend on the processor.
const REQUESTS: [&str; 6] = [
    "--preserve nearest",
    "--preserve gradient --noise 0.05,7",
    "--preserve xyz --bend x=60,z",
    "--preserve nearest --objective surface",
    "--preserve gradient --objective bending --falloff 0:0.4",
    "--preserve xyz --degree 2 --mobility auto --volume 80%",
];

/// The model that `isochor deform` writes, run by `runner` (nothing: the processor at hand).
fn deformed(runner: &[&str], request: &str, folder: &Path) -> Vec<u8> {
    let mut line = runner.to_vec();
    line.push(env!("CARGO_BIN_EXE_isochor"));
    line.extend("deform shape:bottle?n=24 --quiet -o out.ply --precision f64 --twist z=90".split(' '));
    line.extend(request.split(' '));
    let ran = Command::new(line[0]).args(&line[1..]).current_dir(folder).output().unwrap();
    assert!(ran.status.success(), "{line:?}: {}", String::from_utf8_lossy(&ran.stderr));
    std::fs::read(folder.join("out.ply")).unwrap()
}

#[test]
#[cfg_attr(not(isochor_qemu), ignore = "needs qemu-x86_64 on the path, and an x86-64 processor")]
fn bits_are_the_same_with_and_without_fused_multiply_adds() {
    // The first has SSE4.2 only, the second AVX2 and fused multiply-adds.
    let levels = ["Nehalem", "Haswell"].map(|cpu| ["qemu-x86_64", "-cpu", cpu]);
    let folder = tempfile::tempdir().unwrap();
    let mut differing = 0;
    for request in REQUESTS {
        let portable = format!("{request} --portable-bits");
        let here = deformed(&[], &portable, folder.path());
        for level in &levels {
            assert!(deformed(level, &portable, folder.path()) == here, "{portable} on {level:?}");
        }
        let [low, high] = levels.each_ref().map(|level| deformed(level, request, folder.path()));
        differing += usize::from(low != high);
    }
    assert!(differing > 0, "without the flag some bits differ, or this test shows nothing");
}

#[test]
fn bits_are_the_same_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    for request in REQUESTS {
        let of = |threads: u16| deformed(&[], &format!("{request} --portable-bits --threads {threads}"), folder.path());
        assert!(of(1) == of(3), "{request}");
    }
}
