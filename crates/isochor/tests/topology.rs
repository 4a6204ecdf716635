//! Counts on small meshes whose topology is known by hand.

mod voxels;

use std::collections::BTreeSet;

use glam::DVec3;
use isochor::shapes::{cube, cylinder, hollow_sphere, uv_torus};
use isochor::{Faces, Mesh, Topology, UnbalancedEdge, topology};
use proptest::prelude::*;
use voxels::voxels;

fn mesh<const K: usize>(points: &[[f64; 3]], faces: &[[u32; K]]) -> Mesh {
    Mesh::new(points.iter().map(|p| DVec3::from_array(*p)).collect(), faces.iter().collect()).unwrap()
}

fn with_faces(mesh: &Mesh, faces: impl IntoIterator<Item = Vec<u32>>) -> Mesh {
    let mut all = Faces::new();
    faces.into_iter().for_each(|face| all.push(&face));
    Mesh::new(mesh.points().to_vec(), all).unwrap()
}

fn faces(mesh: &Mesh) -> Vec<Vec<u32>> {
    mesh.faces().iter().map(<[u32]>::to_vec).collect()
}

const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// What closed, oriented, two-manifold meshes have in common.
fn assert_manifold(t: &Topology, components: usize, genus: i64) {
    assert!(t.is_closed() && t.is_oriented() && t.is_balanced());
    assert_eq!((t.boundary_edges, t.boundary_loops, t.nonmanifold_edges, t.nonmanifold_vertices), (0, 0, 0, 0));
    assert_eq!((t.inconsistent_edges, t.unbalanced.len()), (0, 0));
    assert_eq!((t.components, t.genus()), (components, Some(genus)));
    assert_eq!(t.euler_characteristic, 2 * (components as i64 - genus));
}

// Closed meshes

#[test]
fn a_tetrahedron_is_a_closed_surface_of_genus_0() {
    let t = topology(&mesh(&CORNERS, &TETRAHEDRON));
    assert_manifold(&t, 1, 0);
    assert_eq!((t.coincident_vertices, t.unused_vertices, t.collapsed_faces), (0, 0, 0));
    assert_eq!((t.welded, t.component_of_face), (vec![0, 1, 2, 3], vec![0; 4]));
}

#[test]
fn handles_are_counted() {
    // A plate of 5 × 3 cells with one, two holes.
    let plate = |holes: &[[i32; 2]]| {
        let cells = (0..15).map(|c| [c / 3, c % 3]).filter(|cell| !holes.contains(cell));
        voxels(&cells.map(|[x, y]| [x, y, 0]).collect())
    };
    assert_manifold(&topology(&plate(&[])), 1, 0);
    assert_manifold(&topology(&plate(&[[1, 1]])), 1, 1);
    assert_manifold(&topology(&plate(&[[1, 1], [3, 1]])), 1, 2);
    assert_manifold(&topology(&uv_torus(2.0, 0.5, 5, 4)), 1, 1);
}

#[test]
fn shells_and_separate_bodies_are_components() {
    assert_manifold(&topology(&hollow_sphere(1, 0.5)), 2, 0);
    let t = topology(&voxels(&BTreeSet::from([[0, 0, 0], [5, 0, 0], [0, 5, 0]])));
    assert_manifold(&t, 3, 0);
    // 3³ cells without the middle one have an inner shell.
    let shell = (0..27).filter(|c| *c != 13).map(|c| [c / 9, c / 3 % 3, c % 3]).collect();
    assert_manifold(&topology(&voxels(&shell)), 2, 0);
}

#[test]
fn components_are_numbered_by_their_first_face_and_collapsed_faces_have_none() {
    let far = |p: [f64; 3]| [p[0] + 5.0, p[1], p[2]];
    let points: Vec<[f64; 3]> = CORNERS.iter().map(|p| far(*p)).chain(CORNERS).collect();
    let [a, b] = [4, 0].map(|by: u32| TETRAHEDRON.map(|t| t.map(|v| v + by)));
    let t = topology(&mesh(&points, &[a[0], b[0], [1, 1, 2], b[1], a[1], a[2], a[3], b[2], b[3]]));
    assert_eq!(t.component_of_face, [0, 1, u32::MAX, 1, 0, 0, 0, 1, 1]);
    assert_eq!((t.components, t.collapsed_faces), (2, 1));
}

