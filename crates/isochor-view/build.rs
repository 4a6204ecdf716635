//! Tells the tests where a Chromium is, if there is one.
//!
//! It is named by `ISOCHOR_CHROMIUM` or stands on the path. Tests that need it carry `#[cfg_attr(not(isochor_chromium), ignore =
//! …)]`, so that without it they are reported as ignored. One that is installed later is found when the
//! variable names it, or when this file is touched.

use std::path::PathBuf;

/// Names of the browser, the first found is taken.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

fn main() {
    println!("cargo::rustc-check-cfg=cfg(isochor_chromium)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=ISOCHOR_CHROMIUM");
    let named = std::env::var_os("ISOCHOR_CHROMIUM").map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let on_path = || NAMES.iter().flat_map(|name| std::env::split_paths(&path).map(move |folder| folder.join(name)));
    let found = match &named {
        Some(file) => Some(file.clone()).filter(|file| file.is_file()),
        None => on_path().find(|file| file.is_file()),
    };
    match found {
        Some(file) => {
            println!("cargo::rerun-if-changed={}", file.display());
            println!("cargo::rustc-cfg=isochor_chromium");
            println!("cargo::rustc-env=ISOCHOR_CHROMIUM_FILE={}", file.display());
        }
        None if named.is_some() => println!("cargo::warning=ISOCHOR_CHROMIUM is set, but names no file"),
        None => {}
    }
}
