//! Tells the tests where the folder of reference models is, if it is there.
//!
//! It is named by `ISOCHOR_SHARED` or stands beside the checkout as `shared`. It is not part of the repository; tests that
//! need it carry `#[cfg_attr(not(isochor_shared), ignore = …)]`, so that without it they are reported as ignored.

use std::path::{Path, PathBuf};

fn main() {
    println!("cargo::rustc-check-cfg=cfg(isochor_shared)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=ISOCHOR_SHARED");
    let named = std::env::var_os("ISOCHOR_SHARED").map(PathBuf::from);
    let folder = named.clone().unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"));
    let manifest = folder.join("models/MANIFEST.tsv");
    match folder.canonicalize() {
        Ok(folder) if manifest.is_file() => {
            // Only where it exists: Cargo would take a missing file for a changed one and rebuild everything every time.
            println!("cargo::rerun-if-changed={}", manifest.display());
            println!("cargo::rustc-cfg=isochor_shared");
            println!("cargo::rustc-env=ISOCHOR_SHARED_DIR={}", folder.display());
        }
        _ if named.is_some() => {
            println!("cargo::warning=ISOCHOR_SHARED is set, but {} is no file", manifest.display());
        }
        _ => {}
    }
}