#[test]
fn a_triangle_and_its_back_are_closed() {
    // V − E + F = 3 − 3 + 2
    assert_manifold(&topology(&mesh(&CORNERS, &[[0, 1, 2], [0, 2, 1]])), 1, 0);
}

#[test]
fn an_inward_mesh_is_as_oriented_as_an_outward_one() {
    let cube = cube(2);
    let reversed = faces(&cube).into_iter().map(|mut face| {
        face.reverse();
        face
    });
    assert_manifold(&topology(&with_faces(&cube, reversed)), 1, 0);
}

// Open meshes

#[test]
fn a_triangle_is_open_along_its_three_edges() {
    let t = topology(&mesh(&CORNERS, &[[0, 1, 2]]));
    assert_eq!((t.boundary_edges, t.boundary_loops, t.components, t.unused_vertices), (3, 1, 1, 1));
    assert_eq!((t.euler_characteristic, t.genus(), t.nonmanifold_vertices), (1, None, 0));
    assert!(!t.is_closed() && t.is_oriented() && !t.is_balanced());
    let edge = |from, to| UnbalancedEdge { from, to, surplus: 1, face: 0 };
    assert_eq!(t.unbalanced, [edge(0, 1), edge(2, 0), edge(1, 2)]);
}

#[test]
fn a_cube_without_one_side_has_one_loop_of_four_edges() {
    let cube = cube(1);
    for side in 0..6 {
        let open = faces(&cube).into_iter().enumerate().filter(|(f, _)| *f != side).map(|(_, face)| face);
        let t = topology(&with_faces(&cube, open));
        assert_eq!((t.boundary_edges, t.boundary_loops, t.euler_characteristic, t.genus()), (4, 1, 1, None));
        assert_eq!((t.unbalanced.len(), t.nonmanifold_vertices), (4, 0));
        // The open side's edges run the other way round in its neighbours.
        let gap = cube.faces().face(side);
        for edge in &t.unbalanced {
            assert!((0..4).any(|c| (gap[(c + 1) % 4], gap[c]) == (edge.from, edge.to)));
            assert_eq!(edge.surplus, 1);
        }
    }
}

#[test]
fn a_tube_has_two_loops() {
    let tube = cylinder(1.0, 1.0, 5, 2);
    let t = topology(&with_faces(&tube, faces(&tube).into_iter().filter(|face| face.len() == 4)));
    assert_eq!((t.boundary_edges, t.boundary_loops, t.euler_characteristic), (10, 2, 0));
    assert_eq!(t.unused_vertices, 2);
}

#[test]
fn loops_that_touch_at_a_vertex_hang_together() {
    // 3--4--5   Two squares of a sheet of four are missing, corner to corner:
    // |##|  |   the rim runs through the middle vertex twice.
    // 6--7--8
    // |  |##|
    // 0--1--2
    let points: Vec<[f64; 3]> = [[0, 0], [1, 0], [2, 0], [0, 2], [1, 2], [2, 2], [0, 1], [1, 1], [2, 1]]
        .map(|[x, y]| [f64::from(x), f64::from(y), 0.0])
        .to_vec();
    let t = topology(&mesh(&points, &[[6, 7, 4, 3], [1, 2, 8, 7]]));
    assert_eq!((t.boundary_edges, t.boundary_loops, t.components), (8, 1, 2));
    // Its faces form two fans.
    assert_eq!((t.nonmanifold_vertices, t.euler_characteristic), (1, 1));
}

#[test]
fn a_t_junction_is_open() {
    // A square of one triangle below the diagonal and two above it that meet in its middle.
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]];
    let t = topology(&mesh(&points, &[[0, 1, 2], [0, 4, 3], [4, 2, 3]]));
    // Eight edges, of which only 3–4 has two faces: 0–2 is not the same as 0–4 and 4–2.
    assert_eq!((t.boundary_edges, t.boundary_loops, t.components), (7, 1, 2));
}

