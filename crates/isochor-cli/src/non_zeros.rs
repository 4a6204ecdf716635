//! Numbers other than 0 in the matrix B (#controls × #faces) that HB, section 6.2, stores: what table 1 of the paper counts.
//!
//! Entry (ijk, f) is `(B_ijk(u_l) + B_ijk(u_m) + B_ijk(u_n)) / 6` with the corners l, m, n of face f. B-splines are not negative, so it
//! differs from 0 where one of them does: on the union of three boxes of control points.

use isochor::{Binding, Faces};

/// First and last control point along u, v, w; `None` where there are none.
type Span = Option<[[usize; 2]; 3]>;

/// The count for triangles `faces` between vertices of a lattice with `size` control points along each side.
pub fn non_zeros(binding: &Binding, faces: &Faces, size: usize) -> usize {
    let node = |control: usize| [control / (size * size), control / size % size, control % size];
    let span = |v: usize| -> Span {
        let weights = binding.weights(v);
        let (first, last) = (node(weights.first()?.0), node(weights.last()?.0));
        Some([0, 1, 2].map(|a| [first[a], last[a]]))
    };
    let spans: Vec<Span> = (0..binding.vertex_count()).map(span).collect();
    let of_face = |face: &[u32]| {
        let [a, b, c] = [face[0], face[1], face[2]].map(|v| spans[v as usize]);
        let pairs = [common(a, b), common(b, c), common(c, a)];
        let once: usize = [a, b, c].map(count).iter().sum();
        once + count(common(pairs[0], c)) - pairs.map(count).iter().sum::<usize>()
    };
    faces.iter().map(of_face).sum()
}

fn common(a: Span, b: Span) -> Span {
    let (a, b) = (a?, b?);
    let both = [0, 1, 2].map(|k| [a[k][0].max(b[k][0]), a[k][1].min(b[k][1])]);
    both.iter().all(|[first, last]| first <= last).then_some(both)
}

fn count(span: Span) -> usize {
    span.map_or(0, |span| span.iter().map(|[first, last]| last - first + 1).product())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use isochor::{Basis, Frame, Lattice, Mesh, Outside, shapes};

    use super::*;

    fn bound(mesh: &Mesh, size: usize) -> Binding {
        let bases = [0; 3].map(|_| Basis::uniform(size, 3).unwrap());
        let frame = Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap();
        Lattice::new(bases, frame).unwrap().bind(mesh.points(), Outside::Keep).unwrap()
    }

    #[test]
    fn counts_are_those_of_the_matrix_written_out() {
        let mesh = shapes::stone(200);
        for size in [4, 6, 10] {
            let binding = bound(&mesh, size);
            let controls = |face: &[u32]| -> BTreeSet<usize> {
                face.iter().flat_map(|v| binding.weights(*v as usize)).map(|(control, _)| control).collect()
            };
            let expected: usize = mesh.faces().iter().map(|face| controls(face).len()).sum();
            assert_eq!(non_zeros(&binding, mesh.faces(), size), expected);
        }
    }

    /// An independent program counted the union for the paper's sphere in a tight box.
    #[test]
    fn counts_of_the_sphere_are_those_of_another_program() {
        let mesh = shapes::icosphere(4);
        for (size, expected) in [(10, 372_896), (6, 344_384)] {
            assert_eq!(non_zeros(&bound(&mesh, size), mesh.faces(), size), expected);
        }
    }

    #[test]
    fn no_faces_have_none() {
        let binding = bound(&shapes::stone(5), 4);
        assert_eq!(non_zeros(&binding, &Faces::new(), 4), 0);
    }
}
