//! A surface's grid, flattened: what a model is laid on.

use glam::DVec2;

use crate::surface::Surface;

/// A surface sampled on a grid of cells, with the place of every grid point in the plane.
///
/// Grid point (i, j) stands at the parameters (s_i, t_j) and has the index `i · (cells[1] + 1) + j`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    surface: Surface,
    cells: [usize; 2],
    flat: Vec<DVec2>,
}

impl Sheet {
    /// The surface, `cells` along s and t with equidistant parameters, and the flattened grid points `flat`.
    ///
    /// # Panics
    ///
    /// Panics where there is no cell, or `flat` does not hold `(cells[0] + 1) · (cells[1] + 1)` points.
    #[must_use]
    pub fn new(surface: Surface, cells: [usize; 2], flat: Vec<DVec2>) -> Self {
        assert!(cells[0] > 0 && cells[1] > 0, "a sheet has cells");
        assert_eq!(flat.len(), (cells[0] + 1) * (cells[1] + 1), "one place for each grid point");
        Self { surface, cells, flat }
    }

    /// The surface.
    #[must_use]
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Cells along s and t.
    #[must_use]
    pub fn cells(&self) -> [usize; 2] {
        self.cells
    }

    /// Flattened places of the grid points, in the length unit of the surface.
    #[must_use]
    pub fn flat(&self) -> &[DVec2] {
        &self.flat
    }

    /// Parameters (s_i, t_j) of grid point (i, j).
    #[must_use]
    pub fn parameters(&self, i: usize, j: usize) -> DVec2 {
        DVec2::new(i as f64 / self.cells[0] as f64, j as f64 / self.cells[1] as f64)
    }
}