#[test]
fn a_mobius_strip_has_one_loop_and_no_orientation() {
    // 0--2--4--6--8--1
    // |  |  |  |  |  |
    // 1--3--5--7--9--0
    let points: Vec<[f64; 3]> = (0..10).map(|v| [f64::from(v), f64::from(v * v), 0.0]).collect();
    let t = topology(&mesh(&points, &[[1, 3, 2, 0], [3, 5, 4, 2], [5, 7, 6, 4], [7, 9, 8, 6], [9, 0, 1, 8]]));
    assert_eq!((t.boundary_edges, t.boundary_loops, t.euler_characteristic), (10, 1, 0));
    assert_eq!((t.inconsistent_edges, t.nonmanifold_vertices, t.components), (1, 0, 1));
    assert!(!t.is_oriented() && t.genus().is_none());
    let seam: Vec<_> =
        t.unbalanced.iter().filter(|e| e.surplus == 2).map(|e| (e.from.min(e.to), e.from.max(e.to))).collect();
    assert_eq!(seam, [(0, 1)]);
}

// Winding

#[test]
fn a_flipped_side_is_inconsistent_with_its_four_neighbours() {
    let cube = cube(1);
    let mut flipped = faces(&cube);
    flipped[2].reverse();
    let t = topology(&with_faces(&cube, flipped));
    assert!(t.is_closed() && !t.is_oriented() && !t.is_balanced());
    assert_eq!((t.inconsistent_edges, t.unbalanced.len(), t.genus()), (4, 4, None));
    assert!(t.unbalanced.iter().all(|e| e.surplus == 2));
    assert_eq!((t.nonmanifold_vertices, t.euler_characteristic), (0, 2));
}

#[test]
fn a_klein_bottle_is_closed_and_has_no_orientation() {
    // A grid of 4 × 5 squares; the seam of its second direction runs backwards.
    let (nu, nv) = (4, 5);
    let points: Vec<[f64; 3]> = (0..nu * nv).map(|c| [f64::from(c), f64::from(c * c), 1.0]).collect();
    let corner = |u: i32, v: i32| (if u < nu { u * nv + v % nv } else { nv - 1 - v % nv }) as u32;
    let squares: Vec<[u32; 4]> = (0..nu * nv)
        .map(|c| (c / nv, c % nv))
        .map(|(u, v)| [corner(u, v), corner(u + 1, v), corner(u + 1, v + 1), corner(u, v + 1)])
        .collect();
    let t = topology(&mesh(&points, &squares));
    assert!(t.is_closed() && !t.is_oriented() && !t.is_balanced());
    assert_eq!((t.inconsistent_edges, t.euler_characteristic, t.components, t.genus()), (nv as usize, 0, 1, None));
    assert_eq!(t.nonmanifold_vertices, 0);
}

// What is not two-manifold

#[test]
fn a_fin_makes_an_edge_with_three_faces() {
    let points: Vec<[f64; 3]> = CORNERS.into_iter().chain([[2.0, -1.0, 0.0]]).collect();
    let t = topology(&mesh(&points, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [0, 1, 4]]));
    assert_eq!((t.nonmanifold_edges, t.boundary_edges, t.boundary_loops, t.components), (1, 2, 1, 1));
    assert!(!t.is_closed() && t.is_oriented() && !t.is_balanced());
    // The shared edge is run once more from 0 to 1, first by face 1; the fin's other edges once each.
    let edge = |from, to, face| UnbalancedEdge { from, to, surplus: 1, face };
    assert_eq!(t.unbalanced, [edge(0, 1, 1), edge(4, 0, 4), edge(1, 4, 4)]);
}

#[test]
fn a_face_that_is_there_twice_makes_edges_with_three_faces() {
    let t = topology(&mesh(&CORNERS, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [1, 2, 3]]));
    assert_eq!((t.nonmanifold_edges, t.boundary_edges, t.unbalanced.len()), (3, 0, 3));
    assert!(t.unbalanced.iter().all(|e| e.surplus == 1 && e.face == 3));
    assert_eq!(t.genus(), None);
}

#[test]
fn cubes_that_share_an_edge_have_an_edge_with_four_faces_and_are_balanced() {
    let t = topology(&voxels(&BTreeSet::from([[0, 0, 0], [1, 1, 0]])));
    assert_eq!((t.nonmanifold_edges, t.boundary_edges, t.components, t.inconsistent_edges), (1, 0, 1, 0));
    assert!(!t.is_closed() && t.is_oriented() && t.is_balanced());
    // V − E + F = 14 − 23 + 12
    assert_eq!((t.euler_characteristic, t.genus()), (3, None));
}

