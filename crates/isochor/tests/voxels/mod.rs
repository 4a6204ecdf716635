//! Meshes of unit cubes.

use std::collections::{BTreeSet, HashMap};

use glam::DVec3;
use isochor::{Faces, Mesh};

/// The surface of a set of unit cubes of the integer grid, squares wound outwards, one vertex at each place.
pub fn voxels(filled: &BTreeSet<[i32; 3]>) -> Mesh {
    let (mut vertices, mut points, mut faces) = (HashMap::new(), Vec::new(), Faces::new());
    for cell in filled {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut neighbour = *cell;
                neighbour[axis] += 2 * side - 1;
                if filled.contains(&neighbour) {
                    continue;
                }
                let mut square = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[b, c]| {
                    let mut corner = *cell;
                    (corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3]) =
                        (corner[axis] + side, corner[(axis + 1) % 3] + b, corner[(axis + 2) % 3] + c);
                    *vertices.entry(corner).or_insert_with(|| {
                        points.push(DVec3::from_array(corner.map(f64::from)));
                        points.len() as u32 - 1
                    })
                });
                if side == 0 {
                    square.reverse();
                }
                faces.push(&square);
            }
        }
    }
    Mesh::new(points, faces).unwrap()
}
