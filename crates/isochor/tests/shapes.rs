//! The built-in solids have the volume and the topology that their documentation says.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use isochor::shapes::{
    bottle, chain, club, cube, cup, cylinder, dolphin, eared_ball, embossed_box, hollow_bottle, hollow_sphere,
    icosphere, plate, screwdriver, stone, uv_torus,
};
use isochor::{Mesh, OpenBoundaries, ParametricSolid, Role, Solid, roles, topology};

/// Relative error of volumes: coordinates are rounded once or twice.
const ROUNDING: f64 = 1e-13;

/// The volume of a closed, balanced, oriented mesh without doubled or unused vertices.
fn checked_volume(mesh: &Mesh, vertices: usize, faces: usize, components: usize, genus: i64) -> f64 {
    assert_eq!((mesh.points().len(), mesh.faces().len()), (vertices, faces));
    let topology = topology(mesh);
    assert!(topology.is_closed() && topology.is_oriented() && topology.is_balanced());
    assert_eq!((topology.coincident_vertices, topology.unused_vertices, topology.collapsed_faces), (0, 0, 0));
    assert_eq!((topology.components, topology.genus(), topology.nonmanifold_vertices), (components, Some(genus), 0));
    Solid::new(mesh, &topology, OpenBoundaries::Refuse).unwrap().volume(mesh.points())
}

fn assert_volume(volume: f64, expected: f64) {
    assert!((volume / expected - 1.0).abs() < ROUNDING, "{volume} instead of {expected}");
}

/// Area of a regular polygon of n corners at distance 1 from its centre.
fn polygon_area(n: usize) -> f64 {
    n as f64 / 2.0 * (TAU / n as f64).sin()
}

#[test]
fn cubes_have_volume_1() {
    for n in [1, 2, 3, 7, 10] {
        assert_volume(checked_volume(&cube(n), 6 * n * n + 2, 6 * n * n, 1, 0), 1.0);
    }
    let bounds = cube(3).bounds().unwrap();
    assert_eq!((bounds.min, bounds.max), (DVec3::ZERO, DVec3::ONE));
}

#[test]
fn plates_have_the_volume_of_their_box() {
    let size = DVec3::new(2.0, 3.0, 0.01);
    let [a, b] = [8, 5];
    let plate = plate(size, [a, b]);
    assert_volume(checked_volume(&plate, 2 * (a + 1) * (b + 1), 2 * (a * b + a + b), 1, 0), 2.0 * 3.0 * 0.01);
    assert_eq!(plate.bounds().unwrap().size(), size);
}

#[test]
fn icospheres_approach_the_sphere() {
    let edge = 4.0 / (10.0 + 2.0 * 5.0_f64.sqrt()).sqrt();
    let icosahedron = 5.0 * (3.0 + 5.0_f64.sqrt()) / 12.0 * edge.powi(3);
    assert_volume(checked_volume(&icosphere(0), 12, 20, 1, 0), icosahedron);
    let mut missing = 4.0 / 3.0 * PI - icosahedron;
    for level in 1..=5 {
        let four = 4_usize.pow(level as u32);
        let mesh = icosphere(level);
        assert!(mesh.points().iter().all(|p| (p.length() - 1.0).abs() < 1e-15));
        let volume = checked_volume(&mesh, 10 * four + 2, 20 * four, 1, 0);
        // Second order: each level leaves a quarter, the more exactly the finer the mesh is.
        let ratio = (4.0 / 3.0 * PI - volume) / missing;
        assert!((ratio - 0.25).abs() < 0.1 / 3.0_f64.powi(level as i32 - 1), "level {level}: {ratio}");
        missing *= ratio;
    }
}

#[test]
fn hollow_spheres_are_spheres_with_a_cavity() {
    for (level, inner) in [(0, 0.5), (2, 0.9), (3, 0.1)] {
        let four = 4_usize.pow(level as u32);
        let outer = checked_volume(&icosphere(level), 10 * four + 2, 20 * four, 1, 0);
        let volume = checked_volume(&hollow_sphere(level, inner), 20 * four + 4, 40 * four, 2, 0);
        assert_volume(volume, outer * (1.0 - inner.powi(3)));
    }
}