#[test]
fn a_bow_tie_is_two_components_with_one_vertex_of_two_fans_and_no_genus() {
    let points: Vec<[f64; 3]> =
        CORNERS.into_iter().chain([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]).collect();
    let other = TETRAHEDRON.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 }));
    let t = topology(&mesh(&points, &[TETRAHEDRON, other].concat()));
    assert_eq!((t.components, t.nonmanifold_vertices, t.nonmanifold_edges), (2, 1, 0));
    assert!(t.is_closed() && t.is_balanced());
    // V − E + F = 7 − 12 + 8
    assert_eq!((t.euler_characteristic, t.genus()), (3, None));
}

#[test]
fn a_vertex_where_a_surface_touches_itself_has_two_fans() {
    // A chain of cells whose ends touch at one corner: a sphere of which two points are one, so χ = 2 − 1.
    let chain = [[0, 0, 0], [0, 0, -1], [1, 0, -1], [2, 0, -1], [2, 1, -1], [2, 1, 0], [2, 1, 1], [1, 1, 1]];
    let t = topology(&voxels(&BTreeSet::from(chain)));
    assert_eq!((t.components, t.nonmanifold_vertices, t.nonmanifold_edges), (1, 1, 0));
    assert_eq!((t.euler_characteristic, t.genus(), t.is_closed()), (1, None, true));
}

// Vertices and corners

#[test]
fn corners_at_one_place_are_one_vertex_whatever_the_sign_of_their_zeros() {
    // A tetrahedron of which every face has its own corners; every other zero is negative.
    let points: Vec<[f64; 3]> = TETRAHEDRON
        .iter()
        .flatten()
        .enumerate()
        .map(|(c, v)| CORNERS[*v as usize].map(|x| if x == 0.0 && c % 2 == 1 { -0.0 } else { x }))
        .collect();
    let t = topology(&mesh(&points, &[[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]));
    assert_manifold(&t, 1, 0);
    assert_eq!((t.coincident_vertices, t.unused_vertices), (8, 0));
    // Corners are those of vertices 0 2 1, 0 1 3, 0 3 2, 1 2 3.
    assert_eq!(t.welded, [0, 1, 2, 0, 2, 5, 0, 5, 1, 2, 1, 5]);
}

#[test]
fn places_a_rounding_apart_are_two() {
    let mut points = CORNERS.to_vec();
    points.push([1.0 + f64::EPSILON, 0.0, 0.0]);
    let t = topology(&mesh(&points, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [4, 2, 3]]));
    assert_eq!((t.coincident_vertices, t.boundary_edges), (0, 4));
    points[4] = [f64::MIN_POSITIVE, 0.0, 0.0];
    assert_eq!(topology(&mesh(&points, &TETRAHEDRON)).coincident_vertices, 0);
}

#[test]
fn vertices_that_no_face_names_are_unused_and_count_nowhere() {
    let points: Vec<[f64; 3]> = CORNERS.into_iter().chain([[9.0; 3], [0.0; 3]]).collect();
    let t = topology(&mesh(&points, &TETRAHEDRON));
    assert_manifold(&t, 1, 0);
    assert_eq!((t.unused_vertices, t.coincident_vertices), (2, 1));
}

#[test]
fn repeated_corners_are_dropped_and_faces_that_collapse_are_counted_only_as_such() {
    let faces: [[u32; 5]; 6] =
        [[0, 0, 2, 1, 0], [0, 1, 1, 1, 3], [0, 3, 2, 2, 0], [1, 2, 3, 3, 1], [2, 2, 2, 2, 2], [1, 1, 0, 0, 1]];
    let t = topology(&mesh(&CORNERS, &faces));
    assert_manifold(&t, 1, 0);
    assert_eq!(t.collapsed_faces, 2);
    assert_eq!(t.component_of_face, [0, 0, 0, 0, u32::MAX, u32::MAX]);
}

#[test]
fn faces_collapse_where_their_corners_fall_together() {
    // Vertex 3 stands where vertex 1 is: the tetrahedron is a triangle and its back, and two faces are gone.
    let mut points = CORNERS;
    points[3] = points[1];
    let t = topology(&mesh(&points, &TETRAHEDRON));
    assert_eq!((t.collapsed_faces, t.coincident_vertices), (2, 1));
    assert_manifold(&t, 1, 0);
}

