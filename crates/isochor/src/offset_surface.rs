//! The outer surface at a distance from triangles: closed, embedded, and nowhere nearer than was asked.
//!
//! Let d(x) be the distance of x from the nearest of some triangles, however they are wound and whether or not they close. On a grid of step h, d is
//! interpolated linearly over tetrahedra, six for each cell, all round a diagonal (H. Freudenthal, *Simplizialzerlegungen von beschränkter Flachheit*,
//! 1942). The surface is where the interpolant is L (A. Doi, A. Koide, *An efficient method of triangulating equi-valued surfaces by using tetrahedral
//! cells*, 1991), between nodes outside and nodes that are not. Outside are nodes with d > L that hang together with the border of the grid along edges
//! of tetrahedra, so cavities have no surface. There is a vertex on each edge between the two kinds, strictly inside it, so the surface is two-manifold,
//! and since each tetrahedron holds its own piece it does not cross itself.
//!
//! *It keeps its distance.* Let x be in a tetrahedron with nodes v_i, q be the triangles' point nearest to x, and x = Σ λ_i v_i. Then
//! Σ λ_i d(v_i) ≤ Σ λ_i |v_i − q| ≤ √(|x − q|² + Σ λ_i |v_i − x|²) ≤ √(d(x)² + ¾ h²), because a cell's nodes lie on a sphere of radius h √3/2. Where the
//! interpolant is L, so d(x) ≥ √(L² − ¾ h²). With L = D + h that is D and more; what is more suffices to move vertices along their edges by [`SNAP`].

use glam::DVec3;
use rustc_hash::FxHashMap;

use crate::closest::closest_on_triangle;
use crate::parallel;

/// Vertices stay away from the ends of their edges by this fraction of them. Larger: the surface is less smooth, and 0.07 could bring it nearer than D;
/// smaller: slivers.
const SNAP: f64 = 0.05;

/// The grid on which the distance is sampled.
struct Grid {
    low: DVec3,
    step: f64,
    /// Nodes along the axes.
    size: [usize; 3],
}

/// The seven edges of the tetrahedra that leave a node upwards: to the other nodes of the cell above it.
const EDGES: [[usize; 3]; 7] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 1, 1]];

/// The tetrahedra of a cell: along the axes in the order of each permutation, from its lowest node to its highest. The flag: whether the permutation is even.
const TETRAHEDRA: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([0, 2, 1], false),
    ([2, 1, 0], false),
    ([1, 0, 2], false),
];

/// For each node p of a tetrahedron of positive volume the others, q, r, s, so that p, q, r, s has positive volume: they run counter-clockwise seen from
/// beyond them, and so do the edges from p to them.
const AROUND: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// The outer surface round `triangles`, nowhere nearer to them than `distance`, and at about `distance + step`: its vertices, and its triangles,
/// counter-clockwise seen from outside. `triangles` may be without area; there must be one.
pub(crate) fn offset_surface(triangles: &[[DVec3; 3]], distance: f64, step: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let level = distance + step;
    let low = triangles.as_flattened().iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = triangles.as_flattened().iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    // Beyond the level, and a node more.
    let margin = level + 2.0 * step;
    let size = ((high - low + 2.0 * margin) / step).ceil().to_array().map(|cells| cells as usize + 1);
    let grid = Grid { low: low - margin, step, size };
    let excess = grid.excess(triangles, level);
    let is_outside = grid.outside(&excess);
    grid.contour(&excess, &is_outside)
}

impl Grid {
    fn node(&self, at: [usize; 3]) -> usize {
        (at[2] * self.size[1] + at[1]) * self.size[0] + at[0]
    }

    fn place(&self, at: [usize; 3]) -> DVec3 {
        self.low + self.step * DVec3::from_array(at.map(|i| i as f64))
    }

