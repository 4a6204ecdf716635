//! The model of the benches, and its pose.

use glam::DVec3;
use isochor::{Basis, Binding, Frame, Lattice, Mesh, OpenBoundaries, Outside, Solid, shapes, topology};

/// A stone in a lattice that fits it tightly.
pub struct Bound {
    pub mesh: Mesh,
    pub lattice: Lattice,
    pub binding: Binding,
    pub solid: Solid,
}

/// A stone of so many vertices in a lattice of this basis along each side.
pub fn bound(vertices: usize, basis: &Basis) -> Bound {
    let mesh = shapes::stone(vertices);
    let frame = Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap();
    let lattice = Lattice::new([0; 3].map(|_| basis.clone()), frame).unwrap();
    let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    Bound { mesh, lattice, binding, solid }
}

/// How far each control point goes in a twist of half a radian to either side, squashed to `squash` of its height.
pub fn twist(rest: &[DVec3], squash: f64) -> Vec<DVec3> {
    let moved = |c: &DVec3| {
        let (sin, cos) = (0.5 * c.z).sin_cos();
        DVec3::new(cos * c.x - sin * c.y, sin * c.x + cos * c.y, squash * c.z) - *c
    };
    rest.iter().map(moved).collect()
}
