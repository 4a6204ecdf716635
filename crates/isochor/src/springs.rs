//! Springs between the control points of a lattice: what it costs to deform an elastic solid. HML, section 3.4.
//!
//! ```text
//! E(C) = Σ_j k_j/2 (|c_e − c_s| − L_j)²                                                         (1)
//! ```
//!
//! over springs j between the nodes s and e, L_j the length at rest. Only distances count, so rigid motions cost nothing. With u the unit vector from s
//! to e and l the length, a spring pulls with `k (l − L) u` at s, and its second derivative is the block `K = k (u uᵀ + (1 − L/l)(1 − u uᵀ))`: K at
//! (s, s) and (e, e), −K at (s, e) and (e, s).
//!
//! # Changes versus the paper
//!
//! - (14) there lacks the square.
//! - The paper connects "14 neighboring nodes" and does not say which. There are two readings, [`Net::Fourteen`] and [`Net::FourteenKuhn`]; the first
//!   has modes beyond rigid motions that cost nothing to first order, the second is not symmetric. [`Net::TwentySix`] is rigid and symmetric.
//! - The stiffness may differ between edges, diagonals of faces, and diagonals of cells.

use glam::{DMat3, DVec3};

use crate::lattice::Lattice;

/// Which nodes of a lattice are connected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Deserialize, serde::Serialize))]
pub enum Net {
    /// All 26 neighbours: along edges, diagonals of faces, and diagonals of cells.
    #[default]
    #[cfg_attr(feature = "serde", serde(rename = "26"))]
    TwentySix,
    /// 14 neighbours: along edges and diagonals of cells. Not rigid to first order.
    #[cfg_attr(feature = "serde", serde(rename = "14"))]
    Fourteen,
    /// 14 neighbours: the edges of Kuhn's six tetrahedra in each cell. Not symmetric.
    #[cfg_attr(feature = "serde", serde(rename = "14-kuhn"))]
    FourteenKuhn,
}

impl Net {
    /// Its word in a job.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::TwentySix => "26",
            Self::Fourteen => "14",
            Self::FourteenKuhn => "14-kuhn",
        }
    }
}

/// Half of the steps to neighbours: the other half are their opposites.
const STEPS: [[isize; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, 0, 1],
    [0, 1, 1],
    [1, -1, 0],
    [1, 0, -1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [1, -1, -1],
];

impl Net {
    /// Whether nodes a step apart are connected.
    fn connects(self, step: [isize; 3]) -> bool {
        let class = Class::of(step);
        match self {
            Self::TwentySix => true,
            Self::Fourteen => class != Class::Face,
            Self::FourteenKuhn => step.iter().all(|s| *s >= 0),
        }
    }
}

/// What a spring is in the cells of the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Class {
    Edge,
    Face,
    Cell,
}

impl Class {
    fn of(step: [isize; 3]) -> Self {
        match step.iter().filter(|s| **s != 0).count() {
            1 => Self::Edge,
            2 => Self::Face,
            _ => Self::Cell,
        }
    }
}

/// k of the springs, energy per square of length. All 1 by default, as in the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// Along edges of cells.
    pub edge: f64,
    /// Along diagonals of faces of cells.
    pub face: f64,
    /// Along diagonals of cells.
    pub cell: f64,
}

impl Stiffness {
    /// The same for all springs.
    #[must_use]
    pub fn uniform(k: f64) -> Self {
        Self { edge: k, face: k, cell: k }
    }

    fn of(&self, class: Class) -> f64 {
        match class {
            Class::Edge => self.edge,
            Class::Face => self.face,
            Class::Cell => self.cell,
        }
    }
}

impl Default for Stiffness {
    fn default() -> Self {
        Self::uniform(1.0)
    }
}

/// Why there are no springs.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// A stiffness that is negative, infinite or not a number.
    #[error("the stiffness {0} of springs must be 0 or more, and finite")]
    Stiffness(f64),
    /// No spring that costs anything.
    #[error("all springs have the stiffness 0: nothing holds the lattice together")]
    Slack,
}

/// A spring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// The nodes at its ends, the smaller first: flat indices of control points, `(i · size[1] + j) · size[2] + k`.
    pub ends: [u32; 2],
    /// At rest.
    pub length: f64,
    /// k.
    pub stiffness: f64,
}

/// (1).
#[derive(Clone, Debug, PartialEq)]
pub struct Springs {
    springs: Vec<Spring>,
    nodes: usize,
}

impl Springs {
    /// Those of `net` between the control points of `lattice`, at rest where these are. Springs without stiffness are left out.
    ///
    /// # Errors
    ///
    /// A stiffness that is negative or not finite; none that is more than 0.
    pub fn of(lattice: &Lattice, net: Net, stiffness: Stiffness) -> Result<Self, SpringsError> {
        Self::between(lattice.size(), &lattice.rest(), net, stiffness)
    }