    /// d − L at every node; infinity where that is more than the length of an edge.
    fn excess(&self, triangles: &[[DVec3; 3]], level: f64) -> Vec<f64> {
        let reach = level + 2.0 * self.step; // edges are shorter than 2 h
        let boxes: Vec<[DVec3; 2]> = triangles.iter().map(|[a, b, c]| [a.min(*b).min(*c), a.max(*b).max(*c)]).collect();
        let layer = |k: usize| {
            let [nx, ny, _] = self.size;
            let mut squared = vec![f64::INFINITY; nx * ny];
            let z = self.place([0, 0, k]).z;
            for (corners, [low, high]) in triangles.iter().zip(&boxes) {
                if z < low.z - reach || z > high.z + reach {
                    continue;
                }
                let first = ((*low - reach - self.low) / self.step).max(DVec3::ZERO);
                let last = (*high + reach - self.low) / self.step;
                for j in first.y as usize..=(last.y as usize).min(ny - 1) {
                    for i in first.x as usize..=(last.x as usize).min(nx - 1) {
                        let p = self.place([i, j, k]);
                        let least = &mut squared[j * nx + i];
                        // A box is looked at sooner than what is in it.
                        if p.distance_squared(p.clamp(*low, *high)) < *least {
                            let weights = closest_on_triangle(p, *corners);
                            let closest: DVec3 = weights.iter().zip(corners).map(|(w, c)| *w * *c).sum();
                            *least = least.min(p.distance_squared(closest));
                        }
                    }
                }
            }
            squared.into_iter().map(|s| if s > reach * reach { f64::INFINITY } else { s.sqrt() - level }).collect()
        };
        let layers: Vec<Vec<f64>> = parallel::map(self.size[2], layer);
        layers.concat()
    }

    /// Which nodes hang together with the border of the grid.
    fn outside(&self, excess: &[f64]) -> Vec<bool> {
        let mut is_outside = vec![false; excess.len()];
        is_outside[0] = true;
        let mut open = vec![[0; 3]];
        while let Some(at) = open.pop() {
            let up = |edge: [usize; 3]| {
                let to: [usize; 3] = std::array::from_fn(|axis| at[axis] + edge[axis]);
                (0..3).all(|axis| to[axis] < self.size[axis]).then_some(to)
            };
            let down = |edge: [usize; 3]| {
                let is_there = (0..3).all(|axis| at[axis] >= edge[axis]);
                is_there.then(|| std::array::from_fn(|axis| at[axis] - edge[axis]))
            };
            for to in EDGES.into_iter().flat_map(|edge| [up(edge), down(edge)]).flatten() {
                let node = self.node(to);
                if !is_outside[node] && excess[node] > 0.0 {
                    is_outside[node] = true;
                    open.push(to);
                }
            }
        }
        is_outside
    }

