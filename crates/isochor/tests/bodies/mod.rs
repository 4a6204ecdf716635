//! A posed model of three bodies: a blob with a cavity, and a smaller blob beside it.

use glam::DVec3;
use isochor::shapes::icosphere;
use isochor::{
    Basis, Binding, Faces, Frame, Lattice, Mesh, OpenBoundaries, Outside, PointTarget, Solid, Volumes, displaced,
    topology,
};

use crate::random::Random;

pub struct Bodies {
    pub solid: Solid,
    pub lattice: Lattice,
    pub binding: Binding,
    pub vertices: Vec<DVec3>,
    pub rest_volumes: Volumes,
}

/// Components: 0 the outer surface, 1 its cavity, 2 the blob beside it.
pub fn three_bodies() -> Mesh {
    let sphere = icosphere(2);
    let n = sphere.points().len() as u32;
    let bump = |p: DVec3| p * (1.0 + 0.15 * (3.0 * p.x + 1.0).sin());
    let outer = sphere.points().iter().map(|p| bump(*p));
    let inner = sphere.points().iter().map(|p| 0.6 * bump(*p) + DVec3::new(0.05, -0.1, 0.0));
    let beside = sphere.points().iter().map(|p| 0.5 * bump(-*p) * DVec3::new(-1.0, -1.0, -1.0) + DVec3::X * 1.9);
    let triangles: Vec<[u32; 3]> = sphere.faces().iter().map(|f| [f[0], f[1], f[2]]).collect();
    let faces = triangles
        .iter()
        .copied()
        .chain(triangles.iter().map(|[a, b, c]| [a + n, c + n, b + n]))
        .chain(triangles.iter().map(|t| t.map(|v| v + 2 * n)));
    let mut list = Faces::new();
    faces.for_each(|t| list.push(&t));
    Mesh::new(outer.chain(inner).chain(beside).collect(), list).unwrap()
}

impl Bodies {
    /// A lattice of `size`, its controls moved at random by up to `amplitude`.
    pub fn new(random: &mut Random, size: [usize; 3], amplitude: f64) -> Self {
        let mesh = three_bodies();
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let bases = size.map(|n| Basis::clamped(n, 3.min(n - 1)).unwrap());
        let lattice = Lattice::new(bases, Frame::fitted(mesh.bounds().unwrap(), 0.05).unwrap()).unwrap();
        let binding = lattice.bind(mesh.points(), Outside::Refuse).unwrap();
        let displacement: Vec<DVec3> = (0..binding.control_count()).map(|_| amplitude * random.vector()).collect();
        let vertices = displaced(mesh.points(), &binding.apply(&displacement));
        Self { rest_volumes: solid.volumes(mesh.points()), solid, lattice, binding, vertices }
    }

    pub fn controls(&self) -> usize {
        self.binding.control_count()
    }

    /// Vertex `v` is to move by `by`.
    pub fn point(&self, v: usize, by: DVec3) -> PointTarget {
        let position = self.vertices[v];
        PointTarget { weights: self.binding.weights(v), position, target: position + by }
    }

    /// Mobilities in [0.2, 2], a part of them 0.
    pub fn mobility(&self, random: &mut Random, pinned: f64) -> Vec<DVec3> {
        let mut one = || if random.within(0.0, 1.0) < pinned { 0.0 } else { random.within(0.2, 2.0) };
        (0..self.controls()).map(|_| DVec3::new(one(), one(), one())).collect()
    }
}