#[test]
fn nothing_is_neither_closed_nor_balanced() {
    let all_at_one_place = mesh(&[[1.0; 3]; 4], &TETRAHEDRON);
    for (empty, unused, coincident, collapsed) in
        [(Mesh::default(), 0, 0, 0), (mesh::<3>(&CORNERS, &[]), 4, 0, 0), (all_at_one_place, 0, 3, 4)]
    {
        let t = topology(&empty);
        assert!(!t.is_closed() && !t.is_balanced());
        assert_eq!((t.components, t.euler_characteristic, t.genus()), (0, 0, None));
        assert_eq!((t.unused_vertices, t.coincident_vertices, t.collapsed_faces), (unused, coincident, collapsed));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn counts_do_not_depend_on_the_order_of_faces_nor_on_their_first_corners(
        filled in prop::collection::btree_set([0..3, 0..3, 0..3], 1..16),
        missing in 0..3usize,
        seed: u64,
    ) {
        let mesh = voxels(&filled);
        let mut order = faces(&mesh);
        order.drain(..missing.min(order.len() - 1));
        let before = topology(&with_faces(&mesh, order.clone()));
        let mut state = seed;
        for last in (1..order.len()).rev() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            order.swap(last, (state >> 33) as usize % (last + 1));
            order[last].rotate_left((state >> 20) as usize % 4);
        }
        let after = topology(&with_faces(&mesh, order));
        let counts = |t: &Topology| {
            let edges: BTreeSet<_> = t.unbalanced.iter().map(|e| (e.from, e.to, e.surplus)).collect();
            let vertices = (t.unused_vertices, t.nonmanifold_vertices);
            (t.boundary_edges, t.boundary_loops, t.nonmanifold_edges, t.components, t.euler_characteristic, vertices, edges)
        };
        prop_assert_eq!(counts(&before), counts(&after));
    }

    #[test]
    fn counts_agree_with_a_count_of_the_grid_itself(filled in prop::collection::btree_set([0..3, 0..3, 0..3], 1..20)) {
        // Independent of meshes: edges of the grid by the four cells round them.
        let (mut four, mut two) = (0, 0);
        for axis in 0..3 {
            for c in 0..64 {
                let at = [c / 16, c / 4 % 4, c % 4];
                let cell = |b: i32, d: i32| {
                    let mut cell = at;
                    cell[(axis + 1) % 3] -= b;
                    cell[(axis + 2) % 3] -= d;
                    filled.contains(&cell)
                };
                let round = [cell(0, 0), cell(1, 0), cell(1, 1), cell(0, 1)];
                match (0..4).filter(|i| round[*i] != round[(*i + 1) % 4]).count() {
                    4 => four += 1,
                    2 => two += 1,
                    _ => {}
                }
            }
        }
        let mesh = voxels(&filled);
        let t = topology(&mesh);
        prop_assert_eq!((t.nonmanifold_edges, t.boundary_edges, t.inconsistent_edges), (four, 0, 0));
        prop_assert_eq!(t.euler_characteristic, (mesh.points().len() + mesh.faces().len()) as i64 - four as i64 - two);
        prop_assert!(t.is_balanced());
    }
    #[test]
    fn faces_of_any_kind_are_counted_as_one_counts_them_by_hand(
        soup in prop::collection::vec(prop::collection::vec(0..9u32, 3..6), 1..40),
        places in prop::collection::vec(0..7u8, 9),
    ) {
        // More corners at a vertex than are looked at in pairs, edges with many faces, faces that meet themselves, vertices at one place.
        let points = places.iter().map(|p| DVec3::new(f64::from(*p), f64::from(p * p), 0.0)).collect();
        let mut all = Faces::new();
        soup.iter().for_each(|face| all.push(face));
        let t = topology(&Mesh::new(points, all).unwrap());
        let by_hand = Counts::of(&soup, &places);
        prop_assert_eq!(
            (t.boundary_edges, t.nonmanifold_edges, t.inconsistent_edges, t.nonmanifold_vertices),
            (by_hand.boundary, by_hand.many, by_hand.inconsistent, by_hand.pinched)
        );
        prop_assert_eq!((t.component_of_face, t.components), (by_hand.component_of_face, by_hand.components));
        prop_assert_eq!((t.euler_characteristic, t.first_nonmanifold_edge), (by_hand.euler, by_hand.first_many));
        prop_assert_eq!((t.unbalanced, t.collapsed_faces), (by_hand.unbalanced, by_hand.collapsed));
    }
}

