//! A surface as a mesh, to look at.

use glam::DVec3;

use crate::mesh::{Faces, Mesh, MeshError};
use crate::parallel;
use crate::surface::Surface;

impl Surface {
    /// The surface cut into `cells` along s and t at equidistant parameters: quadrilaterals, counter-clockwise seen
    /// from the tips of the normals. A seam has its points once, so closed surfaces are closed meshes; a pole is one
    /// point, with triangles around it.
    ///
    /// # Errors
    ///
    /// Points beyond the range of numbers, on surfaces whose control points are.
    ///
    /// # Panics
    ///
    /// Panics where there is no cell along s or t, or there are more than `u32::MAX` grid points.
    pub fn mesh(&self, cells: [usize; 2]) -> Result<Mesh, MeshError> {
        let [m, n] = cells;
        assert!(m > 0 && n > 0, "a mesh of a surface has cells");
        let all =
            (m + 1).checked_mul(n + 1).filter(|all| u32::try_from(*all).is_ok()).expect("at most u32::MAX grid points");
        let ([closes_s, closes_t], [s0, s1, t0, t1]) = (self.closes(), self.poles());
        // The grid point that stands for (i, j).
        let stands_for = |i: usize, j: usize| {
            let i = if closes_s && i == m { 0 } else { i };
            let j = if closes_t && j == n { 0 } else { j };
            let at_s_pole = (s0 && i == 0) || (s1 && i == m);
            let at_t_pole = (t0 && j == 0) || (t1 && j == n);
            (if at_t_pole { 0 } else { i }) * (n + 1) + if at_s_pole { 0 } else { j }
        };
        let mut numbers = vec![u32::MAX; all];
        let mut places = Vec::new();
        for (k, number) in numbers.iter_mut().enumerate() {
            let (i, j) = (k / (n + 1), k % (n + 1));
            if stands_for(i, j) == k {
                *number = places.len() as u32;
                places.push((i as f64 / m as f64, j as f64 / n as f64));
            }
        }
        let points: Vec<DVec3> = parallel::collect(places.len(), |v| self.jet(places[v].0, places[v].1).point);
        let mut faces = Faces::with_capacity(m * n, 4 * m * n);
        for (i, j) in (0..m).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let mut corners =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| numbers[stands_for(i, j)]).to_vec();
            corners.dedup();
            if corners.len() > 1 && corners[0] == corners[corners.len() - 1] {
                corners.pop();
            }
            if corners.len() > 2 {
                faces.push(&corners);
            }
        }
        Mesh::new(points, faces)
    }
}
