//! The isochor lattice file: JSON with bases, frame, rest and posed control points, mobility.
//!
//! ```json
//! { "kind": "lattice", "version": 1, "basis": "bspline", "degree": [3, 3, 3],
//!   "knots": [[0, 0, 0, 0, 1, 1, 1, 1], […], […]],
//!   "frame": { "origin": [0, 0, 0], "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]] },
//!   "rest": [[[[0, 0, 0], …], …], …], "posed": […], "mobility": […] }
//! ```
//!
//! Model coordinates. Control points are nested `[i][j][k] = [x, y, z]`, i along u, so that no reader has to guess an index
//! order. `rest` may be left out (Greville positions), `posed` too (at rest), `mobility` too (1 everywhere); a mobility is one
//! number or one for each coordinate. Bernstein files may leave out the knots.

use glam::DVec3;
use isochor::{Basis, Frame, Lattice, PosedLattice};
use serde::{Deserialize, Serialize};

/// Why a text is no lattice file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}")]
pub struct LatticeFileError {
    /// What is wrong, with the key or value.
    pub what: String,
    /// Line, from 1, where the text itself is wrong.
    pub line: Option<usize>,
}

impl LatticeFileError {
    fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), line: None }
    }
}

/// Values at [i][j][k].
type Nested<T> = Vec<Vec<Vec<T>>>;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LatticeFile {
    kind: Kind,
    version: u32,
    basis: BasisName,
    degree: [usize; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    knots: Option<[Vec<f64>; 3]>,
    frame: FrameEntry,
    #[serde(skip_serializing_if = "Option::is_none")]
    rest: Option<Nested<DVec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    posed: Option<Nested<DVec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mobility: Option<Nested<Mobility>>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Lattice,
}

#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum BasisName {
    Bspline,
    Bernstein,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameEntry {
    origin: DVec3,
    axes: [DVec3; 3],
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(untagged, expecting = "a mobility is one number or three: [mx, my, mz]")]
enum Mobility {
    All(f64),
    Each(DVec3),
}

/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;

/// Reads a lattice file.
///
/// # Errors
///
/// Text that is not JSON of this form; knots, degrees and control points that do not fit together; numbers that are not
/// finite; a negative mobility.
pub fn lattice_from_json(text: &str) -> Result<PosedLattice, LatticeFileError> {
    let file: LatticeFile = serde_json::from_str(text)
        .map_err(|e| LatticeFileError { what: e.to_string(), line: Some(e.line()).filter(|l| *l > 0) })?;
    if file.version != VERSION {
        return Err(LatticeFileError::new(format!("version is {}: only {VERSION} is known", file.version)));
    }
    let mut bases = Vec::with_capacity(3);
    for (a, axis) in ['u', 'v', 'w'].into_iter().enumerate() {
        let degree = file.degree[a];
        let basis = match &file.knots {
            Some(knots) => Basis::with_knots(knots[a].clone(), degree),
            None if file.basis == BasisName::Bernstein => Basis::bernstein(degree.saturating_add(1)),
            None => return Err(LatticeFileError::new("knots are missing: a B-spline lattice needs them")),
        };
        let basis = basis.map_err(|e| LatticeFileError::new(format!("along {axis}: {e}")))?;
        if file.basis == BasisName::Bernstein && !basis.is_bernstein() {
            let problem = "the knots are not those of a Bernstein basis: 0 and 1, degree + 1 times each";
            return Err(LatticeFileError::new(format!("along {axis}: {problem}")));
        }
        bases.push(basis);
    }
    let frame = Frame { origin: file.frame.origin, axes: file.frame.axes };
    let lattice = Lattice::new(bases.try_into().expect("three axes"), frame)
        .map_err(|e| LatticeFileError::new(format!("frame: {e}")))?;

    let size = lattice.size();
    let rest = match file.rest {
        Some(nested) => flat("rest", nested, size)?,
        None => lattice.rest(),
    };
    let posed = file.posed.map_or_else(|| Ok(rest.clone()), |nested| flat("posed", nested, size))?;
    let mobility = file.mobility.map(|nested| flat("mobility", nested, size)).transpose()?.map(|all| {
        let each = |m| match m {
            Mobility::All(m) => DVec3::splat(m),
            Mobility::Each(m) => m,
        };
        all.into_iter().map(each).collect::<Vec<_>>()
    });
    let lattice = PosedLattice { lattice, rest, posed, mobility };
    if let Some(i) = lattice.mobility.iter().flatten().position(|m| m.min_element() < 0.0) {
        let [i, j, k] = lattice.lattice.node(i);
        return Err(LatticeFileError::new(format!("mobility[{i}][{j}][{k}] is negative: 0 pins, 1 is free")));
    }
    Ok(lattice)
}

/// The lattice file of `posed`. Numbers have as many digits as bring them back bit for bit.
#[must_use]
pub fn lattice_to_json(posed: &PosedLattice) -> String {
    let lattice = &posed.lattice;
    let size = lattice.size();
    let is_bernstein = lattice.bases().iter().all(Basis::is_bernstein);
    let file = LatticeFile {
        kind: Kind::Lattice,
        version: VERSION,
        basis: if is_bernstein { BasisName::Bernstein } else { BasisName::Bspline },
        degree: [0, 1, 2].map(|a| lattice.bases()[a].degree()),
        knots: Some([0, 1, 2].map(|a| lattice.bases()[a].knots().to_vec())),
        frame: FrameEntry { origin: lattice.frame().origin, axes: lattice.frame().axes },
        rest: Some(nested(&posed.rest, size)),
        posed: Some(nested(&posed.posed, size)),
        mobility: posed
            .mobility
            .as_ref()
            .map(|all| nested(&all.iter().map(|m| Mobility::Each(*m)).collect::<Vec<_>>(), size)),
    };
    serde_json::to_string(&file).expect("finite numbers and fixed keys make JSON") + "\n"
}

/// Values at [i][j][k] as one list, if there is one for each control point.
fn flat<T>(key: &str, nested: Nested<T>, [nu, nv, nw]: [usize; 3]) -> Result<Vec<T>, LatticeFileError> {
    let expect = |place: String, found: usize, expected: usize| match found == expected {
        true => Ok(()),
        false => Err(LatticeFileError::new(format!("{key}{place} has {found} entries: the knots make it {expected}"))),
    };
    expect(String::new(), nested.len(), nu)?;
    let mut all = Vec::with_capacity(nu * nv * nw);
    for (i, plane) in nested.into_iter().enumerate() {
        expect(format!("[{i}]"), plane.len(), nv)?;
        for (j, line) in plane.into_iter().enumerate() {
            expect(format!("[{i}][{j}]"), line.len(), nw)?;
            all.extend(line);
        }
    }
    Ok(all)
}

fn nested<T: Copy>(flat: &[T], [_, nv, nw]: [usize; 3]) -> Nested<T> {
    flat.chunks(nv * nw).map(|plane| plane.chunks(nw).map(<[T]>::to_vec).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> PosedLattice {
        let bases = [Basis::clamped(5, 2).unwrap(), Basis::uniform(4, 3).unwrap(), Basis::bernstein(3).unwrap()];
        let frame =
            Frame { origin: DVec3::new(0.1, -2.0, 1e6), axes: [DVec3::X, DVec3::new(0.3, 2.0, 0.0), DVec3::Z / 3.0] };
        let lattice = Lattice::new(bases, frame).unwrap();
        let rest = lattice.rest();
        let posed = rest.iter().map(|p| *p * 1.1 + DVec3::splat(1.0 / 3.0)).collect();
        let mobility = (0..rest.len()).map(|i| DVec3::new(i as f64, 0.0, 1.0)).collect();
        PosedLattice { lattice, rest, posed, mobility: Some(mobility) }
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let lattice = lattice();
        assert_eq!(lattice_from_json(&lattice_to_json(&lattice)).unwrap(), lattice);
    }

    fn error(text: &str) -> String {
        lattice_from_json(text).unwrap_err().what
    }

    const FRAME: &str = r#""frame": {"origin": [0,0,0], "axes": [[1,0,0],[0,1,0],[0,0,1]]}"#;

    #[test]
    fn a_minimal_bernstein_lattice() {
        let text = format!(r#"{{"kind":"lattice","version":1,"basis":"bernstein","degree":[1,2,1],{FRAME}}}"#);
        let lattice = lattice_from_json(&text).unwrap();
        assert_eq!(lattice.lattice.size(), [2, 3, 2]);
        assert_eq!(lattice.posed[3], DVec3::new(0.0, 0.5, 1.0));
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let head = r#""kind":"lattice","version":1,"basis":"bernstein","degree":[1,1,1]"#;
        assert!(error(&format!("{{{head},{FRAME},\"rset\":[]}}")).contains("rset"));
        assert!(error(&format!("{{{head},{FRAME},\"posed\":[[[[0,0,0],[0,0,1]]]]}}")).contains("posed has 1 entries"));
        let flat = r#""frame": {"origin": [0,0,0], "axes": [[1,0,0],[0,1,0],[1,1,0]]}"#;
        assert!(error(&format!("{{{head},{flat}}}")).contains("flat"));
        let spline = head.replace("bernstein", "bspline");
        assert!(error(&format!("{{{spline},{FRAME}}}")).contains("knots are missing"));
        assert!(
            error(&format!("{{{},{FRAME}}}", head.replace("\"version\":1", "\"version\":2"))).contains("version is 2")
        );
        assert_eq!(lattice_from_json("{\n\"kind\": 3}").unwrap_err().line, Some(2));
        let mobility = "[[[1,1],[1,-1]],[[1,1],[1,[1,0,0.5]]]]";
        assert!(error(&format!("{{{head},{FRAME},\"mobility\":{mobility}}}")).contains("mobility[0][1][1]"));
    }
}