#[test]
fn tori_have_the_volume_of_pappus() {
    for (major, minor, nu, nv) in [(2.0, 0.5, 3, 3), (1.0, 0.25, 48, 24), (3.0, 2.9, 17, 10)] {
        let volume = checked_volume(&uv_torus(major, minor, nu, nv), nu * nv, 2 * nu * nv, 1, 1);
        assert_volume(volume, 2.0 * polygon_area(nu) * major * polygon_area(nv) * minor * minor);
    }
}

#[test]
fn cylinders_are_prisms() {
    for (radius, height, segments, rings) in [(1.0, 2.0, 3, 1), (0.5, 3.0, 32, 8), (2.0, 0.1, 101, 2)] {
        let (vertices, faces) = (segments * (rings + 1) + 2, segments * (rings + 2));
        let volume = checked_volume(&cylinder(radius, height, segments, rings), vertices, faces, 1, 0);
        assert_volume(volume, polygon_area(segments) * radius * radius * height);
    }
}

/// Radius of the bottle at height z.
fn bottle_radius(z: f64) -> f64 {
    match z {
        z if z <= 1.5 => 0.8,
        z if z >= 2.25 => 0.3,
        z => {
            let t = (z - 1.5) / 0.75;
            0.8 - 0.5 * (3.0 * t * t - 2.0 * t * t * t)
        }
    }
}

/// Volume of frusta of equal height one upon another, over a regular polygon; `less` is taken off all radii of the bottle.
fn bottle_volume(segments: usize, rings: usize, height: f64, less: f64) -> f64 {
    let frustum = |r: usize| {
        let [a, b] = [r, r + 1].map(|r| bottle_radius(3.0 * r as f64 / rings as f64) - less);
        height / rings as f64 * (a * a + a * b + b * b) / 3.0
    };
    polygon_area(segments) * (0..rings).map(frustum).sum::<f64>()
}

#[test]
fn bottles_are_stacks_of_frusta() {
    for (segments, rings) in [(3, 1), (32, 30), (64, 100)] {
        let volume = checked_volume(&bottle(segments, rings), segments * (rings + 1) + 2, segments * (rings + 2), 1, 0);
        assert_volume(volume, bottle_volume(segments, rings, 3.0, 0.0));
    }
}

#[test]
fn hollow_bottles_are_frusta_less_frusta() {
    for (segments, rings, wall) in [(3, 1, 0.1), (5, 2, 0.29), (7, 3, 0.2), (32, 30, 0.05), (64, 100, 0.01)] {
        let mesh = hollow_bottle(segments, rings, wall);
        let material = checked_volume(&mesh, 2 * (segments * (rings + 1) + 2), 2 * segments * (rings + 2), 2, 0);
        let outer = bottle_volume(segments, rings, 3.0, 0.0);
        let capacity = bottle_volume(segments, rings, 3.0 - 2.0 * wall, wall);
        assert_volume(material, outer - capacity);
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
        let volumes = solid.volumes(mesh.points());
        assert_volume(volumes.components[0], outer);
        assert_volume(volumes.components[1], -capacity);

        let roles = roles(&solid, mesh.points(), &volumes);
        let Role::Shell(shell) = &roles[0] else { panic!("{roles:?}") };
        assert_eq!((&shell.cavities, &roles[1]), (&vec![1], &Role::Cavity { of: 0 }));
        assert_volume(shell.capacity(&volumes), capacity);
        assert_volume(shell.material(&volumes), outer - capacity);
        // The corners of the cavity stand at the angles of the outer ones, nearer to the axis than the side there.
        let side = |z: f64| {
            let at = z / 3.0 * rings as f64;
            let [a, b] = [at.floor(), at.floor() + 1.0].map(|r| bottle_radius(3.0 * r / rings as f64));
            a + (b - a) * at.fract()
        };
        for p in &mesh.points()[mesh.points().len() / 2..] {
            assert!(p.z > 0.99 * wall && p.z < 3.0 - 0.99 * wall, "{p}");
            assert!(p.truncate().length() < side(p.z) - 0.1 * wall, "{p}");
        }
    }
}

