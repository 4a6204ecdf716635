//! Tells the tests where the folder of reference models is, if it is there, and whether there is an emulator of other processors.
//!
//! The folder is named by `ISOCHOR_SHARED` or stands beside the checkout as `shared`. It is not part of the repository; tests that
//! need it carry `#[cfg_attr(not(isochor_shared), ignore = …)]`, so that without it they are reported as ignored. The emulator is
//! `qemu-x86_64` on the path, for tests with `isochor_qemu`; one that is installed later is found when this file is touched.

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
    println!("cargo::rustc-check-cfg=cfg(isochor_qemu)");
    let path = std::env::var_os("PATH").unwrap_or_default();
    if cfg!(target_arch = "x86_64") && std::env::split_paths(&path).any(|folder| folder.join("qemu-x86_64").is_file()) {
        println!("cargo::rustc-cfg=isochor_qemu");
    }
}