    /// The surface between nodes outside and others.
    fn contour(&self, excess: &[f64], is_outside: &[bool]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        let mut numbers: FxHashMap<[usize; 2], u32> = FxHashMap::default();
        let mut vertex = |inside: [usize; 3], outside: [usize; 3]| {
            let ends = [self.node(inside), self.node(outside)];
            *numbers.entry(ends).or_insert_with(|| {
                let [from, to] = ends.map(|node| excess[node]);
                let along = (from / (from - to)).clamp(SNAP, 1.0 - SNAP);
                points.push(self.place(inside).lerp(self.place(outside), along));
                points.len() as u32 - 1
            })
        };
        let [nx, ny, nz] = self.size.map(|n| n - 1);
        let cells = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
        for [i, j, k] in cells {
            let corner = |[x, y, z]: [usize; 3]| is_outside[self.node([i + x, j + y, k + z])];
            let first = corner([0; 3]);
            if EDGES.iter().all(|edge| corner(*edge) == first) {
                continue;
            }
            for (axes, is_even) in TETRAHEDRA {
                let mut nodes = [[i, j, k]; 4];
                for (n, axis) in axes.into_iter().enumerate() {
                    nodes[n + 1] = nodes[n];
                    nodes[n + 1][axis] += 1;
                }
                // Nodes of positive volume.
                if !is_even {
                    nodes.swap(2, 3);
                }
                let (outer, inner): (Vec<usize>, Vec<usize>) = (0..4).partition(|n| is_outside[self.node(nodes[*n])]);
                let mut at = |inside: usize, outside: usize| vertex(nodes[inside], nodes[outside]);
                match (&inner[..], &outer[..]) {
                    ([p], _) => {
                        let [q, r, s] = AROUND[*p];
                        triangles.push([at(*p, q), at(*p, r), at(*p, s)]);
                    }
                    (_, [p]) => {
                        let [q, r, s] = AROUND[*p];
                        triangles.push([at(q, *p), at(s, *p), at(r, *p)]);
                    }
                    ([p, q], _) => {
                        let [a, b, c] = AROUND[*p];
                        let [r, s] = if a == *q {
                            [b, c]
                        } else if b == *q {
                            [c, a]
                        } else {
                            [a, b]
                        };
                        let quad = [at(*p, s), at(*q, s), at(*q, r), at(*p, r)];
                        triangles.push([quad[0], quad[1], quad[2]]);
                        triangles.push([quad[0], quad[2], quad[3]]);
                    }
                    _ => {}
                }
            }
        }
        (points, triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Faces, Mesh, fan};
    use crate::shapes;
    use crate::topology::topology;
    use crate::volume::{OpenBoundaries, Solid};

    fn corners(mesh: &Mesh) -> Vec<[DVec3; 3]> {
        mesh.faces().iter().flat_map(fan).map(|t| t.map(|v| mesh.points()[v as usize])).collect()
    }

    /// How far the surface is from `corners`, least and most, its components, genus and volume.
    fn measured(corners: &[[DVec3; 3]], distance: f64, step: f64) -> ([f64; 2], usize, Option<i64>, f64) {
        let (points, triangles) = offset_surface(corners, distance, step);
        let mesh = Mesh::new(points, Faces::from(triangles)).unwrap();
        let topology = topology(&mesh);
        assert!(topology.is_closed() && topology.is_oriented() && topology.nonmanifold_vertices == 0);
        let volume = Solid::new(&mesh, &topology, OpenBoundaries::Refuse).unwrap().volume(mesh.points());
        // At vertices and in the middles of faces.
        let middles = mesh.faces().iter().map(|f| f.iter().map(|v| mesh.points()[*v as usize]).sum::<DVec3>() / 3.0);
        let places = middles.chain(mesh.points().iter().copied());
        let from = |p: DVec3, c: &[DVec3; 3]| {
            closest_on_triangle(p, *c).iter().zip(c).map(|(w, c)| *w * *c).sum::<DVec3>().distance(p)
        };
        let distances = places.map(|p| corners.iter().map(|c| from(p, c)).fold(f64::INFINITY, f64::min));
        let span = distances.fold([f64::INFINITY, 0.0], |[low, high], d| [low.min(d), f64::max(high, d)]);
        (span, topology.components, topology.genus(), volume)
    }

    #[test]
    fn round_a_point_it_is_a_ball() {
        let ([low, high], components, genus, volume) = measured(&[[DVec3::X; 3]], 1.0, 0.1);
        assert!(low >= 1.0 && high <= 1.12, "{low} {high}");
        assert_eq!((components, genus), (1, Some(0)));
        let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r * r * r;
        assert!((ball(1.08)..ball(1.12)).contains(&volume), "{volume}");
    }

    /// L = 3 h; beyond the surface of a shape at most, by the same argument for distances from below: √(L² + ¾ h²), and what vertices are moved.
    #[test]
    fn it_is_as_far_away_as_was_asked_and_cavities_are_filled() {
        let two = [
            shapes::cube(1),
            shapes::cube(1).with_points(shapes::cube(1).points().iter().map(|p| *p + 3.0).collect()).unwrap(),
        ];
        let two: Vec<_> = two.iter().flat_map(corners).collect();
        let cases = [
            ("torus", corners(&shapes::uv_torus(2.0, 0.5, 24, 16)), 0.2, 1, Some(1)),
            ("torus without a hole", corners(&shapes::uv_torus(2.0, 0.5, 24, 16)), 1.5, 1, Some(0)),
            ("two cubes", two, 0.2, 2, Some(0)),
            ("shell", corners(&shapes::hollow_sphere(2, 0.8)), 0.1, 1, Some(0)),
            ("triangle", vec![[DVec3::ZERO, DVec3::X, DVec3::Y]], 0.1, 1, Some(0)),
        ];
        for (name, corners, distance, components, genus) in cases {
            let step = distance / 2.0;
            let ([low, high], found, of_genus, volume) = measured(&corners, distance, step);
            assert!(low >= distance && high <= 1.2 * (distance + step), "{name}: {low} {high}");
            assert_eq!((found, volume > 0.0), (components, true), "{name}");
            if components == 1 {
                assert_eq!(of_genus, genus, "{name}");
            }
        }
    }
}
