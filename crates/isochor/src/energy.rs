//! What a correction keeps small, other than the squared displacement of the controls: HB, section 3, remark 1.
//!
//! An energy is `yᵀ S y` for each coordinate of the control displacement, `y = δ/√m`, with a sparse symmetric matrix S (#controls ×
//! #controls):
//!
//! - *surface*: `S = Wᵀ W`, the squared distances of the mesh's vertices before and after the correction;
//! - *edges*: `Σ |δ_a − δ_b|²/ℓ²` over the lattice's edges (a, b) of rest length ℓ;
//! - *bending*: `Σ |δ″|²`, second differences of δ along and across the axes of the lattice: the linearised thin plate.
//!
//! # Changes versus the paper
//!
//! - The paper names these functionals and leaves them, as they take a linear system to solve; here it is factorised once.
//! - Displacements that an energy does not feel (translations, for edges; affine maps, for bending) would be free of charge and the
//!   smallest not unique. So each S is scaled to a mean diagonal of 1, and [`tolerances::ENERGY_FLOOR`] (surface: [`tolerances::SURFACE_FLOOR`]) times the
//!   identity is added.

use glam::DVec3;

use crate::binding::Binding;
use crate::cage::Cage;
use crate::correct::CorrectError;
use crate::lattice::Lattice;
use crate::tolerances;

/// Entries at most, those that are 0 or stand twice included. More: gigabytes; fewer: 50³ control points must do.
const MOST_ENTRIES: usize = 1 << 26;

/// A quadratic form of the control displacement, the same for each coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Energy {
    controls: usize,
    /// Entries (i, j, value) with i ≤ j, sorted by j, then i, none twice.
    upper: Vec<(usize, usize, f64)>,
}

impl Energy {
    /// The squared distances of the vertices of `binding` before and after.
    ///
    /// # Errors
    ///
    /// [`CorrectError::Energy`] where the matrix is too large. In Bernstein lattices every control is coupled with every other.
    pub fn surface(binding: &Binding) -> Result<Self, CorrectError> {
        let controls = binding.control_count();
        checked(controls, binding.gram_len())?;
        Ok(Self::scaled(controls, binding.gram(), tolerances::SURFACE_FLOOR))
    }

    /// The squared changes of the lattice's edge vectors, relative to their rest lengths.
    ///
    /// # Errors
    ///
    /// [`CorrectError::Energy`] where the matrix is too large.
    pub fn edges(lattice: &Lattice) -> Result<Self, CorrectError> {
        /// Of three edges at a control, three each.
        const ENTRIES: usize = 9;
        let controls = lattice.control_count();
        checked(controls, controls.checked_mul(ENTRIES))?;
        let (rest, extent) = (lattice.rest(), lattice.frame().extent());
        let mut terms = Terms::default();
        for (a, node) in rest.iter().enumerate() {
            for axis in 0..3 {
                if let Some(b) = neighbour(lattice, a, axis, 1) {
                    terms.add(&[a, b], &[1.0, -1.0], (extent / node.distance(rest[b])).powi(2));
                }
            }
        }
        Ok(Self::scaled(rest.len(), terms.entries, tolerances::ENERGY_FLOOR))
    }

    /// The squared changes of a cage's edges, each relative to its length, in the same way.
    ///
    /// # Errors
    ///
    /// [`CorrectError::Energy`] where the matrix is too large.
    pub fn of_cage(cage: &Cage) -> Result<Self, CorrectError> {
        /// Of an edge.
        const ENTRIES: usize = 3;
        let (rest, controls) = (cage.vertices(), cage.vertices().len());
        checked(controls, cage.edges().len().checked_mul(ENTRIES))?;
        let mut terms = Terms::default();
        for [a, b] in cage.edges().iter().map(|edge| edge.map(|v| v as usize)) {
            terms.add(&[a, b], &[1.0, -1.0], (cage.extent() / rest[a].distance(rest[b])).powi(2));
        }
        Ok(Self::scaled(controls, terms.entries, tolerances::ENERGY_FLOOR))
    }