#[test]
fn eared_balls_approach_the_integral_of_their_distance() {
    // (1 + a E₁ + a E₂)³/3 over the sphere, E_i = exp(k (d·e_i − 1)): products are exp(d·s − n k), s the sum of n vectors k e_i,
    // and ∫ exp(d·s) = 4π sinh|s|/|s|.
    let (a, k, ears) = (0.6, 40.0, [2, 3].map(|v| icosphere(0).points()[v]));
    let mut expected = 0.0;
    for first in 0..=3 {
        for second in 0..=3 - first {
            let (n, factorial) = (first + second, [1.0, 1.0, 2.0, 6.0]);
            let ways = 6.0 / (factorial[first] * factorial[second] * factorial[3 - n]);
            let s = (k * (first as f64 * ears[0] + second as f64 * ears[1])).length();
            // sinh s = exp(s)/2 but for s = 0
            let integral = if n == 0 { 4.0 * PI } else { TAU * (s - n as f64 * k).exp() / s };
            expected += ways * f64::powi(a, n as i32) * integral / 3.0;
        }
    }
    let missing = [4, 5, 6].map(|levels| {
        let four = 4_usize.pow(levels as u32);
        expected - checked_volume(&eared_ball(levels), 10 * four + 2, 20 * four, 1, 0)
    });
    assert!(missing[0] > 0.0 && missing[2] < 2e-3 * expected, "{missing:?}");
    for pair in missing.windows(2) {
        assert!((pair[0] / pair[1] - 4.0).abs() < 0.1, "{missing:?}"); // second order
    }
    let tip = eared_ball(5).points()[3];
    assert!((tip.length() - 1.6).abs() < 1e-9 && tip.y > 0.8 && tip.z > 1.3, "{tip}");
}

#[test]
fn chains_have_the_volume_of_their_links() {
    for (links, nu, nv) in [(1, 3, 3), (2, 12, 8), (5, 24, 12)] {
        let mesh = chain(links, nu, nv);
        let volume = checked_volume(&mesh, links * nu * nv, 2 * links * nu * nv, links, links as i64);
        let link = nu as f64 * (TAU / nu as f64).sin() * polygon_area(nv) * 0.2 * 0.2;
        assert_volume(volume, links as f64 * link);
    }
    // The gap between links on a line: a tube of radius 0.2 about a circle of radius 1, the next one crosses at 0.5 from its centre.
    let mesh = chain(2, 96, 48);
    let [one, next] = [&mesh.points()[..96 * 48], &mesh.points()[96 * 48..]];
    let nearest = one.iter().flat_map(|p| next.iter().map(|q| p.distance(*q))).fold(f64::INFINITY, f64::min);
    assert!((nearest - 0.1).abs() < 1e-9, "{nearest}");
}

#[test]
fn embossed_boxes_have_the_volume_of_the_box_and_of_their_bosses() {
    for n in [5, 6, 13, 48] {
        let volume = checked_volume(&embossed_box(n), 6 * n * n + 2, 6 * n * n, 1, 0);
        assert_volume(volume, 1.6 + 0.06 / 4.0 * 2.0 * (2.0 + 1.6 + 0.8));
    }
    // Bosses are full where the middles of parts are corners: 4 along x, 2 along the others.
    let bounds = embossed_box(16).bounds().unwrap();
    let boss = DVec3::splat(0.06);
    assert!((bounds.min + boss).length() < 1e-14 && (bounds.max - DVec3::new(2.0, 1.0, 0.8) - boss).length() < 1e-14);
}

/// The area within a ring of corners round the z-axis.
fn ring_area(ring: &[DVec3]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|(p, q)| p.x * q.y - q.x * p.y).sum::<f64>() / 2.0
}

