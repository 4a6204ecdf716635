//! Built-in solids by name: `shape:cube`, `shape:cube?n=64`, wherever a model can be named.
//!
//! Each has one number, n, how finely it is divided. A drive letter (`C:\…`) is no such name, for it is not `shape`.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use crate::mesh::Mesh;
use crate::shapes;

/// A built-in solid.
#[derive(Debug)]
pub struct BuiltIn {
    /// Its name, without `shape:`.
    pub name: &'static str,
    /// What it is.
    pub about: &'static str,
    /// What n counts.
    pub counts: &'static str,
    /// n unless given.
    pub usual: usize,
    /// What n can be. The upper end keeps a mesh below about four million vertices.
    pub range: RangeInclusive<usize>,
    mesh: fn(usize) -> Mesh,
}

impl BuiltIn {
    /// All of them, in the order of their names.
    pub const ALL: &'static [Self] = &[
        Self {
            name: "ball",
            about: "a sphere of radius 1, of triangles",
            counts: "times that the triangles of an icosahedron are divided into four",
            usual: 5,
            range: 0..=9,
            mesh: shapes::icosphere,
        },
        Self {
            name: "bottle",
            about: "a bottle without cavity",
            counts: "segments round it",
            usual: 96,
            range: 3..=1000,
            mesh: |n| shapes::bottle(n, n * 5 / 4),
        },
        Self {
            name: "box",
            about: "a box of 2 × 1 × 0.8 with bosses on its sides",
            counts: "quads along every edge",
            usual: 48,
            range: 5..=800,
            mesh: shapes::embossed_box,
        },
        Self {
            name: "chain",
            about: "five links that do not touch",
            counts: "sections round each link",
            usual: 72,
            range: 6..=1000,
            mesh: |n| shapes::chain(5, n, n / 2),
        },
        Self {
            name: "club",
            about: "a rounded club 6 long: a sphere in a lattice",
            counts: "triangles at least",
            usual: 16_384,
            range: 64..=8_000_000,
            mesh: shapes::club,
        },
        Self {
            name: "cube",
            about: "the unit cube",
            counts: "squares along every edge",
            usual: 32,
            range: 1..=800,
            mesh: shapes::cube,
        },
        Self {
            name: "cup",
            about: "a cup with a handle",
            counts: "quads along the sides of the handle's ends",
            usual: 4,
            range: 1..=64,
            mesh: shapes::cup,
        },
        Self {
            name: "cylinder",
            about: "a cylinder of radius 0.5 and height 2",
            counts: "segments round it, and along it",
            usual: 64,
            range: 3..=1500,
            mesh: |n| shapes::cylinder(0.5, 2.0, n, n),
        },
        Self {
            name: "dolphin",
            about: "a dolphin 3 long, with fin and flukes",
            counts: "segments round it",
            usual: 96,
            range: 3..=1000,
            mesh: shapes::dolphin,
        },
        Self {
            name: "ears",
            about: "a ball with two ears; vertex 3 is the tip of one",
            counts: "times that the triangles of an icosahedron are divided into four",
            usual: 5,
            range: 0..=9,
            mesh: shapes::eared_ball,
        },
        Self {
            name: "flask",
            about: "a bottle with a cavity and a wall 0.05 thick",
            counts: "segments round it",
            usual: 96,
            range: 3..=1000,
            mesh: |n| shapes::hollow_bottle(n, n * 5 / 4, 0.05),
        },
        Self {
            name: "plate",
            about: "a plate of 1 × 1 × 0.05",
            counts: "rectangles along and across",
            usual: 48,
            range: 1..=1000,
            mesh: |n| shapes::plate(glam::DVec3::new(1.0, 1.0, 0.05), [n; 2]),
        },
        Self {
            name: "ring",
            about: "a torus of radii 1 and 0.3",
            counts: "sections round it",
            usual: 96,
            range: 6..=2000,
            mesh: |n| shapes::uv_torus(1.0, 0.3, n, n / 2),
        },
        Self {
            name: "screwdriver",
            about: "a screwdriver with a fluted handle",
            counts: "segments round it",
            usual: 96,
            range: 3..=1000,
            mesh: shapes::screwdriver,
        },
        Self {
            name: "shell",
            about: "a hollow sphere of radii 1 and 0.8",
            counts: "times that the triangles of an icosahedron are divided into four",
            usual: 5,
            range: 0..=8,
            mesh: |n| shapes::hollow_sphere(n, 0.8),
        },
    ];
}

/// A built-in solid and how finely it is divided: what `shape:NAME?n=N` says.
#[derive(Clone, Copy, Debug)]
pub struct ShapeName {
    /// Which solid.
    pub shape: &'static BuiltIn,
    /// How finely, within [`BuiltIn::range`].
    pub n: usize,
}

/// Why a text that begins with `shape:` names no built-in solid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeNameError {
    /// There is none of this name.
    #[error("there is no built-in shape \"{name}\"")]
    Unknown {
        /// The name.
        name: String,
        /// The name of the most similar one there is.
        nearest: &'static str,
    },
    /// What follows the name is not `n=` and a number that is possible.
    #[error("\"{text}\" does not follow {name}: it takes n={} to n={}, the {counts}", .range.start(), .range.end())]
    Number {
        /// What follows the name and a question mark.
        text: String,
        /// The name.
        name: &'static str,
        /// What n counts.
        counts: &'static str,
        /// What n can be.
        range: RangeInclusive<usize>,
    },
}

impl ShapeName {
    /// What names of built-in solids begin with.
    pub const PREFIX: &'static str = "shape:";

    /// The solid.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        (self.shape.mesh)(self.n)
    }
}

impl FromStr for ShapeName {
    type Err = ShapeNameError;

    /// Reads `cube` or `cube?n=64`, with or without `shape:` before it.
    fn from_str(text: &str) -> Result<Self, ShapeNameError> {
        let text = text.strip_prefix(Self::PREFIX).unwrap_or(text);
        let (name, number) = text.split_once('?').map_or((text, None), |(name, number)| (name, Some(number)));
        let Some(shape) = BuiltIn::ALL.iter().find(|shape| shape.name == name) else {
            let likeness = |shape: &&BuiltIn| strsim::jaro_winkler(name, shape.name);
            let nearest =
                BuiltIn::ALL.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))).map_or("", |shape| shape.name);
            return Err(ShapeNameError::Unknown { name: name.into(), nearest });
        };
        let Some(number) = number else { return Ok(Self { shape, n: shape.usual }) };
        let n = number.strip_prefix("n=").and_then(|n| n.parse().ok()).filter(|n| shape.range.contains(n));
        let BuiltIn { name, counts, ref range, .. } = *shape;
        n.map(|n| Self { shape, n }).ok_or_else(|| ShapeNameError::Number {
            text: number.into(),
            name,
            counts,
            range: range.clone(),
        })
    }
}

impl fmt::Display for ShapeName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}{}?n={}", Self::PREFIX, self.shape.name, self.n)
    }
}
