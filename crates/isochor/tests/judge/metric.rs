//! Displacements along directions, in variables z in which their cost is |z|².

use glam::DVec3;
use isochor::Energy;

use super::dense::{backward, cholesky, forward};

/// Displacements of all controls along some directions.
pub struct Space {
    axes: Vec<Along>,
    controls: usize,
}

struct Along {
    direction: DVec3,
    /// The controls that can move, and √m of each.
    free: Vec<usize>,
    roots: Vec<f64>,
    /// L of the energy's part for them.
    factor: Option<Vec<Vec<f64>>>,
}

impl Space {
    pub fn along(directions: &[DVec3], mobility: &[DVec3], energy: Option<&Energy>) -> Self {
        let axis = |direction: &DVec3| {
            let direction = direction.normalize();
            // 1/m = Σ d²/m over the coordinates that it moves.
            let m = |by_coordinate: &DVec3| {
                let moved = (0..3).filter(|a| direction[*a] != 0.0);
                1.0 / moved.map(|a| direction[a].powi(2) / by_coordinate[a]).sum::<f64>()
            };
            let all: Vec<f64> = mobility.iter().map(m).collect();
            let free: Vec<usize> = (0..all.len()).filter(|c| all[*c] > 0.0).collect();
            let factor = energy.map(|energy| {
                let mut s = vec![vec![0.0; all.len()]; all.len()];
                for &(i, j, value) in energy.upper_triangle() {
                    (s[i][j], s[j][i]) = (value, value);
                }
                cholesky(&free.iter().map(|i| free.iter().map(|j| s[*i][*j]).collect()).collect::<Vec<_>>())
            });
            let roots = free.iter().map(|c| all[*c].sqrt()).collect();
            Along { direction, free, roots, factor }
        };
        Self { axes: directions.iter().map(axis).collect(), controls: mobility.len() }
    }

    /// One axis of it.
    pub fn axis_count(&self) -> usize {
        self.axes.len()
    }

    pub fn unknowns(&self) -> usize {
        self.axes.iter().map(|axis| axis.free.len()).sum()
    }

    /// √ of the largest mobility.
    pub fn largest_root(&self) -> f64 {
        self.axes.iter().flat_map(|axis| &axis.roots).copied().fold(0.0, f64::max)
    }

    /// Rᵀ g of a gradient (#controls × 3).
    pub fn pulled(&self, g: &[DVec3]) -> Vec<f64> {
        let along = |axis: &Along| axis.pulled(&g.iter().map(|g| g.dot(axis.direction)).collect::<Vec<_>>());
        self.axes.iter().flat_map(along).collect()
    }

    /// Rᵀ g of a gradient along axis `k` alone (#controls).
    pub fn pulled_along(&self, k: usize, g: &[f64]) -> Vec<f64> {
        let along = |(j, axis): (usize, &Along)| match j == k {
            true => axis.pulled(g),
            false => vec![0.0; axis.free.len()],
        };
        self.axes.iter().enumerate().flat_map(along).collect()
    }

    /// R z.
    pub fn displacement(&self, z: &[f64]) -> Vec<DVec3> {
        let mut delta = vec![DVec3::ZERO; self.controls];
        let mut z = z;
        for axis in &self.axes {
            let (part, rest) = z.split_at(axis.free.len());
            z = rest;
            let y = axis.factor.as_ref().map_or_else(|| part.to_vec(), |l| backward(l, part));
            for ((c, root), y) in axis.free.iter().zip(&axis.roots).zip(y) {
                delta[*c] += root * y * axis.direction;
            }
        }
        delta
    }

    /// z of a displacement, where the axes are x, y, z.
    pub fn coordinates_of(&self, delta: &[DVec3]) -> Vec<f64> {
        let along = |axis: &Along| {
            let y: Vec<f64> =
                axis.free.iter().zip(&axis.roots).map(|(c, root)| delta[*c].dot(axis.direction) / root).collect();
            match &axis.factor {
                None => y,
                Some(l) => (0..y.len()).map(|j| (j..y.len()).map(|i| l[i][j] * y[i]).sum()).collect(),
            }
        };
        self.axes.iter().flat_map(along).collect()
    }
}

impl Along {
    fn pulled(&self, g: &[f64]) -> Vec<f64> {
        let scaled: Vec<f64> = self.free.iter().zip(&self.roots).map(|(c, root)| g[*c] * root).collect();
        self.factor.as_ref().map_or_else(|| scaled.clone(), |l| forward(l, &scaled))
    }
}
