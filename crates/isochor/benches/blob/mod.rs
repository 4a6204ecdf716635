//! The model of the benches: a closed blob of 436 812 vertices and 873 620 faces inside the unit cube, and its pose.

use glam::DVec3;
use isochor::{Faces, Mesh};

/// Vertices along an edge of the icosahedron whose faces are split: 10 f² + 2 vertices in all.
const FREQUENCY: usize = 209;

/// Corners and faces of the icosahedron.
fn icosahedron() -> ([DVec3; 12], [[usize; 3]; 20]) {
    let t = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, t, 0.0],
        [1.0, t, 0.0],
        [-1.0, -t, 0.0],
        [1.0, -t, 0.0],
        [0.0, -1.0, t],
        [0.0, 1.0, t],
        [0.0, -1.0, -t],
        [0.0, 1.0, -t],
        [t, 0.0, -1.0],
        [t, 0.0, 1.0],
        [-t, 0.0, -1.0],
        [-t, 0.0, 1.0],
    ];
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    (corners.map(DVec3::from_array), faces)
}

/// A geodesic sphere with bumps, inside the unit cube. Vertices in ascending order of their places on the sphere.
pub fn blob() -> Mesh {
    let f = FREQUENCY;
    let (corners, icosahedron) = icosahedron();
    let key = |p: DVec3| p.to_array().map(|x| (x * 1e7).round() as i64);
    let mut sphere: Vec<([i64; 3], DVec3)> = Vec::new();
    let mut corner_keys: Vec<[[i64; 3]; 3]> = Vec::new();
    for [a, b, c] in icosahedron.map(|face| face.map(|v| corners[v])) {
        let at = |i: usize, j: usize| (a * (f - i - j) as f64 + b * i as f64 + c * j as f64).normalize();
        for i in 0..=f {
            sphere.extend((0..=f - i).map(|j| (key(at(i, j)), at(i, j))));
        }
        for i in 0..f {
            for j in 0..f - i {
                corner_keys.push([at(i, j), at(i + 1, j), at(i, j + 1)].map(key));
                if i + j + 1 < f {
                    corner_keys.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)].map(key));
                }
            }
        }
    }
    sphere.sort_by_key(|(key, _)| *key);
    sphere.dedup_by_key(|(key, _)| *key);
    let index = |key: [i64; 3]| sphere.partition_point(|(k, _)| *k < key) as u32;
    let faces: Faces = corner_keys.iter().map(|corners| corners.map(index)).collect::<Vec<_>>().iter().collect();
    let radius = |n: DVec3| 1.0 + 0.25 * (3.0 * n.x).sin() * (2.0 * n.y).cos() + 0.15 * (4.0 * n.z + 1.0).sin();
    let points: Vec<DVec3> = sphere.iter().map(|(_, n)| *n * radius(*n)).collect();
    let bounds = isochor::Bounds::of(&points).unwrap();
    let scale = 0.96 / bounds.extent();
    let points: Vec<DVec3> = points.iter().map(|p| (*p - bounds.center()) * scale + 0.5).collect();
    assert_eq!((points.len(), faces.len()), (10 * f * f + 2, 20 * f * f));
    Mesh::new(points, faces).unwrap()
}

/// How far each control point of a lattice of the unit cube goes in a twist of half a radian to either side, squashed to `squash` of its height.
pub fn twist(rest: &[DVec3], squash: f64) -> Vec<DVec3> {
    let moved = |c: &DVec3| {
        let from_middle = *c - 0.5;
        let (sin, cos) = (0.9 * from_middle.z).sin_cos();
        DVec3::new(
            cos * from_middle.x - sin * from_middle.y,
            sin * from_middle.x + cos * from_middle.y,
            squash * from_middle.z,
        ) - from_middle
    };
    rest.iter().map(moved).collect()
}