/// Counts of a soup of polygons, from lists of all edges and all pairs of corners.
#[derive(Default)]
struct Counts {
    boundary: usize,
    many: usize,
    first_many: Option<[u32; 2]>,
    inconsistent: usize,
    pinched: usize,
    collapsed: usize,
    euler: i64,
    unbalanced: Vec<UnbalancedEdge>,
    components: usize,
    component_of_face: Vec<u32>,
}

impl Counts {
    fn of(soup: &[Vec<u32>], places: &[u8]) -> Self {
        let welded = |v: u32| places.iter().position(|p| *p == places[v as usize]).unwrap() as u32;
        // (from, to, face, corner at from, corner at to) of all sides, corners numbered over all faces.
        let mut sides = Vec::new();
        let mut corners: Vec<u32> = Vec::new();
        let mut counts = Self::default();
        let mut is_live = Vec::new();
        for (face, polygon) in soup.iter().enumerate() {
            let mut ring: Vec<u32> = polygon.iter().map(|v| welded(*v)).collect();
            while let Some(k) = (0..ring.len()).find(|k| ring.len() > 1 && ring[*k] == ring[(k + 1) % ring.len()]) {
                ring.remove(k);
            }
            is_live.push(ring.len() > 2);
            if ring.len() < 3 {
                counts.collapsed += 1;
                continue;
            }
            let first = corners.len();
            for k in 0..ring.len() {
                let next = (k + 1) % ring.len();
                sides.push((ring[k], ring[next], face, first + k, first + next));
            }
            corners.extend(ring);
        }
        let edges: BTreeSet<[u32; 2]> = sides.iter().map(|s| [s.0.min(s.1), s.0.max(s.1)]).collect();
        let mut component: Vec<usize> = (0..soup.len()).collect();
        let mut fan: Vec<usize> = (0..corners.len()).collect();
        let unite = |labels: &mut Vec<usize>, a: usize, b: usize| {
            let (a, b) = (labels[a], labels[b]);
            labels.iter_mut().filter(|label| **label == a.max(b)).for_each(|label| *label = a.min(b));
        };
        for &[low, high] in &edges {
            let here: Vec<_> = sides.iter().filter(|s| [s.0.min(s.1), s.0.max(s.1)] == [low, high]).collect();
            here.iter().for_each(|s| unite(&mut component, here[0].2, s.2));
            let forward = here.iter().filter(|s| s.0 == low).count();
            let backward = here.len() - forward;
            match here[..] {
                [_] => counts.boundary += 1,
                [a, b] => {
                    counts.inconsistent += usize::from(forward != 1);
                    let at = |s: &(u32, u32, usize, usize, usize), v: u32| if s.0 == v { s.3 } else { s.4 };
                    [low, high].iter().for_each(|v| unite(&mut fan, at(a, *v), at(b, *v)));
                }
                _ => {
                    counts.many += 1;
                    counts.first_many.get_or_insert([low, high]);
                }
            }
            if forward != backward {
                let (from, to) = if forward > backward { (low, high) } else { (high, low) };
                let face = here.iter().filter(|s| s.0 == from).map(|s| s.2).min().unwrap() as u32;
                counts.unbalanced.push(UnbalancedEdge { from, to, surplus: forward.abs_diff(backward) as u32, face });
            }
        }
        let vertices: BTreeSet<u32> = corners.iter().copied().collect();
        let fans_at = |v: u32| (0..corners.len()).filter(|c| corners[*c] == v).map(|c| fan[c]).collect::<BTreeSet<_>>();
        counts.pinched = vertices.iter().filter(|v| fans_at(**v).len() > 1).count();
        let labels: BTreeSet<usize> = (0..soup.len()).filter(|f| is_live[*f]).map(|f| component[f]).collect();
        counts.components = labels.len();
        let number = |f: usize| labels.iter().position(|label| *label == component[f]).unwrap() as u32;
        counts.component_of_face = (0..soup.len()).map(|f| if is_live[f] { number(f) } else { u32::MAX }).collect();
        counts.euler = vertices.len() as i64 - edges.len() as i64 + (soup.len() - counts.collapsed) as i64;
        counts
    }
}
