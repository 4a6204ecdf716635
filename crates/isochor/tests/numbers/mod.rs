//! Numbers of independent programs, in `tests/reference/`.

use std::path::Path;

use glam::DVec3;
use serde_json::Value;

pub fn reference(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name);
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap()
}

pub fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(number).collect()
}

pub fn vectors(v: &Value) -> Vec<DVec3> {
    v.as_array().unwrap().iter().map(|p| DVec3::from_slice(&numbers(p))).collect()
}