/// The volume of a stack of rings of corners round the z-axis. Between two rings all edges are straight, so the section's area is
/// quadratic in z, and Simpson's rule exact. Half way its corners are the middles of edges and of the diagonals that divide the quads.
fn stack_volume(rings: &[&[DVec3]]) -> f64 {
    let slab = |pair: &[&[DVec3]]| {
        let [low, high] = [pair[0], pair[1]];
        let next = |s: usize| (s + 1) % low.len();
        let middles: Vec<DVec3> =
            (0..low.len()).flat_map(|s| [high[s], high[next(s)]].map(|p| low[s].midpoint(p))).collect();
        (high[0].z - low[0].z) / 6.0 * (ring_area(low) + 4.0 * ring_area(&middles) + ring_area(high))
    };
    rings.windows(2).map(slab).sum()
}

#[test]
fn dolphins_are_stacks_of_prismatoids_and_tend_to_what_their_sections_hold() {
    for n in [3, 8, 32, 96] {
        let mesh = dolphin(n);
        let volume = checked_volume(&mesh, n * (2 * n + 1) + 2, 2 * n * (n + 1), 1, 0);
        let upright: Vec<DVec3> = mesh.points().iter().map(|p| DVec3::new(p.y, p.z, p.x)).collect();
        assert_volume(volume, stack_volume(&upright[..n * (2 * n + 1)].chunks(n).collect::<Vec<_>>()));
    }
    // ∫ ρ²/2 dφ = π + 2 f J(24)/2 + f² J(48)/2 with J(m) = ∫₀^π sin^m = π (1·3·…·(m−1)) / (2·4·…·m), at the height of the fin.
    let integral = |m: usize| PI * (1..=m / 2).map(|k| (2 * k - 1) as f64 / (2 * k) as f64).product::<f64>();
    let n = 800;
    let fin: Vec<DVec3> = dolphin(n).points()[n * n..n * (n + 1)].iter().map(|p| DVec3::new(p.y, p.z, p.x)).collect();
    let [a, b] = [fin[0].x, -fin[3 * n / 4].y]; // φ = 0 and φ = 3π/2
    let expected = a * b * (PI + 0.8 * integral(24) + 0.32 * integral(48));
    assert_eq!(fin[0].z, 1.5);
    assert!((ring_area(&fin) / expected - 1.0).abs() < 1e-4, "{} instead of {expected}", ring_area(&fin));
}

#[test]
#[should_panic(expected = "a dolphin needs at least 3 segments, not 2")]
fn a_flat_dolphin_is_refused() {
    let _ = dolphin(2);
}

#[test]
fn clubs_tend_to_the_smooth_one() {
    let smooth = ParametricSolid::club().volume().unwrap().volume;
    let [coarse, fine] = [32, 64].map(|m| {
        let faces = 4 * m * (m - 1);
        let mesh = club(faces);
        1.0 - checked_volume(&mesh, faces / 2 + 2, faces, 1, 0) / smooth
    });
    assert!(coarse > 0.0 && (coarse / fine - 4.0).abs() < 0.1, "{coarse} and {fine}");
    assert_eq!(club(0).faces().len(), 80);
}

#[test]
fn screwdrivers_are_stacks_of_prismatoids() {
    for n in [3, 7, 32, 96] {
        let mesh = screwdriver(n);
        let volume = checked_volume(&mesh, n * (2 * n + 1) + 2, 2 * n * (n + 1), 1, 0);
        let rings: Vec<&[DVec3]> = mesh.points()[..n * (2 * n + 1)].chunks(n).collect();
        assert_volume(volume, stack_volume(&rings));
        if n < 32 {
            continue; // flutes are finer
        }
        let ring = |z: f64| rings[(z / 3.0 * (2 * n) as f64).round() as usize];
        let fluted = 1.0 + 0.08 * 0.08 / 2.0 * (16.0 * PI / n as f64).cos();
        for (z, a, b, flutes) in [(0.0, 0.16, 0.025, 1.0), (1.0, 0.08, 0.08, 1.0), (2.5, 0.3, 0.3, fluted)] {
            assert_volume(ring_area(ring(z)), polygon_area(n) * a * b * flutes);
        }
        assert_eq!((ring(0.0)[0].z, ring(3.0)[0].z), (0.0, 3.0));
    }
}

