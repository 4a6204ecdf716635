//! The isochor patch file: JSON with degrees, knots, control points and weights.
//!
//! ```json
//! { "kind": "patch", "version": 1, "degree": [3, 2],
//!   "knots": [[0, 0, 0, 0, 1, 1, 1, 1], [0, 0, 0, 0.5, 1, 1, 1]],
//!   "controls": [[[0, 0, 0], …], …], "weights": [[1, …], …] }
//! ```
//!
//! Control points are nested `[i][j] = [x, y, z]`, i along s. `knots` may be left out: 0 and 1 repeated degree + 1
//! times, equidistant between. `weights`, `[i][j]`, may be left out: 1 everywhere.

use glam::DVec3;
use isochor::{Basis, Patch};
use serde::{Deserialize, Serialize};

use crate::ReadError;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatchFile {
    kind: Kind,
    version: u32,
    degree: [usize; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    knots: Option<[Vec<f64>; 2]>,
    controls: Vec<Vec<DVec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    weights: Option<Vec<Vec<f64>>>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Patch,
}

/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;

/// Reads a patch file.
///
/// # Errors
///
/// Text that is not JSON of this form (with its line); knots, degrees, control points and weights that do not fit
/// together or make no [`Patch`].
pub fn patch_from_json(text: &str) -> Result<Patch, ReadError> {
    let file: PatchFile = serde_json::from_str(text).map_err(|error| {
        // The text of the error ends with its place.
        let what = error.to_string();
        let what = what.split(" at line ").next().unwrap_or(&what).to_owned();
        let read = ReadError::new(what);
        if error.line() > 0 { read.at_line(error.line()) } else { read }
    })?;
    if file.version != VERSION {
        let what = format!("version is {}: only {VERSION} is known", file.version);
        return Err(ReadError::new(what).with_hint("read the file with the program that wrote it"));
    }
    let size = [file.controls.len(), file.controls.first().map_or(0, Vec::len)];
    let controls = flat("controls", file.controls, size)?;
    let weights = file.weights.map(|nested| flat("weights", nested, size)).transpose()?;
    let along = |axis: usize| {
        let degree = file.degree[axis];
        let basis = match &file.knots {
            Some(knots) => Basis::with_knots(knots[axis].clone(), degree),
            None => Basis::clamped(size[axis], degree),
        };
        let basis = basis.map_err(|error| ReadError::new(format!("along {}: {error}", ["s", "t"][axis])));
        basis.and_then(|basis| match (basis.size(), size[axis]) {
            (expected, found) if expected != found => {
                let place = ["controls", "controls[0]"][axis];
                let what = format!("{place} has {found} entries: the knots make it {expected}");
                Err(ReadError::new(what).with_hint("there are as many knots as control points, and degree + 1 more"))
            }
            _ => Ok(basis),
        })
    };
    Patch::new([along(0)?, along(1)?], controls, weights).map_err(|error| ReadError::new(error.to_string()))
}

/// The patch file of `patch`. Numbers have as many digits as bring them back bit for bit.
#[must_use]
pub fn patch_to_json(patch: &Patch) -> String {
    let [over_s, over_t] = patch.bases();
    let m = over_t.size();
    let file = PatchFile {
        kind: Kind::Patch,
        version: VERSION,
        degree: [over_s.degree(), over_t.degree()],
        knots: Some([over_s.knots().to_vec(), over_t.knots().to_vec()]),
        controls: patch.controls().chunks(m).map(<[DVec3]>::to_vec).collect(),
        weights: patch.weights().map(|all| all.chunks(m).map(<[f64]>::to_vec).collect()),
    };
    serde_json::to_string(&file).expect("finite numbers and fixed keys make JSON") + "\n"
}

/// Values at [i][j] as one list, if there is one for each control point.
fn flat<T>(key: &str, nested: Vec<Vec<T>>, [n, m]: [usize; 2]) -> Result<Vec<T>, ReadError> {
    let expect = |place: String, found: usize, expected: usize| match found == expected {
        true => Ok(()),
        false => {
            let what = format!("{key}{place} has {found} entries: there must be {expected}");
            Err(ReadError::new(what).with_hint("all rows are as long as controls[0]"))
        }
    };
    expect(String::new(), nested.len(), n)?;
    for (i, row) in nested.iter().enumerate() {
        expect(format!("[{i}]"), row.len(), m)?;
    }
    Ok(nested.into_iter().flatten().collect())
}