    /// The squared second differences of the displacement.
    ///
    /// # Errors
    ///
    /// [`CorrectError::Energy`] where the matrix is too large.
    pub fn bending(lattice: &Lattice) -> Result<Self, CorrectError> {
        /// Of three differences along and three across at a control, six and ten each.
        const ENTRIES: usize = 48;
        let controls = lattice.control_count();
        checked(controls, controls.checked_mul(ENTRIES))?;
        let rest = lattice.rest();
        // In extents of the lattice: fourth powers of lengths leave the range of numbers.
        let extent = lattice.frame().extent();
        let length = |a: usize, b: usize| rest[a].distance(rest[b]) / extent;
        let mut terms = Terms::default();
        for a in 0..rest.len() {
            for axis in 0..3 {
                let next = neighbour(lattice, a, axis, 1);
                if let (Some(b), Some(c)) = (next, neighbour(lattice, a, axis, 2)) {
                    let (low, high) = (length(a, b), length(b, c));
                    let (first, last) = (2.0 / (low * (low + high)), 2.0 / (high * (low + high)));
                    terms.add(&[a, b, c], &[first, -first - last, last], 1.0);
                }
                let across = (axis + 1) % 3;
                if let (Some(b), Some(c)) = (next, neighbour(lattice, a, across, 1)) {
                    let d = neighbour(lattice, b, across, 1).expect("the fourth corner of a face of the lattice");
                    let scale = 1.0 / (length(a, b) * length(a, c));
                    // The mixed derivative counts twice in |δ″|².
                    terms.add(&[a, b, c, d], &[scale, -scale, -scale, scale], 2.0);
                }
            }
        }
        Ok(Self::scaled(rest.len(), terms.entries, tolerances::ENERGY_FLOOR))
    }

    /// Number of controls that it is for.
    #[must_use]
    pub fn control_count(&self) -> usize {
        self.controls
    }

    /// S with the floor: entries (i, j, value) with i ≤ j, sorted by j, then i.
    #[must_use]
    pub fn upper_triangle(&self) -> &[(usize, usize, f64)] {
        &self.upper
    }

    /// `Σ_coordinates yᵀ S y` of y (#controls × 3).
    ///
    /// # Panics
    ///
    /// Panics where `y` does not have one entry per control.
    #[must_use]
    pub fn of(&self, y: &[DVec3]) -> f64 {
        assert_eq!(y.len(), self.controls, "one entry for each control");
        self.upper.iter().map(|&(i, j, s)| if i == j { s } else { 2.0 * s } * y[i].dot(y[j])).sum()
    }

    fn scaled(controls: usize, mut entries: Vec<(usize, usize, f64)>, floor: f64) -> Self {
        entries.retain(|(i, j, _)| i <= j);
        entries.sort_by_key(|&(i, j, _)| (j, i)); // stable: equal entries are summed in the order in which they came
        entries.dedup_by(|next, sum| {
            let is_same = (next.0, next.1) == (sum.0, sum.1);
            sum.2 += if is_same { next.2 } else { 0.0 };
            is_same
        });
        let trace: f64 = entries.iter().filter(|(i, j, _)| i == j).map(|e| e.2).sum();
        let scale = if trace > 0.0 { controls as f64 / trace } else { 0.0 };
        let mut upper = Vec::with_capacity(entries.len() + controls);
        let mut entries = entries.into_iter().peekable();
        for j in 0..controls {
            let mut diagonal = floor;
            while let Some((i, _, value)) = entries.next_if(|entry| entry.1 == j) {
                if i == j {
                    diagonal += scale * value;
                } else {
                    upper.push((i, j, scale * value));
                }
            }
            upper.push((j, j, diagonal));
        }
        Self { controls, upper }
    }
}

/// Whether a matrix for so many controls has few enough entries.
fn checked(controls: usize, entries: Option<usize>) -> Result<(), CorrectError> {
    match entries {
        Some(entries) if entries <= MOST_ENTRIES => Ok(()),
        _ => Err(CorrectError::Energy { controls }),
    }
}

/// The control `steps` further along `axis`, where there is one.
fn neighbour(lattice: &Lattice, control: usize, axis: usize, steps: usize) -> Option<usize> {
    let mut node = lattice.node(control);
    node[axis] += steps;
    (node[axis] < lattice.size()[axis]).then(|| lattice.index(node))
}

/// A sum of squares of linear forms.
#[derive(Default)]
struct Terms {
    entries: Vec<(usize, usize, f64)>,
}

impl Terms {
    /// Adds `weight · (Σ coefficients · y[controls])²`.
    fn add(&mut self, controls: &[usize], coefficients: &[f64], weight: f64) {
        for (&i, a) in controls.iter().zip(coefficients) {
            for (&j, b) in controls.iter().zip(coefficients) {
                if i <= j {
                    self.entries.push((i, j, weight * a * b));
                }
            }
        }
    }
}