#[test]
fn cups_are_frusta_and_a_bent_tube() {
    let tube = 0.4 * PI * (PI * 0.1 * 0.08);
    for (n, tolerance) in [(1, 0.6), (2, 0.3), (4, 0.15), (12, 0.05)] {
        let mesh = cup(n);
        let (segments, rings) = (24 * n, 2 * (8 * n + 1));
        // Two patches of n × n quads go, with what is inside them; 8n rows of the tube and 8n − 1 rings of 4n corners come.
        let vertices = segments * rings + 2 - 2 * (n - 1) * (n - 1) + (8 * n - 1) * 4 * n;
        let faces = segments * (rings + 1) - 2 * n * n + 8 * n * 4 * n;
        let volume = checked_volume(&mesh, vertices, faces, 1, 1);
        let frusta = |height: f64, low: f64, high: f64| height * (low * low + low * high + high * high) / 3.0;
        let body = polygon_area(segments) * (frusta(1.6, 0.65, 0.81) - frusta(1.5, 0.58, 0.73));
        assert!((volume - body - tube).abs() < tolerance * tube, "{n}: {} of {tube}", volume - body);
        let bounds = mesh.bounds().unwrap();
        assert!((bounds.min.z, bounds.max.z) == (0.0, 1.6) && (bounds.max.y + bounds.min.y).abs() < 1e-12);
        assert!((bounds.max.x - (0.65 + 0.09 + 0.4 + 0.08)).abs() < 0.03, "{bounds:?}");
    }
}

#[test]
#[should_panic(expected = "an embossed box needs at least 5 quads along every side, not 4")]
fn a_box_with_too_few_quads_for_its_bosses_is_refused() {
    let _ = embossed_box(4);
}

#[test]
#[should_panic(expected = "a screwdriver needs at least 3 segments, not 2")]
fn a_flat_screwdriver_is_refused() {
    let _ = screwdriver(2);
}

#[test]
#[should_panic(expected = "a cup needs at least 1 quad")]
fn a_cup_without_quads_is_refused() {
    let _ = cup(0);
}

#[test]
#[should_panic(expected = "a box needs at least one rectangle along every side")]
fn a_cube_without_squares_is_refused() {
    let _ = cube(0);
}

#[test]
#[should_panic(expected = "the minor radius is between 0 and 1, not 1")]
fn a_torus_without_hole_is_refused() {
    let _ = uv_torus(1.0, 1.0, 8, 8);
}

#[test]
#[should_panic(expected = "a solid of revolution needs at least 3 segments, not 2")]
fn a_flat_cylinder_is_refused() {
    let _ = cylinder(1.0, 1.0, 2, 1);
}

#[test]
#[should_panic(expected = "the cavity has a radius between 0 and 1, not NaN")]
fn a_cavity_without_size_is_refused() {
    let _ = hollow_sphere(0, f64::NAN);
}

#[test]
#[should_panic(expected = "the wall of a bottle is between 0 and 0.3 thick, not 0.3")]
fn a_wall_without_room_is_refused() {
    let _ = hollow_bottle(8, 8, 0.3);
}

#[test]
fn stones_have_any_number_of_vertices_and_approach_the_volume_of_the_ball() {
    for vertices in (5..200).chain([2562, 34_727]) {
        checked_volume(&stone(vertices), vertices, 2 * vertices - 4, 1, 0);
    }
    let missing = |vertices: usize| {
        (checked_volume(&stone(vertices), vertices, 2 * vertices - 4, 1, 0) / (4.0 / 3.0 * PI) - 1.0).abs()
    };
    let ladder: Vec<f64> = [1000, 4000, 16_000, 64_000].map(missing).into();
    // Errors of inscribed triangles fall with their area.
    assert!(ladder.windows(2).all(|pair| (3.0..5.0).contains(&(pair[0] / pair[1]))), "{ladder:?}");
    assert!(ladder[3] < 1e-3, "{ladder:?}");
}

#[test]
#[should_panic(expected = "at least 5 vertices, not 4")]
fn a_stone_of_four_vertices_is_refused() {
    let _ = stone(4);
}