    /// The same between nodes that are at rest elsewhere: `size` of them along u, v, w, at `rest` (#nodes × 3).
    ///
    /// # Errors
    ///
    /// As [`Springs::of`].
    ///
    /// # Panics
    ///
    /// Panics where the number of places is not that of the nodes.
    pub fn between(size: [usize; 3], rest: &[DVec3], net: Net, stiffness: Stiffness) -> Result<Self, SpringsError> {
        assert_eq!(rest.len(), size.iter().product::<usize>(), "a place for each node");
        for k in [stiffness.edge, stiffness.face, stiffness.cell] {
            if !(k >= 0.0 && k.is_finite()) {
                return Err(SpringsError::Stiffness(k));
            }
        }
        let index = |[i, j, k]: [usize; 3]| (i * size[1] + j) * size[2] + k;
        let mut springs = Vec::new();
        for step in STEPS.into_iter().filter(|step| net.connects(*step)) {
            let k = stiffness.of(Class::of(step));
            if k == 0.0 {
                continue;
            }
            for a in 0..rest.len() {
                let from = [a / (size[1] * size[2]), a / size[2] % size[1], a % size[2]];
                let to = [0, 1, 2].map(|axis| from[axis].checked_add_signed(step[axis]).filter(|x| *x < size[axis]));
                let [Some(i), Some(j), Some(l)] = to else { continue };
                let b = index([i, j, l]);
                let ends = [a.min(b), a.max(b)].map(|end| end as u32); // at most lattice::MAX_CONTROLS
                springs.push(Spring { ends, length: rest[a].distance(rest[b]), stiffness: k });
            }
        }
        if springs.is_empty() { Err(SpringsError::Slack) } else { Ok(Self { springs, nodes: rest.len() }) }
    }

    /// Mean length at rest.
    #[must_use]
    pub fn mean_length(&self) -> f64 {
        self.springs.iter().map(|spring| spring.length).sum::<f64>() / self.springs.len() as f64
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.nodes
    }

    /// The largest force that stretches a spring by its own length: what forces are compared with.
    #[must_use]
    pub fn force(&self) -> f64 {
        self.springs.iter().map(|spring| spring.stiffness * spring.length).fold(0.0, f64::max)
    }

    /// All of them.
    #[must_use]
    pub fn springs(&self) -> &[Spring] {
        &self.springs
    }

    /// E with the nodes at `places` (#nodes × 3).
    ///
    /// # Panics
    ///
    /// Panics where the number of places is not that of the nodes.
    #[must_use]
    pub fn energy(&self, places: &[DVec3]) -> f64 {
        self.expect_all(places);
        let of = |spring: &Spring| {
            let stretch = spring.along(places).length() - spring.length;
            0.5 * spring.stiffness * stretch * stretch
        };
        self.springs.iter().map(of).sum()
    }

    /// ∂E/∂C (#nodes × 3) with the nodes at `places`. A spring whose ends are at one place has no direction to push in, and pushes nowhere.
    ///
    /// # Panics
    ///
    /// As [`Springs::energy`].
    #[must_use]
    pub fn gradient(&self, places: &[DVec3]) -> Vec<DVec3> {
        self.expect_all(places);
        let mut gradient = vec![DVec3::ZERO; self.nodes];
        for spring in &self.springs {
            let along = spring.along(places);
            let Some(unit) = along.try_normalize() else { continue };
            let pull = spring.stiffness * (along.length() - spring.length) * unit;
            let [s, e] = spring.ends.map(|end| end as usize);
            gradient[s] -= pull;
            gradient[e] += pull;
        }
        gradient
    }

    /// The block K of each spring with the nodes at `places`. One whose ends are at one place has none.
    ///
    /// # Panics
    ///
    /// As [`Springs::energy`].
    pub fn hessian(&self, places: &[DVec3]) -> impl Iterator<Item = (Spring, DMat3)> {
        self.blocks(places, f64::NEG_INFINITY)
    }

    /// The same without what is negative in K: across a compressed spring it is taken for 0.
    pub(crate) fn convex_hessian(&self, places: &[DVec3]) -> impl Iterator<Item = (Spring, DMat3)> {
        self.blocks(places, 0.0)
    }

    /// The blocks with `1 − L/l` at least `least`.
    fn blocks(&self, places: &[DVec3], least: f64) -> impl Iterator<Item = (Spring, DMat3)> {
        self.expect_all(places);
        self.springs.iter().filter_map(move |spring| {
            let along = spring.along(places);
            let unit = along.try_normalize()?;
            let parallel = DMat3::from_cols(unit * unit.x, unit * unit.y, unit * unit.z);
            let across = (1.0 - spring.length / along.length()).max(least) * (DMat3::IDENTITY - parallel);
            Some((*spring, spring.stiffness * (parallel + across)))
        })
    }

    fn expect_all(&self, places: &[DVec3]) {
        assert_eq!(places.len(), self.nodes, "a place for each node");
    }
}

impl Spring {
    /// From its first end to its second.
    fn along(&self, places: &[DVec3]) -> DVec3 {
        let [s, e] = self.ends.map(|end| places[end as usize]);
        e - s
    }
}
